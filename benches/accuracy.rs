//! Errors of the painter quads against the f64 reference, and the time of a frame by the sheets that a pass feeds.
//!
//! ```text
//! cargo bench --bench accuracy -- [SIZE [PIXELS]] [--write]
//! ```
//!
//! Draws the built-in volumes at SIZE^3 voxels (64) in pictures of PIXELS^2 (128), from three oblique views each,
//! parallel and perspective. Errors are the largest of any pixel. `--write` keeps the tables in docs/measurements.

#![allow(clippy::print_stdout, reason = "printing its tables is what this program is for")]

mod common;

use std::time::Instant;

use common::{Arguments, Outcome, Report, median};
use glam::{DAffine3, DMat3, DVec3};
use voxsplat::demos::{self, demo_transfer, demos};
use voxsplat::kernel::Kernel;
use voxsplat::reference::Reference;
use voxsplat::report::compare;
use voxsplat::settings::{Painter, Precision, QuadsSettings};
use voxsplat::{
    Camera, Grid, Image, ProjectionKind, Renderer, RendererOptions, Settings, TransferFunction, View, Volume,
};

const VIEWS: [(f64, f64); 3] = [(33.0, 21.0), (118.0, -37.0), (247.0, 52.0)];
const THICKNESSES: [f64; 3] = [0.5, 1.0, 2.0];

/// Largest errors of (alpha, colour).
fn errors(got: &Image, expected: &Image) -> Outcome<(f64, f64)> {
    let [r, g, b, alpha] = compare(got, expected, 0.0)?.max_channel;
    Ok((alpha, r.max(g).max(b)))
}

/// Draws scenes of one picture size and reports what was found.
struct Harness {
    renderer: Renderer,
    report: Report,
    pixels: u32,
}

/// A picture by quads in which nothing is left out for speed.
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
                            errors(&self.renderer.render(&scene, &camera, &settings)?.image, &expected)?;
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

    /// Quads per splat and the time of a frame, for each number of sheets that a pass feeds, in alternation.
    fn feeding(&mut self) -> Outcome {
        let volume = demos::volume("shepp-logan", 64)?;
        let transfer = demo_transfer("shepp-logan").ok_or("no transfer function")?;
        let scene = self.renderer.prepare(&volume, &transfer, &by_quads(QuadsSettings::default()))?;
        let (azimuth, elevation) = VIEWS[0];
        let camera = Camera::new(&View { azimuth, elevation, ..View::default() }, volume.grid(), [self.pixels; 2])?;
        let counts = [1, 4, 8];
        let mut times = [const { Vec::new() }; 3];
        let mut quads_per_splat = [0.0; 3];
        for _ in 0..5 {
            for (i, &sheets) in counts.iter().enumerate() {
                let settings = by_quads(QuadsSettings { sheets_per_pass: Some(sheets), ..QuadsSettings::default() });
                let start = Instant::now();
                let stats = self.renderer.render(&scene, &camera, &settings)?.stats;
                times[i].push(start.elapsed().as_secs_f64());
                let quads = stats.quads().ok_or("another painter")?;
                quads_per_splat[i] = quads.quads as f64 / stats.splats_kept.max(1) as f64;
            }
        }
        let times = times.map(median);
        self.report.line("\n| sheets per pass | quads per splat | frame, ms | time of one sheet per pass over it |");
        self.report.line("|---|---|---|---|");
        for i in 0..counts.len() {
            let (count, quads, time) = (counts[i], quads_per_splat[i], times[i]);
            self.report.line(format_args!("| {count} | {quads:.2} | {:.0} | {:.2} |", time * 1e3, times[0] / time));
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
    harness.feeding()?;
    harness.report.finish(harness.renderer.adapter())
}
