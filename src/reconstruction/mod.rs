//! Reconstruction of a field from a lattice of samples: as a weighted sum of samples that are filtered first.
//!
//! [`Settings::sharpness`](crate::settings::Settings::sharpness) filters the samples so that the kernels of
//! post-shading pass through them; the filter is made in `prefilter.rs`. [`Reconstruction`] measures the noise of a
//! field, and the waves that it keeps.

mod prefilter;
mod waves;

pub use prefilter::Prefilter;
pub use waves::Reconstruction;
