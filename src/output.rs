//! Output files: they appear whole or not at all.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

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
    // `Path` drops what follows a name: a separator, or a dot behind it.
    let name = path.file_name().unwrap_or_default().as_encoded_bytes();
    if !path.as_os_str().as_encoded_bytes().ends_with(name) {
        return error("it ends as a directory does, expected a file name");
    }
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
/// [`Error::Output`] if the path is a directory, a device or a pipe, or its own directory does not exist or cannot be
/// written to; [`Error::Write`] if no file can have that name.
pub fn check_writable(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    let target = target(path)?;
    let directory = directory_of(&target);
    if !directory.is_dir() {
        let name = directory.display();
        let reason = match directory.exists() {
            true => format!("{name} is no directory"),
            false => format!("there is no directory {name}"),
        };
        return Err(Error::Output { path: path.to_owned(), reason });
    }
    let failed = |source| Err(Error::Write { path: path.to_owned(), source });
    match target.symlink_metadata() {
        // The name is too long, or has characters that the system does not take.
        Err(e) if e.kind() != io::ErrorKind::NotFound => return failed(e),
        _ => {}
    }
    #[cfg(target_os = "linux")]
    if unnamed(&directory).is_some() {
        return Ok(());
    }
    named(&directory).map(drop).map_err(|source| {
        let reason = format!("no file can be made in {}: {source}", directory.display());
        Error::Output { path: path.to_owned(), reason }
    })
}

/// The temporary names of files that are being written. The lock is held while a name is made or given up, so whoever
/// holds it knows all names.
struct Unfinished(Mutex<Names>);

enum Names {
    Open(Vec<PathBuf>),
    /// No name is made any more.
    Closed,
}

static UNFINISHED: Unfinished = Unfinished::new();

/// Removes the temporary files of pictures that are being written, and lets no other begin: from here on
/// [`Image::save`](crate::Image::save) fails.
///
/// For a program that handles signals: call it before the process ends, not in the signal handler itself but in the
/// thread that is told of the signal. Linux needs it least: a picture has no name there until it is complete, on file
/// systems that know unnamed files.
pub fn abandon_unfinished() {
    UNFINISHED.abandon();
}

impl Unfinished {
    const fn new() -> Self {
        Self(Mutex::new(Names::Open(Vec::new())))
    }

    fn abandon(&self) {
        let mut names = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Names::Open(names) = std::mem::replace(&mut *names, Names::Closed) {
            // What cannot be removed cannot be reported either: the process ends.
            names.iter().for_each(|name| drop(std::fs::remove_file(name)));
        }
    }

    /// Runs `step` with the names, unless they are closed.
    fn with<T>(&self, step: impl FnOnce(&mut Vec<PathBuf>) -> io::Result<T>) -> io::Result<T> {
        match &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            Names::Open(names) => step(names),
            Names::Closed => Err(io::Error::other("the program is ending")),
        }
    }

    /// Writes a file under a temporary name and renames it when it is complete.
    fn write_named(&self, target: &Path, write: &impl Fn(&mut File) -> io::Result<()>) -> io::Result<()> {
        let mut file = self.with(|names| {
            let file = named(&directory_of(target))?;
            names.push(file.path().to_owned());
            Ok(file)
        })?;
        let written = write(file.as_file_mut());
        self.with(|names| {
            names.retain(|name| name != file.path());
            written?;
            file.persist(target).map_err(|e| e.error)?;
            Ok(())
        })
    }

    /// Gives a complete unnamed file its name.
    #[cfg(target_os = "linux")]
    fn name(&self, file: &File, target: &Path) -> io::Result<()> {
        use rustix::fs::{AtFlags, CWD, linkat};
        use std::os::fd::AsRawFd;
        let open = format!("/proc/self/fd/{}", file.as_raw_fd());
        let link =
            |path: &Path| linkat(CWD, open.as_str(), CWD, path, AtFlags::SYMLINK_FOLLOW).map_err(io::Error::from);
        self.with(|_| match link(target) {
            // A link replaces nothing, a rename does.
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {
                temporary().make_in(directory_of(target), link)?.persist(target).map_err(|e| e.error)
            }
            linked => linked,
        })
    }
}

fn temporary() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".voxsplat-");
    builder
}

/// A file under a temporary name, with the permissions of the user's umask. Its error does not state that name.
fn named(directory: &Path) -> io::Result<tempfile::NamedTempFile> {
    let create = |path: &Path| File::options().read(true).write(true).create_new(true).open(path);
    temporary().make_in(directory, create)
}

/// A file in `directory` without a name, which vanishes with the process; `None` if the system has none.
#[cfg(target_os = "linux")]
fn unnamed(directory: &Path) -> Option<File> {
    use std::os::unix::fs::OpenOptionsExt;
    let flags = rustix::fs::OFlags::TMPFILE.bits().cast_signed();
    let file = File::options().read(true).write(true).mode(0o666).custom_flags(flags).open(directory).ok()?;
    // It is named by way of this folder.
    Path::new("/proc/self/fd").is_dir().then_some(file)
}

/// Writes a file that takes the name `path` when it is complete.
///
/// # Errors
/// [`Error::Output`] if `path` is a directory, a device or a pipe, [`Error::Write`] if any step fails. Nothing is left
/// behind then, and an older file stays as it was.
pub(crate) fn write_atomically(path: &Path, write: impl Fn(&mut File) -> io::Result<()>) -> Result<()> {
    let failed = |source| Error::Write { path: path.to_owned(), source };
    let target = target(path)?;
    #[cfg(target_os = "linux")]
    if let Some(mut file) = unnamed(&directory_of(&target)) {
        write(&mut file).map_err(failed)?;
        // File systems without links fail here, and succeed by the other way.
        if UNFINISHED.name(&file, &target).is_ok() {
            return Ok(());
        }
    }
    UNFINISHED.write_named(&target, &write).map_err(failed)
}

/// Writes a file. It appears whole or not at all, in place of an older one.
///
/// # Errors
/// [`Error::Output`] if the path is a directory, a device or a pipe; [`Error::Write`] if writing fails.
pub fn write_file(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    write_atomically(path.as_ref(), |file| io::Write::write_all(file, bytes))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    /// The ways to write: as the system does it, and under a temporary name.
    fn both_ways(test: impl Fn(&Path, &dyn Fn(&[u8], bool) -> Result<()>)) {
        let unfinished = Unfinished::new();
        for named in [false, true] {
            let directory = tempfile::tempdir().unwrap();
            let path = directory.path().join("out.txt");
            test(&path, &|bytes: &[u8], fails: bool| {
                let write = |file: &mut File| {
                    file.write_all(bytes)?;
                    if fails { Err(io::Error::other("disk full")) } else { Ok(()) }
                };
                match named {
                    true => unfinished
                        .write_named(&path, &write)
                        .map_err(|source| Error::Write { path: path.clone(), source }),
                    false => write_atomically(&path, write),
                }
            });
            let left: Vec<_> = std::fs::read_dir(directory.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
            assert_eq!(left, ["out.txt"]);
        }
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        both_ways(|path, write| {
            write(b"older", false).unwrap();
            write(b"old", false).unwrap();
            let error = write(b"ne", true).unwrap_err();
            assert!(format!("{error:#}").ends_with("out.txt: disk full"), "{error:#}");
            assert_eq!(std::fs::read(path).unwrap(), b"old");
        });
    }

    #[test]
    fn an_abandoned_write_leaves_nothing() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out.txt");
        let unfinished = Unfinished::new();
        let files = || std::fs::read_dir(directory.path()).unwrap().count();
        let error = unfinished.write_named(&path, &|file| {
            assert_eq!(files(), 1);
            // As a signal does while bytes are written.
            unfinished.abandon();
            assert_eq!(files(), 0);
            file.write_all(b"new")
        });
        assert_eq!(error.unwrap_err().to_string(), "the program is ending");
        let refused = unfinished.write_named(&path, &|file| file.write_all(b"new"));
        assert_eq!(refused.unwrap_err().to_string(), "the program is ending");
        assert_eq!(files(), 0);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn an_unnamed_file_has_no_name_before_it_is_complete() {
        let directory = tempfile::tempdir().unwrap();
        if unnamed(directory.path()).is_none() {
            return;
        }
        for _ in 0..2 {
            write_atomically(&directory.path().join("out.txt"), |file| {
                let names: Vec<_> = std::fs::read_dir(directory.path()).unwrap().collect();
                assert!(names.iter().all(|n| n.as_ref().unwrap().file_name() == "out.txt"), "{names:?}");
                file.write_all(b"new")
            })
            .unwrap();
        }
    }

    #[test]
    fn impossible_targets_are_named_before_the_work() {
        let directory = tempfile::tempdir().unwrap();
        let missing = check_writable(directory.path().join("no/out.png")).unwrap_err().to_string();
        assert!(missing.contains("there is no directory"), "{missing}");
        let folder = check_writable(directory.path()).unwrap_err().to_string();
        assert!(folder.contains("is a directory"), "{folder}");
        for end in ["/", "//", "/.", "/./"] {
            let name = format!("{}{end}", directory.path().join("a.png").display());
            let folder = check_writable(Path::new(&name)).unwrap_err().to_string();
            assert!(folder.contains("ends as a directory does"), "{name}: {folder}");
        }
        let long = check_writable(directory.path().join("a".repeat(300)));
        assert!(matches!(long, Err(Error::Write { .. })), "no file has so long a name: {long:?}");
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
