//! The lattices that a picture is drawn of: voxels, or cells of levels that stand for them.

use super::cells::VoxelLight;
use super::scalar_cells::Coarse;
use super::shadows::Shadows;
use crate::gpu::view::{ViewGeometry, Weights};
use crate::kernel::{Kernel, Normalization};
use crate::settings::Settings;

/// How a picture is drawn of the cells of a level; of voxels, if that is 0.
pub(crate) struct Lattice {
    /// The view of the lattice of the cells, which is a layer if there are others.
    pub(crate) view: ViewGeometry,
    /// The settings with the kernel of cells.
    pub(crate) settings: Settings,
    pub(crate) weights: Weights,
    pub(crate) level: u32,
    /// Which light is kept from voxels; `None`: all of it arrives.
    pub(crate) shadows: Option<Shadows>,
    /// The light on the voxels of cells, which are drawn unlit.
    pub(crate) light: Option<VoxelLight>,
    /// If they are of scalars, which cells they are, and the kernel that voxels have as asked for.
    pub(crate) coarse: Option<(Coarse, Kernel, Normalization)>,
}

impl Lattice {
    /// The kernel of voxels, and the normalisation of their sums.
    pub(crate) fn kernel_of_voxels(&self) -> (Kernel, Normalization) {
        let drawn = (self.settings.kernel, self.settings.normalization);
        self.coarse.map_or(drawn, |(_, kernel, normalization)| (kernel, normalization))
    }
}
