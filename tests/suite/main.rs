//! The integration tests, one binary: wgpu is linked once.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a failing helper fails its test, and measured errors are printed; the lints' own exemption covers test \
              functions only"
)]

mod accuracy;
#[path = "../../src/gpu/adapter_test.rs"]
mod adapter;
mod algorithms;
mod bounds;
mod bundled;
mod camera;
mod cells;
mod classification;
mod cli;
mod clipping;
mod commands;
mod cost;
mod demos;
mod embed;
mod fuzz;
mod golden;
mod gradient_opacity;
mod hard;
mod hard_quads;
mod hostile;
mod lattices;
mod layers;
mod post_light;
mod presets;
mod projections;
mod random;
mod readers;
mod readers_dicom;
mod readers_errors;
mod rendering;
mod savings;
mod scalar_cells;
mod scenes;
mod segmentations;
mod shadows;
mod sharpness;
mod soak;
mod streaming;
mod support;
mod tiles;
mod tiles_hard;
mod tiles_rays;
mod transfer;
mod truth;
mod words;
mod zarr;
