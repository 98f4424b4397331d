//! pack: the splats of a scene in a texture that rays read: see shaders/pack.wgsl.

use std::ops::Range;

use super::super::classify::Store;
use super::super::context::Context;
use super::super::layout::{Lighting, Pack};
use super::super::pipeline::{Slot, bind, compute, layout, module};
use super::super::scan::WORKGROUP;
use super::super::shaders;
use super::super::timing::Timing;
use super::raster::CELL;
use crate::error::Result;
use crate::volume::BRICK_EDGE;

/// Texels of zeros before each row of voxels; MARGIN in shaders/common/packing.wgsl.
pub(crate) const MARGIN: u32 = 7;
/// Bytes of a texel, of two voxels.
const TEXEL: u64 = 16;
/// Bytes that are packed at a time.
const BAND: u64 = 16 << 20;
/// The most bytes of a packed volume: it holds what is between visible voxels too.
const MAX_BYTES: u64 = 1 << 30;
/// Densities are scaled to stay below this, the largest power of two that f16 holds but one.
const FULL: f64 = 16_384.0;

/// Where the voxels of a volume are in the texture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Packing {
    /// Numbers of the lattice axes a, b and m.
    pub(super) axes: [usize; 3],
    /// First lattice point, and points, along a, b and m.
    pub(super) low: [u32; 3],
    pub(super) dims: [u32; 3],
    pub(super) columns: u32,
    pub(super) row_texels: u32,
    size: [u32; 2],
}

impl Packing {
    /// The packing of the bricks that splats are in; `None` where it does not fit into a texture.
    pub(super) fn new(context: &Context, stores: &[Store], dims: [u32; 3], axes: [usize; 3]) -> Option<Self> {
        let bricks = stores.iter().flat_map(|store| &store.bricks);
        let (low, high) = bricks.fold(([u32::MAX; 3], [0; 3]), |(low, high), brick| {
            let axis =
                |i: usize| (low[i].min(brick.origin[i]), high[i].max(dims[i].min(brick.origin[i] + BRICK_EDGE as u32)));
            let ends = [0, 1, 2].map(axis);
            (ends.map(|(low, _)| low), ends.map(|(_, high)| high))
        });
        let low = axes.map(|axis| low[axis]);
        let dims: [u32; 3] = std::array::from_fn(|i| high[axes[i]].saturating_sub(low[i]));
        let [a, b, m] = dims;
        let most = u64::from(context.limits.max_texture_dimension_2d);
        let row_texels = a.div_ceil(2);
        let rows = u64::from(b) + 1;
        // As square as planes allow.
        let column = u64::from(row_texels + MARGIN);
        let columns = ((f64::from(m) * rows as f64 / column as f64).sqrt().ceil() as u64).clamp(1, u64::from(m.max(1)));
        // Rows of buffers that are copied to textures are aligned.
        let align = u64::from(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT) / TEXEL;
        let width = (columns * column + u64::from(MARGIN)).next_multiple_of(align);
        let height = u64::from(m).div_ceil(columns) * rows + 1;
        let fits = width <= most && height <= most && width * height * TEXEL <= MAX_BYTES;
        let cells = dims.map(|n| n.div_ceil(CELL)).iter().all(|&n| n <= context.limits.max_texture_dimension_3d);
        (fits && cells).then_some(Self {
            axes,
            low,
            dims,
            columns: columns as u32,
            row_texels,
            size: [width as u32, height as u32],
        })
    }
}

impl Packing {
    /// The planes that have voxels in rows of the texture.
    fn planes(&self, rows: Range<u32>) -> Range<u32> {
        let shelf = self.dims[1] + 1;
        let at = |row: u32| (row / shelf * self.columns).min(self.dims[2]);
        at(rows.start.saturating_sub(1))..at(rows.end.saturating_sub(1) + shelf)
    }

    /// From the first splat of a store to the last of those that can be in planes.
    fn splats(&self, store: &Store, planes: &Range<u32>) -> Range<u32> {
        let end = |number: usize| store.bricks.get(number + 1).map_or(store.count, |next| next.first);
        let (low, axis) = (self.low[2], self.axes[2]);
        let inside = |origin: u32| origin < low + planes.end && origin + BRICK_EDGE as u32 > low + planes.start;
        let bricks = store.bricks.iter().enumerate().filter(|(_, brick)| inside(brick.origin[axis]));
        let runs = bricks.map(|(number, brick)| brick.first..end(number));
        runs.reduce(|hull, run| hull.start.min(run.start)..hull.end.max(run.end)).unwrap_or(0..0)
    }
}

/// A packed volume on the device.
#[derive(Debug)]
pub(crate) struct Packed {
    pub(super) packing: Packing,
    pub(super) volume: wgpu::TextureView,
    pub(super) occupied: wgpu::TextureView,
    /// What densities were multiplied by.
    pub(super) scale: f64,
    bytes: u64,
}

impl Packed {
    /// Bytes on the device.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// The pipeline.
pub(super) struct Packer {
    layout: wgpu::BindGroupLayout,
    voxels: wgpu::ComputePipeline,
}

impl Packer {
    /// For that many lights.
    pub(super) fn new(context: &Context, lights: u32) -> Self {
        let slots = [
            Slot::Uniform,
            Slot::Uniform,
            Slot::Read,
            Slot::Read,
            Slot::Write,
            Slot::StorageTexture(wgpu::TextureFormat::R32Uint, wgpu::TextureViewDimension::D3),
        ];
        let layout = layout(context, "pack", wgpu::ShaderStages::COMPUTE, &slots);
        let module = module(context, shaders::PACK);
        let voxels = compute(context, &module, "pack", "voxels", &layout, &[("LIGHTS", f64::from(lights))]);
        Self { layout, voxels }
    }

    pub(super) fn run(
        &self,
        context: &Context,
        timing: &mut Timing,
        stores: &[Store],
        packing: Packing,
        lighting: &Lighting,
        max_weight: f64,
    ) -> Result<Packed> {
        let scale = (FULL / max_weight.max(f64::MIN_POSITIVE)).log2().floor().exp2().min(1e30);
        let [width, height] = packing.size;
        let texture = |label, format, size: [u32; 3], dimension, usage| {
            let [width, height, depth_or_array_layers] = size;
            context.texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers },
                mip_level_count: 1,
                sample_count: 1,
                dimension,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING | usage,
                view_formats: &[],
            })
        };
        let volume = texture(
            "pack.volume",
            wgpu::TextureFormat::Rgba32Uint,
            [width, height, 1],
            wgpu::TextureDimension::D2,
            wgpu::TextureUsages::COPY_DST,
        );
        let occupied = texture(
            "pack.occupied",
            wgpu::TextureFormat::R32Uint,
            packing.dims.map(|n| n.div_ceil(CELL)),
            wgpu::TextureDimension::D3,
            wgpu::TextureUsages::STORAGE_BINDING,
        );
        let [volume_view, occupied_view] =
            [&volume, &occupied].map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
        let lighting = context.upload("pack.lighting", bytemuck::bytes_of(lighting), wgpu::BufferUsages::UNIFORM)?;
        let row_bytes = u64::from(width) * TEXEL;
        let band = (BAND / row_bytes).clamp(1, u64::from(height)) as u32;
        for first_row in (0..height).step_by(band as usize) {
            let row_count = band.min(height - first_row);
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let texels = context.buffer("pack.texels", u64::from(row_count) * row_bytes, usage)?;
            let mut encoder = context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let planes = packing.planes(first_row..first_row + row_count);
            for store in stores {
                let splats = packing.splats(store, &planes);
                if splats.is_empty() {
                    continue;
                }
                let parameters = Pack {
                    low: unordered(packing.axes, packing.low),
                    first_splat: splats.start,
                    end_splat: splats.end,
                    axes: packing.axes.map(|axis| axis as u32),
                    rows: packing.dims[1],
                    columns: packing.columns,
                    row_texels: packing.row_texels,
                    width,
                    first_row,
                    row_count,
                    scale: scale as f32,
                    _pad: 0,
                };
                let parameters =
                    context.upload("pack.parameters", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
                let resources = [
                    parameters.as_entire_binding(),
                    lighting.as_entire_binding(),
                    store.splats.as_entire_binding(),
                    store.origins.as_entire_binding(),
                    texels.as_entire_binding(),
                    wgpu::BindingResource::TextureView(&occupied_view),
                ];
                let group = bind(context, "pack", &self.layout, &resources);
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: Some("pack"),
                    timestamp_writes: timing.compute(context, "pack"),
                });
                pass.set_pipeline(&self.voxels);
                pass.set_bind_group(0, &group, &[]);
                let (x, y) = context.workgroups(splats.len() as u64, WORKGROUP);
                pass.dispatch_workgroups(x, y, 1);
            }
            encoder.copy_buffer_to_texture(
                wgpu::TexelCopyBufferInfo {
                    buffer: &texels,
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: 0,
                        bytes_per_row: Some(row_bytes as u32),
                        rows_per_image: None,
                    },
                },
                wgpu::TexelCopyTextureInfo {
                    origin: wgpu::Origin3d { x: 0, y: first_row, z: 0 },
                    ..volume.as_image_copy()
                },
                wgpu::Extent3d { width, height: row_count, depth_or_array_layers: 1 },
            );
            context.queue.submit([encoder.finish()]);
            // One band at a time in memory.
            context.wait("packing the volume")?;
        }
        let cells: u64 = packing.dims.iter().map(|&n| u64::from(n.div_ceil(CELL))).product();
        Ok(Packed {
            packing,
            volume: volume_view,
            occupied: occupied_view,
            scale,
            bytes: u64::from(height) * row_bytes + cells * 4,
        })
    }
}

/// What is given along a, b and m, along the axes of the lattice.
fn unordered(axes: [usize; 3], values: [u32; 3]) -> [u32; 3] {
    let mut result = [0; 3];
    for (axis, value) in axes.into_iter().zip(values) {
        result[axis] = value;
    }
    result
}
