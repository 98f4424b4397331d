//! Commands for the device: recorded in order, timed stage by stage, submitted together, and results read back.

use super::context::Context;
use super::timing::Timing;
use crate::error::Result;
use crate::stats::adapter::AdapterKind;
use crate::stats::{Clock, StageTime};

/// Recorded commands, with their device and the times of their stages.
pub(crate) struct Recorder<'a> {
    pub(crate) context: &'a Context,
    encoder: wgpu::CommandEncoder,
    timing: Timing,
    /// Work recorded since the last submission.
    work: u64,
}

/// The largest work of a submission on a GPU that shares the processor's memory, in fragments of splats: by their
/// operations and the sheets that they blend, a few tenths of a second on the slowest. Operating systems reset a GPU
/// whose commands take seconds.
const MAX_WORK: u64 = 200_000_000;
/// The ratio of the work of submissions on GPUs with memory of their own, which [`MAX_WORK`] does not fill.
const DISCRETE: u64 = 10;

/// Returns the largest work of a submission, in fragments of splats.
pub(crate) fn max_work(context: &Context) -> u64 {
    match context.info.kind {
        AdapterKind::Discrete => DISCRETE * MAX_WORK,
        _ => MAX_WORK,
    }
}

/// A copy of a buffer that the host can read once the commands before it are done.
pub(crate) struct Readback {
    staging: wgpu::Buffer,
    bytes: u64,
}

/// A compute pass whose dispatches are counted.
pub(crate) struct ComputePass<'a> {
    pass: wgpu::ComputePass<'a>,
    context: &'a Context,
}

impl ComputePass<'_> {
    /// Dispatches this number of workgroups of a pipeline with its bindings.
    pub(crate) fn dispatch(
        &mut self,
        pipeline: &wgpu::ComputePipeline,
        group: &wgpu::BindGroup,
        offsets: &[u32],
        [x, y, z]: [u32; 3],
    ) {
        self.context.dispatched();
        self.pass.set_pipeline(pipeline);
        self.pass.set_bind_group(0, group, offsets);
        self.pass.dispatch_workgroups(x, y, z);
    }
}

/// Extends two-dimensional workgroups by a third dimension of one.
pub(crate) fn flat([x, y]: [u32; 2]) -> [u32; 3] {
    [x, y, 1]
}

impl<'a> Recorder<'a> {
    /// Records with the time of each stage.
    pub(crate) fn timed(context: &'a Context) -> Self {
        Self::new(context, Timing::new(context))
    }

    /// Records without taking times.
    pub(crate) fn untimed(context: &'a Context) -> Self {
        Self::new(context, Timing::default())
    }

    fn new(context: &'a Context, timing: Timing) -> Self {
        Self { context, encoder: encoder(context), timing, work: 0 }
    }

    /// Begins a compute pass of a stage, for several dispatches.
    pub(crate) fn compute_pass(&mut self, stage: &'static str) -> ComputePass<'_> {
        let pass = self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(stage),
            timestamp_writes: self.timing.compute(self.context, stage),
        });
        ComputePass { pass, context: self.context }
    }

    /// Records a compute pass of one dispatch.
    pub(crate) fn dispatch(
        &mut self,
        stage: &'static str,
        pipeline: &wgpu::ComputePipeline,
        group: &wgpu::BindGroup,
        offsets: &[u32],
        workgroups: [u32; 3],
    ) {
        self.compute_pass(stage).dispatch(pipeline, group, offsets, workgroups);
    }

    /// Begins a render pass of a stage.
    pub(crate) fn render_pass(
        &mut self,
        stage: &'static str,
        attachments: &[Option<wgpu::RenderPassColorAttachment<'_>>],
    ) -> wgpu::RenderPass<'_> {
        self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(stage),
            color_attachments: attachments,
            timestamp_writes: self.timing.render(self.context, stage),
            ..Default::default()
        })
    }

    /// Copies the first `bytes` of a buffer to another, from byte `at` on.
    pub(crate) fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer, at: u64, bytes: u64) {
        self.copy_part((from, 0), (to, at), bytes);
    }

    /// Copies `bytes` of a buffer, from a byte of it on, to a byte of another.
    pub(crate) fn copy_part(&mut self, from: (&wgpu::Buffer, u64), to: (&wgpu::Buffer, u64), bytes: u64) {
        self.encoder.copy_buffer_to_buffer(from.0, from.1, to.0, to.1, bytes);
    }

    /// Sets the first `bytes` of a buffer to 0.
    pub(crate) fn clear(&mut self, buffer: &wgpu::Buffer, bytes: u64) {
        self.encoder.clear_buffer(buffer, 0, Some(bytes));
    }

    /// Copies the first `bytes` of a buffer to memory that the host can read after [`Self::submit`].
    pub(crate) fn read_back(&mut self, label: &str, buffer: &wgpu::Buffer, bytes: u64) -> Result<Readback> {
        self.read_back_from(label, buffer, 0, bytes)
    }

    /// Copies bytes of a buffer from byte `at` on, as [`Self::read_back`] does from the first.
    pub(crate) fn read_back_from(
        &mut self,
        label: &str,
        buffer: &wgpu::Buffer,
        at: u64,
        bytes: u64,
    ) -> Result<Readback> {
        let staging = self.context.staging(label, bytes)?;
        self.encoder.copy_buffer_to_buffer(buffer, at, &staging, 0, bytes);
        Ok(Readback { staging, bytes })
    }

    /// Records that the host can read the times of the stages so far, once it has waited for the next submission.
    pub(crate) fn resolve_times(&mut self) -> Result<()> {
        self.timing.resolve(self.context, &mut self.encoder)
    }

    /// Counts recorded work, and submits it when it reaches the limit of a submission.
    pub(crate) fn worked(&mut self, work: u64) {
        self.work = self.work.saturating_add(work);
        if self.work >= max_work(self.context) {
            self.submit();
        }
    }

    /// Submits the recorded commands to the device.
    pub(crate) fn submit(&mut self) {
        self.work = 0;
        let recorded = std::mem::replace(&mut self.encoder, encoder(self.context));
        self.context.submit(Some(recorded.finish()));
    }

    /// Returns the time of each stage on the device in the order of their first pass, up to the last
    /// [`Self::resolve_times`]; none without timestamps.
    pub(crate) fn times(self) -> Result<Vec<StageTime>> {
        let seconds = self.timing.finish(self.context)?.into_iter();
        Ok(seconds.map(|(name, seconds)| StageTime { name, seconds, clock: Clock::Device }).collect())
    }
}

impl Readback {
    /// Returns the copied values, once all submitted work is done. `doing` completes an error: "while ...".
    pub(crate) fn values<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
        self,
        context: &Context,
        doing: &str,
    ) -> Result<Vec<T>> {
        context.wait(doing)?;
        self.done_values(context, doing)
    }

    /// Returns the copied values, if the host has waited for the commands that write them.
    pub(crate) fn done_values<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
        self,
        context: &Context,
        doing: &str,
    ) -> Result<Vec<T>> {
        context.read_done(doing, self.staging, self.bytes, |bytes| bytemuck::pod_collect_to_vec(bytes))
    }

    /// Calls `read` with the copied bytes, once all submitted work is done.
    pub(crate) fn read<T>(self, context: &Context, doing: &str, read: impl FnOnce(&[u8]) -> T) -> Result<T> {
        context.wait(doing)?;
        context.read_done(doing, self.staging, self.bytes, read)
    }
}

fn encoder(context: &Context) -> wgpu::CommandEncoder {
    context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
}
