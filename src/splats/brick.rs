//! Splats of a brick on the host: rows of places, and the words of the splats.

use std::ops::Range;
use std::sync::Arc;

use super::words::{LANES, SplatRun};
use crate::error::Result;
use crate::volume::BRICK_EDGE as EDGE;
use voxsplat_volume::memory::reserved;

/// The splats of a brick on the host.
#[derive(Debug, PartialEq)]
pub(crate) struct HostBrick {
    /// The rows of the brick along x, y before z.
    pub(crate) rows: Arc<Vec<Row>>,
    /// The number of words of a splat without its place.
    pub(crate) each: usize,
    /// The words of the splats, row after row: the first word of all splats of a row, then the second. Rows with equal
    /// words share them: the inside of a label takes hardly any memory.
    words: Arc<Vec<u32>>,
}

/// A row of a brick along x.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Row {
    /// The bits of the places with splats, the first place the lowest.
    pub(crate) bits: u32,
    /// The number of the row's first splat among the splats of the brick.
    pub(crate) first: u32,
    /// The number of the row's first splat among the splats whose words are held.
    held: u32,
}

/// Moves the values of rows together, so that a row with the same values as the row before shares them; a splat has
/// `each` values, and `counts` are the numbers of splats of the rows. Returns the number of the first splat of each
/// row.
fn share<T: Copy + PartialEq>(counts: impl Iterator<Item = u32>, each: usize, values: &mut Vec<T>) -> Vec<u32> {
    let (mut read, mut end, mut last) = (0, 0, 0..0);
    let mut start_of = |count: u32| {
        let row = read..read + count as usize * each;
        read = row.end;
        if count > 0 && values[row.clone()] != values[last.clone()] {
            last = end..end + row.len();
            values.copy_within(row, end);
            end = last.end;
        }
        (last.start / each) as u32
    };
    let starts = counts.map(&mut start_of).collect();
    values.truncate(end);
    values.shrink_to_fit();
    starts
}

/// The splats of a brick, which follow one another in a store.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct BrickSplats {
    /// The lattice point of the brick's first voxel.
    pub(crate) origin: [u32; 3],
    /// The level of the brick: places are cells of 2^level voxels a side.
    pub(crate) level: u32,
    /// The number of the brick's first splat in the store.
    pub(crate) first: u32,
    /// The box around the splats: its first lattice point, and the one after the last. Both are equal if there are no
    /// splats.
    pub(crate) bounds: [[u32; 3]; 2],
    /// The pages of [`PAGE`]^3 places that have splats: a bit for each, the lowest of a word first, x fastest, then y.
    pub(crate) pages: [u32; 16],
}

/// The number of places along an edge of a page of a brick.
pub(crate) const PAGE: u32 = 4;

impl BrickSplats {
    /// Describes the splats from `first` on of the brick of level 0 at `origin`, given the bits of the places of each
    /// row along x, y before z, the first of a row the lowest.
    pub(crate) fn new(origin: [u32; 3], first: u32, rows: impl Iterator<Item = u32>) -> Self {
        let (mut places, mut pages) = ([0_u32; 3], [0; 16]);
        for (row, bits) in rows.enumerate().filter(|&(_, bits)| bits != 0) {
            let (y, z) = (row % EDGE, row / EDGE);
            places = [places[0] | bits, places[1] | 1 << y, places[2] | 1 << z];
            let in_row = (0..8).filter(|page| bits >> (page * PAGE) & 0xf != 0).fold(0, |all, page| all | 1 << page);
            let row = y / PAGE as usize + 8 * (z / PAGE as usize);
            pages[row / 4] |= in_row << (8 * (row % 4));
        }
        Self::of_places(origin, first, places, pages)
    }

    /// Describes the splats as [`Self::new`] does, given the bits of the places along each axis that have splats, and
    /// the bits of pages.
    pub(crate) fn of_places(origin: [u32; 3], first: u32, places: [u32; 3], pages: [u32; 16]) -> Self {
        let low: [u32; 3] = std::array::from_fn(|axis| origin[axis] + places[axis].trailing_zeros() % u32::BITS);
        let high = std::array::from_fn(|axis| origin[axis] + u32::BITS - places[axis].leading_zeros());
        Self { origin, level: 0, first, bounds: [low, high], pages }
    }

    /// Returns the brick with cells of a level for voxels, in a lattice where the first cell lies at `first` along each
    /// axis.
    pub(crate) fn of_level(self, level: u32, first: u32) -> Self {
        let scaled = |point: [u32; 3]| point.map(|cell| first + (cell << level));
        Self { level, origin: scaled(self.origin), bounds: self.bounds.map(scaled), ..self }
    }
}

impl HostBrick {
    /// Makes the splats of a brick, of `each` words without the place, splat after splat, given the bits of the places
    /// of each row.
    pub(crate) fn new(bits: &[u32], each: usize, mut words: Vec<u32>) -> Self {
        let mut rest = words.as_mut_slice();
        let mut splats = Vec::new();
        for count in bits.iter().map(|bits| bits.count_ones() as usize) {
            let (row, behind) = rest.split_at_mut(count * each);
            splats.clear();
            splats.extend_from_slice(row);
            for (splat, words) in splats.chunks_exact(each).enumerate() {
                words.iter().enumerate().for_each(|(index, word)| row[index * count + splat] = *word);
            }
            rest = behind;
        }
        let mut first = 0;
        let held = share(bits.iter().map(|bits| bits.count_ones()), each, &mut words);
        let row = |(&bits, held): (&u32, u32)| {
            let row = Row { bits, first, held };
            first += bits.count_ones();
            row
        };
        let rows = Arc::new(bits.iter().zip(held).map(row).collect());
        Self { rows, each, words: Arc::new(words) }
    }

    /// Returns the words of splat number `splat` of a row.
    pub(crate) fn words(&self, row: Row, splat: usize) -> impl Iterator<Item = u32> {
        let words = &self.words[row.held as usize * self.each + splat..];
        words.iter().copied().step_by(row.bits.count_ones() as usize).take(self.each)
    }

    /// Returns some words of each splat, splat after splat.
    pub(crate) fn columns(&self, of: Range<usize>) -> Result<Vec<u32>> {
        let mut columns = reserved(u64::from(self.count()) * of.len() as u64, || "splats of a brick".to_owned())?;
        for &row in self.rows.iter() {
            (0..row.bits.count_ones() as usize)
                .for_each(|splat| columns.extend(self.words(row, splat).skip(of.start).take(of.len())));
        }
        Ok(columns)
    }

    pub(crate) fn count(&self) -> u32 {
        self.rows.last().map_or(0, |row| row.first + row.bits.count_ones())
    }

    /// Returns the splats of row number `number` in runs, each with its number of splats. The first place of the row is
    /// at `x` in the lattice.
    pub(crate) fn runs(&self, number: usize, x: u32) -> impl Iterator<Item = (SplatRun<'_>, usize)> {
        let row = self.rows[number];
        let each_column = row.bits.count_ones() as usize;
        let words = &self.words[row.held as usize * self.each..];
        let mut xs = places(row.bits).map(move |place| x + place as u32);
        (0..each_column).step_by(LANES).map(move |first| {
            let mut run = SplatRun { xs: [x; LANES], each_column, words: &words[first..] };
            let count = run.xs.iter_mut().zip(&mut xs).map(|(to, x)| *to = x).count();
            (run, count)
        })
    }

    pub(crate) fn bytes(&self) -> u64 {
        (size_of_val(self.rows.as_slice()) + size_of_val(self.words.as_slice())) as u64
    }
}

/// Returns the first lattice point of the box around the splats of bricks, and its size; one voxel if there are none.
pub(crate) fn bounds_of<'a>(bricks: impl Iterator<Item = &'a BrickSplats>) -> [[usize; 3]; 2] {
    let filled = bricks.map(|brick| brick.bounds).filter(|[low, high]| low != high);
    let bounds = filled.reduce(|[low, high], bounds| {
        [[0, 1, 2].map(|a| low[a].min(bounds[0][a])), [0, 1, 2].map(|a| high[a].max(bounds[1][a]))]
    });
    let [low, high] = bounds.unwrap_or([[0; 3], [1; 3]]).map(|point| point.map(|n| n as usize));
    [low, [0, 1, 2].map(|a| high[a] - low[a])]
}

/// Returns the numbers of the bits that are set, ascending.
pub(crate) fn places(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = bits.trailing_zeros();
        bits &= bits.wrapping_sub(1);
        (place < u32::BITS).then_some(place as usize)
    })
}

/// A brick whose splats were made on the host.
pub(crate) struct MadeBrick {
    /// The description of the splats, as if the brick were the first of its store.
    pub(crate) brick: BrickSplats,
    pub(crate) splats: HostBrick,
    /// Number of splats that are copies of voxels beyond the faces of the volume.
    pub(crate) copies: u64,
}

impl MadeBrick {
    /// Makes the brick of level 0 at `origin`, of `each` words a splat without the place, given the bits of the places
    /// of each row along x, y before z, the first of a row the lowest.
    pub(crate) fn new(origin: [u32; 3], bits: &[u32], each: usize, words: Vec<u32>) -> Self {
        let brick = BrickSplats::new(origin, 0, bits.iter().copied());
        Self { brick, splats: HostBrick::new(bits, each, words), copies: 0 }
    }

    /// Makes the brick at `origin` of a lattice of `dims` places. `row` gets the y and z of a row in the brick and the
    /// number of its places along x, adds the words of the row's splats, and returns the bits of their places.
    pub(crate) fn of_rows(
        origin: [u32; 3],
        dims: [u32; 3],
        each: usize,
        mut row: impl FnMut([usize; 2], usize, &mut Vec<u32>) -> u32,
    ) -> Result<Self> {
        let [nx, ny, nz] = [0, 1, 2].map(|axis| EDGE.min((dims[axis] - origin[axis]) as usize));
        let mut bits = vec![0; EDGE * EDGE];
        let mut words = reserved((nx * ny * nz * each) as u64, || "splats of a brick".to_owned())?;
        for (y, z) in (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z))) {
            bits[y + EDGE * z] = row([y, z], nx, &mut words);
        }
        Ok(Self::new(origin, &bits, each, words))
    }
}
