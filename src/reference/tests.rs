//! The reference against closed forms and brute force.

use glam::{DAffine3, DMat3, DQuat};

use super::*;
use crate::camera::{ProjectionKind, View};
use crate::transfer::ControlPoint;
use crate::volume::Samples;

fn point(value: f64, color: [f64; 3], opacity: f64) -> ControlPoint {
    ControlPoint { value, color, opacity }
}

/// Values 0, 1 and 2 are air, red-ish of opacity 0.4 and blue-ish of opacity 0.7 per unit.
fn tones() -> TransferFunction {
    let (red, blue) = ([0.9, 0.3, 0.1], [0.2, 0.4, 0.8]);
    TransferFunction::new(
        vec![point(0.0, red, 0.0), point(0.9, red, 0.0), point(1.0, red, 0.4), point(2.0, blue, 0.7)],
        Some(1.0),
    )
    .unwrap()
}

fn volume(dims: [u32; 3], matrix: DMat3, voxels: &[([u32; 3], u8)]) -> Volume {
    let mut samples = vec![0; dims.iter().product::<u32>() as usize];
    for &([x, y, z], value) in voxels {
        samples[((z * dims[1] + y) * dims[0] + x) as usize] = value;
    }
    Volume::new(Grid::new(dims, DAffine3::from_mat3(matrix)).unwrap(), Samples::U8(samples)).unwrap()
}

fn prepared(volume: &Volume, kernel: &Kernel) -> Scene {
    Scene::new(volume, &tones(), &Settings { kernel: *kernel, ..Settings::default() }).unwrap()
}

/// erf by its Maclaurin series (Abramowitz and Stegun 7.1.5), for |x| up to about 3.
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

/// Line integral of the Gaussian of sigma 1 cut at 2, at distance r from its centre.
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
    let a = prepared(&still, &kernel).render(&camera, [16, 12], &|_| ()).unwrap();
    let b = prepared(&moved, &kernel).render(&turned, [16, 12], &|_| ()).unwrap();
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
