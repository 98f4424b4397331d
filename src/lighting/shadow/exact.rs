//! Shadows without an approximation: the sums of sections of all kernels on each ray.

mod converging;

use std::ops::Range;

use glam::DVec3;

use self::converging::PlaceRays;
use super::{DARK, ShadowLattice, Shares, all_around};
use crate::error::Result;
use crate::kernel::{Kernel, Real, section_by};
use crate::lighting::{Casting, LightOrigin, MAX_CASTING};
use crate::vectors::dispatch;
use voxsplat_volume::memory::reserved;

/// Number of planes of the lattice that are summed between two checks for darkness.
pub(super) const CHUNK: i32 = 8;

/// The edge of the blocks that are marked as empty or occupied, in voxels.
const BLOCK: usize = 8;

/// Number of voxels of a row that are summed together, and the padding at both ends of a row.
pub(super) const LANES: usize = 32;

/// The extinction of each voxel of a lattice, x fastest, with padding at both ends of a row.
pub(crate) struct Medium<T> {
    dims: [usize; 3],
    values: Vec<T>,
    /// The number of blocks along the axes; `occupied` tells whether each block has a voxel that was set.
    blocks: [usize; 3],
    occupied: Vec<bool>,
}

impl<T: Real> Medium<T> {
    /// Makes an empty medium of `dims` voxels.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) if 4 or 8 bytes for each voxel cannot be allocated.
    pub(crate) fn new(dims: [usize; 3]) -> Result<Self> {
        let count = (dims[0] + 2 * LANES) * dims[1] * dims[2];
        let mut values = reserved(count as u64, || "the occluders of light".to_owned())?;
        values.resize(count, T::default());
        let blocks = dims.map(|n| n.div_ceil(BLOCK));
        Ok(Self { dims, values, blocks, occupied: vec![false; blocks.iter().product()] })
    }

    /// Returns the index at which a row begins, its padding included.
    fn row(&self, y: usize, z: usize) -> usize {
        (self.dims[0] + 2 * LANES) * (y + self.dims[1] * z)
    }

    pub(crate) fn set(&mut self, [x, y, z]: [usize; 3], value: T) {
        let at = self.row(y, z) + LANES + x;
        self.values[at] = value;
        let [nx, ny, _] = self.blocks;
        self.occupied[x / BLOCK + nx * (y / BLOCK + ny * (z / BLOCK))] = true;
    }

    fn value(&self, [x, y, z]: [usize; 3]) -> T {
        self.values[self.row(y, z) + LANES + x]
    }

    /// Returns whether any block between two points, both included, is occupied; the points may lie outside.
    fn is_occupied(&self, low: [i32; 3], high: [i32; 3]) -> bool {
        let range = |axis: usize| -> Range<usize> {
            let last = self.dims[axis] as i32 - 1;
            if high[axis] < 0 || low[axis] > last {
                return 0..0;
            }
            low[axis].max(0) as usize / BLOCK..high[axis].min(last) as usize / BLOCK + 1
        };
        let [nx, ny, _] = self.blocks;
        let (xs, ys, zs) = (range(0), range(1), range(2));
        zs.into_iter().any(|z| ys.clone().any(|y| self.occupied[nx * (y + ny * z)..][xs.clone()].contains(&true)))
    }

    /// Sums the optical depths of rows of `N` voxels side by side. Depths above [`DARK`] are not exact; unwanted voxels
    /// get an arbitrary depth above it.
    fn depths<const N: usize>(&self, ray: &RayTaps<T>, block: &ShadowBlock<'_>, depths: &mut Vec<[T; N]>) {
        depths.clear();
        let begin = |bits: u32, i: usize| if bits >> i & 1 != 0 { T::default() } else { T::from_f64(f64::INFINITY) };
        depths.extend(block.wanted.iter().map(|&bits| std::array::from_fn(|i| begin(bits, i))));
        dispatch(RaySum { medium: self, ray, block, depths });
    }
}

/// Rows of voxels side by side whose light is to be found.
pub(crate) struct ShadowBlock<'a> {
    /// The lattice point of the first voxel.
    pub(crate) start: [usize; 3],
    /// Number of rows along y.
    pub(crate) down: usize,
    /// A bit for each voxel whose light is wanted, in a number for each row, y before z; the lowest bit is the first
    /// voxel's.
    pub(crate) wanted: &'a [u32],
}

/// The sum along a ray, as a type so that it is compiled for the widest vectors of the machine.
struct RaySum<'a, T, const N: usize> {
    medium: &'a Medium<T>,
    ray: &'a RayTaps<T>,
    block: &'a ShadowBlock<'a>,
    depths: &'a mut [[T; N]],
}

impl<T: Real, const N: usize> pulp::WithSimd for RaySum<'_, T, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { medium, ray, block, depths } = self;
        let dark = T::from_f64(DARK);
        let start = block.start.map(|p| p as i32);
        let [nx, ny, nz] = medium.dims.map(|n| n as i32);
        let reach = [N, block.down, block.wanted.len() / block.down].map(|n| n as i32 - 1);
        let mut rows: Vec<(usize, i32, i32)> = (0..block.wanted.len())
            .filter(|&row| block.wanted[row] != 0)
            .map(|row| (row, start[1] + (row % block.down) as i32, start[2] + (row / block.down) as i32))
            .collect();
        for chunk in &ray.chunks {
            let low: [i32; 3] = std::array::from_fn(|axis| start[axis] + chunk.low[axis]);
            let high: [i32; 3] = std::array::from_fn(|axis| start[axis] + chunk.high[axis] + reach[axis]);
            // Later chunks lie farther outside: the lattice is convex.
            if rows.is_empty() || (0..3).any(|axis| high[axis] < 0 || low[axis] >= medium.dims[axis] as i32) {
                break;
            }
            if !medium.is_occupied(low, high) {
                continue;
            }
            let taps = &ray.taps[chunk.taps.clone()];
            // The rows of a block, and the part of the medium that they read, stay in the first cache.
            let mut lit = 0;
            for index in 0..rows.len() {
                let (row, y, z) = rows[index];
                let mut sums = depths[row];
                for &([dx, dy, dz], weight) in taps {
                    let (x, y, z) = (start[0] + dx, y + dy, z + dz);
                    // Outside the lattice, or outside the row by the length of the run.
                    if y < 0 || z < 0 || y >= ny || z >= nz || x <= -(N as i32) || x >= nx {
                        continue;
                    }
                    let at = medium.row(y as usize, z as usize) + (x + LANES as i32) as usize;
                    // Products are added one by one, so the sums are the same on every machine.
                    for (sum, &value) in sums.iter_mut().zip(&medium.values[at..at + N]) {
                        *sum += weight * value;
                    }
                }
                depths[row] = sums;
                if !sums.iter().all(|sum| *sum > dark) {
                    rows[lit] = rows[index];
                    lit += 1;
                }
            }
            rows.truncate(lit);
        }
    }
}

/// The offsets and weights of a direction, nearest first.
struct RayTaps<T> {
    taps: Vec<([i32; 3], T)>,
    chunks: Vec<Chunk>,
    /// The weight of the ray in the mean over the rays of a light.
    share: f64,
}

/// Consecutive offsets of a ray, and the box around them, ends included.
struct Chunk {
    taps: Range<usize>,
    low: [i32; 3],
    high: [i32; 3],
}

impl<T: Real> RayTaps<T> {
    /// Makes the ray along the unit lattice direction `along`, between two distances in voxels, in a lattice of `dims`
    /// points. Weights are sections times `scale`.
    fn new(kernel: &Kernel, dims: [usize; 3], along: DVec3, between: [f64; 2], scale: f64, share: f64) -> Self {
        let radius = kernel.radius();
        let d = along.to_array();
        // Panels of at most a quarter of the kernel's deviation: to 1e-11.
        let panels = (4.0 * radius / kernel.variance().sqrt()).ceil() as u32;
        let main = along.abs().max_position();
        let [u, v] = [(main + 1) % 3, (main + 2) % 3];
        // The ray meets kernels whose centres lie up to this far along the main axis.
        let within = |length: f64| (length * d[main].abs() + radius).min(dims[main] as f64).floor() as i32;
        let (behind, ahead) = (radius.floor() as i32, within(between[1]));
        let mut ray = Self { taps: Vec::new(), chunks: Vec::new(), share };
        // In a plane across the main axis, the ray meets kernels within an ellipse of at most this half width.
        let wide = radius / d[main].abs();
        for planes in (-behind..=ahead).step_by(CHUNK as usize) {
            let first = ray.taps.len();
            for plane in planes..=(planes + CHUNK - 1).min(ahead) {
                let m = plane * if d[main] < 0.0 { -1 } else { 1 };
                let center = along * (f64::from(m) / d[main]);
                let range = |axis: usize| {
                    let ends = [center[axis] - wide, center[axis] + wide];
                    let most = dims[axis] as f64;
                    ends[0].ceil().max(-most) as i32..=ends[1].floor().min(most) as i32
                };
                for (b, a) in range(v).flat_map(|b| range(u).map(move |a| (b, a))) {
                    let mut offset = [0; 3];
                    (offset[main], offset[u], offset[v]) = (m, a, b);
                    let o = DVec3::from_array(offset.map(f64::from));
                    let t = o.dot(along);
                    let weight = section_by(kernel, o.length_squared() - t * t, between.map(|s| s - t), panels) * scale;
                    if weight > 0.0 {
                        ray.taps.push((offset, T::from_f64(weight)));
                    }
                }
            }
            let taps = first..ray.taps.len();
            if taps.is_empty() {
                continue;
            }
            let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
            for (offset, _) in &ray.taps[taps.clone()] {
                low = std::array::from_fn(|axis| low[axis].min(offset[axis]));
                high = std::array::from_fn(|axis| high[axis].max(offset[axis]));
            }
            ray.chunks.push(Chunk { taps, low, high });
        }
        ray
    }
}

/// The rays from voxels towards the lights.
pub(crate) struct Caster<T> {
    /// The rays of each light, then of the ambient light.
    rays: [ExactRays<T>; MAX_CASTING + 1],
    strength: f64,
}

/// The rays towards a light.
enum ExactRays<T> {
    /// Rays in the same directions from every voxel; none: the full light arrives.
    Along(Vec<RayTaps<T>>),
    /// Rays to a place.
    To(PlaceRays),
}

impl<T: Real> Caster<T> {
    pub(crate) fn new(casting: &Casting, lattice: &ShadowLattice) -> Self {
        let ShadowLattice { kernel, divisor, dims, to_world, unit, voxels, .. } = lattice;
        let far = dims.iter().map(|&n| (n * n) as f64).sum::<f64>().sqrt() + kernel.radius();
        let bias = casting.bias / voxels;
        let ray = |along: DVec3, reach: f64, share: f64| {
            let between = [bias.min(reach), reach];
            RayTaps::new(kernel, *dims, along, between, (*to_world * along).length() / unit / divisor, share)
        };
        let to_lattice = to_world.inverse();
        let mut rays = [const { ExactRays::Along(Vec::new()) }; MAX_CASTING + 1];
        for (rays, origin) in rays.iter_mut().zip(&casting.lights) {
            *rays = match origin {
                LightOrigin::Directions(towards) => {
                    let share = 1.0 / towards.len().max(1) as f64;
                    let ray = |&towards: &DVec3| ray((to_lattice * towards).normalize(), far, share);
                    ExactRays::Along(towards.iter().map(ray).collect())
                }
                &LightOrigin::Point(place) => {
                    ExactRays::To(PlaceRays::new(lattice.to_lattice.transform_point3(place), lattice, bias))
                }
            };
        }
        if let Some(radius) = casting.occlusion {
            let around = all_around().map(|(along, share)| ray(along, radius / voxels, share));
            rays[MAX_CASTING] = ExactRays::Along(around.collect());
        }
        Self { rays, strength: casting.strength }
    }

    /// Returns the shares of light that reach the wanted voxels of rows.
    pub(crate) fn shares<const N: usize>(&self, medium: &Medium<T>, block: &ShadowBlock<'_>) -> Vec<Shares<N>> {
        let mut shares = vec![[[1.0; N]; MAX_CASTING + 1]; block.wanted.len()];
        let (mut depths, mut means) = (Vec::new(), Vec::new());
        // Cells of a level may absorb a little less than nothing.
        let share = |depth: f64| if depth < DARK { libm::exp(-depth.max(0.0)) } else { 0.0 };
        for (number, rays) in self.rays.iter().enumerate() {
            means.clear();
            means.resize(block.wanted.len(), [0.0; N]);
            match rays {
                ExactRays::Along(rays) if rays.is_empty() => continue,
                ExactRays::Along(rays) => {
                    for ray in rays {
                        medium.depths::<N>(ray, block, &mut depths);
                        for (mean, depth) in means.as_flattened_mut().iter_mut().zip(depths.as_flattened()) {
                            *mean += ray.share * share(depth.to_f64());
                        }
                    }
                }
                ExactRays::To(place) => {
                    let [x, y, z] = block.start;
                    let wanted = (0..block.wanted.len()).flat_map(|row| (0..N).map(move |i| (row, i)));
                    let voxel = |&(row, i): &(usize, usize)| [x + i, y + row % block.down, z + row / block.down];
                    // A block may extend beyond the lattice, where a ray has no planes to pass.
                    let is_wanted = |at: &(usize, usize)| {
                        block.wanted[at.0] >> at.1 & 1 != 0 && voxel(at).iter().zip(medium.dims).all(|(p, n)| *p < n)
                    };
                    for (row, i) in wanted.filter(is_wanted) {
                        means[row][i] = share(place.depth(medium, voxel(&(row, i))));
                    }
                }
            }
            for (shares, means) in shares.iter_mut().zip(&means) {
                shares[number] = match number {
                    // Half of the surroundings of a point on a plane lie behind the plane.
                    MAX_CASTING => means.map(|mean| (2.0 * mean).min(1.0)),
                    _ => means.map(|mean| 1.0 - self.strength * (1.0 - mean)),
                };
            }
        }
        shares
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::Normalization;
    use crate::reference::Reference;
    use crate::settings::{Model, Settings};
    use crate::transfer::{Classification, ControlPoint, TransferFunction};
    use crate::volume::{Grid, Samples, Volume};
    use glam::{DAffine3, DMat3};

    const DIMS: [usize; 3] = [19, 14, 11];

    /// Returns a number from 0 to 1 for a lattice point, without order.
    fn noise(index: usize) -> f64 {
        ((index as f64 * 12.9898).sin() * 43_758.545_3).rem_euclid(1.0)
    }

    fn towards(lights: [DVec3; MAX_CASTING]) -> Casting {
        Casting {
            lights: lights.map(|light| LightOrigin::Directions(vec![light])),
            strength: 1.0,
            bias: 0.0,
            occlusion: None,
            exact: true,
        }
    }

    fn medium<T: Real>(dims: [usize; 3], value: impl Fn([usize; 3]) -> f64) -> Medium<T> {
        let mut medium = Medium::new(dims).unwrap();
        for index in 0..dims.iter().product() {
            let at = [index % dims[0], index / dims[0] % dims[1], index / dims[0] / dims[1]];
            medium.set(at, T::from_f64(value(at)));
        }
        medium
    }

    fn lattice(kernel: Kernel, dims: [usize; 3], to_world: DMat3, unit: f64) -> ShadowLattice {
        ShadowLattice {
            kernel,
            divisor: Normalization::Unit.divisor(&kernel),
            dims,
            first: [0; 3],
            to_lattice: DAffine3::from_mat3(to_world.inverse()),
            to_world,
            unit,
            voxels: 1.0,
        }
    }

    fn row<T: Real, const N: usize>(caster: &Caster<T>, medium: &Medium<T>, start: [usize; 3]) -> Shares<N> {
        caster.shares(medium, &ShadowBlock { start, down: 1, wanted: &[u32::MAX] })[0]
    }

    #[test]
    fn depths_are_the_integrals_of_the_reference() {
        // A skewed lattice of unequal spacings, turned against the world.
        let turned = DMat3::from_euler(glam::EulerRot::ZYX, 0.4, -0.3, 0.7);
        let to_world = turned * DMat3::from_cols(DVec3::X, DVec3::new(0.1, 1.4, 0.0), DVec3::new(0.0, -0.2, 2.5));
        let grid = Grid::new(DIMS.map(|n| n as u32), DAffine3::from_mat3_translation(to_world, DVec3::ONE)).unwrap();
        let lights = [turned * DVec3::X, DVec3::new(0.3, -2.0, 0.9), DVec3::new(-1.0, -0.8, 1.1)].map(DVec3::normalize);
        // One in three absorbs, from nearly nothing to a lot.
        let tau = |i: usize| if i.is_multiple_of(3) { (8.0 * noise(i) - 7.0).exp() } else { 0.0 };
        let unit = 1.7;
        let samples: Vec<f64> = (0..DIMS.iter().product()).map(|i| -(-tau(i)).exp_m1()).collect();
        let volume = Volume::new(grid, Samples::F64(samples)).unwrap();
        let point = |value| ControlPoint { value, color: [1.0; 3], opacity: value };
        let transfer = TransferFunction::new(vec![point(0.0), point(1.0)], Some(unit)).unwrap();
        let transfer = transfer.with_classification(Classification::Point);
        for kernel in [Kernel::default(), Kernel::KAISER_BESSEL, Kernel::Gaussian { sigma: 0.8, radius: 3.0 }] {
            let settings = Settings { model: Model::Xray, kernel, antialiasing: false, ..Settings::default() };
            let reference = Reference::new(&volume, &transfer, &settings).unwrap();
            let lattice = ShadowLattice { to_lattice: grid.to_lattice(), ..lattice(kernel, DIMS, to_world, unit) };
            let at = |[x, y, z]: [usize; 3]| x + DIMS[0] * (y + DIMS[1] * z);
            let media = (medium::<f64>(DIMS, |p| tau(at(p))), medium::<f32>(DIMS, |p| tau(at(p))));
            // Beside the lattice, and in it.
            for (light, bias) in [([-3.0, 16.0, 4.5], 0.0), ([8.2, 6.0, 4.1], 0.5)] {
                let light = grid.to_world().transform_point3(DVec3::from_array(light));
                let mut casting = Casting { bias, ..towards(lights) };
                casting.lights[0] = LightOrigin::Point(light);
                let exact = row::<_, 19>(&Caster::new(&casting, &lattice), &media.0, [0, 6, 4]);
                let rounded = row::<_, 19>(&Caster::new(&casting, &lattice), &media.1, [0, 6, 4]);
                for (x, share) in [exact, rounded].iter().flat_map(|shares| shares[0].iter().enumerate()) {
                    let place = grid.to_world().transform_point3(DVec3::new(x as f64, 6.0, 4.0));
                    let way = (light - place).normalize();
                    let begin = bias / (grid.to_lattice().matrix3 * way).length();
                    let beyond = |distance: f64| reference.ray(place + distance * way, way, false).optical_depth;
                    let depth = beyond(begin) - beyond(place.distance(light).max(begin));
                    assert!((-share.ln() - depth).abs() <= 1e-4 * depth + 1e-6, "{share} for {depth}");
                }
            }
            for ([y, z], bias) in [([0, 0], 0.0), ([6, 5], 0.0), ([13, 10], 2.25), ([3, 8], 0.6)] {
                let casting = Casting { bias, ..towards(lights) };
                let exact = row::<_, 19>(&Caster::new(&casting, &lattice), &media.0, [0, y, z]);
                let rounded = row::<_, 19>(&Caster::new(&casting, &lattice), &media.1, [0, y, z]);
                for (number, light) in lights.into_iter().enumerate() {
                    for x in 0..DIMS[0] {
                        let place = grid.to_world().transform_point3(DVec3::new(x as f64, y as f64, z as f64));
                        let begin = bias / (grid.to_lattice().matrix3 * light).length();
                        let depth = reference.ray(place + begin * light, light, false).optical_depth;
                        if depth > DARK {
                            continue;
                        }
                        let [got, single] = [exact[number][x], rounded[number][x]].map(|share| -share.ln());
                        assert!((got - depth).abs() < 1e-8 * (1.0 + depth), "{kernel:?} {number}: {got} for {depth}");
                        assert!((single - depth).abs() <= 1e-4 * depth + 1e-6, "{number}: {single} for {depth}");
                    }
                }
            }
        }
    }

    #[test]
    fn units_of_length_do_not_matter() {
        let dims = [12, 6, 6];
        let casting = towards([DVec3::X, DVec3::new(-0.3, 0.8, 0.5), DVec3::new(0.2, -1.0, 0.1)]);
        let shares = |scale: f64| -> Shares<12> {
            let spacings = [1.0, 1.5, 4.0].map(|spacing| spacing * scale);
            let grid = Grid::axis_parallel(dims.map(|n| n as u32), spacings).unwrap();
            let lattice = ShadowLattice::new(&grid, Kernel::default(), 11.0, 2.0 * scale, 1.0);
            row(
                &Caster::<f32>::new(&casting, &lattice),
                &medium(dims, |[x, y, z]| noise(x + 12 * (y + 6 * z))),
                [0, 3, 3],
            )
        };
        let metres = shares(1.0);
        assert!(metres[0][0] < 0.9);
        for power in [-280, 280] {
            assert_eq!(shares(f64::from(power).exp2()), metres);
        }
    }

    #[test]
    fn light_along_an_axis_is_a_running_sum() {
        let dims = [24, 9, 9];
        let tau = |x: usize| 0.01 + 0.2 * noise(x);
        let kernel = Kernel::KAISER_BESSEL;
        let caster =
            Caster::<f64>::new(&towards([DVec3::X, -DVec3::X, DVec3::Y]), &lattice(kernel, dims, DMat3::IDENTITY, 1.0));
        let shares = row::<_, 24>(&caster, &medium(dims, |[x, ..]| tau(x)), [0, 4, 4]);
        // Seen along x, the kernels of a plane add up to nearly 1 for each voxel: the blob ripples by 0.054 %.
        let half_kernel: Vec<f64> = (-2..=2)
            .map(|n| {
                let planes = |y: i32, z: i32| section_by(&kernel, f64::from(y * y + z * z), [f64::from(-n), 99.0], 8);
                let sum: f64 = (-2..=2).flat_map(|y| (-2..=2).map(move |z| planes(y, z))).sum();
                sum / kernel.integral()
            })
            .collect();
        for (x, share) in shares[0].iter().enumerate().take(20).skip(4) {
            let nearby: f64 = (0..5).map(|n| half_kernel[n] * tau(x + n - 2)).sum();
            let expected = nearby + (x + 3..24).map(tau).sum::<f64>();
            let got = -share.ln();
            assert!((got - expected).abs() < 2e-3 * expected, "{x}: {got} for {expected}");
        }
        // From both sides together: all of the row.
        let both = |x: usize| -(shares[0][x] * shares[1][x]).ln();
        assert!((4..20).all(|x| (both(x) - both(4)).abs() < 1e-9));
    }

    #[test]
    fn nothing_that_absorbs_is_no_shadow() {
        let lattice = lattice(Kernel::default(), [40, 8, 8], DMat3::IDENTITY, 1.0);
        let casting = Casting { occlusion: Some(6.0), ..towards([DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 1.0)]) };
        let caster = Caster::<f32>::new(&casting, &lattice);
        // A wall at the end of the rows.
        let medium = medium(lattice.dims, |[x, ..]| if x == 39 { 3.0 } else { 0.0 });
        let shares = row::<_, 32>(&caster, &medium, [0, 4, 4]);
        assert!(shares[0].iter().all(|&share| share < 0.1), "behind the wall {:?}", shares[0]);
        assert!(shares[1].iter().all(|&share| share == 1.0), "beside it {:?}", shares[1]);
        assert!(shares[3][..30].iter().all(|&share| share > 0.999), "far from it {:?}", shares[3]);
        // Half of the directions are free at its surface, and none within.
        let within = row::<_, 1>(&caster, &medium, [39, 4, 4])[3][0];
        assert!((0.1..0.7).contains(&within), "{within}");
    }

    #[test]
    fn all_around_is_exact_to_degree_seven() {
        let mean = |f: &dyn Fn(DVec3) -> f64| all_around().map(|(d, share)| share * f(d)).sum::<f64>();
        assert_eq!(all_around().count(), 26);
        for (f, exact) in [
            (&(|_| 1.0) as &dyn Fn(DVec3) -> f64, 1.0),
            (&|d| d.x * d.x, 1.0 / 3.0),
            (&|d| d.x.powi(4), 1.0 / 5.0),
            (&|d| d.x.powi(2) * d.y.powi(2), 1.0 / 15.0),
            (&|d| d.x.powi(6), 1.0 / 7.0),
            (&|d| (d.x * d.y * d.z).powi(2), 1.0 / 105.0),
            (&|d| d.x.powi(3) * d.y, 0.0),
        ] {
            assert!((mean(f) - exact).abs() < 1e-14);
        }
    }
}
