//! Signals: a program that is interrupted leaves no temporary file behind.

/// Removes unfinished outputs if a signal ends the process. The process then ends as the signal ends it by default, so
/// a shell sees 128 and the number of the signal.
///
/// Signals that were ignored when the program was started, as by `nohup`, stay ignored. A file that grows past the
/// limit of its size (`ulimit -f`) fails the write, which is reported as any other failure.
#[cfg(unix)]
pub(crate) fn watch() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::iterator::Signals;
    let ignored = ignored();
    let watched = [SIGHUP, SIGINT, SIGTERM, SIGXFSZ].into_iter().filter(move |signal| match ignored {
        Some(mask) => mask >> (signal - 1) & 1 == 0,
        // To handle SIGHUP could undo `nohup`.
        None => *signal != SIGHUP,
    });
    let (watching, started) = std::sync::mpsc::channel::<()>();
    let watch = move || {
        let Ok(mut signals) = Signals::new(watched) else { return };
        drop(watching);
        for signal in signals.forever().filter(|signal| *signal != SIGXFSZ) {
            voxsplat::image::abandon_unfinished();
            // It does not return for these signals.
            drop(signal_hook::low_level::emulate_default_handler(signal));
        }
    };
    // Without a thread, signals end the process at once, as they do by default.
    drop(std::thread::Builder::new().name("signals".to_owned()).spawn(watch));
    // Its end of the channel closes when it watches, or cannot.
    let _closed = started.recv();
}

/// Returns the signals that this process ignores, bit n - 1 for signal n; `None` if the system does not tell.
#[cfg(unix)]
fn ignored() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
    u64::from_str_radix(mask.trim(), 16).ok()
}

/// Removes unfinished outputs if the console ends the process.
#[cfg(windows)]
pub(crate) fn watch() {
    // STATUS_CONTROL_C_EXIT, as without a handler.
    const ENDED: i32 = 0xC000_013A_u32.cast_signed();
    // Without a handler, the console ends the process at once, as it does by default.
    drop(ctrlc::set_handler(|| {
        voxsplat::image::abandon_unfinished();
        std::process::exit(ENDED);
    }));
}
