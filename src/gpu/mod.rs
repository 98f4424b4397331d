//! The stages on the GPU. This folder and `renderer.rs` are the only places that name wgpu.

#[cfg(test)]
mod adapter_test;
pub(crate) mod cache;
pub(crate) mod cells;
pub(crate) mod choice;
pub(crate) mod classify;
pub(crate) mod coarse;
pub(crate) mod context;
pub(crate) mod layers;
pub(crate) mod layout;
pub(crate) mod levels;
pub(crate) mod light_volume;
pub(crate) mod painter;
pub(crate) mod pipeline;
pub(crate) mod present;
pub(crate) mod quads;
pub(crate) mod recorder;
pub(crate) mod savings;
#[cfg(test)]
mod savings_test;
pub(crate) mod scalars;
pub(crate) mod scan;
mod shaders;
#[cfg(test)]
mod shaders_test;
pub(crate) mod shadows;
mod splat;
#[cfg(test)]
mod stages_test;
pub(crate) mod store;
pub(crate) mod tiles;
pub(crate) mod timing;
pub(crate) mod transfer;
#[cfg(test)]
mod translations_test;
#[cfg(test)]
mod twins;
pub(crate) mod view;
