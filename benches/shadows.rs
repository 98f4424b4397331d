//! What shadows take: once for a set of lights, and in each frame of a turntable.
//!
//! ```text
//! cargo bench --bench shadows -- [VOLUME...] [--size PIXELS] [--frames N] [--write]
//! ```
//!
//! Volumes are files or `demo:NAME:SIZE`, with the transfer function that they have or that is suggested. A directional
//! light is drawn without shadows, with hard ones and with soft ones; then studio light. Turntables alternate, and each
//! has a frame that is not timed first.

#![allow(clippy::print_stdout, reason = "printing its table is what this program is for")]

mod common;

use std::time::Instant;

use common::{Arguments, Outcome, Report, median, own_or_suggested};
use glam::DVec3;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::{Camera, LoadOptions, Renderer, RendererOptions, Scene, Settings, View, load};

/// The volumes of the table.
const VOLUMES: [&str; 5] =
    ["demo:vessels:128", "demo:shell:128", "demo:marschner-lobb:96", "demo:shepp-logan:160", "demo:vessels:256"];

/// The names and the lights.
fn ways() -> Outcome<Vec<(&'static str, Lighting)>> {
    let view = View::default();
    let with = |shadows, size| {
        let light = Light { color: [2.0; 3], size, ..Light::directional(DVec3::new(-0.5, -0.7, 0.6)) };
        Lighting { lights: vec![light], shadows, ..Lighting::default() }
    };
    Ok(vec![
        ("a light", with(0.0, 0.0)),
        ("its shadow", with(1.0, 0.0)),
        ("soft", with(1.0, 10.0)),
        ("studio", Lighting::studio(view.forward()?, view.up)),
    ])
}

fn main() -> Outcome {
    let mut arguments = Arguments::of_process();
    let size: u32 = arguments.option("--size")?.unwrap_or(512);
    let frames: usize = arguments.option("--frames")?.unwrap_or(7);
    let mut volumes = arguments.positional()?.to_vec();
    if volumes.is_empty() {
        volumes = VOLUMES.map(str::to_owned).to_vec();
    }
    let mut report = Report::new("shadows", &arguments);
    let renderer = Renderer::new(&RendererOptions::default())?;
    report.line("| volume | light | once, s | frame, ms | frame over that without shadows |");
    report.line("|---|---|---|---|---|");
    for source in &volumes {
        let volume = load(source, &LoadOptions::default())?;
        let transfer = own_or_suggested(source, &volume)?;
        let camera = |azimuth: f64| {
            let view = View { azimuth, elevation: 20.0, ..View::default() };
            Camera::new(&view, volume.grid(), [size; 2])
        };
        let mut prepared: Vec<(&str, Settings, Scene, f64, Vec<f64>)> = Vec::new();
        for (name, lighting) in ways()? {
            let settings = Settings { lighting: Some(lighting), ..Settings::default() };
            let scene = renderer.prepare(&volume, &transfer, &settings)?;
            let once = renderer.render(&scene, &camera(27.0)?, &settings)?.stats.seconds("classify").unwrap_or(0.0);
            prepared.push((name, settings, scene, once, Vec::new()));
        }
        for frame in 0..frames {
            for (_, settings, scene, _, times) in &mut prepared {
                let start = Instant::now();
                renderer.render(scene, &camera(30.0 + 3.0 * frame as f64)?, settings)?;
                times.push(start.elapsed().as_secs_f64());
            }
        }
        let (unshaded, without) =
            prepared.first().map_or((0.0, 1.0), |(.., once, times)| (*once, median(times.clone())));
        for (name, _, _, once, times) in prepared {
            let (frame, once) = (median(times), (once - unshaded).max(0.0));
            let file = source.rsplit('/').next().unwrap_or(source);
            report.line(format_args!("| {file} | {name} | {once:.2} | {:.0} | {:.2} |", frame * 1e3, frame / without));
        }
    }
    report.finish(renderer.adapter())
}
