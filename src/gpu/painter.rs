//! What painters have in common, and the choice between them.
//!
//! A painter is a folder beside this file with the functions of a [`Room`]: it says what it refuses and what it needs
//! of a scene before any work, and begins a [`Painting`] when the splats are there.

use super::context::Context;
use super::pipeline::Pipelines;
use super::recorder::Recorder;
use super::store::Store;
use super::transfer::TransferTable;
use super::view::{Region, ScalarNeed, ViewGeometry, Weights};
use super::{quads, tiles};
use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::settings::{Painter, Settings};
use crate::stats::PainterStats;

/// The painters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PainterKind {
    Quads,
    Tiles,
}

impl PainterKind {
    pub(crate) fn room(self) -> Room {
        match self {
            Self::Quads => quads::ROOM,
            Self::Tiles => tiles::ROOM,
        }
    }
}

/// What a painter is asked, in this order.
pub(crate) struct Room {
    /// Why it does not draw a picture, as a sentence; `None`: it does, unless it finds out late.
    pub(crate) refusal: fn(&Context, &ViewGeometry, &Settings) -> Option<String>,
    /// How far the scalars of a post-shaded scene must reach.
    pub(crate) need: fn(&ViewGeometry, &Settings, Weights) -> ScalarNeed,
    /// Begins a picture.
    pub(crate) begin: for<'a> fn(Job<'a>) -> Result<Begun<'a>>,
}

/// A picture to paint.
#[derive(Clone, Copy)]
pub(crate) struct Job<'a> {
    pub(crate) context: &'a Context,
    pub(crate) pipelines: &'a Pipelines,
    pub(crate) view: &'a ViewGeometry,
    pub(crate) settings: &'a Settings,
    pub(crate) scene: &'a Scene,
    /// The splats.
    pub(crate) stores: &'a [Store],
    pub(crate) weights: Weights,
    /// What scalars are classified by; `None` for classified voxels.
    pub(crate) transfer: Option<&'a TransferTable>,
    /// Layers of the lattice beyond the faces of the volume.
    pub(crate) padding: u32,
}

impl Job<'_> {
    pub(super) fn splats(&self) -> u64 {
        self.stores.iter().map(|store| u64::from(store.count)).sum()
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

    /// Makes the pipelines that the picture takes, or finds those of a picture before.
    fn make_pipelines(&self) -> Result<()>;

    /// Paints a region. The last commands may be recorded and not submitted.
    fn paint(&mut self, recorder: &mut Recorder<'_>, region: Region) -> Result<Painted>;

    /// Largest error of the footprints, as a fraction of their peak.
    fn footprint_error(&self) -> f64;

    /// What it took.
    fn stats(&self) -> PainterStats;
}

/// The pixels of a region on the device.
pub(crate) struct Painted {
    /// Premultiplied RGBA, four f32 a pixel, row by row.
    pub(crate) pixels: wgpu::Buffer,
    /// Pixels around the region that the buffer holds besides.
    pub(crate) margin: u32,
}

/// A painter and the reason for it.
pub(crate) struct Choice {
    pub(crate) kind: PainterKind,
    pub(crate) reason: String,
}

impl Choice {
    /// The painter of a picture, before any work.
    pub(crate) fn new(context: &Context, view: &ViewGeometry, settings: &Settings) -> Result<Self> {
        let asked = |kind| Ok(Self { kind, reason: "asked for".to_owned() });
        let kind = match settings.painter {
            Painter::Quads(_) => return asked(PainterKind::Quads),
            Painter::Tiles(_) => PainterKind::Tiles,
            Painter::Auto if context.info.is_software() => PainterKind::Tiles,
            Painter::Auto => {
                return Ok(Self { kind: PainterKind::Quads, reason: "the adapter has a rasteriser".to_owned() });
            }
        };
        match ((kind.room().refusal)(context, view, settings), settings.painter) {
            (Some(reason), _) => Self::instead(settings, reason),
            (None, Painter::Auto) => Ok(Self { kind, reason: "the adapter is software".to_owned() }),
            (None, _) => asked(kind),
        }
    }

    /// The painter in place of one that refused: the one that draws every picture, unless the other was asked for.
    pub(crate) fn instead(settings: &Settings, reason: String) -> Result<Self> {
        match settings.painter {
            Painter::Auto => Ok(Self { kind: PainterKind::Quads, reason }),
            _ => Err(Error::Setting { name: "painter", reason }),
        }
    }
}
