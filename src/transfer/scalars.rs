//! Values as scalars: relative to the base of a transfer function, in single precision.

use super::Resolution;
use super::TransferFunction;
use crate::volume::{RowCoding, ToF64, Volume};

/// Returns the largest distance of the values of a range from a value.
fn farthest([lowest, highest]: [f64; 2], value: f64) -> f64 {
    (highest - value).abs().max((lowest - value).abs())
}

/// The least scalar of the farthest control point of a function that replaces another one. Smaller ones lose precision,
/// because shaders take differences over 64 for jumps.
const LEAST_EDITED: f64 = 0.125;

/// The map from values to the scalars of shaders: relative to the transfer function's base, times a power of two that
/// brings the farthest relevant control point to between 1 and 2. Data in any unit give the same scalars.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reduction {
    base: f64,
    factor: f64,
}

impl Reduction {
    /// The largest scalar. Values beyond are so far from all control points that the field on its way there crosses
    /// these at the same place.
    pub(crate) const LIMIT: f64 = (1_u128 << 64) as f64;

    /// Returns the reduction of values that are at most `largest` from the base.
    pub(crate) fn new(transfer: &TransferFunction, largest: f64) -> Self {
        Self::around(transfer.base(), transfer.extent_or(largest))
    }

    /// Returns the reduction for a function that others replace, given the lowest and the highest value: its base is so
    /// far below the visible values that it serves functions that show lower values too.
    pub(crate) fn for_edits(transfer: &TransferFunction, range: [f64; 2]) -> Self {
        let base = transfer.base();
        let extent = transfer.extent_or(farthest(range, base));
        let below = (base - extent).max(range[0]);
        let base = if below < base && transfer.is_invisible([below, base]) { below } else { base };
        Self::around(base, 2.0 * extent)
    }

    /// Returns whether the scalars serve a function: their base is invisible, and its points are about as far from it
    /// as shaders expect.
    pub(crate) fn serves(&self, transfer: &TransferFunction, range: [f64; 2]) -> bool {
        let base = transfer.base();
        let extent = transfer.extent_or(farthest(range, base));
        let reach = self.length(extent + (self.base - base).abs());
        transfer.is_invisible([self.base.min(base), self.base.max(base)]) && (LEAST_EDITED..=2.0).contains(&reach)
    }

    /// Returns the reduction of values of this extent around a base.
    fn around(base: f64, extent: f64) -> Self {
        let exponent = libm::log2(extent.clamp(f64::MIN_POSITIVE, f64::MAX)).floor();
        Self { base, factor: libm::exp2((-exponent).clamp(-1020.0, 1020.0)) }
    }

    /// Returns the value of a scalar of 0.
    pub(crate) fn base(&self) -> f64 {
        self.base
    }

    /// Returns the number of scalars for each unit of value.
    pub(crate) fn factor(&self) -> f64 {
        self.factor
    }

    /// Returns the value of a scalar.
    pub(crate) fn value(&self, scalar: f32) -> f64 {
        self.base + f64::from(scalar) / self.factor
    }

    /// Returns the scalar of a value.
    #[inline]
    pub(crate) fn scalar(&self, value: f64) -> f32 {
        self.length(value - self.base) as f32
    }

    /// Returns the resolution of a scalar of 0. At least 2^-64, so that no scalar over it leaves the range of f32.
    pub(crate) fn faintest(&self, resolution: &Resolution) -> f32 {
        self.length(resolution.faintest()).max(Self::LIMIT.recip()) as f32
    }

    /// Converts a difference of values to units of scalars.
    #[inline]
    pub(crate) fn length(&self, difference: f64) -> f64 {
        (difference * self.factor).clamp(-Self::LIMIT, Self::LIMIT)
    }
}

/// The map from samples to scalars.
pub(crate) struct Relative {
    slope: f64,
    intercept: f64,
    reduction: Reduction,
}

impl Relative {
    pub(crate) fn new(volume: &Volume, reduction: Reduction) -> Self {
        let (slope, intercept) = volume.rescale();
        Self { slope, intercept, reduction }
    }

    /// Makes the map from values to scalars.
    pub(crate) fn of_values(reduction: Reduction) -> Self {
        Self { slope: 1.0, intercept: 0.0, reduction }
    }

    #[inline]
    pub(crate) fn to(&self, raw: f64) -> f32 {
        self.reduction.scalar(self.slope * raw + self.intercept)
    }
}

impl RowCoding for Relative {
    fn append<T: ToF64 + bytemuck::Pod>(&self, samples: &[T], bytes: &mut Vec<u8>) {
        bytes.extend(samples.iter().flat_map(|s| self.to(s.to_f64()).to_ne_bytes()));
    }
}
