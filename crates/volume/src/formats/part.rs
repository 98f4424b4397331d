//! A part of a lattice.

use glam::DVec3;

/// The largest number of half-spaces of a part: of a clip and of a rectangle of a picture.
const MAX_SIDES: usize = 12;

/// The part of a lattice inside some half-spaces; by default all of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatticePart {
    /// Gradients and constants of linear functions of lattice coordinates, which are 0 or more inside.
    sides: [(DVec3, f64); MAX_SIDES],
}

impl LatticePart {
    /// The part without any point.
    pub const NOTHING: Self = Self { sides: [(DVec3::ZERO, -1.0); MAX_SIDES] };

    /// Makes the part inside half-spaces: gradients and constants of linear functions of lattice coordinates, which are
    /// 0 or more inside. Half-spaces after the twelfth are left out, so that the part is larger.
    #[must_use]
    pub fn new(sides: impl IntoIterator<Item = (DVec3, f64)>) -> Self {
        let mut part = Self { sides: [(DVec3::ZERO, 0.0); MAX_SIDES] };
        part.sides.iter_mut().zip(sides).for_each(|(side, given)| *side = given);
        part
    }

    /// Returns whether a box of lattice points may have points of the part: it is outside no half-space alone.
    #[must_use]
    pub fn touches(&self, first: DVec3, last: DVec3) -> bool {
        self.sides.iter().all(|(gradient, constant)| {
            let corner = DVec3::select(gradient.cmpge(DVec3::ZERO), last, first);
            gradient.dot(corner) + constant >= 0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_touch_what_they_are_not_outside_of() {
        let part = LatticePart::new([(DVec3::X, -3.0), (DVec3::new(-1.0, -1.0, 0.0), 10.0)]);
        let touches = |from: [f64; 3], to: [f64; 3]| part.touches(DVec3::from(from), DVec3::from(to));
        assert!(touches([0.0; 3], [3.0; 3]) && !touches([0.0; 3], [2.9; 3]));
        assert!(touches([4.0, 6.0, 9.0], [8.0; 3]) && !touches([5.0, 6.0, 9.0], [8.0; 3]));
        assert!(!LatticePart::NOTHING.touches(DVec3::ZERO, DVec3::splat(9.0)));
        assert!(LatticePart::new([]).touches(DVec3::ZERO, DVec3::ZERO));
    }
}
