//! skip and gather: rays from plane to plane. See shaders/skip.wgsl, shaders/gather.wgsl and shaders/gather_scalars.wgsl.

use super::super::context::Context;
use super::super::layout::{RUN_ROW, Raster, TILE};
use super::super::pipeline::{Binding, bind, compute, flag, layout, module, texture_view};
use super::super::recorder::Recorder;
use super::super::shaders;
use super::super::transfer::TransferTable;
use super::enlarge::PICTURE;
use super::pack::{Packed, Voxel};
use super::{Rays, TilesKey, texture};
use crate::settings::Model;

/// A pipeline and the layout of what it is bound to.
pub(super) struct Stage {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

/// What rays write to, and the light they bring.
pub(super) struct Targets<'a> {
    /// The raster they start from.
    pub(super) frame: &'a wgpu::Buffer,
    /// What is enlarged later.
    pub(super) picture: &'a wgpu::TextureView,
    /// What is not.
    pub(super) pixels: &'a wgpu::Buffer,
    pub(super) lighting: &'a wgpu::Buffer,
    pub(super) transfer: Option<&'a TransferTable>,
}

impl Stage {
    fn new(
        context: &Context,
        shader: shaders::Shader,
        entry: &str,
        slots: &[Binding],
        constants: &[(&str, f64)],
    ) -> Self {
        let layout = layout(context, shader.name, wgpu::ShaderStages::COMPUTE, slots);
        let pipeline = compute(context, &module(context, shader), shader.name, entry, &layout, constants);
        Self { layout, pipeline }
    }

    pub(super) fn skip(context: &Context, key: TilesKey) -> Self {
        let runs = Binding::StorageTexture(wgpu::TextureFormat::Rg32Uint, wgpu::TextureViewDimension::D2);
        let slots = [Binding::Uniform, Binding::IntegerTexture(wgpu::TextureViewDimension::D3), runs];
        Self::new(context, shaders::SKIP, "skip", &slots, &[("PERSPECTIVE", flag(key.perspective))])
    }

    pub(super) fn gather(context: &Context, key: TilesKey) -> Self {
        let volume = Binding::ReadTexture(key.voxel.format());
        let runs = Binding::IntegerTexture(wgpu::TextureViewDimension::D2);
        let perspective = ("PERSPECTIVE", flag(key.perspective));
        let terms = ("TERMS", f64::from(key.terms));
        let texels = ("TEXELS", f64::from(key.texels));
        let straight = ("STRAIGHT", flag(key.rays == Rays::Straight));
        if let Voxel::Color { .. } = key.voxel {
            let picture = Binding::StorageTexture(PICTURE, wgpu::TextureViewDimension::D2);
            let entry = if key.rays == Rays::Shared { "blocked" } else { "single" };
            let white = ("WHITE", flag(key.model == Model::Xray));
            let enlarged = ("ENLARGED", flag(key.rays == Rays::Coarser));
            let slots = [Binding::Uniform, volume, runs, picture, Binding::Write];
            return Self::new(
                context,
                shaders::GATHER,
                entry,
                &slots,
                &[perspective, terms, texels, straight, white, enlarged],
            );
        }
        let shader = if key.voxel == Voxel::Scalar { shaders::GATHER_SCALARS } else { shaders::GATHER_GRADIENTS };
        let maximum = ("MAXIMUM", flag(key.model == Model::Mip));
        let lights = ("LIGHTS", f64::from(key.lights));
        let transfer = Binding::ReadTexture(wgpu::TextureFormat::Rgba32Float);
        let slots = [Binding::Uniform, volume, runs, Binding::Write, Binding::Uniform, transfer];
        let scalars = ("SCALARS", 1.0);
        Self::new(context, shader, "gather", &slots, &[perspective, terms, texels, straight, scalars, maximum, lights])
    }
}

/// Follows the rays of one look.
pub(super) fn follow(
    recorder: &mut Recorder<'_>,
    skip: &Stage,
    gather: &Stage,
    packed: &Packed,
    raster: &Raster,
    targets: &Targets<'_>,
) {
    let context = recorder.context;
    let [across, down] = raster.tiles;
    let phases = raster.phases.into_iter().product::<u32>();
    let tiles = across * down * phases;
    let rows = tiles.div_ceil(RUN_ROW) * raster.run_slots;
    let runs = texture(context, "skip.runs", wgpu::TextureFormat::Rg32Uint, [tiles.min(RUN_ROW), rows]);
    let frame = targets.frame.as_entire_binding();
    let resources = [frame.clone(), texture_view(&packed.occupied), texture_view(&runs)];
    let group = bind(context, "skip", &skip.layout, &resources);
    let workgroups = [across.div_ceil(TILE), down.div_ceil(TILE), phases];
    recorder.dispatch("skip", &skip.pipeline, &group, &[], workgroups);
    let mut resources = vec![frame, texture_view(&packed.volume), texture_view(&runs)];
    let pixels = targets.pixels.as_entire_binding();
    match targets.transfer {
        Some(table) => resources.extend([pixels, targets.lighting.as_entire_binding(), texture_view(&table.texture)]),
        None => resources.extend([texture_view(targets.picture), pixels]),
    }
    let group = bind(context, "gather", &gather.layout, &resources);
    let workgroups = [across, down, phases];
    recorder.dispatch("gather", &gather.pipeline, &group, &[], workgroups);
}
