//! The filter from samples to coefficients of splines, row by row.

use pulp::Simd;

use super::lanes::{WIDTH, load};
use crate::kernel::SplineFilter;

/// The largest reach of a filter.
pub(super) const MAX_REACH: usize = 8;
const ROWS: usize = 2 * MAX_REACH + 1;

/// The weights of a filter, by the distance across rows and along them.
pub(super) struct RowFilter {
    pub(super) reach: usize,
    /// The weights by the larger and the smaller distance of a row along both axes across it, then by the distance
    /// along it.
    weights: [[[f32; MAX_REACH + 1]; MAX_REACH + 1]; MAX_REACH + 1],
}

/// The rows around a row: for the planes at each distance, both planes added up, the rows from `reach` before it on.
pub(super) type Around<'a> = [[&'a [f32]; ROWS]; MAX_REACH + 1];

impl RowFilter {
    pub(super) fn new(filter: &SplineFilter) -> Self {
        let reach = filter.reach();
        let mut weights = [[[0.0; MAX_REACH + 1]; MAX_REACH + 1]; MAX_REACH + 1];
        for high in 0..=reach {
            for low in 0..=high {
                for along in 0..=reach {
                    weights[high][low][along] = filter.weight([along, low, high]) as f32;
                }
            }
        }
        Self { reach, weights }
    }

    /// Filters a row: `out` gets a coefficient for each number of the rows but the outermost, as many as the reach on
    /// either side. Rows have room for a vector beyond their end, and so has `sums`, which has rows for each distance.
    #[inline(always)]
    pub(super) fn apply<S: Simd>(&self, simd: S, rows: &Around<'_>, sums: &mut [f32], out: &mut [f32]) {
        match self.reach {
            ..=2 => self.filtered::<S, 2>(simd, rows, sums, out),
            3 => self.filtered::<S, 3>(simd, rows, sums, out),
            4 => self.filtered::<S, 4>(simd, rows, sums, out),
            5 | 6 => self.filtered::<S, 6>(simd, rows, sums, out),
            _ => self.filtered::<S, MAX_REACH>(simd, rows, sums, out),
        }
    }

    #[inline(always)]
    fn filtered<S: Simd, const REACH: usize>(&self, simd: S, rows: &Around<'_>, sums: &mut [f32], out: &mut [f32]) {
        let count = out.len() + 2 * REACH;
        let stride = count.next_multiple_of(WIDTH);
        // Rows at distances that are alike are added up, and get the weights of each distance along the row.
        for x in (0..count).step_by(WIDTH) {
            let mut along = [simd.splat_f32s(0.0); MAX_REACH + 1];
            for high in 0..=REACH {
                for low in 0..=high {
                    let mut sum = load(simd, &rows[high][REACH + low][x..]);
                    if low > 0 {
                        sum = simd.add_f32s(sum, load(simd, &rows[high][REACH - low][x..]));
                    }
                    if high > low {
                        sum = simd.add_f32s(sum, load(simd, &rows[low][REACH + high][x..]));
                        sum = simd.add_f32s(sum, load(simd, &rows[low][REACH - high][x..]));
                    }
                    for distance in 0..=REACH {
                        let weight = simd.splat_f32s(self.weights[high][low][distance]);
                        along[distance] = simd.mul_add_f32s(weight, sum, along[distance]);
                    }
                }
            }
            for distance in 0..=REACH {
                let (vectors, _) = S::as_mut_simd_f32s(&mut sums[distance * stride + x..][..WIDTH]);
                vectors[0] = along[distance];
            }
        }
        let sums = &sums[..(REACH + 1) * stride];
        out.copy_from_slice(&sums[REACH..][..out.len()]);
        for distance in 1..=REACH {
            let left = &sums[distance * stride + REACH - distance..][..out.len()];
            let right = &sums[distance * stride + REACH + distance..][..out.len()];
            for x in 0..out.len() {
                out[x] += left[x] + right[x];
            }
        }
    }
}

/// Adds up the rows of two planes.
#[inline(always)]
pub(super) fn add_rows(one: &[f32], other: &[f32], sums: &mut [f32]) {
    let count = sums.len();
    let (one, other) = (&one[..count], &other[..count]);
    for x in 0..count {
        sums[x] = one[x] + other[x];
    }
}
