//! Pre-shading along rays: colours times extinctions, and extinctions, are composited.

use std::ops::Range;

use pulp::Simd;

use super::blend::{Along, Blend};
use super::colors::{ColorField, Halves, from_half};
use super::lanes::{Lanes, three};
use super::lattice::{CELL, PlaneArea, Reach, ReadPoints, TileRows};
use super::light::Vector;
use super::plane::{CHANNELS, Plane};
use super::post::Met;
use super::rays::{Axes, Rays};
use super::rule::{RECENT, Rule};

/// Sums planes of coefficients at the points of plane `number` of a tile that rays read: weights 1, 4, 1 over 6.
#[inline(always)]
fn make(
    plane: &mut Plane,
    (blend, along): (&Blend<'_, ColorField>, &Along),
    (axes, area, read): (&Axes, &PlaneArea, &ReadPoints),
    number: isize,
) {
    let rows = blend.levels[0].1.lattice.rows(axes, area, number - 1);
    let [width, height] = area.size();
    let stride = plane.resize([CELL * rows.segments(&(0..width)).end, height], rows.skipped);
    if plane.rows.len() < (CHANNELS + 1) * stride {
        plane.rows.resize((CHANNELS + 1) * stride, 0.0);
    }
    plane.note_filled(height);
    let [first, last] = blend.needed(along, [area.low, area.high], number as f64);
    let (weights, part) = plane.rows.split_at_mut(stride);
    for row in 0..height {
        let points = read.of(area, row);
        if points.is_empty() {
            continue;
        }
        let segments = rows.segments(&points);
        let points = CELL * segments.start..CELL * segments.end;
        let channels = &mut plane.channels[CHANNELS * row * stride..][..CHANNELS * points.end];
        let filled = &mut plane.filled[row * (stride / CELL)..][..segments.end];
        filled[segments.clone()].fill(false);
        for level in first..=last {
            let from = (blend.levels[level].1.coefficients(), row, segments.clone());
            if first == last {
                sum_planes(&rows, from, (channels, filled));
                continue;
            }
            sum_planes(&rows, from, (&mut part[..CHANNELS * points.end], filled));
            let low = [area.low[0] - rows.skipped as isize, area.low[1] + row as isize, number];
            blend.weights(along, level, low.map(|point| point as f64), points.clone(), weights);
            let (channels, part) = (channels.as_chunks_mut::<CHANNELS>().0, part.as_chunks::<CHANNELS>().0);
            let (channels, part) = (&mut channels[..points.end], &part[..points.end]);
            for x in points.clone() {
                for channel in 0..CHANNELS {
                    let before = if level == first { 0.0 } else { channels[x][channel] };
                    channels[x][channel] = weights[x].mul_add(part[x][channel], before);
                }
            }
        }
    }
}

/// Sums segments of a row of three planes with weights 1, 4, 1 over 6. Notes which have coefficients that are not 0.
#[inline(always)]
fn sum_planes(
    rows: &TileRows<3>,
    (coefficients, row, segments): (&[Halves], usize, Range<usize>),
    (channels, filled): (&mut [f32], &mut [bool]),
) {
    let (channels, _) = channels.as_chunks_mut::<{ CHANNELS * CELL }>();
    if rows.are_lines() {
        for segment in segments {
            filled[segment] |= sum_segment(rows.lines(coefficients, row, segment), &mut channels[segment]);
        }
    } else {
        for segment in segments {
            let [b, m, a] = rows.columns(coefficients, row, segment);
            filled[segment] |= sum_segment([&b, &m, &a], &mut channels[segment]);
        }
    }
}

#[inline(always)]
fn sum_segment([b, m, a]: [&[Halves; CELL]; 3], channels: &mut [f32; CHANNELS * CELL]) -> bool {
    let (b, m, a) = (b.as_flattened(), m.as_flattened(), a.as_flattened());
    let mut bits = 0;
    for x in 0..CHANNELS * CELL {
        let sum = from_half(b[x]) + from_half(a[x]);
        channels[x] = sum.mul_add(1.0 / 6.0, from_half(m[x]) * (4.0 / 6.0));
        bits |= b[x] | m[x] | a[x];
    }
    bits != 0
}

/// The fields of a pre-shaded picture, and its kind.
pub(super) struct Colors<'a> {
    pub(super) blend: Blend<'a, ColorField>,
    /// Whether pixels are optical depths alone.
    pub(super) is_xray: bool,
}

impl Colors<'_> {
    /// Returns the reach of rays: splines reach 2 voxels, coefficients as far as the filter.
    pub(super) fn reach(&self) -> Reach {
        let reach = self.blend.levels.iter().map(|(_, field)| field.filter_reach()).max().unwrap_or_default();
        Reach { beyond: (reach + 2) as f64, around: 0 }
    }

    /// Returns whether a coefficient in a box of the lattice, ends included, is not 0.
    pub(super) fn shows(&self, low: [isize; 3], high: [isize; 3]) -> bool {
        self.blend.levels.iter().any(|(_, field)| field.shows(low, high))
    }
}

/// The state of a group of rays under way.
#[derive(Clone)]
pub(super) struct ColorState<S: Simd> {
    color: Vector<S>,
    depth: Lanes<S>,
    transmittance: Lanes<S>,
    /// The last samples; sample n is at n modulo 4.
    samples: [[Lanes<S>; CHANNELS]; RECENT],
    /// The numbers of the last two samples.
    last: [isize; 2],
    /// The isosurfaces on the way. Those that are composited lie beyond all planes.
    met: Vec<Met<S>>,
    /// The plane of the isosurface that let less than half of the light pass, beyond all planes if none did.
    half: Lanes<S>,
}

/// The compositing of the rays of a tile.
pub(super) struct Blending<'a, S: Simd> {
    colors: &'a Colors<'a>,
    axes: Axes,
    along: Along,
    zero: Lanes<S>,
    /// The isosurfaces that the rays of each group meet; empty without isosurfaces.
    met: Vec<Vec<Met<S>>>,
}

impl<'a, S: Simd> Blending<'a, S> {
    #[inline(always)]
    pub(super) fn new(simd: S, colors: &'a Colors<'a>, axes: &Axes, met: Vec<Vec<Met<S>>>) -> Self {
        Self { colors, axes: *axes, along: colors.blend.along(axes), zero: Lanes::all(simd, 0.0), met }
    }

    /// Composites a slab around plane z and the isosurfaces before its end. Returns whether there is anything.
    #[inline(always)]
    fn between_surfaces(&self, simd: S, state: &mut ColorState<S>, rays: &Rays<S>, (number, z): (usize, f32)) -> bool {
        let (mut from, high) = (Lanes::all(simd, z - 0.5), Lanes::all(simd, z + 0.5));
        let mut meets = false;
        for index in 0..state.met.len() {
            let all = state.met[index];
            let is_here = all.plane.less(simd, high);
            if is_here.any(simd) {
                let to = all.plane.max(simd, from).or(simd, is_here, from);
                self.part(simd, state, rays, (number, z), [from, to]);
                let beyond = Lanes::all(simd, f32::INFINITY);
                let here = Met {
                    plane: all.plane.or(simd, is_here, beyond),
                    color: all.color,
                    passes: all.passes.or(simd, is_here, Lanes::all(simd, 1.0)),
                    depth: all.depth.or(simd, is_here, self.zero),
                };
                here.composite(simd, &mut state.color, &mut state.transmittance, &mut state.half);
                state.depth = state.depth.add(simd, here.depth);
                state.met[index].plane = beyond.or(simd, is_here, all.plane);
                (from, meets) = (to, true);
            }
        }
        self.part(simd, state, rays, (number, z), [from, high]) || meets
    }

    /// Composites the part of the slab around plane z between two places, in which colour is linear in optical depth,
    /// as `advance` in shaders/common/march.wgsl does. Returns whether it has visible matter.
    #[inline(always)]
    fn part(
        &self,
        simd: S,
        state: &mut ColorState<S>,
        rays: &Rays<S>,
        (number, z): (usize, f32),
        [low, high]: [Lanes<S>; 2],
    ) -> bool {
        let zero = self.zero;
        let before = state.samples[(number + RECENT - 1) % RECENT];
        let mut own = state.samples[number % RECENT];
        let behind = state.samples[(number + 1) % RECENT];
        let mut length = rays.length;
        let is_part = !state.met.is_empty();
        if is_part || low.less(simd, rays.ends[0]).any(simd) || rays.ends[1].less(simd, high).any(simd) {
            // The part that counts, by the parabola at its middle.
            let first = rays.ends[0].max(simd, low).min(simd, high);
            let last = rays.ends[1].min(simd, high).max(simd, low);
            let half = Lanes::all(simd, 0.5);
            length = length.mul(simd, last.sub(simd, first).max(simd, zero));
            let place = first.add(simd, last).mul(simd, half).sub(simd, Lanes::all(simd, z));
            for channel in 0..CHANNELS {
                let (b, m, a) = (before[channel], own[channel], behind[channel]);
                let slope = a.sub(simd, b).mul(simd, half);
                let bend = m.fma(simd, Lanes::all(simd, -2.0), a.add(simd, b)).mul(simd, half);
                own[channel] = place.fma(simd, bend, slope).fma(simd, place, m);
            }
        }
        let depth = own[3].mul(simd, length).max(simd, zero);
        if depth.largest(simd) <= 0.0 {
            return false;
        }
        state.depth = state.depth.add(simd, depth);
        if self.colors.is_xray {
            return true;
        }
        let all = |value: f32| Lanes::all(simd, value);
        let one = all(1.0);
        let left = state.transmittance;
        let passed = left.mul(simd, depth.exp_neg(simd));
        let series = one.sub(simd, depth.mul(simd, all(0.25)));
        let series = one.sub(simd, depth.mul(simd, all(1.0 / 3.0)).mul(simd, series));
        let series = one.sub(simd, depth.mul(simd, all(0.5)).mul(simd, series));
        let is_thin = depth.less(simd, all(0.06));
        let mean = left.sub(simd, passed).div(simd, depth.max(simd, all(1e-30)));
        let mean = left.mul(simd, series).or(simd, is_thin, mean);
        let (absorbed, mean) = (mean.mul(simd, depth), mean.mul(simd, length));
        let denominator = depth.fma(simd, depth.fma(simd, all(2.0), all(6.0)), all(12.0));
        let bend = left.mul(simd, all(0.5)).div(simd, denominator).mul(simd, length);
        let change = behind[3].sub(simd, before[3]).mul(simd, rays.length);
        // Splines of sharp edges swing below 0 and over 1: colours of matter are within both.
        state.color = three!(channel => {
            let differs = behind[channel].sub(simd, before[channel]).mul(simd, depth);
            let bent = own[channel].mul(simd, change).sub(simd, differs);
            let color = own[channel].fma(simd, mean, bend.mul(simd, bent));
            state.color[channel].add(simd, color.max(simd, zero).min(simd, absorbed))
        });
        state.transmittance = passed;
        true
    }
}

impl<S: Simd> Rule<S> for Blending<'_, S> {
    type State = ColorState<S>;

    const BEHIND: usize = 1;
    const STEP: f64 = 1.0;
    const AROUND: [isize; 2] = [0, 0];

    #[inline(always)]
    fn start(&self, simd: S, group: usize) -> ColorState<S> {
        let zero = self.zero;
        ColorState {
            color: [zero; 3],
            depth: zero,
            transmittance: Lanes::all(simd, 1.0),
            samples: [[zero; CHANNELS]; RECENT],
            last: [isize::MIN / 2; 2],
            met: self.met.get(group).cloned().unwrap_or_default(),
            half: Lanes::all(simd, f32::INFINITY),
        }
    }

    #[inline(always)]
    fn make(&self, _: S, plane: &mut Plane, (area, read): (&PlaneArea, &ReadPoints), number: usize) {
        let before = self.colors.reach().beyond as isize;
        make(plane, (&self.colors.blend, &self.along), (&self.axes, area, read), number as isize - before);
    }

    #[inline(always)]
    fn sampled(&self, state: &mut ColorState<S>, number: usize, channels: [Lanes<S>; CHANNELS]) {
        if state.last[0] < number as isize - 1 {
            state.samples[(number + RECENT - 1) % RECENT] = [self.zero; CHANNELS];
        }
        state.samples[number % RECENT] = channels;
        state.last = [number as isize, state.last[0]];
    }

    #[inline(always)]
    fn passed(&self, _: S, state: &mut ColorState<S>, number: usize) {
        if state.last[0] >= number as isize - 1 {
            state.samples[number % RECENT] = [self.zero; CHANNELS];
        }
    }

    #[inline(always)]
    fn slab(&self, simd: S, state: &mut ColorState<S>, rays: &Rays<S>, (number, z): (usize, f32), _: bool) -> bool {
        if !state.last.contains(&(number as isize)) {
            return false;
        }
        if !state.met.is_empty() {
            return self.between_surfaces(simd, state, rays, (number, z));
        }
        self.part(simd, state, rays, (number, z), [Lanes::all(simd, z - 0.5), Lanes::all(simd, z + 0.5)])
    }

    #[inline(always)]
    fn left(&self, _: S, state: &ColorState<S>) -> Lanes<S> {
        state.transmittance
    }

    #[inline(always)]
    fn half(&self, state: &ColorState<S>) -> Option<Lanes<S>> {
        Some(state.half)
    }

    /// Returns the colours and the alpha; for an X-ray the optical depth four times.
    #[inline(always)]
    fn pixel(&self, simd: S, state: &ColorState<S>, _: &Rays<S>) -> [Lanes<S>; 4] {
        if self.colors.is_xray {
            return [state.depth; 4];
        }
        let [r, g, b] = state.color;
        [r, g, b, Lanes::all(simd, 1.0).sub(simd, state.depth.exp_neg(simd))]
    }
}
