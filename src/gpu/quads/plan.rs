//! From a camera to the numbers that the stages of a frame work with.

use glam::{DVec3, DVec4};

use super::super::layout::{Batch, Frame};
use super::super::scalars::Reach;
use crate::camera::{Camera, Growth, Projection};
use crate::lighting::{Light, Lighting};
use crate::settings::{Model, Savings, Settings, Sheets};
use crate::volume::Grid;

/// A rectangle of the image, in pixels from its top left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Region {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

/// A region of a picture and the uniforms to render it with, on the device.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Target<'a> {
    pub(crate) plan: &'a Plan,
    pub(crate) region: Region,
    /// [`Plan::frame`] of the region.
    pub(crate) frame: &'a wgpu::Buffer,
}

impl Target<'_> {
    /// Width and height of the buffers that the region is rendered in: with the margin around it.
    pub(crate) fn extent(&self) -> [u32; 2] {
        [self.region.width, self.region.height].map(|side| side + 2 * self.plan.margin)
    }
}

/// What a scene's splats are, as far as a plan needs it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Subject {
    /// The largest weight of a splat: extinction times unit distance, or scalar.
    pub(crate) max_weight: f64,
    /// World distance that weights are per; 1 for scalars.
    pub(crate) unit: f64,
}

/// The geometry of one picture, in f64: sheets, projection, and the part of the image that the volume can reach.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    pub(super) camera: Camera,
    pub(super) size: [u32; 2],
    pub(super) grid: Grid,
    pub(super) radius: f64,
    pub(super) growth: Growth,
    /// The smallest and the largest growth of a kernel in the volume.
    pub(super) growths: [f64; 2],
    /// Gradients in the lattice of the view coordinates x, y and z.
    pub(super) view: [DVec3; 3],
    /// View coordinates of the middle of the lattice, from the target.
    pub(super) offset: DVec3,
    /// Depth of the middle of the lattice in front of the eye (perspective).
    pub(super) eye_depth: f64,
    /// View depth of the farthest voxel.
    pub(super) farthest: f64,
    /// Lattice axis of axis-aligned sheets.
    pub(super) axis: Option<usize>,
    pub(super) post_shaded: bool,
    /// Pixels around a region that its shading looks at.
    pub(super) margin: u32,
    /// Layers of the lattice beyond the faces of the volume.
    pub(super) padding: u32,
    /// View depth, from the middle of the lattice, at which the first sheet begins.
    pub(super) sheet_origin: f64,
    pub(super) sheet_step: f64,
    pub(super) sheets: u32,
    pub(super) section_scale: f64,
    pub(super) sheet_scale: f64,
    pub(super) opaque_depth: f64,
    pub(super) savings: Savings,
}

/// What a sheet accumulates is scaled so that a sheet filled with the densest material accumulates about this: an f16
/// sheet then resolves contributions 2e6 times smaller before they turn subnormal, and holds 250 times more (oblique
/// perspective rays, `Normalization::Peak`) before it overflows, whatever the units of the scene.
const SHEET_FULL: f64 = 256.0;

/// The most pixels that gradients reach sideways.
const MAX_MARGIN: f64 = 64.0;

impl Plan {
    pub(crate) fn new(camera: &Camera, grid: &Grid, settings: &Settings, subject: Subject) -> Self {
        let to_world = grid.to_world().matrix3;
        let view = [camera.right, camera.up, camera.forward].map(|axis| to_world.transpose() * axis);
        let from_target = grid.center() - camera.target;
        let offset =
            DVec3::new(from_target.dot(camera.right), from_target.dot(camera.up), from_target.dot(camera.forward));
        let half = DVec3::from_array(grid.dims().map(|d| f64::from(d - 1) / 2.0));
        let lattice_reach = view[2].abs().dot(half);
        let eye_depth = match camera.projection {
            Projection::Orthographic { .. } => 0.0,
            Projection::Perspective { distance, .. } => distance + offset.z,
        };
        let growth = if settings.antialiasing { camera.growth(grid, settings.size[1]) } else { Growth::NONE };
        // Depth of the nearest voxel, or of the eye where that is behind it, and of the farthest.
        let growths = [-lattice_reach, lattice_reach].map(|z| growth.at(z + eye_depth));
        let radius = settings.kernel.radius();
        let post_shaded = settings.is_post_shaded();
        // What is reconstructed from scalars ends with the box of the volume.
        let reach = if post_shaded {
            view[2].abs().dot(half + 0.5)
        } else {
            lattice_reach + radius * growths[1] * view[2].length()
        };
        let grid_forward = grid.to_lattice().matrix3 * camera.forward;
        // One voxel of thickness is the world length in which the central ray advances by one lattice unit, and where
        // kernels have grown they resolve that much less.
        let mut sheet_step = settings.sheet_thickness * growths[0] / grid_forward.length();
        // Shading takes in a sheet before the first and one after the last.
        let beside = if post_shaded { sheet_step } else { 0.0 };
        let sheet_origin = match camera.projection {
            Projection::Orthographic { .. } => -reach - beside,
            // Rays start at the eye, and with them the first sheet.
            Projection::Perspective { .. } => (-reach - beside).max(-eye_depth),
        };
        let whole = if reach > sheet_origin { reach + beside - sheet_origin } else { 0.0 };
        if settings.model == Model::Xray {
            sheet_step = sheet_step.max(whole);
        }
        let mut sheets = (whole / sheet_step).ceil().clamp(0.0, f64::from(u32::MAX / 2)) as u32;
        let axis = (settings.sheets == Sheets::Axis).then(|| {
            // The planes whose normal, the gradient of their lattice coordinate, is nearest to the view direction.
            let rows = grid.to_lattice().matrix3.transpose();
            let cosine = |axis: &usize| (grid_forward[*axis] / rows.col(*axis).length()).abs();
            (0..3).max_by(|a, b| cosine(a).total_cmp(&cosine(b))).unwrap_or(0)
        });
        if let Some(axis) = axis {
            sheets = if sheets == 0 { 0 } else { grid.dims()[axis] };
        }
        let divisor = settings.normalization.divisor(&settings.kernel);
        let Subject { max_weight, unit } = subject;
        // A sheet of scalars holds their mean.
        let length = if post_shaded { 1.0 } else { sheet_step };
        let full = max_weight / unit * length * settings.kernel.integral() / divisor;
        let sheet_scale = if full > 0.0 { (SHEET_FULL / full).log2().floor().exp2() } else { 1.0 };
        let mut plan = Self {
            camera: *camera,
            size: settings.size,
            grid: *grid,
            radius,
            growth,
            growths,
            view,
            offset,
            eye_depth,
            farthest: lattice_reach,
            axis,
            post_shaded,
            margin: 0,
            padding: 0,
            sheet_origin,
            sheet_step,
            sheets,
            section_scale: sheet_scale / (divisor * unit),
            sheet_scale,
            opaque_depth: if settings.model == Model::Composite && settings.termination > 0.0 {
                -settings.termination.ln()
            } else {
                f64::INFINITY
            },
            savings: settings.savings,
        };
        if settings.lighting.is_some() && post_shaded {
            // As far sideways as the sheets before and behind are away, for gradients that err alike in all directions.
            let pixel = plan.pixels().0[0] * if plan.is_perspective() { eye_depth.max(sheet_step) } else { 1.0 };
            plan.margin = (sheet_step / pixel).round().clamp(1.0, MAX_MARGIN) as u32;
        }
        if post_shaded {
            plan.padding = plan.scalar_reach().padding;
        }
        plan
    }

    /// How far splats of scalars reach in this picture.
    pub(crate) fn scalar_reach(&self) -> Reach {
        let (scale, origin) = self.pixels();
        let rotation = self.grid.to_lattice().matrix3;
        let [w, h] = self.size.map(f64::from);
        // The longest lattice length of a sheet along any ray.
        let mut longest = (rotation * self.camera.forward).length();
        if self.is_perspective() {
            for (x, y) in [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)] {
                let (sx, sy) = (origin[0] + x * scale[0], origin[1] + y * scale[1]);
                let ray = self.camera.forward + self.camera.right * sx + self.camera.up * sy;
                longest = longest.max((rotation * ray).length());
            }
        }
        let sheet = self.sheet_step * longest;
        let radius = self.radius * self.growths[1];
        // What gradients reach sideways, at the far end of the volume.
        let depth = if self.is_perspective() { self.eye_depth + self.farthest } else { 1.0 };
        let pixel =
            scale[0] * depth * (rotation * self.camera.right).length().max((rotation * self.camera.up).length());
        let sideways = f64::from(self.margin) * pixel;
        // A sheet is classified by its mean and those of its neighbours, any of which may lie beyond the faces; two
        // voxels may take part at opposite ends of that. In steps, so that rounding asks for no other splats when the
        // camera turns.
        let influence = 2.0 * radius + 3.0 * sheet + sideways;
        Reach {
            padding: ((radius + 2.0 * sheet) * (1.0 - 1e-9)).ceil() as u32,
            influence: (16.0 * influence + 1e-3).ceil() / 16.0,
        }
    }

    /// View depth of the first plane of a sheet.
    pub(crate) fn sheet_depth(&self, sheet: u32) -> f64 {
        self.sheet_origin + f64::from(sheet) * self.sheet_step
    }

    /// Material and lights in this view.
    pub(crate) fn lighting(&self, lighting: &Lighting) -> super::super::layout::Lighting {
        let camera = &self.camera;
        let f3 = |v: DVec3| v.as_vec3().to_array();
        let mut lights = [[0.0; 4]; Lighting::MAX_LIGHTS];
        for (slot, light) in lights.iter_mut().zip(&lighting.lights) {
            if let Light::Directional(towards) = light {
                let d = towards.normalize();
                *slot = [d.dot(camera.right), d.dot(camera.up), d.dot(camera.forward), 0.0].map(|c| c as f32);
            }
        }
        super::super::layout::Lighting {
            right: f3(camera.right),
            ambient: lighting.ambient as f32,
            up: f3(camera.up),
            diffuse: lighting.diffuse as f32,
            forward: f3(camera.forward),
            specular: lighting.specular as f32,
            lights,
            shininess: lighting.shininess as f32,
            _pad: [0; 3],
        }
    }

    /// The largest growth of a kernel in the volume.
    pub(crate) fn max_growth(&self) -> f64 {
        self.growths[1]
    }

    pub(crate) fn is_grown(&self) -> bool {
        self.growths[1] > 1.0 || !self.savings.specialization
    }

    pub(crate) fn is_axis_aligned(&self) -> bool {
        self.axis.is_some()
    }

    pub(crate) fn is_post_shaded(&self) -> bool {
        self.post_shaded
    }

    /// Whether opaque pixels end anything.
    pub(crate) fn terminates(&self) -> bool {
        self.opaque_depth.is_finite()
    }

    /// Whether kernels can reach the eye.
    pub(crate) fn is_among_voxels(&self) -> bool {
        let Projection::Perspective { distance, .. } = self.camera.projection else { return false };
        let eye = self.camera.target - self.camera.forward * distance;
        let from_center = self.grid.to_lattice().transform_vector3(eye - self.grid.center());
        let half = DVec3::from_array(self.grid.dims().map(|d| f64::from(d - 1) / 2.0));
        from_center.abs().cmple(half + self.radius * self.growths[1]).all()
    }

    /// Layers of the lattice beyond the faces of the volume.
    pub(crate) fn padding(&self) -> u32 {
        self.padding
    }

    pub(crate) fn margin(&self) -> u32 {
        self.margin
    }

    /// The parameters of the batch that begins with sheet `first`.
    pub(crate) fn batch(&self, first: u32) -> Batch {
        let from = if self.axis.is_some() { 0 } else { first };
        Batch { depth: self.sheet_depth(from) as f32, first_sheet: first }
    }

    /// Side of a tile of early splat termination in pixels: about half of what a splat in the middle of the volume spans.
    fn tile_size(&self) -> u32 {
        let depth = if self.is_perspective() { self.eye_depth.max(self.sheet_step) } else { 1.0 };
        let world = self.radius * self.growth.at(self.eye_depth) * self.view[0].length().max(self.view[1].length());
        let half = world / (self.pixels().0[0] * depth);
        (half / 2.0).log2().floor().exp2().clamp(4.0, 64.0) as u32
    }

    /// Tiles across and down a region with its margin.
    pub(crate) fn tiles(&self, region: Region) -> [u32; 2] {
        [region.width, region.height].map(|side| (side + 2 * self.margin).div_ceil(self.tile_size()))
    }

    pub(crate) fn is_perspective(&self) -> bool {
        matches!(self.camera.projection, Projection::Perspective { .. })
    }

    pub(crate) fn sheets(&self) -> u32 {
        self.sheets
    }

    /// World thickness of a sheet.
    pub(crate) fn sheet_step(&self) -> f64 {
        self.sheet_step
    }

    /// The most batches of `sheets` that one kernel can reach into.
    pub(crate) fn batches_per_splat(&self, sheets: u32) -> u64 {
        let extent = 2.0 * self.radius * self.growths[1] * self.view[2].length() / self.sheet_step;
        // One more than fits exactly, and one for rounding at the planes.
        (extent / f64::from(sheets)).ceil() as u64 + 2
    }

    /// Plane coordinates per pixel across and down, and those of the top left corner of the image.
    pub(super) fn pixels(&self) -> ([f64; 2], [f64; 2]) {
        let [w, h] = self.size.map(f64::from);
        let half = match self.camera.projection {
            Projection::Orthographic { half_height } => half_height,
            Projection::Perspective { tan_half_fov, .. } => tan_half_fov,
        };
        let scale = 2.0 * half / h;
        ([scale, -scale], [-half * w / h, half])
    }

    /// The smallest rectangle of pixels that holds every point the volume's kernels project to; `None`: none does.
    pub(crate) fn reach(&self) -> Option<Region> {
        let [w, h] = self.size;
        let whole = Region { x: 0, y: 0, width: w, height: h };
        let (scale, origin) = self.pixels();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let beyond = if self.post_shaded { 0.5 } else { self.radius * self.growths[1] };
        for corner in self.grid.corners(beyond) {
            let d = corner - self.camera.target;
            let mut plane = [d.dot(self.camera.right), d.dot(self.camera.up)];
            if let Projection::Perspective { distance, .. } = self.camera.projection {
                let z = d.dot(self.camera.forward) + distance;
                if z <= 1e-6 * distance {
                    return Some(whole);
                }
                plane = plane.map(|p| p / z);
            }
            for axis in 0..2 {
                let pixel = (plane[axis] - origin[axis]) / scale[axis];
                low[axis] = low[axis].min(pixel);
                high[axis] = high[axis].max(pixel);
            }
        }
        let clamped = |v: f64, most: u32| v.clamp(0.0, f64::from(most)) as u32;
        let (x, y) = (clamped((low[0] - 1.0).floor(), w), clamped((low[1] - 1.0).floor(), h));
        let (right, bottom) = (clamped((high[0] + 1.0).ceil(), w), clamped((high[1] + 1.0).ceil(), h));
        (right > x && bottom > y).then(|| Region { x, y, width: right - x, height: bottom - y })
    }

    /// The uniforms of a frame that renders `region`.
    pub(crate) fn frame(&self, region: Region) -> Frame {
        let to_lattice = self.grid.to_lattice().matrix3;
        let f3 = |v: DVec3| v.as_vec3().to_array();
        let f2 = |v: [f64; 2]| v.map(|c| c as f32);
        let (scale, origin) = self.pixels();
        let margin = f64::from(self.margin);
        let [width, height] = [region.width, region.height].map(|side| side + 2 * self.margin);
        // Pixels of the region to clip coordinates: x right, y up, both in -1..1.
        let corner = [
            origin[0] + (f64::from(region.x) - margin) * scale[0],
            origin[1] + (f64::from(region.y) - margin) * scale[1],
        ];
        let span = [f64::from(width) * scale[0], f64::from(height) * scale[1]];
        let (plane_axis, plane_offset) = self.axis.map_or((DVec3::ZERO, 0.0), |axis| {
            // Numbered front to back.
            let unit = DVec3::AXES[axis];
            if to_lattice.mul_vec3(self.camera.forward)[axis] >= 0.0 {
                (unit, 0.0)
            } else {
                (-unit, f64::from(self.grid.dims()[axis] - 1))
            }
        });
        let clip = DVec4::new(
            2.0 / span[0],
            -2.0 / span[1],
            -1.0 - 2.0 * corner[0] / span[0],
            1.0 + 2.0 * corner[1] / span[1],
        );
        Frame {
            lattice_center: self.grid.dims().map(|d| (d - 1) as f32 / 2.0 + self.padding as f32),
            radius: self.radius as f32,
            view_x: f3(self.view[0]),
            offset_x: self.offset.x as f32,
            view_y: f3(self.view[1]),
            offset_y: self.offset.y as f32,
            view_z: f3(self.view[2]),
            eye_depth: self.eye_depth as f32,
            grid_right: f3(to_lattice * self.camera.right),
            depth_extent: (self.radius * self.view[2].length()) as f32,
            grid_up: f3(to_lattice * self.camera.up),
            sheet_origin: self.sheet_origin as f32,
            grid_forward: f3(to_lattice * self.camera.forward),
            sheet_step: self.sheet_step as f32,
            pixel_scale: f2(scale),
            pixel_offset: f2(corner),
            clip_scale: [clip.x as f32, clip.y as f32],
            clip_offset: [clip.z as f32, clip.w as f32],
            // Corners snap to 1/256 pixel; 1/64 covers that and the rounding before it.
            quad_pad: [(scale[0].abs() / 64.0) as f32, (scale[1].abs() / 64.0) as f32],
            section_scale: self.section_scale as f32,
            inverse_sheet_scale: (1.0 / self.sheet_scale) as f32,
            region: [width, height],
            sheets: self.sheets,
            inverse_sheet_step: (1.0 / self.sheet_step) as f32,
            plane_axis: f3(plane_axis),
            plane_offset: plane_offset as f32,
            box_half: self.grid.dims().map(|d| d as f32 / 2.0),
            opaque_depth: self.opaque_depth as f32,
            growth: [(self.growth.constant + self.growth.slope * self.eye_depth) as f32, self.growth.slope as f32],
            tiles: self.tiles(region)[0],
            tile_size: self.tile_size(),
        }
    }
}
