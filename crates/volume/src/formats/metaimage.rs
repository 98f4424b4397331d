//! MetaImage: .mha, and .mhd with its data files (<https://itk.org/Wiki/ITK/MetaIO/Documentation>).
//!
//! The world of MetaImage is ITK's, which is DICOM's patient space. If the documentation is ambiguous, this reader does
//! as ITK does: MET_LONG has 32 bits, and a missing byte order means little-endian.

use std::collections::HashMap;
use std::path::PathBuf;

use glam::DVec3;

use super::LoadOptions;
use super::decode::{Layout, lattice, read_samples};
use super::input::Input;
use super::multifile::DataFiles;
use super::placement::{Placement, named_unit};
use super::selection::{Role, picked};
use crate::error::{Error, Result};
use crate::volume::{Endian, SampleType, Units, Volume};

/// The fields that a header may begin with. A file that begins otherwise is a MetaImage only by its extension.
const FIRST_FIELDS: [&str; 9] =
    ["objecttype", "ndims", "comment", "objectsubtype", "name", "id", "binarydata", "dimsize", "elementtype"];

/// Whether these are the first bytes of a MetaImage header.
pub(super) fn is_metaimage(head: &[u8]) -> bool {
    let line = head.split(|&c| c == b'\n').next().unwrap_or_default();
    let Some(equals) = line.iter().position(|&c| c == b'=') else { return false };
    let name = line[..equals].trim_ascii().to_ascii_lowercase();
    FIRST_FIELDS.iter().any(|field| field.as_bytes() == name)
}

/// Reads the volume of a header that begins here.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let header = Header::read(&mut input)?;
    if let Some(kind) = header.get(&["objecttype"])
        && !kind.eq_ignore_ascii_case("image")
    {
        return Err(header.error(format!("ObjectType is {kind:?}, expected Image")));
    }
    let n_dims = header.n_dims()?;
    let sizes: Vec<i64> = header.numbers("DimSize", header.required("DimSize")?, n_dims)?;
    let dims = lattice(&header.path, &sizes[..n_dims.min(3)])?;
    // Channels are beside each other in a sample; a fourth axis is time, as in ITK.
    let mut axes = vec![(Role::Channel, header.number("ElementNumberOfChannels", 1)?)];
    axes.extend(sizes.iter().enumerate().map(|(a, &size)| (if a < 3 { Role::Space } else { Role::Time }, size)));
    let (pick, contents) = picked(&header.path, &axes, options)?;
    let sample_type = header.sample_type()?;
    let placement = header.placement(n_dims)?;
    let grid = placement.grid(&header.path, dims, options.spacing)?;
    let slope: f64 = header.number("ElementToIntensityFunctionSlope", 1.0)?;
    let intercept: f64 = header.number("ElementToIntensityFunctionOffset", 0.0)?;
    if slope == 0.0 || !slope.is_finite() || !intercept.is_finite() {
        return Err(
            header.error(format!("ElementToIntensityFunction {slope} x + {intercept} maps samples to no value"))
        );
    }

    let count = pick.all;
    let files = header.data_files(&mut input)?;
    let n = files.as_ref().map_or(1, DataFiles::len);
    if !count.is_multiple_of(n as u64) {
        return Err(header.error(format!("{n} data files cannot share {count} samples equally")));
    }
    let start = Start {
        header_size: header.number("HeaderSize", 0)?,
        compressed: header.flag("CompressedData", false)?,
        share: (count / n as u64).saturating_mul(sample_type.size() as u64),
    };
    let msb = header.flag("BinaryDataByteOrderMSB", false)? || header.flag("ElementByteOrderMSB", false)?;
    let layout = match header.flag("BinaryData", true)? {
        true => Layout::Binary(if msb { Endian::Big } else { Endian::Little }),
        false => Layout::Text,
    };
    let samples = match files {
        None => {
            // HeaderSize counts from the start of the file, and the header has been read: the file is opened again.
            let local = match (start.header_size, input.at_most()) {
                (0, _) => input,
                (_, Some(_)) => Input::open_kept(&header.path, input.unpacked())?,
                (_, None) => return Err(header.error("HeaderSize needs a regular file: a stream is read once")),
            };
            read_samples(&mut std::iter::once(start.apply(local)), 1, &pick, sample_type, layout)?
        }
        Some(files) => {
            // Of many files each would be kept open.
            let unpacked = input.unpacked().filter(|_| n == 1);
            let mut parts = files.paths().map(|file| start.apply(Input::open_data_kept(&file, unpacked.clone())?));
            read_samples(&mut parts, n, &pick, sample_type, layout)?
        }
    };
    // ITK does not apply this map but leaves it to its caller. It is how such files state Hounsfield units.
    let units = Units { length: header.get(&["DistanceUnits"]).and_then(named_unit), value: None };
    Ok(placement.volume(grid, samples)?.with_rescale(slope, intercept)?.with_units(units).with_contents(contents))
}

/// The data files that the header names which begins here.
pub(super) fn named_files(mut input: Input) -> Result<Vec<PathBuf>> {
    let files = Header::read(&mut input)?.data_files(&mut input)?;
    Ok(files.map_or_else(Vec::new, |files| files.paths().collect()))
}

/// How to find the first sample of a data file.
struct Start {
    /// Bytes before the samples; -1: the samples are the last `share` bytes.
    header_size: i64,
    compressed: bool,
    share: u64,
}

impl Start {
    fn apply(&self, mut input: Input) -> Result<Input> {
        match (u64::try_from(self.header_size), input.exactly_left()) {
            (Ok(bytes), _) => input.skip(bytes)?,
            (Err(_), _) if self.header_size != -1 => {
                return Err(input.error(format!("HeaderSize is {}, expected -1 or more", self.header_size)));
            }
            (Err(_), _) if self.compressed => {
                return Err(input.error("HeaderSize -1 goes with uncompressed data only"));
            }
            (Err(_), Some(left)) if left >= self.share => input.skip(left - self.share)?,
            (Err(_), _) => {
                return Err(input.error(format!("is cut short: its samples need {} bytes", self.share)));
            }
        }
        // CompressedDataSize is not needed: a zlib stream marks its own end.
        if self.compressed { input.inflate() } else { Ok(input) }
    }
}

/// The fields of a header; names are in lower case.
struct Header {
    path: PathBuf,
    fields: HashMap<String, String>,
}

impl Header {
    /// Reads up to and including the line ElementDataFile, which is the last.
    fn read(input: &mut Input) -> Result<Self> {
        let mut fields = HashMap::new();
        while let Some(line) = input.line()? {
            let line = line.trim();
            if line.is_empty() {
                continue;
            }
            let Some((name, value)) = line.split_once('=') else {
                return Err(input.error(format!("header line {line:?} is not \"Field = value\"")));
            };
            let name = name.trim().to_ascii_lowercase();
            let last = name == "elementdatafile";
            if name != "comment" && fields.insert(name.clone(), value.trim().to_owned()).is_some() {
                return Err(input.error(format!("field {name:?} is given twice")));
            }
            if last {
                return Ok(Self { path: input.path().to_owned(), fields });
            }
        }
        Err(input.error("the MetaImage header has no field \"ElementDataFile\""))
    }

    fn error(&self, reason: impl Into<String>) -> Error {
        Error::format(&self.path, reason)
    }

    /// The text of the first of these fields that the header has: some fields have several names.
    fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|name| self.fields.get(&name.to_ascii_lowercase())).map(String::as_str)
    }

    fn required(&self, name: &str) -> Result<&str> {
        self.get(&[name]).ok_or_else(|| self.error(format!("the MetaImage header has no field {name:?}")))
    }

    fn number<T: std::str::FromStr>(&self, name: &str, default: T) -> Result<T> {
        let Some(text) = self.get(&[name]) else { return Ok(default) };
        text.parse().map_err(|_| self.error(format!("{name}: {text:?} is not a number that fits")))
    }

    fn numbers<T: std::str::FromStr>(&self, name: &str, text: &str, n: usize) -> Result<Vec<T>> {
        let list: Vec<T> = text.split_ascii_whitespace().map_while(|word| word.parse().ok()).collect();
        if list.len() != n || text.split_ascii_whitespace().count() != n {
            return Err(self.error(format!("{name}: {text:?}, expected {n} numbers")));
        }
        Ok(list)
    }

    fn flag(&self, name: &str, default: bool) -> Result<bool> {
        match self.get(&[name]).map(str::to_ascii_lowercase).as_deref() {
            None => Ok(default),
            Some("true" | "t" | "1" | "yes") => Ok(true),
            Some("false" | "f" | "0" | "no") => Ok(false),
            Some(other) => Err(self.error(format!("{name}: {other:?}, expected True or False"))),
        }
    }

    fn n_dims(&self) -> Result<usize> {
        match self.number("NDims", 3)? {
            n @ 2..=4 => Ok(n),
            n => Err(self.error(format!("NDims is {n}, expected 3"))),
        }
    }

    fn sample_type(&self) -> Result<SampleType> {
        let name = self.required("ElementType")?;
        Ok(match name.to_ascii_uppercase().as_str() {
            "MET_UCHAR" => SampleType::U8,
            "MET_CHAR" => SampleType::I8,
            "MET_USHORT" => SampleType::U16,
            "MET_SHORT" => SampleType::I16,
            "MET_UINT" | "MET_ULONG" => SampleType::U32,
            "MET_INT" | "MET_LONG" => SampleType::I32,
            "MET_ULONG_LONG" => SampleType::U64,
            "MET_LONG_LONG" => SampleType::I64,
            "MET_FLOAT" => SampleType::F32,
            "MET_DOUBLE" => SampleType::F64,
            _ => return Err(self.error(format!("ElementType {name:?} is not read: expected one number per sample"))),
        })
    }

    /// The position of a lattice of `n` axes. A 2-D image lies in the plane z = 0.
    fn placement(&self, n: usize) -> Result<Placement> {
        let vector = |v: &[f64]| DVec3::new(v[0], v[1], v.get(2).copied().unwrap_or(0.0));
        let spacing = match self.get(&["ElementSpacing", "ElementSize"]) {
            Some(text) => self.numbers("ElementSpacing", text, n)?,
            None => vec![1.0; n],
        };
        let mut placement = Placement::axis_parallel([spacing[0], spacing[1], spacing.get(2).copied().unwrap_or(1.0)]);
        if let Some(text) = self.get(&["Offset", "Position", "Origin", "ImagePosition"]) {
            placement.origin = vector(&self.numbers("Offset", text, n)?);
        }
        if let Some(text) = self.get(&["TransformMatrix", "Rotation", "Orientation"]) {
            let matrix = self.numbers("TransformMatrix", text, n * n)?;
            for (direction, row) in placement.directions.iter_mut().zip(matrix.chunks_exact(n)) {
                *direction = vector(row);
            }
            placement.oriented = true;
        }
        Ok(placement)
    }

    /// The data files; `None` if the samples follow the header.
    fn data_files(&self, input: &mut Input) -> Result<Option<DataFiles>> {
        let text = self.required("ElementDataFile")?;
        let word = text.split_ascii_whitespace().next().unwrap_or_default();
        match word.to_ascii_uppercase().as_str() {
            "LOCAL" => Ok(None),
            "" => Err(self.error("ElementDataFile is empty: expected a file name or LOCAL")),
            // The number after LIST is the dimension of each file. It does not matter: all files hold equal shares.
            "LIST" => DataFiles::listed(input).map(Some),
            _ => DataFiles::named(&self.path, text, 3).map(Some),
        }
    }
}
