//! Nearly raw raster data, NRRD0001 to NRRD0005 (<http://teem.sourceforge.net/nrrd/format.html>).
//!
//! Read are attached and detached headers, the encodings raw, gzip, bzip2, text and hex, and samples in one file or in
//! several. An axis that is not spatial has channels, such as colours, or points in time.

mod header;

use std::path::PathBuf;

use glam::DVec3;

use self::header::NrrdHeader;
use super::decode::Layout;
use super::input::{Input, MAX_EXPANSION};
use super::multifile::{self, read_shares};
use super::placement::{Placement, lengths, named_unit};
use super::selection::{Axes, Role, colours, guessed, picked};
use super::text_header::TextHeader;
use super::{LoadOptions, complex};
use crate::error::{Result, refuse, refuse_if};
use crate::volume::{Endian, SampleType, Units, Volume};

/// The encoding of the samples, as the field `encoding` states it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Raw,
    Gzip,
    Bzip2,
    Text,
    Hex,
}

/// Reads the volume of a header at the start of `input`.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let header = NrrdHeader::read(&mut input)?;
    let (text, path) = (&header.text, &header.text.path);
    let sample_type = sample_type(text)?;
    let encoding = encoding(text)?;
    let layout = layout(text, sample_type, encoding)?;
    let (axes, mut roles) = spatial_axes(&header)?;
    // Without a request both parts are channels.
    let complex = roles.iter().position(|(role, size)| *role == Role::Channel && *size == 2);
    let complex = complex.filter(|&axis| options.complex.is_some() && header.is_kind(axis, &["complex"]));
    if let Some(axis) = complex {
        refuse_if!(axis != 0, text, "has complex numbers whose parts are not beside each other");
        roles[axis].0 = complex::role(path, options)?;
    }
    let (pick, mut contents) = picked(path, &roles, options)?;
    if header.has_colors(sample_type, &roles) {
        contents.labels = colours(contents.channels);
    }
    contents.segments = header.segments();
    contents.origin = header.origin_of_values();
    let (mut placement, sizes) = (placement(&header, axes)?, axes.map(|a| header.sizes[a]));
    // NaN is NRRD's word for what is not known.
    let length = |_, stated: f64| if stated.is_nan() { 1.0 } else { stated };
    placement.spacing = lengths(placement.spacing, options.spacing, &mut contents.notes, length);
    let grid = placement.grid(path, &sizes, options.spacing)?;

    let files = data_files(text, &mut input)?;
    let share = pick.all / files.as_ref().map_or(1, Vec::len) as u64;
    let (skips, total) = (skips(text, encoding)?, share.saturating_mul(sample_type.size() as u64));
    // A data file of bare samples has as many bytes as they need, unless the header states where they begin.
    let is_placed = text.get(["byte skip", "line skip"]).is_some();
    let is_exact = files.is_some() && encoding == Encoding::Raw && !is_placed;
    let samples = read_shares(text, input, files, (&pick, sample_type, layout), |input| {
        if let Some(left) = input.exactly_left().filter(|left| is_exact && *left > total) {
            let reason = "expected \"byte skip\" in the header that names it";
            refuse!(input, "has {} bytes more than its samples need: {reason}", left - total);
        }
        at_samples(input, encoding, skips, total)
    })?;
    let samples = if complex.is_some() { complex::part(samples, path, options)? } else { samples };
    Ok(placement.volume(grid, samples)?.with_units(units(text, axes)).with_contents(contents))
}

/// Returns the data files that the header at the start of `input` names.
pub(super) fn named_files(mut input: Input) -> Result<Vec<PathBuf>> {
    let header = NrrdHeader::read(&mut input)?;
    Ok(data_files(&header.text, &mut input)?.unwrap_or_default())
}

/// Returns the data files that the header names; `None` if the samples follow the header.
fn data_files(header: &TextHeader, input: &mut Input) -> Result<Option<Vec<PathBuf>>> {
    let named = header.get(["data file"]).map(|text| multifile::data_files(&header.path, text, 4, input));
    named.transpose()
}

/// Returns the units that the header states. A unit of length counts if all three axes have it.
fn units(header: &TextHeader, axes: [usize; 3]) -> Units {
    // Quoted, one for each axis; of the space, or of the samples.
    let quoted = |name: &str, of: [usize; 3]| {
        let units: Vec<&str> = header.get([name])?.split('"').skip(1).step_by(2).collect();
        let [x, y, z] = of.map(|axis| units.get(axis).copied());
        x.filter(|_| x == y && y == z).and_then(named_unit)
    };
    Units {
        length: quoted("space units", [0, 1, 2]).or_else(|| quoted("units", axes)),
        value: header.get(["sample units"]).and_then(named_unit),
    }
}

fn sample_type(header: &TextHeader) -> Result<SampleType> {
    let name = header.required("type")?;
    SampleType::from_name(name).ok_or_else(|| {
        header.error(format!("type {name:?} is not read: expected an integer of 8 to 64 bits, float or double"))
    })
}

fn encoding(header: &TextHeader) -> Result<Encoding> {
    match header.required("encoding")?.to_ascii_lowercase().as_str() {
        "raw" => Ok(Encoding::Raw),
        "gz" | "gzip" => Ok(Encoding::Gzip),
        "txt" | "text" | "ascii" => Ok(Encoding::Text),
        "hex" => Ok(Encoding::Hex),
        "bz2" | "bzip2" => Ok(Encoding::Bzip2),
        other => Err(header.error(format!("encoding {other:?} is unknown: expected raw, gzip, bzip2, text or hex"))),
    }
}

fn layout(header: &TextHeader, sample_type: SampleType, encoding: Encoding) -> Result<Layout> {
    if encoding == Encoding::Text {
        return Ok(Layout::Text);
    }
    match header.get(["endian"]).map(str::parse) {
        Some(Ok(endian)) => Ok(Layout::Binary(endian)),
        Some(Err(_)) => refuse!(header, "endian {:?}, expected little or big", header.required("endian")?),
        None if sample_type.size() == 1 => Ok(Layout::Binary(Endian::NATIVE)),
        None => refuse!(header, "type {sample_type} needs a line \"endian: little\" or \"endian: big\""),
    }
}

/// Returns the three spatial axes, fastest first, and the roles of all axes.
fn spatial_axes(header: &NrrdHeader) -> Result<([usize; 3], Axes)> {
    let mut axes: Vec<usize> = (0..header.sizes.len()).collect();
    while axes.len() > 3 {
        let single = |&&a: &&usize| header.sizes[a] == 1;
        // Among several axes with one sample, drop first an axis that the header calls non-spatial, then the slowest.
        let dropped = axes.iter().filter(single).find(|a| !header.is_spatial(**a));
        let Some(&dropped) = dropped.or_else(|| axes.iter().rev().find(single)) else { break };
        axes.retain(|&a| a != dropped);
    }
    let sizes: Vec<i64> = axes.iter().map(|&a| header.sizes[a]).collect();
    let mut roles: Vec<Role> = guessed(&sizes).into_iter().map(|(role, _)| role).collect();
    if axes.iter().any(|&a| !header.is_spatial(a) && header.sizes[a] != 1) {
        // What is not named behind the axes of space is a series of volumes; in front of them it has numbers of each
        // voxel. A list has numbers of each voxel wherever it is, such as directions of diffusion.
        let last = axes.iter().rposition(|&a| header.is_spatial(a)).unwrap_or(0);
        for (n, (role, &a)) in roles.iter_mut().zip(&axes).enumerate() {
            *role = match header.kind(a).as_deref() {
                _ if header.is_spatial(a) || header.sizes[a] == 1 => Role::Space,
                _ if header.is_time(a) => Role::Time,
                None if n > last => Role::Time,
                _ => Role::Channel,
            };
        }
    }
    // A dropped axis, of one sample, may be anything.
    let mut all: Axes = header.sizes.iter().map(|&size| (Role::Channel, size)).collect();
    axes.iter().zip(roles).for_each(|(&a, role)| all[a].0 = role);
    axes.retain(|&a| all[a].0 == Role::Space);
    if let [x, y, z] = axes[..] {
        return Ok(([x, y, z], all));
    }
    let sizes = header.sizes.iter().map(i64::to_string).collect::<Vec<_>>().join(" ");
    let kinds = header.text.get(["kinds"]).map(|k| format!(" and kinds {k}")).unwrap_or_default();
    refuse!(header.text, "axes of sizes {sizes}{kinds} are not volumes: expected three axes of space")
}

/// Returns the position of the lattice. Without directions its axes are the world axes.
fn placement(header: &NrrdHeader, axes: [usize; 3]) -> Result<Placement> {
    let origin = header.origin.unwrap_or_default();
    let Some(directions) = &header.directions else {
        let spacing = header.spacings.as_ref().map_or([1.0; 3], |all| axes.map(|a| all[a]));
        return Ok(Placement { origin, ..Placement::axis_parallel(spacing) });
    };
    if let Some(a) = axes.into_iter().find(|&a| directions[a].is_none()) {
        refuse!(header.text, "space directions: axis {} has none, but is one of the volume's three", a + 1);
    }
    let placement = Placement {
        directions: axes.map(|a| directions[a].unwrap_or_default()),
        spacing: [1.0; 3],
        origin,
        oriented: header.patient_flip.is_some(),
    };
    Ok(placement.flipped(header.patient_flip.unwrap_or(DVec3::ONE)))
}

/// The largest number of bytes before the last samples of a stream, which are kept in memory until its end.
const MAX_BEFORE: u64 = 64 << 20;

/// Returns the numbers of lines and of bytes before the samples of each data file; no number of bytes if the samples
/// are the last bytes of the file.
fn skips(header: &TextHeader, encoding: Encoding) -> Result<(u64, Option<u64>)> {
    let lines = header.number::<i64>("line skip")?.unwrap_or(0);
    let lines = u64::try_from(lines).map_err(|_| header.error(format!("line skip: {lines} is negative")))?;
    let bytes = header.number::<i64>("byte skip")?.unwrap_or(0);
    match u64::try_from(bytes) {
        Ok(bytes) => Ok((lines, Some(bytes))),
        Err(_) if bytes != -1 => refuse!(header, "byte skip: {bytes}, expected -1 or more"),
        Err(_) if matches!(encoding, Encoding::Raw | Encoding::Gzip | Encoding::Bzip2) => Ok((lines, None)),
        Err(_) => refuse!(header, "byte skip: -1 goes with encoding raw, gzip or bzip2"),
    }
}

/// Skips to the first sample of data of `total` bytes. Lines are skipped before decompression, bytes after it.
fn at_samples(mut input: Input, encoding: Encoding, (lines, bytes): (u64, Option<u64>), total: u64) -> Result<Input> {
    input.skip_lines(lines)?;
    // Bzip2 can hold far more than anyone writes before samples.
    let most = input.at_most().unwrap_or(u64::MAX).saturating_mul(MAX_EXPANSION).saturating_add(1 << 16);
    let mut input = match encoding {
        Encoding::Gzip => input.gunzip(),
        Encoding::Bzip2 => input.bunzip2(),
        Encoding::Raw | Encoding::Text | Encoding::Hex => input,
    };
    match bytes {
        Some(bytes) if bytes > most => refuse!(input, "ends before byte {bytes}"),
        Some(bytes) => input.skip(bytes)?,
        None => input = input.skip_to_last(total, most.min(MAX_BEFORE))?,
    }
    if encoding == Encoding::Hex {
        input.decode_digits(4);
    }
    Ok(input)
}
