//! NRRD headers: their fields, and the meaning of the fields that have a value per axis.

use std::collections::BTreeMap;

use glam::{DVec3, DVec4};

use crate::error::{Result, refuse, refuse_if};
use crate::formats::input::Input;
use crate::formats::multifile::announces_list;
use crate::formats::placement::plain_name;
use crate::formats::selection::{Axes, Role};
use crate::formats::text_header::TextHeader;
use crate::volume::{Origin, SampleType, Segment};

/// The largest number of axes: Teem's limit, NRRD_DIM_MAX.
const MAX_AXES: usize = 16;

/// A header of NRRD with the meaning of its fields.
pub(super) struct NrrdHeader {
    /// The fields, whose names keep the blanks between their words.
    pub(super) text: TextHeader,
    /// The modality that an application states among its keys.
    modality: Option<String>,
    /// The labels by their numbers in the file, if it is a segmentation of 3D Slicer.
    segments: BTreeMap<u32, Segment>,
    /// The number of samples along each axis, fastest first, as stated; not yet checked to be positive.
    pub(super) sizes: Vec<i64>,
    /// The world distances between samples, one per axis.
    pub(super) spacings: Option<Vec<f64>>,
    /// The world vectors between samples, one per axis; `None` for an axis that is not spatial.
    pub(super) directions: Option<Vec<Option<DVec3>>>,
    /// The world position of the first sample.
    pub(super) origin: Option<DVec3>,
    /// The axis along time, if the header's space has time and directions say which axis that is.
    time_axis: Option<usize>,
    /// The axes whose index has a type, as in the sequences of 3D Slicer.
    indexed: Vec<usize>,
    /// Factors from the header's space to DICOM's patient space; `None` if the header's is not a patient space.
    pub(super) patient_flip: Option<DVec3>,
}

impl NrrdHeader {
    /// Reads a header up to the blank line before attached data, the end of a detached header, or its list of files.
    pub(super) fn read(input: &mut Input) -> Result<Self> {
        let magic = input.line()?.unwrap_or_default();
        let version = magic.trim_end().strip_prefix("NRRD000");
        if !matches!(version, Some("1" | "2" | "3" | "4" | "5")) {
            refuse!(input, "begins with {magic:?}, expected NRRD0001 to NRRD0005");
        }
        let mut text = TextHeader::new(input, "NRRD");
        let (mut segments, mut indexed, mut modality) = (BTreeMap::new(), Vec::new(), None);
        while let Some(line) = input.line()? {
            let line = line.trim_end();
            if line.is_empty() {
                break;
            }
            if line.starts_with('#') {
                continue;
            }
            let Some((name, value)) = line.split_once(':') else {
                refuse!(input, "header line {line:?} is not \"field: value\"");
            };
            // "key:=value" is metadata of an application, such as "axis 3 index type:=numeric".
            if let Some(value) = value.strip_prefix('=') {
                let axis = name.strip_prefix("axis ").and_then(|rest| rest.strip_suffix(" index type"));
                indexed.extend(axis.and_then(|axis| axis.parse::<usize>().ok()).filter(|axis| *axis < MAX_AXES));
                describe(&mut segments, name, value);
                if ["modality", "dicom_0008_0060_modality"].contains(&name.trim().to_ascii_lowercase().as_str()) {
                    modality = plain_name(value);
                }
                continue;
            }
            let name = canonical(name);
            text.insert(&name, value.trim())?;
            if name == "data file" && announces_list(value) {
                break;
            }
        }
        Ok(Self { modality, ..Self::interpret(text, segments, indexed)? })
    }

    fn interpret(text: TextHeader, segments: BTreeMap<u32, Segment>, indexed: Vec<usize>) -> Result<Self> {
        let dimension: usize = text.parsed("dimension", text.required("dimension")?)?;
        refuse_if!(!(1..=MAX_AXES).contains(&dimension), text, "dimension: {dimension}, expected 1 to {MAX_AXES}");
        let sizes = text.list("sizes", text.required("sizes")?, dimension)?;
        let spacings = text.get(["spacings"]).map(|list| text.list("spacings", list, dimension)).transpose()?;
        let space = text.get(["space"]).unwrap_or("3D-right-handed").to_ascii_lowercase();
        // A fourth coordinate is time.
        let (space, has_time) = match space.as_str() {
            "rast" => ("ras", true),
            "last" => ("las", true),
            "lpst" => ("lps", true),
            space => space.strip_suffix("-time").map_or((space, false), |space| (space, true)),
        };
        let patient_flip = match space {
            "left-posterior-superior" | "lps" => Some(DVec3::ONE),
            "right-anterior-superior" | "ras" => Some(DVec3::new(-1.0, -1.0, 1.0)),
            "left-anterior-superior" | "las" => Some(DVec3::new(1.0, -1.0, 1.0)),
            // These spaces are not oriented in the patient.
            "scanner-xyz" | "3d-right-handed" | "3d-left-handed" => None,
            other => refuse!(text, "space {other:?} is unknown"),
        };
        let stated =
            |field: &str, n: usize| text.get([field]).map(|list| vectors(&text, list, n, has_time)).transpose();
        let mut directions = stated("space directions", dimension)?;
        let mut time_axis = None;
        for (axis, vector) in directions.iter_mut().flatten().enumerate() {
            if let Some(moving) = vector.filter(|vector| vector.w != 0.0) {
                let is_still = time_axis.is_none() && moving.truncate() == DVec3::ZERO;
                refuse_if!(!is_still, text, "space directions: slices at unlike times, which is not read");
                (time_axis, *vector) = (Some(axis), None);
            }
        }
        let origin = match stated("space origin", 1)?.as_deref() {
            None => None,
            Some([Some(origin)]) => Some(origin.truncate()),
            Some(_) => refuse!(text, "space origin: expected one vector such as (0,0,0)"),
        };
        let coordinates = if has_time { 4 } else { 3 };
        if let Some(n) = text.number::<u32>("space dimension")?.filter(|n| *n != coordinates) {
            refuse!(text, "space dimension: {n}, expected {coordinates}");
        }
        let directions: Option<Vec<_>> =
            directions.map(|all| all.into_iter().map(|vector| vector.map(DVec4::truncate)).collect());
        // A named space without directions does not orient the lattice.
        let patient_flip = patient_flip.filter(|_| directions.is_some());
        let modality = None;
        Ok(Self { text, modality, segments, sizes, spacings, directions, origin, time_axis, indexed, patient_flip })
    }

    /// Returns the labels of a segmentation of 3D Slicer.
    pub(super) fn segments(&self) -> Option<Vec<Segment>> {
        (!self.segments.is_empty()).then(|| self.segments.values().cloned().collect())
    }

    /// Returns the origin of the values, as the header states it.
    pub(super) fn origin_of_values(&self) -> Origin {
        Origin::of(self.modality.as_deref(), self.text.get(["content"]))
    }

    /// Returns whether an axis is spatial: it has a direction or, in a header without directions, a spatial kind.
    pub(super) fn is_spatial(&self, axis: usize) -> bool {
        if let Some(directions) = &self.directions {
            return directions.get(axis).is_some_and(Option::is_some);
        }
        self.kind(axis).is_none_or(|kind| matches!(kind.as_str(), "domain" | "space"))
    }

    /// Returns the kind of an axis, if it is stated.
    pub(super) fn kind(&self, axis: usize) -> Option<String> {
        let kind = self.text.get(["kinds"])?.split_ascii_whitespace().nth(axis)?.to_ascii_lowercase();
        (kind != "none" && kind != "???").then_some(kind)
    }

    /// Returns whether an axis is of one of these kinds.
    pub(super) fn is_kind(&self, axis: usize, kinds: &[&str]) -> bool {
        self.kind(axis).is_some_and(|kind| kinds.contains(&kind.as_str()))
    }

    /// Returns whether the channels are colours: their axis is of such a kind, or has four bytes of the kind for any
    /// four.
    pub(super) fn has_colors(&self, sample_type: SampleType, axes: &Axes) -> bool {
        let mut channels = (0..).zip(axes).filter(|(_, (role, size))| *role == Role::Channel && *size > 1);
        let (Some((axis, (_, size))), None) = (channels.next(), channels.next()) else { return false };
        let names: &[&str] = match (size, sample_type) {
            (3, _) => &["rgb-color"],
            (4, SampleType::U8) => &["rgba-color", "4-color"],
            (4, _) => &["rgba-color"],
            _ => &[],
        };
        self.is_kind(axis, names)
    }

    /// Returns whether an axis runs along time: its kind, its label or the space says so, or its index has a type, as
    /// in the sequences of 3D Slicer.
    pub(super) fn is_time(&self, axis: usize) -> bool {
        let kind = self.kind(axis);
        if self.time_axis == Some(axis) || kind.as_deref() == Some("time") {
            return true;
        }
        let mut labels = self.text.get(["labels"]).unwrap_or_default().split('"').skip(1).step_by(2);
        let label = labels.nth(axis).unwrap_or_default().to_ascii_lowercase();
        let named = matches!(label.as_str(), "time" | "t" | "frame");
        matches!(kind.as_deref(), None | Some("list")) && (named || self.indexed.contains(&axis))
    }
}

/// Parses `n` vectors, `(x,y,z) none (x,y,z) ...`, or of four numbers, the last of which is time; blanks may stand
/// anywhere.
fn vectors(header: &TextHeader, text: &str, n: usize, has_time: bool) -> Result<Vec<Option<DVec4>>> {
    let form = if has_time { "(x,y,z,t)" } else { "(x,y,z)" };
    let bad = || header.error(format!("vectors {text:?}: expected {n} of the form {form} or none"));
    let mut vectors = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            vectors.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inside, after) = rest.strip_prefix('(').and_then(|r| r.split_once(')')).ok_or_else(bad)?;
        let numbers: Vec<f64> =
            inside.split(',').map(|word| word.trim().parse().map_err(|_| bad())).collect::<Result<_>>()?;
        let vector = match (&numbers[..], has_time) {
            (&[x, y, z], false) => DVec4::new(x, y, z, 0.0),
            (&[x, y, z, time], true) => DVec4::new(x, y, z, time),
            _ => return Err(bad()),
        };
        // Some writers put NaN for "none".
        vectors.push((!vector.is_nan()).then_some(vector));
        rest = after.trim_start();
    }
    if vectors.len() == n { Ok(vectors) } else { Err(bad()) }
}

/// The largest number of segments that a file may name.
const MOST_SEGMENTS: usize = 1 << 16;

/// Adds a statement of 3D Slicer about a segment, such as `Segment3_Color` and `0.9 0.3 0.1`. Segments that overlap lie
/// in layers, the channels of the file; before they had layers, each was a channel of its own, with the label 1.
fn describe(segments: &mut BTreeMap<u32, Segment>, name: &str, value: &str) {
    let Some((number, what)) = name.strip_prefix("Segment").and_then(|rest| rest.split_once('_')) else { return };
    let Ok(number) = number.parse::<u32>() else { return };
    if segments.len() >= MOST_SEGMENTS && !segments.contains_key(&number) {
        return;
    }
    let new = || Segment { channel: number, label: 1, ..Segment::default() };
    let segment = segments.entry(number).or_insert_with(new);
    match what {
        "Name" => segment.name = plain_name(value),
        "LabelValue" => segment.label = value.trim().parse().unwrap_or(segment.label),
        "Layer" => segment.channel = value.trim().parse().unwrap_or(segment.channel),
        "Color" => {
            let channels: Vec<f64> = value.split_whitespace().filter_map(|part| part.parse().ok()).collect();
            if let [red, green, blue] = channels[..] {
                segment.color = Some([red, green, blue].map(|c| (255.0 * c).round() as u8));
            }
        }
        _ => {}
    }
}

/// Returns the name of a field in lower case. Old spellings without a blank become the new ones.
fn canonical(name: &str) -> String {
    let name = name.trim().to_ascii_lowercase();
    match name.as_str() {
        "datafile" => "data file".to_owned(),
        "lineskip" => "line skip".to_owned(),
        "byteskip" => "byte skip".to_owned(),
        _ => name,
    }
}
