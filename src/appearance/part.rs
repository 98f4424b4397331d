//! The part of a volume that a picture needs, for readers that leave the rest out.

use glam::DVec3;

use crate::camera::Camera;
use crate::camera::clip::{Clip, Plane};
use crate::error::Result;
use crate::formats::LatticePart;
use crate::image::Region;
use crate::settings::{Model, Settings};
use crate::volume::Grid;

/// The distance in voxels on which normals depend, and one more.
const NORMALS: f64 = 4.0;
/// The distance in voxels at which a cubic B-spline's filter has fallen below the precision of f32: 0.27^16.
const FILTER: f64 = 16.0;
/// The largest share by which a figure's parts make voxels smaller, and their kernels larger.
const RESERVED: f64 = 1.5;

/// Returns the part of a lattice that may contribute to a picture inside its clip, and to a region of it, if that is
/// given. Shadows of voxels beside the region are not in it.
///
/// # Errors
/// [`Error::Setting`](crate::error::Error::Setting) if a ray of the camera has no direction.
pub fn needed_part(grid: &Grid, camera: &Camera, region: Option<Region>, settings: &Settings) -> Result<LatticePart> {
    let last = grid.dims().map(|n| f64::from(n - 1));
    let center = DVec3::from(last) / 2.0;
    let growth = camera.growth(grid);
    // The farthest corner of the lattice has the largest kernels.
    let corner = |n: usize| DVec3::from(std::array::from_fn(|axis| if n >> axis & 1 == 1 { last[axis] } else { 0.0 }));
    let depth = |n: usize| {
        let from = camera.eye().unwrap_or_default();
        (grid.to_world().transform_point3(corner(n)) - from).dot(camera.forward)
    };
    let grown = growth.at((0..8).map(depth).fold(0.0, f64::max));
    let is_filtered = settings.sharpness > 0.0 || settings.is_post_shaded() || settings.model != Model::Composite;
    let filter = if is_filtered { FILTER } else { 0.0 };
    let reach = RESERVED * grown * settings.kernel.radius() + NORMALS + filter;
    let mut sides = settings.clip.sides(grid);
    if let Some(region) = region {
        sides.extend(Clip::new(edges(camera, region)?)?.sides(grid));
    }
    Ok(LatticePart::new(sides.into_iter().map(|(gradient, value)| (gradient, value - gradient.dot(center) + reach))))
}

/// Returns the planes through the eye, or along the rays, around a region and a pixel on each side.
fn edges(camera: &Camera, region: Region) -> Result<Vec<Plane>> {
    let [w, h] = camera.size.map(f64::from);
    let at = |x: f64, y: f64| {
        let (origin, direction) = camera.ray((2.0 * x / w - 1.0) * w / h, 1.0 - 2.0 * y / h);
        (origin, direction)
    };
    let (x0, y0) = (f64::from(region.x) - 1.0, f64::from(region.y) - 1.0);
    let (x1, y1) = (x0 + f64::from(region.width) + 2.0, y0 + f64::from(region.height) + 2.0);
    let (from, towards) = at(f64::midpoint(x0, x1), f64::midpoint(y0, y1));
    let corners = [at(x0, y0), at(x1, y0), at(x1, y1), at(x0, y1)];
    let plane = |n: usize| {
        let ((a, along), (b, other)) = (corners[n], corners[(n + 1) % 4]);
        let plane = Plane::through(a, (b + other - a).cross(along))?;
        let is_inside = plane.normal().dot(from + towards) >= plane.offset();
        Ok(if is_inside { plane } else { plane.flipped() })
    };
    (0..4).map(plane).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{ProjectionKind, View};

    #[test]
    fn the_part_has_the_voxels_on_the_rays_of_a_region() {
        let grid = Grid::axis_parallel([256; 3], [0.5, 1.0, 2.0]).unwrap();
        for projection in [ProjectionKind::Orthographic, ProjectionKind::PERSPECTIVE] {
            let view = View { azimuth: 33.0, elevation: 20.0, projection, zoom: 4.0, ..View::default() };
            let camera = Camera::new(&view, &grid, [512, 384]).unwrap();
            let region = Region { x: 300, y: 40, width: 50, height: 70 };
            let settings = Settings::default();
            let part = needed_part(&grid, &camera, Some(region), &settings).unwrap();
            let inside = |x: f64, y: f64, t: f64| {
                let (origin, direction) = camera.ray((2.0 * x / 512.0 - 1.0) * 512.0 / 384.0, 1.0 - 2.0 * y / 384.0);
                let point = grid.to_lattice().transform_point3(origin + direction * t);
                part.touches(point, point)
            };
            for t in [1.0, 100.0, 700.0] {
                for (x, y) in [(300.0, 40.0), (350.0, 40.0), (350.0, 110.0), (300.0, 110.0), (325.0, 75.0)] {
                    assert!(inside(x, y, t), "{projection:?} {x} {y} {t}");
                }
            }
            // Kernels of neighbours reach over the edge, but not far.
            for (x, y) in [(150.0, 75.0), (500.0, 75.0), (325.0, 300.0)] {
                assert!(!inside(x, y, 700.0), "{projection:?} {x} {y}");
            }
        }
    }

    #[test]
    fn the_part_ends_behind_the_clip() {
        let grid = Grid::axis_parallel([100; 3], [1.0; 3]).unwrap();
        let clip = Clip::of_voxels(&grid, [40..60, 0..100, 0..100]).unwrap();
        let settings = Settings { clip, ..Settings::default() };
        let camera = Camera::new(&View::default(), &grid, [512; 2]).unwrap();
        let part = needed_part(&grid, &camera, None, &settings).unwrap();
        let has = |x: f64| part.touches(DVec3::new(x, 50.0, 50.0), DVec3::new(x, 50.0, 50.0));
        assert_eq!([20.0, 34.0, 40.0, 59.0, 65.0, 80.0].map(has), [false, true, true, true, true, false]);
    }
}
