//! The volumes of a source at its points in time, one after the other.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::input::Unpacked;
use super::{LoadOptions, load_from};
use crate::error::Result;
use crate::volume::Volume;

/// The volumes of a source at its points in time, which [`Contents::times`](crate::volume::Contents::times) of any of
/// them counts.
///
/// [`load`](super::load) reads each of them too, but decompresses a stream such as `scan.nii.gz` from its beginning for
/// each. This type decompresses it once, into a temporary file that has no name and is gone with the series
/// and its volumes. If there is no room for that, it is decompressed for each volume.
///
/// ```no_run
/// use voxsplat_volume::formats::{LoadOptions, TimeSeries};
///
/// let mut series = TimeSeries::new("heart.nii.gz", &LoadOptions::default());
/// let times = series.volume(0)?.contents().times;
/// for time in 0..times {
///     println!("{:?}", series.volume(time)?.grid());
/// }
/// # Ok::<(), voxsplat_volume::Error>(())
/// ```
#[derive(Debug)]
pub struct TimeSeries {
    source: PathBuf,
    options: LoadOptions,
    unpacked: Arc<Unpacked>,
}

impl TimeSeries {
    /// Makes the series of a source that [`load`](super::load) accepts; `time` of the options is ignored. Nothing is
    /// read yet.
    #[must_use]
    pub fn new(source: impl AsRef<Path>, options: &LoadOptions) -> Self {
        Self { source: source.as_ref().to_owned(), options: *options, unpacked: Arc::default() }
    }

    /// Reads the volume at a point in time, counted from 0.
    ///
    /// # Errors
    /// The errors of [`load`](super::load); [`Error::Setting`](crate::error::Error::Setting) if the source has no such
    /// point in time.
    pub fn volume(&mut self, time: u32) -> Result<Volume> {
        self.read(&LoadOptions { time: Some(time), ..self.options })
    }

    /// Reads a channel at a point in time, both counted from 0.
    ///
    /// # Errors
    /// The errors of [`Self::volume`]; [`Error::Setting`](crate::error::Error::Setting) if there is no such channel.
    pub fn channel(&mut self, time: u32, channel: u32) -> Result<Volume> {
        self.read(&LoadOptions { time: Some(time), channel: Some(channel), ..self.options })
    }

    /// Reads a volume of the series. Readers of one temporary file share its position, so there is one at a time.
    fn read(&mut self, options: &LoadOptions) -> Result<Volume> {
        load_from(&self.source, options, Some(&self.unpacked))
    }
}
