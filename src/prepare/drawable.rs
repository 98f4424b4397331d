//! The splats of a picture, made when it asks for them and kept for the next.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::cells::{Coarsening, VoxelLight};
use super::levels::ScalarNeed;
use super::media;
use super::pyramid::Pyramid;
use super::scalar_cells::{self, Coarse};
use super::scalars::{Asked, Emission};
use super::shadows::{Arriving, Shadows, shaded};
use crate::error::{Error, Result};
use crate::gpu::cache::Cache;
use crate::gpu::classify::{Classified, Classifier, HostClassifier};
use crate::gpu::context::Context;
use crate::gpu::light_volume::LightVolume;
use crate::gpu::scan::Scan;
use crate::gpu::store::{Bricks, Emitted, Store};
use crate::gpu::timing::on_host;
use crate::gpu::transfer::{Reduction, Shows, TransferTable};
use crate::kernel::{Kernel, Normalization};
use crate::layers::Layers;
use crate::progress::Progress;
use crate::settings::{Model, Settings};
use crate::transfer::{Resolution, TransferFunction};
use crate::volume::Volume;

/// A volume as pre-shading draws it.
pub(super) struct PreShaded {
    pub(super) layers: Layers,
    /// Whether splats have normals.
    pub(super) lit: bool,
    /// The voxels that show, once a picture has asked for them.
    pub(super) classified: Mutex<Option<(Option<Shadows>, Arc<Classified>)>>,
    /// The cells of the levels that the picture before asked for.
    pub(super) cells: Mutex<Vec<CellsOf>>,
}

/// The cells of a level.
pub(super) struct CellsOf {
    pub(super) level: u32,
    pub(super) light: Option<VoxelLight>,
    pub(super) shadows: Option<Shadows>,
    pub(super) cells: Arc<Emitted>,
}

/// A volume as post-shading draws it.
pub(super) struct PostShaded {
    /// The samples, filtered if the picture is to be sharper.
    pub(super) volume: Volume,
    /// What they are filtered for.
    pub(super) sharpened: Option<(Kernel, f64)>,
    /// The volume at lower resolutions, for kernels that have grown.
    pub(super) pyramid: Pyramid,
    pub(super) transfer: TransferFunction,
    pub(super) reduction: Reduction,
    /// Which differences of values are rounding.
    pub(super) resolution: Resolution,
    /// The model that it was prepared for.
    pub(super) model: Model,
    pub(super) shows: Shows,
    /// What scalars are classified by, for cells of a level.
    pub(super) table: Mutex<Option<(u32, Arc<TransferTable>)>>,
    /// Whether things of one value show; empty until a lit picture asks.
    pub(super) plateaus: OnceLock<bool>,
    /// The light that arrives, for the lights of the picture before.
    pub(super) light: Mutex<Option<(Shadows, Arc<LightVolume>)>>,
    /// The splats of the picture before, drawn again unless a picture needs others.
    pub(super) emitted: Mutex<Option<(Asked, Arc<Emitted>)>>,
}

/// The splats of one picture.
pub(crate) enum Drawable {
    Splats(Arc<Classified>),
    Emitted(Arc<Emitted>),
}

/// What a picture asks of a scene.
#[derive(Clone, Copy)]
pub(crate) struct Wanted<'a> {
    pub(crate) settings: &'a Settings,
    /// The level whose cells stand for the voxels of a pre-shaded scene.
    pub(crate) level: u32,
    /// Which light is kept from voxels.
    pub(crate) shadows: Option<&'a Shadows>,
    /// The light on the voxels of cells.
    pub(crate) light: Option<&'a VoxelLight>,
    /// The cells that stand for those of a post-shaded one, and the kernel of its voxels.
    pub(crate) coarse: Option<(Coarse, Kernel, Normalization)>,
    /// How far the scalars of a post-shaded one must reach.
    pub(crate) need: ScalarNeed,
}

impl PostShaded {
    /// The splats of scalars that are asked for.
    pub(super) fn emit(&self, context: &Context, asked: &Asked, progress: &Progress) -> Result<Emitted> {
        let Self { volume, pyramid, transfer, reduction, shows, .. } = self;
        Emission::new(context, volume, transfer, reduction, *shows, asked)?.emit(context, pyramid, progress)
    }

    pub(super) fn has_plateaus(&self) -> Result<bool> {
        if let Some(known) = self.plateaus.get() {
            return Ok(*known);
        }
        let found = scalar_cells::has_plateaus(&self.volume, &self.transfer)?;
        Ok(*self.plateaus.get_or_init(|| found))
    }
}

impl PreShaded {
    /// The voxels that show.
    pub(super) fn classified(
        &self,
        context: &Context,
        pipelines: &Cache,
        shadows: Option<&Shadows>,
        progress: &Progress,
    ) -> Result<(Drawable, f64)> {
        let lock = || self.classified.lock().unwrap_or_else(PoisonError::into_inner);
        let held = lock().clone();
        if let Some((of, classified)) = &held
            && of.as_ref() == shadows
        {
            return Ok((Drawable::Splats(Arc::clone(classified)), 0.0));
        }
        let (classified, seconds) = on_host(|| {
            context.guarded("classifying the volume", || {
                // What light keeps from voxels is told anew, which they are is not.
                let classified = match held {
                    Some((_, classified)) if shadows.is_some() => classified,
                    _ => Arc::new(match self.layers.plain() {
                        None => media::classified(context, &self.layers, self.lit, progress)?,
                        // Such a device is the host, which classifies faster without it.
                        Some((volume, transfer)) if context.info.is_software() => {
                            HostClassifier::run(context, volume, transfer, self.lit, progress)?
                        }
                        Some((volume, transfer)) => {
                            let scan = Scan::of(pipelines, context)?;
                            let classifier = pipelines.get_or_make((), || Ok(Classifier::new(context)))?;
                            classifier.run(context, &scan, volume, transfer, self.lit, progress)?
                        }
                    }),
                };
                let Some(shadows) = shadows else { return Ok(classified) };
                let stores = shaded(context, &classified.stores, shadows, progress)?;
                Ok(Arc::new(Classified { stores, bricks: classified.bricks, kept: Cache::default() }))
            })
        });
        let classified = classified?;
        *lock() = Some((shadows.cloned(), Arc::clone(&classified)));
        Ok((Drawable::Splats(classified), seconds))
    }

    /// The cells of a level.
    pub(super) fn cells(
        &self,
        context: &Context,
        pipelines: &Cache,
        Wanted { level, light, shadows, .. }: Wanted<'_>,
        progress: &Progress,
    ) -> Result<(Drawable, f64)> {
        let lock = || self.cells.lock().unwrap_or_else(PoisonError::into_inner);
        let serves = |of: &CellsOf| of.level == level && of.light.as_ref() == light && of.shadows.as_ref() == shadows;
        let held = lock().iter().find(|of| serves(of)).map(|of| Arc::clone(&of.cells));
        if let Some(cells) = held {
            return Ok((Drawable::Emitted(cells), 0.0));
        }
        // Those of another light go first, so that old and new are never in memory together.
        lock().retain(|cells| cells.level != level);
        let Some((volume, transfer)) = self.layers.plain() else {
            return Err(Error::volume("several layers have no cells"));
        };
        let (cells, seconds) = on_host(|| {
            let shaded = shadows.map(|_| self.classified(context, pipelines, shadows, progress)).transpose()?;
            context.guarded("classifying the volume", || {
                let dims = volume.grid().dims();
                let arriving = |(shaded, _): (Drawable, f64)| Arriving::new(context, shaded.stores(), dims);
                let arriving = shaded.map(arriving).transpose()?;
                let light = light.map(|light| (light, arriving.as_ref()));
                Coarsening::new(volume, transfer, level, light).emit(context, progress)
            })
        });
        let cells = Arc::new(cells?);
        let (light, shadows) = (light.cloned(), shadows.cloned());
        lock().push(CellsOf { level, light, shadows, cells: Arc::clone(&cells) });
        Ok((Drawable::Emitted(cells), seconds))
    }
}

impl Drawable {
    pub(crate) fn stores(&self) -> &[Store] {
        match self {
            Self::Splats(classified) => &classified.stores,
            Self::Emitted(emitted) => &emitted.stores,
        }
    }

    /// What painters made of them for the pictures before.
    pub(crate) fn kept(&self) -> &Cache {
        match self {
            Self::Splats(classified) => &classified.kept,
            Self::Emitted(emitted) => &emitted.kept,
        }
    }

    pub(crate) fn splats(&self) -> u64 {
        self.stores().iter().map(|s| u64::from(s.count)).sum()
    }

    /// Those that are voxels of the volume.
    pub(crate) fn voxels(&self) -> u64 {
        match self {
            Self::Splats(_) => self.splats(),
            Self::Emitted(emitted) => emitted.voxels,
        }
    }

    /// The bricks that splats were looked for in.
    pub(crate) fn bricks(&self) -> &Bricks {
        match self {
            Self::Splats(classified) => &classified.bricks,
            Self::Emitted(emitted) => &emitted.bricks,
        }
    }

    /// Bytes on the device.
    pub(crate) fn bytes(&self) -> u64 {
        self.stores().iter().map(Store::bytes).sum()
    }
}
