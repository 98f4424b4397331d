//! The integration tests, one binary: wgpu is linked once.

mod cli;
mod presets;
mod readers;
mod rendering;
