//! Stand-in: files written whole or not at all.

use std::fs::File;
use std::io;
use std::path::Path;

use crate::error::{Error, Result};

/// Writes a file through a temporary one beside it.
///
/// # Errors
/// [`Error::Write`].
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut File) -> io::Result<()>) -> Result<()> {
    let error = |reason: String| Error::Write { path: path.to_owned(), reason };
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or_else(|| Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder).map_err(|e| error(e.to_string()))?;
    write(file.as_file_mut()).map_err(|e| error(e.to_string()))?;
    file.persist(path).map_err(|e| error(e.to_string()))?;
    Ok(())
}
