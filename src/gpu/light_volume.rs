//! light-volume: how much light arrives at each place of a field of scalars, for post-shading (Kniss et al. 2003 call
//! it a light volume; ours is found once, not from each view). On the host, for any adapter: once for a volume, a
//! transfer function and a set of lights.
//!
//! The scalars of voxels, or of cells, are classified as if they were splats of pre-shading, and the sums of
//! `lighting/shadow.rs` say what arrives at each of them that can show. Rays read between them linearly.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use half::f16;
use rayon::prelude::*;

use super::context::Context;
use super::shadows::{PLANES, Shadows, places, rows};
use super::splat;
use super::store::Emitted;
use super::store::{BrickSplats, HostBrick};
use super::transfer::{Reduction, TransferTable};
use crate::error::Result;
use crate::lighting::shadow::{Block, Caster, Medium};
use crate::memory::reserved;
use crate::progress::Progress;
use crate::transfer::TransferFunction;
use crate::volume::{BRICK_EDGE as EDGE, Grid};

/// The most cells of a light volume, 8 bytes each: coarser ones stand for those of larger lattices.
pub(crate) const MAX_CELLS: u64 = 1 << 25;

/// The light that arrives, as a texture.
pub(crate) struct LightVolume {
    pub(crate) texture: wgpu::TextureView,
    pub(crate) sampler: wgpu::Sampler,
    /// From the world to the texture, which reaches from 0 to 1.
    from_world: DAffine3,
    /// What a scene takes for it.
    pub(crate) bytes: u64,
}

/// What a post-shaded picture is classified and lit by.
pub(crate) struct PostShading {
    pub(crate) table: Arc<TransferTable>,
    pub(crate) light: Arc<LightVolume>,
    /// Whether it is; otherwise the light volume is [`LightVolume::none`].
    pub(crate) shadows: bool,
    /// The map to the light volume from the lattice that the picture is drawn of.
    pub(crate) to_light: DAffine3,
}

/// What scalars are classified by.
pub(crate) struct Classification<'a> {
    pub(crate) transfer: &'a TransferFunction,
    pub(crate) reduction: &'a Reduction,
}

impl Classification<'_> {
    /// The density of a splat of a scalar, given its words without the place: extinction times the unit distance.
    fn density(&self, words: &[u32], grid: &Grid) -> f32 {
        let value = self.reduction.value(f32::from_bits(words[0]));
        let (_, opacity) = self.transfer.sample(value);
        let density = TransferFunction::extinction(opacity, 1.0);
        let share = match words {
            &[_, low, high] if density > 0.0 && !self.transfer.gradient_opacity().is_empty() => {
                let gradient = DVec3::from_array(splat::gradient([low, high]).map(f64::from));
                let world = grid.to_lattice().matrix3.transpose() * gradient;
                self.transfer.gradient_share(world.length() / self.reduction.factor())
            }
            _ => 1.0,
        };
        (density * share) as f32
    }
}

impl LightVolume {
    /// What arrives at the places of `grid` that have splats of scalars.
    pub(crate) fn new(
        context: &Context,
        emitted: &Emitted,
        grid: &Grid,
        classification: &Classification<'_>,
        shadows: &Shadows,
        progress: &Progress,
    ) -> Result<Self> {
        let Shadows { casting, lattice, .. } = shadows;
        let held = emitted.stores.iter().map(|store| store.on_host(context)).collect::<Result<Vec<_>>>()?;
        let bricks = emitted.stores.iter().zip(&held).flat_map(|(store, held)| store.bricks.iter().zip(held.iter()));
        let bricks: Vec<(&BrickSplats, &HostBrick)> = bricks.collect();
        let dense = |(brick, held): &(&BrickSplats, &HostBrick)| {
            let found = rows(brick, held).flat_map(|(at, bits, words)| {
                let found = places(bits)
                    .zip(words.chunks_exact(held.each))
                    .map(move |(x, words)| ([at[0] + x, at[1], at[2]], classification.density(words, grid)));
                found.filter(|(point, density)| *density > 0.0 && shadows.casts(*point))
            });
            found.collect::<Vec<_>>()
        };
        let mut medium = Medium::<f32>::new(lattice.dims)?;
        // Some at a time: what they give is in memory twice for a moment.
        for bricks in bricks.chunks(256) {
            let found: Vec<_> = bricks.par_iter().map(dense).collect();
            found.into_iter().flatten().for_each(|(point, density)| medium.set(point, density));
        }
        let bounds = bricks.iter().filter(|(_, held)| held.count() > 0).map(|(brick, _)| brick.bounds);
        let [low, high] = bounds.fold([[u32::MAX; 3], [0; 3]], |[low, high], bounds| {
            [[0, 1, 2].map(|a| low[a].min(bounds[0][a])), [0, 1, 2].map(|a| high[a].max(bounds[1][a]))]
        });
        // Without splats there is a texel all the same.
        let low = [0, 1, 2].map(|axis| if low[axis] < high[axis] { low[axis] } else { 0 });
        let size = [0, 1, 2].map(|axis| high[axis].saturating_sub(low[axis]).max(1));
        let count = size.iter().map(|&n| u64::from(n)).product();
        let mut texels = reserved(count, || "the light in the volume".to_owned())?;
        texels.resize(count as usize, [f16::ONE.to_bits(); 4]);
        let caster = Caster::new(casting, lattice);
        for (number, some) in bricks.chunks(64).enumerate() {
            let shares: Vec<_> = some.par_iter().map(|brick| shares(&caster, &medium, brick)).collect();
            for ([x, y, z], share) in shares.into_iter().flatten() {
                let [x, y, z] = [x - low[0], y - low[1], z - low[2]].map(|p| p as usize);
                texels[x + size[0] as usize * (y + size[1] as usize * z)] = share;
            }
            progress.report("casting shadows", (64 * (number + 1)).min(bricks.len()) as f64 / bricks.len() as f64);
        }
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let (format, dimension) = (wgpu::TextureFormat::Rgba16Float, wgpu::TextureDimension::D3);
        let texture = context.texture("light_volume", format, size, dimension, usage);
        // Plane by plane: a copy of all of it would be in memory twice.
        let plane = (size[0] * size[1]) as usize;
        for (z, texels) in (0..).zip(texels.chunks_exact(plane)) {
            context.write_texels(&texture, [0, 0, z], bytemuck::cast_slice(texels), [size[0], size[1], 1]);
        }
        // The middle of the first texel is half a texel from the edge.
        let shift = DAffine3::from_translation(DVec3::splat(0.5) - DVec3::from_array(low.map(f64::from)));
        let scale = DAffine3::from_scale(DVec3::from_array(size.map(|n| f64::from(n).recip())));
        Ok(Self {
            texture: texture.create_view(&Default::default()),
            sampler: sampler(context),
            from_world: scale * shift * grid.to_lattice(),
            bytes: 8 * count,
        })
    }

    /// The map from a lattice to the texture.
    pub(crate) fn map_from(&self, grid: &Grid) -> DAffine3 {
        self.from_world * grid.to_world()
    }

    /// A texture for stages that need one and do not read it.
    pub(crate) fn none(context: &Context) -> Self {
        let usage = wgpu::TextureUsages::TEXTURE_BINDING;
        let (format, dimension) = (wgpu::TextureFormat::Rgba16Float, wgpu::TextureDimension::D3);
        let texture = context.texture("light_volume", format, [1; 3], dimension, usage);
        let texture = texture.create_view(&Default::default());
        Self { texture, sampler: sampler(context), from_world: DAffine3::IDENTITY, bytes: 0 }
    }
}

fn sampler(context: &Context) -> wgpu::Sampler {
    context.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("light_volume"),
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    })
}

/// What arrives at the splats of a brick.
fn shares(
    caster: &Caster<f32>,
    medium: &Medium<f32>,
    (brick, held): &(&BrickSplats, &HostBrick),
) -> Vec<([u32; 3], [u16; 4])> {
    let bits: Vec<u32> = held.rows.iter().map(|row| row.bits).collect();
    let start = brick.origin.map(|p| p as usize);
    let mut found = Vec::with_capacity(held.count() as usize);
    for (number, wanted) in bits.chunks_exact(EDGE * PLANES).enumerate() {
        if wanted.iter().all(|&bits| bits == 0) {
            continue;
        }
        let block = Block { start: [start[0], start[1], start[2] + PLANES * number], down: EDGE, wanted };
        let at = |row: usize| [block.start[1] + row % EDGE, block.start[2] + row / EDGE].map(|p| p as u32);
        for (row, shares) in caster.shares::<EDGE>(medium, &block).iter().enumerate() {
            let [y, z] = at(row);
            let share = |x: usize| shares.map(|share| f16::from_f64(share[x]).to_bits());
            found.extend(places(wanted[row]).map(|x| ([brick.origin[0] + x as u32, y, z], share(x))));
        }
    }
    found
}
