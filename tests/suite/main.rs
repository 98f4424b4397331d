//! The integration tests, one binary: wgpu is linked once.

#![allow(clippy::disallowed_methods, reason = "tests allow more than the last bit")]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a failing helper fails its test, and measured errors are printed; the lints' own exemption covers test \
              functions only"
)]

#[path = "../../src/gpu/adapter_test.rs"]
mod adapter;
mod bricks;
mod constants;
mod documents;
mod house;
mod support;
mod truth;

/// The root of the repository.
fn root() -> &'static std::path::Path {
    std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Accepted files, and refused files.
mod formats {
    mod dicom;
    pub(crate) mod fixtures;
    mod lying_headers;
    mod peers;
    mod remote;
    mod reported;
    mod segmentations;
    pub(crate) mod server;
    mod streaming;
    mod transfer_files;
    mod zarr;
}

/// Contents of pictures by any painter: models, kernels, cameras, transfer functions, clips, layers.
mod model {
    mod algorithms;
    mod band_limited;
    mod camera;
    mod classification;
    mod clipping;
    mod demos;
    mod gradient_opacity;
    mod kinds;
    mod lattices;
    pub(crate) mod layers;
    mod overlays;
    mod presets;
    mod projections;
    mod reconstruction;
    mod rendering;
    mod sections;
    mod sharpness;
    mod solids;
    mod suggestions;
}

/// Painters: precision, limits, cost, devices, golden pictures.
mod painters {
    mod accuracy;
    mod cost;
    pub(crate) mod embed;
    mod f32_limits;
    mod golden;
    mod host;
    mod isosurfaces;
    mod isosurfaces_in_layers;
    mod plumbing;
    mod savings;
    pub(crate) mod tiles;
    mod tiles_limits;
    mod tiles_rays;
}

/// Cells in place of several voxels.
mod levels {
    pub(crate) mod colors;
    mod scalars;
}

/// Light on scalars, and shadows.
mod light {
    mod grain;
    mod scalars;
    mod shadows;
}

/// Random scenes, hard cases, damaged files and long turntables.
mod hostile {
    mod bounds;
    pub(crate) mod fuzz;
    mod hard_cases;
    mod random;
    mod soak;
}
