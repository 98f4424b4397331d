//! The choice of a painter.

use super::painter::Room;
use super::{quads, tiles};
use crate::error::{Error, Result};
use crate::gpu::context::Context;
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
    /// The painter of a picture, unless it refuses.
    pub(crate) fn new(context: &Context, settings: &Settings) -> Self {
        let (kind, reason) = match settings.painter {
            Painter::Quads(_) => (PainterKind::Quads, ASKED_FOR),
            Painter::Tiles(_) => (PainterKind::Tiles, ASKED_FOR),
            Painter::Auto => (PainterKind::Tiles, preference(context.info.is_software())),
        };
        Self::of(context, kind, reason.to_owned())
    }

    /// A painter for a reason, to which what its sheets lose is added.
    fn of(context: &Context, kind: PainterKind, mut reason: String) -> Self {
        if kind == PainterKind::Quads && !context.blends_f32() {
            reason += "; sheets are half floats, because the adapter does not blend 32-bit ones";
        }
        Self { kind, reason }
    }

    /// The painter in place of one that refused: the one that draws every picture, unless the other was asked for.
    pub(crate) fn instead(context: &Context, settings: &Settings, reason: String) -> Result<Self> {
        match settings.painter {
            Painter::Auto => Ok(Self::of(context, PainterKind::Quads, reason)),
            _ => Err(Error::Setting { name: "painter", reason }),
        }
    }
}

const ASKED_FOR: &str = "asked for";

/// Why [`Painter::Auto`] takes tiles unless it refuses.
fn preference(is_software: bool) -> &'static str {
    match is_software {
        true => "the adapter is software",
        false => "by operations and bytes, rays are expected to be faster on GPUs, of which none has been measured",
    }
}
