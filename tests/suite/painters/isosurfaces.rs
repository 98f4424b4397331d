//! Isosurfaces along rays: their places, their light, and several of them.

use voxsplat::Frame;
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::engine::{Engine, EngineScene};
use voxsplat::glam::DVec3;
use voxsplat::kernel::Kernel;
use voxsplat::layers::Layers;
use voxsplat::lighting::Lighting;
use voxsplat::reference::Reference;
use voxsplat::settings::{Level, Painter, Settings, Shading};
use voxsplat::transfer::{ControlPoint, TransferFunction};
use voxsplat::volume::Volume;

use crate::support::{PROJECTIONS, demo, engines, headlight};

pub(super) const SIZE: u32 = 72;

pub(super) fn surface(value: f64, color: [f64; 3], opacity: f64) -> ControlPoint {
    ControlPoint { value, color, opacity }
}

pub(super) fn settings() -> Settings {
    Settings {
        shading: Shading::Post,
        painter: Painter::Cpu,
        level: Level::At(0),
        antialiasing: false,
        kernel: Kernel::Gaussian { sigma: 1.0, radius: 4.0 },
        ..Settings::default()
    }
}

/// Returns a scene of the processor.
fn scene(volume: &Volume, transfer: &TransferFunction, settings: &Settings) -> (Engine, EngineScene) {
    let [_, host] = engines();
    let scene = host.prepare_layers(&Layers::of_volume(volume, transfer), settings).unwrap();
    (host, scene)
}

/// Returns the differences of pixels from the reference, of 255 and ascending.
fn errors(volume: &Volume, transfer: &TransferFunction, view: &View, settings: &Settings) -> Vec<f32> {
    let camera = Camera::new(view, volume.grid(), [SIZE; 2]).unwrap();
    let (host, scene) = scene(volume, transfer, settings);
    let image = host.render(&scene, &Frame::new(&camera, settings)).unwrap().image;
    let truth = Reference::new(volume, transfer, settings).unwrap().render(&camera).unwrap();
    let shown = truth.pixels().iter().zip(image.pixels()).filter(|(p, q)| p[3] > 0.0 || q[3] > 0.0);
    let difference = |(p, q): (&[f32; 4], &[f32; 4])| (0..4).map(|c| 255.0 * (p[c] - q[c]).abs()).fold(0.0, f32::max);
    let mut differences: Vec<f32> = shown.map(difference).collect();
    differences.sort_unstable_by(f32::total_cmp);
    differences
}

#[test]
fn pictures_are_those_of_the_reference() {
    let (volume, _) = demo("marschner-lobb", 32);
    let opaque = [surface(0.5, [0.9, 0.8, 0.6], 1.0)];
    // Nested surfaces, given in any order, and matter between them.
    let nested = [surface(0.7, [0.2, 0.4, 0.9], 1.0), surface(0.35, [0.9, 0.3, 0.2], 0.4)];
    let fog = [surface(0.0, [0.3, 0.9, 0.4], 0.0), surface(1.0, [0.3, 0.9, 0.4], 0.1)];
    let fog = TransferFunction::new(fog.to_vec(), Some(1.0 / 16.0)).unwrap();
    let clear = |surfaces: &[ControlPoint]| TransferFunction::of_isosurfaces(surfaces).unwrap();
    let shadowed = Lighting { shadows: 0.7, ..Lighting::studio(DVec3::Y, DVec3::Z) };
    for projection in PROJECTIONS {
        let view = View { azimuth: 33.0, elevation: 20.0, projection, ..View::default() };
        for (name, transfer, lighting, bounds) in [
            ("unlit", clear(&opaque), None, [0.05, 0.1]),
            ("lit", clear(&opaque), headlight(), [1.0, 6.0]),
            ("nested", clear(&nested), headlight(), [1.0, 10.0]),
            ("in fog", fog.clone().with_isosurfaces(&nested).unwrap(), headlight(), [1.5, 12.0]),
            ("shadowed", clear(&nested), Some(shadowed.clone()), [3.0, 18.0]),
        ] {
            let errors = errors(&volume, &transfer, &view, &Settings { lighting, ..settings() });
            let at = |share: f64| errors[((errors.len() - 1) as f64 * share) as usize];
            let [half, most] = [at(0.5), at(0.97)];
            println!(
                "{name}, {projection:?}: {} pixels, half within {half:.2}, 97 % within {most:.2} of 255",
                errors.len()
            );
            // Rays that touch a surface, and those that enter the box at one, meet it or miss it.
            assert!(
                errors.len() > 200 && half < bounds[0] && most < bounds[1],
                "{name}, {projection:?}: {half}, {most}"
            );
        }
    }
}

/// The field of a volume in the Gaussian kernel of deviation 1 and radius 3, by the sum of its kernels in f64.
fn field(volume: &Volume, values: &[f32], place: DVec3) -> f64 {
    let kernel = |square: f64| if square <= 16.0 { (-square / 2.0).exp() } else { 0.0 };
    let dims = volume.grid().dims().map(|d| d as i64);
    let reach = 4;
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
    volume: &Volume,
    settings: &Settings,
    projection: ProjectionKind,
    (is_outside, chord): (&dyn Fn(DVec3) -> bool, f64),
) -> (usize, f64) {
    let transfer = TransferFunction::of_isosurfaces(&[surface(0.5, [1.0; 3], 1.0)]).unwrap();
    let view = View { azimuth: 33.0, elevation: 20.0, projection, ..View::default() };
    let camera = Camera::new(&view, volume.grid(), [SIZE; 2]).unwrap();
    let (host, scene) = scene(volume, &transfer, settings);
    let depths = host.depths(&scene, &Frame::new(&camera, settings)).unwrap();
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
            let steps = (0..400).map(|step| along - 2.0 + 0.01 * f64::from(step));
            let Some(first) = steps.into_iter().find(|&step| !is_outside(at(step))) else { continue };
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
    let sphere = |p: DVec3| 22.3 - p.length();
    let torus = |p: DVec3| 8.2 - DVec3::new(p.truncate().length() - 20.4, p.z, 0.0).length();
    for (name, inside, chord, most) in
        [("sphere", &sphere as &dyn Fn(DVec3) -> f64, 20.0, 0.1), ("torus", &torus, 8.0, 0.2)]
    {
        let (volume, values) = solid(inside);
        for projection in PROJECTIONS {
            let of_field = |place: DVec3| field(&volume, &values, place) < 0.5;
            let (count, largest) = largest_error(&volume, &settings(), projection, (&of_field, chord));
            println!("{name}, {projection:?}: {count} depths within {largest:.4} voxels of the field's");
            assert!(count > 300 && largest < 0.02, "{name}, {projection:?}: {count}, {largest}");
            // A field that passes through the samples.
            let of_solid = |place: DVec3| inside(place - 31.5) < 0.0;
            let sharp = Settings { sharpness: 1.0, ..settings() };
            let (count, largest) = largest_error(&volume, &sharp, projection, (&of_solid, chord));
            println!("{name}, {projection:?}: {count} depths within {largest:.4} voxels of the solid's");
            assert!(count > 300 && largest < most, "{name}, {projection:?}: {count}, {largest}");
        }
    }
}

#[test]
fn painters_of_a_device_refuse_isosurfaces() {
    let [device, _] = engines();
    let (volume, plain) = demo("marschner-lobb", 16);
    let transfer = TransferFunction::of_isosurfaces(&[surface(0.5, [1.0; 3], 1.0)]).unwrap();
    let settings = Settings { painter: Painter::Tiles, ..settings() };
    let layers = Layers::of_volume(&volume, &transfer);
    let error = device.prepare_layers(&layers, &settings).err().unwrap().to_string();
    assert!(error.contains("isosurfaces are drawn by cpu"), "{error}");
    let Engine::Device(renderer) = device else { panic!("a device") };
    let mut scene = renderer.prepare(&volume, &plain, &settings).unwrap();
    let error = renderer.set_transfer(&mut scene, &transfer).unwrap_err().to_string();
    assert!(error.contains("isosurfaces are drawn by cpu"), "{error}");
}
