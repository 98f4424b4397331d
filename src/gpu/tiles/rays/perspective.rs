//! Rays through one eye: their intermediate image is parallel to the picture, and coarser where voxels are larger than
//! pixels.

use glam::DVec2;

use super::super::super::layout;
use super::super::super::view::Region;
use super::super::axis::{PrincipalAxis, RAY_MARGIN};
use super::{RaySetup, Rays, SPLINE_MARGIN, Spacing, f2, f3, first_pixel, rays_for_depth};

/// The fewest pixels between rays of which not each is the ray of a pixel: resampling costs about as much as the rays
/// that a smaller distance would save.
const MIN_PITCH: f64 = 1.25;

/// Rays per voxel by the number that parallel rays would have. These rays do not move in step with the lattice, so 1.5
/// do where parallel rays need 2. The error is in docs/measurements/2026-11-21-painters.md.
const RAYS_PER_VOXEL: [f64; 3] = [1.5, 2.0, 3.0];

/// The rays of a region; the eye is at a distance from the camera's target.
pub(super) fn rays(
    setup: &RaySetup<'_>,
    axis: &PrincipalAxis,
    region: Region,
    distance: f64,
    common: layout::Rays,
) -> Rays {
    let (camera, grid) = (setup.camera, setup.volume.grid);
    let to_lattice = grid.to_lattice().matrix3;
    let heading = |p: DVec2| axis.ordered(to_lattice * (camera.forward + setup.raised(p)));
    // Pixels that a voxel takes at the far end of the volume, where it takes the fewest.
    let depths = grid.corners(0.5).map(|c| (c - camera.target).dot(camera.forward) + distance);
    let farthest = depths.into_iter().fold(0.0, f64::max);
    let magnification = grid.min_spacing() / (farthest * setup.pixel());
    let points = ImagePoints::new(setup, magnification, region);
    let first = heading(points.first);
    let next = points.first + points.pitch;
    let uniforms = layout::Rays {
        heading: f3(first),
        heading_x: f3(heading(points.first + DVec2::X * points.pitch) - first),
        heading_y: f3(heading(points.first + DVec2::Y * points.pitch) - first),
        eye: f3(setup.volume.placed(axis, camera.target - camera.forward * distance)),
        slope_origin: f2(setup.plane(points.first)),
        slope_step: f2(setup.plane(next) - setup.plane(points.first)),
        size: points.size,
        pixel_origin: f2(points.pixel_origin),
        pixel_x: f2(DVec2::X / points.pitch),
        pixel_y: f2(DVec2::Y / points.pitch),
        ..common
    };
    Rays { uniforms, spacing: Spacing::Pixels(points.pitch) }
}

/// The points of the intermediate image.
struct ImagePoints {
    /// Pixels between neighbouring points; 1: the points are the pixels.
    pitch: f64,
    /// The first point, in pixels of the picture.
    first: DVec2,
    /// Points across and down.
    size: [u32; 2],
    /// The middle of the region's first pixel, in points.
    pixel_origin: DVec2,
}

impl ImagePoints {
    /// The points for voxels that take at least `magnification` pixels.
    fn new(setup: &RaySetup<'_>, magnification: f64, region: Region) -> Self {
        let corner = first_pixel(region);
        let rays = RAYS_PER_VOXEL[rays_for_depth(setup.optics.max_depth) as usize - 1];
        // The points around the picture are rays of one of the axes too, if they are not farther out than half the
        // margin for which axes are found.
        let [width, height] = setup.size;
        let pitch = (magnification / rays).min(RAY_MARGIN / 2.0 * f64::from(width.min(height)) / SPLINE_MARGIN);
        let sides = [region.width, region.height];
        if setup.ray_per_pixel || pitch < MIN_PITCH {
            return Self { pitch: 1.0, first: corner, size: sides, pixel_origin: DVec2::ZERO };
        }
        let size = sides.map(|side| ((f64::from(side) - 1.0) / pitch + 2.0 * SPLINE_MARGIN).ceil() as u32 + 1);
        Self { pitch, first: corner - SPLINE_MARGIN * pitch, size, pixel_origin: DVec2::splat(SPLINE_MARGIN) }
    }
}
