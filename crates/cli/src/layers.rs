//! Labels, masks and overlays beside the volume of a job.

use std::path::{Path, PathBuf};

use voxsplat::error::{Error, Hint};
use voxsplat::formats::{self, LoadOptions};
use voxsplat::layers::{Fit, Label, LabelCount, LabelSelection, Layer, Layers, count_labels, on_lattice};
use voxsplat::program::{LabelLooks, Overlay, OverlaySpec, Overlays, PlacedOverlay, UsedColors};
use voxsplat::volume::Volume;
use voxsplat_volume::names::{percent, readable};

use super::args::LayerArgs;
use super::failure::{Failure, refuse};
use super::output;

/// The layers of a job beside its volume, or in place of its values.
#[derive(Debug, Clone, Default)]
pub(crate) struct LayersJob {
    /// Whether the volume is a volume of labels.
    pub(crate) alone: bool,
    labels: Option<PathBuf>,
    pub(crate) looks: LabelLooks,
    mask: Option<(PathBuf, LabelSelection)>,
    pub(crate) overlays: Vec<OverlaySpec>,
}

impl LayersJob {
    pub(crate) fn new(args: &LayerArgs, alone: bool) -> Result<Self, Failure> {
        let LayerArgs { labels, label_table, label, mask, overlay } = args;
        if alone && labels.is_some() {
            let message = "--labels: the volume is one of labels itself, by --transfer labels; leave out either";
            return refuse(message);
        }
        let looks = LabelLooks::new(label_table.as_deref(), label)?;
        let mask = mask.as_deref().map(masked).transpose()?;
        let overlays = overlay.iter().map(|text| OverlaySpec::new(text)).collect::<Result<_, Error>>()?;
        Ok(Self { alone, labels: labels.clone(), looks, mask, overlays })
    }

    /// Returns whether only the values of the volume are drawn.
    pub(crate) fn is_plain(&self) -> bool {
        !self.has_labels() && self.mask.is_none() && self.overlays.is_empty()
    }

    /// Returns whether labels are drawn.
    pub(crate) fn has_labels(&self) -> bool {
        self.alone || self.labels.is_some()
    }

    /// Returns the layer of a volume of labels.
    pub(crate) fn of_labels(&self, volume: &Volume) -> Result<Layer, Failure> {
        Ok(self.looks.layer(volume, if self.alone { "transfer" } else { "labels" })?)
    }

    /// Returns layers with the mask and the labels of the job. `read` reads volumes of labels onto the lattice of the
    /// layers.
    pub(crate) fn over(
        &self,
        base: Vec<Layer>,
        mut read: impl FnMut(&'static str, &Path) -> Result<Vec<Volume>, Failure>,
    ) -> Result<Layers, Failure> {
        let masks = self.mask.as_ref().map(|(path, _)| read("mask", path)).transpose()?;
        let mask = match (&self.mask, masks.as_deref()) {
            (Some((_, which)), Some([mask])) => Some((mask, which)),
            (Some((path, _)), Some(masks)) => {
                let (path, count) = (path.display(), masks.len());
                let message = format!("--mask: {path} has {count} layers of labels, expected one");
                return refuse(message);
            }
            _ => None,
        };
        let labels = self.labels.as_ref().map(|path| read("labels", path)).transpose()?;
        Ok(self.looks.over(base, mask, &labels.unwrap_or_default())?)
    }
}

/// Splits `FILE` or `FILE:LABELS` into the file, and the rest from the colon on.
pub(crate) fn parted(text: &Path) -> (PathBuf, &str) {
    let parts = text.to_str().and_then(|text| Some((text, text.rfind(':')?)));
    match parts.map(|(text, at)| (&text[..at], &text[at..], text[at + 1..].parse())) {
        Some((file, labels, Ok(LabelSelection::All | LabelSelection::Numbers(_)))) => (PathBuf::from(file), labels),
        // A path with a colon in it, such as C:\mask.nrrd, means itself.
        _ => (text.to_owned(), ""),
    }
}

/// Returns the file of a mask and its labels: all but 0 if none are given.
fn masked(text: &Path) -> Result<(PathBuf, LabelSelection), Failure> {
    let (file, labels) = parted(text);
    Ok((file, labels.strip_prefix(':').map_or(Ok(LabelSelection::All), str::parse)?))
}

/// Reads the volumes of labels of a file, mostly one. NaN is label 0.
pub(crate) fn read(path: &Path) -> Result<Vec<Volume>, Failure> {
    let options = LoadOptions { replace_nan: Some(0.0), ..LoadOptions::default() };
    // Options of bare samples are for the volume.
    let bare = |hint| matches!(hint, Hint::GiveDims | Hint::GiveSampleType | Hint::GiveDimsAndSampleType);
    let of = |channel: Option<u32>| {
        formats::load(path, &LoadOptions { channel, ..options }).map_err(|error| match error.hint().is_some_and(bare) {
            true => Failure::failed(error.to_string()),
            false => error.into(),
        })
    };
    with_others(of(Some(0))?, of)
}

/// Returns all volumes of labels of a file, beginning with the first. `of` reads a channel.
pub(crate) fn with_others(
    first: Volume,
    of: impl Fn(Option<u32>) -> Result<Volume, Failure>,
) -> Result<Vec<Volume>, Failure> {
    let channels = first.contents().channels;
    if channels > 1 && first.contents().segments.is_none() {
        // Its error lists the channels.
        return Ok(vec![of(None)?]);
    }
    std::iter::once(Ok(first)).chain((1..channels).map(|n| of(Some(n)))).collect()
}

/// Returns the volumes of labels of an option on the lattice of another volume, and a note on it.
pub(crate) fn placed(
    option: &'static str,
    path: &Path,
    volumes: Vec<Volume>,
    of: &Volume,
) -> Result<(Vec<Volume>, Option<String>), Failure> {
    let mut note = None;
    let mut on = |volume: Volume| {
        let (placed, fit) = on_lattice(&volume, of).map_err(|error| match error {
            Error::Setting { reason, .. } => {
                Error::Setting { name: option, reason: format!("{}: {reason}", path.display()) }
            }
            other => other,
        })?;
        note = note_on_fit(option, path, fit, volume.grid().dims()).or(note.take());
        Ok(placed)
    };
    let placed = volumes.into_iter().map(&mut on).collect::<Result<Vec<Volume>, Failure>>()?;
    Ok((placed, note))
}

/// Writes the numbers of voxels of a lattice in words.
fn by(dims: [u32; 3]) -> String {
    dims.map(|d| d.to_string()).join(" x ")
}

/// Returns the note on the way in which a file was put onto the lattice of the picture, if it has another lattice.
fn note_on_fit(option: &str, path: &Path, fit: Fit, dims: [u32; 3]) -> Option<String> {
    let another = |how: &str, outside: f64, voxels: &str| {
        let out = if outside == 0.0 { "none".to_owned() } else { percent(outside) };
        let by = by(dims);
        format!(
            "using {how} because the lattice is another one ({by}); {out} of its {voxels} voxels lie outside of the \
             volume"
        )
    };
    let text = match fit {
        Fit::Same => return None,
        Fit::Unplaced => "using voxels of equal numbers because the files state no common space".to_owned(),
        Fit::Nearest { outside } => another("the nearest label of each voxel", outside, "labelled"),
        Fit::Interpolated { outside } => another("interpolated values", outside, "visible"),
    };
    Some(format!("note: --{option} {}: {text}", path.display()))
}

/// Loads the overlays of a job over a volume, in colours that its channels do not use.
pub(crate) fn overlays(specs: &[OverlaySpec], base: &Volume, channels: usize) -> Result<Option<Overlays>, Failure> {
    if specs.is_empty() {
        return Ok(None);
    }
    let mut used = UsedColors::new(channels, specs.len());
    let mut own = Vec::new();
    for spec in specs {
        own.push(Overlay::new(spec, spec.load()?, &mut used)?);
    }
    Ok(Some(Overlays::new(base, own)?))
}

/// Returns the notes on overlays over a volume.
pub(crate) fn notes_on(overlays: &Overlays, base: &Volume) -> Vec<String> {
    let dims = overlays.lattice.grid.dims();
    let mut notes: Vec<String> = Vec::new();
    for PlacedOverlay { look, dims: own, fit, .. } in &overlays.all {
        if let Some(reason) = &look.reason {
            notes
                .push(format!("note: using --overlay {look} because {reason} (other: --overlay FILE:TRANSFER@LO..HI)"));
        }
        notes.extend(note_on_fit("overlay", &look.file, *fit, *own));
    }
    if overlays.lattice.grid != *base.grid() {
        notes.push(format!(
            "note: using a lattice of {} with the voxels of the finest overlay; the values of the volume are \
             interpolated",
            by(dims)
        ));
    }
    if let Some(samples) = overlays.refused {
        notes.push(format!(
            "note: using the lattice of the volume because the one of the finest overlay would have {} million voxels; \
             the overlay is averaged",
            (samples / 1e6).round()
        ));
    }
    notes
}

/// A label of a volume in the list of `info`.
#[derive(serde::Serialize)]
pub(crate) struct Listed {
    #[serde(flatten)]
    count: LabelCount,
    name: String,
    color: String,
    opacity: f64,
    /// The volume of the label in cubic world units.
    volume: f64,
}

/// Lists the labels of volumes on one lattice. The voxels without a label are counted in the first volume.
pub(crate) fn list(volumes: &[Volume], looks: &LabelLooks) -> Result<Vec<Listed>, Failure> {
    let mut all = Vec::new();
    for (n, volume) in volumes.iter().enumerate() {
        let cell = volume.grid().to_world().matrix3.determinant().abs();
        let looks = looks.of(volume)?;
        let listed = |count: LabelCount| {
            let Label { name, color, opacity } = looks.label(count.label);
            let [r, g, b] = color.map(|channel| (255.0 * channel).round() as u8);
            let volume = count.voxels as f64 * cell;
            Listed { count, name, color: format!("#{r:02x}{g:02x}{b:02x}"), opacity, volume }
        };
        all.extend(count_labels(volume)?.into_iter().filter(|count| n == 0 || count.label != 0).map(listed));
    }
    Ok(all)
}

/// The units of length in metres, with the least volume that is written in cubes of each.
const LENGTHS: [(&str, f64, f64); 5] =
    [("nm", 1e-9, 0.0), ("µm", 1e-6, 1e-3), ("mm", 1e-3, 1e-3), ("cm", 1e-2, 1.0), ("m", 1.0, 1.0)];

/// Returns a volume in cubes of the largest unit of length that gives a number near 1 or above it, or in cubes of the
/// file's unit if that is no known unit of length.
fn in_cubes(volume: f64, unit: Option<&str>) -> String {
    let name = match unit {
        Some("um" | "μm" | "micron" | "microns" | "micrometer") => Some("µm"),
        unit => unit,
    };
    let digits = |value: f64| match value.abs() {
        size if (1e-3..1e9).contains(&size) => {
            let places = (3.0 - libm::log10(size).floor()).max(0.0) as usize;
            readable(format!("{value:.places$}").parse().unwrap_or(value))
        }
        _ => readable(value),
    };
    let Some((_, metres, _)) = LENGTHS.iter().find(|(length, ..)| Some(*length) == name) else {
        return readable(volume) + &unit.map(|unit| format!(" {unit}^3")).unwrap_or_default();
    };
    let cubes = |(name, length, least): &(&str, f64, f64)| {
        let value = volume * (metres / length).powi(3);
        (value >= *least).then(|| format!("{} {name}^3", digits(value)))
    };
    LENGTHS.iter().rev().find_map(cubes).unwrap_or_default()
}

/// Prints a list of labels.
pub(crate) fn print(listed: &[Listed], unit: Option<&str>) -> Result<(), Failure> {
    let header = format!("{:>12}  {:<7} {:>7} {:>12} {:>16}  name\n", "label", "colour", "opacity", "voxels", "volume");
    let line = |listed: &Listed| {
        let Listed { count: LabelCount { label, voxels, .. }, name, color, opacity, volume } = listed;
        let volume = in_cubes(*volume, unit);
        format!("{label:>12}  {color:<7} {opacity:>7} {voxels:>12} {volume:>16}  {name}").trim_end().to_owned() + "\n"
    };
    output::print(&(header + &listed.iter().map(line).collect::<String>()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volumes_have_units_that_fit() {
        for (volume, unit, text) in [
            (4.9161e6, Some("mm"), "4916 cm^3"),
            (4.9161e9, Some("mm"), "4.916 m^3"),
            (12.0, Some("mm"), "12 mm^3"),
            (0.05, Some("mm"), "0.05 mm^3"),
            (5e7, Some("um"), "0.05 mm^3"),
            (1.5e-7, Some("mm"), "150 µm^3"),
            (1e-6, Some("m"), "1 cm^3"),
            (7.5, Some("px"), "7.5 px^3"),
            (5.0, None, "5"),
        ] {
            assert_eq!(in_cubes(volume, unit), text);
        }
    }

    #[test]
    fn masks_have_labels_behind_their_file() {
        let of = |text: &str| masked(Path::new(text)).unwrap();
        assert_eq!(of("m.nrrd"), (PathBuf::from("m.nrrd"), LabelSelection::All));
        assert_eq!(of("C:/m.nrrd"), (PathBuf::from("C:/m.nrrd"), LabelSelection::All));
        assert_eq!(of("C:/m.nrrd:2,5-6"), (PathBuf::from("C:/m.nrrd"), LabelSelection::Numbers(vec![[2, 2], [5, 6]])));
    }
}
