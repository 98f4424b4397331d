//! Compute stages: a pipeline of an entry point, specialised, with the layout of its bindings.

use super::context::Context;
use super::pipeline::{self, Binding, buffer_range, compute, module};
use super::recorder::{ComputePass, Recorder};
use super::scan::WORKGROUP;
use super::shaders::Shader;
use crate::error::Result;

/// An override constant of shaders and its value. A painter has one list for all of its shaders.
pub(crate) type Constant = (&'static str, u32);

/// Returns the constants that a shader declares; any other constant would be an error.
pub(crate) fn declared(shader: Shader, constants: &[Constant]) -> Vec<(&'static str, f64)> {
    let source = shader.source();
    let declares = |name: &str| source.contains(&format!("override {name}:"));
    constants.iter().filter(|(name, _)| declares(name)).map(|&(name, value)| (name, f64::from(value))).collect()
}

/// A compute pipeline and the layout of its bindings.
pub(crate) struct Stage {
    name: &'static str,
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

impl Stage {
    /// Makes the pipeline of one entry point. The stage has its `name` in
    /// [`Stats::stages`](crate::stats::Stats::stages).
    pub(crate) fn new(
        context: &Context,
        shader: Shader,
        (name, entry): (&'static str, &str),
        slots: &[Binding],
        constants: &[Constant],
    ) -> Self {
        let [stage] = Self::several(context, shader, [(name, entry)], slots, constants);
        stage
    }

    /// Makes the pipelines of entry points with the same bindings: a group of one serves the others.
    pub(crate) fn several<const N: usize>(
        context: &Context,
        shader: Shader,
        entries: [(&'static str, &str); N],
        slots: &[Binding],
        constants: &[Constant],
    ) -> [Self; N] {
        let constants = declared(shader, constants);
        let module = module(context, shader);
        let layout = pipeline::layout(context, shader.name, wgpu::ShaderStages::COMPUTE, slots);
        entries.map(|(name, entry)| {
            let pipeline = compute(context, &module, shader.name, entry, &layout, &constants);
            Self { name, layout: layout.clone(), pipeline }
        })
    }

    /// Makes a group of resources at bindings 0, 1, 2, ...
    pub(crate) fn bind(&self, context: &Context, resources: &[wgpu::BindingResource<'_>]) -> wgpu::BindGroup {
        pipeline::bind(context, self.name, &self.layout, resources)
    }

    /// Records a dispatch as a pass of its own.
    pub(crate) fn dispatch(
        &self,
        recorder: &mut Recorder<'_>,
        group: &wgpu::BindGroup,
        offsets: &[u32],
        workgroups: [u32; 3],
    ) {
        recorder.dispatch(self.name, &self.pipeline, group, offsets, workgroups);
    }

    /// Binds resources and records a dispatch as a pass of its own.
    pub(crate) fn run(
        &self,
        recorder: &mut Recorder<'_>,
        resources: &[wgpu::BindingResource<'_>],
        workgroups: [u32; 3],
    ) {
        let group = self.bind(recorder.context, resources);
        self.dispatch(recorder, &group, &[], workgroups);
    }

    /// Adds a dispatch to a pass.
    pub(crate) fn record(
        &self,
        pass: &mut ComputePass<'_>,
        group: &wgpu::BindGroup,
        offsets: &[u32],
        workgroups: [u32; 3],
    ) {
        pass.dispatch(&self.pipeline, group, offsets, workgroups);
    }
}

/// Returns the workgroups of a dispatch with an invocation for each of `count` items.
pub(crate) fn for_each(context: &Context, count: u64) -> [u32; 3] {
    let (x, y) = context.workgroups(count, WORKGROUP);
    [x, y, 1]
}

/// Parameters of many draws or dispatches in one uniform buffer, each at an offset that can be bound.
pub(crate) struct DynamicUniforms {
    buffer: wgpu::Buffer,
    stride: u32,
    size: u64,
}

impl DynamicUniforms {
    pub(crate) fn new<T: bytemuck::Pod>(context: &Context, label: &str, parameters: &[T]) -> Result<Self> {
        let size = size_of::<T>().next_multiple_of(16);
        let stride = size.next_multiple_of(context.limits.min_uniform_buffer_offset_alignment.max(16) as usize);
        let mut bytes = vec![0_u8; stride * parameters.len().max(1)];
        for (slot, parameters) in bytes.chunks_exact_mut(stride).zip(parameters) {
            slot[..size_of::<T>()].copy_from_slice(bytemuck::bytes_of(parameters));
        }
        let buffer = context.upload(label, &bytes, wgpu::BufferUsages::UNIFORM)?;
        Ok(Self { buffer, stride: stride as u32, size: size as u64 })
    }

    pub(crate) fn binding(&self) -> wgpu::BindingResource<'_> {
        buffer_range(&self.buffer, 0, self.size)
    }

    pub(crate) fn offset(&self, index: u32) -> u32 {
        index * self.stride
    }
}
