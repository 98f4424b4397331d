//! Folders that are one volume, and folders that hold such folders.

use std::path::{Path, PathBuf};

use super::{Series, natural, parts_of_folder};
use crate::names::counted;

/// The files of metadata that make a folder an array or a group of Zarr.
pub(super) const METADATA: [&str; 3] = ["zarr.json", ".zarray", ".zgroup"];

/// Returns whether a folder has the metadata of Zarr: an array or a group.
#[must_use]
pub fn is_zarr(folder: &Path) -> bool {
    METADATA.iter().any(|name| folder.join(name).is_file())
}

/// Returns the folder of a file of Zarr's metadata.
pub(super) fn zarr_folder_of(file: &Path) -> Option<&Path> {
    let name = file.file_name()?.to_str()?;
    (METADATA.contains(&name) || name == ".zattrs").then(|| file.parent()).flatten()
}

/// The largest number of folders that are searched for volumes, and the largest number that a text lists.
const MOST_SEARCHED: usize = 256;
const MOST_LISTED: usize = 4;

/// Returns a sentence about the volumes in a folder and in the folders below it, as on a disc of DICOM; `None` if there
/// are none. Links to folders are not followed.
pub(super) fn volumes_below(top: &Path) -> Option<String> {
    let (mut found, mut folders, mut searched, mut others) = (Vec::new(), vec![top.to_owned()], 0, 0);
    while let Some(folder) = folders.pop().filter(|_| searched < MOST_SEARCHED) {
        searched += 1;
        let name = folder.strip_prefix(top).ok().filter(|name| !name.as_os_str().is_empty());
        let name = name.map_or_else(|| "the folder itself".to_owned(), |name| name.display().to_string());
        if is_zarr(&folder) {
            found.push(format!("{name} (Zarr)"));
            continue;
        }
        for (format, files) in parts_of_folder(&folder).unwrap_or_default() {
            // All headers of a series are read to describe it, so folders that are not listed are only counted.
            if found.len() == MOST_LISTED {
                others += 1;
                continue;
            }
            let series = format.list_series.map(|list| list(&folder, &files).unwrap_or_default());
            let words = match series {
                Some(series) => series.iter().map(described).collect::<Vec<String>>().join("; "),
                None => format!("{} {}", format.name, counted(files.len() as u64, "file")),
            };
            found.extend((!words.is_empty()).then(|| format!("{name} ({words})")));
        }
        let entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
        let is_folder = |entry: &std::fs::DirEntry| entry.file_type().is_ok_and(|kind| kind.is_dir());
        let mut inner: Vec<PathBuf> = entries.filter(is_folder).map(|entry| entry.path()).collect();
        inner.sort_by_cached_key(|path| std::cmp::Reverse(natural(&path.to_string_lossy())));
        folders.extend(inner);
    }
    let more = if others > 0 { format!(" and {others} others") } else { String::new() };
    (!found.is_empty()).then(|| format!("give one of the folders in it: {}{more}", found.join(", ")))
}

/// Describes a series in a few words.
fn described(series: &Series) -> String {
    let Series { modality, description, files, .. } = series;
    format!("{modality} {description:?} of {}", counted((*files).into(), "file"))
}
