//! NumPy's .npy, versions 1 to 3
//! (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>).
//!
//! An array of a volume is indexed (z, y, x), of volumes (time, z, y, x) or (z, y, x, channel), the latter if the last
//! axis alone has at most four samples; or with x first, if `axis_order` says so. The format states neither spacing nor
//! orientation.
//!
//! The crate `npyz` 0.9 is not used: it multiplies the shape unchecked (an overflow panics in a debug build), reserves
//! up to 4 GiB because the header's length says so, and reads sample by sample.

use serde::Deserialize;

use super::decode::{Kind, Layout, read_all, x_fastest};
use super::input::Input;
use super::placement::Placement;
use super::selection::{guessed, guessed_xyz, picked, spatial};
use super::{AxisOrder, LoadOptions, complex};
use crate::error::{Result, refuse, refuse_if};
use crate::volume::{Endian, Volume};

/// The first bytes of a .npy file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// The largest length of a header that is read, in bytes. A header with a plain type and three sizes has under 200.
const MAX_HEADER: usize = 1 << 16;

/// The fields of a header of NumPy.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NpyHeader {
    /// The string of the type, such as `<i2`.
    descr: String,
    fortran_order: bool,
    pub(super) shape: Vec<i64>,
}

/// Reads the volume of a header at the start of `input`.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let path = input.path().to_owned();
    let text = header_text(&mut input)?;
    let unread = || input.error(format!("has a header that is not read: {:?}", text.trim_end()));
    let header = parse(&text).ok_or_else(unread)?;
    let mut shape = header.shape.clone();
    while shape.len() > 3 {
        let Some(single) = shape.iter().position(|&n| n == 1) else { break };
        shape.remove(single);
    }
    let order = options.axis_order.unwrap_or_default();
    let mut axes = match order {
        AxisOrder::Zyx => {
            shape.reverse();
            guessed(&shape)
        }
        AxisOrder::Xyz => guessed_xyz(&shape),
    };
    let sizes = spatial(&axes);
    if sizes.len() != 3 {
        let expected = match order {
            AxisOrder::Zyx => "(z, y, x), (time, z, y, x), (z, y, x, channel) or (time, channel, z, y, x)",
            AxisOrder::Xyz => "(x, y, z), (x, y, z, time), (x, y, z, channel) or (x, y, z, time, channel)",
        };
        refuse!(input, "has the shape {}, expected {expected}", header.shape_text());
    }
    // The last axis of an array is the fastest, unless it is in Fortran order. If z is the fastest, samples are turned
    // when they are read.
    let is_turned = header.fortran_order == (order == AxisOrder::Zyx);
    if is_turned {
        axes.reverse();
    }
    let placement = Placement::axis_parallel([1.0; 3]);
    let grid = placement.grid(&path, &sizes, options.spacing)?;
    if header.is_complex() {
        axes.insert(0, (complex::role(&path, options)?, 2));
    }
    let (pick, mut contents) = picked(&path, &axes, options)?;
    let sign = header.other_order(grid.dims()).filter(|_| options.axis_order.is_none());
    contents.notes.extend(sign.map(|sign| {
        let shape = header.shape_text();
        format!("using axis order zyx for the array of shape {shape}, but {sign} (the other choice: axis order xyz)")
    }));

    let endian = match header.descr.as_bytes().first() {
        Some(b'>') => Endian::Big,
        Some(b'<') => Endian::Little,
        _ => Endian::NATIVE,
    };
    let layout = Layout::Binary(endian);
    let kind = header.kind().ok_or_else(|| {
        input.error(format!("has samples of type {:?}: save it as integers or floats, one per voxel", header.descr))
    })?;
    let stored = read_all(input, &pick, kind, layout)?;
    let stored = if header.is_complex() { complex::part(stored, &path, options)? } else { stored };
    let stored = match is_turned {
        true => x_fastest(&stored.into_samples()?, grid.dims(), &path)?.into(),
        false => stored,
    };
    Ok(placement.volume(grid, stored)?.with_contents(contents))
}

impl NpyHeader {
    /// Returns the type of the samples, or of the parts of complex ones; `None` if they are no numbers.
    pub(super) fn kind(&self) -> Option<Kind> {
        Kind::of_numpy(match self.descr.get(1..)? {
            "c8" => "f4",
            "c16" => "f8",
            letters => letters,
        })
    }

    fn is_complex(&self) -> bool {
        matches!(self.descr.get(1..), Some("c8" | "c16"))
    }

    /// Returns the shape as Python writes it.
    pub(super) fn shape_text(&self) -> String {
        let sizes: Vec<String> = self.shape.iter().map(i64::to_string).collect();
        format!("({}{})", sizes.join(", "), if sizes.len() == 1 { "," } else { "" })
    }

    /// Returns why the array may not be in the default order (z, y, x), if there is a sign of that.
    fn other_order(&self, dims: [u32; 3]) -> Option<&'static str> {
        match () {
            () if self.fortran_order => Some("it is in Fortran order, as arrays of nibabel are"),
            () if looks_reversed(dims) => Some("its last axis is short, as slices are"),
            () => None,
        }
    }
}

/// Returns whether the axes of a lattice look as if their order is reversed: a square section is not along x and y.
pub(super) fn looks_reversed([x, y, z]: [u32; 3]) -> bool {
    y == z && x > 1 && x <= y / 2
}

/// Reads the header at the start of `input`; `None` if it does not describe an array of one type.
pub(super) fn header(mut input: Input) -> Result<Option<NpyHeader>> {
    Ok(parse(&header_text(&mut input)?))
}

/// Reads the text of the header at the start of `input`.
fn header_text(input: &mut Input) -> Result<String> {
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
    Ok(String::from_utf8_lossy(&text).into_owned())
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
