//! Gradient opacity, and the resolution of samples: a gradient below it is rounding and no surface.

use super::{TransferFunction, segment};
use crate::error::{Error, Result};
use crate::volume::Volume;

/// A control point of gradient opacity.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with the keys `magnitude` and `opacity`")]
pub struct GradientPoint {
    /// The length of the scalar's gradient: value per world unit, 0 or more.
    pub magnitude: f64,
    /// The share of extinction that is kept at a gradient of this magnitude, 0 to 1.
    pub opacity: f64,
}

impl TransferFunction {
    /// Returns the function with gradient opacity, piecewise linear in the length of the gradient and constant beyond
    /// its ends: it multiplies extinction (Levoy 1988, "Display of surfaces from volume data"; VTK's gradient opacity
    /// in the limit of short steps). Flat regions, such as the inside of organs, fade and surfaces stay. Without
    /// points, extinction stays as it is. Projections of intensity ignore gradient opacity.
    ///
    /// ```
    /// use voxsplat::transfer::{ControlPoint, GradientPoint, TransferFunction};
    ///
    /// let point = |magnitude, opacity| GradientPoint { magnitude, opacity };
    /// let skin = ControlPoint { value: 0.0, color: [0.9, 0.7, 0.6], opacity: 0.3 };
    /// let transfer = TransferFunction::new(vec![skin], None)?
    ///     .with_gradient_opacity(vec![point(10.0, 0.0), point(50.0, 1.0)])?;
    /// assert_eq!(transfer.gradient_share(30.0), 0.5);
    /// # Ok::<(), voxsplat::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Transfer`] if there are more than [`Self::MAX_POINTS`], magnitudes are not finite, negative or not in
    /// ascending order, or an opacity is outside 0..1.
    pub fn with_gradient_opacity(self, points: Vec<GradientPoint>) -> Result<Self> {
        if points.len() > Self::MAX_POINTS {
            return Err(Self::wrong_count(points.len()));
        }
        let mut before = 0.0;
        for (number, GradientPoint { magnitude, opacity }) in points.iter().enumerate() {
            let error = |reason: String| Err(Error::Transfer(format!("gradient point {}: {reason}", number + 1)));
            if !(magnitude.is_finite() && *magnitude >= before) {
                return error(format!("magnitude {magnitude} comes after {before}: magnitudes must ascend from 0"));
            }
            if !(0.0..=1.0).contains(opacity) {
                return error(format!("opacity {opacity} must lie in 0..1"));
            }
            before = *magnitude;
        }
        Ok(Self { gradient: points, ..self })
    }

    /// Returns the control points of gradient opacity, magnitudes ascending; none if the function has no gradient
    /// opacity.
    #[must_use]
    pub fn gradient_opacity(&self) -> &[GradientPoint] {
        &self.gradient
    }

    /// Returns the share of extinction that is kept at a gradient of this length, value per world unit.
    #[must_use]
    pub fn gradient_share(&self, magnitude: f64) -> f64 {
        share(&self.gradient, magnitude, |p| (p.magnitude, p.opacity))
    }

    /// Returns gradient opacity for shaders and their twins, whose gradients are `scale` times as long: pairs of
    /// magnitude and share.
    pub(crate) fn scaled_gradient_opacity(&self, scale: f64) -> Vec<[f32; 2]> {
        let scaled = |p: &GradientPoint| [(p.magnitude * scale).min(1e36) as f32, p.opacity as f32];
        self.gradient.iter().map(scaled).collect()
    }
}

/// The size below which slopes of a scalar along the axes are rounding, and no surface.
///
/// A slope is a central difference of the samples, (f_(j+1) - f_(j-1)) / 2 along an axis of the lattice (post-shaded,
/// smoothed across), or the filtered slope of a normal. Painters hold the distance of samples from the base of the
/// transfer function in f32. Slopes below a share of that distance are therefore noise, and the direction of their sum
/// is arbitrary. Light does not depend either on slopes far below the smallest that the transfer function
/// distinguishes, because half floats and fitted kernels do not hold them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Resolution {
    of_distance: f64,
    faintest: f64,
}

impl Resolution {
    /// The share of a value's distance from the base that is the resolution: 64 times the rounding of f32. 2^-18.
    pub(crate) const OF_DISTANCE: f64 = 1.0 / 262_144.0;
    /// The share of the largest distance of values from the base that is the resolution, if that distance is within the
    /// extent of the transfer function: half floats hold it to 11 bits if the largest distance stays in their range.
    /// 2^-28.
    const OF_ALL: f64 = Self::OF_DISTANCE / 1024.0;
    /// The least share of the extent of the transfer function that counts as the largest distance. 2^-32.
    const LEAST: f64 = 1.0 / 4_294_967_296.0;

    /// The resolution by which every difference is a surface.
    pub(crate) const NONE: Self = Self { of_distance: 0.0, faintest: 0.0 };

    /// Finds the resolution of the values of a volume.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the samples cannot be read.
    pub(crate) fn new(transfer: &TransferFunction, volume: &Volume) -> Result<Self> {
        let largest = volume.farthest_from(transfer.base())?;
        let extent = transfer.extent_or(largest);
        let faintest = Self::OF_ALL * largest.clamp(Self::LEAST * extent, extent);
        Ok(Self { of_distance: Self::OF_DISTANCE, faintest })
    }

    /// Returns the part of the resolution that does not depend on the value.
    pub(crate) fn faintest(&self) -> f64 {
        self.faintest
    }

    /// Returns the largest central difference that counts half as a surface, at a distance of the value from the base.
    fn at(&self, distance: f64) -> f64 {
        self.of_distance * distance.abs() + self.faintest
    }

    /// Returns the weight of a surface at a distance of its value from the base, given its central differences along
    /// the axes of the lattice: g^4 / (g^4 + 1) with g the largest difference over the resolution. It is steep, so that
    /// quadrature along a ray meets a surface or none.
    pub(crate) fn share(&self, differences: [f64; 3], distance: f64) -> f64 {
        let largest = differences.iter().fold(0.0_f64, |largest, d| largest.max(d.abs()));
        if largest <= 0.0 {
            return 0.0;
        }
        let g = (largest / self.at(distance)).min(1e9).powi(4);
        g / (g + 1.0)
    }

    /// Returns the differences of a voxel, or 0 if their weight as a surface is less than half.
    pub(crate) fn resolved(&self, differences: [f64; 3], distance: f64) -> [f64; 3] {
        if self.share(differences, distance) < 0.5 { [0.0; 3] } else { differences }
    }
}

/// Returns the share of extinction at a magnitude, by pairs of [`TransferFunction::scaled_gradient_opacity`].
pub(crate) fn scaled_share(points: &[[f32; 2]], magnitude: f32) -> f32 {
    share(points, magnitude.into(), |pair| pair.map(f64::from).into()) as f32
}

/// Returns the share at a magnitude, by points that `pair` splits into magnitude and share; 1 without points.
fn share<T>(points: &[T], magnitude: f64, pair: impl Fn(&T) -> (f64, f64)) -> f64 {
    if points.is_empty() {
        return 1.0;
    }
    let (a, b, f) = segment(points, magnitude, |p| pair(p).0);
    let (first, last) = (pair(a).1, pair(b).1);
    first + (last - first) * f
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::ControlPoint;

    fn with(points: &[(f64, f64)]) -> Result<TransferFunction> {
        let all = ControlPoint { value: 0.0, color: [1.0; 3], opacity: 0.5 };
        let point = |&(magnitude, opacity): &(f64, f64)| GradientPoint { magnitude, opacity };
        TransferFunction::new(vec![all], None)?.with_gradient_opacity(points.iter().map(point).collect())
    }

    #[test]
    fn shares_are_linear_between_points() {
        let transfer = with(&[(1.0, 0.2), (3.0, 1.0), (3.0, 0.5)]).unwrap();
        for (magnitude, share) in [(0.0, 0.2), (1.0, 0.2), (2.0, 0.6), (3.0, 0.5), (9.0, 0.5), (f64::INFINITY, 0.5)] {
            assert!((transfer.gradient_share(magnitude) - share).abs() < 1e-12, "{magnitude}");
            let scaled = transfer.scaled_gradient_opacity(1e-3);
            assert!((f64::from(scaled_share(&scaled, (magnitude * 1e-3) as f32)) - share).abs() < 1e-6, "{magnitude}");
        }
        assert_eq!(with(&[]).unwrap().gradient_share(5.0), 1.0);
    }

    #[test]
    fn wrong_points_are_refused() {
        for points in [[(-1.0, 0.5), (1.0, 1.0)], [(2.0, 0.5), (1.0, 1.0)], [(0.0, 0.5), (1.0, 1.5)]] {
            let error = with(&points).unwrap_err().to_string();
            assert!(error.contains("gradient point"), "{error}");
        }
    }
}
