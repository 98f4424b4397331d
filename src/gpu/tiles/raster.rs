//! The raster of a picture: which rays are followed, where they meet the voxel planes, and how they become pixels.

use glam::{DMat2, DVec2, DVec3};

use super::super::layout;
use super::super::plan::Region;
use super::pack::Packing;
use crate::camera::{Camera, Projection};
use crate::kernel::{Kernel, footprint_polynomial, section};
use crate::volume::Grid;

/// Terms of the footprint's polynomial: the fewer where they do.
const TERMS: [usize; 2] = [6, 8];
/// The most that it may err by, as a fraction of the footprint's peak.
const FOOTPRINT_ERROR: f64 = 5e-5;
/// Raster points around those that pixels lie between: what cubic B-splines and the search for their coefficients look at.
const AROUND: f64 = 8.0;
/// Side of a tile in rays.
const TILE: u32 = 8;
/// Voxel planes that are skipped together; CELL in shaders/common/packing.wgsl.
pub(crate) const CELL: u32 = 4;
/// Tiles in a row of the texture of runs; RUN_ROW in shaders/common/raster.wgsl.
pub(crate) const RUN_ROW: u32 = 4096;

/// The footprint of a kernel as a polynomial.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Footprint {
    coefficients: Vec<f64>,
    /// Its largest error, as a fraction of the footprint's peak.
    pub(super) error: f64,
}

impl Footprint {
    /// `None` where the terms there are do not do.
    pub(super) fn new(kernel: &Kernel) -> Option<Self> {
        let fits = TERMS.map(|terms| footprint_polynomial(kernel, terms));
        let (coefficients, error) = fits.into_iter().find(|(_, error)| *error <= FOOTPRINT_ERROR)?;
        Some(Self { coefficients, error })
    }

    pub(super) fn terms(&self) -> u32 {
        self.coefficients.len() as u32
    }
}

/// How parallel rays look at a lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look {
    /// Numbers of the lattice axes a, b and m: rays follow m most, and a least.
    pub(super) axes: [usize; 3],
    /// Whether they run against m.
    flipped: bool,
    /// Their unit vector in (a, b, m), m as they run along it.
    direction: DVec3,
    /// World length per lattice length along them.
    stretch: f64,
}

impl Look {
    pub(super) fn new(camera: &Camera, grid: &Grid) -> Self {
        let ray = grid.to_lattice().matrix3 * camera.forward;
        let lean = ray.abs();
        let mut axes = [0, 1, 2];
        axes.sort_by(|&i, &j| lean[i].total_cmp(&lean[j]));
        let [a, b, m] = axes;
        let unit = ray.normalize();
        Self {
            axes,
            flipped: ray[m] < 0.0,
            direction: DVec3::new(unit[a], unit[b], unit[m].abs()),
            stretch: 1.0 / ray.length(),
        }
    }

    /// World length of a voxel along a ray.
    pub(super) fn voxel(&self) -> f64 {
        self.stretch
    }

    /// World distance of two voxel planes along a ray: the thickness of a slab.
    pub(super) fn slab(&self) -> f64 {
        self.stretch / self.direction.z
    }
}

/// The rays of a region of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Raster {
    pub(super) uniforms: layout::Raster,
    /// Rays per voxel along a and b; `None`: one for each pixel.
    pub(super) rays_per_voxel: Option<[u32; 2]>,
}

/// What a raster is of.
pub(super) struct Subject<'a> {
    pub(super) camera: &'a Camera,
    pub(super) grid: &'a Grid,
    /// Width and height of the whole picture.
    pub(super) size: [u32; 2],
    pub(super) kernel: Kernel,
    pub(super) footprint: &'a Footprint,
    pub(super) packing: Packing,
    /// Optical depth per world length of a stored density times a kernel.
    pub(super) density_scale: f64,
    pub(super) opaque_depth: f64,
    /// The largest optical depth of a voxel per voxel of its density.
    pub(super) max_depth: f64,
    /// A ray for each pixel.
    pub(super) full: bool,
}

/// Rays per voxel along an axis, of rays that move by `shear` voxels along it from plane to plane: where that is close to a
/// whole number, the ripple and the rims of kernels in plane after plane fall on one another, and one ray per voxel misses
/// what is between.
///
/// Measured; ARCHITECTURE.md has the table.
fn rays_for(shear: f64) -> u32 {
    let whole = shear.round();
    match (shear - whole).abs() {
        off if off > 0.18 || whole != 0.0 && off > 0.05 => 1,
        off if off > 0.06 || whole != 0.0 => 2,
        _ => 4,
    }
}

/// Rays per voxel along an axis that a volume asks for whose densest voxel has that optical depth: opacity saturates, and
/// edges of what is opaque are sharper than kernels are.
fn rays_for_depth(depth: f64) -> u32 {
    match depth {
        d if d <= 0.4 => 1,
        d if d <= 1.6 => 2,
        _ => 3,
    }
}

impl Raster {
    /// The raster of a region; `None` where no ray reaches the volume.
    pub(super) fn new(subject: &Subject<'_>, look: &Look, region: Region) -> Option<Self> {
        let Subject { camera, grid, size, kernel, packing, .. } = subject;
        let Projection::Orthographic { half_height } = camera.projection else { return None };
        let [a, b, m] = look.axes;
        let dims = packing.dims.map(f64::from);
        let direction = look.direction;
        let shear = DVec2::new(direction.x, direction.y) / direction.z;
        let to_lattice = grid.to_lattice();
        let pixel = 2.0 * half_height / f64::from(size[1]);
        // Base coordinates of a point of the image, in pixels from its top left corner.
        let base = |x: f64, y: f64| {
            let (x, y) = (x - f64::from(size[0]) / 2.0, f64::from(size[1]) / 2.0 - y);
            let world = camera.target + (camera.right * x + camera.up * y) * pixel;
            let p = to_lattice.transform_point3(world);
            let p = DVec3::new(p[a], p[b], p[m]) - DVec3::from_array(packing.low.map(f64::from));
            let depth = if look.flipped { dims[2] - 1.0 - p.z } else { p.z };
            DVec2::new(p.x, p.y) - shear * depth
        };
        let corner = DVec2::new(f64::from(region.x), f64::from(region.y));
        let first = base(corner.x + 0.5, corner.y + 0.5);
        let pixel_x = base(corner.x + 1.5, corner.y + 0.5) - first;
        let pixel_y = base(corner.x + 0.5, corner.y + 1.5) - first;
        let extent = DVec2::new(f64::from(region.width), f64::from(region.height)) - 1.0;
        let radius = kernel.radius();
        let half = radius * (DVec2::ONE + shear * shear).map(f64::sqrt);
        // Pixels that a step of one voxel along a and b crosses.
        let to_pixels = DMat2::from_cols(pixel_x, pixel_y).inverse();
        let magnification = [to_pixels.x_axis.length(), to_pixels.y_axis.length()];
        let for_depth = rays_for_depth(subject.max_depth);
        let asked = [shear.x, shear.y].map(|shear| rays_for(shear).max(for_depth));
        // Where there are as many rays as pixels, they may as well go through the pixels.
        let as_many = (0..2).all(|axis| asked[axis] > 1 && f64::from(asked[axis]) >= magnification[axis]);
        let full = subject.full || asked == [4, 4] || as_many;
        let rays = [0, 1].map(|axis| asked[axis].min(magnification[axis].ceil().max(1.0) as u32));
        let (origin, step_x, step_y, points, phases);
        if full {
            (origin, step_x, step_y) = (first, pixel_x, pixel_y);
            points = [region.width, region.height];
            phases = 1;
        } else {
            let steps = DVec2::new(1.0 / f64::from(rays[0]), 1.0 / f64::from(rays[1]));
            // Where the volume is, in base coordinates, and where the region looks.
            let drift = shear * (dims[2] - 1.0);
            let volume =
                [-half - drift.max(DVec2::ZERO), DVec2::new(dims[0], dims[1]) - 1.0 + half - drift.min(DVec2::ZERO)];
            let corners = [(0.0, 0.0), (extent.x, 0.0), (0.0, extent.y), (extent.x, extent.y)]
                .map(|(x, y)| first + pixel_x * x + pixel_y * y);
            let low = corners.iter().fold(DVec2::INFINITY, |low, &c| low.min(c)).max(volume[0]);
            let high = corners.iter().fold(DVec2::NEG_INFINITY, |high, &c| high.max(c)).min(volume[1]);
            if low.cmpgt(high).any() {
                return None;
            }
            origin = low - steps * AROUND;
            let count = ((high - low) / steps + 2.0 * AROUND).ceil() + 1.0;
            (step_x, step_y) = (DVec2::new(steps.x, 0.0), DVec2::new(0.0, steps.y));
            points = [count.x as u32, count.y as u32];
            phases = rays[0];
        }
        let to_raster = DMat2::from_cols(step_x, step_y).inverse();
        let footprint = &subject.footprint;
        let coefficient = |n: usize| footprint.coefficients.get(n).map_or(0.0, |&c| c as f32);
        let sections = sections(kernel, direction);
        let f2 = |v: DVec2| v.as_vec2().to_array();
        let uniforms = layout::Raster {
            origin: f2(origin),
            step_x: f2(step_x),
            step_y: f2(step_y),
            shear: f2(shear),
            direction: direction.as_vec3().to_array(),
            density_scale: (subject.density_scale * look.stretch) as f32,
            voxels: packing.dims.map(|n| n as i32),
            flipped: i32::from(look.flipped),
            half: f2(half),
            row_half: (radius / (1.0 - direction.x * direction.x).sqrt()) as f32,
            row_slope: (direction.x * direction.y / (1.0 - direction.x * direction.x)) as f32,
            footprint: [0, 1, 2, 3].map(coefficient),
            footprint_high: [4, 5, 6, 7].map(coefficient),
            size: points,
            tiles: [points[0].div_ceil(TILE * phases), points[1].div_ceil(TILE)],
            phases,
            opaque_depth: subject.opaque_depth as f32,
            columns: packing.columns as i32,
            row_texels: packing.row_texels as i32,
            run_slots: packing.dims[2].div_ceil(CELL).div_ceil(2) + 1,
            radius2: (radius * radius) as f32,
            section_0: sections[0],
            section_1: sections[1],
            section_2: sections[2],
            section_3: sections[3],
            section_4: sections[4],
            pixel_origin: f2(to_raster * (first - origin)),
            pixel_x: f2(to_raster * pixel_x),
            pixel_y: f2(to_raster * pixel_y),
            picture: [region.width, region.height],
        };
        Some(Self { uniforms, rays_per_voxel: (!full).then_some(rays) })
    }
}

/// For the slabs of the planes from two before a kernel's own to two behind: the least squares fit (x, y) of the kernel's
/// part in it by its footprint times x + y s, over where rays can meet its plane; s is the place of its centre along the ray.
fn sections(kernel: &Kernel, direction: DVec3) -> [[f32; 2]; 5] {
    /// Places along a side of the square that is looked at.
    const SIDE: i32 = 25;
    let radius = kernel.radius();
    let reach = radius / direction.z;
    // Sums of squares of the footprint and of it times s, their product, and of both times each part.
    let (mut ww, mut wv, mut vv) = (0.0, 0.0, 0.0);
    let mut parts = [[0.0; 2]; 5];
    for i in 0..SIDE {
        for j in 0..SIDE {
            let place = |n: i32| reach * (f64::from(2 * n + 1) / f64::from(SIDE) - 1.0);
            let (du, dv) = (place(i), place(j));
            let s = du * direction.x + dv * direction.y;
            let r2 = du * du + dv * dv - s * s;
            if r2 >= radius * radius {
                continue;
            }
            let plane = |n: i32| (f64::from(n) - 2.5) / direction.z - s;
            let section = |n: i32| section(kernel, r2, plane(n), plane(n + 1));
            let found = [0, 1, 2, 3, 4].map(section);
            let w: f64 = found.iter().sum();
            let v = w * s;
            (ww, wv, vv) = (ww + w * w, wv + w * v, vv + v * v);
            for (sum, part) in parts.iter_mut().zip(found) {
                *sum = [sum[0] + w * part, sum[1] + v * part];
            }
        }
    }
    let determinant = ww * vv - wv * wv;
    parts.map(|[w, v]| {
        // Rays along m meet all kernels of a plane at s = 0.
        if determinant > 1e-9 * ww * ww {
            [(w * vv - v * wv) / determinant, (v * ww - w * wv) / determinant].map(|c| c as f32)
        } else {
            [(w / ww) as f32, 0.0]
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_kernel_add_up_to_it() {
        for direction in [DVec3::Z, DVec3::new(0.1, 0.4, 0.8).normalize(), DVec3::new(1.0, 1.0, 1.0).normalize()] {
            for kernel in [Kernel::default(), Kernel::KAISER_BESSEL] {
                let sections = sections(&kernel, direction);
                let sum = sections.iter().fold([0.0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]]);
                assert!((sum[0] - 1.0).abs() < 1e-5 && sum[1].abs() < 1e-5, "{kernel:?} {direction}: {sum:?}");
                // Of a kernel before the ray's place, more is in the slabs before.
                assert!(direction == DVec3::Z || sections[0][1] < 0.0 && sections[4][1] > 0.0, "{sections:?}");
            }
        }
    }

    #[test]
    fn footprints_are_polynomials() {
        for kernel in [Kernel::default(), Kernel::KAISER_BESSEL] {
            let Footprint { coefficients, error } = Footprint::new(&kernel).unwrap();
            let radius = kernel.radius();
            let peak = kernel.cumulative_footprint(0.0, radius);
            let worst = (0..=50).map(|i| {
                let r = radius * f64::from(i) / 50.0;
                let c2 = radius * radius - r * r;
                let got = c2.sqrt() * coefficients.iter().rev().fold(0.0, |sum, a| sum * c2 + a);
                (got - kernel.cumulative_footprint(r, radius)).abs() / peak
            });
            let worst = worst.fold(0.0, f64::max);
            assert!(worst < 2e-5 && (worst - error).abs() < 1e-5, "{kernel:?}: {worst:e}, {error:e}");
        }
    }
}
