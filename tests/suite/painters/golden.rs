//! Small pictures, each for one subject, compared to one 8-bit step.
//!
//! `VOXSPLAT_BLESS=front,oblique cargo golden` rewrites the pictures of these names. Look at them before you
//! commit them. `cargo golden-page` writes target/golden/index.html, which shows expected picture, actual picture and
//! difference of all goldens side by side. A missing picture fails.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, OnceLock};

use glam::DVec3;
use voxsplat::camera::{ProjectionKind, View};
use voxsplat::figure::{Figure, Shown};
use voxsplat::image::{Background, Comparison, Image, compare, difference_picture};
use voxsplat::kernel::Kernel;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::settings::{Accumulation, Model, Precision, Settings, Shading, Sheets};

use crate::support::{demo, headlight, look, render, thick, with_quads, with_tiles};

/// A picture of a built-in volume of 40^3 voxels.
struct Golden {
    name: &'static str,
    volume: &'static str,
    view: View,
    settings: Settings,
    figure: Figure,
    outcome: OnceLock<Outcome>,
}

/// A golden beside its actual picture.
struct Outcome {
    actual: Image,
    expected: Image,
    comparison: Comparison,
}

/// Each golden is a test of its own, and a row of the page.
macro_rules! goldens {
    ($($name:ident: $volume:literal, $view:expr, $settings:expr $(, $figure:expr)?;)*) => {
        static GOLDENS: LazyLock<Vec<Golden>> = LazyLock::new(|| vec![$(Golden {
            name: stringify!($name),
            volume: $volume,
            view: $view,
            settings: $settings,
            figure: [$($figure,)? Figure::default()][0].clone(),
            outcome: OnceLock::new(),
        }),*]);
        $(#[test]
        fn $name() {
            check(stringify!($name));
        })*
    };
}

goldens! {
    // The front view is upright.
    front: "vessels", View::default(), quads();
    oblique: "marschner-lobb", turned(35.0, 30.0), quads();
    perspective: "marschner-lobb", through_eye(60.0, turned(-50.0, 20.0)), quads();
    // The two tones meet in the middle.
    two_tones: "sphere", turned(60.0, 0.0), quads();
    // Translucent layers.
    layers: "shepp-logan", turned(20.0, 15.0), quads();
    kaiser_bessel: "marschner-lobb", turned(35.0, 30.0), Settings { kernel: Kernel::KAISER_BESSEL, ..quads() };
    roll_zoom_target: "vessels",
        View { roll: 30.0, zoom: 2.5, target: Some(DVec3::new(4.0, 0.0, -5.0)), ..turned(10.0, 5.0) }, quads();
    thick_sheets: "sphere", turned(60.0, 20.0), thick(&quads(), 6.0);
    axis: "marschner-lobb", turned(44.0, 20.0), with_quads(&quads(), |q| q.sheets = Sheets::Axis);
    additive: "marschner-lobb", turned(46.0, 20.0),
        with_quads(&quads(), |q| (q.sheets, q.accumulation) = (Sheets::Axis, Accumulation::Additive));
    lit: "vessels", turned(30.0, 15.0), Settings { lighting: lights(), ..quads() };
    post: "shell", turned(30.0, 20.0), Settings { shading: Shading::Post, ..quads() };
    post_lit: "sphere", through_eye(50.0, turned(30.0, 15.0)),
        Settings { shading: Shading::Post, lighting: lights(), ..quads() };
    xray: "shepp-logan", turned(20.0, 15.0), Settings { model: Model::Xray, ..quads() };
    mip: "shepp-logan", turned(30.0, 15.0), Settings { model: Model::Mip, ..quads() };
    // Four voxels to a pixel.
    minified: "vessels", View { zoom: 0.3, ..turned(30.0, 15.0) }, quads();
    // The eye is inside the volume.
    inside: "vessels", View { distance: Some(6.0), ..through_eye(80.0, turned(30.0, 10.0)) },
        Settings { lighting: lights(), ..quads() };
    rays: "marschner-lobb", View { zoom: 2.0, ..turned(35.0, 30.0) }, tiles();
    // Rays follow all three axes.
    rays_perspective: "vessels", through_eye(60.0, turned(45.0, 35.0)), Settings { antialiasing: false, ..tiles() };
    rays_post_lit: "vessels", View { zoom: 1.5, ..turned(-40.0, 20.0) },
        Settings { shading: Shading::Post, lighting: headlight(), ..tiles() };
    rays_mip: "vessels", View { zoom: 1.5, ..turned(30.0, 10.0) }, Settings { model: Model::Mip, ..tiles() };
    // Parts of a figure; letters need a larger picture.
    figure: "vessels", through_eye(30.0, turned(35.0, 25.0)), quads(), everything();
}

fn quads() -> Settings {
    with_quads(&Settings::default(), |q| q.precision = Some(Precision::F32))
}

fn tiles() -> Settings {
    with_tiles(&Settings::default())
}

fn turned(azimuth: f64, elevation: f64) -> View {
    View { azimuth, elevation, ..View::default() }
}

fn through_eye(fov: f64, view: View) -> View {
    View { projection: ProjectionKind::Perspective { fov }, ..view }
}

fn lights() -> Option<Lighting> {
    let lights = vec![Light::HEADLIGHT, Light::directional(DVec3::new(1.0, -0.5, 1.0))];
    Some(Lighting { lights, ..Lighting::default() })
}

fn everything() -> Figure {
    let (title, caption) = (Some("A vessel tree".to_owned()), Some("Größe: α ≤ 1".to_owned()));
    Figure { scale_bar: true, axes: true, color_bar: true, title, caption, ..Figure::default() }
}

/// One step of 8 bits. Drivers and processors round differently, so a value may cross the border of two steps.
const STEP: f64 = 1.01 / 255.0;

fn pictures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden")
}

fn results() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("golden")
}

/// The names of the goldens to rewrite.
static BLESSED: LazyLock<Vec<String>> = LazyLock::new(|| {
    let names = std::env::var("VOXSPLAT_BLESS").unwrap_or_default();
    let names: Vec<String> = names.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect();
    for name in &names {
        let known = || GOLDENS.iter().map(|g| g.name).collect::<Vec<_>>().join(", ");
        assert!(GOLDENS.iter().any(|g| g.name == name), "VOXSPLAT_BLESS: {name} is no golden; there are: {}", known());
    }
    names
});

impl Golden {
    /// Renders the picture once, and leaves it beside the expected one and their difference in target/golden.
    fn outcome(&self) -> &Outcome {
        self.outcome.get_or_init(|| {
            let (volume, transfer) = demo(self.volume, 40);
            let size = if self.figure.is_empty() { [64, 56] } else { [192, 160] };
            let camera = look(&self.view, &volume, size);
            let image = render(&volume, &transfer, &camera, &self.settings);
            let shown = Shown {
                volume: &volume,
                transfer: &transfer,
                values: None,
                camera: &camera,
                model: self.settings.model,
            };
            let image = self.figure.draw(&image, Background::Transparent, &shown).unwrap();
            let path = pictures().join(format!("{}.png", self.name));
            if BLESSED.iter().any(|name| name == self.name) {
                image.save(&path, Background::Transparent).unwrap();
            }
            std::fs::create_dir_all(results()).unwrap();
            let result = |what: &str| results().join(format!("{}.{what}.png", self.name));
            image.save(result("actual"), Background::Transparent).unwrap();
            // Compared as 8-bit pictures; straight alpha spreads the step of a nearly transparent pixel, hence
            // premultiplied values.
            let actual = Image::load(result("actual")).unwrap();
            let expected = Image::load(&path).unwrap_or_else(|e| panic!("{e}: VOXSPLAT_BLESS={} writes it", self.name));
            let comparison = compare(&actual, &expected, STEP).unwrap();
            expected.save(result("expected"), Background::Transparent).unwrap();
            let difference = difference_picture(&actual, &expected, 20.0).unwrap();
            difference.save(result("difference"), Background::default()).unwrap();
            Outcome { actual, expected, comparison }
        })
    }
}

/// Compares a picture with tests/golden/NAME.png.
fn check(name: &str) {
    let golden = GOLDENS.iter().find(|g| g.name == name).unwrap();
    let Outcome { actual, expected, comparison } = golden.outcome();
    assert!(actual.pixels().iter().any(|p| p[3] > 0.1), "{name} shows nothing");
    assert_eq!((actual.width(), actual.height()), (expected.width(), expected.height()));
    assert!(
        comparison.outliers == 0,
        "{name} differs, see {}; `cargo golden-page` shows all side by side\n{comparison}",
        results().display()
    );
}

#[test]
fn every_picture_has_a_test() {
    let files = std::fs::read_dir(pictures()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut files: Vec<String> = files.filter(|name| name.ends_with(".png")).collect();
    let mut tested: Vec<String> = GOLDENS.iter().map(|g| format!("{}.png", g.name)).collect();
    files.sort();
    tested.sort();
    assert_eq!(files, tested);
}

#[test]
fn page() {
    let mut rows = String::new();
    for golden in GOLDENS.iter() {
        let c = &golden.outcome().comparison;
        let (name, verdict) = (golden.name, if c.outliers == 0 { "same" } else { "differs" });
        let cells = ["expected", "actual", "difference"].map(|what| format!("<td><img src=\"{name}.{what}.png\">"));
        writeln!(
            rows,
            "<tr class=\"{verdict}\"><td><b>{name}</b><br>{verdict}<br>largest {:.2} of 255<br>rms {:.3} of 255<br>{} \
             pixels over a step{}",
            255.0 * c.max,
            255.0 * c.rms,
            c.outliers,
            cells.concat()
        )
        .unwrap();
    }
    let page = format!(
        "<!DOCTYPE html>\n<meta charset=\"utf-8\">\n<title>Goldens</title>\n<style>\n\
         body {{ font-family: sans-serif; background: #555; color: white }}\n\
         img {{ width: 256px; image-rendering: pixelated }}\n\
         td {{ padding: 4px 12px }}\n\
         tr.differs {{ background: #833 }}\n\
         </style>\n\
         <table>\n<tr><th>Golden<th>Expected<th>Actual<th>Difference, 20 times\n{rows}</table>\n"
    );
    std::fs::create_dir_all(results()).unwrap();
    std::fs::write(results().join("index.html"), page).unwrap();
    println!("{}", results().join("index.html").display());
}
