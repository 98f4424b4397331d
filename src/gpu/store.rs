//! Lists of splats on the device, brick after brick, for the painter `quads`.

use std::ops::Range;

use super::context::Context;
use super::layout::{MACROCELL, MAX_BRICKS, place};
use super::recorder::Recorder;
use super::samples::Bricks;
use super::sender::send_bricks;
use crate::error::Result;
use crate::progress::Progress;
use crate::splats::brick::{BrickSplats, HostBrick, MadeBrick, PAGE, places};
use crate::volume::{BRICK_EDGE as EDGE, Volume};
use voxsplat_volume::memory::reserved;

const _: () = assert!(PAGE == MACROCELL, "pages of bricks are macrocells of shaders");

/// Splats that fit into one buffer and into a storage binding.
#[derive(Debug)]
pub(crate) struct Store {
    /// The splats in the format of shaders/common/splat.wgsl.
    pub(crate) splats: wgpu::Buffer,
    /// The number of bytes of a splat on the device.
    pub(crate) stride: u64,
    pub(crate) count: u32,
    /// The lattice points and levels of the bricks that splats name, as shaders read them.
    pub(crate) origins: wgpu::Buffer,
    pub(crate) bricks: Vec<BrickSplats>,
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

impl Store {
    /// Makes a store of splats in these bricks, whose places are sent.
    pub(crate) fn new(
        context: &Context,
        splats: wgpu::Buffer,
        stride: u64,
        count: u32,
        bricks: Vec<BrickSplats>,
    ) -> Result<Self> {
        let place = |b: &BrickSplats| [b.origin[0], b.origin[1], b.origin[2], b.level];
        let places: Vec<[u32; 4]> = bricks.iter().map(place).collect();
        let origins = context.upload("splats.origins", bytemuck::cast_slice(&places), wgpu::BufferUsages::STORAGE)?;
        Ok(Self { splats, stride, count, origins, bricks })
    }

    /// Reads the words of the splats back to the host.
    pub(crate) fn words(&self, context: &Context) -> Result<Vec<u32>> {
        let mut recorder = Recorder::untimed(context);
        let read = recorder.read_back("store.words", &self.splats, u64::from(self.count) * self.stride)?;
        recorder.submit();
        read.values(context, "reading splats")
    }

    /// Returns the bricks that have splats, with the numbers of their splats.
    pub(crate) fn runs(&self) -> impl Iterator<Item = (&BrickSplats, Range<u32>)> {
        let ends = self.bricks.iter().skip(1).map(|next| next.first).chain([self.count]);
        let all = self.bricks.iter().zip(ends).map(|(brick, end)| (brick, brick.first..end));
        all.filter(|(_, run)| !run.is_empty())
    }

    /// Returns the bytes of device memory of the splats and the origins.
    pub(crate) fn bytes(&self) -> u64 {
        self.splats.size() + self.origins.size()
    }
}

/// A builder that joins the splats of bricks into few stores, each within a storage binding and within the number of
/// bricks that a place can name.
pub(crate) struct StoreBuilder<'a> {
    context: &'a Context,
    /// The number of bytes of a splat.
    stride: u64,
    /// The largest number of splats of a store.
    limit: u32,
    /// The parts of the next store.
    parts: Vec<HostBrick>,
    bricks: Vec<BrickSplats>,
    held: u32,
    made: Stores,
}

/// Stores, and the bricks that were searched for their splats.
#[derive(Default)]
pub(crate) struct Stores {
    pub(crate) stores: Vec<Store>,
    pub(crate) bricks: Bricks,
    /// Number of splats that are copies of voxels beyond the faces of the volume.
    pub(crate) copies: u64,
}

impl<'a> StoreBuilder<'a> {
    /// Builds stores of splats of `stride` bytes, as many as the adapter binds.
    pub(crate) fn new(context: &'a Context, stride: u64) -> Self {
        let limit = u32::try_from(context.largest_buffer() / stride).unwrap_or(u32::MAX);
        Self { context, stride, limit, parts: Vec::new(), bricks: Vec::new(), held: 0, made: Stores::default() }
    }

    fn close(&mut self) -> Result<()> {
        let (parts, bricks) = (std::mem::take(&mut self.parts), std::mem::take(&mut self.bricks));
        let held = std::mem::take(&mut self.held);
        if !parts.is_empty() {
            let bytes: Vec<u64> = parts.iter().map(|part| u64::from(part.count()) * self.stride).collect();
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let words = |number: usize| on_device(&parts[number], self.stride, number as u32);
            let splats = send_bricks(self.context, ("store.splats", usage), &bytes, &words)?;
            self.made.stores.push(Store::new(self.context, splats, self.stride, held, bricks)?);
        }
        Ok(())
    }

    pub(crate) fn finish(mut self) -> Result<Stores> {
        self.close()?;
        Ok(self.made)
    }

    /// Adds a brick that may have splats.
    pub(crate) fn push(&mut self, MadeBrick { brick, splats, copies }: MadeBrick) -> Result<()> {
        let count = splats.count();
        self.made.bricks.uploaded += 1;
        self.made.bricks.bytes += u64::from(count) * self.stride;
        self.made.copies += copies;
        if count > 0 {
            let full = self.held.checked_add(count).is_none_or(|sum| sum > self.limit);
            if full || self.bricks.len() == MAX_BRICKS {
                self.close()?;
            }
            self.parts.push(splats);
            self.bricks.push(BrickSplats { first: self.held, ..brick });
            self.held += count;
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
