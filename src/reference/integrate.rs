//! The integrals of the models along one ray.

use glam::{DAffine3, DMat3, DVec3};

use super::profile::{Gauss, Range, Scalar, Series};
use super::ray::{LatticeRay, Weights};
use super::walk::{Block, Cuts, MOMENTS, Piece};
use crate::lighting::{Lighting, Source, Visibility};
use crate::transfer::{Resolution, TransferFunction};
use crate::volume::Grid;

/// Optical depth of one step at most, for the exponential to be as well resolved as the kernel.
const MAX_STEP_DEPTH: f64 = 0.25;
/// Steps into which a piece is cut at once: an opaque ray ends after four times its optical depth of them.
const MAX_STEPS: f64 = 256.0;
/// How far a step through a classified field and its two halves may differ in what the eye sees of them, at least.
/// Halves err by a small fraction of that.
const TOLERANCE: f64 = 1e-9;
/// The transmittance beyond which nothing more is seen, at least.
const OPAQUE: f64 = 1e-12;
/// The error that the jumps of a smooth block make, over the sum of the squares of their optical depths.
const UNEVENNESS: f64 = 0.3;
/// The nodes of Gauss's two-point rule on -1..1 are at this and its opposite.
const PAIR: f64 = 0.577_350_269_189_625_8;
/// The ends of -1..1 are so many distances of those nodes from the middle.
const PAIR_ENDS: f64 = 0.866_025_403_784_438_7;
/// The error of Gauss's two-point rule for a part of a classified field, over what is seen, is this times the fourth
/// power of the part's length in scales of the kernel.
const ROUGH: f64 = 0.5;
/// Its error over the part's optical depth is this times the fourth power of the relative change between the nodes.
const TURN: f64 = 0.1;
/// The share of the tolerance that one part of a classified field may take.
const PIECE_SHARE: f64 = 0.01;
/// How often a step is halved at most.
const MAX_LEVEL: u32 = 26;
/// Length in voxels down to which the places are looked for where a polynomial meets a value that it may just touch.
const FLOOR: f64 = 1.0 / 1024.0;
/// Length in voxels under which a gap between blocks is rounding.
const GAP: f64 = 1e-9;
/// Spread of a polynomial, as a fraction of its size, that is rounding.
const ROUNDING: f64 = 1e-13;

/// To what share of itself a maximum is found that is attenuated by depth.
const FADED: f64 = 1e-10;

/// What a ray collects: colour (premultiplied) and optical depth.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RayIntegral {
    /// C = integral of e(t) exp(-integral_0^t tau) dt, red, green and blue. Of the other models their pixel.
    pub color: [f64; 3],
    /// The integral of tau, up to the end or to where the transmittance fell under 1e-12 or a quarter of the tolerance;
    /// of an X-ray with another response than absorption, all of it.
    /// Projections of intensity: what has the alpha of its pixel, infinite for an alpha of 1.
    pub optical_depth: f64,
}

impl RayIntegral {
    /// Opacity, 1 - exp(-optical depth), without cancellation where it is small.
    #[must_use]
    pub fn alpha(&self) -> f64 {
        -(-self.optical_depth).exp_m1()
    }

    /// Premultiplied red, green, blue and alpha.
    #[must_use]
    pub fn rgba(&self) -> [f64; 4] {
        let [r, g, b] = self.color;
        [r, g, b, self.alpha()]
    }

    /// Light of a colour (not premultiplied), of some opacity.
    pub(super) fn uniform(color: [f64; 3], alpha: f64) -> Self {
        Self { color: color.map(|c| c * alpha), optical_depth: -(-alpha).ln_1p() }
    }

    /// A step of the given length along which extinction and emission have these values at the nodes.
    fn step(field: &[Weights; STAGES], length: f64) -> Self {
        let dot = |w: &[f64; STAGES]| (0..STAGES).map(|n| w[n] * field[n][0] * length).sum::<f64>();
        let optical_depth = dot(&WEIGHTS);
        if optical_depth > 4.0 * MAX_STEP_DEPTH {
            // Steps so deep are halved, or so short that all that is seen is one colour, that of where it begins.
            let [tau, emission @ ..] = field.iter().find(|f| f[0] > 0.0).copied().unwrap_or_default();
            let alpha = -(-optical_depth).exp_m1();
            return Self { color: emission.map(|e| e / tau * alpha), optical_depth };
        }
        let mut color = [0.0; 3];
        for n in 0..STAGES {
            let seen = WEIGHTS[n] * length * (-dot(&RUNNING[n])).exp();
            for (color, emission) in color.iter_mut().zip(&field[n][1..]) {
                *color += seen * emission;
            }
        }
        Self { color, optical_depth }
    }

    /// The same, for the nodes of Gauss's two-point rule.
    fn pair([first, second]: &[Weights; 2], length: f64) -> Self {
        let [a, b] = [first[0], second[0]].map(|tau| tau * length);
        let early = (-a / 4.0 - b * (0.25 - PAIR / 2.0)).exp() * length / 2.0;
        let late = (-a * (0.25 + PAIR / 2.0) - b / 4.0).exp() * length / 2.0;
        let color = std::array::from_fn(|c| early * first[c + 1] + late * second[c + 1]);
        Self { color, optical_depth: f64::midpoint(a, b) }
    }

    /// Adds what lies behind.
    fn append(&mut self, behind: &Self) {
        let transmittance = (-self.optical_depth).exp();
        for (color, c) in self.color.iter_mut().zip(behind.color) {
            *color += transmittance * c;
        }
        self.optical_depth += behind.optical_depth;
    }
}

/// Gauss's three-point rule on [0, 1] as a collocation method: nodes, weights, and the integrals of the node
/// polynomials up to each node (Hairer, Norsett and Wanner, "Solving Ordinary Differential Equations I", table II.7.4).
/// With the running optical depth at the nodes from the same matrix, colour is as accurate as depth: order 6.
const STAGES: usize = 3;
const SQRT15: f64 = 3.872_983_346_207_417;
const NODES: [f64; STAGES] = [0.5 - SQRT15 / 10.0, 0.5, 0.5 + SQRT15 / 10.0];
const WEIGHTS: [f64; STAGES] = [5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0];
const RUNNING: [[f64; STAGES]; STAGES] = [
    [5.0 / 36.0, 2.0 / 9.0 - SQRT15 / 15.0, 5.0 / 36.0 - SQRT15 / 30.0],
    [5.0 / 36.0 + SQRT15 / 24.0, 2.0 / 9.0, 5.0 / 36.0 - SQRT15 / 24.0],
    [5.0 / 36.0 + SQRT15 / 30.0, 2.0 / 9.0 + SQRT15 / 15.0, 5.0 / 36.0],
];

/// How exact an integral must be.
#[derive(Debug)]
pub(super) struct Accuracy {
    /// The error that a pixel's channel may have; 0 for what rounding allows.
    pub(super) tolerance: f64,
    /// The kernel at the rim of its support.
    pub(super) rim: f64,
    pub(super) rule: Gauss<MOMENTS>,
    /// The scale of the smallest kernel.
    pub(super) scale: f64,
    /// Steps of a block of extinction and emission.
    pub(super) steps: f64,
}

impl Accuracy {
    fn is_opaque(&self, sum: &RayIntegral) -> bool {
        (-sum.optical_depth).exp() < OPAQUE.max(self.tolerance / 4.0)
    }
}

/// A part of a block on which sums over splats are one polynomial.
struct Span<'a> {
    series: &'a Series,
    /// Its ends, in the block.
    from: f64,
    to: f64,
    /// In voxels.
    length: f64,
}

/// The integral of splats that extinguish and emit.
#[derive(Debug)]
pub(super) struct Emission<'a> {
    pub(super) sum: RayIntegral,
    /// World units per voxel along the ray, over the kernel's divisor N.
    pub(super) measure: f64,
    pub(super) accuracy: &'a Accuracy,
    /// Whether what is dense hides what is behind it. Otherwise the optical depth itself is asked for.
    pub(super) hides: bool,
}

impl Emission<'_> {
    /// Adds a block; whether there is more to see.
    pub(super) fn block(&mut self, block: &Block<'_>, cuts: &mut Cuts) -> bool {
        let Accuracy { tolerance, rim, steps, .. } = *self.accuracy;
        let seen = if self.hides { (-self.sum.optical_depth).exp() } else { 1.0 };
        let jumps = block.unevenness(rim) * (2.0 * block.half * self.measure).powi(2);
        if tolerance > 0.0 && UNEVENNESS * jumps * seen <= tolerance && self.smooth(block) {
            return !self.is_opaque();
        }
        block.pieces(cuts, |&Piece { series, from: a, to: b, .. }| {
            let parts = ((b - a) / 2.0 * steps).ceil();
            let at = |i: f64| if i < parts { a + (b - a) * (i / parts) } else { b };
            let mut i = 0.0;
            while i < parts && self.step(series, block.half, at(i), at(i + 1.0)) {
                i += 1.0;
            }
            i == parts
        })
    }

    /// Adds a block as if no chord began or ended in it, unless it is too dense for that; whether it has.
    fn smooth(&mut self, block: &Block<'_>) -> bool {
        let series = block.smooth(&self.accuracy.rule);
        let steps = self.accuracy.steps;
        let length = 2.0 * block.half / steps;
        let mut sum = self.sum;
        let mut i = 0.0;
        while i < steps {
            let field = NODES.map(|c| series.at(2.0 * (i + c) / steps - 1.0).map(|x| x * self.measure));
            if self.hides && field.iter().any(|f| f[0] * length > MAX_STEP_DEPTH) {
                return false;
            }
            sum.append(&RayIntegral::step(&field, length));
            i += 1.0;
        }
        self.sum = sum;
        true
    }

    /// Adds the part of a block from one place to another.
    fn step(&mut self, series: &Series, half: f64, from: f64, to: f64) -> bool {
        // One look tells whether the exponential needs finer steps than the kernel does. Stopping at an opaque ray
        // bounds their number, however many there are to the end of the piece.
        let field = self.field(series, from, to);
        self.part(&Span { series, from, to, length: half * (to - from) }, &field, 0.0, 1.0)
    }

    /// Adds the part of a span from `a` to `b`, as fractions of its length, given the field at its nodes.
    fn part(&mut self, span: &Span<'_>, field: &[Weights; STAGES], a: f64, b: f64) -> bool {
        let length = span.length * (b - a);
        let count = (field.iter().map(|f| f[0]).fold(0.0, f64::max) * length / MAX_STEP_DEPTH).ceil();
        if count <= 1.0 || !self.hides {
            self.sum.append(&RayIntegral::step(field, length));
            return !self.is_opaque();
        }
        // So many steps that the ray may be opaque long before the last: halves, of which the first may do. Fractions
        // stay apart where places in the block are rounded to one, so that depth grows in any material.
        let parts = if count > MAX_STEPS && b - a > f64::MIN_POSITIVE { 2.0 } else { count.min(MAX_STEPS) };
        let at = |i: f64| if i < parts { a + (b - a) * (i / parts) } else { b };
        let mut i = 0.0;
        while i < parts && !self.is_opaque() {
            let (a, b) = (at(i), at(i + 1.0));
            let place = |x: f64| span.from + (span.to - span.from) * x;
            let field = self.field(span.series, place(a), place(b));
            if parts < count {
                self.part(span, &field, a, b);
            } else {
                self.sum.append(&RayIntegral::step(&field, span.length * (b - a)));
            }
            i += 1.0;
        }
        !self.is_opaque()
    }

    fn is_opaque(&self) -> bool {
        self.hides && self.accuracy.is_opaque(&self.sum)
    }

    /// Extinction and emission at the nodes of a step, per voxel of length along the ray.
    fn field(&self, series: &Series, from: f64, to: f64) -> [Weights; STAGES] {
        // At the rim of a kernel there is nothing but rounding, which dense material magnifies: it is neither below 0
        // nor brighter than white.
        NODES.map(|c| {
            let [tau, emission @ ..] = series.at(from + (to - from) * c).map(|x| (x * self.measure).max(0.0));
            let [red, green, blue] = emission.map(|e| e.min(tau));
            [tau, red, green, blue]
        })
    }
}

/// A scalar field that is classified, and lit, where it is reconstructed.
#[derive(Debug)]
pub(super) struct Classifier {
    transfer: TransferFunction,
    /// What opacities are meant per, in world units.
    unit: f64,
    pub(super) base: f64,
    /// Which differences are rounding.
    resolution: Resolution,
    /// The values, ascending, between which opacity is linear and extinction analytic.
    kinks: Vec<f64>,
    /// What is between them, and before and after: one more.
    segments: Vec<Segment>,
    lighting: Option<Lighting>,
    /// From the lattice to the world of the lights.
    grid: DAffine3,
    /// From gradients along the lattice axes to such in the world.
    to_world: DMat3,
}

/// A range of values in which colour and opacity are linear.
#[derive(Debug)]
struct Segment {
    range: [f64; 2],
    /// A value in it, colour and opacity there, and their slopes.
    value: f64,
    color: [f64; 3],
    opacity: f64,
    color_slope: [f64; 3],
    opacity_slope: f64,
}

/// What is before, between and after the kinks of a transfer function.
fn segments(transfer: &TransferFunction, kinks: &[f64]) -> Vec<Segment> {
    (0..=kinks.len())
        .map(|i| {
            let low = i.checked_sub(1).map_or(f64::NEG_INFINITY, |before| kinks[before]);
            let high = kinks.get(i).copied().unwrap_or(f64::INFINITY);
            // Inside, off the steps at either end.
            let inside = |share: f64| low + (high - low) * share;
            let (value, other) = if low.is_finite() && high.is_finite() {
                (inside(0.25), inside(0.75))
            } else if low.is_finite() {
                (low, low)
            } else {
                let below = if high.is_finite() { high - 1.0_f64.max(high.abs()) } else { 0.0 };
                (below, below)
            };
            let (color, opacity) = transfer.sample(value);
            let (far_color, far_opacity) = transfer.sample(other);
            let slope = |a: f64, b: f64| if other > value { (b - a) / (other - value) } else { 0.0 };
            Segment {
                range: [low, high],
                value,
                color,
                opacity,
                color_slope: std::array::from_fn(|c| slope(color[c], far_color[c])),
                opacity_slope: slope(opacity, far_opacity),
            }
        })
        .collect()
}

impl Segment {
    fn is_clear(&self) -> bool {
        self.opacity <= 0.0
    }

    /// Colour and opacity at a value.
    fn at(&self, value: f64) -> ([f64; 3], f64) {
        let along = value - self.value;
        let color = std::array::from_fn(|c| self.color[c] + self.color_slope[c] * along);
        (color, self.opacity + self.opacity_slope * along)
    }
}

impl Classifier {
    /// Lights are at places from the middle of the grid.
    pub(super) fn new(
        transfer: &TransferFunction,
        lighting: Option<&Lighting>,
        grid: &Grid,
        resolution: Resolution,
    ) -> Self {
        let points = transfer.points();
        let mut kinks: Vec<f64> = points.iter().map(|p| p.value).collect();
        // Where opacities are cut off, too.
        kinks.extend(points.windows(2).filter_map(|w| {
            let [a, b] = [w[0].opacity, w[1].opacity].map(|o| o - TransferFunction::MAX_OPACITY);
            (a * b < 0.0).then(|| w[0].value + (w[1].value - w[0].value) * (a / (a - b)))
        }));
        kinks.sort_unstable_by(f64::total_cmp);
        kinks.dedup();
        Self {
            segments: segments(transfer, &kinks),
            transfer: transfer.clone(),
            unit: transfer.unit_or(grid.min_spacing()),
            base: transfer.base(),
            resolution,
            kinks,
            lighting: lighting.map(|lighting| lighting.seen_from(grid.center())),
            grid: grid.centered().to_world(),
            to_world: grid.to_lattice().matrix3.transpose(),
        }
    }

    /// The kinks between two values, not those at them.
    fn between(&self, low: f64, high: f64) -> &[f64] {
        let first = self.kinks.partition_point(|&v| v <= low);
        let last = self.kinks.partition_point(|&v| v < high);
        self.kinks.get(first..last).unwrap_or(&[])
    }

    /// The segment that holds a range of values, if there is one. `last` is the number of the one found last.
    fn segment(&self, [low, high]: [f64; 2], last: &mut usize) -> Option<&Segment> {
        let holds = |segment: &&Segment| segment.range[0] <= low && high <= segment.range[1];
        self.segments.get(*last).filter(holds).or_else(|| {
            *last = self.kinks.partition_point(|&v| v <= low);
            self.segments.get(*last).filter(holds)
        })
    }

    /// The factors of scalar and differences that make the numbers whose sign lit colour jumps or bends with: on which
    /// side of the surface are the eye, each light, and the direction half way between them.
    pub(super) fn sides(&self, to_eye: DVec3) -> Vec<Weights> {
        let lights = self.lighting.iter().flat_map(|lighting| &lighting.lights);
        let halves = lights.filter_map(|light| match light.source {
            // Of a light at a place it changes along the ray: steps find where.
            Source::Eye | Source::Point(_) => None,
            Source::Direction(towards) => Some([towards, to_eye + towards.normalize()]),
        });
        let eye = self.lighting.as_ref().map(|_| to_eye);
        let directions = eye.into_iter().chain(halves.flatten());
        directions.map(|d| self.to_world.transpose() * d).map(|d| [0.0, d.x, d.y, d.z]).collect()
    }

    /// Extinction and emission per world unit where the transfer function gives this colour and opacity, the scalar is
    /// so far from the base and its differences along the lattice axes are these, and light arrives as `visibility`
    /// says.
    fn lit(
        &self,
        (mut color, opacity): ([f64; 3], f64),
        distance: f64,
        differences: [f64; 3],
        place: DVec3,
        to_eye: DVec3,
        visibility: impl FnOnce() -> Visibility,
    ) -> Weights {
        let mut tau = TransferFunction::extinction(opacity, self.unit);
        if tau <= 0.0 {
            return [0.0; 4];
        }
        let gradient = self.to_world * DVec3::from_array(differences);
        if !self.transfer.gradient_opacity().is_empty() {
            tau *= self.transfer.gradient_share(gradient.length());
        }
        if let Some(lighting) = &self.lighting {
            let place = self.grid.transform_point3(place);
            let (surface, visibility) = (self.resolution.share(differences, distance), visibility());
            let lit = lighting.shade(color, gradient, place, to_eye, &visibility);
            let plain = lighting.shade_without_surface(color, &visibility);
            color = std::array::from_fn(|c| surface * lit[c] + (1.0 - surface) * plain[c]);
        }
        [tau, tau * color[0], tau * color[1], tau * color[2]]
    }
}

/// The integral of a field that is classified where it is reconstructed.
pub(super) struct Classified<'a> {
    pub(super) sum: RayIntegral,
    pub(super) classifier: &'a Classifier,
    pub(super) ray: LatticeRay,
    /// What of the light arrives at a place in the lattice; `None`: all of it.
    pub(super) arriving: Option<&'a dyn Fn(DVec3) -> Visibility>,
    /// Unit vector, world coordinates.
    pub(super) to_eye: DVec3,
    /// As the classifier gives them for that.
    pub(super) sides: Vec<Weights>,
    /// World units per voxel along the ray.
    pub(super) measure: f64,
    /// The kernel's divisor N.
    pub(super) divisor: f64,
    /// Up to where the ray is integrated.
    pub(super) position: f64,
    pub(super) accuracy: &'a Accuracy,
    /// The segment of the transfer function that was needed last.
    pub(super) segment: usize,
}

/// A part of a block, in x from -1 to 1 over the block.
struct Stretch {
    /// Scalar and differences.
    series: Series,
    scalar: Scalar,
    /// What has a sign that matters.
    sides: Vec<Scalar>,
    /// Where x is 0 along the ray, and voxels per unit of x.
    middle: f64,
    half: f64,
}

impl Classified<'_> {
    /// Adds a block and what is empty before it; whether there is more to see.
    pub(super) fn block(&mut self, block: &Block<'_>, cuts: &mut Cuts) -> bool {
        let range = block.range().map(|sum| self.value(sum));
        if self.classifier.segment(range, &mut self.segment).is_some_and(Segment::is_clear) {
            self.empty(block.middle - block.half);
            self.position = block.middle + block.half;
            return true;
        }
        block.pieces(cuts, |piece| {
            self.empty(block.middle + block.half * piece.from);
            self.position = block.middle + block.half * piece.to;
            !self.accuracy.is_opaque(&self.sum) && (self.coarse(block, piece) || self.piece(block, piece))
        })
    }

    /// Adds a piece; whether there is more to see.
    fn piece(&mut self, block: &Block<'_>, &Piece { series, from, to, .. }: &Piece<'_>) -> bool {
        let stretch = Stretch {
            series: *series,
            scalar: series.combined(&[1.0, 0.0, 0.0, 0.0]),
            sides: self.sides.iter().map(|side| series.combined(side)).collect(),
            middle: block.middle,
            half: block.half,
        };
        self.split(&stretch, from, to)
    }

    /// Adds a piece so short that the tolerance allows for a rule of two nodes; false if it is not.
    fn coarse(&mut self, block: &Block<'_>, &Piece { series, from, to, curvature }: &Piece<'_>) -> bool {
        if self.accuracy.tolerance <= 0.0 {
            return false;
        }
        let allowed = self.accuracy.tolerance * self.sum.optical_depth.exp();
        let half = block.half;
        let (middle, part) = (f64::midpoint(from, to), (to - from) / 2.0);
        let kernels = 2.0 * part * half / self.accuracy.scale;
        if kernels.powi(4) * ROUGH > allowed {
            return false;
        }
        let sums = [-PAIR, PAIR].map(|x| series.at(middle + part * x));
        // The line through two nodes goes on to 0.87 times their difference from the middle. It errs by a third of the
        // curvature times half the length squared.
        let spread = (sums[1][0] - sums[0][0]).abs() * PAIR_ENDS + curvature * part * part / 3.0;
        let center = f64::midpoint(sums[0][0], sums[1][0]);
        let Some(segment) =
            self.classifier.segment([center - spread, center + spread].map(|s| self.value(s)), &mut self.segment)
        else {
            return false;
        };
        if segment.is_clear() {
            return true;
        }
        let same_side = |side: &Weights| {
            let [a, b] = sums.map(|sum| sum.iter().zip(side).map(|(s, d)| s * d).sum::<f64>());
            f64::midpoint(a, b).abs() >= (a - b).abs() * PAIR_ENDS
        };
        if !self.sides.iter().all(same_side) {
            return false;
        }
        let world = 2.0 * part * half * self.measure;
        let classifier = self.classifier;
        let at = |node: usize| {
            let scalar = sums[node][0];
            let place = self.place(block.middle + half * (middle + part * [-PAIR, PAIR][node]));
            let [distance, differences @ ..] = sums[node].map(|sum| sum / self.divisor);
            classifier.lit(segment.at(self.value(scalar)), distance, differences, place, self.to_eye, || {
                self.visibility(place)
            })
        };
        let field = [0, 1].map(at);
        let most = field.iter().flatten().fold(0.0, |m: f64, f| m.max(f.abs()));
        let change = (0..4).map(|c| (field[0][c] - field[1][c]).abs()).fold(0.0, f64::max);
        if most * world > MAX_STEP_DEPTH || change.powi(4) * world * TURN > allowed * most.powi(3) {
            return false;
        }
        // Lit colours are cut off at 1.
        let bends = |c: usize| {
            let [a, b] = field.map(|f| f[c] - f[0]);
            (a < 0.0 || b < 0.0) && f64::midpoint(a, b) + (a - b).abs() * PAIR_ENDS >= 0.0
        };
        if !self.sides.is_empty() && (1..4).any(bends) {
            return false;
        }
        self.sum.append(&RayIntegral::pair(&field, world));
        true
    }

    /// Adds what is empty up to a position: there the field is its base.
    pub(super) fn empty(&mut self, to: f64) {
        if to - self.position > GAP {
            let length = (to - self.position) * self.measure;
            let (color, opacity) = self.classifier.transfer.sample(self.classifier.base);
            let share = self.classifier.transfer.gradient_share(0.0);
            let optical_depth = TransferFunction::extinction(opacity, self.classifier.unit) * share * length;
            let alpha = -(-optical_depth).exp_m1();
            self.sum.append(&RayIntegral { color: color.map(|c| c * alpha), optical_depth });
            self.position = to;
        }
    }

    fn value(&self, sum: f64) -> f64 {
        self.classifier.base + sum / self.divisor
    }

    /// Adds the part of a stretch from a to b, cut wherever the scalar meets a kink of the transfer function or light
    /// changes sides: so no peak is missed, however narrow, and what is left is smooth.
    fn split(&mut self, stretch: &Stretch, a: f64, b: f64) -> bool {
        let range = stretch.scalar.range(a, b);
        if self.is_invisible(range) {
            return true;
        }
        let mut cuts = Vec::new();
        let base = self.classifier.base;
        let rounding = ROUNDING * stretch.scalar.size.max((base * self.divisor).abs());
        let mut sure = range.spread <= rounding || {
            let sums = |kink: f64| (kink - base) * self.divisor;
            let [low, high] = [-range.spread, range.spread].map(|s| self.value(range.middle + s));
            self.classifier.between(low, high).iter().all(|&kink| stretch.scalar.meets(sums(kink), a, b, &mut cuts))
        };
        for side in &stretch.sides {
            let range = side.range(a, b);
            let settled =
                range.middle.abs() > range.spread || range.middle.abs() + range.spread <= ROUNDING * side.size;
            sure &= settled || side.meets(0.0, a, b, &mut cuts);
        }
        if !sure && (b - a) * stretch.half > FLOOR {
            let middle = f64::midpoint(a, b);
            return self.split(stretch, a, middle) && self.split(stretch, middle, b);
        }
        cuts.push(b);
        cuts.sort_unstable_by(f64::total_cmp);
        let mut from = a;
        cuts.iter().all(|&to| self.smooth(stretch, std::mem::replace(&mut from, to), to))
    }

    /// Whether nothing is seen of scalars in a range.
    fn is_invisible(&self, Range { middle, spread, .. }: Range) -> bool {
        let [low, high] = [-spread, spread].map(|s| self.value(middle + s));
        // Between kinks opacity is linear and not negative: clear at one place inside, clear everywhere.
        self.classifier.between(low, high).is_empty() && self.opacity(middle) <= 0.0
    }

    fn opacity(&self, sum: f64) -> f64 {
        self.classifier.transfer.sample(self.value(sum)).1
    }

    /// Adds a part without kinks.
    fn smooth(&mut self, stretch: &Stretch, a: f64, b: f64) -> bool {
        if a >= b || self.opacity(stretch.scalar.at(f64::midpoint(a, b))) <= 0.0 {
            return true;
        }
        let whole = self.step(stretch, a, b);
        self.refine(stretch, a, b, &whole, 0)
    }

    /// Adds a step, or halves it until its halves agree with it.
    fn refine(&mut self, stretch: &Stretch, a: f64, b: f64, whole: &RayIntegral, level: u32) -> bool {
        let middle = f64::midpoint(a, b);
        let (first, second) = (self.step(stretch, a, middle), self.step(stretch, middle, b));
        let mut both = first;
        both.append(&second);
        let error = (both.color.iter().zip(whole.color))
            .map(|(c, w)| (c - w).abs())
            .fold((both.optical_depth - whole.optical_depth).abs(), f64::max);
        let seen = (-self.sum.optical_depth).exp();
        let agree = both.optical_depth <= MAX_STEP_DEPTH
            && error * seen <= TOLERANCE.max(self.accuracy.tolerance * PIECE_SHARE);
        if level == MAX_LEVEL || (agree && self.is_evenly_bright(stretch, a, b)) {
            self.sum.append(&both);
            return !self.accuracy.is_opaque(&self.sum);
        }
        self.refine(stretch, a, middle, &first, level + 1) && self.refine(stretch, middle, b, &second, level + 1)
    }

    /// Whether the same channels of lit colour are cut off at 1 at both ends and in the middle of a step, or it is so
    /// short that it does not matter. Such a kink near an end escapes the nodes.
    fn is_evenly_bright(&self, stretch: &Stretch, a: f64, b: f64) -> bool {
        if stretch.sides.is_empty() || (b - a) * stretch.half <= FLOOR {
            return true;
        }
        let cut_off = |x: f64| {
            let [tau, emission @ ..] = self.emission(stretch, x);
            emission.map(|e| tau > 0.0 && e >= tau)
        };
        let first = cut_off(a);
        first == cut_off(f64::midpoint(a, b)) && first == cut_off(b)
    }

    fn step(&self, stretch: &Stretch, a: f64, b: f64) -> RayIntegral {
        let field = NODES.map(|c| self.emission(stretch, a + (b - a) * c));
        RayIntegral::step(&field, (b - a) * stretch.half * self.measure)
    }

    fn emission(&self, stretch: &Stretch, x: f64) -> Weights {
        let [scalar, differences @ ..] = stretch.series.at(x);
        let classified = self.classifier.transfer.sample(self.value(scalar));
        let place = self.place(stretch.middle + stretch.half * x);
        let differences = differences.map(|d| d / self.divisor);
        self.classifier
            .lit(classified, scalar / self.divisor, differences, place, self.to_eye, || self.visibility(place))
    }

    /// The place in the lattice so many voxels along the ray.
    fn place(&self, along: f64) -> DVec3 {
        self.ray.origin + self.ray.direction * along
    }

    /// What of the light arrives at a place in the lattice.
    fn visibility(&self, place: DVec3) -> Visibility {
        self.arriving.map_or(Visibility::FULL, |at| at(place))
    }
}

/// The integral of the sum of splats over a ray, in voxels.
#[derive(Debug)]
pub(super) struct Integral(pub(super) f64);

impl Integral {
    pub(super) fn block(&mut self, block: &Block<'_>, cuts: &mut Cuts) {
        block.pieces(cuts, |&Piece { series, from, to, .. }| {
            self.0 += series.mean(from, to) * (to - from) * block.half;
            true
        });
    }
}

/// The largest sum of splats on a ray; 0 where it is empty.
#[derive(Debug)]
pub(super) struct Maximum {
    /// `None` before the first stretch.
    pub(super) largest: Option<f64>,
    /// Where it is on the ray, in voxels.
    pub(super) place: f64,
    /// Up to where the ray was searched.
    pub(super) position: f64,
    /// What sums over 0 are multiplied by.
    pub(super) fade: Fade,
}

/// A share that falls along a ray, of what is attenuated by depth: exp(-(start + slope p)) at p voxels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Fade {
    pub(super) start: f64,
    /// At least 0.
    pub(super) slope: f64,
}

impl Fade {
    /// What is left of a sum at a place.
    fn of(self, sum: f64, place: f64) -> f64 {
        if sum > 0.0 { sum * (-(self.start + self.slope * place)).exp() } else { sum }
    }
}

impl Maximum {
    /// Looks at a block, both of its ends included, and at what is empty before it.
    pub(super) fn block(&mut self, block: &Block<'_>, cuts: &mut Cuts) {
        let first = block.middle - block.half;
        if self.largest.is_some_and(|largest| self.fade.of(block.range()[1], first) < largest) {
            self.empty(block.middle - block.half);
            self.position = block.middle + block.half;
            return;
        }
        block.pieces(cuts, |&Piece { series, from: a, to: b, .. }| {
            self.empty(block.middle + block.half * a);
            self.position = block.middle + block.half * b;
            let place = |x: f64| block.middle + block.half * x;
            self.search(&series.combined(&[1.0, 0.0, 0.0, 0.0]), &place, a, b);
            true
        });
    }

    /// Looks at what is empty up to a position.
    pub(super) fn empty(&mut self, to: f64) {
        if to - self.position > GAP {
            self.take(0.0, self.position);
            self.position = to;
        }
    }

    fn take(&mut self, value: f64, place: f64) {
        let value = self.fade.of(value, place);
        if self.largest.is_none_or(|largest| value > largest) {
            (self.largest, self.place) = (Some(value), place);
        }
    }

    /// Branch and bound: parts that cannot hold the maximum are left alone.
    fn search(&mut self, scalar: &Scalar, place: &impl Fn(f64) -> f64, a: f64, b: f64) {
        let Range { middle, spread, monotone } = scalar.range(a, b);
        let most = self.fade.of(middle + spread, place(a));
        if self.largest.is_some_and(|l| most <= l) {
            return;
        }
        self.take(middle, place(f64::midpoint(a, b)));
        if self.fade.slope > 0.0 {
            // Where a sum rises and its share falls, the product may be largest in between.
            [a, b].into_iter().for_each(|end| self.take(scalar.at(end), place(end)));
            if self.largest.is_some_and(|l| most - l > FADED * most.abs()) && b - a > FADED {
                let middle = f64::midpoint(a, b);
                self.search(scalar, place, a, middle);
                self.search(scalar, place, middle, b);
            }
        } else if monotone {
            self.take(scalar.at(a), place(a));
            self.take(scalar.at(b), place(b));
        } else if spread > ROUNDING * middle.abs() {
            let middle = f64::midpoint(a, b);
            self.search(scalar, place, a, middle);
            self.search(scalar, place, middle, b);
        }
    }
}
