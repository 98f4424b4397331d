//! The arguments of the program, and its help.

mod bricks;
mod figure;
mod input;
mod inspect;
mod model;
mod pareto;
mod render;
mod sheet;
mod slice;
mod solids;
mod turntable;
mod view;

use clap::builder::ValueHint;
use clap::{Arg, CommandFactory, Parser, Subcommand};

use crate::lacking::lacks;

pub(crate) use self::bricks::{BrickArgs, MergeArgs, PlanArgs};
pub(crate) use self::figure::FigureArgs;
pub(crate) use self::inspect::{CompareArgs, InfoArgs};
pub(crate) use self::model::{LayerArgs, ModelArgs};
pub(crate) use self::pareto::ParetoArgs;
pub(crate) use self::render::{RenderArgs, StatsFormat};
pub(crate) use self::sheet::SheetArgs;
pub(crate) use self::slice::SliceArgs;
pub(crate) use self::solids::SolidArgs;
pub(crate) use self::turntable::TurntableArgs;
pub(crate) use self::view::{ProjectionArg, ViewArgs};

/// Render voxel volumes by splatting.
#[derive(Debug, Parser)]
#[command(name = "voxsplat", version, max_term_width = 100, after_help = MAIN_EXAMPLES, disable_help_subcommand = true)]
#[command(subcommand_required = true, arg_required_else_help = false)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Print only results and errors: no notes, no progress
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    /// Print the result as one JSON object with version, choices (preset, light, sharpness, view, painter) and outputs
    ///
    /// A scene with several outputs prints an object for each. --stats adds its numbers, in either format.
    #[arg(long, global = true)]
    pub(crate) json: bool,
}

const MAIN_EXAMPLES: &str = "\
Examples:
  voxsplat render demo:nautilus -o nautilus.png
  voxsplat info scan.nii.gz
  voxsplat slice scan.nii.gz -o slices.png
  voxsplat render scan.nii.gz -o scan.png --transfer ct-bone --azimuth 30
  voxsplat sheet scans -o sheet.png
  voxsplat pareto scan.nii.gz -o speed-against-error

Exit codes: 0 done, 1 failed (compare: the pictures differ; --verify: --max-error is exceeded), \
2 wrong arguments (compare: also pictures that cannot be read or have other sizes), 128 and its \
number for a signal. Output has no colours, with NO_COLOR and without.";

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Render a volume to a picture
    Render(Box<RenderArgs>),
    /// Draw a figure of slices: sections of a volume beside its picture
    Slice(Box<SliceArgs>),
    /// Draw a contact sheet: a small picture of each volume in a folder
    Sheet(Box<SheetArgs>),
    /// Render a turning volume: one picture or film frame per view
    Turntable(Box<TurntableArgs>),
    /// Measure the speed and the error of many settings
    Pareto(Box<ParetoArgs>),
    /// Plan a picture in bricks, which many machines can draw
    Plan(Box<PlanArgs>),
    /// Draw one brick of a plan: a partial picture
    Brick(BrickArgs),
    /// Merge partial pictures into the picture of their plan
    Merge(MergeArgs),
    /// Describe a volume file and show how to render it
    Info(InfoArgs),
    /// Compare two pictures
    Compare(CompareArgs),
    /// List the graphics adapters, best first
    Devices,
    /// Print completions for a shell: bash, elvish, fish, powershell or zsh
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page of the program or of a command, for man -l
    Man {
        /// A command, such as render
        command: Option<String>,
    },
}

/// The options of `render` and its relatives for a first picture, which `-h` shows.
const BASIC: &str = "output size background stats channel time azimuth elevation projection zoom transfer window model \
                     shading light clip labels label overlay mesh scale-bar colour-bar max-error";

/// Options whose values are any text, so that a value with a dash in front is more likely a forgotten value.
const TEXTS: [&str; 4] = ["stats", "title", "caption", "adapter"];

/// Returns the definition of the program's arguments. `-h` shows the options of [`BASIC`] and the ones of a command
/// alone. Help leaves out what a command refuses. Values may begin with a dash, as negative numbers do.
pub(crate) fn command() -> clap::Command {
    let own = [Some("Slices"), Some("Sheet"), Some("Turntable"), Some("Measurement"), Some("Bricks")];
    let is_basic = |arg: &Arg| arg.get_long().is_none_or(|long| BASIC.split(' ').any(|basic| basic == long));
    Args::command().mut_subcommands(|command| {
        let has_many = ["render", "slice", "sheet", "turntable", "pareto", "plan"].contains(&command.get_name());
        let is_sheet = command.get_name() == "sheet";
        let name = command.get_name().to_owned();
        let written = match command.get_name() {
            "plan" => Some("Plan to write: .json"),
            "sheet" => Some("Contact sheet to write: .png, or - for a PNG on standard output"),
            "slice" => Some("Figure to write: .png, or - for a PNG on standard output"),
            "turntable" => {
                Some("Film or pictures to write: .gif, .apng, .y4m, .html, DIR/{frame}.png or - (see below)")
            }
            _ => None,
        };
        command.mut_args(|arg| {
            let arg = match written.filter(|_| arg.get_long() == Some("output")) {
                Some(written) => arg.help(written).long_help(written),
                None => arg,
            };
            // A contact sheet has small pictures.
            let is_small = is_sheet && arg.get_long() == Some("size");
            let arg = if is_small { arg.default_value("256x256") } else { arg };
            let is_hidden = has_many && !is_basic(&arg) && !own.contains(&arg.get_help_heading());
            let is_value = arg.get_long().is_some_and(|long| !TEXTS.contains(&long))
                && arg.get_action().takes_values()
                && arg.get_value_hint() != ValueHint::AnyPath;
            let is_refused = arg.get_long().is_some_and(|long| lacks(&name, long));
            arg.hide(is_refused).hide_short_help(is_hidden).allow_hyphen_values(is_value)
        })
    })
}

/// Returns the definition with the options that all commands share in each command.
pub(crate) fn built() -> clap::Command {
    let mut program = command();
    program.build();
    program
}

/// Returns the option of a name or an alias.
pub(crate) fn option<'a>(command: &'a clap::Command, name: &str) -> Option<&'a Arg> {
    let is_alias = |arg: &Arg| arg.get_all_aliases().is_some_and(|aliases| aliases.contains(&name));
    command.get_arguments().find(|arg| arg.get_long() == Some(name) || is_alias(arg))
}
