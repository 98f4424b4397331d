//! Settings as text: the spellings of options, scenes and Python.

use std::str::FromStr;

use crate::error::{Error, Result};
use crate::kernel::Kernel;
use crate::settings::Level;
use crate::settings::response::Response;

/// Returns numbers parted by commas; `None` if there are not `N`.
pub(crate) fn list<T: FromStr, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Option<Vec<T>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

/// Returns finite numbers parted by commas; `None` if there are not `N`.
pub(crate) fn finite<const N: usize>(text: &str) -> Option<[f64; N]> {
    list(text).filter(|numbers: &[f64; N]| numbers.iter().all(|number| number.is_finite()))
}

/// Returns a value, or an error of a setting that names the expected one.
pub(crate) fn expect<T>(setting: &'static str, value: Option<T>, expected: &str) -> Result<T> {
    value.ok_or_else(|| Error::setting(setting, format!("expected {expected}")))
}

/// Parses `NAME` or `NAME:NUMBER,NUMBER`.
fn name_and_pair<'a>(setting: &'static str, text: &'a str) -> Result<(&'a str, Option<[f64; 2]>)> {
    let Some((name, numbers)) = text.split_once(':') else { return Ok((text, None)) };
    let pair = expect(setting, list(numbers), &format!("two numbers after {name}:, found {numbers:?}"))?;
    Ok((name, Some(pair)))
}

impl FromStr for Kernel {
    type Err = Error;

    /// Parses `gaussian[:SIGMA,RADIUS]` or `kaiser-bessel[:RADIUS,ALPHA]`, lengths in voxels.
    fn from_str(text: &str) -> Result<Self> {
        let kernel = match name_and_pair("kernel", text)? {
            ("gaussian", None) => Self::default(),
            ("gaussian", Some([sigma, radius])) => Self::Gaussian { sigma, radius },
            ("kaiser-bessel", None) => Self::KAISER_BESSEL,
            ("kaiser-bessel", Some([radius, alpha])) => Self::KaiserBessel { radius, alpha },
            _ => return expect("kernel", None, "gaussian[:SIGMA,RADIUS] or kaiser-bessel[:RADIUS,ALPHA]"),
        };
        kernel.validate().map(|()| kernel)
    }
}

impl FromStr for Response {
    type Err = Error;

    /// Parses `absorption`, `depth`, `window[:LOW,HIGH]` or `film[:EXPOSURE,GAMMA]`.
    fn from_str(text: &str) -> Result<Self> {
        let response = match name_and_pair("response", text)? {
            ("absorption", None) => Self::Absorption,
            ("depth", None) => Self::Depth,
            ("window", None) => Self::WINDOW,
            ("window", Some([low, high])) => Self::Window { low, high },
            ("film", None) => Self::FILM,
            ("film", Some([exposure, gamma])) => Self::Film { exposure, gamma },
            _ => return expect("response", None, "absorption, depth, window[:LOW,HIGH] or film[:EXPOSURE,GAMMA]"),
        };
        response.validate().map(|()| response)
    }
}

impl FromStr for Level {
    type Err = Error;

    /// Parses `auto` or a number.
    fn from_str(text: &str) -> Result<Self> {
        match text {
            "auto" => Ok(Self::Auto),
            _ => expect("level", text.parse().ok().map(Self::At), "auto, or a number from 0 to 12"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels() {
        let kernel = |text: &str| text.parse::<Kernel>();
        assert_eq!(kernel("gaussian").unwrap(), Kernel::default());
        assert_eq!(kernel("gaussian:0.7,2.5").unwrap(), Kernel::Gaussian { sigma: 0.7, radius: 2.5 });
        assert_eq!(kernel("kaiser-bessel:2,8").unwrap(), Kernel::KaiserBessel { radius: 2.0, alpha: 8.0 });
        for (bad, expected) in [
            ("box", "expected gaussian[:SIGMA,RADIUS]"),
            ("gaussian:", "expected two numbers"),
            ("gaussian:1", "expected two numbers"),
            ("gaussian:0,2", "sigma"),
            ("kaiser-bessel:99,2", "radius"),
            ("gaussian:nan,1", "sigma"),
        ] {
            let error = kernel(bad).unwrap_err().to_string();
            assert!(error.contains(expected), "{bad}: {error}");
        }
    }

    #[test]
    fn responses() {
        let response = |text: &str| text.parse::<Response>();
        for given in [Response::Absorption, Response::Depth, Response::WINDOW, Response::FILM] {
            assert_eq!(response(&given.to_string()).unwrap(), given);
        }
        assert_eq!(response("film").unwrap(), Response::FILM);
        for (bad, expected) in [
            ("white", "expected absorption, depth"),
            ("depth:1,2", "expected absorption, depth"),
            ("window:4,1", "the lower one first"),
            ("film:0,3", "an exposure of 0"),
            ("film:8", "expected two numbers"),
        ] {
            let error = response(bad).unwrap_err().to_string();
            assert!(error.contains(expected), "{bad}: {error}");
        }
    }
}
