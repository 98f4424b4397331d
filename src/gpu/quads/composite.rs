//! composite and resolve: pre-shaded sheets into the frame, and the frame into a picture.

use super::super::context::Context;
use super::super::pipeline::{Slot, bind, compute, layout, module};
use super::super::plan::Target;
use super::super::shaders;
use super::super::timing::Timing;
use super::splat::Sheets;
use super::{Feed, QuadsKey};

/// The pipelines.
pub(super) struct Composite {
    composite_layout: wgpu::BindGroupLayout,
    composite: wgpu::ComputePipeline,
    resolve_layout: wgpu::BindGroupLayout,
    resolve: wgpu::ComputePipeline,
}

/// What one region is composited with.
pub(super) struct Compositing<'a> {
    stage: &'a Composite,
    sheets: wgpu::BindGroup,
    pixels: wgpu::BindGroup,
    workgroups: [u32; 2],
}

impl Composite {
    pub(super) fn new(context: &Context, key: QuadsKey) -> Self {
        let compute_stage = wgpu::ShaderStages::COMPUTE;
        let slots = [Slot::Uniform, Slot::Texture(wgpu::TextureViewDimension::D2Array), Slot::Write];
        let composite_layout = layout(context, "composite", compute_stage, &slots);
        let resolve_layout = layout(context, "resolve", compute_stage, &[Slot::Uniform, Slot::Write]);
        let constants = [("SHEETS", f64::from(key.sheets_per_pass)), ("ADDITIVE", QuadsKey::flag(key.additive))];
        let (entry, constants) = match key.feed {
            Feed::Colors => ("composite", constants.as_slice()),
            Feed::Depth => ("depth", [].as_slice()),
        };
        let shader = module(context, shaders::COMPOSITE);
        let composite = compute(context, &shader, "composite", entry, &composite_layout, constants);
        let white = [("WHITE", QuadsKey::flag(key.feed == Feed::Depth))];
        let shader = module(context, shaders::RESOLVE);
        let resolve = compute(context, &shader, "resolve", "resolve", &resolve_layout, &white);
        Self { composite_layout, composite, resolve_layout, resolve }
    }

    pub(super) fn bind(
        &self,
        context: &Context,
        target: Target<'_>,
        sheets: &Sheets,
        pixels: &wgpu::Buffer,
    ) -> Compositing<'_> {
        let frame = target.frame.as_entire_binding();
        let sheets = wgpu::BindingResource::TextureView(&sheets.all);
        let resources = [frame.clone(), sheets, pixels.as_entire_binding()];
        Compositing {
            stage: self,
            sheets: bind(context, "composite", &self.composite_layout, &resources),
            pixels: bind(context, "resolve", &self.resolve_layout, &[frame, pixels.as_entire_binding()]),
            workgroups: target.extent().map(|side| side.div_ceil(8)),
        }
    }
}

impl Compositing<'_> {
    /// Brings the sheets of a batch into the frame.
    pub(super) fn record(&self, context: &Context, encoder: &mut wgpu::CommandEncoder, timing: &mut Timing) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("composite"),
            timestamp_writes: timing.compute(context, "composite"),
        });
        pass.set_pipeline(&self.stage.composite);
        pass.set_bind_group(0, &self.sheets, &[]);
        pass.dispatch_workgroups(self.workgroups[0], self.workgroups[1], 1);
    }

    /// Makes the frame a picture.
    pub(super) fn resolve(&self, context: &Context, encoder: &mut wgpu::CommandEncoder, timing: &mut Timing) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("resolve"),
            timestamp_writes: timing.compute(context, "resolve"),
        });
        pass.set_pipeline(&self.stage.resolve);
        pass.set_bind_group(0, &self.pixels, &[]);
        pass.dispatch_workgroups(self.workgroups[0], self.workgroups[1], 1);
    }
}
