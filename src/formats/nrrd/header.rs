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
        let (mut fields, mut segments) = (HashMap::new(), BTreeMap::new());
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
            // "key:=value" is metadata of an application.
            if let Some(value) = value.strip_prefix('=') {
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
        self.directions = self.get("space directions").map(|text| self.vectors(text, dimension)).transpose()?;
        self.origin = match self.get("space origin").map(|text| self.vectors(text, 1)).transpose()? {
            Some(vectors) => match vectors[..] {
                [Some(origin)] => Some(origin),
                _ => return Err(self.error("space origin: expected one vector such as (0,0,0)")),
            },
            None => None,
        };
        self.patient_flip = match self.get("space").map(str::to_ascii_lowercase).as_deref() {
            Some("left-posterior-superior" | "lps") => Some(DVec3::ONE),
            Some("right-anterior-superior" | "ras") => Some(DVec3::new(-1.0, -1.0, 1.0)),
            Some("left-anterior-superior" | "las") => Some(DVec3::new(1.0, -1.0, 1.0)),
            // These spaces are not oriented in the patient.
            Some("scanner-xyz" | "3d-right-handed" | "3d-left-handed") | None => None,
            Some(other) if other.ends_with("-time") || matches!(other, "last" | "rast" | "lpst") => {
                return Err(self.error(format!("space {other:?} has time: save one point in time alone")));
            }
            Some(other) => return Err(self.error(format!("space {other:?} is unknown"))),
        };
        if self.patient_flip.is_some() && self.directions.is_none() {
            // A named space without directions does not orient the lattice.
            self.patient_flip = None;
        }
        if let Some(text) = self.get("space dimension") {
            let n: u32 = self.parsed("space dimension", text)?;
            if n != 3 {
                return Err(self.error(format!("space dimension: {n}, expected 3")));
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

    /// Parses `n` vectors, `(x,y,z) none (x,y,z) ...`; blanks may stand anywhere.
    fn vectors(&self, text: &str, n: usize) -> Result<Vec<Option<DVec3>>> {
        let bad = || self.error(format!("vectors {text:?}: expected {n} of the form (x,y,z) or none"));
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
            let [x, y, z] = numbers[..] else { return Err(bad()) };
            // Some writers put NaN for "none".
            let vector = DVec3::new(x, y, z);
            vectors.push(if vector.is_nan() { None } else { Some(vector) });
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
