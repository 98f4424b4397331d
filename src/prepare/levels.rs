//! Chooses the cells and levels that stand for voxels in a post-shaded picture by `quads` through one eye whose kernels
//! have grown: hierarchical splatting (Laur and Hanrahan 1991), so that cost follows the picture and not the volume.

use glam::DVec3;

use crate::gpu::view::{ViewGeometry, half};
use crate::kernel::Kernel;

/// The least standard deviation, in cells, and the least growth of kernels of cells. Smaller ones give fewer cells and
/// larger errors: docs/algorithms.md.
const LEAST_DEVIATION: f64 = 1.6;
const LEAST_GROWTH: f64 = 2.0;

/// The largest difference of the growth of kernels within a cell, as a share of the growth: where growth rises steeply
/// with depth, the kernels of the voxels of a cell differ.
const MOST_RISE: f64 = 0.125;

/// The number of doublings of the growth over which a level gives way to the next: both are drawn there, each with a
/// share.
const BLEND: f64 = 0.5;

/// The coarsest level. In pictures that could use coarser ones the volume is much smaller than a pixel.
const MAX_LEVEL: u32 = 18;

/// The cells of levels that stand for voxels. Level 0 is the voxels themselves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cut {
    /// The constant of the growth of kernels, which at lattice point p is constant + slope . p, and at least 1.
    constant: f64,
    slope: DVec3,
    /// The growth from which on cells of level 1 have a share; twice as much for each further level.
    first: f64,
    /// The reach of kernels in voxels: a constant part, and a part for each unit of growth.
    reach: [f64; 2],
    /// The largest growth of a kernel that reaches the places that the picture needs.
    most: f64,
    /// The finest and the coarsest level with shares.
    pub(crate) levels: [u32; 2],
}

impl Cut {
    /// Chooses the cells for a picture that needs scalars `beside` voxels and the reach of kernels beyond the faces of
    /// the volume; `None` if the picture is drawn of voxels alone.
    pub(crate) fn new(view: &ViewGeometry, kernel: &Kernel, beside: f64) -> Option<Self> {
        let least = LEAST_GROWTH.max(LEAST_DEVIATION / kernel.variance().sqrt());
        let mut cut = Self {
            constant: view.growth.constant + view.growth.slope * view.eye_depth,
            slope: view.gradients[2] * view.growth.slope,
            // Cells of level 1 count twice as many voxels.
            first: 2.0 * least,
            reach: [beside, view.radius],
            most: view.max_growth(),
            levels: [0, 0],
        };
        cut.constant -= cut.slope.dot(half(&view.grid));
        cut.first = cut.first.max(2.0 * cut.slope.abs().element_sum() / MOST_RISE);
        let [nearest, farthest] = view.growths;
        // Copies beyond the faces may be nearer and farther by the reach of kernels.
        let margin = (beside + view.radius * farthest) * cut.slope.length();
        cut.most = farthest + margin;
        let coarsest = cut.level_after(cut.most);
        if coarsest == 0 {
            return None;
        }
        let finest = cut.level_after((nearest - margin) / libm::exp2(BLEND)).min(coarsest);
        cut.levels = [finest, coarsest];
        if cut.slope == DVec3::ZERO && finest == coarsest {
            // One cut serves all these growths, and all reaches that round up to the same whole number of cells.
            let size = libm::exp2(f64::from(coarsest));
            cut.reach = [((beside + view.radius * cut.most) / size).ceil() * size, 0.0];
            (cut.constant, cut.most) = (cut.full(coarsest), cut.full(coarsest));
        }
        Some(cut)
    }

    /// Returns the coarsest level that has a share at some growth.
    fn level_after(&self, growth: f64) -> u32 {
        let level = libm::log2(growth / self.first).floor() + 1.0;
        level.clamp(0.0, f64::from(MAX_LEVEL)) as u32
    }

    /// Returns the growth from which on finer levels have no share.
    fn full(&self, level: u32) -> f64 {
        self.first * libm::exp2(f64::from(level) - 1.0 + BLEND)
    }

    fn growth(&self, p: DVec3) -> f64 {
        (self.constant + self.slope.dot(p)).max(1.0)
    }

    /// Returns the share of a level at some growth, of the share that coarser levels leave.
    fn share(&self, level: u32, growth: f64) -> f64 {
        if level == 0 {
            return 1.0;
        }
        (1.0 + libm::log2(growth / self.full(level)) / BLEND).clamp(0.0, 1.0)
    }

    /// Returns the share of a cell of a level in the picture, 0 to 1.
    pub(crate) fn part(&self, level: u32, cell: [i64; 3]) -> f64 {
        let coarser = (level + 1..=self.levels[1]).map(|coarser| {
            let cell = cell.map(|c| c >> (coarser - level));
            1.0 - self.share(coarser, self.growth(middle(coarser, cell)))
        });
        self.share(level, self.growth(middle(level, cell))) * coarser.product::<f64>()
    }

    /// Returns whether any cell of a brick may have a share, given the first cell and the number of cells along an edge
    /// of the brick.
    pub(crate) fn takes_part(&self, level: u32, first: [i64; 3], edge: usize) -> bool {
        let size = libm::exp2(f64::from(level));
        let center = middle(level, first) + 0.5 * size * (edge as f64 - 1.0);
        let spread = 0.5 * size * edge as f64 * self.slope.abs().element_sum();
        let growth = self.growth(center);
        // The next level may be evaluated half a cell aside.
        let next = level < self.levels[1]
            && growth - spread - 0.5 * size * self.slope.abs().element_sum() >= self.full(level + 1);
        !next && (level == 0 || self.share(level, growth + spread) > 0.0)
    }

    /// Returns whether the kernel of a cell reaches a lattice of `dims` voxels, or the places beside it that the
    /// picture needs.
    pub(crate) fn reaches(&self, level: u32, cell: [i64; 3], dims: [u32; 3]) -> bool {
        let center = middle(level, cell);
        let last = DVec3::from_array(dims.map(|d| f64::from(d) - 0.5));
        let outside = center - center.clamp(DVec3::splat(-0.5), last);
        outside == DVec3::ZERO || outside.length() < self.reach[0] + self.reach[1] * self.growth(center)
    }

    /// Returns the number of cells of a level beyond each face that may reach the volume.
    pub(crate) fn padding(&self, level: u32) -> u32 {
        let size = libm::exp2(f64::from(level));
        // Beyond this growth there are coarser cells only.
        let coarser = if level < self.levels[1] { self.full(level + 1) } else { f64::INFINITY };
        let most = self.most.min(coarser + size * self.slope.abs().element_sum());
        (((self.reach[0] + self.reach[1] * most) / size).ceil() as u32).saturating_add(1)
    }

    /// Returns the number of voxels beyond each face that cells of all levels may cover, a whole number of cells of
    /// each level.
    pub(crate) fn layers(&self) -> u32 {
        let [finest, coarsest] = self.levels;
        let layers = (finest..=coarsest).map(|level| self.padding(level).saturating_mul(1 << level)).max();
        layers.unwrap_or(0).checked_next_multiple_of(1 << coarsest).unwrap_or(u32::MAX)
    }
}

/// The distances to which the splats of scalars of a post-shaded picture must reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ScalarNeed {
    /// The number of layers by which the lattice is extended on every side, each a copy of the outermost layer: the
    /// field is then complete up to the faces of the volume and does not fade there.
    pub(crate) padding: u32,
    /// The distance in voxels within which two voxels can take part in the classification of the same place.
    pub(crate) influence: f64,
    /// The cells that stand for voxels by depth; `None`: voxels, or cells of one level.
    pub(crate) cut: Option<Cut>,
    /// Whether the painter reads samples where the device has them, in place of lists of splats.
    pub(crate) samples: bool,
    /// Whether scalars of 0 are splats too: they add nothing, but light falls on them.
    pub(crate) zeros: bool,
    /// The largest growth of a kernel, for messages.
    pub(crate) growth: f64,
}

impl ScalarNeed {
    /// The need of pictures of classified voxels.
    pub(crate) const NONE: Self =
        Self { padding: 0, influence: 0.0, cut: None, samples: false, zeros: false, growth: 1.0 };

    /// Returns the need for kernels that reach `reach` voxels from any place of the field, and for an `influence` in
    /// voxels.
    ///
    /// The influence is rounded up, so that the splats do not change when the camera turns: to sixteenths for rounding
    /// errors; through an eye to whole voxels, because kernels grow otherwise wherever the eye is.
    pub(crate) fn new(view: &ViewGeometry, reach: f64, influence: f64) -> Self {
        let steps = if view.is_perspective() { 1.0 } else { 16.0 };
        Self {
            padding: (reach * (1.0 - 1e-9)).ceil() as u32,
            influence: (steps * influence + 1e-3).ceil() / steps,
            cut: None,
            samples: false,
            zeros: false,
            growth: view.max_growth(),
        }
    }

    /// Adds to the need that cells stand for voxels.
    pub(crate) fn with_cells(self, cut: Cut) -> Self {
        Self {
            padding: cut.layers(),
            // A cell is visible because of voxels no farther than this from its middle.
            influence: self.influence + libm::exp2(f64::from(cut.levels[1] + 1)),
            cut: Some(cut),
            ..self
        }
    }
}

/// Returns the lattice point in the middle of a cell of a level.
fn middle(level: u32, cell: [i64; 3]) -> DVec3 {
    let size = libm::exp2(f64::from(level));
    DVec3::from_array(cell.map(|c| size * (c as f64 + 0.5) - 0.5))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, ProjectionKind, View};
    use crate::gpu::savings::Savings;
    use crate::settings::Settings;
    use crate::volume::Grid;

    #[test]
    fn cells_and_voxels_share_each_place_whole() {
        let grid = Grid::axis_parallel([40, 30, 20], [1.0; 3]).unwrap();
        let settings = Settings::default();
        for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 150.0 }] {
            for zoom in [1.0, 0.7, 0.5, 0.35, 0.2, 0.01] {
                let view = View { azimuth: 33.0, projection, zoom, ..View::default() };
                let camera = Camera::new(&view, &grid, [8; 2]).unwrap();
                let view = ViewGeometry::new(&camera, &grid, &settings, Savings::default());
                let Some(cut) = Cut::new(&view, &settings.kernel, 3.0) else { continue };
                let [finest, coarsest] = cut.levels;
                for voxel in [[0, 0, 0], [39, 29, 19], [-30, 5, 50], [17, 3, 11]] {
                    let parts = (finest..=coarsest).map(|level| cut.part(level, voxel.map(|v: i64| v >> level)));
                    let sum: f64 = parts.sum();
                    assert!((sum - 1.0).abs() < 1e-12, "{projection:?} {zoom} {voxel:?}: {sum} {cut:?}");
                    for level in finest..=coarsest {
                        let cell = voxel.map(|v| v >> level);
                        assert!(cut.part(level, cell) == 0.0 || cut.takes_part(level, cell, 1), "{level} {cell:?}");
                    }
                }
            }
        }
    }
}
