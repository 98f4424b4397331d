//! The difference of two pictures, and speed against error.

mod compare;
mod date;
#[cfg(feature = "report")]
mod plot;
mod sample;
mod study;

pub use compare::{Comparison, compare, difference_picture};
pub(crate) use compare::{covered_differences, percentile};
pub use date::today;
#[cfg(feature = "report")]
pub use plot::{Marker, Point, plot};
pub use sample::Sample;
pub use study::{Errors, Measurement, Study, Variant, front, variants};
pub use voxsplat_volume::names::{escaped, readable};

use std::io::Write as _;
use std::path::Path;

use crate::error::Result;

/// Refuses a path that [`write_file`] could not write.
///
/// # Errors
/// Those of [`write_file`].
pub fn check_file(path: impl AsRef<Path>) -> Result<()> {
    crate::output::check_writable(path.as_ref())
}

/// Writes a file of a report. It appears whole or not at all, in place of an older one.
///
/// # Errors
/// [`Error::Output`](crate::error::Error::Output) if the path is a directory, a device or a pipe;
/// [`Error::Write`](crate::error::Error::Write) if writing fails.
pub fn write_file(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    crate::output::write_atomically(path.as_ref(), |file| file.write_all(bytes))
}
