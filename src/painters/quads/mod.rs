//! The painter `quads`: each batch of sheets is one render pass of instanced quads that feed all of its sheets at once,
//! followed by compute passes that bring its sheets into the frame.

mod composite;
mod culling;
mod frustum;
mod paint;
pub(crate) mod plan;
mod shade;
pub(crate) mod sort;
mod splat;
pub(crate) mod terminate;

pub(crate) use paint::ROOM;

use composite::{CompositeStage, Compositing};
use plan::Target;
use shade::{ShadeStage, Shaded};
use sort::Span;
use splat::{SheetTextures, Splatting};
use terminate::Terminator;

use crate::error::{Error, Result};
use crate::gpu::context::Context;
use crate::gpu::layout::{Area, Lighting};
use crate::gpu::light_volume::PostShading;
use crate::gpu::pipeline::{both, buffer_range};
use crate::gpu::recorder::{Readback, Recorder};
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
    /// Means of the scalar and of its gradient, classified, lit and composited.
    LitScalars,
    /// Means of the scalar, of which the largest is kept.
    Maximum,
    /// Means of the scalar, whose mean is kept.
    Mean,
}

/// What the pipelines are specialised for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct QuadsKey {
    pub(crate) feed: Feed,
    /// RESPONSE in shaders/common/response.wgsl.
    pub(crate) response: u32,
    /// Colours are those of depth.
    pub(crate) depth_coded: bool,
    /// A maximum is attenuated by its depth.
    pub(crate) attenuated: bool,
    pub(crate) perspective: bool,
    /// Kernels grow.
    pub(crate) grown: bool,
    /// SheetTextures are voxel planes.
    pub(crate) axis: bool,
    /// Opacities are added.
    pub(crate) additive: bool,
    /// The number of lights, on splats or on sheets of scalars.
    pub(crate) lights: u32,
    /// Some light is at a place.
    pub(crate) point_lights: bool,
    /// Light is kept from splats.
    pub(crate) shadows: bool,
    /// Pieces in which a sheet of scalars is classified.
    pub(crate) samples: u32,
    /// See [`TransferTable`].
    pub(crate) crowded: bool,
    pub(crate) thins: bool,
    /// Light is kept from scalars.
    pub(crate) post_shadows: bool,
    /// Planes that cut rays.
    pub(crate) clip_planes: u32,
    /// Opaque pixels hide splats.
    pub(crate) terminates: bool,
    pub(crate) precision: Precision,
    pub(crate) sheets_per_pass: u32,
    pub(crate) footprint_rows: u32,
    pub(crate) footprint_terms: u32,
}

impl QuadsKey {
    /// Bytes of a pixel in all sheets that are held.
    fn sheet_bytes(&self) -> u32 {
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
    fn sheet_bytes(self, precision: Precision) -> u32 {
        let channel = match precision {
            Precision::F16 => 2,
            Precision::F32 => 4,
        };
        match self {
            Self::Colors | Self::LitScalars => 4 * channel,
            Self::Depth | Self::Scalars | Self::Maximum | Self::Mean => channel,
        }
    }

    /// Whether sheets hold scalars.
    fn is_scalar(self) -> bool {
        matches!(self, Self::Scalars | Self::LitScalars | Self::Maximum | Self::Mean)
    }

    /// Whether one scalar of a ray is classified: then all of the ray counts, what shows nothing too.
    fn projects(self) -> bool {
        matches!(self, Self::Maximum | Self::Mean)
    }

    /// Sheets that share an attachment.
    fn sheets_per_attachment(self) -> u32 {
        match self {
            Self::Scalars | Self::Maximum | Self::Mean => 4,
            Self::Colors | Self::LitScalars | Self::Depth => 1,
        }
    }

    /// How many sheets a batch may have. Shading looks at the last three of the batch before.
    fn batch_sizes(self) -> &'static [u32] {
        match self {
            Self::Colors | Self::Depth => &[8, 4, 1],
            Self::Scalars | Self::LitScalars | Self::Maximum | Self::Mean => &[8, 4],
        }
    }
}

/// What all regions of a picture share on the device.
struct Inputs<'a> {
    footprint: &'a wgpu::TextureView,
    lighting: Lighting,
    /// What scalars are classified and lit by.
    post: Option<&'a PostShading>,
}

/// What sheets are brought into.
#[derive(Clone, Copy)]
struct Frame<'a> {
    /// Colour and optical depth of each pixel.
    pixels: &'a wgpu::Buffer,
    /// The pixels of each batch; none if it has no splats.
    reached: &'a [Area],
}

/// The stage that brings sheets into the frame.
enum Consumer {
    Composite(CompositeStage),
    Shading(ShadeStage),
}

/// That stage bound to what a region is made of.
enum Bound<'a> {
    Composite(Compositing<'a>),
    Shading(Shaded<'a>),
}

impl Bound<'_> {
    /// Takes the batch that was splatted last, if it has splats.
    fn batch(&self, recorder: &mut Recorder<'_>, batch: u32) {
        match self {
            Self::Composite(stage) => stage.batch(recorder, batch),
            Self::Shading(stage) => stage.batch(recorder, batch),
        }
    }

    /// Takes what is left after the last batch, then makes the frame a picture.
    fn resolve(&self, recorder: &mut Recorder<'_>) {
        match self {
            Self::Composite(stage) => stage.resolve(recorder),
            Self::Shading(stage) => stage.resolve(recorder),
        }
    }
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
struct Drawn {
    /// Splats in bricks in view.
    sorted: u64,
    /// Render passes, one per batch that is not empty.
    passes: u64,
    /// Quads, one per splat and batch.
    quads: u64,
    /// Quads that were not drawn: hidden by what is before them.
    terminated: u64,
}

/// A region drawn.
struct DrawnRegion {
    /// Premultiplied RGBA, f32.
    pixels: wgpu::Buffer,
    drawn: Drawn,
    /// What tells the number of terminated quads.
    tally: Option<Readback>,
}

impl Quads {
    fn new(context: &Context, key: QuadsKey) -> Result<Self> {
        let consumer = || match key.feed.is_scalar() {
            true => Consumer::Shading(ShadeStage::new(context, key)),
            false => Consumer::Composite(CompositeStage::new(context, key)),
        };
        let rest = || (key.terminates.then(|| Terminator::new(context, key)), consumer());
        let (splatting, (terminator, consumer)) = both(context, || Splatting::new(context, key), rest)?;
        Ok(Self { key, splatting, terminator, consumer })
    }

    /// Records the drawing of the spans' splats, those of each batch within its area of `covered`.
    fn draw(
        &self,
        recorder: &mut Recorder<'_>,
        target: Target<'_>,
        inputs: &Inputs<'_>,
        spans: &[Span<'_>],
        covered: &[Area],
    ) -> Result<DrawnRegion> {
        let context = recorder.context;
        let mut drawn = Drawn { sorted: spans.iter().map(|s| u64::from(s.sorted)).sum(), ..Drawn::default() };
        let [width, height] = target.extent();
        let batches = target.plan.sheets().div_ceil(self.key.sheets_per_pass);
        let pixels = context.pixels("composite.pixels", [width, height])?;
        let sheets: Vec<_> =
            (0..self.key.batches_held()).map(|_| SheetTextures::new(context, self.key, [width, height])).collect();
        let quads_of = |batch: u32| spans.iter().map(|s| s.batch(batch).len() as u64).sum::<u64>();
        let splats = self.splatting.bind(context, target, inputs, spans, batches)?;
        let termination =
            self.terminator.as_ref().map(|t| t.bind(context, target, &pixels, spans, batches)).transpose()?;
        let reached: Vec<Area> = (0..batches)
            .zip(covered)
            .map(|(batch, area)| if quads_of(batch) > 0 { *area } else { Area::default() })
            .collect();
        let consumer = self.bind(context, target, inputs, &sheets, Frame { pixels: &pixels, reached: &reached })?;
        for batch in 0..batches {
            let quads = quads_of(batch);
            if quads > 0 {
                if let Some(termination) = &termination
                    && drawn.passes > 0
                {
                    termination.record(recorder, spans, batch);
                }
                drawn.passes += 1;
                drawn.quads += quads;
                let sheets = &sheets[(batch % self.key.batches_held()) as usize];
                splats.record(recorder, sheets, spans, batch, reached[batch as usize]);
            }
            consumer.batch(recorder, batch);
        }
        consumer.resolve(recorder);
        let tally = termination.as_ref().map(|t| t.tally(recorder)).transpose()?;
        Ok(DrawnRegion { pixels, drawn, tally })
    }

    fn bind(
        &self,
        context: &Context,
        target: Target<'_>,
        inputs: &Inputs<'_>,
        sheets: &[SheetTextures],
        frame: Frame<'_>,
    ) -> Result<Bound<'_>> {
        match (&self.consumer, inputs.post) {
            (Consumer::Composite(stage), _) => Ok(Bound::Composite(stage.bind(context, target, &sheets[0], frame)?)),
            (Consumer::Shading(stage), Some(table)) => {
                Ok(Bound::Shading(stage.bind(context, target, inputs, table, sheets, frame)?))
            }
            (Consumer::Shading(_), None) => Err(Error::Device {
                stage: "shade".to_owned(),
                reason: "the scene has no transfer function to classify scalars by".to_owned(),
            }),
        }
    }
}

/// Parameters of many draws or dispatches in one uniform buffer, each at an offset that can be bound.
struct DynamicUniforms {
    buffer: wgpu::Buffer,
    stride: u32,
    size: u64,
}

impl DynamicUniforms {
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
        buffer_range(&self.buffer, 0, self.size)
    }

    fn offset(&self, index: u32) -> u32 {
        index * self.stride
    }
}
