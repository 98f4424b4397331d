//! The transfer function as rays read it.

use pulp::Simd;

use super::lanes::{Channels, Lanes, Order, fours, twice_four};
use crate::transfer::TransferFunction;
use crate::transfer::bins::{BINS, Bins, OUTER_BINS, VisibleValues};
use crate::transfer::scalars::Reduction;

/// Numbers of a bin: the function at its beginning, and the integral up to there.
const NUMBERS: usize = 8;

/// A transfer function and its integral over bins of scalars: colour times extinction, and extinction.
pub(super) struct Table {
    numbers: Vec<f32>,
    lookup: [f32; 2],
    /// The range of invisible scalars around 0, ends included; empty if the first is larger.
    pub(super) invisible: [f32; 2],
}

/// The function at a scalar of each ray, and its integral up to there, in bins.
#[derive(Clone, Copy)]
pub(super) struct Classified<S: Simd> {
    place: Lanes<S>,
    value: [Lanes<S>; 4],
    integral: [Lanes<S>; 4],
}

impl Table {
    pub(super) fn new(transfer: &TransferFunction, reduction: &Reduction) -> Self {
        let Bins { rows, lookup, invisible } = Bins::new(transfer, reduction, VisibleValues::Opaque);
        let integrals = rows[1].iter().copied().chain([[0.0; 4]]);
        let numbers = rows[0].iter().zip(integrals).flat_map(|(value, integral)| [*value, integral].concat());
        Self { numbers: numbers.collect(), lookup, invisible }
    }

    /// Whether no scalar of a range is visible.
    pub(super) fn is_invisible(&self, [low, high]: [f32; 2]) -> bool {
        low >= self.invisible[0] && high <= self.invisible[1]
    }

    /// The extinction of a scalar.
    pub(super) fn extinction(&self, scalar: f32) -> f32 {
        let [low, scale] = self.lookup;
        let place = (scalar - low) * scale + OUTER_BINS as f32;
        let bin = place.clamp(0.0, (BINS - 1) as f32) as usize;
        let [value, next] = [3, NUMBERS + 3].map(|c| self.numbers[bin * NUMBERS + c]);
        value + (next - value) * (place - bin as f32)
    }

    #[inline(always)]
    pub(super) fn classified<S: Simd>(&self, simd: S, order: &Order, scalar: Lanes<S>) -> Classified<S> {
        let [low, scale] = self.lookup;
        let from_low = scalar.sub(simd, Lanes::all(simd, low));
        let place = from_low.fma(simd, Lanes::all(simd, scale), Lanes::all(simd, OUTER_BINS as f32));
        let last = Lanes::all(simd, (BINS - 1) as f32);
        let bin = place.max(simd, Lanes::all(simd, 0.0)).min(simd, last).floor(simd);
        let beyond = place.sub(simd, bin).to_array();
        let bins = bin.indices(simd);
        let half = simd.splat_f32s(0.5);
        let (mut values, mut integrals) = (Channels::new(simd), Channels::new(simd));
        for vector in 0..values.0.len() {
            let [one, other] = order.pair(vector);
            let a = &self.numbers[bins[one] as usize * NUMBERS..][..NUMBERS + 4];
            let b = &self.numbers[bins[other] as usize * NUMBERS..][..NUMBERS + 4];
            let value = fours::<S>(a, b);
            let beyond = twice_four::<S>(beyond[one], beyond[other]);
            let rise = simd.mul_f32s(simd.sub_f32s(fours::<S>(&a[NUMBERS..], &b[NUMBERS..]), value), beyond);
            let mean = simd.mul_add_f32s(half, rise, value);
            values.0[vector] = simd.add_f32s(value, rise);
            integrals.0[vector] = simd.mul_add_f32s(mean, beyond, fours::<S>(&a[4..], &b[4..]));
        }
        Classified { place, value: values.apart(simd), integral: integrals.apart(simd) }
    }
}

impl<S: Simd> Classified<S> {
    /// The mean of the function between two scalars. Steps and peaks of any width between them count.
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
