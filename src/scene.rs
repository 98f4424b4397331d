//! A volume prepared on a device.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::{Error, Result};
use crate::gpu::cache::Cache;
use crate::gpu::classify::Classified;
use crate::gpu::context::Context;
use crate::gpu::scalars::{self, Asked, Emission, Emitted, Shows};
use crate::gpu::store::{Bricks, Store};
use crate::gpu::timing::on_host;
use crate::gpu::transfer::{Reduction, TransferTable};
use crate::gpu::view::{ScalarNeed, Weights};
use crate::progress::Progress;
use crate::settings::{Model, Settings};
use crate::transfer::TransferFunction;
use crate::volume::{Grid, Pyramid, Volume};

/// A volume prepared on the device of the [`Renderer`](crate::renderer::Renderer) that prepared it.
pub struct Scene {
    content: Content,
    grid: Grid,
    weights: Weights,
    /// What painters made of it for the pictures before.
    kept: Cache,
    /// Seconds of preparation that no picture has reported yet, as the bits of an f64.
    seconds: AtomicU64,
    /// [`Context::id`] of the device that holds it.
    device: u64,
}

/// What is on the device.
enum Content {
    /// Classified voxels, lit or not.
    Splats { classified: Classified, lit: bool },
    /// Scalars, classified when they have been reconstructed.
    Scalars(Box<Scalars>),
}

/// A volume as post-shading draws it.
struct Scalars {
    volume: Volume,
    /// The volume at lower resolutions, for kernels that have grown.
    pyramid: Pyramid,
    transfer: TransferFunction,
    reduction: Reduction,
    shows: Shows,
    table: TransferTable,
    /// The splats of the picture before, drawn again unless a picture needs others.
    emitted: Mutex<Option<(Asked, Arc<Emitted>)>>,
}

/// The splats of one picture.
pub(crate) enum Drawable<'a> {
    Splats(&'a Classified),
    Scalars(Arc<Emitted>),
}

fn shows(settings: &Settings) -> Shows {
    if settings.model == Model::Mip { Shows::Largest } else { Shows::Opaque }
}

/// The distance that opacities are per, in units of [`Grid::local`].
fn local_unit(transfer: &TransferFunction, grid: &Grid) -> f64 {
    transfer.unit_or(grid.min_spacing()) / grid.unit()
}

impl Scene {
    fn new(context: &Context, content: Content, grid: Grid, weights: Weights, seconds: f64) -> Self {
        let seconds = AtomicU64::new(seconds.to_bits());
        Self { content, grid, weights, kept: Cache::default(), seconds, device: context.id }
    }

    /// A scene of classified voxels, which took `seconds`.
    pub(crate) fn of_splats(
        context: &Context,
        classified: Classified,
        lit: bool,
        volume: &Volume,
        transfer: &TransferFunction,
        seconds: f64,
    ) -> Self {
        let weights = Weights {
            max: TransferFunction::extinction(transfer.max_opacity(), 1.0),
            unit: local_unit(transfer, volume.grid()),
            // Light may turn any colour white.
            brightest: if lit { [1.0; 3] } else { transfer.brightest() },
        };
        Self::new(context, Content::Splats { classified, lit }, *volume.grid(), weights, seconds)
    }

    /// A scene of scalars: all of post-shading that does not depend on the camera.
    pub(crate) fn of_scalars(
        context: &Context,
        volume: &Volume,
        transfer: &TransferFunction,
        settings: &Settings,
    ) -> Result<Self> {
        let shows = shows(settings);
        let (largest, seconds) = on_host(|| scalars::largest(volume, transfer.base()));
        let largest = largest?;
        let reduction = Reduction::new(transfer, largest);
        let weights = Weights { max: reduction.length(largest), unit: 1.0, brightest: [1.0; 3] };
        let scalars = Scalars {
            volume: volume.clone(),
            pyramid: Pyramid::default(),
            transfer: transfer.clone(),
            reduction,
            shows,
            table: TransferTable::new(context, transfer, &reduction, shows, local_unit(transfer, volume.grid())),
            emitted: Mutex::new(None),
        };
        Ok(Self::new(context, Content::Scalars(Box::new(scalars)), *volume.grid(), weights, seconds))
    }

    pub(crate) fn grid(&self) -> &Grid {
        &self.grid
    }

    pub(crate) fn weights(&self) -> Weights {
        self.weights
    }

    /// Seconds that preparing took, told once: pictures after the first did not take them.
    pub(crate) fn take_seconds(&self) -> f64 {
        f64::from_bits(self.seconds.swap(0, Ordering::Relaxed))
    }

    /// What scalars are classified by.
    pub(crate) fn table(&self) -> Option<&TransferTable> {
        match &self.content {
            Content::Splats { .. } => None,
            Content::Scalars(scalars) => Some(&scalars.table),
        }
    }

    /// What painters made of it for the pictures before.
    pub(crate) fn kept(&self) -> &Cache {
        &self.kept
    }

    /// Refuses a scene of another device, and settings that it was not prepared for.
    pub(crate) fn check(&self, context: &Context, settings: &Settings) -> Result<()> {
        let error = |name, what: &str| {
            let reason = format!("the scene was prepared {what}: prepare it with the settings it is rendered with");
            Err(Error::Setting { name, reason })
        };
        if self.device != context.id {
            return error("scene", "by another renderer, on another device");
        }
        match &self.content {
            Content::Splats { .. } if settings.is_post_shaded() => error("shading", "for pre-shading"),
            Content::Splats { lit: false, .. } if settings.lighting.is_some() => error("light", "without light"),
            Content::Scalars(_) if !settings.is_post_shaded() => error("shading", "for post-shading"),
            Content::Scalars(scalars) if scalars.shows != shows(settings) => error("model", "for another model"),
            _ => Ok(()),
        }
    }

    /// The splats that a picture is made of, and the seconds it took to make them, 0 if the scene held them.
    pub(crate) fn drawable(
        &self,
        context: &Context,
        need: ScalarNeed,
        settings: &Settings,
        progress: &Progress,
    ) -> Result<(Drawable<'_>, f64)> {
        let scalars = match &self.content {
            Content::Splats { classified, .. } => return Ok((Drawable::Splats(classified), 0.0)),
            Content::Scalars(scalars) => scalars,
        };
        let Settings { kernel, normalization, ref lighting, .. } = *settings;
        let asked = Asked { kernel, normalization, need, lit: lighting.is_some() };
        let lock = || scalars.emitted.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((of, emitted)) = lock().as_ref()
            && of.serves(&asked)
        {
            return Ok((Drawable::Scalars(Arc::clone(emitted)), 0.0));
        }
        // Not under the lock: who emits waits for a pool of threads, which may hand it work that asks for the lock.
        let (emitted, seconds) = on_host(|| {
            context.guarded("emitting scalars", || {
                let Scalars { volume, pyramid, transfer, reduction, shows, .. } = scalars.as_ref();
                let emission = Emission::new(context, volume, transfer, reduction, *shows, &asked)?;
                emission.emit(context, pyramid, progress)
            })
        });
        let emitted = Arc::new(emitted?);
        self.kept.clear();
        *lock() = Some((asked, Arc::clone(&emitted)));
        Ok((Drawable::Scalars(emitted), seconds))
    }
}

impl Drawable<'_> {
    pub(crate) fn stores(&self) -> &[Store] {
        match self {
            Self::Splats(classified) => &classified.stores,
            Self::Scalars(emitted) => &emitted.stores,
        }
    }

    pub(crate) fn splats(&self) -> u64 {
        self.stores().iter().map(|s| u64::from(s.count)).sum()
    }

    /// Those that are voxels of the volume.
    pub(crate) fn voxels(&self) -> u64 {
        match self {
            Self::Splats(_) => self.splats(),
            Self::Scalars(emitted) => emitted.voxels,
        }
    }

    /// The bricks that splats were looked for in.
    pub(crate) fn bricks(&self) -> &Bricks {
        match self {
            Self::Splats(classified) => &classified.bricks,
            Self::Scalars(emitted) => &emitted.bricks,
        }
    }

    /// Bytes on the device.
    pub(crate) fn bytes(&self) -> u64 {
        self.stores().iter().map(Store::bytes).sum()
    }
}
