//! Pictures made by many machines: a plan of bricks, a partial picture of each brick, and their merged picture.
//!
//! A volume that one machine cannot hold is cut into bricks. A [`Plan`] holds all facts of the whole: lattice, camera,
//! settings, transfer function and the bricks in order. [`brick`] draws one brick of a slice of the samples, the brick
//! with its halo; bricks need nothing of each other but shadows. [`Partial::over`] composites neighbours in order, in
//! any tree, and [`Plan::picture`] classifies and displays the result.
//!
//! ```no_run
//! use voxsplat::bricks::{Chunks, Plan, brick};
//! use voxsplat::{Appearance, Engine, RendererOptions, load};
//!
//! # fn main() -> voxsplat::Result<()> {
//! let volume = load("scan.nrrd", &Default::default())?;
//! let look = Appearance::for_file("scan.nrrd", &volume)?;
//! let chunks = Chunks::even(volume.grid().dims(), [2, 2, 2])?;
//! let (settings, _) = Plan::settings_for(&look.settings);
//! let plan = Plan::new(&look.layers, volume.grid(), &chunks, &look.camera([1024, 1024])?, &settings)?;
//! let engine = Engine::open(&RendererOptions::default(), plan.settings())?;
//! let mut merged = None;
//! for (number, next) in plan.bricks().iter().enumerate() {
//!     // On any machine: a slice of the samples, and the plan as JSON.
//!     let (part, _) = brick(&engine, &plan, number, &look.layers.part(&next.held)?, None)?;
//!     merged = Some(match merged {
//!         None => part,
//!         Some(front) => voxsplat::bricks::Partial::over(&front, &part)?,
//!     });
//! }
//! # let merged = merged.unwrap();
//! plan.picture(&merged)?.save("scan.png", Default::default())
//! # }
//! ```
//!
//! # Seams
//!
//! Painters composite slabs or sheets, and matter within one has no order. A cut through a slab would order it, so the
//! picture would change along the cut. Therefore each slab of each ray belongs to one brick: the brick that holds its
//! middle. All bricks place slabs and cuts by the same numbers of the whole lattice, and hold the voxels around the
//! cuts, their halo. So the merged picture differs from the whole one by the rounding of f32, at cuts as elsewhere.
//!
//! # Shadows
//!
//! Other bricks cast shadows on a brick. [`sweep_light`] sweeps the light once through the whole volume, slab after
//! slab away from it, and returns the light that enters each brick ([`IncomingLight`]). Then [`brick`] draws the
//! shadows of the whole picture. The sweep costs about as much as preparing all slabs, and runs on one machine.
//!
//! # Limits
//!
//! [`Plan::new`] refuses light with shadows or occlusion by a device, shadows of lights at places and exact shadows,
//! axis-aligned sheets, levels whose cells cuts would divide, and levels of scalars by a device: their pictures need
//! matter of other bricks, or have sheets or cells that no brick owns. A ray is marched for each pixel. Each brick ends
//! its own opaque rays, so matter behind other bricks is drawn although it is hidden.

mod draw;
mod file;
mod grid;
mod hash;
mod light;
mod memory;
mod merge;
mod needs;
mod partial;
mod plan;

pub use draw::brick;
pub use grid::Chunks;
pub use light::{IncomingLight, sweep_light};
pub use merge::merge;
pub use partial::Partial;
#[doc(hidden)]
pub use partial::Values;
pub use plan::{Brick, Plan};
