//! The raster of a picture: which rays are followed, where they meet the voxel planes, and how they become pixels.

use bytemuck::Zeroable;
use glam::{DMat2, DMat3, DVec2, DVec3};

use super::super::layout::{self, CELL, TILE};
use super::super::view::Region;
use super::look::{BEYOND, Look, unordered};
use super::pack::Packing;
use super::parts::{Footprint, Sections};
use crate::camera::{Camera, Projection};
use crate::kernel::Kernel;
use crate::volume::Grid;

/// Raster points around those that pixels lie between: what cubic B-splines and the search for their coefficients look at.
const AROUND: f64 = 8.0;
/// The fewest pixels between rays that are not each a pixel's.
const MIN_PITCH: f64 = 1.25;

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
            phases: [1, 1],
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
            let shear = look.shear();
            let base = |p: DVec2| {
                let p = placed(camera.target + raised(p));
                DVec2::new(p.x, p.y) - shear * p.z
            };
            // The same rays whatever part of the volume is packed.
            let anchor = placed(grid.to_world().translation);
            let anchor = DVec2::new(anchor.x, anchor.y) - shear * anchor.z;
            let rays = Parallel { shear, base, anchor, corner, region, dims, radius }.rays(subject)?;
            spacing = rays.spacing;
            let Rays { origin, step_x, step_y, size, phases, pixel_origin, pixel_x, pixel_y, .. } = rays;
            let square = 1.0 - direction.x * direction.x;
            uniforms = layout::Raster {
                origin: f2(origin),
                step_x: f2(step_x),
                step_y: f2(step_y),
                shear: f2(shear),
                direction: f3(direction),
                stretch: look.voxel() as f32,
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
        uniforms.tiles = [across.div_ceil(TILE * uniforms.phases[0]), down.div_ceil(TILE * uniforms.phases[1])];
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
    /// Where a ray through the first voxel of the volume meets it.
    anchor: DVec2,
    /// The middle of the region's first pixel.
    corner: DVec2,
    region: Region,
    /// Voxels that are packed.
    dims: [f64; 3],
    radius: f64,
}

/// Which rays are followed, in base coordinates, and how they become pixels.
struct Rays {
    origin: DVec2,
    step_x: DVec2,
    step_y: DVec2,
    size: [u32; 2],
    phases: [u32; 2],
    spacing: Spacing,
    pixel_origin: DVec2,
    pixel_x: DVec2,
    pixel_y: DVec2,
}

impl<B: Fn(DVec2) -> DVec2> Parallel<B> {
    /// `None` where none reaches the volume.
    fn rays(&self, subject: &Subject<'_>) -> Option<Rays> {
        let Self { shear, base, anchor, corner, region, dims, radius } = self;
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
                phases: [1, 1],
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
        let origin = *anchor + steps * (((low - *anchor) / steps).floor() - AROUND);
        let count = ((high - origin) / steps + AROUND).ceil() + 1.0;
        let (step_x, step_y) = (DVec2::new(steps.x, 0.0), DVec2::new(0.0, steps.y));
        let to_raster = DMat2::from_cols(step_x, step_y).inverse();
        Some(Rays {
            origin,
            step_x,
            step_y,
            size: [count.x as u32, count.y as u32],
            phases: rays,
            spacing: Spacing::Voxel(rays),
            pixel_origin: to_raster * (first - origin),
            pixel_x: to_raster * pixel_x,
            pixel_y: to_raster * pixel_y,
        })
    }
}
