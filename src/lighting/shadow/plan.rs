//! The preparations of shadows as numbers for the stages of a device (`gpu/shadows.rs`): the same responses, stencils,
//! directions and weights as on the host.

use std::sync::Arc;

use glam::DVec3;

use super::response::{StencilRow, SweepResponse};
use super::sweep::{Direction, NearPlace, Pyramid, parallel_planes};
use super::{Bundle, LightRays, LitBox, ShadowLattice, around, axes_across, strict_across};
use crate::lighting::Casting;

/// The numbers of rows and terms of [`LightPlans::table`].
#[cfg(test)]
pub(crate) const TABLE: [u32; 2] = [super::response::ROWS, super::response::TERMS];

/// The plans of lights on a box of voxels.
pub(crate) struct LightPlans {
    lit: LitBox,
    response: Arc<SweepResponse>,
}

/// The stages that find a light.
pub(crate) enum LightPlan {
    /// No stages, because all light arrives everywhere.
    Full,
    /// Sweeps along directions, whose light is added up.
    Parallel(Vec<SweepPlan>),
    /// Sweeps towards a place, each for other voxels.
    Converging(Vec<ConvergingPlan>),
    /// Sums along the rays to the neighbours of voxels.
    Around(AroundPlan),
}

/// A sweep along directions that go together.
pub(crate) struct SweepPlan {
    /// The lattice axes of planes, rows and columns.
    pub(crate) axes: [usize; 3],
    /// Whether the light lies at the end of the last plane.
    pub(crate) ahead: bool,
    /// The number of nearest planes that are not taken from the sweep.
    pub(crate) near: usize,
    /// The weights of neighbours.
    pub(crate) stencil: Stencil,
    /// The places of each plane's first row and column among the rays of each direction, the plane nearest to the light
    /// first: whole parts and fractions.
    pub(crate) places: Vec<Vec<[(i64, f32); 2]>>,
    /// The factor of sums of planes, the factor of all, and the light that an unshadowed voxel gets, for each
    /// direction.
    pub(crate) factors: Vec<[f32; 3]>,
}

/// A sweep towards a place, for voxels from which it lies mainly across planes, on one side.
pub(crate) struct ConvergingPlan {
    /// The lattice axes of planes, rows and columns.
    pub(crate) axes: [usize; 3],
    /// Whether the place lies towards the end of the last plane.
    pub(crate) ahead: bool,
    /// The number of planes, from the end of the light on, that rays do not pass.
    pub(crate) skipped: usize,
    /// The numbers of rows and columns of rays.
    pub(crate) size: [usize; 2],
    /// The place of the light, in planes, rows and columns of the box.
    pub(crate) place: [f32; 3],
    /// The world vectors of a step to the next plane, row and column, in the unit of extinctions.
    pub(crate) to_world: [[f32; 3]; 3],
    /// Whether rays that run as much along rows, or columns, as along planes are left to another axis.
    pub(crate) strict: [bool; 2],
    /// The row and the column near the light from which places are counted, so that numbers stay small.
    pub(crate) origin: [f32; 2],
    /// The maps of each plane from the light on: the factor of distances from `origin` among the rays, the row and the
    /// column of `origin` among the rays, and the weight of the plane; then the distance of rays in the plane, the row
    /// and the column of the first ray from `origin`, and 0.
    pub(crate) planes: Vec<[[f32; 4]; 2]>,
}

/// The stencils of rays to a place.
pub(crate) struct NearPlan {
    /// The number of steps of slopes from 0 to 1: slopes of rows are 0 to 1, of columns -1 to 1.
    pub(crate) steps: usize,
    /// The number of planes from the place within which voxels add up sections of kernels.
    pub(crate) direct: f32,
    /// The rows and weights of all stencils, one after the other.
    pub(crate) stencil: Stencil,
    /// The first row and the first weight of each stencil, and once more at the end.
    pub(crate) firsts: Vec<[u32; 2]>,
}

/// The weights of a voxel's neighbours, row by row.
pub(crate) struct Stencil {
    /// The planes towards the light, the rows, the first column and the number of weights of each row of neighbours.
    pub(crate) rows: Vec<[i32; 4]>,
    pub(crate) weights: Vec<f32>,
}

/// Weighted sums along the rays to neighbours.
pub(crate) struct AroundPlan {
    /// The weights of the filter of the field, along each axis.
    pub(crate) filter: Vec<f32>,
    /// The step to the next point of each ray along x, y and z, and the number of points.
    pub(crate) rays: Vec<[i32; 4]>,
    /// The factor of each ray's light.
    pub(crate) shares: Vec<f32>,
    /// The weights of the points, ray after ray.
    pub(crate) weights: Vec<f32>,
}

impl LightPlans {
    /// Plans lights on a box of voxels of a lattice, given by its first lattice point and its size. `None` if all
    /// kernels on each ray are summed, which only the host does.
    pub(crate) fn new(casting: &Casting, lattice: &ShadowLattice, bounds: [[usize; 3]; 2]) -> Option<Self> {
        let response = SweepResponse::new(&lattice.kernel, lattice.divisor).map(Arc::new);
        let mut lit = LitBox::new(casting, lattice, bounds, response);
        let response = lit.response.take()?;
        Some(Self { lit, response })
    }

    /// Returns the first lattice point of the box with the voxels around it whose kernels absorb light too.
    pub(crate) fn low(&self) -> [i64; 3] {
        self.lit.low
    }

    /// Returns the size of the box with the voxels around it whose kernels absorb light too.
    pub(crate) fn dims(&self) -> [usize; 3] {
        self.lit.lattice.dims
    }

    /// Returns the weights of the filters of sweeps across planes and within planes, the middle one first.
    pub(crate) fn filters(&self) -> [Vec<f32>; 2] {
        [&self.response.across, &self.response.within].map(|weights| weights.iter().map(|&w| w as f32).collect())
    }

    /// Returns the factor of the shadows of a light.
    pub(crate) fn strength(&self, light: usize) -> f32 {
        self.lit.strength(light)
    }

    /// Returns the plan of a light, or for [`MAX_CASTING`](super::MAX_CASTING) of the ambient light.
    pub(crate) fn light(&self, light: usize) -> LightPlan {
        match self.lit.rays(light) {
            None => LightPlan::Full,
            Some(LightRays::Parallel(bundles)) => {
                LightPlan::Parallel(bundles.iter().map(|bundle| self.sweep(bundle)).collect())
            }
            Some(LightRays::Around) => LightPlan::Around(self.around()),
            Some(LightRays::To(place)) => {
                let place = self.lit.lattice.to_lattice.transform_point3(place);
                let sides = (0..3).flat_map(|axis| [true, false].map(|ahead| (axis, ahead)));
                LightPlan::Converging(sides.filter_map(|(axis, ahead)| self.converging(place, axis, ahead)).collect())
            }
        }
    }

    fn sweep(&self, Bundle { axis, towards, directions }: &Bundle) -> SweepPlan {
        let near = self.response.near(*towards, self.lit.bias());
        let axes = axes_across(*axis);
        let [planes, rows, columns] = axes.map(|axis| self.lit.lattice.dims[axis]);
        let first = self.lit.low[*axis];
        let whole = |place: f64| (place.floor() as i64, (place - place.floor()) as f32);
        let of_direction = |direction: &Direction| parallel_planes(direction, [planes, rows, columns], first);
        let maps: Vec<Vec<[f64; 2]>> = directions.iter().map(of_direction).collect();
        let places = (0..planes).map(|plane| maps.iter().map(|places| places[plane].map(whole)).collect());
        SweepPlan {
            axes,
            ahead: near.ahead,
            near: near.planes,
            stencil: Stencil::new(near.stencil.iter()),
            places: places.collect(),
            factors: directions.iter().map(|direction| direction.factors(&self.response)).collect(),
        }
    }

    /// Plans the sweep across an axis to a lattice point of the box; `None`: its rays pass no voxel.
    fn converging(&self, place: DVec3, axis: usize, ahead: bool) -> Option<ConvergingPlan> {
        let lattice = &self.lit.lattice;
        let axes = axes_across(axis);
        let dims = axes.map(|axis| lattice.dims[axis]);
        let seen = DVec3::from_array(axes.map(|axis| place[axis]));
        let pyramid = Pyramid::new(seen, dims, ahead)?;
        let origin = [1, 2].map(|k| seen[k].clamp(0.0, (dims[k] - 1) as f64) as f32);
        let plane = |distance: f64| {
            let [rows, columns] = pyramid.maps(distance);
            let [row, column] = [(rows, origin[0]), (columns, origin[1])].map(|(map, origin)| {
                let origin = f64::from(origin);
                [(map.into[0] * origin + map.into[1]) as f32, (map.back[1] - origin) as f32]
            });
            let weight = Pyramid::weight(distance);
            [[rows.into[0] as f32, row[0], column[0], weight], [rows.back[0] as f32, row[1], column[1], 0.0]]
        };
        let skipped = std::iter::repeat_n([[0.0; 4]; 2], pyramid.skipped);
        let step = |axis: usize| (lattice.to_world.col(axis) / lattice.unit).as_vec3().to_array();
        Some(ConvergingPlan {
            axes,
            ahead,
            skipped: pyramid.skipped,
            size: pyramid.size,
            place: seen.as_vec3().to_array(),
            to_world: axes.map(step),
            strict: strict_across(axis),
            origin,
            planes: skipped.chain(pyramid.distances.iter().map(|&distance| plane(distance))).collect(),
        })
    }

    /// Returns the number of nearest planes to a voxel that are not taken from sweeps to a place.
    pub(crate) fn near_planes(&self) -> usize {
        SweepResponse::planes(self.lit.bias(), 1.0)
    }

    /// Returns the shadow bias in voxels of the lattice.
    pub(crate) fn bias(&self) -> f32 {
        self.lit.bias() as f32
    }

    /// Returns the radius of kernels, their integral in units of the divisor, and the inverse of the divisor.
    pub(crate) fn kernel(&self) -> [f32; 3] {
        [self.response.radius(), self.response.integral, self.response.divisor.recip()].map(|v| v as f32)
    }

    /// Returns the coefficients of the sections of kernels.
    pub(crate) fn table(&self) -> &[f32] {
        self.response.table.coefficients()
    }

    /// Returns the stencils of rays to a place, which are equal for equal [`Self::near_key`]s.
    pub(crate) fn near_place(&self) -> NearPlan {
        let near = NearPlace::new(&self.response, self.lit.bias());
        let mut firsts = vec![[0; 2]];
        for stencil in &near.stencils {
            let [row, weight] = firsts[firsts.len() - 1];
            let weights: usize = stencil.iter().map(|row| row.weights.len()).sum();
            firsts.push([row + stencil.len() as u32, weight + weights as u32]);
        }
        let stencil = Stencil::new(near.stencils.iter().flatten());
        NearPlan { steps: near.steps, direct: near.direct as f32, stencil, firsts }
    }

    /// Returns a text of the kernel, the divisor and the bias, on which [`Self::near_place`] depends.
    pub(crate) fn near_key(&self) -> String {
        format!("{:?} {} {}", self.lit.lattice.kernel, self.response.divisor, self.lit.bias())
    }

    fn around(&self) -> AroundPlan {
        let lattice = &self.lit.lattice;
        let filter = around::filter_of(&lattice.kernel);
        let rays = around::rays(lattice, &self.response, &filter, [self.lit.bias(), self.lit.radius()]);
        AroundPlan {
            filter: filter.iter().map(|&w| w as f32).collect(),
            rays: rays.iter().map(|ray| [ray.step[0], ray.step[1], ray.step[2], ray.weights.len() as i32]).collect(),
            shares: rays.iter().map(|ray| ray.share).collect(),
            weights: rays.into_iter().flat_map(|ray| ray.weights).collect(),
        }
    }
}

impl Stencil {
    fn new<'a>(stencil: impl Iterator<Item = &'a StencilRow>) -> Self {
        let (mut rows, mut weights) = (Vec::new(), Vec::new());
        for StencilRow { offset: [planes, row], column, weights: of_row } in stencil {
            rows.push([*planes, *row, *column, of_row.len() as i32]);
            weights.extend_from_slice(of_row);
        }
        Self { rows, weights }
    }
}

impl AroundPlan {
    /// Returns the largest number of planes between a voxel and a point of its rays.
    pub(crate) fn halo(&self) -> usize {
        self.rays.iter().fold(0, |most, ray| most.max(ray[3].max(1) - 1)) as usize
    }
}
