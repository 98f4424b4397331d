//! Parallel rays: their intermediate image lies in plane 0 of the volume, with whole numbers of rays per voxel along a
//! and b, so that rays meet every plane alike and can share footprints.

use glam::{DMat2, DVec2};

use super::super::super::layout;
use super::super::super::view::Region;
use super::super::axis::PrincipalAxis;
use super::{RaySetup, Rays, SPLINE_MARGIN, Spacing, f2, f3, first_pixel, rays_for_depth};

/// Rays per voxel along an axis, if rays move by `shear` voxels along it from plane to plane. If that is close to a
/// whole number, the ripple and the rims of kernels in plane after plane fall on one another, and one ray per voxel
/// misses what is between.
///
/// Measured; docs/measurements/2026-11-21-rays.md has the table.
fn rays_for(shear: f64) -> u32 {
    let whole = shear.round();
    match (shear - whole).abs() {
        off if off > 0.18 || whole != 0.0 && off > 0.05 => 1,
        off if off > 0.06 || whole != 0.0 => 2,
        _ => 4,
    }
}

/// The rays of a region; `None` if none reaches the volume.
pub(super) fn rays(setup: &RaySetup<'_>, axis: &PrincipalAxis, region: Region, common: layout::Rays) -> Option<Rays> {
    let radius = setup.kernel.kernel.radius();
    let (direction, shear) = (axis.direction, axis.shear());
    let (points, spacing) = ImagePoints::new(setup, axis, region)?;
    let ImagePoints { origin, step_x, step_y, size, phases, pixel_origin, pixel_x, pixel_y } = points;
    // A kernel is a ball of the lattice: at distance v along b it reaches a ray from within row_half of row_slope v.
    let square = 1.0 - direction.x * direction.x;
    let uniforms = layout::Rays {
        origin: f2(origin),
        step_x: f2(step_x),
        step_y: f2(step_y),
        shear: f2(shear),
        direction: f3(direction),
        stretch: axis.voxel() as f32,
        row_half: (radius / square.sqrt()) as f32,
        row_slope: (direction.x * direction.y / square) as f32,
        phases,
        footprint_half: f2(footprint_half(radius, shear)),
        size,
        pixel_origin: f2(pixel_origin),
        pixel_x: f2(pixel_x),
        pixel_y: f2(pixel_y),
        ..common
    };
    Some(Rays { uniforms, spacing })
}

/// The distance along a and b, from where a ray meets a plane, within which the kernels that reach it are centred.
fn footprint_half(radius: f64, shear: DVec2) -> DVec2 {
    radius * (DVec2::ONE + shear * shear).map(f64::sqrt)
}

/// The points of the intermediate image in base coordinates, and where pixels lie among them.
struct ImagePoints {
    /// The first point, and the steps to its neighbours, in base coordinates.
    origin: DVec2,
    step_x: DVec2,
    step_y: DVec2,
    /// Points across and down.
    size: [u32; 2],
    phases: [u32; 2],
    /// The region's first pixel, and the steps to its neighbours, in points.
    pixel_origin: DVec2,
    pixel_x: DVec2,
    pixel_y: DVec2,
}

impl ImagePoints {
    /// `None` if no ray of the region reaches the volume.
    fn new(setup: &RaySetup<'_>, axis: &PrincipalAxis, region: Region) -> Option<(Self, Spacing)> {
        let shear = axis.shear();
        let volume = &setup.volume;
        // Where the ray of a pixel meets plane 0.
        let base = |p: DVec2| {
            let p = volume.placed(axis, setup.camera.target + setup.raised(p));
            DVec2::new(p.x, p.y) - shear * p.z
        };
        let corner = first_pixel(region);
        let first = base(corner);
        let [pixel_x, pixel_y] = [DVec2::X, DVec2::Y].map(|step| base(corner + step) - first);
        // Pixels that a step of one voxel along a and along b crosses.
        let to_pixels = DMat2::from_cols(pixel_x, pixel_y).inverse();
        let magnification = [to_pixels.x_axis.length(), to_pixels.y_axis.length()];
        let for_depth = rays_for_depth(setup.optics.max_depth);
        let asked = [shear.x, shear.y].map(|shear| rays_for(shear).max(for_depth));
        // If there would be as many rays as pixels, they go through the pixels, and nothing is resampled.
        let as_many = (0..2).all(|n| asked[n] > 1 && f64::from(asked[n]) >= magnification[n]);
        if setup.ray_per_pixel || asked == [4, 4] || as_many {
            let points = Self {
                origin: first,
                step_x: pixel_x,
                step_y: pixel_y,
                size: [region.width, region.height],
                phases: [1, 1],
                pixel_origin: DVec2::ZERO,
                pixel_x: DVec2::X,
                pixel_y: DVec2::Y,
            };
            return Some((points, Spacing::Pixels(1.0)));
        }
        let rays = [0, 1].map(|n| asked[n].min(magnification[n].ceil().max(1.0) as u32));
        let steps = DVec2::new(1.0 / f64::from(rays[0]), 1.0 / f64::from(rays[1]));
        // What the region sees of the volume, in base coordinates.
        let volume_ends = base_ends(setup, shear);
        let extent = DVec2::new(f64::from(region.width), f64::from(region.height)) - 1.0;
        let corners = [(0.0, 0.0), (extent.x, 0.0), (0.0, extent.y), (extent.x, extent.y)]
            .map(|(x, y)| first + pixel_x * x + pixel_y * y);
        let low = corners.iter().fold(DVec2::INFINITY, |low, &c| low.min(c)).max(volume_ends[0]);
        let high = corners.iter().fold(DVec2::NEG_INFINITY, |high, &c| high.max(c)).min(volume_ends[1]);
        if low.cmpgt(high).any() {
            return None;
        }
        // Whole steps from the ray through the first voxel of the volume: the same rays whatever part of it is packed,
        // and whatever the region.
        let anchor = volume.placed(axis, volume.grid.to_world().translation);
        let anchor = DVec2::new(anchor.x, anchor.y) - shear * anchor.z;
        let origin = anchor + steps * (((low - anchor) / steps).floor() - SPLINE_MARGIN);
        let count = ((high - origin) / steps + SPLINE_MARGIN).ceil() + 1.0;
        let (step_x, step_y) = (DVec2::new(steps.x, 0.0), DVec2::new(0.0, steps.y));
        let to_points = DMat2::from_cols(step_x, step_y).inverse();
        let points = Self {
            origin,
            step_x,
            step_y,
            size: [count.x as u32, count.y as u32],
            phases: rays,
            pixel_origin: to_points * (first - origin),
            pixel_x: to_points * pixel_x,
            pixel_y: to_points * pixel_y,
        };
        Some((points, Spacing::Voxel(rays)))
    }
}

/// The least and the largest base coordinates of rays that reach a kernel of the packed box.
fn base_ends(setup: &RaySetup<'_>, shear: DVec2) -> [DVec2; 2] {
    let dims = setup.volume.packing.dims.map(f64::from);
    let half = footprint_half(setup.kernel.kernel.radius(), shear);
    // How far rays move between the first plane and the last.
    let drift = shear * (dims[2] - 1.0);
    [-half - drift.max(DVec2::ZERO), DVec2::new(dims[0], dims[1]) - 1.0 + half - drift.min(DVec2::ZERO)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_that_move_in_step_with_the_lattice_are_closer() {
        // Along an axis, near it, away from it; near a whole shear, away from it.
        assert_eq!([0.0, 0.06, 0.1, 0.18, 0.19].map(rays_for), [4, 4, 2, 2, 1]);
        assert_eq!([0.5, 0.94, 0.96, 1.0, -1.0].map(rays_for), [1, 1, 2, 2, 2]);
    }

    #[test]
    fn footprints_widen_with_the_shear() {
        assert_eq!(footprint_half(2.0, DVec2::new(0.0, 1.0)), DVec2::new(2.0, 2.0 * 2.0_f64.sqrt()));
    }
}
