//! ImageData in XML, .vti: arrays as text, in base64 or as bytes after the XML, plain or compressed.

use std::path::Path;
use std::str::FromStr;

use glam::DVec3;

use super::blocks::{BlockCodec, decompressed};
use super::{At, Found, ImageLattice, SampleArray, Wanted, note_name, numbers};
use crate::error::{Result, Subject, refuse, refuse_if};
use crate::formats::LoadOptions;
use crate::formats::decode::Layout;
use crate::formats::input::Input;
use crate::formats::selection::choice;
use crate::formats::xml::Tag;
use crate::volume::{Endian, SampleType};

/// Reads the volume of an array of a file at the start of `input`. Without a name it is the array that is named as the
/// active scalars, else the first, of points, else of cells.
pub(in crate::formats) fn read(mut input: Input, options: &LoadOptions, wanted: Wanted<'_>) -> Result<Found> {
    let Some(file) = tag(&mut input, "VTKFile")? else {
        refuse!(input, "is not a VTK file: it has no tag VTKFile");
    };
    match file.get("type") {
        Some("ImageData") => {}
        other => refuse!(input, "is of type {:?}, expected ImageData", other.unwrap_or_default()),
    }
    let coding = Coding::of(&file, &input)?;
    let Some(image) = tag(&mut input, "ImageData")? else { refuse!(input, "has no tag ImageData") };
    let image_lattice = image_lattice(&image, input.path())?;
    let mut names = Vec::new();
    let Some((array, place)) = find(&mut input, image.get("WholeExtent"), wanted, &mut names)? else {
        return Ok(Found::Others(names));
    };
    let (input, layout) = coding.at_samples(input, place)?;
    image_lattice.read(&array, input, layout, options)
}

/// Reads up to the next tag of this name.
pub(super) fn tag(input: &mut Input, name: &str) -> Result<Option<Tag>> {
    while let Some(tag) = Tag::next(input)? {
        if tag.name == name {
            return Ok(Some(tag));
        }
    }
    Ok(None)
}

/// Returns the numbers of an attribute, or the usual ones if it is not stated.
fn stated<T: FromStr + Copy, const N: usize>(image: &Tag, file: &Path, name: &str, usual: [T; N]) -> Result<[T; N]> {
    let Some(text) = image.get(name) else { return Ok(usual) };
    numbers(text).ok_or_else(|| file.error(format!("{name} is {text:?}, expected {N} numbers")))
}

fn image_lattice(image: &Tag, file: &Path) -> Result<ImageLattice> {
    let [x0, x1, y0, y1, z0, z1] = stated(image, file, "WholeExtent", [0, -1, 0, -1, 0, -1])?;
    let m = stated(image, file, "Direction", [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])?;
    Ok(ImageLattice {
        extent: [[x0, x1], [y0, y1], [z0, z1]],
        spacing: stated(image, file, "Spacing", [1.0; 3])?,
        origin: DVec3::from_array(stated(image, file, "Origin", [0.0; 3])?),
        // Its columns are the directions of the axes.
        directions: std::array::from_fn(|axis| DVec3::new(m[axis], m[axis + 3], m[axis + 6])),
    })
}

/// The place of an array's samples in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ArrayPlace {
    /// After the tag, as decimal numbers.
    Text,
    /// After the tag, in base64.
    Inline,
    /// Behind the XML, after `offset` bytes, or characters of base64.
    Appended { offset: u64, base64: bool },
}

/// Finds the array of scalars and reads up to its tag, or up to the appended data if it is there.
fn find(
    input: &mut Input,
    whole: Option<&str>,
    wanted: Wanted<'_>,
    names: &mut Vec<String>,
) -> Result<Option<(SampleArray, ArrayPlace)>> {
    let (mut at, mut active) = (None, None);
    let same = |a: &str, b: &str| a.split_ascii_whitespace().eq(b.split_ascii_whitespace());
    let mut appended = None;
    while let Some(tag) = Tag::next(input)? {
        match tag.name.as_str() {
            "Piece" if tag.get("Extent").is_some_and(|extent| whole.is_some_and(|whole| !same(extent, whole))) => {
                refuse!(input, "is in several pieces: save it as one");
            }
            "PointData" => (at, active) = (Some(At::Points), tag.get("Scalars").map(str::to_owned)),
            "CellData" => (at, active) = (Some(At::Cells), tag.get("Scalars").map(str::to_owned)),
            "/PointData" | "/CellData" => at = None,
            "DataArray" => {
                let Some(at) = at.filter(|_| appended.is_none()) else { continue };
                let name = tag.get("Name");
                note_name(names, name);
                let is_named = match wanted {
                    Wanted::Named(wanted) => name == Some(wanted),
                    Wanted::Scalars | Wanted::Any => active.is_none() || name == active.as_deref(),
                };
                if !is_named {
                    continue;
                }
                let components = tag.get("NumberOfComponents").unwrap_or("1");
                let Ok(components) = components.parse::<u64>() else {
                    refuse!(input, "NumberOfComponents is {components:?}, expected a number");
                };
                if components != 1 && active.is_none() && matches!(wanted, Wanted::Scalars) {
                    continue;
                }
                let name = tag.get("type").unwrap_or_default();
                let Some(sample_type) = SampleType::from_name(name) else {
                    refuse!(input, "has an array of type {name:?}, which is not read");
                };
                let array = SampleArray { at, sample_type, components };
                match place(&tag, input)? {
                    ArrayPlace::Appended { offset, .. } => appended = Some((array, offset)),
                    place => return Ok(Some((array, place))),
                }
            }
            "AppendedData" => {
                let Some((array, offset)) = appended.take() else { break };
                let encodings = [("base64", true), ("raw", false)];
                let base64 = choice(input.path(), "encoding", tag.get("encoding"), encodings)?;
                return Ok(Some((array, ArrayPlace::Appended { offset, base64 })));
            }
            _ => {}
        }
    }
    refuse_if!(appended.is_some(), input, "is cut short: it has no appended data");
    Ok(None)
}

pub(super) fn place(tag: &Tag, input: &Input) -> Result<ArrayPlace> {
    match tag.get("format") {
        Some("ascii") => Ok(ArrayPlace::Text),
        Some("binary") => Ok(ArrayPlace::Inline),
        Some("appended") => {
            let text = tag.get("offset").unwrap_or_default();
            let offset = text.parse().map_err(|_| input.error(format!("offset is {text:?}, expected a number")))?;
            Ok(ArrayPlace::Appended { offset, base64: false })
        }
        other => Err(input.error(format!("has an array in the format {:?}", other.unwrap_or_default()))),
    }
}

/// The encoding of the arrays of a file.
pub(super) struct Coding {
    endian: Endian,
    /// Whether the numbers before an array have 8 bytes rather than 4.
    wide: bool,
    codec: Option<BlockCodec>,
}

impl Coding {
    pub(super) fn of(file: &Tag, input: &Input) -> Result<Self> {
        let orders = [("LittleEndian", Endian::Little), ("BigEndian", Endian::Big)];
        let order = file.get("byte_order").or(Some(""));
        let endian = choice(input.path(), "byte_order", order, orders)?;
        let numbers = [("UInt32", false), ("UInt64", true)];
        let wide = choice(input.path(), "header_type", file.get("header_type"), numbers)?;
        let codec = match file.get("compressor") {
            None | Some("") => None,
            Some("vtkZLibDataCompressor") => Some(BlockCodec::Zlib),
            Some("vtkLZ4DataCompressor") => Some(BlockCodec::Lz4),
            Some(other) => {
                refuse!(
                    input,
                    "is compressed by {other:?}, which is not read: save it with ZLib, LZ4 or no compression"
                )
            }
        };
        Ok(Self { endian, wide, codec })
    }

    /// Moves from the end of a tag to the first sample.
    pub(super) fn at_samples(&self, mut input: Input, place: ArrayPlace) -> Result<(Input, Layout)> {
        let is_base64 = match place {
            ArrayPlace::Text => return Ok((input, Layout::Text)),
            ArrayPlace::Inline => true,
            ArrayPlace::Appended { offset, base64 } => {
                input.skip_past(b'_')?;
                input.skip(offset)?;
                base64
            }
        };
        if is_base64 {
            input.decode_digits(6);
        }
        let number =
            |input: &mut Input| -> Result<u64> { Ok(self.endian.number(&input.bytes(if self.wide { 8 } else { 4 })?)) };
        let input = match self.codec {
            Some(codec) => decompressed(input, codec, number)?,
            None => {
                // The length is not needed: the lattice gives it.
                number(&mut input)?;
                input
            }
        };
        Ok((input, Layout::Binary(self.endian)))
    }
}
