//! Readers: from the name of a volume to the volume.

mod afni;
mod complex;
#[cfg(any(feature = "hdf5", feature = "zarr"))]
mod coordinates;
mod decode;
#[cfg(feature = "dicom")]
mod dicom;
mod fields;
mod folder;
#[cfg(feature = "hdf5")]
mod hdf5;
mod input;
mod metaimage;
mod mgh;
mod mrc;
mod multifile;
mod nifti;
mod npy;
mod npz;
mod nrrd;
mod origin;
mod pair;
mod parrec;
mod part;
mod placement;
mod raw_name;
mod readers;
mod selection;
mod series;
mod slc;
mod text_header;
#[cfg(feature = "tiff")]
mod tiff;
mod time_series;
#[cfg(feature = "vtk")]
mod vtk;
#[cfg(any(feature = "tiff", feature = "vtk"))]
mod xml;
#[cfg(feature = "zarr")]
mod zarr;
mod zip;

use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use complex::ComplexPart;
use decode::{Layout, read_all, x_fastest};
pub use folder::is_zarr;
use folder::{volumes_below, zarr_folder_of};
use input::{Input, Unpacked};
pub use part::LatticePart;
use placement::{Placement, check_spacing};
use readers::{DICOM, ZARR};
pub use readers::{FORMATS, Format};
use selection::{Pick, chosen};
pub use series::{Series, list_series};
pub use time_series::TimeSeries;
#[cfg(feature = "vtk")]
pub(crate) use vtk::poly_data::read as read_poly_data;

use crate::demos;
use crate::error::{Error, Hint, Result, Subject, refuse, refuse_if};
use crate::files::remote::registered;
pub use crate::files::remote::{CAN_FETCH, FetchOptions, FetchProgress, is_url, without_credentials};
pub use crate::files::{read_json, read_text};
use crate::names::{counted, named};
use crate::volume::{Endian, SampleType, Volume};

/// The level to read of a pyramid, which is a file that holds the same volume at several resolutions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PyramidLevel {
    /// The level of this number; 0 is the finest.
    At(u32),
    /// The coarsest level with samples no coarser than pixels, if the volume's longest edge spans this many pixels.
    Pixels(f64),
    /// The coarsest level with samples at most this world length apart.
    PixelSize(f64),
}

/// The treatment of a DICOM series that lacks slices between others, or whose slices are unequally spaced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MissingSlices {
    /// An error that names the places.
    #[default]
    Refuse,
    /// Linear interpolation of slices at equal distances between their neighbours, which a note of
    /// [`Contents`](crate::volume::Contents) states. Existing slices keep their values, unless slices are unequally
    /// spaced: then the new ones lie about the least distance apart.
    Interpolate,
}

named!("missing_slices", MissingSlices { Refuse: "refuse", Interpolate: "interpolate" });

/// The order in which the axes of an array index its samples; the last axis is the fastest, as in C.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AxisOrder {
    /// An array indexed (z, y, x): x is the fastest.
    #[default]
    Zyx,
    /// An array indexed (x, y, z): z is the fastest, unless an array of NumPy is in Fortran order.
    Xyz,
}

named!("axis_order", AxisOrder { Zyx: "zyx", Xyz: "xyz" });

/// Facts about a file that its header lacks, and choices among its volumes. By default the header decides.
///
/// End a literal with `..LoadOptions::default()`: a minor release may add fields.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadOptions {
    /// The number of samples along x, y and z of a file without a header; x is fastest unless `axis_order` states
    /// otherwise.
    pub dims: Option<[u32; 3]>,
    /// The sample type of a file without a header.
    pub sample_type: Option<SampleType>,
    /// The world distance between samples along each axis. It replaces the spacing of a header, whose directions and
    /// origin stay.
    pub spacing: Option<[f64; 3]>,
    /// The byte order of a file without a header; `None` is little-endian.
    pub endian: Option<Endian>,
    /// The number of bytes before the first sample of a file without a header.
    pub offset: u64,
    /// The order of the axes of an array of NumPy, or of a file without a header; `None` is (z, y, x), and a note of
    /// [`Contents`](crate::volume::Contents) if the array looks otherwise.
    pub axis_order: Option<AxisOrder>,
    /// The finite number that replaces NaN and infinite samples. `None` keeps them: nothing is drawn of them, they are
    /// not in ranges and means, and a note of [`Contents`](crate::volume::Contents) counts them.
    pub replace_nan: Option<f64>,
    /// The point in time of a file that holds several, counted from 0; `None` is the first.
    pub time: Option<u32>,
    /// The channel of a file that holds several, counted from 0; without it such a file is an error. The
    /// [`Volume::contents`] of any channel state the number of channels.
    pub channel: Option<u32>,
    /// The series of a file or folder that holds several, counted from 1: of DICOM in the order of their numbers, as
    /// [`list_series`] lists them, of TIFF in the order of the file.
    pub series: Option<u32>,
    /// The treatment of a DICOM series that lacks slices, or has unequally spaced ones.
    pub missing_slices: MissingSlices,
    /// The number that is read of each complex sample; without it complex samples are an error.
    pub complex: Option<ComplexPart>,
    /// The level of a pyramid; the finest by default.
    pub level: PyramidLevel,
    /// The largest volume, in bytes of samples, that is always read into memory; 4 MiB by default. A larger one stays
    /// in its file if its samples are uncompressed and in one piece there, and is read brick by brick.
    pub stream_over: u64,
    /// The part of the lattice that is needed; `None` is all of it. Of Zarr only the chunks that touch it are read. The
    /// samples of other chunks have the fill value.
    pub part: Option<LatticePart>,
    /// The conditions of fetching a source at a url.
    pub fetch: FetchOptions,
    /// Makes literals that name all fields impossible.
    #[doc(hidden)]
    pub non_exhaustive: (),
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            dims: None,
            sample_type: None,
            spacing: None,
            endian: None,
            offset: 0,
            axis_order: None,
            replace_nan: None,
            time: None,
            channel: None,
            series: None,
            missing_slices: MissingSlices::Refuse,
            complex: None,
            level: PyramidLevel::At(0),
            stream_over: 4 << 20,
            part: None,
            fetch: FetchOptions::default(),
            non_exhaustive: (),
        }
    }
}

/// Loads a volume: a file of one of the formats below, a file of bare samples, or the built-in volume
/// `demo:NAME[:SIZE]` (see [`demos`]).
///
/// With the feature `remote` a source may be a url: `https://..`, `http://..`, or `s3://BUCKET/KEY` with the variables of
/// the environment that AWS names. Files are fetched whole, of Zarr and its archives only the needed chunks.
///
/// [`FORMATS`] lists the formats. Of a file with
/// several points in time or channels `time` and `channel` choose one; [`Volume::contents`] tells how many there are. A
/// folder is read if it holds DICOM files, whose slices are sorted by position, or TIFF files, which are sections in
/// natural order: 9 goes before 10; and if it is an array of Zarr 2 or 3 or an image of OME-Zarr, of whose
/// pyramid `level` chooses. `FILE:SET` is an array of .npz or VTK, or a data set of HDF5 or NetCDF, which need the
/// feature `hdf5`; without a name the only volume in the file is read.
///
/// The content of a file decides on its format; if it has no known beginning, the extension does. Files of every format
/// but .npz, TIFF and HDF5 may be compressed with gzip or bzip2. Files of bare samples need `dims` and `sample_type`,
/// unless their names state them: `NAME_256x256x128_uint8.raw`. For all other files these two are an error, as are
/// `endian` and `offset`, and `axis_order` for all but arrays of NumPy.
///
/// # Errors
/// - [`Error::Read`] if a file cannot be read.
/// - [`Error::Format`] if it is not a regular file (standard input excepted), or its content is malformed, cut short,
///   inconsistent or not supported.
/// - [`Error::NonFinite`] if all samples are NaN or infinite and no replacement is given.
/// - [`Error::Volume`] if the built-in volume does not exist.
/// - [`Error::Setting`] if an option is out of range or does not apply to the file.
/// - [`Error::Memory`] if there is no memory for the samples.
pub fn load(source: impl AsRef<Path>, options: &LoadOptions) -> Result<Volume> {
    load_from(source.as_ref(), options, None)
}

/// Loads a volume as [`load`] does; decompressed streams are kept in `unpacked`, if that is given, and read from there.
fn load_from(source: &Path, options: &LoadOptions, unpacked: Option<&Arc<Unpacked>>) -> Result<Volume> {
    let source = &*registered(source, &options.fetch)?;
    if let Some(spacing) = options.spacing {
        check_spacing(spacing)?;
    }
    if let Some(value) = options.replace_nan
        && !value.is_finite()
    {
        return Err(Error::setting("replace_nan", format!("{value}, expected a finite number")));
    }
    let mut volume = match demos::name_in(source) {
        Some(demo) => {
            refuse_raw_options(source, options, "a built-in volume", false)?;
            chosen(source, options, 1, 1)?;
            demos::parsed(demo, options.spacing)?
        }
        None => match with_inside(source) {
            Some((file, inside)) => load_file(&file, Some(&inside), options, unpacked)?,
            None => load_file(source, None, options, unpacked)?,
        },
    };
    volume = volume.loaded(options.stream_over)?;
    if let Some(value) = options.replace_nan {
        return volume.with_non_finite_replaced(value);
    }
    let gaps = volume.gaps()?;
    if gaps > 0 {
        let (all, are) = (volume.grid().len(), if gaps == 1 { "it is" } else { "they are" });
        let mut contents = volume.contents().clone();
        contents.notes.push(format!("nothing is drawn of {gaps} of {all} samples because {are} NaN or infinite"));
        volume = volume.with_contents(contents);
    }
    Ok(volume)
}

/// Returns the file and the data set of `FILE:SET`, if there is such a file and none of the whole name.
fn with_inside(source: &Path) -> Option<(PathBuf, String)> {
    let (file, inside) = source.to_str()?.rsplit_once(':')?;
    let path = Path::new(file);
    // The colon of a url may stand before a port: a file has a path behind the host.
    let is_at_url = || {
        let has_sets = Format::of_name(path).is_some_and(|format| format.has_sets);
        has_sets && is_url(path) && path.components().count() > 2
    };
    let is_set = !inside.is_empty() && !source.exists() && (path.is_file() || is_at_url());
    is_set.then(|| (file.into(), inside.to_owned()))
}

fn load_file(
    path: &Path,
    inside: Option<&str>,
    options: &LoadOptions,
    unpacked: Option<&Arc<Unpacked>>,
) -> Result<Volume> {
    if path.is_dir() {
        return load_folder(path, options);
    }
    #[cfg(all(feature = "remote", feature = "zarr"))]
    if is_url(path) {
        match Format::of_name(path) {
            Some(format) if format.name == ZARR.name => {
                refuse_raw_options(path, options, "a Zarr file", false)?;
                return zarr::read_archive_at(path, inside, options);
            }
            None if let Some(folder) = zarr::folder_at(path)? => {
                refuse_raw_options(path, options, "a folder", false)?;
                return ZARR.read_folder(folder, &[], options);
            }
            _ => {}
        }
    }
    if let Some(folder) = zarr_folder_of(path) {
        return load_folder(folder, options);
    }
    let mut input = Input::open(path, unpacked.cloned())?;
    let head = input.peek(nifti::HEADER_SIZE)?;
    refuse_if!(head.is_empty(), input, "is empty");
    let content = Format::of_content(&head);
    let has_raw_options = options.dims.is_some() || options.sample_type.is_some();
    // Users may name the file of the samples instead of its header.
    if content.is_none()
        && !has_raw_options
        && let Some(header) = Format::header_of(path)
    {
        return load_file(&header, inside, options, unpacked);
    }
    if content.is_none()
        && nifti::is_analyze(&head)
        && Format::of_name(path).is_some_and(|format| format.name == "NIfTI")
    {
        refuse!(input, "is in ANALYZE 7.5 format, which is not read: convert it to NIfTI");
    }
    let Some(format) = content.or(Format::of_name(path)) else { return read_raw(input, &head, options) };
    refuse_raw_options(path, options, &format!("a {} file", format.name), format.is_array)?;
    if let Some(inside) = inside
        && !format.has_sets
    {
        refuse!(input, "is a {} file, which has no data set {inside:?}", format.name);
    }
    format.read(input, inside, options)
}

/// Reads a folder of Zarr, or the sections that are files of a folder.
fn load_folder(folder: &Path, options: &LoadOptions) -> Result<Volume> {
    if is_zarr(folder) {
        refuse_raw_options(folder, options, "a folder", false)?;
        return ZARR.read_folder(folder, &[], options);
    }
    let mut parts = parts_of_folder(folder)?;
    refuse_raw_options(folder, options, "a folder", false)?;
    let Some((format, mut files)) = parts.pop() else {
        let below = volumes_below(folder).map(|below| format!(": {below}")).unwrap_or_default();
        refuse!(folder, "is a directory without TIFF or DICOM files, and no OME-Zarr{below}");
    };
    if let Some((other, _)) = parts.pop() {
        refuse!(folder, "holds {} and {} files: give each a folder of its own", other.name, format.name);
    }
    files.sort_by_cached_key(|path| natural(&path.file_name().unwrap_or_default().to_string_lossy()));
    format.read_folder(folder, &files, options)
}

/// Returns the files of a folder that are sections of a volume, by their formats.
fn parts_of_folder(folder: &Path) -> Result<Vec<(&'static Format, Vec<PathBuf>)>> {
    let mut parts: Vec<(&Format, Vec<PathBuf>)> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::read(folder))? {
        let path = entry.map_err(Error::read(folder))?.path();
        if !path.is_file() {
            continue;
        }
        // Other files may lie beside the slices, such as notes and previews.
        let content = Format::of_content(&Input::open(&path, None)?.peek(nifti::HEADER_SIZE)?);
        let Some(format) = content.filter(|format| format.has_sections && format.allows_name(&path)) else { continue };
        match parts.iter_mut().find(|(of, _)| of.name == format.name) {
            Some((_, files)) => files.push(path),
            None => parts.push((format, vec![path])),
        }
    }
    // The same message whatever the order of the directory.
    parts.sort_by_key(|(format, _)| format.name);
    Ok(parts)
}

/// Returns the files besides `source` from which a volume is read: the data files that its header names, the slices in
/// its folder, the files of a Zarr. Samples are not read, and a source that cannot be read has no such files.
///
/// A program that writes files can thus tell that it would overwrite its input.
#[must_use]
pub fn data_files(source: &Path) -> Vec<PathBuf> {
    let of_header = |file: &Path| -> Result<Vec<PathBuf>> {
        let mut input = Input::open(file, None)?;
        match (Format::of_content(&input.peek(nifti::HEADER_SIZE)?), Format::header_of(file)) {
            (Some(format), _) => format.data_files(input),
            (None, Some(header)) => Ok(vec![header]),
            (None, None) => Format::of_name(file).map_or(Ok(Vec::new()), |format| format.data_files(input)),
        }
    };
    if source.is_file() && zarr_folder_of(source).is_none() {
        return of_header(source).unwrap_or_default();
    }
    let folder = zarr_folder_of(source).unwrap_or(source);
    if is_zarr(folder) {
        return files_within(folder);
    }
    let parts = if folder.is_dir() { parts_of_folder(folder).unwrap_or_default() } else { Vec::new() };
    parts.into_iter().flat_map(|(_, files)| files).collect()
}

/// Returns the name of the format of a file or a folder that [`load`] may read: by the first bytes, otherwise by the
/// name. Samples are not read.
///
/// A program can thus list the volumes in a folder.
#[must_use]
pub fn format_of(source: &Path) -> Option<&'static str> {
    if is_zarr(source) {
        return Some(ZARR.name);
    }
    if source.is_dir() {
        let parts = parts_of_folder(source).ok()?;
        return parts.first().filter(|_| parts.len() == 1).map(|(format, _)| format.name);
    }
    let head = Input::open(source, None).and_then(|mut input| input.peek(nifti::HEADER_SIZE)).ok()?;
    let format = Format::of_content(&head).or_else(|| Format::of_name(source)).map(|format| format.name);
    format.or_else(|| raw_name::stated(source).map(|_| "bare samples"))
}

/// Returns the volumes in a folder, in the order of their names: files of a known format, folders of Zarr, and folders
/// of slices; the folder itself if it holds slices of DICOM. Files of samples beside a header, hidden files and links
/// to folders are left out. Samples are not read.
///
/// # Errors
/// [`Error::Read`] if the folder cannot be read.
pub fn volumes_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let (mut found, mut samples, mut slices) = (Vec::new(), Vec::new(), false);
    for entry in std::fs::read_dir(folder).map_err(Error::read(folder))? {
        let entry = entry.map_err(Error::read(folder))?;
        let path = entry.path();
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        if entry.file_name().to_string_lossy().starts_with('.') {
            continue;
        }
        if is_folder {
            found.extend(format_of(&path).map(|_| path));
        } else if path.is_file() {
            // A file that cannot be opened is reported when it is read.
            match format_of(&path).or_else(|| Format::of_name(&path).map(|format| format.name)) {
                Some(DICOM) => slices = true,
                Some(_) => {
                    samples.extend(data_files(&path).into_iter().filter(|file| *file != path));
                    found.push(path);
                }
                None => {}
            }
        }
    }
    found.retain(|path| !samples.contains(path));
    found.extend(slices.then(|| folder.to_owned()));
    found.sort_by_cached_key(|path| natural(&path.to_string_lossy()));
    Ok(found)
}

/// Returns the files of a folder and of the folders in it. Links to folders are not followed.
fn files_within(folder: &Path) -> Vec<PathBuf> {
    let (mut files, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => folders.push(entry.path()),
                _ => files.push(entry.path()),
            }
        }
    }
    files
}

/// Returns a key that sorts names with numbers as people do: runs of digits are numbers, and 9 goes before 10. Names
/// that differ in leading zeros and capitals alone keep one order.
fn natural(name: &str) -> (Vec<(String, usize, String)>, String) {
    let run = |run: &[u8]| {
        let text = String::from_utf8_lossy(run);
        if !text.starts_with(|c: char| c.is_ascii_digit()) {
            return (text.to_lowercase(), 0, String::new());
        }
        // Of numbers without leading zeros the one with more digits is the larger.
        let number = text.trim_start_matches('0');
        (String::new(), number.len(), number.to_owned())
    };
    let runs = name.as_bytes().chunk_by(|a, b| a.is_ascii_digit() == b.is_ascii_digit());
    (runs.map(run).collect(), name.to_owned())
}

/// Refuses options for bare samples on any other source: they would contradict its header. Arrays of NumPy state all
/// but the order of their axes.
fn refuse_raw_options(path: &Path, options: &LoadOptions, what: &str, is_array: bool) -> Result<()> {
    let given = [
        ("dims", options.dims.is_some()),
        ("sample_type", options.sample_type.is_some()),
        ("endian", options.endian.is_some()),
        ("offset", options.offset != 0),
        ("axis_order", options.axis_order.is_some() && !is_array),
    ];
    match given.into_iter().find(|(_, given)| *given) {
        Some((name, _)) => {
            let arrays = if name == "axis_order" { " and arrays of NumPy" } else { "" };
            let reason = format!("it is for files of bare samples{arrays}, and {} is {what}", path.display());
            Err(Error::setting(name, reason))
        }
        None => Ok(()),
    }
}

fn read_raw(mut input: Input, head: &[u8], options: &LoadOptions) -> Result<Volume> {
    let named = raw_name::stated(input.path());
    let by_name = options.dims.is_none() && named.is_some();
    let dims = options.dims.or(named.map(|named| named.dims));
    let (dims, sample_type) = match (dims, options.sample_type.or(named.map(|named| named.sample_type))) {
        (Some(dims), Some(sample_type)) => (dims, sample_type),
        (None, Some(_)) => {
            let reason = format!("holds bare samples of unknown number{}", maybe_named(input.path()));
            return Err(input.error(reason).hinted(Hint::GiveDims));
        }
        (Some(_), None) => return Err(input.error("holds bare samples of unknown type").hinted(Hint::GiveSampleType)),
        (None, None) => return Err(unknown(&input, head)),
    };
    let path = input.path().to_owned();
    let placement = Placement::axis_parallel([1.0; 3]);
    let grid = placement.grid(&path, &dims.map(i64::from), options.spacing)?;
    input.skip(options.offset)?;
    let needed = grid.len().saturating_mul(sample_type.size() as u64);
    if let Some(left) = input.exactly_left().filter(|left| *left < needed) {
        let ([x, y, z], after) = (dims, if options.offset > 0 { " after the offset" } else { "" });
        refuse!(input, "has {left} bytes{after}, and {x} x {y} x {z} samples of {sample_type} need {needed}");
    }
    let layout = Layout::Binary(options.endian.or(named.and_then(|named| named.endian)).unwrap_or_default());
    let mut contents = chosen(&path, options, 1, 1)?;
    if let Some(more) = input.exactly_left().map(|left| left - needed).filter(|more| *more > 0) {
        let ([x, y, z], end) = (dims, counted(more, "byte"));
        let times = (more + needed) / needed;
        let wider = (more.is_multiple_of(needed) && [2, 4, 8].contains(&times))
            .then(|| format!(": they fit samples of {} bytes", times * sample_type.size() as u64));
        let wider = wider.unwrap_or_default();
        contents
            .notes
            .push(format!("{x} x {y} x {z} samples of {sample_type} leave {end} at the end of the file{wider}"));
    }
    if by_name {
        let [x, y, z] = dims;
        contents.notes.push(format!("using {x} x {y} x {z} samples of {sample_type} because the name states them"));
    }
    if options.axis_order.is_none() && !by_name && npy::looks_reversed(dims) {
        let ([x, y, z], read) = (dims, "dims are numbers along x, y and z, and x is the fastest");
        contents.notes.push(format!("{x} x {y} x {z} samples look like the shape (z, y, x) of an array, but {read}"));
    }
    let stored = read_all(input, &Pick::all(grid.len()), sample_type, layout)?;
    let stored = match options.axis_order.unwrap_or_default() {
        AxisOrder::Zyx => stored,
        AxisOrder::Xyz => x_fastest(&stored.into_samples()?, dims, &path)?.into(),
    };
    Ok(placement.volume(grid, stored)?.with_contents(contents))
}

/// Returns a remark on bare samples if a name contains three numbers; otherwise empty.
fn maybe_named(path: &Path) -> String {
    let said = |[x, y, z]: [u32; 3]| format!("; its name may mean {x} x {y} x {z} samples");
    raw_name::maybe_dims(path).map(said).unwrap_or_default()
}

/// Returns the error about a file of no known format.
fn unknown(input: &Input, head: &[u8]) -> Error {
    let others: [(&[u8], &str); 3] = [(b"<?xml", "XML"), (b"\x89PNG", "PNG"), (b"PK\x03\x04", "ZIP")];
    if let Some((_, name)) = others.iter().find(|(magic, _)| head.starts_with(magic)) {
        let reason = "which is not read: convert it to NRRD, NIfTI, MetaImage or NumPy (.npy)";
        return input.error(format!("is a {name} file, {reason}"));
    }
    let names: Vec<&str> = FORMATS.iter().map(|format| format.name).collect();
    let named = maybe_named(input.path());
    let error = input.error(format!("is of no format that is read: {}{named}", names.join(", ")));
    error.hinted(Hint::GiveDimsAndSampleType)
}

#[cfg(test)]
mod tests {
    use super::natural;

    #[test]
    fn names_are_sorted_as_people_do() {
        let sorted =
            ["a.tif", "slice2.tif", "slice09.tif", "Slice9.tif", "slice10.tif", "slice10b.tif", "t1z10", "t2z9"];
        let mut names = sorted;
        names.reverse();
        names.sort_by_cached_key(|name| natural(name));
        assert_eq!(names[4..], sorted[4..]);
        assert_eq!((names[0], names[1]), ("a.tif", "slice2.tif"));
        // Digits without end are a number too.
        assert!(natural(&"1".repeat(99)) < natural(&"2".repeat(99)));
    }
}
