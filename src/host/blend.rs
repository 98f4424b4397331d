//! Fields of kernels of several sizes, blended where kernels grow with depth.

use std::ops::Range;

use glam::{DAffine3, DVec3};

use super::lattice::CELL;
use super::rays::Axes;
use crate::camera::Camera;
use crate::camera::Growth;

/// Fields of kernels at several growths, ascending.
pub(super) struct Blend<'a, F> {
    pub(super) levels: Vec<(f64, &'a F)>,
    /// The growth of kernels from which samples half way between planes are interpolated.
    wide: f64,
    growth: LatticeGrowth,
}

/// The growth of kernels over a lattice, linear from point to point. Kernels never grow less than 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LatticeGrowth {
    at_origin: f64,
    gradient: DVec3,
}

impl LatticeGrowth {
    /// Makes the growth over a lattice. `to_world` is the map from the lattice.
    pub(super) fn new(growth: Growth, camera: &Camera, to_world: &DAffine3) -> Self {
        let eye = camera.eye().unwrap_or(DVec3::ZERO);
        let gradient = to_world.matrix3.transpose() * (camera.forward * growth.slope);
        let depth = (to_world.translation - eye).dot(camera.forward);
        Self { at_origin: growth.constant + growth.slope * depth, gradient }
    }

    /// Returns whether each cell, given by the place of its middle, has points in a plane, or in the next, at which a
    /// field has a weight if fields of `growths` are blended.
    pub(super) fn served(&self, growths: &[f64], number: usize, middles: impl Iterator<Item = DVec3>) -> Vec<bool> {
        // A point more for the next planes, and one for rounding.
        let within = self.gradient.abs().element_sum() * (CELL as f64 / 2.0 + 2.0);
        let is_served = |middle: DVec3| {
            let growth = self.at_origin + self.gradient.dot(middle);
            let is_behind = number == 0 || growth + within > growths[number - 1];
            is_behind && growths.get(number + 1).is_none_or(|next| growth - within < *next)
        };
        middles.map(is_served).collect()
    }
}

/// The growth in the axes of a tile: at point 0, and its steps along a, b and the planes.
#[derive(Clone, Copy)]
pub(super) struct Along([f64; 4]);

/// Returns the growths of the fields between two growths: powers of the square root of 2, the same for every camera, up
/// to `most`.
pub(super) fn levels(smallest: f64, largest: f64, most: f64) -> Vec<f64> {
    // Whole powers of 2 are exact: a kernel of 4.000000000000001 voxels would take a filter of the next size.
    let level = |number: i32| libm::exp2(f64::from(number / 2)) * [1.0, std::f64::consts::SQRT_2][number as usize % 2];
    let first = (0..).take_while(|&number| level(number) <= smallest.max(1.0)).last().unwrap_or(0);
    let mut growths = vec![level(first)];
    for number in first + 1.. {
        if growths[growths.len() - 1] >= largest.min(most) {
            break;
        }
        growths.push(level(number).min(most));
    }
    growths
}

impl<'a, F> Blend<'a, F> {
    /// Makes the blend of fields.
    pub(super) fn new(levels: Vec<(f64, &'a F)>, wide: f64, growth: LatticeGrowth) -> Self {
        Self { levels, wide, growth }
    }

    /// Returns the growth in the axes of a tile.
    pub(super) fn along(&self, axes: &Axes) -> Along {
        let (frame, origin) = axes.frame();
        let LatticeGrowth { at_origin, gradient } = self.growth;
        let [a, b, m] = (frame.transpose() * gradient).to_array();
        Along([at_origin + gradient.dot(origin), a, b, m])
    }

    /// Returns whether kernels are wide somewhere.
    pub(super) fn has_wide(&self) -> bool {
        self.levels.iter().any(|(growth, _)| *growth >= self.wide)
    }

    /// Returns whether kernels are wide between places in a plane.
    pub(super) fn are_wide(&self, along: &Along, places: [[f64; 2]; 4], plane: f64) -> bool {
        let least = places.into_iter().map(|[a, b]| along.at(a, b, plane)).fold(f64::INFINITY, f64::min);
        least.clamp(self.levels[0].0, self.levels[self.levels.len() - 1].0) >= self.wide
    }

    /// Returns the first and the last level that a plane needs between two points.
    pub(super) fn needed(&self, along: &Along, area: [[isize; 2]; 2], plane: f64) -> [usize; 2] {
        let last = self.levels.len() - 1;
        if last == 0 {
            return [0, 0];
        }
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for a in [area[0][0], area[1][0]] {
            for b in [area[0][1], area[1][1]] {
                let growth = along.at(a as f64, b as f64, plane);
                (low, high) = (low.min(growth), high.max(growth));
            }
        }
        let below = self.levels.partition_point(|(growth, _)| *growth <= low).saturating_sub(1);
        let above = self.levels.partition_point(|(growth, _)| *growth < high).min(last);
        [below, above.max(below)]
    }

    /// Computes the weights of a level at points of a row, given its first place: linear in the variance of kernels.
    #[inline(always)]
    pub(super) fn weights(
        &self,
        along: &Along,
        level: usize,
        [a, b, plane]: [f64; 3],
        points: Range<usize>,
        weights: &mut [f32],
    ) {
        let square = |level: usize| (self.levels[level].0 * self.levels[level].0) as f32;
        let own = square(level);
        let below = if level > 0 { square(level - 1) } else { -1e30 };
        let above = if level + 1 < self.levels.len() { square(level + 1) } else { 1e30 };
        let (rise, fall) = (1.0 / (own - below), 1.0 / (above - own));
        let (start, step) = (along.at(a, b, plane) as f32, along.0[1] as f32);
        let weights = &mut weights[..points.end];
        for x in points {
            let growth = (x as f32).mul_add(step, start);
            let square = growth * growth;
            weights[x] = (1.0 + (square - own) * rise).min(1.0 - (square - own) * fall).max(0.0);
        }
    }
}

impl Along {
    /// Returns the growth at a point over the axes.
    #[inline(always)]
    fn at(&self, a: f64, b: f64, plane: f64) -> f64 {
        let [value, of_a, of_b, of_plane] = self.0;
        value + of_a * a + of_b * b + of_plane * plane
    }
}

/// Adds a row times its weights to the row `to`; the first row begins the sums.
#[inline(always)]
pub(super) fn blend_row(weights: &[f32], from: &[f32], to: &mut [f32], is_first: bool) {
    let count = to.len();
    let (weights, from) = (&weights[..count], &from[..count]);
    if is_first {
        for x in 0..count {
            to[x] = weights[x] * from[x];
        }
    } else {
        for x in 0..count {
            to[x] = weights[x].mul_add(from[x], to[x]);
        }
    }
}
