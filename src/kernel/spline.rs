//! Kernels as sums of cubic B-splines on the lattice.
//!
//! With B the tensor product of cubic B-splines, h(x) / N is nearly the sum over lattice points j of q_j B(x - j). The
//! field sum_j v_j h(x - j) / N is then nearly sum_j c_j B(x - j), with coefficients c = q * v: after one filter that
//! depends on the kernel alone, no kernel is evaluated any more (Unser, Aldroubi and Eden 1993, "B-spline signal
//! processing").
//!
//! q minimises the squared error over all frequencies, weighted by the power of smooth data. It has the symmetries of
//! the cube, and a constant field stays as it is.

use std::f64::consts::PI;

use super::Kernel;
use super::quadrature::{NODES, integrate};
use crate::error::{Error, Result};

/// The largest reach of a filter.
pub(crate) const MAX_REACH: usize = 8;

/// A filter from samples to the coefficients of cubic B-splines, for a kernel over its integral.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SplineFilter {
    reach: usize,
    /// The weights of all classes of offsets that are alike by symmetry, numbered by [`class`].
    weights: Vec<f64>,
    misfit: Misfit,
}

/// The share of a kernel that its splines leave out: root mean squares over frequencies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Misfit {
    /// The misfit for fields of noise: single voxels.
    pub(crate) noise: f64,
    /// The misfit for smooth fields, with the power of [`power`].
    pub(crate) data: f64,
}

/// Returns the power of smooth data over the distance of a frequency from 0 in the Brillouin zone, radians a voxel,
/// with a floor for noise.
fn power(distance: f64) -> f64 {
    let of_knee = (distance / 0.35).powi(2);
    1.0 / (1.0 + of_knee * of_knee) + 1e-4
}

/// Returns the number of the class of offsets that are alike by symmetry.
fn class(offset: [usize; 3]) -> usize {
    let mut sorted = offset;
    sorted.sort_unstable();
    let [low, middle, high] = sorted;
    high * (high + 1) * (high + 2) / 6 + middle * (middle + 1) / 2 + low
}

/// Returns the number of classes of offsets of up to `reach` voxels along each axis.
fn classes(reach: usize) -> usize {
    (reach + 1) * (reach + 2) * (reach + 3) / 6
}

/// Returns the Fourier transform of the cubic B-spline.
fn spline_spectrum(frequency: f64) -> f64 {
    let half = frequency / 2.0;
    if half.abs() < 1e-9 { 1.0 } else { (libm::sin(half) / half).powi(4) }
}

/// The Fourier transform of a kernel over its integral, in steps of frequency.
struct Spectrum {
    values: Vec<f64>,
    step: f64,
}

impl Spectrum {
    /// The farthest frequency: the corner of the zones around the first.
    const FARTHEST: f64 = 3.0 * PI * 1.7321;

    fn new(kernel: &Kernel) -> Self {
        let radius = kernel.radius();
        // Four steps a radian for a kernel of 1 voxel, and panels that follow the waves.
        let step = (0.25 / radius).min(0.1);
        let panels = (4.0 * radius * Self::FARTHEST / PI).ceil().max(24.0) as u32 / 5 + 8;
        let integral = kernel.integral() / (4.0 * PI);
        let at = |number: usize| {
            let k = number as f64 * step;
            let wave = |r: f64| if k * r < 1e-9 { 1.0 } else { libm::sin(k * r) / (k * r) };
            integrate(0.0, radius, panels, |r| kernel.value(r * r) * r * r * wave(r)) / integral
        };
        Self { values: (0..(Self::FARTHEST / step) as usize + 4).map(at).collect(), step }
    }

    /// Returns the value at a frequency by the cubic through the nearest four.
    fn at(&self, frequency: f64) -> f64 {
        let place = frequency / self.step;
        let first = (place.floor() as usize).clamp(1, self.values.len() - 3);
        let t = place - first as f64;
        let [a, b, c, d] = [0, 1, 2, 3].map(|n| self.values[first - 1 + n]);
        let weights = [
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0,
            (t + 1.0) * t * (t - 1.0) / 6.0,
        ];
        a * weights[0] + b * weights[1] + c * weights[2] + d * weights[3]
    }
}

/// Returns frequencies from 0 to pi with weights: panels that are narrow where smooth data have their power.
fn frequencies() -> Vec<[f64; 2]> {
    const ENDS: [f64; 5] = [0.0, 0.3, 0.9, 2.0, PI];
    let panel = |ends: &[f64]| {
        let (middle, half) = ((ends[0] + ends[1]) / 2.0, (ends[1] - ends[0]) / 2.0);
        NODES.map(|(node, weight)| [middle + half * node, half * weight])
    };
    ENDS.windows(2).flat_map(panel).collect()
}

impl SplineFilter {
    /// The largest support radius of a kernel, voxels: splines reach 2 voxels beyond the farthest weight.
    pub(crate) const MAX_RADIUS: f64 = MAX_REACH as f64 + 2.0;

    /// Fits the filter of a kernel.
    ///
    /// # Errors
    /// [`Error::Setting`] if the kernel reaches farther than [`Self::MAX_RADIUS`].
    pub(crate) fn new(kernel: &Kernel) -> Result<Self> {
        let radius = kernel.radius();
        if radius > Self::MAX_RADIUS * (1.0 + 1e-9) {
            let reason = format!("it reaches {radius} voxels, expected up to {}", Self::MAX_RADIUS);
            return Err(Error::setting("kernel", reason));
        }
        // Splines reach 2 voxels themselves; narrow kernels need negative weights around.
        let reach = (radius.ceil() as usize).clamp(2, MAX_REACH);
        // Of wide kernels even reaches alone: fewer forms of the filter are compiled.
        let reach = if reach > 4 { reach.next_multiple_of(2) } else { reach };
        let count = classes(reach);
        let spectrum = Spectrum::new(kernel);
        let axis = frequencies();
        let splines: Vec<[f64; 3]> =
            axis.iter().map(|&[w, _]| [w, w - 2.0 * PI, w + 2.0 * PI].map(spline_spectrum)).collect();
        let cosines: Vec<Vec<f64>> = axis
            .iter()
            .map(|&[w, _]| (0..=reach).map(|i| libm::cos(i as f64 * w) * if i == 0 { 1.0 } else { 2.0 }).collect())
            .collect();
        let offsets: Vec<([usize; 3], usize)> = (0..=reach)
            .flat_map(|k| (0..=reach).flat_map(move |j| (0..=reach).map(move |i| [i, j, k])))
            .map(|offset| (offset, class(offset)))
            .collect();
        let places: Vec<[usize; 3]> =
            (0..axis.len()).flat_map(|k| (0..=k).flat_map(move |j| (0..=j).map(move |i| [i, j, k]))).collect();
        // Sums over the frequencies outside of the zone, which alias to the same filter.
        let aliases = |place: [usize; 3]| {
            let mut sums = [0.0_f64; 3];
            for number in 0..27 {
                let zone = [number % 3, number / 3 % 3, number / 9];
                let square: f64 = (0..3)
                    .map(|a| {
                        let w: f64 = axis[place[a]][0];
                        [w, w - 2.0 * PI, w + 2.0 * PI][zone[a]].powi(2)
                    })
                    .sum();
                let spline: f64 = (0..3).map(|a| splines[place[a]][zone[a]]).product();
                let own = spectrum.at(square.sqrt());
                sums = [sums[0] + spline * spline, sums[1] + spline * own, sums[2] + own * own];
            }
            sums
        };
        let mut normal = vec![vec![0.0; count + 1]; count + 1];
        let mut right = vec![0.0; count + 1];
        let mut sampled = Vec::with_capacity(places.len());
        for &place in &places {
            let mut basis = vec![0.0; count];
            for &([i, j, k], class) in &offsets {
                basis[class] += cosines[place[0]][i] * cosines[place[1]][j] * cosines[place[2]][k];
            }
            let [x, y, z] = place;
            let permutations = if x == y && y == z {
                1.0
            } else if x == y || y == z {
                3.0
            } else {
                6.0
            };
            let weight = permutations * place.iter().map(|&p| axis[p][1]).product::<f64>();
            let distance = place.iter().map(|&p| axis[p][0].powi(2)).sum::<f64>().sqrt();
            let [splines, both, own] = aliases(place);
            let weighted = weight * power(distance);
            for a in 0..count {
                for b in 0..count {
                    normal[a][b] += weighted * splines * basis[a] * basis[b];
                }
                right[a] += weighted * both * basis[a];
            }
            sampled.push((basis, [weight, weighted], [splines, both, own]));
        }
        // The weights add up to 1: Lagrange's condition.
        for &(offset, class) in &offsets {
            let alike = offset.iter().map(|&o| if o == 0 { 1.0 } else { 2.0 }).product::<f64>();
            normal[class][count] += alike;
            normal[count][class] += alike;
        }
        right[count] = 1.0;
        let mut weights = solved(normal, right);
        weights.truncate(count);
        let mut sums = [[0.0_f64; 2]; 2];
        for (basis, by, [splines, both, own]) in &sampled {
            let gain: f64 = basis.iter().zip(&weights).map(|(b, w)| b * w).sum();
            let error = gain * gain * splines - 2.0 * gain * both + own;
            for (sum, weight) in sums.iter_mut().zip(by) {
                *sum = [sum[0] + weight * error.max(0.0), sum[1] + weight * own];
            }
        }
        let [noise, data] = sums.map(|[error, own]| (error / own).sqrt());
        Ok(Self { reach, weights, misfit: Misfit { noise, data } })
    }

    /// Returns the number of samples, on either side along each axis, on which a coefficient depends.
    pub(crate) fn reach(&self) -> usize {
        self.reach
    }

    /// Returns the weight of a sample at an offset within the reach.
    pub(crate) fn weight(&self, offset: [usize; 3]) -> f64 {
        self.weights[class(offset)]
    }

    pub(crate) fn misfit(&self) -> Misfit {
        self.misfit
    }

    /// Returns the filter for a kernel over its integral, times `factor`.
    pub(crate) fn times(mut self, factor: f64) -> Self {
        self.weights.iter_mut().for_each(|weight| *weight *= factor);
        self
    }
}

/// Solves a linear system by Gauss's elimination with the largest pivot of each column.
fn solved(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let count = right.len();
    for column in 0..count {
        let largest = |a: &usize, b: &usize| matrix[*a][column].abs().total_cmp(&matrix[*b][column].abs());
        let pivot = (column..count).max_by(largest).unwrap_or(column);
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        let (above, below) = matrix.split_at_mut(column + 1);
        let first = &above[column];
        for (row, matrix) in below.iter_mut().enumerate() {
            let factor = matrix[column] / first[column];
            for (value, first) in matrix[column..].iter_mut().zip(&first[column..]) {
                *value -= factor * first;
            }
            right[column + 1 + row] -= factor * right[column];
        }
    }
    for row in (0..count).rev() {
        let known: f64 = (row + 1..count).map(|column| matrix[row][column] * right[column]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_add_up_to_one() {
        let filter = SplineFilter::new(&Kernel::default()).unwrap();
        assert_eq!(filter.reach(), 2);
        let total: f64 = (-2..=2_i32)
            .flat_map(|k| (-2..=2_i32).flat_map(move |j| (-2..=2_i32).map(move |i| [i, j, k])))
            .map(|offset| filter.weight(offset.map(|o| o.unsigned_abs() as usize)))
            .sum();
        assert!((total - 1.0).abs() < 1e-12, "{total}");
    }

    #[test]
    fn misfits_are_measured() {
        for (kernel, noise, data) in [
            (Kernel::default(), 0.09, 0.02),
            (Kernel::Gaussian { sigma: 1.0, radius: 3.0 }, 0.019, 0.0025),
            (Kernel::KAISER_BESSEL, 0.05, 0.012),
        ] {
            let misfit = SplineFilter::new(&kernel).unwrap().misfit();
            assert!(
                (misfit.noise / noise - 1.0).abs() < 0.25 && (misfit.data / data - 1.0).abs() < 0.35,
                "{kernel}: {misfit:?}"
            );
        }
    }

    /// The field of splines is the field of kernels, but for the misfit.
    #[test]
    fn splines_follow_kernels() {
        let kernel = Kernel::Gaussian { sigma: 1.0, radius: 3.0 };
        let filter = SplineFilter::new(&kernel).unwrap();
        let spline = |x: f64| {
            let x = x.abs();
            if x < 1.0 { (4.0 - 6.0 * x * x + 3.0 * x * x * x) / 6.0 } else { (2.0 - x).max(0.0).powi(3) / 6.0 }
        };
        let reach = filter.reach() as i32;
        for place in [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.3, 0.4, -0.7], [2.0, 1.0, 1.0]] {
            let sum: f64 = (-reach..=reach)
                .flat_map(|k| (-reach..=reach).flat_map(move |j| (-reach..=reach).map(move |i| [i, j, k])))
                .map(|offset| {
                    let weight = filter.weight(offset.map(|o| o.unsigned_abs() as usize));
                    weight * (0..3).map(|a| spline(place[a] - f64::from(offset[a]))).product::<f64>()
                })
                .sum();
            let expected = kernel.value(place.iter().map(|p: &f64| p * p).sum()) / kernel.integral();
            assert!((sum - expected).abs() < 0.03 / kernel.integral(), "{place:?}: {sum} {expected}");
        }
    }
}
