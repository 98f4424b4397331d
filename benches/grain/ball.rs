//! The grain of a lit ball in a noisy scan: the difference of its picture from the shading of the true normals.

use std::f64::consts::TAU;

use voxsplat::camera::View;
use voxsplat::error::Result;
use voxsplat::image::Image;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::settings::Settings;
use voxsplat::transfer::{ControlPoint, TransferFunction};
use voxsplat::volume::Volume;
use voxsplat::{Camera, Frame, Renderer};

/// World length of the radius of the ball.
const RADIUS: f64 = 40.0;
/// World length of the picture's height.
const HEIGHT: f64 = 90.0;
/// The share of the radius within which pixels are compared: the rim is blurred.
const COMPARED: f64 = 0.9;
/// The sample within the ball.
const INSIDE: f64 = 1000.0;

/// A scan of a ball.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ball {
    /// Voxels along the radius, along x and y.
    pub(crate) voxels: u32,
    /// The distance of slices, in voxels of x and y: over 1, the ball is an ellipsoid of the lattice.
    pub(crate) slices: f64,
    /// The sample within the ball over the standard deviation of the noise; `None`: no noise.
    pub(crate) signal_to_noise: Option<f64>,
}

/// Differences of the shading from the shading of the true normals, of 255: root mean squares.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grain {
    /// All differences.
    pub(crate) all: f64,
    /// Without their mean over the square of 8 voxels around each pixel.
    pub(crate) fine: f64,
}

/// A number in 0..1 without order (splitmix64).
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

impl Ball {
    /// Its samples: an edge as wide as a scanner blurs it, and the magnitude of a complex signal with noise, as in MRI.
    fn volume(self) -> Result<Volume> {
        let spacing = RADIUS / f64::from(self.voxels);
        let spacing = [spacing, spacing, spacing * self.slices];
        let dims = spacing.map(|step| (2.4 * RADIUS / step).ceil() as u32);
        let noise = self.signal_to_noise.map_or(0.0, |ratio| INSIDE / ratio);
        let mut state = 1;
        let mut samples = Vec::new();
        for index in 0..dims.iter().product() {
            let place = [index % dims[0], index / dims[0] % dims[1], index / (dims[0] * dims[1])];
            let square = (0..3).map(|a| ((f64::from(place[a]) - f64::from(dims[a] - 1) / 2.0) * spacing[a]).powi(2));
            let distance = square.sum::<f64>().sqrt() - RADIUS;
            // A logistic edge with a standard deviation of 0.7 voxels, the mean over the axes.
            let width = 0.39 * (spacing[0] * spacing[1] * spacing[2]).cbrt();
            let signal = INSIDE / (1.0 + (distance / width).exp());
            let radius = noise * (-2.0 * (1.0 - random(&mut state)).ln()).sqrt();
            let angle = TAU * random(&mut state);
            samples.push((signal + radius * angle.cos()).hypot(radius * angle.sin()).round() as u16);
        }
        Ok(Volume::from_slice(dims, spacing, &samples)?)
    }

    /// Returns the grain of its picture of `size` pixels a side with these settings, in the light of a headlight.
    ///
    /// # Errors
    /// The errors of [`Renderer::render`].
    pub(crate) fn grain(self, renderer: &Renderer, settings: &Settings, size: u32) -> Result<Grain> {
        let volume = self.volume()?;
        let point = |value, opacity| ControlPoint { value: value * INSIDE, color: [1.0; 3], opacity };
        let unit = RADIUS / f64::from(self.voxels);
        let transfer = TransferFunction::new(vec![point(0.3, 0.0), point(0.7, 0.5), point(1.0, 0.8)], Some(unit))?;
        let lights = vec![Light::HEADLIGHT];
        let lighting =
            Lighting { ambient: 0.2, diffuse: 0.6, specular: 0.2, shininess: 20.0, lights, ..Lighting::default() };
        let settings = Settings { lighting: Some(lighting), ..settings.clone() };
        let view = View { azimuth: 25.0, elevation: 35.0, view_height: Some(HEIGHT), ..View::default() };
        let camera = Camera::new(&view, volume.grid(), [size; 2])?;
        let scene = renderer.prepare(&volume, &transfer, &settings)?;
        let image = renderer.render(&scene, &Frame::new(&camera, &settings))?.image;
        Ok(grain(&image, 4.0 * RADIUS / f64::from(self.voxels)))
    }
}

/// The grain of a picture; `around` is half the side of the square of a mean, a world length.
fn grain(image: &Image, around: f64) -> Grain {
    let size = image.width() as usize;
    let pixel = HEIGHT / size as f64;
    let place = |i: usize| (i as f64 - (size - 1) as f64 / 2.0) * pixel;
    let difference = |index: usize| {
        let r = place(index % size).hypot(place(index / size)) / RADIUS;
        let cosine = (1.0 - r * r).max(0.0).sqrt();
        let shading = f64::from(image.pixels()[index][1]) - (0.2 + 0.6 * cosine + 0.2 * cosine.powi(20));
        (r < COMPARED).then_some(255.0 * shading)
    };
    let differences: Vec<Option<f64>> = (0..size * size).map(difference).collect();
    let around = (around / pixel).round() as usize;
    let near = |at: usize| at.saturating_sub(around)..(at + around + 1).min(size);
    let fine = |index: usize| {
        let square = near(index / size).flat_map(|y| near(index % size).map(move |x| y * size + x));
        let (count, sum) =
            square.filter_map(|near| differences[near]).fold((0.0, 0.0), |(count, sum), d| (count + 1.0, sum + d));
        Some(differences[index]? - sum / count)
    };
    let rms = |values: &mut dyn Iterator<Item = f64>| {
        let (count, sum) = values.fold((0.0, 0.0), |(count, sum), d| (count + 1.0, sum + d * d));
        (sum / f64::max(count, 1.0)).sqrt()
    };
    Grain { all: rms(&mut differences.iter().flatten().copied()), fine: rms(&mut (0..size * size).filter_map(fine)) }
}
