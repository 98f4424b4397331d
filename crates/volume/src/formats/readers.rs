//! The formats that are read: a row of a table for each.

use std::path::{Path, PathBuf};

use super::input::Input;
use super::{LoadOptions, Series, afni, metaimage, mgh, mrc, nifti, npy, npz, nrrd, parrec, slc};
use crate::error::{Error, Result, Subject};
use crate::volume::{Endian, Volume};

/// A reader of the volume of a file at the start of its input, or of the data set with the given name in the file.
type Read = fn(Input, Option<&str>, &LoadOptions) -> Result<Volume>;
/// A reader of a folder, or of the given files in it.
type ReadFolder = fn(&Path, &[PathBuf], &LoadOptions) -> Result<Volume>;
/// A function that lists the series in the given files of a folder.
type ListSeries = fn(&Path, &[PathBuf]) -> Result<Vec<Series>>;
/// A function that returns the files that a header names besides its own.
type DataFiles = fn(Input) -> Result<Vec<PathBuf>>;
/// A function that returns the header of a file of samples, if that is the extension of the file and there is a header.
type HeaderOf = fn(&Path) -> Option<PathBuf>;

/// A format of files or folders.
///
/// The first bytes of a file decide on its format, otherwise the extension.
#[derive(Debug)]
#[doc(hidden)]
pub struct Format {
    /// The name of the format in messages.
    pub name: &'static str,
    /// The names and the content of files of the format, for lists of formats.
    pub description: &'static str,
    /// The extensions of files of the format in lower case, without the point.
    pub extensions: &'static [&'static str],
    /// The feature of this crate that the reader of the format needs, if it needs one.
    pub feature: Option<&'static str>,
    /// Whether a file may hold several data sets: `FILE:SET`.
    pub(super) has_sets: bool,
    /// Whether files of the format do not state the order of their axes.
    pub(super) is_array: bool,
    /// Whether a folder may hold files of the format that are sections of one volume.
    pub(super) has_sections: bool,
    begins: fn(&[u8]) -> bool,
    read: Option<Read>,
    read_folder: Option<ReadFolder>,
    pub(super) list_series: Option<ListSeries>,
    data_files: Option<DataFiles>,
    header_of: Option<HeaderOf>,
}

/// The defaults of a row of the table: one volume in a file, no folder, no data beside the header.
const PLAIN: Format = Format {
    name: "",
    description: "",
    extensions: &[],
    feature: None,
    has_sets: false,
    is_array: false,
    has_sections: false,
    begins: |_| false,
    read: None,
    read_folder: None,
    list_series: None,
    data_files: None,
    header_of: None,
};

/// Makes an optional reader, which is there if a feature is on.
macro_rules! built {
    ($feature:literal, $type:ty, $reader:expr) => {{
        #[cfg(feature = $feature)]
        const READER: Option<$type> = Some($reader);
        #[cfg(not(feature = $feature))]
        const READER: Option<$type> = None;
        READER
    }};
}

/// The name of the format whose slices are files of their own.
pub(super) const DICOM: &str = "DICOM";

/// The format Zarr: its folders are known by the files of metadata in them, its archives by their names.
pub(super) const ZARR: Format = Format {
    name: "Zarr",
    description: "folders of Zarr 2 and 3, and of OME-Zarr; .zarr.zip, .ozx, FILE:FOLDER",
    extensions: &["zip", "ozx"],
    feature: Some("zarr"),
    has_sets: true,
    read: built!("zarr", Read, |input, inside, options| super::zarr::read_archive(&input, inside, options)),
    read_folder: built!("zarr", ReadFolder, |folder, _, options| super::zarr::read(folder, options)),
    ..PLAIN
};

/// The formats, in the order in which the first bytes of a file are compared with them.
#[doc(hidden)]
pub static FORMATS: [Format; 16] = [
    // Its first 128 bytes are free: they may be the beginning of another format, such as TIFF.
    Format {
        name: DICOM,
        description: "a file or a folder of slices, or a segmentation; all but lossy JPEG of 12 bits",
        feature: Some("dicom"),
        begins: is_dicom,
        has_sections: true,
        read: built!("dicom", Read, |input, _, options| {
            super::dicom::read_files(input.path(), &[input.path().to_owned()], options)
        }),
        read_folder: built!("dicom", ReadFolder, super::dicom::read_files),
        list_series: built!("dicom", ListSeries, super::dicom::series),
        ..PLAIN
    },
    Format {
        name: "NRRD",
        description: ".nrrd, .nhdr",
        extensions: &["nrrd", "nhdr"],
        begins: |head| head.starts_with(b"NRRD000"),
        read: Some(|input, _, options| nrrd::read(input, options)),
        data_files: Some(nrrd::named_files),
        ..PLAIN
    },
    Format {
        name: "NumPy",
        description: ".npy",
        extensions: &["npy"],
        begins: |head| head.starts_with(npy::MAGIC),
        is_array: true,
        read: Some(|input, _, options| npy::read(input, options)),
        ..PLAIN
    },
    Format {
        name: "NumPy archive",
        description: ".npz, FILE:ARRAY",
        extensions: &["npz"],
        begins: npz::is_npz,
        has_sets: true,
        is_array: true,
        read: Some(npz::read),
        ..PLAIN
    },
    Format {
        name: "NIfTI",
        description: "NIfTI-1 and -2: .nii, .hdr with .img",
        extensions: &["nii", "hdr"],
        begins: nifti::is_nifti,
        read: Some(|input, _, options| nifti::read(input, options)),
        data_files: Some(nifti::named_files),
        header_of: Some(nifti::header_of),
        ..PLAIN
    },
    Format {
        name: "FreeSurfer",
        description: ".mgz, .mgh",
        extensions: &["mgz", "mgh"],
        begins: mgh::is_mgh,
        read: Some(|input, _, options| mgh::read(input, options)),
        ..PLAIN
    },
    Format {
        name: "AFNI",
        description: ".HEAD with .BRIK",
        extensions: &["head"],
        begins: afni::is_afni,
        read: Some(|input, _, options| afni::read(input, options)),
        data_files: Some(afni::named_files),
        header_of: Some(afni::header_of),
        ..PLAIN
    },
    Format {
        name: "Philips",
        description: ".PAR with .REC",
        extensions: &["par"],
        begins: parrec::is_parrec,
        read: Some(|input, _, options| parrec::read(input, options)),
        data_files: Some(parrec::named_files),
        header_of: Some(parrec::header_of),
        ..PLAIN
    },
    Format {
        name: "MetaImage",
        description: ".mha, .mhd",
        extensions: &["mha", "mhd"],
        begins: metaimage::is_metaimage,
        read: Some(|input, _, options| metaimage::read(input, options)),
        data_files: Some(metaimage::named_files),
        ..PLAIN
    },
    Format {
        name: "MRC",
        description: "MRC and CCP4: .mrc, .map, .ccp4, .rec, .st, .ali",
        extensions: &["mrc", "mrcs", "map", "ccp4", "rec", "st", "ali"],
        begins: mrc::is_mrc,
        read: Some(|input, _, options| mrc::read(input, options)),
        ..PLAIN
    },
    Format {
        name: "legacy VTK",
        description: "structured points: .vtk, FILE:ARRAY",
        extensions: &["vtk"],
        feature: Some("vtk"),
        begins: |head| head.starts_with(b"# vtk DataFile Version"),
        has_sets: true,
        read: built!("vtk", Read, |input, inside, options| {
            super::vtk::read(input, inside, options, super::vtk::legacy::read)
        }),
        ..PLAIN
    },
    Format {
        name: "VTK XML",
        description: "image data: .vti, FILE:ARRAY",
        extensions: &["vti"],
        feature: Some("vtk"),
        begins: |head| {
            let head = String::from_utf8_lossy(head);
            head.trim_start_matches('\u{feff}').trim_start().starts_with('<') && head.contains("<VTKFile")
        },
        has_sets: true,
        read: built!("vtk", Read, |input, inside, options| {
            super::vtk::read(input, inside, options, super::vtk::image_data::read)
        }),
        ..PLAIN
    },
    Format {
        name: "SLC",
        description: "VolVis: .slc",
        extensions: &["slc"],
        begins: slc::is_slc,
        read: Some(|input, _, options| slc::read(input, options)),
        ..PLAIN
    },
    Format {
        name: "TIFF",
        description: "stacks, and folders of sections: .tif, .tiff, .lsm",
        extensions: &["tif", "tiff", "lsm"],
        feature: Some("tiff"),
        begins: |head| [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| head.starts_with(*magic)),
        has_sections: true,
        read: built!("tiff", Read, |input, _, options| super::tiff::read(input, options)),
        read_folder: built!("tiff", ReadFolder, super::tiff::read_files),
        ..PLAIN
    },
    Format {
        name: "HDF5 or NetCDF",
        description: "FILE:/SET; MATLAB's .mat of version 7.3 and MINC too",
        feature: Some("hdf5"),
        has_sets: true,
        begins: |head| {
            let magics: [&[u8]; 5] = [b"\x89HDF\r\n\x1a\n", b"MATLAB 7.3 MAT-file", b"CDF\x01", b"CDF\x02", b"CDF\x05"];
            magics.iter().any(|magic| head.starts_with(magic))
        },
        read: built!("hdf5", Read, |input, inside, options| super::hdf5::read(&input, inside, options)),
        ..PLAIN
    },
    ZARR,
];

/// Returns whether a file begins as DICOM does: by a mark behind a preamble, by the mark alone, or by elements.
fn is_dicom(head: &[u8]) -> bool {
    head.get(128..132) == Some(b"DICM") || head.starts_with(b"DICM\x02\0") || begins_with_elements(head)
}

/// The number of elements by which a DICOM file without a mark is known.
const ELEMENTS: usize = 3;

/// Returns whether the first bytes are elements of DICOM: in the groups 2 and 8, in ascending order, of even lengths.
fn begins_with_elements(head: &[u8]) -> bool {
    let endian = if head.starts_with(&[0, 8]) { Endian::Big } else { Endian::Little };
    let (mut at, mut last) = (0, 0);
    for _ in 0..ELEMENTS {
        let number = |from: usize, size: usize| Some(endian.number(head.get(at + from..at + from + size)?));
        let Some(kind) = head.get(at + 4..at + 6) else { return false };
        let (start, length) = match kind {
            b"OB" | b"OW" | b"SQ" | b"UN" | b"UT" => (12, number(8, 4)),
            kind if kind.iter().all(u8::is_ascii_uppercase) => (8, number(6, 2)),
            _ => (8, number(4, 4)),
        };
        let (Some(group), Some(element), Some(length)) = (number(0, 2), number(2, 2), length) else { return false };
        let tag = group << 16 | element;
        let is_first = last == 0;
        if ![2, 8].contains(&group) || !is_first && tag <= last || length % 2 == 1 || length > 1024 {
            return false;
        }
        (at, last) = (at + start + length as usize, tag);
    }
    // The last element need not end in the first bytes, but it begins there.
    true
}

impl Format {
    /// Returns the format that the first bytes of a file belong to.
    pub(super) fn of_content(head: &[u8]) -> Option<&'static Self> {
        FORMATS.iter().find(|format| (format.begins)(head))
    }

    /// Returns the format that the name of a file promises; `None` of DICOM, whose files have any name.
    #[must_use]
    pub fn of_name(path: &Path) -> Option<&'static Self> {
        // The extension decides, so a lossy conversion to UTF-8 suffices.
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let name = name.strip_suffix(".gz").or_else(|| name.strip_suffix(".bz2")).unwrap_or(&name);
        let extension = name.rsplit_once('.')?.1;
        FORMATS.iter().find(|format| format.extensions.contains(&extension))
    }

    /// Returns the header of a file of samples, if that is its extension and there is one.
    pub(super) fn header_of(image: &Path) -> Option<PathBuf> {
        FORMATS.iter().filter_map(|format| format.header_of).find_map(|header_of| header_of(image))
    }

    /// Returns whether a file of this format may have the name: with one of the extensions of the format, if it has
    /// any.
    pub(super) fn allows_name(&self, path: &Path) -> bool {
        self.extensions.is_empty() || Self::of_name(path).is_some_and(|named| named.name == self.name)
    }

    /// Returns whether this build has the reader of the format.
    #[must_use]
    pub fn is_built(&self) -> bool {
        self.read.is_some() || self.read_folder.is_some()
    }

    /// Reads the volume of a file, or the data set of the name `inside` in it.
    pub(super) fn read(&self, input: Input, inside: Option<&str>, options: &LoadOptions) -> Result<Volume> {
        self.read.ok_or_else(|| self.absent(input.path()))?(input, inside, options)
    }

    /// Reads a folder, or the given files in it.
    pub(super) fn read_folder(&self, folder: &Path, files: &[PathBuf], options: &LoadOptions) -> Result<Volume> {
        self.read_folder.ok_or_else(|| self.absent(folder))?(folder, files, options)
    }

    /// Returns the files that a header names besides its own.
    pub(super) fn data_files(&self, input: Input) -> Result<Vec<PathBuf>> {
        self.data_files.map_or(Ok(Vec::new()), |named| named(input))
    }

    fn absent(&self, path: &Path) -> Error {
        let (name, feature) = (self.name, self.feature.unwrap_or_default());
        let what = if path.is_dir() { "folder" } else { "file" };
        let way_out = format!("build it with --features {feature}");
        path.error(format!("is a {name} {what}, and this build has no reader of it: {way_out}"))
    }
}
