//! The error of a picture from a sample of its pixels.

use std::collections::HashMap;

use serde::Serialize;

use super::Sample;
use crate::camera::Camera;
use crate::error::Result;
use crate::image::{Image, covered_differences, percentile};
use crate::layers::Layers;
use crate::reference::Reference;
use crate::settings::Settings;

/// The fraction of covered pixels whose errors the error of a picture bounds.
const FRACTION: f64 = 0.999;
/// The fraction of errors below the tail.
const TAIL: f64 = 0.95;
/// The largest ratio of traced to requested pixels, if few pixels are covered.
const MOST_DENSER: f64 = 16.0;
/// Standard deviations from the middle to either end of an interval of 95 % confidence.
const TWO_SIDED: f64 = 1.96;

/// The true colours of a sample of a picture's pixels.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Truth {
    sample: Sample,
    pixels: Image,
    /// The work of tracing the whole picture, in chords; see [`Self::work`].
    work: f64,
}

/// The error of a picture, estimated from a sample of its pixels. Channels run from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Estimate {
    /// Number of sampled pixels that the picture or the truth covers.
    pub pixels: u64,
    /// The estimated 99.9th percentile of the errors of covered pixels.
    pub error: f64,
    /// An interval that contains `error` with a confidence of 95 %, if the largest twentieth of the errors has an
    /// exponential distribution.
    pub interval: [f64; 2],
    /// Root mean square over sampled pixels of the largest difference of their channels.
    pub rms: f64,
    /// The largest error of the sample.
    pub max: f64,
}

impl Truth {
    /// Traces evenly spread pixels of a camera's picture by the f64 reference, so many that about `pixels` of them are
    /// covered: at most 16 times `pixels`, and at most the whole picture.
    ///
    /// # Errors
    /// The errors of [`Reference::of_layers`] and [`Reference::pixels`].
    pub fn trace(layers: &Layers, camera: &Camera, settings: &Settings, pixels: u32) -> Result<Self> {
        Tracer::new(layers, camera, settings)?.truth(pixels)
    }

    /// Returns the work of tracing the whole picture, in chords that rays cut out of kernels.
    pub(super) fn work(&self) -> f64 {
        self.work
    }

    /// Returns the whole picture, if all of its pixels are traced.
    pub(super) fn whole(&self) -> Option<&Image> {
        self.sample.is_whole().then_some(&self.pixels)
    }

    /// Estimates the error of a picture.
    ///
    /// # Errors
    /// [`Error::Image`](crate::error::Error::Image) if the picture has another size than the camera's.
    pub fn estimate(&self, picture: &Image) -> Result<Estimate> {
        Ok(Estimate::of(covered_differences(&self.sample.of(picture)?, &self.pixels)?))
    }
}

/// A tracer of the pixels of a camera's picture, each once.
pub(super) struct Tracer {
    reference: Reference,
    camera: Camera,
    /// Colours of the pixels traced so far, by column and row.
    traced: HashMap<[u32; 2], [f32; 4]>,
}

impl Tracer {
    pub(super) fn new(layers: &Layers, camera: &Camera, settings: &Settings) -> Result<Self> {
        let reference = Reference::of_layers(layers, settings)?.with_tolerance(Reference::TOLERANCE);
        Ok(Self { reference, camera: *camera, traced: HashMap::new() })
    }

    /// Traces as [`Truth::trace`] does, but skips pixels that an earlier call traced.
    pub(super) fn truth(&mut self, pixels: u32) -> Result<Truth> {
        let truth = self.sample(pixels)?;
        let covered = truth.pixels.pixels().iter().filter(|pixel| pixel[3] > 0.0).count() as u32;
        let denser = f64::from(pixels) / f64::from(covered.max(1));
        if denser < 1.5 || truth.sample.is_whole() {
            return Ok(truth);
        }
        self.sample((f64::from(pixels) * denser.min(MOST_DENSER)) as u32)
    }

    fn sample(&mut self, count: u32) -> Result<Truth> {
        let sample = Sample::new(self.camera.size, count);
        let places = sample.pixels();
        let new: Vec<[u32; 2]> = places.iter().copied().filter(|place| !self.traced.contains_key(place)).collect();
        if !new.is_empty() {
            let colors = self.reference.pixels(&self.camera, &new)?;
            self.traced.extend(new.into_iter().zip(colors.into_iter().map(|color| color.map(|v| v as f32))));
        }
        let [width, height] = sample.grid();
        let pixels = Image::new(width, height, places.iter().map(|place| self.traced[place]).collect())?;
        Ok(Truth { sample, pixels, work: self.reference.work(&self.camera) })
    }
}

impl Estimate {
    /// Makes the estimate from the errors of sampled pixels.
    ///
    /// The 99.9th percentile of a thousand numbers depends on one of them. The method of peaks over a threshold uses
    /// more (Pickands 1975, "Statistical inference using extreme order statistics", with an exponential tail): beyond
    /// the 95th percentile u, errors exceed u by s on average, so the percentile is u + s ln(p / 0.001) with p the
    /// fraction of errors over u. If the sample's own percentile is larger, it counts instead. Channels from 0 to 1
    /// differ by 1 at most.
    fn of(mut errors: Vec<f64>) -> Self {
        let count = errors.len();
        // `sum` of no numbers is -0.
        let squares = errors.iter().map(|e| e * e).fold(0.0, |sum: f64, square| sum + square);
        let max = errors.iter().copied().fold(0.0, f64::max);
        let rms = (squares / count.max(1) as f64).sqrt();
        let threshold = percentile(&mut errors, TAIL);
        let beyond: Vec<f64> = errors.iter().filter(|&&e| e > threshold).map(|e| e - threshold).collect();
        let excesses = beyond.len().max(1) as f64;
        let mean = beyond.iter().sum::<f64>() / excesses;
        let steps = libm::log(excesses / count.max(1) as f64 / (1.0 - FRACTION)).max(0.0);
        let tail = (threshold + mean * steps).min(max.max(1.0));
        let sampled = if count >= 1000 { percentile(&mut errors, FRACTION) } else { 0.0 };
        let error = if max.is_finite() { tail.max(sampled) } else { max };
        // The mean of k exponential numbers has a relative standard deviation of 1 / sqrt(k).
        let half = TWO_SIDED * mean * steps / excesses.sqrt();
        Self { pixels: count as u64, error, interval: [(error - half).max(0.0), error + half], rms, max }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::View;
    use crate::transfer::{ControlPoint, TransferFunction};
    use crate::volume::Volume;

    #[test]
    fn a_pixel_is_traced_once() {
        let samples: Vec<f32> = (0..64).map(|i| i as f32).collect();
        let volume = Volume::from_slice([4; 3], [1.0; 3], &samples).unwrap();
        let point = |value: f64| ControlPoint { value, color: [1.0; 3], opacity: value / 64.0 };
        let transfer = TransferFunction::new([0.0, 32.0].map(point).to_vec(), None).unwrap();
        let layers = Layers::of_volume(&volume, &transfer);
        let camera = Camera::new(&View::default(), volume.grid(), [8, 6]).unwrap();
        let settings = Settings::default();
        let mut tracer = Tracer::new(&layers, &camera, &settings).unwrap();
        let few = tracer.truth(12).unwrap();
        // A pixel that is traced again would lose its mark.
        let mark = [9.0; 4];
        tracer.traced.values_mut().for_each(|color| *color = mark);
        let marked = tracer.traced.len();
        let whole = tracer.truth(u32::MAX).unwrap();
        let pixels = whole.whole().unwrap().pixels();
        assert_eq!(pixels.iter().filter(|color| **color == mark).count(), marked);
        assert!(marked >= few.pixels.pixels().len() && marked < pixels.len());
        let direct = Truth::trace(&layers, &camera, &settings, u32::MAX).unwrap();
        let same = pixels.iter().zip(direct.pixels.pixels()).filter(|(a, b)| a == b).count();
        assert_eq!(same, pixels.len() - marked);
    }

    #[test]
    fn an_exponential_tail_is_found() {
        // The quantiles of an exponential distribution of mean 1e-3; its 99.9th percentile is ln(1000) of that.
        let of =
            |n: u32| (0..n).map(|i| -1e-3 * (1.0 - (f64::from(i) + 0.5) / f64::from(n)).ln()).collect::<Vec<f64>>();
        for n in [400, 2000, 20_000] {
            let estimate = Estimate::of(of(n));
            let exact = 1e-3 * 1000_f64.ln();
            assert!((estimate.error / exact - 1.0).abs() < 0.06, "{n}: {estimate:?}");
            assert!(estimate.interval[0] < exact && exact < estimate.interval[1], "{n}: {estimate:?}");
            assert!((estimate.rms / 1e-3 / 2_f64.sqrt() - 1.0).abs() < 0.02, "{n}: {estimate:?}");
        }
        let width = |n| Estimate::of(of(n)).interval.into_iter().rev().reduce(|high, low| high - low).unwrap();
        assert!((width(400) / width(40_000) - 10.0).abs() < 1.0);
    }

    #[test]
    fn little_and_nothing_are_estimates_too() {
        let none = Estimate::of(Vec::new());
        assert_eq!((none.pixels, none.error, none.interval), (0, 0.0, [0.0; 2]));
        assert!(none.rms.is_sign_positive());
        let one = Estimate::of(vec![0.25]);
        assert_eq!((one.error, one.max), (0.25, 0.25));
        assert!(Estimate::of(vec![0.0, f64::INFINITY]).error.is_infinite());
        // One pixel in 500 is off by a half, which an exponential tail would not tell.
        let mut errors = vec![0.0; 2000];
        errors[..4].fill(0.5);
        assert_eq!(Estimate::of(errors).error, 0.5);
    }
}
