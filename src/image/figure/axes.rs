//! The axes of the world as the camera sees them, with the letters of the patient or of the world.

use glam::{DVec2, DVec3};

use super::canvas::Canvas;
use super::path::Path;
use crate::camera::Camera;

/// An end of an axis of the world.
#[derive(Debug, PartialEq)]
pub(super) struct End {
    /// The name of the end; `None` if the name would lie on other names.
    pub(super) name: Option<&'static str>,
    /// Whether a line leads to the end.
    pub(super) line: bool,
    /// The axis of the world, 0 to 2.
    axis: usize,
    /// The place of the end, right and up: of length 1 if it lies in the picture's plane.
    pub(super) place: DVec2,
    /// The distance of the end behind the picture's plane; negative in front of it.
    depth: f64,
}

/// Names of the ends of the world's axes, the positive ones first. Patient space is DICOM's.
const PATIENT: [[&str; 2]; 3] = [["L", "R"], ["P", "A"], ["S", "I"]];
const WORLD: [[&str; 2]; 3] = [["X", "−X"], ["Y", "−Y"], ["Z", "−Z"]];

/// An axis with ends closer to the middle than this is seen along its length: only its near end has a name.
const ALONG: f64 = 0.4;

/// The colours of the axes: red, green and blue, of one luminance that is visible on black and on white.
pub(super) const COLORS: [[f64; 3]; 3] = [[0.87, 0.26, 0.24], [0.16, 0.57, 0.26], [0.24, 0.46, 0.93]];

/// Returns the ends of the axes, the farthest first.
pub(super) fn ends(camera: &Camera, is_patient: bool) -> Vec<End> {
    let [right, up, forward] = [camera.right, camera.up, camera.forward].map(DVec3::normalize_or_zero);
    let end = |axis: usize, positive: bool| {
        let direction = if positive { DVec3::AXES[axis] } else { -DVec3::AXES[axis] };
        let place = DVec2::new(direction.dot(right), direction.dot(up));
        let depth = direction.dot(forward);
        let (along, is_near) = (place.length() < ALONG, depth < 0.0);
        let line = is_patient || positive;
        let named = if along { is_near } else { line };
        let names = if is_patient { PATIENT } else { WORLD };
        End { name: named.then_some(names[axis][usize::from(!positive)]), line, axis, place, depth }
    };
    let mut ends: Vec<End> = (0..3).flat_map(|axis| [end(axis, true), end(axis, false)]).collect();
    ends.sort_by(|a, b| b.depth.total_cmp(&a.depth));
    ends
}

/// Returns the side of the square of the axes.
pub(super) fn room(em: f64) -> f64 {
    6.0 * em
}

/// Draws the axes in a square, given its lower left corner.
pub(super) fn draw(canvas: &mut Canvas, camera: &Camera, is_patient: bool, corner: DVec2) {
    let em = canvas.em;
    let radius = 1.9 * em;
    let middle = corner + DVec2::new(1.0, -1.0) * (radius + 1.1 * em);
    let ends = ends(camera, is_patient);
    let down = |place: DVec2| DVec2::new(place.x, -place.y);
    for end in ends.iter().filter(|end| end.line && end.place.length() > 0.05) {
        let width = if end.depth > 1e-6 { 0.11 } else { 0.17 } * em;
        let line = Path::line(&[middle, middle + radius * down(end.place)], width.max(1.2));
        canvas.fill_with_halo(&line, COLORS[end.axis]);
    }
    for end in &ends {
        if let Some(name) = end.name {
            // Beyond the end of the line; of an axis seen along its length, in the middle.
            let beyond = end.place.normalize_or_zero() * 0.75 * em * (end.place.length() / ALONG).min(1.0);
            canvas.write(name, em, middle + down(radius * end.place + beyond), 0.5);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::View;
    use crate::volume::Grid;

    /// Returns the names, each with its place in whole numbers: right, up.
    fn names(view: View, is_patient: bool) -> Vec<(&'static str, [i32; 2])> {
        let grid = Grid::axis_parallel([2; 3], [1.0; 3]).unwrap();
        let ends = ends(&Camera::new(&view, &grid, [64, 64]).unwrap(), is_patient);
        let whole = |end: &End| Some((end.name?, end.place.round().to_array().map(|c| c as i32)));
        let mut names: Vec<_> = ends.iter().filter_map(whole).collect();
        names.sort_unstable();
        names
    }

    #[test]
    fn the_patient_is_seen_as_radiologists_expect() {
        // Face to face: the patient's left is on the right.
        let front = names(View::default(), true);
        assert_eq!(front, [("A", [0, 0]), ("I", [0, -1]), ("L", [1, 0]), ("R", [-1, 0]), ("S", [0, 1])]);
        let back = names(View { azimuth: 180.0, ..View::default() }, true);
        assert_eq!(back, [("I", [0, -1]), ("L", [-1, 0]), ("P", [0, 0]), ("R", [1, 0]), ("S", [0, 1])]);
        // The eye is turned towards +x, the patient's left.
        let left = names(View { azimuth: 90.0, ..View::default() }, true);
        assert_eq!(left, [("A", [-1, 0]), ("I", [0, -1]), ("L", [0, 0]), ("P", [1, 0]), ("S", [0, 1])]);
        let above = names(View { elevation: 90.0, ..View::default() }, true);
        assert_eq!(above, [("A", [0, -1]), ("L", [1, 0]), ("P", [0, 1]), ("R", [-1, 0]), ("S", [0, 0])]);
        // From the feet, as slices are shown: the nose up, the patient's left on the right.
        let slices = View { direction: Some(DVec3::Z), up: DVec3::NEG_Y, ..View::default() };
        let slices = names(slices, true);
        assert_eq!(slices, [("A", [0, 1]), ("I", [0, 0]), ("L", [1, 0]), ("P", [0, -1]), ("R", [-1, 0])]);
    }

    #[test]
    fn axes_of_the_world_are_right_handed() {
        assert_eq!(names(View::default(), false), [("X", [1, 0]), ("Z", [0, 1]), ("−Y", [0, 0])]);
        let above = names(View { elevation: 90.0, ..View::default() }, false);
        assert_eq!(above, [("X", [1, 0]), ("Y", [0, 1]), ("Z", [0, 0])]);
        let rolled = names(View { roll: 90.0, ..View::default() }, false);
        // The camera turns counter-clockwise, and the picture clockwise.
        assert_eq!(rolled, [("X", [0, -1]), ("Z", [1, 0]), ("−Y", [0, 0])]);
        // Three axes of an oblique view, anticlockwise seen from where all are positive.
        let grid = Grid::axis_parallel([2; 3], [1.0; 3]).unwrap();
        let view = View { direction: Some(-DVec3::ONE), ..View::default() };
        let ends = ends(&Camera::new(&view, &grid, [64, 64]).unwrap(), false);
        let place = |name: &str| ends.iter().find(|end| end.name == Some(name)).unwrap().place;
        assert!(place("X").perp_dot(place("Y")) > 0.1 && place("Y").perp_dot(place("Z")) > 0.1);
        assert_eq!(ends.iter().filter(|end| end.name.is_some()).count(), 3);
    }
}
