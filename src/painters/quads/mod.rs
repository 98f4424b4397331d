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

use composite::Consumer;
use plan::Target;
use sort::{Sorter, Span};
use splat::{SheetTextures, Splatting};
use terminate::Terminator;

use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::{Area, Lighting};
use crate::gpu::light_volume::PostShading;
use crate::gpu::pipeline::both;
use crate::gpu::recorder::Recorder;
use crate::gpu::stage::Constant;
use crate::settings::Precision;

/// The contents of sheets, and their use.
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
    /// Means of the scalar; one scalar of each ray is classified, the largest or the mean.
    Projection,
}

/// The specialisation of the pipelines.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct QuadsKey {
    feed: Feed,
    precision: Precision,
    sheets_per_pass: u32,
    /// Opaque pixels hide splats.
    terminates: bool,
    /// Override constants of all shaders.
    constants: Vec<Constant>,
}

impl QuadsKey {
    /// Bytes of a pixel in all sheets that are held.
    fn sheet_bytes(&self) -> u32 {
        self.layers() * self.feed.texel_bytes(self.precision) * self.batches_held()
    }

    /// Batches whose sheets are held at a time: shading looks back.
    fn batches_held(&self) -> u32 {
        if self.feed.is_scalar() { 2 } else { 1 }
    }

    /// Layers of a batch.
    fn layers(&self) -> u32 {
        self.sheets_per_pass / self.feed.sheets_per_layer()
    }
}

impl Feed {
    /// The format of a layer of sheets.
    fn format(self, precision: Precision) -> wgpu::TextureFormat {
        match (self, precision) {
            (Self::Depth, Precision::F16) => wgpu::TextureFormat::R16Float,
            (Self::Depth, Precision::F32) => wgpu::TextureFormat::R32Float,
            (_, Precision::F16) => wgpu::TextureFormat::Rgba16Float,
            (_, Precision::F32) => wgpu::TextureFormat::Rgba32Float,
        }
    }

    /// Bytes of a pixel of a layer.
    fn texel_bytes(self, precision: Precision) -> u32 {
        self.format(precision).block_copy_size(None).unwrap_or(16)
    }

    /// Whether sheets hold scalars.
    fn is_scalar(self) -> bool {
        matches!(self, Self::Scalars | Self::LitScalars | Self::Projection)
    }

    /// Sheets that share a layer, a channel each.
    fn sheets_per_layer(self) -> u32 {
        if matches!(self, Self::Scalars | Self::Projection) { 4 } else { 1 }
    }

    /// How many sheets a batch may have. Shading looks at the last three of the batch before.
    fn batch_sizes(self) -> &'static [u32] {
        if self.is_scalar() { &[8, 4] } else { &[8, 4, 1] }
    }
}

/// The inputs that all regions of a picture share.
struct Inputs<'a> {
    footprint: &'a wgpu::TextureView,
    lighting: Lighting,
    /// The tables that classify and light scalars.
    post: Option<&'a PostShading>,
    /// The depths of the solids in the pixels of the region.
    solids: &'a wgpu::Buffer,
}

/// The pipelines of the painter.
pub(crate) struct Quads {
    key: QuadsKey,
    sorter: Sorter,
    splatting: Splatting,
    terminator: Option<Terminator>,
    consumer: Consumer,
}

/// Counts of a picture.
#[derive(Debug, Clone, Copy, Default)]
struct Drawn {
    /// Splats in bricks in view.
    sorted: u64,
    /// Render passes, one per batch that is not empty.
    passes: u64,
    /// Quads, one per splat and batch.
    quads: u64,
    /// Quads that were not drawn because opaque pixels hide them.
    terminated: u64,
}

impl Quads {
    fn new(context: &Context, key: &QuadsKey) -> Result<Self> {
        let rest = || {
            let terminator = key.terminates.then(|| Terminator::new(context, &key.constants));
            (Sorter::new(context, &key.constants), terminator, Consumer::new(context, key))
        };
        let (splatting, (sorter, terminator, consumer)) = both(context, || Splatting::new(context, key), rest)?;
        Ok(Self { key: key.clone(), sorter, splatting, terminator, consumer })
    }

    /// Records the drawing of the spans' splats, each batch within its area of `covered`, and adds to the counts.
    /// Returns the pixels, premultiplied RGBA in f32.
    fn draw(
        &self,
        recorder: &mut Recorder<'_>,
        target: Target<'_>,
        inputs: &Inputs<'_>,
        spans: &[Span<'_>],
        covered: &[Area],
        drawn: &mut Drawn,
    ) -> Result<wgpu::Buffer> {
        let context = recorder.context;
        drawn.sorted += spans.iter().map(|s| u64::from(s.sorted)).sum::<u64>();
        let extent = target.extent();
        let batches = target.plan.sheets.div_ceil(self.key.sheets_per_pass);
        let pixels = context.pixels("composite.pixels", extent)?;
        let sheets: Vec<_> =
            (0..self.key.batches_held()).map(|_| SheetTextures::new(context, &self.key, extent)).collect();
        let quads_of = |batch: u32| spans.iter().map(|s| s.batch(batch).len() as u64).sum::<u64>();
        let splats = self.splatting.bind(context, target, inputs, spans, batches)?;
        let termination =
            self.terminator.as_ref().map(|t| t.bind(context, target, &pixels, spans, batches)).transpose()?;
        let reached = (0..batches).zip(covered);
        let reached: Vec<Area> =
            reached.map(|(batch, area)| if quads_of(batch) > 0 { *area } else { Area::default() }).collect();
        let consumer = self.consumer.bind(context, target, inputs, &sheets, &pixels, &reached)?;
        let mut is_first = true;
        for batch in 0..batches {
            let quads = quads_of(batch);
            if quads > 0 {
                if let Some(termination) = termination.as_ref().filter(|_| !is_first) {
                    termination.record(recorder, spans, batch);
                }
                is_first = false;
                drawn.passes += 1;
                drawn.quads += quads;
                let sheets = &sheets[(batch % self.key.batches_held()) as usize];
                splats.record(recorder, sheets, spans, batch, reached[batch as usize]);
            }
            consumer.batch(recorder, batch);
        }
        consumer.resolve(recorder, batches);
        if let Some(termination) = termination {
            drawn.terminated += termination.marked(recorder)?;
        }
        Ok(pixels)
    }
}
