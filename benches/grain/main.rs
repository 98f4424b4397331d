//! The grain of lit surfaces in noisy scans, by shading, kernel and sharpness.
//!
//! ```text
//! cargo bench --bench grain -- [--size PIXELS] [--write]
//! ```
//!
//! A ball of a radius of 40 voxels is sampled with an edge of 0.7 voxels and with the noise of MRI, on cubic voxels and
//! with slices three voxels apart, and lit by a headlight. Each cell has the root mean square of the difference from
//! the shading of the true normals, of 255, and the same without its mean over the 8 x 8 voxels around each pixel.

#![allow(clippy::disallowed_methods, reason = "measurements allow more than the last bit")]
#![allow(clippy::print_stdout, reason = "printing its table is what this program is for")]

mod ball;
#[path = "../common/mod.rs"]
mod common;

use ball::{Ball, Grain};
use common::{Arguments, Outcome, Report};
use voxsplat::kernel::Kernel;
use voxsplat::settings::Shading;
use voxsplat::{Renderer, RendererOptions, Settings};

fn main() -> Outcome {
    let mut arguments = Arguments::of_process();
    let size: u32 = arguments.option("--size")?.unwrap_or(400);
    arguments.positional()?;
    let renderer = Renderer::new(&RendererOptions::default())?;
    let mut report = Report::new("grain", &arguments);
    let noises = [None, Some(50.0), Some(20.0)];
    let noise = |ratio: Option<f64>| ratio.map_or("no noise".to_owned(), |ratio| format!("signal to noise {ratio}"));
    let columns = ["cubic", "slices"].map(|lattice| noises.map(|ratio| format!("{lattice}, {}", noise(ratio))));
    report.line(format_args!("| shading | kernel | sharpness | {} |", columns.as_flattened().join(" | ")));
    report.line("|---|---|---|---|---|---|---|---|---|");
    for shading in [Shading::Pre, Shading::Post] {
        for (kernel, sharpness) in [(Kernel::default(), 0.0), (Kernel::default(), 0.5), (Kernel::KAISER_BESSEL, 0.5)] {
            // Pre-shaded, a blob cannot be narrower.
            if shading == Shading::Pre && sharpness > 0.0 && kernel != Kernel::default() {
                continue;
            }
            let settings = Settings { shading, kernel, sharpness, ..Settings::default() };
            let mut cells = Vec::new();
            for (slices, signal_to_noise) in [1.0, 3.0].into_iter().flat_map(|s| noises.map(|noise| (s, noise))) {
                let Grain { all, fine } =
                    Ball { voxels: 40, slices, signal_to_noise }.grain(&renderer, &settings, size)?;
                cells.push(format!("{all:.2}, {fine:.2}"));
            }
            report.line(format_args!("| {shading} | {kernel} | {sharpness} | {} |", cells.join(" | ")));
        }
    }
    report.finish(renderer.adapter())
}
