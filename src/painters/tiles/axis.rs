//! The principal viewing axes of a picture: the lattice axes that its rays run along most closely (Lacroute and Levoy
//! 1994, "Fast volume rendering using a shear-warp factorization of the viewing transformation").

use glam::{DVec2, DVec3};

use crate::camera::{Camera, Projection};
use crate::gpu::view::ViewGeometry;
use crate::image::Region;
use crate::painters::painter::FamilyShare;
use crate::volume::Grid;

/// The largest component along a of a ray's unit vector. The shaders read six voxels of a row, and the first of them
/// may lie one voxel too early. So kernels, with a radius of 2 voxels, may reach 2.5 voxels along a row at most: 2 /
/// sqrt(1 - a^2) < 2.5 if a < 0.6.
const MAX_LEAN: f64 = 0.599;

/// The difference from its largest component up to which a component of a ray's unit vector has the ray marched along
/// that axis too; BLEND in shaders/common/rays.wgsl. Marches along two axes give colours that differ by up to 1e-2
/// (3e-2 post-shaded), so they are mixed by shares that change smoothly over two degrees on either side of a tie: a
/// degree changes a share by 0.4 at most.
const BLEND: f64 = 0.05;

/// The largest component across of a ray's unit vector in which m has a share.
const LARGEST_LEAN: f64 = 0.733;

/// The two axes across each axis.
const ACROSS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];

/// A principal viewing axis, called m: the lattice axis that rays run along most closely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PrincipalAxis {
    /// The numbers of the lattice axes a, b and m. Of the two axes across m, a is the first along which parallel rays
    /// lean little enough (see `MAX_LEAN`); for rays through one eye, the axis along which they lean less.
    pub(super) axes: [usize; 3],
    /// The largest component along a of the unit vectors of rays.
    pub(super) lean: f64,
    /// Whether rays run against m.
    pub(super) flipped: bool,
    /// The unit vector of a ray in (a, b, m), its component along m positive; for rays through one eye, of a ray in the
    /// middle of the rays along m.
    pub(super) direction: DVec3,
    /// The plane coordinates at unit depth of the ray `direction`, if rays go through one eye; see `Camera::pixels`.
    pub(super) middle: DVec2,
    /// The least and the largest place in the picture of the rays along m, in halves of its width and height from its
    /// middle, y upwards. Infinite for parallel rays.
    part: [DVec2; 2],
    /// The world length per lattice length along the ray `direction`.
    pub(super) stretch: f64,
    /// The share of this axis in a picture of parallel rays; 1 for rays through one eye, which have shares of their
    /// own.
    pub(super) share: f64,
}

impl PrincipalAxis {
    /// Returns the axes of a picture, each with a share in it: for parallel rays the axis that they run along most
    /// closely, and near a tie the others; for rays through one eye every axis and direction with a share in any ray.
    pub(super) fn all(camera: &Camera, grid: &Grid) -> Vec<Self> {
        let to_lattice = grid.to_lattice().matrix3;
        let Some(lens) = Lens::new(camera, grid) else {
            let ray = to_lattice * camera.forward;
            let unit = ray.normalize();
            let axes = (0..3).map(|m| {
                let [i, j] = ACROSS[m];
                let across = if unit[i].abs() < MAX_LEAN { [i, j] } else { [j, i] };
                let share = share(m, ray);
                Self { share, ..Self::along(across, m, ray[m] < 0.0, ray, 1.0, unit[across[0]].abs()) }
            });
            let mut axes: Vec<Self> = axes.filter(|axis| axis.share > 0.0).collect();
            axes.sort_by(|a, b| b.share.total_cmp(&a.share));
            return axes;
        };
        let directions = (0..3).flat_map(|m| [(m, false), (m, true)]);
        let axes = directions.filter_map(|(m, flipped)| {
            let part = lens.part(m, flipped);
            // The ray in the middle of that part stands for all of them.
            let count = part.len() as f64;
            let center = part.iter().fold(DVec2::ZERO, |sum, place| sum + place / count);
            let middle = DVec2::new(center.x * lens.aspect, center.y) * lens.tan_half_fov;
            let ends = [
                part.iter().copied().fold(DVec2::INFINITY, DVec2::min),
                part.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max),
            ];
            let world = (1.0 + middle.length_squared()).sqrt();
            let [i, j] = ACROSS[m];
            let leans = [i, j].map(|axis| lens.lean(axis, m, flipped));
            let (across, lean) = if leans[0] <= leans[1] { ([i, j], leans[0]) } else { ([j, i], leans[1]) };
            let axis = || Self { middle, part: ends, ..Self::along(across, m, flipped, lens.ray(center), world, lean) };
            (!part.is_empty()).then(axis)
        });
        axes.collect()
    }

    /// Returns the part of the picture's area in whose rays the axis may have a share, from 0 to 1.
    pub(super) fn covered(&self, camera: &Camera, grid: &Grid) -> f64 {
        let Some(lens) = Lens::new(camera, grid) else { return 1.0 };
        let part = lens.part(self.axes[2], self.flipped);
        let corners = part.iter().zip(part.iter().cycle().skip(1));
        // Half of the sum is the area, in quarters of the picture.
        corners.map(|(p, q)| p.perp_dot(*q)).sum::<f64>().abs() / 8.0
    }

    /// Returns whether the axis may have a share in rays of a region of a picture of this size.
    pub(super) fn is_in(&self, region: Region, size: [u32; 2]) -> bool {
        let place = |x: u32, y: u32| DVec2::new(f64::from(x), f64::from(y));
        let [low, high] = self.part_of(size);
        let end = place(region.x + region.width, region.y + region.height);
        low.cmple(end).all() && high.cmpge(place(region.x, region.y)).all()
    }

    /// Returns [`Self::part`] of a picture of this size, in pixels from its upper left corner.
    pub(super) fn part_of(&self, size: [u32; 2]) -> [DVec2; 2] {
        let half = DVec2::from_array(size.map(f64::from)) / 2.0;
        let [low, high] = self.part;
        [DVec2::new(low.x, -high.y), DVec2::new(high.x, -low.y)].map(|end| (end + 1.0) * half)
    }

    /// Makes the axis m, with the axes across it, for rays around one ray, given as a lattice vector and its world
    /// length.
    fn along([a, b]: [usize; 2], m: usize, flipped: bool, ray: DVec3, world: f64, lean: f64) -> Self {
        let unit = ray.normalize();
        Self {
            axes: [a, b, m],
            lean,
            flipped,
            direction: DVec3::new(unit[a], unit[b], unit[m].abs()),
            middle: DVec2::ZERO,
            part: [DVec2::NEG_INFINITY, DVec2::INFINITY],
            stretch: world / ray.length(),
            share: 1.0,
        }
    }

    /// Returns the voxels by which rays move along a and b from plane to plane.
    pub(super) fn shear(&self) -> DVec2 {
        DVec2::new(self.direction.x, self.direction.y) / self.direction.z
    }

    /// Returns the world distance between two voxel planes along a ray.
    pub(super) fn slab(&self) -> f64 {
        self.stretch / self.direction.z
    }

    /// Returns the distance in voxels between two voxel planes along a ray.
    pub(super) fn slab_voxels(&self) -> f64 {
        1.0 / self.direction.z
    }

    /// Converts a vector along the axes of the lattice to one along a, b and m, m in the direction of rays.
    pub(super) fn ordered(&self, v: DVec3) -> DVec3 {
        let [a, b, m] = self.axes;
        DVec3::new(v[a], v[b], if self.flipped { -v[m] } else { v[m] })
    }
}

/// The rays of a picture through one eye, in lattice coordinates.
struct Lens {
    aspect: f64,
    tan_half_fov: f64,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
}

/// Returns the families of rays, one along each principal axis; see
/// [`Room::families`](crate::painters::painter::Room::families).
pub(super) fn families(view: &ViewGeometry) -> Vec<FamilyShare<'_>> {
    let camera = &view.camera;
    let to_lattice = view.grid.to_lattice().matrix3;
    let (scale, origin) = camera.pixels();
    let share_of = |axis: PrincipalAxis| -> FamilyShare<'_> {
        if !view.is_perspective() {
            return Box::new(move |_| axis.share);
        }
        let m = axis.axes[2];
        Box::new(move |pixel| {
            let place = |i: usize| origin[i] + (f64::from(pixel[i]) + 0.5) * scale[i];
            let ray = to_lattice * (camera.forward + camera.right * place(0) + camera.up * place(1));
            if (ray[m] < 0.0) == axis.flipped { share(m, ray) } else { 0.0 }
        })
    };
    PrincipalAxis::all(camera, &view.grid).into_iter().map(share_of).collect()
}

impl Lens {
    /// Returns the rays of a camera; `None` if they are parallel.
    fn new(camera: &Camera, grid: &Grid) -> Option<Self> {
        let Projection::Perspective { tan_half_fov, .. } = camera.projection else { return None };
        let to_lattice = grid.to_lattice().matrix3;
        let aspect = f64::from(camera.size[0]) / f64::from(camera.size[1]);
        let [right, up] = [camera.right * aspect, camera.up].map(|axis| to_lattice * axis * tan_half_fov);
        Some(Self { aspect, tan_half_fov, right, up, forward: to_lattice * camera.forward })
    }

    /// Returns the direction of the ray through a place of the picture, in halves of its width and height.
    fn ray(&self, place: DVec2) -> DVec3 {
        self.forward + self.right * place.x + self.up * place.y
    }

    /// Returns the part of the picture in whose rays m has a share in this direction: no other component is larger by
    /// more than the blend. The part is cut by straight lines, which leave too much of it rather than too little.
    fn part(&self, m: usize, flipped: bool) -> Vec<DVec2> {
        let sign = if flipped { -1.0 } else { 1.0 };
        let mut part = vec![DVec2::NEG_ONE, DVec2::new(1.0, -1.0), DVec2::ONE, DVec2::new(-1.0, 1.0)];
        for other in (0..3).filter(|&other| other != m) {
            for against in [1.0, -1.0] {
                let lead = |d: DVec3| sign * d[m] - against * d[other] + BLEND * d.length();
                part = clipped(&part, |place| lead(self.ray(place)));
            }
        }
        part
    }

    /// Returns the largest component along an axis across m of the unit vectors of rays in which m has a share.
    fn lean(&self, axis: usize, m: usize, flipped: bool) -> f64 {
        /// The number of places along each side of the part: no maximum lies within, because the axis itself is
        /// outside.
        const STEPS: usize = 16;
        let part = self.part(m, flipped);
        let side = |i: usize| {
            let (p, q) = (part[i], part[(i + 1) % part.len()]);
            (0..STEPS).map(move |step| p + step as f64 / STEPS as f64 * (q - p))
        };
        let leans = (0..part.len()).flat_map(side).map(|place| self.ray(place).normalize()[axis].abs());
        // Between the places it may be a little more, up to the lean at which m loses its share.
        (leans.fold(0.0, f64::max) + 0.003).min(LARGEST_LEAN)
    }
}

/// Returns the share of axis m in the colour of a ray: 1 if the ray runs along m most closely by far, and smoothly less
/// down to 0. The shares of a ray add up to 1. `share_of` in shaders/common/rays.wgsl is the same.
fn share(m: usize, ray: DVec3) -> f64 {
    let unit = ray.normalize().abs();
    let lead = |m: usize| unit[m] - unit[(m + 1) % 3].max(unit[(m + 2) % 3]);
    let shares = [0, 1, 2].map(|m| smoothstep(-BLEND, BLEND, lead(m)));
    shares[m] / shares.iter().sum::<f64>()
}

/// Returns 0 up to `low`, 1 from `high` on, and smooth values between.
fn smoothstep(low: f64, high: f64, value: f64) -> f64 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Converts values along a, b and m to values along the axes of the lattice.
pub(super) fn unordered<T: Copy + Default>(axes: [usize; 3], values: [T; 3]) -> [T; 3] {
    let mut result = [T::default(); 3];
    for (axis, value) in axes.into_iter().zip(values) {
        result[axis] = value;
    }
    result
}

/// Returns the part of a convex polygon in which a linear function is not negative (Sutherland and Hodgman 1974,
/// "Reentrant polygon clipping").
fn clipped(polygon: &[DVec2], value: impl Fn(DVec2) -> f64) -> Vec<DVec2> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (at_p, at_q) = (value(p), value(q));
        if at_p >= 0.0 {
            kept.push(p);
        }
        if (at_p >= 0.0) != (at_q >= 0.0) {
            kept.push(p + at_p / (at_p - at_q) * (q - p));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_those_of_the_rays_of_pixels() {
        let grid = Grid::new([8, 8, 8], glam::DAffine3::IDENTITY).unwrap();
        let count = |fov, azimuth, elevation| {
            let projection = crate::camera::ProjectionKind::Perspective { fov };
            let view = crate::camera::View { projection, azimuth, elevation, ..crate::camera::View::default() };
            PrincipalAxis::all(&Camera::new(&view, &grid, [64, 48]).unwrap(), &grid).len()
        };
        assert_eq!(count(30.0, 0.0, 0.0), 1);
        assert_eq!(count(30.0, 45.0, 0.0), 2);
        assert_eq!(count(30.0, 45.0, 35.26), 3);
        // In a wide picture from the front rays run along every axis in both directions, but not backwards.
        assert_eq!(count(120.0, 0.0, 0.0), 5);
    }

    #[test]
    fn parts_of_a_picture_are_those_with_a_share_of_their_axis() {
        let grid = Grid::axis_parallel([60, 40, 50], [1.0, 1.5, 0.7]).unwrap();
        let size = [64, 48];
        for (fov, azimuth, elevation) in [(30.0, 30.0, 20.0), (60.0, 45.0, 35.0), (110.0, 100.0, -60.0)] {
            let projection = crate::camera::ProjectionKind::Perspective { fov };
            let view = crate::camera::View { projection, azimuth, elevation, ..crate::camera::View::default() };
            let camera = Camera::new(&view, &grid, size).unwrap();
            let lens = Lens::new(&camera, &grid).unwrap();
            let mut covered = 0.0;
            for axis in PrincipalAxis::all(&camera, &grid) {
                let shown = |x: u32, y: u32| {
                    let place = |i: u32, count: u32| f64::from(2 * i + 1) / f64::from(count) - 1.0;
                    let ray = lens.ray(DVec2::new(place(x, size[0]), -place(y, size[1])));
                    share(axis.axes[2], ray) > 0.0 && (ray[axis.axes[2]] < 0.0) == axis.flipped
                };
                let pixels = (0..size[0]).flat_map(|x| (0..size[1]).map(move |y| (x, y)));
                let shown: Vec<(u32, u32)> = pixels.filter(|&(x, y)| shown(x, y)).collect();
                let part = axis.covered(&camera, &grid);
                assert!(part <= 1.0 + 1e-9 && part + 0.03 > shown.len() as f64 / f64::from(size[0] * size[1]));
                covered += part;
                for (x, y) in shown {
                    assert!(axis.is_in(Region { x, y, width: 1, height: 1 }, size), "{axis:?} {x} {y}");
                }
            }
            assert!((1.0..1.6).contains(&covered), "{fov}: {covered}");
        }
        // From the front: one axis in the middle, another one beside it, both between them.
        let projection = crate::camera::ProjectionKind::Perspective { fov: 100.0 };
        let view = crate::camera::View { projection, azimuth: 0.0, elevation: 0.0, ..crate::camera::View::default() };
        let axes = PrincipalAxis::all(&Camera::new(&view, &grid, size).unwrap(), &grid);
        let regions = [28, 44, 56].map(|x| Region { x, y: 20, width: 8, height: 8 });
        assert!(axes.len() > 2);
        assert_eq!(regions.map(|region| axes.iter().filter(|axis| axis.is_in(region, size)).count()), [1, 2, 1]);
    }

    #[test]
    fn rays_with_a_share_lean_no_more_than_their_axis_says() {
        let grid = Grid::axis_parallel([60, 40, 50], [1.0, 1.5, 0.7]).unwrap();
        let mut held = 0;
        for (fov, azimuth, elevation) in [(30.0, 30.0, 20.0), (60.0, 45.0, 35.0), (110.0, 100.0, -60.0)] {
            let projection = crate::camera::ProjectionKind::Perspective { fov };
            let view = crate::camera::View { projection, azimuth, elevation, ..crate::camera::View::default() };
            let camera = Camera::new(&view, &grid, [64, 48]).unwrap();
            let lens = Lens::new(&camera, &grid).unwrap();
            for axis in PrincipalAxis::all(&camera, &grid) {
                for i in 0..21 * 21 {
                    let ray = lens.ray(DVec2::new(f64::from(i % 21), f64::from(i / 21)) / 10.0 - 1.0);
                    let m = axis.axes[2];
                    if share(m, ray) > 0.0 && (ray[m] < 0.0) == axis.flipped {
                        assert!(ray.normalize()[axis.axes[0]].abs() <= axis.lean, "{fov} {axis:?} {ray}");
                        held += 1;
                    }
                }
            }
        }
        assert!(held >= 3 * 21 * 21, "{held}");
    }
}
