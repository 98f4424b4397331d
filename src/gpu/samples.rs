//! The samples of a volume as stages read them: brick by brick with the voxels around each, in batches on the device.

use std::ops::Range;

use bytemuck::Zeroable;
use rayon::prelude::*;

use super::context::Context;
use super::layout::{Classify, ControlPoint};
use super::pipeline::buffer_range;
use super::recorder::Recorder;
use super::sender::Sender;
use super::stage::Constant;
use crate::error::{Error, Result};
use crate::lighting::Normals;
use crate::progress::Progress;
use crate::splats::gradients::{FAR, gradients};
use crate::transfer::scalars::Reduction;
use crate::transfer::{self, Node, Pieces, Resolution, TransferFunction};
use crate::volume::{BRICK_EDGE as EDGE, Brick, RowCoding, SampleType, ToF64, Volume};

/// The number of bricks of a batch, 4 million voxels: the memory that preparing a scene needs besides its splats, and
/// far within every limit.
pub(super) const BATCH: usize = 128;
/// The number of rows of a brick.
pub(super) const ROWS: usize = EDGE * EDGE;
/// The work in words that complete errors: "while ...".
const SENDING: &str = "sending samples";

/// The count of numbers of a node of a band-limited classification: emission, slope, bend, the integral and its
/// rounding.
const COLUMNS: usize = 5;

/// The least extent of the control points in unreduced floats: their products stay in the range of f32.
const LEAST_EXTENT: f64 = 1e-24;

/// The coding of samples for shaders: SAMPLE_TYPE in shaders/common/classified.wgsl.
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
                let points: Vec<_> = transfer.knots().iter().map(|p| sample(p.value)).collect();
                let (first, last) = (points[0], points[points.len() - 1]);
                let extent = if last > first { last - first } else { first.abs() };
                let ordinary = |p: &f64| p.abs() < FAR && (extent == 0.0 || extent > LEAST_EXTENT);
                points.iter().filter(|&&p| p != 0.0).all(ordinary).then_some(4)
            }
            _ => None,
        };
        let (origin, reduction) = match sample_type {
            Some(4) => (0.0, None),
            // An integer within the samples' range, so that the shader's subtraction is exact.
            Some(_) => (sample(transfer.knots()[0].value).round().clamp(-32_768.0, 65_535.0), None),
            // A function without extent is constant, whatever its input.
            None => (0.0, Some(Reduction::new(transfer, 1.0))),
        };
        Self { sample_type: sample_type.unwrap_or(4), origin, reduction, slope, intercept }
    }

    /// Returns the coding of scalars of this reduction. The host reduces samples whose factor to scalars, or its
    /// inverse, is no normal number of f32.
    fn of_scalars(self, reduction: Reduction) -> Self {
        const MOST_FACTOR: f64 = 1e37;
        let is_normal = (1.0 / MOST_FACTOR..MOST_FACTOR).contains(&(self.slope * reduction.factor()));
        match self.reduction {
            None if is_normal => self,
            _ => Self { sample_type: 4, reduction: Some(reduction), ..self },
        }
    }

    /// Returns the control points in the units in which the shader compares samples; for a band-limited classification
    /// the [`COLUMNS`] of the nodes of its pieces.
    fn points(&self, transfer: &TransferFunction) -> Vec<ControlPoint> {
        if transfer.is_band_limited() {
            let pieces = Pieces::new(transfer, |value| f64::from(self.point(value)));
            let point = |place: f64, [r, g, b, depth]: [f64; 4]| ControlPoint {
                color: [r, g, b].map(|channel| channel as f32),
                sample: place as f32,
                opacity: depth as f32,
                _pad: [0.0; 3],
            };
            let columns = |node: &Node| {
                let Node { emission, slope, bend, integral, .. } = *node;
                [emission, slope, bend, integral, integral.map(|channel| channel - f64::from(channel as f32))]
            };
            let column = |n: usize| pieces.nodes().iter().map(move |node| point(node.place, columns(node)[n]));
            return (0..COLUMNS).flat_map(column).collect();
        }
        let point = |p: &transfer::ControlPoint| ControlPoint {
            color: p.color.map(|c| c as f32),
            sample: self.point(p.value),
            opacity: p.opacity as f32,
            _pad: [0.0; 3],
        };
        transfer.knots().iter().map(point).collect()
    }

    /// Returns the base of the transfer function as a sample, and the resolution of samples there; 0 if nothing depends
    /// on gradients, because the resolution needs the ranges of all samples.
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

    /// Returns the factor from gradients of values to gradients of samples.
    fn gradient_scale(&self) -> f64 {
        self.reduction.map_or(1.0 / self.slope.abs(), |reduction| reduction.factor())
    }

    /// Converts a value of the transfer function to the units in which the shader compares samples.
    fn point(&self, value: f64) -> f32 {
        match &self.reduction {
            Some(reduction) => reduction.scalar(value),
            // A sample reaches the value if it reaches the next f32: no sample is between.
            None if self.slope == 1.0 && self.intercept == 0.0 => next_f32((value - self.origin).clamp(-FAR, FAR)),
            None => ((value - self.intercept) / self.slope - self.origin).clamp(-FAR, FAR) as f32,
        }
    }
}

/// Returns the least f32 that is not below a number.
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

/// A volume to classify, in the form that stages read.
pub(crate) struct Input<'a> {
    pub(super) context: &'a Context,
    pub(super) volume: &'a Volume,
    transfer: &'a TransferFunction,
    /// The kind of the splats' normals; `None`: splats have no normals.
    normals: Option<Normals>,
    /// The number of layers of neighbouring voxels around a brick.
    halo: usize,
    pub(super) progress: &'a Progress,
    pub(super) coding: SampleCoding,
    /// The control points in the units in which samples are compared, see [`SampleCoding::points`].
    pub(super) points: Vec<ControlPoint>,
    /// The points of gradient opacity, as gradients of samples; empty: extinction does not depend on gradients.
    pub(super) thinning: Vec<[f32; 2]>,
    /// The base of the transfer function as a sample, and the resolution there.
    pub(super) resolution: [f32; 2],
    pub(super) gradients: [[f32; 3]; 3],
}

impl<'a> Input<'a> {
    /// Makes the input of a volume whose splats get these normals if they are lit.
    pub(crate) fn new(
        context: &'a Context,
        volume: &'a Volume,
        transfer: &'a TransferFunction,
        normals: Option<Normals>,
        progress: &'a Progress,
    ) -> Result<Self> {
        let coding = SampleCoding::new(volume, transfer);
        let points = coding.points(transfer);
        // On a lattice of the volume's unit of length.
        let thinning = transfer.scaled_gradient_opacity(coding.gradient_scale() * volume.grid().unit());
        let resolution = coding.resolution(transfer, volume, normals.is_some())?;
        // `halo` in shaders/common/classified.wgsl.
        let halo = normals.map_or(usize::from(transfer.depends_on_neighbours()), Normals::reach);
        let unlit = Self::unclassified(context, volume, transfer, (coding, halo), progress);
        Ok(Self { normals, points, thinning, resolution, ..unlit })
    }

    /// Makes the input of a volume of scalars of this reduction, with gradients if they are lit.
    pub(crate) fn of_scalars(
        context: &'a Context,
        volume: &'a Volume,
        (transfer, reduction): (&'a TransferFunction, Reduction),
        lit: bool,
        progress: &'a Progress,
    ) -> Self {
        let coding = SampleCoding::new(volume, transfer);
        let coding = coding.of_scalars(reduction);
        Self::unclassified(context, volume, transfer, (coding, usize::from(lit)), progress)
    }

    /// Makes the input of a volume without classification, with `halo` layers of voxels around each brick.
    fn unclassified(
        context: &'a Context,
        volume: &'a Volume,
        transfer: &'a TransferFunction,
        (coding, halo): (SampleCoding, usize),
        progress: &'a Progress,
    ) -> Self {
        let (points, thinning, resolution) = (Vec::new(), Vec::new(), [0.0; 2]);
        let (normals, gradients) = (None, gradients(volume));
        Self { context, volume, transfer, normals, halo, progress, coding, points, thinning, resolution, gradients }
    }

    /// Returns whether voxels are classified by the values around them.
    fn is_band_limited(&self) -> bool {
        !self.points.is_empty() && self.transfer.is_band_limited()
    }

    /// Returns the number of layers of neighbouring voxels around a brick.
    pub(super) fn halo(&self) -> usize {
        self.halo
    }

    /// Returns the number of bytes of the samples of a brick with its halo: a multiple of 8.
    pub(super) fn brick_bytes(&self) -> u64 {
        let edge = (EDGE + 2 * self.halo()) as u64;
        edge.pow(3) * [1, 1, 2, 2, 4][self.coding.sample_type as usize]
    }

    /// Returns whether invisible voxels become splats too.
    pub(super) fn keeps_invisible(&self) -> bool {
        !self.context.savings.voxels
    }

    /// Returns whether a brick with samples in this range may be visible.
    pub(super) fn may_show(&self, range: [f64; 2]) -> bool {
        let (slope, intercept) = self.volume.rescale();
        let [a, b] = range.map(|raw| slope * raw + intercept);
        !self.context.savings.bricks || self.keeps_invisible() || !self.transfer.is_invisible([a.min(b), a.max(b)])
    }

    /// Calls `take` with the result of `make`, which runs in parallel, for each brick that `shows` accepts, given its
    /// number and the range of its samples, in order.
    pub(super) fn each_brick<B: Send>(
        &self,
        shows: &(dyn Fn(usize, [f64; 2]) -> bool + Sync),
        make: &(dyn Fn(Brick) -> Result<B> + Sync),
        take: &mut dyn FnMut(B) -> Result<()>,
    ) -> Result<Bricks> {
        let Self { volume, progress, .. } = self;
        let mut bricks = Bricks::default();
        let total = self.brick_count();
        let made = |brick: Brick| Ok::<_, Error>((brick.1.len() as u64, make(brick)?));
        volume.for_each_brick(shows, self.halo(), &self.coding, &made, &mut |brick| {
            bricks.all += 1;
            if let Some((bytes, brick)) = brick {
                bricks.uploaded += 1;
                bricks.bytes += bytes;
                take(brick)?;
            }
            progress.report("classifying", f64::from(bricks.all) / total as f64);
            progress.check()
        })?;
        Ok(bricks)
    }
}

/// The form in which shaders read the samples of a volume: the constants of shaders/common/classified.wgsl.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct InputKey {
    sample_type: u32,
    normals: Option<Normals>,
    gradient_opacity: bool,
    band_limited: bool,
}

impl InputKey {
    /// Returns the key of voxels that are classified already, with these normals if they are lit.
    pub(super) fn of_words(normals: Option<Normals>) -> Self {
        Self { sample_type: 0, normals, gradient_opacity: false, band_limited: false }
    }

    /// Returns whether splats have normals.
    pub(super) fn is_lit(self) -> bool {
        self.normals.is_some()
    }

    pub(super) fn constants(self) -> [Constant; 5] {
        let Self { sample_type, normals, gradient_opacity, band_limited } = self;
        [
            ("SAMPLE_TYPE", sample_type),
            ("LIT", normals.is_some().into()),
            ("TENSOR", (normals == Some(Normals::Tensor)).into()),
            ("GRADIENT_OPACITY", gradient_opacity.into()),
            ("BAND_LIMITED", band_limited.into()),
        ]
    }
}

impl Input<'_> {
    pub(super) fn key(&self) -> InputKey {
        let Self { normals, coding, thinning, .. } = self;
        InputKey {
            sample_type: coding.sample_type,
            normals: *normals,
            gradient_opacity: !thinning.is_empty(),
            band_limited: self.is_band_limited(),
        }
    }

    /// Uploads the control points of the transfer function, then the points of gradient opacity.
    pub(super) fn points_on_device(&self) -> Result<wgpu::Buffer> {
        let steepness = |&[sample, opacity]: &[f32; 2]| ControlPoint { sample, opacity, ..ControlPoint::zeroed() };
        let all: Vec<ControlPoint> = self.points.iter().copied().chain(self.thinning.iter().map(steepness)).collect();
        self.context.upload("classify.control_points", bytemuck::cast_slice(&all), wgpu::BufferUsages::STORAGE)
    }

    /// Returns the parameters of shaders, without bricks.
    pub(super) fn parameters(&self) -> Classify {
        let [gradient_x, gradient_y, gradient_z] = self.gradients;
        let [base, faintest] = self.resolution;
        Classify {
            dims: self.volume.grid().dims(),
            bricks: 0,
            gradient_x,
            points: (self.points.len() / if self.is_band_limited() { COLUMNS } else { 1 }) as u32,
            gradient_y,
            sample_origin: self.coding.origin as f32,
            gradient_z,
            first_brick: 0,
            gradient_points: self.thinning.len() as u32,
            base,
            faintest,
            ..Classify::zeroed()
        }
    }

    /// Returns the number of bricks of the volume.
    pub(super) fn brick_count(&self) -> usize {
        self.volume.bricks().into_iter().map(|count| count as usize).product()
    }

    /// Returns the number of bricks that may be visible.
    pub(super) fn shown(&self) -> Result<u32> {
        Ok(self.volume.ranges()?.iter().filter(|&&range| self.may_show(range)).count() as u32)
    }

    /// Sends the samples of the bricks that `shows` accepts, given their numbers and the ranges of their samples: calls
    /// `flush` with up to [`BATCH`] bricks at a time.
    pub(super) fn send(
        &self,
        shows: &(dyn Fn(usize, [f64; 2]) -> bool + Sync),
        flush: &mut dyn FnMut(&mut Outbox<'_>) -> Result<()>,
    ) -> Result<Bricks> {
        let all = self.brick_count();
        let (count, parts) = if all > BATCH { (BATCH, 2) } else { (all, 1) };
        let sender = Sender::new(self.context, SENDING, count as u64 * self.brick_bytes(), parts)?;
        let mut outbox = Outbox { context: self.context, sender, origins: Vec::new(), bytes: Vec::new() };
        let bricks = self.each_brick(shows, &Ok, &mut |([x, y, z], samples)| {
            outbox.origins.push([x, y, z, 0]);
            outbox.bytes.extend_from_slice(&samples);
            if outbox.origins.len() == BATCH { flush(&mut outbox) } else { Ok(()) }
        })?;
        if !outbox.origins.is_empty() {
            flush(&mut outbox)?;
        }
        Ok(bricks)
    }
}

/// Samples of bricks on their way to the device.
pub(super) struct Outbox<'a> {
    context: &'a Context,
    sender: Sender<'a>,
    /// The lattice points of the first voxels of the bricks.
    pub(super) origins: Vec<[u32; 4]>,
    /// The samples of the bricks.
    bytes: Vec<u8>,
}

impl Outbox<'_> {
    /// Sends the samples, whose targets `copy` records, and empties the box.
    pub(super) fn send(&mut self, copy: impl FnOnce(&mut Recorder<'_>, &wgpu::Buffer)) -> Result<()> {
        /// The number of bytes that a thread writes at a time.
        const PART: usize = 1 << 20;
        let fill = |staging: &wgpu::Buffer| {
            self.bytes.par_chunks(PART).enumerate().try_for_each(|(number, part)| {
                self.context.write_mapped(SENDING, staging, (number * PART) as u64, part)
            })
        };
        self.sender.send(&mut Recorder::untimed(self.context), fill, copy)?;
        self.origins.clear();
        self.bytes.clear();
        Ok(())
    }
}

/// The bricks that were searched for splats.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Bricks {
    /// Number of bricks of the volume and of the copies beyond its faces.
    pub(crate) all: u32,
    /// Number of bricks that may be visible: only these are classified, or searched voxel by voxel.
    pub(crate) uploaded: u32,
    /// The number of bytes sent to the device for the bricks.
    pub(crate) bytes: u64,
}

impl Bricks {
    /// Adds the bricks of another level of the volume.
    pub(crate) fn and(self, other: &Self) -> Self {
        Self { all: self.all + other.all, uploaded: self.uploaded + other.uploaded, bytes: self.bytes + other.bytes }
    }
}

/// Bricks that are classified together, on the device.
pub(super) struct BrickBatch {
    /// The lattice points of the first voxels of the bricks.
    pub(super) origins: Vec<[u32; 4]>,
    /// The lattice points of the first voxels, on the device.
    pub(super) places: wgpu::Buffer,
    /// The buffer of samples with the voxels around each brick, which holds other batches too.
    pub(super) samples: wgpu::Buffer,
    /// The number of bricks before these in the buffer of samples.
    pub(super) before: usize,
    /// The bytes of the samples of these bricks.
    pub(super) bytes: Range<u64>,
}

impl BrickBatch {
    /// Makes the batch of the bricks that begin at `origins`, behind `before` other bricks in a buffer of samples.
    pub(super) fn new(
        input: &Input<'_>,
        origins: Vec<[u32; 4]>,
        (samples, before): (wgpu::Buffer, usize),
    ) -> Result<Self> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let places = input.context.upload("classify.origins", bytemuck::cast_slice(&origins), usage)?;
        let [start, end] = [before, before + origins.len()].map(|bricks| bricks as u64 * input.brick_bytes());
        Ok(Self { origins, places, samples, before, bytes: start..end })
    }

    /// Binds the samples of the batch. Batches are whole multiples of the alignment of bindings: a brick has a multiple
    /// of 8 samples.
    pub(super) fn binding(&self) -> wgpu::BindingResource<'_> {
        buffer_range(&self.samples, self.bytes.start, self.bytes.end - self.bytes.start)
    }

    /// Binds the values, a word each, of the rows of `bricks` bricks in a buffer, behind the rows of `before` others.
    pub(super) fn rows(buffer: &wgpu::Buffer, before: usize, bricks: usize) -> wgpu::BindingResource<'_> {
        let bytes = |bricks: usize| (bricks * ROWS * size_of::<u32>()) as u64;
        buffer_range(buffer, bytes(before), bytes(bricks))
    }
}
