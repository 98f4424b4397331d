//! scalars: a volume to splats of scalars, for post-shading. On the host, brick by brick: which voxels can show depends
//! on their surroundings.

use super::context::Context;
use super::layout::{BRICK_SHIFT, ScalarSplat, place};
use super::savings::Savings;
use super::store::{BrickSplats, Bricks, Part, Store, StoreBuilder};
use super::transfer::Reduction;
use super::view::ScalarNeed;
use crate::error::{Error, Result};
use crate::kernel::{Kernel, Normalization};
use crate::progress::Progress;
use crate::transfer::TransferFunction;
use crate::volume::{BRICK_EDGE as EDGE, RowCoding, ToF64, Volume};

/// The largest influence, in voxels, within which single voxels are looked for. If it is larger, bricks are kept whole.
const MAX_HALO: usize = 16;

/// The most places of an extended lattice, unless the volume itself has half as many: kernels grow without end as the
/// picture gets smaller, and the copies beyond the faces with them.
const MAX_PLACES: u64 = 1 << 28;

/// What splats of scalars depend on besides volume and transfer function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Asked {
    pub(crate) kernel: Kernel,
    pub(crate) normalization: Normalization,
    pub(crate) need: ScalarNeed,
}

impl Asked {
    /// Whether splats made for `self` can be reused for `other`. They must reach at least as far; reaching up to 1.5
    /// times as far changes no pixel and costs only time.
    pub(crate) fn serves(&self, other: &Self) -> bool {
        let influence = other.need.influence..=1.5 * other.need.influence;
        let need = ScalarNeed { influence: self.need.influence, ..other.need };
        influence.contains(&self.need.influence) && *self == Self { need, ..*other }
    }
}

/// What of a scalar field shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shows {
    /// Whatever the transfer function gives opacity.
    Opaque,
    /// The largest value, if it has opacity. Smaller values only matter for not being larger.
    Largest,
}

/// Splats of scalars on the device.
#[derive(Debug, Default)]
pub(crate) struct Emitted {
    pub(crate) stores: Vec<Store>,
    /// Voxels of the volume among the splats; the others are copies beyond its faces.
    pub(crate) voxels: u64,
    pub(crate) bricks: Bricks,
}

/// The largest sum of kernels over the lattice, over the divisor: reconstruction magnifies differences by no more.
///
/// Looked for on a grid of a quarter of a voxel, for a kernel as asked and as a broad one has it; a tenth is added for
/// what lies between.
fn magnification(kernel: &Kernel, normalization: Normalization) -> f64 {
    let reach = kernel.radius().ceil() as i32;
    let offsets = [0.0, 0.25, 0.5];
    let mut worst = kernel.integral();
    for x in offsets {
        for y in offsets {
            for z in offsets {
                let mut sum = 0.0;
                for k in -reach..=reach + 1 {
                    for j in -reach..=reach + 1 {
                        for i in -reach..=reach + 1 {
                            let d = [f64::from(i) - x, f64::from(j) - y, f64::from(k) - z];
                            sum += kernel.value(d.iter().map(|c| c * c).sum());
                        }
                    }
                }
                worst = worst.max(sum);
            }
        }
    }
    1.1 * worst / normalization.divisor(kernel)
}

/// Which scalars, relative to the base, show nothing however kernels add them up.
///
/// The interval holds 0, so sums of some of its scalars, be the others left out or not, do not show either.
#[derive(Debug, Clone, Copy)]
struct Invisible([f64; 2]);

impl Invisible {
    fn new(transfer: &TransferFunction, reduction: &Reduction, shows: Shows, magnification: f64) -> Self {
        let base = transfer.base();
        let around = transfer.invisible_around(base);
        let ends = match shows {
            Shows::Opaque => around,
            Shows::Largest => around
                .filter(|_| transfer.is_invisible([f64::NEG_INFINITY, base]))
                .map(|[_, high]| [f64::NEG_INFINITY, high]),
        };
        // Empty if every value is visible.
        let ends = ends.unwrap_or([f64::INFINITY, f64::NEG_INFINITY]);
        Self(ends.map(|end| reduction.length((end - base) / magnification)))
    }

    fn holds(self, scalar: f64) -> bool {
        let Self([low, high]) = self;
        low <= scalar && scalar <= high
    }
}

/// The largest distance of a value from the base.
pub(crate) fn largest(volume: &Volume, base: f64) -> Result<f64> {
    let (slope, intercept) = volume.rescale();
    Ok(volume.ranges()?.iter().flatten().map(|raw| (slope * raw + intercept - base).abs()).fold(0.0, f64::max))
}

/// Samples as scalars.
struct Relative {
    slope: f64,
    intercept: f64,
    reduction: Reduction,
}

impl Relative {
    fn to(&self, raw: f64) -> f32 {
        self.reduction.scalar(self.slope * raw + self.intercept)
    }
}

impl RowCoding for Relative {
    fn append<T: ToF64 + bytemuck::Pod>(&self, samples: &[T], bytes: &mut Vec<u8>) {
        bytes.extend(samples.iter().flat_map(|s| self.to(s.to_f64()).to_ne_bytes()));
    }
}

/// Of the places of a brick, x fastest, whether they are within `reach` of an active one of the brick or its halo.
fn within_reach(active: &[bool], halo: usize, reach: f64) -> Vec<bool> {
    // Far enough, and sums of two stay in range.
    const FAR: u16 = 1 << 14;
    let edge = EDGE + 2 * halo;
    let inner = halo..halo + EDGE;
    // Squares of distances, axis by axis (Saito and Toriwaki 1994): along x by a sweep each way, then the least over
    // the neighbours along y and z.
    let mut squares = Vec::with_capacity(EDGE * edge * edge);
    let mut distances = vec![0_u16; edge];
    for row in active.chunks_exact(edge) {
        let mut distance = 127;
        for (d, &active) in distances.iter_mut().zip(row) {
            distance = if active { 0 } else { (distance + 1).min(127) };
            *d = distance;
        }
        distance = 127;
        for (d, &active) in distances.iter_mut().zip(row).rev() {
            distance = if active { 0 } else { (distance + 1).min(127) };
            *d = distance.min(*d);
        }
        squares.extend(distances[inner.clone()].iter().map(|&d| d * d));
    }
    // `stride` apart; `lines` of them after each other are neighbours along the axis.
    let least = |squares: &[u16], stride: usize| {
        let mut result = vec![FAR; squares.len() / edge * EDGE];
        for (result, squares) in result.chunks_exact_mut(EDGE * stride).zip(squares.chunks_exact(edge * stride)) {
            for (i, result) in result.chunks_exact_mut(stride).enumerate() {
                for (offset, line) in squares[i * stride..].chunks_exact(stride).take(2 * halo + 1).enumerate() {
                    let square = (offset as u16).abs_diff(halo as u16).pow(2);
                    result.iter_mut().zip(line).for_each(|(least, &s)| *least = (*least).min(s + square));
                }
            }
        }
        result
    };
    let squares = least(&squares, EDGE);
    let squares = least(&squares, EDGE * EDGE);
    let reach = (reach * reach).floor() as u16;
    squares.into_iter().map(|square| square <= reach).collect()
}

/// The splats of a volume: the voxels that can take part in something visible, and copies beyond its faces.
///
/// A place shows only if a voxel outside [`Invisible`] reaches it. So a voxel is kept if such a voxel is within the
/// influence of the two. The others change nothing: neither what shows, nor what does not show.
pub(crate) fn emit(
    context: &Context,
    volume: &Volume,
    transfer: &TransferFunction,
    reduction: &Reduction,
    shows: Shows,
    asked: &Asked,
    progress: &Progress,
) -> Result<Emitted> {
    let emission = Emission::new(context, volume, transfer, reduction, shows, asked)?;
    let [_, down, deep] = emission.counts;
    let mut stores = StoreBuilder::new(context, u32::MAX);
    let mut emitted = Emitted::default();
    let mut rows = 0;
    volume.for_each_row([down, deep], emission.halo, &|j, k| emission.row(j, k), &mut |row| {
        row.into_iter().try_for_each(|brick| emitted.add(&mut stores, brick))?;
        rows += 1;
        progress.report("emitting scalars", f64::from(rows) / (down * deep) as f64);
        Ok(())
    })?;
    emitted.stores = stores.finish()?;
    emitted.bricks.all = emission.counts.iter().product::<usize>() as u32;
    context.wait("emitting scalars")?;
    Ok(emitted)
}

impl Emitted {
    fn add(&mut self, stores: &mut StoreBuilder<'_, Vec<ScalarSplat>>, found: BrickScalars) -> Result<()> {
        let BrickScalars { brick, mut splats, voxels } = found;
        self.bricks.uploaded += 1;
        self.voxels += voxels;
        if splats.is_empty() {
            return Ok(());
        }
        let count = splats.len() as u32;
        let (number, first) = stores.make_room(count, 1)?;
        self.bricks.bytes += u64::from(count) * <Vec<ScalarSplat>>::STRIDE;
        splats.iter_mut().for_each(|splat| splat.place |= number << BRICK_SHIFT);
        stores.add(splats, count, [BrickSplats { first, ..brick }]);
        Ok(())
    }
}

/// What decides which scalars of a volume become splats.
struct Emission<'a> {
    volume: &'a Volume,
    relative: Relative,
    invisible: Invisible,
    savings: Savings,
    need: ScalarNeed,
    /// Of each brick of the volume, x fastest, whether a voxel of it can show.
    active: Vec<bool>,
    /// Lattice points along each axis, copies included; below, bricks of them.
    extended: [usize; 3],
    counts: [usize; 3],
    /// Layers of voxels around a brick that are searched for voxels that can show; 0 if bricks are kept whole.
    halo: usize,
    /// Whether they are; otherwise bricks are kept whole.
    singly: bool,
}

impl<'a> Emission<'a> {
    fn new(
        context: &Context,
        volume: &'a Volume,
        transfer: &TransferFunction,
        reduction: &Reduction,
        shows: Shows,
        asked: &Asked,
    ) -> Result<Self> {
        let need = asked.need;
        let dims = volume.grid().dims();
        let places = dims
            .map(|d| u64::from(d.saturating_add(need.padding.saturating_mul(2))))
            .iter()
            .fold(1_u64, |p, &d| p.saturating_mul(d));
        if places > MAX_PLACES.max(2 * volume.grid().len()) {
            return Err(Error::Setting {
                name: "antialiasing",
                reason: format!(
                    "kernels that have grown so far need {} layers of voxels beyond the faces: take a larger picture, \
                     thinner sheets, or turn it off",
                    need.padding
                ),
            });
        }
        let (slope, intercept) = volume.rescale();
        let mut emission = Self {
            volume,
            relative: Relative { slope, intercept, reduction: *reduction },
            invisible: Invisible::new(transfer, reduction, shows, magnification(&asked.kernel, asked.normalization)),
            savings: context.savings,
            need,
            active: Vec::new(),
            extended: dims.map(|d| d as usize + 2 * need.padding as usize),
            counts: [0; 3],
            halo: 0,
            singly: false,
        };
        emission.counts = emission.extended.map(|n| n.div_ceil(EDGE));
        let halo = need.influence.floor() as usize;
        emission.singly = emission.savings.voxels && halo <= MAX_HALO;
        emission.halo = if emission.singly { halo } else { 0 };
        let ranges = volume.ranges()?.iter();
        emission.active =
            ranges.map(|range| range.iter().any(|&raw| emission.is_active(emission.relative.to(raw)))).collect();
        Ok(emission)
    }

    /// Whether a scalar can show.
    fn is_active(&self, scalar: f32) -> bool {
        !self.savings.voxels || !self.invisible.holds(f64::from(scalar))
    }

    /// The lattice point of the volume at which a brick begins along an axis; negative among the copies.
    fn origin(&self, brick: usize) -> i64 {
        (brick * EDGE) as i64 - i64::from(self.need.padding)
    }

    /// Whether any brick of the volume is active that has voxels within the influence of this one.
    fn is_near(&self, brick: [usize; 3]) -> bool {
        let [across, down, deep] = self.volume.bricks().map(|n| n as usize);
        let reach = self.need.influence.floor() as i64;
        let bricks = |axis: usize, n: usize| {
            let first = self.origin(brick[axis]);
            let at = |place: i64| place.div_euclid(EDGE as i64).clamp(0, n as i64 - 1) as usize;
            at(first - reach)..=at(first + EDGE as i64 - 1 + reach)
        };
        let active = |[x, y, z]: [usize; 3]| self.active[x + across * (y + down * z)];
        bricks(2, deep).any(|z| bricks(1, down).any(|y| bricks(0, across).any(|x| active([x, y, z]))))
    }

    /// The bricks along x with these numbers in y and z that can hold splats.
    fn row(&self, j: usize, k: usize) -> Result<Vec<BrickScalars>> {
        let near: Vec<usize> =
            (0..self.counts[0]).filter(|&i| !self.savings.bricks || self.is_near([i, j, k])).collect();
        if near.is_empty() {
            return Ok(Vec::new());
        }
        let strip = self.volume.strip([j, k].map(|brick| self.origin(brick)), self.halo)?;
        Ok(near
            .into_iter()
            .map(|i| {
                let bytes = strip.brick([i, j, k].map(|brick| self.origin(brick)), &self.relative);
                self.brick([i, j, k], &bytemuck::pod_collect_to_vec::<u8, f32>(&bytes))
            })
            .collect())
    }

    /// The splats of a brick, given its scalars with the halo around them.
    fn brick(&self, brick: [usize; 3], scalars: &[f32]) -> BrickScalars {
        let halo = self.halo;
        let kept = self.singly.then(|| {
            let active: Vec<bool> = scalars.iter().map(|&s| self.is_active(s)).collect();
            within_reach(&active, halo, self.need.influence)
        });
        let padding = self.need.padding as usize;
        let origin = brick.map(|b| b * EDGE);
        let edge = EDGE + 2 * halo;
        let [nx, ny, nz] = [0, 1, 2].map(|axis| EDGE.min(self.extended[axis] - origin[axis]));
        // The places along each axis that hold voxels of the volume, not copies.
        let voxels = [0, 1, 2].map(|axis| {
            let place = |lattice: usize| lattice.saturating_sub(origin[axis]);
            place(padding)..place(self.extended[axis] - padding)
        });
        let mut found = BrickScalars::default();
        let mut rows = vec![0; EDGE * EDGE];
        for z in 0..nz {
            for y in 0..ny {
                let row = &scalars[halo + edge * (y + halo + edge * (z + halo))..][..nx];
                let kept = kept.as_ref().map(|kept| &kept[EDGE * (y + EDGE * z)..][..nx]);
                let inside = voxels[1].contains(&y) && voxels[2].contains(&z);
                for (x, &scalar) in row.iter().enumerate() {
                    if scalar != 0.0 && kept.is_none_or(|kept| kept[x]) {
                        rows[y + EDGE * z] |= 1 << x;
                        found.splats.push(ScalarSplat { place: place([x, y, z].map(|c| c as u32), 0), scalar });
                        found.voxels += u64::from(inside && voxels[0].contains(&x));
                    }
                }
            }
        }
        found.brick = BrickSplats::new(origin.map(|o| o as u32), 0, rows.into_iter());
        found
    }
}

impl Part for Vec<ScalarSplat> {
    const STRIDE: u64 = size_of::<ScalarSplat>() as u64;

    fn join(context: &Context, parts: Vec<Self>, count: u64) -> Result<wgpu::Buffer> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let buffer = context.buffer("scalars.splats", count * Self::STRIDE, usage)?;
        let mut at = 0;
        for part in parts {
            context.write(&buffer, at, bytemuck::cast_slice(&part));
            at += part.len() as u64 * Self::STRIDE;
        }
        Ok(buffer)
    }
}

/// The splats of one brick, their places without its number.
#[derive(Default)]
struct BrickScalars {
    /// As if it were the first of its store.
    brick: BrickSplats,
    splats: Vec<ScalarSplat>,
    voxels: u64,
}
