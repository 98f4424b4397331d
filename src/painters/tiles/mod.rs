//! The painter `tiles`: compute shaders that march a ray for each pixel from voxel plane to voxel plane. Rays skip
//! empty macrocells and end when they are opaque.
//!
//! On software Vulkan a quad costs about two microseconds, whatever it shows, so this painter gathers instead. Its rays
//! march along the *principal viewing axis*, the lattice axis closest to their direction, from one voxel plane to the
//! next, and sum the footprints of the voxels around (docs/slab.svg).
//!
//! # Slabs
//!
//! Each voxel plane has a slab around it, and the borders of the slabs cut the kernel of a voxel into five parts. The
//! share of a part in the footprint w is nearly a linear function x + y s of the place s of the kernel's centre along
//! the ray. With parallel rays, x and y are the same for all kernels of a picture. A plane therefore needs two sums
//! over its voxels, the moments m0 = sum of w and m1 = sum of w s: part k of all its kernels together is x_k m0 + y_k
//! m1. If the densest voxel has an optical depth over 0.7, parts are parabolas x + y s + z s^2, and a plane has a third
//! moment.
//!
//! The parts of a kernel add up to its footprint, so the optical depth of a ray is the depth of whole kernels. A slab
//! is composited when all planes that reach it have been gathered. A fitted part may be negative. Up to an optical
//! depth of 0.03 the errors of neighbours cancel, and stay uncorrected. Beyond, a slab pays the deficit of the slab
//! behind it, and passes its own deficit on to that slab. Transmittance is exp of minus the depth, and colour is linear
//! in optical depth within a slab, between bounds. Up to 70 optical depths per voxel, colours are about as exact as
//! with `quads`. Beyond, the fit becomes visible: a hundredth of a kernel in the wrong slab hides the matter behind it.
//!
//! Post-shading sums scalars in slabs half a plane thick with three moments, because classification magnifies small
//! differences. Rays gather kernels with a radius of up to 4 voxels. In perspective the growth g of kernels is linear
//! in the lattice: the footprint is the footprint of the original kernel at r / g, over g^2, and the parts of kernels
//! are parabolas in g.
//!
//! # Stages
//!
//! - `pack` (shaders `pack_samples`, `pack_scalars` or `pack_cells` with a file of `packed/`; `page_table`; files in
//!   `pack/`) writes visible voxels or scalars into a texture of voxels. It marks cells of 2^3 voxels, a byte for each
//!   macrocell of 4^3: cells with splats, or of scalars the cells near a visible scalar. It packs again only if the
//!   transfer function or the light on lit voxels changes.
//! - `skip` (`march.rs`) finds for each tile of 8 x 8 rays the runs of voxel planes with marked cells, by a workgroup
//!   for each tile.
//! - `gather` (shaders `gather`, `gather_scalars`; `march.rs`) marches a ray for each pixel from voxel plane to voxel
//!   plane, through the lattices of several levels one after the other (`layers.rs`).
//!
//! Places of rays are measured from the middle of the volume, so a distant eye causes no cancellation. Runs of planes
//! take memory for each tile and plane: a picture is made in parts whose runs take 256 MiB. A submission has at most
//! the work of 2e8 fragments (of a discrete GPU ten times as much), so that a GPU watchdog does not kill it; regions
//! and passes are cut accordingly.
//!
//! # What makes it fast
//!
//! - *Straight rays.* A ray along a lattice axis meets all planes at the same place, so its footprints are computed
//!   once.
//! - *Footprints as polynomials.* The footprint is c p(c^2): 6 terms for the Gaussian (1e-5 of the peak), 8 for
//!   Kaiser-Bessel (2e-5).
//! - *Voxels as texels.* The volume is packed into a texture of 8 bytes per voxel of the box around visible voxels (4
//!   for scalars without light), at most 4 GiB. The box has a texel for each voxel, and rays along every axis read it
//!   (`common/box`). Of a box of 128 MiB or more that is nearly empty, the texture has the pages of 4^3 voxels that
//!   have splats, with a table of their places, if that takes a quarter of the memory (`pack/pages.rs`). Colours in a
//!   light are packed anew for each eye, into the same texture. Samples are packed over the samples of another transfer
//!   function too. Boxes are whole macrocells of the lattice, so a picture has the same bytes whatever is packed beside
//!   it.
//! - *Empty space* is skipped by macrocell, and rays end when their transmittance is below the termination. Scalars are
//!   packed farther than they show: their slabs count at marked cells only, which kernels of visible scalars may reach.
//!   Rays gather the planes before a run, and classify the slabs of the run.
//!
//! # Axes
//!
//! A picture is a sum of marches. Rays within 2 degrees of a tie of two axes are marched along both. Shares change
//! smoothly with the view, and rays through one eye have individual shares. So a turn of 0.001 degrees changes a
//! picture as much as it changes the reference, and no axis pops. Rays through one eye may have up to three principal
//! axes; each axis is marched for the rays in which it has a share.

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
use march::{MarchTargets, march};
use pack::{PackableKey, Packed, Packer, TextureLayout, Voxel};
use paint::TilesPicture;

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
/// The largest radius, in voxels, of kernels whose footprints along straight rays are evaluated once.
const MAX_STRAIGHT_RADIUS: f64 = 2.0;

/// The largest movement of straight rays across the volume, in voxels: 1e-4 of a voxel changes a footprint by about
/// 1e-4 of its peak.
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

/// The key of the painter's pipelines: their specialisation.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct TilesKey {
    voxel: Voxel,
    layout: TextureLayout,
    rays: RayKind,
    /// The form of the voxels that are packed; `None`: there are none.
    source: Option<PackableKey>,
    /// The override constants of all shaders.
    constants: Vec<Constant>,
}

/// The pipelines of the painter `tiles`.
pub(crate) struct Tiles {
    /// `None`: there are no voxels.
    packer: Option<Packer>,
    skip: Stage,
    gather: Stage,
}

impl Tiles {
    pub(crate) fn new(context: &Context, key: &TilesKey) -> Result<Self> {
        let rest = || {
            let packer = |source| Packer::new(context, &key.constants, (key.voxel, key.layout), source);
            (key.source.map(packer), march::skip(context, &key.constants))
        };
        let (gather, (packer, skip)) = both(context, || march::gather(context, key), rest)?;
        Ok(Self { packer, skip, gather })
    }

    /// Records the rays of a picture in a region. Returns the number of rays and of marches.
    fn draw(
        &self,
        recorder: &mut Recorder<'_>,
        picture: &TilesPicture<'_>,
        packed: &[Arc<Packed>],
        canvas: &mut RegionPixels,
    ) -> Result<TilesStats> {
        let context = recorder.context;
        let RegionPixels { region, part, .. } = *canvas;
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
            let RegionPixels { pixels, solids, .. } = &*canvas;
            let (lighting, post, state) = (&lighting, picture.job.post, state.as_ref());
            let targets = MarchTargets { rays: &on_device, sections, state, pixels, lighting, post, solids };
            march(recorder, [&self.skip, &self.gather], packed, &rays, targets)?;
            drawn.rays += region.area();
            drawn.marches += 1;
        }
        Ok(drawn)
    }
}

/// The pixels of a region while rays add to them.
struct RegionPixels {
    region: Region,
    /// The part of the region whose pixels must be right.
    part: Region,
    /// The pixels of the region: premultiplied RGBA, f32.
    pixels: wgpu::Buffer,
    /// The depths of the solids in the pixels, the same for all layers.
    solids: wgpu::Buffer,
    /// The state of rays behind the layers so far, by their principal axis.
    before: Vec<([usize; 3], bool, wgpu::Buffer)>,
}

impl RegionPixels {
    /// Makes the canvas of a region, without colour.
    fn new(job: &Job<'_>, region: Region, part: Region) -> Result<Self> {
        let pixels = job.context.pixels("tiles.pixels", [region.width, region.height])?;
        Ok(Self { region, part, pixels, solids: job.solid_depths(region)?, before: Vec::new() })
    }

    /// Returns the state of the rays along an axis, which is clear before the first layer.
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
