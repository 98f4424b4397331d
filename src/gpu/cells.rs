//! cells: the samples of a volume to lit cells of a level, on the device: shaders/lit_rows.wgsl and cells.wgsl. Boxes
//! of cells are made one after the other: the sums along x and y of planes of voxels, then the sums along z.
//!
//! Which voxels of the samples are visible, and their normals, is found once and kept: kept_voxels.rs.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::Zeroable;

use super::cache::Cache;
use super::classify::VisibleVoxels;
use super::context::Context;
use super::kept_voxels::{CLASSIFY, FOUND};
use super::layout::{CellBox, Lighting, VoxelBox};
use super::pipeline::Binding;
use super::recorder::{Recorder, max_work};
use super::samples::ROWS;
use super::scan::{Scan, WORKGROUP};
use super::shaders;
use super::splat::{SplatLight, ToEye};
use super::stage::{Constant, Stage, for_each};
use super::voxels::{EACH, SampledBuffer, Voxels, VoxelsKey, numbers_of};
use crate::error::Result;
use crate::progress::Progress;
use crate::splats::brick::BrickSplats;
use crate::volume::BRICK_EDGE as EDGE;

/// The largest number of bytes of a buffer of sums. There is one such buffer in each frame. Larger ones take fewer
/// dispatches, but to allocate 256 MiB more took 5 ms of a frame on an H200.
pub(super) const MOST: u64 = 128 << 20;
/// The number of bytes of a sum.
const VALUE: u64 = 16;
/// Cells that a voxel is shared among along an axis; NODES in shaders/lit_rows.wgsl.
pub(crate) const NODES: usize = 6;
/// Sums along x of a workgroup; SUMS in shaders/lit_rows.wgsl.
pub(crate) const SUMS: usize = WORKGROUP as usize + 1 - NODES;
/// Cells along y of a workgroup; TILE_ROWS in shaders/lit_rows.wgsl.
pub(super) const TILE_ROWS: usize = 32;
/// Cells along y that a workgroup sums at a time; OPEN in shaders/lit_rows.wgsl.
#[cfg(test)]
pub(crate) const OPEN: usize = 8;
/// The work for a voxel whose normal is kept, in fragments of splats.
const LIT: u64 = 2;
/// The work in words that complete errors: "while ...".
const COUNTING: &str = "classifying the volume";

/// The lattice of cells of a level, and the weights of voxels in cells.
pub(crate) struct CellLattice<'a> {
    /// Cells along each axis.
    pub(crate) dims: [usize; 3],
    /// Voxels along each axis.
    pub(crate) voxels: [usize; 3],
    /// Voxels along a cell, as a fraction in lowest terms.
    pub(crate) size: [usize; 2],
    /// The first voxel with a weight in the first cell, along each axis.
    pub(crate) first: i64,
    /// The weights of the voxels from `first` on, for as many cells as the divisor of `size`.
    pub(crate) weights: &'a [Vec<f32>],
    /// The least density of cells that are kept.
    pub(crate) least: f32,
}

impl CellLattice<'_> {
    /// Returns the first voxel with a weight in a cell: below 0 before the face.
    fn low(&self, cell: usize) -> i64 {
        let [over, under] = self.size;
        self.first + (cell * over / under) as i64
    }

    /// Returns the number of weights in a cell.
    fn taps(&self) -> usize {
        self.weights.first().map_or(0, Vec::len)
    }

    /// Returns the voxels with weights in some cells along an axis.
    fn voxels(&self, axis: usize, cells: &Range<usize>) -> Range<usize> {
        let end = self.low(cells.end.max(1) - 1) + self.taps() as i64;
        let [start, end] = [self.low(cells.start), end].map(|voxel| voxel.clamp(0, self.voxels[axis] as i64) as usize);
        start..end
    }

    /// Returns the largest number of voxels with weights in `cells` consecutive cells along an axis.
    fn count(&self, axis: usize, cells: usize) -> usize {
        let [over, under] = self.size;
        (((cells - 1) * over).div_ceil(under) + self.taps()).min(self.voxels[axis])
    }

    /// Plans the fewest boxes of whole bricks of cells whose sums along x and y keep within `most` bytes. Cells of a
    /// box lie side by side along z as far as possible: planes of voxels that two boxes share are lit twice.
    pub(super) fn plan(&self, most: u64) -> Plan {
        let [across, down, deep] = self.dims;
        let fits = |&[rows, layers]: &[usize; 2]| (across * rows * self.count(2, layers)) as u64 * VALUE <= most;
        // Boxes of much the same size.
        let sizes = |cells: usize| {
            let bricks = cells.div_ceil(EDGE);
            (1..=bricks).map(move |boxes| (bricks.div_ceil(boxes) * EDGE).min(cells))
        };
        let all = sizes(deep).flat_map(|layers| sizes(down).map(move |rows| [rows, layers]));
        let boxes = |[rows, layers]: &[usize; 2]| down.div_ceil(*rows) * deep.div_ceil(*layers);
        let [rows, layers] = all.filter(fits).min_by_key(boxes).unwrap_or([down.min(EDGE), deep.min(EDGE)]);
        Plan { rows, layers, lines: self.count(1, rows), planes: self.count(2, layers) }
    }
}

/// The sizes of the boxes in which cells are made one after the other.
pub(super) struct Plan {
    /// Cells of a box along y and z.
    pub(super) rows: usize,
    pub(super) layers: usize,
    /// Voxels of a box along y and z, at most.
    lines: usize,
    pub(super) planes: usize,
}

/// The stages of cells of any volume. In [`Stats::stages`](crate::stats::Stats::stages) they are part of `classify`.
struct CellStages {
    count: Stage,
    emit: Stage,
}

impl CellStages {
    fn new(context: &Context) -> Self {
        use Binding::{Read, Uniform, Write};
        let slots = [Uniform, Read, Read, Write, Write, Write];
        let entries = ["count", "emit"].map(|entry| (CLASSIFY, entry));
        let [count, emit] = Stage::several(context, shaders::CELLS, entries, &slots, &[]);
        Self { count, emit }
    }
}

/// The pictures whose voxels one pipeline lights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct LitKey {
    voxels: VoxelsKey,
    lights: u32,
    points: bool,
    perspective: bool,
}

impl LitKey {
    /// Returns the stage that lights voxels.
    fn stage(self, context: &Context) -> Stage {
        use Binding::{Read, Uniform, Write};
        let Self { voxels, lights, points, perspective } = self;
        let own = [("LIGHTS", lights), ("POINT_LIGHTS", points.into()), ("PERSPECTIVE", perspective.into())];
        let constants: Vec<Constant> = own.into_iter().chain(voxels.constants()).collect();
        let slots = [Uniform, Read, Read, Uniform, Write, Read, Read, Read, Uniform, Read, Read];
        Stage::new(context, shaders::LIT_ROWS, (CLASSIFY, "lit_rows"), &slots, &constants)
    }
}

/// Makes the cells of a level under a light; `None`: unlit. `before` are the cells of the same voxels under another
/// light, whose places stay and whose memory is used again.
pub(crate) fn run(
    context: &Context,
    pipelines: &Cache,
    (voxels, light): (&Voxels, Option<&SplatLight>),
    lattice: &CellLattice<'_>,
    before: Option<Arc<Voxels>>,
    progress: &Progress,
) -> Result<Arc<Voxels>> {
    let (uniform, storage) = (wgpu::BufferUsages::UNIFORM, wgpu::BufferUsages::STORAGE);
    let lighting = light.map_or_else(Lighting::zeroed, |light| light.lighting);
    let key = LitKey {
        voxels: voxels.key(),
        lights: light.map_or(0, |light| light.lights),
        points: light.is_some_and(|light| light.points),
        perspective: light.is_some_and(|light| light.to_eye.perspective),
    };
    let job = CellJob {
        context,
        progress,
        lattice,
        stages: pipelines.get_or_make((), || Ok(CellStages::new(context)))?,
        lit_voxels: pipelines.get_or_make(key, || Ok(key.stage(context)))?,
        scan: Scan::of(pipelines, context)?,
        to_eye: light.map_or(&ToEye::PARALLEL, |light| &light.to_eye),
        lighting: context.upload("cells.lighting", bytemuck::bytes_of(&lighting), uniform)?,
        weights: context.upload("cells.weights", bytemuck::cast_slice(&lattice.weights.concat()), storage)?,
        classify: context.upload("cells.classify", bytemuck::bytes_of(&voxels.parameters()), uniform)?,
        points: voxels.points(),
        parts: voxels.buffers().collect(),
    };
    job.run(before).map(Arc::new)
}

/// The state that all boxes of cells share.
struct CellJob<'a> {
    context: &'a Context,
    progress: &'a Progress,
    lattice: &'a CellLattice<'a>,
    stages: Arc<CellStages>,
    lit_voxels: Arc<Stage>,
    scan: Arc<Scan>,
    to_eye: &'a ToEye,
    lighting: wgpu::Buffer,
    weights: wgpu::Buffer,
    /// The voxels of all boxes: parameters, control points and samples.
    classify: wgpu::Buffer,
    points: &'a wgpu::Buffer,
    parts: Vec<SampledBuffer<'a>>,
}

/// The sums along x and y of all planes of a box.
struct PlaneSums {
    sums: wgpu::Buffer,
    /// The number of planes of voxels that are lit together.
    together: usize,
}

impl CellJob<'_> {
    /// Returns the work for a voxel, in fragments of splats.
    fn work(&self) -> u64 {
        if self.parts.iter().any(|part| part.normals.is_none()) { FOUND } else { LIT }
    }

    fn planes(&self, Plan { rows, lines, planes, .. }: Plan) -> Result<PlaneSums> {
        let ([across, ..], [width, ..]) = (self.lattice.dims, self.lattice.voxels);
        // No dispatch outlasts the watchdog of a small GPU.
        let of_plane = (width * lines) as u64;
        let most = max_work(self.context) / self.work() / of_plane.max(1);
        let at_once = most.clamp(1, planes.max(1) as u64) as usize;
        let bytes = (across * rows * planes) as u64 * VALUE;
        let sums = self.context.buffer("cells.planes", bytes, wgpu::BufferUsages::STORAGE)?;
        // Parts of much the same size.
        Ok(PlaneSums { sums, together: planes.div_ceil(planes.div_ceil(at_once)) })
    }

    /// Returns the cells of each box, box after box.
    fn boxes(&self, Plan { rows, layers, .. }: &Plan) -> Vec<[Range<usize>; 3]> {
        let [across, down, deep] = self.lattice.dims;
        let of_rows = |z: usize| {
            let of_box = move |y: usize| [0..across, y..down.min(y + rows), z..deep.min(z + layers)];
            (0..down).step_by(*rows).map(of_box)
        };
        (0..deep).step_by(*layers).flat_map(of_rows).collect()
    }

    fn run(&self, before: Option<Arc<Voxels>>) -> Result<Voxels> {
        let plan = self.lattice.plan(MOST.min(self.context.largest_buffer()));
        let boxes = self.boxes(&plan);
        let planes = self.planes(plan)?;
        if let Some(before) = before {
            return self.relight(&planes, &boxes, &before);
        }
        let mut of_boxes = Vec::new();
        for (number, cells) in boxes.iter().enumerate() {
            let mut recorder = Recorder::untimed(self.context);
            self.sum(&mut recorder, &planes, cells)?;
            of_boxes.push(self.collect(recorder, &planes.sums, cells)?);
            self.progress.report("classifying", (number + 1) as f64 / boxes.len() as f64);
            self.progress.check()?;
        }
        Voxels::of_words(self.context, words(self.lattice.dims), of_boxes, None)
    }

    /// Lights cells again, without a wait.
    fn relight(&self, planes: &PlaneSums, boxes: &[[Range<usize>; 3]], before: &Voxels) -> Result<Voxels> {
        let mut recorder = Recorder::untimed(self.context);
        for (cells, of_box) in boxes.iter().zip(before.buffers()).filter(|(_, of_box)| of_box.visible.count > 0) {
            self.sum(&mut recorder, planes, cells)?;
            let VisibleVoxels { places, seen, .. } = of_box.visible;
            self.record(&mut recorder, &self.stages.emit, cells, [&planes.sums, places, seen, of_box.samples])?;
        }
        recorder.submit();
        Ok(before.again())
    }

    /// Records the sums along x and y of the planes of a box of cells.
    fn sum(&self, recorder: &mut Recorder<'_>, planes: &PlaneSums, cells: &[Range<usize>; 3]) -> Result<()> {
        let [xs, ys, zs] = [0, 1, 2].map(|axis| self.lattice.voxels(axis, &cells[axis]));
        for z in zs.clone().step_by(planes.together) {
            let within = [xs.clone(), ys.clone(), z..zs.end.min(z + planes.together)];
            self.light(recorder, &planes.sums, (&within, z - zs.start), cells)?;
            let voxels: usize = within.iter().map(Range::len).product();
            recorder.worked(voxels as u64 * self.work());
        }
        Ok(())
    }

    /// Records the sums along x and y of some planes of a box of cells, given the number of the first plane.
    fn light(
        &self,
        recorder: &mut Recorder<'_>,
        to: &wgpu::Buffer,
        (within, first_plane): (&[Range<usize>; 3], usize),
        cells: &[Range<usize>; 3],
    ) -> Result<()> {
        let Self { context, lattice, .. } = self;
        let [_, ys, zs] = within;
        if ys.is_empty() || zs.is_empty() {
            return Ok(());
        }
        let ToEye { eye, view: [view_x, view_y, view_z], .. } = *self.to_eye;
        let across = lattice.dims[0];
        let [over, under] = words(lattice.size);
        let [bricks_x, bricks_y, _] = lattice.voxels.map(|n| n.div_ceil(EDGE) as u32);
        let row = |y: usize, z: usize| bricks_x * ((y / EDGE) as u32 + bricks_y * (z / EDGE) as u32);
        let reached = row(ys.start, zs.start)..row(ys.end - 1, zs.end - 1) + bricks_x;
        let groups = (across.div_ceil(SUMS) * cells[1].len().div_ceil(TILE_ROWS) * zs.len()) as u64;
        let reaches = |part: &&SampledBuffer<'_>| part.bricks.start < reached.end && part.bricks.end > reached.start;
        for SampledBuffer { bricks, samples, visible, normals, kept } in self.parts.iter().filter(reaches) {
            let inside = VoxelBox {
                low: within.clone().map(|range| range.start as u32),
                first: bricks.start,
                dims: within.clone().map(|range| range.len() as u32),
                end: bricks.end,
                eye,
                cells: across as u32,
                view_x,
                first_x: lattice.low(0) as i32,
                view_y,
                over,
                view_z,
                under,
                rows: cells[1].len() as u32,
                first_y: lattice.low(cells[1].start) as i32,
                first_plane: first_plane as u32,
                ..VoxelBox::zeroed()
            };
            let uniform = wgpu::BufferUsages::UNIFORM;
            let inside = &context.upload("cells.voxel_box", bytemuck::bytes_of(&inside), uniform)?;
            let VisibleVoxels { places, seen, .. } = visible;
            let [normals, kept] = [normals, kept].map(|buffer| buffer.unwrap_or(places));
            let (classify, points, lighting, weights) = (&self.classify, self.points, &self.lighting, &self.weights);
            let buffers = [classify, *samples, points, lighting, to, places, seen, weights, inside, normals, kept];
            let resources = buffers.map(wgpu::Buffer::as_entire_binding);
            self.lit_voxels.run(recorder, &resources, for_each(context, groups * WORKGROUP));
        }
        Ok(())
    }

    /// Counts the cells of a box and makes their words, after the recorder's commands.
    fn collect(
        &self,
        mut recorder: Recorder<'_>,
        sums: &wgpu::Buffer,
        within: &[Range<usize>; 3],
    ) -> Result<(VisibleVoxels, wgpu::Buffer)> {
        let context = self.context;
        let [bx, by, bz] = bricks_of(within);
        let [_, y0, z0] = within.clone().map(|range| range.start as u32);
        let origin = |brick: u32| {
            let at = [brick % bx, brick / bx % by, brick / (bx * by)].map(|n| n * EDGE as u32);
            [at[0], y0 + at[1], z0 + at[2]]
        };
        let origins = (0..bx * by * bz).map(origin);
        let rows = origins.len() * ROWS;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let buffer = |label, values: usize| context.buffer(label, 4 * values as u64, usage);
        let places = buffer("classify.places", rows + 1 + origins.len())?;
        let seen = buffer("classify.seen", rows)?;
        let none = buffer("cells.no_appearances", 0)?;
        self.record(&mut recorder, &self.stages.count, within, [sums, &places, &seen, &none])?;
        self.scan.record(context, &mut recorder.compute_pass(CLASSIFY), &places, rows as u64 + 1)?;
        let [firsts, bits] = [(&places, rows + 1), (&seen, rows)]
            .map(|(buffer, values)| recorder.read_back("cells.staging", buffer, 4 * values as u64));
        let (firsts, bits) = (firsts?, bits?);
        recorder.submit();
        context.wait(COUNTING)?;
        let firsts: Vec<u32> = firsts.done_values(context, COUNTING)?;
        let bits: Vec<u32> = bits.done_values(context, COUNTING)?;
        let numbers: Vec<u32> = numbers_of(words(self.lattice.dims), origins.clone()).collect();
        context.write(&places, 4 * (rows as u64 + 1), bytemuck::cast_slice(&numbers));
        let bricks = origins.zip(firsts.iter().step_by(ROWS).zip(bits.chunks_exact(ROWS)));
        let bricks = bricks.map(|(origin, (&first, bits))| BrickSplats::new(origin, first, bits.iter().copied()));
        let (count, bricks) = (firsts.last().copied().unwrap_or_default(), bricks.collect());
        let appearances = context.buffer("classify.appearances", EACH * u64::from(count), usage)?;
        let mut recorder = Recorder::untimed(context);
        self.record(&mut recorder, &self.stages.emit, within, [sums, &places, &seen, &appearances])?;
        recorder.submit();
        Ok((VisibleVoxels { count, bricks, places, seen }, appearances))
    }

    /// Records the stage that counts the cells of a box that are kept, or the stage that makes their words.
    fn record(
        &self,
        recorder: &mut Recorder<'_>,
        stage: &Stage,
        within: &[Range<usize>; 3],
        [sums, places, seen, appearances]: [&wgpu::Buffer; 4],
    ) -> Result<()> {
        let Self { context, lattice, .. } = self;
        let [bx, by, bz] = bricks_of(within);
        let voxels = lattice.voxels(2, &within[2]);
        let [over, under] = words(lattice.size);
        let parameters = CellBox {
            dims: within.clone().map(|range| range.len() as u32),
            least: lattice.least,
            bricks: [bx, by, bx * by * bz],
            low: (lattice.low(within[2].start) - voxels.start as i64) as i32,
            over,
            under,
            planes: voxels.len() as u32,
            ..CellBox::zeroed()
        };
        let parameters =
            context.upload("cells.cell_box", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
        let buffers = [&parameters, &self.weights, sums, places, seen, appearances];
        // Rows are counted, cells are made.
        let each = if std::ptr::eq(stage, &self.stages.count) { ROWS } else { ROWS * EDGE };
        let invocations = u64::from(bx * by * bz) * each as u64;
        stage.run(recorder, &buffers.map(wgpu::Buffer::as_entire_binding), for_each(context, invocations));
        Ok(())
    }
}

fn words<const N: usize>(values: [usize; N]) -> [u32; N] {
    values.map(|value| value as u32)
}

/// Bricks along each axis of a box of cells.
fn bricks_of(cells: &[Range<usize>; 3]) -> [u32; 3] {
    cells.clone().map(|range| range.len().div_ceil(EDGE) as u32)
}
