//! Numbers of voxels of a row, side by side in the vectors of the machine.
//!
//! Operations are loops, not closures: a closure is not compiled for the vectors of the machine.

use pulp::Simd;

use super::DARK;

/// Sums with this number are whole, and the last 16 bits of their representations are those of the other number.
pub(super) const WHOLE: f32 = 8_388_608.0;

/// The number of vectors that are summed together: enough to hide the latency of a sum.
const VECTORS: usize = 4;

/// A number for each of several voxels of a row.
#[derive(Clone, Copy)]
pub(super) struct RowLanes<S: Simd>([S::f32s; VECTORS]);

impl<S: Simd> RowLanes<S> {
    /// The number of voxels side by side.
    pub(super) const COUNT: usize = VECTORS * S::F32_LANES;

    #[inline(always)]
    pub(super) fn new(simd: S, value: f32) -> Self {
        Self([simd.splat_f32s(value); VECTORS])
    }

    /// Loads the first [`Self::COUNT`] numbers of a slice.
    #[inline(always)]
    pub(super) fn load(values: &[f32]) -> Self {
        let (vectors, _) = S::as_simd_f32s(&values[..Self::COUNT]);
        Self([vectors[0], vectors[1], vectors[2], vectors[3]])
    }

    #[inline(always)]
    pub(super) fn store(self, values: &mut [f32]) {
        let (vectors, _) = S::as_mut_simd_f32s(&mut values[..Self::COUNT]);
        vectors.copy_from_slice(&self.0);
    }

    /// Adds other numbers times a factor. Products are rounded, so the sums are the same on every machine.
    #[inline(always)]
    pub(super) fn plus(mut self, simd: S, factor: f32, others: Self) -> Self {
        let factor = simd.splat_f32s(factor);
        for i in 0..VECTORS {
            self.0[i] = simd.add_f32s(self.0[i], simd.mul_f32s(factor, others.0[i]));
        }
        self
    }

    #[inline(always)]
    pub(super) fn times(mut self, simd: S, factor: f32) -> Self {
        let factor = simd.splat_f32s(factor);
        for i in 0..VECTORS {
            self.0[i] = simd.mul_f32s(factor, self.0[i]);
        }
        self
    }

    /// Adds other numbers from 0 to 65535 times a factor, each rounded to a whole number. The last 16 bits of the
    /// representations of these numbers are sums, whatever the order.
    #[inline(always)]
    pub(super) fn plus_whole(mut self, simd: S, factor: f32, others: Self) -> Self {
        let (factor, whole) = (simd.splat_f32s(factor), simd.splat_f32s(WHOLE));
        for i in 0..VECTORS {
            let rounded = simd.add_f32s(simd.mul_f32s(factor, others.0[i]), whole);
            let bits = [self.0[i], rounded].map(|value| simd.transmute_u32s_f32s(value));
            self.0[i] = simd.transmute_f32s_u32s(simd.add_u32s(bits[0], bits[1]));
        }
        self
    }

    /// Returns these numbers where `others` are below a limit, and 0 elsewhere.
    #[inline(always)]
    pub(super) fn below(mut self, simd: S, others: Self, limit: f32) -> Self {
        let (zero, limit) = (simd.splat_f32s(0.0), simd.splat_f32s(limit));
        for i in 0..VECTORS {
            self.0[i] = simd.select_f32s(simd.less_than_f32s(others.0[i], limit), self.0[i], zero);
        }
        self
    }

    /// Returns exp(-x) for x from 0 to [`DARK`], to 3e-4: the 16th power of a series.
    #[inline(always)]
    pub(super) fn transmitted(mut self, simd: S) -> Self {
        let (zero, dark) = (simd.splat_f32s(0.0), simd.splat_f32s(DARK as f32));
        let scale = simd.splat_f32s(-1.0 / 16.0);
        for i in 0..VECTORS {
            let y = simd.mul_f32s(simd.min_f32s(simd.max_f32s(self.0[i], zero), dark), scale);
            let mut e = simd.splat_f32s(1.0 / 720.0);
            for term in [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 1.0 / 2.0, 1.0, 1.0] {
                e = simd.add_f32s(simd.mul_f32s(e, y), simd.splat_f32s(term));
            }
            for _ in 0..4 {
                e = simd.mul_f32s(e, e);
            }
            self.0[i] = e;
        }
        self
    }
}
