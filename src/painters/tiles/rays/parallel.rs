//! Parallel rays, which meet every plane alike.

use glam::DVec2;

use super::{FIRST_PIXEL, RaySetup, f2, f3};
use crate::gpu::layout;

/// Returns the rays of pixels, numbered from the first pixel of the picture.
pub(super) fn rays(setup: &RaySetup<'_>, common: layout::Rays) -> layout::Rays {
    let [origin, step_x, step_y] = pixels_at(setup, FIRST_PIXEL);
    let radius = setup.kernel.radius();
    let (direction, shear) = (setup.axis.direction, setup.axis.shear());
    // A kernel is a ball of the lattice: at distance v along b it reaches a ray from within row_half of row_slope v.
    let square = 1.0 - direction.x * direction.x;
    layout::Rays {
        origin: f2(origin),
        step_x: f2(step_x),
        step_y: f2(step_y),
        shear: f2(shear),
        direction: f3(direction),
        stretch: setup.axis.stretch as f32,
        row_half: (radius / square.sqrt()) as f32,
        row_slope: (direction.x * direction.y / square) as f32,
        footprint_half: f2(footprint_half(radius, shear)),
        ..common
    }
}

/// Returns the point at which the ray of a pixel meets plane 0, and the steps to its neighbours' points in x and y.
fn pixels_at(setup: &RaySetup<'_>, pixel: DVec2) -> [DVec2; 3] {
    let shear = setup.axis.shear();
    let base = |p: DVec2| {
        let (camera, plane) = (&setup.job.view.camera, setup.plane(p));
        let p = setup.placed(camera.target + (camera.right * plane.x + camera.up * plane.y));
        p.truncate() - shear * p.z
    };
    let first = base(pixel);
    [first, base(pixel + DVec2::X) - first, base(pixel + DVec2::Y) - first]
}

/// Returns the distance along a and b, from where a ray meets a plane, within which the kernels that reach it are
/// centred.
fn footprint_half(radius: f64, shear: DVec2) -> DVec2 {
    radius * (DVec2::ONE + shear * shear).map(f64::sqrt)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn footprints_widen_with_the_shear() {
        assert_eq!(footprint_half(2.0, DVec2::new(0.0, 1.0)), DVec2::new(2.0, 2.0 * 2.0_f64.sqrt()));
    }
}
