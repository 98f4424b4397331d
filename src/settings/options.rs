//! Options of engines.

use crate::progress::Progress;

/// Options of an engine.
///
/// End a literal with `..RendererOptions::default()`: a minor release may add fields.
#[derive(Debug, Clone, Default)]
pub struct RendererOptions {
    /// A part of the name of the adapter, letter case ignored, or `#` and its index in the list of `voxsplat devices`,
    /// from 0. `None` is the best adapter of a [`Renderer`](crate::Renderer); an [`Engine`](crate::engine::Engine)
    /// draws on the processor if there is no GPU.
    pub adapter: Option<String>,
    /// The callback for the progress of scene preparation and of the emission of scalars.
    pub progress: Progress,
    /// Makes literals that name all fields impossible.
    #[doc(hidden)]
    pub non_exhaustive: (),
}
