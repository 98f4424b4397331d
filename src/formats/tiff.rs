//! TIFF and BigTIFF: the pages of a file, or the files of a folder in natural order, are the sections of a volume.
//!
//! The crate `tiff` finds the pages and decodes them. Pages that are uncompressed and in one piece stay in their file.
//! Sizes of voxels are those of OME-XML (<https://docs.openmicroscopy.org/ome-model/latest/ome-tiff/>) or of ImageJ; of
//! other files 1, because resolutions for printers are no lengths in a volume. ImageJ writes a stack of over 4 GB with
//! one directory, and only its description says how many sections follow.

use std::collections::HashSet;
use std::fs::File;
use std::io::{BufReader, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tiff::TiffError;
use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, Limits};
use tiff::tags::{ByteOrder, Tag};

use super::decode::{Layout, lattice, of_halves, read_all, read_halves, samples_in};
use super::input::Input;
use super::placement::{Placement, named_unit};
use super::xml;
use crate::error::{Error, Result};
use crate::memory::reserved;
use crate::volume::{Endian, Number, SampleType, Samples, Stored, Units, Volume, with_type};

/// No codec expands more: LZW makes at most 4096 bytes of 12 bits. A page that claims more is refused.
const MAX_EXPANSION: u64 = 4096;

/// The largest table or text of a directory, in bytes: positions of 65535 strips and a long OME-XML.
const MAX_VALUE: usize = 16 << 20;

/// The largest strip or tile, in bytes.
const MAX_STRIP: usize = 1 << 30;

/// Whether these are the first bytes of a TIFF or BigTIFF file.
pub(super) fn is_tiff(head: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| head.starts_with(*magic))
}

/// Reads the volume of a file.
pub(super) fn read(input: Input, spacing: Option<[f64; 3]>) -> Result<Volume> {
    if input.plain_file()?.is_none() {
        return Err(input.error("is a TIFF file in a stream or in gzip: write it to a file, decompressed"));
    }
    let path = input.path().to_owned();
    let stack = Stack::open(&path)?;
    let sections = stack.sections();
    read_stacks(&path, &stack, std::slice::from_ref(&path), sections, spacing)
}

/// Reads the volume whose sections are in these files.
pub(super) fn read_files(folder: &Path, files: &[PathBuf], spacing: Option<[f64; 3]>) -> Result<Volume> {
    let Some(first) = files.first() else { return Err(Error::format(folder, "has no TIFF files")) };
    let stack = Stack::open(first)?;
    let mut sections = stack.sections();
    for file in &files[1..] {
        let next = Stack::open(file)?;
        if (next.size, next.kind) != (stack.size, stack.kind) {
            let ([w, h], [x, y]) = (next.size, stack.size);
            return Err(Error::format(
                file,
                format!(
                    "has pages of {w} x {h} {}, but the first file has {x} x {y} {}",
                    next.kind.name(),
                    stack.kind.name()
                ),
            ));
        }
        sections = sections.saturating_add(next.sections());
    }
    read_stacks(folder, &stack, files, sections, spacing)
}

fn read_stacks(
    path: &Path,
    stack: &Stack,
    files: &[PathBuf],
    sections: u64,
    spacing: Option<[f64; 3]>,
) -> Result<Volume> {
    let [width, height] = stack.size.map(i64::from);
    let dims = lattice(path, &[width, height, i64::try_from(sections).unwrap_or(i64::MAX)])?;
    let (steps, units) = stack.spacing()?;
    let placement = Placement::axis_parallel(steps);
    let grid = placement.grid(path, dims, spacing)?;
    let stored = match (files, stack.plain) {
        ([file], Some(first)) => {
            let mut input = Input::open(file)?;
            input.skip(first)?;
            match stack.kind {
                Kind::Whole(sample_type) => read_all(input, grid.len(), sample_type, Layout::Binary(stack.endian))?,
                Kind::Half => read_halves(input, grid.len(), Layout::Binary(stack.endian))?,
            }
        }
        _ => {
            let samples = match stack.kind {
                Kind::Whole(sample_type) => {
                    with_type!(sample_type, T => T::collected(decoded(path, files, grid.len())?))
                }
                Kind::Half => Samples::F32(of_halves(decoded(path, files, grid.len())?, path)?),
            };
            Stored::Memory(Arc::new(samples))
        }
    };
    Ok(placement.volume(grid, stored)?.with_units(units))
}

/// The samples of all pages of the files.
fn decoded<T: Number>(path: &Path, files: &[PathBuf], count: u64) -> Result<Vec<T>> {
    // What all files can hold, before memory is reserved.
    let mut most = 0_u64;
    for file in files {
        let length = std::fs::metadata(file).map_err(|source| Error::Read { path: file.clone(), source })?.len();
        most = most.saturating_add(length.saturating_mul(MAX_EXPANSION));
    }
    if count.saturating_mul(size_of::<T>() as u64) > most {
        let reason = format!("claims {count} samples, more than it can hold however compressed");
        return Err(Error::format(path, reason));
    }
    let mut samples: Vec<T> = reserved(count, || samples_in(path))?;
    for file in files {
        let mut stack = Stack::open(file)?;
        let page = (u64::from(stack.size[0]) * u64::from(stack.size[1])) as usize;
        for index in stack.pages.clone() {
            let start = samples.len();
            if (start + page) as u64 > count {
                return Err(Error::format(file, "has changed while it was read"));
            }
            samples.resize(start + page, T::zeroed());
            let bytes = bytemuck::cast_slice_mut(&mut samples[start..]);
            let decoder = &mut stack.decoder;
            let read = decoder.seek_to_image(index).and_then(|()| decoder.read_image_bytes(bytes));
            read.map_err(|error| failed(file, error))?;
        }
    }
    if samples.len() as u64 != count {
        return Err(Error::format(
            path,
            format!("is cut short: {count} samples expected, {} are there", samples.len()),
        ));
    }
    Ok(samples)
}

/// What a sample is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Whole(SampleType),
    /// 16-bit floating point.
    Half,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Whole(sample_type) => sample_type.name(),
            Self::Half => "f16",
        }
    }
}

/// The directories of a file.
struct Stack {
    path: PathBuf,
    decoder: Decoder<BufReader<File>>,
    size: [u32; 2],
    kind: Kind,
    endian: Endian,
    /// The directories of pages: those of previews are left out.
    pages: Vec<usize>,
    /// The offset of the first sample if all of them are uncompressed and in one piece.
    plain: Option<u64>,
    described: Described,
}

/// What the description of the first page says.
#[derive(Default)]
struct Described {
    /// Sections of ImageJ's stack that has one directory.
    images: Option<u64>,
    spacing: Option<[f64; 3]>,
    unit: Option<String>,
}

/// What a page says of its samples.
#[derive(PartialEq, Eq)]
struct Page {
    size: [u32; 2],
    kind: Kind,
    /// The first byte and the byte after the last, if they are uncompressed and in one piece.
    plain: Option<[u64; 2]>,
}

impl Stack {
    fn open(path: &Path) -> Result<Self> {
        let Some((file, _)) = Input::open_data(path)?.plain_file()? else {
            return Err(Error::format(path, "is not a regular file"));
        };
        let length = file.metadata().map_err(|source| Error::Read { path: path.to_owned(), source })?.len();
        let limit = usize::try_from(length.saturating_mul(MAX_EXPANSION)).unwrap_or(usize::MAX);
        let mut limits = Limits::default();
        // The first is of texts too, for which memory is taken at once.
        limits.decoding_buffer_size = MAX_VALUE.min(limit);
        limits.intermediate_buffer_size = MAX_STRIP.min(limit);
        limits.ifd_value_size = MAX_VALUE.min(limit);
        let decoder = Decoder::new(BufReader::new(file)).map_err(|error| failed(path, error))?;
        let mut decoder = decoder.with_limits(limits);
        let endian = match decoder.byte_order() {
            ByteOrder::LittleEndian => Endian::Little,
            ByteOrder::BigEndian => Endian::Big,
        };
        let first = Page::of(&mut decoder, path)?;
        let text = decoder.find_tag(Tag::ImageDescription).ok().flatten();
        let text = text.and_then(|value| value.into_string().ok()).unwrap_or_default();
        let resolution = [Tag::XResolution, Tag::YResolution].map(|tag| {
            let value = decoder.find_tag(tag).ok().flatten();
            value.and_then(per_unit)
        });
        let (mut pages, mut plain) = (vec![0], first.plain);
        let (mut index, mut seen) = (0, HashSet::new());
        while decoder.more_images() {
            // A chain of directories that is a ring.
            if !seen.insert(decoder.ifd_pointer().map(|pointer| pointer.0)) {
                return Err(Error::format(path, "has a directory that follows itself"));
            }
            decoder.next_image().map_err(|error| failed(path, error))?;
            index += 1;
            let preview = decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType).ok().flatten().unwrap_or(0) & 1 == 1;
            if preview {
                plain = None;
                continue;
            }
            let page = Page::of(&mut decoder, path)?;
            if (page.size, page.kind) != (first.size, first.kind) {
                let ([w, h], [x, y]) = (page.size, first.size);
                return Err(Error::format(
                    path,
                    format!(
                        "page {} has {w} x {h} {}, the first has {x} x {y} {}: save pages of one size and type",
                        index + 1,
                        page.kind.name(),
                        first.kind.name()
                    ),
                ));
            }
            plain = match (plain, page.plain) {
                (Some([start, end]), Some([next, last])) if next == end => Some([start, last]),
                _ => None,
            };
            pages.push(index);
        }
        let described = Described::of(&text, resolution, pages.len() as u64, path)?;
        let stack = Self {
            path: path.to_owned(),
            decoder,
            size: first.size,
            kind: first.kind,
            endian,
            pages,
            plain: plain.map(|[start, _]| start),
            described,
        };
        if stack.described.images.is_some() && stack.plain.is_none() {
            return Err(Error::format(path, "has one directory for several compressed sections: save it anew"));
        }
        Ok(stack)
    }

    fn sections(&self) -> u64 {
        self.described.images.unwrap_or(self.pages.len() as u64)
    }

    /// The distances between samples, and their unit.
    fn spacing(&self) -> Result<([f64; 3], Units)> {
        let steps = self.described.spacing.unwrap_or([1.0; 3]);
        if steps.iter().any(|step| !step.is_finite()) {
            return Err(Error::format(&self.path, format!("has voxels of {steps:?}")));
        }
        Ok((steps, Units { length: self.described.unit.clone(), value: None }))
    }
}

impl Page {
    /// What the directory that the decoder is at says.
    fn of(decoder: &mut Decoder<BufReader<File>>, path: &Path) -> Result<Self> {
        let failed = |error| failed(path, error);
        let (width, height) = decoder.dimensions().map_err(failed)?;
        let mut number = |tag: Tag, default: u32| -> Result<u32> {
            // Some tags have a number for each channel; all of them are alike.
            let value = decoder.find_tag_unsigned_vec::<u32>(tag).map_err(failed)?;
            Ok(value.and_then(|numbers| numbers.first().copied()).unwrap_or(default))
        };
        let channels = number(Tag::SamplesPerPixel, 1)?;
        let photometric = number(Tag::PhotometricInterpretation, 1)?;
        if channels != 1 || photometric != 1 {
            let reason = match photometric {
                0 => "its samples are inverted: 0 is white".to_owned(),
                3 => "its samples are numbers of a palette".to_owned(),
                _ => format!("has {channels} channels per sample"),
            };
            return Err(Error::format(path, format!("{reason}; save it in grey, black is 0")));
        }
        let bits = number(Tag::BitsPerSample, 1)?;
        let kind = match (bits, number(Tag::SampleFormat, 1)?) {
            (8, 1) => Kind::Whole(SampleType::U8),
            (16, 1) => Kind::Whole(SampleType::U16),
            (32, 1) => Kind::Whole(SampleType::U32),
            (64, 1) => Kind::Whole(SampleType::U64),
            (8, 2) => Kind::Whole(SampleType::I8),
            (16, 2) => Kind::Whole(SampleType::I16),
            (32, 2) => Kind::Whole(SampleType::I32),
            (64, 2) => Kind::Whole(SampleType::I64),
            (16, 3) => Kind::Half,
            (32, 3) => Kind::Whole(SampleType::F32),
            (64, 3) => Kind::Whole(SampleType::F64),
            (bits, format) => {
                let reason = format!("has samples of {bits} bits in format {format}, which is not read");
                return Err(Error::format(path, reason));
            }
        };
        let compressed = number(Tag::Compression, 1)? != 1 || number(Tag::Predictor, 1)? != 1;
        let mut plain = None;
        let strips = decoder.find_tag_unsigned_vec::<u64>(Tag::StripOffsets).map_err(failed)?;
        if !compressed && let Some(offsets) = strips.filter(|strips| !strips.is_empty()) {
            let counts = decoder.find_tag_unsigned_vec::<u64>(Tag::StripByteCounts).map_err(failed)?;
            let counts = counts.unwrap_or_default();
            let size = u64::from(width) * u64::from(height) * u64::from(bits / 8);
            let next = |(pair, count): (&[u64], &u64)| pair[0].checked_add(*count) == Some(pair[1]);
            let follow = offsets.windows(2).zip(&counts).all(next);
            let total = counts.iter().fold(0, |sum: u64, n| sum.saturating_add(*n));
            let whole = counts.len() == offsets.len() && total == size;
            plain = (follow && whole).then(|| [offsets[0], offsets[0].saturating_add(size)]);
        }
        Ok(Self { size: [width, height], kind, plain })
    }
}

/// A length from a resolution, which is a number of pixels in it.
fn per_unit(value: Value) -> Option<f64> {
    let Value::Rational(pixels, units) = value else { return None };
    Some(f64::from(units) / f64::from(pixels)).filter(|length| length.is_finite() && *length > 0.0)
}

impl Described {
    fn of(text: &str, resolution: [Option<f64>; 2], pages: u64, path: &Path) -> Result<Self> {
        if text.starts_with("ImageJ=") {
            return Self::of_imagej(text, resolution, pages, path);
        }
        match xml::Tag::all(text).find(|tag| tag.name.rsplit(':').next() == Some("Pixels")) {
            Some(tag) => Self::of_ome(&tag, pages, path),
            None => Ok(Self::default()),
        }
    }

    fn of_imagej(text: &str, resolution: [Option<f64>; 2], pages: u64, path: &Path) -> Result<Self> {
        let get = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('='));
        let count = |name: &str| get(name).and_then(|text| text.trim().parse::<u64>().ok()).unwrap_or(1);
        one_of_all(path, count("channels"), count("frames"))?;
        let [x, y] = resolution.map(|length| length.unwrap_or(1.0));
        let z = get("spacing").and_then(|text| text.trim().parse().ok()).filter(|z: &f64| z.is_finite() && *z != 0.0);
        let unit = match get("unit").map(str::trim) {
            Some("micron" | "microns" | "um" | "\\u00B5m" | "\u{b5}m") => Some("µm".to_owned()),
            Some("pixel" | "pixels") | None => None,
            Some(other) => named_unit(other),
        };
        Ok(Self {
            images: (pages == 1).then(|| count("images")).filter(|&images| images > 1),
            // Negative if the stack was turned over.
            spacing: Some([x, y, z.map_or(1.0, f64::abs)]),
            unit,
        })
    }

    fn of_ome(tag: &xml::Tag, pages: u64, path: &Path) -> Result<Self> {
        let count = |name: &str| tag.get(name).and_then(|text| text.parse::<u64>().ok()).unwrap_or(1);
        one_of_all(path, count("SizeC"), count("SizeT"))?;
        if count("SizeZ") != pages {
            let stated = count("SizeZ");
            let reason = format!("has {pages} pages, but its OME-XML states {stated} sections: save it as one file");
            return Err(Error::format(path, reason));
        }
        let stated = |name: &str| tag.get(name).and_then(|text| text.parse::<f64>().ok()).filter(|n| *n > 0.0);
        let lengths = ["PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ"].map(stated);
        let units = ["PhysicalSizeXUnit", "PhysicalSizeYUnit", "PhysicalSizeZUnit"];
        let units = units.map(|name| tag.get(name).unwrap_or("µm"));
        let Some(x) = lengths[0] else { return Ok(Self::default()) };
        if units.iter().zip(lengths).any(|(unit, length)| length.is_some() && *unit != units[0]) {
            return Err(Error::format(path, format!("states lengths in several units, {}", units.join(", "))));
        }
        let spacing = Some([x, lengths[1].unwrap_or(x), lengths[2].unwrap_or(x)]);
        Ok(Self { images: None, spacing, unit: named_unit(units[0]) })
    }
}

/// Refuses a file of several channels or points in time.
fn one_of_all(path: &Path, channels: u64, times: u64) -> Result<()> {
    if channels <= 1 && times <= 1 {
        return Ok(());
    }
    let reason = format!("holds {channels} channels at {times} points in time: save one of them alone");
    Err(Error::format(path, reason))
}

/// The crate's error as one of ours: of the file, or of the content.
fn failed(path: &Path, error: TiffError) -> Error {
    let content = [ErrorKind::InvalidData, ErrorKind::InvalidInput, ErrorKind::Other];
    match error {
        TiffError::IoError(source) if source.kind() == ErrorKind::UnexpectedEof => {
            Error::format(path, "is cut short: a directory or a page ends behind the end of the file")
        }
        TiffError::IoError(source) if !content.contains(&source.kind()) => {
            Error::Read { path: path.to_owned(), source }
        }
        other => Error::format(path, format!("is damaged, or TIFF of a kind that is not read: {other}")),
    }
}
