//! Volumes for [voxsplat](https://docs.rs/voxsplat): samples on a lattice, and readers of their files. Needs no GPU.
//!
//! [`formats`] reads files, [`volume`] holds samples and their lattice, [`demos`] has built-in volumes, [`meshes`]
//! reads surfaces. Modules without documentation are shared with the renderer: any release may change them.
//!
//! Features, all on by default: `dicom` (with JPEG), `hdf5` (HDF5 and NetCDF), `jpeg2000` (in DICOM), `tiff`, `vtk` and
//! `zarr`. One more is off by default: `remote`, for sources at urls.

#![cfg_attr(docsrs, feature(doc_cfg))]
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests allow more than the last bit"))]
#![cfg_attr(
    not(all(feature = "dicom", feature = "tiff", feature = "vtk", feature = "zarr")),
    allow(dead_code, reason = "readers share what some of them alone use")
)]

pub mod demos;
mod error;
#[doc(hidden)]
pub mod files;
pub mod formats;
#[doc(hidden)]
pub mod memory;
pub mod meshes;
#[doc(hidden)]
pub mod names;
#[doc(hidden)]
pub mod parallel;
#[doc(hidden)]
pub mod vector;
pub mod volume;

pub use error::{Error, Hint, Line, Result};

/// Compiles the examples of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
