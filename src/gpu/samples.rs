//! The samples of a volume as stages read them: brick by brick with the voxels around each, in batches on the device.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Zeroable;
use rayon::prelude::*;

use super::context::Context;
use super::layout::{Classify, ControlPoint};
use super::pipeline::buffer_range;
use super::recorder::Recorder;
use super::sender::Sender;
use super::stage::Constant;
use super::transfer::Reduction;
use crate::error::{Error, Result};
use crate::kernel::NORMAL_REACH;
use crate::progress::Progress;
use crate::transfer::{self, Resolution, TransferFunction};
use crate::volume::{BRICK_EDGE as EDGE, Brick, RowCoding, SampleType, ToF64, Volume};

/// Bricks of one batch, 4 million voxels: the memory that preparing a scene needs besides its splats, and far within
/// every limit.
pub(super) const BATCH: usize = 128;
/// Rows of a brick.
pub(super) const ROWS: usize = EDGE * EDGE;
/// Completes errors: "while ...".
const SENDING: &str = "sending samples";

/// The limit of control points and samples that shaders see: differences stay in the range of f32.
pub(super) const FAR: f64 = 1e36;
/// The least extent of the control points in unreduced floats: their products stay in the range of f32.
const LEAST_EXTENT: f64 = 1e-24;

/// How the shader reads samples: SAMPLE_TYPE in shaders/common/classified.wgsl.
///
/// Types whose every value is exact in f32 are uploaded unchanged. Others, and floats whose control points are near the
/// ends of the range of f32, are reduced on the host, chunk by chunk, to the scalars of post-shading: a window of 10 at
/// 4e9 keeps its resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SampleCoding {
    pub(super) sample_type: u32,
    pub(super) origin: f64,
    pub(super) reduction: Option<Reduction>,
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
    pub(super) lit: bool,
    /// The layers of neighbouring voxels around a brick.
    halo: usize,
    pub(super) progress: &'a Progress,
    pub(super) coding: SampleCoding,
    /// The control points as samples are compared with them.
    pub(super) points: Vec<ControlPoint>,
    /// Gradient opacity, of gradients of samples; empty: extinction does not depend on them.
    pub(super) thinning: Vec<[f32; 2]>,
    /// The base of the transfer function as a sample, and the resolution there.
    pub(super) resolution: [f32; 2],
    pub(super) gradients: [[f32; 3]; 3],
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
        // For normals and for gradient opacity: `halo` in shaders/common/classified.wgsl.
        let halo = if lit { NORMAL_REACH } else { usize::from(!thinning.is_empty()) };
        Ok(Self { context, volume, transfer, lit, halo, progress, coding, points, thinning, resolution, gradients })
    }

    /// A volume of scalars of this reduction, with gradients if they are lit.
    pub(crate) fn of_scalars(
        context: &'a Context,
        volume: &'a Volume,
        (transfer, reduction): (&'a TransferFunction, Reduction),
        lit: bool,
        progress: &'a Progress,
    ) -> Self {
        let coding = SampleCoding::new(volume, transfer);
        let coding = SampleCoding { reduction: coding.reduction.map(|_| reduction), ..coding };
        let (points, thinning) = (Vec::new(), Vec::new());
        let (resolution, gradients, halo) = ([0.0; 2], gradients(volume), usize::from(lit));
        Self { context, volume, transfer, lit: false, halo, progress, coding, points, thinning, resolution, gradients }
    }

    /// The layers of neighbouring voxels around a brick.
    pub(super) fn halo(&self) -> usize {
        self.halo
    }

    /// Bytes of the samples of a brick with its halo.
    fn brick_bytes(&self) -> u64 {
        let edge = (EDGE + 2 * self.halo()) as u64;
        edge.pow(3) * [1, 1, 2, 2, 4][self.coding.sample_type as usize]
    }

    /// Whether voxels that do not show become splats too.
    pub(super) fn keeps_invisible(&self) -> bool {
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
    pub(super) fn each_brick<B: Send>(
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

    /// Bytes of the samples of all bricks.
    pub(crate) fn bytes(&self) -> u64 {
        self.volume.bricks().into_iter().map(u64::from).product::<u64>() * self.brick_bytes()
    }

    /// The number of bricks that may show of bricks with samples in these ranges.
    pub(super) fn shown(&self, ranges: &[[f64; 2]]) -> u32 {
        ranges.iter().filter(|&&range| self.may_show(range)).count() as u32
    }

    /// Calls `take` with the bricks that `shows` accepts, in batches on the device. Each `together` bricks share a
    /// buffer.
    pub(super) fn batches(
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

/// The bricks that were searched for splats.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Bricks {
    /// Bricks of the volume and of the copies beyond its faces.
    pub(crate) all: u32,
    /// Bricks that may be visible: only these are classified, or searched voxel by voxel.
    pub(crate) uploaded: u32,
    /// Bytes sent to the device for them.
    pub(crate) bytes: u64,
}

impl Bricks {
    /// The bricks of two levels of a volume together.
    pub(crate) fn and(self, other: &Self) -> Self {
        Self { all: self.all + other.all, uploaded: self.uploaded + other.uploaded, bytes: self.bytes + other.bytes }
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
        input.bytes() <= Self::MOST && input.together().is_multiple_of(row as usize)
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
    pub(super) fn binding(&self) -> wgpu::BindingResource<'_> {
        buffer_range(&self.samples, self.bytes.start, self.bytes.end - self.bytes.start)
    }

    /// The values of the rows of some bricks of a buffer of samples, a word each, as a binding.
    pub(super) fn rows(buffer: &wgpu::Buffer, before: usize, bricks: usize) -> wgpu::BindingResource<'_> {
        let bytes = |bricks: usize| (bricks * ROWS * size_of::<u32>()) as u64;
        buffer_range(buffer, bytes(before), bytes(bricks))
    }
}

/// World gradients of the lattice coordinates.
pub(crate) fn gradients(volume: &Volume) -> [[f32; 3]; 3] {
    let gradients = volume.grid().local().to_lattice().matrix3.transpose();
    [0, 1, 2].map(|axis| gradients.col(axis).as_vec3().to_array())
}
