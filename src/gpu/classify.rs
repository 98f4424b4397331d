//! classify: a volume and a transfer function to a list of splats, on the device or by its twin on the host.

use std::cell::LazyCell;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Zeroable;
use rayon::prelude::*;

use super::cache::Cache;
use super::context::Context;
use super::layout::{Classify, ControlPoint, Splat};
use super::pipeline::{Binding, buffer_range};
use super::recorder::{ComputePass, Readback, Recorder};
use super::rows::{DevicePart, ROWS, Rows, collect};
use super::scan::Scan;
use super::sender::Sender;
use super::shaders;
use super::splat::{density, packed_appearance, packed_normal, resolution_at, with_density};
use super::stage::{Constant, Stage, for_each};
use super::store::{BrickSplats, Bricks, Drawable, MadeBrick, StoreBuilder};
use super::transfer::Reduction;
use crate::error::{Error, Result};
use crate::kernel::{DerivativeFilter, NORMAL_REACH};
use crate::progress::Progress;
use crate::transfer::{self, Resolution, TransferFunction, scaled_share};
use crate::volume::{BRICK_EDGE as EDGE, Brick, RowCoding, SampleType, ToF64, Volume};

/// Bricks of one batch, 4 million voxels: the memory that preparing a scene needs besides its splats, and far within
/// every limit.
pub(super) const BATCH: usize = 128;
/// Completes errors: "while ...".
const SENDING: &str = "sending samples";
const FINDING: &str = "classifying the volume";

/// The largest number of splats that are joined: meanwhile they are in memory twice. On a GPU each store is a dispatch.
const JOINED: u32 = 1 << 23;
const SOFTWARE_JOINED: u32 = 1 << 19;

pub(super) fn joined(context: &Context) -> u32 {
    if context.is_software() { SOFTWARE_JOINED } else { JOINED }
}

/// The limit of control points and samples that shaders see: differences stay in the range of f32.
const FAR: f64 = 1e36;
/// The least extent of the control points in unreduced floats: their products stay in the range of f32.
const LEAST_EXTENT: f64 = 1e-24;

/// How the shader reads samples: SAMPLE_TYPE in shaders/common/classified.wgsl.
///
/// Types whose every value is exact in f32 are uploaded unchanged. Others, and floats whose control points are near the
/// ends of the range of f32, are reduced on the host, chunk by chunk, to the scalars of post-shading: a window of 10 at
/// 4e9 keeps its resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SampleCoding {
    sample_type: u32,
    origin: f64,
    reduction: Option<Reduction>,
    slope: f64,
    intercept: f64,
}

impl SampleCoding {
    fn new(volume: &Volume, transfer: &TransferFunction) -> Self {
        let (slope, intercept) = volume.rescale();
        let sample = |value: f64| (value - intercept) / slope;
        let sample_type = match volume.sample_type() {
            // A falling map would reverse the control points, and the side on which a step belongs.
            _ if slope < 0.0 => None,
            SampleType::U8 => Some(0),
            SampleType::I8 => Some(1),
            SampleType::U16 => Some(2),
            SampleType::I16 => Some(3),
            SampleType::F32 => {
                let mut points = transfer.points().iter().map(|p| sample(p.value).abs()).filter(|&p| p > 0.0);
                let [first, last] = transfer.range().map(sample);
                let extent = if last > first { last - first } else { first.abs() };
                let ordinary = |p: f64| p < FAR && (extent == 0.0 || extent > LEAST_EXTENT);
                points.all(ordinary).then_some(4)
            }
            _ => None,
        };
        let (origin, reduction) = match sample_type {
            Some(4) => (0.0, None),
            // An integer within the samples' range, so that the shader's subtraction is exact.
            Some(_) => (sample(transfer.points()[0].value).round().clamp(-32_768.0, 65_535.0), None),
            // A function without extent is constant, whatever its input.
            None => (0.0, Some(Reduction::new(transfer, 1.0))),
        };
        Self { sample_type: sample_type.unwrap_or(4), origin, reduction, slope, intercept }
    }

    /// The control points in the units in which the shader compares samples.
    fn points(&self, transfer: &TransferFunction) -> Vec<ControlPoint> {
        let point = |p: &transfer::ControlPoint| ControlPoint {
            color: p.color.map(|c| c as f32),
            sample: self.point(p.value),
            opacity: p.opacity as f32,
            _pad: [0.0; 3],
        };
        transfer.points().iter().map(point).collect()
    }

    /// The base of the transfer function as a sample, and the resolution of samples there; 0 if nothing depends on
    /// gradients, because the resolution needs the ranges of all samples.
    fn resolution(&self, transfer: &TransferFunction, volume: &Volume, lit: bool) -> Result<[f32; 2]> {
        if !lit && transfer.gradient_opacity().is_empty() {
            return Ok([0.0; 2]);
        }
        let resolution = Resolution::new(transfer, volume)?;
        Ok(match &self.reduction {
            Some(reduction) => [0.0, reduction.faintest(&resolution)],
            None => {
                let faintest = resolution.faintest() * self.gradient_scale();
                let sample = (transfer.base() - self.intercept) / self.slope;
                [sample.clamp(-FAR, FAR) as f32, faintest.clamp(f64::from(f32::MIN_POSITIVE), FAR) as f32]
            }
        })
    }

    /// Samples for each unit of value.
    fn gradient_scale(&self) -> f64 {
        self.reduction.map_or(1.0 / self.slope.abs(), |reduction| reduction.factor())
    }

    /// A value of the transfer function in the units in which the shader compares samples.
    fn point(&self, value: f64) -> f32 {
        match &self.reduction {
            Some(reduction) => reduction.scalar(value),
            // A sample reaches the value if it reaches the next f32: no sample is between.
            None if self.slope == 1.0 && self.intercept == 0.0 => next_f32((value - self.origin).clamp(-FAR, FAR)),
            None => ((value - self.intercept) / self.slope - self.origin).clamp(-FAR, FAR) as f32,
        }
    }
}

/// The least f32 that is at least a number.
fn next_f32(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) < value { nearest.next_up() } else { nearest }
}

impl RowCoding for SampleCoding {
    fn append<T: ToF64 + bytemuck::Pod>(&self, samples: &[T], bytes: &mut Vec<u8>) {
        if let Some(reduction) = &self.reduction {
            let value = |s: &T| reduction.scalar(self.slope * s.to_f64() + self.intercept);
            bytes.extend(samples.iter().flat_map(|s| value(s).to_ne_bytes()));
        } else {
            bytes.extend_from_slice(bytemuck::cast_slice(samples));
        }
    }
}

/// A volume to classify, as the stage and its twin on the host read it.
pub(crate) struct Input<'a> {
    pub(super) context: &'a Context,
    pub(super) volume: &'a Volume,
    transfer: &'a TransferFunction,
    /// Whether splats have normals.
    lit: bool,
    pub(super) progress: &'a Progress,
    coding: SampleCoding,
    /// The control points as samples are compared with them.
    points: Vec<ControlPoint>,
    /// Gradient opacity, of gradients of samples; empty: extinction does not depend on them.
    thinning: Vec<[f32; 2]>,
    /// The base of the transfer function as a sample, and the resolution there.
    resolution: [f32; 2],
    gradients: [[f32; 3]; 3],
}

impl<'a> Input<'a> {
    /// A volume whose splats get normals if they are lit.
    pub(crate) fn new(
        context: &'a Context,
        volume: &'a Volume,
        transfer: &'a TransferFunction,
        lit: bool,
        progress: &'a Progress,
    ) -> Result<Self> {
        let coding = SampleCoding::new(volume, transfer);
        let points = coding.points(transfer);
        // On a lattice of the volume's unit of length.
        let thinning = transfer.scaled_gradient_opacity(coding.gradient_scale() * volume.grid().unit());
        let resolution = coding.resolution(transfer, volume, lit)?;
        let gradients = gradients(volume);
        Ok(Self { context, volume, transfer, lit, progress, coding, points, thinning, resolution, gradients })
    }

    /// The layers of neighbouring voxels around a brick, for normals and for gradient opacity: `halo` in
    /// shaders/common/classified.wgsl.
    fn halo(&self) -> usize {
        if self.lit { NORMAL_REACH } else { usize::from(!self.thinning.is_empty()) }
    }

    /// Bytes of the samples of a brick with its halo.
    fn brick_bytes(&self) -> u64 {
        let edge = (EDGE + 2 * self.halo()) as u64;
        edge.pow(3) * [1, 1, 2, 2, 4][self.coding.sample_type as usize]
    }

    /// Whether voxels that do not show become splats too.
    fn keeps_invisible(&self) -> bool {
        !self.context.savings.voxels
    }

    /// Whether a brick with samples in this range may show.
    pub(super) fn may_show(&self, range: [f64; 2]) -> bool {
        let (slope, intercept) = self.volume.rescale();
        let [a, b] = range.map(|raw| slope * raw + intercept);
        !self.context.savings.bricks || self.keeps_invisible() || !self.transfer.is_invisible([a.min(b), a.max(b)])
    }

    /// Calls `take` with the result of `make`, which runs in parallel, for each brick that `shows` accepts, given the
    /// range of its samples, in order.
    fn each_brick<B: Send>(
        &self,
        shows: &(dyn Fn([f64; 2]) -> bool + Sync),
        make: &(dyn Fn(Brick) -> Result<B> + Sync),
        take: &mut dyn FnMut(B) -> Result<()>,
    ) -> Result<Bricks> {
        let Self { volume, progress, .. } = self;
        let mut bricks = Bricks::default();
        let total = volume.bricks().into_iter().product::<u32>();
        let made = |brick: Brick| Ok::<_, Error>((brick.1.len() as u64, make(brick)?));
        volume.for_each_brick(shows, self.halo(), &self.coding, &made, &mut |brick| {
            bricks.all += 1;
            if let Some((bytes, brick)) = brick {
                bricks.uploaded += 1;
                bricks.bytes += bytes;
                take(brick)?;
            }
            progress.report("classifying", f64::from(bricks.all) / f64::from(total));
            progress.check()
        })?;
        Ok(bricks)
    }
}

/// The stages of classification, for one way of reading samples.
pub(crate) struct Classifier {
    count: Stage,
    emit: Stage,
    extents: Stage,
}

impl Classifier {
    /// The stages for a volume, made now if there are none.
    pub(crate) fn of(pipelines: &Cache, input: &Input<'_>) -> Result<Arc<Self>> {
        pipelines.get_or_make((input.key(), input.keeps_invisible()), || Ok(Self::new(input)))
    }

    pub(crate) fn new(input: &Input<'_>) -> Self {
        use Binding::{Read, Uniform, Write};
        let slots = [Uniform, Read, Read, Write, Write, Read, Write];
        let [sample_type, lit, gradient_opacity] = input.key().constants();
        let constants = [sample_type, lit, gradient_opacity, ("KEEP_INVISIBLE", input.keeps_invisible().into())];
        let entries = ["count", "emit"].map(|entry| ("classify", entry));
        let [count, emit] = Stage::several(input.context, shaders::CLASSIFY, entries, &slots, &constants);
        let entry = ("classify", "extents_of_bricks");
        let extents = Stage::new(input.context, shaders::EXTENTS, entry, &[Read, Read, Write], &[]);
        Self { count, emit, extents }
    }

    /// The visible voxels of a volume as splats, brick by brick, with normals if there is light. The samples of visible
    /// bricks are on the device a batch at a time.
    pub(crate) fn run(&self, scan: &Scan, input: &Input<'_>) -> Result<Drawable> {
        let context = input.context;
        let job = Job { context, scan, stages: self, input, points: input.points_on_device()? };
        let mut stores = StoreBuilder::new(context, STRIDE, joined(context));
        let shows = |range| input.may_show(range);
        let bricks = input.batches(&shows, BATCH, &mut |batch| job.run(&batch, &mut stores))?;
        Ok(Drawable { bricks, ..stores.finish()? })
    }

    /// Finds the visible voxels of all bricks on the device, buffer of samples by buffer of samples.
    pub(super) fn visible(&self, scan: &Scan, input: &Input<'_>, batches: &[BrickBatch]) -> Result<Vec<VisibleVoxels>> {
        let context = input.context;
        let job = Job { context, scan, stages: self, input, points: input.points_on_device()? };
        let mut recorder = Recorder::untimed(context);
        let mut ranges = input.volume.ranges()?;
        let part = |part: &[BrickBatch]| job.mark(&mut recorder, part, &mut ranges);
        let parts = BrickBatch::by_buffer(batches).map(part).collect::<Result<Vec<_>>>()?;
        recorder.submit();
        context.wait(FINDING)?;
        let origins = BrickBatch::by_buffer(batches).map(|part| part.iter().flat_map(|batch| &batch.origins));
        let counted = |((mut visible, extents), origins): ((VisibleVoxels, Readback), _)| {
            let extents: Vec<[u32; 4]> = extents.done_values(context, FINDING)?;
            let brick = |(&[ox, oy, oz, _], &[x, y, z, first]): (&[u32; 4], &[u32; 4])| {
                BrickSplats::of_places([ox, oy, oz], first, [x, y, z])
            };
            visible.bricks = Iterator::zip(origins, &extents).map(brick).collect();
            visible.count = extents.last().map_or(0, |&[.., all]| all);
            Ok(visible)
        };
        parts.into_iter().zip(origins).map(counted).collect()
    }

    /// Records the dispatch that counts the splats of a batch of bricks, or that emits them into a store.
    pub(super) fn record(
        &self,
        context: &Context,
        pass: &mut ComputePass<'_>,
        (batch, points): (&BrickBatch, &wgpu::Buffer),
        (parameters, emits): (Classify, bool),
        [places, seen, splats]: [wgpu::BindingResource<'_>; 3],
    ) -> Result<()> {
        let parameters = Classify { bricks: batch.origins.len() as u32, ..parameters };
        let uniform = wgpu::BufferUsages::UNIFORM;
        let parameters = context.upload("classify.parameters", bytemuck::bytes_of(&parameters), uniform)?;
        let [parameters, points, origins] = [&parameters, points, &batch.places].map(wgpu::Buffer::as_entire_binding);
        let stage = if emits { &self.emit } else { &self.count };
        let group = stage.bind(context, &[parameters, batch.binding(), points, places, splats, origins, seen]);
        stage.record(pass, &group, &[], for_each(context, (batch.origins.len() * ROWS) as u64));
        Ok(())
    }
}

/// The visible voxels of the bricks of a buffer of samples.
pub(super) struct VisibleVoxels {
    pub(super) count: u32,
    /// The bricks, of whose visible voxels the first is numbered among those of the buffer.
    pub(super) bricks: Vec<BrickSplats>,
    /// For each row of a brick, the number of its first visible voxel.
    pub(super) places: wgpu::Buffer,
    /// For each row of a brick, the bits of its visible voxels.
    pub(super) seen: wgpu::Buffer,
}

/// How shaders read the samples of a volume: the constants of shaders/common/classified.wgsl.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct InputKey {
    sample_type: u32,
    lit: bool,
    gradient_opacity: bool,
}

impl InputKey {
    /// Whether splats have normals.
    pub(super) fn is_lit(self) -> bool {
        self.lit
    }

    pub(super) fn constants(self) -> [Constant; 3] {
        let Self { sample_type, lit, gradient_opacity } = self;
        [("SAMPLE_TYPE", sample_type), ("LIT", lit.into()), ("GRADIENT_OPACITY", gradient_opacity.into())]
    }
}

impl Input<'_> {
    pub(crate) fn context(&self) -> &Context {
        self.context
    }

    pub(super) fn key(&self) -> InputKey {
        let Self { lit, coding, thinning, .. } = self;
        InputKey { sample_type: coding.sample_type, lit: *lit, gradient_opacity: !thinning.is_empty() }
    }

    /// The control points of the transfer function, then those of gradient opacity.
    pub(super) fn points_on_device(&self) -> Result<wgpu::Buffer> {
        let steepness = |&[sample, opacity]: &[f32; 2]| ControlPoint { sample, opacity, ..ControlPoint::zeroed() };
        let all: Vec<ControlPoint> = self.points.iter().copied().chain(self.thinning.iter().map(steepness)).collect();
        self.context.upload("classify.control_points", bytemuck::cast_slice(&all), wgpu::BufferUsages::STORAGE)
    }

    /// The parameters of shaders, without bricks.
    pub(super) fn parameters(&self) -> Classify {
        let [gradient_x, gradient_y, gradient_z] = self.gradients;
        let [base, faintest] = self.resolution;
        Classify {
            dims: self.volume.grid().dims(),
            bricks: 0,
            gradient_x,
            points: self.points.len() as u32,
            gradient_y,
            sample_origin: self.coding.origin as f32,
            gradient_z,
            first_brick: 0,
            gradient_points: self.thinning.len() as u32,
            base,
            faintest,
            first_splat: 0,
        }
    }

    /// Whether the samples of all bricks may take less memory than lists of the splats of visible ones.
    pub(crate) fn is_dense(&self) -> Result<bool> {
        let ranges = self.volume.ranges()?;
        let splats = u64::from(self.shown(ranges)) * (EDGE * EDGE * EDGE) as u64;
        Ok(ranges.len() as u64 * self.brick_bytes() <= splats * STRIDE)
    }

    /// The number of bricks that may show of bricks with samples in these ranges.
    pub(super) fn shown(&self, ranges: &[[f64; 2]]) -> u32 {
        ranges.iter().filter(|&&range| self.may_show(range)).count() as u32
    }

    /// Calls `take` with the bricks that `shows` accepts, in batches on the device. Each `together` bricks share a
    /// buffer.
    fn batches(
        &self,
        shows: &(dyn Fn([f64; 2]) -> bool + Sync),
        together: usize,
        take: &mut dyn FnMut(BrickBatch) -> Result<()>,
    ) -> Result<Bricks> {
        let context = self.context;
        let all = self.volume.bricks().into_iter().map(|count| count as usize).product::<usize>();
        let count = all.min(BATCH).min(together);
        let parts = if count < all { 2 } else { 1 };
        let bytes_of = |bricks: usize| bricks as u64 * self.brick_bytes();
        let mut sender = Sender::new(context, SENDING, bytes_of(count).next_multiple_of(4), parts)?;
        let (mut origins, mut bytes, mut sent, mut samples) = (Vec::new(), Vec::new(), 0, None);
        let mut add = |brick: Option<Brick>| {
            let is_last = brick.is_none();
            if let Some(([x, y, z], samples)) = brick {
                origins.push([x, y, z, 0]);
                bytes.extend_from_slice(&samples);
            }
            let is_full = origins.len() == BATCH || (sent + origins.len()).is_multiple_of(together);
            if origins.is_empty() || !(is_last || is_full) {
                return Ok(());
            }
            let at = sent % together;
            let buffer = match samples.take().filter(|_| at > 0) {
                Some(buffer) => buffer,
                None => {
                    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
                    context.buffer("classify.samples", bytes_of(together.min(all - sent)), usage)?
                }
            };
            samples = Some(buffer.clone());
            sent += origins.len();
            let batch = BrickBatch::new(
                context,
                &mut sender,
                std::mem::take(&mut origins),
                (buffer, at, bytes_of(at)),
                &mut bytes,
            )?;
            bytes.clear();
            take(batch)
        };
        let bricks = self.each_brick(shows, &Ok, &mut |brick| add(Some(brick)))?;
        add(None)?;
        Ok(bricks)
    }

    /// The bricks whose samples share a buffer on a device that holds all of them: whole rows along x, if a buffer can
    /// hold a row.
    fn together(&self) -> usize {
        let most = self.context.largest_buffer() / self.brick_bytes();
        let most = usize::try_from(most).unwrap_or(usize::MAX);
        let row = self.volume.bricks()[0] as usize;
        if most < row { most.max(1) } else { most / row * row }
    }
}

/// The samples of a volume on the device, for any transfer function.
#[derive(Default)]
pub(crate) struct HeldSamples(Mutex<Option<(SamplesKey, Arc<Vec<BrickBatch>>)>>);

/// The format of samples on the device: their type, their reduction and the voxels around each brick.
type SamplesKey = (u32, Option<Reduction>, usize);

impl HeldSamples {
    /// The most bytes of samples that are held without a change of the transfer function.
    pub(super) const MOST: u64 = 2 << 30;

    /// Whether the samples of a volume are few enough to be held for their own sake, with whole rows of bricks in each
    /// buffer.
    pub(crate) fn fits(input: &Input<'_>) -> bool {
        let [row, ..] = input.volume.bricks();
        let bricks: u64 = input.volume.bricks().into_iter().map(u64::from).product();
        bricks * input.brick_bytes() <= Self::MOST && input.together().is_multiple_of(row as usize)
    }

    /// Whether the device holds samples.
    pub(crate) fn is_held(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// Drops the samples.
    pub(crate) fn clear(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// Calls `work` with the batches of all bricks. Sends the samples first if the device does not hold them; also
    /// returns the bytes that were sent.
    pub(super) fn with<T>(
        &self,
        input: &Input<'_>,
        work: impl FnOnce(&Arc<Vec<BrickBatch>>) -> Result<T>,
    ) -> Result<(T, u64)> {
        let key = (input.coding.sample_type, input.coding.reduction, input.halo());
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Not locked meanwhile: reading samples waits for a pool of threads, which may hand over work that takes the
        // lock. Samples in another format are dropped first, so that both are never in memory together.
        let held = lock().take().filter(|(of, _)| *of == key);
        let (batches, bytes) = match held {
            Some((_, held)) => (held, 0),
            None => {
                let mut batches = Vec::new();
                let mut keep = |batch| {
                    batches.push(batch);
                    Ok(())
                };
                let sent = input.batches(&|_| true, input.together(), &mut keep)?;
                (Arc::new(batches), sent.bytes)
            }
        };
        let result = work(&batches)?;
        *lock() = Some((key, batches));
        Ok((result, bytes))
    }
}

/// World gradients of the lattice coordinates.
pub(crate) fn gradients(volume: &Volume) -> [[f32; 3]; 3] {
    let gradients = volume.grid().local().to_lattice().matrix3.transpose();
    [0, 1, 2].map(|axis| gradients.col(axis).as_vec3().to_array())
}

/// Bytes of a splat.
pub(crate) const STRIDE: u64 = size_of::<Splat>() as u64;

/// Bricks that are classified together, on the device.
pub(super) struct BrickBatch {
    /// Lattice points of the first voxels.
    pub(super) origins: Vec<[u32; 4]>,
    /// The same on the device.
    pub(super) places: wgpu::Buffer,
    /// The samples with the voxels around each brick, and those of other batches.
    pub(super) samples: wgpu::Buffer,
    /// Bricks before these in that buffer.
    pub(super) before: usize,
    /// The bytes of the samples of these bricks.
    pub(super) bytes: Range<u64>,
}

impl BrickBatch {
    /// Sends `samples`, which become a whole number of words, to a place in a buffer.
    fn new(
        context: &Context,
        sender: &mut Sender<'_>,
        origins: Vec<[u32; 4]>,
        (buffer, before, at): (wgpu::Buffer, usize, u64),
        samples: &mut Vec<u8>,
    ) -> Result<Self> {
        /// Bytes that a thread writes at a time.
        const PART: usize = 1 << 20;
        use wgpu::BufferUsages as Usages;
        let places = bytemuck::cast_slice(&origins);
        let places = context.upload("classify.origins", places, Usages::STORAGE | Usages::COPY_SRC)?;
        samples.resize(samples.len().next_multiple_of(4), 0);
        let bytes = samples.len() as u64;
        let fill = |staging: &wgpu::Buffer| {
            samples
                .par_chunks(PART)
                .enumerate()
                .try_for_each(|(number, part)| context.write_mapped(SENDING, staging, (number * PART) as u64, part))
        };
        let mut recorder = Recorder::untimed(context);
        sender.send(&mut recorder, fill, |recorder, staging| recorder.copy(staging, &buffer, at, bytes))?;
        Ok(Self { origins, places, samples: buffer, before, bytes: at..at + bytes })
    }

    /// The batches of each buffer of samples.
    pub(super) fn by_buffer(batches: &[Self]) -> impl Iterator<Item = &[Self]> {
        batches.chunk_by(|a, b| a.samples == b.samples)
    }

    /// The samples of these bricks as a binding. Batches are whole multiples of the alignment of bindings: a brick has
    /// a multiple of 8 samples.
    fn binding(&self) -> wgpu::BindingResource<'_> {
        buffer_range(&self.samples, self.bytes.start, self.bytes.end - self.bytes.start)
    }

    /// The values of the rows of some bricks of a buffer of samples, a word each, as a binding.
    pub(super) fn rows(buffer: &wgpu::Buffer, before: usize, bricks: usize) -> wgpu::BindingResource<'_> {
        let bytes = |bricks: usize| (bricks * ROWS * size_of::<u32>()) as u64;
        buffer_range(buffer, bytes(before), bytes(bricks))
    }
}

/// The state that all batches of a volume share.
struct Job<'a> {
    context: &'a Context,
    scan: &'a Scan,
    stages: &'a Classifier,
    input: &'a Input<'a>,
    points: wgpu::Buffer,
}

impl Job<'_> {
    /// Adds the visible voxels of a batch that is on the device no longer than that takes.
    fn run(&self, batch: &BrickBatch, stores: &mut StoreBuilder<'_, DevicePart>) -> Result<()> {
        let record = |pass: &mut ComputePass<'_>, first, rows: &Rows| self.record(batch, pass, first, rows);
        let recorder = Recorder::untimed(self.context);
        collect(recorder, self.scan, (stores, STRIDE), (&batch.origins, &batch.places), &record)?;
        self.context.wait("classifying the volume")
    }

    /// Records the visible voxels of the batches of a buffer, of those that may show by the ranges of their bricks, of
    /// which the first ones are taken. The extents of their bricks can be read after a wait.
    fn mark(
        &self,
        recorder: &mut Recorder<'_>,
        batches: &[BrickBatch],
        ranges: &mut &[[f64; 2]],
    ) -> Result<(VisibleVoxels, Readback)> {
        /// Bytes of a row of a brick, and of the extents of a brick.
        const EACH: u64 = 4;
        const EXTENTS: u64 = 16;
        let context = self.context;
        let bricks = batches.iter().map(|batch| batch.origins.len()).sum::<usize>();
        let rows = (bricks * ROWS) as u64;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let places = context.buffer("classify.places", (rows + 1) * EACH, usage)?;
        let seen = context.buffer("classify.seen", rows * EACH, usage)?;
        let no_splats = context.buffer("classify.no_splats", 16, usage)?;
        // New buffers hold zeros: the rows of batches that do not show.
        for batch in batches {
            let of_batch = ranges.split_off(..batch.origins.len()).unwrap_or_default();
            if self.input.shown(of_batch) == 0 {
                continue;
            }
            let [places, seen] =
                [&places, &seen].map(|buffer| BrickBatch::rows(buffer, batch.before, batch.origins.len()));
            let buffers = [places, seen, no_splats.as_entire_binding()];
            let parameters = (self.input.parameters(), false);
            let mut pass = recorder.compute_pass("classify");
            self.stages.record(context, &mut pass, (batch, &self.points), parameters, buffers)?;
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
        self.stages.record(self.context, pass, (batch, &self.points), (parameters, first.is_some()), buffers)
    }
}

/// The twin of the device's stage on the host, faster on software adapters.
pub(crate) struct HostClassifier<'a> {
    input: &'a Input<'a>,
    /// The entry of each sample of 8 and 16 bits, by its bits.
    table: Vec<Entry>,
    normals: DerivativeFilter,
}

/// The appearance of a sample.
#[derive(Debug, Clone, Copy)]
struct Entry {
    density: f32,
    /// Words of the splat; `None`: the sample is invisible.
    appearance: Option<[u32; 2]>,
}

impl HostClassifier<'_> {
    /// The visible voxels of a volume as splats, brick by brick, with normals if there is light.
    pub(crate) fn run(input: &Input<'_>) -> Result<Drawable> {
        let mut classifier = HostClassifier { input, table: Vec::new(), normals: DerivativeFilter::of_normals() };
        classifier.table = match input.coding.sample_type {
            0 => classifier.table(256, |bits| bits as u8 as f32),
            1 => classifier.table(256, |bits| bits as i8 as f32),
            2 => classifier.table(65_536, |bits| bits as f32),
            3 => classifier.table(65_536, |bits| bits as i16 as f32),
            _ => Vec::new(),
        };
        let mut stores = StoreBuilder::new(input.context, STRIDE, joined(input.context));
        let bricks =
            input.each_brick(&|range| input.may_show(range), &|brick| classifier.brick(brick), &mut |brick| {
                stores.push(brick)
            })?;
        Ok(Drawable { bricks, ..stores.finish()? })
    }

    fn table(&self, count: u32, sample: impl Fn(u32) -> f32 + Sync) -> Vec<Entry> {
        (0..count).into_par_iter().map(|bits| self.entry(sample(bits))).collect()
    }

    fn entry(&self, sample: f32) -> Entry {
        let (color, opacity) = self.transfer(sample - self.input.coding.origin as f32);
        let shows = self.input.keeps_invisible() || opacity > 0.0;
        let density = density(opacity);
        Entry { density, appearance: shows.then(|| packed_appearance(color, density)) }
    }

    /// `transfer` in shaders/common/classified.wgsl.
    fn transfer(&self, sample: f32) -> ([f32; 3], f32) {
        let points = self.input.points.as_slice();
        let above = points.partition_point(|point| point.sample <= sample);
        let a = points[above.max(1) - 1];
        let b = points[above.min(points.len() - 1)];
        let width = b.sample - a.sample;
        let f = if width > 0.0 { ((sample - a.sample) / width).clamp(0.0, 1.0) } else { 0.0 };
        let color = [0, 1, 2].map(|c| a.color[c] + (b.color[c] - a.color[c]) * f);
        (color, a.opacity + (b.opacity - a.opacity) * f)
    }

    fn brick(&self, (origin, bytes): Brick) -> Result<MadeBrick> {
        let words = || bytemuck::pod_collect_to_vec::<u8, u16>(&bytes);
        let (narrow, wide) = (|bits: u8| self.table[usize::from(bits)], |bits: u16| self.table[usize::from(bits)]);
        match self.input.coding.sample_type {
            0 => self.splats(origin, &bytes, f32::from, narrow),
            1 => self.splats(origin, &bytes, |bits| f32::from(bits as i8), narrow),
            2 => self.splats(origin, &words(), f32::from, wide),
            3 => self.splats(origin, &words(), |bits| f32::from(bits as i16), wide),
            _ => {
                let samples: Vec<f32> = bytemuck::pod_collect_to_vec(&bytes);
                let sample = |sample: f32| sample.clamp(-FAR as f32, FAR as f32);
                self.splats(origin, &samples, sample, |value| self.entry(sample(value)))
            }
        }
    }

    /// The splats of a brick, given its samples with the halo around them.
    fn splats<T: Copy>(
        &self,
        origin: [u32; 3],
        samples: &[T],
        sample: impl Fn(T) -> f32,
        entry: impl Fn(T) -> Entry,
    ) -> Result<MadeBrick> {
        let Input { lit, thinning, gradients, resolution: [base, faintest], .. } = self.input;
        let halo = self.input.halo();
        let edge = EDGE + 2 * halo;
        let each = if *lit { 3 } else { 2 };
        let slopes = LazyCell::new(|| {
            let field: Vec<f32> = samples.iter().map(|&s| sample(s) - base).collect();
            self.normals.slopes(&field, EDGE, halo)
        });
        MadeBrick::of_rows(origin, self.input.volume.grid().dims(), each, |[y, z], count, words| {
            let start = halo + edge * (y + halo + edge * (z + halo));
            let mut bits = 0;
            for (x, &value) in samples[start..][..count].iter().enumerate() {
                let Entry { density, appearance: Some(mut appearance), .. } = entry(value) else { continue };
                let at = |i: usize| sample(samples[i]);
                let i = start + x;
                let gradient = |slopes| gradient_of(gradients, slopes, resolution_at(at(i) - base, *faintest));
                if !thinning.is_empty() {
                    let differences = [1, edge, edge * edge].map(|step| 0.5 * (at(i + step) - at(i - step)));
                    let share = scaled_share(thinning, steepness_of(gradient(differences)));
                    if share <= 0.0 && !self.input.keeps_invisible() {
                        continue;
                    }
                    appearance = with_density(appearance, density * share);
                }
                bits |= 1 << x;
                words.extend(appearance);
                if *lit {
                    let inside = x + EDGE * (y + EDGE * z);
                    words.push(packed_normal(gradient([0, 1, 2].map(|axis| slopes[axis][inside])).0));
                }
            }
            bits
        })
    }
}

/// `world_gradient` in shaders/common/classified.wgsl, of the slopes along the axes of the lattice: a vector and its
/// factor; 0 if the slopes are under their resolution.
pub(crate) fn gradient_of([x, y, z]: &[[f32; 3]; 3], slopes: [f32; 3], resolution: f32) -> ([f32; 3], f32) {
    let largest = slopes.iter().fold(0.0_f32, |largest, slope| largest.max(slope.abs()));
    if largest <= 0.0 || largest < resolution {
        return ([0.0; 3], 0.0);
    }
    let d = slopes.map(|slope| slope / largest);
    ([0, 1, 2].map(|i| x[i] * d[0] + y[i] * d[1] + z[i] * d[2]), largest)
}

/// The length of such a gradient.
pub(crate) fn steepness_of(([x, y, z], times): ([f32; 3], f32)) -> f32 {
    ((x * x + y * y + z * z).sqrt() * times).min(FAR as f32)
}
