//! Shadows: the share of each light that reaches the centre of a voxel.
//!
//! The extinction that light passes is the field that pre-shading splats, a sum of kernels. So its integral from the
//! centre of voxel j along the unit lattice direction d, as far as `reach`, is a sum of sections of kernels:
//!
//! ```text
//! D_j = l / N sum_k tau_k S(k - j)        S(o) = integral from b to reach of h(|o - s d|) ds
//! ```
//!
//! with h the kernel, N its divisor, l the world length of d and b the bias. S depends on the offset of two lattice
//! points alone. It is 0 farther than a kernel's radius from the ray, and without bias a voxel's own kernel counts by
//! half. So D_j needs no sheets, no steps and no view.
//!
//! There are two ways to find it. [`exact`] adds up the sections of all kernels on each ray: thousands of multiply-adds
//! for each voxel. [`sweep`] adds up sections near the voxel, and beyond them the planes of the volume, resampled once
//! for all voxels. [`around`] finds ambient occlusion by sums along lattice directions.
//!
//! Splatters before shade one image of the light after another and look the voxel up there: Nulkar and Mueller 2001,
//! "Splatting with shadows" (a volume of light, by sheets); Zhang and Crawfis 2003, "Shadows and soft shadows with
//! participating media using splatting" (sheets half way between eye and light, anew in each view); Kniss et al. 2003,
//! "A model for volume lighting and modeling", likewise for slices. Ray casters send a second ray from each sample.

mod around;
pub(crate) mod exact;
pub(crate) mod field;
pub(crate) mod incoming;
mod lanes;
pub(crate) mod passing;
pub(crate) mod plan;
mod response;
mod sweep;

use std::sync::Arc;
use std::sync::atomic::{AtomicU16, AtomicUsize, Ordering};

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;

use self::exact::{Caster, Medium, ShadowBlock};
use self::field::{ExtinctionBox, RowPlanes, Spare, turned_back};
use self::incoming::{Entering, Incoming};
use self::response::SweepResponse;
use self::sweep::{Converging, Direction, NearPlace, Swept};
use super::{Casting, LightOrigin, MAX_CASTING};
use crate::error::Result;
use crate::kernel::Kernel;
use crate::volume::Grid;

/// Optical depths beyond this count as dark: they transmit 1e-7 of the light.
const DARK: f64 = 16.0;
/// The distance in lattice points, before an isosurface, of the place whose light it gets. The surface casts shadows as
/// voxels up to a point to either side of it, and does not lie in its own shadow.
pub(crate) const SURFACE_BIAS: f32 = 3.0;

/// A callback that gets a field as planes across an axis, and the axes of its planes, rows and columns.
type TakesPlanes<'a> = dyn FnMut(&Swept<'_>, [usize; 3]) -> Result<()> + 'a;

/// A callback that sweeps across an axis: it gets the swept field, the axes of its planes, rows and columns, and the
/// light to be set.
type Sweeps<'a> = dyn FnMut(&Swept<'_>, [usize; 3], &[AtomicU16]) -> Result<()> + 'a;

/// The cosine of the angle to the middle of a light within which its directions share the sums of neighbours: 8
/// degrees, at which a neighbour 4 voxels away moves by half a voxel.
const NARROW: f64 = 0.99;

/// The distance in voxels beyond which the rays of a light at a place are parallel: over the largest lattice they turn
/// by less than a thousandth of a voxel.
const DISTANT: f64 = 1e9;

/// The shares of light that reach voxels, 0 to 1: of each light that casts shadows, then of the ambient light.
pub(crate) type Shares<const N: usize> = [[f64; N]; MAX_CASTING + 1];

/// A lattice of kernels with a length.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ShadowLattice {
    pub(crate) kernel: Kernel,
    /// The divisor of sums of kernels.
    pub(crate) divisor: f64,
    pub(crate) dims: [usize; 3],
    /// The point of the lattice at the first voxel of a scene, which may be of a part of the lattice.
    pub(crate) first: [u32; 3],
    /// The map from the world of lights to the lattice.
    pub(crate) to_lattice: DAffine3,
    /// The map from the lattice to the world, which may be measured in any unit.
    pub(crate) to_world: DMat3,
    /// The length of the unit of extinctions, in that world.
    pub(crate) unit: f64,
    /// The number of voxels per step of the lattice along its axes.
    pub(crate) voxels: f64,
}

impl ShadowLattice {
    /// Makes the lattice of a grid, with extinctions per `unit` of the world.
    pub(crate) fn new(grid: &Grid, kernel: Kernel, divisor: f64, unit: f64, voxels: f64) -> Self {
        // In a world measured in the grid's own unit, so that no unit of a file leaves the range of numbers.
        Self {
            kernel,
            divisor,
            dims: grid.dims().map(|n| n as usize),
            first: [0; 3],
            to_lattice: grid.to_lattice(),
            to_world: grid.local().to_world().matrix3,
            unit: unit / grid.unit(),
            voxels,
        }
    }
}

/// Returns the distance in voxels of the farthest voxels on which the occlusion of a voxel depends.
pub(crate) fn occlusion_reach(kernel: &Kernel, radius: f64) -> u32 {
    (radius + kernel.radius()).ceil() as u32 + around::filter_of(kernel).len() as u32
}

/// A box of voxels that are lit, with the voxels around it whose kernels absorb light too.
struct LitBox {
    casting: Casting,
    /// The first lattice point of the box, the voxels around it included; counted from the first voxel of the scene.
    in_scene: [i64; 3],
    /// The same, counted from the first point of the lattice.
    low: [i64; 3],
    /// The lattice of the box.
    lattice: ShadowLattice,
    /// The response of sweeps; `None`: light is found by exact sums.
    response: Option<Arc<SweepResponse>>,
    /// The number of voxels around the lit ones, on each side.
    margin: usize,
}

/// The rays of a light.
enum LightRays {
    /// Rays all around each voxel.
    Around,
    Parallel(Vec<Bundle>),
    /// Rays to a place in the world.
    To(DVec3),
}

/// Directions that are swept together, across one axis.
struct Bundle {
    axis: usize,
    /// The direction of the neighbours of voxels: planes, rows and columns.
    towards: DVec3,
    directions: Vec<Direction>,
}

/// Returns the lattice axes of the planes, rows and columns of sweeps across an axis.
fn axes_across(axis: usize) -> [usize; 3] {
    [[0, 2, 1], [1, 2, 0], [2, 1, 0]][axis]
}

/// Returns whether rays to a place that run as much along rows, or columns, as across an axis are left to another axis:
/// rays along a diagonal belong to the first of its axes.
fn strict_across(axis: usize) -> [bool; 2] {
    let [_, rows, columns] = axes_across(axis);
    [rows < axis, columns < axis]
}

impl LitBox {
    /// Makes a box of `size` voxels from `low` on.
    fn new(
        casting: &Casting,
        lattice: &ShadowLattice,
        [low, size]: [[usize; 3]; 2],
        response: Option<Arc<SweepResponse>>,
    ) -> Self {
        let response = response.filter(|_| !casting.exact);
        // Kernels absorb light around the box too.
        let margin = response.as_ref().map_or(0, |response| response.margin());
        let in_scene = low.map(|n| n as i64 - margin as i64);
        let low = [0, 1, 2].map(|axis| in_scene[axis] + i64::from(lattice.first[axis]));
        let shift = DAffine3::from_translation(-DVec3::from_array(low.map(|n| n as f64)));
        let dims = size.map(|n| n + 2 * margin);
        let lattice = ShadowLattice { dims, to_lattice: shift * lattice.to_lattice, ..lattice.clone() };
        Self { casting: casting.clone(), in_scene, low, lattice, response, margin }
    }

    /// Returns the bias in voxels of the lattice.
    fn bias(&self) -> f64 {
        self.casting.bias / self.lattice.voxels
    }

    /// Returns the radius of occlusion in voxels of the lattice.
    fn radius(&self) -> f64 {
        self.casting.occlusion.unwrap_or(0.0) / self.lattice.voxels
    }

    /// Returns the factor of the shadows of a light.
    fn strength(&self, light: usize) -> f32 {
        if light < MAX_CASTING { self.casting.strength as f32 } else { 1.0 }
    }

    /// Returns the rays of a light, or for [`MAX_CASTING`] of the ambient light; `None`: all of the light arrives
    /// everywhere.
    fn rays(&self, light: usize) -> Option<LightRays> {
        if !self.casting.casts(light) {
            return None;
        }
        Some(match self.casting.lights.get(light) {
            None => LightRays::Around,
            Some(LightOrigin::Directions(towards)) => LightRays::Parallel(self.bundles(towards)),
            Some(&LightOrigin::Point(place)) => {
                let middle = DVec3::from_array(self.lattice.dims.map(|n| (n - 1) as f64 / 2.0));
                let towards = self.lattice.to_lattice.transform_point3(place) - middle;
                if towards.length() > DISTANT {
                    LightRays::Parallel(self.bundles(&[self.lattice.to_world * towards]))
                } else {
                    LightRays::To(place)
                }
            }
        })
    }

    /// Groups world directions into bundles, by axis.
    fn bundles(&self, towards: &[DVec3]) -> Vec<Bundle> {
        let to_lattice = self.lattice.to_world.inverse();
        let count = towards.len();
        // Whole numbers whose sum is all of the light.
        let part = |i: usize| ((i + 1) * 65_535 / count - i * 65_535 / count) as u16;
        let directions: Vec<(DVec3, usize)> = towards.iter().map(|&d| (to_lattice * d).normalize()).zip(0..).collect();
        let middle = directions.iter().map(|(along, _)| *along).sum::<DVec3>().normalize_or_zero();
        // The directions of a narrow light go together, whatever their own main axes.
        let is_narrow = count > 1 && directions.iter().all(|(along, _)| along.dot(middle) > NARROW);
        let main = |along: DVec3| if is_narrow { middle } else { along }.abs().max_position();
        let mut bundles = Vec::new();
        for axis in 0..3 {
            let seen = |along: DVec3| DVec3::from_array(axes_across(axis).map(|axis| along[axis]));
            let mine = directions.iter().filter(|(along, _)| main(*along) == axis).map(|&(along, number)| {
                let scale = (self.lattice.to_world * along).length() / self.lattice.unit;
                Direction { along: seen(along), scale, share: part(number), number }
            });
            let mine: Vec<_> = mine.collect();
            // Those that do not go together have their own neighbours.
            bundles.extend(mine.chunks(if is_narrow { count } else { 1 }).map(|together| {
                let towards = if is_narrow { seen(middle) } else { together[0].along };
                Bundle { axis, towards, directions: together.to_vec() }
            }));
        }
        bundles
    }
}

/// What the light of a picture leaves for the next one: memory, and the response of sweeps.
#[derive(Default)]
pub(crate) struct Reusable {
    /// The kernel and the divisor of the response.
    of: Option<(Kernel, f64)>,
    response: Option<Arc<SweepResponse>>,
    spare: Arc<Spare>,
}

impl Reusable {
    /// Frees the memory.
    pub(crate) fn free(&mut self) {
        self.spare = Arc::default();
    }

    /// Returns the response for a lattice.
    fn response(&mut self, lattice: &ShadowLattice) -> Option<Arc<SweepResponse>> {
        let of = Some((lattice.kernel, lattice.divisor));
        if self.of != of {
            self.response = SweepResponse::new(&lattice.kernel, lattice.divisor).map(Arc::new);
            self.of = of;
        }
        self.response.clone()
    }
}

/// The light that arrives at the voxels of a box.
pub(crate) struct Arrival {
    lit: LitBox,
    field: ExtinctionBox,
    /// The light that enters the box, if it belongs to a part of a lattice.
    incoming: Option<Incoming>,
}

/// The share of a light that arrives at each voxel of the box of an [`Arrival`].
pub(crate) struct Arriving<'a> {
    arrival: &'a Arrival,
    shares: field::Shares,
    strength: f32,
}

impl Arriving<'_> {
    /// Returns the shares at the voxels of a row from a lattice point on, 65535 for all of the light.
    pub(crate) fn from(&self, point: [usize; 3]) -> impl Fn(usize) -> u16 {
        let shares = &self.shares.values[self.arrival.index(point)..];
        move |place| {
            let share = f32::from(shares[place].load(Ordering::Relaxed));
            sweep::nearest(65_535.0 - self.strength * (65_535.0 - share))
        }
    }
}

impl Arrival {
    /// Makes the field of the occluders in a box of voxels, given by its first lattice point and its size. `fill` gets
    /// the y and z of a row, and writes its extinctions, 0 for voxels that are not lit and [`CLIPPED`](field::CLIPPED)
    /// for voxels that cast no shadow. `reusable` is left by earlier light.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) if 4 bytes for each voxel cannot be allocated.
    pub(crate) fn new(
        casting: &Casting,
        lattice: &ShadowLattice,
        bounds: [[usize; 3]; 2],
        reusable: &mut Reusable,
        fill: impl Fn([usize; 2], &mut [f32]) + Sync,
    ) -> Result<Self> {
        let lit = LitBox::new(casting, lattice, bounds, reusable.response(lattice));
        let (dims, low, margin) = (lit.lattice.dims, lit.in_scene, lit.margin);
        // No row of rays or of neighbours is read beyond its zeros.
        let beside = |response: &SweepResponse| response.pad(lit.bias()).max(response.pad(lit.radius()).min(dims[0]));
        let pad = field::LANES + lit.response.as_deref().map_or(0, beside);
        let mut field = ExtinctionBox::new(&reusable.spare, dims, pad)?;
        field.fill(margin, |[y, z], row| {
            fill([y as i64 + low[1], z as i64 + low[2]].map(|n| n as usize), row);
        });
        Ok(Self { lit, field, incoming: None })
    }

    /// Sets the light that enters the box, if it belongs to a part of a lattice.
    pub(crate) fn entered_by(self, incoming: Option<Incoming>) -> Self {
        Self { incoming, ..self }
    }

    /// Returns the number of a lattice point of the box.
    fn index(&self, point: [usize; 3]) -> usize {
        let [x, y, z] = [0, 1, 2].map(|axis| (point[axis] as i64 - self.lit.in_scene[axis]) as usize);
        x + self.lit.lattice.dims[0] * (y + self.lit.lattice.dims[1] * z)
    }

    /// Returns the share of a light that arrives at each voxel of the box; of the ambient light for [`MAX_CASTING`].
    /// `None`: all of it, everywhere. `report` gets the part that is done.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) if 12 bytes for each voxel cannot be allocated.
    pub(crate) fn shares(&self, light: usize, report: &(dyn Fn(f64) + Sync)) -> Result<Option<Arriving<'_>>> {
        let LitBox { lattice, response, .. } = &self.lit;
        let Some(rays) = self.lit.rays(light) else { return Ok(None) };
        let arriving = |shares, strength| Some(Arriving { arrival: self, shares, strength });
        let Some(response) = response else { return Ok(arriving(self.exact(light, report)?, 1.0)) };
        let bias = self.lit.bias();
        let shares = match rays {
            LightRays::Around => around::arriving(&self.field, lattice, response, [bias, self.lit.radius()])?,
            LightRays::Parallel(bundles) => self.along(response, (light, &bundles), bias, report)?,
            LightRays::To(place) => self.towards_place(response, place, bias, report)?,
        };
        Ok(arriving(shares, self.lit.strength(light)))
    }

    /// Prepares the planes across an axis and calls `take` with them and the axes of planes, rows and columns.
    fn planes(&self, axis: usize, response: &SweepResponse, take: &mut TakesPlanes<'_>) -> Result<()> {
        let [nx, ny, nz] = self.lit.lattice.dims;
        let axes = axes_across(axis);
        let planes = match axis {
            0 => RowPlanes::across(2, [ny, nz, nx]),
            _ => RowPlanes::across(axis, [nx, ny, nz]),
        };
        // Across x, its rows lie along y.
        let turned = (axis == 0).then(|| self.field.turned()).transpose()?;
        let field = turned.as_ref().unwrap_or(&self.field);
        let first = axes.map(|axis| self.lit.low[axis]);
        take(&Swept { field, planes, first, filtered: &sweep::filtered(field, planes, response)?, response }, axes)
    }

    /// Prepares the planes across an axis and calls `sweeps` with them.
    fn across(&self, axis: usize, response: &SweepResponse, out: &[AtomicU16], sweeps: &mut Sweeps<'_>) -> Result<()> {
        if axis != 0 {
            return self.planes(axis, response, &mut |swept, axes| sweeps(swept, axes, out));
        }
        let light = self.field.dark()?;
        self.planes(axis, response, &mut |swept, axes| sweeps(swept, axes, &light.values))?;
        turned_back(&light.values, self.lit.lattice.dims, out);
        Ok(())
    }

    /// Returns the mean light of bundles.
    fn along(
        &self,
        response: &SweepResponse,
        (light, bundles): (usize, &[Bundle]),
        bias: f64,
        report: &(dyn Fn(f64) + Sync),
    ) -> Result<field::Shares> {
        let shares = self.field.dark()?;
        let mut done = 0;
        for axis in 0..3 {
            let mine = || bundles.iter().filter(|bundle| bundle.axis == axis);
            if mine().next().is_none() {
                continue;
            }
            self.across(axis, response, &shares.values, &mut |swept, axes, out| {
                let entering = self.incoming.as_ref().map(|incoming| Entering { incoming, light, axes });
                for Bundle { towards, directions, .. } in mine() {
                    swept.add_parallel(&response.near(*towards, bias), directions, entering.as_ref(), out);
                    done += 1;
                    report(f64::from(done) / bundles.len() as f64);
                }
                Ok(())
            })?;
        }
        Ok(shares)
    }

    /// Returns the light from a place in the world.
    fn towards_place(
        &self,
        response: &SweepResponse,
        place: DVec3,
        bias: f64,
        report: &(dyn Fn(f64) + Sync),
    ) -> Result<field::Shares> {
        let place = self.lit.lattice.to_lattice.transform_point3(place);
        let near = NearPlace::new(response, bias);
        let shares = self.field.dark()?;
        for axis in 0..3 {
            self.across(axis, response, &shares.values, &mut |swept, axes, out| {
                let rays = Converging {
                    place: DVec3::from_array(axes.map(|axis| place[axis])),
                    to_world: DMat3::from_cols_array_2d(
                        &axes.map(|axis| (self.lit.lattice.to_world.col(axis) / self.lit.lattice.unit).to_array()),
                    ),
                    strict: strict_across(axis),
                    near: &near,
                };
                swept.set_converging(&rays, true, out);
                swept.set_converging(&rays, false, out);
                Ok(())
            })?;
            report(f64::from(axis as u32 + 1) / 3.0);
        }
        // All light arrives at a voxel at the place itself.
        let [nx, ny, _] = self.lit.lattice.dims;
        if place.round() == place && (0..3).all(|a| (0.0..self.lit.lattice.dims[a] as f64).contains(&place[a])) {
            let [x, y, z] = place.to_array().map(|p| p as usize);
            shares.values[x + nx * (y + ny * z)].store(u16::MAX, Ordering::Relaxed);
        }
        Ok(shares)
    }

    /// Returns the share of a light that arrives, by exact sums.
    fn exact(&self, light: usize, report: &(dyn Fn(f64) + Sync)) -> Result<field::Shares> {
        /// Numbers of voxels along the edges of blocks.
        const BLOCK: [usize; 3] = [32, 32, 4];
        let [nx, ny, nz] = self.lit.lattice.dims;
        let caster = Caster::<f32>::new(&self.lit.casting.only(light), &self.lit.lattice);
        let mut medium = Medium::new(self.lit.lattice.dims)?;
        for (y, z) in (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z))) {
            let filled = self.field.filled(y + ny * z);
            let values = self.field.from(y + ny * z, 0);
            let casts = filled.filter(|&x| values[x] > field::CLIPPED);
            casts.for_each(|x| medium.set([x, y, z], values[x]));
        }
        let mut shares = self.field.dark()?;
        let slabs = nz.div_ceil(BLOCK[2]);
        let done = AtomicUsize::new(0);
        shares.values.par_chunks_mut(nx * ny * BLOCK[2]).enumerate().for_each(|(slab, out)| {
            let z = slab * BLOCK[2];
            let planes = out.len() / (nx * ny);
            for (x, y) in (0..ny).step_by(BLOCK[1]).flat_map(|y| (0..nx).step_by(BLOCK[0]).map(move |x| (x, y))) {
                let down = BLOCK[1].min(ny - y);
                let wanted: Vec<u32> = (0..planes * down)
                    .map(|row| {
                        let values = self.field.from(y + row % down + ny * (z + row / down), x as isize);
                        (0..BLOCK[0].min(nx - x)).fold(0, |bits, i| bits | u32::from(values[i] > 0.0) << i)
                    })
                    .collect();
                if wanted.iter().all(|&bits| bits == 0) {
                    continue;
                }
                let block = ShadowBlock { start: [x, y, z], down, wanted: &wanted };
                for (row, found) in caster.shares::<{ BLOCK[0] }>(&medium, &block).iter().enumerate() {
                    let out = &mut out[nx * (y + row % down + ny * (row / down)) + x..][..BLOCK[0].min(nx - x)];
                    for (out, share) in out.iter_mut().zip(found[light]) {
                        *out.get_mut() = sweep::nearest(65_535.0 * share.clamp(0.0, 1.0) as f32);
                    }
                }
            }
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            report(done as f64 / slabs as f64);
        });
        Ok(shares)
    }
}

/// Returns the 26 directions to the neighbours of a lattice point with the weights of Lebedev's rule of degree 7
/// (Lebedev 1975, "Values of the nodes and weights of ninth to seventeenth order Gauss-Markov quadrature formulae
/// invariant under the octahedron group with inversion"): 6 along axes, 12 along edges, 8 along diagonals.
fn all_around() -> impl Iterator<Item = (DVec3, f64)> {
    let weights = [1.0 / 21.0, 4.0 / 105.0, 9.0 / 280.0];
    let steps = || (-1..=1).map(f64::from);
    let directions = steps().flat_map(move |x| steps().flat_map(move |y| steps().map(move |z| DVec3::new(x, y, z))));
    directions.filter(|d| *d != DVec3::ZERO).map(move |d| (d.normalize(), weights[d.length_squared() as usize - 1]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lighting::{Light, Lighting};

    /// Places whose coordinates have the same fraction put the rays of whole slopes next to whole places of the buffer,
    /// on either side by rounding.
    #[test]
    fn light_from_places_of_any_fraction_arrives_at_the_right_voxels() {
        let dims = [14, 13, 12];
        let grid = Grid::axis_parallel(dims.map(|n| n as u32), [1.0; 3]).unwrap();
        let kernel = Kernel::default();
        let lattice = ShadowLattice::new(&grid, kernel, kernel.integral(), 1.0, 1.0);
        let tau = |x: usize, y: usize, z: usize| ((x * 7 + y * 13 + z * 29) % 11) as f32 * 0.02;
        for tenths in 0..10 {
            for whole in [[5.0, 6.0, 5.0], [-4.0, 30.0, 2.0], [13.0, 0.0, 25.0]] {
                let place = DVec3::from_array(whole) + f64::from(tenths) / 10.0;
                let lights = vec![Light::at(grid.to_world().transform_point3(place))];
                let shares = |exact_shadows: bool| {
                    let lighting =
                        Lighting { lights: lights.clone(), shadows: 1.0, exact_shadows, ..Lighting::default() };
                    let casting = lighting.casting().unwrap();
                    let kept = &mut Reusable::default();
                    let arrival = Arrival::new(&casting, &lattice, [[0; 3], dims], kept, |[y, z], row| {
                        row.iter_mut().enumerate().for_each(|(x, value)| *value = tau(x, y, z).max(field::CLIPPED));
                    });
                    let arrival = arrival.unwrap();
                    let shares = arrival.shares(0, &|_| ()).unwrap().unwrap();
                    let points = (0..dims.iter().product()).map(|i| [i % 14, i / 14 % 13, i / 14 / 13]);
                    points.map(|point| f64::from(shares.from(point)(0)) / 257.0).collect::<Vec<_>>()
                };
                let (swept, exact) = (shares(false), shares(true));
                let largest = swept.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(largest < 6.0, "{place}: {largest} of 255");
            }
        }
    }
}
