//! The series among files, without copies and localizers.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::dataset::Dataset;
use super::plane::Plane;
use super::slices::{gaps, single_gap, sorted};
use super::times::in_times;
use super::{
    ACQUISITION_DATE, IMAGE_TYPE, INSTANCE, MODALITY, POSITION, SERIES_DATE, SERIES_DESCRIPTION, SERIES_NUMBER,
    SERIES_UID, SOP_INSTANCE, STUDY_DATE, segmentation,
};
use crate::error::{Error, Hint, Result, Subject, refuse};
use crate::formats::Series;
use crate::formats::placement::plain_name;
use crate::names::counted;

/// Groups files by series, in the order of their numbers.
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

/// Returns the files of a series without localizers, if there are others.
fn without_localizers(mut sets: Vec<Dataset>) -> Vec<Dataset> {
    let localizer = |set: &Dataset| set.text(IMAGE_TYPE).split('\\').any(|word| word.trim() == "LOCALIZER");
    if !sets.iter().all(localizer) {
        sets.retain(|set| !localizer(set));
    }
    sets
}

/// Returns the files of a series without copies of others, and a note if there are copies.
///
/// A copy has the identifier, the number and the position of its original: identifiers alone are equal in files that a
/// tool has made anonymous.
pub(super) fn without_copies(sets: Vec<Dataset>) -> (Vec<Dataset>, Option<String>) {
    let mut known: HashMap<[String; 3], usize> = HashMap::new();
    let (mut kept, mut count, mut example): (Vec<Dataset>, u64, _) = (Vec::new(), 0, None);
    for set in sets {
        let key = [SOP_INSTANCE, INSTANCE, POSITION].map(|tag| set.text(tag));
        match known.get(&key).filter(|_| !key[0].is_empty()).and_then(|at| kept.get(*at)) {
            Some(original) => {
                count += 1;
                example.get_or_insert_with(|| format!("{} of {}", set.name(), original.name()));
            }
            None => {
                known.insert(key, kept.len());
                kept.push(set);
            }
        }
    }
    let note = example.map(|example| {
        let (files, are) = (counted(count, "file"), if count == 1 { "is a copy" } else { "are copies" });
        format!("{files} of the series {are} and left out, such as {example}")
    });
    (kept, note)
}

/// The largest number of series that an error lists.
const MOST_LISTED: usize = 4;

/// Returns the files of one series: the requested one, or the only one.
pub(super) fn chosen(source: &Path, sets: Vec<Dataset>, series: Option<u32>) -> Result<Vec<Dataset>> {
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
pub(in crate::formats) fn series(source: &Path, files: &[PathBuf]) -> Result<Vec<Series>> {
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
        let lattice = lattice_of(source, &without_copies(without_localizers(sets)).0).ok();
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

/// Returns the samples of a series along each axis, their distances, and the number of points in time.
fn lattice_of(source: &Path, sets: &[Dataset]) -> Result<([u32; 3], [f64; 3], u32)> {
    let Some(first) = sets.first() else { refuse!(source, "is DICOM without pixels") };
    let plane = Plane::of(first, 0)?;
    let (slices, step, times) = match (segmentation::is_one(first), sets) {
        (true, [set]) => segmentation::lattice_of(set, &plane)?,
        _ => {
            let (times, _) = in_times(source, sets, sorted(source, sets, &plane)?)?;
            let slices = times.first().map(Vec::as_slice).unwrap_or_default();
            let usual = gaps(slices, plane.normal()).map(|(_, usual)| usual);
            (slices.len() as u64, usual.unwrap_or_else(|| single_gap(first)), times.len() as u32)
        }
    };
    let [dx, dy] = plane.spacing;
    let [columns, rows] = plane.size();
    Ok(([columns.into(), rows.into(), slices as u32], [dx, dy, step], times))
}
