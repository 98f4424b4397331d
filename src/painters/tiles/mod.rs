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
use march::{Refiner, Targets, march};
use pack::{Layout, Packed, Packer, SamplesKey, Voxel};
use paint::Picture;
use rays::Rays;
use resample::{IntermediateImage, Resampler};

use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::pipeline::{both, texture_view};
use crate::gpu::recorder::Recorder;
use crate::gpu::stage::{Constant, Stage};
use crate::image::Region;
use crate::painters::painter::Job;
use crate::stats::TilesStats;

/// The largest radius of kernels, in voxels, along rays that share footprints: they reach at most two planes and three
/// texels of a row.
const MAX_RADIUS: f64 = 2.0;
/// The largest radius of kernels along other rays, whose shaders read more planes and texels.
const MAX_SINGLE_RADIUS: f64 = 4.0;

/// How far rays may move across the volume, in voxels, and still count as straight: 1e-4 of a voxel changes a footprint
/// by about 1e-4 of its peak.
const STRAIGHT: f64 = 1e-4;

/// The rays that are marched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum RayKind {
    /// A ray for each pixel.
    Pixels,
    /// A ray for each pixel, along the principal axis.
    Straight,
    /// The same, eight at a time.
    StraightBlocks(Block),
    /// A ray for each pixel, through one of several layers.
    Layered,
    /// Rays through an intermediate image that is coarser than the picture, each on its own.
    Coarser,
    /// Rays through an intermediate image that is aligned with the lattice, eight at a time.
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

/// The specialisation of the pipelines.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct TilesKey {
    voxel: Voxel,
    layout: Layout,
    rays: RayKind,
    packs_on_host: bool,
    /// The samples that are packed in place of lists of splats.
    samples: Option<SamplesKey>,
    /// Override constants of all shaders.
    constants: Vec<Constant>,
}

/// The pipelines of the painter.
pub(crate) struct Tiles {
    /// None: the host packs.
    packer: Option<Packer>,
    skip: Stage,
    gather: Stage,
    /// If rays do not go through pixels: the stages that resample their image, and that add the rays of some pixels.
    resample: Option<(Resampler, Refiner)>,
}

impl Tiles {
    pub(crate) fn new(context: &Context, key: &TilesKey) -> Result<Self> {
        let rest = || {
            let packer = || Packer::new(context, &key.constants, (key.voxel, key.layout), key.samples);
            let packer = (!key.packs_on_host).then(packer);
            let resample = key.rays.is_resampled().then(|| (Resampler::new(context), Refiner::new(context, key)));
            (packer, march::skip(context, &key.constants), resample)
        };
        let (gather, (packer, skip, resample)) = both(context, || march::gather(context, key), rest)?;
        Ok(Self { packer, skip, gather, resample })
    }

    /// Records the rays of a picture in a region. Returns their number, spacing and marches.
    fn draw(
        &self,
        recorder: &mut Recorder<'_>,
        picture: &Picture<'_>,
        packed: &[Arc<Packed>],
        canvas: &mut Canvas,
    ) -> Result<TilesStats> {
        let context = recorder.context;
        let Canvas { region, part, .. } = *canvas;
        let Job { view, .. } = picture.job;
        let uniform = wgpu::BufferUsages::UNIFORM;
        let lighting = context.upload("gather.lighting", bytemuck::bytes_of(&picture.lighting), uniform)?;
        let mut drawn = TilesStats::default();
        let mut largest = 0.0;
        for ((axis, packed), sections) in picture.axes.iter().zip(packed).zip(&picture.sections) {
            let upload = |rays: &Rays| context.upload("rays", bytemuck::bytes_of(&rays.uniforms), uniform);
            let scaled = |mut rays: Rays| {
                rays.uniforms.density_scale /= packed.scale as f32;
                rays.around(region, part)
            };
            let setup = picture.setup(axis);
            let mut pixel_rays = scaled(setup.pixel_rays(region));
            let marched = match &self.resample {
                Some(_) => setup.image_rays(region).into_iter().map(scaled).collect(),
                None if axis.axis.is_in(region, view.camera.size) => vec![pixel_rays],
                None => Vec::new(),
            };
            if marched.is_empty() {
                continue;
            }
            let shares = if self.resample.is_some() { region.area() } else { 1 };
            let refinement = context.buffer("refine.shares", shares * 4, wgpu::BufferUsages::STORAGE)?;
            for rays in marched {
                let size = if self.resample.is_some() { rays.uniforms.size } else { [1; 2] };
                let image = IntermediateImage::new(context, upload(&rays)?, size);
                let before = if picture.is_layered() { Some(canvas.before(context, &axis.axis)?) } else { None };
                let state = before.as_ref().map_or(texture_view(&image.textures[0]), wgpu::Buffer::as_entire_binding);
                let post = picture.job.post;
                let Canvas { pixels, solids, .. } = &*canvas;
                let is_layered = before.is_some();
                let (rays_on_device, lighting) = (&image.rays, &lighting);
                let targets =
                    Targets { rays: rays_on_device, sections, state, is_layered, pixels, lighting, post, solids };
                march(recorder, [&self.skip, &self.gather], packed, &rays.uniforms, targets)?;
                if let Some((resampler, _)) = &self.resample {
                    resampler.run(recorder, &image, &canvas.pixels, &refinement, [region.width, region.height]);
                }
                drawn.rays += rays.count();
                drawn.marches += 1;
                if rays.uniforms.share > largest {
                    (largest, drawn.spacing) = (rays.uniforms.share, Some(rays.spacing));
                }
            }
            if let Some((_, refiner)) = &self.resample {
                // Their shares are in `refinement`.
                pixel_rays.uniforms.share = 1.0;
                let buffer = upload(&pixel_rays)?;
                let rays = [&buffer, &**sections];
                refiner.run(recorder, packed, &pixel_rays.uniforms, rays, &canvas.pixels, &refinement)?;
            }
        }
        Ok(drawn)
    }
}

/// The pixels of a region while rays add to them.
struct Canvas {
    region: Region,
    /// The part of the region whose pixels must be right.
    part: Region,
    /// Premultiplied RGBA, f32.
    pixels: wgpu::Buffer,
    /// The depths of the solids in the pixels, the same for all layers.
    solids: wgpu::Buffer,
    /// The state of rays behind the layers so far, by their principal axis.
    before: Vec<([usize; 3], bool, wgpu::Buffer)>,
}

impl Canvas {
    /// A region without colour.
    fn new(job: &Job<'_>, region: Region, part: Region) -> Result<Self> {
        let pixels = job.context.pixels("tiles.pixels", [region.width, region.height])?;
        Ok(Self { region, part, pixels, solids: job.solid_depths(region)?, before: Vec::new() })
    }

    /// The state of the rays along an axis: nothing before the first layer.
    fn before(&mut self, context: &Context, axis: &PrincipalAxis) -> Result<wgpu::Buffer> {
        let is_same = |(axes, flipped, _): &&([usize; 3], bool, _)| *axes == axis.axes && *flipped == axis.flipped;
        if let Some((_, _, buffer)) = self.before.iter().find(is_same) {
            return Ok(buffer.clone());
        }
        let buffer = context.pixels("layer.before", [self.region.width, self.region.height])?;
        self.before.push((axis.axes, axis.flipped, buffer.clone()));
        Ok(buffer)
    }
}
