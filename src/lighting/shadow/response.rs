//! The response of a sweep to single voxels, and the stencils that mend it near the voxel that is lit.

use crate::kernel::{FootprintTable, Kernel};
use glam::DVec3;

/// The number of rows of the table of footprints. With [`TERMS`] terms its error is below 1e-5 of a footprint's peak
/// for kernels that sweeps serve.
pub(super) const ROWS: u32 = 512;
pub(super) const TERMS: u32 = 12;

/// The share of the integral of a kernel below which weights of a stencil are left out.
const FAINT: f64 = 2e-3;

/// The number of samples per voxel of [`SweepResponse::within`].
const SAMPLES: usize = 64;

/// The variance of the quadratic B-spline by which sweeps read planes.
const SPLINE_VARIANCE: f64 = 0.25;

/// The response of a sweep to a voxel.
///
/// A sweep filters extinctions along the three axes of the lattice, reads each plane across its main axis by a
/// quadratic B-spline at the places of its rays, adds planes up, and reads the sum by Catmull-Rom splines. So a voxel's
/// kernel is replaced by a product of the filters and the splines, which has the kernel's integral and its variance.
pub(super) struct SweepResponse {
    kernel: Kernel,
    pub(super) table: FootprintTable,
    pub(super) divisor: f64,
    /// The integral of a kernel in units of the divisor.
    pub(super) integral: f64,
    /// The weights of the filter across planes, and in `within` of the filter within planes, the middle one first.
    pub(super) across: Vec<f64>,
    pub(super) within: Vec<f64>,
    /// The response within a plane along one axis, at distances of 1/64 of a voxel from 0 on.
    response: Vec<f64>,
}

/// The weights of neighbours in one row of the lattice, counted from the lit voxel.
pub(super) struct StencilRow {
    /// The number of planes towards the light, and of rows, from the lit voxel.
    pub(super) offset: [i32; 2],
    /// The first column, counted from the lit voxel.
    pub(super) column: i32,
    pub(super) weights: Vec<f32>,
}

/// The largest variance of a filter of three weights that are not negative, with the largest in the middle.
const WIDEST: f64 = 2.0 / 3.0;

/// Returns symmetric weights of a variance (voxels^2), the middle one first: filters of three weights, one after the
/// other.
pub(super) fn filter(variance: f64) -> Vec<f64> {
    let times = (variance / WIDEST).ceil().max(1.0);
    let (side, middle) = (variance / times / 2.0, 1.0 - variance / times);
    let mut weights = vec![1.0];
    for _ in 0..times as usize {
        let at = |i: i32| weights.get(i.unsigned_abs() as usize).copied().unwrap_or(0.0);
        weights = (0..=weights.len() as i32).map(|i| middle * at(i) + side * (at(i - 1) + at(i + 1))).collect();
    }
    weights
}

/// Returns the quadratic B-spline.
fn spline(x: f64) -> f64 {
    let x = x.abs();
    if x < 0.5 { 0.75 - x * x } else { 0.5 * (1.5 - x).max(0.0).powi(2) }
}

/// Returns the weights of a quadratic B-spline for the nearest point and its neighbours, given the place relative to
/// it, -1/2 to 1/2.
pub(super) fn spline_weights(x: f32) -> [f32; 3] {
    [0.5 * (0.5 - x) * (0.5 - x), 0.75 - x * x, 0.5 * (0.5 + x) * (0.5 + x)]
}

/// Returns the weights of the Catmull-Rom spline (Catmull and Rom 1974, "A class of local interpolating splines") for
/// the two points on either side of a place, given its distance from the second, 0 to 1.
pub(super) fn catmull_rom(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [-0.5 * f + f2 - 0.5 * f3, 1.0 - 2.5 * f2 + 1.5 * f3, 0.5 * f + 2.0 * f2 - 1.5 * f3, -0.5 * f2 + 0.5 * f3]
}

impl SweepResponse {
    /// Returns the response for sums of kernels with a divisor; `None` if the kernel is narrower than a sweep can be.
    pub(super) fn new(kernel: &Kernel, divisor: f64) -> Option<Self> {
        let variance = kernel.variance();
        if variance < SPLINE_VARIANCE {
            return None;
        }
        let table = FootprintTable::with_size(kernel, ROWS, TERMS);
        let (across, within) = (filter(variance), filter(variance - SPLINE_VARIANCE));
        // The splines after each other, and the filter: an integral over 64 places of a voxel.
        let rom = |x: f64| {
            let x = x.abs();
            let outside = 2.0 - 4.0 * x + 2.5 * x * x - 0.5 * x.powi(3);
            if x < 1.0 {
                1.0 - 2.5 * x * x + 1.5 * x.powi(3)
            } else if x < 2.0 {
                outside
            } else {
                0.0
            }
        };
        let step = 1.0 / SAMPLES as f64;
        let splines = |y: f64| -> f64 {
            (-2 * SAMPLES as i32..=2 * SAMPLES as i32)
                .map(|i| f64::from(i) * step)
                .map(|x| rom(x) * spline(y - x))
                .sum::<f64>()
                * step
        };
        let reach = within.len() as i32 - 1;
        let count = (reach as usize + 4) * SAMPLES;
        let response = (0..count).map(|i| i as f64 * step);
        let response = response
            .map(|y| (-reach..=reach).map(|o| within[o.unsigned_abs() as usize] * splines(y - f64::from(o))).sum())
            .collect();
        Some(Self { kernel: *kernel, table, divisor, integral: kernel.integral() / divisor, across, within, response })
    }

    /// Returns the number of voxels by which the filters widen a field.
    pub(super) fn margin(&self) -> usize {
        self.across.len().max(self.within.len()) - 1
    }

    pub(super) fn radius(&self) -> f64 {
        self.kernel.radius()
    }

    /// Returns the least number of planes from a voxel beyond which sweeps serve, given the bias in voxels.
    pub(super) fn planes(bias: f64, length: f64) -> usize {
        (bias / length).round() as usize + 1
    }

    /// Returns the largest number of rows or columns between a voxel and its neighbours in a stencil.
    pub(super) fn reach(&self, bias: f64) -> usize {
        let planes = Self::planes(bias, 1.0) + self.across.len();
        planes + (3.0_f64.sqrt() * self.kernel.radius()).ceil() as usize + self.within.len() + 4
    }

    /// Returns the largest number of columns beyond a row that stencils read, given the bias in voxels.
    pub(super) fn pad(&self, bias: f64) -> usize {
        self.reach(bias) + (3.0 * self.kernel.radius()).ceil() as usize + 2
    }

    /// Returns the response within a plane at a distance along one axis.
    fn within(&self, y: f64) -> f64 {
        let at = y.abs() * SAMPLES as f64;
        let (below, part) = (at as usize, at.fract());
        let value = |i: usize| self.response.get(i).copied().unwrap_or(0.0);
        value(below) + part * (value(below + 1) - value(below))
    }

    /// Returns the section of a kernel along the ray from a lattice point in the unit direction `along` between two
    /// distances, in units of the divisor, given the offset of the kernel.
    pub(super) fn section(&self, offset: DVec3, along: DVec3, between: [f64; 2]) -> f64 {
        let t = offset.dot(along);
        let r2 = offset.length_squared() - t * t;
        self.table.section(self.kernel.radius(), r2, between[0] - t, between[1] - t) / self.divisor
    }

    /// Returns the weights of the voxels near a lit voxel: the section of each kernel between two distances, less the
    /// response of a sweep that adds up the planes beyond `far`; `None`: no sweep. `slopes` are rows and columns a
    /// plane towards the light.
    pub(super) fn stencil(&self, slopes: [f64; 2], between: [f64; 2], far: Option<usize>) -> Vec<StencilRow> {
        let along = DVec3::new(1.0, slopes[0], slopes[1]);
        let length = along.length();
        let along = along / length;
        let radius = self.kernel.radius();
        let (reach, far) = (self.across.len() as i32 - 1, far.map(|far| far as i32));
        let last = far.map_or(((between[1] / length) + radius).floor() as i32, |far| far + reach);
        let wide = (radius * length).max(if far.is_some() { self.within.len() as f64 + 2.5 } else { 0.0 });
        let (mut weights, mut faint, mut total) = (Vec::new(), 0.0, 0.0);
        for plane in -(radius.floor() as i32)..=last {
            let middle = slopes.map(|slope| slope * f64::from(plane));
            let range = |k: usize| (middle[k] - wide).ceil() as i32..=(middle[k] + wide).floor() as i32;
            for (row, column) in range(0).flat_map(|row| range(1).map(move |column| (row, column))) {
                let offset = DVec3::new(f64::from(plane), f64::from(row), f64::from(column));
                let section = self.section(offset, along, between);
                // Planes between the voxel and the far ones are not swept.
                let swept: f64 = far.map_or(0.0, |far| {
                    let planes = (far + 1).max(plane - reach)..=plane + reach;
                    planes
                        .map(|swept| {
                            let across = self.across[(swept - plane).unsigned_abs() as usize];
                            let [row, column] = [(row, slopes[0]), (column, slopes[1])]
                                .map(|(n, slope)| self.within(f64::from(n) - slope * f64::from(swept)));
                            across * row * column
                        })
                        .sum()
                });
                let weight = section - swept * length * self.integral;
                total += section;
                if weight.abs() < FAINT * self.integral {
                    faint += weight;
                } else {
                    weights.push(([plane, row], column, weight, section));
                }
            }
        }
        // The sum stays, so uniform matter absorbs as much as it does.
        let share =
            if total > 0.0 { faint / weights.iter().map(|(.., section)| section).sum::<f64>().max(1e-30) } else { 0.0 };
        let mut rows: Vec<StencilRow> = Vec::new();
        for (offset, column, weight, section) in weights {
            let weight = (weight + share * section) as f32;
            match rows.last_mut() {
                Some(row) if row.offset == offset => {
                    row.weights.resize((column - row.column) as usize, 0.0);
                    row.weights.push(weight);
                }
                _ => rows.push(StencilRow { offset, column, weights: vec![weight] }),
            }
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KERNELS: [Kernel; 3] = [
        Kernel::Gaussian { sigma: 1.0, radius: 2.0 },
        Kernel::KAISER_BESSEL,
        Kernel::Gaussian { sigma: 2.0, radius: 4.0 },
    ];

    #[test]
    fn filters_have_their_variance() {
        for variance in [0.0, 0.36, 0.61, 2.4, 17.0] {
            let weights = filter(variance);
            let moment = |power: i32| -> f64 {
                let sides = weights.iter().enumerate().skip(1).map(|(i, w)| 2.0 * w * (i as f64).powi(power));
                sides.sum::<f64>() + if power == 0 { weights[0] } else { 0.0 }
            };
            assert!((moment(0) - 1.0).abs() < 1e-12 && (moment(2) - variance).abs() < 1e-12 * (1.0 + variance));
            assert!(weights.iter().all(|w| *w >= 0.0));
        }
    }

    #[test]
    fn a_sweep_replaces_kernels_by_the_same_integral_and_variance() {
        for kernel in KERNELS {
            let response = SweepResponse::new(&kernel, kernel.integral()).unwrap();
            let places = (-20 * SAMPLES as i32..=20 * SAMPLES as i32).map(|i| f64::from(i) / SAMPLES as f64);
            let moment =
                |power: i32| places.clone().map(|y| response.within(y) * y.powi(power)).sum::<f64>() / SAMPLES as f64;
            let variance = kernel.variance();
            assert!((moment(0) - 1.0).abs() < 1e-3, "{kernel:?} {}", moment(0));
            assert!((moment(2) - variance).abs() < 0.01 * variance, "{kernel:?} {} {variance}", moment(2));
        }
        let narrow = Kernel::Gaussian { sigma: 0.3, radius: 1.0 };
        assert!(SweepResponse::new(&narrow, narrow.integral()).is_none());
    }

    /// In uniform matter a stencil and the planes that it leaves to the sweep absorb as much as all sections.
    #[test]
    fn stencils_absorb_as_much_as_sections() {
        for kernel in KERNELS {
            let response = SweepResponse::new(&kernel, kernel.integral()).unwrap();
            // Not along an axis, where a Gaussian's kernels line up and absorb 5 % less.
            for (slopes, bias) in [([0.31, -0.72], 1.5), ([-0.93, 0.88], 0.0), ([0.47, 0.13], 4.0)] {
                let length = DVec3::new(1.0, slopes[0], slopes[1]).length();
                let near = SweepResponse::planes(bias, length);
                let sum =
                    |rows: &[StencilRow]| rows.iter().flat_map(|row| &row.weights).map(|w| f64::from(*w)).sum::<f64>();
                let last = 40.0;
                let all = sum(&response.stencil(slopes, [bias, last * length], None));
                let mended = sum(&response.stencil(slopes, [bias, f64::INFINITY], Some(near)));
                // Half of the last plane lies beyond the end.
                let swept = (last + 0.5 - (near as f64 + 1.0)) * length;
                let ripple = 0.06 * length;
                assert!(
                    (mended + swept - all).abs() < ripple + 0.01 * all,
                    "{kernel:?} {slopes:?}: {mended} + {swept}, {all}"
                );
            }
        }
    }
}
