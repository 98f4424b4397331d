//! classify: a volume and a transfer function to a list of splats.

use bytemuck::Zeroable;

use super::cache::Cache;
use super::context::Context;
use super::layout::{Classify, ControlPoint, MAX_INLINE_POINTS, Splat};
use super::pipeline::{Binding, bind, compute, flag, layout, module};
use super::recorder::Recorder;
use super::scan::{Scan, WORKGROUP};
use super::shaders;
use super::store::{BrickSplats, Bricks, Part, Store, StoreBuilder};
use super::transfer::Reduction;
use crate::error::Result;
use crate::progress::Progress;
use crate::transfer::TransferFunction;
use crate::volume::{BRICK_EDGE as EDGE, RowCoding, SampleType, ToF64, Volume};

/// Bricks of one batch, a million voxels: the memory that preparing a scene takes besides its splats, and far within
/// every limit.
const BATCH: usize = 32;

/// The most splats that are joined: while they are, they are in memory twice.
const JOINED: u32 = 1 << 19;

/// What became of a volume.
#[derive(Default)]
pub(crate) struct Classified {
    pub(crate) stores: Vec<Store>,
    pub(crate) bricks: Bricks,
    /// What painters made of the splats.
    pub(crate) kept: Cache,
}

/// The largest control point, and beyond it the largest sample, that shaders see: differences stay in the range of f32.
const FAR: f64 = 1e36;
/// The least extent of the control points in floats as they are: their products stay in the range of f32.
const LEAST_EXTENT: f64 = 1e-24;

/// How the shader reads samples: SAMPLE_TYPE in shaders/classify.wgsl.
///
/// Types whose every value is exact in f32 are uploaded as they are. Others, and floats whose control points are near
/// the ends of the range of f32, are reduced on the host, chunk by chunk, to the scalars of post-shading: a window of
/// 10 at 4e9 keeps its resolution.
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
            // A falling map would turn the control points round, and with them the side on which a step belongs.
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
            // A function without extent is constant, whatever it is told.
            None => (0.0, Some(Reduction::new(transfer, 1.0))),
        };
        Self { sample_type: sample_type.unwrap_or(4), origin, reduction, slope, intercept }
    }

    /// A value of the transfer function as the shader compares it with samples.
    fn point(&self, value: f64) -> f32 {
        match &self.reduction {
            Some(reduction) => reduction.scalar(value),
            // A sample reaches the value if it reaches the next f32: no sample is between.
            None if self.slope == 1.0 && self.intercept == 0.0 => next_f32((value - self.origin).clamp(-FAR, FAR)),
            None => ((value - self.intercept) / self.slope - self.origin).clamp(-FAR, FAR) as f32,
        }
    }
}

/// The least f32 that is not under a number.
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

/// The pipelines of classification, made for one way of reading samples at a time.
pub(crate) struct Classifier {
    module: wgpu::ShaderModule,
    layout: wgpu::BindGroupLayout,
}

impl Classifier {
    pub(crate) fn new(context: &Context) -> Self {
        let slots = [
            Binding::Uniform,
            Binding::Read,
            Binding::Read,
            Binding::Write,
            Binding::Write,
            Binding::Read,
            Binding::Write,
        ];
        Self {
            module: module(context, shaders::CLASSIFY),
            layout: layout(context, "classify", wgpu::ShaderStages::COMPUTE, &slots),
        }
    }

    /// The visible voxels of a volume as splats, brick by brick, with normals if there is light.
    pub(crate) fn run(
        &self,
        context: &Context,
        scan: &Scan,
        volume: &Volume,
        transfer: &TransferFunction,
        lit: bool,
        progress: &Progress,
    ) -> Result<Classified> {
        let savings = context.savings;
        let coding = SampleCoding::new(volume, transfer);
        let points: Vec<ControlPoint> = transfer
            .points()
            .iter()
            .map(|p| ControlPoint {
                color: p.color.map(|c| c as f32),
                sample: coding.point(p.value),
                opacity: p.opacity as f32,
                _pad: [0.0; 3],
            })
            .collect();
        // So few points are part of the pipeline, which is made for their number.
        let mut few = [ControlPoint::zeroed(); MAX_INLINE_POINTS];
        let is_few = points.len() <= MAX_INLINE_POINTS;
        if is_few {
            few[..points.len()].copy_from_slice(&points);
        }
        let constants = [
            ("SAMPLE_TYPE", f64::from(coding.sample_type)),
            ("LIT", flag(lit)),
            ("KEEP_INVISIBLE", flag(!savings.voxels)),
            ("INLINE_POINTS", if is_few { points.len() as f64 } else { 0.0 }),
        ];
        let pipeline = |entry| compute(context, &self.module, "classify", entry, &self.layout, &constants);
        let gradients = volume.grid().local().to_lattice().matrix3.transpose();
        let gradient = |axis: usize| gradients.col(axis).as_vec3().to_array();
        let storage = wgpu::BufferUsages::STORAGE;
        let job = Job {
            context,
            scan,
            layout: &self.layout,
            count: pipeline("count"),
            emit: pipeline("emit"),
            points: context.upload("classify.control_points", bytemuck::cast_slice(&points), storage)?,
            parameters: Classify {
                dims: volume.grid().dims(),
                bricks: 0,
                gradient_x: gradient(0),
                points: points.len() as u32,
                gradient_y: gradient(1),
                sample_origin: coding.origin as f32,
                gradient_z: gradient(2),
                first_brick: 0,
                inline_points: few,
            },
        };
        let mut batch = BrickBatch::default();
        let mut stores = StoreBuilder::new(context, STRIDE, JOINED);
        let mut classified = Classified::default();
        let (slope, intercept) = volume.rescale();
        let shows = |[low, high]: [f64; 2]| {
            let [a, b] = [low, high].map(|raw| slope * raw + intercept);
            !savings.bricks || !savings.voxels || !transfer.is_invisible([a.min(b), a.max(b)])
        };
        let total = volume.bricks().into_iter().product::<u32>();
        volume.for_each_brick(&shows, usize::from(lit), &coding, &mut |brick| {
            let bricks = &mut classified.bricks;
            bricks.all += 1;
            if let Some((origin, bytes)) = brick {
                bricks.uploaded += 1;
                bricks.bytes += bytes.len() as u64;
                batch.origins.push([origin[0], origin[1], origin[2], 0]);
                batch.bytes.extend_from_slice(&bytes);
                if batch.origins.len() == BATCH {
                    job.run(&std::mem::take(&mut batch), &mut stores)?;
                }
            }
            progress.report("classifying", f64::from(classified.bricks.all) / f64::from(total));
            Ok(())
        })?;
        if !batch.origins.is_empty() {
            job.run(&batch, &mut stores)?;
        }
        classified.stores = stores.finish()?;
        Ok(classified)
    }
}

/// Bytes of a splat.
const STRIDE: u64 = size_of::<Splat>() as u64;

/// Bricks that are classified together.
#[derive(Default)]
struct BrickBatch {
    origins: Vec<[u32; 4]>,
    bytes: Vec<u8>,
}

/// What all batches of a volume share.
struct Job<'a> {
    context: &'a Context,
    scan: &'a Scan,
    layout: &'a wgpu::BindGroupLayout,
    count: wgpu::ComputePipeline,
    emit: wgpu::ComputePipeline,
    points: wgpu::Buffer,
    parameters: Classify,
}

impl Job<'_> {
    /// Adds the visible voxels of a batch.
    fn run(&self, batch: &BrickBatch, stores: &mut StoreBuilder<'_, ClassifiedPart>) -> Result<()> {
        let context = self.context;
        let storage = wgpu::BufferUsages::STORAGE;
        let rows = EDGE * EDGE;
        let runs = (batch.origins.len() * rows) as u64;
        let parameters = Classify { bricks: batch.origins.len() as u32, ..self.parameters };
        let uniform = |parameters: &Classify| {
            context.upload("classify.parameters", bytemuck::bytes_of(parameters), wgpu::BufferUsages::UNIFORM)
        };
        let samples = context.upload("classify.samples", &batch.bytes, storage)?;
        let origins = context.upload("classify.origins", bytemuck::cast_slice(&batch.origins), storage)?;
        // One place more than runs: the scan leaves the total there.
        let (places_bytes, seen_bytes) = ((runs + 1) * 4, runs * 4);
        let places = context.buffer("classify.places", places_bytes, storage | wgpu::BufferUsages::COPY_SRC)?;
        let seen = context.buffer("classify.seen", seen_bytes, storage | wgpu::BufferUsages::COPY_SRC)?;
        let none = context.buffer("classify.no_splats", 16, storage)?;
        let bindings = |parameters: &wgpu::Buffer, splats: &wgpu::Buffer| {
            let resources = [parameters, &samples, &self.points, &places, splats, &origins, &seen];
            bind(context, "classify", self.layout, &resources.map(wgpu::Buffer::as_entire_binding))
        };
        let (x, y) = context.workgroups(runs, WORKGROUP);
        let mut recorder = Recorder::untimed(context);
        {
            let mut pass = recorder.compute_pass("classify");
            pass.set_pipeline(&self.count);
            pass.set_bind_group(0, &bindings(&uniform(&parameters)?, &none), &[]);
            pass.dispatch_workgroups(x, y, 1);
            self.scan.record(context, &mut pass, &places, runs + 1)?;
        }
        let places = recorder.read_back("classify.places_staging", &places, places_bytes)?;
        let seen = recorder.read_back("classify.seen_staging", &seen, seen_bytes)?;
        recorder.submit();
        let places: Vec<u32> = places.values(context, "classifying the volume")?;
        let seen: Vec<u32> = seen.values(context, "classifying the volume")?;
        let visible = places[runs as usize];
        if visible == 0 {
            return Ok(());
        }
        let (first_brick, first_splat) = stores.make_room(visible, batch.origins.len())?;
        let bytes = u64::from(visible) * STRIDE;
        let splats = context.buffer("classify.splats", bytes, storage | wgpu::BufferUsages::COPY_SRC)?;
        let parameters = uniform(&Classify { first_brick, ..parameters })?;
        recorder.dispatch("classify", &self.emit, &bindings(&parameters, &splats), &[], [x, y, 1]);
        recorder.submit();
        // Waiting here keeps one batch of samples on the device, not all of them.
        context.wait("classifying the volume")?;
        let bricks = batch.origins.iter().zip(places.iter().step_by(rows).zip(seen.chunks_exact(rows)));
        let bricks = bricks.map(|(&[x, y, z, _], (place, seen))| {
            BrickSplats::new([x, y, z], first_splat + place, seen.iter().copied())
        });
        stores.add(ClassifiedPart { splats, count: visible }, visible, bricks);
        Ok(())
    }
}

/// Classified splats on the device.
struct ClassifiedPart {
    splats: wgpu::Buffer,
    count: u32,
}

impl Part for ClassifiedPart {
    fn join(context: &Context, parts: Vec<Self>, bytes: u64) -> Result<wgpu::Buffer> {
        if let [part] = parts.as_slice() {
            return Ok(part.splats.clone());
        }
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let joined = context.buffer("classify.store", bytes, usage)?;
        let mut recorder = Recorder::untimed(context);
        let mut at = 0;
        for part in &parts {
            let bytes = u64::from(part.count) * STRIDE;
            recorder.copy(&part.splats, &joined, at, bytes);
            at += bytes;
        }
        recorder.submit();
        // Waiting here frees the parts before others are made.
        context.wait("classifying the volume")?;
        Ok(joined)
    }
}
