//! Projections beside the composite: what an X-ray shows of optical depth.

use voxsplat::camera::{ProjectionKind, View};
use voxsplat::kernel::Normalization;
use voxsplat::settings::{Level, Model, Resolution, Response, Settings};

use crate::support::{PERSPECTIVE, PROJECTIONS, camera, demo, errors, exact_quads, full, look, picture, render};
use crate::support::{rms_covered, with_tiles};
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
            let rays = with_tiles(&quads, Resolution::Full);
            let expected = truth(&volume, &transfer, &camera, &quads);
            let deepest = expected.pixels().iter().map(|p| f64::from(p[0])).fold(0.0, f64::max);
            // Normalised to the peak of kernels there is twelve times as much, and of an alpha nothing is left to see.
            let deep = normalization == Normalization::Peak;
            assert!(response != Response::Depth || deepest > if deep { 12.0 } else { 1.0 }, "{deepest}");
            let unit = if response == Response::Depth { deepest } else { 1.0 };
            let steep = if deep { 8.0 } else { 1.0 };
            for (settings, most) in [(quads, 4e-5), (rays.clone(), 3e-4), (with_tiles(&rays, Resolution::Capped), 4e-3)]
            {
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
