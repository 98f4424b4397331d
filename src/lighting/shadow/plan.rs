//! The preparations of shadows as numbers for the stages of a device (`gpu/shadows.rs`): the same responses, stencils,
//! directions and weights as on the host.

use super::response::{Response, StencilRow};
use super::sweep::{Direction, parallel_planes};
use super::{Bundle, LightRays, LitBox, ShadowLattice, around, axes_across};
use crate::lighting::Casting;

/// The plans of lights on a box of voxels.
pub(crate) struct LightPlans {
    lit: LitBox,
    response: Response,
}

/// The stages that find a light.
pub(crate) enum LightPlan {
    /// All light arrives everywhere.
    Full,
    /// Sweeps along directions, whose light is added.
    Parallel(Vec<SweepPlan>),
    /// Sums along the rays to the neighbours of voxels.
    Around(AroundPlan),
    /// The host finds this light.
    Host,
}

/// A sweep along directions that go together.
pub(crate) struct SweepPlan {
    /// The lattice axes of planes, rows and columns.
    pub(crate) axes: [usize; 3],
    /// Whether the light lies at the end of the last plane.
    pub(crate) ahead: bool,
    /// The nearest planes, which are not taken from the sweep.
    pub(crate) near: usize,
    /// The weights of neighbours.
    pub(crate) stencil: Stencil,
    /// For each plane, the nearest to the light first, the places of its first row and column among the rays of each
    /// direction: whole parts and fractions.
    pub(crate) places: Vec<Vec<[(i64, f32); 2]>>,
    /// For each direction the factor of sums of planes, the factor of all, and the light that an unshadowed voxel gets.
    pub(crate) factors: Vec<[f32; 3]>,
}

/// Weights of neighbours, row by row.
pub(crate) struct Stencil {
    /// Planes towards the light, rows, the first column, and the number of weights.
    pub(crate) rows: Vec<[i32; 4]>,
    pub(crate) weights: Vec<f32>,
}

/// Weighted sums along rays.
pub(crate) struct AroundPlan {
    /// The weights of the filter of the field, along each axis.
    pub(crate) filter: Vec<f32>,
    /// For each ray the step to its next point along x, y and z, and the number of points.
    pub(crate) rays: Vec<[i32; 4]>,
    /// For each ray the factor of its light.
    pub(crate) shares: Vec<f32>,
    /// The weights of the points, ray after ray.
    pub(crate) weights: Vec<f32>,
}

impl LightPlans {
    /// Plans for a box of voxels of a lattice: its first lattice point, and its size. `None` if all kernels on each ray
    /// are summed, which only the host does.
    pub(crate) fn new(casting: &Casting, lattice: &ShadowLattice, bounds: [[usize; 3]; 2]) -> Option<Self> {
        let mut lit = LitBox::new(casting, lattice, bounds);
        let response = lit.response.take()?;
        Some(Self { lit, response })
    }

    /// The first lattice point of the box with the voxels around it whose kernels absorb light too.
    pub(crate) fn low(&self) -> [i64; 3] {
        self.lit.low
    }

    /// The size of that box.
    pub(crate) fn dims(&self) -> [usize; 3] {
        self.lit.lattice.dims
    }

    /// The weights of the filters of sweeps across planes and within planes, the middle one first.
    pub(crate) fn filters(&self) -> [Vec<f32>; 2] {
        [&self.response.across, &self.response.within].map(|weights| weights.iter().map(|&w| w as f32).collect())
    }

    /// The factor of the shadows of a light.
    pub(crate) fn strength(&self, light: usize) -> f32 {
        self.lit.strength(light)
    }

    /// The plan of a light, of the ambient light for [`MAX_CASTING`](super::MAX_CASTING).
    pub(crate) fn light(&self, light: usize) -> LightPlan {
        match self.lit.rays(light) {
            None => LightPlan::Full,
            Some(LightRays::Parallel(bundles)) => {
                LightPlan::Parallel(bundles.iter().map(|bundle| self.sweep(bundle)).collect())
            }
            Some(LightRays::Around) => LightPlan::Around(self.around()),
            Some(LightRays::To(_)) => LightPlan::Host,
        }
    }

    fn sweep(&self, Bundle { axis, towards, directions }: &Bundle) -> SweepPlan {
        let near = self.response.near(*towards, self.lit.bias());
        let axes = axes_across(*axis);
        let [planes, rows, columns] = axes.map(|axis| self.lit.lattice.dims[axis]);
        let whole = |place: f64| (place.floor() as i64, (place - place.floor()) as f32);
        let of_direction = |direction: &Direction| parallel_planes(direction, [planes, rows, columns]);
        let maps: Vec<Vec<[f64; 2]>> = directions.iter().map(of_direction).collect();
        let places = (0..planes).map(|plane| maps.iter().map(|places| places[plane].map(whole)).collect());
        SweepPlan {
            axes,
            ahead: near.ahead,
            near: near.planes,
            stencil: Stencil::new(&near.stencil),
            places: places.collect(),
            factors: directions.iter().map(|direction| direction.factors(&self.response)).collect(),
        }
    }

    fn around(&self) -> AroundPlan {
        let lattice = &self.lit.lattice;
        let filter = around::filter_of(lattice);
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
    fn new(rows: &[StencilRow]) -> Self {
        let row = |StencilRow { offset: [planes, row], column, weights }: &StencilRow| {
            [*planes, *row, *column, weights.len() as i32]
        };
        Self {
            rows: rows.iter().map(row).collect(),
            weights: rows.iter().flat_map(|row| &row.weights).copied().collect(),
        }
    }
}

impl AroundPlan {
    /// The most planes between a voxel and a point of its rays.
    pub(crate) fn halo(&self) -> usize {
        self.rays.iter().fold(0, |most, ray| most.max(ray[3].max(1) - 1)) as usize
    }
}
