//! skip and gather: the march of rays from voxel plane to voxel plane, past empty macrocells. See shaders/skip.wgsl,
//! shaders/gather.wgsl and shaders/gather_scalars.wgsl.

use super::pack::{Packed, Voxel};
use super::resample::FORMAT;
use super::{Block, RayKind, TilesKey};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::{self, TILE};
use crate::gpu::light_volume::PostShading;
use crate::gpu::pipeline::{self, Binding, bind, compute, flag, module, texture_view};
use crate::gpu::recorder::Recorder;
use crate::gpu::shaders;
use crate::settings::Model;

/// The bindings of `skip`.
const SKIP: [Binding; 3] = [Binding::Uniform, Binding::IntegerTexture(wgpu::TextureViewDimension::D3), Binding::Write];

/// A pipeline and the layout of what it is bound to.
pub(super) struct Stage {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

/// What rays of classified voxels write to beside the picture.
pub(super) enum RayTarget {
    /// Written if rays do not go through pixels; read by `prefilter`.
    Image(wgpu::TextureView),
    /// What the rays of pixels have gathered in the layers before.
    Before(wgpu::Buffer),
}

/// What rays write to, and what they are lit and classified by.
pub(super) struct Targets<'a> {
    /// The uniforms of the rays.
    pub(super) rays: &'a wgpu::Buffer,
    pub(super) state: &'a RayTarget,
    /// The picture, to which every ray of a pixel adds.
    pub(super) pixels: &'a wgpu::Buffer,
    pub(super) lighting: &'a wgpu::Buffer,
    pub(super) post: Option<&'a PostShading>,
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
        Self::new(context, shaders::SKIP, "skip", &SKIP, &[("PERSPECTIVE", flag(key.perspective))])
    }

    /// `skip` of the tiles of pixels that have rays of their own beside an intermediate image.
    fn skip_refined(context: &Context, key: TilesKey) -> Self {
        let [rays, occupied, runs] = SKIP;
        let bindings = [rays, occupied, runs, Binding::Read, Binding::Write];
        Self::new(context, shaders::SKIP, "skip_refined", &bindings, &[("PERSPECTIVE", flag(key.perspective))])
    }

    /// The rays of these pixels.
    fn refine(context: &Context, key: TilesKey) -> Self {
        let volume = key.voxel.binding(context.info.is_software());
        let bindings = [Binding::Uniform, volume, Binding::Read, Binding::Read, Binding::Write, Binding::Read];
        let constants = [&key.constants()[..], &[response(key), curved(key)]].concat();
        Self::new(context, shaders::GATHER, "refine", &bindings, &constants)
    }

    pub(super) fn gather(context: &Context, key: TilesKey) -> Self {
        if let Voxel::Color { .. } = key.voxel { Self::of_colors(context, key) } else { Self::of_scalars(context, key) }
    }

    fn of_colors(context: &Context, key: TilesKey) -> Self {
        let image = Binding::StorageTexture(FORMAT, wgpu::TextureViewDimension::D2);
        let (entry, state) = match key.rays {
            RayKind::Shared => ("blocked", image),
            RayKind::Layered => ("layer", Binding::Write),
            RayKind::StraightBlocks(_) => ("straight", image),
            _ => ("single", image),
        };
        let volume = key.voxel.binding(context.info.is_software());
        let bindings = [Binding::Uniform, volume, Binding::Read, state, Binding::Write];
        let resampled = ("RESAMPLED", flag(key.rays == RayKind::Coarser));
        let layered = ("LAYERED", flag(key.rays == RayKind::Layered));
        let mut constants =
            [&key.constants()[..], &[straight(key), response(key), resampled, curved(key), layered]].concat();
        if let RayKind::StraightBlocks(Block { across, rows }) = key.rays {
            constants.extend([("ACROSS", f64::from(across)), ("ROWS", f64::from(rows))]);
        }
        Self::new(context, shaders::GATHER, entry, &bindings, &constants)
    }

    fn of_scalars(context: &Context, key: TilesKey) -> Self {
        let software = context.info.is_software();
        let shader = match (key.voxel, software) {
            (Voxel::Scalar, true) => shaders::GATHER_SCALARS_SOFTWARE,
            (Voxel::Scalar, false) => shaders::GATHER_SCALARS,
            _ => shaders::GATHER_GRADIENTS,
        };
        let transfer = Binding::ReadTexture(wgpu::TextureFormat::Rgba32Float);
        let light = Binding::FilteredTexture(wgpu::TextureViewDimension::D3);
        let volume = key.voxel.binding(software);
        let [uniform, read, write] = [Binding::Uniform, Binding::Read, Binding::Write];
        let bindings = [uniform, volume, read, write, uniform, transfer, light, Binding::Sampler];
        let constants = [
            straight(key),
            ("SCALARS", 1.0),
            ("MAXIMUM", flag(matches!(key.model, Model::Mip | Model::Minip))),
            ("MEAN", flag(key.model == Model::Average)),
            ("DEPTH_CODED", flag(key.depth_coded)),
            ("ATTENUATED", flag(key.attenuated)),
            ("LIGHTS", f64::from(key.lights)),
            ("POINT_LIGHTS", flag(key.point_lights)),
            ("CROWDED", flag(key.crowded)),
            ("GRADIENT_OPACITY", flag(key.thins)),
            ("SHADOWS", flag(key.post_shadows)),
        ];
        Self::new(context, shader, "gather", &bindings, &[&key.constants()[..], &constants].concat())
    }
}

/// An override constant and its value.
type Constant = (&'static str, f64);

impl TilesKey {
    /// What all stages of rays have in common.
    fn constants(self) -> [Constant; 6] {
        [
            ("PERSPECTIVE", flag(self.perspective)),
            ("TERMS", f64::from(self.terms)),
            ("TEXELS", f64::from(self.texels)),
            ("GROWN", flag(self.grown)),
            ("REACH", f64::from(self.reach)),
            ("CLIP_PLANES", f64::from(self.clip_planes)),
        ]
    }
}

fn straight(key: TilesKey) -> Constant {
    ("STRAIGHT", flag(key.rays == RayKind::Straight))
}

fn response(key: TilesKey) -> Constant {
    ("RESPONSE", f64::from(key.response))
}

fn curved(key: TilesKey) -> Constant {
    ("CURVED", flag(key.curved))
}

/// Marches the rays along one principal axis.
pub(super) fn march(
    recorder: &mut Recorder<'_>,
    skip: &Stage,
    gather: &Stage,
    packed: &Packed,
    uniforms: &layout::Rays,
    targets: &Targets<'_>,
) -> Result<()> {
    let runs = find_runs(recorder, skip, packed, uniforms, targets.rays)?;
    let rays = targets.rays.as_entire_binding();
    let mut resources = vec![rays, texture_view(&packed.volume), runs.as_entire_binding()];
    let pixels = targets.pixels.as_entire_binding();
    match targets.post {
        Some(PostShading { table, light, .. }) => resources.extend([
            pixels,
            targets.lighting.as_entire_binding(),
            texture_view(&table.texture),
            texture_view(&light.texture),
            wgpu::BindingResource::Sampler(&light.sampler),
        ]),
        None => {
            let state = match targets.state {
                RayTarget::Image(image) => texture_view(image),
                RayTarget::Before(buffer) => buffer.as_entire_binding(),
            };
            resources.extend([state, pixels]);
        }
    }
    let group = bind(recorder.context, "gather", &gather.layout, &resources);
    let [across, down] = uniforms.tiles;
    recorder.dispatch("gather", &gather.pipeline, &group, &[], [across, down, phases(uniforms)]);
    Ok(())
}

/// For each tile of rays, the runs of planes in which they can meet a voxel.
pub(super) fn find_runs(
    recorder: &mut Recorder<'_>,
    skip: &Stage,
    packed: &Packed,
    uniforms: &layout::Rays,
    rays: &wgpu::Buffer,
) -> Result<wgpu::Buffer> {
    let runs = runs_of(recorder.context, uniforms)?;
    let resources = [rays.as_entire_binding(), texture_view(&packed.occupied), runs.as_entire_binding()];
    let group = bind(recorder.context, "skip", &skip.layout, &resources);
    recorder.dispatch("skip", &skip.pipeline, &group, &[], tiles_of(uniforms));
    Ok(runs)
}

/// Room for the runs of every tile.
fn runs_of(context: &Context, uniforms: &layout::Rays) -> Result<wgpu::Buffer> {
    let [across, down] = uniforms.tiles;
    let runs = [across, down, phases(uniforms), uniforms.run_slots].into_iter().map(u64::from).product::<u64>();
    context.buffer("skip.runs", 8 * runs, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC)
}

/// Workgroups of `skip`.
fn tiles_of(uniforms: &layout::Rays) -> [u32; 3] {
    let [across, down] = uniforms.tiles;
    [across.div_ceil(TILE), down.div_ceil(TILE), phases(uniforms)]
}

/// Interleaved tiles that cover the same area.
fn phases(uniforms: &layout::Rays) -> u32 {
    uniforms.phases.into_iter().product()
}

/// The pipelines for the rays of pixels that intermediate images do not show well enough.
pub(super) struct Refiner {
    skip: Stage,
    refine: Stage,
}

impl Refiner {
    pub(super) fn new(context: &Context, key: TilesKey) -> Self {
        Self { skip: Stage::skip_refined(context, key), refine: Stage::refine(context, key) }
    }

    /// Adds these rays to the pixels, each with its share in `refinement`. `rays` holds their uniforms.
    pub(super) fn run(
        &self,
        recorder: &mut Recorder<'_>,
        packed: &Packed,
        uniforms: &layout::Rays,
        rays: &wgpu::Buffer,
        pixels: &wgpu::Buffer,
        refinement: &wgpu::Buffer,
    ) -> Result<()> {
        let context = recorder.context;
        let runs = runs_of(context, uniforms)?;
        // Four words, and one for each tile, in whole vectors of the shader; zeros at first.
        let words = 4 + (u64::from(uniforms.tiles[0]) * u64::from(uniforms.tiles[1])).next_multiple_of(4);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT;
        let refined = context.buffer("refine.tiles", 4 * words, usage)?;
        let rays = rays.as_entire_binding();
        let mut resources = vec![rays.clone(), texture_view(&packed.occupied), runs.as_entire_binding()];
        resources.extend([refinement.as_entire_binding(), refined.as_entire_binding()]);
        let group = bind(context, "skip", &self.skip.layout, &resources);
        recorder.dispatch("skip", &self.skip.pipeline, &group, &[], tiles_of(uniforms));
        let resources = [
            rays,
            texture_view(&packed.volume),
            runs.as_entire_binding(),
            refinement.as_entire_binding(),
            pixels.as_entire_binding(),
            refined.as_entire_binding(),
        ];
        let group = bind(context, "refine", &self.refine.layout, &resources);
        recorder.dispatch_indirect("refine", &self.refine.pipeline, &group, &refined);
        Ok(())
    }
}
