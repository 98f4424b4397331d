//! Progress on stderr, if that is a terminal.

use std::io::{IsTerminal, stderr};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// Steps of the bar.
const STEPS: u64 = 1000;

/// A bar or spinner that disappears when it is dropped.
pub(super) struct Progress(ProgressBar);

impl Progress {
    fn new(bar: ProgressBar, template: &str, what: &'static str) -> Self {
        if !stderr().is_terminal() {
            return Self(ProgressBar::hidden());
        }
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_message(what);
        Self(bar)
    }

    /// For work of unknown length.
    pub(super) fn spinner(what: &'static str) -> Self {
        let progress = Self::new(ProgressBar::new_spinner(), "{spinner} {msg} {elapsed}", what);
        progress.0.enable_steady_tick(Duration::from_millis(100));
        progress
    }

    /// For work that reports how much is done.
    pub(super) fn bar(what: &'static str) -> Self {
        Self::new(ProgressBar::new(STEPS), "{msg:10} {wide_bar} {percent:>3} % {elapsed}", what)
    }

    /// Shows that a fraction (0..1) of the work is done.
    pub(super) fn set(&self, fraction: f64) {
        self.0.set_position((fraction.clamp(0.0, 1.0) * STEPS as f64) as u64);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
