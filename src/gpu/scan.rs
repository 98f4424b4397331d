//! scan: exclusive prefix sums of u32, in as many levels as the length needs.

use std::sync::Arc;

use super::cache::Cache;
use super::context::Context;
use super::pipeline::{Binding, bind, buffer_range, compute, layout, module};
use super::recorder::ComputePass;
use super::shaders;
use crate::error::Result;

/// Number of values that one invocation sums; RUN in shaders/scan.wgsl.
pub(crate) const RUN: u64 = 128;
/// Number of invocations of a workgroup; WORKGROUP in shaders/common/dispatch.wgsl.
pub(crate) const WORKGROUP: u64 = 64;

/// The pipelines of the scan.
pub(crate) struct Scan {
    layout: wgpu::BindGroupLayout,
    reduce: wgpu::ComputePipeline,
    spread: wgpu::ComputePipeline,
}

impl Scan {
    /// Returns the pipelines of the scan, made now if there are none.
    pub(crate) fn of(pipelines: &Cache, context: &Context) -> Result<Arc<Self>> {
        pipelines.get_or_make((), || Ok(Self::new(context)))
    }

    pub(crate) fn new(context: &Context) -> Self {
        let module = module(context, shaders::SCAN);
        let layout = layout(context, "scan", wgpu::ShaderStages::COMPUTE, &[Binding::Write, Binding::Write]);
        let pipeline = |entry| compute(context, &module, "scan", entry, &layout, &[]);
        Self { reduce: pipeline("reduce"), spread: pipeline("spread"), layout }
    }

    /// Records the scan of the first `count` values of `values`, in place, into `pass`.
    pub(crate) fn record(
        &self,
        context: &Context,
        pass: &mut ComputePass<'_>,
        values: &wgpu::Buffer,
        count: u64,
    ) -> Result<()> {
        let runs = count.div_ceil(RUN);
        let sums = context.buffer("scan.sums", runs * 4, wgpu::BufferUsages::STORAGE)?;
        let group = bind(
            context,
            "scan",
            &self.layout,
            &[buffer_range(values, 0, count * 4), buffer_range(&sums, 0, runs * 4)],
        );
        let (x, y) = context.workgroups(runs, WORKGROUP);
        let workgroups = [x, y, 1];
        // A single run has no higher level: its offset is the zero of a new buffer.
        if runs > 1 {
            pass.dispatch(&self.reduce, &group, &[], workgroups);
            self.record(context, pass, &sums, runs)?;
        }
        pass.dispatch(&self.spread, &group, &[], workgroups);
        Ok(())
    }
}
