//! From a volume to splats that painters draw: voxels, cells that stand for several voxels, and the light on them. The
//! stages of the device are in `gpu`.

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
