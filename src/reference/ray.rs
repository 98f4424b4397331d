//! A ray in the lattice, the viewer, and the weights of splats.

use glam::DVec3;

use crate::camera::clip::Side;
use crate::volume::Grid;

/// The weights of a splat, which multiply its kernel:
///
/// * pre-shading: extinction per world unit, then emission in red, green and blue (colour times extinction); X-rays
///   have no emission;
/// * post-shading and projections of intensity: scalar less base, then the scalar's central differences along the
///   lattice axes, 0 if neither light nor opacity depends on them.
pub(super) type Weights = [f64; 4];

/// A ray in lattice coordinates. Positions on it are lengths u in voxels from `origin`, the point nearest to the middle
/// of the volume, so that u keeps its digits for a distant eye.
#[derive(Debug, Clone, Copy)]
pub(super) struct LatticeRay {
    pub(super) origin: DVec3,
    /// The direction of the ray, unit length.
    pub(super) direction: DVec3,
    /// The position of the start: minus infinity for a parallel ray.
    pub(super) start: f64,
    /// The position of the end: infinity unless the ray was clipped.
    pub(super) end: f64,
    /// Voxels along the ray per world unit.
    pub(super) voxels_per_unit: f64,
}

impl LatticeRay {
    /// Makes the ray from `origin_world` along `direction_world` (unit length); `two_sided` rays extend backwards as
    /// well.
    pub(super) fn new(grid: &Grid, origin_world: DVec3, direction_world: DVec3, two_sided: bool) -> Self {
        let eye = grid.to_lattice().transform_point3(origin_world);
        let step = grid.to_lattice().transform_vector3(direction_world);
        let voxels_per_unit = step.length();
        let direction = step / voxels_per_unit;
        let center = DVec3::from_array(grid.dims().map(|d| f64::from(d - 1) / 2.0));
        let ahead = (center - eye).dot(direction);
        let start = if two_sided { f64::NEG_INFINITY } else { -ahead };
        Self { origin: eye + direction * ahead, direction, start, end: f64::INFINITY, voxels_per_unit }
    }

    /// Returns the part of the ray inside a lattice box grown by `margin`, if any.
    pub(super) fn clipped(mut self, bounds: &[[i64; 2]; 3], margin: f64) -> Option<Self> {
        for (axis, bound) in bounds.iter().enumerate() {
            let (origin, slope) = (self.origin[axis], self.direction[axis]);
            let (low, high) = (bound[0] as f64 - margin, bound[1] as f64 + margin);
            if slope == 0.0 {
                if !(low..=high).contains(&origin) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - origin) / slope, (high - origin) / slope);
            self.start = self.start.max(a.min(b));
            self.end = self.end.min(a.max(b));
        }
        (self.start < self.end).then_some(self)
    }

    /// Returns the part of the ray inside half-spaces relative to `middle`, if any (Cyrus and Beck 1978, "Generalized
    /// two- and three-dimensional clipping").
    pub(super) fn within(mut self, sides: &[Side], middle: DVec3) -> Option<Self> {
        for (gradient, value) in sides {
            let (at, slope) = (gradient.dot(self.origin - middle) + value, gradient.dot(self.direction));
            if slope > 0.0 {
                self.start = self.start.max(-at / slope);
            } else if slope < 0.0 {
                self.end = self.end.min(-at / slope);
            } else if at < 0.0 {
                return None;
            }
        }
        (self.start < self.end).then_some(self)
    }
}

/// The viewer of a picture, in world coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) enum Viewer {
    /// An eye at a place.
    At(DVec3),
    /// An eye infinitely far away in a direction, unit length.
    Towards(DVec3),
}

impl Viewer {
    /// Returns the unit direction from a point to the viewer.
    pub(super) fn from(self, point: DVec3) -> DVec3 {
        match self {
            Self::At(eye) => (eye - point).normalize_or_zero(),
            Self::Towards(direction) => direction,
        }
    }
}
