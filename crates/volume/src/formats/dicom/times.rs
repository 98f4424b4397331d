//! Points in time: equally many slices at each position, distinguished by an index, a time, a kind or their numbers.

use std::cmp::Ordering;
use std::path::Path;

use super::dataset::{Dataset, decimals};
use super::slices::{APART, name_of};
use super::{FRAME_OFFSETS, IMAGE_TYPE, INSTANCE, Slice};
use crate::error::{Error, Result, Subject, refuse};
use crate::formats::placement::plain_name;
use crate::names::readable;

/// The encoding of a value that distinguishes the slices of one position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Written {
    Decimal,
    Whole,
    Float,
    /// A time HHMMSS.FFFFFF, on a date that another tag states.
    Time(u32),
    /// The number of the file, and of the frame in it.
    Number,
}

/// The tags that distinguish points in time, the most reliable first: TemporalPositionIndex,
/// TemporalPositionIdentifier, NominalCardiacTriggerDelayTime, TriggerTime, FrameReferenceTime, AcquisitionNumber,
/// AcquisitionTime, ContentTime, InstanceNumber.
const TIMES: [(u32, Written); 9] = [
    (0x0020_9128, Written::Whole),
    (0x0020_0100, Written::Decimal),
    (0x0020_9153, Written::Float),
    (0x0018_1060, Written::Decimal),
    (0x0054_1300, Written::Decimal),
    (0x0020_0012, Written::Decimal),
    (0x0008_0032, Written::Time(0x0008_0022)),
    (0x0008_0033, Written::Time(0x0008_0023)),
    (INSTANCE, Written::Number),
];

/// The numbers that distinguish the kinds of a series, with their names: slices of two kinds belong to two volumes.
const KINDS: [(&str, &[(u32, Written)]); 5] = [
    ("EchoTime", &[(0x0018_0081, Written::Decimal), (0x0018_9082, Written::Float)]),
    ("DiffusionBValue", &[(0x0018_9087, Written::Float)]),
    ("InversionTime", &[(0x0018_0082, Written::Decimal), (0x0018_9079, Written::Float)]),
    ("FlipAngle", &[(0x0018_1314, Written::Decimal)]),
    ("KVP", &[(0x0018_0060, Written::Decimal)]),
];
/// The place of the b-value among [`KINDS`], which makers also write in groups of their own.
const B_VALUE: usize = 1;

/// The tags of the type of an image, and of a frame: magnitude and phase may be in one series.
const TYPES: [u32; 2] = [0x0008_9007, IMAGE_TYPE];

/// The kind of a slice: numbers as in [`KINDS`], negative infinity if they are not stated, and the type.
#[derive(Clone, PartialEq, PartialOrd)]
struct SliceKind([f64; KINDS.len()], String);

/// The slices at one position, with their kinds.
type There = Vec<(SliceKind, Slice)>;

/// The volumes at the points in time, and notes about their differences.
type Volumes = (Vec<Vec<Slice>>, Vec<String>);

/// Splits slices along the normal of their plane into points in time: as many as there are slices at each position.
pub(super) fn in_times(source: &Path, sets: &[Dataset], slices: Vec<Slice>) -> Result<Volumes> {
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
        return Ok((vec![positions.into_iter().flatten().collect()], Vec::new()));
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
    let with_kind = |slice: Slice| (kind_of(sets, &slice), slice);
    let mut positions: Vec<There> =
        positions.into_iter().map(|there| there.into_iter().map(with_kind).collect()).collect();
    let Some(by) = told_apart(sets, &mut positions) else {
        let what = if times == 2 { "two slices".to_owned() } else { format!("{times} slices") };
        refuse!(source, "has {what} at one position: {examples}, and no number, time or kind tells them apart");
    };
    let first: Vec<SliceKind> = positions.first().into_iter().flatten().map(|(kind, _)| kind.clone()).collect();
    let mut notes = differences(&first);
    if notes.is_empty() && by == Some(INSTANCE) {
        notes.push("time points are in the order of InstanceNumber, because no time tells them apart".to_owned());
    }
    let mut volumes: Vec<Vec<Slice>> = (0..times).map(|_| Vec::new()).collect();
    for there in positions {
        volumes.iter_mut().zip(there).for_each(|(volume, (_, slice))| volume.push(slice));
    }
    Ok((volumes, notes))
}

/// Sorts the slices of each position so that the first ones make a volume, and so on. Returns the tag that
/// distinguishes them, besides their kinds; `None` if no tag does.
fn told_apart(sets: &[Dataset], positions: &mut [There]) -> Option<Option<u32>> {
    // A time alone, if each volume then is of one kind, or the kind and a time.
    for by_kind in [false, true] {
        let tags = by_kind.then_some(None).into_iter().chain(TIMES.map(Some));
        for tag in tags {
            if is_sorted_by(sets, positions, by_kind, tag) && is_of_one_kind(positions) {
                return Some(tag.map(|(tag, _)| tag));
            }
        }
    }
    // Kinds may differ within a volume: echo times that are rounded, say.
    let mut tags = TIMES.into_iter();
    tags.find(|tag| is_sorted_by(sets, positions, false, Some(*tag))).map(|(tag, _)| Some(tag))
}

/// Sorts the slices of each position by their kind, a tag or both, and returns whether that distinguishes them.
fn is_sorted_by(sets: &[Dataset], positions: &mut [There], by_kind: bool, tag: Option<(u32, Written)>) -> bool {
    let order = |(a_kind, a): &(SliceKind, Slice), (b_kind, b): &(SliceKind, Slice)| {
        let by_tag = tag.map_or(Some(Ordering::Equal), |tag| key_of(sets, a, tag)?.partial_cmp(&key_of(sets, b, tag)?));
        if by_kind { Some(a_kind.partial_cmp(b_kind)?.then(by_tag?)) } else { by_tag }
    };
    positions.iter_mut().all(|there| {
        there.sort_by(|a, b| order(a, b).unwrap_or(Ordering::Equal));
        there.windows(2).all(|pair| order(&pair[0], &pair[1]) == Some(Ordering::Less))
    })
}

/// Returns whether the first slices of all positions are of one kind, and the second ones, and so on.
fn is_of_one_kind(positions: &[There]) -> bool {
    let kinds = |there: &There| there.iter().map(|(kind, _)| kind.clone()).collect::<Vec<SliceKind>>();
    let first = positions.first().map(kinds).unwrap_or_default();
    positions.iter().all(|there| there.iter().zip(&first).all(|((kind, _), first)| kind == first))
}

/// The largest number of values that a note lists.
const MOST_LISTED: usize = 8;

/// Notes on the differences between volumes of these kinds.
fn differences(kinds: &[SliceKind]) -> Vec<String> {
    let mut notes = Vec::new();
    let mut compare = |name: &str, mut values: Vec<String>| {
        if values.windows(2).any(|pair| pair[0] != pair[1]) {
            let others = values.len().saturating_sub(MOST_LISTED);
            values.truncate(MOST_LISTED);
            let more = if others > 0 { format!(" and {others} others") } else { String::new() };
            notes.push(format!("time points differ in {name}: {}{more}", values.join(", ")));
        }
    };
    for (n, (name, _)) in KINDS.iter().enumerate() {
        let written = |value: f64| if value.is_finite() { readable(value) } else { "none".to_owned() };
        compare(name, kinds.iter().map(|SliceKind(numbers, _)| written(numbers[n])).collect());
    }
    compare("ImageType", kinds.iter().map(|SliceKind(_, name)| plain_name(name).unwrap_or_default()).collect());
    notes
}

/// Returns the kind of a slice.
fn kind_of(sets: &[Dataset], slice: &Slice) -> SliceKind {
    let number =
        |tags: &[(u32, Written)]| tags.iter().find_map(|tag| key_of(sets, slice, *tag)).map(|[_, number]| number);
    let mut numbers = KINDS.map(|(_, tags)| number(tags));
    let set = sets.get(slice.file);
    numbers[B_VALUE] = numbers[B_VALUE].or_else(|| makers_b_value(set?));
    let name = set.and_then(|set| TYPES.iter().find_map(|tag| set.frame_text(slice.frame, *tag)));
    SliceKind(numbers.map(|number| number.unwrap_or(f64::NEG_INFINITY)), name.unwrap_or_default())
}

/// Returns the b-value in the private groups of Siemens, GE, Philips and United Imaging, in s/mm^2.
fn makers_b_value(set: &Dataset) -> Option<f64> {
    let decimal = |bytes: &[u8]| decimals(bytes)?.first().copied();
    let siemens = || decimal(set.private(0x0019, "SIEMENS MR HEADER", 0x0c)?);
    // GE adds a large round number.
    let ge = || decimal(set.private(0x0043, "GEMS_PARM_01", 0x39)?).map(|value| value % 100_000.0);
    let philips = || {
        let bytes = set.private(0x2001, "Philips Imaging DD 001", 0x03)?.get(..4)?;
        Some(f32::from_bits(set.endian.number(bytes) as u32).into())
    };
    let united =
        || Some(f64::from_bits(set.endian.number(set.private(0x0065, "Image Private Header", 0x09)?.get(..8)?)));
    siemens().or_else(ge).or_else(philips).or_else(united).filter(|value: &f64| value.is_finite())
}

/// Returns the time of a slice by a tag, as a key to compare: a date, then a number.
fn key_of(sets: &[Dataset], slice: &Slice, (tag, written): (u32, Written)) -> Option<[f64; 2]> {
    let set = sets.get(slice.file)?;
    let decimal = |tag: u32| set.numbers::<1>(slice.frame, tag).map(|[number]| number);
    Some(match written {
        Written::Decimal => [0.0, decimal(tag)?],
        Written::Whole => [0.0, f64::from(set.u32(slice.frame, tag)?)],
        Written::Float => [0.0, set.f64(slice.frame, tag)?],
        Written::Time(date) => [decimal(date).unwrap_or(0.0), decimal(tag)?],
        // Frames of a dose at one place are an error.
        Written::Number if set.value(FRAME_OFFSETS).is_some() => return None,
        // The frames of the only file are in order without a number.
        Written::Number => [decimal(tag).or((sets.len() == 1).then_some(0.0))?, slice.frame as f64],
    })
}
