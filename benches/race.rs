//! voxsplat beside other renderers, on the same scenes and in one run.
//!
//! ```text
//! cargo bench --bench race -- --work DIR [--scripts DIR --python PYTHON] [--scene NAME] [--runs N] [--frames N]
//!     [--write]
//! ```
//!
//! `benches/race.json` names the scenes, the transfer function and the rivals. A rival is a script in --scripts that
//! --python runs. It takes `--frames N --out PNG` and prints one JSON object with `median_s`: the median seconds of the
//! frames of a turntable, the first frame left out. --work holds the volumes. Without --scripts voxsplat runs alone.
//!
//! In each of N runs every entry makes one picture from a cold start and then a turntable of 10-degree steps, each in a
//! process of its own, one after the other. An entry that takes over 1.5 s a frame takes part in the first run only.
//!
//! Prints per scene and entry, as medians: wall time of the command that makes one picture, time of a frame, peak
//! resident memory of that command, the error against the entry's own truth (rms over the colours of covered pixels, in
//! steps of 8 bits), and the ratios to the best rival. voxsplat's truth is its f64 reference, made once and kept in
//! WORK/truth, which takes minutes. The truth of a rival is what `reference.py` of the scripts makes. `--write` keeps
//! the table in docs/measurements.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "printing its table is what this program is for")]

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use common::{Arguments, Outcome, Report, measured, median};
use serde::Deserialize;
use voxsplat::reference::Reference;
use voxsplat::renderer::adapters;
use voxsplat::settings::{Painter, QuadsSettings, TilesSettings};
use voxsplat::transfer::ControlPoint;
use voxsplat::{
    Background, Camera, Image, LoadOptions, Renderer, RendererOptions, Settings, TransferFunction, View, Volume, load,
};

#[derive(Deserialize)]
struct Config {
    scenes: Vec<SceneConfig>,
    volume: String,
    transfer: Vec<[f64; 5]>,
    rivals: Vec<Rival>,
}

#[derive(Deserialize)]
struct SceneConfig {
    name: String,
    view_height: f64,
}

#[derive(Deserialize, Clone)]
struct Rival {
    name: String,
    /// What its field ends at: the outermost `centers` of voxels, or the faces of their `cells`.
    r#box: String,
    command: Vec<String>,
}

struct Options {
    work: PathBuf,
    scripts: Option<PathBuf>,
    python: String,
    scene: Option<String>,
    runs: usize,
    frames: usize,
    /// In a child process: the painter of its scene.
    child: Option<String>,
}

const SIZE: u32 = 512;

fn options(arguments: &mut Arguments) -> Outcome<Options> {
    let options = Options {
        work: arguments.option("--work")?.unwrap_or_else(|| PathBuf::from("target/race")),
        scripts: arguments.option("--scripts")?,
        python: arguments.option("--python")?.unwrap_or_else(|| "python3".to_owned()),
        scene: arguments.option("--scene")?,
        runs: arguments.option("--runs")?.unwrap_or(5),
        frames: arguments.option("--frames")?.unwrap_or(8),
        child: arguments.option("--child")?,
    };
    match arguments.positional()? {
        [] => Ok(options),
        [unknown, ..] => Err(format!("unknown argument {unknown}").into()),
    }
}

/// A scene of the race.
struct Scene {
    name: String,
    path: String,
    view_height: f64,
}

impl Scene {
    fn camera(&self, volume: &Volume, azimuth: f64) -> Outcome<Camera> {
        let view = View { azimuth, elevation: 20.0, view_height: Some(self.view_height), ..View::default() };
        Ok(Camera::new(&View { up: glam::DVec3::Y, ..view }, volume.grid(), [SIZE; 2])?)
    }

    fn command_line(&self, transfer: &Path, out: &Path) -> Vec<String> {
        let height = self.view_height.to_string();
        let [transfer, out] = [transfer, out].map(|path| path.to_string_lossy().into_owned());
        ["render", &self.path, "-o", &out, "--size", "512", "--azimuth", "30", "--elevation", "20", "--up", "0,1,0"]
            .into_iter()
            .chain(["--view-height", &height, "--transfer", &transfer, "--background", "black"])
            .map(str::to_owned)
            .collect()
    }
}

fn transfer(config: &Config) -> Outcome<TransferFunction> {
    let point = |p: &[f64; 5]| ControlPoint { value: p[0], color: [p[1], p[2], p[3]], opacity: p[4] };
    Ok(TransferFunction::new(config.transfer.iter().map(point).collect(), Some(1.0))?)
}

/// Colours of a picture before black.
fn colors(image: &Image) -> Vec<[f64; 3]> {
    image.pixels().iter().map(|p| [p[0], p[1], p[2]].map(f64::from)).collect()
}

/// Root mean square over the colours of pixels that either covers, of 255; the first as 8 bits hold it.
fn error(picture: &[[f64; 3]], truth: &[[f64; 3]]) -> f64 {
    let rounded = |c: f64| (c.clamp(0.0, 1.0) * 255.0).round();
    let shown = |p: &[f64; 3]| p.iter().any(|&c| c > 1.0 / 255.0);
    let covered = picture.iter().zip(truth).filter(|(p, t)| shown(p) || shown(t));
    let squares: Vec<f64> =
        covered.flat_map(|(p, t)| p.iter().zip(t)).map(|(p, t)| (rounded(*p) - 255.0 * t).powi(2)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// voxsplat's part: a turntable in this process, and the error of its first picture.
fn child(options: &Options, config: &Config, scene: &Scene, painter: &str) -> Outcome {
    let painter = match painter {
        "tiles" => Painter::Tiles(TilesSettings::default()),
        _ => Painter::Quads(QuadsSettings::default()),
    };
    let settings = Settings { painter, ..Settings::default() };
    let volume = load(&scene.path, &LoadOptions::default())?;
    let transfer = transfer(config)?;
    let renderer = Renderer::new(&RendererOptions::default())?;
    let prepared = renderer.prepare(&volume, &transfer, &settings)?;
    let mut times = Vec::new();
    let mut first = None;
    for frame in 0..options.frames {
        let camera = scene.camera(&volume, 30.0 + 10.0 * frame as f64)?;
        let start = Instant::now();
        let image = renderer.render(&prepared, &camera, &settings)?.image;
        times.push(start.elapsed().as_secs_f64());
        first.get_or_insert(image);
    }
    let kept = options.work.join("truth").join(format!("{}.exr", scene.name));
    let truth = if kept.exists() {
        Image::load(&kept)?
    } else {
        eprintln!("{}: the reference is made", scene.name);
        let truth = Reference::new(&volume, &transfer, &settings)?.render(&scene.camera(&volume, 30.0)?)?;
        std::fs::create_dir_all(options.work.join("truth"))?;
        truth.save(&kept, Background::Transparent)?;
        truth
    };
    let first = first.ok_or("no frames")?;
    let error = error(&colors(&first), &colors(&truth));
    println!("{}", serde_json::json!({ "median_s": median(times.split_off(1)), "error": error }));
    Ok(())
}

/// The colours of a NumPy array of height x width x 4 doubles.
fn numpy(path: &Path) -> Outcome<Vec<[f64; 3]>> {
    let bytes = std::fs::read(path)?;
    let header = bytes.get(8..10).ok_or("no NumPy file")?;
    let start = 10 + usize::from(u16::from_le_bytes([header[0], header[1]]));
    let numbers: Vec<f64> = bytes[start..].chunks_exact(8).map(bytemuck::pod_read_unaligned).collect();
    Ok(numbers.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect())
}

/// A participant: a painter of voxsplat, or a script.
enum Entry {
    Own(&'static str),
    Rival(Rival),
}

#[derive(Default)]
struct Times {
    cold: Vec<f64>,
    frame: Vec<f64>,
    memory: Vec<f64>,
    error: f64,
}

struct Race<'a> {
    options: &'a Options,
    scene: &'a Scene,
    transfer: &'a Path,
    out: PathBuf,
}

impl Race<'_> {
    /// One picture from a cold start, and a turntable.
    fn run(&self, entry: &Entry, times: &mut Times) -> Outcome {
        let Options { work, scripts, python, frames, .. } = self.options;
        let frames = frames.to_string();
        match entry {
            Entry::Own(painter) => {
                let arguments = self.scene.command_line(self.transfer, &self.out);
                let mut once = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
                let (wall, memory, _) = measured(once.args(arguments).args(["--painter", painter]))?;
                let mut turn = Command::new(std::env::current_exe()?);
                turn.args(["--bench", "--child", painter, "--scene", &self.scene.name, "--frames", &frames, "--work"]);
                turn.arg(work);
                let (_, _, json) = measured(&mut turn)?;
                times.cold.push(wall);
                times.memory.push(memory);
                times.frame.push(json["median_s"].as_f64().unwrap_or(f64::NAN));
                times.error = json["error"].as_f64().unwrap_or(f64::NAN);
            }
            Entry::Rival(rival) => {
                let scripts = scripts.as_ref().ok_or("no scripts")?;
                let command = |frames: &str| {
                    let mut command = Command::new(python);
                    let arguments = rival.command[1..].iter().map(|a| a.replace("{volume}", &self.scene.path));
                    command.arg(scripts.join(&rival.command[0])).args(arguments);
                    command.args(["--frames", frames, "--out"]).arg(&self.out);
                    command.env("PEERS_WORK", work).env("EGL_PLATFORM", "surfaceless").env_remove("DISPLAY");
                    command
                };
                let (wall, memory, _) = measured(&mut command("1"))?;
                if times.cold.is_empty() {
                    let truth = work.join("truth").join(format!("{}.{}.npy", self.scene.name, rival.r#box));
                    if !truth.exists() {
                        std::fs::create_dir_all(work.join("truth"))?;
                        let mut make = Command::new(python);
                        make.arg(scripts.join("reference.py")).arg(&self.scene.path);
                        make.args(["--box", &rival.r#box, "--npy"])
                            .arg(&truth)
                            .arg("--out")
                            .arg(work.join("truth.png"));
                        measured(make.env("PEERS_WORK", work))?;
                    }
                    times.error = error(&colors(&Image::load(&self.out)?), &numpy(&truth)?);
                }
                let (_, _, json) = measured(&mut command(&frames))?;
                times.cold.push(wall);
                times.memory.push(memory);
                times.frame.push(json["median_s"].as_f64().unwrap_or(f64::NAN));
            }
        }
        Ok(())
    }
}

fn main() -> Outcome {
    let mut arguments = Arguments::of_process();
    let options = options(&mut arguments)?;
    let mut report = Report::new("race", &arguments);
    let config: Config = serde_json::from_str(include_str!("race.json"))?;
    let volume = config.volume.replace("{work}", &options.work.to_string_lossy());
    let scenes = config.scenes.iter().map(|scene| Scene {
        name: scene.name.clone(),
        path: volume.replace("{scene}", &scene.name),
        view_height: scene.view_height,
    });
    let scenes: Vec<Scene> = scenes.collect();
    if let Some(painter) = &options.child {
        let scene = scenes.iter().find(|s| Some(&s.name) == options.scene.as_ref()).ok_or("no such scene")?;
        return child(&options, &config, scene, painter);
    }
    let file = options.work.join("race-transfer.json");
    let points = config
        .transfer
        .iter()
        .map(|p| serde_json::json!({ "value": p[0], "color": [p[1], p[2], p[3]], "opacity": p[4] }));
    std::fs::write(
        &file,
        serde_json::json!({ "unit_distance": 1.0, "points": points.collect::<Vec<_>>() }).to_string(),
    )?;
    let mut entries = vec![Entry::Own("tiles"), Entry::Own("quads")];
    if options.scripts.is_some() {
        entries.extend(config.rivals.iter().cloned().map(Entry::Rival));
    }
    for scene in scenes.iter().filter(|s| options.scene.as_ref().is_none_or(|only| *only == s.name)) {
        let out = options.work.join("race.png");
        let race = Race { options: &options, scene, transfer: &file, out };
        let mut times: Vec<Times> = entries.iter().map(|_| Times::default()).collect();
        for _ in 0..options.runs {
            for (entry, times) in entries.iter().zip(&mut times) {
                // One run tells enough of what takes seconds a frame.
                if times.frame.iter().all(|&seconds| seconds < 1.5) {
                    race.run(entry, times)?;
                }
            }
        }
        print(&mut report, scene, &entries, times);
    }
    report.finish(adapters().first().ok_or("no adapter")?)
}

fn print(report: &mut Report, scene: &Scene, entries: &[Entry], times: Vec<Times>) {
    let rows: Vec<[f64; 4]> =
        times.into_iter().map(|t| [median(t.cold), median(t.frame) * 1e3, median(t.memory), t.error]).collect();
    let rival = |entry: &Entry| matches!(entry, Entry::Rival(_));
    let best: [f64; 3] = std::array::from_fn(|column| {
        let rivals = entries.iter().zip(&rows).filter(|(entry, _)| rival(entry));
        rivals.map(|(_, row)| row[column]).fold(f64::INFINITY, f64::min)
    });
    report.line(format_args!("\n| {:<12} | cold, s | x | frame, ms | x | peak, MiB | x | error |", scene.name));
    report.line("|---|---|---|---|---|---|---|---|");
    for (entry, [cold, frame, memory, error]) in entries.iter().zip(&rows) {
        let name = match entry {
            Entry::Own(painter) => (*painter).to_owned(),
            Entry::Rival(rival) => rival.name.clone(),
        };
        // Without rivals there is no ratio.
        let ratio = |own: f64, best: f64| if best.is_finite() { format!("{:.2}", own / best) } else { String::new() };
        let [cold_ratio, frame_ratio] = [ratio(*cold, best[0]), ratio(*frame, best[1])];
        let memory_ratio = ratio(*memory, best[2]);
        report.line(format_args!(
            "| {name:<12} | {cold:>8.2} | {cold_ratio:>6} | {frame:>9.1} | {frame_ratio:>6} | {memory:>9.0} \
             | {memory_ratio:>6} | {error:>7.3} |"
        ));
    }
}
