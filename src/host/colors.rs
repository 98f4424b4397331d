//! Fields of colours times extinctions, and of extinctions, as coefficients of cubic B-splines.

use std::sync::atomic::{AtomicUsize, Ordering};

use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use voxsplat_volume::memory::zeroed;

use super::filter::{Around, MAX_REACH, RowFilter, add_rows};
use super::lanes::{WIDTH, dispatch};
use super::lattice::{CELL, Padded};
use super::plane::CHANNELS;
use crate::error::Result;
use crate::kernel::SplineFilter;
use crate::progress::Progress;
use crate::splats::words::nearest_half;

/// A coefficient: four f16.
pub(super) type Halves = [u16; CHANNELS];

/// Planes of coefficients that a thread makes at a time: whole cells.
const PLANES: usize = 2 * CELL;

/// Converts an f16 that is normal or 0 to f32.
#[inline(always)]
pub(super) fn from_half(half: u16) -> f32 {
    // The exponents of f32 are larger by 112.
    const FACTOR: f32 = f32::from_bits((112 + 127) << 23);
    let size = f32::from_bits(u32::from(half & 0x7fff) << 13) * FACTOR;
    f32::from_bits(size.to_bits() | u32::from(half & 0x8000) << 16)
}

/// Returns the f16 nearest to a number; numbers under the least normal f16 become 0, which loops decode faster.
#[inline(always)]
fn half(value: f32) -> u16 {
    if value.abs() < 6.103_515_6e-5 { 0 } else { nearest_half(value) as u16 }
}

/// Planes of voxels of four channels, side by side in rows: the input of the filter.
pub(super) struct VoxelPlanes {
    /// The count of numbers of a row of one channel, with the margins.
    width: usize,
    margin: usize,
    rows: Vec<f32>,
    /// The first and the last column with a voxel of each row; the first is larger if there is none.
    extents: Vec<[usize; 2]>,
}

impl VoxelPlanes {
    const EMPTY: [usize; 2] = [usize::MAX, 0];

    pub(super) fn new([nx, ny]: [usize; 2], margin: usize) -> Result<Self> {
        // Vectors reach beyond the end of a row.
        let width = (nx + 2 * margin).next_multiple_of(WIDTH) + WIDTH;
        let rows = planes_of(width, ny)?;
        Ok(Self { width, margin, rows, extents: vec![Self::EMPTY; ny] })
    }

    fn clear(&mut self) {
        let Self { width, margin, rows, extents, .. } = self;
        for (row, extent) in rows.chunks_exact_mut(CHANNELS * *width).zip(extents) {
            if extent[0] <= extent[1] {
                row.chunks_exact_mut(*width).for_each(|row| row[*margin + extent[0]..=*margin + extent[1]].fill(0.0));
            }
            *extent = Self::EMPTY;
        }
    }

    /// Puts a voxel into a row.
    #[inline]
    pub(super) fn put(&mut self, row: usize, column: usize, channels: [f32; CHANNELS]) {
        let at = row * CHANNELS * self.width + self.margin + column;
        for (channel, value) in channels.into_iter().enumerate() {
            self.rows[at + channel * self.width] = value;
        }
        let [first, last] = self.extents[row];
        self.extents[row] = [first.min(column), last.max(column)];
    }

    /// Returns the voxels of a plane of `columns` columns without margins, x fastest.
    pub(super) fn plane(&self, columns: usize) -> Vec<[f32; CHANNELS]> {
        let voxel = |row: usize, column: usize| {
            let at = row * CHANNELS * self.width + self.margin + column;
            [0, 1, 2, 3].map(|channel| self.rows[at + channel * self.width])
        };
        (0..self.extents.len()).flat_map(|row| (0..columns).map(move |column| voxel(row, column))).collect()
    }

    /// Returns whether a row has a voxel.
    #[inline(always)]
    fn has(&self, row: usize) -> bool {
        self.extents[row][0] <= self.extents[row][1]
    }

    /// Returns the channels' numbers of a row.
    #[inline(always)]
    fn row(&self, row: usize) -> &[f32] {
        &self.rows[row * CHANNELS * self.width..][..CHANNELS * self.width]
    }
}

/// Allocates zeros for a plane of rows of each channel, and for a vector more.
fn planes_of(width: usize, rows: usize) -> Result<Vec<f32>> {
    let count = CHANNELS * width * rows + WIDTH;
    Ok(zeroed(count as u64, || "planes of voxels".to_owned())?)
}

/// Coefficients over a lattice. Voxels beyond it are empty.
pub(super) struct ColorField {
    pub(super) lattice: Padded,
    coefficients: Vec<Halves>,
    /// Whether each cell has a coefficient other than 0.
    shows: Vec<bool>,
    /// The reach of the filter, in voxels.
    filter_reach: usize,
}

impl ColorField {
    /// Filters the voxels of the part of a lattice of `dims` points from point `first` on, which `plane` puts into
    /// empty planes.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) if the coefficients cannot be allocated.
    pub(super) fn new(
        (dims, first, pad): ([usize; 3], [isize; 3], usize),
        filter: &SplineFilter,
        plane: &(dyn Fn(usize, &mut VoxelPlanes) + Sync),
        progress: &Progress,
    ) -> Result<Self> {
        let lattice = Padded::new(dims, pad, first);
        let (area, cells) = (lattice.area(), lattice.cells());
        // Zeros that nothing is written over take no memory.
        let mut coefficients: Vec<Halves> =
            zeroed(lattice.count() as u64, || "the coefficients of colours".to_owned())?;
        let mut shows = vec![false; cells.iter().product()];
        let filter = RowFilter::new(filter);
        let reach = filter.reach;
        let (done, all) = (AtomicUsize::new(0), lattice.size[2].div_ceil(PLANES));
        let slabs = coefficients.par_chunks_mut(PLANES * area);
        let slabs = slabs.zip(shows.par_chunks_mut(PLANES / CELL * cells[0] * cells[1])).enumerate();
        slabs.try_for_each(|(slab, (coefficients, shows))| {
            progress.check()?;
            // The planes of voxels around a plane, at the remainder of their number.
            let kept = 2 * reach + 1;
            let make = |_| VoxelPlanes::new([dims[0], dims[1]], 2 * reach);
            let mut planes = (0..kept).map(make).collect::<Result<Vec<_>>>()?;
            let width = planes[0].width;
            let pair = |_| Ok((planes_of(width, dims[1])?, vec![false; dims[1]]));
            let mut pairs = (0..reach).map(pair).collect::<Result<Vec<_>>>()?;
            let mut next = isize::MIN;
            for (number, coefficients) in coefficients.chunks_exact_mut(area).enumerate() {
                let z = (slab * PLANES + number) as isize - pad as isize;
                let (first, last) = (z - reach as isize, z + reach as isize);
                if last < 0 || first >= dims[2] as isize {
                    continue;
                }
                for z in next.max(first)..=last {
                    let voxels = &mut planes[z.rem_euclid(kept as isize) as usize];
                    voxels.clear();
                    if let Ok(z) = usize::try_from(z)
                        && z < dims[2]
                    {
                        plane(z, voxels);
                    }
                }
                next = last + 1;
                let shows = &mut shows[number / CELL * cells[0] * cells[1]..][..cells[0] * cells[1]];
                let at = z.rem_euclid(kept as isize) as usize;
                let (planes, pairs, across) = (&planes, &mut pairs, cells[0]);
                dispatch(PlaneFiltering { filter: &filter, lattice, planes, at, pairs, coefficients, shows, across });
            }
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            progress.report("filtering", done as f64 / all as f64);
            Ok::<_, crate::error::Error>(())
        })?;
        Ok(Self { lattice, coefficients, shows, filter_reach: reach })
    }

    /// Returns the bytes of memory of the field.
    pub(super) fn bytes(&self) -> u64 {
        size_of_val(self.coefficients.as_slice()) as u64
    }

    /// Returns whether a coefficient in a box, ends included, is not 0.
    pub(super) fn shows(&self, low: [isize; 3], high: [isize; 3]) -> bool {
        self.lattice.any(&self.shows, low, high, |shows| *shows)
    }

    /// Returns the coefficients, x fastest.
    pub(super) fn coefficients(&self) -> &[Halves] {
        &self.coefficients
    }

    /// Returns the number of voxels, on either side along each axis, on which a coefficient depends.
    pub(super) fn filter_reach(&self) -> usize {
        self.filter_reach
    }
}

/// The filter of a plane.
struct PlaneFiltering<'a> {
    filter: &'a RowFilter,
    lattice: Padded,
    /// The planes of voxels around the filtered plane; number `at` is the plane itself.
    planes: &'a [VoxelPlanes],
    at: usize,
    /// Sums of the planes at each distance before and behind the filtered plane, and whether each row has voxels.
    pairs: &'a mut [(Vec<f32>, Vec<bool>)],
    coefficients: &'a mut [Halves],
    /// The marks of the cells of the plane, `across` in a row.
    shows: &'a mut [bool],
    across: usize,
}

impl WithSimd for PlaneFiltering<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { filter, lattice, planes, at, pairs, coefficients, shows, across } = self;
        let (pad, padded) = (lattice.pad, lattice.size);
        let (reach, kept) = (filter.reach, planes.len());
        let VoxelPlanes { width, margin, .. } = planes[0];
        let ny = planes[0].extents.len();
        for (number, (sums, has)) in pairs.iter_mut().enumerate() {
            let [before, behind] = [(at + kept - number - 1) % kept, (at + number + 1) % kept].map(|at| &planes[at]);
            for row in 0..ny {
                has[row] = before.has(row) || behind.has(row);
                if has[row] {
                    let sums = &mut sums[CHANNELS * width * row..][..CHANNELS * width];
                    add_rows(before.row(row), behind.row(row), sums);
                }
            }
        }
        let empty = vec![0.0_f32; width];
        let mut sums = vec![0.0_f32; (MAX_REACH + 1) * (width + WIDTH)];
        let mut filtered = vec![0.0_f32; CHANNELS * width];
        for row in 0..ny + 2 * reach {
            let y = row as isize - reach as isize;
            let rows = (y - reach as isize).max(0) as usize..((y + reach as isize + 1).min(ny as isize)) as usize;
            let mut extent = VoxelPlanes::EMPTY;
            for voxels in planes {
                for row in rows.clone() {
                    let [first, last] = voxels.extents[row];
                    extent = [extent[0].min(first), extent[1].max(last)];
                }
            }
            let [first, last] = extent;
            if first > last {
                continue;
            }
            // Coefficients reach as far as the filter beyond voxels; margins are twice as wide.
            let from = margin + first - reach;
            let count = last - first + 1 + 2 * reach;
            for channel in 0..CHANNELS {
                let begin = channel * width + from - reach;
                let mut around: Around<'_> = Default::default();
                for (k, around) in around.iter_mut().take(reach + 1).enumerate() {
                    for (j, place) in around.iter_mut().take(2 * reach + 1).enumerate() {
                        let row = y + j as isize - reach as isize;
                        *place = &empty[from - reach..];
                        if row < 0 || row >= ny as isize {
                            continue;
                        }
                        let row = row as usize;
                        if k == 0 && planes[at].has(row) {
                            *place = &planes[at].row(row)[begin..];
                        } else if k > 0 && pairs[k - 1].1[row] {
                            *place = &pairs[k - 1].0[CHANNELS * width * row + begin..];
                        }
                    }
                }
                filter.apply(simd, &around, &mut sums, &mut filtered[channel * width..][..count]);
            }
            let y = (y + pad as isize) as usize;
            let column = pad + first - reach;
            let out = &mut coefficients[y * padded[0] + column..][..count];
            let (r, g) = (&filtered[..count], &filtered[width..][..count]);
            let (b, a) = (&filtered[2 * width..][..count], &filtered[3 * width..][..count]);
            for x in 0..count {
                out[x] = [half(r[x]), half(g[x]), half(b[x]), half(a[x])];
            }
            shows[y / CELL * across..][column / CELL..=(column + count - 1) / CELL].fill(true);
        }
    }
}
