//! Transfer functions and colour maps from the files of other programs, told apart by content.

mod curve;
mod niivue;
mod paraview;
mod slicer;
mod space;

use std::path::Path;

use serde_json::Value;

use super::lines::merged;
use super::maps::ColorMap;

use super::{GradientPoint, TransferFunction, Window};
use voxsplat_volume::files;

use crate::error::{Error, Result};
use crate::volume::Grid;

/// The largest file that is read, in bytes.
const MAX_BYTES: u64 = 4 << 20;

/// A transfer function from a file, before it meets a volume.
///
/// Read are the JSON of this library, ParaView's JSON and XML, Slicer's `.vp`, `.vp.json` and presets.xml, and the
/// colour maps of niivue and napari as JSON. Colour spaces, midpoints and sharpness become points, off by at most a
/// quarter of an 8-bit step.
///
/// ```no_run
/// use voxsplat::transfer::{Imported, Window};
/// use voxsplat::volume::Statistics;
///
/// let volume = voxsplat::load("ct.nrrd", &Default::default())?;
/// let imported = Imported::load("presets.xml#CT-Bone")?;
/// let window = if imported.fits { Window::of(&Statistics::of(&volume)?) } else { None };
/// let transfer = imported.placed(volume.grid(), window.as_ref())?;
/// # Ok::<(), voxsplat::error::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Imported {
    /// The function. If it fits itself to data, its values are places in a window, 0 to 1.
    pub transfer: TransferFunction,
    /// Whether the file states no values of data: a colour map.
    pub fits: bool,
    /// Whether its opacities are for slabs as thick as the mean spacing, as the file states no thickness.
    pub mean_spacing: bool,
    /// Whether the magnitudes of its gradient opacity are differences over a mean spacing, as VTK's are.
    pub gradient_of_spacing: bool,
    /// Ambient, diffuse and specular share and shininess of light from the eye, if the file asks for it.
    pub material: Option<[f64; 4]>,
    /// What the file holds and the function does not, a sentence each.
    pub notes: Vec<String>,
}

impl Imported {
    /// Reads a file. Behind a `#` the path may name one of several functions in it.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the file cannot be read; [`Error::Input`](crate::Error::Input) if it is
    /// of another format or malformed, takes over 4 MiB, or holds several functions and the path names none of them.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        Self::with_file(path.as_ref(), Self::parse)
    }

    /// Reads the text of a file, and of several functions in it the one of a name.
    ///
    /// # Errors
    /// [`Error::Transfer`] as [`Self::load`].
    pub fn parse(text: &str, name: Option<&str>) -> Result<Self> {
        match Content::of(text)? {
            Content::Own => unnamed(name).and_then(|()| {
                let transfer = TransferFunction::from_json(text)?;
                Ok(Self {
                    transfer,
                    fits: false,
                    mean_spacing: false,
                    gradient_of_spacing: false,
                    material: None,
                    notes: Vec::new(),
                })
            }),
            content => found(content, name)?.imported(),
        }
    }

    /// A colour map with its gentle ramp of opacity, to be fitted to data.
    ///
    /// # Errors
    /// Those of [`ColorMap::transfer`].
    pub fn of_map(map: &ColorMap) -> Result<Self> {
        let transfer = map.transfer()?;
        Ok(Self {
            transfer,
            fits: true,
            mean_spacing: false,
            gradient_of_spacing: false,
            material: None,
            notes: Vec::new(),
        })
    }

    /// The function at the values of data: stretched over a window, if one is given.
    ///
    /// # Errors
    /// [`Error::Setting`] if a colour map has no window; those of [`TransferFunction::stretched`].
    pub fn placed(&self, grid: &Grid, window: Option<&Window>) -> Result<TransferFunction> {
        let transfer = match window {
            Some(window) => self.transfer.stretched(window)?,
            None if self.fits => {
                let reason = "a colour map needs one where all values of a volume are the same".to_owned();
                return Err(Error::Setting { name: "window", reason });
            }
            None => self.transfer.clone(),
        };
        let spacing = grid.mean_spacing();
        let transfer =
            if self.gradient_of_spacing { transfer.with_steeper_gradients(1.0 / spacing)? } else { transfer };
        if self.mean_spacing { transfer.with_unit_distance(spacing) } else { Ok(transfer) }
    }

    /// What `read` makes of the text of a file and of the name behind it.
    fn with_file<T>(path: &Path, read: impl FnOnce(&str, Option<&str>) -> Result<T>) -> Result<T> {
        let whole = path.to_str().filter(|_| !path.exists()).and_then(|text| text.rsplit_once('#'));
        let (path, name) = whole.map_or((path, None), |(file, name)| (Path::new(file), Some(name)));
        let text = files::read_text(path, MAX_BYTES)?;
        read(&text, name).map_err(|e| match e {
            Error::Transfer(reason) => Error::format(path, reason),
            other => other,
        })
    }
}

impl ColorMap {
    /// The colours of a file that [`Imported::load`] reads, without its values and opacities.
    ///
    /// # Errors
    /// Those of [`Imported::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        Imported::with_file(path.as_ref(), |text, name| {
            let colors = match Content::of(text)? {
                Content::Own => {
                    unnamed(name)?;
                    TransferFunction::from_json(text)?.points().iter().map(|p| (p.value, p.color)).collect()
                }
                content => found(content, name)?
                    .colors
                    .ok_or_else(|| Error::Transfer("it has opacities and no colours".to_owned()))?,
            };
            Self::new(colors)
        })
    }
}

/// What kind of file a text is.
enum Content<'a> {
    Own,
    ParaView(Value),
    Slicer(Value),
    Niivue(Value),
    Napari(Value),
    Xml(roxmltree::Document<'a>),
    /// Slicer's lines of numbers.
    Lines(&'a str),
}

impl<'a> Content<'a> {
    fn of(text: &'a str) -> Result<Self> {
        let text = text.trim_start_matches('\u{feff}').trim_start();
        if text.starts_with('<') {
            let document = roxmltree::Document::parse(text);
            return document.map(Self::Xml).map_err(|e| Error::Transfer(format!("malformed XML: {e}")));
        }
        if !text.starts_with(['{', '[']) {
            let numbers = text.lines().next().is_some_and(|line| line.trim().parse::<f64>().is_ok());
            let first = text.lines().next().unwrap_or_default();
            let reason = || format!("line 1: {first:?}, expected JSON, XML or a line with a number");
            return if numbers { Ok(Self::Lines(text)) } else { Err(Error::Transfer(reason())) };
        }
        // What is no JSON at all is refused with its line by the reader of the library's own files.
        let Ok(value) = serde_json::from_str::<Value>(text) else { return Ok(Self::Own) };
        let has = |keys: &[&str]| keys.iter().any(|key| value.get(key).is_some());
        Ok(if value.is_array() || has(&["RGBPoints", "Points", "IndexedColors"]) {
            Self::ParaView(value)
        } else if has(&["volumeProperties"]) {
            Self::Slicer(value)
        } else if has(&["R"]) && has(&["G"]) && has(&["B"]) {
            Self::Niivue(value)
        } else if has(&["colors"]) {
            Self::Napari(value)
        } else {
            Self::Own
        })
    }
}

/// What a file of another program says.
fn found(content: Content<'_>, name: Option<&str>) -> Result<Found> {
    match content {
        Content::ParaView(value) => paraview::json(&value, name),
        Content::Slicer(value) => slicer::json(&value, name),
        Content::Niivue(value) => unnamed(name).and_then(|()| niivue::niivue(&value)),
        Content::Napari(value) => unnamed(name).and_then(|()| niivue::napari(&value)),
        Content::Lines(text) => unnamed(name).and_then(|()| slicer::lines(text)),
        Content::Xml(document) if document.descendants().any(|node| node.has_tag_name("VolumeProperty")) => {
            slicer::presets(&document, name)
        }
        Content::Xml(document) => paraview::xml(&document, name),
        Content::Own => Err(fault("is no file of another program")),
    }
}

/// Refuses a name for a file of one function.
fn unnamed(name: Option<&str>) -> Result<()> {
    name.map_or(Ok(()), |name| Err(fault(format!("it holds one function, and none called {name:?}"))))
}

/// The error of a file that is not as expected.
fn fault(reason: impl Into<String>) -> Error {
    Error::Transfer(reason.into())
}

/// Colours and opacities as a file states them.
#[derive(Debug, Default)]
struct Found {
    colors: Option<Vec<(f64, [f64; 3])>>,
    opacities: Option<Vec<(f64, [f64; 1])>>,
    /// Whether values are those of data; otherwise they are places in a window.
    placed: bool,
    unit_distance: Option<f64>,
    /// Magnitudes are differences over a mean spacing, as VTK's are.
    gradient: Vec<GradientPoint>,
    material: Option<[f64; 4]>,
    notes: Vec<String>,
}

impl Found {
    fn imported(self) -> Result<Imported> {
        let Self { colors, opacities, placed, unit_distance, gradient, material, mut notes } = self;
        let (transfer, fits, mean_spacing) = match (colors, opacities) {
            (Some(colors), Some(opacities)) => {
                let transfer = TransferFunction::new(merged(&colors, &opacities), unit_distance)?;
                (transfer, !placed, unit_distance.is_none())
            }
            (Some(colors), None) => {
                notes.push("it has no opacities and takes a gentle ramp".to_owned());
                (ColorMap::new(colors)?.transfer()?, true, false)
            }
            (None, Some(opacities)) => {
                notes.push("it has no colours and takes white".to_owned());
                let white = [(opacities[0].0, [1.0; 3])];
                let transfer = TransferFunction::new(merged(&white, &opacities), unit_distance)?;
                (transfer, !placed, unit_distance.is_none())
            }
            (None, None) => return Err(Error::Transfer("it has neither colours nor opacities".to_owned())),
        };
        let gradient_of_spacing = !gradient.is_empty();
        let transfer = transfer.with_gradient_opacity(gradient)?;
        Ok(Imported { transfer, fits, mean_spacing, gradient_of_spacing, material, notes })
    }
}

/// One of several things with names: the one asked for, or the only one.
fn chosen<T>(mut named: Vec<(String, T)>, asked: Option<&str>) -> Result<T> {
    let place = match (asked, named.len()) {
        (_, 0) => return Err(fault("it holds no transfer function")),
        (None, 1) => Some(0),
        (None, _) => None,
        (Some(asked), _) => named.iter().position(|(name, _)| name == asked),
    };
    match place {
        Some(place) => Ok(named.swap_remove(place).1),
        None => {
            let names: Vec<&str> = named.iter().map(|(name, _)| name.as_str()).collect();
            let asked =
                asked.map_or_else(|| "choose one by FILE#NAME".to_owned(), |asked| format!("none is {asked:?}"));
            Err(fault(format!("it holds {} functions, {asked}: {}", names.len(), names.join(", "))))
        }
    }
}

/// A finite number of a JSON value.
fn number(value: &Value) -> Result<f64> {
    value.as_f64().filter(|n| n.is_finite()).ok_or_else(|| fault(format!("{value}, expected a number")))
}

/// The numbers of a JSON array, at least one.
fn numbers(value: &Value) -> Result<Vec<f64>> {
    match value.as_array() {
        Some(array) if !array.is_empty() => array.iter().map(number).collect(),
        _ => Err(fault("a list of numbers is missing or empty")),
    }
}

/// Numbers in groups of `N`, at least one.
fn groups<const N: usize>(numbers: &[f64], what: &str) -> Result<Vec<[f64; N]>> {
    let (groups, rest) = numbers.as_chunks::<N>();
    if groups.is_empty() || !rest.is_empty() {
        return Err(fault(format!("{what}: {} numbers, expected {N} for each point", numbers.len())));
    }
    Ok(groups.to_vec())
}

/// Whether opacities say nothing: all are 1.
fn opaque(opacities: &[(f64, [f64; 1])]) -> bool {
    opacities.iter().all(|(_, [opacity])| *opacity >= 1.0)
}
