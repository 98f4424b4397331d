//! shadows: from visible voxels to voxels with the shares of light that arrive at them, once for a volume, a transfer
//! function and a set of lights, by [`gpu::shadows`](crate::gpu::shadows) or, as exact sums, by `light_on_host`.

use std::sync::{Mutex, PoisonError};

use glam::DVec3;

use crate::camera::clip::{Side, is_inside};
use crate::error::Result;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::shadows::{self, Buffers, Unlit};
use crate::gpu::voxels::Voxels;
use crate::lighting::shadow::ShadowLattice;
use crate::lighting::shadow::plan::LightPlans;
use crate::lighting::{Casting, MAX_CASTING};
use crate::progress::Progress;

/// The shadows on a lattice of voxels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Shadows {
    pub(crate) casting: Casting,
    pub(crate) lattice: ShadowLattice,
    /// The sides of unclipped matter; clipped matter casts no shadows.
    pub(crate) clip: Vec<Side>,
}

impl Shadows {
    /// Returns whether light number `light` arrives alike at all voxels under both shadows; for [`MAX_CASTING`] the
    /// ambient light.
    pub(super) fn is_same(&self, other: &Self, light: usize) -> bool {
        let [own, others] = [self, other].map(|shadows| shadows.casting.only(light));
        own == others && self.lattice == other.lattice && self.clip == other.clip
    }

    /// Returns the shadows with no light but the ambient light.
    pub(super) fn without_lights(&self) -> Self {
        Self { casting: self.casting.only(MAX_CASTING), ..self.clone() }
    }

    /// Returns whether the voxel at a lattice point casts shadows.
    pub(super) fn casts(&self, point: [usize; 3]) -> bool {
        let from_middle = |axis: usize| point[axis] as f64 - (self.lattice.dims[axis] - 1) as f64 / 2.0;
        self.clip.is_empty() || is_inside(&self.clip, DVec3::from_array([0, 1, 2].map(from_middle)))
    }
}

/// The occluders on a lattice of voxels, kept for lights that move, with their shadows without lights.
#[derive(Default)]
pub(crate) struct Occluders(Mutex<Option<(Shadows, Buffers)>>);

impl Occluders {
    /// The largest number of bytes of buffers that are kept: a lattice of 512^3 voxels has 1.4 GB.
    const MOST: u64 = 3 << 29;

    /// Drops the occluders.
    pub(crate) fn clear(&self) {
        self.keep(None);
    }

    /// Takes the occluders if they were kept for the same shadows without lights.
    fn taken(&self, shadows: &Shadows) -> Option<Buffers> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        kept.filter(|(of, _)| *of == shadows.without_lights()).map(|(_, kept)| kept)
    }

    fn keep(&self, value: Option<(Shadows, Buffers)>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = value;
    }
}

/// Returns the lights, with the ambient light, whose shares voxels do not hold.
pub(super) fn unknown<'a>(held: Option<&'a Shadows>, shadows: &'a Shadows) -> impl Iterator<Item = usize> + 'a {
    (0..=MAX_CASTING).filter(move |&light| !held.is_some_and(|held| held.is_same(shadows, light)))
}

/// Returns lit voxels with the shares of light that arrive at each. Voxels that hold shares of other shadows keep the
/// shares of lights that are the same. With `over`, the memory of the shares may be used again. `None`: the host has to
/// find the light.
pub(crate) fn shaded(
    (context, pipelines): (&Context, &Cache),
    (voxels, over): (&Voxels, bool),
    held: Option<&Shadows>,
    occluders: &Occluders,
    shadows: &Shadows,
    progress: &Progress,
) -> Result<Option<Voxels>> {
    let Shadows { casting, lattice, clip } = shadows;
    let Some(plans) = LightPlans::new(casting, lattice, voxels.bounds()) else { return Ok(None) };
    let lights: Vec<usize> = unknown(held, shadows).collect();
    let unlit = Unlit { voxels, over, dims: lattice.dims, clip };
    let buffers = occluders.taken(shadows);
    let made = shadows::run(context, pipelines, &unlit, &plans, &lights, buffers, progress)?;
    Ok(made.map(|(voxels, buffers)| {
        // Lights that changed once may do so again.
        let is_kept = held.is_some() && buffers.bytes() <= Occluders::MOST;
        occluders.keep(is_kept.then(|| (shadows.without_lights(), buffers)));
        voxels
    }))
}
