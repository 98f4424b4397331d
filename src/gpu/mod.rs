//! The device, its buffers and shaders, and what all painters need of them.

#[cfg(test)]
pub(crate) mod adapter_test;
pub(crate) mod cache;
pub(crate) mod cells;
#[cfg(test)]
mod cells_test;
pub(crate) mod classify;
pub(crate) mod context;
pub(crate) mod held_samples;
pub(crate) mod kept_voxels;
pub(crate) mod layout;
pub(crate) mod light_volume;
pub(crate) mod pipeline;
pub(crate) mod present;
pub(crate) mod recorder;
mod rows;
pub(crate) mod sampled;
pub(crate) mod sampled_scalars;
#[cfg(test)]
mod sampled_test;
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
