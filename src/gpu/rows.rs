//! Splats that a stage counts and emits row by row of bricks: the count of each row, a scan that turns the counts into
//! places, and the splats at these places.

use super::context::Context;
use super::recorder::{ComputePass, Readback, Recorder};
use super::samples::ROWS;
use super::scan::Scan;
use super::store::{Splats, StoreBuilder, StorePart};
use crate::error::Result;
use crate::splats::brick::BrickSplats;

/// The buffers of the rows of a set of bricks.
pub(super) struct Rows {
    /// The number of splats of each row; after the scan, the place of its first splat. One more number is the total.
    pub(super) places: wgpu::Buffer,
    /// The bits of the places with splats, for each row.
    pub(super) seen: wgpu::Buffer,
    /// The splats; a few bytes while they are counted.
    pub(super) splats: wgpu::Buffer,
}

/// A function that records the dispatch that counts the splats of rows, or that emits them, given the number of their
/// first brick in its store.
pub(super) type Record<'a> = dyn Fn(&mut ComputePass<'_>, Option<u32>, &Rows) -> Result<()> + 'a;

/// The rows of bricks with splats, in a store.
pub(super) struct Collected {
    /// The rows, whose splats are a part of the store.
    pub(super) rows: Rows,
    /// The number of the store; `first_brick` and `first_splat` are the rows' first brick and splat in it.
    pub(super) store: usize,
    pub(super) first_brick: u32,
    pub(super) first_splat: u32,
}

/// A part of a store: splats on the device.
pub(super) struct DevicePart {
    splats: wgpu::Buffer,
    count: u32,
    /// The lattice points at which the bricks begin.
    origins: wgpu::Buffer,
}

/// Bricks by the lattice points of their first places, on the host and on the device.
pub(super) type Origins<'a> = (&'a [[u32; 4]], &'a wgpu::Buffer);

/// Rows whose splats are counted and not yet emitted.
pub(super) struct Counted {
    rows: Rows,
    places: Readback,
    seen: Readback,
}

const STAGE: &str = "classifying the volume";
const USAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_SRC);

impl Counted {
    /// Records the count of the splats of `bricks` bricks.
    pub(super) fn record(recorder: &mut Recorder<'_>, scan: &Scan, bricks: usize, record: &Record<'_>) -> Result<Self> {
        let context = recorder.context;
        let count = (bricks * ROWS) as u64;
        let (places_bytes, seen_bytes) = ((count + 1) * 4, count * 4);
        let rows = Rows {
            places: context.buffer("classify.places", places_bytes, USAGE)?,
            seen: context.buffer("classify.seen", seen_bytes, USAGE)?,
            splats: context.buffer("classify.no_splats", 16, USAGE)?,
        };
        {
            let mut pass = recorder.compute_pass("classify");
            record(&mut pass, None, &rows)?;
            scan.record(context, &mut pass, &rows.places, count + 1)?;
        }
        let places = recorder.read_back("classify.places_staging", &rows.places, places_bytes)?;
        let seen = recorder.read_back("classify.seen_staging", &rows.seen, seen_bytes)?;
        Ok(Self { rows, places, seen })
    }

    /// Emits the counted splats, of `stride` bytes each, into a store; `None` if there are none. The host has waited
    /// for the counts.
    pub(super) fn emit(
        self,
        context: &Context,
        (stores, stride): (&mut StoreBuilder<'_, DevicePart>, u64),
        (origins, on_device): Origins<'_>,
        record: &Record<'_>,
    ) -> Result<Option<Collected>> {
        let Self { mut rows, places, seen } = self;
        let places: Vec<u32> = places.done_values(context, STAGE)?;
        let seen: Vec<u32> = seen.done_values(context, STAGE)?;
        let visible = places.last().copied().unwrap_or_default();
        if visible == 0 {
            return Ok(None);
        }
        let (first_brick, first_splat) = stores.make_room(visible, origins.len())?;
        rows.splats = context.buffer("classify.splats", u64::from(visible) * stride, USAGE)?;
        let mut recorder = Recorder::untimed(context);
        record(&mut recorder.compute_pass("classify"), Some(first_brick), &rows)?;
        recorder.submit();
        let bricks = origins.iter().zip(places.iter().step_by(ROWS).zip(seen.chunks_exact(ROWS)));
        let bricks = bricks.map(|(&[x, y, z, _], (place, seen))| {
            BrickSplats::new([x, y, z], first_splat + place, seen.iter().copied())
        });
        let splats = rows.splats.clone();
        stores.add(DevicePart { splats, count: visible, origins: on_device.clone() }, visible, bricks);
        Ok(Some(Collected { rows, store: stores.closed(), first_brick, first_splat }))
    }
}

/// Counts the splats of bricks and emits them into a store, after the recorder's commands; `None` if there are none.
pub(super) fn collect(
    mut recorder: Recorder<'_>,
    scan: &Scan,
    stores: (&mut StoreBuilder<'_, DevicePart>, u64),
    origins: Origins<'_>,
    record: &Record<'_>,
) -> Result<Option<Collected>> {
    let context = recorder.context;
    let counted = Counted::record(&mut recorder, scan, origins.0.len(), record)?;
    recorder.submit();
    context.wait(STAGE)?;
    counted.emit(context, stores, origins, record)
}

impl StorePart for DevicePart {
    fn join(context: &Context, parts: Vec<Self>, stride: u64, count: u32) -> Result<(Splats, Option<wgpu::Buffer>)> {
        if let [part] = parts.as_slice() {
            return Ok((Splats::Listed(part.splats.clone()), Some(part.origins.clone())));
        }
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let joined = context.buffer("classify.store", u64::from(count) * stride, usage)?;
        let origins = context.buffer("splats.origins", parts.iter().map(|part| part.origins.size()).sum(), usage)?;
        let mut recorder = Recorder::untimed(context);
        let (mut at, mut brick) = (0, 0);
        for part in &parts {
            let bytes = u64::from(part.count) * stride;
            recorder.copy(&part.splats, &joined, at, bytes);
            recorder.copy(&part.origins, &origins, brick, part.origins.size());
            (at, brick) = (at + bytes, brick + part.origins.size());
        }
        recorder.submit();
        // Waiting here frees the parts before others are made.
        context.wait(STAGE)?;
        Ok((Splats::Listed(joined), Some(origins)))
    }
}
