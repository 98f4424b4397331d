//! scalar-cells: the samples of a volume to scalars of cells and to the box that painters read, on the device:
//! shaders/cell_rows.wgsl, scalar_sums.wgsl and pack_cells.wgsl. The box is made part by part: sums of voxels along x,
//! then along y, then along z, which are cells, and texels of these. No cell is kept but in the box.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::Zeroable;

use super::cache::Cache;
use super::context::Context;
use super::layout::{CellTexels, ScalarSums, Scalars};
use super::pipeline::Binding;
use super::recorder::{Recorder, max_work};
use super::shaders;
use super::stage::{Constant, Stage, for_each};
use crate::error::{Error, Result};
use crate::kernel::Slopes;
use crate::volume::BRICK_EDGE as EDGE;

/// The stage in [`Stats::stages`](crate::stats::Stats::stages).
const PACK: &str = "pack";
/// The largest number of bytes of each of three buffers of sums.
const MOST: u64 = 128 << 20;
/// Cells to either side that gradients depend on.
const HALO: u32 = 3;
/// Voxels of a sum that are as much work as a fragment of a splat.
const VOXELS_OF_WORK: u64 = 8;

/// The weights of voxels in cells, and of cells in gradients.
pub(crate) struct CellFilters<'a> {
    /// Cells that cover the volume along each axis.
    pub(crate) dims: [u32; 3],
    /// Voxels along a cell, as a fraction in lowest terms.
    pub(crate) size: [usize; 2],
    /// The first voxel with a weight in the first cell, along each axis, and the weights of the voxels from there on:
    /// for as many cells as the divisor of `size`.
    pub(crate) axes: [(i64, &'a [Vec<f32>]); 3],
    /// Voxels to either side of a cell that its gradients depend on although its kernel does not.
    pub(crate) beside: i64,
    pub(crate) slopes: Slopes,
}

/// The cells of a lattice, which shaders make of samples.
#[derive(Clone)]
pub(crate) struct ScalarCells {
    stages: Arc<SumStages>,
    size: [i64; 2],
    axes: [AxisWeights; 3],
    slopes: Slopes,
    /// Whether cells have gradients.
    gradients: bool,
}

/// The weights of voxels in cells along an axis.
#[derive(Clone)]
struct AxisWeights {
    /// Number of voxels of the volume.
    voxels: u32,
    /// The first voxel with a weight in cell 0; `taps` is the number of voxels with weights in a cell.
    first: i64,
    taps: i64,
    /// The weights of the voxels in the middle, whose range is kept; none: all cells have gradients.
    block: Range<i64>,
    weights: wgpu::Buffer,
}

/// The samples of a volume on the device.
pub(super) struct BoundSamples<'a> {
    /// The parameters that make scalars of the samples; without bricks.
    pub(super) parameters: Scalars,
    /// The samples of each buffer, and the numbers of their bricks.
    pub(super) buffers: Vec<(Range<u32>, wgpu::BindingResource<'a>)>,
    /// Number of bricks of a layer along x and y.
    pub(super) of_layer: u32,
}

/// The stages that sum scalars.
struct SumStages {
    along_x: Stage,
    along_axis: Stage,
}

/// A part of a box of texels.
struct TexelPart {
    rows: Range<u32>,
    planes: Range<u32>,
    /// The cells on which the part depends, along each axis.
    cells: [Range<i64>; 3],
}

impl SumStages {
    fn new(context: &Context, constants: &[Constant]) -> Self {
        use Binding::{Read, Uniform, Write};
        let slots = [Uniform, Read, Uniform, Read, Write];
        let along_x = Stage::new(context, shaders::CELL_ROWS, (PACK, "along_x"), &slots, constants);
        let slots = [Uniform, Read, Read, Write];
        let along_axis = Stage::new(context, shaders::SCALAR_SUMS, (PACK, "along_axis"), &slots, constants);
        Self { along_x, along_axis }
    }
}

impl ScalarCells {
    /// Makes the cells of a volume of `voxels` voxels, whose samples shaders read by these constants.
    pub(super) fn new(
        context: &Context,
        pipelines: &Cache,
        (constants, gradients): (Vec<Constant>, bool),
        voxels: [u32; 3],
        filters: &CellFilters<'_>,
    ) -> Result<Self> {
        let CellFilters { size, axes, beside, slopes, .. } = *filters;
        let over = size[0] as i64;
        let axis = |axis: usize| {
            let (first, weights) = axes[axis];
            let taps = weights.first().map_or(0, Vec::len) as i64;
            // None of voxels: their gradients are those of the voxels beside them.
            let before = (taps - over) / 2 - beside;
            let block = if before < 0 { 0..0 } else { before..taps - before };
            let usage = wgpu::BufferUsages::STORAGE;
            let on_device = context.upload("cells.weights", bytemuck::cast_slice(&weights.concat()), usage)?;
            Ok::<_, Error>(AxisWeights { voxels: voxels[axis], first, taps, block, weights: on_device })
        };
        Ok(Self {
            stages: pipelines.get_or_make(constants.clone(), || Ok(SumStages::new(context, &constants)))?,
            size: size.map(|n| n as i64),
            axes: [axis(0)?, axis(1)?, axis(2)?],
            slopes,
            gradients,
        })
    }

    /// Returns the count of numbers of a sum.
    fn each(&self) -> u64 {
        if self.gradients { 3 } else { 1 }
    }

    /// Returns the first voxel with a weight in a cell: below 0 before the face.
    fn low(&self, axis: usize, cell: i64) -> i64 {
        let [over, under] = self.size;
        self.axes[axis].first + (cell * over).div_euclid(under)
    }

    /// Returns the voxels with weights in these cells; voxels beyond the faces are copies of the outermost ones.
    fn voxels(&self, axis: usize, cells: &Range<i64>) -> Range<i64> {
        let AxisWeights { voxels, taps, .. } = self.axes[axis];
        let inside = |voxel: i64| voxel.clamp(0, i64::from(voxels) - 1);
        inside(self.low(axis, cells.start))..inside(self.low(axis, cells.end - 1) + taps - 1) + 1
    }

    /// Returns the cells on which a range of a box depends, from a cell on that has the first weights.
    fn cells(&self, low: i64, range: &Range<u32>) -> Range<i64> {
        let halo = if self.gradients { i64::from(HALO) } else { 0 };
        let [_, under] = self.size;
        let start = (low + i64::from(range.start) - halo).div_euclid(under) * under;
        start..low + i64::from(range.end) + halo
    }

    /// Returns the part of a box, which begins at cell `low`, with these rows and planes.
    fn part(&self, low: [i64; 3], across: u32, rows: Range<u32>, planes: Range<u32>) -> TexelPart {
        let cells = [self.cells(low[0], &(0..across)), self.cells(low[1], &rows), self.cells(low[2], &planes)];
        TexelPart { rows, planes, cells }
    }

    /// Returns the numbers of sums of a part along x, along x and y, and along all axes.
    fn sums(&self, part: &TexelPart) -> [u64; 3] {
        let cells = |axis: usize| (part.cells[axis].end - part.cells[axis].start) as u64;
        let voxels = |axis: usize| self.voxels(axis, &part.cells[axis]).count() as u64;
        [cells(0) * voxels(1) * voxels(2), cells(0) * cells(1) * voxels(2), cells(0) * cells(1) * cells(2)]
    }

    /// Returns the work of a sum along each axis, in fragments of splats.
    fn work(&self) -> [u64; 3] {
        self.axes.each_ref().map(|axis| (axis.taps as u64).div_ceil(VOXELS_OF_WORK))
    }

    /// Splits a box into parts, with buffers of at most `bytes` and dispatches of at most this work.
    fn parts(&self, [bytes, most_work]: [u64; 2], low: [i64; 3], [across, rows, planes]: [u32; 3]) -> Vec<TexelPart> {
        let most = bytes / (4 * self.each());
        let fits = |part: &TexelPart| {
            let allowed = |(sums, work): (u64, u64)| sums <= most && sums * work <= most_work;
            self.sums(part).into_iter().zip(self.work()).all(allowed)
        };
        let ranges = |count: u32, size: u32| {
            (0..count).step_by(size.max(1) as usize).map(move |start| start..count.min(start + size))
        };
        let mut size = [rows, planes];
        loop {
            let of_planes = |planes: Range<u32>| {
                ranges(rows, size[0]).map(move |rows| self.part(low, across, rows, planes.clone()))
            };
            let parts: Vec<TexelPart> = ranges(planes, size[1]).flat_map(of_planes).collect();
            if size.iter().all(|&n| n <= 1) || parts.iter().all(fits) {
                return parts;
            }
            // Parts of much the same size.
            let longer = usize::from(size[1] >= size[0]);
            size[longer] = size[longer].div_ceil(2);
        }
    }

    /// Returns whether cells have gradients.
    pub(super) fn has_gradients(&self) -> bool {
        self.gradients
    }

    /// Records the cells of a box part by part, and calls `take` after each part, given the parameters of the part, its
    /// cells and their number in the box. The box begins at cell `low` and has `dims` cells.
    pub(super) fn each_part(
        &self,
        recorder: &mut Recorder<'_>,
        samples: &BoundSamples<'_>,
        (low, dims): ([i64; 3], [u32; 3]),
        take: &mut dyn FnMut(&mut Recorder<'_>, [&wgpu::Buffer; 2], u64),
    ) -> Result<()> {
        let context = recorder.context;
        // No dispatch outlasts the watchdog of a small GPU.
        let parts = self.parts([MOST.min(context.largest_buffer()), max_work(context)], low, dims);
        let largest = |stage: usize| parts.iter().map(|part| self.sums(part)[stage]).max().unwrap_or_default();
        let buffer =
            |label, stage| context.buffer(label, 4 * self.each() * largest(stage), wgpu::BufferUsages::STORAGE);
        let rows = buffer("cells.rows", 0)?;
        let columns = buffer("cells.columns", 1)?;
        let cells = buffer("cells.cells", 2)?;
        for part in &parts {
            self.sum_rows(recorder, samples, part, &rows)?;
            self.sum_along(recorder, 1, part, [&rows, &columns])?;
            self.sum_along(recorder, 2, part, [&columns, &cells])?;
            let first = |axis: usize, start: u32| (low[axis] + i64::from(start) - part.cells[axis].start) as u32;
            let parameters = CellTexels {
                dims: part.cells.each_ref().map(|cells| cells.clone().count() as u32),
                first_plane: part.planes.start,
                first: [first(0, 0), first(1, part.rows.start), first(2, part.planes.start)],
                planes: part.planes.len() as u32,
                differences: self.slopes.differences,
                first_row: part.rows.start,
                rows: part.rows.len() as u32,
                across: dims[0],
                beside: self.slopes.beside,
                own: self.slopes.own,
            };
            let uniform = wgpu::BufferUsages::UNIFORM;
            let parameters = context.upload("cells.texels", bytemuck::bytes_of(&parameters), uniform)?;
            let texels = [dims[0], part.rows.len() as u32, part.planes.len() as u32];
            let texels = texels.map(u64::from).into_iter().product();
            take(recorder, [&parameters, &cells], texels);
            recorder.worked(texels);
        }
        Ok(())
    }

    /// Returns the parameters of the sums of a part along an axis.
    fn parameters(&self, axis: usize, part: &TexelPart) -> ScalarSums {
        let cells = |axis: usize| part.cells[axis].clone().count() as u32;
        let voxels = [0, 1, 2].map(|axis| self.voxels(axis, &part.cells[axis]));
        let counts = [0, 1, 2].map(|axis| voxels[axis].clone().count() as u32);
        // Along the axes before, values are sums already.
        let across = [0, 1].map(|other| if other < axis { cells(other) } else { counts[other] });
        let sums = [0, 1, 2].map(|other| if other <= axis { cells(other) } else { counts[other] });
        let Range { start, end } = self.axes[axis].block;
        ScalarSums {
            dims: sums,
            count: counts[axis],
            steps: [1, across[0], across[0] * across[1]],
            over: self.size[0] as u32,
            axis: [0, 1, 2].map(|other| u32::from(other == axis)),
            under: self.size[1] as u32,
            low: (self.low(axis, part.cells[axis].start) - if axis == 0 { 0 } else { voxels[axis].start }) as i32,
            first_in_block: start as i32,
            end_of_block: end as i32,
            first_y: voxels[1].start as u32,
            first_z: voxels[2].start as u32,
            ..ScalarSums::zeroed()
        }
    }

    /// Records sums along y or z of the sums along the axes before.
    fn sum_along(
        &self,
        recorder: &mut Recorder<'_>,
        axis: usize,
        part: &TexelPart,
        [values, sums]: [&wgpu::Buffer; 2],
    ) -> Result<()> {
        let context = recorder.context;
        let parameters = self.parameters(axis, part);
        let uniform = wgpu::BufferUsages::UNIFORM;
        let parameters = context.upload("cells.sums", bytemuck::bytes_of(&parameters), uniform)?;
        let buffers = [&parameters, values, &self.axes[axis].weights, sums].map(wgpu::Buffer::as_entire_binding);
        let count = self.sums(part)[axis];
        self.stages.along_axis.run(recorder, &buffers, for_each(context, count));
        recorder.worked(count * self.work()[axis]);
        Ok(())
    }

    /// Records sums along x of the scalars of voxels.
    fn sum_rows(
        &self,
        recorder: &mut Recorder<'_>,
        samples: &BoundSamples<'_>,
        part: &TexelPart,
        sums: &wgpu::Buffer,
    ) -> Result<()> {
        let context = recorder.context;
        let parameters = self.parameters(0, part);
        let uniform = wgpu::BufferUsages::UNIFORM;
        let on_device = context.upload("cells.sums", bytemuck::bytes_of(&parameters), uniform)?;
        let [count, ..] = self.sums(part);
        let planes = self.voxels(2, &part.cells[2]);
        let [first, last] = [planes.start, planes.end - 1].map(|plane| plane as u32 / EDGE as u32);
        let reached = first * samples.of_layer..(last + 1) * samples.of_layer;
        let reaches = |bricks: &Range<u32>| bricks.start < reached.end && bricks.end > reached.start;
        for (bricks, bound) in samples.buffers.iter().filter(|(bricks, _)| reaches(bricks)) {
            let own = Scalars { first_brick: bricks.start, end_brick: bricks.end, ..samples.parameters };
            let own = context.upload("pack.scalars", bytemuck::bytes_of(&own), uniform)?;
            let resources = [
                own.as_entire_binding(),
                bound.clone(),
                on_device.as_entire_binding(),
                self.axes[0].weights.as_entire_binding(),
                sums.as_entire_binding(),
            ];
            self.stages.along_x.run(recorder, &resources, for_each(context, count));
        }
        recorder.worked(count * self.work()[0]);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::adapter_test::adapter;

    #[test]
    fn device_parts_of_a_box_cover_it_and_keep_within_their_buffers() {
        let context = Context::new(Some(&adapter())).unwrap();
        let weights = [vec![0.1; 9], vec![0.1; 9]];
        let filters = CellFilters {
            dims: [60, 50, 40],
            size: [3, 2],
            axes: [(-2, weights.as_slice()), (-3, weights.as_slice()), (-1, weights.as_slice())],
            beside: 1,
            slopes: Slopes::of_cells(1.5),
        };
        let constants = vec![("SAMPLE_TYPE", 0), ("RANGES", 1), ("HALO", 1)];
        let key = (constants, true);
        let cells = ScalarCells::new(&context, &Cache::default(), key, [90, 75, 60], &filters).unwrap();
        let (low, dims) = ([-4, -2, 3], [68, 54, 30]);
        let most = [2_000_000, 250_000];
        let parts = cells.parts(most, low, dims);
        assert!(parts.len() > 4);
        let mut covered = vec![0; (dims[1] * dims[2]) as usize];
        for part in &parts {
            for (sums, work) in cells.sums(part).into_iter().zip(cells.work()) {
                assert!(12 * sums <= most[0] && sums * work <= most[1], "{sums} sums");
            }
            let rows = part.planes.clone().flat_map(|z| part.rows.clone().map(move |y| y + dims[1] * z));
            rows.for_each(|row| covered[row as usize] += 1);
            for (axis, (low, range)) in
                low.into_iter().zip([0..dims[0], part.rows.clone(), part.planes.clone()]).enumerate()
            {
                let Range { start, end } = part.cells[axis];
                // The weights of the first cell are the first ones.
                assert!(start % 2 == 0 && start <= low + i64::from(range.start) - 3);
                assert!(end == low + i64::from(range.end) + 3);
            }
        }
        assert!(covered.iter().all(|&times| times == 1));
        assert_eq!(cells.parts([u64::MAX; 2], low, dims).len(), 1);
    }
}
