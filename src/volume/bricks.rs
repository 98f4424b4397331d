//! A volume brick by brick: what each holds is known from its range, and only bricks that matter are read again.

use std::ops::Range;

use bytemuck::Pod;
use rayon::prelude::*;

use super::{Samples, ToF64, Volume, with_samples};
use crate::error::Result;

/// Voxels along the side of a brick.
pub(crate) const EDGE: usize = 32;

/// Bytes of samples that are read at a time, as far as one row of bricks allows.
const READ: usize = 8 << 20;

/// How samples are written down for whoever wants bricks.
pub(crate) trait RowCoding: Sync {
    /// Appends samples to what is there.
    fn append<T: ToF64 + Pod>(&self, samples: &[T], bytes: &mut Vec<u8>);
}

/// The lattice point of a brick's first voxel, and its samples with the halo around them, coded, x fastest.
pub(crate) type Brick = ([u32; 3], Vec<u8>);

/// Ranges of a row of bricks along x, as far as they were looked for, and those of the bricks that show something.
type Row = (Vec<[f64; 2]>, Vec<Option<Brick>>);

/// The planes of a row of bricks along x, with the halo in y and z; copies of the edge where the volume ends.
struct Strip {
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
        let [nx, _, _] = self.grid().dims().map(|d| d as usize);
        let edge = EDGE + 2 * halo;
        let strip_bytes = edge * edge * nx * self.sample_type().size();
        let strips: Vec<usize> = (0..down * deep).collect();
        let known = self.ranges();
        let mut found = Vec::with_capacity(if known.is_some() { 0 } else { across * down * deep });
        for group in strips.chunks((READ / strip_bytes).max(1)) {
            let rows: Vec<Row> = group
                .par_iter()
                .map(|&strip| {
                    let (y, z) = (strip % down * EDGE, strip / down * EDGE);
                    let ranges = known.map(|k| &k[strip * across..(strip + 1) * across]);
                    if ranges.is_some_and(|r| !r.iter().any(|&r| shows(r))) {
                        return Ok((Vec::new(), vec![None; across]));
                    }
                    let read = self.strip(y, z, halo)?;
                    let ranges = ranges.map_or_else(|| read.ranges(nx, y, z), <[_]>::to_vec);
                    let brick = |(i, &range): (usize, &[f64; 2])| {
                        let x = i * EDGE;
                        let origin = [x, y, z].map(|c| c as u32);
                        shows(range).then(|| (origin, read.brick(self.grid().dims(), [x, y, z], halo, coding)))
                    };
                    let bricks = ranges.iter().enumerate().map(brick).collect();
                    Ok((ranges, bricks))
                })
                .collect::<Result<_>>()?;
            for (ranges, bricks) in rows {
                found.extend(ranges);
                bricks.into_iter().try_for_each(&mut *take)?;
            }
        }
        if known.is_none() {
            self.keep_ranges(found);
        }
        Ok(())
    }

    /// Reads the row of bricks whose first voxels have these y and z.
    fn strip(&self, y: usize, z: usize, halo: usize) -> Result<Strip> {
        let [nx, ny, nz] = self.grid().dims().map(|d| d as usize);
        let rows = y.saturating_sub(halo)..ny.min(y + EDGE + halo);
        let planes_from = z.saturating_sub(halo);
        let planes = (planes_from..nz.min(z + EDGE + halo))
            .map(|plane| self.read((plane * ny + rows.start) * nx..(plane * ny + rows.end) * nx))
            .collect::<Result<_>>()?;
        Ok(Strip { planes, planes_from, rows })
    }
}

impl Strip {
    /// The least and the largest stored sample of each brick, the halo left out.
    fn ranges(&self, nx: usize, y: usize, z: usize) -> Vec<[f64; 2]> {
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

    /// The samples of one brick with the halo, coded.
    fn brick(&self, dims: [u32; 3], at: [usize; 3], halo: usize, coding: &impl RowCoding) -> Vec<u8> {
        let [nx, ny, nz] = dims.map(|d| d as usize);
        let edge = EDGE + 2 * halo;
        let mut bytes = Vec::with_capacity(edge * edge * edge * 4);
        // Places past the end of the volume are filled with its last voxels: nobody looks at those past a halo.
        let place = |first: usize, i: usize, n: usize| (first + i).saturating_sub(halo).min(n - 1);
        let x = at[0].saturating_sub(halo)..(at[0] + EDGE + halo).min(nx);
        let (before, behind) = (halo.saturating_sub(at[0]), (at[0] + EDGE + halo).saturating_sub(nx));
        for k in 0..edge {
            let plane = &self.planes[place(at[2], k, nz) - self.planes_from];
            with_samples!(plane, samples => {
                for j in 0..edge {
                    let row = (place(at[1], j, ny) - self.rows.start) * nx;
                    let run = &samples[row + x.start..row + x.end];
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
