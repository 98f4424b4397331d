//! The one error type of the library.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

pub use voxsplat_volume::Error as InputError;
pub use voxsplat_volume::Hint;
use voxsplat_volume::Line;

/// The library's result.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can go wrong.
///
/// `{}` prints the message alone: one line without a trailing full stop, in the words of the library.
/// [`source`](std::error::Error::source) returns the cause, if there is one. The message does not repeat the cause, so
/// that a report that walks the chain prints each fact once. `{:#}` prints message, cause and remedy in one line.
///
/// ```
/// use voxsplat::formats::{LoadOptions, load};
///
/// let error = load("missing.nrrd", &LoadOptions::default()).unwrap_err();
/// assert_eq!(error.to_string(), "cannot read missing.nrrd");
/// assert!(format!("{error:#}").starts_with("cannot read missing.nrrd: "));
/// ```
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// A file that cannot be read, or a volume that cannot be rendered.
    Input(InputError),
    /// An output could not be created, written or renamed into place.
    Write {
        /// The path of the requested file (not the temporary one).
        path: PathBuf,
        /// The error of the operating system or the encoder.
        source: io::Error,
    },
    /// A path that cannot be an output: a directory, a device, an unknown extension; or a picture that the format of
    /// the output cannot hold.
    Output {
        /// The path of the requested file.
        path: PathBuf,
        /// The reason why the file cannot be written.
        reason: String,
    },
    /// A transfer function that cannot be used.
    Transfer(String),
    /// A camera that sees nothing or is not defined.
    Camera(String),
    /// A setting or an option out of its range, or at odds with another one.
    Setting {
        /// The setting: the name of its field, with `_` or `-` between words.
        name: &'static str,
        /// The given value and the accepted values.
        reason: String,
    },
    /// No usable graphics adapter.
    NoAdapter(String),
    /// The adapter lacks a feature or a limit that the request needs.
    Unsupported {
        /// The name of the adapter.
        adapter: String,
        /// The missing feature and the remedy.
        reason: String,
    },
    /// A lack of host memory for a volume or a picture.
    Memory {
        /// The use of the memory.
        what: String,
        /// The requested bytes.
        bytes: u64,
    },
    /// A picture that needs more memory than there is, refused before any of it is allocated.
    TooLarge {
        /// The predicted bytes of the picture.
        bytes: u64,
        /// The bytes of memory that are left.
        available: u64,
        /// The name of the limit on the memory, such as `the machine`.
        limit: &'static str,
        /// Options of the program with which the picture fits.
        remedies: Vec<String>,
    },
    /// The GPU ran out of memory.
    OutOfMemory(String),
    /// The device reported an error or was lost; no picture was made.
    Device {
        /// The stage that was running.
        stage: String,
        /// The message of the driver.
        reason: String,
    },
    /// Pixels that do not make a picture.
    Image(String),
    /// Two pictures that cannot be compared.
    Compare(String),
    /// The caller ended the work: see [`Progress::cancelled_by`](crate::progress::Progress::cancelled_by).
    Cancelled,
}

impl Error {
    /// Makes an [`InputError::Volume`]: a volume that cannot be rendered.
    pub(crate) fn volume(reason: impl Into<String>) -> Self {
        InputError::Volume(reason.into()).into()
    }

    /// Makes an [`InputError::Format`]: a malformed file, or a file of an unknown format.
    pub(crate) fn format(path: &Path, reason: impl Into<String>) -> Self {
        InputError::format(path, reason).into()
    }

    /// Makes an [`Error::Setting`].
    pub(crate) fn setting(name: &'static str, reason: impl Into<String>) -> Self {
        Self::Setting { name, reason: reason.into() }
    }

    /// Adds the path of the file whose text is no transfer function to the error.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        match self {
            Self::Transfer(reason) => Self::format(path, reason),
            other => other,
        }
    }

    /// Returns whether settings are refused, so that other settings may succeed on the same volume and device.
    #[must_use]
    pub fn refuses_settings(&self) -> bool {
        matches!(
            self,
            Self::Setting { .. }
                | Self::Unsupported { .. }
                | Self::Memory { .. }
                | Self::TooLarge { .. }
                | Self::OutOfMemory(_)
        )
    }

    /// Returns the remedy, if the library knows one that the message does not state.
    #[must_use]
    pub fn hint(&self) -> Option<Hint> {
        match self {
            Self::Input(error) => error.hint(),
            _ => None,
        }
    }
}

impl From<InputError> for Error {
    /// Converts errors of settings and memory to the same kind here; other errors are about an input.
    fn from(error: InputError) -> Self {
        match error {
            InputError::Setting { name, reason } => Self::Setting { name, reason },
            InputError::Memory { what, bytes } => Self::Memory { what, bytes },
            other => Self::Input(other),
        }
    }
}

/// Returns a number of bytes in a unit that people read.
fn in_units(bytes: u64) -> String {
    let (unit, name) = if bytes < 1_000_000_000 { (1e6, "MB") } else { (1e9, "GB") };
    format!("{:.1} {name}", bytes as f64 / unit)
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(error) => write!(f, "{error}"),
            Self::Write { path, .. } => write!(f, "cannot write {}", path.display()),
            Self::Output { path, reason } => write!(f, "cannot write {}: {}", path.display(), Line(reason)),
            Self::Transfer(reason) => write!(f, "transfer function: {}", Line(reason)),
            Self::Camera(reason) => write!(f, "camera: {reason}"),
            Self::Setting { name, reason } => write!(f, "{name}: {}", Line(reason)),
            Self::NoAdapter(reason) => write!(f, "no graphics adapter: {reason}"),
            Self::Unsupported { adapter, reason } => write!(f, "adapter {adapter} {reason}"),
            Self::Memory { what, bytes } => write!(f, "no memory for {what}: {bytes} bytes"),
            Self::TooLarge { bytes, available, limit, remedies } => {
                let [bytes, available] = [bytes, available].map(|bytes| in_units(*bytes));
                let remedies = match remedies.as_slice() {
                    [] => String::new(),
                    [only] => format!(": draw it with {only}"),
                    [some @ .., last] => format!(": draw it with {}, or in {last}", some.join(", or with ")),
                };
                write!(f, "the picture needs about {bytes} of memory, and {limit} has {available} left{remedies}")
            }
            Self::OutOfMemory(stage) => {
                write!(f, "out of GPU memory while {stage}: draw bricks (voxsplat plan), or use --painter cpu")
            }
            Self::Device { stage, reason } => write!(f, "graphics device failed while {stage}: {reason}"),
            Self::Image(reason) => write!(f, "picture: {reason}"),
            Self::Compare(reason) => write!(f, "cannot compare: {reason}"),
            Self::Cancelled => f.write_str("cancelled"),
        }?;
        if f.alternate() {
            if let Some(source) = std::error::Error::source(self) {
                write!(f, ": {source}")?;
            }
            if let Some(hint) = self.hint() {
                write!(f, ": {hint}")?;
            }
        }
        Ok(())
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Input(error) => error.source(),
            Self::Write { source, .. } => Some(source),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_is_printed_once() {
        let error = Error::Write { path: "a.png".into(), source: io::Error::other("disk full") };
        assert_eq!(error.to_string(), "cannot write a.png");
        assert_eq!(std::error::Error::source(&error).unwrap().to_string(), "disk full");
        assert_eq!(format!("{error:#}"), "cannot write a.png: disk full");
    }
}
