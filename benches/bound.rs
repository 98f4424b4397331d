//! How often pictures keep a requested error, and their cost.
//!
//! ```text
//! cargo bench --bench bound -- [--seeds FIRST..LAST] [--scans DIR] [--size PIXELS] [--write]
//! ```
//!
//! Each seed (0..119) draws a combination: a scene (built-in volumes, opaque and narrow variants of them, and the
//! volume files of DIR), a view, a model, and a bound E from 3e-4 to 3e-2. `accuracy::choose` chooses settings for it.
//! Their picture is compared with the f64 reference at other pixels than the pixels of the choice. Then a grid of
//! settings is timed (each twice after an untimed frame) and measured at the same pixels. The chosen settings are
//! compared with the cheapest settings of the grid that keep E.
//!
//! Prints a row for each combination, and the shares that keep E and 2 E. `--write` keeps them in docs/measurements.

#![allow(clippy::print_stdout, reason = "printing its table is what this program is for")]

mod common;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use common::{Arguments, Outcome, Report, median, own_or_suggested};
use voxsplat::accuracy::{Truth, choose};
use voxsplat::engine::Engine;
use voxsplat::kernel::Kernel;
use voxsplat::layers::Layers;
use voxsplat::lighting::Lighting;
use voxsplat::settings::{Level, Model, Painter, QuadsSettings, Shading};
use voxsplat::transfer::ControlPoint;
use voxsplat::{
    Camera, Frame, LoadOptions, ProjectionKind, Renderer, RendererOptions, Scene, Settings, TransferFunction, View,
    Volume, load,
};

/// Pixels traced for the choice.
const CHOOSING: u32 = 2048;
/// Pixels traced for the check: their grid lies between the pixels of the choice.
const CHECKING: u32 = 6000;

/// Steele, Lea and Flood 2014, "Fast splittable pseudorandom number generators".
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn of<T: Clone>(&mut self, choices: &[T]) -> T {
        choices[(self.bits() % choices.len() as u64) as usize].clone()
    }
}

struct Combination {
    name: String,
    volume: Volume,
    transfer: TransferFunction,
    camera: Camera,
    settings: Settings,
    bound: f64,
}

/// The same curve with opacities multiplied by a factor, at most 0.99.
fn denser(transfer: &TransferFunction, times: f64) -> voxsplat::Result<TransferFunction> {
    let points = transfer.points().iter().map(|p| ControlPoint { opacity: (p.opacity * times).min(0.99), ..*p });
    TransferFunction::new(points.collect(), transfer.unit_distance())
}

fn combination(seed: u64, scans: &[PathBuf], size: u32) -> Outcome<Combination> {
    let mut random = Random(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
    let demos =
        ["marschner-lobb:40", "sphere:48", "vessels:64", "shepp-logan:56", "shell:48", "vessels:40", "shell:64"];
    let from_scans = !scans.is_empty() && random.between(0.0, 1.0) < 0.35;
    let source = match from_scans {
        true => random.of(scans).to_string_lossy().into_owned(),
        false => format!("demo:{}", random.of(&demos)),
    };
    let volume = load(&source, &LoadOptions::default())?;
    let density = random.of(&[1.0, 1.0, 0.3, 4.0, 30.0]);
    let transfer = denser(&own_or_suggested(&source, &volume)?, density)?;
    let projection = random.of(&[ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 30.0 }]);
    let view = View {
        azimuth: random.between(-180.0, 180.0),
        elevation: random.between(-80.0, 80.0),
        projection,
        zoom: random.of(&[1.0, 1.0, 2.0, if from_scans { 1.5 } else { 0.5 }]),
        ..View::default()
    };
    let model = random.of(&[Model::Composite, Model::Composite, Model::Composite, Model::Xray, Model::Mip]);
    let composite = model == Model::Composite;
    let shading = if composite { random.of(&[Shading::Pre, Shading::Pre, Shading::Post]) } else { Shading::Pre };
    let lit = composite && random.of(&[false, true]);
    let kernel = random.of(&[Kernel::default(), Kernel::default(), Kernel::KAISER_BESSEL]);
    let settings = Settings { model, shading, kernel, lighting: lit.then(Lighting::default), ..Settings::default() };
    // In smaller pictures kernels of scans grow over 4 voxels, and a post-shaded frame takes half a minute.
    let size = if from_scans { 2 * size } else { size };
    let camera = Camera::new(&view, volume.grid(), [size; 2])?;
    // With the thin sheets of smaller bounds, a frame of a post-shaded scan takes minutes.
    let least: f64 = if from_scans && settings.is_post_shaded() { 1e-2 } else { 0.0 };
    let bound = random.of(&[3e-4, 1e-3, 3e-3, 1e-2, 3e-2]);
    let bound = f64::max(bound, least);
    let file = source.rsplit('/').next().unwrap_or(&source);
    let what = if composite { shading.name() } else { model.name() };
    let light = if lit { ", lit" } else { "" };
    let rays = if camera.eye().is_some() { "perspective" } else { "parallel" };
    let kind = if matches!(kernel, Kernel::Gaussian { .. }) { "" } else { ", blob" };
    let name = format!("{file} x {density}, {what}{light}{kind}, {rays}, zoom {}", view.zoom);
    Ok(Combination { name, volume, transfer, camera, settings, bound })
}

/// The grid of settings with which the choice is compared.
fn grid(settings: &Settings) -> Vec<Settings> {
    let mut all = vec![settings.clone()];
    for level in [0, 1, 2] {
        all.push(Settings { level: Level::At(level), ..settings.clone() });
    }
    for sheet_thickness in [2.0, 1.0, 0.5, 0.25, 0.125] {
        let painter = Painter::Quads(QuadsSettings { sheet_thickness, ..QuadsSettings::default() });
        all.push(Settings { painter, ..settings.clone() });
    }
    all
}

/// Seconds of a frame after an untimed frame.
fn seconds(renderer: &Renderer, scene: &Scene, c: &Combination, settings: &Settings) -> voxsplat::Result<f64> {
    let mut times = Vec::new();
    for _ in 0..3 {
        let start = Instant::now();
        renderer.render(scene, &Frame::new(&c.camera, settings))?;
        times.push(start.elapsed().as_secs_f64());
        // One frame suffices for slow settings.
        if start.elapsed().as_secs_f64() > 2.0 {
            break;
        }
    }
    Ok(median(times.split_off(usize::from(times.len() > 1))))
}

struct Row {
    ratio: f64,
    keeps: bool,
    cost: Option<f64>,
}

fn row(engine: &Engine, c: &Combination, report: &mut Report, seed: u64) -> Outcome<Row> {
    let Engine::Device(renderer) = engine else { return Err("no device is open".into()) };
    let (scene_of, at) = (Layers::of_volume(&c.volume, &c.transfer), &c.camera);
    let chosen = choose(engine, &scene_of, at, &c.settings, c.bound, CHOOSING)?;
    let truth = Truth::trace(&scene_of, at, &c.settings, CHECKING)?;
    let error = truth.estimate(&chosen.rendered.image)?.error;
    let scene = renderer.prepare(&c.volume, &c.transfer, &c.settings)?;
    let own = seconds(renderer, &scene, c, &chosen.settings)?;
    let mut cheapest = f64::INFINITY;
    // Settings that take much longer than the choice are not the cheapest.
    for settings in grid(&c.settings).into_iter().filter(|_| chosen.keeps) {
        let start = Instant::now();
        let Ok(rendered) = renderer.render(&scene, &Frame::new(at, &settings)) else { continue };
        let once = start.elapsed().as_secs_f64();
        if truth.estimate(&rendered.image)?.error <= c.bound && once < 4.0 * own + 0.5 {
            cheapest = cheapest.min(seconds(renderer, &scene, c, &settings)?);
        }
    }
    let cost = cheapest.is_finite().then(|| own / cheapest);
    let ratio = error / c.bound;
    let text = cost.map(|cost| format!("{cost:.2}")).unwrap_or_default();
    let keeps = if chosen.keeps { "" } else { "no way found" };
    report.line(format_args!(
        "| {seed} | {} | {:.0e} | {:.2} | {:.1e} | {ratio:.2} | {:.0} | {text} | {} | {keeps} |",
        c.name,
        c.bound,
        chosen.estimate.error / c.bound,
        error,
        own * 1e3,
        chosen.tried.len(),
    ));
    Ok(Row { ratio, keeps: chosen.keeps, cost })
}

fn main() -> Outcome {
    let mut arguments = Arguments::of_process();
    let seeds: String = arguments.option("--seeds")?.unwrap_or_else(|| "0..119".to_owned());
    let (first, last) = seeds.split_once("..").ok_or("--seeds FIRST..LAST")?;
    let (first, last): (u64, u64) = (first.parse()?, last.parse()?);
    let scans: Option<PathBuf> = arguments.option("--scans")?;
    let size = arguments.option("--size")?.unwrap_or(256);
    arguments.positional()?;
    let mut files = Vec::new();
    if let Some(folder) = scans {
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            let name = path.to_string_lossy().into_owned();
            if [".nii.gz", ".nrrd", ".mha", ".nii"].iter().any(|end| name.ends_with(end)) {
                files.push(path);
            }
        }
        files.sort();
    }
    let mut report = Report::new("bound", &arguments);
    let engine = Engine::Device(Arc::new(Renderer::new(&RendererOptions::default())?));
    report.line("| seed | scene | E | estimated / E | error | error / E | frame, ms | x cheapest | tried | |");
    report.line("|---|---|---|---|---|---|---|---|---|---|");
    let mut rows = Vec::new();
    for seed in first..=last {
        rows.push(row(&engine, &combination(seed, &files, size)?, &mut report, seed)?);
        report.save(&engine.adapter())?;
    }
    let kept: Vec<&Row> = rows.iter().filter(|row| row.keeps).collect();
    let share = |holds: &dyn Fn(&Row) -> bool| {
        100.0 * kept.iter().filter(|row| holds(row)).count() as f64 / kept.len().max(1) as f64
    };
    let costs: Vec<f64> = kept.iter().filter_map(|row| row.cost).collect();
    let dear = costs.iter().filter(|&&cost| cost > 1.5).count();
    report.line(format_args!(
        "\nOf {} combinations, {} have a way that was found to keep E. Of these the error keeps E in {:.1} %, 2 E in \
         {:.1} %. The chosen settings take {:.2} times (median) the cheapest of the grid that keeps E, over 1.5 times \
         in {dear} of {}.",
        rows.len(),
        kept.len(),
        share(&|row| row.ratio <= 1.0),
        share(&|row| row.ratio <= 2.0),
        median(costs.clone()),
        costs.len()
    ));
    report.finish(&engine.adapter())
}
