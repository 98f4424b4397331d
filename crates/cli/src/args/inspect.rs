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
    /// Print one JSON object
    #[arg(long, help_heading = "Output")]
    pub(crate) json: bool,
}

/// Compare two pictures. The exit code is 1 if a pixel differs by more than the tolerance.
#[derive(Debug, clap::Args)]
pub(crate) struct CompareArgs {
    /// A picture, .png or .exr
    pub(crate) a: PathBuf,
    /// A picture of the same size
    pub(crate) b: PathBuf,
    /// Largest tolerated difference of a channel; channels run from 0 to 1, so an 8-bit step is 0.00392
    #[arg(long, value_name = "T", default_value_t = 0.0, value_parser = parse::tolerance)]
    pub(crate) tolerance: f64,
    /// Write the difference, multiplied by ten, as a picture
    #[arg(long, value_name = "FILE")]
    pub(crate) difference: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}
