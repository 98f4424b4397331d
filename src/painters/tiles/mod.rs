//! The painter `tiles`: compute shaders that march rays from voxel plane to voxel plane. Rays go through the points of
//! an intermediate image that is aligned with the lattice, so that they can share the footprints of kernels; the image
//! is resampled to the picture. Rays skip empty macrocells and end when they are opaque.

mod axis;
mod layers;
mod march;
mod pack;
mod paint;
mod parts;
mod rays;
mod resample;
#[cfg(test)]
mod stages_test;

pub(crate) use layers::ROOM;

use std::sync::Arc;

use axis::PrincipalAxis;
use march::{RayTarget, Refiner, Stage, Targets, march};
use pack::{Packed, Packer, Voxel};
use paint::Picture;
use rays::{Rays, Spacing};
use resample::{FORMAT, IntermediateImage, Resampler};

use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::pipeline::both;
use crate::gpu::recorder::Recorder;
use crate::image::Region;
use crate::settings::Model;

/// The largest radius of kernels, in voxels, along rays that share footprints: they reach at most two planes and three
/// texels of a row.
const MAX_RADIUS: f64 = 2.0;
/// The largest radius of kernels along other rays: their shaders read more planes and texels.
const MAX_SINGLE_RADIUS: f64 = 4.0;

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
    /// The same, eight at a time.
    StraightBlocks(Block),
    /// Those of the pixels, through one of several layers.
    Layered,
    /// Through an intermediate image that is coarser than the picture, each on its own.
    Coarser,
    /// Through an intermediate image that is aligned with the lattice, eight at a time.
    Shared,
}

/// Eight pixels whose rays along the principal axis share the voxels that they meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Block {
    /// Pixels across: 2 or 4.
    across: u32,
    /// Rows of voxels that reach a ray of the block: 5 to 7.
    rows: u32,
}

impl RayKind {
    /// Whether rays go through an intermediate image.
    fn is_resampled(self) -> bool {
        matches!(self, Self::Coarser | Self::Shared)
    }
}

/// What the pipelines are specialised for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(crate) struct TilesKey {
    model: Model,
    /// RESPONSE in shaders/common/response.wgsl.
    response: u32,
    /// Colours are those of depth.
    depth_coded: bool,
    /// A maximum is attenuated by its depth.
    attenuated: bool,
    voxel: Voxel,
    lights: u32,
    /// Some light is at a place.
    point_lights: bool,
    perspective: bool,
    /// Kernels grow with their depth before the eye.
    grown: bool,
    /// Parts of kernels of colours are parabolas.
    curved: bool,
    rays: RayKind,
    /// Planes that cut rays.
    clip_planes: u32,
    /// Terms of the footprint's polynomial.
    terms: u32,
    /// Planes before and behind their own that kernels reach along single rays.
    reach: u32,
    /// Texels of a row of voxels that kernels reach.
    texels: u32,
    packs_on_host: bool,
    /// See [`TransferTable`](crate::gpu::transfer::TransferTable).
    crowded: bool,
    thins: bool,
    /// Light is kept from scalars.
    post_shadows: bool,
}

/// The pipelines of the painter.
pub(crate) struct Tiles {
    packer: Packer,
    skip: Stage,
    gather: Stage,
    /// If rays do not go through pixels: what makes pixels of the image, and what adds the rays of some pixels.
    resample: Option<(Resampler, Refiner)>,
}

impl Tiles {
    pub(crate) fn new(context: &Context, key: TilesKey) -> Result<Self> {
        let rest = || {
            let packer = Packer::new(context, key.voxel, key.perspective, key.point_lights, key.packs_on_host);
            (
                packer,
                Stage::skip(context, key),
                key.rays.is_resampled().then(|| (Resampler::new(context), Refiner::new(context, key))),
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
        canvas: &mut Canvas,
    ) -> Result<Marched> {
        let context = recorder.context;
        let Canvas { region, part, .. } = *canvas;
        let uniform = wgpu::BufferUsages::UNIFORM;
        let lighting = context.upload("gather.lighting", bytemuck::bytes_of(&picture.lighting), uniform)?;
        let mut marched = Marched::default();
        let mut largest = 0.0;
        for (way, packed) in picture.ways.iter().zip(packed) {
            let upload = |rays: &Rays| context.upload("rays", bytemuck::bytes_of(&rays.uniforms), uniform);
            let scaled = |mut rays: Rays| {
                rays.uniforms.density_scale /= packed.scale as f32;
                rays
            };
            let count = |marched: &mut Marched, rays: &Rays| {
                let [width, height] = rays.uniforms.size;
                marched.rays += u64::from(width) * u64::from(height);
                marched.marches += 1;
            };
            let mut pixel_rays = scaled(picture.pixel_rays(way, region).around(region, part));
            let Some((resampler, refiner)) = &self.resample else {
                let buffer = upload(&pixel_rays)?;
                let state = if picture.is_layered() {
                    RayTarget::Before(canvas.before(context, &way.axis)?)
                } else {
                    RayTarget::Image(texture(context, "gather.intermediate", FORMAT, [1, 1]))
                };
                let targets = Targets {
                    rays: &buffer,
                    state: &state,
                    pixels: &canvas.pixels,
                    lighting: &lighting,
                    post: picture.job.post,
                };
                march(recorder, &self.skip, &self.gather, packed, &pixel_rays.uniforms, &targets)?;
                count(&mut marched, &pixel_rays);
                marched.spacing = Some(pixel_rays.spacing);
                continue;
            };
            let images = picture.image_rays(way, region);
            if images.is_empty() {
                continue;
            }
            let share_bytes = u64::from(region.width) * u64::from(region.height) * 4;
            let refinement = context.buffer("refine.shares", share_bytes, wgpu::BufferUsages::STORAGE)?;
            for rays in images.into_iter().map(|rays| scaled(rays.around(region, part))) {
                let image = IntermediateImage::new(context, upload(&rays)?, rays.uniforms.size);
                let targets = Targets {
                    rays: &image.rays,
                    state: &RayTarget::Image(image.textures[0].clone()),
                    pixels: &canvas.pixels,
                    lighting: &lighting,
                    post: None,
                };
                march(recorder, &self.skip, &self.gather, packed, &rays.uniforms, &targets)?;
                resampler.run(recorder, &image, &canvas.pixels, &refinement, [region.width, region.height]);
                count(&mut marched, &rays);
                if rays.uniforms.share > largest {
                    (largest, marched.spacing) = (rays.uniforms.share, Some(rays.spacing));
                }
            }
            // Their shares are those of `refinement`.
            pixel_rays.uniforms.share = 1.0;
            let buffer = upload(&pixel_rays)?;
            refiner.run(recorder, packed, &pixel_rays.uniforms, &buffer, &canvas.pixels, &refinement)?;
        }
        Ok(marched)
    }
}

/// What the rays of a region write to.
struct Canvas {
    region: Region,
    /// The part of it that is wanted.
    part: Region,
    /// Premultiplied RGBA, f32.
    pixels: wgpu::Buffer,
    /// What rays have gathered in the layers before, by their principal axis.
    before: Vec<([usize; 3], bool, wgpu::Buffer)>,
}

impl Canvas {
    /// A region without colour.
    fn new(context: &Context, region: Region, part: Region) -> Result<Self> {
        let pixels = context.pixels("tiles.pixels", [region.width, region.height])?;
        Ok(Self { region, part, pixels, before: Vec::new() })
    }

    /// What the rays along an axis have gathered: nothing before the first layer.
    fn before(&mut self, context: &Context, axis: &PrincipalAxis) -> Result<wgpu::Buffer> {
        let of_axis = |(axes, flipped, _): &&([usize; 3], bool, _)| *axes == axis.axes && *flipped == axis.flipped;
        if let Some((_, _, buffer)) = self.before.iter().find(of_axis) {
            return Ok(buffer.clone());
        }
        let buffer = context.pixels("layer.before", [self.region.width, self.region.height])?;
        self.before.push((axis.axes, axis.flipped, buffer.clone()));
        Ok(buffer)
    }
}

/// The rays that have been marched for a region.
#[derive(Default)]
struct Marched {
    rays: u64,
    /// Of the march with the largest share.
    spacing: Option<Spacing>,
    /// Marches that were mixed, those of single pixels aside.
    marches: u32,
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
