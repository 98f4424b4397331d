//! cells: the samples of a volume, or its splats in shadows, to lit cells of a level, on the device:
//! shaders/lit_voxels.wgsl or lit_splats.wgsl, coarsen.wgsl and cells.wgsl. Boxes of cells are made one after the
//! other: the planes of their voxels a few at a time, summed along x and y, then the sums along z.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Zeroable;

use super::cache::Cache;
use super::classify::{BATCH, BrickBatch, HeldSamples, Input, InputKey, STRIDE, joined};
use super::context::Context;
use super::layout::{CellBox, Coarsen, Lighting, VoxelBox};
use super::pipeline::Binding;
use super::recorder::{ComputePass, Recorder};
use super::rows::{Collected, DevicePart, ROWS, Rows, collect};
use super::scan::Scan;
use super::shaders;
use super::splat::{SplatLight, ToEye};
use super::stage::{Stage, for_each};
use super::store::{Bricks, Drawable, Store, StoreBuilder};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::BRICK_EDGE as EDGE;

/// The most bytes of a buffer of voxels or of sums: enough of them to fill a GPU.
const MOST: u64 = 128 << 20;
/// Bytes of a voxel or of a sum.
const VALUE: u64 = 16;
/// The least planes of voxels that are lit together.
const PLANES: usize = 8;

/// The cells of a level.
pub(crate) struct CellLattice<'a> {
    /// Cells along each axis.
    pub(crate) dims: [usize; 3],
    /// Voxels along a cell, as a fraction in lowest terms.
    pub(crate) size: [usize; 2],
    /// The first voxel with a weight in the first cell, along each axis.
    pub(crate) first: i64,
    /// The weights of the voxels from there on, for as many cells as the divisor of `size`.
    pub(crate) weights: &'a [Vec<f32>],
    /// Cells of a lower density are left out.
    pub(crate) least: f32,
}

impl CellLattice<'_> {
    /// The weights in a cell.
    fn taps(&self) -> usize {
        self.weights.first().map_or(0, Vec::len)
    }

    /// The voxels with weights in these cells. A range begins at a cell that lies between voxels as the first one does.
    fn voxels(&self, cells: &Range<usize>) -> Range<i64> {
        let [over, under] = self.size;
        let first = |cell: usize| self.first + (cell * over / under) as i64;
        first(cells.start)..first(cells.start + cells.len().max(1) - 1) + self.taps() as i64
    }

    /// The number of voxels with weights in so many cells.
    fn count(&self, cells: usize) -> usize {
        let voxels = self.voxels(&(0..cells));
        (voxels.end - voxels.start) as usize
    }

    /// Cells along y of a box: whole bricks, as many as keep the buffers small.
    fn rows(&self, most: u64) -> usize {
        let [across, down, _] = self.dims;
        let fits = |rows: &usize| {
            let rows = (rows * EDGE).min(down);
            let plane = self.count(across) * self.count(rows) * PLANES;
            let planes = across * rows * self.count(EDGE);
            plane.max(planes) as u64 * VALUE <= most
        };
        EDGE * (1..=down.div_ceil(EDGE)).take_while(fits).last().unwrap_or(1)
    }
}

/// The stages of cells of any volume. In [`Stats::stages`](crate::stats::Stats::stages) they are part of `classify`.
struct Coarsener {
    along_axis: Stage,
    count: Stage,
    emit: Stage,
}

const CLASSIFY: &str = "classify";

impl Coarsener {
    fn new(context: &Context) -> Self {
        use Binding::{Read, Uniform, Write};
        let along_axis = (CLASSIFY, "along_axis");
        let slots = [Uniform, Read, Write, Write, Write];
        let entries = ["count", "emit"].map(|entry| (CLASSIFY, entry));
        let [count, emit] = Stage::several(context, shaders::CELLS, entries, &slots, &[]);
        let along_axis = Stage::new(context, shaders::COARSEN, along_axis, &[Uniform, Read, Read, Write], &[]);
        Self { along_axis, count, emit }
    }
}

/// The voxels of a volume on the device.
#[derive(Clone, Copy)]
pub(crate) enum Voxels<'a> {
    /// Classified and lit on the way.
    Samples(&'a Input<'a>, &'a HeldSamples),
    /// Voxels in shadows: splats hold the light that arrives.
    Splats(&'a [Store]),
}

/// The pictures whose voxels one pipeline lights. Splats have no input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct VoxelsKey {
    input: Option<InputKey>,
    lights: u32,
    points: bool,
    perspective: bool,
}

impl VoxelsKey {
    /// The stage that lights voxels.
    fn stage(self, context: &Context) -> Stage {
        use Binding::{Read, Uniform, Write};
        let Self { input, lights, points, perspective } = self;
        let mut constants =
            vec![("LIGHTS", lights), ("POINT_LIGHTS", points.into()), ("PERSPECTIVE", perspective.into())];
        match input {
            Some(input) => {
                constants.extend(input.constants());
                let slots = [Uniform, Read, Read, Uniform, Write, Read, Uniform];
                Stage::new(context, shaders::LIT_VOXELS, (CLASSIFY, "lit_voxels"), &slots, &constants)
            }
            None => {
                constants.push(("SHADOWS", 1));
                let slots = [Uniform, Uniform, Read, Read, Write];
                Stage::new(context, shaders::LIT_SPLATS, (CLASSIFY, "lit_splats"), &slots, &constants)
            }
        }
    }
}

/// What a box of cells needs under another light: the places of its splats are the same.
struct KeptBox {
    cells: [Range<usize>; 3],
    collected: Collected,
}

/// The boxes of all cells that were made together.
struct KeptBoxes(Vec<KeptBox>);

/// The cells of a level under a light; `None`: unlit. `before` are the cells of the same voxels under another light,
/// whose memory is used again.
pub(crate) fn run(
    context: &Context,
    pipelines: &Cache,
    (voxels, light): (Voxels<'_>, Option<&SplatLight>),
    lattice: &CellLattice<'_>,
    before: Option<Drawable>,
    progress: &Progress,
) -> Result<Drawable> {
    let key = VoxelsKey {
        input: match voxels {
            Voxels::Samples(input, _) => Some(input.key()),
            Voxels::Splats(_) => None,
        },
        lights: light.map_or(0, |light| light.lights),
        points: light.is_some_and(|light| light.points),
        perspective: light.is_some_and(|light| light.to_eye.perspective),
    };
    let lighting = light.map_or_else(Lighting::zeroed, |light| light.lighting);
    let (uniform, storage) = (wgpu::BufferUsages::UNIFORM, wgpu::BufferUsages::STORAGE);
    let job = Job {
        context,
        progress,
        lattice,
        coarsener: pipelines.get_or_make((), || Ok(Coarsener::new(context)))?,
        lit_voxels: pipelines.get_or_make(key, || Ok(key.stage(context)))?,
        scan: Scan::of(pipelines, context)?,
        to_eye: light.map_or(&ToEye::PARALLEL, |light| &light.to_eye),
        lighting: context.upload("cells.lighting", bytemuck::bytes_of(&lighting), uniform)?,
        weights: context.upload("cells.weights", bytemuck::cast_slice(&lattice.weights.concat()), storage)?,
    };
    match voxels {
        Voxels::Splats(stores) => job.run(&Source::Splats(stores), before),
        Voxels::Samples(input, held) => {
            let classify = context.upload("cells.classify", bytemuck::bytes_of(&input.parameters()), uniform)?;
            let points = input.points_on_device()?;
            let (made, bytes) = held.with(input, |batches| {
                job.run(&Source::Samples { input, batches, classify: &classify, points: &points }, before)
            })?;
            Ok(Drawable { bricks: Bricks { bytes, ..made.bricks }, ..made })
        }
    }
}

/// The voxels of all boxes, on the device.
enum Source<'a> {
    Samples { input: &'a Input<'a>, batches: &'a [BrickBatch], classify: &'a wgpu::Buffer, points: &'a wgpu::Buffer },
    Splats(&'a [Store]),
}

/// The state that all boxes of cells share.
struct Job<'a> {
    context: &'a Context,
    progress: &'a Progress,
    lattice: &'a CellLattice<'a>,
    coarsener: Arc<Coarsener>,
    lit_voxels: Arc<Stage>,
    scan: Arc<Scan>,
    to_eye: &'a ToEye,
    lighting: wgpu::Buffer,
    weights: wgpu::Buffer,
}

/// The values on the way from voxels to cells.
struct Values {
    /// A few planes of voxels.
    voxels: wgpu::Buffer,
    /// Their sums along x.
    rows: wgpu::Buffer,
    /// The sums along x and y of all planes of a box.
    planes: wgpu::Buffer,
    cells: wgpu::Buffer,
    /// The planes of voxels that are lit together.
    together: usize,
}

impl Job<'_> {
    fn run(&self, source: &Source<'_>, before: Option<Drawable>) -> Result<Drawable> {
        let Self { context, lattice, .. } = self;
        let most = MOST.min(context.limits.max_storage_buffer_binding_size).min(context.limits.max_buffer_size);
        let [across, down, deep] = lattice.dims;
        let rows = lattice.rows(most).min(down);
        let plane = lattice.count(across) * lattice.count(rows);
        let box_planes = lattice.count(EDGE);
        let together = ((most / VALUE) as usize / plane).clamp(1, box_planes);
        let buffer = |label, values: usize| {
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
            context.buffer(label, values as u64 * VALUE, usage)
        };
        let values = Values {
            voxels: buffer("cells.voxels", plane * together)?,
            rows: buffer("cells.rows", across * lattice.count(rows) * together)?,
            planes: buffer("cells.planes", across * rows * box_planes)?,
            cells: buffer("cells.cells", across * rows * EDGE)?,
            together,
        };
        if let Some(before) = before {
            let kept: Arc<Mutex<Option<KeptBoxes>>> = before.kept.get_or_make((), || Ok(Mutex::default()))?;
            let kept = kept.lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some(boxes) = kept {
                return self.relight(source, &values, boxes, before);
            }
        }
        let mut stores = StoreBuilder::new(context, STRIDE, joined(context));
        let mut boxes = Vec::new();
        for z in (0..deep).step_by(EDGE) {
            for y in (0..down).step_by(rows) {
                let cells = [0..across, y..down.min(y + rows), z..deep.min(z + EDGE)];
                let mut recorder = Recorder::untimed(context);
                self.sum(&mut recorder, source, &values, &cells)?;
                let collected = self.collect(recorder, &values.cells, &cells, &mut stores)?;
                boxes.extend(collected.map(|collected| KeptBox { cells, collected }));
                self.progress.check()?;
            }
            self.progress.report("classifying", (z + EDGE).min(deep) as f64 / deep as f64);
        }
        let made = stores.finish()?;
        // A store that was joined holds the splats; other boxes have theirs in a buffer of their own.
        boxes.iter_mut().try_for_each(|KeptBox { collected, .. }| {
            collected.rows.splats = made.stores[collected.store].on_device(context)?;
            Ok::<_, Error>(())
        })?;
        let all = lattice.dims.into_iter().map(|n| n.div_ceil(EDGE) as u32).product();
        let uploaded = made.stores.iter().map(|store| store.runs().count() as u32).sum();
        let made = Drawable { bricks: Bricks { all, uploaded, bytes: 0 }, ..made };
        made.kept.get_or_make((), || Ok(Mutex::new(Some(KeptBoxes(boxes)))))?;
        Ok(made)
    }

    /// The same cells under this light, without a wait.
    fn relight(
        &self,
        source: &Source<'_>,
        values: &Values,
        boxes: KeptBoxes,
        Drawable { stores, bricks, .. }: Drawable,
    ) -> Result<Drawable> {
        for KeptBox { cells, collected: Collected { rows, first_brick, first_splat, .. } } in &boxes.0 {
            // A submission each: all boxes together may outlast the watchdog of a small GPU.
            let mut recorder = Recorder::untimed(self.context);
            self.sum(&mut recorder, source, values, cells)?;
            let first = Some([*first_brick, *first_splat]);
            self.emit(&mut recorder.compute_pass(CLASSIFY), &values.cells, cells, first, rows)?;
            recorder.submit();
        }
        let stores = stores.into_iter().map(|store| store.over(self.context)).collect::<Result<_>>()?;
        let made = Drawable { stores, bricks, ..Drawable::default() };
        made.kept.get_or_make((), || Ok(Mutex::new(Some(boxes))))?;
        Ok(made)
    }

    /// Records the sums of a box of cells.
    fn sum(
        &self,
        recorder: &mut Recorder<'_>,
        source: &Source<'_>,
        Values { voxels, rows, planes, cells: sums, together }: &Values,
        cells: &[Range<usize>; 3],
    ) -> Result<()> {
        let lattice = self.lattice;
        let [over, under] = lattice.size.map(|n| n as u32);
        let [xs, ys, zs] = [0, 1, 2].map(|axis| lattice.voxels(&cells[axis]));
        let [nx, ny] = [&xs, &ys].map(|voxels| (voxels.end - voxels.start) as usize);
        let [across, down, deep] = cells.clone().map(|cells| cells.len());
        let common = Coarsen { taps: lattice.taps() as u32, over, under, ..Coarsen::zeroed() };
        let words = |values: [usize; 3]| values.map(|value| value as u32);
        for z in zs.clone().step_by(*together) {
            let some = z..zs.end.min(z + *together as i64);
            let count = (some.end - some.start) as usize;
            recorder.clear(voxels, (nx * ny * count) as u64 * VALUE);
            self.light(recorder, source, voxels, [&xs, &ys, &some])?;
            let along_x =
                Coarsen { dims: words([across, ny, count]), steps: words([0, nx, nx * ny]), stride: 1, axis: 0, ..common };
            let along_y = Coarsen {
                dims: words([across, down, count]),
                steps: words([1, 0, across * ny]),
                stride: across as u32,
                axis: 1,
                first: (across * down) as u32 * (z - zs.start) as u32,
                ..common
            };
            self.coarsen(recorder, &along_x, voxels, rows)?;
            self.coarsen(recorder, &along_y, rows, planes)?;
        }
        let along_z = Coarsen {
            dims: words([across, down, deep]),
            steps: words([1, across, 0]),
            stride: (across * down) as u32,
            axis: 2,
            ..common
        };
        self.coarsen(recorder, &along_z, planes, sums)
    }

    /// Records sums along an axis.
    fn coarsen(
        &self,
        recorder: &mut Recorder<'_>,
        parameters: &Coarsen,
        from: &wgpu::Buffer,
        to: &wgpu::Buffer,
    ) -> Result<()> {
        let context = recorder.context;
        let count = parameters.dims.into_iter().map(u64::from).product();
        let parameters =
            context.upload("cells.coarsen", bytemuck::bytes_of(parameters), wgpu::BufferUsages::UNIFORM)?;
        let buffers = [&parameters, &self.weights, from, to].map(wgpu::Buffer::as_entire_binding);
        self.coarsener.along_axis.run(recorder, &buffers, for_each(context, count));
        Ok(())
    }

    /// Records the voxels of a box.
    fn light(
        &self,
        recorder: &mut Recorder<'_>,
        source: &Source<'_>,
        voxels: &wgpu::Buffer,
        within: [&Range<i64>; 3],
    ) -> Result<()> {
        let context = self.context;
        let reaches = |low: [u32; 3], high: [u32; 3]| {
            let inside =
                |axis: usize| i64::from(low[axis]) < within[axis].end && i64::from(high[axis]) > within[axis].start;
            (0..3).all(inside)
        };
        let ToEye { eye, view: [view_x, view_y, view_z], .. } = *self.to_eye;
        // From the first to before the last brick or splat.
        let inside = |first: u32, end: u32| {
            let parameters = VoxelBox {
                low: within.map(|range| range.start as i32),
                first,
                dims: within.map(|range| (range.end - range.start) as u32),
                end,
                eye,
                view_x,
                view_y,
                view_z,
                ..VoxelBox::zeroed()
            };
            context.upload("cells.voxel_box", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)
        };
        let mut record = |buffers: &[&wgpu::Buffer], count: u64| {
            let resources: Vec<_> = buffers.iter().map(|buffer| buffer.as_entire_binding()).collect();
            self.lit_voxels.run(recorder, &resources, for_each(context, count));
        };
        match *source {
            Source::Samples { input, batches, classify, points } => {
                let ranges = input.volume.ranges()?;
                for (batch, ranges) in batches.iter().zip(ranges.chunks(BATCH)) {
                    let shows = |&at: &usize| {
                        let [x, y, z, _] = batch.origins[at];
                        reaches([x, y, z], [x, y, z].map(|first| first + EDGE as u32)) && input.may_show(ranges[at])
                    };
                    let mut bricks = (0..batch.origins.len()).filter(shows);
                    let Some(first) = bricks.next() else { continue };
                    let end = bricks.next_back().unwrap_or(first) + 1;
                    let inside = inside(first as u32, end as u32)?;
                    let places = &batch.places;
                    record(
                        &[classify, &batch.samples, points, &self.lighting, voxels, places, &inside],
                        ((end - first) * ROWS * EDGE) as u64,
                    );
                }
            }
            Source::Splats(stores) => {
                for store in stores {
                    let mut runs = store.runs().filter(|(brick, _)| reaches(brick.bounds[0], brick.bounds[1]));
                    let Some((_, Range { start, end })) = runs.next() else { continue };
                    let end = runs.last().map_or(end, |(_, run)| run.end);
                    let splats = store.on_device(context)?;
                    let buffers = [&inside(start, end)?, &self.lighting, &splats, &store.origins, voxels];
                    record(&buffers, u64::from(end - start));
                }
            }
        }
        Ok(())
    }

    /// Adds the cells of a box as splats, after what the recorder holds.
    fn collect(
        &self,
        recorder: Recorder<'_>,
        cells: &wgpu::Buffer,
        within: &[Range<usize>; 3],
        stores: &mut StoreBuilder<'_, DevicePart>,
    ) -> Result<Option<Collected>> {
        let edge = EDGE as u32;
        let [bx, by, bz] = bricks_of(within);
        let [_, y0, z0] = within.clone().map(|range| range.start as u32);
        let origin = |brick: u32| [brick % bx * edge, y0 + brick / bx % by * edge, z0 + brick / (bx * by) * edge, 0];
        let origins: Vec<[u32; 4]> = (0..bx * by * bz).map(origin).collect();
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let on_device = self.context.upload("cells.origins", bytemuck::cast_slice(&origins), usage)?;
        // Each box has a buffer for its splats.
        let record = |pass: &mut ComputePass<'_>, first: Option<u32>, rows: &Rows| {
            self.emit(pass, cells, within, first.map(|first_brick| [first_brick, 0]), rows)
        };
        collect(recorder, &self.scan, (stores, STRIDE), (&origins, &on_device), &record)
    }

    /// Records the dispatch that counts the cells of a box that are kept, or that emits them, given the numbers of the
    /// first brick and of the first splat.
    fn emit(
        &self,
        pass: &mut ComputePass<'_>,
        cells: &wgpu::Buffer,
        within: &[Range<usize>; 3],
        first: Option<[u32; 2]>,
        Rows { places, seen, splats }: &Rows,
    ) -> Result<()> {
        let [bx, by, bz] = bricks_of(within);
        let bricks = [bx, by, bx * by * bz];
        let (dims, least) = (within.clone().map(|range| range.len() as u32), self.lattice.least);
        let [first_brick, first_splat] = first.unwrap_or_default();
        let parameters = CellBox { dims, least, bricks, first_brick, first_splat, ..CellBox::zeroed() };
        let parameters =
            self.context.upload("cells.cell_box", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
        let buffers = [&parameters, cells, places, seen, splats].map(wgpu::Buffer::as_entire_binding);
        let stage = if first.is_some() { &self.coarsener.emit } else { &self.coarsener.count };
        let workgroups = for_each(self.context, u64::from(bricks[2]) * ROWS as u64);
        stage.record(pass, &stage.bind(self.context, &buffers), &[], workgroups);
        Ok(())
    }
}

/// Bricks along each axis of a box of cells.
fn bricks_of(cells: &[Range<usize>; 3]) -> [u32; 3] {
    cells.clone().map(|range| range.len().div_ceil(EDGE) as u32)
}
