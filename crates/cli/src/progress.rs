//! Progress on stderr, if stderr is a terminal and notes are wanted.

use std::io::{IsTerminal, stderr};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::output::is_quiet;

/// Steps of the bar.
const STEPS: u64 = 1000;

/// A bar or spinner that disappears when it is dropped.
pub(crate) struct Progress(ProgressBar);

impl Progress {
    fn new(bar: ProgressBar, template: &str, what: &'static str) -> Self {
        if is_quiet() || !stderr().is_terminal() {
            return Self(ProgressBar::hidden());
        }
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_prefix(what);
        bar.set_message(what);
        bar.enable_steady_tick(Duration::from_millis(100));
        Self(bar)
    }

    /// Shows work of unknown length.
    pub(crate) fn spinner(what: &'static str) -> Self {
        Self::new(ProgressBar::new_spinner(), "{spinner} {msg} {elapsed}", what)
    }

    /// Shows the progress of work that reports it.
    fn bar(what: &'static str) -> Self {
        Self::new(
            ProgressBar::new(STEPS),
            "{spinner} {msg:16} {wide_bar} {percent:>3} % {elapsed} (about {eta} left)",
            what,
        )
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Returns the callback for the progress of the library: one bar at a time, for the current work.
pub(crate) fn reporter() -> voxsplat::progress::Progress {
    let shown: Mutex<Option<(&'static str, Progress)>> = Mutex::new(None);
    voxsplat::progress::Progress::new(move |doing, fraction| {
        let mut shown = shown.lock().unwrap_or_else(PoisonError::into_inner);
        if fraction >= 1.0 {
            *shown = None;
            return;
        }
        let current = shown.take().filter(|(what, _)| *what == doing);
        let (_, bar) = shown.insert(current.unwrap_or_else(|| (doing, Progress::bar(doing))));
        bar.0.set_position((fraction.max(0.0) * STEPS as f64) as u64);
    })
}

/// A bar for steps of unlike times, with the current step.
pub(crate) struct Remaining(Progress);

impl Remaining {
    /// Shows a number of steps.
    pub(crate) fn new(what: &'static str, steps: usize) -> Self {
        let bar = ProgressBar::new(steps as u64);
        Self(Progress::new(
            bar,
            "{spinner} {prefix} {wide_bar} {pos}/{len} {elapsed} (about {eta} left)\n  {msg}",
            what,
        ))
    }

    /// Shows the number of finished steps, and the next one.
    pub(crate) fn at(&self, done: usize, next: &str) {
        self.0.0.set_position(done as u64);
        self.0.0.set_message(next.to_owned());
    }
}
