//! shadows: from splats to splats with the shares of light that arrive at them. On the host, for any adapter: once for
//! a volume, a transfer function and a set of lights.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::clip::{Side, is_inside};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::{SHADED_WORDS, Splat};
use crate::gpu::splat::{LANES, kept, packed_kept};
use crate::gpu::store::{BrickSplats, HostBrick, MadeBrick, Row, Store, StoreBuilder, places};
use crate::lighting::Casting;
use crate::lighting::shadow::{Caster, Medium, ShadowBlock, ShadowLattice};
use crate::progress::Progress;
use crate::volume::BRICK_EDGE as EDGE;
use voxsplat_volume::memory::reserved;

/// Words of a lit splat without its place and without the shares of light.
const LIT: usize = size_of::<Splat>() / 4 - 1;

/// Planes of a brick whose sums are computed together, so that their input stays in caches.
pub(crate) const PLANES: usize = 4;

/// The shadows on a lattice of splats.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Shadows {
    pub(crate) casting: Casting,
    pub(crate) lattice: ShadowLattice,
    /// The sides of unclipped matter; clipped matter casts no shadows.
    pub(crate) clip: Vec<Side>,
}

impl Shadows {
    /// Whether the voxel at a lattice point casts shadows.
    pub(crate) fn casts(&self, point: [usize; 3]) -> bool {
        let from_middle = |axis: usize| point[axis] as f64 - (self.lattice.dims[axis] - 1) as f64 / 2.0;
        is_inside(&self.clip, DVec3::from_array([0, 1, 2].map(from_middle)))
    }
}

/// Returns lit splats with the shares of light that arrive at each.
pub(crate) fn shaded(
    context: &Context,
    stores: &[Store],
    shadows: &Shadows,
    progress: &Progress,
) -> Result<Vec<Store>> {
    let Shadows { casting, lattice, .. } = shadows;
    let held = stores.iter().map(|store| store.on_host(context)).collect::<Result<Vec<_>>>()?;
    let bricks = bricks_of(stores, &held);
    let medium = medium(&bricks, shadows, &|words| f32::from_bits(words[0] & 0xffff_ff00))?;
    let caster = Caster::new(casting, lattice);
    let done = AtomicUsize::new(0);
    let shade = |&(brick, held): &(&BrickSplats, &HostBrick)| -> Result<MadeBrick> {
        let count = u64::from(held.count());
        let mut shaded = reserved(count * (SHADED_WORDS - 1) as u64, || "splats of a brick".to_owned())?;
        let mut splats = held.words.chunks_exact(held.each);
        each_share(&caster, &medium, (brick, held), |_, shares| {
            shaded.extend(splats.next().iter().flat_map(|words| &words[..LIT]));
            shaded.extend(packed_kept(shares));
        });
        let number = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress.report("casting shadows", number as f64 / bricks.len() as f64);
        let bits: Vec<u32> = held.rows.iter().map(|row| row.bits).collect();
        Ok(MadeBrick::new(brick.origin, &bits, SHADED_WORDS - 1, shaded))
    };
    let shaded = bricks.par_iter().map(shade).collect::<Result<Vec<_>>>()?;
    let mut stores = StoreBuilder::new(context, 4 * SHADED_WORDS as u64, u32::MAX);
    shaded.into_iter().try_for_each(|brick| stores.push(brick))?;
    Ok(stores.finish()?.stores)
}

/// The shares of light that arrive at the voxels of a lattice.
pub(crate) struct Arriving {
    /// Bricks along each axis.
    bricks: [usize; 3],
    /// By brick, x fastest: the splats of a store, and the number of the brick in it; `None`: the brick has no splats.
    held: Vec<Option<(Arc<Vec<HostBrick>>, usize)>>,
}

impl Arriving {
    /// The shares at the splats of [`shaded`], on a lattice of `dims` points.
    pub(crate) fn new(context: &Context, shaded: &[Store], dims: [u32; 3]) -> Result<Self> {
        let bricks = dims.map(|n| (n as usize).div_ceil(EDGE));
        let mut held = vec![None; bricks.iter().product()];
        for store in shaded {
            let splats = store.on_host(context)?;
            for (number, brick) in store.bricks.iter().enumerate() {
                let [x, y, z] = brick.origin.map(|p| p as usize / EDGE);
                held[x + bricks[0] * (y + bricks[1] * z)] = Some((Arc::clone(&splats), number));
            }
        }
        Ok(Self { bricks, held })
    }

    /// The shares at [`LANES`] voxels of a row; all light arrives at voxels without a splat.
    pub(crate) fn at(&self, [first, y, z]: [usize; 3]) -> [[f32; LANES]; 4] {
        let (mut low, mut high) = ([u32::MAX; LANES], [u32::MAX; LANES]);
        let row = self.bricks[0] * (y / EDGE + self.bricks[1] * (z / EDGE));
        for number in first / EDGE..((first + LANES - 1) / EDGE + 1).min(self.bricks[0]) {
            let Some((splats, brick)) = &self.held[row + number] else { continue };
            let brick = &splats[*brick];
            let row = brick.rows[y % EDGE + EDGE * (z % EDGE)];
            for (x, words) in places(row.bits).zip(brick.words[row.first as usize * brick.each..].chunks(brick.each)) {
                if let Some(at) = (number * EDGE + x).checked_sub(first).filter(|&at| at < LANES) {
                    (low[at], high[at]) = (words[LIT], words[LIT + 1]);
                }
            }
        }
        kept(&low, &high)
    }
}

/// The bricks of stores with their splats on the host.
pub(crate) fn bricks_of<'a>(
    stores: &'a [Store],
    held: &'a [Arc<Vec<HostBrick>>],
) -> Vec<(&'a BrickSplats, &'a HostBrick)> {
    stores.iter().zip(held).flat_map(|(store, held)| store.bricks.iter().zip(held.iter())).collect()
}

/// The densities of the splats that cast shadows. `density` gets the words of a splat without the place.
pub(crate) fn medium(
    bricks: &[(&BrickSplats, &HostBrick)],
    shadows: &Shadows,
    density: &(dyn Fn(&[u32]) -> f32 + Sync),
) -> Result<Medium<f32>> {
    let mut medium = Medium::new(shadows.lattice.dims)?;
    let dense = |(brick, held): &(&BrickSplats, &HostBrick)| {
        let [x, y, z] = brick.origin.map(|p| p as usize);
        let rows = held.rows.iter().enumerate();
        let points = rows.flat_map(|(row, &Row { bits, .. })| {
            places(bits).map(move |place| [x + place, y + row % EDGE, z + row / EDGE])
        });
        let splats = points.zip(held.words.chunks_exact(held.each)).map(|(point, words)| (point, density(words)));
        splats.filter(|(point, density)| *density > 0.0 && shadows.casts(*point)).collect::<Vec<_>>()
    };
    // Some bricks at a time: their densities are in memory twice for a moment.
    for bricks in bricks.chunks(256) {
        let found: Vec<_> = bricks.par_iter().map(dense).collect();
        found.into_iter().flatten().for_each(|(point, density)| medium.set(point, density));
    }
    Ok(medium)
}

/// Calls `visit` for each splat of a brick, in order, with its lattice point and the shares of light that arrive there.
pub(crate) fn each_share(
    caster: &Caster<f32>,
    medium: &Medium<f32>,
    (brick, held): (&BrickSplats, &HostBrick),
    mut visit: impl FnMut([usize; 3], [f64; 4]),
) {
    let bits: Vec<u32> = held.rows.iter().map(|row| row.bits).collect();
    let [x, y, z] = brick.origin.map(|p| p as usize);
    for (number, wanted) in bits.chunks_exact(EDGE * PLANES).enumerate() {
        if wanted.iter().all(|&bits| bits == 0) {
            continue;
        }
        let block = ShadowBlock { start: [x, y, z + PLANES * number], down: EDGE, wanted };
        for (row, shares) in caster.shares::<EDGE>(medium, &block).iter().enumerate() {
            let (y, z) = (y + row % EDGE, block.start[2] + row / EDGE);
            places(wanted[row]).for_each(|at| visit([x + at, y, z], shares.map(|share| share[at])));
        }
    }
}
