//! Layers: several media on one lattice, drawn together. Each has samples and a look of its own; where they overlap,
//! extinctions add, and colours add by extinction:
//!
//! ```text
//! tau_j = sum over layers of tau        c_j tau_j = sum over layers of c tau
//! ```
//!
//! Voxels are classified before they are reconstructed, each by its own samples: numbers of labels are never mixed.

mod labels;
mod lattice;
mod recognise;
mod shown;
mod table;

use std::sync::Arc;

pub use self::labels::{LabelCount, Labels, Which, count_labels};
pub(crate) use self::labels::{Look, look_of};
pub use self::lattice::{Fit, on_lattice};
pub use self::recognise::recognised;
pub use self::table::Label;
use crate::clip::Clip;
use crate::error::{Error, Result};
use crate::framing::Hull;
use crate::settings::{Level, Model, Settings};
use crate::transfer::TransferFunction;
use crate::volume::{Grid, Volume};

/// Media on one lattice, at least one.
#[derive(Debug, Clone, PartialEq)]
pub struct Layers {
    layers: Vec<Layer>,
}

/// A line of a legend.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LegendEntry {
    /// What it is of.
    pub name: String,
    /// Red, green and blue, sRGB.
    pub color: [u8; 3],
}

/// One of the media of a lattice.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    pub(crate) matter: Matter,
    pub(crate) mask: Option<Mask>,
    /// What a legend says of it, if it is not of labels.
    named: Option<LegendEntry>,
}

/// Samples, and what they look like.
#[derive(Debug, Clone)]
pub(crate) enum Matter {
    Scalars {
        volume: Volume,
        transfer: TransferFunction,
    },
    /// With the names of the looks.
    Labels {
        volume: Volume,
        looks: Arc<[Look]>,
        names: Arc<[String]>,
    },
    Colors(Box<Colors>),
}

/// Voxels that have colours.
#[derive(Debug, Clone)]
pub(crate) struct Colors {
    /// Red, green, blue.
    pub(crate) channels: [Volume; 3],
    pub(crate) alpha: Option<Volume>,
    /// The value of a channel at its brightest.
    pub(crate) white: f64,
    /// Opacities of alpha, or of [`luminance`] where there is none.
    pub(crate) transfer: TransferFunction,
}

/// The luminance of red, green and blue (ITU-R BT.709).
pub(crate) fn luminance([red, green, blue]: [f64; 3]) -> f64 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

/// Where a layer shows.
#[derive(Debug, Clone)]
pub(crate) struct Mask {
    pub(crate) volume: Volume,
    /// The labels of it where the layer shows, ascending.
    pub(crate) shown: Arc<[i64]>,
}

impl PartialEq for Matter {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Scalars { volume: a, transfer }, Self::Scalars { volume: b, transfer: of_b }) => {
                a.is_same(b) && transfer == of_b
            }
            (Self::Labels { volume: a, looks, names }, Self::Labels { volume: b, looks: of_b, names: named }) => {
                a.is_same(b) && looks == of_b && names == named
            }
            (Self::Colors(a), Self::Colors(b)) => {
                let alphas = match (&a.alpha, &b.alpha) {
                    (Some(a), Some(b)) => a.is_same(b),
                    (a, b) => a.is_none() && b.is_none(),
                };
                let channels = a.channels.iter().zip(&b.channels).all(|(a, b)| a.is_same(b));
                channels && alphas && a.white == b.white && a.transfer == b.transfer
            }
            _ => false,
        }
    }
}

impl PartialEq for Mask {
    fn eq(&self, other: &Self) -> bool {
        self.volume.is_same(&other.volume) && self.shown == other.shown
    }
}

impl Layer {
    fn of(matter: Matter) -> Self {
        Self { matter, mask: None, named: None }
    }

    /// Scalars that a transfer function classifies.
    #[must_use]
    pub fn scalars(volume: &Volume, transfer: &TransferFunction) -> Self {
        Self::of(Matter::Scalars { volume: volume.clone(), transfer: transfer.clone() })
    }

    /// Labels, each of which has a colour and an opacity of a slab as thick as the least distance of voxels. Reads the
    /// volume once.
    ///
    /// # Errors
    /// Those of [`count_labels`].
    pub fn labels(volume: &Volume, labels: &Labels) -> Result<Self> {
        let (looks, names) = labels.looks(&count_labels(volume)?);
        Ok(Self::of(Matter::Labels { volume: volume.clone(), looks: looks.into(), names: names.into() }))
    }

    /// Voxels in colours of their own: red, green and blue, `white` where they are brightest. The transfer function
    /// says how opaque they are, by their `alpha` or, if there is none, by their luminance (ITU-R BT.709); its colours
    /// do not count.
    ///
    /// # Errors
    /// [`Error::Setting`] if the lattices differ or `white` is not over 0.
    pub fn colors(
        channels: [&Volume; 3],
        alpha: Option<&Volume>,
        white: f64,
        transfer: &TransferFunction,
    ) -> Result<Self> {
        for other in channels.into_iter().chain(alpha) {
            check_lattice("channel", channels[0], other)?;
        }
        if !(white > 0.0 && white.is_finite()) {
            return Err(Error::Setting { name: "white", reason: format!("{white}, expected a number over 0") });
        }
        let (channels, alpha) = (channels.map(Volume::clone), alpha.cloned());
        let colors = Colors { channels, alpha, white, transfer: transfer.clone() };
        Ok(Self::of(Matter::Colors(Box::new(colors))))
    }

    /// The same layer with a name and a colour in [`Layers::legend`], such as those of a channel. Labels have their
    /// own.
    #[must_use]
    pub fn named(self, entry: LegendEntry) -> Self {
        Self { named: Some(entry), ..self }
    }

    /// What [`Self::named`] said.
    #[must_use]
    pub fn entry(&self) -> Option<&LegendEntry> {
        self.named.as_ref()
    }

    /// The same layer where a volume of labels has one of some, and nothing elsewhere. Reads that volume once.
    ///
    /// # Errors
    /// Those of [`Self::labels`], and [`Error::Setting`] if the lattices differ (see [`on_lattice`]) or no voxel has
    /// such a label.
    pub fn masked(self, mask: &Volume, which: &Which) -> Result<Self> {
        check_lattice("mask", self.volume(), mask)?;
        let shown: Vec<i64> =
            count_labels(mask)?.into_iter().map(|count| count.label).filter(|&label| which.has(label, "")).collect();
        if shown.is_empty() {
            return Err(Error::Setting { name: "mask", reason: "no voxel has such a label".to_owned() });
        }
        Ok(Self { mask: Some(Mask { volume: mask.clone(), shown: shown.into() }), ..self })
    }

    /// The same look of other samples, such as those of another point in time. `other` gives the volume that takes the
    /// place of each. Looks of labels are those of the labels that there are now.
    ///
    /// # Errors
    /// [`Error::Setting`] if the lattice of a volume is another one, and what `other` returns.
    pub fn with_samples(&self, mut other: impl FnMut(&Volume) -> Result<Volume>) -> Result<Self> {
        let mut next = |volume: &Volume| {
            let next = other(volume)?;
            check_lattice("volume", volume, &next).map(|()| next)
        };
        let matter = match &self.matter {
            Matter::Scalars { volume, transfer } => {
                Matter::Scalars { volume: next(volume)?, transfer: transfer.clone() }
            }
            Matter::Labels { volume, looks, names } => {
                Matter::Labels { volume: next(volume)?, looks: Arc::clone(looks), names: Arc::clone(names) }
            }
            Matter::Colors(colors) => {
                let [red, green, blue] = &colors.channels;
                let channels = [next(red)?, next(green)?, next(blue)?];
                let alpha = colors.alpha.as_ref().map(&mut next).transpose()?;
                Matter::Colors(Box::new(Colors { channels, alpha, ..Colors::clone(colors) }))
            }
        };
        Ok(Self { matter, mask: self.mask.clone(), named: self.named.clone() })
    }

    fn grid(&self) -> &Grid {
        self.volume().grid()
    }

    pub(crate) fn volume(&self) -> &Volume {
        match &self.matter {
            Matter::Scalars { volume, .. } | Matter::Labels { volume, .. } => volume,
            Matter::Colors(colors) => &colors.channels[0],
        }
    }

    /// The distance that opacities are per, world units.
    pub(crate) fn unit(&self) -> f64 {
        let spacing = self.grid().min_spacing();
        match &self.matter {
            Matter::Scalars { transfer, .. } => transfer.unit_or(spacing),
            Matter::Colors(colors) => colors.transfer.unit_or(spacing),
            Matter::Labels { .. } => spacing,
        }
    }

    /// The largest opacity of any voxel.
    pub(crate) fn max_opacity(&self) -> f64 {
        match &self.matter {
            Matter::Scalars { transfer, .. } => transfer.max_opacity(),
            Matter::Colors(colors) => colors.transfer.max_opacity(),
            Matter::Labels { looks, .. } => looks.iter().map(|look| look.opacity).fold(0.0, f64::max),
        }
    }
}

/// Refuses a volume on another lattice.
fn check_lattice(name: &'static str, volume: &Volume, other: &Volume) -> Result<()> {
    lattice::fit(other, volume).map(drop).map_err(|reason| Error::Setting { name, reason })
}

impl Layers {
    /// A volume as it is drawn alone.
    #[must_use]
    pub fn of(volume: &Volume, transfer: &TransferFunction) -> Self {
        Self::new(Layer::scalars(volume, transfer))
    }

    /// One layer.
    #[must_use]
    pub fn new(layer: Layer) -> Self {
        Self { layers: vec![layer] }
    }

    /// The same with another layer.
    ///
    /// # Errors
    /// [`Error::Setting`] if it has another number of voxels along an axis, or if the files state where both are and
    /// voxels are half a voxel or more apart: [`on_lattice`] resamples labels.
    pub fn with(mut self, layer: Layer) -> Result<Self> {
        check_lattice("labels", self.layers[0].volume(), layer.volume())?;
        self.layers.push(layer);
        Ok(self)
    }

    /// The lattice.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        self.layers[0].grid()
    }

    /// The hull of all that layers show and that is not cut away; `None` if that is nothing. Masks do not count.
    ///
    /// # Errors
    /// Those of [`Hull::of_visible`].
    pub fn hull(&self, clip: &Clip) -> Result<Option<Hull>> {
        let hull = |layer: &Layer| match (&layer.mask, &layer.matter) {
            (Some(mask), _) => Hull::of_values(&mask.volume, &runs(mask.shown.iter().copied()), clip),
            (None, Matter::Scalars { volume, transfer }) => Hull::of_visible(volume, transfer, clip),
            (None, Matter::Colors(colors)) => match &colors.alpha {
                Some(alpha) => Hull::of_visible(alpha, &colors.transfer, clip),
                // Luminance is no more than the brightest channel.
                None => united(colors.channels.iter().map(|channel| Hull::of_visible(channel, &colors.transfer, clip))),
            },
            (None, Matter::Labels { volume, looks, .. }) => {
                let shown = looks.iter().filter(|look| look.opacity > 0.0).map(|look| look.label);
                Hull::of_values(volume, &runs(shown), clip)
            }
        };
        united(self.layers.iter().map(hull))
    }

    /// What a legend says of layers: every label that shows, in ascending order, and layers that are
    /// [named](Layer::named). A label shows if it is not clear and one of its voxels is neither cut away nor masked; it
    /// may be hidden behind others. Reads labels again if something is cut away or masked.
    ///
    /// # Errors
    /// [`Error::Input`] and [`Error::Memory`] if samples left in a file cannot be read.
    pub fn legend(&self, clip: &Clip) -> Result<Vec<LegendEntry>> {
        let mut entries = Vec::new();
        for layer in &self.layers {
            match &layer.matter {
                Matter::Labels { volume, looks, names } => {
                    let shown = shown::labels(volume, looks, layer.mask.as_ref(), clip)?;
                    let all = looks.iter().zip(names.iter()).zip(shown);
                    entries.extend(all.filter(|(_, shown)| *shown).map(|((look, name), _)| LegendEntry {
                        name: if name.is_empty() { format!("label {}", look.label) } else { name.clone() },
                        color: look.color.map(|channel| (255.0 * channel).round() as u8),
                    }));
                }
                _ => entries.extend(layer.named.clone()),
            }
        }
        Ok(entries)
    }

    /// The volume and the transfer function, if there is nothing else.
    pub(crate) fn plain(&self) -> Option<(&Volume, &TransferFunction)> {
        match self.layers.as_slice() {
            [Layer { matter: Matter::Scalars { volume, transfer }, mask: None, .. }] => Some((volume, transfer)),
            _ => None,
        }
    }

    pub(crate) fn all(&self) -> &[Layer] {
        &self.layers
    }

    /// The distance that opacities of splats are per, world units.
    pub(crate) fn unit(&self) -> f64 {
        self.layers[0].unit()
    }

    /// The largest extinction of a voxel, per [`Self::unit`].
    pub(crate) fn max_density(&self) -> f64 {
        let density = |layer: &Layer| TransferFunction::extinction(layer.max_opacity(), layer.unit() / self.unit());
        self.layers.iter().map(density).sum()
    }

    /// The largest of each channel of the colours.
    pub(crate) fn brightest(&self) -> [f64; 3] {
        let brightest = |layer: &Layer| match &layer.matter {
            Matter::Scalars { transfer, .. } => transfer.brightest(),
            Matter::Colors(_) => [1.0; 3],
            Matter::Labels { looks, .. } => looks.iter().fold([0.0; 3], |most, look| larger(most, look.color)),
        };
        self.layers.iter().map(brightest).fold([0.0; 3], larger)
    }

    /// Refuses settings that layers are not drawn by, and values that are no numbers.
    pub(crate) fn check(&self, settings: &Settings) -> Result<()> {
        for layer in &self.layers {
            match &layer.matter {
                Matter::Scalars { volume, .. } => volume.check_finite()?,
                Matter::Labels { .. } => {}
                Matter::Colors(colors) => {
                    colors.channels.iter().chain(&colors.alpha).try_for_each(Volume::check_finite)?;
                }
            }
        }
        if self.plain().is_some() { Ok(()) } else { Self::check_settings(settings) }
    }

    /// Refuses settings that layers are not drawn by, unless they are one volume alone.
    ///
    /// # Errors
    /// [`Error::Setting`] of post-shading, projections of intensity and cells of a level above 0.
    pub fn check_settings(settings: &Settings) -> Result<()> {
        let (name, what) = match settings {
            Settings { model: Model::Mip | Model::Minip | Model::Average, .. } => ("model", settings.model.name()),
            _ if settings.is_post_shaded() => ("shading", "post"),
            Settings { level: Level::At(1..), .. } => ("level", "over 0"),
            _ => return Ok(()),
        };
        let reason = format!("{what}, and labels, masks and channels are drawn voxel by voxel, pre-shaded");
        Err(Error::Setting { name, reason })
    }
}

/// The hull of all.
fn united(mut hulls: impl Iterator<Item = Result<Option<Hull>>>) -> Result<Option<Hull>> {
    hulls.try_fold(None, |all: Option<Hull>, hull| {
        Ok(match (all, hull?) {
            (Some(a), Some(b)) => Some(a.and(&b)),
            (a, b) => a.or(b),
        })
    })
}

fn larger(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|channel| a[channel].max(b[channel]))
}

/// Ranges of values that hold ascending labels and no other whole numbers.
fn runs(labels: impl Iterator<Item = i64>) -> Vec<[f64; 2]> {
    let mut runs: Vec<[f64; 2]> = Vec::new();
    for label in labels.map(|label| label as f64) {
        match runs.last_mut() {
            Some([_, high]) if *high + 1.0 == label => *high = label,
            _ => runs.push([label, label]),
        }
    }
    runs
}
