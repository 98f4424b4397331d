//! Lines of colours and of opacities, put together.

use super::ControlPoint;

/// Control points that have the colours of one line and the opacities of another. Neither is empty.
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

/// What a line is just below a value, and from there on.
fn sides<const N: usize>(line: &[(f64, [f64; N])], value: f64) -> [[f64; N]; 2] {
    let (first, beyond) = (line.partition_point(|p| p.0 < value), line.partition_point(|p| p.0 <= value));
    if first < beyond {
        return [line[first].1, line[beyond - 1].1];
    }
    let between = match (first.checked_sub(1), line.get(first)) {
        (Some(a), Some(b)) => {
            let a = line[a];
            let s = (value - a.0) / (b.0 - a.0);
            std::array::from_fn(|c| a.1[c] + (b.1[c] - a.1[c]) * s)
        }
        (Some(a), None) => line[a].1,
        (None, _) => line[0].1,
    };
    [between; 2]
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
