//! MRC2014 and CCP4 maps (<https://www.ccpem.ac.uk/mrc-format/mrc2014/>).
//!
//! Samples keep the order of the file: columns are the lattice's first axis, whichever axis of the cell MAPC names, and
//! the directions of the lattice say which one that is. The reader does as mrcfile does, with three exceptions that
//! older files need. Bytes are unsigned if IMOD wrote them so. If ORIGIN is zero, NSTART places the map, as in CCP4 and
//! ChimeraX. If the cell has no size, samples are 1 apart.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::LoadOptions;
use super::decode::{self, Kind, Layout, lattice, read_all, read_kind};
use super::fields::Fields;
use super::input::Input;
use super::placement::Placement;
use super::selection::{Pick, Role, colours, picked};
use crate::error::Result;
use crate::memory::{reserved, samples_in};
use crate::volume::{Endian, SampleType, Samples, Stored, Units, Volume};

/// Bytes of the header, without its extension.
const HEADER_SIZE: usize = 1024;

/// The greatest number of bytes of an extended header.
const MAX_EXTENDED: i32 = 1 << 30;

/// Whether these are the first bytes of an MRC file: "MAP" at word 53. Old writers left out the blank after it.
pub(super) fn is_mrc(head: &[u8]) -> bool {
    head.get(208..212).is_some_and(|word| matches!(word, b"MAP " | b"MAP\0")) && endian(head).is_some()
}

/// The byte order: by the machine stamp, or, if that is damaged, the order in which mode and axes are those of a map.
fn endian(head: &[u8]) -> Option<Endian> {
    let plausible = |endian: &Endian| {
        let f = Fields { bytes: head, endian: *endian };
        (0..=127).contains(&f.i32(12)) && (0..=3).contains(&f.i32(64))
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
        return Err(input.error("is not an MRC file: neither byte order gives it a mode and axes"));
    };
    let header = Fields { bytes: &bytes, endian };
    let path = input.path().to_owned();
    let mode = Mode::of(&header, &input)?;
    let mut sizes = [0, 4, 8].map(|at| i64::from(header.i32(at)));
    // A stack of volumes has as many sections as all of them together.
    let (space_group, in_volume) = (header.i32(88), i64::from(header.i32(36)));
    let mut times = 1;
    if (401..=630).contains(&space_group) && in_volume > 0 && sizes[2] > in_volume {
        if sizes[2] % in_volume != 0 {
            return Err(input.error(format!("has {} sections in volumes of {in_volume}", sizes[2])));
        }
        (times, sizes[2]) = (sizes[2] / in_volume, in_volume);
    }
    let dims = lattice(&path, &sizes)?;
    let [x, y, z] = sizes;
    let coloured = matches!(mode, Mode::Colours);
    let channels = if coloured { 3 } else { 1 };
    let axes = [(Role::Channel, channels), (Role::Space, x), (Role::Space, y), (Role::Space, z), (Role::Time, times)];
    let (pick, mut contents) = picked(&path, &axes, options)?;
    if coloured {
        contents.labels = colours(contents.channels);
    }
    let (placement, units) = placement(&header, &input)?;
    let grid = placement.grid(&path, dims, options.spacing)?;
    let extended = header.i32(92);
    if !(0..=MAX_EXTENDED).contains(&extended) {
        return Err(input.error(format!("has an extended header of {extended} bytes")));
    }
    input.skip(extended as u64)?;
    let layout = Layout::Binary(endian);
    let samples = match mode {
        Mode::Kind(kind) => read_kind(input, &pick, kind, layout)?,
        Mode::Colours => read_all(input, &pick, SampleType::U8, layout)?,
        Mode::Nibble => nibbles(input, dims, contents.time, &path)?,
    };
    Ok(placement.volume(grid, samples)?.with_units(units).with_contents(contents))
}

/// What a sample is.
enum Mode {
    Kind(Kind),
    /// 4 bits; each row begins at a byte.
    Nibble,
    /// Red, green and blue in bytes.
    Colours,
}

impl Mode {
    fn of(header: &Fields<'_>, input: &Input) -> Result<Self> {
        let refused = match header.i32(12) {
            0 if header.i32(152) == IMOD_STAMP && header.i32(156) & 1 == 0 => {
                return Ok(Self::Kind(Kind::Whole(SampleType::U8)));
            }
            0 => return Ok(Self::Kind(Kind::Whole(SampleType::I8))),
            1 => return Ok(Self::Kind(Kind::Whole(SampleType::I16))),
            2 => return Ok(Self::Kind(Kind::Whole(SampleType::F32))),
            6 => return Ok(Self::Kind(Kind::Whole(SampleType::U16))),
            12 => return Ok(Self::Kind(Kind::Half)),
            16 => return Ok(Self::Colours),
            101 => return Ok(Self::Nibble),
            3 | 4 => "complex numbers",
            other => return Err(input.error(format!("mode {other} is not read: expected 0, 1, 2, 6, 12, 16 or 101"))),
        };
        Err(input.error(format!("its samples are {refused}: save them as one number per voxel")))
    }
}

/// The mark of IMOD, which says in the lowest bit of the next word whether bytes are signed.
const IMOD_STAMP: i32 = 1_146_047_817;

/// The position of the lattice, and its unit.
fn placement(header: &Fields<'_>, input: &Input) -> Result<(Placement, Units)> {
    let stated = [64, 68, 72].map(|at| header.i32(at));
    // The axis of the cell along columns, rows and sections. All three are 0 in files of before 2000.
    let axes = match stated {
        [0, 0, 0] => [0, 1, 2],
        [c, r, s] if [1, 2, 3].iter().all(|axis| stated.contains(axis)) => [c, r, s].map(|axis| axis as usize - 1),
        [c, r, s] => return Err(input.error(format!("axes {c}, {r}, {s}: expected 1, 2 and 3 in any order"))),
    };
    let triple = |first: usize| std::array::from_fn::<f64, 3, _>(|i| header.f32(first + 4 * i));
    let intervals = [28, 32, 36].map(|at| f64::from(header.i32(at)));
    let (lengths, angles) = (triple(40), triple(52));
    let sized = lengths != [0.0; 3];
    let steps: [f64; 3] = std::array::from_fn(|i| if sized { lengths[i] / intervals[i] } else { 1.0 });
    let edges = edges(angles);
    let (directions, spacing) = (axes.map(|axis| edges[axis]), axes.map(|axis| steps[axis]));
    let mut origin = DVec3::from_array(triple(196));
    if origin == DVec3::ZERO {
        // Counted along columns, rows and sections.
        origin = (0..3).map(|a| directions[a] * spacing[a] * f64::from(header.i32(16 + 4 * a))).sum();
    }
    let unit = sized.then(|| "Å".to_owned());
    Ok((Placement { directions, spacing, origin, oriented: false }, Units { length: unit, value: None }))
}

/// Unit vectors along the edges of a cell with these angles in degrees: the first along x, the second in the plane of x
/// and y. Angles of 0 are right ones.
fn edges(angles: [f64; 3]) -> [DVec3; 3] {
    if angles.iter().all(|angle| [0.0, 90.0].contains(angle)) {
        return DVec3::AXES;
    }
    let [alpha, beta, gamma] = angles.map(f64::to_radians);
    let b = DVec3::new(gamma.cos(), gamma.sin(), 0.0);
    let (x, y) = (beta.cos(), (alpha.cos() - beta.cos() * gamma.cos()) / gamma.sin());
    // Angles of no cell give NaN here, which the grid refuses.
    [DVec3::X, b, DVec3::new(x, y, (1.0 - x * x - y * y).sqrt())]
}

/// The samples of 4 bits of one of several volumes, the low half of each byte first.
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
    Ok(Stored::Memory(Arc::new(Samples::U8(samples))))
}
