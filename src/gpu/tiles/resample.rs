//! prefilter and resample: from the intermediate image to the picture, by interpolating cubic B-splines. See
//! shaders/prefilter.wgsl and shaders/resample.wgsl.

use super::super::context::Context;
use super::super::pipeline::{Binding, bind, compute, flag, layout, module, texture_view};
use super::super::recorder::Recorder;
use super::super::shaders;

/// The format of intermediate images.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// Invocations of a workgroup, along x; shaders/prefilter.wgsl and shaders/resample.wgsl.
const WORKGROUP: u32 = 64;

/// The image whose points rays go through if they do not go through pixels.
pub(super) struct IntermediateImage {
    /// The uniforms of the rays.
    pub(super) rays: wgpu::Buffer,
    /// Points across and down.
    pub(super) size: [u32; 2],
    /// The image, and room for filtering it.
    pub(super) textures: [wgpu::TextureView; 2],
}

/// The pipelines.
pub(super) struct Resampler {
    prefilter: wgpu::BindGroupLayout,
    across: wgpu::ComputePipeline,
    down: wgpu::ComputePipeline,
    resample: wgpu::BindGroupLayout,
    pixels: wgpu::ComputePipeline,
}

impl Resampler {
    pub(super) fn new(context: &Context) -> Self {
        let stage = wgpu::ShaderStages::COMPUTE;
        let written = Binding::StorageTexture(FORMAT, wgpu::TextureViewDimension::D2);
        let prefilter = layout(context, "prefilter", stage, &[Binding::ReadTexture(FORMAT), written]);
        let filter = module(context, shaders::PREFILTER);
        let filtering = |down| compute(context, &filter, "prefilter", "prefilter", &prefilter, &[("DOWN", flag(down))]);
        let (across, down) = (filtering(false), filtering(true));
        let bindings = [Binding::Uniform, Binding::ReadTexture(FORMAT), Binding::Write];
        let resample = layout(context, "resample", stage, &bindings);
        let shader = module(context, shaders::RESAMPLE);
        let pixels = compute(context, &shader, "resample", "resample", &resample, &[]);
        Self { prefilter, across, down, resample, pixels }
    }

    /// Resamples an intermediate image to the pixels of a region, given the size of the region.
    pub(super) fn run(
        &self,
        recorder: &mut Recorder<'_>,
        image: &IntermediateImage,
        pixels: &wgpu::Buffer,
        region: [u32; 2],
    ) {
        self.prefilter(recorder, image);
        self.resample(recorder, image, pixels, region);
    }

    /// The coefficients of the splines through the image, in its place.
    pub(super) fn prefilter(&self, recorder: &mut Recorder<'_>, image: &IntermediateImage) {
        let [a, b] = &image.textures;
        let [width, height] = image.size;
        for (pipeline, from, to) in [(&self.across, a, b), (&self.down, b, a)] {
            let resources = [texture_view(from), texture_view(to)];
            let group = bind(recorder.context, "prefilter", &self.prefilter, &resources);
            recorder.dispatch("prefilter", pipeline, &group, &[], [width.div_ceil(WORKGROUP), height, 1]);
        }
    }

    /// The splines at the pixels of a region.
    pub(super) fn resample(
        &self,
        recorder: &mut Recorder<'_>,
        image: &IntermediateImage,
        pixels: &wgpu::Buffer,
        [across, down]: [u32; 2],
    ) {
        let rays = image.rays.as_entire_binding();
        let resources = [rays, texture_view(&image.textures[0]), pixels.as_entire_binding()];
        let group = bind(recorder.context, "resample", &self.resample, &resources);
        recorder.dispatch("resample", &self.pixels, &group, &[], [across.div_ceil(WORKGROUP), down, 1]);
    }
}
