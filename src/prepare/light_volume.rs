//! light-volume: the share of each light that arrives at each place of a field of scalars, for post-shading (Kniss et
//! al. 2003 compute a light volume for each view; this one once for a volume, a transfer function and a set of lights).
//! On the host, for any adapter.
//!
//! The scalars of voxels, or of cells, are classified like splats of pre-shading, and the sums of `lighting/shadow.rs`
//! give the light that arrives at each visible one. Rays interpolate linearly between them.

use glam::DVec3;
use half::f16;
use rayon::prelude::*;
use voxsplat_volume::memory::reserved;

use super::shadows::{Shadows, bricks_of, each_share, medium};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::light_volume::LightVolume;
use crate::gpu::splat;
use crate::gpu::store::{BrickSplats, Drawable, HostBrick};
use crate::gpu::transfer::Reduction;
use crate::lighting::shadow::Caster;
use crate::progress::Progress;
use crate::transfer::TransferFunction;
use crate::volume::Grid;

/// The largest number of cells of a light volume, 8 bytes each: larger lattices use coarser cells.
pub(crate) const MAX_CELLS: u64 = 1 << 25;

/// The classification of scalars.
pub(crate) struct Classification<'a> {
    pub(crate) transfer: &'a TransferFunction,
    pub(crate) reduction: &'a Reduction,
}

impl Classification<'_> {
    /// The density of a splat of a scalar, given its words without the place: extinction times the unit distance.
    fn density(&self, words: &[u32], grid: &Grid) -> f32 {
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

/// Computes the light at the places of `grid` that have splats of scalars.
pub(crate) fn light_volume(
    context: &Context,
    emitted: &Drawable,
    grid: &Grid,
    classification: &Classification<'_>,
    shadows: &Shadows,
    progress: &Progress,
) -> Result<LightVolume> {
    let Shadows { casting, lattice, .. } = shadows;
    let held = emitted.stores.iter().map(|store| store.on_host(context)).collect::<Result<Vec<_>>>()?;
    let bricks = bricks_of(&emitted.stores, &held);
    let medium = medium(&bricks, shadows, &|words| classification.density(words, grid))?;
    let bounds = bricks.iter().filter(|(_, held)| held.count() > 0).map(|(brick, _)| brick.bounds);
    let [low, high] = bounds.fold([[u32::MAX; 3], [0; 3]], |[low, high], bounds| {
        [[0, 1, 2].map(|a| low[a].min(bounds[0][a])), [0, 1, 2].map(|a| high[a].max(bounds[1][a]))]
    });
    // Without splats there is one texel.
    let low = [0, 1, 2].map(|axis| if low[axis] < high[axis] { low[axis] } else { 0 });
    let size = [0, 1, 2].map(|axis| high[axis].saturating_sub(low[axis]).max(1));
    let count = size.iter().map(|&n| u64::from(n)).product();
    let mut texels = reserved(count, || "the light in the volume".to_owned())?;
    texels.resize(count as usize, [f16::ONE.to_bits(); 4]);
    let caster = Caster::new(casting, lattice);
    for (number, some) in bricks.chunks(64).enumerate() {
        let shares = |&(brick, held): &(&BrickSplats, &HostBrick)| {
            let mut found = Vec::with_capacity(held.count() as usize);
            each_share(&caster, &medium, (brick, held), |point, shares| {
                found.push((point, shares.map(|share| f16::from_f64(share).to_bits())));
            });
            found
        };
        let shares: Vec<_> = some.par_iter().map(shares).collect();
        for ([x, y, z], share) in shares.into_iter().flatten() {
            let [x, y, z] = [x - low[0] as usize, y - low[1] as usize, z - low[2] as usize];
            texels[x + size[0] as usize * (y + size[1] as usize * z)] = share;
        }
        progress.report("casting shadows", (64 * (number + 1)).min(bricks.len()) as f64 / bricks.len() as f64);
    }
    Ok(LightVolume::new(context, grid, low, size, &texels))
}
