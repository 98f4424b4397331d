//! The reference against closed forms and brute force.

mod scalars;
mod tolerance;

use glam::{DAffine3, DMat3, DQuat};

use super::*;
use crate::camera::{ProjectionKind, View};
use crate::kernel::Normalization;
use crate::lighting::{Light, Lighting, Normals, Visibility};
use crate::settings::Shading;
use crate::transfer::{Classification, ControlPoint};
use crate::volume::Samples;

fn point(value: f64, color: [f64; 3], opacity: f64) -> ControlPoint {
    ControlPoint { value, color, opacity }
}

/// Returns a transfer function in which values 0, 1 and 2 are air, red-ish of opacity 0.4 and blue-ish of opacity 0.7
/// per unit.
fn tones() -> TransferFunction {
    let (red, blue) = ([0.9, 0.3, 0.1], [0.2, 0.4, 0.8]);
    TransferFunction::new(
        vec![point(0.0, red, 0.0), point(0.9, red, 0.0), point(1.0, red, 0.4), point(2.0, blue, 0.7)],
        Some(1.0),
    )
    .unwrap()
    .with_classification(Classification::Point)
}

fn volume(dims: [u32; 3], matrix: DMat3, voxels: &[([u32; 3], u8)]) -> Volume {
    let mut samples = vec![0; dims.iter().product::<u32>() as usize];
    for &([x, y, z], value) in voxels {
        samples[((z * dims[1] + y) * dims[0] + x) as usize] = value;
    }
    Volume::new(Grid::new(dims, DAffine3::from_mat3(matrix)).unwrap(), Samples::U8(samples)).unwrap()
}

fn prepared(volume: &Volume, kernel: &Kernel) -> Reference {
    Reference::new(volume, &tones(), &Settings { kernel: *kernel, ..Settings::default() }).unwrap()
}

/// Returns erf by its Maclaurin series (Abramowitz and Stegun 7.1.5), for |x| up to about 3.
fn erf(x: f64) -> f64 {
    let mut term = x;
    let mut sum = x;
    for n in 1..60 {
        term *= -x * x / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    sum * 2.0 / PI.sqrt()
}

const PI: f64 = std::f64::consts::PI;

/// Returns the line integral of the Gaussian of sigma 1 cut at 2, at distance r from its centre.
fn footprint(r: f64) -> f64 {
    let c2 = 4.0 - r * r;
    if c2 <= 0.0 { 0.0 } else { (-r * r / 2.0).exp() * (2.0 * PI).sqrt() * erf((c2 / 2.0).sqrt()) }
}

#[test]
fn one_voxel_has_the_footprint_of_its_kernel() {
    let scene = prepared(&volume([5, 5, 5], DMat3::IDENTITY, &[([2, 2, 2], 1)]), &Kernel::default());
    let tau = TransferFunction::extinction(0.4, 1.0) / Kernel::default().integral();
    for r in [0.0, 0.4, 1.0, 1.7, 1.99, 2.01] {
        let got = scene.ray(DVec3::new(2.0 + r, -9.0, 2.0), DVec3::Y, true).rgba();
        let alpha = 1.0 - (-tau * footprint(r)).exp();
        assert!((got[3] - alpha).abs() < 1e-9, "r {r}: {} is not {alpha}", got[3]);
        for (c, tone) in [0.9, 0.3, 0.1].into_iter().enumerate() {
            assert!((got[c] - tone * alpha).abs() < 1e-9, "r {r}, channel {c}");
        }
    }
}

#[test]
fn one_voxel_of_a_sheared_anisotropic_grid() {
    let matrix = DMat3::from_cols(DVec3::new(0.5, 0.1, 0.0), DVec3::new(-0.2, 1.0, 0.3), DVec3::new(0.0, 0.4, 2.0));
    let scene = prepared(&volume([3, 3, 3], matrix, &[([1, 1, 1], 1)]), &Kernel::default());
    let center = matrix * DVec3::ONE;
    let direction = DVec3::new(0.3, -0.5, 0.7).normalize();
    let offset = DVec3::new(0.2, 0.1, -0.3);
    // In the lattice the ray has another direction, another distance and another unit of length.
    let inverse = matrix.inverse();
    let (u, q) = (inverse * direction, inverse * offset);
    let r = (q.length_squared() - (q.dot(u) / u.length()).powi(2)).sqrt();
    let tau = TransferFunction::extinction(0.4, 1.0) / Kernel::default().integral();
    let expected = 1.0 - (-tau * footprint(r) / u.length()).exp();
    let got = scene.ray(center + offset - direction * 7.0, direction, true).alpha();
    assert!((got - expected).abs() < 1e-9, "{got} is not {expected}");
}

#[test]
#[ignore = "slow: a ray in a million steps"]
fn two_tones_match_brute_force() {
    let kernel = Kernel::default();
    let scene = prepared(&volume([5, 6, 5], DMat3::IDENTITY, &[([2, 2, 2], 1), ([2, 3, 2], 2)]), &kernel);
    let (origin, direction) = (DVec3::new(1.6, -3.0, 2.3), DVec3::new(0.1, 1.0, -0.05).normalize());
    let got = scene.ray(origin, direction, true).rgba();
    let splats = [
        (DVec3::new(2.0, 2.0, 2.0), TransferFunction::extinction(0.4, 1.0), DVec3::new(0.9, 0.3, 0.1)),
        (DVec3::new(2.0, 3.0, 2.0), TransferFunction::extinction(0.7, 1.0), DVec3::new(0.2, 0.4, 0.8)),
    ];
    let (mut color, mut depth) = (DVec3::ZERO, 0.0);
    let step = 1e-5;
    for i in 0..1_200_000 {
        let x = origin + direction * (f64::from(i) + 0.5) * step;
        let (mut tau, mut emission) = (0.0, DVec3::ZERO);
        for (center, extinction, tone) in splats {
            let t = extinction * kernel.value(x.distance_squared(center)) / kernel.integral();
            tau += t;
            emission += tone * t;
        }
        color += emission * (-depth - tau * step / 2.0_f64).exp() * step;
        depth += tau * step;
    }
    let expected = [color.x, color.y, color.z, 1.0 - (-depth).exp()];
    // Brute force misses the kernels' rims by up to a step each.
    for c in 0..4 {
        assert!((got[c] - expected[c]).abs() < 1e-6, "channel {c}: {} is not {}", got[c], expected[c]);
    }
}

#[test]
fn uniform_sphere_has_the_optical_depth_of_its_chord() {
    // Reconstruction rounds the rim off and the lattice makes it a staircase: the error of a chord of L voxels is a
    // fraction of a voxel, so it falls as the resolution rises.
    let mut last = f64::INFINITY;
    for radius in [8_u32, 16, 32] {
        let size = 2 * radius + 7;
        let middle = f64::from(size - 1) / 2.0;
        let inside = |x: u32, y: u32, z: u32| {
            let d = DVec3::new(f64::from(x), f64::from(y), f64::from(z)) - middle;
            d.length() <= f64::from(radius)
        };
        let samples = (0..size)
            .flat_map(|z| (0..size).flat_map(move |y| (0..size).map(move |x| u8::from(inside(x, y, z)))))
            .collect();
        // The sphere is 2 across whatever the lattice.
        let spacing = 1.0 / f64::from(radius);
        let grid = Grid::axis_parallel([size; 3], [spacing; 3]).unwrap();
        let volume = Volume::new(grid, Samples::U8(samples)).unwrap();
        let scene = prepared(&volume, &Kernel::KAISER_BESSEL);
        let tau = TransferFunction::extinction(0.4, 1.0);
        let direction = DVec3::new(0.5, 0.7, -0.3).normalize();
        let side = direction.cross(DVec3::Z).normalize();
        let worst = [0.0, 0.25, 0.5, 0.75].map(|r: f64| {
            let chord = 2.0 * (1.0 - r * r).sqrt();
            let expected = 1.0 - (-tau * chord).exp();
            (scene.ray(grid.center() + side * r, direction, true).alpha() - expected).abs()
        });
        let worst = worst.into_iter().fold(0.0, f64::max);
        assert!(worst < 0.25 / f64::from(radius) && worst < last, "radius {radius}: {worst:e}");
        last = worst;
    }
}

#[test]
fn rigid_motion_of_scene_and_camera_leaves_the_picture() {
    let still = volume([4, 5, 6], DMat3::IDENTITY, &[([1, 2, 3], 1), ([2, 2, 2], 2), ([3, 4, 1], 1)]);
    let turn = DQuat::from_scaled_axis(DVec3::new(0.3, 1.2, -0.7));
    let motion = DAffine3::from_rotation_translation(turn, DVec3::new(5.0, -3.0, 8.0));
    let moved = still.clone().with_grid(Grid::new([4, 5, 6], motion * still.grid().to_world()).unwrap()).unwrap();
    let view = View { azimuth: 20.0, projection: ProjectionKind::Perspective { fov: 40.0 }, ..View::default() };
    let camera = Camera::new(&view, still.grid(), [16, 12]).unwrap();
    let turned = Camera {
        target: motion.transform_point3(camera.target),
        right: turn * camera.right,
        up: turn * camera.up,
        forward: turn * camera.forward,
        ..camera
    };
    let kernel = Kernel::default();
    let a = prepared(&still, &kernel).render(&camera).unwrap();
    let b = prepared(&moved, &kernel).render(&turned).unwrap();
    for (p, q) in a.pixels().iter().flatten().zip(b.pixels().iter().flatten()) {
        // Pictures are f32: equal to its rounding.
        assert!((p - q).abs() < 1e-7, "{p} {q}");
    }
}

#[test]
fn a_ray_that_starts_inside_sees_only_what_is_ahead() {
    let scene = prepared(&volume([5, 5, 5], DMat3::IDENTITY, &[([2, 2, 2], 1)]), &Kernel::default());
    let from_center = scene.ray(DVec3::splat(2.0), DVec3::X, false).alpha();
    let tau = TransferFunction::extinction(0.4, 1.0) / Kernel::default().integral();
    let expected = 1.0 - (-tau * footprint(0.0) / 2.0).exp();
    assert!((from_center - expected).abs() < 1e-9, "{from_center} is not {expected}");
    assert_eq!(scene.ray(DVec3::new(4.1, 2.0, 2.0), DVec3::X, false).alpha(), 0.0);
}

fn settings(kernel: Kernel, model: Model, shading: Shading) -> Settings {
    Settings { kernel, model, shading, ..Settings::default() }
}

/// Makes a transfer function through (value, opacity) points, red from 0 to 1 over them.
fn ramp(points: &[(f64, f64)], unit: f64) -> TransferFunction {
    let last = (points.len() - 1).max(1) as f64;
    let points = points.iter().enumerate().map(|(i, &(v, o))| point(v, [i as f64 / last, 0.5, 0.25], o)).collect();
    TransferFunction::new(points, Some(unit)).unwrap().with_classification(Classification::Point)
}

fn floats(grid: Grid, f: impl Fn(DVec3) -> f64) -> Volume {
    let [nx, ny, nz] = grid.dims();
    let mut samples = Vec::new();
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                samples.push(f(DVec3::new(f64::from(x), f64::from(y), f64::from(z))));
            }
        }
    }
    Volume::new(grid, Samples::F64(samples)).unwrap()
}

/// Returns a volume of bumpy values from about -1 to 1 on a sheared anisotropic grid.
fn bumps() -> Volume {
    let matrix = DMat3::from_cols(DVec3::new(0.5, 0.1, 0.0), DVec3::new(-0.1, 0.8, 0.2), DVec3::new(0.0, 0.3, 1.2));
    let grid = Grid::new([5, 6, 4], DAffine3::from_mat3_translation(matrix, DVec3::new(1.0, 2.0, -3.0))).unwrap();
    floats(grid, |p| (1.3 * p.x + 0.4).sin() * (0.9 * p.y).cos() + 0.3 * (p.z * 1.7 + p.x).sin())
}

fn assert_close(got: [f64; 4], expected: [f64; 4], tolerance: f64, what: &str) {
    let worst = got.iter().zip(expected).map(|(g, e)| (g - e).abs()).fold(0.0, f64::max);
    assert!(worst < tolerance, "{what}: {got:?} is not {expected:?}, off by {worst:e}");
}

#[test]
fn a_grown_voxel_is_wider_and_as_much() {
    let kernel = Kernel::default();
    let volume = volume([5, 5, 5], DMat3::IDENTITY, &[([2, 2, 2], 1)]);
    let scene = prepared(&volume, &kernel);
    let tau = TransferFunction::extinction(0.4, 1.0) / kernel.integral();
    for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 40.0 }] {
        // 3 voxels to a pixel, at the target, which is the voxel's place.
        let view = View { view_height: Some(33.0), projection, ..View::default() };
        let camera = Camera::new(&view, volume.grid(), [11, 11]).unwrap();
        let picture = scene.render(&camera).unwrap();
        let mut seen = 0;
        for (i, got) in (0_u32..).zip(picture.pixels()) {
            let (sx, sy) = camera.image_coordinates([i % 11, i / 11]);
            let (origin, direction) = camera.ray(sx, sy);
            let r = (DVec3::splat(2.0) - origin).cross(direction).length();
            // The chord and its amplitude: 3 / 27 of the footprint at a third of the distance.
            let expected = 1.0 - (-tau * footprint(r / 3.0) / 9.0).exp();
            assert!((f64::from(got[3]) - expected).abs() < 1e-7, "{projection:?} {r}: {} is not {expected}", got[3]);
            seen += u32::from(expected > 0.0);
        }
        assert!(seen > 10);
    }
}

#[test]
fn growth_is_off_without_antialiasing_and_for_single_rays() {
    let kernel = Kernel::default();
    let volume = volume([5, 5, 5], DMat3::IDENTITY, &[([2, 2, 2], 1)]);
    let still = Settings { antialiasing: false, ..Settings::default() };
    let camera = Camera::new(&View { view_height: Some(33.0), ..View::default() }, volume.grid(), [11, 11]).unwrap();
    let tau = TransferFunction::extinction(0.4, 1.0) / kernel.integral();
    let expected = 1.0 - (-tau * footprint(0.0)).exp();
    let picture = Reference::new(&volume, &tones(), &still).unwrap().render(&camera).unwrap();
    assert!((f64::from(picture.pixels()[60][3]) - expected).abs() < 1e-7);
    let (origin, direction) = camera.ray(0.0, 0.0);
    assert!((prepared(&volume, &kernel).ray(origin, direction, true).alpha() - expected).abs() < 1e-9);
}

#[test]
fn xray_adds_optical_depth() {
    let scene = Reference::new(
        &volume([5, 9, 5], DMat3::IDENTITY, &[([2, 2, 2], 1), ([2, 5, 2], 2)]),
        &tones(),
        &settings(Kernel::default(), Model::Xray, Shading::Pre),
    )
    .unwrap();
    let tau = TransferFunction::extinction(0.4, 1.0) + TransferFunction::extinction(0.7, 1.0);
    let r = DVec3::new(0.5, 0.0, 0.7);
    let expected = 1.0 - (-tau / Kernel::default().integral() * footprint(r.length())).exp();
    let got = scene.ray(DVec3::new(2.0, -9.0, 2.0) + r, DVec3::Y, true);
    assert_close(got.rgba(), [expected; 4], 1e-10, "two voxels");
}

/// Returns a volume and a function whose red rises with x, y and z in the lattice; the middle voxel alone is visible.
fn hill(matrix: DMat3) -> (Volume, TransferFunction, DVec3) {
    let grid = Grid::new([3, 3, 3], DAffine3::from_mat3(matrix)).unwrap();
    let volume = floats(grid, |p| p.dot(DVec3::new(1.0, 10.0, 100.0)));
    let transfer = ramp(&[(110.5, 0.0), (111.0, 0.6), (111.5, 0.0)], 1.0);
    (volume, transfer, grid.to_lattice().matrix3.transpose() * DVec3::new(1.0, 10.0, 100.0))
}

#[test]
fn a_lit_voxel_shows_its_shade() {
    let matrix = DMat3::from_cols(DVec3::new(0.5, 0.1, 0.0), DVec3::new(-0.2, 1.0, 0.3), DVec3::new(0.0, 0.4, 2.0));
    let (volume, transfer, gradient) = hill(matrix);
    let lighting = Lighting {
        lights: vec![
            Light::HEADLIGHT,
            Light::directional(DVec3::new(1.0, -2.0, 3.0)),
            Light::at(DVec3::new(-4.0, 3.0, 9.0)),
        ],
        normals: Normals::Gradient,
        ..Lighting::default()
    };
    let lit = Settings { lighting: Some(lighting.clone()), ..Settings::default() };
    let scene = Reference::new(&volume, &transfer, &lit).unwrap();
    let center = matrix * DVec3::ONE;
    let direction = DVec3::new(0.3, -0.5, 0.7).normalize();
    let origin = center - direction * 3.0 + DVec3::new(0.2, 0.1, -0.3);
    for (two_sided, to_eye) in [(true, -direction), (false, (origin - center).normalize())] {
        let got = scene.ray(origin, direction, two_sided);
        let shade = lighting.shade([0.5, 0.5, 0.25], gradient, center, to_eye, &Visibility::FULL);
        let [r, g, b] = shade.map(|c| c * got.alpha());
        assert!(got.alpha() > 0.01);
        assert_close(got.rgba(), [r, g, b, got.alpha()], 1e-10, "shade");
    }
}

#[test]
fn gradients_at_the_edge_take_the_edge_for_its_neighbour() {
    let volume = floats(Grid::axis_parallel([2, 1, 1], [2.0; 3]).unwrap(), |p| p.x);
    let layers = Layers::of_volume(&volume, &ramp(&[(0.0, 0.1), (1.0, 0.2)], 1.0));
    let lighting = Some(Lighting { normals: Normals::Gradient, ..Lighting::default() });
    let media = media::Media::new(&layers, &Settings { lighting, ..Settings::default() }).unwrap();
    for x in 0..2 {
        // A step of 1 per 2 world units, by the weights of the differences of voxels 1 and 2 to either side.
        let expected = DVec3::new(0.5 * (0.278_979 + 0.110_51), 0.0, 0.0);
        assert!(media.voxel([x, 0, 0], true).2.abs_diff_eq(expected, 1e-6));
    }
}

#[test]
fn wrong_settings_are_refused() {
    let volume = bumps();
    let wrong = Settings { lighting: Some(Lighting::default()), model: Model::Mip, ..Settings::default() };
    assert!(matches!(Reference::new(&volume, &tones(), &wrong), Err(Error::Setting { .. })));
}

#[test]
fn finer_steps_change_nothing() {
    let volume = crate::formats::load("demo:marschner-lobb:16", &crate::formats::LoadOptions::default()).unwrap();
    let transfer = crate::appearance::demos::demo_transfer("marschner-lobb").unwrap();
    let lights = vec![Light::HEADLIGHT, Light::directional(DVec3::new(0.2, -1.0, 0.5))];
    let light = Lighting { lights, ambient: 0.6, ..Lighting::default() };
    for (model, shading, lighting) in [
        (Model::Composite, Shading::Pre, None),
        (Model::Composite, Shading::Post, None),
        (Model::Composite, Shading::Post, Some(light)),
        (Model::Mip, Shading::Post, None),
    ] {
        let how = Settings { lighting, ..settings(Kernel::default(), model, shading) };
        let scene = Reference::new(&volume, &transfer, &how).unwrap();
        let mut finer = Reference::new(&volume, &transfer, &how).unwrap();
        finer.longest *= 0.21;
        let mut worst = 0.0_f64;
        for i in 0..40 {
            // Along an axis, where chords end together and pieces are longest, and across.
            let turn = DQuat::from_scaled_axis(DVec3::new(0.3, 1.2, -0.7) * f64::from(i % 4));
            let (u, v) = (f64::from(i * 7 % 40) / 40.0 - 0.5, f64::from(i) / 40.0 - 0.5);
            let diameter = volume.grid().corners(0.5)[0].distance(volume.grid().center());
            let origin = volume.grid().center() + turn * DVec3::new(u, 0.0, v) * diameter;
            let [a, b] = [&scene, &finer].map(|s| s.ray(origin, turn * DVec3::Y, true).rgba());
            worst = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(worst, f64::max);
        }
        assert!(worst < 1e-8, "{model:?} {shading:?}: {worst:e}");
    }
}

#[test]
fn some_pixels_are_those_of_the_picture() {
    let volume = volume([5, 4, 3], DMat3::IDENTITY, &[([1, 1, 1], 1), ([3, 2, 1], 2)]);
    let reference = prepared(&volume, &Kernel::default());
    let view = View { azimuth: 20.0, projection: ProjectionKind::Perspective { fov: 30.0 }, ..View::default() };
    let camera = Camera::new(&view, volume.grid(), [9, 7]).unwrap();
    let image = reference.render(&camera).unwrap();
    let places = [[4, 3], [8, 6], [0, 0], [5, 2], [4, 3]];
    let some = reference.pixels(&camera, &places).unwrap();
    for ([x, y], pixel) in places.into_iter().zip(&some) {
        assert_eq!(image.pixels()[(y * 9 + x) as usize], pixel.map(|v| v as f32));
    }
    assert!(some[0][3] > 0.1 && reference.pixels(&camera, &[]).unwrap().is_empty());
}
