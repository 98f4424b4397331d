//! Occluders of light on a box of the lattice, and the box seen as planes across the main axis of a direction.

use std::ops::Range;
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Zeroable;
use rayon::prelude::*;
use voxsplat_volume::memory::zeroed;

use crate::error::Result;

/// Number of voxels of a row that are summed together.
pub(super) const LANES: usize = 32;

/// The extinction of an occluder that is lit but casts no shadow.
pub(crate) const CLIPPED: f32 = 1e-30;

/// Extinctions in a box, x fastest, with zeros at both ends of a row.
pub(super) struct ExtinctionBox {
    /// Numbers of voxels along x, y and z.
    pub(super) size: [usize; 3],
    /// The number of zeros at either end of a row.
    pad: usize,
    values: Vec<f32>,
    /// The columns between the first and the last that are not 0, for each row, y before z.
    filled: Vec<Range<u32>>,
    /// A bit for each block of columns that are not all 0, in a number for each row.
    blocks: Vec<u64>,
    spare: Arc<Spare>,
}

/// The light that arrives at the voxels of a field, 65535 for all of it.
pub(super) struct Shares {
    pub(super) values: Vec<AtomicU16>,
    spare: Arc<Spare>,
}

/// The memory of dropped fields and light, kept for later ones: to get it from the system again costs as much as a
/// sweep.
#[derive(Default)]
pub(super) struct Spare {
    fields: Mutex<Vec<Vec<f32>>>,
    shares: Mutex<Vec<Vec<AtomicU16>>>,
}

/// Returns `count` numbers of spare memory, if there is enough.
fn spared<T: Zeroable>(spare: &Mutex<Vec<Vec<T>>>, count: usize) -> Option<Vec<T>> {
    let mut spare = spare.lock().unwrap_or_else(PoisonError::into_inner);
    let fit = spare.iter().position(|values| values.capacity() >= count)?;
    let mut values = spare.swap_remove(fit);
    values.resize_with(count, T::zeroed);
    Some(values)
}

/// Writes zeros. A page of the system that is read before it is written is mapped twice, the second time on all cores.
fn clear<T: Zeroable + Send>(values: &mut [T]) {
    values.par_chunks_mut(1 << 16).for_each(|values| values.fill_with(T::zeroed));
}

/// Returns the memory of `values` to the spare memory.
fn give_back<T>(spare: &Mutex<Vec<Vec<T>>>, values: &mut Vec<T>) {
    spare.lock().unwrap_or_else(PoisonError::into_inner).push(std::mem::take(values));
}

impl Drop for ExtinctionBox {
    fn drop(&mut self) {
        give_back(&self.spare.fields, &mut self.values);
    }
}

impl Drop for Shares {
    fn drop(&mut self) {
        give_back(&self.spare.shares, &mut self.values);
    }
}

/// The rows of a field as planes across an axis other than x.
#[derive(Clone, Copy)]
pub(super) struct RowPlanes {
    pub(super) planes: usize,
    /// The number of rows of a plane.
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Whether the first rows of all planes come first, in place of all rows of the first plane.
    is_inner: bool,
}

impl RowPlanes {
    /// Returns the planes of a box across y (1) or z (2).
    pub(super) fn across(axis: usize, [columns, ny, nz]: [usize; 3]) -> Self {
        if axis == 1 {
            Self { planes: ny, rows: nz, columns, is_inner: true }
        } else {
            Self { planes: nz, rows: ny, columns, is_inner: false }
        }
    }

    /// Returns the number in the field of a row of a plane.
    pub(super) fn row(&self, plane: usize, row: usize) -> usize {
        if self.is_inner { plane + row * self.planes } else { row + plane * self.rows }
    }

    /// Returns the plane of a row of the field, and the row's number in it.
    fn place(&self, number: usize) -> [usize; 2] {
        if self.is_inner {
            [number % self.planes, number / self.planes]
        } else {
            [number / self.rows, number % self.rows]
        }
    }

    /// Returns the number of the row that lies `planes` and `rows` beside a row, if there is one.
    pub(super) fn beside(&self, [plane, row]: [usize; 2], [planes, rows]: [i32; 2]) -> Option<usize> {
        let plane = plane.checked_add_signed(planes as isize).filter(|&plane| plane < self.planes)?;
        let row = row.checked_add_signed(rows as isize).filter(|&row| row < self.rows)?;
        Some(self.row(plane, row))
    }

    /// Splits an array into its rows, each with its number in the plane: plane by plane.
    pub(super) fn split<'a, T>(&self, values: &'a mut [T], pitch: usize) -> Vec<Vec<(usize, &'a mut [T])>> {
        let mut planes: Vec<Vec<(usize, &'a mut [T])>> = (0..self.planes).map(|_| Vec::new()).collect();
        for (number, row) in values.chunks_exact_mut(pitch).enumerate() {
            let [plane, number] = self.place(number);
            planes[plane].push((number, row));
        }
        planes
    }
}

impl ExtinctionBox {
    /// Allocates an empty field in spare memory, or in new.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) if 4 bytes for each voxel cannot be allocated.
    pub(super) fn new(spare: &Arc<Spare>, size: [usize; 3], pad: usize) -> Result<Self> {
        let count = (size[0] + 2 * pad) * size[1] * size[2];
        let values = match spared(&spare.fields, count) {
            Some(mut values) => {
                clear(&mut values);
                values
            }
            None => zeroed(count as u64, || "the occluders of light".to_owned())?,
        };
        let filled = vec![0..0; size[1] * size[2]];
        let blocks = vec![0; size[1] * size[2]];
        Ok(Self { size, pad, values, filled, blocks, spare: Arc::clone(spare) })
    }

    /// Allocates shares without light at any voxel.
    pub(super) fn dark(&self) -> Result<Shares> {
        let count = self.size.iter().product();
        let mut values = match spared(&self.spare.shares, count) {
            Some(values) => values,
            None => zeroed(count as u64, || "the light in the volume".to_owned())?,
        };
        clear(&mut values);
        Ok(Shares { values, spare: Arc::clone(&self.spare) })
    }

    fn pitch(&self) -> usize {
        self.size[0] + 2 * self.pad
    }

    /// Calls `fill` to write the rows, given their y and z, except for a margin around all.
    pub(super) fn fill(&mut self, margin: usize, fill: impl Fn([usize; 2], &mut [f32]) + Sync) {
        let ([nx, ny, nz], pitch, pad, block) = (self.size, self.pitch(), self.pad, self.block());
        let within = |n: usize, count: usize| n >= margin && n + margin < count;
        let rows = self.values.par_chunks_mut(pitch).zip(&mut self.filled).zip(&mut self.blocks).enumerate();
        let rows = rows.map(|(row, of)| ([row % ny, row / ny], of));
        let rows = rows.filter(|([y, z], _)| within(*y, ny) && within(*z, nz));
        rows.for_each_init(
            || vec![0.0; nx],
            |line, ([y, z], ((row, filled), blocks))| {
                line.fill(0.0);
                fill([y, z], &mut line[margin..nx - margin]);
                let first = line.iter().position(|value| *value > 0.0).unwrap_or(0);
                let end = line.iter().rposition(|value| *value > 0.0).map_or(0, |last| last + 1);
                if first < end {
                    row.fill(0.0);
                    row[pad..pad + nx].copy_from_slice(line);
                    *filled = first as u32..end as u32;
                    *blocks = bits(line, block);
                }
            },
        );
    }

    /// Returns the columns of a row between the first and the last that are not 0.
    pub(super) fn filled(&self, row: usize) -> Range<usize> {
        let Range { start, end } = self.filled[row];
        start as usize..end as usize
    }

    /// Returns the number of columns of a block.
    fn block(&self) -> usize {
        self.size[0].div_ceil(64).max(LANES)
    }

    /// Returns the runs of blocks of columns that are not all 0 in some of `rows`, in ascending order.
    pub(super) fn runs(&self, rows: impl Iterator<Item = usize>) -> impl Iterator<Item = Range<usize>> {
        let (block, columns) = (self.block(), self.size[0]);
        let mut bits = rows.fold(0, |bits, row| bits | self.blocks[row]);
        std::iter::from_fn(move || {
            let first = bits.trailing_zeros();
            let count = bits.checked_shr(first)?.trailing_ones();
            bits &= bits.checked_shr(first + count).map_or(0, |_| u64::MAX << (first + count));
            Some(first as usize * block..((first + count) as usize * block).min(columns))
        })
    }

    /// Returns a row from a column on, which may lie outside by the padding.
    pub(super) fn from(&self, row: usize, column: isize) -> &[f32] {
        let start = (row * self.pitch() + self.pad).wrapping_add_signed(column);
        &self.values[start..(row + 1) * self.pitch()]
    }

    /// Returns the field with y, z and x in place of x, y and z: rows along y, in planes across x.
    pub(super) fn turned(&self) -> Result<Self> {
        /// The number of planes that are read together, from one cache line.
        const TOGETHER: usize = 16;
        let [nx, ny, nz] = self.size;
        let mut turned = Self::new(&self.spare, [ny, nz, nx], self.pad)?;
        let (pitch, block) = (turned.pitch(), turned.block());
        let planes = turned.values.par_chunks_mut(TOGETHER * nz * pitch);
        let filled = turned.filled.par_chunks_mut(TOGETHER * nz);
        let blocks = turned.blocks.par_chunks_mut(TOGETHER * nz);
        planes.zip(filled).zip(blocks).enumerate().for_each(|(number, ((values, filled), blocks))| {
            let first = number * TOGETHER;
            let count = TOGETHER.min(nx - first);
            for (z, y) in (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))) {
                let row = y + ny * z;
                let of = self.filled(row);
                if of.end <= first || of.start >= first + count {
                    continue;
                }
                for (i, &value) in self.from(row, first as isize)[..count].iter().enumerate() {
                    if value > 0.0 {
                        let at = z + nz * i;
                        values[at * pitch + self.pad + y] = value;
                        blocks[at] |= 1 << (y / block);
                        let (filled, y) = (&mut filled[at], y as u32);
                        *filled = if filled.start == filled.end { y..y + 1 } else { filled.start..y + 1 };
                    }
                }
            }
        });
        Ok(turned)
    }

    /// Filters the field with symmetric weights, the middle one first: across planes, and within planes along both
    /// axes.
    pub(super) fn filtered(&self, planes: RowPlanes, [across, within]: [&[f32]; 2]) -> Result<Self> {
        let mut filtered = Self::new(&self.spare, self.size, self.pad)?;
        let block = self.block();
        let (pitch, reach) = (self.pitch(), within.len() - 1);
        let near = |at: usize, offset: isize, count: usize| at.checked_add_signed(offset).filter(|&n| n < count);
        let offsets = |weights: &[f32]| {
            let reach = weights.len() as isize - 1;
            (-reach..=reach).map(|o| (o, weights[o.unsigned_abs()])).collect::<Vec<_>>()
        };
        let (across, within) = (offsets(across), offsets(within));
        let rows = planes.split(&mut filtered.values, pitch);
        let ranges = rows.into_par_iter().enumerate().map_init(
            || [vec![0.0; planes.rows * pitch], vec![0.0; pitch]],
            |[plane_sum, row_sum], (plane, rows)| {
                let mut found = vec![0..0; planes.rows];
                for (row, range) in found.iter_mut().enumerate() {
                    let sum = &mut plane_sum[row * pitch..][..pitch];
                    let sources = || {
                        across.iter().filter_map(|&(o, w)| Some((planes.row(near(plane, o, planes.planes)?, row), w)))
                    };
                    *range = sources().fold(0..0, |range, (source, _)| hull(range, self.filled(source)));
                    if range.start == range.end {
                        continue;
                    }
                    // The ends, which the filter within planes reads, may hold another plane.
                    sum.fill(0.0);
                    for (source, weight) in sources() {
                        add(
                            &mut sum[self.pad + range.start..self.pad + range.end],
                            self.from(source, range.start as isize),
                            weight,
                        );
                    }
                }
                rows.into_iter()
                    .map(|(row, out)| {
                        let sources = || within.iter().filter_map(|&(o, w)| Some((near(row, o, planes.rows)?, w)));
                        let range = sources().fold(0..0, |range, (source, _)| hull(range, found[source].clone()));
                        if range.is_empty() {
                            return (planes.row(plane, row), 0..0, 0);
                        }
                        let wide = range.start.saturating_sub(reach)..(range.end + reach).min(self.size[0]);
                        row_sum.fill(0.0);
                        for (source, weight) in sources().filter(|(source, _)| !found[*source].is_empty()) {
                            let from = &plane_sum[source * pitch..][self.pad + range.start..];
                            add(&mut row_sum[self.pad + range.start..self.pad + range.end], from, weight);
                        }
                        out.fill(0.0);
                        let sum = &mut out[self.pad + wide.start..self.pad + wide.end];
                        for &(o, weight) in &within {
                            add(sum, &row_sum[(self.pad + wide.start).wrapping_add_signed(o)..], weight);
                        }
                        let bits = bits(&out[self.pad..self.pad + self.size[0]], block);
                        (planes.row(plane, row), wide.start as u32..wide.end as u32, bits)
                    })
                    .collect::<Vec<_>>()
            },
        );
        let ranges: Vec<_> = ranges.collect();
        for (row, range, bits) in ranges.into_iter().flatten() {
            (filtered.filled[row], filtered.blocks[row]) = (range, bits);
        }
        Ok(filtered)
    }
}

/// Returns a bit for each block of a row: 1 unless the block is all 0.
fn bits(row: &[f32], block: usize) -> u64 {
    // A sum has no branches, so it is a vector.
    let is_filled = |block: &[f32]| block.iter().map(|value| u32::from(*value != 0.0)).sum::<u32>() > 0;
    row.chunks(block).enumerate().fold(0, |bits, (i, block)| bits | u64::from(is_filled(block)) << i)
}

/// Adds a row times `weight` to a sum.
fn add(sum: &mut [f32], row: &[f32], weight: f32) {
    sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
}

/// Returns the smallest range that contains two ranges.
pub(super) fn hull(a: Range<usize>, b: Range<usize>) -> Range<usize> {
    match (a.is_empty(), b.is_empty()) {
        (true, _) => b,
        (_, true) => a,
        _ => a.start.min(b.start)..a.end.max(b.end),
    }
}

/// Adds planes across x, with rows along y as [`ExtinctionBox::turned`] makes them, to rows along x.
pub(super) fn turned_back(turned: &[AtomicU16], [nx, ny, nz]: [usize; 3], out: &[AtomicU16]) {
    /// The number of rows that are written together.
    const TOGETHER: usize = 32;
    out.par_chunks(nx * ny).enumerate().for_each(|(z, plane)| {
        for first in (0..ny).step_by(TOGETHER) {
            for x in 0..nx {
                let from = &turned[ny * (z + nz * x)..][first..ny.min(first + TOGETHER)];
                for (y, value) in (first..).zip(from) {
                    let out = &plane[x + nx * y];
                    let sum = out.load(Ordering::Relaxed).saturating_add(value.load(Ordering::Relaxed));
                    out.store(sum, Ordering::Relaxed);
                }
            }
        }
    });
}
