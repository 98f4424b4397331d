//! The rules by which rays turn their samples into a pixel.

use pulp::Simd;

use super::blend::{Along, Blend};
use super::field::Field;
use super::lanes::Lanes;
use super::lattice::{PlaneArea, ReadPoints};
use super::plane::{CHANNELS, Plane};
use super::rays::Rays;

/// The number of samples that a group keeps.
pub(super) const RECENT: usize = 4;

/// A rule that turns the samples of a group of rays into pixels. Slabs lie around samples.
pub(super) trait Rule<S: Simd> {
    type State: Clone;

    /// The number of samples behind its own on which a slab depends.
    const BEHIND: usize;
    /// The distance in planes from sample to sample: 1 or 1/2.
    const STEP: f64;
    /// The range of neighbours to whose slabs a sample matters, from first to last.
    const AROUND: [isize; 2];

    /// Returns the state of a group of rays, given its number in the tile.
    fn start(&self, simd: S, group: usize) -> Self::State;

    /// Returns the fields of samples that may be interpolated between planes, where kernels are wide; `None`: none may.
    #[inline(always)]
    fn scalars(&self) -> Option<(&Blend<'_, Field>, &Along)> {
        None
    }

    /// Makes the points of an area that rays read, in the plane of a sample.
    fn make(&self, simd: S, plane: &mut Plane, area: (&PlaneArea, &ReadPoints), number: usize);

    /// Stores the channels of a sample.
    fn sampled(&self, state: &mut Self::State, number: usize, channels: [Lanes<S>; CHANNELS]);

    /// Notes that a sample was skipped, because no visible matter is around it.
    fn passed(&self, simd: S, state: &mut Self::State, number: usize);

    /// Adds the slab around a sample at plane z; `shows`: it may have visible matter. Returns whether it had any.
    fn slab(&self, simd: S, state: &mut Self::State, rays: &Rays<S>, sample: (usize, f32), shows: bool) -> bool;

    /// Returns the planes of the isosurfaces that let less than half of the light pass, infinite where none did; `None`
    /// if there are none.
    #[inline(always)]
    fn half(&self, _: &Self::State) -> Option<Lanes<S>> {
        None
    }

    /// Returns the transmittance of the rays.
    fn left(&self, simd: S, state: &Self::State) -> Lanes<S>;

    /// Returns the colours and the alpha of the rays.
    fn pixel(&self, simd: S, state: &Self::State, rays: &Rays<S>) -> [Lanes<S>; 4];
}
