//! Folders that are one volume.

use std::path::Path;

/// Whether a folder has the metadata of Zarr: an array or a group.
#[must_use]
pub fn is_zarr(folder: &Path) -> bool {
    ["zarr.json", ".zarray", ".zgroup"].iter().any(|name| folder.join(name).is_file())
}

/// The folder of a file of Zarr's metadata.
pub(super) fn zarr_folder_of(file: &Path) -> Option<&Path> {
    let name = file.file_name()?.to_str()?;
    ["zarr.json", ".zarray", ".zgroup", ".zattrs"].contains(&name).then(|| file.parent()).flatten()
}
