//! Pictures by the renderer, and the notes in their files.

use voxsplat::Frame;
use voxsplat::accuracy::{Chosen, Estimate, choose};
use voxsplat::camera::Camera;
use voxsplat::engine::{Engine, EngineScene};
use voxsplat::figure::Figure;
use voxsplat::image::{Image, Note};
use voxsplat::layers::Layers;
use voxsplat::program::{self, command_line, options_of};
use voxsplat::settings::Settings;
use voxsplat::solids::Solids;
use voxsplat::stats::Stats;
use voxsplat::volume::{Units, Volume};
use voxsplat_volume::names::counted;

use super::failure::Failure;
use super::job::RenderJob;
use super::output;

/// A scene, with the layers and settings that it was prepared with.
pub(crate) struct Prepared {
    layers: Layers,
    settings: Settings,
    pub(crate) scene: EngineScene,
}

impl Prepared {
    pub(crate) fn new(layers: &Layers, settings: &Settings, scene: EngineScene) -> Self {
        Self { layers: layers.clone(), settings: settings.clone(), scene }
    }

    /// Returns whether a picture of these layers and settings can be made of the scene.
    pub(crate) fn serves(&self, layers: &Layers, settings: &Settings) -> bool {
        let of = |s: &Settings| (s.model, s.shading, s.lighting.is_some(), s.kernel, s.sharpness, s.level);
        self.layers == *layers && of(&self.settings) == of(settings)
    }
}

/// Returns an estimate as a sentence.
pub(crate) fn in_words(estimate: &Estimate) -> String {
    let Estimate { pixels, error, interval: [low, high], rms, max, .. } = estimate;
    if *pixels == 0 {
        return "no traced pixel shows anything, in the picture or in truth: there is no error to estimate".to_owned();
    }
    format!(
        "99.9 % of the covered pixels err by at most {error:.1e} (95 % confidence: {low:.1e} to {high:.1e}), rms \
         {rms:.1e}; the largest error of {pixels} traced pixels is {max:.1e}"
    )
}

/// A drawn picture, its settings, the error that traced pixels estimate, and statistics unless the reference traced it.
type Drawn = (Image, Settings, Option<Estimate>, Option<Stats>);

/// Draws the picture of a job, by its settings or by the cheapest ones that keep its error, which a note names. Returns
/// the prepared scene for the next picture too.
pub(crate) fn draw(
    engine: &Engine,
    layers: &Layers,
    camera: &Camera,
    job: &RenderJob,
    solids: Option<&Solids>,
    prepared: Option<Prepared>,
) -> Result<(Drawn, Option<Prepared>), Failure> {
    let Some(max_error) = job.accuracy.max_error else {
        let prepared = match prepared {
            Some(prepared) => prepared,
            None => Prepared::new(layers, &job.settings, engine.prepare_layers(layers, &job.settings)?),
        };
        let scene = &prepared.scene;
        let rendered = engine.render(scene, &Frame::new(camera, &job.settings).region(job.region).solids(solids))?;
        return Ok(((rendered.image, job.settings.clone(), None, Some(rendered.stats)), Some(prepared)));
    };
    let Chosen { settings, rendered, estimate, keeps, traced, tried, .. } =
        choose(engine, layers, camera, &job.settings, max_error, job.accuracy.sample)?;
    let options = command_line(&options_of(&settings));
    let options = if options.is_empty() { "the defaults".to_owned() } else { options };
    let said = in_words(&estimate);
    let tried = counted(tried.len() as u64, "picture");
    if traced {
        output::say(&format!(
            "note: using --reference because tracing the picture is less work than the painters need for --max-error \
             {max_error}, which {tried} exceeded"
        ));
        return Ok(((rendered.image, settings, Some(estimate), None), None));
    }
    output::say(&match keeps {
        true => format!("note: using {options} for --max-error {max_error}, found with {tried}: {said}"),
        false => {
            format!("note: using {options}, the best of {tried}, all of which exceed --max-error {max_error}: {said}")
        }
    });
    Ok(((rendered.image, settings, Some(estimate), Some(rendered.stats)), None))
}

/// Returns the notes in the file of a picture: program, settings, error, title and caption.
pub(crate) fn notes(settings: &Settings, figure: &Figure, of_errors: Option<Note>) -> Vec<Note> {
    let mut notes = program::notes(settings);
    notes.extend(of_errors);
    let texts = [("Title", &figure.title), ("Description", &figure.caption)];
    notes.extend(texts.into_iter().filter_map(|(name, text)| Some(Note { name, text: text.clone()? })));
    notes
}

/// Returns a volume with the given units, and otherwise the units of its file.
pub(crate) fn with_units(volume: &Volume, given: &Units) -> Volume {
    let of_file = volume.units().clone();
    let units = Units { length: given.length.clone().or(of_file.length), value: given.value.clone().or(of_file.value) };
    volume.clone().with_units(units)
}
