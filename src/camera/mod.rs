//! Views as users describe them, and the cameras made of them.

pub mod clip;
pub(crate) mod framing;

use glam::{DMat3, DVec2, DVec3};

pub use crate::camera::framing::Hull;
use crate::error::{Error, Result};
use crate::volume::Grid;
use voxsplat_volume::vector::{rotation, unit};

/// The projection of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProjectionKind {
    /// Parallel rays.
    Orthographic,
    /// Rays through one eye.
    Perspective {
        /// The vertical field of view, degrees, over 0 and under 180.
        fov: f64,
    },
}

impl ProjectionKind {
    /// The perspective of 30 degrees, the default field of view.
    pub const PERSPECTIVE: Self = Self::Perspective { fov: 30.0 };
}

/// A view as a user describes it. `Default` looks at the front of the volume, orthographic, fitted to the image.
///
/// End a literal with `..View::default()`: a minor release may add fields.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Degrees by which the eye is turned about `up`, starting from the front (looking along world +y) towards +x.
    pub azimuth: f64,
    /// Degrees by which the eye is lifted towards `up`.
    pub elevation: f64,
    /// Degrees by which the camera is turned about its own axis, counter-clockwise; the picture turns clockwise.
    pub roll: f64,
    /// The world direction that is up in the picture; z by default.
    pub up: DVec3,
    /// The direction from eye to target, in place of azimuth and elevation.
    pub direction: Option<DVec3>,
    /// The world point in the middle of the picture; by default the centre of the hull.
    pub target: Option<DVec3>,
    /// The hull that is fitted to the picture, such as [`Hull::of_visible`], as if it were turned all around `up` or
    /// [from one side](Hull::from_one_side). `None` fits the box of the volume as seen from this side.
    pub around: Option<Hull>,
    /// Free space around the hull: a fraction of the picture on each side, 0 to under 0.5.
    pub margin: f64,
    /// Parts of the picture at its left, right, top and bottom that stay free beside the hull and its margin: fractions
    /// of the width and of the height, 0 or more. Ignored if the view has a target, a height or a distance of its own.
    pub reserved: [f64; 4],
    /// Parallel or perspective rays.
    pub projection: ProjectionKind,
    /// Magnification relative to the fitted or stated size.
    pub zoom: f64,
    /// World height that the picture spans at the target; fitted by default.
    pub view_height: Option<f64>,
    /// World distance from eye to target; only perspective pictures depend on it.
    pub distance: Option<f64>,
    /// Makes literals that name all fields impossible.
    #[doc(hidden)]
    pub non_exhaustive: (),
}

impl Default for View {
    fn default() -> Self {
        Self {
            azimuth: 0.0,
            elevation: 0.0,
            roll: 0.0,
            up: DVec3::Z,
            direction: None,
            target: None,
            around: None,
            margin: 0.02,
            reserved: [0.0; 4],
            projection: ProjectionKind::Orthographic,
            zoom: 1.0,
            view_height: None,
            distance: None,
            non_exhaustive: (),
        }
    }
}

/// The rays of a camera. Pixel (x, y) of a picture of w x h pixels, y down, has image coordinates
/// sx = (2 (x + 1/2) / w - 1) w/h and sy = 1 - 2 (y + 1/2) / h.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Projection {
    /// The ray starts at target + half_height (sx right + sy up) and runs along forward.
    Orthographic {
        /// Half the world height that the picture spans.
        half_height: f64,
    },
    /// The ray starts at the eye, target - distance forward, and runs along
    /// forward + tan_half_fov (sx right + sy up).
    Perspective {
        /// Tangent of half the vertical field of view.
        tan_half_fov: f64,
        /// World distance from eye to target.
        distance: f64,
    },
}

impl Projection {
    /// Returns the world distance from the eye to the target; `None` if rays are parallel.
    #[must_use]
    pub fn eye_distance(&self) -> Option<f64> {
        if let Self::Perspective { distance, .. } = self { Some(*distance) } else { None }
    }
}

/// A camera: an orthonormal frame at a target, and a projection. World coordinates, f64.
///
/// [`Camera::new`] makes cameras of views. End a literal with the camera that it changes: a minor release may add
/// fields.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Camera {
    /// The world point in the middle of the picture.
    pub target: DVec3,
    /// The world direction that points right in the picture, unit length.
    pub right: DVec3,
    /// The world direction that points up in the picture, unit length.
    pub up: DVec3,
    /// The world direction of the central ray, unit length: right x up = -forward.
    pub forward: DVec3,
    /// Parallel or perspective rays.
    pub projection: Projection,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Makes literals that name all fields impossible.
    #[doc(hidden)]
    #[serde(skip)]
    pub non_exhaustive: (),
}

/// The largest distance of eye and target from the volume, in voxels: f32 holds it and its inverse.
const MOST_VOXELS: f64 = 1e30;
/// The smallest size of a pixel in voxels.
const LEAST_VOXELS: f64 = 1e-30;

/// The least width of a volume in pixels. The light of smaller volumes, the square of this, is below the resolution of
/// every picture format.
const LEAST_PIXELS: f64 = 1e-5;

impl Camera {
    /// The largest width or height of a picture, in pixels.
    pub const MAX_SIZE: u32 = 32_768;
    /// The default width and height of a picture, in pixels.
    pub const DEFAULT_SIZE: [u32; 2] = [1024, 1024];

    /// Makes the camera of a view of a volume for a picture of `size` (width, height) pixels.
    ///
    /// A view without height and distance is fitted: the hull of [`View::around`], or the box of the volume, just fits
    /// into the picture.
    ///
    /// # Errors
    /// [`Error::Camera`] if a number is not finite or out of its range, or `up` is parallel to the direction;
    /// [`Error::Setting`] if a side of the picture is 0 or over [`Camera::MAX_SIZE`] pixels.
    pub fn new(view: &View, grid: &Grid, size: [u32; 2]) -> Result<Self> {
        check_size(size)?;
        view.validate()?;
        let frame = view.frame()?;
        let (right, up, forward) = (frame.x_axis, frame.y_axis, -frame.z_axis);
        let axis = unit(view.up);
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let (tan, towards) = match view.projection {
            ProjectionKind::Orthographic => (1.0, DVec3::ZERO),
            ProjectionKind::Perspective { fov } => (libm::tan(fov.to_radians() / 2.0), -forward),
        };
        // A place p from the target is inside a side of the picture if p . limit(side) is at most half the height of
        // the picture, or in perspective the distance of the eye.
        let room = tan * (1.0 - 2.0 * view.margin);
        let limit = |side: DVec3| side / room + towards;
        let center = |hull: &Hull| {
            let shift = |side: DVec3, wide: f64| [side * (wide * room), limit(side / wide), limit(-side / wide)];
            hull.target(axis, up, [[forward, forward, -forward], shift(right, aspect), shift(up, 1.0)])
        };
        let middle = view.target.unwrap_or_else(|| view.around.as_ref().map_or_else(|| grid.center(), center));
        let corners = grid.corners_from_center(0.5).map(|corner| corner + (grid.center() - middle));
        let extent = |direction: DVec3| match &view.around {
            Some(hull) => hull.extent(middle, axis, direction),
            None => corners.iter().map(|corner| corner.dot(direction)).fold(f64::NEG_INFINITY, f64::max),
        };
        let is_fitted = [view.view_height, view.distance] == [None; 2] && view.target.is_none();
        let (shift, fitted) = if is_fitted && view.reserved != [0.0; 4] {
            beside(view, aspect, &frame, (tan, towards), &extent)
        } else {
            let sides = [up, -up, right / aspect, -right / aspect];
            (DVec3::ZERO, sides.map(|side| extent(limit(side))).into_iter().fold(f64::NEG_INFINITY, f64::max))
        };
        let half_height = view.view_height.map(|height| height / 2.0);
        let projection = match view.projection {
            ProjectionKind::Orthographic => {
                Projection::Orthographic { half_height: half_height.unwrap_or(fitted) / view.zoom }
            }
            ProjectionKind::Perspective { .. } => {
                let distance = view.distance.or(half_height.map(|half| half / tan)).unwrap_or(fitted);
                // With both a distance and a height, the height decides the field of view.
                let tan = half_height.filter(|_| view.distance.is_some()).map_or(tan, |half| half / distance);
                Projection::Perspective { tan_half_fov: tan / view.zoom, distance }
            }
        };
        Ok(Self { target: middle + shift, right, up, forward, projection, size, non_exhaustive: () })
    }

    /// Refuses a camera with numbers that are not finite or a wrong size.
    ///
    /// # Errors
    /// [`Error::Camera`] if a number is not finite, [`Error::Setting`] if a side of the picture is 0 or over
    /// [`Camera::MAX_SIZE`] pixels.
    pub fn validate(&self) -> Result<()> {
        check_size(self.size)?;
        let numbers = match self.projection {
            Projection::Orthographic { half_height } => [half_height, 1.0],
            Projection::Perspective { tan_half_fov, distance } => [tan_half_fov, distance],
        };
        if ![self.target, self.right, self.up, self.forward].iter().all(|v| v.is_finite())
            || !numbers.iter().all(|n| n.is_finite())
        {
            return Err(Error::Camera("its position, axes and projection must be finite".to_owned()));
        }
        Ok(())
    }

    /// Converts the camera to the coordinates of [`Grid::local`].
    pub(crate) fn local(&self, grid: &Grid) -> Self {
        let per_unit = 1.0 / grid.unit();
        let projection = match self.projection {
            Projection::Orthographic { half_height } => {
                Projection::Orthographic { half_height: half_height * per_unit }
            }
            Projection::Perspective { tan_half_fov, distance } => {
                Projection::Perspective { tan_half_fov, distance: distance * per_unit }
            }
        };
        Self { target: (self.target - grid.center()) * per_unit, projection, ..*self }
    }

    /// Refuses a camera for which a volume on `grid` is too small to be visible, or whose lengths in voxels leave the
    /// range of f32.
    ///
    /// # Errors
    /// [`Error::Camera`].
    pub(crate) fn check_scale(&self, grid: &Grid) -> Result<()> {
        let (camera, grid) = (self.local(grid), grid.local());
        let half_diagonal = grid.corners_from_center(0.5).map(DVec3::length).into_iter().fold(0.0, f64::max);
        let (distance, depth) = match camera.projection {
            Projection::Orthographic { .. } => (0.0, 1.0),
            Projection::Perspective { distance, .. } => (distance.abs(), distance - camera.target.dot(camera.forward)),
        };
        let pixel = camera.pixels().0[0].abs();
        let farthest = camera.target.length().max(distance);
        if farthest > MOST_VOXELS {
            return Err(Error::Camera(format!(
                "the {} is {farthest:.1e} voxels away from the volume, expected at most {MOST_VOXELS:e}",
                if distance > camera.target.length() { "eye" } else { "target" }
            )));
        }
        if !(LEAST_VOXELS..=MOST_VOXELS).contains(&pixel) {
            return Err(Error::Camera(format!(
                "a pixel is {pixel:.1e} voxels wide, expected {LEAST_VOXELS:e} to {MOST_VOXELS:e}"
            )));
        }
        let across = 2.0 * half_diagonal / (pixel * depth);
        let is_before_the_eye = camera.eye().is_none() || depth > half_diagonal;
        if is_before_the_eye && across < LEAST_PIXELS {
            return Err(Error::Camera(format!(
                "the whole volume would be {across:.1e} pixels wide, too small to be visible: come closer, or zoom in"
            )));
        }
        Ok(())
    }

    /// Returns the world point that perspective rays start from; `None` for parallel rays.
    #[must_use]
    pub fn eye(&self) -> Option<DVec3> {
        match self.projection {
            Projection::Orthographic { .. } => None,
            Projection::Perspective { distance, .. } => Some(self.target - self.forward * distance),
        }
    }

    /// Returns the width of a pixel in world units; in perspective at the depth of the target.
    #[must_use]
    pub fn pixel_size(&self) -> f64 {
        let at = match self.projection {
            Projection::Orthographic { .. } => 1.0,
            Projection::Perspective { distance, .. } => distance,
        };
        self.pixels().0[0] * at
    }

    /// Returns the steps of one pixel across and down, and the top left corner of the picture, as offsets along right
    /// and up: in world units at the target for parallel rays, at unit depth for perspective rays.
    pub(crate) fn pixels(&self) -> ([f64; 2], [f64; 2]) {
        let [w, h] = self.size.map(f64::from);
        let half = match self.projection {
            Projection::Orthographic { half_height } => half_height,
            Projection::Perspective { tan_half_fov, .. } => tan_half_fov,
        };
        let scale = 2.0 * half / h;
        ([scale, -scale], [-half * w / h, half])
    }

    /// Returns the view coordinates of a place: right, up, and the depth from the eye or from the target's plane.
    pub(crate) fn seen(&self, place: DVec3) -> DVec3 {
        let from = place - self.eye().unwrap_or(self.target);
        DVec3::new(from.dot(self.right), from.dot(self.up), from.dot(self.forward))
    }

    /// Returns the place of view coordinates in the picture, in pixels from its top left. In perspective their depth
    /// is over 0.
    pub(crate) fn pixel_of(&self, seen: DVec3) -> DVec2 {
        let (step, start) = self.pixels();
        let scale = if self.projection.eye_distance().is_some() { 1.0 / seen.z } else { 1.0 };
        DVec2::new((seen.x * scale - start[0]) / step[0], (seen.y * scale - start[1]) / step[1])
    }

    /// Returns the image coordinates (sx, sy) of a pixel's centre; see [`Projection`].
    #[must_use]
    pub fn image_coordinates(&self, pixel: [u32; 2]) -> (f64, f64) {
        let [w, h] = self.size.map(f64::from);
        let sx = (2.0 * (f64::from(pixel[0]) + 0.5) / w - 1.0) * w / h;
        let sy = 1.0 - 2.0 * (f64::from(pixel[1]) + 0.5) / h;
        (sx, sy)
    }

    /// Returns origin and unit direction of the ray through image coordinates (sx, sy), in world coordinates.
    ///
    /// A perspective ray starts at the eye. A parallel ray has no start: its origin lies in the target's plane and
    /// the ray extends both ways.
    #[must_use]
    pub fn ray(&self, sx: f64, sy: f64) -> (DVec3, DVec3) {
        let offset = self.right * sx + self.up * sy;
        match self.projection {
            Projection::Orthographic { half_height } => (self.target + offset * half_height, self.forward),
            Projection::Perspective { tan_half_fov, distance } => {
                (self.target - self.forward * distance, (self.forward + offset * tan_half_fov).normalize())
            }
        }
    }
}

/// Returns how far the target of a view moves from a point, and the half height or the distance of the eye, to fit
/// matter around the point beside the parts of the picture that are reserved. `extent` returns how far the matter
/// reaches from the point in a direction, whose length multiplies the result; the columns of `frame` are the camera's
/// axes: right, up, backward. A place p from the target is inside a side of the free part, at a height or distance of
/// 1, if p . (side / (tan room) + towards) is at most 1.
fn beside(
    view: &View,
    aspect: f64,
    frame: &DMat3,
    (tan, towards): (f64, DVec3),
    extent: &dyn Fn(DVec3) -> f64,
) -> (DVec3, f64) {
    let [left, right, top, bottom] = view.reserved.map(|part| 1.0 - 2.0 * (part + view.margin));
    let axes = [(frame.x_axis, [aspect * right, aspect * left]), (frame.y_axis, [top, bottom])];
    // For both sides along an axis: the room at a height or a distance of 1, and the reach of the matter.
    let sides = axes.map(|(axis, room)| {
        let room = room.map(|room| room * tan);
        (axis, room, [extent(axis / room[0] + towards), extent(-axis / room[1] + towards)])
    });
    // The least that holds both sides of each axis: the target moves until they need alike.
    let least = sides.map(|(_, [a, b], [far, near])| (far * a + near * b) / (a + b));
    let reach = least[0].max(least[1]);
    // In the middle of the free part.
    let shift = sides.into_iter().fold(DVec3::ZERO, |shift, (axis, [a, b], [far, near])| {
        shift + axis * (((far - reach) * a - (near - reach) * b) / 2.0)
    });
    (shift, reach)
}

/// The growth of kernels if voxels are closer together than pixels.
///
/// A kernel at depth z in front of the eye (any, for parallel rays) is h(x / s) / s^3 in lattice coordinates, with
/// s = max(1, constant + slope z): as wide as if there were one voxel per pixel, with the same integral (Swan, Mueller
/// et al. 1997, "An anti-aliasing technique for splatting"). The distance of two voxels is the smallest extent of a
/// unit lattice ball in the image, so that anisotropic grids have no holes either.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
#[doc(hidden)]
pub struct Growth {
    /// s for parallel rays; 0 for perspective rays.
    pub constant: f64,
    /// s per world unit of depth in front of the eye; 0 for parallel rays.
    pub slope: f64,
}

impl Growth {
    /// Kernels that never grow.
    pub const NONE: Self = Self { constant: 1.0, slope: 0.0 };

    /// Returns s at world depth `depth` in front of the eye.
    #[must_use]
    pub fn at(&self, depth: f64) -> f64 {
        (self.constant + self.slope * depth).max(1.0)
    }
}

impl Camera {
    /// Returns the growth of the kernels of a volume on `grid` in the picture.
    #[must_use]
    #[doc(hidden)]
    pub fn growth(&self, grid: &Grid) -> Growth {
        // Lengths in a unit whose squares neither overflow nor vanish.
        let unit = grid.min_spacing();
        let to_world = grid.to_world().matrix3.transpose();
        let (x, y) = (to_world * self.right / unit, to_world * self.up / unit);
        // The smaller singular value of the 2 x 3 matrix of rows x and y.
        let (a, b, c) = (x.length_squared(), x.dot(y), y.length_squared());
        let larger2 = f64::midpoint(a, c) + (((a - c) / 2.0).powi(2) + b * b).sqrt();
        let voxel = unit * (x.cross(y).length_squared() / larger2).sqrt();
        let pixel = |half: f64| 2.0 * half / f64::from(self.size[1]) / voxel;
        match self.projection {
            Projection::Orthographic { half_height } => Growth { constant: pixel(half_height), slope: 0.0 },
            Projection::Perspective { tan_half_fov, .. } => Growth { constant: 0.0, slope: pixel(tan_half_fov) },
        }
    }
}

fn check_size([width, height]: [u32; 2]) -> Result<()> {
    let most = Camera::MAX_SIZE;
    if (1..=most).contains(&width) && (1..=most).contains(&height) {
        return Ok(());
    }
    Err(Error::Setting { name: "size", reason: format!("{width}x{height} pixels, expected 1x1 to {most}x{most}") })
}

impl View {
    /// Returns the world direction from eye to target, unit length.
    ///
    /// # Errors
    /// [`Error::Camera`] if a number is not finite or out of its range, or `up` is parallel to the direction.
    pub fn forward(&self) -> Result<DVec3> {
        self.validate()?;
        Ok(-self.frame()?.z_axis)
    }

    /// Returns the camera's axes as columns: right, up, backward.
    fn frame(&self) -> Result<DMat3> {
        let world_up = unit(self.up);
        let (forward, right) = match self.direction {
            Some(direction) => {
                let forward = unit(direction);
                let right = forward.cross(world_up);
                if right.length() < 1e-6 {
                    return Err(Error::Camera(format!(
                        "direction {forward} is parallel to up {world_up}: choose another up"
                    )));
                }
                (forward, right.normalize())
            }
            None => {
                // The front looks along +y, or if `up` is y itself along -z, the custom of y-up worlds.
                let seed = if world_up.dot(DVec3::Y).abs() < 0.999 { DVec3::Y } else { DVec3::NEG_Z };
                let front = seed.reject_from_normalized(world_up).normalize();
                let turned = rotation(world_up, self.azimuth.to_radians()) * front;
                let right = turned.cross(world_up);
                (rotation(right, -self.elevation.to_radians()) * turned, right)
            }
        };
        let roll = rotation(-forward, self.roll.to_radians());
        let right = roll * right;
        Ok(DMat3::from_cols(right, right.cross(forward), -forward))
    }

    fn validate(&self) -> Result<()> {
        let error = |what: String| Err(Error::Camera(what));
        for (name, value) in [("azimuth", self.azimuth), ("elevation", self.elevation), ("roll", self.roll)] {
            if !value.is_finite() {
                return error(format!("{name} is {value}, expected a number of degrees"));
            }
        }
        for (name, value) in [("zoom", Some(self.zoom)), ("view-height", self.view_height), ("distance", self.distance)]
        {
            if let Some(value) = value
                && !(value.is_finite() && value > 0.0)
            {
                return error(format!("{name} is {value}, expected a number over 0"));
            }
        }
        if !(0.0..0.5).contains(&self.margin) {
            return error(format!("margin is {}, expected 0 to under 0.5", self.margin));
        }
        if !self.reserved.iter().all(|part| (0.0..0.5 - self.margin).contains(part)) {
            let reserved = self.reserved;
            return error(format!("reserved is {reserved:?}, expected 0 to under 0.5, with the margin"));
        }
        for (name, value) in [("up", Some(self.up)), ("direction", self.direction)] {
            if let Some(value) = value
                && !(value.is_finite() && value != DVec3::ZERO)
            {
                return error(format!("{name} is {value}, expected a direction"));
            }
        }
        if let Some(target) = self.target
            && !target.is_finite()
        {
            return error(format!("target is {target}, expected a point"));
        }
        if let ProjectionKind::Perspective { fov } = self.projection
            && !(fov > 0.0 && fov < 180.0)
        {
            return error(format!("fov is {fov} degrees, expected over 0 and under 180"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3};

    use super::*;

    #[test]
    fn kernels_grow_with_the_distance_of_pixels() {
        let grid = Grid::axis_parallel([10; 3], [0.5; 3]).unwrap();
        let at = |projection, distance| {
            let view = View { azimuth: 30.0, view_height: Some(40.0), projection, distance, ..View::default() };
            Camera::new(&view, &grid, [16, 20]).unwrap().growth(&grid)
        };
        // 40 units over 20 pixels: 2 a pixel, 4 voxels.
        let parallel = at(ProjectionKind::Orthographic, None);
        assert!((parallel.at(7.0) - 4.0).abs() < 1e-12);
        let perspective = at(ProjectionKind::Perspective { fov: 30.0 }, Some(100.0));
        assert!((perspective.at(100.0) - 4.0).abs() < 1e-12);
        assert!((perspective.at(50.0) - 2.0).abs() < 1e-12);
        assert_eq!(perspective.at(-3.0), 1.0);
    }

    #[test]
    fn the_thinnest_direction_in_the_image_counts() {
        let grid = Grid::new([4; 3], DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, 1.0, 4.0)))).unwrap();
        let view = View { view_height: Some(40.0), ..View::default() };
        let camera = Camera::new(&view, &grid, [20, 20]).unwrap();
        assert!((camera.growth(&grid).at(0.0) - 2.0).abs() < 1e-12);
    }
}
