//! The choice of a painter.

use super::context::Context;
use super::painter::Room;
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
    /// The painter of a picture, unless it refuses.
    pub(crate) fn new(context: &Context, settings: &Settings) -> Self {
        let (kind, reason) = match settings.painter {
            Painter::Quads(_) => (PainterKind::Quads, ASKED_FOR),
            Painter::Tiles(_) => (PainterKind::Tiles, ASKED_FOR),
            Painter::Auto => preferred(context.info.is_software(), context.blends_f32()),
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

/// The painter that [`Painter::Auto`] takes unless it refuses, and why. Sheets of half floats are what is left if it
/// does.
fn preferred(is_software: bool, blends_f32: bool) -> (PainterKind, &'static str) {
    match (is_software, blends_f32) {
        (true, _) => (PainterKind::Tiles, "the adapter is software"),
        (false, false) => (PainterKind::Tiles, "the adapter does not blend the 32-bit floats of sheets"),
        (false, true) => (PainterKind::Quads, "the adapter has a rasteriser"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn auto_takes_quads_where_hardware_blends_f32() {
        use PainterKind::{Quads, Tiles};
        let rows = [(true, true, Tiles), (true, false, Tiles), (false, true, Quads), (false, false, Tiles)];
        for (is_software, blends_f32, kind) in rows {
            assert_eq!(preferred(is_software, blends_f32).0, kind, "{is_software} {blends_f32}");
        }
    }
}
