//! Sheared accumulation: the optical depths of all voxels towards a light, plane after plane away from the light.
//!
//! A buffer holds, for rays of the light through the places of a lattice of its own, the extinctions that they have
//! passed. It is sheared along the direction of the light, or scaled about the place of the light, so a ray stays at
//! its place in the buffer: each plane of the volume is read into the buffer once, and the buffer is read at the voxels
//! of a plane once. Nothing diffuses from plane to plane, as in sweeps that resample the sum (Kniss et al. 2003). The
//! depth of a voxel is the sum of the planes beyond the nearest few, and an exact sum over its neighbours less the
//! response of the sweep to them ([`SweepResponse`]). A voxel costs 15 multiply-adds and the multiply-adds of its
//! neighbours, wherever it lies.

mod buffer;
mod converging;
mod parallel;

use std::ops::Range;
use std::sync::atomic::AtomicU16;

use rayon::prelude::*;

use self::buffer::Buffer;
pub(super) use self::buffer::RowScratch;
use super::field::{ExtinctionBox, RowPlanes};
use super::incoming::{PointRanges, RayDepths};
use super::lanes::{RowLanes, WHOLE};
use super::response::SweepResponse;
use crate::error::Result;
use crate::vectors::dispatch;

pub(super) use self::converging::{Converging, NearPlace, Pyramid};
pub(super) use self::parallel::{Direction, parallel_planes};

/// The number of rows of a band.
const BAND: usize = 32;

/// The optical depth beyond which the neighbours of a vector of voxels do not count: about 1 of 255 of the light
/// arrives at most, at all of them. Shaders decide for each voxel, by a larger FAINT.
const FAINT: f32 = 5.5;

/// The number of places of the buffer beyond the places that are read.
const MARGIN: f64 = 4.0;

/// The extinctions of a box, ready for sweeps across an axis.
pub(super) struct Swept<'a> {
    pub(super) field: &'a ExtinctionBox,
    pub(super) planes: RowPlanes,
    /// The plane, the row and the column of the first voxel in the lattice.
    pub(super) first: [i64; 3],
    /// The field, filtered by [`filtered`].
    pub(super) filtered: &'a ExtinctionBox,
    pub(super) response: &'a SweepResponse,
}

/// The map between the rows, or columns, of a plane and places of the buffer, in both directions: factor and summand.
#[derive(Clone, Copy)]
pub(super) struct Map {
    pub(super) into: [f64; 2],
    pub(super) back: [f64; 2],
}

/// Rays of one direction, or to one place.
pub(super) struct RaySet<'a> {
    /// The row and the column of the first place among all rays of a direction; `None`: the rays converge. Parallel
    /// rays only shift columns in the buffer, by whole 65536ths.
    pub(super) origin: Option<[i64; 2]>,
    /// The number of places of a row of the buffer.
    pub(super) width: usize,
    /// The maps of the rows and the columns of each plane, the nearest to the light first.
    maps: Vec<[Map; 2]>,
    /// The weight of each plane.
    weights: Vec<f32>,
    /// The distance, for each plane, of rows' places from the places by which rows are handed to bands.
    drifts: Vec<f64>,
    /// The sums of rays that enter a part of a lattice, and the planes, rows and columns that this part adds; `None`:
    /// the lattice is whole.
    incoming: Option<&'a RayDepths>,
    window: Option<PointRanges>,
}

/// Rays that are swept together, so that each plane is read once for all.
struct Sweep<'a, L> {
    swept: &'a Swept<'a>,
    /// Whether the light lies at the end of the last plane.
    ahead: bool,
    /// The number of nearest planes that are not taken from the sweep.
    near: usize,
    rays: Vec<RaySet<'a>>,
    /// The places by which rows are handed to bands, for each plane, and the number of places.
    places: (Vec<Map>, usize),
    light: L,
}

/// The conversion of sums of planes to light at voxels.
trait SweepLight: Sync {
    /// Returns the columns of a row that the light reaches.
    fn within(&self, columns: Range<usize>, at: [usize; 2]) -> Range<usize>;

    /// Stores the light that arrives at some columns of a row of the planes, given a row of sums of planes for each of
    /// the rays, at the voxels of the row.
    fn arrive<S: pulp::Simd>(
        &self,
        simd: S,
        at: [usize; 2],
        columns: Range<usize>,
        sums: &[Vec<f32>],
        out: &[AtomicU16],
    );
}

/// Filters a field for sweeps, which add it up.
pub(super) fn filtered(field: &ExtinctionBox, planes: RowPlanes, response: &SweepResponse) -> Result<ExtinctionBox> {
    let weights = [&response.across, &response.within].map(|w| w.iter().map(|&w| w as f32).collect::<Vec<_>>());
    field.filtered(planes, [&weights[0], &weights[1]])
}

impl<L: SweepLight> Sweep<'_, L> {
    /// Sweeps all bands.
    fn run(&self, out: &[AtomicU16]) {
        let bands = (0..self.places.1.div_ceil(BAND)).into_par_iter();
        bands.for_each_init(BandScratch::default, |scratch, band| {
            dispatch(Band { sweep: self, first: band * BAND, scratch, out });
        });
    }

    /// Returns the plane with a number counted from the light.
    fn plane(&self, number: usize) -> usize {
        let skipped = self.swept.planes.planes - self.places.0.len();
        if self.ahead { self.swept.planes.planes - 1 - skipped - number } else { skipped + number }
    }
}

/// A band: rows that are lit together, [`BAND`] in each plane, beside each other along the rays, so that their buffers
/// stay in a cache. A type so that the sweep is compiled for the widest vectors of the machine.
struct Band<'a, L> {
    sweep: &'a Sweep<'a, L>,
    /// The first place of the band.
    first: usize,
    scratch: &'a mut BandScratch,
    /// The light of each voxel. No two bands write to the same voxel: it is atomic because their rows lie mixed.
    out: &'a [AtomicU16],
}

/// The memory of a band.
#[derive(Default)]
struct BandScratch {
    /// The buffers of all rays.
    buffers: Vec<Buffer>,
    sums: Vec<Vec<f32>>,
}

impl<L: SweepLight> pulp::WithSimd for Band<'_, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let Self { sweep, first, scratch: BandScratch { buffers, sums }, out } = self;
        let Sweep { swept, rays, light, .. } = sweep;
        let RowPlanes { rows, columns, .. } = swept.planes;
        buffers.resize_with(rays.len(), Buffer::default);
        sums.resize_with(rays.len(), Vec::new);
        for ((buffer, sums), rays) in buffers.iter_mut().zip(sums.iter_mut()).zip(rays) {
            buffer.clear(rays, first, columns);
            sums.resize(columns + RowLanes::<S>::COUNT, 0.0);
        }
        let mut added = 0;
        for (number, places) in sweep.places.0.iter().enumerate() {
            let [low, high] = [first, first + BAND]
                .map(|place| ((place as f64 - places.into[1]) / places.into[0]).ceil().max(0.0) as usize);
            let plane = sweep.plane(number);
            for row in low..high.min(rows) {
                let source = swept.planes.row(plane, row);
                let wanted = light.within(swept.field.filled(source), [plane, row]);
                if wanted.is_empty() {
                    continue;
                }
                while added + sweep.near < number {
                    for (buffer, rays) in buffers.iter_mut().zip(rays) {
                        buffer.add(swept, rays, added, sweep.plane(added));
                    }
                    added += 1;
                }
                let out = &out[source * columns..][..columns];
                for run in swept.field.runs(std::iter::once(source)) {
                    let run = run.start.max(wanted.start)..run.end.min(wanted.end);
                    if !run.is_empty() {
                        for ((buffer, rays), sums) in buffers.iter_mut().zip(rays).zip(sums.iter_mut()) {
                            buffer.read(rays, number, row, run.clone(), &mut sums[run.clone()]);
                        }
                        light.arrive(simd, [plane, row], run, sums, out);
                    }
                }
            }
        }
    }
}

/// Rounds a number from 0 to 65535 to the nearest whole number.
#[inline(always)]
pub(super) fn nearest(value: f32) -> u16 {
    (value + WHOLE).to_bits() as u16
}
