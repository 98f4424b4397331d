//! Transfer functions as JSON files.
//!
//! ```json
//! {"unit_distance": 1.0, "points": [{"value": 0, "color": "orange", "opacity": 0.0},
//!                                   {"value": 0.5, "color": "#rrggbb", "opacity": 0.1},
//!                                   {"value": 1, "color": [1.0, 0.9, 0.8], "opacity": 0.4}],
//!  "gradient_opacity": [{"magnitude": 0, "opacity": 0.0}, {"magnitude": 20, "opacity": 1.0}],
//!  "classification": "band-limited"}
//! ```

use std::path::Path;

use serde::Deserialize;
use serde_json::Value;
use serde_json::value::RawValue;

use super::{Classification, ControlPoint, GradientPoint, TransferFunction};
use crate::error::{Error, Result};
use crate::transfer::color;
use voxsplat_volume::files::{self, fault};

/// The largest file that is read, in bytes: 1 KiB for each of [`TransferFunction::MAX_POINTS`].
const MAX_BYTES: u64 = 4 << 20;

/// The document in a file. Points stay text until each is parsed by itself, so that an error can name the point and its
/// line.
#[derive(Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "an object with the keys `points`, `unit_distance`, `gradient_opacity` and `classification`"
)]
struct FunctionDocument<'a> {
    #[serde(default)]
    unit_distance: Option<f64>,
    #[serde(borrow)]
    points: Vec<&'a RawValue>,
    #[serde(default)]
    gradient_opacity: Vec<GradientPoint>,
    #[serde(default)]
    classification: Classification,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with the keys `value`, `color` and `opacity`")]
struct FunctionPoint {
    value: f64,
    color: Value,
    opacity: f64,
}

/// Reads red, green and blue of a colour in either notation.
fn channels(color: &Value) -> Option<[f64; 3]> {
    color.as_str().map_or_else(|| Deserialize::deserialize(color).ok(), color::parse)
}

impl TransferFunction {
    /// Reads a transfer function from JSON text.
    ///
    /// # Errors
    /// [`Error::Transfer`] for malformed JSON, missing or unknown keys, wrong colours, and all that
    /// [`TransferFunction::new`] refuses. The message names the line and, inside a point, the point.
    pub fn from_json(text: &str) -> Result<Self> {
        let document: FunctionDocument<'_> = serde_json::from_str(text)
            .map_err(|e| Error::Transfer(format!("line {} column {}: {}", e.line(), e.column(), fault(&e))))?;
        if document.points.len() > Self::MAX_POINTS {
            return Err(Self::wrong_count(document.points.len()));
        }
        let mut points: Vec<ControlPoint> = Vec::with_capacity(document.points.len());
        let (mut line, mut passed) = (1, 0);
        for raw in document.points {
            let number = points.len() + 1;
            // The raw text is a slice of `text` behind the raw text of the point before: its offset gives the line.
            let start = raw.get().as_ptr().addr() - text.as_ptr().addr();
            line += text[passed..start].bytes().filter(|&b| b == b'\n').count();
            passed = start;
            let error = |line: usize, reason: &str| Error::Transfer(format!("point {number} (line {line}): {reason}"));
            let FunctionPoint { value, color, opacity } =
                serde_json::from_str(raw.get()).map_err(|e| error(line + e.line() - 1, &fault(&e)))?;
            let color = channels(&color).ok_or_else(|| {
                let expected = "expected \"#rrggbb\", a colour name of CSS or [red, green, blue] from 0 to 1";
                let tip = color.as_str().map(color::tip).unwrap_or_default();
                error(line, &format!("colour {color}, {expected}{tip}"))
            })?;
            let point = ControlPoint { value, color, opacity };
            point.check(points.last()).map_err(|reason| error(line, &reason))?;
            points.push(point);
        }
        let transfer = Self::new(points, document.unit_distance)?.with_gradient_opacity(document.gradient_opacity)?;
        Ok(transfer.with_classification(document.classification))
    }

    /// Reads a transfer function from a JSON file.
    ///
    /// # Errors
    /// [`Error::Input`] if the file cannot be read, is not a regular file (standard input excepted), takes over 4 MiB,
    /// or [`TransferFunction::from_json`] refuses its text.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        Self::from_json(&files::read_text(path, MAX_BYTES)?).map_err(|e| e.in_file(path))
    }

    /// Returns the function as JSON text, one point per line. [`TransferFunction::from_json`] reads the same function
    /// back.
    #[must_use]
    pub fn to_json(&self) -> String {
        // Debug prints the shortest decimal that reads back as the same number. All numbers are finite.
        let point = |ControlPoint { value, color, opacity }: &ControlPoint| {
            format!("    {{\"value\": {value:?}, \"color\": {color:?}, \"opacity\": {opacity:?}}}")
        };
        let steepness = |GradientPoint { magnitude, opacity }: &GradientPoint| {
            format!("    {{\"magnitude\": {magnitude:?}, \"opacity\": {opacity:?}}}")
        };
        let points = self.points.iter().map(point).collect::<Vec<_>>().join(",\n");
        let gradient = self.gradient.iter().map(steepness).collect::<Vec<_>>().join(",\n");
        let unit = self.unit_distance.map(|unit| format!("  \"unit_distance\": {unit:?},\n")).unwrap_or_default();
        let gradient = match gradient.as_str() {
            "" => String::new(),
            points => format!(",\n  \"gradient_opacity\": [\n{points}\n  ]"),
        };
        let classification = match self.classification {
            Classification::Auto => String::new(),
            way => format!(",\n  \"classification\": \"{way}\""),
        };
        format!("{{\n{unit}  \"points\": [\n{points}\n  ]{gradient}{classification}\n}}\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn json(points: usize) -> String {
        let point = r##"{"value": 1, "color": "#ffffff", "opacity": 0.5}"##;
        format!("{{\"points\": [\n{}\n]}}", vec![point; points].join(",\n"))
    }

    /// The text of 100 000 points took 100 s when each was read before they were counted.
    #[test]
    fn too_many_points_are_refused_before_one_is_read() {
        assert_eq!(TransferFunction::from_json(&json(4096)).unwrap().points().len(), 4096);
        let text = json(100_000).replace("0.5}", "\"half\"}");
        let error = TransferFunction::from_json(&text).unwrap_err().to_string();
        assert_eq!(error, "transfer function: 100000 control points, expected 1 to 4096");
    }

    #[test]
    fn lines_are_counted_from_point_to_point() {
        let text = json(300).replace("\n]}", ",\n\n {\"value\": 0, \"color\": \"#ffffff\", \"opacity\": 0.5}]}");
        let error = TransferFunction::from_json(&text).unwrap_err().to_string();
        assert!(error.contains("point 301 (line 303): value 0 comes after 1"), "{error}");
    }

    #[test]
    fn a_long_color_is_not_quoted_whole() {
        let text = json(1).replace("#ffffff", &"#f".repeat(50_000));
        let error = TransferFunction::from_json(&text).unwrap_err().to_string();
        assert!(error.len() < 600 && error.contains("point 1 (line 2)"), "{error}");
        assert!(error.ends_with("from 0 to 1"), "{error}");
    }

    #[test]
    fn files_are_read_up_to_their_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.json");
        let load = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            TransferFunction::load(&path).map_err(|e| e.to_string())
        };
        assert!(load(json(2).as_bytes()).is_ok());
        assert!(load(&vec![b' '; MAX_BYTES as usize + 1]).unwrap_err().ends_with("expected at most 4194304 bytes"));
        assert!(load(b"\xff").unwrap_err().contains("is no text"));
    }
}
