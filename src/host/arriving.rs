//! The shares of light that arrive at the voxels of a field, under shadows and occlusion.

use std::sync::{Mutex, PoisonError};

use glam::DVec3;
use pulp::Simd;
use rayon::prelude::*;
use voxsplat_volume::memory::reserved;

use super::lanes::{Channels, Lanes, Order, RAYS, twice_four};
use crate::camera::clip::Side;
use crate::error::{Error, Result};
use crate::kernel::Kernel;
use crate::lighting::shadow::incoming::Incoming;
use crate::lighting::shadow::{Arrival, Reusable, ShadowLattice};
use crate::lighting::{Casting, MAX_CASTING};
use crate::progress::Progress;

/// The bytes of shadows for each voxel: its shares, its extinction, and sums of sweeps.
pub(crate) const BYTES: u64 = 20;

/// The light that falls on a field and casts shadows.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Falling {
    pub(super) casting: Casting,
    pub(super) lattice: ShadowLattice,
    /// The sides of unclipped matter; clipped matter casts no shadows.
    pub(super) clip: Vec<Side>,
    /// The kernel of the field near whose visible matter voxels are lit; `None` if all visible voxels are.
    pub(super) near: Option<Kernel>,
}

impl Falling {
    /// Returns the place of a voxel of the scene, from the middle of the lattice.
    pub(super) fn place(&self, voxel: [usize; 3]) -> DVec3 {
        let place = |axis: usize| f64::from(self.lattice.first[axis]) + voxel[axis] as f64;
        DVec3::from_array([0, 1, 2].map(|axis| place(axis) - (self.lattice.dims[axis] as f64 - 1.0) / 2.0))
    }
}

/// A callback that writes the extinctions of a row of a box, given its y and z in the lattice.
type Rows<'a> = dyn Fn([usize; 2], &mut [f32]) -> Result<()> + Sync + 'a;

/// The matter of a scene that casts shadows.
pub(super) struct Casters<'a> {
    /// The first voxel of the box around all visible voxels, and its size.
    pub(super) bounds: [[usize; 3]; 2],
    /// Writes the extinctions of a row of the box: [`CLIPPED`](crate::lighting::shadow::field::CLIPPED) where matter
    /// casts no shadows, 0 where no visible matter is near.
    pub(super) row: Box<Rows<'a>>,
}

impl Casters<'_> {
    /// Returns the light on them.
    pub(super) fn arrival(&self, falling: &Falling, reusable: &mut Reusable) -> Result<Arrival> {
        let failed = Mutex::new(None::<Error>);
        let arrival = Arrival::new(&falling.casting, &falling.lattice, self.bounds, reusable, |place, out| {
            if let Err(error) = (self.row)(place, out) {
                failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            }
        })?;
        match failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(error) => Err(error),
            None => Ok(arrival),
        }
    }
}

/// The shares of three lights and of ambient light at each voxel of a box, x fastest. Beyond the box, the shares are
/// the ones at its faces.
pub(super) struct ArrivingLight {
    /// The first voxel of the box.
    low: [usize; 3],
    dims: [usize; 3],
    shares: Vec<[u16; 4]>,
    /// The occlusion of ambient light, which turning lights leave as it is.
    occlusion: Falling,
    reusable: Reusable,
}

impl ArrivingLight {
    /// Finds the light that arrives at the voxels of a box around all visible ones. `incoming` is the light that enters
    /// a part of a lattice, and `before` the light of the same voxels under other lights.
    ///
    /// # Errors
    /// [`Error::Memory`] if [`BYTES`] for each voxel cannot be allocated; the errors of the rows.
    pub(super) fn new(
        casters: &Casters<'_>,
        falling: &Falling,
        incoming: Option<&Incoming>,
        before: Option<Self>,
        progress: &Progress,
    ) -> Result<Self> {
        let [low, dims] = casters.bounds;
        let count = dims.iter().product::<usize>();
        let occlusion = Falling { casting: falling.casting.only(MAX_CASTING), ..falling.clone() };
        let (is_first, mut reusable, mut occluded) = (before.is_none(), Reusable::default(), None);
        if let Some(before) = before {
            reusable = before.reusable;
            let is_same = before.occlusion == occlusion && (before.low, before.dims) == (low, dims);
            occluded = is_same.then_some(before.shares);
        }
        let arrival = casters.arrival(falling, &mut reusable)?.entered_by(incoming.cloned());
        let lights = if occluded.is_some() { 0..=MAX_CASTING - 1 } else { 0..=MAX_CASTING };
        let mut shares = match occluded {
            Some(mut shares) => {
                shares.par_iter_mut().for_each(|shares| shares[..MAX_CASTING].fill(u16::MAX));
                shares
            }
            None => {
                let mut shares: Vec<[u16; 4]> = reserved(count as u64, || "the light in the volume".to_owned())?;
                shares.resize(count, [u16::MAX; 4]);
                shares
            }
        };
        for light in lights {
            let done = |part: f64| (light as f64 + part) / (MAX_CASTING + 1) as f64;
            progress.check()?;
            let arriving = arrival.shares(light, &|part| progress.report("casting shadows", done(part)))?;
            let Some(arriving) = arriving else { continue };
            shares.par_chunks_mut(dims[0]).enumerate().for_each(|(row, shares)| {
                let share = arriving.from([low[0], low[1] + row % dims[1], low[2] + row / dims[1]]);
                shares.iter_mut().enumerate().for_each(|(x, shares)| shares[light] = share(x));
            });
        }
        drop(arrival);
        // The fields of a single picture take the place of that memory. Later pictures need both at once anyway.
        if is_first {
            reusable.free();
        }
        Ok(Self { low, dims, shares, occlusion, reusable })
    }

    /// Returns the shares of light at a voxel.
    #[inline(always)]
    pub(super) fn at_voxel(&self, voxel: [usize; 3]) -> [u16; 4] {
        let mut at = [0; 3];
        for axis in 0..3 {
            at[axis] = voxel[axis].saturating_sub(self.low[axis]).min(self.dims[axis] - 1);
        }
        self.shares[at[0] + self.dims[0] * (at[1] + self.dims[1] * at[2])]
    }

    /// Returns the shares at places of the lattice, given along the lattice axes `axes`, linear between voxels.
    #[inline(always)]
    pub(super) fn at<S: Simd>(&self, simd: S, order: &Order, axes: [usize; 3], at: [Lanes<S>; 3]) -> [Lanes<S>; 4] {
        let steps = [1, self.dims[0], self.dims[0] * self.dims[1]];
        let (mut firsts, mut fractions) = ([[0; RAYS]; 3], [[0.0; RAYS]; 3]);
        for axis in 0..3 {
            let last = self.dims[axes[axis]] - 1;
            let low = self.low[axes[axis]] as f32 + self.occlusion.lattice.first[axes[axis]] as f32;
            let place = at[axis].sub(simd, Lanes::all(simd, low));
            let place = place.max(simd, Lanes::all(simd, 0.0)).min(simd, Lanes::all(simd, last as f32));
            let first = place.floor(simd).min(simd, Lanes::all(simd, last.saturating_sub(1) as f32));
            fractions[axis] = place.sub(simd, first).to_array();
            firsts[axis] = first.indices(simd);
        }
        // A lattice of one plane has no neighbour; its weight is 0.
        let mut next = [0; 3];
        for axis in 0..3 {
            next[axis] = if self.dims[axes[axis]] > 1 { steps[axes[axis]] } else { 0 };
        }
        let mut channels = Channels::new(simd);
        for vector in 0..channels.0.len() {
            let rays = order.pair(vector);
            let mut first = [0; 2];
            for side in 0..2 {
                for axis in 0..3 {
                    first[side] += firsts[axis][rays[side]] as usize * steps[axes[axis]];
                }
            }
            let mut sum = simd.splat_f32s(0.0);
            for corner in 0..8 {
                let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
                let offset = i * next[0] + j * next[1] + k * next[2];
                let mut weights = [0.0; 2];
                for side in 0..2 {
                    let [a, b, c] = [fractions[0][rays[side]], fractions[1][rays[side]], fractions[2][rays[side]]];
                    let a = if i == 1 { a } else { 1.0 - a };
                    let b = if j == 1 { b } else { 1.0 - b };
                    weights[side] = a * b * if k == 1 { c } else { 1.0 - c };
                }
                let (one, other) = (&self.shares[first[0] + offset], &self.shares[first[1] + offset]);
                let mut shares = [0.0_f32; 8];
                for channel in 0..4 {
                    shares[channel] = f32::from(one[channel]);
                    shares[channel + 4] = f32::from(other[channel]);
                }
                sum = simd.mul_add_f32s(bytemuck::cast(shares), twice_four::<S>(weights[0], weights[1]), sum);
            }
            channels.0[vector] = simd.mul_f32s(sum, simd.splat_f32s(1.0 / 65_535.0));
        }
        channels.apart(simd)
    }
}
