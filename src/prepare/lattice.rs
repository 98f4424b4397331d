//! The lattices that a picture is drawn of: voxels, or the cells of levels that stand for voxels.

use super::cells::CellSize;
use super::scalar_cells::Coarse;
use super::shadows::Shadows;
use crate::gpu::splat::SplatLight;
use crate::gpu::view::{ViewGeometry, Weights};
use crate::kernel::{Kernel, Normalization};
use crate::settings::Settings;

/// A lattice of a picture: the cells of a size, of which the smallest are the voxels, with view and settings.
pub(crate) struct Lattice {
    /// The view of the lattice, which is a layer if a picture has several lattices.
    pub(crate) view: ViewGeometry,
    /// The settings, with the kernel of the cells.
    pub(crate) settings: Settings,
    pub(crate) weights: Weights,
    pub(crate) size: CellSize,
    /// The shadows on voxels; `None`: all light arrives.
    pub(crate) shadows: Option<Shadows>,
    /// The light on the voxels of cells; the cells are drawn unlit.
    pub(crate) light: Option<SplatLight>,
    /// Cells of scalars, and the kernel and normalisation of their voxels.
    pub(crate) coarse: Option<(Coarse, Kernel, Normalization)>,
    /// The level of the cells on which shadows of scalars lie: one for all lattices of a picture.
    pub(crate) shadow_level: u32,
}

impl Lattice {
    /// Returns the kernel of voxels, and the normalisation of their sums.
    pub(crate) fn kernel_of_voxels(&self) -> (Kernel, Normalization) {
        let drawn = (self.settings.kernel, self.settings.normalization);
        self.coarse.map_or(drawn, |(_, kernel, normalization)| (kernel, normalization))
    }
}
