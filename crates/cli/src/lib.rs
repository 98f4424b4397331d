//! The command `voxsplat`. The program of that name calls [`command`], and so does the Python package, which has the
//! program inside.
//!
//! Arguments (`args`) become validated jobs (`job`); each command has a file that runs its jobs.
//!
//! Results go to stdout, everything else to stderr. Each error is one line. Exit codes: 0 done, 1 failed, 2 wrong
//! arguments; of `compare` 1 pictures that differ, 2 pictures that cannot be compared. A signal ends the program as it
//! ends others.

mod args;
mod bricks;
mod compare;
mod destination;
mod devices;
mod draw;
mod effects;
mod failure;
mod files;
mod fitted;
mod given;
mod histogram;
mod info;
mod job;
mod lacking;
mod layers;
mod manual;
mod options;
mod output;
mod pareto;
mod parse;
mod part;
mod progress;
mod render;
mod report;
mod scene;
mod scene_file;
mod sections;
mod session;
mod sheet;
mod signals;
mod slice;
mod solids;
mod stages;
mod transfer;
mod tune;
mod turntable;
mod usage;

use std::ffi::OsString;
use std::time::Instant;

use clap::FromArgMatches;
use clap::error::ErrorKind;

use failure::Failure;
use options::given;

/// Runs a command line and returns its exit code. `words` are the arguments, the name of the program first.
///
/// It is for a process that does nothing else, because it handles signals, starts the threads of `rayon` and prints.
pub fn command(words: &[OsString]) -> u8 {
    if usage::requests_knobs(words) {
        drop(output::print(&tune::help()));
        return 0;
    }
    let parsed = args::command().try_get_matches_from(words);
    let parsed = parsed.and_then(|matches| Ok((args::Args::from_arg_matches(&matches)?, matches)));
    let result = match parsed {
        Ok((args, matches)) => run(args, &matches),
        Err(error) if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            output::print(&error.render().to_string())
        }
        Err(error) => Err(Failure { code: 2, messages: usage::messages(&error, words) }),
    };
    let Err(Failure { code, messages }) = result else { return 0 };
    // A missing volume comes before errors of options.
    let missing = if code == 2 { usage::missing_input(words) } else { None };
    let typed = messages.iter().map(|message| usage::as_typed(message, words));
    missing.into_iter().chain(typed).for_each(|message| output::complain(&message));
    code
}

fn run(args: args::Args, matches: &clap::ArgMatches) -> Result<(), Failure> {
    signals::watch();
    // Before a driver takes memory, because rayon panics if it cannot start its threads at their first work.
    rayon::ThreadPoolBuilder::new().build_global().map_err(|e| {
        Failure::failed(format!(
            "threads cannot be started: {e}: free memory, or raise the limits (ulimit -v, ulimit -u)"
        ))
    })?;
    if args.quiet {
        output::be_quiet();
    }
    if args.json {
        output::be_json();
    }
    let program = args::built();
    let found = matches.subcommand().and_then(|(name, matches)| Some((program.find_subcommand(name)?, matches)));
    let Some(line @ (command, matches)) = found else { return Ok(()) };
    let mut files = files::Files::default();
    files.add(command, matches);
    files.check()?;
    match args.command {
        args::Command::Render(args) => render::run(scene::jobs(*args, line, job::RenderJob::new)?),
        args::Command::Slice(args) => render::run(slice::jobs(*args, line)?),
        args::Command::Sheet(args) => sheet::run(*args, line),
        args::Command::Turntable(args) => turntable::run(turntable::TurntableJob::new(*args, line)?),
        args::Command::Pareto(args) => {
            let start = Instant::now();
            pareto::run(&args, line, &|| start.elapsed())
        }
        args::Command::Plan(args) => bricks::plan(*args, line),
        args::Command::Brick(args) => bricks::brick(&args),
        args::Command::Merge(args) => bricks::merge(&args),
        args::Command::Info(args) => {
            effects::noted(command, vec![matches])?.iter().for_each(|note| output::say(note));
            info::run(&args, &given(command, matches))
        }
        args::Command::Compare(args) => compare::run(&args),
        args::Command::Devices => devices::run(),
        args::Command::Completions { shell } => manual::completions(shell),
        args::Command::Man { command } => manual::page(command.as_deref()),
    }
}
