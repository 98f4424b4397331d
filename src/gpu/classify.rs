//! classify: a volume and a transfer function to a list of splats.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

use super::context::Context;
use super::layout::{Classify, ControlPoint};
use super::pipeline::{Slot, bind, compute, layout, module};
use super::scan::{Scan, WORKGROUP};
use super::shaders;
use crate::error::Result;
use crate::transfer::TransferFunction;
use crate::volume::{Samples, ToF64, Volume, with_samples};

/// Voxels that one invocation classifies; RUN in shaders/classify.wgsl.
pub(super) const RUN: u64 = 32;
/// Voxels of one chunk: the memory that preparing a scene takes besides its splats, and far within every limit.
const CHUNK: usize = 1 << 22;

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
        let sample_type = match volume.samples() {
            // A falling map would turn the control points round, and with them the side on which a step belongs.
            _ if slope < 0.0 => None,
            Samples::U8(_) => Some(0),
            Samples::I8(_) => Some(1),
            Samples::U16(_) => Some(2),
            Samples::I16(_) => Some(3),
            Samples::F32(_) => Some(4),
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

    /// Bytes of the samples `range`, as the shader reads them.
    fn bytes<'a>(&self, samples: &'a Samples, range: Range<usize>) -> Cow<'a, [u8]> {
        fn converted<T: ToF64>(coding: &SampleCoding, samples: &[T]) -> Vec<u8> {
            let values: Vec<f32> = samples
                .par_iter()
                .map(|s| ((coding.slope * s.to_f64() + coding.intercept) - coding.origin) as f32)
                .collect();
            bytemuck::cast_slice(&values).to_vec()
        }
        if self.convert {
            Cow::Owned(with_samples!(samples, s => converted(self, &s[range])))
        } else {
            Cow::Borrowed(with_samples!(samples, s => bytemuck::cast_slice(&s[range])))
        }
    }
}

/// What of the samples a chunk is uploaded with, and where in it: see `Classify` in shaders/classify.wgsl.
struct Neighbours {
    ranges: Vec<Range<usize>>,
    before: u32,
    below: u32,
    above: u32,
}

impl Neighbours {
    /// The chunk alone.
    fn none(chunk: Range<usize>) -> Self {
        Self { ranges: vec![chunk], before: 0, below: 0, above: 0 }
    }

    /// The chunk and every neighbour of its voxels, in a volume of `total` samples with `row` in a row and `plane` in a
    /// plane.
    fn new(chunk: Range<usize>, total: usize, row: usize, plane: usize) -> Self {
        let beside = chunk.start.saturating_sub(row)..(chunk.end + row).min(total);
        let below = chunk.start.saturating_sub(plane)..chunk.end.saturating_sub(plane);
        let above = (chunk.start + plane).min(total)..(chunk.end + plane).min(total);
        // Of the chunk's first voxel, which need not have such neighbours itself: indices wrap.
        let index = |offset: usize, neighbour: i64, start: usize| (offset as i64 + neighbour - start as i64) as u32;
        Self {
            before: (chunk.start - beside.start) as u32,
            below: index(beside.len(), chunk.start as i64 - plane as i64, below.start),
            above: index(beside.len() + below.len(), (chunk.start + plane) as i64, above.start),
            ranges: vec![beside, below, above],
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
        let slots = [Slot::Uniform, Slot::Read, Slot::Read, Slot::Write, Slot::Write, Slot::Write];
        Self {
            module: module(context, shaders::CLASSIFY),
            layout: layout(context, "classify", wgpu::ShaderStages::COMPUTE, &slots),
        }
    }

    /// The visible voxels of a volume as splats in lattice order, with normals where they are to be `lit`.
    pub(crate) fn run(
        &self,
        context: &Context,
        scan: &Scan,
        volume: &Volume,
        transfer: &TransferFunction,
        lit: bool,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Vec<Store>> {
        let coding = SampleCoding::new(volume, transfer);
        let constants = [("SAMPLE_TYPE", f64::from(coding.sample_type)), ("LIT", f64::from(u8::from(lit)))];
        let pipeline = |entry| compute(context, &self.module, "classify", entry, &self.layout, &constants);
        let (count_pipeline, emit_pipeline) = (pipeline("count"), pipeline("emit"));
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
        let points_buffer =
            context.upload("classify.control_points", bytemuck::cast_slice(&points), wgpu::BufferUsages::STORAGE)?;

        let total = volume.samples().len();
        let [nx, ny, _] = volume.grid().dims().map(|d| d as usize);
        let gradients = volume.grid().to_lattice().matrix3.transpose();
        let gradient = |axis: usize| gradients.col(axis).as_vec3().to_array();
        let storage = wgpu::BufferUsages::STORAGE;
        let mut chunks = Vec::new();
        for first in (0..total).step_by(CHUNK) {
            let count = CHUNK.min(total - first);
            let runs = (count as u64).div_ceil(RUN);
            let neighbours = if lit {
                Neighbours::new(first..first + count, total, nx, nx * ny)
            } else {
                Neighbours::none(first..first + count)
            };
            let parameters = Classify {
                dims: volume.grid().dims(),
                count: count as u32,
                start: [first % nx, first / nx % ny, first / (nx * ny)].map(|v| v as u32),
                points: points.len() as u32,
                sample_origin: if coding.convert { 0.0 } else { coding.origin as f32 },
                base: 0,
                before: neighbours.before,
                below: neighbours.below,
                gradient_x: gradient(0),
                above: neighbours.above,
                gradient_y: gradient(1),
                _pad_y: 0,
                gradient_z: gradient(2),
                _pad_z: 0,
            };
            let parameters =
                context.upload("classify.parameters", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
            let bytes = match neighbours.ranges.as_slice() {
                [range] => coding.bytes(volume.samples(), range.clone()),
                ranges => {
                    let parts: Vec<_> = ranges.iter().map(|r| coding.bytes(volume.samples(), r.clone())).collect();
                    Cow::Owned(parts.concat())
                }
            };
            let samples = context.upload("classify.samples", &bytes, storage)?;
            // One place more than runs: the scan leaves the total there.
            let places = context.buffer("classify.places", (runs + 1) * 4, storage | wgpu::BufferUsages::COPY_SRC)?;
            let bindings = |splats: &wgpu::Buffer, normals: &wgpu::Buffer| {
                bind(
                    context,
                    "classify",
                    &self.layout,
                    &[
                        parameters.as_entire_binding(),
                        samples.as_entire_binding(),
                        points_buffer.as_entire_binding(),
                        places.as_entire_binding(),
                        splats.as_entire_binding(),
                        normals.as_entire_binding(),
                    ],
                )
            };
            let none = context.buffer("classify.no_splats", 16, storage)?;
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
                pass.set_pipeline(&count_pipeline);
                pass.set_bind_group(0, &bindings(&none, &no_normals), &[]);
                pass.dispatch_workgroups(x, y, 1);
                scan.record(context, &mut pass, &places, runs + 1)?;
            }
            encoder.copy_buffer_to_buffer(&places, runs * 4, &total_buffer, 0, 4);
            context.queue.submit([encoder.finish()]);
            let visible: u32 =
                bytemuck::pod_read_unaligned(&context.read("classifying the volume", &total_buffer)?[..4]);
            if visible > 0 {
                let splats = context.buffer(
                    "classify.splats",
                    u64::from(visible) * 16,
                    storage | wgpu::BufferUsages::COPY_SRC,
                )?;
                let normals = if lit {
                    let usage = storage | wgpu::BufferUsages::COPY_SRC;
                    Some(context.buffer("classify.normals", u64::from(visible) * 4, usage)?)
                } else {
                    None
                };
                let mut encoder = context.device.create_command_encoder(&Default::default());
                {
                    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                        label: Some("classify.emit"),
                        timestamp_writes: None,
                    });
                    pass.set_pipeline(&emit_pipeline);
                    pass.set_bind_group(0, &bindings(&splats, normals.as_ref().unwrap_or(&no_normals)), &[]);
                    pass.dispatch_workgroups(x, y, 1);
                }
                context.queue.submit([encoder.finish()]);
                // Waiting here keeps one chunk of samples on the device, not all of them.
                context.wait("classifying the volume")?;
                chunks.push(Store { splats, normals, count: visible });
            }
            progress((first + count) as f64 / total as f64);
        }
        gather(context, chunks)
    }
}

/// Joins the splats of many chunks into as few buffers as storage bindings allow.
fn gather(context: &Context, chunks: Vec<Store>) -> Result<Vec<Store>> {
    let most = context.limits.max_storage_buffer_binding_size.min(context.limits.max_buffer_size) / 16;
    let most = u32::try_from(most).unwrap_or(u32::MAX);
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
