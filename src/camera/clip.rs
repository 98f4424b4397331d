//! Clipping planes, which cut matter away.

use std::ops::Range;

use glam::DVec3;
use serde::ser::SerializeStruct;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::error::{Error, Result};
use crate::volume::Grid;
use voxsplat_volume::vector::{length, unit};

/// A clipping plane. Matter on the side that its normal points to stays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    normal: DVec3,
    offset: f64,
}

impl Plane {
    /// Makes the plane that keeps the world points x with x . n >= `offset`, where n is the direction of `normal`.
    ///
    /// # Errors
    /// [`Error::Setting`] if a number is not finite, or the normal is 0.
    pub fn new(normal: DVec3, offset: f64) -> Result<Self> {
        if !normal.is_finite() || normal == DVec3::ZERO || !offset.is_finite() {
            let reason = format!("the plane {normal} {offset}: expected finite numbers, and a normal over 0");
            return Err(Error::Setting { name: "clip", reason });
        }
        Ok(Self { normal: unit(normal), offset })
    }

    /// Makes the plane through a point of the world.
    ///
    /// # Errors
    /// The errors of [`Self::new`].
    pub fn through(point: DVec3, normal: DVec3) -> Result<Self> {
        let plane = Self::new(normal, 0.0)?;
        Self::new(normal, plane.normal.dot(point))
    }

    /// Returns the unit vector towards the matter that stays.
    #[must_use]
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// Returns the distance of the plane from the origin of the world, along its normal.
    #[must_use]
    pub fn offset(&self) -> f64 {
        self.offset
    }

    /// Returns the plane with its sides exchanged: it keeps the matter that this plane cuts away.
    #[must_use]
    pub fn flipped(self) -> Self {
        Self { normal: -self.normal, offset: -self.offset }
    }
}

/// Writes `{"normal": [x, y, z], "offset": d}`.
impl Serialize for Plane {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut plane = serializer.serialize_struct("Plane", 2)?;
        plane.serialize_field("normal", &self.normal.to_array())?;
        plane.serialize_field("offset", &self.offset)?;
        plane.end()
    }
}

/// Reads the plane as written, to the bit: a unit normal is not normalised again.
impl<'de> Deserialize<'de> for Plane {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        struct Written {
            normal: DVec3,
            offset: f64,
        }
        let Written { normal, offset } = Written::deserialize(deserializer)?;
        let plane = Self::new(normal, offset).map_err(serde::de::Error::custom)?;
        Ok(if (normal.length() - 1.0).abs() < 1e-12 { Self { normal, offset } } else { plane })
    }
}

/// The visible part of the world: the inner side of all planes of the clip. By default, all of the world.
///
/// Extinction and emission are 0 outside. Every ray has one interval inside and is integrated there alone: the cut is
/// exact for every kernel. Pictures of parts that share only their faces add up, composited front to back, to the
/// picture of the whole. Clipped matter casts no shadow.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Clip {
    planes: Vec<Plane>,
}

impl Clip {
    /// The largest number of planes of a clip.
    pub const MAX_PLANES: usize = 8;

    /// Makes the clip of some planes, which keeps the inner side of all of them.
    ///
    /// # Errors
    /// [`Error::Setting`] if there are more than [`Self::MAX_PLANES`].
    pub fn new(planes: Vec<Plane>) -> Result<Self> {
        if planes.len() > Self::MAX_PLANES {
            let reason = format!("{} planes, expected {} at most; a box has 6", planes.len(), Self::MAX_PLANES);
            return Err(Error::Setting { name: "clip", reason });
        }
        Ok(Self { planes })
    }

    /// Makes a box of the world between two corners. An infinite number leaves its side open.
    ///
    /// # Errors
    /// [`Error::Setting`] if a number is NaN, or a number of `low` is not below its counterpart in `high`.
    pub fn of_box(low: DVec3, high: DVec3) -> Result<Self> {
        if !low.cmplt(high).all() {
            let reason = format!("a box from {low} to {high}: expected the first corner below the second");
            return Err(Error::Setting { name: "clip", reason });
        }
        let mut planes = Vec::new();
        for (axis, normal) in DVec3::AXES.into_iter().enumerate() {
            let ends = [(normal, low[axis]), (-normal, -high[axis])];
            for (normal, offset) in ends.into_iter().filter(|(_, offset)| offset.is_finite()) {
                planes.push(Plane::new(normal, offset)?);
            }
        }
        Self::new(planes)
    }

    /// Makes the box of some voxels, given by their numbers along the axes of the lattice. It ends half a voxel beyond
    /// its outermost voxels. At the faces of the volume nothing is cut, so the box of all voxels cuts nothing.
    ///
    /// # Errors
    /// [`Error::Setting`] if a range is empty or ends beyond the volume.
    pub fn of_voxels(grid: &Grid, ranges: [Range<u32>; 3]) -> Result<Self> {
        let to_lattice = grid.to_lattice();
        let mut planes = Vec::new();
        for (axis, (Range { start, end }, count)) in ranges.into_iter().zip(grid.dims()).enumerate() {
            if start >= end || end > count {
                let letter = ["x", "y", "z"][axis];
                let reason = format!("voxels {start}:{end} along {letter}, expected some of 0:{count}");
                return Err(Error::Setting { name: "clip", reason });
            }
            // The number of a voxel is gradient . x + constant.
            let gradient = to_lattice.matrix3.row(axis);
            let steepness = length(gradient);
            let offset = |number: u32| (f64::from(number) - 0.5 - to_lattice.translation[axis]) / steepness;
            if start > 0 {
                planes.push(Plane::new(gradient, offset(start))?);
            }
            if end < count {
                planes.push(Plane::new(gradient, offset(end))?.flipped());
            }
        }
        Self::new(planes)
    }

    /// Returns the part of the world inside both clips.
    ///
    /// # Errors
    /// The errors of [`Self::new`].
    pub fn and(mut self, other: Self) -> Result<Self> {
        self.planes.extend(other.planes);
        Self::new(self.planes)
    }

    /// Returns the planes of the clip.
    #[must_use]
    pub fn planes(&self) -> &[Plane] {
        &self.planes
    }

    /// Returns whether the clip has no planes, so that nothing is cut away.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.planes.is_empty()
    }

    /// Converts the planes to lattice coordinates.
    pub(crate) fn sides(&self, grid: &Grid) -> Vec<Side> {
        let center = grid.center();
        let side = |plane: &Plane| {
            let gradient = grid.to_world().matrix3.transpose() * plane.normal;
            let steepness = length(gradient);
            (gradient / steepness, (plane.normal.dot(center) - plane.offset) / steepness)
        };
        self.planes.iter().map(side).collect()
    }
}

/// A half-space of a lattice, as (gradient, value in the middle of the lattice) of a linear function, which is 0 or
/// more inside. The gradients of clipping planes have length 1.
pub(crate) type Side = (DVec3, f64);

/// Returns whether a point, relative to the middle of the lattice, is on the inner side of all planes.
pub(crate) fn is_inside(sides: &[Side], point: DVec3) -> bool {
    sides.iter().all(|(gradient, value)| gradient.dot(point) + value >= 0.0)
}

/// Returns the corners of the polytope inside all sides, relative to the middle of the lattice. In each corner three
/// planes meet, and it lies on the inner side of the others.
pub(crate) fn corners(sides: &[Side]) -> Vec<DVec3> {
    let mut corners = Vec::new();
    for i in 0..sides.len() {
        for j in 0..i {
            for k in 0..j {
                let [a, b, c] = [i, j, k].map(|side| sides[side]);
                let (x, y, z) = (b.0.cross(c.0), c.0.cross(a.0), a.0.cross(b.0));
                let corner = -(x * a.1 + y * b.1 + z * c.1) / a.0.dot(x);
                let inside = |(normal, value): &Side| {
                    normal.dot(corner) + value >= -1e-6 * (value.abs() + (*normal * corner).abs().element_sum())
                };
                if corner.is_finite() && sides.iter().all(inside) {
                    corners.push(corner);
                }
            }
        }
    }
    corners
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3};

    use super::*;

    /// Makes a skewed lattice far from the origin of the world.
    fn skewed() -> Grid {
        let axes = DMat3::from_cols(DVec3::new(1.0, 0.2, 0.0), DVec3::new(0.3, 1.0, 0.1), DVec3::new(0.0, -0.4, 10.0));
        Grid::new([8, 6, 5], DAffine3::from_mat3_translation(axes, DVec3::new(100.0, -3.0, 7.0))).unwrap()
    }

    #[test]
    fn voxels_of_a_skewed_lattice_are_its_cells() {
        let grid = skewed();
        let sides = Clip::of_voxels(&grid, [2..6, 0..4, 1..5]).unwrap().sides(&grid);
        // Those at the faces cut nothing.
        assert_eq!(sides.len(), 4);
        let middle = DVec3::new(3.5, 2.5, 2.0);
        for (point, inside) in [
            (DVec3::new(1.51, 0.0, 3.0), true),
            (DVec3::new(1.49, 0.0, 3.0), false),
            (DVec3::new(5.49, -20.0, 0.51), true),
            (DVec3::new(5.51, 3.0, 0.51), false),
            (DVec3::new(4.0, 3.49, 90.0), true),
            (DVec3::new(4.0, 3.51, 3.0), false),
            (DVec3::new(4.0, 3.0, 0.49), false),
        ] {
            assert_eq!(is_inside(&sides, point - middle), inside, "{point}");
        }
        assert!(Clip::of_voxels(&grid, [0..8, 0..6, 0..5]).unwrap().is_empty());
        for bad in [[3..3, 0..6, 0..5], [0..9, 0..6, 0..5]] {
            assert!(Clip::of_voxels(&grid, bad).unwrap_err().to_string().contains("along x, expected some of 0:8"));
        }
    }

    #[test]
    fn neighbours_share_a_plane_to_the_bit() {
        let grid = skewed();
        let [left, right] = [[0..3, 0..6, 0..5], [3..8, 0..6, 0..5]].map(|r| Clip::of_voxels(&grid, r).unwrap());
        let flipped: Vec<Plane> = left.planes().iter().map(|plane| plane.flipped()).collect();
        assert_eq!(right.planes(), flipped);
        let [(n, d), (m, e)] = [left.sides(&grid)[0], right.sides(&grid)[0]];
        assert_eq!((n, d), (-m, -e));
    }

    #[test]
    fn boxes_have_corners() {
        let grid = Grid::axis_parallel([11; 3], [2.0; 3]).unwrap();
        let clip = Clip::of_box(DVec3::new(4.0, f64::NEG_INFINITY, 6.0), DVec3::new(8.0, 10.0, f64::INFINITY)).unwrap();
        assert_eq!(clip.planes().len(), 4);
        let faces = (0..3).flat_map(|axis| [1.0, -1.0].map(|sign| (DVec3::AXES[axis] * sign, 5.0)));
        let corners = corners(&clip.sides(&grid).into_iter().chain(faces).collect::<Vec<Side>>());
        let least = corners.iter().copied().reduce(DVec3::min).unwrap();
        let most = corners.iter().copied().reduce(DVec3::max).unwrap();
        assert_eq!((least, most), (DVec3::new(-3.0, -5.0, -2.0), DVec3::new(-1.0, 0.0, 5.0)));
    }

    #[test]
    fn planes_are_checked() {
        for (normal, offset) in [(DVec3::ZERO, 1.0), (DVec3::X, f64::NAN)] {
            let error = Plane::new(normal, offset).unwrap_err().to_string();
            assert!(error.ends_with("expected finite numbers, and a normal over 0"), "{error}");
        }
        let error = Clip::of_box(DVec3::ZERO, DVec3::new(1.0, 0.0, 1.0)).unwrap_err().to_string();
        assert!(error.ends_with("expected the first corner below the second"), "{error}");
        let plane = Plane::through(DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.0, 0.0, -5.0)).unwrap();
        assert_eq!((plane.normal(), plane.offset()), (DVec3::NEG_Z, -3.0));
        assert!(Clip::new(vec![plane; Clip::MAX_PLANES]).is_ok());
        let error = Clip::new(vec![plane; Clip::MAX_PLANES + 1]).unwrap_err();
        assert_eq!(error.to_string(), "clip: 9 planes, expected 8 at most; a box has 6");
    }
}
