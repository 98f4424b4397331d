//! The position of a volume's lattice points in the world.

use glam::{DAffine3, DMat3, DVec3};

use crate::error::{Error, Result};
use crate::vector::{length, unit};

/// A lattice of samples placed in the world by an affine map.
///
/// Lattice coordinates are voxel indices: sample (i, j, k) lies at lattice point (i, j, k), i fastest in memory. World
/// coordinates are in the file's unit of length (millimetres for most scans). The world of an oriented medical file is
/// the patient space of DICOM: +x to the patient's left, +y to the back, +z to the head. In a file without orientation
/// the lattice axes are the world axes, and the origin is the file's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    dims: [u32; 3],
    to_world: DAffine3,
    to_lattice: DAffine3,
}

/// The least angle, in degrees, between a lattice axis and the plane of the two others. A kernel is a ball in lattice
/// coordinates: in a lattice this flat it is a sliver hundreds of times as long as thick, which no picture resolves.
/// Tilted gantries and oblique sections lie over 30 degrees.
const FLATTEST: f64 = 0.1;

/// The distances of samples whose cubes, and thus the inverse of the grid, f64 holds.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-100..=1e100;

/// The largest number of samples along an axis. Up to here, f32 lattice coordinates resolve 1/256 of a voxel.
pub const MAX_DIM: u32 = 65_535;

impl Grid {
    /// Makes a grid of `dims` samples along x, y and z. Lattice point p lies at `to_world * p`.
    ///
    /// # Errors
    /// [`Error::Volume`] if a dimension is 0 or over [`MAX_DIM`], a distance of samples is outside 1e-100 to 1e100, or
    /// the map is not finite, singular or nearly so: if a lattice axis is less than 0.1 degrees from the plane of the
    /// two others.
    pub fn new(dims: [u32; 3], to_world: DAffine3) -> Result<Self> {
        if let Some(axis) = (0..3).find(|&a| dims[a] == 0 || dims[a] > MAX_DIM) {
            let ([x, y, z], size, n) = (dims, dims[axis], axis + 1);
            let reason = format!("dimension {n} is {size}, expected 1 to {MAX_DIM} (lattice {x} x {y} x {z})");
            return Err(Error::Volume(reason));
        }
        let m = to_world.matrix3;
        let axes = [m.x_axis, m.y_axis, m.z_axis];
        let lengths = axes.map(length);
        if let Some(bad) = lengths.into_iter().find(|l| l.is_finite() && *l > 0.0 && !LENGTHS.contains(l)) {
            let (least, most) = (LENGTHS.start(), LENGTHS.end());
            let reason = "choose another unit of length";
            return Err(Error::Volume(format!("a spacing of {bad:e} is outside {least:e} to {most:e}: {reason}")));
        }
        // Of unit axes: the test does not depend on the unit of length.
        let [x, y, z] = axes.map(unit);
        // The sine of the angle between an axis and the plane of the two others is the volume that the three span over
        // the area that the two span.
        let area = [x.cross(y), y.cross(z), z.cross(x)].map(DVec3::length).into_iter().fold(0.0, f64::max);
        let sine = (x.dot(y.cross(z)) / area).abs();
        if !to_world.is_finite() || !sine.is_finite() || sine < libm::sin(FLATTEST.to_radians()) {
            let flat = if sine.is_finite() && sine > 0.0 {
                let degrees = libm::asin(sine.min(1.0)).to_degrees();
                format!("one is {degrees:.2e} degrees from the plane of the others, expected {FLATTEST} or more, ")
            } else {
                String::new()
            };
            let ([x, y, z], check) = (lengths, "check spacing and directions in the header");
            let reason = format!("the grid's axes do not span space ({flat}spacing {x} x {y} x {z}): {check}");
            return Err(Error::Volume(reason));
        }
        Ok(Self { dims, to_world, to_lattice: to_world.inverse() })
    }

    /// Makes a grid along the world axes with the given spacing (world length per voxel); its first sample is at the
    /// origin.
    ///
    /// # Errors
    /// The errors of [`Grid::new`].
    pub fn axis_parallel(dims: [u32; 3], spacing: [f64; 3]) -> Result<Self> {
        Self::new(dims, DAffine3::from_mat3(DMat3::from_diagonal(DVec3::from_array(spacing))))
    }

    /// Returns the number of samples along each lattice axis.
    #[must_use]
    pub fn dims(&self) -> [u32; 3] {
        self.dims
    }

    /// Returns the number of samples.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.dims.iter().map(|&d| u64::from(d)).product()
    }

    /// Returns false: a grid has at least one sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Returns the map from lattice to world coordinates.
    #[must_use]
    pub fn to_world(&self) -> DAffine3 {
        self.to_world
    }

    /// Returns the map from world to lattice coordinates.
    #[must_use]
    pub fn to_lattice(&self) -> DAffine3 {
        self.to_lattice
    }

    /// Returns the world distance between neighbouring samples along each lattice axis.
    #[must_use]
    pub fn spacing(&self) -> [f64; 3] {
        let m = self.to_world.matrix3;
        [m.x_axis, m.y_axis, m.z_axis].map(length)
    }

    /// Returns the lattice of a box of lattice points, given by their numbers along each axis.
    ///
    /// # Errors
    /// [`Error::Volume`] if a range is empty.
    pub fn part(&self, ranges: &[std::ops::Range<u32>; 3]) -> Result<Self> {
        let mut to_world = self.to_world;
        let first = DVec3::from_array(std::array::from_fn(|axis| f64::from(ranges[axis].start)));
        to_world.translation = to_world.transform_point3(first);
        Self::new(std::array::from_fn(|axis| ranges[axis].end.saturating_sub(ranges[axis].start)), to_world)
    }

    /// Returns the smallest of the three spacings: the default unit distance of opacities.
    #[must_use]
    pub fn min_spacing(&self) -> f64 {
        let [x, y, z] = self.spacing();
        x.min(y).min(z)
    }

    /// Returns the mean of the three spacings.
    #[must_use]
    pub fn mean_spacing(&self) -> f64 {
        self.spacing().iter().sum::<f64>() / 3.0
    }

    /// Returns the world position of the centre of the lattice.
    #[must_use]
    pub fn center(&self) -> DVec3 {
        self.to_world.transform_point3(self.middle())
    }

    /// Returns the world length that painters use as 1: a power of two within a factor of two of the middle one of the
    /// three spacings.
    pub fn unit(&self) -> f64 {
        let [x, y, z] = self.spacing();
        let middle = x.max(y).min(x.min(y).max(z));
        // Without the bits of the fraction.
        f64::from_bits(middle.to_bits() & 0x7ff0_0000_0000_0000)
    }

    /// Returns the lattice in a world that begins in its middle and is measured in [`Self::unit`]. Neither the file's
    /// unit of length nor its origin then reaches a number of f32; as the unit is a power of two, nothing is rounded.
    pub fn local(&self) -> Self {
        Self::around_origin(self.dims, self.to_world.matrix3 * (1.0 / self.unit()))
    }

    /// Returns the lattice in a world that begins in its middle.
    pub fn centered(&self) -> Self {
        Self::around_origin(self.dims, self.to_world.matrix3)
    }

    fn around_origin(dims: [u32; 3], matrix3: DMat3) -> Self {
        let middle = DVec3::from_array(dims.map(|d| f64::from(d - 1))) / 2.0;
        let to_world = DAffine3::from_mat3_translation(matrix3, -(matrix3 * middle));
        Self { dims, to_world, to_lattice: to_world.inverse() }
    }

    /// Returns the lattice point in the middle of the lattice.
    fn middle(&self) -> DVec3 {
        DVec3::from_array(self.dims.map(|d| f64::from(d - 1))) / 2.0
    }

    /// Returns the eight world corners of the box that lies `margin` voxels outside the outermost samples. Bit a of a
    /// corner's index says whether it lies at the far end of lattice axis a.
    #[must_use]
    pub fn corners(&self, margin: f64) -> [DVec3; 8] {
        self.corners_from_center(margin).map(|corner| self.center() + corner)
    }

    /// Returns the eight corners of the box `margin` voxels outside the outermost samples, relative to the centre of
    /// the lattice, so that a distant origin costs no precision.
    pub fn corners_from_center(&self, margin: f64) -> [DVec3; 8] {
        let half = self.middle() + margin;
        std::array::from_fn(|c| {
            let side = |axis: usize| if c >> axis & 1 == 0 { -half[axis] } else { half[axis] };
            self.to_world.matrix3 * DVec3::new(side(0), side(1), side(2))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spacings_are_named_as_they_are() {
        let refused = |spacing| Grid::axis_parallel([2; 3], spacing).unwrap_err().to_string();
        assert!(refused([1e-200, 1.0, 1.0]).contains("a spacing of 1e-200 is outside 1e-100 to 1e100"));
        assert!(refused([1.0, 1e200, 1.0]).contains("a spacing of 1e200 is"));
        assert!(refused([1.0, 0.0, 1.0]).contains("spacing 1 x 0 x 1"));
        for size in [1e-100, 1e-9, 1e9, 1e100] {
            let grid = Grid::axis_parallel([2; 3], [size; 3]).unwrap();
            assert_eq!(grid.spacing(), [size; 3]);
            assert!(grid.to_lattice().is_finite(), "{size}");
        }
    }
}
