//! A volume brick by brick: what each holds is known from its range, and only bricks that matter are read again.

use std::ops::Range;

use rayon::prelude::*;

use super::{Number, Samples, ToF64, Volume, with_samples};
use crate::error::Result;

/// Voxels along the side of a brick.
pub(crate) const EDGE: usize = 32;

/// Bytes of samples that are read at a time, as far as one row of bricks allows.
const READ: usize = 8 << 20;

/// How samples are written down for whoever wants bricks.
pub(crate) trait RowCoding: Sync {
    /// Appends samples to what is there.
    fn append<T: Number>(&self, samples: &[T], bytes: &mut Vec<u8>);
}

/// The lattice point of a brick's first voxel, and its samples with the halo around them, coded, x fastest.
pub(crate) type Brick = ([u32; 3], Vec<u8>);

/// Ranges of a row of bricks along x, as far as they were looked for, and those of the bricks that show something.
type Row = (Vec<[f64; 2]>, Vec<Option<Brick>>);

/// The planes of a row of bricks along x, with the halo in y and z; copies of the edge where the volume ends.
pub(crate) struct Strip {
    dims: [usize; 3],
    halo: usize,
    /// Of each plane, the rows `rows`.
    planes: Vec<Samples>,
    planes_from: usize,
    rows: Range<usize>,
}

impl Volume {
    /// The number of bricks along each axis; those at the far ends may be cut short.
    pub(crate) fn bricks(&self) -> [u32; 3] {
        self.grid().dims().map(|d| d.div_ceil(EDGE as u32))
    }

    /// Hands over the bricks, x fastest, whose range of stored samples `shows` something, coded and with `halo` voxels
    /// around them that repeat the outermost ones of the volume; `None` for each of the others.
    ///
    /// The first time every sample is read, and the ranges are kept; from then on only what shows is.
    pub(crate) fn for_each_brick(
        &self,
        shows: &(dyn Fn([f64; 2]) -> bool + Sync),
        halo: usize,
        coding: &impl RowCoding,
        take: &mut dyn FnMut(Option<Brick>) -> Result<()>,
    ) -> Result<()> {
        let [across, down, deep] = self.bricks().map(|n| n as usize);
        let known = self.known_ranges();
        let mut found = Vec::with_capacity(if known.is_some() { 0 } else { across * down * deep });
        let row = |j: usize, k: usize| -> Result<Row> {
            let (y, z) = (j * EDGE, k * EDGE);
            let first = (k * down + j) * across;
            let ranges = known.map(|known| &known[first..first + across]);
            if ranges.is_some_and(|r| !r.iter().any(|&r| shows(r))) {
                return Ok((Vec::new(), vec![None; across]));
            }
            let read = self.strip([y, z].map(|c| c as i64), halo)?;
            let ranges = ranges.map_or_else(|| read.ranges(y, z), <[_]>::to_vec);
            let brick = |(i, &range): (usize, &[f64; 2])| {
                let at = [i * EDGE, y, z];
                shows(range).then(|| (at.map(|c| c as u32), read.brick(at.map(|c| c as i64), coding)))
            };
            let bricks = ranges.iter().enumerate().map(brick).collect();
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

    /// The least and the largest stored sample of each brick, x fastest; the first time every sample is read.
    pub(crate) fn ranges(&self) -> Result<&[[f64; 2]]> {
        if self.known_ranges().is_none() {
            let [_, down, deep] = self.bricks().map(|n| n as usize);
            let mut found = Vec::new();
            let row = |j: usize, k: usize| {
                let (y, z) = (j * EDGE, k * EDGE);
                Ok(self.strip([y, z].map(|c| c as i64), 0)?.ranges(y, z))
            };
            self.for_each_row([down, deep], 0, &row, &mut |ranges| {
                found.extend(ranges);
                Ok(())
            })?;
            self.keep_ranges(found);
        }
        Ok(self.known_ranges().unwrap_or_default())
    }

    /// Makes something of each row of bricks along x, given its number in y and in z, many at a time, and hands the results
    /// over in order, y fastest. At most [`READ`] bytes of samples are in use, as far as one row with its halo allows.
    pub(crate) fn for_each_row<R: Send>(
        &self,
        [down, deep]: [usize; 2],
        halo: usize,
        make: &(dyn Fn(usize, usize) -> Result<R> + Sync),
        take: &mut dyn FnMut(R) -> Result<()>,
    ) -> Result<()> {
        let edge = EDGE + 2 * halo;
        let bytes = edge * edge * self.grid().dims()[0] as usize * self.sample_type().size();
        let rows: Vec<usize> = (0..down * deep).collect();
        for group in rows.chunks((READ / bytes).max(rayon::current_num_threads())) {
            let made: Vec<R> = group.par_iter().map(|&row| make(row % down, row / down)).collect::<Result<_>>()?;
            made.into_iter().try_for_each(&mut *take)?;
        }
        Ok(())
    }

    /// Reads the row of bricks whose first voxels have these y and z, be they in the volume or beyond its faces.
    pub(crate) fn strip(&self, [y, z]: [i64; 2], halo: usize) -> Result<Strip> {
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

/// The place nearest to `place` along an axis of `n`.
fn clamped(place: i64, n: usize) -> usize {
    place.clamp(0, n as i64 - 1) as usize
}

impl Strip {
    /// The least and the largest stored sample of each brick, the halo left out.
    fn ranges(&self, y: usize, z: usize) -> Vec<[f64; 2]> {
        let [nx, _, _] = self.dims;
        let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; nx.div_ceil(EDGE)];
        let rows = y - self.rows.start..(y + EDGE).min(self.rows.end) - self.rows.start;
        let planes = z - self.planes_from..(z + EDGE - self.planes_from).min(self.planes.len());
        for plane in &self.planes[planes] {
            with_samples!(plane, samples => {
                for row in samples[rows.start * nx..rows.end * nx].chunks_exact(nx) {
                    for (range, run) in ranges.iter_mut().zip(row.chunks(EDGE)) {
                        // Compared at their own width, which vectorises.
                        let (low, high) = run.iter().fold((run[0], run[0]), |(low, high), &v| {
                            (if v < low { v } else { low }, if v > high { v } else { high })
                        });
                        *range = [range[0].min(low.to_f64()), range[1].max(high.to_f64())];
                    }
                }
            });
        }
        ranges
    }

    /// The samples of the brick whose first voxel is at `at`, with the halo, coded; beyond its faces the volume repeats its
    /// outermost voxels.
    pub(crate) fn brick(&self, at: [i64; 3], coding: &impl RowCoding) -> Vec<u8> {
        let [nx, ny, nz] = self.dims;
        let edge = EDGE + 2 * self.halo;
        let mut bytes = Vec::with_capacity(edge * edge * edge * 4);
        let [x, y, z] = at.map(|first| first - self.halo as i64);
        let end = x + edge as i64;
        let run = clamped(x, nx)..clamped(end - 1, nx) + 1;
        // Copies of the first voxel, of the last.
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
