//! prefilter and enlarge: the raster to the picture. See shaders/prefilter.wgsl and shaders/resample.wgsl.

use super::super::context::Context;
use super::super::pipeline::{Slot, bind, compute, dispatch, flag, layout, module, whole};
use super::super::shaders;
use super::super::timing::Timing;

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
        let written = Slot::StorageTexture(PICTURE, wgpu::TextureViewDimension::D2);
        let filtering = layout(context, "prefilter", stage, &[Slot::ReadTexture(PICTURE), written]);
        let filter = module(context, shaders::PREFILTER);
        let prefilter = |down| compute(context, &filter, "prefilter", "prefilter", &filtering, &[("DOWN", flag(down))]);
        let slots = [Slot::Uniform, Slot::FilteredTexture, Slot::Sampler, Slot::Write];
        let enlarging = layout(context, "enlarge", stage, &slots);
        let enlarge = module(context, shaders::RESAMPLE);
        let sampler = context.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("enlarge.filtered"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..wgpu::SamplerDescriptor::default()
        });
        Self {
            across: prefilter(false),
            down: prefilter(true),
            enlarge: compute(context, &enlarge, "resample", "resample", &enlarging, &[]),
            filtering,
            enlarging,
            sampler,
        }
    }

    /// What is in the first of two textures of a size, by way of the second, to the pixels of a region of another.
    pub(super) fn run(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        timing: &mut Timing,
        frame: &wgpu::Buffer,
        (pictures, [width, height]): (&[wgpu::TextureView; 2], [u32; 2]),
        (pixels, [across, down]): (&wgpu::Buffer, [u32; 2]),
    ) {
        let [a, b] = pictures;
        let workgroups = [width.div_ceil(64), height, 1];
        for (pipeline, from, to) in [(&self.across, a, b), (&self.down, b, a)] {
            let group = bind(context, "prefilter", &self.filtering, &[whole(from), whole(to)]);
            dispatch(context, encoder, timing, "enlarge", pipeline, &group, &[], workgroups);
        }
        let sampler = wgpu::BindingResource::Sampler(&self.sampler);
        let resources = [frame.as_entire_binding(), whole(a), sampler, pixels.as_entire_binding()];
        let group = bind(context, "enlarge", &self.enlarging, &resources);
        let workgroups = [across.div_ceil(64), down, 1];
        dispatch(context, encoder, timing, "enlarge", &self.enlarge, &group, &[], workgroups);
    }
}
