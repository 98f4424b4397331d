//! From a volume to what painters draw: splats, cells that stand for several of them, and the light on them. On the
//! host, but for the classification of voxels, which [`gpu::classify`](crate::gpu::classify) has for devices.

pub(crate) mod cells;
pub(crate) mod drawable;
pub(crate) mod lattice;
pub(crate) mod levels;
pub(crate) mod light_volume;
pub(crate) mod media;
pub(crate) mod scalar_cells;
pub(crate) mod scalars;
pub(crate) mod scene;
pub(crate) mod shadows;
