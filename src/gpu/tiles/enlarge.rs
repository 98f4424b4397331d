//! prefilter and enlarge: the raster to the picture. See shaders/prefilter.wgsl and shaders/enlarge.wgsl.

use super::super::context::Context;
use super::super::pipeline::{Binding, bind, compute, flag, layout, module, texture_view};
use super::super::recorder::Recorder;
use super::super::shaders;

/// The format of what is enlarged.
pub(super) const PICTURE: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// The pipelines.
pub(super) struct Enlarge {
    filtering: wgpu::BindGroupLayout,
    across: wgpu::ComputePipeline,
    down: wgpu::ComputePipeline,
    enlarging: wgpu::BindGroupLayout,
    enlarge: wgpu::ComputePipeline,
    sampler: wgpu::Sampler,
}

impl Enlarge {
    pub(super) fn new(context: &Context) -> Self {
        let stage = wgpu::ShaderStages::COMPUTE;
        let written = Binding::StorageTexture(PICTURE, wgpu::TextureViewDimension::D2);
        let filtering = layout(context, "prefilter", stage, &[Binding::ReadTexture(PICTURE), written]);
        let filter = module(context, shaders::PREFILTER);
        let prefilter = |down| compute(context, &filter, "prefilter", "prefilter", &filtering, &[("DOWN", flag(down))]);
        let slots = [Binding::Uniform, Binding::FilteredTexture, Binding::Sampler, Binding::Write];
        let enlarging = layout(context, "enlarge", stage, &slots);
        let enlarge = module(context, shaders::ENLARGE);
        let sampler = context.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("enlarge.filtered"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..wgpu::SamplerDescriptor::default()
        });
        Self {
            across: prefilter(false),
            down: prefilter(true),
            enlarge: compute(context, &enlarge, "enlarge", "enlarge", &enlarging, &[]),
            filtering,
            enlarging,
            sampler,
        }
    }

    /// Resamples an intermediate image to the pixels of a region, given the size of the region.
    pub(super) fn run(
        &self,
        recorder: &mut Recorder<'_>,
        image: &IntermediateImage,
        pixels: &wgpu::Buffer,
        [across, down]: [u32; 2],
    ) {
        let context = recorder.context;
        let [a, b] = &image.pictures;
        let [width, height] = image.size;
        let workgroups = [width.div_ceil(64), height, 1];
        for (pipeline, from, to) in [(&self.across, a, b), (&self.down, b, a)] {
            let group = bind(context, "prefilter", &self.filtering, &[texture_view(from), texture_view(to)]);
            recorder.dispatch("prefilter", pipeline, &group, &[], workgroups);
        }
        let sampler = wgpu::BindingResource::Sampler(&self.sampler);
        let resources = [image.frame.as_entire_binding(), texture_view(a), sampler, pixels.as_entire_binding()];
        let group = bind(context, "enlarge", &self.enlarging, &resources);
        recorder.dispatch("enlarge", &self.enlarge, &group, &[], [across.div_ceil(64), down, 1]);
    }
}

/// What rays wrote that are not spaced by pixels.
pub(super) struct IntermediateImage {
    /// The uniforms of the rays.
    pub(super) frame: wgpu::Buffer,
    pub(super) size: [u32; 2],
    /// The image, and room for filtering it.
    pub(super) pictures: [wgpu::TextureView; 2],
}
