//! The painter `tiles`: compute shaders that march a ray for each pixel from voxel plane to voxel plane. Rays skip
//! empty macrocells and end when they are opaque.

mod axis;
mod layers;
mod march;
mod pack;
mod paint;
mod parts;
mod rays;
#[cfg(test)]
mod stages_test;

pub(crate) use layers::ROOM;

use std::sync::Arc;

use axis::PrincipalAxis;
use march::{Targets, march};
use pack::{Layout, Packed, Packer, SamplesKey, Voxel};
use paint::Picture;

use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::pipeline::both;
use crate::gpu::recorder::Recorder;
use crate::gpu::stage::{Constant, Stage};
use crate::image::Region;
use crate::painters::painter::Job;
use crate::stats::TilesStats;

/// The largest radius of kernels, in voxels.
const MAX_RADIUS: f64 = 4.0;
/// The largest radius of kernels whose footprints along straight rays are evaluated once.
const MAX_STRAIGHT_RADIUS: f64 = 2.0;

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
    /// A ray for each pixel, through one of several layers.
    Layered,
}

/// The specialisation of the pipelines.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct TilesKey {
    voxel: Voxel,
    layout: Layout,
    rays: RayKind,
    /// The samples that are packed in place of lists of splats.
    samples: Option<SamplesKey>,
    /// Override constants of all shaders.
    constants: Vec<Constant>,
}

/// The pipelines of the painter.
pub(crate) struct Tiles {
    packer: Packer,
    skip: Stage,
    gather: Stage,
}

impl Tiles {
    pub(crate) fn new(context: &Context, key: &TilesKey) -> Result<Self> {
        let rest = || {
            let packer = Packer::new(context, &key.constants, (key.voxel, key.layout), key.samples);
            (packer, march::skip(context, &key.constants))
        };
        let (gather, (packer, skip)) = both(context, || march::gather(context, key), rest)?;
        Ok(Self { packer, skip, gather })
    }

    /// Records the rays of a picture in a region. Returns their number and marches.
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
        for ((axis, packed), sections) in picture.axes.iter().zip(packed).zip(&picture.sections) {
            if !axis.axis.is_in(region, view.camera.size) {
                continue;
            }
            let mut rays = picture.setup(axis).rays(region, part);
            rays.density_scale /= packed.scale as f32;
            let on_device = context.upload("rays", bytemuck::bytes_of(&rays), uniform)?;
            let state = if picture.is_layered() { Some(canvas.before(context, &axis.axis)?) } else { None };
            let Canvas { pixels, solids, .. } = &*canvas;
            let (lighting, post, state) = (&lighting, picture.job.post, state.as_ref());
            let targets = Targets { rays: &on_device, sections, state, pixels, lighting, post, solids };
            march(recorder, [&self.skip, &self.gather], packed, &rays, targets)?;
            drawn.rays += region.area();
            drawn.marches += 1;
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
