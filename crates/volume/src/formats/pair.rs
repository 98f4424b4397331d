//! Volumes in two files: a header, and samples in a file of the same name with another extension.

use std::path::{Path, PathBuf};

/// Returns whether a file has one of these extensions in lower case, .gz and .bz2 after it aside.
pub(super) fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    let extension = uncompressed(path).extension().map(|e| e.to_ascii_lowercase());
    extension.is_some_and(|extension| extensions.iter().any(|known| *known == extension))
}

/// Returns the first existing file with the name of `path` and one of the extensions.
pub(super) fn existing(path: &Path, extensions: &[&str]) -> Option<PathBuf> {
    extensions.iter().map(|extension| with_extension(path, extension)).find(|file| file.is_file())
}

/// Returns the path with its extension, and .gz or .bz2 after it, replaced.
pub(super) fn with_extension(path: &Path, extension: &str) -> PathBuf {
    let mut name = uncompressed(path).with_extension("").into_os_string();
    name.push(extension);
    name.into()
}

/// Returns the path without the extension .gz or .bz2.
fn uncompressed(path: &Path) -> PathBuf {
    let is_packed = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz") || e.eq_ignore_ascii_case("bz2"));
    if is_packed { path.with_extension("") } else { path.to_owned() }
}

/// Loads a time point of the same pair twice, by its header and by its samples, which have to agree.
#[cfg(test)]
pub(super) fn loaded_by_both(
    [(header, text), (data, samples)]: [(&str, &[u8]); 2],
    time: u32,
) -> crate::error::Result<crate::volume::Volume> {
    let folder = tempfile::tempdir().unwrap();
    let [header, data] = [(header, text), (data, samples)].map(|(name, bytes)| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    });
    let options = super::LoadOptions { time: Some(time), ..super::LoadOptions::default() };
    let volume = super::load(header, &options)?;
    let by_samples = super::load(data, &options)?;
    assert_eq!((volume.grid(), volume.contents()), (by_samples.grid(), by_samples.contents()));
    Ok(volume)
}
