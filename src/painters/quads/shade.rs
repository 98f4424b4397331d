//! shade: sheets of scalars into the frame, classified and lit per pixel; or their largest value or mean.

use glam::DAffine3;

use super::plan::Target;
use super::splat::SheetTextures;
use super::{DynamicUniforms, Feed, Frame, Inputs, QuadsKey};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::{Area, Lighting, Shade, affine};
use crate::gpu::light_volume::PostShading;
use crate::gpu::pipeline::{Binding, bind, compute, flag, layout, module, texture_view};
use crate::gpu::recorder::{Recorder, flat};
use crate::gpu::shaders;
use crate::gpu::view::half;

/// The pipelines.
pub(super) struct ShadeStage {
    key: QuadsKey,
    layout: wgpu::BindGroupLayout,
    shade: wgpu::ComputePipeline,
    resolve_layout: wgpu::BindGroupLayout,
    resolve: wgpu::ComputePipeline,
}

/// What one region is shaded with.
pub(super) struct Shaded<'a> {
    stage: &'a ShadeStage,
    batches: DynamicUniforms,
    /// Whether a batch has splats; one more ends the list.
    drawn: Vec<bool>,
    /// The pixels that each step looks at.
    areas: Vec<Area>,
    /// Whether a field of nothing but the base shows nothing.
    base_is_invisible: bool,
    /// For even and odd batches.
    groups: [wgpu::BindGroup; 2],
    resolve: wgpu::BindGroup,
    workgroups: [u32; 2],
}

impl ShadeStage {
    pub(super) fn new(context: &Context, key: QuadsKey) -> Self {
        let stages = wgpu::ShaderStages::COMPUTE;
        let sheets = Binding::Texture(wgpu::TextureViewDimension::D2Array);
        let slots = [
            Binding::Uniform,
            Binding::DynamicUniform,
            Binding::Uniform,
            sheets,
            sheets,
            Binding::ReadTexture(wgpu::TextureFormat::Rgba32Float),
            Binding::Write,
            Binding::FilteredTexture(wgpu::TextureViewDimension::D3),
            Binding::Sampler,
        ];
        let shade_layout = layout(context, "shade", stages, &slots);
        let shader = module(context, shaders::SHADE);
        let crowded = ("CROWDED", flag(key.crowded));
        let thins = ("GRADIENT_OPACITY", flag(key.thins));
        let constants = [("PERSPECTIVE", flag(key.perspective)), ("SHEETS", f64::from(key.sheets_per_pass))];
        let shadows = ("SHADOWS", flag(key.post_shadows));
        let lights = [("LIGHTS", f64::from(key.lights)), ("POINT_LIGHTS", flag(key.point_lights))];
        let clip = ("CLIP_PLANES", f64::from(key.clip_planes));
        let samples = ("SAMPLES", f64::from(key.samples));
        let shading = [clip, lights[0], lights[1], samples, crowded, thins, shadows];
        let shading = [&constants[..], &shading].concat();
        let mean = ("MEAN", flag(key.feed == Feed::Mean));
        let coded = ("DEPTH_CODED", flag(key.depth_coded));
        let attenuated = ("ATTENUATED", flag(key.attenuated));
        let projection = [&constants[..], &[clip, mean, coded, attenuated]].concat();
        let (entry, constants) = if key.feed.projects() { ("project", &projection) } else { ("shade", &shading) };
        let shade = compute(context, &shader, "shade", entry, &shade_layout, constants);
        let (resolve_layout, resolve) = if key.feed.projects() {
            let constants = [crowded, mean, coded];
            let pipeline = compute(context, &shader, "shade", "resolve_projection", &shade_layout, &constants);
            (shade_layout.clone(), pipeline)
        } else {
            let resolve_layout = layout(context, "resolve", stages, &[Binding::Uniform, Binding::Write]);
            let shader = module(context, shaders::RESOLVE);
            let pipeline = compute(context, &shader, "resolve", "resolve", &resolve_layout, &[]);
            (resolve_layout, pipeline)
        };
        Self { key, layout: shade_layout, shade, resolve_layout, resolve }
    }

    pub(super) fn bind<'a>(
        &'a self,
        context: &Context,
        target: Target<'_>,
        inputs: &Inputs<'_>,
        post: &PostShading,
        sheets: &[SheetTextures],
        Frame { pixels, reached }: Frame<'_>,
    ) -> Result<Shaded<'a>> {
        let table = &post.table;
        let drawn: Vec<bool> = reached.iter().map(|area| *area != Area::default()).chain([false]).collect();
        let base_is_invisible = table.invisible[0] <= table.invisible[1];
        let extent = target.extent();
        // Pixels that neither batch reaches hold the base. They are shaded only if the base shows or counts.
        let areas: Vec<Area> = (0..drawn.len())
            .map(|batch| {
                if !base_is_invisible || self.key.feed.projects() {
                    return Area { low: [0, 0], high: extent };
                }
                let of = |batch: Option<usize>| batch.and_then(|b| reached.get(b)).copied().unwrap_or_default();
                of(batch.checked_sub(1)).joined(of(Some(batch)))
            })
            .collect();
        let to_light = affine(&(post.to_light * DAffine3::from_translation(half(&target.plan.view.grid))));
        let parameters: Vec<_> = (0..drawn.len() as u32)
            .map(|batch| Shade {
                // One sheet back: each is shaded when the next one is known.
                depth: (target.plan.sheet_depth(batch * self.key.sheets_per_pass) - target.plan.sheet_step()) as f32,
                previous: f32::from(u8::from(batch > 0 && drawn[batch as usize - 1])),
                current: f32::from(u8::from(drawn[batch as usize])),
                gradient_lookup: table.gradient_lookup,
                invisible: table.invisible,
                lookup: table.lookup,
                low: areas[batch as usize].low,
                high: areas[batch as usize].high,
                to_light,
            })
            .collect();
        let batches = DynamicUniforms::new(context, "shade.batches", &parameters)?;
        // Rays are in the lattice from its middle.
        let view = &target.plan.view;
        let from_middle = view.map_of_lattice() * DAffine3::from_translation(half(&view.grid));
        let lighting = Lighting { from_lattice: affine(&from_middle), ..inputs.lighting };
        let lighting = context.upload("shade.lighting", bytemuck::bytes_of(&lighting), wgpu::BufferUsages::UNIFORM)?;
        let frame = target.frame.as_entire_binding();
        let group = |parity: usize| {
            let resources = [
                frame.clone(),
                batches.binding(),
                lighting.as_entire_binding(),
                texture_view(&sheets[1 - parity].all),
                texture_view(&sheets[parity].all),
                texture_view(&table.texture),
                pixels.as_entire_binding(),
                texture_view(&post.light.texture),
                wgpu::BindingResource::Sampler(&post.light.sampler),
            ];
            bind(context, "shade", &self.layout, &resources)
        };
        let groups = [group(0), group(1)];
        let resolve = if self.key.feed.projects() {
            group(0)
        } else {
            bind(context, "resolve", &self.resolve_layout, &[frame.clone(), pixels.as_entire_binding()])
        };
        Ok(Shaded {
            stage: self,
            batches,
            drawn,
            areas,
            base_is_invisible,
            groups,
            resolve,
            workgroups: target.extent().map(|side| side.div_ceil(8)),
        })
    }
}

impl Shaded<'_> {
    /// Shades what can be shaded once a batch of sheets is splatted: all sheets but the last, which waits for its
    /// neighbour.
    pub(super) fn batch(&self, recorder: &mut Recorder<'_>, batch: u32) {
        let index = batch as usize;
        let before = index.checked_sub(1).is_some_and(|before| self.drawn[before]);
        // Places that no splat reaches hold the base: it may show, or be the largest value of a ray.
        if !before && !self.drawn[index] && self.base_is_invisible && !self.stage.key.feed.projects() {
            return;
        }
        let offsets = [self.batches.offset(batch)];
        let workgroups = self.areas[index].size().map(|side| side.div_ceil(8));
        if workgroups[0] > 0 && workgroups[1] > 0 {
            recorder.dispatch("shade", &self.stage.shade, &self.groups[index % 2], &offsets, flat(workgroups));
        }
    }

    /// Shades the last sheet, after which there is none, and makes the frame a picture.
    pub(super) fn resolve(&self, recorder: &mut Recorder<'_>) {
        self.batch(recorder, self.drawn.len() as u32 - 1);
        let offsets: &[u32] = if self.stage.key.feed.projects() { &[0] } else { &[] };
        recorder.dispatch("resolve", &self.stage.resolve, &self.resolve, offsets, flat(self.workgroups));
    }
}
