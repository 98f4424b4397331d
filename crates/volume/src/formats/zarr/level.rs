//! A level of a pyramid, or an array alone, from its chunks.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::codecs::{ChunkTarget, Part, parts, strides_of};
use super::metadata::{Array, MAX_CHUNK};
use super::store::Store;
use crate::error::{Error, Result, Subject, refuse_if};
use crate::formats::LoadOptions;
use crate::formats::coordinates::{Axis, Steps, placement, space};
use crate::formats::decode::{Kind, of_halves};
use crate::formats::selection::{Axes, indices, sized};
use crate::memory::{reserved, samples_in, zeroed};
use crate::parallel::try_map;
use crate::volume::{Contents, Endian, Number, Samples, Units, Volume, with_type};

/// The largest number of chunks that are looked for.
const MAX_CHUNKS: u64 = 1 << 22;

/// The largest number of bytes of chunks that are decompressed at once.
const AT_ONCE: u64 = 1 << 28;

/// The largest number of bytes of a file of chunks that an archive compresses: incompressible chunks, and the index of
/// a shard.
const MAX_PACKED: u64 = 2 * MAX_CHUNK;

/// A level of a pyramid, or an array alone.
pub(super) struct Level {
    pub(super) folder: PathBuf,
    pub(super) array: Array,
    /// The distance between samples along each axis of the array, and the place of the first sample.
    pub(super) scale: Vec<f64>,
    pub(super) translation: Vec<f64>,
}

impl Level {
    /// Makes the level that an array alone is.
    pub(super) fn alone(folder: PathBuf, array: Array) -> Self {
        let axes = array.shape.len();
        Self { folder, array, scale: vec![1.0; axes], translation: vec![0.0; axes] }
    }

    /// Sets the sizes of the axes and the coordinates along them.
    pub(super) fn place(&self, axes: &mut [Axis]) {
        for (n, axis) in axes.iter_mut().enumerate() {
            axis.size = self.array.shape[n];
            axis.steps = Some(Steps::Even { first: self.translation[n], step: self.scale[n] });
        }
    }

    /// Reads the volume of an array with these axes.
    pub(super) fn read(
        &self,
        store: &Store,
        axes: &[Axis],
        contents: Contents,
        options: &LoadOptions,
    ) -> Result<Volume> {
        let Self { folder, array, .. } = self;
        let space = space(axes);
        refuse_if!(!(2..=3).contains(&space.len()), folder, "has {} axes of space, expected 2 or 3", space.len());
        let sizes: Vec<i64> = space.iter().map(|&(axis, _)| sized(array.shape[axis])).collect();
        let (placement, length, note) = placement(axes, &space);
        let grid = placement.grid(folder, &sizes, options.spacing)?;
        let all: Axes = axes.iter().rev().map(|axis| (axis.role, sized(axis.size))).collect();
        let (indices, taken) = indices(folder, &all, options)?;
        let Contents { channel, channels, time, times, .. } = taken;
        let mut contents = Contents { channel, channels, time, times, ..contents };
        contents.notes.extend(note.filter(|_| options.spacing.is_none()));
        if contents.labels.len() != contents.channels as usize {
            contents.labels.clear();
        }
        contents.segments.iter_mut().flatten().for_each(|segment| segment.channel = channel);
        let part = |(size, index): (&u64, Option<u64>)| index.map_or(0..*size, |index| index..index + 1);
        let want: Vec<Range<u64>> = array.shape.iter().zip(indices.into_iter().rev()).map(part).collect();
        let mut strides = vec![0; axes.len()];
        space.iter().fold(1, |stride, &(axis, _)| {
            strides[axis] = stride;
            stride * array.shape[axis] as usize
        });
        let samples = self.stored(store, &want, &strides)?;
        let volume = placement.volume(grid, samples.into())?;
        Ok(volume.with_units(Units { length, value: None }).with_contents(contents))
    }

    /// Reads the part `want` of the array, placed by strides: the numbers of samples from one index of an axis to the
    /// next.
    pub(super) fn stored(&self, store: &Store, want: &[Range<u64>], strides: &[usize]) -> Result<Samples> {
        let Self { folder, array, .. } = self;
        Ok(match array.kind {
            Kind::Whole(sample_type) => {
                with_type!(sample_type, T => T::collected(self.samples::<T>(store, want, strides, array.fill())?))
            }
            Kind::Half => Samples::F32(of_halves(&self.samples(store, want, strides, array.fill())?, folder)?),
        })
    }

    /// Reads the samples of [`Self::stored`], where `fill` stands for chunks that are not there.
    fn samples<T: Number>(&self, store: &Store, want: &[Range<u64>], strides: &[usize], fill: T) -> Result<Vec<T>> {
        let Self { folder, array, .. } = self;
        let count = want.iter().fold(1_u64, |count, range| count.saturating_mul(range.end - range.start));
        let counts = want.iter().zip(&array.chunks).map(|(range, size)| range.end.div_ceil(*size) - range.start / size);
        let chunks = counts.fold(1, u64::saturating_mul);
        refuse_if!(chunks > MAX_CHUNKS, folder, "is in {chunks} chunks, expected at most {MAX_CHUNKS}");
        let mut samples: Vec<T> = zeroed(count, || samples_in(folder))?;
        let largest = array.chunks.iter().product::<u64>() * size_of::<T>() as u64;
        let at_once = (AT_ONCE / largest.max(1)).clamp(1, rayon::current_num_threads() as u64) as usize;
        let mut all = parts(want, &array.chunks);
        loop {
            let batch: Vec<Part> = all.by_ref().take(at_once).collect();
            if batch.is_empty() {
                return Ok(samples);
            }
            let read = |n: usize| {
                let (chunk, inner, _) = &batch[n];
                self.chunk(store, &array.file(folder, chunk), inner, fill)
            };
            let regions: Vec<Option<Vec<T>>> = try_map(batch.len(), read)?;
            for (region, (_, inner, at)) in regions.into_iter().zip(&batch) {
                let Some(region) = region else { continue };
                let shape: Vec<u64> = inner.iter().map(|range| range.end - range.start).collect();
                let all: Vec<Range<u64>> = shape.iter().map(|size| 0..*size).collect();
                let first = at.iter().zip(strides).map(|(n, stride)| *n as usize * stride).sum();
                let mut target = ChunkTarget { samples: &mut samples, first, strides: strides.to_vec() };
                target.place(bytemuck::cast_slice(&region), Endian::NATIVE, &shape, &all);
            }
        }
    }

    /// Reads a part of a chunk; `None` if the chunk is not there and would hold zeros.
    fn chunk<T: Number>(&self, store: &Store, path: &Path, inner: &[Range<u64>], fill: T) -> Result<Option<Vec<T>>> {
        let shape: Vec<u64> = inner.iter().map(|range| range.end - range.start).collect();
        let count: u64 = shape.iter().product();
        let filled = || {
            let mut region: Vec<T> = reserved(count, || samples_in(path))?;
            region.resize(count as usize, fill);
            Ok::<_, Error>(region)
        };
        let Some(bytes) = store.open(path, MAX_PACKED)? else {
            let is_zero = bytemuck::bytes_of(&fill).iter().all(|byte| *byte == 0);
            return if is_zero { Ok(None) } else { filled().map(Some) };
        };
        let mut region = filled()?;
        let mut target = ChunkTarget { samples: &mut region, first: 0, strides: strides_of(&shape) };
        let read = self.array.chain.read(&bytes, (&self.array.chunks, inner), &mut target);
        read.map_err(|source| Error::of_content(path, source))?;
        Ok(Some(region))
    }
}
