//! The rays of a picture: where they meet the voxel planes, how far apart they are, and which points of the
//! intermediate image they go through. See shaders/common/rays.wgsl.

mod parallel;
mod perspective;

use bytemuck::Zeroable;
use glam::{DAffine3, DMat3, DVec2, DVec3};

use super::Block;
use super::axis::{PrincipalAxis, smoothstep, unordered};
use super::pack::Packing;
use super::parts::{Footprint, Sections};
use crate::camera::{Camera, Growth, Projection};
use crate::clip::Side;
use crate::gpu::layout::{self, MACROCELL, TILE};
use crate::gpu::view::{Fade, half};
use crate::image::Region;
use crate::kernel::{Kernel, section};
use crate::volume::Grid;

/// Points of the intermediate image beyond those that pixels lie between, on every side: a cubic B-spline reads 2 of
/// them, and its coefficients read 5 more along each axis (shaders/prefilter.wgsl).
const SPLINE_MARGIN: f64 = 8.0;

/// The largest factor of stored densities: one of the smallest in a voxel plane makes it opaque, and the product with
/// the largest stays in the range of f32.
const MAX_DENSITY_SCALE: f64 = 1e30;

/// The rays of a region of a picture, along one principal axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rays {
    pub(super) uniforms: layout::Rays,
    pub(super) spacing: Spacing,
}

/// How far apart rays are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Spacing {
    /// Rays per voxel along a and along b.
    Voxel([u32; 2]),
    /// Pixels between neighbouring rays; 1: each pixel has its own ray.
    Pixels(f64),
}

/// What the rays of a picture depend on.
pub(super) struct RaySetup<'a> {
    pub(super) camera: &'a Camera,
    /// Width and height of the whole picture, pixels.
    pub(super) size: [u32; 2],
    pub(super) volume: PackedBox<'a>,
    pub(super) kernel: FittedKernel<'a>,
    pub(super) optics: Optics,
    /// How scalars are classified; `None`: voxels are classified already.
    pub(super) scalars: Option<Classification>,
}

/// The box of voxels that rays cross, as it is packed.
#[derive(Clone, Copy)]
pub(super) struct PackedBox<'a> {
    pub(super) grid: &'a Grid,
    pub(super) packing: Packing,
    /// Layers of the packed lattice beyond the faces of the volume.
    pub(super) padding: u32,
    /// See [`ViewGeometry::faces`](crate::gpu::view::ViewGeometry).
    pub(super) faces: DVec3,
    /// What is not cut away.
    pub(super) clip: &'a [Side],
}

/// A kernel as rays evaluate it.
#[derive(Clone, Copy)]
pub(super) struct FittedKernel<'a> {
    pub(super) kernel: Kernel,
    pub(super) footprint: &'a Footprint,
    pub(super) sections: &'a Sections,
    /// How it grows with its depth before an eye, and the largest growth. The growth of parallel rays is the kernel's.
    pub(super) growth: Growth,
    pub(super) most: f64,
    /// The share of the layer that the volume is.
    pub(super) fade: Option<Fade>,
}

/// What the field of the volume means to light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Optics {
    /// Optical depth per world length, of a stored density times a kernel; or scalar per lattice length.
    pub(super) density_scale: f64,
    /// Optical depth at which a ray ends.
    pub(super) opaque_depth: f64,
    /// Optical depth of the densest voxel over the longest edge of a voxel.
    pub(super) max_depth: f64,
    /// The largest of each channel of colours.
    pub(super) brightest: [f64; 3],
    /// Of an X-ray: `curve` in shaders/common/response.wgsl.
    pub(super) curve: [f32; 4],
    /// Colours are those of depth.
    pub(super) depth_coded: bool,
    /// How much a maximum is attenuated by its depth.
    pub(super) attenuation: f64,
}

/// How scalars are classified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Classification {
    /// See [`TransferTable`](crate::gpu::transfer::TransferTable).
    pub(super) invisible: [f32; 2],
    pub(super) lookup: [f32; 2],
    pub(super) gradient_lookup: f32,
    /// From the lattice of the volume to where the light is that arrives.
    pub(super) to_light: DAffine3,
    /// Places in a slab at which it is classified.
    pub(super) samples: u32,
    /// Whether empty space may show, so that nothing is skipped.
    pub(super) skip_nothing: bool,
}

impl PackedBox<'_> {
    /// A world point as (a, b, plane) of the packed box.
    fn placed(&self, axis: &PrincipalAxis, world: DVec3) -> DVec3 {
        let p = self.grid.to_lattice().transform_point3(world) + f64::from(self.padding);
        let low = DVec3::from_array(unordered(axis.axes, self.packing.low).map(f64::from));
        // Planes are numbered front to back: if rays run against m, from the last one of the box.
        let last_plane = f64::from(self.packing.dims[2]) - 1.0;
        axis.ordered(p - low) + if axis.flipped { DVec3::Z * last_plane } else { DVec3::ZERO }
    }

    /// From (a, b, plane) of the packed box to the lattice.
    fn map_to_lattice(&self, axis: &PrincipalAxis) -> DAffine3 {
        let of = |p: DVec3| self.placed(axis, self.grid.to_world().transform_point3(p));
        let zero = of(DVec3::ZERO);
        let [x, y, z] = DVec3::AXES.map(|unit| of(unit) - zero);
        DAffine3::from_mat3_translation(DMat3::from_cols(x, y, z), zero).inverse()
    }

    /// The planes that cut rays, as linear functions of (a, b, plane).
    fn clip_planes(&self, axis: &PrincipalAxis) -> layout::ClipPlanes {
        let to_lattice = self.map_to_lattice(axis);
        let origin = to_lattice.translation - half(self.grid);
        let plane = |(gradient, value): &Side| {
            (to_lattice.matrix3.transpose() * *gradient).extend(gradient.dot(origin) + value)
        };
        layout::clip_planes(self.clip.iter().map(plane))
    }

    /// The box of what shows, as its least and largest (a, b, plane).
    fn bounds(&self, axis: &PrincipalAxis) -> [DVec3; 2] {
        let ends = [-self.faces, self.faces].map(|end| half(self.grid) + end);
        let [a, b] = ends.map(|end| self.placed(axis, self.grid.to_world().transform_point3(end)));
        [a.min(b), a.max(b)]
    }
}

impl RaySetup<'_> {
    /// The share of a place (a, b, plane) in the depth of the box: `model` in shaders/common/rays.wgsl.
    fn depth(&self, axis: &PrincipalAxis) -> [f32; 4] {
        let PackedBox { grid, faces, .. } = self.volume;
        let gradient = grid.to_world().matrix3.transpose() * self.camera.forward;
        let across = axis.ordered(gradient) / (2.0 * gradient.abs().dot(faces));
        let middle = self.volume.placed(axis, grid.to_world().transform_point3(half(grid)));
        across.extend(0.5 - across.dot(middle)).as_vec4().to_array()
    }

    /// Plane coordinates (see shaders/common/frame.wgsl) of a point of the image, given in pixels from its top left
    /// corner.
    fn plane(&self, p: DVec2) -> DVec2 {
        let [width, height] = self.size.map(f64::from);
        DVec2::new(p.x - width / 2.0, height / 2.0 - p.y) * self.pixel()
    }

    /// The size of a pixel in plane coordinates.
    fn pixel(&self) -> f64 {
        let half_height = match self.camera.projection {
            Projection::Orthographic { half_height } => half_height,
            Projection::Perspective { tan_half_fov, .. } => tan_half_fov,
        };
        2.0 * half_height / f64::from(self.size[1])
    }

    /// The world vector from the middle of the image to a point of it, in a plane at unit distance or through the
    /// target.
    fn raised(&self, p: DVec2) -> DVec3 {
        let plane = self.plane(p);
        self.camera.right * plane.x + self.camera.up * plane.y
    }

    /// The uniforms that do not depend on the projection; 0 where they do.
    fn uniforms(&self, axis: &PrincipalAxis, region: Region) -> layout::Rays {
        let PackedBox { grid, packing, .. } = self.volume;
        let FittedKernel { kernel, footprint, sections, most, .. } = self.kernel;
        let radius = kernel.radius();
        let coefficient = |n: usize| footprint.coefficients.get(n).map_or(0.0, |&c| c as f32);
        // View coordinates of a gradient along each axis of the lattice: the transpose of what maps view to lattice.
        let view = DMat3::from_cols(self.camera.right, self.camera.up, self.camera.forward);
        let gradients = (grid.to_lattice().matrix3 * view).transpose();
        let [box_low, box_high] = self.volume.bounds(axis);
        // What begins or ends over no growth has its whole share there.
        let rate = |[from, to]: [f64; 2]| (1.0 / (to - from).max(1e-6)) as f32;
        let (fade_in, fade_out) = self.kernel.fade.map_or(([0.0; 2], [0.0; 2]), |Fade { begins, ends }| {
            ([begins[0] as f32, rate(begins)], [ends[1] as f32, rate(ends)])
        });
        let uniforms = layout::Rays {
            density_scale: self.optics.density_scale.min(MAX_DENSITY_SCALE) as f32,
            opaque_depth: self.optics.opaque_depth.min(f64::from(f32::MAX)) as f32,
            brightest: self.optics.brightest.map(|c| c as f32),
            model: if self.optics.depth_coded || self.optics.attenuation > 0.0 {
                self.depth(axis)
            } else {
                self.optics.curve
            },
            attenuation: self.optics.attenuation as f32,
            radius2: (radius * radius) as f32,
            box_low: f3(box_low),
            box_high: f3(box_high),
            gradient_x: f3(gradients.x_axis),
            gradient_y: f3(gradients.y_axis),
            gradient_z: f3(gradients.z_axis),
            // Runs are at least two macrocells apart, and an empty run ends them.
            run_slots: packing.dims[2].div_ceil(MACROCELL).div_ceil(2) + 1,
            voxels: packing.dims.map(|n| n as i32),
            flipped: i32::from(axis.flipped),
            columns: packing.columns as i32,
            row_texels: packing.row_texels as i32,
            footprint: [0, 1, 2, 3].map(coefficient),
            footprint_high: [4, 5, 6, 7].map(coefficient),
            picture: [region.width, region.height],
            phases: [1, 1],
            share: axis.share as f32,
            fineness: 1.0,
            growth_most: most as f32,
            fade_in,
            fade_out,
            sections: sections.0,
            clip_planes: self.volume.clip_planes(axis),
            ..layout::Rays::zeroed()
        };
        match self.scalars {
            Some(Classification { invisible, lookup, gradient_lookup, to_light, samples, skip_nothing }) => {
                let unskipped = if skip_nothing { packing.dims[2] as i32 } else { 0 };
                let map = self.volume.map_to_lattice(axis);
                let [to_light, to_lattice] = [to_light * map, map].map(|map| layout::affine(&map));
                let of_light = layout::Rays { gradient_lookup, to_light, to_lattice, ..uniforms };
                layout::Rays { invisible, lookup, samples, unskipped, ..of_light }
            }
            None => uniforms,
        }
    }
}

impl RaySetup<'_> {
    /// The least share of its own ray in each pixel. At 1 no intermediate image is worth its rays.
    pub(super) fn pixel_share(&self, axis: &PrincipalAxis) -> f64 {
        match self.camera.projection {
            Projection::Orthographic { .. } => parallel::pixel_share(self, axis),
            Projection::Perspective { distance, .. } => perspective::pixel_share(self, distance),
        }
    }

    /// The pixels of a region whose parallel rays along the axis share voxels.
    pub(super) fn block(&self, axis: &PrincipalAxis, region: Region) -> Option<Block> {
        parallel::block(self, axis, region)
    }
}

impl Rays {
    /// The rays of the pixels of a region.
    pub(super) fn of_pixels(setup: &RaySetup<'_>, axis: &PrincipalAxis, region: Region) -> Self {
        let common = setup.uniforms(axis, region);
        match setup.camera.projection {
            Projection::Orthographic { .. } => parallel::of_pixels(setup, axis, region, common),
            Projection::Perspective { distance, .. } => perspective::of_pixels(setup, axis, region, distance, common),
        }
        .in_tiles()
    }

    /// The rays of the intermediate images of a region, none if no ray reaches the volume. Each image has a share in
    /// the picture; together these are the share of the axis.
    pub(super) fn of_images(setup: &RaySetup<'_>, axis: &PrincipalAxis, region: Region) -> Vec<Self> {
        let common = layout::Rays { least_refined: setup.pixel_share(axis) as f32, ..setup.uniforms(axis, region) };
        let images = match setup.camera.projection {
            Projection::Orthographic { .. } => parallel::of_images(setup, axis, region, common),
            Projection::Perspective { distance, .. } => {
                perspective::of_image(setup, axis, region, distance, common).into_iter().collect()
            }
        };
        images.into_iter().map(Self::in_tiles).collect()
    }

    fn in_tiles(mut self) -> Self {
        let [across, down] = self.uniforms.size;
        let [along_a, along_b] = self.uniforms.phases;
        self.uniforms.tiles = [across.div_ceil(TILE * along_a), down.div_ceil(TILE * along_b)];
        self.uniforms.clip_high = self.uniforms.tiles;
        self
    }

    /// The same rays, of which only those around the pixels of a part of the region are marched: the bytes of these
    /// pixels do not depend on the others.
    pub(super) fn around(mut self, region: Region, part: Region) -> Self {
        // The pixels' splines depend on so many points around them.
        const MARGIN: f64 = SPLINE_MARGIN + 4.0;
        let uniforms = &mut self.uniforms;
        let [origin, x, y] =
            [uniforms.pixel_origin, uniforms.pixel_x, uniforms.pixel_y].map(|[x, y]| DVec2::new(x.into(), y.into()));
        let low = DVec2::new(f64::from(part.x - region.x), f64::from(part.y - region.y));
        let high = low + DVec2::new(f64::from(part.width), f64::from(part.height)) - 1.0;
        let corners = [(low.x, low.y), (high.x, low.y), (low.x, high.y), (high.x, high.y)];
        let points = corners.map(|(across, down)| origin + x * across + y * down);
        let ends = points
            .iter()
            .fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], &point| [low.min(point), high.max(point)]);
        // In points of the tiles' lattice; a float to integer cast saturates.
        let tile = DVec2::from(uniforms.phases.map(|phases| f64::from(TILE * phases)));
        let first = ((ends[0] - MARGIN) / tile).floor();
        let end = ((ends[1] + MARGIN) / tile + 1.0).floor();
        uniforms.clip_low = [first.x as u32, first.y as u32];
        uniforms.clip_high = [(end.x as u32).min(uniforms.tiles[0]), (end.y as u32).min(uniforms.tiles[1])];
        self
    }
}

/// The rays per voxel that the densest voxel asks for by its optical depth, as a power of 2: opacity saturates, so the
/// edges of what is opaque are sharper than kernels are. No view changes it.
///
/// Measured; docs/measurements/2026-11-22-rays.md has the table.
fn level_for_depth(depth: f64) -> f64 {
    if depth > 0.4 { 1.0 } else { 0.0 }
}

/// The rays per voxel that a kernel asks for by its width, as a whole power of 2: the estimate of what splines err by
/// sees only kernels that several rays meet. It changes with the view only where kernels grow, and there every pixel
/// has its own ray.
fn level_for_kernel(kernel: &Kernel) -> f64 {
    let radius = kernel.radius();
    // The standard deviation of the footprint along a or b.
    let (mut sum, mut squares) = (0.0_f64, 0.0);
    for i in 0..64 {
        let r = radius * (f64::from(i) + 0.5) / 64.0;
        let footprint = section(kernel, r * r, -radius, radius);
        sum += footprint * r;
        squares += footprint * r * r * r / 2.0;
    }
    let width = (squares / sum).sqrt();
    // What is cut off at the rim: 0.14 of the default Gaussian's peak.
    let rim = kernel.value(radius * radius * (1.0 - 1e-9)) / kernel.value(0.0);
    (2.0 * (0.58 / width).log2()).max((rim - 0.15) / 0.15).max(0.0).ceil()
}

/// The middle of the first pixel of a region, in pixels of the picture.
fn first_pixel(region: Region) -> DVec2 {
    DVec2::new(f64::from(region.x), f64::from(region.y)) + 0.5
}

fn f2(v: DVec2) -> [f32; 2] {
    v.as_vec2().to_array()
}

fn f3(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}
