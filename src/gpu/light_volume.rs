//! The texture of the light that arrives at each place of a field of scalars.

use std::sync::Arc;

use glam::{DAffine3, DVec3};

use super::context::Context;
use super::transfer::TransferTable;
use crate::volume::Grid;

/// The light that arrives at each place of a lattice, as a texture.
pub(crate) struct LightVolume {
    pub(crate) texture: wgpu::TextureView,
    pub(crate) sampler: wgpu::Sampler,
    /// The map from the world to the texture, which spans 0 to 1.
    from_world: DAffine3,
    /// The bytes of memory that the light volume takes in a scene.
    pub(crate) bytes: u64,
}

/// The classification and the light of a post-shaded picture.
pub(crate) struct PostShading {
    pub(crate) table: Arc<TransferTable>,
    /// The factor from a local length (see [`Grid::local`]) to a length in the unit of the table's extinctions.
    pub(crate) per_unit: f32,
    /// The scale of gradients in the table: [`TransferTable::gradient_lookup`].
    pub(crate) gradient_lookup: f32,
    pub(crate) light: Arc<LightVolume>,
    /// Whether there are shadows; otherwise the light volume is [`LightVolume::none`].
    pub(crate) shadows: bool,
    /// The map to the light volume from the lattice that the picture is drawn of.
    pub(crate) to_light: DAffine3,
}

impl LightVolume {
    /// Makes the light volume of the places of `grid` from `low` on, `size` places along each axis: half floats for
    /// three lights and ambient light, x fastest.
    pub(crate) fn new(context: &Context, grid: &Grid, low: [u32; 3], size: [u32; 3], texels: &[[u16; 4]]) -> Self {
        let (made, texture) = Self::empty(context, from_world(grid, low, size), size, wgpu::TextureUsages::COPY_DST);
        // Plane by plane: a copy of all of it would be in memory twice.
        let plane = (size[0] * size[1]) as usize;
        for (z, texels) in (0..).zip(texels.chunks_exact(plane)) {
            context.write_texels(&texture, [0, 0, z], bytemuck::cast_slice(texels), [size[0], size[1], 1]);
        }
        made
    }

    /// Makes a light volume of the places of `grid` from `low` on, whose texture a stage writes.
    pub(super) fn stored(context: &Context, grid: &Grid, low: [u32; 3], size: [u32; 3]) -> Self {
        Self::empty(context, from_world(grid, low, size), size, wgpu::TextureUsages::STORAGE_BINDING).0
    }

    /// Makes the texture for stages that bind a light volume but do not read it.
    pub(crate) fn none(context: &Context) -> Self {
        let (made, _) = Self::empty(context, DAffine3::IDENTITY, [1; 3], wgpu::TextureUsages::empty());
        Self { bytes: 0, ..made }
    }

    /// Makes a light volume with an empty texture, which has these usages besides its own.
    fn empty(
        context: &Context,
        from_world: DAffine3,
        size: [u32; 3],
        usage: wgpu::TextureUsages,
    ) -> (Self, wgpu::Texture) {
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | usage;
        let (format, dimension) = (wgpu::TextureFormat::Rgba16Float, wgpu::TextureDimension::D3);
        let texture = context.texture("light_volume", format, size, dimension, usage);
        let sampler = context.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("light_volume"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let bytes = 8 * size.into_iter().map(u64::from).product::<u64>();
        (Self { texture: texture.create_view(&Default::default()), sampler, from_world, bytes }, texture)
    }

    /// Returns the map from a lattice to the texture.
    pub(crate) fn map_from(&self, grid: &Grid) -> DAffine3 {
        self.from_world * grid.to_world()
    }
}

/// Returns the map from the world to the texture of the places of a grid from `low` on.
fn from_world(grid: &Grid, low: [u32; 3], size: [u32; 3]) -> DAffine3 {
    // The middle of the first texel is half a texel from the edge.
    let shift = DAffine3::from_translation(DVec3::splat(0.5) - DVec3::from_array(low.map(f64::from)));
    let scale = DAffine3::from_scale(DVec3::from_array(size.map(|n| f64::from(n).recip())));
    scale * shift * grid.to_lattice()
}
