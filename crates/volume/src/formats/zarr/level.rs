//! A level of a pyramid, or an array alone, from its chunks.

use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::codecs::{ChunkTarget, Part, strides_of, units};
use super::metadata::{Array, MAX_CHUNK};
use super::store::Store;
use crate::error::{Error, Result, Subject, refuse_if};
#[cfg(feature = "remote")]
use crate::files::remote;
use crate::files::remote::CONNECTIONS;
use crate::formats::LoadOptions;
use crate::formats::coordinates::{Axis, Steps, placement, space};
use crate::formats::decode::{Kind, of_halves};
use crate::formats::selection::{Axes, indices, sized};
use crate::memory::{reserved, samples_in, zeroed};
use crate::parallel::{try_map, try_map_in};
use crate::volume::{Contents, Endian, Number, Samples, Units, Volume, with_type};

/// The largest number of chunks that are looked for.
const MAX_CHUNKS: u64 = 1 << 22;

/// The largest number of bytes of chunks that are decompressed at once.
const AT_ONCE: u64 = 1 << 28;

/// The largest number of bytes of a file of chunks that an archive compresses: incompressible chunks, and the index of
/// a shard.
const MAX_PACKED: u64 = 2 * MAX_CHUNK;

/// The largest number of files at a url whose lengths are asked before they are fetched.
#[cfg(feature = "remote")]
const MAX_ASKED: usize = 256;

/// Whether samples between two places, which are indices along the axes, are needed.
type IsNeeded<'a> = &'a dyn Fn(&[u64], &[u64]) -> bool;

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
        // The axis of the array along x, y and z.
        let along: Vec<usize> = space.iter().map(|&(axis, _)| axis).collect();
        let is_needed = |low: &[u64], high: &[u64]| {
            options.part.is_none_or(|part| {
                let point = |indices: &[u64]| {
                    let index = |n: usize| along.get(n).map_or(0.0, |axis| indices[*axis] as f64);
                    DVec3::new(index(0), index(1), index(2))
                };
                part.touches(point(low), point(high))
            })
        };
        let samples = self.stored(store, &want, &strides, &is_needed)?;
        let volume = placement.volume(grid, samples.into())?;
        Ok(volume.with_units(Units { length, value: None }).with_contents(contents))
    }

    /// Reads the part `want` of the array, placed by strides: the numbers of samples from one index of an axis to the
    /// next. Chunks that are not needed hold the fill value.
    pub(super) fn stored(
        &self,
        store: &Store,
        want: &[Range<u64>],
        strides: &[usize],
        is_needed: IsNeeded<'_>,
    ) -> Result<Samples> {
        let Self { folder, array, .. } = self;
        let place = (want, strides, is_needed);
        Ok(match array.kind {
            Kind::Whole(sample_type) => {
                with_type!(sample_type, T => T::collected(self.samples::<T>(store, place, array.fill())?))
            }
            Kind::Half => Samples::F32(of_halves(&self.samples(store, place, array.fill())?, folder)?),
        })
    }

    /// Reads the samples of [`Self::stored`], where `fill` stands for chunks that are not there.
    fn samples<T: Number>(
        &self,
        store: &Store,
        (want, strides, is_needed): (&[Range<u64>], &[usize], IsNeeded<'_>),
        fill: T,
    ) -> Result<Vec<T>> {
        let Self { folder, array, .. } = self;
        let count = want.iter().fold(1_u64, |count, range| count.saturating_mul(range.end - range.start));
        // Chunks in shards at a url are fetched alone, by threads that wait.
        let is_fetched = store.is_fetched();
        let unit = &*array.chain.inner().filter(|_| is_fetched).unwrap_or(array.chunks.clone());
        let counts = want.iter().zip(unit).map(|(range, size)| range.end.div_ceil(*size) - range.start / size);
        let chunks = counts.fold(1, u64::saturating_mul);
        refuse_if!(chunks > MAX_CHUNKS, folder, "is in {chunks} chunks, expected at most {MAX_CHUNKS}");
        let needed = || {
            units(want, &array.chunks, unit).filter(|(_, inner, at)| {
                let low: Vec<u64> = at.iter().zip(want).map(|(at, want)| at + want.start).collect();
                let high: Vec<u64> =
                    low.iter().zip(inner).map(|(low, inner)| low + inner.end - inner.start - 1).collect();
                is_needed(&low, &high)
            })
        };
        let largest = unit.iter().product::<u64>() * size_of::<T>() as u64;
        let total = needed().count();
        #[cfg(feature = "remote")]
        if is_fetched {
            self.check_size(store, needed(), (total as u64, largest), unit)?;
        }
        let mut samples: Vec<T> = zeroed(count, || samples_in(folder))?;
        if bytemuck::bytes_of(&fill).iter().any(|byte| *byte != 0) {
            samples.fill(fill);
        }
        // Fewer waits for the last thread of a batch.
        let most = if is_fetched { 4 * CONNECTIONS } else { rayon::current_num_threads() };
        let at_once = (AT_ONCE / largest.max(1)).clamp(1, most as u64) as usize;
        let (mut all, mut done, mut found) = (needed(), 0, 0);
        while done < total {
            let batch: Vec<Part> = all.by_ref().take(at_once).collect();
            let read = |n: usize| {
                let (chunk, inner, _) = &batch[n];
                self.chunk(store, &array.file(folder, chunk), inner, fill)
            };
            let regions: Vec<Option<Vec<T>>> = match is_fetched {
                true => try_map_in(CONNECTIONS, batch.len(), read)?,
                false => try_map(batch.len(), read)?,
            };
            for (region, (_, inner, at)) in regions.into_iter().zip(&batch) {
                let Some(region) = region else { continue };
                found += 1;
                let shape: Vec<u64> = inner.iter().map(|range| range.end - range.start).collect();
                let all: Vec<Range<u64>> = shape.iter().map(|size| 0..*size).collect();
                let first = at.iter().zip(strides).map(|(n, stride)| *n as usize * stride).sum();
                let mut target = ChunkTarget { samples: &mut samples, first, strides: strides.to_vec() };
                target.place(bytemuck::cast_slice(&region), Endian::NATIVE, &shape, &all);
            }
            done += batch.len();
            store.report(folder, [done, found, total])?;
        }
        Ok(samples)
    }

    /// Refuses chunks whose files at a url are larger than the limit: by the number of chunks and their bytes without
    /// compression, and if that is too many, by the lengths of files that are spread evenly.
    #[cfg(feature = "remote")]
    fn check_size(
        &self,
        store: &Store,
        needed: impl Iterator<Item = Part>,
        (total, largest): (u64, u64),
        unit: &[u64],
    ) -> Result<()> {
        let Self { folder, array, .. } = self;
        let bound = total.saturating_mul(largest);
        if remote::check_limit(folder, bound, "").is_ok() {
            return Ok(());
        }
        // Every step-th file, with the number of chunks that are needed of it.
        let (mut files, mut step, mut count, mut last) = (Vec::<(Vec<u64>, u64)>::new(), 1, 0, None);
        for (chunk, ..) in needed {
            if last.as_ref() != Some(&chunk) {
                if count % step == 0 {
                    files.push((chunk.clone(), 0));
                }
                count += 1;
                last = Some(chunk.clone());
                if files.len() == 2 * MAX_ASKED {
                    let mut keep = [true, false].into_iter().cycle();
                    files.retain(|_| keep.next() == Some(true));
                    step *= 2;
                }
            }
            if let Some((_, units)) = files.last_mut().filter(|(of, _)| *of == chunk) {
                *units += 1;
            }
        }
        let sizes = try_map_in(CONNECTIONS, files.len(), |n| store.size(&array.file(folder, &files[n].0)))?;
        let (mut bytes, mut asked) = (0.0, 0);
        for (size, (chunk, units)) in sizes.into_iter().zip(&files).filter_map(|(size, file)| Some((size?, file))) {
            let inside = |axis: usize| (array.shape[axis] - chunk[axis] * array.chunks[axis]).min(array.chunks[axis]);
            let all: u64 = (0..unit.len()).map(|axis| inside(axis).div_ceil(unit[axis])).product();
            bytes += size as f64 * *units as f64 / all as f64;
            asked += units;
        }
        match asked {
            0 => remote::check_limit(folder, bound, "up to "),
            _ => remote::check_limit(folder, (bytes * total as f64 / asked as f64) as u64, "about "),
        }
    }

    /// Reads a part of a chunk; `None` if the chunk is not there.
    fn chunk<T: Number>(&self, store: &Store, path: &Path, inner: &[Range<u64>], fill: T) -> Result<Option<Vec<T>>> {
        let Some(bytes) = store.open(path, MAX_PACKED)? else { return Ok(None) };
        let shape: Vec<u64> = inner.iter().map(|range| range.end - range.start).collect();
        let count: u64 = shape.iter().product();
        let mut region: Vec<T> = reserved(count, || samples_in(path))?;
        region.resize(count as usize, fill);
        let mut target = ChunkTarget { samples: &mut region, first: 0, strides: strides_of(&shape) };
        match self.array.chain.read(&bytes, (&self.array.chunks, inner), &mut target) {
            Ok(()) => Ok(Some(region)),
            Err(source) if source.kind() == ErrorKind::NotFound => Ok(None),
            Err(source) => Err(Error::of_content(path, source)),
        }
    }
}
