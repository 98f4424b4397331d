//! A GPU splatting renderer for voxel volumes.
//!
//! A volume is a lattice of samples; a transfer function gives each some colour and extinction; every voxel that has
//! any is a fuzzy ball, the *reconstruction kernel*, whose line integral, the *footprint*, is known in advance. It is
//! drawn as a quad into *sheets* parallel to the image, and the sheets are composited front to back. The optical depth
//! of a ray is exact whatever the thickness of the sheets; colours converge as its square.
//!
//! ```no_run
//! use voxsplat::{Background, Camera, Renderer, RendererOptions, Settings, TransferFunction, View, load};
//!
//! # fn main() -> voxsplat::Result<()> {
//! let volume = load("scan.nii.gz", &Default::default())?;
//! let transfer = TransferFunction::preset("ct-bone", &volume)?;
//! let settings = Settings::default();
//! let renderer = Renderer::new(&RendererOptions::default())?; // a device
//! let scene = renderer.prepare(&volume, &transfer, &settings)?; // the visible voxels on it
//! for azimuth in [0.0, 90.0] {
//!     let view = View { azimuth, ..View::default() };
//!     let camera = Camera::new(&view, volume.grid(), [512, 512])?;
//!     let rendered = renderer.render(&scene, &camera, &settings)?;
//!     rendered.image.save(format!("scan_{azimuth}.png"), Background::default())?;
//! }
//! # Ok(())
//! # }
//! ```
//!
//! Names that most programs use are at the root. The rest is in modules: [`volume`] (samples on a lattice), [`formats`]
//! (readers), [`demos`] (built-in volumes), [`transfer`] (functions, presets, JSON), [`kernel`], [`camera`], [`clip`]
//! (planes, boxes), [`lighting`], [`settings`], [`renderer`] (the GPU), [`mod@reference`] (the same model integrated in
//! f64, to measure against), [`accuracy`] (pictures that keep an error), [`reconstruction`] (the error of kernels),
//! [`report`] (differences of pictures, speed against error), [`image`] (pictures and their files), [`figure`] (scale
//! bar, axes, colour bar and title on a picture), `film` (GIF, APNG and Y4M), [`stats`], [`progress`], [`adapter`] and
//! [`error`].
//!
//! The features, on by default: `cli` builds the program `voxsplat`; `film` writes films; `hdf5` reads HDF5 and NetCDF;
//! `jpeg2000` reads JPEG 2000 in DICOM; `report` has plots of speed against error. A library needs
//! `default-features = false`.

pub mod accuracy;
pub mod adapter;
mod budget;
pub mod camera;
pub mod clip;
mod color;
pub mod demos;
pub mod error;
pub mod figure;
#[cfg(feature = "film")]
pub mod film;
pub mod formats;
mod framing;
mod gpu;
pub mod image;
pub mod kernel;
pub mod layers;
pub mod lighting;
mod memory;
mod names;
mod output;
pub mod progress;
pub mod reconstruction;
pub mod reference;
pub mod renderer;
pub mod report;
mod response;
mod scene;
pub mod settings;
mod source;
pub mod stats;
pub mod transfer;
mod vector;
pub mod volume;

pub use camera::{Camera, ProjectionKind, View};
pub use error::{Error, Result};
pub use formats::{LoadOptions, load};
pub use glam;
pub use image::{Background, Image};
pub use renderer::{Rendered, Renderer, RendererOptions, Scene};
pub use settings::Settings;
pub use transfer::TransferFunction;
pub use volume::{Grid, Volume};
pub use wgpu;

/// What can be shared between threads.
const _: fn() = || {
    fn shared<T: Send + Sync>() {}
    shared::<(Renderer, Scene, Camera, View, Settings, Volume, TransferFunction, Image, Rendered, Error)>();
    shared::<(reference::Reference, progress::Progress, RendererOptions, stats::Stats, LoadOptions)>();
};
