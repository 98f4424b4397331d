//! A field of scalars as coefficients of cubic B-splines.

use std::ops::Range;

use rayon::prelude::*;

use super::filter::{Coefficients, RowSource, SampleRow, filtered};
use super::lattice::{CELL, CELL_POINTS, Padded};
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

/// Returns the number of coefficients of a lattice, with those beyond its faces.
pub(super) fn count(dims: [u32; 3], pad: usize) -> u64 {
    dims.map(|d| (u64::from(d) + 2 * pad as u64).next_multiple_of(CELL as u64)).iter().product()
}

/// The coefficients of a field of scalars over a lattice.
pub(super) struct Field {
    pub(super) lattice: Padded,
    coefficients: Coefficients<f32>,
    /// The range of the coefficients of each cell.
    ranges: Vec<[f32; 2]>,
}

/// A callback that returns the scalars of a range of planes.
pub(super) type ReadPlanes<'a> = dyn Fn(Range<usize>) -> Result<Vec<f32>> + Sync + 'a;

/// The scalars of a lattice, which repeat beyond its faces.
struct RepeatedScalars<'a> {
    dims: [usize; 3],
    planes: &'a ReadPlanes<'a>,
}

impl RowSource<1> for RepeatedScalars<'_> {
    /// The scalars of planes, and the number of the first plane.
    type Slab = (Vec<f32>, usize);

    fn slab(&self, planes: Range<isize>) -> Result<Self::Slab> {
        let [first, last] = [planes.start, planes.end - 1].map(|z| z.clamp(0, self.dims[2] as isize - 1) as usize);
        Ok(((self.planes)(first..last + 1)?, first))
    }

    fn row(&self, (scalars, first): &Self::Slab, [y, z]: [isize; 2], out: &mut SampleRow<1>) {
        let [nx, ny, nz] = self.dims;
        let [y, z] = [(y, ny), (z, nz)].map(|(point, count)| point.clamp(0, count as isize - 1) as usize);
        out.repeat(&scalars[nx * (y + ny * (z - first))..][..nx]);
    }
}

impl Field {
    /// Filters the scalars of the part of a lattice of `dims` points from point `first` on by several filters, with
    /// `pad` coefficients beyond each face. Reuses the memory of `spare`.
    ///
    /// # Errors
    /// The errors of `planes`, and [`Error::Memory`](crate::Error::Memory) if 4 bytes for each coefficient cannot be
    /// allocated.
    pub(super) fn new(
        (dims, first, pad): ([usize; 3], [isize; 3], usize),
        filters: &[SplineFilter],
        planes: &ReadPlanes<'_>,
        spare: Vec<Self>,
        progress: &Progress,
    ) -> Result<Vec<Self>> {
        let lattice = Padded::new(dims, pad, first);
        let spare = spare.into_iter().map(|field| field.coefficients).collect();
        let fields = filtered(&lattice, filters, &RepeatedScalars { dims, planes }, (spare, None), progress)?;
        let range = |cell: &[f32]| {
            let [low, high] = [f32::min, f32::max].map(|extreme| cell[1..].iter().copied().fold(cell[0], extreme));
            [low, high]
        };
        let field = |coefficients: Coefficients<f32>| {
            let ranges = coefficients.values.par_chunks_exact(CELL_POINTS).map(range).collect();
            Self { lattice, coefficients, ranges }
        };
        Ok(fields.into_iter().map(field).collect())
    }

    /// Returns the bytes of memory of the field.
    pub(super) fn bytes(&self) -> u64 {
        size_of_val(self.coefficients.values.as_slice()) as u64
    }

    /// Returns the coefficients, in the order of [`Padded`].
    pub(super) fn coefficients(&self) -> &[f32] {
        &self.coefficients.values
    }

    /// Returns whether `holds` accepts the range of the coefficients of any cell that meets a box, ends included. The
    /// field at a point is within the ranges of the four coefficients around it along each axis.
    #[inline]
    pub(super) fn any(&self, low: [isize; 3], high: [isize; 3], holds: impl Fn([f32; 2]) -> bool) -> bool {
        self.lattice.any(&self.ranges, low, high, |range| holds(*range))
    }
}
