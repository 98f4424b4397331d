//! shadows: from splats to splats with the shares of light that arrive at them. On the host, for any adapter: once for
//! a volume, a transfer function and a set of lights.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::clip::{Side, is_inside};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::{SHADED_WORDS, Splat};
use crate::gpu::splat::{LANES, kept};
use crate::gpu::store::{BrickSplats, HostBrick, MadeBrick, Row, Store, StoreBuilder, places};
use crate::lighting::shadow::field::CLIPPED;
use crate::lighting::shadow::{Arrival, ShadowLattice};
use crate::lighting::{Casting, MAX_CASTING};
use crate::progress::Progress;
use crate::volume::BRICK_EDGE as EDGE;
use voxsplat_volume::memory::reserved;

/// Words of a lit splat without its place and without the shares of light.
const LIT: usize = size_of::<Splat>() / 4 - 1;

/// The shadows on a lattice of splats.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Shadows {
    pub(crate) casting: Casting,
    pub(crate) lattice: ShadowLattice,
    /// The sides of unclipped matter; clipped matter casts no shadows.
    pub(crate) clip: Vec<Side>,
}

impl Shadows {
    /// Whether the light of the same number arrives at all voxels alike; for [`MAX_CASTING`] ambient light.
    fn is_same(&self, other: &Self, light: usize) -> bool {
        let [own, others] = [self, other].map(|shadows| shadows.casting.only(light));
        own == others && self.lattice == other.lattice && self.clip == other.clip
    }

    /// Whether the voxel at a lattice point casts shadows.
    fn casts(&self, point: [usize; 3]) -> bool {
        if self.clip.is_empty() {
            return true;
        }
        let from_middle = |axis: usize| point[axis] as f64 - (self.lattice.dims[axis] - 1) as f64 / 2.0;
        is_inside(&self.clip, DVec3::from_array([0, 1, 2].map(from_middle)))
    }
}

/// Returns lit splats with the shares of light that arrive at each. Splats that hold shares of other shadows keep those
/// of lights that are the same.
pub(crate) fn shaded(
    context: &Context,
    stores: &[Store],
    held: Option<&Shadows>,
    shadows: &Shadows,
    progress: &Progress,
) -> Result<Vec<Store>> {
    let places = Places::new(context, stores)?;
    let arrival = places.arrival(shadows, &|words| f32::from_bits(words[0] & 0xffff_ff00))?;
    let bricks = places.bricks();
    let copied = |(_, held): &(&BrickSplats, &HostBrick)| -> Result<Vec<u32>> {
        let words = u64::from(held.count()) * (SHADED_WORDS - 1) as u64;
        let mut shaded = reserved(words, || "splats of a brick".to_owned())?;
        for words in held.words.chunks_exact(held.each) {
            shaded.extend_from_slice(&words[..LIT]);
            shaded.extend(words.get(LIT..LIT + 2).unwrap_or(&[u32::MAX; 2]));
        }
        Ok(shaded)
    };
    let mut shaded = bricks.par_iter().map(copied).collect::<Result<Vec<_>>>()?;
    let is_held = |light| held.is_some_and(|held| held.is_same(shadows, light));
    for light in (0..=MAX_CASTING).filter(|&light| !is_held(light)) {
        let report = |part: f64| progress.report("casting shadows", (light as f64 + part) / (MAX_CASTING + 1) as f64);
        let shares = arrival.shares(light, &report)?;
        let (word, shift) = (LIT + light / 2, light % 2 * 16);
        bricks.par_iter().zip(&mut shaded).for_each(|(&brick, shaded)| {
            for (point, words) in points(brick).zip(shaded.chunks_exact_mut(SHADED_WORDS - 1)) {
                let share = shares.as_ref().map_or(u16::MAX, |shares| shares[arrival.index(point)]);
                words[word] = words[word] & !(0xffff << shift) | u32::from(share) << shift;
            }
        });
    }
    let mut stores = StoreBuilder::new(context, 4 * SHADED_WORDS as u64, u32::MAX);
    for ((brick, held), words) in bricks.into_iter().zip(shaded) {
        let bits: Vec<u32> = held.rows.iter().map(|row| row.bits).collect();
        stores.push(MadeBrick::new(brick.origin, &bits, SHADED_WORDS - 1, words))?;
    }
    Ok(stores.finish()?.stores)
}

/// The splats of a lattice on the host, by place.
pub(crate) struct Places<'a> {
    stores: &'a [Store],
    held: Vec<Arc<Vec<HostBrick>>>,
    /// Bricks along each axis.
    counts: [usize; 3],
    /// By brick, x fastest: its store, and its number in the store; `None`: the brick has no splats.
    numbers: Vec<Option<[usize; 2]>>,
    /// The first lattice point of the box around the splats, and its size; one voxel if there are no splats.
    pub(crate) bounds: [[usize; 3]; 2],
}

impl<'a> Places<'a> {
    pub(crate) fn new(context: &Context, stores: &'a [Store]) -> Result<Self> {
        let held = stores.iter().map(|store| store.on_host(context)).collect::<Result<Vec<_>>>()?;
        let bricks = || stores.iter().flat_map(|store| &store.bricks);
        let bounds =
            bricks().map(|brick| brick.bounds).filter(|[low, high]| low != high).reduce(|[low, high], bounds| {
                [[0, 1, 2].map(|a| low[a].min(bounds[0][a])), [0, 1, 2].map(|a| high[a].max(bounds[1][a]))]
            });
        let [low, high] = bounds.unwrap_or([[0; 3], [1; 3]]).map(|point| point.map(|n| n as usize));
        let counts = high.map(|n| n.div_ceil(EDGE));
        let mut numbers = vec![None; counts.iter().product()];
        for (store, of) in stores.iter().enumerate() {
            for (number, brick) in of.bricks.iter().enumerate() {
                let [x, y, z] = brick.origin.map(|p| p as usize / EDGE);
                if brick.bounds[0] != brick.bounds[1] {
                    numbers[x + counts[0] * (y + counts[1] * z)] = Some([store, number]);
                }
            }
        }
        Ok(Self { stores, held, counts, numbers, bounds: [low, [0, 1, 2].map(|a| high[a] - low[a])] })
    }

    /// The bricks of the stores in order.
    pub(crate) fn bricks(&self) -> Vec<(&BrickSplats, &HostBrick)> {
        self.stores.iter().zip(&self.held).flat_map(|(store, held)| store.bricks.iter().zip(held.iter())).collect()
    }

    /// The splats of a row of the lattice that lie in some columns: their x and their words without the place.
    pub(crate) fn row(&self, columns: Range<usize>, [y, z]: [usize; 2]) -> impl Iterator<Item = (usize, &[u32])> {
        let row = self.counts[0] * (y / EDGE + self.counts[1] * (z / EDGE));
        let is_within = y / EDGE < self.counts[1] && z / EDGE < self.counts[2];
        let bricks = columns.start / EDGE..columns.end.div_ceil(EDGE).min(self.counts[0]);
        bricks
            .filter(move |_| is_within)
            .flat_map(move |number| {
                let brick = self.numbers[row + number].map(|[store, brick]| &self.held[store][brick]);
                let words = brick.into_iter().flat_map(move |brick| {
                    let row = brick.rows[y % EDGE + EDGE * (z % EDGE)];
                    places(row.bits).zip(brick.words[row.first as usize * brick.each..].chunks_exact(brick.each))
                });
                words.map(move |(x, words)| (number * EDGE + x, words))
            })
            .filter(move |(x, _)| columns.contains(x))
    }

    /// The light that arrives at the splats. `density` gets the words of a splat without the place.
    pub(crate) fn arrival<'b>(
        &self,
        shadows: &'b Shadows,
        density: &(dyn Fn(&[u32]) -> f32 + Sync),
    ) -> Result<Arrival<'b>> {
        let [low, size] = self.bounds;
        Arrival::new(&shadows.casting, &shadows.lattice, self.bounds, |[y, z], row| {
            for (x, words) in self.row(low[0]..low[0] + size[0], [y, z]) {
                let casts = shadows.casts([x, y, z]);
                row[x - low[0]] = if casts { density(words).max(CLIPPED) } else { CLIPPED };
            }
        })
    }
}

/// The lattice points of the splats of a brick in order.
pub(crate) fn points((brick, held): (&BrickSplats, &HostBrick)) -> impl Iterator<Item = [usize; 3]> {
    let [x, y, z] = brick.origin.map(|p| p as usize);
    held.rows.iter().enumerate().flat_map(move |(row, &Row { bits, .. })| {
        places(bits).map(move |place| [x + place, y + row % EDGE, z + row / EDGE])
    })
}

/// The shares of light that arrive at [`LANES`] voxels of a row, given the splats of [`shaded`]; all light arrives at
/// voxels without a splat.
pub(crate) fn shares_at(shaded: &Places<'_>, [first, y, z]: [usize; 3]) -> [[f32; LANES]; 4] {
    let (mut low, mut high) = ([u32::MAX; LANES], [u32::MAX; LANES]);
    for (x, words) in shaded.row(first..first + LANES, [y, z]) {
        (low[x - first], high[x - first]) = (words[LIT], words[LIT + 1]);
    }
    kept(&low, &high)
}
