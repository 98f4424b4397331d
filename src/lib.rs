//! A GPU splatting renderer for voxel volumes.
//!
//! A volume is a lattice of samples; a transfer function gives each some colour and extinction; every voxel that has
//! any is a fuzzy ball, the *reconstruction kernel*, whose line integral, the *footprint*, is known in advance. It is
//! drawn as a quad into *sheets* parallel to the image, and the sheets are composited front to back. The optical depth
//! of a ray is exact whatever the thickness of the sheets; colours converge as its square.
//!
//! ```no_run
//! use voxsplat::camera::{Camera, View};
//! use voxsplat::image::Background;
//! use voxsplat::renderer::{Renderer, RendererOptions};
//! use voxsplat::settings::Settings;
//! use voxsplat::transfer::presets;
//! use voxsplat::formats::{LoadOptions, load};
//! use voxsplat::volume::Statistics;
//!
//! # fn main() -> voxsplat::error::Result<()> {
//! let volume = load("scan.nii.gz", &LoadOptions::default())?;
//! let transfer = presets::preset("ct-bone", &Statistics::of(&volume)?)?;
//! let renderer = Renderer::new(&RendererOptions::default())?;
//! let settings = Settings { size: [512, 512], ..Settings::default() };
//! let scene = renderer.prepare(&volume, &transfer, &settings, &|_| ())?;
//! let view = View { azimuth: 30.0, elevation: 15.0, ..View::default() };
//! let camera = Camera::new(&view, volume.grid(), settings.size)?;
//! let rendered = renderer.render(&scene, &camera, &settings)?;
//! rendered.image.save("scan.png", Background::default())?;
//! print!("{}", rendered.stats);
//! # Ok(())
//! # }
//! ```
//!
//! Where things are: [`volume`] (readers, phantoms, statistics), [`transfer`] (functions, presets, JSON), [`kernel`]
//! (kernels and the footprint table), [`camera`], [`settings`], [`renderer`] (the GPU), [`mod@reference`] (the same
//! model integrated in f64, to measure against), [`report`] (differences of pictures), [`image`] (pictures
//! and their files), [`stats`] and [`error`].

pub mod adapter;
pub mod camera;
mod color;
pub mod demos;
pub mod error;
pub mod formats;
mod gpu;
pub mod image;
pub mod kernel;
pub mod lighting;
mod names;
mod output;
pub mod progress;
pub mod reference;
pub mod renderer;
pub mod report;
mod scene;
pub mod settings;
pub mod stats;
pub mod transfer;
pub mod volume;
