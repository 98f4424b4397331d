//! The one error type of this crate.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// The result type of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Faults of a file or a volume.
///
/// `{}` gives the message alone: one line without a trailing full stop. The cause, if there is one, is
/// [`source`](std::error::Error::source); the message does not repeat it. `{:#}` gives message, cause and remedy in one
/// line.
///
/// ```
/// use voxsplat_volume::formats::{LoadOptions, load};
///
/// let error = load("missing.nrrd", &LoadOptions::default()).unwrap_err();
/// assert_eq!(error.to_string(), "cannot read missing.nrrd");
/// assert!(format!("{error:#}").starts_with("cannot read missing.nrrd: "));
/// ```
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be opened or read.
    Read {
        /// The path of the file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A file is malformed, truncated, inconsistent or uses a feature that is not read.
    Format {
        /// The path of the file.
        path: PathBuf,
        /// The fault of the file.
        reason: String,
        /// The remedy, if there is one.
        hint: Option<Hint>,
    },
    /// A volume that cannot be rendered: empty, too large, or with a singular grid.
    Volume(String),
    /// A volume with samples that are NaN or infinite.
    NonFinite {
        /// Number of samples that are NaN or infinite.
        count: u64,
        /// The lattice point (x, y, z) of the first sample that is NaN or infinite.
        first: [u32; 3],
    },
    /// A setting or an option out of its range, or at odds with another one.
    Setting {
        /// The setting: the name of its field, with `_` or `-` between words.
        name: &'static str,
        /// The given value and the accepted values.
        reason: String,
    },
    /// A lack of host memory for a volume or a picture.
    Memory {
        /// The purpose of the memory.
        what: String,
        /// The requested bytes.
        bytes: u64,
    },
}

/// A remedy for an [`Error`], which a program can offer in its own words. `Display` uses the words of the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Hint {
    /// The file has no header: state the number of samples along each axis.
    GiveDims,
    /// The file has no header: state the type of its samples.
    GiveSampleType,
    /// The file may have no header: state the number of samples along each axis, and their type.
    GiveDimsAndSampleType,
    /// The header's spacing is no length: state the distance between samples.
    GiveSpacing,
    /// Some samples are NaN or infinite: choose a number to replace them.
    ReplaceNonFinite,
    /// The file or folder holds several series: choose one.
    ChooseSeries,
    /// A series lacks slices, or has unequally spaced ones: interpolate them.
    InterpolateSlices,
    /// The file has several channels: choose one.
    ChooseChannel,
    /// The file has several data sets: name one behind the name of the file.
    ChooseDataset,
    /// The samples are complex: choose one number of each.
    ChooseComplexPart,
    /// The volume at a url is larger than the limit: raise it, or read a coarser level or a part.
    RaiseFetchLimit,
}

impl fmt::Display for Hint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::GiveDims => "set LoadOptions::dims",
            Self::GiveSampleType => "set LoadOptions::sample_type",
            Self::GiveDimsAndSampleType => "for bare samples set LoadOptions::dims and LoadOptions::sample_type",
            Self::GiveSpacing => "set LoadOptions::spacing",
            Self::ReplaceNonFinite => "set LoadOptions::replace_nan or call Volume::with_non_finite_replaced",
            Self::ChooseSeries => "set LoadOptions::series",
            Self::InterpolateSlices => "set LoadOptions::missing_slices",
            Self::ChooseChannel => "set LoadOptions::channel",
            Self::ChooseDataset => "load FILE:NAME",
            Self::ChooseComplexPart => "set LoadOptions::complex",
            Self::RaiseFetchLimit => "set FetchOptions::limit, or a coarser LoadOptions::level",
        })
    }
}

/// Returns an [`Error`] about a file, or [`Damage`] of its content, from a function: `refuse!(path, "has {n} axes")`.
macro_rules! refuse {
    ($subject:expr, $($reason:tt)+) => {
        return Err($subject.error(format!($($reason)+)))
    };
}
pub(crate) use refuse;

/// Returns from a function as [`refuse!`] does, if a condition holds: `refuse_if!(n > 3, path, "has {n} axes")`.
macro_rules! refuse_if {
    ($condition:expr, $($refusal:tt)+) => {
        if $condition {
            $crate::error::refuse!($($refusal)+);
        }
    };
}
pub(crate) use refuse_if;

/// A fault in the content of a file, for readers that do not know its name: see [`Error::of_content`].
pub(crate) struct Damage;

impl Damage {
    pub(crate) fn error(&self, reason: impl Into<String>) -> io::Error {
        io::Error::new(io::ErrorKind::InvalidData, reason.into())
    }
}

/// The file that an error is about.
pub(crate) trait Subject {
    /// Makes an [`Error::Format`] about this file.
    fn error(&self, reason: impl Into<String>) -> Error;
}

impl Subject for Path {
    fn error(&self, reason: impl Into<String>) -> Error {
        Error::format(self, reason)
    }
}

impl Error {
    /// Makes an [`Error::Format`] without a hint.
    #[must_use]
    pub fn format(path: &Path, reason: impl Into<String>) -> Self {
        Self::Format { path: path.to_owned(), reason: reason.into(), hint: None }
    }

    /// Makes an [`Error::Read`], for `map_err`.
    pub(crate) fn read(path: &Path) -> impl Fn(io::Error) -> Self {
        |source| Self::Read { path: path.to_owned(), source }
    }

    /// Makes an [`Error::Setting`].
    pub(crate) fn setting(name: &'static str, reason: impl Into<String>) -> Self {
        Self::Setting { name, reason: reason.into() }
    }

    /// Converts a failed read to [`Error::Format`] if the content is at fault, otherwise to [`Error::Read`].
    pub(crate) fn of_content(path: &Path, source: io::Error) -> Self {
        use io::ErrorKind::{InvalidData, InvalidInput, Other, UnexpectedEof};
        match source.kind() {
            InvalidData | InvalidInput | UnexpectedEof | Other => path.error(format!("is damaged: {source}")),
            _ => Self::read(path)(source),
        }
    }

    /// Adds a hint to the error if it is an [`Error::Format`].
    #[must_use]
    pub fn hinted(mut self, way_out: Hint) -> Self {
        if let Self::Format { hint, .. } = &mut self {
            *hint = Some(way_out);
        }
        self
    }

    /// Returns the remedy, if the message does not state it.
    #[must_use]
    pub fn hint(&self) -> Option<Hint> {
        match self {
            Self::Format { hint, .. } => *hint,
            Self::NonFinite { .. } => Some(Hint::ReplaceNonFinite),
            _ => None,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read { path, .. } => write!(f, "cannot read {}", path.display()),
            Self::Format { path, reason, .. } => write!(f, "{}: {}", path.display(), Line(reason)),
            Self::Volume(reason) => write!(f, "volume: {}", Line(reason)),
            Self::NonFinite { count, first: [x, y, z] } => {
                let are = if *count == 1 { "sample is" } else { "samples are" };
                write!(f, "volume: {count} {are} NaN or infinite, the first at ({x}, {y}, {z})")
            }
            Self::Setting { name, reason } => write!(f, "{name}: {}", Line(reason)),
            Self::Memory { what, bytes } => write!(f, "no memory for {what}: {bytes} bytes"),
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

/// The largest number of characters of a reason that are shown.
const MAX_REASON: usize = 400;

/// A reason in one line of bearable length. It may quote what a user wrote or a file holds, of any length and with any
/// characters: control characters, which could steer a terminal, become blanks, and the middle of a long one is left
/// out.
pub struct Line<'a>(pub &'a str);

impl fmt::Display for Line<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plain: Vec<char> = self.0.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        // The end states the accepted values, so it is kept as well.
        let half = MAX_REASON / 2;
        match plain.len() {
            ..=MAX_REASON => f.write_str(&String::from_iter(&plain)),
            n => write!(f, "{} ... {}", String::from_iter(&plain[..half]), String::from_iter(&plain[n - half..])),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Read { source, .. } => Some(source),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_reasons_keep_their_ends() {
        let reason = format!("colour \"{}\n\u{1b}[2J\", expected #rrggbb", "ä".repeat(100_000));
        let said = Error::Volume(reason).to_string();
        assert!(said.starts_with("volume: colour \"ä") && said.ends_with("expected #rrggbb"), "{said}");
        assert!(said.chars().count() < 450 && !said.contains(char::is_control), "{said}");
        let exact = "x".repeat(MAX_REASON);
        assert_eq!(Line(&exact).to_string(), exact);
    }

    #[test]
    fn a_way_out_is_told_apart_from_the_message() {
        let error = Error::NonFinite { count: 3, first: [1, 0, 2] };
        assert_eq!(error.hint(), Some(Hint::ReplaceNonFinite));
        assert!(error.to_string().ends_with("the first at (1, 0, 2)"));
        assert!(format!("{error:#}").contains("LoadOptions::replace_nan"));
    }
}
