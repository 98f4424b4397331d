//! Band-limited classification: smooth surfaces have no rings, thin matter keeps its brightness, and the engines agree.

use glam::DVec3;
use voxsplat::Frame;
use voxsplat::camera::{Camera, View};
use voxsplat::demos::demo_transfer;
use voxsplat::engine::Engine;
use voxsplat::image::Image;
use voxsplat::layers::Layers;
use voxsplat::renderer::RendererOptions;
use voxsplat::settings::{Level, Painter, Settings};
use voxsplat::transfer::presets::{PresetValues, preset};
use voxsplat::transfer::{Classification, TransferFunction};
use voxsplat::volume::{Statistics, Volume};

use crate::support::{exact_quads, headlight, look, render, rms_of_all, with_tiles};
use crate::truth::truth;

/// The radius of balls, in voxels.
const RADIUS: f64 = 40.0;
/// Pixels along an edge of their pictures, half a voxel apart.
const PIXELS: u32 = 172;

/// The error function (Abramowitz and Stegun, 7.1.26), within 1.5e-7.
fn erf(x: f64) -> f64 {
    let t = (1.0 + 0.327_591_1 * x.abs()).recip();
    let sum = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    x.signum() * (1.0 - sum.into_iter().fold(0.0, |sum, c| (sum + c) * t) * (-x * x).exp())
}

/// Values of a cube of `size`^3 voxels by their place.
fn volume(size: u32, mut value: impl FnMut(DVec3) -> f64) -> Volume {
    let place = |i: u32| DVec3::new(f64::from(i % size), f64::from(i / size % size), f64::from(i / (size * size)));
    let values: Vec<f32> = (0..size.pow(3)).map(|i| value(place(i)) as f32).collect();
    Volume::from_slice([size; 3], [1.0; 3], &values).unwrap()
}

/// Matter with an edge as a scanner blurs it, 0.7 voxels, given the distance from its surface.
fn edge([outside, inside]: [f64; 2], depth: f64) -> f64 {
    outside + (inside - outside) * (0.5 + erf(depth / (0.7 * std::f64::consts::SQRT_2)) / 2.0)
}

/// A ball off the centre of the lattice, and its camera.
fn ball(values: [f64; 2]) -> (Volume, Camera) {
    let size = 2 * RADIUS as u32 + 16;
    let center = DVec3::splat(f64::from(size - 1) / 2.0) + DVec3::new(0.13, 0.29, 0.41);
    let volume = volume(size, |place| edge(values, RADIUS - place.distance(center)));
    let world = volume.grid().to_world().transform_point3(center);
    let height = Some(f64::from(PIXELS) / 2.0);
    let view = View { azimuth: 12.0, elevation: 9.0, target: Some(world), view_height: height, ..View::default() };
    let camera = look(&view, &volume, [PIXELS; 2]);
    (volume, camera)
}

/// The places along an axis of the picture, voxels from the middle.
fn places() -> impl Iterator<Item = f64> + Clone {
    (0..PIXELS).map(|i| (f64::from(i) + 0.5 - f64::from(PIXELS) / 2.0) / 2.0)
}

/// The rings of a picture of a ball, rms of 255 within 0.9 of its radius: the picture less its mean over azimuths, less
/// the Gaussian of 4 voxels of that.
fn rings(image: &Image) -> f64 {
    let n = PIXELS as usize;
    let radius: Vec<f64> = places().flat_map(|y| places().map(move |x| x.hypot(y))).collect();
    let inside: Vec<bool> = radius.iter().map(|&r| r < 0.9 * RADIUS).collect();
    let weight = |a: f64, b: f64| (-0.5 * ((a - b) / 4.0).powi(2)).exp();
    let weights: Vec<Vec<f64>> = places().map(|a| places().map(|b| weight(a, b)).collect()).collect();
    let blurred = |field: &[f64]| -> Vec<f64> {
        let across = |row: &[f64]| weights.iter().map(|w| w.iter().zip(row).map(|(w, v)| w * v).sum()).collect();
        let rows: Vec<Vec<f64>> = field.chunks(n).map(across).collect();
        weights
            .iter()
            .flat_map(|w| (0..n).map(|x| w.iter().zip(&rows).map(|(w, row)| w * row[x]).sum()).collect::<Vec<f64>>())
            .collect()
    };
    let share = blurred(&inside.iter().map(|&inside| f64::from(u8::from(inside))).collect::<Vec<_>>());
    let (mut sum, mut count) = (0.0, 0);
    for channel in 0..3 {
        let mut bins = vec![[0.0; 2]; n];
        for ((pixel, &r), _) in image.pixels().iter().zip(&radius).zip(&inside).filter(|(_, inside)| **inside) {
            let (low, part) = ((2.0 * r) as usize, (2.0 * r).fract());
            for (bin, weight) in [(low, 1.0 - part), (low + 1, part)] {
                bins[bin] = [bins[bin][0] + weight * 255.0 * f64::from(pixel[channel]), bins[bin][1] + weight];
            }
        }
        let mean = |bin: usize| bins[bin][0] / bins[bin][1].max(1e-9);
        let mean = |r: f64| {
            let (low, part) = ((2.0 * r) as usize, (2.0 * r).fract());
            mean(low) * (1.0 - part) + mean(low + 1) * part
        };
        let pixels = image.pixels().iter().zip(radius.iter().zip(&inside));
        let rest: Vec<f64> = pixels
            .map(|(pixel, (&r, &inside))| if inside { 255.0 * f64::from(pixel[channel]) - mean(r) } else { 0.0 })
            .collect();
        for (i, smooth) in blurred(&rest).into_iter().enumerate().filter(|&(i, _)| inside[i]) {
            sum += (rest[i] - smooth / share[i]).powi(2);
            count += 1;
        }
    }
    (sum / f64::from(count)).sqrt()
}

/// Pictures by the processor.
fn drawn(volume: &Volume, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> Image {
    let settings = Settings { painter: Painter::Cpu, level: Level::At(0), ..settings.clone() };
    let engine = Engine::open(&RendererOptions::default(), &settings).unwrap();
    let scene = engine.prepare_layers(&Layers::of_volume(volume, transfer), &settings).unwrap();
    engine.render(&scene, &Frame::new(camera, &settings)).unwrap().image
}

/// A preset at absolute values.
fn absolute(name: &str, volume: &Volume) -> TransferFunction {
    preset(name, volume, &Statistics::of(volume).unwrap(), PresetValues::Absolute).unwrap()
}

#[test]
fn smooth_balls_have_no_rings() {
    let lit = Settings { lighting: headlight(), ..Settings::default() };
    // The nautilus has narrow peaks: its rings depend on the value inside.
    for (name, values, most) in [
        ("ct-skin", [-1000.0, 40.0], [0.15, 0.2]),
        ("ct-bone", [40.0, 1200.0], [0.15, 0.2]),
        ("nautilus", [0.0, 118.0], [0.15, 0.2]),
        ("nautilus", [0.0, 160.0], [1.0, 1.0]),
        ("nautilus", [0.0, 236.0], [2.0, 2.0]),
    ] {
        let (volume, camera) = ball(values);
        let transfer = demo_transfer(name).unwrap_or_else(|| absolute(name, &volume));
        assert!(transfer.is_band_limited());
        let point = transfer.clone().with_classification(Classification::Point);
        for (settings, most) in [&Settings::default(), &lit].into_iter().zip(most) {
            let [before, after] =
                [&point, &transfer].map(|transfer| rings(&drawn(&volume, transfer, &camera, settings)));
            println!("{name} {values:?} lit {}: {before:.3} to {after:.3}", settings.lighting.is_some());
            // Rings under a sixth of a step are the painter's.
            assert!(after < most && 2.0 * after < before.max(0.3), "{name} {values:?}: {before} to {after}");
        }
    }
}

#[test]
fn thin_tubes_keep_their_brightness() {
    let size = 48;
    let center = DVec3::new(24.13, 23.37, 23.71);
    for radius in [1.0, 1.5, 2.0, 2.5] {
        let tube = volume(size, |place| edge([-1000.0, 40.0], radius - (place - center).truncate().length()));
        let transfer = absolute("ct-skin", &tube);
        let point = transfer.clone().with_classification(Classification::Point);
        let view = View { azimuth: 35.0, elevation: 25.0, ..View::default() };
        let camera = look(&view, &tube, [96; 2]);
        let [before, after] = [&point, &transfer].map(|transfer| {
            let image = drawn(&tube, transfer, &camera, &Settings::default());
            // Of the brightest pixels of rows in the middle.
            let rows = image.pixels().chunks(96).skip(32).take(32);
            rows.map(|row| row.iter().map(|p| f64::from(p[0] + p[1] + p[2])).fold(0.0, f64::max)).sum::<f64>()
        });
        println!("{radius}: {:.3}", after / before);
        assert!((after / before - 1.0).abs() < if radius > 1.0 { 0.03 } else { 0.06 }, "{radius}: {before} {after}");
    }
}

#[test]
fn engines_draw_the_definition() {
    // Noise, so that boxes end at neighbours, and steps in the transfer function.
    let mut state = 7_u32;
    let volume = volume(20, |place| {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let noise = f64::from(state >> 8) / f64::from(1 << 24) - 0.5;
        edge([0.0, 100.0], 7.0 - place.distance(DVec3::splat(9.7))) + 8.0 * noise
    });
    let view = View { azimuth: 33.0, elevation: 20.0, ..View::default() };
    let camera = look(&view, &volume, [64; 2]);
    let points = [
        (20.0, [1.0, 0.2, 0.1], 0.0),
        (40.0, [1.0, 0.8, 0.1], 0.5),
        (60.0, [0.1, 0.8, 0.1], 0.0),
        (90.0, [0.1, 0.8, 1.0], 0.0),
        (90.0, [0.9, 0.8, 1.0], 0.7),
    ];
    let transfer = crate::support::transfer(&points, None).with_classification(Classification::BandLimited);
    for lighting in [None, headlight()] {
        let settings = Settings { lighting, ..exact_quads() };
        let expected = truth(&volume, &transfer, &camera, &settings);
        let point = transfer.clone().with_classification(Classification::Point);
        assert!(rms_of_all(&expected, &truth(&volume, &point, &camera, &settings)) > 1e-2);
        let pictures = [settings.clone(), with_tiles(&settings)].map(|s| render(&volume, &transfer, &camera, &s));
        for (picture, what) in pictures.iter().chain([&drawn(&volume, &transfer, &camera, &settings)]).zip(0..) {
            let error = rms_of_all(picture, &expected);
            println!("{what}: {error:e}");
            assert!(error < 3e-3, "{what}: {error:e}");
        }
    }
}
