//! From a volume to splats that painters draw: voxels, cells that stand for several voxels, and the light on them. The
//! stages of the device are in `gpu`.
//!
//! `Renderer::prepare` makes a `Scene` from a volume, a transfer function and settings (`scene.rs`). `scene.rs` decides
//! which lattices a picture draws (`lattice.rs`), and `drawable.rs` makes and keeps their splats. A scene serves any
//! number of pictures: each picture of a turntable sends parameters only. The first picture of a post-shaded scene
//! emits its scalars, because their number depends on the painter and on the kernel. No file here names wgpu.
//!
//! # Classified voxels
//!
//! - Colours and densities of pre-shaded voxels are means over the values around a voxel (`transfer/classification.rs`,
//!   `shaders/common/classified.wgsl`, `reference/emission.rs`).
//! - Their normals are dominant axes of structure tensors (`splats/gradients.rs`) of filtered gradients of the samples
//!   (`kernel/derivative.rs`).
//!
//! # Scalars
//!
//! Post-shading keeps a voxel if its scalar can take part in something visible: if a visible voxel lies within reach,
//! by exact Euclidean distance (Saito and Toriwaki 1994). The scalar is stored relative to the *base*, the invisible
//! value next to visible ones. So with `quads` the voxels beyond that reach change no bit of a picture. With `tiles`
//! they change a channel by up to 1.6e-3, and a maximum by 9.6e-3, because fitted parts of kernels fade a little later
//! than the kernels (`gpu/savings_test.rs`).
//!
//! With sharpness, a post-shaded scene and the reference use the volume filtered for the kernel
//! (`kernel/reconstruction`) in place of the original, so ranges, empty space and gradients belong to the drawn field.
//!
//! With grown kernels cells stand for voxels: of one size along parallel rays, and of a layer for each size through one
//! eye (`scalar_cells.rs`); for `quads` of levels by depth (`levels.rs`).

pub(crate) mod cells;
pub(crate) mod drawable;
pub(crate) mod lattice;
pub(crate) mod levels;
mod light_on_host;
pub(crate) mod light_volume;
mod memory;
pub(crate) mod scalar_cells;
pub(crate) mod scalars;
pub(crate) mod scene;
pub(crate) mod shadows;

pub(crate) use memory::bytes_of_voxels;

#[cfg(test)]
mod shadows_test;
