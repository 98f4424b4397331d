//! Folders that are one volume.

use std::path::Path;

/// The files of metadata that make a folder an array or a group of Zarr.
pub(super) const METADATA: [&str; 3] = ["zarr.json", ".zarray", ".zgroup"];

/// Whether a folder has the metadata of Zarr: an array or a group.
#[must_use]
pub fn is_zarr(folder: &Path) -> bool {
    METADATA.iter().any(|name| folder.join(name).is_file())
}

/// The folder of a file of Zarr's metadata.
pub(super) fn zarr_folder_of(file: &Path) -> Option<&Path> {
    let name = file.file_name()?.to_str()?;
    (METADATA.contains(&name) || name == ".zattrs").then(|| file.parent()).flatten()
}
