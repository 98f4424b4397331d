//! Errors of the library as exceptions of Python.

use std::error::Error as _;
use std::io;

use pyo3::exceptions::{PyKeyboardInterrupt, PyMemoryError, PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::{IntoPyObjectExt, create_exception};
use voxsplat::error::{Error, Hint, InputError};
use voxsplat::formats::without_credentials;

create_exception!(
    voxsplat,
    DeviceError,
    PyRuntimeError,
    "There is no graphics adapter, it cannot draw the picture, or it failed. The message states what to install."
);

/// Returns an error of the library as an exception: one line, with keywords of the package.
pub(crate) fn raised(error: &Error) -> PyErr {
    let mut message = match error {
        Error::Setting { name, reason } => format!("{}: {reason}", keyword(name)),
        Error::TooLarge { bytes, available, limit, remedies } => {
            let remedies = remedies.iter().map(|option| keyword_of(option)).collect();
            Error::TooLarge { bytes: *bytes, available: *available, limit, remedies }.to_string()
        }
        other => other.to_string(),
    };
    let causes = std::iter::successors(error.source(), |&cause| cause.source());
    causes.for_each(|cause| message += &format!(": {cause}"));
    if let Some(hint) = error.hint() {
        message += &format!(": {}", remedy(hint));
    }
    let message = without_credentials(&message).into_owned();
    match error {
        Error::Memory { .. } | Error::OutOfMemory(_) | Error::TooLarge { .. } => PyMemoryError::new_err(message),
        Error::NoAdapter(_) | Error::Unsupported { .. } | Error::Device { .. } => DeviceError::new_err(message),
        Error::Input(InputError::Read { path, source }) | Error::Write { path, source } => {
            system(source, &path.display().to_string(), message)
        }
        Error::Cancelled => PyKeyboardInterrupt::new_err(()),
        _ => PyValueError::new_err(message),
    }
}

/// Returns an error of the operating system. Python chooses the class by its number, such as FileNotFoundError.
fn system(source: &io::Error, path: &str, message: String) -> PyErr {
    match source.raw_os_error() {
        Some(number) => {
            let text = source.to_string();
            let text = text.split(" (os error").next().unwrap_or_default().to_owned();
            PyOSError::new_err((number, text, path.to_owned()))
        }
        None => PyOSError::new_err(message),
    }
}

/// Returns the exception of a fault of voxsplat itself.
pub(crate) fn internal(message: &str) -> PyErr {
    let line = message.lines().next().unwrap_or_default();
    PyRuntimeError::new_err(format!("internal error of voxsplat, please report it: {line}"))
}

/// Returns the keyword of the package for a setting of the library.
fn keyword(setting: &str) -> String {
    match setting {
        "lighting" => "light".to_owned(),
        "axis_order" => "axes".to_owned(),
        other => other.replace('-', "_"),
    }
}

/// Returns an option of the command with its value, such as `--light off`, as a keyword of the package.
fn keyword_of(option: &str) -> String {
    let option = option.strip_prefix("--").unwrap_or(option);
    match option.split_once(' ') {
        Some((name, value)) if value.parse::<f64>().is_ok() => format!("{}={value}", keyword(name)),
        Some((name, value)) => format!("{}={value:?}", keyword(name)),
        None => format!("{}=True", keyword(option)),
    }
}

fn remedy(hint: Hint) -> String {
    match hint {
        Hint::RaiseFetchLimit => "read a coarser level with pyramid=, or more with fetch_limit=".to_owned(),
        Hint::GiveDims => "give dims=(x, y, z) too".to_owned(),
        Hint::GiveSampleType => "give dtype= too".to_owned(),
        Hint::GiveDimsAndSampleType => "for bare samples give dims=(x, y, z) and dtype=".to_owned(),
        Hint::GiveSpacing => "give spacing=".to_owned(),
        Hint::ReplaceNonFinite => "replace them with replace_nan=VALUE".to_owned(),
        Hint::ChooseSeries => "choose one with series=N".to_owned(),
        Hint::InterpolateSlices => "interpolate them with missing_slices=\"interpolate\"".to_owned(),
        Hint::ChooseChannel => "choose one with channel=N".to_owned(),
        Hint::ChooseDataset => "give one as \"FILE:NAME\"".to_owned(),
        other => other.to_string(),
    }
}

/// Returns a value of JSON as a dictionary or a list of Python.
pub(crate) fn from_json(py: Python<'_>, json: &str) -> PyResult<Py<PyAny>> {
    py.import("json")?.call_method1("loads", (json,))?.into_py_any(py)
}
