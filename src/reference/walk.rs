//! The splats that a ray pierces, in order, and their sums along it.

use glam::DVec3;

use super::classify::{Brick, ClassifiedBricks, VoxelValues};
use super::profile::{Chebyshev, Profile, RULE, SERIES};
use super::ray::{LatticeRay, Weights};
use crate::camera::{Camera, Growth};
use crate::kernel::quadrature::{self, integrate};
use crate::volume::Grid;

/// The distance, in halves of a block, below which ends of chords count as one end.
const SAME: f64 = 1e-10;
/// The length in voxels below which a gap between blocks is only rounding.
const GAP: f64 = 1e-9;
/// The number of panels of the quadrature of a kernel, per standard deviation: to 1e-12.
const PANELS: f64 = 2.0;

/// The sizes of the kernels of a picture: at scale s a kernel is h(x / s) / s^3 in lattice coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sizes {
    growth: Growth,
    /// The world depth of lattice point 0 in front of the eye; `slope` is its change per voxel along each axis.
    depth: f64,
    slope: DVec3,
    /// The number of repetitions of the edge that reach into the volume, if the edge is repeated.
    pub(super) layers: i64,
    /// The support radius of a kernel that has not grown.
    radius: f64,
    /// The support radius of the largest kernel.
    pub(super) reach: f64,
    /// The scale of the smallest kernel.
    pub(super) least: f64,
}

impl Sizes {
    /// Returns the sizes of kernels of support radius `radius` that never grow.
    pub(super) fn fixed(radius: f64) -> Self {
        let layers = radius.ceil() as i64;
        Self { growth: Growth::NONE, depth: 0.0, slope: DVec3::ZERO, layers, radius, reach: radius, least: 1.0 }
    }

    /// Returns the sizes of kernels of support radius `radius` in a camera's picture.
    pub(super) fn seen(radius: f64, grid: &Grid, camera: &Camera) -> Self {
        let growth = camera.growth(grid);
        let eye = camera.eye().unwrap_or(camera.target);
        // Depth is linear, so scales are largest and smallest at corners.
        let scales = |margin: f64| grid.corners(margin).map(|c| growth.at((c - eye).dot(camera.forward)));
        let largest = |margin: f64| scales(margin).into_iter().fold(1.0, f64::max);
        let layers = (radius * largest(0.0)).ceil();
        Self {
            growth,
            depth: (grid.to_world().translation - eye).dot(camera.forward),
            slope: grid.to_world().matrix3.transpose() * camera.forward,
            layers: layers as i64,
            radius,
            reach: radius * largest(layers),
            least: scales(layers).into_iter().fold(f64::INFINITY, f64::min),
        }
    }

    /// Returns the scale of the largest kernel.
    pub(super) fn largest(&self) -> f64 {
        self.reach / self.radius
    }

    /// Returns the scale s of the kernel at a lattice point.
    fn at(&self, point: [i64; 3]) -> f64 {
        if self.growth.slope == 0.0 {
            return self.least;
        }
        self.growth.at(self.depth + self.slope.dot(DVec3::from_array(point.map(|p| p as f64))))
    }
}

/// The chord that a ray cuts out of one splat's support ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chord {
    /// The place where the ray enters the ball, or starts inside it.
    enter: f64,
    /// The place where the ray leaves the ball, or ends inside it.
    leave: f64,
    /// The ray's closest point to the ball's centre.
    closest: f64,
    /// The square of half the chord: R^2 - r^2, r the distance of the ray from the centre.
    half2: f64,
    /// The factor 1 / s^2 for a kernel of scale s.
    shrink: f64,
    /// The weights of the splat with the factor 1 / s^3.
    weights: Weights,
}

impl Chord {
    /// Returns the kernel at places u, continued analytically beyond the ends.
    #[inline]
    fn values<const N: usize>(&self, profile: &Profile, places: [f64; N]) -> [f64; N] {
        // Loops, because maps of arrays are not inlined.
        let mut y = places;
        for u in &mut y {
            let t = *u - self.closest;
            *u = (self.half2 - t * t) * self.shrink;
        }
        profile.values(y)
    }

    /// Returns the integral of the kernel over the chord, times the first weight. `deviation` is the smallest kernel's.
    pub(super) fn integral(&self, profile: &Profile, deviation: f64) -> f64 {
        let panels = ((self.leave - self.enter) / deviation * PANELS).ceil();
        self.weights[0] * integrate(self.enter, self.leave, panels as u32, |u| self.values(profile, [u])[0])
    }
}

/// A walk through the lattice planes across a part of a ray along its dominant axis, in the order in which the ray
/// meets them.
#[derive(Debug)]
pub(super) struct Walk<'a> {
    splats: &'a VoxelValues,
    sizes: Sizes,
    bounds: [[i64; 2]; 3],
    /// The part of the ray that splats reach.
    ray: LatticeRay,
    /// The axis most parallel to the ray, and the other two axes, the one that is slower in memory first.
    axes: [usize; 3],
    /// The half extents, along the other two axes, of the ellipse in a plane in which the ray meets kernels.
    halves: [f64; 2],
    /// The next plane; `last` is the last one, `step` the step from one to the next (1 or -1).
    next: i64,
    last: i64,
    step: i64,
}

impl<'a> Walk<'a> {
    /// Makes the walk of a part of a ray; `None` if it misses the box of the splats.
    pub(super) fn new(splats: &'a VoxelValues, sizes: Sizes, ray: LatticeRay) -> Option<Self> {
        let bounds = splats.bounds(sizes.layers)?;
        let reach = sizes.reach;
        let ray = ray.clipped(&bounds, reach)?;
        let size = ray.direction.abs();
        let main = size.max_position();
        let axes = [main, if main == 2 { 1 } else { 2 }, if main == 0 { 1 } else { 0 }];
        // The ray's tube of radius R cuts a plane in an ellipse q^2 - (q.d)^2 = R^2, whose half extent along one
        // in-plane axis is R sqrt(1 - d^2 of the other) / |d main|.
        let half = |other: usize| reach * (1.0 - ray.direction[other].powi(2)).max(0.0).sqrt() / size[main];
        // A ball around a point of a plane meets the ray only within its radius of the plane.
        let [a, b] = [ray.start, ray.end].map(|u| ray.origin[main] + u * ray.direction[main]);
        let low = bounds[main][0].max((a.min(b) - reach).floor() as i64);
        let high = bounds[main][1].min((a.max(b) + reach).ceil() as i64);
        if low > high {
            return None;
        }
        let (next, last, step) = if ray.direction[main] > 0.0 { (low, high, 1) } else { (high, low, -1) };
        Some(Self { splats, sizes, bounds, ray, axes, halves: [half(axes[2]), half(axes[1])], next, last, step })
    }

    /// Estimates the number of chords.
    pub(super) fn chords(&self) -> f64 {
        let planes = (self.last - self.next).abs() as f64 + 1.0;
        let [main, a, b] = self.axes;
        let across =
            |axis: usize| (2.0 * self.sizes.reach).min((self.bounds[axis][1] - self.bounds[axis][0]) as f64 + 1.0);
        planes * across(a) * across(b) / self.ray.direction[main].abs()
    }

    /// Returns half the length of the longest part of the ray on which the splats of one plane are found.
    fn spread(&self) -> f64 {
        self.sizes.reach / self.ray.direction[self.axes[0]].abs()
    }

    /// Calls `add` for the chords of the next plane. Returns the position before which no later plane's chord begins:
    /// infinity after the last plane.
    pub(super) fn plane(
        &mut self,
        bricks: &'a ClassifiedBricks,
        last: &mut Option<(usize, Option<&'a Brick>)>,
        mut add: impl FnMut(Chord),
    ) -> f64 {
        let [main, slow, fast] = self.axes;
        let d = self.ray.direction;
        let at = (self.next as f64 - self.ray.origin[main]) / d[main];
        let hit = self.ray.origin + d * at;
        let Self { splats, sizes, .. } = *self;
        let reach2 = sizes.reach * sizes.reach;
        let range = |axis: usize, half: f64| {
            let low = ((hit[axis] - half).ceil() as i64).max(self.bounds[axis][0]);
            let high = ((hit[axis] + half).floor() as i64).min(self.bounds[axis][1]);
            low..=high
        };
        let mut point = [self.next; 3];
        for row in range(slow, self.halves[0]) {
            point[slow] = row;
            let q_slow = row as f64 - hit[slow];
            for column in range(fast, self.halves[1]) {
                point[fast] = column;
                let q_fast = column as f64 - hit[fast];
                let along = q_slow * d[slow] + q_fast * d[fast];
                let distance2 = q_slow * q_slow + q_fast * q_fast - along * along;
                if distance2 >= reach2 {
                    continue;
                }
                let scale = sizes.at(point);
                let half2 = (sizes.radius * scale).powi(2) - distance2;
                if half2 <= 0.0 {
                    continue;
                }
                let (closest, half) = (at + along, half2.sqrt());
                let enter = (closest - half).max(self.ray.start);
                let leave = (closest + half).min(self.ray.end);
                if enter >= leave {
                    continue;
                }
                let weights = bricks.get(splats, point, last);
                if weights == [0.0; 4] {
                    continue;
                }
                let (shrink, thin) = (1.0 / (scale * scale), 1.0 / scale.powi(3));
                add(Chord { enter, leave, closest, half2, shrink, weights: weights.map(|w| w * thin) });
            }
        }
        if self.next == self.last {
            return f64::INFINITY;
        }
        self.next += self.step;
        (self.next as f64 - self.ray.origin[main]) / d[main] - self.spread()
    }
}

/// The chords of a block before it is visited; kept from ray to ray for its memory.
#[derive(Debug, Default)]
struct Slot {
    /// The number of chords that cover the whole block; `values` are their sums, for each weight, at each node.
    whole: usize,
    values: [[f64; SERIES]; 4],
    /// The chords that begin or end in the block.
    ends: Vec<Chord>,
}

impl Slot {
    fn clear(&mut self) {
        self.whole = 0;
        self.values = [[0.0; SERIES]; 4];
        self.ends.clear();
    }
}

/// The memory of the ray being integrated.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    slots: Vec<Slot>,
    cuts: Cuts,
}

/// The ends of chords in a block; kept from block to block for their memory.
#[derive(Debug, Default)]
pub(super) struct Cuts {
    /// The place of each end, the number of the chord, and whether the chord begins.
    places: Vec<(f64, usize, bool)>,
    /// The series of each chord, in the block.
    series: Vec<[f64; SERIES]>,
}

/// A stretch of a ray, so short that a kernel in it is one polynomial up to the kernel's rim. Places in it are x from
/// -1 to 1.
#[derive(Debug)]
pub(super) struct Block<'a> {
    profile: &'a Profile,
    /// The middle of the block on the ray; `half` is half its length, in voxels.
    pub(super) middle: f64,
    pub(super) half: f64,
    /// Whether any chord covers the whole block.
    filled: bool,
    /// The sum of the chords that cover the whole block.
    whole: Chebyshev,
    /// The chords that begin or end in the block.
    ends: &'a [Chord],
}

/// A part of a ray on which the sum of splats is one polynomial.
#[derive(Debug, Clone, Copy)]
pub(super) struct RayPiece<'a> {
    /// The sum of splats on the piece, in x.
    pub(super) series: &'a Chebyshev,
    /// The place on the ray where x is 0; `half` is the number of voxels per unit of x.
    pub(super) middle: f64,
    pub(super) half: f64,
    /// The ends of the piece, `from` and `to`, in x between -1 and 1.
    pub(super) from: f64,
    pub(super) to: f64,
}

/// The integral of a model along a ray, given the sums of splats.
pub(super) trait Visitor {
    /// Adds a block as a whole, and returns whether more may be visible; `None` if it must be added piece by piece.
    fn block(&mut self, block: &Block<'_>) -> Option<bool>;

    /// Adds a piece, and returns whether more may be visible behind it.
    fn piece(&mut self, piece: &RayPiece<'_>) -> bool;
}

/// The scene that rays visit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight<'a> {
    pub(super) splats: &'a VoxelValues,
    pub(super) bricks: &'a ClassifiedBricks,
    pub(super) profile: &'a Profile,
    pub(super) sizes: Sizes,
    /// The standard deviation of the smallest kernel, and in `longest` the length of the longest block, voxels.
    pub(super) deviation: f64,
    pub(super) longest: f64,
}

impl<'a> Sight<'a> {
    /// Integrates the first weight's sum over a part of a ray, in voxels.
    pub(super) fn integral(&self, part: LatticeRay) -> f64 {
        let Some(mut walk) = Walk::new(self.splats, self.sizes, part) else { return 0.0 };
        let (mut sum, mut last) = (0.0, None);
        while walk.plane(self.bricks, &mut last, |chord| sum += chord.integral(self.profile, self.deviation))
            < f64::INFINITY
        {}
        sum
    }

    /// Visits a part of a ray, front to back, block by block or piece by piece, with the gaps in between, as long as
    /// more may be visible; returns whether it may.
    pub(super) fn visit(&self, part: LatticeRay, scratch: &mut Scratch, visitor: &mut impl Visitor) -> bool {
        let Some(walk) = Walk::new(self.splats, self.sizes, part) else { return gap(part.start, part.end, visitor) };
        let mut position = part.start;
        self.blocks(walk, scratch, |block, cuts| {
            let before = std::mem::replace(&mut position, block.middle + block.half);
            gap(before, block.middle - block.half, visitor)
                && visitor.block(block).unwrap_or_else(|| block.pieces(cuts, visitor))
        }) && gap(position, part.end, visitor)
    }

    /// Calls `visit` for the blocks of a walk that have splats, front to back, until it returns false; returns that.
    fn blocks(
        &self,
        mut walk: Walk<'a>,
        scratch: &mut Scratch,
        mut visit: impl FnMut(&Block<'_>, &mut Cuts) -> bool,
    ) -> bool {
        let LatticeRay { start, end, .. } = walk.ray;
        let count = ((end - start) / self.longest).ceil().max(1.0);
        let step = (end - start) / count;
        let count = count as usize;
        let begin = |block: usize| if block < count { start + block as f64 * step } else { end };
        // The largest number of blocks with chords of one plane, and of the next before blocks are complete.
        let plane = 1.0 / walk.ray.direction[walk.axes[0]].abs();
        let window = (((2.0 * walk.spread() + plane) / step) as usize + 4).min(count).next_power_of_two();
        let Scratch { slots, cuts } = scratch;
        slots.resize_with(slots.len().max(window), Slot::default);
        slots.iter_mut().take(window).for_each(Slot::clear);
        let half = step / 2.0;
        let nodes = RULE.nodes.map(|x| half * x);
        let channels = self.splats.channels();
        let (mut visited, mut last) = (0, None);
        loop {
            let complete = walk.plane(self.bricks, &mut last, |chord| {
                // A float to integer cast saturates.
                let first = ((chord.enter - start) / step) as usize;
                for block in first..count {
                    let (from, to) = (begin(block), begin(block + 1));
                    if from >= chord.leave {
                        break;
                    }
                    let slot = &mut slots[block & (window - 1)];
                    if chord.enter > from || chord.leave < to {
                        slot.ends.push(chord);
                        continue;
                    }
                    let middle = from + half;
                    let mut places = nodes;
                    for x in &mut places {
                        *x += middle;
                    }
                    let values = chord.values(self.profile, places);
                    slot.whole += 1;
                    for (sums, weight) in slot.values.iter_mut().zip(chord.weights).take(channels) {
                        for (sum, value) in sums.iter_mut().zip(values) {
                            *sum += weight * value;
                        }
                    }
                }
            });
            while visited < count && begin(visited + 1) <= complete {
                let slot = &mut slots[visited & (window - 1)];
                if slot.whole > 0 || !slot.ends.is_empty() {
                    let block = Block {
                        profile: self.profile,
                        middle: begin(visited) + half,
                        half,
                        filled: slot.whole > 0,
                        whole: Chebyshev::through(&slot.values),
                        ends: &slot.ends,
                    };
                    if !visit(&block, cuts) {
                        return false;
                    }
                    slot.clear();
                }
                visited += 1;
            }
            if complete == f64::INFINITY {
                return true;
            }
        }
    }
}

/// Visits the gap between two positions on a ray, unless it is only rounding.
fn gap(from: f64, to: f64, visitor: &mut impl Visitor) -> bool {
    let (middle, half) = (f64::midpoint(from, to), (to - from) / 2.0);
    to - from <= GAP || visitor.piece(&RayPiece { series: &Chebyshev::default(), middle, half, from: -1.0, to: 1.0 })
}

impl Block<'_> {
    fn place(&self, u: f64) -> f64 {
        (u - self.middle) / self.half
    }

    /// Returns bounds of the first weight's sum in the block.
    pub(super) fn range(&self) -> [f64; 2] {
        let [first, others @ ..] = self.whole.0.map(|term| term[0]);
        let spread: f64 = others.iter().map(|c| c.abs()).sum();
        self.ends.iter().fold([first - spread, first + spread], |[low, high], chord| {
            let largest = chord.weights[0] * self.profile.values([chord.half2 * chord.shrink])[0];
            [low + largest.min(0.0), high + largest.max(0.0)]
        })
    }

    /// Visits all pieces, front to back, empty pieces included, as long as more may be visible; returns whether it may.
    fn pieces(&self, cuts: &mut Cuts, visitor: &mut impl Visitor) -> bool {
        let Cuts { places, series } = cuts;
        places.clear();
        series.clear();
        let nodes = RULE.nodes.map(|x| self.middle + self.half * x);
        let (mut sum, mut inside) = (self.whole, usize::from(self.filled));
        for (index, chord) in self.ends.iter().enumerate() {
            let mut terms = [0.0; SERIES];
            for (row, value) in RULE.terms.iter().zip(chord.values(self.profile, nodes)) {
                for (term, t) in terms.iter_mut().zip(row) {
                    *term += t * value;
                }
            }
            let [enter, leave] = [chord.enter, chord.leave].map(|u| self.place(u));
            if enter > -1.0 {
                places.push((enter, index, true));
            } else {
                sum.add(&terms, &chord.weights);
                inside += 1;
            }
            if leave < 1.0 {
                places.push((leave, index, false));
            }
            series.push(terms);
        }
        places.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        places.push((1.0, usize::MAX, false));
        let (middle, half, mut from) = (self.middle, self.half, -1.0);
        for &(to, index, begins) in &*places {
            if to - from > SAME {
                if !visitor.piece(&RayPiece { series: &sum, middle, half, from, to }) {
                    return false;
                }
                from = to;
            }
            let Some(terms) = series.get(index) else { continue };
            let sign = if begins { 1.0 } else { -1.0 };
            sum.add(terms, &self.ends[index].weights.map(|w| sign * w));
            inside = if begins { inside + 1 } else { inside - 1 };
            if inside == 0 {
                sum = Chebyshev::default();
            }
        }
        true
    }

    /// Returns a series with the same moments, up to the cubic, as the sum over splats. It lacks the jumps where chords
    /// begin and end, but its integrals with smooth functions are the same.
    pub(super) fn smooth(&self) -> Chebyshev {
        let mut sum = self.whole;
        for chord in self.ends {
            let from = self.place(chord.enter).max(-1.0);
            let to = self.place(chord.leave).min(1.0);
            let (middle, half) = (f64::midpoint(from, to), (to - from) / 2.0);
            let places = quadrature::NODES.map(|(x, _)| middle + half * x);
            let values = chord.values(self.profile, places.map(|x| self.middle + self.half * x));
            let mut moments = [0.0; 4];
            for ((x, value), (_, weight)) in places.into_iter().zip(values).zip(quadrature::NODES) {
                // The coefficients of Legendre polynomials, (m + 1/2) integral of P_m.
                let share = half * weight * value;
                moments[0] += 0.5 * share;
                moments[1] += 1.5 * share * x;
                moments[2] += 2.5 * share * (1.5 * x * x - 0.5);
                moments[3] += 3.5 * share * (2.5 * x * x - 1.5) * x;
            }
            let [a, b, c, d] = moments;
            // In Chebyshev polynomials, P_2 is (1 + 3 T_2) / 4 and P_3 is (3 T_1 + 5 T_3) / 8.
            sum.add(&[a + c / 4.0, b + d * 0.375, c * 0.75, d * 0.625], &chord.weights);
        }
        sum
    }

    /// Returns the unevenness of the first weight: the sum of the squares of its jumps where chords begin and end, for
    /// kernels that are `rim` at the rim of their support.
    pub(super) fn unevenness(&self, rim: f64) -> f64 {
        self.ends.iter().map(|chord| (chord.weights[0] * rim).powi(2)).sum()
    }
}
