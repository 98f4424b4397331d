//! Stand-in: the readers.

use std::str::FromStr;

use super::{Grid, Samples, Volume};
use crate::error::{Error, Result};

/// How a file is read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LoadOptions {
    /// Samples along each axis.
    pub dims: Option<[u32; 3]>,
    /// The type of the samples.
    pub sample_type: Option<SampleType>,
    /// Spacing.
    pub spacing: Option<[f64; 3]>,
    /// Byte order.
    pub endian: Option<Endian>,
    /// Bytes to skip.
    pub offset: u64,
    /// In place of NaN.
    pub replace_nan: Option<f64>,
}

/// A sample type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "stand-in")]
pub enum SampleType {
    U8,
    I16,
    F32,
}

/// A byte order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "stand-in")]
pub enum Endian {
    Little,
    Big,
}

impl FromStr for SampleType {
    type Err = Error;

    fn from_str(s: &str) -> Result<Self> {
        match s {
            "u8" => Ok(Self::U8),
            "i16" => Ok(Self::I16),
            "f32" => Ok(Self::F32),
            _ => Err(Error::Setting { name: "type", reason: format!("{s}, expected u8, i8, u16 ... f64") }),
        }
    }
}

impl FromStr for Endian {
    type Err = Error;

    fn from_str(s: &str) -> Result<Self> {
        match s {
            "little" => Ok(Self::Little),
            "big" => Ok(Self::Big),
            _ => Err(Error::Setting { name: "endian", reason: format!("{s}, expected little or big") }),
        }
    }
}

/// Reads a volume.
///
/// # Errors
/// Whatever is wrong with it.
pub fn load(source: &str, options: &LoadOptions) -> Result<Volume> {
    if let Some(name) = source.strip_prefix("demo:") {
        return super::phantom::demo(name);
    }
    let path = std::path::Path::new(source);
    let bytes = std::fs::read(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
    let dims = options
        .dims
        .ok_or_else(|| Error::Format { path: path.to_owned(), reason: "give --dims and --type".to_owned() })?;
    let bytes = bytes.into_iter().skip(options.offset as usize);
    let samples = match options.sample_type {
        Some(SampleType::I16) => {
            let bytes: Vec<u8> = bytes.collect();
            Samples::I16(bytes.chunks_exact(2).map(|b| i16::from_le_bytes([b[0], b[1]])).collect())
        }
        _ => Samples::U8(bytes.collect()),
    };
    Volume::new(Grid::axis_parallel(dims, options.spacing.unwrap_or([1.0; 3]))?, samples)
}
