//! The responses of an X-ray: from optical depth to pixels.

use std::f64::consts::LN_10;
use std::fmt;

use crate::error::{Error, Result};
use crate::transfer::color::from_linear;

/// The pixel of an X-ray as a function of optical depth, the integral of extinction along the ray. A beam of intensity
/// 1 leaves with the intensity exp(-depth).
///
/// All responses but [`Self::Depth`] are white with an alpha that rises from 0 to 1 with the depth.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub enum Response {
    /// The absorbed share of the beam: alpha = 1 - exp(-depth).
    #[default]
    Absorption,
    /// The optical depth itself in red, green and blue, unbounded; alpha = 1 - exp(-depth). For measurements, in an
    /// EXR.
    Depth,
    /// A window of depth, as in digital radiographs: black up to `low`, white from `high` on, linear between.
    Window {
        /// The largest depth of a black pixel, 0 or more.
        low: f64,
        /// The smallest depth of a white pixel, at most 1e6.
        high: f64,
    },
    /// Film on a light box. Its density is D = 3 / (1 + E^(-4 gamma / (3 ln 10))), E the exposure times exp(-depth):
    /// the characteristic curve of Hurter and Driffield. With T(depth) = 10^-D the transmitted light, a pixel has the
    /// display value (sRGB) of (T - T(0)) / (1 - T(0)): black if nothing absorbs, white if the film is clear.
    Film {
        /// The exposure by the whole beam, relative to the exposure that makes half of the largest density, 1 to 1e6.
        /// A larger exposure shows deeper matter.
        exposure: f64,
        /// The contrast: the slope of density over the decimal logarithm of exposure, at half of the largest density,
        /// 0.1 to 20.
        gamma: f64,
    },
}

/// The largest density of film above the density of clear film; `DENSITY` in shaders/common/response.wgsl is its
/// natural logarithm.
const DENSITY: f64 = 3.0;

impl Response {
    /// The window of depths from 0 to 4.
    pub const WINDOW: Self = Self::Window { low: 0.0, high: 4.0 };
    /// Film of ordinary contrast, which shows depths of about 1 to 3.
    pub const FILM: Self = Self::Film { exposure: 4.0, gamma: 3.0 };

    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// [`Error::Setting`] that names the parameter.
    pub fn validate(&self) -> Result<()> {
        let refused = |reason: String| Err(Error::Setting { name: "response", reason });
        match *self {
            Self::Window { low, high } if !(low >= 0.0 && low < high && high <= 1e6) => {
                refused(format!("a window from {low} to {high}, expected depths of 0 to 1e6, the lower one first"))
            }
            Self::Film { exposure, .. } if !(1.0..=1e6).contains(&exposure) => {
                refused(format!("an exposure of {exposure}, expected 1 to 1e6"))
            }
            Self::Film { gamma, .. } if !(0.1..=20.0).contains(&gamma) => {
                refused(format!("a gamma of {gamma}, expected 0.1 to 20"))
            }
            _ => Ok(()),
        }
    }

    /// Returns the constants RESPONSE and `curve` of shaders/common/response.wgsl.
    pub(crate) fn for_shaders(&self) -> (u32, [f32; 4]) {
        let (kind, curve) = match *self {
            Self::Absorption => (1, [0.0; 4]),
            Self::Depth => (2, [0.0; 4]),
            Self::Window { low, high } => (3, [low, 1.0 / (high - low), 0.0, 0.0]),
            Self::Film { exposure, gamma } => {
                let steepness = steepness(gamma);
                let fog = passed(0.0, exposure, gamma);
                (4, [steepness, steepness * libm::log(exposure), fog, 1.0 / (1.0 - fog)])
            }
        };
        (kind, curve.map(|c| c as f32))
    }

    /// Returns the pixel of an optical depth: premultiplied red, green, blue and alpha.
    #[must_use]
    pub fn pixel(&self, depth: f64) -> [f64; 4] {
        let absorbed = -libm::expm1(-depth);
        match *self {
            Self::Absorption => [absorbed; 4],
            Self::Depth => [depth, depth, depth, absorbed],
            Self::Window { low, high } => [((depth - low) / (high - low)).clamp(0.0, 1.0); 4],
            Self::Film { exposure, gamma } => {
                let fog = passed(0.0, exposure, gamma);
                let light = (passed(depth, exposure, gamma) - fog) / (1.0 - fog);
                [from_linear(light.clamp(0.0, 1.0)); 4]
            }
        }
    }
}

/// Returns the exponent of the exposure in the density.
fn steepness(gamma: f64) -> f64 {
    4.0 * gamma / (DENSITY * LN_10)
}

/// Returns the share of light that passes film behind an optical depth.
fn passed(depth: f64, exposure: f64, gamma: f64) -> f64 {
    let density = DENSITY / (1.0 + libm::exp(steepness(gamma) * (depth - libm::log(exposure))));
    libm::exp(-LN_10 * density)
}

/// Writes the spelling of `--response`.
impl fmt::Display for Response {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Absorption => f.write_str("absorption"),
            Self::Depth => f.write_str("depth"),
            Self::Window { low, high } => write!(f, "window:{low},{high}"),
            Self::Film { exposure, gamma } => write!(f, "film:{exposure},{gamma}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn responses_rise_from_black_to_white() {
        for response in [Response::Absorption, Response::WINDOW, Response::FILM] {
            let values: Vec<f64> = (0..100).map(|i| response.pixel(f64::from(i) / 2.0)[3]).collect();
            assert!(values[0] == 0.0 && values[99] > 0.999, "{response}: {} to {}", values[0], values[99]);
            assert!(values.windows(2).all(|pair| pair[0] <= pair[1]), "{response}");
        }
        assert_eq!(Response::Depth.pixel(30.0), [30.0, 30.0, 30.0, -(-30.0_f64).exp_m1()]);
        assert_eq!(Response::Window { low: 1.0, high: 3.0 }.pixel(1.5), [0.25; 4]);
    }

    #[test]
    fn film_has_its_density_and_its_contrast() {
        let (exposure, gamma) = (20.0_f64, 2.5);
        let density = |depth: f64| -passed(depth, exposure, gamma).log10();
        let middle = exposure.ln();
        assert!((density(middle) - DENSITY / 2.0).abs() < 1e-12);
        // A decade of exposure is a depth of ln 10.
        let slope = (density(middle - 1e-4) - density(middle + 1e-4)) / 2e-4 * LN_10;
        assert!((slope - gamma).abs() < 1e-6, "{slope}");
        assert!(density(40.0) < 1e-9 && (density(-40.0) - DENSITY).abs() < 1e-9);
    }

    #[test]
    fn what_is_out_of_range_is_refused() {
        for bad in [
            Response::Window { low: 2.0, high: 2.0 },
            Response::Window { low: -1.0, high: 2.0 },
            Response::Window { low: 0.0, high: f64::INFINITY },
            Response::Film { exposure: 0.5, gamma: 3.0 },
            Response::Film { exposure: 8.0, gamma: f64::NAN },
        ] {
            let error = bad.validate().unwrap_err().to_string();
            assert!(error.starts_with("response: ") && error.contains(", expected "), "{bad}: {error}");
        }
        for good in [Response::Absorption, Response::Depth, Response::WINDOW, Response::FILM] {
            good.validate().unwrap();
        }
    }
}
