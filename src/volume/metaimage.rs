//! MetaImage: .mha, and .mhd with its data file (itk.org/Wiki/ITK/MetaIO/Documentation).

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};

use super::source::{Endian, Packing, SampleType, Source, malformed, open, sample_count};
use super::{Grid, Volume};
use crate::error::{Error, Result};

/// A header longer than this is none.
const MAX_HEADER: u64 = 1 << 20;

/// Whether a file begins like a MetaImage header: `Key = value`, with one of the keys that come first.
pub(super) fn looks_like(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(&head[..head.len().min(64)]);
    match text.split_once('=') {
        Some((key, _)) => matches!(key.trim(), "ObjectType" | "NDims" | "Comment" | "ObjectSubType"),
        None => false,
    }
}

struct Header<'a> {
    path: &'a Path,
    fields: HashMap<String, String>,
    length: u64,
}

impl Header<'_> {
    fn error(&self, reason: impl Into<String>) -> Error {
        malformed(self.path, reason)
    }

    fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|n| self.fields.get(*n)).map(String::as_str)
    }

    fn require(&self, name: &str) -> Result<&str> {
        self.get(&[name]).ok_or_else(|| self.error(format!("the header has no {name}")))
    }

    fn numbers<T: std::str::FromStr>(&self, name: &str, text: &str) -> Result<Vec<T>> {
        text.split_whitespace()
            .map(|n| n.parse().map_err(|_| self.error(format!("{name} = {text}: {n:?} is not such a number"))))
            .collect()
    }

    fn is_true(&self, names: &[&str]) -> bool {
        self.get(names).is_some_and(|v| v.eq_ignore_ascii_case("true") || v == "1")
    }
}

fn read_header(path: &Path) -> Result<Header<'_>> {
    let failed = |source| Error::Read { path: path.to_owned(), source };
    let mut reader = BufReader::new(open(path)?).take(MAX_HEADER);
    let mut header = Header { path, fields: HashMap::new(), length: 0 };
    let mut line = Vec::new();
    // The data file comes last, and its samples may follow at once.
    while !header.fields.contains_key("ElementDataFile") {
        line.clear();
        let got = reader.read_until(b'\n', &mut line).map_err(failed)?;
        if got == 0 {
            return Err(header.error("the header has no ElementDataFile"));
        }
        header.length += got as u64;
        if let Some((key, value)) = String::from_utf8_lossy(&line).split_once('=') {
            header.fields.insert(key.trim().to_owned(), value.trim().to_owned());
        }
    }
    Ok(header)
}

/// Reads the volume of a MetaImage header.
pub(super) fn read(path: &Path) -> Result<Volume> {
    let header = read_header(path)?;
    let text = header.require("DimSize")?;
    let sizes: Vec<u32> = header.numbers("DimSize", text)?;
    if sizes.is_empty() || sizes.len() > 4 || sizes.iter().skip(3).any(|&s| s != 1) || sizes.contains(&0) {
        return Err(header.error(format!("DimSize = {text}: a volume has three dimensions")));
    }
    let rank = sizes.len();
    let mut dims = [1; 3];
    for (dim, &size) in dims.iter_mut().zip(&sizes) {
        *dim = size;
    }
    if let Some(channels) = header.get(&["ElementNumberOfChannels"]).filter(|&c| c != "1") {
        return Err(header.error(format!("ElementNumberOfChannels = {channels}: extract one channel")));
    }
    let text = header.require("ElementType")?;
    let sample_type: SampleType = match text.strip_prefix("MET_").unwrap_or(text) {
        // MetaIO's long is 32 bits in files, whatever the platform's is.
        "LONG" => SampleType::I32,
        "ULONG" => SampleType::U32,
        name => name.parse().map_err(|_| header.error(format!("ElementType = {text} is not an integer or float")))?,
    };
    let source = source(&header, sample_type)?;
    let grid = Grid::new(dims, affine(&header, rank)?).map_err(|e| header.error(e.to_string()))?;
    let volume = Volume::new(grid, source.read(sample_count(path, dims)?)?)?;
    let stated = header.get(&["TransformMatrix", "Orientation", "Rotation", "AnatomicalOrientation"]).is_some();
    Ok(if stated { volume.with_orientation_known() } else { volume })
}

fn source(header: &Header<'_>, sample_type: SampleType) -> Result<Source> {
    let big = header.is_true(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]);
    let compressed = header.is_true(&["CompressedData"]);
    let text = header.get(&["BinaryData"]).is_some_and(|v| v.eq_ignore_ascii_case("false"));
    let packing = match (compressed, text) {
        (true, _) => Packing::Zlib,
        (false, true) => Packing::Text,
        (false, false) => Packing::Raw,
    };
    let name = header.require("ElementDataFile")?;
    let (path, start) = match name {
        "LOCAL" | "Local" | "local" => (header.path.to_owned(), header.length),
        _ if name.starts_with("LIST") || name.contains('%') => {
            return Err(header.error(format!("ElementDataFile = {name} names many files: join them into one")));
        }
        _ => (header.path.parent().unwrap_or(Path::new("")).join(name), 0),
    };
    let offset = match header.get(&["HeaderSize"]) {
        None => Some(start),
        Some("-1") if packing == Packing::Raw => None,
        Some(text) => {
            let skip: u64 =
                text.parse().map_err(|_| header.error(format!("HeaderSize = {text} is neither a count nor -1")))?;
            Some(start + skip)
        }
    };
    let endian = if big { Endian::Big } else { Endian::Little };
    Ok(Source { path, offset, packing, skip_unpacked: 0, sample_type, endian })
}

/// Lattice to world. ITK's world is patient space, LPS; row i of the nine numbers is the direction of lattice axis i.
fn affine(header: &Header<'_>, rank: usize) -> Result<DAffine3> {
    let padded = |names: &[&str], fill: f64| -> Result<DVec3> {
        let mut values = [fill; 3];
        if let Some(text) = header.get(names) {
            let numbers: Vec<f64> = header.numbers(names[0], text)?;
            if numbers.len() != rank {
                return Err(header.error(format!("{} = {text}: expected {rank} numbers", names[0])));
            }
            for (value, number) in values.iter_mut().zip(numbers) {
                *value = number;
            }
        }
        Ok(DVec3::from_array(values))
    };
    let spacing = padded(&["ElementSpacing", "ElementSize"], 1.0)?;
    let origin = padded(&["Offset", "Position", "Origin"], 0.0)?;
    let mut directions = [DVec3::X, DVec3::Y, DVec3::Z];
    if let Some(text) = header.get(&["TransformMatrix", "Orientation", "Rotation"]) {
        let numbers: Vec<f64> = header.numbers("TransformMatrix", text)?;
        if numbers.len() != rank * rank {
            return Err(header.error(format!("TransformMatrix = {text}: expected {} numbers", rank * rank)));
        }
        for (axis, direction) in directions.iter_mut().enumerate().take(rank) {
            let component = |c: usize| if c < rank { numbers[axis * rank + c] } else { 0.0 };
            *direction = DVec3::new(component(0), component(1), component(2));
        }
    }
    let matrix = DMat3::from_cols(directions[0] * spacing.x, directions[1] * spacing.y, directions[2] * spacing.z);
    Ok(DAffine3::from_mat3_translation(matrix, origin))
}
