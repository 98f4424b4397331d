//! Samples half way between planes, interpolated between samples at planes.
//!
//! Fields of wide kernels are smooth from plane to plane, and summing planes is most of the work of dense voxels.

use pulp::Simd;

use super::lanes::Lanes;
use super::plane::CHANNELS;

/// The number of samples behind a sample half way between planes that it is interpolated of.
pub(super) const DELAY: usize = 3;
/// The number of samples that are kept.
const KEPT: usize = 8;

/// The last samples of a group of rays that were taken: all at planes, which have odd numbers, and some between them.
#[derive(Clone)]
pub(super) struct PlaneSamples<S: Simd> {
    /// Sample n is at n modulo 8.
    samples: [[Lanes<S>; CHANNELS]; KEPT],
    last: isize,
}

/// Returns whether a sample of `count` lies at a plane, or so near an end that it cannot be interpolated.
pub(super) fn is_apart(number: usize, count: usize) -> bool {
    number % 2 == 1 || number < DELAY || number + DELAY >= count
}

/// Returns the value half way between the second and the third of four samples, by the cubic through them.
#[inline(always)]
pub(super) fn half_way<S: Simd>(simd: S, [first, before, behind, last]: [Lanes<S>; 4]) -> Lanes<S> {
    let inner = before.add(simd, behind).mul(simd, Lanes::all(simd, 9.0));
    inner.sub(simd, first.add(simd, last)).mul(simd, Lanes::all(simd, 1.0 / 16.0))
}

impl<S: Simd> PlaneSamples<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        Self { samples: [[Lanes::all(simd, 0.0); CHANNELS]; KEPT], last: isize::MIN / 2 }
    }

    /// Stores a sample that was taken.
    #[inline(always)]
    pub(super) fn sampled(&mut self, number: usize, channels: [Lanes<S>; CHANNELS]) {
        if self.last < number as isize - 2 {
            self.samples = [channels; KEPT];
        }
        self.samples[number % KEPT] = channels;
        self.last = number as isize;
    }

    /// Notes that a sample was skipped.
    #[inline(always)]
    pub(super) fn passed(&mut self, number: usize) {
        self.samples[number % KEPT] = self.samples[(number + KEPT - 2) % KEPT];
    }

    /// Returns a sample, by the cubic through four at planes if it was not taken.
    #[inline(always)]
    pub(super) fn at(&self, simd: S, number: usize, was_taken: bool) -> [Lanes<S>; CHANNELS] {
        let mut channels = self.samples[number % KEPT];
        if !was_taken {
            let [first, before, behind, last] = [3, 1, KEPT - 1, KEPT - 3].map(|back| (number + KEPT - back) % KEPT);
            for channel in 0..CHANNELS {
                let of = |sample: usize| self.samples[sample][channel];
                channels[channel] = half_way(simd, [of(first), of(before), of(behind), of(last)]);
            }
        }
        channels
    }
}
