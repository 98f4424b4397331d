//! The painter `tiles`: compute shaders that march rays from voxel plane to voxel plane. Rays go through the points of
//! an intermediate image that is aligned with the lattice, so that they can share the footprints of kernels; the image
//! is resampled to the picture. Rays skip empty macrocells and end when they are opaque.

mod axis;
mod march;
mod pack;
mod paint;
mod parts;
mod rays;
mod resample;
#[cfg(test)]
mod stages_test;

pub(crate) use paint::ROOM;

use std::sync::Arc;

use march::{Stage, Targets, march};
use pack::{Packed, Packer, Voxel};
use paint::Picture;
use rays::Spacing;
use resample::{FORMAT, IntermediateImage, Resampler};

use super::context::Context;
use super::pipeline::both;
use super::recorder::Recorder;
use super::view::Region;
use crate::error::Result;
use crate::settings::Model;

/// The largest radius of kernels, in voxels, that reach at most two planes and three texels of a row.
const MAX_RADIUS: f64 = 2.0;
/// The largest radius of kernels of classified voxels along parallel rays: their shader reads more planes and texels.
const MAX_PARALLEL_RADIUS: f64 = 3.0;

/// How far rays may move across the volume, in voxels, and still count as straight: 1e-4 of a voxel changes a footprint
/// by about 1e-4 of its peak.
const STRAIGHT: f64 = 1e-4;

/// Which rays are marched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
enum RayKind {
    /// Those of the pixels.
    #[default]
    Pixels,
    /// Those of the pixels, which run along the principal axis.
    Straight,
    /// Through an intermediate image that is coarser than the picture, each on its own.
    Coarser,
    /// Through an intermediate image that is aligned with the lattice, eight at a time.
    Shared,
}

/// What the pipelines are specialised for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(crate) struct TilesKey {
    model: Model,
    voxel: Voxel,
    lights: u32,
    perspective: bool,
    /// Parts of kernels of colours are parabolas.
    curved: bool,
    rays: RayKind,
    /// Terms of the footprint's polynomial.
    terms: u32,
    /// Texels of a row of voxels that kernels reach.
    texels: u32,
    /// See [`TransferTable`](super::transfer::TransferTable).
    crowded: bool,
}

/// The pipelines of the painter.
pub(crate) struct Tiles {
    packer: Packer,
    skip: Stage,
    gather: Stage,
    /// If rays do not go through pixels.
    resample: Option<Resampler>,
}

impl Tiles {
    pub(crate) fn new(context: &Context, key: TilesKey) -> Result<Self> {
        let rest = || {
            let packer = Packer::new(context, key.voxel, key.perspective);
            (
                packer,
                Stage::skip(context, key),
                matches!(key.rays, RayKind::Coarser | RayKind::Shared).then(|| Resampler::new(context)),
            )
        };
        let (gather, (packer, skip, resample)) = both(context, || Stage::gather(context, key), rest)?;
        Ok(Self { packer, skip, gather, resample })
    }

    /// Records the rays of a picture in a region.
    fn draw(
        &self,
        recorder: &mut Recorder<'_>,
        picture: &Picture<'_>,
        packed: &[Arc<Packed>],
        region: Region,
    ) -> Result<Marched> {
        let context = recorder.context;
        let pixels = context.pixels("tiles.pixels", [region.width, region.height])?;
        let uniform = wgpu::BufferUsages::UNIFORM;
        let lighting = context.upload("gather.lighting", bytemuck::bytes_of(&picture.lighting), uniform)?;
        let (mut count, mut spacing) = (0, None);
        let mut image: Option<IntermediateImage> = None;
        for (axis, packed) in picture.axes.iter().zip(packed) {
            let Some(mut rays) = picture.rays(axis, region) else { continue };
            rays.uniforms.density_scale /= packed.scale as f32;
            let [width, height] = rays.uniforms.size;
            // Several axes share one set of rays, and each ray is marched along one of them.
            (count, spacing) = (u64::from(width) * u64::from(height), Some(rays.spacing));
            let buffer = context.upload("rays", bytemuck::bytes_of(&rays.uniforms), uniform)?;
            // All axes share one intermediate image.
            let image = image.get_or_insert_with(|| {
                let size = if self.resample.is_some() { [width, height] } else { [1, 1] };
                let textures = [0, 1].map(|_| texture(context, "gather.intermediate", FORMAT, size));
                IntermediateImage { rays: buffer.clone(), size, textures }
            });
            let targets = Targets {
                rays: &buffer,
                intermediate: &image.textures[0],
                pixels: &pixels,
                lighting: &lighting,
                transfer: picture.job.transfer,
            };
            march(recorder, &self.skip, &self.gather, packed, &rays.uniforms, &targets);
        }
        if let (Some(stage), Some(image)) = (&self.resample, &image) {
            stage.run(recorder, image, &pixels, [region.width, region.height]);
        }
        Ok(Marched { pixels, rays: count, spacing })
    }
}

/// A region whose rays have been marched.
struct Marched {
    /// Premultiplied RGBA, f32.
    pixels: wgpu::Buffer,
    rays: u64,
    spacing: Option<Spacing>,
}

fn texture(
    context: &Context,
    label: &str,
    format: wgpu::TextureFormat,
    [width, height]: [u32; 2],
) -> wgpu::TextureView {
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING;
    let texture = context.texture(label, format, [width, height, 1], wgpu::TextureDimension::D2, usage);
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
