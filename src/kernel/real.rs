//! The number types of sums of kernels.

use std::ops::{Add, AddAssign, Mul, Sub};

use crate::volume::Number;

/// A number type of sums of kernels: f32 for pictures, f64 for the truth.
pub(crate) trait Real:
    Number + Default + PartialOrd + Add<Output = Self> + AddAssign + Sub<Output = Self> + Mul<Output = Self>
{
    /// Returns the number nearest to a value.
    fn from_f64(value: f64) -> Self;
}

impl Real for f32 {
    fn from_f64(value: f64) -> Self {
        value as Self
    }
}

impl Real for f64 {
    fn from_f64(value: f64) -> Self {
        value
    }
}
