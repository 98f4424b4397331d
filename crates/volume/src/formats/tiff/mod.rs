//! TIFF and BigTIFF: the pages of a file, or the files of a folder in natural order, are the sections of a volume.
//!
//! The crate `tiff` finds the pages and decodes them. Pages that are uncompressed and in one piece stay in their file.
//! Sizes of voxels are stated by OME-XML, ImageJ or Zeiss LSM; of other files they are 1, because resolutions for
//! printers are no lengths in a volume. These descriptions, and tifffile's, also state which pages are sections,
//! channels and points in time, and which belong to one image: a series. A page of several samples per pixel has
//! channels of its own, and a page may be a volume (the tag ImageDepth of SGI).

mod described;
mod imagej;
mod lsm;
mod ome;
mod page;
mod shaped;
mod view;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, Limits};
use tiff::tags::Tag;

use self::described::Described;
use self::page::{MAX_EXPANSION, TiffPage, failed};
use self::view::PatchedFile;
use super::LoadOptions;
use super::complex;
use super::decode::{Kind, Layout, read_all, samples_of};
use super::input::Input;
use super::placement::Placement;
use super::selection::{Pick, Role, colours, one_of, picked};
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::memory::{samples_in, zeroed};
use crate::volume::{Endian, Number, Origin, Samples, Units, Volume, with_type};

/// The largest table or text of a directory, in bytes: positions of 65535 strips and a long OME-XML.
const MAX_VALUE: usize = 16 << 20;

/// The largest strip or tile, in bytes.
const MAX_STRIP: usize = 1 << 30;

/// The largest number of kinds of pages that are listed as series.
const MAX_KINDS: usize = 64;

/// Reads the volume of a file of TIFF.
pub(super) fn read(input: Input, options: &LoadOptions) -> Result<Volume> {
    if input.plain_file()?.is_none() {
        refuse!(input, "is a TIFF file in a stream or in gzip: write it to a file, decompressed");
    }
    let path = input.path().to_owned();
    let stack = Stack::open(&path, options.series)?;
    read_stacks(&path, &stack, std::slice::from_ref(&path), &stack.described.axes, options)
}

/// Reads the volume whose sections are in the given files of TIFF.
pub(super) fn read_files(folder: &Path, files: &[PathBuf], options: &LoadOptions) -> Result<Volume> {
    let Some(first) = files.first() else { refuse!(folder, "has no TIFF files") };
    let stack = Stack::open(first, None)?;
    let mut sections = stack.sections()?;
    for file in &files[1..] {
        let next = Stack::open(file, None)?;
        let (next_pages, pages) = (next.page.described(), stack.page.described());
        refuse_if!(next_pages != pages, file, "has pages of {next_pages}, but the first file has {pages}");
        sections = sections.saturating_add(next.sections()?);
    }
    read_stacks(folder, &stack, files, &[(Role::Space, sections)], &LoadOptions { series: None, ..*options })
}

fn read_stacks(
    path: &Path,
    stack: &Stack,
    files: &[PathBuf],
    pages: &[(Role, i64)],
    options: &LoadOptions,
) -> Result<Volume> {
    let TiffPage { kind, samples, planar, depth, .. } = stack.page;
    let [width, height] = stack.page.size.map(i64::from);
    let of_pages = pages.iter().filter(|(role, _)| *role == Role::Space).map(|(_, size)| *size);
    let sections = of_pages.fold(i64::from(depth), i64::saturating_mul);
    let steps = stack.described.spacing.unwrap_or([1.0; 3]);
    refuse_if!(steps.iter().any(|step| !step.is_finite()), stack.path, "has voxels of {steps:?}");
    let placement = Placement::axis_parallel(steps);
    let grid = placement.grid(path, &[width, height, sections], options.spacing)?;
    let mut axes = vec![(Role::Space, width), (Role::Space, height), (Role::Space, depth.into())];
    let role = if stack.page.complex { complex::role(path, options)? } else { Role::Channel };
    axes.insert(if planar { 2 } else { 0 }, (role, samples.into()));
    axes.extend(pages);
    let (pick, mut contents) = picked(path, &axes, options)?;
    contents.labels = stack.described.labels.clone();
    contents.origin = Origin::of(stack.described.is_microscopy.then_some("GM"), stack.described.name.as_deref());
    if contents.labels.is_empty() && stack.page.coloured {
        contents.labels = colours(contents.channels);
    }
    if stack.page.indexed && !stack.has_look_up_table {
        contents.notes.push("values are numbers of a palette, whose colours are not used".to_owned());
    }
    let stored = match (files, stack.plain) {
        ([file], Some([first, _])) => {
            let mut input = Input::open(file, None)?;
            input.skip(first)?;
            read_all(input, &pick, kind, Layout::Binary(stack.endian))?
        }
        _ => {
            let page = stack.page.len();
            samples_of!(kind, path, T => decoded::<T>(path, files, &pick, page, options.series)?).into()
        }
    };
    let stored = if stack.page.complex { complex::part(stored, path, options)? } else { stored };
    let units = Units { length: stack.described.unit.clone(), value: None };
    Ok(placement.volume(grid, stored)?.with_units(units).with_contents(contents))
}

/// Decodes the samples that are picked from the pages of the files, each of `page` samples.
fn decoded<T: Number>(path: &Path, files: &[PathBuf], pick: &Pick, page: u64, series: Option<u32>) -> Result<Vec<T>> {
    let count = pick.len();
    let mut samples: Vec<T> = zeroed(count, || samples_in(path))?;
    let mut done = 0;
    // The first page of a file, among all.
    let mut first = 0;
    for file in files {
        let Stack { mut decoder, page: of, pages, .. } = Stack::open(file, series)?;
        let area = of.area();
        refuse_if!(of.len() != page || page == 0, file, "has changed while it was read");
        // A page of which a part is wanted at a time, and its number.
        let (mut whole, mut held): (Vec<T>, Option<usize>) = (Vec::new(), None);
        // The next section that is wanted, if it is in this file.
        let next = |done: usize| {
            let place = (done as u64 + area <= count).then(|| pick.place(done as u64))?;
            let index = (place / page).checked_sub(first).and_then(|index| usize::try_from(index).ok())?;
            Some((index, (place % page) as usize))
        };
        while let Some((index, offset)) = next(done) {
            let Some(&directory) = pages.get(index) else { break };
            let section = &mut samples[done..done + area as usize];
            if page == area {
                of.read(&mut decoder, directory, file, section)?;
            } else {
                if whole.is_empty() {
                    whole = zeroed(page, || samples_in(path))?;
                }
                if held != Some(index) {
                    of.read(&mut decoder, directory, file, &mut whole)?;
                    held = Some(index);
                }
                let step = if of.planar { 1 } else { of.samples as usize };
                section.iter_mut().zip(whole[offset..].iter().step_by(step)).for_each(|(to, from)| *to = *from);
            }
            done += area as usize;
        }
        first += pages.len() as u64;
    }
    refuse_if!(done as u64 != count, path, "is cut short: {count} samples expected, {done} are there");
    Ok(samples)
}

/// A series of a file of TIFF.
struct Stack {
    path: PathBuf,
    decoder: Decoder<PatchedFile>,
    /// The first page of the series: the others are of its size and type.
    page: TiffPage,
    endian: Endian,
    /// The numbers of the pages' directories, in their order; directories of previews and of other series are left out.
    pages: Vec<usize>,
    /// The first byte of the samples and the byte after the last, if all of them are uncompressed and in one piece.
    plain: Option<[u64; 2]>,
    /// Whether a palette only shows grey values, as the look-up tables of ImageJ do.
    has_look_up_table: bool,
    described: Described,
}

/// A directory of a file of TIFF and its page.
struct Directory {
    number: usize,
    page: Result<TiffPage>,
    /// The description of the page, if it begins a series.
    text: Option<String>,
}

impl Stack {
    fn open(path: &Path, series: Option<u32>) -> Result<Self> {
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
        let view = PatchedFile::new(file).map_err(Error::read(path))?;
        let endian = view.endian();
        let decoder = Decoder::new(view).map_err(|error| failed(path, error))?;
        let mut decoder = decoder.with_limits(limits);
        let text = description(&mut decoder).unwrap_or_default();
        let resolution = [Tag::XResolution, Tag::YResolution].map(|tag| {
            let value = decoder.find_tag(tag).ok().flatten();
            value.and_then(per_unit)
        });
        let lsm = decoder.find_tag_unsigned_vec::<u8>(Tag::Unknown(lsm::TAG)).ok().flatten();
        let mut directories = directories(&mut decoder, path, length)?;
        let has_look_up_table = imagej::is_imagej(&text);
        let samples = |number: usize| {
            let page: Option<&TiffPage> = directories.get(number).and_then(|directory| directory.page.as_ref().ok());
            page.map_or(1, |page| page.samples)
        };
        let numbers: Vec<usize> = directories.iter().map(|directory| directory.number).collect();
        let count = numbers.len();
        let of_lsm = lsm.and_then(|info| lsm::described(&info, count, samples(0)));
        let all = if has_look_up_table {
            vec![imagej::described(&text, resolution, count, path)?]
        } else if let Some(described) = of_lsm {
            vec![described]
        } else if let Some(all) = ome::described(&text, &numbers, |number| samples(number).into(), path)? {
            all
        } else {
            undescribed(&directories)
        };
        let described = one_of(path, series, all, |described| words(described, &directories))?;
        let mut pages = described.pages.iter().filter_map(|number| directories.get(*number));
        let Some(first) = pages.next() else { refuse!(path, "has no pages of a volume") };
        let (mut numbers, mut plain) = (vec![first.number], None);
        if let Ok(page) = &first.page {
            plain = page.plain;
            let mut expansion = page.expansion;
            for Directory { number, page: next, .. } in pages {
                let next = match next {
                    Ok(next) => next,
                    Err(_) => refuse!(path, "page {} is of a kind that is not read", number + 1),
                };
                let (found, expected, n) = (next.described(), page.described(), number + 1);
                if found != expected {
                    refuse!(path, "page {n} has {found}, the first has {expected}: save pages of one size and type");
                }
                expansion = expansion.max(next.expansion);
                plain = match (plain, next.plain) {
                    (Some([start, end]), Some([next, last])) if next == end => Some([start, last]),
                    _ => None,
                };
                numbers.push(*number);
            }
            page.check_length(path, numbers.len() as u64, length, expansion)?;
        }
        if described.together && plain.is_none() && first.page.is_ok() {
            refuse!(path, "has one directory for several compressed sections: save it anew");
        }
        let first = described.pages[0];
        let page = directories.swap_remove(first).page?;
        Ok(Self { path: path.to_owned(), decoder, page, endian, pages: numbers, plain, has_look_up_table, described })
    }

    /// Returns the number of sections of a file that has neither channels nor points in time.
    fn sections(&self) -> Result<i64> {
        let axes = &self.described.axes;
        if axes.iter().any(|(role, size)| *role != Role::Space && *size != 1) {
            let reason = "such a file is read alone, not in a folder";
            refuse!(self.path, "has pages of several channels or points in time: {reason}");
        }
        Ok(self.described.depth())
    }
}

/// Returns the description of the directory that the decoder is at.
fn description(decoder: &mut Decoder<PatchedFile>) -> Option<String> {
    decoder.find_tag(Tag::ImageDescription).ok().flatten()?.into_string().ok()
}

/// Returns the directories of pages; directories of previews are left out.
fn directories(decoder: &mut Decoder<PatchedFile>, path: &Path, length: u64) -> Result<Vec<Directory>> {
    let (mut all, mut seen, mut number, mut chunks) = (Vec::new(), HashSet::new(), 0, 0_u64);
    loop {
        let is_preview = decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType).ok().flatten().unwrap_or(0) & 1 == 1;
        // The first page is one in any case.
        if number == 0 || !is_preview {
            let text = description(decoder).filter(|text| shaped::is_shaped(text));
            let page = TiffPage::of(decoder, path, length);
            if let Ok(page) = &page {
                chunks = chunks.saturating_add(page.chunks);
            }
            // An offset has two bytes at least. If there are more, directories share a table, and each would read it.
            if number > 0 && chunks.saturating_mul(2) > length {
                refuse!(path, "has directories that share a table of strips: it is damaged");
            }
            all.push(Directory { number, page, text });
        }
        if !decoder.more_images() {
            return Ok(all);
        }
        decoder.next_image().map_err(|error| failed(path, error))?;
        number += 1;
        // A chain of directories that is a ring.
        if !seen.insert(decoder.ifd_pointer().map(|pointer| pointer.0)) {
            refuse!(path, "has a directory that follows itself");
        }
    }
}

/// Returns the series of a file without a description of all: the series of tifffile, or pages of one size and type
/// each.
fn undescribed(directories: &[Directory]) -> Vec<Described> {
    if directories.first().is_some_and(|first| first.text.is_some()) {
        let numbers: Vec<usize> = (0..directories.len()).collect();
        let runs = numbers.chunk_by(|_, next| directories[*next].text.is_none());
        let described = |run: &[usize]| {
            let Directory { page, text, .. } = &directories[run[0]];
            let samples = page.as_ref().map_or(0, TiffPage::len);
            shaped::described(text.as_deref().unwrap_or_default(), run.to_vec(), samples)
        };
        return runs.map(described).collect();
    }
    let mut groups: Vec<(String, Vec<usize>)> = Vec::new();
    for (number, Directory { page, .. }) in directories.iter().enumerate() {
        let key = page.as_ref().map_or_else(Error::to_string, TiffPage::described);
        match groups.iter().position(|(of, _)| *of == key) {
            Some(group) => groups[group].1.push(number),
            // Beyond some kinds of pages it is no stack.
            None if groups.len() == MAX_KINDS => break,
            None => groups.push((key, vec![number])),
        }
    }
    groups.into_iter().map(|(_, pages)| Described::sections(pages)).collect()
}

/// Describes a series in words: its name and its size.
fn words(described: &Described, directories: &[Directory]) -> String {
    let page = described.pages.first().and_then(|number| directories.get(*number)?.page.as_ref().ok());
    let size = match (page, described.depth()) {
        (None, _) => "pages that are not read".to_owned(),
        (Some(page), 1) => page.described(),
        (Some(page), sections) => {
            let ([x, y], kind) = (page.size, page.kind.name());
            format!("{x} x {y} x {} {kind}", sections.saturating_mul(page.depth.into()))
        }
    };
    described.name.as_ref().map_or(size.clone(), |name| format!("{name:?} of {size}"))
}

/// Returns the length of a pixel by a resolution, which is the number of pixels in a unit of length.
fn per_unit(value: Value) -> Option<f64> {
    let Value::Rational(pixels, units) = value else { return None };
    Some(f64::from(units) / f64::from(pixels)).filter(|length| length.is_finite() && *length > 0.0)
}
