//! MetaImage: .mha, and .mhd with its data files (<https://itk.org/Wiki/ITK/MetaIO/Documentation>).
//!
//! The world of MetaImage is ITK's, which is DICOM's patient space. If the documentation is ambiguous, this reader does
//! as ITK does: MET_LONG has 32 bits, and a missing byte order means little-endian.

use std::path::PathBuf;

use glam::DVec3;

use super::LoadOptions;
use super::decode::Layout;
use super::input::Input;
use super::multifile::{self, read_shares};
use super::placement::{Placement, named_unit};
use super::selection::{Role, colours_of_bytes, picked};
use super::text_header::TextHeader;
use crate::error::{Result, refuse, refuse_if};
use crate::volume::{Endian, Origin, SampleType, Units, Volume};

/// The fields that a header may begin with. A file that begins otherwise is a MetaImage only by its extension.
const FIRST_FIELDS: [&str; 9] =
    ["objecttype", "ndims", "comment", "objectsubtype", "name", "id", "binarydata", "dimsize", "elementtype"];

/// Returns whether these are the first bytes of a MetaImage header.
pub(super) fn is_metaimage(head: &[u8]) -> bool {
    let line = head.split(|&c| c == b'\n').next().unwrap_or_default();
    let Some(equals) = line.iter().position(|&c| c == b'=') else { return false };
    let name = line[..equals].trim_ascii().to_ascii_lowercase();
    FIRST_FIELDS.iter().any(|field| field.as_bytes() == name)
}

/// Reads the volume of a header that begins here.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let header = read_header(&mut input)?;
    if let Some(kind) = header.get(["ObjectType"]).filter(|kind| !kind.eq_ignore_ascii_case("image")) {
        refuse!(header, "ObjectType is {kind:?}, expected Image");
    }
    let n_dims = header.number("NDims")?.unwrap_or(3);
    refuse_if!(!(2..=4).contains(&n_dims), header, "NDims is {n_dims}, expected 3");
    let sizes: Vec<i64> = header.list("DimSize", header.required("DimSize")?, n_dims)?;
    // Channels are beside each other in a sample; a fourth axis is time, as in ITK.
    let mut axes = vec![(Role::Channel, header.number("ElementNumberOfChannels")?.unwrap_or(1))];
    axes.extend(sizes.iter().enumerate().map(|(a, &size)| (if a < 3 { Role::Space } else { Role::Time }, size)));
    let sample_type = sample_type(&header)?;
    let placement = placement(&header, n_dims)?;
    let grid = placement.grid(&header.path, &sizes[..n_dims.min(3)], options.spacing)?;
    let (pick, mut contents) = picked(&header.path, &axes, options)?;
    if sample_type == SampleType::U8 {
        contents.labels = colours_of_bytes(contents.channels);
    }
    let modality = header.get(["Modality"]).and_then(|name| name.strip_prefix("MET_MOD_"));
    contents.origin = Origin::of(modality.filter(|name| *name != "OTHER"), header.get(["Name"]));
    let slope: f64 = header.number("ElementToIntensityFunctionSlope")?.unwrap_or(1.0);
    let intercept: f64 = header.number("ElementToIntensityFunctionOffset")?.unwrap_or(0.0);
    if slope == 0.0 || !slope.is_finite() || !intercept.is_finite() {
        refuse!(header, "ElementToIntensityFunction {slope} x + {intercept} maps samples to no value");
    }

    let files = data_files(&header, &mut input)?;
    let share = pick.all / files.as_ref().map_or(1, Vec::len) as u64;
    let bytes = share.saturating_mul(sample_type.size() as u64);
    let header_size = header.number("HeaderSize")?.unwrap_or(0);
    let is_compressed = flag(&header, "CompressedData", false)?;
    let msb = flag(&header, "BinaryDataByteOrderMSB", false)? || flag(&header, "ElementByteOrderMSB", false)?;
    let layout = match flag(&header, "BinaryData", true)? {
        true => Layout::Binary(if msb { Endian::Big } else { Endian::Little }),
        false => Layout::Text,
    };
    if files.is_none() && header_size != 0 {
        // HeaderSize counts from the start of the file, and the header has been read: the file is opened again.
        refuse_if!(input.at_most().is_none(), header, "HeaderSize needs a regular file: a stream is read once");
        input = Input::open(&header.path, input.unpacked())?;
    }
    let samples = read_shares(&header, input, files, (&pick, sample_type, layout), |mut input| {
        match (u64::try_from(header_size), input.exactly_left()) {
            (Ok(skipped), _) => input.skip(skipped)?,
            (Err(_), _) if header_size != -1 => refuse!(input, "HeaderSize is {header_size}, expected -1 or more"),
            (Err(_), _) if is_compressed => refuse!(input, "HeaderSize -1 goes with uncompressed data only"),
            // The samples are the last bytes.
            (Err(_), Some(left)) if left >= bytes => input.skip(left - bytes)?,
            (Err(_), _) => refuse!(input, "is cut short: its samples need {bytes} bytes"),
        }
        // CompressedDataSize is not needed: a zlib stream marks its own end.
        if is_compressed { input.inflate() } else { Ok(input) }
    })?;
    // ITK does not apply this map but leaves it to its caller. It is how such files state Hounsfield units.
    let units = Units { length: header.get(["DistanceUnits"]).and_then(named_unit), value: None };
    Ok(placement.volume(grid, samples)?.with_rescale(slope, intercept)?.with_units(units).with_contents(contents))
}

/// Returns the data files that the header that begins here names.
pub(super) fn named_files(mut input: Input) -> Result<Vec<PathBuf>> {
    let header = read_header(&mut input)?;
    Ok(data_files(&header, &mut input)?.unwrap_or_default())
}

/// Reads the header up to and including the line ElementDataFile, which is the last.
fn read_header(input: &mut Input) -> Result<TextHeader> {
    let mut header = TextHeader::new(input, "MetaImage");
    while let Some(line) = input.line()? {
        let line = line.trim();
        if line.is_empty() {
            continue;
        }
        let Some((name, value)) = line.split_once('=') else {
            refuse!(input, "header line {line:?} is not \"Field = value\"");
        };
        let name = name.trim().to_ascii_lowercase();
        if name != "comment" {
            header.insert(&name, value.trim())?;
        }
        if name == "elementdatafile" {
            break;
        }
    }
    header.required("ElementDataFile")?;
    Ok(header)
}

fn flag(header: &TextHeader, name: &str, default: bool) -> Result<bool> {
    match header.get([name]).map(str::to_ascii_lowercase).as_deref() {
        None => Ok(default),
        Some("true" | "t" | "1" | "yes") => Ok(true),
        Some("false" | "f" | "0" | "no") => Ok(false),
        Some(other) => refuse!(header, "{name}: {other:?}, expected True or False"),
    }
}

fn sample_type(header: &TextHeader) -> Result<SampleType> {
    let name = header.required("ElementType")?;
    let lower = name.to_ascii_lowercase();
    // An array of the type has the channels of a sample.
    let known = lower.strip_prefix("met_").map(|name| name.strip_suffix("_array").unwrap_or(name));
    let known = known.and_then(|name| match name {
        "ulong" => Some(SampleType::U32),
        "long" => Some(SampleType::I32),
        _ => SampleType::from_name(&name.replace('_', " ")),
    });
    known.ok_or_else(|| header.error(format!("ElementType {name:?} is not read: expected one number per sample")))
}

/// Returns the position of a lattice of `n` axes. A 2-D image lies in the plane z = 0.
fn placement(header: &TextHeader, n: usize) -> Result<Placement> {
    let stated = |names: &[&str], n: usize| -> Result<Option<Vec<f64>>> {
        let text = names.iter().find_map(|name| header.get([*name]));
        text.map(|text| header.list(names[0], text, n)).transpose()
    };
    let vector = |v: &[f64]| DVec3::new(v[0], v[1], v.get(2).copied().unwrap_or(0.0));
    let spacing = stated(&["ElementSpacing", "ElementSize"], n)?.unwrap_or_else(|| vec![1.0; n]);
    let mut placement = Placement::axis_parallel([spacing[0], spacing[1], spacing.get(2).copied().unwrap_or(1.0)]);
    if let Some(origin) = stated(&["Offset", "Position", "Origin", "ImagePosition"], n)? {
        placement.origin = vector(&origin);
    }
    if let Some(matrix) = stated(&["TransformMatrix", "Rotation", "Orientation"], n * n)? {
        for (direction, row) in placement.directions.iter_mut().zip(matrix.chunks_exact(n)) {
            *direction = vector(row);
        }
        placement.oriented = true;
    }
    Ok(placement)
}

/// Returns the data files; `None` if the samples follow the header.
fn data_files(header: &TextHeader, input: &mut Input) -> Result<Option<Vec<PathBuf>>> {
    let text = header.required("ElementDataFile")?;
    refuse_if!(text.is_empty(), header, "ElementDataFile is empty: expected a file name or LOCAL");
    if text.split_ascii_whitespace().next().is_some_and(|word| word.eq_ignore_ascii_case("LOCAL")) {
        return Ok(None);
    }
    multifile::data_files(&header.path, text, 3, input).map(Some)
}
