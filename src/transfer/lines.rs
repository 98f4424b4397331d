//! Lines of colours and of opacities, merged to control points.

use super::{ControlPoint, segment};

/// Merges the colours of one line with the opacities of another to control points. Neither line is empty.
pub(super) fn merged(colors: &[(f64, [f64; 3])], opacities: &[(f64, [f64; 1])]) -> Vec<ControlPoint> {
    let mut values: Vec<f64> = colors.iter().map(|c| c.0).chain(opacities.iter().map(|o| o.0)).collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let mut points = Vec::with_capacity(values.len());
    for value in values {
        let (color, opacity) = (sides(colors, value), sides(opacities, value));
        let point = |side: usize| ControlPoint {
            value,
            color: color[side].map(|c| c.clamp(0.0, 1.0)),
            opacity: opacity[side][0].clamp(0.0, 1.0),
        };
        points.push(point(0));
        if color[0] != color[1] || opacity[0] != opacity[1] {
            points.push(point(1));
        }
    }
    points
}

/// Returns the values of a line just below a place, and from there on.
fn sides<const N: usize>(line: &[(f64, [f64; N])], at: f64) -> [[f64; N]; 2] {
    let (first, beyond) = (line.partition_point(|p| p.0 < at), line.partition_point(|p| p.0 <= at));
    if first < beyond {
        return [line[first].1, line[beyond - 1].1];
    }
    let ((_, a), (_, b), s) = segment(line, at, |p| p.0);
    [std::array::from_fn(|c| a[c] + (b[c] - a[c]) * s); 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_meet_in_the_points_of_both() {
        let colors = [(0.0, [0.0; 3]), (10.0, [1.0; 3])];
        let opacities = [(5.0, [0.0]), (5.0, [0.5]), (20.0, [0.5])];
        let points: Vec<(f64, f64, f64)> =
            merged(&colors, &opacities).iter().map(|p| (p.value, p.color[0], p.opacity)).collect();
        assert_eq!(points, [(0.0, 0.0, 0.0), (5.0, 0.5, 0.0), (5.0, 0.5, 0.5), (10.0, 1.0, 0.5), (20.0, 1.0, 0.5)]);
    }
}
