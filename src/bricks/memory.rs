//! The memory that drawing a brick takes, predicted from a sample of the voxels.

use std::ops::Range;

use crate::error::Result;
use crate::layers::Layers;
use crate::settings::{Level, Painter, Settings};
use crate::volume::Grid;

/// The bytes of the program and its driver, on software Vulkan. Measured; see
/// docs/measurements/2026-11-25-bricks.md.
const PROGRAM: f64 = 75.0 * 1048576.0;

/// Voxels between sampled ones along x, y and z.
const STRIDE: [u32; 3] = [4, 8, 8];

/// Predicts the memory of bricks.
pub(super) struct Memory {
    /// Bytes of each voxel of a slice: samples, filtered samples, and the packed texture of the painter tiles.
    voxel: f64,
    /// Bytes of each visible voxel.
    splat: f64,
    /// Of every sampled voxel, x fastest, whether it is visible; `None`: take all as visible.
    sampled: Option<(Vec<bool>, [usize; 3])>,
    /// Voxels of the volume between sampled ones.
    steps: [f64; 3],
}

impl Memory {
    /// Samples the voxels of an overview of a volume on `grid`. Several layers count as visible everywhere.
    pub(super) fn new(layers: &Layers, grid: &Grid, settings: &Settings) -> Result<Self> {
        let (post, lit) = (settings.is_post_shaded(), settings.lighting.is_some());
        let cells = if let Level::At(level) = settings.level { f64::from(3 * level).exp2() } else { 1.0 };
        let filtered = if settings.sharpens().is_some() { 4.0 } else { 0.0 };
        // Measured on a scan of 512^3: splats, and the memory that making and drawing them takes beside.
        let (packed, splat) = match (settings.painter, post, lit) {
            (Painter::Quads(_), false, _) => (0.0, 91.0),
            (Painter::Quads(_), true, _) => (0.0, 110.0),
            // Cells of a level take the place of voxels.
            (_, false, _) => (8.0 / cells, 12.0 / cells),
            (_, true, false) => (4.0, 21.0),
            (_, true, true) => (8.0, 34.0),
        };
        let voxel = layers.sample_bytes() as f64 + filtered + packed;
        let coarser = |axis: usize| f64::from(grid.dims()[axis]) / f64::from(layers.grid().dims()[axis]);
        let steps = std::array::from_fn(|axis| f64::from(STRIDE[axis]) * coarser(axis));
        Ok(Self { voxel, splat, sampled: sampled(layers)?, steps })
    }

    /// The bytes that drawing a slice takes.
    pub(super) fn of(&self, held: &[Range<u32>; 3]) -> u64 {
        let voxels: f64 = held.iter().map(|range| range.len() as f64).product();
        let share = self.sampled.as_ref().map_or(1.0, |(visible, counts)| {
            let places = |axis: usize| {
                let within = |at: &usize| held[axis].contains(&((*at as f64 * self.steps[axis]) as u32));
                (0..counts[axis]).filter(within).collect::<Vec<usize>>()
            };
            let [x, y, z] = [places(0), places(1), places(2)];
            let rows = z.iter().flat_map(|z| y.iter().map(move |y| counts[0] * (y + counts[1] * z)));
            let found = rows.flat_map(|row| x.iter().map(move |x| visible[row + x])).filter(|&visible| visible).count();
            found as f64 / (x.len() * y.len() * z.len()).max(1) as f64
        });
        (PROGRAM + voxels * (self.voxel + share * self.splat)) as u64
    }
}

/// Whether sampled voxels of one volume are visible, and their numbers along the axes.
fn sampled(layers: &Layers) -> Result<Option<(Vec<bool>, [usize; 3])>> {
    let Some((volume, transfer)) = layers.plain() else { return Ok(None) };
    let dims = volume.grid().dims();
    let [nx, ny, nz] = dims.map(|count| count as usize);
    let counts: [usize; 3] = std::array::from_fn(|axis| dims[axis].div_ceil(STRIDE[axis]) as usize);
    let (slope, intercept) = volume.rescale();
    let mut visible = Vec::with_capacity(counts.iter().product());
    for z in (0..nz).step_by(STRIDE[2] as usize) {
        for y in (0..ny).step_by(STRIDE[1] as usize) {
            let row = nx * (y + ny * z);
            let samples = volume.read(row..row + nx)?;
            let values = (0..nx).step_by(STRIDE[0] as usize).map(|x| slope * samples.raw(x) + intercept);
            visible.extend(values.map(|value| transfer.sample(value).1 > 0.0));
        }
    }
    Ok(Some((visible, counts)))
}
