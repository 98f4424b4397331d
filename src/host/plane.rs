//! Planes of coefficients, summed along the principal axis for the rays of a tile, which each read 4 x 4 points of
//! them.

use std::ops::Range;

use pulp::Simd;

use super::blend::{Along, Blend, blend_row};
use super::field::Field;
use super::lanes::{Channels, Lanes, Order, WIDTH, added_up, load, weighted};
use super::lattice::{CELL, PlaneArea, ReadPoints, TileRows};
use super::rays::Axes;
use crate::kernel;

/// The number of channels of a point of a plane.
pub(super) const CHANNELS: usize = 4;

/// The weight of the points to either side by which gradients are smoothed.
const BESIDE: f32 = kernel::BESIDE as f32;

/// A plane of channels side by side, and the memory in which it is made.
#[derive(Default)]
pub(super) struct Plane {
    scalars: Vec<f32>,
    /// The scalars smoothed along the axis, and in `along` the central differences along it.
    smooth: Vec<f32>,
    along: Vec<f32>,
    /// The memory for the rows of a level, or for lines across rows.
    pub(super) rows: Vec<f32>,
    pub(super) channels: Vec<f32>,
    /// The number of points from row to row.
    stride: usize,
    /// The number of points of each row before those of the area.
    skipped: usize,
    /// Whether each segment of each row has numbers that are not 0; empty if all segments may have.
    pub(super) filled: Vec<bool>,
}

/// Returns at a plane the scalar, the scalar smoothed along the axis by 1, 4, 1 over 6, and the central difference, by
/// coefficients at five planes.
#[inline(always)]
fn whole([z, b, m, a, y]: [f32; 5]) -> [f32; 3] {
    let (beside, far) = (b + a, z + y);
    let scalar = beside.mul_add(1.0 / 6.0, m * (4.0 / 6.0));
    let smooth = far.mul_add(1.0 / 36.0, beside.mul_add(8.0 / 36.0, m * (18.0 / 36.0)));
    [scalar, smooth, (y - z).mul_add(1.0 / 12.0, (a - b) * (4.0 / 12.0))]
}

/// Returns the same half way between two planes, by coefficients at six planes.
#[inline(always)]
fn half([x, z, b, a, y, w]: [f32; 6]) -> [f32; 3] {
    let (beside, far) = (b + a, z + y);
    let scalar = far.mul_add(1.0 / 48.0, beside * (23.0 / 48.0));
    let smooth = (x + w).mul_add(1.0 / 288.0, far.mul_add(27.0 / 288.0, beside * (116.0 / 288.0)));
    let difference = (y - z).mul_add(23.0, w - x);
    [scalar, smooth, difference.mul_add(1.0 / 96.0, (a - b) * (22.0 / 96.0))]
}

/// Sums segments of a row of coefficients at a plane, by [`whole`] or [`half`]; without `differs` the scalars alone.
#[inline(always)]
fn sum<const PLANES: usize>(
    rows: &TileRows<PLANES>,
    (coefficients, row, segments): (&[f32], usize, Range<usize>),
    [scalars, smooth, along]: [&mut [f32]; 3],
    differs: bool,
    at_point: impl Fn([f32; PLANES]) -> [f32; 3],
) {
    let [scalars, smooth, along] = [scalars, smooth, along].map(|row| row.as_chunks_mut::<CELL>().0);
    let end = segments.end;
    let (scalars, smooth, along) = (&mut scalars[..end], &mut smooth[..end], &mut along[..end]);
    for segment in segments {
        let to = [&mut scalars[segment], &mut smooth[segment], &mut along[segment]];
        if rows.are_lines() {
            sum_segment(rows.lines(coefficients, row, segment), to, differs, &at_point);
        } else {
            let columns = rows.columns(coefficients, row, segment);
            sum_segment(columns.each_ref(), to, differs, &at_point);
        }
    }
}

#[inline(always)]
fn sum_segment<const PLANES: usize>(
    planes: [&[f32; CELL]; PLANES],
    [scalars, smooth, along]: [&mut [f32; CELL]; 3],
    differs: bool,
    at_point: &impl Fn([f32; PLANES]) -> [f32; 3],
) {
    for x in 0..CELL {
        let mut point = [0.0; PLANES];
        for plane in 0..PLANES {
            point[plane] = planes[plane][x];
        }
        let [scalar, smoothed, difference] = at_point(point);
        scalars[x] = scalar;
        if differs {
            smooth[x] = smoothed;
            along[x] = difference;
        }
    }
}

/// Smooths the middle one of three rows, with the rows beside it.
#[inline(always)]
fn smooth_across([before, middle, behind]: [&[f32]; 3], to: &mut [f32]) {
    let count = to.len();
    let (before, middle, behind) = (&before[..count], &middle[..count], &behind[..count]);
    for x in 0..count {
        to[x] = (before[x] + behind[x]).mul_add(BESIDE, middle[x] * (1.0 - 2.0 * BESIDE));
    }
}

/// Writes the central differences across three rows.
#[inline(always)]
fn slope_across([before, _, behind]: [&[f32]; 3], to: &mut [f32]) {
    let count = to.len();
    let (before, behind) = (&before[..count], &behind[..count]);
    for x in 0..count {
        to[x] = 0.5 * (behind[x] - before[x]);
    }
}

/// Returns the numbers of a row from `x` on, smoothed along the row.
#[inline(always)]
fn smooth_along<S: Simd>(simd: S, row: &[f32], x: usize) -> S::f32s {
    let sides = simd.add_f32s(load(simd, &row[x - 1..]), load(simd, &row[x + 1..]));
    let own = simd.mul_f32s(simd.splat_f32s(1.0 - 2.0 * BESIDE), load(simd, &row[x..]));
    simd.mul_add_f32s(simd.splat_f32s(BESIDE), sides, own)
}

impl Plane {
    /// Makes room for rows. Rays count their points after the first `skipped` ones. Returns the number of points from
    /// row to row.
    pub(super) fn resize(&mut self, [width, height]: [usize; 2], skipped: usize) -> usize {
        self.skipped = skipped;
        // Vectors reach beyond the end of a row.
        self.stride = width.next_multiple_of(WIDTH) + WIDTH;
        let numbers = CHANNELS * self.stride * (height + 1);
        if self.channels.len() < numbers {
            self.channels.resize(numbers, 0.0);
        }
        // Tests see points that are read but not made.
        if cfg!(debug_assertions) {
            self.channels.fill(f32::NAN);
        }
        self.filled.clear();
        self.stride
    }

    /// Makes room to note whether each segment of `rows` rows is filled. Segments that are not made count as empty; in
    /// debug builds as filled, so that tests see one that is read.
    pub(super) fn note_filled(&mut self, rows: usize) {
        self.filled.resize(self.stride / CELL * rows, cfg!(debug_assertions));
    }

    /// Returns whether all channels are 0 at the points that rays read, given the first of them along a and b and by
    /// how much the last ray's points lie behind the first's.
    #[inline(always)]
    fn is_clear(&self, [a, b]: [usize; 2], spans: [usize; 2]) -> bool {
        if self.filled.is_empty() {
            return false;
        }
        let (first, last) = ((self.skipped + a) / CELL, (self.skipped + a + spans[0] + 3) / CELL);
        let mut rows = self.filled.chunks_exact(self.stride / CELL).skip(b).take(spans[1] + 4);
        rows.all(|row| !row[first..=last].contains(&true))
    }

    /// Makes the points of half plane `number` of scalars that rays read: the scalar, and if requested its central
    /// differences along a, b and the axis. Even half planes lie at planes.
    #[inline(always)]
    pub(super) fn make_scalars<S: Simd>(
        &mut self,
        simd: S,
        order: &Order,
        (blend, along): (&Blend<'_, Field>, &Along),
        (axes, area, read): (&Axes, &PlaneArea, &ReadPoints),
        number: isize,
        differs: bool,
    ) {
        let (half_way, at_plane) = (number % 2 != 0, number.div_euclid(2));
        let lattice = blend.levels[0].1.lattice;
        let rows_of_half: TileRows<6> = lattice.rows(axes, area, at_plane - 2);
        let rows_of_whole: TileRows<5> = lattice.rows(axes, area, at_plane - 2);
        let [own_width, height] = area.size();
        let (width, skipped) = (CELL * rows_of_half.segments(&(0..own_width)).end, rows_of_half.skipped);
        let stride = self.resize([width, height], skipped);
        let room = stride * (height + 1);
        if self.scalars.len() < room {
            self.scalars.resize(room, 0.0);
            self.smooth.resize(room, 0.0);
            self.along.resize(room, 0.0);
        }
        if self.rows.len() < 4 * stride {
            self.rows.resize(4 * stride, 0.0);
        }
        let z = number as f64 / 2.0;
        let [first, last] = blend.needed(along, [area.low, area.high], z);
        let (weights, parts) = self.rows[..4 * stride].split_at_mut(stride);
        let (part_scalars, parts) = parts.split_at_mut(stride);
        let (part_smooth, part_along) = parts.split_at_mut(stride);
        for row in 0..height {
            let points = read.of(area, row);
            if points.is_empty() {
                continue;
            }
            let segments = rows_of_half.segments(&points);
            let points = CELL * segments.start..CELL * segments.end;
            let scalars = &mut self.scalars[row * stride..][..width];
            let smooth = &mut self.smooth[row * stride..][..width];
            let slopes = &mut self.along[row * stride..][..width];
            for level in first..=last {
                let to = if first == last {
                    [&mut *scalars, &mut *smooth, &mut *slopes]
                } else {
                    [&mut part_scalars[..width], &mut part_smooth[..width], &mut part_along[..width]]
                };
                let from = (blend.levels[level].1.coefficients(), row, segments.clone());
                if half_way {
                    sum(&rows_of_half, from, to, differs, half);
                } else {
                    sum(&rows_of_whole, from, to, differs, whole);
                }
                if first < last {
                    let low = [area.low[0] - skipped as isize, area.low[1] + row as isize].map(|point| point as f64);
                    blend.weights(along, level, [low[0], low[1], z], points.clone(), weights);
                    let weights = &weights[points.clone()];
                    blend_row(weights, &part_scalars[points.clone()], &mut scalars[points.clone()], level == first);
                    if differs {
                        blend_row(weights, &part_smooth[points.clone()], &mut smooth[points.clone()], level == first);
                        blend_row(weights, &part_along[points.clone()], &mut slopes[points.clone()], level == first);
                    }
                }
            }
        }
        let halve = simd.splat_f32s(0.5);
        for row in 1..height - 1 {
            let points = read.of(area, row);
            // Their outermost points are there for the differences.
            let points = points.start + 1..points.end.saturating_sub(1);
            if points.is_empty() {
                continue;
            }
            let start = row * stride + skipped;
            if differs {
                let (from, to) = (points.start - 1, points.end + 1);
                let [before, own, behind] = [start - stride + from, start + from, start + stride + from];
                let lines = [&self.smooth[before..], &self.smooth[own..], &self.smooth[behind..]];
                smooth_across(lines, &mut weights[from..to]);
                slope_across(lines, &mut part_scalars[from..to]);
                let lines = [&self.along[before..], &self.along[own..], &self.along[behind..]];
                smooth_across(lines, &mut part_smooth[from..to]);
            }
            for x in points.step_by(WIDTH) {
                let at = start + x;
                let scalar = load(simd, &self.scalars[at..]);
                let channels = if differs {
                    let a = simd.sub_f32s(load(simd, &weights[x + 1..]), load(simd, &weights[x - 1..]));
                    let (b, along) = (smooth_along(simd, part_scalars, x), smooth_along(simd, part_smooth, x));
                    [scalar, simd.mul_f32s(a, halve), b, along]
                } else {
                    [scalar; CHANNELS]
                };
                order.write(simd, channels, &mut self.channels[CHANNELS * at..]);
            }
        }
    }

    /// Returns the channels at the places of a group of rays, in points of the plane.
    #[inline(always)]
    pub(super) fn at<S: Simd>(&self, simd: S, order: &Order, [a, b]: [Lanes<S>; 2]) -> [Lanes<S>; CHANNELS] {
        let stride = CHANNELS * self.stride;
        let (first_a, first_b) = (a.floor(simd), b.floor(simd));
        let low = [first_a.smallest(simd), first_b.smallest(simd)];
        let first = [low[0] as usize, low[1] as usize];
        let spans = [first_a.largest(simd) as usize - first[0], first_b.largest(simd) as usize - first[1]];
        if self.is_clear(first, spans) {
            return [Lanes::all(simd, 0.0); CHANNELS];
        }
        let along = spline(simd, a.sub(simd, first_a));
        let across = spline(simd, b.sub(simd, first_b));
        if spans[0].max(spans[1]) < 2 {
            let rows = shifted(simd, across, first_b.sub(simd, Lanes::all(simd, low[1])));
            let rows = &rows[..spans[1] + 4];
            if spans[0] == 0 {
                return self.shared(simd, first, &along, rows);
            }
            let columns = shifted(simd, along, first_a.sub(simd, Lanes::all(simd, low[0])));
            return self.shared(simd, first, &columns, rows);
        }
        let [along0, along1, along2, along3] = along;
        let [across0, across1, across2, across3] = across;
        let along = [along0.to_array(), along1.to_array(), along2.to_array(), along3.to_array()];
        let across = [across0.to_array(), across1.to_array(), across2.to_array(), across3.to_array()];
        let offset = first_b.fma(simd, Lanes::all(simd, stride as f32), first_a.mul(simd, Lanes::all(simd, 4.0)));
        let offset = offset.indices(simd);
        let mut channels = Channels::new(simd);
        for vector in 0..channels.0.len() {
            let [one, other] = order.pair(vector);
            let mut parts = [simd.splat_f32s(0.0); 2];
            for (part, ray) in [one, other].into_iter().enumerate() {
                let at = offset[ray] as usize + CHANNELS * self.skipped;
                let row = |number: usize| at + number * stride;
                parts[part] = weighted(
                    simd,
                    [
                        &self.channels[at..at + 16],
                        &self.channels[row(1)..row(1) + 16],
                        &self.channels[row(2)..row(2) + 16],
                        &self.channels[row(3)..row(3) + 16],
                    ],
                    [across[0][ray], across[1][ray], across[2][ray], across[3][ray]],
                    [along[0][ray], along[1][ray], along[2][ray], along[3][ray]],
                );
            }
            channels.0[vector] = added_up(simd, parts[0], parts[1]);
        }
        channels.apart(simd)
    }

    /// Returns the channels by the weights of all rays for the same few points, from point `first` on.
    #[inline(always)]
    fn shared<S: Simd, const COLUMNS: usize>(
        &self,
        simd: S,
        first: [usize; 2],
        along: &[Lanes<S>; COLUMNS],
        across: &[Lanes<S>],
    ) -> [Lanes<S>; CHANNELS] {
        let mut channels = [Lanes::all(simd, 0.0); CHANNELS];
        for (row, weight) in across.iter().enumerate() {
            let at = CHANNELS * ((first[1] + row) * self.stride + first[0] + self.skipped);
            let points = &self.channels[at..at + CHANNELS * COLUMNS];
            let mut sums = [Lanes::all(simd, 0.0); CHANNELS];
            for column in 0..COLUMNS {
                for channel in 0..CHANNELS {
                    let point = Lanes::all(simd, points[CHANNELS * column + channel]);
                    sums[channel] = along[column].fma(simd, point, sums[channel]);
                }
            }
            for channel in 0..CHANNELS {
                channels[channel] = sums[channel].fma(simd, *weight, channels[channel]);
            }
        }
        channels
    }
}

/// Returns the weights of five points by those of four, of which the first is point `shift`, 0 or 1.
#[inline(always)]
fn shifted<S: Simd>(simd: S, [s, t, u, v]: [Lanes<S>; 4], shift: Lanes<S>) -> [Lanes<S>; 5] {
    let zero = Lanes::all(simd, 0.0);
    let is_first = shift.less(simd, Lanes::all(simd, 0.5));
    [
        s.or(simd, is_first, zero),
        t.or(simd, is_first, s),
        u.or(simd, is_first, t),
        v.or(simd, is_first, u),
        zero.or(simd, is_first, v),
    ]
}

/// Returns the weights of cubic B-splines at a fraction of the way from the second to the third of four points.
#[inline(always)]
fn spline<S: Simd>(simd: S, t: Lanes<S>) -> [Lanes<S>; 4] {
    let (one, half) = (Lanes::all(simd, 1.0), Lanes::all(simd, 0.5));
    let (sixth, two_thirds) = (Lanes::all(simd, 1.0 / 6.0), Lanes::all(simd, 2.0 / 3.0));
    let minus_one = Lanes::all(simd, -1.0);
    let u = one.sub(simd, t);
    let (t2, u2) = (t.mul(simd, t), u.mul(simd, u));
    [
        u2.mul(simd, u).mul(simd, sixth),
        t2.fma(simd, t.fma(simd, half, minus_one), two_thirds),
        u2.fma(simd, u.fma(simd, half, minus_one), two_thirds),
        t2.mul(simd, t).mul(simd, sixth),
    ]
}
