//! The raster of a picture: which rays are followed, where they meet the voxel planes, and how they become pixels.

use bytemuck::Zeroable;
use glam::{DMat2, DMat3, DVec2, DVec3};

use super::super::layout;
use super::super::plan::Region;
use super::pack::{Packing, unordered};
use crate::camera::{Camera, Projection};
use crate::kernel::{Kernel, footprint_polynomial, section};
use crate::volume::Grid;

/// Terms of the footprint's polynomial: the fewer where they do.
const TERMS: [usize; 2] = [6, 8];
/// The most that it may err by, as a fraction of the footprint's peak.
const FOOTPRINT_ERROR: f64 = 5e-5;
/// Raster points around those that pixels lie between: what cubic B-splines and the search for their coefficients look at.
const AROUND: f64 = 8.0;
/// The fewest pixels between rays that are not each a pixel's.
const MIN_PITCH: f64 = 1.25;
/// How far beyond the picture, in halves of its width and height, looks are those of rays.
const BEYOND: f64 = 0.25;
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

/// How rays look at a lattice: along the axis m that they follow most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look {
    /// Numbers of the lattice axes a, b and m; rays follow a least.
    pub(super) axes: [usize; 3],
    /// Whether they run against m.
    flipped: bool,
    /// Unit vector in (a, b, m), m as they run along it; of rays through one eye that of a ray in their middle.
    direction: DVec3,
    /// World length per lattice length along it.
    stretch: f64,
}

impl Look {
    /// The looks of a picture: one of parallel rays; of rays through one eye those that any pixel's ray has.
    pub(super) fn all(camera: &Camera, grid: &Grid, size: [u32; 2]) -> Vec<Self> {
        let to_lattice = grid.to_lattice().matrix3;
        let Projection::Perspective { tan_half_fov, .. } = camera.projection else {
            let ray = to_lattice * camera.forward;
            let m = ray.abs().max_position();
            return vec![Self::along(m, ray[m] < 0.0, ray, 1.0)];
        };
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let [right, up] = [camera.right * aspect, camera.up].map(|axis| to_lattice * axis * tan_half_fov);
        let forward = to_lattice * camera.forward;
        let ways = (0..3).flat_map(|m| [(m, false), (m, true)]);
        ways.filter_map(|(m, flipped)| {
            // The part of the picture whose rays follow m that way most: where m's component is larger than any other.
            let sign = if flipped { -1.0 } else { 1.0 };
            let edge = 1.0 + BEYOND;
            let mut part = vec![(-edge, -edge), (edge, -edge), (edge, edge), (-edge, edge)];
            for other in (0..3).filter(|&other| other != m) {
                for against in [1.0, -1.0] {
                    // Ties are followed along both, whatever rounding makes of them.
                    let lead = |d: DVec3| sign * d[m] - against * d[other] + 1e-5 * d.length();
                    part = clipped(&part, |(x, y)| lead(forward + right * x + up * y));
                }
            }
            let count = part.len() as f64;
            let (x, y) = part.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / count, y + p.1 / count));
            let world = (1.0 + (tan_half_fov * tan_half_fov) * (x * x * aspect * aspect + y * y)).sqrt();
            (!part.is_empty()).then(|| Self::along(m, flipped, forward + right * x + up * y, world))
        })
        .collect()
    }

    /// Along m, of rays around one of that lattice direction and world length.
    fn along(m: usize, flipped: bool, ray: DVec3, world: f64) -> Self {
        let lean = ray.abs();
        let (i, j) = ((m + 1) % 3, (m + 2) % 3);
        let (a, b) = if lean[i] < lean[j] || lean[i] == lean[j] && i < j { (i, j) } else { (j, i) };
        let unit = ray.normalize();
        Self {
            axes: [a, b, m],
            flipped,
            direction: DVec3::new(unit[a], unit[b], unit[m].abs()),
            stretch: world / ray.length(),
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

    /// That distance in voxels.
    pub(super) fn slab_voxels(&self) -> f64 {
        1.0 / self.direction.z
    }

    /// What is given along the axes of the lattice, along a, b and m as rays run along it.
    fn ordered(&self, v: DVec3) -> DVec3 {
        let [a, b, m] = self.axes;
        DVec3::new(v[a], v[b], if self.flipped { -v[m] } else { v[m] })
    }
}

/// The part of a convex polygon where a linear function is not negative (Sutherland and Hodgman 1974).
fn clipped(polygon: &[(f64, f64)], value: impl Fn((f64, f64)) -> f64) -> Vec<(f64, f64)> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (at_p, at_q) = (value(p), value(q));
        if at_p >= 0.0 {
            kept.push(p);
        }
        if (at_p >= 0.0) != (at_q >= 0.0) {
            let t = at_p / (at_p - at_q);
            kept.push((p.0 + t * (q.0 - p.0), p.1 + t * (q.1 - p.1)));
        }
    }
    kept
}

/// The rays of a region of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Raster {
    pub(super) uniforms: layout::Raster,
    pub(super) spacing: Spacing,
}

/// How far rays are apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Spacing {
    /// So many rays a voxel, along a and b.
    Voxel([u32; 2]),
    /// So many pixels; where it is one, rays go through the pixels.
    Pixels(f64),
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
    /// Layers of the lattice beyond the faces of the volume.
    pub(super) padding: u32,
    /// Optical depth per world length of a stored density times a kernel, or scalar per lattice length.
    pub(super) density_scale: f64,
    /// How scalars are classified; `None`: voxels are.
    pub(super) scalars: Option<Classification>,
    pub(super) sections: &'a Sections,
    pub(super) opaque_depth: f64,
    /// The largest optical depth of a voxel per voxel of its density.
    pub(super) max_depth: f64,
    /// A ray for each pixel.
    pub(super) full: bool,
}

/// How scalars are classified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Classification {
    /// See [`TransferTable`](super::super::transfer::TransferTable).
    pub(super) clear: [f32; 2],
    pub(super) lookup: [f32; 2],
    /// Places in a slab.
    pub(super) samples: u32,
    /// Whether empty space may show.
    pub(super) everything: bool,
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
        let dims = packing.dims.map(f64::from);
        let to_lattice = grid.to_lattice();
        // A lattice point in base coordinates and planes.
        let placed = |world: DVec3| {
            let p = to_lattice.transform_point3(world) + f64::from(subject.padding);
            let low = DVec3::from_array(unordered(look.axes, packing.low).map(f64::from));
            look.ordered(p - low) + if look.flipped { DVec3::Z * (dims[2] - 1.0) } else { DVec3::ZERO }
        };
        let radius = kernel.radius();
        let footprint = &subject.footprint;
        let coefficient = |n: usize| footprint.coefficients.get(n).map_or(0.0, |&c| c as f32);
        let f2 = |v: DVec2| v.as_vec2().to_array();
        let f3 = |v: DVec3| v.as_vec3().to_array();
        let gradients = DMat3::from_cols(camera.right, camera.up, camera.forward);
        let gradients = (to_lattice.matrix3 * gradients).transpose();
        // Half a voxel beyond the outermost ones of the volume.
        let ends = [DVec3::splat(-0.5), DVec3::from_array(grid.dims().map(f64::from)) - 0.5];
        let ends = ends.map(|end| placed(grid.to_world().transform_point3(end)));
        let mut uniforms = layout::Raster {
            density_scale: subject.density_scale as f32,
            opaque_depth: subject.opaque_depth as f32,
            radius2: (radius * radius) as f32,
            box_low: f3(ends[0].min(ends[1])),
            box_high: f3(ends[0].max(ends[1])),
            gradient_x: f3(gradients.x_axis),
            gradient_y: f3(gradients.y_axis),
            gradient_z: f3(gradients.z_axis),
            run_slots: packing.dims[2].div_ceil(CELL).div_ceil(2) + 1,
            voxels: packing.dims.map(|n| n as i32),
            flipped: i32::from(look.flipped),
            columns: packing.columns as i32,
            row_texels: packing.row_texels as i32,
            footprint: [0, 1, 2, 3].map(coefficient),
            footprint_high: [4, 5, 6, 7].map(coefficient),
            picture: [region.width, region.height],
            phases: 1,
            sections: subject.sections.0,
            ..layout::Raster::zeroed()
        };
        if let Some(Classification { clear, lookup, samples, everything }) = subject.scalars {
            uniforms = layout::Raster { clear, lookup, samples, everything: u32::from(everything), ..uniforms };
        }
        let corner = DVec2::new(f64::from(region.x), f64::from(region.y)) + 0.5;
        let [width, height] = size.map(f64::from);
        let half_height = match camera.projection {
            Projection::Orthographic { half_height } => half_height,
            Projection::Perspective { tan_half_fov, .. } => tan_half_fov,
        };
        // Plane coordinates of a point of the image, in pixels from its top left corner.
        let plane = |p: DVec2| DVec2::new(p.x - width / 2.0, height / 2.0 - p.y) * (2.0 * half_height / height);
        let raised = |p: DVec2| camera.right * plane(p).x + camera.up * plane(p).y;
        let spacing;
        if let Projection::Perspective { distance, .. } = camera.projection {
            let heading = |p: DVec2| look.ordered(to_lattice.matrix3 * (camera.forward + raised(p)));
            // Pixels that a voxel takes at the far end of the volume.
            let farthest = grid.corners(0.5).map(|c| (c - camera.target).dot(camera.forward) + distance);
            let farthest = farthest.into_iter().fold(0.0, f64::max);
            let magnification = grid.min_spacing() / (farthest * 2.0 * half_height / height);
            let points = Points::new(subject, magnification, corner, &region);
            spacing = Spacing::Pixels(points.pitch);
            let first = heading(points.first);
            let next = points.first + points.pitch;
            uniforms = layout::Raster {
                heading: f3(first),
                heading_x: f3(heading(points.first + DVec2::X * points.pitch) - first),
                heading_y: f3(heading(points.first + DVec2::Y * points.pitch) - first),
                eye: f3(placed(camera.target - camera.forward * distance)),
                plane_origin: f2(plane(points.first)),
                plane_step: f2(plane(next) - plane(points.first)),
                size: points.size,
                pixel_origin: f2(points.pixel_origin),
                pixel_x: f2(DVec2::X / points.pitch),
                pixel_y: f2(DVec2::Y / points.pitch),
                ..uniforms
            };
        } else {
            let direction = look.direction;
            let shear = DVec2::new(direction.x, direction.y) / direction.z;
            let base = |p: DVec2| {
                let p = placed(camera.target + raised(p));
                DVec2::new(p.x, p.y) - shear * p.z
            };
            let rays = Parallel { shear, base, corner, region, dims, radius }.rays(subject)?;
            spacing = rays.spacing;
            let Rays { origin, step_x, step_y, size, phases, pixel_origin, pixel_x, pixel_y, .. } = rays;
            let square = 1.0 - direction.x * direction.x;
            uniforms = layout::Raster {
                origin: f2(origin),
                step_x: f2(step_x),
                step_y: f2(step_y),
                shear: f2(shear),
                direction: f3(direction),
                stretch: look.stretch as f32,
                row_half: (radius / square.sqrt()) as f32,
                row_slope: (direction.x * direction.y / square) as f32,
                phases,
                half: f2(reach(radius, shear)),
                size,
                pixel_origin: f2(pixel_origin),
                pixel_x: f2(pixel_x),
                pixel_y: f2(pixel_y),
                ..uniforms
            };
        }
        let [across, down] = uniforms.size;
        uniforms.tiles = [across.div_ceil(TILE * uniforms.phases), down.div_ceil(TILE)];
        Some(Self { uniforms, spacing })
    }
}

/// How far from where a ray meets a plane kernels reach it along a and b.
fn reach(radius: f64, shear: DVec2) -> DVec2 {
    radius * (DVec2::ONE + shear * shear).map(f64::sqrt)
}

/// A raster of points between pixels.
struct Points {
    /// Pixels from point to point; 1 where points are pixels.
    pitch: f64,
    /// The first of them, in pixels of the picture.
    first: DVec2,
    size: [u32; 2],
    /// The middle of the region's first pixel, in points.
    pixel_origin: DVec2,
}

impl Points {
    /// Where voxels take so many pixels; `corner` is the middle of the region's first.
    fn new(subject: &Subject<'_>, magnification: f64, corner: DVec2, region: &Region) -> Self {
        // Rays per voxel: measured, as those of parallel rays are. These do not move in step with the lattice.
        let rays = [1.5, 2.0, 3.0][rays_for_depth(subject.max_depth) as usize - 1];
        // Not so coarse that the points around the picture are rays that no look follows.
        let pitch = (magnification / rays).min(BEYOND / 2.0 * f64::from(subject.size[0].min(subject.size[1])) / AROUND);
        let sides = [region.width, region.height];
        // Enlarging costs as much as a few rays.
        if subject.full || pitch < MIN_PITCH {
            return Self { pitch: 1.0, first: corner, size: sides, pixel_origin: DVec2::ZERO };
        }
        let size = sides.map(|side| ((f64::from(side) - 1.0) / pitch + 2.0 * AROUND).ceil() as u32 + 1);
        Self { pitch, first: corner - AROUND * pitch, size, pixel_origin: DVec2::splat(AROUND) }
    }
}

/// Parallel rays in base coordinates.
struct Parallel<B> {
    shear: DVec2,
    /// Where the ray of a pixel meets plane 0.
    base: B,
    /// The middle of the region's first pixel.
    corner: DVec2,
    region: Region,
    dims: [f64; 3],
    radius: f64,
}

/// Which rays are followed, in base coordinates, and how they become pixels.
struct Rays {
    origin: DVec2,
    step_x: DVec2,
    step_y: DVec2,
    size: [u32; 2],
    phases: u32,
    spacing: Spacing,
    pixel_origin: DVec2,
    pixel_x: DVec2,
    pixel_y: DVec2,
}

impl<B: Fn(DVec2) -> DVec2> Parallel<B> {
    /// `None` where none reaches the volume.
    fn rays(&self, subject: &Subject<'_>) -> Option<Rays> {
        let Self { shear, base, corner, region, dims, radius } = self;
        let first = base(*corner);
        let [pixel_x, pixel_y] = [DVec2::X, DVec2::Y].map(|step| base(*corner + step) - first);
        // Pixels that a step of one voxel along a and b crosses.
        let to_pixels = DMat2::from_cols(pixel_x, pixel_y).inverse();
        let magnification = [to_pixels.x_axis.length(), to_pixels.y_axis.length()];
        let for_depth = rays_for_depth(subject.max_depth);
        let asked = [shear.x, shear.y].map(|shear| rays_for(shear).max(for_depth));
        // Where there are as many rays as pixels, they may as well go through the pixels.
        let as_many = (0..2).all(|axis| asked[axis] > 1 && f64::from(asked[axis]) >= magnification[axis]);
        if subject.full || asked == [4, 4] || as_many {
            return Some(Rays {
                origin: first,
                step_x: pixel_x,
                step_y: pixel_y,
                size: [region.width, region.height],
                phases: 1,
                spacing: Spacing::Pixels(1.0),
                pixel_origin: DVec2::ZERO,
                pixel_x: DVec2::X,
                pixel_y: DVec2::Y,
            });
        }
        let rays = [0, 1].map(|axis| asked[axis].min(magnification[axis].ceil().max(1.0) as u32));
        let steps = DVec2::new(1.0 / f64::from(rays[0]), 1.0 / f64::from(rays[1]));
        // Where the volume is, in base coordinates, and where the region looks.
        let drift = *shear * (dims[2] - 1.0);
        let half = reach(*radius, *shear);
        let volume =
            [-half - drift.max(DVec2::ZERO), DVec2::new(dims[0], dims[1]) - 1.0 + half - drift.min(DVec2::ZERO)];
        let extent = DVec2::new(f64::from(region.width), f64::from(region.height)) - 1.0;
        let corners = [(0.0, 0.0), (extent.x, 0.0), (0.0, extent.y), (extent.x, extent.y)]
            .map(|(x, y)| first + pixel_x * x + pixel_y * y);
        let low = corners.iter().fold(DVec2::INFINITY, |low, &c| low.min(c)).max(volume[0]);
        let high = corners.iter().fold(DVec2::NEG_INFINITY, |high, &c| high.max(c)).min(volume[1]);
        if low.cmpgt(high).any() {
            return None;
        }
        let origin = low - steps * AROUND;
        let count = ((high - low) / steps + 2.0 * AROUND).ceil() + 1.0;
        let (step_x, step_y) = (DVec2::new(steps.x, 0.0), DVec2::new(0.0, steps.y));
        let to_raster = DMat2::from_cols(step_x, step_y).inverse();
        Some(Rays {
            origin,
            step_x,
            step_y,
            size: [count.x as u32, count.y as u32],
            phases: rays[0],
            spacing: Spacing::Voxel(rays),
            pixel_origin: to_raster * (first - origin),
            pixel_x: to_raster * pixel_x,
            pixel_y: to_raster * pixel_y,
        })
    }
}

/// The parts of kernels in slabs, as all rays of a picture need them: the same for every look and region of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sections([[[f32; 4]; 3]; layout::SECTIONS]);

impl Sections {
    pub(super) fn new(kernel: &Kernel, camera: &Camera, looks: &[Look], scalars: bool) -> Self {
        Self(match (camera.projection, looks) {
            (Projection::Orthographic { .. }, [look, ..]) => {
                [sections(kernel, look.direction, scalars); layout::SECTIONS]
            }
            _ => std::array::from_fn(|step| section_step(step, kernel, scalars)),
        })
    }
}

/// A step of the table of sections: those of any direction that leans so far, with s in units of that. So they are smooth
/// towards rays along m, which meet all kernels of a plane at s = 0.
fn section_step(step: usize, kernel: &Kernel, scalars: bool) -> [[f32; 4]; 3] {
    let lean = (std::f64::consts::SQRT_2 * step as f64 / (layout::SECTIONS - 1) as f64).max(1e-3);
    let [x, y, z] = sections(kernel, DVec3::new(0.0, lean, 1.0).normalize(), scalars);
    let lean = lean as f32;
    [x, y.map(|c| c * lean), z.map(|c| c * lean * lean)]
}

/// The parts of a kernel in the slabs before its middle, as the least squares fit over where rays can meet its plane: for
/// each slab, by its number, footprint times x + y s, with scalars + z s^2; s is the place of its centre along the ray.
///
/// Slabs are a plane thick, with a plane in their middle, those of scalars half as thick between planes.
fn sections(kernel: &Kernel, direction: DVec3, scalars: bool) -> [[f32; 4]; 3] {
    /// Places along a side of the square that is looked at.
    const SIDE: i32 = 25;
    let radius = kernel.radius();
    let reach = radius / direction.z;
    // Planes where slabs begin and the last ends.
    let ends: &[f64] = if scalars { &[-2.0, -1.5, -1.0, -0.5, 0.0] } else { &[-2.5, -1.5, -0.5] };
    // Powers of s that are told apart: rays along m meet all kernels of a plane at s = 0.
    let terms = if direction.z > 1.0 - 1e-9 {
        1
    } else if scalars {
        3
    } else {
        2
    };
    // Sums of squares of the footprint times powers of s, and of these times each part.
    let mut normal = DMat3::ZERO;
    let mut parts = [DVec3::ZERO; 4];
    for i in 0..SIDE {
        for j in 0..SIDE {
            let place = |n: i32| reach * (f64::from(2 * n + 1) / f64::from(SIDE) - 1.0);
            let (du, dv) = (place(i), place(j));
            let s = du * direction.x + dv * direction.y;
            let r2 = du * du + dv * dv - s * s;
            if r2 >= radius * radius {
                continue;
            }
            let powers = DVec3::new(1.0, s, s * s) * section(kernel, r2, -radius, radius);
            normal += DMat3::from_cols(powers * powers.x, powers * powers.y, powers * powers.z);
            for (sum, slab) in parts.iter_mut().zip(ends.windows(2)) {
                *sum += powers * section(kernel, r2, slab[0] / direction.z - s, slab[1] / direction.z - s);
            }
        }
    }
    // Powers that are not fitted are left out of the equations.
    for unused in terms..3 {
        let axis = DVec3::AXES[unused];
        let keep = DVec3::ONE - axis;
        normal = DMat3::from_cols(normal.x_axis * keep, normal.y_axis * keep, normal.z_axis * keep);
        *normal.col_mut(unused) = axis;
        parts = parts.map(|part| part * keep);
    }
    let solve = normal.inverse();
    let fits = parts.map(|part| (solve * part).as_vec3());
    [fits.map(|fit| fit.x), fits.map(|fit| fit.y), fits.map(|fit| fit.z)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_kernel_are_its_sections() {
        for direction in [DVec3::Z, DVec3::new(0.1, 0.4, 0.8).normalize(), DVec3::new(1.0, 1.0, 1.0).normalize()] {
            for kernel in [Kernel::default(), Kernel::KAISER_BESSEL] {
                let [[x0, x1, ..], [y0, y1, ..], _] = sections(&kernel, direction, false).map(|c| c.map(f64::from));
                // Of a kernel before the ray's place, more is in the slabs before.
                assert!(direction == DVec3::Z || y0 < 0.0 && y1 < 0.0, "{y0} {y1}");
                // Through the middle: what symmetry leaves adds up to the footprint.
                let plane = |n: f64| n / direction.z;
                let whole = section(&kernel, 0.0, -9.0, 9.0);
                for (x, n) in [(x0, -2.5), (x1, -1.5), (1.0 - 2.0 * (x0 + x1), -0.5)] {
                    let exact = section(&kernel, 0.0, plane(n), plane(n + 1.0)) / whole;
                    // The fit is to all places at once, most of which are beside the middle.
                    assert!((x - exact).abs() < 0.15, "{kernel:?} {direction} {n}: {x} for {exact}");
                }
            }
        }
    }

    #[test]
    fn looks_are_those_of_pixels() {
        let grid = Grid::new([8, 8, 8], glam::DAffine3::IDENTITY).unwrap();
        let count = |fov, azimuth, elevation| {
            let projection = crate::camera::ProjectionKind::Perspective { fov };
            let view = crate::camera::View { projection, azimuth, elevation, ..crate::camera::View::default() };
            Look::all(&Camera::new(&view, &grid, [64, 48]).unwrap(), &grid, [64, 48]).len()
        };
        assert_eq!(count(30.0, 0.0, 0.0), 1);
        assert_eq!(count(30.0, 45.0, 0.0), 2);
        assert_eq!(count(30.0, 45.0, 35.26), 3);
        // Around the front all sides, but not the back.
        assert_eq!(count(120.0, 0.0, 0.0), 5);
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
