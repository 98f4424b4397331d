//! Limits of the work of one picture. More is refused before it begins: grown kernels, copies beyond the faces of a
//! volume and wide fields of view can need any amount.
//!
//! For comparison, a volume of 512^3 visible voxels at 512 x 512 pixels is some 3e9 fragments by the painter quads and
//! 3e9 chords for the reference; at 4096 x 4096 pixels 1e11 fragments.

use crate::error::Error;

/// The largest number of places of lattices, copies beyond the faces included, that are searched for splats of scalars,
/// unless the volume itself has half as many. A splat is 8 bytes.
pub(crate) const MAX_PLACES: u64 = 1 << 27;

/// The largest number of pixels of quads, summed over all passes. Software draws some 1e8 a second.
pub(crate) const MAX_FRAGMENTS: f64 = (1_u64 << 40) as f64;

/// The largest number of chords that rays of the reference cut out of kernels. A thread adds up some 2e6 a second, 1e7
/// with a tolerance.
pub(crate) const MAX_CHORDS: f64 = (1_u64 << 36) as f64;

/// The largest number of chords of one ray, on average over a picture. A chord takes some 100 bytes, and each thread
/// keeps the chords of a ray.
pub(crate) const MAX_RAY_CHORDS: f64 = (1_u64 << 24) as f64;

/// The largest number of blocks of a ray of the reference that its largest kernel spans. A thread keeps some 1000 bytes
/// for each.
pub(crate) const MAX_BLOCKS: f64 = (1_u64 << 18) as f64;

/// The largest growth of kernels of scalars: beyond, the whole volume is a fraction of a voxel of the coarsest level.
pub(crate) const MAX_GROWTH: f64 = (1_u64 << 26) as f64;

/// Returns the refusal of a picture that needs too much work: `what` it would have to do, and the growth of its largest
/// kernel.
pub(crate) fn too_much(what: &str, growth: f64) -> Error {
    if growth > 1.0 {
        return Error::Setting {
            name: "antialiasing",
            reason: format!(
                "kernels have grown up to {growth:.0} times because so many voxels fall to a pixel, and {what}: take a \
                 larger picture, a narrower field of view, or turn it off"
            ),
        };
    }
    Error::Setting { name: "size", reason: format!("{what}: take a smaller picture or a volume of fewer voxels") }
}
