//! A contact sheet of a folder.

use std::path::PathBuf;

use super::render::RenderArgs;

const SHEET_EXAMPLES: &str = "\
The folder takes the place of VOLUME; a file there gives its picture alone. --size is of one picture. \
All other options of render apply to each picture.

Examples:
  voxsplat sheet scans -o sheet.png
  voxsplat sheet scans -o sheet.png --size 160 --transfer ct-bone --azimuth 30
  voxsplat sheet scans --each thumbnails --size 128";

/// Draw a contact sheet: a small picture of each volume in a folder.
///
/// Volumes are files of a known format, folders of Zarr and folders of slices. Each gets the look that render gives it,
/// from the means of blocks of voxels about as wide as a pixel. A volume that cannot be drawn is named and left out;
/// then the exit code is 1.
#[derive(Debug, clap::Args)]
#[command(after_help = SHEET_EXAMPLES)]
pub(crate) struct SheetArgs {
    #[command(flatten)]
    pub(crate) render: RenderArgs,
    /// Write a picture of each volume into DIR too, NAME.png; DIR is created if it does not exist
    #[arg(long, value_name = "DIR", help_heading = "Sheet")]
    pub(crate) each: Option<PathBuf>,
}
