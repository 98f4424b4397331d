//! A turning volume.

use std::path::PathBuf;

use voxsplat::film::Format;

use super::render::RenderArgs;
use crate::parse::{self, one_of};

const TURNTABLE_EXAMPLES: &str = "\
-o is DIR/{frame}.png or .exr (a file for each frame), FILE.gif (256 colours for all frames), FILE.apng, FILE.y4m, \
FILE.html (a page that turns by mouse, touch and keys), or - for standard output. All options of render apply, and a \
scene may take the place of a volume.

Examples:
  voxsplat turntable head.nii.gz --frames 72 -o head.gif --size 512 --elevation 15
  voxsplat turntable ct.nrrd --frames 72 -o ct.html --size 512 --scale-bar
  voxsplat turntable ct.nrrd --frames 360 -o frames/{frame}.png --part 2/8 --resume
  voxsplat turntable ct.nrrd --frames 100 -o - --key-frames path.json | ffmpeg -i - -pix_fmt yuv420p ct.mp4
  voxsplat turntable heart.nii.gz --time all --turn 0 --rate 10 -o heart.gif";

/// Render a turning volume: one picture or film frame per view.
#[derive(Debug, clap::Args)]
#[command(after_help = TURNTABLE_EXAMPLES)]
pub(crate) struct TurntableArgs {
    #[command(flatten)]
    pub(crate) render: RenderArgs,
    /// Number of frames. Several time points (--time) are spread over the frames [default: 36, or one per time point]
    #[arg(long, value_name = "N", value_parser = parse::whole::<u32, 1, 100_000>, help_heading = "Turntable")]
    pub(crate) frames: Option<u32>,
    /// Turn the eye by DEG degrees from --azimuth on; the last frame is one step before the end. 0: no turn
    #[arg(long, value_name = "DEG", default_value_t = 360.0, value_parser = parse::number, help_heading = "Turntable")]
    pub(crate) turn: f64,
    /// Interpolate key frames in place of a turn: a JSON list of objects with frame (from 0) and any of azimuth,
    /// elevation, roll and zoom
    #[arg(long, value_name = "FILE", conflicts_with = "turn", help_heading = "Turntable")]
    pub(crate) key_frames: Option<PathBuf>,
    /// Frames per second of a film, 0.1 to 1000
    #[arg(long, value_name = "N", default_value_t = 25.0, value_parser = parse::positive, help_heading = "Turntable")]
    pub(crate) rate: f64,
    /// Format of a film [default: by the name of the file; y4m for -]
    #[arg(long, value_name = "FORMAT", value_parser = one_of(Format::ALL, Format::name), help_heading = "Turntable")]
    pub(crate) format: Option<Format>,
    /// Render the I-th of N parts of the frames, for batch systems
    #[arg(long, value_name = "I/N", value_parser = parse::part, help_heading = "Turntable")]
    pub(crate) part: Option<[u32; 2]>,
    /// Skip frames whose files exist
    #[arg(long, help_heading = "Turntable")]
    pub(crate) resume: bool,
}
