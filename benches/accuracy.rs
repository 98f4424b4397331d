//! Errors of the painter quads against the f64 reference.
//!
//! ```text
//! cargo bench --bench accuracy -- [SIZE [PIXELS]] [--write]
//! ```
//!
//! Draws the built-in volumes at SIZE^3 voxels (64) in pictures of PIXELS^2 (128), from three oblique views each,
//! parallel and perspective. Errors are the largest of any pixel. `--write` keeps the tables in docs/measurements.

#![allow(clippy::print_stdout, reason = "printing its tables is what this program is for")]

mod common;

use common::{Arguments, Outcome, Report};
use glam::{DAffine3, DMat3, DVec3};
use voxsplat::demos::{self, demo_transfer, demos};
use voxsplat::image::compare;
use voxsplat::kernel::Kernel;
use voxsplat::reference::Reference;
use voxsplat::settings::{Painter, Precision, QuadsSettings};
use voxsplat::{
    Camera, Frame, Grid, Image, ProjectionKind, Renderer, RendererOptions, Settings, TransferFunction, View, Volume,
};

const VIEWS: [(f64, f64); 3] = [(33.0, 21.0), (118.0, -37.0), (247.0, 52.0)];
const THICKNESSES: [f64; 3] = [0.5, 1.0, 2.0];

/// Largest errors of (alpha, colour).
fn errors(got: &Image, expected: &Image) -> Outcome<(f64, f64)> {
    let [r, g, b, alpha] = compare(got, expected, 0.0)?.max_channel;
    Ok((alpha, r.max(g).max(b)))
}

/// Draws scenes of one picture size and reports their errors.
struct Harness {
    renderer: Renderer,
    report: Report,
    pixels: u32,
}

/// Settings of quads without early termination.
fn by_quads(quads: QuadsSettings) -> Settings {
    Settings { painter: Painter::Quads(quads), termination: 0.0, ..Settings::default() }
}

impl Harness {
    /// Four rows per scene: alpha and colour error at each thickness, over all views.
    fn rows(&mut self, name: &str, volume: &Volume, transfer: &TransferFunction, kernel: Kernel) -> Outcome {
        let settings = Settings { kernel, ..by_quads(QuadsSettings::default()) };
        let scene = self.renderer.prepare(volume, transfer, &settings)?;
        let truth = Reference::new(volume, transfer, &settings)?;
        for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 30.0 }] {
            let mut worst = [[(0.0_f64, 0.0_f64); 3]; 2];
            for (azimuth, elevation) in VIEWS {
                let view = View { azimuth, elevation, projection, ..View::default() };
                let camera = Camera::new(&view, volume.grid(), [self.pixels; 2])?;
                let expected = truth.render(&camera)?;
                for (precision, worst) in [Precision::F16, Precision::F32].into_iter().zip(&mut worst) {
                    for (thickness, worst) in THICKNESSES.into_iter().zip(worst) {
                        let precision = Some(precision);
                        let quads = QuadsSettings { precision, sheet_thickness: thickness, ..QuadsSettings::default() };
                        let settings = Settings { kernel, ..by_quads(quads) };
                        let (alpha, color) =
                            errors(&self.renderer.render(&scene, &Frame::new(&camera, &settings))?.image, &expected)?;
                        *worst = (worst.0.max(alpha), worst.1.max(color));
                    }
                }
            }
            let kind = if projection == ProjectionKind::Orthographic { "parallel" } else { "perspective" };
            for (precision, worst) in ["f16", "f32"].into_iter().zip(worst) {
                let [half, one, two] = worst;
                self.report.line(format_args!(
                    "| {name} | {kind} | {precision} | {:.1e} / {:.1e} / {:.1e} | {:.1e} / {:.1e} / {:.1e} |",
                    half.0, one.0, two.0, half.1, one.1, two.1
                ));
            }
        }
        Ok(())
    }
}

fn main() -> Outcome {
    let arguments = Arguments::of_process();
    let report = Report::new("accuracy", &arguments);
    let numbers = arguments.positional()?.iter().map(|a| a.parse()).collect::<Result<Vec<u32>, _>>()?;
    let size = numbers.first().copied().unwrap_or(64);
    let pixels = numbers.get(1).copied().unwrap_or(128);
    let mut harness = Harness { renderer: Renderer::new(&RendererOptions::default())?, report, pixels };
    harness
        .report
        .line(format_args!("| volume, {size}^3 | rays | sheets | alpha at 0.5 / 1 / 2 | colour at 0.5 / 1 / 2 |"));
    harness.report.line("|---|---|---|---|---|");
    for demo in demos() {
        let transfer = demo_transfer(demo.name).ok_or("no transfer function")?;
        harness.rows(demo.name, &demos::volume(demo.name, size)?, &transfer, Kernel::default())?;
    }
    let volume = demos::volume("marschner-lobb", size)?;
    let transfer = demo_transfer("marschner-lobb").ok_or("no transfer function")?;
    harness.rows("marschner-lobb, Kaiser-Bessel", &volume, &transfer, Kernel::KAISER_BESSEL)?;
    let grids = [
        ("1:1:4", DMat3::from_diagonal(DVec3::new(1.0, 1.0, 4.0))),
        ("sheared", DMat3::from_cols(DVec3::X, DVec3::new(0.3, 1.0, 0.1), DVec3::new(0.2, -0.4, 1.5))),
    ];
    for (name, matrix) in grids {
        let grid = Grid::new([size; 3], DAffine3::from_mat3(matrix))?;
        let volume = volume.clone().with_grid(grid)?;
        harness.rows(&format!("marschner-lobb, {name}"), &volume, &transfer, Kernel::default())?;
    }
    harness.report.finish(harness.renderer.adapter())
}
