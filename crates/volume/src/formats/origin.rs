//! A file whose bytes are read at any place: on this machine, or at a url.

use std::fs::File;
use std::io;
use std::sync::Arc;

use crate::error::Damage;
use crate::files::read_exact_at;
#[cfg(feature = "remote")]
use crate::files::remote::RemoteFile;

/// A file whose bytes are read at any place, by any number of threads.
#[derive(Clone)]
pub(super) enum FileOrigin {
    File(Arc<File>),
    #[cfg(feature = "remote")]
    Url(Arc<RemoteFile>),
}

impl FileOrigin {
    /// Returns whether the bytes are fetched from a url.
    #[cfg_attr(not(feature = "zarr"), expect(dead_code, reason = "for chunks of Zarr"))]
    pub(super) fn is_fetched(&self) -> bool {
        !matches!(self, Self::File(_))
    }

    /// Reads the `length` bytes at an offset.
    pub(super) fn range(&self, offset: u64, length: u64) -> io::Result<Vec<u8>> {
        match self {
            Self::File(file) => {
                // No memory is reserved for bytes that are not there.
                let end = offset.checked_add(length).filter(|end| file.metadata().is_ok_and(|meta| *end <= meta.len()));
                let size = end.and_then(|_| usize::try_from(length).ok()).ok_or_else(|| Damage.error("cut short"))?;
                let mut bytes = Vec::new();
                bytes.try_reserve_exact(size).map_err(|_| io::ErrorKind::OutOfMemory)?;
                bytes.resize(size, 0);
                read_exact_at(file, &mut bytes, offset)?;
                Ok(bytes)
            }
            #[cfg(feature = "remote")]
            Self::Url(file) => file.range(offset, length),
        }
    }

    /// Returns the first or the last `length` bytes, or fewer if the file is shorter, and the length of the file.
    pub(super) fn edge(&self, first: bool, length: u64) -> io::Result<(Vec<u8>, u64)> {
        match self {
            Self::File(file) => {
                let total = file.metadata()?.len();
                let length = length.min(total);
                Ok((self.range(if first { 0 } else { total - length }, length)?, total))
            }
            #[cfg(feature = "remote")]
            Self::Url(file) => file.edge(first, length),
        }
    }
}
