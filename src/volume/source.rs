//! Bytes of a file to typed samples: what every reader shares.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use flate2::read::{MultiGzDecoder, ZlibDecoder};

use super::Samples;
use crate::error::{Error, Result};

/// The type of stored samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "each variant is named for the type")]
pub enum SampleType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl SampleType {
    /// Bytes of one sample.
    #[must_use]
    pub fn bytes(self) -> u64 {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

impl FromStr for SampleType {
    type Err = Error;

    /// u8 ... f64, and the names of C, NumPy and NRRD for them (uchar, uint8, short, int16, float, float32, ...).
    fn from_str(text: &str) -> Result<Self, Error> {
        // Blanks and underscores vary between "unsigned char", "unsigned_char" and "uint8_t".
        let plain: String = text.to_lowercase().chars().filter(|c| !c.is_whitespace() && *c != '_').collect();
        Ok(match plain.as_str() {
            "u8" | "uint8" | "uint8t" | "uchar" | "unsignedchar" | "byte" => Self::U8,
            "i8" | "int8" | "int8t" | "schar" | "signedchar" | "char" => Self::I8,
            "u16" | "uint16" | "uint16t" | "ushort" | "unsignedshort" | "unsignedshortint" => Self::U16,
            "i16" | "int16" | "int16t" | "short" | "shortint" | "signedshort" | "signedshortint" => Self::I16,
            "u32" | "uint32" | "uint32t" | "uint" | "unsignedint" => Self::U32,
            "i32" | "int32" | "int32t" | "int" | "signedint" => Self::I32,
            "u64" | "uint64" | "uint64t" | "ulonglong" | "unsignedlonglong" | "unsignedlonglongint" => Self::U64,
            "i64" | "int64" | "int64t" | "longlong" | "longlongint" | "signedlonglong" | "signedlonglongint" => {
                Self::I64
            }
            "f32" | "float32" | "float" => Self::F32,
            "f64" | "float64" | "double" => Self::F64,
            _ => {
                return Err(Error::Setting {
                    name: "type",
                    reason: format!("{text:?}, expected u8, i8, u16, i16, u32, i32, u64, i64, f32 or f64"),
                });
            }
        })
    }
}

/// The order of the bytes of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[expect(missing_docs, reason = "each variant is named for the order")]
pub enum Endian {
    #[default]
    Little,
    Big,
}

impl Endian {
    fn is_foreign(self) -> bool {
        (self == Self::Big) != cfg!(target_endian = "big")
    }
}

impl FromStr for Endian {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text.to_lowercase().as_str() {
            "little" | "le" => Ok(Self::Little),
            "big" | "be" => Ok(Self::Big),
            _ => Err(Error::Setting { name: "endian", reason: format!("{text:?}, expected little or big") }),
        }
    }
}

/// How the samples are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    /// As they are.
    Raw,
    /// gzip, possibly of several members.
    Gzip,
    /// zlib (MetaImage).
    Zlib,
    /// Numbers in text, separated by blanks.
    Text,
}

/// Where samples lie and how they are stored.
#[derive(Debug, Clone)]
pub(super) struct Source {
    pub(super) path: PathBuf,
    /// Bytes of the file before the (packed) samples; `None`: they end with the file.
    pub(super) offset: Option<u64>,
    pub(super) packing: Packing,
    /// Bytes skipped after unpacking.
    pub(super) skip_unpacked: u64,
    pub(super) sample_type: SampleType,
    pub(super) endian: Endian,
}

/// An error of a file's content.
pub(super) fn malformed(path: &Path, reason: impl Into<String>) -> Error {
    Error::Format { path: path.to_owned(), reason: reason.into() }
}

/// Opens a file for reading; a directory is none.
pub(super) fn open(path: &Path) -> Result<File> {
    let failed = |source| Error::Read { path: path.to_owned(), source };
    let file = File::open(path).map_err(failed)?;
    if file.metadata().map_err(failed)?.is_dir() {
        return Err(failed(io::Error::new(io::ErrorKind::IsADirectory, "it is a directory")));
    }
    Ok(file)
}

/// The number of samples of a lattice.
pub(super) fn sample_count(path: &Path, dims: [u32; 3]) -> Result<u64> {
    dims.iter()
        .try_fold(1_u64, |n, &d| n.checked_mul(u64::from(d)))
        .ok_or_else(|| malformed(path, format!("a lattice of {dims:?} is too large")))
}

impl Source {
    /// Reads `count` samples at their own width.
    pub(super) fn read(&self, count: u64) -> Result<Samples> {
        let failed = |source| Error::Read { path: self.path.clone(), source };
        let mut file = open(&self.path)?;
        let length = file.metadata().map_err(failed)?.len();
        let needed = count
            .checked_mul(self.sample_type.bytes())
            .ok_or_else(|| malformed(&self.path, format!("{count} samples are too many")))?;
        let offset = match self.offset {
            Some(offset) => offset,
            None => length.checked_sub(needed).ok_or_else(|| self.truncated(needed, length))?,
        };
        file.seek(SeekFrom::Start(offset)).map_err(failed)?;
        let available = length.saturating_sub(offset);
        // A raw file tells its length: a header that promises more is caught before memory is asked for.
        if self.packing == Packing::Raw && available < needed.saturating_add(self.skip_unpacked) {
            return Err(self.truncated(needed, available.saturating_sub(self.skip_unpacked)));
        }
        let file = BufReader::with_capacity(1 << 20, file);
        let mut reader: Box<dyn Read> = match self.packing {
            Packing::Raw | Packing::Text => Box::new(file),
            Packing::Gzip => Box::new(MultiGzDecoder::new(file)),
            Packing::Zlib => Box::new(ZlibDecoder::new(file)),
        };
        io::copy(&mut reader.by_ref().take(self.skip_unpacked), &mut io::sink()).map_err(failed)?;
        if self.packing == Packing::Text {
            return self.parse(&mut *reader, count);
        }
        macro_rules! typed {
            ($($variant:ident: $t:ty),*) => {
                match self.sample_type {
                    $(SampleType::$variant => {
                        let mut samples: Vec<$t> = self.fill(&mut *reader, count)?;
                        if self.endian.is_foreign() {
                            samples.iter_mut().for_each(|s| {
                                bytemuck::bytes_of_mut(s).reverse();
                            });
                        }
                        Ok(Samples::$variant(samples))
                    })*
                }
            };
        }
        typed!(U8: u8, I8: i8, U16: u16, I16: i16, U32: u32, I32: i32, U64: u64, I64: i64, F32: f32, F64: f64)
    }

    fn truncated(&self, needed: u64, found: u64) -> Error {
        malformed(&self.path, format!("truncated: expected {needed} bytes of samples, found {found}"))
    }

    /// `count` values straight from the reader. Memory grows with what has been read, not with what a header claims.
    fn fill<T: bytemuck::Pod>(&self, reader: &mut dyn Read, count: u64) -> Result<Vec<T>> {
        const STEP: usize = 16 << 20;
        let count =
            usize::try_from(count).map_err(|_| malformed(&self.path, format!("{count} samples are too many")))?;
        let mut values: Vec<T> = Vec::new();
        let whole = self.packing == Packing::Raw;
        let mut filled = 0;
        while filled < count {
            let more = if whole { count } else { (count - filled).min(STEP / size_of::<T>()) };
            let reserved = if whole { values.try_reserve_exact(more) } else { values.try_reserve(more) };
            reserved.map_err(|_| {
                let bytes = count as u64 * size_of::<T>() as u64;
                Error::Volume(format!("{}: no memory for {bytes} bytes of samples", self.path.display()))
            })?;
            values.resize(filled + more, T::zeroed());
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut values[filled..]);
            let got = read_full(reader, bytes)
                .map_err(|e| malformed(&self.path, format!("the samples cannot be unpacked: {e}")))?;
            if got < bytes.len() {
                let size = size_of::<T>() as u64;
                return Err(self.truncated(count as u64 * size, filled as u64 * size + got as u64));
            }
            filled += more;
        }
        Ok(values)
    }

    /// Numbers in text.
    fn parse(&self, reader: &mut dyn Read, count: u64) -> Result<Samples> {
        let mut text = String::new();
        reader.read_to_string(&mut text).map_err(|source| Error::Read { path: self.path.clone(), source })?;
        let words = || text.split(|c: char| c.is_whitespace() || c == ',').filter(|w| !w.is_empty());
        macro_rules! typed {
            ($($variant:ident: $t:ty),*) => {
                match self.sample_type {
                    $(SampleType::$variant => {
                        let mut samples: Vec<$t> = Vec::new();
                        for word in words().take(usize::try_from(count).unwrap_or(usize::MAX)) {
                            samples.push(word.parse().map_err(|_| {
                                malformed(&self.path, format!("sample {} is {word:?}, not a {}", samples.len() + 1, stringify!($t)))
                            })?);
                        }
                        Samples::$variant(samples)
                    })*
                }
            };
        }
        let samples =
            typed!(U8: u8, I8: i8, U16: u16, I16: i16, U32: u32, I32: i32, U64: u64, I64: i64, F32: f32, F64: f64);
        if (samples.len() as u64) < count {
            return Err(malformed(
                &self.path,
                format!("truncated: expected {count} samples in text, found {}", samples.len()),
            ));
        }
        Ok(samples)
    }
}

/// Fills as much of `buffer` as there is; returns how much that was.
pub(super) fn read_full(reader: &mut dyn Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match reader.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            // A gzip stream that ends early is a truncated file, not a broken one.
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => break,
            Err(e) => return Err(e),
        }
    }
    Ok(filled)
}
