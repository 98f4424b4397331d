//! How far two pictures are apart.

mod compare;

pub use compare::{Comparison, compare, difference_picture};
