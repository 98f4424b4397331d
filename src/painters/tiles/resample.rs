//! estimate, prefilter and resample: from an intermediate image to the picture, by interpolating cubic B-splines. See
//! shaders/estimate.wgsl, shaders/prefilter.wgsl and shaders/resample.wgsl.

use crate::gpu::context::Context;
use crate::gpu::pipeline::Binding::{self, ReadTexture, StorageTexture, Uniform, Write};
use crate::gpu::pipeline::texture_view;
use crate::gpu::recorder::Recorder;
use crate::gpu::shaders;
use crate::gpu::stage::{Constant, Stage};

/// The format of intermediate images.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// Invocations of a workgroup, along x, of each of these stages.
const WORKGROUP: u32 = 64;

/// The format of the estimated errors of splines.
pub(super) const ESTIMATES: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// The image through whose points rays go if they do not go through pixels.
pub(super) struct IntermediateImage {
    /// The uniforms of the rays.
    pub(super) rays: wgpu::Buffer,
    /// Points across and down.
    pub(super) size: [u32; 2],
    /// The image, and a second texture for filtering it.
    pub(super) textures: [wgpu::TextureView; 2],
    /// The estimated errors of the splines through the image around each of its points.
    pub(super) estimates: wgpu::TextureView,
}

impl IntermediateImage {
    /// An image without colour.
    pub(super) fn new(context: &Context, rays: wgpu::Buffer, size: [u32; 2]) -> Self {
        let [width, height] = size;
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING;
        let texture = |label, format| {
            let texture = context.texture(label, format, [width, height, 1], wgpu::TextureDimension::D2, usage);
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let textures = [0, 1].map(|_| texture("gather.intermediate", FORMAT));
        Self { rays, size, textures, estimates: texture("estimate.estimates", ESTIMATES) }
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
        let written = |format| StorageTexture(format, wgpu::TextureViewDimension::D2);
        let stage = |shader: shaders::Shader, slots: &[Binding], constants: &[Constant]| {
            Stage::new(context, shader, (shader.name, shader.name), slots, constants)
        };
        let estimate = [Uniform, ReadTexture(FORMAT), written(ESTIMATES)];
        let prefilter = [ReadTexture(FORMAT), written(FORMAT)];
        let resample = [Uniform, ReadTexture(FORMAT), Write, ReadTexture(ESTIMATES), Write];
        Self {
            estimate: stage(shaders::ESTIMATE, &estimate, &[]),
            prefilter: [0, 1].map(|down| stage(shaders::PREFILTER, &prefilter, &[("DOWN", down)])),
            resample: stage(shaders::RESAMPLE, &resample, &[]),
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
