//! The painter `quads`: splat and composite. Each batch of sheets is one render pass of instanced quads that feed all
//! of its sheets at once, followed by one compute pass that composites them.

use super::context::Context;
use super::layout::Batch;
use super::pipeline::{Slot, bind, compute, layout, module, pipeline_layout, specialised};
use super::plan::Target;
use super::shaders;
use super::sort::Span;
use super::timing::Timing;
use crate::error::Result;
use crate::kernel::FootprintTable;
use crate::settings::Precision;

/// What the pipelines are specialised for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct QuadsKey {
    pub(crate) perspective: bool,
    pub(crate) precision: Precision,
    pub(crate) sheets_per_pass: u32,
    pub(crate) footprint_rows: u32,
    pub(crate) footprint_terms: u32,
}

impl Precision {
    /// Bytes of a pixel of a sheet.
    pub(crate) fn bytes(self) -> u32 {
        match self {
            Self::F16 => 8,
            Self::F32 => 16,
        }
    }

    /// The format of a sheet.
    pub(crate) fn format(self) -> wgpu::TextureFormat {
        match self {
            Self::F16 => wgpu::TextureFormat::Rgba16Float,
            Self::F32 => wgpu::TextureFormat::Rgba32Float,
        }
    }
}

/// The pipelines of the painter.
pub(crate) struct Quads {
    key: QuadsKey,
    splat_layout: wgpu::BindGroupLayout,
    splat: wgpu::RenderPipeline,
    composite_layout: wgpu::BindGroupLayout,
    composite: wgpu::ComputePipeline,
    resolve_layout: wgpu::BindGroupLayout,
    resolve: wgpu::ComputePipeline,
}

/// What was drawn.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Drawn {
    /// Render passes, one per batch that is not empty.
    pub(crate) passes: u64,
    /// Quads, one per splat and batch.
    pub(crate) quads: u64,
}

impl Quads {
    pub(crate) fn new(context: &Context, key: QuadsKey) -> Self {
        let splat_layout = layout(
            context,
            "splat",
            wgpu::ShaderStages::VERTEX_FRAGMENT,
            &[Slot::Uniform, Slot::DynamicUniform, Slot::Read, Slot::Texture(wgpu::TextureViewDimension::D2)],
        );
        let composite_layout = layout(
            context,
            "composite",
            wgpu::ShaderStages::COMPUTE,
            &[Slot::Uniform, Slot::Texture(wgpu::TextureViewDimension::D2Array), Slot::Write],
        );
        let resolve_layout = layout(context, "resolve", wgpu::ShaderStages::COMPUTE, &[Slot::Uniform, Slot::Write]);
        let composite = compute(
            context,
            &module(context, shaders::COMPOSITE),
            "composite",
            "composite",
            &composite_layout,
            &[("SHEETS", f64::from(key.sheets_per_pass))],
        );
        let resolve = compute(context, &module(context, shaders::RESOLVE), "resolve", "resolve", &resolve_layout, &[]);
        Self {
            splat: splat_pipeline(context, key, &splat_layout),
            key,
            splat_layout,
            composite_layout,
            composite,
            resolve_layout,
            resolve,
        }
    }

    pub(crate) fn sheets_per_pass(&self) -> u32 {
        self.key.sheets_per_pass
    }

    /// Draws the spans' splats and returns the region as premultiplied RGBA.
    pub(crate) fn run(
        &self,
        context: &Context,
        timing: &mut Timing,
        Target { plan, region, frame }: Target<'_>,
        footprint: &wgpu::TextureView,
        spans: &[Span<'_>],
    ) -> Result<(Vec<[f32; 4]>, Drawn)> {
        let mut drawn = Drawn::default();
        let sheets = self.key.sheets_per_pass;
        let batches = plan.sheets().div_ceil(sheets);
        let texture = context.texture(&wgpu::TextureDescriptor {
            label: Some("splat.sheets"),
            size: wgpu::Extent3d { width: region.width, height: region.height, depth_or_array_layers: sheets },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: self.key.precision.format(),
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let targets: Vec<_> = (0..sheets)
            .map(|layer| {
                texture.create_view(&wgpu::TextureViewDescriptor {
                    label: Some("splat.sheet"),
                    dimension: Some(wgpu::TextureViewDimension::D2),
                    base_array_layer: layer,
                    array_layer_count: Some(1),
                    ..Default::default()
                })
            })
            .collect();
        let all_sheets = texture.create_view(&wgpu::TextureViewDescriptor {
            label: Some("composite.sheets"),
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        let bytes = u64::from(region.width) * u64::from(region.height) * 16;
        let pixels =
            context.buffer("composite.pixels", bytes, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC)?;
        // One batch's parameters in each slot that a dynamic offset can name.
        let stride = context.limits.min_uniform_buffer_offset_alignment.max(16) as usize;
        let mut depths = vec![0_u8; stride * batches as usize];
        for (batch, slot) in (0..batches).zip(depths.chunks_exact_mut(stride)) {
            let parameters = Batch { depth: plan.sheet_depth(batch * sheets) as f32 };
            slot[..size_of::<Batch>()].copy_from_slice(bytemuck::bytes_of(&parameters));
        }
        let depths = context.upload("splat.batches", &depths, wgpu::BufferUsages::UNIFORM)?;
        let splat_groups: Vec<_> = spans
            .iter()
            .map(|span| {
                bind(
                    context,
                    "splat",
                    &self.splat_layout,
                    &[
                        frame.as_entire_binding(),
                        super::pipeline::part(&depths, 0, 16),
                        span.piece.splats(),
                        wgpu::BindingResource::TextureView(footprint),
                    ],
                )
            })
            .collect();
        let composite_group = bind(
            context,
            "composite",
            &self.composite_layout,
            &[frame.as_entire_binding(), wgpu::BindingResource::TextureView(&all_sheets), pixels.as_entire_binding()],
        );
        let mut encoder = context.device.create_command_encoder(&Default::default());
        for batch in 0..batches as usize {
            let quads: u32 = spans.iter().map(|s| s.starts[batch + 1] - s.starts[batch]).sum();
            if quads == 0 {
                continue;
            }
            drawn.passes += 1;
            drawn.quads += u64::from(quads);
            {
                let attachments: Vec<_> = targets
                    .iter()
                    .map(|view| {
                        Some(wgpu::RenderPassColorAttachment {
                            view,
                            depth_slice: None,
                            resolve_target: None,
                            ops: wgpu::Operations {
                                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                                store: wgpu::StoreOp::Store,
                            },
                        })
                    })
                    .collect();
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("splat"),
                    color_attachments: &attachments,
                    timestamp_writes: timing.render(context, "splat"),
                    ..Default::default()
                });
                pass.set_pipeline(&self.splat);
                for (span, group) in spans.iter().zip(&splat_groups) {
                    let range = span.starts[batch]..span.starts[batch + 1];
                    if !range.is_empty() {
                        pass.set_bind_group(0, group, &[(batch * stride) as u32]);
                        pass.set_vertex_buffer(0, span.entries.slice(..));
                        pass.draw(0..4, range);
                    }
                }
            }
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("composite"),
                timestamp_writes: timing.compute(context, "composite"),
            });
            pass.set_pipeline(&self.composite);
            pass.set_bind_group(0, &composite_group, &[]);
            pass.dispatch_workgroups(region.width.div_ceil(8), region.height.div_ceil(8), 1);
        }
        {
            let group = bind(
                context,
                "resolve",
                &self.resolve_layout,
                &[frame.as_entire_binding(), pixels.as_entire_binding()],
            );
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("resolve"),
                timestamp_writes: timing.compute(context, "resolve"),
            });
            pass.set_pipeline(&self.resolve);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(region.width.div_ceil(8), region.height.div_ceil(8), 1);
        }
        let staging =
            context.buffer("resolve.staging", bytes, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)?;
        encoder.copy_buffer_to_buffer(&pixels, 0, &staging, 0, bytes);
        context.queue.submit([encoder.finish()]);
        let data = context.read("splatting", &staging)?;
        let rgba = data[..bytes as usize].chunks_exact(16).map(bytemuck::pod_read_unaligned).collect();
        Ok((rgba, drawn))
    }
}

fn splat_pipeline(context: &Context, key: QuadsKey, group: &wgpu::BindGroupLayout) -> wgpu::RenderPipeline {
    let module = module(context, shaders::SPLATTING);
    let vertex_constants = [("PERSPECTIVE", f64::from(u8::from(key.perspective)))];
    let fragment_constants = [
        ("PERSPECTIVE", f64::from(u8::from(key.perspective))),
        ("TEXELS", f64::from(key.footprint_terms / 4)),
        ("ROWS", f64::from(key.footprint_rows)),
    ];
    let add = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let target = Some(wgpu::ColorTargetState {
        format: key.precision.format(),
        blend: Some(wgpu::BlendState { color: add, alpha: add }),
        write_mask: wgpu::ColorWrites::ALL,
    });
    let targets = vec![target; key.sheets_per_pass as usize];
    context.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("splat"),
        layout: Some(&pipeline_layout(context, "splat", group)),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: specialised(&vertex_constants),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: 4,
                step_mode: wgpu::VertexStepMode::Instance,
                attributes: &[wgpu::VertexAttribute {
                    format: wgpu::VertexFormat::Uint32,
                    offset: 0,
                    shader_location: 0,
                }],
            })],
        },
        primitive: wgpu::PrimitiveState { topology: wgpu::PrimitiveTopology::TriangleStrip, ..Default::default() },
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(&format!("feed_{}", key.sheets_per_pass)),
            compilation_options: specialised(&fragment_constants),
            targets: &targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// The footprint table as a texture: one row of texels per row of the table, four coefficients each.
pub(crate) fn footprint_texture(context: &Context, table: &FootprintTable) -> wgpu::TextureView {
    let texels = table.terms() / 4;
    let size = wgpu::Extent3d { width: texels, height: table.rows(), depth_or_array_layers: 1 };
    let texture = context.texture(&wgpu::TextureDescriptor {
        label: Some("splat.footprint"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    context.queue.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(table.coefficients()),
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(texels * 16), rows_per_image: None },
        size,
    );
    texture.create_view(&Default::default())
}
