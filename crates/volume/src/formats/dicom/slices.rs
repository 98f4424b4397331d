//! The slices of a volume in the order of their positions, and their lattice.

use std::path::Path;

use glam::DVec3;

use super::dataset::Dataset;
use super::mosaic::Mosaic;
use super::plane::Plane;
use super::{FRAME_OFFSETS, FRAMES, INSTANCE, MODALITY, ORIENTATION, POSITION, SLICE_VECTOR, SOP_CLASS, Slice};
use crate::error::{Hint, Result, Subject, refuse, refuse_if};
use crate::formats::placement::Placement;
use crate::names::readable;

const SLICE_THICKNESS: u32 = 0x0018_0050;
pub(super) const BETWEEN_SLICES: u32 = 0x0018_0088;
const INTERCEPT: u32 = 0x0028_1052;
const SLOPE: u32 = 0x0028_1053;
const REAL_INTERCEPT: u32 = 0x0040_9224;
const REAL_SLOPE: u32 = 0x0040_9225;
const DOSE_SCALING: u32 = 0x3004_000e;

/// The beginning of the SOP classes of secondary captures.
const SECONDARY_CAPTURE: &str = "1.2.840.10008.5.1.4.1.1.7";

/// Returns the distance of slices that a file states, or their thickness. Nuclear medicine gives it a sign (PS3.3,
/// C.8.4.15).
fn stated_gap(set: &Dataset) -> Option<f64> {
    let stated = |tag| set.numbers::<1>(0, tag).map(|[length]| length).filter(|length| *length != 0.0);
    let gap = stated(BETWEEN_SLICES).or(stated(SLICE_THICKNESS))?;
    Some(if set.text(MODALITY) == "NM" { gap } else { gap.abs() })
}

/// Returns the distance of slices that the file of a single slice states, or its thickness, or 1.
pub(super) fn single_gap(set: &Dataset) -> f64 {
    stated_gap(set).map_or(1.0, f64::abs)
}

/// Returns a note if slices follow one another at a distance that the file does not state.
pub(super) fn gap_note(set: &Dataset, plane: &Plane, slices: usize) -> Option<&'static str> {
    let is_whole = plane.mosaic.is_none() && set.numbers(0, FRAMES).is_none_or(|[frames]| frames == 1.0);
    let has_places = set.value(FRAME_OFFSETS).is_some_and(|offsets| !offsets.is_empty())
        || set.is_of_frames(0, POSITION)
        || is_whole && set.numbers::<3>(0, POSITION).is_some();
    let is_unstated = slices > 1 && !has_places && stated_gap(set).is_none();
    is_unstated
        .then_some("the file states no distance of slices: they are taken to be 1 apart unless a spacing is given")
}

/// Returns the places of the frames of a dose along the normal of their plane, from the position of the file (PS3.3,
/// C.8.8.3.2); `None` if the file states no places.
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

/// Returns the places of the frames of a file along the normal of their plane, from the position of the file: 0 if each
/// frame has a position, or all share one.
fn frame_offsets(set: &Dataset, normal: DVec3, frames: usize) -> Result<Vec<f64>> {
    if let Some(offsets) = dose_offsets(set, normal, frames)? {
        return Ok(offsets);
    }
    if frames == 1 || (0..frames).any(|frame| set.is_of_frames(frame, POSITION)) {
        return Ok(vec![0.0; frames]);
    }
    // Frames follow one another. In gated studies each frame states the number of its slice.
    let numbers: Vec<u16> = set.words(SLICE_VECTOR).map(Iterator::collect).unwrap_or_default();
    let is_whole = numbers.len() == frames;
    let number = |frame: usize| if is_whole { f64::from(numbers[frame]) - 1.0 } else { frame as f64 };
    let step = stated_gap(set).unwrap_or(1.0);
    Ok((0..frames).map(|frame| step * number(frame)).collect())
}

/// Returns the slope and the intercept of the samples of a frame. Real-world values count if the rescale changes
/// nothing.
fn map_of(set: &Dataset, frame: usize) -> [f64; 2] {
    let [slope] = set.numbers(frame, SLOPE).or_else(|| set.numbers(0, DOSE_SCALING)).unwrap_or([1.0]);
    let [intercept] = set.numbers(frame, INTERCEPT).unwrap_or([0.0]);
    let real = set.f64(frame, REAL_SLOPE).zip(set.f64(frame, REAL_INTERCEPT));
    match real.filter(|(real, _)| *real != 0.0 && [slope, intercept] == [1.0, 0.0]) {
        Some((slope, intercept)) => [slope, intercept],
        None => [slope, intercept],
    }
}

/// Returns the slices sorted along the normal of their plane.
pub(super) fn sorted(source: &Path, sets: &[Dataset], plane: &Plane) -> Result<Vec<Slice>> {
    let normal = plane.normal();
    let mut slices = Vec::new();
    for (file, set) in sets.iter().enumerate() {
        let [frames] = set.numbers(0, FRAMES).unwrap_or([1.0]);
        refuse_if!(!(1.0..=f64::from(u16::MAX)).contains(&frames), set, "has {frames} frames");
        let offsets = frame_offsets(set, normal, frames as usize)?;
        for (frame, offset) in offsets.into_iter().enumerate() {
            let other = Plane::of(set, frame)?;
            let near = |a: DVec3, b: DVec3| a.distance(b) < 1e-3;
            let turned = !(0..2).all(|i| near(other.directions[i], plane.directions[i]));
            let scaled = (0..2).any(|i| (other.spacing[i] / plane.spacing[i] - 1.0).abs() > 1e-3);
            let kind = |p: &Plane| (p.columns, p.rows, p.pixels, p.colors, p.planar, p.bytes, p.mosaic);
            if turned || scaled || kind(&other) != kind(plane) {
                let of = sets.first().map(|set| set.path.display().to_string()).unwrap_or_default();
                refuse!(set, "has another size, type, spacing or plane than {of}");
            }
            let position = set.numbers(frame, POSITION).map(DVec3::from_array);
            // Frames without positions follow one another, and so do secondary captures by their numbers.
            let capture = || {
                let is_capture = frames == 1.0 && set.text(SOP_CLASS).starts_with(SECONDARY_CAPTURE);
                set.numbers(0, INSTANCE).filter(|_| is_capture).map(|[number]| normal * number * single_gap(set))
            };
            let start = if sets.len() == 1 { position.or(Some(DVec3::ZERO)) } else { position.or_else(capture) };
            let Some(start) = start else { refuse!(set, "has no position") };
            let [slope, intercept] = map_of(set, frame);
            let position = start + normal * offset;
            let slice = Slice { file, frame, tile: 0, position, slope, intercept, behind: None };
            match plane.mosaic {
                None => slices.push(slice),
                Some(mosaic) => {
                    let steps = [0, 1].map(|axis| plane.directions[axis] * plane.spacing[axis]);
                    let first = position + Mosaic::first_tile([plane.columns, plane.rows], mosaic.across, steps);
                    let step = normal * single_gap(set) * if mosaic.is_reversed { -1.0 } else { 1.0 };
                    let place = |tile: u16| first + step * f64::from(tile);
                    let of_tile = |tile: u16| Slice { tile, position: place(tile), ..slice.clone() };
                    slices.extend((0..mosaic.tiles).map(of_tile));
                }
            }
            refuse_if!(slices.len() > usize::from(u16::MAX), source, "has over 65535 slices");
        }
    }
    slices.sort_by(|a, b| a.position.dot(normal).total_cmp(&b.position.dot(normal)));
    Ok(slices)
}

/// The least distance of slices that are not at one position, world units.
pub(super) const APART: f64 = 1e-4;

/// Returns the name of the file that contains a slice.
pub(super) fn name_of(sets: &[Dataset], slice: &Slice) -> String {
    sets.get(slice.file).map(Dataset::name).unwrap_or_default()
}

/// Returns the number of slices missing in a gap, from the usual distance of slices.
fn missing_in(gap: f64, usual: f64) -> u64 {
    let times = (gap / usual).round();
    if times >= 2.0 && (gap / usual - times).abs() < 0.05 { times as u64 - 1 } else { 0 }
}

/// Returns a sentence about the slices that are missing between two; `None` if there are none.
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

/// Returns the distances of neighbouring slices along the normal of their plane, and the usual distance; `None` for one
/// slice.
pub(super) fn gaps(slices: &[Slice], normal: DVec3) -> Option<(Vec<f64>, f64)> {
    let gap = |pair: &[Slice]| (pair[1].position - pair[0].position).dot(normal);
    let gaps: Vec<f64> = slices.windows(2).map(gap).collect();
    let mut sorted = gaps.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = *sorted.get(sorted.len() / 2)?;
    Some((gaps, usual))
}

/// Returns whether a gap differs from the usual distance of slices by more than the rounding of positions.
fn is_uneven(gap: f64, usual: f64) -> bool {
    (gap / usual - 1.0).abs() > 0.02
}

/// Slices, with notes about them.
type Noted = (Vec<Slice>, Vec<String>);

/// Interpolates slices in place of missing ones, or unequally spaced slices at equal distances, and returns notes about
/// it.
pub(super) fn completed(source: &Path, sets: &[Dataset], slices: Vec<Slice>, normal: DVec3) -> Result<Noted> {
    let Some((gaps, usual)) = gaps(&slices, normal).filter(|(_, usual)| *usual >= APART) else {
        return Ok((slices, Vec::new()));
    };
    let counts: Vec<u64> = gaps.iter().map(|gap| missing_in(*gap, usual)).collect();
    let lacking = counts.iter().fold(slices.len() as u64, |sum, count| sum.saturating_add(*count));
    refuse_if!(lacking > u64::from(u16::MAX), source, "has over 65535 slices with those that are missing");
    if gaps.iter().zip(&counts).any(|(gap, count)| is_uneven(gap / (count + 1) as f64, usual)) {
        return evened(source, &slices, &gaps);
    }
    let (mut all, mut notes) = (Vec::new(), Vec::new());
    for (pair, count) in slices.windows(2).zip(counts) {
        let [before, after] = pair else { continue };
        all.push(before.clone());
        all.extend((1..=count).map(|n| between(before, after, n as f64 / (count + 1) as f64)));
        notes.extend(missing(sets, pair, normal, usual).map(|said| said + ": interpolated between their neighbours"));
    }
    all.extend(slices.last().cloned());
    Ok((all, notes))
}

/// Interpolates the slice at a share of the way from one slice to the next.
fn between(before: &Slice, after: &Slice, share: f64) -> Slice {
    let position = before.position.lerp(after.position, share);
    Slice { position, behind: Some((Box::new(after.clone()), share)), ..before.clone() }
}

/// The largest ratio of the number of interpolated slices to the number of unequally spaced ones.
const MOST_EVENED: f64 = 16.0;

/// Interpolates slices at equal distances, of about the least gap, and returns a note about it.
fn evened(source: &Path, slices: &[Slice], gaps: &[f64]) -> Result<Noted> {
    let ends = |ends: [f64; 2], gap: &f64| [ends[0].min(*gap), ends[1].max(*gap)];
    let ([least, most], length) = (gaps.iter().fold([f64::INFINITY, 0.0], ends), gaps.iter().sum::<f64>());
    let (count, limit) = ((length / least).round(), MOST_EVENED * slices.len() as f64);
    let is_wide = least < APART || count > limit;
    refuse_if!(is_wide, source, "slices are {least:.4} to {most:.4} apart, which is too unequal to interpolate");
    let step = length / count;
    let (mut all, mut done, mut start) = (Vec::new(), 0.0, 0.0);
    for (pair, gap) in slices.windows(2).zip(gaps) {
        let [before, after] = pair else { continue };
        // Whole steps from the first slice, of which each gap has those up to its end.
        while done < count && done * step < start + gap {
            let share = (done * step - start) / gap;
            all.push(if share < 1e-6 { before.clone() } else { between(before, after, share.min(1.0)) });
            done += 1.0;
        }
        start += gap;
    }
    all.extend(slices.last().cloned());
    let (had, have, apart) = (slices.len(), all.len(), readable(step));
    let note = format!("{had} slices are {least:.4} to {most:.4} apart: interpolated to {have} slices, {apart} apart");
    Ok((all, vec![note]))
}

/// Returns the position of the lattice, if the slices are the same distance apart.
pub(super) fn placed(source: &Path, sets: &[Dataset], slices: &[Slice], plane: &Plane) -> Result<Placement> {
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
            if is_uneven(*gap, usual) {
                let between = format!("{} and {}", name(&pair[0]), name(&pair[1]));
                let reason = format!("slices are unequally spaced: {gap:.4} between {between}, {usual:.4} elsewhere");
                return Err(source.error(reason).hinted(Hint::InterpolateSlices));
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
