//! The one error type of the library.

use std::path::PathBuf;

/// Everything that can go wrong, each with a message that says what, where and what to do about it.
///
/// Messages are one line, without a trailing full stop, fit to be printed after `voxsplat: `.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// An output could not be created, written or renamed into place.
    #[error("cannot write {}: {reason}", path.display())]
    Write {
        /// The file asked for (not the temporary one).
        path: PathBuf,
        /// What went wrong, in words.
        reason: String,
    },
    /// A volume file is malformed, truncated, inconsistent or uses a feature that is not read.
    #[error("{}: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it and, where there is one, the way out.
        reason: String,
    },
    /// A volume that cannot be rendered: empty, too large, non-finite values, a singular grid.
    #[error("volume: {0}")]
    Volume(String),
    /// A transfer function that cannot be used.
    #[error("transfer function: {0}")]
    Transfer(String),
    /// A camera that sees nothing or is not defined.
    #[error("camera: {0}")]
    Camera(String),
    /// A setting out of its range.
    #[error("{name}: {reason}")]
    Setting {
        /// The setting as the command line spells it, without dashes.
        name: &'static str,
        /// What was given and what would be accepted.
        reason: String,
    },
    /// No usable graphics adapter.
    #[error("no graphics adapter: {0}")]
    NoAdapter(String),
    /// The adapter lacks a feature or a limit that the request needs.
    #[error("adapter {adapter} {reason}")]
    Unsupported {
        /// The adapter's name.
        adapter: String,
        /// What it lacks and what to do instead.
        reason: String,
    },
    /// The GPU ran out of memory.
    #[error("out of GPU memory while {0}")]
    OutOfMemory(String),
    /// The device reported an error or was lost; no picture was made.
    #[error("graphics device failed while {stage}: {reason}")]
    Device {
        /// The stage that was running.
        stage: String,
        /// What the driver said.
        reason: String,
    },
    /// Two images that cannot be compared.
    #[error("cannot compare: {0}")]
    Compare(String),
}

/// The library's result.
pub type Result<T, E = Error> = std::result::Result<T, E>;
