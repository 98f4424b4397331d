//! The stage on the host: the twin of the one on the device.

use std::ops::Range;

use bytemuck::Pod as Words;
use rayon::prelude::*;

use super::{BEHIND, Packing, Reached, Voxel, reaches};
use crate::error::Result;
use crate::gpu::layout::{CELL, MARGIN};
use crate::gpu::recorder::Recorder;
use crate::gpu::sender::Sender;
use crate::gpu::splat::{self, SplatLight};
use crate::gpu::store::Store;
use crate::painters::tiles::axis::unordered;
use crate::splats::brick::{BrickSplats, HostBrick};
use crate::splats::words::{LANES, SplatRun};
use crate::volume::BRICK_EDGE as EDGE;
use voxsplat_volume::memory::reserved;

/// Bytes of the buffer that is packed and copied to the texture at a time: few enough for the caches.
const BAND: u64 = 4 << 20;

/// Completes errors: "while ...".
const DOING: &str = "packing the volume";

/// Rows of the texture that a thread packs at a time. It then reads up to 16 neighbours along a row of the lattice, so
/// that cache lines are read once.
const ROWS: usize = 16;

/// A brick with its splats.
type Held<'a> = (BrickSplats, &'a HostBrick);

impl Packing {
    /// Fills the texture of voxels and the marks of macrocells.
    pub(super) fn fill_on_host(
        &self,
        recorder: &mut Recorder<'_>,
        (stores, reached): (&[Store], &Reached),
        light: &SplatLight,
        scale: f32,
        (volume, marks): (&wgpu::Texture, &wgpu::Buffer),
    ) -> Result<()> {
        let context = recorder.context;
        let held = stores.iter().map(|store| store.on_host(context)).collect::<Result<Vec<_>>>()?;
        let bricks = stores.iter().zip(&held).enumerate().flat_map(|(number, (store, held))| {
            let bricks = store.bricks.iter().copied().zip(held.iter()).enumerate();
            bricks.filter(move |(brick, _)| reaches(reached, number, *brick)).map(|(_, brick)| brick)
        });
        let bricks: Vec<Held<'_>> = bricks.collect();
        context.write(marks, 0, &self.marks(&bricks)?);
        match self.voxel {
            Voxel::Scalar => self.fill(recorder, volume, &bricks, |run| run.column(0)),
            Voxel::Gradient => self.fill(recorder, volume, &bricks, |run| {
                let scalars = run.column(0).map(|bits| f32::from_bits(bits) * scale);
                let mut gradients = [[0.0; LANES]; 3];
                let (low, high) = (run.column(1), run.column(2));
                for i in 0..LANES {
                    let gradient = splat::gradient([low[i], high[i]]);
                    (0..3).for_each(|axis| gradients[axis][i] = gradient[axis] * scale);
                }
                splat::halves(&gradients, &scalars)
            }),
            Voxel::Color { lights, .. } => {
                let light = (lights > 0).then_some(light);
                self.fill(recorder, volume, &bricks, |run| run.packed(light, scale))
            }
        }
    }

    /// Fills the texture with voxels that `packed` makes of splats.
    fn fill<V: Words + Send + Sync>(
        &self,
        recorder: &mut Recorder<'_>,
        volume: &wgpu::Texture,
        bricks: &[Held<'_>],
        packed: impl Fn(&SplatRun<'_>) -> [V; LANES] + Sync,
    ) -> Result<()> {
        let context = recorder.context;
        let [width, height] = self.size;
        let row = 2 * width as usize;
        let row_bytes = (row * size_of::<V>()) as u64;
        let band_rows = ((BAND / row_bytes) as usize).next_multiple_of(ROWS).min(height as usize);
        let parts = (height as usize).div_ceil(band_rows);
        let mut sender = Sender::new(context, DOING, band_rows as u64 * row_bytes, parts)?;
        for first in (0..height as usize).step_by(band_rows) {
            let rows = first..(first + band_rows).min(height as usize);
            let planes = self.planes(rows.start as u32..rows.end as u32);
            let (low, axis) = (self.low[2], self.axes[2]);
            let near = |(brick, _): &Held<'_>| {
                brick.bounds[0][axis] < low + planes.end && brick.bounds[1][axis] > low + planes.start
            };
            let near: Vec<Held<'_>> = bricks.iter().copied().filter(near).collect();
            // Rows are filled in a cache, and written to the band once.
            let fill = |band: &wgpu::Buffer| {
                let parts = (0..rows.len()).step_by(ROWS).collect::<Vec<_>>().into_par_iter();
                parts.try_for_each_init(Vec::new, |voxels, at| {
                    voxels.clear();
                    voxels.resize(ROWS.min(rows.len() - at) * row, V::zeroed());
                    self.fill_rows(first + at, voxels, &near, &packed);
                    context.write_mapped(DOING, band, at as u64 * row_bytes, bytemuck::cast_slice(voxels))
                })
            };
            sender.send(recorder, fill, |recorder, band| {
                recorder.copy_rows(band, row_bytes, volume, first as u32, [width, rows.len() as u32]);
            })?;
        }
        Ok(())
    }
}

/// The part of a brick from one lattice point to before another, if any: bits of the places in a row along x, and the
/// ranges along y and z.
fn part(brick: &BrickSplats, from: [u32; 3], to: [u32; 3]) -> Option<(u32, Range<u32>, Range<u32>)> {
    let [low, high] = brick.bounds;
    let [xs, ys, zs] = [0, 1, 2].map(|axis| low[axis].max(from[axis])..high[axis].min(to[axis]));
    let x0 = brick.origin[0];
    let bits = || u32::MAX << (xs.start - x0) & u32::MAX >> (u32::BITS - (xs.end - x0));
    (!xs.is_empty() && !ys.is_empty() && !zs.is_empty()).then(|| (bits(), ys, zs))
}

impl Packing {
    /// The marks of macrocells.
    fn marks(&self, bricks: &[Held<'_>]) -> Result<Vec<u8>> {
        let zeros = || -> Result<Vec<u8>> {
            let mut bytes = reserved(self.mark_bytes(), || "the macrocells of a volume".to_owned())?;
            bytes.resize(self.mark_bytes() as usize, 0_u8);
            Ok(bytes)
        };
        // The voxels of a cell mark the same cells. `done` has the cells whose voxels have marked theirs.
        let (mut marks, mut done) = (zeros()?, zeros()?);
        let low = unordered(self.axes, self.low);
        let ends = unordered(self.axes, [0, 1, 2].map(|i| self.low[i] + self.dims[i]));
        let steps = unordered(self.axes, self.mark_steps()).map(|step| step as usize);
        let behind = unordered(self.axes, BEHIND);
        let (shift, reach) = (unordered(self.axes, self.mark_shift()), self.marking.reach);
        // The cells along an axis that a voxel marks.
        let marked = |axis: usize, place: u32| {
            let place = place - low[axis] + shift[axis];
            [place - reach, place + reach].map(|place| place / CELL)
        };
        // Each macrocell of these cells along an axis: its index, and the bits of the cells.
        let macrocells = |axis: usize, [first, last]: [u32; 2]| {
            let bits = move |number: u32| {
                let foremost = if first <= 2 * number { !behind[axis] } else { 0 };
                foremost | if last > 2 * number { behind[axis] } else { 0 }
            };
            (first / 2..=last / 2).map(move |number| (number as usize * steps[axis], bits(number)))
        };
        // The index of a voxel's own macrocell along an axis, and the bits of its cell.
        let own = |axis: usize, place: u32| {
            let cell = (place - low[axis] + shift[axis]) / CELL;
            ((cell / 2) as usize * steps[axis], if cell % 2 == 1 { behind[axis] } else { !behind[axis] })
        };
        for (brick, held) in bricks {
            let Some((mask, ys, zs)) = part(brick, low, ends) else { continue };
            let [x0, y0, z0] = brick.origin;
            for (z, y) in zs.flat_map(|z| ys.clone().map(move |y| (z, y))) {
                let row = held.rows[(y - y0) as usize + EDGE * (z - z0) as usize];
                let mut bits = row.bits & mask;
                let ((own_z, in_z), (own_y, in_y)) = (own(2, z), own(1, y));
                while bits != 0 {
                    let place = bits.trailing_zeros();
                    let before = row.bits & !(u32::MAX << place);
                    bits &= bits - 1;
                    let (own_x, in_x) = own(0, x0 + place);
                    let (index, own) = (own_x + own_y + own_z, in_x & in_y & in_z);
                    let word = || held.words(row, before.count_ones())[0];
                    if done[index] & own != 0 || !self.marking.is_by(self.voxel, word()) {
                        continue;
                    }
                    done[index] |= own;
                    for (at_z, in_z) in macrocells(2, marked(2, z)) {
                        for (at_y, in_y) in macrocells(1, marked(1, y)) {
                            for (at_x, in_x) in macrocells(0, marked(0, x0 + place)) {
                                marks[at_x + at_y + at_z] |= in_x & in_y & in_z;
                            }
                        }
                    }
                }
            }
        }
        Ok(marks)
    }

    /// Fills rows of the texture, from row `first` on, all zeros so far.
    fn fill_rows<V: Copy>(
        &self,
        first: usize,
        voxels: &mut [V],
        bricks: &[Held<'_>],
        packed: &impl Fn(&SplatRun<'_>) -> [V; LANES],
    ) {
        let [across, down, deep] = self.dims.map(|n| n as usize);
        let row = 2 * self.size[0] as usize;
        let column = 2 * (self.row_texels + MARGIN) as usize;
        let (columns, shelf) = (self.columns as usize, down + 1);
        let end = first + voxels.len() / row;
        // The rows may belong to several shelves.
        for number in first / shelf..end.div_ceil(shelf) {
            let top = number * shelf + 1;
            let (b_low, b_high) = (first.saturating_sub(top).min(down), end.saturating_sub(top).min(down));
            let (m_low, m_high) = (number * columns, ((number + 1) * columns).min(deep));
            if b_low >= b_high || m_low >= m_high {
                continue;
            }
            // The box of the lattice in these rows, and the distances of neighbours along its axes.
            let low = unordered(self.axes, [0, b_low, m_low].map(|n| n as u32));
            let high = unordered(self.axes, [across, b_high, m_high].map(|n| n as u32));
            let steps = unordered(self.axes, [1, row as u32, column as u32]).map(|n| n as usize);
            let start = (top + b_low - first) * row + 2 * MARGIN as usize;
            let corner = unordered(self.axes, self.low);
            for (brick, held) in bricks {
                let [from, to] = [low, high].map(|end| [0, 1, 2].map(|axis| end[axis] + corner[axis]));
                let Some((mask, ys, zs)) = part(brick, from, to) else { continue };
                let [x0, y0, z0] = brick.origin;
                for z in zs {
                    for y in ys.clone() {
                        let row = (y - y0) as usize + EDGE * (z - z0) as usize;
                        let at = |axis: usize, place: u32| (place - low[axis] - corner[axis]) as usize * steps[axis];
                        let line = start + at(1, y) + at(2, z);
                        for (run, count) in held.runs(row, mask, [x0, y, z]) {
                            for (x, voxel) in run.xs.into_iter().zip(packed(&run)).take(count) {
                                voxels[line + at(0, x)] = voxel;
                            }
                        }
                    }
                }
            }
        }
    }
}
