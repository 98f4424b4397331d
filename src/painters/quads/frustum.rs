//! The part of space that a region of a picture shows.

use crate::camera::clip::{Side, corners};
use crate::gpu::view::ViewGeometry;
use crate::image::Region;

/// Returns the planes that bound the space that a region shows.
pub(super) fn sides(view: &ViewGeometry, region: Region) -> Vec<Side> {
    let (scale, origin) = view.camera.pixels();
    let plane = |axis: usize, pixel: f64| origin[axis] + pixel * scale[axis];
    let ends = |axis: usize, first: u32, length: u32| {
        // A pixel more: quads are padded.
        let (a, b) = (plane(axis, f64::from(first) - 1.0), plane(axis, f64::from(first + length) + 1.0));
        [a.min(b), a.max(b)]
    };
    let (x, y) = (ends(0, region.x, region.width), ends(1, region.y, region.height));
    // In view coordinates: coordinate - slope z >= end, and the other way round.
    let side = |axis: usize, end: f64, sign: f64| {
        let (slope, constant) = if view.is_perspective() { (end, end * view.eye_depth) } else { (0.0, end) };
        ((view.gradients[axis] - slope * view.gradients[2]) * sign, (view.offset[axis] - constant) * sign)
    };
    let mut sides = vec![side(0, x[0], 1.0), side(0, x[1], -1.0), side(1, y[0], 1.0), side(1, y[1], -1.0)];
    if view.is_perspective() {
        sides.push((view.gradients[2], view.eye_depth));
    }
    sides
}

/// Returns the least and the largest view depth of the part of a volume that the picture shows; `None` if there is no
/// such part.
pub(super) fn visible_depths(view: &ViewGeometry) -> Option<[f64; 2]> {
    let [width, height] = view.camera.size;
    let mut planes = sides(view, Region { x: 0, y: 0, width, height });
    planes.extend(view.shown());
    let depths = corners(&planes).into_iter().map(|corner| view.gradients[2].dot(corner));
    depths.fold(None, |range, depth| {
        Some(range.map_or([depth; 2], |[low, high]: [f64; 2]| [low.min(depth), high.max(depth)]))
    })
}
