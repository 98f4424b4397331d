//! splat: quads into the sheets of a batch.

use std::ops::Range;

use super::plan::Target;
use super::sort::Span;
use super::{Feed, Inputs, QuadsKey};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::Area;
use crate::gpu::pipeline::Binding::{DynamicUniform, Read, ReadTexture, Uniform};
use crate::gpu::pipeline::{Render, bind, layout, module, texture_view};
use crate::gpu::recorder::{Recorder, max_work};
use crate::gpu::shaders;
use crate::gpu::stage::{DynamicUniforms, declared};
use crate::kernel::FootprintTable;

/// The render pipelines that feed sheets and clear them.
pub(super) struct Splatting {
    sheets_per_pass: u32,
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
    /// The pipeline that clears parts of sheets; not of scalars, which shading reads beyond these parts.
    wipe: Option<wgpu::RenderPipeline>,
}

/// The sheets of a batch, as layers of a texture.
pub(super) struct SheetTextures {
    targets: Vec<wgpu::TextureView>,
    /// The view of all layers.
    pub(super) all: wgpu::TextureView,
}

/// The stage that splats, bound to a region.
pub(super) struct RegionSplatting<'a> {
    stage: &'a Splatting,
    extent: [u32; 2],
    batches: DynamicUniforms,
    groups: Vec<wgpu::BindGroup>,
    /// The largest number of pixels that a quad covers.
    quad_pixels: u64,
}

/// The number of quads of one render pass on software drivers, which keep the triangles of a pass in memory.
const SOFTWARE_PASS: u32 = 1 << 18;

impl QuadsKey {
    /// Returns the name of the fragment stage.
    fn entry(&self) -> String {
        match self.feed {
            Feed::Colors | Feed::LitScalars => format!("feed_{}", self.sheets_per_pass),
            Feed::Depth => "feed_depth".to_owned(),
            Feed::Scalars | Feed::Projection => format!("scalars_{}", self.sheets_per_pass),
        }
    }
}

impl SheetTextures {
    pub(super) fn new(context: &Context, key: &QuadsKey, [width, height]: [u32; 2]) -> Self {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
        let (size, layered) = ([width, height, key.layers()], wgpu::TextureDimension::D2);
        let texture = context.texture("splat.sheets", key.feed.format(key.precision), size, layered, usage);
        let view = |base_array_layer, array_layer_count, dimension| {
            let dimension = Some(dimension);
            let layers =
                wgpu::TextureViewDescriptor { dimension, base_array_layer, array_layer_count, ..Default::default() };
            texture.create_view(&layers)
        };
        let targets = (0..key.layers()).map(|layer| view(layer, Some(1), wgpu::TextureViewDimension::D2)).collect();
        let all = view(0, None, wgpu::TextureViewDimension::D2Array);
        Self { targets, all }
    }
}

impl Splatting {
    pub(super) fn new(context: &Context, key: &QuadsKey) -> Self {
        let table = ReadTexture(wgpu::TextureFormat::Rgba32Float);
        let slots = [Uniform, DynamicUniform, Read, table, Read, Uniform, Read];
        let layout = layout(context, "splat", wgpu::ShaderStages::VERTEX_FRAGMENT, &slots);
        let module = &module(context, shaders::SPLAT);
        let constants = &declared(shaders::SPLAT, &key.constants);
        let add = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: wgpu::BlendOperation::Add,
        };
        let targets = |blend| {
            let target = wgpu::ColorTargetState {
                format: key.feed.format(key.precision),
                blend,
                write_mask: wgpu::ColorWrites::ALL,
            };
            vec![Some(target); key.layers() as usize]
        };
        let place = wgpu::VertexAttribute { format: wgpu::VertexFormat::Uint32, offset: 0, shader_location: 0 };
        let places = wgpu::VertexBufferLayout {
            array_stride: 4,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &[place],
        };
        let pipeline = Render {
            label: "splat",
            layout: Some(&layout),
            module,
            vertex: ("vertex", constants),
            buffers: &[Some(places)],
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            fragment: (&key.entry(), constants),
            targets: &targets(Some(wgpu::BlendState { color: add, alpha: add })),
        };
        // Writes nothing but zeros.
        let wipe = Render {
            label: "splat.wipe",
            layout: None,
            module,
            vertex: ("cover", &[]),
            buffers: &[],
            topology: wgpu::PrimitiveTopology::TriangleList,
            fragment: (&format!("wipe_{}", key.layers()), &[]),
            targets: &targets(None),
        };
        Self {
            sheets_per_pass: key.sheets_per_pass,
            pipeline: pipeline.pipeline(context),
            wipe: (!key.feed.is_scalar()).then(|| wipe.pipeline(context)),
            layout,
        }
    }

    pub(super) fn bind(
        &self,
        context: &Context,
        target: Target<'_>,
        inputs: &Inputs<'_>,
        spans: &[Span<'_>],
        batches: u32,
    ) -> Result<RegionSplatting<'_>> {
        let parameters: Vec<_> = (0..batches).map(|b| target.plan.batch(b * self.sheets_per_pass)).collect();
        let batches = DynamicUniforms::new(context, "splat.batches", &parameters)?;
        let lighting =
            context.upload("splat.lighting", bytemuck::bytes_of(&inputs.lighting), wgpu::BufferUsages::UNIFORM)?;
        let groups = spans
            .iter()
            .map(|span| {
                let resources = [
                    target.frame.as_entire_binding(),
                    batches.binding(),
                    span.piece.splats(),
                    texture_view(inputs.footprint),
                    span.piece.origins(),
                    lighting.as_entire_binding(),
                    inputs.solids.as_entire_binding(),
                ];
                bind(context, "splat", &self.layout, &resources)
            })
            .collect();
        let extent = target.extent();
        let pixels = extent.into_iter().map(f64::from).product();
        let quad_pixels = target.plan.view.splat_pixels().min(pixels) as u64;
        Ok(RegionSplatting { stage: self, extent, batches, groups, quad_pixels })
    }
}

impl RegionSplatting<'_> {
    /// Draws the entries of a batch into its sheets, after clearing the area that they reach.
    pub(super) fn record(
        &self,
        recorder: &mut Recorder<'_>,
        sheets: &SheetTextures,
        spans: &[Span<'_>],
        batch: u32,
        area: Area,
    ) {
        let context = recorder.context;
        // Drivers clear large parts faster.
        let [width, height] = area.size();
        let part = u64::from(width) * u64::from(height);
        let all = u64::from(self.extent[0]) * u64::from(self.extent[1]);
        let wipe = self.stage.wipe.as_ref().filter(|_| 2 * part < all && part > 0);
        let most = match context.info.is_software() {
            true => SOFTWARE_PASS,
            false => u32::try_from(max_work(context) / self.quad_pixels.max(1)).unwrap_or(u32::MAX).max(1),
        };
        let passes = passes(spans, batch, most);
        for (number, pieces) in passes.into_iter().enumerate() {
            let load = match (number, wipe) {
                (0, None) => wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                _ => wgpu::LoadOp::Load,
            };
            let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
            let attachments: Vec<_> = sheets
                .targets
                .iter()
                .map(|view| {
                    Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
                })
                .collect();
            let mut pass = recorder.render_pass("splat", &attachments);
            if let (0, Some(wipe)) = (number, wipe) {
                pass.set_pipeline(wipe);
                pass.set_scissor_rect(area.low[0], area.low[1], width, height);
                context.dispatched();
                pass.draw(0..3, 0..1);
                pass.set_scissor_rect(0, 0, self.extent[0], self.extent[1]);
            }
            pass.set_pipeline(&self.stage.pipeline);
            let mut quads = 0;
            for (index, piece) in pieces {
                quads += piece.len() as u64;
                pass.set_bind_group(0, &self.groups[index], &[self.batches.offset(batch)]);
                pass.set_vertex_buffer(0, spans[index].entries.slice(..));
                context.dispatched();
                pass.draw(0..4, piece);
            }
            drop(pass);
            recorder.worked(quads * self.quad_pixels);
        }
    }
}

/// Splits the entries of a batch into passes of at most `most` quads each, as runs of entries of spans, each with the
/// span's index.
fn passes(spans: &[Span<'_>], batch: u32, most: u32) -> Vec<Vec<(usize, Range<u32>)>> {
    let mut passes: Vec<Vec<(usize, Range<u32>)>> = vec![Vec::new()];
    let mut held = 0;
    for (index, span) in spans.iter().enumerate() {
        let range = span.batch(batch);
        for first in range.clone().step_by(most as usize) {
            let piece = first..range.end.min(first.saturating_add(most));
            held += piece.len();
            if held > most as usize {
                held = piece.len();
                passes.push(Vec::new());
            }
            if let Some(pass) = passes.last_mut() {
                pass.push((index, piece));
            }
        }
    }
    passes
}

/// Returns the footprint table as a texture: one row of texels per row of the table, four coefficients each.
pub(crate) fn footprint_texture(context: &Context, table: &FootprintTable) -> wgpu::TextureView {
    context.float_texture("splat.footprint", [table.terms() / 4, table.rows()], table.coefficients())
}
