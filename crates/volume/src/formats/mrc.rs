//! MRC2014 and CCP4 maps (<https://www.ccpem.ac.uk/mrc-format/mrc2014/>).
//!
//! Samples keep the order of the file: columns are the lattice's first axis, whichever axis of the cell MAPC names, and
//! the directions of the lattice say which one that is. The reader does as mrcfile does, with three exceptions that
//! older files need. Bytes are unsigned if IMOD wrote them so. If ORIGIN is zero, NSTART places the map, as in CCP4 and
//! ChimeraX. If the cell has no size, samples are 1 apart.

use std::path::Path;

use glam::DVec3;

use super::LoadOptions;
use super::decode::{self, Kind, Layout, read_all};
use super::fields::Fields;
use super::input::Input;
use super::placement::Placement;
use super::selection::{Pick, Role, colours, picked};
use crate::error::{Result, refuse, refuse_if};
use crate::memory::{reserved, samples_in};
use crate::volume::{Endian, SampleType, Samples, Stored, Units, Volume};

/// The number of bytes of the header, without its extension.
const HEADER_SIZE: usize = 1024;

/// The largest number of bytes of an extended header.
const MAX_EXTENDED: i64 = 1 << 30;

/// Returns whether these are the first bytes of an MRC file: "MAP" at word 53. Old writers left out the blank after it.
pub(super) fn is_mrc(head: &[u8]) -> bool {
    head.get(208..212).is_some_and(|word| matches!(word, b"MAP " | b"MAP\0")) && endian(head).is_some()
}

/// Returns the byte order that the machine stamp states or, if it is damaged, the order that gives a valid mode and
/// axes.
fn endian(head: &[u8]) -> Option<Endian> {
    let plausible = |endian: &Endian| {
        let f = Fields { bytes: head, endian: *endian };
        (0..=127).contains(&f.int(12, 4)) && (0..=3).contains(&f.int(64, 4))
    };
    let stamped = match head.get(212..214)? {
        [0x44, 0x41 | 0x44] => [Endian::Little, Endian::Big],
        [0x11, 0x11] => [Endian::Big, Endian::Little],
        _ => [Endian::NATIVE, if Endian::NATIVE == Endian::Big { Endian::Little } else { Endian::Big }],
    };
    stamped.into_iter().find(plausible)
}

/// Reads the volume of a header that begins here.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let bytes = input.bytes(HEADER_SIZE)?;
    let Some(endian) = endian(&bytes) else {
        refuse!(input, "is not an MRC file: neither byte order gives it a mode and axes");
    };
    let header = Fields { bytes: &bytes, endian };
    let path = input.path().to_owned();
    let (kind, channels) = kind(&header, &input)?;
    let mut sizes = [0, 4, 8].map(|at| header.int(at, 4));
    // A stack of volumes has as many sections as all of them together.
    let (space_group, in_volume) = (header.int(88, 4), header.int(36, 4));
    let mut times = 1;
    if (401..=630).contains(&space_group) && in_volume > 0 && sizes[2] > in_volume {
        refuse_if!(sizes[2] % in_volume != 0, input, "has {} sections in volumes of {in_volume}", sizes[2]);
        (times, sizes[2]) = (sizes[2] / in_volume, in_volume);
    }
    let [x, y, z] = sizes;
    let axes = [(Role::Channel, channels), (Role::Space, x), (Role::Space, y), (Role::Space, z), (Role::Time, times)];
    let (placement, units) = placement(&header, &input)?;
    let grid = placement.grid(&path, &sizes, options.spacing)?;
    let (pick, mut contents) = picked(&path, &axes, options)?;
    if channels > 1 {
        contents.labels = colours(contents.channels);
    }
    let extended = header.int(92, 4);
    refuse_if!(!(0..=MAX_EXTENDED).contains(&extended), input, "has an extended header of {extended} bytes");
    input.skip(extended as u64)?;
    let layout = Layout::Binary(endian);
    let samples = match header.int(12, 4) {
        NIBBLES => nibbles(input, grid.dims(), contents.time, &path)?,
        _ => read_all(input, &pick, kind, layout)?,
    };
    Ok(placement.volume(grid, samples)?.with_units(units).with_contents(contents))
}

/// The mode of samples of 4 bits; each row begins at a byte.
const NIBBLES: i64 = 101;

/// Returns the type of the samples, and their number in a voxel.
fn kind(header: &Fields<'_>, input: &Input) -> Result<(Kind, i64)> {
    let sample_type = match header.int(12, 4) {
        0 if header.int(152, 4) == IMOD_STAMP && header.int(156, 4) & 1 == 0 => SampleType::U8,
        0 => SampleType::I8,
        1 => SampleType::I16,
        2 => SampleType::F32,
        6 => SampleType::U16,
        12 => return Ok((Kind::Half, 1)),
        // Red, green and blue in bytes.
        16 => return Ok((Kind::Whole(SampleType::U8), 3)),
        NIBBLES => SampleType::U8,
        3 | 4 => refuse!(input, "its samples are complex numbers: save them as one number per voxel"),
        other => refuse!(input, "mode {other} is not read: expected 0, 1, 2, 6, 12, 16 or 101"),
    };
    Ok((Kind::Whole(sample_type), 1))
}

/// The mark of IMOD, which says in the lowest bit of the next word whether bytes are signed.
const IMOD_STAMP: i64 = 1_146_047_817;

/// Returns the position of the lattice, and its unit.
fn placement(header: &Fields<'_>, input: &Input) -> Result<(Placement, Units)> {
    let stated = [64, 68, 72].map(|at| header.int(at, 4));
    // The axis of the cell along columns, rows and sections. All three are 0 in files of before 2000.
    let axes = match stated {
        [0, 0, 0] => [0, 1, 2],
        [c, r, s] if [1, 2, 3].iter().all(|axis| stated.contains(axis)) => [c, r, s].map(|axis| axis as usize - 1),
        [c, r, s] => refuse!(input, "axes {c}, {r}, {s}: expected 1, 2 and 3 in any order"),
    };
    let triple = |first: usize| std::array::from_fn::<f64, 3, _>(|i| header.float(first + 4 * i, 4));
    let intervals = [28, 32, 36].map(|at| header.int(at, 4) as f64);
    let (lengths, angles) = (triple(40), triple(52));
    let sized = lengths != [0.0; 3];
    let steps: [f64; 3] = std::array::from_fn(|i| if sized { lengths[i] / intervals[i] } else { 1.0 });
    let edges = edges(angles);
    let (directions, spacing) = (axes.map(|axis| edges[axis]), axes.map(|axis| steps[axis]));
    let mut origin = DVec3::from_array(triple(196));
    if origin == DVec3::ZERO {
        // Counted along columns, rows and sections.
        origin = (0..3).map(|a| directions[a] * spacing[a] * header.int(16 + 4 * a, 4) as f64).sum();
    }
    let unit = sized.then(|| "Å".to_owned());
    Ok((Placement { directions, spacing, origin, oriented: false }, Units { length: unit, value: None }))
}

/// Returns unit vectors along the edges of a cell with these angles in degrees: the first along x, the second in the
/// plane of x and y. Angles of 0 are right ones.
fn edges(angles: [f64; 3]) -> [DVec3; 3] {
    if angles.iter().all(|angle| [0.0, 90.0].contains(angle)) {
        return DVec3::AXES;
    }
    let [alpha, beta, gamma] = angles.map(f64::to_radians);
    let b = DVec3::new(libm::cos(gamma), libm::sin(gamma), 0.0);
    let (x, y) = (libm::cos(beta), (libm::cos(alpha) - libm::cos(beta) * libm::cos(gamma)) / libm::sin(gamma));
    // Angles of no cell give NaN here, which the grid refuses.
    [DVec3::X, b, DVec3::new(x, y, (1.0 - x * x - y * y).sqrt())]
}

/// Reads samples of 4 bits of one of several volumes, the low half of each byte first.
fn nibbles(mut input: Input, dims: [u32; 3], time: u32, path: &Path) -> Result<Stored> {
    let row = dims[0] as usize;
    let bytes = row.div_ceil(2);
    let rows = u64::from(dims[1]) * u64::from(dims[2]);
    let layout = Layout::Binary(Endian::NATIVE);
    input.skip(u64::from(time).saturating_mul(rows * bytes as u64))?;
    let packed: Vec<u8> = decode::read(&mut std::iter::once(Ok(input)), 1, &Pick::all(rows * bytes as u64), layout)?;
    let mut samples: Vec<u8> = reserved(rows * row as u64, || samples_in(path))?;
    for row_bytes in packed.chunks_exact(bytes) {
        samples.extend(row_bytes.iter().flat_map(|byte| [byte & 15, byte >> 4]).take(row));
    }
    Ok(Samples::U8(samples).into())
}
