//! sort: splats into batches of consecutive sheets, by a stable counting sort.

use std::ops::Range;

use super::plan::Target;
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::Sort;
use crate::gpu::pipeline::Binding::{Read, Uniform, Write};
use crate::gpu::pipeline::buffer_range;
use crate::gpu::recorder::Recorder;
use crate::gpu::scan::Scan;
use crate::gpu::shaders;
use crate::gpu::stage::{Constant, Stage, for_each};
use crate::gpu::store::Store;

/// The least number of splats that one invocation sorts.
const MIN_BLOCK: u64 = 64;
/// The number of counters (blocks times batches) beyond which blocks grow instead: the scan stays cheap beside the
/// splats.
const MAX_COUNTERS: u64 = 1 << 22;

/// The pipelines of the sort.
pub(crate) struct Sorter {
    count: Stage,
    mark: Stage,
    emit: Stage,
}

/// A run of splats of one store.
#[derive(Debug, Clone)]
pub(crate) struct Piece<'a> {
    store: &'a Store,
    /// The first splat of the run, a multiple of the alignment of storage bindings.
    first: u32,
    count: u32,
}

impl<'a> Piece<'a> {
    /// Binds the splats of the piece.
    pub(crate) fn splats(&self) -> wgpu::BindingResource<'_> {
        let stride = self.store.stride;
        buffer_range(&self.store.splats, u64::from(self.first) * stride, u64::from(self.count) * stride)
    }

    /// Returns the part of a run of the store's splats that is in the piece, counted from the piece's first splat.
    fn part(&self, run: &Range<u32>) -> Option<Range<u32>> {
        let (start, end) = (run.start.max(self.first), run.end.min(self.first + self.count));
        (start < end).then(|| start - self.first..end - self.first)
    }

    /// Binds the lattice points at which the bricks of the splats begin.
    pub(crate) fn origins(&self) -> wgpu::BindingResource<'a> {
        self.store.origins.as_entire_binding()
    }
}

/// A piece sorted on its own, small enough that its entries fit into one binding.
pub(crate) struct Span<'a> {
    pub(crate) piece: Piece<'a>,
    /// Number of splats in bricks in view.
    pub(crate) sorted: u32,
    /// The indices of splats in the piece, by batch.
    pub(crate) entries: wgpu::Buffer,
    /// The start of each batch in `entries`; one more ends the last.
    pub(crate) starts: Vec<u32>,
}

impl Span<'_> {
    /// Returns the places of a batch's entries.
    pub(crate) fn batch(&self, batch: u32) -> Range<u32> {
        let batch = batch as usize;
        self.starts[batch]..self.starts[batch + 1]
    }
}

impl Sorter {
    pub(crate) fn new(context: &Context, constants: &[Constant]) -> Self {
        let slots = [Uniform, Uniform, Read, Write, Write, Write, Read, Read];
        let entries = ["count", "mark", "emit"].map(|entry| ("sort", entry));
        let [count, mark, emit] = Stage::several(context, shaders::SORT, entries, &slots, constants);
        Self { count, mark, emit }
    }

    /// Sorts the splats of all stores into batches of `sheets` sheets.
    pub(crate) fn run<'a>(
        &self,
        recorder: &mut Recorder<'_>,
        scan: &Scan,
        target: Target<'_>,
        sheets: u32,
        stores: &'a [Store],
    ) -> Result<Vec<Span<'a>>> {
        let context = recorder.context;
        let binding = context.largest_buffer();
        // Offsets of storage bindings are multiples of at most 256 bytes: 32 scalars.
        let most = (binding / 4 / target.plan.batches_per_splat(sheets) / 32 * 32).max(32);
        let mut spans = Vec::new();
        for store in stores {
            let runs = target.plan.in_view(store, target.region);
            for first in (0..u64::from(store.count)).step_by(most as usize) {
                let count = most.min(u64::from(store.count) - first);
                let piece = Piece { store, first: first as u32, count: count as u32 };
                let runs: Vec<_> = runs.iter().filter_map(|run| piece.part(run)).collect();
                if !runs.is_empty() {
                    spans.push(self.span(recorder, scan, target, sheets, piece, &runs)?);
                }
            }
        }
        Ok(spans)
    }

    /// Sorts the runs of a piece.
    fn span<'a>(
        &self,
        recorder: &mut Recorder<'_>,
        scan: &Scan,
        Target { plan, frame, .. }: Target<'_>,
        sheets_per_batch: u32,
        piece: Piece<'a>,
        runs: &[Range<u32>],
    ) -> Result<Span<'a>> {
        let context = recorder.context;
        let batches = plan.sheets.div_ceil(sheets_per_batch);
        let blocks = blocks(runs, batches);
        let block_count = blocks.len() as u64;
        let counters = block_count * u64::from(batches.max(1)) + 1;
        let parameters = Sort { blocks: blocks.len() as u32, batches, sheets_per_batch };
        let parameters =
            context.upload("sort.parameters", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
        let storage = wgpu::BufferUsages::STORAGE;
        let places = context.buffer("sort.places", counters * 4, storage)?;
        let starts_bytes = u64::from(batches + 1) * 4;
        let starts = context.buffer("sort.starts", starts_bytes, storage | wgpu::BufferUsages::COPY_SRC)?;
        let none = context.buffer("sort.no_entries", 16, storage)?;
        let blocks = context.upload("sort.blocks", bytemuck::cast_slice(&blocks), storage)?;
        let bindings = |entries: &wgpu::Buffer| {
            let resources = [
                frame.as_entire_binding(),
                parameters.as_entire_binding(),
                piece.splats(),
                places.as_entire_binding(),
                starts.as_entire_binding(),
                entries.as_entire_binding(),
                piece.origins(),
                blocks.as_entire_binding(),
            ];
            self.count.bind(context, &resources)
        };
        let each_block = for_each(context, block_count);
        {
            let mut pass = recorder.compute_pass("sort");
            let group = bindings(&none);
            self.count.record(&mut pass, &group, &[], each_block);
            scan.record(context, &mut pass, &places, counters)?;
            self.mark.record(&mut pass, &group, &[], for_each(context, u64::from(batches) + 1));
        }
        let starts = recorder.read_back("sort.starts_staging", &starts, starts_bytes)?;
        recorder.submit();
        let starts: Vec<u32> = starts.values(context, "sorting")?;
        let total = starts.last().copied().unwrap_or(0);
        // Written by the termination of splats too.
        let usage = storage | wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_SRC;
        let entries = context.buffer("sort.entries", u64::from(total) * 4, usage)?;
        self.emit.dispatch(recorder, &bindings(&entries), &[], each_block);
        recorder.submit();
        let sorted = runs.iter().map(|run| run.len() as u32).sum();
        Ok(Span { piece, sorted, entries, starts })
    }
}

/// Splits runs of splats into the blocks that one invocation sorts each, given by their first splat and the one after
/// the last.
fn blocks(runs: &[Range<u32>], batches: u32) -> Vec<[u32; 2]> {
    let sorted: u64 = runs.iter().map(|run| run.len() as u64).sum();
    let block = sorted.div_ceil((MAX_COUNTERS / u64::from(batches.max(1))).max(1)).max(MIN_BLOCK) as u32;
    let blocks = |run: &Range<u32>| {
        let end = run.end;
        run.clone().step_by(block as usize).map(move |first| [first, end.min(first + block)])
    };
    runs.iter().flat_map(blocks).collect()
}
