//! The density of the rays of the painter `tiles`, and the changes of pictures if the density or the axis changes.

use voxsplat::Image;
use voxsplat::camera::{ProjectionKind, View};
use voxsplat::kernel::Kernel;
use voxsplat::settings::{Model, Resolution, Settings, Shading};
use voxsplat::stats::RaySpacing;
use voxsplat::volume::{Grid, Samples, Volume};

use crate::painters::tiles::{camera, from_eye};
use crate::support::{by_tiles, demo, draw, full, look, picture, prepare, rms_in_steps, transfer, with_tiles};
use crate::truth::truth;

#[test]
fn a_ray_per_voxel_errs_by_less_than_half_a_step() {
    for (name, size) in [("marschner-lobb", 48), ("shell", 64), ("vessels", 48), ("shepp-logan", 48)] {
        let (volume, transfer) = demo(name, size);
        for (azimuth, elevation) in [(30.0, 20.0), (100.0, -50.0), (215.0, 10.0), (30.0, 4.0)] {
            let exact = full();
            let settings = with_tiles(&exact, Resolution::Capped);
            let camera = camera(azimuth, elevation, 1.0, &volume, 300);
            let expected = picture(&volume, &transfer, &camera, &exact);
            let got = picture(&volume, &transfer, &camera, &settings);
            assert!(matches!(by_tiles(&got).spacing, Some(RaySpacing::PerVoxel(_))), "{name} {azimuth} {elevation}");
            let error = rms_in_steps(&got.image, &expected.image);
            assert!(error < 0.45, "{name} {azimuth} {elevation}: {error}");
        }
    }
}

/// The largest change of a channel between two pictures.
fn change(a: &Image, b: &Image) -> f32 {
    let pairs = a.pixels().as_flattened().iter().zip(b.pixels().as_flattened());
    pairs.fold(0.0, |worst, (p, q)| worst.max((p - q).abs()))
}

#[test]
fn capped_rays_serve_every_kernel_lattice_and_volume() {
    let gaussian = |sigma, radius| Kernel::Gaussian { sigma, radius };
    let blob = Kernel::KaiserBessel { radius: 1.5, alpha: 6.0 };
    let capped = |kernel| Settings { kernel, ..with_tiles(&full(), Resolution::Capped) };
    let (waves, colors) = demo("marschner-lobb", 24);
    let six = [[2, 3, 4], [9, 8, 3], [5, 5, 9], [8, 2, 8], [3, 9, 6], [6, 7, 2]];
    let is_bright = |n: usize| six.contains(&[n % 12, n / 12 % 12, n / 144]);
    let dots = (0..12 * 12 * 12).map(|n| f32::from(u8::from(is_bright(n)))).collect();
    let dots = Volume::new(Grid::axis_parallel([12; 3], [1.0; 3]).unwrap(), Samples::F32(dots)).unwrap();
    // Independent voxels, by a permutation of 24^3 places (Knuth's multiplier).
    let noise = (0..24_u32.pow(3)).map(|n| n.wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32).collect();
    let noise = Volume::new(Grid::axis_parallel([24; 3], [1.0; 3]).unwrap(), Samples::F32(noise)).unwrap();
    let ramp = |opacity| transfer(&[(0.0, [0.2, 0.4, 0.9], 0.0), (1.0, [1.0, 0.8, 0.3], opacity)], None);
    let long = Grid::axis_parallel([24; 3], [1.0, 1.0, 4.0]).unwrap();
    let long = waves.clone().with_grid(long).unwrap();
    let standard = Kernel::default();
    let cases = [
        (&waves, colors.clone(), capped(gaussian(1.0, 0.5)), [30.0, 20.0], 96),
        (&waves, colors.clone(), capped(gaussian(0.5, 1.0)), [30.0, 20.0], 96),
        (&waves, colors.clone(), capped(gaussian(1.0, 1.0)), [30.0, 20.0], 96),
        (&waves, colors.clone(), capped(gaussian(1.0, 1.5)), [30.0, 20.0], 96),
        (&waves, colors.clone(), capped(blob), [30.0, 20.0], 96),
        (&waves, colors.clone(), capped(standard), [30.0, 20.0], 64),
        (&waves, colors.clone(), capped(standard), [13.0, 0.0], 128),
        (&waves, colors.clone(), capped(standard), [42.0, 0.0], 128),
        (&long, colors, capped(standard), [0.0, 45.0], 192),
        (&dots, ramp(0.3), capped(standard), [30.0, 20.0], 128),
        (&dots, ramp(0.99), capped(standard), [30.0, 20.0], 128),
        (&noise, ramp(0.3), capped(standard), [30.0, 20.0], 128),
        (&noise, ramp(0.99), capped(standard), [70.0, 10.0], 128),
    ];
    for (number, (volume, transfer, settings, [azimuth, elevation], size)) in cases.into_iter().enumerate() {
        let exact = with_tiles(&settings, Resolution::Full);
        let parallel = View { azimuth, elevation, ..View::default() };
        let through_eye = View { projection: ProjectionKind::Perspective { fov: 30.0 }, ..parallel.clone() };
        for view in [parallel, through_eye] {
            let camera = look(&view, volume, [size; 2]);
            let got = picture(volume, &transfer, &camera, &settings).image;
            let expected = picture(volume, &transfer, &camera, &exact).image;
            let (rms, worst) = (rms_in_steps(&got, &expected), change(&got, &expected));
            assert!(rms < 0.45 && worst < 1.2e-2, "case {number}, {:?}: {rms}, {worst:e}", view.projection);
        }
    }
}

/// The change by a thousandth of a degree, with tiles and in truth.
fn pop(source: (&str, u32), settings: &Settings, view: &View, size: u32) -> (f32, f32) {
    let (volume, transfer) = demo(source.0, source.1);
    let cameras = [-0.0005, 0.0005].map(|degrees| {
        let view = View { azimuth: view.azimuth + degrees, ..view.clone() };
        look(&view, &volume, [size; 2])
    });
    let scene = prepare(&volume, &transfer, settings);
    let [a, b] = cameras.each_ref().map(|camera| draw(&scene, camera, settings).image);
    let [c, d] = cameras.each_ref().map(|camera| truth(&volume, &transfer, camera, settings));
    (change(&a, &b), change(&c, &d))
}

#[test]
fn turning_over_a_tie_of_axes_changes_pictures_as_the_reference() {
    let capped = with_tiles(&full(), Resolution::Capped);
    let post = Settings { shading: Shading::Post, ..full() };
    let perspective = ProjectionKind::Perspective { fov: 30.0 };
    let parallel = View { azimuth: 45.0, elevation: 20.0, ..View::default() };
    let diagonal = View { azimuth: 45.0, elevation: 35.264, ..View::default() };
    let through_eye = View { projection: perspective, ..parallel.clone() };
    let cases = [
        (full(), parallel.clone()),
        (capped.clone(), parallel.clone()),
        (capped.clone(), diagonal.clone()),
        (capped.clone(), through_eye.clone()),
        (Settings { model: Model::Xray, ..capped }, parallel.clone()),
        (Settings { model: Model::Mip, ..full() }, parallel.clone()),
        (post.clone(), parallel.clone()),
        (post, through_eye.clone()),
    ];
    for (settings, view) in cases {
        let (got, expected) = pop(("shell", 24), &settings, &view, 48);
        assert!(got < expected + 1e-3, "{settings:?} {view:?}: {got:e} for {expected:e}");
    }
}

#[test]
fn turning_past_numbers_of_rays_changes_pictures_as_the_reference() {
    let capped = with_tiles(&full(), Resolution::Capped);
    // Elevation 0: one shear is 0, and the other passes every change of the number of rays.
    for azimuth in [1.72, 2.86, 3.434, 4.0, 5.14, 8.53, 10.204, 12.4, 42.92, 43.531, 44.13] {
        let view = View { azimuth, ..View::default() };
        let (got, expected) = pop(("marschner-lobb", 24), &capped, &view, 80);
        assert!(got < expected + 1e-3, "{azimuth}: {got:e} for {expected:e}");
    }
}

#[test]
#[ignore = "slow: 850 pictures and their truths"]
fn a_turn_in_steps_of_up_to_a_degree_changes_pictures_as_the_reference() {
    let capped = with_tiles(&full(), Resolution::Capped);
    let post = Settings { shading: Shading::Post, ..full() };
    let through_eye = ProjectionKind::Perspective { fov: 30.0 };
    let (volume, transfer) = demo("shell", 24);
    let frames = |settings: &Settings, azimuth: f64, projection| {
        let view = View { azimuth, elevation: 20.0, projection, ..View::default() };
        let camera = look(&view, &volume, [28; 2]);
        let got = picture(&volume, &transfer, &camera, settings).image;
        (got, truth(&volume, &transfer, &camera, settings))
    };
    let mut worst = [0.0_f32; 2];
    let mut turn = |settings: &Settings, projection, azimuths: &mut dyn Iterator<Item = f64>| {
        let mut before: Option<(Image, Image)> = None;
        for azimuth in azimuths {
            let (got, expected) = frames(settings, azimuth, projection);
            if let Some((got_before, expected_before)) = &before {
                let beyond = change(&got, got_before) - change(&expected, expected_before);
                // Slabs of scalars are classified by their means: single pixels err by more than a step.
                let limit = if settings.is_post_shaded() { 8e-3 } else { 1.0 / 255.0 };
                let worst = &mut worst[usize::from(settings.is_post_shaded())];
                *worst = worst.max(beyond);
                assert!(beyond < limit, "{settings:?} {projection:?} at {azimuth}: {beyond:e}");
            }
            before = Some((got, expected));
        }
    };
    turn(&capped, ProjectionKind::Orthographic, &mut (0..=360).map(f64::from));
    turn(&capped, through_eye, &mut (0..=90).map(f64::from));
    turn(&post, ProjectionKind::Orthographic, &mut (0..=90).map(f64::from));
    // Around a tie of axes, and around a change of the number of rays.
    for step in [0.01, 0.1] {
        for place in [45.0, 43.5] {
            for settings in [&capped, &post] {
                let around = (-10..=10).map(|n| place + step * f64::from(n));
                turn(settings, ProjectionKind::Orthographic, &mut around.clone());
                turn(settings, through_eye, &mut around.clone());
            }
        }
    }
    println!("a turn: at most {worst:?} beyond the reference");
}

#[test]
fn a_seam_between_axes_inside_a_picture_does_not_show() {
    // Through one eye at 45 degrees, half of the pixels are nearest to one axis and half to the other.
    let (volume, transfer) = demo("shell", 24);
    for settings in [full(), Settings { shading: Shading::Post, ..full() }] {
        let camera = from_eye([45.0, 0.0, 30.0], None, &volume, 65);
        let got = picture(&volume, &transfer, &camera, &settings).image;
        let expected = truth(&volume, &transfer, &camera, &settings);
        let error = |x: usize, y: usize| f64::from(got.pixels()[y * 65 + x][3] - expected.pixels()[y * 65 + x][3]);
        // The second difference of the error across the seam, against the columns around it.
        let jump = |x: usize| {
            let rows = (0..65).map(|y| (error(x - 1, y) - 2.0 * error(x, y) + error(x + 1, y)).abs());
            rows.fold(0.0, f64::max)
        };
        let around = (24..=40).filter(|x| !(30..=34).contains(x)).map(jump).fold(0.0, f64::max);
        let seam = (30..=34).map(jump).fold(0.0, f64::max);
        assert!(seam < around + 1e-3, "{:?}: {seam:e}, elsewhere {around:e}", settings.shading);
    }
}

#[test]
fn a_coarser_raster_errs_by_less_than_half_a_step() {
    for (name, size) in [("marschner-lobb", 48), ("shell", 48), ("vessels", 40), ("shepp-logan", 48)] {
        let (volume, transfer) = demo(name, size);
        for (eye, zoom) in [([0.0, 0.0, 30.0], 1.3), ([45.0, 35.0, 60.0], 3.0), ([215.0, -50.0, 30.0], 2.0)] {
            let exact = full();
            let settings = with_tiles(&exact, Resolution::Capped);
            let [azimuth, elevation, fov] = eye;
            let projection = ProjectionKind::Perspective { fov };
            let view = View { azimuth, elevation, projection, zoom, ..View::default() };
            let camera = look(&view, &volume, [240; 2]);
            let expected = picture(&volume, &transfer, &camera, &exact);
            let got = picture(&volume, &transfer, &camera, &settings);
            assert_eq!(by_tiles(&expected).spacing, Some(RaySpacing::Pixels(1.0)));
            assert!(matches!(by_tiles(&got).spacing, Some(RaySpacing::Pixels(pitch)) if pitch > 1.2), "{name} {eye:?}");
            assert!(by_tiles(&got).rays < by_tiles(&expected).rays, "{name} {eye:?}");
            let error = rms_in_steps(&got.image, &expected.image);
            assert!(error < 0.45, "{name} {eye:?}: {error}");
        }
    }
}
