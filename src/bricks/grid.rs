//! The bricks of a lattice: boxes of voxels between cuts along each axis, and their order along rays.

use std::ops::Range;

use glam::DVec3;

use crate::camera::{Camera, Projection};
use crate::error::{Error, Result};
use crate::settings::MAX_LEVEL;
use crate::volume::Grid;

/// The cuts of a lattice into bricks: along each axis the numbers of the voxels at which chunks begin, the first 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chunks {
    dims: [u32; 3],
    starts: [Vec<u32>; 3],
}

impl Chunks {
    /// Makes chunks of these sizes in voxels along x, y and z, such as the chunks of a Zarr store.
    ///
    /// ```
    /// use voxsplat::bricks::Chunks;
    ///
    /// let chunks = Chunks::new([10, 8, 4], [vec![4, 4, 2], vec![3, 5], vec![4]])?;
    /// assert_eq!(chunks.counts(), [3, 2, 1]);
    /// assert_eq!(chunks.voxels([2, 1, 0]), [8..10, 3..8, 0..4]);
    /// assert_eq!(chunks.sizes(), [vec![4, 4, 2], vec![3, 5], vec![4]]);
    /// # Ok::<(), voxsplat::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Setting`] if a size is 0, or the sizes along an axis do not add up to its voxels.
    pub fn new(dims: [u32; 3], sizes: [Vec<u32>; 3]) -> Result<Self> {
        for ((axis, sizes), voxels) in ["x", "y", "z"].into_iter().zip(&sizes).zip(dims) {
            let sum: u64 = sizes.iter().copied().map(u64::from).sum();
            if sum != u64::from(voxels) || sizes.contains(&0) {
                let reason =
                    format!("chunks of {sizes:?} voxels along {axis}, expected sizes over 0 that sum to {voxels}");
                return Err(Error::setting("grid", reason));
            }
        }
        let starts = sizes.map(|sizes| {
            let ends = sizes.iter().scan(0, |end, size| {
                let start = *end;
                *end += size;
                Some(start)
            });
            ends.collect()
        });
        Ok(Self { dims, starts })
    }

    /// Makes this number of chunks along x, y and z, of about equal sizes. Chunks of 16 voxels and more begin between
    /// cells of level 1, chunks of 32 and more between cells of level 2, and so on.
    ///
    /// # Errors
    /// [`Error::Setting`] if a number is 0 or exceeds the voxels along its axis.
    pub fn even(dims: [u32; 3], counts: [u32; 3]) -> Result<Self> {
        for ((axis, count), voxels) in ["x", "y", "z"].into_iter().zip(counts).zip(dims) {
            if !(1..=voxels).contains(&count) {
                let reason = format!("{count} chunks along {axis}, expected 1 to {voxels}, the number of its voxels");
                return Err(Error::setting("grid", reason));
            }
        }
        let start = |axis: usize, i: u32| {
            let level = (dims[axis] / counts[axis] / 8).max(1).ilog2();
            let start = (u64::from(dims[axis]) * u64::from(i) / u64::from(counts[axis])) as u32;
            start >> level << level
        };
        let starts = [0, 1, 2].map(|axis| (0..counts[axis]).map(|i| start(axis, i)).collect());
        Ok(Self { dims, starts })
    }

    /// Returns the voxels of the lattice along x, y and z.
    #[must_use]
    pub fn dims(&self) -> [u32; 3] {
        self.dims
    }

    /// Returns the coarsest level of which chunks cut no cell.
    pub(super) fn level(&self) -> u32 {
        let starts = self.starts.iter().flatten();
        starts.map(|start| start.trailing_zeros()).min().unwrap_or_default().min(MAX_LEVEL)
    }

    /// Returns the number of chunks along x, y and z.
    #[must_use]
    pub fn counts(&self) -> [usize; 3] {
        [0, 1, 2].map(|axis| self.starts[axis].len())
    }

    /// Returns the sizes of chunks in voxels along x, y and z, as [`Self::new`] takes them.
    #[must_use]
    pub fn sizes(&self) -> [Vec<u32>; 3] {
        std::array::from_fn(|axis| {
            let starts = self.starts[axis].iter().chain([&self.dims[axis]]);
            starts.clone().zip(starts.skip(1)).map(|(start, end)| end - start).collect()
        })
    }

    /// Returns the voxels of a brick, given its numbers along x, y and z.
    ///
    /// # Panics
    /// If a number is not under [`Self::counts`].
    #[must_use]
    pub fn voxels(&self, brick: [usize; 3]) -> [Range<u32>; 3] {
        std::array::from_fn(|axis| {
            let starts = &self.starts[axis];
            starts[brick[axis]]..starts.get(brick[axis] + 1).copied().unwrap_or(self.dims[axis])
        })
    }

    /// Returns the number of the chunk at a place along an axis; -1 before the first voxel and the number of chunks
    /// behind the last.
    fn chunk_at(&self, axis: usize, place: f64) -> i64 {
        if place >= f64::from(self.dims[axis]) - 0.5 {
            return self.starts[axis].len() as i64;
        }
        // Chunks begin half a voxel before their first voxel.
        self.starts[axis].iter().take_while(|&&start| f64::from(start) - 0.5 <= place).count() as i64 - 1
    }

    /// Returns the bricks with their keys, front to back: along every ray the keys of the bricks that it meets ascend.
    /// Through an eye in brick e the key of brick i is the sum of |i - e| over the axes, along parallel rays of
    /// direction d the sum of sign(d) i.
    pub(super) fn in_order(&self, grid: &Grid, camera: &Camera) -> Vec<([usize; 3], i64)> {
        let to_lattice = grid.to_lattice();
        let key: Box<dyn Fn(usize, i64) -> i64> = match camera.projection {
            Projection::Orthographic { .. } => {
                let direction = to_lattice.matrix3 * camera.forward;
                // No ray along an axis of the lattice meets two bricks across it.
                let sign = |c: f64| if c == 0.0 { 0 } else { c.signum() as i64 };
                Box::new(move |axis, i| sign(direction[axis]) * i)
            }
            Projection::Perspective { distance, .. } => {
                let eye = to_lattice.transform_point3(camera.target - camera.forward * distance);
                let chunk = [0, 1, 2].map(|axis| self.chunk_at(axis, eye[axis]));
                Box::new(move |axis, i| (i - chunk[axis]).abs())
            }
        };
        let [x, y, z] = self.counts();
        let all = (0..z).flat_map(|k| (0..y).flat_map(move |j| (0..x).map(move |i| [i, j, k])));
        let mut all: Vec<([usize; 3], i64)> =
            all.map(|brick| (brick, (0..3).map(|axis| key(axis, brick[axis] as i64)).sum())).collect();
        all.sort_by_key(|(_, key)| *key);
        all
    }
}

/// Returns the part of a lattice that a brick owns: from half a voxel before its first voxel to half a voxel behind its
/// last, open at the faces of the lattice.
pub(super) fn owned(grid: &Grid, voxels: &[Range<u32>; 3], open: f64) -> [DVec3; 2] {
    let low = |axis: usize| match voxels[axis].start {
        0 => -open,
        start => f64::from(start) - 0.5,
    };
    let high = |axis: usize| match voxels[axis].end {
        end if end == grid.dims()[axis] => open,
        end => f64::from(end) - 0.5,
    };
    [DVec3::from_array([0, 1, 2].map(low)), DVec3::from_array([0, 1, 2].map(high))]
}
