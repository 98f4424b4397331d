//! cells: a volume and a transfer function to classified cells of a level, for pre-shading with grown kernels (Laur and
//! Hanrahan 1991, "Hierarchical splatting"). On the host: it is memory traffic rather than arithmetic.
//!
//! A cell of level n stands for 2^n voxels along each axis. Voxels are classified and lit one by one. A cell holds the
//! light that they emit and absorb, weighted by the polynomials of degree 5 that interpolate cells at the places of
//! voxels (Lagrange). So the moments of each voxel are kept up to the fifth. Weights farther than a cell away are
//! negative, so a cell may absorb a little less than nothing.
//!
//! Cells have no normals: lit by a mean normal, uniform matter erred by 20 of 255 and folds finer than a cell by 30. So
//! cells are made anew if a light or the eye moves.

mod classification;
mod filter;

use std::ops::Range;

use glam::{DVec3, Vec3};

use self::filter::REACH;
use super::shadows::{Places, shares_at};
use crate::error::Result;
use crate::gpu::classify::gradients;
use crate::gpu::context::Context;
use crate::gpu::layout::{Lighting, Splat};
use crate::gpu::splat::{self, LANES, ToEye, packed_appearance, packed_normal};
use crate::gpu::store::{Drawable, MadeBrick, StoreBuilder};
use crate::gpu::transfer::{Reduction, Relative};
use crate::kernel::{DerivativeFilter, Kernel, NORMAL_REACH};
use crate::progress::Progress;
use crate::settings::MAX_LEVEL;
use crate::transfer::{TransferFunction, scaled_share};
use crate::volume::{BRICK_EDGE as EDGE, Grid, Samples, ToF64, Volume, with_samples};
use voxsplat_volume::memory::reserved;

pub(crate) use self::classification::{Classification, ColorSource, Emission};
pub(crate) use self::filter::{Filter, response};

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

/// The coarsest level whose cells are accurate for voxels with grown kernels, given the optical depth of a voxel; 0
/// stands for the voxels. At the coarsest level of all, one cell holds the volume.
pub(crate) fn level_of(kernel: &Kernel, growth: f64, grid: &Grid, depth: f64) -> u32 {
    let one = grid.dims().into_iter().max().unwrap_or(1).next_power_of_two().ilog2();
    // The growth of a picture is often 1.5, to within rounding.
    let is_right = |level: &u32| right_growth(kernel, *level, depth) <= 1.0001 * growth;
    (1..=one.min(MAX_LEVEL)).take_while(is_right).last().unwrap_or(0)
}

/// The growth of kernels from which on cells of a level are accurate, given the optical depth of a voxel.
///
/// Cells ring beside edges by a few hundredths of their optical depth. Denser cells ring more visibly, and kernels that
/// are wide beside cells smooth the ringing. Measured on noise, boxes, specks, balls, shells and tubes:
/// docs/measurements/2026-11-23-levels.md.
pub(crate) fn right_growth(kernel: &Kernel, level: u32, depth: f64) -> f64 {
    let denser = (depth * f64::from(level).exp2() / THIN).max(1.0);
    least_growth(kernel, level) * denser.powf(DENSER)
}

/// The least growth of kernels that cells of a level can have.
pub(crate) fn least_growth(kernel: &Kernel, level: u32) -> f64 {
    least_deviation(kernel) * f64::from(level).exp2() / kernel.variance().sqrt()
}

/// The least standard deviation of the kernels of cells that stand for voxels of this kernel, in cells.
fn least_deviation(kernel: &Kernel) -> f64 {
    let wide = WIDEST / 2.0 * kernel.variance().sqrt() / kernel.radius();
    wide.clamp(LEAST_DEVIATION_OF_WIDE, LEAST_DEVIATION)
}

/// The kernel of cells of a level, in cells: as broad as the grown kernel of voxels, whose growth is at least
/// [`least_growth`].
pub(crate) fn kernel_of(kernel: &Kernel, growth: f64, level: u32) -> Kernel {
    let grown = kernel.grown(growth / f64::from(level).exp2());
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

/// The lattice of the cells of a level: cell [`REACH`] lies in the middle of the first 2^n voxels along each axis, and
/// [`REACH`] cells lie beyond each face.
pub(crate) fn grid_of(grid: &Grid, level: u32) -> Result<Grid> {
    let size = f64::from(level).exp2();
    let mut to_world = grid.to_world();
    to_world.translation = to_world.transform_point3(DVec3::splat((size - 1.0) / 2.0 - size * REACH as f64));
    to_world.matrix3 *= size;
    Ok(Grid::new(dims_of(grid, level).map(|d| d as u32), to_world)?)
}

fn dims_of(grid: &Grid, level: u32) -> [usize; 3] {
    grid.dims().map(|d| d.div_ceil(1 << level) as usize + 2 * REACH)
}

/// The light of one picture on voxels that become cells; it depends on the eye.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VoxelLight {
    pub(crate) lighting: Lighting,
    /// The number of lights.
    pub(crate) lights: u32,
    /// Whether a light has a position.
    pub(crate) points: bool,
    pub(crate) to_eye: ToEye,
}

/// Makes the cells of a level of a volume.
pub(crate) struct Coarsening<'a> {
    volume: &'a Volume,
    filter: Filter,
    classification: Classification<'a>,
    /// The light on voxels and the shares of it that arrive; `None`: voxels are unlit.
    light: Option<(&'a VoxelLight, Option<&'a Places<'a>>)>,
    /// Gradients, if light or opacity depends on them.
    steepness: Option<Steepness>,
    /// Cells along each axis.
    dims: [usize; 3],
    /// Cells of a lower density are left out.
    least: f32,
}

/// The inputs of gradients and what depends on them.
struct Steepness {
    scalars: Relative,
    /// World gradients of the lattice coordinates.
    gradients: [Vec3; 3],
    /// Gradient opacity, of gradients of scalars; empty: extinction does not depend on them.
    thinning: Vec<[f32; 2]>,
    /// The filter of normals; `None`: voxels are unlit.
    normals: Option<DerivativeFilter>,
}

impl Steepness {
    /// The rows and planes to either side that a voxel depends on.
    fn reach(&self) -> usize {
        if self.normals.is_some() { NORMAL_REACH } else { 1 }
    }
}

/// The least density of a cell that is kept, as a share of the largest of a voxel.
const LEAST: f64 = 1.0 / 1024.0;

impl<'a> Coarsening<'a> {
    pub(crate) fn new(
        volume: &'a Volume,
        transfer: &'a TransferFunction,
        level: u32,
        light: Option<(&'a VoxelLight, Option<&'a Places<'a>>)>,
    ) -> Self {
        let reduction = Reduction::new(transfer, 1.0);
        let scale = reduction.factor() * volume.grid().unit();
        let thinning = transfer.scaled_gradient_opacity(scale);
        let steep = light.is_some() || !thinning.is_empty();
        let gradients = gradients(volume).map(Vec3::from_array);
        Self {
            volume,
            filter: Filter::new(level, 0.0, &[1.0], REACH),
            classification: Classification::new(volume, ColorSource::Transfer(transfer), 1.0),
            light,
            steepness: steep.then(|| Steepness {
                scalars: Relative::new(volume, reduction),
                gradients,
                thinning,
                normals: light.is_some().then(DerivativeFilter::of_normals),
            }),
            dims: dims_of(volume.grid(), level),
            least: (TransferFunction::extinction(transfer.max_opacity(), 1.0) * LEAST) as f32,
        }
    }

    /// The cells as splats.
    pub(crate) fn emit(&self, context: &Context, progress: &Progress) -> Result<Drawable> {
        let mut stores = StoreBuilder::new(context, size_of::<Splat>() as u64, u32::MAX);
        // The rows that a row of bricks reads, beyond the rows of a brick of voxels.
        let halo = (self.filter.voxels(0, EDGE as i64).count() - EDGE).div_ceil(2);
        let counts = self.dims.map(|n| n.div_ceil(EDGE));
        stores.push_rows(self.volume, counts, halo, (progress, "classifying"), &|j, k| self.row([j, k]))?;
        let cells = stores.finish()?;
        context.wait("classifying the volume")?;
        Ok(cells)
    }

    /// The bricks with cells along x, with these numbers in y and z.
    fn row(&self, [j, k]: [usize; 2]) -> Result<Vec<MadeBrick>> {
        let [across, down, deep] = self.dims;
        let [ys, zs] = [(j, down), (k, deep)].map(|(brick, n)| brick * EDGE..n.min((brick + 1) * EDGE));
        let [nx, ny, nz] = self.volume.grid().dims().map(i64::from);
        let within = |cells: &Range<usize>, n: i64| {
            let voxels = self.filter.voxels(cells.start as i64, cells.end as i64);
            voxels.start.clamp(0, n)..voxels.end.clamp(0, n)
        };
        let rows = within(&ys, ny);
        // The cells of the row of bricks, and a plane of cells for the voxels of one plane.
        let mut cells = filled(across * ys.len() * zs.len(), [0.0; 4])?;
        let mut plane = filled(across * ys.len(), [0.0; 4])?;
        let mut slices = Slices { coarsening: self, rows: rows.clone(), slices: Vec::new() };
        // A row with room for empty voxels before the first and behind the last.
        let all = self.filter.voxels(0, across as i64);
        let mut voxels = vec![[0.0; 4]; (all.end - all.start) as usize];
        let begin = (-all.start) as usize;
        let mut narrow = vec![[0.0; 4]; across];
        for z in within(&zs, nz) {
            slices.advance(z)?;
            let mut shows = false;
            for y in rows.clone() {
                let inside = &mut voxels[begin..begin + nx as usize];
                let shown = slices.classify([y, z], inside);
                if shown.is_empty() {
                    continue;
                }
                shows = true;
                slices.apply_gradients([y, z], shown.clone(), inside);
                let reached = self.filter.reached(&shown, across);
                let narrow = &mut narrow[reached.clone()];
                let start = reached.start * self.filter.size();
                self.filter.gather(&voxels[start..], narrow);
                for (cell, weight) in self.filter.cells(y, ys.start, ys.end) {
                    let sums = &mut plane[(cell - ys.start) * across + reached.start..];
                    add(sums.as_flattened_mut(), weight, narrow.as_flattened());
                }
            }
            if shows {
                for (cell, weight) in self.filter.cells(z, zs.start, zs.end) {
                    let sums = &mut cells[(cell - zs.start) * plane.len()..];
                    add(sums.as_flattened_mut(), weight, plane.as_flattened());
                }
                plane.fill([0.0; 4]);
            }
        }
        let mut bricks: Vec<_> =
            (0..across.div_ceil(EDGE)).map(|i| self.brick(&cells, [i, j, k])).collect::<Result<_>>()?;
        bricks.retain(|made| made.splats.count() > 0);
        Ok(bricks)
    }

    /// The splats of a brick, given the cells of its row of bricks.
    fn brick(&self, cells: &[Emission], brick: [usize; 3]) -> Result<MadeBrick> {
        let [across, down, _] = self.dims;
        let down = EDGE.min(down - brick[1] * EDGE);
        let origin = brick.map(|b| (b * EDGE) as u32);
        MadeBrick::of_rows(origin, self.dims.map(|n| n as u32), 2, |[y, z], count, words| {
            let start = across * (y + down * z) + brick[0] * EDGE;
            let mut bits = 0;
            for (x, cell) in cells[start..start + count].iter().enumerate() {
                let [r, g, b, density] = *cell;
                if density.abs() > self.least {
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
        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
    }
}

/// A few planes of some rows of voxels; for gradients also the rows and planes beside them.
struct Slices<'a> {
    coarsening: &'a Coarsening<'a>,
    rows: Range<i64>,
    slices: Vec<Slice>,
}

struct Slice {
    z: i64,
    /// The first row.
    first: i64,
    samples: Samples,
    /// Scalars of all rows for gradient opacity, with the outermost of a row repeated as far as gradients reach.
    scalars: Vec<f32>,
    /// Scalars of the rows that are lit: slopes along x, slopes along y, and smoothed, each smoothed along the other
    /// axis of the plane.
    filtered: [Vec<f32>; 3],
}

impl Slices<'_> {
    /// Reads the plane `z`: the first, or the one after the plane before.
    fn advance(&mut self, z: i64) -> Result<()> {
        let Coarsening { volume, steepness, .. } = self.coarsening;
        let [nx, ny, nz] = volume.grid().dims().map(i64::from);
        let reach = steepness.as_ref().map_or(0, Steepness::reach);
        let beside = reach as i64;
        self.slices.retain(|slice| slice.z >= z - beside);
        let first = (self.rows.start - beside).max(0);
        let end = (self.rows.end + beside).min(ny);
        for z in (z - beside).max(0)..=(z + beside).min(nz - 1) {
            if self.slices.iter().any(|slice| slice.z == z) {
                continue;
            }
            let samples = volume.read(((z * ny + first) * nx) as usize..((z * ny + end) * nx) as usize)?;
            let (mut scalars, mut filtered) = (Vec::new(), Default::default());
            if let Some(Steepness { scalars: of, normals, .. }) = steepness {
                let width = nx as usize + 2 * reach;
                scalars = reserved((end - first) as u64 * width as u64, || "scalars of a plane".to_owned())?;
                with_samples!(&samples, s => for row in s.chunks_exact(nx as usize) {
                    let copies = |at: usize| std::iter::repeat_n(of.to(row[at].to_f64()), reach);
                    scalars.extend(copies(0));
                    scalars.extend(row.iter().map(|sample| of.to(sample.to_f64())));
                    scalars.extend(copies(row.len() - 1));
                });
                if let Some(normals) = normals {
                    filtered = self.filtered(normals, &scalars, nx as usize, first)?;
                }
            }
            self.slices.push(Slice { z, first, samples, scalars, filtered });
        }
        Ok(())
    }

    /// Filters the rows of a plane that are lit along x and y. `scalars` has the rows from `first` on.
    fn filtered(&self, normals: &DerivativeFilter, scalars: &[f32], nx: usize, first: i64) -> Result<[Vec<f32>; 3]> {
        let width = nx + 2 * NORMAL_REACH;
        let rows = scalars.len() / width;
        let [mut sloping, mut smooth] = [filled(rows * nx, 0.0)?, filled(rows * nx, 0.0)?];
        let each = sloping.chunks_exact_mut(nx).zip(smooth.chunks_exact_mut(nx));
        for (row, (sloping, smooth)) in scalars.chunks_exact(width).zip(each) {
            let taps = |k: isize| &row[NORMAL_REACH.saturating_add_signed(k)..][..nx];
            normals.slope(taps, sloping);
            normals.smooth(taps, smooth);
        }
        let count = (self.rows.end - self.rows.start) as usize * nx;
        let mut filtered = [filled(count, 0.0)?, filled(count, 0.0)?, filled(count, 0.0)?];
        let [x, y, smoothed] = &mut filtered;
        let each = x.chunks_exact_mut(nx).zip(y.chunks_exact_mut(nx)).zip(smoothed.chunks_exact_mut(nx));
        for (row, ((x, y), smoothed)) in self.rows.clone().zip(each) {
            // Rows beyond the faces are copies of the outermost.
            let at = |k: isize| (row - first + k as i64).clamp(0, rows as i64 - 1) as usize * nx;
            normals.smooth(|k| &sloping[at(k)..][..nx], x);
            normals.slope(|k| &smooth[at(k)..][..nx], y);
            normals.smooth(|k| &smooth[at(k)..][..nx], smoothed);
        }
        Ok(filtered)
    }

    /// Classifies a row. Returns a range outside which all voxels are transparent.
    fn classify(&self, [y, z]: [i64; 2], voxels: &mut [Emission]) -> Range<usize> {
        let Some(slice) = self.slices.iter().find(|slice| slice.z == z) else { return 0..0 };
        let count = voxels.len();
        let start = (y - slice.first) as usize * count;
        with_samples!(&slice.samples, s => self.coarsening.classification.row(&s[start..start + count], voxels))
    }

    /// Thins the voxels `shown` of a row by gradient opacity and lights them. Beyond the faces voxels are copies of the
    /// outermost.
    fn apply_gradients(&self, [y, z]: [i64; 2], shown: Range<usize>, voxels: &mut [Emission]) {
        let Some(steepness) = &self.coarsening.steepness else { return };
        for start in shown.clone().step_by(RUN) {
            let run = start..shown.end.min(start + RUN);
            if voxels[run.clone()].iter().all(|voxel| voxel[3] == 0.0) {
                continue;
            }
            if !steepness.thinning.is_empty() {
                let (_, magnitudes) = directions(steepness.gradients, self.differences(steepness, [y, z], &run));
                for (voxel, magnitude) in voxels[run.clone()].iter_mut().zip(magnitudes) {
                    let share = scaled_share(&steepness.thinning, magnitude);
                    voxel.iter_mut().for_each(|channel| *channel *= share);
                }
            }
            if let (Some((light, arriving)), Some(normals)) = (self.coarsening.light, &steepness.normals) {
                let slopes = self.slopes(normals, [y, z], &run, voxels.len());
                let (directions, _) = directions(steepness.gradients, slopes);
                let normal = |at: usize| packed_normal([0, 1, 2].map(|axis| directions[axis][at]));
                let normals = splat::normals(&std::array::from_fn(normal));
                let first = [run.start, y as usize, z as usize];
                let kept = arriving.map(|arriving| shares_at(arriving, first));
                light.apply(first, &normals, kept.as_ref(), &mut voxels[run]);
            }
        }
    }

    /// The plane at `z`, or the outermost beyond the faces.
    fn slice(&self, z: i64) -> Option<&Slice> {
        let [.., nz] = self.coarsening.volume.grid().dims().map(i64::from);
        let z = z.clamp(0, nz - 1);
        self.slices.iter().find(|slice| slice.z == z)
    }

    /// Central differences of a run of a row, on which gradient opacity depends.
    fn differences(&self, steepness: &Steepness, [y, z]: [i64; 2], run: &Range<usize>) -> [[f32; RUN]; 3] {
        let [nx, ny, _] = self.coarsening.volume.grid().dims().map(i64::from);
        let reach = steepness.reach();
        let width = nx as usize + 2 * reach;
        let row = |y: i64, z: i64| {
            let y = y.clamp(0, ny - 1);
            self.slice(z).map_or(&[][..], |slice| &slice.scalars[(y - slice.first) as usize * width..][..width])
        };
        let difference = |high: &[f32], low: &[f32], step: usize| {
            let mut differences = [0.0; RUN];
            let start = run.start + reach;
            let pairs = high[start + step..].iter().zip(&low[start - step..]);
            differences[..run.len()].iter_mut().zip(pairs).for_each(|(d, (high, low))| *d = 0.5 * (high - low));
            differences
        };
        let here = row(y, z);
        [
            difference(here, here, 1),
            difference(row(y + 1, z), row(y - 1, z), 0),
            difference(row(y, z + 1), row(y, z - 1), 0),
        ]
    }

    /// Slopes of a run of a row of `nx` voxels by the filter of normals.
    fn slopes(&self, normals: &DerivativeFilter, [y, z]: [i64; 2], run: &Range<usize>, nx: usize) -> [[f32; RUN]; 3] {
        let start = (y - self.rows.start) as usize * nx + run.start;
        let tap = |axis: usize| {
            move |k: isize| {
                let plane = self.slice(z + k as i64);
                plane.map_or(&[][..], |plane| &plane.filtered[axis][start..start + run.len()])
            }
        };
        let mut slopes = [[0.0; RUN]; 3];
        let [along_x, along_y, along_z] = slopes.each_mut().map(|slopes| &mut slopes[..run.len()]);
        normals.smooth(tap(0), along_x);
        normals.smooth(tap(1), along_y);
        normals.slope(tap(2), along_z);
        slopes
    }
}

impl VoxelLight {
    /// Lights up to [`RUN`] voxels of a row from a lattice point on.
    fn apply(
        &self,
        [x, y, z]: [usize; 3],
        normals: &splat::Normals,
        kept: Option<&[[f32; LANES]; 4]>,
        voxels: &mut [Emission],
    ) {
        let xs = std::array::from_fn(|at| (x + at) as u32);
        let (y, z) = (y as u32, z as u32);
        let mut colors = [[0.0; LANES]; 3];
        for (at, [r, g, b, density]) in voxels.iter().enumerate().filter(|(_, voxel)| voxel[3] > 0.0) {
            [colors[0][at], colors[1][at], colors[2][at]] = [r / density, g / density, b / density];
        }
        let to_eye = self.to_eye.at(&xs, y, z);
        let places = self.points.then(|| splat::places(&self.lighting, &xs, y, z));
        splat::light(&self.lighting, self.lights, &mut colors, normals, kept, places.as_ref(), &to_eye);
        for (at, voxel) in voxels.iter_mut().enumerate() {
            (0..3).for_each(|channel| voxel[channel] = colors[channel][at] * voxel[3]);
        }
    }
}

/// Voxels whose gradients are computed together.
const RUN: usize = LANES;

/// Converts slopes along the axes of the lattice to gradients in the world: directions of length 1 or 0, and
/// magnitudes.
fn directions([gx, gy, gz]: [Vec3; 3], [dx, dy, dz]: [[f32; RUN]; 3]) -> ([[f32; RUN]; 3], [f32; RUN]) {
    let mut directions = [[0.0; RUN]; 3];
    let mut magnitudes = [0.0; RUN];
    for at in 0..RUN {
        // Divided by the largest, no square leaves the range of f32.
        let most = dx[at].abs().max(dy[at].abs()).max(dz[at].abs());
        let scale = if most > f32::MIN_POSITIVE && most < f32::MAX { 1.0 / most } else { 0.0 };
        let gradient = gx * (scale * dx[at]) + gy * (scale * dy[at]) + gz * (scale * dz[at]);
        let square = gradient.length_squared();
        let length = square.sqrt();
        let unit = if length > 0.0 { gradient / length } else { Vec3::ZERO };
        magnitudes[at] = length * most;
        directions[0][at] = unit.x;
        directions[1][at] = unit.y;
        directions[2][at] = unit.z;
    }
    (directions, magnitudes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broad_kernels_of_cells_are_those_of_voxels() {
        for kernel in [Kernel::default(), Kernel::KAISER_BESSEL, Kernel::Gaussian { sigma: 1.2, radius: 3.0 }] {
            for (level, growth) in [(1, 3.0), (2, 6.0), (3, 30.0)] {
                assert_eq!(kernel_of(&kernel, growth, level), kernel.grown(growth / f64::from(level).exp2()));
            }
        }
    }

    #[test]
    fn dense_cells_need_a_larger_growth() {
        let kernel = Kernel::default();
        assert_eq!(right_growth(&kernel, 1, 0.1), least_growth(&kernel, 1));
        let [thin, dense, opaque] = [0.5, 5.0, 50.0].map(|depth| right_growth(&kernel, 2, depth));
        assert!(thin < dense && dense < opaque, "{thin} {dense} {opaque}");
    }

    #[test]
    fn no_level_is_coarser_than_the_volume() {
        let grid = Grid::axis_parallel([40, 65, 10], [1.0; 3]).unwrap();
        let level = |growth| level_of(&Kernel::default(), growth, &grid, 0.0);
        assert_eq!([1.0, 1.5, 3.0, 50.0, 1e3, 1e9].map(level), [0, 1, 2, 6, 7, 7]);
    }
}
