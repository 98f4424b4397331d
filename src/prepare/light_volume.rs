//! light-volume: the share of each light that arrives at each place of a field of scalars, for post-shading (Kniss et
//! al. 2003 compute a light volume for each view; this one once for a volume, a transfer function and a set of lights,
//! and for a light that moves only its own share).
//! GPUs find the light by [`gpu::shadows`](crate::gpu::shadows), on fields that they make of the samples that they
//! hold, or that the host makes of lists.
//!
//! The scalars of voxels, or of cells, are classified like splats of pre-shading, and the sums of `lighting/shadow.rs`
//! give the light that arrives at each visible one. Rays interpolate linearly between them.

use std::sync::Arc;

use glam::DVec3;
use half::f16;
use rayon::prelude::*;
use voxsplat_volume::memory::reserved;

use super::shadows::{Places, Shadows, on_device, unknown};
use crate::error::{Error, Result};
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::light_volume::LightVolume;
use crate::gpu::scalar_field::ScalarField;
use crate::gpu::shadows::{BoxLight, Field, run_on_box};
use crate::gpu::splat;
use crate::gpu::store::Drawable;
use crate::gpu::transfer::TransferTable;
use crate::lighting::MAX_CASTING;
use crate::lighting::shadow::Arrival;
use crate::lighting::shadow::plan::LightPlans;
use crate::progress::Progress;
use crate::transfer::TransferFunction;
use crate::transfer::scalars::Reduction;
use crate::volume::Grid;

/// The largest number of cells of a light volume, 8 bytes each: larger lattices use coarser cells.
pub(crate) const MAX_CELLS: u64 = 1 << 25;

/// The classification of scalars.
pub(crate) struct Classification<'a> {
    pub(crate) transfer: &'a TransferFunction,
    pub(crate) reduction: &'a Reduction,
    /// The same for shaders.
    pub(crate) table: &'a TransferTable,
}

impl Classification<'_> {
    /// The density of a splat of a scalar, given its words without the place: extinction times the unit distance.
    pub(super) fn density(&self, words: &[u32], grid: &Grid) -> f32 {
        let value = self.reduction.value(f32::from_bits(words[0]));
        let (_, opacity) = self.transfer.sample(value);
        let density = TransferFunction::extinction(opacity, 1.0);
        let share = match words {
            &[_, low, high] if density > 0.0 && !self.transfer.gradient_opacity().is_empty() => {
                let gradient = DVec3::from_array(splat::gradient([low, high]).map(f64::from));
                let world = grid.to_lattice().matrix3.transpose() * gradient;
                self.transfer.gradient_share(world.length() / self.reduction.factor())
            }
            _ => 1.0,
        };
        (density * share) as f32
    }
}

/// The light at places that have splats of scalars, and the matter that it falls on if this is kept for other lights.
pub(crate) struct FallenLight {
    pub(crate) volume: Arc<LightVolume>,
    kept: Option<Kept>,
}

/// What other lights on the same matter need.
enum Kept {
    Host(Box<HostLight>),
    Device(BoxLight),
}

/// The matter that light falls on.
enum Source<'a> {
    /// The device holds it.
    Held,
    Splats(&'a Places<'a>),
    Scalars(ScalarField<'a>),
}

/// The splats, what they occlude, and the light at their places.
struct HostLight {
    emitted: Drawable,
    arrival: Arrival,
    texels: Vec<[u16; 4]>,
}

impl FallenLight {
    /// Computes the light at the places of `grid` that have scalars, which `emit` makes: as splats, or as samples if
    /// they may be. Lights that are the same as in `held` keep theirs.
    pub(crate) fn new(
        (context, pipelines): (&Context, &Cache),
        held: Option<(Shadows, Arc<Self>)>,
        grid: &Grid,
        emit: impl Fn(bool) -> Result<Drawable>,
        classification: &Classification<'_>,
        shadows: &Shadows,
        progress: &Progress,
    ) -> Result<Self> {
        let is_turned = held.is_some();
        let kept = held.filter(|(of, _)| of.without_lights() == shadows.without_lights());
        let kept = kept.and_then(|(of, held)| Some((of, Arc::into_inner(held)?.kept?)));
        let on_device = |bounds: [[usize; 3]; 2],
                         (of, held): (Option<&Shadows>, Option<BoxLight>),
                         source: &Source<'_>| {
            let made = on_device(context, || {
                let Some(plans) = LightPlans::new(&shadows.casting, &shadows.lattice, bounds) else { return Ok(None) };
                let lights: Vec<usize> = unknown(of, shadows).collect();
                let lights = (&plans, lights.as_slice());
                let density = |words: &[u32]| classification.density(words, grid);
                let values = || match source {
                    Source::Splats(places) => places.field(shadows, &plans, &density),
                    Source::Held | Source::Scalars(_) => Ok(Vec::new()),
                };
                let field = match source {
                    Source::Scalars(of) => Field::Scalars { of, dims: shadows.lattice.dims, clip: &shadows.clip },
                    Source::Held | Source::Splats(_) => Field::Host(&values),
                };
                run_on_box(context, pipelines, (grid, bounds), lights, (held, field), progress)
            })?;
            Ok::<_, Error>(made.map(|(volume, light)| {
                // Lights that changed once may do so again.
                Self { volume: Arc::new(volume), kept: is_turned.then_some(Kept::Device(light)) }
            }))
        };
        let (of, emitted, arrival, mut texels) = match kept {
            Some((of, Kept::Host(held))) => {
                let HostLight { emitted, arrival, texels } = *held;
                (Some(of), emitted, Some(arrival), texels)
            }
            Some((of, Kept::Device(light))) => {
                if let Some(made) = on_device(light.bounds, (Some(&of), Some(light)), &Source::Held)? {
                    return Ok(made);
                }
                (None, emit(false)?, None, Vec::new())
            }
            None => {
                let mut emitted = emit(!context.is_software())?;
                if let Some((scalars, _)) = &emitted.scalars {
                    let field = ScalarField { scalars, table: classification.table, grid };
                    if let Some(made) = on_device(field.bounds(), (None, None), &Source::Scalars(field))? {
                        return Ok(made);
                    }
                    emitted = emit(false)?;
                }
                (None, emitted, None, Vec::new())
            }
        };
        let places = Places::new(context, &emitted.stores)?;
        let [low, size] = places.bounds;
        let density = |words: &[u32]| classification.density(words, grid);
        if arrival.is_none()
            && let Some(made) = on_device(places.bounds, (None, None), &Source::Splats(&places))?
        {
            return Ok(made);
        }
        let arrival = match arrival {
            Some(arrival) => arrival.under(&shadows.casting),
            None => {
                let count = size.iter().map(|&n| n as u64).product();
                texels = reserved(count, || "the light in the volume".to_owned())?;
                texels.resize(count as usize, [f16::ONE.to_bits(); 4]);
                let arrival = places.arrival(shadows, &density)?;
                // Lights that changed once may do so again.
                if is_turned { arrival.keeping() } else { arrival }
            }
        };
        for light in unknown(of.as_ref(), shadows) {
            let done = |part: f64| (light as f64 + part) / (MAX_CASTING + 1) as f64;
            let arriving = arrival.shares(light, &|part| progress.report("casting shadows", done(part)))?;
            texels.par_chunks_mut(size[0]).enumerate().for_each(|(row, texels)| {
                let [y, z] = [low[1] + row % size[1], low[2] + row / size[1]];
                let share = arriving.as_ref().map(|arriving| arriving.from([low[0], y, z]));
                for (x, ..) in places.row(low[0]..low[0] + size[0], [y, z]) {
                    let share = share.as_ref().map_or(u16::MAX, |share| share(x - low[0]));
                    texels[x - low[0]][light] = f16::from_f32(f32::from(share) / 65_535.0).to_bits();
                }
            });
        }
        let [low, size] = [low, size].map(|point| point.map(|n| n as u32));
        let volume = Arc::new(LightVolume::new(context, grid, low, size, &texels));
        let kept = arrival.is_kept().then(|| Kept::Host(Box::new(HostLight { emitted, arrival, texels })));
        Ok(Self { volume, kept })
    }
}
