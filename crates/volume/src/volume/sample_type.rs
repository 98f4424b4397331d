//! The types of samples, and their byte order.

use std::str::FromStr;

use super::Samples;
use crate::error::Error;
use crate::names::{listed, spelled};

/// The type of a volume's samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "each variant is named for the type it stands for")]
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
    /// Returns the number of bytes per sample.
    #[must_use]
    pub fn size(self) -> usize {
        with_type!(self, T => size_of::<T>())
    }

    /// Returns the least and the largest number of an integer type of at most 16 bits: so few that a table has them
    /// all.
    pub fn few(self) -> Option<[i32; 2]> {
        match self {
            Self::U8 => Some([0, i32::from(u8::MAX)]),
            Self::I8 => Some([i32::from(i8::MIN), i32::from(i8::MAX)]),
            Self::U16 => Some([0, i32::from(u16::MAX)]),
            Self::I16 => Some([i32::from(i16::MIN), i32::from(i16::MAX)]),
            _ => None,
        }
    }

    /// Returns the number that [`Self::size`] bytes stand for. Whole numbers over 2^53 are rounded.
    pub(crate) fn number(self, bytes: &[u8], endian: Endian) -> f64 {
        let bits = endian.number(bytes);
        match self {
            Self::U8 | Self::U16 | Self::U32 | Self::U64 => bits as f64,
            Self::I8 => f64::from(bits as i8),
            Self::I16 => f64::from(bits as i16),
            Self::I32 => f64::from(bits as i32),
            Self::I64 => bits as i64 as f64,
            Self::F32 => f32::from_bits(bits as u32).into(),
            Self::F64 => f64::from_bits(bits),
        }
    }

    /// Returns whether numbers of this type can be NaN or infinite.
    #[must_use]
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// Returns the type with a common name, in any case; runs of blanks count as one.
    ///
    /// Accepts names of C, NumPy and the NRRD format ("unsigned short int", "uint16_t", "ushort"). Plain "long" is
    /// not accepted: depending on the writer it has 32 or 64 bits.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        let words = name.to_ascii_lowercase().split_ascii_whitespace().collect::<Vec<_>>().join(" ");
        let name = words.strip_suffix(" int").filter(|name| name.ends_with("short") || name.ends_with("long"));
        let name =
            name.unwrap_or(&words).replace("unsigned ", "u").replace("signed ", "").replace("long long", "longlong");
        Some(match name.as_str() {
            "u8" | "uint8" | "uint8_t" | "uchar" | "byte" => Self::U8,
            "i8" | "int8" | "int8_t" | "char" | "schar" => Self::I8,
            "u16" | "uint16" | "uint16_t" | "ushort" => Self::U16,
            "i16" | "int16" | "int16_t" | "short" => Self::I16,
            "u32" | "uint32" | "uint32_t" | "uint" => Self::U32,
            "i32" | "int32" | "int32_t" | "int" => Self::I32,
            "u64" | "uint64" | "uint64_t" | "ulonglong" => Self::U64,
            "i64" | "int64" | "int64_t" | "longlong" => Self::I64,
            "f32" | "float32" | "float" | "single" => Self::F32,
            "f64" | "float64" | "double" => Self::F64,
            _ => return None,
        })
    }
}

spelled! {
    SampleType {
        U8: "u8", I8: "i8", U16: "u16", I16: "i16", U32: "u32", I32: "i32",
        U64: "u64", I64: "i64", F32: "f32", F64: "f64",
    }
}

impl FromStr for SampleType {
    type Err = Error;

    fn from_str(s: &str) -> Result<Self, Error> {
        let expected = || format!("{s:?} is not a sample type: expected {}", listed(&Self::ALL.map(Self::name)));
        Self::from_name(s).ok_or_else(|| Error::setting("sample_type", expected()))
    }
}

/// The byte order of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Endian {
    /// The least significant byte first, as in nearly every file.
    #[default]
    Little,
    /// The most significant byte first.
    Big,
}

impl Endian {
    /// The byte order of this machine.
    pub const NATIVE: Self = if cfg!(target_endian = "big") { Self::Big } else { Self::Little };

    /// Returns the whole number, without sign, that up to 8 bytes stand for.
    pub(crate) fn number(self, bytes: &[u8]) -> u64 {
        let more = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        match self {
            Self::Little => bytes.iter().rev().fold(0, more),
            Self::Big => bytes.iter().fold(0, more),
        }
    }
}

spelled! { Endian { Little: "little", Big: "big" } }

impl FromStr for Endian {
    type Err = Error;

    fn from_str(s: &str) -> Result<Self, Error> {
        match s.to_ascii_lowercase().as_str() {
            "little" | "le" | "lsb" => Ok(Self::Little),
            "big" | "be" | "msb" => Ok(Self::Big),
            _ => Err(Error::setting("endian", format!("{s:?}, expected little or big"))),
        }
    }
}

/// A number type that the samples of a volume can have: `u8`, `i8`, `u16`, `i16`, `u32`, `i32`, `u64`, `i64`, `f32` or
/// `f64`.
///
/// Sealed: files hold these ten types, and the device classifies them.
pub trait Sample: Number {
    /// The type of samples as a value.
    const TYPE: SampleType;
}

mod number {
    use super::Samples;

    /// Conversion to f64: 64-bit integers beyond 2^53 are rounded, all other numbers are exact.
    #[doc(hidden)]
    pub trait ToF64: Copy + Send + Sync {
        /// Returns the number in f64.
        fn to_f64(self) -> f64;
    }

    /// The operations on a sample type that the library needs; not part of the interface.
    #[doc(hidden)]
    pub trait Number: bytemuck::Pod + ToF64 {
        /// Returns the number with its bytes in the reverse order.
        #[must_use]
        fn swap(self) -> Self;
        /// Parses a decimal number; `None` if the text is not a number of this type.
        fn parse(text: &str) -> Option<Self>;
        /// Returns the samples as [`Samples`].
        fn collected(samples: Vec<Self>) -> Samples;
    }
}
pub use number::{Number, ToF64};

macro_rules! samples {
    ($swap:expr, $parse:expr; $($variant:ident $t:ty),+) => { $(
        impl Number for $t {
            fn swap(self) -> Self { $swap(self) }
            fn parse(text: &str) -> Option<Self> { $parse(text) }
            fn collected(samples: Vec<Self>) -> Samples { Samples::$variant(samples) }
        }

        impl ToF64 for $t {
            fn to_f64(self) -> f64 { self as f64 }
        }

        impl Sample for $t {
            const TYPE: SampleType = SampleType::$variant;
        }
    )+ };
}
samples! {
    Self::swap_bytes,
    // Some writers spell integers as floats: 3.0 or 1e3.
    |text: &str| text.parse().ok().or_else(|| {
        let number: f64 = text.parse().ok()?;
        let integer = number as Self;
        // Below 9e15, a little under 2^53, f64 holds every integer exactly.
        (integer as f64 == number && number.abs() < 9e15).then_some(integer)
    });
    U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, U64 u64, I64 i64
}
samples! {
    |number: Self| Self::from_bits(number.to_bits().swap_bytes()),
    |text: &str| text.parse().ok();
    F32 f32, F64 f64
}

/// Runs one expression with the Rust type `$t` of a [`SampleType`].
#[macro_export]
macro_rules! with_type {
    ($type:expr, $t:ident => $body:expr) => {
        $crate::volume::with_type!(@ $type, $t, $body;
            U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, U64 u64, I64 i64, F32 f32, F64 f64)
    };
    (@ $type:expr, $t:ident, $body:expr; $($variant:ident $rust:ty),+) => {
        match $type {
            $($crate::volume::SampleType::$variant => {
                type $t = $rust;
                $body
            })+
        }
    };
}
pub use crate::with_type;
