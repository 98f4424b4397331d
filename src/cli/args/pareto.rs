//! A study of many pictures.

use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;

use super::figure::FigureArgs;
use super::input::InputArgs;
use super::model::ModelArgs;
use super::view::ViewArgs;
use crate::cli::parse;

const PARETO_EXAMPLES: &str = "\
Examples:
  voxsplat pareto demo:vessels:128 -o vessels
  voxsplat pareto ct.nrrd -o ct --transfer ct-bone --light headlight --projection perspective
  voxsplat pareto ct.nrrd -o ct --transfer ct-bone --light headlight --projection perspective --resume";

/// Draw a volume in many ways, time each, measure its error against the f64 reference, and report which are worth it.
///
/// Painters, density of rays, level of the lattice, sheets, footprint tables, termination, shading and kernels are
/// varied. DIR gets report.html with the plots, the front as command lines to copy, and pictures of differences; the
/// plots as .svg; all numbers as pareto.csv and pareto.json.
#[derive(Debug, clap::Args)]
#[command(after_help = PARETO_EXAMPLES)]
pub(in crate::cli) struct ParetoArgs {
    #[command(flatten)]
    pub(in crate::cli) input: InputArgs,

    /// Directory of the report; it is made if there is none
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    pub(in crate::cli) output: PathBuf,
    /// Pixels across and down, or one number for both; 1 to 32768
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = parse::size, help_heading = "Output")]
    pub(in crate::cli) size: [u32; 2],
    /// Views: the one asked for, and others from around the volume; 1 to 16
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=16),
        help_heading = "Measurement")]
    pub(in crate::cli) views: u32,
    /// Timed frames of each view, each after a frame that is not timed; 1 to 100
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100),
        help_heading = "Measurement")]
    pub(in crate::cli) repeats: u32,
    /// Pixels of each view that the reference traces, spread evenly; more than the picture has: all
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(16..),
        help_heading = "Measurement")]
    pub(in crate::cli) sample: u32,
    /// Seconds of a frame beyond which a way to draw is not timed again
    #[arg(long, value_name = "SECONDS", default_value_t = 5.0, value_parser = parse::positive,
        allow_hyphen_values = true, help_heading = "Measurement")]
    pub(in crate::cli) patience: f64,
    /// Go on with what an interrupted run of the same command has measured
    #[arg(long, help_heading = "Measurement")]
    pub(in crate::cli) resume: bool,
    /// Show other renderers in the plot: a JSON array of objects with name, seconds (of a frame) and rms (error against
    /// their own truth)
    #[arg(long, value_name = "FILE", help_heading = "Measurement")]
    pub(in crate::cli) rivals: Option<PathBuf>,
    #[command(flatten)]
    pub(in crate::cli) figure: FigureArgs,
    #[command(flatten)]
    pub(in crate::cli) view: ViewArgs,
    #[command(flatten)]
    pub(in crate::cli) model: ModelArgs,
    /// Part of the name of the adapter to use; see `voxsplat devices` [default: the best]
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new(), help_heading = "Device")]
    pub(in crate::cli) adapter: Option<String>,
}
