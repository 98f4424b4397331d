//! The interface of painters. `choice.rs` chooses one.
//!
//! A painter is a folder beside this file with the functions of a [`Room`]. The painter states its refusals and its
//! needs of a scene before any work, and begins a [`Painting`] when the splats are there.

use std::sync::Arc;

use crate::error::Result;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::layout::Lighting;
use crate::gpu::light_volume::PostShading;
use crate::gpu::recorder::Recorder;
use crate::gpu::sampled_scalars::SampledScalars;
use crate::gpu::stage::Constant;
use crate::gpu::store::Store;
use crate::gpu::view::{ViewGeometry, Weights};
use crate::gpu::voxels::Voxels;
use crate::image::{DepthMap, Region};
use crate::prepare::levels::ScalarNeed;
use crate::settings::{Model, Settings};
use crate::stats::PainterStats;

/// The share of a family of rays in a pixel, given its column and row.
pub(crate) type FamilyShare<'a> = Box<dyn Fn([u32; 2]) -> f64 + 'a>;

/// The functions of a painter, in the order in which they are called.
pub(crate) struct Room {
    /// Returns why the painter does not draw a picture, as a sentence; `None` if it does, unless `begin` refuses.
    pub(crate) refusal: fn(&ViewGeometry, &Settings) -> Option<String>,
    /// Returns the largest distance beyond the cuts of a brick of its sheets or slabs, and of voxels that take part in
    /// its partial picture; both in voxels along each axis.
    pub(crate) reach: fn(&ViewGeometry, &Settings) -> [f64; 2],
    /// Returns the families of rays of a picture. The partial pictures of each family are merged on their own, because
    /// each has slabs of its own; the shares of a pixel add up to 1.
    pub(crate) families: for<'a> fn(&'a ViewGeometry) -> Vec<FamilyShare<'a>>,
    /// Returns how far the scalars of a post-shaded scene must reach.
    pub(crate) need: fn(&ViewGeometry, &Settings, Weights) -> ScalarNeed,
    /// Whether the painter draws cells of several levels as layers of one picture, coarser ones farther from the eye.
    pub(crate) layers: bool,
    /// Whether the painter draws lists of splats.
    pub(crate) lists: bool,
    /// Begins a picture of its nearest layer and the layers behind it (none without `layers`).
    pub(crate) begin: for<'a> fn(Job<'a>, Vec<Job<'a>>) -> Result<Begun<'a>>,
}

/// A picture to paint: scene, view and settings.
#[derive(Clone, Copy)]
pub(crate) struct Job<'a> {
    pub(crate) context: &'a Context,
    /// The pipelines of the renderer.
    pub(crate) pipelines: &'a Cache,
    /// The resources that painters made of the scene for earlier pictures.
    pub(crate) kept: &'a Cache,
    pub(crate) view: &'a ViewGeometry,
    pub(crate) settings: &'a Settings,
    /// The visible voxels of a pre-shaded scene.
    pub(crate) voxels: Option<&'a Arc<Voxels>>,
    /// The splats of the scene, for painters with [`Room::lists`].
    pub(crate) lists: &'a [Store],
    /// The scalars of a post-shaded scene, for painters whose [`ScalarNeed::samples`] permits it, and the number that
    /// distinguishes them from others.
    pub(crate) scalars: Option<&'a (Arc<SampledScalars>, u64)>,
    /// Whether the device has no room for the scalars.
    pub(crate) is_outgrown: bool,
    pub(crate) weights: Weights,
    /// The tables that classify and light scalars; `None` for classified voxels.
    pub(crate) post: Option<&'a PostShading>,
    /// The largest factor by which reconstruction magnifies scalars; `None`: lists of splats serve other transfer
    /// functions too.
    pub(crate) magnification: Option<f64>,
    /// The number of layers of the lattice beyond the faces of the volume.
    pub(crate) padding: u32,
    pub(crate) depths: Depths<'a>,
    /// The largest number of pixels that quads may cover, summed over all passes.
    pub(crate) most_fragments: f64,
}

/// The depths that a picture reads and writes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Depths<'a> {
    /// The solids that end rays.
    pub(crate) solids: Option<&'a DepthMap>,
    /// Whether pixels are the depths at which rays have lost half of their light, as in shaders/common/half_depth.wgsl.
    pub(crate) halves: bool,
}

impl Job<'_> {
    /// Returns the number of splats.
    pub(crate) fn splats(&self) -> u64 {
        let listed: u64 = self.lists.iter().map(|store| u64::from(store.count)).sum();
        let voxels = self.voxels.map_or(listed, |voxels| voxels.count());
        voxels + self.scalars.map_or(0, |(scalars, _)| scalars.count())
    }

    /// Returns whether empty space is visible: places without splats have the transfer function's base.
    pub(crate) fn base_shows(&self) -> bool {
        self.post.is_some_and(|post| post.table.invisible[0] > post.table.invisible[1])
    }

    /// Returns the number of isosurfaces.
    pub(crate) fn isosurfaces(&self) -> u32 {
        self.post.map_or(0, |post| post.table.surfaces)
    }

    /// Returns whether clipping planes or solids cut rays.
    pub(crate) fn is_cut(&self) -> bool {
        !self.view.clip.is_empty() || self.depths.solids.is_some()
    }

    /// Uploads the depths of solids in the pixels of a region, for shaders; without solids a buffer to be bound.
    pub(crate) fn solid_depths(&self, region: Region) -> Result<wgpu::Buffer> {
        let Some(solids) = self.depths.solids else {
            return self.context.buffer("solids", 0, wgpu::BufferUsages::STORAGE);
        };
        let depths = solids.for_shaders(&self.view.camera, self.view.unit, region)?;
        self.context.upload("solids", bytemuck::cast_slice(&depths), wgpu::BufferUsages::STORAGE)
    }

    /// Returns material and lights for shaders.
    pub(crate) fn lighting(&self) -> Lighting {
        let faintest = self.post.map_or(0.0, |post| post.table.faintest);
        Lighting { faintest, ..self.view.lighting(self.settings.lighting.as_ref()) }
    }

    /// Returns the override constants that both painters declare.
    pub(crate) fn constants(&self) -> Vec<Constant> {
        let Self { view, settings, post, depths, .. } = *self;
        let lit_scalars = settings.is_post_shaded() && settings.lighting.is_some();
        let shadows = post.map_or(settings.casting().is_some(), |post| post.shadows);
        vec![
            ("PERSPECTIVE", view.is_perspective().into()),
            ("BRICK", view.held.is_some().into()),
            ("CUT_OWNED", (view.held.is_some() && settings.model == Model::Xray).into()),
            ("CLIP_PLANES", view.clip.len() as u32),
            ("CUT", self.is_cut().into()),
            ("SOLIDS", depths.solids.is_some().into()),
            ("HALF_DEPTH", depths.halves.into()),
            ("SCALARS", settings.is_post_shaded().into()),
            ("GRADIENTS", lit_scalars.into()),
            ("LIGHTS", settings.light_count()),
            ("POINT_LIGHTS", settings.has_point_lights().into()),
            ("SHADOWS", shadows.into()),
            ("GRADIENT_OPACITY", post.is_some_and(|post| post.table.thins).into()),
            ("RESPONSE", settings.xray_response().0),
            ("MAXIMUM", matches!(settings.model, Model::Mip | Model::Minip).into()),
            ("MEAN", (settings.model == Model::Average).into()),
            ("DEPTH_CODED", settings.depth_coded.into()),
            ("ATTENUATED", (settings.attenuation > 0.0).into()),
        ]
    }
}

/// A picture begun, or refused late because only the splats could tell.
pub(crate) enum Begun<'a> {
    Ready(Box<dyn Painting + 'a>),
    /// The reason for a refusal, as a sentence.
    Refused(String),
}

/// A painter at work on a picture.
pub(crate) trait Painting {
    /// Returns whether no matter can be visible.
    fn is_empty(&self) -> bool;

    /// Returns the bytes on the device for each pixel of a region, besides the pixel itself.
    fn pixel_bytes(&self) -> u32;

    /// Returns the largest number of pixels of a region that is submitted at a time, so that a GPU watchdog does not
    /// end the commands.
    fn most_pixels(&self) -> u64 {
        u64::MAX
    }

    /// Makes the pipelines of the picture, or finds those of an earlier picture.
    fn make_pipelines(&self) -> Result<()>;

    /// Paints a region and returns its pixels: premultiplied RGBA, or the values of a partial picture if the
    /// scene holds a brick; four f32 each, row by row. Only the pixels of `part`
    /// need be right; their bytes are those of the whole region's picture. The last commands may be recorded and not
    /// submitted.
    fn paint(&mut self, recorder: &mut Recorder<'_>, region: Region, part: Region) -> Result<wgpu::Buffer>;

    /// Returns the largest error of the footprints, as a fraction of their peak.
    fn footprint_error(&self) -> f64;

    /// Returns the painter's part of the picture's statistics.
    fn stats(&self) -> PainterStats;
}
