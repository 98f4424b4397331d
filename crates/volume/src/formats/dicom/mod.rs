//! DICOM: a file, or the files of a folder (<https://www.dicomstandard.org/current>).
//!
//! Slices are sorted by their position along the normal of their plane, and the positions give the direction and the
//! spacing of the third axis: a tilted gantry makes a sheared lattice. If each position has as many slices as the
//! others, these are points in time, in the order of an index or a time that tells them apart. Secondary captures have
//! no positions: they follow one another by their numbers. The frames of a dose of radiotherapy have offsets along the
//! normal. Segmentations have a module of their own. Pixels are grey values, colours, entries of a palette or single
//! bits; uncompressed, in RLE, JPEG (baseline and lossless), JPEG-LS or JPEG 2000. Elements may be deflated, and files
//! in gzip.

mod dataset;
mod encapsulated;
mod palette;
mod segmentation;
mod times;

use std::io::SeekFrom;
use std::path::{Path, PathBuf};

use glam::DVec3;

use self::dataset::Dataset;
use self::encapsulated::{Codec, DECOMPRESS, Frames, Size, syntax_of};
use self::palette::Table;
use self::times::in_times;
use super::placement::{Placement, plain_name};
use super::{LoadOptions, MissingSlices, Series, selection};
use crate::error::{Error, Hint, Result, Subject, refuse, refuse_if};
use crate::memory::{reserved, samples_in};
use crate::names::{counted, readable};
use crate::volume::{Endian, Origin, Samples, Units, Volume};

const IMAGE_TYPE: u32 = 0x0008_0008;
const SOP_CLASS: u32 = 0x0008_0016;
const STUDY_DATE: u32 = 0x0008_0020;
const SERIES_DATE: u32 = 0x0008_0021;
const ACQUISITION_DATE: u32 = 0x0008_0022;
const MODALITY: u32 = 0x0008_0060;
const SERIES_DESCRIPTION: u32 = 0x0008_103e;
const PROTOCOL: u32 = 0x0018_1030;
const SEQUENCE: u32 = 0x0018_0024;
const ANGIO: u32 = 0x0018_0025;
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
const DOSE_UNITS: u32 = 0x3004_0002;
const FRAME_OFFSETS: u32 = 0x3004_000c;
const DOSE_SCALING: u32 = 0x3004_000e;

/// The beginning of the SOP classes of secondary captures.
const SECONDARY_CAPTURE: &str = "1.2.840.10008.5.1.4.1.1.7";

/// One section of a volume.
#[derive(Clone)]
struct Slice {
    /// Among the files.
    file: usize,
    frame: usize,
    position: DVec3,
    slope: f64,
    intercept: f64,
    /// The next slice that is there and its weight, if this slice is missing; the slice before has the rest.
    behind: Option<(Box<Self>, f64)>,
}

/// The properties that all slices share.
struct Plane {
    columns: u16,
    rows: u16,
    pixels: Pixels,
    colors: Colors,
    /// Whether each colour has a plane of its own in a frame.
    planar: bool,
    /// Bytes of a sample in the volume.
    bytes: u32,
    /// Directions of rows and columns.
    directions: [DVec3; 2],
    /// Distances between columns and between rows.
    spacing: [f64; 2],
}

/// The bits of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Pixels {
    /// Bits of a sample: 1, 8, 16 or 32.
    allocated: u32,
    stored: u32,
    high: u32,
    signed: bool,
}

/// The meaning of the samples of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Colors {
    Grey,
    /// Red, green and blue.
    Rgb,
    /// Luma and the differences of blue and red, of 8 bits (PS3.3, C.7.6.3.1.2).
    Ybr,
    /// Two of luma, and the differences that both pixels have, of 8 bits.
    Ybr422,
    /// An index into tables of red, green and blue.
    Palette,
}

impl Colors {
    /// The samples of a pixel in the file.
    fn stored(self) -> usize {
        match self {
            Self::Grey | Self::Palette => 1,
            Self::Ybr422 => 2,
            Self::Rgb | Self::Ybr => 3,
        }
    }

    /// The samples of a pixel in the volume.
    fn channels(self) -> u32 {
        if self == Self::Grey { 1 } else { 3 }
    }
}

/// Reads the volume of a series in these files.
pub(super) fn read_files(source: &Path, files: &[PathBuf], options: &LoadOptions) -> Result<Volume> {
    let mut sets = files.iter().map(|file| Dataset::read(file)).collect::<Result<Vec<Dataset>>>()?;
    // A report or a directory file has no pixels.
    sets.retain(|set| set.pixels.is_some());
    let sets = chosen(source, sets, options.series)?;
    let Some(first) = sets.first() else { refuse!(source, "is DICOM without pixels") };
    if segmentation::is_one(first) {
        return segmentation::read(source, &sets, options);
    }
    let plane = Plane::of(first, 0)?;
    let mut times = in_times(source, &sets, sorted(source, &sets, &plane)?)?;
    let mut contents = selection::chosen(source, options, plane.colors.channels().into(), times.len() as u64)?;
    if plane.colors != Colors::Grey {
        contents.labels = selection::colours(contents.channels);
    }
    let (slices, channel) = (times.swap_remove(contents.time as usize), contents.channel as usize);
    let slices = match options.missing_slices {
        MissingSlices::Refuse => slices,
        MissingSlices::Interpolate => {
            let (slices, notes) = completed(source, &sets, slices, plane.normal())?;
            contents.notes.extend(notes);
            slices
        }
    };
    let placement = placed(source, &sets, &slices, &plane)?;
    let sizes = [plane.columns.into(), plane.rows.into(), slices.len() as i64];
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
    let raw = |slice: &Slice| pixels_of(&sets[slice.file], frames[slice.file].as_ref(), slice.frame, &plane, channel);
    let value = |slice: &Slice, raw: i64| if same { raw as f64 } else { slice.slope * raw as f64 + slice.intercept };
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
    let samples = match (same, plane.bytes, signed) {
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

/// The files of each series, in the order of their numbers.
fn by_series(sets: Vec<Dataset>) -> Vec<Vec<Dataset>> {
    let mut all: Vec<(i64, String, Vec<Dataset>)> = Vec::new();
    for set in sets {
        let uid = set.text(SERIES_UID);
        match all.iter_mut().find(|(_, known, _)| *known == uid) {
            Some((.., sets)) => sets.push(set),
            None => all.push((set.text(SERIES_NUMBER).parse().unwrap_or(i64::MAX), uid, vec![set])),
        }
    }
    all.sort_by(|a, b| (a.0, &a.1).cmp(&(b.0, &b.1)));
    all.into_iter().map(|(.., sets)| sets).collect()
}

/// The files of a series without localizers, if there are others.
fn without_localizers(mut sets: Vec<Dataset>) -> Vec<Dataset> {
    let localizer = |set: &Dataset| set.text(IMAGE_TYPE).split('\\').any(|word| word.trim() == "LOCALIZER");
    if !sets.iter().all(localizer) {
        sets.retain(|set| !localizer(set));
    }
    sets
}

/// The most series that an error lists.
const MOST_LISTED: usize = 4;

/// The files of one series.
fn chosen(source: &Path, sets: Vec<Dataset>, series: Option<u32>) -> Result<Vec<Dataset>> {
    let mut all = by_series(sets);
    let listed = || {
        let line = |(n, sets): (usize, &Vec<Dataset>)| {
            let text = |tag| sets.first().map(|set| set.text(tag)).unwrap_or_default();
            let files = counted(sets.len() as u64, "file");
            format!("{} is {} {:?} of {files}", n + 1, text(MODALITY), text(SERIES_DESCRIPTION))
        };
        let lines: Vec<String> = all.iter().enumerate().take(MOST_LISTED).map(line).collect();
        let others = all.len() - lines.len();
        lines.join(", ") + &if others > 0 { format!(", and {others} others") } else { String::new() }
    };
    let index = match series {
        None if all.len() > 1 => {
            let reason = format!("holds {} series: {}", all.len(), listed());
            return Err(source.error(reason).hinted(Hint::ChooseSeries));
        }
        None => 0,
        Some(n) if n == 0 || n as usize > all.len() => {
            let (path, count) = (source.display(), all.len());
            return Err(Error::setting("series", format!("{n}, but {path} has 1 to {count}: {}", listed())));
        }
        Some(n) => n as usize - 1,
    };
    Ok(if all.is_empty() { Vec::new() } else { without_localizers(all.swap_remove(index)) })
}

/// Describes the series in these files.
pub(super) fn series(source: &Path, files: &[PathBuf]) -> Result<Vec<Series>> {
    let mut sets = files.iter().map(|file| Dataset::read(file)).collect::<Result<Vec<Dataset>>>()?;
    sets.retain(|set| set.pixels.is_some());
    let described = |(n, sets): (usize, Vec<Dataset>)| {
        let text = |tag| {
            let plain = |set: &Dataset| plain_name(&set.text(tag)).unwrap_or_default();
            sets.first().map(plain).unwrap_or_default()
        };
        let (modality, description, uid) = (text(MODALITY), text(SERIES_DESCRIPTION), text(SERIES_UID));
        let date = [SERIES_DATE, ACQUISITION_DATE, STUDY_DATE].map(text).into_iter().find(|date| !date.is_empty());
        let files = sets.len() as u32;
        let lattice = lattice_of(source, &without_localizers(sets)).ok();
        Series {
            number: n as u32 + 1,
            modality,
            description,
            files,
            dims: lattice.map(|(dims, ..)| dims),
            times: lattice.map_or(1, |(.., times)| times),
            spacing: lattice.map(|(_, spacing, _)| spacing),
            date,
            uid,
        }
    };
    Ok(by_series(sets).into_iter().enumerate().map(described).collect())
}

/// The samples of a series along each axis, their distances, and the number of points in time.
fn lattice_of(source: &Path, sets: &[Dataset]) -> Result<([u32; 3], [f64; 3], u32)> {
    let Some(first) = sets.first() else { refuse!(source, "is DICOM without pixels") };
    let plane = Plane::of(first, 0)?;
    let (slices, step, times) = match (segmentation::is_one(first), sets) {
        (true, [set]) => segmentation::lattice_of(set, &plane)?,
        _ => {
            let times = in_times(source, sets, sorted(source, sets, &plane)?)?;
            let slices = times.first().map(Vec::as_slice).unwrap_or_default();
            let usual = gaps(slices, plane.normal()).map(|(_, usual)| usual);
            (slices.len() as u64, usual.unwrap_or_else(|| single_gap(first)), times.len() as u32)
        }
    };
    let [dx, dy] = plane.spacing;
    Ok(([plane.columns.into(), plane.rows.into(), slices as u32], [dx, dy, step], times))
}

/// The distance of slices that the file of a single slice states, or its thickness.
fn single_gap(set: &Dataset) -> f64 {
    let stated = |tag| set.numbers::<1>(0, tag).map(|[length]| length).filter(|length| *length > 0.0);
    stated(BETWEEN_SLICES).or(stated(SLICE_THICKNESS)).unwrap_or(1.0)
}

impl Plane {
    fn of(set: &Dataset, frame: usize) -> Result<Self> {
        let required = |tag: u32, name: &str| set.u16(tag).ok_or_else(|| set.error(format!("has no {name}")));
        let (rows, columns) = (required(ROWS, "number of rows")?, required(COLUMNS, "number of columns")?);
        let photometric = set.text(PHOTOMETRIC);
        // Codecs of colours give red, green and blue; run lengths and lossless JPEG are none.
        let is_lossless = ["1.2.840.10008.1.2.4.57", "1.2.840.10008.1.2.4.70"].contains(&set.syntax.as_str());
        let by_codec = !is_lossless && syntax_of(&set.syntax).is_some_and(|(_, codec)| codec != Some(Codec::Rle));
        let colors = match (set.u16(CHANNELS).unwrap_or(1), photometric.as_str()) {
            (1, "PALETTE COLOR") => Colors::Palette,
            (1, _) => Colors::Grey,
            (3, "RGB" | "YBR_ICT" | "YBR_RCT") => Colors::Rgb,
            (3, "YBR_FULL" | "YBR_FULL_422" | "YBR_PARTIAL_420") if by_codec => Colors::Rgb,
            (3, "YBR_FULL_422") if syntax_of(&set.syntax).is_none() => {
                refuse_if!(columns % 2 == 1, set, "has {columns} columns of YBR_FULL_422, expected an even number");
                Colors::Ybr422
            }
            (3, "YBR_FULL" | "YBR_FULL_422") => Colors::Ybr,
            (channels, photometric) => {
                let expected = "grey values, a palette, RGB, YBR_FULL or YBR_FULL_422";
                refuse!(set, "has {channels} samples per pixel of the kind {photometric:?}: expected {expected}")
            }
        };
        let allocated = u32::from(required(BITS_ALLOCATED, "number of bits")?);
        let stored = set.u16(BITS_STORED).map_or(allocated, u32::from);
        let high = set.u16(HIGH_BIT).map_or(stored.saturating_sub(1), u32::from);
        let is_packed = allocated == 1 && (colors != Colors::Grey || syntax_of(&set.syntax).is_some());
        if !matches!(allocated, 1 | 8 | 16 | 32) || is_packed || stored == 0 || high >= allocated || stored > high + 1 {
            refuse!(set, "has {stored} bits up to bit {high} in {allocated}, which is not read");
        }
        let pixels = Pixels { allocated, stored, high, signed: set.u16(SIGNED) == Some(1) };
        let is_chroma = matches!(colors, Colors::Ybr | Colors::Ybr422);
        if is_chroma && (allocated, stored, pixels.signed) != (8, 8, false) {
            refuse!(set, "has {stored} bits of {photometric}, expected 8 without sign");
        }
        let [x, y, z, a, b, c] = set.numbers(frame, ORIENTATION).unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let [between_rows, between_columns] = set.numbers(frame, PIXEL_SPACING).unwrap_or([1.0; 2]);
        let directions = [DVec3::new(x, y, z), DVec3::new(a, b, c)];
        let planar = set.u16(PLANAR) == Some(1) && matches!(colors, Colors::Rgb | Colors::Ybr);
        let bytes = if colors == Colors::Palette { palette::bytes_of_entries(set)? } else { allocated.div_ceil(8) };
        let spacing = [between_columns, between_rows];
        Ok(Self { columns, rows, pixels, colors, planar, bytes, directions, spacing })
    }

    /// The normal of the plane.
    fn normal(&self) -> DVec3 {
        self.directions[0].cross(self.directions[1])
    }

    /// The bits of an uncompressed frame.
    fn frame_bits(&self) -> u64 {
        let samples = u64::from(self.columns) * u64::from(self.rows) * self.colors.stored() as u64;
        samples * u64::from(self.pixels.allocated)
    }
}

/// The places of the frames of a dose along the normal of their plane, from the position of the file (PS3.3,
/// C.8.8.3.2); `None` if it states none.
fn dose_offsets(set: &Dataset, normal: DVec3, frames: usize) -> Result<Option<Vec<f64>>> {
    if frames == 1 || set.value(FRAME_OFFSETS).is_none_or(<[u8]>::is_empty) {
        return Ok(None);
    }
    let Some(mut offsets) = set.list(FRAME_OFFSETS) else {
        refuse!(set, "has offsets of frames that are no numbers");
    };
    refuse_if!(offsets.len() != frames, set, "has offsets of {} frames, expected {frames}", offsets.len());
    // Offsets that do not begin with 0 are coordinates along z, which transverse planes may have.
    let start = set.numbers(0, POSITION).map_or(0.0, |[_, _, z]: [f64; 3]| z);
    let first = offsets.first().copied().unwrap_or(0.0);
    if first != 0.0 && normal.z.abs() > 1.0 - 1e-6 && (first - start).abs() < 1e-3 {
        offsets.iter_mut().for_each(|offset| *offset = (*offset - start) * normal.z.signum());
    }
    Ok(Some(offsets))
}

/// The slices along the normal of their plane.
fn sorted(source: &Path, sets: &[Dataset], plane: &Plane) -> Result<Vec<Slice>> {
    let normal = plane.normal();
    let mut slices = Vec::new();
    for (file, set) in sets.iter().enumerate() {
        let [frames] = set.numbers(0, FRAMES).unwrap_or([1.0]);
        refuse_if!(!(1.0..=f64::from(u16::MAX)).contains(&frames), set, "has {frames} frames");
        let offsets = dose_offsets(set, normal, frames as usize)?;
        for frame in 0..frames as usize {
            let other = Plane::of(set, frame)?;
            let near = |a: DVec3, b: DVec3| a.distance(b) < 1e-3;
            let turned = !(0..2).all(|i| near(other.directions[i], plane.directions[i]));
            let scaled = (0..2).any(|i| (other.spacing[i] / plane.spacing[i] - 1.0).abs() > 1e-3);
            let kind = |p: &Plane| (p.columns, p.rows, p.pixels, p.colors, p.planar, p.bytes);
            if turned || scaled || kind(&other) != kind(plane) {
                let of = sets.first().map(|set| set.path.display().to_string()).unwrap_or_default();
                refuse!(set, "has another size, type, spacing or plane than {of}");
            }
            let offset = offsets.as_ref().and_then(|offsets| offsets.get(frame).copied()).unwrap_or(0.0);
            let position = set.numbers(frame, POSITION).map(|place| DVec3::from_array(place) + normal * offset);
            // Frames without positions follow one another, and so do secondary captures by their numbers.
            let number = || match sets.len() {
                1 => Some(frame as f64),
                _ if frames == 1.0 && set.text(SOP_CLASS).starts_with(SECONDARY_CAPTURE) => {
                    set.numbers(0, INSTANCE).map(|[number]| number)
                }
                _ => None,
            };
            let Some(position) = position.or_else(|| number().map(|number| normal * number)) else {
                refuse!(set, "has no position");
            };
            let [slope] = set.numbers(frame, SLOPE).or_else(|| set.numbers(0, DOSE_SCALING)).unwrap_or([1.0]);
            let [intercept] = set.numbers(frame, INTERCEPT).unwrap_or([0.0]);
            refuse_if!(slices.len() > usize::from(u16::MAX), source, "has over 65535 slices");
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

/// The number of slices missing in a gap, from the usual distance of slices.
fn missing_in(gap: f64, usual: f64) -> u64 {
    let times = (gap / usual).round();
    if times >= 2.0 && (gap / usual - times).abs() < 0.05 { times as u64 - 1 } else { 0 }
}

/// A sentence about the slices that are missing between two; `None` if there are none.
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

/// The distances of neighbouring slices along the normal of their plane, and the usual one; `None` of one slice.
fn gaps(slices: &[Slice], normal: DVec3) -> Option<(Vec<f64>, f64)> {
    let gap = |pair: &[Slice]| (pair[1].position - pair[0].position).dot(normal);
    let gaps: Vec<f64> = slices.windows(2).map(gap).collect();
    let mut sorted = gaps.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = *sorted.get(sorted.len() / 2)?;
    Some((gaps, usual))
}

/// Slices, and notes about them.
type Noted = (Vec<Slice>, Vec<String>);

/// Adds interpolated slices in place of missing ones, and returns notes about them.
fn completed(source: &Path, sets: &[Dataset], slices: Vec<Slice>, normal: DVec3) -> Result<Noted> {
    let Some((gaps, usual)) = gaps(&slices, normal).filter(|(_, usual)| *usual >= APART) else {
        return Ok((slices, Vec::new()));
    };
    let counts: Vec<u64> = gaps.iter().map(|gap| missing_in(*gap, usual)).collect();
    let lacking = counts.iter().fold(slices.len() as u64, |sum, count| sum.saturating_add(*count));
    refuse_if!(lacking > u64::from(u16::MAX), source, "has over 65535 slices with those that are missing");
    let (mut all, mut notes) = (Vec::new(), Vec::new());
    for (pair, count) in slices.windows(2).zip(counts) {
        let [before, after] = pair else { continue };
        all.push(before.clone());
        all.extend((1..=count).map(|n| {
            let share = n as f64 / (count + 1) as f64;
            let position = before.position.lerp(after.position, share);
            Slice { position, behind: Some((Box::new(after.clone()), share)), ..before.clone() }
        }));
        notes.extend(missing(sets, pair, normal, usual).map(|said| said + ": interpolated between their neighbours"));
    }
    all.extend(slices.last().cloned());
    Ok((all, notes))
}

/// The position of the lattice, if the slices are the same distance apart.
fn placed(source: &Path, sets: &[Dataset], slices: &[Slice], plane: &Plane) -> Result<Placement> {
    let ([along_rows, along_columns], normal) = (plane.directions, plane.normal());
    let (Some(first), Some(last)) = (slices.first(), slices.last()) else { refuse!(source, "has no slices") };
    let name = |slice: &Slice| name_of(sets, slice);
    let step = if let Some((gaps, usual)) = gaps(slices, normal) {
        for (pair, gap) in slices.windows(2).zip(&gaps) {
            if gap.abs() < APART {
                refuse!(source, "has two slices at one position: {} and {}", name(&pair[0]), name(&pair[1]));
            }
        }
        let missing: Vec<String> = slices.windows(2).filter_map(|pair| missing(sets, pair, normal, usual)).collect();
        if !missing.is_empty() {
            return Err(source.error(missing.join("; ")).hinted(Hint::InterpolateSlices));
        }
        for (pair, gap) in slices.windows(2).zip(&gaps) {
            if (gap / usual - 1.0).abs() > 0.02 {
                let between = format!("{} and {}", name(&pair[0]), name(&pair[1]));
                refuse!(source, "slices are unequally spaced: {gap:.4} between {between}, {usual:.4} elsewhere");
            }
        }
        (last.position - first.position) / (slices.len() - 1) as f64
    } else {
        normal * sets.first().map_or(1.0, single_gap)
    };
    for (n, slice) in slices.iter().enumerate() {
        if slice.position.distance(first.position + step * n as f64) > 0.05 * step.length() {
            refuse!(source, "the slice {} is not in a row with the others", name(slice));
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

/// The compressed frames of each file; `None` if its frames are uncompressed.
fn pixels_in(source: &Path, sets: &[Dataset], slices: &[Slice], frame_bits: u64) -> Result<Vec<Option<Frames>>> {
    refuse_if!(slices.is_empty(), source, "has no slices");
    let mut is_used = vec![false; sets.len()];
    slices.iter().for_each(|slice| is_used[slice.file] = true);
    let frames = |(set, is_used): (&Dataset, bool)| if is_used { frames_in(set, frame_bits) } else { Ok(None) };
    sets.iter().zip(is_used).map(frames).collect()
}

/// The compressed frames of a file, also those at other points in time; `None` if they are uncompressed, and all there.
fn frames_in(set: &Dataset, frame_bits: u64) -> Result<Option<Frames>> {
    let frames = set.numbers(0, FRAMES).map_or(1, |[frames]| frames as usize);
    match (syntax_of(&set.syntax), set.pixels) {
        (Some((name, None)), _) => {
            refuse!(set, "is compressed by {name} ({}), which is not read: {DECOMPRESS}", set.syntax)
        }
        (Some((_, Some(codec))), Some((_, None))) => Frames::find(set, frames, codec).map(Some),
        (Some((name, _)), _) => refuse!(set, "is compressed by {name}, but its pixels are in no fragments"),
        // Refused before memory is reserved.
        (None, Some((_, Some(length)))) => {
            let needed = (frames as u64).saturating_mul(frame_bits).div_ceil(8);
            let need = if frames == 1 { "frame needs" } else { "frames need" };
            let is_short = length < needed;
            refuse_if!(is_short, set, "is cut short: {frames} {need} {needed} bytes, {length} are there");
            Ok(None)
        }
        (None, _) => refuse!(set, "is in the transfer syntax {}, which is not read: {DECOMPRESS}", set.syntax),
    }
}

/// The bits before the first of a frame in its first byte: single bits follow one another over the ends of frames.
fn bits_before(frame: usize, plane: &Plane) -> usize {
    (frame as u64 * plane.frame_bits() % 8) as usize
}

/// The bytes of an uncompressed frame.
fn bytes_of(set: &Dataset, frame: usize, plane: &Plane) -> Result<Vec<u8>> {
    let first = frame as u64 * plane.frame_bits();
    let (start, end) = (first / 8, (first + plane.frame_bits()).div_ceil(8));
    // Bytes in words are read in pairs, from the highest to the lowest.
    let is_swapped = set.in_words && set.endian == Endian::Big && plane.pixels.allocated <= 8;
    let before = if is_swapped { start % 2 } else { 0 };
    let (from, to) = (start - before, if is_swapped { end.next_multiple_of(2) } else { end });
    let (pixels_at, pixels_end) = match set.pixels {
        Some((at, length)) => (at, length.unwrap_or(u64::MAX)),
        None => (0, u64::MAX),
    };
    let length = to.min(pixels_end).saturating_sub(from);
    let mut bytes: Vec<u8> = reserved(length, || samples_in(&set.path))?;
    bytes.resize(length as usize, 0);
    let mut file = set.open().map_err(Error::read(&set.path))?;
    file.seek(SeekFrom::Start(pixels_at + from))
        .and_then(|_| file.read_exact(&mut bytes))
        .map_err(Error::read(&set.path))?;
    if is_swapped {
        bytes.as_chunks_mut::<2>().0.iter_mut().for_each(|two| two.reverse());
        bytes.drain(..(before as usize).min(bytes.len()));
    }
    Ok(bytes)
}

/// The samples of a channel of a frame as stored: bits beside them are masked, and the sign is extended.
fn pixels_of(set: &Dataset, frames: Option<&Frames>, frame: usize, plane: &Plane, channel: usize) -> Result<Vec<i64>> {
    let (pixels, colors) = (plane.pixels, plane.colors);
    let (columns, rows) = (usize::from(plane.columns), usize::from(plane.rows));
    let width = pixels.allocated.div_ceil(8) as usize;
    let (above, below) = (64 - 1 - pixels.high, 64 - pixels.stored);
    let value = |raw: u64| {
        let raised = raw << above;
        if pixels.signed { raised.cast_signed() >> below } else { (raised >> below).cast_signed() }
    };
    let (area, samples) = (columns * rows, colors.stored());
    let count = area * samples;
    let mut all: Vec<u64> = reserved(count as u64, || samples_in(&set.path))?;
    // Codecs give the samples of a pixel beside each other.
    let mut is_planar = false;
    if let Some(frames) = frames {
        let is_rgb = set.text(PHOTOMETRIC) == "RGB";
        all = frames.pixels(set, frame, Size { columns, rows, samples, bytes: width, is_rgb })?;
    } else {
        is_planar = plane.planar;
        let bytes = bytes_of(set, frame, plane)?;
        if pixels.allocated == 1 {
            let bits = bytes.iter().flat_map(|byte| (0..8).map(move |bit| u64::from(byte >> bit & 1)));
            all.extend(bits.skip(bits_before(frame, plane)).take(count));
        } else {
            all.extend(bytes.chunks_exact(width).map(|bytes| set.endian.number(bytes)));
        }
    }
    let sample = |pixel: usize, channel: usize| {
        let place = match colors {
            // Two of luma, then what both pixels share.
            Colors::Ybr422 if channel == 0 => pixel / 2 * 4 + pixel % 2,
            Colors::Ybr422 => pixel / 2 * 4 + channel + 1,
            _ if is_planar => channel * area + pixel,
            _ => pixel * samples + channel,
        };
        value(all[place])
    };
    let mut values = reserved(area as u64, || samples_in(&set.path))?;
    match colors {
        Colors::Ybr | Colors::Ybr422 => values.extend((0..area).map(|pixel| {
            let [y, cb, cr] = [0, 1, 2].map(|channel| sample(pixel, channel) as f64);
            let (blue, red) = (cb - 128.0, cr - 128.0);
            let of = [y + 1.402 * red, y - 0.344_136 * blue - 0.714_136 * red, y + 1.772 * blue];
            of[channel].round().clamp(0.0, 255.0) as i64
        })),
        Colors::Palette => {
            let table = Table::of(set, channel, pixels.signed)?;
            values.extend((0..area).map(|pixel| table.at(sample(pixel, 0))));
        }
        Colors::Grey | Colors::Rgb => values.extend((0..area).map(|pixel| sample(pixel, channel))),
    }
    Ok(values)
}
