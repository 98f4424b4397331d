//! What each optimisation of the painter `quads` saves: pictures with all of them, and with each switched off, in alternation; then a turn.
//!
//! ```text
//! cargo run --release --example savings [--post] [--zoom F] [--size PIXELS] [--runs N] VOLUME...
//! ```
//!
//! For each volume a table: median milliseconds of preparing and of a picture, their ratio to those with every
//! optimisation, what was modelled, and the largest difference of the picture, which may only be that of early termination.
//! Then the first picture of a turntable against the next ones. VOLUME is demo:vessels:128.

#![allow(clippy::print_stdout, reason = "printing its tables is what this program is for")]

use std::error::Error;
use std::time::Instant;

use voxsplat::camera::{Camera, View};
use voxsplat::demos::demo_transfer;
use voxsplat::formats::{LoadOptions, load};
use voxsplat::image::Image;
use voxsplat::renderer::{Rendered, Renderer, RendererOptions};
use voxsplat::settings::{Painter, Savings, Settings, Shading};
use voxsplat::stats::Stats;
use voxsplat::transfer::{TransferFunction, presets};
use voxsplat::volume::{Statistics, Volume};

struct Options {
    settings: Settings,
    zoom: f64,
    runs: usize,
    volumes: Vec<String>,
}

fn options() -> Result<Options, Box<dyn Error>> {
    let mut options = Options {
        settings: Settings { size: [256; 2], painter: Painter::Quads, ..Settings::default() },
        zoom: 1.0,
        runs: 3,
        volumes: Vec::new(),
    };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} takes a value"));
        match argument.as_str() {
            "--post" => options.settings.shading = Shading::Post,
            "--zoom" => options.zoom = value()?.parse()?,
            "--size" => options.settings.size = [value()?.parse()?; 2],
            "--runs" => options.runs = value()?.parse()?,
            _ => options.volumes.push(argument),
        }
    }
    if options.volumes.is_empty() {
        options.volumes.push("demo:vessels:128".to_owned());
    }
    Ok(options)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn largest_difference(a: &Image, b: &Image) -> f32 {
    let channels = a.pixels().as_flattened().iter().zip(b.pixels().as_flattened());
    channels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Milliseconds of the picture alone.
fn frame(stats: &Stats) -> f64 {
    stats.stages.iter().find(|s| s.name == "frame").map_or(0.0, |s| s.seconds * 1e3)
}

fn variants(all: &Settings) -> Vec<(&'static str, Settings)> {
    let without = |savings| Settings { savings, ..all.clone() };
    let on = Savings::default();
    vec![
        ("all", all.clone()),
        ("no bricks", without(Savings { bricks: false, ..on })),
        ("no voxels", without(Savings { voxels: false, ..on })),
        ("no view", without(Savings { view: false, ..on })),
        ("no pixels", without(Savings { pixels: false, ..on })),
        ("no specialization", without(Savings { specialization: false, ..on })),
        ("no termination", Settings { termination: 0.0, ..all.clone() }),
        (
            "one sheet a pass",
            Settings { sheets_per_pass: Some(if all.is_post_shaded() { 4 } else { 1 }), ..all.clone() },
        ),
    ]
}

fn savings(
    renderer: &Renderer,
    (volume, transfer): (&Volume, &TransferFunction),
    camera: &Camera,
    options: &Options,
) -> Result<(), Box<dyn Error>> {
    let variants = variants(&options.settings);
    let mut times = vec![(Vec::new(), Vec::new()); variants.len()];
    let mut last: Vec<Option<Rendered>> = vec![None; variants.len()];
    for _ in 0..options.runs {
        for (variant, (_, settings)) in variants.iter().enumerate() {
            // The volume's ranges are known after the first: what is timed is another transfer function on it.
            let start = Instant::now();
            let scene = renderer.prepare(volume, transfer, settings, &|_| ())?;
            times[variant].0.push(start.elapsed().as_secs_f64() * 1e3);
            // Post-shading finishes preparing with the first picture, shaders with it too.
            let first = renderer.render(&scene, camera, settings)?;
            times[variant].1.push(frame(&first.stats));
            last[variant] = Some(first);
        }
    }
    println!(
        "{:<18} {:>11} {:>6} {:>10} {:>6} {:>10} {:>10} {:>10} {:>12} {:>10}",
        "", "prepare, ms", "x", "frame, ms", "x", "splats", "in view", "quads", "GPU bytes", "difference"
    );
    let medians: Vec<_> = times.into_iter().map(|(p, f)| (median(p), median(f))).collect();
    let Some(Some(all)) = last.first() else { return Ok(()) };
    for (((name, _), (prepare, frame)), got) in variants.iter().zip(&medians).zip(&last) {
        let Some(Rendered { image, stats }) = got else { continue };
        println!(
            "{name:<18} {prepare:>11.0} {:>6.2} {frame:>10.0} {:>6.2} {:>10} {:>10} {:>10} {:>12} {:>10.1e}",
            prepare / medians[0].0,
            frame / medians[0].1,
            stats.splats_kept + stats.splats_padding,
            stats.splats_in_view,
            stats.quads - stats.quads_terminated,
            stats.scene_bytes + stats.frame_bytes,
            largest_difference(image, &all.image),
        );
    }
    Ok(())
}

/// The first picture of a turntable on a renderer of its own, from opening the device on, and the next ones.
fn turn(volume: &Volume, transfer: &TransferFunction, options: &Options) -> Result<(), Box<dyn Error>> {
    let settings = &options.settings;
    let start = Instant::now();
    let renderer = Renderer::new(&RendererOptions::default())?;
    let scene = renderer.prepare(volume, transfer, settings, &|_| ())?;
    let mut times = Vec::new();
    let mut sent = Vec::new();
    let mut start = start;
    // As high for every view: one fitted to each would change the size of the voxels.
    let [corner, .., opposite] = volume.grid().corners(0.5);
    let view_height = Some(corner.distance(opposite));
    for step in 0..=options.runs.max(2) {
        let view =
            View { azimuth: 10.0 * step as f64, elevation: 20.0, zoom: options.zoom, view_height, ..View::default() };
        let camera = Camera::new(&view, volume.grid(), settings.size)?;
        sent.push(renderer.render(&scene, &camera, settings)?.stats.bytes_sent);
        times.push(start.elapsed().as_secs_f64() * 1e3);
        start = Instant::now();
    }
    let next = median(times.split_off(1));
    println!(
        "turntable: first picture {:.0} ms with the device and the scene, next {next:.0} ms, {:.2} of it; {} bytes sent, then {}",
        times[0],
        next / times[0],
        sent[0],
        sent[1]
    );
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let options = options()?;
    let renderer = Renderer::new(&RendererOptions::default())?;
    for source in &options.volumes {
        let volume = load(source, &LoadOptions::default())?;
        let transfer = match source.strip_prefix("demo:").and_then(demo_transfer) {
            Some(transfer) => transfer,
            None => {
                let statistics = Statistics::of(&volume)?;
                presets::preset(presets::suggest(&volume, &statistics).name, &statistics)?
            }
        };
        let view = View { azimuth: 30.0, elevation: 20.0, zoom: options.zoom, ..View::default() };
        let camera = Camera::new(&view, volume.grid(), options.settings.size)?;
        println!("{source}, {} x {0} pixels, zoom {}", options.settings.size[0], options.zoom);
        savings(&renderer, (&volume, &transfer), &camera, &options)?;
        turn(&volume, &transfer, &options)?;
        println!();
    }
    Ok(())
}
