//! The command `voxsplat pareto`: speed against error of many settings, as a report.

mod date;
mod page;
mod plan;
mod plot;
#[cfg(test)]
mod stages_test;
mod study;

use std::path::Path;
use std::time::Duration;

use clap::{ArgMatches, Command};
use flate2::Crc;
use serde::{Deserialize, Serialize};
use voxsplat::accuracy::Sample;
use voxsplat::appearance::Framing;
use voxsplat::camera::{Camera, View};
use voxsplat::engine::{Engine, EngineScene};
use voxsplat::figure::{Figure, Shown};
use voxsplat::formats::{LoadOptions, read_json};
use voxsplat::image::{Background, Image, check_writable, compare, difference_picture, write_file};
use voxsplat::kernel::Kernel;
use voxsplat::layers::Layers;
use voxsplat::program::{ClipSpec, TransferChoice, command_line, options_of};
use voxsplat::reference::Reference;
use voxsplat::renderer::Rendered;
use voxsplat::settings::{Painter, Response, Settings};
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::{Statistics, Volume};
use voxsplat::{Error, Frame, RendererOptions, formats};
use voxsplat_volume::vector::rotation;

use super::args::ParetoArgs;
use super::draw::with_units;
use super::effects::noted;
use super::failure::{Failure, fail, refuse};
use super::files::STUDY_FILES;
use super::fitted::transfer;
use super::job::{figure, settings, view};
use super::options::{file_name, words};
use super::output;
use super::progress::{ProgressLine, Remaining};
use super::report::{self, Choices, PictureLook};
use super::session::say_choice;
use super::stages::Stages;
use super::transfer::transfer as requested_transfer;
use super::tune::{Tuning, pairs_without};
use date::today;
use plan::{Plan, Task};
use plot::{Marker, Point, plot};
pub(crate) use study::variants;
use study::{Errors, Measurement, Variant, front, telling};

/// The subject of a study: an interrupted run continues only if every part of it is the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct StudySubject {
    /// The arguments of `voxsplat render` that make the picture, with names of files for their paths.
    command: String,
    volume: [u32; 3],
    /// A checksum of the distribution of the values and of the transfer function: files of one name may differ.
    content: String,
    views: u32,
    size: [u32; 2],
    sample: u32,
    adapter: String,
    driver: String,
    version: String,
}

/// The measurements and facts that a run keeps for the next.
#[derive(Debug, Serialize, Deserialize)]
struct KeptStudy {
    #[serde(flatten)]
    subject: StudySubject,
    /// The day of the last measurement.
    date: String,
    /// The settings without a measurement, as model and name.
    #[serde(default)]
    unmeasured: Vec<[String; 2]>,
    measurements: Vec<Measurement>,
}

/// The state of a study, for its report.
struct State {
    /// The number of all settings.
    all: usize,
    /// The number of settings that were measured in fewer frames than requested.
    short: usize,
    /// The seconds that are left; `None` at the end.
    left: Option<f64>,
    /// The command that measures everything that is missing.
    rest: String,
}

/// The best compromises, the fastest first.
#[derive(Serialize)]
struct Front<'a> {
    front: Vec<&'a Measurement>,
}

/// A picture of the same scene by another renderer.
#[derive(Debug, Deserialize)]
struct Rival {
    name: String,
    /// The seconds of a frame.
    seconds: f64,
    /// The error against the renderer's own truth, of 1.
    rms: f64,
}

/// The options of `voxsplat pareto` alone, and the options that a study varies.
const OWN: &str = "output views repeats patience seconds rivals resume json quiet shading kernel level tune";

/// The error of the truth: a tenth of the error of the most exact pictures.
const TOLERANCE: f64 = 1e-6;

/// The angle in degrees by which the eye turns before a frame is timed: a turntable does not draw the same frame twice.
const TURN: f64 = 3.0;

/// The largest JSON file that is read, in bytes.
const MAX_JSON: u64 = 64 << 20;

/// The keys of `--tune` that a study varies or measures by.
const STUDIED: &str =
    "sheets accumulate sheet-thickness precision table-error resolution interslice termination sample";

/// The golden angle, degrees: steps of it spread any number of views evenly.
const GOLDEN_ANGLE: f64 = 137.507_764_050_037_85;

/// The elevations of the views after the first, degrees, in turn.
const ELEVATIONS: [f64; 5] = [25.0, -35.0, 55.0, -15.0, 0.0];

/// A clock that returns the time since the start of a study: the machine's, or a test's.
pub(crate) type Clock<'a> = &'a dyn Fn() -> Duration;

/// Runs a study, whose times are all read from `clock`.
pub(crate) fn run(args: &ParetoArgs, line: (&Command, &ArgMatches), clock: Clock<'_>) -> Result<(), Failure> {
    let notes = noted(line.0, vec![line.1])?;
    args.input.check_one_time()?;
    let first = view(&args.view, args.size)?;
    let tuning = Tuning::new(&args.model.tune).map_err(Failure::usage)?;
    let mut settings = settings(&args.model, &tuning, Painter::Auto, &first)?;
    if settings.response == Response::Depth {
        return refuse("--response depth is no picture for a report: window shows it");
    }
    let (figure, units) = figure(&args.figure, args.size, &settings)?;
    let requested = requested_transfer(&args.model)?;
    if args.input.channel.len() > 1 {
        return refuse("--channel: a study is of one channel");
    }
    if matches!(requested.choice, TransferChoice::Labels) {
        return refuse("--transfer labels is for render and turntable");
    }
    check_folder(&args.output)?;
    notes.iter().for_each(|note| output::say(note));
    let rivals: Vec<Rival> = args.rivals.as_deref().map_or(Ok(Vec::new()), |path| read_json(path, MAX_JSON))?;
    let load = LoadOptions { stream_over: tuning.stream_over, ..args.input.options_for(&first, args.size) };
    let (volume, transfer, preset) = {
        let _progress = ProgressLine::spinner("reading");
        let volume = formats::load(&args.input.source, &load)?;
        say_choice(&volume, &load);
        let fitted = transfer(&args.input.source, &requested, &volume, false, 0, &mut Stages::default())?;
        fitted.notes.iter().for_each(|note| output::say(note));
        let preset = report::preset(&fitted);
        (with_units(&volume, &units), fitted.transfer, preset)
    };
    settings.clip = ClipSpec::intersection(&args.model.clip, &volume)?;
    let frame = args.view.frame.unwrap_or_else(|| Framing::suited_to(&first, true));
    let around = frame.hull(&Layers::of_volume(&volume, &transfer), &settings.clip)?;
    let first = View { around, ..first };
    let turned = (1..args.views).zip(ELEVATIONS.iter().cycle()).map(|(i, &elevation)| {
        let azimuth = first.azimuth + f64::from(i) * GOLDEN_ANGLE;
        View { direction: None, azimuth, elevation, ..first.clone() }
    });
    let cameras = std::iter::once(first.clone()).chain(turned);
    let cameras: Vec<Camera> =
        cameras.map(|view| Camera::new(&view, volume.grid(), args.size)).collect::<Result<_, _>>()?;
    let options = RendererOptions { adapter: args.adapter.clone(), ..RendererOptions::default() };
    let device = device(&options)?;
    let host = Engine::open(&RendererOptions::default(), &Settings { painter: Painter::Cpu, ..Settings::default() })?;
    let mut base = words(line, &OWN.split(' ').collect::<Vec<_>>(), file_name);
    let tune = pairs_without(&args.model.tune, &STUDIED.split(' ').collect::<Vec<_>>());
    base.extend(tune.into_iter().flat_map(|pairs| ["--tune".to_owned(), pairs]));
    let adapter = device.as_ref().unwrap_or(&host).adapter();
    let subject = StudySubject {
        command: command_line(&base),
        volume: volume.grid().dims(),
        content: content(&volume, &transfer)?,
        views: args.views,
        size: args.size,
        sample: tuning.sample,
        adapter: adapter.name.clone(),
        driver: adapter.driver.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let rest = |name: fn(&str) -> String| {
        let words = words(line, &["json", "quiet", "resume", "seconds"], name);
        format!("voxsplat pareto {} --resume --seconds 0", command_line(&words))
    };
    make_directory(&args.output)?;
    let mut variants = variants(&settings);
    variants.retain(|variant| device.is_some() || variant.settings.painter == Painter::Cpu);
    let mut run = Run {
        args,
        device,
        host,
        volume: &volume,
        transfer: &transfer,
        cameras,
        sample: Sample::new(args.size, tuning.sample),
        plan: Plan::new(&variants, args.seconds),
        variants,
        clock,
        rest: rest(file_name),
        rivals,
        figure,
        kept: kept(args, subject)?,
        scene: None,
        truths: Vec::new(),
        drawn: Vec::new(),
    };
    let front = run.measure()?;
    if output::is_json() {
        let light = args.model.light.iter().map(|light| light.text.clone()).collect();
        let look = PictureLook::new(&settings, light, (&first, frame), None);
        let choices =
            Choices { preset, classification: report::classification(&transfer, &settings), look: Some(look) };
        let files = STUDY_FILES.iter().map(|name| args.output.join(name)).filter(|path| path.is_file());
        let front = front.iter().filter_map(|&index| run.kept.measurements.get(index)).collect();
        return report::print(choices, files, Front { front });
    }
    let summary = summary(&run.kept, &front, &run.state(None), &args.output.join("report.html"), &rest(str::to_owned));
    output::print(&summary)
}

/// Refuses a folder that cannot be made or written to. It is made after the volume has been read.
fn check_folder(folder: &Path) -> Result<(), Failure> {
    let usage = |reason: String| refuse(format!("--output: {}: {reason}", folder.display()));
    let mut first = folder.join("report.html");
    while let Some(above) = first.parent().filter(|above| !above.as_os_str().is_empty() && !above.is_dir()) {
        if above.exists() {
            return usage(format!("{} is no directory", above.display()));
        }
        first = above.to_owned();
    }
    check_writable(&first).or_else(|error| usage(format!("{error:#}")))
}

/// Returns a checksum of the distribution of the values and of the transfer function.
fn content(volume: &Volume, transfer: &TransferFunction) -> Result<String, Failure> {
    let values = Statistics::of(volume)?;
    let mut sum = Crc::new();
    [values.min, values.max].iter().for_each(|value| sum.update(&value.to_le_bytes()));
    values.histogram().iter().for_each(|count| sum.update(&count.to_le_bytes()));
    sum.update(transfer.to_json().as_bytes());
    Ok(format!("{:08x}", sum.sum()))
}

fn make_directory(path: &Path) -> Result<(), Failure> {
    let failed = |e| Failure::failed(format!("{}: the directory cannot be made: {e}", path.display()));
    std::fs::create_dir_all(path).map_err(failed)
}

/// Returns the measurements of earlier runs of the same command, if this one resumes them.
fn kept(args: &ParetoArgs, subject: StudySubject) -> Result<KeptStudy, Failure> {
    let numbers = args.output.join("pareto.json");
    let measurements = if args.resume && numbers.exists() {
        let found: KeptStudy = read_json(&numbers, MAX_JSON)?;
        if found.subject != subject {
            return fail(format!(
                "{}: it is of another command, of other data, of another adapter or of another version: \
                 give another directory, or leave out --resume",
                numbers.display()
            ));
        }
        found.measurements
    } else {
        Vec::new()
    };
    Ok(KeptStudy { subject, date: today(), unmeasured: Vec::new(), measurements })
}

/// The properties for which a scene was prepared: the processor, post-shading, and the kernel for which samples were
/// filtered.
type Prepared = (bool, bool, Option<Kernel>);

/// Opens the device whose painters a study measures; `None` if none was requested and none can be opened.
fn device(options: &RendererOptions) -> Result<Option<Engine>, Failure> {
    let settings = Settings { painter: Painter::Tiles, ..Settings::default() };
    match Engine::open(options, &settings) {
        Err(error @ Error::NoAdapter(_)) if options.adapter.is_none() => {
            output::say(&format!("note: measuring --painter cpu alone because of {error}"));
            Ok(None)
        }
        opened => Ok(Some(opened?)),
    }
}

/// A study under way.
struct Run<'a> {
    args: &'a ParetoArgs,
    /// The device whose painters are measured; `None` if none can be opened.
    device: Option<Engine>,
    host: Engine,
    volume: &'a Volume,
    transfer: &'a TransferFunction,
    cameras: Vec<Camera>,
    /// The pixels that are compared with the truth.
    sample: Sample,
    variants: Vec<Variant>,
    plan: Plan,
    clock: Clock<'a>,
    /// The command that measures everything that is missing.
    rest: String,
    rivals: Vec<Rival>,
    /// The figure on the pictures of the page.
    figure: Figure,
    kept: KeptStudy,
    /// The scene of the last picture.
    scene: Option<(Prepared, EngineScene)>,
    /// The true sampled pixels of each view, by model.
    truths: Vec<(String, Vec<Image>)>,
    /// The picture of the first view of a variant, and its difference from the truth.
    drawn: Vec<(Variant, page::Shots)>,
}

impl Run<'_> {
    fn save(&mut self) -> Result<(), Failure> {
        self.kept.date = today();
        let missing = self.variants.iter().filter(|variant| self.measurement(variant).is_none());
        self.kept.unmeasured = missing.map(|variant| [variant.model.clone(), variant.name.clone()]).collect();
        let text = serde_json::to_string_pretty(&self.kept).map_err(|e| Failure::failed(e.to_string()))?;
        Ok(write_file(self.args.output.join("pareto.json"), text.as_bytes())?)
    }

    fn elapsed(&self) -> f64 {
        (self.clock)().as_secs_f64()
    }

    fn measurement(&self, variant: &Variant) -> Option<usize> {
        self.kept.measurements.iter().position(|measured| is_of(measured, variant))
    }

    /// Measures the settings, the most telling ones first, until the budget of time is used up. The report is complete
    /// after each row. Returns the front.
    fn measure(&mut self) -> Result<Vec<usize>, Failure> {
        let order = telling(&self.variants);
        let mut left = self.tasks(&order);
        let progress = Remaining::new("settings", left.len());
        let all = left.len();
        while !left.is_empty() {
            let elapsed = self.elapsed();
            // A report needs one row, whatever the budget is.
            let first = self.kept.measurements.iter().all(|measured| measured.frames.is_empty());
            let Some(at) = left.iter().position(|task| first || self.plan.fits(*task, elapsed)) else { break };
            let task = left.remove(at);
            let (Task::Row(variant) | Task::Round(variant)) = task;
            let Variant { model, name, .. } = &self.variants[variant];
            let seconds = self.plan.left(&left, elapsed).map(Duration::from_secs_f64);
            progress.at_left(all.saturating_sub(left.len() + 1), &format!("{model}: {name}"), seconds);
            match task {
                Task::Row(variant) => self.row(variant)?,
                Task::Round(variant) => self.time(variant)?,
            }
            left = self.tasks(&order);
            self.save()?;
            let more = left.iter().any(|task| self.plan.fits(*task, self.elapsed()));
            if matches!(task, Task::Row(_)) && more && self.kept.measurements.iter().any(|m| !m.frames.is_empty()) {
                let seconds = self.plan.left(&left, self.elapsed());
                self.write(Some(seconds.unwrap_or_default()))?;
            }
        }
        drop(progress);
        self.save()?;
        self.write(None)
    }

    /// Returns the tasks that are left.
    fn tasks(&self, order: &[usize]) -> Vec<Task> {
        let open: Vec<(bool, u32)> = self.variants.iter().map(|variant| self.open(variant)).collect();
        Plan::tasks(order, &open)
    }

    /// Returns whether the row of a variant is to be measured, and the number of further rounds of timing.
    fn open(&self, variant: &Variant) -> (bool, u32) {
        let rounds = self.args.repeats - 1;
        let Some(measured) = self.measurement(variant).map(|at| &self.kept.measurements[at]) else {
            return (true, rounds);
        };
        if measured.refused.is_some() || measured.seconds().is_some_and(|seconds| seconds > self.args.patience) {
            return (false, 0);
        }
        if measured.frames.is_empty() || self.is_cut(measured) {
            return (true, rounds);
        }
        let missing = (self.args.repeats * measured.views).saturating_sub(measured.frames.len() as u32);
        (false, missing.div_ceil(measured.views.max(1)))
    }

    /// Returns whether the budget of time has ended a row before its last view.
    fn is_cut(&self, measured: &Measurement) -> bool {
        measured.refused.is_none() && measured.views < self.args.views && measured.first <= self.args.patience
    }

    /// Measures the errors of a variant and times it once. A refusal of the renderer is a measurement too.
    fn row(&mut self, index: usize) -> Result<(), Failure> {
        let variant = self.variants[index].clone();
        if let Some(at) = self.measurement(&variant).filter(|&at| self.is_cut(&self.kept.measurements[at])) {
            self.kept.measurements.remove(at);
        }
        if self.measurement(&variant).is_none() {
            let truth = self.truth(index)?;
            let mut measured = Measurement {
                model: variant.model.clone(),
                name: variant.name.clone(),
                refused: None,
                painter: String::new(),
                views: 0,
                first: 0.0,
                frames: Vec::new(),
                errors: Errors::default(),
            };
            let start = self.elapsed();
            match self.errors(&variant, &truth, &mut measured) {
                Err(error) if error.refuses_settings() => measured.refused = Some(format!("{error:#}")),
                result => result?,
            }
            if measured.refused.is_none() {
                self.plan.took(self.plan.errors(index), self.elapsed() - start);
            }
            self.kept.measurements.push(measured);
        }
        self.time(index)
    }

    /// Draws each view from the start and compares it with its truth.
    fn errors(&mut self, variant: &Variant, truth: &[Image], measured: &mut Measurement) -> Result<(), Error> {
        let start = self.elapsed();
        self.scene = None;
        for (view, truth) in truth.iter().enumerate() {
            if measured.first > self.args.patience || view > 0 && self.plan.is_over(self.elapsed()) {
                break;
            }
            let camera = self.cameras[view];
            let rendered = self.draw(&camera, &variant.settings)?;
            if measured.views == 0 {
                measured.first = self.elapsed() - start;
                measured.painter = rendered.stats.painter.name().to_owned();
            }
            let c = compare(&self.sample.of(&rendered.image)?, truth, 0.0)?;
            let [red, green, blue, alpha] = c.max_channel;
            measured.views += 1;
            let errors = &mut measured.errors;
            let psnr = if errors.psnr == 0.0 { c.psnr } else { c.psnr.min(errors.psnr) };
            *errors = Errors {
                max: errors.max.max(c.max),
                p999: errors.p999.max(c.p999),
                rms: errors.rms.max(c.rms_covered),
                psnr: if psnr.is_finite() { psnr } else { 0.0 },
                alpha: errors.alpha.max(alpha),
                color: errors.color.max(red).max(green).max(blue),
            };
        }
        Ok(())
    }

    fn draw(&mut self, camera: &Camera, settings: &Settings) -> Result<Rendered, Error> {
        let filter = (settings.sharpness > 0.0).then(|| settings.reconstruction_kernel());
        let is_cpu = settings.painter == Painter::Cpu;
        let prepared = (is_cpu, settings.is_post_shaded(), filter);
        let engine = self.device.as_ref().filter(|_| !is_cpu).unwrap_or(&self.host);
        let scene = match self.scene.take().filter(|(held, _)| *held == prepared) {
            Some((_, scene)) => scene,
            None => engine.prepare_layers(&Layers::of_volume(self.volume, self.transfer), settings)?,
        };
        let (_, scene) = self.scene.insert((prepared, scene));
        engine.render(scene, &Frame::new(camera, settings))
    }

    /// Returns the true sampled pixels of each view, by the reference. They are traced at most once for a model, and
    /// kept for an interrupted run.
    fn truth(&mut self, index: usize) -> Result<Vec<Image>, Failure> {
        let variant = self.variants[index].clone();
        if let Some((_, truth)) = self.truths.iter().find(|(model, _)| *model == variant.model) {
            return Ok(truth.clone());
        }
        let start = self.elapsed();
        let number = self.variants.iter().position(|v| v.model == variant.model).unwrap_or(0);
        let folder = self.args.output.join("truth");
        let file = |view: usize| folder.join(format!("{number}-{view}.exr"));
        let views = self.cameras.len();
        let truth = if self.kept.measurements.iter().any(|m| m.model == variant.model) && file(views - 1).exists() {
            (0..views).map(|view| Image::load(file(view))).collect::<Result<Vec<Image>, _>>()?
        } else {
            let reference = Reference::new(self.volume, self.transfer, &variant.settings)?.with_tolerance(TOLERANCE);
            let [width, height] = self.sample.grid();
            let traced = |camera: &Camera| {
                let pixels = reference.pixels(camera, &self.sample.pixels())?;
                Image::new(width, height, pixels.into_iter().map(|pixel| pixel.map(|v| v as f32)).collect())
            };
            let truth = self.cameras.iter().map(traced).collect::<Result<Vec<Image>, _>>()?;
            make_directory(&folder)?;
            for (view, image) in truth.iter().enumerate() {
                image.save(file(view), Background::Transparent)?;
            }
            self.plan.took(self.plan.truth(index), self.elapsed() - start);
            truth
        };
        self.plan.has_truth(index);
        self.truths.push((variant.model, truth.clone()));
        Ok(truth)
    }

    /// Times each view of a variant once.
    fn time(&mut self, index: usize) -> Result<(), Failure> {
        let variant = self.variants[index].clone();
        let Some(at) = self.measurement(&variant) else { return Ok(()) };
        let measured = &self.kept.measurements[at];
        if measured.refused.is_some() {
            return Ok(());
        }
        let (begun, some) = (self.elapsed(), !measured.frames.is_empty());
        for view in 0..measured.views as usize {
            if (some || view > 0) && self.plan.is_over(self.elapsed()) {
                break;
            }
            let camera = self.cameras[view];
            // A frame that is not timed, then one of another angle.
            self.draw(&camera, &variant.settings)?;
            let turn = rotation(camera.up, TURN.to_radians());
            let turned = Camera { forward: turn * camera.forward, right: turn * camera.right, ..camera };
            let start = self.elapsed();
            self.draw(&turned, &variant.settings)?;
            let seconds = self.elapsed() - start;
            self.kept.measurements[at].frames.push(seconds);
        }
        self.plan.took(self.plan.frames(index), self.elapsed() - begun);
        Ok(())
    }

    fn state(&self, left: Option<f64>) -> State {
        let short =
            self.variants.iter().filter(|v| self.measurement(v).is_some() && self.open(v) != (false, 0)).count();
        State { all: self.variants.len(), short, left, rest: self.rest.clone() }
    }

    /// Writes the report: numbers, plots and the page, each of which is complete at every moment. Returns the front.
    fn write(&mut self, left: Option<f64>) -> Result<Vec<usize>, Failure> {
        let directory = &self.args.output;
        let front = front(&self.kept.measurements, |errors| errors.rms);
        let commands: Vec<String> = self.kept.measurements.iter().map(|measured| self.command(measured)).collect();
        let name = file_name(&self.args.input.source.to_string_lossy());
        write_file(directory.join("pareto.csv"), csv(&self.kept.measurements, &front, &commands).as_bytes())?;
        let [width, height] = self.args.size;
        let title = format!("{name}, {width} x {height} pixels");
        let mut plots = Vec::new();
        for (file, name, error) in ERRORS {
            let points = points(&self.kept.measurements, error, if file == "rms" { &self.rivals } else { &[] });
            let svg = plot(&title, name, &points)
                .ok_or_else(|| Failure::failed("nothing was timed: there is no plot".to_owned()))?;
            write_file(directory.join(format!("time-{file}.svg")), svg.as_bytes())?;
            plots.push(svg);
        }
        let exact: fn(&Measurement) -> f64 = |measured| measured.errors.rms;
        let fast: fn(&Measurement) -> f64 = |measured| measured.seconds().unwrap_or(f64::INFINITY);
        let mut best = Vec::new();
        for (title, rank) in [("The most exact of the front", exact), ("The fastest of the front", fast)] {
            let measurements = front.iter().map(|&index| &self.kept.measurements[index]);
            let found = measurements.min_by(|a, b| rank(a).total_cmp(&rank(b)));
            let found = found.and_then(|found| self.variants.iter().position(|v| is_of(found, v)));
            best.extend(found.map(|variant| (title, variant)));
        }
        let mut pictures = Vec::new();
        for (title, index) in best {
            let variant = self.variants[index].clone();
            let held = self.drawn.iter().find(|(of, _)| *of == variant).map(|(_, shots)| shots.clone());
            let shots = match held {
                Some(shots) => shots,
                None => self.shots(index)?,
            };
            pictures.push(page::Pictures { title, variant, shots });
        }
        // Only the pictures of this page are kept for the next one.
        self.drawn = pictures.iter().map(|of| (of.variant.clone(), of.shots.clone())).collect();
        let page = page::page(&page::Report {
            name: &name,
            caption: self.figure.caption.as_deref(),
            volume: self.volume,
            kept: &self.kept,
            state: &self.state(left),
            front: &front,
            commands: &commands,
            plots: &plots,
            pictures: &pictures,
        });
        write_file(self.args.output.join("report.html"), page.as_bytes())?;
        Ok(front)
    }

    /// Draws the first view of a variant and its difference from the truth, as files.
    fn shots(&mut self, index: usize) -> Result<page::Shots, Failure> {
        let variant = self.variants[index].clone();
        let truth = self.truth(index)?;
        let camera = self.cameras[0];
        let mut image = self.draw(&camera, &variant.settings)?.image;
        let difference = difference_picture(&self.sample.of(&image)?, &truth[0], page::GAIN)?;
        if !self.figure.is_empty() {
            let (volume, transfer) = (self.volume, self.transfer);
            let values = if self.figure.color_bar { Some(volume.value_range()?) } else { None };
            let shown = Shown { volume, transfer, values, camera: &camera, model: variant.settings.model };
            image = self.figure.draw(&image, Background::default(), &shown)?;
        }
        Ok([image.to_png(Background::default())?, difference.to_png(Background::default())?])
    }

    fn variant(&self, measured: &Measurement) -> Option<&Variant> {
        self.variants.iter().find(|variant| is_of(measured, variant))
    }

    /// Returns the command that draws the picture of a measurement.
    fn command(&self, measured: &Measurement) -> String {
        let base = &self.kept.subject.command;
        let options = self.variant(measured).map(|v| command_line(&options_of(&v.settings))).unwrap_or_default();
        format!("voxsplat render {base} -o picture.png {options}")
    }
}

/// Returns whether a measurement is of a variant.
fn is_of(measured: &Measurement, variant: &Variant) -> bool {
    (&measured.model, &measured.name) == (&variant.model, &variant.name)
}

type ErrorOf = fn(&Errors) -> f64;

/// The plotted errors: the name of the file and of the axis, and the error.
const ERRORS: [(&str, &str, ErrorOf); 2] = [
    ("rms", "rms error of covered pixels", |errors| errors.rms),
    ("p999", "error that 99.9 % of covered pixels keep", |errors| errors.p999),
];

/// Returns the points of a plot. Points of the front are numbered as in the tables.
fn points(measurements: &[Measurement], error: ErrorOf, rivals: &[Rival]) -> Vec<Point> {
    let front = front(measurements, error);
    let own = measurements.iter().enumerate().filter_map(|(index, m)| {
        let number = front.iter().position(|&at| at == index);
        Some(Point {
            series: m.model.clone(),
            label: number.map(|number| (number + 1).to_string()),
            seconds: m.seconds()?,
            error: error(&m.errors),
            front: number.is_some(),
            marker: match m.painter.as_str() {
                "cpu" => Marker::Diamond,
                "quads" => Marker::Triangle,
                _ => Marker::Disc,
            },
        })
    });
    let others = rivals.iter().map(|rival| Point {
        series: "other renderers".to_owned(),
        label: Some(rival.name.clone()),
        seconds: rival.seconds,
        error: rival.rms,
        front: false,
        marker: Marker::Square,
    });
    own.chain(others).collect()
}

fn csv(measurements: &[Measurement], front: &[usize], commands: &[String]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let mut text =
        "model,name,painter,front,views,frame_s,first_s,frames,max,p999,rms,psnr_db,alpha_max,color_max,refused,\
         command\n"
            .to_owned();
    for (index, (m, command)) in measurements.iter().zip(commands).enumerate() {
        let number = front.iter().position(|&at| at == index).map(|number| (number + 1).to_string());
        let seconds = m.seconds().map(|seconds| seconds.to_string()).unwrap_or_default();
        let Errors { max, p999, rms, psnr, alpha, color } = m.errors;
        text += &format!(
            "{},{},{},{},{},{seconds},{},{},{max},{p999},{rms},{psnr},{alpha},{color},{},{}\n",
            quoted(&m.model),
            quoted(&m.name),
            m.painter,
            number.unwrap_or_default(),
            m.views,
            m.first,
            m.frames.len(),
            quoted(m.refused.as_deref().unwrap_or_default()),
            quoted(command)
        );
    }
    text
}

/// Returns the front as a table, and the part of the study that is missing.
fn summary(kept: &KeptStudy, front: &[usize], state: &State, page: &Path, rest: &str) -> String {
    let mut text = format!("{:>3}  {:>10}  {:>9}  {:>9}  way\n", "", "frame, ms", "rms", "99.9 %");
    for (number, m) in front.iter().filter_map(|&index| kept.measurements.get(index)).enumerate() {
        let milliseconds = m.seconds().unwrap_or(f64::NAN) * 1e3;
        let Errors { rms, p999, .. } = m.errors;
        text +=
            &format!("{:>3}  {milliseconds:>10.1}  {rms:>9.2e}  {p999:>9.2e}  {}: {}\n", number + 1, m.model, m.name);
    }
    text += &format!("\nreport: {}\n", page.display());
    if let Some(missing) = state.missing(kept) {
        text += &format!("{missing}: {rest}\n");
    }
    text
}

impl State {
    /// Returns the part of a study that the budget of time has left out, as a sentence without its end; `None` if
    /// nothing is missing.
    fn missing(&self, kept: &KeptStudy) -> Option<String> {
        let unmeasured = kept.unmeasured.len();
        let rows = (unmeasured > 0).then(|| format!("{unmeasured} of {} settings are not measured", self.all));
        let short = (self.short > 0).then(|| format!("{} are measured in fewer frames than requested", self.short));
        let missing: Vec<String> = rows.into_iter().chain(short).collect();
        (!missing.is_empty()).then(|| format!("{}; this command completes the study", missing.join(", ")))
    }
}
