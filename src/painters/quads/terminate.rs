//! terminate: marks the entries of a batch that opaque pixels hide.

use super::plan::Target;
use super::sort::Span;
use super::{DynamicUniforms, Feed, QuadsKey};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::Terminate;
use crate::gpu::pipeline::{Binding, bind, compute, flag, layout, module};
use crate::gpu::recorder::{Readback, Recorder};
use crate::gpu::scan::WORKGROUP;
use crate::gpu::shaders;

/// Entries that one invocation looks at; RUN in shaders/terminate.wgsl.
pub(crate) const RUN: u64 = 16;
/// Bytes of `Tally` in shaders/terminate.wgsl.
const TALLY: u64 = 8;

/// The pipelines.
pub(super) struct Terminator {
    layout: wgpu::BindGroupLayout,
    tile: wgpu::ComputePipeline,
    mark: wgpu::ComputePipeline,
}

/// What the batches of one region are looked at with.
pub(super) struct Termination<'a> {
    stage: &'a Terminator,
    batches: DynamicUniforms,
    groups: Vec<wgpu::BindGroup>,
    tiles: u64,
    tally: wgpu::Buffer,
}

impl Terminator {
    pub(super) fn new(context: &Context, key: QuadsKey) -> Self {
        let slots = [
            Binding::Uniform,
            Binding::DynamicUniform,
            Binding::Read,
            Binding::Write,
            Binding::Read,
            Binding::Write,
            Binding::Write,
            Binding::Read,
        ];
        let layout = layout(context, "terminate", wgpu::ShaderStages::COMPUTE, &slots);
        let module = module(context, shaders::TERMINATE);
        let constants = [
            ("PERSPECTIVE", flag(key.perspective)),
            ("GROWN", flag(key.grown)),
            ("SCALARS", flag(key.feed.is_scalar())),
            ("GRADIENTS", flag(key.feed == Feed::LitScalars)),
            ("SHADOWS", flag(key.shadows)),
        ];
        let pipeline = |entry, constants: &[_]| compute(context, &module, "terminate", entry, &layout, constants);
        Self { tile: pipeline("tile", &[]), mark: pipeline("mark", &constants), layout }
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
                bind(context, "terminate", &self.layout, &resources)
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
        pass.set_pipeline(&self.stage.tile);
        pass.set_bind_group(0, first, &[0]);
        let (x, y) = context.workgroups(self.tiles, WORKGROUP);
        pass.dispatch_workgroups(x, y, 1);
        pass.set_pipeline(&self.stage.mark);
        for ((index, span), group) in (0..).zip(spans).zip(&self.groups) {
            let count = span.batch(batch).len() as u64;
            if count > 0 {
                pass.set_bind_group(0, group, &[self.batches.offset(batch * spans.len() as u32 + index)]);
                let (x, y) = context.workgroups(count.div_ceil(RUN), WORKGROUP);
                pass.dispatch_workgroups(x, y, 1);
            }
        }
    }

    /// Asks for the number of entries marked, which [`Terminator::marked`] reads.
    pub(super) fn tally(&self, recorder: &mut Recorder<'_>) -> Result<Readback> {
        recorder.read_back("terminate.staging", &self.tally, TALLY)
    }
}

impl Terminator {
    /// The number of entries marked, once the commands are done.
    pub(super) fn marked(context: &Context, tally: &Readback) -> Result<u64> {
        Ok(tally.values::<u32>(context, "splatting")?.get(1).copied().map_or(0, u64::from))
    }
}
