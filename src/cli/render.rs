//! `voxsplat render`.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use voxsplat::accuracy::{Chosen, Estimate, Truth, choose};
use voxsplat::camera::{Camera, Hull, View};
use voxsplat::figure::{Figure, Shown};
use voxsplat::image::{Image, Note};
use voxsplat::lighting::Lighting;
use voxsplat::reference::Reference;
use voxsplat::renderer::{Rendered, Renderer, RendererOptions};
use voxsplat::settings::Settings;
use voxsplat::stats::{Clock, StageTime, Stats};
use voxsplat::transfer::TransferFunction;
use voxsplat::transfer::presets::{self, Preset, Suggestion};
use voxsplat::volume::{Statistics, Units, Volume};
use voxsplat::{demos, formats};

use super::args::{FrameArg, StatsFormat};
use super::job::{Engine, RenderJob, Transfer};
use super::options::{command_line, options_of};
use super::parse::GradientOpacity;
use super::progress::{self, Progress};
use super::stderr::silenced;
use super::{Failure, output};

/// Host times of the stages, in the order in which they ran.
#[derive(Default)]
pub(super) struct Stages(Vec<StageTime>);

impl Stages {
    fn time<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.0.push(StageTime { name, seconds: start.elapsed().as_secs_f64(), clock: Clock::Host });
        result
    }
}

/// Statistics of a picture by the reference.
#[derive(Serialize)]
struct ReferenceStats {
    painter: &'static str,
    size: [u32; 2],
    voxels: u64,
    stages: Vec<StageTime>,
}

pub(super) fn run(mut job: RenderJob) -> Result<(), Failure> {
    let mut stages = Stages::default();
    let mut opening = Stages::default();
    let progress = Progress::spinner("reading");
    // Opening the driver takes about as long as reading a small volume, so both run at once. The driver is silenced
    // meanwhile, and with it this process: notes are printed afterwards.
    let (read, opened) = std::thread::scope(|scope| {
        let adapter = match &job.engine {
            Engine::Device { adapter } => Some(adapter.clone()),
            Engine::Reference => None,
        };
        let device = adapter.map(|adapter| {
            let opening = &mut opening;
            let open = move || silenced(|| Renderer::new(&RendererOptions { adapter, progress: progress::reporter() }));
            scope.spawn(move || opening.time("device", open))
        });
        let mut read = || {
            let volume = stages.time("load", || formats::load(&job.source, &job.load))?;
            let volume = with_units(volume, &job.units);
            let fitted = transfer(&job.source, (&job.transfer, job.gradient.as_ref()), &volume, &mut stages)?;
            Ok::<_, Failure>((volume, fitted))
        };
        (read(), device.map(|thread| thread.join()))
    });
    drop(progress);
    let (volume, Fitted { transfer, preset, note }) = read?;
    if let Some(note) = note {
        let frames = "; the picture frames what shows, and with --frame volume the whole volume";
        output::say(&(note + if job.frame == FrameArg::Visible { frames } else { "" }));
    }
    if job.chooses_light && preset.is_some_and(|preset| preset.surfaces) {
        job.settings.lighting = Some(Lighting::studio(job.view.forward()?, job.view.up));
        output::say("note: --light studio is taken, as the preset shows surfaces; --light off is without");
    }
    stages.0.append(&mut opening.0);
    let around = stages.time("framing", || framed(job.frame, &volume, &transfer))?;
    let camera = Camera::new(&View { around, ..job.view.clone() }, volume.grid(), job.size)?;
    let save = |image: &Image, notes: &[Note], stages: &mut Stages| {
        let shown = Shown { volume: &volume, transfer: &transfer, camera: &camera, model: job.settings.model };
        let draw = || job.figure.draw_region(image, job.region, job.background, &shown);
        let drawn = if job.figure.is_empty() { None } else { Some(stages.time("figure", draw)?) };
        let image = drawn.as_ref().unwrap_or(image);
        stages.time("encode", || image.save_with_notes(&job.output, job.background, notes))
    };
    match opened {
        Some(opened) => {
            let renderer = opened.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
            let (mut rendered, settings, estimate) = draw(&renderer, (&volume, &transfer), &camera, &job)?;
            let before = stages.0.len();
            let predicted = format!("{:.1e}", rendered.stats.predicted.error());
            let mut notes = notes(&settings, &job.figure, vec![Note { name: "Predicted error", text: predicted }]);
            notes.extend(estimate.map(|e| Note { name: "Estimated error", text: in_words(&e) }));
            save(&rendered.image, &notes, &mut stages)?;
            let after = stages.0.split_off(before);
            rendered.stats.stages.splice(0..0, stages.0);
            rendered.stats.stages.extend(after);
            let verified = job.verify.then(|| verify(&rendered.image, (&volume, &transfer), &camera, &settings, &job));
            let verified = verified.transpose()?;
            let broken = verified.filter(|verified| job.max_error.is_some_and(|bound| verified.interval[0] > bound));
            print_stats(job.stats, &RenderStats { stats: rendered.stats, estimate, verified }, RenderStats::to_text)?;
            match (broken, job.max_error) {
                (Some(verified), Some(bound)) => {
                    Err(Failure::Failed(format!("--max-error {bound} is broken: {}", in_words(&verified))))
                }
                _ => Ok(()),
            }
        }
        None => {
            let image = stages.time("integrate", || {
                Reference::new(&volume, &transfer, &job.settings)?
                    .with_tolerance(Reference::TOLERANCE)
                    .with_progress(progress::reporter())
                    .render_region(&camera, job.region)
            })?;
            let exact = Note { name: "Predicted error", text: "none: rays integrated in f64".to_owned() };
            save(&image, &notes(&job.settings, &job.figure, vec![exact]), &mut stages)?;
            let stats =
                ReferenceStats { painter: "reference", size: job.size, voxels: volume.grid().len(), stages: stages.0 };
            print_stats(job.stats, &stats, |stats| {
                let times: String = stats
                    .stages
                    .iter()
                    .map(|s| format!("{:<12} {:>9.3} ms  (host clock)\n", s.name, s.seconds * 1e3))
                    .collect();
                let [width, height] = stats.size;
                format!("painter      reference (f64)\npicture      {width} x {height} px\n{times}")
            })
        }
    }
}

/// Statistics of a picture by the renderer, and what traced pixels say of it.
#[derive(Serialize)]
struct RenderStats {
    #[serde(flatten)]
    stats: Stats,
    /// By the pixels that chose the settings.
    #[serde(skip_serializing_if = "Option::is_none")]
    estimate: Option<Estimate>,
    /// By other pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    verified: Option<Estimate>,
}

impl RenderStats {
    fn to_text(&self) -> String {
        let line = |name: &str, estimate: &Option<Estimate>| {
            estimate.map(|estimate| format!("{name:<12} {}\n", in_words(&estimate))).unwrap_or_default()
        };
        format!("{}{}{}", self.stats, line("estimated", &self.estimate), line("verified", &self.verified))
    }
}

/// An estimate as a person reads it.
fn in_words(estimate: &Estimate) -> String {
    let Estimate { pixels, error, interval: [low, high], rms, max } = estimate;
    format!(
        "99.9 % of the covered pixels err by at most {error:.1e} (95 % confidence: {low:.1e} to {high:.1e}), rms \
         {rms:.1e}; the largest error of {pixels} traced pixels is {max:.1e}"
    )
}

/// The picture of a job, by the settings asked for or by those that an error asks for, which a note names.
fn draw(
    renderer: &Renderer,
    (volume, transfer): (&Volume, &TransferFunction),
    camera: &Camera,
    job: &RenderJob,
) -> Result<(Rendered, Settings, Option<Estimate>), Failure> {
    let Some(max_error) = job.max_error else {
        let scene = renderer.prepare(volume, transfer, &job.settings)?;
        return Ok((renderer.render_region(&scene, camera, &job.settings, job.region)?, job.settings.clone(), None));
    };
    let Chosen { settings, rendered, estimate, keeps, tried } =
        choose(renderer, (volume, transfer), camera, &job.settings, max_error, job.sample)?;
    let options = command_line(&options_of(&settings));
    let options = if options.is_empty() { "the defaults".to_owned() } else { options };
    let said = in_words(&estimate);
    output::say(&match keeps {
        true => format!("note: --max-error {max_error} takes {options}: {said}"),
        false => format!(
            "note: none of {} ways to draw keeps --max-error {max_error}; the best takes {options}: {said}",
            tried.len()
        ),
    });
    Ok((rendered, settings, Some(estimate)))
}

/// What the file of a picture says of how it was made.
fn notes(settings: &Settings, figure: &Figure, of_errors: Vec<Note>) -> Vec<Note> {
    let software = format!("voxsplat {}", env!("CARGO_PKG_VERSION"));
    let mut options = vec!["--model".to_owned(), settings.model.to_string()];
    options.extend(options_of(settings));
    let light = settings.lighting.as_ref().map_or_else(
        || "none".to_owned(),
        |Lighting { lights, shadows, occlusion, .. }| {
            let around = occlusion.map_or_else(|| "off".to_owned(), |radius| radius.to_string());
            format!("{}, shadows {shadows}, occlusion {around}", lights.len())
        },
    );
    let settings = format!("{}; lights: {light}", command_line(&options));
    let mut notes = vec![Note { name: "Software", text: software }, Note { name: "Settings", text: settings }];
    notes.extend(of_errors);
    let texts = [("Title", &figure.title), ("Description", &figure.caption)];
    notes.extend(texts.into_iter().filter_map(|(name, text)| Some(Note { name, text: text.clone()? })));
    notes
}

/// The hull that a picture is fitted to; `None` is the box of the volume.
pub(super) fn framed(frame: FrameArg, volume: &Volume, transfer: &TransferFunction) -> Result<Option<Hull>, Failure> {
    Ok(match frame {
        FrameArg::Volume => None,
        FrameArg::Visible => Hull::of_visible(volume, transfer)?,
        FrameArg::View => Hull::of_visible(volume, transfer)?.map(Hull::from_one_side),
    })
}

/// A volume whose units are those given, otherwise those of its file.
fn with_units(volume: Volume, given: &Units) -> Volume {
    let of_file = volume.units().clone();
    let units = Units { length: given.length.clone().or(of_file.length), value: given.value.clone().or(of_file.value) };
    volume.with_units(units)
}

/// What pixels other than those of the choice say of a picture.
fn verify(
    image: &Image,
    (volume, transfer): (&Volume, &TransferFunction),
    camera: &Camera,
    settings: &Settings,
    job: &RenderJob,
) -> Result<Estimate, Failure> {
    // A tenth more pixels along each axis fall between those of the other sample.
    let pixels = job.sample.saturating_add(job.sample / 5);
    let estimate = Truth::trace(volume, transfer, camera, settings, pixels)?.estimate(image)?;
    if job.stats.is_none() {
        output::say(&format!("verified: {}", in_words(&estimate)));
    }
    Ok(estimate)
}

fn print_stats<S: Serialize>(
    format: Option<StatsFormat>,
    stats: &S,
    table: impl FnOnce(&S) -> String,
) -> Result<(), Failure> {
    match format {
        None => Ok(()),
        Some(StatsFormat::Table) => output::print(&table(stats)),
        Some(StatsFormat::Json) => output::print_json(stats),
    }
}

/// The transfer function of a job.
pub(super) struct Fitted {
    pub(super) transfer: TransferFunction,
    /// The preset that it is.
    preset: Option<&'static Preset>,
    /// For the user, if it was suggested.
    pub(super) note: Option<String>,
}

/// The transfer function of a job.
pub(super) fn transfer(
    source: &Path,
    (choice, gradient): (&Transfer, Option<&GradientOpacity>),
    volume: &Volume,
    stages: &mut Stages,
) -> Result<Fitted, Failure> {
    let fitted = fitted(source, choice, volume, stages)?;
    let Some(GradientOpacity(points)) = gradient else { return Ok(fitted) };
    Ok(Fitted { transfer: fitted.transfer.with_gradient_opacity(points.clone())?, ..fitted })
}

/// The same with the gradient opacity that it has.
fn fitted(source: &Path, choice: &Transfer, volume: &Volume, stages: &mut Stages) -> Result<Fitted, Failure> {
    let mut statistics = || stages.time("statistics", || Statistics::of(volume));
    match choice {
        Transfer::Given(transfer) => Ok(Fitted { transfer: transfer.clone(), preset: None, note: None }),
        Transfer::Preset(preset) => {
            let transfer = presets::preset(preset.name, &statistics()?)?;
            Ok(Fitted { transfer, preset: Some(preset), note: None })
        }
        Transfer::Suggested => {
            if let Some(transfer) = demos::own_transfer(source) {
                return Ok(Fitted { transfer, preset: None, note: None });
            }
            let (transfer, Suggestion { name, reason }) = TransferFunction::for_volume(volume, &statistics()?)?;
            let preset = presets::PRESETS.iter().find(|preset| preset.name == name);
            Ok(Fitted { transfer, preset, note: Some(format!("note: --transfer {name} is taken, as {reason}")) })
        }
    }
}
