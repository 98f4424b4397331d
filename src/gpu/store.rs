//! Splats on the device, brick after brick.

use std::any::Any;
use std::fmt;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::cache::Cache;
use super::context::Context;
use super::layout::{MACROCELL, MAX_BRICKS, place};
use super::recorder::Recorder;
use super::sampled_scalars::SampledScalars;
use super::samples::Bricks;
use super::sender::Sender;
use crate::error::Result;
use crate::progress::Progress;
use crate::splats::brick::{BrickSplats, HostBrick, MadeBrick, PAGE, places};
use crate::volume::{BRICK_EDGE as EDGE, Volume};
use voxsplat_volume::memory::reserved;

const _: () = assert!(PAGE == MACROCELL, "pages of bricks are macrocells of shaders");

/// Splats that fit into one buffer and into a storage binding.
#[derive(Debug)]
pub(crate) struct Store {
    splats: Mutex<Splats>,
    /// The number that distinguishes the store from others of the program.
    pub(crate) id: u64,
    /// A number that stores share whose splats have the same places.
    pub(crate) places: u64,
    /// The number of bytes of a splat on the device.
    pub(crate) stride: u64,
    pub(crate) count: u32,
    /// The lattice points and levels of the bricks that splats name, as shaders read them.
    pub(crate) origins: wgpu::Buffer,
    pub(crate) bricks: Vec<BrickSplats>,
}

/// The memory that holds splats.
#[derive(Debug)]
pub(crate) enum Splats {
    Listed(wgpu::Buffer),
    /// A source that the device holds and that can make the splats.
    Unlisted(Arc<dyn Unlisted>),
}

/// A source of splats, which makes a list of them when one is read.
pub(crate) trait Unlisted: Any + Send + Sync {
    /// Makes the list of splats on the device.
    fn list(&self, context: &Context) -> Result<wgpu::Buffer>;

    /// Returns the bytes of device memory of the source.
    fn bytes(&self) -> u64;
}

impl fmt::Debug for dyn Unlisted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Unlisted")
    }
}

/// Converts the splats of a brick to the format of the device, `stride` bytes each, for the brick `number` of a store.
fn on_device(brick: &HostBrick, stride: u64, number: u32) -> Result<Vec<u32>> {
    let words = stride as usize / 4;
    let mut splats = reserved(u64::from(brick.count()) * words as u64, || "splats of a brick".to_owned())?;
    for (at, &row) in brick.rows.iter().enumerate().filter(|(_, row)| row.bits != 0) {
        for (splat, x) in places(row.bits).enumerate() {
            splats.push(place([x, at % EDGE, at / EDGE].map(|place| place as u32), number));
            splats.extend(brick.words(row, splat));
            splats.resize(splats.len().next_multiple_of(words), 0);
        }
    }
    Ok(splats)
}

/// The largest number of bytes of splats that are sent to the device at a time.
const SENT: u64 = 32 << 20;
/// The work in words that complete errors: "while ...".
const DOING: &str = "sending splats";

/// Sends `count` splats to the device, `stride` bytes each.
fn upload(context: &Context, bricks: &[HostBrick], stride: u64, count: u32) -> Result<wgpu::Buffer> {
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let buffer = context.buffer("store.splats", u64::from(count) * stride, usage)?;
    // Parts of whole bricks, each with its first byte and those of its bricks.
    let ends = bricks.iter().scan(0, |end, brick| {
        *end += u64::from(brick.count()) * stride;
        Some(*end)
    });
    let ends: Vec<u64> = ends.collect();
    let start_of = |brick: usize| if brick == 0 { 0 } else { ends[brick - 1] };
    let mut parts: Vec<Range<usize>> = Vec::new();
    for (brick, &end) in ends.iter().enumerate() {
        match parts.last_mut() {
            Some(part) if end - start_of(part.start) <= SENT => part.end = brick + 1,
            _ => parts.push(brick..brick + 1),
        }
    }
    let bytes = |part: &Range<usize>| ends[part.end - 1] - start_of(part.start);
    let most = parts.iter().map(bytes).max().unwrap_or_default();
    let mut sender = Sender::new(context, DOING, most, parts.len())?;
    let mut recorder = Recorder::untimed(context);
    for part in parts {
        let (first, bytes) = (start_of(part.start), bytes(&part));
        let fill = |staging: &wgpu::Buffer| {
            part.into_par_iter().try_for_each(|brick| {
                let splats = on_device(&bricks[brick], stride, brick as u32)?;
                context.write_mapped(DOING, staging, start_of(brick) - first, bytemuck::cast_slice(&splats))
            })
        };
        sender.send(&mut recorder, fill, |recorder, staging| recorder.copy(staging, &buffer, first, bytes))?;
    }
    Ok(buffer)
}

/// The number of stores made so far.
static MADE: AtomicU64 = AtomicU64::new(0);

impl Store {
    /// Makes a store of splats, with the origins of their bricks on the device; `None`: the origins are sent.
    pub(crate) fn new(
        context: &Context,
        (splats, origins): (Splats, Option<wgpu::Buffer>),
        stride: u64,
        count: u32,
        bricks: Vec<BrickSplats>,
    ) -> Result<Self> {
        let send = || {
            let place = |b: &BrickSplats| [b.origin[0], b.origin[1], b.origin[2], b.level];
            let places: Vec<[u32; 4]> = bricks.iter().map(place).collect();
            context.upload("splats.origins", bytemuck::cast_slice(&places), wgpu::BufferUsages::STORAGE)
        };
        let origins = origins.map_or_else(send, Ok)?;
        let id = MADE.fetch_add(1, Ordering::Relaxed);
        Ok(Self { splats: Mutex::new(splats), id, places: id, stride, count, origins, bricks })
    }

    /// Returns the splats on the device, and makes their list if there is none: shaders/common/splat.wgsl.
    pub(crate) fn on_device(&self, context: &Context) -> Result<wgpu::Buffer> {
        let mut splats = self.splats.lock().unwrap_or_else(PoisonError::into_inner);
        let buffer = match &*splats {
            Splats::Listed(buffer) => return Ok(buffer.clone()),
            Splats::Unlisted(source) => source.list(context)?,
        };
        *splats = Splats::Listed(buffer.clone());
        Ok(buffer)
    }

    /// Reads the words of the splats back to the host.
    pub(crate) fn words(&self, context: &Context) -> Result<Vec<u32>> {
        let buffer = self.on_device(context)?;
        let mut recorder = Recorder::untimed(context);
        let read = recorder.read_back("store.words", &buffer, u64::from(self.count) * self.stride)?;
        recorder.submit();
        read.values(context, "reading splats")
    }

    /// Makes a store of splats of these words, `stride` bytes each, in the bricks of this one.
    pub(crate) fn with_words(&self, context: &Context, words: &[u32], stride: u64) -> Result<Self> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let buffer = context.upload("store.splats", bytemuck::cast_slice(words), usage)?;
        let splats = (Splats::Listed(buffer), Some(self.origins.clone()));
        Self::new(context, splats, stride, self.count, self.bricks.clone())
    }

    /// Makes a store for other splats at the same places, in the device memory of these splats.
    pub(crate) fn over(self, context: &Context) -> Result<Self> {
        let buffer = self.on_device(context)?;
        let Self { places, stride, count, origins, bricks, .. } = self;
        let made = Self::new(context, (Splats::Listed(buffer), Some(origins)), stride, count, bricks)?;
        Ok(Self { places, ..made })
    }

    /// Returns the source of the splats; `None` if they are listed.
    pub(crate) fn unlisted(&self) -> Option<Arc<dyn Unlisted>> {
        match &*self.splats.lock().unwrap_or_else(PoisonError::into_inner) {
            Splats::Unlisted(source) => Some(Arc::clone(source)),
            Splats::Listed(_) => None,
        }
    }

    /// Returns all bricks with the numbers of their splats.
    pub(crate) fn all_runs(&self) -> impl Iterator<Item = (&BrickSplats, Range<u32>)> {
        let ends = self.bricks.iter().skip(1).map(|next| next.first).chain([self.count]);
        self.bricks.iter().zip(ends).map(|(brick, end)| (brick, brick.first..end))
    }

    /// Returns the bricks that have splats, with the numbers of their splats.
    pub(crate) fn runs(&self) -> impl Iterator<Item = (&BrickSplats, Range<u32>)> {
        self.all_runs().filter(|(_, run)| !run.is_empty())
    }

    /// Returns the bytes of device memory of the splats and the origins.
    pub(crate) fn bytes(&self) -> u64 {
        let splats = match &*self.splats.lock().unwrap_or_else(PoisonError::into_inner) {
            Splats::Listed(buffer) => buffer.size(),
            Splats::Unlisted(source) => source.bytes(),
        };
        splats + self.origins.size()
    }
}

/// Splats to be joined into a store.
pub(crate) trait StorePart: Sized {
    /// Joins parts into `count` splats of `stride` bytes each. Also returns the origins of their bricks if the device
    /// has them.
    fn join(context: &Context, parts: Vec<Self>, stride: u64, count: u32) -> Result<(Splats, Option<wgpu::Buffer>)>;
}

impl StorePart for HostBrick {
    fn join(context: &Context, parts: Vec<Self>, stride: u64, count: u32) -> Result<(Splats, Option<wgpu::Buffer>)> {
        Ok((Splats::Listed(upload(context, &parts, stride, count)?), None))
    }
}

/// The splats of a volume, or of a level of it.
#[derive(Default)]
pub(crate) struct Drawable {
    pub(crate) stores: Vec<Store>,
    /// Scalars that no store lists, and the number that takes the place of [`Store::id`].
    pub(crate) scalars: Option<(Arc<SampledScalars>, u64)>,
    pub(crate) bricks: Bricks,
    /// Number of splats that are copies of voxels beyond the faces of the volume.
    pub(crate) copies: u64,
    /// Resources that painters made of the splats.
    pub(crate) kept: Arc<Cache>,
}

impl Drawable {
    /// Makes the drawable of scalars that no store lists.
    pub(crate) fn of_scalars(scalars: SampledScalars, bricks: Bricks) -> Self {
        let copies = scalars.copies();
        let scalars = Some((Arc::new(scalars), MADE.fetch_add(1, Ordering::Relaxed)));
        Self { scalars, bricks, copies, ..Self::default() }
    }

    pub(crate) fn splats(&self) -> u64 {
        let listed: u64 = self.stores.iter().map(|store| u64::from(store.count)).sum();
        listed + self.scalars.as_ref().map_or(0, |(scalars, _)| scalars.count())
    }

    /// Returns the bytes of device memory of splats and scalars.
    pub(crate) fn bytes(&self) -> u64 {
        let listed: u64 = self.stores.iter().map(Store::bytes).sum();
        listed + self.scalars.as_ref().map_or(0, |(scalars, _)| scalars.bytes())
    }
}

/// A builder that joins the splats of bricks into few stores, each within a storage binding and within the number of
/// bricks that a place can name.
pub(crate) struct StoreBuilder<'a, P> {
    context: &'a Context,
    /// The number of bytes of a splat.
    stride: u64,
    /// The largest number of splats of a store.
    limit: u32,
    /// The parts of the next store.
    parts: Vec<P>,
    bricks: Vec<BrickSplats>,
    held: u32,
    made: Drawable,
}

impl<'a, P: StorePart> StoreBuilder<'a, P> {
    /// Builds stores of at most `limit` splats of `stride` bytes, or as many as the adapter binds.
    pub(crate) fn new(context: &'a Context, stride: u64, limit: u32) -> Self {
        let bindable = context.largest_buffer() / stride;
        let limit = u32::try_from(bindable).unwrap_or(u32::MAX).min(limit);
        Self { context, stride, limit, parts: Vec::new(), bricks: Vec::new(), held: 0, made: Drawable::default() }
    }

    /// Returns the numbers of the first brick and the first splat of the next part in its store. The part is added
    /// next.
    pub(crate) fn make_room(&mut self, splats: u32, bricks: usize) -> Result<(u32, u32)> {
        let full = self.held.checked_add(splats).is_none_or(|sum| sum > self.limit);
        if full || self.bricks.len() + bricks > MAX_BRICKS {
            self.close()?;
        }
        Ok((self.bricks.len() as u32, self.held))
    }

    /// Returns the number of stores before the one that takes the next part.
    pub(crate) fn closed(&self) -> usize {
        self.made.stores.len()
    }

    pub(crate) fn add(&mut self, part: P, count: u32, bricks: impl IntoIterator<Item = BrickSplats>) {
        self.parts.push(part);
        self.bricks.extend(bricks);
        self.held += count;
    }

    fn close(&mut self) -> Result<()> {
        let (parts, bricks) = (std::mem::take(&mut self.parts), std::mem::take(&mut self.bricks));
        let held = std::mem::take(&mut self.held);
        if !parts.is_empty() {
            let splats = P::join(self.context, parts, self.stride, held)?;
            self.made.stores.push(Store::new(self.context, splats, self.stride, held, bricks)?);
        }
        Ok(())
    }

    pub(crate) fn finish(mut self) -> Result<Drawable> {
        self.close()?;
        Ok(self.made)
    }
}

impl StoreBuilder<'_, HostBrick> {
    /// Adds a brick that may have splats.
    pub(crate) fn push(&mut self, MadeBrick { brick, splats, copies }: MadeBrick) -> Result<()> {
        let count = splats.count();
        self.made.bricks.uploaded += 1;
        self.made.bricks.bytes += u64::from(count) * self.stride;
        self.made.copies += copies;
        if count > 0 {
            let (_, first) = self.make_room(count, 1)?;
            self.add(splats, count, [BrickSplats { first, ..brick }]);
        }
        Ok(())
    }

    /// Adds the bricks of a lattice of `across`, `down` and `deep` bricks. `row` makes, in parallel, the bricks along x
    /// with these numbers in y and z, from the samples of bricks of a volume with this halo.
    pub(crate) fn push_rows(
        &mut self,
        volume: &Volume,
        [across, down, deep]: [usize; 3],
        halo: usize,
        (progress, doing): (&Progress, &'static str),
        row: &(dyn Fn(usize, usize) -> Result<Vec<MadeBrick>> + Sync),
    ) -> Result<()> {
        self.made.bricks.all += (across * down * deep) as u32;
        let mut rows = 0;
        volume.for_each_row([down, deep], halo, row, &mut |made| {
            made.into_iter().try_for_each(|brick| self.push(brick))?;
            rows += 1;
            progress.report(doing, f64::from(rows) / (down * deep) as f64);
            progress.check()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_equal_splats_share_their_words() {
        // Two splats in each row of a plane: all rows but one are equal.
        let mut bits = vec![0; EDGE * EDGE];
        bits[..EDGE].fill(0b101);
        let odd = |row: usize, of: usize| u32::from(row == of);
        let words: Vec<u32> = (0..EDGE).flat_map(|row| [7 + odd(row, 3), 8, 9, 10]).collect();
        let brick = HostBrick::new(&bits, 2, words.clone());
        assert_eq!((brick.bytes() - 12 * (EDGE * EDGE) as u64, brick.count()), (4 * 12, 2 * EDGE as u32));
        // The device gets all words of all splats.
        let splats = on_device(&brick, 12, 0).unwrap();
        assert_eq!(splats.len(), 2 * EDGE * 3);
        let without_places = splats.chunks_exact(3).flat_map(|splat| splat[1..].to_vec());
        assert!(without_places.eq(words));
        let run = |row: usize| brick.runs(row, 0).map(|(run, count)| (run.column(0), count)).next();
        let (column, count) = run(3).unwrap();
        assert_eq!((column[0], column[1], count), (8, 9, 2));
        assert_eq!(run(4).unwrap().0[..2], [7, 9]);
    }
}
