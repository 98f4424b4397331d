//! The painters: [`quads`] rasterises splats into sheets, [`tiles`] gathers them along rays.
//!
//! A painter is a folder here; `choice.rs` chooses it. Its constant `ROOM` ([`painter::Room`]) has three functions,
//! which are called in this order:
//!
//! 1. `refusal(view, settings)` returns the reason why the painter does not draw this picture, as a sentence, before
//!    any work.
//! 2. `need(view, settings, weights)` returns how far scalars must reach beyond visible voxels.
//! 3. `begin(nearest, behind)` returns a `Painting` of the lattices of a picture, usually one. It may refuse late, if
//!    only the splats decide.
//!
//! `ROOM` also states whether the painter draws cells of several levels in one picture (`layers`). `Renderer::render`
//! then calls the `Painting` to make its pipelines and to paint each region into a buffer of pixels.
//!
//! `quads` refuses isosurfaces alone, `tiles` more (see `Painter::Tiles` in `settings/mod.rs`). `Painter::Auto` uses
//! `tiles` unless it refuses: this follows a prediction (docs/algorithms.md, "Painters on GPUs") that an H100 bore out.
//! The choice depends only on the adapter, the settings, the view and the volume, so the same input gives the same
//! bytes. `Stats::painter_reason` states the reason.
//!
//! # What both painters keep
//!
//! - **Precision.** The frame is f32 and keeps colour and optical depth. Alpha is one exponential at the end.
//! - **Regions.** Painters get the regions of the whole picture, and the requested part. `tiles` marches only the tiles
//!   of rays that the part needs (`clip_low` and `clip_high` of `Rays`). `quads` draws the whole region, because early
//!   termination of a splat depends on all pixels that it covers.
//! - **Clipping.** Planes are settings of a picture: a moved plane needs no new classification, and new packing only if
//!   the kept part needs other bricks. `Clip::sides` converts planes of the world to lattice coordinates. Shaders get
//!   planes as linear functions of their own coordinates (`Frame::clip_planes`, `Rays::clip_planes`), and are
//!   specialised by the number of planes, so pictures without planes take no time for them. Planes also bound the drawn
//!   bricks (`Plan::sides`, `ViewGeometry::may_show`), the painted pixels (`ViewGeometry::shown`) and the framed hull.
//! - **Solids.** `Job::solid_depths` are the depths of a region, in widths of a pixel from the plane of the target, so
//!   that the lattices of all levels share them. `SOLIDS` ends each ray at its pixel's depth: in `tiles` as a clipping
//!   plane of the ray's own (`shaders/common/ray_geometry.wgsl`), in `quads` as the end of the chord of a fragment.
//!   Then the picture of the matter before the surfaces is laid over the surfaces, and beside their edges over the
//!   picture of all matter. `HALF_DEPTH` stores, in place of colours, the depth at which the optical depth of a ray
//!   passes ln 2 (`common/half_depth.wgsl`).
//! - **Bricks of a plan** (`bricks`). A scene of a brick is made of a slice of the samples, and `Scene::within` places
//!   it in the whole lattice. `ViewGeometry` then is the view of the whole, and its `Held` says which voxels the scene
//!   holds and which part it owns. So sheets, slabs, axes, growth and depths are those of the whole picture. Stores
//!   number the voxels of the slice; `ViewGeometry::first` leads to numbers of the lattice. Shaders of bricks are
//!   specialised by `BRICK`: they composite only slabs or sheets that the brick owns (`shaders/common/owned.wgsl`), and
//!   leave values instead of colours, so `resolve` does not run. A `Room` says how far voxels beyond a cut matter
//!   (`reach`), and which families of rays the painter mixes (`families`).

pub(crate) mod choice;
pub(crate) mod painter;
pub(crate) mod quads;
pub(crate) mod tiles;
