//! Samples in memory, or in their file and read a range at a time.

use std::fs::File;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::{Endian, Number, Sample, SampleType, Samples, ToF64, with_samples, with_type};
use crate::error::{Error, Result};
use crate::files::read_exact_at;
use crate::memory::reserved;
use crate::parallel::for_each_chunk;

/// The samples of a volume.
#[derive(Debug)]
pub(crate) enum Stored {
    Memory(Arc<Samples>),
    File(FileSamples),
}

impl From<Samples> for Stored {
    fn from(samples: Samples) -> Self {
        Self::Memory(Arc::new(samples))
    }
}

/// Binary samples in one piece of a file.
#[derive(Debug)]
pub(crate) struct FileSamples {
    pub(crate) file: File,
    pub(crate) path: PathBuf,
    /// The number of bytes before the first sample.
    pub(crate) offset: u64,
    pub(crate) count: usize,
    pub(crate) sample_type: SampleType,
    pub(crate) endian: Endian,
    /// The number that replaces NaN and infinite samples.
    pub(crate) replacement: Option<f64>,
}

/// The number of bytes that one thread reads or checks at a time.
const PIECE: usize = 1 << 20;

impl Stored {
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Memory(samples) => samples.len(),
            Self::File(file) => file.count,
        }
    }

    pub(crate) fn sample_type(&self) -> SampleType {
        match self {
            Self::Memory(samples) => samples.sample_type(),
            Self::File(file) => file.sample_type,
        }
    }

    /// Copies a range of the samples.
    pub(crate) fn read(&self, range: Range<usize>) -> Result<Samples> {
        match self {
            Self::Memory(samples) => samples.slice(range),
            Self::File(file) => file.read(range),
        }
    }

    /// Returns all samples, in memory.
    pub(crate) fn into_samples(self) -> Result<Samples> {
        match self {
            Self::Memory(samples) => Ok(Arc::unwrap_or_clone(samples)),
            Self::File(file) => file.read(0..file.count),
        }
    }

    /// Replaces every NaN or infinite sample by `raw`.
    pub(crate) fn replace_non_finite(&mut self, raw: f64) {
        match self {
            Self::Memory(samples) => Arc::make_mut(samples).replace_non_finite(raw),
            Self::File(file) => file.replacement = Some(raw),
        }
    }
}

impl FileSamples {
    fn read(&self, range: Range<usize>) -> Result<Samples> {
        let mut samples = with_type!(self.sample_type, T => T::collected(self.numbers(range)?));
        if let Some(raw) = self.replacement {
            samples.replace_non_finite(raw);
        }
        Ok(samples)
    }

    fn numbers<T: Number>(&self, range: Range<usize>) -> Result<Vec<T>> {
        let mut numbers = reserved(range.len() as u64, || format!("samples of {}", self.path.display()))?;
        numbers.resize(range.len(), T::zeroed());
        let first = self.offset + (range.start * size_of::<T>()) as u64;
        let failure = Mutex::new(None);
        for_each_chunk(&mut numbers, PIECE / size_of::<T>(), |index, piece| {
            let bytes = bytemuck::cast_slice_mut(piece);
            match read_exact_at(&self.file, bytes, first + (index * PIECE) as u64) {
                Err(error) => *failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error),
                Ok(()) if self.endian != Endian::NATIVE && size_of::<T>() > 1 => {
                    piece.iter_mut().for_each(|n| *n = n.swap());
                }
                Ok(()) => {}
            }
        });
        match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(error) => Err(Error::read(&self.path)(error)),
            None => Ok(numbers),
        }
    }
}

/// Copies samples.
pub(super) fn copied<T: Copy>(samples: &[T]) -> Result<Vec<T>> {
    let mut copy = reserved(samples.len() as u64, || "the samples of a volume".to_owned())?;
    copy.extend_from_slice(samples);
    Ok(copy)
}

impl Samples {
    /// Returns the type of the samples.
    #[must_use]
    pub fn sample_type(&self) -> SampleType {
        fn type_of<T: Sample>(_: &[T]) -> SampleType {
            T::TYPE
        }
        with_samples!(self, s => type_of(s))
    }

    /// Copies a range of the samples.
    fn slice(&self, range: Range<usize>) -> Result<Self> {
        with_samples!(self, s => Ok(Number::collected(copied(&s[range])?)))
    }

    /// Copies some columns of rows of `row` samples, with memory for `most` samples.
    pub(super) fn cropped(&self, row: usize, columns: &Range<usize>, most: u64) -> Result<Self> {
        with_samples!(self, s => {
            let mut copy = reserved(most, || "a part of a volume".to_owned())?;
            s.chunks_exact(row).for_each(|row| copy.extend_from_slice(&row[columns.clone()]));
            Ok(Number::collected(copy))
        })
    }

    /// Adds some columns of rows of `row` samples of the same type.
    pub(super) fn extend_cropped(&mut self, rows: &Self, row: usize, columns: &Range<usize>) {
        macro_rules! extend {
            ($($variant:ident)+) => {
                match (self, rows) {
                    $((Self::$variant(to), Self::$variant(from)) => {
                        from.chunks_exact(row).for_each(|row| to.extend_from_slice(&row[columns.clone()]));
                    })+
                    _ => {}
                }
            };
        }
        extend!(U8 I8 U16 I16 U32 I32 U64 I64 F32 F64);
    }

    /// Returns the number of NaN and infinite samples, and the index of the first.
    pub(crate) fn non_finite(&self) -> (usize, Option<usize>) {
        fn count<T: Copy + Sync>(s: &[T], is_finite: impl Fn(T) -> bool + Sync) -> (usize, Option<usize>) {
            // A fold over whole pieces vectorises. Samples are counted one by one only if a piece fails.
            let piece = |piece: &[T]| !piece.iter().fold(true, |all, &v| all & is_finite(v));
            if !s.par_chunks(PIECE / size_of::<T>()).any(piece) {
                return (0, None);
            }
            let bad = |v: &T| !is_finite(*v);
            (s.par_iter().filter(|v| bad(v)).count(), s.iter().position(bad))
        }
        match self {
            Self::F32(s) => count(s, |v: f32| v.is_finite()),
            Self::F64(s) => count(s, |v: f64| v.is_finite()),
            _ => (0, None),
        }
    }

    fn replace_non_finite(&mut self, raw: f64) {
        match self {
            Self::F32(s) => s.par_iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = raw as f32),
            Self::F64(s) => s.par_iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = raw),
            _ => {}
        }
    }

    /// Returns sample `index` as stored, in f64; 64-bit integers beyond 2^53 are rounded.
    ///
    /// # Panics
    /// If `index` is not under the number of samples.
    #[must_use]
    pub fn raw(&self, index: usize) -> f64 {
        with_samples!(self, s => s[index].to_f64())
    }
}
