//! Ambient occlusion: the optical depths of all voxels along the 26 directions to their neighbours.
//!
//! In these directions the rays of a voxel pass through lattice points, at which the field of extinctions, filtered to
//! the width of kernels, is summed with weights. The weights are those of least squared distance from the sections of
//! kernels along the ray.

use std::sync::atomic::AtomicU16;

use glam::DVec3;
use rayon::prelude::*;

use super::field::{ExtinctionBox, LANES, RowPlanes, Shares};
use super::lanes::RowLanes;
use super::response::{SweepResponse, filter};
use super::sweep::nearest;
use super::{ShadowLattice, all_around};
use crate::error::Result;
use crate::kernel::Kernel;
use crate::vectors::dispatch;

/// The variance of the filter as a share of the kernel's, at which the errors of single voxels are least.
const SHARE: f64 = 1.1;

/// The weight of the weights' sum among the squared distances that a fit minimises.
const PINNED: f64 = 900.0;

/// A ray from a voxel towards one of its neighbours.
pub(super) struct Ray {
    /// The step to the next point of the ray: columns, rows and planes.
    pub(super) step: [i32; 3],
    /// The factor of the ray's light.
    pub(super) share: f32,
    /// The weights of the ray's points, the voxel's own first.
    pub(super) weights: Vec<f32>,
}

/// Returns the weights of the filter of the field along each axis, the middle one first.
pub(super) fn filter_of(kernel: &Kernel) -> Vec<f64> {
    filter(SHARE * kernel.variance())
}

/// Returns the rays from a voxel if occluders from the bias to `radius` count (voxels), through a field filtered with
/// `weights`.
pub(super) fn rays(
    lattice: &ShadowLattice,
    response: &SweepResponse,
    weights: &[f64],
    [bias, radius]: [f64; 2],
) -> Vec<Ray> {
    let rays = all_around().map(|(along, share)| {
        let step = along.to_array().map(|c| if c.abs() < 0.1 { 0.0 } else { c.signum() });
        let scale = (lattice.to_world * along).length() / lattice.unit;
        let weights = weights_along(response, weights, step, [bias.min(radius), radius]);
        let weights = weights.into_iter().map(|w| (w * scale) as f32).collect();
        Ray { step: step.map(|s| s as i32), share: share as f32, weights }
    });
    rays.collect()
}

/// Returns the light that arrives at each voxel of a field from all around, 65535 for all of it, if occluders from the
/// bias to `radius` count (voxels).
pub(super) fn arriving(
    field: &ExtinctionBox,
    lattice: &ShadowLattice,
    response: &SweepResponse,
    [bias, radius]: [f64; 2],
) -> Result<Shares> {
    let planes = RowPlanes::across(2, field.size);
    let weights = filter_of(&lattice.kernel);
    let single: Vec<f32> = weights.iter().map(|&w| w as f32).collect();
    let filtered = field.filtered(planes, [&single, &single])?;
    let rays = rays(lattice, response, &weights, [bias, radius]);
    let [nx, ny, _] = field.size;
    let mut out = field.dark()?;
    let rows = out.values.par_chunks_mut(nx).enumerate().filter(|(row, _)| !field.filled(*row).is_empty());
    rows.for_each(|(row, out)| {
        dispatch(RowSum { field, filtered: &filtered, rays: &rays, at: [row % ny, row / ny], out });
    });
    Ok(out)
}

/// The light of a row of voxels, as a type so that it is compiled for the widest vectors of the machine.
struct RowSum<'a> {
    field: &'a ExtinctionBox,
    filtered: &'a ExtinctionBox,
    rays: &'a [Ray],
    /// The y and the z of the row.
    at: [usize; 2],
    out: &'a mut [AtomicU16],
}

impl pulp::WithSimd for RowSum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let Self { field, filtered, rays, at, out } = self;
        let planes = RowPlanes::across(2, field.size);
        let row = planes.row(at[1], at[0]);
        // The points of all rays in the field, ray after ray: the values for all columns, and the weights.
        let mut points = Vec::with_capacity(256);
        // For each ray its share and the end of its points.
        let mut ends = [(0.0, 0); 26];
        for (end, Ray { step: [dx, dy, dz], share, weights }) in ends.iter_mut().zip(rays) {
            for (k, &weight) in (0..).zip(weights) {
                let source = planes.beside([at[1], at[0]], [k * dz, k * dy]);
                let Some(source) = source.filter(|_| (k * dx).unsigned_abs() < field.size[0] as u32) else { break };
                if !filtered.filled(source).is_empty() {
                    points.push((filtered.from(source, (k * dx) as isize), weight));
                }
            }
            *end = (*share, points.len());
        }
        let mut lights = [0.0; LANES];
        let runs = field.runs(std::iter::once(row));
        for (start, end) in runs.flat_map(|run| run.clone().step_by(RowLanes::<S>::COUNT).map(move |i| (i, run.end))) {
            let mut light = RowLanes::new(simd, 0.0);
            let mut first = 0;
            for (share, end) in ends {
                let mut sums = RowLanes::new(simd, 0.0);
                for (values, weight) in &points[first..end] {
                    sums = sums.plus(simd, *weight, RowLanes::load(&values[start..]));
                }
                light = light.plus(simd, share, sums.transmitted(simd));
                first = end;
            }
            light.store(&mut lights);
            let count = end - start;
            for (out, light) in out[start..].iter_mut().zip(&lights).take(count.min(RowLanes::<S>::COUNT)) {
                // Half of the surroundings of a point on a plane lie behind the plane.
                *out.get_mut() = nearest((2.0 * light).min(1.0) * 65_535.0);
            }
        }
    }
}

/// Returns the weights of the points of a ray from a lattice point along `step`, the point itself first, between two
/// distances in voxels, in units of the divisor of kernels, for a field filtered with `filter`.
fn weights_along(response: &SweepResponse, filter: &[f64], step: [f64; 3], between: [f64; 2]) -> Vec<f64> {
    let step = DVec3::from_array(step);
    let along = step.normalize();
    let reach = filter.len() as i32 - 1;
    let count = ((between[1] + response.radius()) / step.length()).floor() as usize + 1;
    let weight = |i: i32| filter.get(i.unsigned_abs() as usize).copied().unwrap_or(0.0);
    let around = |reach: i32| {
        let range = move || -reach..=reach;
        range().flat_map(move |x| range().flat_map(move |y| range().map(move |z| [x, y, z])))
    };
    // The products of the filters of two points, and of a filter with the sections.
    let overlap = |offset: DVec3| -> f64 {
        let along_axis = |n: i32| (-reach..=reach).map(|i| weight(i) * weight(i + n)).sum::<f64>();
        offset.to_array().into_iter().map(|c| along_axis(c as i32)).product()
    };
    let section = |offset: DVec3| response.section(offset, along, between);
    let seen = |k: usize| -> f64 {
        let at = step * k as f64;
        around(reach)
            .map(|o| o.map(weight).iter().product::<f64>() * section(at + DVec3::from_array(o.map(f64::from))))
            .sum()
    };
    // All kernels that the ray meets: the columns of points along the ray's main axis.
    let main = along.abs().max_position();
    let wide = (response.radius() / along[main].abs()).ceil() as i32;
    let last = ((between[1] + response.radius()) * along[main].abs()).ceil() as i32;
    let total: f64 = (-wide..=last)
        .map(|plane| {
            let at = step * f64::from(plane);
            let across = around(wide).filter(|o| o[main] == 0);
            across.map(|o| section(at + DVec3::from_array(o.map(f64::from)))).sum::<f64>()
        })
        .sum();
    let overlaps: Vec<f64> = (0..count).map(|k| overlap(step * k as f64) + PINNED).collect();
    let matrix = (0..count).map(|i| (0..count).map(|j| overlaps[i.abs_diff(j)]).collect()).collect();
    solved(matrix, (0..count).map(|k| seen(k) + PINNED * total).collect())
}

/// Solves a system of linear equations with a symmetric, positive definite matrix, by elimination.
fn solved(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let count = right.len();
    for i in 0..count {
        let (above, below) = matrix.split_at_mut(i + 1);
        let pivot = &above[i];
        for (row, number) in below.iter_mut().zip(i + 1..) {
            let factor = row[i] / pivot[i];
            row[i..].iter_mut().zip(&pivot[i..]).for_each(|(value, above)| *value -= factor * above);
            right[number] -= factor * right[i];
        }
    }
    for i in (0..count).rev() {
        let known: f64 = (i + 1..count).map(|j| matrix[i][j] * right[j]).sum();
        right[i] = (right[i] - known) / matrix[i][i];
    }
    right
}
