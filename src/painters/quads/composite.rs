//! composite and resolve: pre-shaded sheets into the frame, and the frame into a picture.

use super::plan::Target;
use super::splat::SheetTextures;
use super::{DynamicUniforms, Feed, Frame, QuadsKey};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::Area;
use crate::gpu::pipeline::{Binding, bind, compute, flag, layout, module, texture_view};
use crate::gpu::recorder::{Recorder, flat};
use crate::gpu::shaders;

/// The pipelines.
pub(super) struct CompositeStage {
    composite_layout: wgpu::BindGroupLayout,
    composite: wgpu::ComputePipeline,
    resolve_layout: wgpu::BindGroupLayout,
    resolve: wgpu::ComputePipeline,
}

/// What one region is composited with.
pub(super) struct Compositing<'a> {
    stage: &'a CompositeStage,
    /// The pixels of each batch; none if it has no splats.
    reached: Vec<Area>,
    areas: DynamicUniforms,
    sheets: wgpu::BindGroup,
    pixels: wgpu::BindGroup,
    workgroups: [u32; 2],
}

impl CompositeStage {
    pub(super) fn new(context: &Context, key: QuadsKey) -> Self {
        let compute_stage = wgpu::ShaderStages::COMPUTE;
        let sheets = Binding::Texture(wgpu::TextureViewDimension::D2Array);
        let slots = [Binding::Uniform, sheets, Binding::Write, Binding::DynamicUniform];
        let composite_layout = layout(context, "composite", compute_stage, &slots);
        let resolve_layout = layout(context, "resolve", compute_stage, &[Binding::Uniform, Binding::Write]);
        let constants = [("SHEETS", f64::from(key.sheets_per_pass)), ("ADDITIVE", flag(key.additive))];
        let (entry, constants) = match key.feed {
            Feed::Colors => ("composite", constants.as_slice()),
            _ => ("depth", [].as_slice()),
        };
        let shader = module(context, shaders::COMPOSITE);
        let composite = compute(context, &shader, "composite", entry, &composite_layout, constants);
        let response = [("RESPONSE", f64::from(key.response))];
        let shader = module(context, shaders::RESOLVE);
        let resolve = compute(context, &shader, "resolve", "resolve", &resolve_layout, &response);
        Self { composite_layout, composite, resolve_layout, resolve }
    }

    pub(super) fn bind<'a>(
        &'a self,
        context: &Context,
        target: Target<'_>,
        sheets: &SheetTextures,
        Frame { pixels, reached }: Frame<'_>,
    ) -> Result<Compositing<'a>> {
        let areas = DynamicUniforms::new(context, "composite.areas", reached)?;
        let frame = target.frame.as_entire_binding();
        let sheets = texture_view(&sheets.all);
        let resources = [frame.clone(), sheets, pixels.as_entire_binding(), areas.binding()];
        Ok(Compositing {
            stage: self,
            reached: reached.to_vec(),
            sheets: bind(context, "composite", &self.composite_layout, &resources),
            pixels: bind(context, "resolve", &self.resolve_layout, &[frame, pixels.as_entire_binding()]),
            workgroups: target.extent().map(|side| side.div_ceil(8)),
            areas,
        })
    }
}

impl Compositing<'_> {
    /// Brings the sheets of the batch that was splatted last into the frame.
    pub(super) fn batch(&self, recorder: &mut Recorder<'_>, batch: u32) {
        let workgroups = self.reached[batch as usize].size().map(|side| side.div_ceil(8));
        if workgroups[0] > 0 && workgroups[1] > 0 {
            let offsets = [self.areas.offset(batch)];
            recorder.dispatch("composite", &self.stage.composite, &self.sheets, &offsets, flat(workgroups));
        }
    }

    /// Makes the frame a picture.
    pub(super) fn resolve(&self, recorder: &mut Recorder<'_>) {
        recorder.dispatch("resolve", &self.stage.resolve, &self.pixels, &[], flat(self.workgroups));
    }
}
