//! The difference of two pictures.

mod compare;

pub use compare::{Comparison, compare, difference_picture};
