//! One picture.

use std::path::PathBuf;

use clap::ValueEnum;
use clap::builder::NonEmptyStringValueParser;
use voxsplat::image::{Background, Region};

use super::figure::FigureArgs;
use super::input::InputArgs;
use super::model::{LayerArgs, ModelArgs};
use super::solids::SolidArgs;
use super::view::ViewArgs;
use crate::parse::{self, PainterArg};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum StatsFormat {
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
  voxsplat render t1.nii.gz -o map.png --overlay zmap.nii.gz@2.3.. --colour-bar
  voxsplat render head.nii.gz -o electrodes.png --mesh electrodes.ply:gold --clip R
  voxsplat render ct.nrrd -o organs.png --labels organs.nrrd --label-table organs.ctbl --label all:0.5
  voxsplat render ct.nrrd -o figure.png --scale-bar --axes --colour-bar --units value=HU --title 'A skull'";

/// Render a volume to a picture.
///
/// Angles are in degrees. World lengths are in the unit of the file, millimetres for most scans.
#[derive(Debug, clap::Args)]
#[command(after_help = RENDER_EXAMPLES)]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    pub(crate) input: InputArgs,

    /// Picture to write: .png, .exr, or - for a PNG on standard output
    ///
    /// A .png has 8 bits per channel, an .exr 32-bit floats with premultiplied alpha. render also writes a channel Z
    /// into an .exr of the composite model: the depth at which a ray has lost half of its light, as --depth reads it.
    /// Required, unless a scene has outputs of its own.
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    pub(crate) output: Option<PathBuf>,
    /// Width and height in pixels, or one number for both; 1 to 32768
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = parse::size, help_heading = "Output")]
    pub(crate) size: [u32; 2],
    /// Render a part of the picture of --size: W x H pixels, X and Y from its top left. The pixels equal the pixels of
    /// the whole picture
    #[arg(long, value_name = "X,Y,W,H", value_parser = parse::region, conflicts_with_all = ["max_error", "verify"],
        help_heading = "Output")]
    pub(crate) region: Option<Region>,
    /// Background of a PNG: #rrggbb, a name of CSS such as white, r,g,b from 0 to 1, or transparent
    #[arg(long, aliases = ["background-color", "bg-color"], value_name = "COLOUR", default_value = "black",
        value_parser = parse::library::<Background>, help_heading = "Output")]
    pub(crate) background: Background,
    /// Write all options to a scene, FILE.json: `voxsplat render FILE.json -o PICTURE` makes the same picture
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub(crate) save_scene: Option<PathBuf>,
    /// Write the transfer function too: .json for this program, .vp.json or .vp for 3D Slicer
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub(crate) save_transfer: Option<PathBuf>,
    /// Print statistics and stage times: table or json
    ///
    /// A turntable prints one line of totals, or one JSON object. Put the option after VOLUME. [without FORMAT: table]
    #[arg(long, value_name = "FORMAT", num_args = 0..=1, default_missing_value = "table", hide_possible_values = true,
        help_heading = "Output")]
    pub(crate) stats: Option<StatsFormat>,

    #[command(flatten)]
    pub(crate) figure: FigureArgs,
    #[command(flatten)]
    pub(crate) view: ViewArgs,
    #[command(flatten)]
    pub(crate) model: ModelArgs,
    #[command(flatten)]
    pub(crate) layers: LayerArgs,
    #[command(flatten)]
    pub(crate) solids: SolidArgs,

    /// Draw by rays on the processor (cpu), or splats on a device: by quads, which draws all but --iso, or by tiles,
    /// which is faster and refuses more. auto is cpu without a GPU; on a GPU it is tiles, or quads if tiles refuses. A
    /// knob of quads (--tune help) chooses quads
    #[arg(long, value_name = "PAINTER", default_value = "auto", help_heading = "Device")]
    pub(crate) painter: PainterArg,

    /// Use the adapter whose name contains NAME, or #N of `voxsplat devices` [default: the best GPU]
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new(), help_heading = "Device")]
    pub(crate) adapter: Option<String>,
    /// Use the cheapest settings whose error is at most E, over 0; channels run from 0 to 1
    ///
    /// Bounds the error of every channel in 99.9 % of the covered pixels, estimated from pixels that the f64 reference
    /// traces. Prints the chosen settings.
    #[arg(long, value_name = "E", value_parser = parse::positive, conflicts_with = "reference",
        help_heading = "Accuracy")]
    pub(crate) max_error: Option<f64>,
    /// Trace other pixels of the finished picture and print its error; exit with 1 if the error exceeds --max-error
    #[arg(long, conflicts_with = "reference", help_heading = "Accuracy")]
    pub(crate) verify: bool,
    /// Integrate every ray in f64 on the CPU: slow, and exact to 1e-5 of a channel. Options of painters and devices
    /// have no effect
    #[arg(long, help_heading = "Device")]
    pub(crate) reference: bool,
}
