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
use crate::error::{Error, Result};
use crate::volume::Grid;
use voxsplat_volume::files;

/// The largest file that is read, in bytes.
const MAX_BYTES: u64 = 4 << 20;

/// A transfer function from a file, before it is applied to a volume.
///
/// Reads the JSON of this library, ParaView's JSON and XML, Slicer's `.vp`, `.vp.json` and presets.xml, and the colour
/// maps of niivue and napari as JSON. Colour spaces, midpoints and sharpness become points, off by at most a quarter of
/// an 8-bit step.
///
/// ```no_run
/// use voxsplat::transfer::{Imported, Window};
/// use voxsplat::volume::Statistics;
///
/// let volume = voxsplat::load("ct.nrrd", &Default::default())?;
/// let imported = Imported::load("presets.xml#CT-Bone")?;
/// let window = if imported.fits { Window::of_foreground(&Statistics::of(&volume)?) } else { None };
/// let transfer = imported.placed(volume.grid(), window.as_ref())?;
/// # Ok::<(), voxsplat::error::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Imported {
    /// The transfer function. If it fits itself to data, its values are places in a window, 0 to 1.
    pub transfer: TransferFunction,
    /// Whether the function fits itself to data, because the file states no values: a colour map.
    pub fits: bool,
    /// Whether the function's opacities are for slabs as thick as the mean spacing, because the file states no
    /// thickness.
    pub mean_spacing: bool,
    /// Whether the magnitudes of the function's gradient opacity are differences over a mean spacing, as in VTK.
    pub gradient_of_spacing: bool,
    /// Ambient, diffuse and specular share and shininess of light from the eye, if the file requests light.
    pub material: Option<[f64; 4]>,
    /// Properties of the file that the function does not have, a sentence each.
    pub notes: Vec<String>,
}

impl Imported {
    /// Reads a file. Behind a `#` the path may name one of several functions in the file.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the file cannot be read, is of another format or malformed, takes over
    /// 4 MiB, or holds several functions and the path names none of them.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        with_file(path.as_ref(), Self::parse)
    }

    /// Reads the text of a file; `name` chooses one of several functions in it.
    ///
    /// # Errors
    /// [`Error::Transfer`] as [`Self::load`].
    pub fn parse(text: &str, name: Option<&str>) -> Result<Self> {
        match FileContent::read(text, name)? {
            FileContent::Own(transfer) => Ok(Self::plain(transfer, false)),
            FileContent::Foreign(found) => found.imported(),
        }
    }

    /// Returns a colour map with its gentle ramp of opacity, to be fitted to data.
    ///
    /// # Errors
    /// The errors of [`ColorMap::transfer`].
    pub fn of_map(map: &ColorMap) -> Result<Self> {
        Ok(Self::plain(map.transfer()?, true))
    }

    fn plain(transfer: TransferFunction, fits: bool) -> Self {
        let (mean_spacing, gradient_of_spacing, material, notes) = (false, false, None, Vec::new());
        Self { transfer, fits, mean_spacing, gradient_of_spacing, material, notes }
    }

    /// Returns the function at the values of data, stretched over a window if one is given.
    ///
    /// # Errors
    /// [`Error::Setting`] if a colour map has no window; the errors of [`TransferFunction::stretched`].
    pub fn placed(&self, grid: &Grid, window: Option<&Window>) -> Result<TransferFunction> {
        let mut transfer = match window {
            Some(window) => self.transfer.stretched(window)?,
            None if self.fits => {
                let reason = "a colour map needs one where all values of a volume are the same";
                return Err(Error::setting("window", reason));
            }
            None => self.transfer.clone(),
        };
        let spacing = grid.mean_spacing();
        if self.gradient_of_spacing {
            transfer = transfer.with_steeper_gradients(1.0 / spacing)?;
        }
        if self.mean_spacing { transfer.with_unit_distance(spacing) } else { Ok(transfer) }
    }
}

impl ColorMap {
    /// Loads the colours of a file that [`Imported::load`] reads, without its values and opacities.
    ///
    /// # Errors
    /// The errors of [`Imported::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        with_file(path.as_ref(), |text, name| {
            let colors = match FileContent::read(text, name)? {
                FileContent::Own(transfer) => transfer.points().iter().map(|p| (p.value, p.color)).collect(),
                FileContent::Foreign(found) => found.colors.ok_or_else(|| fault("it has opacities and no colours"))?,
            };
            Self::new(colors)
        })
    }
}

/// Reads the text of a file with the name behind the `#` of its path.
fn with_file<T>(path: &Path, read: impl FnOnce(&str, Option<&str>) -> Result<T>) -> Result<T> {
    let whole = path.to_str().filter(|_| !path.exists()).and_then(|text| text.rsplit_once('#'));
    let (path, name) = whole.map_or((path, None), |(file, name)| (Path::new(file), Some(name)));
    read(&files::read_text(path, MAX_BYTES)?, name).map_err(|e| e.in_file(path))
}

/// The content of a file.
enum FileContent {
    /// A function in the JSON of this library.
    Own(TransferFunction),
    /// A function of another program.
    Foreign(ForeignFunction),
}

impl FileContent {
    fn read(text: &str, name: Option<&str>) -> Result<Self> {
        let trimmed = text.trim_start_matches('\u{feff}').trim_start();
        // Refuses a name for a file of one function.
        let unnamed = || match name {
            Some(name) => Err(fault(format!("it holds one function, and none called {name:?}"))),
            None => Ok(()),
        };
        let found = if trimmed.starts_with('<') {
            let document = roxmltree::Document::parse(trimmed).map_err(|e| fault(format!("malformed XML: {e}")))?;
            match document.descendants().any(|node| node.has_tag_name("VolumeProperty")) {
                true => slicer::presets(&document, name)?,
                false => paraview::xml(&document, name)?,
            }
        } else if !trimmed.starts_with(['{', '[']) {
            let first = trimmed.lines().next().unwrap_or_default();
            if first.trim().parse::<f64>().is_err() {
                return Err(fault(format!("line 1: {first:?}, expected JSON, XML or a line with a number")));
            }
            unnamed()?;
            slicer::lines(trimmed)?
        } else {
            let value = serde_json::from_str::<Value>(trimmed).unwrap_or_default();
            let has = |key: &str| value.get(key).is_some();
            if value.is_array() || ["RGBPoints", "Points", "IndexedColors"].into_iter().any(has) {
                paraview::json(&value, name)?
            } else if has("volumeProperties") {
                slicer::json(&value, name)?
            } else {
                unnamed()?;
                if ["R", "G", "B"].into_iter().all(has) {
                    niivue::niivue(&value)?
                } else if has("colors") {
                    niivue::napari(&value)?
                } else {
                    // Refuses text that is no JSON with the line of the fault.
                    return TransferFunction::from_json(text).map(Self::Own);
                }
            }
        };
        Ok(Self::Foreign(found))
    }
}

/// Returns the error of a file that is not as expected.
fn fault(reason: impl Into<String>) -> Error {
    Error::Transfer(reason.into())
}

/// Colours and opacities as a file states them.
#[derive(Debug, Default)]
struct ForeignFunction {
    colors: Option<Vec<(f64, [f64; 3])>>,
    opacities: Option<Vec<(f64, [f64; 1])>>,
    /// Whether values belong to data; otherwise they are places in a window.
    placed: bool,
    unit_distance: Option<f64>,
    /// The points of gradient opacity; magnitudes are differences over a mean spacing, as in VTK.
    gradient: Vec<GradientPoint>,
    material: Option<[f64; 4]>,
    notes: Vec<String>,
}

impl ForeignFunction {
    fn imported(self) -> Result<Imported> {
        let Self { colors, opacities, placed, unit_distance, gradient, material, mut notes } = self;
        let has_opacities = opacities.is_some();
        let transfer = match (colors, opacities) {
            (None, None) => return Err(fault("it has neither colours nor opacities")),
            (Some(colors), None) => {
                notes.push("it has no opacities and gets a gentle ramp".to_owned());
                ColorMap::new(colors)?.transfer()?
            }
            (colors, Some(opacities)) => {
                let colors = colors.unwrap_or_else(|| {
                    notes.push("it has no colours and gets white".to_owned());
                    vec![(opacities[0].0, [1.0; 3])]
                });
                TransferFunction::new(merged(&colors, &opacities), unit_distance)?
            }
        };
        Ok(Imported {
            fits: !(placed && has_opacities),
            mean_spacing: has_opacities && unit_distance.is_none(),
            gradient_of_spacing: !gradient.is_empty(),
            transfer: transfer.with_gradient_opacity(gradient)?,
            material,
            notes,
        })
    }
}

/// Returns the requested one of several named items, or the only one.
fn chosen<T>(
    items: impl IntoIterator<Item = T>,
    name: impl Fn(&T) -> Option<&str>,
    requested: Option<&str>,
) -> Result<T> {
    let mut items: Vec<T> = items.into_iter().collect();
    let names: Vec<&str> = items.iter().map(|item| name(item).unwrap_or("(no name)")).collect();
    let place = match requested {
        None => (names.len() == 1).then_some(0),
        Some(requested) => names.iter().position(|name| *name == requested),
    };
    match place {
        Some(place) => Ok(items.swap_remove(place)),
        None if names.is_empty() => Err(fault("it holds no transfer function")),
        None => {
            let choice = requested.map_or("choose one by FILE#NAME".to_owned(), |name| format!("none is {name:?}"));
            Err(fault(format!("it holds {} functions, {choice}: {}", names.len(), names.join(", "))))
        }
    }
}

/// Returns the list under a key of a JSON object; empty if there is none.
fn list<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    value.get(key).and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default()
}

/// Reads a finite number from a JSON value.
fn number(value: &Value) -> Result<f64> {
    value.as_f64().filter(|n| n.is_finite()).ok_or_else(|| fault(format!("{value}, expected a number")))
}

/// Reads a finite number from a text.
fn parsed(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|n: &f64| n.is_finite())
}

/// Reads the numbers of a JSON array, at least one.
fn numbers(value: &Value) -> Result<Vec<f64>> {
    match value.as_array() {
        Some(array) if !array.is_empty() => array.iter().map(number).collect(),
        _ => Err(fault("a list of numbers is missing or empty")),
    }
}

/// Splits numbers into groups of `N`, at least one group.
fn groups<const N: usize>(numbers: &[f64], what: &str) -> Result<Vec<[f64; N]>> {
    let (groups, rest) = numbers.as_chunks::<N>();
    if groups.is_empty() || !rest.is_empty() {
        return Err(fault(format!("{what}: {} numbers, expected {N} for each point", numbers.len())));
    }
    Ok(groups.to_vec())
}

/// Returns whether opacities have no effect, because all are 1.
fn opaque(opacities: &[(f64, [f64; 1])]) -> bool {
    opacities.iter().all(|(_, [opacity])| *opacity >= 1.0)
}
