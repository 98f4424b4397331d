//! The memory that drawing a brick takes, predicted from a sample of the voxels.

use std::ops::Range;

use crate::camera::Camera;
use crate::error::Result;
use crate::host::{BYTES_OF_LIGHT, needs};
use crate::layers::Layers;
use crate::prepare::bytes_of_voxels;
use crate::settings::{Level, Painter, Settings};
use crate::volume::Grid;

/// The bytes of the program, its driver and the pipelines of one family of rays, on software Vulkan. All numbers here
/// are measured; see docs/measurements/2026-11-25-bricks.md.
const PROGRAM: f64 = 112.0 * 1048576.0;

/// The bytes of the program alone.
const PROGRAM_ALONE: f64 = 28.0 * 1048576.0;

/// The number of bytes of further families of rays: half of the pipelines that they may need, for some need none.
const FAMILIES: f64 = 17.0 * 1048576.0;

/// Voxels between sampled ones along x, y and z.
const STRIDE: [u32; 3] = [4, 8, 8];

/// A prediction of the memory of bricks.
pub(super) struct Memory {
    /// The number of bytes of the program.
    program: f64,
    /// The number of bytes of each voxel of a slice: its sample, its filtered sample, and by the processor its
    /// coefficient.
    voxel: f64,
    /// The number of bytes of each voxel of the box around the visible ones: the packed texture of the painter tiles
    /// and its margins, or coefficients.
    boxed: f64,
    /// The number of bytes of each visible voxel: its splat, and the memory that making and drawing splats takes
    /// beside.
    splat: f64,
    /// The visibility of each sampled voxel, x fastest, and the numbers of sampled voxels along the axes; `None`: take
    /// all voxels as visible.
    sampled: Option<(Vec<bool>, [usize; 3])>,
    /// Voxels of the volume between sampled ones.
    steps: [f64; 3],
    /// The number of bytes of the light that enters, for each voxel of the largest face of a slice.
    face: f64,
}

impl Memory {
    /// Samples the voxels of an overview of a volume on `grid`. Several layers count as visible everywhere.
    pub(super) fn new(layers: &Layers, grid: &Grid, camera: &Camera, settings: &Settings) -> Result<Self> {
        let (post, lit) = (settings.is_post_shaded(), settings.lighting.is_some());
        let level = if let Level::At(level) = settings.level { level } else { 0 };
        let [of_fields, boxed, splat] = match (settings.painter, level) {
            (Painter::Cpu, _) => {
                let [of_fields, boxed, splat] = needs(camera, grid, settings).bytes(post);
                let light = if settings.casting().is_some() { BYTES_OF_LIGHT as f64 } else { 0.0 };
                if post { [of_fields + light, boxed, splat] } else { [of_fields, boxed + light, splat] }
            }
            // Cells take the place of voxels once they are made.
            (Painter::Auto | Painter::Tiles, 1) if !post => [0.0, 3.5, 0.0],
            (Painter::Auto | Painter::Tiles, 2..) if !post => [0.0, 2.0, 0.0],
            (painter, _) => {
                let [boxed, splat] = bytes_of_voxels(painter, post, lit);
                [0.0, boxed, splat]
            }
        };
        let program = if settings.painter == Painter::Cpu { PROGRAM_ALONE } else { PROGRAM };
        // Filtered samples are f32. Noise that the filter makes visible is not known here.
        let filtered = if settings.sharpens().is_some() { 4.0 } else { 0.0 };
        let voxel = layers.sample_bytes() as f64 + filtered + of_fields;
        let coarser = |axis: usize| f64::from(grid.dims()[axis]) / f64::from(layers.grid().dims()[axis]);
        let steps = std::array::from_fn(|axis| f64::from(STRIDE[axis]) * coarser(axis));
        // The rays of a direction pass about twice the face, and the sums of a ray are decoded beside the file.
        let face = settings.casting().map_or(0.0, |casting| 2.0 * 2.0 * 4.0 * casting.directions() as f64);
        Ok(Self { program, voxel, boxed, splat, sampled: sampled(layers)?, steps, face })
    }

    /// Returns the bytes that drawing a slice takes, by one family of rays or by several.
    pub(super) fn of(&self, held: &[Range<u32>; 3], has_families: bool) -> u64 {
        let voxels: f64 = held.iter().map(|range| range.len() as f64).product();
        let (boxed, visible) = self.visible(held).unwrap_or((voxels, voxels));
        let of_voxels = voxels * self.voxel + boxed * self.boxed + visible * self.splat;
        let face = voxels / held.iter().map(|range| range.len() as f64).fold(f64::INFINITY, f64::min).max(1.0);
        (self.program + if has_families { FAMILIES } else { 0.0 } + of_voxels + face * self.face) as u64
    }

    /// Returns the number of voxels of the box around the visible voxels of a slice, and the number of visible voxels.
    fn visible(&self, held: &[Range<u32>; 3]) -> Option<(f64, f64)> {
        let (visible, counts) = self.sampled.as_ref()?;
        let places = |axis: usize| {
            let within = |at: &usize| held[axis].contains(&((*at as f64 * self.steps[axis]) as u32));
            (0..counts[axis]).filter(within).collect::<Vec<usize>>()
        };
        let places = [0, 1, 2].map(places);
        let (mut found, mut ends) = (0_u32, [(usize::MAX, 0); 3]);
        for (&z, &y) in places[2].iter().flat_map(|z| places[1].iter().map(move |y| (z, y))) {
            let row = counts[0] * (y + counts[1] * z);
            for &x in places[0].iter().filter(|&&x| visible[row + x]) {
                found += 1;
                ends.iter_mut().zip([x, y, z]).for_each(|(end, at)| *end = (end.0.min(at), end.1.max(at)));
            }
        }
        // A sampled voxel stands for those half way to the next.
        let side = |axis: usize| {
            let (low, high) = ends[axis];
            ((high + 1).saturating_sub(low) as f64 * self.steps[axis]).min(held[axis].len() as f64)
        };
        let each: f64 = self.steps.iter().product();
        Some(((0..3).map(side).product(), f64::from(found) * each))
    }
}

/// Returns the visibility of the sampled voxels of one volume, and their numbers along the axes.
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
