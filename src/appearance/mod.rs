//! The default appearance of a volume: transfer function or labels, side, framing, light, material and sharpness.
//!
//! `voxsplat render FILE --frame visible` draws the same picture; its options replace choices. [The library](crate) has
//! an example.

mod channels;
mod choice;
mod clip;
mod foreign;
mod isosurface;
mod labels;
mod light;
mod options;
mod overlay;
mod part;
mod section;
mod suggestion;
mod transfer;

pub mod demos;

/// The part of the library that the program and the Python package share: requests of a user as texts, open choices,
/// overlays and channels of files, and notes. It is no part of the interface: any release may change it.
#[doc(hidden)]
pub mod program {
    pub use super::channels::{ChannelChoice, ChannelLook, Loaded, Values, load_channels};
    pub use super::choice::{GUESS, LABELS, ValueMeaning};
    pub use super::clip::ClipSpec;
    pub use super::foreign::ForeignWords;
    pub use super::isosurface::IsosurfaceSpec;
    pub use super::labels::{LabelLooks, LabelSpec};
    pub use super::light::{LightPlace, LightRequest, LightSpec, OcclusionSpec, ShadowSpec, place_studio};
    pub use super::options::{command_line, notes, options_of, quoted};
    pub use super::overlay::{HOT, Overlay, OverlayLook, OverlaySpec, Overlays, PlacedOverlay, TWO_SIDED, UsedColors};
    pub use super::part::needed_part;
    pub use super::section::PlaneSpec;
    pub use super::transfer::{FittedTransfer, GradientSpec, MAP, TransferChoice, TransferRequest};
    pub use super::{ChoiceContext, OpenChoices};
}

use std::path::Path;

pub use choice::Choice;
pub use suggestion::{Suggestion, suggest};

use crate::camera::clip::Clip;
use crate::camera::{Camera, Hull, View};
use crate::error::{Error, Result};
use crate::formats::PyramidLevel;
use crate::layers::{Labels, Layer, Layers};
use crate::lighting::Lighting;
use crate::settings::{Model, Settings};
use crate::transfer::TransferFunction;
use crate::transfer::presets::{self, Material, PresetValues};
use crate::volume::{Statistics, Volume};
use channels::Loaded;
use choice::ValueMeaning;
use voxsplat_volume::names::named;

/// Azimuth and elevation of a view of three sides of a box, degrees.
const OBLIQUE: [f64; 2] = [30.0, 20.0];

/// The sharpness of a picture of surfaces: crisper edges at no cost per frame, and less noise than at 1.
const SHARPNESS: f64 = 0.5;

/// The [`Lighting::shadow_bias`] of labels, voxels: their surfaces are stairs of voxels, which cast shadows on each
/// other.
const LABEL_BIAS: f64 = 4.0;

/// The region that a picture is fitted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Framing {
    /// The visible voxels, at one size for every azimuth.
    Visible,
    /// The visible voxels, as large as the view permits.
    View,
    /// The box of the lattice.
    Volume,
}

named! { "frame", Framing { Visible: "visible", View: "view", Volume: "volume" } }

impl Framing {
    /// Returns the region that suits a view: the box of the lattice if the view has a target or a size of its own,
    /// otherwise the visible voxels. Pictures of a series have one size for every azimuth; a single picture is as large
    /// as its view permits.
    #[must_use]
    pub fn suited_to(view: &View, in_series: bool) -> Self {
        match view.target.is_some() || view.view_height.is_some() || view.distance.is_some() {
            true => Self::Volume,
            false if in_series => Self::Visible,
            false => Self::View,
        }
    }

    /// Returns the hull that the picture is fitted to; `None` is the box of the lattice.
    ///
    /// # Errors
    /// The errors of [`Layers::hull`].
    pub fn hull(self, layers: &Layers, clip: &Clip) -> Result<Option<Hull>> {
        Ok(match self {
            Self::Volume => None,
            Self::Visible => layers.hull(clip)?,
            Self::View => layers.hull(clip)?.map(Hull::from_one_side),
        })
    }
}

/// Returns the level of a pyramid that suits a picture of `size` pixels, width and height: the coarsest level whose
/// samples are no coarser than pixels.
#[must_use]
pub fn pyramid_level(view: &View, size: [u32; 2]) -> PyramidLevel {
    match view.view_height {
        Some(height) => PyramidLevel::PixelSize(height / view.zoom / f64::from(size[1])),
        None => PyramidLevel::Pixels(f64::from(size[0].max(size[1])) * view.zoom),
    }
}

/// The choices that are left to the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[doc(hidden)]
pub struct OpenChoices {
    /// The side of the volume that faces the eye.
    pub side: bool,
    /// The lights, or no light.
    pub light: bool,
    /// The material of lit surfaces.
    pub material: bool,
    /// The sharpness.
    pub sharpness: bool,
}

impl OpenChoices {
    /// All choices.
    pub const ALL: Self = Self { side: true, light: true, material: true, sharpness: true };
}

/// The facts that decide open choices.
#[derive(Debug, Clone, Copy)]
#[doc(hidden)]
pub struct ChoiceContext<'a> {
    /// The volume that is drawn.
    pub volume: &'a Volume,
    /// Azimuth and elevation that the volume suggests, in degrees, if it is built in.
    pub view: Option<[f64; 2]>,
    /// The material of the surfaces that the transfer function shows; `None`: translucent matter.
    pub material: Option<Material>,
    /// Whether channels are drawn in a colour each.
    pub channels: bool,
    /// Whether labels are drawn.
    pub labels: bool,
    /// Whether overlays are drawn.
    pub overlays: bool,
    /// Whether the volume is drawn alone, without labels or overlays over it or a mask.
    pub plain: bool,
}

/// The preset whose material channels have.
const CHANNELS: &str = "fluorescence";
/// The preset whose material overlays have over a volume without one.
const OVERLAYS: &str = "activation";

impl<'a> ChoiceContext<'a> {
    /// Makes the context of translucent matter of a volume that is drawn alone.
    #[must_use]
    pub fn of(volume: &'a Volume) -> Self {
        Self { volume, view: None, material: None, channels: false, labels: false, overlays: false, plain: true }
    }

    /// Makes the open choices in `view` and `settings`, and returns the choices made.
    ///
    /// # Errors
    /// [`Error::Camera`] if the view has no direction.
    pub fn make_choices(&self, open: OpenChoices, view: &mut View, settings: &mut Settings) -> Result<Vec<Choice>> {
        let mut choices = Vec::new();
        // The front of a box without an orientation hides most of it.
        let has_front = self.volume.is_oriented() || self.volume.grid().dims().contains(&1);
        let side = match self.view {
            Some(side) => Some((side, "the built-in volume suggests this view")).filter(|_| side != [0.0; 2]),
            None => (!has_front).then_some((OBLIQUE, "the file states no orientation")),
        };
        if let Some(([azimuth, elevation], reason)) = side.filter(|_| open.side) {
            (view.azimuth, view.elevation) = (azimuth, elevation);
            choices.push(Choice::Side { azimuth, elevation, reason });
        }
        let composite = settings.model == Model::Composite;
        let material = match (self.channels, self.material) {
            (true, _) => presets::find(CHANNELS)?.material,
            (false, None) if self.overlays => presets::find(OVERLAYS)?.material,
            (false, material) => material,
        };
        if open.light && composite && (material.is_some() || self.labels) {
            let mut studio = Lighting::studio(view.forward()?, view.up);
            let shadow_bias = material.is_none().then_some(LABEL_BIAS);
            studio.shadow_bias = shadow_bias.unwrap_or(studio.shadow_bias);
            settings.lighting = Some(studio);
            let surfaces = match (self.channels, shadow_bias) {
                (true, _) => "channels show surfaces",
                (false, None) => "the transfer function shows surfaces",
                (false, Some(_)) => "labels have surfaces",
            };
            choices.push(Choice::Light { shadow_bias, surfaces });
        }
        let Some(material) = material else { return Ok(choices) };
        if open.material {
            settings.lighting = settings.lighting.take().map(|lighting| material.lit(lighting));
        }
        if open.sharpness && composite && self.plain && !self.channels {
            settings.sharpness = SHARPNESS;
            choices.push(Choice::Sharpness(SHARPNESS));
        }
        Ok(choices)
    }
}

/// The appearance of a volume: input of [`Renderer::prepare_layers`](crate::Renderer::prepare_layers),
/// [`Renderer::render`](crate::Renderer::render) and a camera, to be changed before use.
#[derive(Debug, Clone)]
pub struct Appearance {
    /// The volume with its transfer function, or its labels.
    pub layers: Layers,
    /// Side and framing. All azimuths have one size, so a series of pictures is steady; for a single picture
    /// [`Hull::from_one_side`] of [`View::around`] fits as large as the view permits.
    pub view: View,
    /// Light, material and sharpness; otherwise defaults.
    pub settings: Settings,
    /// The choices that were made, with reasons.
    pub choices: Vec<Choice>,
}

impl Appearance {
    /// Chooses the appearance of a volume from `source`: a file, or `demo:NAME`. A volume that is not from a file may
    /// name any file.
    ///
    /// # Errors
    /// The errors of [`ValueMeaning::find`].
    pub fn for_file(source: impl AsRef<Path>, volume: &Volume) -> Result<Self> {
        let meaning = ValueMeaning::find(&source, volume, true, PresetValues::Auto, || Ok(Statistics::of(volume)?))?;
        let alone = ChoiceContext::of(volume);
        match meaning {
            ValueMeaning::Labels { reason } => {
                let layers = Layers::new(Layer::labels(volume, &Labels::stated(volume))?);
                Self::new(layers, ChoiceContext { labels: true, ..alone }, Some(Choice::Labels { reason }))
            }
            ValueMeaning::BuiltIn(transfer) => {
                let look = demos::own_look(source);
                let (view, material) = (look.map(|look| look.view), look.and_then(|look| look.material));
                Self::new(Layers::of_volume(volume, &transfer), ChoiceContext { view, material, ..alone }, None)
            }
            ValueMeaning::Values { transfer, preset, reason, is_guess } => {
                let choice = Choice::Preset { name: preset.name, reason, is_guess };
                let context = ChoiceContext { material: preset.material, ..alone };
                Self::new(Layers::of_volume(volume, &transfer), context, Some(choice))
            }
        }
    }

    /// Chooses the appearance of the contents of a file, which `program::load_channels` returned: channels in a colour
    /// each, or a volume as [`Self::for_file`] does.
    ///
    /// # Errors
    /// The errors of [`Self::for_file`]; [`Error::Input`] if lattices of channels differ.
    pub fn for_loaded(source: impl AsRef<Path>, loaded: &Loaded) -> Result<Self> {
        let Loaded { volume, layers, channels, .. } = loaded;
        let mut layers = layers.iter().cloned();
        let Some(first) = layers.next() else { return Self::for_file(source, volume) };
        let layers = layers.try_fold(Layers::new(first), Layers::with)?;
        let channels = !channels.is_empty();
        Self::new(layers, ChoiceContext { channels, ..ChoiceContext::of(volume) }, None)
    }

    /// Chooses the appearance of a volume with a preset.
    ///
    /// # Errors
    /// [`Error::Transfer`] if there is no such preset, or if all values are the same;
    /// [`Error::Input`] and [`Error::Memory`] if samples cannot be read.
    pub fn for_preset(name: &str, volume: &Volume) -> Result<Self> {
        let layers = Layers::of_volume(volume, &TransferFunction::preset(name, volume)?);
        let material = presets::find(name)?.material;
        Self::new(layers, ChoiceContext { material, ..ChoiceContext::of(volume) }, None)
    }

    fn new(layers: Layers, context: ChoiceContext<'_>, chosen: Option<Choice>) -> Result<Self> {
        let (mut view, mut settings) = (View::default(), Settings::default());
        let mut choices: Vec<Choice> = chosen.into_iter().collect();
        choices.extend(context.make_choices(OpenChoices::ALL, &mut view, &mut settings)?);
        view.around = layers.hull(&settings.clip)?;
        Ok(Self { layers, view, settings, choices })
    }

    /// Returns the camera of a picture of `size` pixels, width and height.
    ///
    /// # Errors
    /// The errors of [`Camera::new`].
    pub fn camera(&self, size: [u32; 2]) -> Result<Camera> {
        Camera::new(&self.view, self.layers.grid(), size)
    }
}
