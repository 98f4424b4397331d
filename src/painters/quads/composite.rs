//! composite, shade and resolve: sheets into the frame, and the frame into a picture.

use glam::DAffine3;

use super::plan::Target;
use super::splat::SheetTextures;
use super::{Feed, Inputs, QuadsKey, shade};
use crate::error::{Error, Result};
use crate::gpu::context::Context;
use crate::gpu::layout::{Area, Lighting, Reached, Shade, affine};
use crate::gpu::light_volume::PostShading;
use crate::gpu::pipeline::Binding::{DynamicUniform, Texture, Uniform, Write};
use crate::gpu::pipeline::texture_view;
use crate::gpu::recorder::{Recorder, flat};
use crate::gpu::shaders;
use crate::gpu::stage::{DynamicUniforms, Stage};
use crate::gpu::view::half;

/// The pipelines that bring sheets into the frame, and that make the frame a picture.
pub(super) struct Consumer {
    feed: Feed,
    sheets_per_pass: u32,
    sheets: Stage,
    resolve: Stage,
}

/// A consumer bound to a region.
pub(super) struct Bound<'a> {
    consumer: &'a Consumer,
    steps: SheetSteps,
    /// The bindings that make the frame a picture; `None`: a brick keeps its frame.
    resolve: Option<wgpu::BindGroup>,
    workgroups: [u32; 2],
}

/// The bindings of the stage that reads sheets.
struct SheetSteps {
    /// The parameters of each step: one for each batch, and one more if a sheet of the last batch waits for its
    /// neighbour.
    uniforms: DynamicUniforms,
    /// The pixels that each step reaches.
    areas: Vec<Area>,
    /// The bindings for even and for odd batches.
    groups: [wgpu::BindGroup; 2],
}

impl Consumer {
    pub(super) fn new(context: &Context, key: &QuadsKey) -> Self {
        let (feed, constants) = (key.feed, &key.constants);
        let resolve = || Stage::new(context, shaders::RESOLVE, ("resolve", "resolve"), &[Uniform, Write], constants);
        let composite = |entry| {
            let sheets = Texture(wgpu::TextureViewDimension::D2Array);
            let slots = [Uniform, sheets, Write, DynamicUniform];
            Stage::new(context, shaders::COMPOSITE, ("composite", entry), &slots, constants)
        };
        let [sheets, resolve] = match feed {
            Feed::Colors => [composite("composite"), resolve()],
            Feed::Depth => [composite("depth"), resolve()],
            Feed::Projection => {
                let entries = [("shade", "project"), ("resolve", "resolve_projection")];
                Stage::several(context, shaders::SHADE, entries, &shade::SLOTS, constants)
            }
            Feed::Scalars | Feed::LitScalars => {
                [Stage::new(context, shaders::SHADE, ("shade", "shade"), &shade::SLOTS, constants), resolve()]
            }
        };
        Self { feed, sheets_per_pass: key.sheets_per_pass, sheets, resolve }
    }

    /// Binds the sheets and the pixels of a region. `reached` has the pixels that each batch reaches; it is empty for a
    /// batch without splats.
    pub(super) fn bind(
        &self,
        context: &Context,
        target: Target<'_>,
        inputs: &Inputs<'_>,
        sheets: &[SheetTextures],
        pixels: &wgpu::Buffer,
        reached: &[Area],
    ) -> Result<Bound<'_>> {
        let frame = target.frame.as_entire_binding();
        let steps = if self.feed.is_scalar() {
            let post = inputs.post.ok_or_else(|| Error::Device {
                stage: "shade".to_owned(),
                reason: "the scene has no transfer function to classify scalars by".to_owned(),
            })?;
            self.shading(context, target, (post, inputs), sheets, pixels, reached)?
        } else {
            let batches = (0_u32..).zip(reached).map(|(batch, &Area { low, high })| {
                let depth = target.plan.sheet_depth(batch * self.sheets_per_pass) as f32;
                Reached { low, high, depth, _pad: 0 }
            });
            let uniforms = DynamicUniforms::new(context, "composite.areas", &batches.collect::<Vec<Reached>>())?;
            let sheets = texture_view(&sheets[0].all);
            let group = [frame.clone(), sheets, pixels.as_entire_binding(), uniforms.binding()];
            let group = self.sheets.bind(context, &group);
            SheetSteps { uniforms, areas: reached.to_vec(), groups: [group.clone(), group] }
        };
        let resolve = match self.feed {
            Feed::Projection => Some(steps.groups[0].clone()),
            _ if target.plan.view.held.is_some() => None,
            _ => Some(self.resolve.bind(context, &[frame, pixels.as_entire_binding()])),
        };
        Ok(Bound { consumer: self, steps, resolve, workgroups: target.extent().map(|side| side.div_ceil(8)) })
    }

    /// Binds sheets of scalars.
    fn shading(
        &self,
        context: &Context,
        target: Target<'_>,
        (post, inputs): (&PostShading, &Inputs<'_>),
        sheets: &[SheetTextures],
        pixels: &wgpu::Buffer,
        reached: &[Area],
    ) -> Result<SheetSteps> {
        // Pixels that neither batch reaches hold the base. They are shaded only if the base shows or counts.
        let [low, high] = post.table.invisible;
        let whole = (low > high || self.feed == Feed::Projection).then_some(target.extent());
        let parameters = shade::steps(target.plan, post, self.sheets_per_pass, reached, whole);
        let uniforms = DynamicUniforms::new(context, "shade.batches", &parameters)?;
        // Rays are in the lattice from its middle.
        let view = target.plan.view;
        let from_middle = view.map_of_lattice() * DAffine3::from_translation(half(&view.grid));
        let lighting = Lighting { from_lattice: affine(&from_middle), ..inputs.lighting };
        let lighting = context.upload("shade.lighting", bytemuck::bytes_of(&lighting), wgpu::BufferUsages::UNIFORM)?;
        let groups = [0, 1].map(|parity| {
            let resources = [
                target.frame.as_entire_binding(),
                uniforms.binding(),
                lighting.as_entire_binding(),
                texture_view(&sheets[1 - parity].all),
                texture_view(&sheets[parity].all),
                texture_view(&post.table.texture),
                pixels.as_entire_binding(),
                texture_view(&post.light.texture),
                wgpu::BindingResource::Sampler(&post.light.sampler),
                inputs.solids.as_entire_binding(),
            ];
            self.sheets.bind(context, &resources)
        });
        let areas = parameters.iter().map(|&Shade { low, high, .. }| Area { low, high }).collect();
        Ok(SheetSteps { uniforms, areas, groups })
    }
}

impl Bound<'_> {
    /// Brings a batch into the frame after it was splatted. Shading is one sheet behind.
    pub(super) fn batch(&self, recorder: &mut Recorder<'_>, batch: u32) {
        let SheetSteps { uniforms, areas, groups } = &self.steps;
        let workgroups = areas[batch as usize].size().map(|side| side.div_ceil(8));
        if workgroups[0] > 0 && workgroups[1] > 0 {
            let group = &groups[batch as usize % 2];
            self.consumer.sheets.dispatch(recorder, group, &[uniforms.offset(batch)], flat(workgroups));
        }
    }

    /// Takes the steps after the last batch, then makes the frame a picture.
    pub(super) fn resolve(&self, recorder: &mut Recorder<'_>, batches: u32) {
        (batches..self.steps.areas.len() as u32).for_each(|batch| self.batch(recorder, batch));
        // Projections resolve with the bindings of their steps, which have an offset.
        let offsets: &[u32] = if self.consumer.feed == Feed::Projection { &[0] } else { &[] };
        if let Some(resolve) = &self.resolve {
            self.consumer.resolve.dispatch(recorder, resolve, offsets, flat(self.workgroups));
        }
    }
}
