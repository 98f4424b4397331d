//! Isosurfaces along rays: their places, their light, and several of them.

use voxsplat::Frame;
use voxsplat::camera::clip::{Clip, Plane};
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::engine::{Engine, EngineScene};
use voxsplat::glam::DVec3;
use voxsplat::image::Image;
use voxsplat::kernel::Kernel;
use voxsplat::layers::Layers;
use voxsplat::lighting::Lighting;
use voxsplat::reference::Reference;
use voxsplat::settings::{Level, Painter, Settings, Shading};
use voxsplat::transfer::{ControlPoint, TransferFunction};
use voxsplat::volume::Volume;

use crate::support::{PROJECTIONS, demo, engines, headlight, with_quads};

pub(super) const SIZE: u32 = 72;

pub(super) fn surface(value: f64, color: [f64; 3], opacity: f64) -> ControlPoint {
    ControlPoint { value, color, opacity }
}

pub(super) fn settings() -> Settings {
    Settings {
        shading: Shading::Post,
        level: Level::At(0),
        antialiasing: false,
        kernel: Kernel::Gaussian { sigma: 1.0, radius: 3.0 },
        ..Settings::default()
    }
}

/// The painter of each engine that draws isosurfaces.
const PAINTERS: [Painter; 2] = [Painter::Tiles, Painter::Cpu];

/// Returns the scene of an engine.
fn scene(engine: &Engine, volume: &Volume, transfer: &TransferFunction, settings: &Settings) -> EngineScene {
    engine.prepare_layers(&Layers::of_volume(volume, transfer), settings).unwrap()
}

/// Returns the picture of an engine.
fn picture(engine: &Engine, volume: &Volume, transfer: &TransferFunction, view: &View, settings: &Settings) -> Image {
    let camera = Camera::new(view, volume.grid(), [SIZE; 2]).unwrap();
    let scene = scene(engine, volume, transfer, settings);
    engine.render(&scene, &Frame::new(&camera, settings)).unwrap().image
}

/// Returns the differences of pixels of each engine from the reference, of 255 and ascending.
fn errors(
    engines: &[Engine; 2],
    volume: &Volume,
    transfer: &TransferFunction,
    view: &View,
    settings: &Settings,
) -> [Vec<f32>; 2] {
    let camera = Camera::new(view, volume.grid(), [SIZE; 2]).unwrap();
    let truth = Reference::new(volume, transfer, settings).unwrap().render(&camera).unwrap();
    [0, 1].map(|number| {
        let settings = Settings { painter: PAINTERS[number], ..settings.clone() };
        let image = picture(&engines[number], volume, transfer, view, &settings);
        differences(&truth, &image)
    })
}

/// Returns the differences of visible pixels, of 255 and ascending.
pub(super) fn differences(a: &Image, b: &Image) -> Vec<f32> {
    let shown = a.pixels().iter().zip(b.pixels()).filter(|(p, q)| p[3] > 0.0 || q[3] > 0.0);
    let largest = |(p, q): (&[f32; 4], &[f32; 4])| (0..4).map(|c| 255.0 * (p[c] - q[c]).abs()).fold(0.0, f32::max);
    let mut all: Vec<f32> = shown.map(largest).collect();
    all.sort_unstable_by(f32::total_cmp);
    all
}

#[test]
fn pictures_are_those_of_the_reference() {
    compare_pictures(3);
}

#[test]
#[ignore = "slow: ten pictures by the reference; the test before has four"]
fn pictures_of_every_look_are_those_of_the_reference() {
    compare_pictures(1);
}

/// Compares every `step`-th of ten pictures.
fn compare_pictures(step: usize) {
    let (volume, _) = demo("marschner-lobb", 32);
    let opaque = [surface(0.5, [0.9, 0.8, 0.6], 1.0)];
    // Nested surfaces, given in any order, and matter between them.
    let nested = [surface(0.7, [0.2, 0.4, 0.9], 1.0), surface(0.35, [0.9, 0.3, 0.2], 0.4)];
    let fog = [surface(0.0, [0.3, 0.9, 0.4], 0.0), surface(1.0, [0.3, 0.9, 0.4], 0.1)];
    let fog = TransferFunction::new(fog.to_vec(), Some(1.0 / 16.0)).unwrap();
    let clear = |surfaces: &[ControlPoint]| TransferFunction::of_isosurfaces(surfaces).unwrap();
    let shadowed = Lighting { shadows: 0.7, ..Lighting::studio(DVec3::Y, DVec3::Z) };
    let open = Clip::default();
    let cut = Clip::new(vec![Plane::new(DVec3::new(0.3, -0.9, 0.2), -0.1).unwrap()]).unwrap();
    let engines = engines();
    let looks = [
        ("unlit", clear(&opaque), None, &open, [[0.05, 0.1], [0.05, 0.1]]),
        ("lit", clear(&opaque), headlight(), &open, [[2.5, 18.0], [1.0, 6.0]]),
        ("nested, cut", clear(&nested), headlight(), &cut, [[2.5, 20.0], [1.0, 10.0]]),
        ("in fog", fog.with_isosurfaces(&nested).unwrap(), headlight(), &open, [[4.5, 22.0], [1.5, 12.0]]),
        ("shadowed", clear(&nested), Some(shadowed), &open, [[3.5, 24.0], [3.0, 18.0]]),
    ];
    let all = PROJECTIONS.into_iter().flat_map(|projection| looks.iter().map(move |look| (projection, look)));
    for (projection, (name, transfer, lighting, clip, bounds)) in all.step_by(step) {
        let view = View { azimuth: 33.0, elevation: 20.0, projection, ..View::default() };
        let settings = Settings { lighting: lighting.clone(), clip: (*clip).clone(), ..settings() };
        let errors = errors(&engines, &volume, transfer, &view, &settings);
        for ((errors, painter), bounds) in errors.iter().zip(PAINTERS).zip(bounds) {
            let at = |share: f64| errors[((errors.len() - 1) as f64 * share) as usize];
            let ([half, most], count) = ([at(0.5), at(0.97)], errors.len());
            let name = format!("{name}, {painter:?}, {projection:?}");
            println!("{name}: {count} pixels, half within {half:.2}, 97 % within {most:.2} of 255");
            // Rays that touch a surface, and those that enter the box at one, meet it or miss it.
            assert!(count > 200 && half < bounds[0] && most < bounds[1], "{name}: {half}, {most}");
        }
    }
}

/// The field of a volume in the Gaussian kernel of deviation 1 and a radius, by the sum of its kernels in f64.
fn field(volume: &Volume, values: &[f32], reach: i64, place: DVec3) -> f64 {
    let kernel = |square: f64| if square <= (reach * reach) as f64 { (-square / 2.0).exp() } else { 0.0 };
    let dims = volume.grid().dims().map(|d| d as i64);
    let near = place.round().to_array().map(|c| c as i64);
    let mut sum = 0.0;
    for k in near[2] - reach..=near[2] + reach {
        for j in near[1] - reach..=near[1] + reach {
            for i in near[0] - reach..=near[0] + reach {
                let [x, y, z] = [(i, 0), (j, 1), (k, 2)].map(|(p, axis)| p.clamp(0, dims[axis] - 1));
                let value = f64::from(values[(x + dims[0] * (y + dims[1] * z)) as usize]);
                sum += value * kernel(place.distance_squared(DVec3::new(i as f64, j as f64, k as f64)));
            }
        }
    }
    let shell = |r: f64| 4.0 * std::f64::consts::PI * r * r * kernel(r * r) / 1000.0;
    // The integral of the kernel, its divisor.
    sum / (0..4000).map(|n| shell((f64::from(n) + 0.5) / 1000.0)).sum::<f64>()
}

/// Returns the number of pixels with a surface, and the largest distance of depths from surfaces that `is_outside`
/// tells: along each ray halved to 1e-6 voxels. Rays count that stay inside for `chord` voxels.
fn largest_error(
    engine: &Engine,
    volume: &Volume,
    settings: &Settings,
    projection: ProjectionKind,
    (is_outside, chord): (&dyn Fn(DVec3) -> bool, f64),
) -> (usize, f64) {
    let transfer = TransferFunction::of_isosurfaces(&[surface(0.5, [1.0; 3], 1.0)]).unwrap();
    let view = View { azimuth: 33.0, elevation: 20.0, projection, ..View::default() };
    let camera = Camera::new(&view, volume.grid(), [SIZE; 2]).unwrap();
    let scene = scene(engine, volume, &transfer, settings);
    let depths = engine.depths(&scene, &Frame::new(&camera, settings)).unwrap();
    let (mut count, mut largest) = (0, 0.0_f64);
    let to_lattice = volume.grid().to_lattice();
    for y in 0..SIZE {
        for x in 0..SIZE {
            let depth = f64::from(depths.depths()[(x + SIZE * y) as usize]);
            if !depth.is_finite() {
                continue;
            }
            let (sx, sy) = camera.image_coordinates([x, y]);
            let (origin, direction) = camera.ray(sx, sy);
            let at = |along: f64| to_lattice.transform_point3(origin + direction * along);
            // Depths are distances along the view's direction.
            let along = depth / direction.dot(camera.forward);
            // The first place inside. A small change of the field moves the depth of flat rays far.
            let mut steps = (0..60).map(|step| along - 0.3 + 0.01 * f64::from(step));
            let first = steps.find(|&step| !is_outside(at(step))).unwrap_or(along + 0.3);
            if is_outside(at(first + chord)) {
                continue;
            }
            let (mut outside, mut inside) = (first - 0.01, first);
            while inside - outside > 1e-6 {
                let half = f64::midpoint(outside, inside);
                if is_outside(at(half)) { outside = half } else { inside = half }
            }
            count += 1;
            largest = largest.max((outside - along).abs());
        }
    }
    (count, largest)
}

/// Returns a volume of 64^3 by a signed distance, positive inside, of an edge as a scan's.
fn solid(inside: impl Fn(DVec3) -> f64) -> (Volume, Vec<f32>) {
    let place = |i: usize| DVec3::new((i % 64) as f64, (i / 64 % 64) as f64, (i / 4096) as f64) - 31.5;
    let values: Vec<f32> =
        (0..64_usize.pow(3)).map(|i| (1.0 / (1.0 + (-2.5 * inside(place(i))).exp())) as f32).collect();
    (Volume::from_slice([64; 3], [1.0; 3], &values).unwrap(), values)
}

#[test]
fn depths_are_roots_of_the_field_and_of_the_solid() {
    compare_depths(3);
}

#[test]
#[ignore = "slow: eight sets of depths; the test before has three"]
fn depths_of_every_solid_are_roots_of_the_field_and_of_the_solid() {
    compare_depths(1);
}

/// Compares every `step`-th of eight sets of depths.
fn compare_depths(step: usize) {
    let sphere = |p: DVec3| 22.3 - p.length();
    let torus = |p: DVec3| 8.2 - DVec3::new(p.truncate().length() - 20.4, p.z, 0.0).length();
    let engines = engines();
    let mut set = 0;
    for (name, inside, chord, most) in
        [("sphere", &sphere as &dyn Fn(DVec3) -> f64, 20.0, 0.1), ("torus", &torus, 8.0, 0.2)]
    {
        let (volume, values) = solid(inside);
        for (number, projection) in [0, 1].into_iter().flat_map(|number| PROJECTIONS.map(|of| (number, of))) {
            set += 1;
            if (set - 1) % step > 0 {
                continue;
            }
            let (engine, reach) = (&engines[number], [3, 4][number]);
            let kernel = Kernel::Gaussian { sigma: 1.0, radius: reach as f64 };
            let settings = Settings { painter: PAINTERS[number], kernel, ..settings() };
            let name = format!("{name}, {:?}, {projection:?}", settings.painter);
            let of_field = |place: DVec3| field(&volume, &values, reach, place) < 0.5;
            let (count, largest) = largest_error(engine, &volume, &settings, projection, (&of_field, chord));
            println!("{name}: {count} depths within {largest:.4} voxels of the field's");
            // The parts of kernels in slabs of a device are fitted: to 0.008 voxels (rms).
            assert!(count > 300 && largest < [0.06, 0.02][number], "{name}: {count}, {largest}");
            if settings.painter == Painter::Tiles {
                continue;
            }
            // A field that passes through the samples.
            let of_solid = |place: DVec3| inside(place - 31.5) < 0.0;
            let sharp = Settings { sharpness: 1.0, ..settings };
            let (count, largest) = largest_error(engine, &volume, &sharp, projection, (&of_solid, chord));
            println!("{name}: {count} depths within {largest:.4} voxels of the solid's");
            assert!(count > 300 && largest < most, "{name}: {count}, {largest}");
        }
    }
}

/// Each ray meets each plane of a ramp once, wherever the borders of slabs lie.
#[test]
fn surfaces_are_met_once() {
    let [device, _] = engines();
    let planes = [-3.0, 2.0, 2.5].map(|value| surface(value, [1.0; 3], 0.3));
    let transfer = TransferFunction::of_isosurfaces(&planes).unwrap();
    for spacing in [[1.0; 3], [1.0, 1.0, 10.0]] {
        for projection in PROJECTIONS {
            let settings = Settings { painter: Painter::Tiles, ..settings() };
            let view = View { azimuth: 33.0, elevation: 35.0, projection, ..View::default() };
            // It falls along every axis of the lattice on every ray, also where it is flat beyond a face.
            let slope = view.forward().unwrap().signum() * DVec3::new(-1.0, -0.6, -0.8);
            let place = |i: usize| DVec3::new((i % 24) as f64, (i / 24 % 24) as f64, (i / 576) as f64) - 11.5;
            let values: Vec<f32> = (0..24_usize.pow(3)).map(|i| slope.dot(place(i)) as f32).collect();
            let volume = Volume::from_slice([24; 3], spacing, &values).unwrap();
            let image = picture(&device, &volume, &transfer, &view, &settings);
            let mut counts = [0; 4];
            for alpha in image.pixels().iter().map(|pixel| pixel[3]) {
                let met = (1.0 - alpha).ln() / 0.7_f32.ln();
                assert!((met - met.round()).abs() < 1e-3, "{spacing:?}, {projection:?}: met {met} times");
                counts[met.round() as usize] += 1;
            }
            println!("{spacing:?}, {projection:?}: {counts:?} pixels with 0 to 3 planes");
            assert!(counts[1] > 40 && counts[3] > 200, "{counts:?}");
        }
    }
}

#[test]
fn a_device_draws_masks_and_thick_slices_as_the_reference() {
    let engines = engines();
    let half = [surface(0.5, [0.9, 0.8, 0.6], 0.6)];
    let transfer = TransferFunction::of_isosurfaces(&half).unwrap();
    let ball = |i: usize| DVec3::new((i % 32) as f64 - 15.3, (i / 32 % 32) as f64 - 15.7, 0.0);
    let mask = |depth: usize, size: f64| {
        let inside = move |i: usize| ball(i).length_squared() + ((i / 1024) as f64 - depth as f64 / 2.0).powi(2) * size;
        (0..1024 * depth).map(|i| f32::from(u8::from(inside(i) < 121.0))).collect::<Vec<f32>>()
    };
    for (name, dims, spacing, values) in
        [("a mask", [32; 3], [1.0; 3], mask(32, 1.0)), ("thick slices", [32, 32, 8], [1.0, 1.0, 10.0], mask(8, 16.0))]
    {
        let volume = Volume::from_slice(dims, spacing, &values).unwrap();
        for (projection, level) in [(PROJECTIONS[0], Level::At(0)), (PROJECTIONS[1], Level::Auto)] {
            let settings = Settings { level, kernel: Kernel::default(), antialiasing: true, ..settings() };
            let view = View { azimuth: 33.0, elevation: 20.0, projection, ..View::default() };
            let errors = errors(&engines, &volume, &transfer, &view, &settings);
            let at = |errors: &[f32], share: f64| errors[((errors.len() - 1) as f64 * share) as usize];
            for (errors, painter) in errors.iter().zip(PAINTERS) {
                let name = format!("{name}, {painter:?}, {projection:?}");
                println!("{name}: {} pixels, {:?} of 255", errors.len(), [0.5, 0.9, 0.97].map(|s| at(errors, s)));
            }
            assert!(errors[0].len() > 400 && at(&errors[0], 0.9) < 1.0, "{name}, {projection:?}");
        }
    }
}

#[test]
fn quads_refuses_isosurfaces() {
    let [device, _] = engines();
    let (volume, _) = demo("marschner-lobb", 16);
    let transfer = TransferFunction::of_isosurfaces(&[surface(0.5, [1.0; 3], 1.0)]).unwrap();
    let camera = Camera::new(&View::default(), volume.grid(), [SIZE; 2]).unwrap();
    // Kernels that are too wide for tiles.
    let wide = Settings { kernel: Kernel::Gaussian { sigma: 2.0, radius: 5.0 }, ..settings() };
    for settings in [with_quads(&settings(), |_| ()), wide] {
        let scene = scene(&device, &volume, &transfer, &settings);
        let error = device.render(&scene, &Frame::new(&camera, &settings)).err().unwrap().to_string();
        assert!(error.contains("painter: quads draws no isosurfaces: use tiles or cpu"), "{error}");
    }
}
