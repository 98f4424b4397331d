//! skip and gather: rays from plane to plane. See shaders/skip.wgsl, shaders/gather.wgsl and shaders/gather_scalars.wgsl.

use super::super::context::Context;
use super::super::layout::{self, RUN_ROW};
use super::super::pipeline::{Slot, bind, compute, dispatch, flag, layout, module, whole};
use super::super::shaders;
use super::super::timing::Timing;
use super::super::transfer::TransferTable;
use super::enlarge::PICTURE;
use super::pack::{Packed, Voxel};
use super::{RayKind, TilesKey, texture};
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
    fn new(context: &Context, shader: shaders::Shader, entry: &str, slots: &[Slot], constants: &[(&str, f64)]) -> Self {
        let layout = layout(context, shader.name, wgpu::ShaderStages::COMPUTE, slots);
        let pipeline = compute(context, &module(context, shader), shader.name, entry, &layout, constants);
        Self { layout, pipeline }
    }

    pub(super) fn skip(context: &Context, key: TilesKey) -> Self {
        let runs = Slot::StorageTexture(wgpu::TextureFormat::Rg32Uint, wgpu::TextureViewDimension::D2);
        let slots = [Slot::Uniform, Slot::IntegerTexture(wgpu::TextureViewDimension::D3), runs];
        Self::new(context, shaders::SKIP, "skip", &slots, &[("PERSPECTIVE", flag(key.perspective))])
    }

    pub(super) fn gather(context: &Context, key: TilesKey) -> Self {
        let volume = Slot::ReadTexture(key.voxel.format());
        let runs = Slot::IntegerTexture(wgpu::TextureViewDimension::D2);
        let perspective = ("PERSPECTIVE", flag(key.perspective));
        let terms = ("TERMS", f64::from(key.terms));
        let texels = ("TEXELS", f64::from(key.texels));
        let straight = ("STRAIGHT", flag(key.rays == RayKind::Straight));
        if let Voxel::Color { .. } = key.voxel {
            let picture = Slot::StorageTexture(PICTURE, wgpu::TextureViewDimension::D2);
            let entry = if key.rays == RayKind::Shared { "blocked" } else { "single" };
            let white = ("WHITE", flag(key.model == Model::Xray));
            let enlarged = ("RESAMPLED", flag(key.rays == RayKind::Coarser));
            let slots = [Slot::Uniform, volume, runs, picture, Slot::Write];
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
        let transfer = Slot::ReadTexture(wgpu::TextureFormat::Rgba32Float);
        let slots = [Slot::Uniform, volume, runs, Slot::Write, Slot::Uniform, transfer];
        let scalars = ("SCALARS", 1.0);
        Self::new(context, shader, "gather", &slots, &[perspective, terms, texels, straight, scalars, maximum, lights])
    }
}

/// Follows the rays of one look.
pub(super) fn follow(
    context: &Context,
    encoder: &mut wgpu::CommandEncoder,
    timing: &mut Timing,
    [skip, gather]: [&Stage; 2],
    packed: &Packed,
    raster: &layout::Rays,
    targets: &Targets<'_>,
) {
    let [across, down] = raster.tiles;
    let phases = raster.phases.into_iter().product::<u32>();
    let tiles = across * down * phases;
    let rows = tiles.div_ceil(RUN_ROW) * raster.run_slots;
    let runs = texture(context, "skip.runs", wgpu::TextureFormat::Rg32Uint, [tiles.min(RUN_ROW), rows]);
    let frame = targets.frame.as_entire_binding();
    let resources = [frame.clone(), whole(&packed.occupied), whole(&runs)];
    let group = bind(context, "skip", &skip.layout, &resources);
    let workgroups = [across.div_ceil(8), down.div_ceil(8), phases];
    dispatch(context, encoder, timing, "skip", &skip.pipeline, &group, &[], workgroups);
    let mut resources = vec![frame, whole(&packed.volume), whole(&runs)];
    let pixels = targets.pixels.as_entire_binding();
    match targets.transfer {
        Some(table) => resources.extend([pixels, targets.lighting.as_entire_binding(), whole(&table.texture)]),
        None => resources.extend([whole(targets.picture), pixels]),
    }
    let group = bind(context, "gather", &gather.layout, &resources);
    let workgroups = [across, down, phases];
    dispatch(context, encoder, timing, "gather", &gather.pipeline, &group, &[], workgroups);
}
