//! The painter `quads`: each batch of sheets is one render pass of instanced quads that feed all of its sheets at once,
//! followed by compute passes that bring its sheets into the frame.
//!
//! # Sheets
//!
//! Sheets are parallel to the image, and `sheet_thickness` voxels thick along the central ray. They are thinner for
//! oblique rays of a wide field of view and for post-shaded narrow kernels (`thickness` in `plan.rs`). A *batch* is the
//! sheets that one pass feeds. Splats are sorted by batch, so a batch is one range of instances. The planes between
//! sheets cut each kernel, and each fragment adds the section of the kernel in each sheet, as optical depth. The depths
//! of all sheets add up to the depth of whole footprints: alpha is exact for every thickness. The error of colours
//! comes from the order of matter within a sheet, and falls as the square of the thickness.
//!
//! # Stages
//!
//! - `sort` (`sort.rs`) sorts splats by batch of sheets: a stable counting sort without atomics.
//! - `terminate` (`terminate.rs`) finds opaque tiles of the frame, and the splats of a batch that these tiles hide.
//! - `splat` (`splat.rs`) draws instanced quads: a fragment adds the sections of its kernel to all sheets of the batch.
//! - `composite` (`composite.rs`) composites the sheets of a batch into the frame, front to back.
//! - `shade` (`composite.rs`, its steps in `shade.rs`) is for post-shading: it classifies, lights and composites sheets
//!   of scalars, or keeps their maximum or sum.
//! - `resolve` (`composite.rs`) turns the frame into premultiplied RGBA.
//!
//! Bricks of splats outside the view are neither sorted nor drawn (`culling.rs`).
//!
//! # Footprints
//!
//! The footprint table (`kernel/footprint.rs`) holds the running line integral t (a_0 + a_1 q + a_2 q^2 + ...) with q =
//! 1 - t^2/c^2, where c is half the chord of the ray in the kernel's ball: rows of coefficients over c^2/R^2. The
//! factor t and the clamp of t to c contain the singularity; the rest is analytic. 256 rows of 8 coefficients (8 KiB)
//! err by 5e-6 of the footprint's peak. Rays are evaluated in lattice coordinates, so one table serves both projections
//! and every grid.
//!
//! # Post-shading
//!
//! Splats add means of the scalar over sheets and, if there is light, gradients: smoothed central differences of the
//! samples, the same for both painters. A sheet is classified along the parabola through its mean and the means of its
//! neighbours, so shading is one sheet behind splatting.
//!
//! # Precision
//!
//! - Sheets are f32 if the adapter blends f32. Half floats lose 3e-4 of alpha if sums are rounded to the nearest, and
//!   up to 4e-3 if they are truncated (docs/measurements/2026-11-21-accuracy.md). Vulkan permits both; Mesa's software
//!   rasteriser truncates, and Mesa's drivers configure AMD's GPUs to truncate. Sheets of half floats are at most 4
//!   voxels thick, also in an X-ray.
//! - Sheets hold optical depth times a power of two such that a sheet of the densest material holds about 256: f16
//!   neither overflows nor underflows, whatever the units.
//! - Depths are measured from the middle of the lattice, and places in the image from the *home ray*, the ray of the
//!   picture nearest to that middle. So neither a distant eye nor a volume far off the axis causes cancellation.
//! - A quad is 3/64 pixel larger than its kernel on every side, because Vulkan lets rasterisers snap corners to 1/16
//!   pixel.

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
    /// Emission and optical depth, to be composited.
    Colors,
    /// Optical depth in the one sheet of an X-ray.
    Depth,
    /// Means of the scalar, to be classified and composited.
    Scalars,
    /// Means of the scalar and of its gradient, to be classified, lit and composited.
    LitScalars,
    /// Means of the scalar; one scalar of each ray is classified, the largest or the mean.
    Projection,
}

/// The key of the painter's pipelines: their specialisation.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct QuadsKey {
    feed: Feed,
    precision: Precision,
    sheets_per_pass: u32,
    /// Whether opaque pixels hide splats.
    terminates: bool,
    /// The override constants of all shaders.
    constants: Vec<Constant>,
}

impl QuadsKey {
    /// Returns the bytes of a pixel in all sheets that are held.
    fn sheet_bytes(&self) -> u32 {
        self.layers() * self.feed.texel_bytes(self.precision) * self.batches_held()
    }

    /// Returns the number of batches whose sheets are held at a time: shading looks back.
    fn batches_held(&self) -> u32 {
        if self.feed.is_scalar() { 2 } else { 1 }
    }

    /// Returns the number of layers of a batch.
    fn layers(&self) -> u32 {
        self.sheets_per_pass / self.feed.sheets_per_layer()
    }
}

impl Feed {
    /// Returns the format of a layer of sheets.
    fn format(self, precision: Precision) -> wgpu::TextureFormat {
        match (self, precision) {
            (Self::Depth, Precision::F16) => wgpu::TextureFormat::R16Float,
            (Self::Depth, Precision::F32) => wgpu::TextureFormat::R32Float,
            (_, Precision::F16) => wgpu::TextureFormat::Rgba16Float,
            (_, Precision::F32) => wgpu::TextureFormat::Rgba32Float,
        }
    }

    /// Returns the bytes of a pixel of a layer.
    fn texel_bytes(self, precision: Precision) -> u32 {
        self.format(precision).block_copy_size(None).unwrap_or(16)
    }

    /// Returns whether sheets hold scalars.
    fn is_scalar(self) -> bool {
        matches!(self, Self::Scalars | Self::LitScalars | Self::Projection)
    }

    /// Returns the number of sheets that share a layer, a channel each.
    fn sheets_per_layer(self) -> u32 {
        if matches!(self, Self::Scalars | Self::Projection) { 4 } else { 1 }
    }

    /// Returns the possible numbers of sheets of a batch. Shading looks at the last three of the batch before.
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

/// The pipelines of the painter `quads`.
pub(crate) struct Quads {
    key: QuadsKey,
    sorter: Sorter,
    splatting: Splatting,
    terminator: Option<Terminator>,
    consumer: Consumer,
}

/// The counts of a picture for its statistics.
#[derive(Debug, Clone, Copy, Default)]
struct QuadCounts {
    /// Number of splats in bricks in view.
    sorted: u64,
    /// Number of render passes, one per batch that is not empty.
    passes: u64,
    /// Number of quads, one per splat and batch.
    quads: u64,
    /// Number of quads that were not drawn because opaque pixels hide them.
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
        drawn: &mut QuadCounts,
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
