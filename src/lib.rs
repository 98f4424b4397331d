//! A GPU splatting renderer for voxel volumes.

pub mod camera;
pub mod error;
mod gpu;
pub mod image;
pub mod kernel;
pub mod output;
pub mod reference;
pub mod renderer;
pub mod report;
pub mod settings;
pub mod stats;
pub mod transfer;
pub mod volume;
