//! skip and gather: the march of rays from voxel plane to voxel plane, past empty macrocells. See shaders/skip.wgsl,
//! shaders/gather.wgsl and shaders/gather_scalars.wgsl.

use super::pack::{Packed, Voxel};
use super::{RayKind, TilesKey};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout;
use crate::gpu::light_volume::PostShading;
use crate::gpu::pipeline::Binding::{self, FilteredTexture, Read, ReadTexture, Sampler, Uniform, Write};
use crate::gpu::pipeline::texture_view;
use crate::gpu::recorder::Recorder;
use crate::gpu::shaders;
use crate::gpu::stage::{Constant, Stage};

/// The resources, besides the volume, with which rays are marched.
pub(super) struct MarchTargets<'a> {
    /// The uniforms of the rays, and the parts of kernels that they gather.
    pub(super) rays: &'a wgpu::Buffer,
    pub(super) sections: &'a wgpu::Buffer,
    /// The state of the rays behind the layers so far, if there are several.
    pub(super) state: Option<&'a wgpu::Buffer>,
    /// The picture, to which every ray of a pixel adds.
    pub(super) pixels: &'a wgpu::Buffer,
    pub(super) lighting: &'a wgpu::Buffer,
    /// The tables that classify and light scalars.
    pub(super) post: Option<&'a PostShading>,
    /// The depths of the solids in pixels.
    pub(super) solids: &'a wgpu::Buffer,
}

/// Returns the stage that finds runs.
pub(super) fn skip(context: &Context, constants: &[Constant]) -> Stage {
    Stage::new(context, shaders::SKIP, ("skip", "skip"), &[Uniform, Read, Write], constants)
}

/// Returns the stage that marches the rays of a picture.
pub(super) fn gather(context: &Context, key: &TilesKey) -> Stage {
    let is_layered = key.rays == RayKind::Layered;
    let entry = if is_layered { "layer" } else { "gather" };
    let (shader, slots) = if matches!(key.voxel, Voxel::Color { .. }) {
        (shaders::GATHER, &[Write, Read, Uniform, Read][..])
    } else {
        let transfer = ReadTexture(wgpu::TextureFormat::Rgba32Float);
        let light = FilteredTexture(wgpu::TextureViewDimension::D3);
        (shaders::GATHER_SCALARS, &[Write, Uniform, transfer, light, Sampler, Read, Read, Uniform, Read][..])
    };
    let state: &[Binding] = if is_layered { &[Write] } else { &[] };
    let slots = [&[Uniform, key.voxel.binding(), Read], slots, state].concat();
    Stage::new(context, shader, ("gather", entry), &slots, &key.constants)
}

/// Marches the rays along one principal axis.
pub(super) fn march(
    recorder: &mut Recorder<'_>,
    [skip, gather]: [&Stage; 2],
    packed: &Packed,
    uniforms: &layout::Rays,
    MarchTargets { rays, sections, state, pixels, lighting, post, solids }: MarchTargets<'_>,
) -> Result<()> {
    let runs = find_runs(recorder, skip, packed, uniforms, rays)?;
    let mut resources = vec![rays.as_entire_binding(), texture_view(&packed.volume), runs.as_entire_binding()];
    let (pixels, solids) = (pixels.as_entire_binding(), solids.as_entire_binding());
    match post {
        Some(PostShading { table, light, .. }) => {
            resources.extend([
                pixels,
                lighting.as_entire_binding(),
                texture_view(&table.texture),
                texture_view(&light.texture),
                wgpu::BindingResource::Sampler(&light.sampler),
                solids,
                packed.marks.as_entire_binding(),
                sections.as_entire_binding(),
                packed.pages.as_entire_binding(),
            ]);
        }
        None => {
            resources.extend([pixels, solids, sections.as_entire_binding(), packed.pages.as_entire_binding()]);
        }
    }
    resources.extend(state.map(wgpu::Buffer::as_entire_binding));
    let [across, down] = uniforms.tiles;
    gather.run(recorder, &resources, [across, down, 1]);
    Ok(())
}

/// Finds for each tile of rays the runs of planes in which they can meet a voxel.
pub(super) fn find_runs(
    recorder: &mut Recorder<'_>,
    skip: &Stage,
    packed: &Packed,
    uniforms: &layout::Rays,
    rays: &wgpu::Buffer,
) -> Result<wgpu::Buffer> {
    let [across, down] = uniforms.tiles;
    let count: u64 = [across, down, uniforms.run_slots].map(u64::from).into_iter().product();
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let runs = recorder.context.buffer("skip.runs", 8 * count, usage)?;
    let resources = [rays.as_entire_binding(), packed.marks.as_entire_binding(), runs.as_entire_binding()];
    // A workgroup for each tile.
    skip.run(recorder, &resources, [across, down, 1]);
    Ok(runs)
}
