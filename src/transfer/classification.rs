//! How pre-shading classifies voxels of scalars: at a point, or band-limited.

use super::{ControlPoint, TransferFunction};
use crate::error::Error;
use voxsplat_volume::names::named;

/// How pre-shading classifies a voxel of scalars.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Classification {
    /// [`Self::Point`] if two control points at one value make a step, otherwise [`Self::BandLimited`].
    #[default]
    Auto,
    /// Colour and extinction are those of the sample. Where a transfer function is steep, the classified voxels change
    /// faster than a lattice can hold, and smooth surfaces show rings.
    Point,
    /// Colour and extinction are the mean over the values that occur around the voxel, see
    /// [`TransferFunction::with_classification`].
    BandLimited,
}

named!("classification", Classification { Auto: "auto", Point: "point", BandLimited: "band-limited" });

impl TransferFunction {
    /// Returns the same function with a way to classify voxels in pre-shading; [`Classification::Auto`] without it.
    ///
    /// Band-limited, the emission of a voxel with value f is the mean of its means over two boxes of values:
    ///
    /// ```text
    /// [max(f - d, lowest neighbour), f]   and   [f, min(f + d, highest neighbour)]
    /// ```
    ///
    /// The neighbours are the six next voxels along the axes of the lattice, and d is the length of the gradient by
    /// their central differences, in values per voxel. A box without width counts as f itself, at a step too. Emission
    /// is extinction, and colour times extinction. Gradient opacity then multiplies it. Post-shading and projections
    /// of intensity have no voxels to classify, and ignore the choice.
    #[must_use]
    pub fn with_classification(self, classification: Classification) -> Self {
        Self { classification, ..self }
    }

    /// Returns the way to classify voxels in pre-shading.
    #[must_use]
    pub fn classification(&self) -> Classification {
        self.classification
    }

    /// Returns whether pre-shading classifies voxels band-limited.
    #[must_use]
    pub fn is_band_limited(&self) -> bool {
        let is_step = |[a, b]: &[ControlPoint; 2]| {
            a.value == b.value && (a.opacity != b.opacity || a.color != b.color && a.opacity > 0.0)
        };
        match self.classification {
            Classification::Auto => !self.points.array_windows().any(is_step),
            Classification::Point => false,
            Classification::BandLimited => true,
        }
    }

    /// The emission of a value in a slab one unit distance thick: colour times optical depth, optical depth.
    fn emission(&self, value: f64) -> [f64; 4] {
        let ([r, g, b], opacity) = self.sample(value);
        let depth = Self::extinction(opacity, 1.0);
        [r * depth, g * depth, b * depth, depth]
    }
}

/// A place between which emission is linear in the value.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    pub(crate) place: f64,
    /// Colour times optical depth, optical depth, of a slab one unit distance thick.
    pub(crate) emission: [f64; 4],
    /// The integral of emission from the first node.
    pub(crate) integral: [f64; 4],
}

/// The emission of a transfer function as linear pieces, for means over values. Of several nodes at one place the last
/// holds from there on; emission is constant beyond the ends.
#[derive(Debug, Clone)]
pub(crate) struct Pieces {
    nodes: Vec<Node>,
    /// For each cell of places, the number of nodes in the cells before it.
    before: Vec<u32>,
    first: f64,
    cells_per_unit: f64,
    /// The range of places outside of which nothing is visible.
    visible: [f64; 2],
}

/// The error of a piece over its own emission and 1/64 of the largest emission. 2^-12.
const TOLERANCE: f64 = 1.0 / 4096.0;
/// The most halvings of a segment between control points.
const HALVINGS: u32 = 12;

/// The middle of two emissions.
fn middle(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [0, 1, 2, 3].map(|c| (a[c] + b[c]) / 2.0)
}

impl Pieces {
    /// The pieces of a function of places, given the place of each value: an ascending map.
    pub(crate) fn new(transfer: &TransferFunction, place: impl Fn(f64) -> f64) -> Self {
        let knots = transfer.knots();
        let most = TransferFunction::extinction(transfer.max_opacity(), 1.0);
        let of_knot = |knot: &ControlPoint| {
            let depth = TransferFunction::extinction(knot.opacity, 1.0);
            let [r, g, b] = knot.color;
            [r * depth, g * depth, b * depth, depth]
        };
        let mut ends = vec![(knots[0].value, of_knot(&knots[0]))];
        for [a, b] in knots.array_windows() {
            if a.value < b.value {
                halve(transfer, [(a.value, of_knot(a)), (b.value, of_knot(b))], most, HALVINGS, &mut ends);
            }
            ends.push((b.value, of_knot(b)));
        }
        let mut nodes: Vec<Node> = Vec::with_capacity(ends.len());
        for (value, emission) in ends {
            let place = place(value);
            let integral = nodes.last().map_or([0.0; 4], |last| {
                let mean = middle(last.emission, emission);
                [0, 1, 2, 3].map(|c| last.integral[c] + (place - last.place) * mean[c])
            });
            nodes.push(Node { place, emission, integral });
        }
        Self::of_nodes(nodes)
    }

    fn of_nodes(nodes: Vec<Node>) -> Self {
        let (first, last) = (nodes[0], nodes[nodes.len() - 1]);
        let cells = 4 * nodes.len();
        let width = last.place - first.place;
        let cells_per_unit = if width > 0.0 { (cells - 1) as f64 / width } else { 0.0 };
        let is_clear = |node: &Node| node.emission[3] <= 0.0;
        let clear_below = nodes.iter().take_while(|node| is_clear(node)).last();
        let clear_above = nodes.iter().rev().take_while(|node| is_clear(node)).last();
        let visible = [
            clear_below.map_or(f64::NEG_INFINITY, |node| node.place),
            clear_above.map_or(f64::INFINITY, |node| node.place),
        ];
        let mut pieces = Self { before: vec![0; cells], first: first.place, cells_per_unit, visible, nodes };
        for node in &pieces.nodes {
            let cell = pieces.cell(node.place);
            pieces.before[cell + 1..].iter_mut().for_each(|count| *count += 1);
        }
        pieces
    }

    /// The number of the cell of a place: it does not descend with the place.
    fn cell(&self, place: f64) -> usize {
        (((place - self.first) * self.cells_per_unit) as usize).min(self.before.len() - 1)
    }

    pub(crate) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The number of nodes that are not above a place.
    fn below(&self, place: f64) -> usize {
        let mut below = self.before[self.cell(place)] as usize;
        while self.nodes.get(below).is_some_and(|node| node.place <= place) {
            below += 1;
        }
        below
    }

    /// The emission of a place, given the number of nodes that are not above it.
    fn at(&self, below: usize, place: f64) -> [f64; 4] {
        let Some(a) = below.checked_sub(1).map(|last| &self.nodes[last]) else { return self.nodes[0].emission };
        let Some(b) = self.nodes.get(below) else { return a.emission };
        let share = (place - a.place) / (b.place - a.place);
        [0, 1, 2, 3].map(|c| a.emission[c] + (b.emission[c] - a.emission[c]) * share)
    }

    /// The mean emission between two places; of equal places the emission there.
    fn mean(&self, low: f64, high: f64) -> [f64; 4] {
        let from = self.below(low);
        if low >= high {
            return self.at(from, low);
        }
        let to = from + self.nodes[from..].iter().take_while(|node| node.place <= high).count();
        if from == to {
            return self.at(from, f64::midpoint(low, high));
        }
        let (a, b) = (&self.nodes[from], &self.nodes[to - 1]);
        let start = self.at(from, f64::midpoint(low, a.place));
        let end = self.at(to, f64::midpoint(b.place, high));
        let width = (high - low).recip();
        [0, 1, 2, 3].map(|c| {
            let whole = b.integral[c] - a.integral[c];
            (start[c] * (a.place - low) + whole + end[c] * (high - b.place)) * width
        })
    }

    /// The band-limited emission of a voxel, given its place, those of the lowest and of the highest of its neighbours,
    /// and the length of its gradient.
    pub(crate) fn emission(&self, place: f64, [lowest, highest]: [f64; 2], rise: f64) -> [f64; 4] {
        let low = (place - rise).max(lowest).min(place);
        let high = (place + rise).min(highest).max(place);
        if high < self.visible[0] || low > self.visible[1] {
            return [0.0; 4];
        }
        middle(self.mean(low, place), self.mean(place, high))
    }
}

/// Adds the ends between those of a segment at which it is cut into pieces that are linear enough.
fn halve(
    transfer: &TransferFunction,
    [(a, of_a), (b, of_b)]: [(f64, [f64; 4]); 2],
    most: f64,
    halvings: u32,
    ends: &mut Vec<(f64, [f64; 4])>,
) {
    let value = f64::midpoint(a, b);
    let emission = transfer.emission(value);
    let linear = middle(of_a, of_b);
    let error = (0..4).map(|c| (emission[c] - linear[c]).abs()).fold(0.0, f64::max);
    if halvings == 0 || !(a < value && value < b) || error <= TOLERANCE * (emission[3] + most / 64.0) {
        return;
    }
    halve(transfer, [(a, of_a), (value, emission)], most, halvings - 1, ends);
    ends.push((value, emission));
    halve(transfer, [(value, emission), (b, of_b)], most, halvings - 1, ends);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::quadrature::integrate;

    fn function(points: &[(f64, f64)]) -> TransferFunction {
        let point = |&(value, opacity): &(f64, f64)| {
            let share = (value / 300.0).clamp(0.0, 1.0);
            ControlPoint { value, color: [share, 1.0 - share, 0.5], opacity }
        };
        TransferFunction::new(points.iter().map(point).collect(), None).unwrap()
    }

    #[test]
    fn means_over_pieces_are_those_of_the_function() {
        let ramp = function(&[(100.0, 0.0), (120.0, 0.7), (200.0, 0.1), (201.0, 0.999), (250.0, 0.999)]);
        let pieces = Pieces::new(&ramp, |value| value);
        assert!(pieces.nodes().len() < 200, "{}", pieces.nodes().len());
        let most = TransferFunction::extinction(0.999, 1.0);
        for low in (90..260).map(|value| f64::from(value) + 0.37) {
            for width in [1e-9, 0.01, 0.4, 3.0, 50.0, 200.0] {
                let mean = pieces.mean(low, low + width);
                for (c, mean) in mean.into_iter().enumerate() {
                    let exact = integrate(low, low + width, 4096, |v| ramp.emission(v)[c]) / width;
                    assert!((mean - exact).abs() <= TOLERANCE * (exact + most / 32.0), "{low} {width} {mean} {exact}");
                }
            }
        }
    }

    #[test]
    fn boxes_end_at_the_neighbours_and_an_empty_one_is_the_value() {
        let step = function(&[(10.0, 0.0), (10.0, 0.5)]);
        let pieces = Pieces::new(&step, |value| value);
        let depth = |place, neighbours, rise| pieces.emission(place, neighbours, rise)[3] / 0.5_f64.recip().ln();
        // A share of each half above the step; no half is wider than to the neighbour, and the later point holds.
        assert_eq!(depth(9.0, [0.0, 20.0], 2.0), 0.25);
        assert_eq!(depth(9.0, [0.0, 9.5], 2.0), 0.0);
        assert_eq!(depth(10.0, [0.0, 20.0], 2.0), 0.5);
        assert_eq!(depth(10.0, [0.0, 20.0], 0.0), 1.0);
        assert_eq!(depth(11.0, [11.0, 11.0], 5.0), 1.0);
    }

    #[test]
    fn steps_are_points_unless_requested() {
        let ramp = function(&[(0.0, 0.0), (1.0, 0.5)]);
        let step = function(&[(0.0, 0.0), (1.0, 0.0), (1.0, 0.5)]);
        assert!(ramp.is_band_limited() && !step.is_band_limited());
        assert!(!ramp.with_classification(Classification::Point).is_band_limited());
        assert!(step.with_classification(Classification::BandLimited).is_band_limited());
    }
}
