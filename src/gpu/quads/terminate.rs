//! terminate: marks the entries of a batch that opaque pixels hide.

use super::super::context::Context;
use super::super::layout::Terminate;
use super::super::pipeline::{Slot, bind, compute, flag, layout, module, part};
use super::super::plan::Target;
use super::super::scan::WORKGROUP;
use super::super::shaders;
use super::super::sort::Span;
use super::super::timing::Timing;
use super::{QuadsKey, Slots};
use crate::error::Result;

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
    batches: Slots,
    groups: Vec<wgpu::BindGroup>,
    tiles: u64,
    tally: wgpu::Buffer,
}

impl Terminator {
    pub(super) fn new(context: &Context, key: QuadsKey) -> Self {
        let slots = [
            Slot::Uniform,
            Slot::DynamicUniform,
            Slot::Read,
            Slot::Write,
            Slot::Read,
            Slot::Write,
            Slot::Write,
            Slot::Read,
        ];
        let layout = layout(context, "terminate", wgpu::ShaderStages::COMPUTE, &slots);
        let module = module(context, shaders::TERMINATE);
        let constants = [
            ("PERSPECTIVE", flag(key.perspective)),
            ("GROWN", flag(key.grown)),
            ("SCALARS", flag(key.feed.is_scalar())),
        ];
        Self {
            tile: compute(context, &module, "terminate", "tile", &layout, &[]),
            mark: compute(context, &module, "terminate", "mark", &layout, &constants),
            layout,
        }
    }

    pub(super) fn bind(
        &self,
        context: &Context,
        target: Target<'_>,
        pixels: &wgpu::Buffer,
        spans: &[Span<'_>],
        batches: u32,
    ) -> Result<Termination<'_>> {
        let margin = target.plan.margin() as f32;
        let parameters: Vec<_> = (0..batches)
            .flat_map(|batch| spans.iter().map(move |span| span.batch(batch)))
            .map(|range| Terminate { first: range.start, count: range.len() as u32, margin })
            .collect();
        let batches = Slots::new(context, "terminate.batches", &parameters)?;
        let [across, down] = target.plan.tiles(target.region);
        let count = u64::from(across) * u64::from(down);
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
                    part(&tiles, 0, count * 4),
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

    /// The number of entries marked, from the copy of a tally.
    pub(super) fn terminated(context: &Context, tally: &wgpu::Buffer) -> Result<u64> {
        let bytes = context.read("splatting", tally)?;
        Ok(u64::from(bytemuck::pod_read_unaligned::<u32>(&bytes[4..8])))
    }
}

impl Termination<'_> {
    /// Marks the hidden entries of a batch.
    pub(super) fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        timing: &mut Timing,
        spans: &[Span<'_>],
        batch: u32,
    ) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("terminate"),
            timestamp_writes: timing.compute(context, "terminate"),
        });
        let Some(first) = self.groups.first() else { return };
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

    /// A copy of the tally that can be read when the commands are done.
    pub(super) fn tally(&self, context: &Context, encoder: &mut wgpu::CommandEncoder) -> Result<wgpu::Buffer> {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let staging = context.buffer("terminate.staging", TALLY, usage)?;
        encoder.copy_buffer_to_buffer(&self.tally, 0, &staging, 0, TALLY);
        Ok(staging)
    }
}
