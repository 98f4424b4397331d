//! Differences of pictures, on premultiplied RGBA as composited; alpha counts like the colours.
//!
//! Scale of differences: 1/255 = 3.9e-3 is one step of an 8-bit channel, which is invisible. A difference up to 1e-3
//! cannot change an 8-bit picture by more than one step. 1e-6 is the rounding of f32.

use std::fmt;

use serde::{Serialize, Serializer};

use super::Image;
use crate::error::{Error, Result};
use voxsplat_volume::memory::reserved;
use voxsplat_volume::names::readable;

/// The result of a comparison of two pictures. d stands for the differences of all channels of all pixels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Width and height of both pictures, pixels.
    pub size: [u32; 2],
    /// The maximum of |d|; infinite if either picture has a value that is not finite.
    #[serde(serialize_with = "finite_or_text")]
    pub max: f64,
    /// The maxima of |d| for red, green, blue and alpha.
    pub max_channel: [f64; 4],
    /// The mean of |d|.
    pub mean: f64,
    /// The root mean square sqrt(mean d^2) over all pixels.
    pub rms: f64,
    /// Number of pixels that either picture covers: alpha is over 0, or NaN. An opaque picture covers all of its
    /// pixels.
    pub covered: u64,
    /// The root mean square sqrt(mean d^2) over all four channels of the covered pixels only; 0 if there are none.
    ///
    /// Unlike `rms` it does not fall when the same volume is drawn with more empty space around it.
    #[serde(serialize_with = "finite_or_text")]
    pub rms_covered: f64,
    /// The bound of the largest |d| of a pixel's channels in 99.9 % of the covered pixels; 0 if there are none. For
    /// fewer than 1000 pixels it is the largest.
    #[serde(serialize_with = "finite_or_text")]
    pub p999: f64,
    /// The peak signal-to-noise ratio -20 log10(rms) dB, relative to a signal of 1; infinite if the pictures are equal.
    #[serde(serialize_with = "finite_or_text")]
    pub psnr: f64,
    /// The largest difference of a channel that is tolerated.
    pub tolerance: f64,
    /// Number of pixels with a channel that differs by more than the tolerance.
    pub outliers: u64,
    /// `outliers` as a fraction of all pixels, 0 to 1.
    pub outlier_fraction: f64,
    /// Column and row, from the top left, of the pixel that differs most.
    pub worst: [u32; 2],
}

/// Writes an infinite number as the text "inf" or "-inf", because JSON has no infinity. A PSNR is -inf if a picture has
/// NaN.
fn finite_or_text<S: Serializer>(value: &f64, serializer: S) -> std::result::Result<S::Ok, S::Error> {
    if value.is_finite() { serializer.serialize_f64(*value) } else { serializer.serialize_str(&value.to_string()) }
}

/// Compares two pictures of the same size. A pixel is an outlier if a channel differs by more than `tolerance`.
///
/// A value that is not finite in either picture differs infinitely, even from itself: NaN never matches.
///
/// ```
/// use voxsplat::image::{Image, compare};
///
/// let a = Image::new(2, 1, vec![[0.0; 4], [0.5, 0.5, 0.5, 1.0]])?;
/// let b = Image::new(2, 1, vec![[0.0; 4], [0.5, 0.5, 0.25, 1.0]])?;
/// let comparison = compare(&a, &b, 0.01)?;
/// assert_eq!((comparison.max, comparison.outliers, comparison.worst), (0.25, 1, [1, 0]));
/// // One pixel is covered: sqrt(0.25^2 / 4).
/// assert_eq!((comparison.covered, comparison.rms_covered), (1, 0.125));
/// # Ok::<(), voxsplat::error::Error>(())
/// ```
///
/// # Errors
/// [`Error::Compare`] if the sizes differ or the pictures have no pixels.
pub fn compare(a: &Image, b: &Image, tolerance: f64) -> Result<Comparison> {
    check_sizes(a, b)?;
    let (mut max_channel, mut sum, mut squares) = ([0.0_f64; 4], 0.0, 0.0);
    let (mut outliers, mut max, mut worst) = (0, 0.0, 0);
    let (mut differences, mut squares_covered) = (Vec::new(), 0.0);
    for (index, (p, q)) in a.pixels().iter().zip(b.pixels()).enumerate() {
        let mut pixel = 0.0_f64;
        let mut pixel_squares = 0.0;
        for c in 0..4 {
            let d = difference(p[c], q[c]);
            max_channel[c] = max_channel[c].max(d);
            sum += d;
            pixel_squares += d * d;
            pixel = pixel.max(d);
        }
        squares += pixel_squares;
        if is_covered(p, q) {
            differences.push(pixel);
            squares_covered += pixel_squares;
        }
        outliers += u64::from(pixel > tolerance);
        if pixel > max {
            (max, worst) = (pixel, index);
        }
    }
    let count = (a.pixels().len() * 4) as f64;
    let rms = (squares / count).sqrt();
    let width = a.width() as usize;
    let covered = differences.len() as u64;
    Ok(Comparison {
        size: [a.width(), a.height()],
        max,
        max_channel,
        mean: sum / count,
        rms,
        covered,
        rms_covered: (squares_covered / (4 * covered.max(1)) as f64).sqrt(),
        p999: percentile(&mut differences, 0.999),
        psnr: -20.0 * libm::log10(rms),
        tolerance,
        outliers,
        outlier_fraction: outliers as f64 / a.pixels().len() as f64,
        worst: [(worst % width) as u32, (worst / width) as u32],
    })
}

/// Returns the largest difference of a channel for each pixel that either picture covers.
///
/// # Errors
/// [`Error::Compare`] if the sizes differ or the pictures have no pixels.
pub(crate) fn covered_differences(a: &Image, b: &Image) -> Result<Vec<f64>> {
    check_sizes(a, b)?;
    let pairs = a.pixels().iter().zip(b.pixels()).filter(|(p, q)| is_covered(p, q));
    let largest = |(p, q): (&[f32; 4], &[f32; 4])| (0..4).map(|c| difference(p[c], q[c])).fold(0.0, f64::max);
    Ok(pairs.map(largest).collect())
}

/// Returns whether either pixel has an alpha over 0, or NaN.
fn is_covered(p: &[f32; 4], q: &[f32; 4]) -> bool {
    [p[3], q[3]].iter().any(|alpha| *alpha > 0.0 || alpha.is_nan())
}

/// Returns the smallest of some numbers that a fraction of them does not exceed; 0 if there are none.
pub(crate) fn percentile(numbers: &mut [f64], fraction: f64) -> f64 {
    let rank = (fraction * numbers.len() as f64).ceil() as usize;
    match rank.checked_sub(1) {
        Some(index) if index < numbers.len() => *numbers.select_nth_unstable_by(index, f64::total_cmp).1,
        _ => 0.0,
    }
}

/// Returns an opaque picture of the differences of red, green and blue, times `gain`. The difference of alpha is added
/// to each of them, so a difference of alpha alone appears as gray.
///
/// # Errors
/// [`Error::Compare`] if the sizes differ or the pictures have no pixels; [`Error::Memory`] if there is no memory for
/// the picture.
pub fn difference_picture(a: &Image, b: &Image, gain: f64) -> Result<Image> {
    check_sizes(a, b)?;
    let mut pixels = reserved(a.pixels().len() as u64, || "the picture of the difference".to_owned())?;
    pixels.extend(a.pixels().iter().zip(b.pixels()).map(|(p, q)| {
        let shown = |c: usize| ((difference(p[c], q[c]) + difference(p[3], q[3])) * gain).min(1.0) as f32;
        [shown(0), shown(1), shown(2), 1.0]
    }));
    Image::new(a.width(), a.height(), pixels)
}

fn difference(a: f32, b: f32) -> f64 {
    let d = (f64::from(a) - f64::from(b)).abs();
    if d.is_finite() { d } else { f64::INFINITY }
}

fn check_sizes(a: &Image, b: &Image) -> Result<()> {
    if (a.width(), a.height()) == (b.width(), b.height()) && !a.pixels().is_empty() {
        return Ok(());
    }
    Err(Error::Compare(format!(
        "the pictures are {} x {} and {} x {} pixels",
        a.width(),
        a.height(),
        b.width(),
        b.height()
    )))
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [r, g, b, a] = self.max_channel;
        writeln!(f, "pixels    {} x {}", self.size[0], self.size[1])?;
        writeln!(f, "max       {:.3e} at ({}, {})", self.max, self.worst[0], self.worst[1])?;
        writeln!(f, "  r g b a {r:.3e} {g:.3e} {b:.3e} {a:.3e}")?;
        writeln!(f, "mean      {:.3e}", self.mean)?;
        writeln!(f, "rms       {:.3e}", self.rms)?;
        writeln!(f, "covered   {} pixels, rms {:.3e}", self.covered, self.rms_covered)?;
        writeln!(f, "99.9 %    {:.3e}", self.p999)?;
        writeln!(f, "psnr      {:.1} dB", self.psnr)?;
        writeln!(
            f,
            "outliers  {} pixels over {:.3e} ({} %)",
            self.outliers,
            self.tolerance,
            readable(100.0 * self.outlier_fraction)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(values: &[[f32; 4]]) -> Image {
        Image::new(values.len() as u32, 1, values.to_vec()).unwrap()
    }

    #[test]
    fn measures_follow_their_formulas() {
        let a = image(&[[0.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.5, 1.0]]);
        let b = image(&[[0.0, 0.0, 0.0, 0.25], [0.5, 0.25, 0.5, 0.5]]);
        let c = compare(&a, &b, 0.3).unwrap();
        assert_eq!((c.max, c.worst, c.outliers), (0.5, [1, 0], 1));
        assert_eq!(c.max_channel, [0.0, 0.25, 0.0, 0.5]);
        assert!((c.mean - 1.0 / 8.0).abs() < 1e-12);
        assert!((c.rms - (0.375_f64 / 8.0).sqrt()).abs() < 1e-12);
        assert!((c.psnr + 20.0 * c.rms.log10()).abs() < 1e-12);
    }

    #[test]
    fn pixels_that_neither_picture_covers_do_not_dilute_the_rms() {
        let (clear, half) = ([0.0; 4], [0.25, 0.25, 0.25, 0.5]);
        let a = image(&[clear, clear, clear, half]);
        let b = image(&[clear, clear, half, half]);
        let c = compare(&a, &b, 0.0).unwrap();
        let square: f64 = 3.0 * 0.0625 + 0.25;
        assert_eq!(c.covered, 2);
        assert!((c.rms_covered - (square / 8.0).sqrt()).abs() < 1e-12);
        assert!((c.rms - (square / 16.0).sqrt()).abs() < 1e-12);
        assert!(c.to_string().contains("covered   2 pixels, rms 2.339e-1"), "{c}");
        let nothing = compare(&image(&[clear]), &image(&[clear]), 0.0).unwrap();
        assert_eq!((nothing.covered, nothing.rms_covered), (0, 0.0));
    }

    #[test]
    fn one_covered_pixel_in_a_thousand_may_differ_more() {
        let truth = image(&[[0.5, 0.5, 0.5, 1.0]; 2000]);
        let mut other = truth.clone();
        for (i, pixel) in other.pixels_mut().iter_mut().enumerate() {
            pixel[1] += [0.25, 0.125, 0.0625][i.min(2)];
        }
        assert_eq!(compare(&truth, &other, 0.0).unwrap().p999, 0.0625);
        let few = image(&[[0.5, 0.5, 0.5, 1.0]; 2]);
        other = image(&[[0.5, 0.5, 0.5, 1.0], [0.5, 0.75, 0.5, 1.0]]);
        assert_eq!(compare(&few, &other, 0.0).unwrap().p999, 0.25);
        assert_eq!(percentile(&mut [], 0.5), 0.0);
    }

    #[test]
    fn equal_pictures_have_no_difference() {
        let a = image(&[[0.1, 0.2, 0.3, 0.4]]);
        let c = compare(&a, &a, 0.0).unwrap();
        assert_eq!((c.max, c.outliers), (0.0, 0));
        assert!(c.psnr.is_infinite() && serde_json::to_string(&c).unwrap().contains("\"inf\""));
    }

    #[test]
    fn nan_never_matches() {
        let a = image(&[[f32::NAN, 0.0, 0.0, 0.0]]);
        let c = compare(&a, &a, 1e9).unwrap();
        assert!(c.max.is_infinite() && c.outliers == 1);
        // "-inf" is the worst PSNR; "inf" is that of equal pictures.
        assert!(serde_json::to_string(&c).unwrap().contains("\"psnr\":\"-inf\""));
    }

    #[test]
    fn sizes_must_match() {
        let error = compare(&image(&[[0.0; 4]]), &image(&[[0.0; 4]; 2]), 0.0).unwrap_err().to_string();
        assert_eq!(error, "cannot compare: the pictures are 1 x 1 and 2 x 1 pixels");
    }

    #[test]
    fn difference_picture_shows_alpha_as_gray() {
        let d = difference_picture(&image(&[[0.0; 4]]), &image(&[[0.0, 0.0, 0.0, 0.05]]), 10.0).unwrap();
        assert!(d.pixels()[0].iter().take(3).all(|v| (v - 0.5).abs() < 1e-6));
    }
}
