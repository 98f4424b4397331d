//! scalars: a volume to splats of scalars, for post-shading. On the host, brick by brick: which voxels can show depends on
//! their surroundings.

use super::context::Context;
use super::layout::{MAX_BRICKS, ScalarSplat, place};
use super::store::{BrickSplats, Bricks, Store};
use crate::error::{Error, Result};
use crate::kernel::{Kernel, Normalization};
use crate::settings::Savings;
use crate::transfer::TransferFunction;
use crate::volume::{BRICK_EDGE as EDGE, RowCoding, ToF64, Volume};

/// The farthest, in voxels, that single voxels are looked for; where kernels reach farther, bricks are kept whole.
const MAX_HALO: usize = 16;

/// The most places of an extended lattice, unless the volume itself has half as many: kernels grow without end as the
/// picture gets smaller, and the copies beyond the faces with them.
const MAX_PLACES: u64 = 1 << 28;

/// How far splats reach, as far as it decides which are needed; see [`Plan`](super::quads::plan::Plan).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reach {
    /// Layers by which the lattice is extended on every side, each a copy of the outermost one: the field is complete to
    /// the faces of the volume and does not fade there.
    pub(crate) padding: u32,
    /// Distance in voxels within which two voxels can take part in the classification of the same place.
    pub(crate) influence: f64,
}

/// What splats of scalars depend on besides volume and transfer function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Asked {
    pub(crate) kernel: Kernel,
    pub(crate) normalization: Normalization,
    pub(crate) reach: Reach,
    pub(crate) savings: Savings,
}

impl Asked {
    /// Whether splats made for this are as good for `other`: more than needed change nothing, but should not be many.
    pub(crate) fn serves(&self, other: &Self) -> bool {
        let influence = other.reach.influence..=1.5 * other.reach.influence;
        let reach = Reach { influence: self.reach.influence, ..other.reach };
        other.savings.reuse && influence.contains(&self.reach.influence) && *self == Self { reach, ..*other }
    }
}

/// What of a scalar field shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shows {
    /// Whatever the transfer function gives opacity.
    Opaque,
    /// The largest value, where it has opacity: smaller ones only matter for not being larger.
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
struct Clear([f64; 2]);

impl Clear {
    fn new(transfer: &TransferFunction, shows: Shows, magnification: f64) -> Self {
        let base = transfer.base();
        let around = transfer.clear_around(base);
        let ends = match shows {
            Shows::Opaque => around,
            Shows::Largest => around
                .filter(|_| transfer.is_clear([f64::NEG_INFINITY, base]))
                .map(|[_, high]| [f64::NEG_INFINITY, high]),
        };
        // Empty where no value is clear.
        let ends = ends.unwrap_or([f64::INFINITY, f64::NEG_INFINITY]);
        Self(ends.map(|end| (end - base) / magnification))
    }

    fn holds(self, scalar: f64) -> bool {
        let Self([low, high]) = self;
        low <= scalar && scalar <= high
    }
}

/// The largest distance of a value from the base: what sheets are scaled by.
pub(crate) fn largest(volume: &Volume, base: f64) -> Result<f64> {
    let (slope, intercept) = volume.rescale();
    Ok(volume.ranges()?.iter().flatten().map(|raw| (slope * raw + intercept - base).abs()).fold(0.0, f64::max))
}

/// Scalars relative to the base.
struct Relative {
    slope: f64,
    intercept: f64,
    base: f64,
}

impl Relative {
    fn to(&self, raw: f64) -> f32 {
        (self.slope * raw + self.intercept - self.base) as f32
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
    // Squares of distances, axis by axis (Saito and Toriwaki 1994): along x by a sweep each way, then the least over the
    // neighbours along y and z.
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

/// The splats of a volume: those of voxels that can take part in something visible, and copies beyond its faces.
///
/// A place shows only where a voxel that [`Clear`] does not hold reaches it. So a voxel is kept where such a one is
/// within the influence of the two, and the others change nothing, neither what shows nor that the rest does not.
pub(crate) fn emit(
    context: &Context,
    volume: &Volume,
    transfer: &TransferFunction,
    shows: Shows,
    asked: &Asked,
) -> Result<Emitted> {
    let reach = asked.reach;
    let dims = volume.grid().dims();
    let places: u64 = dims
        .map(|d| u64::from(d.saturating_add(reach.padding.saturating_mul(2))))
        .iter()
        .fold(1, |p, &d| p.saturating_mul(d));
    if places > MAX_PLACES.max(2 * volume.grid().len()) {
        return Err(Error::Setting {
            name: "antialiasing",
            reason: format!(
                "kernels that have grown so far need {} layers of voxels beyond the faces: take a larger picture, thinner \
                 sheets, or turn it off",
                reach.padding
            ),
        });
    }
    let (slope, intercept) = volume.rescale();
    let relative = Relative { slope, intercept, base: transfer.base() };
    let clear = Clear::new(transfer, shows, magnification(&asked.kernel, asked.normalization));
    let Savings { bricks, voxels, .. } = asked.savings;
    let is_active = |scalar: f32| !voxels || !clear.holds(f64::from(scalar));
    let active: Vec<bool> =
        volume.ranges()?.iter().map(|range| range.iter().any(|&raw| is_active(relative.to(raw)))).collect();
    let [across, down, deep] = volume.bricks().map(|n| n as usize);
    let padding = reach.padding as usize;
    let extended = dims.map(|d| d as usize + 2 * padding);
    let counts = extended.map(|n| n.div_ceil(EDGE));
    let halo = reach.influence.floor() as usize;
    // Whether any brick of the volume is active that has voxels within the halo around this one.
    let is_near = |brick: [usize; 3]| {
        let bricks = |axis: usize, n: usize| {
            let first = (brick[axis] * EDGE) as i64 - padding as i64;
            let at = |place: i64| place.div_euclid(EDGE as i64).clamp(0, n as i64 - 1) as usize;
            at(first - halo as i64)..=at(first + (EDGE - 1 + halo) as i64)
        };
        bricks(2, deep).any(|z| bricks(1, down).any(|y| bricks(0, across).any(|x| active[x + across * (y + down * z)])))
    };
    let singly = voxels && halo <= MAX_HALO;
    let halo = if singly { halo } else { 0 };
    let row = |j: usize, k: usize| -> Result<Vec<Found>> {
        let near: Vec<usize> = (0..counts[0]).filter(|&i| !bricks || is_near([i, j, k])).collect();
        if near.is_empty() {
            return Ok(Vec::new());
        }
        let at = |brick: usize| (brick * EDGE) as i64 - padding as i64;
        let strip = volume.strip([at(j), at(k)], halo)?;
        let found = |&i: &usize| {
            let bytes = strip.brick([at(i), at(j), at(k)], &relative);
            let scalars: Vec<f32> = bytemuck::pod_collect_to_vec(&bytes);
            let kept = singly.then(|| {
                let active: Vec<bool> = scalars.iter().map(|&s| is_active(s)).collect();
                within_reach(&active, halo, reach.influence)
            });
            found([i, j, k].map(|b| b * EDGE), extended, padding, (&scalars, halo), kept.as_deref())
        };
        Ok(near.iter().map(found).collect())
    };
    let mut gathering = Gathering::new(context);
    volume.for_each_row([counts[1], counts[2]], halo, &row, &mut |row| {
        row.iter().try_for_each(|found| gathering.add(found))
    })?;
    gathering.finish(counts.iter().product::<usize>() as u32)
}

/// The splats of the brick that begins at `origin` in the lattice with the copies, `extended`, given its scalars with
/// `halo` around them, and which of its places are kept where not all are.
fn found(
    origin: [usize; 3],
    extended: [usize; 3],
    padding: usize,
    (scalars, halo): (&[f32], usize),
    kept: Option<&[bool]>,
) -> Found {
    let mut found = Found::default();
    let mut rows = vec![0; EDGE * EDGE];
    let edge = EDGE + 2 * halo;
    let [nx, ny, nz] = [0, 1, 2].map(|axis| EDGE.min(extended[axis] - origin[axis]));
    // The places of a row along an axis that are those of voxels, not of copies.
    let voxels = [0, 1, 2].map(|axis| {
        let place = |lattice: usize| lattice.saturating_sub(origin[axis]);
        place(padding)..place(extended[axis] - padding)
    });
    for z in 0..nz {
        for y in 0..ny {
            let row = &scalars[halo + edge * (y + halo + edge * (z + halo))..][..nx];
            let kept = kept.map(|kept| &kept[EDGE * (y + EDGE * z)..][..nx]);
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

/// Joins the splats of bricks into few buffers.
struct Gathering<'a> {
    context: &'a Context,
    /// The most splats of a store.
    most: usize,
    splats: Vec<ScalarSplat>,
    bricks: Vec<BrickSplats>,
    emitted: Emitted,
}

impl<'a> Gathering<'a> {
    fn new(context: &'a Context) -> Self {
        let most = context.limits.max_storage_buffer_binding_size.min(context.limits.max_buffer_size) / STRIDE;
        let most = usize::try_from(most.min(u64::from(u32::MAX))).unwrap_or(usize::MAX);
        Self { context, most, splats: Vec::new(), bricks: Vec::new(), emitted: Emitted::default() }
    }

    fn add(&mut self, found: &Found) -> Result<()> {
        self.emitted.bricks.uploaded += 1;
        self.emitted.voxels += found.voxels;
        if found.splats.is_empty() {
            return Ok(());
        }
        if self.splats.len() + found.splats.len() > self.most || self.bricks.len() == MAX_BRICKS {
            self.close()?;
        }
        let number = self.bricks.len() as u32;
        self.bricks.push(BrickSplats { first: self.splats.len() as u32, ..found.brick });
        self.emitted.bricks.bytes += size_of_val(found.splats.as_slice()) as u64;
        self.splats.extend(found.splats.iter().map(|s| ScalarSplat { place: s.place | number << 15, ..*s }));
        Ok(())
    }

    fn close(&mut self) -> Result<()> {
        if !self.splats.is_empty() {
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let buffer = self.context.upload("scalars.splats", bytemuck::cast_slice(&self.splats), usage)?;
            let (count, bricks) = (self.splats.len() as u32, std::mem::take(&mut self.bricks));
            self.emitted.stores.push(Store::new(self.context, buffer, STRIDE, count, bricks)?);
            self.splats.clear();
        }
        Ok(())
    }

    fn finish(mut self, bricks: u32) -> Result<Emitted> {
        self.close()?;
        self.context.wait("emitting scalars")?;
        self.emitted.bricks.all = bricks;
        Ok(self.emitted)
    }
}

/// Bytes of a splat.
const STRIDE: u64 = 8;

/// The splats of one brick, their places without its number.
#[derive(Default)]
struct Found {
    /// As if it were the first of its store.
    brick: BrickSplats,
    splats: Vec<ScalarSplat>,
    voxels: u64,
}
