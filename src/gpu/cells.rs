//! cells: the samples of a volume to classified and lit cells of a level, on the device: shaders/lit_voxels.wgsl,
//! coarsen.wgsl and cells.wgsl. Boxes of cells are made one after the other: the planes of their voxels a few at a time,
//! summed along x and y, then the sums along z.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::Zeroable;

use super::cache::Cache;
use super::classify::{BATCH, BrickBatch, HeldSamples, Input, InputKey, STRIDE, joined};
use super::context::Context;
use super::layout::{CellBox, Coarsen, Lighting, VoxelBox};
use super::pipeline::{Binding, bind, compute, flag, layout, module};
use super::recorder::{ComputePass, Recorder};
use super::rows::{DevicePart, ROWS, Rows, collect};
use super::scan::{Scan, WORKGROUP};
use super::shaders::{self, Shader};
use super::splat::{SplatLight, ToEye};
use super::store::{Bricks, Drawable, StoreBuilder};
use crate::error::Result;
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
    /// Voxels along a cell.
    pub(crate) size: usize,
    /// The first voxel with a weight in the first cell, along each axis.
    pub(crate) first: i64,
    /// The weights of the voxels from there on.
    pub(crate) weights: &'a [f32],
    /// Cells of a lower density are left out.
    pub(crate) least: f32,
}

impl CellLattice<'_> {
    /// The voxels with weights in these cells.
    fn voxels(&self, cells: &Range<usize>) -> Range<i64> {
        let start = self.first + (cells.start * self.size) as i64;
        start..start + ((cells.len().max(1) - 1) * self.size + self.weights.len()) as i64
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

/// A pipeline of one entry point with its bindings.
struct Pass {
    layout: wgpu::BindGroupLayout,
    pipelines: Vec<wgpu::ComputePipeline>,
}

impl Pass {
    fn new(context: &Context, shader: Shader, entries: &[&str], slots: &[Binding], constants: &[(&str, f64)]) -> Self {
        let layout = layout(context, shader.name, wgpu::ShaderStages::COMPUTE, slots);
        let module = module(context, shader);
        let pipeline = |entry: &&str| compute(context, &module, shader.name, entry, &layout, constants);
        let pipelines = entries.iter().map(pipeline).collect();
        Self { layout, pipelines }
    }

    /// Records a dispatch of an entry point with `count` invocations.
    fn record(
        &self,
        context: &Context,
        pass: &mut ComputePass<'_>,
        entry: usize,
        buffers: &[&wgpu::Buffer],
        count: u64,
    ) {
        let resources: Vec<_> = buffers.iter().map(|buffer| buffer.as_entire_binding()).collect();
        let group = bind(context, "cells", &self.layout, &resources);
        let (x, y) = context.workgroups(count, WORKGROUP);
        pass.dispatch(&self.pipelines[entry], &group, &[], [x, y, 1]);
    }
}

/// The pipelines of cells of any volume.
struct Coarsener {
    along_axis: Pass,
    /// `count` and `emit`.
    cells: Pass,
}

impl Coarsener {
    fn new(context: &Context) -> Self {
        use Binding::{Read, Uniform, Write};
        let cells = [Uniform, Read, Write, Write, Write];
        Self {
            along_axis: Pass::new(context, shaders::COARSEN, &["along_axis"], &[Uniform, Read, Read, Write], &[]),
            cells: Pass::new(context, shaders::CELLS, &["count", "emit"], &cells, &[]),
        }
    }
}

/// The pictures whose voxels one pipeline lights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct VoxelsKey {
    input: InputKey,
    lights: u32,
    points: bool,
    perspective: bool,
}

/// The pipeline that classifies and lights voxels.
struct LitVoxels(Pass);

impl LitVoxels {
    fn new(context: &Context, VoxelsKey { input, lights, points, perspective }: VoxelsKey) -> Self {
        use Binding::{Read, Uniform, Write};
        let [sample_type, lit, gradient_opacity] = input.constants();
        let constants = [
            sample_type,
            lit,
            gradient_opacity,
            ("LIGHTS", f64::from(lights)),
            ("POINT_LIGHTS", flag(points)),
            ("PERSPECTIVE", flag(perspective)),
        ];
        let slots = [Uniform, Read, Read, Uniform, Write, Read, Uniform];
        Self(Pass::new(context, shaders::LIT_VOXELS, &["lit_voxels"], &slots, &constants))
    }
}

/// The cells of a level, of a volume whose samples the device holds, under a light; `None`: unlit.
pub(crate) fn run(
    pipelines: &Cache,
    input: &Input<'_>,
    held: &HeldSamples,
    light: Option<&SplatLight>,
    lattice: &CellLattice<'_>,
) -> Result<Drawable> {
    let context = input.context;
    let key = VoxelsKey {
        input: input.key(),
        lights: light.map_or(0, |light| light.lights),
        points: light.is_some_and(|light| light.points),
        perspective: light.is_some_and(|light| light.to_eye.perspective),
    };
    let lighting = light.map_or_else(Lighting::zeroed, |light| light.lighting);
    let uniform = wgpu::BufferUsages::UNIFORM;
    let job = Job {
        input,
        lattice,
        coarsener: pipelines.get_or_make((), || Ok(Coarsener::new(context)))?,
        lit_voxels: pipelines.get_or_make(key, || Ok(LitVoxels::new(context, key)))?,
        scan: Scan::of(pipelines, context)?,
        to_eye: light.map_or(&ToEye::PARALLEL, |light| &light.to_eye),
        parameters: context.upload("cells.classify", bytemuck::bytes_of(&input.parameters()), uniform)?,
        points: input.points_on_device()?,
        lighting: context.upload("cells.lighting", bytemuck::bytes_of(&lighting), uniform)?,
        weights: context.upload("cells.weights", bytemuck::cast_slice(lattice.weights), wgpu::BufferUsages::STORAGE)?,
    };
    let (made, bytes) = held.with(input, |batches| job.run(batches))?;
    let all = lattice.dims.into_iter().map(|n| n.div_ceil(EDGE) as u32).product();
    let uploaded = made.stores.iter().map(|store| store.runs().count() as u32).sum();
    Ok(Drawable { bricks: Bricks { all, uploaded, bytes }, ..made })
}

/// The state that all boxes of cells share.
struct Job<'a> {
    input: &'a Input<'a>,
    lattice: &'a CellLattice<'a>,
    coarsener: Arc<Coarsener>,
    lit_voxels: Arc<LitVoxels>,
    scan: Arc<Scan>,
    to_eye: &'a ToEye,
    parameters: wgpu::Buffer,
    points: wgpu::Buffer,
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
}

impl Job<'_> {
    fn run(&self, batches: &[BrickBatch]) -> Result<Drawable> {
        let Self { input, lattice, .. } = self;
        let context = input.context;
        let most = MOST.min(context.limits.max_storage_buffer_binding_size).min(context.limits.max_buffer_size);
        let [across, down, deep] = lattice.dims;
        let rows = lattice.rows(most).min(down);
        let plane = lattice.count(across) * lattice.count(rows);
        let box_planes = lattice.count(EDGE);
        let planes = ((most / VALUE) as usize / plane).clamp(1, box_planes);
        let buffer = |label, values: usize| {
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
            context.buffer(label, values as u64 * VALUE, usage)
        };
        let values = Values {
            voxels: buffer("cells.voxels", plane * planes)?,
            rows: buffer("cells.rows", across * lattice.count(rows) * planes)?,
            planes: buffer("cells.planes", across * rows * box_planes)?,
            cells: buffer("cells.cells", across * rows * EDGE)?,
        };
        let mut stores = StoreBuilder::new(context, STRIDE, joined(context));
        for z in (0..deep).step_by(EDGE) {
            for y in (0..down).step_by(rows) {
                let cells = [0..across, y..down.min(y + rows), z..deep.min(z + EDGE)];
                let mut recorder = Recorder::untimed(context);
                self.sum(&mut recorder, batches, &values, &cells, planes)?;
                self.collect(recorder, &values.cells, &cells, &mut stores)?;
                input.progress.check()?;
            }
            input.progress.report("classifying", (z + EDGE).min(deep) as f64 / deep as f64);
        }
        stores.finish()
    }

    /// Records the sums of a box of cells, from `together` planes of voxels at a time.
    fn sum(
        &self,
        recorder: &mut Recorder<'_>,
        batches: &[BrickBatch],
        Values { voxels, rows, planes, cells: sums }: &Values,
        cells: &[Range<usize>; 3],
        together: usize,
    ) -> Result<()> {
        let lattice = self.lattice;
        let (size, taps) = (lattice.size, lattice.weights.len() as u32);
        let [xs, ys, zs] = [0, 1, 2].map(|axis| lattice.voxels(&cells[axis]));
        let [nx, ny] = [&xs, &ys].map(|voxels| (voxels.end - voxels.start) as usize);
        let [across, down, deep] = cells.clone().map(|cells| cells.len());
        let common = Coarsen { taps, ..Coarsen::zeroed() };
        let words = |values: [usize; 3]| values.map(|value| value as u32);
        for z in zs.clone().step_by(together) {
            let some = z..zs.end.min(z + together as i64);
            let count = (some.end - some.start) as usize;
            recorder.clear(voxels, (nx * ny * count) as u64 * VALUE);
            self.light(recorder, batches, voxels, [&xs, &ys, &some])?;
            let along_x =
                Coarsen { dims: words([across, ny, count]), steps: words([size, nx, nx * ny]), stride: 1, ..common };
            let along_y = Coarsen {
                dims: words([across, down, count]),
                steps: words([1, across * size, across * ny]),
                stride: across as u32,
                first: (across * down) as u32 * (z - zs.start) as u32,
                ..common
            };
            self.coarsen(recorder, &along_x, voxels, rows)?;
            self.coarsen(recorder, &along_y, rows, planes)?;
        }
        let along_z = Coarsen {
            dims: words([across, down, deep]),
            steps: words([1, across, across * down * size]),
            stride: (across * down) as u32,
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
        let buffers = [&parameters, &self.weights, from, to];
        self.coarsener.along_axis.record(context, &mut recorder.compute_pass("classify"), 0, &buffers, count);
        Ok(())
    }

    /// Records the voxels of a box.
    fn light(
        &self,
        recorder: &mut Recorder<'_>,
        batches: &[BrickBatch],
        voxels: &wgpu::Buffer,
        within: [&Range<i64>; 3],
    ) -> Result<()> {
        let context = recorder.context;
        let ToEye { eye, view: [view_x, view_y, view_z], .. } = *self.to_eye;
        let ranges = self.input.volume.ranges()?;
        for (batch, ranges) in batches.iter().zip(ranges.chunks(BATCH)) {
            let reached = |origin: &[u32; 4]| {
                (0..3).all(|axis| {
                    let first = i64::from(origin[axis]);
                    first < within[axis].end && first + EDGE as i64 > within[axis].start
                })
            };
            let shows = |&at: &usize| reached(&batch.origins[at]) && self.input.may_show(ranges[at]);
            let mut bricks = (0..batch.origins.len()).filter(shows);
            let Some(first) = bricks.next() else { continue };
            let end = bricks.next_back().unwrap_or(first) + 1;
            let parameters = VoxelBox {
                low: within.map(|range| range.start as i32),
                first_brick: first as u32,
                dims: within.map(|range| (range.end - range.start) as u32),
                end_brick: end as u32,
                eye,
                view_x,
                view_y,
                view_z,
                ..VoxelBox::zeroed()
            };
            let parameters =
                context.upload("cells.voxel_box", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
            let Self { parameters: classify, points, lighting, .. } = self;
            let buffers = [classify, &batch.samples, points, lighting, voxels, &batch.places, &parameters];
            let count = ((end - first) * ROWS * EDGE) as u64;
            self.lit_voxels.0.record(context, &mut recorder.compute_pass("classify"), 0, &buffers, count);
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
    ) -> Result<()> {
        let context = recorder.context;
        let dims = within.clone().map(|range| range.len() as u32);
        let [bx, by, bz] = dims.map(|n| n.div_ceil(EDGE as u32));
        let edge = EDGE as u32;
        let [_, y0, z0] = within.clone().map(|range| range.start as u32);
        let origin = |brick: u32| [brick % bx * edge, y0 + brick / bx % by * edge, z0 + brick / (bx * by) * edge, 0];
        let origins: Vec<[u32; 4]> = (0..bx * by * bz).map(origin).collect();
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let on_device = context.upload("cells.origins", bytemuck::cast_slice(&origins), usage)?;
        let count = (origins.len() * ROWS) as u64;
        let record = |pass: &mut ComputePass<'_>, first: Option<u32>, Rows { places, seen, splats }: &Rows| {
            let (least, first_brick) = (self.lattice.least, first.unwrap_or_default());
            let parameters = CellBox { dims, least, bricks: [bx, by, bx * by * bz], first_brick };
            let parameters =
                context.upload("cells.cell_box", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
            let entry = usize::from(first.is_some());
            let buffers = [&parameters, cells, places, seen, splats];
            self.coarsener.cells.record(context, pass, entry, &buffers, count);
            Ok(())
        };
        collect(recorder, &self.scan, (stores, STRIDE), (&origins, &on_device), &record)
    }
}
