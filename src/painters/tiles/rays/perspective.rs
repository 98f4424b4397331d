//! Rays through one eye.

use glam::{DVec2, DVec3};

use super::{FIRST_PIXEL, RaySetup, f2, f3};
use crate::gpu::layout;

/// Returns the rays of pixels, numbered from the first pixel of the picture. The eye is at a distance from the camera's
/// target.
pub(super) fn rays(setup: &RaySetup<'_>, distance: f64, common: layout::Rays) -> layout::Rays {
    let (view, axis) = (setup.job.view, setup.axis);
    let (camera, grid) = (&view.camera, &view.grid);
    let to_lattice = grid.to_lattice().matrix3;
    let heading = |plane: DVec2| axis.ordered(to_lattice * (camera.right * plane.x + camera.up * plane.y));
    let forward = axis.ordered(to_lattice * camera.forward);
    let [first, next] = [FIRST_PIXEL, FIRST_PIXEL + 1.0].map(|pixel| setup.plane(pixel));
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
    layout::Rays {
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
        ..common
    }
}
