//! The samples of a volume that the device holds for any transfer function: of all bricks, or only of the bricks that
//! may be visible if these are few.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use super::recorder::Recorder;
use super::samples::{BATCH, BrickBatch, Input};
use crate::error::Result;
use crate::transfer::scalars::Reduction;
use crate::volume::BRICK_EDGE as EDGE;

/// The samples of a volume on the device.
#[derive(Default)]
pub(crate) struct HeldSamples(Mutex<Option<(SamplesKey, Arc<HeldBricks>)>>);

/// The format of samples on the device: their type, their reduction and the voxels around each brick.
type SamplesKey = (u32, Option<Reduction>, usize);

/// A set of bricks of a volume: whether it contains each brick, x fastest.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct BrickSet(Vec<bool>);

/// Bricks whose samples the device holds.
pub(super) struct HeldBricks {
    set: BrickSet,
    /// The number of bytes of the samples of a brick.
    of_brick: u64,
    pub(super) buffers: Vec<HeldBuffer>,
}

/// The bricks whose samples share a buffer.
pub(super) struct HeldBuffer {
    /// The bricks of the volume that are in this buffer if they are held. The ranges of all buffers join.
    pub(super) bricks: Range<u32>,
    pub(super) samples: wgpu::Buffer,
    pub(super) batches: Vec<BrickBatch>,
    /// The number in the volume of each held brick of the buffer, then the place in the buffer of each brick of the
    /// range, or [`ABSENT`].
    pub(super) index: wgpu::Buffer,
}

/// The place of a brick that is not held; ABSENT in shaders/common/sampled.wgsl.
pub(super) const ABSENT: u32 = u32::MAX;

impl BrickSet {
    fn count(&self) -> usize {
        self.0.iter().filter(|&&is_held| is_held).count()
    }

    fn has(&self, brick: u32) -> bool {
        self.0[brick as usize]
    }

    /// Returns the set, or all bricks if the set saves little memory: then another transfer function sends no samples.
    /// `is_first` if the device holds none yet.
    fn or_all(self, input: &Input<'_>, is_first: bool) -> Self {
        let counts = [self.count(), self.0.len()].map(|count| count as u64);
        let saves = saves(counts, input.brick_bytes(), input.context.savings.paged_bytes, is_first);
        if saves { self } else { Self(vec![true; self.0.len()]) }
    }
}

/// Returns whether holding `count` of `all` bricks is worthwhile: all bricks are `SAVES` times as many or exceed
/// [`HeldSamples::MOST`]. If all take less than `paged_bytes`, the first picture sends only what shows, and the next
/// transfer function the rest.
fn saves([count, all]: [u64; 2], brick_bytes: u64, paged_bytes: u64, is_first: bool) -> bool {
    /// The least factor by which a set takes less memory than all bricks.
    const SAVES: u64 = 4;
    let bytes = all * brick_bytes;
    if bytes < paged_bytes { is_first } else { SAVES * count <= all || bytes > HeldSamples::MOST }
}

impl Input<'_> {
    /// Returns the set of all bricks.
    pub(crate) fn all_bricks(&self) -> BrickSet {
        BrickSet(vec![true; self.brick_count()])
    }

    /// Returns the bricks whose samples pictures need: the bricks that may be visible.
    pub(crate) fn needed_bricks(&self) -> Result<BrickSet> {
        Ok(BrickSet(self.volume.ranges()?.iter().map(|&range| self.may_show(range)).collect()))
    }

    /// Returns the number of bytes of the samples of some bricks.
    pub(crate) fn bytes_of(&self, bricks: &BrickSet) -> u64 {
        bricks.count() as u64 * self.brick_bytes()
    }

    /// Returns the lattice point of the first voxel of a brick.
    fn origin(&self, brick: u32) -> [u32; 4] {
        let [across, down, _] = self.volume.bricks();
        let at = [brick % across, brick / across % down, brick / (across * down)];
        let [x, y, z] = at.map(|n| n * EDGE as u32);
        [x, y, z, 0]
    }

    /// Returns the number of the brick that begins at a lattice point.
    pub(super) fn brick_number(&self, [x, y, z, _]: [u32; 4]) -> u32 {
        let [across, down, _] = self.volume.bricks();
        (x + across * (y + down * z)) / EDGE as u32
    }

    /// Returns whether a buffer can hold a row of bricks along x.
    fn has_room_for_rows(&self) -> bool {
        let [row, ..] = self.volume.bricks();
        u64::from(row) * self.brick_bytes() <= self.context.largest_buffer()
    }

    /// Returns the bricks of the volume that each buffer serves: whole rows along x, if a buffer can hold a row.
    fn ranges_of_buffers(&self, set: &BrickSet) -> Vec<Range<u32>> {
        let most = (self.context.largest_buffer() / self.brick_bytes()).max(1);
        let [row, ..] = self.volume.bricks();
        let together = if self.has_room_for_rows() { row } else { 1 };
        let all = set.0.len() as u32;
        let (mut ranges, mut start, mut held) = (Vec::new(), 0, 0);
        for first in (0..all).step_by(together as usize) {
            let own = (first..all.min(first + together)).filter(|&brick| set.has(brick)).count() as u64;
            if held + own > most {
                ranges.push(start..first);
                (start, held) = (first, 0);
            }
            held += own;
        }
        if held > 0 {
            ranges.push(start..all);
        }
        ranges
    }
}

impl HeldSamples {
    /// The largest number of bytes of samples that stay on the device when the transfer function changes.
    pub(super) const MOST: u64 = 4 << 30;

    /// Returns whether the samples of these bricks may stay on the device: at most [`Self::MOST`] bytes, with whole
    /// rows of bricks in each buffer.
    pub(crate) fn fits(input: &Input<'_>, bricks: &BrickSet) -> bool {
        input.bytes_of(bricks) <= Self::MOST && input.has_room_for_rows()
    }

    /// Returns the number of bytes of the samples on the device.
    #[cfg(test)]
    pub(super) fn bytes(&self) -> u64 {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map_or(0, |(_, held)| held.bytes())
    }

    /// Calls `work` with these bricks and all bricks that were held before, or with all bricks of the volume. Sends the
    /// samples first that the device does not hold; also returns the bytes that were sent.
    pub(super) fn with<T>(
        &self,
        input: &Input<'_>,
        BrickSet(mut needed): BrickSet,
        work: impl FnOnce(&Arc<HeldBricks>) -> Result<T>,
    ) -> Result<(T, u64)> {
        let key = (input.coding.sample_type, input.coding.reduction, input.halo());
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Not locked meanwhile: reading samples waits for a pool of threads, which may hand over work that takes the
        // lock.
        let before = lock().take();
        // A brick is sent once, however often transfer functions hide it and show it again. Boxes that were packed from
        // samples have no voxels of other bricks, so that they can be packed over.
        let held = before.iter().flat_map(|(_, held)| &held.set.0);
        needed.iter_mut().zip(held).for_each(|(needed, held)| *needed |= held);
        let needed = BrickSet(needed);
        // Samples in another format are dropped first, so that both are never in memory together.
        let before = before.filter(|(of, _)| *of == key).map(|(_, held)| held);
        let (held, bytes) = match before {
            Some(held) if held.set == needed => (held, 0),
            before => {
                let set = needed.or_all(input, before.is_none());
                let (held, bytes) = HeldBricks::send(input, set, before.as_deref())?;
                (Arc::new(held), bytes)
            }
        };
        let result = work(&held)?;
        *lock() = Some((key, held));
        Ok((result, bytes))
    }
}

/// A buffer of samples and the place of a brick in it, in bytes.
type Place<'a> = (&'a wgpu::Buffer, u64);

impl HeldBricks {
    /// Holds the samples of a set of bricks: copies samples that `before` holds and sends the others. Also returns the
    /// bytes that were sent.
    fn send(input: &Input<'_>, set: BrickSet, before: Option<&Self>) -> Result<(Self, u64)> {
        let made = Self::without_samples(input, set)?;
        let (of_brick, to) = (made.of_brick, made.places());
        let from = before.map(Self::places).unwrap_or_default();
        let kept = |brick: usize| from.get(brick).copied().flatten();
        let mut recorder = Recorder::untimed(input.context);
        let both = to.iter().enumerate().filter_map(|(brick, &to)| Some([kept(brick)?, to?]));
        copy_bricks(&mut recorder, of_brick, both);
        recorder.submit();
        let lacks = |brick: usize, _| to[brick].is_some() && kept(brick).is_none();
        let sent = input.send(&lacks, &mut |outbox| {
            let bricks: Vec<u32> = outbox.origins.iter().map(|&origin| input.brick_number(origin)).collect();
            outbox.send(|recorder, staging| {
                let place = |(number, &brick): (u64, &u32)| Some([(staging, number * of_brick), to[brick as usize]?]);
                copy_bricks(recorder, of_brick, (0..).zip(&bricks).filter_map(place));
            })
        })?;
        Ok((made, sent.bytes))
    }

    /// Allocates buffers for the samples of a set of bricks.
    fn without_samples(input: &Input<'_>, set: BrickSet) -> Result<Self> {
        let (context, of_brick) = (input.context, input.brick_bytes());
        let buffer = |bricks: Range<u32>| {
            let held: Vec<u32> = bricks.clone().filter(|&brick| set.has(brick)).collect();
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
            let samples = context.buffer("classify.samples", held.len() as u64 * of_brick, usage)?;
            let mut places = vec![ABSENT; bricks.len()];
            for (place, &brick) in (0..).zip(&held) {
                places[(brick - bricks.start) as usize] = place;
            }
            let index = [held.as_slice(), &places].concat();
            let index = context.upload("classify.index", bytemuck::cast_slice(&index), wgpu::BufferUsages::COPY_SRC)?;
            let batch = |(number, bricks): (usize, &[u32])| {
                let origins = bricks.iter().map(|&brick| input.origin(brick)).collect();
                BrickBatch::new(input, origins, (samples.clone(), number * BATCH))
            };
            let batches = held.chunks(BATCH).enumerate().map(batch).collect::<Result<_>>()?;
            Ok(HeldBuffer { bricks, samples, batches, index })
        };
        let buffers = input.ranges_of_buffers(&set).into_iter().map(buffer).collect::<Result<_>>()?;
        Ok(Self { set, of_brick, buffers })
    }

    /// Returns the places of all bricks of the volume; `None` for bricks that are not held.
    fn places(&self) -> Vec<Option<Place<'_>>> {
        let mut places = vec![None; self.set.0.len()];
        for HeldBuffer { bricks, samples, .. } in &self.buffers {
            let held = bricks.clone().filter(|&brick| self.set.has(brick));
            for (number, brick) in (0..).zip(held) {
                places[brick as usize] = Some((samples, number * self.of_brick));
            }
        }
        places
    }

    /// Returns the number of bytes of the samples on the device.
    pub(super) fn bytes(&self) -> u64 {
        self.set.count() as u64 * self.of_brick
    }
}

impl HeldBuffer {
    /// Returns the number of bricks in the buffer.
    pub(super) fn count(&self) -> usize {
        self.batches.iter().map(|batch| batch.origins.len()).sum()
    }
}

/// Records copies of bricks from places to places, with one copy for bricks that follow one another in both.
fn copy_bricks<'a>(recorder: &mut Recorder<'_>, of_brick: u64, copies: impl Iterator<Item = [Place<'a>; 2]>) {
    let mut run: Option<([Place<'a>; 2], u64)> = None;
    let mut copy = |run: Option<([Place<'a>; 2], u64)>| {
        if let Some(([from, to], bytes)) = run {
            recorder.copy_part(from, to, bytes);
        }
    };
    for places in copies {
        run = match run {
            Some((first, bytes)) if first.map(|(buffer, at)| (buffer, at + bytes)) == places => {
                Some((first, bytes + of_brick))
            }
            before => {
                copy(before);
                Some((places, of_brick))
            }
        };
    }
    copy(run);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_bricks_of_many_are_held_alone() {
        let brick = 36_u64.pow(3);
        let of = |count, all| saves([count, all], brick, 128 << 20, false);
        // A volume of 256^3, one of 1024^3 and one of 2048^3 voxels.
        assert!(!of(1, 1 << 9) && of(1 << 13, 1 << 15) && !of((1 << 13) + 1, 1 << 15));
        assert!(of(1 << 17, 1 << 18) && (brick << 18) > HeldSamples::MOST);
        // The first picture of the smallest one.
        assert!(saves([1 << 8, 1 << 9], brick, 128 << 20, true) && !saves([1 << 14, 1 << 15], brick, 128 << 20, true));
    }
}
