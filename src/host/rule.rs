//! What becomes of the samples of rays.

use pulp::Simd;

use super::lanes::Lanes;
use super::lattice::Area;
use super::plane::{CHANNELS, Plane};
use super::rays::Rays;

/// Samples that a group keeps.
pub(super) const RECENT: usize = 4;

/// What becomes of the samples of a group of rays. Slabs lie around samples.
pub(super) trait Rule<S: Simd> {
    type State: Copy;

    /// How many samples a slab must see behind its own.
    const BEHIND: usize;
    /// Planes from sample to sample: 1 or 1/2.
    const STEP: f64;
    /// The first and the last sample around a sample that it matters to.
    const AROUND: [isize; 2];

    fn start(&self, simd: S) -> Self::State;

    /// Makes the plane of a sample.
    fn make(&self, simd: S, plane: &mut Plane, area: &Area, number: usize);

    /// Takes a sample.
    fn sampled(&self, state: &mut Self::State, number: usize, channels: [Lanes<S>; CHANNELS]);

    /// Takes note that a sample is left out, because nothing shows around it.
    fn passed(&self, simd: S, state: &mut Self::State, number: usize);

    /// Adds the slab around a sample at plane z; `shows`: something may show in it. Returns whether something did.
    fn slab(&self, simd: S, state: &mut Self::State, rays: &Rays<S>, sample: (usize, f32), shows: bool) -> bool;

    /// The transmittance of the rays.
    fn left(&self, simd: S, state: &Self::State) -> Lanes<S>;

    /// The colours and the alpha of the rays.
    fn pixel(&self, simd: S, state: &Self::State, rays: &Rays<S>) -> [Lanes<S>; 4];
}
