//! Pictures in bricks.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use voxsplat::image::Background;

use super::render::RenderArgs;
use crate::parse;

const PLAN_EXAMPLES: &str = "\
All options of render that make a picture apply: see voxsplat render --help.

If lights cast shadows (--light studio, --shadows), the light that enters each brick is written beside the plan, as \
plan.light-0.exr and so on: keep the files together. Shadows need --painter cpu, and lights from directions.

Examples:
  voxsplat plan ct.nrrd --grid 2x2x2 -o plan.json --transfer ct-bone --azimuth 30
  voxsplat brick plan.json 0-3 -o part-0.exr
  voxsplat brick plan.json 4-7 -o part-1.exr
  voxsplat merge plan.json part-*.exr -o ct.png";

/// Plan a picture in bricks, which many machines can draw.
///
/// Writes the facts of the whole picture as JSON: camera, settings, transfer function, and the bricks front to back.
#[derive(Debug, clap::Args)]
#[command(after_help = PLAN_EXAMPLES)]
pub(crate) struct PlanArgs {
    #[command(flatten)]
    pub(crate) render: RenderArgs,
    /// Number of bricks along x, y and z of the lattice
    #[arg(long, value_name = "XxYxZ", value_parser = parse::grid, help_heading = "Bricks")]
    pub(crate) grid: [u32; 3],
}

const BRICK_EXAMPLES: &str = "\
Examples:
  voxsplat brick plan.json 0 -o part-0.exr
  voxsplat brick plan.json 8-15 -o part-1.exr   # one partial picture of eight bricks";

/// Draw a brick of a plan, or bricks in a row: a partial picture.
///
/// Bricks in a row are drawn one after the other with one engine, and composited. Reads only the samples of a brick at
/// a time from files of uncompressed samples in one piece, and otherwise the volume. The light that enters a brick is
/// beside the plan, if there is one.
#[derive(Debug, clap::Args)]
#[command(after_help = BRICK_EXAMPLES)]
pub(crate) struct BrickArgs {
    /// A plan by voxsplat plan
    pub(crate) plan: PathBuf,
    /// Number of the brick, from 0 on, or FIRST-LAST
    #[arg(value_name = "N", value_parser = parse::bricks)]
    pub(crate) bricks: RangeInclusive<usize>,
    /// Partial picture to write: an OpenEXR with four channels
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Use the adapter whose name contains NAME, or #N of `voxsplat devices` [default: the best adapter, or the
    /// processor for a plan by `cpu`]
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
}

/// Merge the partial pictures of all bricks of a plan into the picture.
#[derive(Debug, clap::Args)]
pub(crate) struct MergeArgs {
    /// A plan by voxsplat plan
    pub(crate) plan: PathBuf,
    /// Partial pictures of all its bricks, in any order
    #[arg(value_name = "PART", required = true)]
    pub(crate) parts: Vec<PathBuf>,
    /// Picture to write: .png, .exr, or - for a PNG on standard output
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Background of a PNG: #rrggbb, a name of CSS such as white, r,g,b from 0 to 1, or transparent
    #[arg(long, value_name = "COLOUR", default_value = "black", value_parser = parse::library::<Background>)]
    pub(crate) background: Background,
}
