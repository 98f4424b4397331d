//! The result of a command as one JSON object, for `--json`.

use std::path::Path;

use serde::Serialize;
use voxsplat::appearance::Framing;
use voxsplat::camera::{ProjectionKind, View};
use voxsplat::program::LABELS;
use voxsplat::settings::Settings;
use voxsplat::transfer::{Classification, TransferFunction};

use super::failure::Failure;
use super::fitted::Fitted;
use super::job::RenderJob;
use super::output;

/// The JSON object of a command. The keys of `result` are the command's own.
#[derive(Serialize)]
struct CommandReport<C, R> {
    /// The version of the program.
    version: &'static str,
    choices: C,
    /// The files that the command has written.
    outputs: Vec<String>,
    #[serde(flatten)]
    result: R,
}

/// The look of a picture, whoever chose it. A command without a picture has no choices.
#[derive(Serialize, Default)]
pub(crate) struct Choices {
    /// The preset or `labels`; `None`: a file, a colour map, or the transfer function of a built-in volume.
    pub(crate) preset: Option<&'static str>,
    /// The classification of voxels of values; `None`: there are none, or the transfer function is not known.
    pub(crate) classification: Option<Classification>,
    #[serde(flatten)]
    pub(crate) look: Option<PictureLook>,
}

/// The look of a picture: light, kernel, view and painter.
#[derive(Serialize)]
pub(crate) struct PictureLook {
    /// The lights in the spelling of `--light`; none: unlit.
    light: Vec<String>,
    sharpness: f64,
    kernel: String,
    model: &'static str,
    shading: &'static str,
    view: ViewChoice,
    /// The painter that drew; `None` if nothing was drawn, or if several painters were measured.
    painter: Option<&'static str>,
}

/// The view, with angles in degrees.
#[derive(Serialize)]
struct ViewChoice {
    /// The azimuth; `None` if a direction replaces azimuth and elevation.
    azimuth: Option<f64>,
    elevation: Option<f64>,
    direction: Option<[f64; 3]>,
    roll: f64,
    zoom: f64,
    projection: &'static str,
    frame: &'static str,
}

/// Returns the classification of voxels of values by pictures; `None`: they classify no voxels.
pub(crate) fn classification(transfer: &TransferFunction, settings: &Settings) -> Option<Classification> {
    let way = if transfer.is_band_limited() { Classification::BandLimited } else { Classification::Point };
    Some(way).filter(|_| !settings.is_post_shaded())
}

impl Choices {
    /// Returns the choices of a job that is complete. `settings` drew its picture, `fitted` is its transfer function if
    /// it is known.
    pub(crate) fn of(
        job: &RenderJob,
        settings: &Settings,
        fitted: Option<&Fitted>,
        painter: Option<&'static str>,
    ) -> Self {
        let studio = if job.studio.follows { "studio:eye" } else { "studio" };
        let light = match (&settings.lighting, &job.lights[..]) {
            (None, _) => Vec::new(),
            (Some(_), []) => vec![studio.to_owned()],
            (Some(_), lights) => lights.to_vec(),
        };
        Self {
            preset: fitted.and_then(preset),
            classification: fitted
                .filter(|fitted| !fitted.labels)
                .and_then(|fitted| classification(&fitted.transfer, settings)),
            look: Some(PictureLook::new(settings, light, (&job.view, job.frame), painter)),
        }
    }
}

impl PictureLook {
    pub(crate) fn new(
        settings: &Settings,
        light: Vec<String>,
        (view, frame): (&View, Framing),
        painter: Option<&'static str>,
    ) -> Self {
        let turned = |angle: f64| view.direction.is_none().then_some(angle);
        Self {
            light,
            sharpness: settings.sharpness,
            kernel: settings.kernel.to_string(),
            model: settings.model.name(),
            shading: settings.shading.name(),
            view: ViewChoice {
                azimuth: turned(view.azimuth),
                elevation: turned(view.elevation),
                direction: view.direction.map(|direction| direction.to_array()),
                roll: view.roll,
                zoom: view.zoom,
                projection: match view.projection {
                    ProjectionKind::Orthographic => "orthographic",
                    ProjectionKind::Perspective { .. } => "perspective",
                },
                frame: frame.name(),
            },
            painter,
        }
    }
}

/// Returns the name of the preset of a transfer function, or `labels`.
pub(crate) fn preset(fitted: &Fitted) -> Option<&'static str> {
    if fitted.labels { Some(LABELS) } else { fitted.preset.map(|preset| preset.name) }
}

/// Prints the object of a command that is done, if `--json` is given.
pub(crate) fn print<P: AsRef<Path>>(
    choices: impl Serialize,
    outputs: impl IntoIterator<Item = P>,
    result: impl Serialize,
) -> Result<(), Failure> {
    if !output::is_json() {
        return Ok(());
    }
    let outputs = outputs.into_iter().map(|path| path.as_ref().to_string_lossy().into_owned()).collect();
    output::print_json(&CommandReport { version: env!("CARGO_PKG_VERSION"), choices, outputs, result })
}

/// The files of a command that writes none.
pub(crate) const NO_FILES: [&str; 0] = [];
