//! The popping experiment (Mueller and Crawfis 1998, "Eliminating popping artifacts in sheet buffer-based splatting"): a turn
//! from 44 to 46 degrees in small steps. Half way the axis of axis-aligned sheets switches, and the picture with it.
//!
//! ```text
//! cargo run --release --example popping [VOLUME [PIXELS [FOLDER]]]
//! ```
//!
//! Prints, for each way of splatting, how much of the change from frame to frame is not there in the f64 reference: the
//! largest over all pixels and channels, at the switch and elsewhere. Writes the pictures at 44.8 and 45.2 degrees to FOLDER
//! (target/popping). VOLUME is demo:marschner-lobb:48, PIXELS 128.

#![allow(clippy::print_stdout, reason = "printing its table is what this program is for")]

use std::error::Error;
use std::path::PathBuf;

use voxsplat::camera::{Camera, View};
use voxsplat::demos::demo_transfer;
use voxsplat::formats::{LoadOptions, load};
use voxsplat::image::{Background, Image};
use voxsplat::reference;
use voxsplat::renderer::{Renderer, RendererOptions};
use voxsplat::settings::{Accumulation, Painter, Settings, Sheets};
use voxsplat::transfer::presets;
use voxsplat::volume::Statistics;

/// Frames, in tenths of a degree.
const TENTHS: std::ops::RangeInclusive<u32> = 440..=460;

/// The largest difference, over pixels and channels, between the change from `a` to `b` and that from `c` to `d`.
fn excess([a, b]: [&Image; 2], [c, d]: [&Image; 2]) -> f32 {
    let change = |p: &Image, q: &Image| -> Vec<f32> {
        p.pixels().iter().flatten().zip(q.pixels().iter().flatten()).map(|(p, q)| q - p).collect()
    };
    change(a, b).iter().zip(change(c, d)).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let source = arguments.next().unwrap_or_else(|| "demo:marschner-lobb:48".to_owned());
    let pixels = arguments.next().map_or(Ok(128), |text| text.parse())?;
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "target/popping".to_owned()));
    std::fs::create_dir_all(&folder)?;

    let volume = load(&source, &LoadOptions::default())?;
    let transfer = match source.strip_prefix("demo:").and_then(demo_transfer) {
        Some(transfer) => transfer,
        None => {
            let statistics = Statistics::of(&volume)?;
            presets::preset(presets::suggest(&volume, &statistics).name, &statistics)?
        }
    };
    let painter = Painter::Quads;
    let settings = Settings { size: [pixels; 2], painter, termination: 0.0, ..Settings::default() };
    let cameras = TENTHS
        .map(|t| Camera::new(&View { azimuth: f64::from(t) / 10.0, ..View::default() }, volume.grid(), settings.size))
        .collect::<Result<Vec<_>, _>>()?;
    let renderer = Renderer::new(&RendererOptions::default())?;
    let scene = renderer.prepare(&volume, &transfer, &settings, &|_| ())?;
    let truth = reference::Scene::new(&volume, &transfer, &settings)?;
    let truth = cameras.iter().map(|c| truth.render(c, settings.size, &|_| ())).collect::<Result<Vec<_>, _>>()?;
    let true_change = truth.windows(2).map(|w| excess([&w[0], &w[1]], [&w[0], &w[0]])).fold(0.0, f32::max);
    println!(
        "{source}, {pixels} x {pixels} pixels, 44 to 46 degrees by 0.1; the true change of a step is at most {true_change:.2e}"
    );
    println!("| sheets | accumulation | excess at 45 degrees | elsewhere | ratio |");
    println!("|---|---|---|---|---|");
    for (sheets, accumulation) in [
        (Sheets::Axis, Accumulation::Additive),
        (Sheets::Axis, Accumulation::OpticalDepth),
        (Sheets::Image, Accumulation::OpticalDepth),
    ] {
        let settings = Settings { sheets, accumulation, ..settings.clone() };
        let mut frames = Vec::new();
        for (tenths, camera) in TENTHS.zip(&cameras) {
            let image = renderer.render(&scene, camera, &settings)?.image;
            if tenths == 448 || tenths == 452 {
                let name = format!("{sheets}-{accumulation}-{}.{}.png", tenths / 10, tenths % 10);
                image.save(folder.join(name), Background::default())?;
            }
            frames.push(image);
        }
        // At 45 degrees itself either axis may be taken: the switch is in one of the two steps beside it.
        let (mut switch, mut elsewhere) = (0.0_f32, 0.0_f32);
        for ((tenths, got), want) in TENTHS.zip(frames.windows(2)).zip(truth.windows(2)) {
            let excess = excess([&got[0], &got[1]], [&want[0], &want[1]]);
            let part = if tenths == 449 || tenths == 450 { &mut switch } else { &mut elsewhere };
            *part = part.max(excess);
        }
        println!("| {sheets} | {accumulation} | {switch:.1e} | {elsewhere:.1e} | {:.1} |", switch / elsewhere);
    }
    println!("pictures at 44.8 and 45.2 degrees: {}", folder.display());
    Ok(())
}
