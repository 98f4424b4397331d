//! The lengths of vectors whose squares f64 does not hold, and rotations with the same bits on every machine.

use glam::{DQuat, DVec3};

/// The lengths between which squares neither overflow nor underflow.
const SAFE: std::ops::Range<f64> = 1e-150..1e150;

/// Returns the length of a finite vector.
pub fn length(vector: DVec3) -> f64 {
    let length = vector.length();
    let largest = vector.abs().max_element();
    if SAFE.contains(&length) || largest == 0.0 { length } else { (vector / largest).length() * largest }
}

/// Returns the direction, of length 1, of a finite vector that is not 0.
pub fn unit(vector: DVec3) -> DVec3 {
    if SAFE.contains(&vector.length()) { vector.normalize() } else { (vector / vector.abs().max_element()).normalize() }
}

/// Returns the rotation by an angle in radians around an axis of length 1.
pub fn rotation(axis: DVec3, angle: f64) -> DQuat {
    let (sine, cosine) = libm::sincos(angle / 2.0);
    DQuat::from_vec4((axis * sine).extend(cosine))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_length_has_a_direction() {
        for size in [5e-324, 1e-310, 1e-200, 1.0, 1e200, f64::MAX] {
            assert_eq!(length(DVec3::X * size), size);
            assert_eq!(unit(DVec3::X * size), DVec3::X);
        }
        // With the largest number divided out, a rounding or two remain.
        assert!((length(DVec3::new(3e200, 0.0, 4e200)) / 5e200 - 1.0).abs() < 4.0 * f64::EPSILON);
        assert_eq!(length(DVec3::ZERO), 0.0);
    }
}
