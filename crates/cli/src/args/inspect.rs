//! Descriptions of volumes, comparisons of pictures.

use std::path::PathBuf;

use super::input::InputArgs;
use crate::parse;

/// Show the properties of a volume file, its histogram, and the command line that renders it.
#[derive(Debug, clap::Args)]
pub(crate) struct InfoArgs {
    #[command(flatten)]
    pub(crate) input: InputArgs,
    /// List labels with their colours, voxels and volumes in place of the rest
    #[arg(long, help_heading = "Labels")]
    pub(crate) labels: bool,
    /// Names, colours and opacities of labels, as for render
    #[arg(long, value_name = "FILE", requires = "labels", help_heading = "Labels")]
    pub(crate) label_table: Option<PathBuf>,
}

/// Compare two pictures. The exit code is 0 if they keep all limits, 1 if they differ, 2 if they cannot be compared.
///
/// All limits that are given must hold. --tolerance and --max-outliers limit single pixels, --max-rms and --min-psnr
/// the whole picture. Without any, no pixel may differ; with limits of the whole picture alone, single pixels may.
#[derive(Debug, clap::Args)]
pub(crate) struct CompareArgs {
    /// A picture, .png or .exr
    pub(crate) a: PathBuf,
    /// A picture of the same size
    pub(crate) b: PathBuf,
    /// Largest tolerated difference of a channel; channels run from 0 to 1, so an 8-bit step is 0.00392 [default: 0]
    #[arg(long, value_name = "T", value_parser = parse::tolerance)]
    pub(crate) tolerance: Option<f64>,
    /// Largest tolerated share of pixels that differ by more than --tolerance, 0 to 1 [default: 0]
    #[arg(long, value_name = "SHARE", value_parser = parse::share)]
    pub(crate) max_outliers: Option<f64>,
    /// Largest tolerated root mean square of all differences
    #[arg(long, value_name = "RMS", value_parser = parse::tolerance)]
    pub(crate) max_rms: Option<f64>,
    /// Least tolerated peak signal-to-noise ratio, dB: -20 log10(rms); inf tolerates no difference
    #[arg(long, value_name = "DB", value_parser = parse::decibels)]
    pub(crate) min_psnr: Option<f64>,
    /// Write the difference, multiplied by ten, as a picture
    #[arg(long, value_name = "FILE")]
    pub(crate) difference: Option<PathBuf>,
}
