//! Legacy files of structured points, .vtk, as text or as big-endian bytes.

use glam::DVec3;

use super::{At, Lattice, axes, numbers};
use crate::error::Result;
use crate::formats::LoadOptions;
use crate::formats::decode::{Layout, lattice, read_all};
use crate::formats::input::Input;
use crate::formats::selection::picked;
use crate::volume::{Endian, SampleType, Volume};

/// Reads the volume of a header that begins here: its first array with one number per sample, or else with several.
pub(in crate::formats) fn read(input: Input, options: &LoadOptions) -> Result<Volume> {
    let path = input.path().to_owned();
    let again = input.at_most().is_some();
    let mut reader = Reader::open(input)?;
    let (at, sample_type, components) = match reader.find(false)? {
        Some(found) => found,
        None if again && reader.passed => {
            reader = Reader::open(Input::open(&path)?)?;
            reader.find(true)?.ok_or_else(|| reader.input.error("has changed while it was read"))?
        }
        None => return Err(reader.input.error("has no array with one number per sample")),
    };
    let Reader { input, layout, lattice: placed, .. } = reader;
    let (sizes, placement) = placed.placed(at);
    let dims = lattice(&path, &sizes)?;
    let grid = placement.grid(&path, dims, options.spacing)?;
    let (pick, contents) = picked(&path, &axes(components, sizes), options)?;
    let samples = read_all(input, &pick, sample_type, layout)?;
    Ok(placement.volume(grid, samples)?.with_contents(contents))
}

struct Reader {
    input: Input,
    layout: Layout,
    lattice: Lattice,
    /// What the arrays to come belong to, and their number.
    of: Option<(At, u64)>,
    /// Whether an array with several numbers per sample was passed.
    passed: bool,
}

impl Reader {
    /// Reads the three lines that every file begins with.
    fn open(mut input: Input) -> Result<Self> {
        let magic = input.line()?.unwrap_or_default();
        if !magic.starts_with("# vtk DataFile Version") {
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
        Ok(Self { input, layout, lattice, of: None, passed: false })
    }

    /// Reads up to the first sample of the array; `several` tells whether it may have several numbers per sample.
    fn find(&mut self, several: bool) -> Result<Option<(At, SampleType, u64)>> {
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
                    let components = components.parse().map_err(|_| bad(&self.input))?;
                    if components == 1 || several {
                        return Ok(Some((at, self.sample_type(kind)?, components)));
                    }
                    self.pass(kind, components, count)?;
                }
                // Bytes; in text they are fractions of 255.
                "COLOR_SCALARS" => {
                    let (at, count) = self.of.ok_or_else(|| bad(&self.input))?;
                    let components = words.get(1).and_then(|text| text.parse().ok()).ok_or_else(|| bad(&self.input))?;
                    if (components == 1 || several) && self.layout != Layout::Text {
                        return Ok(Some((at, SampleType::U8, components)));
                    }
                    match self.layout {
                        Layout::Text => self.skip("unsigned_char", components, count)?,
                        Layout::Binary(_) => self.pass("unsigned_char", components, count)?,
                    }
                }
                "VECTORS" | "NORMALS" => {
                    let (at, count) = self.of.ok_or_else(|| bad(&self.input))?;
                    let kind = words.get(1).ok_or_else(|| bad(&self.input))?;
                    if several {
                        return Ok(Some((at, self.sample_type(kind)?, 3)));
                    }
                    self.pass(kind, 3, count)?;
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
                        Some((at, count)) if tuples == count && (components == 1 || several) => {
                            return Ok(Some((at, self.sample_type(kind)?, components)));
                        }
                        Some((_, count)) if tuples == count => self.pass(kind, components, tuples)?,
                        _ => self.skip(kind, components, tuples)?,
                    }
                }
            }
        }
        Ok(None)
    }

    /// Skips an array with several numbers per sample.
    fn pass(&mut self, kind: &str, components: u64, tuples: u64) -> Result<()> {
        self.passed = true;
        self.skip(kind, components, tuples)
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
