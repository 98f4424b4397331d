//! The integrals of the models along one ray.

use glam::{DAffine3, DMat3, DVec3};

use super::profile::{Chebyshev, Range, Scalar};
use super::ray::{LatticeRay, Weights};
use super::walk::{Block, RayPiece, Visitor};
use crate::lighting::shadow::SURFACE_BIAS;
use crate::lighting::{Lighting, Visibility};
use crate::transfer::{ControlPoint, Resolution, TransferFunction};
use crate::volume::Grid;

/// The largest optical depth of a step: it resolves the exponential as well as the kernel.
const MAX_STEP_DEPTH: f64 = 0.25;
/// The smallest limit of the visible difference between a step through a classified field and its two halves. Halves
/// err by a small fraction of that.
const TOLERANCE: f64 = 1e-9;
/// The transmittance at which every ray ends.
const OPAQUE: f64 = 1e-12;
/// The error due to the jumps in a smoothed block, over the sum of the squares of their optical depths.
const UNEVENNESS: f64 = 0.3;
/// The error of a step through a classified field, over its optical depth, is less than the fourth power of this times
/// the relative change between its nodes.
const TURN: f64 = 0.5;
/// The share of the tolerance that one part of a classified field may take.
const PIECE_SHARE: f64 = 0.01;
/// The largest number of times that a step is halved.
const MAX_LEVEL: u32 = 26;
/// The length in voxels down to which intersections of a polynomial with a value are searched, if it may only touch it.
const FLOOR: f64 = 1.0 / 1024.0;
/// The spread of a polynomial, as a fraction of its size, that is only rounding.
const ROUNDING: f64 = 1e-13;
/// The distance of the field from an isosurface within which it may jump across it at rims of kernels, over the jump of
/// a kernel whose voxel has the surface's value.
const JUMPS: f64 = 4.0;
/// The relative error of maxima that are attenuated by depth.
const FADED: f64 = 1e-10;

/// The integral along a ray: premultiplied colour and optical depth.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RayIntegral {
    /// The colour, red, green and blue: C = integral of e(t) exp(-integral_0^t tau) dt. For the other models, the
    /// pixel's colour.
    pub color: [f64; 3],
    /// The integral of tau, up to the point where the transmittance falls below 1e-12 or a quarter of the tolerance;
    /// for an X-ray, to the end. For projections of intensity, the depth with the alpha of their pixel: infinite for 1.
    pub optical_depth: f64,
}

impl RayIntegral {
    /// Returns the opacity, 1 - exp(-optical depth), without cancellation if it is small.
    #[must_use]
    pub fn alpha(&self) -> f64 {
        -(-self.optical_depth).exp_m1()
    }

    /// Returns premultiplied red, green, blue and alpha.
    #[must_use]
    pub fn rgba(&self) -> [f64; 4] {
        let [r, g, b] = self.color;
        [r, g, b, self.alpha()]
    }

    /// Returns the integral of a ray that leaves a premultiplied pixel.
    pub(super) fn of_pixel([r, g, b, alpha]: [f64; 4]) -> Self {
        Self { color: [r, g, b], optical_depth: -(-alpha).ln_1p() }
    }

    /// Integrates a step of the given length, given extinction and emission at the nodes.
    fn step(field: &[Weights; STAGES], length: f64) -> Self {
        let dot = |w: &[f64; STAGES]| (0..STAGES).map(|n| w[n] * field[n][0] * length).sum::<f64>();
        let optical_depth = dot(&WEIGHTS);
        if optical_depth > 4.0 * MAX_STEP_DEPTH {
            // Such a deep step is halved, or so short that only the colour at its beginning is visible.
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

    /// Returns the integral of this part and one behind it.
    pub(super) fn before(mut self, behind: &Self) -> Self {
        self.append(behind);
        self
    }

    /// Adds a part behind this one.
    fn append(&mut self, behind: &Self) {
        let transmittance = (-self.optical_depth).exp();
        for (color, c) in self.color.iter_mut().zip(behind.color) {
            *color += transmittance * c;
        }
        self.optical_depth += behind.optical_depth;
    }
}

/// The number of nodes of Gauss's three-point rule on [0, 1] as a collocation method: nodes, weights, and the integrals
/// of the node polynomials up to each node (Hairer, Norsett and Wanner, "Solving Ordinary Differential Equations I",
/// table II.7.4). With the running optical depth at the nodes from the same matrix, colour is as accurate as depth:
/// order 6.
const STAGES: usize = 3;
const SQRT15: f64 = 3.872_983_346_207_417;
const NODES: [f64; STAGES] = [0.5 - SQRT15 / 10.0, 0.5, 0.5 + SQRT15 / 10.0];
const WEIGHTS: [f64; STAGES] = [5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0];
const RUNNING: [[f64; STAGES]; STAGES] = [
    [5.0 / 36.0, 2.0 / 9.0 - SQRT15 / 15.0, 5.0 / 36.0 - SQRT15 / 30.0],
    [5.0 / 36.0 + SQRT15 / 24.0, 2.0 / 9.0, 5.0 / 36.0 - SQRT15 / 24.0],
    [5.0 / 36.0 + SQRT15 / 30.0, 2.0 / 9.0 + SQRT15 / 15.0, 5.0 / 36.0],
];

/// The accuracy requested of integrals, and the step that it takes.
#[derive(Debug)]
pub(super) struct Accuracy {
    /// The largest error of a pixel's channel; 0 for as exact as rounding allows.
    pub(super) tolerance: f64,
    /// The value of the kernel at the rim of its support.
    pub(super) rim: f64,
    /// The number of steps of a block of extinction and emission.
    pub(super) steps: f64,
}

impl Accuracy {
    fn is_opaque(&self, sum: &RayIntegral) -> bool {
        (-sum.optical_depth).exp() < OPAQUE.max(self.tolerance / 4.0)
    }
}

/// An isosurface that a ray meets: the place on the ray in voxels, and what the surface adds.
pub(super) type Met = (f64, RayIntegral);

/// The integral of splats with extinction and emission.
#[derive(Debug)]
pub(super) struct EmissionIntegral<'a> {
    pub(super) sum: RayIntegral,
    /// The isosurfaces that are still ahead, front to back.
    pub(super) met: &'a [Met],
    /// The world units per voxel along the ray, over the kernel's divisor N.
    pub(super) measure: f64,
    pub(super) accuracy: &'a Accuracy,
}

impl Visitor for EmissionIntegral<'_> {
    /// Adds a block as if no chord began or ended in it, if that is exact enough.
    fn block(&mut self, block: &Block<'_>) -> Option<bool> {
        if self.met.first().is_some_and(|&(place, _)| place < block.middle + block.half) {
            return None;
        }
        let Accuracy { tolerance, rim, .. } = *self.accuracy;
        let jumps = block.unevenness(rim) * (2.0 * block.half * self.measure).powi(2);
        let error = UNEVENNESS * jumps * (-self.sum.optical_depth).exp();
        (tolerance > 0.0 && error <= tolerance).then(|| {
            let (series, measure) = (block.smooth(), self.measure);
            self.add(2.0, block.half, |x| series.at(x - 1.0).map(|w| w * measure))
        })
    }

    fn piece(&mut self, &RayPiece { series, middle, half, from, to }: &RayPiece<'_>) -> bool {
        let measure = self.measure;
        let matter = |emission: &mut Self, from: f64, to: f64| {
            // At the rim of a kernel the sum is only rounding, which dense material magnifies: keep extinction from
            // falling below 0 and colours from exceeding white.
            emission.add(to - from, half, |x| {
                let [tau, emission @ ..] = series.at(from + x).map(|w| (w * measure).max(0.0));
                let [red, green, blue] = emission.map(|e| e.min(tau));
                [tau, red, green, blue]
            })
        };
        let mut begin = from;
        while let Some((&(place, surface), behind)) = self.met.split_first()
            && place < middle + half * to
        {
            let at = ((place - middle) / half).clamp(begin, to);
            if at > begin && !matter(self, begin, at) {
                return false;
            }
            self.sum.append(&surface);
            (self.met, begin) = (behind, at);
            if self.accuracy.is_opaque(&self.sum) {
                return false;
            }
        }
        begin >= to || matter(self, begin, to)
    }
}

impl EmissionIntegral<'_> {
    /// Adds a stretch of `length`, in halves of its block, given extinction and emission at places in it, per voxel.
    fn add(&mut self, length: f64, half: f64, field: impl Fn(f64) -> Weights) -> bool {
        let parts = (length / 2.0 * self.accuracy.steps).ceil();
        let length = length / parts;
        (0..parts as u32).all(|i| {
            let begin = f64::from(i) * length;
            let step = |[a, b]: [f64; 2]| {
                RayIntegral::step(&NODES.map(|c| field(begin + length * (a + (b - a) * c))), half * length * (b - a))
            };
            self.part([0.0, 1.0], &step([0.0, 1.0]), &step)
        })
    }

    /// Adds the part between two fractions of a step, or its halves if it is too deep for the exponential. Fractions
    /// remain distinct even if places in the block round to the same number, so rays end in any material.
    fn part(&mut self, [a, b]: [f64; 2], whole: &RayIntegral, step: &impl Fn([f64; 2]) -> RayIntegral) -> bool {
        if whole.optical_depth > MAX_STEP_DEPTH && b - a > f64::MIN_POSITIVE {
            let middle = f64::midpoint(a, b);
            return [[a, middle], [middle, b]].into_iter().all(|half| self.part(half, &step(half), step));
        }
        self.sum.append(whole);
        !self.accuracy.is_opaque(&self.sum)
    }
}

/// The classification and light of a reconstructed scalar field.
#[derive(Debug)]
pub(super) struct FieldClassifier {
    pub(super) transfer: TransferFunction,
    /// The thickness of the slab to which opacities refer, in world units.
    unit: f64,
    pub(super) base: f64,
    /// The resolution of scalars: smaller differences are only rounding.
    resolution: Resolution,
    /// The values, ascending, between which opacity is linear, and so extinction analytic.
    kinks: Vec<f64>,
    /// The isosurfaces, values ascending.
    surfaces: Vec<ControlPoint>,
    lighting: Option<Lighting>,
    /// The map from the lattice to the world of the lights.
    grid: DAffine3,
    /// The map from gradients along the lattice axes to gradients in the world.
    to_world: DMat3,
}

impl FieldClassifier {
    /// Makes the classifier of a grid, with the places of lights relative to its middle.
    pub(super) fn new(
        transfer: &TransferFunction,
        lighting: Option<&Lighting>,
        grid: &Grid,
        resolution: Resolution,
    ) -> Self {
        let points = transfer.points();
        let mut kinks: Vec<f64> = points.iter().map(|p| p.value).collect();
        // Opacities are cut off, too.
        kinks.extend(points.windows(2).filter_map(|w| {
            let [a, b] = [w[0].opacity, w[1].opacity].map(|o| o - TransferFunction::MAX_OPACITY);
            (a * b < 0.0).then(|| w[0].value + (w[1].value - w[0].value) * (a / (a - b)))
        }));
        kinks.sort_unstable_by(f64::total_cmp);
        kinks.dedup();
        Self {
            transfer: transfer.clone(),
            unit: transfer.unit_or(grid.min_spacing()),
            base: transfer.base(),
            resolution,
            kinks,
            surfaces: transfer.isosurfaces(),
            lighting: lighting.map(|lighting| lighting.seen_from(grid.center())),
            grid: grid.centered().to_world(),
            to_world: grid.to_lattice().matrix3.transpose(),
        }
    }

    /// Returns the kinks between two values, exclusive of both.
    fn between(&self, low: f64, high: f64) -> &[f64] {
        let first = self.kinks.partition_point(|&v| v <= low);
        let last = self.kinks.partition_point(|&v| v < high);
        self.kinks.get(first..last).unwrap_or(&[])
    }

    /// Returns factors of scalar and differences whose sums change sign where lit colour jumps or bends: the signs tell
    /// on which side of the surface the eye, each light, and the direction half way between them are.
    pub(super) fn sides(&self, to_eye: DVec3) -> Vec<Weights> {
        let lights = self.lighting.iter().flat_map(|lighting| &lighting.lights);
        // The direction to a light at a place changes along the ray: halving finds where.
        let directions = lights.filter_map(|light| light.source.direction());
        let halves = directions.map(|towards| [towards, to_eye + towards.normalize()]);
        let eye = self.lighting.as_ref().map(|_| to_eye);
        let directions = eye.into_iter().chain(halves.flatten());
        directions.map(|d| self.to_world.transpose() * d).map(|d| [0.0, d.x, d.y, d.z]).collect()
    }

    /// Returns extinction and emission per world unit at a place, given the colour and opacity of its scalar, the
    /// distance of the scalar from the base, its differences along the lattice axes, and the light that arrives.
    fn lit(
        &self,
        (color, opacity): ([f64; 3], f64),
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
        if !self.transfer.gradient_opacity().is_empty() {
            tau *= self.transfer.gradient_share((self.to_world * DVec3::from_array(differences)).length());
        }
        let color = self.shaded(color, distance, differences, place, to_eye, visibility);
        [tau, tau * color[0], tau * color[1], tau * color[2]]
    }

    /// Returns a colour in the light.
    fn shaded(
        &self,
        mut color: [f64; 3],
        distance: f64,
        differences: [f64; 3],
        place: DVec3,
        to_eye: DVec3,
        visibility: impl FnOnce() -> Visibility,
    ) -> [f64; 3] {
        let gradient = self.to_world * DVec3::from_array(differences);
        if let Some(lighting) = &self.lighting {
            let place = self.grid.transform_point3(place);
            let (surface, visibility) = (self.resolution.share(differences, distance), visibility());
            let lit = lighting.shade(color, gradient, place, to_eye, &visibility);
            let plain = lighting.shade_without_surface(color, &visibility);
            color = std::array::from_fn(|c| surface * lit[c] + (1.0 - surface) * plain[c]);
        }
        color
    }
}

/// The integral of a reconstructed and classified scalar field.
pub(super) struct ClassifiedIntegral<'a> {
    pub(super) sum: RayIntegral,
    pub(super) classifier: &'a FieldClassifier,
    pub(super) ray: LatticeRay,
    /// The light that arrives at a place in the lattice.
    pub(super) arriving: &'a dyn Fn(DVec3) -> Visibility,
    /// The direction to the eye: a unit vector in world coordinates.
    pub(super) to_eye: DVec3,
    /// The classifier's sides for the direction to the eye.
    pub(super) sides: Vec<Weights>,
    /// The world units per voxel along the ray.
    pub(super) measure: f64,
    /// The kernel's divisor N.
    pub(super) divisor: f64,
    pub(super) accuracy: &'a Accuracy,
    /// For each isosurface whether the scalar was above it at the last place; empty before the first.
    pub(super) above: Vec<bool>,
    /// The isosurfaces that were met, front to back.
    pub(super) met: Vec<Met>,
}

/// A part of a block, in x from -1 to 1 over the block.
struct Stretch {
    /// The scalar and its differences as polynomials.
    series: Chebyshev,
    scalar: Scalar,
    /// The numbers whose sign tells the sides of light.
    sides: Vec<Scalar>,
    /// The place on the ray where x is 0; `half` is the number of voxels per unit of x.
    middle: f64,
    half: f64,
}

impl Visitor for ClassifiedIntegral<'_> {
    fn block(&mut self, block: &Block<'_>) -> Option<bool> {
        let [low, high] = block.range();
        let above = self.sides_of(f64::midpoint(low, high));
        let passes = self.above.iter().zip(&above).any(|(before, after)| before != after);
        (!passes && self.is_clear([low, high])).then(|| {
            self.above = above;
            true
        })
    }

    fn piece(&mut self, &RayPiece { series, middle, half, from, to }: &RayPiece<'_>) -> bool {
        let stretch = Stretch {
            series: *series,
            scalar: series.combined(&[1.0, 0.0, 0.0, 0.0]),
            sides: self.sides.iter().map(|side| series.combined(side)).collect(),
            middle,
            half,
        };
        !self.accuracy.is_opaque(&self.sum) && self.split(&stretch, from, to)
    }
}

impl ClassifiedIntegral<'_> {
    fn value(&self, sum: f64) -> f64 {
        self.classifier.base + sum / self.divisor
    }

    /// Adds the part of a stretch from a to b, cut wherever the scalar meets a kink of the transfer function or light
    /// changes sides: so no narrow peak is missed, and the field is smooth in between.
    fn split(&mut self, stretch: &Stretch, a: f64, b: f64) -> bool {
        let range = stretch.scalar.range(a, b);
        let [low, high] = [range.middle - range.spread, range.middle + range.spread];
        if self.is_clear([low, high]) {
            return self.pass(stretch, a, b);
        }
        let mut cuts = Vec::new();
        let base = self.classifier.base;
        let rounding = ROUNDING * stretch.scalar.size.max((base * self.divisor).abs());
        let mut sure = range.spread <= rounding || {
            let sums = |kink: f64| (kink - base) * self.divisor;
            self.classifier
                .between(self.value(low), self.value(high))
                .iter()
                .all(|&kink| stretch.scalar.meets(sums(kink), a, b, &mut cuts))
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

    /// Returns whether sums in a range are invisible.
    fn is_clear(&self, [low, high]: [f64; 2]) -> bool {
        // Between kinks opacity is linear and not negative: clear at one place inside, clear everywhere.
        self.classifier.between(self.value(low), self.value(high)).is_empty()
            && self.opacity(f64::midpoint(low, high)) <= 0.0
    }

    fn opacity(&self, sum: f64) -> f64 {
        self.classifier.transfer.sample(self.value(sum)).1
    }

    /// Returns for each isosurface whether a sum is above it. Within the jumps of the field at the rims of kernels the
    /// last answer stays, so that a surface is met once and not before and behind each of them.
    fn sides_of(&self, sum: f64) -> Vec<bool> {
        let value = self.value(sum);
        let base = self.classifier.base;
        let side = |(number, surface): (usize, &ControlPoint)| {
            let jumps = JUMPS * self.accuracy.rim / self.divisor * (surface.value - base).abs();
            match self.above.get(number) {
                Some(&before) if (value - surface.value).abs() <= jumps => before,
                _ => value > surface.value,
            }
        };
        self.classifier.surfaces.iter().enumerate().map(side).collect()
    }

    /// Composites the isosurfaces between the last place and the part from a to b, in which none lies. Returns whether
    /// more may be visible.
    fn pass(&mut self, stretch: &Stretch, a: f64, b: f64) -> bool {
        if self.classifier.surfaces.is_empty() || a >= b {
            return true;
        }
        let above = self.sides_of(stretch.scalar.at(f64::midpoint(a, b)));
        let before = std::mem::replace(&mut self.above, above.clone());
        let mut passed: Vec<usize> = (0..before.len()).filter(|&i| before[i] != above[i]).collect();
        if passed.first().is_some_and(|&i| before[i]) {
            passed.reverse();
        }
        for i in passed {
            let ControlPoint { color, opacity, .. } = self.classifier.surfaces[i];
            let optical_depth = TransferFunction::extinction(opacity, 1.0);
            let [scalar, differences @ ..] = stretch.series.at(a);
            let place = self.ray.origin + self.ray.direction * (stretch.middle + stretch.half * a);
            let (distance, differences) = (scalar / self.divisor, differences.map(|d| d / self.divisor));
            let normal = DVec3::from_array(differences).normalize_or_zero();
            let ahead = f64::from(if above[i] { -SURFACE_BIAS } else { SURFACE_BIAS });
            let lit = || (self.arriving)(place + ahead * normal);
            let color = self.classifier.shaded(color, distance, differences, place, self.to_eye, lit);
            let alpha = -(-optical_depth).exp_m1();
            let surface = RayIntegral { color: color.map(|c| c * alpha), optical_depth };
            self.met.push((stretch.middle + stretch.half * a, surface));
            self.sum.append(&surface);
        }
        !self.accuracy.is_opaque(&self.sum)
    }

    /// Adds a part without kinks.
    fn smooth(&mut self, stretch: &Stretch, a: f64, b: f64) -> bool {
        if !self.pass(stretch, a, b) {
            return false;
        }
        if a >= b || self.opacity(stretch.scalar.at(f64::midpoint(a, b))) <= 0.0 {
            return true;
        }
        let field = self.field(stretch, a, b);
        let whole = RayIntegral::step(&field, self.length(stretch, a, b));
        // With a tolerance, halving is often needless because the nodes hardly differ. Light jumps and bends too much.
        let most = field.as_flattened().iter().fold(0.0_f64, |most, f| most.max(f.abs()));
        let change = |c: usize| field.iter().map(|f| (f[c] - field[1][c]).abs()).fold(0.0, f64::max);
        let turn = (TURN * (0..4).map(change).fold(0.0, f64::max) / most).powi(4);
        let allowed = self.accuracy.tolerance * PIECE_SHARE * self.sum.optical_depth.exp();
        if stretch.sides.is_empty() && whole.optical_depth <= MAX_STEP_DEPTH && turn * whole.optical_depth < allowed {
            self.sum.append(&whole);
            return !self.accuracy.is_opaque(&self.sum);
        }
        self.refine(stretch, a, b, &whole, 0)
    }

    /// Adds the halves of a step, or halves them until they agree with the whole.
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

    /// Returns whether the same channels of lit colour are cut off at 1 at both ends and in the middle of a step, or
    /// the step is too short to matter. Such a kink near an end escapes the nodes.
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
        RayIntegral::step(&self.field(stretch, a, b), self.length(stretch, a, b))
    }

    /// Returns the world length from a to b.
    fn length(&self, stretch: &Stretch, a: f64, b: f64) -> f64 {
        (b - a) * stretch.half * self.measure
    }

    /// Returns extinction and emission at the nodes of a step.
    fn field(&self, stretch: &Stretch, a: f64, b: f64) -> [Weights; STAGES] {
        NODES.map(|c| self.emission(stretch, a + (b - a) * c))
    }

    fn emission(&self, stretch: &Stretch, x: f64) -> Weights {
        let [scalar, differences @ ..] = stretch.series.at(x);
        let classified = self.classifier.transfer.sample(self.value(scalar));
        let place = self.ray.origin + self.ray.direction * (stretch.middle + stretch.half * x);
        let differences = differences.map(|d| d / self.divisor);
        self.classifier
            .lit(classified, scalar / self.divisor, differences, place, self.to_eye, || (self.arriving)(place))
    }
}

/// The largest sum of splats on a ray.
#[derive(Debug)]
pub(super) struct Maximum {
    /// The largest sum so far; `None` before the first piece.
    pub(super) largest: Option<f64>,
    /// The place of the largest sum on the ray, in voxels.
    pub(super) place: f64,
    /// The attenuation of sums over 0.
    pub(super) fade: Attenuation,
}

/// The attenuation of sums by depth: the factor exp(-(start + slope p)) at p voxels along the ray.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Attenuation {
    pub(super) start: f64,
    /// The rise of the attenuation per voxel, at least 0.
    pub(super) slope: f64,
}

impl Attenuation {
    /// Attenuates a sum at a place.
    fn apply(self, sum: f64, place: f64) -> f64 {
        if sum > 0.0 { sum * (-(self.start + self.slope * place)).exp() } else { sum }
    }
}

impl Visitor for Maximum {
    /// Skips a block that cannot contain the maximum.
    fn block(&mut self, block: &Block<'_>) -> Option<bool> {
        let most = self.fade.apply(block.range()[1], block.middle - block.half);
        self.largest.is_some_and(|largest| most < largest).then_some(true)
    }

    fn piece(&mut self, &RayPiece { series, middle, half, from, to }: &RayPiece<'_>) -> bool {
        self.search(&series.combined(&[1.0, 0.0, 0.0, 0.0]), &|x| middle + half * x, from, to);
        true
    }
}

impl Maximum {
    /// Searches the part from a to b by branch and bound: parts that cannot contain the maximum are skipped.
    fn search(&mut self, scalar: &Scalar, place: &impl Fn(f64) -> f64, a: f64, b: f64) {
        let Range { middle, spread, monotone } = scalar.range(a, b);
        let most = self.fade.apply(middle + spread, place(a));
        if self.largest.is_some_and(|largest| most <= largest) {
            return;
        }
        let center = f64::midpoint(a, b);
        for x in [a, center, b] {
            let value = self.fade.apply(scalar.at(x), place(x));
            if self.largest.is_none_or(|largest| value > largest) {
                (self.largest, self.place) = (Some(value), place(x));
            }
        }
        let is_found = if self.fade.slope > 0.0 {
            // If the sum rises while the factor falls, the product may be largest in between.
            b - a <= FADED || self.largest.is_some_and(|largest| most - largest <= FADED * most.abs())
        } else {
            monotone || spread <= ROUNDING * middle.abs()
        };
        if !is_found {
            self.search(scalar, place, a, center);
            self.search(scalar, place, center, b);
        }
    }
}
