//! Points in time: equally many slices at each position, distinguished by an index or a time.

use std::cmp::Ordering;
use std::path::Path;

use super::dataset::Dataset;
use super::{APART, Slice, name_of};
use crate::error::{Error, Result, Subject, refuse};

/// The encoding of a value that distinguishes the slices of one position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Written {
    Decimal,
    Whole,
    Float,
    /// HHMMSS.FFFFFF, on a date that another tag states.
    Time(u32),
}

/// The tags that distinguish points in time, the most reliable first: TemporalPositionIndex,
/// TemporalPositionIdentifier, NominalCardiacTriggerDelayTime, TriggerTime, FrameReferenceTime, AcquisitionNumber,
/// AcquisitionTime, ContentTime.
const TIMES: [(u32, Written); 8] = [
    (0x0020_9128, Written::Whole),
    (0x0020_0100, Written::Decimal),
    (0x0020_9153, Written::Float),
    (0x0018_1060, Written::Decimal),
    (0x0054_1300, Written::Decimal),
    (0x0020_0012, Written::Decimal),
    (0x0008_0032, Written::Time(0x0008_0022)),
    (0x0008_0033, Written::Time(0x0008_0023)),
];

/// Slices along the normal of their plane, parted into points in time: as many as there are slices at each position.
pub(super) fn in_times(source: &Path, sets: &[Dataset], slices: Vec<Slice>) -> Result<Vec<Vec<Slice>>> {
    let mut positions: Vec<Vec<Slice>> = Vec::new();
    for slice in slices {
        match positions.last_mut() {
            Some(there) if there.last().is_some_and(|last| last.position.distance(slice.position) < APART) => {
                there.push(slice);
            }
            _ => positions.push(vec![slice]),
        }
    }
    let times = positions.iter().map(Vec::len).max().unwrap_or(0);
    if times <= 1 {
        return Ok(vec![positions.into_iter().flatten().collect()]);
    }
    let at = |there: &[Slice]| there.iter().map(|slice| name_of(sets, slice)).take(2).collect::<Vec<_>>().join(" and ");
    let fewest = positions.iter().min_by_key(|there| there.len()).map(Vec::as_slice).unwrap_or_default();
    let most = positions.iter().find(|there| there.len() == times).map(Vec::as_slice).unwrap_or_default();
    if fewest.len() != times {
        let (few, names) = (fewest.len(), at(fewest));
        let reason = match times {
            2 => format!("has two slices at one position: {}, and one at another: {names}", at(most)),
            _ => format!("has {times} slices at one position, such as {}, and {few} at another: {names}", at(most)),
        };
        return Err(Error::format(source, reason));
    }
    let examples = at(most);
    // Sorts the slices of a position by the tag, and returns whether it distinguishes them.
    let tells_apart = |there: &mut Vec<Slice>, tag| {
        let order = |a: &Slice, b: &Slice| key_of(sets, a, tag).partial_cmp(&key_of(sets, b, tag));
        there.sort_by(|a, b| order(a, b).unwrap_or(Ordering::Equal));
        there.iter().all(|slice| key_of(sets, slice, tag).is_some())
            && there.windows(2).all(|pair| order(&pair[0], &pair[1]) == Some(Ordering::Less))
    };
    if !TIMES.into_iter().any(|tag| positions.iter_mut().all(|there| tells_apart(there, tag))) {
        let what = if times == 2 { "two slices".to_owned() } else { format!("{times} slices") };
        refuse!(source, "has {what} at one position: {examples}, and no number or time tells them apart");
    }
    let mut volumes: Vec<Vec<Slice>> = (0..times).map(|_| Vec::new()).collect();
    for there in positions {
        volumes.iter_mut().zip(there).for_each(|(volume, slice)| volume.push(slice));
    }
    Ok(volumes)
}

/// The time of a slice by a tag, as a key to compare: a date, then a number.
fn key_of(sets: &[Dataset], slice: &Slice, (tag, written): (u32, Written)) -> Option<[f64; 2]> {
    let set = sets.get(slice.file)?;
    let decimal = |tag: u32| set.numbers::<1>(slice.frame, tag).map(|[number]| number);
    Some(match written {
        Written::Decimal => [0.0, decimal(tag)?],
        Written::Whole => [0.0, f64::from(set.u32(slice.frame, tag)?)],
        Written::Float => [0.0, set.f64(slice.frame, tag)?],
        Written::Time(date) => [decimal(date).unwrap_or(0.0), decimal(tag)?],
    })
}
