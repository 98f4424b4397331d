//! Transfer functions as JSON files.
//!
//! ```json
//! {"unit_distance": 1.0, "points": [{"value": 0, "color": "#rrggbb", "opacity": 0.0},
//!                                   {"value": 1, "color": [1.0, 0.9, 0.8], "opacity": 0.4}]}
//! ```

use std::fmt;
use std::path::Path;

use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};
use serde_json::value::RawValue;

use super::{ControlPoint, TransferFunction};
use crate::color;
use crate::error::{Error, Result};

/// The file. Points stay text until each is parsed by itself, so an error can name the point and its line.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with the keys `points` and `unit_distance`")]
struct Document<'a> {
    #[serde(default)]
    unit_distance: Option<f64>,
    #[serde(borrow)]
    points: Vec<&'a RawValue>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with the keys `value`, `color` and `opacity`")]
struct Point {
    value: f64,
    color: Color,
    opacity: f64,
}

struct Color([f64; 3]);

impl<'de> Deserialize<'de> for Color {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct ColorVisitor;
        impl<'de> Visitor<'de> for ColorVisitor {
            type Value = Color;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a colour \"#rrggbb\" or [red, green, blue] from 0 to 1")
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<Color, E> {
                color::hex(text).map(Color).ok_or_else(|| E::invalid_value(de::Unexpected::Str(text), &self))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Color, A::Error> {
                let mut color = [0.0; 3];
                for (i, c) in color.iter_mut().enumerate() {
                    *c = seq.next_element()?.ok_or_else(|| de::Error::invalid_length(i, &self))?;
                }
                match seq.next_element::<de::IgnoredAny>()? {
                    None => Ok(Color(color)),
                    Some(_) => Err(de::Error::invalid_length(4, &self)),
                }
            }
        }
        deserializer.deserialize_any(ColorVisitor)
    }
}

/// The message of a JSON error without the position at its end.
fn bare(error: &serde_json::Error) -> String {
    let text = error.to_string();
    text.split_once(" at line ").map_or(text.clone(), |(message, _)| message.to_owned())
}

impl TransferFunction {
    /// Reads a transfer function from JSON text.
    ///
    /// # Errors
    /// [`Error::Transfer`] for malformed JSON, missing or unknown keys, wrong colours, and all that
    /// [`TransferFunction::new`] refuses. It names the line and, inside a point, the point.
    pub fn from_json(text: &str) -> Result<Self> {
        let document: Document<'_> = serde_json::from_str(text)
            .map_err(|e| Error::Transfer(format!("line {} column {}: {}", e.line(), e.column(), bare(&e))))?;
        let mut points: Vec<ControlPoint> = Vec::with_capacity(document.points.len());
        for raw in document.points {
            let number = points.len() + 1;
            // The raw text is a slice of `text`: its offset gives the line.
            let start = raw.get().as_ptr().addr() - text.as_ptr().addr();
            let line = 1 + text[..start].bytes().filter(|&b| b == b'\n').count();
            let error = |line: usize, reason: &str| Error::Transfer(format!("point {number} (line {line}): {reason}"));
            let Point { value, color, opacity } =
                serde_json::from_str(raw.get()).map_err(|e| error(line + e.line() - 1, &bare(&e)))?;
            let point = ControlPoint { value, color: color.0, opacity };
            point.check(points.last()).map_err(|reason| error(line, &reason))?;
            points.push(point);
        }
        Self::new(points, document.unit_distance)
    }

    /// Reads a transfer function from a JSON file.
    ///
    /// # Errors
    /// [`Error::Read`] if the file cannot be read, [`Error::Format`] if [`TransferFunction::from_json`] refuses its
    /// text.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
        Self::from_json(&text).map_err(|e| {
            let reason = match e {
                Error::Transfer(reason) => reason,
                other => other.to_string(),
            };
            Error::Format { path: path.to_owned(), reason, hint: None }
        })
    }

    /// The function as JSON text, one point per line. [`TransferFunction::from_json`] reads back the same function.
    #[must_use]
    pub fn to_json(&self) -> String {
        let points: Vec<String> = self
            .points
            .iter()
            .map(|p| {
                let [r, g, b] = p.color.map(number);
                let (value, opacity) = (number(p.value), number(p.opacity));
                format!("    {{\"value\": {value}, \"color\": [{r}, {g}, {b}], \"opacity\": {opacity}}}")
            })
            .collect();
        let unit = self.unit_distance.map(|u| format!("  \"unit_distance\": {},\n", number(u))).unwrap_or_default();
        format!("{{\n{unit}  \"points\": [\n{}\n  ]\n}}\n", points.join(",\n"))
    }
}

/// The shortest decimal that reads back as the same number. Numbers of a transfer function are finite.
fn number(value: f64) -> String {
    format!("{value:?}")
}
