//! cells: a volume and a transfer function to classified cells of a level, for pre-shading with grown kernels (Laur and
//! Hanrahan 1991, "Hierarchical splatting"). On the host on software, and for volumes whose samples a device does not
//! hold. Otherwise the device makes them: gpu/cells.rs.
//!
//! A cell of level n stands for 2^n voxels along each axis, and of level n + 1/2 for half as many more. Voxels are
//! classified and lit one by one. A cell holds the light that they emit and absorb, weighted by the polynomials of
//! degree 5 that interpolate cells at the places of voxels (Lagrange). So the moments of each voxel are kept up to the
//! fifth. Weights farther than a cell away are negative, so a cell may absorb a little less than nothing.
//!
//! Cells have no normals: lit by a mean normal, uniform matter erred by 20 of 255 and folds finer than a cell by 30. So
//! cells are made anew if a light or the eye moves. From the second time on the normals of the voxels are kept.

mod filter;
mod lit;
mod size;
mod slices;

use std::ops::Range;

use glam::DVec3;
use pulp::{Arch, NullaryFnOnce};

use self::filter::REACH;
use crate::error::Result;
use crate::gpu::cells::CellLattice;
use crate::gpu::context::Context;
use crate::gpu::layout::Splat;
use crate::gpu::store::{Drawable, StoreBuilder};
use crate::gpu::view::LayerPart;
use crate::kernel::Kernel;
use crate::progress::Progress;
use crate::settings::MAX_LEVEL;
use crate::splats::brick::MadeBrick;
use crate::splats::classification::Emission;
use crate::splats::words::packed_appearance;
use crate::transfer::TransferFunction;
use crate::volume::{BRICK_EDGE as EDGE, Grid, Volume};
use voxsplat_volume::memory::reserved;

pub(crate) use self::filter::{Filter, response};
pub(crate) use self::lit::LitSplats;
pub(crate) use self::size::CellSize;
pub(crate) use self::slices::{KeptNormals, Source};

/// The least standard deviation of the kernels of cells, in cells: narrower kernels would show the lattice. The default
/// Gaussian has it at a growth of 1.5.
pub(crate) const LEAST_DEVIATION: f64 = 0.585;

/// The least standard deviation of compact kernels such as the blob, in cells: rays through one eye reach 4 voxels of
/// grown kernels, and by then cells must stand for voxels.
const LEAST_DEVIATION_OF_WIDE: f64 = 0.5;
/// The voxels that rays through one eye reach to either side.
const WIDEST: f64 = 4.0;

/// The radius of the narrowest Gaussian of cells, in standard deviations: the largest that polynomials of 8 terms, by
/// which rays evaluate footprints, can follow, so that little is cut off.
const NARROW_RADIUS: f64 = 3.28;
/// The standard deviation, in cells, from which on cells have the grown Gaussian of voxels.
const BROAD: f64 = 0.975;
/// The largest radius, in cells, of kernels that rays gather eight together.
const SHARED_RADIUS: f64 = 2.0;

/// The optical depth of a cell up to which a level begins at its least growth.
const THIN: f64 = 0.6;
/// The exponent by which the first growth of a level rises with the optical depth of denser cells.
const DENSER: f64 = 0.42;

/// The largest cells that are accurate for voxels with grown kernels, given the optical depth of a voxel; no larger
/// than the volume.
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

/// The coarsest level whose cells are: see [`size_for`].
pub(crate) fn level_of(kernel: &Kernel, growth: f64, grid: &Grid, depth: f64) -> u32 {
    size_for(kernel, growth, grid, depth).level() as u32
}

/// The growth of kernels from which on cells are accurate, given the optical depth of a voxel.
///
/// Cells ring beside edges by a few hundredths of their optical depth. Denser cells ring more visibly, and kernels that
/// are wide beside cells smooth the ringing. Measured on noise, boxes, specks, balls, shells and tubes:
/// docs/measurements/2026-11-23-levels.md.
pub(crate) fn right_growth(kernel: &Kernel, size: CellSize, depth: f64) -> f64 {
    let denser = (depth * size.voxels() / THIN).max(1.0).powf(DENSER);
    let finer = CellSize::all().take_while(|finer| *finer < size).last().unwrap_or(CellSize::VOXEL);
    growth_of_wide(kernel, denser, size, finer).max(least_growth(kernel, size) * denser)
}

/// The growth from which on cells of a size may stand for voxels with a kernel of any width: the growth of the default
/// kernel, times `denser`, or the growth from which on rays cannot gather kernels of `finer` cells.
///
/// Samples under a wide kernel that pixels resolve keep details that cells lose: at a growth of 1, cells of 1.5 voxels
/// erred by up to 6 of 255 (rms) in lit pictures of the signal of Marschner and Lobb, although the kernel was wide
/// enough for them.
pub(crate) fn growth_of_wide(kernel: &Kernel, denser: f64, size: CellSize, finer: CellSize) -> f64 {
    let gathered = WIDEST * finer.voxels() / kernel.radius();
    (least_growth(&Kernel::default(), size) * denser).min(gathered)
}

/// The least growth of kernels that cells can have.
pub(crate) fn least_growth(kernel: &Kernel, size: CellSize) -> f64 {
    least_deviation(kernel) * size.voxels() / kernel.variance().sqrt()
}

/// The least standard deviation of the kernels of cells that stand for voxels of this kernel, in cells.
fn least_deviation(kernel: &Kernel) -> f64 {
    let wide = WIDEST / 2.0 * kernel.variance().sqrt() / kernel.radius();
    wide.clamp(LEAST_DEVIATION_OF_WIDE, LEAST_DEVIATION)
}

/// The kernel of cells, in cells: as broad as the grown kernel of voxels, whose growth is at least [`least_growth`].
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

/// The lattice of cells: cell [`REACH`] begins where the volume does along each axis, and [`REACH`] cells lie beyond
/// each face.
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

/// The voxels that become cells.
pub(crate) enum Voxels<'a> {
    /// Classified and lit on the way.
    Samples(Source<'a>),
    /// Voxels in shadows: splats hold the light that arrives.
    Splats(LitSplats<'a>),
}

/// The cells of a level of a volume.
pub(crate) struct Shape {
    filter: Filter,
    /// Cells along each axis.
    dims: [usize; 3],
    /// Voxels along each axis.
    voxels: [usize; 3],
    /// Cells of a lower density are left out.
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

    /// The same as the device needs it.
    pub(crate) fn on_device(&self) -> CellLattice<'_> {
        let (size, first, weights) = self.filter.parts();
        CellLattice { dims: self.dims, voxels: self.voxels, size, first, weights, least: self.least }
    }
}

/// Makes the cells of a level of a volume on the host.
pub(crate) struct Coarsening<'a> {
    pub(crate) volume: &'a Volume,
    pub(crate) voxels: Voxels<'a>,
    pub(crate) shape: Shape,
    /// The part of the lattice of cells whose bricks are made; `None`: all of it.
    pub(crate) part: Option<LayerPart>,
}

impl Coarsening<'_> {
    /// The cells as splats.
    pub(crate) fn emit(&self, context: &Context, progress: &Progress) -> Result<Drawable> {
        let mut stores = StoreBuilder::new(context, size_of::<Splat>() as u64, u32::MAX);
        // The rows that a row of bricks reads, beyond the rows of a brick of voxels.
        let halo = (self.shape.filter.voxels(0, EDGE as i64).count() - EDGE).div_ceil(2);
        let counts = self.shape.dims.map(|n| n.div_ceil(EDGE));
        stores.push_rows(self.volume, counts, halo, (progress, "classifying"), &|j, k| self.row([j, k]))?;
        let cells = stores.finish()?;
        context.wait("classifying the volume")?;
        Ok(cells)
    }

    /// The bricks along x that are made, with these numbers in y and z: a linear function bounds them.
    fn bricks_of_row(&self, [j, k]: [usize; 2]) -> Range<usize> {
        let count = self.shape.dims[0].div_ceil(EDGE);
        let Some(part) = &self.part else { return 0..count };
        let middle = DVec3::from_array(self.shape.dims.map(|n| (n as f64 - 1.0) / 2.0));
        let corner = |brick: [usize; 3]| DVec3::from_array(brick.map(|n| (n * EDGE) as f64)) - middle;
        let mut made = (0..count).filter(|&i| part.meets([corner([i, j, k]), corner([i + 1, j + 1, k + 1])]));
        made.next().map_or(0..0, |first| first..made.next_back().unwrap_or(first) + 1)
    }

    /// The bricks with cells along x, with these numbers in y and z.
    fn row(&self, [j, k]: [usize; 2]) -> Result<Vec<MadeBrick>> {
        let [across, down, deep] = self.shape.dims;
        let [ys, zs] = [(j, down), (k, deep)].map(|(brick, n)| brick * EDGE..n.min((brick + 1) * EDGE));
        let bricks = self.bricks_of_row([j, k]);
        let xs = bricks.start * EDGE..across.min(bricks.end * EDGE);
        if xs.is_empty() {
            return Ok(Vec::new());
        }
        let [nx, ny, nz] = self.volume.grid().dims().map(i64::from);
        let within = |cells: &Range<usize>, n: i64| {
            let voxels = self.shape.filter.voxels(cells.start as i64, cells.end as i64);
            voxels.start.clamp(0, n)..voxels.end.clamp(0, n)
        };
        let rows = within(&ys, ny);
        let columns = within(&xs, nx);
        let columns = columns.start as usize..columns.end as usize;
        // The cells of the row of bricks, and a plane of cells for the voxels of one plane.
        let mut cells = filled(across * ys.len() * zs.len(), [0.0; 4])?;
        let mut plane = filled(across * ys.len(), [0.0; 4])?;
        let mut slices = match &self.voxels {
            Voxels::Samples(source) => Ok(source.slices(rows.clone())),
            Voxels::Splats(splats) => Err(splats),
        };
        // A row with room for empty voxels before the first and behind the last, and for one more.
        let all = self.shape.filter.voxels(0, across as i64);
        let mut voxels = vec![[0.0; 4]; (all.end - all.start) as usize + 1];
        let begin = (-all.start) as usize;
        let mut narrow = vec![[0.0; 4]; across];
        for z in within(&zs, nz) {
            if let Ok(slices) = &mut slices {
                slices.advance(z)?;
            }
            let mut shows = false;
            for y in rows.clone() {
                let inside = &mut voxels[begin..begin + nx as usize];
                let shown = match &slices {
                    Ok(slices) => slices.row([y, z], &columns, inside),
                    Err(splats) => splats.row([y as usize, z as usize], &columns, inside),
                };
                if shown.is_empty() {
                    continue;
                }
                shows = true;
                let reached = self.shape.filter.reached(&shown, across);
                let start = reached.start.clamp(xs.start, xs.end);
                let reached = start..reached.end.clamp(start, xs.end);
                let narrow = &mut narrow[reached.clone()];
                self.shape.filter.gather(&voxels, reached.clone(), narrow);
                for (cell, weight) in self.shape.filter.cells(y, ys.start, ys.end) {
                    let sums = &mut plane[(cell - ys.start) * across + reached.start..];
                    add(sums.as_flattened_mut(), weight, narrow.as_flattened());
                }
            }
            if shows {
                for (cell, weight) in self.shape.filter.cells(z, zs.start, zs.end) {
                    let sums = &mut cells[(cell - zs.start) * plane.len()..];
                    add(sums.as_flattened_mut(), weight, plane.as_flattened());
                }
                plane.fill([0.0; 4]);
            }
        }
        let mut bricks: Vec<_> = bricks.map(|i| self.brick(&cells, [i, j, k])).collect::<Result<_>>()?;
        bricks.retain(|made| made.splats.count() > 0);
        Ok(bricks)
    }

    /// The splats of a brick, given the cells of its row of bricks.
    fn brick(&self, cells: &[Emission], brick: [usize; 3]) -> Result<MadeBrick> {
        let [across, down, _] = self.shape.dims;
        let down = EDGE.min(down - brick[1] * EDGE);
        let origin = brick.map(|b| (b * EDGE) as u32);
        MadeBrick::of_rows(origin, self.shape.dims.map(|n| n as u32), 2, |[y, z], count, words| {
            let start = across * (y + down * z) + brick[0] * EDGE;
            let mut bits = 0;
            for (x, cell) in cells[start..start + count].iter().enumerate() {
                let [r, g, b, density] = *cell;
                if density.abs() > self.shape.least {
                    bits |= 1 << x;
                    words.extend(packed_appearance([r, g, b].map(|c| c / density), density));
                }
            }
            bits
        })
    }
}

/// Returns a vector of `count` equal values, or an error if there is no memory.
pub(super) fn filled<T: Copy>(count: usize, value: T) -> Result<Vec<T>> {
    let mut values = reserved(count as u64, || "the cells of a row of bricks".to_owned())?;
    values.resize(count, value);
    Ok(values)
}

/// Adds weighted values to sums.
pub(super) fn add(sums: &mut [f32], weight: f32, values: &[f32]) {
    if weight != 0.0 {
        Arch::new().dispatch(Sum { sums, weight, values });
    }
}

/// The parameters of [`add`], as a type so that it is compiled for the widest vectors of the machine.
struct Sum<'a> {
    sums: &'a mut [f32],
    weight: f32,
    values: &'a [f32],
}

impl NullaryFnOnce for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { sums, weight, values } = self;
        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
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
