//! scalars: a volume to splats of scalars, for post-shading. On the host: which voxels can show depends on their
//! surroundings, and is known brick by brick.

use rayon::prelude::*;

use super::classify::{BrickSplats, Store};
use super::context::Context;
use super::layout::{MAX_BRICKS, ScalarSplat, place};
use crate::error::{Error, Result};
use crate::kernel::{Kernel, Normalization};
use crate::transfer::TransferFunction;
use crate::volume::{BRICK_EDGE as EDGE, Volume};

/// Voxels along the side of the bricks in which ranges are known.
const BRICK: usize = 4;

/// The most places of an extended lattice, unless the volume itself has half as many: kernels grow without end as the
/// picture gets smaller, and the copies beyond the faces with them.
const MAX_PLACES: u64 = 1 << 28;

/// How far splats reach, as far as it decides which are needed; see [`Plan`](super::plan::Plan).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Reach {
    /// Layers by which the lattice is extended on every side, each a copy of the outermost one: the field is complete to
    /// the faces of the volume and does not fade there.
    pub(crate) padding: u32,
    /// Voxels within which two voxels can take part in the classification of the same place.
    pub(crate) influence: u32,
}

/// What splats of scalars depend on besides volume and transfer function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Asked {
    pub(crate) kernel: Kernel,
    pub(crate) normalization: Normalization,
    pub(crate) reach: Reach,
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
#[derive(Debug)]
pub(crate) struct Emitted {
    pub(crate) stores: Vec<Store>,
    /// Voxels of the volume among the splats; the others are copies beyond its faces.
    pub(crate) voxels: u64,
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

/// The least and the largest value of each brick of a volume, less the base.
#[derive(Debug)]
pub(crate) struct Bricks {
    counts: [usize; 3],
    ranges: Vec<[f64; 2]>,
}

const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

fn joined(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl Bricks {
    pub(crate) fn new(volume: &Volume, base: f64) -> Result<Self> {
        let values = volume.in_memory()?;
        let dims = volume.grid().dims().map(|d| d as usize);
        let counts = dims.map(|d| d.div_ceil(BRICK));
        let [nx, ny, nz] = dims;
        let mut ranges = vec![NOTHING; counts.iter().product()];
        ranges.par_chunks_mut(counts[0] * counts[1]).enumerate().for_each(|(bz, layer)| {
            for z in bz * BRICK..nz.min((bz + 1) * BRICK) {
                for y in 0..ny {
                    for x in 0..nx {
                        let value = values.value(x + nx * (y + ny * z)) - base;
                        let range = &mut layer[x / BRICK + counts[0] * (y / BRICK)];
                        *range = joined(*range, [value, value]);
                    }
                }
            }
        });
        Ok(Self { counts, ranges })
    }

    /// The largest distance of a value from the base: what sheets are scaled by.
    pub(crate) fn largest(&self) -> f64 {
        self.ranges.iter().flatten().map(|v| v.abs()).fold(0.0, f64::max)
    }

    /// The range of each brick and all within `bricks` of it.
    fn dilated(&self, bricks: usize) -> Vec<[f64; 2]> {
        let counts = self.counts;
        let mut ranges = self.ranges.clone();
        let strides = [1, counts[0], counts[0] * counts[1]];
        for axis in 0..3 {
            let (n, stride) = (counts[axis], strides[axis]);
            let source = std::mem::take(&mut ranges);
            ranges = (0..source.len())
                .into_par_iter()
                .map(|index| {
                    let at = index / stride % n;
                    let (low, high) = (at.saturating_sub(bricks), (at + bricks).min(n - 1));
                    (low..=high).map(|i| source[index - at * stride + i * stride]).fold(NOTHING, joined)
                })
                .collect();
        }
        ranges
    }
}

/// Whether nothing shows where the field is made of voxels in a range about the base.
fn is_hidden(transfer: &TransferFunction, shows: Shows, base: f64, magnification: f64, range: [f64; 2]) -> bool {
    let low = base + range[0].min(0.0) * magnification;
    let high = base + range[1].max(0.0) * magnification;
    match shows {
        Shows::Opaque => transfer.is_clear([low, high]),
        Shows::Largest => transfer.is_clear([f64::NEG_INFINITY, high]),
    }
}

/// The splats of a volume: those of voxels that can take part in something visible, and copies beyond its faces.
pub(crate) fn emit(
    context: &Context,
    volume: &Volume,
    bricks: &Bricks,
    transfer: &TransferFunction,
    shows: Shows,
    asked: &Asked,
) -> Result<Emitted> {
    let reach = asked.reach;
    let base = transfer.base();
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
    let magnification = magnification(&asked.kernel, asked.normalization);
    let values = volume.in_memory()?;
    let ranges = bricks.dilated((reach.influence as usize).div_ceil(BRICK));
    let shown: Vec<bool> =
        ranges.par_iter().map(|&range| !is_hidden(transfer, shows, base, magnification, range)).collect();
    let [bx, by, _] = bricks.counts;
    let [nx, ny, nz] = dims.map(|d| d as usize);
    let padding = reach.padding as usize;
    // A place of the extended lattice is that of a voxel or of a copy.
    let voxel = |p: usize, n: usize| p.saturating_sub(padding).min(n - 1);
    let extended = [nx, ny, nz].map(|n| n + 2 * padding);
    let counts = extended.map(|n| n.div_ceil(EDGE));
    let found: Vec<Found> = (0..counts.iter().product())
        .into_par_iter()
        .map(|brick: usize| {
            let origin = [brick % counts[0], brick / counts[0] % counts[1], brick / (counts[0] * counts[1])];
            let origin = origin.map(|b| b * EDGE);
            let inside = |axis: usize| origin[axis]..extended[axis].min(origin[axis] + EDGE);
            let mut found = Found { origin: origin.map(|o| o as u32), ..Found::default() };
            for pz in inside(2) {
                let z = voxel(pz, nz);
                for py in inside(1) {
                    let y = voxel(py, ny);
                    for px in inside(0) {
                        let x = voxel(px, nx);
                        if !shown[x / BRICK + bx * (y / BRICK + by * (z / BRICK))] {
                            continue;
                        }
                        let scalar = (values.value(x + nx * (y + ny * z)) - base) as f32;
                        if scalar != 0.0 {
                            let at = [px - origin[0], py - origin[1], pz - origin[2]].map(|c| c as u32);
                            found.splats.push(ScalarSplat { place: place(at, 0), scalar });
                            found.voxels += u64::from([px, py, pz] == [x, y, z].map(|c| c + padding));
                        }
                    }
                }
            }
            found
        })
        .filter(|found| !found.splats.is_empty())
        .collect();
    let most = context.limits.max_storage_buffer_binding_size.min(context.limits.max_buffer_size) / STRIDE;
    let most = usize::try_from(most.min(u64::from(u32::MAX))).unwrap_or(usize::MAX);
    let mut emitted = Emitted { stores: Vec::new(), voxels: 0 };
    let (mut splats, mut bricks): (Vec<ScalarSplat>, Vec<BrickSplats>) = (Vec::new(), Vec::new());
    for brick in found {
        if splats.len() + brick.splats.len() > most || bricks.len() == MAX_BRICKS {
            emitted.stores.push(store(context, &splats, std::mem::take(&mut bricks))?);
            splats.clear();
        }
        let number = bricks.len() as u32;
        bricks.push(BrickSplats { origin: brick.origin, first: splats.len() as u32 });
        splats.extend(brick.splats.iter().map(|s| ScalarSplat { place: s.place | number << 15, ..*s }));
        emitted.voxels += brick.voxels;
    }
    if !splats.is_empty() {
        emitted.stores.push(store(context, &splats, bricks)?);
    }
    context.wait("emitting scalars")?;
    Ok(emitted)
}

/// Bytes of a splat.
const STRIDE: u64 = 8;

/// The splats of one brick, their places without its number.
#[derive(Default)]
struct Found {
    origin: [u32; 3],
    splats: Vec<ScalarSplat>,
    voxels: u64,
}

fn store(context: &Context, splats: &[ScalarSplat], bricks: Vec<BrickSplats>) -> Result<Store> {
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let buffer = context.upload("scalars.splats", bytemuck::cast_slice(splats), usage)?;
    Store::new(context, buffer, STRIDE, splats.len() as u32, bricks)
}
