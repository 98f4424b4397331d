//! The bricks of a volume. The range of a brick decides whether it is visible; only visible bricks are read again.

use std::ops::Range;

use super::{Number, Samples, ToF64, Volume, with_samples};
use crate::error::{Error, Result};
use crate::memory::reserved;
use crate::parallel::try_map;

/// The number of voxels along the edge of a brick.
pub const EDGE: usize = 32;

/// The number of bytes of samples read at a time; more if one row of bricks per thread has more.
const READ: usize = 8 << 20;

/// The encoding in which a consumer of bricks wants their samples.
#[doc(hidden)]
pub trait RowCoding: Sync {
    /// Appends encoded samples.
    fn append<T: Number>(&self, samples: &[T], bytes: &mut Vec<u8>);
}

/// The absence of an encoding, for passes that need ranges alone.
impl RowCoding for () {
    fn append<T: Number>(&self, _: &[T], _: &mut Vec<u8>) {}
}

/// The lattice point of a brick's first voxel, and its encoded samples with the halo around them, x fastest.
pub type Brick = ([u32; 3], Vec<u8>);

/// A row of bricks along x: their ranges (empty if they were known before), and the result for each visible brick.
type Row<B> = (Vec<[f64; 2]>, Vec<Option<B>>);

/// The samples of a row of bricks along x, with the halo in y and z as far as the volume reaches.
#[doc(hidden)]
pub struct Strip {
    dims: [usize; 3],
    halo: usize,
    /// The samples of the rows `rows` of each plane, along z.
    planes: Vec<Samples>,
    planes_from: usize,
    rows: Range<usize>,
}

impl Volume {
    /// Returns the number of bricks along each axis. The last brick of an axis may be cut short.
    pub fn bricks(&self) -> [u32; 3] {
        self.grid().dims().map(|d| d.div_ceil(EDGE as u32))
    }

    /// Calls `take` for each brick, x fastest: with the result of `make` for its encoded samples if `shows` accepts its
    /// number and its range of stored samples ([`Self::ranges`]), otherwise with `None`. `halo` voxels around a brick
    /// are included; outside the volume they repeat its outermost voxels. `make` runs in parallel.
    ///
    /// The first call reads every sample and keeps the ranges. Later calls read only rows of bricks that show
    /// something.
    ///
    /// # Errors
    /// [`Error::Read`] and [`Error::Memory`] if samples cannot be read, and the errors of `make` and `take`.
    pub fn for_each_brick<B: Send, E: From<Error> + Send>(
        &self,
        shows: &(dyn Fn(usize, [f64; 2]) -> bool + Sync),
        halo: usize,
        coding: &impl RowCoding,
        make: &(dyn Fn(Brick) -> Result<B, E> + Sync),
        take: &mut dyn FnMut(Option<B>) -> Result<(), E>,
    ) -> Result<(), E> {
        let [across, down, deep] = self.bricks().map(|n| n as usize);
        let known = self.known_ranges();
        let count = if known.is_some() { 0 } else { across * down * deep };
        let mut found = reserved(count as u64, || "the ranges of bricks".to_owned())?;
        let row = |j: usize, k: usize| -> Result<Row<B>, E> {
            let (y, z) = (j * EDGE, k * EDGE);
            let first = (k * down + j) * across;
            let ranges = known.map(|known| &known[first..first + across]);
            if ranges.is_some_and(|ranges| !(first..).zip(ranges).any(|(number, &range)| shows(number, range))) {
                return Ok((Vec::new(), (0..across).map(|_| None).collect()));
            }
            // Ranges are those with the voxels next to a brick.
            let read = Strip { halo, ..self.strip([y, z].map(|c| c as i64), halo.max(1))? };
            let ranges = ranges.map_or_else(|| read.ranges(y, z), <[_]>::to_vec);
            let brick = |(i, &range): (usize, &[f64; 2])| {
                let at = [i * EDGE, y, z];
                let brick = || (at.map(|c| c as u32), read.brick(at.map(|c| c as i64), coding));
                shows(first + i, range).then(|| make(brick())).transpose()
            };
            let bricks = ranges.iter().enumerate().map(brick).collect::<Result<_, E>>()?;
            Ok((ranges, bricks))
        };
        self.for_each_row([down, deep], halo, &row, &mut |(ranges, bricks)| {
            found.extend(ranges);
            bricks.into_iter().try_for_each(&mut *take)
        })?;
        if known.is_none() {
            self.keep_ranges(found);
        }
        Ok(())
    }

    /// Returns the least and the largest finite sample, as stored, of each brick and of the voxels next to it, on which
    /// the classification of its own voxels depends, x fastest; ∞ and -∞ if there is none. The first call reads every
    /// sample.
    pub fn ranges(&self) -> Result<&[[f64; 2]]> {
        if self.known_ranges().is_none() {
            self.for_each_brick::<(), Error>(&|_, _| false, 0, &(), &|_| Ok(()), &mut |_| Ok(()))?;
        }
        Ok(self.known_ranges().unwrap_or_default())
    }

    /// Returns the least and the largest finite value. The first call reads every sample, as [`Self::ranges`] does.
    ///
    /// # Errors
    /// [`Error::Read`] and [`Error::Memory`] if samples left in a file cannot be read.
    pub fn value_range(&self) -> Result<[f64; 2]> {
        let (slope, intercept) = self.rescale();
        let finite = self.ranges()?.iter().flatten().filter(|raw| raw.is_finite());
        let values = finite.map(|raw| slope * raw + intercept);
        Ok(values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)]))
    }

    /// Returns the largest distance of the volume's values from `value`. The first call reads every sample, as
    /// [`Self::ranges`] does.
    pub fn farthest_from(&self, value: f64) -> Result<f64> {
        let (slope, intercept) = self.rescale();
        Ok(self.ranges()?.iter().flatten().map(|raw| (slope * raw + intercept - value).abs()).fold(0.0, f64::max))
    }

    /// Calls `make` for each row of bricks along x with the row's number in y and in z, in parallel, and `take` with
    /// the results in order, y fastest. Results wait of about 8 MiB of samples, or of four rows per thread if that is
    /// more: rows take unequal times, and threads wait for the last of a group.
    ///
    /// # Errors
    /// The errors of `make` and `take`.
    pub fn for_each_row<R: Send, E: From<Error> + Send>(
        &self,
        [down, deep]: [usize; 2],
        halo: usize,
        make: &(dyn Fn(usize, usize) -> Result<R, E> + Sync),
        take: &mut dyn FnMut(R) -> Result<(), E>,
    ) -> Result<(), E> {
        let edge = EDGE + 2 * halo;
        let bytes = edge * edge * self.grid().dims()[0] as usize * self.sample_type().size();
        let rows: Vec<usize> = (0..down * deep).collect();
        for group in rows.chunks((READ / bytes).max(4 * rayon::current_num_threads())) {
            let made = try_map(group.len(), |n| make(group[n] % down, group[n] / down))?;
            made.into_iter().try_for_each(&mut *take)?;
        }
        Ok(())
    }

    /// Reads the row of bricks whose first voxels have these y and z, which may lie outside the volume.
    pub fn strip(&self, [y, z]: [i64; 2], halo: usize) -> Result<Strip> {
        let [nx, ny, nz] = self.grid().dims().map(|d| d as usize);
        let within =
            |first: i64, n: usize| clamped(first - halo as i64, n)..clamped(first + (EDGE + halo - 1) as i64, n) + 1;
        let rows = within(y, ny);
        let planes = within(z, nz);
        let planes_from = planes.start;
        let planes = planes
            .map(|plane| self.read((plane * ny + rows.start) * nx..(plane * ny + rows.end) * nx))
            .collect::<Result<_>>()?;
        Ok(Strip { dims: [nx, ny, nz], halo, planes, planes_from, rows })
    }
}

/// Returns the voxel of an axis of `n` voxels that is nearest to `place`.
fn clamped(place: i64, n: usize) -> usize {
    place.clamp(0, n as i64 - 1) as usize
}

impl Strip {
    /// Returns the least and the largest finite sample of each brick and of the voxels next to it, as stored: ∞ and -∞
    /// if there is none. The halo holds the voxels next to it along y and z.
    fn ranges(&self, y: usize, z: usize) -> Vec<[f64; 2]> {
        let [nx, _, _] = self.dims;
        let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; nx.div_ceil(EDGE)];
        let beside = |first: usize, start: usize, end: usize| {
            first.saturating_sub(1).max(start) - start..(first + EDGE + 1).min(end) - start
        };
        let rows = beside(y, self.rows.start, self.rows.end);
        let planes = beside(z, self.planes_from, self.planes_from + self.planes.len());
        for plane in &self.planes[planes] {
            with_samples!(plane, samples => {
                for row in samples[rows.start * nx..rows.end * nx].chunks_exact(nx) {
                    for (range, first) in ranges.iter_mut().zip((0..nx).step_by(EDGE)) {
                        let run = &row[first.saturating_sub(1)..(first + EDGE + 1).min(nx)];
                        // Samples are compared in their own type, which vectorises.
                        let (low, high) = run.iter().fold((run[0], run[0]), |(low, high), &v| {
                            (if v < low { v } else { low }, if v > high { v } else { high })
                        });
                        let (mut low, mut high) = (low.to_f64(), high.to_f64());
                        if !(low.is_finite() && high.is_finite()) {
                            let finite = run.iter().map(|v| v.to_f64()).filter(|v| v.is_finite());
                            let ends = (f64::INFINITY, f64::NEG_INFINITY);
                            (low, high) = finite.fold(ends, |(low, high), v| (v.min(low), v.max(high)));
                        }
                        *range = [range[0].min(low), range[1].max(high)];
                    }
                }
            });
        }
        ranges
    }

    /// Returns the encoded samples, with the halo, of the brick whose first voxel is at `at`. Outside the volume its
    /// outermost voxels are repeated.
    pub fn brick(&self, at: [i64; 3], coding: &impl RowCoding) -> Vec<u8> {
        let [nx, ny, nz] = self.dims;
        let edge = EDGE + 2 * self.halo;
        let mut bytes = Vec::with_capacity(edge * edge * edge * 4);
        let [x, y, z] = at.map(|first| first - self.halo as i64);
        let end = x + edge as i64;
        let run = clamped(x, nx)..clamped(end - 1, nx) + 1;
        // Copies of the first and of the last voxel of a row, outside the volume.
        let before = (-x).clamp(0, edge as i64 - run.len() as i64) as usize;
        let behind = edge - before - run.len();
        for k in 0..edge as i64 {
            let plane = &self.planes[clamped(z + k, nz) - self.planes_from];
            with_samples!(plane, samples => {
                for j in 0..edge as i64 {
                    let row = (clamped(y + j, ny) - self.rows.start) * nx;
                    let run = &samples[row + run.start..row + run.end];
                    for _ in 0..before {
                        coding.append(&run[..1], &mut bytes);
                    }
                    coding.append(run, &mut bytes);
                    for _ in 0..behind {
                        coding.append(&run[run.len() - 1..], &mut bytes);
                    }
                }
            });
        }
        bytes
    }
}
