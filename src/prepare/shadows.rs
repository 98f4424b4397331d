//! shadows: from splats to splats with the shares of light that arrive at them, once for a volume, a transfer function
//! and a set of lights. On GPUs by [`gpu::shadows`](crate::gpu::shadows); on the host on software adapters, for exact
//! sums, and for boxes that outgrow the device.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::clip::{Side, is_inside};
use crate::error::{Error, Result};
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::sampled::Sampled;
use crate::gpu::shadows::{self, Buffers, STRIDE, Unlit, UnlitSamples};
use crate::gpu::store::{Drawable, Store, StoreBuilder};
use crate::lighting::shadow::field::CLIPPED;
use crate::lighting::shadow::plan::LightPlans;
use crate::lighting::shadow::{Arrival, ShadowLattice};
use crate::lighting::{Casting, MAX_CASTING};
use crate::progress::Progress;
use crate::splats::brick::{BrickSplats, HostBrick, MadeBrick, Row, places};
use crate::volume::BRICK_EDGE as EDGE;
use voxsplat_volume::memory::zeroed;

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
    pub(super) fn is_same(&self, other: &Self, light: usize) -> bool {
        let [own, others] = [self, other].map(|shadows| shadows.casting.only(light));
        own == others && self.lattice == other.lattice && self.clip == other.clip
    }

    /// The same without lights.
    pub(super) fn without_lights(&self) -> Self {
        Self { casting: self.casting.only(MAX_CASTING), ..self.clone() }
    }

    /// Whether the voxel at a lattice point casts shadows.
    pub(super) fn casts(&self, point: [usize; 3]) -> bool {
        if self.clip.is_empty() {
            return true;
        }
        let from_middle = |axis: usize| point[axis] as f64 - (self.lattice.dims[axis] - 1) as f64 / 2.0;
        is_inside(&self.clip, DVec3::from_array([0, 1, 2].map(from_middle)))
    }
}

/// The occluders on a lattice of splats, kept for lights that move, and the shadows that they are for.
#[derive(Default)]
pub(crate) struct Occluders {
    host: Mutex<Option<(Shadows, Arrival)>>,
    device: Mutex<Option<(Shadows, Buffers)>>,
}

/// Takes what is kept for the same shadows without lights.
fn taken<T>(kept: &Mutex<Option<(Shadows, T)>>, shadows: &Shadows) -> Option<T> {
    let kept = kept.lock().unwrap_or_else(PoisonError::into_inner).take();
    kept.filter(|(of, _)| *of == shadows.without_lights()).map(|(_, kept)| kept)
}

fn keep<T>(kept: &Mutex<Option<(Shadows, T)>>, value: Option<(Shadows, T)>) {
    *kept.lock().unwrap_or_else(PoisonError::into_inner) = value;
}

impl Occluders {
    /// The most bytes of buffers of the device that are kept: a lattice of 512^3 voxels has 1.4 GB.
    const MOST: u64 = 3 << 29;

    /// Forgets them.
    pub(crate) fn clear(&self) {
        keep(&self.host, None);
        keep(&self.device, None);
    }

    /// The arrival of the light of these shadows, if they are the same without lights.
    fn taken(&self, shadows: &Shadows) -> Option<Arrival> {
        taken(&self.host, shadows).map(|arrival| arrival.under(&shadows.casting))
    }

    fn keep(&self, shadows: &Shadows, arrival: Arrival) {
        keep(&self.host, arrival.is_kept().then(|| (shadows.without_lights(), arrival)));
    }
}

/// Returns lit splats with the shares of light that arrive at each. Splats that hold shares of other shadows keep those
/// of lights that are the same.
pub(crate) fn shaded(
    context: &Context,
    pipelines: &Cache,
    mut classified: Arc<Drawable>,
    held: Option<&Shadows>,
    occluders: &Occluders,
    shadows: &Shadows,
    progress: &Progress,
) -> Result<Vec<Store>> {
    let over = Arc::get_mut(&mut classified).is_some();
    let stores = (classified.stores.as_slice(), over);
    let find = || shaded_on_device((context, pipelines), stores, held, occluders, shadows, progress);
    if let Some(stores) = on_device(context, find)? {
        keep(&occluders.host, None);
        return Ok(stores);
    }
    shaded_on_host(context, &classified.stores, held, occluders, shadows, progress)
}

/// Finds light by stages of a GPU; `None` if the device is the host, has too little memory, or the host has to find it.
pub(super) fn on_device<T>(context: &Context, find: impl FnOnce() -> Result<Option<T>>) -> Result<Option<T>> {
    if context.is_software() {
        return Ok(None);
    }
    match context.guarded("casting shadows", find) {
        Err(Error::OutOfMemory(_)) => Ok(None),
        found => found,
    }
}

/// The lights, with the ambient light, whose shares splats do not hold.
pub(super) fn unknown<'a>(held: Option<&'a Shadows>, shadows: &'a Shadows) -> impl Iterator<Item = usize> + 'a {
    (0..=MAX_CASTING).filter(move |&light| !held.is_some_and(|held| held.is_same(shadows, light)))
}

/// [`shaded`] by stages of the device; `None` if the host has to find some light. `over`: the memory of the splats may
/// be used again.
pub(super) fn shaded_on_device(
    (context, pipelines): (&Context, &Cache),
    (stores, over): (&[Store], bool),
    held: Option<&Shadows>,
    occluders: &Occluders,
    shadows: &Shadows,
    progress: &Progress,
) -> Result<Option<Vec<Store>>> {
    let Shadows { casting, lattice, clip } = shadows;
    let Some(plans) = LightPlans::new(casting, lattice, bounds_of(stores)) else { return Ok(None) };
    let lights: Vec<usize> = unknown(held, shadows).collect();
    let unlit = Unlit { stores, over, dims: lattice.dims, clip };
    let buffers = taken(&occluders.device, shadows);
    let made = match Sampled::of(stores) {
        None => shadows::run(context, pipelines, &unlit, &plans, &lights, buffers, progress)?,
        Some(sampled) => {
            let unlit = UnlitSamples { sampled: &sampled, over, dims: lattice.dims, clip };
            let made = shadows::run_on_samples(context, pipelines, &unlit, &plans, &lights, buffers, progress)?;
            let stores = |(sampled, buffers)| Ok::<_, Error>((Sampled::stores(&Arc::new(sampled), context)?, buffers));
            made.map(stores).transpose()?
        }
    };
    Ok(made.map(|(stores, buffers)| {
        // Lights that changed once may do so again.
        let is_kept = held.is_some() && buffers.bytes() <= Occluders::MOST;
        keep(&occluders.device, is_kept.then(|| (shadows.without_lights(), buffers)));
        stores
    }))
}

/// [`shaded`] on the host.
pub(super) fn shaded_on_host(
    context: &Context,
    stores: &[Store],
    held: Option<&Shadows>,
    occluders: &Occluders,
    shadows: &Shadows,
    progress: &Progress,
) -> Result<Vec<Store>> {
    let splats = Places::new(context, stores)?;
    let arrival = match occluders.taken(shadows) {
        Some(arrival) => arrival,
        None => {
            let arrival = splats.arrival(shadows, &|words| f32::from_bits(words[0] & 0xffff_ff00))?;
            // Lights that changed once may do so again.
            if held.is_some() { arrival.keeping() } else { arrival }
        }
    };
    let bricks = splats.bricks();
    let mut lit: Vec<Option<HostBrick>> = bricks.iter().map(|_| None).collect();
    for light in unknown(held, shadows) {
        let report = |part: f64| progress.report("casting shadows", (light as f64 + part) / (MAX_CASTING + 1) as f64);
        let arriving = arrival.shares(light, &report)?;
        let (word, shift) = (light / 2, light % 2 * 16);
        bricks.par_iter().zip(&mut lit).try_for_each(|(&brick, lit)| {
            let mut kept = lit.as_ref().unwrap_or(brick.1).all_light()?;
            for (Row { bits, first, .. }, point) in rows(brick) {
                let shares = arriving.as_ref().map(|arriving| arriving.from(point));
                let lowest = bits.trailing_zeros() as usize;
                for (place, kept) in places(bits).zip(&mut kept[first as usize..]) {
                    let share = shares.as_ref().map_or(u16::MAX, |share| share(place - lowest));
                    kept[word] = kept[word] & !(0xffff << shift) | u32::from(share) << shift;
                }
            }
            *lit = Some(brick.1.under(kept));
            Ok::<_, Error>(())
        })?;
    }
    occluders.keep(shadows, arrival);
    let mut stores = StoreBuilder::new(context, STRIDE, u32::MAX);
    for ((&brick, held), lit) in bricks.into_iter().zip(lit) {
        let splats = lit.map_or_else(|| Ok::<_, Error>(held.under(held.all_light()?)), Ok)?;
        stores.push(MadeBrick { brick, splats, copies: 0 })?;
    }
    Ok(stores.finish()?.stores)
}

/// The first lattice point of the box around splats, and its size; one voxel if there are no splats.
fn bounds_of(stores: &[Store]) -> [[usize; 3]; 2] {
    let bricks = stores.iter().flat_map(|store| &store.bricks);
    let filled = bricks.map(|brick| brick.bounds).filter(|[low, high]| low != high);
    let bounds = filled.reduce(|[low, high], bounds| {
        [[0, 1, 2].map(|a| low[a].min(bounds[0][a])), [0, 1, 2].map(|a| high[a].max(bounds[1][a]))]
    });
    let [low, high] = bounds.unwrap_or([[0; 3], [1; 3]]).map(|point| point.map(|n| n as usize));
    [low, [0, 1, 2].map(|a| high[a] - low[a])]
}

/// The splats of a lattice on the host, by place.
pub(crate) struct Places<'a> {
    stores: &'a [Store],
    held: Vec<Arc<Vec<HostBrick>>>,
    /// Bricks along each axis.
    counts: [usize; 3],
    /// By brick, x fastest: its store, and its number in the store; `None`: the brick has no splats.
    numbers: Vec<Option<[usize; 2]>>,
    /// The box around the splats: [`bounds_of`].
    pub(crate) bounds: [[usize; 3]; 2],
}

impl<'a> Places<'a> {
    pub(crate) fn new(context: &Context, stores: &'a [Store]) -> Result<Self> {
        let held = stores.iter().map(|store| store.on_host(context)).collect::<Result<Vec<_>>>()?;
        let bounds @ [low, size] = bounds_of(stores);
        let high = [0, 1, 2].map(|a| low[a] + size[a]);
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
        Ok(Self { stores, held, counts, numbers, bounds })
    }

    /// The bricks of the stores in order.
    pub(crate) fn bricks(&self) -> Vec<(&BrickSplats, &HostBrick)> {
        self.stores.iter().zip(&self.held).flat_map(|(store, held)| store.bricks.iter().zip(held.iter())).collect()
    }

    /// The bricks with splats in a row of the lattice, of these `bricks` along it: the x of the first place of each,
    /// and the row of the brick.
    pub(crate) fn bricks_of_row(
        &self,
        bricks: Range<usize>,
        [y, z]: [usize; 2],
    ) -> impl Iterator<Item = (usize, &HostBrick, Row)> {
        let row = self.counts[0] * (y / EDGE + self.counts[1] * (z / EDGE));
        let is_within = y / EDGE < self.counts[1] && z / EDGE < self.counts[2];
        let bricks = bricks.start..bricks.end.min(self.counts[0]);
        bricks.filter(move |_| is_within).filter_map(move |number| {
            let [store, brick] = self.numbers[row + number]?;
            let brick = &self.held[store][brick];
            let row = brick.rows[y % EDGE + EDGE * (z % EDGE)];
            (row.bits != 0).then_some((number * EDGE, brick, row))
        })
    }

    /// The splats of a row of the lattice that lie in some columns: their x, and their words without the place.
    pub(crate) fn row(&self, columns: Range<usize>, place: [usize; 2]) -> impl Iterator<Item = (usize, &[u32])> {
        let bricks = columns.start / EDGE..columns.end.div_ceil(EDGE);
        let splats = self.bricks_of_row(bricks, place).flat_map(|(start, brick, row)| {
            let words = brick.words(row, 0).chunks_exact(brick.each);
            places(row.bits).zip(words).map(move |(x, words)| (start + x, words))
        });
        splats.filter(move |(x, _)| columns.contains(x))
    }

    /// The light that arrives at the splats. `density` gets the words of a splat without the place.
    pub(crate) fn arrival(&self, shadows: &Shadows, density: &(dyn Fn(&[u32]) -> f32 + Sync)) -> Result<Arrival> {
        Arrival::new(&shadows.casting, &shadows.lattice, self.bounds, |place, row| {
            self.fill_row(shadows, density, place, row);
        })
    }

    /// The extinctions of the splats in the box of `plans`, x fastest.
    pub(crate) fn field(
        &self,
        shadows: &Shadows,
        plans: &LightPlans,
        density: &(dyn Fn(&[u32]) -> f32 + Sync),
    ) -> Result<Vec<f32>> {
        let [nx, ny, nz] = plans.dims();
        let mut field: Vec<f32> = zeroed((nx * ny * nz) as u64, || "the occluders of light".to_owned())?;
        let [low, size] = self.bounds;
        let margin = (nx - size[0]) / 2;
        field.par_chunks_mut(nx).enumerate().for_each(|(row, values)| {
            let [y, z] = [row % ny, row / ny].map(|n| n.wrapping_sub(margin));
            if y < size[1] && z < size[2] {
                self.fill_row(shadows, density, [low[1] + y, low[2] + z], &mut values[margin..margin + size[0]]);
            }
        });
        Ok(field)
    }

    /// Writes the extinctions of a row of the box.
    fn fill_row(
        &self,
        shadows: &Shadows,
        density: &(dyn Fn(&[u32]) -> f32 + Sync),
        [y, z]: [usize; 2],
        row: &mut [f32],
    ) {
        let [[first, ..], [count, ..]] = self.bounds;
        for (x, words) in self.row(first..first + count, [y, z]) {
            let casts = shadows.casts([x, y, z]);
            row[x - first] = if casts { density(words).max(CLIPPED) } else { CLIPPED };
        }
    }
}

/// The rows of a brick that have splats, each with the lattice point of its first splat.
fn rows((brick, held): (&BrickSplats, &HostBrick)) -> impl Iterator<Item = (Row, [usize; 3])> {
    let [x, y, z] = brick.origin.map(|p| p as usize);
    held.rows.iter().enumerate().filter(|(_, row)| row.bits != 0).map(move |(number, &row)| {
        let lowest = row.bits.trailing_zeros() as usize;
        (row, [x + lowest, y + number % EDGE, z + number / EDGE])
    })
}
