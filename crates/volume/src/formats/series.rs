//! The series of a folder of DICOM files.

use std::path::Path;

use serde::Serialize;

use super::{is_zarr, parts_of_folder};
use crate::error::Result;

/// A series of a folder of DICOM files, as the files state it. Texts are empty if the files state none.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Series {
    /// The number by which [`LoadOptions::series`](super::LoadOptions::series) chooses it.
    pub number: u32,
    /// The modality of the series, such as CT, MR or SEG.
    pub modality: String,
    /// The description of the series.
    pub description: String,
    /// The number of files of the series.
    pub files: u32,
    /// The number of samples along each axis; `None` if the slices do not make a volume.
    pub dims: Option<[u32; 3]>,
    /// The number of points in time.
    pub times: u32,
    /// The distance of samples along each axis, mm.
    pub spacing: Option<[f64; 3]>,
    /// The date of the series, the acquisition or the study: YYYYMMDD.
    pub date: Option<String>,
    /// The unique identifier of the series.
    pub uid: String,
}

/// Lists the series of a folder of DICOM files; none if it is another folder, or a file.
///
/// # Errors
/// [`Error::Read`](crate::error::Error::Read) if a file cannot be read, and
/// [`Error::Format`](crate::error::Error::Format) if one is malformed.
pub fn list_series(folder: impl AsRef<Path>) -> Result<Vec<Series>> {
    let folder = folder.as_ref();
    if !folder.is_dir() || is_zarr(folder) {
        return Ok(Vec::new());
    }
    let parts = parts_of_folder(folder)?;
    let listed = parts.iter().find_map(|(format, files)| Some(format.list_series?(folder, files)));
    listed.unwrap_or_else(|| Ok(Vec::new()))
}
