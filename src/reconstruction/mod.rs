//! How well a lattice of samples is turned back into a field: the error of reconstruction, apart from that of
//! rendering.
//!
//! [`measure`] samples a signal that is known everywhere, reconstructs it by a [`Method`], and compares: the field, and
//! its integrals along rays. What a method does to any signal is told as well: ripple, blur, gain of noise.
//!
//! [`Settings::sharpness`](crate::settings::Settings::sharpness) filters the samples so that the kernels of
//! post-shading pass through them; the filter is measured here, and made in `prefilter.rs`.

mod prefilter;
mod quality;
mod signal;

pub(crate) use prefilter::Prefilter;
pub use quality::{Errors, Method, Quality, measure};
pub(crate) use quality::{noise, noise_of_gradients};
pub use signal::Signal;
