//! scalar-cells: the scalars of cells, for post-shading if kernels are wider than rays gather. On the host, from the
//! samples, brick by brick on demand: no volume of cells is kept.
//!
//! Cells have 3/2 voxels along each axis, or the voxels of a whole level ([`sizes`]): voxels are shared by the weights
//! of pre-shading (cells.rs), which keep their moments. Along parallel rays all cells have one kernel, which rays
//! gather; through an eye it grows with depth. Cells are blurred by the difference to the kernels of voxels, because
//! classification magnifies differences of shape: a Gaussian of the same variance does not replace a truncated kernel.
//! The middle of the lattice of cells is the middle of the voxels, and voxels beyond a face are copies of the outermost
//! one.

use std::ops::Range;

use glam::{DMat3, DVec3};
use pulp::NullaryFnOnce;
use voxsplat_volume::memory::reserved;

use super::cells::{CellSize, Filter, LEAST_DEVIATION, growth_of_wide, response};
use crate::error::Result;
use crate::gpu::scalar_cells::CellFilters;
use crate::kernel::{Kernel, Slopes};
use crate::settings::MAX_LEVEL;
use crate::transfer::TransferFunction;
use crate::transfer::scalars::Relative;
use crate::vectors::dispatch;
use crate::volume::{BRICK_EDGE as EDGE, Grid, ToF64, Volume, with_samples};

/// The least kernel of cells; the largest is one of [`STEPS`] larger, and rays gather kernels of a radius of 2. It is
/// smooth: its parts are fitted well, and the lattice is invisible.
const KERNEL: Kernel = Kernel::KaiserBessel { radius: 1.915, alpha: 5.0 };

/// The largest scalar of voxels that have cells; visible scalars are within 2. The shapes of kernels differ by some
/// hundredths of a scalar, which is visible beside distant values such as a value for missing data.
pub(crate) const MOST_SCALAR: f64 = 16.0;

/// The optical depth of a cell up to which the fit of [`blur`] is accurate: denser matter shows the ends of kernels.
pub(crate) const MOST_DEPTH: f64 = 1.0;

/// The number of cells that rays gather to either side.
const REACH: f64 = 4.0;
/// The standard deviation, in cells, from which on grown kernels of voxels do not show the lattice.
const SMOOTH_DEVIATION: f64 = 1.1;
/// The factor by which radii may exceed their limit, because of rounding.
const ROUNDING: f64 = 1.0 + 1e-6;

/// The number of growths, per doubling, for which cells are blurred. The kernel of cells makes up for growths between,
/// so that cells of one picture serve a picture of another size.
const STEPS: f64 = 16.0;

/// The cells that stand for voxels: of one size along parallel rays, of a layer through an eye.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Coarse {
    pub(crate) cells: CellSize,
    /// The step of the growth for which cells are blurred: kernels of voxels with a growth of 2^(step / [`STEPS`]) in
    /// cells; `None`: cells have the grown kernel of voxels.
    step: Option<i32>,
}

impl Coarse {
    /// Chooses the cells for grown kernels of voxels: of size `cells`, or of the largest size that can have such
    /// kernels.
    pub(crate) fn new(kernel: &Kernel, growth: f64, cells: Option<CellSize>) -> Self {
        let largest = || {
            // Rounding: see `cells::size_for`.
            let serves = |cells: &CellSize| right_growth(kernel, *cells) <= 1.0001 * growth;
            sizes().skip(1).take_while(serves).last().unwrap_or(CellSize::VOXEL)
        };
        let cells = cells.unwrap_or_else(largest);
        let least = least_growth(kernel, CellSize::VOXEL);
        let steps = |growth: f64| STEPS * libm::log2(growth);
        let step = steps(1.0001 * growth / cells.voxels()).floor();
        // The least kernel serves coarser cells too; finer cells have the least kernel of the next level.
        let (first, last) = (steps(least).floor(), steps(2.0 * least).floor());
        Self { cells, step: Some(step.clamp(first, last) as i32) }
    }

    /// Chooses the finest cells of a level in which grown kernels of voxels reach no farther than rays gather, up to 8
    /// times as many as [`Self::new`] returns. Kernels are the voxels' own, unless they are so narrow in cells that the
    /// lattice of the cells would be visible.
    pub(crate) fn fine(kernel: &Kernel, growth: f64) -> Self {
        let radius = |cells: CellSize| growth * kernel.radius() / cells.voxels();
        let gathered = |cells: &CellSize| radius(*cells) <= REACH * ROUNDING;
        let levels = || (0..=MAX_LEVEL).map(CellSize::of_level);
        let cells = levels().find(gathered).unwrap_or(CellSize::LARGEST);
        let deviation = growth * kernel.variance().sqrt() / cells.voxels();
        if deviation < SMOOTH_DEVIATION { Self::new(kernel, growth, Some(cells)) } else { Self { cells, step: None } }
    }

    /// Returns the number of voxels along an edge of a cell.
    pub(crate) fn size(self) -> f64 {
        self.cells.voxels()
    }

    /// Returns the growth, in cells, for which cells are blurred.
    fn blurred(self) -> Option<f64> {
        self.step.map(|step| libm::exp2(f64::from(step) / STEPS))
    }

    /// Returns the kernel of cells, in cells, given the kernel of voxels and its growth.
    pub(crate) fn kernel(self, voxels: &Kernel, growth: f64) -> Kernel {
        match self.blurred() {
            Some(blurred) => KERNEL.grown((growth / (self.size() * blurred)).max(1.0)),
            None => voxels.grown(growth / self.size()),
        }
    }

    /// Returns the lattice of the cells.
    pub(crate) fn grid(self, grid: &Grid) -> Result<Grid> {
        let dims = grid.dims().map(|n| self.cells.cells(n));
        let mut to_world = grid.to_world();
        let half = |dims: [u32; 3]| DVec3::from_array(dims.map(|n| f64::from(n - 1) / 2.0));
        to_world.translation = to_world.transform_point3(half(grid.dims()) - self.size() * half(dims));
        to_world.matrix3 *= self.size();
        Ok(Grid::new(dims, to_world)?)
    }

    /// Returns the filters that make these cells of voxels with this kernel.
    pub(crate) fn filters(self, kernel: &Kernel, grid: &Grid) -> Filters {
        let blurred = self.blurred();
        let blur = blurred.map_or_else(|| vec![1.0], |growth| blur(kernel, growth, self.cells).to_vec());
        let before = grid.dims().map(|voxels| {
            let cells = self.cells.cells(voxels);
            (f64::from(cells) * self.size() - f64::from(voxels)) / 2.0
        });
        let filters = Filters::new(self.cells, before, &blur);
        let farther = blurred.map_or(0.0, |growth| self.size() * (kernel.radius() * growth - KERNEL.radius()));
        Filters { beside: farther.ceil().max(1.0) as i64, ..filters }
    }
}

/// Returns the sizes of cells of scalars. Between whole levels only the smallest is worth it, because farther away rays
/// are short: with cells of 12 voxels a sphere erred by 1.0 of 255, with cells of 8 by 0.5.
pub(crate) fn sizes() -> impl Iterator<Item = CellSize> {
    CellSize::all().filter(|size| *size < CellSize::of_level(1) || *size == size.whole())
}

/// Returns the least growth of kernels of voxels that cells stand for.
pub(crate) fn least_growth(kernel: &Kernel, cells: CellSize) -> f64 {
    LEAST_DEVIATION / kernel.variance().sqrt() * cells.voxels()
}

/// Returns the growth of kernels of voxels from which on cells stand for them, unless a level is requested.
pub(crate) fn right_growth(kernel: &Kernel, cells: CellSize) -> f64 {
    let finer = sizes().take_while(|finer| *finer < cells).last().unwrap_or(CellSize::VOXEL);
    growth_of_wide(kernel, 1.0, cells, finer).max(least_growth(kernel, cells))
}

/// Returns the weights along each axis, from the middle one on, by which [`KERNEL`] is blurred to a grown kernel: by
/// least squares over frequencies along an axis and both kinds of diagonals.
fn blur(kernel: &Kernel, growth: f64, cells: CellSize) -> [f64; 4] {
    /// The number of frequencies, in steps of a tenth of a radian: up to the next images of the lattice.
    const FREQUENCIES: u32 = 60;
    let (mut squares, mut wanted) = (DMat3::ZERO, DVec3::ZERO);
    for frequency in (1..=FREQUENCIES).map(|n| f64::from(n) / 10.0) {
        let cell = transform(&KERNEL, frequency);
        // The cell keeps nothing of such waves.
        if cell < 0.02 {
            break;
        }
        let ratio = (transform(kernel, growth * frequency) / cell).max(0.0);
        for axes in [1.0, 2.0, 3.0_f64] {
            // The frequency along each axis, and the factor that the weights of one axis should have.
            let along = frequency / axes.sqrt();
            let factor = libm::pow(ratio, axes.recip());
            let importance = (axes * cell * libm::pow(factor.max(0.05), axes - 1.0)).powi(2);
            let kept = response(cells, along);
            let waves = DVec3::new(1.0, 2.0, 3.0).map(|n| 2.0 * libm::cos(n * along) - 2.0) * kept;
            squares += DMat3::from_cols(waves * waves.x, waves * waves.y, waves * waves.z) * importance;
            wanted += waves * (importance * (factor - kept));
        }
    }
    let beside = squares.inverse() * wanted;
    [1.0 - 2.0 * beside.element_sum(), beside.x, beside.y, beside.z]
}

/// Returns the Fourier transform of a kernel at a frequency over 0, in radians per voxel, divided by the transform at
/// 0.
fn transform(kernel: &Kernel, frequency: f64) -> f64 {
    const SHELLS: u32 = 512;
    let (mut sum, mut whole) = (0.0, 0.0);
    for shell in 0..SHELLS {
        let r = kernel.radius() * (f64::from(shell) + 0.5) / f64::from(SHELLS);
        let area = kernel.value(r * r) * r * r;
        sum += area * libm::sin(frequency * r) / (frequency * r);
        whole += area;
    }
    sum / whole
}

/// Returns whether regions of one value are visible: over a twentieth of the visible voxels, in planes and rows far
/// apart, are runs of equal samples. Light shows the direction of the smallest gradient, and there cells have other
/// gradients than voxels.
pub(crate) fn has_plateaus(volume: &Volume, transfer: &TransferFunction) -> Result<bool> {
    const PLANES: usize = 8;
    const RUN: usize = 5;
    let [nx, ny, nz] = volume.grid().dims().map(|n| n as usize);
    let (slope, intercept) = volume.rescale();
    let shows = |sample: f64| !transfer.is_invisible([slope * sample + intercept; 2]);
    let (mut shown, mut equal) = (0_u64, 0_u64);
    for plane in (0..PLANES).map(|n| (2 * n + 1) * nz / (2 * PLANES)) {
        let samples = volume.read(plane * nx * ny..(plane + 1) * nx * ny)?;
        with_samples!(&samples, s => {
            for run in s.chunks_exact(nx).step_by(4).flat_map(|row| row.windows(RUN)) {
                let shows = shows(run[0].to_f64());
                shown += u64::from(shows);
                equal += u64::from(shows && run.iter().all(|sample| *sample == run[0]));
            }
        });
    }
    Ok(20 * equal > shown)
}

/// The filters that make cells of the voxels of a volume.
pub(crate) struct Filters {
    axes: [Filter; 3],
    /// The number of voxels to either side of a cell on which its gradients depend although its kernel does not.
    beside: i64,
}

/// The scalars of cells along a row of bricks.
pub(crate) struct CellStrip {
    /// The first cell of the strip.
    first: [i64; 3],
    /// The number of cells along each axis.
    size: [usize; 3],
    scalars: Vec<f32>,
    /// Whether all voxels around a cell are equal; empty if no gradients are needed.
    flat: Vec<bool>,
}

impl Filters {
    /// Makes the filters of cells. The first cell begins `before` voxels before the volume along each axis. Cells are
    /// blurred by the weights `blur`, from the middle one on.
    pub(crate) fn new(cells: CellSize, before: [f64; 3], blur: &[f64]) -> Self {
        Self { axes: before.map(|before| Filter::new(cells, before, blur, 0)), beside: 1 }
    }

    /// Returns the filters in the form that the device reads, for a lattice of `dims` cells with this filter of
    /// gradients.
    pub(crate) fn on_device(&self, dims: [u32; 3], slopes: Slopes) -> CellFilters<'_> {
        let (size, ..) = self.axes[0].parts();
        let axes = self.axes.each_ref().map(|axis| {
            let (_, first, weights) = axis.parts();
            (first, weights)
        });
        CellFilters { dims, size, axes, beside: self.beside, slopes }
    }

    /// Returns the hull of the cells in which any of these voxels of an axis have weights.
    pub(crate) fn cells(&self, axis: usize, voxels: Range<i64>) -> Range<i64> {
        self.axes[axis].around(voxels)
    }

    /// Returns the voxels with weights in a range of cells along an axis, copies beyond the faces included.
    pub(crate) fn voxels(&self, axis: usize, cells: Range<i64>) -> Range<i64> {
        self.axes[axis].voxels(cells.start, cells.end)
    }

    /// Makes the cells of a volume from `first` to before `end`.
    pub(crate) fn strip(
        &self,
        volume: &Volume,
        relative: &Relative,
        [first, end]: [[i64; 3]; 2],
        gradients: bool,
    ) -> Result<CellStrip> {
        let size = [0, 1, 2].map(|axis| (end[axis] - first[axis]).max(0) as usize);
        let dims = volume.grid().dims().map(|n| n as usize);
        let [nx, ny, _] = dims;
        let [across, down, deep] = size;
        let taken = [0, 1, 2].map(|axis| self.axes[axis].taken(first[axis]..end[axis], dims[axis]));
        let [columns, rows, planes] = [0, 1, 2].map(|axis| span(&taken[axis]));
        let width = columns.len();
        let mut scalars = filled(across * down * deep, 0.0)?;
        let mut row = filled(width, 0.0)?;
        // A plane in which rows are cells and columns still voxels, and a plane of cells.
        let mut tall = filled(width * down, 0.0)?;
        let mut plane = filled(across * down, 0.0)?;
        let blocks = [0, 1, 2].map(|axis| self.axes[axis].blocks(first[axis]..end[axis], self.beside, dims[axis]));
        let mut ranges = filled(if gradients { across * down * deep } else { 0 }, NONE)?;
        let mut tall_ranges = filled(if gradients { width * down } else { 0 }, NONE)?;
        for z in planes {
            tall.fill(0.0);
            tall_ranges.fill(NONE);
            let at = |y: usize| (z * ny + y) * nx;
            let samples = volume.read(at(rows.start)..at(rows.end))?;
            for y in rows.clone() {
                let start = at(y) - at(rows.start);
                with_samples!(&samples, s => {
                    let samples = &s[start + columns.start..start + columns.end];
                    row.iter_mut().zip(samples).for_each(|(scalar, sample)| *scalar = relative.to(sample.to_f64()));
                });
                for (cells, weight) in tall.chunks_exact_mut(width).zip(weights(&taken[1], y)) {
                    add(cells, weight, &row);
                }
                let ranges = tall_ranges.chunks_exact_mut(width).zip(&blocks[1]);
                for (ranges, _) in ranges.filter(|(_, block)| block.contains(&y)) {
                    ranges.iter_mut().zip(&row).for_each(|(range, &scalar)| *range = hull(*range, [scalar; 2]));
                }
            }
            for (cells, voxels) in plane.chunks_exact_mut(across).zip(tall.chunks_exact(width)) {
                for (cell, (first, weights)) in cells.iter_mut().zip(&taken[0]) {
                    let voxels = &voxels[first - columns.start..];
                    *cell = weights.iter().zip(voxels).map(|(weight, voxel)| weight * voxel).sum();
                }
            }
            for (cells, weight) in scalars.chunks_exact_mut(plane.len()).zip(weights(&taken[2], z)) {
                add(cells, weight, &plane);
            }
            let cells = ranges.chunks_exact_mut((across * down).max(1)).zip(&blocks[2]);
            for (cells, _) in cells.filter(|(_, block)| block.contains(&z)) {
                for (cells, voxels) in cells.chunks_exact_mut(across).zip(tall_ranges.chunks_exact(width)) {
                    for (cell, block) in cells.iter_mut().zip(&blocks[0]) {
                        let block = block.start - columns.start..block.end - columns.start;
                        *cell = voxels[block].iter().fold(*cell, |range, &voxel| hull(range, voxel));
                    }
                }
            }
        }
        let flat = ranges.iter().map(|[low, high]| low == high).collect();
        Ok(CellStrip { first, size, scalars, flat })
    }
}

/// Returns the hull of the voxels with weights in cells, see [`Filter::taken`].
fn span(taken: &[(usize, Vec<f32>)]) -> Range<usize> {
    let ends = taken.iter().map(|(first, weights)| [*first, first + weights.len()]);
    ends.reduce(|hull, [first, end]| [hull[0].min(first), hull[1].max(end)]).map_or(0..0, |[first, end]| first..end)
}

/// Returns the weight of a voxel in each cell.
fn weights(taken: &[(usize, Vec<f32>)], voxel: usize) -> impl Iterator<Item = f32> {
    let weight = move |(first, weights): &(usize, Vec<f32>)| weights.get(voxel.checked_sub(*first)?).copied();
    taken.iter().map(move |cell| weight(cell).unwrap_or(0.0))
}

/// Returns a vector of `count` equal values, or an error if there is no memory.
fn filled<T: Copy>(count: usize, value: T) -> Result<Vec<T>> {
    let mut values = reserved(count as u64, || "the cells of a row of bricks".to_owned())?;
    values.resize(count, value);
    Ok(values)
}

/// Adds values times a weight to sums.
fn add(sums: &mut [f32], weight: f32, values: &[f32]) {
    if weight != 0.0 {
        dispatch(Sum { sums, weight, values });
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

/// The empty range of scalars.
const NONE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// Returns the hull of two ranges of scalars.
fn hull(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [if b[0] < a[0] { b[0] } else { a[0] }, if b[1] > a[1] { b[1] } else { a[1] }]
}

impl CellStrip {
    /// Returns the 32^3 cells from `first` on with `halo` cells around them, x fastest.
    pub(crate) fn brick(&self, first: [i64; 3], halo: usize) -> Vec<f32> {
        self.part(&self.scalars, first, halo)
    }

    /// Returns for each of the 32^3 cells from `first` on whether all voxels around it are equal, so that it has no
    /// gradient. Negative weights would give it a remainder of farther voxels, and light shows the direction of the
    /// smallest gradient.
    pub(crate) fn flat(&self, first: [i64; 3]) -> Vec<bool> {
        if self.flat.is_empty() { Vec::new() } else { self.part(&self.flat, first, 0) }
    }

    fn part<T: Copy>(&self, all: &[T], first: [i64; 3], halo: usize) -> Vec<T> {
        let edge = EDGE + 2 * halo;
        let [x, y, z] = [0, 1, 2].map(|axis| (first[axis] - halo as i64 - self.first[axis]) as usize);
        let mut cells = Vec::with_capacity(edge * edge * edge);
        for k in z..z + edge {
            for j in y..y + edge {
                cells.extend_from_slice(&all[x + self.size[0] * (j + self.size[1] * k)..][..edge]);
            }
        }
        cells
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::ControlPoint;
    use crate::transfer::scalars::Reduction;

    /// Returns the scalars of cells of a level of a volume of `value` at each voxel, from `first` to before `end`.
    fn cells(dims: [usize; 3], value: impl Fn([usize; 3]) -> f32, level: u32, ends: [[i64; 3]; 2]) -> Vec<f32> {
        let points = (0..dims.iter().product()).map(|i| [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])]);
        let samples: Vec<f32> = points.map(value).collect();
        let volume = Volume::from_slice(dims.map(|d| d as u32), [1.0; 3], &samples).unwrap();
        let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
        let transfer = TransferFunction::new(vec![point(0.0, 0.0), point(1.0, 1.0)], None).unwrap();
        let relative = Relative::new(&volume, Reduction::new(&transfer, 1.0));
        Filters::new(CellSize::of_level(level), [0.0; 3], &[1.0])
            .strip(&volume, &relative, ends, false)
            .unwrap()
            .scalars
    }

    #[test]
    fn cells_keep_the_sum_the_centre_and_the_spread_of_voxels() {
        let dims = [41, 37, 50];
        let inside = |p: [usize; 3]| (0..3).all(|a| p[a] >= 12 && p[a] + 12 < dims[a]);
        let value = |p: [usize; 3]| if inside(p) { ((p[0] * 7 + p[1] * 5 + p[2] * 3) % 11) as f32 } else { 0.0 };
        let mut expected = None;
        for level in 0..=3 {
            let size = f64::from(level).exp2();
            // Farther than any voxel gives.
            let first = [-6; 3];
            let end = dims.map(|d| d.div_ceil(1 << level) as i64 + 6);
            let across = (end[0] - first[0]) as usize;
            let mut sums = [0.0; 3];
            for (i, cell) in cells(dims, value, level, [first, end]).into_iter().enumerate() {
                let place = ((i % across) as f64 + first[0] as f64 + 0.5) * size - 0.5;
                (0..)
                    .zip(&mut sums)
                    .for_each(|(power, sum)| *sum += f64::from(cell) * size.powi(3) * place.powi(power));
            }
            let expected = *expected.get_or_insert(sums);
            for (got, expected) in sums.into_iter().zip(expected) {
                assert!((got / expected - 1.0).abs() < 1e-4, "level {level}: {got} {expected}");
            }
        }
    }

    #[test]
    fn cells_beyond_the_faces_are_copies_of_the_outermost_voxels() {
        // An odd number of voxels, which differ up to the faces.
        let dims = [7, 5, 3];
        for level in 1..=4 {
            let end = (7 >> level) + 9;
            let row = cells(dims, |[x, ..]| x as f32, level, [[-8, 0, 0], [end, 1, 1]]);
            assert!(row[..4].iter().all(|cell| cell.abs() < 1e-5), "level {level}: {row:?}");
            assert!(row[row.len() - 4..].iter().all(|cell| (cell - 6.0).abs() < 1e-5), "level {level}: {row:?}");
        }
    }

    #[test]
    fn fine_cells_are_the_finest_that_rays_gather() {
        for kernel in [Kernel::default(), Kernel::Gaussian { sigma: 0.5, radius: 1.0 }, Kernel::KAISER_BESSEL] {
            for growth in [1.0, 2.0, 2.1, 3.9, 5.0, 17.0] {
                let cells = Coarse::fine(&kernel, growth);
                assert!(cells.kernel(&kernel, growth).radius() <= REACH * ROUNDING, "{kernel} {growth} {cells:?}");
                let finer = (0..).map(CellSize::of_level).take_while(|finer| *finer < cells.cells).last();
                let gathered = |finer: CellSize| kernel.radius() * growth / finer.voxels() <= REACH;
                assert!(!finer.is_some_and(gathered), "{kernel} {growth} {cells:?}");
            }
        }
    }
}
