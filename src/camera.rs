//! From the options of a view to a camera.

use glam::{DMat3, DQuat, DVec3};

use crate::error::{Error, Result};
use crate::volume::Grid;

/// How a picture is projected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProjectionKind {
    /// Parallel rays.
    Orthographic,
    /// Rays through one eye; `fov` is the vertical field of view in degrees, over 0 and under 180.
    Perspective {
        /// Vertical field of view, degrees.
        fov: f64,
    },
}

/// A view as a user describes it. `Default` looks at the front of the volume, orthographic, fitted to the image.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Degrees by which the eye is turned about `up`, starting from the front (looking along world +y) towards +x.
    pub azimuth: f64,
    /// Degrees by which the eye is lifted towards `up`.
    pub elevation: f64,
    /// Degrees by which the camera is turned about its own axis, counter-clockwise; the picture turns clockwise.
    pub roll: f64,
    /// The world direction that is up in the picture; z where none is given.
    pub up: DVec3,
    /// The direction from eye to target, in place of azimuth and elevation.
    pub direction: Option<DVec3>,
    /// The world point in the middle of the picture; the volume's centre where none is given.
    pub target: Option<DVec3>,
    /// Parallel or perspective rays.
    pub projection: ProjectionKind,
    /// Magnification of the fitted or stated size.
    pub zoom: f64,
    /// World height that the picture spans at the target; fitted to the volume where none is given.
    pub view_height: Option<f64>,
    /// World distance from eye to target; only perspective pictures depend on it.
    pub distance: Option<f64>,
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
            projection: ProjectionKind::Orthographic,
            zoom: 1.0,
            view_height: None,
            distance: None,
        }
    }
}

/// The rays of a camera. Pixel (x, y) of a picture of w x h pixels, y down, has image coordinates
/// sx = (2 (x + 1/2) / w - 1) w/h and sy = 1 - 2 (y + 1/2) / h.
#[derive(Debug, Clone, Copy, PartialEq)]
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

/// A camera: an orthonormal frame at a target, and a projection. World coordinates, f64.
#[derive(Debug, Clone, Copy, PartialEq)]
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
}

/// Space left around a fitted volume, as a fraction of the picture.
const FIT_MARGIN: f64 = 0.02;

impl Camera {
    /// The camera of a view of a volume in a picture of `size` (width, height) pixels.
    ///
    /// A view without height and distance is fitted: the box of the volume just fits into the picture.
    ///
    /// # Errors
    /// [`Error::Camera`] where a number is not finite or out of its range, or `up` is parallel to the direction.
    pub fn new(view: &View, grid: &Grid, size: [u32; 2]) -> Result<Self> {
        view.validate()?;
        let frame = view.frame()?;
        let (right, up, forward) = (frame.x_axis, frame.y_axis, -frame.z_axis);
        let target = view.target.unwrap_or_else(|| grid.center());
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        // Offsets of the corners from the target, in (right, up, forward).
        let corners = grid.corners(0.5).map(|c| {
            let d = c - target;
            DVec3::new(d.dot(right), d.dot(up), d.dot(forward))
        });
        let fill = 1.0 - 2.0 * FIT_MARGIN;
        let projection = match view.projection {
            ProjectionKind::Orthographic => {
                let fitted = || {
                    let half = corners.iter().fold(0.0_f64, |m, c| m.max(c.y.abs()).max(c.x.abs() / aspect));
                    2.0 * half / fill
                };
                let height = view.view_height.unwrap_or_else(fitted) / view.zoom;
                Projection::Orthographic { half_height: height / 2.0 }
            }
            ProjectionKind::Perspective { fov } => {
                let tan = (fov.to_radians() / 2.0).tan();
                let fitted = || {
                    // Corner (x, y, z) is inside where |y| <= fill tan (distance + z), and likewise across.
                    corners.iter().fold(0.0_f64, |m, c| m.max(c.y.abs().max(c.x.abs() / aspect) / (tan * fill) - c.z))
                };
                let distance = match (view.distance, view.view_height) {
                    (Some(distance), _) => distance,
                    (None, Some(height)) => height / 2.0 / tan,
                    (None, None) => fitted(),
                };
                // With both a distance and a height, the height decides the field of view.
                let tan = match (view.distance, view.view_height) {
                    (Some(distance), Some(height)) => height / 2.0 / distance,
                    _ => tan,
                };
                Projection::Perspective { tan_half_fov: tan / view.zoom, distance }
            }
        };
        Ok(Self { target, right, up, forward, projection })
    }

    /// Image coordinates (sx, sy) of a pixel's centre; see [`Projection`].
    #[must_use]
    pub fn image_coordinates(pixel: [u32; 2], size: [u32; 2]) -> (f64, f64) {
        let [w, h] = size.map(f64::from);
        let sx = (2.0 * (f64::from(pixel[0]) + 0.5) / w - 1.0) * w / h;
        let sy = 1.0 - 2.0 * (f64::from(pixel[1]) + 0.5) / h;
        (sx, sy)
    }

    /// Origin and unit direction of the ray through image coordinates (sx, sy), in world coordinates.
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

impl View {
    /// The camera's axes as columns: right, up, backward.
    fn frame(&self) -> Result<DMat3> {
        let world_up = self.up.normalize();
        let (forward, right) = match self.direction {
            Some(direction) => {
                let forward = direction.normalize();
                let right = forward.cross(world_up);
                if right.length() < 1e-6 {
                    return Err(Error::Camera(format!(
                        "direction {forward} is parallel to up {world_up}: give another --up"
                    )));
                }
                (forward, right.normalize())
            }
            None => {
                // The front looks along +y; where `up` is y itself, along -z, as y-up worlds have it.
                let seed = if world_up.dot(DVec3::Y).abs() < 0.999 { DVec3::Y } else { DVec3::NEG_Z };
                let front = seed.reject_from_normalized(world_up).normalize();
                let turned = DQuat::from_axis_angle(world_up, self.azimuth.to_radians()) * front;
                let right = turned.cross(world_up);
                (DQuat::from_axis_angle(right, -self.elevation.to_radians()) * turned, right)
            }
        };
        let roll = DQuat::from_axis_angle(-forward, self.roll.to_radians());
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
        for (name, value) in [("up", Some(self.up)), ("direction", self.direction)] {
            if let Some(value) = value
                && !(value.is_finite() && value.length() > 0.0)
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
