//! The ways in which rays follow a lattice.

use glam::{DVec2, DVec3};

use crate::camera::{Camera, Projection};
use crate::volume::Grid;

/// How far beyond the picture, in halves of its width and height, looks are those of rays.
pub(super) const BEYOND: f64 = 0.25;
/// Component along a of unit vectors of rays that the shaders' rows of six voxels, of which the first may begin one too
/// early, hold: kernels reach less than 2.5 voxels along a row, 2 / sqrt(1 - a^2), up to 0.6.
const MAX_LEAN: f64 = 0.599;

/// How rays look at a lattice: along the axis m that they follow most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look {
    /// Numbers of the lattice axes a, b and m. Of the two across, a is the first that rays do not lean to too much: the
    /// same in most pictures of a turning volume, so that few pack it anew.
    pub(super) axes: [usize; 3],
    /// Whether they run against m.
    pub(super) flipped: bool,
    /// Unit vector in (a, b, m), m as they run along it; of rays through one eye that of a ray in their middle.
    pub(super) direction: DVec3,
    /// World length per lattice length along it.
    stretch: f64,
}

impl Look {
    /// The looks of a picture: one of parallel rays; of rays through one eye those that any pixel's ray has.
    pub(super) fn all(camera: &Camera, grid: &Grid, size: [u32; 2]) -> Vec<Self> {
        let to_lattice = grid.to_lattice().matrix3;
        let Projection::Perspective { tan_half_fov, .. } = camera.projection else {
            let ray = to_lattice * camera.forward;
            let m = ray.abs().max_position();
            return vec![Self::along(m, ray[m] < 0.0, ray, 1.0)];
        };
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let [right, up] = [camera.right * aspect, camera.up].map(|axis| to_lattice * axis * tan_half_fov);
        let forward = to_lattice * camera.forward;
        let ways = (0..3).flat_map(|m| [(m, false), (m, true)]);
        ways.filter_map(|(m, flipped)| {
            // The part of the picture whose rays follow m that way most: where m's component is larger than any other.
            let sign = if flipped { -1.0 } else { 1.0 };
            let edge = 1.0 + BEYOND;
            let mut part = vec![(-edge, -edge), (edge, -edge), (edge, edge), (-edge, edge)];
            for other in (0..3).filter(|&other| other != m) {
                for against in [1.0, -1.0] {
                    // Ties are followed along both, whatever rounding makes of them.
                    let lead = |d: DVec3| sign * d[m] - against * d[other] + 1e-5 * d.length();
                    part = clipped(&part, |(x, y)| lead(forward + right * x + up * y));
                }
            }
            let count = part.len() as f64;
            let (x, y) = part.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / count, y + p.1 / count));
            let world = (1.0 + (tan_half_fov * tan_half_fov) * (x * x * aspect * aspect + y * y)).sqrt();
            (!part.is_empty()).then(|| Self::along(m, flipped, forward + right * x + up * y, world))
        })
        .collect()
    }

    /// Along m, of rays around one of that lattice direction and world length.
    fn along(m: usize, flipped: bool, ray: DVec3, world: f64) -> Self {
        let unit = ray.normalize();
        let (i, j) = [(1, 2), (0, 2), (0, 1)][m];
        let (a, b) = if unit[i].abs() < MAX_LEAN { (i, j) } else { (j, i) };
        Self {
            axes: [a, b, m],
            flipped,
            direction: DVec3::new(unit[a], unit[b], unit[m].abs()),
            stretch: world / ray.length(),
        }
    }

    /// How far rays move along a and b from plane to plane.
    pub(super) fn shear(&self) -> DVec2 {
        DVec2::new(self.direction.x, self.direction.y) / self.direction.z
    }

    /// World length of a voxel along a ray.
    pub(super) fn voxel(&self) -> f64 {
        self.stretch
    }

    /// World distance of two voxel planes along a ray: the thickness of a slab.
    pub(super) fn slab(&self) -> f64 {
        self.stretch / self.direction.z
    }

    /// That distance in voxels.
    pub(super) fn slab_voxels(&self) -> f64 {
        1.0 / self.direction.z
    }

    /// What is given along the axes of the lattice, along a, b and m as rays run along it.
    pub(super) fn ordered(&self, v: DVec3) -> DVec3 {
        let [a, b, m] = self.axes;
        DVec3::new(v[a], v[b], if self.flipped { -v[m] } else { v[m] })
    }
}

/// What is given along a, b and m, along the axes of the lattice.
pub(super) fn unordered(axes: [usize; 3], values: [u32; 3]) -> [u32; 3] {
    let mut result = [0; 3];
    for (axis, value) in axes.into_iter().zip(values) {
        result[axis] = value;
    }
    result
}

/// The part of a convex polygon where a linear function is not negative (Sutherland and Hodgman 1974).
fn clipped(polygon: &[(f64, f64)], value: impl Fn((f64, f64)) -> f64) -> Vec<(f64, f64)> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (at_p, at_q) = (value(p), value(q));
        if at_p >= 0.0 {
            kept.push(p);
        }
        if (at_p >= 0.0) != (at_q >= 0.0) {
            let t = at_p / (at_p - at_q);
            kept.push((p.0 + t * (q.0 - p.0), p.1 + t * (q.1 - p.1)));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_are_those_of_pixels() {
        let grid = Grid::new([8, 8, 8], glam::DAffine3::IDENTITY).unwrap();
        let count = |fov, azimuth, elevation| {
            let projection = crate::camera::ProjectionKind::Perspective { fov };
            let view = crate::camera::View { projection, azimuth, elevation, ..crate::camera::View::default() };
            Look::all(&Camera::new(&view, &grid, [64, 48]).unwrap(), &grid, [64, 48]).len()
        };
        assert_eq!(count(30.0, 0.0, 0.0), 1);
        assert_eq!(count(30.0, 45.0, 0.0), 2);
        assert_eq!(count(30.0, 45.0, 35.26), 3);
        // Around the front all sides, but not the back.
        assert_eq!(count(120.0, 0.0, 0.0), 5);
    }
}
