//! pack: from the splats of a scene to the texture that rays read, on the device or by its twin on the host. See
//! shaders/common/packing.wgsl and shaders/pack.wgsl.

use std::ops::Range;

use bytemuck::{Pod as Words, Zeroable};
use rayon::prelude::*;

use super::super::context::Context;
use super::super::layout::{Lighting, MACROCELL, MARGIN, Pack};
use super::super::pipeline::{Binding, bind, compute, flag, layout, module, texture_view};
use super::super::recorder::Recorder;
use super::super::scan::WORKGROUP;
use super::super::shaders;
use super::super::splat::{self, LANES};
use super::super::store::{BrickSplats, HostBrick, Row, Store};
use super::axis::unordered;
use crate::error::Result;
use crate::memory::reserved;
use crate::volume::BRICK_EDGE as EDGE;

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
/// The same on the host, where such a buffer stays in the caches.
const HOST_BAND: u64 = 4 << 20;
/// The most bytes of a packed volume. The box around visible voxels is packed whole, so that much may be empty.
const MAX_BYTES: u64 = 4 << 30;
/// The largest density after scaling: a power of two with room below 65504, the largest f16.
const F16_HEADROOM: f64 = 16_384.0;
/// The largest factor that densities are scaled by, a power of two: products with it stay in the range of f32.
const MAX_SCALE: f64 = (1_u128 << 100) as f64;

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
    /// The packing of the box around the bricks of splats that are `seen`, or if `whole`, of the lattice of `dims`
    /// points; `None` if it does not fit into a texture.
    pub(super) fn new(
        context: &Context,
        stores: &[Store],
        dims: [u32; 3],
        whole: bool,
        seen: impl Fn([[u32; 3]; 2]) -> bool,
        axes: [usize; 3],
        voxel: Voxel,
    ) -> Option<Self> {
        let boxes = stores.iter().flat_map(Store::runs).map(|(brick, _)| brick.bounds).filter(|&bounds| seen(bounds));
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

    /// Whether there is no voxel in the box.
    pub(super) fn is_empty(&self) -> bool {
        self.dims.contains(&0)
    }

    /// Whether so many splats are packed faster on the host. A software adapter is the host: there the device takes
    /// about 55 ns for each splat, the way to it included, and the host 2 ns for each byte of the texture, all of which
    /// it sends.
    pub(super) fn is_for_host(&self, context: &Context, splats: u64) -> bool {
        const BYTES: u64 = 28;
        let [width, height] = self.size.map(u64::from);
        context.info.is_software() && BYTES * splats > width * height * self.voxel.texel()
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
    /// [`Store::id`] of the first store that it was made from.
    pub(super) source: Option<u64>,
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

/// What packs.
pub(super) enum Packer {
    Device {
        layout: wgpu::BindGroupLayout,
        voxels: wgpu::ComputePipeline,
    },
    /// The twin on the host, and whether rays go through one eye.
    Host {
        perspective: bool,
    },
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
    pub(super) fn new(context: &Context, voxel: Voxel, perspective: bool, on_host: bool) -> Self {
        if on_host { Self::Host { perspective } } else { Self::on_device(context, voxel, perspective) }
    }

    pub(super) fn on_device(context: &Context, voxel: Voxel, perspective: bool) -> Self {
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
        Self::Device { layout: pack, voxels }
    }

    /// Packs the splats of stores, whose largest weight is `max_weight`; into the textures of `over`, the same splats
    /// packed alike but for their light, if that is given.
    pub(super) fn run(
        &self,
        recorder: &mut Recorder<'_>,
        stores: &[Store],
        packing: Packing,
        lit: &Lit<'_>,
        max_weight: f64,
        over: Option<Packed>,
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
            across: packing.dims[0],
            eye: lit.eye,
            view_x,
            view_y,
            view_z,
            ..Pack::zeroed()
        };
        let context = recorder.context;
        let [volume, occupied] = match over {
            Some(Packed { volume, occupied, .. }) => [volume, occupied].map(|view| view.texture().clone()),
            None => packing.textures(context),
        };
        match self {
            Self::Device { layout, voxels } => {
                let lighting = lit.lighting;
                let stage = DeviceStage { layout, voxels, stores, packing: &packing, lighting };
                stage.run(recorder, parameters, &volume, &occupied)?;
            }
            &Self::Host { perspective } => {
                let stage = HostStage { packing: &packing, lit, perspective, parameters: &parameters };
                recorder.on_host("pack", |recorder| stage.run(recorder, stores, &volume, &occupied))?;
            }
        }
        let [volume, occupied] =
            [volume, occupied].map(|texture| texture.create_view(&wgpu::TextureViewDescriptor::default()));
        let [width, height] = packing.size.map(u64::from);
        let macrocells: u64 = packing.macrocells().into_iter().map(u64::from).product();
        Ok(Packed {
            packing,
            source: stores.first().map(|store| store.id),
            volume,
            occupied,
            scale,
            bytes: width * height * packing.voxel.texel() + macrocells * 4,
        })
    }
}

/// A run of the stage on the device.
struct DeviceStage<'a> {
    layout: &'a wgpu::BindGroupLayout,
    voxels: &'a wgpu::ComputePipeline,
    stores: &'a [Store],
    packing: &'a Packing,
    lighting: &'a Lighting,
}

impl DeviceStage<'_> {
    /// Makes the texture of splats, and that of the macrocells which have any.
    fn run(
        &self,
        recorder: &mut Recorder<'_>,
        common: Pack,
        volume: &wgpu::Texture,
        occupied: &wgpu::Texture,
    ) -> Result<()> {
        let Self { packing, stores, .. } = self;
        let context = recorder.context;
        let uniform = wgpu::BufferUsages::UNIFORM;
        let [width, height] = packing.size;
        let occupied = occupied.create_view(&wgpu::TextureViewDescriptor::default());
        let lighting = context.upload("pack.lighting", bytemuck::bytes_of(self.lighting), uniform)?;
        let row_bytes = u64::from(width) * packing.voxel.texel();
        let band = (BAND / row_bytes).clamp(1, u64::from(height)) as u32;
        for first_row in (0..height).step_by(band as usize) {
            let row_count = band.min(height - first_row);
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let texels = context.buffer("pack.texels", u64::from(row_count) * row_bytes, usage)?;
            let planes = packing.planes(first_row..first_row + row_count);
            for store in *stores {
                let splats = packing.splats(store, &planes);
                if splats.is_empty() {
                    continue;
                }
                let parameters =
                    Pack { first_splat: splats.start, end_splat: splats.end, first_row, row_count, ..common };
                let parameters = context.upload("pack.parameters", bytemuck::bytes_of(&parameters), uniform)?;
                let buffer = store.on_device(context)?;
                let resources = [
                    parameters.as_entire_binding(),
                    lighting.as_entire_binding(),
                    buffer.as_entire_binding(),
                    store.origins.as_entire_binding(),
                    texels.as_entire_binding(),
                    texture_view(&occupied),
                ];
                let group = bind(context, "pack", self.layout, &resources);
                let (x, y) = context.workgroups(splats.len() as u64, WORKGROUP);
                recorder.dispatch("pack", self.voxels, &group, &[], [x, y, 1]);
            }
            recorder.copy_rows(&texels, row_bytes, volume, first_row, [width, row_count]);
            recorder.submit();
            // One band at a time in memory.
            context.wait("packing the volume")?;
        }
        Ok(())
    }
}

/// Rows of the texture that a thread packs at a time. It reads up to so many neighbours along a row of the lattice, so
/// that cache lines are read once.
const ROWS: usize = 16;

/// The stage on the host.
struct HostStage<'a> {
    packing: &'a Packing,
    lit: &'a Lit<'a>,
    perspective: bool,
    parameters: &'a Pack,
}

/// Splats of a row of a brick.
struct Run<'a> {
    /// Lattice points: along x, of each splat; beyond the last any.
    xs: [u32; LANES],
    y: u32,
    z: u32,
    /// Words of a splat without its place, and those of the splats and of some that follow.
    each: usize,
    words: &'a [u32],
}

impl Run<'_> {
    /// Word number `index` of each splat; 0 beyond the last.
    fn column(&self, index: usize) -> [u32; LANES] {
        let mut column = [0; LANES];
        for (place, words) in column.iter_mut().zip(self.words.chunks_exact(self.each)) {
            *place = words[index];
        }
        column
    }
}

/// A brick with its splats.
type Held<'a> = (BrickSplats, &'a HostBrick);

impl HostStage<'_> {
    fn run(
        &self,
        recorder: &mut Recorder<'_>,
        stores: &[Store],
        volume: &wgpu::Texture,
        occupied: &wgpu::Texture,
    ) -> Result<()> {
        let context = recorder.context;
        let held = stores.iter().map(|store| store.on_host(context)).collect::<Result<Vec<_>>>()?;
        let bricks = stores.iter().zip(&held).flat_map(|(store, held)| store.bricks.iter().copied().zip(held.iter()));
        let bricks: Vec<Held<'_>> = bricks.collect();
        let marks = self.packing.marks(&bricks)?;
        context.write_texels(occupied, [0; 3], bytemuck::cast_slice(&marks), self.packing.macrocells());
        let Pack { scale, .. } = *self.parameters;
        match self.packing.voxel {
            Voxel::Scalar => self.fill(recorder, volume, &bricks, |run| run.column(0)),
            Voxel::Gradient => self.fill(recorder, volume, &bricks, |run| {
                let scalars = run.column(0).map(|bits| f32::from_bits(bits) * scale);
                let mut gradients = [[0.0; LANES]; 3];
                let (low, high) = (run.column(1), run.column(2));
                for i in 0..LANES {
                    let gradient = splat::gradient([low[i], high[i]]);
                    (0..3).for_each(|axis| gradients[axis][i] = gradient[axis] * scale);
                }
                splat::halves(&gradients, &scalars)
            }),
            Voxel::Color { lights } => self.fill(recorder, volume, &bricks, |run| {
                let (mut colors, densities) = splat::appearances(&run.column(0), &run.column(1));
                if lights > 0 {
                    splat::light(self.lit.lighting, lights, &mut colors, &run.column(2), &self.to_eye(run));
                }
                let weights = densities.map(|density| density * scale);
                for color in &mut colors {
                    color.iter_mut().zip(weights).for_each(|(c, weight)| *c *= weight);
                }
                splat::halves(&colors, &weights)
            }),
        }
    }

    /// The directions from lattice points to the eye, in view coordinates.
    fn to_eye(&self, run: &Run<'_>) -> [[f32; LANES]; 3] {
        if !self.perspective {
            return [[0.0; LANES], [0.0; LANES], [-1.0; LANES]];
        }
        let Lit { eye, view: [x, y, z], .. } = *self.lit;
        let (oy, oz) = (run.y as f32 - eye[1], run.z as f32 - eye[2]);
        splat::directions(&run.xs, x, [0, 1, 2].map(|i| y[i] * oy + z[i] * oz - x[i] * eye[0]))
    }

    /// Fills the texture with what `packed` makes of splats.
    fn fill<V: Words + Send + Sync>(
        &self,
        recorder: &mut Recorder<'_>,
        volume: &wgpu::Texture,
        bricks: &[Held<'_>],
        packed: impl Fn(&Run<'_>) -> [V; LANES] + Sync,
    ) -> Result<()> {
        let context = recorder.context;
        let [width, height] = self.packing.size;
        let row = 2 * width as usize;
        let most = (HOST_BAND as usize / (row * size_of::<V>())).next_multiple_of(ROWS).min(height as usize);
        let mut band = reserved((most * row) as u64, || "a packed volume".to_owned())?;
        band.resize(most * row, V::zeroed());
        for first in (0..height as usize).step_by(most) {
            let rows = first..(first + most).min(height as usize);
            let planes = self.packing.planes(rows.start as u32..rows.end as u32);
            let (low, axis) = (self.packing.low[2], self.packing.axes[2]);
            let near = |(brick, _): &Held<'_>| {
                brick.bounds[0][axis] < low + planes.end && brick.bounds[1][axis] > low + planes.start
            };
            let near: Vec<Held<'_>> = bricks.iter().copied().filter(near).collect();
            let band = &mut band[..rows.len() * row];
            band.par_chunks_mut(ROWS * row).enumerate().for_each(|(index, voxels)| {
                voxels.fill(V::zeroed());
                self.packing.fill_rows(first + index * ROWS, voxels, &near, &packed);
            });
            // One band at a time on its way, while the next one is filled.
            context.wait("packing the volume")?;
            let size = [width, rows.len() as u32, 1];
            context.write_texels(volume, [0, first as u32, 0], bytemuck::cast_slice(band), size);
            recorder.submit();
        }
        Ok(())
    }
}

/// The part of a brick that is in a box of the lattice.
struct Part {
    /// Bits of the places in a row.
    xs: u32,
    ys: Range<u32>,
    zs: Range<u32>,
}

impl Part {
    /// The part from one lattice point to before another, if any.
    fn new(brick: &BrickSplats, from: [u32; 3], to: [u32; 3]) -> Option<Self> {
        let [low, high] = brick.bounds;
        let [xs, ys, zs] = [0, 1, 2].map(|axis| low[axis].max(from[axis])..high[axis].min(to[axis]));
        let x0 = brick.origin[0];
        let bits = || u32::MAX << (xs.start - x0) & u32::MAX >> (u32::BITS - (xs.end - x0));
        (!xs.is_empty() && !ys.is_empty() && !zs.is_empty()).then(|| Self { xs: bits(), ys, zs })
    }
}

impl Packing {
    /// Macrocells along a, b and m.
    fn macrocells(&self) -> [u32; 3] {
        self.dims.map(|n| n.div_ceil(MACROCELL))
    }

    /// The textures of the voxels and of the macrocells. Shaders read both as storage, or write them, and buffers are
    /// copied to them.
    fn textures(&self, context: &Context) -> [wgpu::Texture; 2] {
        let usage =
            wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let texture = |label, format, size, dimension| context.texture(label, format, size, dimension, usage);
        let [width, height] = self.size;
        [
            texture("pack.volume", self.voxel.format(), [width, height, 1], wgpu::TextureDimension::D2),
            texture("pack.occupied", wgpu::TextureFormat::R32Uint, self.macrocells(), wgpu::TextureDimension::D3),
        ]
    }

    /// A mark for each macrocell with splats.
    fn marks(&self, bricks: &[Held<'_>]) -> Result<Vec<u32>> {
        let [na, nb, nm] = self.macrocells();
        let count = u64::from(na) * u64::from(nb) * u64::from(nm);
        let mut marks = reserved(count, || "the macrocells of a volume".to_owned())?;
        marks.resize(count as usize, 0_u32);
        let low = unordered(self.axes, self.low);
        let [step_x, step_y, step_z] = unordered(self.axes, [1, na, na * nb]);
        let ends = unordered(self.axes, [0, 1, 2].map(|i| self.low[i] + self.dims[i]));
        for (brick, held) in bricks {
            let Some(Part { xs: mask, ys, zs }) = Part::new(brick, low, ends) else { continue };
            let [x0, y0, z0] = brick.origin;
            for (z, y) in zs.flat_map(|z| ys.clone().map(move |y| (z, y))) {
                let mut bits = held.rows[(y - y0) as usize + EDGE * (z - z0) as usize].bits & mask;
                let line = (y - low[1]) / MACROCELL * step_y + (z - low[2]) / MACROCELL * step_z;
                while bits != 0 {
                    let x = x0 + bits.trailing_zeros() - low[0];
                    marks[(line + x / MACROCELL * step_x) as usize] = 1;
                    // On to the next one that is in another macrocell.
                    let rest = MACROCELL - x % MACROCELL + bits.trailing_zeros();
                    bits &= u32::MAX.checked_shl(rest).unwrap_or(0);
                }
            }
        }
        Ok(marks)
    }

    /// Fills rows of the texture, from row `first` on, all zeros so far.
    fn fill_rows<V: Copy>(
        &self,
        first: usize,
        voxels: &mut [V],
        bricks: &[Held<'_>],
        packed: &impl Fn(&Run<'_>) -> [V; LANES],
    ) {
        let [across, down, deep] = self.dims.map(|n| n as usize);
        let row = 2 * self.size[0] as usize;
        let column = 2 * (self.row_texels + MARGIN) as usize;
        let (columns, shelf) = (self.columns as usize, down + 1);
        let end = first + voxels.len() / row;
        // The rows may belong to several shelves.
        for number in first / shelf..end.div_ceil(shelf) {
            let top = number * shelf + 1;
            let (b_low, b_high) = (first.saturating_sub(top).min(down), end.saturating_sub(top).min(down));
            let (m_low, m_high) = (number * columns, ((number + 1) * columns).min(deep));
            if b_low >= b_high || m_low >= m_high {
                continue;
            }
            // The box of the lattice that they show, and how far apart neighbours along its axes are.
            let low = unordered(self.axes, [0, b_low, m_low].map(|n| n as u32));
            let high = unordered(self.axes, [across, b_high, m_high].map(|n| n as u32));
            let steps = unordered(self.axes, [1, row as u32, column as u32]).map(|n| n as usize);
            let start = (top + b_low - first) * row + 2 * MARGIN as usize;
            let corner = unordered(self.axes, self.low);
            for (brick, held) in bricks {
                let [from, to] = [low, high].map(|end| [0, 1, 2].map(|axis| end[axis] + corner[axis]));
                let Some(Part { xs: mask, ys, zs }) = Part::new(brick, from, to) else { continue };
                let [x0, y0, z0] = brick.origin;
                for z in zs {
                    for y in ys.clone() {
                        let Row { bits, first } = held.rows[(y - y0) as usize + EDGE * (z - z0) as usize];
                        let mut rest = bits & mask;
                        if rest == 0 {
                            continue;
                        }
                        let before = (bits & ((1 << rest.trailing_zeros()) - 1)).count_ones();
                        let words = &held.words[(first + before) as usize * held.each..];
                        let at = |axis: usize, place: u32| (place - low[axis] - corner[axis]) as usize * steps[axis];
                        let line = start + at(1, y) + at(2, z);
                        for words in words.chunks(held.each * LANES) {
                            let mut run = Run { xs: [x0; LANES], y, z, each: held.each, words };
                            let mut count = 0;
                            while rest != 0 && count < LANES {
                                run.xs[count] = x0 + rest.trailing_zeros();
                                rest &= rest - 1;
                                count += 1;
                            }
                            for (x, voxel) in run.xs.into_iter().zip(packed(&run)).take(count) {
                                voxels[line + at(0, x)] = voxel;
                            }
                            if rest == 0 {
                                break;
                            }
                        }
                    }
                }
            }
        }
    }
}
