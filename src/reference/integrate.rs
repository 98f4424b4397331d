//! The optical model's integral along one ray.

use super::profile::Profile;
use super::walk::{Chord, Walk};

/// Optical depth beyond which nothing more is seen: a transmittance of 1e-12.
const OPAQUE_DEPTH: f64 = 27.631_021_115_928_547;
/// Optical depth of one step at most, for the exponential to be as well resolved as the kernel.
const MAX_STEP_DEPTH: f64 = 0.25;
/// Planes gathered at once: sorting few chords at a time costs little, and an opaque ray leaves most planes alone.
const PLANES: usize = 16;

/// What a ray collects: colour (premultiplied) and optical depth.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RayIntegral {
    /// C = integral of e(t) exp(-integral_0^t tau) dt, red, green and blue.
    pub color: [f64; 3],
    /// The integral of tau, up to the end or to where the transmittance fell under 1e-12.
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
}

/// How finely a ray is cut, and in what measure.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steps<'a> {
    pub(super) profile: &'a Profile,
    /// The longest step, in voxels along the ray.
    pub(super) longest: f64,
    /// World units per voxel along the ray, over the kernel's divisor N.
    pub(super) measure: f64,
}

/// Chords of the ray being integrated; kept from ray to ray for its memory.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Chords not yet entered, the next one last.
    ahead: Vec<Chord>,
    /// Chords that hold the current position.
    inside: Vec<Chord>,
}

/// Integrates along a walk.
///
/// The truncated kernels jump where the ray enters and leaves their support, and are analytic in between: the ray is
/// cut at every such place, and each piece is integrated by Gauss's rule, which never sees a jump.
pub(super) fn integrate(mut walk: Walk<'_>, steps: Steps<'_>, scratch: &mut Scratch) -> RayIntegral {
    let Scratch { ahead, inside } = scratch;
    ahead.clear();
    inside.clear();
    let mut sum = RayIntegral::default();
    let mut position = f64::NEG_INFINITY;
    loop {
        // No chord of a plane not yet gathered begins before `complete`.
        let complete = walk.gather(PLANES, ahead);
        ahead.sort_unstable_by(|a, b| b.enter.total_cmp(&a.enter));
        loop {
            while let Some(chord) = ahead.pop_if(|c| c.enter <= position) {
                inside.push(chord);
            }
            let mut next = ahead.last().map_or(complete, |c| c.enter.min(complete));
            let mut i = 0;
            while i < inside.len() {
                if inside[i].leave <= position {
                    inside.swap_remove(i);
                } else {
                    next = next.min(inside[i].leave);
                    i += 1;
                }
            }
            if !inside.is_empty() {
                steps.piece(inside, position, next, &mut sum);
                if sum.optical_depth > OPAQUE_DEPTH {
                    return sum;
                }
            }
            position = next;
            if next >= complete {
                break;
            }
        }
        if complete == f64::INFINITY {
            return sum;
        }
    }
}

impl Steps<'_> {
    /// Adds the integral over a piece without jumps.
    fn piece(&self, inside: &[Chord], from: f64, to: f64, sum: &mut RayIntegral) {
        let count = ((to - from) / self.longest).ceil().max(1.0);
        self.cut(count, from, to, |a, b| {
            let field = self.field(inside, a, b);
            // One look tells whether the exponential needs finer steps than the kernel does. Stopping at an opaque
            // ray bounds their number, however many there are to the end of the piece.
            let depth = field.iter().map(|f| f[0]).fold(0.0, f64::max) * (b - a);
            if depth <= MAX_STEP_DEPTH {
                add(&field, b - a, sum);
                return sum.optical_depth <= OPAQUE_DEPTH;
            }
            self.cut((depth / MAX_STEP_DEPTH).ceil(), a, b, |c, d| {
                add(&self.field(inside, c, d), d - c, sum);
                sum.optical_depth <= OPAQUE_DEPTH
            })
        });
    }

    /// Calls `step` for each of `count` equal parts of a piece until it returns false; whether it never did.
    fn cut(&self, count: f64, from: f64, to: f64, mut step: impl FnMut(f64, f64) -> bool) -> bool {
        let at = |i: f64| if i < count { from + (to - from) * (i / count) } else { to };
        let mut i = 0.0;
        while i < count {
            if !step(at(i), at(i + 1.0)) {
                return false;
            }
            i += 1.0;
        }
        true
    }

    /// Extinction and emission at the nodes of a step, per voxel of length along the ray.
    fn field(&self, inside: &[Chord], from: f64, to: f64) -> [[f64; 4]; STAGES] {
        let nodes = NODES.map(|c| from + (to - from) * c);
        let mut field = [[0.0; 4]; STAGES];
        for chord in inside {
            for (sum, u) in field.iter_mut().zip(nodes) {
                let t = u - chord.closest;
                let h = self.profile.value(chord.half2 - t * t);
                for (s, w) in sum.iter_mut().zip(chord.weights) {
                    *s += w * h;
                }
            }
        }
        field.map(|f| f.map(|x| x * self.measure))
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

/// Adds a step of the given length whose field is known at the nodes.
fn add(field: &[[f64; 4]; STAGES], length: f64, sum: &mut RayIntegral) {
    let dot = |w: &[f64; STAGES]| (0..STAGES).map(|n| w[n] * field[n][0]).sum::<f64>() * length;
    for n in 0..STAGES {
        let transmittance = (-(sum.optical_depth + dot(&RUNNING[n]))).exp();
        for (color, emission) in sum.color.iter_mut().zip(&field[n][1..]) {
            *color += WEIGHTS[n] * length * transmittance * emission;
        }
    }
    sum.optical_depth += dot(&WEIGHTS);
}
