//! Rays from voxels to a light at a place: each has its own direction and end.
//!
//! Such a ray passes most kernels as a whole, and collects their footprint c p(c^2), with the half chord c and a
//! polynomial p. Footprints are summed for a bundle of rays at a time, plane by plane, until all of them are dark.
//! Kernels in which a ray begins or ends are cut: their sections are looked up voxel by voxel.

use std::ops::RangeInclusive;

use glam::{DMat3, DVec3};

use super::{CHUNK, DARK, LANES, Medium, ShadowLattice};
use crate::kernel::{FootprintTable, Real, footprint_polynomial};

/// The largest error of a section, as a fraction of the footprint's peak.
const ERROR: f64 = 1e-6;

/// The numbers of terms of the polynomial that are tried.
const TERMS: RangeInclusive<usize> = 4..=16;

/// Number of rays that are summed together.
const TOGETHER: usize = 16;

/// Rays to a place in the lattice.
pub(super) struct Converging {
    place: DVec3,
    table: FootprintTable,
    /// The coefficients of p, the lowest first.
    footprint: Vec<f64>,
    radius: f64,
    /// Voxels.
    bias: f64,
    to_world: DMat3,
    /// The factor of sections, per world unit that a voxel along the ray is long.
    scale: f64,
}

/// The ray from a voxel to the place.
struct Path {
    from: [i32; 3],
    /// Its unit direction, and its length in voxels.
    along: DVec3,
    distance: f64,
    /// The axis of its largest component, the others, and the direction of planes along it.
    main: usize,
    across: [usize; 2],
    ahead: i32,
    /// Voxels of the ray from one plane to the next.
    step: f64,
    /// The half width of the ellipse in a plane in which the ray meets kernels, at most.
    wide: f64,
    /// The planes of the kernels that the ray meets, counted from the voxel's plane.
    planes: RangeInclusive<i32>,
    /// The planes of the kernels that the ray passes as a whole.
    whole: RangeInclusive<i32>,
    /// The factor of the sum of sections.
    scale: f64,
}

impl Converging {
    pub(super) fn new(place: DVec3, lattice: &ShadowLattice, bias: f64) -> Self {
        let ShadowLattice { kernel, divisor, to_world, unit, .. } = *lattice;
        let table = FootprintTable::new(&kernel, ERROR);
        // Kernels too narrow in their support for that get the finest table.
        let table = table.unwrap_or_else(|_| FootprintTable::with_size(&kernel, 4096, 16));
        let mut footprint = Vec::new();
        for terms in TERMS {
            let error;
            (footprint, error) = footprint_polynomial(&kernel, terms);
            if error <= ERROR {
                break;
            }
        }
        Self { place, table, footprint, radius: kernel.radius(), bias, to_world, scale: 1.0 / unit / divisor }
    }

    /// Returns the ray from a voxel; `None` if nothing on it can occlude light.
    fn path(&self, dims: [usize; 3], from: [usize; 3]) -> Option<Path> {
        let path = self.place - DVec3::from_array(from.map(|p| p as f64));
        let distance = path.length();
        if distance <= self.bias {
            return None;
        }
        let along = path / distance;
        let d = along.to_array();
        let main = along.abs().max_position();
        let (ahead, room) = if d[main] > 0.0 { (1, dims[main] - 1 - from[main]) } else { (-1, from[main]) };
        let (cosine, sine) = (d[main].abs(), (1.0 - d[main] * d[main]).max(0.0).sqrt());
        let wide = self.radius / cosine;
        let last = (distance * cosine + self.radius).min(room as f64).floor() as i32;
        // The middle of a chord lies within `wide * sine` of the point where the ray meets the kernel's plane, and its
        // ends within the radius of the middle.
        let margin = wide * sine + self.radius;
        let first_whole = ((self.bias + margin) * cosine).ceil() as i32;
        let last_whole = (((distance - margin) * cosine).floor() as i32).min(last);
        Some(Path {
            from: from.map(|p| p as i32),
            along,
            distance,
            main,
            across: [(main + 1) % 3, (main + 2) % 3],
            ahead,
            step: 1.0 / cosine,
            wide,
            planes: -(self.radius as i32)..=last,
            whole: first_whole..=last_whole,
            scale: (self.to_world * along).length() * self.scale,
        })
    }

    /// Sums the sections of the kernels of some planes.
    fn cut<T: Real>(&self, medium: &Medium<T>, path: &Path, planes: RangeInclusive<i32>) -> f64 {
        let [low, high] = path.around(&planes);
        if planes.is_empty() || !medium.is_occupied(low, high) {
            return 0.0;
        }
        let [u, v] = path.across;
        let radius2 = self.radius * self.radius;
        let mut sum = 0.0;
        for plane in planes {
            let mut at = path.from;
            at[path.main] += plane * path.ahead;
            if at[path.main] < 0 || at[path.main] >= medium.dims[path.main] as i32 {
                continue;
            }
            let center = (path.along * (f64::from(plane) * path.step)).to_array();
            let range = |axis: usize| {
                let middle = f64::from(path.from[axis]) + center[axis];
                let end = (medium.dims[axis] - 1) as f64;
                (middle - path.wide).ceil().max(0.0) as i32..=(middle + path.wide).floor().min(end) as i32
            };
            for (b, a) in range(v).flat_map(|b| range(u).map(move |a| (b, a))) {
                (at[u], at[v]) = (a, b);
                let value = medium.value(at.map(|p| p as usize)).to_f64();
                let o = DVec3::from_array([0, 1, 2].map(|axis| f64::from(at[axis] - path.from[axis])));
                let t = o.dot(path.along);
                let r2 = o.length_squared() - t * t;
                let c2 = radius2 - r2;
                if value == 0.0 || c2 <= 0.0 {
                    continue;
                }
                let (c, [begin, end]) = (c2.sqrt(), [self.bias - t, path.distance - t]);
                sum += value
                    * if begin >= c || end <= -c {
                        0.0
                    } else if begin <= -c && end >= c {
                        c * self.footprint.iter().rev().fold(0.0, |sum, a| sum * c2 + a)
                    } else {
                        self.table.section(self.radius, r2, begin, end)
                    };
            }
        }
        sum
    }

    /// Returns the optical depths from voxels to the place in their order; depths above [`DARK`] are not exact.
    pub(super) fn depths<T: Real>(&self, medium: &Medium<T>, voxels: &[[usize; 3]]) -> Vec<f64> {
        let mut depths = Vec::with_capacity(voxels.len());
        for voxels in voxels.chunks(TOGETHER) {
            let mut bundle = Bundle::<T>::new(self);
            let begin = depths.len();
            for (i, &voxel) in voxels.iter().enumerate() {
                let Some(path) = self.path(medium.dims, voxel) else {
                    depths.push(0.0);
                    continue;
                };
                if path.whole.is_empty() {
                    depths.push(path.scale * self.cut(medium, &path, path.planes.clone()));
                    continue;
                }
                let (first, last) = (*path.planes.start(), *path.planes.end());
                let near = self.cut(medium, &path, first..=*path.whole.start() - 1);
                let depth = path.scale * (near + self.cut(medium, &path, *path.whole.end() + 1..=last));
                depths.push(depth);
                if depth <= DARK {
                    bundle.set(i, path, DARK - depth, medium);
                }
            }
            medium.arch.dispatch(PathSum { medium, bundle: &mut bundle });
            for ((depth, path), sum) in depths[begin..].iter_mut().zip(&bundle.paths).zip(bundle.sums) {
                *depth += path.as_ref().map_or(0.0, |path| path.scale * sum.to_f64());
            }
        }
        depths
    }
}

impl Path {
    /// Returns the ends of a box around the kernels of some planes that the ray meets.
    fn around(&self, planes: &RangeInclusive<i32>) -> [[i32; 3]; 2] {
        let ends = [*planes.start(), *planes.end()].map(|n| f64::from(n) * self.step);
        let corner = |axis: usize, at: f64| self.from[axis] + (self.along[axis] * at).floor() as i32;
        let reach = self.wide.ceil() as i32 + 1;
        [
            std::array::from_fn(|a| corner(a, ends[0]).min(corner(a, ends[1])) - reach),
            std::array::from_fn(|a| corner(a, ends[0]).max(corner(a, ends[1])) + reach),
        ]
    }
}

/// Rays that are summed together.
struct Bundle<'a, T> {
    rays: &'a Converging,
    paths: [Option<Path>; TOGETHER],
    /// For each voxel: the components of its ray across, ..
    along: [[T; TOGETHER]; 2],
    /// .. the points of the lattice across and the samples from one to the next, ..
    sizes: [[u32; TOGETHER]; 2],
    strides: [[usize; TOGETHER]; 2],
    /// .. the sample at 0 of its own plane and the samples from one plane to the next, ..
    plane: [[usize; 2]; TOGETHER],
    /// .. and the sum of sections, and the sum at which no light is left.
    sums: [T; TOGETHER],
    dark: [T; TOGETHER],
}

impl<'a, T: Real> Bundle<'a, T> {
    fn new(rays: &'a Converging) -> Self {
        Self {
            rays,
            paths: [const { None }; TOGETHER],
            along: [[T::default(); TOGETHER]; 2],
            sizes: [[0; TOGETHER]; 2],
            strides: [[0; TOGETHER]; 2],
            plane: [[0; 2]; TOGETHER],
            sums: [T::default(); TOGETHER],
            dark: [T::default(); TOGETHER],
        }
    }

    /// Adds the ray of a voxel that is dark at a depth.
    fn set(&mut self, i: usize, path: Path, dark: f64, medium: &Medium<T>) {
        let strides = [1, medium.row(1, 0), medium.row(0, 1)];
        for (k, axis) in path.across.into_iter().enumerate() {
            self.along[k][i] = T::from_f64(path.along[axis]);
            self.sizes[k][i] = medium.dims[axis] as u32;
            self.strides[k][i] = strides[axis];
        }
        self.plane[i] = [LANES + path.from[path.main] as usize * strides[path.main], strides[path.main]];
        self.dark[i] = T::from_f64(dark / path.scale);
        self.paths[i] = Some(path);
    }
}

/// The sum of the kernels that the rays of a bundle pass as a whole, as a type so that it is compiled for the widest
/// vectors of the machine.
struct PathSum<'a, 'b, T> {
    medium: &'a Medium<T>,
    bundle: &'a mut Bundle<'b, T>,
}

impl<T: Real> pulp::WithSimd for PathSum<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { medium, bundle } = self;
        let paths = bundle.paths.iter().flatten();
        let Some(first) = paths.clone().map(|path| *path.whole.start()).min() else { return };
        let last = paths.clone().map(|path| *path.whole.end()).max().unwrap_or(first);
        let wide = paths.map(|path| path.wide).fold(0.0, f64::max);
        // Largest number of lattice points that the widest ellipse covers along an axis.
        let across = (2.0 * wide).floor() as i32 + 1;
        let (zero, radius2) = (T::default(), T::from_f64(bundle.rays.radius * bundle.rays.radius));
        let mut powers = [zero; *TERMS.end()];
        let powers = &mut powers[..bundle.rays.footprint.len()];
        powers.iter_mut().zip(&bundle.rays.footprint).for_each(|(power, &a)| *power = T::from_f64(a));
        for begin in (first..=last).step_by(CHUNK as usize) {
            let chunk = begin..=(begin + CHUNK - 1).min(last);
            let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
            let mut is_lit = [false; TOGETHER];
            for (i, path) in bundle.paths.iter().enumerate() {
                let Some(path) = path else { continue };
                let within = begin.max(*path.whole.start())..=(*chunk.end()).min(*path.whole.end());
                is_lit[i] = bundle.sums[i] <= bundle.dark[i];
                if is_lit[i] && !within.is_empty() {
                    let [from, to] = path.around(&within);
                    low = std::array::from_fn(|axis| low[axis].min(from[axis]));
                    high = std::array::from_fn(|axis| high[axis].max(to[axis]));
                }
            }
            if !is_lit.contains(&true) {
                break;
            }
            if low[0] > high[0] || !medium.is_occupied(low, high) {
                continue;
            }
            for plane in chunk {
                // The first point of the ellipse, and from the ray to it, both across.
                let (mut points, mut offsets) = ([[0_i32; TOGETHER]; 2], [[zero; TOGETHER]; 2]);
                let (mut starts, mut sizes) = ([0; TOGETHER], [0; TOGETHER]);
                for (i, path) in bundle.paths.iter().enumerate() {
                    let Some(path) = path.as_ref().filter(|path| is_lit[i] && path.whole.contains(&plane)) else {
                        continue;
                    };
                    for (k, axis) in path.across.into_iter().enumerate() {
                        let middle = f64::from(path.from[axis]) + path.along[axis] * (f64::from(plane) * path.step);
                        let point = (middle - path.wide).ceil();
                        (points[k][i], offsets[k][i]) = (point as i32, T::from_f64(point - middle));
                    }
                    let [own, step] = bundle.plane[i];
                    starts[i] = own.wrapping_add_signed(plane as isize * path.ahead as isize * step as isize);
                    sizes[i] = bundle.sizes[1][i];
                }
                for down in 0..across {
                    let mut rows = [0; TOGETHER];
                    for i in 0..TOGETHER {
                        let v = (points[1][i] + down) as u32;
                        rows[i] = if v < sizes[i] { starts[i] + v as usize * bundle.strides[1][i] } else { 0 };
                    }
                    for right in 0..across {
                        let mut values = [zero; TOGETHER];
                        for i in 0..TOGETHER {
                            let u = (points[0][i] + right) as u32;
                            // The first sample lies before the first row: it is 0.
                            let within = u < bundle.sizes[0][i] && rows[i] > 0;
                            let at = if within { rows[i] + u as usize * bundle.strides[0][i] } else { 0 };
                            values[i] = medium.values[at];
                        }
                        if values.iter().all(|value| *value == zero) {
                            continue;
                        }
                        let steps = [right, down].map(|n| T::from_f64(f64::from(n)));
                        // The inner loops run over rays and have a constant length, so they become vectors.
                        let (mut squares, mut means) = ([zero; TOGETHER], [zero; TOGETHER]);
                        for i in 0..TOGETHER {
                            let [u, v] = [offsets[0][i] + steps[0], offsets[1][i] + steps[1]];
                            let t = u * bundle.along[0][i] + v * bundle.along[1][i];
                            let c2 = radius2 - (u * u + v * v - t * t);
                            squares[i] = if c2 > zero { c2 } else { zero };
                        }
                        for &power in powers.iter().rev() {
                            for i in 0..TOGETHER {
                                means[i] = means[i] * squares[i] + power;
                            }
                        }
                        for i in 0..TOGETHER {
                            bundle.sums[i] += values[i] * (squares[i].sqrt() * means[i]);
                        }
                    }
                }
            }
        }
    }
}
