//! A volume prepared on a device.

use std::sync::{Arc, Mutex, PoisonError};

use crate::error::{Error, Result};
use crate::gpu::classify::Classified;
use crate::gpu::context::Context;
use crate::gpu::quads::plan::{Plan, Subject};
use crate::gpu::scalars::{self, Asked, Emitted, Shows};
use crate::gpu::store::{Bricks, Store};
use crate::gpu::tiles::{self, Packed};
use crate::gpu::timing::on_host;
use crate::gpu::transfer::TransferTable;
use crate::settings::{Model, Settings};
use crate::transfer::TransferFunction;
use crate::volume::{Grid, Volume};

/// A volume prepared on the device of the [`Renderer`](crate::renderer::Renderer) that prepared it.
pub struct Scene {
    content: Content,
    grid: Grid,
    subject: Subject,
    /// What the painter `tiles` made of it for the picture before.
    packed: Mutex<Vec<Arc<Packed>>>,
    /// Seconds that it took to prepare.
    pub(crate) seconds: f64,
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
    transfer: TransferFunction,
    shows: Shows,
    table: TransferTable,
    /// The splats of the picture before, drawn again where nothing asks for others.
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

impl Scene {
    /// A scene of classified voxels.
    pub(crate) fn of_splats(
        classified: Classified,
        lit: bool,
        volume: &Volume,
        transfer: &TransferFunction,
        seconds: f64,
    ) -> Self {
        let subject = Subject {
            max_weight: TransferFunction::extinction(transfer.max_opacity(), 1.0),
            unit: transfer.unit_or(volume.grid().min_spacing()),
        };
        Self {
            content: Content::Splats { classified, lit },
            grid: *volume.grid(),
            subject,
            packed: Mutex::default(),
            seconds,
        }
    }

    /// A scene of scalars: all of post-shading that does not depend on the camera.
    pub(crate) fn of_scalars(
        context: &Context,
        volume: &Volume,
        transfer: &TransferFunction,
        settings: &Settings,
    ) -> Result<Self> {
        let shows = shows(settings);
        let (max_weight, seconds) = on_host(|| scalars::largest(volume, transfer.base()));
        let max_weight = max_weight?;
        let scalars = Scalars {
            volume: volume.clone(),
            transfer: transfer.clone(),
            shows,
            table: TransferTable::new(context, transfer, shows, transfer.unit_or(volume.grid().min_spacing())),
            emitted: Mutex::new(None),
        };
        Ok(Self {
            content: Content::Scalars(Box::new(scalars)),
            grid: *volume.grid(),
            subject: Subject { max_weight, unit: 1.0 },
            packed: Mutex::default(),
            seconds,
        })
    }

    pub(crate) fn grid(&self) -> &Grid {
        &self.grid
    }

    pub(crate) fn subject(&self) -> Subject {
        self.subject
    }

    /// What scalars are classified by.
    pub(crate) fn table(&self) -> Option<&TransferTable> {
        match &self.content {
            Content::Splats { .. } => None,
            Content::Scalars(scalars) => Some(&scalars.table),
        }
    }

    /// The splats as the painter `tiles` reads them, for each of a view's looks: those of the picture before, where they
    /// serve, or made anew.
    pub(crate) fn packed(
        &self,
        view: &tiles::View<'_>,
        mut make: impl FnMut(usize) -> Result<Arc<Packed>>,
    ) -> Result<Vec<Arc<Packed>>> {
        let mut held = self.packed.lock().unwrap_or_else(PoisonError::into_inner);
        // Let go of the others before, so that there are not more than needed.
        held.retain(|packed| (0..view.looks()).any(|look| view.is_served_by(look, packed)));
        let mut packed: Vec<Arc<Packed>> = Vec::new();
        for look in 0..view.looks() {
            let mut found = packed.iter().chain(held.iter()).filter(|packed| view.serves(look, packed));
            let next = found.next().map(Arc::clone);
            packed.push(match next {
                Some(packed) => packed,
                None => make(look)?,
            });
        }
        held.clone_from(&packed);
        Ok(packed)
    }

    /// Whether the scene holds what pictures of these settings need.
    pub(crate) fn check(&self, settings: &Settings) -> Result<()> {
        let error = |name, what: &str| {
            let reason = format!("the scene was prepared {what}: prepare it with the settings it is rendered with");
            Err(Error::Setting { name, reason })
        };
        match &self.content {
            Content::Splats { .. } if settings.is_post_shaded() => error("shading", "for pre-shading"),
            Content::Splats { lit: false, .. } if settings.lighting.is_some() => error("light", "without light"),
            Content::Scalars(_) if !settings.is_post_shaded() => error("shading", "for post-shading"),
            Content::Scalars(scalars) if scalars.shows != shows(settings) => error("model", "for another model"),
            _ => Ok(()),
        }
    }

    /// The splats that a picture is made of, and the seconds it took to make those that the scene did not hold.
    pub(crate) fn drawable(&self, context: &Context, plan: &Plan, settings: &Settings) -> Result<(Drawable<'_>, f64)> {
        let scalars = match &self.content {
            Content::Splats { classified, .. } => return Ok((Drawable::Splats(classified), 0.0)),
            Content::Scalars(scalars) => scalars,
        };
        let asked = Asked {
            kernel: settings.kernel,
            normalization: settings.normalization,
            reach: plan.scalar_reach(),
            savings: settings.savings,
        };
        let lock = || scalars.emitted.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((of, emitted)) = lock().as_ref()
            && of.serves(&asked)
        {
            return Ok((Drawable::Scalars(Arc::clone(emitted)), 0.0));
        }
        // Not under the lock: who emits waits for a pool of threads, which may hand it work that asks for the lock.
        let (emitted, seconds) = on_host(|| {
            context.guarded("emitting scalars", || {
                let Scalars { volume, transfer, shows, .. } = scalars.as_ref();
                scalars::emit(context, volume, transfer, *shows, &asked)
            })
        });
        let emitted = Arc::new(emitted?);
        self.packed.lock().unwrap_or_else(PoisonError::into_inner).clear();
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
