//! The arguments of the program, and its help.

mod figure;
mod input;
mod inspect;
mod model;
mod painter;
mod pareto;
mod render;
mod turntable;
mod view;

use clap::{Parser, Subcommand};

pub(super) use self::figure::FigureArgs;
pub(super) use self::input::InputArgs;
pub(super) use self::inspect::{CompareArgs, InfoArgs, KernelsArgs};
pub(super) use self::model::{LayerArgs, ModelArgs, SwitchArg};
pub(super) use self::painter::{PainterArg, PainterArgs};
pub(super) use self::pareto::ParetoArgs;
pub(super) use self::render::{RenderArgs, StatsFormat};
pub(super) use self::turntable::TurntableArgs;
pub(super) use self::view::{FrameArg, ProjectionArg, ViewArgs};

/// Renders voxel volumes by splatting on the GPU.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100, after_help = MAIN_EXAMPLES, disable_help_subcommand = true)]
#[command(subcommand_required = true, arg_required_else_help = false)]
pub(super) struct Args {
    #[command(subcommand)]
    pub(super) command: Command,
    /// Print results and errors alone: no notes, no progress
    #[arg(short, long, global = true)]
    pub(super) quiet: bool,
}

const MAIN_EXAMPLES: &str = "\
Examples:
  voxsplat render demo:shepp-logan -o head.png
  voxsplat info scan.nii.gz
  voxsplat render scan.nii.gz -o scan.png --transfer ct-bone --azimuth 30
  voxsplat pareto scan.nii.gz -o speed-against-error

Exit codes: 0 done, 1 failed (compare: the pictures differ; --max-error: broken), 2 wrong arguments;
128 and its number if a signal ends it. Output has no colours, with NO_COLOR and without.";

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Render a volume to a picture
    Render(Box<RenderArgs>),
    /// Turn a volume: a picture or a frame of a film for each view
    Turntable(Box<TurntableArgs>),
    /// Draw a volume in many ways, and report their speed against their error
    Pareto(Box<ParetoArgs>),
    /// Show what a volume file holds and how to render it
    Info(InfoArgs),
    /// Show how well kernels reconstruct a known signal
    Kernels(KernelsArgs),
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
