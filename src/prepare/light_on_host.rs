//! light-on-host: the light that arrives at listed splats by the sums of `lighting/shadow.rs` on the processor: exact
//! shadows, kernels too narrow for sweeps, and volumes whose light outgrows the device. The device lists the splats,
//! the host reads them, and the light goes back.

use super::shadows::Shadows;
use crate::error::Result;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::layout::BRICK_SHIFT;
use crate::gpu::list::listed;
use crate::gpu::store::Store;
use crate::gpu::voxels::Voxels;
use crate::lighting::MAX_CASTING;
use crate::lighting::shadow::field::CLIPPED;
use crate::lighting::shadow::{Arrival, Reusable};
use crate::progress::Progress;
use crate::splats::brick::bounds_of;
use voxsplat_volume::memory::{reserved, zeroed};

/// The splats of stores, read by the host.
pub(super) struct ListedSplats<'a> {
    stores: &'a [Store],
    /// The words of each store.
    words: Vec<Vec<u32>>,
    /// The first lattice point of the box around the splats, and its size.
    pub(super) bounds: [[usize; 3]; 2],
}

/// The shares of three lights and of ambient light that arrive at a splat, in 1/65535.
pub(super) type Shares = [u16; MAX_CASTING + 1];

impl<'a> ListedSplats<'a> {
    pub(super) fn read(context: &Context, stores: &'a [Store]) -> Result<Self> {
        let words = stores.iter().map(|store| store.words(context)).collect::<Result<_>>()?;
        Ok(Self { stores, words, bounds: bounds_of(stores.iter().flat_map(|store| &store.bricks)) })
    }

    /// Returns the splats of each store: their lattice points, and their words without the place.
    pub(super) fn splats(&self) -> impl Iterator<Item = impl Iterator<Item = ([usize; 3], &[u32])>> {
        self.stores.iter().zip(&self.words).map(|(store, words)| {
            words.chunks_exact(store.stride as usize / 4).map(|splat| {
                let origin = store.bricks[(splat[0] >> BRICK_SHIFT) as usize].origin;
                ([0, 1, 2].map(|axis| (origin[axis] + (splat[0] >> (5 * axis) & 31)) as usize), &splat[1..])
            })
        })
    }

    /// Returns the light that arrives at each splat, store by store. `density` gets the words of a splat without the
    /// place.
    pub(super) fn light(
        &self,
        shadows: &Shadows,
        density: impl Fn(&[u32]) -> f32,
        progress: &Progress,
    ) -> Result<Vec<Vec<Shares>>> {
        let [low, size] = self.bounds;
        let number = |[x, y, z]: [usize; 3]| x - low[0] + size[0] * (y - low[1] + size[1] * (z - low[2]));
        let places = size.iter().map(|&n| n as u64).product();
        let mut field: Vec<f32> = zeroed(places, || "the occluders of light".to_owned())?;
        for (point, words) in self.splats().flatten() {
            field[number(point)] = if shadows.casts(point) { density(words).max(CLIPPED) } else { CLIPPED };
        }
        let reusable = &mut Reusable::default();
        let arrival = Arrival::new(&shadows.casting, &shadows.lattice, self.bounds, reusable, |[y, z], row| {
            let first = number([low[0], y, z]);
            row.copy_from_slice(&field[first..first + row.len()]);
        })?;
        let mut all = Vec::new();
        for store in self.stores {
            let mut shares = reserved(u64::from(store.count), || "the light on splats".to_owned())?;
            shares.resize(store.count as usize, [u16::MAX; MAX_CASTING + 1]);
            all.push(shares);
        }
        for light in 0..=MAX_CASTING {
            let done = |part: f64| (light as f64 + part) / (MAX_CASTING + 1) as f64;
            let arriving = arrival.shares(light, &|part| progress.report("casting shadows", done(part)))?;
            let Some(arriving) = arriving else { continue };
            for (shares, splats) in all.iter_mut().zip(self.splats()) {
                shares.iter_mut().zip(splats).for_each(|(shares, (point, _))| shares[light] = arriving.from(point)(0));
            }
        }
        Ok(all)
    }
}

/// Returns lit voxels with the shares of light that arrive at each.
pub(super) fn shaded(
    (context, pipelines): (&Context, &Cache),
    voxels: &Voxels,
    shadows: &Shadows,
    progress: &Progress,
) -> Result<Voxels> {
    let stores = listed(context, pipelines, voxels)?;
    let listed = ListedSplats::read(context, &stores)?;
    let light = listed.light(shadows, |words| f32::from_bits(words[0] & 0xffff_ff00), progress)?;
    voxels.under_shares(context, &light.concat())
}
