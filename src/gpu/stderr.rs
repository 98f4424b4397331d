//! Keeps a message of drivers off the standard error.

/// Runs `work`, such as opening a device, without the driver's message about XDG_RUNTIME_DIR on the standard error.
///
/// Mesa's layer that selects devices asks libwayland for a display. On a machine without a desktop session libwayland
/// then prints "error: XDG_RUNTIME_DIR is invalid or not set in the environment.", and no setting prevents it. Other
/// text on the standard error arrives, whoever writes it meanwhile; a line written just afterwards may overtake it. A
/// process that is started meanwhile keeps a pipe to this process as its standard error. One thread at a time does
/// this; others wait.
#[cfg(unix)]
pub fn silenced<T>(work: impl FnOnce() -> T) -> T {
    use std::path::Path;
    use std::sync::{Mutex, PoisonError};

    // Each redirection restores the stream that it found.
    static REDIRECTED: Mutex<()> = Mutex::new(());
    if std::env::var_os("XDG_RUNTIME_DIR").is_some_and(|folder| Path::new(&folder).is_absolute()) {
        return work();
    }
    let _one = REDIRECTED.lock().unwrap_or_else(PoisonError::into_inner);
    // Without a redirection the message is printed, which is no reason to fail.
    let _restored_at_the_end = redirection::Redirection::begin();
    work()
}

/// Runs `work` unchanged: on other systems drivers print nothing.
#[cfg(not(unix))]
pub fn silenced<T>(work: impl FnOnce() -> T) -> T {
    work()
}

#[cfg(unix)]
mod redirection {
    use std::fs::File;
    use std::io::{self, BufReader, PipeWriter, Write};
    use std::mem;
    use std::os::fd::{AsFd, OwnedFd};
    use std::sync::mpsc::{Receiver, Sender, channel};
    use std::thread;

    use rustix::stdio::dup2_stderr;

    /// The message of libwayland.
    const MESSAGE: &[u8] = b"error: XDG_RUNTIME_DIR is invalid or not set in the environment.\n";
    /// The bytes behind the last text of a redirection.
    const END: &[u8] = b"\0end of voxsplat's redirection\0";

    /// The standard error as a pipe, whose text a thread writes to the original stream without [`MESSAGE`].
    pub(super) struct Redirection {
        original: OwnedFd,
        pipe: PipeWriter,
        ended: Receiver<()>,
    }

    impl Redirection {
        pub(super) fn begin() -> io::Result<Self> {
            let original = io::stderr().as_fd().try_clone_to_owned()?;
            let (text, pipe) = io::pipe()?;
            // As large as a pipe, so that no line is read in parts.
            let mut text = BufReader::with_capacity(1 << 16, text);
            let (end, ended) = channel();
            let mut filter = Filter { to: File::from(original.try_clone()?), held: Vec::new(), end };
            let forward = move || {
                // Returns when every copy of the pipe is closed: a process that was started meanwhile may hold one.
                let _ended = io::copy(&mut text, &mut filter);
            };
            thread::Builder::new().name("voxsplat-stderr".to_owned()).spawn(forward)?;
            dup2_stderr(&pipe)?;
            Ok(Self { original, pipe, ended })
        }
    }

    impl Drop for Redirection {
        fn drop(&mut self) {
            // If this fails, the thread goes on forwarding.
            let _restored = dup2_stderr(&self.original);
            if self.pipe.write_all(END).is_ok() {
                // An error means that the thread has ended.
                let _ended = self.ended.recv();
            }
        }
    }

    /// A writer that passes bytes to another stream without [`MESSAGE`], and reports that [`END`] has come.
    struct Filter<W> {
        to: W,
        /// The beginning of a word that is not complete.
        held: Vec<u8>,
        end: Sender<()>,
    }

    impl<W: Write> Write for Filter<W> {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.held.extend_from_slice(bytes);
            let is_end = remove(&mut self.held, END);
            remove(&mut self.held, MESSAGE);
            let begun = if is_end { 0 } else { begun(&self.held) };
            let rest = self.held.split_off(self.held.len() - begun);
            // A closed stream must not stop the thread, or writers to the pipe would fail.
            let _written = self.to.write_all(&mem::replace(&mut self.held, rest));
            if is_end {
                // Nobody waits if the redirection could not begin.
                let _received = self.end.send(());
            }
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            self.to.flush()
        }
    }

    /// Removes all occurrences of a word, and returns whether there was one.
    fn remove(text: &mut Vec<u8>, word: &[u8]) -> bool {
        let before = text.len();
        while let Some(at) = text.windows(word.len()).position(|window| window == word) {
            text.drain(at..at + word.len());
        }
        text.len() < before
    }

    /// Returns the length of the longest end of a text that begins a word.
    fn begun(text: &[u8]) -> usize {
        let begins = |&length: &usize| {
            let end = &text[text.len() - length..];
            MESSAGE.starts_with(end) || END.starts_with(end)
        };
        (1..=text.len().min(MESSAGE.len())).rev().find(begins).unwrap_or_default()
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn only_the_message_is_left_out_however_it_is_cut() {
            let text = [b"error: one\nerr", MESSAGE, b"or: two", MESSAGE, MESSAGE, b"\0end of error: X", END].concat();
            for first in 0..text.len() {
                for second in first..text.len() {
                    let (end, ended) = channel();
                    let mut filter = Filter { to: Vec::new(), held: Vec::new(), end };
                    for part in [&text[..first], &text[first..second], &text[second..]] {
                        filter.write_all(part).unwrap();
                    }
                    assert_eq!(filter.to, b"error: one\nerror: two\0end of error: X", "{first} {second}");
                    assert_eq!(ended.try_iter().count(), 1);
                }
            }
        }

        #[test]
        fn text_that_begins_no_message_is_not_held_back() {
            let mut filter = Filter { to: Vec::new(), held: Vec::new(), end: channel().0 };
            for (part, arrived) in
                [("a bar: 10 %", "a bar: 10 %"), (" err", "a bar: 10 % "), ("atum", "a bar: 10 % erratum")]
            {
                filter.write_all(part.as_bytes()).unwrap();
                assert_eq!(filter.to, arrived.as_bytes());
            }
        }
    }
}
