//! Failures of commands, as one line or several, with the options of the command line for the settings of the library.

use std::error::Error as _;

use voxsplat::error::{Error, Hint, InputError};
use voxsplat::volume::SampleType;

use super::tune;

/// The failure of a command.
#[derive(Debug)]
pub(crate) enum Failure {
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

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        Error::from(error).into()
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
            Hint::InterpolateSlices => "fill them in with --missing-slices interpolate".to_owned(),
            Hint::ChooseChannel => "choose one with --channel N".to_owned(),
            Hint::ChooseDataset => "give one as FILE:/PATH/OF/SET".to_owned(),
            other => other.to_string(),
        };
    }
    message
}

/// The option that sets a setting of the library.
fn flag(setting: &str) -> String {
    let name = setting.replace('_', "-");
    match name.as_str() {
        "sample-type" => "--type".to_owned(),
        "accumulation" => "--tune accumulate".to_owned(),
        "lighting" => "--light".to_owned(),
        "color-bar" => "--colour-bar".to_owned(),
        _ if tune::has(&name) => format!("--tune {name}"),
        _ => format!("--{name}"),
    }
}

/// The sample types, as `--type` takes them.
fn sample_types() -> String {
    SampleType::ALL.map(SampleType::name).join("|")
}
