//! Output files: they appear whole or not at all.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::error::{Error, Result};

fn directory_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Returns the file behind a path. Follows links, because a rename onto a link would replace the link.
fn target(path: &Path) -> Result<PathBuf> {
    let error = |reason: String| Error::Output { path: path.to_owned(), reason };
    // `Path` drops a separator behind a name, and a dot behind the separator.
    let name = path.file_name().unwrap_or_default().as_encoded_bytes();
    if !path.as_os_str().as_encoded_bytes().ends_with(name) {
        return Err(error("it ends as a directory does, expected a file name".to_owned()));
    }
    let mut file = path.to_owned();
    if path.is_symlink() {
        file = path.canonicalize().map_err(|e| error(format!("it is a link that leads nowhere: {e}")))?;
    }
    if file.is_dir() {
        return Err(error("it is a directory, expected a file name".to_owned()));
    }
    // A rename would replace a device or a pipe instead of writing to it.
    if file.exists() && !file.is_file() {
        return Err(error("it is not a regular file".to_owned()));
    }
    Ok(file)
}

/// Refuses a path that cannot be written, before the work whose result would be lost.
///
/// # Errors
/// [`Error::Output`] if the path is a directory, a device or a pipe, or its own directory does not exist or cannot be
/// written to; [`Error::Write`] if no file can have that name.
pub fn check_writable(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    let target = target(path)?;
    let directory = directory_of(&target);
    let refused = |reason: String| Err(Error::Output { path: path.to_owned(), reason });
    if !directory.is_dir() {
        let name = directory.display();
        let exists = directory.exists();
        return refused(if exists {
            format!("{name} is no directory")
        } else {
            format!("there is no directory {name}")
        });
    }
    // The name is too long, or has characters that the system does not accept.
    if let Err(source) = target.symlink_metadata()
        && source.kind() != io::ErrorKind::NotFound
    {
        return Err(Error::Write { path: path.to_owned(), source });
    }
    #[cfg(target_os = "linux")]
    if unnamed(directory).is_some() {
        return Ok(());
    }
    named(directory).map(drop).or_else(|e| refused(format!("no file can be made in {}: {e}", directory.display())))
}

/// The temporary names of files that are being written; `None` if no more may be made. The lock is held while a name is
/// made or removed, so that its holder knows all names.
struct Unfinished(Mutex<Option<Vec<PathBuf>>>);

static UNFINISHED: Unfinished = Unfinished::new();

/// Removes the temporary files of pictures that are being written, and prevents new ones: from here on
/// [`Image::save`](crate::Image::save) fails.
///
/// For programs that handle signals: call it before the process ends, not in the signal handler but in the thread that
/// receives the signal. On Linux a picture mostly has no name until it is complete, on file systems with unnamed files.
pub fn abandon_unfinished() {
    UNFINISHED.abandon();
}

impl Unfinished {
    const fn new() -> Self {
        Self(Mutex::new(Some(Vec::new())))
    }

    fn abandon(&self) {
        let names = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        // A file that cannot be removed cannot be reported either: the process ends.
        names.iter().flatten().for_each(|name| drop(std::fs::remove_file(name)));
    }

    /// Runs `step` with the temporary names, unless no more may be made.
    fn with<T>(&self, step: impl FnOnce(&mut Vec<PathBuf>) -> io::Result<T>) -> io::Result<T> {
        match &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(names) => step(names),
            None => Err(io::Error::other("the program is ending")),
        }
    }

    /// Writes a file under a temporary name and renames it when it is complete.
    fn write_named(&self, target: &Path, write: &impl Fn(&mut File) -> io::Result<()>) -> io::Result<()> {
        let mut file = self.with(|names| {
            let file = named(directory_of(target))?;
            names.push(file.path().to_owned());
            Ok(file)
        })?;
        keep_permissions(file.as_file(), target);
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

/// Makes a file under a temporary name, with the permissions of the user's umask. Errors do not state the name.
fn named(directory: &Path) -> io::Result<tempfile::NamedTempFile> {
    let create = |path: &Path| File::options().read(true).write(true).create_new(true).open(path);
    temporary().make_in(directory, create)
}

/// Makes a file in `directory` without a name, which vanishes with the process; `None` if the system has no such files.
#[cfg(target_os = "linux")]
fn unnamed(directory: &Path) -> Option<File> {
    use std::os::unix::fs::OpenOptionsExt;
    let flags = rustix::fs::OFlags::TMPFILE.bits().cast_signed();
    let file = File::options().read(true).write(true).mode(0o666).custom_flags(flags).open(directory).ok()?;
    // The link that names it goes through this folder.
    Path::new("/proc/self/fd").is_dir().then_some(file)
}

/// Gives a new file the permissions of the file that it will replace, so that a private picture stays private. File
/// systems without permissions refuse, which changes nothing.
fn keep_permissions(file: &File, replaced: &Path) {
    if let Ok(metadata) = replaced.metadata() {
        drop(file.set_permissions(metadata.permissions()));
    }
}

/// Writes a file that gets the name `path` when it is complete.
///
/// # Errors
/// [`Error::Output`] if `path` is a directory, a device or a pipe, [`Error::Write`] if any step fails. Nothing is left
/// behind then, and an older file stays unchanged.
pub(crate) fn write_atomically(path: &Path, write: impl Fn(&mut File) -> io::Result<()>) -> Result<()> {
    let failed = |source| Error::Write { path: path.to_owned(), source };
    let target = target(path)?;
    #[cfg(target_os = "linux")]
    if let Some(mut file) = unnamed(directory_of(&target)) {
        keep_permissions(&file, &target);
        write(&mut file).map_err(failed)?;
        // File systems without links fail here, and succeed with a temporary name.
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

    /// Runs a test with both ways to write: as the system does it, and under a temporary name.
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

    #[cfg(unix)]
    #[test]
    fn a_file_keeps_the_permissions_of_the_one_that_it_replaces() {
        use std::os::unix::fs::PermissionsExt;
        both_ways(|path, write| {
            write(b"public", false).unwrap();
            std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).unwrap();
            write(b"private", false).unwrap();
            assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o600);
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
