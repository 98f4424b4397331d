//! The error of a reconstruction on known signals, and its properties for any signal.

use std::f64::consts::PI;
use std::fmt;

use glam::DVec3;
use rayon::prelude::*;
use voxsplat::demos;
use voxsplat::error::{Error, Result};
use voxsplat::kernel::Kernel;
use voxsplat::reconstruction::Reconstruction;
use voxsplat::settings::{Settings, Shading};
use voxsplat::volume::{Grid, Samples, Volume};

/// A known signal over the cube from -1 to 1 along each axis.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Signal {
    /// The test signal of Marschner and Lobb (1994), whose finest waves are near the limit of a lattice of 40^3
    /// samples.
    MarschnerLobb,
    /// Five Gaussians of standard deviations 0.045 to 0.3.
    Gaussians,
    /// The 3-D Shepp-Logan head: ellipsoids with sharp edges.
    SheppLogan,
}

/// Peak, centre and standard deviation.
const GAUSSIANS: [(f64, [f64; 3], f64); 5] = [
    (0.5, [0.05, -0.1, 0.0], 0.3),
    (0.4, [-0.35, 0.3, 0.2], 0.12),
    (0.3, [0.4, 0.35, -0.3], 0.08),
    (0.3, [0.3, -0.4, 0.35], 0.06),
    (0.3, [-0.3, -0.35, -0.4], 0.045),
];

impl Signal {
    /// Its value at a point.
    fn value(self, p: DVec3) -> f64 {
        match self {
            Self::MarschnerLobb => demos::marschner_lobb_at(p),
            Self::SheppLogan => demos::shepp_logan_at(p),
            Self::Gaussians => GAUSSIANS
                .iter()
                .map(|&(peak, center, sigma)| {
                    peak * (-(p - DVec3::from_array(center)).length_squared() / (2.0 * sigma * sigma)).exp()
                })
                .sum(),
        }
    }

    /// Its mean between two points, by the midpoint rule.
    fn mean(self, from: DVec3, to: DVec3) -> f64 {
        // Waves are 0.1 long and more; at an edge the rule errs by half a step.
        let nodes = if matches!(self, Self::SheppLogan) { 20_000 } else { 2000 };
        let at = |i: u32| from + (to - from) * ((f64::from(i) + 0.5) / f64::from(nodes));
        (0..nodes).map(|i| self.value(at(i))).sum::<f64>() / f64::from(nodes)
    }
}

/// A method of reconstructing a field from samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Method {
    /// Linear interpolation along each axis.
    Trilinear,
    /// The interpolating cubic of Catmull and Rom along each axis.
    CatmullRom,
    /// The cubic B-spline along each axis, of samples filtered so that it passes through them (Unser 1999).
    BSpline,
    /// A sum of kernels, as in a picture with this kernel and this sharpness.
    Splats {
        /// The kernel of the settings.
        kernel: Kernel,
        /// The sharpness, 0 to 1.
        sharpness: f64,
        /// Whether samples are filtered, as in post-shading; pre-shading only narrows the kernel.
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
#[derive(Debug, Clone, Copy)]
pub(crate) struct Errors {
    /// Root mean square.
    pub(crate) rms: f64,
    /// The largest error.
    pub(crate) max: f64,
}

impl Errors {
    pub(crate) fn of(errors: &[f64]) -> Self {
        let squares: f64 = errors.iter().map(|e| e * e).sum();
        let max = errors.iter().fold(0.0, |max: f64, e| max.max(e.abs()));
        Self { rms: (squares / errors.len().max(1) as f64).sqrt(), max }
    }
}

/// The quality of a reconstruction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quality {
    /// Errors of the field, at points at least a voxel inside the outermost samples.
    pub(crate) field: Errors,
    /// Errors of the mean of the field along rays that cross that box.
    pub(crate) rays: Errors,
    /// The largest minus the least value of a field of samples that are all 1.
    pub(crate) ripple: f64,
    /// The variance of the blur along an axis, voxels^2: of kernel and filter together.
    pub(crate) blur: f64,
    /// The remaining share of a wave along an axis that is four samples long: half of Nyquist's frequency.
    pub(crate) half_nyquist: f64,
    /// Root mean square of the noise of the field over the white noise of the samples.
    pub(crate) noise: f64,
}

/// Voxels between the outermost samples and the compared part.
const INSET: f64 = 1.0;
/// The numbers of points at which fields are compared, and of rays along which they are integrated.
const POINTS: u32 = 30_000;
const RAYS: u32 = 300;
/// Integration points per voxel along a ray.
const STEPS_PER_VOXEL: f64 = 8.0;
/// The range of samples along each axis of a measurement.
const SIZES: std::ops::RangeInclusive<u32> = 8..=256;

impl Method {
    fn settings(self) -> Option<Settings> {
        let Self::Splats { kernel, sharpness, shading } = self else { return None };
        Some(Settings { kernel, sharpness, shading, ..Settings::default() })
    }

    pub(crate) fn reconstruction(self) -> Result<Reconstruction> {
        if let Some(settings) = self.settings() {
            return settings.reconstruction();
        }
        let along = |weight: fn(f64) -> f64| -> Box<dyn Fn(DVec3) -> f64 + Send + Sync> {
            Box::new(move |d| weight(d.x.abs()) * weight(d.y.abs()) * weight(d.z.abs()))
        };
        let (reach, weight) = match self {
            Self::CatmullRom => (
                2,
                along(|t| match t {
                    t if t < 1.0 => 1.0 + t * t * (1.5 * t - 2.5),
                    t if t < 2.0 => 2.0 + t * (-4.0 + t * (2.5 - 0.5 * t)),
                    _ => 0.0,
                }),
            ),
            Self::BSpline => (
                2,
                along(|t| match t {
                    t if t < 1.0 => 2.0 / 3.0 + t * t * (0.5 * t - 1.0),
                    t if t < 2.0 => (2.0 - t).powi(3) / 6.0,
                    _ => 0.0,
                }),
            ),
            _ => (1, along(|t| (1.0 - t).max(0.0))),
        };
        let filtered = matches!(self, Self::BSpline);
        let gain = move |frequency: [f64; 3]| {
            if filtered { frequency.iter().map(|w| 3.0 / (2.0 + w.cos())).product() } else { 1.0 }
        };
        Ok(Reconstruction { reach, weight, gain: Box::new(gain) })
    }

    /// The coefficients for samples.
    pub(crate) fn coefficients(self, volume: &Volume) -> Result<Vec<f64>> {
        let values = |volume: &Volume| -> Result<Vec<f64>> {
            let memory = volume.in_memory()?;
            Ok((0..memory.samples().len()).map(|index| memory.value(index)).collect())
        };
        if let Some(prefilter) = self.settings().map_or(Ok(None), |settings| settings.prefilter())? {
            return values(&prefilter.filtered(volume)?);
        }
        let mut coefficients = values(volume)?;
        if matches!(self, Self::BSpline) {
            let n = volume.grid().dims()[0] as usize;
            for stride in [1, n, n * n] {
                let starts = (0..n * n * n).filter(|index| (index / stride).is_multiple_of(n));
                starts.for_each(|start| spline_coefficients(&mut coefficients[start..], stride, n));
            }
        }
        Ok(coefficients)
    }
}

/// The field at a point of a lattice of n^3 samples; the outermost samples repeat beyond its faces.
pub(crate) fn field(reconstruction: &Reconstruction, coefficients: &[f64], n: i64, at: DVec3) -> f64 {
    let reach = i64::from(reconstruction.reach);
    let first = (at.floor().as_i64vec3() - (reach - 1)).to_array();
    let clamped = |place: i64| place.clamp(0, n - 1);
    let mut sum = 0.0;
    for k in first[2]..first[2] + 2 * reach {
        for j in first[1]..first[1] + 2 * reach {
            for i in first[0]..first[0] + 2 * reach {
                let weight = (reconstruction.weight)(DVec3::new(i as f64, j as f64, k as f64) - at);
                sum += weight * coefficients[((clamped(k) * n + clamped(j)) * n + clamped(i)) as usize];
            }
        }
    }
    sum
}

/// The remaining share of a wave, averaged over its phase.
fn transfer(reconstruction: &Reconstruction, frequency: [f64; 3]) -> f64 {
    let waves = reconstruction.waves(frequency, 16);
    (reconstruction.gain)(frequency) * waves.iter().map(|[real, _]| real).sum::<f64>() / waves.len() as f64
}

/// Filters `n` samples, `stride` apart, for the cubic B-spline: a recursion each way, samples mirrored at the ends
/// (Unser 1999, "Splines: a perfect fit for signal and image processing").
fn spline_coefficients(samples: &mut [f64], stride: usize, n: usize) {
    let pole = 3.0_f64.sqrt() - 2.0;
    let at = |i: usize| i * stride;
    // The sum over the mirrored row, as far as it matters.
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
pub(crate) fn spread(index: u32) -> [f64; 3] {
    const ROOT: f64 = 1.220_744_084_605_759_6;
    [1, 2, 3].map(|power| (0.5 + f64::from(index) / ROOT.powi(power)).fract())
}

/// Measures the reconstruction of a signal that is sampled at the centres of `size`^3 cells of its cube, as in built-in
/// volumes.
///
/// # Errors
/// [`Error::Setting`] if `size` is not 8 to 256, or the kernel or the sharpness of splats is refused.
pub(crate) fn measure(signal: Signal, size: u32, method: Method) -> Result<Quality> {
    if !SIZES.contains(&size) {
        let reason = format!("{size}, expected {} to {} samples along an axis", SIZES.start(), SIZES.end());
        return Err(Error::Setting { name: "size", reason });
    }
    let reconstruction = method.reconstruction()?;
    let signal_place = |at: DVec3| (at + 0.5) / f64::from(size) * 2.0 - 1.0;
    let sample = |index: u32| {
        let at = [index % size, index / size % size, index / size / size];
        signal.value(signal_place(DVec3::from_array(at.map(f64::from))))
    };
    let samples = Samples::F64((0..size.pow(3)).map(sample).collect());
    let volume = Volume::new(Grid::axis_parallel([size; 3], [1.0; 3])?, samples)?;
    let coefficients = method.coefficients(&volume)?;
    let n = i64::from(size);
    let span = f64::from(size - 1) - 2.0 * INSET;
    let inside = |place: [f64; 3]| DVec3::from_array(place) * span + INSET;
    let errors: Vec<f64> = (0..POINTS)
        .into_par_iter()
        .map(|index| {
            let at = inside(spread(index));
            field(&reconstruction, &coefficients, n, at) - signal.value(signal_place(at))
        })
        .collect();
    let rays: Vec<f64> = (0..RAYS)
        .into_par_iter()
        .map(|index| {
            // From a face of the box to the opposite face, for each axis in turn.
            let [[a, b, _], [c, d, _]] = [2 * index, 2 * index + 1].map(spread);
            let mut ends = [[a, b, 0.0], [c, d, 1.0]];
            ends.iter_mut().for_each(|end| end.rotate_right(index as usize % 3));
            let [from, to] = ends.map(inside);
            let steps = ((to - from).length() * STEPS_PER_VOXEL).ceil().max(1.0);
            let place = |i: u32| from + (to - from) * ((f64::from(i) + 0.5) / steps);
            let sum: f64 = (0..steps as u32).map(|i| field(&reconstruction, &coefficients, n, place(i))).sum();
            sum / steps - signal.mean(signal_place(from), signal_place(to))
        })
        .collect();
    let ones = reconstruction.waves([0.0; 3], 16);
    let ends = ones.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [v, _]| [low.min(*v), high.max(*v)]);
    let slow = 0.02;
    let [constant, wave] = [0.0, slow].map(|w| transfer(&reconstruction, [w, 0.0, 0.0]));
    Ok(Quality {
        field: Errors::of(&errors),
        rays: Errors::of(&rays),
        ripple: (ends[1] - ends[0]) * (reconstruction.gain)([0.0; 3]),
        blur: 2.0 * (1.0 - wave / constant) / (slow * slow),
        half_nyquist: transfer(&reconstruction, [PI / 2.0, 0.0, 0.0]),
        noise: reconstruction.noise(),
    })
}
