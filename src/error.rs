//! The one error type of the library.

use std::fmt::{self, Write as _};
use std::io;
use std::path::{Path, PathBuf};

/// The library's result.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can go wrong.
///
/// `{}` gives the message alone: one line without a trailing full stop, in the words of the library. The cause, if
/// there is one, is what [`source`](std::error::Error::source) returns; the message does not repeat it, so a report
/// that walks the chain prints each fact once. `{:#}` gives the whole of it in one line: message, cause and way out.
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
    /// A file could not be opened or read.
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// An output could not be created, written or renamed into place.
    Write {
        /// The file asked for (not the temporary one).
        path: PathBuf,
        /// What the operating system or the encoder said.
        source: io::Error,
    },
    /// A path that cannot be an output: a directory, a device, an unknown extension; or a picture that the format of
    /// the output cannot hold.
    Output {
        /// The file asked for.
        path: PathBuf,
        /// Why it cannot be written.
        reason: String,
    },
    /// A file is malformed, truncated, inconsistent or uses a feature that is not read.
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
        /// What the caller can do about it, if anything.
        hint: Option<Hint>,
    },
    /// A volume that cannot be rendered: empty, too large, a singular grid.
    Volume(String),
    /// A volume with samples that are NaN or infinite.
    NonFinite {
        /// How many samples are NaN or infinite.
        count: u64,
        /// Lattice point (x, y, z) of the first of them.
        first: [u32; 3],
    },
    /// A transfer function that cannot be used.
    Transfer(String),
    /// A camera that sees nothing or is not defined.
    Camera(String),
    /// A setting or an option out of its range, or at odds with another one.
    Setting {
        /// The setting: the name of its field, with `_` or `-` between words.
        name: &'static str,
        /// What was given and what would be accepted.
        reason: String,
    },
    /// No usable graphics adapter.
    NoAdapter(String),
    /// The adapter lacks a feature or a limit that the request needs.
    Unsupported {
        /// The adapter's name.
        adapter: String,
        /// What it lacks and what to do instead.
        reason: String,
    },
    /// There is no host memory for a volume or a picture.
    Memory {
        /// What the memory is for.
        what: String,
        /// Bytes asked for.
        bytes: u64,
    },
    /// The GPU ran out of memory.
    OutOfMemory(String),
    /// The device reported an error or was lost; no picture was made.
    Device {
        /// The stage that was running.
        stage: String,
        /// What the driver said.
        reason: String,
    },
    /// Pixels that do not make a picture.
    Image(String),
    /// Two pictures that cannot be compared.
    Compare(String),
}

/// What the caller can do about an [`Error`]: a way out that a program can offer in its own words.
///
/// `Display` says it in the words of the library.
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
    /// Some samples are NaN or infinite: choose a number that takes their place.
    ReplaceNonFinite,
    /// The folder holds several series: choose one.
    ChooseSeries,
    /// A series lacks slices: interpolate them.
    InterpolateSlices,
    /// The file has several channels: choose one.
    ChooseChannel,
    /// The file has several data sets: name one behind the name of the file.
    ChooseDataset,
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
            Self::ChooseDataset => "load FILE:/PATH/OF/SET",
        })
    }
}

impl Error {
    /// An [`Error::Format`] without a hint.
    pub(crate) fn format(path: &Path, reason: impl Into<String>) -> Self {
        Self::Format { path: path.to_owned(), reason: reason.into(), hint: None }
    }

    /// The same error, with a hint if it is an [`Error::Format`].
    pub(crate) fn hinted(mut self, way_out: Hint) -> Self {
        if let Self::Format { hint, .. } = &mut self {
            *hint = Some(way_out);
        }
        self
    }

    /// Whether a way to draw is refused, and another way may still succeed.
    pub(crate) fn refuses_settings(&self) -> bool {
        matches!(self, Self::Setting { .. } | Self::Unsupported { .. } | Self::Memory { .. } | Self::OutOfMemory(_))
    }

    /// What the caller can do about it, if the library knows a way out that its message does not state.
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
            Self::Write { path, .. } => write!(f, "cannot write {}", path.display()),
            Self::Output { path, reason } => write!(f, "cannot write {}: {}", path.display(), Line(reason)),
            Self::Format { path, reason, .. } => write!(f, "{}: {}", path.display(), Line(reason)),
            Self::Volume(reason) => write!(f, "volume: {}", Line(reason)),
            Self::NonFinite { count, first: [x, y, z] } => {
                let are = if *count == 1 { "sample is" } else { "samples are" };
                write!(f, "volume: {count} {are} NaN or infinite, the first at ({x}, {y}, {z})")
            }
            Self::Transfer(reason) => write!(f, "transfer function: {}", Line(reason)),
            Self::Camera(reason) => write!(f, "camera: {reason}"),
            Self::Setting { name, reason } => write!(f, "{name}: {}", Line(reason)),
            Self::NoAdapter(reason) => write!(f, "no graphics adapter: {reason}"),
            Self::Unsupported { adapter, reason } => write!(f, "adapter {adapter} {reason}"),
            Self::Memory { what, bytes } => write!(f, "no memory for {what}: {bytes} bytes"),
            Self::OutOfMemory(stage) => write!(f, "out of GPU memory while {stage}"),
            Self::Device { stage, reason } => write!(f, "graphics device failed while {stage}: {reason}"),
            Self::Image(reason) => write!(f, "picture: {reason}"),
            Self::Compare(reason) => write!(f, "cannot compare: {reason}"),
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

/// The most characters of a reason that are shown.
const MAX_REASON: usize = 400;

/// A reason in one line of bearable length. It may quote what a user wrote or a file holds, of any length and with any
/// characters: control characters, which could steer a terminal, become blanks, and the middle of a long one is left
/// out.
struct Line<'a>(&'a str);

impl fmt::Display for Line<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plain = |c: char| if c.is_control() { ' ' } else { c };
        // The end states what is expected, so it is kept as well.
        let half = MAX_REASON / 2;
        match (self.0.char_indices().nth(half), self.0.char_indices().rev().nth(half - 1)) {
            (Some((head, _)), Some((tail, _))) if head < tail => {
                self.0[..head].chars().map(plain).try_for_each(|c| f.write_char(c))?;
                f.write_str(" ... ")?;
                self.0[tail..].chars().map(plain).try_for_each(|c| f.write_char(c))
            }
            _ => self.0.chars().map(plain).try_for_each(|c| f.write_char(c)),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Read { source, .. } | Self::Write { source, .. } => Some(source),
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

    #[test]
    fn long_reasons_keep_their_ends() {
        let reason = format!("colour \"{}\n\u{1b}[2J\", expected #rrggbb", "ä".repeat(100_000));
        let said = Error::Transfer(reason).to_string();
        assert!(said.starts_with("transfer function: colour \"ä") && said.ends_with("expected #rrggbb"), "{said}");
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
