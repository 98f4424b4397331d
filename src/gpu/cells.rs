//! cells: the samples of a volume, or its splats in shadows, to lit cells of a level, on the device:
//! shaders/lit_rows.wgsl or lit_splats.wgsl with coarsen.wgsl, and cells.wgsl. Boxes of cells are made one after the
//! other: the sums along x and y of planes of voxels, then the sums along z.
//!
//! Which voxels of the samples are visible, and their normals, is found once and kept: kept_voxels.rs.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Zeroable;

use super::cache::Cache;
use super::classify::{JOINED, STRIDE, VisibleVoxels};
use super::context::Context;
use super::kept_voxels::{CLASSIFY, FOUND};
use super::layout::{CellBox, Coarsen, Lighting, VoxelBox};
use super::pipeline::Binding;
use super::recorder::{ComputePass, Recorder, max_work};
use super::rows::{Collected, DevicePart, Rows, collect};
use super::sampled::{Sampled, SampledBuffer, SampledKey};
use super::samples::{Bricks, ROWS};
use super::scan::{Scan, WORKGROUP};
use super::shaders;
use super::splat::{SplatLight, ToEye};
use super::stage::{Stage, for_each};
use super::store::{Drawable, Store, StoreBuilder};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::BRICK_EDGE as EDGE;

/// The largest number of bytes of a buffer of voxels or of sums. There is one such buffer in each frame, three for
/// voxels in shadows. Larger ones take fewer dispatches, but to allocate 256 MiB more took 5 ms of a frame on an H200.
pub(super) const MOST: u64 = 128 << 20;
/// The number of bytes of a voxel or of a sum.
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
struct Coarsener {
    along_axis: Stage,
    count: Stage,
    emit: Stage,
}

impl Coarsener {
    fn new(context: &Context) -> Self {
        use Binding::{Read, Uniform, Write};
        let along_axis = (CLASSIFY, "along_axis");
        let slots = [Uniform, Read, Read, Write, Write, Write];
        let entries = ["count", "emit"].map(|entry| (CLASSIFY, entry));
        let [count, emit] = Stage::several(context, shaders::CELLS, entries, &slots, &[]);
        let along_axis = Stage::new(context, shaders::COARSEN, along_axis, &[Uniform, Read, Read, Write], &[]);
        Self { along_axis, count, emit }
    }
}

/// The voxels of a volume on the device.
#[derive(Clone, Copy)]
pub(crate) enum Voxels<'a> {
    /// The samples of voxels, which are classified and lit on the way.
    Samples(&'a Sampled),
    /// Listed voxels in shadows: splats hold the light that arrives.
    Splats(&'a [Store]),
}

/// The pictures whose voxels one pipeline lights. Splats have no input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct VoxelsKey {
    samples: Option<SampledKey>,
    lights: u32,
    points: bool,
    perspective: bool,
}

impl VoxelsKey {
    /// Returns the stage that lights voxels.
    fn stage(self, context: &Context) -> Stage {
        use Binding::{Read, Uniform, Write};
        let Self { samples, lights, points, perspective } = self;
        let mut constants =
            vec![("LIGHTS", lights), ("POINT_LIGHTS", points.into()), ("PERSPECTIVE", perspective.into())];
        match samples {
            Some(samples) => {
                constants.extend(samples.constants());
                let slots = [Uniform, Read, Read, Uniform, Write, Read, Read, Read, Uniform, Read, Read];
                Stage::new(context, shaders::LIT_ROWS, (CLASSIFY, "lit_rows"), &slots, &constants)
            }
            None => {
                constants.push(("SHADOWS", 1));
                let slots = [Uniform, Uniform, Read, Read, Write];
                Stage::new(context, shaders::LIT_SPLATS, (CLASSIFY, "lit_splats"), &slots, &constants)
            }
        }
    }
}

/// A box of cells, kept for another light: the places of its splats stay.
struct KeptBox {
    cells: [Range<usize>; 3],
    collected: Collected,
}

/// The boxes of all cells that were made together.
struct KeptBoxes(Vec<KeptBox>);

/// Makes the cells of a level under a light; `None`: unlit. `before` are the cells of the same voxels under another
/// light, whose memory is used again.
pub(crate) fn run(
    context: &Context,
    pipelines: &Cache,
    (voxels, light): (Voxels<'_>, Option<&SplatLight>),
    lattice: &CellLattice<'_>,
    before: Option<Drawable>,
    progress: &Progress,
) -> Result<Drawable> {
    let (uniform, storage) = (wgpu::BufferUsages::UNIFORM, wgpu::BufferUsages::STORAGE);
    let lighting = light.map_or_else(Lighting::zeroed, |light| light.lighting);
    let key = VoxelsKey {
        samples: if let Voxels::Samples(sampled) = voxels { Some(sampled.key()) } else { None },
        lights: light.map_or(0, |light| light.lights),
        points: light.is_some_and(|light| light.points),
        perspective: light.is_some_and(|light| light.to_eye.perspective),
    };
    let job = CellJob {
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
        Voxels::Samples(sampled) => {
            let classify = context.upload("cells.classify", bytemuck::bytes_of(&sampled.parameters()), uniform)?;
            let (parts, points) = (sampled.buffers().collect(), sampled.points());
            job.run(&Source::Samples { parts, classify: &classify, points }, before)
        }
    }
}

/// The voxels of all boxes, on the device.
enum Source<'a> {
    Samples { parts: Vec<SampledBuffer<'a>>, classify: &'a wgpu::Buffer, points: &'a wgpu::Buffer },
    Splats(&'a [Store]),
}

impl Source<'_> {
    /// Returns the work for a voxel, in fragments of splats.
    fn work(&self) -> u64 {
        match self {
            Source::Samples { parts, .. } if parts.iter().any(|part| part.normals.is_none()) => FOUND,
            _ => LIT,
        }
    }
}

/// The state that all boxes of cells share.
struct CellJob<'a> {
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
    /// A few planes of voxels in shadows, and their sums along x; `None`: voxels are summed as they are lit.
    voxels: Option<[wgpu::Buffer; 2]>,
    /// The sums along x and y of all planes of a box.
    planes: wgpu::Buffer,
    /// The number of planes of voxels that are lit together.
    together: usize,
}

impl Values {
    fn new(context: &Context, source: &Source<'_>, lattice: &CellLattice<'_>, most: u64, plan: &Plan) -> Result<Self> {
        let &Plan { rows, lines, planes, .. } = plan;
        let ([across, ..], [width, ..]) = (lattice.dims, lattice.voxels);
        let buffer = |label, values: usize| {
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
            context.buffer(label, values as u64 * VALUE, usage)
        };
        let within =
            |all: u64, of_plane: usize| (all / (of_plane as u64).max(1)).clamp(1, planes.max(1) as u64) as usize;
        let (voxels, at_once) = match source {
            // No dispatch outlasts the watchdog of a small GPU.
            Source::Samples { .. } => (None, within(max_work(context) / source.work(), width * lines)),
            Source::Splats(_) => {
                let together = within(most / VALUE, across.max(width) * lines);
                let voxels = buffer("cells.voxels", width * lines * together)?;
                (Some([voxels, buffer("cells.rows", across * lines * together)?]), together)
            }
        };
        let planes_of_box = buffer("cells.planes", across * rows * planes)?;
        // Parts of much the same size.
        Ok(Self { voxels, planes: planes_of_box, together: planes.div_ceil(planes.div_ceil(at_once)) })
    }
}

impl CellJob<'_> {
    fn run(&self, source: &Source<'_>, before: Option<Drawable>) -> Result<Drawable> {
        let Self { context, lattice, .. } = self;
        let most = MOST.min(context.largest_buffer());
        let [across, down, deep] = lattice.dims;
        let plan = lattice.plan(most);
        let values = Values::new(context, source, lattice, most, &plan)?;
        let Plan { rows, layers, .. } = plan;
        if let Some(before) = before {
            let kept: Arc<Mutex<Option<KeptBoxes>>> = before.kept.get_or_make((), || Ok(Mutex::default()))?;
            let kept = kept.lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some(boxes) = kept {
                return self.relight(source, &values, boxes, before);
            }
        }
        let mut stores = StoreBuilder::new(context, STRIDE, JOINED);
        let mut boxes = Vec::new();
        for z in (0..deep).step_by(layers) {
            for y in (0..down).step_by(rows) {
                let cells = [0..across, y..down.min(y + rows), z..deep.min(z + layers)];
                let mut recorder = Recorder::untimed(context);
                self.sum(&mut recorder, source, &values, &cells)?;
                let collected = self.collect(recorder, &values.planes, &cells, &mut stores)?;
                boxes.extend(collected.map(|collected| KeptBox { cells, collected }));
                self.progress.check()?;
            }
            self.progress.report("classifying", (z + layers).min(deep) as f64 / deep as f64);
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

    /// Lights the cells of `boxes` again, without a wait.
    fn relight(
        &self,
        source: &Source<'_>,
        values: &Values,
        boxes: KeptBoxes,
        Drawable { stores, bricks, .. }: Drawable,
    ) -> Result<Drawable> {
        let mut recorder = Recorder::untimed(self.context);
        for KeptBox { cells, collected: Collected { rows, first_brick, first_splat, .. } } in &boxes.0 {
            self.sum(&mut recorder, source, values, cells)?;
            let first = Some([*first_brick, *first_splat]);
            self.emit(&mut recorder.compute_pass(CLASSIFY), &values.planes, cells, first, rows)?;
        }
        recorder.submit();
        let stores = stores.into_iter().map(|store| store.over(self.context)).collect::<Result<_>>()?;
        let made = Drawable { stores, bricks, ..Drawable::default() };
        made.kept.get_or_make((), || Ok(Mutex::new(Some(boxes))))?;
        Ok(made)
    }

    /// Records the sums along x and y of the planes of a box of cells.
    fn sum(
        &self,
        recorder: &mut Recorder<'_>,
        source: &Source<'_>,
        values: &Values,
        cells: &[Range<usize>; 3],
    ) -> Result<()> {
        let lattice = self.lattice;
        let [xs, ys, zs] = [0, 1, 2].map(|axis| lattice.voxels(axis, &cells[axis]));
        let [across, down] = [0, 1].map(|axis| cells[axis].len());
        for z in zs.clone().step_by(values.together) {
            let within = [xs.clone(), ys.clone(), z..zs.end.min(z + values.together)];
            let [nx, ny, count] = within.clone().map(|voxels| voxels.len());
            match &values.voxels {
                None => self.light(recorder, source, &values.planes, (&within, z - zs.start), cells)?,
                Some([voxels, rows]) if nx * ny > 0 => {
                    recorder.clear(voxels, (nx * ny * count) as u64 * VALUE);
                    self.light(recorder, source, voxels, (&within, 0), cells)?;
                    let along_x = self.coarsen(0, cells, [across, ny, count], [1, nx, nx * ny], 0);
                    self.along_axis(recorder, &along_x, voxels, rows)?;
                    let first = across * down * (z - zs.start);
                    let along_y = self.coarsen(1, cells, [across, down, count], [1, across, across * ny], first);
                    self.along_axis(recorder, &along_y, rows, &values.planes)?;
                }
                Some(_) => {}
            }
            recorder.worked((nx * ny * count) as u64 * source.work());
        }
        Ok(())
    }

    /// Returns the parameters of the sums of a box of cells along an axis: `dims` sums along each axis, of values with
    /// these steps, from place `first` on.
    fn coarsen(
        &self,
        axis: usize,
        cells: &[Range<usize>; 3],
        dims: [usize; 3],
        steps: [usize; 3],
        first: usize,
    ) -> Coarsen {
        let voxels = self.lattice.voxels(axis, &cells[axis]);
        let [over, under] = words(self.lattice.size);
        Coarsen {
            dims: words(dims),
            first: first as u32,
            steps: words(steps),
            count: voxels.len() as u32,
            axis: std::array::from_fn(|other| u32::from(other == axis)),
            low: (self.lattice.low(cells[axis].start) - voxels.start as i64) as i32,
            over,
            under,
            ..Coarsen::zeroed()
        }
    }

    /// Records sums along an axis.
    fn along_axis(
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

    /// Records the voxels of some planes of a box of cells, or of samples their sums along x and y, given the number of
    /// the first plane.
    fn light(
        &self,
        recorder: &mut Recorder<'_>,
        source: &Source<'_>,
        to: &wgpu::Buffer,
        (within, first_plane): (&[Range<usize>; 3], usize),
        cells: &[Range<usize>; 3],
    ) -> Result<()> {
        let Self { context, lattice, .. } = self;
        let ToEye { eye, view: [view_x, view_y, view_z], .. } = *self.to_eye;
        let across = lattice.dims[0];
        let [over, under] = words(lattice.size);
        // From the first to before the last brick or splat.
        let inside = |Range { start, end }: Range<u32>| {
            let parameters = VoxelBox {
                low: within.clone().map(|range| range.start as u32),
                first: start,
                dims: within.clone().map(|range| range.len() as u32),
                end,
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
            context.upload("cells.voxel_box", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)
        };
        let mut record = |buffers: &[&wgpu::Buffer], count: u64| {
            let resources: Vec<_> = buffers.iter().map(|buffer| buffer.as_entire_binding()).collect();
            self.lit_voxels.run(recorder, &resources, for_each(context, count));
        };
        match source {
            Source::Samples { parts, classify, points } => {
                let [_, ys, zs] = within;
                if ys.is_empty() || zs.is_empty() {
                    return Ok(());
                }
                let [bricks_x, bricks_y, _] = self.lattice.voxels.map(|n| n.div_ceil(EDGE) as u32);
                let row = |y: usize, z: usize| bricks_x * ((y / EDGE) as u32 + bricks_y * (z / EDGE) as u32);
                let reached = row(ys.start, zs.start)..row(ys.end - 1, zs.end - 1) + bricks_x;
                let groups = (across.div_ceil(SUMS) * cells[1].len().div_ceil(TILE_ROWS) * zs.len()) as u64;
                let reaches =
                    |part: &&SampledBuffer<'_>| part.bricks.start < reached.end && part.bricks.end > reached.start;
                for SampledBuffer { bricks, samples, visible, normals, kept } in parts.iter().filter(reaches) {
                    let VisibleVoxels { places, seen, .. } = visible;
                    let [normals, kept] = [normals, kept].map(|buffer| buffer.unwrap_or(places));
                    let (lighting, weights, inside) = (&self.lighting, &self.weights, &inside(bricks.clone())?);
                    let buffers =
                        [classify, samples, points, lighting, to, places, seen, weights, inside, normals, kept];
                    record(&buffers, groups * WORKGROUP);
                }
            }
            Source::Splats(stores) => {
                let reaches = |low: [u32; 3], high: [u32; 3]| {
                    let inside = |axis: usize| {
                        (low[axis] as usize) < within[axis].end && high[axis] as usize > within[axis].start
                    };
                    (0..3).all(inside)
                };
                for store in *stores {
                    let mut runs = store.runs().filter(|(brick, _)| reaches(brick.bounds[0], brick.bounds[1]));
                    let Some((_, Range { start, end })) = runs.next() else { continue };
                    let end = runs.last().map_or(end, |(_, run)| run.end);
                    let splats = store.on_device(context)?;
                    let buffers = [&inside(start..end)?, &self.lighting, &splats, &store.origins, to];
                    record(&buffers, u64::from(end - start));
                }
            }
        }
        Ok(())
    }

    /// Counts the cells of a box and adds them as splats, after the recorder's commands.
    fn collect(
        &self,
        recorder: Recorder<'_>,
        planes: &wgpu::Buffer,
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
            self.emit(pass, planes, within, first.map(|first_brick| [first_brick, 0]), rows)
        };
        collect(recorder, &self.scan, (stores, STRIDE), (&origins, &on_device), &record)
    }

    /// Records the dispatch that counts the cells of a box that are kept, or that emits them, given the numbers of the
    /// first brick and of the first splat.
    fn emit(
        &self,
        pass: &mut ComputePass<'_>,
        planes: &wgpu::Buffer,
        within: &[Range<usize>; 3],
        first: Option<[u32; 2]>,
        Rows { places, seen, splats }: &Rows,
    ) -> Result<()> {
        let Self { context, lattice, .. } = self;
        let [bx, by, bz] = bricks_of(within);
        let bricks = [bx, by, bx * by * bz];
        let [first_brick, first_splat] = first.unwrap_or_default();
        let voxels = lattice.voxels(2, &within[2]);
        let [over, under] = words(lattice.size);
        let parameters = CellBox {
            dims: within.clone().map(|range| range.len() as u32),
            least: lattice.least,
            bricks,
            first_brick,
            first_splat,
            over,
            under,
            low: (lattice.low(within[2].start) - voxels.start as i64) as i32,
            planes: voxels.len() as u32,
            ..CellBox::zeroed()
        };
        let parameters =
            context.upload("cells.cell_box", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
        let buffers = [&parameters, &self.weights, planes, places, seen, splats].map(wgpu::Buffer::as_entire_binding);
        // Rows are counted, cells are emitted.
        let (stage, each) =
            if first.is_some() { (&self.coarsener.emit, ROWS * EDGE) } else { (&self.coarsener.count, ROWS) };
        let workgroups = for_each(context, u64::from(bricks[2]) * each as u64);
        stage.record(pass, &stage.bind(context, &buffers), &[], workgroups);
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
