//! skip and gather: the march of rays from voxel plane to voxel plane, past empty macrocells. See shaders/skip.wgsl,
//! shaders/gather.wgsl and shaders/gather_scalars.wgsl.

use super::pack::{Layout, Packed, Voxel};
use super::resample::FORMAT;
use super::{RayKind, TilesKey};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::{self, TILE};
use crate::gpu::light_volume::PostShading;
use crate::gpu::pipeline::Binding::{
    self, FilteredTexture, Read, ReadTexture, Sampler, StorageTexture, Uniform, Write,
};
use crate::gpu::pipeline::texture_view;
use crate::gpu::recorder::Recorder;
use crate::gpu::shaders::{self, Shader};
use crate::gpu::stage::{Constant, Stage};

/// The bindings of `skip`, then those that `skip_refined` has beside them.
const SKIP: [Binding; 5] = [Uniform, Read, Write, Read, Write];

/// The resources that rays are marched with, besides the volume.
pub(super) struct Targets<'a> {
    /// The uniforms of the rays, and the parts of kernels that they gather.
    pub(super) rays: &'a wgpu::Buffer,
    pub(super) sections: &'a wgpu::Buffer,
    /// The intermediate image, which is written if rays do not go through pixels; or the state of the rays of pixels
    /// behind the layers so far.
    pub(super) state: wgpu::BindingResource<'a>,
    /// Whether the picture has several layers.
    pub(super) is_layered: bool,
    /// The picture, to which every ray of a pixel adds.
    pub(super) pixels: &'a wgpu::Buffer,
    pub(super) lighting: &'a wgpu::Buffer,
    /// The tables that classify and light scalars.
    pub(super) post: Option<&'a PostShading>,
    /// The depths of the solids in pixels.
    pub(super) solids: &'a wgpu::Buffer,
}

/// The stage that finds runs.
pub(super) fn skip(context: &Context, constants: &[Constant]) -> Stage {
    let entry = if skips_together(context) { "skip_together" } else { "skip" };
    Stage::new(context, shaders::SKIP, ("skip", entry), &SKIP[..3], constants)
}

/// Whether a workgroup finds the runs of one tile, rather than an invocation.
fn skips_together(context: &Context) -> bool {
    !context.is_software()
}

/// The stage that marches the rays of a picture.
pub(super) fn gather(context: &Context, key: &TilesKey) -> Stage {
    let image = StorageTexture(FORMAT, wgpu::TextureViewDimension::D2);
    let of_colors = |entry, state| (gather_of_colors(key.layout), entry, vec![state, Write, Read, Uniform, Read]);
    let of_scalars = |shader| {
        let transfer = ReadTexture(wgpu::TextureFormat::Rgba32Float);
        let light = FilteredTexture(wgpu::TextureViewDimension::D3);
        let slots = vec![Write, Uniform, transfer, light, Sampler, Read, Read, Uniform, Read];
        if key.rays == RayKind::Layered {
            (shader, "layer", [slots, vec![Write]].concat())
        } else {
            (shader, "gather", slots)
        }
    };
    let (shader, entry, slots) = match (key.voxel, key.layout, key.rays) {
        (Voxel::Scalar, Layout::Box, _) => of_scalars(shaders::GATHER_SCALARS_BOX),
        (Voxel::Scalar, Layout::Pages, _) => of_scalars(shaders::GATHER_SCALARS_PAGES),
        (Voxel::Scalar, Layout::Rows, _) => of_scalars(shaders::GATHER_SCALARS),
        (Voxel::Gradient, Layout::Box, _) => of_scalars(shaders::GATHER_GRADIENTS_BOX),
        (Voxel::Gradient, Layout::Pages, _) => of_scalars(shaders::GATHER_GRADIENTS_PAGES),
        (Voxel::Gradient, Layout::Rows, _) => of_scalars(shaders::GATHER_GRADIENTS),
        (_, _, RayKind::Shared | RayKind::StraightBlocks(_)) => of_colors("eight", image),
        (_, _, RayKind::Layered) => of_colors("layer", Write),
        _ => of_colors("single", image),
    };
    let slots = [&[Uniform, key.voxel.binding(key.layout), Read][..], &slots].concat();
    Stage::new(context, shader, ("gather", entry), &slots, &key.constants)
}

/// The shader that marches through colours.
fn gather_of_colors(layout: Layout) -> Shader {
    match layout {
        Layout::Rows => shaders::GATHER,
        Layout::Box => shaders::GATHER_BOX,
        Layout::Pages => shaders::GATHER_PAGES,
    }
}

/// Marches the rays along one principal axis.
pub(super) fn march(
    recorder: &mut Recorder<'_>,
    [skip, gather]: [&Stage; 2],
    packed: &Packed,
    uniforms: &layout::Rays,
    Targets { rays, sections, state, is_layered, pixels, lighting, post, solids }: Targets<'_>,
) -> Result<()> {
    let runs = find_runs(recorder, skip, packed, uniforms, rays, &[])?;
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
            if is_layered {
                resources.push(state);
            }
        }
        None => {
            resources.extend([state, pixels, solids, sections.as_entire_binding(), packed.pages.as_entire_binding()])
        }
    }
    let [across, down] = uniforms.tiles;
    gather.run(recorder, &resources, [across, down, phases(uniforms)]);
    Ok(())
}

/// Finds for each tile of rays the runs of planes in which they can meet a voxel. `others` are further bindings of the
/// stage.
pub(super) fn find_runs(
    recorder: &mut Recorder<'_>,
    skip: &Stage,
    packed: &Packed,
    uniforms: &layout::Rays,
    rays: &wgpu::Buffer,
    others: &[wgpu::BindingResource<'_>],
) -> Result<wgpu::Buffer> {
    let [across, down] = uniforms.tiles;
    let tiles = [across, down, phases(uniforms)];
    let count: u64 = tiles.into_iter().chain([uniforms.run_slots]).map(u64::from).product();
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let runs = recorder.context.buffer("skip.runs", 8 * count, usage)?;
    let resources = [rays.as_entire_binding(), packed.marks.as_entire_binding(), runs.as_entire_binding()];
    // An invocation for each tile, if pixels are refined.
    let together = skips_together(recorder.context) && others.is_empty();
    let [across, down] = if together { [across, down] } else { [across, down].map(|tiles| tiles.div_ceil(TILE)) };
    let workgroups = [across, down, tiles[2]];
    skip.run(recorder, &[&resources, others].concat(), workgroups);
    Ok(runs)
}

/// The number of interleaved tiles that cover the same area.
fn phases(uniforms: &layout::Rays) -> u32 {
    uniforms.phases.into_iter().product()
}

/// The pipelines for the rays of pixels that intermediate images do not show well enough.
pub(super) struct Refiner {
    skip: Stage,
    refine: Stage,
}

impl Refiner {
    pub(super) fn new(context: &Context, key: &TilesKey) -> Self {
        let volume = key.voxel.binding(key.layout);
        let slots = [Uniform, volume, Read, Read, Write, Read, Uniform, Read];
        Self {
            skip: Stage::new(context, shaders::SKIP, ("skip", "skip_refined"), &SKIP, &key.constants),
            refine: Stage::new(context, gather_of_colors(key.layout), ("refine", "refine"), &slots, &key.constants),
        }
    }

    /// Adds these rays to the pixels, each with its share in `refinement`. `rays` holds their uniforms.
    pub(super) fn run(
        &self,
        recorder: &mut Recorder<'_>,
        packed: &Packed,
        uniforms: &layout::Rays,
        [rays, sections]: [&wgpu::Buffer; 2],
        pixels: &wgpu::Buffer,
        refinement: &wgpu::Buffer,
    ) -> Result<()> {
        // Four words, and one for each tile, in whole vectors of the shader; zeros at first.
        let words = 4 + (u64::from(uniforms.tiles[0]) * u64::from(uniforms.tiles[1])).next_multiple_of(4);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT;
        let refined = recorder.context.buffer("refine.tiles", 4 * words, usage)?;
        let others = [refinement.as_entire_binding(), refined.as_entire_binding()];
        let runs = find_runs(recorder, &self.skip, packed, uniforms, rays, &others)?;
        let resources = [
            rays.as_entire_binding(),
            texture_view(&packed.volume),
            runs.as_entire_binding(),
            refinement.as_entire_binding(),
            pixels.as_entire_binding(),
            refined.as_entire_binding(),
            sections.as_entire_binding(),
            packed.pages.as_entire_binding(),
        ];
        self.refine.run_indirect(recorder, &resources, &refined);
        Ok(())
    }
}
