//! Pictures by the renderer, their framing, and the notes in their files.

use glam::DVec3;
use voxsplat::accuracy::{Chosen, Estimate, choose};
use voxsplat::camera::{Camera, Hull};
use voxsplat::clip::Clip;
use voxsplat::figure::Figure;
use voxsplat::image::Note;
use voxsplat::layers::Layers;
use voxsplat::lighting::Lighting;
use voxsplat::renderer::{Rendered, Renderer, Scene};
use voxsplat::settings::Settings;
use voxsplat::volume::{Units, Volume};

use super::args::FrameArg;
use super::failure::Failure;
use super::job::RenderJob;
use super::options::{command_line, options_of};
use super::output;

/// A scene, and the layers and settings that it was prepared with.
pub(crate) struct Prepared {
    layers: Layers,
    settings: Settings,
    pub(crate) scene: Scene,
}

impl Prepared {
    pub(crate) fn new(layers: &Layers, settings: &Settings, scene: Scene) -> Self {
        Self { layers: layers.clone(), settings: settings.clone(), scene }
    }

    /// Whether a picture of other settings can be made of the scene.
    pub(crate) fn serves(&self, layers: &Layers, settings: &Settings) -> bool {
        let of = |s: &Settings| (s.model, s.shading, s.lighting.is_some(), s.kernel, s.sharpness, s.level);
        self.layers == *layers && of(&self.settings) == of(settings)
    }
}

/// Returns an estimate as a sentence.
pub(crate) fn in_words(estimate: &Estimate) -> String {
    let Estimate { pixels, error, interval: [low, high], rms, max } = estimate;
    if *pixels == 0 {
        return "no traced pixel shows anything, in the picture or in truth: there is no error to estimate".to_owned();
    }
    format!(
        "99.9 % of the covered pixels err by at most {error:.1e} (95 % confidence: {low:.1e} to {high:.1e}), rms \
         {rms:.1e}; the largest error of {pixels} traced pixels is {max:.1e}"
    )
}

/// A picture, its settings, and the error that traced pixels estimate.
type Drawn = (Rendered, Settings, Option<Estimate>);

/// Draws the picture of a job, by its settings or by the cheapest ones that keep its error, which a note names. Returns
/// the prepared scene for the next picture too.
pub(crate) fn draw(
    renderer: &Renderer,
    layers: &Layers,
    camera: &Camera,
    job: &RenderJob,
    prepared: Option<Prepared>,
) -> Result<(Drawn, Option<Prepared>), Failure> {
    let Some(max_error) = job.accuracy.max_error else {
        let prepared = match prepared {
            Some(prepared) => prepared,
            None => Prepared::new(layers, &job.settings, renderer.prepare_layers(layers, &job.settings)?),
        };
        let rendered = renderer.render_region(&prepared.scene, camera, &job.settings, job.region)?;
        return Ok(((rendered, job.settings.clone(), None), Some(prepared)));
    };
    let Chosen { settings, rendered, estimate, keeps, tried } =
        choose(renderer, layers, camera, &job.settings, max_error, job.accuracy.sample)?;
    let options = command_line(&options_of(&settings));
    let options = if options.is_empty() { "the defaults".to_owned() } else { options };
    let said = in_words(&estimate);
    output::say(&match keeps {
        true => format!("note: using {options} for --max-error {max_error}: {said}"),
        false => format!(
            "note: using {options}, the best of {} settings, all of which exceed --max-error {max_error}: {said}",
            tried.len()
        ),
    });
    Ok(((rendered, settings, Some(estimate)), None))
}

/// Returns the notes in the file of a picture: program, settings, error, title and caption.
pub(crate) fn notes(settings: &Settings, figure: &Figure, of_errors: Option<Note>) -> Vec<Note> {
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

/// Returns the hull that a picture is fitted to; `None` is the box of the volume.
pub(crate) fn framed(frame: FrameArg, layers: &Layers, clip: &Clip) -> Result<Option<Hull>, Failure> {
    Ok(match frame {
        FrameArg::Volume => None,
        FrameArg::Visible => layers.hull(clip)?,
        FrameArg::View => layers.hull(clip)?.map(Hull::from_one_side),
    })
}

/// Returns a volume with the given units, and otherwise the units of its file.
pub(crate) fn with_units(volume: &Volume, given: &Units) -> Volume {
    let of_file = volume.units().clone();
    let units = Units { length: given.length.clone().or(of_file.length), value: given.value.clone().or(of_file.value) };
    volume.clone().with_units(units)
}
