//! Failures of commands, as one line or several, with the options of the command line for the settings of the library.

use std::error::Error as _;

use voxsplat::error::{Error, Hint, InputError};
use voxsplat::volume::SampleType;

use super::tune;

/// The failure of a command: the lines that report it, and the exit code.
#[derive(Debug)]
pub(crate) struct Failure {
    /// The exit code: 1 if the work failed, 2 if the arguments are wrong.
    pub(crate) code: u8,
    pub(crate) messages: Vec<String>,
}

impl Failure {
    /// Makes the failure of wrong arguments.
    pub(crate) fn usage(message: impl Into<String>) -> Self {
        Self { code: 2, messages: vec![message.into()] }
    }

    /// Makes the failure of work that failed.
    pub(crate) fn failed(message: impl Into<String>) -> Self {
        Self { code: 1, messages: vec![message.into()] }
    }
}

/// Returns the failure of wrong arguments as an error.
pub(crate) fn refuse<T>(message: impl Into<String>) -> Result<T, Failure> {
    Err(Failure::usage(message))
}

/// Returns the failure of work as an error.
pub(crate) fn fail<T>(message: impl Into<String>) -> Result<T, Failure> {
    Err(Failure::failed(message))
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let message = in_flags(&error);
        match error {
            // Both are about options, even if the volume or the adapter must be known to find the fault.
            Error::Setting { .. } | Error::Camera(_) => Self::usage(message),
            _ => Self::failed(message),
        }
    }
}

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        Error::from(error).into()
    }
}

/// Returns an error in one line: message, causes and remedy, with the options of the command line for the fields of the
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
            Hint::ChooseSeries => "choose one with --series N (info lists them)".to_owned(),
            Hint::InterpolateSlices => "interpolate them with --missing-slices interpolate".to_owned(),
            Hint::ChooseChannel => "choose one with --channel N".to_owned(),
            Hint::ChooseComplexPart => "choose a part with --complex abs, real, imag or phase".to_owned(),
            Hint::RaiseFetchLimit => {
                "read a coarser level with --pyramid, less with --clip and --transfer FILE, or more with --fetch-limit"
                    .to_owned()
            }
            Hint::ChooseDataset => "give one as FILE:NAME".to_owned(),
            other => other.to_string(),
        };
    }
    message
}

/// Returns the option for a setting of the library.
fn flag(setting: &str) -> String {
    let name = setting.replace('_', "-");
    match name.as_str() {
        "sample-type" => "--type".to_owned(),
        "accumulation" => "--tune accumulate".to_owned(),
        "lighting" => "--light".to_owned(),
        // Arguments without a name.
        "brick" => "N".to_owned(),
        "parts" | "plan" => name,
        "color-bar" => "--colour-bar".to_owned(),
        _ if tune::has(&name) => format!("--tune {name}"),
        _ => format!("--{name}"),
    }
}

/// Returns the names of the sample types for `--type`.
fn sample_types() -> String {
    SampleType::ALL.map(SampleType::name).join("|")
}
