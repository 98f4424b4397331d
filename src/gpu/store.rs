//! Splats on the device, brick after brick.

use std::ops::Range;

use super::context::Context;
use super::layout::MAX_BRICKS;
use crate::error::Result;
use crate::volume::BRICK_EDGE as EDGE;

/// The bricks that splats were looked for in.
#[derive(Debug, Default)]
pub(crate) struct Bricks {
    /// Those of the volume and of the copies beyond its faces.
    pub(crate) all: u32,
    /// Those that may hold anything that shows: only they are classified, or looked at voxel by voxel.
    pub(crate) uploaded: u32,
    /// Bytes sent to the device for them.
    pub(crate) bytes: u64,
}

/// Splats in one buffer that fits into a storage binding.
#[derive(Debug)]
pub(crate) struct Store {
    pub(crate) splats: wgpu::Buffer,
    /// Bytes of a splat.
    pub(crate) stride: u64,
    pub(crate) count: u32,
    /// Where the bricks that splats name begin, as the shaders read it.
    pub(crate) origins: wgpu::Buffer,
    pub(crate) bricks: Vec<BrickSplats>,
}

/// The splats of a brick, one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct BrickSplats {
    /// Lattice point of the brick's first voxel.
    pub(crate) origin: [u32; 3],
    /// Its places are cells of 2^level voxels a side.
    pub(crate) level: u32,
    /// Its first splat in the store.
    pub(crate) first: u32,
    /// Lattice points of the box around its splats: the first, and the one after the last. Both are equal if
    /// there are none.
    pub(crate) bounds: [[u32; 3]; 2],
}

impl BrickSplats {
    /// The splats from `first` on of the brick of level 0 at `origin`, given for each row along x, y before z, the bits
    /// of the places where there are any, the first of a row the lowest.
    pub(crate) fn new(origin: [u32; 3], first: u32, rows: impl Iterator<Item = u32>) -> Self {
        let mut places = [0_u32; 3];
        for (row, bits) in rows.enumerate().filter(|&(_, bits)| bits != 0) {
            let (y, z) = (row % EDGE, row / EDGE);
            places = [places[0] | bits, places[1] | 1 << y, places[2] | 1 << z];
        }
        let low: [u32; 3] = std::array::from_fn(|axis| origin[axis] + places[axis].trailing_zeros() % u32::BITS);
        let high = std::array::from_fn(|axis| origin[axis] + u32::BITS - places[axis].leading_zeros());
        Self { origin, level: 0, first, bounds: [low, high] }
    }

    /// The same brick with cells of a level for voxels.
    pub(crate) fn of_level(self, level: u32) -> Self {
        let scaled =
            |point: [u32; 3]| [0, 1, 2].map(|axis| self.origin[axis] + ((point[axis] - self.origin[axis]) << level));
        Self { level, bounds: self.bounds.map(scaled), ..self }
    }
}

impl Store {
    pub(crate) fn new(
        context: &Context,
        splats: wgpu::Buffer,
        stride: u64,
        count: u32,
        bricks: Vec<BrickSplats>,
    ) -> Result<Self> {
        let origins: Vec<[u32; 4]> = bricks.iter().map(|b| [b.origin[0], b.origin[1], b.origin[2], b.level]).collect();
        let origins = context.upload("splats.origins", bytemuck::cast_slice(&origins), wgpu::BufferUsages::STORAGE)?;
        Ok(Self { splats, stride, count, origins, bricks })
    }

    /// The bricks that have splats, and which.
    pub(crate) fn runs(&self) -> impl Iterator<Item = (&BrickSplats, Range<u32>)> {
        let ends = self.bricks.iter().skip(1).map(|next| next.first).chain([self.count]);
        let runs = self.bricks.iter().zip(ends).map(|(brick, end)| (brick, brick.first..end));
        runs.filter(|(_, run)| !run.is_empty())
    }

    /// Bytes on the device.
    pub(crate) fn bytes(&self) -> u64 {
        self.splats.size() + self.origins.size()
    }
}

/// Splats that will be part of a store.
pub(super) trait Part: Sized {
    /// A buffer of the splats of parts, of `bytes` in all, one after the other.
    fn join(context: &Context, parts: Vec<Self>, bytes: u64) -> Result<wgpu::Buffer>;
}

/// Joins the splats of bricks into few stores, each within a storage binding and within the bricks that a place can
/// name.
pub(super) struct StoreBuilder<'a, P> {
    context: &'a Context,
    /// Bytes of a splat.
    stride: u64,
    /// The most splats of a store.
    most: u32,
    /// What goes into the next store.
    parts: Vec<P>,
    bricks: Vec<BrickSplats>,
    held: u32,
    stores: Vec<Store>,
}

impl<'a, P: Part> StoreBuilder<'a, P> {
    /// Stores of at most `most` splats of `stride` bytes, or as many as the adapter binds.
    pub(super) fn new(context: &'a Context, stride: u64, most: u32) -> Self {
        let bindable = context.limits.max_storage_buffer_binding_size.min(context.limits.max_buffer_size) / stride;
        let most = u32::try_from(bindable).unwrap_or(u32::MAX).min(most);
        Self { context, stride, most, parts: Vec::new(), bricks: Vec::new(), held: 0, stores: Vec::new() }
    }

    /// The numbers that the first brick and the first splat of a part will have in their store. The part is added next.
    pub(super) fn make_room(&mut self, splats: u32, bricks: usize) -> Result<(u32, u32)> {
        let full = self.held.checked_add(splats).is_none_or(|sum| sum > self.most);
        if full || self.bricks.len() + bricks > MAX_BRICKS {
            self.close()?;
        }
        Ok((self.bricks.len() as u32, self.held))
    }

    pub(super) fn add(&mut self, part: P, count: u32, bricks: impl IntoIterator<Item = BrickSplats>) {
        self.parts.push(part);
        self.bricks.extend(bricks);
        self.held += count;
    }

    fn close(&mut self) -> Result<()> {
        let (parts, bricks) = (std::mem::take(&mut self.parts), std::mem::take(&mut self.bricks));
        let held = std::mem::take(&mut self.held);
        if !parts.is_empty() {
            let splats = P::join(self.context, parts, u64::from(held) * self.stride)?;
            self.stores.push(Store::new(self.context, splats, self.stride, held, bricks)?);
        }
        Ok(())
    }

    pub(super) fn finish(mut self) -> Result<Vec<Store>> {
        self.close()?;
        Ok(self.stores)
    }
}
