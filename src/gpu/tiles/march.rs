//! skip and gather: the march of rays from voxel plane to voxel plane, past empty macrocells. See shaders/skip.wgsl,
//! shaders/gather.wgsl and shaders/gather_scalars.wgsl.

use super::super::context::Context;
use super::super::layout::{self, RUN_ROW, TILE};
use super::super::pipeline::{self, Binding, bind, compute, flag, module, texture_view};
use super::super::recorder::Recorder;
use super::super::shaders;
use super::super::transfer::TransferTable;
use super::pack::{Packed, Voxel};
use super::resample::FORMAT;
use super::{RayKind, TilesKey, texture};
use crate::settings::Model;

/// A pipeline and the layout of what it is bound to.
pub(super) struct Stage {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

/// What rays write to, and what they are lit and classified by.
pub(super) struct Targets<'a> {
    /// The uniforms of the rays.
    pub(super) rays: &'a wgpu::Buffer,
    /// Written if rays do not go through pixels; read by `prefilter`.
    pub(super) intermediate: &'a wgpu::TextureView,
    /// The picture: written if every pixel has its own ray.
    pub(super) pixels: &'a wgpu::Buffer,
    pub(super) lighting: &'a wgpu::Buffer,
    pub(super) transfer: Option<&'a TransferTable>,
}

impl Stage {
    fn new(
        context: &Context,
        shader: shaders::Shader,
        entry: &str,
        bindings: &[Binding],
        constants: &[(&str, f64)],
    ) -> Self {
        let layout = pipeline::layout(context, shader.name, wgpu::ShaderStages::COMPUTE, bindings);
        let pipeline = compute(context, &module(context, shader), shader.name, entry, &layout, constants);
        Self { layout, pipeline }
    }

    pub(super) fn skip(context: &Context, key: TilesKey) -> Self {
        let runs = Binding::StorageTexture(wgpu::TextureFormat::Rg32Uint, wgpu::TextureViewDimension::D2);
        let bindings = [Binding::Uniform, Binding::IntegerTexture(wgpu::TextureViewDimension::D3), runs];
        Self::new(context, shaders::SKIP, "skip", &bindings, &[("PERSPECTIVE", flag(key.perspective))])
    }

    pub(super) fn gather(context: &Context, key: TilesKey) -> Self {
        let software = context.info.is_software();
        let volume = key.voxel.binding(software);
        let runs = Binding::IntegerTexture(wgpu::TextureViewDimension::D2);
        let perspective = ("PERSPECTIVE", flag(key.perspective));
        let terms = ("TERMS", f64::from(key.terms));
        let texels = ("TEXELS", f64::from(key.texels));
        let straight = ("STRAIGHT", flag(key.rays == RayKind::Straight));
        if let Voxel::Color { .. } = key.voxel {
            let intermediate = Binding::StorageTexture(FORMAT, wgpu::TextureViewDimension::D2);
            let entry = if key.rays == RayKind::Shared { "blocked" } else { "single" };
            let white = ("WHITE", flag(key.model == Model::Xray));
            let resampled = ("RESAMPLED", flag(key.rays == RayKind::Coarser));
            let bindings = [Binding::Uniform, volume, runs, intermediate, Binding::Write];
            return Self::new(
                context,
                shaders::GATHER,
                entry,
                &bindings,
                &[perspective, terms, texels, straight, white, resampled, ("CURVED", flag(key.curved))],
            );
        }
        let shader = match (key.voxel, software) {
            (Voxel::Scalar, true) => shaders::GATHER_SCALARS_SOFTWARE,
            (Voxel::Scalar, false) => shaders::GATHER_SCALARS,
            _ => shaders::GATHER_GRADIENTS,
        };
        let maximum = ("MAXIMUM", flag(key.model == Model::Mip));
        let lights = ("LIGHTS", f64::from(key.lights));
        let transfer = Binding::ReadTexture(wgpu::TextureFormat::Rgba32Float);
        let bindings = [Binding::Uniform, volume, runs, Binding::Write, Binding::Uniform, transfer];
        let scalars = ("SCALARS", 1.0);
        let crowded = ("CROWDED", flag(key.crowded));
        Self::new(
            context,
            shader,
            "gather",
            &bindings,
            &[perspective, terms, texels, straight, scalars, maximum, lights, crowded],
        )
    }
}

/// Marches the rays along one principal axis.
pub(super) fn march(
    recorder: &mut Recorder<'_>,
    skip: &Stage,
    gather: &Stage,
    packed: &Packed,
    uniforms: &layout::Rays,
    targets: &Targets<'_>,
) {
    let runs = find_runs(recorder, skip, packed, uniforms, targets.rays);
    let rays = targets.rays.as_entire_binding();
    let mut resources = vec![rays, texture_view(&packed.volume), texture_view(&runs)];
    let pixels = targets.pixels.as_entire_binding();
    match targets.transfer {
        Some(table) => resources.extend([pixels, targets.lighting.as_entire_binding(), texture_view(&table.texture)]),
        None => resources.extend([texture_view(targets.intermediate), pixels]),
    }
    let group = bind(recorder.context, "gather", &gather.layout, &resources);
    let [across, down] = uniforms.tiles;
    recorder.dispatch("gather", &gather.pipeline, &group, &[], [across, down, phases(uniforms)]);
}

/// For each tile of rays, the runs of planes in which they can meet a voxel.
pub(super) fn find_runs(
    recorder: &mut Recorder<'_>,
    skip: &Stage,
    packed: &Packed,
    uniforms: &layout::Rays,
    rays: &wgpu::Buffer,
) -> wgpu::TextureView {
    let context = recorder.context;
    let [across, down] = uniforms.tiles;
    let rows = (across * down * phases(uniforms) * uniforms.run_slots).div_ceil(RUN_ROW);
    let runs = texture(context, "skip.runs", wgpu::TextureFormat::Rg32Uint, [RUN_ROW, rows]);
    let resources = [rays.as_entire_binding(), texture_view(&packed.occupied), texture_view(&runs)];
    let group = bind(context, "skip", &skip.layout, &resources);
    let workgroups = [across.div_ceil(TILE), down.div_ceil(TILE), phases(uniforms)];
    recorder.dispatch("skip", &skip.pipeline, &group, &[], workgroups);
    runs
}

/// Interleaved tiles that cover the same area.
fn phases(uniforms: &layout::Rays) -> u32 {
    uniforms.phases.into_iter().product()
}
