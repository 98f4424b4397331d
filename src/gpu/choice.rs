//! The choice of a painter.

use super::context::Context;
use super::painter::Room;
use super::view::ViewGeometry;
use super::{quads, tiles};
use crate::error::{Error, Result};
use crate::settings::{Painter, Settings};

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
            Painter::Auto if !context.blends_f32() => PainterKind::Tiles,
            Painter::Auto => {
                return Ok(Self { kind: PainterKind::Quads, reason: "the adapter has a rasteriser".to_owned() });
            }
        };
        match ((kind.room().refusal)(context, view, settings), settings.painter) {
            (Some(reason), _) => Self::instead(context, settings, reason),
            (None, Painter::Auto) if context.info.is_software() => {
                Ok(Self { kind, reason: "the adapter is software".to_owned() })
            }
            (None, Painter::Auto) => Ok(Self { kind, reason: "the adapter does not blend 32-bit floats".to_owned() }),
            (None, _) => asked(kind),
        }
    }

    /// The painter in place of one that refused: the one that draws every picture, unless the other was asked for.
    pub(crate) fn instead(context: &Context, settings: &Settings, reason: String) -> Result<Self> {
        match settings.painter {
            Painter::Auto if context.blends_f32() => Ok(Self { kind: PainterKind::Quads, reason }),
            Painter::Auto => {
                let reason = format!("{reason}; the adapter does not blend 32-bit floats: sheets are half floats");
                Ok(Self { kind: PainterKind::Quads, reason })
            }
            _ => Err(Error::Setting { name: "painter", reason }),
        }
    }
}
