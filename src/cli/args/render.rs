//! One picture.

use std::path::PathBuf;

use clap::ValueEnum;
use clap::builder::NonEmptyStringValueParser;
use voxsplat::image::{Background, Region};

use super::figure::FigureArgs;
use super::input::InputArgs;
use super::model::{LayerArgs, ModelArgs};
use super::painter::PainterArgs;
use super::view::ViewArgs;
use crate::cli::parse;
use crate::cli::preview::Preview;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum StatsFormat {
    Table,
    Json,
}

const RENDER_EXAMPLES: &str = "\
Examples:
  voxsplat render demo:marschner-lobb -o ml.png --kernel kaiser-bessel
  voxsplat render head.nii.gz -o head.png --azimuth -30 --elevation 15 --size 1920x1080
  voxsplat render ct.nrrd -o skull.png --transfer ct-bone --projection perspective --fov 40
  voxsplat render engine.raw -o engine.png --dims 256,256,128 --type u8 --transfer viridis
  voxsplat render ct.nrrd -o lit.png --transfer ct-bone --shading post --light headlight
  voxsplat render head.nii.gz -o half.png --clip R --light studio
  voxsplat render ct.nrrd -o film.png --model xray --response film --azimuth 90
  voxsplat render head.nii.gz -o truth.exr --reference --size 256
  voxsplat render ct.nrrd -o organs.png --labels organs.nrrd --label-table organs.ctbl --label all:0.5
  voxsplat render ct.nrrd -o figure.png --scale-bar --axes --colour-bar --value-unit HU --title 'A skull'";

/// Render a volume to a picture.
///
/// Angles are in degrees; world lengths are in the unit of the file, millimetres for most scans.
#[derive(Debug, clap::Args)]
#[command(after_help = RENDER_EXAMPLES)]
pub(in crate::cli) struct RenderArgs {
    #[command(flatten)]
    pub(in crate::cli) input: InputArgs,

    /// Picture to write: .png, 8 bits per channel, or .exr, 32-bit float with premultiplied alpha; - is a PNG on
    /// standard output. Needed, unless there is a --preview or a scene has outputs of its own
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    pub(in crate::cli) output: Option<PathBuf>,
    /// Show the picture in the terminal: by kitty's or iTerm2's protocol if it is known to take either, otherwise in
    /// half blocks; put it after VOLUME
    #[arg(long, value_name = "HOW", num_args = 0..=1, default_missing_value = "auto", help_heading = "Output")]
    pub(in crate::cli) preview: Option<Preview>,
    /// Pixels across and down, or one number for both; 1 to 32768
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = parse::size, help_heading = "Output")]
    pub(in crate::cli) size: [u32; 2],
    /// Render only a part of the picture of --size: W x H pixels, X and Y from its top left. The bytes are those of the
    /// whole picture there
    #[arg(long, value_name = "X,Y,W,H", value_parser = parse::region, conflicts_with_all = ["max_error", "verify"],
        help_heading = "Output")]
    pub(in crate::cli) region: Option<Region>,
    /// Background of a PNG: #rrggbb, a name such as white, r,g,b in 0..1, or transparent
    #[arg(long, aliases = ["background-color", "bg-color"], value_name = "COLOUR", default_value = "black",
        value_parser = parse::library::<Background>,
        help_heading = "Output")]
    pub(in crate::cli) background: Background,
    /// Write all options as a scene, FILE.json: `voxsplat render FILE.json -o PICTURE` makes the same picture
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub(in crate::cli) save_scene: Option<PathBuf>,
    /// Write the transfer function too: .json for this program, .vp.json or .vp for 3D Slicer
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub(in crate::cli) save_transfer: Option<PathBuf>,
    /// Print statistics and the time of each stage, as a table or as one JSON object; of a turntable one line of totals
    /// or one JSON object. Put it after VOLUME
    #[arg(long, value_name = "FORMAT", num_args = 0..=1, default_missing_value = "table", help_heading = "Output")]
    pub(in crate::cli) stats: Option<StatsFormat>,

    #[command(flatten)]
    pub(in crate::cli) figure: FigureArgs,
    #[command(flatten)]
    pub(in crate::cli) view: ViewArgs,
    #[command(flatten)]
    pub(in crate::cli) model: ModelArgs,
    #[command(flatten)]
    pub(in crate::cli) layers: LayerArgs,
    #[command(flatten)]
    pub(in crate::cli) painter: PainterArgs,

    /// Part of the name of the adapter to use; see `voxsplat devices` [default: the best]
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new(), help_heading = "Device")]
    pub(in crate::cli) adapter: Option<String>,
    /// Choose the cheapest way to draw whose error is at most E, 0 to 1: no channel of 99.9 % of the covered pixels is
    /// off by more, as pixels traced by the f64 reference tell. Says on stderr what was chosen
    #[arg(long, value_name = "E", value_parser = parse::positive, allow_hyphen_values = true,
        conflicts_with = "reference", help_heading = "Accuracy")]
    pub(in crate::cli) max_error: Option<f64>,
    /// Trace other pixels of the finished picture and print its error; the exit code is 1 if --max-error is broken
    #[arg(long, conflicts_with = "reference", help_heading = "Accuracy")]
    pub(in crate::cli) verify: bool,
    /// Covered pixels that --max-error and --verify trace, spread evenly; all, if there are no more
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(64..),
        help_heading = "Accuracy")]
    pub(in crate::cli) sample: u32,
    /// Integrate every ray in f64 on the CPU instead: slow, and exact to 1e-5 of a channel; options of painters and
    /// devices have no effect
    #[arg(long, help_heading = "Device")]
    pub(in crate::cli) reference: bool,
}
