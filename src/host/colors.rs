//! Fields of colours times extinctions, and of extinctions, as coefficients of cubic B-splines.

use super::filter::{Coefficient, Coefficients, RowSource, filtered};
use super::lattice::{CELL, CELL_POINTS, Padded};
use super::plane::CHANNELS;
use crate::error::Result;
use crate::kernel::SplineFilter;
use crate::progress::Progress;

/// A coefficient: four f16.
pub(super) type Halves = [u16; CHANNELS];

/// Converts an f16 that is normal or 0 to f32.
#[inline(always)]
pub(super) fn from_half(half: u16) -> f32 {
    // The exponents of f32 are larger by 112.
    const FACTOR: f32 = f32::from_bits((112 + 127) << 23);
    let size = f32::from_bits(u32::from(half & 0x7fff) << 13) * FACTOR;
    f32::from_bits(size.to_bits() | u32::from(half & 0x8000) << 16)
}

/// Returns the f16 nearest to a number; numbers under the least normal f16 become 0, which loops decode faster.
#[inline(always)]
fn half(value: f32) -> u16 {
    const LEAST: u32 = (112 + 1) << 23;
    let (size, sign) = (value.to_bits() & 0x7fff_ffff, value.to_bits() >> 16 & 0x8000);
    let nearest = (size + 0x1000).wrapping_sub(112 << 23) >> 13 | sign;
    (if size < LEAST { 0 } else { nearest }) as u16
}

impl Coefficient<CHANNELS> for Halves {
    #[inline(always)]
    fn of(channels: [&[f32; CELL]; CHANNELS]) -> [Self; CELL] {
        let mut halves = [[0; CELL]; CHANNELS];
        for channel in 0..CHANNELS {
            for point in 0..CELL {
                halves[channel][point] = half(channels[channel][point]);
            }
        }
        let [r, g, b, a] = halves;
        let mut points = [[0; CHANNELS]; CELL];
        for point in 0..CELL {
            points[point] = [r[point], g[point], b[point], a[point]];
        }
        points
    }
}

/// Coefficients over a lattice. Voxels beyond it are empty.
pub(super) struct ColorField {
    pub(super) lattice: Padded,
    coefficients: Coefficients<Halves>,
    /// The reach of the filter, in voxels.
    filter_reach: usize,
}

impl ColorField {
    /// Filters the voxels of a lattice by several filters, each where its field serves; without `served` everywhere.
    /// Reuses the memory of `spare`.
    ///
    /// # Errors
    /// The errors of `rows`, and [`Error::Memory`](crate::Error::Memory) if the coefficients cannot be allocated.
    pub(super) fn new(
        lattice: Padded,
        filters: &[SplineFilter],
        rows: &impl RowSource<CHANNELS>,
        (spare, served): (Vec<Self>, Option<&[Vec<bool>]>),
        progress: &Progress,
    ) -> Result<Vec<Self>> {
        let spare = spare.into_iter().map(|field| field.coefficients).collect();
        let fields = filtered(&lattice, filters, rows, (spare, served), progress)?;
        let field =
            |(coefficients, filter): (_, &SplineFilter)| Self { lattice, coefficients, filter_reach: filter.reach() };
        Ok(fields.into_iter().zip(filters).map(field).collect())
    }

    /// Returns the bytes of memory of the cells that have coefficients.
    pub(super) fn bytes(&self) -> u64 {
        let cells = self.coefficients.shows.iter().filter(|shows| **shows).count();
        (cells * CELL_POINTS * size_of::<Halves>()) as u64
    }

    /// Returns whether a coefficient in a box, ends included, is not 0.
    pub(super) fn shows(&self, low: [isize; 3], high: [isize; 3]) -> bool {
        self.lattice.any(&self.coefficients.shows, low, high, |shows| *shows)
    }

    /// Returns the coefficients, in the order of [`Padded`].
    pub(super) fn coefficients(&self) -> &[Halves] {
        &self.coefficients.values
    }

    /// Returns the number of voxels, on either side along each axis, on which a coefficient depends.
    pub(super) fn filter_reach(&self) -> usize {
        self.filter_reach
    }
}
