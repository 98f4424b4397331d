//! A field of scalars as coefficients of cubic B-splines.

use std::ops::Range;

use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use voxsplat_volume::memory::zeroed;

use super::filter::{Around, MAX_REACH, RowFilter, add_rows};
use super::lanes::{WIDTH, dispatch};
use crate::error::Result;
use crate::kernel::{Kernel, SplineFilter};
use crate::progress::Progress;

/// The least number of coefficients beyond each face of the lattice, where the samples at the face repeat. Rays reach
/// half a voxel beyond; a sample there reads 4 coefficients on either side.
const PAD: usize = 8;

/// The coefficients beyond each face of the fields of kernels that are blended: as far as voxels, filters and splines
/// reach.
pub(super) fn padding(kernels: &[Kernel]) -> usize {
    let reach = kernels.iter().map(|kernel| kernel.radius().ceil() as usize + 1).max().unwrap_or_default();
    PAD.max(reach + 4)
}

/// Planes of coefficients that a thread makes at a time. It reads a few planes of samples more on either side.
const PLANES: usize = 16;

/// Lattice points along the edge of a cell.
pub(super) const CELL: usize = 8;

/// Bytes of the coefficients of a lattice, without growth.
pub(super) fn bytes(dims: [u32; 3]) -> u64 {
    4 * dims.map(|d| u64::from(d) + 2 * PAD as u64).iter().product::<u64>()
}

/// Coefficients over a lattice and some points around it, x fastest.
pub(super) struct Field {
    /// Points with coefficients.
    padded: [usize; 3],
    /// Coefficients beyond each face.
    pad: usize,
    coefficients: Vec<f32>,
    ranges: Ranges,
}

impl Field {
    /// Filters scalars, of which `planes` returns those of a range of planes.
    ///
    /// # Errors
    /// The errors of `planes`, and [`Error::Memory`](crate::Error::Memory) if 4 bytes for each coefficient cannot be
    /// allocated.
    pub(super) fn new(
        dims: [usize; 3],
        planes: &(dyn Fn(Range<usize>) -> Result<Vec<f32>> + Sync),
        filter: &SplineFilter,
        pad: usize,
        progress: &Progress,
    ) -> Result<Self> {
        let padded = dims.map(|d| d + 2 * pad);
        let plane = padded[0] * padded[1];
        let count = plane * padded[2];
        let mut coefficients: Vec<f32> = zeroed(count as u64, || "the coefficients of a volume".to_owned())?;
        let filter = &RowFilter::new(filter);
        let slabs = coefficients.par_chunks_mut(PLANES * plane).enumerate();
        slabs.try_for_each(|(slab, coefficients)| {
            progress.check()?;
            let source = |z: usize| (z as isize - pad as isize).clamp(0, dims[2] as isize - 1) as usize;
            let count = coefficients.len() / plane;
            let first = slab * PLANES;
            // Beyond the faces all planes are the plane at the face.
            let low = (source(first) as isize - filter.reach as isize).max(0) as usize;
            let high = (source(first + count - 1) + filter.reach).min(dims[2] - 1);
            let scalars = planes(low..high + 1)?;
            dispatch(Filtering { filter, dims, padded, pad, scalars: &scalars, low, first, coefficients });
            Ok::<_, crate::error::Error>(())
        })?;
        let ranges = Ranges::new(padded, pad, &coefficients);
        Ok(Self { padded, pad, coefficients, ranges })
    }

    /// Bytes of memory.
    pub(super) fn bytes(&self) -> u64 {
        size_of_val(self.coefficients.as_slice()) as u64
    }

    /// The distances of neighbouring coefficients along the axes.
    pub(super) fn steps(&self) -> [usize; 3] {
        [1, self.padded[0], self.padded[0] * self.padded[1]]
    }

    /// The coefficients, x fastest.
    pub(super) fn coefficients(&self) -> &[f32] {
        &self.coefficients
    }

    /// The place of the coefficient of a lattice point. Points farther than all coefficients count as the farthest.
    pub(super) fn index(&self, point: [isize; 3]) -> usize {
        let steps = self.steps();
        let place = |axis: usize| (point[axis] + self.pad as isize).clamp(0, self.padded[axis] as isize - 1) as usize;
        (0..3).map(|axis| place(axis) * steps[axis]).sum()
    }

    /// The range of the coefficients in a box, ends included. The field at a point is within the range of the four
    /// coefficients around it along each axis.
    pub(super) fn range(&self, low: [isize; 3], high: [isize; 3]) -> [f32; 2] {
        self.ranges.over(low, high)
    }
}

/// The filter of a slab of planes.
struct Filtering<'a> {
    filter: &'a RowFilter,
    dims: [usize; 3],
    padded: [usize; 3],
    pad: usize,
    /// Planes of scalars from plane `low` on.
    scalars: &'a [f32],
    low: usize,
    /// The first padded plane.
    first: usize,
    coefficients: &'a mut [f32],
}

impl WithSimd for Filtering<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { filter, dims: [nx, ny, nz], padded, pad, scalars, low, first, coefficients } = self;
        let reach = filter.reach;
        // Rows repeat their ends, and have room for a vector more.
        let margin = pad + reach;
        let width = (nx + 2 * margin).next_multiple_of(WIDTH) + WIDTH;
        let mut planes = vec![0.0_f32; (reach + 1) * ny * width];
        let mut sums = vec![0.0_f32; (MAX_REACH + 1) * (width + WIDTH)];
        for (number, plane) in coefficients.chunks_exact_mut(padded[0] * padded[1]).enumerate() {
            let z = (first + number) as isize - pad as isize;
            // Beyond the faces all planes are alike.
            let source = |z: isize| z.clamp(0, nz as isize - 1) as usize - low;
            for k in 0..=reach as isize {
                let [before, behind] = [source(z - k), source(z + k)];
                for y in 0..ny {
                    let row = &mut planes[(k as usize * ny + y) * width..][..width];
                    let inner = &mut row[margin..margin + nx];
                    if k == 0 {
                        inner.copy_from_slice(&scalars[nx * (y + ny * before)..][..nx]);
                    } else {
                        add_rows(&scalars[nx * (y + ny * before)..], &scalars[nx * (y + ny * behind)..], inner);
                    }
                    let (first, last) = (row[margin], row[margin + nx - 1]);
                    row[..margin].fill(first);
                    row[margin + nx..].fill(last);
                }
            }
            for (y, row) in plane.chunks_exact_mut(padded[0]).enumerate() {
                let y = y as isize - pad as isize;
                let mut around: Around<'_> = Default::default();
                for (k, around) in around.iter_mut().take(reach + 1).enumerate() {
                    for (j, place) in around.iter_mut().take(2 * reach + 1).enumerate() {
                        let y = (y + j as isize - reach as isize).clamp(0, ny as isize - 1) as usize;
                        *place = &planes[(k * ny + y) * width..][..width];
                    }
                }
                filter.apply(simd, &around, &mut sums, row);
            }
        }
    }
}

/// The range of coefficients over cells.
struct Ranges {
    pad: usize,
    cells: [usize; 3],
    ranges: Vec<[f32; 2]>,
}

impl Ranges {
    fn new(padded: [usize; 3], pad: usize, coefficients: &[f32]) -> Self {
        let cells = padded.map(|d| d.div_ceil(CELL));
        let mut ranges = vec![[f32::INFINITY, f32::NEG_INFINITY]; cells.iter().product()];
        let planes = ranges.par_chunks_mut(cells[0] * cells[1]);
        let slabs = coefficients.par_chunks(CELL * padded[0] * padded[1]);
        planes.zip(slabs).for_each(|(ranges, slab)| {
            for (number, row) in slab.chunks_exact(padded[0]).enumerate() {
                let y = number % padded[1] / CELL;
                for (range, cell) in ranges[y * cells[0]..].iter_mut().zip(row.chunks(CELL)) {
                    let [low, high] = *range;
                    *range = [cell.iter().copied().fold(low, f32::min), cell.iter().copied().fold(high, f32::max)];
                }
            }
        });
        Self { pad, cells, ranges }
    }

    fn over(&self, low: [isize; 3], high: [isize; 3]) -> [f32; 2] {
        let (mut first, mut last) = ([0; 3], [0; 3]);
        for axis in 0..3 {
            first[axis] = ((low[axis] + self.pad as isize).max(0) as usize / CELL).min(self.cells[axis] - 1);
            last[axis] = ((high[axis] + self.pad as isize).max(0) as usize / CELL).min(self.cells[axis] - 1);
        }
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                let row = (z * self.cells[1] + y) * self.cells[0];
                for [low, high] in &self.ranges[row + first[0]..=row + last[0]] {
                    range = [range[0].min(*low), range[1].max(*high)];
                }
            }
        }
        range
    }
}
