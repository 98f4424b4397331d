//! Output files: they appear whole or not at all.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

fn directory_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// The file that a path leads to. Links are followed: a rename onto a link would replace the link.
fn target(path: &Path) -> Result<PathBuf> {
    let error = |reason: &str| Err(Error::Output { path: path.to_owned(), reason: reason.to_owned() });
    let file = if path.is_symlink() {
        match path.canonicalize() {
            Ok(file) => file,
            Err(e) => return error(&format!("it is a link that leads nowhere: {e}")),
        }
    } else {
        path.to_owned()
    };
    if file.is_dir() {
        return error("it is a directory, expected a file name");
    }
    // A rename would replace a device or a pipe instead of writing to it.
    if file.exists() && !file.is_file() {
        return error("it is not a regular file");
    }
    Ok(file)
}

/// Refuses a path that cannot be written. It is checked before the work whose result would be lost.
///
/// # Errors
/// [`Error::Output`] if the path is a directory, a device or a pipe, or its own directory does not exist;
/// [`Error::Write`] if that directory cannot be written to.
pub(crate) fn check_writable(path: &Path) -> Result<()> {
    let directory = directory_of(&target(path)?);
    if !directory.is_dir() {
        let reason = format!("there is no directory {}", directory.display());
        return Err(Error::Output { path: path.to_owned(), reason });
    }
    match tempfile::tempfile_in(&directory) {
        Ok(_) => Ok(()),
        Err(source) => Err(Error::Write { path: path.to_owned(), source }),
    }
}

/// Writes a file under a temporary name in the directory of `path` and renames it when it is complete.
///
/// # Errors
/// [`Error::Output`] if `path` is a directory, a device or a pipe, [`Error::Write`] if any step fails. Nothing is left
/// behind then, and an older file stays as it was.
pub(crate) fn write_atomically(path: &Path, write: impl FnOnce(&mut File) -> io::Result<()>) -> Result<()> {
    let failed = |source| Error::Write { path: path.to_owned(), source };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".voxsplat-");
    // Temporary files are private by default; an output gets the permissions of the user's umask.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let target = target(path)?;
    let mut file = builder.tempfile_in(directory_of(&target)).map_err(failed)?;
    write(file.as_file_mut()).map_err(failed)?;
    file.as_file_mut().flush().map_err(failed)?;
    file.persist(&target).map_err(|e| failed(e.error))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out.txt");
        write_atomically(&path, |f| f.write_all(b"old")).unwrap();
        let error = write_atomically(&path, |f| {
            f.write_all(b"ne")?;
            Err(io::Error::other("disk full"))
        })
        .unwrap_err();
        assert!(format!("{error:#}").ends_with("out.txt: disk full"), "{error:#}");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
    }

    #[test]
    fn impossible_targets_are_named_before_the_work() {
        let directory = tempfile::tempdir().unwrap();
        let missing = check_writable(&directory.path().join("no/out.png")).unwrap_err().to_string();
        assert!(missing.contains("there is no directory"), "{missing}");
        let folder = check_writable(directory.path()).unwrap_err().to_string();
        assert!(folder.contains("is a directory"), "{folder}");
        #[cfg(unix)]
        {
            let device = check_writable(Path::new("/dev/null")).unwrap_err().to_string();
            assert!(device.contains("not a regular file"), "{device}");
            let (file, link) = (directory.path().join("file"), directory.path().join("link"));
            std::fs::write(&file, b"old").unwrap();
            std::os::unix::fs::symlink(&file, &link).unwrap();
            write_atomically(&link, |f| f.write_all(b"new")).unwrap();
            assert!(link.is_symlink());
            assert_eq!(std::fs::read(&file).unwrap(), b"new");
        }
    }
}
