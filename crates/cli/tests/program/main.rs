//! The tests that run the program, one binary.

#![allow(clippy::disallowed_methods, reason = "tests allow more than the last bit")]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a failing helper fails its test, and measured errors are printed; the lints' own exemption covers test \
              functions only"
)]

mod accuracy;
#[path = "../../../../src/gpu/adapter_test.rs"]
mod adapter;
mod appearance;
mod bricks;
mod cli;
mod commands;
mod hostile;
mod isosurfaces;
mod overlays;
mod remote;
mod results;
mod scenes;
mod segmentations;
#[allow(dead_code, reason = "the tests of the library use more of it")]
#[path = "../../../../tests/suite/formats/server.rs"]
mod server;
mod sheets;
mod slices;
mod solids;
#[allow(dead_code, reason = "the tests of the library use more of it")]
#[path = "../../../../tests/suite/support.rs"]
mod support;
mod words;
