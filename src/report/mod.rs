//! Stand-in: pictures compared.

use std::fmt;

use serde::Serialize;

use crate::error::{Error, Result};
use crate::image::Image;

/// How two pictures differ.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Largest difference.
    pub max: f64,
    /// Root mean square.
    pub rms: f64,
    /// Decibels.
    pub psnr: f64,
    /// Pixels over the tolerance.
    pub outliers: u64,
    /// Their share.
    pub outlier_fraction: f64,
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "max {} rms {} psnr {} outliers {}", self.max, self.rms, self.psnr, self.outliers)
    }
}

/// Compares two pictures.
///
/// # Errors
/// [`Error::Compare`] where the sizes differ.
pub fn compare(a: &Image, b: &Image, tolerance: f64) -> Result<Comparison> {
    if (a.width(), a.height()) != (b.width(), b.height()) {
        return Err(Error::Compare(format!(
            "{} x {} against {} x {} pixels",
            a.width(),
            a.height(),
            b.width(),
            b.height()
        )));
    }
    let (mut max, mut sum, mut outliers) = (0.0_f64, 0.0_f64, 0);
    for (a, b) in a.pixels().iter().zip(b.pixels()) {
        let worst = (0..4).map(|c| f64::from((a[c] - b[c]).abs())).fold(0.0, f64::max);
        max = max.max(worst);
        sum += worst * worst;
        outliers += u64::from(worst > tolerance);
    }
    let count = a.pixels().len() as f64;
    let rms = (sum / count).sqrt();
    Ok(Comparison { max, rms, psnr: -20.0 * rms.log10(), outliers, outlier_fraction: outliers as f64 / count })
}

/// The difference as a picture.
#[must_use]
pub fn difference_picture(a: &Image, b: &Image, gain: f64) -> Image {
    let mut out = a.clone();
    for (o, b) in out.pixels_mut().iter_mut().zip(b.pixels()) {
        *o =
            [0, 1, 2].map(|c| (o[c] - b[c]).abs() * gain as f32).into_iter().chain([1.0]).fold([0.0; 4], |mut p, v| {
                p.rotate_left(1);
                p[3] = v;
                p
            });
    }
    out
}
