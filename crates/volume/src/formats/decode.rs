//! Samples from the bytes of one or more files, in the width of their type there.

use std::path::Path;

use super::input::Input;
use super::selection::Pick;
use crate::error::{Error, Result, refuse, refuse_if};
use crate::memory::{samples_in, zeroed};
use crate::parallel::for_each_chunk;
use crate::volume::{Endian, FileSamples, Number, SampleType, Samples, Stored, with_samples, with_type};

/// The encoding of samples in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    /// Binary numbers in a byte order.
    Binary(Endian),
    /// Decimal numbers separated by blanks.
    Text,
}

/// The type of samples in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Whole(SampleType),
    /// 16-bit floating point. It has no sample type of its own: f32 holds each of its numbers exactly.
    Half,
}

impl From<SampleType> for Kind {
    fn from(sample_type: SampleType) -> Self {
        Self::Whole(sample_type)
    }
}

impl Kind {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Whole(sample_type) => sample_type.name(),
            Self::Half => "f16",
        }
    }

    /// Returns the bytes of a sample.
    pub(super) fn size(self) -> usize {
        match self {
            Self::Whole(sample_type) => sample_type.size(),
            Self::Half => 2,
        }
    }

    /// Returns the kind with NumPy's letter and number of bytes, such as i2.
    pub(super) fn of_numpy(letters: &str) -> Option<Self> {
        let named = |known: &SampleType| letters == format!("{}{}", &known.name()[..1], known.size());
        match letters {
            "f2" => Some(Self::Half),
            "b1" => Some(Self::Whole(SampleType::U8)),
            _ => SampleType::ALL.into_iter().find(named).map(Self::Whole),
        }
    }
}

/// Makes samples of a kind from an expression for a vector of numbers of type `$t`. For 16-bit floating point `$t` is
/// `u16`, the bits, and the samples are f32.
macro_rules! samples_of {
    ($kind:expr, $path:expr, $t:ident => $numbers:expr) => {
        match $kind {
            Kind::Whole(sample_type) => with_type!(sample_type, $t => <$t as Number>::collected($numbers)),
            Kind::Half => {
                type $t = u16;
                Samples::F32($crate::formats::decode::of_halves(&$numbers, $path)?)
            }
        }
    };
}
#[cfg_attr(not(feature = "tiff"), expect(unused_imports, reason = "for pages of TIFF"))]
pub(super) use samples_of;

/// The files of a volume, each opened at its first sample when its turn comes.
pub(super) type Parts<'a> = &'a mut dyn Iterator<Item = Result<Input>>;

/// Reads picked samples from the `n_parts` files of `parts`, which hold equal shares of all samples.
/// Uncompressed binary samples in one piece of a single file are not read: they stay there until they are needed.
pub(super) fn read_samples(
    parts: Parts<'_>,
    n_parts: usize,
    pick: &Pick,
    kind: impl Into<Kind>,
    layout: Layout,
) -> Result<Stored> {
    let kind = kind.into();
    let Some(first) = parts.next().transpose()? else { return Ok(Samples::U8(Vec::new()).into()) };
    let path = first.path().to_owned();
    if n_parts == 1
        && let (Kind::Whole(sample_type), Layout::Binary(endian)) = (kind, layout)
        && let (Some(place), Some((file, offset))) = (pick.in_one_piece(), first.plain_file()?)
    {
        let (count, size) = (pick.len(), sample_type.size());
        check_bytes(&first, pick.end(), size, layout)?;
        let count = usize::try_from(count).map_err(|_| out_of_memory(&first, count, size))?;
        let offset = offset + place * size as u64;
        return Ok(Stored::File(FileSamples { file, path, offset, count, sample_type, endian, replacement: None }));
    }
    let parts = &mut std::iter::once(Ok(first)).chain(parts);
    Ok(samples_of!(kind, &path, T => read::<T>(parts, n_parts, pick, layout)?).into())
}

/// Reads picked samples from one file, as [`read_samples`] does from several.
pub(super) fn read_all(input: Input, pick: &Pick, kind: impl Into<Kind>, layout: Layout) -> Result<Stored> {
    read_samples(&mut std::iter::once(Ok(input)), 1, pick, kind, layout)
}

/// The number of samples of a piece of work.
const CHUNK: usize = 1 << 16;

/// Reorders samples from z fastest to x fastest.
pub(super) fn x_fastest(samples: &Samples, dims: [u32; 3], path: &Path) -> Result<Samples> {
    let [_, ny, nz] = dims.map(|d| d as usize);
    reordered(samples, dims, [ny * nz, nz, 1], path)
}

/// Reorders samples to x fastest, from an order in which neighbours along each axis are a stride apart.
pub(super) fn reordered(samples: &Samples, dims: [u32; 3], strides: [usize; 3], path: &Path) -> Result<Samples> {
    let ([nx, ny, _], [sx, sy, sz]) = (dims.map(|d| d as usize), strides);
    with_samples!(samples, from => {
        let mut turned = zeroed(from.len() as u64, || samples_in(path))?;
        let at = |i: usize| from[i % nx * sx + i / nx % ny * sy + i / (nx * ny) * sz];
        for_each_chunk(&mut turned, CHUNK, |number, chunk| {
            chunk.iter_mut().enumerate().for_each(|(i, sample)| *sample = at(number * CHUNK + i));
        });
        Ok(Number::collected(turned))
    })
}

/// Converts the bits of 16-bit floating point to numbers.
pub(super) fn of_halves(halves: &[u16], path: &Path) -> Result<Vec<f32>> {
    let mut floats = zeroed(halves.len() as u64, || samples_in(path))?;
    for_each_chunk(&mut floats, CHUNK, |number, chunk| {
        let halves = &halves[number * CHUNK..];
        chunk.iter_mut().zip(halves).for_each(|(float, bits)| *float = half::f16::from_bits(*bits).to_f32());
    });
    Ok(floats)
}

/// Reads picked samples straight into the vector that becomes the volume, without a second copy.
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
            skip(&mut input, start - at, size_of::<T>(), layout)?;
            match layout {
                Layout::Binary(_) => read_binary(&mut input, here, pick.step, &mut samples)?,
                Layout::Text => read_text(&mut input, here, pick.step, &mut samples)?,
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
        for_each_chunk(&mut samples, CHUNK, |_, chunk| chunk.iter_mut().for_each(|s| *s = s.swap()));
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
    if input.at_most().is_some_and(|most| needed > u128::from(most)) {
        let there = match input.exactly_left() {
            Some(left) => format!("{left} are there"),
            None => "and the file cannot hold that many however compressed".to_owned(),
        };
        refuse!(input, "is cut short, or its header claims too much: {count} samples need {needed} bytes, {there}");
    }
    Ok(())
}

fn out_of_memory(input: &Input, count: u64, size: usize) -> Error {
    let gib = count as f64 * size as f64 / f64::from(1 << 30);
    input.error(format!("needs {gib:.1} GiB of memory, more than can be had: crop or downsample it first"))
}

/// Skips `count` samples of `size` bytes.
pub(super) fn skip(input: &mut Input, count: u64, size: usize, layout: Layout) -> Result<()> {
    let mut token = String::new();
    match layout {
        Layout::Binary(_) => input.skip(count.saturating_mul(size as u64)),
        Layout::Text => (0..count).try_for_each(|_| {
            refuse_if!(!input.token(&mut token)?, input, "ends before its samples");
            Ok(())
        }),
    }
}

/// Reads `count` samples, each `step` behind the last.
fn read_binary<T: Number>(input: &mut Input, count: u64, step: u64, samples: &mut Vec<T>) -> Result<()> {
    if step == 1 {
        return read_run(input, count, samples);
    }
    let (size, mut block, mut left) = (size_of::<T>() as u64, Vec::new(), count);
    while left > 0 {
        let n = left.min((1 << 20) / size / step).max(1);
        block.clear();
        // The file may end behind the last sample that is wanted.
        read_run::<T>(input, (n - 1) * step + 1, &mut block)?;
        samples.extend(block.iter().step_by(step as usize));
        left -= n;
        if left > 0 {
            input.skip((step - 1) * size)?;
        }
    }
    Ok(())
}

/// Reads `count` samples that follow one another.
fn read_run<T: Number>(input: &mut Input, count: u64, samples: &mut Vec<T>) -> Result<()> {
    // The vector grows by 1 MiB at a time. The zeros that `resize` writes are still in the cache when samples overwrite
    // them, and pages beyond the end of a short file are never touched.
    let size = size_of::<T>() as u64;
    let mut left = count;
    while left > 0 {
        let n = left.min((1 << 20) / size);
        let start = samples.len();
        samples.resize(start + n as usize, T::zeroed());
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut samples[start..]);
        let wanted = bytes.len();
        let got = input.fill(bytes)?;
        if got < wanted {
            let found = (count - left) * size + got as u64;
            refuse!(input, "is cut short: {count} samples need {} bytes, {found} are there", count * size);
        }
        left -= n;
    }
    Ok(())
}

fn read_text<T: Number>(input: &mut Input, count: u64, step: u64, samples: &mut Vec<T>) -> Result<()> {
    let mut token = String::new();
    for i in 0..count {
        if i > 0 {
            skip(input, step - 1, size_of::<T>(), Layout::Text)?;
        }
        refuse_if!(!input.token(&mut token)?, input, "is cut short: {count} samples expected, {i} are there");
        let Some(sample) = T::parse(&token) else {
            let name = std::any::type_name::<T>();
            refuse!(input, "sample {} is {token:?}, which is not a number of type {name}", i + 1);
        };
        samples.push(sample);
    }
    Ok(())
}
