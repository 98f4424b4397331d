//! The command `voxsplat compare`.

use serde::Serialize;
use voxsplat::image::{self, Background, Comparison, Image};

use super::args::CompareArgs;
use super::failure::{Failure, fail};
use super::output;
use super::report::{self, Choices};

/// The factor of the difference picture: it makes one step of 8 bits visible.
const GAIN: f64 = 10.0;

/// A comparison against its limits.
#[derive(Serialize)]
struct Verdict {
    #[serde(flatten)]
    comparison: Comparison,
    max_outliers: Option<f64>,
    max_rms: Option<f64>,
    min_psnr: Option<f64>,
    /// The limits that the pictures exceed, in words.
    exceeded: Vec<String>,
}

/// Compares two pictures. The exit code is that of `diff`: 1 if the pictures differ, 2 if they cannot be compared.
pub(crate) fn run(args: &CompareArgs) -> Result<(), Failure> {
    let exceeded = compared(args).map_err(|failure| Failure { code: 2, ..failure })?;
    if exceeded.is_empty() {
        return Ok(());
    }
    fail(format!("{} and {} differ {}", args.a.display(), args.b.display(), exceeded.join("; ")))
}

/// Compares two pictures, prints the result and returns the limits that they exceed.
fn compared(args: &CompareArgs) -> Result<Vec<String>, Failure> {
    if let Some(path) = &args.difference {
        Image::check_output(path).map_err(|e| Failure::usage(format!("{e:#}")))?;
    }
    let (a, b) = (Image::load(&args.a)?, Image::load(&args.b)?);
    let comparison = image::compare(&a, &b, args.tolerance.unwrap_or_default())?;
    if let Some(path) = &args.difference {
        image::difference_picture(&a, &b, GAIN)?.save(path, Background::default())?;
    }
    let exceeded = exceeded(args, &comparison);
    if !output::is_json() {
        output::print(&format!("{}\n", comparison.to_string().trim_end()))?;
    }
    let CompareArgs { max_outliers, max_rms, min_psnr, .. } = *args;
    let verdict = Verdict { comparison, max_outliers, max_rms, min_psnr, exceeded };
    report::print(Choices::default(), &args.difference, &verdict)?;
    Ok(verdict.exceeded)
}

/// Returns the limits that a comparison exceeds, in words. All limits that are given must hold. Without a limit of the
/// whole picture, single pixels are limited even if no option says so.
fn exceeded(args: &CompareArgs, comparison: &Comparison) -> Vec<String> {
    let CompareArgs { tolerance, max_outliers, max_rms, min_psnr, .. } = *args;
    let Comparison { outliers, outlier_fraction, max, rms, psnr, .. } = *comparison;
    let limits_pixels = tolerance.is_some() || max_outliers.is_some() || (max_rms.is_none() && min_psnr.is_none());
    let mut exceeded = Vec::new();
    if limits_pixels && outlier_fraction > max_outliers.unwrap_or_default() {
        let limit = max_outliers.map(|limit| format!(" ({outlier_fraction:.2e} of all, over --max-outliers {limit})"));
        exceeded.push(format!(
            "by more than {} in {outliers} pixels{}, at most by {max:.6}",
            comparison.tolerance,
            limit.unwrap_or_default()
        ));
    }
    exceeded
        .extend(max_rms.filter(|limit| rms > *limit).map(|limit| format!("by {rms:.3e} rms, over --max-rms {limit}")));
    exceeded.extend(
        min_psnr.filter(|limit| psnr < *limit).map(|limit| format!("by {psnr:.1} dB, under --min-psnr {limit}")),
    );
    exceeded
}
