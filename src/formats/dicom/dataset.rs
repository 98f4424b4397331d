//! The elements of a DICOM file that a volume needs (PS3.5 and PS3.10).
//!
//! The crate `dicom-object` is not used: it reads every element into memory, as long as the file says it is, and brings
//! dictionaries of thousands of tags.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::formats::input::Input;
use crate::volume::Endian;

/// The longest value that is kept, in bytes: a list of six numbers has under 100.
const MAX_VALUE: u64 = 4096;

/// The deepest sequence within sequences: real ones have under 10.
const MAX_DEPTH: usize = 32;

/// The most frames of a file.
const MAX_FRAMES: usize = crate::volume::MAX_DIM as usize;

/// The length of what ends at its own mark.
const UNDEFINED: u32 = u32::MAX;

/// The sequences that have what is needed, in files without types too: of all frames, of each frame, and inside them
/// positions, orientations, spacings, maps to values, indices of time and delays of triggers.
const SEQUENCES: [u32; 8] =
    [0x5200_9229, 0x5200_9230, 0x0020_9113, 0x0020_9116, 0x0028_9110, 0x0028_9145, 0x0020_9111, 0x0018_9118];

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
    /// The offset of the pixels, and their length unless they are in fragments.
    pub(super) pixels: Option<(u64, Option<u64>)>,
}

impl Dataset {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let Some((file, _)) = Input::open_data(path)?.plain_file()? else {
            return Err(Error::format(path, "is not a regular file"));
        };
        let set = Self {
            path: path.to_owned(),
            syntax: String::new(),
            endian: Endian::Little,
            values: Values::new(),
            shared: Values::new(),
            frames: Vec::new(),
            pixels: None,
        };
        let failed = |source: io::Error| match source.kind() {
            io::ErrorKind::UnexpectedEof => {
                Error::format(path, "is cut short: an element ends behind the end of the file")
            }
            io::ErrorKind::InvalidData => Error::format(path, format!("is damaged: {source}")),
            _ => Error::Read { path: path.to_owned(), source },
        };
        let length = file.metadata().map_err(failed)?.len();
        let mut reader = Reader { file: BufReader::new(file), at: 0, length, explicit: true, set };
        reader.file.rewind().map_err(failed)?;
        reader.run().map_err(failed)?;
        Ok(reader.set)
    }

    /// The bytes of a value, of a frame if it has one of its own.
    fn bytes(&self, frame: usize, tag: u32) -> Option<&[u8]> {
        let of_frame = self.frames.get(frame).and_then(|values| values.get(&tag));
        of_frame.or_else(|| self.shared.get(&tag)).or_else(|| self.values.get(&tag)).map(Vec::as_slice)
    }

    pub(super) fn text(&self, tag: u32) -> String {
        let bytes = self.values.get(&tag).map(Vec::as_slice).unwrap_or_default();
        String::from_utf8_lossy(bytes).trim_matches(['\0', ' ']).to_owned()
    }

    /// A binary number of 16 bits.
    pub(super) fn u16(&self, tag: u32) -> Option<u16> {
        let bytes = self.values.get(&tag)?.first_chunk::<2>()?;
        Some(if self.endian == Endian::Big { u16::from_be_bytes(*bytes) } else { u16::from_le_bytes(*bytes) })
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
        let text = String::from_utf8_lossy(self.bytes(frame, tag)?);
        let number = |word: &str| word.trim_matches(['\0', ' ']).parse::<f64>().ok().filter(|n| n.is_finite());
        text.split('\\').map(number).collect::<Option<Vec<f64>>>()?.try_into().ok()
    }
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

struct Reader {
    file: BufReader<File>,
    at: u64,
    length: u64,
    explicit: bool,
    set: Dataset,
}

fn damaged(what: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what.into())
}

impl Reader {
    fn run(&mut self) -> io::Result<()> {
        self.skip(132)?;
        // The first group is always little-endian with explicit types.
        let mut syntax = Values::new();
        while self.at < self.length {
            let start = self.at;
            if self.u16()? != 2 {
                self.file.seek(SeekFrom::Start(start))?;
                self.at = start;
                break;
            }
            let element = self.u16()?;
            let (_, length) = self.rest_of_header(2)?;
            let value = self.value(length.into())?;
            syntax.insert(element.into(), value);
        }
        let uid = syntax.get(&0x10).cloned().unwrap_or_default();
        self.set.syntax = String::from_utf8_lossy(&uid).trim_matches(['\0', ' ']).to_owned();
        self.explicit = self.set.syntax != "1.2.840.10008.1.2";
        if self.set.syntax == "1.2.840.10008.1.2.2" {
            self.set.endian = Endian::Big;
        }
        if self.set.syntax == "1.2.840.10008.1.2.1.99" {
            return Err(damaged("its elements are deflated, which is not read: convert it to explicit little-endian"));
        }
        self.elements(self.length, Place::Top, 0)
    }

    /// Reads elements up to `end`, or up to the mark that ends an item.
    fn elements(&mut self, end: u64, place: Place, depth: usize) -> io::Result<()> {
        if depth > MAX_DEPTH {
            return Err(damaged("sequences within sequences without end"));
        }
        while self.at < end && self.set.pixels.is_none() {
            let (group, element) = (self.u16()?, self.u16()?);
            let tag = u32::from(group) << 16 | u32::from(element);
            let (kind, length) = self.rest_of_header(group)?;
            match tag {
                0xfffe_e00d | 0xfffe_e0dd => return Ok(()),
                0x7fe0_0010 if place == Place::Top => {
                    let known = (length != UNDEFINED).then_some(u64::from(length));
                    if known.is_some_and(|n| n > self.length - self.at) {
                        return Err(io::ErrorKind::UnexpectedEof.into());
                    }
                    self.set.pixels = Some((self.at, known));
                    return Ok(());
                }
                _ if &kind == b"SQ" || length == UNDEFINED || SEQUENCES.contains(&tag) => {
                    let inside = match (place, tag) {
                        (Place::Top, 0x5200_9229) => Place::Shared,
                        (Place::Top, 0x5200_9230) => Place::PerFrame,
                        (Place::Shared | Place::PerFrame, _) => place,
                        _ => Place::Elsewhere,
                    };
                    // An unknown value of undefined length has elements without types.
                    let explicit = self.explicit;
                    self.explicit &= &kind != b"UN";
                    self.items(length, inside, place == Place::Top, depth)?;
                    self.explicit = explicit;
                }
                _ if place != Place::Elsewhere && u64::from(length) <= MAX_VALUE => {
                    let value = self.value(length.into())?;
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

    /// The type and the length of an element whose tag has been read.
    fn rest_of_header(&mut self, group: u16) -> io::Result<([u8; 2], u32)> {
        if group == 0xfffe || (!self.explicit && group != 2) {
            return Ok(([0; 2], self.u32()?));
        }
        let mut kind = [0; 2];
        self.fill(&mut kind)?;
        let long = [b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV"];
        if !kind.iter().all(u8::is_ascii_uppercase) {
            return Err(damaged(format!("an element of the type {:?}", String::from_utf8_lossy(&kind))));
        }
        Ok(if long.contains(&&kind) {
            self.u16()?;
            (kind, self.u32()?)
        } else {
            (kind, self.u16()?.into())
        })
    }

    fn value(&mut self, length: u64) -> io::Result<Vec<u8>> {
        if length > MAX_VALUE {
            return Err(damaged(format!("a value of {length} bytes, expected at most {MAX_VALUE}")));
        }
        let mut value = vec![0; length as usize];
        self.fill(&mut value)?;
        Ok(value)
    }

    fn fill(&mut self, bytes: &mut [u8]) -> io::Result<()> {
        self.file.read_exact(bytes)?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    fn skip(&mut self, n: u64) -> io::Result<()> {
        let to = self.at.checked_add(n).filter(|to| *to <= self.length).ok_or(io::ErrorKind::UnexpectedEof)?;
        self.file.seek_relative(n.cast_signed())?;
        self.at = to;
        Ok(())
    }

    fn u16(&mut self) -> io::Result<u16> {
        let mut bytes = [0; 2];
        self.fill(&mut bytes)?;
        Ok(if self.set.endian == Endian::Big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    fn u32(&mut self) -> io::Result<u32> {
        let mut bytes = [0; 4];
        self.fill(&mut bytes)?;
        Ok(if self.set.endian == Endian::Big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }
}
