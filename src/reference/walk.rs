//! Which splats a ray pierces, in order, without looking at the others; and what they add up to along it.

use glam::DVec3;

use super::classify::{Splats, Weights};
use super::profile::{Profile, SERIES, Series};
use crate::camera::{Camera, Growth, Projection};
use crate::lighting::Lighting;
use crate::volume::Grid;

/// Planes gathered at once: sorting few chords at a time costs little, and an opaque ray leaves most planes alone.
const PLANES: usize = 16;
/// Ends of chords in a part of a block that are added up one by one. Parts with more are halved, so that the cost of a
/// block grows as its number of ends and not as the square: grown kernels overlap in thousands.
const FEW: usize = 16;
/// How often a block is halved at most: where many chords end at one place, halving does not part them.
const MAX_HALVINGS: u32 = 12;
/// Ends of chords closer together than this, in voxels, count as one.
const SAME: f64 = 1e-11;

/// A ray in lattice coordinates. Positions on it are lengths u in voxels from `origin`, which lies abreast of the
/// volume however far away the eye is, so that u keeps its digits.
#[derive(Debug, Clone, Copy)]
pub(super) struct LatticeRay {
    pub(super) origin: DVec3,
    /// Unit length.
    pub(super) direction: DVec3,
    /// Where the ray starts: minus infinity for a parallel ray.
    pub(super) start: f64,
    /// Where it ends: infinity unless it was clipped.
    pub(super) end: f64,
    /// Voxels along the ray per world unit.
    pub(super) voxels_per_unit: f64,
}

impl LatticeRay {
    /// The ray from `origin_world` along `direction_world` (unit length); `two_sided` rays extend backwards as well.
    pub(super) fn new(grid: &Grid, origin_world: DVec3, direction_world: DVec3, two_sided: bool) -> Self {
        let eye = grid.to_lattice().transform_point3(origin_world);
        let step = grid.to_lattice().transform_vector3(direction_world);
        let voxels_per_unit = step.length();
        let direction = step / voxels_per_unit;
        let center = DVec3::from_array(grid.dims().map(|d| f64::from(d - 1) / 2.0));
        let ahead = (center - eye).dot(direction);
        let start = if two_sided { f64::NEG_INFINITY } else { -ahead };
        Self { origin: eye + direction * ahead, direction, start, end: f64::INFINITY, voxels_per_unit }
    }

    /// The part of the ray inside a lattice box grown by `margin`, if any.
    pub(super) fn clipped(mut self, bounds: &[[i64; 2]; 3], margin: f64) -> Option<Self> {
        for (axis, bound) in bounds.iter().enumerate() {
            let (origin, slope) = (self.origin[axis], self.direction[axis]);
            let (low, high) = (bound[0] as f64 - margin, bound[1] as f64 + margin);
            if slope == 0.0 {
                if !(low..=high).contains(&origin) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - origin) / slope, (high - origin) / slope);
            self.start = self.start.max(a.min(b));
            self.end = self.end.min(a.max(b));
        }
        (self.start < self.end).then_some(self)
    }
}

/// How large the kernels of a picture are: at scale s a kernel is h(x / s) / s^3 in lattice coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sizes {
    growth: Growth,
    /// World depth in front of the eye of lattice point 0, and what a voxel along each axis adds to it.
    depth: f64,
    slope: DVec3,
    /// Repetitions of the edge that reach into the volume, where the edge is repeated.
    layers: i64,
    /// The support radius of the largest kernel.
    reach: f64,
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
    fn at(&self, point: DVec3) -> f64 {
        self.growth.at(self.depth + self.slope.dot(point))
    }
}

/// Where light goes to, in world coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) enum Viewer {
    /// To an eye.
    At(DVec3),
    /// In one direction, unit length, wherever it comes from.
    Towards(DVec3),
}

impl Viewer {
    pub(super) fn from(self, point: DVec3) -> DVec3 {
        match self {
            Self::At(eye) => (eye - point).normalize_or_zero(),
            Self::Towards(direction) => direction,
        }
    }
}

/// What a ray finds: splats, how large their kernels are, and how lit voxels look from where the ray comes from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight<'a> {
    pub(super) grid: &'a Grid,
    pub(super) splats: &'a Splats,
    /// The support radius of a kernel that has not grown.
    pub(super) radius: f64,
    pub(super) sizes: Sizes,
    pub(super) viewer: Viewer,
    /// The light on voxels that have a gradient.
    pub(super) lighting: Option<&'a Lighting>,
}

impl Sight<'_> {
    /// What the splat at a lattice point weighs, if there is one.
    fn weights(&self, point: [i64; 3], at: DVec3) -> Option<Weights> {
        let splat = self.splats.get(point)?;
        let (Some(lighting), Some(gradient)) = (self.lighting, splat.gradient) else { return Some(splat.weights) };
        let [tau, color @ ..] = splat.weights;
        let to_eye = self.viewer.from(self.grid.to_world().transform_point3(at));
        let [red, green, blue] = lighting.shade(color, gradient, to_eye).map(|c| c * tau);
        Some([tau, red, green, blue])
    }
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
    fn add(&self, profile: &Profile, u: f64, sum: &mut Weights) {
        let t = u - self.closest;
        let h = profile.value((self.half2 - t * t) * self.shrink);
        for (s, w) in sum.iter_mut().zip(self.weights) {
            *s += w * h;
        }
    }
}

/// Walks the lattice planes across a ray's dominant axis in the order in which the ray meets them.
#[derive(Debug)]
pub(super) struct Walk<'a> {
    sight: Sight<'a>,
    bounds: [[i64; 2]; 3],
    ray: LatticeRay,
    /// The axis most parallel to the ray, and the other two, the one that is slower in memory first.
    axes: [usize; 3],
    /// The next plane, the last one, and the step from one to the next (1 or -1).
    next: i64,
    last: i64,
    step: i64,
}

impl<'a> Walk<'a> {
    /// The walk of a ray; `None` where it meets no splat's box.
    pub(super) fn new(sight: Sight<'a>, ray: LatticeRay) -> Option<Self> {
        let bounds = sight.splats.bounds(sight.sizes.layers)?;
        let reach = sight.sizes.reach;
        let part = ray.clipped(&bounds, reach)?;
        let size = ray.direction.abs();
        let main = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let axes = [main, if main == 2 { 1 } else { 2 }, if main == 0 { 1 } else { 0 }];
        // A ball around a plane's point reaches the ray only while the ray is within the radius of that plane.
        let [a, b] = [part.start, part.end].map(|u| ray.origin[main] + u * ray.direction[main]);
        let low = bounds[main][0].max((a.min(b) - reach).floor() as i64);
        let high = bounds[main][1].min((a.max(b) + reach).ceil() as i64);
        if low > high {
            return None;
        }
        let (next, last, step) = if ray.direction[main] > 0.0 { (low, high, 1) } else { (high, low, -1) };
        Some(Self { sight, bounds, ray, axes, next, last, step })
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

    /// Appends the chords of the next `planes` planes. Returns the position before which no later plane's chord
    /// begins: infinity after the last plane.
    fn gather(&mut self, planes: usize, chords: &mut Vec<Chord>) -> f64 {
        for _ in 0..planes {
            self.plane(chords);
            if self.next == self.last {
                return f64::INFINITY;
            }
            self.next += self.step;
        }
        let slope = self.ray.direction[self.axes[0]];
        (self.next as f64 - self.ray.origin[self.axes[0]]) / slope - self.sight.sizes.reach / slope.abs()
    }

    fn plane(&self, chords: &mut Vec<Chord>) {
        let [main, slow, fast] = self.axes;
        let d = self.ray.direction;
        let at = (self.next as f64 - self.ray.origin[main]) / d[main];
        let hit = self.ray.origin + d * at;
        let Sizes { reach, .. } = self.sight.sizes;
        // The ray's tube of radius R cuts the plane in an ellipse q^2 - (q.d)^2 = R^2, whose half extent along one
        // in-plane axis is R sqrt(1 - d^2 of the other) / |d main|.
        let range = |axis: usize, other: usize| {
            let half = reach * (1.0 - d[other] * d[other]).max(0.0).sqrt() / d[main].abs();
            let low = ((hit[axis] - half).ceil() as i64).max(self.bounds[axis][0]);
            let high = ((hit[axis] + half).floor() as i64).min(self.bounds[axis][1]);
            low..=high
        };
        let mut point = [self.next; 3];
        for row in range(slow, fast) {
            point[slow] = row;
            let q_slow = row as f64 - hit[slow];
            for column in range(fast, slow) {
                point[fast] = column;
                let q_fast = column as f64 - hit[fast];
                let along = q_slow * d[slow] + q_fast * d[fast];
                let distance2 = q_slow * q_slow + q_fast * q_fast - along * along;
                if distance2 >= reach * reach {
                    continue;
                }
                let position = DVec3::from_array(point.map(|p| p as f64));
                let scale = self.sight.sizes.at(position);
                let half2 = (self.sight.radius * scale).powi(2) - distance2;
                if half2 <= 0.0 {
                    continue;
                }
                let (closest, half) = (at + along, half2.sqrt());
                let enter = (closest - half).max(self.ray.start);
                let leave = (closest + half).min(self.ray.end);
                if enter >= leave {
                    continue;
                }
                if let Some(weights) = self.sight.weights(point, position) {
                    let weights = weights.map(|w| w / scale.powi(3));
                    chords.push(Chord { enter, leave, closest, half2, shrink: 1.0 / (scale * scale), weights });
                }
            }
        }
    }
}

/// Chords of the ray being integrated; kept from ray to ray for its memory.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Chords not yet entered, the next one last.
    ahead: Vec<Chord>,
    /// Chords that hold the current position.
    inside: Vec<Chord>,
    /// Chords that begin or end in the current block.
    ends: Vec<Chord>,
}

/// A stretch of a ray on which no chord begins or ends, so that sums over splats are analytic.
#[derive(Debug)]
pub(super) struct Piece<'a> {
    pub(super) from: f64,
    pub(super) to: f64,
    profile: &'a Profile,
    /// The sum of the chords that hold the whole block, over the block: its middle and half its length.
    whole: &'a Series,
    middle: f64,
    half: f64,
    /// The others that hold the piece.
    partial: &'a [Chord],
}

impl Piece<'_> {
    /// The sum of weight times kernel over all splats at a position inside.
    pub(super) fn at(&self, u: f64) -> Weights {
        let mut sum = self.whole.at((u - self.middle) / self.half);
        for chord in self.partial {
            chord.add(self.profile, u, &mut sum);
        }
        sum
    }

    /// The same as a series in x from -1 at `from` to 1 at `to`.
    pub(super) fn series(&self) -> Series {
        let (middle, half) = (f64::midpoint(self.from, self.to), (self.to - self.from) / 2.0);
        Series::through(&Series::points().map(|x| self.at(middle + half * x)))
    }
}

/// Calls `visit` for the pieces of a walk, front to back, until it returns false. What lies between pieces is empty.
///
/// Truncated kernels jump where the ray enters and leaves their support, and are analytic in between: the ray is cut at
/// every such place. It is taken in blocks of length `longest` at most. What the many chords that hold a whole block
/// add up to is one polynomial, so that only the few that begin or end in it are added up piece by piece.
pub(super) fn pieces(
    mut walk: Walk<'_>,
    profile: &Profile,
    longest: f64,
    scratch: &mut Scratch,
    mut visit: impl FnMut(&Piece<'_>) -> bool,
) {
    let Scratch { ahead, inside, ends } = scratch;
    ahead.clear();
    inside.clear();
    let mut position = f64::NEG_INFINITY;
    loop {
        // No chord of a plane not yet gathered begins before `complete`.
        let complete = walk.gather(PLANES, ahead);
        ahead.sort_unstable_by(|a, b| b.enter.total_cmp(&a.enter));
        while position < complete {
            while let Some(chord) = ahead.pop_if(|c| c.enter <= position) {
                inside.push(chord);
            }
            inside.retain(|c| c.leave > position);
            if inside.is_empty() {
                position = ahead.last().map_or(complete, |c| c.enter.min(complete));
                continue;
            }
            // Behind the end of a ray that was clipped there is nothing, not even the base.
            let end = complete.min(position + longest).min(walk.ray.end);
            let (middle, half) = (f64::midpoint(position, end), (end - position) / 2.0);
            let nodes = Series::points().map(|x| middle + half * x);
            let mut values = [[0.0; 4]; SERIES];
            ends.clear();
            for chord in &*inside {
                if chord.leave < end {
                    ends.push(*chord);
                    continue;
                }
                for (sum, u) in values.iter_mut().zip(nodes) {
                    chord.add(profile, u, sum);
                }
            }
            while let Some(chord) = ahead.pop_if(|c| c.enter < end) {
                ends.push(chord);
                inside.push(chord);
            }
            let block = Block { from: position, to: end, whole: Series::through(&values) };
            if !block.pieces(profile, ends, 0, &mut visit) {
                return;
            }
            position = end;
        }
        if complete == f64::INFINITY {
            return;
        }
    }
}

/// A stretch of a ray with the sum of the chords that hold all of it.
struct Block {
    from: f64,
    to: f64,
    /// In x from -1 at `from` to 1 at `to`.
    whole: Series,
}

impl Block {
    /// Calls `visit` for its pieces, given the chords that begin or end in it; false: no more are wanted.
    fn pieces(
        &self,
        profile: &Profile,
        ends: &[Chord],
        halvings: u32,
        visit: &mut impl FnMut(&Piece<'_>) -> bool,
    ) -> bool {
        let Self { from: start, to: end, whole } = self;
        let (middle, half) = (f64::midpoint(*start, *end), (end - start) / 2.0);
        if ends.len() > FEW && halvings < MAX_HALVINGS {
            return [(*start, middle), (middle, *end)].into_iter().all(|(from, to)| {
                let nodes = Series::points().map(|x| f64::midpoint(from, to) + (to - from) / 2.0 * x);
                let mut values = nodes.map(|u| whole.at((u - middle) / half));
                let mut inside = Vec::with_capacity(ends.len());
                for chord in ends.iter().filter(|c| c.enter < to && from < c.leave) {
                    if chord.enter > from || chord.leave < to {
                        inside.push(*chord);
                        continue;
                    }
                    for (sum, u) in values.iter_mut().zip(nodes) {
                        chord.add(profile, u, sum);
                    }
                }
                Self { from, to, whole: Series::through(&values) }.pieces(profile, &inside, halvings + 1, visit)
            });
        }
        let mut cuts: Vec<f64> =
            ends.iter().flat_map(|c| [c.enter, c.leave]).filter(|u| start < u && u < end).collect();
        cuts.push(*end);
        cuts.sort_unstable_by(f64::total_cmp);
        let mut partial = Vec::with_capacity(ends.len());
        let mut from = *start;
        for to in cuts {
            if to - from < SAME && to < *end {
                continue;
            }
            let at = f64::midpoint(from, to);
            partial.clear();
            partial.extend(ends.iter().filter(|c| c.enter < at && at < c.leave));
            let piece = Piece { from, to, profile, whole, middle, half, partial: &partial };
            from = to;
            if piece.from < piece.to && !visit(&piece) {
                return false;
            }
        }
        true
    }
}
