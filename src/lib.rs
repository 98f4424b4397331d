//! A GPU splatting renderer for voxel volumes.
//!
//! A volume is a lattice of samples. A transfer function gives each sample a colour and an extinction. Every visible
//! voxel is a fuzzy ball, the *reconstruction kernel*; its line integral, the *footprint*, is known in advance. The
//! painter `tiles`, the default, gathers footprints along rays. The painter `quads` draws them as quads into *sheets*
//! parallel to the image and composites the sheets front to back: optical depth is exact at any thickness of the
//! sheets, and colours converge with its square.
//!
//! ```no_run
//! use voxsplat::{Appearance, Background, Engine, Frame, RendererOptions, load};
//!
//! # fn main() -> voxsplat::Result<()> {
//! let volume = load("scan.nii.gz", &Default::default())?;
//! let look = Appearance::for_file("scan.nii.gz", &volume)?; // transfer function, side, light, as `voxsplat render`
//! let engine = Engine::open(&RendererOptions::default(), &look.settings)?; // a GPU, or the processor
//! let scene = engine.prepare_layers(&look.layers, &look.settings)?; // the visible voxels
//! let rendered = engine.render(&scene, &Frame::new(&look.camera([1024, 1024])?, &look.settings))?;
//! rendered.image.save("scan.png", Background::default())?;
//! # Ok(())
//! # }
//! ```
//!
//! [`appearance`] makes default choices. Names that most programs use are at the root, others in modules: [`volume`]
//! (samples on a lattice), [`formats`] (readers), [`demos`] (built-in volumes), [`transfer`] (functions, presets,
//! JSON), [`kernel`], [`camera`], [`clip`] (planes, boxes), [`lighting`], [`settings`], [`engine`] (a GPU or the
//! processor), [`renderer`] (a GPU, or the caller's device), [`mod@reference`] (the same model integrated in f64, to
//! measure against), [`accuracy`] (pictures that keep an error), [`bricks`] (pictures made by many machines), [`image`]
//! (pictures, their files and their differences), [`solids`] (meshes and depth buffers in pictures), [`figure`] (scale
//! bar, axes, colour bar and title on a picture), `film` (GIF, APNG and Y4M), [`stats`], [`progress`], [`adapter`] and
//! [`error`].
//!
//! # Stability
//!
//! Items in this documentation follow semantic versioning. Structs that a caller fills end with a default
//! (`..Settings::default()`), and enums that may grow are `#[non_exhaustive]`, so new fields and variants are no
//! breaking change. Items that this documentation does not show serve the program and the Python package: any release
//! may change them. Vectors are those of [`glam`], which the interface re-exports because cameras, lattices and planes
//! are made of them. `wgpu` appears only in `Renderer::from_device` and `Renderer::render_into`, with the feature
//! `gpu`.
//!
//! Features, all on by default: `gpu` is the device engine and pictures in bricks, without which nothing needs wgpu and
//! the processor draws; `film` writes films; `dicom`, `hdf5` (HDF5 and NetCDF), `jpeg2000` (in DICOM), `tiff`,
//! `vtk` and `zarr` are readers. `remote`, off by default, reads files at urls. The program `voxsplat` is a package of
//! its own, `crates/cli`.

#![cfg_attr(docsrs, feature(doc_cfg))]
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests allow more than the last bit"))]
#![cfg_attr(
    not(feature = "gpu"),
    allow(dead_code, unused_imports, reason = "what only the device engine reads is compiled without it too")
)]

pub mod accuracy;
pub mod appearance;
#[cfg(feature = "gpu")]
pub mod bricks;
pub mod camera;
pub mod engine;
pub mod error;
mod frame;
#[cfg(feature = "gpu")]
mod gpu;
pub mod host;
pub mod image;
pub mod kernel;
pub mod layers;
pub mod lighting;
mod output;
#[cfg(feature = "gpu")]
mod painters;
#[cfg(feature = "gpu")]
mod prepare;
pub mod progress;
pub mod reference;
#[cfg(feature = "gpu")]
pub mod renderer;
pub mod settings;
pub mod solids;
mod splats;
pub mod stats;
pub mod transfer;
mod vectors;

#[doc(hidden)]
pub use appearance::program;
pub use appearance::{Appearance, demos};
pub use camera::{Camera, ProjectionKind, View, clip};
pub use engine::{Engine, EngineScene};
pub use error::{Error, Result};
pub use formats::{LoadOptions, load};
pub use frame::Frame;
pub use glam;
#[cfg(feature = "film")]
pub use image::film;
pub use image::{Background, Image, figure};
#[doc(hidden)]
pub use kernel::reconstruction;
#[cfg(feature = "gpu")]
pub use renderer::{Renderer, Scene};
pub use settings::{RendererOptions, Settings};
pub use stats::{Rendered, adapter};
pub use transfer::TransferFunction;
pub use volume::{Grid, Volume};
pub use voxsplat_volume::{formats, volume};
#[cfg(feature = "gpu")]
pub use wgpu;

/// Compiles the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

/// These types can be shared between threads.
const _: fn() = || {
    fn shared<T: Send + Sync>() {}
    shared::<(Engine, EngineScene, Camera, View, Settings, Volume, TransferFunction, Image, Rendered, Error)>();
    shared::<(reference::Reference, progress::Progress, RendererOptions, stats::Stats, LoadOptions)>();
};
