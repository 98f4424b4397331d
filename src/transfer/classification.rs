//! The classification of voxels of scalars in pre-shading: at a point, or band-limited.

use super::{ControlPoint, TransferFunction};
use crate::error::Error;
use voxsplat_volume::names::named;

/// The classification of a voxel of scalars in pre-shading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Classification {
    /// The choice of the library: [`Self::Point`] if two control points at one value make a step, otherwise
    /// [`Self::BandLimited`].
    #[default]
    Auto,
    /// Colour and extinction at the value of the sample. Where a transfer function is steep, the classified voxels
    /// change faster than a lattice can hold, and smooth surfaces show rings.
    Point,
    /// Mean colour and extinction over the values that occur around the voxel, see
    /// [`TransferFunction::with_classification`].
    BandLimited,
}

named!("classification", Classification { Auto: "auto", Point: "point", BandLimited: "band-limited" });

impl TransferFunction {
    /// Returns the function with a classification of voxels in pre-shading; [`Classification::Auto`] without it.
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

    /// Returns the classification of voxels in pre-shading.
    #[must_use]
    pub fn classification(&self) -> Classification {
        self.classification
    }

    /// Returns whether pre-shading classifies voxels band-limited.
    #[must_use]
    pub fn is_band_limited(&self) -> bool {
        let is_step = |(a, b): (&ControlPoint, &ControlPoint)| {
            a.value == b.value && (a.opacity != b.opacity || a.color != b.color && a.opacity > 0.0)
        };
        match self.classification {
            Classification::Auto => !self.points.iter().zip(&self.points[1..]).any(is_step),
            Classification::Point => false,
            Classification::BandLimited => true,
        }
    }

    /// Returns whether the classification of a voxel depends on the next voxels.
    pub(crate) fn depends_on_neighbours(&self) -> bool {
        self.is_band_limited() || !self.gradient.is_empty()
    }

    fn emission(&self, value: f64) -> Emission {
        let (color, opacity) = self.sample(value);
        Self::emission_of(color, opacity)
    }

    fn emission_of([r, g, b]: [f64; 3], opacity: f64) -> Emission {
        let depth = Self::extinction(opacity, 1.0);
        [r * depth, g * depth, b * depth, depth]
    }
}

/// The emission of a slab one unit distance thick: colour times optical depth, and optical depth.
type Emission = [f64; 4];

/// A node of [`Pieces`]: the begin of a piece, in which emission is `emission` + `slope` t + `bend` t^2, t from 0 to 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    pub(crate) place: f64,
    pub(crate) emission: Emission,
    pub(crate) slope: Emission,
    pub(crate) bend: Emission,
    /// The integral of emission from the first node.
    pub(crate) integral: Emission,
    /// The inverse of the width of the piece; 0 beyond the last node, and between nodes at one place.
    inverse: f64,
}

/// The emission of a transfer function as parabolas, for means over values. Of several nodes at one place the last
/// holds from there on; emission is constant beyond the ends.
#[derive(Debug, Clone)]
pub(crate) struct Pieces {
    nodes: Vec<Node>,
    /// The number of nodes in the cells before, for each cell of places and for the end.
    before: Vec<u32>,
    first: f64,
    cells_per_unit: f64,
    /// The range of places outside of which nothing is visible.
    visible: [f64; 2],
}

/// The largest error of a parabola, as a share of its own emission and of 1/1024 of the largest emission: 2^-20.
const TOLERANCE: f64 = 1.0 / 1_048_576.0;
/// The largest number of halvings of a segment between control points.
const HALVINGS: u32 = 14;

/// Collects a number for each channel.
fn each(channel: impl FnMut(usize) -> f64) -> Emission {
    [0, 1, 2, 3].map(channel)
}

/// Returns the slope and the bend of the parabola through an emission at the begin, in the middle and at the end of a
/// piece.
fn parabola([a, m, b]: [Emission; 3]) -> [Emission; 2] {
    [each(|c| 4.0 * m[c] - 3.0 * a[c] - b[c]), each(|c| 2.0 * (a[c] - 2.0 * m[c] + b[c]))]
}

impl Pieces {
    /// Makes the pieces of a function of places, given the place of each value: an ascending map.
    pub(crate) fn new(transfer: &TransferFunction, place: impl Fn(f64) -> f64) -> Self {
        let knots = transfer.knots();
        let most = TransferFunction::extinction(transfer.max_opacity(), 1.0);
        // The begins of pieces: their values, and emission there and in the middle and at the end of the piece.
        let mut begins = Vec::new();
        for (a, b) in knots.iter().zip(&knots[1..]) {
            let ends = [a, b].map(|knot| (knot.value, TransferFunction::emission_of(knot.color, knot.opacity)));
            if a.value < b.value {
                halve(transfer, ends, most, HALVINGS, &mut begins);
            } else {
                begins.push((a.value, [ends[0].1; 3]));
            }
        }
        let last = &knots[knots.len() - 1];
        begins.push((last.value, [TransferFunction::emission_of(last.color, last.opacity); 3]));
        let mut nodes: Vec<Node> = Vec::with_capacity(begins.len());
        for (value, of_piece) in begins {
            let (place, [slope, bend]) = (place(value), parabola(of_piece));
            let integral = nodes.last().map_or([0.0; 4], |last| {
                let width = place - last.place;
                each(|c| last.integral[c] + width * (last.emission[c] + last.slope[c] / 2.0 + last.bend[c] / 3.0))
            });
            if let Some(last) = nodes.last_mut().filter(|last| last.place < place) {
                last.inverse = (place - last.place).recip();
            }
            nodes.push(Node { place, emission: of_piece[0], slope, bend, integral, inverse: 0.0 });
        }
        Self::of_nodes(nodes)
    }

    fn of_nodes(nodes: Vec<Node>) -> Self {
        let (first, last) = (nodes[0], nodes[nodes.len() - 1]);
        let cells = 16 * nodes.len();
        let width = last.place - first.place;
        let cells_per_unit = if width > 0.0 { (cells - 1) as f64 / width } else { 0.0 };
        let is_clear = |node: &&Node| node.emission[3] <= 0.0;
        let clear_below = nodes.iter().take_while(is_clear).last();
        let clear_above = nodes.iter().rev().take_while(is_clear).last();
        let visible = [
            clear_below.map_or(f64::NEG_INFINITY, |node| node.place),
            clear_above.map_or(f64::INFINITY, |node| node.place),
        ];
        let mut pieces = Self { before: vec![0; cells + 1], first: first.place, cells_per_unit, visible, nodes };
        for node in &pieces.nodes {
            let cell = pieces.cell(node.place);
            pieces.before[cell + 1..].iter_mut().for_each(|count| *count += 1);
        }
        pieces
    }

    /// Returns the number of the cell of a place, which does not descend with the place.
    fn cell(&self, place: f64) -> usize {
        (((place - self.first) * self.cells_per_unit) as usize).min(self.before.len() - 2)
    }

    pub(crate) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Returns the number of nodes that are not above a place.
    fn below(&self, place: f64) -> usize {
        let cell = self.cell(place);
        let [first, end] = [cell, cell + 1].map(|cell| self.before[cell] as usize);
        first + self.nodes[first..end].partition_point(|node| node.place <= place)
    }

    /// Returns whether no place between two is visible.
    pub(crate) fn is_clear(&self, [low, high]: [f64; 2]) -> bool {
        high < self.visible[0] || low > self.visible[1]
    }

    /// Returns the mean emission between two places of a piece, given the number of nodes that are not above them.
    fn within(&self, below: usize, low: f64, high: f64) -> Emission {
        let node = &self.nodes[below.max(1) - 1];
        let inverse = if below > 0 { node.inverse } else { 0.0 };
        let [s, t] = [low, high].map(|place| (place - node.place) * inverse);
        let [of_slope, of_bend] = [(s + t) / 2.0, (s * s + s * t + t * t) / 3.0];
        each(|c| node.emission[c] + of_slope * node.slope[c] + of_bend * node.bend[c])
    }

    /// Returns the mean emission between two places, given the numbers of nodes that are not above them; if the places
    /// are equal, the emission there.
    fn mean(&self, (low, from): (f64, usize), (high, to): (f64, usize)) -> Emission {
        if from == to {
            return self.within(from, low, high);
        }
        let (a, b) = (&self.nodes[from], &self.nodes[to - 1]);
        let (start, end) = (self.within(from, low, a.place), self.within(to, b.place, high));
        let width = (high - low).recip();
        each(|c| {
            let whole = b.integral[c] - a.integral[c];
            (start[c] * (a.place - low) + whole + end[c] * (high - b.place)) * width
        })
    }

    /// Returns the band-limited emission of a voxel, given its place, the places of the lowest and of the highest of
    /// its neighbours, and the length of its gradient.
    pub(crate) fn emission(&self, place: f64, [lowest, highest]: [f64; 2], rise: f64) -> Emission {
        let low = (place - rise).max(lowest).min(place);
        let high = (place + rise).min(highest).max(place);
        if self.is_clear([low, high]) {
            return [0.0; 4];
        }
        let [low, place, high] = [low, place, high].map(|place| (place, self.below(place)));
        let (below, above) = (self.mean(low, place), self.mean(place, high));
        each(|c| (below[c] + above[c]) / 2.0)
    }
}

/// Adds the begins of the pieces of a segment, each of which is a parabola closely enough.
fn halve(
    transfer: &TransferFunction,
    [(a, of_a), (b, of_b)]: [(f64, Emission); 2],
    most: f64,
    halvings: u32,
    begins: &mut Vec<(f64, [Emission; 3])>,
) {
    let value = f64::midpoint(a, b);
    let of_piece = [of_a, transfer.emission(value), of_b];
    let [slope, bend] = parabola(of_piece);
    let errs = |t: f64| {
        let exact = transfer.emission(a + (b - a) * t);
        let error = |c: usize| (of_a[c] + (slope[c] + bend[c] * t) * t - exact[c]).abs();
        (0..4).map(error).fold(0.0, f64::max) > TOLERANCE * (exact[3] + most / 1024.0)
    };
    if halvings == 0 || !(a < value && value < b) || !(errs(0.25) || errs(0.75)) {
        begins.push((a, of_piece));
        return;
    }
    halve(transfer, [(a, of_a), (value, of_piece[1])], most, halvings - 1, begins);
    halve(transfer, [(value, of_piece[1]), (b, of_b)], most, halvings - 1, begins);
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
        assert!(pieces.nodes().len() < 1000, "{}", pieces.nodes().len());
        let most = TransferFunction::extinction(0.999, 1.0);
        for low in (90..260).step_by(7).map(|value| f64::from(value) + 0.37) {
            for width in [1e-9, 0.01, 0.4, 3.0, 50.0] {
                let high = low + width;
                let [from, to] = [low, high].map(|place| (place, pieces.below(place)));
                let mean = pieces.mean(from, to);
                for (c, mean) in mean.into_iter().enumerate() {
                    let exact = integrate(low, high, 16_384, |v| ramp.emission(v)[c]) / (high - low);
                    // Panels of the sum span kinks.
                    assert!((mean - exact).abs() <= 1e-5 * (exact + most / 32.0), "{low} {width} {mean} {exact}");
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
