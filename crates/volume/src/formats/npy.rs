//! NumPy's .npy, versions 1 to 3
//! (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>).
//!
//! An array of a volume is indexed (z, y, x), of volumes (time, z, y, x) or (z, y, x, channel), the latter if the last
//! axis alone has at most four samples. The format states neither spacing nor orientation.
//!
//! The crate `npyz` 0.9 is not used: it multiplies the shape unchecked (an overflow panics in a debug build), reserves
//! up to 4 GiB because the header's length says so, and reads sample by sample.

use std::sync::Arc;

use rayon::prelude::*;

use super::LoadOptions;
use super::decode::{Kind, Layout, lattice, read_kind};
use super::input::Input;
use super::placement::Placement;
use super::selection::{guessed, picked, spatial};
use crate::error::Result;
use crate::memory::{reserved, samples_in};
use crate::volume::{Endian, Number, Samples, Stored, Volume, with_samples};

/// The first bytes of a .npy file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// The longest header that is read, in bytes. One with a plain type and three sizes has under 200.
const MAX_HEADER: usize = 1 << 16;

/// What the header says.
#[derive(Debug, PartialEq)]
struct Header {
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
        return Err(input.error(format!("has the shape {:?}, {expected}", header.shape)));
    }
    let dims = lattice(&path, &sizes)?;
    if header.fortran_order {
        axes.reverse();
    }
    let (pick, contents) = picked(&path, &axes, options)?;
    let placement = Placement::axis_parallel([1.0; 3]);
    let grid = placement.grid(&path, dims, options.spacing)?;

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
    let stored = read_kind(input, &pick, kind, layout)?;
    let stored = match header.fortran_order {
        true => Stored::Memory(Arc::new(x_fastest(&stored.into_samples()?, dims, || samples_in(&path))?)),
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

fn read_header(input: &mut Input) -> Result<Header> {
    let start = input.bytes(8)?;
    let (magic, version) = start.split_at(6);
    if magic != MAGIC {
        return Err(input.error("is not a NumPy file: its magic is missing"));
    }
    let length = match version {
        [1, 0] => input.bytes(2)?,
        [2 | 3, 0] => input.bytes(4)?,
        _ => return Err(input.error(format!("is of the unknown .npy version {version:?}, expected 1.0 to 3.0"))),
    };
    let length = length.iter().rev().fold(0, |n, &byte| n << 8 | usize::from(byte));
    if length > MAX_HEADER {
        return Err(input.error(format!("has a header of {length} bytes, expected at most {MAX_HEADER}")));
    }
    let text = input.bytes(length)?;
    let text = String::from_utf8_lossy(&text);
    parse(&text).ok_or_else(|| input.error(format!("has a header that is not read: {:?}", text.trim_end())))
}

/// Parses the dictionary literal of a header; `None` if it does not describe a plain array.
fn parse(text: &str) -> Option<Header> {
    let (mut descr, mut fortran_order, mut shape) = (None, None, None);
    let mut rest = text.trim().strip_prefix('{')?.trim_start();
    while !rest.starts_with('}') {
        let (key, after) = quoted(rest)?;
        let value = after.trim_start().strip_prefix(':')?.trim_start();
        rest = match key {
            "descr" => {
                let (text, after) = quoted(value)?;
                descr.replace(text.to_owned()).is_none().then_some(after)?
            }
            "fortran_order" => {
                let word = if value.starts_with("True") { "True" } else { "False" };
                fortran_order.replace(word == "True").is_none().then_some(value.strip_prefix(word)?)?
            }
            "shape" => {
                let (inside, after) = value.strip_prefix('(')?.split_once(')')?;
                let numbers = inside.trim().trim_end_matches(',').split(',').map(|n| n.trim().parse().ok());
                shape.replace(numbers.collect::<Option<Vec<i64>>>()?).is_none().then_some(after)?
            }
            _ => return None,
        };
        rest = rest.trim_start();
        match rest.strip_prefix(',') {
            Some(after) => rest = after.trim_start(),
            None if rest.starts_with('}') => {}
            None => return None,
        }
    }
    Some(Header { descr: descr?, fortran_order: fortran_order?, shape: shape? })
}

/// The content of a string literal, and the text after it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    text.get(1..)?.split_once(quote)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_parse_as_python_does() {
        let header = |descr: &str, fortran_order, shape: &[i64]| {
            Some(Header { descr: descr.to_owned(), fortran_order, shape: shape.to_vec() })
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
