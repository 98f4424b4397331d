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

    /// Sums the weights of samples times a wave (radians a voxel) at each of `places`^3 points between samples, x
    /// fastest. Returns real and imaginary parts.
    #[must_use]
    pub fn waves(&self, frequency: [f64; 3], places: u32) -> Vec<[f64; 2]> {
        let along =
            frequency.map(|frequency| (0..places).map(|i| self.along(frequency, i, places)).collect::<Vec<_>>());
        self.points(places)
            .map(|(at, weights)| sum(&weights, [0, 1, 2].map(|a| &along[a][at[a] as usize][..])))
            .collect()
    }

    /// Returns the offsets of samples along an axis from a place, one of `places` between samples.
    fn offsets(&self, place: u32, places: u32) -> impl Iterator<Item = f64> + Clone + use<> {
        let reach = i64::from(self.reach);
        (1 - reach..=reach).map(move |i| i as f64 - (f64::from(place) + 0.5) / f64::from(places))
    }

    /// Returns a wave along an axis at the samples around a place: real and imaginary parts.
    fn along(&self, frequency: f64, place: u32, places: u32) -> Vec<[f64; 2]> {
        self.offsets(place, places)
            .map(|offset| [libm::cos(offset * frequency), libm::sin(offset * frequency)])
            .collect()
    }

    /// Returns the places between samples, x fastest, with the weights of the samples around them.
    fn points(&self, places: u32) -> impl Iterator<Item = ([u32; 3], Vec<f64>)> {
        let all = (0..places).flat_map(move |k| (0..places).flat_map(move |j| (0..places).map(move |i| [i, j, k])));
        all.map(move |at| {
            let [x, y, z] = at.map(|place| self.offsets(place, places));
            let offsets = z.flat_map(|z| {
                let x = x.clone();
                y.clone().flat_map(move |y| x.clone().map(move |x| DVec3::new(x, y, z)))
            });
            (at, offsets.map(|offset| (self.weight)(offset)).collect())
        })
    }

    /// Returns the root mean square of the noise of the field over the noise of the samples, if it is white.
    #[must_use]
    pub fn noise(&self) -> f64 {
        /// The number of frequencies along an axis, and of places between samples.
        const FREQUENCIES: u32 = 8;
        const PLACES: u32 = 4;
        let w = |i: u32| (f64::from(i) + 0.5) * PI / f64::from(FREQUENCIES);
        // Weights depend on no frequency, and waves along an axis on the place along it alone.
        let points: Vec<_> = self.points(PLACES).collect();
        let along: Vec<Vec<_>> =
            (0..FREQUENCIES).map(|f| (0..PLACES).map(|place| self.along(w(f), place, PLACES)).collect()).collect();
        let power_at = |index: u32| {
            let number = [index % FREQUENCIES, index / FREQUENCIES % FREQUENCIES, index / FREQUENCIES.pow(2)];
            let waves = points.iter().map(|(at, weights)| {
                sum(weights, [0, 1, 2].map(|axis| &along[number[axis] as usize][at[axis] as usize][..]))
            });
            let power = waves.map(|[a, b]| a * a + b * b).sum::<f64>();
            (self.gain)(number.map(w)).powi(2) * power / f64::from(PLACES.pow(3))
        };
        let powers: Vec<f64> = (0..FREQUENCIES.pow(3)).into_par_iter().map(power_at).collect();
        (powers.iter().sum::<f64>() / f64::from(FREQUENCIES.pow(3))).sqrt()
    }
}

/// Sums weights, x fastest, times a wave, the product of waves along x, y and z.
fn sum(weights: &[f64], [x, y, z]: [&[[f64; 2]]; 3]) -> [f64; 2] {
    let times = |[a, b]: [f64; 2], [c, d]: [f64; 2]| [a * c - b * d, a * d + b * c];
    let plus = |[a, b]: [f64; 2], [c, d]: [f64; 2]| [a + c, b + d];
    let rows = z.iter().flat_map(|&of_z| y.iter().map(move |&of_y| times(of_y, of_z)));
    rows.zip(weights.chunks_exact(x.len())).fold([0.0; 2], |sum, (of_row, weights)| {
        let row = weights.iter().zip(x).fold([0.0; 2], |sum, (weight, [a, b])| plus(sum, [weight * a, weight * b]));
        plus(sum, times(row, of_row))
    })
}
