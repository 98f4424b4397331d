//! Rays through one eye: their intermediate image is parallel to the picture, and coarser where voxels are larger than
//! pixels.

use glam::{DVec2, DVec3};

use super::{
    FIRST_PIXEL, RaySetup, Rays, SPLINE_MARGIN, f2, f3, first_pixel, level_for_depth, level_for_kernel, max_depth,
    smoothstep,
};
use crate::gpu::layout;
use crate::image::Region;
use crate::painters::tiles::axis::RAY_MARGIN;
use crate::stats::RaySpacing;

/// The pixels between rays up to which each pixel has its own ray, and from which on none has: between them pixels have
/// both, so the range is narrow. Resampling costs less than a tenth of the rays of all pixels.
const OWN_RAYS: [f64; 2] = [1.05, 1.1];

/// The least share of its own ray in each pixel. The eye is at a distance from the camera's target.
pub(super) fn pixel_share(setup: &RaySetup<'_>, distance: f64) -> f64 {
    let [all, none] = OWN_RAYS;
    smoothstep(none, all, pitch(setup, distance))
}

/// The rays of pixels, numbered from the first pixel of the picture.
pub(super) fn pixel_rays(setup: &RaySetup<'_>, distance: f64, common: layout::Rays) -> Rays {
    through([FIRST_PIXEL, DVec2::ONE], setup, distance, common)
}

/// The rays of the intermediate image of a region, `None` if the axis has no share in it.
pub(super) fn image_rays(setup: &RaySetup<'_>, region: Region, distance: f64, common: layout::Rays) -> Option<Rays> {
    let pitch = pitch(setup, distance);
    // Visible matter is as a rule nearer than the far end, and has more rays a voxel. Rays that do not move in step
    // with the lattice err by a little more. Of marschner-lobb:48 at 40 degrees the margin takes oblique views from
    // 1.23e-2 to 1.1e-2; along an axis 1.26e-2 stay, where 1.2e-2 is promised.
    const MARGIN: f64 = 1.15;
    let [middle, far] = depths(setup, distance);
    let fineness = (magnification(setup, far) / pitch * (far / middle.abs()).min(2.0) * MARGIN) as f32;
    // The part of the picture in which the axis has a share.
    let part = setup.axis.part_of(setup.job.view.camera.size);
    let all =
        ((DVec2::new(f64::from(region.width), f64::from(region.height)) - 1.0) / pitch + 2.0 * SPLINE_MARGIN).ceil();
    let first = first_pixel(region) - SPLINE_MARGIN * pitch;
    // The same points whatever the part, so that none of them moves while the part does.
    let [low, high] = part.map(|end| (end - first) / pitch);
    let low = (low - SPLINE_MARGIN).floor().max(DVec2::ZERO);
    let count = (high + SPLINE_MARGIN).ceil().min(all) - low + 1.0;
    let (size, pixel_origin) = ([count.x as u32, count.y as u32], f2(SPLINE_MARGIN - low));
    let common = layout::Rays { fineness, size, pixel_origin, ..common };
    (count.min_element() >= 1.0).then(|| through([first + low * pitch, DVec2::splat(pitch)], setup, distance, common))
}

/// The rays through points, given the first point and the steps to its neighbours in pixels of the picture.
fn through([first, steps]: [DVec2; 2], setup: &RaySetup<'_>, distance: f64, common: layout::Rays) -> Rays {
    let (view, axis) = (setup.job.view, setup.axis);
    let (camera, grid) = (&view.camera, &view.grid);
    let to_lattice = grid.to_lattice().matrix3;
    let heading = |plane: DVec2| axis.ordered(to_lattice * (camera.right * plane.x + camera.up * plane.y));
    let forward = axis.ordered(to_lattice * camera.forward);
    let next = setup.plane(first + steps);
    let first = setup.plane(first);
    let [step_x, step_y] = [DVec2::new(next.x - first.x, 0.0), DVec2::new(0.0, next.y - first.y)].map(heading);
    // Places are measured from the point in plane 0, the middle one, that a ray in the middle of all that run along m
    // goes through: measured from an eye that is far away they would cancel. Let c be the heading of that ray, E the
    // eye and M = E + t c the point. A ray of heading h meets plane 0 at E + t c.m / h.m h = M + t (c.m h - h.m c) /
    // h.m. The numerator is linear in h, and 0 for h = c: it is the numerator of the difference.
    let central = forward + heading(axis.middle);
    let placed = |from_target: DVec3| setup.placed(camera.target + from_target);
    let eye = placed(-camera.forward * distance);
    // The point of that ray at the depth of the target.
    let near = placed((camera.right * axis.middle.x + camera.up * axis.middle.y) * distance);
    let t = -eye.z / central.z;
    let numerator = |difference: DVec3| ((difference * central.z - central * difference.z) * t).truncate();
    let middle = near - central * (near.z / central.z);
    // The growth where that is, and its change along the lattice.
    let (growth, most) = view.depth_growth();
    let depth = distance - near.z / central.z;
    let growth_slope = axis.ordered(grid.to_world().matrix3.transpose() * camera.forward) * growth.slope;
    let uniforms = layout::Rays {
        heading: f3(forward + heading(first)),
        heading_x: f3(step_x),
        heading_y: f3(step_y),
        origin: f2(numerator(heading(first - axis.middle))),
        step_x: f2(numerator(step_x)),
        step_y: f2(numerator(step_y)),
        middle: f2(middle.truncate()),
        // Farther than any volume has planes it makes no difference.
        eye_plane: eye.z.clamp(-1e8, 1e8) as f32,
        growth_slope: f3(growth_slope),
        growth_middle: (growth.constant + growth.slope * depth) as f32,
        // Rays in which m has a share lean by less than twice m, so that kernels reach less than twice their radius.
        growth_around: (growth_slope.truncate().length() * 2.0 * most * setup.kernel.radius()) as f32,
        slope_origin: f2(first),
        slope_step: f2(next - first),
        pixel_x: f2(DVec2::X / steps),
        pixel_y: f2(DVec2::Y / steps),
        ..common
    };
    Rays { uniforms, spacing: RaySpacing::Pixels(steps.x) }
}

/// Depths before the eye of the middle of the volume and of its far end.
fn depths(setup: &RaySetup<'_>, distance: f64) -> [f64; 2] {
    let camera = &setup.job.view.camera;
    let depths = setup.job.view.grid.corners(0.5).map(|c| (c - camera.target).dot(camera.forward) + distance);
    [depths.iter().sum::<f64>() / depths.len() as f64, depths.into_iter().fold(0.0, f64::max)]
}

/// Pixels that a voxel takes at this depth.
fn magnification(setup: &RaySetup<'_>, depth: f64) -> f64 {
    setup.job.view.grid.min_spacing() / (depth * setup.pixel())
}

/// Pixels between neighbouring points of the intermediate image.
fn pitch(setup: &RaySetup<'_>, distance: f64) -> f64 {
    let level = level_for_depth(max_depth(setup.job)).max(level_for_kernel(&setup.kernel));
    // The points around the picture are rays of one of the axes too, if they are not farther out than half the margin
    // for which axes are found.
    let [width, height] = setup.job.view.camera.size;
    let most = RAY_MARGIN / 2.0 * f64::from(width.min(height)) / SPLINE_MARGIN;
    // At the far end rays are farthest apart. They do not move in step with the lattice: one a voxel is enough where
    // it is for parallel rays.
    let [_, far] = depths(setup, distance);
    (magnification(setup, far) / level.exp2()).min(most)
}
