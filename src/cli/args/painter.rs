//! What draws it, with its knobs.

use clap::ValueEnum;
use voxsplat::settings::{Accumulation, Precision, Resolution, Sheets};

use crate::cli::parse::{self, one_of};

/// What draws the splats.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum PainterArg {
    Auto,
    Quads,
    Tiles,
}

/// What draws it.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct PainterArgs {
    /// What draws the splats: quads draws every picture, tiles is faster and refuses some, auto takes tiles
    /// unless it refuses, on GPUs with --resolution full. An option of a painter (below) chooses that painter
    #[arg(long, value_name = "PAINTER", default_value = "auto", help_heading = "Device")]
    pub(in crate::cli) painter: PainterArg,
    /// Thickness of a sheet in voxels, 0.05 to 64: thinner is more exact and slower [default: 1]
    #[arg(long, value_name = "VOXELS", value_parser = parse::positive, allow_hyphen_values = true,
        help_heading = "Painter quads")]
    pub(in crate::cli) sheet_thickness: Option<f64>,
    /// Sheets parallel to the image, or (historical, pops) the voxel planes most parallel to it [default: image]
    #[arg(long, value_name = "ALIGNMENT", value_parser = one_of(Sheets::ALL, Sheets::name),
        help_heading = "Painter quads")]
    pub(in crate::cli) sheets: Option<Sheets>,
    /// What a sheet adds up: optical depth, or (historical, inexact) opacities clamped at 1 [default: optical-depth]
    #[arg(long, value_name = "WHAT", value_parser = one_of(Accumulation::ALL, Accumulation::name),
        help_heading = "Painter quads")]
    pub(in crate::cli) accumulate: Option<Accumulation>,
    /// Format of the sheets [default: f32 where the adapter blends it, otherwise f16]. With f16 alpha errs by 3e-4 to
    /// 4e-3, by up to 6e-2 if kernels grow, and scalars by 5e-4 of their range
    #[arg(long, value_name = "FORMAT", value_parser = one_of(Precision::ALL, Precision::name),
        help_heading = "Painter quads")]
    pub(in crate::cli) precision: Option<Precision>,
    /// Largest error of the footprint table, 1e-7 to 0.1 of its peak [default: 1e-4 for f16, 1e-5 for f32]
    #[arg(long, value_name = "E", value_parser = parse::positive, allow_hyphen_values = true,
        help_heading = "Painter quads")]
    pub(in crate::cli) table_error: Option<f64>,
    /// Rows and coefficients a row of the footprint table, 2 to 4096 and 4, 8, 12 or 16, in place of --table-error
    #[arg(long, value_name = "ROWSxTERMS", value_parser = parse::table, conflicts_with = "table_error",
        help_heading = "Painter quads")]
    pub(in crate::cli) footprint_table: Option<[u32; 2]>,
    /// Sheets that one pass feeds: 1, 4 or 8 [default: what the adapter does best]
    #[arg(long, value_name = "N", help_heading = "Painter quads")]
    pub(in crate::cli) sheets_per_pass: Option<u32>,

    /// How finely rays are spaced: capped (pre-shaded, 1 to 4 rays per voxel and axis, resampled to the picture, and
    /// own rays for pixels that would err) or full (a ray per pixel) [default: capped]
    #[arg(long, value_name = "HOW", value_parser = one_of(Resolution::ALL, Resolution::name),
        help_heading = "Painter tiles")]
    pub(in crate::cli) resolution: Option<Resolution>,
}
