//! Segmentations: frames that mark the voxels of a segment each, or whose samples are labels (PS3.3, A.51 and C.8.20).
//!
//! Segments without a frame in a slice, and slices without frames, have no voxels there. Segments that overlap lie in
//! channels of their own.

use std::ops::Range;
use std::path::Path;

use glam::DVec3;

use super::dataset::{Dataset, MAX_FRAMES, Values, trimmed};
use super::palette::{self, PaletteTable};
use super::pixels::{bits_before, bytes_of, frames_in, pixels_of};
use super::plane::{Colors, Plane};
use super::slices::{APART, BETWEEN_SLICES, single_gap};
use super::{FRAMES, ORIENTATION, PHOTOMETRIC, POSITION, SERIES_DESCRIPTION, SOP_CLASS};
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::formats::placement::{Placement, plain_name};
use crate::formats::{LoadOptions, selection};
use crate::memory::{reserved, samples_in, zeroed};
use crate::volume::{MAX_DIM, Origin, Samples, Segment, Volume};

/// The classes Segmentation Storage and Label Map Segmentation Storage.
const CLASSES: [&str; 2] = ["1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7"];

const KIND: u32 = 0x0062_0001;
const NUMBER: u32 = 0x0062_0004;
const LABEL: u32 = 0x0062_0005;
const NUMBER_OF_FRAME: u32 = 0x0062_000b;
const DISPLAY_COLOR: u32 = 0x0062_000d;
const LARGEST_FRACTION: u32 = 0x0062_000e;

/// The largest number of voxels of a lattice whose frames lie far apart. A file must fill a larger one to a 64th.
const MAX_SPARSE: u64 = 1 << 30;

/// The meaning of the samples of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Meaning {
    /// Masks: voxels of at least this value belong to the segment of the frame.
    Mask { least: i64 },
    /// Samples that are labels.
    Labels,
}

/// A frame of a segmentation and its place.
struct Marks {
    frame: usize,
    /// The number of the frame's segment; 0 if its samples are labels.
    segment: u16,
    position: DVec3,
    /// The slice of the lattice.
    slice: u64,
}

/// Returns whether a file is a segmentation.
pub(super) fn is_one(set: &Dataset) -> bool {
    CLASSES.contains(&set.text(SOP_CLASS).as_str())
}

/// Reads the labels of a segmentation; `copies` is the note about copies of its file.
pub(super) fn read(source: &Path, sets: &[Dataset], copies: Option<String>, options: &LoadOptions) -> Result<Volume> {
    let [set] = sets else { refuse!(source, "holds {} segmentations in one series: give the file of one", sets.len()) };
    let kind = kind_of(set)?;
    // Whatever colours labels have, their samples are the labels.
    let plane = Plane { colors: Colors::Grey, planar: false, ..Plane::of(set, 0)? };
    let mut frames = frames_of(set, &plane, kind)?;
    let step = stacked(set, &mut frames, plane.normal())?;
    let placement = Placement {
        directions: [plane.directions[0], plane.directions[1], step.normalize()],
        spacing: [plane.spacing[0], plane.spacing[1], step.length()],
        origin: frames.first().map(|frame| frame.position).unwrap_or_default(),
        oriented: set.numbers::<6>(0, ORIENTATION).is_some(),
    };
    let slices = frames.last().map_or(0, |frame| frame.slice + 1);
    let area = u64::from(plane.columns) * u64::from(plane.rows);
    let (voxels, filled) = (area.saturating_mul(slices), area.saturating_mul(frames.len() as u64));
    let is_empty = voxels > MAX_SPARSE.max(filled.saturating_mul(64));
    refuse_if!(is_empty, set, "claims {slices} slices, and has only {} frames in them", frames.len());
    let sizes = [plane.columns.into(), plane.rows.into(), slices as i64];
    let grid = placement.grid(source, &sizes, options.spacing)?;

    let mut layers = layered(set, &plane, kind, frames, voxels)?;
    let mut contents = selection::chosen(source, options, layers.len() as u64, 1)?;
    contents.notes.extend(copies);
    if let (Meaning::Mask { least }, "FRACTIONAL") = (kind, set.text(KIND).as_str()) {
        let note = format!("voxels belong to a fractional segment from half of its maximum on, {least}");
        contents.notes.push(note);
    }
    contents.origin = Origin::of(Some("SEG"), [set.text(SERIES_DESCRIPTION).as_str()]);
    contents.segments = Some(described(set, &layers)?);
    let LabelMap { labels, segments } = layers.swap_remove(contents.channel as usize);
    let samples = match segments.iter().all(|number| u8::try_from(*number).is_ok()) {
        false => Samples::U16(labels),
        true => {
            let mut small = reserved(voxels, || samples_in(&set.path))?;
            small.extend(labels.into_iter().map(|label| label as u8));
            Samples::U8(small)
        }
    };
    Ok(placement.volume(grid, samples.into())?.with_contents(contents))
}

/// Returns the number of slices, their distance and the number of points in time, which is one.
pub(super) fn lattice_of(set: &Dataset, plane: &Plane) -> Result<(u64, f64, u32)> {
    let mut frames = frames_of(set, plane, kind_of(set)?)?;
    let step = stacked(set, &mut frames, plane.normal())?;
    Ok((frames.last().map_or(0, |frame| frame.slice + 1), step.length(), 1))
}

/// Returns the meaning of the samples of all frames.
fn kind_of(set: &Dataset) -> Result<Meaning> {
    Ok(match set.text(KIND).as_str() {
        "BINARY" => Meaning::Mask { least: 1 },
        "FRACTIONAL" => {
            let most = set.u16(LARGEST_FRACTION).filter(|most| *most > 0).unwrap_or(255);
            Meaning::Mask { least: i64::from(most.div_ceil(2)) }
        }
        "LABELMAP" => Meaning::Labels,
        kind => refuse!(set, "is a segmentation of the kind {kind:?}: expected BINARY, FRACTIONAL or LABELMAP"),
    })
}

/// Returns the frames of a file, in the order of their places along the normal.
fn frames_of(set: &Dataset, plane: &Plane, kind: Meaning) -> Result<Vec<Marks>> {
    let [count] = set.numbers(0, FRAMES).unwrap_or([1.0]);
    refuse_if!(!(1.0..=MAX_FRAMES as f64).contains(&count), set, "has {count} frames");
    let only = match &set.segments[..] {
        [only] => only.get(&NUMBER).and_then(|bytes| set.words_of(bytes).next()),
        _ => None,
    };
    let mut frames = Vec::new();
    for frame in 0..count as usize {
        let of_frame = frame + 1;
        let other = Plane::of(set, frame)?;
        let near = |a: DVec3, b: DVec3| a.distance(b) < 1e-3;
        let turned = !(0..2).all(|i| near(other.directions[i], plane.directions[i]));
        let scaled = (0..2).any(|i| (other.spacing[i] / plane.spacing[i] - 1.0).abs() > 1e-3);
        refuse_if!(turned || scaled, set, "frame {of_frame} has another spacing or plane than the first");
        let Some(position) = set.numbers(frame, POSITION).map(DVec3::from_array) else {
            refuse!(set, "frame {of_frame} of {count} has no position: only segmentations of volumes are read");
        };
        let segment = match (kind, set.frame_u16(frame, NUMBER_OF_FRAME).or(only)) {
            (Meaning::Labels, _) => 0,
            (Meaning::Mask { .. }, Some(number)) if number > 0 => number,
            _ => refuse!(set, "frame {of_frame} of {count} states no segment"),
        };
        frames.push(Marks { frame, segment, position, slice: 0 });
    }
    let normal = plane.normal();
    frames.sort_by(|a, b| a.position.dot(normal).total_cmp(&b.position.dot(normal)));
    Ok(frames)
}

/// Numbers the slices of sorted frames, and returns the vector from one slice to the next.
fn stacked(set: &Dataset, frames: &mut [Marks], normal: DVec3) -> Result<DVec3> {
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else { refuse!(set, "has no frames") };
    let (first, way) = (first.position, last.position - first.position);
    let depth = |frame: &Marks| (frame.position - first).dot(normal);
    let gaps = frames.windows(2).map(|pair| depth(&pair[1]) - depth(&pair[0]));
    let least = gaps.filter(|gap| *gap >= APART).fold(f64::INFINITY, f64::min);
    if !least.is_finite() {
        return Ok(normal * single_gap(set));
    }
    // Gaps may be multiples of the spacing, and none of them the spacing itself.
    let stated = set.numbers(0, BETWEEN_SLICES).map(|[length]| length).filter(|length| *length > 0.0);
    let candidates = stated.into_iter().chain((1..=8).map(|part| least / f64::from(part)));
    let is_off = |frame: &Marks, step: f64| ((depth(frame) / step).round() * step - depth(frame)).abs() > 0.05 * step;
    let Some(step) = candidates.into_iter().find(|step| !frames.iter().any(|frame| is_off(frame, *step))) else {
        refuse!(set, "frames are unequally spaced: no distance of slices fits their positions");
    };
    let most = (way.dot(normal) / step).round();
    refuse_if!(most >= f64::from(MAX_DIM), set, "claims {most} slices, expected at most {MAX_DIM}");
    let way = way / most;
    for frame in frames {
        frame.slice = (frame.position - first).dot(normal).mul_add(1.0 / step, 0.5) as u64;
        if frame.position.distance(first + way * frame.slice as f64) > 0.05 * step {
            refuse!(set, "frame {} is not in a row with the others", frame.frame + 1);
        }
    }
    Ok(way)
}

/// A layer of labels that do not overlap.
struct LabelMap {
    labels: Vec<u16>,
    /// The numbers of the segments in the layer.
    segments: Vec<u16>,
}

/// Distributes the segments over layers: each lies in the first one where it overlaps with no other.
fn layered(set: &Dataset, plane: &Plane, kind: Meaning, mut frames: Vec<Marks>, voxels: u64) -> Result<Vec<LabelMap>> {
    let compressed = frames_in(set, plane.frame_bits())?;
    let area = usize::from(plane.columns) * usize::from(plane.rows);
    let what = || samples_in(&set.path);
    let new = || Ok(LabelMap { labels: zeroed(voxels, what)?, segments: Vec::new() });
    let samples = |frame: &Marks| pixels_of(set, compressed.as_ref(), frame.frame, plane, 0);
    let place = |frame: &Marks| frame.slice as usize * area..(frame.slice as usize + 1) * area;
    frames.sort_by_key(|frame| (frame.segment, frame.slice));
    let mut layers: Vec<LabelMap> = Vec::new();
    for frames in frames.chunk_by(|a, b| a.segment == b.segment) {
        if let Some(pair) = frames.windows(2).find(|pair| pair[0].slice == pair[1].slice) {
            let [a, b] = [&pair[0], &pair[1]].map(|frame| frame.frame + 1);
            let of = if kind == Meaning::Labels { "labels".to_owned() } else { format!("segment {}", pair[0].segment) };
            refuse!(set, "has two frames of {of} at one position: {a} and {b}");
        }
        let Meaning::Mask { least } = kind else {
            let mut layer = new()?;
            for frame in frames {
                let labels = &mut layer.labels[place(frame)];
                labels.iter_mut().zip(samples(frame)?).for_each(|(label, sample)| *label = sample as u16);
            }
            layer.segments.extend(layer.labels.iter().max());
            return Ok(vec![layer]);
        };
        let mut runs = VoxelRuns { all: Vec::new(), open: None };
        for frame in frames {
            // A frame has at most a run for every other voxel.
            runs.all.try_reserve(area / 2 + 1).map_err(|_| Error::Memory { what: what(), bytes: 8 * area as u64 })?;
            let start = place(frame).start;
            if least == 1 && plane.pixels.allocated == 1 {
                runs.add_bits(
                    start..start + area,
                    &bytes_of(set, frame.frame, plane)?,
                    bits_before(frame.frame, plane),
                );
            } else {
                let marks = samples(frame)?.into_iter().map(|sample| sample >= least);
                (start..).zip(marks).for_each(|(voxel, is_marked)| runs.add(voxel, is_marked));
            }
            runs.add(start + area, false);
        }
        let is_free =
            |layer: &LabelMap| !runs.all.iter().any(|run| layer.labels[run.clone()].iter().any(|of| *of != 0));
        let at = layers.iter().position(is_free).unwrap_or(layers.len());
        if at == layers.len() {
            layers.push(new()?);
        }
        let (layer, number) = (&mut layers[at], frames[0].segment);
        layer.segments.push(number);
        runs.all.into_iter().for_each(|run| layer.labels[run].fill(number));
    }
    Ok(layers)
}

/// Runs of marked voxels, and the run under way.
struct VoxelRuns {
    all: Vec<Range<usize>>,
    /// The first voxel of the run that has not ended.
    open: Option<usize>,
}

impl VoxelRuns {
    /// Adds the next voxel; skipped voxels are like the one before.
    fn add(&mut self, voxel: usize, is_marked: bool) {
        match (self.open, is_marked) {
            (None, true) => self.open = Some(voxel),
            (Some(first), false) => {
                self.all.push(first..voxel);
                self.open = None;
            }
            _ => {}
        }
    }

    /// Adds voxels by their bits, of which `before` in the first byte belong to other voxels.
    fn add_bits(&mut self, voxels: Range<usize>, bytes: &[u8], before: usize) {
        for (n, &byte) in bytes.iter().enumerate() {
            // Most bytes are empty: a run ends at their first bit.
            for bit in 0..if byte == 0 { 1 } else { 8 } {
                let voxel = (8 * n + bit).checked_sub(before).map(|number| voxels.start + number);
                if let Some(voxel) = voxel.filter(|voxel| *voxel < voxels.end) {
                    self.add(voxel, byte >> bit & 1 == 1);
                }
            }
        }
    }
}

/// Returns the names and the colours of the segments.
fn described(set: &Dataset, layers: &[LabelMap]) -> Result<Vec<Segment>> {
    let mut tables = Vec::new();
    if set.text(PHOTOMETRIC) == "PALETTE COLOR" {
        let shift = 8 * (palette::bytes_of_entries(set)? - 1);
        tables = (0..3).map(|channel| PaletteTable::of(set, channel, false)).collect::<Result<Vec<_>>>()?;
        tables.iter_mut().for_each(|table| table.shift(shift));
    }
    let segment = |values: &Values| {
        let words = |tag: u32| values.get(&tag).map(|bytes| set.words_of(bytes).collect::<Vec<u16>>());
        // Number 0 is the background of label maps.
        let number = words(NUMBER).and_then(|words| words.first().copied()).filter(|number| *number > 0)?;
        let lab = words(DISPLAY_COLOR).and_then(|words| words.try_into().ok());
        let by_palette = || {
            let [red, green, blue] = &tables[..] else { return None };
            Some([red, green, blue].map(|table| table.at(number.into()) as u8))
        };
        Some(Segment {
            channel: layers.iter().position(|layer| layer.segments.contains(&number)).unwrap_or(0) as u32,
            label: number.into(),
            name: values.get(&LABEL).and_then(|bytes| plain_name(&trimmed(bytes))),
            color: lab.map(srgb).or_else(by_palette),
        })
    };
    Ok(set.segments.iter().filter_map(segment).collect())
}

/// Returns the sRGB colour of a `CIELab` colour in words (PS3.3, C.10.7.1.1). Its white is the white of sRGB, as DCMTK
/// and highdicom write it.
fn srgb(lab: [u16; 3]) -> [u8; 3] {
    let [lightness, a, b] = lab.map(|word| f64::from(word) / 65_535.0);
    let (lightness, a, b) = (100.0 * lightness, 255.0 * a - 128.0, 255.0 * b - 128.0);
    let y = (lightness + 16.0) / 116.0;
    let linear = |t: f64| if t > 6.0 / 29.0 { t.powi(3) } else { 3.0 * (6.0_f64 / 29.0).powi(2) * (t - 4.0 / 29.0) };
    let xyz = [0.9505 * linear(y + a / 500.0), linear(y), 1.0889 * linear(y - b / 200.0)];
    let rows = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]];
    rows.map(|row| {
        let share: f64 = row.iter().zip(xyz).map(|(factor, part)| factor * part).sum();
        let share = if share > 0.003_130_8 { 1.055 * libm::pow(share, 1.0 / 2.4) - 0.055 } else { 12.92 * share };
        (255.0 * share).round().clamp(0.0, 255.0) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::srgb;

    #[test]
    fn colours_are_those_that_were_written() {
        // By highdicom 0.28.2: CIELabColor.from_rgb(...).value.
        for (words, color) in [
            ([34_886, 53_484, 50_172], [255, 0, 0]),
            ([57_498, 10_747, 54_274], [0, 255, 0]),
            ([21_170, 53_250, 5_175], [0, 0, 255]),
            ([65_535, 32_897, 32_893], [255, 255, 255]),
            ([0, 32_896, 32_896], [0, 0, 0]),
            ([43_803, 26_565, 37_722], [128, 174, 128]),
            ([8_295, 32_928, 28_569], [12, 34, 56]),
            ([28_849, 51_210, 30_767], [200, 10, 120]),
        ] {
            assert_eq!(srgb(words), color);
        }
    }
}
