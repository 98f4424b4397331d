//! The codecs between the samples of a chunk and the bytes of its file.

use std::borrow::Cow;
use std::io::{self, Read};
use std::ops::Range;
use std::path::Path;

use flate2::bufread::{MultiGzDecoder, ZlibDecoder};
use serde_json::Value;

use super::blosc;
use super::content::{numbers, zstd};
use super::store::Bytes;
use crate::error::{Damage, Result, Subject, refuse, refuse_if};
use crate::formats::selection::choice;
use crate::volume::{Endian, Number};

/// A codec from bytes to bytes.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum ByteCodec {
    Gzip,
    Zlib,
    Zstd,
    /// A block of LZ4 behind its length in four bytes.
    Lz4,
    Blosc,
    /// A checksum in the last four bytes.
    Crc32c,
    /// A shuffle of the bytes of elements of this size.
    Shuffle(usize),
}

/// A codec from samples to bytes.
#[derive(Debug, Clone, PartialEq)]
enum Writing {
    Plain(Endian),
    Shards(Box<Shards>),
}

/// The chunks within a chunk.
#[derive(Debug, Clone, PartialEq)]
struct Shards {
    shape: Vec<u64>,
    chain: Chain,
    index: Chain,
    index_first: bool,
}

/// The codecs of a chunk, from samples to bytes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chain {
    /// The permutations of axes, in the order of encoding: for each axis after a permutation, the axis before it.
    transposed: Vec<Vec<usize>>,
    writing: Writing,
    packings: Vec<ByteCodec>,
}

/// The largest depth of shards within shards.
const MAX_DEPTH: usize = 4;

/// The largest number of codecs of a chain.
const MAX_CODECS: usize = 16;

impl Chain {
    /// Returns the chain of codecs of Zarr 2: an order, a byte order, filters and a compressor.
    pub(super) fn of_v2(file: &Path, axes: usize, fortran: bool, endian: Endian, codecs: &[&Value]) -> Result<Self> {
        let transposed = if fortran { vec![(0..axes).rev().collect()] } else { Vec::new() };
        let packing = |codec: &&Value| ByteCodec::of(file, codec["id"].as_str().unwrap_or_default(), codec);
        let packings = codecs.iter().map(packing).collect::<Result<_>>()?;
        Ok(Self { transposed, writing: Writing::Plain(endian), packings })
    }

    /// Returns the chain of codecs of Zarr 3 for chunks of this shape.
    pub(super) fn of_v3(file: &Path, codecs: &Value, shape: &[u64], depth: usize) -> Result<Self> {
        let list = codecs.as_array().filter(|list| list.len() <= MAX_CODECS && depth <= MAX_DEPTH);
        let Some(list) = list else { refuse!(file, "its codecs are no list of bearable length") };
        let mut shape = shape.to_vec();
        let (mut transposed, mut writing, mut packings) = (Vec::new(), None, Vec::new());
        for codec in list {
            let name = codec.as_str().or(codec["name"].as_str()).unwrap_or_default();
            let options = &codec["configuration"];
            match name {
                "transpose" if writing.is_none() => {
                    let order: Vec<usize> = numbers(&options["order"]).into_iter().map(|axis| axis as usize).collect();
                    let is_order = order.len() == shape.len() && (0..shape.len()).all(|axis| order.contains(&axis));
                    refuse_if!(!is_order, file, "transpose: the order {order:?} of {} axes", shape.len());
                    shape = order.iter().map(|&axis| shape[axis]).collect();
                    transposed.push(order);
                }
                "bytes" if writing.is_none() => {
                    let orders = [("little", Endian::Little), ("big", Endian::Big)];
                    writing = Some(Writing::Plain(choice(file, "endian", options["endian"].as_str(), orders)?));
                }
                "sharding_indexed" if writing.is_none() => {
                    let inner = numbers(&options["chunk_shape"]);
                    let divides = inner.len() == shape.len()
                        && inner.iter().zip(&shape).all(|(inner, outer)| *inner > 0 && outer % inner == 0);
                    refuse_if!(!divides, file, "chunks of {inner:?} in shards of {shape:?}");
                    let chunks = inner.iter().zip(&shape).map(|(inner, outer)| outer / inner);
                    let index_shape: Vec<u64> = chunks.chain([2]).collect();
                    let places = [("end", false), ("start", true)];
                    writing = Some(Writing::Shards(Box::new(Shards {
                        chain: Self::of_v3(file, &options["codecs"], &inner, depth + 1)?,
                        index: Self::of_v3(file, &options["index_codecs"], &index_shape, MAX_DEPTH)?,
                        shape: inner,
                        index_first: choice(file, "index_location", options["index_location"].as_str(), places)?,
                    })));
                }
                other if writing.is_some() => packings.push(ByteCodec::of(file, other, options)?),
                other => refuse!(file, "the codec {other:?} is not read"),
            }
        }
        let Some(writing) = writing else { refuse!(file, "its codecs make no bytes of samples") };
        // What is written last is read first.
        packings.reverse();
        Ok(Self { transposed, writing, packings })
    }

    /// Reads the part `want` of a chunk of this shape to its place in `target`.
    pub(super) fn read<T: Number>(
        &self,
        bytes: &Bytes<'_>,
        (shape, want): (&[u64], &[Range<u64>]),
        target: &mut ChunkTarget<'_, T>,
    ) -> io::Result<()> {
        let (mut shape, mut want, mut strides) = (shape.to_vec(), want.to_vec(), target.strides.clone());
        for order in &self.transposed {
            shape = order.iter().map(|&axis| shape[axis]).collect();
            want = order.iter().map(|&axis| want[axis].clone()).collect();
            strides = order.iter().map(|&axis| strides[axis]).collect();
        }
        let count: u64 = shape.iter().fold(1, |n, size| n.saturating_mul(*size));
        let size = count.saturating_mul(size_of::<T>() as u64);
        let mut target = ChunkTarget { samples: &mut *target.samples, first: target.first, strides };
        match &self.writing {
            Writing::Plain(endian) => {
                let content = self.unpacked(bytes, size)?;
                refuse_if!(content.len() as u64 != size, Damage, "a chunk of {} bytes, expected {size}", content.len());
                target.place(&content, *endian, &shape, &want);
                Ok(())
            }
            Writing::Shards(shards) if self.packings.is_empty() => shards.read(bytes, (&shape, &want), &mut target),
            Writing::Shards(shards) => {
                // Compressed chunks may be larger than their content, and the index has 16 bytes for each.
                let content = self.unpacked(bytes, size.saturating_mul(2).saturating_add(16 * count + 1024))?;
                shards.read(&Bytes::Memory(Cow::Borrowed(&content)), (&shape, &want), &mut target)
            }
        }
    }

    /// Returns the shape of the chunks in the shards that these chunks are, if each can be read alone.
    pub(super) fn inner(&self) -> Option<Vec<u64>> {
        let Writing::Shards(shards) = &self.writing else { return None };
        let mut shape = shards.shape.clone();
        for order in self.transposed.iter().rev() {
            let size = |axis: usize| order.iter().position(|of| *of == axis).map_or(1, |n| shape[n]);
            shape = (0..shape.len()).map(size).collect();
        }
        self.packings.is_empty().then_some(shape)
    }

    /// Returns the unpacked bytes, about `most` at most.
    fn unpacked(&self, bytes: &Bytes<'_>, most: u64) -> io::Result<Vec<u8>> {
        // Checksums and incompressible content take a little more.
        let most = usize::try_from(most.saturating_add(most >> 3).saturating_add(1024)).unwrap_or(usize::MAX);
        let mut content = bytes.all((most as u64).saturating_mul(2))?;
        for packing in &self.packings {
            content = packing.undone(&content, most)?;
        }
        Ok(content)
    }

    /// Returns the packed length of this many bytes; fails if a codec makes it vary.
    fn fixed_length(&self, bytes: u64) -> io::Result<u64> {
        self.packings.iter().try_fold(bytes, |length, packing| match packing {
            ByteCodec::Crc32c => Ok(length + 4),
            ByteCodec::Shuffle(_) => Ok(length),
            _ => Err(Damage.error("the index of a shard is compressed")),
        })
    }
}

impl Shards {
    fn read<T: Number>(
        &self,
        bytes: &Bytes<'_>,
        (shape, want): (&[u64], &[Range<u64>]),
        target: &mut ChunkTarget<'_, T>,
    ) -> io::Result<()> {
        let chunks: Vec<u64> = shape.iter().zip(&self.shape).map(|(outer, inner)| outer / inner).collect();
        let count = chunks.iter().fold(1, |n: u64, size| n.saturating_mul(*size));
        let length = self.index.fixed_length(count.saturating_mul(16))?;
        let index = bytes.edge(self.index_first, length)?;
        // The file has the index, so it is no larger than the file.
        let mut entries = vec![0_u64; (count * 2) as usize];
        let index_shape: Vec<u64> = chunks.iter().copied().chain([2]).collect();
        let all: Vec<Range<u64>> = index_shape.iter().map(|size| 0..*size).collect();
        let mut to = ChunkTarget { strides: strides_of(&index_shape), samples: &mut entries, first: 0 };
        self.index.read(&Bytes::Memory(Cow::Borrowed(&index)), (&index_shape, &all), &mut to)?;
        let strides = strides_of(&chunks);
        for (chunk, inner, at) in parts(want, &self.shape) {
            let entry: usize = chunk.iter().zip(&strides).map(|(index, stride)| *index as usize * stride).sum();
            let (offset, length) = (entries[2 * entry], entries[2 * entry + 1]);
            // A chunk that is not there has the fill value, which is in the target already.
            if (offset, length) == (u64::MAX, u64::MAX) {
                continue;
            }
            let first = target.first + at.iter().zip(&target.strides).map(|(n, s)| *n as usize * s).sum::<usize>();
            let mut target = ChunkTarget { samples: &mut *target.samples, first, strides: target.strides.clone() };
            let content = bytes.range(offset, length)?;
            self.chain.read(&Bytes::Memory(Cow::Borrowed(&content)), (&self.shape, &inner), &mut target)?;
        }
        Ok(())
    }
}

/// The destination of samples: along each axis of a chunk they are a stride apart.
pub(super) struct ChunkTarget<'a, T> {
    pub(super) samples: &'a mut [T],
    pub(super) first: usize,
    pub(super) strides: Vec<usize>,
}

impl<T: Number> ChunkTarget<'_, T> {
    /// Copies the part `want` from samples of this shape, whose last axis is the fastest.
    pub(super) fn place(&mut self, bytes: &[u8], endian: Endian, shape: &[u64], want: &[Range<u64>]) {
        let (Some((row, outer)), Some(stride)) = (want.split_last(), self.strides.last()) else { return };
        let from = strides_of(shape);
        let size = size_of::<T>();
        let swapped = endian != Endian::NATIVE && size > 1;
        let rows: u64 = outer.iter().map(|range| range.end - range.start).product();
        for index in 0..rows {
            let (mut rest, mut source, mut to) = (index, row.start as usize, self.first);
            for axis in (0..outer.len()).rev() {
                let length = outer[axis].end - outer[axis].start;
                source += (outer[axis].start + rest % length) as usize * from[axis];
                to += (rest % length) as usize * self.strides[axis];
                rest /= length;
            }
            let length = (row.end - row.start) as usize;
            let source = &bytes[source * size..(source + length) * size];
            if *stride == 1 {
                let to = &mut self.samples[to..to + length];
                bytemuck::cast_slice_mut::<T, u8>(to).copy_from_slice(source);
                if swapped {
                    to.iter_mut().for_each(|sample| *sample = sample.swap());
                }
            } else {
                let to = self.samples[to..].iter_mut().step_by(*stride);
                for (sample, bytes) in to.zip(source.chunks_exact(size)) {
                    let read: T = bytemuck::pod_read_unaligned(bytes);
                    *sample = if swapped { read.swap() } else { read };
                }
            }
        }
    }
}

/// Returns the number of samples from one index to the next along each axis; the last is the fastest.
pub(super) fn strides_of(shape: &[u64]) -> Vec<usize> {
    let mut strides = vec![1; shape.len()];
    for axis in (1..shape.len()).rev() {
        strides[axis - 1] = strides[axis] * shape[axis] as usize;
    }
    strides
}

/// The indices of a chunk, the wanted part of it, and the place of this part in the whole wanted region.
pub(super) type Part = (Vec<u64>, Vec<Range<u64>>, Vec<u64>);

/// Returns the chunks of this shape that have part of `want`.
pub(super) fn parts(want: &[Range<u64>], shape: &[u64]) -> impl Iterator<Item = Part> + use<> {
    let first: Vec<u64> = want.iter().zip(shape).map(|(range, size)| range.start / size).collect();
    let counts: Vec<u64> =
        want.iter().zip(shape).zip(&first).map(|((range, size), first)| range.end.div_ceil(*size) - first).collect();
    let total: u64 = counts.iter().product();
    let (want, shape) = (want.to_vec(), shape.to_vec());
    (0..total).map(move |mut rest| {
        let (mut chunk, mut inner, mut at) = (first.clone(), Vec::new(), Vec::new());
        for axis in (0..counts.len()).rev() {
            chunk[axis] += rest % counts[axis];
            rest /= counts[axis];
        }
        for (axis, index) in chunk.iter().enumerate() {
            let begin = index * shape[axis];
            let (from, to) = (want[axis].start.max(begin), want[axis].end.min(begin + shape[axis]));
            inner.push(from - begin..to - begin);
            at.push(from - want[axis].start);
        }
        (chunk, inner, at)
    })
}

/// Returns the parts of chunks that are chunks of the shape `unit` in them, of one chunk after the other.
pub(super) fn units(want: &[Range<u64>], chunks: &[u64], unit: &[u64]) -> impl Iterator<Item = Part> + use<> {
    let unit = unit.to_vec();
    parts(want, chunks).flat_map(move |(chunk, inner, at)| {
        parts(&inner, &unit).map(move |(_, part, offset)| {
            let range = |n: usize| inner[n].start + offset[n]..inner[n].start + offset[n] + part[n].end - part[n].start;
            (chunk.clone(), (0..at.len()).map(range).collect(), at.iter().zip(&offset).map(|(a, b)| a + b).collect())
        })
    })
}

impl ByteCodec {
    fn of(file: &Path, name: &str, options: &Value) -> Result<Self> {
        Ok(match name.strip_prefix("numcodecs.").unwrap_or(name) {
            "gzip" => Self::Gzip,
            "zlib" => Self::Zlib,
            "zstd" => Self::Zstd,
            "lz4" => Self::Lz4,
            "blosc" => Self::Blosc,
            "crc32c" => Self::Crc32c,
            "shuffle" => match options["elementsize"].as_u64() {
                Some(size @ 1..=64) => Self::Shuffle(size as usize),
                _ => refuse!(file, "shuffle: expected an elementsize of 1 to 64"),
            },
            other => {
                let read = "gzip, zlib, zstd, lz4, blosc, shuffle and crc32c are read";
                refuse!(file, "the codec {other:?} is not read: {read}")
            }
        })
    }

    /// Unpacks bytes by one codec, to `most` at most.
    fn undone(&self, bytes: &[u8], most: usize) -> io::Result<Vec<u8>> {
        let mut content = Vec::new();
        match self {
            Self::Gzip => drop(MultiGzDecoder::new(bytes).take(most as u64).read_to_end(&mut content)?),
            Self::Zlib => drop(ZlibDecoder::new(bytes).take(most as u64).read_to_end(&mut content)?),
            Self::Zstd => content = zstd(bytes, most)?,
            Self::Lz4 => {
                let Some((length, block)) = bytes.split_first_chunk::<4>() else {
                    refuse!(Damage, "LZ4: no length");
                };
                let length = u32::from_le_bytes(*length) as usize;
                // A byte stands for at most 255.
                if length > most || length / 256 > block.len() {
                    refuse!(Damage, "LZ4: {} bytes that hold {length}", block.len());
                }
                content = lz4_flex::block::decompress(block, length).map_err(|e| Damage.error(format!("LZ4: {e}")))?;
            }
            Self::Blosc => content = blosc::decompressed(bytes, most)?,
            Self::Crc32c => {
                let Some((body, sum)) = bytes.split_last_chunk::<4>() else { refuse!(Damage, "no checksum") };
                refuse_if!(crc32c(body) != u32::from_le_bytes(*sum), Damage, "its checksum is wrong");
                content.extend_from_slice(body);
            }
            Self::Shuffle(element) => content = blosc::unshuffled(bytes, *element),
        }
        Ok(content)
    }
}

/// Returns the checksum of Castagnoli.
fn crc32c(bytes: &[u8]) -> u32 {
    let table: [u32; 256] = std::array::from_fn(|n| {
        (0..8).fold(n as u32, |sum, _| if sum & 1 == 1 { sum >> 1 ^ 0x82F6_3B78 } else { sum >> 1 })
    });
    !bytes.iter().fold(u32::MAX, |sum, byte| sum >> 8 ^ table[usize::from(sum as u8 ^ byte)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_rfc_3720() {
        assert_eq!(crc32c(b"123456789"), 0xE306_9283);
        assert_eq!(crc32c(&[0; 32]), 0x8A91_36AA);
    }

    #[test]
    fn parts_cover_what_is_wanted_once() {
        let want = [3..8, 0..5, 2..3];
        let mut seen = vec![0; 25];
        for (chunk, inner, at) in parts(&want, &[4, 2, 9]) {
            for y in inner[0].clone() {
                for x in inner[1].clone() {
                    assert_eq!(inner[2], 2..3);
                    let (a, b) = (chunk[0] * 4 + y - 3, chunk[1] * 2 + x);
                    assert_eq!((a, b), (at[0] + y - inner[0].start, at[1] + x - inner[1].start));
                    seen[(a * 5 + b) as usize] += 1;
                }
            }
        }
        assert_eq!(seen, [1; 25]);
        // Chunks of 6 in pieces of 2: the order is that of the chunks.
        let pieces = units(&[3..8, 0..1], &[6, 1], &[2, 1]);
        let pieces: Vec<_> = pieces.map(|(chunk, inner, at)| (chunk[0], inner[0].clone(), at[0])).collect();
        assert_eq!(pieces, [(0, 3..4, 0), (0, 4..6, 1), (1, 0..2, 3)]);
    }
}
