//! Short forms of wgpu's descriptors.

use super::context::Context;
use super::shaders::Shader;
use crate::error::Result;

/// The kind of a binding of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Binding {
    /// A uniform buffer, bound as a whole.
    Uniform,
    /// A uniform buffer bound at an offset given with each draw.
    DynamicUniform,
    /// A storage buffer that is only read.
    Read,
    /// A storage buffer that is written.
    Write,
    /// A float texture, read without filtering.
    Texture(wgpu::TextureViewDimension),
    /// A float texture that a sampler reads between texels.
    FilteredTexture(wgpu::TextureViewDimension),
    Sampler,
    /// A texture of unsigned integers.
    IntegerTexture(wgpu::TextureViewDimension),
    /// A storage texture that is read: faster than others on software Vulkan, which look up their level each time.
    ReadTexture(wgpu::TextureFormat),
    /// A texture that is written.
    StorageTexture(wgpu::TextureFormat, wgpu::TextureViewDimension),
}

impl Binding {
    fn binding_type(self) -> wgpu::BindingType {
        use wgpu::{BindingType, BufferBindingType, SamplerBindingType, StorageTextureAccess, TextureSampleType};
        let buffer = |ty, has_dynamic_offset| BindingType::Buffer { ty, has_dynamic_offset, min_binding_size: None };
        let storage = |read_only| buffer(BufferBindingType::Storage { read_only }, false);
        let texture =
            |sample_type, view_dimension| BindingType::Texture { sample_type, view_dimension, multisampled: false };
        let float = |filterable, dimension| texture(TextureSampleType::Float { filterable }, dimension);
        let stored = |access, format, view_dimension| BindingType::StorageTexture { access, format, view_dimension };
        match self {
            Self::Uniform => buffer(BufferBindingType::Uniform, false),
            Self::DynamicUniform => buffer(BufferBindingType::Uniform, true),
            Self::Read => storage(true),
            Self::Write => storage(false),
            Self::Texture(dimension) => float(false, dimension),
            Self::FilteredTexture(dimension) => float(true, dimension),
            Self::Sampler => BindingType::Sampler(SamplerBindingType::Filtering),
            Self::IntegerTexture(dimension) => texture(TextureSampleType::Uint, dimension),
            Self::ReadTexture(format) => stored(StorageTextureAccess::ReadOnly, format, wgpu::TextureViewDimension::D2),
            Self::StorageTexture(format, dimension) => stored(StorageTextureAccess::WriteOnly, format, dimension),
        }
    }
}

/// Makes a bind group layout of the slots at bindings 0, 1, 2, ...
pub(crate) fn layout(
    context: &Context,
    stage: &str,
    visibility: wgpu::ShaderStages,
    slots: &[Binding],
) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = (0..)
        .zip(slots)
        .map(|(binding, slot)| wgpu::BindGroupLayoutEntry { binding, visibility, ty: slot.binding_type(), count: None })
        .collect();
    context.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(&format!("{stage}.layout")),
        entries: &entries,
    })
}

/// Makes a bind group of resources at bindings 0, 1, 2, ...
pub(crate) fn bind(
    context: &Context,
    stage: &str,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource<'_>],
) -> wgpu::BindGroup {
    let entries: Vec<_> = (0..)
        .zip(resources)
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource: resource.clone() })
        .collect();
    context.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(&format!("{stage}.bindings")),
        layout,
        entries: &entries,
    })
}

/// Returns a texture as a binding.
pub(crate) fn texture_view(view: &wgpu::TextureView) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::TextureView(view)
}

/// Returns the range of a buffer from byte `offset`, `size` bytes long, as a binding.
pub(crate) fn buffer_range(buffer: &wgpu::Buffer, offset: u64, size: u64) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset, size: std::num::NonZeroU64::new(size) })
}

pub(crate) fn module(context: &Context, shader: Shader) -> wgpu::ShaderModule {
    context.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(shader.name),
        source: wgpu::ShaderSource::Wgsl(shader.source().into()),
    })
}

fn pipeline_layout(context: &Context, stage: &str, group: &wgpu::BindGroupLayout) -> wgpu::PipelineLayout {
    context.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(&format!("{stage}.pipeline_layout")),
        bind_group_layouts: &[Some(group)],
        immediate_size: 0,
    })
}

/// Makes a compute pipeline of one entry point, specialised by override constants.
pub(crate) fn compute(
    context: &Context,
    module: &wgpu::ShaderModule,
    stage: &str,
    entry: &str,
    group: &wgpu::BindGroupLayout,
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    context.made_pipeline();
    context.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(&format!("{stage}.{entry}")),
        layout: Some(&pipeline_layout(context, stage, group)),
        module,
        entry_point: Some(entry),
        compilation_options: specialised(constants),
        cache: None,
    })
}

/// The parts in which render pipelines differ. Entry points come with their override constants.
pub(crate) struct Render<'a> {
    pub(crate) label: &'a str,
    /// The layout of the bindings; `None`: the stages have no bindings.
    pub(crate) layout: Option<&'a wgpu::BindGroupLayout>,
    pub(crate) module: &'a wgpu::ShaderModule,
    pub(crate) vertex: (&'a str, &'a [(&'a str, f64)]),
    pub(crate) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    pub(crate) topology: wgpu::PrimitiveTopology,
    pub(crate) fragment: (&'a str, &'a [(&'a str, f64)]),
    pub(crate) targets: &'a [Option<wgpu::ColorTargetState>],
}

impl Render<'_> {
    pub(crate) fn pipeline(&self, context: &Context) -> wgpu::RenderPipeline {
        let layout = match self.layout {
            Some(group) => pipeline_layout(context, self.label, group),
            None => context.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor::default()),
        };
        context.made_pipeline();
        context.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.label),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: self.module,
                entry_point: Some(self.vertex.0),
                compilation_options: specialised(self.vertex.1),
                buffers: self.buffers,
            },
            primitive: wgpu::PrimitiveState { topology: self.topology, ..Default::default() },
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: self.module,
                entry_point: Some(self.fragment.0),
                compilation_options: specialised(self.fragment.1),
                targets: self.targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// Makes two sets of pipelines at the same time.
pub(crate) fn both<A: Send, B: Send>(
    context: &Context,
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> Result<(A, B)> {
    // Error scopes belong to a thread. It is no thread of a pool: callers hold locks, and a thread that waits in a pool
    // may be handed work that takes them.
    const STAGE: &str = "making pipelines";
    std::thread::scope(|scope| {
        let first = scope.spawn(|| context.guarded(STAGE, || Ok(first())));
        let second = context.guarded(STAGE, || Ok(second()));
        let first = first.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        Ok((first?, second?))
    })
}

/// Returns the value of an override constant that is a bool.
pub(crate) fn flag(value: bool) -> f64 {
    f64::from(u8::from(value))
}

/// Specialises a stage by override constants. Stages clear the memory of workgroups themselves.
fn specialised<'a>(constants: &'a [(&'a str, f64)]) -> wgpu::PipelineCompilationOptions<'a> {
    wgpu::PipelineCompilationOptions { constants, zero_initialize_workgroup_memory: false }
}
