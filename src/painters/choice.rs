//! The choice of a painter.

use super::painter::Room;
use super::{quads, tiles};
use crate::error::{Error, Result};
use crate::gpu::context::Context;
use crate::settings::{Painter, Settings};

/// The painter of a picture.
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
pub(crate) struct PainterChoice {
    pub(crate) kind: PainterKind,
    pub(crate) reason: String,
}

impl PainterChoice {
    /// Chooses the painter of a picture; the painter may still refuse it.
    ///
    /// # Errors
    /// [`Error::Setting`] if the host engine is to draw it.
    pub(crate) fn new(context: &Context, settings: &Settings) -> Result<Self> {
        let (kind, reason) = match settings.painter {
            Painter::Quads(_) => (PainterKind::Quads, "requested"),
            Painter::Tiles => (PainterKind::Tiles, "requested"),
            Painter::Auto => (PainterKind::Tiles, EXPECTED),
            Painter::Cpu => {
                let reason = "cpu draws on no device: use a HostRenderer, or another painter";
                return Err(Error::setting("painter", reason));
            }
        };
        Ok(Self::with_precision(context, kind, reason.to_owned()))
    }

    /// Makes the choice of a painter for a reason, with a remark if its sheets are half floats.
    fn with_precision(context: &Context, kind: PainterKind, mut reason: String) -> Self {
        if kind == PainterKind::Quads && !context.blends_f32() {
            reason += "; sheets are half floats, because the adapter does not blend 32-bit ones";
        }
        Self { kind, reason }
    }

    /// Chooses the fallback for a painter that refused: quads, which refuses only isosurfaces. An error if the painter
    /// was requested.
    pub(crate) fn instead(context: &Context, settings: &Settings, reason: String) -> Result<Self> {
        match settings.painter {
            Painter::Auto => Ok(Self::with_precision(context, PainterKind::Quads, reason)),
            _ => Err(Error::Setting { name: "painter", reason }),
        }
    }
}

/// The reason for tiles.
const EXPECTED: &str = "on the GPU that was measured, an H100, rays take 0.003 to 0.8 of the time of quads";
