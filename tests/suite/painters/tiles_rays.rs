//! The axes that rays of the painter `tiles` run along, and the changes of pictures if the axis changes.

use voxsplat::Image;
use voxsplat::camera::{ProjectionKind, View};
use voxsplat::settings::{Model, Settings, Shading};

use crate::painters::tiles::from_eye;
use crate::support::{demo, draw, full, look, picture, prepare};
use crate::truth::truth;

/// The largest change of a channel between two pictures.
fn change(a: &Image, b: &Image) -> f32 {
    let pairs = a.pixels().as_flattened().iter().zip(b.pixels().as_flattened());
    pairs.fold(0.0, |worst, (p, q)| worst.max((p - q).abs()))
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
    let post = Settings { shading: Shading::Post, ..full() };
    let perspective = ProjectionKind::Perspective { fov: 30.0 };
    let parallel = View { azimuth: 45.0, elevation: 20.0, ..View::default() };
    let diagonal = View { azimuth: 45.0, elevation: 35.264, ..View::default() };
    let through_eye = View { projection: perspective, ..parallel.clone() };
    let cases = [
        (full(), parallel.clone()),
        (full(), diagonal.clone()),
        (full(), through_eye.clone()),
        (Settings { model: Model::Xray, ..full() }, parallel.clone()),
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
#[ignore = "slow: 710 pictures and their truths"]
fn a_turn_in_steps_of_up_to_a_degree_changes_pictures_as_the_reference() {
    let (pre, post) = (full(), Settings { shading: Shading::Post, ..full() });
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
    turn(&pre, ProjectionKind::Orthographic, &mut (0..=360).map(f64::from));
    turn(&pre, through_eye, &mut (0..=90).map(f64::from));
    turn(&post, ProjectionKind::Orthographic, &mut (0..=90).map(f64::from));
    // Around a tie of axes.
    for step in [0.01, 0.1] {
        for settings in [&pre, &post] {
            let around = (-10..=10).map(|n| 45.0 + step * f64::from(n));
            turn(settings, ProjectionKind::Orthographic, &mut around.clone());
            turn(settings, through_eye, &mut around.clone());
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
