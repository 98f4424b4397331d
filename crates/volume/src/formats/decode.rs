//! Samples from the bytes of one or more files, at the width they have there.

use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::input::Input;
use super::selection::Pick;
use crate::error::{Error, Result};
use crate::memory::{reserved, samples_in};
use crate::volume::{Endian, FileSamples, MAX_DIM, Number, SampleType, Samples, Stored, with_type};

/// The encoding of samples in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    /// Binary, in this byte order.
    Binary(Endian),
    /// Decimal numbers separated by blanks.
    Text,
}

/// What a sample is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Whole(SampleType),
    /// 16-bit floating point. It has no sample type of its own: f32 holds each of its numbers exactly.
    Half,
}

impl Kind {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Whole(sample_type) => sample_type.name(),
            Self::Half => "f16",
        }
    }

    /// Bytes of a sample.
    pub(super) fn size(self) -> usize {
        match self {
            Self::Whole(sample_type) => sample_type.size(),
            Self::Half => 2,
        }
    }

    /// By the letters of NumPy, such as i2.
    pub(super) fn of_numpy(letters: &str) -> Option<Self> {
        Some(Self::Whole(match letters {
            "u1" | "b1" => SampleType::U8,
            "i1" => SampleType::I8,
            "u2" => SampleType::U16,
            "i2" => SampleType::I16,
            "u4" => SampleType::U32,
            "i4" => SampleType::I32,
            "u8" => SampleType::U64,
            "i8" => SampleType::I64,
            "f4" => SampleType::F32,
            "f8" => SampleType::F64,
            "f2" => return Some(Self::Half),
            _ => return None,
        }))
    }
}

/// The files of a volume, each opened at its first sample when its turn comes.
pub(super) type Parts<'a> = &'a mut dyn Iterator<Item = Result<Input>>;

/// Reads the samples that are picked from those of the `n_parts` files of `parts`, which hold equal shares of all.
/// Uncompressed binary samples in one piece of a single file are not read: they stay there until they are needed.
pub(super) fn read_samples(
    parts: Parts<'_>,
    n_parts: usize,
    pick: &Pick,
    sample_type: SampleType,
    layout: Layout,
) -> Result<Stored> {
    if n_parts == 1
        && let (Layout::Binary(endian), Some(first)) = (layout, pick.in_one_piece())
        && let Some(part) = parts.next()
    {
        let input = part?;
        if let Some((file, offset)) = input.plain_file()? {
            let (count, size) = (pick.len(), sample_type.size());
            check_bytes(&input, pick.end(), size, layout)?;
            let count = usize::try_from(count).map_err(|_| out_of_memory(&input, count, size))?;
            let (path, offset) = (input.path().to_owned(), offset + first * size as u64);
            return Ok(Stored::File(FileSamples { file, path, offset, count, sample_type, endian, replacement: None }));
        }
        return read_into_memory(&mut std::iter::once(Ok(input)), 1, pick, sample_type, layout);
    }
    read_into_memory(parts, n_parts, pick, sample_type, layout)
}

fn read_into_memory(
    parts: Parts<'_>,
    n_parts: usize,
    pick: &Pick,
    sample_type: SampleType,
    layout: Layout,
) -> Result<Stored> {
    let samples = with_type!(sample_type, T => T::collected(read(parts, n_parts, pick, layout)?));
    Ok(Stored::Memory(Arc::new(samples)))
}

/// As [`read_samples`], from one file.
pub(super) fn read_all(input: Input, pick: &Pick, sample_type: SampleType, layout: Layout) -> Result<Stored> {
    read_samples(&mut std::iter::once(Ok(input)), 1, pick, sample_type, layout)
}

/// As [`read_all`], of samples of a kind.
pub(super) fn read_kind(input: Input, pick: &Pick, kind: Kind, layout: Layout) -> Result<Stored> {
    match kind {
        Kind::Whole(sample_type) => read_all(input, pick, sample_type, layout),
        Kind::Half => read_halves(input, pick, layout),
    }
}

/// Reads numbers of 16-bit floating point from one file.
fn read_halves(input: Input, pick: &Pick, layout: Layout) -> Result<Stored> {
    let path = input.path().to_owned();
    let halves: Vec<u16> = read(&mut std::iter::once(Ok(input)), 1, pick, layout)?;
    Ok(Stored::Memory(Arc::new(Samples::F32(of_halves(halves, &path)?))))
}

/// The numbers of 16-bit floating point with these bits.
pub(super) fn of_halves(halves: Vec<u16>, path: &Path) -> Result<Vec<f32>> {
    let mut floats = reserved(halves.len() as u64, || samples_in(path))?;
    halves.into_par_iter().map(|bits| half::f16::from_bits(bits).to_f32()).collect_into_vec(&mut floats);
    Ok(floats)
}

/// Reads straight into the vector that becomes the volume, without a second copy.
pub(super) fn read<T: Number>(parts: Parts<'_>, n_parts: usize, pick: &Pick, layout: Layout) -> Result<Vec<T>> {
    let mut samples: Vec<T> = Vec::new();
    let (count, share) = (pick.len(), pick.all / n_parts.max(1) as u64);
    let (mut run, mut done) = (0, 0);
    for (index, part) in parts.enumerate() {
        let mut input = part?;
        let base = index as u64 * share;
        if base >= pick.end() {
            break;
        }
        check_bytes(&input, share.min(pick.end() - base), size_of::<T>(), layout)?;
        if samples.capacity() == 0 {
            // Reserved once, after the first file has shown that it can hold its share. Reserved pages that are never
            // written to cost nothing, so a compressed file that ends early does no harm.
            let total = usize::try_from(count).ok().filter(|&n| samples.try_reserve_exact(n).is_ok());
            total.ok_or_else(|| out_of_memory(&input, count, size_of::<T>()))?;
        }
        let (mut at, end) = (base, base + share);
        while run < pick.runs() {
            let start = pick.start(run) + done * pick.step;
            if start >= end {
                break;
            }
            let here = (pick.run - done).min((end - start).div_ceil(pick.step));
            match layout {
                Layout::Binary(_) => {
                    if start > at {
                        input.skip((start - at) * size_of::<T>() as u64)?;
                    }
                    read_binary(&mut input, here, pick.step, &mut samples)?;
                }
                Layout::Text => {
                    skip_text(&mut input, start - at)?;
                    read_text(&mut input, here, pick.step, &mut samples)?;
                }
            }
            at = start + (here - 1) * pick.step + 1;
            done += here;
            if done == pick.run {
                (run, done) = (run + 1, 0);
            }
        }
        if matches!(layout, Layout::Binary(_)) && at == end {
            input.verify_checksum()?;
        }
    }
    if matches!(layout, Layout::Binary(endian) if endian != Endian::NATIVE) && size_of::<T>() > 1 {
        samples.par_iter_mut().for_each(|s| *s = s.swap());
    }
    Ok(samples)
}

/// Refuses a file that cannot hold `count` samples, before memory is reserved.
fn check_bytes(input: &Input, count: u64, size: usize, layout: Layout) -> Result<()> {
    let needed = match layout {
        Layout::Binary(_) => u128::from(count) * size as u128,
        // At least one digit per sample, and a blank between two samples.
        Layout::Text => (u128::from(count) * 2).saturating_sub(1),
    };
    match (input.exactly_left(), input.at_most()) {
        (Some(left), _) if needed > u128::from(left) => Err(input.error(format!(
            "is cut short, or its header claims too much: {count} samples need {needed} bytes, {left} are there"
        ))),
        (None, Some(most)) if needed > u128::from(most) => Err(input.error(format!(
            "is cut short, or its header claims too much: {count} samples need {needed} bytes, \
             and the file cannot hold that many however compressed"
        ))),
        _ => Ok(()),
    }
}

fn out_of_memory(input: &Input, count: u64, size: usize) -> Error {
    let gib = count as f64 * size as f64 / f64::from(1 << 30);
    input.error(format!("needs {gib:.1} GiB of memory, more than can be had: crop or downsample it first"))
}

/// Reads `count` samples, each `step` behind the last.
fn read_binary<T: Number>(input: &mut Input, count: u64, step: u64, samples: &mut Vec<T>) -> Result<()> {
    if step > 1 {
        return read_every(input, count, step, samples);
    }
    // The vector grows by 1 MiB at a time. The zeros that `resize` writes are still in the cache when samples overwrite
    // them, and pages beyond the end of a short file are never touched.
    let chunk = (1 << 20) / size_of::<T>() as u64;
    let mut left = count;
    while left > 0 {
        let n = left.min(chunk);
        let start = samples.len();
        samples.resize(start + n as usize, T::zeroed());
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut samples[start..]);
        let wanted = bytes.len();
        let got = input.fill(bytes)?;
        if got < wanted {
            let size = size_of::<T>() as u64;
            let found = (count - left) * size + got as u64;
            return Err(
                input.error(format!("is cut short: {count} samples need {} bytes, {found} are there", count * size))
            );
        }
        left -= n;
    }
    Ok(())
}

/// Reads `count` samples with `step - 1` others between two of them.
fn read_every<T: Number>(input: &mut Input, count: u64, step: u64, samples: &mut Vec<T>) -> Result<()> {
    let size = size_of::<T>() as u64;
    if step > (1 << 20) / size {
        for i in 0..count {
            if i > 0 {
                input.skip((step - 1) * size)?;
            }
            read_binary(input, 1, 1, samples)?;
        }
        return Ok(());
    }
    let groups = (1 << 20) / size / step;
    let mut all = Vec::new();
    let mut left = count;
    while left > 0 {
        let n = left.min(groups);
        // The file may end behind the last sample that is wanted.
        let wanted = if n == left { (n - 1) * step + 1 } else { n * step };
        all.clear();
        read_binary::<T>(input, wanted, 1, &mut all)?;
        samples.extend(all.iter().step_by(step as usize));
        left -= n;
    }
    Ok(())
}

fn skip_text(input: &mut Input, count: u64) -> Result<()> {
    let mut token = String::new();
    for _ in 0..count {
        if !input.token(&mut token)? {
            return Err(input.error("ends before its samples"));
        }
    }
    Ok(())
}

fn read_text<T: Number>(input: &mut Input, count: u64, step: u64, samples: &mut Vec<T>) -> Result<()> {
    let mut token = String::new();
    for i in 0..count {
        if i > 0 {
            skip_text(input, step - 1)?;
        }
        if !input.token(&mut token)? {
            return Err(input.error(format!("is cut short: {count} samples expected, {i} are there")));
        }
        let sample = T::parse(&token);
        samples.push(sample.ok_or_else(|| {
            let name = std::any::type_name::<T>();
            input.error(format!("sample {} is {token:?}, which is not a number of type {name}", i + 1))
        })?);
    }
    Ok(())
}

/// The dimensions of a lattice from a header, each checked to be in the range that a grid accepts; missing ones are 1.
pub(super) fn lattice(path: &Path, sizes: &[i64]) -> Result<[u32; 3]> {
    let dim = |axis: usize| {
        let size = sizes.get(axis).copied().unwrap_or(1);
        match u32::try_from(size) {
            Ok(n) if (1..=MAX_DIM).contains(&n) => Ok(n),
            _ => Err(Error::format(path, format!("dimension {} is {size}, expected 1 to {}", axis + 1, MAX_DIM))),
        }
    };
    Ok([dim(0)?, dim(1)?, dim(2)?])
}
