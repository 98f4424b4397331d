//! Sweeps towards a place.

use std::ops::Range;
use std::sync::atomic::{AtomicU16, Ordering};

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::{FAINT, MARGIN, Map, RaySet, Sweep, SweepLight, Swept, nearest};
use crate::lighting::shadow::response::{StencilRow, SweepResponse};

/// The light of rays to a place.
struct To<'a> {
    swept: &'a Swept<'a>,
    rays: &'a Converging<'a>,
    ahead: bool,
}

/// The rays of a light at a place that run mainly along an axis.
pub(in crate::lighting::shadow) struct Converging<'a> {
    /// The place of the light, in planes, rows and columns from the first voxel.
    pub(in crate::lighting::shadow) place: DVec3,
    /// The world vectors of a step to the next plane, row and column, in the unit of extinctions.
    pub(in crate::lighting::shadow) to_world: DMat3,
    /// Whether rays that run as much along rows, or columns, as along planes are left to another axis.
    pub(in crate::lighting::shadow) strict: [bool; 2],
    pub(in crate::lighting::shadow) near: &'a NearPlace,
}

/// The stencils of rays to a place, for slopes of rows 0 to 1 and of columns -1 to 1.
pub(in crate::lighting::shadow) struct NearPlace {
    /// The number of steps of slopes from 0 to 1.
    pub(in crate::lighting::shadow) steps: usize,
    pub(in crate::lighting::shadow) stencils: Vec<Vec<StencilRow>>,
    bias: f64,
    /// The number of planes from the place within which voxels are summed without a sweep.
    pub(in crate::lighting::shadow) direct: f64,
}

impl NearPlace {
    pub(in crate::lighting::shadow) fn new(response: &SweepResponse, bias: f64) -> Self {
        let near = SweepResponse::planes(bias, 1.0);
        // 32 for the default kernel; wider kernels change less.
        let steps = (64.0 / response.radius()).clamp(4.0, 32.0) as usize;
        let stencils = (0..(steps + 1) * (2 * steps + 1)).into_par_iter().map(|number| {
            let [row, column] = [number / (2 * steps + 1), number % (2 * steps + 1)].map(|n| n as f64 / steps as f64);
            response.stencil([row, column - 1.0], [bias, f64::INFINITY], Some(near))
        });
        Self { steps, stencils: stencils.collect(), bias, direct: response.reach(bias) as f64 }
    }

    /// Returns the stencil of the nearest slopes.
    fn stencil(&self, [row, column]: [f64; 2]) -> &[StencilRow] {
        let number = |slope: f64, from: f64| ((slope - from) * self.steps as f64).round() as usize;
        &self.stencils[number(row.abs(), 0.0) * (2 * self.steps + 1) + number(column, -1.0)]
    }
}

/// The rays to a place through the planes on one side of it.
pub(in crate::lighting::shadow) struct Pyramid {
    /// The number of planes, nearest to the end of the light, that the rays do not pass.
    pub(in crate::lighting::shadow) skipped: usize,
    /// The distances of the remaining planes from the place in planes, the nearest first.
    pub(in crate::lighting::shadow) distances: Vec<f64>,
    /// The numbers of rows and columns of rays.
    pub(in crate::lighting::shadow) size: [usize; 2],
    /// The row and the column of the place, and the least slopes.
    ranges: [(f64, f64); 2],
}

impl Pyramid {
    /// Returns the rays to a place (planes, rows, columns) through a box of planes, rows and columns; `None`: they pass
    /// no voxel.
    pub(in crate::lighting::shadow) fn new(
        place: DVec3,
        [count, rows, columns]: [usize; 3],
        ahead: bool,
    ) -> Option<Self> {
        // Planes less than half a plane behind the place count by their part before it.
        let first = if ahead { count as f64 - 1.0 - place.x } else { place.x };
        let skipped = (0.5 + first).floor().max(0.0) as usize;
        // Distances from the place in planes, the nearest first.
        let distances: Vec<f64> = (skipped..count).map(|i| i as f64 - first).collect();
        let farthest = distances.last().copied().filter(|farthest| *farthest > 0.0)?;
        let nearest = distances[0].max(1e-3);
        let ranges = [(place.y, rows), (place.z, columns)].map(|(at, count)| {
            let ends = [-at, (count - 1) as f64 - at];
            let least = (ends[0] / nearest).min(ends[0] / farthest).max(-1.0);
            (at, least, (ends[1] / nearest).max(ends[1] / farthest).min(1.0))
        });
        if ranges.iter().any(|(_, least, most)| least > most) {
            return None;
        }
        let size = ranges.map(|(_, least, most)| ((most - least) * farthest).ceil() as usize + 2 * MARGIN as usize + 1);
        Some(Self { skipped, distances, size, ranges: ranges.map(|(at, least, _)| (at, least)) })
    }

    /// Returns the maps of the rows and columns of a plane at a distance.
    pub(in crate::lighting::shadow) fn maps(&self, distance: f64) -> [Map; 2] {
        let farthest = self.distances[self.distances.len() - 1];
        self.ranges.map(|(at, least)| {
            let (along, factor) = (distance.max(0.0), farthest / distance.max(1e-3));
            Map {
                into: [factor, MARGIN - least * farthest - at * factor],
                back: [along / farthest, at + (least - MARGIN / farthest) * along],
            }
        })
    }

    /// Returns the weight of a plane at a distance.
    pub(in crate::lighting::shadow) fn weight(distance: f64) -> f32 {
        (distance + 0.5).clamp(0.0, 1.0) as f32
    }
}

impl Swept<'_> {
    /// Sets the light from a place at the voxels from which it lies mainly across planes, ahead of them or behind.
    pub(in crate::lighting::shadow) fn set_converging(&self, rays: &Converging<'_>, ahead: bool, out: &[AtomicU16]) {
        let of = self.planes;
        let Some(pyramid) = Pyramid::new(rays.place, [of.planes, of.rows, of.columns], ahead) else { return };
        let maps: Vec<_> = pyramid.distances.iter().map(|&distance| pyramid.maps(distance)).collect();
        let places = maps.iter().map(|[rows, _]| *rows).collect();
        let weights = pyramid.distances.iter().map(|&distance| Pyramid::weight(distance)).collect();
        let near = SweepResponse::planes(rays.near.bias, 1.0);
        let drifts = vec![0.0; maps.len()];
        let size = pyramid.size;
        let scaled = RaySet { origin: None, width: size[1], maps, weights, drifts, incoming: None, window: None };
        let light = To { swept: self, rays, ahead };
        let sweep = Sweep { swept: self, ahead, near, rays: vec![scaled], places: (places, size[0]), light };
        sweep.run(out);
    }
}

impl To<'_> {
    /// Returns the vector from a voxel to the place: planes, rows and columns.
    fn path(&self, [plane, row, column]: [usize; 3]) -> DVec3 {
        let path = self.rays.place - DVec3::new(plane as f64, row as f64, column as f64);
        if self.ahead { path } else { DVec3::new(-path.x, path.y, path.z) }
    }
}

impl SweepLight for To<'_> {
    /// Returns the columns from which the place lies mainly across planes.
    fn within(&self, columns: Range<usize>, [plane, row]: [usize; 2]) -> Range<usize> {
        let path = self.path([plane, row, 0]);
        let [strict_rows, strict_columns] = self.rays.strict;
        if path.x <= 0.0 || path.y.abs() > path.x || (strict_rows && path.y.abs() >= path.x) {
            return 0..0;
        }
        let [mut first, mut last] = [(path.z - path.x).ceil(), (path.z + path.x).floor()];
        if strict_columns {
            first += if first == path.z - path.x { 1.0 } else { 0.0 };
            last -= if last == path.z + path.x { 1.0 } else { 0.0 };
        }
        columns.start.max(first.max(0.0) as usize)..columns.end.min((last + 1.0).max(0.0) as usize)
    }

    #[inline(always)]
    fn arrive<S: pulp::Simd>(
        &self,
        _: S,
        [plane, row]: [usize; 2],
        columns: Range<usize>,
        sums: &[Vec<f32>],
        out: &[AtomicU16],
    ) {
        let swept = self.swept;
        let (of, near, response) = (swept.planes, self.rays.near, swept.response);
        let integral = response.integral;
        let own = swept.field.from(of.row(plane, row), 0);
        for (column, &planes) in columns.clone().zip(&sums[0][columns]) {
            if own[column] <= 0.0 {
                continue;
            }
            let path = self.path([plane, row, column]);
            let slopes = [path.y / path.x, path.z / path.x];
            let length = DVec3::new(1.0, slopes[0], slopes[1]).length();
            let towards = DVec3::new(if self.ahead { 1.0 } else { -1.0 }, slopes[0], slopes[1]);
            let scale = (self.rays.to_world * towards).length() / length;
            let sum = |stencil: &[StencilRow], down: i32| {
                let mut sum = 0.0_f32;
                for StencilRow { offset: [ahead, rows], column: first, weights } in stencil {
                    let planes = if self.ahead { *ahead } else { -*ahead };
                    let Some(source) = of.beside([plane, row], [planes, down * rows]) else { continue };
                    let values = swept.field.from(source, column as isize + *first as isize);
                    sum += weights.iter().zip(values).map(|(weight, value)| weight * value).sum::<f32>();
                }
                f64::from(sum)
            };
            let depth = if path.x < near.direct {
                let distance = path.x * length;
                if distance <= near.bias {
                    0.0
                } else {
                    scale * sum(&response.stencil(slopes, [near.bias, distance], None), 1)
                }
            } else {
                let far = scale * length * integral * f64::from(planes);
                if far >= f64::from(FAINT) {
                    far
                } else {
                    far + scale * sum(near.stencil(slopes), if slopes[0] < 0.0 { -1 } else { 1 })
                }
            };
            // Stencils have weights below 0: no more than all light arrives.
            out[column].store(nearest(65_535.0 * libm::exp(-depth.max(0.0)) as f32), Ordering::Relaxed);
        }
    }
}
