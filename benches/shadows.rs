//! The cost of shadows: once per set of lights, and in each frame of a turntable.
//!
//! ```text
//! cargo bench --bench shadows -- [VOLUME...] [--size PIXELS] [--frames N] [--shading pre|post] [--truths] [--write]
//! ```
//!
//! Volumes are files or `demo:NAME:SIZE`, with their own or the suggested transfer function. A directional light is
//! drawn without shadows, with hard and with soft shadows; then studio light. Turntables alternate, and each begins
//! with an untimed frame. `--truths` compares two truths instead, post-shaded: light computed at voxels, and light
//! computed at every point.

#![allow(clippy::print_stdout, reason = "printing its table is what this program is for")]

mod common;

use std::time::Instant;

use common::{Arguments, Outcome, Report, median, own_or_suggested};
use glam::DVec3;
use voxsplat::image::compare;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::reference::Reference;
use voxsplat::settings::Shading;
use voxsplat::{Camera, Frame, LoadOptions, Renderer, RendererOptions, Scene, Settings, View, load};

/// The volumes of the table.
const VOLUMES: [&str; 5] =
    ["demo:vessels:128", "demo:shell:128", "demo:marschner-lobb:96", "demo:shepp-logan:160", "demo:vessels:256"];

/// The volumes whose truths are compared.
const TRUTHS: [&str; 4] = ["demo:vessels:24", "demo:marschner-lobb:24", "demo:sphere:24", "demo:shepp-logan:24"];

/// The error of light at voxels: pictures of 24 x 24 pixels in a hard light from the side.
fn compare_truths(report: &mut Report, volumes: &[String]) -> Outcome {
    report.line("| volume | light at voxels against light at every point, rms over covered pixels | shadows make |");
    report.line("|---|---|---|");
    for source in volumes {
        let volume = load(source, &LoadOptions::default())?;
        let transfer = own_or_suggested(source, &volume)?;
        let view = View { azimuth: 30.0, elevation: 20.0, ..View::default() };
        let camera = Camera::new(&view, volume.grid(), [24; 2])?;
        let settings = |shadows| {
            let light = Light { color: [2.0; 3], ..Light::directional(DVec3::new(-0.5, -0.7, 0.6)) };
            let lighting = Some(Lighting { lights: vec![light], shadows, ..Lighting::default() });
            Settings { shading: Shading::Post, lighting, ..Settings::default() }
        };
        let truth = |reference: Reference| reference.with_tolerance(1e-3).render(&camera);
        let everywhere = truth(Reference::with_light_everywhere(&volume, &transfer, &settings(1.0))?)?;
        let [at_voxels, without] = [1.0, 0.0].map(|s| Reference::new(&volume, &transfer, &settings(s)).and_then(truth));
        let (at_voxels, without) = (at_voxels?, without?);
        let rms = |image| compare(image, &everywhere, 0.0).map(|comparison| comparison.rms_covered);
        report.line(format_args!("| {source} | {:.1e} | {:.1e} |", rms(&at_voxels)?, rms(&without)?));
    }
    Ok(())
}

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
    let shading: Shading = arguments.option("--shading")?.unwrap_or_default();
    let truths = arguments.flag("--truths");
    let mut volumes = arguments.positional()?.to_vec();
    if volumes.is_empty() {
        volumes = if truths { TRUTHS.map(str::to_owned).to_vec() } else { VOLUMES.map(str::to_owned).to_vec() };
    }
    let mut report = Report::new("shadows", &arguments);
    let renderer = Renderer::new(&RendererOptions::default())?;
    if truths {
        compare_truths(&mut report, &volumes)?;
        return report.finish(renderer.adapter());
    }
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
            let settings = Settings { shading, lighting: Some(lighting), ..Settings::default() };
            let scene = renderer.prepare(&volume, &transfer, &settings)?;
            let once = renderer
                .render(&scene, &Frame::new(&camera(27.0)?, &settings))?
                .stats
                .seconds("classify")
                .unwrap_or(0.0);
            prepared.push((name, settings, scene, once, Vec::new()));
        }
        for frame in 0..frames {
            for (_, settings, scene, _, times) in &mut prepared {
                let start = Instant::now();
                renderer.render(scene, &Frame::new(&camera(30.0 + 3.0 * frame as f64)?, settings))?;
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
