//! Reconstruction kernels: the density of a voxel around its lattice point.

#[doc(hidden)]
pub mod reconstruction;

mod derivative;
mod footprint;
pub(crate) mod quadrature;
mod real;
mod spline;

pub(crate) use derivative::{BESIDE, DerivativeFilter, NORMAL_REACH, Slopes};
pub(crate) use footprint::{FootprintTable, footprint_polynomial, section, section_by};
pub(crate) use real::Real;
pub(crate) use spline::{MAX_REACH, Misfit, SplineFilter};

use std::f64::consts::PI;
use std::fmt;

use crate::error::{Error, Result};
use quadrature::integrate;
use voxsplat_volume::names::named;

/// A radially symmetric reconstruction kernel of compact support, peak 1, in lattice coordinates (unit: voxels).
///
/// Inside its support ball of radius R, every kernel is an analytic function of y = R^2 - rho^2. This makes its table
/// of footprints smooth.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Kernel {
    /// A truncated Gaussian: exp(-rho^2 / (2 sigma^2)) for rho <= radius, 0 outside (Westover 1990). The default is
    /// sigma 1, radius 2.
    Gaussian {
        /// The standard deviation in voxels, over 0.
        sigma: f64,
        /// The radius in voxels at which the Gaussian is truncated, over 0.
        radius: f64,
    },
    /// The generalised Kaiser-Bessel blob of order 2, y I_2(alpha sqrt y) / I_2(alpha) with y = 1 - (rho/radius)^2
    /// (Lewitt 1990, "Multidimensional digital image representations using generalized Kaiser-Bessel window functions",
    /// equation 6 with m = 2). The blob and its first derivative are continuous at the rim.
    KaiserBessel {
        /// The radius of the support in voxels, over 0.
        radius: f64,
        /// The taper. At radius 2, 10.4 puts a zero of the spectrum at the lattice frequency (Matej and Lewitt 1996).
        alpha: f64,
    },
}

impl Default for Kernel {
    fn default() -> Self {
        Self::Gaussian { sigma: 1.0, radius: 2.0 }
    }
}

impl Kernel {
    /// The blob with the parameters of Matej and Lewitt (1996): radius 2, alpha 10.4.
    pub const KAISER_BESSEL: Self = Self::KaiserBessel { radius: 2.0, alpha: 10.4 };

    /// The largest support radius, in voxels: a splat of this kernel covers 32^3 voxels.
    pub const MAX_RADIUS: f64 = 16.0;

    /// Refuses parameters out of range: sigma 0.05 to 16, alpha 0 to 50, radius 0.5 to [`Self::MAX_RADIUS`].
    ///
    /// # Errors
    /// [`Error::Setting`] that names the parameter.
    pub fn validate(&self) -> Result<()> {
        let shape = match *self {
            Self::Gaussian { sigma, .. } => ("sigma", sigma, 0.05, 16.0),
            Self::KaiserBessel { alpha, .. } => ("alpha", alpha, 0.0, 50.0),
        };
        for (what, value, low, high) in [shape, ("radius", self.radius(), 0.5, Self::MAX_RADIUS)] {
            if !(low..=high).contains(&value) {
                return Err(Error::Setting {
                    name: "kernel",
                    reason: format!("{what} is {value}, expected {low} to {high}"),
                });
            }
        }
        Ok(())
    }

    /// Returns the radius of the support, in voxels.
    #[must_use]
    pub fn radius(&self) -> f64 {
        match *self {
            Self::Gaussian { radius, .. } | Self::KaiserBessel { radius, .. } => radius,
        }
    }

    /// Scales the kernel by `growth` in all directions.
    pub(crate) fn grown(&self, growth: f64) -> Self {
        match *self {
            Self::Gaussian { sigma, radius } => Self::Gaussian { sigma: growth * sigma, radius: growth * radius },
            Self::KaiserBessel { radius, alpha } => Self::KaiserBessel { radius: growth * radius, alpha },
        }
    }

    /// Returns a narrower kernel in place of a Gaussian: a blob of radius 2. For a share of 0 the blob is as broad as
    /// the Gaussian, if a blob can be, and for 1 it is [`Self::KAISER_BESSEL`]. `None` if the kernel is a blob, or a
    /// Gaussian no broader than [`Self::KAISER_BESSEL`].
    ///
    /// A narrow Gaussian would have ripple: 8.5 % with a sigma of 0.5. The blobs have at most 4.3 %.
    pub(crate) fn narrowed(&self, share: f64) -> Option<Self> {
        let Self::KaiserBessel { radius, alpha: narrowest } = Self::KAISER_BESSEL else { return None };
        let blob = |alpha: f64| Self::KaiserBessel { radius, alpha };
        let variance = self.variance();
        if matches!(self, Self::KaiserBessel { .. }) || variance <= Self::KAISER_BESSEL.variance() {
            return None;
        }
        // The variance falls with alpha.
        let [mut low, mut high] = [0.0, narrowest];
        while blob(low).variance() > variance && high - low > 1e-3 {
            let middle = f64::midpoint(low, high);
            if blob(middle).variance() > variance { low = middle } else { high = middle }
        }
        Some(blob(low + share * (narrowest - low)))
    }

    /// Returns the kernel at squared distance `rho2` (voxels^2) from its centre: 1 at 0, 0 outside the support.
    #[must_use]
    pub(crate) fn value(&self, rho2: f64) -> f64 {
        if rho2 > self.radius() * self.radius() { 0.0 } else { self.continued(rho2) }
    }

    /// Returns the kernel at squared distance `rho2` (voxels^2), continued analytically beyond its support.
    #[must_use]
    pub(crate) fn continued(&self, rho2: f64) -> f64 {
        match *self {
            Self::Gaussian { sigma, .. } => libm::exp(-rho2 / (2.0 * sigma * sigma)),
            Self::KaiserBessel { radius, alpha } => {
                let y = 1.0 - rho2 / (radius * radius);
                y * y * bessel_i2_over_z2(alpha * alpha * y) / bessel_i2_over_z2(alpha * alpha)
            }
        }
    }

    /// Returns the integral over the support ball, in voxels^3: 11.6317 for the default Gaussian.
    #[must_use]
    pub(crate) fn integral(&self) -> f64 {
        4.0 * PI * integrate(0.0, self.radius(), 64, |r| self.value(r * r) * r * r)
    }

    /// Returns the variance along each axis, in voxels^2.
    #[must_use]
    pub fn variance(&self) -> f64 {
        let fourth = 4.0 * PI * integrate(0.0, self.radius(), 64, |r| self.value(r * r) * r.powi(4));
        fourth / (3.0 * self.integral())
    }

    /// Returns the integral along the line at distance `r` from the centre, up to `t` past its closest point (voxels):
    /// the cumulative footprint F(r, t) = integral from -inf to t of h(sqrt(r^2 + u^2)) du.
    ///
    /// Integrated numerically to about 1e-13, as a truth for the sections of a [`FootprintTable`].
    #[cfg(test)]
    pub(crate) fn cumulative_footprint(&self, r: f64, t: f64) -> f64 {
        let half_chord = (self.radius() * self.radius() - r * r).max(0.0).sqrt();
        let end = t.clamp(-half_chord, half_chord);
        integrate(-half_chord, end, 64, |u| self.value(r * r + u * u))
    }
}

/// Writes the spelling of `--kernel`.
impl fmt::Display for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Gaussian { sigma, radius } => write!(f, "gaussian:{sigma},{radius}"),
            Self::KAISER_BESSEL => f.write_str("kaiser-bessel"),
            Self::KaiserBessel { radius, alpha } => write!(f, "kaiser-bessel:{radius},{alpha}"),
        }
    }
}

/// The divisor N of the sum of kernels in f(x) = sum f_j h / N.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Normalization {
    /// N is the kernel's integral: a constant field of 1 is reconstructed as 1 on average and integrates to path
    /// length.
    #[default]
    Unit,
    /// N is 1, the kernel's peak. Historical: the volume is denser by the kernel's integral.
    Peak,
}

named! { "normalization", Normalization { Unit: "unit", Peak: "peak" } }

impl Normalization {
    /// Returns the divisor N of a kernel.
    #[must_use]
    pub(crate) fn divisor(self, kernel: &Kernel) -> f64 {
        match self {
            Self::Unit => kernel.integral(),
            Self::Peak => 1.0,
        }
    }

    /// Returns the ratio of sums of a kernel to sums with [`Self::Unit`].
    pub(crate) fn density(self, kernel: &Kernel) -> f64 {
        kernel.integral() / self.divisor(kernel)
    }
}

/// Returns I_2(z) / z^2 from z^2, of either sign: the series sum_k (z^2/4)^k / (4 k! (k+2)!) (Abramowitz and Stegun
/// 9.6.10).
fn bessel_i2_over_z2(z2: f64) -> f64 {
    let q = z2 / 4.0;
    let mut term: f64 = 1.0 / 8.0;
    let mut sum = term;
    let mut k = 1.0;
    while term.abs() > sum.abs() * 1e-17 {
        term *= q / (k * (k + 2.0));
        sum += term;
        k += 1.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrals_are_those_of_the_literature() {
        assert!((Kernel::default().integral() - 11.6317).abs() < 5e-5);
        // Untruncated: (2 pi)^(3/2).
        let wide = Kernel::Gaussian { sigma: 1.0, radius: 12.0 };
        assert!((wide.integral() - (2.0 * PI).powf(1.5)).abs() < 1e-10);
    }

    #[test]
    fn bessel_series_matches_tabulated_values() {
        // Abramowitz and Stegun, table 9.8: I_2(1) = 0.1357476698, I_2(10) = 2281.518968.
        assert!((bessel_i2_over_z2(1.0) - 0.135_747_669_8).abs() < 1e-10);
        assert!((bessel_i2_over_z2(100.0) * 100.0 - 2_281.518_968).abs() < 1e-5);
    }

    #[test]
    fn peak_is_one_and_outside_is_zero() {
        for kernel in [Kernel::default(), Kernel::KAISER_BESSEL] {
            assert!((kernel.value(0.0) - 1.0).abs() < 1e-15);
            assert!(kernel.value(4.0 + 1e-9) == 0.0);
        }
    }

    #[test]
    fn footprint_of_a_wide_gaussian_is_a_gaussian() {
        let wide = Kernel::Gaussian { sigma: 1.0, radius: 10.0 };
        for r in [0.0, 0.5, 1.7] {
            let expected = (2.0 * PI).sqrt() * (-r * r / 2.0_f64).exp();
            assert!((wide.cumulative_footprint(r, 20.0) - expected).abs() < 1e-11);
            assert!((wide.cumulative_footprint(r, 0.0) - expected / 2.0).abs() < 1e-11);
        }
    }
}
