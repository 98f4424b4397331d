//! Standard output and standard error.

use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};

use voxsplat::formats::without_credentials;

use super::failure::{Failure, fail};

/// Whether only results and errors are printed.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Whether the result is one JSON object.
static JSON: AtomicBool = AtomicBool::new(false);

/// Prints the result as one JSON object from here on.
pub(crate) fn be_json() {
    JSON.store(true, Ordering::Relaxed);
}

/// Returns whether the result is one JSON object.
pub(crate) fn is_json() -> bool {
    JSON.load(Ordering::Relaxed)
}

/// Prints results and errors alone from here on.
pub(crate) fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Returns whether only results and errors are printed.
pub(crate) fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Writes a result to stdout, without the credentials of urls. A closed pipe, as from `| head`, is not a failure.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    print_bytes(without_credentials(text).as_bytes())
}

/// Writes bytes to stdout.
pub(crate) fn print_bytes(bytes: &[u8]) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => fail(format!("cannot write to stdout: {e}")),
        _ => Ok(()),
    }
}

/// Writes a value to stdout as JSON.
pub(crate) fn print_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Failure::failed(format!("cannot write JSON: {e}")))?;
    print(&(text + "\n"))
}

/// The largest number of characters of a message: two paths of the longest names, and some words.
const MAX_MESSAGE: usize = 10_000;

/// Writes a note of one line to stderr, unless `--quiet` is given.
pub(crate) fn say(message: &str) {
    if !is_quiet() {
        complain(message);
    }
}

/// Writes one line to stderr, without the credentials of urls. A failure to do so is ignored: it cannot be reported.
pub(crate) fn complain(message: &str) {
    let message = without_credentials(message);
    let words: Vec<&str> = message.split_whitespace().collect();
    let mut line = words.join(" ");
    // It may quote an argument of any length. The end states the expected value.
    let half = MAX_MESSAGE / 2;
    if let (Some((head, _)), Some((tail, _))) = (line.char_indices().nth(half), line.char_indices().rev().nth(half - 1))
        && head < tail
    {
        line.replace_range(head..tail, " ... ");
    }
    drop(writeln!(io::stderr().lock(), "voxsplat: {line}"));
}
