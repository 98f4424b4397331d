//! The command `voxsplat render`.

use std::path::PathBuf;

use serde::Serialize;
use voxsplat::accuracy::{Estimate, Truth};
use voxsplat::camera::Camera;
use voxsplat::clip::Clip;
use voxsplat::demos;
use voxsplat::image::Image;
use voxsplat::layers::Layers;
use voxsplat::program::PlacedOverlay;
use voxsplat::settings::Settings;
use voxsplat::stats::{StageTime, Stats};

use super::args::StatsFormat;
use super::destination::Destination;
use super::draw::in_words;
use super::failure::{Failure, fail};
use super::fitted::Fitted;
use super::job::{Outputs, RenderJob};
use super::output;
use super::part;
use super::report::{self, Choices};
use super::session::{Drawing, Session};
use super::stages::Stages;

/// Statistics of a picture by the reference.
#[derive(Serialize)]
struct ReferenceStats {
    painter: &'static str,
    clip: Clip,
    size: [u32; 2],
    voxels: u64,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    overlays: Vec<PlacedOverlay>,
    stages: Vec<StageTime>,
}

/// Renders the pictures of jobs of one volume and one device.
pub(crate) fn run(jobs: Vec<RenderJob>) -> Result<(), Failure> {
    let mut shared: Option<Session> = None;
    // Commands that end in a pipe are not a newcomer's.
    let is_file = |job: &RenderJob| matches!(job.output.picture, Destination::File(_));
    let built_in = jobs.iter().any(|job| is_file(job) && demos::name_in(&job.source).is_some());
    let is_one = jobs.len() == 1;
    for mut job in jobs {
        if is_one {
            job.load = part::options(&job)?;
        }
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
        if let Some(path) = &job.output.transfer {
            fitted.transfer.save(path, session.volume.grid())?;
        }
        let layers = session.layers(&job, &fitted, &mut stages)?;
        let picture = session.picture(&job, &layers, &fitted.transfer, &mut stages)?;
        let depths = session.depths(&job, &layers, &picture, &mut stages)?;
        let Outputs { picture: output, background, .. } = &job.output;
        stages.time("encode", || output.write(picture.image(), depths.as_ref(), *background, &picture.notes))?;
        if let Some(scene) = &job.output.scene {
            scene.save(&job.source, &job.transfer.choice, &fitted)?;
        }
        let overlays = session.overlays.as_ref().map(|overlays| overlays.all.clone());
        report(&job, &layers, overlays.unwrap_or_default(), picture, stages, &fitted)?;
    }
    if built_in {
        output::say("note: this volume is built in; try next: voxsplat render FILE -o picture.png");
    }
    Ok(())
}

/// Prints the requested statistics of a finished picture, and checks its bound.
fn report(
    job: &RenderJob,
    layers: &Layers,
    overlays: Vec<PlacedOverlay>,
    picture: Drawing,
    stages: Stages,
    fitted: &Fitted,
) -> Result<(), Failure> {
    let choices = |settings: &Settings, painter| Choices::of(job, settings, Some(fitted), Some(painter));
    let Drawing { image, camera, settings, estimate, stats, .. } = picture;
    let Some(mut stats) = stats else {
        let result = (choices(&settings, "reference"), job.output.files());
        let stats = ReferenceStats {
            painter: "reference",
            clip: settings.clip,
            size: job.size,
            voxels: layers.grid().len(),
            overlays,
            stages: stages.0,
        };
        return print_stats(result, TracedErrors::default(), job.output.stats, &stats, |stats| {
            let times: String = stats
                .stages
                .iter()
                .map(|s| format!("{:<12} {:>9.3} ms  (host clock)\n", s.name, s.seconds * 1e3))
                .collect();
            let [width, height] = stats.size;
            format!("painter      reference (f64)\npicture      {width} x {height} px\n{times}")
        });
    };
    // Drawing the figure and encoding come after the stages of the renderer.
    let (before, after): (Vec<_>, Vec<_>) =
        stages.0.into_iter().partition(|s| s.name != "figure" && s.name != "encode");
    stats.stages.splice(0..0, before);
    stats.stages.extend(after);
    let verified = job.accuracy.verify.then(|| verify(&image, layers, &camera, &settings, job)).transpose()?;
    let broken = verified.filter(|verified| job.accuracy.max_error.is_some_and(|bound| verified.interval[0] > bound));
    let result = (choices(&settings, stats.painter.name()), job.output.files());
    let errors = TracedErrors { estimate, verified };
    let stats = RenderStats { stats, overlays, errors };
    print_stats(result, errors, job.output.stats, &stats, RenderStats::to_text)?;
    match (broken, job.accuracy.max_error) {
        (Some(verified), Some(bound)) => fail(format!("--max-error {bound} is exceeded: {}", in_words(&verified))),
        _ => Ok(()),
    }
}

/// Statistics of a picture by the renderer, and its error by traced pixels.
#[derive(Serialize)]
struct RenderStats {
    #[serde(flatten)]
    stats: Stats,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    overlays: Vec<PlacedOverlay>,
    #[serde(flatten)]
    errors: TracedErrors,
}

/// Errors of a picture by traced pixels.
#[derive(Serialize, Default, Clone, Copy)]
pub(crate) struct TracedErrors {
    /// The error by the pixels that chose the settings.
    #[serde(skip_serializing_if = "Option::is_none")]
    estimate: Option<Estimate>,
    /// The error by other pixels than the ones that chose the settings.
    #[serde(skip_serializing_if = "Option::is_none")]
    verified: Option<Estimate>,
}

impl RenderStats {
    fn to_text(&self) -> String {
        let line = |name: &str, estimate: &Option<Estimate>| {
            estimate.map(|estimate| format!("{name:<12} {}\n", in_words(&estimate))).unwrap_or_default()
        };
        let overlays: String = self.overlays.iter().map(|overlay| format!("overlay      {}\n", overlay.look)).collect();
        let [estimated, verified] = [line("estimated", &self.errors.estimate), line("verified", &self.errors.verified)];
        format!("{}{overlays}{estimated}{verified}", self.stats)
    }
}

/// Returns the error of a picture by other pixels than the ones that chose its settings.
fn verify(
    image: &Image,
    layers: &Layers,
    camera: &Camera,
    settings: &Settings,
    job: &RenderJob,
) -> Result<Estimate, Failure> {
    // A tenth more pixels along each axis fall between the pixels of the other sample.
    let pixels = job.accuracy.sample.saturating_add(job.accuracy.sample / 5);
    let estimate = Truth::trace(layers, camera, settings, pixels)?.estimate(image)?;
    if job.output.stats.is_none() {
        output::say(&format!("verified: {}", in_words(&estimate)));
    }
    Ok(estimate)
}

/// The result of a picture as JSON.
#[derive(Serialize)]
struct Measured<'a, S> {
    #[serde(flatten)]
    errors: TracedErrors,
    #[serde(skip_serializing_if = "Option::is_none")]
    stats: Option<&'a S>,
}

/// Prints statistics if they are requested; with `--json` choices, files and errors too.
pub(crate) fn print_stats<S: Serialize>(
    (choices, files): (Choices, Vec<PathBuf>),
    errors: TracedErrors,
    format: Option<StatsFormat>,
    stats: &S,
    table: impl FnOnce(&S) -> String,
) -> Result<(), Failure> {
    match format {
        _ if output::is_json() => report::print(choices, files, Measured { errors, stats: format.map(|_| stats) }),
        None => Ok(()),
        Some(StatsFormat::Table) => output::print(&table(stats)),
        Some(StatsFormat::Json) => output::print_json(stats),
    }
}
