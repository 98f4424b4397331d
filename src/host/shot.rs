//! A picture that rays are marched for: its kernels and the lattice of its fields.

use std::sync::Arc;

use glam::{DAffine3, DVec3};

use super::arriving::Falling;
use super::blend::{self, Blend, LatticeGrowth};
use super::level::Level;
use crate::camera::{Camera, Growth};
use crate::error::Result;
use crate::frame::Frame;
use crate::image::{DepthMap, Region};
use crate::kernel::Kernel;
use crate::lighting::shadow::ShadowLattice;
use crate::lighting::shadow::incoming::Incoming;
use crate::settings::{Level as Cells, Settings};
use crate::volume::Grid;

/// The largest growth of kernels of perspective pictures: growth by the last rounding does not count.
const NO_GROWTH: f64 = 1.0 + 1e-9;

/// A part of a lattice whose partial picture is made.
#[derive(Debug, Clone)]
pub(super) struct OwnedPart {
    /// The whole lattice, and the lattice of the scene's voxels in it.
    pub(super) grid: Grid,
    pub(super) held: Grid,
    /// The first voxel of the scene in it.
    pub(super) first: [u32; 3],
    /// The least and the largest place of the slabs of the partial picture, in numbers of voxels.
    pub(super) owned: [DVec3; 2],
    /// Whether the eye lies between them.
    pub(super) has_eye: bool,
    /// The light that enters the part; `None`: no light of the picture casts shadows.
    pub(super) incoming: Option<Incoming>,
}

/// The growth of kernels, in steps of their lattice, from which fields are so smooth that a cubic between planes takes
/// the place of their samples there.
const WIDE: f64 = 1.5;

/// Steps of growths of kernels between 0 and 1.
const STEPS: f64 = 16_777_216.0;

/// The camera, the settings and the lattice of a picture.
#[derive(Clone)]
pub(super) struct Shot<'a> {
    pub(super) camera: &'a Camera,
    pub(super) settings: &'a Settings,
    /// The lattice of all voxels; `part` is the part of it that a partial picture shows.
    pub(super) grid: &'a Grid,
    pub(super) part: Option<&'a OwnedPart>,
    pub(super) region: Region,
    /// The growths of the kernels whose fields are blended, ascending.
    pub(super) growths: Vec<f64>,
    /// The level of the blended fields; `lattice` is the lattice of its cells.
    pub(super) level: Level,
    pub(super) lattice: Grid,
    /// The kernel without growth.
    pub(super) kernel: Kernel,
    /// The ratio of the sums of kernels to their means.
    pub(super) density: f64,
    pub(super) depths: Depths<'a>,
}

/// The depths that a picture reads and writes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Depths<'a> {
    /// The depths at which rays end; see [`Picture::solids`].
    pub(super) solids: Option<&'a DepthMap>,
    /// Whether pixels are half depths; see [`Picture::halves`].
    pub(super) halves: bool,
}

impl<'a> Shot<'a> {
    /// Plans the picture of the matter of a region of a frame.
    pub(super) fn new(
        frame: &Frame<'a>,
        (grid, part): (&'a Grid, Option<&'a OwnedPart>),
        region: Region,
        depths: Depths<'a>,
    ) -> Result<Self> {
        let Frame { camera, settings, .. } = *frame;
        let grid = part.map_or(grid, |part| &part.grid);
        let kernel = settings.reconstruction_kernel();
        let (growths, level) = growths(camera, grid, settings, &kernel);
        let (lattice, density) = (level.grid(grid)?, settings.normalization.density(&kernel));
        Ok(Self { camera, settings, grid, part, region, growths, level, lattice, kernel, density, depths })
    }

    /// Returns the voxel of the lattice at the first voxel of the scene.
    pub(super) fn first_voxel(&self) -> [u32; 3] {
        self.part.map_or([0; 3], |part| part.first)
    }

    /// Returns the point of the lattice at the first point of the scene.
    pub(super) fn first(&self) -> [isize; 3] {
        self.first_voxel().map(|voxel| (voxel >> self.level.0) as isize)
    }

    /// Returns the first and the last point of the scene along each axis of the lattice.
    pub(super) fn held(&self) -> Result<[[f64; 2]; 3]> {
        let lattice = self.part.map_or(Ok(self.lattice), |part| self.level.grid(&part.held))?;
        let first = self.first();
        Ok([0, 1, 2].map(|axis| [0, lattice.dims()[axis] as isize - 1].map(|end| (first[axis] + end) as f64)))
    }

    /// Returns the least and the largest place of the slabs of a partial picture, and whether the eye lies between
    /// them.
    pub(super) fn owned(&self) -> Option<([DVec3; 2], bool)> {
        let to_cells = |place: DVec3| DVec3::from_array(place.to_array().map(|place| self.level.cells_of(place)));
        self.part.map(|part| (part.owned.map(to_cells), part.has_eye))
    }

    /// Returns the kernels whose fields are blended.
    pub(super) fn kernels(&self) -> Vec<Kernel> {
        self.growths.iter().map(|growth| self.level.kernel(&self.kernel, *growth)).collect()
    }

    /// Returns the blend of the fields in `made`, one for each growth.
    pub(super) fn blend<'b, V, F>(&self, made: &'b [Arc<V>], field: impl Fn(&'b V) -> &'b F) -> Blend<'b, F> {
        let levels = self.growths.iter().zip(made).map(|(growth, made)| (*growth, field(made))).collect();
        Blend::new(levels, WIDE * self.level.size(), self.growth())
    }

    /// Returns the growth of kernels over the lattice.
    pub(super) fn growth(&self) -> LatticeGrowth {
        let Self { camera, grid, .. } = *self;
        LatticeGrowth::new(camera.growth(grid), camera, &self.lattice.to_world())
    }

    /// Returns the size of cells in voxels, and the voxel at cell 0 along each axis.
    pub(super) fn to_voxels(&self) -> [f32; 2] {
        let first = self.grid.to_lattice().transform_point3(self.lattice.to_world().translation);
        [self.level.size() as f32, first.x as f32]
    }

    /// Returns the sides of unclipped matter; see [`Picture::sides`].
    pub(super) fn sides(&self) -> Vec<(DVec3, f64)> {
        let Self { settings, grid, level, lattice, .. } = self;
        let middle = DVec3::from_array(grid.dims().map(|d| (f64::from(d) - 1.0) / 2.0));
        let to_voxels = grid.to_lattice() * lattice.to_world();
        let side = |(gradient, value): (DVec3, f64)| {
            (to_voxels.matrix3.transpose() * gradient, value + gradient.dot(to_voxels.translation - middle))
        };
        let mut sides: Vec<(DVec3, f64)> = settings.clip.sides(grid).into_iter().map(side).collect();
        // Cells reach beyond the volume, where scalars end.
        if settings.is_post_shaded() && *level != Level(0) {
            sides.extend((0..3).flat_map(|axis| {
                let voxels = f64::from(grid.dims()[axis]);
                let faces = [(1.0, 0.5 + middle[axis]), (-1.0, voxels - 0.5 - middle[axis])];
                faces.map(|(sign, value)| side((sign * DVec3::AXES[axis], value)))
            }));
        }
        sides
    }

    /// Returns the gradient of depth and the depth at point 0; see [`Projection::depth`].
    pub(super) fn depth_in_box(&self) -> (DVec3, f64) {
        let Self { camera, grid, lattice, .. } = self;
        let in_voxels = grid.to_world().matrix3.transpose() * camera.forward;
        let dims = DVec3::from_array(grid.dims().map(f64::from));
        let gradient = in_voxels / in_voxels.abs().dot(dims);
        let to_voxels = grid.to_lattice() * lattice.to_world();
        let at_zero = 0.5 + gradient.dot(to_voxels.translation - (dims - 1.0) / 2.0);
        (to_voxels.matrix3.transpose() * gradient, at_zero)
    }

    /// Returns the light that enters the part of the lattice, if there is one.
    pub(super) fn incoming(&self) -> Option<&Incoming> {
        self.part.and_then(|part| part.incoming.as_ref())
    }

    /// Returns the light that casts shadows, if there is one. `unit` is the world length of the unit of extinctions;
    /// with fields of scalars, voxels of level 0 are lit near visible matter alone.
    pub(super) fn falling(&self, unit: f64, has_scalars: bool) -> Option<Falling> {
        let Self { settings, grid, kernel, .. } = *self;
        let casting = settings.casting()?;
        let lattice = ShadowLattice::new(grid, kernel, settings.normalization.divisor(&kernel), unit, 1.0);
        let lattice = ShadowLattice { first: self.first_voxel(), ..lattice };
        let near = (has_scalars && self.level == Level(0)).then(|| self.kernels()[0]);
        Some(Falling { casting, lattice, clip: settings.clip.sides(grid), near })
    }
}

/// Returns the map from the points of a lattice of cells to the places of a [`Shader`] of a volume.
pub(super) fn places_of_light(grid: &Grid, lattice: &Grid) -> DAffine3 {
    let to_places = DAffine3::from_scale(DVec3::splat(1.0 / grid.unit()));
    to_places * DAffine3::from_translation(-grid.center()) * lattice.to_world()
}

/// What a picture needs of a volume.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Needs {
    /// The level of its cells.
    pub(crate) level: u32,
    /// The largest distance in voxels of the samples of which slabs are made.
    pub(crate) reach: u32,
    /// The number of fields that have coefficients in the same cell.
    fields: usize,
}

impl Needs {
    /// Returns the bytes of each voxel, of each voxel of the box around the visible ones, and of each visible voxel.
    pub(crate) fn bytes(self, is_post: bool) -> [f64; 3] {
        let voxels_of_cell = libm::exp2(f64::from(3 * self.level));
        let of_fields = self.fields as f64 / voxels_of_cell;
        // Cells of two voxels are made of all voxels at once.
        let of_cells = |bytes: f64| if self.level > 0 { bytes / 8.0 } else { 0.0 };
        // Fields of scalars reach 8 points beyond each face.
        if is_post { [5.0 * of_fields + of_cells(4.0), 0.0, 0.0] } else { [of_cells(16.0), 8.0 * of_fields, 12.0] }
    }
}

/// Returns what a picture needs.
pub(crate) fn needs(camera: &Camera, grid: &Grid, settings: &Settings) -> Needs {
    let kernel = settings.reconstruction_kernel();
    let (growths, level) = growths(camera, grid, settings, &kernel);
    let cells = growths.iter().map(|growth| level.kernel(&kernel, *growth).radius().ceil()).fold(0.0, f64::max);
    // Filters reach as far as kernels, splines 2 points farther; slabs read the next samples, of leaning rays 3 or 6
    // points away, and their differences. Cells are made of cells a point beyond their own voxels.
    let is_wide = growths.iter().any(|&growth| growth >= WIDE * level.size());
    let samples = if settings.is_post_shaded() && is_wide { 6 } else { 3 };
    let fields = fields_of_cell(settings, growths.len());
    Needs { level: level.0, reach: (cells as u32 + 5 + samples) << level.0, fields }
}

/// Returns the number of fields that have coefficients in the same cell, of `count` that are blended. Fields of lit
/// voxels have them where they have weights: two in a point, and three in a cell across which kernels do not double.
pub(super) fn fields_of_cell(settings: &Settings, count: usize) -> usize {
    let is_served = settings.lighting.is_some() && !settings.is_post_shaded();
    if is_served { count.min(3) } else { count }
}

/// Returns the growths of the kernels whose fields a picture needs, and the level of their lattice.
fn growths(camera: &Camera, grid: &Grid, settings: &Settings, kernel: &Kernel) -> (Vec<f64>, Level) {
    let growth = if settings.antialiasing { camera.growth(grid) } else { Growth::NONE };
    let depths = camera.eye().map_or([0.0; 2], |eye| {
        let to_center = (grid.center() - eye).dot(camera.forward);
        let depths = grid.corners_from_center(0.5).map(|corner| to_center + corner.dot(camera.forward));
        [depths.into_iter().fold(f64::INFINITY, f64::min).max(0.0), depths.into_iter().fold(0.0, f64::max)]
    });
    let requested = if let Cells::At(level) = settings.level { Some(level) } else { None };
    let least = requested.map_or(0.0, |level| Level(level).least());
    // Views of a turning volume differ in the last bit, and share a field.
    let [smallest, largest] = depths.map(|depth| (growth.at(depth).max(least) * STEPS).round() / STEPS);
    let level = Level::new(kernel, smallest, requested);
    if camera.eye().is_none() || largest <= NO_GROWTH {
        return (vec![largest], level);
    }
    (blend::levels(smallest, largest, level.most(kernel)), level)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::View;

    #[test]
    fn views_of_a_turning_volume_share_fields() {
        let grid = Grid::new([40, 30, 20], DAffine3::from_scale(DVec3::splat(0.7))).unwrap();
        let (settings, kernel) = (Settings::default(), Kernel::default());
        let growths_of = |azimuth: f64| {
            let view = View { azimuth, elevation: 17.0, view_height: Some(60.0), ..View::default() };
            growths(&Camera::new(&view, &grid, [32; 2]).unwrap(), &grid, &settings, &kernel)
        };
        let first = growths_of(0.0);
        assert!(first.0[0] > 2.0, "{first:?}");
        assert!((1..100).all(|step| growths_of(3.7 * f64::from(step)) == first));
    }
}
