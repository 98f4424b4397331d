//! Lattices of cells for pictures in which many voxels fall into a pixel: a cell stands for 2^n voxels along each axis.

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;

use crate::error::Result;
use crate::kernel::{Kernel, SplineFilter};
use crate::volume::Grid;

/// The weights of the four voxels along an axis around the middle of a cell of twice their size, of a variance of
/// [`VARIANCE`] voxels^2. They add up to 1, so that cells are means.
const WEIGHTS: [f32; 4] = [0.125, 0.375, 0.375, 0.125];
const VARIANCE: f64 = 0.75;

/// The least growth of kernels over the size of cells: narrower ones would show the cells.
const LEAST_GROWTH: f64 = 1.25;

/// The level of cells: 0 for voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Level(pub(super) u32);

impl Level {
    /// Returns the level for kernels whose least growth is `smallest`, unless another is requested. Farther kernels
    /// grow as far as filters follow them: of rods seen end-on, cells for the farthest ones erred by 24 of 255 (rms)
    /// nearby.
    pub(super) fn new(kernel: &Kernel, smallest: f64, requested: Option<u32>) -> Self {
        let most = Self(0).most(kernel);
        let fine = requested.map_or(libm::log2(smallest / LEAST_GROWTH).floor(), f64::from);
        // No filter follows wider kernels.
        let coarse = libm::log2(smallest / most / (1.0 + 1e-9)).ceil();
        Self(fine.max(coarse).clamp(0.0, 100.0) as u32)
    }

    /// Returns the least growth of kernels of the level.
    pub(super) fn least(self) -> f64 {
        if self.0 == 0 { 0.0 } else { LEAST_GROWTH * self.size() }
    }

    /// Returns the largest growth of a kernel that a filter can represent.
    pub(super) fn most(self, kernel: &Kernel) -> f64 {
        SplineFilter::MAX_RADIUS / kernel.radius() * self.size()
    }

    /// Returns the number of voxels along the edge of a cell.
    pub(super) fn size(self) -> f64 {
        libm::exp2(f64::from(self.0))
    }

    /// Converts a place along an axis from numbers of voxels to numbers of cells.
    pub(super) fn cells_of(self, place: f64) -> f64 {
        (place - FIRST * (self.size() - 1.0)) / self.size()
    }

    /// Returns the lattice of the cells, [`SPREAD`] cells of each level beyond the faces included.
    pub(super) fn grid(self, grid: &Grid) -> Result<Grid> {
        let (mut dims, mut to_voxels) = (grid.dims(), DAffine3::IDENTITY);
        for _ in 0..self.0 {
            dims = dims.map(|d| d.div_ceil(2) + 2 * SPREAD as u32);
            to_voxels *= DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(2.0)), DVec3::splat(FIRST));
        }
        Ok(Grid::new(dims, grid.to_world() * to_voxels)?)
    }

    /// Returns the kernel of cells that represents `kernel` of voxels, grown by `growth`.
    pub(super) fn kernel(self, kernel: &Kernel, growth: f64) -> Kernel {
        if self.0 == 0 {
            return kernel.grown(growth);
        }
        // Making cells of cells widens what is left to the kernel: variances add up.
        let of_cells = VARIANCE * (self.size() * self.size() - 1.0) / 3.0;
        let left = growth * growth - of_cells / kernel.variance();
        kernel.grown(left.max(0.36).sqrt() / self.size())
    }
}

/// Number of cells of each level beyond the faces: voxels at the faces spread into them, and scalars at the faces
/// repeat.
const SPREAD: usize = 1;

/// The place of the first cell of twice the size, in numbers of the points that it is made of.
const FIRST: f64 = 0.5 - 2.0 * SPREAD as f64;

/// Values over a lattice, x fastest, and the number of its points along each axis.
pub(super) type Cells<const N: usize> = ([usize; 3], Vec<[f32; N]>);

/// A callback that returns the values of a plane.
pub(super) type Planes<'a, const N: usize> = dyn Fn(usize) -> Result<Vec<[f32; N]>> + Sync + 'a;

impl Level {
    /// Makes the cells of this level, from 1 on, of voxels of `N` channels. Beyond the faces voxels repeat or are
    /// empty.
    pub(super) fn cells<const N: usize>(
        self,
        dims: [usize; 3],
        plane: &Planes<'_, N>,
        repeats: bool,
    ) -> Result<Cells<N>> {
        let (mut dims, mut cells) = halved(dims, plane, repeats)?;
        for _ in 1..self.0 {
            let area = dims[0] * dims[1];
            (dims, cells) = halved(dims, &|plane| Ok(cells[plane * area..(plane + 1) * area].to_vec()), repeats)?;
        }
        Ok((dims, cells))
    }
}

/// Makes cells of twice the size of the points of a lattice.
fn halved<const N: usize>(dims: [usize; 3], plane: &Planes<'_, N>, repeats: bool) -> Result<Cells<N>> {
    let [nx, ny, nz] = dims;
    let half @ [across, down, deep] = dims.map(|d| d.div_ceil(2) + 2 * SPREAD);
    // The voxels under the weights of a cell.
    let under = |cell: usize, count: usize| {
        WEIGHTS.into_iter().enumerate().filter_map(move |(tap, weight)| {
            let voxel = (2 * cell + tap) as isize - (1 + 2 * SPREAD) as isize;
            let nearest = voxel.clamp(0, count as isize - 1);
            (repeats || nearest == voxel).then_some((nearest as usize, weight))
        })
    };
    let add = |sum: &mut [f32; N], weight: f32, voxel: &[f32; N]| {
        sum.iter_mut().zip(voxel).for_each(|(sum, value)| *sum = weight.mul_add(*value, *sum));
    };
    let make = |z: usize| {
        let mut sum = vec![[0.0; N]; nx * ny];
        for (z, weight) in under(z, nz) {
            sum.iter_mut().zip(&plane(z)?).for_each(|(sum, voxel)| add(sum, weight, voxel));
        }
        let mut cells = vec![[0.0; N]; across * down];
        let mut row = vec![[0.0; N]; nx];
        for (y, cells) in cells.chunks_exact_mut(across).enumerate() {
            row.fill([0.0; N]);
            for (y, weight) in under(y, ny) {
                row.iter_mut().zip(&sum[nx * y..]).for_each(|(sum, voxel)| add(sum, weight, voxel));
            }
            for (x, cell) in cells.iter_mut().enumerate() {
                under(x, nx).for_each(|(x, weight)| add(cell, weight, &row[x]));
            }
        }
        Ok(cells)
    };
    let planes = (0..deep).into_par_iter().map(make).collect::<Result<Vec<_>>>()?;
    Ok((half, planes.concat()))
}
