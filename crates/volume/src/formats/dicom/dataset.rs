//! The elements of a DICOM file that a volume needs (PS3.5 and PS3.10).
//!
//! The crate `dicom-object` is not used: it reads every element into memory, as long as the file says it is, and brings
//! dictionaries of thousands of tags.
//!
//! Files in gzip and deflated elements are read as a stream. Their pixels alone are kept, once their size is known.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek};
use std::path::{Path, PathBuf};

use flate2::bufread::DeflateDecoder;

use crate::error::{Error, Result};
use crate::formats::input::{Input, MAX_EXPANSION};
use crate::memory::{reserved, samples_in};
use crate::volume::Endian;

/// The longest value that is kept, in bytes: a list of six numbers has under 100.
const MAX_VALUE: u64 = 4096;

/// The longest value of [`LONG`], in bytes.
const MAX_LONG: u64 = 1 << 20;

/// The values that may be longer than others: the tables of palettes, whole and in segments, and the offsets of frames.
const LONG: [u32; 7] =
    [0x0028_1201, 0x0028_1202, 0x0028_1203, 0x0028_1221, 0x0028_1222, 0x0028_1223, super::FRAME_OFFSETS];

/// The most that a compressed file is read for, in bytes: pixels have under 4 GiB.
const MAX_UNPACKED: u64 = 5 << 30;

/// The deepest sequence within sequences: real ones have under 10.
const MAX_DEPTH: usize = 32;

/// The most frames of a file.
const MAX_FRAMES: usize = crate::volume::MAX_DIM as usize;

/// The transfer syntax whose elements are deflated.
const DEFLATED: &str = "1.2.840.10008.1.2.1.99";

/// The length of what ends at its own mark.
const UNDEFINED: u32 = u32::MAX;

/// The sequences that have what is needed, in files without types too: of all frames, of each frame, and inside them
/// positions, orientations, spacings, maps to values, indices of time and delays of triggers. Sequences of makers may
/// have values of the same names that mean something else.
const SEQUENCES: [u32; 8] =
    [0x5200_9229, 0x5200_9230, 0x0020_9113, 0x0020_9116, 0x0028_9110, 0x0028_9145, 0x0020_9111, 0x0018_9118];

/// The longest value of a tag that is kept, in bytes.
fn longest(tag: u32) -> u64 {
    if LONG.contains(&tag) { MAX_LONG } else { MAX_VALUE }
}

/// Values by tag: group and element in one number.
type Values = HashMap<u32, Vec<u8>>;

/// What a file says, without its pixels.
pub(super) struct Dataset {
    pub(super) path: PathBuf,
    /// The UID of the transfer syntax.
    pub(super) syntax: String,
    pub(super) endian: Endian,
    values: Values,
    /// Of all frames.
    shared: Values,
    frames: Vec<Values>,
    /// Whether the pixels stand in words of 16 bits, whatever their size.
    pub(super) in_words: bool,
    /// The offset of the pixels in what [`Self::open`] returns, and their length unless they are in fragments.
    pub(super) pixels: Option<(u64, Option<u64>)>,
    /// The pixels of a compressed file.
    unpacked: Option<Vec<u8>>,
}

/// Bytes to read at any place.
pub(super) trait Bytes: Read + Seek {}

impl<T: Read + Seek> Bytes for T {}

impl Dataset {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let input = Input::open_data(path)?.unpacked_if_marked()?;
        let mut length = input.at_most().unwrap_or(u64::MAX);
        let stream = match input.plain_file()? {
            Some((file, _)) => {
                let mut file = BufReader::new(file);
                file.rewind().map_err(|source| Error::Read { path: path.to_owned(), source })?;
                Stream::File(file)
            }
            None => {
                length = length.min(MAX_UNPACKED);
                Stream::Packed(input.into_reader())
            }
        };
        let set = Self {
            path: path.to_owned(),
            syntax: String::new(),
            endian: Endian::Little,
            values: Values::new(),
            shared: Values::new(),
            frames: Vec::new(),
            in_words: false,
            pixels: None,
            unpacked: None,
        };
        let failed = |source: io::Error| match source.kind() {
            io::ErrorKind::UnexpectedEof => {
                Error::format(path, "is cut short: an element ends behind the end of the file")
            }
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => {
                Error::format(path, format!("is damaged: {source}"))
            }
            _ => Error::Read { path: path.to_owned(), source },
        };
        let mut reader = Reader { stream, at: 0, length, explicit: true, is_sure: false, group: None, set };
        reader.run().map_err(failed)?;
        reader.unpack().map_err(failed)??;
        Ok(reader.set)
    }

    /// Opens what has the pixels: the file, or the pixels of a compressed one.
    pub(super) fn open(&self) -> io::Result<Box<dyn Bytes + '_>> {
        Ok(match &self.unpacked {
            Some(bytes) => Box::new(Cursor::new(bytes.as_slice())),
            None => Box::new(File::open(&self.path)?),
        })
    }

    /// The bytes of a value, of a frame if it has one of its own.
    fn bytes(&self, frame: usize, tag: u32) -> Option<&[u8]> {
        let of_frame = self.frames.get(frame).and_then(|values| values.get(&tag));
        of_frame.or_else(|| self.shared.get(&tag)).or_else(|| self.values.get(&tag)).map(Vec::as_slice)
    }

    /// The bytes of a value of the whole file.
    pub(super) fn value(&self, tag: u32) -> Option<&[u8]> {
        self.values.get(&tag).map(Vec::as_slice)
    }

    pub(super) fn text(&self, tag: u32) -> String {
        let bytes = self.value(tag).unwrap_or_default();
        String::from_utf8_lossy(bytes).trim_matches(['\0', ' ']).to_owned()
    }

    /// A binary number of 16 bits.
    pub(super) fn u16(&self, tag: u32) -> Option<u16> {
        self.words(tag)?.next()
    }

    /// Binary numbers of 16 bits.
    pub(super) fn words(&self, tag: u32) -> Option<impl Iterator<Item = u16>> {
        let word = |bytes: &[u8; 2]| {
            if self.endian == Endian::Big { u16::from_be_bytes(*bytes) } else { u16::from_le_bytes(*bytes) }
        };
        Some(self.value(tag)?.as_chunks::<2>().0.iter().map(word))
    }

    /// A binary whole number of 32 bits, of a frame if it has one of its own.
    pub(super) fn u32(&self, frame: usize, tag: u32) -> Option<u32> {
        let bytes = self.bytes(frame, tag)?.first_chunk::<4>()?;
        Some(if self.endian == Endian::Big { u32::from_be_bytes(*bytes) } else { u32::from_le_bytes(*bytes) })
    }

    /// A binary number of 64-bit floating point, of a frame if it has one of its own; `None` if it is not finite.
    pub(super) fn f64(&self, frame: usize, tag: u32) -> Option<f64> {
        let bytes = self.bytes(frame, tag)?.first_chunk::<8>()?;
        let number = if self.endian == Endian::Big { f64::from_be_bytes(*bytes) } else { f64::from_le_bytes(*bytes) };
        number.is_finite().then_some(number)
    }

    /// Decimal numbers separated by backslashes; `None` if there are not `N`, or one is not finite.
    pub(super) fn numbers<const N: usize>(&self, frame: usize, tag: u32) -> Option<[f64; N]> {
        decimals(self.bytes(frame, tag)?)?.try_into().ok()
    }

    /// As [`Self::numbers`], of the whole file and of any number.
    pub(super) fn list(&self, tag: u32) -> Option<Vec<f64>> {
        decimals(self.value(tag)?)
    }
}

/// Decimal numbers separated by backslashes; `None` if one is not finite.
fn decimals(bytes: &[u8]) -> Option<Vec<f64>> {
    let number = |word: &str| word.trim_matches(['\0', ' ']).parse::<f64>().ok().filter(|n| n.is_finite());
    String::from_utf8_lossy(bytes).split('\\').map(number).collect()
}

/// Where an element is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Top,
    Shared,
    PerFrame,
    /// Where nothing is needed.
    Elsewhere,
}

/// The bytes of a file from its beginning.
enum Stream {
    File(BufReader<File>),
    Packed(Box<dyn BufRead>),
}

impl Stream {
    fn reader(&mut self) -> &mut dyn BufRead {
        match self {
            Self::File(file) => file,
            Self::Packed(reader) => reader,
        }
    }
}

struct Reader {
    stream: Stream,
    at: u64,
    /// The length of the file; of a compressed one, the most that it can have.
    length: u64,
    /// Whether elements have types.
    explicit: bool,
    /// Whether an element has shown that.
    is_sure: bool,
    /// The group of the next element, if it has been read.
    group: Option<[u8; 2]>,
    set: Dataset,
}

fn damaged(what: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what.into())
}

impl Reader {
    fn run(&mut self) -> io::Result<()> {
        self.skip(132)?;
        // The first group is always little-endian with explicit types.
        let (mut syntax, mut end) = (Values::new(), u64::MAX);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim_matches(['\0', ' ']).to_owned();
        // Behind its end may be anything, if it is deflated.
        while !(self.at_end()? || self.at >= end && syntax.get(&0x10).is_some_and(|uid| text(uid) == DEFLATED)) {
            let mut group = [0; 2];
            self.fill(&mut group)?;
            if group != [2, 0] {
                self.group = Some(group);
                break;
            }
            let element = self.u16()?;
            let (_, length) = self.rest_of_header(2)?;
            let value = self.value(length.into(), MAX_VALUE)?;
            if let (0, Some(length)) = (element, value.first_chunk::<4>()) {
                end = self.at.saturating_add(u32::from_le_bytes(*length).into());
            }
            syntax.insert(element.into(), value);
        }
        self.set.syntax = text(&syntax.remove(&0x10).unwrap_or_default());
        self.explicit = self.set.syntax != "1.2.840.10008.1.2";
        if self.set.syntax == "1.2.840.10008.1.2.2" {
            self.set.endian = Endian::Big;
        }
        if self.set.syntax == DEFLATED {
            self.inflate();
        }
        self.elements(self.length, Place::Top, 0)
    }

    /// Decompresses what follows.
    fn inflate(&mut self) {
        let nothing = Stream::Packed(Box::new(io::empty()));
        let reader: Box<dyn BufRead> = match std::mem::replace(&mut self.stream, nothing) {
            Stream::File(file) => Box::new(file),
            Stream::Packed(reader) => reader,
        };
        self.stream = Stream::Packed(Box::new(BufReader::with_capacity(1 << 16, DeflateDecoder::new(reader))));
        let left = self.length.saturating_sub(self.at).saturating_mul(MAX_EXPANSION);
        self.length = self.at.saturating_add(left).min(MAX_UNPACKED);
    }

    /// Keeps the pixels of a compressed file: no more than the file says that they need.
    fn unpack(&mut self) -> io::Result<Result<()>> {
        let (Stream::Packed(_), Some((_, known))) = (&self.stream, self.set.pixels) else { return Ok(Ok(())) };
        let set = &self.set;
        let number = |tag: u32| u64::from(set.u16(tag).unwrap_or(1));
        let frames = set.numbers(0, super::FRAMES).map_or(1, |[frames]| frames as u64);
        let bits = [super::ROWS, super::COLUMNS, super::CHANNELS, super::BITS_ALLOCATED].map(number);
        let needed = bits.into_iter().fold(frames, u64::saturating_mul).div_ceil(8);
        // Codecs may expand what cannot be compressed, and fragments have headers.
        let most = known.unwrap_or(u64::MAX).min(match known {
            Some(_) => needed,
            None => needed.saturating_mul(2).saturating_add(1 << 20),
        });
        // What is needed is reserved at once. Fragments are mostly far smaller than that.
        let mut bytes = match reserved(if known.is_some() { most } else { 0 }, || samples_in(&set.path)) {
            Ok(bytes) => bytes,
            Err(error) => return Ok(Err(error)),
        };
        match self.stream.reader().take(most).read_to_end(&mut bytes) {
            Ok(_) => {}
            // What is missing is reported by its number.
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {}
            Err(error) => return Err(error),
        }
        self.set.pixels = Some((0, known.map(|_| bytes.len() as u64)));
        self.set.unpacked = Some(bytes);
        Ok(Ok(()))
    }

    /// Whether there are no more bytes.
    fn at_end(&mut self) -> io::Result<bool> {
        Ok(self.group.is_none() && self.stream.reader().fill_buf()?.is_empty())
    }

    /// Reads elements up to `end`, or up to the mark that ends an item.
    fn elements(&mut self, end: u64, place: Place, depth: usize) -> io::Result<()> {
        if depth > MAX_DEPTH {
            return Err(damaged("sequences within sequences without end"));
        }
        while self.at < end && self.set.pixels.is_none() {
            // Where a compressed file ends is known only there.
            if place == Place::Top && self.at_end()? {
                return Ok(());
            }
            let group = match self.group.take() {
                Some(bytes) => self.number(bytes),
                None => self.u16()?,
            };
            let element = self.u16()?;
            let tag = u32::from(group) << 16 | u32::from(element);
            let (kind, length) = self.rest_of_header(group)?;
            match tag {
                0xfffe_e00d | 0xfffe_e0dd => return Ok(()),
                0x7fe0_0010 if place == Place::Top => {
                    let known = (length != UNDEFINED).then_some(u64::from(length));
                    if known.is_some_and(|n| n > self.length - self.at) {
                        return Err(io::ErrorKind::UnexpectedEof.into());
                    }
                    self.set.in_words = &kind == b"OW";
                    self.set.pixels = Some((self.at, known));
                    return Ok(());
                }
                // Compressed pixels of an icon.
                _ if length == UNDEFINED && (tag == 0x7fe0_0010 || [b"OB", b"OW"].contains(&&kind)) => {
                    self.skip_fragments()?;
                }
                _ if &kind == b"SQ" || length == UNDEFINED || SEQUENCES.contains(&tag) => {
                    let inside = match (place, tag) {
                        (Place::Top, 0x5200_9229) => Place::Shared,
                        (Place::Top, 0x5200_9230) => Place::PerFrame,
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
                    let value = self.value(length.into(), longest(tag))?;
                    let values = match place {
                        Place::Shared => &mut self.set.shared,
                        Place::PerFrame => match self.set.frames.last_mut() {
                            Some(frame) => frame,
                            None => continue,
                        },
                        _ => &mut self.set.values,
                    };
                    values.insert(tag, value);
                }
                _ => self.skip(length.into())?,
            }
        }
        Ok(())
    }

    /// Reads the items of a sequence.
    fn items(&mut self, length: u32, place: Place, outermost: bool, depth: usize) -> io::Result<()> {
        let end = if length == UNDEFINED { self.length } else { self.at.saturating_add(length.into()) };
        while self.at < end {
            let (group, element) = (self.u16()?, self.u16()?);
            let length = self.u32()?;
            match (group, element) {
                (0xfffe, 0xe000) => {
                    if place == Place::PerFrame && outermost {
                        if self.set.frames.len() == MAX_FRAMES {
                            return Err(damaged(format!("over {MAX_FRAMES} frames")));
                        }
                        self.set.frames.push(Values::new());
                    }
                    let end = if length == UNDEFINED { self.length } else { self.at.saturating_add(length.into()) };
                    self.elements(end, place, depth + 1)?;
                }
                (0xfffe, 0xe0dd) => return Ok(()),
                _ => return Err(damaged(format!("({group:04x},{element:04x}) where an item should begin"))),
            }
        }
        Ok(())
    }

    /// Skips fragments up to the mark that ends them.
    fn skip_fragments(&mut self) -> io::Result<()> {
        loop {
            let (group, element) = (self.u16()?, self.u16()?);
            let length = self.u32()?;
            match (group, element) {
                (0xfffe, 0xe000) => self.skip(length.into())?,
                (0xfffe, 0xe0dd) => return Ok(()),
                _ => return Err(damaged(format!("({group:04x},{element:04x}) where a fragment should begin"))),
            }
        }
    }

    /// The type and the length of an element whose tag has been read.
    fn rest_of_header(&mut self, group: u16) -> io::Result<([u8; 2], u32)> {
        if group == 0xfffe {
            return Ok(([0; 2], self.u32()?));
        }
        let mut four = [0; 4];
        self.fill(&mut four)?;
        let [a, b, ..] = four;
        let kind = [a, b];
        let is_type = kind.iter().all(u8::is_ascii_uppercase);
        // Some files have types where their transfer syntax has none, and the reverse: the first element shows it.
        if group > 2 && !self.is_sure {
            (self.explicit, self.is_sure) = (is_type, true);
        }
        if !self.explicit && group != 2 {
            let big = self.set.endian == Endian::Big;
            return Ok(([0; 2], if big { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) }));
        }
        let long = [b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV"];
        if !is_type {
            return Err(damaged(format!("an element of the type {:?}", String::from_utf8_lossy(&kind))));
        }
        let [.., c, d] = four;
        Ok((kind, if long.contains(&&kind) { self.u32()? } else { self.number([c, d]).into() }))
    }

    fn value(&mut self, length: u64, most: u64) -> io::Result<Vec<u8>> {
        if length > most {
            return Err(damaged(format!("a value of {length} bytes, expected at most {most}")));
        }
        let mut value = vec![0; length as usize];
        self.fill(&mut value)?;
        Ok(value)
    }

    fn fill(&mut self, bytes: &mut [u8]) -> io::Result<()> {
        self.stream.reader().read_exact(bytes)?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    fn skip(&mut self, n: u64) -> io::Result<()> {
        let to = self.at.checked_add(n).filter(|to| *to <= self.length).ok_or(io::ErrorKind::UnexpectedEof)?;
        match &mut self.stream {
            Stream::File(file) => file.seek_relative(n.cast_signed())?,
            Stream::Packed(reader) => {
                if io::copy(&mut reader.take(n), &mut io::sink())? < n {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
            }
        }
        self.at = to;
        Ok(())
    }

    fn u16(&mut self) -> io::Result<u16> {
        let mut bytes = [0; 2];
        self.fill(&mut bytes)?;
        Ok(self.number(bytes))
    }

    fn number(&self, bytes: [u8; 2]) -> u16 {
        if self.set.endian == Endian::Big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
    }

    fn u32(&mut self) -> io::Result<u32> {
        let mut bytes = [0; 4];
        self.fill(&mut bytes)?;
        Ok(if self.set.endian == Endian::Big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }
}
