//! The painter `quads`: each batch of sheets is one render pass of instanced quads that feed all of its sheets at once,
//! followed by compute passes that bring its sheets into the frame.

mod composite;
mod culling;
pub(crate) mod plan;
mod shade;
pub(crate) mod sort;
mod splat;
pub(crate) mod terminate;

pub(crate) use splat::footprint_texture;

use composite::Composite;
use plan::Target;
use shade::Shading;
use sort::Span;
use splat::{Sheets, Splatting};
use terminate::Terminator;

use super::context::Context;
use super::layout::{Area, Lighting};
use super::pipeline::both;
use super::timing::Timing;
use super::transfer::TransferTable;
use crate::error::Result;
use crate::settings::Precision;

/// What sheets hold, and what becomes of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Feed {
    /// Emission and optical depth, composited.
    Colors,
    /// Optical depth of the one sheet of an X-ray.
    Depth,
    /// Means of the scalar, classified and composited.
    Scalars,
    /// Means of the scalar, of which the largest is kept.
    Maximum,
}

/// What the pipelines are specialised for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct QuadsKey {
    pub(crate) feed: Feed,
    pub(crate) perspective: bool,
    /// Kernels grow.
    pub(crate) grown: bool,
    /// Sheets are voxel planes.
    pub(crate) axis: bool,
    /// Opacities are added.
    pub(crate) additive: bool,
    /// The number of lights, on splats or on sheets of scalars.
    pub(crate) lights: u32,
    /// Samples that a sheet of scalars is classified at.
    pub(crate) samples: u32,
    /// Opaque pixels hide splats.
    pub(crate) terminates: bool,
    pub(crate) precision: Precision,
    pub(crate) sheets_per_pass: u32,
    pub(crate) footprint_rows: u32,
    pub(crate) footprint_terms: u32,
}

impl QuadsKey {
    /// Bytes of a pixel in all sheets that are held.
    pub(crate) fn sheet_bytes(&self) -> u32 {
        self.sheets_per_pass * self.feed.sheet_bytes(self.precision) * self.batches_held()
    }

    /// Batches whose sheets are held at a time: shading looks back.
    fn batches_held(&self) -> u32 {
        if self.feed.is_scalar() { 2 } else { 1 }
    }

    /// Lights on splats.
    fn splat_lights(&self) -> u32 {
        if self.feed.is_scalar() { 0 } else { self.lights }
    }
}

impl Feed {
    /// Bytes of a pixel of one sheet.
    pub(crate) fn sheet_bytes(self, precision: Precision) -> u32 {
        let channel = match precision {
            Precision::F16 => 2,
            Precision::F32 => 4,
        };
        match self {
            Self::Colors => 4 * channel,
            Self::Depth | Self::Scalars | Self::Maximum => channel,
        }
    }

    /// Whether sheets hold scalars.
    pub(crate) fn is_scalar(self) -> bool {
        matches!(self, Self::Scalars | Self::Maximum)
    }
}

/// What all pictures of a scene with the same settings share on the device.
pub(crate) struct Inputs<'a> {
    pub(crate) footprint: &'a wgpu::TextureView,
    pub(crate) lighting: Lighting,
    /// What scalars are classified by.
    pub(crate) transfer: Option<&'a TransferTable>,
}

/// Brings batches of sheets into the frame, front to back.
trait IntoFrame {
    /// The batch that was splatted last, if it has splats.
    fn batch(&self, context: &Context, encoder: &mut wgpu::CommandEncoder, timing: &mut Timing, batch: u32);

    /// What is left after the last batch; then makes the frame a picture.
    fn resolve(&self, context: &Context, encoder: &mut wgpu::CommandEncoder, timing: &mut Timing);
}

/// Which stage brings sheets into the frame.
enum Consumer {
    Composite(Composite),
    Shading(Shading),
}

/// The pipelines of the painter.
pub(crate) struct Quads {
    key: QuadsKey,
    splatting: Splatting,
    terminator: Option<Terminator>,
    consumer: Consumer,
}

/// What was drawn.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Drawn {
    /// Splats in bricks in view.
    pub(crate) sorted: u64,
    /// Render passes, one per batch that is not empty.
    pub(crate) passes: u64,
    /// Quads, one per splat and batch.
    pub(crate) quads: u64,
    /// Of these, terminated early: hidden by what is before them.
    pub(crate) terminated: u64,
    /// Bricks found hidden as a whole on the way.
    pub(crate) hidden_bricks: u64,
}

impl Drawn {
    /// Adds what was drawn of another part of the picture.
    pub(crate) fn add(&mut self, other: Self) {
        self.sorted += other.sorted;
        self.passes += other.passes;
        self.quads += other.quads;
        self.terminated += other.terminated;
        self.hidden_bricks += other.hidden_bricks;
    }
}

impl Quads {
    pub(crate) fn new(context: &Context, key: QuadsKey) -> Result<Self> {
        let consumer = || match key.feed.is_scalar() {
            true => Consumer::Shading(Shading::new(context, key)),
            false => Consumer::Composite(Composite::new(context, key)),
        };
        let rest = || (key.terminates.then(|| Terminator::new(context, key)), consumer());
        let (splatting, (terminator, consumer)) = both(context, || Splatting::new(context, key), rest)?;
        Ok(Self { key, splatting, terminator, consumer })
    }

    pub(crate) fn sheets_per_pass(&self) -> u32 {
        self.key.sheets_per_pass
    }

    /// Draws the spans' splats, those of each batch within its area of `covered`. Returns the region, with the margin around
    /// it, as premultiplied RGBA.
    pub(crate) fn run(
        &self,
        context: &Context,
        timing: &mut Timing,
        target: Target<'_>,
        inputs: &Inputs<'_>,
        spans: &[Span<'_>],
        covered: &[Area],
    ) -> Result<(Vec<[f32; 4]>, Drawn)> {
        let mut drawn = Drawn { sorted: spans.iter().map(|s| u64::from(s.sorted)).sum(), ..Drawn::default() };
        let [width, height] = target.extent();
        let batches = target.plan.sheets().div_ceil(self.key.sheets_per_pass);
        let bytes = u64::from(width) * u64::from(height) * 16;
        let pixels =
            context.buffer("composite.pixels", bytes, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC)?;
        let sheets: Vec<_> =
            (0..self.key.batches_held()).map(|_| Sheets::new(context, self.key, [width, height])).collect();
        let quads_of = |batch: u32| spans.iter().map(|s| s.batch(batch).len() as u64).sum::<u64>();
        let splats = self.splatting.bind(context, target, inputs, spans, batches)?;
        let termination =
            self.terminator.as_ref().map(|t| t.bind(context, target, &pixels, spans, batches)).transpose()?;
        let reached: Vec<Area> = (0..batches)
            .zip(covered)
            .map(|(batch, area)| if quads_of(batch) > 0 { *area } else { Area::default() })
            .collect();
        let into_frame = match &self.consumer {
            Consumer::Composite(stage) => stage.bind(context, target, &sheets[0], &pixels, &reached)?,
            Consumer::Shading(stage) => stage.bind(context, target, inputs, &sheets, &pixels, &reached)?,
        };
        let mut encoder = context.device.create_command_encoder(&Default::default());
        for batch in 0..batches {
            let quads = quads_of(batch);
            if quads > 0 {
                if let Some(termination) = &termination
                    && drawn.passes > 0
                {
                    termination.record(context, &mut encoder, timing, spans, batch);
                }
                drawn.passes += 1;
                drawn.quads += quads;
                let sheets = &sheets[(batch % self.key.batches_held()) as usize];
                let area = reached[batch as usize];
                splats.record(context, &mut encoder, timing, sheets, spans, (batch, area));
            }
            into_frame.batch(context, &mut encoder, timing, batch);
        }
        into_frame.resolve(context, &mut encoder, timing);
        let staging =
            context.buffer("resolve.staging", bytes, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)?;
        encoder.copy_buffer_to_buffer(&pixels, 0, &staging, 0, bytes);
        let tally = termination.as_ref().map(|t| t.tally(context, &mut encoder)).transpose()?;
        context.queue.submit([encoder.finish()]);
        let data = context.read("splatting", &staging)?;
        if let Some(tally) = tally {
            [drawn.terminated, drawn.hidden_bricks] = Terminator::terminated(context, &tally)?;
        }
        let rgba = data[..bytes as usize].chunks_exact(16).map(bytemuck::pod_read_unaligned).collect();
        Ok((rgba, drawn))
    }
}

/// Parameters of many draws or dispatches in one uniform buffer, each at an offset that can be bound.
struct Slots {
    buffer: wgpu::Buffer,
    stride: u32,
    size: u64,
}

impl Slots {
    fn new<T: bytemuck::Pod>(context: &Context, label: &str, parameters: &[T]) -> Result<Self> {
        let size = size_of::<T>().next_multiple_of(16);
        let stride = size.next_multiple_of(context.limits.min_uniform_buffer_offset_alignment.max(16) as usize);
        let mut bytes = vec![0_u8; stride * parameters.len().max(1)];
        for (slot, parameters) in bytes.chunks_exact_mut(stride).zip(parameters) {
            slot[..size_of::<T>()].copy_from_slice(bytemuck::bytes_of(parameters));
        }
        let buffer = context.upload(label, &bytes, wgpu::BufferUsages::UNIFORM)?;
        Ok(Self { buffer, stride: stride as u32, size: size as u64 })
    }

    fn binding(&self) -> wgpu::BindingResource<'_> {
        super::pipeline::part(&self.buffer, 0, self.size)
    }

    fn offset(&self, index: u32) -> u32 {
        index * self.stride
    }
}
