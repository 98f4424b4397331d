//! The integration tests, one binary: wgpu is linked once.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a failing helper fails its test; the lints' own exemption covers test functions only"
)]

#[path = "../../src/gpu/adapter_test.rs"]
mod adapter;
mod algorithms;
mod camera;
mod cli;
mod demos;
mod embed;
mod fuzz;
mod golden;
mod hard_quads;
mod hostile;
mod presets;
mod readers;
mod readers_errors;
mod rendering;
mod savings;
mod streaming;
mod support;
mod tiles;
mod truth;
