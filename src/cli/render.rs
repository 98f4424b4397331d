//! `voxsplat render`.

use std::path::Path;
use std::time::Instant;

use glam::DVec3;
use serde::Serialize;
use voxsplat::accuracy::{Chosen, Estimate, Truth, choose};
use voxsplat::camera::{Camera, Hull};
use voxsplat::clip::Clip;
use voxsplat::demos;
use voxsplat::figure::Figure;
use voxsplat::image::{Image, Note};
use voxsplat::layers::Layers;
use voxsplat::lighting::Lighting;
use voxsplat::renderer::{Rendered, Renderer};
use voxsplat::settings::Settings;
use voxsplat::stats::{Clock, StageTime, Stats};
use voxsplat::transfer::presets::{self, Preset, Suggestion};
use voxsplat::transfer::{ControlPoint, Imported, TransferFunction, Window};
use voxsplat::volume::{Statistics, Units, Volume};

use super::args::{FrameArg, StatsFormat};
use super::info::short;
use super::job::{RenderJob, Transfer, TransferChoice};
use super::options::{command_line, options_of};
use super::parse::{GradientFloor, GradientOpacity};
use super::session::{Picture, Prepared, Session};
use super::{Failure, output};

/// Host times of the stages, in the order in which they ran.
#[derive(Default)]
pub(super) struct Stages(Vec<StageTime>);

impl Stages {
    pub(super) fn time<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.0.push(StageTime { name, seconds: start.elapsed().as_secs_f64(), clock: Clock::Host });
        result
    }

    /// The stages of both, one after the other.
    pub(super) fn append(&mut self, mut later: Self) {
        self.0.append(&mut later.0);
    }
}

/// Statistics of a picture by the reference.
#[derive(Serialize)]
struct ReferenceStats {
    painter: &'static str,
    clip: Clip,
    size: [u32; 2],
    voxels: u64,
    stages: Vec<StageTime>,
}

/// Makes the pictures of jobs of one volume and one device.
pub(super) fn run(jobs: Vec<RenderJob>) -> Result<(), Failure> {
    let mut shared: Option<Session> = None;
    for mut job in jobs {
        let mut stages = Stages::default();
        let (session, fitted) = match &mut shared {
            Some(session) => {
                let fitted = session.fitted(&job, &mut stages)?;
                (session, fitted)
            }
            None => {
                let (session, fitted) = Session::open(&job, &mut stages)?;
                (shared.insert(session), fitted)
            }
        };
        session.complete(&mut job, &fitted)?;
        if let Some(path) = &job.save_transfer {
            fitted.transfer.save(path, session.volume.grid())?;
        }
        let layers = session.layers(&job, &fitted, &mut stages)?;
        let picture = session.picture(&job, &layers, &fitted.transfer, &mut stages)?;
        let image = picture.image();
        stages.time("encode", || job.output.write(image, job.background, &picture.notes))?;
        if let Some(preview) = job.preview {
            preview.show(image, job.background)?;
        }
        if let Some(scene) = &job.save_scene {
            scene.save(&job, &fitted)?;
        }
        report(&job, &layers, picture, stages)?;
    }
    Ok(())
}

/// Prints what was asked for of a finished picture, and holds it to its bound.
fn report(job: &RenderJob, layers: &Layers, picture: Picture, stages: Stages) -> Result<(), Failure> {
    let Picture { image, camera, settings, estimate, stats, .. } = picture;
    let Some(mut stats) = stats else {
        let stats = ReferenceStats {
            painter: "reference",
            clip: settings.clip,
            size: job.size,
            voxels: layers.grid().len(),
            stages: stages.0,
        };
        return print_stats(job.stats, &stats, |stats| {
            let times: String = stats
                .stages
                .iter()
                .map(|s| format!("{:<12} {:>9.3} ms  (host clock)\n", s.name, s.seconds * 1e3))
                .collect();
            let [width, height] = stats.size;
            format!("painter      reference (f64)\npicture      {width} x {height} px\n{times}")
        });
    };
    // What is done with the picture comes after what the renderer did.
    let (before, after): (Vec<_>, Vec<_>) =
        stages.0.into_iter().partition(|s| s.name != "figure" && s.name != "encode");
    stats.stages.splice(0..0, before);
    stats.stages.extend(after);
    let verified = job.verify.then(|| verify(&image, layers, &camera, &settings, job)).transpose()?;
    let broken = verified.filter(|verified| job.max_error.is_some_and(|bound| verified.interval[0] > bound));
    print_stats(job.stats, &RenderStats { stats, estimate, verified }, RenderStats::to_text)?;
    match (broken, job.max_error) {
        (Some(verified), Some(bound)) => {
            Err(Failure::Failed(format!("--max-error {bound} is broken: {}", in_words(&verified))))
        }
        _ => Ok(()),
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
pub(super) fn in_words(estimate: &Estimate) -> String {
    let Estimate { pixels, error, interval: [low, high], rms, max } = estimate;
    if *pixels == 0 {
        return "no traced pixel shows anything, in the picture or in truth: there is no error to estimate".to_owned();
    }
    format!(
        "99.9 % of the covered pixels err by at most {error:.1e} (95 % confidence: {low:.1e} to {high:.1e}), rms \
         {rms:.1e}; the largest error of {pixels} traced pixels is {max:.1e}"
    )
}

/// A picture, the settings that it was made by, and what traced pixels said of them.
type Drawn = (Rendered, Settings, Option<Estimate>);

/// The picture of a job, by the settings asked for or by those that an error asks for, which a note names. What was
/// prepared is for the next picture.
pub(super) fn draw(
    renderer: &Renderer,
    layers: &Layers,
    camera: &Camera,
    job: &RenderJob,
    prepared: Option<Prepared>,
) -> Result<(Drawn, Option<Prepared>), Failure> {
    let Some(max_error) = job.max_error else {
        let prepared = match prepared {
            Some(prepared) => prepared,
            None => Prepared::new(layers, &job.settings, renderer.prepare_layers(layers, &job.settings)?),
        };
        let rendered = renderer.render_region(&prepared.scene, camera, &job.settings, job.region)?;
        return Ok(((rendered, job.settings.clone(), None), Some(prepared)));
    };
    let Chosen { settings, rendered, estimate, keeps, tried } =
        choose(renderer, layers, camera, &job.settings, max_error, job.sample)?;
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
    Ok(((rendered, settings, Some(estimate)), None))
}

/// What the file of a picture says of how it was made.
pub(super) fn notes(settings: &Settings, figure: &Figure, of_errors: Vec<Note>) -> Vec<Note> {
    let software = format!("voxsplat {}", env!("CARGO_PKG_VERSION"));
    let mut options = vec!["--model".to_owned(), settings.model.to_string()];
    options.extend(options_of(settings));
    for plane in settings.clip.planes() {
        let DVec3 { x, y, z } = plane.normal();
        options.extend(["--clip".to_owned(), format!("{x},{y},{z},{}", plane.offset())]);
    }
    let light = settings.lighting.as_ref().map_or_else(
        || "none".to_owned(),
        |Lighting { lights, shadows, shadow_bias, occlusion, .. }| {
            let around = occlusion.map_or_else(|| "off".to_owned(), |radius| radius.to_string());
            format!("{}, shadows {shadows}, bias {shadow_bias}, occlusion {around}", lights.len())
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
pub(super) fn framed(frame: FrameArg, layers: &Layers, clip: &Clip) -> Result<Option<Hull>, Failure> {
    Ok(match frame {
        FrameArg::Volume => None,
        FrameArg::Visible => layers.hull(clip)?,
        FrameArg::View => layers.hull(clip)?.map(Hull::from_one_side),
    })
}

/// A volume whose units are those given, otherwise those of its file.
pub(super) fn with_units(volume: Volume, given: &Units) -> Volume {
    let of_file = volume.units().clone();
    let units = Units { length: given.length.clone().or(of_file.length), value: given.value.clone().or(of_file.value) };
    volume.with_units(units)
}

/// What pixels other than those of the choice say of a picture.
fn verify(
    image: &Image,
    layers: &Layers,
    camera: &Camera,
    settings: &Settings,
    job: &RenderJob,
) -> Result<Estimate, Failure> {
    // A tenth more pixels along each axis fall between those of the other sample.
    let pixels = job.sample.saturating_add(job.sample / 5);
    let estimate = Truth::trace(layers, camera, settings, pixels)?.estimate(image)?;
    if job.stats.is_none() {
        output::say(&format!("verified: {}", in_words(&estimate)));
    }
    Ok(estimate)
}

/// Prints statistics if they are asked for.
pub(super) fn print_stats<S: Serialize>(
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
    pub(super) preset: Option<&'static Preset>,
    /// Whether there is none, as values are labels.
    pub(super) labels: bool,
    /// For the user: why it was suggested, if it was.
    pub(super) suggested: Option<String>,
    /// For the user: what was found out.
    pub(super) notes: Vec<String>,
}

impl Fitted {
    fn new(transfer: TransferFunction) -> Self {
        Self { transfer, preset: None, labels: false, suggested: None, notes: Vec::new() }
    }

    /// What stands for none, where layers say what shows.
    pub(super) fn clear() -> Result<Self, Failure> {
        let clear = ControlPoint { value: 0.0, color: [0.0; 3], opacity: 0.0 };
        Ok(Self::new(TransferFunction::new(vec![clear], None)?))
    }

    /// All that the user should know of it.
    pub(super) fn notes(&self) -> impl Iterator<Item = &String> {
        self.suggested.iter().chain(&self.notes)
    }
}

/// The transfer function of a job.
pub(super) fn transfer(
    source: &Path,
    asked: &Transfer,
    volume: &Volume,
    stages: &mut Stages,
) -> Result<Fitted, Failure> {
    let mut fitted = fitted(source, asked, volume, stages)?;
    if let Some(GradientOpacity(points)) = &asked.gradient {
        fitted.transfer = fitted.transfer.with_gradient_opacity(points.clone())?;
    }
    match asked.floor {
        None => (),
        Some(GradientFloor::At(floor)) => fitted.transfer = fitted.transfer.with_gradient_floor(floor)?,
        Some(GradientFloor::Auto) => {
            let found = || fitted.transfer.floor_over_noise(volume, &asked.settings);
            let floor = stages.time("noise", found)?.map_or(0.0, rounded);
            fitted.notes.push(match floor > 0.0 {
                true => format!("note: --gradient-floor {} is taken, twice the gradient of the noise", short(floor)),
                false => "note: --gradient-floor 0 is taken: too little of what shows is flat, or without noise".into(),
            });
            fitted.transfer = fitted.transfer.with_gradient_floor(floor)?;
        }
    }
    Ok(fitted)
}

/// A number as it is printed.
fn rounded(number: f64) -> f64 {
    short(number).parse().unwrap_or(number)
}

/// The same with the gradient opacity that it has.
fn fitted(source: &Path, asked: &Transfer, volume: &Volume, stages: &mut Stages) -> Result<Fitted, Failure> {
    let mut statistics = || stages.time("statistics", || Statistics::of(volume));
    let fitted = match &asked.choice {
        // There is none: layers have the labels.
        TransferChoice::Labels => return Ok(Fitted { labels: true, ..Fitted::clear()? }),
        TransferChoice::Given(imported) => {
            let window = match asked.window {
                None if imported.fits => Window::of(&statistics()?),
                given => given,
            };
            let transfer = imported.placed(volume.grid(), window.as_ref())?;
            let notes = notes_on(imported, &transfer, asked.window.is_some(), volume);
            return Ok(Fitted { notes, ..Fitted::new(transfer) });
        }
        TransferChoice::Preset(preset) => {
            let transfer = presets::preset(preset.name, volume, &statistics()?)?;
            Fitted { preset: Some(preset), ..Fitted::new(transfer) }
        }
        TransferChoice::Suggested => {
            if let Some(transfer) = demos::own_transfer(source) {
                return Ok(Fitted::new(transfer));
            }
            let (transfer, Suggestion { name, reason }) = TransferFunction::for_volume(volume, &statistics()?)?;
            let preset = Some(presets::find(name)?);
            let suggested = Some(format!("note: --transfer {name} is taken, as {reason}"));
            Fitted { preset, suggested, ..Fitted::new(transfer) }
        }
    };
    Ok(match &asked.window {
        Some(window) => Fitted { transfer: fitted.transfer.stretched(window)?, ..fitted },
        None => fitted,
    })
}

/// What a transfer function from a file leaves open, and how it was filled.
fn notes_on(imported: &Imported, transfer: &TransferFunction, windowed: bool, volume: &Volume) -> Vec<String> {
    let mut notes: Vec<String> = imported.notes.iter().map(|note| format!("note: transfer function: {note}")).collect();
    if let (true, Some(unit)) = (imported.mean_spacing, transfer.unit_distance()) {
        let length = volume.length_unit().unwrap_or("world units");
        let thickness = format!("slabs {} {length} thick, the mean spacing", short(unit));
        notes.push(format!("note: transfer function: its opacities are taken for {thickness}, as none is stated"));
    }
    if imported.fits && !windowed {
        let [low, high] = transfer.range().map(short);
        notes.push(format!("note: colours run from {low} to {high}, the foreground; --window LEVEL,WIDTH places them"));
    }
    notes
}
