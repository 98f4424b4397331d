//! A field of scalars as coefficients of cubic B-splines.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use voxsplat_volume::memory::reserved;

use super::lanes::dispatch;
use crate::error::Result;
use crate::kernel::SplineFilter;
use crate::progress::Progress;
use crate::transfer::scalars::Relative;
use crate::volume::{ToF64, Volume, with_samples};

/// Coefficients beyond each face of the lattice, where the samples at the face repeat. Rays reach half a voxel beyond;
/// a sample there reads 4 coefficients on either side.
pub(super) const PAD: usize = 8;

/// Planes of coefficients that a thread makes at a time. It reads a few planes of samples more on either side.
const PLANES: usize = 16;

/// Lattice points along the edge of a cell.
pub(super) const CELL: usize = 8;

/// Bytes of the coefficients of a lattice.
pub(super) fn bytes(dims: [u32; 3]) -> u64 {
    4 * dims.map(|d| u64::from(d) + 2 * PAD as u64).iter().product::<u64>()
}

/// Coefficients over a lattice and [`PAD`] points around it, x fastest.
pub(super) struct Field {
    /// Points of the lattice.
    pub(super) dims: [usize; 3],
    /// Points with coefficients.
    padded: [usize; 3],
    coefficients: Vec<f32>,
    ranges: Ranges,
}

impl Field {
    /// Reads a volume once.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the samples cannot be read, and [`Error::Memory`](crate::Error::Memory)
    /// if 4 bytes for each coefficient cannot be allocated.
    pub(super) fn new(
        volume: &Volume,
        relative: &Relative,
        filter: &SplineFilter,
        progress: &Progress,
    ) -> Result<Self> {
        let dims = volume.grid().dims().map(|d| d as usize);
        let padded = dims.map(|d| d + 2 * PAD);
        let plane = padded[0] * padded[1];
        let count = plane * padded[2];
        let mut coefficients: Vec<f32> = reserved(count as u64, || "the coefficients of a volume".to_owned())?;
        coefficients.resize(count, 0.0);
        let slabs = coefficients.par_chunks_mut(PLANES * plane).enumerate();
        slabs.try_for_each(|(slab, coefficients)| {
            progress.check()?;
            let source = |z: usize| (z as isize - PAD as isize).clamp(0, dims[2] as isize - 1) as usize;
            let planes = coefficients.len() / plane;
            let first = slab * PLANES;
            // Beyond the faces all planes are the plane at the face.
            let low = (source(first) as isize - filter.reach() as isize).max(0) as usize;
            let high = (source(first + planes - 1) + filter.reach()).min(dims[2] - 1);
            let area = dims[0] * dims[1];
            let samples = volume.read(low * area..(high + 1) * area)?;
            let scalars: Vec<f32> = with_samples!(&samples, s => s.iter().map(|v| relative.to(v.to_f64())).collect());
            dispatch(Filtering { filter, dims, padded, scalars: &scalars, low, first, coefficients });
            Ok::<_, crate::error::Error>(())
        })?;
        let ranges = Ranges::new(padded, &coefficients);
        Ok(Self { dims, padded, coefficients, ranges })
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

    /// The place of the coefficient of a lattice point. Points farther than the padding count as the farthest.
    pub(super) fn index(&self, point: [isize; 3]) -> usize {
        let steps = self.steps();
        let place = |axis: usize| (point[axis] + PAD as isize).clamp(0, self.padded[axis] as isize - 1) as usize;
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
    filter: &'a SplineFilter,
    dims: [usize; 3],
    padded: [usize; 3],
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
    fn with_simd<S: Simd>(self, _: S) {
        let Self { filter, dims: [nx, ny, nz], padded, scalars, low, first, coefficients } = self;
        let reach = filter.reach() as isize;
        let taps = filter.reach();
        // Rows at distances that are alike by symmetry are added up first.
        let weights = filter.row_groups();
        let margin = PAD + taps;
        let mut sums = vec![vec![0.0_f32; nx + 2 * margin]; weights.len()];
        for (number, plane) in coefficients.chunks_exact_mut(padded[0] * padded[1]).enumerate() {
            let z = (first + number) as isize - PAD as isize;
            for (y, row) in plane.chunks_exact_mut(padded[0]).enumerate() {
                let y = y as isize - PAD as isize;
                sums.iter_mut().for_each(|sum| sum.fill(0.0));
                for k in -reach..=reach {
                    let z = (z + k).clamp(0, nz as isize - 1) as usize - low;
                    for j in -reach..=reach {
                        let y = (y + j).clamp(0, ny as isize - 1) as usize;
                        let scalars = &scalars[nx * (y + ny * z)..][..nx];
                        let group = SplineFilter::row_group(j.unsigned_abs(), k.unsigned_abs());
                        let sum = &mut sums[group][margin..margin + nx];
                        for (sum, scalar) in sum.iter_mut().zip(scalars) {
                            *sum += scalar;
                        }
                    }
                }
                row.fill(0.0);
                for (sum, weights) in sums.iter_mut().zip(&weights) {
                    let (first, last) = (sum[margin], sum[margin + nx - 1]);
                    sum[..margin].fill(first);
                    sum[margin + nx..].fill(last);
                    let count = row.len();
                    let (middle, weight) = (&sum[taps..][..count], weights[0]);
                    for x in 0..count {
                        row[x] = weight.mul_add(middle[x], row[x]);
                    }
                    for i in 1..=taps {
                        let (left, right, weight) = (&sum[taps - i..][..count], &sum[taps + i..][..count], weights[i]);
                        for x in 0..count {
                            row[x] = weight.mul_add(left[x] + right[x], row[x]);
                        }
                    }
                }
            }
        }
    }
}

/// The range of coefficients over cells.
struct Ranges {
    cells: [usize; 3],
    ranges: Vec<[f32; 2]>,
}

impl Ranges {
    fn new(padded: [usize; 3], coefficients: &[f32]) -> Self {
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
        Self { cells, ranges }
    }

    fn over(&self, low: [isize; 3], high: [isize; 3]) -> [f32; 2] {
        let (mut first, mut last) = ([0; 3], [0; 3]);
        for axis in 0..3 {
            first[axis] = ((low[axis] + PAD as isize).max(0) as usize / CELL).min(self.cells[axis] - 1);
            last[axis] = ((high[axis] + PAD as isize).max(0) as usize / CELL).min(self.cells[axis] - 1);
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
