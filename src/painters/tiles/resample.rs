//! estimate, prefilter and resample: from an intermediate image to the picture, by interpolating cubic B-splines. See
//! shaders/estimate.wgsl, shaders/prefilter.wgsl and shaders/resample.wgsl.

use super::texture;
use crate::gpu::context::Context;
use crate::gpu::pipeline::{Binding, texture_view};
use crate::gpu::recorder::Recorder;
use crate::gpu::shaders;
use crate::painters::stage::{Constants, Stage};

/// The format of intermediate images.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// Invocations of a workgroup, along x, of each of these stages.
const WORKGROUP: u32 = 64;

/// The format of the estimated errors of splines.
pub(super) const ESTIMATES: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// The image whose points rays go through if they do not go through pixels.
pub(super) struct IntermediateImage {
    /// The uniforms of the rays.
    pub(super) rays: wgpu::Buffer,
    /// Points across and down.
    pub(super) size: [u32; 2],
    /// The image, and room for filtering it.
    pub(super) textures: [wgpu::TextureView; 2],
    /// The estimated errors of the splines through the image around each of its points.
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
    estimate: Stage,
    /// Along rows, then along columns.
    prefilter: [Stage; 2],
    resample: Stage,
}

impl Resampler {
    pub(super) fn new(context: &Context) -> Self {
        let written = |format| Binding::StorageTexture(format, wgpu::TextureViewDimension::D2);
        let stage = |shader: shaders::Shader, slots: &[Binding], constants: &Constants| {
            Stage::new(context, shader, (shader.name, shader.name), slots, constants)
        };
        let estimate = [Binding::Uniform, Binding::ReadTexture(FORMAT), written(ESTIMATES)];
        let prefilter = [Binding::ReadTexture(FORMAT), written(FORMAT)];
        let resample = [
            Binding::Uniform,
            Binding::ReadTexture(FORMAT),
            Binding::Write,
            Binding::ReadTexture(ESTIMATES),
            Binding::Write,
        ];
        Self {
            estimate: stage(shaders::ESTIMATE, &estimate, &Vec::new()),
            prefilter: [0, 1].map(|down| stage(shaders::PREFILTER, &prefilter, &vec![("DOWN", down)])),
            resample: stage(shaders::RESAMPLE, &resample, &Vec::new()),
        }
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
        let rays = image.rays.as_entire_binding();
        // Of the image before it is filtered.
        let resources = [rays, texture_view(&image.textures[0]), texture_view(&image.estimates)];
        self.estimate.run(recorder, &resources, rows(image.size));
        self.prefilter(recorder, image);
        self.resample(recorder, image, pixels, refinement, region);
    }

    /// Replaces the image by the coefficients of the splines through it.
    pub(super) fn prefilter(&self, recorder: &mut Recorder<'_>, image: &IntermediateImage) {
        let [a, b] = &image.textures;
        for (stage, from, to) in [(&self.prefilter[0], a, b), (&self.prefilter[1], b, a)] {
            stage.run(recorder, &[texture_view(from), texture_view(to)], rows(image.size));
        }
    }

    /// Adds the splines to the pixels of a region, given the size of the region.
    pub(super) fn resample(
        &self,
        recorder: &mut Recorder<'_>,
        image: &IntermediateImage,
        pixels: &wgpu::Buffer,
        refinement: &wgpu::Buffer,
        region: [u32; 2],
    ) {
        let resources = [
            image.rays.as_entire_binding(),
            texture_view(&image.textures[0]),
            pixels.as_entire_binding(),
            texture_view(&image.estimates),
            refinement.as_entire_binding(),
        ];
        self.resample.run(recorder, &resources, rows(region));
    }
}

/// The workgroups of these stages for an image.
fn rows([width, height]: [u32; 2]) -> [u32; 3] {
    [width.div_ceil(WORKGROUP), height, 1]
}
