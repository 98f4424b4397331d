//! coarse: the scalars of cells, for post-shading along parallel rays of kernels that are wider than rays gather. On
//! the host, from the samples as they are asked for, brick by brick: no volume of cells is kept.
//!
//! A cell stands for 2^n voxels along each axis, as for pre-shading (cells.rs): voxels are shared by the same weights,
//! which keep their moments. A kernel that is broader than rays gather is two: a blur that the cells get, and a kernel
//! of what is left of its variance. The lattice of cells has its middle in that of the voxels, and voxels beyond a face
//! are copies of the outermost one.

use std::ops::Range;

use glam::DVec3;

use super::cells::{Filter, LEAST_DEVIATION, MAX_LEVEL, kernel_of_deviation};
use super::scalars::Relative;
use crate::error::Result;
use crate::kernel::Kernel;
use crate::memory::reserved;
use crate::volume::{BRICK_EDGE as EDGE, Grid, ToF64, Volume, with_samples};

/// The largest standard deviation of the kernels of cells, in cells: such a kernel is small two cells away.
const MOST_DEVIATION: f64 = 0.78;

/// The variances that cells are blurred by are multiples of this, cells^2: what is between is left to kernels.
const BLUR: f64 = MOST_DEVIATION * MOST_DEVIATION - LEAST_DEVIATION * LEAST_DEVIATION;

/// Which cells stand for voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Coarse {
    pub(crate) level: u32,
    /// How often they are blurred by a variance of [`BLUR`].
    blurs: u32,
}

impl Coarse {
    /// The cells for kernels of a standard deviation in voxels, of the coarsest level that has such kernels or of the
    /// one asked for.
    pub(crate) fn new(deviation: f64, level: Option<u32>) -> Self {
        // To within rounding: see `cells::level_of`.
        let most = (1.0001 * deviation / LEAST_DEVIATION).log2().floor().clamp(0.0, f64::from(MAX_LEVEL));
        let level = level.unwrap_or(most as u32);
        let cells = deviation / f64::from(level).exp2();
        let blurs = ((cells * cells - MOST_DEVIATION * MOST_DEVIATION) / BLUR - 1e-3).ceil().max(0.0);
        Self { level, blurs: blurs as u32 }
    }

    /// Voxels along an edge of a cell.
    pub(crate) fn size(self) -> f64 {
        f64::from(self.level).exp2()
    }

    /// The kernel of cells, in cells, that shows them as kernels of that standard deviation show voxels.
    pub(crate) fn kernel(self, deviation: f64) -> Kernel {
        let cells = deviation / self.size();
        let left = cells * cells - f64::from(self.blurs) * BLUR;
        kernel_of_deviation(left.max(LEAST_DEVIATION * LEAST_DEVIATION).sqrt())
    }

    /// The lattice of the cells.
    pub(crate) fn grid(self, grid: &Grid) -> Result<Grid> {
        let dims = grid.dims().map(|n| n.div_ceil(1 << self.level));
        let mut to_world = grid.to_world();
        let half = |dims: [u32; 3]| DVec3::from_array(dims.map(|n| f64::from(n - 1) / 2.0));
        to_world.translation = to_world.transform_point3(half(grid.dims()) - self.size() * half(dims));
        to_world.matrix3 *= self.size();
        Grid::new(dims, to_world)
    }

    /// Gradients of cells are sums of differences of cells so far apart, times these: they are what cells make of the
    /// central differences of voxels, up to the fifth derivative.
    pub(crate) fn differences(self) -> [f64; 3] {
        let square = self.size().powi(-2);
        let nodes = [1.0, 4.0, 9.0];
        nodes.map(|node: f64| {
            let others = nodes.into_iter().filter(|&other| other != node);
            others.map(|other| (square - other) / (node - other)).product::<f64>() / (2.0 * node.sqrt())
        })
    }

    /// What voxels give to cells along an axis of so many voxels.
    fn filter(self, voxels: u32) -> Filter {
        let cells = voxels.div_ceil(1 << self.level);
        let before = (f64::from(cells) * self.size() - f64::from(voxels)) / 2.0;
        Filter::new(self.level, before, &blur(f64::from(self.blurs) * BLUR), 0)
    }
}

/// The weights of a blur of a variance, from the middle one on. They have the moments of a Gaussian, up to the seventh.
fn blur(variance: f64) -> Vec<f64> {
    let sampled = variance > 1.0;
    let reach = if sampled { (4.0 * variance.sqrt()).ceil() as i32 } else { 3 };
    let weight = |k: i32| {
        let square = f64::from(k * k);
        if sampled {
            return (-square / (2.0 * variance)).exp() / (2.0 * std::f64::consts::PI * variance).sqrt();
        }
        // Of the three weights, the sums of their even powers of k are those of a Gaussian.
        let others: Vec<f64> = [1.0, 4.0, 9.0].into_iter().filter(|&other| other != square).collect();
        let (sum, product): (f64, f64) = (others.iter().sum(), others.iter().product());
        let moments = variance * (15.0 * variance * variance - sum * 3.0 * variance + product);
        moments / (2.0 * square * others.iter().map(|other| square - other).product::<f64>())
    };
    let beside: Vec<f64> = (1..=reach).map(weight).collect();
    let middle = 1.0 - 2.0 * beside.iter().sum::<f64>();
    std::iter::once(middle).chain(beside).collect()
}

/// What makes cells of the voxels of a volume.
pub(super) struct Filters([Filter; 3]);

/// The scalars of cells along a row of bricks.
pub(super) struct CellStrip {
    /// The first cell.
    first: [i64; 3],
    /// Cells along each axis.
    size: [usize; 3],
    scalars: Vec<f32>,
}

impl Filters {
    pub(super) fn new(grid: &Grid, coarse: Coarse) -> Self {
        Self(grid.dims().map(|n| coarse.filter(n)))
    }

    /// The voxels that give to a range of cells along an axis, copies beyond the faces included.
    pub(super) fn voxels(&self, axis: usize, cells: Range<i64>) -> Range<i64> {
        self.0[axis].voxels(cells.start, cells.end)
    }

    /// The cells of a volume from `first` to before `end`.
    pub(super) fn strip(
        &self,
        volume: &Volume,
        relative: &Relative,
        first: [i64; 3],
        end: [i64; 3],
    ) -> Result<CellStrip> {
        let size = [0, 1, 2].map(|axis| (end[axis] - first[axis]).max(0) as usize);
        let dims = volume.grid().dims().map(i64::from);
        let [nx, ny, _] = dims;
        let [across, down, deep] = size;
        let voxels = self.voxels(0, first[0]..end[0]);
        let width = (voxels.end - voxels.start) as usize;
        let zeros = |count: usize| -> Result<Vec<f32>> {
            let mut zeros = reserved(count as u64, || "the cells of a row of bricks".to_owned())?;
            zeros.resize(count, 0.0);
            Ok(zeros)
        };
        let mut scalars = zeros(across * down * deep)?;
        let mut row = zeros(width)?;
        // A plane of voxels in which rows are cells already, and one of cells.
        let mut tall = zeros(width * down)?;
        let mut plane = zeros(across * down)?;
        let [rows, planes] = [1, 2].map(|axis| self.0[axis].shares(first[axis]..end[axis], dims[axis]));
        let (from, to) = (clamped(voxels.start, nx), clamped(voxels.end - 1, nx) + 1);
        for (z, of_plane) in planes {
            tall.fill(0.0);
            let [y, last] = [rows.first(), rows.last()].map(|row| row.map_or(0, |&(y, _)| y));
            let at = |y: i64| ((z * ny + y) * nx) as usize;
            let samples = volume.read(at(y)..at(last + 1))?;
            for (row_at, of_row) in &rows {
                let start = at(*row_at) - at(y);
                with_samples!(&samples, s => {
                    let inside = s[start + from as usize..start + to as usize].iter();
                    let copies = (from - voxels.start) as usize;
                    let count = inside.len();
                    row[copies..copies + count].iter_mut().zip(inside)
                        .for_each(|(scalar, sample)| *scalar = relative.to(sample.to_f64()));
                    let [before, behind] = [row[copies], row[copies + count - 1]];
                    row[..copies].fill(before);
                    row[copies + count..].fill(behind);
                });
                for &(cell, weight) in of_row {
                    add(&mut tall[cell * width..][..width], weight, &row);
                }
            }
            for (cells, voxels) in plane.chunks_exact_mut(across).zip(tall.chunks_exact(width)) {
                self.0[0].narrow(voxels, cells);
            }
            for (cell, weight) in of_plane {
                add(&mut scalars[cell * plane.len()..][..plane.len()], weight, &plane);
            }
        }
        Ok(CellStrip { first, size, scalars })
    }
}

/// The voxel of an axis of `n` voxels that is nearest to `place`.
fn clamped(place: i64, n: i64) -> i64 {
    place.clamp(0, n - 1)
}

fn add(sums: &mut [f32], weight: f32, values: &[f32]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
}

impl CellStrip {
    /// The cells around `first`, with `halo` cells around 32^3 of them, x fastest.
    pub(super) fn brick(&self, first: [i64; 3], halo: usize) -> Vec<f32> {
        let edge = EDGE + 2 * halo;
        let [x, y, z] = [0, 1, 2].map(|axis| (first[axis] - halo as i64 - self.first[axis]) as usize);
        let mut cells = Vec::with_capacity(edge * edge * edge);
        for k in z..z + edge {
            for j in y..y + edge {
                cells.extend_from_slice(&self.scalars[x + self.size[0] * (j + self.size[1] * k)..][..edge]);
            }
        }
        cells
    }
}
