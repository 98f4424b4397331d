//! The difference of two pictures, and speed against error.

mod compare;
mod date;
#[cfg(feature = "report")]
mod plot;
mod sample;
mod study;

pub use compare::{Comparison, compare, difference_picture};
pub use date::today;
#[cfg(feature = "report")]
pub use plot::{Marker, Point, plot};
pub use sample::Sample;
pub use study::{Errors, Measurement, Study, Variant, front, variants};
