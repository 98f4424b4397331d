//! DICOM: a file, or the files of a folder (<https://www.dicomstandard.org/current>).
//!
//! Slices are sorted by their position along the normal of their plane, and the positions give the direction and the
//! spacing of the third axis: a tilted gantry makes a sheared lattice. If each position has as many slices as the
//! others, these are points in time, in the order of an index, a time or a kind that tells them apart. Secondary
//! captures have no positions: they follow one another by their numbers, and so do frames without positions, at the
//! distance that the file states. The frames of a dose of radiotherapy have offsets along the normal. The tiles of a
//! mosaic are slices. Segmentations have a module of their own. Pixels are grey values, floating point, colours,
//! entries of a palette or single bits; uncompressed, in RLE, JPEG (baseline and lossless), JPEG-LS or JPEG 2000.
//! Elements may be deflated, and files in gzip, or without a preamble.

mod dataset;
mod encapsulated;
mod mosaic;
mod palette;
mod pixels;
mod plane;
mod segmentation;
mod series;
mod slices;
#[cfg(test)]
mod tests;
mod times;

use std::cell::OnceCell;
use std::path::{Path, PathBuf};

use glam::DVec3;

use self::dataset::Dataset;
use self::pixels::{pixels_in, pixels_of};
use self::plane::{Colors, Plane};
pub(super) use self::series::series;
use self::series::{chosen, without_copies};
use self::slices::{completed, gap_note, placed, sorted};
use self::times::in_times;
use super::{LoadOptions, MissingSlices, folder, selection};
use crate::error::{Result, Subject, refuse};
use crate::memory::{reserved, samples_in};
use crate::volume::{Origin, Samples, Units, Volume};

const IMAGE_TYPE: u32 = 0x0008_0008;
const SOP_CLASS: u32 = 0x0008_0016;
const SOP_INSTANCE: u32 = 0x0008_0018;
const STUDY_DATE: u32 = 0x0008_0020;
const SERIES_DATE: u32 = 0x0008_0021;
const ACQUISITION_DATE: u32 = 0x0008_0022;
const MODALITY: u32 = 0x0008_0060;
const SERIES_DESCRIPTION: u32 = 0x0008_103e;
const PROTOCOL: u32 = 0x0018_1030;
const SEQUENCE: u32 = 0x0018_0024;
const ANGIO: u32 = 0x0018_0025;
const SERIES_UID: u32 = 0x0020_000e;
const SERIES_NUMBER: u32 = 0x0020_0011;
const POSITION: u32 = 0x0020_0032;
const ORIENTATION: u32 = 0x0020_0037;
const INSTANCE: u32 = 0x0020_0013;
const CHANNELS: u32 = 0x0028_0002;
const PHOTOMETRIC: u32 = 0x0028_0004;
const FRAMES: u32 = 0x0028_0008;
const ROWS: u32 = 0x0028_0010;
const COLUMNS: u32 = 0x0028_0011;
const BITS_ALLOCATED: u32 = 0x0028_0100;
const SLICE_VECTOR: u32 = 0x0054_0080;
const DOSE_UNITS: u32 = 0x3004_0002;
const FRAME_OFFSETS: u32 = 0x3004_000c;

/// The SOP class of a directory file, DICOMDIR.
const DIRECTORY: &str = "1.2.840.10008.1.3.10";

/// A slice of a volume.
#[derive(Clone)]
struct Slice {
    /// The index of the slice's file.
    file: usize,
    frame: usize,
    /// The tile of the frame, if it is a mosaic.
    tile: u16,
    position: DVec3,
    slope: f64,
    intercept: f64,
    /// The next slice that exists and its weight, if this slice is missing; the slice before has the rest.
    behind: Option<(Box<Self>, f64)>,
}

/// Reads the volume of a series in these files.
pub(super) fn read_files(source: &Path, files: &[PathBuf], options: &LoadOptions) -> Result<Volume> {
    let mut sets = files.iter().map(|file| Dataset::read(file)).collect::<Result<Vec<Dataset>>>()?;
    let is_directory = sets.iter().any(|set| set.text(SOP_CLASS) == DIRECTORY);
    // A report or a directory file has no pixels.
    sets.retain(|set| set.pixels.is_some());
    if sets.is_empty() {
        let top = if source.is_dir() { Some(source) } else { source.parent().filter(|_| is_directory) };
        // A name without a folder has an empty parent.
        let top = top.map(|top| if top.as_os_str().is_empty() { Path::new(".") } else { top });
        let below = top.and_then(folder::volumes_below).map(|below| format!(": {below}")).unwrap_or_default();
        refuse!(source, "is DICOM without pixels{below}");
    }
    let (sets, copies) = without_copies(chosen(source, sets, options.series)?);
    let Some(first) = sets.first() else { refuse!(source, "is DICOM without pixels") };
    if segmentation::is_one(first) {
        return segmentation::read(source, &sets, copies, options);
    }
    let plane = Plane::of(first, 0)?;
    let (mut times, notes) = in_times(source, &sets, sorted(source, &sets, &plane)?)?;
    let mut contents = selection::chosen(source, options, plane.colors.channels().into(), times.len() as u64)?;
    contents.notes.extend(copies.into_iter().chain(notes));
    if plane.colors != Colors::Grey {
        contents.labels = selection::colours(contents.channels);
    }
    let (slices, channel) = (times.swap_remove(contents.time as usize), contents.channel as usize);
    if options.spacing.is_none() {
        let unstated = plane.spacing_note.into_iter().chain(gap_note(first, &plane, slices.len()));
        contents.notes.extend(unstated.map(str::to_owned));
    }
    if plane.mosaic.is_none() && mosaic::is_named(first) {
        let note = "the file is a mosaic without a number of tiles: its picture is read as one slice";
        contents.notes.push(note.to_owned());
    }
    let slices = match options.missing_slices {
        MissingSlices::Refuse => slices,
        MissingSlices::Interpolate => {
            let (slices, notes) = completed(source, &sets, slices, plane.normal())?;
            contents.notes.extend(notes);
            slices
        }
    };
    let placement = placed(source, &sets, &slices, &plane)?;
    let [columns, rows] = plane.size();
    let sizes = [columns.into(), rows.into(), slices.len() as i64];
    let grid = placement.grid(source, &sizes, options.spacing)?;
    let maps: Vec<(f64, f64)> = slices.iter().map(|slice| (slice.slope, slice.intercept)).collect();
    let same = maps.windows(2).all(|pair| pair[0] == pair[1]);
    let unit = match (first.text(MODALITY).as_str(), first.text(DOSE_UNITS).as_str()) {
        ("CT", _) => Some("HU"),
        ("RTDOSE", "GY") => Some("Gy"),
        _ => None,
    };
    let units = Units { length: None, value: unit.map(str::to_owned) };
    let described = [SERIES_DESCRIPTION, PROTOCOL, SEQUENCE].map(|tag| first.text(tag));
    let is_angiogram = first.text(ANGIO).eq_ignore_ascii_case("Y");
    let descriptions = described.iter().map(String::as_str).chain(is_angiogram.then_some("angiography"));
    contents.origin = Origin::of(Some(&first.text(MODALITY)), descriptions);

    let frames = pixels_in(source, &sets, &slices, plane.frame_bits())?;
    let frame = |slice: &Slice| pixels_of(&sets[slice.file], frames[slice.file].as_ref(), slice.frame, &plane, channel);
    // A mosaic is decoded once for all its tiles.
    let pictures: Vec<OnceCell<Vec<i64>>> = vec![OnceCell::new(); sets.len()];
    let raw = |slice: &Slice| {
        let Some(mosaic) = plane.mosaic else { return frame(slice) };
        let cell = &pictures[slice.file];
        let picture = match cell.get() {
            Some(picture) => picture,
            None => {
                let picture = frame(slice)?;
                cell.get_or_init(|| picture)
            }
        };
        Ok(mosaic.cut(picture, plane.columns.into(), slice.tile.into()))
    };
    let value = |slice: &Slice, raw: i64| {
        let number = plane.pixels.number(raw);
        if same { number } else { slice.slope * number + slice.intercept }
    };
    let values = |slice: &Slice| -> Result<Vec<f64>> {
        let near = raw(slice)?.into_iter().map(|raw| value(slice, raw));
        Ok(match &slice.behind {
            None => near.collect(),
            Some((next, share)) => near.zip(raw(next)?).map(|(a, b)| a + (value(next, b) - a) * share).collect(),
        })
    };
    macro_rules! all {
        ($variant:ident, $sample:expr) => {{
            let mut all = reserved(grid.len(), || samples_in(source))?;
            for slice in &slices {
                all.extend(values(slice)?.into_iter().map($sample));
            }
            Samples::$variant(all)
        }};
    }
    let signed = plane.pixels.signed && plane.colors != Colors::Palette;
    let is_float = plane.pixels.is_float;
    let samples = match (same && !is_float, plane.bytes, signed) {
        (false, 8, _) => all!(F64, |value| value),
        (false, ..) => all!(F32, |value| value as f32),
        (_, 1, false) => all!(U8, |value| value.round() as u8),
        (_, 1, true) => all!(I8, |value| value.round() as i8),
        (_, 2, false) => all!(U16, |value| value.round() as u16),
        (_, 2, true) => all!(I16, |value| value.round() as i16),
        (_, _, false) => all!(U32, |value| value.round() as u32),
        (_, _, true) => all!(I32, |value| value.round() as i32),
    };
    let volume = placement.volume(grid, samples.into())?.with_units(units).with_contents(contents);
    match (same, maps.first()) {
        (true, Some(&(slope, intercept))) => volume.with_rescale(slope, intercept),
        _ => Ok(volume),
    }
}
