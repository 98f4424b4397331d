//! The geometry of a picture that every painter needs, in f64: camera, lattice, pixels, growth of kernels, light.

use glam::{DAffine3, DMat3, DVec3};

use super::layout;
use super::savings::Savings;
use super::splat::{SplatLight, ToEye};
use crate::camera::clip::{Side, corners};
use crate::camera::{Camera, Growth};
use crate::image::Region;
use crate::lighting::{Lighting, Source};
use crate::settings::{Model, Settings};
use crate::volume::Grid;

/// The weights of the splats of a scene.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights {
    /// The largest weight of a splat: extinction times unit distance, or the distance of a scalar from the base.
    pub(crate) max: f64,
    /// The local distance (see [`Grid::local`]) that weights are per; 1 for scalars.
    pub(crate) unit: f64,
    /// The largest of each channel of the splats' colours; 1 for scalars.
    pub(crate) brightest: [f64; 3],
}

/// The limit of the distance of a point light, in half diagonals of the lattice: there it errs by 1e-6.
const FARTHEST_LIGHT: f64 = 1e6;

/// The share of a layer in a picture of several, by the growth of the layer's kernels at a depth: the share begins, is
/// whole, fades, and ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fade {
    /// The growths at which the share begins and is whole.
    pub(crate) begins: [f64; 2],
    /// The growths at which the share begins to fade and ends.
    pub(crate) ends: [f64; 2],
}

impl Fade {
    /// The growths of anything nearer than the layers, and [`Self::FARTHEST`] of anything farther; not infinite.
    pub(crate) const NEAREST: [f64; 2] = [-2e8, -1e8];
    pub(crate) const FARTHEST: [f64; 2] = [1e8, 2e8];
}

/// The voxels of a lattice that a scene holds, and the part of the lattice that its partial pictures show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Held {
    /// The first held voxel.
    pub(crate) first: [u32; 3],
    /// The number of held voxels along each axis.
    pub(crate) dims: [u32; 3],
    /// The least and the largest place that the part owns, in numbers of voxels; [`Self::OPEN`] beyond a face of the
    /// lattice.
    pub(crate) owned: [DVec3; 2],
    /// The family of rays to draw: see `Room::families` of the painters.
    pub(crate) family: usize,
    /// The reach of the part's sheets and slabs beyond `owned`, in voxels.
    pub(crate) beyond: f64,
}

impl Held {
    /// A place beyond every voxel, whose quotients stay in the range of f32.
    pub(crate) const OPEN: f64 = 1e9;

    /// Converts the held part to a lattice of cells, each of `size` voxels along an edge. The first voxel and the cuts
    /// lie between cells. `dims` are the numbers of held cells, `faces` the number of cells before the first voxel.
    pub(crate) fn of_cells(self, size: f64, dims: [u32; 3], faces: f64) -> Self {
        let cell = |place: f64| if place.abs() < Self::OPEN { (place + 0.5) / size - 0.5 + faces } else { place };
        Self {
            first: self.first.map(|voxel| (f64::from(voxel) / size) as u32),
            dims,
            owned: self.owned.map(|places| DVec3::from_array(places.to_array().map(cell))),
            beyond: self.beyond / size,
            ..self
        }
    }
}

/// A camera on a lattice, in local coordinates: see [`Grid::local`]. World means local here.
#[derive(Debug, Clone)]
pub(crate) struct ViewGeometry {
    /// The world length of a local unit.
    pub(crate) unit: f64,
    /// The middle of the lattice in the world.
    center: DVec3,
    pub(crate) camera: Camera,
    pub(crate) grid: Grid,
    /// The radius of the kernel without growth, in voxels.
    pub(crate) radius: f64,
    pub(crate) growth: Growth,
    /// The smallest and the largest growth of a kernel in the volume, or in the layer.
    pub(crate) growths: [f64; 2],
    /// The share of the layer, if the lattice is a layer.
    pub(crate) fade: Option<Fade>,
    /// The gradients in the lattice of the view coordinates x (right), y (up) and z (forward), in world units.
    pub(crate) gradients: [DVec3; 3],
    /// The view coordinates of the middle of the lattice, from the target.
    pub(crate) offset: DVec3,
    /// The depth of the middle of the lattice in front of the eye (perspective); 0 for parallel rays.
    pub(crate) eye_depth: f64,
    /// The view depth of the farthest voxel from the middle of the lattice.
    pub(crate) farthest: f64,
    /// The distances from the middle of the lattice to the faces of the visible field, in lattice points: post-shaded
    /// half a voxel beyond the outermost voxels, pre-shaded to the ends of kernels.
    pub(crate) faces: DVec3,
    /// The sides of unclipped matter, in the lattice.
    pub(crate) clip: Vec<Side>,
    pub(crate) post_shaded: bool,
    /// The voxels of the lattice that the scene holds; `None`: all of them.
    pub(crate) held: Option<Held>,
    /// The optical depth from which on a pixel counts as opaque; infinite without termination.
    pub(crate) opaque_depth: f64,
    pub(crate) savings: Savings,
}

impl ViewGeometry {
    /// Returns the view of a camera on a grid of the world.
    pub(crate) fn new(camera: &Camera, grid: &Grid, settings: &Settings, savings: Savings) -> Self {
        Self::of_cells(camera, grid, settings, savings, 1.0, None)
    }

    /// Returns the view of a camera on a lattice of cells. The settings' kernel includes a growth of `grown`.
    pub(crate) fn of_cells(
        camera: &Camera,
        grid: &Grid,
        settings: &Settings,
        savings: Savings,
        grown: f64,
        fade: Option<Fade>,
    ) -> Self {
        let (unit, center) = (grid.unit(), grid.center());
        let clip = settings.clip.sides(grid);
        let (camera, grid) = (&camera.local(grid), &grid.local());
        let to_world = grid.to_world().matrix3;
        let gradients = [camera.right, camera.up, camera.forward].map(|axis| to_world.transpose() * axis);
        let from_target = -camera.target;
        let offset =
            DVec3::new(from_target.dot(camera.right), from_target.dot(camera.up), from_target.dot(camera.forward));
        let farthest = gradients[2].abs().dot(half(grid));
        let eye_depth = camera.projection.eye_distance().map_or(0.0, |distance| distance + offset.z);
        let growth = if settings.antialiasing { camera.growth(grid) } else { Growth::NONE };
        let growth = Growth { constant: growth.constant / grown, slope: growth.slope / grown };
        // Of the nearest voxel, or at the eye if the voxel is behind it, and of the farthest.
        let growths = [-farthest, farthest].map(|z| {
            let all = growth.at(z + eye_depth);
            fade.map_or(all, |fade| all.max(fade.begins[0]).min(fade.ends[1]).max(1.0))
        });
        let beyond = if settings.is_post_shaded() { 0.5 } else { settings.kernel.radius() * growths[1] };
        Self {
            unit,
            center,
            camera: *camera,
            grid: *grid,
            radius: settings.kernel.radius(),
            growth,
            growths,
            fade,
            gradients,
            offset,
            eye_depth,
            farthest,
            faces: half(grid) + beyond,
            clip,
            post_shaded: settings.is_post_shaded(),
            held: None,
            opaque_depth: if settings.model == Model::Composite && settings.termination > 0.0 {
                -libm::log(settings.termination)
            } else {
                f64::INFINITY
            },
            savings,
        }
    }

    /// Returns factors \[a, b\] of the depth a z + b at view depth z, in the form of shaders: from the plane of the
    /// target, in widths of a pixel there, so that all lattices of a picture share it.
    pub(crate) fn depth_of_z(&self) -> [f64; 2] {
        let pixel = self.camera.pixel_size().abs();
        [1.0 / pixel, self.offset.z / pixel]
    }

    /// Returns the view for a scene that holds a brick.
    pub(crate) fn of_held(self, held: Option<Held>) -> Self {
        Self { held, ..self }
    }

    /// Returns the number of voxels that the scene holds along each axis.
    pub(crate) fn held_dims(&self) -> [u32; 3] {
        self.held.map_or(self.grid.dims(), |held| held.dims)
    }

    /// Returns the first voxel of the lattice that the scene holds.
    pub(crate) fn first(&self) -> DVec3 {
        self.held.map_or(DVec3::ZERO, |held| DVec3::from_array(held.first.map(f64::from)))
    }

    /// Returns the smallest growth of a kernel in the volume.
    pub(crate) fn min_growth(&self) -> f64 {
        self.growths[0]
    }

    /// Returns the largest growth of a kernel in the volume.
    pub(crate) fn max_growth(&self) -> f64 {
        self.growths[1]
    }

    /// Returns the growths between which voxels, or smaller cells, give way to cells of `size` voxels that begin at a
    /// growth of `least`. The ramp is four of these cells deep: over fewer planes the shares of both would not add up
    /// to 1.
    pub(crate) fn ramp(&self, size: f64, least: f64) -> [f64; 2] {
        let [x, y, z] = self.grid.spacing();
        let depth = 4.0 * size * x.max(y).max(z);
        // A quarter less than the least is hardly visible, and only few cells would have deeper ramps.
        [least - (self.growth.slope * depth).min(least / 4.0), least]
    }

    /// Returns the growth of every kernel along parallel rays; 1 in perspective.
    pub(crate) fn parallel_growth(&self) -> f64 {
        if self.is_perspective() { 1.0 } else { self.max_growth() }
    }

    /// Returns the growth of kernels with their depth before an eye, and the largest growth; 1 along parallel rays.
    pub(crate) fn depth_growth(&self) -> (Growth, f64) {
        if self.is_perspective() { (self.growth, self.max_growth()) } else { (Growth::NONE, 1.0) }
    }

    /// Returns the radius of the largest kernel in the volume, in voxels.
    pub(crate) fn max_radius(&self) -> f64 {
        self.radius * self.growths[1]
    }

    /// Estimates the pixels of the largest quad of a splat; infinite if a kernel may reach the eye.
    pub(crate) fn splat_pixels(&self) -> f64 {
        let axes = self.grid.to_world().matrix3;
        let longest = [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::length).into_iter().fold(0.0, f64::max);
        let reach = self.max_radius() * longest;
        let depth = if self.is_perspective() { self.eye_depth - self.farthest - reach } else { 1.0 };
        if depth <= 0.0 {
            return f64::INFINITY;
        }
        (2.0 * reach / (self.camera.pixels().0[0] * depth) + 2.0).powi(2)
    }

    pub(crate) fn is_perspective(&self) -> bool {
        self.camera.projection.eye_distance().is_some()
    }

    /// Returns whether opaque pixels end rays.
    pub(crate) fn terminates(&self) -> bool {
        self.opaque_depth.is_finite()
    }

    /// Returns whether kernels can reach the eye.
    pub(crate) fn is_among_voxels(&self) -> bool {
        let Some(eye) = self.camera.eye() else { return false };
        let from_center = self.grid.to_lattice().transform_vector3(eye);
        from_center.abs().cmple(half(&self.grid) + self.max_radius()).all()
    }

    /// Returns the sides of the visible field: the faces and the clipping planes.
    pub(crate) fn shown(&self) -> impl Iterator<Item = Side> {
        let faces = (0..3).flat_map(|a| [1.0, -1.0].map(|sign| (DVec3::AXES[a] * sign, self.faces[a])));
        faces.chain(self.clip.iter().copied())
    }

    /// Returns the sides of the part that the scene owns, with the sheets and slabs that reach beyond it.
    fn owned(&self) -> impl Iterator<Item = Side> {
        self.held.into_iter().flat_map(|Held { owned: [low, high], beyond, .. }| {
            let middle = half(&self.grid);
            (0..3).flat_map(move |a| {
                let axis = DVec3::AXES[a];
                [(axis, middle[a] - low[a] + beyond), (-axis, high[a] - middle[a] + beyond)]
            })
        })
    }

    /// Returns the smallest rectangle of pixels that holds the projection of all unclipped kernels; `None` if there are
    /// none.
    pub(crate) fn projected_bounds(&self) -> Option<Region> {
        let camera = &self.camera;
        let [w, h] = camera.size;
        let whole = Region { x: 0, y: 0, width: w, height: h };
        let (scale, origin) = camera.pixels();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in corners(&self.shown().chain(self.owned()).collect::<Vec<Side>>()) {
            let d = self.grid.to_world().matrix3 * corner - camera.target;
            let mut plane = [d.dot(camera.right), d.dot(camera.up)];
            if let Some(distance) = camera.projection.eye_distance() {
                let z = d.dot(camera.forward) + distance;
                // A corner beside or behind the eye bounds no pixels.
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
        // One pixel more on either side absorbs rounding.
        let clamped = |v: f64, most: u32| v.clamp(0.0, f64::from(most)) as u32;
        let (x, y) = (clamped((low[0] - 1.0).floor(), w), clamped((low[1] - 1.0).floor(), h));
        let (right, bottom) = (clamped((high[0] + 1.0).ceil(), w), clamped((high[1] + 1.0).ceil(), h));
        (right > x && bottom > y).then(|| Region { x, y, width: right - x, height: bottom - y })
    }

    /// Returns the map from the lattice to view coordinates from its middle.
    pub(crate) fn map_of_lattice(&self) -> DAffine3 {
        let Camera { right, up, forward, .. } = self.camera;
        let to_view = DMat3::from_cols(right, up, forward).transpose() * self.grid.to_world().matrix3;
        DAffine3::from_mat3_translation(to_view, -(to_view * half(&self.grid)))
    }

    /// Returns the map from held lattice points to view coordinates from the middle of the lattice.
    fn map_of_held(&self) -> DAffine3 {
        self.map_of_lattice() * DAffine3::from_translation(self.first())
    }

    /// Returns the directions from held lattice points to the eye.
    pub(crate) fn to_eye(&self) -> ToEye {
        let camera = &self.camera;
        let Some(eye) = camera.eye() else { return ToEye::PARALLEL };
        let to_world = self.grid.to_world().matrix3;
        let axes = [camera.right, camera.up, camera.forward];
        ToEye {
            perspective: true,
            eye: (self.grid.to_lattice().transform_point3(eye) - self.first()).as_vec3().to_array(),
            view: [0, 1, 2].map(|i| axes.map(|axis| axis.dot(to_world.col(i)) as f32)),
        }
    }

    /// Returns the lights on splats of a picture with these settings.
    pub(crate) fn splat_light(&self, settings: &Settings) -> SplatLight {
        SplatLight {
            lighting: self.lighting(settings.lighting.as_ref()),
            lights: settings.light_count(),
            points: settings.has_point_lights(),
            to_eye: self.to_eye(),
        }
    }

    /// Returns material and lights in view coordinates; all zero without light. Places are held lattice points.
    pub(crate) fn lighting(&self, lighting: Option<&Lighting>) -> layout::Lighting {
        let Some(lighting) = lighting else { return layout::Lighting::default() };
        let camera = &self.camera;
        let f3 = |v: DVec3| v.as_vec3().to_array();
        let mut lights = [[0.0; 4]; Lighting::MAX_LIGHTS];
        for (slot, light) in lights.iter_mut().zip(&lighting.lights) {
            *slot = match light.source {
                // Zeros: the shader takes the direction to the eye.
                Source::Eye => [0.0; 4],
                Source::Direction(towards) => {
                    let d = towards.normalize();
                    [d.dot(camera.right), d.dot(camera.up), d.dot(camera.forward), 0.0].map(|c| c as f32)
                }
                Source::Point(place) => {
                    let d = (place - self.center) / self.unit;
                    // Farther out, light is parallel in f32: squares stay in its range.
                    let d = d.clamp_length_max(FARTHEST_LIGHT * half(&self.grid).length().max(1.0));
                    [d.dot(camera.right), d.dot(camera.up), d.dot(camera.forward), 1.0].map(|c| c as f32)
                }
            };
        }
        let mut colors = [[0.0; 4]; Lighting::MAX_LIGHTS];
        for (slot, light) in colors.iter_mut().zip(&lighting.lights) {
            slot.iter_mut().zip(light.color).for_each(|(slot, c)| *slot = c as f32);
        }
        layout::Lighting {
            right: f3(camera.right),
            ambient: lighting.ambient as f32,
            up: f3(camera.up),
            diffuse: lighting.diffuse as f32,
            forward: f3(camera.forward),
            specular: lighting.specular as f32,
            lights,
            colors,
            from_lattice: layout::affine(&self.map_of_held()),
            shininess: lighting.shininess as f32,
            // Painters that light reconstructed gradients fill it in.
            faintest: 0.0,
            _pad: [0; 2],
        }
    }
}

/// Returns the vector from the middle of a lattice to its last point.
pub(crate) fn half(grid: &Grid) -> DVec3 {
    DVec3::from_array(grid.dims().map(|d| f64::from(d - 1) / 2.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_those_of_the_box_and_its_kernels() {
        let grid = Grid::axis_parallel([11; 3], [1.0; 3]).unwrap();
        let view = crate::camera::View { view_height: Some(100.0), ..crate::camera::View::default() };
        let camera = Camera::new(&view, &grid, [200, 100]).unwrap();
        let bounds = |settings: &Settings| {
            ViewGeometry::new(&camera, &grid, settings, Savings::default()).projected_bounds().unwrap()
        };
        // One world unit a pixel: lattice points span 10 pixels, kernels reach 2 more, and 1 is for rounding.
        let region = bounds(&Settings::default());
        assert_eq!([region.x, region.width, region.y, region.height], [92, 16, 42, 16]);
        let post = Settings { shading: crate::settings::Shading::Post, ..Settings::default() };
        let region = bounds(&post);
        assert_eq!([region.x, region.width, region.y, region.height], [93, 14, 43, 14]);
    }
}
