//! The rays of a picture: the places at which they meet the voxel planes. See shaders/common/rays.wgsl.

mod parallel;
mod perspective;

use bytemuck::Zeroable;
use glam::{DAffine3, DMat3, DVec2, DVec3, DVec4};

use super::axis::{PrincipalAxis, unordered};
use super::pack::Packing;
use super::parts::Footprint;
use crate::camera::Projection;
use crate::camera::clip::Side;
use crate::gpu::layout::{self, MACROCELL, TILE};
use crate::gpu::view::{Fade, Held, half};
use crate::image::Region;
use crate::kernel::Kernel;
use crate::painters::painter::Job;
use crate::settings::Model;
use crate::settings::response::Response;

/// The largest factor of stored densities: one of the smallest in a voxel plane makes it opaque, and the product with
/// the largest stays in the range of f32.
const MAX_DENSITY_SCALE: f64 = 1e30;

/// The number of pieces per voxel in which slabs of scalars are classified. Slabs are thin: on the demos of 32^3
/// voxels, three err as eight do, to 1 % (rms; vessels 7 %).
const PIECES: f64 = 3.0;

/// The brightness of an X-ray that shows depth: optical depth over alpha is never more.
const BRIGHTEST_DEPTH: f64 = 1e30;

/// The inputs of the rays of a picture along one principal axis.
pub(super) struct RaySetup<'a> {
    pub(super) job: &'a Job<'a>,
    pub(super) axis: &'a PrincipalAxis,
    pub(super) packing: Packing,
    /// The reconstruction kernel, along parallel rays with its growth.
    pub(super) kernel: Kernel,
    pub(super) footprint: &'a Footprint,
}

/// Returns the optical depth of the densest voxel over the longest edge of a voxel: the same in every view, so that
/// nothing that depends on it changes while a volume turns.
pub(super) fn max_depth(job: &Job<'_>) -> f64 {
    let [x, y, z] = job.view.grid.spacing();
    job.weights.max * x.max(y).max(z) / job.weights.unit
}

impl RaySetup<'_> {
    /// Converts a world point to (a, b, plane).
    fn placed(&self, world: DVec3) -> DVec3 {
        self.numbered(self.job.view.grid.to_lattice().transform_point3(world))
    }

    /// Converts a place in the lattice to (a, b, plane). Voxels are numbered from one in the middle of the whole
    /// lattice, whatever part of it is packed: so the rays of a brick are the rays of the whole picture, to the bit.
    /// Planes are numbered front to back.
    fn numbered(&self, place: DVec3) -> DVec3 {
        let middle = self.job.view.grid.dims().map(|count| f64::from(count / 2));
        self.axis.ordered(place - DVec3::from_array(middle))
    }

    /// Returns the first voxel of the packed box along a and b, and its first plane.
    fn first(&self) -> DVec3 {
        let Self { job, axis, packing, .. } = self;
        let [a, b, m] = packing.low;
        let front = if axis.flipped { m + packing.dims[2] - 1 } else { m };
        let low = DVec3::from_array(unordered(axis.axes, [a, b, front]).map(f64::from));
        self.numbered(job.view.first() + low - f64::from(job.padding))
    }

    /// Returns the number of planes from the first plane of the foremost macrocells to the first plane of the packed
    /// box.
    fn lead(&self) -> i32 {
        let Self { axis, packing, .. } = self;
        let before = packing.mark_shift()[2];
        let behind = MACROCELL * packing.macrocells()[2] - before - packing.dims[2];
        (if axis.flipped { behind } else { before }) as i32
    }

    /// Returns the least and the largest (a, b, plane) that a brick owns.
    fn owned(&self) -> [DVec3; 2] {
        let open = DVec3::splat(Held::OPEN);
        let Some(held) = self.job.view.held else { return [-open, open] };
        let [a, b] = held.owned.map(|place| self.numbered(place).clamp(-open, open));
        [a.min(b), a.max(b)]
    }

    /// Returns the map from (a, b, plane) to the lattice.
    fn map_to_lattice(&self) -> DAffine3 {
        let place = |p: DVec3| self.placed(self.job.view.grid.to_world().transform_point3(p));
        let zero = place(DVec3::ZERO);
        let [x, y, z] = DVec3::AXES.map(|unit| place(unit) - zero);
        DAffine3::from_mat3_translation(DMat3::from_cols(x, y, z), zero).inverse()
    }

    /// Returns the planes that cut rays, as linear functions of (a, b, plane).
    fn clip_planes(&self) -> layout::ClipPlanes {
        let to_lattice = self.map_to_lattice();
        let origin = to_lattice.translation - half(&self.job.view.grid);
        let plane = |(gradient, value): &Side| {
            (to_lattice.matrix3.transpose() * *gradient).extend(gradient.dot(origin) + value)
        };
        layout::clip_planes(self.job.view.clip.iter().map(plane))
    }

    /// Returns the depth as a linear function of (a, b, plane): `view_depth` in shaders/common/rays.wgsl.
    fn view_depth(&self) -> [f32; 4] {
        let (view, to_lattice) = (self.job.view, self.map_to_lattice());
        let [scale, offset] = view.depth_of_z();
        let from_middle = to_lattice.translation - half(&view.grid);
        let across = to_lattice.matrix3.transpose() * view.gradients[2];
        (across.extend(view.gradients[2].dot(from_middle)) * scale + DVec4::W * offset).as_vec4().to_array()
    }

    /// Returns the box of visible matter, as its least and largest (a, b, plane).
    fn bounds(&self) -> [DVec3; 2] {
        let view = self.job.view;
        let ends = [-view.faces, view.faces].map(|end| half(&view.grid) + end);
        let [a, b] = ends.map(|end| self.placed(view.grid.to_world().transform_point3(end)));
        [a.min(b), a.max(b)]
    }

    /// Returns the share in the depth of the box as a linear function of (a, b, plane): `model` in
    /// shaders/common/rays.wgsl.
    fn depth(&self) -> [f32; 4] {
        let (view, grid) = (self.job.view, &self.job.view.grid);
        let gradient = grid.to_world().matrix3.transpose() * view.camera.forward;
        let across = self.axis.ordered(gradient) / (2.0 * gradient.abs().dot(view.faces));
        let middle = self.placed(grid.to_world().transform_point3(half(grid)));
        across.extend(0.5 - across.dot(middle)).as_vec4().to_array()
    }

    /// Returns the plane coordinates (see shaders/common/frame.wgsl) of a point of the image, given in pixels from its
    /// top left corner.
    fn plane(&self, p: DVec2) -> DVec2 {
        let [width, height] = self.job.view.camera.size.map(f64::from);
        DVec2::new(p.x - width / 2.0, height / 2.0 - p.y) * self.pixel()
    }

    /// Returns the size of a pixel in plane coordinates.
    fn pixel(&self) -> f64 {
        let camera = &self.job.view.camera;
        let half_height = match camera.projection {
            Projection::Orthographic { half_height } => half_height,
            Projection::Perspective { tan_half_fov, .. } => tan_half_fov,
        };
        2.0 * half_height / f64::from(camera.size[1])
    }

    /// Returns the uniforms that do not depend on the projection; all others are 0.
    fn uniforms(&self, region: Region) -> layout::Rays {
        let Self { job, axis, packing, kernel, footprint, .. } = self;
        let Job { view, settings, weights, post, .. } = **job;
        let radius = kernel.radius();
        let divisor = settings.normalization.divisor(&settings.kernel) * view.parallel_growth().powi(3);
        // An X-ray is white, whatever the colours of the transfer function, or as bright as it is deep.
        let brightest = match (settings.model, settings.response) {
            (Model::Xray, Response::Depth) => [BRIGHTEST_DEPTH; 3],
            (Model::Xray, _) => [1.0; 3],
            _ => weights.brightest,
        };
        let has_depth = settings.depth_coded || settings.attenuation > 0.0;
        let coefficient = |n: usize| footprint.coefficients.get(n).map_or(0.0, |&c| c as f32);
        // View coordinates of a gradient along each axis of the lattice: the transpose of the map from view to lattice.
        let axes = DMat3::from_cols(view.camera.right, view.camera.up, view.camera.forward);
        let gradients = (view.grid.to_lattice().matrix3 * axes).transpose();
        let ([box_low, box_high], [owned_low, owned_high]) = (self.bounds(), self.owned());
        let [along_a, along_b, along_m] = packing.steps();
        // A fade over no growth is whole at once.
        let rate = |[from, to]: [f64; 2]| (1.0 / (to - from).max(1e-6)) as f32;
        let (fade_in, fade_out) = view.fade.map_or(([0.0; 2], [0.0; 2]), |Fade { begins, ends }| {
            ([begins[0] as f32, rate(begins)], [ends[1] as f32, rate(ends)])
        });
        let uniforms = layout::Rays {
            density_scale: (1.0 / (divisor * weights.unit)).min(MAX_DENSITY_SCALE) as f32,
            opaque_depth: view.opaque_depth.min(f64::from(f32::MAX)) as f32,
            brightest: brightest.map(|c| c as f32),
            model: if has_depth { self.depth() } else { settings.xray_response().1 },
            attenuation: settings.attenuation as f32,
            radius2: (radius * radius) as f32,
            box_low: f3(box_low),
            box_high: f3(box_high),
            view_depth: self.view_depth(),
            owned_low: f3(owned_low),
            owned_high: f3(owned_high),
            first: self.first().as_ivec3().to_array(),
            gradient_x: f3(gradients.x_axis),
            gradient_y: f3(gradients.y_axis),
            gradient_z: f3(gradients.z_axis),
            // Runs are a slab apart or more, of which a macrocell has at most two; and an empty run ends them.
            run_slots: packing.macrocells()[2] + 1,
            macrocells: packing.macrocells().map(|n| n as i32),
            mark_shift: packing.mark_shift().map(|n| n as i32),
            mark_steps: packing.mark_steps().map(|n| n as i32),
            mark_bits: packing.mark_bits(),
            lead: self.lead(),
            along_a,
            along_b,
            along_m,
            page_steps: packing.table_steps(),
            voxels: packing.dims.map(|n| n as i32),
            flipped: i32::from(axis.flipped),
            footprint: [0, 1, 2, 3].map(coefficient),
            footprint_high: [4, 5, 6, 7].map(coefficient),
            picture: [region.width, region.height],
            share: axis.share as f32,
            growth_most: view.depth_growth().1 as f32,
            fade_in,
            fade_out,
            clip_planes: self.clip_planes(),
            ..layout::Rays::zeroed()
        };
        let Some(post) = post else { return uniforms };
        let map = self.map_to_lattice();
        layout::Rays {
            invisible: post.table.invisible,
            lookup: post.table.lookup,
            gradient_lookup: post.gradient_lookup,
            per_unit: post.per_unit,
            // Slabs of scalars are half a plane thick.
            samples: settings.samples_per_slab(axis.slab_voxels() / 2.0, PIECES),
            unskipped: if job.base_shows() { packing.dims[2] as i32 } else { 0 },
            to_light: layout::affine(&(post.to_light * map)),
            to_lattice: layout::affine(&map),
            ..uniforms
        }
    }

    /// Returns the rays of the pixels of a region; the rays around the pixels of its `part` are marched. The bytes of
    /// these pixels do not depend on the others.
    pub(super) fn rays(&self, region: Region, part: Region) -> layout::Rays {
        let tile = |end: [u32; 2]| [end[0] - region.x, end[1] - region.y];
        let uniforms = layout::Rays {
            corner: [region.x, region.y],
            tiles: [region.width, region.height].map(|n| n.div_ceil(TILE)),
            clip_low: tile([part.x, part.y]).map(|n| n / TILE),
            clip_high: tile([part.x + part.width, part.y + part.height]).map(|n| n.div_ceil(TILE)),
            ..self.uniforms(region)
        };
        match self.job.view.camera.projection {
            Projection::Orthographic { .. } => parallel::rays(self, uniforms),
            Projection::Perspective { distance, .. } => perspective::rays(self, distance, uniforms),
        }
    }
}

/// The middle of the first pixel of a picture, in pixels.
const FIRST_PIXEL: DVec2 = DVec2::splat(0.5);

fn f2(v: DVec2) -> [f32; 2] {
    v.as_vec2().to_array()
}

fn f3(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}
