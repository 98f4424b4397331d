//! Small pictures, one issue each, held to one 8-bit step.
//!
//! `VOXSPLAT_BLESS=1 cargo test --test suite golden` writes them anew, to be looked at before they are committed. A missing
//! picture fails. A failure leaves expected, actual and difference pictures in target/golden.

use std::path::{Path, PathBuf};

use glam::DVec3;
use voxsplat::camera::{ProjectionKind, View};
use voxsplat::image::{Background, Image};
use voxsplat::kernel::Kernel;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::report::{compare, difference_picture};
use voxsplat::settings::{Accumulation, Model, Painter, Precision, Settings, Shading, Sheets};

use crate::support::{demo, look, render};

fn directory(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// Renders a built-in volume of 40^3 voxels and compares it with tests/golden/NAME.png.
fn check(name: &str, volume: &str, view: View, settings: Settings) {
    let (volume, transfer) = demo(volume, 40);
    let precision = (settings.painter != Painter::Tiles).then_some(Precision::F32);
    let settings = Settings { precision, ..settings };
    let image = render(&volume, &transfer, &look(&view, &volume, [64, 56]), &settings);
    let golden = directory("tests/golden").join(format!("{name}.png"));
    if std::env::var_os("VOXSPLAT_BLESS").is_some() {
        image.save(&golden, Background::Transparent).unwrap();
        return;
    }
    let results = directory("target/golden");
    std::fs::create_dir_all(&results).unwrap();
    let actual = results.join(format!("{name}.actual.png"));
    image.save(&actual, Background::Transparent).unwrap();
    let expected = Image::load(&golden).unwrap_or_else(|e| panic!("{e}: bless it"));
    // Compared as 8-bit pictures. Drivers and processors round differently, which may turn a value over the border of
    // two steps; straight alpha spreads the step of a nearly transparent pixel, hence premultiplied values.
    let actual = Image::load(&actual).unwrap();
    let step = 1.01 / 255.0;
    let comparison = compare(&actual, &expected, step).unwrap();
    if comparison.outliers > 0 {
        let save = |image: &Image, what: &str| {
            image.save(&results.join(format!("{name}.{what}.png")), Background::default()).unwrap();
        };
        save(&expected, "expected");
        save(&difference_picture(&actual, &expected, 20.0).unwrap(), "difference");
        panic!("{name} differs, see {}\n{comparison}", results.display());
    }
}

fn turned(azimuth: f64, elevation: f64) -> View {
    View { azimuth, elevation, ..View::default() }
}

#[test]
fn golden_front_view_is_upright() {
    check("front", "vessels", View::default(), Settings::default());
}

#[test]
fn golden_oblique_view() {
    check("oblique", "marschner-lobb", turned(35.0, 30.0), Settings::default());
}

#[test]
fn golden_perspective() {
    let view = View { projection: ProjectionKind::Perspective { fov: 60.0 }, ..turned(-50.0, 20.0) };
    check("perspective", "marschner-lobb", view, Settings::default());
}

#[test]
fn golden_two_tones_meet_in_the_middle() {
    check("two_tones", "sphere", turned(60.0, 0.0), Settings::default());
}

#[test]
fn golden_translucent_layers() {
    check("layers", "shepp-logan", turned(20.0, 15.0), Settings::default());
}

#[test]
fn golden_kaiser_bessel() {
    let settings = Settings { kernel: Kernel::KAISER_BESSEL, ..Settings::default() };
    check("kaiser_bessel", "marschner-lobb", turned(35.0, 30.0), settings);
}

#[test]
fn golden_roll_zoom_and_target() {
    let view = View { roll: 30.0, zoom: 2.5, target: Some(DVec3::new(4.0, 0.0, -5.0)), ..turned(10.0, 5.0) };
    check("roll_zoom_target", "vessels", view, Settings::default());
}

#[test]
fn golden_rays() {
    let settings = Settings { painter: Painter::Tiles, ..Settings::default() };
    check("rays", "marschner-lobb", View { zoom: 2.0, ..turned(35.0, 30.0) }, settings);
}

#[test]
fn golden_rays_through_one_eye() {
    // They follow all three axes.
    let settings = Settings { painter: Painter::Tiles, antialiasing: false, ..Settings::default() };
    let view = View { projection: ProjectionKind::Perspective { fov: 60.0 }, ..turned(45.0, 35.0) };
    check("rays_perspective", "vessels", view, settings);
}

#[test]
fn golden_rays_lit_per_pixel() {
    let lighting = Some(Lighting { lights: vec![Light::Headlight], ..Lighting::default() });
    let settings = Settings { painter: Painter::Tiles, shading: Shading::Post, lighting, ..Settings::default() };
    check("rays_post_lit", "vessels", View { zoom: 1.5, ..turned(-40.0, 20.0) }, settings);
}

#[test]
fn golden_rays_to_the_maximum() {
    let settings = Settings { painter: Painter::Tiles, model: Model::Mip, ..Settings::default() };
    check("rays_mip", "vessels", View { zoom: 1.5, ..turned(30.0, 10.0) }, settings);
}

#[test]
fn golden_thick_sheets() {
    check("thick_sheets", "sphere", turned(60.0, 20.0), Settings { sheet_thickness: 6.0, ..Settings::default() });
}

#[test]
fn golden_axis_aligned_sheets() {
    let settings = Settings { sheets: Sheets::Axis, sheet_thickness: 1.0, ..Settings::default() };
    check("axis", "marschner-lobb", turned(44.0, 20.0), settings);
}

#[test]
fn golden_added_opacities() {
    let settings = Settings { accumulation: Accumulation::Additive, sheets: Sheets::Axis, ..Settings::default() };
    check("additive", "marschner-lobb", turned(46.0, 20.0), settings);
}

#[test]
fn golden_lit_voxels() {
    let settings = Settings { lighting: Some(lights()), ..Settings::default() };
    check("lit", "vessels", turned(30.0, 15.0), settings);
}

#[test]
fn golden_post_shading() {
    check("post", "shell", turned(30.0, 20.0), Settings { shading: Shading::Post, ..Settings::default() });
}

#[test]
fn golden_post_shaded_light_in_perspective() {
    let view = View { projection: ProjectionKind::Perspective { fov: 50.0 }, ..turned(30.0, 15.0) };
    let settings = Settings { shading: Shading::Post, lighting: Some(lights()), ..Settings::default() };
    check("post_lit", "sphere", view, settings);
}

#[test]
fn golden_xray() {
    check("xray", "shepp-logan", turned(20.0, 15.0), Settings { model: Model::Xray, ..Settings::default() });
}

#[test]
fn golden_maximum_intensity() {
    check("mip", "shepp-logan", turned(30.0, 15.0), Settings { model: Model::Mip, ..Settings::default() });
}

#[test]
fn golden_minified() {
    // Four voxels to a pixel.
    check("minified", "vessels", View { zoom: 0.3, ..turned(30.0, 15.0) }, Settings::default());
}

#[test]
fn golden_eye_inside_the_volume() {
    let projection = ProjectionKind::Perspective { fov: 80.0 };
    let view = View { projection, distance: Some(6.0), ..turned(30.0, 10.0) };
    check("inside", "vessels", view, Settings { lighting: Some(lights()), ..Settings::default() });
}

fn lights() -> Lighting {
    Lighting { lights: vec![Light::Headlight, Light::Directional(DVec3::new(1.0, -0.5, 1.0))], ..Lighting::default() }
}
