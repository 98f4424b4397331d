//! terminate: marks the entries of a batch that opaque pixels hide.

use super::plan::Target;
use super::sort::Span;
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::Terminate;
use crate::gpu::pipeline::Binding::{DynamicUniform, Read, Uniform, Write};
use crate::gpu::recorder::Recorder;
use crate::gpu::shaders;
use crate::gpu::stage::{Constant, DynamicUniforms, Stage, for_each};

/// The number of entries that one invocation tests; RUN in shaders/terminate.wgsl.
pub(crate) const RUN: u64 = 16;
/// The bytes of `Tally` in shaders/terminate.wgsl.
const TALLY: u64 = 8;

/// The pipelines that mark hidden splats.
pub(super) struct Terminator {
    tile: Stage,
    mark: Stage,
}

/// The stage that marks hidden splats, bound to a region.
pub(super) struct Termination<'a> {
    stage: &'a Terminator,
    batches: DynamicUniforms,
    groups: Vec<wgpu::BindGroup>,
    tiles: u64,
    tally: wgpu::Buffer,
}

impl Terminator {
    pub(super) fn new(context: &Context, constants: &[Constant]) -> Self {
        let slots = [Uniform, DynamicUniform, Read, Write, Read, Write, Write, Read];
        let entries = ["tile", "mark"].map(|entry| ("terminate", entry));
        let [tile, mark] = Stage::several(context, shaders::TERMINATE, entries, &slots, constants);
        Self { tile, mark }
    }

    pub(super) fn bind(
        &self,
        context: &Context,
        target: Target<'_>,
        pixels: &wgpu::Buffer,
        spans: &[Span<'_>],
        batches: u32,
    ) -> Result<Termination<'_>> {
        let parameters: Vec<_> = (0..batches)
            .flat_map(|batch| spans.iter().map(move |span| span.batch(batch)))
            .map(|range| Terminate { first: range.start, count: range.len() as u32 })
            .collect();
        let batches = DynamicUniforms::new(context, "terminate.batches", &parameters)?;
        let count: u64 = target.plan.tiles(target.region).map(u64::from).iter().product();
        let tiles = context.buffer("terminate.tiles", count * 4, wgpu::BufferUsages::STORAGE)?;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let tally = context.buffer("terminate.tally", TALLY, usage)?;
        let groups = spans
            .iter()
            .map(|span| {
                let resources = [
                    target.frame.as_entire_binding(),
                    batches.binding(),
                    pixels.as_entire_binding(),
                    tiles.as_entire_binding(),
                    span.piece.splats(),
                    span.entries.as_entire_binding(),
                    tally.as_entire_binding(),
                    span.piece.origins(),
                ];
                self.mark.bind(context, &resources)
            })
            .collect();
        Ok(Termination { stage: self, batches, groups, tiles: count, tally })
    }
}

impl Termination<'_> {
    /// Marks the hidden entries of a batch.
    pub(super) fn record(&self, recorder: &mut Recorder<'_>, spans: &[Span<'_>], batch: u32) {
        let Some(first) = self.groups.first() else { return };
        let context = recorder.context;
        let mut pass = recorder.compute_pass("terminate");
        self.stage.tile.record(&mut pass, first, &[0], for_each(context, self.tiles));
        for ((index, span), group) in (0..).zip(spans).zip(&self.groups) {
            let count = span.batch(batch).len() as u64;
            if count > 0 {
                let offset = self.batches.offset(batch * spans.len() as u32 + index);
                self.stage.mark.record(&mut pass, group, &[offset], for_each(context, count.div_ceil(RUN)));
            }
        }
    }

    /// Submits what was recorded and returns the number of entries marked.
    pub(super) fn marked(&self, recorder: &mut Recorder<'_>) -> Result<u64> {
        let tally = recorder.read_back("terminate.staging", &self.tally, TALLY)?;
        recorder.submit();
        Ok(tally.values::<u32>(recorder.context, "splatting")?.get(1).copied().map_or(0, u64::from))
    }
}
