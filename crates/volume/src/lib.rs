//! Volumes for [voxsplat](https://docs.rs/voxsplat): samples on a lattice, and readers of their files. Needs no GPU.
//!
//! [`formats`] reads files, [`volume`] holds samples and their lattice, [`demos`] has built-in volumes, [`meshes`]
//! reads surfaces. The rest is what the renderer shares with them: [`memory`] (allocation that can fail), [`files`]
//! (what may be opened), [`names`] (spellings in messages) and [`vector`].
//!
//! Features, all on by default: `dicom` (with JPEG), `hdf5` (HDF5 and NetCDF), `jpeg2000` (in DICOM), `tiff`, `vtk` and
//! `zarr`.

#![cfg_attr(
    not(all(feature = "dicom", feature = "tiff", feature = "vtk", feature = "zarr")),
    allow(dead_code, reason = "readers share what some of them alone use")
)]

pub mod demos;
mod error;
pub mod files;
pub mod formats;
pub mod memory;
pub mod meshes;
pub mod names;
pub mod parallel;
pub mod vector;
pub mod volume;

pub use error::{Error, Hint, Line, Result};
