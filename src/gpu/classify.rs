//! classify: a volume and a transfer function to a list of splats.

use super::context::Context;
use super::layout::{Classify, ControlPoint};
use super::pipeline::{Slot, bind, compute, layout, module};
use super::scan::{Scan, WORKGROUP};
use super::shaders;
use crate::error::Result;
use crate::transfer::TransferFunction;
use crate::volume::{BRICK_EDGE as EDGE, RowCoding, SampleType, ToF64, Volume};

/// Bricks of one batch, 4 million voxels: the memory that preparing a scene takes besides its splats, and far within every
/// limit.
const BATCH: usize = 128;

/// The most splats that are joined: while they are, they are in memory twice.
const JOINED: u32 = 1 << 22;

/// What became of a volume.
#[derive(Debug, Default)]
pub(crate) struct Classified {
    pub(crate) stores: Vec<Store>,
    /// Bricks of the volume, those of them that may show anything, and the bytes of these.
    pub(crate) bricks: u32,
    pub(crate) bricks_uploaded: u32,
    pub(crate) bytes_uploaded: u64,
}

/// Splats in one buffer that fits into a storage binding.
#[derive(Debug)]
pub(crate) struct Store {
    pub(crate) splats: wgpu::Buffer,
    /// A packed world normal for each splat, where they are to be lit.
    pub(crate) normals: Option<wgpu::Buffer>,
    pub(crate) count: u32,
}

/// How the shader reads samples: SAMPLE_TYPE in shaders/classify.wgsl.
///
/// Types whose every value is exact in f32 are uploaded as they are. Wider ones are reduced on the host, chunk by chunk,
/// to f32 relative to the first control point: a window of 10 at 4e9 keeps its resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SampleCoding {
    sample_type: u32,
    origin: f64,
    convert: bool,
    slope: f64,
    intercept: f64,
}

impl SampleCoding {
    fn new(volume: &Volume, transfer: &TransferFunction) -> Self {
        let (slope, intercept) = volume.rescale();
        let first = transfer.points()[0].value;
        let sample_type = match volume.sample_type() {
            // A falling map would turn the control points round, and with them the side on which a step belongs.
            _ if slope < 0.0 => None,
            SampleType::U8 => Some(0),
            SampleType::I8 => Some(1),
            SampleType::U16 => Some(2),
            SampleType::I16 => Some(3),
            SampleType::F32 => Some(4),
            _ => None,
        };
        match sample_type {
            Some(4) => Self { sample_type: 4, origin: 0.0, convert: false, slope, intercept },
            Some(sample_type) => {
                // An integer within the samples' range, so that the shader's subtraction is exact.
                let origin = ((first - intercept) / slope).round().clamp(-32_768.0, 65_535.0);
                Self { sample_type, origin, convert: false, slope, intercept }
            }
            None => Self { sample_type: 4, origin: first, convert: true, slope, intercept },
        }
    }

    /// A value of the transfer function as the shader compares it with samples.
    fn point(&self, value: f64) -> f32 {
        if self.convert {
            (value - self.origin) as f32
        } else {
            ((value - self.intercept) / self.slope - self.origin) as f32
        }
    }
}

impl RowCoding for SampleCoding {
    fn append<T: ToF64 + bytemuck::Pod>(&self, samples: &[T], bytes: &mut Vec<u8>) {
        if self.convert {
            let value = |s: &T| ((self.slope * s.to_f64() + self.intercept) - self.origin) as f32;
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
        let slots = [Slot::Uniform, Slot::Read, Slot::Read, Slot::Write, Slot::Write, Slot::Write, Slot::Read];
        Self {
            module: module(context, shaders::CLASSIFY),
            layout: layout(context, "classify", wgpu::ShaderStages::COMPUTE, &slots),
        }
    }

    /// The visible voxels of a volume as splats, brick by brick, with normals where they are to be `lit`.
    pub(crate) fn run(
        &self,
        context: &Context,
        scan: &Scan,
        volume: &Volume,
        transfer: &TransferFunction,
        lit: bool,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Classified> {
        let coding = SampleCoding::new(volume, transfer);
        let constants = [("SAMPLE_TYPE", f64::from(coding.sample_type)), ("LIT", f64::from(u8::from(lit)))];
        let pipeline = |entry| compute(context, &self.module, "classify", entry, &self.layout, &constants);
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
        let gradients = volume.grid().to_lattice().matrix3.transpose();
        let gradient = |axis: usize| gradients.col(axis).as_vec3().to_array();
        let storage = wgpu::BufferUsages::STORAGE;
        let job = Job {
            context,
            scan,
            layout: &self.layout,
            count: pipeline("count"),
            emit: pipeline("emit"),
            lit,
            points: context.upload("classify.control_points", bytemuck::cast_slice(&points), storage)?,
            parameters: Classify {
                dims: volume.grid().dims(),
                bricks: 0,
                gradient_x: gradient(0),
                points: points.len() as u32,
                gradient_y: gradient(1),
                sample_origin: if coding.convert { 0.0 } else { coding.origin as f32 },
                gradient_z: gradient(2),
                _pad: 0,
            },
        };
        let mut batch = Batch::default();
        let mut chunks = Vec::new();
        let mut classified = Classified::default();
        let (slope, intercept) = volume.rescale();
        let shows = |[low, high]: [f64; 2]| {
            let [a, b] = [low, high].map(|raw| slope * raw + intercept);
            !transfer.is_clear([a.min(b), a.max(b)])
        };
        let total = volume.bricks().into_iter().product::<u32>();
        volume.for_each_brick(&shows, usize::from(lit), &coding, &mut |brick| {
            classified.bricks += 1;
            if let Some((origin, bytes)) = brick {
                classified.bricks_uploaded += 1;
                classified.bytes_uploaded += bytes.len() as u64;
                batch.origins.push([origin[0], origin[1], origin[2], 0]);
                batch.bytes.extend_from_slice(&bytes);
                if batch.origins.len() == BATCH {
                    chunks.extend(job.run(&std::mem::take(&mut batch))?);
                }
            }
            progress(f64::from(classified.bricks) / f64::from(total));
            Ok(())
        })?;
        if !batch.origins.is_empty() {
            chunks.extend(job.run(&batch)?);
        }
        classified.stores = gather(context, chunks)?;
        Ok(classified)
    }
}

/// Bricks that are classified together.
#[derive(Default)]
struct Batch {
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
    lit: bool,
    points: wgpu::Buffer,
    parameters: Classify,
}

impl Job<'_> {
    /// The visible voxels of a batch; `None` where there are none.
    fn run(&self, batch: &Batch) -> Result<Option<Store>> {
        let context = self.context;
        let storage = wgpu::BufferUsages::STORAGE;
        let runs = (batch.origins.len() * EDGE * EDGE) as u64;
        let parameters = Classify { bricks: batch.origins.len() as u32, ..self.parameters };
        let parameters =
            context.upload("classify.parameters", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
        let samples = context.upload("classify.samples", &batch.bytes, storage)?;
        let origins = context.upload("classify.origins", bytemuck::cast_slice(&batch.origins), storage)?;
        // One place more than runs: the scan leaves the total there.
        let places = context.buffer("classify.places", (runs + 1) * 4, storage | wgpu::BufferUsages::COPY_SRC)?;
        let none = context.buffer("classify.none", 16, storage)?;
        let bindings = |splats: &wgpu::Buffer, normals: &wgpu::Buffer| {
            let resources = [&parameters, &samples, &self.points, &places, splats, normals, &origins]
                .map(wgpu::Buffer::as_entire_binding);
            bind(context, "classify", self.layout, &resources)
        };
        let no_normals = context.buffer("classify.no_normals", 16, storage)?;
        let total_buffer =
            context.buffer("classify.total", 4, wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ)?;
        let (x, y) = context.workgroups(runs, WORKGROUP);
        let mut encoder = context.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("classify.count"),
                timestamp_writes: None,
            });
            pass.set_pipeline(&self.count);
            pass.set_bind_group(0, &bindings(&none, &no_normals), &[]);
            pass.dispatch_workgroups(x, y, 1);
            self.scan.record(context, &mut pass, &places, runs + 1)?;
        }
        encoder.copy_buffer_to_buffer(&places, runs * 4, &total_buffer, 0, 4);
        context.queue.submit([encoder.finish()]);
        let visible: u32 = bytemuck::pod_read_unaligned(&context.read("classifying the volume", &total_buffer)?[..4]);
        if visible == 0 {
            return Ok(None);
        }
        let usage = storage | wgpu::BufferUsages::COPY_SRC;
        let splats = context.buffer("classify.splats", u64::from(visible) * 16, usage)?;
        let normals =
            if self.lit { Some(context.buffer("classify.normals", u64::from(visible) * 4, usage)?) } else { None };
        let mut encoder = context.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("classify.emit"),
                timestamp_writes: None,
            });
            pass.set_pipeline(&self.emit);
            pass.set_bind_group(0, &bindings(&splats, normals.as_ref().unwrap_or(&no_normals)), &[]);
            pass.dispatch_workgroups(x, y, 1);
        }
        context.queue.submit([encoder.finish()]);
        // Waiting here keeps one batch of samples on the device, not all of them.
        context.wait("classifying the volume")?;
        Ok(Some(Store { splats, normals, count: visible }))
    }
}

/// Joins the splats of many batches into few buffers.
fn gather(context: &Context, chunks: Vec<Store>) -> Result<Vec<Store>> {
    let most = context.limits.max_storage_buffer_binding_size.min(context.limits.max_buffer_size) / 16;
    let most = u32::try_from(most).unwrap_or(u32::MAX).min(JOINED);
    let mut stores = Vec::new();
    let mut group: Vec<Store> = Vec::new();
    let mut held = 0_u32;
    for chunk in chunks {
        if !group.is_empty() && held.checked_add(chunk.count).is_none_or(|sum| sum > most) {
            stores.push(join(context, std::mem::take(&mut group), held)?);
            held = 0;
        }
        held += chunk.count;
        group.push(chunk);
    }
    if !group.is_empty() {
        stores.push(join(context, group, held)?);
    }
    Ok(stores)
}

fn join(context: &Context, mut group: Vec<Store>, count: u32) -> Result<Store> {
    if group.len() == 1 {
        return Ok(group.remove(0));
    }
    let splats: Vec<_> = group.iter().map(|s| (&s.splats, u64::from(s.count) * 16)).collect();
    let normals: Option<Vec<_>> =
        group.iter().map(|s| s.normals.as_ref().map(|normals| (normals, u64::from(s.count) * 4))).collect();
    let splats = concatenated(context, "classify.store", &splats)?;
    let normals = normals.map(|parts| concatenated(context, "classify.store_normals", &parts)).transpose()?;
    context.wait("classifying the volume")?;
    Ok(Store { splats, normals, count })
}

/// A buffer of the first bytes of others, as many of each as stated.
fn concatenated(context: &Context, label: &str, parts: &[(&wgpu::Buffer, u64)]) -> Result<wgpu::Buffer> {
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let whole = context.buffer(label, parts.iter().map(|(_, bytes)| bytes).sum(), usage)?;
    let mut encoder = context.device.create_command_encoder(&Default::default());
    let mut at = 0;
    for &(part, bytes) in parts {
        encoder.copy_buffer_to_buffer(part, 0, &whole, at, bytes);
        at += bytes;
    }
    context.queue.submit([encoder.finish()]);
    Ok(whole)
}
