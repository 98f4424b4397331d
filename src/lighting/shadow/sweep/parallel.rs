//! Sweeps along directions.

use std::ops::Range;
use std::sync::atomic::{AtomicU16, Ordering};

use glam::DVec3;

use super::buffer::nearest_place;
use super::{BAND, FAINT, MARGIN, Map, RaySet, Sweep, SweepLight, Swept};
use crate::lighting::shadow::field::{LANES, RowPlanes};
use crate::lighting::shadow::incoming::{Entering, PointRanges};
use crate::lighting::shadow::lanes::RowLanes;
use crate::lighting::shadow::response::{StencilRow, SweepResponse};

/// The largest number of bytes of the buffers of a band, so that they stay in a cache.
const BUFFERS: usize = 1280 << 10;

/// A direction of parallel light.
#[derive(Clone, Copy)]
pub(in crate::lighting::shadow) struct Direction {
    /// The direction towards the light, in planes, rows and columns; unit length.
    pub(in crate::lighting::shadow) along: DVec3,
    /// The length of a voxel along the direction, per unit of extinction.
    pub(in crate::lighting::shadow) scale: f64,
    /// The light that an unshadowed voxel gets, of 65535.
    pub(in crate::lighting::shadow) share: u16,
    /// The number of the direction among those of its light.
    pub(in crate::lighting::shadow) number: usize,
}

/// The light of parallel rays of several directions.
struct ParallelLight<'a> {
    swept: &'a Swept<'a>,
    near: &'a Near,
    /// The factor of sums of planes, the factor of all, and the light that an unshadowed voxel gets, for each
    /// direction.
    factors: Vec<[f32; 3]>,
}

/// The stencil of the nearest neighbours of voxels towards the light.
pub(in crate::lighting::shadow) struct Near {
    /// Whether the light lies at the end of the last plane.
    pub(in crate::lighting::shadow) ahead: bool,
    /// The number of nearest planes that are not taken from sweeps.
    pub(in crate::lighting::shadow) planes: usize,
    pub(in crate::lighting::shadow) stencil: Vec<StencilRow>,
}

/// Returns the length of a unit direction between two planes, and the rows and the columns that it passes.
fn slopes(along: DVec3) -> (f64, [f64; 2]) {
    let length = 1.0 / along.x.abs();
    (length, [along.y * length, along.z * length])
}

impl SweepResponse {
    /// Returns the stencil of neighbours towards a direction (planes, rows, columns; unit length).
    pub(in crate::lighting::shadow) fn near(&self, along: DVec3, bias: f64) -> Near {
        let (length, slopes) = slopes(along);
        let planes = Self::planes(bias, length);
        let stencil = self.stencil(slopes, [bias, f64::INFINITY], Some(planes));
        Near { ahead: along.x > 0.0, planes, stencil }
    }
}

impl Direction {
    /// Returns the number of the plane that is nearest to the light, counted away from the light; `first` is the number
    /// of the first of `planes` planes in the lattice.
    fn nearest(&self, first: i64, planes: usize) -> i64 {
        if self.is_ahead() { 1 - first - planes as i64 } else { first }
    }

    /// Returns the rays through a box, given the numbers of its first plane, row and column in the lattice.
    pub(in crate::lighting::shadow) fn rays(&self, of: RowPlanes, first: [i64; 3]) -> RaySet<'static> {
        let (_, slopes) = slopes(self.along);
        let (count, nearest) = (of.planes, self.nearest(first[0], of.planes));
        let (rows, _, row) = sheared(slopes[0], nearest, of.rows, count);
        let (columns, width, column) = sheared(slopes[1], nearest, of.columns, count);
        let maps = rows.into_iter().zip(columns).map(|(row, column)| [row, column]).collect();
        let origin = Some([first[1] + row, first[2] + column]);
        let (weights, drifts) = (vec![1.0; count], vec![0.0; count]);
        RaySet { origin, width, maps, weights, drifts, incoming: None, window: None }
    }

    /// Returns whether the light lies at the end of the last plane.
    pub(in crate::lighting::shadow) fn is_ahead(&self) -> bool {
        self.along.x > 0.0
    }

    /// Returns the rows and the columns of the rays that pass a box of planes, and of rows and columns.
    pub(in crate::lighting::shadow) fn places_in(&self, planes: &Range<i64>, of: [Range<i64>; 2]) -> [Range<i64>; 2] {
        let ends = [planes.start, planes.end - 1].map(|plane| if self.is_ahead() { -plane } else { plane });
        let (_, slopes) = slopes(self.along);
        [0, 1].map(|k| {
            let [one, other] = ends.map(|plane| moved(slopes[k], plane));
            let low = of[k].start as f64 + one.min(other);
            low.floor() as i64 - 1..(of[k].end as f64 + one.max(other)).ceil() as i64 + 1
        })
    }

    /// Returns the columns of a row of rays that enter a window of planes, rows and columns at a plane.
    pub(in crate::lighting::shadow) fn entering(&self, window: &PointRanges, plane: i64, row: i64) -> [Range<i64>; 2] {
        let (_, slopes) = slopes(self.along);
        let within = |plane: i64| {
            let away = if self.is_ahead() { -plane } else { plane };
            let nearest = nearest_place(row as f64 - moved(slopes[0], away)) as i64;
            let shift = nearest_place(-moved(slopes[1], away)) as i64;
            let is_within = window[0].contains(&plane) && window[1].contains(&nearest);
            is_within.then(|| window[2].start - shift..window[2].end - shift)
        };
        let Some(now) = within(plane) else { return [0..0, 0..0] };
        match within(if self.is_ahead() { plane + 1 } else { plane - 1 }) {
            None => [now, 0..0],
            Some(before) => [now.start..now.end.min(before.start), now.start.max(before.end)..now.end],
        }
    }

    /// Returns the factor of sums of planes, the factor of all, and the light that an unshadowed voxel gets.
    pub(in crate::lighting::shadow) fn factors(&self, response: &SweepResponse) -> [f32; 3] {
        let (length, _) = slopes(self.along);
        [(length * response.integral) as f32, self.scale as f32, f32::from(self.share)]
    }
}

/// Returns the places of the first row and column of each plane of a box among the rays of a direction, the plane
/// nearest to the light first. `first` is the number of the box's first plane in the lattice.
pub(in crate::lighting::shadow) fn parallel_planes(
    direction: &Direction,
    [planes, rows, columns]: [usize; 3],
    first: i64,
) -> Vec<[f64; 2]> {
    let (_, [down, right]) = slopes(direction.along);
    let first = direction.nearest(first, planes);
    let [rows, columns] = [(down, rows), (right, columns)].map(|(slope, count)| sheared(slope, first, count, planes).0);
    rows.iter().zip(&columns).map(|(row, column)| [row.into[1], column.into[1]]).collect()
}

impl Swept<'_> {
    /// Adds the light from some directions to each voxel, given the neighbours towards about these directions, and the
    /// light that enters a part of a lattice.
    pub(in crate::lighting::shadow) fn add_parallel(
        &self,
        near: &Near,
        directions: &[Direction],
        entering: Option<&Entering<'_>>,
        out: &[AtomicU16],
    ) {
        let count = self.planes.planes;
        let mut directions = directions.to_vec();
        // Neighbours drift apart the least.
        directions.sort_by(|a, b| slopes(a.along).1[0].total_cmp(&slopes(b.along).1[0]));
        let columns = self.planes.columns + 2 * MARGIN as usize + count;
        let together = (BUFFERS / (4 * 2 * BAND * columns)).max(1);
        for directions in directions.chunks(directions.len().div_ceil(directions.len().div_ceil(together))) {
            let middle = directions.iter().map(|direction| slopes(direction.along).1[0]).sum::<f64>();
            let nearest = directions[0].nearest(self.first[0], count);
            let (places, rows, _) = sheared(middle / directions.len() as f64, nearest, self.planes.rows, count);
            let rays = directions.iter().map(|direction| {
                let rays = direction.rays(self.planes, self.first);
                let drifts = rays.maps.iter().zip(&places).map(|([row, _], place)| row.into[1] - place.into[1]);
                let incoming = entering.and_then(|entering| entering.depths(direction.number));
                let window = entering.map(|entering| entering.window(self.first));
                RaySet { drifts: drifts.collect(), incoming, window, ..rays }
            });
            let factors = directions.iter().map(|direction| direction.factors(self.response));
            let light = ParallelLight { swept: self, near, factors: factors.collect() };
            let rays = rays.collect();
            let sweep =
                Sweep { swept: self, ahead: near.ahead, near: near.planes, rays, places: (places, rows), light };
            sweep.run(out);
        }
    }
}

/// Returns the place, among rays that move by a slope from plane to plane, of row 0 or column 0 of a plane, given its
/// number away from the light: in whole 65536ths, so that whole parts stay whole. Parts of a lattice share its rays.
fn moved(slope: f64, plane: i64) -> f64 {
    (slope * plane as f64 * 65_536.0).round() / 65_536.0
}

/// Returns the maps of rows, or columns, that a direction shifts by a slope from plane to plane, for each plane, the
/// number of places, and the place of the first among all rays. `nearest` is the number of the nearest plane.
fn sheared(slope: f64, nearest: i64, count: usize, planes: usize) -> (Vec<Map>, usize, i64) {
    let place = |number: usize| moved(slope, nearest + number as i64);
    let first = (place(0).min(place(planes - 1)) - MARGIN).floor();
    let maps = (0..planes).map(|number| {
        let at = place(number) - first;
        Map { into: [1.0, at], back: [1.0, -at] }
    });
    let width = count + (slope.abs() * (planes - 1) as f64).ceil() as usize + 2 * MARGIN as usize + 1;
    (maps.collect(), width, first as i64)
}

impl SweepLight for ParallelLight<'_> {
    fn within(&self, columns: Range<usize>, _: [usize; 2]) -> Range<usize> {
        columns
    }

    #[inline(always)]
    fn arrive<S: pulp::Simd>(
        &self,
        simd: S,
        at: [usize; 2],
        columns: Range<usize>,
        sums: &[Vec<f32>],
        out: &[AtomicU16],
    ) {
        let source = self.swept.planes.row(at[0], at[1]);
        let mut light = [0.0; LANES];
        for start in columns.clone().step_by(RowLanes::<S>::COUNT) {
            let own = self.swept.field.from(source, start as isize);
            // Where hardly any light is left, the neighbours do not matter.
            let is_lit = self.factors.iter().zip(sums).any(|([planes, all, _], sums)| {
                let faint = FAINT / (planes * all);
                let lit = own.iter().zip(&sums[start..start + RowLanes::<S>::COUNT]);
                lit.map(|(own, &sum)| u32::from((*own > 0.0) & (sum < faint))).sum::<u32>() > 0
            });
            let mut near = RowLanes::new(simd, 0.0);
            if is_lit {
                near = self.near.add(simd, self.swept, at, start, near);
            }
            // The light of each direction is rounded, so it is the same however many directions go together.
            let mut sum = RowLanes::new(simd, 0.0);
            for (&[planes, all, share], sums) in self.factors.iter().zip(sums) {
                let far = RowLanes::load(&sums[start..]);
                let near = near.below(simd, far, FAINT / (planes * all));
                let depth = near.plus(simd, planes, far).times(simd, all);
                sum = sum.plus_whole(simd, share, depth.transmitted(simd));
            }
            sum.store(&mut light);
            for (out, light) in out[start..columns.end].iter().zip(&light[..RowLanes::<S>::COUNT]) {
                out.store(out.load(Ordering::Relaxed) + light.to_bits() as u16, Ordering::Relaxed);
            }
        }
    }
}

impl Near {
    /// Adds the neighbours of the voxels of a row from a column on.
    #[inline(always)]
    fn add<S: pulp::Simd>(
        &self,
        simd: S,
        swept: &Swept<'_>,
        at: [usize; 2],
        start: usize,
        mut sums: RowLanes<S>,
    ) -> RowLanes<S> {
        let (field, of) = (swept.field, swept.planes);
        for StencilRow { offset: [ahead, down], column, weights } in &self.stencil {
            let planes = if self.ahead { *ahead } else { -*ahead };
            let Some(source) = of.beside(at, [planes, *down]) else { continue };
            let filled = field.filled(source);
            let first = start as isize + *column as isize;
            if filled.is_empty()
                || filled.end as isize <= first
                || filled.start as isize >= first + (RowLanes::<S>::COUNT + weights.len()) as isize
            {
                continue;
            }
            let values = field.from(source, first);
            for (i, &weight) in weights.iter().enumerate() {
                sums = sums.plus(simd, weight, RowLanes::load(&values[i..]));
            }
        }
        sums
    }
}
