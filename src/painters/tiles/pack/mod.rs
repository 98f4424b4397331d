//! pack: from the voxels of a scene to the texture that rays read. See shaders/common/packing.wgsl.

mod device;
mod pages;

pub(super) use pages::occupied;

use std::sync::Arc;

use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::MACROCELL;
use crate::gpu::pipeline::Binding::{self, Read, Uniform, Write};
use crate::gpu::recorder::Recorder;
use crate::gpu::sampled_scalars::{SampledScalars, ScalarsKey};
use crate::gpu::shaders;
use crate::gpu::splat::SplatLight;
use crate::gpu::stage::{Constant, Stage};
use crate::gpu::voxels::{Voxels, VoxelsKey};
use crate::painters::painter::Job;
use crate::painters::tiles::axis::unordered;
use crate::splats::brick::{BrickSplats, PAGE};

/// The data that a packed voxel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(super) enum Voxel {
    /// Colour and density of classified voxels. The colours are lit already, by this number of lights, with or without
    /// shadows.
    Color { lights: u32, shadows: bool },
    /// The scalar of a voxel.
    #[default]
    Scalar,
    /// The scalar of a voxel, and its gradient.
    Gradient,
}

impl Voxel {
    /// Returns the bytes of a voxel.
    fn bytes(self) -> u64 {
        if self == Self::Scalar { 4 } else { 8 }
    }

    /// Returns whether a voxel's colour depends on light.
    pub(super) fn is_lit(self) -> bool {
        matches!(self, Self::Color { lights: 1.., .. })
    }

    /// Returns the binding of the texture that rays read.
    pub(super) fn binding(self) -> Binding {
        Binding::IntegerTexture(wgpu::TextureViewDimension::D3)
    }

    /// Returns the format of the texture that rays read.
    pub(super) fn format(self) -> wgpu::TextureFormat {
        if self == Self::Scalar { wgpu::TextureFormat::R32Uint } else { wgpu::TextureFormat::Rg32Uint }
    }
}

/// The layout of voxels in the texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum TextureLayout {
    /// A texel for each voxel of the box in a texture of three dimensions. Rays along every axis read the same texture,
    /// and the stage stores in it voxel by voxel: on a GPU a copy of a gigabyte from a buffer to a texture takes 25 ms,
    /// its allocation 60 ms, and all rays of a frame 2 to 7 ms (measured; docs/measurements/2026-11-25-gpu.md).
    Box,
    /// The pages with splats of a box: see [`pages`]. For large boxes that are nearly empty.
    Pages,
}

/// The largest number of bytes of a packed volume. The box around visible voxels is packed whole; much of it may be
/// empty.
const MAX_BYTES: u64 = 4 << 30;
/// The largest number of macrocells along an axis of which a workgroup keeps the marks: `marked` in shaders/skip.wgsl.
const MARKED: u32 = 2048;
/// The largest ratio of the bytes of a packed volume to the bytes of the voxels that a picture needs: it serves other
/// pictures too.
pub(super) const MOST_UNSEEN: u64 = 2;
/// The number of macrocells before the first lattice point: more than splats reach.
const BEFORE: u32 = 4;
/// The largest density after scaling: a power of two with room below 65504, the largest f16.
const F16_HEADROOM: f64 = 16_384.0;
/// The largest factor that densities are scaled by, a power of two: products with it stay in the range of f32.
const MAX_SCALE: f64 = (1_u128 << 100) as f64;

/// The rule by which splats mark macrocells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Marking {
    /// The number of voxels along each axis within which a splat marks macrocells.
    pub(super) reach: u32,
    /// The least and the largest scalar that mark nothing; none if the first is larger.
    pub(super) invisible: [f32; 2],
    /// The number of voxels along each axis from the first voxel of a macrocell of the whole lattice to the first
    /// lattice point, less than a macrocell.
    pub(super) offset: [u32; 3],
}

impl Marking {
    /// The rule that a splat marks its own macrocell only.
    pub(super) const OWN: Self = Self { reach: 0, invisible: [f32::MAX, f32::MIN], offset: [0; 3] };
}

/// The places of the voxels of a volume in the texture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Packing {
    pub(super) voxel: Voxel,
    pub(super) layout: TextureLayout,
    /// The numbers of the lattice axes a, b and m.
    pub(super) axes: [usize; 3],
    /// The first lattice point of the box along a, b and m.
    pub(super) low: [u32; 3],
    /// The number of lattice points of the box along a, b and m.
    pub(super) dims: [u32; 3],
    /// The number of pages along each axis of the texture, x, y and z; 0 for other layouts.
    pub(super) atlas: [u32; 3],
    pub(super) marking: Marking,
}

impl Packing {
    /// Returns the packing of the hull of these boxes of splats, or if `whole`, of the lattice of this many points;
    /// `None` if it does not fit into a texture, or its marks or its table of pages into a binding. `pages` is the
    /// number of pages that have splats; `None`: the box is packed as a whole.
    pub(super) fn new(
        context: &Context,
        boxes: impl Iterator<Item = [[u32; 3]; 2]>,
        (lattice, whole): ([u32; 3], bool),
        pages: Option<u64>,
        axes: [usize; 3],
        (voxel, marking): (Voxel, Marking),
    ) -> Option<Self> {
        let (low, high) = boxes.fold(([u32::MAX; 3], [0; 3]), |hull, next| {
            let ends = |i: usize| (hull.0[i].min(next[0][i]), hull.1[i].max(next[1][i]));
            let ends = [0, 1, 2].map(ends);
            (ends.map(|(low, _)| low), ends.map(|(_, high)| high))
        });
        let low = low.map(|n| if n == u32::MAX { 0 } else { n });
        // In whole macrocells of the lattice, which are pages.
        let (low, high) = (low.map(|n| n / MACROCELL * MACROCELL), high.map(|n| n.next_multiple_of(MACROCELL)));
        let (low, high) = if whole { ([0; 3], lattice) } else { (low, high) };
        let low = axes.map(|axis| low[axis]);
        let dims: [u32; 3] = std::array::from_fn(|i| high[axes[i]].saturating_sub(low[i]));
        let packing = Self { voxel, layout: TextureLayout::Box, axes, low, dims, atlas: [0; 3], marking };
        let paged = |count| Self { layout: TextureLayout::Pages, atlas: pages::atlas(count), ..packing };
        let in_pages = pages.filter(|_| !whole).map(paged);
        let deep = context.limits.max_texture_dimension_3d;
        let is_texture = packing.box_texels().iter().all(|&n| n <= deep);
        let saves = |of: &Self| !is_texture || pages::are_worth_it(context, of.voxel_bytes(), packing.voxel_bytes());
        let packing = in_pages.filter(saves).unwrap_or(packing);
        let fits = (is_texture || packing.layout == TextureLayout::Pages)
            && packing.atlas.iter().all(|&n| n <= deep / PAGE)
            && packing.macrocells().iter().all(|&n| n <= deep.min(MARKED))
            && packing.mark_bytes().max(packing.table_bytes()) <= context.largest_buffer();
        (fits && packing.voxel_bytes() <= MAX_BYTES).then_some(packing)
    }

    /// Returns the packing of the voxels in memory: along the axes of the lattice, for rays along every axis.
    pub(super) fn stored(self) -> Self {
        let [low, dims] = [self.low, self.dims].map(|values| unordered(self.axes, values));
        Self { axes: [0, 1, 2], low, dims, ..self }
    }

    /// Returns the steps along a, b and m in a box of voxels.
    pub(super) fn steps(&self) -> [[i32; 3]; 3] {
        self.axes.map(|axis| [0, 1, 2].map(|along| i32::from(along == axis)))
    }

    /// Returns whether the textures are alike, whichever scalars mark macrocells.
    fn is_in_box_of(&self, other: &Self) -> bool {
        let marking = Marking { invisible: other.marking.invisible, ..self.marking };
        Self { marking, ..*self } == *other
    }

    /// Returns the packing of these voxels in the box of another packing, if that has room for them and is not much
    /// larger.
    pub(super) fn in_box_of(&self, other: &Self) -> Option<Self> {
        let [low, dims] = [other.low, other.dims].map(|values| self.axes.map(|axis| values[axis]));
        let is_box = self.layout == TextureLayout::Box;
        let has_room =
            is_box && (0..3).all(|i| low[i] <= self.low[i] && self.low[i] + self.dims[i] <= low[i] + dims[i]);
        let moved = Self { low, dims, ..*self };
        let fits = has_room && moved.stored().is_in_box_of(other) && moved.bytes() <= MOST_UNSEEN * self.bytes();
        fits.then_some(moved)
    }

    /// Returns whether the box has no voxel.
    pub(super) fn is_empty(&self) -> bool {
        self.dims.contains(&0)
    }

    /// Returns the bytes of the texture of voxels.
    fn voxel_bytes(&self) -> u64 {
        match self.layout {
            TextureLayout::Box => self.box_texels().map(u64::from).into_iter().product::<u64>() * self.voxel.bytes(),
            TextureLayout::Pages => {
                let texels: u64 = self.atlas.map(|n| u64::from(n * PAGE)).into_iter().product();
                texels * self.voxel.bytes() + self.table_bytes()
            }
        }
    }

    /// Returns the numbers of texels of a box along a, b and m: a layer of zeros lies behind the voxels of each axis.
    fn box_texels(&self) -> [u32; 3] {
        self.dims.map(|n| n + 1)
    }

    /// Returns the bytes of the textures of voxels and of macrocells.
    pub(super) fn bytes(&self) -> u64 {
        self.voxel_bytes() + self.mark_bytes()
    }

    /// Returns the macrocells that splats may mark: the first along a, b and m, and their numbers. They are numbered
    /// from [`BEFORE`] before the one with the first lattice point.
    fn marked(&self) -> [[u32; 3]; 2] {
        let Marking { reach, offset, .. } = self.marking;
        let place = |i: usize, place: u32| place + offset[self.axes[i]] + BEFORE * MACROCELL;
        let low = [0, 1, 2].map(|i| (place(i, self.low[i]) - reach) / MACROCELL);
        // At least two along each axis: `slab_count` of shaders/skip.wgsl counts layers by the words of their marks.
        let count = |i: usize| ((place(i, self.low[i] + self.dims[i]) + reach).div_ceil(MACROCELL) - low[i]).max(2);
        [low, [0, 1, 2].map(count)]
    }

    /// Returns the number of macrocells along a, b and m.
    pub(super) fn macrocells(&self) -> [u32; 3] {
        self.marked()[1]
    }

    /// Returns the steps, in macrocells of the buffer of marks, along a, b and m.
    pub(super) fn mark_steps(&self) -> [u32; 3] {
        let [nx, ny, _] = unordered(self.axes, self.macrocells());
        self.axes.map(|axis| [1, nx, nx * ny][axis])
    }

    /// Returns the bits of the place along a, b and m in the number of a cell.
    pub(super) fn mark_bits(&self) -> [u32; 3] {
        self.axes.map(|axis| 1 << axis)
    }

    /// Returns the bytes of the buffer of marks.
    fn mark_bytes(&self) -> u64 {
        self.macrocells().into_iter().map(u64::from).product::<u64>().next_multiple_of(4)
    }

    /// Returns the number of voxels along a, b and m from the first voxel of the first macrocell to the first voxel of
    /// the box.
    pub(super) fn mark_shift(&self) -> [u32; 3] {
        let [low, _] = self.marked();
        let place = |i: usize| self.low[i] + self.marking.offset[self.axes[i]] + BEFORE * MACROCELL;
        [0, 1, 2].map(|i| place(i) - MACROCELL * low[i])
    }

    /// Allocates the texture of the voxels and the buffer of marks.
    fn targets(&self, context: &Context) -> Result<(wgpu::Texture, wgpu::Buffer)> {
        let usage = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING;
        let size = match self.layout {
            TextureLayout::Box => self.box_texels(),
            TextureLayout::Pages => self.atlas.map(|n| n * PAGE),
        };
        let volume = context.texture("pack.volume", self.voxel.format(), size, wgpu::TextureDimension::D3, usage);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        Ok((volume, context.buffer("pack.marks", self.mark_bytes(), usage)?))
    }
}

/// The voxels that a picture packs.
pub(super) enum Packable {
    /// Visible voxels, which are classified on the way if they are samples.
    Voxels(Arc<Voxels>),
    /// Scalars, and the number that distinguishes them from others.
    Scalars(Arc<SampledScalars>, u64),
}

/// The form in which the stage that packs voxels reads them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum PackableKey {
    Voxels(VoxelsKey),
    Scalars(ScalarsKey),
}

impl Packable {
    /// Returns the voxels of a picture; `None` if there are none.
    pub(super) fn of(job: &Job<'_>) -> Option<Self> {
        let voxels = job.voxels.map(|voxels| Self::Voxels(Arc::clone(voxels)));
        voxels.or_else(|| job.scalars.map(|(scalars, id)| Self::Scalars(Arc::clone(scalars), *id)))
    }

    pub(super) fn key(&self) -> PackableKey {
        match self {
            Self::Voxels(voxels) => PackableKey::Voxels(voxels.key()),
            Self::Scalars(scalars, _) => PackableKey::Scalars(scalars.key()),
        }
    }

    /// Returns the number that distinguishes the voxels from others.
    fn id(&self) -> u64 {
        match self {
            Self::Voxels(voxels) => voxels.id,
            Self::Scalars(_, id) => *id,
        }
    }

    /// Returns the boxes around the splats of bricks, or the box of scalars.
    pub(super) fn boxes(&self) -> impl Iterator<Item = [[u32; 3]; 2]> {
        self.bricks().map(|brick| brick.bounds).chain(self.scalars().map(|scalars| scalars.bounds))
    }

    fn scalars(&self) -> Option<&SampledScalars> {
        if let Self::Scalars(scalars, _) = self { Some(scalars) } else { None }
    }

    /// Returns the bricks with visible voxels.
    fn bricks(&self) -> impl Iterator<Item = &BrickSplats> {
        let voxels = if let Self::Voxels(voxels) = self { Some(voxels) } else { None };
        voxels.into_iter().flat_map(|voxels| voxels.bricks())
    }
}

impl Packed {
    /// Returns the bytes of the volumes that the axes of a picture read, each counted once.
    pub(super) fn bytes_of(packed: &[Arc<Self>]) -> u64 {
        let is_first = |&(i, volume): &(usize, &Arc<Self>)| !packed[..i].iter().any(|other| Arc::ptr_eq(other, volume));
        packed.iter().enumerate().filter(is_first).map(|(_, volume)| volume.bytes).sum()
    }

    /// Returns whether the volume is packed like `packing` of `source`.
    pub(super) fn serves(&self, packing: Packing, source: &Packable) -> bool {
        packing.stored() == self.packing && self.source == source.id()
    }

    /// Returns whether other voxels can be packed over the volume's own: into pages the stage writes the places of
    /// visible voxels only.
    pub(super) fn has_room_for(&self, packing: Packing) -> bool {
        packing.layout == TextureLayout::Box && packing.stored().is_in_box_of(&self.packing)
    }
}

/// A packed volume on the device.
#[derive(Debug)]
pub(crate) struct Packed {
    pub(super) packing: Packing,
    /// The number of the voxels of which the volume is packed.
    source: u64,
    pub(super) volume: wgpu::TextureView,
    /// The marks of macrocells: see shaders/common/packing.wgsl.
    pub(super) marks: wgpu::Buffer,
    /// The places of pages in the texture; empty for a box.
    pub(super) pages: wgpu::Buffer,
    /// The factor that densities, or scalars with gradients, were multiplied by: a power of two.
    pub(super) scale: f64,
    /// The bytes of the volume on the device.
    pub(super) bytes: u64,
    /// The light on the voxels; `None`: their colours do not depend on light.
    pub(super) light: Option<SplatLight>,
}

/// The stages that pack on the device.
pub(super) struct Packer {
    voxels: Stage,
    /// The stage that makes the table of pages; `None`: other layouts have none.
    pages: Option<Stage>,
}

impl Packer {
    pub(super) fn new(
        context: &Context,
        constants: &[Constant],
        (voxel, layout): (Voxel, TextureLayout),
        source: PackableKey,
    ) -> Self {
        let voxels = stage(context, constants, voxel, source);
        Self { voxels, pages: (layout == TextureLayout::Pages).then(|| pages::stage(context)) }
    }
}

/// Makes the stage that packs voxels.
fn stage(context: &Context, constants: &[Constant], voxel: Voxel, key: PackableKey) -> Stage {
    let texels = Binding::StorageTexture(voxel.format(), wgpu::TextureViewDimension::D3);
    let (shader, entry, slots, own) = match key {
        PackableKey::Voxels(key) => {
            let slots = vec![Uniform, Read, Read, Write, texels, Read, Read, Uniform, Uniform, Read, Read, Read];
            (shaders::PACK_SAMPLES, "voxels", slots, key.constants().collect::<Vec<Constant>>())
        }
        PackableKey::Scalars(key) => {
            let shader = match (key.has_cells(), key.has_gradients()) {
                (false, false) => shaders::PACK_SCALAR_SAMPLES,
                (false, true) => shaders::PACK_GRADIENT_SAMPLES,
                (true, false) => shaders::PACK_SCALAR_CELLS,
                (true, true) => shaders::PACK_GRADIENT_CELLS,
            };
            (shader, "texels", vec![Uniform, Read, Uniform, Write, texels], key.constants().to_vec())
        }
    };
    // Those of samples replace those of the picture.
    let others = constants.iter().copied().filter(|(name, _)| own.iter().all(|(of_samples, _)| of_samples != name));
    let constants: Vec<Constant> = others.chain(own.iter().copied()).collect();
    Stage::new(context, shader, ("pack", entry), &slots, &constants)
}

impl Packing {
    /// Packs voxels, whose largest weight is `max_weight`: into a new texture, or into the texture of `over`, which has
    /// room for them.
    pub(super) fn pack(
        self,
        recorder: &mut Recorder<'_>,
        (packer, source): (&Packer, &Packable),
        light: &SplatLight,
        max_weight: f64,
        over: Option<Packed>,
    ) -> Result<Packed> {
        let scale = match self.voxel {
            Voxel::Scalar => 1.0,
            _ => libm::exp2(libm::log2(F16_HEADROOM / max_weight.max(f64::MIN_POSITIVE)).floor()).min(MAX_SCALE),
        };
        // Voxels of others that show nothing now.
        let clears = over.as_ref().is_some_and(|over| over.source != source.id());
        let (volume, marks, pages) = match over {
            Some(Packed { volume, marks, pages, .. }) => (volume.texture().clone(), marks, pages),
            None => {
                let (volume, marks) = self.targets(recorder.context)?;
                let pages = match &packer.pages {
                    Some(stage) => self.page_table(recorder, stage, source)?,
                    None => recorder.context.upload("pack.pages", &[], wgpu::BufferUsages::STORAGE)?,
                };
                (volume, marks, pages)
            }
        };
        let volume = volume.create_view(&wgpu::TextureViewDescriptor::default());
        self.fill(recorder, &packer.voxels, (source, clears), (light, scale as f32), (&volume, &marks, &pages))?;
        Ok(Packed {
            packing: self,
            source: source.id(),
            volume,
            marks,
            pages,
            scale,
            bytes: self.bytes(),
            light: self.voxel.is_lit().then(|| light.clone()),
        })
    }
}
