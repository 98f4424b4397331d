//! Zarr 2 and 3, and OME-Zarr up to 0.6: a folder of chunks, or an archive of one (<https://zarr-specs.readthedocs.io>).
//!
//! An image of OME is a pyramid: the same volume at several resolutions. The coarsest that is fine enough is read,
//! chunk by chunk; of shards, which are files of many chunks, only the chunks that are needed.
//!
//! The crate `zarrs` is not used: it adds 133 packages. Zarr needs little: JSON, and codecs, which are crates
//! except for Blosc's container.

mod blosc;
mod codecs;
mod content;
mod image;
mod level;
mod metadata;
mod store;

use std::path::{Component, Path, PathBuf};

use serde_json::Value;

use self::image::{axes_of_image, chosen_level, first_of, labels, levels, pyramid, segments};
use self::level::Level;
use self::metadata::{Array, ZarrNode};
#[cfg(feature = "remote")]
use self::store::MAX_METADATA;
use self::store::Store;
use super::LoadOptions;
use super::coordinates::Axis;
#[cfg(feature = "remote")]
use super::folder::{METADATA, zarr_folder_of};
use super::input::Input;
#[cfg(feature = "remote")]
use super::origin::FileOrigin;
use super::placement::{named_unit, plain_name};
use super::selection::{Role, guessed, sized};
use super::zip::Archive;
use crate::error::{Error, Hint, Result, Subject, refuse};
#[cfg(feature = "remote")]
use crate::files::remote::RemoteFile;
use crate::volume::{Contents, MAX_DIM, ToF64, Units, Volume, with_samples};

/// The largest number of folders of a group that are searched for arrays.
const MAX_FOLDERS: usize = 4096;

/// Reads the volume of a folder of Zarr.
pub(super) fn read(folder: &Path, options: &LoadOptions) -> Result<Volume> {
    read_from(&Store::of_folder(folder), folder, options)
}

/// Returns the folder of Zarr that a url is, or is a file of metadata of.
///
/// # Errors
/// [`Error::Read`] if the server cannot be asked.
#[cfg(feature = "remote")]
pub(super) fn folder_at(url: &Path) -> Result<Option<&Path>> {
    if let Some(folder) = zarr_folder_of(url) {
        return Ok(Some(folder));
    }
    for name in METADATA {
        if Store::of_folder(url).open(&url.join(name), MAX_METADATA)?.is_some() {
            return Ok(Some(url));
        }
    }
    Ok(None)
}

/// Reads the volume of an archive at a url, or of a folder in it, without fetching all of it.
#[cfg(feature = "remote")]
pub(super) fn read_archive_at(url: &Path, inside: Option<&str>, options: &LoadOptions) -> Result<Volume> {
    let file = RemoteFile::new(url).map_err(Error::read(url))?;
    read_members(url, Archive::at(url.to_owned(), FileOrigin::Url(file.into()))?, inside, options)
}

/// Reads the volume of an archive, or of a folder in it.
pub(super) fn read_archive(input: &Input, inside: Option<&str>, options: &LoadOptions) -> Result<Volume> {
    read_members(input.path(), Archive::open(input)?, inside, options)
}

fn read_members(path: &Path, archive: Archive, inside: Option<&str>, options: &LoadOptions) -> Result<Volume> {
    let (store, tops) = Store::archive(path, archive)?;
    let folder = match (inside, &tops[..]) {
        (None, [top]) => top.clone(),
        (None, []) => refuse!(path, "is a ZIP file without a Zarr: unpack it"),
        (None, several) => {
            let names: Vec<String> = several.iter().take(12).filter_map(|folder| name_of(folder)).collect();
            let reason = format!("is a ZIP file with several folders of Zarr: {}", names.join(", "));
            return Err(path.error(reason).hinted(Hint::ChooseDataset));
        }
        (Some(inside), _) => {
            let name = Path::new(inside.trim_matches('/'));
            let is_inside = name.components().all(|part| matches!(part, Component::Normal(_)));
            let all = std::iter::once(path).chain(tops.iter().map(PathBuf::as_path));
            let found = all.map(|top| top.join(name)).find(|folder| is_inside && store.is_zarr(folder));
            found.ok_or_else(|| path.error(format!("has no array or group of Zarr named {inside:?}")))?
        }
    };
    read_from(&store, &folder, options)
}

fn read_from(store: &Store, folder: &Path, options: &LoadOptions) -> Result<Volume> {
    let mut node = ZarrNode::read(store, folder)?;
    // Bio-Formats puts images in folders with numbers.
    if node.array.is_none() && pyramid(&node.attributes).is_none() && first_of(&node, "bioformats2raw.layout").is_some()
    {
        let series = options.series.unwrap_or(1);
        let Some(index) = series.checked_sub(1).filter(|n| store.is_zarr(&folder.join(n.to_string()))) else {
            return Err(Error::setting("series", format!("{series}, but {} has no such image", folder.display())));
        };
        node = ZarrNode::read(store, &folder.join(index.to_string()))?;
    }
    if node.array.is_none() && pyramid(&node.attributes).is_none() {
        node = only_array(store, &node)?;
    }
    if let Some(array) = node.array {
        return of_array(store, node.folder, array, &node.attributes, options);
    }
    let Some(image) = pyramid(&node.attributes) else { return Err(no_image(store, &node)) };
    let mut axes = axes_of_image(&node.folder, image)?;
    let levels = levels(store, &node.folder, image, axes.len())?;
    let index = chosen_level(&node.folder, &levels, &axes, options.level)?;
    let (labels, segments) = (labels(&node), segments(&node));
    let contents =
        Contents { labels, segments, level: index as u32, levels: levels.len() as u32, ..Contents::default() };
    let Some(level) = levels.into_iter().nth(index) else { return Err(no_image(store, &node)) };
    level.place(&mut axes);
    level.read(store, &axes, contents, options)
}

/// Reads the volume of an array alone, with the names and coordinates that xarray writes beside it, and the scale and
/// the unit of its values.
fn of_array(store: &Store, folder: PathBuf, array: Array, attributes: &Value, options: &LoadOptions) -> Result<Volume> {
    let axes = axes_of_array(store, &folder, &array)?;
    let level = Level::alone(folder, array);
    let volume = level.read(store, &axes, Contents::default(), options)?;
    let units = Units { value: attributes["units"].as_str().and_then(named_unit), ..volume.units().clone() };
    let number = |name: &str| attributes[name].as_f64();
    let (slope, intercept) = (number("scale_factor").unwrap_or(1.0), number("add_offset").unwrap_or(0.0));
    volume.with_units(units).with_rescale(slope, intercept).map_err(|error| level.folder.error(error.to_string()))
}

/// Returns the only array of a group that is a volume, or else a plane, such as the variable of a data set of xarray.
fn only_array(store: &Store, group: &ZarrNode) -> Result<ZarrNode> {
    let folders = store.folders(&group.folder).into_iter().take(MAX_FOLDERS);
    let mut arrays: Vec<ZarrNode> = folders.filter_map(|folder| ZarrNode::read(store, &folder).ok()).collect();
    let shape = |node: &ZarrNode| node.array.as_ref().map(|array| array.shape.clone()).unwrap_or_default();
    let axes = |node: &ZarrNode| shape(node).into_iter().filter(|size| *size > 1).count();
    let least = if arrays.iter().any(|node| axes(node) >= 3) { 3 } else { 2 };
    arrays.retain(|node| axes(node) >= least);
    if arrays.len() > 1 {
        let line = |node: &ZarrNode| {
            let sizes: Vec<String> = shape(node).iter().map(u64::to_string).collect();
            format!("{} of {}", name_of(&node.folder).unwrap_or_default(), sizes.join(" x "))
        };
        let listed: Vec<String> = arrays.iter().take(12).map(line).collect();
        let (count, way_out) = (arrays.len(), "give the folder of one");
        refuse!(group.folder, "is a group without an image, but with {count} arrays, {}: {way_out}", listed.join(", "));
    }
    arrays.pop().ok_or_else(|| no_image(store, group))
}

/// Returns the name of a folder, for messages.
fn name_of(folder: &Path) -> Option<String> {
    plain_name(&folder.file_name()?.to_string_lossy())
}

/// Returns the error about a group that is no image.
fn no_image(store: &Store, node: &ZarrNode) -> Error {
    if first_of(node, "plate").is_some() {
        let reason = "is a plate with many images: give the folder of one, such as PLATE/A/1/0";
        return Error::format(&node.folder, reason);
    }
    let folders = store.folders(&node.folder);
    let names: Vec<String> = folders.iter().take(20).filter_map(|folder| name_of(folder)).collect();
    let found = match names.is_empty() {
        true => String::new(),
        false => format!(": give one of the folders in it: {}", names.join(", ")),
    };
    node.folder.error(format!("is a group of Zarr without an image{found}"))
}

/// Returns the axes of an array by their names, and by the arrays of coordinates that have these names and lie beside
/// it; without names, roles are guessed.
fn axes_of_array(store: &Store, folder: &Path, array: &Array) -> Result<Vec<Axis>> {
    if array.names.len() == array.shape.len() && array.names.iter().any(|name| !name.is_empty()) {
        let named = |(name, &size): (&String, &u64)| {
            let is_name = Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
            let beside =
                folder.parent().filter(|_| is_name && size <= u64::from(MAX_DIM)).map(|parent| parent.join(name));
            let node = beside.and_then(|beside| ZarrNode::read(store, &beside).ok());
            let node = node.filter(|node| node.array.as_ref().is_some_and(|array| array.shape == [size]));
            let (attributes, level) = node.map_or((Value::Null, None), |node| {
                (node.attributes, node.array.map(|array| Level::alone(node.folder, array)))
            });
            Axis::described(name, size, &|key| attributes[key].as_str().map(str::to_owned), || {
                let values = level?.stored(store, std::slice::from_ref(&(0..size)), &[1], &|_, _| true).ok()?;
                Some(with_samples!(&values, v => v.iter().map(|value| value.to_f64()).collect()))
            })
        };
        return Ok(array.names.iter().zip(&array.shape).map(named).collect());
    }
    let sizes: Vec<i64> = array.shape.iter().rev().map(|&n| sized(n)).collect();
    let roles = guessed(&sizes);
    if roles.iter().filter(|(role, _)| *role == Role::Space).count() > 3 {
        refuse!(folder, "has {} axes without names, expected at most 5", array.shape.len());
    }
    let mut axes: Vec<Axis> = array.shape.iter().map(|size| Axis::named("", *size)).collect();
    axes.iter_mut().rev().zip(roles).for_each(|(axis, (role, _))| axis.role = role);
    Ok(axes)
}
