//! The command line: typed arguments ([`args`]) become validated jobs ([`job`]), each run by the file of its command.
//!
//! Results go to stdout, everything else to stderr; an error is one line. Exit codes: 0 done, 1 failed (for `compare`
//! also: the pictures differ), 2 the command line asks for something that is not possible.

mod args;
mod compare;
mod devices;
mod histogram;
mod info;
mod job;
mod output;
mod parse;
mod progress;
mod render;
mod stderr;

use std::process::ExitCode;

use clap::Parser;
use clap::error::ErrorKind;
use voxsplat::error::Error;

/// Why a command did not do what it was asked.
#[derive(Debug)]
enum Failure {
    /// The arguments are wrong.
    Usage(String),
    /// The work failed.
    Failed(String),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        match error {
            // Both come from options; that a value is out of range may show only beside the volume or the adapter.
            Error::Setting { name, reason } => Self::Usage(format!("--{name}: {reason}")),
            Error::Camera(_) => Self::Usage(error.to_string()),
            other => Self::Failed(other.to_string()),
        }
    }
}

/// Parses, runs, reports.
pub(crate) fn main() -> ExitCode {
    let result = match args::Args::try_parse() {
        Ok(args) => run(args),
        Err(error) if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            output::print(&error.render().to_string())
        }
        Err(error) => Err(Failure::Usage(in_one_line(&error.render().to_string()))),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Failed(message)) => {
            output::say(&message);
            ExitCode::from(1)
        }
        Err(Failure::Usage(message)) => {
            output::say(&message);
            ExitCode::from(2)
        }
    }
}

fn run(args: args::Args) -> Result<(), Failure> {
    match args.command {
        args::Command::Render(args) => render::run(job::RenderJob::new(*args)?),
        args::Command::Info(args) => info::run(&args),
        args::Command::Compare(args) => compare::run(&job::CompareJob::new(args)?),
        args::Command::Devices => devices::run(),
    }
}

/// The message of a command-line error: its first paragraph and the tips, without the usage text.
fn in_one_line(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let end = lines.iter().position(|l| l.starts_with("Usage:") || l.starts_with("For more information"));
    let kept: Vec<&str> = lines[..end.unwrap_or(lines.len())].iter().copied().filter(|l| !l.is_empty()).collect();
    let message = kept.join("; ").replace(":; ", ": ");
    format!("{} (see --help)", message.strip_prefix("error: ").unwrap_or(&message))
}
