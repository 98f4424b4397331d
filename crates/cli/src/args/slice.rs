//! A figure of sections.

use glam::DVec3;

use super::render::RenderArgs;
use crate::parse::{self, Planes};

const SLICE_EXAMPLES: &str = "\
All options of render apply to the picture beside the sections; title and caption belong to the whole figure.

Examples:
  voxsplat slice head.nii.gz -o head.png
  voxsplat slice ct.nrrd -o ct.png --at 12,8,15 --window 40,400 --size 1600x400
  voxsplat slice t1.nii.gz -o map.png --overlay zmap.nii.gz@2.3.. --planes axial:5,axial:10,axial:15
  voxsplat slice ct.nrrd -o organs.png --labels organs.nrrd --label all:0.5 --title 'Organs'";

/// Draw a figure of slices: sections of a volume beside its picture.
///
/// Sections show values in grey over --window, or over the foreground, tinted where the transfer function shows matter;
/// colour maps keep their colours. --clip and --mask cut the picture alone. All sections have one scale. An axial
/// section is seen from the feet, a coronal one from the front and a sagittal one from the left.
#[derive(Debug, clap::Args)]
#[command(after_help = SLICE_EXAMPLES)]
pub(crate) struct SliceArgs {
    #[command(flatten)]
    pub(crate) render: RenderArgs,
    /// Point of the world through which the planes go, for patients in LPS [default: the middle of the volume]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::vector, help_heading = "Slices")]
    pub(crate) at: Option<DVec3>,
    /// Planes: axial, coronal, sagittal (or xy, xz, yz), each maybe with a place along its axis such as axial:12.5; or
    /// one plane as of --plane. Repeat the option for more
    #[arg(long, value_name = "PLANE,..", default_value = "axial,coronal,sagittal", value_parser = parse::planes,
        help_heading = "Slices")]
    pub(crate) planes: Vec<Planes>,
}
