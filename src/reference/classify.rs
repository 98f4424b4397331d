//! From scalars to splats: how much each voxel counts. Voxels are classified brick by brick, when a ray asks for them.

use std::sync::{Arc, OnceLock};

use glam::{DMat3, DVec3};

use super::cells::Cells;
use super::layers::Media;
use super::ray::{Viewer, Weights};
use crate::clip::is_inside;
use crate::error::{Error, Result};
use crate::layers::Layers;
use crate::lighting::shadow::{Block, Caster, Lattice, Medium, Shares};
use crate::lighting::{Lighting, Visibility};
use crate::settings::{Model, Settings};
use crate::transfer::{ControlPoint, Resolution, TransferFunction};
use crate::volume::{Grid, Samples, Volume};

/// The weight of voxels that do not count.
const CLEAR: Weights = [0.0; 4];

/// Voxels along the edge of a brick.
const EDGE: usize = 8;

/// The voxels of a volume, to be classified.
#[derive(Debug)]
pub(super) struct Splats {
    grid: Grid,
    dims: [usize; 3],
    samples: Arc<Samples>,
    rescale: (f64, f64),
    transfer: TransferFunction,
    unit: f64,
    base: f64,
    /// Which differences of voxels are rounding.
    resolution: Resolution,
    lighting: Option<Lighting>,
    /// Unless all light arrives.
    shadows: Option<Shadows>,
    /// From gradients along the lattice axes to such in the world.
    to_world: DMat3,
    /// Whether weights are scalars, and the samples at the edge are repeated beyond it: post-shading and projections
    /// of intensity.
    repeats: bool,
    emits: bool,
    /// Whether what is reconstructed is composited, not the largest taken.
    composites: bool,
    pub(super) cells: Cells,
    bounds: Option<[[i64; 2]; 3]>,
    /// Several layers; `None`: all is said by samples and transfer function.
    media: Option<Media>,
}

/// What keeps light from voxels.
struct Shadows {
    medium: Medium<f64>,
    caster: Caster<f64>,
    /// What arrives at voxels, brick by brick, where it was asked for.
    bricks: Vec<OnceLock<Vec<Shares<EDGE>>>>,
}

impl Shadows {
    /// What arrives at the voxels of the brick that begins at a lattice point, row by row.
    fn shares(&self, start: [usize; 3]) -> Vec<Shares<EDGE>> {
        let block = Block { start, down: EDGE, wanted: &[u32::MAX; EDGE * EDGE] };
        self.caster.shares::<EDGE>(&self.medium, &block)
    }
}

/// Bricks along the axes of a lattice.
fn brick_counts(dims: [usize; 3]) -> [usize; 3] {
    dims.map(|d| d.div_ceil(EDGE))
}

impl std::fmt::Debug for Shadows {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Shadows")
    }
}

impl Splats {
    /// Reads the volume once.
    ///
    /// # Errors
    /// [`Error::Transfer`] where an extinction is too large to be a number, [`Error::Input`](crate::Error::Input) where
    /// values are too far apart, [`Error::Input`](crate::Error::Input) and [`Error::Memory`] if samples cannot be read.
    pub(super) fn new(volume: &Volume, transfer: &TransferFunction, settings: &Settings) -> Result<Self> {
        let unit = transfer.unit_or(volume.grid().min_spacing());
        if !TransferFunction::extinction(transfer.max_opacity(), unit).is_finite() {
            return Err(Error::Transfer(format!("opacity per {unit} is more extinction than a number can hold")));
        }
        let dims = volume.grid().dims().map(|d| d as usize);
        let (samples, rescale) = (volume.shared_samples()?, volume.rescale());
        let cells = Cells::new(dims, |index| rescale.0 * samples.raw(index) + rescale.1);
        let base = transfer.base();
        let repeats = settings.is_post_shaded();
        let counts = |[low, high]: [f64; 2]| {
            if repeats { low != base || high != base } else { !transfer.is_invisible([low, high]) }
        };
        let [low, high] = cells.range();
        if repeats && ![low - base, high - base].iter().all(|v| v.is_finite()) {
            return Err(Error::volume("values are further apart than a number can hold"));
        }
        let bounds = cells.bounds(dims, counts);
        let splats = Self {
            grid: volume.grid().centered(),
            dims,
            samples,
            rescale,
            transfer: transfer.clone(),
            unit,
            base,
            resolution: Resolution::new(transfer, volume)?,
            lighting: settings.lighting.as_ref().map(|lighting| lighting.seen_from(volume.grid().center())),
            shadows: None,
            to_world: volume.grid().to_lattice().matrix3.transpose(),
            repeats,
            emits: settings.model != Model::Xray,
            composites: settings.model == Model::Composite,
            cells,
            bounds,
            media: None,
        };
        splats.with_shadows(volume.grid(), settings)
    }

    /// Several layers, pre-shaded.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub(super) fn of_layers(layers: &Layers, settings: &Settings) -> Result<Self> {
        let (grid, media) = (layers.grid(), Media::new(layers)?);
        let dims = grid.dims().map(|d| d as usize);
        let point = |index: usize| [index % dims[0], index / dims[0] % dims[1], index / dims[0] / dims[1]];
        let cells = Cells::new(dims, |index| media.tau(point(index)));
        let bounds = cells.bounds(dims, |[_, most]| most > 0.0);
        let clear = ControlPoint { value: 0.0, color: [0.0; 3], opacity: 0.0 };
        let splats = Self {
            grid: grid.centered(),
            dims,
            samples: Arc::new(Samples::U8(Vec::new())),
            rescale: (1.0, 0.0),
            transfer: TransferFunction::new(vec![clear], None)?,
            unit: layers.unit(),
            base: 0.0,
            resolution: Resolution::NONE,
            lighting: settings.lighting.as_ref().map(|lighting| lighting.seen_from(grid.center())),
            shadows: None,
            to_world: grid.to_lattice().matrix3.transpose(),
            repeats: false,
            emits: settings.model != Model::Xray,
            composites: settings.model == Model::Composite,
            cells,
            bounds,
            media: Some(media),
        };
        splats.with_shadows(grid, settings)
    }

    /// The same with what keeps light from voxels, if any does.
    fn with_shadows(mut self, grid: &Grid, settings: &Settings) -> Result<Self> {
        let dims = self.dims;
        if let Some(casting) = settings.lighting.as_ref().and_then(Lighting::casting) {
            let mut medium = Medium::new(dims)?;
            let sides = settings.clip.sides(grid);
            let middle = DVec3::from_array(dims.map(|d| (d - 1) as f64 / 2.0));
            for index in 0..dims.iter().product() {
                let point = [index % dims[0], index / dims[0] % dims[1], index / dims[0] / dims[1]];
                let tau = self.tau(point);
                if tau > 0.0 && is_inside(&sides, DVec3::from_array(point.map(|p| p as f64)) - middle) {
                    medium.set(point, tau);
                }
            }
            let divisor = settings.normalization.divisor(&settings.kernel);
            let lattice = Lattice::new(grid, settings.kernel, divisor, 1.0, 1.0);
            let bricks = (0..brick_counts(dims).iter().product()).map(|_| OnceLock::new()).collect();
            self.shadows = Some(Shadows { caster: Caster::new(&casting, &lattice), medium, bricks });
        }
        Ok(self)
    }

    /// The extinction of a voxel, per world unit.
    fn tau(&self, point: [usize; 3]) -> f64 {
        match &self.media {
            Some(media) => media.tau(point),
            None => self.extinction(self.transfer.sample(self.value(self.index(point))).1, point),
        }
    }

    /// Whether voxels with values of a range of [`Self::cells`] may count.
    pub(super) fn may_show(&self, range: [f64; 2]) -> bool {
        if self.media.is_some() { range[1] > 0.0 } else { !self.transfer.is_invisible(range) }
    }

    /// Whether weights depend on who looks.
    pub(super) fn depend_on_viewer(&self) -> bool {
        !self.repeats && self.lighting.is_some()
    }

    /// Whether more than extinction or scalar counts.
    pub(super) fn channels(&self) -> usize {
        if self.emits && (!self.repeats || self.has_gradients()) { 4 } else { 1 }
    }

    /// Whether gradients are reconstructed beside scalars.
    fn has_gradients(&self) -> bool {
        self.lighting.is_some() || (self.composites && !self.transfer.gradient_opacity().is_empty())
    }

    /// Whether scalars are reconstructed, in the box of the voxels.
    pub(super) fn repeats(&self) -> bool {
        self.repeats
    }

    pub(super) fn transfer(&self) -> &TransferFunction {
        &self.transfer
    }

    fn value(&self, index: usize) -> f64 {
        self.rescale.0 * self.samples.raw(index) + self.rescale.1
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// Half the differences of the neighbours' values along the lattice axes. A neighbour beyond the edge has the value
    /// at the edge.
    fn central_differences(&self, point: [usize; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let at = |p: usize| self.value(self.index(std::array::from_fn(|a| if a == axis { p } else { point[a] })));
            // Halved first: no difference of numbers overflows.
            at((point[axis] + 1).min(self.dims[axis] - 1)) / 2.0 - at(point[axis].saturating_sub(1)) / 2.0
        })
    }

    /// The gradient of the scalar at a voxel, world coordinates; 0 if its differences are rounding.
    pub(super) fn gradient(&self, point: [usize; 3]) -> DVec3 {
        let distance = self.value(self.index(point)) - self.base;
        self.to_world * DVec3::from_array(self.resolution.resolved(self.central_differences(point), distance))
    }

    /// What of the light arrives at a place in the lattice: trilinear between voxels, beyond the outermost as there.
    pub(super) fn visibility(&self, place: DVec3) -> Visibility {
        let Some(shadows) = &self.shadows else { return Visibility::FULL };
        let counts = brick_counts(self.dims);
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
            let [i, j, k] = [0, 1, 2].map(|axis| first[axis] as usize + offset[axis]);
            let brick = ((k / EDGE) * counts[1] + j / EDGE) * counts[0] + i / EDGE;
            let shares = shadows.bricks[brick].get_or_init(|| shadows.shares([i, j, k].map(|p| p / EDGE * EDGE)));
            let arrives = Visibility::of(&shares[(k % EDGE) * EDGE + j % EDGE], i % EDGE);
            visibility.lights.iter_mut().zip(arrives.lights).for_each(|(sum, share)| *sum += weight * share);
            visibility.ambient += weight * arrives.ambient;
        }
        visibility
    }

    /// Whether light is kept from voxels.
    pub(super) fn has_shadows(&self) -> bool {
        self.shadows.is_some()
    }

    /// The extinction of a voxel whose value has some opacity, per world unit.
    fn extinction(&self, opacity: f64, point: [usize; 3]) -> f64 {
        let tau = TransferFunction::extinction(opacity, self.unit);
        if tau <= 0.0 || self.transfer.gradient_opacity().is_empty() {
            return tau;
        }
        tau * self.transfer.gradient_share(self.gradient(point).length())
    }

    /// What a voxel weighs for a viewer.
    fn classify(&self, point: [usize; 3], viewer: Viewer, visibility: &Visibility) -> Weights {
        if self.repeats {
            let value = self.value(self.index(point));
            let [x, y, z] = if self.has_gradients() { self.central_differences(point) } else { [0.0; 3] };
            return [value - self.base, x, y, z];
        }
        let (mut color, tau, normal) = match &self.media {
            Some(media) => media.voxel(point, self.lighting.is_some()),
            None => {
                let (color, opacity) = self.transfer.sample(self.value(self.index(point)));
                let normal = self.lighting.as_ref().map_or(DVec3::ZERO, |_| self.gradient(point));
                (color, self.extinction(opacity, point), normal)
            }
        };
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

    /// The lattice box that holds every splat, both ends included, with `layers` repetitions of the edge where it is
    /// repeated; `None` where no voxel counts.
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

/// Voxels classified for one viewer, brick by brick, x fastest; `None` if none of a brick counts.
#[derive(Debug)]
pub(super) struct Bricks {
    viewer: Viewer,
    /// Whether weights are kept in f32.
    rounded: bool,
    counts: [usize; 3],
    bricks: Vec<OnceLock<Option<Brick>>>,
}

/// The weights of the voxels of a brick, x fastest.
#[derive(Debug)]
pub(super) enum Brick {
    Exact(Box<[Weights; EDGE * EDGE * EDGE]>),
    /// To be multiplied by the number.
    Rounded(Box<[[f32; 4]; EDGE * EDGE * EDGE]>, f64),
}

impl Brick {
    fn get(&self, index: usize) -> Weights {
        match self {
            Self::Exact(weights) => weights[index],
            Self::Rounded(weights, unit) => weights[index].map(|w| f64::from(w) * unit),
        }
    }
}

impl Bricks {
    pub(super) fn new(splats: &Splats, viewer: Viewer, rounded: bool) -> Self {
        let counts = brick_counts(splats.dims);
        let bricks = (0..counts.iter().product()).map(|_| OnceLock::new()).collect();
        Self { viewer, rounded, counts, bricks }
    }

    /// The weights of the splat at a lattice point; 0 if there is none. Outside the lattice that is what the nearest
    /// point of the edge repeats, and nothing where the edge is not repeated. `last` is the brick asked for last.
    pub(super) fn get<'a>(
        &'a self,
        splats: &Splats,
        point: [i64; 3],
        last: &mut Option<(usize, Option<&'a Brick>)>,
    ) -> Weights {
        let inside: [i64; 3] = std::array::from_fn(|axis| point[axis].clamp(0, splats.dims[axis] as i64 - 1));
        if !splats.repeats && inside != point {
            return CLEAR;
        }
        let [i, j, k] = inside.map(|p| p as usize);
        let number = ((k / EDGE) * self.counts[1] + j / EDGE) * self.counts[0] + i / EDGE;
        let brick = match *last {
            Some((of, brick)) if of == number => brick,
            _ => {
                let brick = self.bricks[number].get_or_init(|| self.classified(splats, [i, j, k])).as_ref();
                *last = Some((number, brick));
                brick
            }
        };
        let Some(brick) = brick else { return CLEAR };
        let mut weights = brick.get((k % EDGE * EDGE + j % EDGE) * EDGE + i % EDGE);
        if inside != point {
            // Beyond an edge all neighbours across it have the same value.
            for axis in 0..3 {
                if inside[axis] != point[axis] {
                    weights[axis + 1] = 0.0;
                }
            }
        }
        weights
    }

    /// The brick that holds a voxel.
    fn classified(&self, splats: &Splats, voxel: [usize; 3]) -> Option<Brick> {
        let first = voxel.map(|p| p / EDGE * EDGE);
        if !splats.repeats && !splats.may_show(splats.cells.range_of(first, EDGE)) {
            return None;
        }
        let mut weights = Box::new([CLEAR; EDGE * EDGE * EDGE]);
        let [x, y, z] = std::array::from_fn(|a| first[a]..splats.dims[a].min(first[a] + EDGE));
        let shares = splats.shadows.as_ref().filter(|_| !splats.repeats).map(|shadows| shadows.shares(first));
        for k in z {
            for j in y.clone() {
                for i in x.clone() {
                    let at = (k % EDGE * EDGE + j % EDGE) * EDGE + i % EDGE;
                    let row = |s: &Vec<Shares<EDGE>>| Visibility::of(&s[(k % EDGE) * EDGE + j % EDGE], i % EDGE);
                    let visibility = shares.as_ref().map_or(Visibility::FULL, row);
                    weights[at] = splats.classify([i, j, k], self.viewer, &visibility);
                }
            }
        }
        let largest = weights.iter().flatten().fold(0.0_f64, |most, w| most.max(w.abs()));
        if largest == 0.0 {
            return None;
        }
        if !self.rounded {
            return Some(Brick::Exact(weights));
        }
        let mut rounded = Box::new([[0.0; 4]; EDGE * EDGE * EDGE]);
        for (r, w) in rounded.iter_mut().zip(&*weights) {
            *r = w.map(|w| (w / largest) as f32);
        }
        Some(Brick::Rounded(rounded, largest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_every_voxel_that_is_not_clear_and_no_other() {
        let dims = [7, 11, 13];
        let values: Vec<f32> = (0..7 * 11 * 13).map(|i| if i % 5 == 3 { i as f32 / 1001.0 } else { 0.0 }).collect();
        let grid = Grid::axis_parallel(dims, [1.0, 2.0, 3.0]).unwrap();
        let volume = Volume::new(grid, Samples::F32(values.clone())).unwrap();
        let point = |value, opacity| ControlPoint { value, color: [1.0, 0.5, 0.25], opacity };
        let transfer = TransferFunction::new(vec![point(0.0, 0.0), point(1.0, 0.9)], Some(0.5)).unwrap();
        let splats = Splats::new(&volume, &transfer, &Settings::default()).unwrap();
        assert_eq!(splats.bounds(2), Some([[0, 6], [0, 10], [0, 12]]));
        for (rounded, tolerance) in [(false, 1e-12), (true, 1e-7)] {
            let bricks = Bricks::new(&splats, Viewer::Towards(DVec3::X), rounded);
            let mut last = None;
            for (index, &value) in values.iter().enumerate() {
                let weights = bricks.get(&splats, [index % 7, index / 7 % 11, index / 77].map(|p| p as i64), &mut last);
                let opacity = 0.9 * f64::from(value);
                assert_eq!(weights != CLEAR, value > 0.0, "voxel {index}");
                let tau = -(1.0 - opacity).ln() / 0.5;
                for (got, color) in weights.iter().zip([1.0, 1.0, 0.5, 0.25]) {
                    assert!((got - color * tau).abs() <= tolerance * 2.0 * tau, "voxel {index}");
                }
            }
            assert_eq!(bricks.get(&splats, [7, 3, 3], &mut last), CLEAR);
        }
    }

    #[test]
    fn a_clear_volume_has_no_bounds() {
        let grid = Grid::axis_parallel([3, 3, 3], [1.0; 3]).unwrap();
        let volume = Volume::new(grid, Samples::U8(vec![9; 27])).unwrap();
        let clear = ControlPoint { value: 0.0, color: [1.0; 3], opacity: 0.0 };
        let transfer = TransferFunction::new(vec![clear], None).unwrap();
        assert_eq!(Splats::new(&volume, &transfer, &Settings::default()).unwrap().bounds(2), None);
    }
}
