//! A study of many pictures.

use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;

use super::figure::FigureArgs;
use super::input::InputArgs;
use super::model::ModelArgs;
use super::view::ViewArgs;
use crate::parse;

const PARETO_EXAMPLES: &str = "\
Examples:
  voxsplat pareto demo:vessels:128 -o vessels
  voxsplat pareto ct.nrrd -o ct --transfer ct-bone --light headlight --projection perspective
  voxsplat pareto ct.nrrd -o ct --transfer ct-bone --light headlight --projection perspective --resume --seconds 0";

/// Measure the speed and the error of many settings, and report the best compromises.
///
/// Errors are relative to the f64 reference. The study varies painters, density of rays, level of detail, sheets,
/// footprint tables, termination, shading and kernels. DIR gets report.html with the plots, the Pareto front as command
/// lines to copy and pictures of differences; the plots as .svg; all numbers as pareto.csv and pareto.json. All files
/// are complete from the first measured settings on, and name the settings that --seconds leaves out.
#[derive(Debug, clap::Args)]
#[command(after_help = PARETO_EXAMPLES)]
pub(crate) struct ParetoArgs {
    #[command(flatten)]
    pub(crate) input: InputArgs,

    /// Directory of the report; created if it does not exist
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    pub(crate) output: PathBuf,
    /// Pixels across and down, or one number for both; 1 to 32768
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = parse::size, help_heading = "Output")]
    pub(crate) size: [u32; 2],
    /// Number of views: the requested view and others around the volume; 1 to 16
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = parse::whole::<u32, 1, 16>,
        help_heading = "Measurement")]
    pub(crate) views: u32,
    /// Timed frames of each view, each after an untimed frame; 1 to 100
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = parse::whole::<u32, 1, 100>,
        help_heading = "Measurement")]
    pub(crate) repeats: u32,
    /// Time settings only once if a frame takes longer than SECONDS
    #[arg(long, value_name = "SECONDS", default_value_t = 5.0, value_parser = parse::positive,
        help_heading = "Measurement")]
    pub(crate) patience: f64,
    /// Measure for about SECONDS, the most telling settings first; 0: measure everything. --resume goes on
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, value_parser = parse::tolerance,
        help_heading = "Measurement")]
    pub(crate) seconds: f64,
    /// Continue a run of the same command that was interrupted or has used up its --seconds
    #[arg(long, help_heading = "Measurement")]
    pub(crate) resume: bool,
    /// Show other renderers in the plot: a JSON array of objects with name, seconds (per frame) and rms (error against
    /// the renderer's own truth)
    #[arg(long, value_name = "FILE", help_heading = "Measurement")]
    pub(crate) rivals: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) figure: FigureArgs,
    #[command(flatten)]
    pub(crate) view: ViewArgs,
    #[command(flatten)]
    pub(crate) model: ModelArgs,
    /// Use the adapter whose name contains NAME, or #N of `voxsplat devices` [default: the best GPU]
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new(), help_heading = "Device")]
    pub(crate) adapter: Option<String>,
}
