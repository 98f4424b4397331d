//! light-volume: the share of each light that arrives at each place of a field of scalars, for post-shading (Kniss et
//! al. 2003 compute a light volume for each view; this one once for a volume, a transfer function and a set of lights,
//! and for a light that moves only its own share). [`gpu::shadows`](crate::gpu::shadows) finds the light, on a field
//! that it makes of the samples that the device holds, or `light_on_host` at listed scalars.
//!
//! The scalars of voxels, or of cells, are classified like splats of pre-shading, and the sums of `lighting/shadow.rs`
//! give the light that arrives at each visible one. Rays interpolate linearly between them.

use std::sync::Arc;

use glam::DVec3;
use half::f16;

use super::light_on_host::ListedSplats;
use super::scalars::Samples;
use super::shadows::{Shadows, unknown};
use crate::error::Result;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::drawable::Drawable;
use crate::gpu::layout::unpacked_gradient;
use crate::gpu::light_volume::LightVolume;
use crate::gpu::scalar_field::ScalarField;
use crate::gpu::shadows::{BoxLight, run_on_box};
use crate::gpu::transfer::TransferTable;
use crate::lighting::MAX_CASTING;
use crate::lighting::shadow::plan::LightPlans;
use crate::progress::Progress;
use crate::transfer::isosurface::casting;
use crate::transfer::scalars::Reduction;
use crate::transfer::{ControlPoint, TransferFunction};
use crate::volume::Grid;
use voxsplat_volume::memory::reserved;

/// The largest number of cells of a light volume, 8 bytes each: larger lattices use coarser cells.
pub(crate) const MAX_CELLS: u64 = 1 << 25;

/// The scalars of a lattice, with the transfer function of their extinctions.
pub(crate) struct LitScalars<'a> {
    pub(crate) grid: &'a Grid,
    pub(crate) transfer: &'a TransferFunction,
    pub(crate) reduction: &'a Reduction,
    /// The transfer function for shaders.
    pub(crate) table: &'a TransferTable,
    /// The length of the unit of extinctions, in world units.
    pub(crate) unit: f64,
    pub(crate) surfaces: Vec<ControlPoint>,
}

impl LitScalars<'_> {
    /// Returns the density of a splat of a scalar, given its words without the place: extinction times the unit
    /// distance.
    pub(super) fn density(&self, words: &[u32]) -> f32 {
        let Self { grid, transfer, reduction, unit, surfaces, .. } = self;
        let value = reduction.value(f32::from_bits(words[0]));
        let density = TransferFunction::extinction(transfer.sample(value).1, 1.0);
        let &[_, low, high] = words else { return density as f32 };
        let gradient = DVec3::from_array(unpacked_gradient([low, high]).map(f64::from));
        let world = grid.to_lattice().matrix3.transpose() * gradient;
        let lengths = [gradient, world].map(|gradient| gradient.length() / reduction.factor());
        (density * transfer.gradient_share(lengths[1]) + casting(surfaces, value, lengths) * unit) as f32
    }
}

/// The light at places that have scalars, and the matter that it falls on if this is kept for other lights.
pub(crate) struct FallenLight {
    pub(crate) volume: Arc<LightVolume>,
    kept: Option<BoxLight>,
}

impl FallenLight {
    /// Finds the light at the places that have scalars: `sample` brings them to the device, `list` lists them. Lights
    /// that are the same as in `held` keep their shares.
    pub(crate) fn new(
        (context, pipelines): (&Context, &Cache),
        held: Option<(Shadows, Arc<Self>)>,
        scalars: &LitScalars<'_>,
        (sample, list): (impl FnOnce() -> Result<Samples>, impl FnOnce() -> Result<Drawable>),
        shadows: &Shadows,
        progress: &Progress,
    ) -> Result<Self> {
        let &LitScalars { grid, table, unit, .. } = scalars;
        let is_turned = held.is_some();
        let kept = held.filter(|(of, _)| of.without_lights() == shadows.without_lights());
        let kept = kept.and_then(|(of, held)| Some((of, Arc::into_inner(held)?.kept?)));
        let on_host = || Self::on_host((context, pipelines), scalars, &list()?, shadows, progress);
        let made;
        let (of, held, field, bounds) = match kept {
            Some((of, held)) => {
                let bounds = held.bounds;
                (Some(of), Some(held), None, bounds)
            }
            // All kernels on each ray are summed, which only the host does.
            None if shadows.casting.is_exact() => return on_host(),
            None => match sample()? {
                Samples::Held(drawable) => {
                    made = drawable;
                    let Some((scalars, _)) = &made.scalars else { return on_host() };
                    let field = ScalarField { scalars, table, grid, unit };
                    let bounds = field.bounds();
                    (None, None, Some(field), bounds)
                }
                Samples::Outgrown | Samples::Invisible => return on_host(),
            },
        };
        let Some(plans) = LightPlans::new(&shadows.casting, &shadows.lattice, bounds) else { return on_host() };
        let lights: Vec<usize> = unknown(of.as_ref(), shadows).collect();
        let field = field.as_ref().map(|of| (of, shadows.lattice.dims, shadows.clip.as_slice()));
        let lights = (&plans, lights.as_slice());
        let Some((volume, light)) = run_on_box(context, pipelines, (grid, bounds), lights, (held, field), progress)?
        else {
            return on_host();
        };
        // Lights that changed once may do so again.
        Ok(Self { volume: Arc::new(volume), kept: is_turned.then_some(light) })
    }

    /// Finds the light at listed scalars on the host.
    fn on_host(
        (context, pipelines): (&Context, &Cache),
        scalars: &LitScalars<'_>,
        listed: &Drawable,
        shadows: &Shadows,
        progress: &Progress,
    ) -> Result<Self> {
        let stores = listed.lists(context, pipelines)?;
        let listed = ListedSplats::read(context, &stores)?;
        let light = listed.light(shadows, |words| scalars.density(words), progress)?;
        let [low, size] = listed.bounds;
        let count = size.iter().map(|&n| n as u64).product();
        let mut texels = reserved(count, || "the light in the volume".to_owned())?;
        texels.resize(count as usize, [f16::ONE.to_bits(); MAX_CASTING + 1]);
        for (shares, splats) in light.iter().zip(listed.splats()) {
            for (shares, (point, _)) in shares.iter().zip(splats) {
                let [x, y, z] = [0, 1, 2].map(|axis| point[axis] - low[axis]);
                let of_one = |share: u16| f16::from_f32(f32::from(share) / 65_535.0).to_bits();
                texels[x + size[0] * (y + size[1] * z)] = shares.map(of_one);
            }
        }
        let [low, size] = [low, size].map(|point| point.map(|n| n as u32));
        Ok(Self { volume: Arc::new(LightVolume::new(context, scalars.grid, low, size, &texels)), kept: None })
    }
}
