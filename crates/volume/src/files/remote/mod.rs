//! Files at urls, of http, https and S3: whole, or by ranges of bytes.
//!
//! A url that a user gives is registered: [`registered`] returns its path without credentials, by which all readers
//! know the file, the files in it and the files beside it. So no error shows a password or a token.
//!
//! The client is `ureq`, which blocks, with a signature for S3 here: 19 packages, and 66 s of one processor in a cold
//! build alone. `object_store` needs 97 packages, an asynchronous runtime and 255 s; `ureq` with `rusty-s3` needs 64
//! packages and 157 s.

mod address;
#[cfg(feature = "remote")]
mod client;
#[cfg(feature = "remote")]
mod file;
#[cfg(feature = "remote")]
mod s3;

use std::borrow::Cow;
use std::fs::File;
use std::path::Path;
use std::time::Duration;

pub use address::{is_url, without_credentials};
#[cfg(all(feature = "remote", feature = "zarr"))]
pub(crate) use client::{check_limit, is_denied, report, size};
#[cfg(feature = "remote")]
pub(crate) use file::RemoteFile;

use crate::error::Result;

/// Whether this build fetches files at urls.
#[doc(hidden)]
pub const CAN_FETCH: bool = cfg!(feature = "remote");

/// The number of requests at once.
pub(crate) const CONNECTIONS: usize = 16;

/// The conditions of fetching files at urls.
///
/// End a literal with `..FetchOptions::default()`: a minor release may add fields.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FetchOptions {
    /// The largest number of bytes to fetch for a volume; 1 GiB by default. A larger volume is an error.
    pub limit: u64,
    /// The longest wait for a connection, and for the next bytes; 30 s by default. An answer must bring 4 KiB/s on
    /// average as well, from this time on.
    pub timeout: Duration,
    /// The largest number of times that a request is made; 6 by default. Requests are repeated if the server is busy or
    /// fails (HTTP 408, 425, 429, 500, 502, 503 and 504), or the connection does.
    pub attempts: u32,
    /// The wait before the second request; 0.5 s by default. It doubles with each request, up to 64 times this wait. A
    /// server may ask for a longer one, up to the same bound.
    pub wait: Duration,
    /// A callback for the progress: the bytes that were fetched, and the fraction that is done.
    pub progress: Option<FetchProgress>,
    /// Makes literals that name all fields impossible.
    #[doc(hidden)]
    pub non_exhaustive: (),
}

/// A callback for the progress of fetching. Callbacks are the same if they are the same function.
#[derive(Debug, Clone, Copy)]
pub struct FetchProgress(pub fn(u64, f64));

impl PartialEq for FetchProgress {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::fn_addr_eq(self.0, other.0)
    }
}

impl Default for FetchOptions {
    fn default() -> Self {
        Self {
            limit: 1 << 30,
            timeout: Duration::from_secs(30),
            attempts: 6,
            wait: Duration::from_millis(500),
            progress: None,
            non_exhaustive: (),
        }
    }
}

/// Returns the path by which readers know a source: of a url, the url without credentials, which are kept for the
/// requests.
///
/// # Errors
/// [`Error::Format`](crate::Error::Format) if the url is malformed, or this build cannot fetch.
pub(crate) fn registered<'a>(source: &'a Path, options: &FetchOptions) -> Result<Cow<'a, Path>> {
    if !is_url(source) {
        return Ok(Cow::Borrowed(source));
    }
    client::register(source, options).map(Cow::Owned)
}

/// Fetches a whole file to a file without a name, and returns its length.
///
/// # Errors
/// [`Error::Read`](crate::Error::Read) if the file cannot be fetched; [`Error::Format`](crate::Error::Format) if it is
/// larger than the limit, or this build cannot fetch.
pub(crate) fn open(path: &Path) -> Result<(File, u64)> {
    let text = path.to_string_lossy();
    match without_credentials(&text) == text {
        true => client::download(path),
        false => client::download(&client::register(path, &FetchOptions::default())?),
    }
}

/// What a build without the feature does with urls.
#[cfg(not(feature = "remote"))]
mod client {
    use std::fs::File;
    use std::path::{Path, PathBuf};

    use super::{FetchOptions, without_credentials};
    use crate::error::{Error, Result};

    pub(super) fn register(source: &Path, _: &FetchOptions) -> Result<PathBuf> {
        let shown = without_credentials(&source.to_string_lossy()).into_owned();
        Err(Error::format(Path::new(&shown), "is a url, and this build lacks --features remote: fetch it first"))
    }

    pub(super) fn download(path: &Path) -> Result<(File, u64)> {
        register(path, &FetchOptions::default()).and_then(|_| Err(Error::format(path, "is a url")))
    }
}
