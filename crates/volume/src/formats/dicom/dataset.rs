//! The elements of a DICOM file that a volume needs (PS3.5 and PS3.10).
//!
//! The crate `dicom-object` is not used: it reserves the memory that an element claims, and brings dictionaries of
//! thousands of tags.
//!
//! Files in gzip and deflated elements are read as a stream. Their pixels alone are kept, once their size is known.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Cursor, Read, Seek};
use std::path::{Path, PathBuf};

use flate2::bufread::DeflateDecoder;

use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::files::remote::is_url;
use crate::formats::input::{Input, MAX_EXPANSION, buffered};
use crate::memory::{reserved, samples_in};
use crate::volume::Endian;

/// The longest value that is kept, in bytes: a list of six numbers has under 100.
const MAX_VALUE: u64 = 4096;

/// The longest value of [`LONG`], in bytes.
const MAX_LONG: u64 = 1 << 20;

/// The tags whose values may be longer than others: the tables of palettes, whole and in segments, and the offsets and
/// the slices of frames.
const LONG: [u32; 8] = [
    0x0028_1201,
    0x0028_1202,
    0x0028_1203,
    0x0028_1221,
    0x0028_1222,
    0x0028_1223,
    super::FRAME_OFFSETS,
    super::SLICE_VECTOR,
];

/// The elements of the private groups of Siemens that may hold a CSA header: (0029,xx10), of about 12 kB.
const CSA_GROUP: u32 = 0x0029;

/// The largest number of bytes that are read from a compressed file: pixels have under 4 GiB.
const MAX_UNPACKED: u64 = 5 << 30;

/// The deepest sequence within sequences: real ones have under 10.
const MAX_DEPTH: usize = 32;

/// The largest number of fragments of a file.
const MAX_FRAGMENTS: usize = 1 << 20;

/// The largest number of frames of a file: a segmentation has one for each segment in each slice.
pub(super) const MAX_FRAMES: usize = 1 << 20;

/// The largest number of segments of a file: their numbers have 16 bits.
const MAX_SEGMENTS: usize = 1 << 16;

/// The transfer syntax whose elements are deflated.
const DEFLATED: &str = "1.2.840.10008.1.2.1.99";

/// The length of an element that ends at a mark.
const UNDEFINED: u32 = u32::MAX;

/// The sequences that are read, in files without types too: the sequences of all frames and of each frame, and inside
/// them positions, orientations, spacings, maps to values, indices of time, delays of triggers, echoes, diffusion,
/// types of frames and segments. Sequences of makers may have values of the same names with another meaning.
const SEQUENCES: [u32; 15] = [
    SHARED,
    PER_FRAME,
    DETECTORS,
    REGIONS,
    REAL_WORLD,
    0x0020_9113,
    0x0020_9116,
    0x0028_9110,
    0x0028_9145,
    0x0020_9111,
    0x0018_9118,
    0x0018_9114,
    0x0018_9117,
    0x0018_9226,
    0x0062_000a,
];

/// The sequences whose items describe the whole file, if they are at its top: the detectors of nuclear medicine, the
/// regions of ultrasound and maps to real-world values. Their first items count.
const OF_FILE: [u32; 3] = [DETECTORS, REGIONS, REAL_WORLD];
const DETECTORS: u32 = 0x0054_0022;
const REGIONS: u32 = 0x0018_6011;
const REAL_WORLD: u32 = 0x0040_9096;

/// The tags of the sequences of all frames, of each frame, and of the segments of a segmentation.
const SHARED: u32 = 0x5200_9229;
const PER_FRAME: u32 = 0x5200_9230;
const SEGMENTS: u32 = 0x0062_0002;

/// Returns the longest value of a tag that is kept, in bytes.
fn longest(tag: u32) -> u64 {
    let is_csa = tag >> 16 == CSA_GROUP && tag & 0xff == 0x10;
    if LONG.contains(&tag) || is_csa { MAX_LONG } else { MAX_VALUE }
}

/// The values of elements by tag: group and element in one number.
pub(super) type Values = HashMap<u32, Vec<u8>>;

/// The elements of a file, without its pixels.
#[derive(Default)]
pub(super) struct Dataset {
    pub(super) path: PathBuf,
    /// The UID of the transfer syntax.
    pub(super) syntax: String,
    pub(super) endian: Endian,
    values: Values,
    /// The values that all frames share.
    shared: Values,
    frames: Vec<Values>,
    /// The descriptions of segments.
    pub(super) segments: Vec<Values>,
    /// Whether the pixels are floating point.
    pub(super) is_float: bool,
    /// Whether the pixels are stored in words of 16 bits, whatever their size.
    pub(super) in_words: bool,
    /// The offset of the pixels in the bytes that [`Self::open`] returns, and their length unless they are in
    /// fragments.
    pub(super) pixels: Option<(u64, Option<u64>)>,
    /// The offsets and the lengths of fragments in the bytes that [`Self::open`] returns.
    pub(super) fragments: Vec<[u64; 2]>,
    /// The first item before the fragments: the offsets of frames, or nothing.
    pub(super) frame_table: Vec<u8>,
    /// The decompressed pixels of a compressed file.
    unpacked: Option<Vec<u8>>,
}

/// A source of bytes that are read at any place.
pub(super) trait ByteSource: Read + Seek {}

impl<T: Read + Seek> ByteSource for T {}

impl Dataset {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let mut input = Input::open_data(path, None)?.unpacked_if_marked()?;
        if is_url(path) {
            // The fetched file has no name by which it is opened again.
            input = input.streamed();
        }
        input.limit(MAX_UNPACKED);
        let set = Self { path: path.to_owned(), ..Self::default() };
        let length = input.at_most().unwrap_or(0);
        let mut reader = ElementReader { input, length, explicit: true, is_sure: false, group: None, set };
        reader.run()?;
        Ok(reader.set)
    }

    /// Makes an error about this file.
    pub(super) fn error(&self, reason: impl Into<String>) -> Error {
        self.path.error(reason)
    }

    /// Returns the name of this file, without its folder.
    pub(super) fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// Opens the file, or the decompressed pixels of a compressed file.
    pub(super) fn open(&self) -> io::Result<Box<dyn ByteSource + '_>> {
        Ok(match &self.unpacked {
            Some(bytes) => Box::new(Cursor::new(bytes.as_slice())),
            None => Box::new(File::open(&self.path)?),
        })
    }

    /// Returns whether a frame has a value of this tag, or all frames share one: not the whole file alone.
    pub(super) fn is_of_frames(&self, frame: usize, tag: u32) -> bool {
        self.shared.contains_key(&tag) || self.frames.get(frame).is_some_and(|values| values.contains_key(&tag))
    }

    /// Returns the bytes of a value of a maker: of `element` in the block of `group` that the maker's name reserves.
    pub(super) fn private(&self, group: u32, maker: &str, element: u32) -> Option<&[u8]> {
        let is_maker = |block: &u32| self.value(group << 16 | block).is_some_and(|name| trimmed(name) == maker);
        let block = (0x10..=0xff).find(is_maker)?;
        self.value(group << 16 | block << 8 | element)
    }

    /// Returns the text of a value, of the frame if it has a value of its own.
    pub(super) fn frame_text(&self, frame: usize, tag: u32) -> Option<String> {
        self.bytes(frame, tag).map(trimmed)
    }

    /// Returns the bytes of a value, of the frame if it has a value of its own.
    fn bytes(&self, frame: usize, tag: u32) -> Option<&[u8]> {
        let of_frame = self.frames.get(frame).and_then(|values| values.get(&tag));
        of_frame.or_else(|| self.shared.get(&tag)).or_else(|| self.values.get(&tag)).map(Vec::as_slice)
    }

    /// Returns the bytes of a value of the whole file.
    pub(super) fn value(&self, tag: u32) -> Option<&[u8]> {
        self.values.get(&tag).map(Vec::as_slice)
    }

    pub(super) fn text(&self, tag: u32) -> String {
        trimmed(self.value(tag).unwrap_or_default())
    }

    /// Returns a binary number of 16 bits.
    pub(super) fn u16(&self, tag: u32) -> Option<u16> {
        self.words(tag)?.next()
    }

    /// Returns the binary numbers of 16 bits of a value.
    pub(super) fn words(&self, tag: u32) -> Option<impl Iterator<Item = u16>> {
        Some(self.words_of(self.value(tag)?))
    }

    /// Returns the binary numbers of 16 bits in the bytes of a value.
    pub(super) fn words_of(&self, bytes: &[u8]) -> impl Iterator<Item = u16> {
        bytes.chunks_exact(2).map(|bytes| self.endian.number(bytes) as u16)
    }

    /// Returns a binary number of 16 bits, of the frame if it has a value of its own.
    pub(super) fn frame_u16(&self, frame: usize, tag: u32) -> Option<u16> {
        self.words_of(self.bytes(frame, tag)?).next()
    }

    /// Returns a binary whole number of 32 bits, of the frame if it has a value of its own.
    pub(super) fn u32(&self, frame: usize, tag: u32) -> Option<u32> {
        self.bytes(frame, tag)?.get(..4).map(|bytes| self.endian.number(bytes) as u32)
    }

    /// Returns a binary number of 64-bit floating point, of the frame if it has a value of its own; `None` if it is not
    /// finite.
    pub(super) fn f64(&self, frame: usize, tag: u32) -> Option<f64> {
        let bytes = self.bytes(frame, tag)?.get(..8)?;
        Some(f64::from_bits(self.endian.number(bytes))).filter(|number| number.is_finite())
    }

    /// Returns `N` decimal numbers separated by backslashes; `None` if there are not `N`, or one is not finite.
    pub(super) fn numbers<const N: usize>(&self, frame: usize, tag: u32) -> Option<[f64; N]> {
        decimals(self.bytes(frame, tag)?)?.try_into().ok()
    }

    /// Returns any number of decimal numbers, of the whole file, read as by [`Self::numbers`].
    pub(super) fn list(&self, tag: u32) -> Option<Vec<f64>> {
        decimals(self.value(tag)?)
    }
}

/// Returns a text without the padding that makes its length even; in Latin-1 if it is not in UTF-8.
pub(super) fn trimmed(bytes: &[u8]) -> String {
    let latin = || bytes.iter().copied().map(char::from).collect();
    let text = str::from_utf8(bytes).map_or_else(|_| latin(), str::to_owned);
    text.trim_matches(['\0', ' ']).to_owned()
}

/// Reads decimal numbers separated by backslashes; `None` if one is not finite.
pub(super) fn decimals(bytes: &[u8]) -> Option<Vec<f64>> {
    let number = |word: &[u8]| trimmed(word).parse::<f64>().ok().filter(|n| n.is_finite());
    bytes.split(|byte| *byte == b'\\').map(number).collect()
}

/// The part of a file to which an element belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Top,
    Shared,
    PerFrame,
    Segment,
    /// An item that describes the whole file.
    OfFile,
    /// A sequence whose values are not needed.
    Elsewhere,
}

/// The mark behind the preamble.
const MARK: &[u8] = b"DICM";

/// The marks of an item, of its end, and of the end of a sequence.
const ITEM: u32 = 0xfffe_e000;
const ITEM_END: u32 = 0xfffe_e00d;
const SEQUENCE_END: u32 = 0xfffe_e0dd;

/// The tags of the pixels: whole numbers, and floating point of 32 and 64 bits.
const PIXELS: u32 = 0x7fe0_0010;
const FLOATS: u32 = 0x7fe0_0008;
const DOUBLES: u32 = 0x7fe0_0009;

/// A reader of elements one after the other. Places are counted in bytes from the end of the file, or of a compressed
/// one from the farthest that it can have.
struct ElementReader {
    input: Input,
    /// The length of the file in bytes.
    length: u64,
    /// Whether elements have types.
    explicit: bool,
    /// Whether an element has shown whether elements have types.
    is_sure: bool,
    /// The group of the next element, if it has been read.
    group: Option<[u8; 2]>,
    set: Dataset,
}

impl ElementReader {
    fn run(&mut self) -> Result<()> {
        // The preamble and the mark behind it may be missing.
        let head = self.input.peek(132)?;
        let start = if head.starts_with(MARK) { MARK.len() } else { 132 };
        if head.get(start - MARK.len()..start) == Some(MARK) {
            self.skip(start as u64)?;
        }
        // The first group is always little-endian with explicit types.
        let (mut syntax, mut end) = (Values::new(), 0);
        // Behind its end may be anything, if it is deflated.
        let is_deflated = |syntax: &Values| syntax.get(&0x10).is_some_and(|uid| trimmed(uid) == DEFLATED);
        while !(self.is_at_end()? || self.left() <= end && is_deflated(&syntax)) {
            let group = self.array()?;
            if group != [2, 0] {
                self.group = Some(group);
                break;
            }
            let element = self.u16()?;
            let (_, length) = self.rest_of_header(2)?;
            let too_long = u64::from(length) > MAX_VALUE;
            refuse_if!(too_long, self.input, "is damaged: a value of {length} bytes, expected at most {MAX_VALUE}");
            let value = self.input.bytes(length as usize)?;
            if let (0, Some(length)) = (element, value.get(..4)) {
                end = self.left().saturating_sub(Endian::Little.number(length));
            }
            syntax.insert(element.into(), value);
        }
        self.set.syntax = trimmed(&syntax.remove(&0x10).unwrap_or_default());
        self.explicit = self.set.syntax != "1.2.840.10008.1.2";
        let is_bare = self.set.syntax.is_empty();
        if self.set.syntax == "1.2.840.10008.1.2.2" || is_bare && self.group == Some([0, 8]) {
            self.set.endian = Endian::Big;
        }
        if self.set.syntax == DEFLATED {
            self.input.decompress(MAX_EXPANSION, |packed| buffered(DeflateDecoder::new(packed)));
            self.input.limit(MAX_UNPACKED);
        }
        self.elements(0, Place::Top, 0)
    }

    /// Returns the bytes that the pixels of all frames need, uncompressed.
    fn needed(&self) -> u64 {
        let number = |tag: u32| u64::from(self.set.u16(tag).unwrap_or(1));
        let frames = self.set.numbers(0, super::FRAMES).map_or(1, |[frames]| frames as u64);
        let bits = [super::ROWS, super::COLUMNS, super::CHANNELS, super::BITS_ALLOCATED].map(number);
        bits.into_iter().fold(frames, u64::saturating_mul).div_ceil(8)
    }

    /// Keeps the pixels of a compressed file: no more than the file states that they need.
    fn unpack(&mut self, length: u64) -> Result<u64> {
        let most = length.min(self.needed());
        let mut bytes = reserved(most, || samples_in(&self.set.path))?;
        self.input.append(most, &mut bytes)?;
        let found = bytes.len() as u64;
        self.set.unpacked = Some(bytes);
        Ok(found)
    }

    /// Finds the fragments that begin here, and keeps them if the file is compressed.
    fn fragments(&mut self) -> Result<()> {
        // Codecs may expand what cannot be compressed, and fragments have headers.
        let most = self.needed().saturating_mul(2).saturating_add(1 << 20);
        let (mut unpacked, mut is_table) = (Vec::new(), true);
        while self.left() >= 8
            && !self.is_at_end()?
            && let Some(length) = self.next_item("a fragment")?.map(u64::from)
        {
            if std::mem::take(&mut is_table) {
                let kept = length.min(4 * MAX_FRAMES as u64);
                self.set.frame_table = self.input.bytes(kept as usize)?;
                self.skip(length - kept)?;
                continue;
            }
            refuse_if!(self.set.fragments.len() == MAX_FRAGMENTS, self.input, "has too many fragments");
            if self.input.exactly_left().is_some() {
                self.set.fragments.push([self.place(), length]);
                self.skip(length)?;
                continue;
            }
            let at = unpacked.len() as u64;
            refuse_if!(length > most - at, self.input, "is damaged: its fragments are larger than its pixels");
            self.input.append(length, &mut unpacked)?;
            self.set.fragments.push([at, unpacked.len() as u64 - at]);
        }
        self.set.unpacked = self.input.exactly_left().is_none().then_some(unpacked);
        Ok(())
    }

    /// Reads elements up to `end`, or up to the mark that ends an item.
    fn elements(&mut self, end: u64, place: Place, depth: usize) -> Result<()> {
        refuse_if!(depth > MAX_DEPTH, self.input, "is damaged: sequences within sequences without end");
        while self.left() > end && self.set.pixels.is_none() {
            // Where a compressed file ends is known only there.
            if place == Place::Top && self.is_at_end()? {
                return Ok(());
            }
            let group = match self.group.take() {
                Some(bytes) => self.set.endian.number(&bytes) as u16,
                None => self.u16()?,
            };
            let tag = u32::from(group) << 16 | u32::from(self.u16()?);
            let (kind, length) = self.rest_of_header(group)?;
            match tag {
                ITEM_END | SEQUENCE_END => return Ok(()),
                PIXELS | FLOATS | DOUBLES if place == Place::Top => {
                    self.set.is_float = tag != PIXELS;
                    self.set.in_words = &kind == b"OW";
                    if length == UNDEFINED {
                        self.set.pixels = Some((self.place(), None));
                        return self.fragments();
                    }
                    let length = u64::from(length);
                    refuse_if!(length > self.left(), self.input, "{CUT_SHORT}");
                    self.set.pixels = match self.input.exactly_left() {
                        Some(_) => Some((self.place(), Some(length))),
                        None => Some((0, Some(self.unpack(length)?))),
                    };
                    return Ok(());
                }
                // Compressed pixels of an icon.
                _ if length == UNDEFINED && (tag == PIXELS || [b"OB", b"OW"].contains(&&kind)) => {
                    while let Some(length) = self.next_item("a fragment")? {
                        self.skip(length.into())?;
                    }
                }
                _ if &kind == b"SQ" || length == UNDEFINED || tag == SEGMENTS || SEQUENCES.contains(&tag) => {
                    let inside = match (place, tag) {
                        (Place::Top, SHARED) => Place::Shared,
                        (Place::Top, PER_FRAME) => Place::PerFrame,
                        (Place::Top, SEGMENTS) => Place::Segment,
                        (Place::Top, _) if OF_FILE.contains(&tag) => Place::OfFile,
                        (Place::Shared | Place::PerFrame, _) if SEQUENCES.contains(&tag) => place,
                        _ => Place::Elsewhere,
                    };
                    // An unknown value of undefined length has elements without types.
                    let explicit = self.explicit;
                    self.explicit &= &kind != b"UN";
                    self.items(length, inside, place == Place::Top, depth)?;
                    self.explicit = explicit;
                }
                _ if place != Place::Elsewhere && u64::from(length) <= longest(tag) => {
                    let value = self.input.bytes(length as usize)?;
                    let values = match place {
                        Place::Shared => Some(&mut self.set.shared),
                        Place::PerFrame => self.set.frames.last_mut(),
                        Place::Segment => self.set.segments.last_mut(),
                        _ => Some(&mut self.set.values),
                    };
                    // Of several items of a sequence the first counts.
                    values.map(|values| values.entry(tag).or_insert(value));
                }
                _ => self.skip(length.into())?,
            }
        }
        Ok(())
    }

    /// Reads the items of a sequence.
    fn items(&mut self, length: u32, place: Place, outermost: bool, depth: usize) -> Result<()> {
        let end = self.end_of(length);
        while self.left() > end
            && let Some(length) = self.next_item("an item")?
        {
            let (parts, most) = match place {
                Place::PerFrame => (Some(&mut self.set.frames), MAX_FRAMES),
                Place::Segment => (Some(&mut self.set.segments), MAX_SEGMENTS),
                _ => (None, 0),
            };
            if let Some(parts) = parts.filter(|_| outermost) {
                refuse_if!(parts.len() == most, self.input, "is damaged: over {most} frames or segments");
                parts.push(Values::new());
            }
            self.elements(self.end_of(length), place, depth + 1)?;
        }
        Ok(())
    }

    /// Returns the length of the item or the fragment that begins here; `None` at the end of the sequence.
    fn next_item(&mut self, what: &str) -> Result<Option<u32>> {
        let (group, element, length) = (self.u16()?, self.u16()?, self.u32()?);
        match u32::from(group) << 16 | u32::from(element) {
            ITEM => Ok(Some(length)),
            SEQUENCE_END => Ok(None),
            _ => refuse!(self.input, "is damaged: ({group:04x},{element:04x}) where {what} should begin"),
        }
    }

    /// Returns the type and the length of an element whose tag has been read.
    fn rest_of_header(&mut self, group: u16) -> Result<([u8; 2], u32)> {
        if group == 0xfffe {
            return Ok(([0; 2], self.u32()?));
        }
        let four: [u8; 4] = self.array()?;
        let [a, b, ..] = four;
        let kind = [a, b];
        let is_type = kind.iter().all(u8::is_ascii_uppercase);
        // Some files have types where their transfer syntax has none, and the reverse: the first element shows it.
        if group > 2 && !self.is_sure {
            (self.explicit, self.is_sure) = (is_type, true);
        }
        if !self.explicit && group != 2 {
            return Ok(([0; 2], self.set.endian.number(&four) as u32));
        }
        let name = String::from_utf8_lossy(&kind);
        refuse_if!(!is_type, self.input, "is damaged: an element of the type {name:?}");
        let long = [b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV"];
        Ok((kind, if long.contains(&&kind) { self.u32()? } else { self.set.endian.number(&four[2..]) as u32 }))
    }

    /// Returns the bytes to the end of the file.
    fn left(&self) -> u64 {
        self.input.at_most().unwrap_or(0)
    }

    /// Returns the offset in the file.
    fn place(&self) -> u64 {
        self.length.saturating_sub(self.left())
    }

    /// Returns the end of an element or item of this length that begins here.
    fn end_of(&self, length: u32) -> u64 {
        if length == UNDEFINED { 0 } else { self.left().saturating_sub(length.into()) }
    }

    /// Returns whether no bytes are left.
    fn is_at_end(&mut self) -> Result<bool> {
        Ok(self.group.is_none() && self.input.is_at_end()?)
    }

    fn skip(&mut self, n: u64) -> Result<()> {
        refuse_if!(!self.input.skipped(n)?, self.input, "{CUT_SHORT}");
        Ok(())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        refuse_if!(self.input.fill(&mut bytes)? < N, self.input, "{CUT_SHORT}");
        Ok(bytes)
    }

    fn u16(&mut self) -> Result<u16> {
        let bytes: [u8; 2] = self.array()?;
        Ok(self.set.endian.number(&bytes) as u16)
    }

    fn u32(&mut self) -> Result<u32> {
        let bytes: [u8; 4] = self.array()?;
        Ok(self.set.endian.number(&bytes) as u32)
    }
}

/// The error about a file that ends within an element.
const CUT_SHORT: &str = "is cut short: an element ends behind the end of the file";
