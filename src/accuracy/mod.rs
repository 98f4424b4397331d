//! The error of a picture: an estimate from a sample of traced pixels, and settings that keep it below a bound.
//!
//! The error of a pixel is the largest difference of its four channels, premultiplied, 0 to 1. The error of a picture
//! is the 99.9th percentile over the covered pixels. The largest error of all pixels is no measure: single pixels with
//! grazing rays decide it, and no sample tells it.

mod choose;
mod estimate;
mod sample;

pub use choose::{Chosen, MOST_PICTURES, Tried, choose};
pub use estimate::{Estimate, Truth};
#[doc(hidden)]
pub use sample::Sample;
