//! cells: a volume and a transfer function to classified cells of a level, for pre-shading with grown kernels (Laur and
//! Hanrahan 1991, "Hierarchical splatting"). The device makes them: gpu/cells.rs.
//!
//! A cell of level n stands for 2^n voxels along each axis, and of level n + 1/2 for half as many more. Voxels are
//! classified and lit one by one. A cell holds the light that they emit and absorb, weighted by the polynomials of
//! degree 5 that interpolate cells at the places of voxels (Lagrange). So the moments of each voxel are kept up to the
//! fifth. Weights farther than a cell away are negative, so a cell may absorb a little less than nothing.
//!
//! Cells have no normals: lit by a mean normal, uniform matter erred by 20 of 255 and folds finer than a cell by 30. So
//! cells are made anew if a light or the eye moves. The normals of the voxels are kept.

mod filter;
mod size;

use glam::DVec3;

use self::filter::REACH;
use crate::error::Result;
use crate::gpu::cells::CellLattice;
use crate::kernel::Kernel;
use crate::settings::MAX_LEVEL;
use crate::transfer::TransferFunction;
use crate::volume::Grid;

pub(crate) use self::filter::{Filter, response};
pub(crate) use self::size::CellSize;

/// The least standard deviation of the kernels of cells, in cells: narrower kernels would show the lattice. The default
/// Gaussian has it at a growth of 1.5.
pub(crate) const LEAST_DEVIATION: f64 = 0.585;

/// The least standard deviation of compact kernels such as the blob, in cells: rays through one eye reach 4 voxels of
/// grown kernels, and by then cells must stand for voxels.
const LEAST_DEVIATION_OF_WIDE: f64 = 0.5;
/// The number of voxels that rays through one eye reach to either side.
const WIDEST: f64 = 4.0;

/// The radius of the narrowest Gaussian of cells, in standard deviations: the largest that polynomials of 8 terms, by
/// which rays evaluate footprints, can follow, so that little is cut off.
const NARROW_RADIUS: f64 = 3.28;
/// The standard deviation, in cells, from which on cells have the grown Gaussian of voxels.
const BROAD: f64 = 0.975;
/// The largest radius, in cells, of kernels that rays gather from three texels of a row.
const SHARED_RADIUS: f64 = 2.0;

/// The optical depth of a cell up to which a level begins at its least growth.
const THIN: f64 = 0.6;
/// The exponent by which the first growth of a level rises with the optical depth of denser cells.
const DENSER: f64 = 0.42;

/// Returns the largest cells that are accurate for voxels with grown kernels, given the optical depth of a voxel; no
/// larger than the volume.
pub(crate) fn size_for(kernel: &Kernel, growth: f64, grid: &Grid, depth: f64) -> CellSize {
    let one = grid.dims().into_iter().max().unwrap_or(1).next_power_of_two().ilog2();
    let largest = CellSize::of_level(one.min(MAX_LEVEL));
    let mut size = CellSize::VOXEL;
    // The growth of a picture is often 1.5, to within rounding.
    while size < largest && right_growth(kernel, size.next(), depth) <= 1.0001 * growth {
        size = size.next();
    }
    size
}

/// Returns the coarsest level whose cells are accurate; see [`size_for`].
pub(crate) fn level_of(kernel: &Kernel, growth: f64, grid: &Grid, depth: f64) -> u32 {
    size_for(kernel, growth, grid, depth).level() as u32
}

/// Returns the growth of kernels from which on cells are accurate, given the optical depth of a voxel.
///
/// Cells ring beside edges by a few hundredths of their optical depth. Denser cells ring more visibly, and kernels that
/// are wide beside cells smooth the ringing. Measured on noise, boxes, specks, balls, shells and tubes:
/// docs/measurements/2026-11-23-levels.md.
pub(crate) fn right_growth(kernel: &Kernel, size: CellSize, depth: f64) -> f64 {
    let denser = libm::pow((depth * size.voxels() / THIN).max(1.0), DENSER);
    let finer = CellSize::all().take_while(|finer| *finer < size).last().unwrap_or(CellSize::VOXEL);
    growth_of_wide(kernel, denser, size, finer).max(least_growth(kernel, size) * denser)
}

/// Returns the growth from which on cells of a size may stand for voxels with a kernel of any width: the growth of the
/// default kernel, times `denser`, or the growth from which on rays cannot gather kernels of `finer` cells.
///
/// Samples under a wide kernel that pixels resolve keep details that cells lose: at a growth of 1, cells of 1.5 voxels
/// erred by up to 6 of 255 (rms) in lit pictures of the signal of Marschner and Lobb, although the kernel was wide
/// enough for them.
pub(crate) fn growth_of_wide(kernel: &Kernel, denser: f64, size: CellSize, finer: CellSize) -> f64 {
    let gathered = WIDEST * finer.voxels() / kernel.radius();
    (least_growth(&Kernel::default(), size) * denser).min(gathered)
}

/// Returns the least growth of kernels that cells can have.
pub(crate) fn least_growth(kernel: &Kernel, size: CellSize) -> f64 {
    least_deviation(kernel) * size.voxels() / kernel.variance().sqrt()
}

/// Returns the least standard deviation, in cells, of the kernels of cells that stand for voxels of this kernel.
fn least_deviation(kernel: &Kernel) -> f64 {
    let wide = WIDEST / 2.0 * kernel.variance().sqrt() / kernel.radius();
    wide.clamp(LEAST_DEVIATION_OF_WIDE, LEAST_DEVIATION)
}

/// Returns the kernel of cells, in cells: as broad as the grown kernel of voxels, whose growth is at least
/// [`least_growth`].
pub(crate) fn kernel_of(kernel: &Kernel, growth: f64, size: CellSize) -> Kernel {
    let grown = kernel.grown(growth / size.voxels());
    let deviation = grown.variance().sqrt();
    // A blob is small where it ends, so cells may have it unchanged.
    if matches!(grown, Kernel::KaiserBessel { .. }) || deviation >= BROAD {
        return grown;
    }
    let broad = ((deviation - LEAST_DEVIATION) / (BROAD - LEAST_DEVIATION)).max(0.0);
    let narrow_radius = NARROW_RADIUS * deviation;
    let radius = narrow_radius + (grown.radius() - narrow_radius) * broad;
    gaussian(if grown.radius() <= SHARED_RADIUS { radius.min(SHARED_RADIUS) } else { radius }, deviation)
}

/// Returns the Gaussian of this radius and standard deviation, found by bisection to rounding.
fn gaussian(radius: f64, deviation: f64) -> Kernel {
    let of = |sigma: f64| Kernel::Gaussian { sigma, radius };
    let [mut low, mut high] = [0.25 * deviation, 8.0 * deviation];
    for _ in 0..50 {
        let middle = f64::midpoint(low, high);
        if of(middle).variance() < deviation * deviation {
            low = middle;
        } else {
            high = middle;
        }
    }
    of(f64::midpoint(low, high))
}

/// Returns the lattice of cells: cell [`REACH`] begins where the volume does along each axis, and [`REACH`] cells lie
/// beyond each face.
pub(crate) fn grid_of(grid: &Grid, cells: CellSize) -> Result<Grid> {
    let size = cells.voxels();
    let mut to_world = grid.to_world();
    to_world.translation = to_world.transform_point3(DVec3::splat((size - 1.0) / 2.0 - size * REACH as f64));
    to_world.matrix3 *= size;
    Ok(Grid::new(dims_of(grid, cells).map(|d| d as u32), to_world)?)
}

fn dims_of(grid: &Grid, size: CellSize) -> [usize; 3] {
    grid.dims().map(|d| size.cells(d) as usize + 2 * REACH)
}

/// The cells of a level of a volume, and the weights of voxels in them.
pub(crate) struct Shape {
    filter: Filter,
    /// Number of cells along each axis.
    dims: [usize; 3],
    /// Number of voxels along each axis.
    voxels: [usize; 3],
    /// The least density of cells that are kept.
    least: f32,
}

/// The least density of a cell that is kept, as a share of the largest of a voxel.
const LEAST: f64 = 1.0 / 1024.0;

impl Shape {
    pub(crate) fn new(grid: &Grid, transfer: &TransferFunction, size: CellSize) -> Self {
        Self {
            filter: Filter::new(size, 0.0, &[1.0], REACH),
            dims: dims_of(grid, size),
            voxels: grid.dims().map(|d| d as usize),
            least: (TransferFunction::extinction(transfer.max_opacity(), 1.0) * LEAST) as f32,
        }
    }

    /// Returns the cells in the form that the device reads.
    pub(crate) fn on_device(&self) -> CellLattice<'_> {
        let (size, first, weights) = self.filter.parts();
        CellLattice { dims: self.dims, voxels: self.voxels, size, first, weights, least: self.least }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broad_kernels_of_cells_are_those_of_voxels() {
        for kernel in [Kernel::default(), Kernel::KAISER_BESSEL, Kernel::Gaussian { sigma: 1.2, radius: 3.0 }] {
            for (level, growth) in [(1, 3.0), (2, 6.0), (3, 30.0)] {
                let grown = kernel.grown(growth / f64::from(level).exp2());
                assert_eq!(kernel_of(&kernel, growth, CellSize::of_level(level)), grown);
            }
        }
    }

    #[test]
    fn dense_cells_need_a_larger_growth() {
        let kernel = Kernel::default();
        let [fine, coarse] = [1, 2].map(CellSize::of_level);
        assert_eq!(right_growth(&kernel, fine, 0.1), least_growth(&kernel, fine));
        let [thin, dense, opaque] = [0.5, 5.0, 50.0].map(|depth| right_growth(&kernel, coarse, depth));
        assert!(thin < dense && dense < opaque, "{thin} {dense} {opaque}");
    }

    #[test]
    fn wide_kernels_take_cells_no_sooner_than_the_default_kernel_unless_rays_cannot_gather_voxels() {
        let grid = Grid::axis_parallel([64; 3], [1.0; 3]).unwrap();
        for depth in [0.0, 0.5, 4.0] {
            for (sigma, radius) in [(1.0, 2.5), (1.0, 3.0), (1.5, 3.0), (1.2, 3.9)] {
                let wide = Kernel::Gaussian { sigma, radius };
                assert_eq!(size_for(&wide, 1.0, &grid, depth), CellSize::VOXEL, "{wide} {depth}");
                for growth in [1.0, 1.2, 1.5, 2.0] {
                    let [of_wide, of_default] =
                        [wide, Kernel::default()].map(|kernel| size_for(&kernel, growth, &grid, depth));
                    let reach = growth * radius / of_wide.voxels();
                    assert!(depth > 0.0 || reach <= WIDEST * 1.0001, "{wide} {growth}: {reach}");
                    assert!(of_wide <= of_default || growth * radius > WIDEST, "{wide} {depth} {growth}");
                }
            }
        }
        let widest = Kernel::Gaussian { sigma: 3.0, radius: 6.0 };
        assert!(size_for(&widest, 1.0, &grid, 0.0) > CellSize::VOXEL);
    }

    #[test]
    fn no_level_is_coarser_than_the_volume() {
        let grid = Grid::axis_parallel([40, 65, 10], [1.0; 3]).unwrap();
        let level = |growth| size_for(&Kernel::default(), growth, &grid, 0.0).level();
        assert_eq!([1.0, 1.2, 1.5, 2.4, 3.0, 50.0, 1e3, 1e9].map(level), [0.0, 0.5, 1.0, 1.5, 2.0, 6.0, 7.0, 7.0]);
    }
}
