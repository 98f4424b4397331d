//! Projections of intensity: the largest, the smallest or the mean scalar along rays.

use glam::DVec3;
use pulp::Simd;

use super::blend::{Along, Blend};
use super::field::Field;
use super::lanes::{Lanes, Order, three};
use super::lattice::{PlaneArea, Reach, ReadPoints};
use super::plane::{CHANNELS, Plane};
use super::rays::{Axes, Rays};
use super::rule::{RECENT, Rule};

/// The scalar along a ray that a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Extreme {
    Largest,
    Smallest,
    Mean,
}

/// The fields and the depths of a projection.
pub(super) struct Projection<'a> {
    pub(super) blend: Blend<'a, Field>,
    pub(super) extreme: Extreme,
    /// The gradient of depth over the lattice, and the depth at point 0: 0 at the nearest corner of the box of the
    /// voxels and 1 at the farthest, along the view.
    pub(super) depth: (DVec3, f64),
    /// The attenuation with depth; see [`Settings::attenuation`](crate::settings::Settings::attenuation).
    pub(super) attenuation: f32,
}

impl Projection<'_> {
    /// The reach of rays: they end half a voxel beyond the faces; planes of scalars are made without their outermost
    /// points.
    pub(super) const REACH: Reach = Reach { beyond: 1.0, around: 1 };
}

/// The state of a group of rays under way.
#[derive(Clone, Copy)]
pub(super) struct ProjectedState<S: Simd> {
    /// The scalars of the last samples; sample n is at n modulo 4.
    scalars: [Lanes<S>; RECENT],
    /// The extreme scalar, or the sum of the scalars.
    value: Lanes<S>,
    /// The plane of the extreme, or the number of planes that were added up.
    planes: Lanes<S>,
    last: isize,
}

/// The scalars of projections along the rays of a tile.
pub(super) struct Projecting<'a, S: Simd> {
    projection: &'a Projection<'a>,
    axes: Axes,
    along: Along,
    order: Order,
    /// The sign of scalars: -1 if the smallest is searched, otherwise 1.
    sign: Lanes<S>,
    /// The depth over the planes: factors of the place along a, b and the planes, and a sum.
    depth: [Lanes<S>; 4],
}

impl<'a, S: Simd> Projecting<'a, S> {
    #[inline(always)]
    pub(super) fn new(simd: S, projection: &'a Projection<'a>, axes: &Axes) -> Self {
        let sign = if projection.extreme == Extreme::Smallest { -1.0 } else { 1.0 };
        let (along, order) = (projection.blend.along(axes), Order::new(simd));
        let (frame, origin) = axes.frame();
        let (gradient, at_zero) = projection.depth;
        let [a, b, m] = (frame.transpose() * gradient).to_array();
        let [a, b, m] = three!(axis => Lanes::all(simd, [a, b, m][axis] as f32));
        let depth = [a, b, m, Lanes::all(simd, (at_zero + gradient.dot(origin)) as f32)];
        Self { projection, axes: *axes, along, order, sign: Lanes::all(simd, sign), depth }
    }

    /// Returns the depths of rays in a plane, or in a plane for each ray.
    #[inline(always)]
    fn depth(&self, simd: S, rays: &Rays<S>, plane: Lanes<S>) -> Lanes<S> {
        let ([at_a, at_b], [a, b, m, sum]) = (rays.at(simd, plane), self.depth);
        at_a.fma(simd, a, at_b.fma(simd, b, plane.fma(simd, m, sum)))
    }

    /// Attenuates scalars in a plane by the depths of the rays.
    #[inline(always)]
    fn attenuated(&self, simd: S, rays: &Rays<S>, plane: f32, scalars: Lanes<S>) -> Lanes<S> {
        let attenuation = self.projection.attenuation;
        if attenuation <= 0.0 {
            return scalars;
        }
        let depth = self.depth(simd, rays, Lanes::all(simd, plane)).max(simd, Lanes::all(simd, 0.0));
        scalars.mul(simd, depth.mul(simd, Lanes::all(simd, attenuation)).exp_neg(simd))
    }
}

impl<S: Simd> Rule<S> for Projecting<'_, S> {
    type State = ProjectedState<S>;

    const BEHIND: usize = 1;
    const STEP: f64 = 0.5;
    const AROUND: [isize; 2] = [0, 0];

    #[inline(always)]
    fn scalars(&self) -> Option<(&Blend<'_, Field>, &Along)> {
        Some((&self.projection.blend, &self.along))
    }

    #[inline(always)]
    fn start(&self, simd: S, _: usize) -> ProjectedState<S> {
        let zero = Lanes::all(simd, 0.0);
        let least = if self.projection.extreme == Extreme::Mean { 0.0 } else { f32::NEG_INFINITY };
        ProjectedState { scalars: [zero; RECENT], value: Lanes::all(simd, least), planes: zero, last: isize::MIN / 2 }
    }

    #[inline(always)]
    fn make(&self, simd: S, plane: &mut Plane, (area, read): (&PlaneArea, &ReadPoints), number: usize) {
        // Number 0 lies half a plane before the first.
        let blend = (&self.projection.blend, &self.along);
        plane.make_scalars(simd, &self.order, blend, (&self.axes, area, read), number as isize - 1, false);
    }

    #[inline(always)]
    fn sampled(&self, state: &mut ProjectedState<S>, number: usize, [scalar, ..]: [Lanes<S>; CHANNELS]) {
        if state.last < number as isize - 1 {
            state.scalars = [scalar; RECENT];
        }
        state.scalars[number % RECENT] = scalar;
        state.last = number as isize;
    }

    #[inline(always)]
    fn passed(&self, _: S, state: &mut ProjectedState<S>, number: usize) {
        state.scalars[number % RECENT] = state.scalars[(number + RECENT - 1) % RECENT];
    }

    #[inline(always)]
    fn slab(&self, simd: S, state: &mut ProjectedState<S>, rays: &Rays<S>, (number, z): (usize, f32), _: bool) -> bool {
        if state.last < number as isize {
            return false;
        }
        let all = |value: f32| Lanes::all(simd, value);
        // Samples from half plane to half plane: the slab reaches half way to its neighbours.
        let [before, own, behind] = three!(index => {
            let scalars = state.scalars[(number + RECENT - 1 + index) % RECENT].mul(simd, self.sign);
            self.attenuated(simd, rays, z - 0.5 + 0.5 * index as f32, scalars)
        });
        let (half, zero) = (all(0.5), all(0.0));
        let at = |end: Lanes<S>| end.sub(simd, all(z)).mul(simd, all(2.0)).max(simd, all(-0.5)).min(simd, half);
        let (low, high) = (at(rays.ends[0]), at(rays.ends[1]));
        let inside = low.less(simd, high);
        if !inside.any(simd) {
            return false;
        }
        let slope = behind.sub(simd, before).mul(simd, half);
        let bend = own.fma(simd, all(-2.0), before.add(simd, behind));
        if self.projection.extreme == Extreme::Mean {
            let length = high.sub(simd, low);
            let linear = high.fma(simd, high, zero.sub(simd, low.mul(simd, low))).mul(simd, half);
            let cube = high.mul(simd, high).mul(simd, high).sub(simd, low.mul(simd, low).mul(simd, low));
            let sum = bend.mul(simd, cube).mul(simd, all(1.0 / 6.0));
            let sum = own.fma(simd, length, slope.fma(simd, linear, sum));
            state.value = state.value.add(simd, sum.or(simd, inside, zero));
            state.planes = state.planes.add(simd, length.or(simd, inside, zero));
            return true;
        }
        // The parabola through three samples at both ends of the slab, and at its vertex.
        let vertex = zero.sub(simd, slope).div(simd, bend.min(simd, all(-1e-30)));
        for place in [low, high, vertex.max(simd, low).min(simd, high)] {
            let value = place.mul(simd, half).fma(simd, bend, slope).fma(simd, place, own);
            let is_larger = state.value.less(simd, value).and(simd, inside);
            state.planes = place.fma(simd, half, all(z)).or(simd, is_larger, state.planes);
            state.value = value.or(simd, is_larger, state.value);
        }
        true
    }

    #[inline(always)]
    fn left(&self, simd: S, _: &ProjectedState<S>) -> Lanes<S> {
        Lanes::all(simd, 1.0)
    }

    /// Returns the extreme or the sum of the scalars, and its depth or the number of planes that were added up.
    #[inline(always)]
    fn pixel(&self, simd: S, state: &ProjectedState<S>, rays: &Rays<S>) -> [Lanes<S>; 4] {
        let zero = Lanes::all(simd, 0.0);
        let planes =
            if self.projection.extreme == Extreme::Mean { state.planes } else { self.depth(simd, rays, state.planes) };
        [state.value.mul(simd, self.sign), planes, zero, zero]
    }
}
