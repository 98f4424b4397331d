//! The painter `tiles`: compute shaders that follow rays over a raster of the lattice's own, so that rays share what they
//! know of the kernels, and enlarge it to the picture. Rays skip what is empty and end where they are opaque.

mod enlarge;
mod follow;
mod look;
mod pack;
mod paint;
mod parts;
mod raster;

pub(crate) use pack::Packed;
pub(crate) use paint::ROOM;

use std::sync::Arc;

use enlarge::{Enlarge, IntermediateImage, PICTURE};
use follow::{Stage, Targets, follow};
use pack::{Packer, Voxel};
use paint::Picture;
use raster::Spacing;

use super::context::Context;
use super::pipeline::{Cached, both};
use super::recorder::Recorder;
use super::view::Region;
use crate::error::Result;
use crate::settings::Model;

/// The pipelines made so far.
#[derive(Default)]
pub(crate) struct Cache(Cached<TilesKey, Tiles>);

/// The radius of kernels, in voxels, that reach two planes and three texels of a row.
const MAX_RADIUS: f64 = 2.0;
/// That of kernels of classified voxels along parallel rays, which may reach farther.
const MAX_PARALLEL_RADIUS: f64 = 3.0;

/// How far straight rays may move across the volume, in voxels.
const STRAIGHT: f64 = 1e-4;

/// Which rays are followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
enum Rays {
    /// Those of the pixels.
    #[default]
    Pixels,
    /// Those of the pixels, which run along m.
    Straight,
    /// Each on its own through a coarser raster, that is enlarged.
    Coarser,
    /// Eight at a time through the lattice's raster, that is enlarged.
    Shared,
}

/// What the pipelines are specialised for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(crate) struct TilesKey {
    model: Model,
    voxel: Voxel,
    lights: u32,
    perspective: bool,
    rays: Rays,
    /// Terms of the footprint's polynomial.
    terms: u32,
    /// Texels of a row of voxels that kernels reach.
    texels: u32,
}

/// The pipelines of the painter.
pub(crate) struct Tiles {
    packer: Packer,
    skip: Stage,
    gather: Stage,
    enlarge: Option<Enlarge>,
}

impl Tiles {
    pub(crate) fn new(context: &Context, key: TilesKey) -> Result<Self> {
        let rest = || {
            let packer = Packer::new(context, key.voxel, key.perspective);
            (
                packer,
                Stage::skip(context, key),
                matches!(key.rays, Rays::Coarser | Rays::Shared).then(|| Enlarge::new(context)),
            )
        };
        let (gather, (packer, skip, enlarge)) = both(context, || Stage::gather(context, key), rest)?;
        Ok(Self { packer, skip, gather, enlarge })
    }

    /// Records the rays of a picture in a region.
    fn draw(
        &self,
        recorder: &mut Recorder<'_>,
        picture: &Picture<'_>,
        packed: &[Arc<Packed>],
        region: Region,
    ) -> Result<Followed> {
        let context = recorder.context;
        let pixels = context.pixels("tiles.pixels", [region.width, region.height])?;
        let uniform = wgpu::BufferUsages::UNIFORM;
        let lighting = context.upload("gather.lighting", bytemuck::bytes_of(&picture.lighting), uniform)?;
        let (mut rays, mut spacing) = (0, None);
        let mut image: Option<IntermediateImage> = None;
        for (look, packed) in picture.looks.iter().zip(packed) {
            let Some(mut raster) = picture.raster(look, region) else { continue };
            raster.uniforms.density_scale /= packed.scale as f32;
            let [width, height] = raster.uniforms.size;
            // Of several looks each follows its own of the same rays.
            (rays, spacing) = (u64::from(width) * u64::from(height), Some(raster.spacing));
            let frame = context.upload("raster", bytemuck::bytes_of(&raster.uniforms), uniform)?;
            // All looks share one intermediate image.
            let image = image.get_or_insert_with(|| {
                let size = if self.enlarge.is_some() { [width, height] } else { [1, 1] };
                let pictures = [0, 1].map(|_| texture(context, "gather.picture", PICTURE, size));
                IntermediateImage { frame: frame.clone(), size, pictures }
            });
            let targets = Targets {
                frame: &frame,
                picture: &image.pictures[0],
                pixels: &pixels,
                lighting: &lighting,
                transfer: picture.job.transfer,
            };
            follow(recorder, &self.skip, &self.gather, packed, &raster.uniforms, &targets);
        }
        if let (Some(stage), Some(image)) = (&self.enlarge, &image) {
            stage.run(recorder, image, &pixels, [region.width, region.height]);
        }
        Ok(Followed { pixels, rays, spacing })
    }
}

/// A region whose rays were followed.
struct Followed {
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
