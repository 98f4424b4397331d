//! The popping experiment (Mueller and Crawfis 1998, "Eliminating popping artifacts in sheet buffer-based splatting").
//!
//! A turn from 44 to 46 degrees in small steps: half way the axis of axis-aligned sheets switches, and the picture
//! pops.
//!
//! ```text
//! cargo bench --bench popping -- [VOLUME [PIXELS [FOLDER]]] [--write]
//! ```
//!
//! Prints, for each kind of sheets, the change from frame to frame beyond the change of the f64 reference: the
//! largest over all pixels and channels, at the switch and elsewhere. Writes the pictures at 44.8 and 45.2 degrees to
//! FOLDER (target/popping). VOLUME is demo:marschner-lobb:48, PIXELS 128. `--write` keeps the table in
//! docs/measurements.

#![allow(clippy::print_stdout, reason = "printing its table is what this program is for")]

mod common;

use std::path::PathBuf;

use common::{Arguments, Outcome, Report, own_or_suggested};
use voxsplat::reference::Reference;
use voxsplat::settings::{Accumulation, Painter, QuadsSettings, Sheets};
use voxsplat::{Background, Camera, Frame, Image, LoadOptions, Renderer, RendererOptions, Settings, View, load};

/// Frames, in tenths of a degree.
const TENTHS: std::ops::RangeInclusive<u32> = 440..=460;

/// The largest difference, over pixels and channels, between the change from `a` to `b` and the change from `c` to `d`.
fn excess([a, b]: [&Image; 2], [c, d]: [&Image; 2]) -> f32 {
    let change = |p: &Image, q: &Image| -> Vec<f32> {
        p.pixels().iter().flatten().zip(q.pixels().iter().flatten()).map(|(p, q)| q - p).collect()
    };
    change(a, b).iter().zip(change(c, d)).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
}

/// Settings of quads without early termination.
fn by_quads(sheets: Sheets, accumulation: Accumulation) -> Settings {
    let quads = QuadsSettings { sheets, accumulation, ..QuadsSettings::default() };
    Settings { painter: Painter::Quads(quads), termination: 0.0, ..Settings::default() }
}

fn main() -> Outcome {
    let arguments = Arguments::of_process();
    let mut report = Report::new("popping", &arguments);
    let positional = arguments.positional()?;
    let source = positional.first().map_or("demo:marschner-lobb:48", String::as_str);
    let pixels = positional.get(1).map_or(Ok(128), |text| text.parse())?;
    let folder = PathBuf::from(positional.get(2).map_or("target/popping", String::as_str));
    std::fs::create_dir_all(&folder)?;

    let volume = load(source, &LoadOptions::default())?;
    let transfer = own_or_suggested(source, &volume)?;
    let settings = by_quads(Sheets::Image, Accumulation::OpticalDepth);
    let cameras = TENTHS
        .map(|t| Camera::new(&View { azimuth: f64::from(t) / 10.0, ..View::default() }, volume.grid(), [pixels; 2]))
        .collect::<Result<Vec<_>, _>>()?;
    let renderer = Renderer::new(&RendererOptions::default())?;
    let scene = renderer.prepare(&volume, &transfer, &settings)?;
    let truth = Reference::new(&volume, &transfer, &settings)?;
    let truth = cameras.iter().map(|c| truth.render(c)).collect::<Result<Vec<_>, _>>()?;
    let true_change = truth.windows(2).map(|w| excess([&w[0], &w[1]], [&w[0], &w[0]])).fold(0.0, f32::max);
    report.line(format_args!("{source}, {pixels} x {pixels} pixels, 44 to 46 degrees by 0.1."));
    report.line(format_args!("The true change of a step is at most {true_change:.2e}.\n"));
    report.line("| sheets | accumulation | excess at 45 degrees | elsewhere | ratio |");
    report.line("|---|---|---|---|---|");
    for (sheets, accumulation) in [
        (Sheets::Axis, Accumulation::Additive),
        (Sheets::Axis, Accumulation::OpticalDepth),
        (Sheets::Image, Accumulation::OpticalDepth),
    ] {
        let settings = by_quads(sheets, accumulation);
        let mut frames = Vec::new();
        for (tenths, camera) in TENTHS.zip(&cameras) {
            let image = renderer.render(&scene, &Frame::new(camera, &settings))?.image;
            if tenths == 448 || tenths == 452 {
                let name = format!("{sheets}-{accumulation}-{}.{}.png", tenths / 10, tenths % 10);
                image.save(folder.join(name), Background::default())?;
            }
            frames.push(image);
        }
        // At 45 degrees either axis is possible: the switch is in one of the two adjacent steps.
        let (mut switch, mut elsewhere) = (0.0_f32, 0.0_f32);
        for ((tenths, got), want) in TENTHS.zip(frames.windows(2)).zip(truth.windows(2)) {
            let excess = excess([&got[0], &got[1]], [&want[0], &want[1]]);
            let part = if tenths == 449 || tenths == 450 { &mut switch } else { &mut elsewhere };
            *part = part.max(excess);
        }
        let ratio = switch / elsewhere;
        report.line(format_args!("| {sheets} | {accumulation} | {switch:.1e} | {elsewhere:.1e} | {ratio:.1} |"));
    }
    println!("\npictures at 44.8 and 45.2 degrees: {}", folder.display());
    report.finish(renderer.adapter())
}
