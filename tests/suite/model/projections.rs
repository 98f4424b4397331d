//! Projections other than the composite: the responses of an X-ray, minimum and average intensity.

use glam::DVec3;
use voxsplat::camera::{ProjectionKind, View};
use voxsplat::kernel::{Kernel, Normalization};
use voxsplat::settings::{Level, Model, Response, Settings};
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{PERSPECTIVE, PROJECTIONS, camera, demo, errors, exact_quads, full, look, picture, render};
use crate::support::{rms_covered, thick, transfer, with_tiles};
use crate::truth::truth;

#[test]
fn an_xray_shows_depth_as_the_reference_does() {
    let (volume, transfer) = demo("shepp-logan", 32);
    let responses = [Response::Depth, Response::WINDOW, Response::FILM, Response::Film { exposure: 1e3, gamma: 1.5 }];
    for response in responses {
        for (projection, normalization) in [
            (PROJECTIONS[0], Normalization::Unit),
            (PERSPECTIVE, Normalization::Unit),
            (PROJECTIONS[0], Normalization::Peak),
        ] {
            let camera = camera(33.0, projection, &volume, 40);
            let xray = |base: Settings| Settings { model: Model::Xray, response, normalization, ..base };
            let quads = xray(exact_quads());
            let rays = with_tiles(&quads);
            let expected = truth(&volume, &transfer, &camera, &quads);
            let deepest = expected.pixels().iter().map(|p| f64::from(p[0])).fold(0.0, f64::max);
            // Normalised to the peak of kernels, optical depth is twelve times as large, and alpha is 1 everywhere.
            let deep = normalization == Normalization::Peak;
            assert!(response != Response::Depth || deepest > if deep { 12.0 } else { 1.0 }, "{deepest}");
            let unit = if response == Response::Depth { deepest } else { 1.0 };
            let steep = if deep { 8.0 } else { 1.0 };
            for (settings, most) in [(quads, 4e-5), (rays, 3e-4)] {
                let got = render(&volume, &transfer, &camera, &settings);
                let (color, alpha) = errors(&got, &expected);
                let painter = &settings.painter;
                println!("{response} {normalization:?} {painter:?}: {:e} {alpha:e}", color / unit);
                assert!(
                    color < most * unit * steep && alpha < most * steep,
                    "{response} {painter:?}: {color:e} {alpha:e}"
                );
            }
        }
    }
}

#[test]
fn layers_of_cells_add_up_to_the_depth() {
    let (volume, transfer) = demo("shepp-logan", 48);
    let projection = ProjectionKind::Perspective { fov: 60.0 };
    let view = View { azimuth: 30.0, elevation: 20.0, projection, zoom: 0.5, ..View::default() };
    let camera = look(&view, &volume, [64; 2]);
    for response in [Response::Depth, Response::FILM] {
        let settings = Settings { model: Model::Xray, response, level: Level::Auto, ..full() };
        let settings = Settings { antialiasing: true, ..settings };
        let got = picture(&volume, &transfer, &camera, &settings);
        assert!(got.stats.levels[0] < got.stats.levels[1], "{:?}", got.stats.levels);
        let rms = rms_covered(&got.image, &truth(&volume, &transfer, &camera, &settings));
        assert!(rms < 1e-2, "{response}: {rms:e}");
    }
}

/// Quads with thin sheets, and rays.
fn both_painters(model: Model, kernel: Kernel) -> [Settings; 2] {
    let quads = thick(&Settings { model, kernel, ..exact_quads() }, 0.25);
    [with_tiles(&quads), quads]
}

#[test]
fn minimum_and_average_follow_the_reference() {
    // Grey over all values, so that nothing is invisible; and a function with a step.
    let (volume, _) = demo("marschner-lobb", 24);
    let [dark, light] = [[0.1, 0.0, 0.0], [1.0, 0.9, 0.8]];
    let ramp = transfer(&[(0.0, dark, 0.0), (1.0, light, 0.9)], None);
    let stepped = transfer(&[(0.0, dark, 0.2), (0.4, light, 0.4), (0.4, dark, 0.9), (1.0, light, 0.9)], None);
    for (model, kernel, transfer, most) in [
        (Model::Minip, Kernel::KAISER_BESSEL, &ramp, 6e-3),
        (Model::Minip, Kernel::default(), &ramp, 3e-2),
        (Model::Average, Kernel::KAISER_BESSEL, &ramp, 1.5e-3),
        (Model::Average, Kernel::default(), &ramp, 4e-3),
        (Model::Average, Kernel::KAISER_BESSEL, &stepped, 2e-2),
    ] {
        for projection in PROJECTIONS {
            let camera = camera(33.0, projection, &volume, 40);
            for settings in both_painters(model, kernel) {
                let expected = truth(&volume, transfer, &camera, &settings);
                let rms = rms_covered(&render(&volume, transfer, &camera, &settings), &expected);
                println!("{model} {kernel} {projection:?} {:?}: {rms:e}", settings.painter);
                assert!(rms < most, "{model} {kernel} {projection:?} {:?}: {rms:e}", settings.painter);
            }
        }
    }
}

#[test]
fn a_minimum_is_the_maximum_of_what_is_mirrored() {
    let (volume, transfer_function) = demo("marschner-lobb", 16);
    let mirrored = volume.clone().with_rescale(-1.0, 0.0).unwrap();
    let points: Vec<_> = transfer_function.points().iter().rev().map(|p| (-p.value, p.color, p.opacity)).collect();
    let opposite = transfer(&points, None);
    let camera = camera(33.0, PERSPECTIVE, &volume, 32);
    for settings in both_painters(Model::Minip, Kernel::default()) {
        let least = render(&volume, &transfer_function, &camera, &settings);
        let most = render(&mirrored, &opposite, &camera, &Settings { model: Model::Mip, ..settings });
        assert_eq!(least, most);
    }
}

#[test]
fn what_is_outside_of_the_box_does_not_count() {
    // A ramp along x, and a transfer function that shows values as alpha. The box of the voxels is 1:1:10.
    let size = 16;
    let values: Vec<f32> = (0..size * size * size).map(|i| 1.0 + (i % size) as f32).collect();
    let grid = Grid::axis_parallel([size; 3], [1.0, 1.0, 10.0]).unwrap();
    let volume = Volume::new(grid, Samples::F32(values)).unwrap();
    let transfer = transfer(&[(0.0, [1.0; 3], 0.0), (16.0, [1.0; 3], 0.8)], None);
    let along = |direction: DVec3| {
        let view = View { direction: Some(direction), view_height: Some(8.0), ..View::default() };
        look(&view, &volume, [9; 2])
    };
    for (model, of_ramp) in [(Model::Minip, 1.0), (Model::Mip, 16.0), (Model::Average, 8.5)] {
        for settings in both_painters(model, Kernel::KAISER_BESSEL) {
            for (direction, expected) in [(DVec3::X, of_ramp), (DVec3::NEG_X, of_ramp), (DVec3::Y, 8.5)] {
                let picture = render(&volume, &transfer, &along(direction), &settings);
                let middle = 16.0 * f64::from(picture.pixels()[40][3]);
                let painter = &settings.painter;
                // At the faces copies of the outermost voxels flatten the ramp. Kernels have ripples of 5e-4.
                assert!((middle - expected).abs() < 0.03, "{model} {direction} {painter:?}: {middle} for {expected}");
            }
        }
    }
}

#[test]
fn the_mean_of_one_bright_voxel_is_exact() {
    let mut values = vec![0.0_f32; 12 * 11 * 10];
    values[5 + 12 * (5 + 11 * 4)] = 1.0;
    let grid = Grid::axis_parallel([12, 11, 10], [1.0, 1.0, 3.0]).unwrap();
    let volume = Volume::new(grid, Samples::F32(values)).unwrap();
    let transfer = transfer(&[(0.0, [1.0; 3], 0.0), (0.02, [1.0; 3], 0.8)], None);
    for projection in PROJECTIONS {
        let camera = camera(33.0, projection, &volume, 40);
        for settings in both_painters(Model::Average, Kernel::default()) {
            let expected = truth(&volume, &transfer, &camera, &settings);
            let brightest = expected.pixels().iter().map(|p| p[3]).fold(0.0, f32::max);
            assert!(brightest > 0.3, "{brightest}");
            let (color, alpha) = errors(&render(&volume, &transfer, &camera, &settings), &expected);
            let painter = &settings.painter;
            assert!(color < 6e-4 && alpha < 6e-4, "{projection:?} {painter:?}: {color:e} {alpha:e}");
        }
    }
}

#[test]
fn colours_of_depth_follow_the_reference() {
    let (volume, _) = demo("vessels", 32);
    let ramp = transfer(&[(0.0, [0.1, 0.0, 0.0], 0.0), (100.0, [1.0, 0.9, 0.8], 0.9)], None);
    for (model, azimuth) in [(Model::Mip, 30.0), (Model::Mip, 250.0), (Model::Minip, 120.0)] {
        for projection in PROJECTIONS {
            let camera = camera(azimuth, projection, &volume, 64);
            for plain in both_painters(model, Kernel::KAISER_BESSEL) {
                let settings = Settings { depth_coded: true, ..plain };
                let expected = truth(&volume, &ramp, &camera, &settings);
                let rms = rms_covered(&render(&volume, &ramp, &camera, &settings), &expected);
                let painter = &settings.painter;
                println!("{model} {azimuth} {projection:?} {painter:?}: {rms:e}");
                // Single pixels have two nearly equal maxima at different depths.
                assert!(rms < 2e-2, "{model} {azimuth} {projection:?} {painter:?}: {rms:e}");
            }
        }
    }
}

#[test]
fn attenuated_maxima_follow_the_reference() {
    let (volume, _) = demo("vessels", 32);
    let ramp = transfer(&[(0.0, [0.1, 0.0, 0.0], 0.0), (100.0, [1.0, 0.9, 0.8], 0.9)], None);
    for projection in PROJECTIONS {
        let camera = camera(30.0, projection, &volume, 64);
        for plain in both_painters(Model::Mip, Kernel::KAISER_BESSEL) {
            let settings = Settings { attenuation: 2.0, ..plain.clone() };
            let expected = truth(&volume, &ramp, &camera, &settings);
            let image = render(&volume, &ramp, &camera, &settings);
            let error = rms_covered(&image, &expected);
            let without = rms_covered(&render(&volume, &ramp, &camera, &plain), &expected);
            println!("{projection:?} {:?}: {error:e}, effect {without:e}", settings.painter);
            // 1.5 times the measured errors.
            assert!(error < 6e-3 && without > 0.1, "{projection:?} {:?}: {error:e}", settings.painter);
        }
    }
}

#[test]
fn the_farther_a_maximum_is_the_dimmer() {
    let ramp = transfer(&[(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], 0.9)], None);
    for bright in [2, 8, 14_u32] {
        let values: Vec<f32> = (0..17_u32.pow(3)).map(|i| if i / (17 * 17) == bright { 1.0 } else { 0.0 }).collect();
        let volume = Volume::new(Grid::axis_parallel([17; 3], [1.0; 3]).unwrap(), Samples::F32(values)).unwrap();
        let view = View { direction: Some(DVec3::Z), up: DVec3::Y, view_height: Some(8.0), ..View::default() };
        for plain in both_painters(Model::Mip, Kernel::KAISER_BESSEL) {
            let attenuated = Settings { attenuation: 1.5, ..plain.clone() };
            let camera = look(&view, &volume, [9; 2]);
            let alpha = |settings| f64::from(render(&volume, &ramp, &camera, settings).pixels()[40][3]);
            let share = alpha(&attenuated) / alpha(&plain);
            // The box is 17 deep, and the plane's maximum within a tenth of its middle.
            let expected = (-1.5 * (f64::from(bright) + 0.5) / 17.0).exp();
            assert!((share / expected - 1.0).abs() < 0.01, "{bright} {:?}: {share} for {expected}", plain.painter);
        }
    }
}

#[test]
fn the_nearest_is_red_and_the_farthest_violet() {
    // Bright planes across a box, seen along z.
    let transfer = transfer(&[(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], 0.9)], None);
    for (bright, expected) in [(0, [1.0, 0.0, 0.0]), (8, [0.0, 1.0, 0.25]), (16, [0.5, 0.0, 1.0])] {
        let values: Vec<f32> = (0..17_u32.pow(3)).map(|i| if i / (17 * 17) == bright { 1.0 } else { 0.0 }).collect();
        let volume = Volume::new(Grid::axis_parallel([17; 3], [1.0; 3]).unwrap(), Samples::F32(values)).unwrap();
        let view = View { direction: Some(DVec3::Z), up: DVec3::Y, view_height: Some(8.0), ..View::default() };
        for settings in both_painters(Model::Mip, Kernel::KAISER_BESSEL) {
            let settings = Settings { depth_coded: true, ..settings };
            let picture = render(&volume, &transfer, &look(&view, &volume, [9; 2]), &settings);
            let [r, g, b, a] = picture.pixels()[40].map(f64::from);
            let color = [r / a, g / a, b / a];
            // The maximum of a plane is half a voxel from an end of the box, or up to a voxel away in the copies beyond
            // the end.
            let off = (0..3).map(|c| (color[c] - expected[c]).abs()).fold(0.0, f64::max);
            assert!(off < 0.3, "{bright} {:?}: {color:?}", settings.painter);
        }
    }
}
