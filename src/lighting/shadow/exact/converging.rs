//! Rays from voxels to a light at a place: each has its own direction and end.
//!
//! The sections of the kernels that a ray meets are looked up in a table of footprints.

use std::ops::RangeInclusive;

use glam::{DMat3, DVec3};

use super::{CHUNK, DARK, Medium, ShadowLattice};
use crate::kernel::{FootprintTable, Real};

/// The largest error of a section, as a fraction of the footprint's peak.
const ERROR: f64 = 1e-6;

/// Rays to a place in the lattice.
pub(super) struct PlaceRays {
    place: DVec3,
    table: FootprintTable,
    radius: f64,
    /// The shadow bias, voxels.
    bias: f64,
    to_world: DMat3,
    /// The factor of sections, per world unit that a voxel along the ray is long.
    scale: f64,
}

/// The ray from a voxel to the place.
struct VoxelRay {
    from: [i32; 3],
    /// The unit direction of the ray; `distance` is its length in voxels.
    along: DVec3,
    distance: f64,
    /// The axis of the direction's largest component; `across` are the other axes, `ahead` is the sense of planes, 1 or
    /// -1.
    main: usize,
    across: [usize; 2],
    ahead: i32,
    /// The length in voxels of the ray from one plane to the next.
    step: f64,
    /// The largest half width of the ellipse in a plane in which the ray meets kernels.
    wide: f64,
    /// The planes of the kernels that the ray meets, counted from the voxel's plane.
    planes: RangeInclusive<i32>,
    /// The factor of the sum of sections.
    scale: f64,
}

impl PlaceRays {
    pub(super) fn new(place: DVec3, lattice: &ShadowLattice, bias: f64) -> Self {
        let ShadowLattice { kernel, divisor, to_world, unit, .. } = *lattice;
        let table = FootprintTable::new(&kernel, ERROR);
        // Kernels too narrow in their support for that get the finest table.
        let table = table.unwrap_or_else(|_| FootprintTable::with_size(&kernel, 4096, 16));
        Self { place, table, radius: kernel.radius(), bias, to_world, scale: 1.0 / unit / divisor }
    }

    /// Returns the ray from a voxel; `None` if nothing on it can occlude light.
    fn path(&self, dims: [usize; 3], from: [usize; 3]) -> Option<VoxelRay> {
        let path = self.place - DVec3::from_array(from.map(|p| p as f64));
        let distance = path.length();
        if distance <= self.bias {
            return None;
        }
        let along = path / distance;
        let d = along.to_array();
        let main = along.abs().max_position();
        let (ahead, room) = if d[main] > 0.0 { (1, dims[main] - 1 - from[main]) } else { (-1, from[main]) };
        let cosine = d[main].abs();
        let wide = self.radius / cosine;
        let last = (distance * cosine + self.radius).min(room as f64).floor() as i32;
        Some(VoxelRay {
            from: from.map(|p| p as i32),
            along,
            distance,
            main,
            across: [(main + 1) % 3, (main + 2) % 3],
            ahead,
            step: 1.0 / cosine,
            wide,
            planes: -(self.radius as i32)..=last,
            scale: (self.to_world * along).length() * self.scale,
        })
    }

    /// Sums the sections of the kernels of some planes.
    fn sum<T: Real>(&self, medium: &Medium<T>, path: &VoxelRay, planes: RangeInclusive<i32>) -> f64 {
        let [low, high] = path.around(&planes);
        if planes.is_empty() || !medium.is_occupied(low, high) {
            return 0.0;
        }
        let [u, v] = path.across;
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
                if value == 0.0 {
                    continue;
                }
                let o = DVec3::from_array([0, 1, 2].map(|axis| f64::from(at[axis] - path.from[axis])));
                let t = o.dot(path.along);
                let r2 = o.length_squared() - t * t;
                sum += value * self.table.section(self.radius, r2, self.bias - t, path.distance - t);
            }
        }
        sum
    }

    /// Returns the optical depth from a voxel to the place; depths above [`DARK`] are not exact.
    pub(super) fn depth<T: Real>(&self, medium: &Medium<T>, voxel: [usize; 3]) -> f64 {
        let Some(path) = self.path(medium.dims, voxel) else { return 0.0 };
        let (mut depth, last) = (0.0, *path.planes.end());
        for first in path.planes.clone().step_by(CHUNK as usize) {
            depth += path.scale * self.sum(medium, &path, first..=(first + CHUNK - 1).min(last));
            if depth > DARK {
                break;
            }
        }
        depth
    }
}

impl VoxelRay {
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
