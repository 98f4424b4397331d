//! How a volume looks if nobody says otherwise: transfer function or labels, side, framing, light, material, sharpness.
//!
//! `voxsplat render FILE` draws the same picture; its options replace one choice or another.
//! The example is that of [the library](crate).

mod channels;

use std::fmt;
use std::path::Path;

pub use channels::{ChannelChoice, ChannelLook, Loaded, Values, load_channels};

use crate::camera::{Camera, View};
use crate::demos;
use crate::error::Result;
use crate::layers::{Labels, Layer, Layers, recognised};
use crate::lighting::Lighting;
use crate::settings::{Model, Settings};
use crate::transfer::TransferFunction;
use crate::transfer::presets::{self, Preset, Suggestion};
use crate::volume::{Statistics, Volume};

/// Azimuth and elevation of a view that shows three sides of a box, degrees.
const OBLIQUE: [f64; 2] = [30.0, 20.0];

/// The sharpness of a picture of surfaces: crisper edges at the cost of a frame without, and less noise than 1 shows.
const SHARPNESS: f64 = 0.5;

/// [`Lighting::shadow_bias`] of labels, voxels: their surfaces are stairs of voxels, which cast shadows on each other.
const LABEL_BIAS: f64 = 4.0;

/// What the values of a volume mean.
#[derive(Debug, Clone)]
pub enum Meaning {
    /// Labels, and why they are taken for such.
    Labels {
        /// The property of the volume or its file that speaks for labels.
        reason: String,
    },
    /// The values of a built-in volume, which has a transfer function of its own.
    BuiltIn(TransferFunction),
    /// Values that a preset suits.
    Values {
        /// The preset, fitted to the values.
        transfer: TransferFunction,
        /// The preset.
        preset: &'static Preset,
        /// The property of the volume that speaks for it.
        reason: String,
    },
}

impl Meaning {
    /// What the values of the volume that `source` names mean: a file, or `demo:NAME`. Without `labels`, values are not
    /// taken for labels. `statistics` is asked for if the values decide.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) and [`Error::Memory`](crate::Error::Memory) if samples cannot be read;
    /// [`Error::Transfer`](crate::Error::Transfer) if all values are the same.
    pub fn of(
        source: impl AsRef<Path>,
        volume: &Volume,
        labels: bool,
        statistics: impl FnOnce() -> Result<Statistics>,
    ) -> Result<Self> {
        if let Some(transfer) = demos::own_transfer(source) {
            return Ok(Self::BuiltIn(transfer));
        }
        if labels && let Some(reason) = recognised(volume)? {
            return Ok(Self::Labels { reason });
        }
        let (transfer, Suggestion { name, reason }) = TransferFunction::for_volume(volume, &statistics()?)?;
        Ok(Self::Values { transfer, preset: presets::find(name)?, reason })
    }
}

/// Which choices are left open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Open {
    /// From which side to look.
    pub side: bool,
    /// Whether there is light, and which.
    pub light: bool,
    /// The material of lit surfaces.
    pub material: bool,
    /// The sharpness.
    pub sharpness: bool,
}

impl Open {
    /// All of them.
    pub const ALL: Self = Self { side: true, light: true, material: true, sharpness: true };
}

/// What decides on the choices that are left open.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Whether it is built in: its front is known, though no file states an orientation.
    pub built_in: bool,
    /// The preset that its transfer function is, if it is one.
    pub preset: Option<&'static Preset>,
    /// Whether labels are drawn.
    pub labels: bool,
    /// Whether nothing but the volume is drawn: no labels over it, no mask.
    pub plain: bool,
}

/// A choice, and why. `Display` says it in the words of the library.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Choice {
    /// Values are labels.
    Labels {
        /// Why they are taken for labels.
        reason: String,
    },
    /// A preset.
    Preset {
        /// Its name.
        name: &'static str,
        /// Why it suits.
        reason: String,
    },
    /// An oblique side, because the file states no orientation. Degrees.
    Side {
        /// [`View::azimuth`].
        azimuth: f64,
        /// [`View::elevation`].
        elevation: f64,
    },
    /// Studio light around the view, because there are surfaces: those of a preset, or of labels, whose shadows begin
    /// farther from a voxel.
    Light {
        /// [`Lighting::shadow_bias`] in voxels, if it is that of labels.
        shadow_bias: Option<f64>,
    },
    /// [`Settings::sharpness`], because the preset shows surfaces.
    Sharpness(f64),
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Labels { reason } => write!(f, "values are labels because {reason}"),
            Self::Preset { name, reason } => write!(f, "preset {name} because {reason}"),
            Self::Side { azimuth, elevation } => {
                write!(f, "azimuth {azimuth}, elevation {elevation} because the file states no orientation")
            }
            Self::Light { shadow_bias: None } => f.write_str("studio light because the preset shows surfaces"),
            Self::Light { shadow_bias: Some(bias) } => {
                write!(f, "studio light, shadow bias {bias}, because labels have surfaces")
            }
            Self::Sharpness(sharpness) => write!(f, "sharpness {sharpness} because the preset shows surfaces"),
        }
    }
}

impl Subject<'_> {
    /// Makes the choices that are left open, in `view` and `settings`.
    ///
    /// # Errors
    /// [`Error::Camera`](crate::Error::Camera) if the view has no direction.
    pub fn choose(&self, open: Open, view: &mut View, settings: &mut Settings) -> Result<Vec<Choice>> {
        let mut choices = Vec::new();
        // Of a box whose front means nothing the front hides most.
        let has_front = self.built_in || self.volume.is_oriented();
        if open.side && !has_front && !self.volume.grid().dims().contains(&1) {
            let [azimuth, elevation] = OBLIQUE;
            (view.azimuth, view.elevation) = (azimuth, elevation);
            choices.push(Choice::Side { azimuth, elevation });
        }
        let composite = settings.model == Model::Composite;
        let material = self.preset.and_then(|preset| preset.material);
        if open.light && composite && (material.is_some() || self.labels) {
            let mut studio = Lighting::studio(view.forward()?, view.up);
            let shadow_bias = material.is_none().then_some(LABEL_BIAS);
            studio.shadow_bias = shadow_bias.unwrap_or(studio.shadow_bias);
            settings.lighting = Some(studio);
            choices.push(Choice::Light { shadow_bias });
        }
        let Some(material) = material else { return Ok(choices) };
        if open.material {
            settings.lighting = settings.lighting.take().map(|lighting| material.lit(lighting));
        }
        // Post-shaded, samples would be filtered: noise is left as it is unless sharpness is asked for.
        if open.sharpness && composite && !settings.is_post_shaded() && self.plain {
            settings.sharpness = SHARPNESS;
            choices.push(Choice::Sharpness(SHARPNESS));
        }
        Ok(choices)
    }
}

/// How a volume looks: what [`Renderer::prepare_layers`](crate::Renderer::prepare_layers),
/// [`Renderer::render`](crate::Renderer::render) and a camera take, to be changed before use.
#[derive(Debug, Clone)]
pub struct Appearance {
    /// The volume with its transfer function, or its labels.
    pub layers: Layers,
    /// Side and framing.
    pub view: View,
    /// Light, material, sharpness; the rest has its defaults.
    pub settings: Settings,
    /// What was chosen, and why.
    pub choices: Vec<Choice>,
}

impl Appearance {
    /// The looks of the volume that `source` names: a file, or `demo:NAME`. A volume that is not from a file may name
    /// any file.
    ///
    /// # Errors
    /// Those of [`Meaning::of`].
    pub fn of(source: impl AsRef<Path>, volume: &Volume) -> Result<Self> {
        let meaning = Meaning::of(source, volume, true, || Ok(Statistics::of(volume)?))?;
        let plain = |transfer| Layers::of(volume, transfer);
        let subject = Subject { volume, built_in: false, preset: None, labels: false, plain: true };
        match meaning {
            Meaning::Labels { reason } => {
                let layers = Layers::new(Layer::labels(volume, &Labels::stated(volume))?);
                Self::new(layers, Subject { labels: true, ..subject }, Some(Choice::Labels { reason }))
            }
            Meaning::BuiltIn(transfer) => Self::new(plain(&transfer), Subject { built_in: true, ..subject }, None),
            Meaning::Values { transfer, preset, reason } => {
                let chosen = Choice::Preset { name: preset.name, reason };
                Self::new(plain(&transfer), Subject { preset: Some(preset), ..subject }, Some(chosen))
            }
        }
    }

    /// The looks of a volume with a preset.
    ///
    /// # Errors
    /// [`Error::Transfer`](crate::Error::Transfer) if there is no such preset, or if all values are the same;
    /// [`Error::Input`](crate::Error::Input) and [`Error::Memory`](crate::Error::Memory) if samples cannot be read.
    pub fn with_preset(name: &str, volume: &Volume) -> Result<Self> {
        let layers = Layers::of(volume, &TransferFunction::preset(name, volume)?);
        let preset = Some(presets::find(name)?);
        Self::new(layers, Subject { volume, built_in: false, preset, labels: false, plain: true }, None)
    }

    /// The looks of what is drawn, after the choice of it.
    fn new(layers: Layers, subject: Subject<'_>, chosen: Option<Choice>) -> Result<Self> {
        let (mut view, mut settings) = (View::default(), Settings::default());
        let mut choices: Vec<Choice> = chosen.into_iter().collect();
        choices.extend(subject.choose(Open::ALL, &mut view, &mut settings)?);
        view.around = layers.hull(&settings.clip)?;
        Ok(Self { layers, view, settings, choices })
    }

    /// The camera of a picture of `size` pixels, width and height.
    ///
    /// # Errors
    /// Those of [`Camera::new`].
    pub fn camera(&self, size: [u32; 2]) -> Result<Camera> {
        Camera::new(&self.view, self.layers.grid(), size)
    }
}
