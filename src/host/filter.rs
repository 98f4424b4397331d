//! The filters from samples to coefficients of splines: slabs of planes, row by row, in memory that stays in the caches
//! of a core.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use bytemuck::Zeroable;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use voxsplat_volume::memory::{reserved, zeroed};

use super::lanes::{WIDTH, load};
use super::lattice::{CELL, CELL_POINTS, Padded};
use crate::error::Result;
use crate::kernel::{MAX_REACH, SplineFilter};
use crate::progress::Progress;
use crate::vectors::dispatch;

/// Number of planes of a slab, of which a thread makes the coefficients at a time: whole cells.
const PLANES: usize = 2 * CELL;
/// The largest number of cells of a row that are filtered together.
const CELLS: usize = 16;
/// Number of rows that are read of each plane at a time: voxels of rows follow each other in memory.
const ROWS: usize = 4;

/// The samples of as many columns as are filtered together, with a cell more on either side.
type SampleLine = [[f32; WIDTH]; CELLS + 2];
/// The lines of a plane around a row: of the row itself, then of both rows at each distance, added up.
type Pairs = [SampleLine; MAX_REACH + 1];

/// A row of the samples of a padded lattice, `N` channels one after the other, with a cell more on either side.
pub(super) struct SampleRow<const N: usize> {
    /// The count of numbers of a channel.
    width: usize,
    /// The column of the lattice's first point.
    first: usize,
    values: Vec<f32>,
    /// Whether there are samples in each cell of the row.
    has: Vec<bool>,
    /// Whether samples are needed in each cell of the row.
    wanted: Vec<bool>,
}

impl<const N: usize> SampleRow<N> {
    pub(super) fn new(lattice: &Padded) -> Result<Self> {
        let width = lattice.size[0] + 2 * CELL;
        let values = zeroed((N * width) as u64, || "a row of samples".to_owned())?;
        let cells = width / CELL;
        Ok(Self { width, first: CELL + lattice.pad, values, has: vec![false; cells], wanted: vec![true; cells] })
    }

    pub(super) fn clear(&mut self) {
        for (cell, has) in self.has.iter_mut().enumerate() {
            if std::mem::take(has) {
                for channel in 0..N {
                    self.values[channel * self.width + CELL * cell..][..CELL].fill(0.0);
                }
            }
        }
    }

    /// Returns whether samples are needed in a cell between two points of the lattice.
    #[inline(always)]
    pub(super) fn wants(&self, first: u32, last: u32) -> bool {
        let [first, last] = [first, last].map(|x| (self.first + x as usize) / CELL);
        self.wanted[first..=last].contains(&true)
    }

    /// Puts a sample at a point of the lattice.
    #[inline(always)]
    pub(super) fn put(&mut self, x: usize, channels: [f32; N]) {
        let at = self.first + x;
        for (channel, value) in channels.into_iter().enumerate() {
            self.values[at + channel * self.width] = value;
        }
        self.has[at / CELL] = true;
    }

    /// Puts the first `count` of some samples at their points of the lattice, ascending.
    #[inline(always)]
    pub(super) fn put_run<const M: usize>(&mut self, xs: &[u32; M], count: usize, channels: [[f32; M]; N]) {
        if count == M && (xs[M - 1] - xs[0]) as usize == M - 1 {
            let at = self.first + xs[0] as usize;
            for channel in 0..N {
                self.values[at + channel * self.width..][..M].copy_from_slice(&channels[channel]);
            }
            self.has[at / CELL..=(at + M - 1) / CELL].fill(true);
            return;
        }
        for i in 0..count {
            let mut sample = [0.0; N];
            for channel in 0..N {
                sample[channel] = channels[channel][i];
            }
            self.put(xs[i] as usize, sample);
        }
    }

    /// Returns the sample at a point of the lattice.
    pub(super) fn get(&self, x: usize) -> [f32; N] {
        let mut channels = [0.0; N];
        for (channel, value) in channels.iter_mut().enumerate() {
            *value = self.values[self.first + x + channel * self.width];
        }
        channels
    }
}

impl SampleRow<1> {
    /// Sets the row to samples, which repeat beyond both ends.
    pub(super) fn repeat(&mut self, samples: &[f32]) {
        let (before, rest) = self.values.split_at_mut(self.first);
        let (own, behind) = rest.split_at_mut(samples.len());
        own.copy_from_slice(samples);
        before.fill(samples[0]);
        behind.fill(samples[samples.len() - 1]);
        self.has.fill(true);
    }
}

/// The samples of a lattice, and of the points beyond its faces.
pub(super) trait RowSource<const N: usize>: Sync {
    /// What is read for a slab.
    type Slab: Send;

    /// Reads the samples of a range of planes.
    fn slab(&self, planes: Range<isize>) -> Result<Self::Slab>;

    /// Writes a row, given its y and z, into one that is empty.
    fn row(&self, slab: &Self::Slab, place: [isize; 2], out: &mut SampleRow<N>);
}

/// A coefficient as it is stored.
pub(super) trait Coefficient<const N: usize>: Copy + Send + Sync + PartialEq + Zeroable {
    /// Returns the coefficients of the points of a row of a cell.
    fn of(channels: [&[f32; CELL]; N]) -> [Self; CELL];
}

impl Coefficient<1> for f32 {
    #[inline(always)]
    fn of([values]: [&[f32; CELL]; 1]) -> [Self; CELL] {
        *values
    }
}

/// Coefficients over a padded lattice, in the order of [`Padded::index`].
pub(super) struct Coefficients<T> {
    pub(super) values: Vec<T>,
    /// Whether each cell has a coefficient other than 0.
    pub(super) shows: Vec<bool>,
}

impl<T: Zeroable> Coefficients<T> {
    /// Makes zeros, or takes `spare` memory of that size, whose cells that show are to be cleared.
    fn new(lattice: &Padded, spare: Option<Self>) -> Result<Self> {
        // Zeros that nothing is written over take no memory.
        let values = || zeroed(lattice.count() as u64, || "the coefficients of a volume".to_owned());
        match spare {
            Some(spare) if spare.values.len() == lattice.count() => Ok(spare),
            _ => Ok(Self { values: values()?, shows: vec![false; lattice.cells().iter().product()] }),
        }
    }
}

/// Returns, for each row of cells of a range of layers, whether a filter makes each cell or a cell beside it. Rows have
/// a cell more on either side.
fn near(made: &[Vec<bool>], [across, down, _]: [usize; 3], layers: &Range<usize>) -> Vec<Vec<bool>> {
    let near = |row: usize| {
        let mut near = vec![false; across + 2];
        for (made, layer) in made.iter().flat_map(|made| layers.clone().map(move |layer| (made, layer))) {
            let made = &made[across * (row + down * layer)..][..across];
            for cell in (0..across).filter(|&cell| made[cell]) {
                near[cell..cell + 3].fill(true);
            }
        }
        near
    };
    (0..down).map(near).collect()
}

/// Filters the samples of a lattice by several filters: the cells that are `made` of each, without it all. Reuses the
/// memory of `spare`.
///
/// # Errors
/// The errors of `rows`, and [`Error::Memory`](crate::Error::Memory) if the coefficients cannot be allocated.
pub(super) fn filtered<const N: usize, T: Coefficient<N>, R: RowSource<N>>(
    lattice: &Padded,
    filters: &[SplineFilter],
    rows: &R,
    (mut spare, made): (Vec<Coefficients<T>>, Option<&[Vec<bool>]>),
    progress: &Progress,
) -> Result<Vec<Coefficients<T>>> {
    let mut fields = Vec::with_capacity(filters.len());
    for _ in filters {
        fields.push(Coefficients::new(lattice, spare.pop())?);
    }
    drop(spare);
    let filters: Vec<RowFilter> = filters.iter().map(RowFilter::new).collect();
    let reach = filters.iter().map(|filter| filter.reach).max().unwrap_or_default();
    let [across, down, deep] = lattice.cells();
    let mut slabs: Vec<Vec<SlabPart<'_, T>>> = (0..(deep * CELL).div_ceil(PLANES)).map(|_| Vec::new()).collect();
    for (number, field) in fields.iter_mut().enumerate() {
        let cells = PLANES / CELL * across * down;
        let parts = field.values.chunks_mut(cells * CELL_POINTS).zip(field.shows.chunks_mut(cells));
        for (slab, (values, shows)) in parts.enumerate() {
            let made = made.map(|made| &made[number][cells * slab..][..shows.len()]);
            slabs[slab].push(SlabPart { values, shows, made });
        }
    }
    let (done, all) = (AtomicUsize::new(0), slabs.len());
    let of_rows = |n: usize, count: usize| n as isize - (lattice.pad + count) as isize;
    slabs.par_iter_mut().enumerate().try_for_each_init(
        || None,
        |scratch, (number, parts)| {
            progress.check()?;
            let first = number * PLANES;
            let planes = PLANES.min(lattice.size[2] - first) + 2 * reach;
            let around = match scratch {
                Some(around) => around,
                None => scratch.insert(Around::new(lattice, reach)?),
            };
            let low = of_rows(first, reach);
            let layers = first / CELL..((first + PLANES) / CELL).min(deep);
            let near = made.map(|made| near(made, [across, down, deep], &layers));
            let slab = rows.slab(low..low + planes as isize)?;
            let count = lattice.size[1] + 2 * reach;
            for read in (0..count).step_by(ROWS).map(|y| y..(y + ROWS).min(count)) {
                for (plane, y) in (0..planes).flat_map(|plane| read.clone().map(move |y| (plane, y))) {
                    let row = around.row(plane, y);
                    row.clear();
                    if let Some(near) = &near {
                        // The rows of cells whose coefficients depend on the row.
                        let [first, last] = [y.saturating_sub(2 * reach), y].map(|y| (y / CELL).min(down - 1));
                        row.wanted.fill(false);
                        for near in &near[first..=last] {
                            row.wanted.iter_mut().zip(near).for_each(|(wanted, near)| *wanted |= near);
                        }
                        if !row.wanted.contains(&true) {
                            continue;
                        }
                    }
                    rows.row(&slab, [of_rows(y, reach), low + plane as isize], row);
                }
                // The rows in the middle of those that were read.
                for row in read.filter_map(|y| y.checked_sub(2 * reach)) {
                    dispatch(RowFiltering { filters: &filters, lattice, around, planes, row, parts });
                }
            }
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            progress.report("filtering", done as f64 / all as f64);
            Ok::<_, crate::error::Error>(())
        },
    )?;
    Ok(fields)
}

/// The coefficients of a slab.
struct SlabPart<'a, T> {
    values: &'a mut [T],
    shows: &'a mut [bool],
    /// Whether each cell is made; `None`: all are.
    made: Option<&'a [bool]>,
}

/// The weights of a filter, by the distance across rows and along them.
struct RowFilter {
    reach: usize,
    /// The weights by the larger and the smaller distance of a row along both axes across it, then by the distance
    /// along it.
    weights: [[[f32; MAX_REACH + 1]; MAX_REACH + 1]; MAX_REACH + 1],
}

/// The samples around a row of the planes of a slab and of the planes around it, and memory for filters.
struct Around<const N: usize> {
    reach: usize,
    /// The last rows of each plane, each at its number modulo their count.
    rows: Vec<Vec<SampleRow<N>>>,
    /// Whether some row of a plane, and some plane around a plane, has samples in each cell.
    has: Vec<Vec<bool>>,
    shows: Vec<bool>,
    /// Whether each cell of the row gets coefficients.
    gets: Vec<bool>,
    /// For each channel the lines of each plane.
    pairs: Vec<Vec<Pairs>>,
    sums: Pairs,
}

impl<const N: usize> Around<N> {
    fn new(lattice: &Padded, reach: usize) -> Result<Self> {
        let planes = PLANES + 2 * reach;
        let rows = |_| (0..2 * reach + ROWS).map(|_| SampleRow::new(lattice)).collect::<Result<Vec<_>>>();
        let pairs = |_| {
            let mut pairs = reserved(planes as u64, || "planes of samples".to_owned())?;
            pairs.resize(planes, Pairs::zeroed());
            Ok(pairs)
        };
        let cells = lattice.cells()[0] + 2;
        Ok(Self {
            reach,
            rows: (0..planes).map(rows).collect::<Result<_>>()?,
            has: vec![vec![false; cells]; planes],
            shows: vec![false; cells],
            gets: vec![false; cells - 2],
            pairs: (0..N).map(pairs).collect::<Result<_>>()?,
            sums: Pairs::zeroed(),
        })
    }

    /// Returns row number `y` of a plane.
    fn row(&mut self, plane: usize, y: usize) -> &mut SampleRow<N> {
        let rows = &mut self.rows[plane];
        let count = rows.len();
        &mut rows[y % count]
    }
}

/// The filters of a row of all planes of a slab.
struct RowFiltering<'a, 'b, const N: usize, T> {
    filters: &'a [RowFilter],
    lattice: &'a Padded,
    around: &'a mut Around<N>,
    /// The number of planes with those around the slab.
    planes: usize,
    /// The number of the row in the lattice.
    row: usize,
    parts: &'a mut [SlabPart<'b, T>],
}

impl<const N: usize, T: Coefficient<N>> WithSimd for RowFiltering<'_, '_, N, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { filters, lattice, around, planes, row, parts } = self;
        let Around { reach, rows, has, shows, gets, pairs, sums } = around;
        let reach = *reach;
        if row % CELL == 0 {
            parts.iter_mut().for_each(|part| part.clear(lattice, row));
        }
        shows.fill(false);
        for plane in 0..planes {
            has[plane].fill(false);
            for row in &rows[plane] {
                for (has, of_row) in has[plane].iter_mut().zip(&row.has) {
                    *has |= of_row;
                }
            }
            for (shows, has) in shows.iter_mut().zip(&has[plane]) {
                *shows |= has;
            }
        }
        let cells = lattice.cells()[0];
        let layers = (planes - 2 * reach) / CELL;
        // Cells beside samples get coefficients, too: filters reach a cell at most.
        for cell in 0..cells {
            let makes = |part: &SlabPart<'_, T>| (0..layers).any(|layer| part.makes(lattice, [row, layer], [cell, 1]));
            gets[cell] = (shows[cell] || shows[cell + 1] || shows[cell + 2]) && parts.iter().any(makes);
        }
        let mut next = 0;
        while next < cells {
            if !gets[next] {
                next += 1;
                continue;
            }
            let first = next;
            while next < cells && next - first < CELLS && gets[next] {
                next += 1;
            }
            let lines = next - first + 2;
            for plane in 0..planes {
                add_pairs(simd, &rows[plane], (row, reach), (first, lines), plane, pairs);
            }
            for plane in reach..planes - reach {
                for (filter, part) in filters.iter().zip(parts.iter_mut()) {
                    if !part.makes(lattice, [row, (plane - reach) / CELL], [first, next - first]) {
                        continue;
                    }
                    let window = plane - filter.reach..plane + filter.reach + 1;
                    let has_any = |has: &Vec<bool>| has[first..first + lines].contains(&true);
                    if !has[window.clone()].iter().any(has_any) {
                        continue;
                    }
                    let mut channels = [[0.0; CELLS * CELL]; N];
                    for (channel, out) in channels.iter_mut().enumerate() {
                        filter.apply(simd, &pairs[channel][window.clone()], sums, &mut out[..CELL * (next - first)]);
                    }
                    part.write(lattice, [first, row, plane - reach], &channels, next - first);
                }
            }
        }
    }
}

/// Writes the lines of a plane around a row, from a cell of the row on; `row` and those beside it are kept at their
/// numbers modulo their count.
#[inline(always)]
fn add_pairs<S: Simd, const N: usize>(
    simd: S,
    rows: &[SampleRow<N>],
    (row, reach): (usize, usize),
    (first, lines): (usize, usize),
    plane: usize,
    pairs: &mut [Vec<Pairs>],
) {
    for distance in 0..=reach {
        let [before, behind] = [row + reach - distance, row + reach + distance].map(|row| &rows[row % rows.len()]);
        for channel in 0..N {
            let at = channel * before.width + CELL * first;
            let (before, behind) = (&before.values[at..][..WIDTH * lines], &behind.values[at..][..WIDTH * lines]);
            let line = &mut pairs[channel][plane][distance];
            for (number, sum) in line.iter_mut().take(lines).enumerate() {
                let one = load(simd, &before[WIDTH * number..]);
                let sum_of =
                    if distance == 0 { one } else { simd.add_f32s(one, load(simd, &behind[WIDTH * number..])) };
                store(simd, sum_of, sum);
            }
        }
    }
}

/// Stores a vector.
#[inline(always)]
fn store<S: Simd>(_: S, vector: S::f32s, out: &mut [f32; WIDTH]) {
    let (vectors, _) = S::as_mut_simd_f32s(out);
    vectors[0] = vector;
}

impl<T: Zeroable> SlabPart<'_, T> {
    /// Returns whether one of `count` cells from `first` on is made, given a row of points and a layer of cells.
    #[inline(always)]
    fn makes(&self, lattice: &Padded, [row, layer]: [usize; 2], [first, count]: [usize; 2]) -> bool {
        let [across, down, _] = lattice.cells();
        self.made.is_none_or(|made| made[first + across * (row / CELL + down * layer)..][..count].contains(&true))
    }

    /// Clears the cells whose first row this is.
    fn clear(&mut self, lattice: &Padded, row: usize) {
        let [across, down, _] = lattice.cells();
        for layer in 0..self.shows.len() / (across * down) {
            let first = lattice.index([0, row, CELL * layer]) / CELL_POINTS;
            for cell in first..first + across {
                if std::mem::take(&mut self.shows[cell]) {
                    self.values[CELL_POINTS * cell..][..CELL_POINTS].fill_with(T::zeroed);
                }
            }
        }
    }

    /// Writes a row of coefficients from a cell on: those of `cells` cells that are not all 0.
    #[inline(always)]
    fn write<const N: usize>(
        &mut self,
        lattice: &Padded,
        [first, row, plane]: [usize; 3],
        channels: &[[f32; CELLS * CELL]; N],
        cells: usize,
    ) where
        T: Coefficient<N>,
    {
        for cell in 0..cells {
            let at = lattice.index([CELL * (first + cell), row, plane]);
            if self.made.is_some_and(|made| !made[at / CELL_POINTS]) {
                continue;
            }
            let mut of_cell = [&[0.0; CELL]; N];
            for channel in 0..N {
                of_cell[channel] = &channels[channel].as_chunks().0[cell];
            }
            let values = T::of(of_cell);
            if values != [T::zeroed(); CELL] {
                self.values[at..at + CELL].copy_from_slice(&values);
                self.shows[at / CELL_POINTS] = true;
            }
        }
    }
}

impl RowFilter {
    fn new(filter: &SplineFilter) -> Self {
        let reach = filter.reach();
        let mut weights = [[[0.0; MAX_REACH + 1]; MAX_REACH + 1]; MAX_REACH + 1];
        for high in 0..=reach {
            for low in 0..=high {
                for along in 0..=reach {
                    weights[high][low][along] = filter.weight([along, low, high]) as f32;
                }
            }
        }
        Self { reach, weights }
    }

    /// Filters lines: `out` gets coefficients for whole cells. `planes` are the planes as far as the filter reaches.
    #[inline(always)]
    fn apply<S: Simd>(&self, simd: S, planes: &[Pairs], sums: &mut Pairs, out: &mut [f32]) {
        match self.reach {
            ..=2 => self.filtered::<S, 2>(simd, planes, sums, out),
            3 => self.filtered::<S, 3>(simd, planes, sums, out),
            4 => self.filtered::<S, 4>(simd, planes, sums, out),
            5 | 6 => self.filtered::<S, 6>(simd, planes, sums, out),
            _ => self.filtered::<S, MAX_REACH>(simd, planes, sums, out),
        }
    }

    #[inline(always)]
    fn filtered<S: Simd, const REACH: usize>(&self, simd: S, planes: &[Pairs], sums: &mut Pairs, out: &mut [f32]) {
        // Two vectors at a time share the loads of weights.
        const TOGETHER: usize = 2;
        let planes = &planes[..2 * REACH + 1];
        let lines = (out.len() / WIDTH + 2).min(CELLS + 2);
        // Rows at distances that are alike are added up, and get the weights of each distance along the row.
        for x in (0..lines.next_multiple_of(TOGETHER)).step_by(TOGETHER) {
            let mut along = [[simd.splat_f32s(0.0); TOGETHER]; MAX_REACH + 1];
            for high in 0..=REACH {
                for low in 0..=high {
                    let mut sum = [simd.splat_f32s(0.0); TOGETHER];
                    for n in 0..TOGETHER {
                        sum[n] = load(simd, &planes[REACH + low][high][x + n]);
                        if low > 0 {
                            sum[n] = simd.add_f32s(sum[n], load(simd, &planes[REACH - low][high][x + n]));
                        }
                        if high > low {
                            sum[n] = simd.add_f32s(sum[n], load(simd, &planes[REACH + high][low][x + n]));
                            sum[n] = simd.add_f32s(sum[n], load(simd, &planes[REACH - high][low][x + n]));
                        }
                    }
                    for distance in 0..=REACH {
                        let weight = simd.splat_f32s(self.weights[high][low][distance]);
                        for n in 0..TOGETHER {
                            along[distance][n] = simd.mul_add_f32s(weight, sum[n], along[distance][n]);
                        }
                    }
                }
            }
            for distance in 0..=REACH {
                for n in 0..TOGETHER {
                    store(simd, along[distance][n], &mut sums[distance][x + n]);
                }
            }
        }
        out.copy_from_slice(&sums[0].as_flattened()[CELL..][..out.len()]);
        for distance in 1..=REACH {
            let sums = sums[distance].as_flattened();
            let left = &sums[CELL - distance..][..out.len()];
            let right = &sums[CELL + distance..][..out.len()];
            for x in 0..out.len() {
                out[x] += left[x] + right[x];
            }
        }
    }
}
