//! The sheets of one picture, and the uniforms of its frames.

use glam::{DMat3, DVec2, DVec3};

use super::frustum::visible_depths;
use crate::camera::clip::Side;
use crate::camera::{Camera, Projection};
use crate::gpu::layout::{Batch, Frame, clip_planes};
use crate::gpu::view::{Held, ViewGeometry, Weights, half};
use crate::image::Region;
use crate::kernel::Kernel;
use crate::prepare::levels::{Cut, ScalarNeed};
use crate::settings::{Level, Model, Precision, Settings, Sheets};

/// A region of a picture and the uniforms to render it with, on the device.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Target<'a> {
    pub(crate) plan: &'a Plan<'a>,
    pub(crate) region: Region,
    /// The uniforms of the region, [`Plan::frame`].
    pub(crate) frame: &'a wgpu::Buffer,
}

impl Target<'_> {
    /// Returns the width and the height of the buffers that the region is rendered in.
    pub(crate) fn extent(&self) -> [u32; 2] {
        [self.region.width, self.region.height]
    }
}

/// The sheets of one picture, in f64. Depths are measured along the view from the middle of the lattice, so that a
/// distant eye cancels nothing.
#[derive(Debug, Clone)]
pub(crate) struct Plan<'a> {
    pub(super) view: &'a ViewGeometry,
    /// The lattice axis of axis-aligned sheets.
    pub(crate) axis: Option<usize>,
    /// The number of layers of the lattice beyond the faces of the volume.
    pub(super) padding: u32,
    /// The view depth at which the first sheet begins.
    pub(super) sheet_origin: f64,
    /// The thickness of a sheet, in world units.
    pub(super) sheet_step: f64,
    pub(super) sheets: u32,
    section_scale: f64,
    sheet_scale: f64,
    kernel: Kernel,
    /// The model in the form of shaders/common/frame.wgsl.
    model: [f32; 4],
    /// Whether cells may stand for voxels of scalars.
    takes_cells: bool,
}

/// The approximate value of a sheet filled with the densest material: sheets are scaled to it. An f16 sheet then
/// resolves contributions 2e6 times smaller before they turn subnormal, and holds 250 times more (oblique perspective
/// rays, `Normalization::Peak`) before it overflows, whatever the units of the scene.
const SHEET_FULL: f64 = 256.0;

/// The number of sheets from which on the sheets beyond the picture are left out: the kernels of stretched lattices may
/// reach far beyond it, before and behind.
const MANY_SHEETS: u32 = 4096;

/// The number of pixels by which a quad is grown on every side. Rasterisers snap corners to 1/16 pixel at the coarsest
/// (Vulkan's least `subPixelPrecisionBits` is 4), so by up to 1/32; the rest covers the rounding before it.
const QUAD_PAD: f64 = 3.0 / 64.0;

/// The largest thickness of a sheet of half floats, in voxels. Kernels beyond it would be lost beside the sum: a voxel
/// of path adds 12.6 kernels, and of the 810 of 64 voxels rounding to the nearest loses 0.3 %, cutting off 12 %.
const F16_THICKNESS: f64 = 4.0;

/// The largest ratio of an oblique ray's length in a sheet to the central ray's before sheets become thinner:
/// pre-shaded and post-shaded. Classification magnifies differences within a sheet.
const MAX_STRETCH: [f64; 2] = [2.0, 1.25];

/// The radius in voxels of kernels that a sheet of scalars a voxel thick resolves. Narrower ones take thinner sheets.
const RESOLVED_RADIUS: f64 = 2.0;

/// The largest number of sheets that a kernel may reach where sheets become thinner for oblique rays: in a field of
/// view of 170 degrees the farthest kernels have grown 12 times as much as the nearest, which decide the thickness, and
/// would reach 600.
const MOST_REACHED: f64 = 128.0;

/// Returns the thickness of the sheets of a picture in voxels, in its middle and before kernels grow: the requested
/// one, unless the picture would suffer. The one sheet of an X-ray in f32 is infinite. `growths` belong to the nearest
/// and the farthest kernel.
fn thickness(camera: &Camera, growths: [f64; 2], settings: &Settings, precision: Precision) -> f64 {
    let post = settings.is_post_shaded();
    let thickness = match settings.model {
        Model::Xray => f64::INFINITY,
        _ => {
            let stretch = largest_stretch(camera) / MAX_STRETCH[usize::from(post)];
            let resolved = if post { (settings.kernel.radius() / RESOLVED_RADIUS).min(1.0) } else { 1.0 };
            // Fields that pass through their samples bend more than blurred ones.
            let resolved = if post { resolved * (1.0 - settings.sharpness / 2.0) } else { resolved };
            let thickness = settings.quads().sheet_thickness * resolved;
            let reached = 2.0 * settings.kernel.radius() * growths[1] / (growths[0] * thickness);
            thickness / stretch.min(MOST_REACHED / reached).max(1.0)
        }
    };
    match precision {
        Precision::F16 => thickness.min(F16_THICKNESS),
        Precision::F32 => thickness,
    }
}

/// Returns the length of the longest ray of the picture per unit of view depth.
fn largest_stretch(camera: &Camera) -> f64 {
    match camera.projection {
        Projection::Orthographic { .. } => 1.0,
        Projection::Perspective { .. } => {
            let [x, y] = camera.pixels().1;
            (1.0 + x * x + y * y).sqrt()
        }
    }
}

/// Returns the image-aligned sheets across a volume: the view depth at which the first begins, their thickness and
/// their number.
fn image_aligned(view: &ViewGeometry, settings: &Settings, precision: Precision) -> (f64, f64, u32) {
    let depth_per_voxel = view.gradients[2];
    let reach = if view.post_shaded {
        depth_per_voxel.abs().dot(view.faces)
    } else {
        view.farthest + view.max_radius() * depth_per_voxel.length()
    };
    let grid_forward = view.grid.to_lattice().matrix3 * view.camera.forward;
    // One voxel of thickness is the world length in which the central ray advances by one lattice unit. Kernels that
    // have grown resolve less in proportion.
    let voxel = view.growths[0] / grid_forward.length();
    let step = thickness(&view.camera, view.growths, settings, precision) * voxel;
    // Shading reads a sheet before the first and one after the last.
    let beside = if view.post_shaded { step } else { 0.0 };
    let mut origin = -reach - beside;
    if view.is_perspective() {
        // Rays start at the eye, and with them the first sheet.
        origin = origin.max(-view.eye_depth);
    }
    let whole = if reach > origin { reach + beside - origin } else { 0.0 };
    let step = if step.is_finite() { step } else { whole.max(voxel) };
    let count = (whole / step).ceil().clamp(0.0, f64::from(u32::MAX / 2)) as u32;
    let Some(range) = (count > MANY_SHEETS).then(|| visible_depths(view)).flatten() else {
        return (origin, step, count);
    };
    let [first, last] = range.map(|depth| ((depth - origin) / step).floor().max(0.0));
    // Shading reads one more on either side, and one absorbs rounding.
    let first = (first - 2.0).max(0.0);
    let count = (f64::from(count) - first).min(last + 3.0 - first).max(0.0) as u32;
    (origin + first * step, step, count)
}

/// Returns the reach of sheets and of voxels beyond cuts; see [`Room::reach`](crate::painters::painter::Room::reach).
pub(super) fn reach(view: &ViewGeometry, settings: &Settings) -> [f64; 2] {
    // The one sheet of an X-ray is cut where bricks are.
    let sheet = match settings.model {
        Model::Xray => 0.0,
        _ => image_aligned(view, settings, Precision::F32).1 * longest_ray(view),
    };
    // Scalars are classified by the sheets before and behind, and from the end of the sheet before. They are there if
    // they may take part where a visible voxel does, so visible voxels matter farther on.
    let around = if view.post_shaded { 2.0 * sheet + influence(view, sheet) } else { 0.0 };
    [0.5 * sheet, 0.5 * sheet + around + view.max_radius()]
}

/// Returns [`ScalarNeed::influence`]: two voxels may take part at opposite ends of three sheets of this length.
fn influence(view: &ViewGeometry, sheet: f64) -> f64 {
    2.0 * view.max_radius() + 3.0 * sheet
}

/// Returns the longest lattice length of a ray of the picture per unit of view depth.
fn longest_ray(view: &ViewGeometry) -> f64 {
    let (scale, origin) = view.camera.pixels();
    let rotation = view.grid.to_lattice().matrix3;
    let [w, h] = view.camera.size.map(f64::from);
    let mut longest = (rotation * view.camera.forward).length();
    if view.is_perspective() {
        for (x, y) in [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)] {
            let (sx, sy) = (origin[0] + x * scale[0], origin[1] + y * scale[1]);
            let ray = view.camera.forward + view.camera.right * sx + view.camera.up * sy;
            longest = longest.max((rotation * ray).length());
        }
    }
    longest
}

/// Returns the lattice axis of axis-aligned sheets: the normal of its voxel planes, the gradient of its lattice
/// coordinate, is nearest to the view direction.
fn sheet_axis(view: &ViewGeometry) -> usize {
    let to_lattice = view.grid.to_lattice().matrix3;
    let rows = to_lattice.transpose();
    let grid_forward = to_lattice * view.camera.forward;
    let cosine = |axis: &usize| (grid_forward[*axis] / rows.col(*axis).length()).abs();
    (0..3).max_by(|a, b| cosine(a).total_cmp(&cosine(b))).unwrap_or(0)
}

impl<'a> Plan<'a> {
    pub(crate) fn new(view: &'a ViewGeometry, settings: &Settings, weights: Weights, precision: Precision) -> Self {
        let (sheet_origin, sheet_step, mut sheets) = image_aligned(view, settings, precision);
        let axis = (settings.quads().sheets == Sheets::Axis).then(|| sheet_axis(view));
        if let Some(axis) = axis
            && sheets > 0
        {
            sheets = view.grid.dims()[axis];
        }
        let divisor = settings.normalization.divisor(&settings.kernel);
        // A sheet of scalars holds their mean.
        let length = if view.post_shaded { 1.0 } else { sheet_step };
        let full = weights.max / weights.unit * length * settings.kernel.integral() / divisor;
        let sheet_scale = if full > 0.0 { libm::exp2(libm::log2(SHEET_FULL / full).floor()) } else { 1.0 };
        let mut plan = Self {
            view,
            axis,
            padding: 0,
            sheet_origin,
            sheet_step,
            sheets,
            section_scale: sheet_scale / (divisor * weights.unit),
            sheet_scale,
            kernel: settings.kernel,
            model: if settings.depth_coded || settings.attenuation > 0.0 {
                let slope = 0.5 / view.gradients[2].abs().dot(view.faces);
                [slope as f32, 0.5, settings.attenuation as f32, 0.0]
            } else {
                settings.xray_response().1
            },
            takes_cells: settings.level == Level::Auto,
        };
        plan.padding = plan.scalar_need().padding;
        plan
    }

    /// Returns how far splats of scalars must reach in this picture: not at all if voxels are classified.
    pub(crate) fn scalar_need(&self) -> ScalarNeed {
        let view = self.view;
        if !view.post_shaded {
            return ScalarNeed::NONE;
        }
        // The longest lattice length of a sheet along any ray.
        let sheet = self.sheet_step * longest_ray(view);
        // A sheet is classified by its mean and the means of its neighbours, any of which may lie beyond the faces.
        let radius = view.max_radius();
        let need = ScalarNeed::new(view, radius + 2.0 * sheet, influence(view, sheet));
        match Cut::new(view, &self.kernel, 2.0 * sheet).filter(|_| self.takes_cells) {
            Some(cut) => need.with_cells(cut),
            None => need,
        }
    }

    /// Returns the view depth of the first plane of a sheet.
    pub(crate) fn sheet_depth(&self, sheet: u32) -> f64 {
        self.sheet_origin + f64::from(sheet) * self.sheet_step
    }

    /// Returns the parameters of the batch that begins with sheet `first`.
    pub(crate) fn batch(&self, first: u32) -> Batch {
        let from = if self.axis.is_some() { 0 } else { first };
        Batch { depth: self.sheet_depth(from) as f32, first_sheet: first }
    }

    /// Returns the side of a tile of early splat termination in pixels, a power of two from 4 on: about half the span
    /// of a splat in the middle of the volume.
    fn tile_size(&self) -> u32 {
        let view = self.view;
        let depth = if view.is_perspective() { view.eye_depth.max(self.sheet_step) } else { 1.0 };
        let across = view.gradients[0].length().max(view.gradients[1].length());
        let half = view.radius * view.growth.at(view.eye_depth) * across / (view.camera.pixels().0[0] * depth);
        libm::exp2(libm::log2(half / 2.0).floor()).clamp(4.0, f64::from(Camera::MAX_SIZE)) as u32
    }

    /// Returns the numbers of tiles across and down a region.
    pub(crate) fn tiles(&self, region: Region) -> [u32; 2] {
        [region.width, region.height].map(|side| side.div_ceil(self.tile_size()))
    }

    /// Returns the largest number of batches of `sheets` sheets that one kernel can reach into.
    pub(crate) fn batches_per_splat(&self, sheets: u32) -> u64 {
        let extent = 2.0 * self.view.max_radius() * self.view.gradients[2].length() / self.sheet_step;
        // One more than fits exactly, and one for rounding at the planes.
        (extent / f64::from(sheets)).ceil() as u64 + 2
    }

    /// Returns the home ray in plane coordinates: of the rays of the picture, the one nearest to the middle of the
    /// lattice.
    fn home(&self) -> DVec2 {
        let view = self.view;
        let (scale, origin) = view.camera.pixels();
        let middle = match view.is_perspective() {
            false => view.offset.truncate(),
            true if view.eye_depth > 0.0 => view.offset.truncate() / view.eye_depth,
            true => DVec2::ZERO,
        };
        let corner = DVec2::from_array(origin);
        let opposite = corner + DVec2::from_array(scale) * DVec2::from_array(view.camera.size.map(f64::from));
        middle.clamp(corner.min(opposite), corner.max(opposite))
    }

    /// Returns the uniforms of a frame that renders `region`.
    pub(crate) fn frame(&self, region: Region) -> Frame {
        let view = self.view;
        let home = self.home();
        let (home_slope, home_offset) =
            if view.is_perspective() { (home, home * view.eye_depth) } else { (DVec2::ZERO, home) };
        let offset = view.offset.truncate() - home_offset;
        let along_home = view.camera.forward + view.camera.right * home_slope.x + view.camera.up * home_slope.y;
        let to_lattice = view.grid.to_lattice().matrix3;
        let f3 = |v: DVec3| v.as_vec3().to_array();
        let f2 = |v: [f64; 2]| v.map(|c| c as f32);
        let (scale, origin) = view.camera.pixels();
        let [width, height] = [region.width, region.height];
        // Pixels of the region to clip coordinates: x right, y up, both in -1..1.
        let corner =
            [origin[0] + f64::from(region.x) * scale[0] - home.x, origin[1] + f64::from(region.y) * scale[1] - home.y];
        let span = [f64::from(width) * scale[0], f64::from(height) * scale[1]];
        let (plane_axis, plane_offset) = self.axis.map_or((DVec3::ZERO, 0.0), |axis| {
            // Numbered front to back.
            let unit = DVec3::AXES[axis];
            if to_lattice.mul_vec3(view.camera.forward)[axis] >= 0.0 {
                (unit, 0.0)
            } else {
                (-unit, f64::from(view.grid.dims()[axis] - 1))
            }
        });
        // The lattice around its middle, of view coordinates from the home ray.
        let map = to_lattice * DMat3::from_cols(view.camera.right, view.camera.up, along_home);
        let plane = |(gradient, value): &Side| {
            let slopes = map.transpose() * *gradient;
            slopes.extend(value - slopes.truncate().dot(offset))
        };
        let open = Held::OPEN;
        let owned = view.held.map_or([-DVec3::splat(open), DVec3::splat(open)], |held| {
            held.owned.map(|place| (place - half(&view.grid)).clamp(DVec3::splat(-open), DVec3::splat(open)))
        });
        Frame {
            lattice_center: f3(half(&view.grid) - view.first() + f64::from(self.padding)),
            radius: view.radius as f32,
            view_x: f3(view.gradients[0] - view.gradients[2] * home_slope.x),
            offset_x: offset.x as f32,
            view_y: f3(view.gradients[1] - view.gradients[2] * home_slope.y),
            offset_y: offset.y as f32,
            view_z: f3(view.gradients[2]),
            eye_depth: view.eye_depth as f32,
            grid_right: f3(to_lattice * view.camera.right),
            depth_extent: (view.radius * view.gradients[2].length()) as f32,
            grid_up: f3(to_lattice * view.camera.up),
            sheet_origin: self.sheet_origin as f32,
            grid_forward: f3(to_lattice * along_home),
            sheet_step: self.sheet_step as f32,
            pixel_scale: f2(scale),
            pixel_offset: f2(corner),
            clip_scale: f2([2.0 / span[0], -2.0 / span[1]]),
            clip_offset: f2([-1.0 - 2.0 * corner[0] / span[0], 1.0 + 2.0 * corner[1] / span[1]]),
            quad_pad: scale.map(|pixel| (QUAD_PAD * pixel.abs()) as f32),
            section_scale: self.section_scale as f32,
            inverse_sheet_scale: (1.0 / self.sheet_scale) as f32,
            region: [width, height],
            sheets: self.sheets,
            inverse_sheet_step: (1.0 / self.sheet_step) as f32,
            plane_axis: f3(plane_axis),
            plane_offset: plane_offset as f32,
            box_half: f3(view.faces),
            opaque_depth: view.opaque_depth.min(f64::from(f32::MAX)) as f32,
            growth: [(view.growth.constant + view.growth.slope * view.eye_depth) as f32, view.growth.slope as f32],
            home_slope: f2(home_slope.to_array()),
            tiles: self.tiles(region)[0],
            tile_size: self.tile_size(),
            solid_depth: view.depth_of_z().map(|c| c as f32),
            model: self.model,
            owned_low: f3(owned[0]),
            _pad_low: 0,
            owned_high: f3(owned[1]),
            _pad_high: 0,
            picture_offset: f2([origin[0] - home.x, origin[1] - home.y]),
            picture_corner: [region.x, region.y],
            clip_planes: clip_planes(view.clip.iter().map(plane)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{ProjectionKind, View};
    use crate::gpu::savings::Savings;
    use crate::kernel::Kernel;
    use crate::settings::{Painter, QuadsSettings, Shading};
    use crate::volume::Grid;

    fn camera(projection: ProjectionKind, grid: &Grid) -> Camera {
        Camera::new(&View { projection, azimuth: 33.0, elevation: 20.0, ..View::default() }, grid, [40, 30]).unwrap()
    }

    const REGION: Region = Region { x: 3, y: 5, width: 24, height: 20 };

    /// Returns the frame of a lattice in some unit and around some origin.
    fn frame(projection: ProjectionKind, unit: f64, origin: f64) -> Frame {
        let matrix = DMat3::from_diagonal(DVec3::new(1.1, 0.9, 2.3)) * unit;
        let to_world = glam::DAffine3::from_mat3_translation(matrix, DVec3::splat(origin));
        let grid = Grid::new([17, 24, 9], to_world).unwrap();
        let settings = Settings::default();
        let view = ViewGeometry::new(&camera(projection, &grid), &grid, &settings, Savings::default());
        let weights = Weights { max: 2.0, unit: 0.9, brightest: [1.0; 3] };
        Plan::new(&view, &settings, weights, Precision::F32).frame(REGION)
    }

    #[test]
    fn neither_unit_nor_origin_reaches_the_uniforms() {
        for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 50.0 }] {
            let expected = frame(projection, 1.0, 0.0);
            for exponent in [-300, -100, -30, -1, 1, 30, 100, 300] {
                let unit = 2_f64.powi(exponent);
                assert_eq!(frame(projection, unit, 0.0), expected, "unit 2^{exponent}");
                assert_eq!(frame(projection, unit, 1e12 * unit), expected, "unit 2^{exponent}, far from its origin");
            }
        }
    }

    #[test]
    fn quads_are_padded_beyond_the_coarsest_rasteriser() {
        let frame = frame(ProjectionKind::Orthographic, 1.0, 0.0);
        for (pad, pixel) in frame.quad_pad.into_iter().zip(frame.pixel_scale) {
            assert!(pad / pixel.abs() > 1.4 / 32.0, "{pad}");
        }
    }

    #[test]
    fn sheets_are_as_thin_as_the_picture_needs() {
        let grid = Grid::axis_parallel([400; 3], [1.0; 3]).unwrap();
        let thickness_at = |fov, precision, settings: Settings| {
            let view = View { projection: ProjectionKind::Perspective { fov }, ..View::default() };
            thickness(&Camera::new(&view, &grid, [64; 2]).unwrap(), [1.0, 1.0], &settings, precision)
        };
        let quads = |sheet_thickness| Settings {
            painter: Painter::Quads(QuadsSettings { sheet_thickness, ..QuadsSettings::default() }),
            ..Settings::default()
        };
        let post = |radius| Settings {
            shading: Shading::Post,
            kernel: Kernel::Gaussian { sigma: radius / 2.0, radius },
            ..Settings::default()
        };
        let xray = Settings { model: Model::Xray, ..Settings::default() };
        let corner = |fov: f64| (1.0 + 2.0 * (fov.to_radians() / 2.0).tan().powi(2)).sqrt();
        for (fov, precision, settings, expected) in [
            (30.0, Precision::F32, quads(1.0), 1.0),
            (100.0, Precision::F32, quads(64.0), 64.0),
            (30.0, Precision::F16, quads(64.0), 4.0),
            (170.0, Precision::F32, quads(1.0), 2.0 / corner(170.0)),
            (30.0, Precision::F32, post(2.0), 1.0),
            (30.0, Precision::F32, post(3.0), 1.0),
            (30.0, Precision::F32, post(0.5), 0.25),
            (140.0, Precision::F32, post(2.0), 1.25 / corner(140.0)),
            (30.0, Precision::F32, xray.clone(), f64::INFINITY),
            (30.0, Precision::F16, xray.clone(), 4.0),
            (170.0, Precision::F16, xray, 4.0),
        ] {
            let got = thickness_at(fov, precision, settings);
            assert!(got == expected || (got - expected).abs() < 1e-12, "{fov} {precision}: {got} {expected}");
        }
    }
}
