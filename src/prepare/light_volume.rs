//! light-volume: the share of each light that arrives at each place of a field of scalars, for post-shading (Kniss et
//! al. 2003 compute a light volume for each view; this one once for a volume, a transfer function and a set of lights,
//! and for a light that moves only its own share). [`gpu::shadows`](crate::gpu::shadows) finds the light, on a field that
//! it makes of the samples that the device holds.
//!
//! The scalars of voxels, or of cells, are classified like splats of pre-shading, and the sums of `lighting/shadow.rs`
//! give the light that arrives at each visible one. Rays interpolate linearly between them.

use std::sync::Arc;

use super::scalars::Samples;
use super::shadows::{Shadows, outgrown, plans, unknown};
use crate::error::Result;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::light_volume::LightVolume;
use crate::gpu::scalar_field::ScalarField;
use crate::gpu::shadows::{BoxLight, run_on_box};
use crate::gpu::transfer::TransferTable;
use crate::progress::Progress;
use crate::volume::Grid;

/// The largest number of cells of a light volume, 8 bytes each: larger lattices use coarser cells.
pub(crate) const MAX_CELLS: u64 = 1 << 25;

/// The light at places that have scalars, and the matter that it falls on if this is kept for other lights.
pub(crate) struct FallenLight {
    pub(crate) volume: Arc<LightVolume>,
    kept: Option<BoxLight>,
}

impl FallenLight {
    /// Computes the light at the places of `grid` that have scalars, which `sample` takes to the device. Lights that are
    /// the same as in `held` keep theirs.
    pub(crate) fn new(
        (context, pipelines): (&Context, &Cache),
        held: Option<(Shadows, Arc<Self>)>,
        (grid, table): (&Grid, &TransferTable),
        sample: impl FnOnce() -> Result<Samples>,
        shadows: &Shadows,
        progress: &Progress,
    ) -> Result<Self> {
        let is_turned = held.is_some();
        let kept = held.filter(|(of, _)| of.without_lights() == shadows.without_lights());
        let kept = kept.and_then(|(of, held)| Some((of, Arc::into_inner(held)?.kept?)));
        let made;
        let (of, held, field, bounds) = match kept {
            Some((of, held)) => {
                let bounds = held.bounds;
                (Some(of), Some(held), None, bounds)
            }
            None => match sample()? {
                Samples::Held(drawable) => {
                    made = drawable;
                    let Some((scalars, _)) = &made.scalars else { return Err(outgrown(context)) };
                    let field = ScalarField { scalars, table, grid };
                    let bounds = field.bounds();
                    (None, None, Some(field), bounds)
                }
                Samples::Outgrown => return Err(outgrown(context)),
                Samples::Invisible => {
                    return Ok(Self { volume: Arc::new(LightVolume::full(context, grid)), kept: None });
                }
            },
        };
        let plans = plans(context, shadows, bounds)?;
        let lights: Vec<usize> = unknown(of.as_ref(), shadows).collect();
        let field = field.as_ref().map(|of| (of, shadows.lattice.dims, shadows.clip.as_slice()));
        let lights = (&plans, lights.as_slice());
        let made = run_on_box(context, pipelines, (grid, bounds), lights, (held, field), progress)?;
        let (volume, light) = made.ok_or_else(|| outgrown(context))?;
        // Lights that changed once may do so again.
        Ok(Self { volume: Arc::new(volume), kept: is_turned.then_some(light) })
    }
}
