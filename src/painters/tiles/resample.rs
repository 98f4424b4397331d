//! estimate, prefilter and resample: from an intermediate image to the picture, by interpolating cubic B-splines. See
//! shaders/estimate.wgsl, shaders/prefilter.wgsl and shaders/resample.wgsl.

use super::texture;
use crate::gpu::context::Context;
use crate::gpu::pipeline::{Binding, bind, compute, flag, layout, module, texture_view};
use crate::gpu::recorder::Recorder;
use crate::gpu::shaders;

/// The format of intermediate images.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// Invocations of a workgroup, along x, of each of these stages.
const WORKGROUP: u32 = 64;

/// The format of what splines may err by.
pub(super) const ESTIMATES: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// The image whose points rays go through if they do not go through pixels.
pub(super) struct IntermediateImage {
    /// The uniforms of the rays.
    pub(super) rays: wgpu::Buffer,
    /// Points across and down.
    pub(super) size: [u32; 2],
    /// The image, and room for filtering it.
    pub(super) textures: [wgpu::TextureView; 2],
    /// What the splines through the image may err by, around each of its points.
    pub(super) estimates: wgpu::TextureView,
}

impl IntermediateImage {
    /// An image of no colour.
    pub(super) fn new(context: &Context, rays: wgpu::Buffer, size: [u32; 2]) -> Self {
        let textures = [0, 1].map(|_| texture(context, "gather.intermediate", FORMAT, size));
        Self { rays, size, textures, estimates: texture(context, "estimate.estimates", ESTIMATES, size) }
    }
}

/// The pipelines.
pub(super) struct Resampler {
    prefilter: wgpu::BindGroupLayout,
    across: wgpu::ComputePipeline,
    down: wgpu::ComputePipeline,
    estimate: (wgpu::BindGroupLayout, wgpu::ComputePipeline),
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
        let estimates = Binding::StorageTexture(ESTIMATES, wgpu::TextureViewDimension::D2);
        let estimating =
            layout(context, "estimate", stage, &[Binding::Uniform, Binding::ReadTexture(FORMAT), estimates]);
        let shader = module(context, shaders::ESTIMATE);
        let estimate = compute(context, &shader, "estimate", "estimate", &estimating, &[]);
        let bindings = [
            Binding::Uniform,
            Binding::ReadTexture(FORMAT),
            Binding::Write,
            Binding::ReadTexture(ESTIMATES),
            Binding::Write,
        ];
        let resample = layout(context, "resample", stage, &bindings);
        let shader = module(context, shaders::RESAMPLE);
        let pixels = compute(context, &shader, "resample", "resample", &resample, &[]);
        Self { prefilter, across, down, estimate: (estimating, estimate), resample, pixels }
    }

    /// Adds an intermediate image to the pixels of a region, given the size of the region.
    pub(super) fn run(
        &self,
        recorder: &mut Recorder<'_>,
        image: &IntermediateImage,
        pixels: &wgpu::Buffer,
        refinement: &wgpu::Buffer,
        region: [u32; 2],
    ) {
        self.estimate(recorder, image);
        self.prefilter(recorder, image);
        self.resample(recorder, image, pixels, refinement, region);
    }

    /// What the splines may err by. The image is still that of the rays.
    fn estimate(&self, recorder: &mut Recorder<'_>, image: &IntermediateImage) {
        let (layout, pipeline) = &self.estimate;
        let rays = image.rays.as_entire_binding();
        let resources = [rays, texture_view(&image.textures[0]), texture_view(&image.estimates)];
        let group = bind(recorder.context, "estimate", layout, &resources);
        let [width, height] = image.size;
        recorder.dispatch("estimate", pipeline, &group, &[], [width.div_ceil(WORKGROUP), height, 1]);
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
        refinement: &wgpu::Buffer,
        [across, down]: [u32; 2],
    ) {
        let rays = image.rays.as_entire_binding();
        let resources = [
            rays,
            texture_view(&image.textures[0]),
            pixels.as_entire_binding(),
            texture_view(&image.estimates),
            refinement.as_entire_binding(),
        ];
        let group = bind(recorder.context, "resample", &self.resample, &resources);
        recorder.dispatch("resample", &self.pixels, &group, &[], [across.div_ceil(WORKGROUP), down, 1]);
    }
}
