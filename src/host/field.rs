//! A field of scalars as coefficients of cubic B-splines.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use voxsplat_volume::memory::zeroed;

use super::filter::{Around, MAX_REACH, RowFilter, add_rows};
use super::lanes::{WIDTH, dispatch};
use super::lattice::{CELL, Padded};
use crate::error::Result;
use crate::kernel::{Kernel, SplineFilter};
use crate::progress::Progress;

/// The least number of coefficients beyond each face of the lattice, where the samples at the face repeat. Rays reach
/// half a voxel beyond; a sample there reads 4 coefficients on either side.
const PAD: usize = 8;

/// Returns the number of coefficients beyond each face of the fields of kernels that are blended: as far as voxels,
/// filters and splines reach.
pub(super) fn padding(kernels: &[Kernel]) -> usize {
    let reach = kernels.iter().map(|kernel| kernel.radius().ceil() as usize + 1).max().unwrap_or_default();
    PAD.max(reach + 4)
}

/// Number of planes of coefficients that a thread makes at a time. It reads a few planes of samples more on either
/// side.
const PLANES: usize = 16;

/// Returns the number of coefficients of a lattice, with those beyond its faces.
pub(super) fn count(dims: [u32; 3], pad: usize) -> u64 {
    dims.map(|d| u64::from(d) + 2 * pad as u64).iter().product()
}

/// The coefficients of a field of scalars over a lattice.
pub(super) struct Field {
    pub(super) lattice: Padded,
    coefficients: Vec<f32>,
    /// The range of the coefficients of each cell.
    ranges: Vec<[f32; 2]>,
}

impl Field {
    /// Filters the scalars of the part of a lattice of `dims` points from point `first` on; `planes` returns the
    /// scalars of a range of planes.
    ///
    /// # Errors
    /// The errors of `planes`, and [`Error::Memory`](crate::Error::Memory) if 4 bytes for each coefficient cannot be
    /// allocated.
    pub(super) fn new(
        (dims, first): ([usize; 3], [isize; 3]),
        planes: &(dyn Fn(Range<usize>) -> Result<Vec<f32>> + Sync),
        filter: &SplineFilter,
        pad: usize,
        progress: &Progress,
    ) -> Result<Self> {
        let lattice = Padded::new(dims, pad, first);
        let plane = lattice.area();
        let mut coefficients: Vec<f32> = zeroed(lattice.count() as u64, || "the coefficients of a volume".to_owned())?;
        let filter = &RowFilter::new(filter);
        let (done, all) = (AtomicUsize::new(0), lattice.size[2].div_ceil(PLANES));
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
            dispatch(Filtering { filter, dims, lattice, scalars: &scalars, low, first, coefficients });
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            progress.report("filtering", done as f64 / all as f64);
            Ok::<_, crate::error::Error>(())
        })?;
        Ok(Self { ranges: ranges(&lattice, &coefficients), lattice, coefficients })
    }

    /// Returns the bytes of memory of the field.
    pub(super) fn bytes(&self) -> u64 {
        size_of_val(self.coefficients.as_slice()) as u64
    }

    /// Returns the coefficients, x fastest.
    pub(super) fn coefficients(&self) -> &[f32] {
        &self.coefficients
    }

    /// Returns whether `holds` accepts the range of the coefficients of any cell that meets a box, ends included. The
    /// field at a point is within the ranges of the four coefficients around it along each axis.
    #[inline]
    pub(super) fn any(&self, low: [isize; 3], high: [isize; 3], holds: impl Fn([f32; 2]) -> bool) -> bool {
        self.lattice.any(&self.ranges, low, high, |range| holds(*range))
    }
}

/// The filter of a slab of planes.
struct Filtering<'a> {
    filter: &'a RowFilter,
    dims: [usize; 3],
    lattice: Padded,
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
        let Self { filter, dims: [nx, ny, nz], lattice, scalars, low, first, coefficients } = self;
        let (pad, padded) = (lattice.pad, lattice.size);
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

/// Returns the ranges of the coefficients of cells, x fastest.
fn ranges(lattice: &Padded, coefficients: &[f32]) -> Vec<[f32; 2]> {
    let (size, cells) = (lattice.size, lattice.cells());
    let mut ranges = vec![[f32::INFINITY, f32::NEG_INFINITY]; cells.iter().product()];
    let planes = ranges.par_chunks_mut(cells[0] * cells[1]);
    let slabs = coefficients.par_chunks(CELL * lattice.area());
    planes.zip(slabs).for_each(|(ranges, slab)| {
        for (number, row) in slab.chunks_exact(size[0]).enumerate() {
            let y = number % size[1] / CELL;
            for (range, cell) in ranges[y * cells[0]..].iter_mut().zip(row.chunks(CELL)) {
                let [low, high] = *range;
                *range = [cell.iter().copied().fold(low, f32::min), cell.iter().copied().fold(high, f32::max)];
            }
        }
    });
    ranges
}
