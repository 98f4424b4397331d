//! Reconstruction of a field from a lattice of samples, as a weighted sum of filtered samples.
//!
//! [`Settings::sharpness`](crate::settings::Settings::sharpness) filters the samples so that the kernels of
//! post-shading pass through them; `prefilter.rs` makes the filter. [`Reconstruction`] measures the noise of a field
//! and the attenuation of waves.

mod prefilter;
mod waves;

pub use prefilter::Prefilter;
pub use waves::Reconstruction;
