//! The command line. Arguments ([`args`]) become validated jobs ([`job`]); each command has a file that runs its jobs.
//!
//! Results go to stdout, everything else to stderr. Each error is one line. Exit codes: 0 done, 1 failed or, for
//! `compare`, the pictures differ, 2 wrong arguments. A signal ends the program as it ends others.

mod args;
mod channels;
mod clip;
mod compare;
mod destination;
mod devices;
mod effects;
mod files;
mod histogram;
mod info;
mod job;
mod kernels;
mod layers;
mod manual;
mod options;
mod output;
mod pareto;
mod parse;
mod preview;
mod progress;
mod render;
mod scene;
mod session;
mod signals;
mod stderr;
mod turntable;
mod usage;

use std::error::Error as _;
use std::ffi::OsString;
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches};
use voxsplat::error::{Error, Hint};
use voxsplat::volume::SampleType;

/// The failure of a command.
#[derive(Debug)]
enum Failure {
    /// The arguments are wrong.
    Usage(String),
    /// The arguments are wrong in several ways.
    Several(Vec<String>),
    /// The work failed.
    Failed(String),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let message = in_flags(&error);
        match error {
            // Both are about options, even if the volume or the adapter must be known to find the fault.
            Error::Setting { .. } | Error::Camera(_) => Self::Usage(message),
            _ => Self::Failed(message),
        }
    }
}

/// An error in one line: message, causes and way out, with the options of the command line for the fields of the
/// library.
fn in_flags(error: &Error) -> String {
    let mut message = match error {
        Error::Setting { name, reason } => format!("{}: {reason}", flag(name)),
        other => other.to_string(),
    };
    // Standard input has no name.
    if let Some(rest) = message.strip_prefix("-: ") {
        message = format!("standard input: {rest}");
    }
    let causes = std::iter::successors(error.source(), |&cause| cause.source());
    causes.for_each(|cause| message += &format!(": {cause}"));
    if let Some(hint) = error.hint() {
        message += ": ";
        message += &match hint {
            Hint::GiveDims => "give --dims X,Y,Z too".to_owned(),
            Hint::GiveSampleType => format!("give --type {} too", sample_types()),
            Hint::GiveDimsAndSampleType => format!("for bare samples give --dims X,Y,Z and --type {}", sample_types()),
            Hint::GiveSpacing => "give --spacing X,Y,Z".to_owned(),
            Hint::ReplaceNonFinite => "replace them with --replace-nan VALUE".to_owned(),
            Hint::ChooseSeries => "choose one with --series N".to_owned(),
            Hint::InterpolateSlices => "--missing-slices interpolate goes on".to_owned(),
            Hint::ChooseChannel => "choose one with --channel N".to_owned(),
            Hint::ChooseDataset => "give one as FILE:/PATH/OF/SET".to_owned(),
            other => other.to_string(),
        };
    }
    message
}

/// The option that sets a setting of the library.
fn flag(setting: &str) -> String {
    match setting {
        "sample_type" => "--type".to_owned(),
        "accumulation" => "--accumulate".to_owned(),
        "lighting" => "--light".to_owned(),
        "color_bar" => "--colour-bar".to_owned(),
        other => format!("--{}", other.replace('_', "-")),
    }
}

/// The sample types, as `--type` takes them.
fn sample_types() -> String {
    SampleType::ALL.map(SampleType::name).join("|")
}

/// Parses the arguments, runs the command, reports its failure.
pub(crate) fn main() -> ExitCode {
    let words: Vec<OsString> = std::env::args_os().collect();
    let parsed = args::Args::command().try_get_matches();
    let parsed = parsed.and_then(|matches| Ok((args::Args::from_arg_matches(&matches)?, matches)));
    let result = match parsed {
        Ok((args, matches)) => run(args, &matches),
        Err(error) if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            output::print(&error.render().to_string())
        }
        Err(error) => Err(Failure::Several(usage::messages(error, &words))),
    };
    let (code, messages) = match result {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Failed(message)) => (1, vec![message]),
        Err(Failure::Usage(message)) => (2, vec![message]),
        Err(Failure::Several(messages)) => (2, messages),
    };
    // A volume that is not there comes before what is wrong with the options.
    let missing = if code == 2 { usage::missing_input(&words) } else { None };
    let typed = messages.iter().map(|message| usage::as_typed(message, &words));
    missing.into_iter().chain(typed).for_each(|message| output::complain(&message));
    ExitCode::from(code)
}

fn run(args: args::Args, matches: &clap::ArgMatches) -> Result<(), Failure> {
    signals::watch();
    if args.quiet {
        output::be_quiet();
    }
    let mut program = args::Args::command();
    program.build();
    if let Some((name, matches)) = matches.subcommand()
        && let Some(command) = program.find_subcommand(name)
    {
        let mut files = files::Files::default();
        files.add(command, matches);
        files.check()?;
    }
    // What was given is told apart from defaults by the matches of the command itself.
    let (name, matches) = matches.subcommand().unwrap_or(("", matches));
    match args.command {
        args::Command::Render(args) => render::run(scene::jobs(*args, (name, matches), job::RenderJob::new)?),
        args::Command::Turntable(args) => turntable::run(turntable::TurntableJob::new(*args, (name, matches))?),
        args::Command::Pareto(args) => {
            let notes = effects::noted(name, vec![matches])?;
            let job = job::ParetoJob::new(*args)?;
            notes.iter().for_each(|note| output::say(note));
            pareto::run(job, matches)
        }
        args::Command::Info(args) => {
            effects::noted(name, vec![matches])?.iter().for_each(|note| output::say(note));
            info::run(&args)
        }
        args::Command::Kernels(args) => kernels::run(&args),
        args::Command::Compare(args) => compare::run(&job::CompareJob::new(args)?),
        args::Command::Devices => devices::run(),
        args::Command::Completions { shell } => manual::completions(shell),
        args::Command::Man { command } => manual::page(command.as_deref()),
    }
}
