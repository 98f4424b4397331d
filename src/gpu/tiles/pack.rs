//! pack: from the splats of a scene to the texture that rays read. See shaders/common/packing.wgsl and
//! shaders/pack.wgsl.

use std::ops::Range;

use bytemuck::Zeroable;

use super::super::context::Context;
use super::super::layout::{Lighting, MACROCELL, MARGIN, Pack};
use super::super::pipeline::{Binding, bind, compute, flag, layout, module, texture_view};
use super::super::recorder::Recorder;
use super::super::scan::WORKGROUP;
use super::super::shaders;
use super::super::store::Store;
use super::axis::unordered;
use crate::error::Result;

/// What is packed of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(super) enum Voxel {
    /// Colour and density of classified voxels. The colours are lit already, by this number of lights.
    Color { lights: u32 },
    /// The scalar.
    #[default]
    Scalar,
    /// The scalar and its gradient.
    Gradient,
}

impl Voxel {
    fn is_scalar(self) -> bool {
        matches!(self, Self::Scalar | Self::Gradient)
    }

    /// Bytes of a texel, which holds two voxels.
    fn texel(self) -> u64 {
        if self == Self::Scalar { 8 } else { 16 }
    }

    /// The binding of the texture that rays read.
    pub(super) fn binding(self, software: bool) -> Binding {
        if self == Self::Scalar && !software {
            Binding::IntegerTexture(wgpu::TextureViewDimension::D2)
        } else {
            Binding::ReadTexture(self.format())
        }
    }

    /// Its format.
    pub(super) fn format(self) -> wgpu::TextureFormat {
        if self == Self::Scalar { wgpu::TextureFormat::Rg32Uint } else { wgpu::TextureFormat::Rgba32Uint }
    }
}

/// Bytes of the buffer that is packed and copied to the texture at a time: small beside the volume.
const BAND: u64 = 16 << 20;
/// The most bytes of a packed volume. The box around visible voxels is packed whole, so that much may be empty.
const MAX_BYTES: u64 = 1 << 30;
/// The largest density after scaling: a power of two with room below 65504, the largest f16.
const F16_HEADROOM: f64 = 16_384.0;
/// The largest factor that densities are scaled by: products with it stay in the range of f32.
const MAX_SCALE: f64 = 1e30;

/// Where the voxels of a volume are in the texture: the rows of shaders/common/packing.wgsl.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Packing {
    pub(super) voxel: Voxel,
    /// Numbers of the lattice axes a, b and m.
    pub(super) axes: [usize; 3],
    /// First lattice point of the box along a, b and m.
    pub(super) low: [u32; 3],
    /// Lattice points of the box along a, b and m.
    pub(super) dims: [u32; 3],
    /// Planes side by side.
    pub(super) columns: u32,
    /// Texels of a row of voxels, without its margin.
    pub(super) row_texels: u32,
    /// Width and height of the texture.
    size: [u32; 2],
}

impl Packing {
    /// The packing of the box around the splats, or if `whole`, of the lattice of `dims` points; `None` if it does not
    /// fit into a texture.
    pub(super) fn new(
        context: &Context,
        stores: &[Store],
        dims: [u32; 3],
        whole: bool,
        axes: [usize; 3],
        voxel: Voxel,
    ) -> Option<Self> {
        let boxes = stores.iter().flat_map(Store::runs).map(|(brick, _)| brick.bounds);
        let (low, high) = boxes.fold(([u32::MAX; 3], [0; 3]), |hull, next| {
            let ends = |i: usize| (hull.0[i].min(next[0][i]), hull.1[i].max(next[1][i]));
            let ends = [0, 1, 2].map(ends);
            (ends.map(|(low, _)| low), ends.map(|(_, high)| high))
        });
        let (low, high) = if whole { ([0; 3], dims) } else { (low, high) };
        let low = axes.map(|axis| low[axis]);
        let dims: [u32; 3] = std::array::from_fn(|i| high[axes[i]].saturating_sub(low[i]));
        let [a, b, m] = dims;
        let most = u64::from(context.limits.max_texture_dimension_2d);
        let row_texels = a.div_ceil(2);
        let rows = u64::from(b) + 1;
        // As many planes side by side as make the texture about square.
        let column = u64::from(row_texels + MARGIN);
        let columns = ((f64::from(m) * rows as f64 / column as f64).sqrt().ceil() as u64).clamp(1, u64::from(m.max(1)));
        // A row of a buffer that is copied to a texture begins at a multiple of so many bytes; texels have 8 at least.
        let align = u64::from(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT) / 8;
        let width = (columns * column + u64::from(MARGIN)).next_multiple_of(align);
        let height = u64::from(m).div_ceil(columns) * rows + 1;
        let fits = width <= most && height <= most && width * height * voxel.texel() <= MAX_BYTES;
        let macrocells =
            dims.map(|n| n.div_ceil(MACROCELL)).iter().all(|&n| n <= context.limits.max_texture_dimension_3d);
        (fits && macrocells).then_some(Self {
            voxel,
            axes,
            low,
            dims,
            columns: columns as u32,
            row_texels,
            size: [width as u32, height as u32],
        })
    }

    /// The planes that have voxels in these rows of the texture.
    fn planes(&self, rows: Range<u32>) -> Range<u32> {
        let shelf = self.dims[1] + 1;
        let at = |row: u32| (row / shelf * self.columns).min(self.dims[2]);
        at(rows.start.saturating_sub(1))..at(rows.end.saturating_sub(1) + shelf)
    }

    /// The splats of a store from the first to the last that can be in these planes.
    fn splats(&self, store: &Store, planes: &Range<u32>) -> Range<u32> {
        let (low, axis) = (self.low[2], self.axes[2]);
        let inside = |[first, end]: [u32; 2]| first < low + planes.end && end > low + planes.start;
        let bricks = store.runs().filter(|(brick, _)| inside(brick.bounds.map(|point| point[axis])));
        let runs = bricks.map(|(_, run)| run);
        runs.reduce(|hull, run| hull.start.min(run.start)..hull.end.max(run.end)).unwrap_or(0..0)
    }
}

/// A packed volume on the device.
#[derive(Debug)]
pub(crate) struct Packed {
    pub(super) packing: Packing,
    /// The first buffer of the splats that it was made from, which tells scenes apart.
    pub(super) source: Option<wgpu::Buffer>,
    pub(super) volume: wgpu::TextureView,
    pub(super) occupied: wgpu::TextureView,
    /// The factor that densities, or scalars with gradients, were multiplied by: a power of two.
    pub(super) scale: f64,
    bytes: u64,
}

impl Packed {
    /// Bytes on the device.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// The pipelines.
pub(super) struct Packer {
    layout: wgpu::BindGroupLayout,
    voxels: wgpu::ComputePipeline,
}

/// The light on what is packed.
pub(super) struct Lit<'a> {
    pub(super) lighting: &'a Lighting,
    /// Lattice point of the eye.
    pub(super) eye: [f32; 3],
    /// View coordinates of a step along each axis of the lattice.
    pub(super) view: [[f32; 3]; 3],
}

impl Packer {
    pub(super) fn new(context: &Context, voxel: Voxel, perspective: bool) -> Self {
        let slots = [
            Binding::Uniform,
            Binding::Uniform,
            Binding::Read,
            Binding::Read,
            Binding::Write,
            Binding::StorageTexture(wgpu::TextureFormat::R32Uint, wgpu::TextureViewDimension::D3),
        ];
        let stage = wgpu::ShaderStages::COMPUTE;
        let pack = layout(context, "pack", stage, &slots);
        let lights = if let Voxel::Color { lights } = voxel { lights } else { 0 };
        let constants = [
            ("LIGHTS", f64::from(lights)),
            ("SCALARS", flag(voxel.is_scalar())),
            ("GRADIENTS", flag(voxel == Voxel::Gradient)),
            // The direction to the eye is all that a perspective changes here.
            ("PERSPECTIVE", flag(perspective && lights > 0)),
        ];
        let voxels = compute(context, &module(context, shaders::PACK), "pack", "voxels", &pack, &constants);
        Self { layout: pack, voxels }
    }

    /// Packs the splats of stores, whose largest weight is `max_weight`.
    pub(super) fn run(
        &self,
        recorder: &mut Recorder<'_>,
        stores: &[Store],
        packing: Packing,
        lit: &Lit<'_>,
        max_weight: f64,
    ) -> Result<Packed> {
        let scale = match packing.voxel {
            Voxel::Scalar => 1.0,
            _ => (F16_HEADROOM / max_weight.max(f64::MIN_POSITIVE)).log2().floor().exp2().min(MAX_SCALE),
        };
        let [view_x, view_y, view_z] = lit.view;
        let parameters = Pack {
            low: unordered(packing.axes, packing.low),
            axes: packing.axes.map(|axis| axis as u32),
            rows: packing.dims[1],
            columns: packing.columns,
            row_texels: packing.row_texels,
            width: packing.size[0],
            scale: scale as f32,
            planes: packing.dims[2],
            eye: lit.eye,
            view_x,
            view_y,
            view_z,
            ..Pack::zeroed()
        };
        let (volume, occupied) = self.voxels(recorder, stores, &packing, lit.lighting, parameters)?;
        let [width, height] = packing.size.map(u64::from);
        let macrocells: u64 = packing.dims.iter().map(|&n| u64::from(n.div_ceil(MACROCELL))).product();
        Ok(Packed {
            packing,
            source: stores.first().map(|store| store.splats.clone()),
            volume,
            occupied,
            scale,
            bytes: width * height * packing.voxel.texel() + macrocells * 4,
        })
    }

    /// The texture of splats, and that of the macrocells which have any.
    fn voxels(
        &self,
        recorder: &mut Recorder<'_>,
        stores: &[Store],
        packing: &Packing,
        lighting: &Lighting,
        common: Pack,
    ) -> Result<(wgpu::TextureView, wgpu::TextureView)> {
        let context = recorder.context;
        let uniform = wgpu::BufferUsages::UNIFORM;
        let [width, height] = packing.size;
        let voxel = packing.voxel;
        let volume = storage_texture(context, "pack.volume", voxel.format(), packing.size);
        let occupied = context.texture(
            "pack.occupied",
            wgpu::TextureFormat::R32Uint,
            packing.dims.map(|n| n.div_ceil(MACROCELL)),
            wgpu::TextureDimension::D3,
            wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
        );
        let occupied = occupied.create_view(&wgpu::TextureViewDescriptor::default());
        let lighting = context.upload("pack.lighting", bytemuck::bytes_of(lighting), uniform)?;
        let row_bytes = u64::from(width) * voxel.texel();
        let band = (BAND / row_bytes).clamp(1, u64::from(height)) as u32;
        for first_row in (0..height).step_by(band as usize) {
            let row_count = band.min(height - first_row);
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let texels = context.buffer("pack.texels", u64::from(row_count) * row_bytes, usage)?;
            let planes = packing.planes(first_row..first_row + row_count);
            for store in stores {
                let splats = packing.splats(store, &planes);
                if splats.is_empty() {
                    continue;
                }
                let parameters =
                    Pack { first_splat: splats.start, end_splat: splats.end, first_row, row_count, ..common };
                let parameters = context.upload("pack.parameters", bytemuck::bytes_of(&parameters), uniform)?;
                let resources = [
                    parameters.as_entire_binding(),
                    lighting.as_entire_binding(),
                    store.splats.as_entire_binding(),
                    store.origins.as_entire_binding(),
                    texels.as_entire_binding(),
                    texture_view(&occupied),
                ];
                let group = bind(context, "pack", &self.layout, &resources);
                let (x, y) = context.workgroups(splats.len() as u64, WORKGROUP);
                recorder.dispatch("pack", &self.voxels, &group, &[], [x, y, 1]);
            }
            recorder.copy_rows(&texels, row_bytes, &volume, first_row, [width, row_count]);
            recorder.submit();
            // One band at a time in memory.
            context.wait("packing the volume")?;
        }
        Ok((volume.create_view(&wgpu::TextureViewDescriptor::default()), occupied))
    }
}

/// A texture that shaders read as storage and that buffers are copied to.
fn storage_texture(
    context: &Context,
    label: &str,
    format: wgpu::TextureFormat,
    [width, height]: [u32; 2],
) -> wgpu::Texture {
    let usage =
        wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    context.texture(label, format, [width, height, 1], wgpu::TextureDimension::D2, usage)
}
