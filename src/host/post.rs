//! Post-shading along rays: scalars are reconstructed, then classified and lit.
//!
//! Samples lie at half planes; those of wide kernels are interpolated between planes (`between.rs`). Slabs around them
//! are classified: at the mean of the parabola through the scalar if the transfer function is nearly linear there, else
//! in two pieces along which the scalar is linear and the function is integrated exactly.

use glam::DAffine3;
use pulp::Simd;

use super::arriving::ArrivingLight;
use super::between::half_way;
use super::blend::{Along, Blend};
use super::field::Field;
use super::lanes::{LaneMask, Lanes, Order, three};
use super::lattice::{PlaneArea, Reach, ReadPoints};
use super::light::{Shader, Shine, Vector, dot};
use super::plane::{CHANNELS, Plane};
use super::rays::{Axes, Rays};
use super::rule::{RECENT, Rule};
use super::table::{Classified, Table};
use crate::lighting::shadow::SURFACE_BIAS;
use crate::transfer::scalars::Reduction;
use crate::transfer::{ControlPoint, TransferFunction, scaled_share};

/// The optical depth of a slab that may be neglected, and the like amount of colour.
const LEAST_BEND: f32 = 2e-4;

/// The fields, the transfer function and the light of a post-shaded picture.
pub(super) struct Post<'a> {
    pub(super) blend: Blend<'a, Field>,
    pub(super) table: &'a Table,
    pub(super) shader: Option<Shader>,
    pub(super) surfaces: Vec<Surface>,
    /// The light that arrives at voxels; `None`: all light does.
    pub(super) arriving: Option<&'a ArrivingLight>,
    /// The points of gradient opacity: pairs of the length of a gradient of scalars in the world, and the share of
    /// extinction.
    pub(super) gradient_opacity: Vec<[f32; 2]>,
    /// The map from the lattice to places for the shader.
    pub(super) to_places: DAffine3,
    /// The size of the lattice's cells in voxels, and the voxel at cell 0: `arriving` holds the light at voxels.
    pub(super) to_voxels: [f32; 2],
}

/// An isosurface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surface {
    /// The scalar at the surface.
    scalar: f32,
    color: [f32; 3],
    /// The share of light that passes the surface, and its optical depth.
    passes: f32,
    depth: f32,
}

/// An isosurface where rays of a group meet it.
#[derive(Clone, Copy)]
pub(super) struct Met<S: Simd> {
    /// The plane of each ray; beyond all planes for rays that do not meet it.
    pub(super) plane: Lanes<S>,
    /// The colour in the light.
    pub(super) color: Vector<S>,
    /// The share of light that passes, and the optical depth: 1 and 0 for rays that do not meet it.
    pub(super) passes: Lanes<S>,
    pub(super) depth: Lanes<S>,
}

impl<S: Simd> Met<S> {
    /// Composites the surface: the colour, the transmittance, and the plane of the surface that let less than half of
    /// the light pass.
    #[inline(always)]
    pub(super) fn composite(&self, simd: S, color: &mut Vector<S>, left: &mut Lanes<S>, half: &mut Lanes<S>) {
        let passed = left.mul(simd, self.passes);
        let absorbed = left.sub(simd, passed);
        *color = three!(channel => self.color[channel].fma(simd, absorbed, color[channel]));
        let halves = passed.less(simd, Lanes::all(simd, 0.5));
        // Rays that do not meet the surface have it beyond all planes.
        *half = half.min(simd, self.plane).or(simd, halves, *half);
        *left = passed;
    }
}

impl Surface {
    /// Returns the isosurfaces of a transfer function, in scalars, ascending.
    pub(super) fn of(transfer: &TransferFunction, reduction: &Reduction) -> Vec<Self> {
        let surface = |p: &ControlPoint| Self {
            scalar: reduction.scalar(p.value),
            color: p.color.map(|c| c as f32),
            passes: (1.0 - p.opacity.min(TransferFunction::MAX_OPACITY)) as f32,
            depth: TransferFunction::extinction(p.opacity, 1.0) as f32,
        };
        transfer.isosurfaces().iter().map(surface).collect()
    }
}

/// The state of a group of rays under way.
#[derive(Clone)]
pub(super) struct PostState<S: Simd> {
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
    /// The plane of the isosurface that let less than half of the light pass, beyond all planes if none did.
    half: Lanes<S>,
    /// The isosurfaces that were met, front to back along each ray.
    pub(super) met: Vec<Met<S>>,
}

/// The classification and the light of slabs.
pub(super) struct SlabShading<'a, S: Simd> {
    post: &'a Post<'a>,
    axes: Axes,
    along: Along,
    order: Order,
    /// The map from differences along a, b and the planes to gradients in the world over `steepest`.
    gradient: [[Lanes<S>; 3]; 3],
    steepest: f32,
    /// The map from the planes to places for the shader: rows of three factors and a sum.
    places: [[Lanes<S>; 4]; 3],
    /// Whether states keep the isosurfaces that were met.
    keeps: bool,
}

impl<'a, S: Simd> SlabShading<'a, S> {
    #[inline(always)]
    pub(super) fn new(simd: S, post: &'a Post<'a>, to_lattice: &DAffine3, axes: &Axes, keeps: bool) -> Self {
        let (frame, origin) = axes.frame();
        let gradient = (to_lattice.matrix3.transpose() * frame).to_cols_array_2d();
        let steepest = gradient.as_flattened().iter().fold(f64::MIN_POSITIVE, |most, factor| most.max(factor.abs()));
        let map = post.to_places * DAffine3::from_mat3_translation(frame, origin);
        let (factors, sums) = (map.matrix3.to_cols_array_2d(), map.translation.to_array());
        Self {
            post,
            axes: *axes,
            along: post.blend.along(axes),
            order: Order::new(simd),
            gradient: three!(row => three!(column => Lanes::all(simd, (gradient[column][row] / steepest) as f32))),
            steepest: steepest as f32,
            places: three!(row => {
                let [a, b, m] = three!(column => Lanes::all(simd, factors[column][row] as f32));
                [a, b, m, Lanes::all(simd, sums[row] as f32)]
            }),
            keeps,
        }
    }

    /// Composites the slab around half plane number `number`, at `z`. Returns whether visible matter was found.
    #[inline(always)]
    fn composite_slab(&self, simd: S, state: &mut PostState<S>, rays: &Rays<S>, number: usize, z: f32) -> bool {
        let table = self.post.table;
        let before = number + RECENT - 1;
        let s0 = state.scalars[before % RECENT];
        let s1 = state.scalars[(before + 1) % RECENT];
        let s2 = state.scalars[(before + 2) % RECENT];
        let s3 = state.scalars[(before + 3) % RECENT];
        // The scalar half way to the next sample.
        let last = half_way(simd, [s0, s1, s2, s3]);
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
        if !self.post.surfaces.is_empty() {
            self.composite_surfaces(simd, state, rays, (number, z), [first, s1, last]);
            if table.is_clear {
                state.classified = None;
                return true;
            }
        }
        let (shine, share) = self.light(simd, &state.differences[number % RECENT], rays, (z, None), s1);
        // Rays that begin or end within the slab have a part of it.
        let cuts =
            Lanes::all(simd, z - 0.25).less(simd, ends[0]).or(simd, ends[1].less(simd, Lanes::all(simd, z + 0.25)));
        let is_cut = cuts.and(simd, inside).any(simd);
        let share = share.or(simd, inside, Lanes::all(simd, 0.0));
        let apart = high.sub(simd, low).largest(simd);
        let range = [low.smallest(simd), high.largest(simd)];
        if table.bend(range, apart) * rays.longest <= LEAST_BEND {
            // The function is nearly linear: its mean is the function at the mean of the parabola through the three.
            let (mut mean, mut part) = (Lanes::all(simd, 1.0 / 3.0), [Lanes::all(simd, 0.0), Lanes::all(simd, 0.5)]);
            if is_cut {
                let [from, to] = ends.map(|end| {
                    let place = end.sub(simd, Lanes::all(simd, z)).mul(simd, Lanes::all(simd, 4.0));
                    place.max(simd, Lanes::all(simd, -1.0)).min(simd, Lanes::all(simd, 1.0))
                });
                let sum = from.add(simd, to);
                mean = sum.fma(simd, sum, Lanes::all(simd, 0.0).sub(simd, from.mul(simd, to)));
                mean = mean.mul(simd, Lanes::all(simd, 1.0 / 3.0));
                part = [sum.mul(simd, Lanes::all(simd, 0.5)), to.sub(simd, from).mul(simd, Lanes::all(simd, 0.25))];
            }
            let slope = last.sub(simd, first).mul(simd, Lanes::all(simd, 0.5));
            let bend = first.add(simd, last).fma(simd, Lanes::all(simd, 0.5), Lanes::all(simd, 0.0).sub(simd, s1));
            let mean = mean.fma(simd, bend, part[0].fma(simd, slope, s1));
            let mean = table.value(simd, &self.order, mean);
            composite(simd, state, &mean, rays.length.mul(simd, part[1]).mul(simd, share), shine.as_ref());
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

    /// Composites the isosurfaces that rays meet in the slab around half plane number `number`, at `z`, given the
    /// scalars at its beginning, middle and end.
    #[inline(always)]
    fn composite_surfaces(
        &self,
        simd: S,
        state: &mut PostState<S>,
        rays: &Rays<S>,
        (number, z): (usize, f32),
        scalars: [Lanes<S>; 3],
    ) {
        let all = |value: f32| Lanes::all(simd, value);
        let surfaces = &self.post.surfaces;
        // Rays that rise meet the lowest surface first.
        for half in 0..2 {
            let (from, to) = (scalars[half], scalars[half + 1]);
            for order in 0..2 * surfaces.len() {
                let rises = order < surfaces.len();
                let surface = if rises { surfaces[order] } else { surfaces[2 * surfaces.len() - 1 - order] };
                let scalar = all(surface.scalar);
                let (below, above) = if rises { (from, to) } else { (to, from) };
                let meets = above.less(simd, scalar).not(simd).and(simd, below.less(simd, scalar));
                if meets.any(simd) {
                    let root = self.root(simd, scalars, half, scalar);
                    self.composite_surface(simd, state, rays, (number, z), (surface, rises, meets, root));
                }
            }
        }
    }

    /// Returns the place in a half of a slab, from -1 to 1 over the slab, where the parabola through its scalars is a
    /// scalar: the place on the chord, and two of Newton's steps.
    #[inline(always)]
    fn root(&self, simd: S, [first, middle, last]: [Lanes<S>; 3], half: usize, scalar: Lanes<S>) -> Lanes<S> {
        let all = |value: f32| Lanes::all(simd, value);
        let (from, to) = if half == 0 { (first, middle) } else { (middle, last) };
        let least = all(1e-36);
        let low = all(half as f32 - 1.0);
        let high = all(half as f32);
        let over = |number: Lanes<S>, by: Lanes<S>| {
            let size = by.abs(simd).max(simd, least);
            let sign = all(-1.0).or(simd, by.less(simd, all(0.0)), all(1.0));
            number.mul(simd, sign).div(simd, size)
        };
        let mut place = over(scalar.sub(simd, from), to.sub(simd, from)).add(simd, low);
        let slope = last.sub(simd, first).mul(simd, all(0.5));
        let bend = first.add(simd, last).mul(simd, all(0.5)).sub(simd, middle);
        for _ in 0..2 {
            let value = place.fma(simd, bend, slope).fma(simd, place, middle).sub(simd, scalar);
            let rise = place.mul(simd, all(2.0)).fma(simd, bend, slope);
            place = place.sub(simd, over(value, rise)).max(simd, low).min(simd, high);
        }
        place
    }

    /// Composites an isosurface where rays meet it, at a place of a slab from -1 to 1.
    #[inline(always)]
    fn composite_surface(
        &self,
        simd: S,
        state: &mut PostState<S>,
        rays: &Rays<S>,
        (number, z): (usize, f32),
        (surface, rises, meets, place): (Surface, bool, LaneMask<S>, Lanes<S>),
    ) {
        let all = |value: f32| Lanes::all(simd, value);
        let plane = place.fma(simd, all(0.25), all(z));
        let is_cut = plane.less(simd, rays.ends[0]).or(simd, rays.ends[1].less(simd, plane));
        let meets = meets.and(simd, is_cut.not(simd));
        // Samples are half a plane apart, slabs as thick.
        let beyond = place.mul(simd, all(0.5));
        let [before, own, behind] = [number + RECENT - 1, number, number + 1].map(|n| &state.differences[n % RECENT]);
        let is_before = place.less(simd, all(0.0));
        let differences: Vector<S> = three!(axis => {
            let rise = own[axis].sub(simd, before[axis]).or(simd, is_before, behind[axis].sub(simd, own[axis]));
            beyond.fma(simd, rise, own[axis])
        });
        let ahead = all(if rises { -SURFACE_BIAS } else { SURFACE_BIAS });
        let (shine, _) = self.light(simd, &differences, rays, (z, Some(ahead)), all(surface.scalar));
        let mut color: Vector<S> = three!(channel => all(surface.color[channel]));
        if let Some(shine) = &shine {
            color = three!(channel => shine.lit(simd, channel, color[channel]));
        }
        let met = Met {
            plane: plane.or(simd, meets, all(f32::INFINITY)),
            color,
            passes: all(surface.passes).or(simd, meets, all(1.0)),
            depth: all(surface.depth).or(simd, meets, all(0.0)),
        };
        met.composite(simd, &mut state.color, &mut state.transmittance, &mut state.half);
        if self.keeps {
            state.met.push(met);
        }
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

    /// Returns the light on a slab at `z`, and the share of its extinction by gradient opacity. The light arrives
    /// `ahead` points of the lattice along the gradient.
    #[inline(always)]
    fn light(
        &self,
        simd: S,
        differences: &Vector<S>,
        rays: &Rays<S>,
        (z, ahead): (f32, Option<Lanes<S>>),
        scalar: Lanes<S>,
    ) -> (Option<Shine<S>>, Lanes<S>) {
        let points = &self.post.gradient_opacity;
        let shader = &self.post.shader;
        if shader.is_none() && points.is_empty() {
            return (None, Lanes::all(simd, 1.0));
        }
        let largest = differences[0].abs(simd).max(simd, differences[1].abs(simd)).max(simd, differences[2].abs(simd));
        // Over the largest: squares of large and of small numbers leave the range of f32.
        let inverse = Lanes::all(simd, 1.0).div(simd, largest.max(simd, Lanes::all(simd, 1e-36)));
        let scaled: Vector<S> = three!(axis => differences[axis].mul(simd, inverse));
        let gradient: Vector<S> = three!(axis => {
            let [a, b, m] = self.gradient[axis];
            a.fma(simd, scaled[0], b.fma(simd, scaled[1], m.mul(simd, scaled[2])))
        });
        let share = if points.is_empty() {
            Lanes::all(simd, 1.0)
        } else {
            let length = dot(simd, &gradient, &gradient).sqrt(simd).mul(simd, largest).to_array();
            Lanes::from_array(length.map(|length| scaled_share(points, length * self.steepest)))
        };
        let Some(shader) = shader else { return (None, share) };
        let [at_a, at_b] = rays.at(simd, Lanes::all(simd, z));
        let mut kept = None;
        if let Some(arriving) = self.post.arriving {
            let mut at = [at_a, at_b, Lanes::all(simd, z)];
            if let Some(ahead) = ahead {
                let square = dot(simd, differences, differences).max(simd, Lanes::all(simd, 1e-36));
                let share = ahead.div(simd, square.sqrt(simd));
                at = three!(axis => share.fma(simd, differences[axis], at[axis]));
            }
            let [a, b, mut plane] = at;
            if self.axes.is_flipped {
                plane = Lanes::all(simd, (self.axes.size[2] - 1) as f32).sub(simd, plane);
            }
            let [factor, voxel] = self.post.to_voxels;
            let (size, first) = (Lanes::all(simd, factor), Lanes::all(simd, voxel));
            let at = three!(axis => [a, b, plane][axis].fma(simd, size, first));
            kept = Some(arriving.at(simd, &self.order, self.axes.axes, at));
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
fn composite<S: Simd>(
    simd: S,
    state: &mut PostState<S>,
    mean: &[Lanes<S>; 4],
    length: Lanes<S>,
    shine: Option<&Shine<S>>,
) {
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

impl<S: Simd> Rule<S> for SlabShading<'_, S> {
    type State = PostState<S>;

    const BEHIND: usize = 2;
    const STEP: f64 = 0.5;
    const AROUND: [isize; 2] = [-2, 1];

    #[inline(always)]
    fn scalars(&self) -> Option<(&Blend<'_, Field>, &Along)> {
        Some((&self.post.blend, &self.along))
    }

    #[inline(always)]
    fn start(&self, simd: S, _: usize) -> PostState<S> {
        let zero = Lanes::all(simd, 0.0);
        PostState {
            color: [zero; 3],
            transmittance: Lanes::all(simd, 1.0),
            scalars: [zero; RECENT],
            differences: [[zero; 3]; RECENT],
            end: zero,
            classified: None,
            last: isize::MIN / 2,
            half: Lanes::all(simd, f32::INFINITY),
            met: Vec::new(),
        }
    }

    #[inline(always)]
    fn make(&self, simd: S, plane: &mut Plane, (area, read): (&PlaneArea, &ReadPoints), number: usize) {
        let Post { blend, shader, gradient_opacity, .. } = self.post;
        let differs = shader.is_some() || !gradient_opacity.is_empty();
        // Number 0 lies half a plane before the first.
        let (blend, tile) = ((blend, &self.along), (&self.axes, area, read));
        plane.make_scalars(simd, &self.order, blend, tile, number as isize - 1, differs);
    }

    #[inline(always)]
    fn sampled(&self, state: &mut PostState<S>, number: usize, [scalar, a, b, m]: [Lanes<S>; CHANNELS]) {
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
    fn passed(&self, _: S, state: &mut PostState<S>, number: usize) {
        if state.last >= number as isize - 2 {
            state.scalars[number % RECENT] = state.scalars[(number + RECENT - 1) % RECENT];
            state.differences[number % RECENT] = state.differences[(number + RECENT - 1) % RECENT];
        }
    }

    #[inline(always)]
    fn slab(&self, simd: S, state: &mut PostState<S>, rays: &Rays<S>, (number, z): (usize, f32), shows: bool) -> bool {
        if !shows || state.last < number as isize {
            state.classified = None;
            return false;
        }
        self.composite_slab(simd, state, rays, number, z)
    }

    #[inline(always)]
    fn left(&self, _: S, state: &PostState<S>) -> Lanes<S> {
        state.transmittance
    }

    #[inline(always)]
    fn half(&self, state: &PostState<S>) -> Option<Lanes<S>> {
        Some(state.half)
    }

    #[inline(always)]
    fn pixel(&self, simd: S, state: &PostState<S>, _: &Rays<S>) -> [Lanes<S>; 4] {
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
