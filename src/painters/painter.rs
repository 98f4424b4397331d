//! What painters have in common. The choice between them is in `choice.rs`.
//!
//! A painter is a folder beside this file with the functions of a [`Room`]: it says what it refuses and what it needs
//! of a scene before any work, and begins a [`Painting`] when the splats are there.

use crate::error::Result;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::layout::Lighting;
use crate::gpu::light_volume::PostShading;
use crate::gpu::recorder::Recorder;
use crate::gpu::store::Store;
use crate::gpu::view::{ViewGeometry, Weights};
use crate::image::Region;
use crate::prepare::levels::ScalarNeed;
use crate::settings::Settings;
use crate::stats::PainterStats;

/// What a painter is asked, in this order.
pub(crate) struct Room {
    /// Why it does not draw a picture, as a sentence; `None`: it does, unless it finds out late.
    pub(crate) refusal: fn(&ViewGeometry, &Settings) -> Option<String>,
    /// How far the scalars of a post-shaded scene must reach.
    pub(crate) need: fn(&ViewGeometry, &Settings, Weights) -> ScalarNeed,
    /// Whether it draws cells of several levels as layers of one picture, coarser ones farther from the eye.
    pub(crate) layers: bool,
    /// Begins a picture of its nearest layer and of those behind it, of which there are none without `layers`.
    pub(crate) begin: for<'a> fn(Job<'a>, Vec<Job<'a>>) -> Result<Begun<'a>>,
}

/// A picture to paint.
#[derive(Clone, Copy)]
pub(crate) struct Job<'a> {
    pub(crate) context: &'a Context,
    /// Pipelines of the renderer.
    pub(crate) pipelines: &'a Cache,
    /// What painters made of the scene for pictures before.
    pub(crate) kept: &'a Cache,
    pub(crate) view: &'a ViewGeometry,
    pub(crate) settings: &'a Settings,
    /// The splats.
    pub(crate) stores: &'a [Store],
    pub(crate) weights: Weights,
    /// What scalars are classified and lit by; `None` for classified voxels.
    pub(crate) post: Option<&'a PostShading>,
    /// Layers of the lattice beyond the faces of the volume.
    pub(crate) padding: u32,
}

impl Job<'_> {
    pub(crate) fn splats(&self) -> u64 {
        self.stores.iter().map(|store| u64::from(store.count)).sum()
    }

    /// Material and lights as shaders have them.
    pub(crate) fn lighting(&self) -> Lighting {
        let faintest = self.post.map_or(0.0, |post| post.table.faintest);
        Lighting { faintest, ..self.view.lighting(self.settings.lighting.as_ref()) }
    }
}

/// A picture begun, or refused late: what decides was known only with the splats.
pub(crate) enum Begun<'a> {
    Ready(Box<dyn Painting + 'a>),
    /// Why, as a sentence.
    Refused(String),
}

/// A painter at work on a picture.
pub(crate) trait Painting {
    /// Whether nothing can show.
    fn is_empty(&self) -> bool;

    /// Bytes on the device for each pixel of a region, besides the pixel itself.
    fn pixel_bytes(&self) -> u32;

    /// The most pixels of a region that is submitted at a time, for no watchdog to end it.
    fn most_pixels(&self) -> u64 {
        u64::MAX
    }

    /// Makes the pipelines that the picture takes, or finds those of a picture before.
    fn make_pipelines(&self) -> Result<()>;

    /// Paints a region: its pixels, premultiplied RGBA, four f32 each, row by row. Only a part of it is wanted; other
    /// pixels may be anything. The bytes of the part are those of the whole region's picture there. The last commands
    /// may be recorded and not submitted.
    fn paint(&mut self, recorder: &mut Recorder<'_>, region: Region, part: Region) -> Result<wgpu::Buffer>;

    /// Largest error of the footprints, as a fraction of their peak.
    fn footprint_error(&self) -> f64;

    /// What it took.
    fn stats(&self) -> PainterStats;
}
