//! Splats on the device, brick after brick.

use std::ops::Range;

use super::context::Context;
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
    /// Its first splat in the store.
    pub(crate) first: u32,
    /// Lattice points of the box around its splats: the first, and the one after the last; alike where there are none.
    pub(crate) bounds: [[u32; 3]; 2],
}

impl BrickSplats {
    /// The splats from `first` on of the brick at `origin`, given for each row along x, y before z, the bits of the places
    /// where there are any, the first of a row the lowest.
    pub(crate) fn new(origin: [u32; 3], first: u32, rows: impl Iterator<Item = u32>) -> Self {
        let mut places = [0_u32; 3];
        for (row, bits) in rows.enumerate().filter(|&(_, bits)| bits != 0) {
            let (y, z) = (row % EDGE, row / EDGE);
            places = [places[0] | bits, places[1] | 1 << y, places[2] | 1 << z];
        }
        let low: [u32; 3] = std::array::from_fn(|axis| origin[axis] + places[axis].trailing_zeros() % u32::BITS);
        let high = std::array::from_fn(|axis| origin[axis] + u32::BITS - places[axis].leading_zeros());
        Self { origin, first, bounds: [low, high] }
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
        let origins: Vec<[u32; 4]> = bricks.iter().map(|b| [b.origin[0], b.origin[1], b.origin[2], 0]).collect();
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
