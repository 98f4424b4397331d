//! The response of a reconstruction to waves and noise.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::Prefilter;
use crate::kernel::Kernel;

/// A function of one argument.
type Function<T> = Box<dyn Fn(T) -> f64 + Send + Sync>;

/// A field as a weighted sum of filtered samples.
pub struct Reconstruction {
    /// Number of samples with a weight to either side of a point, along each axis.
    pub reach: u32,
    /// The weight of a sample, given its offset from the point in voxels.
    pub weight: Function<DVec3>,
    /// The factor of the filter at a frequency, radians a voxel.
    pub gain: Function<[f64; 3]>,
}

impl Reconstruction {
    /// Makes the reconstruction by a kernel over its integral, of samples that `prefilter` filters first.
    #[must_use]
    pub fn new(kernel: Kernel, prefilter: Option<Prefilter>) -> Self {
        let integral = kernel.integral();
        Self {
            reach: kernel.radius().ceil() as u32,
            weight: Box::new(move |offset| kernel.value(offset.length_squared()) / integral),
            gain: Box::new(move |frequency| prefilter.as_ref().map_or(1.0, |prefilter| prefilter.gain(frequency))),
        }
    }

    /// Sums weights times a wave (radians a voxel) at each of `places`^3 points between samples, x fastest. Returns
    /// real and imaginary parts.
    #[must_use]
    pub fn waves(&self, frequency: [f64; 3], places: u32) -> Vec<[f64; 2]> {
        let place = |i: u32| (f64::from(i) + 0.5) / f64::from(places);
        let all = (0..places).flat_map(|k| (0..places).flat_map(move |j| (0..places).map(move |i| [i, j, k])));
        let reach = i64::from(self.reach);
        let times = |[a, b]: [f64; 2], [c, d]: [f64; 2]| [a * c - b * d, a * d + b * c];
        all.map(|at| {
            let at = DVec3::from_array(at.map(place));
            let [x, y, z] = [0, 1, 2].map(|axis| -> Vec<(f64, [f64; 2])> {
                let offset = |i: i64| i as f64 - at[axis];
                let wave = |offset: f64| [(offset * frequency[axis]).cos(), (offset * frequency[axis]).sin()];
                (1 - reach..=reach).map(|i| (offset(i), wave(offset(i)))).collect()
            });
            let mut sum = [0.0; 2];
            for &(z, of_z) in &z {
                for &(y, of_y) in &y {
                    let of_row = times(of_y, of_z);
                    for &(x, of_x) in &x {
                        let weight = (self.weight)(DVec3::new(x, y, z));
                        let [real, imaginary] = times(of_x, of_row);
                        sum = [sum[0] + weight * real, sum[1] + weight * imaginary];
                    }
                }
            }
            sum
        })
        .collect()
    }

    /// Returns the root mean square of the noise of the field over the noise of the samples, if it is white.
    #[must_use]
    pub fn noise(&self) -> f64 {
        /// Frequencies along an axis, and places between samples.
        const FREQUENCIES: u32 = 8;
        const PLACES: u32 = 4;
        let w = |i: u32| (f64::from(i) + 0.5) * PI / f64::from(FREQUENCIES);
        let sum: f64 = (0..FREQUENCIES.pow(3))
            .into_par_iter()
            .map(|index| {
                let frequency = [index % FREQUENCIES, index / FREQUENCIES % FREQUENCIES, index / FREQUENCIES.pow(2)];
                let frequency = frequency.map(w);
                let power = self.waves(frequency, PLACES).iter().map(|[a, b]| a * a + b * b).sum::<f64>();
                (self.gain)(frequency).powi(2) * power / f64::from(PLACES.pow(3))
            })
            .sum();
        (sum / f64::from(FREQUENCIES.pow(3))).sqrt()
    }
}
