//! Post-shading along rays: scalars are reconstructed, then classified and lit.
//!
//! Samples lie at half planes. Slabs around them are classified: at the mean of the parabola through the scalar if the
//! transfer function is nearly linear there, else in two pieces along which the scalar is linear and the function is
//! integrated exactly.

use glam::DAffine3;
use pulp::Simd;

use super::arriving::ArrivingLight;
use super::blend::{Along, Blend};
use super::field::Field;
use super::lanes::{Lanes, Order, three};
use super::lattice::{Area, Reach};
use super::light::{Shader, Shine, Vector, dot};
use super::plane::{CHANNELS, Plane};
use super::rays::{Axes, Rays};
use super::rule::{RECENT, Rule};
use super::table::{Classified, Table};
use crate::transfer::scaled_share;

/// The optical depth of a slab that may be neglected, and the like amount of colour.
const LEAST_BEND: f32 = 2e-4;

/// The fields, the transfer function and the light of a post-shaded picture.
pub(super) struct Post<'a> {
    pub(super) blend: Blend<'a, Field>,
    pub(super) table: &'a Table,
    pub(super) shader: Option<&'a Shader>,
    /// The light that arrives at voxels; `None`: all light does.
    pub(super) arriving: Option<&'a ArrivingLight>,
    /// The points of gradient opacity: pairs of the length of a gradient of scalars in the world, and the share of
    /// extinction.
    pub(super) gradient_opacity: &'a [[f32; 2]],
    /// The map from the lattice to places for the shader.
    pub(super) to_places: DAffine3,
    /// The size of the lattice's cells in voxels, and the voxel at cell 0: `arriving` holds the light at voxels.
    pub(super) to_voxels: [f32; 2],
}

/// The state of a group of rays under way.
#[derive(Clone, Copy)]
pub(super) struct State<S: Simd> {
    color: Vector<S>,
    transmittance: Lanes<S>,
    /// The scalars of the last four samples, and in `differences` their central differences; sample n is at n modulo 4.
    scalars: [Lanes<S>; RECENT],
    differences: [Vector<S>; RECENT],
    /// The scalar at the end of the last slab.
    end: Lanes<S>,
    /// The classification of `end`, if it is known.
    classified: Option<Classified<S>>,
    /// The number of the last sample.
    last: isize,
}

/// The classification and the light of slabs.
pub(super) struct Shading<'a, S: Simd> {
    post: &'a Post<'a>,
    axes: Axes,
    along: Along,
    order: Order,
    /// The map from differences along a, b and the planes to gradients in the world.
    gradient: [[Lanes<S>; 3]; 3],
    /// The map from the planes to places for the shader: rows of three factors and a sum.
    places: [[Lanes<S>; 4]; 3],
}

impl<'a, S: Simd> Shading<'a, S> {
    #[inline(always)]
    pub(super) fn new(simd: S, post: &'a Post<'a>, to_lattice: &DAffine3, axes: &Axes) -> Self {
        let (frame, origin) = axes.frame();
        let gradient = (to_lattice.matrix3.transpose() * frame).to_cols_array_2d();
        let map = post.to_places * DAffine3::from_mat3_translation(frame, origin);
        let (factors, sums) = (map.matrix3.to_cols_array_2d(), map.translation.to_array());
        Self {
            post,
            axes: *axes,
            along: post.blend.along(axes),
            order: Order::new(simd),
            gradient: three!(row => three!(column => Lanes::all(simd, gradient[column][row] as f32))),
            places: three!(row => {
                let [a, b, m] = three!(column => Lanes::all(simd, factors[column][row] as f32));
                [a, b, m, Lanes::all(simd, sums[row] as f32)]
            }),
        }
    }

    /// Composites the slab around half plane number `number`, at `z`. Returns whether visible matter was found.
    #[inline(always)]
    fn composite_slab(&self, simd: S, state: &mut State<S>, rays: &Rays<S>, number: usize, z: f32) -> bool {
        let table = self.post.table;
        let before = number + RECENT - 1;
        let s0 = state.scalars[before % RECENT];
        let s1 = state.scalars[(before + 1) % RECENT];
        let s2 = state.scalars[(before + 2) % RECENT];
        let s3 = state.scalars[(before + 3) % RECENT];
        // The scalar half way to the next sample, by the cubic through four.
        let outer = s0.add(simd, s3);
        let last =
            s1.add(simd, s2).mul(simd, Lanes::all(simd, 9.0)).sub(simd, outer).mul(simd, Lanes::all(simd, 1.0 / 16.0));
        let first = state.end;
        let (low, high) = (first.min(simd, s1).min(simd, last), first.max(simd, s1).max(simd, last));
        let ends = rays.ends;
        let inside =
            ends[0].less(simd, Lanes::all(simd, z + 0.25)).and(simd, Lanes::all(simd, z - 0.25).less(simd, ends[1]));
        let above = Lanes::all(simd, table.invisible[1]).less(simd, high).and(simd, inside).any(simd);
        let below = low.less(simd, Lanes::all(simd, table.invisible[0])).and(simd, inside).any(simd);
        state.end = last;
        if !above && !below {
            state.classified = None;
            return false;
        }
        let (shine, share) = self.light(simd, &state.differences[number % RECENT], rays, z, s1);
        // Cut pieces begin or end at other scalars.
        let is_cut = Lanes::all(simd, z - 0.25).less(simd, ends[0]).any(simd)
            || ends[1].less(simd, Lanes::all(simd, z + 0.25)).any(simd);
        let apart = high.sub(simd, low).largest(simd);
        let range = [low.smallest(simd), high.largest(simd)];
        if !is_cut && table.bend(range, apart) * rays.longest <= LEAST_BEND {
            // The function is nearly linear: its mean is the function at the mean of the parabola through the three.
            let mean = s1.fma(simd, Lanes::all(simd, 4.0), first.add(simd, last));
            let mean = table.value(simd, &self.order, mean.mul(simd, Lanes::all(simd, 1.0 / 6.0)));
            let length = rays.length.mul(simd, Lanes::all(simd, 0.5)).mul(simd, share);
            composite(simd, state, &mean, length, shine.as_ref());
            state.classified = None;
            return true;
        }
        let begin = match state.classified {
            Some(begin) => begin,
            None => table.classified(simd, &self.order, first),
        };
        let middle = table.classified(simd, &self.order, s1);
        let end = table.classified(simd, &self.order, last);
        state.classified = Some(end);
        if is_cut {
            let (start, stop) = self.cut(simd, ends, z - 0.25, [first, s1]);
            let length = self.length(simd, rays, z - 0.25, share);
            composite(simd, state, &Classified::mean(simd, &start, &stop), length, shine.as_ref());
            let (start, stop) = self.cut(simd, ends, z, [s1, last]);
            let length = self.length(simd, rays, z, share);
            composite(simd, state, &Classified::mean(simd, &start, &stop), length, shine.as_ref());
        } else {
            let length = rays.length.mul(simd, Lanes::all(simd, 0.25)).mul(simd, share);
            composite(simd, state, &Classified::mean(simd, &begin, &middle), length, shine.as_ref());
            composite(simd, state, &Classified::mean(simd, &middle, &end), length, shine.as_ref());
        }
        true
    }

    /// Returns the length, in the unit of extinctions, of the part of a quarter of a plane within the ends of rays.
    #[inline(always)]
    fn length(&self, simd: S, rays: &Rays<S>, from: f32, share: Lanes<S>) -> Lanes<S> {
        let start = rays.ends[0].max(simd, Lanes::all(simd, from));
        let stop = rays.ends[1].min(simd, Lanes::all(simd, from + 0.25));
        stop.sub(simd, start).max(simd, Lanes::all(simd, 0.0)).mul(simd, rays.length).mul(simd, share)
    }

    /// Classifies the ends of the part of a quarter of a plane within the ends of rays, between two scalars.
    #[inline(always)]
    fn cut(&self, simd: S, ends: [Lanes<S>; 2], from: f32, scalars: [Lanes<S>; 2]) -> (Classified<S>, Classified<S>) {
        let (low, high) = (Lanes::all(simd, from), Lanes::all(simd, from + 0.25));
        let rise = scalars[1].sub(simd, scalars[0]).mul(simd, Lanes::all(simd, 4.0));
        let start = ends[0].max(simd, low).min(simd, high).sub(simd, low).fma(simd, rise, scalars[0]);
        let stop = ends[1].max(simd, low).min(simd, high).sub(simd, low).fma(simd, rise, scalars[0]);
        let table = self.post.table;
        (table.classified(simd, &self.order, start), table.classified(simd, &self.order, stop))
    }

    /// Returns the light on a slab, and the share of its extinction by gradient opacity.
    #[inline(always)]
    fn light(
        &self,
        simd: S,
        differences: &Vector<S>,
        rays: &Rays<S>,
        z: f32,
        scalar: Lanes<S>,
    ) -> (Option<Shine<S>>, Lanes<S>) {
        let points = self.post.gradient_opacity;
        let shader = self.post.shader;
        if shader.is_none() && points.is_empty() {
            return (None, Lanes::all(simd, 1.0));
        }
        let gradient: Vector<S> = three!(axis => {
            let [a, b, m] = self.gradient[axis];
            a.fma(simd, differences[0], b.fma(simd, differences[1], m.mul(simd, differences[2])))
        });
        let share = if points.is_empty() {
            Lanes::all(simd, 1.0)
        } else {
            let length = dot(simd, &gradient, &gradient).sqrt(simd).to_array();
            Lanes::from_array(length.map(|length| scaled_share(points, length)))
        };
        let Some(shader) = shader else { return (None, share) };
        let largest = differences[0].abs(simd).max(simd, differences[1].abs(simd)).max(simd, differences[2].abs(simd));
        let [at_a, at_b] = rays.at(simd, Lanes::all(simd, z));
        let mut kept = None;
        if let Some(arriving) = self.post.arriving {
            let plane = if self.axes.is_flipped { (self.axes.size[2] - 1) as f32 - z } else { z };
            let [factor, voxel] = self.post.to_voxels;
            let (size, first) = (Lanes::all(simd, factor), Lanes::all(simd, voxel));
            let at = [at_a.fma(simd, size, first), at_b.fma(simd, size, first)];
            let plane = plane * factor + voxel;
            kept = Some(arriving.at(simd, &self.order, self.axes.axes, at, plane));
        }
        let mut place = [Lanes::all(simd, 0.0); 3];
        if shader.has_places() {
            place = three!(axis => {
                let [a, b, m, sum] = self.places[axis];
                at_a.fma(simd, a, at_b.fma(simd, b, Lanes::all(simd, z).fma(simd, m, sum)))
            });
        }
        let surface = shader.surface(simd, largest, scalar);
        let shine = shader.shine(simd, &gradient, surface, &place, &rays.to_eye, kept.as_ref());
        (Some(shine), share)
    }
}

/// Composites a piece of matter with these means of colour times extinction, and extinction.
#[inline(always)]
fn composite<S: Simd>(simd: S, state: &mut State<S>, mean: &[Lanes<S>; 4], length: Lanes<S>, shine: Option<&Shine<S>>) {
    let extinction = mean[3].max(simd, Lanes::all(simd, 0.0));
    let passed = state.transmittance.mul(simd, extinction.mul(simd, length).exp_neg(simd));
    let absorbed = state.transmittance.sub(simd, passed);
    let per = Lanes::all(simd, 1.0).div(simd, extinction.max(simd, Lanes::all(simd, 1e-30)));
    for channel in 0..3 {
        let mut color = mean[channel].mul(simd, per);
        if let Some(shine) = shine {
            color = shine.lit(simd, channel, color);
        }
        state.color[channel] = color.fma(simd, absorbed, state.color[channel]);
    }
    state.transmittance = passed;
}

impl<S: Simd> Rule<S> for Shading<'_, S> {
    type State = State<S>;

    const BEHIND: usize = 2;
    const STEP: f64 = 0.5;
    const AROUND: [isize; 2] = [-2, 1];

    #[inline(always)]
    fn start(&self, simd: S) -> State<S> {
        let zero = Lanes::all(simd, 0.0);
        State {
            color: [zero; 3],
            transmittance: Lanes::all(simd, 1.0),
            scalars: [zero; RECENT],
            differences: [[zero; 3]; RECENT],
            end: zero,
            classified: None,
            last: isize::MIN / 2,
        }
    }

    #[inline(always)]
    fn make(&self, simd: S, plane: &mut Plane, area: &Area, number: usize) {
        let Post { blend, shader, gradient_opacity, .. } = self.post;
        let differs = shader.is_some() || !gradient_opacity.is_empty();
        // Number 0 lies half a plane before the first.
        plane.make_scalars(simd, &self.order, (blend, &self.along), (&self.axes, area), number as isize - 1, differs);
    }

    #[inline(always)]
    fn sampled(&self, state: &mut State<S>, number: usize, [scalar, a, b, m]: [Lanes<S>; CHANNELS]) {
        if state.last == number as isize - 1 {
            state.scalars[number % RECENT] = scalar;
            state.differences[number % RECENT] = [a, b, m];
        } else {
            state.scalars = [scalar; RECENT];
            state.differences = [[a, b, m]; RECENT];
            state.end = scalar;
            state.classified = None;
        }
        state.last = number as isize;
    }

    #[inline(always)]
    fn passed(&self, _: S, state: &mut State<S>, number: usize) {
        if state.last >= number as isize - 2 {
            state.scalars[number % RECENT] = state.scalars[(number + RECENT - 1) % RECENT];
            state.differences[number % RECENT] = state.differences[(number + RECENT - 1) % RECENT];
        }
    }

    #[inline(always)]
    fn slab(&self, simd: S, state: &mut State<S>, rays: &Rays<S>, (number, z): (usize, f32), shows: bool) -> bool {
        if !shows || state.last < number as isize {
            state.classified = None;
            return false;
        }
        self.composite_slab(simd, state, rays, number, z)
    }

    #[inline(always)]
    fn left(&self, _: S, state: &State<S>) -> Lanes<S> {
        state.transmittance
    }

    #[inline(always)]
    fn pixel(&self, simd: S, state: &State<S>, _: &Rays<S>) -> [Lanes<S>; 4] {
        let [r, g, b] = state.color;
        [r, g, b, Lanes::all(simd, 1.0).sub(simd, state.transmittance)]
    }
}

impl Post<'_> {
    /// The reach of rays: they end half a voxel beyond the faces; central differences take one more point.
    pub(super) const REACH: Reach = Reach { beyond: 1.0, around: 1 };

    /// Returns whether a scalar between two points of the lattice, ends included, may be visible.
    pub(super) fn shows(&self, low: [isize; 3], high: [isize; 3]) -> bool {
        let is_visible = |range: [f32; 2]| !self.table.is_invisible(range);
        self.blend.levels.iter().any(|(_, field)| field.any(low, high, is_visible))
    }
}
