//! Framing: the hull of the visible voxels, and the camera that fits around it.

mod outline;

use std::fmt;
use std::sync::Arc;

use glam::DVec3;
use outline::{outline, outline_steps};

use crate::camera::clip::Clip;
use crate::error::Result;
use crate::transfer::TransferFunction;
use crate::volume::Volume;
use voxsplat_volume::meshes::Mesh;

/// The convex hull of the visible voxels of a volume.
///
/// A view that is fitted around it has the same target and scale at every azimuth, so that a turntable is steady: the
/// hull counts as if it were rotated around [`View::up`](crate::camera::View::up), unless it is
/// [`Self::from_one_side`].
#[derive(Clone, PartialEq)]
pub struct Hull {
    /// The world point that `points` are relative to.
    origin: DVec3,
    /// Voxels that include the corners of the hull.
    points: Arc<[DVec3]>,
    /// The reach beyond `points`, in world units, of kernels and of voxels between inspected rows.
    reach: f64,
    /// Whether the hull counts as if it were rotated around an axis.
    turned: bool,
}

impl fmt::Debug for Hull {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Hull").field("origin", &self.origin).field("points", &self.points.len()).finish_non_exhaustive()
    }
}

/// The smallest opacity that counts as visible, as a share of the largest opacity of the transfer function.
const VISIBLE: f64 = 0.01;

/// The smallest cosine between the axis and the picture's up at which the axis is used to centre the hull vertically.
const LEAST_LEAN: f64 = 0.2;

/// The largest number of points of a joined hull; of more points the farthest in each of `DIRECTIONS` are kept.
const MOST_POINTS: usize = 16_384;
const DIRECTIONS: u32 = 4096;

/// The golden angle, radians.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Steps towards the smallest circle, mostly enough for a radius within a hundredth of the smallest.
const STEPS: u32 = 200;

impl Hull {
    /// Returns the hull of the voxels that a transfer function makes visible and that are not clipped; `None` if there
    /// are none. Voxels of less than a hundredth of the function's largest opacity do not count. Volumes of over 255
    /// voxels along y or z are searched in some rows only, so that a structure of a few voxels may be missed.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) and [`Error::Memory`](crate::error::Error::Memory) if samples left in
    /// a file cannot be read.
    pub fn of_visible(volume: &Volume, transfer: &TransferFunction, clip: &Clip) -> Result<Option<Self>> {
        let most = transfer.max_opacity();
        if most <= 0.0 {
            return Ok(None);
        }
        Self::of_values(volume, &transfer.values_over(VISIBLE * most), clip)
    }

    /// Returns the hull of the voxels with values in some ranges, which ascend and are apart.
    pub(crate) fn of_values(volume: &Volume, ranges: &[[f64; 2]], clip: &Clip) -> Result<Option<Self>> {
        let grid = volume.grid();
        let to_world = grid.centered().to_world();
        let points = outline(volume, ranges, &clip.sides(grid))?;
        let points: Arc<[DVec3]> = points.into_iter().map(|point| to_world.transform_point3(point)).collect();
        let [x, y, z] = grid.spacing();
        let [rows, planes] = outline_steps(volume).map(|n| n as f64);
        let hull = Self { origin: grid.center(), points, reach: x.max(y * rows).max(z * planes), turned: true };
        Ok((!hull.points.is_empty()).then_some(hull))
    }

    /// Returns the hull of both hulls, with all points.
    pub(crate) fn and(&self, other: &Self) -> Self {
        let offset = other.origin - self.origin;
        let points = self.points.iter().copied().chain(other.points.iter().map(|&point| point + offset)).collect();
        Self { points, reach: self.reach.max(other.reach), ..self.clone() }
    }

    /// Returns the hull of both hulls, such as of two time points. It has all their points if there are at most 16384,
    /// otherwise the farthest points in each of 4096 directions. Less than 1/200 of the largest extent is lost if the
    /// hull is no flatter than 1 : 6.
    #[must_use]
    pub fn joined(&self, other: &Self) -> Self {
        let both = self.and(other);
        if both.points.len() <= MOST_POINTS {
            return both;
        }
        let farthest = |direction: DVec3| {
            let along = |point: &&DVec3| point.dot(direction);
            both.points.iter().max_by(|a, b| along(a).total_cmp(&along(b))).copied()
        };
        // Directions along a spiral, each with an equal area of the sphere (Saff and Kuijlaars 1997, "Distributing many
        // points on a sphere").
        let direction = |n: u32| {
            let height = (2.0 * f64::from(n) + 1.0) / f64::from(DIRECTIONS) - 1.0;
            let turn = f64::from(n) * GOLDEN_ANGLE;
            let across = (1.0 - height * height).sqrt();
            DVec3::new(across * libm::cos(turn), across * libm::sin(turn), height)
        };
        Self { points: (0..DIRECTIONS).filter_map(|n| farthest(direction(n))).collect(), ..both }
    }

    /// Returns the hull of this hull and a mesh in the world.
    #[must_use]
    pub fn with_mesh(&self, mesh: &Mesh) -> Self {
        self.with_points((0..mesh.vertices.len() as u32).map(|vertex| mesh.place(vertex)))
    }

    /// Returns the hull of this hull and points of the world.
    #[must_use]
    pub fn with_points(&self, points: impl IntoIterator<Item = DVec3>) -> Self {
        let points: Vec<DVec3> = points.into_iter().map(|point| point - self.origin).collect();
        if points.is_empty() {
            return self.clone();
        }
        self.joined(&Self { points: outermost(points).into(), ..self.clone() })
    }

    /// Returns the hull, to be fitted as seen from the direction of the view: it fills the picture, and every view has
    /// its own target and scale.
    #[must_use]
    pub fn from_one_side(self) -> Self {
        Self { turned: false, ..self }
    }

    /// Returns the point in the middle of a picture with the unit vector `top` upwards. Each of `shifts` is a vector
    /// and two directions in which the extents of the hull must be equal: the point moves by the vector for each unit
    /// of half the difference of the extents.
    pub(crate) fn target(&self, up: DVec3, top: DVec3, shifts: [[DVec3; 3]; 3]) -> DVec3 {
        if self.turned {
            return self.center(up, top);
        }
        shifts.into_iter().fold(self.origin, |target, [shift, to, from]| {
            let [to, from] = [to, from].map(|direction| self.extent(target, up, direction));
            target + shift * ((to - from) / 2.0)
        })
    }

    /// Returns the point on the axis of the hull along the unit vector `up` that is in the middle of a picture with the
    /// unit vector `top` upwards. The axis goes through the centre of a small circle around the hull (Badoiu and
    /// Clarkson 2003, "Smaller core-sets for balls").
    fn center(&self, up: DVec3, top: DVec3) -> DVec3 {
        let heights = || self.points.iter().map(|point| point.dot(up));
        let (least, most) = (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
        let farthest = |center: DVec3| {
            let distances = self.points.iter().map(|point| {
                let point = point.reject_from_normalized(up);
                (center.distance_squared(point), point)
            });
            distances.fold((0.0, center), |best, next| if next.0 > best.0 { next } else { best })
        };
        let mut center = DVec3::ZERO;
        let mut best = (f64::INFINITY, center);
        for step in 0..STEPS {
            let (squared, point) = farthest(center);
            if squared < best.0 {
                best = (squared, center);
            }
            center += (point - center) / f64::from(step + 2);
        }
        let middle = self.origin + best.1 + up * f64::midpoint(least, most);
        // Seen from above, a wider end of the hull reaches farther up or down the picture.
        let lean = top.dot(up);
        let [above, below] = [top, -top].map(|side| self.extent(middle, up, side));
        if lean > LEAST_LEAN { middle + up * ((above - below) / 2.0 / lean) } else { middle }
    }

    /// Returns the extent from a target in a direction, times the length of `direction`; rotated around the unit vector
    /// `up` through the target unless the hull is [`Self::from_one_side`].
    pub(crate) fn extent(&self, target: DVec3, up: DVec3, direction: DVec3) -> f64 {
        let (along, across) = (direction.dot(up), direction.reject_from_normalized(up).length());
        let offset = self.origin - target;
        let extents = self.points.iter().map(|&point| {
            let point = point + offset;
            if !self.turned {
                return point.dot(direction);
            }
            point.dot(up) * along + point.reject_from_normalized(up).length() * across
        });
        extents.fold(f64::NEG_INFINITY, f64::max) + self.reach * direction.length()
    }
}

/// Returns the outermost of many points: the first and the last along each axis in each of 64 x 64 columns. At most
/// 1/64 of the extent is lost, and mostly nothing, because the columns of another axis keep the points at the sides.
fn outermost(points: Vec<DVec3>) -> Vec<DVec3> {
    const COLUMNS: usize = 64;
    if points.len() <= MOST_POINTS {
        return points;
    }
    let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let per_unit = COLUMNS as f64 / (high - low).max(DVec3::splat(f64::MIN_POSITIVE));
    let mut kept = Vec::new();
    for axis in 0..3 {
        let mut ends: Vec<Option<[DVec3; 2]>> = vec![None; COLUMNS * COLUMNS];
        for &point in &points {
            // Casts saturate.
            let cell = |axis: usize| (((point - low) * per_unit)[axis] as usize).min(COLUMNS - 1);
            let column = &mut ends[cell((axis + 1) % 3) * COLUMNS + cell((axis + 2) % 3)];
            let [first, last] = column.get_or_insert([point; 2]);
            if point[axis] < first[axis] {
                *first = point;
            }
            if point[axis] > last[axis] {
                *last = point;
            }
        }
        kept.extend(ends.into_iter().flatten().flatten());
    }
    kept
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3};

    use super::*;
    use crate::camera::{Camera, Projection, ProjectionKind, View};
    use crate::transfer::ControlPoint;
    use crate::volume::Grid;

    fn hull(points: &[DVec3]) -> Hull {
        Hull { origin: DVec3::new(1.0, 2.0, 3.0), points: points.into(), reach: 0.5, turned: true }
    }

    #[test]
    fn hulls_of_many_points_are_joined_to_within_1_200_of_their_extent() {
        // Places on a flat ellipsoid, in an order that is not that of the directions.
        let place = |n: u32| {
            let [a, b] = [0.754_877_666_246_693, 0.569_840_290_998_053].map(|step| (f64::from(n) * step).fract());
            let (height, turn) = (2.0 * a - 1.0, b * std::f64::consts::TAU);
            let across = (1.0 - height * height).sqrt();
            DVec3::new(across * turn.cos(), across * turn.sin(), height) * DVec3::new(30.0, 20.0, 5.0)
        };
        let of = |numbers: std::ops::Range<u32>, origin: DVec3| Hull {
            origin,
            points: numbers.map(|n| place(n) - origin).collect(),
            reach: 1.0,
            turned: false,
        };
        let all = of(0..40_000, DVec3::ZERO);
        let joined = of(0..20_000, DVec3::ZERO).joined(&of(20_000..40_000, DVec3::new(1.0, -2.0, 3.0)));
        assert!(joined.points.len() <= DIRECTIONS as usize, "{}", joined.points.len());
        for direction in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(1.0, -2.0, 0.5), DVec3::new(-3.0, 1.0, 1.0)] {
            let [whole, found] = [&all, &joined].map(|hull| hull.extent(DVec3::ZERO, DVec3::Z, direction));
            let lost = (whole - found) / direction.length();
            assert!((-1e-9..60.0 / 200.0).contains(&lost), "{direction}: {found} of {whole}");
        }
        // Fewer points are all kept.
        assert!(of(0..100, DVec3::ZERO).joined(&of(100..200, DVec3::ZERO)) == of(0..200, DVec3::ZERO));
    }

    #[test]
    fn extents_are_those_of_the_turned_hull() {
        let points = [DVec3::new(3.0, 4.0, 1.0), DVec3::new(-3.0, -4.0, 7.0)];
        let hull = hull(&points);
        let center = hull.center(DVec3::Z, DVec3::Z);
        assert!(center.distance(DVec3::new(1.0, 2.0, 7.0)) < 0.05, "{center}");
        // As far up as down in a picture from above, if the upper end is the wider.
        let wide = self::hull(&[DVec3::new(3.0, 4.0, 1.0), DVec3::new(-3.0, -4.0, 1.0), DVec3::NEG_Z]);
        let top = DVec3::new(0.0, 0.6, 0.8);
        let center = wide.center(DVec3::Z, top);
        let [above, below] = [top, -top].map(|side| wide.extent(center, DVec3::Z, side));
        assert!((above - below).abs() < 1e-9 && center.z > 3.5, "{above} {below} {center}");
        let extent = |direction| hull.extent(DVec3::new(1.0, 2.0, 7.0), DVec3::Z, direction);
        assert!((extent(DVec3::Z) - 3.5).abs() < 1e-12 && (extent(DVec3::NEG_Z) - 3.5).abs() < 1e-12);
        // Whatever the azimuth.
        for angle in [0.0_f64, 0.3, 2.0] {
            let around = DVec3::new(angle.cos(), angle.sin(), 0.0);
            assert!((extent(around) - 5.5).abs() < 1e-12);
            assert!((extent(2.0 * around) - 11.0).abs() < 1e-12);
            let diagonal = (around + DVec3::Z) / 2.0_f64.sqrt();
            assert!((extent(diagonal) - (8.0 / 2.0_f64.sqrt() + 0.5)).abs() < 1e-12);
        }
    }

    #[test]
    fn circles_are_hardly_larger_than_the_smallest() {
        // A cluster far from the middle of the box of all.
        let points = [DVec3::ZERO, DVec3::X * 10.0, DVec3::new(5.0, 4.0, 0.0), DVec3::new(5.0, 4.0, 0.1)];
        let hull = hull(&points);
        let radius = hull.extent(hull.center(DVec3::Z, DVec3::Z), DVec3::Z, DVec3::X) - 0.5;
        assert!((5.0..5.05).contains(&radius), "{radius}");
    }

    #[test]
    fn from_one_side_opposite_ends_touch_opposite_sides() {
        let points = [DVec3::new(9.0, 1.0, 2.0), DVec3::new(-1.0, 4.0, -3.0), DVec3::new(2.0, -8.0, 0.5), DVec3::ZERO];
        let hull = Hull { reach: 0.0, ..hull(&points) }.from_one_side();
        let grid = Grid::axis_parallel([1; 3], [1.0; 3]).unwrap();
        for (size, projection) in [
            ([300, 100], ProjectionKind::Orthographic),
            ([100, 300], ProjectionKind::Orthographic),
            ([300, 100], ProjectionKind::Perspective { fov: 60.0 }),
            ([100, 300], ProjectionKind::Perspective { fov: 60.0 }),
        ] {
            let around = Some(hull.clone());
            let view = View { azimuth: 30.0, elevation: 20.0, projection, around, margin: 0.1, ..View::default() };
            let camera = Camera::new(&view, &grid, size).unwrap();
            let places = points.map(|point| {
                let d = point + hull.origin - camera.target;
                let half_height = match camera.projection {
                    Projection::Orthographic { half_height } => half_height,
                    Projection::Perspective { tan_half_fov, distance } => {
                        tan_half_fov * (distance + d.dot(camera.forward))
                    }
                };
                let aspect = f64::from(size[0]) / f64::from(size[1]);
                [d.dot(camera.right) / (half_height * aspect), d.dot(camera.up) / half_height]
            });
            let ends = [0, 1].map(|axis| {
                let along = || places.iter().map(|place| place[axis]);
                [-along().fold(f64::INFINITY, f64::min), along().fold(f64::NEG_INFINITY, f64::max)]
            });
            let touched = ends.iter().filter(|[a, b]| (a - 0.8).abs() < 1e-9 && (b - 0.8).abs() < 1e-9).count();
            let inside = ends.iter().flatten().all(|end| *end < 0.8 + 1e-9);
            assert!(touched >= 1 && inside, "{size:?} {projection:?}: {ends:?}");
        }
    }

    #[test]
    fn what_is_framed_lies_in_the_middle_of_what_is_not_reserved() {
        let points = [DVec3::new(9.0, 1.0, 2.0), DVec3::new(-1.0, 4.0, -3.0), DVec3::new(2.0, -8.0, 0.5), DVec3::ZERO];
        let turned = Hull { reach: 0.0, ..hull(&points) };
        let grid = Grid::axis_parallel([20, 9, 5], [1.0; 3]).unwrap();
        let [left, right, top, bottom] = [0.0, 0.3, 0.1, 0.2];
        let (kinds, sizes) = (
            [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 60.0 }],
            [[300, 100], [100, 300], [200, 200]],
        );
        for (size, projection) in sizes.into_iter().flat_map(|size| kinds.map(|kind| (size, kind))) {
            for around in [None, Some(turned.clone()), Some(turned.clone().from_one_side())] {
                let is_turned = around.as_ref().is_some_and(|hull| hull.turned);
                let view = View { azimuth: 30.0, elevation: 20.0, projection, around, margin: 0.05, ..View::default() };
                let view = View { reserved: [left, right, top, bottom], ..view };
                let camera = Camera::new(&view, &grid, size).unwrap();
                let of_hull = points.map(|point| point + hull(&points).origin);
                let all = if view.around.is_some() { of_hull.to_vec() } else { grid.corners_from_center(0.5).to_vec() };
                let all = all.into_iter().map(|p| if view.around.is_some() { p } else { p + grid.center() });
                // As shares of the picture, from its upper left.
                let places = all.map(|point| {
                    let d = point - camera.target;
                    let half_height = match camera.projection {
                        Projection::Orthographic { half_height } => half_height,
                        Projection::Perspective { tan_half_fov, distance } => {
                            tan_half_fov * (distance + d.dot(camera.forward))
                        }
                    };
                    let aspect = f64::from(size[0]) / f64::from(size[1]);
                    let (x, y) = (d.dot(camera.right) / (half_height * aspect), d.dot(camera.up) / half_height);
                    [0.5 + x / 2.0, 0.5 - y / 2.0]
                });
                let places: Vec<[f64; 2]> = places.collect();
                let what = format!("{size:?} {projection:?} {is_turned}");
                let space = [0, 1].map(|axis| {
                    let along = || places.iter().map(|place| place[axis]);
                    let [before, behind] = [[left, right], [top, bottom]][axis].map(|part| part + 0.05);
                    let least = along().fold(f64::INFINITY, f64::min) - before;
                    [least, 1.0 - behind - along().fold(f64::NEG_INFINITY, f64::max)]
                });
                assert!(space.iter().flatten().all(|space| *space > -1e-9), "{what}: {space:?}");
                // What is turned touches the sides at some azimuths only.
                if !is_turned {
                    assert!(space.iter().any(|[a, b]| a.abs() < 1e-9 && b.abs() < 1e-9), "{what}: {space:?}");
                    // Through an eye it is as far from both sides along the other axis at one depth only.
                    let middle = space.iter().all(|[a, b]| (a - b).abs() < 1e-9);
                    assert!(middle || projection != ProjectionKind::Orthographic, "{what}: {space:?}");
                }
                // A turntable is steady.
                let turned = Camera::new(&View { azimuth: 77.0, ..view.clone() }, &grid, size).unwrap();
                let size_of = |camera: &Camera| match camera.projection {
                    Projection::Orthographic { half_height } => half_height,
                    Projection::Perspective { distance, .. } => distance,
                };
                let aside = |camera: &Camera| {
                    let d = hull(&points).center(DVec3::Z, camera.up) - camera.target;
                    [d.dot(camera.right), d.dot(camera.up)]
                };
                let steady = [size_of(&camera) - size_of(&turned), aside(&camera)[0] - aside(&turned)[0]];
                assert!(!is_turned || steady.iter().all(|d| d.abs() < 1e-9), "{what}: {steady:?}");
            }
        }
        let view = View { reserved: [0.5, 0.0, 0.0, 0.0], ..View::default() };
        let error = Camera::new(&view, &grid, [100, 100]).unwrap_err().to_string();
        assert!(error.contains("reserved is [0.5, 0.0, 0.0, 0.0], expected 0 to under 0.5"), "{error}");
        // What places itself in the picture stays there.
        let view = View { view_height: Some(30.0), ..View::default() };
        let camera = Camera::new(&view, &grid, [100, 100]).unwrap();
        let reserved = Camera::new(&View { reserved: [0.1; 4], ..view }, &grid, [100, 100]).unwrap();
        assert_eq!(camera, reserved);
    }

    #[test]
    fn what_is_nearly_clear_is_not_framed() {
        let mut samples = vec![0_u8; 20 * 20 * 20];
        let at = |x: usize, y: usize, z: usize| (z * 20 + y) * 20 + x;
        for (x, y, z) in [(4, 5, 6), (8, 5, 6)] {
            samples[at(x, y, z)] = 100;
        }
        samples[at(19, 19, 19)] = 1;
        let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
        let transfer = TransferFunction::new(vec![point(0.0, 0.0), point(200.0, 1.0)], None).unwrap();
        for unit in [1e-90, 1.0, 1e90] {
            let world = DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(unit)), DVec3::X * unit);
            let grid = Grid::new([20; 3], world).unwrap();
            let volume = Volume::from_slice([20; 3], [1.0; 3], &samples).unwrap().with_grid(grid).unwrap();
            let hull = Hull::of_visible(&volume, &transfer, &Clip::default()).unwrap().unwrap();
            let center = hull.center(DVec3::Z, DVec3::Z);
            assert!((center / unit).distance(DVec3::new(7.0, 5.0, 6.0)) < 0.03, "{center}");
            let extents = [DVec3::X, DVec3::Z].map(|direction| hull.extent(center, DVec3::Z, direction) / unit);
            assert!((extents[0] - 3.0).abs() < 0.03 && (extents[1] - 1.0).abs() < 1e-9, "{extents:?}");
        }
        let clear = TransferFunction::new(vec![point(150.0, 0.0), point(200.0, 1.0)], None).unwrap();
        let volume = Volume::from_slice([20; 3], [1.0; 3], &samples).unwrap();
        assert_eq!(Hull::of_visible(&volume, &clear, &Clip::default()).unwrap(), None);
    }
}
