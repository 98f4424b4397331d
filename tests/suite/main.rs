//! The integration tests, one binary: wgpu is linked once.

mod readers;
mod rendering;
