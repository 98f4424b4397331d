//! terminate: marks the entries of a batch that opaque pixels hide, bricks first.

use super::super::context::Context;
use super::super::layout::Terminate;
use super::super::pipeline::{Slot, bind, compute, flag, layout, module};
use super::super::scan::WORKGROUP;
use super::super::shaders;
use super::super::timing::Timing;
use super::plan::Target;
use super::sort::Span;
use super::{QuadsKey, Slots};
use crate::error::Result;

/// Entries that one invocation looks at; RUN in shaders/terminate.wgsl.
pub(crate) const RUN: u64 = 16;
/// Bytes of `Tally` in shaders/terminate.wgsl.
const TALLY: u64 = 12;
/// LEVELS and STEP in shaders/terminate.wgsl.
pub(crate) const LEVELS: u64 = 2;
pub(crate) const STEP: u64 = 4;

/// The pipelines.
pub(super) struct Terminator {
    layout: wgpu::BindGroupLayout,
    tile: wgpu::ComputePipeline,
    raise: wgpu::ComputePipeline,
    group: wgpu::ComputePipeline,
    mark: wgpu::ComputePipeline,
}

/// What the batches of one region are looked at with.
pub(super) struct Termination<'a> {
    stage: &'a Terminator,
    batches: Slots,
    groups: Vec<wgpu::BindGroup>,
    /// Tiles, and blocks of them in the levels above.
    tiles: u64,
    blocks: u64,
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
            Slot::Write,
        ];
        let layout = layout(context, "terminate", wgpu::ShaderStages::COMPUTE, &slots);
        let module = module(context, shaders::TERMINATE);
        let constants = [
            ("PERSPECTIVE", flag(key.perspective)),
            ("GROWN", flag(key.grown)),
            ("SCALARS", flag(key.feed.is_scalar())),
        ];
        let pipeline = |entry, constants: &[_]| compute(context, &module, "terminate", entry, &layout, constants);
        Self {
            tile: pipeline("tile", &[]),
            raise: pipeline("raise", &[]),
            group: pipeline("group", &constants[..2]),
            mark: pipeline("mark", &constants),
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
        let [across, down] = target.plan.tiles(target.region).map(u64::from);
        let level = |side: u64| across.div_ceil(side) * down.div_ceil(side);
        let blocks = (1..=LEVELS as u32).map(|n| level(STEP.pow(n))).sum();
        let tiles = context.buffer("terminate.tiles", (level(1) + blocks) * 4, wgpu::BufferUsages::STORAGE)?;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let tally = context.buffer("terminate.tally", TALLY, usage)?;
        let groups = spans
            .iter()
            .map(|span| {
                let bricks = span.piece.bricks() as u64;
                let hidden = context.buffer("terminate.hidden", bricks * 4, wgpu::BufferUsages::STORAGE)?;
                let resources = [
                    target.frame.as_entire_binding(),
                    batches.binding(),
                    pixels.as_entire_binding(),
                    tiles.as_entire_binding(),
                    span.piece.splats(),
                    span.entries.as_entire_binding(),
                    tally.as_entire_binding(),
                    span.piece.origins(),
                    hidden.as_entire_binding(),
                ];
                Ok(bind(context, "terminate", &self.layout, &resources))
            })
            .collect::<Result<_>>()?;
        Ok(Termination { stage: self, batches, groups, tiles: level(1), blocks, tally })
    }

    /// The number of entries marked and of bricks found hidden, from the copy of a tally.
    pub(super) fn terminated(context: &Context, tally: &wgpu::Buffer) -> Result<[u64; 2]> {
        let bytes = context.read("splatting", tally)?;
        let word = |first: usize| u64::from(bytemuck::pod_read_unaligned::<u32>(&bytes[first..first + 4]));
        Ok([word(4), word(8)])
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
        pass.set_pipeline(&self.stage.raise);
        let (x, y) = context.workgroups(self.blocks, WORKGROUP);
        pass.dispatch_workgroups(x, y, 1);
        pass.set_pipeline(&self.stage.group);
        for (span, group) in spans.iter().zip(&self.groups) {
            pass.set_bind_group(0, group, &[0]);
            let (x, y) = context.workgroups(span.piece.bricks() as u64, WORKGROUP);
            pass.dispatch_workgroups(x, y, 1);
        }
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
