//! The painter `tiles`: compute shaders that follow rays over a raster of the lattice's own, so that rays share what they
//! know of the kernels, and enlarge it to the picture. Rays skip what is empty and end where they are opaque.

mod axis;
mod enlarge;
mod follow;
mod pack;
mod parts;
mod rays;

pub(crate) use pack::Packed;

use std::sync::Arc;

use axis::PrincipalAxis;
use enlarge::{Enlarge, PICTURE};
use follow::{Stage, Targets, follow};
use pack::{Lit, Packer, Packing, Voxel};
use parts::{Footprint, Sections};
pub(crate) use rays::Spacing;
use rays::{Classification, FittedKernel, Optics, PackedBox, RaySetup, Rays};

use super::context::Context;
use super::layout::Lighting;
use super::pipeline::both;
use super::quads::plan::{Plan, Region};
use super::store::Store;
use super::timing::Timing;
use super::transfer::TransferTable;
use crate::camera::{Camera, Projection};
use crate::error::Result;
use crate::kernel::Kernel;
use crate::settings::{Accumulation, Interslice, Model, Resolution, Settings, Sheets};
use crate::volume::Grid;

/// The radius of kernels, in voxels, that reach two planes and three texels of a row.
const MAX_RADIUS: f64 = 2.0;
/// That of kernels of classified voxels along parallel rays, which may reach farther.
const MAX_PARALLEL_RADIUS: f64 = 3.0;

/// Places at which a slab of scalars, half a plane thick, is classified, per voxel of its thickness.
const SAMPLES_PER_VOXEL: f64 = 8.0;

/// How far straight rays may move across the volume, in voxels.
const STRAIGHT: f64 = 1e-4;

/// Pixels that are worth an X-ray's quad.
const PIXELS_PER_QUAD: u64 = 8;

/// Which rays are followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
enum RayKind {
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
    rays: RayKind,
    /// Terms of the footprint's polynomial.
    terms: u32,
    /// Texels of a row of voxels that kernels reach.
    texels: u32,
}

/// Why the painter does not serve a picture; `None`: it does.
pub(crate) fn refusal(context: &Context, plan: &Plan, settings: &Settings) -> Option<String> {
    let given = |what: &str| Some(format!("it has no {what}"));
    if settings.sheets == Sheets::Axis || settings.accumulation == Accumulation::Additive {
        return Some("its sheets add up optical depth of parts of kernels".to_owned());
    }
    let growth = plan.max_growth();
    if plan.is_perspective() && growth > 1.0 {
        return Some("its kernels are of one size, and grow with the distance here".to_owned());
    }
    let wide = !plan.is_perspective() && !settings.is_post_shaded();
    let most = if wide { MAX_PARALLEL_RADIUS } else { MAX_RADIUS };
    if settings.kernel.radius() * growth > most {
        let grown = if growth > 1.0 { ", grown to the size of pixels" } else { "" };
        return Some(format!("its kernels reach at most {most} voxels{grown}"));
    }
    if !settings.is_post_shaded() && plan.is_among_voxels() {
        return Some("its kernels are not cut at the eye, which is among the voxels".to_owned());
    }
    if settings.model != Model::Xray && settings.sheet_thickness < 1.0 {
        return Some("its sheets are a voxel thick and more".to_owned());
    }
    if settings.precision.is_some() || settings.sheets_per_pass.is_some() {
        return given("sheets in memory to choose a precision or a number of");
    }
    if settings.max_error.is_some() || settings.footprint_table.is_some() {
        return given("footprint table to choose");
    }
    if !context.features.contains(wgpu::Features::FLOAT32_FILTERABLE) {
        return Some(format!("{} does not filter 32-bit floats", context.info.name));
    }
    None
}

/// The pipelines of the painter.
pub(crate) struct Tiles {
    packer: Packer,
    skip: Stage,
    gather: Stage,
    enlarge: Option<Enlarge>,
}

/// What the painter draws.
#[derive(Clone, Copy)]
pub(crate) struct Subject<'a> {
    pub(crate) stores: &'a [Store],
    pub(crate) grid: &'a Grid,
    /// Layers of the lattice beyond the faces of the volume.
    pub(crate) padding: u32,
    /// How many times as large as asked for kernels are.
    pub(crate) growth: f64,
    /// The largest density of a voxel, or scalar.
    pub(crate) max_weight: f64,
    /// World distance that densities are per.
    pub(crate) unit: f64,
    /// What scalars are classified by.
    pub(crate) transfer: Option<&'a TransferTable>,
}

/// A scene as the painter looks at it.
pub(crate) struct View<'a> {
    subject: Subject<'a>,
    camera: &'a Camera,
    pub(crate) settings: &'a Settings,
    /// As it has grown.
    kernel: Kernel,
    footprint: Footprint,
    sections: Sections,
    /// The ways in which rays follow the lattice, and the volume as each reads it.
    looks: Vec<(PrincipalAxis, Packing)>,
}

/// What was drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Followed {
    /// Rays.
    pub(crate) rays: u64,
    pub(crate) spacing: Option<Spacing>,
}

impl<'a> View<'a> {
    /// Says why where that cannot be: the volume does not fit into a texture, or the kernel's footprint is no polynomial.
    pub(crate) fn new(
        context: &Context,
        subject: Subject<'a>,
        camera: &'a Camera,
        settings: &'a Settings,
    ) -> std::result::Result<Self, &'static str> {
        let kernel = settings.kernel.grown(subject.growth);
        let footprint = Footprint::new(&kernel).ok_or("its footprints are polynomials, this kernel's is none")?;
        let lights = settings.lighting.as_ref().map_or(0, |l| l.lights.len() as u32);
        let voxel = match (settings.is_post_shaded(), lights) {
            (false, lights) => Voxel::Color { lights },
            (true, 0) => Voxel::Scalar,
            (true, _) => Voxel::Gradient,
        };
        let dims = subject.grid.dims().map(|n| n + 2 * subject.padding);
        let whole = !subject.shows_nothing_else();
        let looks = PrincipalAxis::all(camera, subject.grid, settings.size);
        let packings = looks.iter().map(|look| {
            Packing::new(context, subject.stores, dims, whole, look.axes, voxel)
                .ok_or("the volume outgrows its texture")
        });
        let packings = packings.collect::<std::result::Result<Vec<_>, _>>()?;
        let sections = Sections::new(&kernel, camera, &looks, subject.transfer.is_some());
        let looks = looks.into_iter().zip(packings).collect();
        Ok(Self { subject, camera, settings, kernel, footprint, sections, looks })
    }

    /// The largest error of the footprint, as a fraction of its peak.
    pub(crate) fn footprint_error(&self) -> f64 {
        self.footprint.error
    }

    /// Whether there is anything to look at.
    pub(crate) fn is_empty(&self) -> bool {
        self.looks.is_empty() || self.subject.stores.is_empty() && self.subject.shows_nothing_else()
    }

    pub(crate) fn key(&self) -> TilesKey {
        let [look, ..] = self.looks.as_slice() else { return TilesKey::default() };
        let (_, packing) = look;
        let [width, height] = self.settings.size;
        let raster = self.raster(look, Region { x: 0, y: 0, width, height });
        let perspective = matches!(self.camera.projection, Projection::Perspective { .. });
        TilesKey {
            model: self.settings.model,
            voxel: packing.voxel,
            lights: self.settings.lighting.as_ref().map_or(0, |l| l.lights.len() as u32),
            perspective,
            terms: self.footprint.terms(),
            texels: match raster.map_or(0.0, |r| r.uniforms.row_half) {
                // Rays through one eye that lean along a as much as along m reach over seven voxels.
                _ if perspective => 4,
                half if half < 2.5 => 3,
                half if half < 3.5 => 4,
                _ => 5,
            },
            rays: match raster.map(|r| r.spacing) {
                Some(Spacing::Voxel(_)) => RayKind::Shared,
                Some(Spacing::Pixels(1.0)) if self.is_straight(look) => RayKind::Straight,
                Some(Spacing::Pixels(1.0)) | None => RayKind::Pixels,
                Some(Spacing::Pixels(_)) => RayKind::Coarser,
            },
        }
    }

    /// Whether rays run along m so closely that they meet all planes at the same place.
    fn is_straight(&self, (look, packing): &(PrincipalAxis, Packing)) -> bool {
        matches!(self.camera.projection, Projection::Orthographic { .. })
            && self.kernel.radius() <= MAX_RADIUS
            && look.shear().abs().max_element() * f64::from(packing.dims[2]) < STRAIGHT
    }

    /// Whether software draws the picture faster by quads: an X-ray takes one of them a splat, and a ray for each pixel a
    /// sixth of that time. Measured; ARCHITECTURE.md has the figures.
    pub(crate) fn is_better_by_quads(&self) -> bool {
        let splats: u64 = self.subject.stores.iter().map(|store| u64::from(store.count)).sum();
        let [width, height] = self.settings.size.map(u64::from);
        self.settings.model == Model::Xray
            && matches!(self.key().rays, RayKind::Pixels | RayKind::Straight)
            && PIXELS_PER_QUAD * splats < width * height
    }

    /// Slabs across the volume, and their world thickness along the rays.
    pub(crate) fn slabs(&self) -> (u32, f64) {
        let Some((look, packing)) = self.looks.first() else { return (0, 0.0) };
        let per_plane = if self.subject.transfer.is_some() { 2 } else { 1 };
        (packing.dims[2] * per_plane, look.slab() / f64::from(per_plane))
    }

    /// How many ways rays follow the lattice.
    pub(crate) fn looks(&self) -> usize {
        self.looks.len()
    }

    /// Whether a volume that was packed for this picture is what a look needs.
    pub(crate) fn serves(&self, look: usize, packed: &Packed) -> bool {
        let source = self.subject.stores.first().map(|store| &store.splats);
        self.looks[look].1 == packed.packing && source == packed.source.as_ref()
    }

    /// Whether one that was packed for another is.
    pub(crate) fn is_served_by(&self, look: usize, packed: &Packed) -> bool {
        // Light is packed with the colours, and may come from the eye.
        let lit = matches!(packed.packing.voxel, Voxel::Color { lights: 1.. });
        self.settings.savings.reuse && !lit && self.serves(look, packed)
    }

    fn raster(&self, (look, packing): &(PrincipalAxis, Packing), region: Region) -> Option<Rays> {
        let settings = self.settings;
        let Subject { grid, padding, growth, max_weight, unit, transfer, .. } = self.subject;
        let samples = match settings.interslice {
            Interslice::Mean => 1,
            Interslice::Parabola => (SAMPLES_PER_VOXEL * look.slab_voxels() / 2.0).ceil() as u32,
        };
        let scalars = transfer.map(|table| Classification {
            invisible: table.invisible,
            lookup: table.lookup,
            samples,
            skip_nothing: !self.subject.shows_nothing_else(),
        });
        let divisor = settings.normalization.divisor(&settings.kernel) * growth.powi(3);
        let setup = RaySetup {
            camera: self.camera,
            size: settings.size,
            volume: PackedBox { grid, packing: *packing, padding },
            kernel: FittedKernel { kernel: self.kernel, footprint: &self.footprint, sections: &self.sections },
            optics: Optics {
                density_scale: 1.0 / (divisor * unit),
                opaque_depth: match (settings.model, settings.termination) {
                    (Model::Composite, e) if e > 0.0 => -e.ln(),
                    _ => f64::INFINITY,
                },
                max_depth: max_weight * look.voxel() / unit,
            },
            scalars,
            // What is classified has edges that only the rays of pixels keep; rays that are shared reach two voxels.
            ray_per_pixel: settings.resolution == Resolution::Full
                || scalars.is_some()
                || self.kernel.radius() > MAX_RADIUS,
        };
        Rays::new(&setup, look, region)
    }
}

impl Subject<'_> {
    /// Whether places without splats, at the transfer function's base, show nothing.
    fn shows_nothing_else(&self) -> bool {
        self.transfer.is_none_or(|table| table.invisible[0] <= table.invisible[1])
    }
}

impl Tiles {
    pub(crate) fn new(context: &Context, key: TilesKey) -> Result<Self> {
        let rest = || {
            let packer = Packer::new(context, key.voxel, key.perspective);
            (
                packer,
                Stage::skip(context, key),
                matches!(key.rays, RayKind::Coarser | RayKind::Shared).then(|| Enlarge::new(context)),
            )
        };
        let (gather, (packer, skip, enlarge)) = both(context, || Stage::gather(context, key), rest)?;
        Ok(Self { packer, skip, gather, enlarge })
    }

    /// The volume as a look of a view reads it, in a texture.
    pub(crate) fn pack(
        &self,
        context: &Context,
        timing: &mut Timing,
        view: &View<'_>,
        look: usize,
        lighting: &Lighting,
    ) -> Result<Arc<Packed>> {
        let (camera, subject) = (view.camera, &view.subject);
        let eye = match camera.projection {
            Projection::Perspective { distance, .. } => camera.target - camera.forward * distance,
            Projection::Orthographic { .. } => camera.target,
        };
        let to_world = subject.grid.to_world().matrix3;
        let axes = [camera.right, camera.up, camera.forward];
        let lit = Lit {
            lighting,
            eye: subject.grid.to_lattice().transform_point3(eye).as_vec3().to_array(),
            view: [0, 1, 2].map(|i| axes.map(|axis| axis.dot(to_world.col(i)) as f32)),
        };
        let (_, packing) = view.looks[look];
        Ok(Arc::new(self.packer.run(context, timing, subject.stores, packing, &lit, subject.max_weight)?))
    }

    /// Draws a region, as premultiplied RGBA.
    pub(crate) fn run(
        &self,
        context: &Context,
        timing: &mut Timing,
        view: &View<'_>,
        packed: &[Arc<Packed>],
        lighting: &Lighting,
        region: Region,
    ) -> Result<(Vec<[f32; 4]>, Followed)> {
        let bytes = u64::from(region.width) * u64::from(region.height) * 16;
        let pixels =
            context.buffer("tiles.pixels", bytes, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC)?;
        let lighting = context.upload("gather.lighting", bytemuck::bytes_of(lighting), wgpu::BufferUsages::UNIFORM)?;
        let mut encoder = context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut followed = Followed::default();
        let mut enlarged: Option<Enlarged> = None;
        for (look, packed) in view.looks.iter().zip(packed) {
            let Some(mut raster) = view.raster(look, region) else { continue };
            raster.uniforms.density_scale /= packed.scale as f32;
            let [width, height] = raster.uniforms.size;
            // Of several looks each follows its own of the same rays.
            followed = Followed { rays: u64::from(width) * u64::from(height), spacing: Some(raster.spacing) };
            let frame = context.upload("raster", bytemuck::bytes_of(&raster.uniforms), wgpu::BufferUsages::UNIFORM)?;
            // Where they are enlarged from is the same for all.
            let enlarged = enlarged.get_or_insert_with(|| {
                let size = if self.enlarge.is_some() { [width, height] } else { [1, 1] };
                let pictures = [0, 1].map(|_| texture(context, "gather.picture", PICTURE, size));
                Enlarged { frame: frame.clone(), size, pictures }
            });
            let targets = Targets {
                frame: &frame,
                picture: &enlarged.pictures[0],
                pixels: &pixels,
                lighting: &lighting,
                transfer: view.subject.transfer,
            };
            let stages = [&self.skip, &self.gather];
            follow(context, &mut encoder, timing, stages, packed, &raster.uniforms, &targets);
        }
        if let (Some(stage), Some(Enlarged { frame, size, pictures })) = (&self.enlarge, &enlarged) {
            let to = (&pixels, [region.width, region.height]);
            stage.run(context, &mut encoder, timing, frame, (pictures, *size), to);
        }
        let staging =
            context.buffer("tiles.staging", bytes, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)?;
        encoder.copy_buffer_to_buffer(&pixels, 0, &staging, 0, bytes);
        context.queue.submit([encoder.finish()]);
        let data = context.read("following rays", &staging)?;
        let rgba = data[..bytes as usize].chunks_exact(16).map(bytemuck::pod_read_unaligned).collect();
        Ok((rgba, followed))
    }
}

/// What is enlarged.
struct Enlarged {
    frame: wgpu::Buffer,
    size: [u32; 2],
    /// What rays wrote, and room for filtering it.
    pictures: [wgpu::TextureView; 2],
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
