//! The painter `tiles`: compute shaders that follow rays over a raster of the lattice's own, so that rays share what they
//! know of the kernels, and enlarge it to the picture. Rays skip what is empty and end where they are opaque.

mod pack;
mod raster;

#[cfg(test)]
pub(crate) use pack::MARGIN;
pub(crate) use pack::Packed;
#[cfg(test)]
pub(crate) use raster::CELL;
pub(crate) use raster::RUN_ROW;

use std::sync::Arc;

use pack::{Packer, Packing};
use raster::{Footprint, Look, Raster, Subject};

use super::classify::Store;
use super::context::Context;
use super::layout::Lighting;
use super::pipeline::{Slot, bind, compute, flag, layout, module};
use super::plan::{Plan, Region};
use super::shaders;
use super::timing::Timing;
use crate::camera::{Camera, Projection};
use crate::error::Result;
use crate::settings::{Accumulation, Model, Resolution, Settings, Sheets};
use crate::volume::Grid;

/// The radius of kernels, in voxels, that the shaders' rows of six voxels hold at every angle.
const MAX_RADIUS: f64 = 2.0;

/// What the pipelines are specialised for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct TilesKey {
    /// X-ray: white.
    white: bool,
    lights: u32,
    /// A ray for each pixel, instead of one or a few for each voxel.
    full: bool,
    /// Terms of the footprint's polynomial.
    terms: u32,
}

/// Why the painter does not serve a picture; `None`: it does.
pub(crate) fn refusal(context: &Context, plan: &Plan, camera: &Camera, settings: &Settings) -> Option<String> {
    let given = |what: &str| Some(format!("it has no {what}"));
    if settings.is_post_shaded() {
        return Some("it shades voxels, not pixels".to_owned());
    }
    if !matches!(camera.projection, Projection::Orthographic { .. }) {
        return Some("its rays are parallel".to_owned());
    }
    if settings.sheets == Sheets::Axis || settings.accumulation == Accumulation::Additive {
        return Some("its sheets add up optical depth of parts of kernels".to_owned());
    }
    if settings.kernel.radius() > MAX_RADIUS {
        return Some(format!("its kernels reach at most {MAX_RADIUS} voxels"));
    }
    if plan.max_growth() > 1.0 {
        return Some("its kernels do not grow where voxels are smaller than pixels".to_owned());
    }
    if settings.model == Model::Composite && settings.sheet_thickness < 1.0 {
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
    key: TilesKey,
    packer: Packer,
    skip_layout: wgpu::BindGroupLayout,
    skip: wgpu::ComputePipeline,
    gather_layout: wgpu::BindGroupLayout,
    gather: wgpu::ComputePipeline,
    enlarge: Option<Enlarge>,
}

struct Enlarge {
    layout: wgpu::BindGroupLayout,
    across: wgpu::ComputePipeline,
    down: wgpu::ComputePipeline,
    enlarge: wgpu::ComputePipeline,
    sampler: wgpu::Sampler,
}

/// A scene as the painter looks at it.
pub(crate) struct View<'a> {
    pub(crate) stores: &'a [Store],
    pub(crate) grid: &'a Grid,
    pub(crate) camera: &'a Camera,
    pub(crate) settings: &'a Settings,
    /// The largest density of a voxel, and the world distance that densities are per.
    pub(crate) max_weight: f64,
    pub(crate) unit: f64,
    footprint: Footprint,
    look: Look,
    packing: Packing,
}

/// What was drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Followed {
    /// Rays.
    pub(crate) rays: u64,
    /// Rays per voxel along the two lattice axes that face the eye most; `None`: one per pixel.
    pub(crate) rays_per_voxel: Option<[u32; 2]>,
}

impl<'a> View<'a> {
    /// Says why where that cannot be: the volume does not fit into a texture, or the kernel's footprint is no polynomial.
    pub(crate) fn new(
        context: &Context,
        stores: &'a [Store],
        grid: &'a Grid,
        camera: &'a Camera,
        settings: &'a Settings,
        [max_weight, unit]: [f64; 2],
    ) -> std::result::Result<Self, &'static str> {
        let footprint =
            Footprint::new(&settings.kernel).ok_or("its footprints are polynomials, this kernel's is none")?;
        let look = Look::new(camera, grid);
        let packing = Packing::new(context, stores, grid.dims(), look.axes).ok_or("the volume outgrows its texture")?;
        Ok(Self { stores, grid, camera, settings, max_weight, unit, footprint, look, packing })
    }

    /// The largest error of the footprint, as a fraction of its peak.
    pub(crate) fn footprint_error(&self) -> f64 {
        self.footprint.error
    }

    pub(crate) fn key(&self) -> TilesKey {
        TilesKey {
            white: self.settings.model == Model::Xray,
            lights: self.settings.lighting.as_ref().map_or(0, |l| l.lights.len() as u32),
            terms: self.footprint.terms(),
            full: self.raster(Region { x: 0, y: 0, width: 1, height: 1 }).is_some_and(|r| r.rays_per_voxel.is_none()),
        }
    }

    /// Voxel planes across the volume, and their world distance along the rays.
    pub(crate) fn slabs(&self) -> (u32, f64) {
        (self.packing.dims[2], self.look.slab())
    }

    /// Whether a volume packed before is what this picture needs.
    pub(crate) fn is_served_by(&self, packed: &Packed) -> bool {
        // Light is packed with the colours, and may come from the eye.
        self.settings.savings.reuse && self.settings.lighting.is_none() && packed.packing == self.packing
    }

    fn raster(&self, region: Region) -> Option<Raster> {
        let settings = self.settings;
        let subject = Subject {
            camera: self.camera,
            grid: self.grid,
            size: settings.size,
            kernel: settings.kernel,
            footprint: &self.footprint,
            packing: self.packing,
            density_scale: 1.0 / (settings.normalization.divisor(&settings.kernel) * self.unit),
            opaque_depth: match (settings.model, settings.termination) {
                (Model::Composite, e) if e > 0.0 => -e.ln(),
                _ => f64::INFINITY,
            },
            max_depth: self.max_weight * self.look.voxel() / self.unit,
            full: settings.resolution == Resolution::Full,
        };
        Raster::new(&subject, &self.look, region)
    }
}

impl Tiles {
    pub(crate) fn new(context: &Context, key: TilesKey) -> Self {
        let stage = wgpu::ShaderStages::COMPUTE;
        let d2 = wgpu::TextureViewDimension::D2;
        let d3 = wgpu::TextureViewDimension::D3;
        let picture = Slot::StorageTexture(wgpu::TextureFormat::Rgba32Float, d2);
        let runs = Slot::StorageTexture(wgpu::TextureFormat::Rg32Uint, d2);
        let skip_layout = layout(context, "skip", stage, &[Slot::Uniform, Slot::IntegerTexture(d3), runs]);
        let skip = compute(context, &module(context, shaders::SKIP), "skip", "skip", &skip_layout, &[]);
        let textures = [Slot::IntegerTexture(d2), Slot::IntegerTexture(d2)];
        let slots = [Slot::Uniform, textures[0], textures[1], picture, Slot::Write];
        let gather_layout = layout(context, "gather", stage, &slots);
        let entry = if key.full { "single" } else { "blocked" };
        let constants = [("WHITE", flag(key.white)), ("TERMS", f64::from(key.terms))];
        let gather = compute(context, &module(context, shaders::GATHER), "gather", entry, &gather_layout, &constants);
        let enlarge = (!key.full).then(|| {
            let slots = [Slot::Uniform, Slot::FilteredTexture, picture, Slot::Sampler, Slot::Write];
            let layout = layout(context, "enlarge", stage, &slots);
            let module = module(context, shaders::ENLARGE);
            let prefilter = |down| compute(context, &module, "enlarge", "prefilter", &layout, &[("DOWN", flag(down))]);
            let sampler = context.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("enlarge.filtered"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..wgpu::SamplerDescriptor::default()
            });
            Enlarge {
                across: prefilter(false),
                down: prefilter(true),
                enlarge: compute(context, &module, "enlarge", "enlarge", &layout, &[]),
                sampler,
                layout,
            }
        });
        Self { key, packer: Packer::new(context, key.lights), skip_layout, skip, gather_layout, gather, enlarge }
    }

    /// The volume of a view in a texture.
    pub(crate) fn pack(
        &self,
        context: &Context,
        timing: &mut Timing,
        view: &View<'_>,
        lighting: &Lighting,
    ) -> Result<Arc<Packed>> {
        let packed = self.packer.run(context, timing, view.stores, view.packing, lighting, view.max_weight)?;
        Ok(Arc::new(packed))
    }

    /// Draws a region, as premultiplied RGBA.
    pub(crate) fn run(
        &self,
        context: &Context,
        timing: &mut Timing,
        view: &View<'_>,
        packed: &Packed,
        region: Region,
    ) -> Result<(Vec<[f32; 4]>, Followed)> {
        let Some(mut raster) = view.raster(region) else {
            let pixels = region.width as usize * region.height as usize;
            return Ok((vec![[0.0; 4]; pixels], Followed::default()));
        };
        raster.uniforms.density_scale /= packed.scale as f32;
        let uniforms = &raster.uniforms;
        let [width, height] = uniforms.size;
        let [across, down] = uniforms.tiles;
        let tiles = across * down * uniforms.phases;
        let frame = context.upload("raster", bytemuck::bytes_of(uniforms), wgpu::BufferUsages::UNIFORM)?;
        let texture = |label, format, [width, height]: [u32; 2]| {
            let texture = context.texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let rows = tiles.div_ceil(RUN_ROW) * uniforms.run_slots;
        let runs = texture("skip.runs", wgpu::TextureFormat::Rg32Uint, [tiles.min(RUN_ROW), rows]);
        let picture_size = if self.key.full { [1, 1] } else { [width, height] };
        let pictures = [0, 1].map(|_| texture("gather.picture", wgpu::TextureFormat::Rgba32Float, picture_size));
        let bytes = u64::from(region.width) * u64::from(region.height) * 16;
        let pixels =
            context.buffer("tiles.pixels", bytes, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC)?;
        let mut encoder = context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut dispatch = |stage, pipeline: &wgpu::ComputePipeline, group: &wgpu::BindGroup, [x, y, z]: [u32; 3]| {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(stage),
                timestamp_writes: timing.compute(context, stage),
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(x, y, z);
        };
        let resources = [frame.as_entire_binding(), texture_binding(&packed.occupied), texture_binding(&runs)];
        let group = bind(context, "skip", &self.skip_layout, &resources);
        dispatch("skip", &self.skip, &group, [across.div_ceil(8), down.div_ceil(8), uniforms.phases]);
        let resources = [
            frame.as_entire_binding(),
            texture_binding(&packed.volume),
            texture_binding(&runs),
            texture_binding(&pictures[0]),
            pixels.as_entire_binding(),
        ];
        let group = bind(context, "gather", &self.gather_layout, &resources);
        dispatch("gather", &self.gather, &group, [across, down, uniforms.phases]);
        if let Some(stage) = &self.enlarge {
            let group = |from: &wgpu::TextureView, to: &wgpu::TextureView| {
                let resources = [
                    frame.as_entire_binding(),
                    texture_binding(from),
                    texture_binding(to),
                    wgpu::BindingResource::Sampler(&stage.sampler),
                    pixels.as_entire_binding(),
                ];
                bind(context, "enlarge", &stage.layout, &resources)
            };
            let [a, b] = &pictures;
            let spare = texture("enlarge.spare", wgpu::TextureFormat::Rgba32Float, [1, 1]);
            dispatch("enlarge", &stage.across, &group(a, b), [width.div_ceil(64), height, 1]);
            dispatch("enlarge", &stage.down, &group(b, a), [width.div_ceil(64), height, 1]);
            dispatch("enlarge", &stage.enlarge, &group(a, &spare), [region.width.div_ceil(64), region.height, 1]);
        }
        let staging =
            context.buffer("tiles.staging", bytes, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)?;
        encoder.copy_buffer_to_buffer(&pixels, 0, &staging, 0, bytes);
        context.queue.submit([encoder.finish()]);
        let data = context.read("following rays", &staging)?;
        let rgba = data[..bytes as usize].chunks_exact(16).map(bytemuck::pod_read_unaligned).collect();
        let rays = u64::from(width) * u64::from(height);
        Ok((rgba, Followed { rays, rays_per_voxel: raster.rays_per_voxel }))
    }
}

fn texture_binding(view: &wgpu::TextureView) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::TextureView(view)
}
