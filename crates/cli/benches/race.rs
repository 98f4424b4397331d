//! voxsplat beside other renderers, on the same scenes and in one run.
//!
//! ```text
//! cargo bench --bench race -- --work DIR [--scripts DIR --python PYTHON] [--scenes NAME,..] [--pictures NAME,..]
//!     [--rivals NAME,..] [--painters NAME,..] [--size N] [--runs N] [--frames N] [--no-truth] [--write]
//! ```
//!
//! `race.json` names the scenes, the pictures, the transfer function and the rivals. --work holds the volumes and the
//! programs that rivals build. A rival has two commands. `probe` succeeds if the rival is installed, and may build it;
//! the report names missing rivals. `command` draws `{frames}` pictures of a turntable of 10-degree steps, the first of
//! them into the file `{out}`, and prints one JSON object with `median_s`, the median seconds of the frames after the
//! first. The environment variable PEERS_WORK is --work, and PEERS_UNIT the unit of opacities in voxels: a script
//! that does not read it draws another scene if the unit is not 1 (head512). --scripts is the folder of the commands'
//! scripts; without it voxsplat runs alone.
//!
//! - VTK and others are packages of PYTHON: `pip install vtk pyvista pygfx rendercanvas wgpu numba pillow`
//! - OSPRay is part of a package: `pip download ovito==3.17.2 --no-deps -d D`, `unzip 'D/ovito*.whl' 'ovito/plugins/*'
//!   -d D`, and the environment variable OSPRAY_LIB is D/ovito/plugins
//! - VolPack, Debian and Ubuntu: `apt-get install libvolpack1-dev gcc`
//!
//! In each of N runs every entry makes one picture from a cold start and then a turntable, each in a process of its
//! own, one after the other. An entry that takes over 1.5 s a frame takes part in the first run only.
//!
//! Prints per scene, picture and entry, as medians: wall time of the command that makes one picture, time of a frame,
//! peak resident memory of that command, the error against the entry's own truth (rms over the colours of covered
//! pixels, in steps of 8 bits), and the ratios to the best rival, of those with more than 8 bits. voxsplat's truth is
//! its f64 reference to 1e-5 of a channel, made once and kept in WORK/truth. `reference.py` of the scripts makes the
//! truth of a rival, of unlit pictures along parallel rays: no two rivals light alike. Scenes without `truth` have no
//! error. The truth of lit pictures takes minutes and more each; --no-truth leaves all errors out. The first picture of
//! each entry stays in WORK/pictures.
//! `--write` keeps the tables in docs/measurements, each as soon as it is whole, and a plot of time against error.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "printing its table is what this program is for")]

#[path = "../../../benches/common/mod.rs"]
mod common;
#[allow(dead_code, unused_imports, reason = "a bench has no tests")]
#[path = "../src/pareto/plot.rs"]
mod plot;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use common::{Arguments, Outcome, Report, measured, median};
use plot::{Marker, Point, plot};
use serde::Deserialize;
use voxsplat::camera::ProjectionKind;
use voxsplat::lighting::Lighting;
use voxsplat::reference::Reference;
use voxsplat::renderer::adapters;
use voxsplat::settings::{Painter, QuadsSettings, Shading};
use voxsplat::transfer::ControlPoint;
use voxsplat::volume::SampleType;
use voxsplat::{
    Background, Camera, Frame, Image, LoadOptions, Renderer, RendererOptions, Settings, TransferFunction, View, Volume,
    load,
};

#[derive(Deserialize)]
struct Config {
    scenes: Vec<Scene>,
    pictures: Vec<Picture>,
    transfer: Vec<[f64; 5]>,
    rivals: Vec<Rival>,
}

/// A volume with its transfer function.
#[derive(Deserialize, Clone)]
struct Scene {
    name: String,
    dims: [u32; 3],
    /// The file that voxsplat reads; rivals find their files by the name.
    file: String,
    /// The type of its samples, if it has no header.
    r#type: Option<String>,
    /// The value that is 1 in the transfer function.
    one: f64,
    /// The unit of opacities, in voxels.
    unit: f64,
    /// Whether an error can be measured.
    truth: bool,
}

/// A kind of picture.
#[derive(Deserialize, Clone, Copy)]
struct Kind {
    lit: bool,
    perspective: bool,
    post: bool,
}

#[derive(Deserialize, Clone)]
struct Picture {
    name: String,
    #[serde(flatten)]
    kind: Kind,
}

#[derive(Deserialize, Clone)]
struct Rival {
    name: String,
    /// The end of its field: the outermost `centers` of voxels, or the faces of their `cells`.
    r#box: String,
    probe: Vec<String>,
    command: Vec<String>,
    /// Arguments for light and for rays through one eye; `None` if it lacks them.
    lit: Option<Vec<String>>,
    perspective: Option<Vec<String>>,
    /// The scenes that it draws; all, if there are none.
    #[serde(default)]
    scenes: Vec<String>,
    /// The kind of file that it writes.
    #[serde(default = "png")]
    picture: String,
    /// Whether it computes with 8 bits, so that others are not compared with it.
    #[serde(default)]
    coarse: bool,
}

fn png() -> String {
    "png".to_owned()
}

struct Options {
    work: PathBuf,
    scripts: Option<PathBuf>,
    python: String,
    scenes: Option<String>,
    pictures: Option<String>,
    rivals: Option<String>,
    painters: String,
    /// Width and height of pictures in pixels.
    size: u32,
    /// Whether errors are measured.
    truth: bool,
    runs: usize,
    frames: usize,
    /// In a child process: the painter of its scene and picture.
    child: Option<String>,
}

const AZIMUTH: f64 = 30.0;
const ELEVATION: f64 = 20.0;
/// Seconds after which a turntable of ours ends early.
const PATIENCE: f64 = 60.0;

fn options(arguments: &mut Arguments) -> Outcome<Options> {
    let options = Options {
        work: arguments.option("--work")?.unwrap_or_else(|| PathBuf::from("target/race")),
        scripts: arguments.option("--scripts")?,
        python: arguments.option("--python")?.unwrap_or_else(|| "python3".to_owned()),
        scenes: arguments.option("--scenes")?,
        pictures: arguments.option("--pictures")?,
        rivals: arguments.option("--rivals")?,
        painters: arguments.option("--painters")?.unwrap_or_else(|| "auto".to_owned()),
        size: arguments.option("--size")?.unwrap_or(512),
        truth: !arguments.flag("--no-truth"),
        runs: arguments.option("--runs")?.unwrap_or(5),
        frames: arguments.option("--frames")?.unwrap_or(8).max(2),
        child: arguments.option("--child")?,
    };
    match arguments.positional()? {
        [] => Ok(options),
        [unknown, ..] => Err(format!("unknown argument {unknown}").into()),
    }
}

/// Returns the items that a list of names parted by commas has; all without a list.
fn chosen<T: Clone>(all: &[T], list: Option<&String>, name: fn(&T) -> &String) -> Outcome<Vec<T>> {
    let Some(list) = list else { return Ok(all.to_vec()) };
    let find = |wanted: &str| {
        let found = all.iter().find(|item| name(item) == wanted);
        found.cloned().ok_or_else(|| format!("no {wanted:?} in crates/cli/benches/race.json").into())
    };
    list.split(',').filter(|wanted| !wanted.is_empty()).map(find).collect()
}

impl Scene {
    fn path(&self, work: &Path) -> PathBuf {
        work.join("vol").join(&self.file)
    }

    fn view_height(&self) -> f64 {
        1.5 * f64::from(self.dims.into_iter().max().unwrap_or(1))
    }

    fn volume(&self, work: &Path) -> Outcome<Volume> {
        let raw = match &self.r#type {
            Some(name) => LoadOptions {
                dims: Some(self.dims),
                sample_type: Some(name.parse::<SampleType>()?),
                ..LoadOptions::default()
            },
            None => LoadOptions::default(),
        };
        Ok(load(self.path(work), &raw)?)
    }

    fn transfer(&self, curve: &[[f64; 5]]) -> Outcome<TransferFunction> {
        let point = |p: &[f64; 5]| ControlPoint { value: self.one * p[0], color: [p[1], p[2], p[3]], opacity: p[4] };
        Ok(TransferFunction::new(curve.iter().map(point).collect(), Some(self.unit))?)
    }

    fn camera(&self, kind: Kind, volume: &Volume, azimuth: f64, size: u32) -> Outcome<Camera> {
        let projection = match kind.perspective {
            true => ProjectionKind::Perspective { fov: 30.0 },
            false => ProjectionKind::Orthographic,
        };
        let view = View {
            azimuth,
            elevation: ELEVATION,
            up: glam::DVec3::Y,
            view_height: Some(self.view_height()),
            projection,
            ..View::default()
        };
        Ok(Camera::new(&view, volume.grid(), [size; 2])?)
    }

    fn arguments(&self, kind: Kind, options: &Options, transfer: &Path, out: &Path) -> Vec<String> {
        let [volume, transfer, out] =
            [&self.path(&options.work), transfer, out].map(|path| path.to_string_lossy().into_owned());
        let [size, azimuth, elevation] = [f64::from(options.size), AZIMUTH, ELEVATION].map(|number| number.to_string());
        let height = self.view_height().to_string();
        let [x, y, z] = self.dims;
        let dims = format!("{x},{y},{z}");
        let mut line = vec!["render", &volume, "-o", &out, "--transfer", &transfer, "--background", "black"];
        line.extend(["--size", &size, "--azimuth", &azimuth, "--elevation", &elevation, "--up", "0,1,0"]);
        line.extend(["--view-height", &height]);
        if let Some(name) = &self.r#type {
            line.extend(["--dims", &dims, "--type", name]);
        }
        if kind.lit {
            line.extend(["--light", "headlight"]);
        }
        if kind.perspective {
            line.extend(["--projection", "perspective"]);
        }
        if kind.post {
            line.extend(["--shading", "post"]);
        }
        line.into_iter().map(str::to_owned).collect()
    }
}

/// Colours of a picture before black.
fn colors(image: &Image) -> Vec<[f64; 3]> {
    image.pixels().iter().map(|p| [p[0], p[1], p[2]].map(f64::from)).collect()
}

/// Colours of a square picture in a file, binary PPM included.
fn colors_of(path: &Path, size: u32) -> Outcome<Vec<[f64; 3]>> {
    if path.extension().is_none_or(|extension| extension != "ppm") {
        return Ok(colors(&Image::load(path)?));
    }
    let bytes = std::fs::read(path)?;
    let samples = bytes.len().checked_sub((size * size * 3) as usize).ok_or("a PPM of another size")?;
    let of_255 = |c: u8| f64::from(c) / 255.0;
    Ok(bytes[samples..].chunks_exact(3).map(|p| [p[0], p[1], p[2]].map(of_255)).collect())
}

/// Returns the root mean square over the colours of pixels that either picture covers, of 255; the first picture is
/// rounded to 8 bits.
fn error(picture: &[[f64; 3]], truth: &[[f64; 3]]) -> f64 {
    let rounded = |c: f64| (c.clamp(0.0, 1.0) * 255.0).round();
    let shown = |p: &[f64; 3]| p.iter().any(|&c| c > 1.0 / 255.0);
    let covered = picture.iter().zip(truth).filter(|(p, t)| shown(p) || shown(t));
    let squares: Vec<f64> =
        covered.flat_map(|(p, t)| p.iter().zip(t)).map(|(p, t)| (rounded(*p) - 255.0 * t).powi(2)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// The run of voxsplat: a turntable in this process, and the error of its first picture.
fn child(race: &Race<'_>, curve: &[[f64; 5]], painter: &str) -> Outcome {
    let Race { options, scene, picture, .. } = race;
    let Kind { lit, post, .. } = picture.kind;
    let painter = match painter {
        "tiles" => Painter::Tiles,
        "quads" => Painter::Quads(QuadsSettings::default()),
        _ => Painter::Auto,
    };
    let settings = Settings {
        painter,
        lighting: lit.then(Lighting::default),
        shading: if post { Shading::Post } else { Shading::Pre },
        ..Settings::default()
    };
    let volume = scene.volume(&options.work)?;
    let transfer = scene.transfer(curve)?;
    let renderer = Renderer::new(&RendererOptions::default())?;
    let prepared = renderer.prepare(&volume, &transfer, &settings)?;
    let mut times = Vec::new();
    let mut first = None;
    for frame in 0..options.frames {
        let camera = scene.camera(picture.kind, &volume, AZIMUTH + 10.0 * frame as f64, options.size)?;
        let start = Instant::now();
        let image = renderer.render(&prepared, &Frame::new(&camera, &settings))?.image;
        times.push(start.elapsed().as_secs_f64());
        first.get_or_insert(image);
        if times.len() > 1 && times.iter().sum::<f64>() > PATIENCE {
            break;
        }
    }
    let mut own_error = None;
    if race.has_truth() {
        let kept = options.work.join("truth").join(format!("{}.exr", race.name()));
        let truth = if kept.exists() {
            Image::load(&kept)?
        } else {
            eprintln!("{}: the reference is made", race.name());
            let camera = scene.camera(picture.kind, &volume, AZIMUTH, options.size)?;
            let reference = Reference::new(&volume, &transfer, &settings)?.with_tolerance(Reference::TOLERANCE);
            let truth = reference.render(&camera)?;
            std::fs::create_dir_all(options.work.join("truth"))?;
            truth.save(&kept, Background::Transparent)?;
            truth
        };
        own_error = Some(error(&colors(&first.ok_or("no frames")?), &colors(&truth)));
    }
    println!("{}", serde_json::json!({ "median_s": median(times.split_off(1)), "error": own_error }));
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

/// A participant: voxsplat with a painter, or another program.
enum Entry {
    Own(String),
    Rival(Rival),
}

impl Entry {
    fn name(&self) -> String {
        match self {
            Self::Own(painter) => format!("voxsplat, {painter}"),
            Self::Rival(rival) => rival.name.clone(),
        }
    }
}

#[derive(Default)]
struct Times {
    cold: Vec<f64>,
    frame: Vec<f64>,
    memory: Vec<f64>,
    error: Option<f64>,
}

/// A picture that entries draw.
struct Race<'a> {
    options: &'a Options,
    scene: &'a Scene,
    picture: &'a Picture,
}

/// Returns a word of a rival's command with its places filled.
fn filled(word: &str, options: &Options, places: &[(&str, String)]) -> String {
    let path = |path: &Path| path.to_string_lossy().into_owned();
    let scripts = options.scripts.as_deref().map(path).unwrap_or_default();
    let mut word = word
        .replace("{python}", &options.python)
        .replace("{scripts}", &scripts)
        .replace("{work}", &path(&options.work));
    for (place, value) in places {
        word = word.replace(place, value);
    }
    word
}

impl Rival {
    /// Whether it can be run.
    fn is_there(&self, options: &Options) -> bool {
        let words: Vec<String> = self.probe.iter().map(|word| filled(word, options, &[])).collect();
        let Some((program, rest)) = words.split_first() else { return true };
        let probe = Command::new(program).args(rest).stdout(Stdio::null()).stderr(Stdio::null()).status();
        probe.is_ok_and(|status| status.success())
    }

    /// Whether it can draw a picture of a scene.
    fn draws(&self, scene: &Scene, kind: Kind) -> bool {
        let knows = self.scenes.is_empty() || self.scenes.contains(&scene.name);
        knows && (!kind.lit || self.lit.is_some()) && (!kind.perspective || self.perspective.is_some())
    }
}

impl Race<'_> {
    /// The scene, the picture and its size, for names of files.
    fn name(&self) -> String {
        format!("{}-{}-{}", self.scene.name, self.picture.name, self.options.size)
    }

    /// Whether the error of voxsplat's picture is measured.
    fn has_truth(&self) -> bool {
        self.scene.truth && self.options.truth
    }

    /// Whether the errors of rivals are measured too.
    fn is_comparable(&self) -> bool {
        let Kind { lit, perspective, .. } = self.picture.kind;
        self.has_truth() && !lit && !perspective
    }

    /// Keeps the first picture of an entry.
    fn keep(&self, entry: &Entry, picture: &Path) -> Outcome {
        let folder = self.options.work.join("pictures");
        std::fs::create_dir_all(&folder)?;
        let extension = picture.extension().unwrap_or_default().to_string_lossy();
        std::fs::copy(picture, folder.join(format!("{}-{}.{extension}", self.name(), entry.name())))?;
        Ok(())
    }

    /// One picture from a cold start, and a turntable.
    fn run(&self, entry: &Entry, transfer: &Path, times: &mut Times) -> Outcome {
        let Options { work, scripts, python, frames, size, .. } = self.options;
        let kind = self.picture.kind;
        match entry {
            Entry::Own(painter) => {
                let out = work.join("race.png");
                let arguments = self.scene.arguments(kind, self.options, transfer, &out);
                let mut once = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
                let (wall, memory, _) = measured(once.args(arguments).args(["--painter", painter]))?;
                self.keep(entry, &out)?;
                let mut turn = Command::new(std::env::current_exe()?);
                turn.args((!self.options.truth).then_some("--no-truth"));
                turn.args(["--bench", "--child", painter, "--scenes", &self.scene.name]);
                turn.args(["--pictures", &self.picture.name, "--frames", &frames.to_string()]);
                turn.args(["--size", &size.to_string(), "--work"]).arg(work);
                let (_, _, json) = measured(&mut turn)?;
                times.cold.push(wall);
                times.memory.push(memory);
                times.frame.push(json["median_s"].as_f64().unwrap_or(f64::NAN));
                times.error = json["error"].as_f64();
            }
            Entry::Rival(rival) => {
                let out = work.join("race").with_extension(&rival.picture);
                let command = |frames: usize| {
                    let [nx, ny, nz] = self.scene.dims.map(|n| n.to_string());
                    let places = [
                        ("{scene}", self.scene.name.clone()),
                        ("{frames}", frames.to_string()),
                        ("{size}", size.to_string()),
                        ("{out}", out.to_string_lossy().into_owned()),
                        ("{nx}", nx),
                        ("{ny}", ny),
                        ("{nz}", nz),
                    ];
                    let light = rival.lit.iter().filter(|_| kind.lit);
                    let eye = rival.perspective.iter().filter(|_| kind.perspective);
                    let words = rival.command.iter().chain(light.chain(eye).flatten());
                    let words: Vec<String> = words.map(|word| filled(word, self.options, &places)).collect();
                    let mut command = Command::new(&words[0]);
                    command.args(&words[1..]).env("PEERS_WORK", work).env("PEERS_UNIT", self.scene.unit.to_string());
                    command.env("EGL_PLATFORM", "surfaceless").env_remove("DISPLAY");
                    command
                };
                let (wall, memory, _) = measured(&mut command(1))?;
                self.keep(entry, &out)?;
                if times.cold.is_empty() && self.is_comparable() {
                    let truth = work.join("truth").join(format!("{}.{}.npy", self.name(), rival.r#box));
                    if !truth.exists() {
                        std::fs::create_dir_all(work.join("truth"))?;
                        let script = scripts.as_ref().ok_or("no scripts")?.join("reference.py");
                        let mut make = Command::new(python);
                        make.arg(script).arg(work.join("vol").join(format!("{}.npy", self.scene.name)));
                        make.args(["--size", &size.to_string(), "--box", &rival.r#box, "--npy"]).arg(&truth);
                        make.arg("--out").arg(work.join("truth.png"));
                        measured(make.env("PEERS_WORK", work).env("PEERS_UNIT", self.scene.unit.to_string()))?;
                    }
                    times.error = Some(error(&colors_of(&out, *size)?, &numpy(&truth)?));
                }
                let (_, _, json) = measured(&mut command(*frames))?;
                times.cold.push(wall);
                times.memory.push(memory);
                times.frame.push(json["median_s"].as_f64().unwrap_or(f64::NAN));
            }
        }
        Ok(())
    }

    /// All runs of all entries that draw the picture.
    fn table(&self, report: &mut Report, rivals: &[Rival], transfer: &Path, plotted: &mut Vec<Point>) -> Outcome {
        let painters = self.options.painters.split(',').map(|painter| Entry::Own(painter.to_owned()));
        let rivals = rivals.iter().filter(|rival| rival.draws(self.scene, self.picture.kind)).cloned();
        let entries: Vec<Entry> = painters.chain(rivals.map(Entry::Rival)).collect();
        let mut times: Vec<Times> = entries.iter().map(|_| Times::default()).collect();
        for _ in 0..self.options.runs {
            for (entry, times) in entries.iter().zip(&mut times) {
                // One run tells enough of what takes seconds a frame.
                if times.frame.iter().all(|&seconds| seconds < 1.5) {
                    self.run(entry, transfer, times)?;
                }
            }
        }
        print(report, &format!("{}, {}", self.scene.name, self.picture.name), &entries, &times);
        if self.is_comparable() {
            plotted.extend(self.points(&entries, &times)?);
        }
        Ok(())
    }

    /// Returns time against error of all entries, with the front marked. Keeps the rivals' in WORK/rivals, for
    /// `voxsplat pareto --rivals`.
    fn points(&self, entries: &[Entry], times: &[Times]) -> Outcome<Vec<Point>> {
        let found =
            entries.iter().zip(times).filter_map(|(entry, t)| Some((entry, median(t.frame.clone()), t.error? / 255.0)));
        let found: Vec<(&Entry, f64, f64)> = found.collect();
        let rivals = found.iter().filter_map(|(entry, seconds, rms)| match entry {
            Entry::Rival(rival) => Some(serde_json::json!({ "name": rival.name, "seconds": seconds, "rms": rms })),
            Entry::Own(_) => None,
        });
        let folder = self.options.work.join("rivals");
        std::fs::create_dir_all(&folder)?;
        let file = folder.join(format!("{}-{}.json", self.scene.name, self.picture.name));
        std::fs::write(file, serde_json::to_string_pretty(&rivals.collect::<Vec<_>>())?)?;
        let point = |(entry, seconds, error): &(&Entry, f64, f64)| Point {
            series: self.scene.name.clone(),
            label: Some(entry.name()),
            seconds: *seconds,
            error: *error,
            front: !found.iter().any(|(_, s, e)| s <= seconds && e <= error && (s < seconds || e < error)),
            marker: if matches!(entry, Entry::Own(_)) { Marker::Disc } else { Marker::Square },
        };
        Ok(found.iter().map(point).collect())
    }
}

fn main() -> Outcome {
    let mut arguments = Arguments::of_process();
    let options = options(&mut arguments)?;
    let mut report = Report::new("race", &arguments);
    let config: Config = serde_json::from_str(include_str!("race.json"))?;
    let scenes = chosen(&config.scenes, options.scenes.as_ref(), |scene| &scene.name)?;
    let pictures = chosen(&config.pictures, options.pictures.as_ref(), |picture| &picture.name)?;
    if let Some(painter) = &options.child {
        let ([scene, ..], [picture, ..]) = (&*scenes, &*pictures) else { return Err("nothing to draw".into()) };
        return child(&Race { options: &options, scene, picture }, &config.transfer, painter);
    }
    let mut rivals = Vec::new();
    if options.scripts.is_some() {
        for rival in chosen(&config.rivals, options.rivals.as_ref(), |rival| &rival.name)? {
            if rival.is_there(&options) {
                rivals.push(rival);
            } else {
                report.line(format_args!("{} is left out: it is not there.", rival.name));
            }
        }
    }
    let adapters = adapters();
    let adapter = adapters.first().ok_or("no adapter")?;
    let mut plotted = Vec::new();
    for scene in &scenes {
        let transfer = options.work.join("race-transfer.json");
        std::fs::write(&transfer, scene.transfer(&config.transfer)?.to_json())?;
        for picture in &pictures {
            Race { options: &options, scene, picture }.table(&mut report, &rivals, &transfer, &mut plotted)?;
            if let Some(page) = report.save(adapter)?
                && !plotted.is_empty()
            {
                let title = format!(
                    "{0} x {0} pixels, unlit, parallel rays: each renderer against its own truth",
                    options.size
                );
                let svg = plot(&title, "rms error of covered pixels", &plotted).ok_or("nothing was timed")?;
                std::fs::write(page.with_extension("svg"), svg)?;
            }
        }
    }
    report.finish(adapter)
}

fn print(report: &mut Report, title: &str, entries: &[Entry], times: &[Times]) {
    let of = |numbers: &[f64]| median(numbers.to_vec());
    let rows = times.iter().map(|t| ([of(&t.cold), of(&t.frame) * 1e3, of(&t.memory)], t.error));
    let rows: Vec<([f64; 3], Option<f64>)> = rows.collect();
    let counts = |entry: &Entry| matches!(entry, Entry::Rival(rival) if !rival.coarse);
    let best: [f64; 3] = std::array::from_fn(|column| {
        let rivals = entries.iter().zip(&rows).filter(|(entry, _)| counts(entry));
        rivals.map(|(_, (row, _))| row[column]).fold(f64::INFINITY, f64::min)
    });
    report.line(format_args!("\n| {title} | cold, s | x | frame, ms | x | peak, MiB | x | error |"));
    report.line("|---|---|---|---|---|---|---|---|");
    for (entry, ([cold, frame, memory], error)) in entries.iter().zip(&rows) {
        let name = entry.name();
        // Without rivals there is no ratio.
        let ratio = |own: f64, best: f64| if best.is_finite() { format!("{:.2}", own / best) } else { String::new() };
        let [cold_ratio, frame_ratio] = [ratio(*cold, best[0]), ratio(*frame, best[1])];
        let memory_ratio = ratio(*memory, best[2]);
        let error = error.map(|error| format!("{error:.3}")).unwrap_or_default();
        report.line(format_args!(
            "| {name:<14} | {cold:>8.2} | {cold_ratio:>6} | {frame:>9.1} | {frame_ratio:>6} | {memory:>9.0} \
             | {memory_ratio:>6} | {error:>7} |"
        ));
    }
}
