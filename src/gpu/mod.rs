//! The device, its buffers and shaders, and what all painters need of them.
//!
//! # Stages
//!
//! A stage is a step of the device. Its shader (`shaders/NAME.wgsl`), its file on the host, its twin on the CPU in
//! tests and its row of `Stats::stages` have one name. The stages of painters are in the documentation of
//! `painters/quads` and `painters/tiles`.
//!
//! - `classify` (shaders `classify`, `extents`, `normals`) finds the visible voxels of bricks of samples, and their
//!   normals if there is light. The device holds the samples (of few visible bricks only these), a bit for each voxel,
//!   set if it is visible, and the normals of visible voxels. Stages that read voxels classify their samples on the
//!   way (`common/sampled.wgsl`). Files: `classify.rs`; `samples.rs` (bricks of samples), `held_samples.rs`,
//!   `kept_voxels.rs`, `voxels.rs`.
//! - `layers` (on the host, `splats/layers.rs`) does the same for several layers on one lattice: labels, masks,
//!   scalars. The device gets the words of visible voxels in place of samples. Its time is a part of `classify`.
//! - `list` (shader `list`; `list.rs`) makes lists of splats of visible voxels, for `quads`. Its time is a part of
//!   `classify`.
//! - `shadows` (shaders `shadows_of_voxels`, `filter`, `sweep`, `converging`, `around`) computes the share of each
//!   light that reaches a voxel, once per set of lights, a few planes at a time, without a wait. Its time is a part of
//!   `classify`. Files: `shadows.rs`, `shadows/voxels.rs`; `lighting/shadow/plan.rs` has the plans,
//!   `prepare/shadows.rs` keeps the occluders, and `prepare/light_on_host.rs` computes exact sums and shadows that the
//!   device has no room for.
//! - light volume (shaders `field_of_cells`, `box_light`, and the shaders of `shadows`) computes the same shares for
//!   places in a field of scalars, as a texture that `shade` and `gather` interpolate between voxels
//!   (`common/light_volume.wgsl`). The field of extinctions is made of the samples that the device holds. Files:
//!   `prepare/light_volume.rs`, `light_volume.rs` (the texture), `scalar_field.rs` (the field).
//! - `cells` (shaders `lit_rows`, `cells`) is for pre-shading with grown kernels: it makes cells of a level from
//!   classified and lit voxels, again if the eye or a light moves. Cells under another light take the places of the
//!   cells before. Files: `cells.rs`; `prepare/cells.rs` with `cells/size.rs` and `cells/filter.rs` (sizes, kernels and
//!   lattices of cells).
//! - `scalars` (shaders `cell_rows`, `scalar_sums`) is for post-shading by `tiles`: the device holds the samples of
//!   voxels, which serve every transfer function, and makes cells of these as it packs them, part by part. For `quads`
//!   the host lists the voxels that can take part in something visible, and copies beyond the faces. Files:
//!   `sampled_scalars.rs`, `scalar_cells.rs`; `prepare/scalars.rs`, `scalar_cells.rs`, `levels.rs`; `store.rs` (lists).
//! - `scan` (`scan.rs`) computes prefix sums for `classify` and `sort`.
//! - `present` (`present.rs`) writes pixels into the caller's texture (`Renderer::render_into`).
//!
//! If a picture outgrows the adapter's textures or bindings, or 256 MiB of sheets, the renderer makes it in regions,
//! one after the other. A region of a picture has the bytes of the whole picture there.
//!
//! # Samples and splats
//!
//! `Volume` hands out bricks of 32^3 voxels, from memory or from the file, with the range of values of each brick. A
//! brick whose range is invisible under the transfer function is not uploaded, unless the device holds the samples of
//! all bricks. It does so from the second transfer function on if the samples take less than 128 MiB, and from the
//! first on if they take more, up to 4 GiB, and over a quarter of the bricks may show. Otherwise it holds the bricks
//! that have shown, and others are sent as they show. Over 4 GiB of bricks that show are refused. A splat stores its
//! brick and its place in the brick: 16 bytes as a classified voxel and 24 with shares of light, 8 as a scalar and 16
//! as a scalar with a gradient (`shaders/common/splat.wgsl`).
//!
//! # Shaders
//!
//! Shaders are WGSL files joined from parts (`shaders.rs`). Structs that shaders and host share are in `layout.rs`; a
//! test compares names, offsets and sizes with naga's reflection of the shaders. `override` constants specialise
//! shaders: an unlit scene has no normals, an X-ray has one channel. A picture has one list of constants, which is also
//! the key of its pipelines, and each stage takes the constants that its shader declares (`stage.rs`). Only pipelines
//! that a picture uses are made.
//!
//! No shader has an `if` or a loop whose condition depends on uniforms alone: Mesa 22.3.6 copies and optimises such a
//! shader again in each dispatch, and keeps the copies. It also executes both sides of every `if`, so only a loop that
//! ends earlier saves time there; Mesa 25.0.7 does not. Rays copy their uniforms into private variables
//! (`uniform_rays`, `rays`), because software Vulkan loads a uniform lane by lane in each pass of a loop
//! (docs/measurements/2026-11-26-uniforms.md).
//!
//! # Precision
//!
//! - The host computes view geometry in f64 (`view.rs`). Its world begins in the middle of the lattice, and its unit is
//!   a power of two of about a voxel (`Grid::local`), so no unit of length and no origin reaches an f32.
//! - Integers are compared with the transfer function relative to its first point. The host reduces scalars of
//!   post-shading, 32 and 64-bit integers, f64, and f32 near the ends of its range in f64: relative to the base of the
//!   transfer function, times a power of two (`Reduction` in `transfer.rs`). Shaders see no unit of the data.
//! - Pre-shading, post-shading, maxima and the reference agree at a step: if several points have one value, the last
//!   holds above it; below all points, the first holds.
//! - Order is fixed: splats keep the order of the lattice, blending follows draw order, and atomics only count. The
//!   same input gives the same bytes on the same driver.

#[cfg(test)]
pub(crate) mod adapter_test;
pub(crate) mod cache;
pub(crate) mod cells;
#[cfg(test)]
mod cells_test;
pub(crate) mod classify;
pub(crate) mod context;
pub(crate) mod drawable;
pub(crate) mod held_samples;
pub(crate) mod kept_voxels;
pub(crate) mod layout;
pub(crate) mod light_volume;
pub(crate) mod list;
pub(crate) mod pipeline;
pub(crate) mod present;
pub(crate) mod recorder;
pub(crate) mod sampled_scalars;
pub(crate) mod samples;
pub(crate) mod savings;
#[cfg(test)]
mod savings_test;
pub(crate) mod scalar_cells;
pub(crate) mod scalar_field;
pub(crate) mod scan;
pub(crate) mod sender;
pub(crate) mod shaders;
#[cfg(test)]
mod shaders_test;
pub(crate) mod shadows;
pub(crate) mod splat;
pub(crate) mod stage;
#[cfg(test)]
mod stages_test;
pub(crate) mod stderr;
pub(crate) mod store;
pub(crate) mod timing;
pub(crate) mod transfer;
#[cfg(test)]
mod translations_test;
#[cfg(test)]
pub(crate) mod twins_test;
pub(crate) mod view;
pub(crate) mod voxels;
#[cfg(test)]
mod voxels_test;
