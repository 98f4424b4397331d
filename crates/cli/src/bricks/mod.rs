//! Pictures in bricks: `voxsplat plan`, `voxsplat brick` and `voxsplat merge`.

mod brick;
mod document;
mod merge;
mod plan;

pub(crate) use brick::run as brick;
pub(crate) use merge::run as merge;
pub(crate) use plan::run as plan;
