//! Layers: several media on one lattice, drawn together. Each layer has its own samples and look. Media of other
//! lattices are put onto the lattice of the picture first ([`Layer::on_lattice`]). Where layers overlap, extinctions
//! add, and colours add weighted by extinction:
//!
//! ```text
//! tau_j = sum over layers of tau        c_j tau_j = sum over layers of c tau
//! ```
//!
//! Voxels are classified before they are reconstructed, so that numbers of labels are never mixed.

mod labels;
mod lattice;
mod recognise;
mod resample;
mod shown;
mod table;

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

pub use self::labels::{LabelChange, LabelCount, LabelSelection, Labels, count_labels};
pub(crate) use self::labels::{LabelLook, look_of};
pub(crate) use self::lattice::nearest as nearest_samples;
pub use self::lattice::{Fit, Lattice, on_lattice};
pub use self::recognise::recognised;
pub(crate) use self::resample::values as resampled;
pub use self::table::Label;
use crate::camera::clip::Clip;
use crate::camera::framing::Hull;
use crate::error::{Error, InputError, Result};
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
    /// The name of the layer or the label.
    pub name: String,
    /// Red, green and blue of the patch, sRGB, 0 to 255.
    pub color: [u8; 3],
}

/// A medium of a lattice, which may share the lattice with others.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    pub(crate) matter: Matter,
    pub(crate) mask: Option<Mask>,
    /// The lines of the layer in a legend, unless it is a layer of labels.
    named: Vec<LegendEntry>,
}

/// The samples of a layer, with their look.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Matter {
    Scalars {
        volume: Volume,
        transfer: TransferFunction,
    },
    /// Numbers of labels, with a look and a name for each.
    Labels {
        volume: Volume,
        looks: Arc<[LabelLook]>,
        names: Arc<[String]>,
    },
    Colors(Box<Colors>),
}

/// Voxels that have colours.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Colors {
    /// The volumes of red, green and blue.
    pub(crate) channels: [Volume; 3],
    pub(crate) alpha: Option<Volume>,
    /// The value of a channel at its brightest.
    pub(crate) white: f64,
    /// The transfer function of opacities by alpha, or by [`luminance`] without alpha.
    pub(crate) transfer: TransferFunction,
}

/// Returns the luminance of red, green and blue (ITU-R BT.709).
pub(crate) fn luminance([red, green, blue]: [f64; 3]) -> f64 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

/// The voxels in which a layer is visible.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mask {
    pub(crate) volume: Volume,
    /// The labels of `volume` at which the layer is visible, ascending.
    pub(crate) shown: Arc<[i64]>,
}

impl Layer {
    fn new(matter: Matter) -> Self {
        Self { matter, mask: None, named: Vec::new() }
    }

    /// Makes a layer of scalars that a transfer function classifies.
    #[must_use]
    pub fn scalars(volume: &Volume, transfer: &TransferFunction) -> Self {
        Self::new(Matter::Scalars { volume: volume.clone(), transfer: transfer.clone() })
    }

    /// Makes a layer of labels. Each label has a colour and an opacity, per slab as thick as the smallest spacing.
    /// Reads the volume once.
    ///
    /// # Errors
    /// The errors of [`count_labels`].
    pub fn labels(volume: &Volume, labels: &Labels) -> Result<Self> {
        let (looks, names) = labels.looks(&count_labels(volume)?);
        Ok(Self::new(Matter::Labels { volume: volume.clone(), looks: looks.into(), names: names.into() }))
    }

    /// Makes a layer of voxels with colours: red, green and blue, brightest at `white`. The transfer function gives
    /// their opacity, by `alpha` or, without it, by their luminance (ITU-R BT.709); its colours are ignored.
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
            return Err(Error::setting("white", format!("{white}, expected a number over 0")));
        }
        let (channels, alpha) = (channels.map(Volume::clone), alpha.cloned());
        let colors = Colors { channels, alpha, white, transfer: transfer.clone() };
        Ok(Self::new(Matter::Colors(Box::new(colors))))
    }

    /// Adds a line to the layer's lines in [`Layers::legend`], such as for a channel. Labels have lines without it.
    #[must_use]
    pub fn named(mut self, entry: LegendEntry) -> Self {
        self.named.push(entry);
        self
    }

    /// Returns the first line that [`Self::named`] added.
    #[must_use]
    pub fn entry(&self) -> Option<&LegendEntry> {
        self.named.first()
    }

    /// Makes the layer visible only in the voxels whose label in `mask` is one of `which`. Reads `mask` once. With an
    /// empty mask, all of whose labels are 0, the layer is invisible (see [`Layers::hidden`]).
    ///
    /// # Errors
    /// The errors of [`Self::labels`], and [`Error::Setting`] if the lattices differ (see [`on_lattice`]), or if there
    /// are labels other than 0 and none of them is one of `which`.
    pub fn masked(self, mask: &Volume, which: &LabelSelection) -> Result<Self> {
        check_lattice("mask", self.volume(), mask)?;
        let all: Vec<i64> = count_labels(mask)?.into_iter().map(|count| count.label).collect();
        let shown: Vec<i64> = all.iter().copied().filter(|&label| which.has(label, "")).collect();
        if shown.is_empty() && all != [0] {
            return Err(Error::setting("mask", "no voxel has such a label"));
        }
        Ok(Self { mask: Some(Mask { volume: mask.clone(), shown: shown.into() }), ..self })
    }

    /// Returns the layer on another lattice, and how it was put there. A layer on other points is resampled: labels and
    /// masks as [`on_lattice`] does, values by a cubic spline through the samples, before they are classified. A voxel
    /// that spans several samples gets their mean. Opacities keep their slab. The layer is invisible outside of its own
    /// lattice.
    ///
    /// # Errors
    /// The errors of [`on_lattice`], with the name of the setting `name`, and those of
    /// [`Volume::with_non_finite_replaced`].
    pub fn on_lattice(&self, of: &Lattice, name: &'static str) -> Result<(Self, Fit)> {
        let mut layer = self.clone();
        let Some(transfer) = self.transfer() else {
            let (mut fit, mut all) = (Fit::Same, layer.volumes());
            for volume in &mut all {
                (**volume, fit) = lattice::put(volume, of, name, None)?;
            }
            return Ok((layer.with_mask_on(of, name)?, fit));
        };
        let hidden = invisible_value(transfer);
        let values = lattice::Values { transfer, absent: hidden.unwrap_or_default() };
        let mut fit = Fit::Same;
        for volume in layer.volumes() {
            let finite = without_gaps(volume, || Ok(values.absent))?.into_owned();
            (*volume, fit) = lattice::put(&finite, of, name, Some(values))?;
        }
        if matches!(fit, Fit::Interpolated { .. }) {
            // Matter does not get denser in smaller voxels.
            let unit = self.unit();
            if let Matter::Scalars { transfer, .. } = &mut layer.matter {
                *transfer = transfer.with_unit_distance(unit)?;
            } else if let Matter::Colors(colors) = &mut layer.matter {
                colors.transfer = colors.transfer.with_unit_distance(unit)?;
            }
        }
        if hidden.is_none() && matches!(fit, Fit::Interpolated { .. }) {
            // No value hides a voxel, so a mask does.
            let own = *self.grid();
            let inside = Volume::from_slice(own.dims(), [1.0; 3], &vec![1_u8; own.len() as usize])?.with_grid(own)?;
            let inside = if self.volume().is_oriented() { inside.with_orientation_known() } else { inside };
            let (volume, _) = lattice::put(&inside, of, name, None)?;
            layer.mask = layer.mask.or(Some(Mask { volume, shown: [1].into() }));
        }
        Ok((layer.with_mask_on(of, name)?, fit))
    }

    fn with_mask_on(mut self, of: &Lattice, name: &'static str) -> Result<Self> {
        if let Some(mask) = &mut self.mask {
            mask.volume = lattice::put(&mask.volume, of, name, None)?.0;
        }
        Ok(self)
    }

    /// Returns the layer with other samples, such as of another time point. `other` replaces each volume. Labels keep
    /// the looks of their present labels.
    ///
    /// # Errors
    /// [`Error::Setting`] if a volume has another lattice, and the errors of `other`.
    pub fn with_samples(&self, mut other: impl FnMut(&Volume) -> Result<Volume>) -> Result<Self> {
        let mut layer = self.clone();
        for volume in layer.volumes() {
            let next = other(volume)?;
            check_lattice("volume", volume, &next)?;
            *volume = next;
        }
        Ok(layer)
    }

    /// Returns the layer with the means of blocks of voxels: see [`Volume::reduced`]. Not for labels.
    pub(crate) fn reduced(&self, factors: [u32; 3]) -> Result<Self> {
        self.replaced(&mut |volume| Ok(volume.reduced(factors)?))
    }

    /// Replaces each volume of the layer, the mask too, by the result of `other`.
    fn replaced(&self, other: &mut impl FnMut(&Volume) -> Result<Volume>) -> Result<Self> {
        let mut layer = self.clone();
        for volume in layer.volumes() {
            *volume = other(volume)?;
        }
        if let Some(mask) = &mut layer.mask {
            mask.volume = other(&mask.volume)?;
        }
        Ok(layer)
    }

    /// Returns the volumes of the layer, without the mask.
    fn volumes(&mut self) -> Vec<&mut Volume> {
        match &mut self.matter {
            Matter::Scalars { volume, .. } | Matter::Labels { volume, .. } => vec![volume],
            Matter::Colors(colors) => colors.channels.iter_mut().chain(&mut colors.alpha).collect(),
        }
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

    /// Returns the transfer function, unless the layer is of labels.
    fn transfer(&self) -> Option<&TransferFunction> {
        match &self.matter {
            Matter::Scalars { transfer, .. } => Some(transfer),
            Matter::Colors(colors) => Some(&colors.transfer),
            Matter::Labels { .. } => None,
        }
    }

    /// Returns the thickness of the slab that opacities belong to, world units.
    pub(crate) fn unit(&self) -> f64 {
        let spacing = self.grid().min_spacing();
        self.transfer().map_or(spacing, |transfer| transfer.unit_or(spacing))
    }

    /// Returns the largest opacity of any voxel.
    pub(crate) fn max_opacity(&self) -> f64 {
        match &self.matter {
            Matter::Labels { looks, .. } => looks.iter().map(|look| look.opacity).fold(0.0, f64::max),
            _ => self.transfer().map_or(0.0, TransferFunction::max_opacity),
        }
    }
}

/// Returns the value in place of NaN and infinite values, which stand for no matter. It has no opacity if any value has
/// none, and is next to the visible values, so that interpolation passes few others.
pub(crate) fn absent_value(transfer: &TransferFunction) -> f64 {
    let base = f64::from(transfer.base() as f32);
    let is_absent = base.is_finite() && transfer.is_invisible([base; 2]);
    if is_absent { base } else { invisible_value(transfer).unwrap_or(transfer.base()) }
}

/// Replaces NaN and infinite values of a volume by an invisible value. In projections of intensity this is the lowest
/// value, which never wins, unless both the lowest and the highest are visible, as in a statistic. A brick may have no
/// other values.
///
/// # Errors
/// The errors of [`Volume::with_non_finite_replaced`].
pub(crate) fn finite<'a>(volume: &'a Volume, transfer: &TransferFunction, model: Model) -> Result<Cow<'a, Volume>> {
    without_gaps(volume, || {
        if !matches!(model, Model::Mip | Model::Minip) {
            return Ok(absent_value(transfer));
        }
        let range = volume.value_range()?;
        let has_invisible_end = range.iter().any(|&end| end.is_finite() && transfer.is_invisible([end; 2]));
        Ok(if has_invisible_end { range[0] } else { absent_value(transfer) })
    })
}

fn without_gaps(volume: &Volume, absent: impl FnOnce() -> Result<f64>) -> Result<Cow<'_, Volume>> {
    match volume.check_finite() {
        Ok(()) => Ok(Cow::Borrowed(volume)),
        Err(InputError::NonFinite { .. }) => Ok(Cow::Owned(volume.clone().with_non_finite_replaced(absent()?)?)),
        Err(error) => Err(error.into()),
    }
}

/// Returns a value without opacity, exact in f32; `None` if every value has some opacity.
fn invisible_value(transfer: &TransferFunction) -> Option<f64> {
    let [low, high] = transfer.range();
    let width = (high - low).abs().max(1.0);
    let values = [0.0, low, high, low - width, high + width].into_iter();
    let all = values.chain(transfer.points().iter().map(|point| point.value)).map(|value| f64::from(value as f32));
    all.into_iter().find(|value| value.is_finite() && transfer.is_invisible([*value; 2]))
}

/// Refuses a volume on another lattice.
fn check_lattice(name: &'static str, volume: &Volume, other: &Volume) -> Result<()> {
    lattice::fit(other, &Lattice::of(volume)).map(drop).map_err(|reason| Error::setting(name, reason))
}

impl Layers {
    /// Makes one layer of a volume and its transfer function.
    #[must_use]
    pub fn of_volume(volume: &Volume, transfer: &TransferFunction) -> Self {
        Self::new(Layer::scalars(volume, transfer))
    }

    /// Makes layers of a single layer.
    #[must_use]
    pub fn new(layer: Layer) -> Self {
        Self { layers: vec![layer] }
    }

    /// Adds a layer.
    ///
    /// # Errors
    /// [`Error::Setting`] if the layer has another number of voxels along an axis, or if the files state the places of
    /// both and voxels are half a voxel or more apart: [`on_lattice`] resamples labels.
    pub fn with(mut self, layer: Layer) -> Result<Self> {
        check_lattice("labels", self.layers[0].volume(), layer.volume())?;
        self.layers.push(layer);
        Ok(self)
    }

    /// Returns the number of the layer with isosurfaces, its volume, and a function of its isosurfaces alone; `None` if
    /// no layer has any, and for models that leave them out.
    ///
    /// # Errors
    /// [`Error::Setting`] if several layers have isosurfaces, or one that has a mask or colours of its own.
    pub(crate) fn isosurfaces(&self, model: Model) -> Result<Option<(usize, &Volume, TransferFunction)>> {
        if model != Model::Composite {
            return Ok(None);
        }
        let surfaces = |layer: &Layer| layer.transfer().map_or(Vec::new(), TransferFunction::isosurfaces);
        let all = self.layers.iter().enumerate().map(|(number, layer)| (number, layer, surfaces(layer)));
        let mut all = all.filter(|(.., surfaces)| !surfaces.is_empty());
        let Some((number, layer, surfaces)) = all.next() else { return Ok(None) };
        match (&layer.matter, &layer.mask, all.next()) {
            (Matter::Scalars { volume, .. }, None, None) => {
                Ok(Some((number, volume, TransferFunction::of_isosurfaces(&surfaces)?)))
            }
            _ => Err(Error::setting("iso", "isosurfaces are of one layer of values without a mask")),
        }
    }

    /// Returns the layers on a lattice.
    ///
    /// # Errors
    /// The errors of [`Layer::on_lattice`].
    pub fn on_lattice(&self, of: &Lattice) -> Result<Self> {
        let layers = self.layers.iter().map(|layer| Ok(layer.on_lattice(of, "overlay")?.0));
        Ok(Self { layers: layers.collect::<Result<_>>()? })
    }

    /// Returns the voxels of a box of every layer, given by their numbers along x, y and z: the slice of a brick
    /// ([`bricks`](crate::bricks)). Labels keep their looks.
    ///
    /// # Errors
    /// The errors of [`Volume::part`].
    pub fn part(&self, ranges: &[Range<u32>; 3]) -> Result<Self> {
        self.replaced(|volume| Ok(volume.part(ranges.clone())?))
    }

    /// Returns the bytes of the samples of a voxel.
    pub(crate) fn sample_bytes(&self) -> u64 {
        let mut bytes = 0;
        let add = |volume: &Volume| {
            bytes += volume.sample_type().size() as u64;
            Ok(volume.clone())
        };
        // No volume is refused.
        drop(self.replaced(add));
        bytes
    }

    /// Returns the layers on another grid of the same dimensions.
    pub(crate) fn on_grid(&self, grid: &Grid) -> Result<Self> {
        self.replaced(|volume| Ok(volume.clone().with_grid(*grid)?))
    }

    fn replaced(&self, mut other: impl FnMut(&Volume) -> Result<Volume>) -> Result<Self> {
        let layers = self.layers.iter().map(|layer| layer.replaced(&mut other)).collect::<Result<_>>()?;
        Ok(Self { layers })
    }

    /// Returns the lattice of all layers.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        self.layers[0].grid()
    }

    /// Returns the hull of all visible voxels of the layers that are not clipped; `None` if there are none. The hull of
    /// a masked layer is the hull of the mask.
    ///
    /// # Errors
    /// The errors of [`Hull::of_visible`].
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

    /// Returns the lines of a legend: every visible label, in ascending order, and layers that are
    /// [named](Layer::named). A label is visible if it is not clear and one of its voxels is neither clipped nor
    /// masked; it may be hidden behind others. Reads labels again if something is clipped or masked.
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
                _ => entries.extend(layer.named.iter().cloned()),
            }
        }
        Ok(entries)
    }

    /// Returns why layers are invisible: because of an empty mask, or of a volume of labels without labels.
    #[must_use]
    pub fn hidden(&self) -> Vec<&'static str> {
        let is_masked = |layer: &Layer| layer.mask.as_ref().is_some_and(|mask| mask.shown.is_empty());
        let is_clear = |look: &LabelLook| look.label == 0 && look.opacity <= 0.0;
        let is_blank =
            |layer: &Layer| matches!(&layer.matter, Matter::Labels { looks, .. } if looks.iter().all(is_clear));
        let any = |test: &dyn Fn(&Layer) -> bool| self.layers.iter().any(test);
        let masked =
            any(&is_masked).then_some("the volume is invisible because the mask is empty: all its values are 0");
        let blank = any(&is_blank).then_some("no label is visible because all labels are 0");
        masked.into_iter().chain(blank).collect()
    }

    /// Returns the labels that voxels of the layers have, and their names, which are empty if no table has the label.
    pub(crate) fn labels(&self) -> impl Iterator<Item = (i64, &str)> {
        self.layers.iter().flat_map(|layer| match &layer.matter {
            Matter::Labels { looks, names, .. } => {
                looks.iter().map(|look| look.label).zip(names.iter().map(String::as_str)).collect()
            }
            _ => Vec::new(),
        })
    }

    /// Returns the volume of the first layer: all layers have its lattice.
    pub(crate) fn volume(&self) -> &Volume {
        self.all()[0].volume()
    }

    /// Returns the volume and the transfer function of a single layer of scalars without a mask; otherwise `None`.
    pub(crate) fn plain(&self) -> Option<(&Volume, &TransferFunction)> {
        match self.layers.as_slice() {
            [Layer { matter: Matter::Scalars { volume, transfer }, mask: None, .. }] => Some((volume, transfer)),
            _ => None,
        }
    }

    pub(crate) fn all(&self) -> &[Layer] {
        &self.layers
    }

    /// Returns the thickness of the slab that opacities of splats belong to, world units.
    pub(crate) fn unit(&self) -> f64 {
        self.layers[0].unit()
    }

    /// Returns the largest extinction of a voxel, per [`Self::unit`].
    pub(crate) fn max_density(&self) -> f64 {
        let density = |layer: &Layer| TransferFunction::extinction(layer.max_opacity(), layer.unit() / self.unit());
        self.layers.iter().map(density).sum()
    }

    /// Returns the largest value of each channel of the colours.
    pub(crate) fn brightest(&self) -> [f64; 3] {
        let brightest = |layer: &Layer| match &layer.matter {
            Matter::Scalars { transfer, .. } => transfer.brightest(),
            Matter::Colors(_) => [1.0; 3],
            Matter::Labels { looks, .. } => looks.iter().fold([0.0; 3], |most, look| larger(most, look.color)),
        };
        self.layers.iter().map(brightest).fold([0.0; 3], larger)
    }

    /// Refuses settings that layers do not support.
    pub(crate) fn check(&self, settings: &Settings) -> Result<()> {
        if self.plain().is_some() { Ok(()) } else { Self::check_settings(settings) }
    }

    /// Replaces NaN and infinite values of all layers by invisible ones.
    pub(crate) fn finite(&self) -> Result<Self> {
        let finite = |layer: &Layer| {
            let mut layer = layer.clone();
            let Some(absent) = layer.transfer().map(absent_value) else { return Ok(layer) };
            for volume in layer.volumes() {
                *volume = without_gaps(volume, || Ok(absent))?.into_owned();
            }
            Ok(layer)
        };
        Ok(Self { layers: self.layers.iter().map(finite).collect::<Result<_>>()? })
    }

    /// Refuses settings that layers do not support, other than a single volume.
    ///
    /// # Errors
    /// [`Error::Setting`] for post-shading, projections of intensity and cells of a level above 0.
    pub fn check_settings(settings: &Settings) -> Result<()> {
        let (name, what) = match settings {
            Settings { model: Model::Mip | Model::Minip | Model::Average, .. } => ("model", settings.model.name()),
            _ if settings.is_post_shaded() => ("shading", "post"),
            Settings { level: Level::At(1..), .. } => ("level", "over 0"),
            _ => return Ok(()),
        };
        let reason = "labels, masks, overlays and channels are drawn voxel by voxel, pre-shaded";
        Err(Error::setting(name, format!("{what}, and {reason}")))
    }
}

/// Joins the hulls of layers.
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

/// Returns ranges of values that contain ascending labels and no other whole numbers.
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
