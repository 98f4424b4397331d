//! Curves between points, approximated by straight lines between more points.

use super::space::ColorSpace;
use crate::transfer::TransferFunction;

/// The largest distance of a straight line from the curve in a channel: a quarter of an 8-bit step.
const TOLERANCE: f64 = 1e-3;

/// The largest number of halvings of a stretch between two points.
const HALVINGS: u32 = 12;

/// A point of a curve, with the course of the curve to the next point in VTK's terms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VtkNode<const N: usize> {
    pub(super) at: f64,
    pub(super) value: [f64; N],
    /// The place between this point and the next, 0 to 1, at which the value is half way.
    pub(super) midpoint: f64,
    /// The sharpness of the course to the next point: 0 is a straight line, 1 nearly a step at the midpoint.
    pub(super) sharpness: f64,
}

impl<const N: usize> VtkNode<N> {
    /// Makes a point with a straight line to the next.
    pub(super) fn plain(at: f64, value: [f64; N]) -> Self {
        Self { at, value, midpoint: 0.5, sharpness: 0.0 }
    }

    /// Returns the share of the next point in the value at the share `s` of the way (`vtkPiecewiseFunction::GetTable`).
    fn share(&self, s: f64) -> f64 {
        let middle = self.midpoint.clamp(1e-5, 1.0 - 1e-5);
        let s = if s < middle { 0.5 * s / middle } else { 0.5 + 0.5 * (s - middle) / (1.0 - middle) };
        if self.sharpness < 0.01 {
            return s;
        }
        let steep = 1.0 + 10.0 * self.sharpness;
        let s = if s < 0.5 { 0.5 * libm::pow(2.0 * s, steep) } else { 1.0 - 0.5 * libm::pow(2.0 * (1.0 - s), steep) };
        // A cubic with the same slope at both ends.
        let (ss, sss) = (s * s, s * s * s);
        (3.0 * ss - 2.0 * sss + (2.0 * sss - 3.0 * ss + s) * (1.0 - self.sharpness)).clamp(0.0, 1.0)
    }
}

impl VtkNode<3> {
    /// Makes points of colour from (value, red, green, blue), with straight lines between them.
    pub(super) fn colors(rows: &[[f64; 4]]) -> Vec<Self> {
        rows.iter().map(|&[at, r, g, b]| Self::plain(at, [r, g, b])).collect()
    }
}

/// A line through points, values ascending; two points at one value are a step.
type Line<const N: usize> = Vec<(f64, [f64; N])>;

/// Returns the line of a curve of opacities.
pub(super) fn opacities(nodes: Vec<VtkNode<1>>) -> Line<1> {
    line(nodes, false, |a, b, s| [(1.0 - s) * a[0] + s * b[0]])
}

/// Returns the line of a curve of colours.
pub(super) fn colors(nodes: Vec<VtkNode<3>>, space: ColorSpace) -> Line<3> {
    line(nodes, space == ColorSpace::Step, |a, b, s| space.between(a, b, s))
}

fn line<const N: usize>(
    mut nodes: Vec<VtkNode<N>>,
    steps: bool,
    between: impl Fn([f64; N], [f64; N], f64) -> [f64; N],
) -> Line<N> {
    // Like VTK; points at the same place stay in order.
    nodes.sort_by(|a, b| a.at.total_cmp(&b.at));
    let mut line = Vec::with_capacity(nodes.len());
    for (i, node) in nodes.iter().enumerate() {
        line.push((node.at, node.value));
        let Some(next) = nodes.get(i + 1).filter(|next| next.at > node.at) else { continue };
        if steps {
            line.push((node.at, next.value));
            continue;
        }
        let at = |s: f64| node.at + (next.at - node.at) * s;
        let curve = |s: f64| between(node.value, next.value, node.share(s));
        // A longer line is refused later.
        let halvings = if line.len() > TransferFunction::MAX_POINTS { 0 } else { HALVINGS };
        halve(&curve, [0.0, 1.0], [node.value, next.value], halvings, &mut |s, value| line.push((at(s), value)));
    }
    line
}

/// Adds to `out` the points within a stretch of a curve that a line needs.
fn halve<const N: usize>(
    curve: &impl Fn(f64) -> [f64; N],
    [from, to]: [f64; 2],
    [first, last]: [[f64; N]; 2],
    halvings: u32,
    out: &mut impl FnMut(f64, [f64; N]),
) {
    let off = |share: f64| {
        let value = curve(from + (to - from) * share);
        (0..N).map(|c| (value[c] - first[c] - (last[c] - first[c]) * share).abs()).fold(0.0, f64::max)
    };
    if halvings == 0 || (1..8).all(|eighths| off(f64::from(eighths) / 8.0) <= TOLERANCE) {
        return;
    }
    let middle = f64::midpoint(from, to);
    let value = curve(middle);
    halve(curve, [from, middle], [first, value], halvings - 1, out);
    out(middle, value);
    halve(curve, [middle, to], [value, last], halvings - 1, out);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_take_the_points_that_they_need() {
        let node = |at, value, sharpness| VtkNode { at, value: [value], midpoint: 0.25, sharpness };
        assert_eq!(
            opacities(vec![VtkNode::plain(4.0, [1.0]), VtkNode::plain(0.0, [0.0])]),
            [(0.0, [0.0]), (4.0, [1.0])]
        );
        for sharpness in [0.5, 1.0] {
            let curved = opacities(vec![node(0.0, 0.0, sharpness), node(4.0, 1.0, 0.0)]);
            assert!((8..80).contains(&curved.len()) && curved.is_sorted_by(|a, b| a.0 <= b.0), "{curved:?}");
        }
        let steps = colors(vec![VtkNode::plain(0.0, [0.1; 3]), VtkNode::plain(1.0, [0.2; 3])], ColorSpace::Step);
        assert_eq!(steps, [(0.0, [0.1; 3]), (0.0, [0.2; 3]), (1.0, [0.2; 3])]);
        // A line that is too long for a function gets no further points.
        let many = (0..20_000).map(|i| node(f64::from(i), f64::from(i % 2), 0.5)).collect();
        assert!(opacities(many).len() < 40_000);
    }
}
