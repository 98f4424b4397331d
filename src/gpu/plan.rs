//! From a camera to the numbers that the stages of a frame work with.

use glam::{DVec3, DVec4};

use super::layout::Frame;
use crate::camera::{Camera, Projection};
use crate::settings::Settings;
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

/// The geometry of one picture, in f64: sheets, projection, and the part of the image that the volume can reach.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    camera: Camera,
    size: [u32; 2],
    grid: Grid,
    radius: f64,
    /// Gradients in the lattice of the view coordinates x, y and z.
    view: [DVec3; 3],
    /// View coordinates of the middle of the lattice, from the target.
    offset: DVec3,
    /// Depth of the middle of the lattice in front of the eye (perspective).
    eye_depth: f64,
    /// View depth, from the middle of the lattice, at which the first sheet begins.
    sheet_origin: f64,
    sheet_step: f64,
    sheets: u32,
    section_scale: f64,
    sheet_scale: f64,
}

/// The optical depth of a sheet is scaled so that a sheet filled with the densest material accumulates about this:
/// an f16 sheet then resolves contributions 2e6 times smaller before they turn subnormal, and holds 250 times more
/// (oblique perspective rays, `Normalization::Peak`) before it overflows, whatever the units of the scene.
const SHEET_FULL: f64 = 256.0;

impl Plan {
    /// `max_density`: the largest extinction times unit distance that the transfer function gives.
    /// `unit`: that distance, in world units.
    pub(crate) fn new(camera: &Camera, grid: &Grid, settings: &Settings, max_density: f64, unit: f64) -> Self {
        let to_world = grid.to_world().matrix3;
        let view = [camera.right, camera.up, camera.forward].map(|axis| to_world.transpose() * axis);
        let from_target = grid.center() - camera.target;
        let offset =
            DVec3::new(from_target.dot(camera.right), from_target.dot(camera.up), from_target.dot(camera.forward));
        let radius = settings.kernel.radius();
        let extent = radius * view[2].length();
        let half = DVec3::from_array(grid.dims().map(|d| f64::from(d - 1) / 2.0));
        let reach = view[2].abs().dot(half) + extent;
        let eye_depth = match camera.projection {
            Projection::Orthographic { .. } => 0.0,
            Projection::Perspective { distance, .. } => distance + offset.z,
        };
        let sheet_origin = match camera.projection {
            Projection::Orthographic { .. } => -reach,
            // Rays start at the eye, and with them the first sheet.
            Projection::Perspective { .. } => (-reach).max(-eye_depth),
        };
        // One voxel of thickness is the world length in which the central ray advances by one lattice unit.
        let grid_forward = grid.to_lattice().matrix3 * camera.forward;
        let sheet_step = settings.sheet_thickness / grid_forward.length();
        let sheets = ((reach - sheet_origin) / sheet_step).ceil().clamp(0.0, f64::from(u32::MAX / 2)) as u32;
        let divisor = settings.normalization.divisor(&settings.kernel);
        let full = max_density / unit * sheet_step * settings.kernel.integral() / divisor;
        let sheet_scale = if full > 0.0 { (SHEET_FULL / full).log2().floor().exp2() } else { 1.0 };
        Self {
            camera: *camera,
            size: settings.size,
            grid: *grid,
            radius,
            view,
            offset,
            eye_depth,
            sheet_origin,
            sheet_step,
            sheets,
            section_scale: sheet_scale / (divisor * unit),
            sheet_scale,
        }
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

    /// View depth of the first plane of a sheet.
    pub(crate) fn sheet_depth(&self, sheet: u32) -> f64 {
        self.sheet_origin + f64::from(sheet) * self.sheet_step
    }

    /// The most batches of `sheets` that one kernel can reach into.
    pub(crate) fn batches_per_splat(&self, sheets: u32) -> u64 {
        let extent = 2.0 * self.radius * self.view[2].length() / self.sheet_step;
        // One more than fits exactly, and one for rounding at the planes.
        (extent / f64::from(sheets)).ceil() as u64 + 2
    }

    /// Plane coordinates per pixel across and down, and those of the top left corner of the image.
    fn pixels(&self) -> ([f64; 2], [f64; 2]) {
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
        for corner in self.grid.corners(self.radius) {
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
        // Pixels of the region to clip coordinates: x right, y up, both in -1..1.
        let corner = [origin[0] + f64::from(region.x) * scale[0], origin[1] + f64::from(region.y) * scale[1]];
        let span = [f64::from(region.width) * scale[0], f64::from(region.height) * scale[1]];
        let clip = DVec4::new(
            2.0 / span[0],
            -2.0 / span[1],
            -1.0 - 2.0 * corner[0] / span[0],
            1.0 + 2.0 * corner[1] / span[1],
        );
        Frame {
            lattice_center: self.grid.dims().map(|d| (d - 1) as f32 / 2.0),
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
            region: [region.width, region.height],
            sheets: self.sheets,
            inverse_sheet_step: (1.0 / self.sheet_step) as f32,
        }
    }
}
