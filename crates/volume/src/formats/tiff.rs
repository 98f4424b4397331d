//! TIFF and BigTIFF: the pages of a file, or the files of a folder in natural order, are the sections of a volume.
//!
//! The crate `tiff` finds the pages and decodes them. Pages that are uncompressed and in one piece stay in their file.
//! Sizes of voxels are stated by OME-XML (<https://docs.openmicroscopy.org/ome-model/latest/ome-tiff/>) or of ImageJ; of
//! other files 1, because resolutions for printers are no lengths in a volume. ImageJ writes a stack of over 4 GB with
//! one directory, and only its description says how many sections follow. Both say in which order pages have sections,
//! channels and points in time; a page of several samples per pixel has channels of its own.

use std::collections::HashSet;
use std::fs::File;
use std::io::{BufReader, ErrorKind};
use std::path::{Path, PathBuf};

use tiff::TiffError;
use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, Limits};
use tiff::tags::{ByteOrder, Tag};

use super::LoadOptions;
use super::decode::{Kind, Layout, read_all, samples_of};
use super::input::{self, Input};
use super::placement::{Placement, lattice, named_unit, plain_name};
use super::selection::{Axes, Pick, Role, colours, picked};
use super::xml;
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::memory::{samples_in, zeroed};
use crate::names::counted;
use crate::volume::{Channel, Endian, Number, Origin, Samples, Units, Volume, with_type};

/// No codec expands more: LZW makes at most 4096 bytes of 12 bits.
const MAX_EXPANSION: u64 = 2731;

/// The largest table or text of a directory, in bytes: positions of 65535 strips and a long OME-XML.
const MAX_VALUE: usize = 16 << 20;

/// The largest strip or tile, in bytes.
const MAX_STRIP: usize = 1 << 30;

/// The most bytes that a codec makes of one. A page that claims more is refused.
fn expansion(compression: u32) -> u64 {
    match compression {
        1 => 1,
        8 | 32946 => input::MAX_EXPANSION,
        // PackBits repeats a byte up to 128 times.
        32773 => 64,
        _ => MAX_EXPANSION,
    }
}

/// Reads the volume of a file.
pub(super) fn read(input: Input, options: &LoadOptions) -> Result<Volume> {
    if input.plain_file()?.is_none() {
        refuse!(input, "is a TIFF file in a stream or in gzip: write it to a file, decompressed");
    }
    let path = input.path().to_owned();
    let stack = Stack::open(&path)?;
    read_stacks(&path, &stack, std::slice::from_ref(&path), &stack.described.axes, options)
}

/// Reads the volume whose sections are in these files.
pub(super) fn read_files(folder: &Path, files: &[PathBuf], options: &LoadOptions) -> Result<Volume> {
    let Some(first) = files.first() else { refuse!(folder, "has no TIFF files") };
    let stack = Stack::open(first)?;
    let mut sections = stack.sections()?;
    for file in &files[1..] {
        let next = Stack::open(file)?;
        let (next_pages, pages) = (next.page.described(), stack.page.described());
        refuse_if!(next_pages != pages, file, "has pages of {next_pages}, but the first file has {pages}");
        sections = sections.saturating_add(next.sections()?);
    }
    read_stacks(folder, &stack, files, &[(Role::Space, sections)], options)
}

fn read_stacks(
    path: &Path,
    stack: &Stack,
    files: &[PathBuf],
    pages: &[(Role, i64)],
    options: &LoadOptions,
) -> Result<Volume> {
    let Page { kind, samples, planar, .. } = stack.page;
    let [width, height] = stack.page.size.map(i64::from);
    let sections = pages.iter().find(|(role, _)| *role == Role::Space).map_or(1, |(_, size)| *size);
    let steps = stack.described.spacing.unwrap_or([1.0; 3]);
    refuse_if!(steps.iter().any(|step| !step.is_finite()), stack.path, "has voxels of {steps:?}");
    let placement = Placement::axis_parallel(steps);
    let grid = placement.grid(path, &[width, height, sections], options.spacing)?;
    let mut axes = vec![(Role::Space, width), (Role::Space, height)];
    axes.insert(if planar { 2 } else { 0 }, (Role::Channel, samples.into()));
    axes.extend(pages);
    let (pick, mut contents) = picked(path, &axes, options)?;
    contents.labels = stack.described.labels.clone();
    contents.origin = Origin::of(stack.described.is_ome.then_some("GM"), []);
    if contents.labels.is_empty() && stack.page.coloured {
        contents.labels = colours(contents.channels);
    }
    let stored = match (files, stack.plain) {
        ([file], Some([first, _])) => {
            let mut input = Input::open(file, None)?;
            input.skip(first)?;
            read_all(input, &pick, kind, Layout::Binary(stack.endian))?
        }
        _ => samples_of!(kind, path, T => decoded::<T>(path, files, &pick, stack.page.len())?).into(),
    };
    let units = Units { length: stack.described.unit.clone(), value: None };
    Ok(placement.volume(grid, stored)?.with_units(units).with_contents(contents))
}

/// The samples that are picked from the pages of the files, each of `page` samples.
fn decoded<T: Number>(path: &Path, files: &[PathBuf], pick: &Pick, page: u64) -> Result<Vec<T>> {
    let count = pick.len();
    let mut samples: Vec<T> = zeroed(count, || samples_in(path))?;
    let mut done = 0;
    // The first page of a file, among all.
    let mut first = 0;
    for file in files {
        let mut stack = Stack::open(file)?;
        let area = stack.page.area();
        refuse_if!(stack.page.len() != page || page == 0, file, "has changed while it was read");
        let mut whole: Vec<T> = Vec::new();
        // The next section that is wanted, if it is in this file.
        let next = |done: usize| {
            let place = (done as u64 + area <= count).then(|| pick.place(done as u64))?;
            let index = (place / page).checked_sub(first).and_then(|index| usize::try_from(index).ok())?;
            Some((index, (place % page) as usize))
        };
        while let Some((index, offset)) = next(done) {
            let Some(&index) = stack.pages.get(index) else { break };
            let section = &mut samples[done..done + area as usize];
            let decoder = &mut stack.decoder;
            let mut read = |samples: &mut [T]| -> tiff::TiffResult<()> {
                decoder.seek_to_image(index)?;
                let whole = decoder.image_buffer_layout()?.complete_len;
                let bytes: &mut [u8] = bytemuck::cast_slice_mut(samples);
                if whole != bytes.len() {
                    // The crate leaves out samples beyond the colours.
                    return Err(TiffError::UnsupportedError(tiff::TiffUnsupportedError::UnsupportedDataType));
                }
                decoder.read_image_bytes(bytes)
            };
            if stack.page.samples == 1 {
                read(section).map_err(|error| failed(file, error))?;
            } else {
                if whole.is_empty() {
                    whole = zeroed(page, || samples_in(path))?;
                }
                read(&mut whole).map_err(|error| failed(file, error))?;
                let step = if stack.page.planar { 1 } else { stack.page.samples as usize };
                section.iter_mut().zip(whole[offset..].iter().step_by(step)).for_each(|(to, from)| *to = *from);
            }
            done += area as usize;
        }
        first += stack.pages.len() as u64;
    }
    refuse_if!(done as u64 != count, path, "is cut short: {count} samples expected, {done} are there");
    Ok(samples)
}

/// The directories of a file.
struct Stack {
    path: PathBuf,
    decoder: Decoder<BufReader<File>>,
    /// The first page: the others are of its size and type.
    page: Page,
    endian: Endian,
    /// The directories of pages; directories of previews are left out.
    pages: Vec<usize>,
    /// Where samples begin and end if all of them are uncompressed and in one piece.
    plain: Option<[u64; 2]>,
    described: Described,
}

/// The facts that the description of the first page states.
#[derive(Default)]
struct Described {
    /// The axes of pages, the fastest first; one axis is of space.
    axes: Axes,
    labels: Vec<Channel>,
    /// Whether all pages have one directory, as ImageJ writes large stacks.
    together: bool,
    spacing: Option<[f64; 3]>,
    unit: Option<String>,
    /// Whether it is of OME, the format of microscopy.
    is_ome: bool,
}

/// The properties of a page.
struct Page {
    size: [u32; 2],
    kind: Kind,
    /// The samples of a pixel.
    samples: u16,
    /// Whether they are in planes behind one another.
    planar: bool,
    /// Whether they are colours.
    coloured: bool,
    /// The first byte and the byte after the last, if they are uncompressed and in one piece.
    plain: Option<[u64; 2]>,
    /// The most bytes that its codec makes of one.
    expansion: u64,
    /// The number of its strips or tiles.
    chunks: u64,
}

impl Stack {
    fn open(path: &Path) -> Result<Self> {
        let Some((file, _)) = Input::open_data(path, None)?.plain_file()? else {
            refuse!(path, "is not a regular file");
        };
        let length = file.metadata().map_err(Error::read(path))?.len();
        let limit = usize::try_from(length.saturating_mul(MAX_EXPANSION)).unwrap_or(usize::MAX);
        let mut limits = Limits::default();
        // The first limit holds for texts too, whose memory is reserved at once.
        limits.decoding_buffer_size = MAX_VALUE.min(limit);
        limits.intermediate_buffer_size = MAX_STRIP.min(limit);
        limits.ifd_value_size = MAX_VALUE.min(limit);
        let decoder = Decoder::new(BufReader::new(file)).map_err(|error| failed(path, error))?;
        let mut decoder = decoder.with_limits(limits);
        let endian = match decoder.byte_order() {
            ByteOrder::LittleEndian => Endian::Little,
            ByteOrder::BigEndian => Endian::Big,
        };
        let first = Page::of(&mut decoder, path, length)?;
        let text = decoder.find_tag(Tag::ImageDescription).ok().flatten();
        let text = text.and_then(|value| value.into_string().ok()).unwrap_or_default();
        let resolution = [Tag::XResolution, Tag::YResolution].map(|tag| {
            let value = decoder.find_tag(tag).ok().flatten();
            value.and_then(per_unit)
        });
        let (mut pages, mut plain) = (vec![0], first.plain);
        let (mut chunks, mut expansion) = (first.chunks, first.expansion);
        let (mut index, mut seen) = (0, HashSet::new());
        while decoder.more_images() {
            // A chain of directories that is a ring.
            if !seen.insert(decoder.ifd_pointer().map(|pointer| pointer.0)) {
                refuse!(path, "has a directory that follows itself");
            }
            decoder.next_image().map_err(|error| failed(path, error))?;
            index += 1;
            let preview = decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType).ok().flatten().unwrap_or(0) & 1 == 1;
            if preview {
                plain = None;
                continue;
            }
            let page = Page::of(&mut decoder, path, length)?;
            chunks = chunks.saturating_add(page.chunks);
            expansion = expansion.max(page.expansion);
            // An offset has two bytes at least. If there are more, directories share a table, and each would read it.
            if chunks.saturating_mul(2) > length {
                refuse!(path, "has directories that share a table of strips: it is damaged");
            }
            let (found, expected, n) = (page.described(), first.described(), index + 1);
            if found != expected {
                refuse!(path, "page {n} has {found}, the first has {expected}: save pages of one size and type");
            }
            plain = match (plain, page.plain) {
                (Some([start, end]), Some([next, last])) if next == end => Some([start, last]),
                _ => None,
            };
            pages.push(index);
        }
        first.check_length(path, pages.len() as u64, length, expansion)?;
        let described = Described::of(&text, resolution, pages.len() as i64, first.samples, path)?;
        if described.together && plain.is_none() {
            refuse!(path, "has one directory for several compressed sections: save it anew");
        }
        Ok(Self { path: path.to_owned(), decoder, page: first, endian, pages, plain, described })
    }

    /// The sections of a file that has nothing else.
    fn sections(&self) -> Result<i64> {
        let axes = &self.described.axes;
        if axes.iter().any(|(role, size)| *role != Role::Space && *size != 1) {
            let reason = "such a file is read alone, not in a folder";
            refuse!(self.path, "has pages of several channels or points in time: {reason}");
        }
        Ok(axes.iter().map(|(_, size)| *size).fold(1, i64::saturating_mul))
    }
}

impl Page {
    /// The number of pixels.
    fn area(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1])
    }

    /// The number of samples.
    fn len(&self) -> u64 {
        self.area().saturating_mul(self.samples.into())
    }

    /// The size and the type, which all pages share.
    fn described(&self) -> String {
        let ([x, y], kind) = (self.size, self.kind.name());
        match (self.samples, self.planar) {
            (1, _) => format!("{x} x {y} {kind}"),
            (n, false) => format!("{x} x {y} pixels of {n} {kind}"),
            (n, true) => format!("{n} planes of {x} x {y} {kind}"),
        }
    }

    /// Refuses pages that need more bytes than those `held` in the file become by an expansion.
    fn check_length(&self, path: &Path, pages: u64, held: u64, expansion: u64) -> Result<()> {
        let needed = self.len().saturating_mul(self.kind.size() as u64).saturating_mul(pages);
        if needed <= held.saturating_mul(expansion) {
            return Ok(());
        }
        let [x, y] = self.size;
        let size = if pages == 1 { format!("{x} x {y}") } else { format!("{x} x {y} x {pages}") };
        let there = match expansion {
            1 => format!("{held} are there"),
            _ => format!("and {held} compressed bytes cannot hold that many"),
        };
        refuse!(path, "is cut short, or its header claims too much: {size} samples need {needed} bytes, {there}")
    }

    /// What the directory that the decoder is at says.
    /// The file has `length` bytes.
    fn of(decoder: &mut Decoder<BufReader<File>>, path: &Path, length: u64) -> Result<Self> {
        let failed = |error| failed(path, error);
        let (width, height) = decoder.dimensions().map_err(failed)?;
        let mut number = |tag: Tag, default: u32| -> Result<u32> {
            // Some tags have a number for each channel; all of them are alike.
            let value = decoder.find_tag_unsigned_vec::<u32>(tag).map_err(failed)?;
            Ok(value.and_then(|numbers| numbers.first().copied()).unwrap_or(default))
        };
        let samples = number(Tag::SamplesPerPixel, 1)?;
        let samples = u16::try_from(samples).ok().filter(|samples| *samples > 0);
        let samples = samples.ok_or_else(|| Error::format(path, "has pixels without samples"))?;
        let coloured = match number(Tag::PhotometricInterpretation, 1)? {
            1 => false,
            2 => true,
            other => {
                let reason = match other {
                    0 => "are inverted: 0 is white".to_owned(),
                    3 => "are numbers of a palette".to_owned(),
                    _ => format!("have the photometric interpretation {other}"),
                };
                refuse!(path, "its samples {reason}; save it in grey, black is 0, or in RGB");
            }
        };
        let planar = samples > 1 && number(Tag::PlanarConfiguration, 1)? == 2;
        let bits = number(Tag::BitsPerSample, 1)?;
        let format = number(Tag::SampleFormat, 1)?;
        let letter = ["", "u", "i", "f"].get(format as usize).copied().unwrap_or_default();
        let kind = Kind::of_numpy(&format!("{letter}{}", bits / 8)).filter(|_| bits % 8 == 0);
        let Some(kind) = kind else {
            refuse!(path, "has samples of {bits} bits in format {format}, which is not read");
        };
        let expansion = expansion(number(Tag::Compression, 1)?);
        let compressed = expansion != 1 || number(Tag::Predictor, 1)? != 1;
        let mut table =
            |tag: Tag| decoder.find_tag_unsigned_vec::<u64>(tag).map_err(failed).map(Option::unwrap_or_default);
        let mut offsets = table(Tag::StripOffsets)?;
        let in_strips = !offsets.is_empty();
        if !in_strips {
            offsets = table(Tag::TileOffsets)?;
        }
        let counts = table(if in_strips { Tag::StripByteCounts } else { Tag::TileByteCounts })?;
        lattice(path, &[width.into(), height.into()])?;
        let whole = counts.len() == offsets.len();
        // Of a strip that ends behind the end of the file only its beginning is there.
        let there = |(offset, count): (&u64, &u64)| length.saturating_sub(*offset).min(*count);
        let held = if whole { offsets.iter().zip(&counts).map(there).fold(0, u64::saturating_add) } else { length };
        let mut page = Self {
            size: [width, height],
            kind,
            samples,
            planar,
            coloured,
            plain: None,
            expansion,
            chunks: offsets.len() as u64,
        };
        page.check_length(path, 1, held.min(length), expansion)?;
        if !compressed && in_strips {
            let bytes = page.len() * kind.size() as u64;
            let next = |(pair, count): (&[u64], &u64)| pair[0].checked_add(*count) == Some(pair[1]);
            let follow = offsets.windows(2).zip(&counts).all(next);
            let total = counts.iter().fold(0, |sum: u64, n| sum.saturating_add(*n));
            let is_plain = follow && whole && total == bytes;
            page.plain = is_plain.then(|| [offsets[0], offsets[0].saturating_add(bytes)]);
        }
        Ok(page)
    }
}

/// A length from a resolution, which is a number of pixels in it.
fn per_unit(value: Value) -> Option<f64> {
    let Value::Rational(pixels, units) = value else { return None };
    Some(f64::from(units) / f64::from(pixels)).filter(|length| length.is_finite() && *length > 0.0)
}

impl Described {
    fn of(text: &str, resolution: [Option<f64>; 2], pages: i64, samples: u16, path: &Path) -> Result<Self> {
        if text.starts_with("ImageJ=") {
            return Self::of_imagej(text, resolution, pages, path);
        }
        match xml::Tag::all(text).find(|tag| tag.name.rsplit(':').next() == Some("Pixels")) {
            Some(tag) => Self::of_ome(&tag, text, pages, samples, path),
            None => Ok(Self { axes: vec![(Role::Space, pages)], ..Self::default() }),
        }
    }

    fn of_imagej(text: &str, resolution: [Option<f64>; 2], pages: i64, path: &Path) -> Result<Self> {
        let get = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('='));
        let count = |name: &str| get(name).and_then(|text| text.trim().parse::<i64>().ok()).unwrap_or(1);
        let together = pages == 1 && count("images") > 1;
        let images = if together { count("images") } else { pages };
        let (channels, times) = (count("channels").max(1), count("frames").max(1));
        let volumes = channels.saturating_mul(times);
        if images % volumes != 0 {
            let pages = counted(images.unsigned_abs(), "page");
            let channels = counted(channels.unsigned_abs(), "channel");
            let at = if times == 1 { "one point in time".to_owned() } else { format!("{times} points in time") };
            refuse!(path, "has {pages} for {channels} at {at}");
        }
        let axes = vec![(Role::Channel, channels), (Role::Space, images / volumes), (Role::Time, times)];
        let [x, y] = resolution.map(|length| length.unwrap_or(1.0));
        let z = get("spacing").and_then(|text| text.trim().parse().ok()).filter(|z: &f64| z.is_finite() && *z != 0.0);
        let unit = match get("unit").map(str::trim) {
            Some("micron" | "microns" | "um" | "\\u00B5m" | "\u{b5}m") => Some("µm".to_owned()),
            Some("pixel" | "pixels") | None => None,
            Some(other) => named_unit(other),
        };
        // Negative if the stack was turned over.
        let spacing = Some([x, y, z.map_or(1.0, f64::abs)]);
        Ok(Self { axes, together, spacing, unit, ..Self::default() })
    }

    fn of_ome(tag: &xml::Tag, text: &str, pages: i64, samples: u16, path: &Path) -> Result<Self> {
        let count = |name: &str| tag.get(name).and_then(|text| text.parse::<i64>().ok()).unwrap_or(1).max(1);
        let (sections, channels, times) = (count("SizeZ"), count("SizeC"), count("SizeT"));
        let of_pages = (channels / i64::from(samples)).max(1);
        let stated = sections.saturating_mul(of_pages).saturating_mul(times);
        if stated != pages {
            let pages = counted(pages.unsigned_abs(), "page");
            refuse!(path, "has {pages}, but its OME-XML states {stated}: save it as one file");
        }
        let axes = tag.get("DimensionOrder").unwrap_or("XYZCT").chars().filter_map(|axis| match axis {
            'Z' => Some((Role::Space, sections)),
            'C' => Some((Role::Channel, of_pages)),
            'T' => Some((Role::Time, times)),
            _ => None,
        });
        let axes: Axes = axes.collect();
        refuse_if!(axes.len() != 3, path, "has no order of its dimensions that is known");
        let mut labels: Vec<Channel> = xml::Tag::all(text)
            .filter(|tag| tag.name.rsplit(':').next() == Some("Channel"))
            .take(MAX_LABELS)
            .map(|tag| Channel {
                name: tag.get("Name").and_then(plain_name),
                // Red, green, blue and opacity, from the highest byte to the lowest.
                color: tag.get("Color").and_then(|text| text.parse::<i32>().ok()).map(|rgba| {
                    let [r, g, b, _] = rgba.to_be_bytes();
                    [r, g, b]
                }),
                window: None,
            })
            .collect();
        if labels.len() as i64 != channels || labels.iter().all(|label| *label == Channel::default()) {
            labels.clear();
        }
        let stated = |name: &str| tag.get(name).and_then(|text| text.parse::<f64>().ok()).filter(|n| *n > 0.0);
        let lengths = ["PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ"].map(stated);
        let units = ["PhysicalSizeXUnit", "PhysicalSizeYUnit", "PhysicalSizeZUnit"];
        let units = units.map(|name| tag.get(name).unwrap_or("µm"));
        let described = Self { axes, labels, is_ome: true, ..Self::default() };
        let Some(x) = lengths[0] else { return Ok(described) };
        if units.iter().zip(lengths).any(|(unit, length)| length.is_some() && *unit != units[0]) {
            refuse!(path, "states lengths in several units, {}", units.join(", "));
        }
        let spacing = Some([x, lengths[1].unwrap_or(x), lengths[2].unwrap_or(x)]);
        Ok(Self { spacing, unit: named_unit(units[0]), ..described })
    }
}

/// The most channels whose names are kept.
const MAX_LABELS: usize = 4096;

/// The crate's error as one of ours: of the file, or of the content.
fn failed(path: &Path, error: TiffError) -> Error {
    match error {
        TiffError::IoError(source) if source.kind() == ErrorKind::UnexpectedEof => {
            path.error("is cut short: a directory or a page ends behind the end of the file")
        }
        TiffError::IoError(source) => Error::of_content(path, source),
        other => path.error(format!("is damaged, or TIFF of a kind that is not read: {other}")),
    }
}
