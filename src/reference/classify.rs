//! The weights of splats. Voxels are classified brick by brick, when a ray meets their brick.

use std::sync::OnceLock;

use glam::DVec3;

use super::cells::Cells;
use super::media::Media;
use super::ray::{Viewer, Weights};
use crate::camera::clip::is_inside;
use crate::error::{Error, Result};
use crate::layers::Layers;
use crate::lighting::shadow::exact::{Caster, Medium, ShadowBlock};
use crate::lighting::shadow::{ShadowLattice, Shares};
use crate::lighting::{Lighting, Visibility};
use crate::settings::{Model, Settings};
use crate::transfer::TransferFunction;
use crate::volume::Grid;

/// The weights of invisible voxels.
const CLEAR: Weights = [0.0; 4];

/// The number of voxels along the edge of a brick.
const EDGE: usize = 8;

/// The voxels of a lattice, to be classified.
#[derive(Debug)]
pub(super) struct VoxelValues {
    grid: Grid,
    dims: [usize; 3],
    media: Media,
    lighting: Option<Lighting>,
    /// The occluders of light; `None` if the full light arrives everywhere.
    shadows: Option<BrickShadows>,
    /// Whether weights are scalars, and the samples at the edge are repeated beyond it: post-shading and projections
    /// of intensity.
    repeats: bool,
    /// Whether gradients are reconstructed beside scalars.
    differs: bool,
    emits: bool,
    pub(super) cells: Cells,
    bounds: Option<[[i64; 2]; 3]>,
}

/// The occluders of light, and the light that arrives at voxels.
struct BrickShadows {
    medium: Medium<f64>,
    caster: Caster<f64>,
    /// The light that arrives at voxels, brick by brick, once it is needed.
    bricks: Vec<OnceLock<Vec<Shares<EDGE>>>>,
}

impl BrickShadows {
    /// Returns the light that arrives at the voxels of the brick that begins at a lattice point, row by row.
    fn shares(&self, start: [usize; 3]) -> Vec<Shares<EDGE>> {
        let block = ShadowBlock { start, down: EDGE, wanted: &[u32::MAX; EDGE * EDGE] };
        self.caster.shares::<EDGE>(&self.medium, &block)
    }
}

/// Returns the light that arrives at a voxel, given the light of its brick.
fn arriving(shares: &[Shares<EDGE>], [i, j, k]: [usize; 3]) -> Visibility {
    Visibility::of_voxel(&shares[(k % EDGE) * EDGE + j % EDGE], i % EDGE)
}

/// Returns the numbers of bricks along the axes of a lattice.
fn brick_counts(dims: [usize; 3]) -> [usize; 3] {
    dims.map(|d| d.div_ceil(EDGE))
}

/// Returns the number of the brick that holds a voxel.
fn brick_of(dims: [usize; 3], [i, j, k]: [usize; 3]) -> usize {
    let [nx, ny, _] = brick_counts(dims);
    ((k / EDGE) * ny + j / EDGE) * nx + i / EDGE
}

/// Returns the place of a voxel in its brick.
fn in_brick([i, j, k]: [usize; 3]) -> usize {
    (k % EDGE * EDGE + j % EDGE) * EDGE + i % EDGE
}

/// Makes an empty slot for each brick.
fn no_bricks<T>(dims: [usize; 3]) -> Vec<OnceLock<T>> {
    (0..brick_counts(dims).iter().product()).map(|_| OnceLock::new()).collect()
}

impl std::fmt::Debug for BrickShadows {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("BrickShadows")
    }
}

impl VoxelValues {
    /// Reads the volumes once.
    ///
    /// # Errors
    /// [`Error::Transfer`] if an extinction is too large to be a number, [`Error::Input`](crate::Error::Input) if
    /// values are too far apart, [`Error::Input`](crate::Error::Input) and [`Error::Memory`] if samples cannot be read.
    pub(super) fn new(layers: &Layers, settings: &Settings) -> Result<Self> {
        let (grid, media) = (layers.grid(), Media::new(layers, settings)?);
        let dims = grid.dims().map(|d| d as usize);
        let cells = Cells::new(dims, |index| media.number(index));
        let lighting = settings.lighting.as_ref().map(|lighting| lighting.seen_from(grid.center()));
        let scalars = media.plain().filter(|_| settings.is_post_shaded());
        let bounds = match scalars.map(TransferFunction::base) {
            Some(base) if !cells.range().iter().all(|v| (v - base).is_finite()) => {
                return Err(Error::volume("values are further apart than a number can hold"));
            }
            Some(base) => cells.bounds(dims, |range| range != [base; 2]),
            None => cells.bounds(dims, |range| media.may_show(range)),
        };
        let composites = settings.model == Model::Composite;
        let mut splats = Self {
            grid: grid.centered(),
            dims,
            repeats: scalars.is_some(),
            differs: lighting.is_some() || scalars.is_some_and(|t| composites && !t.gradient_opacity().is_empty()),
            emits: settings.model != Model::Xray,
            media,
            lighting,
            shadows: None,
            cells,
            bounds,
        };
        if let Some(casting) = settings.casting() {
            let mut medium = Medium::new(dims)?;
            let sides = settings.clip.sides(grid);
            let middle = DVec3::from_array(dims.map(|d| (d - 1) as f64 / 2.0));
            for point in (0..dims.iter().product()).map(|index| splats.media.point(index)) {
                let tau = splats.media.tau(point);
                if tau > 0.0 && is_inside(&sides, DVec3::from_array(point.map(|p| p as f64)) - middle) {
                    medium.set(point, tau);
                }
            }
            let divisor = settings.normalization.divisor(&settings.kernel);
            let lattice = ShadowLattice::new(grid, settings.kernel, divisor, 1.0, 1.0);
            splats.shadows =
                Some(BrickShadows { caster: Caster::new(&casting, &lattice), medium, bricks: no_bricks(dims) });
        }
        Ok(splats)
    }

    /// Returns whether voxels with numbers in a range of [`Self::cells`] may be visible.
    pub(super) fn may_show(&self, range: [f64; 2]) -> bool {
        self.media.may_show(range)
    }

    /// Returns whether weights depend on the viewer.
    pub(super) fn depend_on_viewer(&self) -> bool {
        !self.repeats && self.lighting.is_some()
    }

    /// Returns the number of weights that are not always 0.
    pub(super) fn channels(&self) -> usize {
        if if self.repeats { self.differs } else { self.emits } { 4 } else { 1 }
    }

    /// Returns whether scalars are reconstructed, in the box of the voxels.
    pub(super) fn repeats(&self) -> bool {
        self.repeats
    }

    /// Returns the light that arrives at a place in the lattice: trilinear between voxels, constant beyond the
    /// outermost.
    pub(super) fn visibility(&self, place: DVec3) -> Visibility {
        let Some(shadows) = &self.shadows else { return Visibility::FULL };
        let last = DVec3::from_array(self.dims.map(|d| (d - 1) as f64));
        let place = place.clamp(DVec3::ZERO, last);
        let first = place.floor().min((last - 1.0).max(DVec3::ZERO));
        let beyond = place - first;
        let mut visibility = Visibility { lights: [0.0; Lighting::MAX_LIGHTS], ambient: 0.0 };
        for corner in 0..8 {
            let offset = [0, 1, 2].map(|axis| corner >> axis & 1);
            let weight: f64 =
                (0..3).map(|axis| if offset[axis] == 1 { beyond[axis] } else { 1.0 - beyond[axis] }).product();
            if weight <= 0.0 {
                continue;
            }
            let point = [0, 1, 2].map(|axis| first[axis] as usize + offset[axis]);
            let brick = &shadows.bricks[brick_of(self.dims, point)];
            let shares = brick.get_or_init(|| shadows.shares(point.map(|p| p / EDGE * EDGE)));
            let arrives = arriving(shares, point);
            visibility.lights.iter_mut().zip(arrives.lights).for_each(|(sum, share)| *sum += weight * share);
            visibility.ambient += weight * arrives.ambient;
        }
        visibility
    }

    /// Returns the weights of a voxel for a viewer.
    fn classify(&self, point: [usize; 3], viewer: Viewer, visibility: &Visibility) -> Weights {
        if self.repeats {
            return self.media.first_scalar(point.map(|p| p as i64), self.differs);
        }
        let (mut color, tau, normal) = self.media.voxel(point, self.lighting.is_some());
        if tau <= 0.0 {
            return CLEAR;
        }
        if !self.emits {
            return [tau, 0.0, 0.0, 0.0];
        }
        if let Some(lighting) = &self.lighting {
            let place = self.grid.to_world().transform_point3(DVec3::from_array(point.map(|p| p as f64)));
            color = lighting.shade(color, normal, place, viewer.from(place), visibility);
        }
        let [red, green, blue] = color.map(|c| c * tau);
        [tau, red, green, blue]
    }

    /// Returns the lattice box of all splats, both ends included, with `layers` repetitions of the edge if it is
    /// repeated; `None` if there are no splats.
    pub(super) fn bounds(&self, layers: i64) -> Option<[[i64; 2]; 3]> {
        let bounds = self.bounds?;
        if !self.repeats {
            return Some(bounds);
        }
        Some(std::array::from_fn(|axis| {
            let ([low, high], last) = (bounds[axis], self.dims[axis] as i64 - 1);
            [if low == 0 { -layers } else { low }, if high == last { last + layers } else { high }]
        }))
    }
}

/// The voxels classified for one viewer, brick by brick; `None` for a brick of clear voxels.
#[derive(Debug)]
pub(super) struct ClassifiedBricks {
    viewer: Viewer,
    bricks: Vec<OnceLock<Option<Brick>>>,
}

/// The weights of the voxels of a brick, x fastest.
pub(super) type Brick = Box<[Weights; EDGE * EDGE * EDGE]>;

impl ClassifiedBricks {
    pub(super) fn new(splats: &VoxelValues, viewer: Viewer) -> Self {
        Self { viewer, bricks: no_bricks(splats.dims) }
    }

    /// Returns the weights of the splat at a lattice point; 0 if there is none. Outside the lattice the nearest point
    /// of the edge is repeated, if the edge is repeated. `last` is the brick of the preceding call.
    pub(super) fn get<'a>(
        &'a self,
        splats: &VoxelValues,
        point: [i64; 3],
        last: &mut Option<(usize, Option<&'a Brick>)>,
    ) -> Weights {
        let inside: [i64; 3] = std::array::from_fn(|axis| point[axis].clamp(0, splats.dims[axis] as i64 - 1));
        if inside != point {
            return if splats.repeats { splats.media.first_scalar(point, splats.differs) } else { CLEAR };
        }
        let voxel = inside.map(|p| p as usize);
        let number = brick_of(splats.dims, voxel);
        let brick = match *last {
            Some((of, brick)) if of == number => brick,
            _ => {
                let brick = self.bricks[number].get_or_init(|| self.classified(splats, voxel)).as_ref();
                *last = Some((number, brick));
                brick
            }
        };
        brick.map_or(CLEAR, |brick| brick[in_brick(voxel)])
    }

    /// Classifies the brick that holds a voxel.
    fn classified(&self, splats: &VoxelValues, voxel: [usize; 3]) -> Option<Brick> {
        let first = voxel.map(|p| p / EDGE * EDGE);
        if !splats.repeats && !splats.may_show(splats.cells.range_of(first, EDGE)) {
            return None;
        }
        let mut weights = Box::new([CLEAR; EDGE * EDGE * EDGE]);
        let [x, y, z] = std::array::from_fn(|a| first[a]..splats.dims[a].min(first[a] + EDGE));
        let shares = splats.shadows.as_ref().filter(|_| !splats.repeats).map(|shadows| shadows.shares(first));
        for k in z {
            for j in y.clone() {
                for voxel in x.clone().map(|i| [i, j, k]) {
                    let visibility = shares.as_ref().map_or(Visibility::FULL, |shares| arriving(shares, voxel));
                    weights[in_brick(voxel)] = splats.classify(voxel, self.viewer, &visibility);
                }
            }
        }
        weights.iter().any(|w| *w != CLEAR).then_some(weights)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::{Classification, ControlPoint};
    use crate::volume::{Samples, Volume};

    #[test]
    fn finds_every_voxel_that_is_not_clear_and_no_other() {
        let dims = [7, 11, 13];
        let values: Vec<f32> = (0..7 * 11 * 13).map(|i| if i % 5 == 3 { i as f32 / 1001.0 } else { 0.0 }).collect();
        let grid = Grid::axis_parallel(dims, [1.0, 2.0, 3.0]).unwrap();
        let volume = Volume::new(grid, Samples::F32(values.clone())).unwrap();
        let point = |value, opacity| ControlPoint { value, color: [1.0, 0.5, 0.25], opacity };
        let transfer = TransferFunction::new(vec![point(0.0, 0.0), point(1.0, 0.9)], Some(0.5)).unwrap();
        let transfer = transfer.with_classification(Classification::Point);
        let splats = VoxelValues::new(&Layers::of_volume(&volume, &transfer), &Settings::default()).unwrap();
        assert_eq!(splats.bounds(2), Some([[0, 6], [0, 10], [0, 12]]));
        let bricks = ClassifiedBricks::new(&splats, Viewer::Towards(DVec3::X));
        let mut last = None;
        for (index, &value) in values.iter().enumerate() {
            let weights = bricks.get(&splats, [index % 7, index / 7 % 11, index / 77].map(|p| p as i64), &mut last);
            let opacity = 0.9 * f64::from(value);
            assert_eq!(weights != CLEAR, value > 0.0, "voxel {index}");
            let tau = -(1.0 - opacity).ln() / 0.5;
            for (got, color) in weights.iter().zip([1.0, 1.0, 0.5, 0.25]) {
                assert!((got - color * tau).abs() <= 1e-12 * tau, "voxel {index}");
            }
        }
        assert_eq!(bricks.get(&splats, [7, 3, 3], &mut last), CLEAR);
    }

    #[test]
    fn a_clear_volume_has_no_bounds() {
        let grid = Grid::axis_parallel([3, 3, 3], [1.0; 3]).unwrap();
        let volume = Volume::new(grid, Samples::U8(vec![9; 27])).unwrap();
        let clear = ControlPoint { value: 0.0, color: [1.0; 3], opacity: 0.0 };
        let transfer = TransferFunction::new(vec![clear], None).unwrap();
        assert_eq!(
            VoxelValues::new(&Layers::of_volume(&volume, &transfer), &Settings::default()).unwrap().bounds(2),
            None
        );
    }
}
