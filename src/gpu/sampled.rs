//! Splats that are no list: the device holds the samples and which of them are visible, for painters that read these.

use std::any::Any;
use std::ops::Range;
use std::sync::Arc;

use super::cache::Cache;
use super::classify::{Classifier, JOINED, STRIDE, VisibleVoxels, emit_in_shadows, record};
use super::context::Context;
use super::held_samples::{HeldBricks, HeldSamples};
use super::kept_voxels::{FOUND, KeptVoxels};
use super::layout::{Classify, MAX_BRICKS, SHADED_WORDS};
use super::recorder::{Recorder, max_work};
use super::samples::{BATCH, BrickBatch, Bricks, Input, InputKey, ROWS};
use super::stage::Constant;
use super::store::{Drawable, Splats, Store, Unlisted};
use crate::error::Result;
use crate::splats::brick::BrickSplats;
use crate::volume::BRICK_EDGE as EDGE;

/// The samples of a volume, classified by a transfer function. A clone shares the memory of the device.
#[derive(Clone)]
pub(crate) struct Sampled {
    classifier: Arc<Classifier>,
    key: InputKey,
    points: wgpu::Buffer,
    parameters: Classify,
    held: Arc<HeldBricks>,
    /// The visible voxels of each buffer of samples.
    visible: Arc<Vec<VisibleVoxels>>,
    /// The packed normals of visible voxels, by buffer of samples; `None`: there is no light or no room for them.
    normals: Option<Vec<wgpu::Buffer>>,
    /// The shares of light that arrive at visible voxels, 8 bytes each, by buffer of samples; `None`: all light
    /// arrives.
    kept: Option<Vec<wgpu::Buffer>>,
}

/// The form in which shaders read samples, normals and the light that arrives; a key of pipelines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct SampledKey {
    input: InputKey,
    kept_normals: bool,
    shadows: bool,
}

impl SampledKey {
    pub(crate) fn constants(self) -> impl Iterator<Item = Constant> {
        let own = [("KEPT_NORMALS", self.kept_normals.into()), ("SHADOWS", self.shadows.into())];
        self.input.constants().into_iter().chain(own)
    }
}

/// A buffer of samples, with the visible voxels of its bricks.
pub(crate) struct SampledBuffer<'a> {
    /// The numbers in the volume of the buffer's bricks, some of which may not be held.
    pub(super) bricks: Range<u32>,
    pub(super) samples: &'a wgpu::Buffer,
    pub(super) visible: &'a VisibleVoxels,
    pub(super) normals: Option<&'a wgpu::Buffer>,
    pub(super) kept: Option<&'a wgpu::Buffer>,
}

/// The largest number of batches of a dispatch: shaders count invocations in 32 bits.
const MOST_TOGETHER: u64 = 1 << 9;

/// The samples that a dispatch reads, as bindings.
pub(crate) struct Dispatch<'a> {
    /// Parameters of the dispatch: its bricks, counted from brick `first_brick` of the buffer of samples on.
    pub(crate) parameters: Classify,
    pub(crate) voxels: u64,
    pub(crate) work: u64,
    pub(crate) samples: wgpu::BindingResource<'a>,
    pub(crate) places: wgpu::BindingResource<'a>,
    pub(crate) seen: wgpu::BindingResource<'a>,
    pub(crate) normals: wgpu::BindingResource<'a>,
    pub(crate) kept: wgpu::BindingResource<'a>,
    /// The number of the buffer of samples.
    pub(super) buffer: usize,
}

/// A store of consecutive batches of a buffer of samples.
struct SampledBatches {
    of: Arc<Sampled>,
    /// The number of the buffer of samples.
    buffer: usize,
    /// The numbers of the batches in the buffer.
    batches: Range<usize>,
    /// The number of the first splat among the visible voxels of the buffer; `count` is the number of splats.
    first: u32,
    count: u32,
}

impl Sampled {
    /// Finds the visible voxels of a volume, whose samples the device holds from now on. Also returns the bytes that
    /// were sent.
    pub(crate) fn hold(
        pipelines: &Cache,
        input: &Input<'_>,
        held: &HeldSamples,
        kept: &KeptVoxels,
    ) -> Result<(Arc<Self>, u64)> {
        let classifier = Classifier::of(pipelines, input)?;
        let points = input.points_on_device()?;
        held.with(input, input.needed_bricks()?, |held| {
            kept.with(pipelines, input, held, input.key().is_lit(), |visible, normals| {
                Ok(Arc::new(Self {
                    classifier,
                    key: input.key(),
                    points,
                    parameters: input.parameters(),
                    held: Arc::clone(held),
                    visible: Arc::clone(visible),
                    normals: normals.map(<[_]>::to_vec),
                    kept: None,
                }))
            })
        })
    }

    /// Finds the visible voxels of a volume, as [`Self::hold`] does, as splats that no store lists.
    pub(crate) fn run(pipelines: &Cache, input: &Input<'_>, held: &HeldSamples, kept: &KeptVoxels) -> Result<Drawable> {
        let (sampled, bytes) = Self::hold(pipelines, input, held, kept)?;
        let bricks = Bricks { all: input.brick_count() as u32, uploaded: input.shown()?, bytes };
        Ok(Drawable { stores: Self::stores(&sampled, input.context)?, bricks, ..Drawable::default() })
    }

    /// Returns the voxels with the shares `kept` of the light that arrives.
    pub(super) fn under(&self, kept: Vec<wgpu::Buffer>) -> Self {
        Self { kept: Some(kept), ..self.clone() }
    }

    /// Returns the shares of the light that arrives, by buffer of samples.
    pub(super) fn kept(&self) -> Option<&[wgpu::Buffer]> {
        self.kept.as_deref()
    }

    /// Returns the number of visible voxels of each buffer of samples.
    pub(super) fn counts(&self) -> impl Iterator<Item = u32> {
        self.visible.iter().map(|visible| visible.count)
    }

    /// Returns the number of bytes of a listed splat.
    fn stride(&self) -> u64 {
        if self.kept.is_some() { 4 * SHADED_WORDS as u64 } else { STRIDE }
    }

    /// Returns the stores of the sampled splats.
    pub(crate) fn stores(this: &Arc<Self>, context: &Context) -> Result<Vec<Store>> {
        Self::parts(this, context).into_iter().map(|part| part.store(context)).collect()
    }

    /// Returns whether samples may take less memory of the device than lists of all voxels that may be visible.
    pub(crate) fn may_save(input: &Input<'_>) -> Result<bool> {
        let bricks = input.needed_bricks()?;
        let most_listed = u64::from(input.shown()?) * (ROWS * EDGE) as u64 * STRIDE;
        Ok(HeldSamples::fits(input, &bricks) && input.bytes_of(&bricks) <= most_listed)
    }

    /// Returns the sampled splats of stores; `None` if a store lists its splats or they are of several volumes.
    pub(crate) fn of(stores: &[Store]) -> Option<Arc<Self>> {
        let of = |store: &Store| -> Option<Arc<Self>> {
            let source: Arc<dyn Any + Send + Sync> = store.unlisted()?;
            Some(Arc::clone(&source.downcast_ref::<SampledBatches>()?.of))
        };
        let first = of(stores.first()?)?;
        stores.iter().all(|store| of(store).is_some_and(|other| Arc::ptr_eq(&first, &other))).then_some(first)
    }

    /// Returns whether lists of the splats take less memory than half of the samples of all bricks.
    pub(crate) fn is_sparse(&self) -> bool {
        let splats: u64 = self.visible.iter().map(|visible| u64::from(visible.count)).sum();
        2 * splats * STRIDE < self.held.all_bytes()
    }

    /// Returns the form in which stages without normals and light read the samples.
    pub(super) fn input_key(&self) -> InputKey {
        self.key
    }

    pub(crate) fn key(&self) -> SampledKey {
        SampledKey { input: self.key, kept_normals: self.normals.is_some(), shadows: self.kept.is_some() }
    }

    /// Returns the control points of the transfer function.
    pub(crate) fn points(&self) -> &wgpu::Buffer {
        &self.points
    }

    /// Returns the parameters of shaders, without bricks.
    pub(super) fn parameters(&self) -> Classify {
        self.parameters
    }

    /// Returns whether each buffer of samples has whole rows of bricks along x, as cells need them.
    pub(crate) fn has_whole_rows(&self) -> bool {
        let row = self.parameters.dims[0].div_ceil(EDGE as u32);
        self.buffers().all(|of_buffer| of_buffer.bricks.start.is_multiple_of(row))
    }

    /// Returns the buffers of samples.
    pub(super) fn buffers(&self) -> impl Iterator<Item = SampledBuffer<'_>> {
        let buffers = self.held.buffers.iter().zip(&*self.visible).enumerate();
        buffers.map(|(number, (buffer, visible))| {
            let [normals, kept] = [&self.normals, &self.kept].map(|buffers| buffers.as_ref()?.get(number));
            SampledBuffer { bricks: buffer.bricks.clone(), samples: &buffer.samples, visible, normals, kept }
        })
    }

    /// Returns the dispatches that read all samples, with an invocation for each. None outlasts the watchdog of a small
    /// GPU.
    pub(crate) fn dispatches(&self, context: &Context) -> Vec<Dispatch<'_>> {
        let each = if self.key.is_lit() && self.normals.is_none() { FOUND } else { 1 };
        let batch_work = (BATCH * EDGE * EDGE * EDGE) as u64 * each;
        let together = (max_work(context) / batch_work).clamp(1, MOST_TOGETHER) as usize * BATCH;
        let mut dispatches = Vec::new();
        for (number, of) in self.buffers().enumerate() {
            let all = of.visible.bricks.len();
            for first in (0..all).step_by(together) {
                let bricks = together.min(all - first);
                let voxels = (bricks * ROWS * EDGE) as u64;
                let VisibleVoxels { places, seen, .. } = of.visible;
                dispatches.push(Dispatch {
                    parameters: Classify { bricks: bricks as u32, first_brick: first as u32, ..self.parameters },
                    voxels,
                    work: voxels * each,
                    samples: of.samples.as_entire_binding(),
                    places: places.as_entire_binding(),
                    seen: seen.as_entire_binding(),
                    normals: of.normals.unwrap_or(places).as_entire_binding(),
                    kept: of.kept.unwrap_or(places).as_entire_binding(),
                    buffer: number,
                });
            }
        }
        dispatches
    }

    /// Splits the splats into stores, each of which could be listed in one buffer.
    fn parts(this: &Arc<Self>, context: &Context) -> Vec<SampledBatches> {
        let bindable = context.largest_buffer() / this.stride();
        let most = u32::try_from(bindable).unwrap_or(u32::MAX).min(JOINED);
        let mut parts: Vec<SampledBatches> = Vec::new();
        for (buffer, (of, visible)) in this.held.buffers.iter().zip(&*this.visible).enumerate() {
            for (number, batch) in of.batches.iter().enumerate() {
                let place = |brick: usize| visible.bricks.get(brick).map_or(visible.count, |brick| brick.first);
                let first = place(batch.before);
                let count = place(batch.before + batch.origins.len()) - first;
                // Of this buffer, and batches that follow one another but for empty ones.
                let has_room = |part: &&mut SampledBatches| {
                    let bricks = (number + 1 - part.batches.start) * BATCH;
                    part.buffer == buffer && part.count + count <= most && bricks <= MAX_BRICKS
                };
                match parts.last_mut().filter(has_room) {
                    _ if count == 0 => {}
                    Some(part) => {
                        part.batches.end = number + 1;
                        part.count += count;
                    }
                    None => {
                        let batches = number..number + 1;
                        parts.push(SampledBatches { of: Arc::clone(this), buffer, batches, first, count });
                    }
                }
            }
        }
        parts
    }
}

impl SampledBatches {
    fn batches(&self) -> impl Iterator<Item = &BrickBatch> {
        self.of.held.buffers[self.buffer].batches[self.batches.clone()].iter()
    }

    fn store(self, context: &Context) -> Result<Store> {
        let visible = &self.of.visible[self.buffer];
        let of_batch = |batch: &BrickBatch| &visible.bricks[batch.before..][..batch.origins.len()];
        let brick = |brick: &BrickSplats| BrickSplats { first: brick.first - self.first, ..*brick };
        let bricks = self.batches().flat_map(of_batch).map(brick).collect();
        let bytes = self.batches().map(|batch| batch.places.size()).sum();
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let origins = context.buffer("splats.origins", bytes, usage)?;
        let (mut recorder, mut at) = (Recorder::untimed(context), 0);
        for batch in self.batches() {
            recorder.copy(&batch.places, &origins, at, batch.places.size());
            at += batch.places.size();
        }
        recorder.submit();
        let (stride, count) = (self.of.stride(), self.count);
        Store::new(context, (Splats::Unlisted(Arc::new(self)), Some(origins)), stride, count, bricks)
    }
}

impl Unlisted for SampledBatches {
    fn list(&self, context: &Context) -> Result<wgpu::Buffer> {
        let Sampled { classifier, key, points, parameters, visible, kept, .. } = &*self.of;
        let VisibleVoxels { places, seen, .. } = &visible[self.buffer];
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let splats = context.buffer("classify.splats", u64::from(self.count) * self.of.stride(), usage)?;
        let kept = kept.as_ref().and_then(|kept| kept.get(self.buffer));
        let in_shadows = kept.map(|_| emit_in_shadows(context, *key));
        let stage = in_shadows.as_ref().unwrap_or(classifier.emit());
        let (mut recorder, mut first_brick) = (Recorder::untimed(context), 0);
        for batch in self.batches() {
            let bricks = batch.origins.len();
            let [places, seen] = [places, seen].map(|buffer| BrickBatch::rows(buffer, batch.before, bricks));
            let parameters = Classify { first_brick, first_splat: self.first, ..*parameters };
            let buffers = [places, seen, splats.as_entire_binding()];
            let mut pass = recorder.compute_pass("classify");
            record(context, &mut pass, stage, (batch, points, kept), parameters, buffers)?;
            drop(pass);
            recorder.worked((bricks * ROWS * EDGE) as u64 * FOUND);
            first_brick += bricks as u32;
        }
        recorder.submit();
        Ok(splats)
    }

    fn bytes(&self) -> u64 {
        let rows: usize = self.batches().map(|batch| batch.origins.len() * ROWS).sum();
        let samples: u64 = self.batches().map(|batch| batch.bytes.end - batch.bytes.start).sum();
        let normals = if self.of.normals.is_some() { 4 } else { 0 };
        let kept = if self.of.kept.is_some() { 8 } else { 0 };
        samples + 8 * rows as u64 + (normals + kept) * u64::from(self.count)
    }
}
