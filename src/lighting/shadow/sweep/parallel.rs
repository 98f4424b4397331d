//! Sweeps along directions.

use std::ops::Range;
use std::sync::atomic::{AtomicU16, Ordering};

use glam::DVec3;

use super::{BAND, FAINT, MARGIN, Map, RaySet, Sweep, SweepLight, Swept, nearest};
use crate::lighting::shadow::field::LANES;
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
    /// Returns the factor of sums of planes, the factor of all, and the light that an unshadowed voxel gets.
    pub(in crate::lighting::shadow) fn factors(&self, response: &SweepResponse) -> [f32; 3] {
        let (length, _) = slopes(self.along);
        [(length * response.integral) as f32, self.scale as f32, f32::from(self.share)]
    }
}

/// Returns the places of the first row and column of each plane among the rays of a direction, the plane nearest to the
/// light first.
pub(in crate::lighting::shadow) fn parallel_planes(
    direction: &Direction,
    [planes, rows, columns]: [usize; 3],
) -> Vec<[f64; 2]> {
    let (_, [down, right]) = slopes(direction.along);
    let [rows, columns] = [(down, rows), (right, columns)].map(|(slope, count)| sheared(slope, count, planes).0);
    rows.iter().zip(&columns).map(|(row, column)| [row.into[1], column.into[1]]).collect()
}

impl Swept<'_> {
    /// Adds the light from some directions to each voxel, given the neighbours towards about these directions.
    pub(in crate::lighting::shadow) fn add_parallel(&self, near: &Near, directions: &[Direction], out: &[AtomicU16]) {
        let count = self.planes.planes;
        let mut directions = directions.to_vec();
        // Neighbours drift apart the least.
        directions.sort_by(|a, b| slopes(a.along).1[0].total_cmp(&slopes(b.along).1[0]));
        let columns = self.planes.columns + 2 * MARGIN as usize + count;
        let together = (BUFFERS / (4 * 2 * BAND * columns)).max(1);
        for directions in directions.chunks(directions.len().div_ceil(directions.len().div_ceil(together))) {
            let slopes: Vec<_> = directions.iter().map(|direction| slopes(direction.along)).collect();
            let middle = slopes.iter().map(|(_, slopes)| slopes[0]).sum::<f64>() / slopes.len() as f64;
            let (places, rows) = sheared(middle, self.planes.rows, count);
            let rays = slopes.iter().map(|(_, slopes)| {
                let (columns, width) = sheared(slopes[1], self.planes.columns, count);
                let (rows, _) = sheared(slopes[0], self.planes.rows, count);
                let drifts = rows.iter().zip(&places).map(|(row, place)| row.into[1] - place.into[1]).collect();
                let maps = rows.into_iter().zip(columns).map(|(row, column)| [row, column]).collect();
                RaySet { is_sheared: true, width, maps, weights: vec![1.0; count], drifts }
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

/// Returns the maps of rows, or columns, that a direction shifts by a slope from plane to plane, for each plane, and
/// the number of places.
fn sheared(slope: f64, count: usize, planes: usize) -> (Vec<Map>, usize) {
    let shift = MARGIN + (-slope * (planes - 1) as f64).max(0.0);
    let maps = (0..planes).map(|i| {
        // Whole parts stay whole: sums with whole numbers are exact.
        let at = ((shift + slope * i as f64) * 65_536.0).round() / 65_536.0;
        Map { into: [1.0, at], back: [1.0, -at] }
    });
    (maps.collect(), count + (slope.abs() * (planes - 1) as f64).ceil() as usize + 2 * MARGIN as usize)
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
            let mut sum = RowLanes::new(simd, 0.0);
            for (&[planes, all, share], sums) in self.factors.iter().zip(sums) {
                let depth = near.plus(simd, planes, RowLanes::load(&sums[start..])).times(simd, all);
                sum = sum.plus(simd, share, depth.transmitted(simd));
            }
            sum.store(&mut light);
            for (out, light) in out[start..columns.end].iter().zip(&light[..RowLanes::<S>::COUNT]) {
                out.store(out.load(Ordering::Relaxed) + nearest(*light), Ordering::Relaxed);
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
