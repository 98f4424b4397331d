//! Which splats a ray pierces, in order, without looking at the others; and what they add up to along it.

use glam::DVec3;

use super::classify::{Brick, Bricks, Splats};
use super::profile::{GAUSS, Gauss, Profile, SERIES, Series, bend, legendre};
use super::ray::{LatticeRay, Weights};
use crate::camera::{Camera, Growth, Projection};
use crate::volume::Grid;

/// Ends of chords closer together than this, in halves of a block, count as one.
const SAME: f64 = 1e-10;
/// Terms of the series that a part of a chord adds to a smooth block.
pub(super) const MOMENTS: usize = 4;

/// How large the kernels of a picture are: at scale s a kernel is h(x / s) / s^3 in lattice coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sizes {
    growth: Growth,
    /// World depth in front of the eye of lattice point 0, and what a voxel along each axis adds to it.
    depth: f64,
    slope: DVec3,
    /// Repetitions of the edge that reach into the volume, where the edge is repeated.
    pub(super) layers: i64,
    /// The support radius of the largest kernel.
    pub(super) reach: f64,
    /// The scale of the smallest kernel.
    pub(super) least: f64,
}

impl Sizes {
    /// Kernels of support radius `radius` that never grow.
    pub(super) fn fixed(radius: f64) -> Self {
        Self {
            growth: Growth::NONE,
            depth: 0.0,
            slope: DVec3::ZERO,
            layers: radius.ceil() as i64,
            reach: radius,
            least: 1.0,
        }
    }

    /// Kernels as a camera sees them.
    pub(super) fn seen(radius: f64, grid: &Grid, camera: &Camera, growth: Growth) -> Self {
        let eye = match camera.projection {
            Projection::Orthographic { .. } => camera.target,
            Projection::Perspective { distance, .. } => camera.target - camera.forward * distance,
        };
        // Depth is linear, so scales are largest at a corner.
        let largest = |margin: f64| {
            grid.corners(margin).map(|c| growth.at((c - eye).dot(camera.forward))).into_iter().fold(1.0, f64::max)
        };
        let layers = (radius * largest(0.0)).ceil();
        Self {
            growth,
            depth: (grid.to_world().translation - eye).dot(camera.forward),
            slope: grid.to_world().matrix3.transpose() * camera.forward,
            layers: layers as i64,
            reach: radius * largest(layers),
            least: grid
                .corners(layers)
                .map(|c| growth.at((c - eye).dot(camera.forward)))
                .into_iter()
                .fold(f64::INFINITY, f64::min),
        }
    }

    /// The scale of the largest kernel of support radius `radius`.
    pub(super) fn largest(&self, radius: f64) -> f64 {
        self.reach / radius
    }

    /// The scale s of the kernel at a lattice point.
    fn at(&self, point: [i64; 3]) -> f64 {
        if self.growth.slope == 0.0 {
            return self.least;
        }
        self.growth.at(self.depth + self.slope.dot(DVec3::from_array(point.map(|p| p as f64))))
    }
}

/// What a ray finds: splats, and how large their kernels are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight<'a> {
    pub(super) splats: &'a Splats,
    /// The support radius of a kernel that has not grown.
    pub(super) radius: f64,
    pub(super) sizes: Sizes,
}

/// The chord that a ray cuts out of one splat's support ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chord {
    /// Where the ray enters the ball, or starts inside it.
    enter: f64,
    /// Where it leaves, or ends inside it.
    leave: f64,
    /// Its closest point to the ball's centre.
    closest: f64,
    /// R^2 - r^2, r the distance of the ray from the centre: the square of half the chord.
    half2: f64,
    /// 1 / s^2 for a kernel of scale s.
    shrink: f64,
    /// With the factor 1 / s^3.
    weights: Weights,
}

impl Chord {
    /// The kernel at places u, continued analytically beyond the ends.
    #[inline]
    fn values<const N: usize>(&self, profile: &Profile, places: [f64; N]) -> [f64; N] {
        // Loops, as maps of arrays are not inlined.
        let mut y = places;
        for u in &mut y {
            let t = *u - self.closest;
            *u = (self.half2 - t * t) * self.shrink;
        }
        profile.values(y)
    }
}

/// Walks the lattice planes across a part of a ray along its dominant axis, in the order in which the ray meets them.
#[derive(Debug)]
pub(super) struct Walk<'a> {
    sight: Sight<'a>,
    bounds: [[i64; 2]; 3],
    /// The part of the ray that splats reach.
    ray: LatticeRay,
    /// The axis most parallel to the ray, and the other two, the one that is slower in memory first.
    axes: [usize; 3],
    /// The half extents, along the latter two, of the ellipse in which a plane cuts what kernels reach.
    halves: [f64; 2],
    /// The next plane, the last one, and the step from one to the next (1 or -1).
    next: i64,
    last: i64,
    step: i64,
}

impl<'a> Walk<'a> {
    /// The walk of a part of a ray; `None` where it meets no splat's box.
    pub(super) fn new(sight: Sight<'a>, ray: LatticeRay) -> Option<Self> {
        let bounds = sight.splats.bounds(sight.sizes.layers)?;
        let reach = sight.sizes.reach;
        let ray = ray.clipped(&bounds, reach)?;
        let size = ray.direction.abs();
        let main = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let axes = [main, if main == 2 { 1 } else { 2 }, if main == 0 { 1 } else { 0 }];
        // The ray's tube of radius R cuts a plane in an ellipse q^2 - (q.d)^2 = R^2, whose half extent along one
        // in-plane axis is R sqrt(1 - d^2 of the other) / |d main|.
        let half = |other: usize| reach * (1.0 - ray.direction[other].powi(2)).max(0.0).sqrt() / size[main];
        // A ball around a plane's point reaches the ray only while the ray is within the radius of that plane.
        let [a, b] = [ray.start, ray.end].map(|u| ray.origin[main] + u * ray.direction[main]);
        let low = bounds[main][0].max((a.min(b) - reach).floor() as i64);
        let high = bounds[main][1].min((a.max(b) + reach).ceil() as i64);
        if low > high {
            return None;
        }
        let (next, last, step) = if ray.direction[main] > 0.0 { (low, high, 1) } else { (high, low, -1) };
        Some(Self { sight, bounds, ray, axes, halves: [half(axes[2]), half(axes[1])], next, last, step })
    }

    /// About how many chords it gathers.
    pub(super) fn chords(&self) -> f64 {
        let planes = (self.last - self.next).abs() as f64 + 1.0;
        let [main, a, b] = self.axes;
        let across = |axis: usize| {
            (2.0 * self.sight.sizes.reach).min((self.bounds[axis][1] - self.bounds[axis][0]) as f64 + 1.0)
        };
        planes * across(a) * across(b) / self.ray.direction[main].abs()
    }

    /// Half the length of the longest part of the ray on which the splats of one plane are found.
    fn spread(&self) -> f64 {
        self.sight.sizes.reach / self.ray.direction[self.axes[0]].abs()
    }

    /// Calls `add` for the chords of the next plane. Returns the position before which no later plane's chord begins:
    /// infinity after the last plane.
    fn plane(
        &mut self,
        bricks: &'a Bricks,
        last: &mut Option<(usize, Option<&'a Brick>)>,
        mut add: impl FnMut(Chord),
    ) -> f64 {
        let [main, slow, fast] = self.axes;
        let d = self.ray.direction;
        let at = (self.next as f64 - self.ray.origin[main]) / d[main];
        let hit = self.ray.origin + d * at;
        let Sight { splats, radius, sizes } = self.sight;
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
                let half2 = (radius * scale).powi(2) - distance2;
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

/// What is known of a block before it is visited; kept from ray to ray for its memory.
#[derive(Debug, Default)]
struct Slot {
    /// How many chords hold all of the block, and what they add up to: of each weight, at each node.
    whole: usize,
    values: [[f64; SERIES]; 4],
    /// The chords that begin or end in it.
    ends: Vec<Chord>,
}

impl Slot {
    fn clear(&mut self) {
        self.whole = 0;
        self.values = [[0.0; SERIES]; 4];
        self.ends.clear();
    }
}

/// Memory of the ray being integrated.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    slots: Vec<Slot>,
    cuts: Cuts,
}

/// Where chords begin and end in a block.
#[derive(Debug, Default)]
pub(super) struct Cuts {
    /// The place, which chord, and whether it begins.
    places: Vec<(f64, usize, bool)>,
    /// The series of each chord, in the block.
    series: Vec<[f64; SERIES]>,
}

/// A stretch of a ray, so short that what a kernel adds to it is one polynomial as far as the kernel holds it. Places
/// in it are x from -1 to 1.
#[derive(Debug)]
pub(super) struct Block<'a> {
    profile: &'a Profile,
    /// Its middle, and half its length, in voxels.
    pub(super) middle: f64,
    pub(super) half: f64,
    /// Whether there are chords that hold all of it.
    filled: bool,
    /// Their sum.
    whole: Series,
    /// The others.
    ends: &'a [Chord],
}

/// A part of a block on which no chord begins or ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece<'a> {
    /// The sum of splats.
    pub(super) series: &'a Series,
    /// Its ends, in the block.
    pub(super) from: f64,
    pub(super) to: f64,
    /// No second derivative of the first weight's sum is larger in the block.
    pub(super) curvature: f64,
}

/// Calls `visit` for the blocks of a walk, front to back, until it returns false; returns that. What lies between
/// blocks is empty. Blocks are no longer than `longest`.
pub(super) fn blocks<'a>(
    mut walk: Walk<'a>,
    bricks: &'a Bricks,
    profile: &Profile,
    longest: f64,
    scratch: &mut Scratch,
    mut visit: impl FnMut(&Block<'_>, &mut Cuts) -> bool,
) -> bool {
    let LatticeRay { start, end, .. } = walk.ray;
    let count = ((end - start) / longest).ceil().max(1.0);
    let step = (end - start) / count;
    let count = count as usize;
    let begin = |block: usize| if block < count { start + block as f64 * step } else { end };
    // Chords of one plane, and those of the next before blocks are whole, are in so many blocks at most.
    let plane = 1.0 / walk.ray.direction[walk.axes[0]].abs();
    let window = (((2.0 * walk.spread() + plane) / step) as usize + 4).min(count).next_power_of_two();
    let Scratch { slots, cuts } = scratch;
    slots.resize_with(slots.len().max(window), Slot::default);
    slots.iter_mut().take(window).for_each(Slot::clear);
    let half = step / 2.0;
    let nodes = GAUSS.nodes.map(|x| half * x);
    let channels = walk.sight.splats.channels();
    let (mut visited, mut last) = (0, None);
    loop {
        let complete = walk.plane(bricks, &mut last, |chord| {
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
                let values = chord.values(profile, places);
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
                    profile,
                    middle: begin(visited) + half,
                    half,
                    filled: slot.whole > 0,
                    whole: Series::through(&slot.values),
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

impl Block<'_> {
    fn place(&self, u: f64) -> f64 {
        (u - self.middle) / self.half
    }

    /// Bounds of the first weight's sum in it.
    pub(super) fn range(&self) -> [f64; 2] {
        let [first, others @ ..] = self.whole.0.map(|term| term[0]);
        let spread: f64 = others.iter().map(|c| c.abs()).sum();
        self.ends.iter().fold([first - spread, first + spread], |[low, high], chord| {
            let largest = chord.weights[0] * self.profile.values([chord.half2 * chord.shrink])[0];
            [low + largest.min(0.0), high + largest.max(0.0)]
        })
    }

    /// Calls `visit` for its pieces, front to back, until it returns false; returns that. Sums over splats are one
    /// polynomial on each, a series of the block. What lies between pieces is empty.
    pub(super) fn pieces(&self, cuts: &mut Cuts, mut visit: impl FnMut(&Piece<'_>) -> bool) -> bool {
        let Cuts { places, series } = cuts;
        places.clear();
        series.clear();
        let gauss = &*GAUSS;
        let nodes = gauss.nodes.map(|x| self.middle + self.half * x);
        let (mut sum, mut inside) = (self.whole, usize::from(self.filled));
        let mut curvature = bend(&self.whole.0.map(|term| term[0]));
        for (index, chord) in self.ends.iter().enumerate() {
            let values = chord.values(self.profile, nodes);
            let mut terms = [0.0; SERIES];
            for (row, value) in gauss.terms.iter().zip(values) {
                for (term, t) in terms.iter_mut().zip(row) {
                    *term += t * value;
                }
            }
            curvature += chord.weights[0].abs() * bend(&terms);
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
        let mut from = -1.0;
        for &(to, index, begins) in &*places {
            if to - from > SAME {
                if inside > 0 && !visit(&Piece { series: &sum, from, to, curvature }) {
                    return false;
                }
                from = to;
            }
            let Some(terms) = series.get(index) else { continue };
            let weights = &self.ends[index].weights;
            if begins {
                sum.add(terms, weights);
                inside += 1;
            } else {
                sum.add(terms, &weights.map(|w| -w));
                inside -= 1;
            }
            if inside == 0 {
                sum = Series::default();
            }
        }
        true
    }

    /// The series that has the same moments, up to the cubic, as the sum over splats. It differs by what jumps where
    /// chords begin and end, but its integrals with smooth functions do not.
    pub(super) fn smooth(&self, rule: &Gauss<MOMENTS>) -> Series {
        let mut sum = self.whole;
        for chord in self.ends {
            let from = self.place(chord.enter).max(-1.0);
            let to = self.place(chord.leave).min(1.0);
            let (middle, half) = (f64::midpoint(from, to), (to - from) / 2.0);
            let (mut places, mut along) = (rule.nodes, rule.nodes);
            for (x, u) in places.iter_mut().zip(&mut along) {
                *x = middle + half * *x;
                *u = self.middle + self.half * *x;
            }
            let values = chord.values(self.profile, along);
            let mut moments = [0.0; MOMENTS];
            for ((place, value), weight) in places.iter().zip(values).zip(rule.terms.map(|row| row[0])) {
                let p = legendre::<MOMENTS>(*place);
                for (moment, p) in moments.iter_mut().zip(p) {
                    *moment += 2.0 * weight * value * half * p;
                }
            }
            for (m, moment) in moments.iter_mut().enumerate() {
                *moment *= m as f64 + 0.5;
            }
            sum.add(&moments, &chord.weights);
        }
        sum
    }

    /// How uneven the first weight is: the sum of the squares of its jumps where chords begin and end, for kernels
    /// that are `rim` at the rim of their support.
    pub(super) fn unevenness(&self, rim: f64) -> f64 {
        self.ends.iter().map(|chord| (chord.weights[0] * rim).powi(2)).sum()
    }
}
