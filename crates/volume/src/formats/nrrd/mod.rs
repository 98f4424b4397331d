//! Nearly raw raster data, NRRD0001 to NRRD0005 (<http://teem.sourceforge.net/nrrd/format.html>).
//!
//! Read are attached and detached headers, the encodings raw, gzip, bzip2, text and hex, and samples in one file or in
//! several. An axis that is not spatial has channels, such as colours, or points in time.

mod header;

use std::path::PathBuf;

use glam::DVec3;

use self::header::Header;
use super::LoadOptions;
use super::decode::{Layout, lattice, read_samples};
use super::input::{Input, MAX_EXPANSION};
use super::multifile::DataFiles;
use super::placement::{Placement, named_unit};
use super::selection::{Axes, Role, guessed, picked};
use crate::error::Result;
use crate::volume::{Endian, SampleType, Units, Volume};

/// The `encoding:` of the samples.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Raw,
    Gzip,
    Bzip2,
    Text,
    Hex,
}

/// Reads the volume of a header that begins here.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let header = Header::read(&mut input)?;
    let sample_type = sample_type(&header)?;
    let encoding = encoding(&header)?;
    let layout = layout(&header, sample_type, encoding)?;
    let (axes, roles) = spatial_axes(&header)?;
    let (pick, mut contents) = picked(header.path(), &roles, options)?;
    contents.segments = header.segments();
    let sizes = axes.map(|a| header.sizes[a]);
    let dims = lattice(header.path(), &sizes)?;
    let placement = placement(&header, axes)?;
    let grid = placement.grid(header.path(), dims, options.spacing)?;
    let count = pick.all;

    let skip = Skip::new(&header, encoding, count.saturating_mul(sample_type.size() as u64))?;
    let files = data_files(&header, &mut input)?;
    let samples = match files {
        None => {
            let part = skip.apply(input, encoding);
            read_samples(&mut std::iter::once(part), 1, &pick, sample_type, layout)?
        }
        Some(files) => {
            let n = files.len();
            if !count.is_multiple_of(n as u64) {
                return Err(header.error(format!("{n} data files cannot share {count} samples equally")));
            }
            let skip = Skip { total: skip.total / n as u64, ..skip };
            // Of many files each would be kept open.
            let unpacked = input.unpacked().filter(|_| n == 1);
            let is_placed = header.get("byte skip").is_some() || header.get("line skip").is_some();
            let mut parts = files.paths().map(|file| {
                let input = Input::open_data_kept(&file, unpacked.clone())?;
                match input.exactly_left() {
                    Some(left) if left > skip.total && encoding == Encoding::Raw && !is_placed => {
                        let more = left - skip.total;
                        let reason = "expected \"byte skip\" in the header that names it";
                        Err(input.error(format!("has {more} bytes more than its samples need: {reason}")))
                    }
                    _ => skip.apply(input, encoding),
                }
            });
            read_samples(&mut parts, n, &pick, sample_type, layout)?
        }
    };
    Ok(placement.volume(grid, samples)?.with_units(units(&header, axes)).with_contents(contents))
}

/// The data files that the header names which begins here.
pub(super) fn named_files(mut input: Input) -> Result<Vec<PathBuf>> {
    let header = Header::read(&mut input)?;
    Ok(data_files(&header, &mut input)?.map_or_else(Vec::new, |files| files.paths().collect()))
}

/// The units that the header states. A unit of length must be that of all three axes.
fn units(header: &Header, axes: [usize; 3]) -> Units {
    // Quoted, one for each axis; of the space, or of the samples.
    let quoted = |name: &str, of: [usize; 3]| {
        let units: Vec<&str> = header.get(name)?.split('"').skip(1).step_by(2).collect();
        let [x, y, z] = of.map(|axis| units.get(axis).copied());
        x.filter(|_| x == y && y == z).and_then(named_unit)
    };
    Units {
        length: quoted("space units", [0, 1, 2]).or_else(|| quoted("units", axes)),
        value: header.get("sample units").and_then(named_unit),
    }
}

fn sample_type(header: &Header) -> Result<SampleType> {
    let name = header.required("type")?;
    SampleType::from_name(name).ok_or_else(|| {
        header.error(format!("type {name:?} is not read: expected an integer of 8 to 64 bits, float or double"))
    })
}

fn encoding(header: &Header) -> Result<Encoding> {
    match header.required("encoding")?.to_ascii_lowercase().as_str() {
        "raw" => Ok(Encoding::Raw),
        "gz" | "gzip" => Ok(Encoding::Gzip),
        "txt" | "text" | "ascii" => Ok(Encoding::Text),
        "hex" => Ok(Encoding::Hex),
        "bz2" | "bzip2" => Ok(Encoding::Bzip2),
        other => Err(header.error(format!("encoding {other:?} is unknown: expected raw, gzip, bzip2, text or hex"))),
    }
}

fn layout(header: &Header, sample_type: SampleType, encoding: Encoding) -> Result<Layout> {
    if encoding == Encoding::Text {
        return Ok(Layout::Text);
    }
    match header.get("endian").map(str::to_ascii_lowercase).as_deref() {
        Some("little") => Ok(Layout::Binary(Endian::Little)),
        Some("big") => Ok(Layout::Binary(Endian::Big)),
        None if sample_type.size() == 1 => Ok(Layout::Binary(Endian::NATIVE)),
        None => Err(header.error(format!("type {sample_type} needs a line \"endian: little\" or \"endian: big\""))),
        Some(other) => Err(header.error(format!("endian {other:?}, expected little or big"))),
    }
}

/// The three spatial axes, fastest first, and what all axes are.
fn spatial_axes(header: &Header) -> Result<([usize; 3], Axes)> {
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
    let all: Axes = (0..header.sizes.len())
        .map(|a| match axes.iter().position(|&kept| kept == a) {
            Some(n) => (roles[n], header.sizes[a]),
            // An axis of one sample does not matter.
            None => (Role::Channel, header.sizes[a]),
        })
        .collect();
    let spatial: Vec<usize> =
        axes.iter().zip(&roles).filter(|(_, role)| **role == Role::Space).map(|(&a, _)| a).collect();
    match spatial[..] {
        [x, y, z] => Ok(([x, y, z], all)),
        _ => {
            let sizes: Vec<String> = header.sizes.iter().map(i64::to_string).collect();
            let kinds = header.get("kinds").map(|k| format!(" and kinds {k}")).unwrap_or_default();
            Err(header.error(format!(
                "axes of sizes {}{kinds} are not volumes: expected three axes of space",
                sizes.join(" ")
            )))
        }
    }
}

/// The position of the lattice. Without directions its axes are the world axes.
fn placement(header: &Header, axes: [usize; 3]) -> Result<Placement> {
    let Some(directions) = &header.directions else {
        let spacing = match &header.spacings {
            Some(all) => axes.map(|a| all[a]),
            None => [1.0; 3],
        };
        return Ok(Placement { origin: header.origin.unwrap_or(DVec3::ZERO), ..Placement::axis_parallel(spacing) });
    };
    let mut vectors = [DVec3::ZERO; 3];
    for (vector, a) in vectors.iter_mut().zip(axes) {
        *vector = directions[a].ok_or_else(|| {
            header.error(format!("space directions: axis {} has none, but is one of the volume's three", a + 1))
        })?;
    }
    let placement = Placement {
        directions: vectors,
        spacing: [1.0; 3],
        origin: header.origin.unwrap_or(DVec3::ZERO),
        oriented: header.patient_flip.is_some(),
    };
    Ok(placement.flipped(header.patient_flip.unwrap_or(DVec3::ONE)))
}

/// What precedes the samples in each data file.
#[derive(Clone, Copy)]
struct Skip {
    lines: u64,
    /// Bytes to skip; `None`: the samples are the last `total` bytes.
    bytes: Option<u64>,
    total: u64,
}

impl Skip {
    fn new(header: &Header, encoding: Encoding, total: u64) -> Result<Self> {
        let number = |name: &str| -> Result<i64> {
            let Some(text) = header.get(name) else { return Ok(0) };
            text.parse().map_err(|_| header.error(format!("{name}: {text:?} is not a whole number")))
        };
        let (lines, bytes) = (number("line skip")?, number("byte skip")?);
        let lines = u64::try_from(lines).map_err(|_| header.error(format!("line skip: {lines} is negative")))?;
        let bytes = match bytes {
            -1 if matches!(encoding, Encoding::Raw | Encoding::Gzip | Encoding::Bzip2) => None,
            -1 => return Err(header.error("byte skip: -1 goes with encoding raw, gzip or bzip2")),
            n => Some(u64::try_from(n).map_err(|_| header.error(format!("byte skip: {n}, expected -1 or more")))?),
        };
        Ok(Self { lines, bytes, total })
    }

    /// Moves the input to its first sample. Lines are skipped before decompression, bytes after it.
    fn apply(&self, mut input: Input, encoding: Encoding) -> Result<Input> {
        input.skip_lines(self.lines)?;
        // Bzip2 can hold far more than anyone writes before samples.
        let most = input.at_most().unwrap_or(u64::MAX).saturating_mul(MAX_EXPANSION).saturating_add(1 << 16);
        let mut input = match encoding {
            Encoding::Gzip => input.gunzip(),
            Encoding::Bzip2 => input.bunzip2(),
            Encoding::Raw | Encoding::Text | Encoding::Hex => input,
        };
        match self.bytes {
            Some(bytes) if bytes > most => return Err(input.error(format!("ends before byte {bytes}"))),
            Some(bytes) => input.skip(bytes)?,
            None => input = input.skip_to_last(self.total, most)?,
        }
        Ok(if encoding == Encoding::Hex { input.unhex() } else { input })
    }
}

/// The data files; `None` if the samples follow the header.
fn data_files(header: &Header, input: &mut Input) -> Result<Option<DataFiles>> {
    let Some(text) = header.get("data file") else { return Ok(None) };
    // The number after LIST is the dimension of each file. It does not matter: all files hold equal shares.
    let list = text.split_ascii_whitespace().next() == Some("LIST");
    let files = if list { DataFiles::listed(input) } else { DataFiles::named(header.path(), text, 4) };
    files.map(Some)
}
