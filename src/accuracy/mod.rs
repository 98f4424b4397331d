//! How far a picture is from the truth: estimated from a sample of traced pixels, and kept below a bound by the choice
//! of settings.
//!
//! The error of a pixel is the largest difference of its four channels, premultiplied, 0 to 1. The error of a picture
//! is what 99.9 % of the covered pixels keep: the largest of all is that of single pixels that grazing rays make
//! anything of, and no sample tells it.

mod choose;
mod estimate;
mod sample;

pub use choose::{Chosen, Tried, choose};
pub use estimate::{Estimate, Truth};
pub use sample::Sample;
