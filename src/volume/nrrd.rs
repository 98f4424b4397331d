//! NRRD, versions 1 to 5, header attached or detached (teem.sourceforge.net/nrrd/format.html).

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3};

use super::source::{Endian, Packing, SampleType, Source, malformed, open, sample_count};
use super::{Grid, Volume};
use crate::error::{Error, Result};

/// A header longer than this is none.
const MAX_HEADER: u64 = 1 << 20;

/// Whether a file begins like an NRRD file.
pub(super) fn looks_like(head: &[u8]) -> bool {
    head.starts_with(b"NRRD000")
}

/// The fields of a header by their lower-case names, and the bytes that it takes.
struct Header {
    path: PathBuf,
    fields: HashMap<String, String>,
    length: u64,
}

impl Header {
    fn read(path: &Path) -> Result<Self> {
        let failed = |source| Error::Read { path: path.to_owned(), source };
        let mut reader = BufReader::new(open(path)?).take(MAX_HEADER);
        let mut fields = HashMap::new();
        let mut length = 0;
        let mut line = Vec::new();
        for number in 0.. {
            line.clear();
            let got = reader.read_until(b'\n', &mut line).map_err(failed)?;
            length += got as u64;
            let text = String::from_utf8_lossy(&line);
            let text = text.trim_end_matches(['\n', '\r']);
            // An empty line ends an attached header, the end of the file a detached one.
            if got == 0 || text.is_empty() {
                break;
            }
            // Line 0 is the magic; comments and key/value pairs say nothing about the lattice.
            if number == 0 || text.starts_with('#') {
                continue;
            }
            match text.find(':') {
                Some(at) if text[at..].starts_with(":=") => {}
                Some(at) => {
                    let name = text[..at].trim().to_lowercase();
                    fields.insert(name, text[at + 1..].trim().to_owned());
                }
                None => return Err(malformed(path, format!("header line {} is {text:?}, not a field", number + 1))),
            }
        }
        Ok(Self { path: path.to_owned(), fields, length })
    }

    fn error(&self, reason: impl Into<String>) -> Error {
        malformed(&self.path, reason)
    }

    /// A field under any of its spellings.
    fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|n| self.fields.get(*n)).map(String::as_str)
    }

    fn require(&self, names: &[&str]) -> Result<&str> {
        self.get(names).ok_or_else(|| self.error(format!("the header has no field `{}`", names[0])))
    }

    fn integer(&self, names: &[&str]) -> Result<i64> {
        match self.get(names) {
            None => Ok(0),
            Some(text) => text.parse().map_err(|_| self.error(format!("`{}: {text}` is not a whole number", names[0]))),
        }
    }

    /// Vectors such as `(1,0,0) none (0, 1, 0)`.
    fn vectors(&self, name: &str, text: &str) -> Result<Vec<Option<DVec3>>> {
        let bad = || self.error(format!("`{name}: {text}` are not vectors of three numbers"));
        let mut vectors = Vec::new();
        let mut rest = text.trim();
        while !rest.is_empty() {
            if let Some(after) = rest.strip_prefix("none") {
                vectors.push(None);
                rest = after.trim_start();
                continue;
            }
            let (inside, after) = rest.strip_prefix('(').and_then(|r| r.split_once(')')).ok_or_else(bad)?;
            let numbers: Option<Vec<f64>> = inside.split(',').map(|n| n.trim().parse().ok()).collect();
            let vector = numbers.and_then(|n| <[f64; 3]>::try_from(n).ok()).ok_or_else(bad)?;
            vectors.push(Some(DVec3::from_array(vector)));
            rest = after.trim_start();
        }
        Ok(vectors)
    }
}

/// Reads the volume of an NRRD header and the samples behind it or in the file that it names.
pub(super) fn read(path: &Path) -> Result<Volume> {
    let header = Header::read(path)?;
    let text = header.require(&["sizes"])?;
    let sizes: Vec<u32> = text
        .split_whitespace()
        .map(|s| s.parse().ok().filter(|&n| n > 0))
        .collect::<Option<_>>()
        .ok_or_else(|| header.error(format!("`sizes: {text}` are not positive whole numbers")))?;
    let rank = header.integer(&["dimension"])?;
    if rank != sizes.len() as i64 {
        return Err(header.error(format!("`dimension: {rank}` but {} sizes", sizes.len())));
    }
    // Which axes of the file are x, y and z: those longer than 1 where there are more than three.
    let mut axes: Vec<usize> = (0..sizes.len()).collect();
    while axes.len() > 3 {
        let single = axes.iter().position(|&a| sizes[a] == 1).ok_or_else(|| {
            header.error(format!("{} axes of sizes {text}: a volume has 3, extract one component", sizes.len()))
        })?;
        axes.remove(single);
    }
    let mut dims = [1; 3];
    for (dim, &axis) in dims.iter_mut().zip(&axes) {
        *dim = sizes[axis];
    }
    let sample_type: SampleType = {
        let text = header.require(&["type"])?;
        text.parse().map_err(|_| header.error(format!("`type: {text}` is not an integer or float type")))?
    };
    let (to_world, oriented) = orientation(&header, &axes)?;
    let grid = Grid::new(dims, to_world).map_err(|e| header.error(e.to_string()))?;
    let samples = source(&header, sample_type)?.read(sample_count(path, dims)?)?;
    let volume = Volume::new(grid, samples)?;
    Ok(if oriented { volume.with_orientation_known() } else { volume })
}

/// Where the samples are.
fn source(header: &Header, sample_type: SampleType) -> Result<Source> {
    let encoding = header.require(&["encoding"])?.to_lowercase();
    let packing = match encoding.as_str() {
        "raw" => Packing::Raw,
        "gzip" | "gz" => Packing::Gzip,
        "ascii" | "text" | "txt" => Packing::Text,
        _ => {
            return Err(header.error(format!("encoding {encoding} is not read: save it as raw, gzip or ascii")));
        }
    };
    let endian = match header.get(&["endian"]) {
        Some(text) => text.parse().map_err(|_| header.error(format!("`endian: {text}` is neither little nor big")))?,
        None if sample_type.bytes() == 1 || packing == Packing::Text => Endian::Little,
        None => return Err(header.error("the header has no field `endian`")),
    };
    let (path, mut offset) = match header.get(&["data file", "datafile"]) {
        None => (header.path.clone(), header.length),
        Some(name) if name.starts_with("LIST") || name.contains('%') => {
            return Err(header.error(format!("`data file: {name}` names many files: join them into one")));
        }
        Some(name) => (header.path.parent().unwrap_or(Path::new("")).join(name), 0),
    };
    let lines = header.integer(&["line skip", "lineskip"])?;
    if lines > 0 {
        offset += line_bytes(&path, offset, lines as u64)?;
    }
    let skip = header.integer(&["byte skip", "byteskip"])?;
    let (offset, skip_unpacked) = match (skip, packing) {
        (..=-2, _) => return Err(header.error(format!("`byte skip: {skip}` is neither a count nor -1"))),
        (-1, Packing::Raw) => (None, 0),
        (-1, _) => return Err(header.error("`byte skip: -1` needs raw encoding")),
        // The format counts bytes after unpacking.
        (skip, Packing::Gzip) => (Some(offset), skip as u64),
        (skip, _) => (Some(offset + skip as u64), 0),
    };
    Ok(Source { path, offset, packing, skip_unpacked, sample_type, endian })
}

/// Bytes of the `lines` lines that begin at `offset`.
fn line_bytes(path: &Path, offset: u64, lines: u64) -> Result<u64> {
    let failed = |source| Error::Read { path: path.to_owned(), source };
    let mut file = open(path)?;
    std::io::Seek::seek(&mut file, std::io::SeekFrom::Start(offset)).map_err(failed)?;
    let mut reader = BufReader::new(file);
    let mut bytes = 0;
    for _ in 0..lines {
        let mut line = Vec::new();
        let got = reader.by_ref().take(MAX_HEADER).read_until(b'\n', &mut line).map_err(failed)?;
        if got == 0 {
            break;
        }
        bytes += got as u64;
    }
    Ok(bytes)
}

/// Lattice to world, and whether the world is patient space; patient spaces other than LPS are turned into it.
fn orientation(header: &Header, axes: &[usize]) -> Result<(DAffine3, bool)> {
    let space = header.get(&["space"]).map(str::to_lowercase);
    let to_lps = match space.as_deref() {
        Some("left-posterior-superior" | "lps") => Some(DVec3::ONE),
        Some("right-anterior-superior" | "ras") => Some(DVec3::new(-1.0, -1.0, 1.0)),
        Some("left-anterior-superior" | "las") => Some(DVec3::new(1.0, -1.0, 1.0)),
        _ => None,
    };
    let flip = to_lps.unwrap_or(DVec3::ONE);
    let unit = [DVec3::X, DVec3::Y, DVec3::Z];
    let mut columns = unit;
    let mut origin = DVec3::ZERO;
    let directions = header.get(&["space directions"]);
    if let Some(text) = directions {
        let vectors = header.vectors("space directions", text)?;
        for (column, &axis) in columns.iter_mut().zip(axes) {
            match vectors.get(axis) {
                Some(&Some(vector)) => *column = vector,
                _ => {
                    return Err(header.error(format!("`space directions: {text}` has no vector for axis {}", axis + 1)));
                }
            }
        }
    } else if let Some(text) = header.get(&["spacings"]) {
        let spacings: Vec<&str> = text.split_whitespace().collect();
        for (i, &axis) in axes.iter().enumerate() {
            let spacing: f64 = spacings
                .get(axis)
                .and_then(|s| s.parse().ok())
                .ok_or_else(|| header.error(format!("`spacings: {text}` has no number for axis {}", axis + 1)))?;
            // NaN says that an axis has no spacing.
            columns[i] = unit[i] * if spacing.is_nan() { 1.0 } else { spacing };
        }
    }
    if let Some(text) = header.get(&["space origin"]) {
        origin = match header.vectors("space origin", text)?.as_slice() {
            [Some(origin)] => *origin,
            _ => return Err(header.error(format!("`space origin: {text}` is not one vector"))),
        };
    }
    let matrix = DMat3::from_cols(columns[0] * flip, columns[1] * flip, columns[2] * flip);
    Ok((DAffine3::from_mat3_translation(matrix, origin * flip), to_lps.is_some() && directions.is_some()))
}
