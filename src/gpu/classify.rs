//! classify: the samples of a volume to the visible voxels.

use std::sync::Arc;

use super::cache::Cache;
use super::context::Context;
use super::held_samples::{HeldBricks, HeldBuffer};
use super::layout::{Classify, Extent};
use super::pipeline::Binding;
use super::recorder::{Readback, Recorder};
use super::samples::{BrickBatch, Input, ROWS};
use super::scan::Scan;
use super::shaders;
use super::stage::{Stage, for_each};
use crate::error::Result;
use crate::splats::brick::BrickSplats;
use crate::volume::BRICK_EDGE as EDGE;

/// The work in words that complete errors: "while ...".
const FINDING: &str = "classifying the volume";

/// The stages of classification, for one way of reading samples.
pub(crate) struct Classifier {
    count: Stage,
    extents: Stage,
}

impl Classifier {
    /// Returns the stages for a volume, made now if there are none.
    pub(crate) fn of(pipelines: &Cache, input: &Input<'_>) -> Result<Arc<Self>> {
        pipelines.get_or_make((input.key(), input.keeps_invisible()), || Ok(Self::new(input)))
    }

    pub(crate) fn new(input: &Input<'_>) -> Self {
        use Binding::{Read, Uniform, Write};
        let mut constants = input.key().constants().to_vec();
        constants.push(("KEEP_INVISIBLE", input.keeps_invisible().into()));
        let slots = [Uniform, Read, Read, Write, Write, Read];
        let count = Stage::new(input.context, shaders::CLASSIFY, ("classify", "count"), &slots, &constants);
        let entry = ("classify", "extents_of_bricks");
        let extents = Stage::new(input.context, shaders::EXTENTS, entry, &[Read, Read, Write], &[]);
        Self { count, extents }
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
}

/// The visible voxels of the bricks of a buffer.
pub(super) struct VisibleVoxels {
    pub(super) count: u32,
    /// The bricks; each numbers its first visible voxel among the visible voxels of the buffer.
    pub(super) bricks: Vec<BrickSplats>,
    /// The number of the first visible voxel of each row of each brick, then their total, and the numbers of the
    /// bricks: see shaders/common/sampled.wgsl.
    pub(super) places: wgpu::Buffer,
    /// The bits of the visible voxels in each row of each brick.
    pub(super) seen: wgpu::Buffer,
}

/// The state that all batches of a volume share.
struct ClassifyJob<'a> {
    context: &'a Context,
    scan: &'a Scan,
    stages: &'a Classifier,
    input: &'a Input<'a>,
    points: wgpu::Buffer,
}

impl ClassifyJob<'_> {
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
        // New buffers hold zeros: the rows of batches that do not show.
        for batch in of.batches.iter().filter(|batch| shows(batch)) {
            let [places, seen] =
                [&places, &seen].map(|buffer| BrickBatch::rows(buffer, batch.before, batch.origins.len()));
            let parameters = Classify { bricks: batch.origins.len() as u32, ..self.input.parameters() };
            let uniform = wgpu::BufferUsages::UNIFORM;
            let parameters = context.upload("classify.parameters", bytemuck::bytes_of(&parameters), uniform)?;
            let [parameters, points, origins] =
                [&parameters, &self.points, &batch.places].map(wgpu::Buffer::as_entire_binding);
            let resources = [parameters, batch.binding(), points, places, seen, origins];
            self.stages.count.run(recorder, &resources, for_each(context, (batch.origins.len() * ROWS) as u64));
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
}
