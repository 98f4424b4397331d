//! classify: the samples of a volume to the visible voxels, and to lists of splats of them.

use std::sync::Arc;

use super::cache::Cache;
use super::context::Context;
use super::held_samples::{HeldBricks, HeldBuffer};
use super::layout::{Classify, Extent, Splat};
use super::pipeline::Binding;
use super::recorder::{ComputePass, Readback, Recorder};
use super::rows::{DevicePart, Rows, collect};
use super::samples::{BrickBatch, Input, InputKey, ROWS};
use super::scan::Scan;
use super::shaders;
use super::stage::{Stage, for_each};
use super::store::{Drawable, StoreBuilder};
use crate::error::Result;
use crate::splats::brick::BrickSplats;
use crate::volume::BRICK_EDGE as EDGE;

/// The work in words that complete errors: "while ...".
const FINDING: &str = "classifying the volume";

/// The largest number of splats that are joined: meanwhile they are in memory twice. Each store is a dispatch.
pub(super) const JOINED: u32 = 1 << 23;

/// The stages of classification, for one way of reading samples.
pub(crate) struct Classifier {
    count: Stage,
    emit: Stage,
    extents: Stage,
}

impl Classifier {
    /// Returns the stages for a volume, made now if there are none.
    pub(crate) fn of(pipelines: &Cache, input: &Input<'_>) -> Result<Arc<Self>> {
        pipelines.get_or_make((input.key(), input.keeps_invisible()), || Ok(Self::new(input)))
    }

    pub(crate) fn new(input: &Input<'_>) -> Self {
        use Binding::{Read, Write};
        let mut constants = input.key().constants().to_vec();
        constants.push(("KEEP_INVISIBLE", input.keeps_invisible().into()));
        let entries = ["count", "emit"].map(|entry| ("classify", entry));
        let [count, emit] = Stage::several(input.context, shaders::CLASSIFY, entries, &SLOTS, &constants);
        let entry = ("classify", "extents_of_bricks");
        let extents = Stage::new(input.context, shaders::EXTENTS, entry, &[Read, Read, Write], &[]);
        Self { count, emit, extents }
    }

    /// Classifies a volume and returns its visible voxels as splats, brick by brick, with normals if there is light.
    /// The samples of visible bricks are on the device a batch at a time.
    pub(crate) fn run(&self, scan: &Scan, input: &Input<'_>) -> Result<Drawable> {
        let context = input.context;
        let job = ClassifyJob { context, scan, stages: self, input, points: input.points_on_device()? };
        let mut stores = StoreBuilder::new(context, STRIDE, JOINED);
        let bricks = input.batches(&mut |batch| job.run(batch, &mut stores))?;
        Ok(Drawable { bricks, ..stores.finish()? })
    }

    /// Finds the visible voxels of bricks that are held, buffer of samples by buffer of samples.
    pub(super) fn visible(&self, scan: &Scan, input: &Input<'_>, held: &HeldBricks) -> Result<Vec<VisibleVoxels>> {
        let context = input.context;
        let job = ClassifyJob { context, scan, stages: self, input, points: input.points_on_device()? };
        let mut recorder = Recorder::untimed(context);
        let ranges = input.volume.ranges()?;
        let shows = |batch: &BrickBatch| {
            batch.origins.iter().any(|&origin| input.may_show(ranges[input.brick_number(origin) as usize]))
        };
        let part = |part: &HeldBuffer| job.mark(&mut recorder, part, &shows);
        let parts = held.buffers.iter().map(part).collect::<Result<Vec<_>>>()?;
        recorder.submit();
        context.wait(FINDING)?;
        let origins = held.buffers.iter().map(|part| part.batches.iter().flat_map(|batch| &batch.origins));
        let counted = |((mut visible, extents), origins): ((VisibleVoxels, Readback), _)| {
            let extents: Vec<Extent> = extents.done_values(context, FINDING)?;
            let brick = |(&[ox, oy, oz, _], extent): (&[u32; 4], &Extent)| {
                let Extent { places: [x, y, z, first], pages } = *extent;
                BrickSplats::of_places([ox, oy, oz], first, [x, y, z], pages)
            };
            visible.bricks = Iterator::zip(origins, &extents).map(brick).collect();
            visible.count = extents.last().map_or(0, |extent| extent.places[3]);
            Ok(visible)
        };
        parts.into_iter().zip(origins).map(counted).collect()
    }

    /// Returns the stage that emits splats.
    pub(super) fn emit(&self) -> &Stage {
        &self.emit
    }
}

/// The bindings of shaders/classify.wgsl.
const SLOTS: [Binding; 8] = {
    use Binding::{Read, Uniform, Write};
    [Uniform, Read, Read, Write, Write, Read, Write, Read]
};

/// Returns the stage that emits splats with the light that arrives.
pub(super) fn emit_in_shadows(context: &Context, key: InputKey) -> Stage {
    let mut constants = key.constants().to_vec();
    constants.push(("SHADOWS", 1));
    Stage::new(context, shaders::CLASSIFY, ("classify", "emit"), &SLOTS, &constants)
}

/// Records the dispatch that counts the splats of a batch of bricks, or that emits them into a store, with the light of
/// `kept` or without.
pub(super) fn record(
    context: &Context,
    pass: &mut ComputePass<'_>,
    stage: &Stage,
    (batch, points, kept): (&BrickBatch, &wgpu::Buffer, Option<&wgpu::Buffer>),
    parameters: Classify,
    [places, seen, splats]: [wgpu::BindingResource<'_>; 3],
) -> Result<()> {
    let parameters = Classify { bricks: batch.origins.len() as u32, ..parameters };
    let uniform = wgpu::BufferUsages::UNIFORM;
    let parameters = context.upload("classify.parameters", bytemuck::bytes_of(&parameters), uniform)?;
    let kept = kept.unwrap_or(points);
    let [parameters, points, origins, kept] =
        [&parameters, points, &batch.places, kept].map(wgpu::Buffer::as_entire_binding);
    let resources = [parameters, batch.binding(), points, places, splats, origins, seen, kept];
    let group = stage.bind(context, &resources);
    stage.record(pass, &group, &[], for_each(context, (batch.origins.len() * ROWS) as u64));
    Ok(())
}

/// The visible voxels of the bricks of a buffer of samples.
pub(super) struct VisibleVoxels {
    pub(super) count: u32,
    /// The bricks; each numbers its first visible voxel among the visible voxels of the buffer.
    pub(super) bricks: Vec<BrickSplats>,
    /// The number of the first visible voxel of each row of each brick, then their total, and the index of the buffer:
    /// see shaders/common/sampled.wgsl.
    pub(super) places: wgpu::Buffer,
    /// The bits of the visible voxels in each row of each brick.
    pub(super) seen: wgpu::Buffer,
}

/// The number of bytes of a splat.
pub(crate) const STRIDE: u64 = size_of::<Splat>() as u64;

/// The state that all batches of a volume share.
struct ClassifyJob<'a> {
    context: &'a Context,
    scan: &'a Scan,
    stages: &'a Classifier,
    input: &'a Input<'a>,
    points: wgpu::Buffer,
}

impl ClassifyJob<'_> {
    /// Adds the visible voxels of a batch, then waits, so that the batch leaves the device.
    fn run(&self, batch: &BrickBatch, stores: &mut StoreBuilder<'_, DevicePart>) -> Result<()> {
        let record = |pass: &mut ComputePass<'_>, first, rows: &Rows| self.record(batch, pass, first, rows);
        let recorder = Recorder::untimed(self.context);
        collect(recorder, self.scan, (stores, STRIDE), (&batch.origins, &batch.places), &record)?;
        self.context.wait("classifying the volume")
    }

    /// Records the search for visible voxels in the batches of a buffer that `shows` accepts. The extents of their
    /// bricks can be read after a wait.
    fn mark(
        &self,
        recorder: &mut Recorder<'_>,
        of: &HeldBuffer,
        shows: &dyn Fn(&BrickBatch) -> bool,
    ) -> Result<(VisibleVoxels, Readback)> {
        /// The number of bytes of a row of a brick, and of the extents of a brick.
        const EACH: u64 = 4;
        const EXTENTS: u64 = size_of::<Extent>() as u64;
        let context = self.context;
        let bricks = of.count();
        let rows = (bricks * ROWS) as u64;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let places = context.buffer("classify.places", (rows + 1) * EACH + of.index.size(), usage)?;
        recorder.copy(&of.index, &places, (rows + 1) * EACH, of.index.size());
        let seen = context.buffer("classify.seen", rows * EACH, usage)?;
        let no_splats = context.buffer("classify.no_splats", 16, usage)?;
        // New buffers hold zeros: the rows of batches that do not show.
        for batch in of.batches.iter().filter(|batch| shows(batch)) {
            let [places, seen] =
                [&places, &seen].map(|buffer| BrickBatch::rows(buffer, batch.before, batch.origins.len()));
            let buffers = [places, seen, no_splats.as_entire_binding()];
            let mut pass = recorder.compute_pass("classify");
            let from = (batch, &self.points, None);
            record(context, &mut pass, &self.stages.count, from, self.input.parameters(), buffers)?;
            drop(pass);
            recorder.worked((batch.origins.len() * ROWS * EDGE) as u64);
        }
        self.scan.record(context, &mut recorder.compute_pass("classify"), &places, rows + 1)?;
        let bytes = (bricks as u64 + 1) * EXTENTS;
        let extents = context.buffer("classify.extents", bytes, usage)?;
        let buffers = [&places, &seen, &extents].map(wgpu::Buffer::as_entire_binding);
        let (x, y) = context.workgroups(bricks as u64, 1);
        self.stages.extents.run(recorder, &buffers, [x, y, 1]);
        let extents = recorder.read_back("classify.extents_staging", &extents, bytes)?;
        Ok((VisibleVoxels { count: 0, bricks: Vec::new(), places, seen }, extents))
    }

    /// Records the dispatch that counts the splats of a batch, or that emits them.
    fn record(
        &self,
        batch: &BrickBatch,
        pass: &mut ComputePass<'_>,
        first: Option<u32>,
        Rows { places, seen, splats }: &Rows,
    ) -> Result<()> {
        let buffers = [places, seen, splats].map(wgpu::Buffer::as_entire_binding);
        let parameters = Classify { first_brick: first.unwrap_or_default(), ..self.input.parameters() };
        let stage = if first.is_some() { &self.stages.emit } else { &self.stages.count };
        record(self.context, pass, stage, (batch, &self.points, None), parameters, buffers)
    }
}
