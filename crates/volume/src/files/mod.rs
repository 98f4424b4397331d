//! Files that are read: regular files, files at urls, and standard input of any kind.

mod positional;
pub(crate) mod remote;

use std::fs::{File, Metadata};
use std::io::{IsTerminal, Read};
use std::path::Path;

use serde::de::DeserializeOwned;

pub(crate) use positional::read_exact_at;

use crate::error::{Error, Result, Subject, refuse_if};

/// Opens a regular file, or standard input if `path` is `-` or leads there. The second value is the length of the file
/// in bytes; `None` if standard input is a stream. A file at a url is fetched first.
///
/// Other files are refused before they are opened: to open a pipe waits for its other end, and to open a device can
/// start it.
///
/// # Errors
/// [`Error::Read`] if there is no such file or it cannot be opened; [`Error::Format`] if it is a directory, a pipe, a
/// socket or a device.
pub fn open(path: &Path) -> Result<(File, Option<u64>)> {
    if path == Path::new("-") {
        refuse_if!(std::io::stdin().is_terminal(), path, "standard input is a terminal, expected a pipe or a file");
        return Ok((stream().map_err(Error::read(path))?, None));
    }
    if remote::is_url(path) {
        return remote::open(path).map(|(file, length)| (file, Some(length)));
    }
    let meta = std::fs::metadata(path).map_err(Error::read(path))?;
    if !meta.is_file() {
        return match standard_input(&meta) {
            Some(stream) => Ok((stream, None)),
            None => Err(not_regular(path, &meta)),
        };
    }
    let file = open_at_once(path).map_err(Error::read(path))?;
    // The path can lead to another file by now.
    let meta = file.metadata().map_err(Error::read(path))?;
    if meta.is_file() { Ok((file, Some(meta.len()))) } else { Err(not_regular(path, &meta)) }
}

/// Reads the whole content of a file that [`open`] accepts, of at most `most` bytes.
///
/// # Errors
/// The errors of [`open`]; [`Error::Format`] if there are more than `most` bytes.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>> {
    let (file, _) = open(path)?;
    let mut bytes = Vec::new();
    // `read_to_end` returns an error if there is no memory.
    file.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(Error::read(path))?;
    refuse_if!(bytes.len() as u64 > most, path, "is too large: expected at most {most} bytes");
    Ok(bytes)
}

/// Reads the text of a regular file, or of standard input if `path` is `-` or leads there. Pipes, devices and
/// directories are refused without waiting.
///
/// # Errors
/// [`Error::Read`] if the file cannot be read; [`Error::Format`] if it is not a regular file, has more than `most`
/// bytes, is empty, or is not UTF-8.
pub fn read_text(path: &Path, most: u64) -> Result<String> {
    let text = String::from_utf8(read(path, most)?);
    let text = text.map_err(|e| Error::format(path, format!("is no text: {}", e.utf8_error())))?;
    if text.trim().is_empty() { Err(Error::format(path, "is empty")) } else { Ok(text) }
}

/// Reads a value from a file of JSON, which is read as by [`read_text`].
///
/// # Errors
/// The errors of [`read_text`]; [`Error::Format`] with line and column if the text is no such value.
pub fn read_json<T: DeserializeOwned>(path: &Path, most: u64) -> Result<T> {
    let fault =
        |e: serde_json::Error| Error::format(path, format!("line {} column {}: {}", e.line(), e.column(), fault(&e)));
    serde_json::from_str(&read_text(path, most)?).map_err(fault)
}

/// Returns the fault of a JSON text, without its place, in words of JSON.
pub fn fault(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let text = text.rsplit_once(" at line ").map_or(text.as_str(), |(message, _)| message);
    let words = [
        ("invalid type: ", ""),
        ("invalid value: ", ""),
        ("EOF while parsing", "the text ends within"),
        ("sequence", "a list"),
        ("map,", "an object,"),
        ("expected a map", "expected an object"),
        ("expected u32", "expected a whole number, 0 or over"),
        ("expected f64", "expected a number"),
    ];
    // Quoted texts of the file stay as they are; the words about their kind stand before or after them.
    let (head, rest) = text.split_once('"').unwrap_or((text, ""));
    let (quoted, tail) = rest.rsplit_once('"').unwrap_or(("", rest));
    let plain = |text: &str| words.iter().fold(text.to_owned(), |text, (from, to)| text.replace(from, to));
    match text.contains('"') {
        true => format!("{}\"{quoted}\"{}", plain(head), plain(tail)),
        false => plain(head),
    }
    .replace("expected a a list", "expected a list")
}

fn not_regular(path: &Path, meta: &Metadata) -> Error {
    let kind = if meta.is_dir() { "directory" } else { special(meta) };
    Error::format(path, format!("is a {kind}, expected a regular file"))
}

#[cfg(unix)]
fn special(meta: &Metadata) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    let kind = meta.file_type();
    match () {
        () if kind.is_fifo() => "pipe",
        () if kind.is_socket() => "socket",
        () => "device",
    }
}

#[cfg(not(unix))]
fn special(_: &Metadata) -> &'static str {
    "device"
}

/// Opens standard input.
fn stream() -> std::io::Result<File> {
    #[cfg(unix)]
    let owned = std::os::fd::AsFd::as_fd(&std::io::stdin()).try_clone_to_owned();
    #[cfg(windows)]
    let owned = std::os::windows::io::AsHandle::as_handle(&std::io::stdin()).try_clone_to_owned();
    #[cfg(not(any(unix, windows)))]
    let owned = Err::<File, _>(std::io::Error::from(std::io::ErrorKind::Unsupported));
    owned.map(File::from)
}

/// Opens standard input, if it is the file that `meta` describes.
#[cfg(unix)]
fn standard_input(meta: &Metadata) -> Option<File> {
    use std::os::unix::fs::MetadataExt;
    let stream = stream().ok()?;
    let its = stream.metadata().ok()?;
    (!meta.is_dir() && (its.dev(), its.ino()) == (meta.dev(), meta.ino())).then_some(stream)
}

#[cfg(not(unix))]
fn standard_input(_: &Metadata) -> Option<File> {
    None
}

/// Opens a file without waiting, even if it has become a pipe.
#[cfg(unix)]
fn open_at_once(path: &Path) -> std::io::Result<File> {
    use std::os::unix::fs::OpenOptionsExt;
    // Neither flag changes how a regular file is read.
    let flags = rustix::fs::OFlags::NONBLOCK | rustix::fs::OFlags::NOCTTY;
    std::fs::OpenOptions::new().read(true).custom_flags(flags.bits().cast_signed()).open(path)
}

#[cfg(not(unix))]
fn open_at_once(path: &Path) -> std::io::Result<File> {
    File::open(path)
}
