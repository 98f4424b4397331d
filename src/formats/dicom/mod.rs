//! DICOM: a file, or the files of a folder (<https://www.dicomstandard.org/current>).
//!
//! Slices are sorted by their position along the normal of their plane, and the positions give the direction and the
//! spacing of the third axis: a tilted gantry makes a sheared lattice. Pixels are uncompressed, in RLE,
//! JPEG (baseline and lossless) or JPEG 2000.

mod dataset;
mod encapsulated;

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

use self::dataset::Dataset;
use self::encapsulated::{Frames, Size, syntax_of};
use super::decode::{lattice, samples_in};
use super::placement::Placement;
use super::{LoadOptions, selection};
use crate::error::{Error, Hint, Result};
use crate::memory::reserved;
use crate::volume::{Endian, Samples, Stored, Units, Volume};

const IMAGE_TYPE: u32 = 0x0008_0008;
const MODALITY: u32 = 0x0008_0060;
const SERIES_DESCRIPTION: u32 = 0x0008_103e;
const SLICE_THICKNESS: u32 = 0x0018_0050;
const BETWEEN_SLICES: u32 = 0x0018_0088;
const SERIES_UID: u32 = 0x0020_000e;
const SERIES_NUMBER: u32 = 0x0020_0011;
const POSITION: u32 = 0x0020_0032;
const ORIENTATION: u32 = 0x0020_0037;
const CHANNELS: u32 = 0x0028_0002;
const FRAMES: u32 = 0x0028_0008;
const ROWS: u32 = 0x0028_0010;
const COLUMNS: u32 = 0x0028_0011;
const PIXEL_SPACING: u32 = 0x0028_0030;
const BITS_ALLOCATED: u32 = 0x0028_0100;
const BITS_STORED: u32 = 0x0028_0101;
const HIGH_BIT: u32 = 0x0028_0102;
const SIGNED: u32 = 0x0028_0103;
const INTERCEPT: u32 = 0x0028_1052;
const SLOPE: u32 = 0x0028_1053;

/// Whether these are the first bytes of a DICOM file.
pub(super) fn is_dicom(head: &[u8]) -> bool {
    head.get(128..132) == Some(b"DICM")
}

/// One section of a volume.
struct Slice {
    /// Among the files.
    file: usize,
    frame: usize,
    position: DVec3,
    slope: f64,
    intercept: f64,
}

/// What all slices share.
#[derive(PartialEq)]
struct Plane {
    columns: u16,
    rows: u16,
    pixels: Pixels,
    /// Directions of rows and columns.
    directions: [DVec3; 2],
    /// Distances between columns and between rows.
    spacing: [f64; 2],
}

/// How pixels are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Pixels {
    bytes: u32,
    stored: u32,
    high: u32,
    signed: bool,
}

/// Reads the volume of a series in these files.
pub(super) fn read_files(source: &Path, files: &[PathBuf], options: &LoadOptions) -> Result<Volume> {
    let mut sets = files.iter().map(|file| Dataset::read(file)).collect::<Result<Vec<Dataset>>>()?;
    // A report or a directory file has no pixels.
    sets.retain(|set| set.pixels.is_some());
    let sets = chosen(source, sets, options.series)?;
    let contents = selection::chosen(source, options, 1, 1)?;
    let Some(first) = sets.first() else { return Err(Error::format(source, "is DICOM without pixels")) };
    let plane = Plane::of(first, 0)?;
    let slices = sorted(source, &sets, &plane)?;
    let placement = placed(source, &sets, &slices, &plane)?;
    let dims = lattice(source, &[plane.columns.into(), plane.rows.into(), slices.len() as i64])?;
    let grid = placement.grid(source, dims, options.spacing)?;
    let maps: Vec<(f64, f64)> = slices.iter().map(|slice| (slice.slope, slice.intercept)).collect();
    let same = maps.windows(2).all(|pair| pair[0] == pair[1]);
    let units = Units { length: None, value: (first.text(MODALITY) == "CT").then(|| "HU".to_owned()) };

    let per_slice = usize::from(plane.columns) * usize::from(plane.rows);
    let frames = pixels_in(source, &sets, &slices, per_slice * plane.pixels.bytes as usize)?;
    let count = grid.len();
    let what = || samples_in(source);
    let read = |slice: &Slice| pixels_of(&sets[slice.file], frames[slice.file].as_ref(), slice.frame, &plane);
    macro_rules! whole {
        ($variant:ident $t:ty) => {{
            let mut all: Vec<$t> = reserved(count, what)?;
            for slice in &slices {
                all.extend(read(slice)?.into_iter().map(|value| value as $t));
            }
            Samples::$variant(all)
        }};
    }
    let samples = match (same, plane.pixels.bytes, plane.pixels.signed) {
        (false, ..) => {
            let mut all: Vec<f32> = reserved(count, what)?;
            for slice in &slices {
                let value = |raw: i64| (slice.slope * raw as f64 + slice.intercept) as f32;
                all.extend(read(slice)?.into_iter().map(value));
            }
            Samples::F32(all)
        }
        (_, 1, false) => whole!(U8 u8),
        (_, 1, true) => whole!(I8 i8),
        (_, 2, false) => whole!(U16 u16),
        (_, 2, true) => whole!(I16 i16),
        (_, _, false) => whole!(U32 u32),
        (_, _, true) => whole!(I32 i32),
    };
    let volume = placement.volume(grid, Stored::Memory(Arc::new(samples)))?.with_units(units).with_contents(contents);
    match (same, maps.first()) {
        (true, Some(&(slope, intercept))) => volume.with_rescale(slope, intercept),
        _ => Ok(volume),
    }
}

/// The files of one series, without localizers if there are others.
fn chosen(source: &Path, sets: Vec<Dataset>, series: Option<u32>) -> Result<Vec<Dataset>> {
    let number = |set: &Dataset| set.text(SERIES_NUMBER).parse::<i64>().unwrap_or(i64::MAX);
    let mut all: Vec<(i64, String, Vec<Dataset>)> = Vec::new();
    for set in sets {
        let uid = set.text(SERIES_UID);
        match all.iter_mut().find(|(_, known, _)| *known == uid) {
            Some((.., sets)) => sets.push(set),
            None => all.push((number(&set), uid, vec![set])),
        }
    }
    all.sort_by(|a, b| (a.0, &a.1).cmp(&(b.0, &b.1)));
    let listed = || {
        let line = |(n, (_, _, sets)): (usize, &(i64, String, Vec<Dataset>))| {
            let text = |tag| sets.first().map(|set| set.text(tag)).unwrap_or_default();
            format!("{} is {} {:?} of {} files", n + 1, text(MODALITY), text(SERIES_DESCRIPTION), sets.len())
        };
        all.iter().enumerate().map(line).collect::<Vec<_>>().join(", ")
    };
    let index = match series {
        None if all.len() > 1 => {
            let mut error = Error::format(source, format!("holds {} series: {}", all.len(), listed()));
            if let Error::Format { hint, .. } = &mut error {
                *hint = Some(Hint::ChooseSeries);
            }
            return Err(error);
        }
        None => 0,
        Some(n) if n == 0 || n as usize > all.len() => {
            let reason = format!("{n}, but {} has 1 to {}: {}", source.display(), all.len(), listed());
            return Err(Error::Setting { name: "series", reason });
        }
        Some(n) => n as usize - 1,
    };
    let mut sets = if all.is_empty() { Vec::new() } else { all.swap_remove(index).2 };
    let localizer = |set: &Dataset| set.text(IMAGE_TYPE).split('\\').any(|word| word.trim() == "LOCALIZER");
    if !sets.iter().all(localizer) {
        sets.retain(|set| !localizer(set));
    }
    Ok(sets)
}

impl Plane {
    fn of(set: &Dataset, frame: usize) -> Result<Self> {
        let refused = |reason: String| Error::format(&set.path, reason);
        let required = |tag: u32, name: &str| set.u16(tag).ok_or_else(|| refused(format!("has no {name}")));
        let (rows, columns) = (required(ROWS, "number of rows")?, required(COLUMNS, "number of columns")?);
        let channels = set.u16(CHANNELS).unwrap_or(1);
        if channels != 1 {
            return Err(refused(format!("has {channels} channels per sample: save one of them alone")));
        }
        let allocated = u32::from(required(BITS_ALLOCATED, "number of bits")?);
        let stored = set.u16(BITS_STORED).map_or(allocated, u32::from);
        let high = set.u16(HIGH_BIT).map_or(stored.saturating_sub(1), u32::from);
        if !matches!(allocated, 8 | 16 | 32) || stored == 0 || high >= allocated || stored > high + 1 {
            return Err(refused(format!("has {stored} bits up to bit {high} in {allocated}, which is not read")));
        }
        let pixels = Pixels { bytes: allocated / 8, stored, high, signed: set.u16(SIGNED) == Some(1) };
        let [x, y, z, a, b, c] = set.numbers(frame, ORIENTATION).unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let [between_rows, between_columns] = set.numbers(frame, PIXEL_SPACING).unwrap_or([1.0; 2]);
        let directions = [DVec3::new(x, y, z), DVec3::new(a, b, c)];
        Ok(Self { columns, rows, pixels, directions, spacing: [between_columns, between_rows] })
    }
}

/// The slices along the normal of their plane.
fn sorted(source: &Path, sets: &[Dataset], plane: &Plane) -> Result<Vec<Slice>> {
    let normal = plane.directions[0].cross(plane.directions[1]);
    let mut slices = Vec::new();
    for (file, set) in sets.iter().enumerate() {
        let [frames] = set.numbers(0, FRAMES).unwrap_or([1.0]);
        if !(1.0..=f64::from(u16::MAX)).contains(&frames) {
            return Err(Error::format(&set.path, format!("has {frames} frames")));
        }
        for frame in 0..frames as usize {
            let other = Plane::of(set, frame)?;
            let near = |a: DVec3, b: DVec3| a.distance(b) < 1e-3;
            let turned = !(0..2).all(|i| near(other.directions[i], plane.directions[i]));
            let scaled = (0..2).any(|i| (other.spacing[i] / plane.spacing[i] - 1.0).abs() > 1e-3);
            if turned
                || scaled
                || (other.columns, other.rows, other.pixels) != (plane.columns, plane.rows, plane.pixels)
            {
                let of = sets.first().map(|set| set.path.display().to_string()).unwrap_or_default();
                return Err(Error::format(&set.path, format!("has another size, type, spacing or plane than {of}")));
            }
            let position = set.numbers(frame, POSITION).map(DVec3::from_array);
            // Frames without positions follow one another.
            let Some(position) = position.or((sets.len() == 1).then(|| normal * frame as f64)) else {
                return Err(Error::format(&set.path, "has no position"));
            };
            let [slope] = set.numbers(frame, SLOPE).unwrap_or([1.0]);
            let [intercept] = set.numbers(frame, INTERCEPT).unwrap_or([0.0]);
            if slices.len() > usize::from(u16::MAX) {
                return Err(Error::format(source, "has over 65535 slices"));
            }
            slices.push(Slice { file, frame, position, slope, intercept });
        }
    }
    slices.sort_by(|a, b| a.position.dot(normal).total_cmp(&b.position.dot(normal)));
    Ok(slices)
}

/// The position of the lattice, if the slices are the same distance apart.
fn placed(source: &Path, sets: &[Dataset], slices: &[Slice], plane: &Plane) -> Result<Placement> {
    let [along_rows, along_columns] = plane.directions;
    let normal = along_rows.cross(along_columns);
    let (Some(first), Some(last)) = (slices.first(), slices.last()) else {
        return Err(Error::format(source, "has no slices"));
    };
    let name = |slice: &Slice| {
        let file = sets.get(slice.file).and_then(|set| set.path.file_name()).unwrap_or_default();
        file.to_string_lossy().into_owned()
    };
    let mut gaps: Vec<f64> = slices.windows(2).map(|pair| (pair[1].position - pair[0].position).dot(normal)).collect();
    for (pair, gap) in slices.windows(2).zip(&gaps) {
        if gap.abs() < 1e-4 {
            let reason = format!("has two slices at one position: {} and {}", name(&pair[0]), name(&pair[1]));
            return Err(Error::format(source, reason));
        }
    }
    let step = if gaps.is_empty() {
        let single = |tag| sets.first().and_then(|set| set.numbers::<1>(0, tag)).map(|[length]| length);
        normal * single(BETWEEN_SLICES).or(single(SLICE_THICKNESS)).filter(|length| *length > 0.0).unwrap_or(1.0)
    } else {
        let all = gaps.clone();
        gaps.sort_by(f64::total_cmp);
        let usual = gaps[gaps.len() / 2];
        for (pair, gap) in slices.windows(2).zip(all) {
            let (times, between) = ((gap / usual).round(), format!("{} and {}", name(&pair[0]), name(&pair[1])));
            if times >= 2.0 && (gap / usual - times).abs() < 0.05 {
                let reason = format!("{} slices are missing between {between}", times - 1.0);
                return Err(Error::format(source, reason));
            }
            if (gap / usual - 1.0).abs() > 0.02 {
                let reason = format!("slices are unequally spaced: {gap:.4} between {between}, {usual:.4} elsewhere");
                return Err(Error::format(source, reason));
            }
        }
        (last.position - first.position) / (slices.len() - 1) as f64
    };
    for (n, slice) in slices.iter().enumerate() {
        if slice.position.distance(first.position + step * n as f64) > 0.05 * step.length() {
            return Err(Error::format(source, format!("the slice {} is not in a row with the others", name(slice))));
        }
    }
    let length = step.length();
    Ok(Placement {
        directions: [along_rows, along_columns, step / length],
        spacing: [plane.spacing[0], plane.spacing[1], length],
        origin: first.position,
        oriented: sets.first().is_some_and(|set| set.numbers::<6>(0, ORIENTATION).is_some()),
    })
}

/// Where the pixels of a file are: compressed frames, or `None` if they follow one another.
fn pixels_in(source: &Path, sets: &[Dataset], slices: &[Slice], slice_bytes: usize) -> Result<Vec<Option<Frames>>> {
    if slices.is_empty() {
        return Err(Error::format(source, "has no slices"));
    }
    let mut frames_of = vec![0_usize; sets.len()];
    slices.iter().for_each(|slice| frames_of[slice.file] += 1);
    let frames = |(set, frames): (&Dataset, usize)| {
        let refused = |reason: String| Err(Error::format(&set.path, reason));
        match (syntax_of(&set.syntax), set.pixels) {
            (Some((name, None)), _) => {
                refused(format!("is compressed by {name}, which is not read: decompress it first"))
            }
            (Some((_, Some(codec))), Some((start, None))) => Frames::find(set, start, frames, codec).map(Some),
            (Some((name, _)), _) => refused(format!("is compressed by {name}, but its pixels are in no fragments")),
            // Refused before memory is reserved.
            (None, Some((_, Some(length)))) => {
                let needed = frames.saturating_mul(slice_bytes) as u64;
                if length >= needed {
                    return Ok(None);
                }
                refused(format!("is cut short: {frames} frames need {needed} bytes, {length} are there"))
            }
            (None, _) => refused(format!("is in the transfer syntax {}, which is not read", set.syntax)),
        }
    };
    sets.iter().zip(frames_of).map(frames).collect()
}

/// The pixels of a frame as stored: bits beside the pixels are masked, and the sign is extended.
fn pixels_of(set: &Dataset, frames: Option<&Frames>, frame: usize, plane: &Plane) -> Result<Vec<i64>> {
    let pixels = plane.pixels;
    let (columns, rows, width) = (usize::from(plane.columns), usize::from(plane.rows), pixels.bytes as usize);
    let (above, below) = (64 - 1 - pixels.high, 64 - pixels.stored);
    let value = |raw: u64| {
        let raised = raw << above;
        if pixels.signed { raised.cast_signed() >> below } else { (raised >> below).cast_signed() }
    };
    let count = columns * rows;
    let mut values = reserved(count as u64, || samples_in(&set.path))?;
    if let Some(frames) = frames {
        let raw = frames.pixels(set, frame, Size { columns, rows, bytes: width })?;
        values.extend(raw.into_iter().map(value));
        return Ok(values);
    }
    let read_error = |source| Error::Read { path: set.path.clone(), source };
    let mut bytes: Vec<u8> = reserved((count * width) as u64, || samples_in(&set.path))?;
    bytes.resize(count * width, 0);
    let mut file = File::open(&set.path).map_err(read_error)?;
    let start = set.pixels.map_or(0, |(start, _)| start) + (frame * count * width) as u64;
    file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(&mut bytes)).map_err(read_error)?;
    let more = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
    values.extend(bytes.chunks_exact(width).map(|bytes| {
        value(match set.endian {
            Endian::Little => bytes.iter().rev().fold(0, more),
            Endian::Big => bytes.iter().fold(0, more),
        })
    }));
    Ok(values)
}
