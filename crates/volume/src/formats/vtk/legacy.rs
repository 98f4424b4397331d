//! Legacy files of structured points, .vtk, as text or as big-endian bytes.

use glam::DVec3;

use super::{At, Found, ImageLattice, SampleArray, Wanted, note_name, numbers};
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::formats::LoadOptions;
use crate::formats::decode::{Layout, skip};
use crate::formats::input::Input;
use crate::volume::{Endian, SampleType};

/// Reads the volume of an array of a header at the start of `input`.
pub(in crate::formats) fn read(input: Input, options: &LoadOptions, wanted: Wanted<'_>) -> Result<Found> {
    let mut reader = Reader::open(input)?;
    match reader.find(wanted)? {
        Some(array) => reader.lattice.read(&array, reader.input, reader.layout, options),
        None => Ok(Found::Others(reader.names)),
    }
}

/// Reads the next line that is not blank: VTK skips blank lines.
fn word_line(input: &mut Input) -> Result<String> {
    while let Some(line) = input.line()? {
        if !line.trim().is_empty() {
            return Ok(line);
        }
    }
    Ok(String::new())
}

struct Reader {
    input: Input,
    layout: Layout,
    lattice: ImageLattice,
    /// The places (points or cells) that the arrays to come belong to, and their number.
    of: Option<(At, u64)>,
    /// The names of arrays that were skipped.
    names: Vec<String>,
}

impl Reader {
    /// Reads the three lines that every file begins with.
    fn open(mut input: Input) -> Result<Self> {
        let magic = input.line()?.unwrap_or_default();
        refuse_if!(!magic.starts_with("# vtk DataFile Version"), input, "is not a legacy VTK file");
        input.line()?;
        let coding = word_line(&mut input)?;
        let layout = match coding.trim().to_ascii_uppercase().as_str() {
            "ASCII" => Layout::Text,
            "BINARY" => Layout::Binary(Endian::Big),
            _ => refuse!(input, "the line after its title is {coding:?}, expected ASCII or BINARY"),
        };
        let lattice =
            ImageLattice { extent: [[0, -1]; 3], spacing: [1.0; 3], origin: DVec3::ZERO, directions: DVec3::AXES };
        Ok(Self { input, layout, lattice, of: None, names: Vec::new() })
    }

    /// Reads up to the first sample of the array.
    fn find(&mut self, wanted: Wanted<'_>) -> Result<Option<SampleArray>> {
        while let Some(line) = self.input.line()? {
            let line = line.trim();
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            let Some(keyword) = words.first() else { continue };
            let rest = line[keyword.len()..].trim();
            let path = self.input.path().to_owned();
            let bad = || path.error(format!("header line {line:?} is not understood"));
            match keyword.to_ascii_uppercase().as_str() {
                "DATASET" => {
                    let is_image = rest.eq_ignore_ascii_case("STRUCTURED_POINTS");
                    refuse_if!(!is_image, path, "is of type {rest:?}, expected STRUCTURED_POINTS");
                }
                "DIMENSIONS" => {
                    let dims: [i64; 3] = numbers(rest).ok_or_else(bad)?;
                    self.lattice.extent = dims.map(|n| [0, n.saturating_sub(1)]);
                }
                "EXTENT" => {
                    let [x0, x1, y0, y1, z0, z1] = numbers(rest).ok_or_else(bad)?;
                    self.lattice.extent = [[x0, x1], [y0, y1], [z0, z1]];
                }
                "SPACING" | "ASPECT_RATIO" => self.lattice.spacing = numbers(rest).ok_or_else(bad)?,
                "ORIGIN" => self.lattice.origin = DVec3::from_array(numbers(rest).ok_or_else(bad)?),
                "POINT_DATA" => self.of = Some((At::Points, rest.parse().map_err(|_| bad())?)),
                "CELL_DATA" => self.of = Some((At::Cells, rest.parse().map_err(|_| bad())?)),
                // Its arrays follow, each behind a line of its own.
                "FIELD" => {}
                // Names and units of components, up to a blank line.
                "METADATA" => while self.input.line()?.is_some_and(|line| !line.trim().is_empty()) {},
                keyword => {
                    if let Some(array) = self.array(keyword, &words, wanted, bad)? {
                        return Ok(Some(array));
                    }
                }
            }
        }
        Ok(None)
    }

    /// Returns the array that a line begins, or `None` if it is skipped.
    fn array(
        &mut self,
        keyword: &str,
        line: &[&str],
        wanted: Wanted<'_>,
        bad: impl Fn() -> Error,
    ) -> Result<Option<SampleArray>> {
        let words = line.get(1..).unwrap_or_default();
        let is_field = !["SCALARS", "COLOR_SCALARS", "VECTORS", "NORMALS"].contains(&keyword);
        let (kind, components, tuples) = match (keyword, words) {
            ("SCALARS", [_, kind]) => (*kind, "1", None),
            ("SCALARS", [_, kind, components, ..]) => (*kind, *components, None),
            ("COLOR_SCALARS", [_, components, ..]) => ("unsigned_char", *components, None),
            ("VECTORS" | "NORMALS", [_, kind, ..]) => (*kind, "3", None),
            // An array of a field: NAME COMPONENTS TUPLES TYPE.
            (_, [components, tuples, kind]) if is_field => (*kind, *components, Some(*tuples)),
            _ => return Err(bad()),
        };
        let components: u64 = components.parse().map_err(|_| bad())?;
        let tuples: Option<u64> = tuples.map(|tuples| tuples.parse().map_err(|_| bad())).transpose()?;
        let Some(tuples) = tuples.or(self.of.map(|(_, count)| count)) else { return Err(bad()) };
        if keyword == "SCALARS" {
            let table = word_line(&mut self.input)?;
            let is_table = table.trim().to_ascii_uppercase().starts_with("LOOKUP_TABLE");
            refuse_if!(!is_table, self.input, "expected LOOKUP_TABLE before samples, not {table:?}");
        }
        // Colours are bytes; in text they are fractions of 255.
        let is_fraction = keyword == "COLOR_SCALARS" && self.layout == Layout::Text;
        // In a field the name comes first.
        let name = if is_field { line.first() } else { words.first() };
        let is_wanted = match wanted {
            Wanted::Scalars => components == 1,
            Wanted::Any => true,
            Wanted::Named(wanted) => name.is_some_and(|name| *name == wanted),
        };
        let at = self.of.filter(|(_, count)| tuples == *count && !is_fraction && is_wanted);
        if let Some((at, _)) = at {
            return Ok(Some(SampleArray { at, sample_type: self.sample_type(kind)?, components }));
        }
        let size = if self.layout == Layout::Text { 1 } else { self.sample_type(kind)?.size() };
        if self.of.is_some_and(|(_, count)| tuples == count) {
            note_name(&mut self.names, name.copied());
        }
        skip(&mut self.input, components.saturating_mul(tuples), size, self.layout)?;
        Ok(None)
    }

    fn sample_type(&self, name: &str) -> Result<SampleType> {
        let known = match name.to_ascii_lowercase().as_str() {
            // As 64-bit Unix has them, where nearly all such files are written.
            "long" | "vtktypeint64" => Some(SampleType::I64),
            "unsigned_long" | "vtktypeuint64" => Some(SampleType::U64),
            other => SampleType::from_name(&other.replace('_', " ")),
        };
        known.ok_or_else(|| self.input.error(format!("has an array of type {name:?}, which is not read")))
    }
}
