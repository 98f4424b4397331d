//! NRRD headers: their fields, and the meaning of the fields that have a value per axis.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::error::{Error, Result};
use crate::formats::input::Input;
use crate::formats::placement::plain_name;
use crate::volume::Segment;

/// The most axes: Teem's limit, NRRD_DIM_MAX.
const MAX_AXES: usize = 16;

/// The fields of a header. Names are in lower case and keep the blanks between their words.
pub(super) struct Header {
    path: PathBuf,
    fields: HashMap<String, String>,
    /// Labels by their numbers in the file, if it is a segmentation of 3D Slicer.
    segments: BTreeMap<u32, Segment>,
    /// Samples along each axis, fastest first, as stated; not yet checked to be positive.
    pub(super) sizes: Vec<i64>,
    /// World distance between samples, one per axis.
    pub(super) spacings: Option<Vec<f64>>,
    /// World vectors between samples, one per axis; `None` for an axis that is not spatial.
    pub(super) directions: Option<Vec<Option<DVec3>>>,
    /// World position of the first sample.
    pub(super) origin: Option<DVec3>,
    /// The axis along time, if the header's space has time and directions say which axis that is.
    time_axis: Option<usize>,
    /// The axes whose index has a type, as in the sequences of 3D Slicer.
    indexed: Vec<usize>,
    /// Factors from the header's space to DICOM's patient space; `None` if the header's is not a patient space.
    pub(super) patient_flip: Option<DVec3>,
}

impl Header {
    /// Reads up to the blank line before attached data, the end of a detached header, or its list of files.
    pub(super) fn read(input: &mut Input) -> Result<Self> {
        let path = input.path().to_owned();
        let magic = input.line()?.unwrap_or_default();
        let version = magic.trim_end().strip_prefix("NRRD000");
        if !matches!(version, Some("1" | "2" | "3" | "4" | "5")) {
            return Err(input.error(format!("begins with {magic:?}, expected NRRD0001 to NRRD0005")));
        }
        let (mut fields, mut segments, mut indexed) = (HashMap::new(), BTreeMap::new(), Vec::new());
        while let Some(line) = input.line()? {
            let line = line.trim_end();
            if line.is_empty() {
                break;
            }
            if line.starts_with('#') {
                continue;
            }
            let Some((name, value)) = line.split_once(':') else {
                return Err(input.error(format!("header line {line:?} is not \"field: value\"")));
            };
            // "key:=value" is metadata of an application, such as "axis 3 index type:=numeric".
            if let Some(value) = value.strip_prefix('=') {
                let axis = name.strip_prefix("axis ").and_then(|rest| rest.strip_suffix(" index type"));
                indexed.extend(axis.and_then(|axis| axis.parse::<usize>().ok()).filter(|axis| *axis < MAX_AXES));
                describe(&mut segments, name, value);
                continue;
            }
            let name = canonical(name);
            let is_list = name == "data file" && value.split_ascii_whitespace().next() == Some("LIST");
            if let Some(first) = fields.insert(name.clone(), value.trim().to_owned()) {
                return Err(input.error(format!("field {name:?} is given twice: {first:?} and {:?}", value.trim())));
            }
            if is_list {
                break;
            }
        }
        Self::interpret(Self {
            path,
            fields,
            segments,
            sizes: Vec::new(),
            spacings: None,
            directions: None,
            origin: None,
            time_axis: None,
            indexed,
            patient_flip: None,
        })
    }

    fn interpret(mut self) -> Result<Self> {
        let dimension: usize = self.parsed("dimension", self.required("dimension")?)?;
        if !(1..=MAX_AXES).contains(&dimension) {
            return Err(self.error(format!("dimension: {dimension}, expected 1 to {MAX_AXES}")));
        }
        self.sizes = self.list("sizes", self.required("sizes")?, dimension)?;
        self.spacings = self.get("spacings").map(|text| self.list("spacings", text, dimension)).transpose()?;
        let space = self.get("space").unwrap_or("3D-right-handed").to_ascii_lowercase();
        // A fourth coordinate is time.
        let (space, has_time) = match space.as_str() {
            "rast" => ("ras", true),
            "last" => ("las", true),
            "lpst" => ("lps", true),
            space => space.strip_suffix("-time").map_or((space, false), |space| (space, true)),
        };
        self.patient_flip = match space {
            "left-posterior-superior" | "lps" => Some(DVec3::ONE),
            "right-anterior-superior" | "ras" => Some(DVec3::new(-1.0, -1.0, 1.0)),
            "left-anterior-superior" | "las" => Some(DVec3::new(1.0, -1.0, 1.0)),
            // These spaces are not oriented in the patient.
            "scanner-xyz" | "3d-right-handed" | "3d-left-handed" => None,
            other => return Err(self.error(format!("space {other:?} is unknown"))),
        };
        let directions =
            self.get("space directions").map(|text| self.vectors(text, dimension, has_time)).transpose()?;
        if let (Some(directions), true) = (&directions, has_time) {
            let moves = |vector: &Option<(DVec3, f64)>| vector.is_some_and(|(_, time)| time != 0.0);
            let moving: Vec<usize> = (0..directions.len()).filter(|&axis| moves(&directions[axis])).collect();
            let still = |&axis: &usize| directions[axis].is_some_and(|(space, _)| space == DVec3::ZERO);
            self.time_axis = match moving[..] {
                [] => None,
                [axis] if still(&axis) => Some(axis),
                _ => return Err(self.error("space directions: slices at unlike times, which is not read")),
            };
        }
        self.directions = directions.map(|directions| {
            let in_space = |(axis, vector): (usize, Option<(DVec3, f64)>)| {
                vector.map(|(space, _)| space).filter(|_| self.time_axis != Some(axis))
            };
            directions.into_iter().enumerate().map(in_space).collect()
        });
        self.origin = match self.get("space origin").map(|text| self.vectors(text, 1, has_time)).transpose()? {
            Some(vectors) => match vectors[..] {
                [Some((origin, _))] => Some(origin),
                _ => return Err(self.error("space origin: expected one vector such as (0,0,0)")),
            },
            None => None,
        };
        if self.patient_flip.is_some() && self.directions.is_none() {
            // A named space without directions does not orient the lattice.
            self.patient_flip = None;
        }
        if let Some(text) = self.get("space dimension") {
            let n: u32 = self.parsed("space dimension", text)?;
            if n != if has_time { 4 } else { 3 } {
                return Err(self.error(format!("space dimension: {n}, expected {}", if has_time { 4 } else { 3 })));
            }
        }
        Ok(self)
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// An [`Error::Format`] about this header.
    pub(super) fn error(&self, reason: impl Into<String>) -> Error {
        Error::format(&self.path, reason)
    }

    /// The labels of a segmentation of 3D Slicer.
    pub(super) fn segments(&self) -> Option<Vec<Segment>> {
        (!self.segments.is_empty()).then(|| self.segments.values().cloned().collect())
    }

    /// The text of a field.
    pub(super) fn get(&self, name: &str) -> Option<&str> {
        self.fields.get(name).map(String::as_str)
    }

    /// The text of a mandatory field.
    pub(super) fn required(&self, name: &str) -> Result<&str> {
        self.get(name).ok_or_else(|| self.error(format!("the NRRD header has no field {name:?}")))
    }

    /// Whether an axis is spatial: it has a direction or, in a header without directions, a spatial kind.
    pub(super) fn is_spatial(&self, axis: usize) -> bool {
        if let Some(directions) = &self.directions {
            return directions.get(axis).is_some_and(Option::is_some);
        }
        self.kind(axis).is_none_or(|kind| matches!(kind.as_str(), "domain" | "space"))
    }

    /// What an axis is, if that is stated.
    pub(super) fn kind(&self, axis: usize) -> Option<String> {
        let kind = self.get("kinds")?.split_ascii_whitespace().nth(axis)?.to_ascii_lowercase();
        (kind != "none" && kind != "???").then_some(kind)
    }

    /// Whether an axis runs along time: its kind, its label or the space says so, or its index has a type, as in the
    /// sequences of 3D Slicer.
    pub(super) fn is_time(&self, axis: usize) -> bool {
        let kind = self.kind(axis);
        if self.time_axis == Some(axis) || kind.as_deref() == Some("time") {
            return true;
        }
        let mut labels = self.get("labels").unwrap_or_default().split('"').skip(1).step_by(2);
        let label = labels.nth(axis).unwrap_or_default().to_ascii_lowercase();
        let named = matches!(label.as_str(), "time" | "t" | "frame");
        matches!(kind.as_deref(), None | Some("list")) && (named || self.indexed.contains(&axis))
    }

    fn parsed<T: std::str::FromStr>(&self, name: &str, text: &str) -> Result<T> {
        text.trim().parse().map_err(|_| self.error(format!("{name}: {text:?} is not a number that fits")))
    }

    fn list<T: std::str::FromStr>(&self, name: &str, text: &str, n: usize) -> Result<Vec<T>> {
        let list = text.split_ascii_whitespace().map(|word| self.parsed(name, word)).collect::<Result<Vec<T>>>()?;
        if list.len() != n {
            return Err(self.error(format!("{name}: {} numbers for {n} axes", list.len())));
        }
        Ok(list)
    }

    /// Parses `n` vectors, `(x,y,z) none (x,y,z) ...`, or of four numbers, the last of which is time; blanks may stand
    /// anywhere.
    fn vectors(&self, text: &str, n: usize, has_time: bool) -> Result<Vec<Option<(DVec3, f64)>>> {
        let form = if has_time { "(x,y,z,t)" } else { "(x,y,z)" };
        let bad = || self.error(format!("vectors {text:?}: expected {n} of the form {form} or none"));
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
            let (vector, time) = match (&numbers[..], has_time) {
                (&[x, y, z], false) => (DVec3::new(x, y, z), 0.0),
                (&[x, y, z, time], true) => (DVec3::new(x, y, z), time),
                _ => return Err(bad()),
            };
            // Some writers put NaN for "none".
            vectors.push(if vector.is_nan() || time.is_nan() { None } else { Some((vector, time)) });
            rest = after.trim_start();
        }
        if vectors.len() != n {
            return Err(bad());
        }
        Ok(vectors)
    }
}

/// The most segments that a file may name.
const MOST_SEGMENTS: usize = 1 << 16;

/// What metadata of 3D Slicer say of a segment, such as `Segment3_Color` and `0.9 0.3 0.1`. Segments that overlap lie
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

/// A field's name in lower case. Old spellings without a blank become the new ones.
fn canonical(name: &str) -> String {
    let name = name.trim().to_ascii_lowercase();
    match name.as_str() {
        "datafile" => "data file".to_owned(),
        "lineskip" => "line skip".to_owned(),
        "byteskip" => "byte skip".to_owned(),
        _ => name,
    }
}
