//! Progress on stderr, if stderr is a terminal and notes are printed.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::io::{IsTerminal, stderr};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{HumanBytes, HumanDuration, ProgressBar, ProgressStyle};

use super::output::is_quiet;

/// The template of a spinner.
const SPINNER: &str = "{spinner} {msg} {elapsed}";

/// The number of steps of the bar.
const STEPS: u64 = 1000;

/// A bar or spinner that disappears when it is dropped.
pub(crate) struct ProgressLine(ProgressBar);

impl ProgressLine {
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
        let spinner = Self::new(ProgressBar::new_spinner(), SPINNER, what);
        if what == "reading" {
            *READING.lock().unwrap_or_else(PoisonError::into_inner) = Some(spinner.0.clone());
        }
        spinner
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

/// The spinner of a volume that is read, which becomes a bar while the volume is fetched.
static READING: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Shows the bytes that were fetched of a volume, and the fraction that is done.
pub(crate) fn fetched(bytes: u64, fraction: f64) {
    let reading = READING.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(bar) = &*reading else { return };
    let is_done = fraction >= 1.0;
    let template = if is_done { SPINNER } else { "{spinner} {msg:16} {wide_bar} {percent:>3} % {elapsed}" };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.set_length(STEPS);
    bar.set_position((fraction.clamp(0.0, 1.0) * STEPS as f64) as u64);
    bar.set_message(if is_done { "reading".to_owned() } else { format!("fetching {}", HumanBytes(bytes)) });
}

impl Drop for ProgressLine {
    fn drop(&mut self) {
        READING.lock().unwrap_or_else(PoisonError::into_inner).take_if(|bar| bar.prefix() == self.0.prefix());
        self.0.finish_and_clear();
    }
}

/// Returns the callback for the progress of the library: one bar at a time, for the current work.
pub(crate) fn reporter() -> voxsplat::progress::Progress {
    let shown: Mutex<Option<(&'static str, ProgressLine)>> = Mutex::new(None);
    voxsplat::progress::Progress::new(move |doing, fraction| {
        let mut shown = shown.lock().unwrap_or_else(PoisonError::into_inner);
        if fraction >= 1.0 {
            *shown = None;
            return;
        }
        let current = shown.take().filter(|(what, _)| *what == doing);
        let (_, bar) = shown.insert(current.unwrap_or_else(|| (doing, ProgressLine::bar(doing))));
        bar.0.set_position((fraction.max(0.0) * STEPS as f64) as u64);
    })
}

/// The number of last steps whose mean time predicts the time of the remaining steps.
const RECENT: usize = 12;

/// A bar for steps of unlike times, with the current step.
pub(crate) struct Remaining {
    bar: ProgressLine,
    steps: usize,
    /// The times at which the last steps began, the oldest first, with the numbers of steps that were done then.
    begun: RefCell<VecDeque<(Instant, usize)>>,
}

impl Remaining {
    /// Shows a number of steps.
    pub(crate) fn new(what: &'static str, steps: usize) -> Self {
        let bar = ProgressBar::new(steps as u64);
        let template = "{spinner} {prefix} {wide_bar} {pos}/{len} {elapsed}{msg}";
        let bar = ProgressLine::new(bar, template, what);
        bar.0.set_message("");
        Self { bar, steps, begun: RefCell::default() }
    }

    /// Shows the number of finished steps, and the next one.
    pub(crate) fn at(&self, done: usize, next: &str) {
        let mut begun = self.begun.borrow_mut();
        begun.push_back((Instant::now(), done));
        let left = time_left(&begun, self.steps);
        if begun.len() > RECENT {
            begun.pop_front();
        }
        self.at_left(done, next, left);
    }

    /// Shows the number of finished steps, the next one, and the time that is left.
    pub(crate) fn at_left(&self, done: usize, next: &str, left: Option<Duration>) {
        let left = left.map_or_else(String::new, |left| format!(" (about {} left)", HumanDuration(left)));
        self.bar.0.set_position(done as u64);
        self.bar.0.set_message(format!("{left}\n  {next}"));
    }
}

/// Returns the time of the remaining steps if each takes the mean time of the last ones; `None` before one is done.
fn time_left(begun: &VecDeque<(Instant, usize)>, steps: usize) -> Option<Duration> {
    let (&(first, before), &(now, done)) = (begun.front()?, begun.back()?);
    let recent = done.checked_sub(before).filter(|&recent| recent > 0)?;
    Some(now.duration_since(first).mul_f64(steps.saturating_sub(done) as f64 / recent as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After quick steps come slow ones: the time left follows the last steps, not the mean of all.
    #[test]
    fn time_left_follows_the_last_steps() {
        let start = Instant::now();
        let at = |second: u64, done: usize| (start + Duration::from_secs(second), done);
        assert_eq!(time_left(&VecDeque::from([at(0, 0)]), 100), None);
        assert_eq!(time_left(&VecDeque::from([at(0, 0), at(1, 10)]), 100), Some(Duration::from_secs(9)));
        assert_eq!(time_left(&VecDeque::from([at(1, 10), at(31, 13)]), 100), Some(Duration::from_secs(870)));
        assert_eq!(time_left(&VecDeque::from([at(1, 10), at(31, 100)]), 100), Some(Duration::ZERO));
    }
}
