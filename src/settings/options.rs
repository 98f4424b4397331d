//! Options of what makes pictures.

use crate::progress::Progress;

/// Options of an engine.
#[derive(Debug, Clone, Default)]
pub struct RendererOptions {
    /// A part of the name of the adapter, letter case ignored, or `#` and its index in the list of `voxsplat devices`,
    /// from 0. `None` is the best adapter of a [`Renderer`](crate::Renderer); an [`Engine`](crate::engine::Engine)
    /// draws on the processor if there is no GPU.
    pub adapter: Option<String>,
    /// Called with the progress of scene preparation and of the emission of scalars.
    pub progress: Progress,
}
