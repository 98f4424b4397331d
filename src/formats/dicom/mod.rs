//! DICOM: a file, or the files of a folder (<https://www.dicomstandard.org/current>).
//!
//! Slices are sorted by their position along the normal of their plane, and the positions give the direction and the
//! spacing of the third axis: a tilted gantry makes a sheared lattice. If each position has as many slices as the
//! others, these are points in time, in the order of an index or a time that tells them apart. Secondary captures have
//! no positions: they follow one another by their numbers. Pixels are grey values or colours, uncompressed, in RLE,
//! JPEG (baseline and lossless) or JPEG 2000.

mod dataset;
mod encapsulated;
mod times;

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

use self::dataset::Dataset;
use self::encapsulated::{Codec, Frames, Size, syntax_of};
use self::times::in_times;
use super::decode::{lattice, samples_in};
use super::placement::Placement;
use super::{LoadOptions, MissingSlices, hinted, selection};
use crate::error::{Error, Hint, Result};
use crate::memory::reserved;
use crate::names::{counted, readable};
use crate::volume::{Endian, Samples, Stored, Units, Volume};

const IMAGE_TYPE: u32 = 0x0008_0008;
const SOP_CLASS: u32 = 0x0008_0016;
const MODALITY: u32 = 0x0008_0060;
const SERIES_DESCRIPTION: u32 = 0x0008_103e;
const SLICE_THICKNESS: u32 = 0x0018_0050;
const BETWEEN_SLICES: u32 = 0x0018_0088;
const SERIES_UID: u32 = 0x0020_000e;
const SERIES_NUMBER: u32 = 0x0020_0011;
const POSITION: u32 = 0x0020_0032;
const ORIENTATION: u32 = 0x0020_0037;
const INSTANCE: u32 = 0x0020_0013;
const CHANNELS: u32 = 0x0028_0002;
const PHOTOMETRIC: u32 = 0x0028_0004;
const PLANAR: u32 = 0x0028_0006;
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

/// The SOP classes of secondary captures begin so.
const SECONDARY_CAPTURE: &str = "1.2.840.10008.5.1.4.1.1.7";

/// Whether these are the first bytes of a DICOM file.
pub(super) fn is_dicom(head: &[u8]) -> bool {
    head.get(128..132) == Some(b"DICM")
}

/// One section of a volume.
#[derive(Clone)]
struct Slice {
    /// Among the files.
    file: usize,
    frame: usize,
    position: DVec3,
    slope: f64,
    intercept: f64,
    /// Of a missing slice: the next one that is there, and its share. The rest is that of the slice before.
    behind: Option<(Box<Self>, f64)>,
}

/// What all slices share.
#[derive(PartialEq)]
struct Plane {
    columns: u16,
    rows: u16,
    pixels: Pixels,
    colors: Colors,
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

/// What the samples of a pixel are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Colors {
    Grey,
    /// Red, green and blue; `planar` if each has a plane of its own in a frame.
    Rgb {
        planar: bool,
    },
    /// Luma and the differences of blue and red, of 8 bits (PS3.3, C.7.6.3.1.2).
    Ybr {
        planar: bool,
    },
}

impl Colors {
    fn samples(self) -> usize {
        if self == Self::Grey { 1 } else { 3 }
    }
}

/// Reads the volume of a series in these files.
pub(super) fn read_files(source: &Path, files: &[PathBuf], options: &LoadOptions) -> Result<Volume> {
    let mut sets = files.iter().map(|file| Dataset::read(file)).collect::<Result<Vec<Dataset>>>()?;
    // A report or a directory file has no pixels.
    sets.retain(|set| set.pixels.is_some());
    let sets = chosen(source, sets, options.series)?;
    let Some(first) = sets.first() else { return Err(Error::format(source, "is DICOM without pixels")) };
    let plane = Plane::of(first, 0)?;
    let mut times = in_times(source, &sets, sorted(source, &sets, &plane)?)?;
    let mut contents = selection::chosen(source, options, plane.colors.samples() as u64, times.len() as u64)?;
    if plane.colors != Colors::Grey {
        contents.labels = selection::colours(contents.channels);
    }
    let (slices, channel) = (times.swap_remove(contents.time as usize), contents.channel as usize);
    let slices = match options.missing_slices {
        MissingSlices::Refuse => slices,
        MissingSlices::Interpolate => completed(source, &sets, slices, &plane, &mut contents.notes)?,
    };
    let placement = placed(source, &sets, &slices, &plane)?;
    let dims = lattice(source, &[plane.columns.into(), plane.rows.into(), slices.len() as i64])?;
    let grid = placement.grid(source, dims, options.spacing)?;
    let maps: Vec<(f64, f64)> = slices.iter().map(|slice| (slice.slope, slice.intercept)).collect();
    let same = maps.windows(2).all(|pair| pair[0] == pair[1]);
    let units = Units { length: None, value: (first.text(MODALITY) == "CT").then(|| "HU".to_owned()) };

    let per_slice = usize::from(plane.columns) * usize::from(plane.rows);
    let slice_bytes = per_slice * plane.pixels.bytes as usize * plane.colors.samples();
    let frames = pixels_in(source, &sets, &slices, slice_bytes)?;
    let count = grid.len();
    let what = || samples_in(source);
    let raw = |slice: &Slice| pixels_of(&sets[slice.file], frames[slice.file].as_ref(), slice.frame, &plane, channel);
    let read = |slice: &Slice, value: fn(&Slice, i64) -> f64| -> Result<Vec<f64>> {
        let near = raw(slice)?.into_iter().map(|raw| value(slice, raw));
        Ok(match &slice.behind {
            None => near.collect(),
            Some((next, share)) => near.zip(raw(next)?).map(|(a, b)| a + (value(next, b) - a) * share).collect(),
        })
    };
    macro_rules! whole {
        ($variant:ident $t:ty) => {{
            let mut all: Vec<$t> = reserved(count, what)?;
            for slice in &slices {
                all.extend(read(slice, |_, raw| raw as f64)?.into_iter().map(|value| value.round() as $t));
            }
            Samples::$variant(all)
        }};
    }
    let samples = match (same, plane.pixels.bytes, plane.pixels.signed) {
        (false, ..) => {
            let mut all: Vec<f32> = reserved(count, what)?;
            for slice in &slices {
                let values = read(slice, |of, raw| of.slope * raw as f64 + of.intercept)?;
                all.extend(values.into_iter().map(|value| value as f32));
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
            let files = counted(sets.len() as u64, "file");
            format!("{} is {} {:?} of {files}", n + 1, text(MODALITY), text(SERIES_DESCRIPTION))
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
        let planar = set.u16(PLANAR) == Some(1);
        let photometric = set.text(PHOTOMETRIC);
        // Codecs of colours give red, green and blue; run lengths and lossless JPEG are none.
        let is_lossless = ["1.2.840.10008.1.2.4.57", "1.2.840.10008.1.2.4.70"].contains(&set.syntax.as_str());
        let by_codec = !is_lossless && syntax_of(&set.syntax).is_some_and(|(_, codec)| codec != Some(Codec::Rle));
        let colors = match (set.u16(CHANNELS).unwrap_or(1), photometric.as_str()) {
            (1, "PALETTE COLOR") => {
                return Err(refused("is in a palette of colours, which is not read: convert it to RGB".to_owned()));
            }
            (1, _) => Colors::Grey,
            (3, "RGB" | "YBR_ICT" | "YBR_RCT") => Colors::Rgb { planar },
            (3, "YBR_FULL" | "YBR_FULL_422" | "YBR_PARTIAL_420") if by_codec => Colors::Rgb { planar },
            (3, "YBR_FULL") => Colors::Ybr { planar },
            (channels, photometric) => {
                let what = format!("{channels} samples per pixel of the kind {photometric:?}");
                return Err(refused(format!("has {what}: expected grey values, RGB or YBR_FULL")));
            }
        };
        let allocated = u32::from(required(BITS_ALLOCATED, "number of bits")?);
        let stored = set.u16(BITS_STORED).map_or(allocated, u32::from);
        let high = set.u16(HIGH_BIT).map_or(stored.saturating_sub(1), u32::from);
        if !matches!(allocated, 8 | 16 | 32) || stored == 0 || high >= allocated || stored > high + 1 {
            return Err(refused(format!("has {stored} bits up to bit {high} in {allocated}, which is not read")));
        }
        let pixels = Pixels { bytes: allocated / 8, stored, high, signed: set.u16(SIGNED) == Some(1) };
        if matches!(colors, Colors::Ybr { .. }) && (stored, pixels.signed) != (8, false) {
            return Err(refused(format!("has {stored} bits of YBR_FULL, expected 8 without sign")));
        }
        let [x, y, z, a, b, c] = set.numbers(frame, ORIENTATION).unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let [between_rows, between_columns] = set.numbers(frame, PIXEL_SPACING).unwrap_or([1.0; 2]);
        let directions = [DVec3::new(x, y, z), DVec3::new(a, b, c)];
        Ok(Self { columns, rows, pixels, colors, directions, spacing: [between_columns, between_rows] })
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
                || other.colors != plane.colors
            {
                let of = sets.first().map(|set| set.path.display().to_string()).unwrap_or_default();
                return Err(Error::format(&set.path, format!("has another size, type, spacing or plane than {of}")));
            }
            let position = set.numbers(frame, POSITION).map(DVec3::from_array);
            // Frames without positions follow one another, and so do secondary captures by their numbers.
            let number = || match sets.len() {
                1 => Some(frame as f64),
                _ if frames == 1.0 && set.text(SOP_CLASS).starts_with(SECONDARY_CAPTURE) => {
                    set.numbers(0, INSTANCE).map(|[number]| number)
                }
                _ => None,
            };
            let Some(position) = position.or_else(|| number().map(|number| normal * number)) else {
                return Err(Error::format(&set.path, "has no position"));
            };
            let [slope] = set.numbers(frame, SLOPE).unwrap_or([1.0]);
            let [intercept] = set.numbers(frame, INTERCEPT).unwrap_or([0.0]);
            if slices.len() > usize::from(u16::MAX) {
                return Err(Error::format(source, "has over 65535 slices"));
            }
            slices.push(Slice { file, frame, position, slope, intercept, behind: None });
        }
    }
    slices.sort_by(|a, b| a.position.dot(normal).total_cmp(&b.position.dot(normal)));
    Ok(slices)
}

/// The least distance of slices that are not at one position, world units.
const APART: f64 = 1e-4;

/// The name of the file that a slice is in.
fn name_of(sets: &[Dataset], slice: &Slice) -> String {
    let file = sets.get(slice.file).and_then(|set| set.path.file_name()).unwrap_or_default();
    file.to_string_lossy().into_owned()
}

/// The number of slices that a gap lacks, where slices are usually so far apart.
fn missing_in(gap: f64, usual: f64) -> u64 {
    let times = (gap / usual).round();
    if times >= 2.0 && (gap / usual - times).abs() < 0.05 { times as u64 - 1 } else { 0 }
}

/// What is said of the slices that are missing between two, if any are.
fn missing(sets: &[Dataset], pair: &[Slice], normal: DVec3, usual: f64) -> Option<String> {
    let [before, after] = pair else { return None };
    let way = after.position - before.position;
    let count = missing_in(way.dot(normal), usual);
    let place = |n: u64| {
        let position = before.position + way * (n as f64 / (count + 1) as f64);
        position.to_array().map(readable).join(",")
    };
    let (are, at) = match count {
        0 => return None,
        1 => ("slice is", format!("at {}", place(1))),
        _ => ("slices are", format!("from {} to {}", place(1), place(count))),
    };
    let [before, after] = [before, after].map(|slice| name_of(sets, slice));
    Some(format!("{count} {are} missing between {before} and {after}, {at}"))
}

/// The slices with those that are missing between them, which are interpolated; `notes` says so.
fn completed(
    source: &Path,
    sets: &[Dataset],
    slices: Vec<Slice>,
    plane: &Plane,
    notes: &mut Vec<String>,
) -> Result<Vec<Slice>> {
    let normal = plane.directions[0].cross(plane.directions[1]);
    let gap = |pair: &[Slice]| (pair[1].position - pair[0].position).dot(normal);
    let mut gaps: Vec<f64> = slices.windows(2).map(gap).collect();
    gaps.sort_by(f64::total_cmp);
    let Some(&usual) = gaps.get(gaps.len() / 2).filter(|usual| **usual >= APART) else { return Ok(slices) };
    let lacking =
        slices.windows(2).map(|pair| missing_in(gap(pair), usual)).fold(slices.len() as u64, u64::saturating_add);
    if lacking > u64::from(u16::MAX) {
        return Err(Error::format(source, "has over 65535 slices with those that are missing"));
    }
    let mut all = Vec::new();
    for pair in slices.windows(2) {
        let [before, after] = pair else { continue };
        all.push(before.clone());
        let count = missing_in(gap(pair), usual);
        all.extend((1..=count).map(|n| {
            let share = n as f64 / (count + 1) as f64;
            let position = before.position.lerp(after.position, share);
            Slice { position, behind: Some((Box::new(after.clone()), share)), ..before.clone() }
        }));
        notes.extend(missing(sets, pair, normal, usual).map(|said| said + ": interpolated between their neighbours"));
    }
    all.extend(slices.last().cloned());
    Ok(all)
}

/// The position of the lattice, if the slices are the same distance apart.
fn placed(source: &Path, sets: &[Dataset], slices: &[Slice], plane: &Plane) -> Result<Placement> {
    let [along_rows, along_columns] = plane.directions;
    let normal = along_rows.cross(along_columns);
    let (Some(first), Some(last)) = (slices.first(), slices.last()) else {
        return Err(Error::format(source, "has no slices"));
    };
    let name = |slice: &Slice| name_of(sets, slice);
    let mut gaps: Vec<f64> = slices.windows(2).map(|pair| (pair[1].position - pair[0].position).dot(normal)).collect();
    for (pair, gap) in slices.windows(2).zip(&gaps) {
        if gap.abs() < APART {
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
            let between = format!("{} and {}", name(&pair[0]), name(&pair[1]));
            if missing_in(gap, usual) > 0 {
                let all = slices.windows(2).filter_map(|pair| missing(sets, pair, normal, usual));
                let reason = all.collect::<Vec<String>>().join("; ");
                return Err(hinted(Error::format(source, reason), Hint::InterpolateSlices));
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
    slices.iter().filter(|slice| slice.behind.is_none()).for_each(|slice| frames_of[slice.file] += 1);
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
                let need = if frames == 1 { "frame needs" } else { "frames need" };
                refused(format!("is cut short: {frames} {need} {needed} bytes, {length} are there"))
            }
            (None, _) => refused(format!("is in the transfer syntax {}, which is not read", set.syntax)),
        }
    };
    sets.iter().zip(frames_of).map(frames).collect()
}

/// The samples of a channel of a frame as stored: bits beside them are masked, and the sign is extended.
fn pixels_of(set: &Dataset, frames: Option<&Frames>, frame: usize, plane: &Plane, channel: usize) -> Result<Vec<i64>> {
    let (pixels, colors) = (plane.pixels, plane.colors);
    let (columns, rows, width) = (usize::from(plane.columns), usize::from(plane.rows), pixels.bytes as usize);
    let (above, below) = (64 - 1 - pixels.high, 64 - pixels.stored);
    let value = |raw: u64| {
        let raised = raw << above;
        if pixels.signed { raised.cast_signed() >> below } else { (raised >> below).cast_signed() }
    };
    let (area, samples) = (columns * rows, colors.samples());
    let count = area * samples;
    let mut all: Vec<u64> = reserved(count as u64, || samples_in(&set.path))?;
    // Codecs give the samples of a pixel beside each other.
    let mut is_planar = false;
    if let Some(frames) = frames {
        let is_rgb = set.text(PHOTOMETRIC) == "RGB";
        all = frames.pixels(set, frame, Size { columns, rows, samples, bytes: width, is_rgb })?;
    } else {
        is_planar = matches!(colors, Colors::Rgb { planar: true } | Colors::Ybr { planar: true });
        let read_error = |source| Error::Read { path: set.path.clone(), source };
        let mut bytes: Vec<u8> = reserved((count * width) as u64, || samples_in(&set.path))?;
        bytes.resize(count * width, 0);
        let mut file = File::open(&set.path).map_err(read_error)?;
        let start = set.pixels.map_or(0, |(start, _)| start) + (frame * count * width) as u64;
        file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(&mut bytes)).map_err(read_error)?;
        let more = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        all.extend(bytes.chunks_exact(width).map(|bytes| match set.endian {
            Endian::Little => bytes.iter().rev().fold(0, more),
            Endian::Big => bytes.iter().fold(0, more),
        }));
    }
    let sample = |pixel: usize, channel: usize| {
        value(all[if is_planar { channel * area + pixel } else { pixel * samples + channel }])
    };
    let mut values = reserved(area as u64, || samples_in(&set.path))?;
    match colors {
        Colors::Ybr { .. } => values.extend((0..area).map(|pixel| {
            let [y, cb, cr] = [0, 1, 2].map(|channel| sample(pixel, channel) as f64);
            let (blue, red) = (cb - 128.0, cr - 128.0);
            let of = [y + 1.402 * red, y - 0.344_136 * blue - 0.714_136 * red, y + 1.772 * blue];
            of[channel].round().clamp(0.0, 255.0) as i64
        })),
        Colors::Grey | Colors::Rgb { .. } => values.extend((0..area).map(|pixel| sample(pixel, channel))),
    }
    Ok(values)
}
