//! What is shown as text: volumes, kernels, comparisons.

use std::path::PathBuf;

use voxsplat::kernel::Kernel;
use voxsplat::reconstruction::Signal;

use super::input::InputArgs;
use crate::cli::parse::{self, one_of};

/// Show the properties of a volume file, its histogram, and the command line that renders it.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct InfoArgs {
    #[command(flatten)]
    pub(in crate::cli) input: InputArgs,
    /// List labels with their colours, voxels and volumes in place of the rest
    #[arg(long, help_heading = "Labels")]
    pub(in crate::cli) labels: bool,
    /// Names, colours and opacities of labels, as for render
    #[arg(long, value_name = "FILE", requires = "labels", help_heading = "Labels")]
    pub(in crate::cli) label_table: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long, help_heading = "Output")]
    pub(in crate::cli) json: bool,
}

const KERNELS_EXAMPLES: &str = "\
Examples:
  voxsplat kernels
  voxsplat kernels --signal shepp-logan --size 64
  voxsplat kernels --kernel gaussian:0.7,2 --sharpness 0.5 --json";

/// Show how well kernels reconstruct a signal that is known everywhere, with the usual interpolations beside them.
///
/// Errors of the field are at points at least a voxel inside the outermost samples; errors of rays are of its mean
/// along rays through that box. Ripple is the largest less the least value of a field of samples that are all 1. Blur
/// is a variance along an axis, in voxels^2. Half Nyquist is what is left of waves that are four samples long. Noise
/// is that of the field over that of the samples.
#[derive(Debug, clap::Args)]
#[command(after_help = KERNELS_EXAMPLES)]
pub(in crate::cli) struct KernelsArgs {
    /// The signal: marschner-lobb, gaussians or shepp-logan
    #[arg(long, value_name = "SIGNAL", default_value = "marschner-lobb",
        value_parser = one_of(Signal::ALL, Signal::name))]
    pub(in crate::cli) signal: Signal,
    /// Samples along each axis, 8 to 256
    #[arg(long, value_name = "N", default_value_t = 40)]
    pub(in crate::cli) size: u32,
    /// The kernel, as for render [default: gaussian and kaiser-bessel]
    #[arg(long, value_name = "KERNEL", value_parser = parse::kernel)]
    pub(in crate::cli) kernel: Option<Kernel>,
    /// The sharpness, 0 to 1 [default: 0, 0.5 and 1]
    #[arg(long, value_name = "S", value_parser = parse::number, allow_hyphen_values = true)]
    pub(in crate::cli) sharpness: Option<f64>,
    /// Print a JSON array of objects
    #[arg(long)]
    pub(in crate::cli) json: bool,
}

/// Compare two pictures. The exit code is 1 if a pixel differs by more than the tolerance.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct CompareArgs {
    /// A picture, .png or .exr
    pub(in crate::cli) a: PathBuf,
    /// A picture of the same size
    pub(in crate::cli) b: PathBuf,
    /// Largest tolerated difference of a channel; channels run from 0 to 1, so an 8-bit step is 0.00392
    #[arg(long, value_name = "T", default_value_t = 0.0, value_parser = parse::tolerance, allow_hyphen_values = true)]
    pub(in crate::cli) tolerance: f64,
    /// Write the difference, multiplied by ten, as a picture
    #[arg(long, value_name = "FILE")]
    pub(in crate::cli) difference: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub(in crate::cli) json: bool,
}
