//! The transfer function as rays read it.

use std::array::from_fn;

use pulp::Simd;

use super::lanes::{Channels, Lanes, Order, RAYS, fours, twice_four};
use crate::transfer::TransferFunction;
use crate::transfer::bins::{BINS, Bins, OUTER_BINS, VisibleValues};
use crate::transfer::scalars::Reduction;

/// The number of bins of a block, of which the largest bend is known.
const BLOCK: usize = 8;
const BLOCKS: usize = BINS.div_ceil(BLOCK);

/// A transfer function and its integral over bins of scalars: colour times extinction, and extinction.
pub(super) struct Table {
    /// The transfer function at the ends of bins.
    values: Vec<[f32; 4]>,
    /// The integral of the transfer function up to the ends of bins, in bins.
    integrals: Vec<[f32; 4]>,
    /// The largest second difference of the function at the ends of the bins of 2^n blocks, for each n and each first
    /// block.
    bends: Vec<[f32; BLOCKS]>,
    lookup: [f32; 2],
    /// The range of invisible scalars around 0, ends included; empty if the first is larger.
    pub(super) invisible: [f32; 2],
    /// Whether the function is clear but for isosurfaces.
    pub(super) is_clear: bool,
}

/// The place among the bins of a scalar of each ray.
struct BinPlace<S: Simd> {
    place: Lanes<S>,
    bins: [u32; RAYS],
    /// The distance of the place from the beginning of its bin.
    beyond: [f32; RAYS],
}

/// The transfer function at a scalar of each ray, and its integral up to there, in bins.
#[derive(Clone, Copy)]
pub(super) struct Classified<S: Simd> {
    place: Lanes<S>,
    value: [Lanes<S>; 4],
    integral: [Lanes<S>; 4],
}

/// Returns for each n the largest second difference in 2^n blocks.
fn bends(values: &[[f32; 4]]) -> Vec<[f32; BLOCKS]> {
    let mut first = [0.0_f32; BLOCKS];
    for (number, around) in values.windows(3).enumerate() {
        let bend = (0..4).map(|c| (around[0][c] - 2.0 * around[1][c] + around[2][c]).abs()).fold(0.0, f32::max);
        // The end between two bins bends both.
        for bin in [number, number + 1] {
            first[bin / BLOCK] = first[bin / BLOCK].max(bend);
        }
    }
    let mut levels = vec![first];
    while 1 << levels.len() <= BLOCKS {
        let below = levels[levels.len() - 1];
        let half = 1 << (levels.len() - 1);
        levels.push(from_fn(|block| below[block].max(below[(block + half).min(BLOCKS - 1)])));
    }
    levels
}

impl Table {
    pub(super) fn new(transfer: &TransferFunction, reduction: &Reduction) -> Self {
        let Bins { mut rows, lookup, invisible } = Bins::new(transfer, reduction, VisibleValues::Opaque);
        let (integrals, values) = (rows.swap_remove(1), rows.swap_remove(0));
        let is_clear = values.iter().all(|value| value[3] <= 0.0);
        Self { bends: bends(&values), values, integrals, lookup, invisible, is_clear }
    }

    /// Returns whether no scalar of a range is visible.
    pub(super) fn is_invisible(&self, [low, high]: [f32; 2]) -> bool {
        low >= self.invisible[0] && high <= self.invisible[1]
    }

    /// Returns the bin of a scalar, and the distance of the scalar from the bin's beginning.
    #[inline(always)]
    fn bin(&self, scalar: f32) -> (usize, f32) {
        let [low, scale] = self.lookup;
        let place = (scalar - low) * scale + OUTER_BINS as f32;
        let bin = place.max(0.0).min((BINS - 1) as f32) as usize;
        (bin, place - bin as f32)
    }

    /// Returns the extinction of a scalar.
    pub(super) fn extinction(&self, scalar: f32) -> f32 {
        let (bin, beyond) = self.bin(scalar);
        let [value, next] = [self.values[bin][3], self.values[bin + 1][3]];
        value + (next - value) * beyond
    }

    /// Bounds the error of the transfer function at the mean of scalars, in place of its mean over them. All scalars
    /// lie in a range, and the scalars of one mean lie at most `apart`.
    #[inline(always)]
    pub(super) fn bend(&self, [low, high]: [f32; 2], apart: f32) -> f32 {
        let (low, high) = (self.bin(low).0 / BLOCK, self.bin(high).0 / BLOCK);
        let level = (high - low + 1).ilog2() as usize;
        let bend = self.bends[level][low].max(self.bends[level][high + 1 - (1 << level)]);
        // A second derivative times a variance of uniform scalars, halved; if only few bins are crossed, a kink counts
        // by an eighth.
        let bins = apart * self.lookup[1];
        bend * bins * (bins + 3.0) * (1.0 / 24.0)
    }

    #[inline(always)]
    fn place<S: Simd>(&self, simd: S, scalar: Lanes<S>) -> BinPlace<S> {
        let [low, scale] = self.lookup;
        let from_low = scalar.sub(simd, Lanes::all(simd, low));
        let place = from_low.fma(simd, Lanes::all(simd, scale), Lanes::all(simd, OUTER_BINS as f32));
        let last = Lanes::all(simd, (BINS - 1) as f32);
        let bin = place.max(simd, Lanes::all(simd, 0.0)).min(simd, last).floor(simd);
        BinPlace { place, bins: bin.indices(simd), beyond: place.sub(simd, bin).to_array() }
    }

    /// Returns for two rays the function at the beginning of their bins, its rise over them, and the places in them.
    #[inline(always)]
    fn in_bins<S: Simd>(
        &self,
        simd: S,
        [one, other]: [usize; 2],
        bins: &[u32; RAYS],
        beyond: &[f32; RAYS],
    ) -> [S::f32s; 3] {
        let a = &self.values[bins[one] as usize..][..2];
        let b = &self.values[bins[other] as usize..][..2];
        let value = fours::<S>(&a[0], &b[0]);
        [value, simd.sub_f32s(fours::<S>(&a[1], &b[1]), value), twice_four::<S>(beyond[one], beyond[other])]
    }

    /// Returns the function at a scalar of each ray.
    #[inline(always)]
    pub(super) fn value<S: Simd>(&self, simd: S, order: &Order, scalar: Lanes<S>) -> [Lanes<S>; 4] {
        let BinPlace { bins, beyond, .. } = self.place(simd, scalar);
        let mut values = Channels::new(simd);
        for vector in 0..values.0.len() {
            let [value, rise, beyond] = self.in_bins(simd, order.pair(vector), &bins, &beyond);
            values.0[vector] = simd.mul_add_f32s(rise, beyond, value);
        }
        values.apart(simd)
    }

    /// Returns the function at a scalar of each ray, and its integral.
    #[inline(always)]
    pub(super) fn classified<S: Simd>(&self, simd: S, order: &Order, scalar: Lanes<S>) -> Classified<S> {
        let BinPlace { place, bins, beyond } = self.place(simd, scalar);
        let half = simd.splat_f32s(0.5);
        let (mut values, mut integrals) = (Channels::new(simd), Channels::new(simd));
        for vector in 0..values.0.len() {
            let [one, other] = order.pair(vector);
            let [value, rise, beyond] = self.in_bins(simd, [one, other], &bins, &beyond);
            let rise = simd.mul_f32s(rise, beyond);
            let mean = simd.mul_add_f32s(half, rise, value);
            values.0[vector] = simd.add_f32s(value, rise);
            let up_to = fours::<S>(&self.integrals[bins[one] as usize], &self.integrals[bins[other] as usize]);
            integrals.0[vector] = simd.mul_add_f32s(mean, beyond, up_to);
        }
        Classified { place, value: values.apart(simd), integral: integrals.apart(simd) }
    }
}

impl<S: Simd> Classified<S> {
    /// Returns the mean of the function between two scalars. Steps and peaks of any width between them count.
    #[inline(always)]
    pub(super) fn mean(simd: S, from: &Self, to: &Self) -> [Lanes<S>; 4] {
        let one = Lanes::all(simd, 1.0);
        let apart = to.place.sub(simd, from.place);
        // If the scalars are nearly equal, rounding loses the difference of integrals.
        let sizes = from.place.abs(simd).add(simd, to.place.abs(simd));
        let alike = apart.abs(simd).less(simd, sizes.fma(simd, Lanes::all(simd, 1e-4), Lanes::all(simd, 0.25)));
        let per_bin = one.div(simd, one.or(simd, alike, apart));
        let mut mean = [one; 4];
        for c in 0..4 {
            let between = to.integral[c].sub(simd, from.integral[c]).mul(simd, per_bin);
            let middle = from.value[c].add(simd, to.value[c]).mul(simd, Lanes::all(simd, 0.5));
            mean[c] = middle.or(simd, alike, between);
        }
        mean
    }
}
