//! The error of a reconstruction, and what it does to any signal.

use std::f64::consts::PI;
use std::fmt;

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use super::{Prefilter, Signal};
use crate::demos;
use crate::error::{Error, Result};
use crate::kernel::Kernel;
use crate::progress::Progress;
use crate::settings::{Settings, Shading};
use crate::volume::{Grid, Samples, Volume};

/// A way to turn samples back into a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// Linear interpolation along each axis.
    Trilinear,
    /// The interpolating cubic of Catmull and Rom along each axis.
    CatmullRom,
    /// The cubic B-spline along each axis, of samples filtered so that it passes through them (Unser 1999).
    BSpline,
    /// A sum of kernels, as settings with this kernel and this sharpness have it.
    Splats {
        /// The kernel as asked for.
        kernel: Kernel,
        /// The sharpness, 0 to 1.
        sharpness: f64,
        /// Post-shading filters samples; pre-shading has the narrower kernel alone.
        shading: Shading,
    },
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = match self {
            Self::Trilinear => "trilinear".to_owned(),
            Self::CatmullRom => "Catmull-Rom".to_owned(),
            Self::BSpline => "cubic B-spline, prefiltered".to_owned(),
            Self::Splats { kernel, sharpness, .. } if *sharpness == 0.0 => kernel.to_string(),
            Self::Splats { kernel, sharpness, shading } => format!("{kernel}, sharpness {sharpness}, {shading}-shaded"),
        };
        f.pad(&text)
    }
}

/// Errors of a reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Errors {
    /// Root mean square.
    pub rms: f64,
    /// The largest.
    pub max: f64,
}

impl Errors {
    fn of(errors: &[f64]) -> Self {
        let squares: f64 = errors.iter().map(|e| e * e).sum();
        let max = errors.iter().fold(0.0, |max: f64, e| max.max(e.abs()));
        Self { rms: (squares / errors.len().max(1) as f64).sqrt(), max }
    }
}

/// How good a reconstruction is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Quality {
    /// The method, in words.
    pub method: String,
    /// Of the field, at points at least a voxel inside the outermost samples.
    pub field: Errors,
    /// Of the mean of the field along rays that cross that box.
    pub rays: Errors,
    /// The largest less the least value of a field of samples that are all 1.
    pub ripple: f64,
    /// The variance of the blur along an axis, voxels^2: of kernel and filter together.
    pub blur: f64,
    /// What is left of a wave along an axis that is four samples long: half of Nyquist's frequency.
    pub half_nyquist: f64,
    /// Root mean square of the noise of the field over that of the samples, if theirs is white.
    pub noise: f64,
}

/// Voxels between the outermost samples and what is compared.
const INSET: f64 = 1.0;
/// Points at which fields are compared, and rays along which they are integrated.
const POINTS: u32 = 30_000;
const RAYS: u32 = 300;
/// Places in a voxel at which the field is added up along a ray.
const STEPS_PER_VOXEL: f64 = 8.0;
/// The samples along each axis that a measurement may have.
const SIZES: std::ops::RangeInclusive<u32> = 8..=256;

/// A method made ready.
struct Reconstruction {
    method: Method,
    /// Of splats the kernel that reconstructs, its integral, and its filter.
    kernel: Kernel,
    integral: f64,
    prefilter: Option<Prefilter>,
}

impl Reconstruction {
    fn new(method: Method) -> Result<Self> {
        let Method::Splats { kernel, sharpness, shading } = method else {
            return Ok(Self { method, kernel: Kernel::default(), integral: 1.0, prefilter: None });
        };
        let settings = Settings { kernel, sharpness, shading, ..Settings::default() };
        settings.validate()?;
        let kernel = settings.reconstruction_kernel();
        Ok(Self { method, kernel, integral: kernel.integral(), prefilter: settings.prefilter()? })
    }

    /// Samples to either side of a point that count.
    fn reach(&self) -> i64 {
        match self.method {
            Method::Trilinear => 1,
            Method::CatmullRom | Method::BSpline => 2,
            Method::Splats { .. } => self.kernel.radius().ceil() as i64,
        }
    }

    /// The weight of a sample so far from a point, voxels.
    fn weight(&self, d: DVec3) -> f64 {
        let along = |weight: fn(f64) -> f64| weight(d.x.abs()) * weight(d.y.abs()) * weight(d.z.abs());
        match self.method {
            Method::Trilinear => along(|t| (1.0 - t).max(0.0)),
            Method::CatmullRom => along(|t| match t {
                t if t < 1.0 => 1.0 + t * t * (1.5 * t - 2.5),
                t if t < 2.0 => 2.0 + t * (-4.0 + t * (2.5 - 0.5 * t)),
                _ => 0.0,
            }),
            Method::BSpline => along(|t| match t {
                t if t < 1.0 => 2.0 / 3.0 + t * t * (0.5 * t - 1.0),
                t if t < 2.0 => (2.0 - t).powi(3) / 6.0,
                _ => 0.0,
            }),
            Method::Splats { .. } => self.kernel.value(d.length_squared()) / self.integral,
        }
    }

    /// What the filter of the samples makes of a frequency, radians a voxel.
    fn gain(&self, frequency: [f64; 3]) -> f64 {
        match &self.prefilter {
            Some(prefilter) => prefilter.gain(frequency),
            None if self.method == Method::BSpline => frequency.iter().map(|w| 3.0 / (2.0 + w.cos())).product(),
            None => 1.0,
        }
    }

    /// The coefficients of samples.
    fn coefficients(&self, volume: &Volume) -> Result<Vec<f64>> {
        let values = |volume: &Volume| -> Result<Vec<f64>> {
            let memory = volume.in_memory()?;
            Ok((0..memory.samples().len()).map(|index| memory.value(index)).collect())
        };
        if let Some(prefilter) = &self.prefilter {
            return values(&prefilter.apply::<f64>(volume, 0.0, &Progress::default())?);
        }
        let mut coefficients = values(volume)?;
        if self.method == Method::BSpline {
            let n = volume.grid().dims()[0] as usize;
            for stride in [1, n, n * n] {
                let starts = (0..n * n * n).filter(|index| (index / stride).is_multiple_of(n));
                starts.for_each(|start| spline_coefficients(&mut coefficients[start..], stride, n));
            }
        }
        Ok(coefficients)
    }

    /// The field at a point of a lattice of n^3 samples, whose outermost repeat beyond its faces.
    fn field(&self, coefficients: &[f64], n: i64, at: DVec3) -> f64 {
        let first = (at.floor().as_i64vec3() - (self.reach() - 1)).to_array();
        let clamped = |place: i64| place.clamp(0, n - 1);
        let mut sum = 0.0;
        for k in first[2]..first[2] + 2 * self.reach() {
            for j in first[1]..first[1] + 2 * self.reach() {
                for i in first[0]..first[0] + 2 * self.reach() {
                    let weight = self.weight(at - DVec3::new(i as f64, j as f64, k as f64));
                    sum += weight * coefficients[((clamped(k) * n + clamped(j)) * n + clamped(i)) as usize];
                }
            }
        }
        sum
    }

    /// For each of some places of a point between samples: the real and the imaginary part of the sum of weights times
    /// a wave.
    fn waves(&self, frequency: [f64; 3], places: u32) -> Vec<[f64; 2]> {
        let place = |i: u32| (f64::from(i) + 0.5) / f64::from(places);
        let all = (0..places).flat_map(|k| (0..places).flat_map(move |j| (0..places).map(move |i| [i, j, k])));
        let reach = self.reach();
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
                        let weight = self.weight(DVec3::new(x, y, z));
                        let [real, imaginary] = times(of_x, of_row);
                        sum = [sum[0] + weight * real, sum[1] + weight * imaginary];
                    }
                }
            }
            sum
        })
        .collect()
    }

    /// What is left of a wave, on average over where it lies.
    fn transfer(&self, frequency: [f64; 3]) -> f64 {
        let waves = self.waves(frequency, 16);
        self.gain(frequency) * waves.iter().map(|[real, _]| real).sum::<f64>() / waves.len() as f64
    }

    /// The noise of the field over that of the samples.
    fn noise(&self) -> f64 {
        self.spectrum(|_| 1.0)
    }

    /// The noise that is left of central differences of the samples along an axis when they are reconstructed, over
    /// that of the differences.
    fn noise_of_slopes(&self) -> f64 {
        // The mean of the weights is 1.
        self.spectrum(|[x, ..]| 2.0 * x.sin().powi(2))
    }

    /// The root mean square of the field of white noise over that of the noise, its power weighted by frequency.
    fn spectrum(&self, weight: impl Fn([f64; 3]) -> f64 + Sync) -> f64 {
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
                weight(frequency) * self.gain(frequency).powi(2) * power / f64::from(PLACES.pow(3))
            })
            .sum();
        (sum / f64::from(FREQUENCIES.pow(3))).sqrt()
    }
}

/// The noise of a field that is reconstructed by some settings over that of its samples, which is white.
pub(crate) fn noise(settings: &Settings) -> Result<f64> {
    Ok(reconstruction(settings)?.noise())
}

/// The noise of the gradients that light is made of by some settings, over that of central differences of the samples,
/// whose noise is white: pre-shaded they are what light is made of.
pub(crate) fn noise_of_gradients(settings: &Settings) -> Result<f64> {
    if settings.is_post_shaded() { Ok(reconstruction(settings)?.noise_of_slopes()) } else { Ok(1.0) }
}

fn reconstruction(settings: &Settings) -> Result<Reconstruction> {
    let shading = if settings.is_post_shaded() { Shading::Post } else { Shading::Pre };
    Reconstruction::new(Method::Splats { kernel: settings.kernel, sharpness: settings.sharpness, shading })
}

/// Filters `n` samples, `stride` apart, for the cubic B-spline: a recursion each way, samples mirrored at the ends
/// (Unser 1999, "Splines: a perfect fit for signal and image processing").
fn spline_coefficients(samples: &mut [f64], stride: usize, n: usize) {
    let pole = 3.0_f64.sqrt() - 2.0;
    let at = |i: usize| i * stride;
    // The sum over the mirrored row, as far as it counts.
    let mirrored = |i: usize| if (i / (n - 1)).is_multiple_of(2) { i % (n - 1) } else { n - 1 - i % (n - 1) };
    let first: f64 = (0..40).map(|i| samples[at(mirrored(i))] * pole.powi(i as i32)).sum();
    samples[0] = 6.0 * first;
    for i in 1..n {
        samples[at(i)] = 6.0 * samples[at(i)] + pole * samples[at(i - 1)];
    }
    let (last, before) = (samples[at(n - 1)], samples[at(n - 2)]);
    samples[at(n - 1)] = pole / (pole * pole - 1.0) * (last + pole * before);
    for i in (0..n - 1).rev() {
        samples[at(i)] = pole * (samples[at(i + 1)] - samples[at(i)]);
    }
}

/// Point `index` of a sequence that fills the unit cube evenly (Roberts 2018, "The unreasonable effectiveness of
/// quasirandom sequences").
fn spread(index: u32) -> [f64; 3] {
    const ROOT: f64 = 1.220_744_084_605_759_6;
    [1, 2, 3].map(|power| (0.5 + f64::from(index) / ROOT.powi(power)).fract())
}

/// Measures how well a method reconstructs a signal that is sampled at the centres of `size`^3 cells of its cube, as
/// built-in volumes are.
///
/// # Errors
/// [`Error::Setting`] if `size` is not 8 to 256, or the kernel or the sharpness of splats is refused.
pub fn measure(signal: Signal, size: u32, method: Method) -> Result<Quality> {
    if !SIZES.contains(&size) {
        let reason = format!("{size}, expected {} to {} samples along an axis", SIZES.start(), SIZES.end());
        return Err(Error::Setting { name: "size", reason });
    }
    let reconstruction = Reconstruction::new(method)?;
    let samples = Samples::F64(demos::sampled(size, |p| signal.value(p)));
    let volume = Volume::new(Grid::axis_parallel([size; 3], [1.0; 3])?, samples)?;
    let coefficients = reconstruction.coefficients(&volume)?;
    let n = i64::from(size);
    let span = f64::from(size - 1) - 2.0 * INSET;
    let inside = |place: [f64; 3]| DVec3::from_array(place) * span + INSET;
    let signal_place = |at: DVec3| (at + 0.5) / f64::from(size) * 2.0 - 1.0;
    let field: Vec<f64> = (0..POINTS)
        .into_par_iter()
        .map(|index| {
            let at = inside(spread(index));
            reconstruction.field(&coefficients, n, at) - signal.value(signal_place(at))
        })
        .collect();
    let rays: Vec<f64> = (0..RAYS)
        .into_par_iter()
        .map(|index| {
            // From a face of the box to the opposite one, of each axis in turn.
            let [[a, b, _], [c, d, _]] = [2 * index, 2 * index + 1].map(spread);
            let mut ends = [[a, b, 0.0], [c, d, 1.0]];
            ends.iter_mut().for_each(|end| end.rotate_right(index as usize % 3));
            let [from, to] = ends.map(inside);
            let steps = ((to - from).length() * STEPS_PER_VOXEL).ceil().max(1.0);
            let place = |i: u32| from + (to - from) * ((f64::from(i) + 0.5) / steps);
            let sum: f64 = (0..steps as u32).map(|i| reconstruction.field(&coefficients, n, place(i))).sum();
            let [from, to] = [from, to].map(signal_place);
            let length = (to - from).length();
            sum / steps - signal.integral(from, (to - from) / length, length) / length
        })
        .collect();
    let ones = reconstruction.waves([0.0; 3], 16);
    let ends = ones.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [v, _]| [low.min(*v), high.max(*v)]);
    let slow = 0.02;
    let [constant, wave] = [0.0, slow].map(|w| reconstruction.transfer([w, 0.0, 0.0]));
    Ok(Quality {
        method: method.to_string(),
        field: Errors::of(&field),
        rays: Errors::of(&rays),
        ripple: (ends[1] - ends[0]) * reconstruction.gain([0.0; 3]),
        blur: 2.0 * (1.0 - wave / constant) / (slow * slow),
        half_nyquist: reconstruction.transfer([PI / 2.0, 0.0, 0.0]),
        noise: reconstruction.noise(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn splats(kernel: Kernel, sharpness: f64) -> Method {
        Method::Splats { kernel, sharpness, shading: Shading::Post }
    }

    #[test]
    fn a_sharp_blob_beats_linear_interpolation_of_marschner_lobb() {
        let of = |method| measure(Signal::MarschnerLobb, 40, method).unwrap();
        let [linear, cubic, spline] = [Method::Trilinear, Method::CatmullRom, Method::BSpline].map(of);
        let [blurred, sharp] = [0.0, 1.0].map(|sharpness| of(splats(Kernel::KAISER_BESSEL, sharpness)));
        // Published for linear interpolation: 0.033.
        assert!((linear.field.rms - 0.0335).abs() < 5e-4, "{linear:?}");
        assert!(spline.field.rms < cubic.field.rms && cubic.field.rms < linear.field.rms);
        assert!(blurred.field.rms > 0.04 && sharp.field.rms < 0.021, "{blurred:?} {sharp:?}");
        assert!(sharp.rays.rms < 0.6 * linear.rays.rms, "{sharp:?}");
        assert!((blurred.noise - 0.395).abs() < 0.005 && (sharp.noise - 0.792).abs() < 0.01, "{blurred:?} {sharp:?}");
        assert!(sharp.blur.abs() < 0.03 && (blurred.blur - Kernel::KAISER_BESSEL.variance()).abs() < 1e-3);
        assert!((blurred.ripple - 5.4e-4).abs() < 5e-5, "{blurred:?}");
    }

    #[test]
    fn figures_of_linear_interpolation_are_those_of_theory() {
        let Quality { ripple, blur, half_nyquist, noise, .. } =
            measure(Signal::Gaussians, 16, Method::Trilinear).unwrap();
        assert!(ripple < 1e-12 && (blur - 1.0 / 6.0).abs() < 1e-3, "{ripple} {blur}");
        // sinc^2(1/4), and the mean over a voxel of the sums of squared weights, (2/3)^3.
        assert!((half_nyquist - 0.8106).abs() < 1e-3, "{half_nyquist}");
        assert!((noise - (2.0_f64 / 3.0).powf(1.5)).abs() < 0.02, "{noise}");
    }

    #[test]
    fn white_noise_grows_as_stated() {
        let size = 24;
        let mut state = 1_u64;
        let samples: Vec<f64> = (0..size * size * size)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
            })
            .collect();
        let volume = Volume::from_slice([size; 3], [1.0; 3], &samples).unwrap();
        let kernels = [Kernel::default(), Kernel::KAISER_BESSEL];
        for method in kernels.into_iter().flat_map(|kernel| [0.0, 0.5, 1.0].map(|sharpness| splats(kernel, sharpness)))
        {
            let reconstruction = Reconstruction::new(method).unwrap();
            let coefficients = reconstruction.coefficients(&volume).unwrap();
            let field: Vec<f64> = (0..20_000)
                .map(|index| {
                    let at = DVec3::from_array(spread(index)) * 15.0 + 4.0;
                    reconstruction.field(&coefficients, i64::from(size), at)
                })
                .collect();
            // Uniform over a range of 1: a variance of 1/12.
            let measured = Errors::of(&field).rms * 12.0_f64.sqrt();
            let stated = reconstruction.noise();
            assert!((measured / stated - 1.0).abs() < 0.05, "{method}: {measured} {stated}");
            // Central differences of a field are those of its samples, reconstructed.
            let slopes: Vec<f64> = (0..20_000)
                .map(|index| {
                    let at = DVec3::from_array(spread(index)) * 15.0 + 4.0;
                    let [low, high] =
                        [-1.0, 1.0].map(|x| reconstruction.field(&coefficients, i64::from(size), at + DVec3::X * x));
                    (high - low) / 2.0
                })
                .collect();
            let measured = Errors::of(&slopes).rms * 24.0_f64.sqrt();
            let stated = reconstruction.noise_of_slopes();
            assert!((measured / stated - 1.0).abs() < 0.05, "{method}: slopes {measured} {stated}");
        }
    }

    #[test]
    fn integrals_of_ellipsoids_are_exact() {
        let direction = DVec3::new(0.3, -0.5, 0.8).normalize();
        let origin = DVec3::new(-0.2, 0.5, -0.9);
        let nodes = 400_000;
        let step = 1.9 / f64::from(nodes);
        let sum: f64 = (0..nodes)
            .map(|i| Signal::SheppLogan.value(origin + direction * ((f64::from(i) + 0.5) * step)) * step)
            .sum();
        assert!((Signal::SheppLogan.integral(origin, direction, 1.9) - sum).abs() < 1e-5);
    }

    #[test]
    fn what_cannot_be_measured_is_refused() {
        let error = measure(Signal::Gaussians, 4, Method::Trilinear).unwrap_err().to_string();
        assert!(error.starts_with("size: 4, expected 8 to 256"), "{error}");
        assert!(measure(Signal::Gaussians, 16, splats(Kernel::default(), 1.5)).is_err());
    }
}
