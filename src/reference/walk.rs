//! Which splats a ray pierces, in order, without looking at the others.

use glam::DVec3;

use super::classify::{Splats, Weights};
use crate::volume::Grid;

/// A ray in lattice coordinates. Positions on it are lengths u in voxels from `origin`, which lies abreast of the
/// volume however far away the eye is, so that u keeps its digits.
#[derive(Debug, Clone, Copy)]
pub(super) struct LatticeRay {
    pub(super) origin: DVec3,
    /// Unit length.
    pub(super) direction: DVec3,
    /// Where the ray starts: minus infinity for a parallel ray.
    pub(super) start: f64,
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
        Self { origin: eye + direction * ahead, direction, start, voxels_per_unit }
    }

    /// The part of the ray inside a lattice box grown by `margin`, if any.
    fn clip(&self, bounds: &[[i64; 2]; 3], margin: f64) -> Option<(f64, f64)> {
        let (mut from, mut to) = (self.start, f64::INFINITY);
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
            from = from.max(a.min(b));
            to = to.min(a.max(b));
        }
        (from < to).then_some((from, to))
    }
}

/// The chord that a ray cuts out of one splat's support ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chord {
    /// Where the ray enters the ball, or starts inside it.
    pub(super) enter: f64,
    /// Where it leaves.
    pub(super) leave: f64,
    /// Its closest point to the ball's centre.
    pub(super) closest: f64,
    /// R^2 - r^2, r the distance of the ray from the centre: the square of half the chord.
    pub(super) half2: f64,
    pub(super) weights: Weights,
}

/// Walks the lattice planes across a ray's dominant axis in the order in which the ray meets them.
#[derive(Debug)]
pub(super) struct Walk<'a> {
    splats: &'a Splats,
    bounds: [[i64; 2]; 3],
    ray: LatticeRay,
    radius: f64,
    /// The axis most parallel to the ray, and the other two, the one that is slower in memory first.
    axes: [usize; 3],
    /// The next plane, the last one, and the step from one to the next (1 or -1).
    next: i64,
    last: i64,
    step: i64,
}

impl<'a> Walk<'a> {
    /// The walk of a ray through the splats of support radius `radius`; `None` where it meets none of their box.
    pub(super) fn new(splats: &'a Splats, ray: LatticeRay, radius: f64) -> Option<Self> {
        let bounds = splats.bounds()?;
        let (from, to) = ray.clip(&bounds, radius)?;
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
        let (a, b) = (ray.origin[main] + from * ray.direction[main], ray.origin[main] + to * ray.direction[main]);
        let low = bounds[main][0].max((a.min(b) - radius).floor() as i64);
        let high = bounds[main][1].min((a.max(b) + radius).ceil() as i64);
        if low > high {
            return None;
        }
        let (next, last, step) = if ray.direction[main] > 0.0 { (low, high, 1) } else { (high, low, -1) };
        Some(Self { splats, bounds, ray, radius, axes, next, last, step })
    }

    /// Appends the chords of the next `planes` planes. Returns the position before which no later plane's chord
    /// begins: infinity after the last plane.
    pub(super) fn gather(&mut self, planes: usize, chords: &mut Vec<Chord>) -> f64 {
        for _ in 0..planes {
            self.plane(chords);
            if self.next == self.last {
                return f64::INFINITY;
            }
            self.next += self.step;
        }
        let slope = self.ray.direction[self.axes[0]];
        (self.next as f64 - self.ray.origin[self.axes[0]]) / slope - self.radius / slope.abs()
    }

    fn plane(&self, chords: &mut Vec<Chord>) {
        let [main, slow, fast] = self.axes;
        let d = self.ray.direction;
        let at = (self.next as f64 - self.ray.origin[main]) / d[main];
        let hit = self.ray.origin + d * at;
        let radius2 = self.radius * self.radius;
        // The ray's tube of radius R cuts the plane in an ellipse q^2 - (q.d)^2 = R^2, whose half extent along one
        // in-plane axis is R sqrt(1 - d^2 of the other) / |d main|.
        let range = |axis: usize, other: usize| {
            let half = self.radius * (1.0 - d[other] * d[other]).max(0.0).sqrt() / d[main].abs();
            let low = ((hit[axis] - half).ceil() as i64).max(self.bounds[axis][0]);
            let high = ((hit[axis] + half).floor() as i64).min(self.bounds[axis][1]);
            low..=high
        };
        let mut point = [0_usize; 3];
        // All three lie inside `bounds`, which start at 0 or later.
        point[main] = self.next as usize;
        for row in range(slow, fast) {
            point[slow] = row as usize;
            let q_slow = row as f64 - hit[slow];
            for column in range(fast, slow) {
                point[fast] = column as usize;
                let q_fast = column as f64 - hit[fast];
                let along = q_slow * d[slow] + q_fast * d[fast];
                let half2 = radius2 - (q_slow * q_slow + q_fast * q_fast - along * along);
                if half2 <= 0.0 {
                    continue;
                }
                let Some(&weights) = self.splats.get(point) else { continue };
                let (closest, half) = (at + along, half2.sqrt());
                let enter = (closest - half).max(self.ray.start);
                let leave = closest + half;
                if enter < leave {
                    chords.push(Chord { enter, leave, closest, half2, weights });
                }
            }
        }
    }
}
