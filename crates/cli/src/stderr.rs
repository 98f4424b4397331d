//! Keeps messages of drivers off the user's terminal.

/// Runs `work` with the standard error of the process redirected to /dev/null.
///
/// Mesa 22.3 prints "error: XDG_RUNTIME_DIR is invalid or not set in the environment." whenever a device is opened on a
/// machine without a desktop session, and has no setting to prevent it. Real failures are returned by the calls, and
/// this program reports them.
#[cfg(unix)]
pub(crate) fn silenced<T>(work: impl FnOnce() -> T) -> T {
    use rustix::stdio;
    if std::env::var_os("XDG_RUNTIME_DIR").is_some() {
        return work();
    }
    let kept = rustix::io::dup(stdio::stderr());
    let null = std::fs::OpenOptions::new().write(true).open("/dev/null");
    let (Ok(kept), Ok(null)) = (kept, null) else { return work() };
    if stdio::dup2_stderr(null).is_err() {
        return work();
    }
    let result = work();
    // A failure here is ignored: without standard error it cannot be reported.
    let _restored = stdio::dup2_stderr(kept);
    result
}

/// On other systems drivers print nothing.
#[cfg(not(unix))]
pub(crate) fn silenced<T>(work: impl FnOnce() -> T) -> T {
    work()
}
