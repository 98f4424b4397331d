//! NumPy's .npy, versions 1 to 3
//! (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>).
//!
//! An array of a volume is indexed (z, y, x), of volumes (time, z, y, x) or (z, y, x, channel), the latter if the last
//! axis alone has at most four samples. The format states neither spacing nor orientation.
//!
//! The crate `npyz` 0.9 is not used: it multiplies the shape unchecked (an overflow panics in a debug build), reserves
//! up to 4 GiB because the header's length says so, and reads sample by sample.

use rayon::prelude::*;
use serde::Deserialize;

use super::LoadOptions;
use super::decode::{Kind, Layout, read_all};
use super::input::Input;
use super::placement::Placement;
use super::selection::{guessed, picked, spatial};
use crate::error::{Result, refuse, refuse_if};
use crate::memory::{reserved, samples_in};
use crate::volume::{Endian, Number, Samples, Volume, with_samples};

/// The first bytes of a .npy file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// The longest header that is read, in bytes. One with a plain type and three sizes has under 200.
const MAX_HEADER: usize = 1 << 16;

/// The fields of the header.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct NpyHeader {
    /// The type's string, such as `<i2`.
    descr: String,
    fortran_order: bool,
    shape: Vec<i64>,
}

/// Reads the volume of a header that begins here.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let path = input.path().to_owned();
    let header = read_header(&mut input)?;
    let mut shape = header.shape.clone();
    while shape.len() > 3 {
        let Some(single) = shape.iter().position(|&n| n == 1) else { break };
        shape.remove(single);
    }
    // The last axis is the fastest, unless the array is in Fortran order: then it is turned when it is read.
    shape.reverse();
    let mut axes = guessed(&shape);
    let sizes = spatial(&axes);
    if sizes.len() != 3 {
        let expected = "expected (z, y, x), (time, z, y, x), (z, y, x, channel) or (time, channel, z, y, x)";
        refuse!(input, "has the shape {:?}, {expected}", header.shape);
    }
    if header.fortran_order {
        axes.reverse();
    }
    let placement = Placement::axis_parallel([1.0; 3]);
    let grid = placement.grid(&path, &sizes, options.spacing)?;
    let (pick, contents) = picked(&path, &axes, options)?;

    let (order, kind) = header.descr.split_at_checked(1).unwrap_or_default();
    let endian = match order {
        ">" => Endian::Big,
        "<" => Endian::Little,
        _ => Endian::NATIVE,
    };
    let layout = Layout::Binary(endian);
    let kind = Kind::of_numpy(kind).ok_or_else(|| {
        input.error(format!("has samples of type {:?}: save it as integers or floats, one per voxel", header.descr))
    })?;
    let stored = read_all(input, &pick, kind, layout)?;
    let stored = match header.fortran_order {
        true => x_fastest(&stored.into_samples()?, grid.dims(), || samples_in(&path))?.into(),
        false => stored,
    };
    Ok(placement.volume(grid, stored)?.with_contents(contents))
}

/// Reorders samples from z fastest to x fastest.
fn x_fastest(samples: &Samples, dims: [u32; 3], what: impl Fn() -> String) -> Result<Samples> {
    let [nx, ny, nz] = dims.map(|d| d as usize);
    with_samples!(samples, from => {
        let mut turned = reserved(from.len() as u64, what)?;
        let at = |i: usize| from[(i % nx * ny + i / nx % ny) * nz + i / (nx * ny)];
        (0..from.len()).into_par_iter().map(at).collect_into_vec(&mut turned);
        Ok(Number::collected(turned))
    })
}

fn read_header(input: &mut Input) -> Result<NpyHeader> {
    let start = input.bytes(8)?;
    let (magic, version) = start.split_at(6);
    refuse_if!(magic != MAGIC, input, "is not a NumPy file: its magic is missing");
    let length = match version {
        [1, 0] => input.bytes(2)?,
        [2 | 3, 0] => input.bytes(4)?,
        _ => refuse!(input, "is of the unknown .npy version {version:?}, expected 1.0 to 3.0"),
    };
    let length = Endian::Little.number(&length) as usize;
    refuse_if!(length > MAX_HEADER, input, "has a header of {length} bytes, expected at most {MAX_HEADER}");
    let text = input.bytes(length)?;
    let text = String::from_utf8_lossy(&text);
    parse(&text).ok_or_else(|| input.error(format!("has a header that is not read: {:?}", text.trim_end())))
}

/// Parses the dictionary literal of a header, which is all but JSON; `None` if it does not describe a plain array.
fn parse(text: &str) -> Option<NpyHeader> {
    let mut json: String = text.chars().filter(|c| !c.is_ascii_whitespace()).collect();
    let words = [(",)", "]"), (",}", "}"), ("(", "["), (")", "]"), ("'", "\""), ("False", "false"), ("True", "true")];
    for (python, word) in words {
        json = json.replace(python, word);
    }
    serde_json::from_str(&json).ok().filter(|header: &NpyHeader| !header.shape.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_parse_as_python_does() {
        let header = |descr: &str, fortran_order, shape: &[i64]| {
            Some(NpyHeader { descr: descr.to_owned(), fortran_order, shape: shape.to_vec() })
        };
        let text = "{'descr': '<i2', 'fortran_order': False, 'shape': (5, 4, 3), }        \n";
        assert_eq!(parse(text), header("<i2", false, &[5, 4, 3]));
        assert_eq!(parse("{\"shape\":(7,),\"fortran_order\":True,\"descr\":\"|u1\"}"), header("|u1", true, &[7]));
        for bad in [
            "",
            "{",
            "{'descr': '<i2'}",
            "{'descr': [('a', '<i2')], 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<i2', 'fortran_order': 0, 'shape': (1,)}",
            "{'descr': '<i2', 'fortran_order': False, 'shape': ((((1,))))}",
            "{'descr': '<i2', 'descr': '<i2', 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<i2', 'fortran_order': False, 'shape': (99999999999999999999,)}",
        ] {
            assert_eq!(parse(bad), None, "{bad}");
        }
    }
}
