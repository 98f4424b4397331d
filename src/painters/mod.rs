//! The painters: [`quads`] rasterises splats into sheets, [`tiles`] gathers them along rays.

pub(crate) mod choice;
pub(crate) mod painter;
pub(crate) mod quads;
pub(crate) mod tiles;
