//! Keeps drivers from talking on the user's terminal.

/// Runs `work` with the process's standard error closed to drivers.
///
/// Mesa 22.3 prints "error: XDG_RUNTIME_DIR is invalid or not set in the environment." whenever a device is opened on a
/// machine without a desktop session, which is where this program mostly runs, and nothing in its environment stops it.
/// What really goes wrong is returned by the calls, and reported by this program.
#[cfg(unix)]
pub(super) fn silenced<T>(work: impl FnOnce() -> T) -> T {
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
    // Should this fail the program goes on, silently; there is nowhere left to say so.
    let _restored = stdio::dup2_stderr(kept);
    result
}

/// Elsewhere drivers keep quiet by themselves.
#[cfg(not(unix))]
pub(super) fn silenced<T>(work: impl FnOnce() -> T) -> T {
    work()
}
