//! present: copies the pixels of a region into the caller's texture. See shaders/present.wgsl.

use super::context::Context;
use super::layout;
use super::pipeline::{Binding, Render, bind, flag, layout, module};
use super::recorder::Recorder;
use super::shaders;
use crate::error::{Error, Result};
use crate::image::Region;

/// The pipeline for textures of one format.
pub(crate) struct Present {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
}

impl Present {
    pub(crate) fn new(context: &Context, format: wgpu::TextureFormat) -> Self {
        let slots = [Binding::Uniform, Binding::Read];
        let layout = layout(context, "present", wgpu::ShaderStages::FRAGMENT, &slots);
        let module = module(context, shaders::PRESENT);
        let target = wgpu::ColorTargetState { format, blend: None, write_mask: wgpu::ColorWrites::ALL };
        let render = Render {
            label: "present",
            layout: Some(&layout),
            module: &module,
            vertex: ("cover", &[]),
            buffers: &[],
            topology: wgpu::PrimitiveTopology::TriangleList,
            fragment: ("present_pixel", &[("SRGB", flag(format.is_srgb()))]),
            targets: &[Some(target)],
        };
        let pipeline = render.pipeline(context);
        Self { layout, pipeline }
    }

    /// Records the copy of a region to its place in a texture.
    pub(crate) fn record(
        &self,
        recorder: &mut Recorder<'_>,
        view: &wgpu::TextureView,
        region: Region,
        pixels: &wgpu::Buffer,
    ) -> Result<()> {
        let context = recorder.context;
        let parameters = layout::Present { corner: [region.x, region.y], row: region.width, _pad: 0 };
        let parameters = bytemuck::bytes_of(&parameters);
        let parameters = context.upload("present.parameters", parameters, wgpu::BufferUsages::UNIFORM)?;
        let resources = [parameters.as_entire_binding(), pixels.as_entire_binding()];
        let group = bind(context, "present", &self.layout, &resources);
        let mut pass = recorder.render_pass("present", &[Some(attachment(view, wgpu::LoadOp::Load))]);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.set_scissor_rect(region.x, region.y, region.width, region.height);
        context.dispatched();
        pass.draw(0..3, 0..1);
        Ok(())
    }
}

/// Refuses a texture that a picture of `size` pixels cannot be drawn into.
pub(crate) fn check_target(texture: &wgpu::Texture, size: [u32; 2]) -> Result<()> {
    let error = |reason: String| Err(Error::Setting { name: "target", reason });
    let extent = texture.size();
    if [extent.width, extent.height] != size || texture.dimension() != wgpu::TextureDimension::D2 {
        let [width, height] = size;
        return error(format!(
            "a texture of {} x {} texels for a picture of {width} x {height} pixels",
            extent.width, extent.height
        ));
    }
    if !texture.usage().contains(wgpu::TextureUsages::RENDER_ATTACHMENT) || texture.sample_count() != 1 {
        return error("expected a texture of one sample with the usage RENDER_ATTACHMENT".to_owned());
    }
    let kind = texture.format().sample_type(None, None);
    if !matches!(kind, Some(wgpu::TextureSampleType::Float { .. })) || texture.format().components() != 4 {
        return error(format!("{:?}, expected a format of four float or normalised channels", texture.format()));
    }
    Ok(())
}

/// Makes a texture transparent.
pub(crate) fn clear(context: &Context, view: &wgpu::TextureView) {
    let mut recorder = Recorder::untimed(context);
    drop(recorder.render_pass("present", &[Some(attachment(view, wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT)))]));
    recorder.submit();
}

fn attachment(view: &wgpu::TextureView, load: wgpu::LoadOp<wgpu::Color>) -> wgpu::RenderPassColorAttachment<'_> {
    let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
    wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops }
}
