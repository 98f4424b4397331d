//! Legacy files of structured points, .vtk, as text or as big-endian bytes.

use glam::DVec3;

use super::{At, Lattice, numbers};
use crate::error::Result;
use crate::formats::decode::{Layout, lattice, read_all};
use crate::formats::input::Input;
use crate::volume::{Endian, SampleType, Volume};

/// The first bytes of every legacy file.
pub(in crate::formats) const MAGIC: &[u8] = b"# vtk DataFile Version";

/// Reads the volume of a header that begins here: its first array with one number per sample.
pub(in crate::formats) fn read(input: Input, spacing: Option<[f64; 3]>) -> Result<Volume> {
    let mut reader = Reader::open(input)?;
    let (at, sample_type) = reader.find()?;
    let Reader { input, layout, lattice: placed, .. } = reader;
    let (sizes, placement) = placed.placed(at);
    let dims = lattice(input.path(), &sizes)?;
    let grid = placement.grid(input.path(), dims, spacing)?;
    let samples = read_all(input, grid.len(), sample_type, layout)?;
    placement.volume(grid, samples)
}

struct Reader {
    input: Input,
    layout: Layout,
    lattice: Lattice,
    /// What the arrays to come belong to, and their number.
    of: Option<(At, u64)>,
}

impl Reader {
    /// Reads the three lines that every file begins with.
    fn open(mut input: Input) -> Result<Self> {
        let magic = input.line()?.unwrap_or_default();
        if !magic.as_bytes().starts_with(MAGIC) {
            return Err(input.error("is not a legacy VTK file"));
        }
        input.line()?;
        let coding = input.line()?.unwrap_or_default();
        let layout = match coding.trim().to_ascii_uppercase().as_str() {
            "ASCII" => Layout::Text,
            "BINARY" => Layout::Binary(Endian::Big),
            _ => return Err(input.error(format!("its third line is {coding:?}, expected ASCII or BINARY"))),
        };
        let lattice = Lattice { extent: [[0, -1]; 3], spacing: [1.0; 3], origin: DVec3::ZERO, directions: DVec3::AXES };
        Ok(Self { input, layout, lattice, of: None })
    }

    /// Reads up to the first sample of the array.
    fn find(&mut self) -> Result<(At, SampleType)> {
        while let Some(line) = self.input.line()? {
            let line = line.trim();
            let Some(keyword) = line.split_ascii_whitespace().next() else { continue };
            let rest = line[keyword.len()..].trim();
            let words: Vec<&str> = rest.split_ascii_whitespace().collect();
            let bad = |input: &Input| input.error(format!("header line {line:?} is not understood"));
            match keyword.to_ascii_uppercase().as_str() {
                "DATASET" if rest.eq_ignore_ascii_case("STRUCTURED_POINTS") => {}
                "DATASET" => return Err(self.input.error(format!("is of type {rest:?}, expected STRUCTURED_POINTS"))),
                "DIMENSIONS" => {
                    let dims: [i64; 3] = numbers(rest).ok_or_else(|| bad(&self.input))?;
                    self.lattice.extent = dims.map(|n| [0, n.saturating_sub(1)]);
                }
                "EXTENT" => {
                    let [x0, x1, y0, y1, z0, z1] = numbers(rest).ok_or_else(|| bad(&self.input))?;
                    self.lattice.extent = [[x0, x1], [y0, y1], [z0, z1]];
                }
                "SPACING" | "ASPECT_RATIO" => {
                    self.lattice.spacing = numbers(rest).ok_or_else(|| bad(&self.input))?;
                }
                "ORIGIN" => {
                    self.lattice.origin = DVec3::from_array(numbers(rest).ok_or_else(|| bad(&self.input))?);
                }
                "POINT_DATA" | "CELL_DATA" => {
                    let at = if keyword.eq_ignore_ascii_case("POINT_DATA") { At::Points } else { At::Cells };
                    self.of = Some((at, rest.parse().map_err(|_| bad(&self.input))?));
                }
                "SCALARS" => {
                    let (at, count) = self.of.ok_or_else(|| bad(&self.input))?;
                    let (Some(kind), components) = (words.get(1), words.get(2).copied().unwrap_or("1")) else {
                        return Err(bad(&self.input));
                    };
                    let table = self.input.line()?.unwrap_or_default();
                    if !table.trim().to_ascii_uppercase().starts_with("LOOKUP_TABLE") {
                        return Err(self.input.error(format!("expected LOOKUP_TABLE before samples, not {table:?}")));
                    }
                    if components == "1" {
                        return Ok((at, self.sample_type(kind)?));
                    }
                    self.skip(kind, components.parse().map_err(|_| bad(&self.input))?, count)?;
                }
                // Bytes; in text they are fractions of 255.
                "COLOR_SCALARS" => {
                    let (at, count) = self.of.ok_or_else(|| bad(&self.input))?;
                    let components = words.get(1).and_then(|text| text.parse().ok()).ok_or_else(|| bad(&self.input))?;
                    if components == 1 && self.layout != Layout::Text {
                        return Ok((at, SampleType::U8));
                    }
                    self.skip("unsigned_char", components, count)?;
                }
                "VECTORS" | "NORMALS" => {
                    let (_, count) = self.of.ok_or_else(|| bad(&self.input))?;
                    self.skip(words.get(1).ok_or_else(|| bad(&self.input))?, 3, count)?;
                }
                // Its arrays follow, each behind a line of its own.
                "FIELD" => {}
                // Names and units of components, up to a blank line.
                "METADATA" => while self.input.line()?.is_some_and(|line| !line.trim().is_empty()) {},
                _ => {
                    // An array of a field: NAME COMPONENTS TUPLES TYPE.
                    let [components, tuples, kind] = words[..] else { return Err(bad(&self.input)) };
                    let number = |text: &str| text.parse::<u64>().map_err(|_| bad(&self.input));
                    let (components, tuples) = (number(components)?, number(tuples)?);
                    match self.of {
                        Some((at, count)) if (components, tuples) == (1, count) => {
                            return Ok((at, self.sample_type(kind)?));
                        }
                        _ => self.skip(kind, components, tuples)?,
                    }
                }
            }
        }
        Err(self.input.error("has no array with one number per sample"))
    }

    fn sample_type(&self, name: &str) -> Result<SampleType> {
        let refused = || self.input.error(format!("has an array of type {name:?}, which is not read"));
        let name = name.to_ascii_lowercase();
        match name.as_str() {
            // As 64-bit Unix has them, where nearly all such files are written.
            "long" | "vtktypeint64" => Ok(SampleType::I64),
            "unsigned_long" | "vtktypeuint64" => Ok(SampleType::U64),
            _ => SampleType::from_name(&name.replace('_', " ")).ok_or_else(refused),
        }
    }

    /// Skips an array.
    fn skip(&mut self, kind: &str, components: u64, tuples: u64) -> Result<()> {
        let count = components.saturating_mul(tuples);
        match self.layout {
            Layout::Binary(_) => {
                let size = self.sample_type(kind)?.size() as u64;
                self.input.skip(count.saturating_mul(size))
            }
            Layout::Text => {
                let mut token = String::new();
                for _ in 0..count {
                    if !self.input.token(&mut token)? {
                        return Err(self.input.error("ends before its samples"));
                    }
                }
                Ok(())
            }
        }
    }
}
