//! Work on threads of their own, so that Python keeps its lock for others and hears Ctrl-C.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use voxsplat::RendererOptions;
use voxsplat::engine::Engine;
use voxsplat::error::Error;
use voxsplat::progress::Progress;
use voxsplat::settings::{Painter, Settings};

use crate::error::{DeviceError, internal, raised};

/// The time between two looks for signals.
const TICK: Duration = Duration::from_millis(50);

/// The longest wait for abandoned work when the interpreter ends.
const LAST_WAIT: Duration = Duration::from_secs(1);

/// The process that has used threads or devices; 0: none yet.
static PROCESS: AtomicU32 = AtomicU32::new(0);

/// The number of threads that work.
static WORKING: (Mutex<usize>, Condvar) = (Mutex::new(0), Condvar::new());

/// Refuses to work in a process that was forked from one that has worked: its threads and its device do not exist
/// there, and a wait for them would not end.
pub(crate) fn check_process() -> PyResult<()> {
    let process = std::process::id();
    match PROCESS.compare_exchange(0, process, Ordering::Relaxed, Ordering::Relaxed) {
        Err(first) if first != process => Err(DeviceError::new_err(format!(
            "process {process} was forked from process {first} after voxsplat had worked there, so it has no device: \
             start processes with multiprocessing.get_context(\"spawn\")"
        ))),
        _ => Ok(()),
    }
}

/// Waits until no thread works, at most for some seconds. Called when the interpreter ends.
#[pyfunction]
pub(crate) fn wait_for_abandoned(py: Python<'_>) {
    if PROCESS.load(Ordering::Relaxed) != std::process::id() {
        return;
    }
    py.detach(|| {
        let working = locked(&WORKING.0);
        drop(WORKING.1.wait_timeout_while(working, LAST_WAIT, |working| *working > 0));
    });
}

/// A count of a working thread, for the life of the value.
struct Working;

impl Working {
    fn begin() -> Self {
        *locked(&WORKING.0) += 1;
        Self
    }
}

impl Drop for Working {
    fn drop(&mut self) {
        *locked(&WORKING.0) -= 1;
        WORKING.1.notify_all();
    }
}

/// The work that a device does.
struct Current {
    /// Whether nobody waits for the work any more.
    abandoned: Arc<AtomicBool>,
    report: Box<dyn FnMut(&'static str, f64) + Send>,
}

/// A device that is opened for the first work, and does one piece of work at a time.
pub(crate) struct Device {
    adapter: Option<String>,
    engines: Mutex<Open>,
    current: Arc<Mutex<Option<Current>>>,
    closed: AtomicBool,
}

/// The engines that are open.
#[derive(Default)]
struct Open {
    device: Option<Engine>,
    host: Option<Engine>,
    /// Whether the processor makes pictures whose painter is left open.
    prefers_host: Option<bool>,
}

impl Open {
    fn slot(&mut self, is_host: bool) -> &mut Option<Engine> {
        if is_host { &mut self.host } else { &mut self.device }
    }
}

/// The engines that make pictures.
pub(crate) struct Engines<'a> {
    open: &'a mut Open,
    options: RendererOptions,
}

impl Engines<'_> {
    /// Returns the callback for the progress of the work.
    pub(crate) fn progress(&self) -> &Progress {
        &self.options.progress
    }

    /// Returns the engine for pictures with these settings. Opens it if it is not open.
    pub(crate) fn suited(&mut self, settings: &Settings) -> Result<&Engine, Error> {
        let is_host = match settings.painter {
            Painter::Cpu => Some(true),
            Painter::Auto => self.open.prefers_host,
            _ => Some(false),
        };
        let kept = is_host.and_then(|is_host| self.open.slot(is_host).take());
        let engine = kept.map_or_else(|| Engine::open(&self.options, settings), Ok)?;
        let is_host = matches!(engine, Engine::Host(_));
        if settings.painter == Painter::Auto {
            self.open.prefers_host = Some(is_host);
        }
        Ok(self.open.slot(is_host).insert(engine))
    }
}

/// A message from a thread that works.
enum Event<T> {
    Progress(&'static str, f64),
    Done(Result<T, WorkFailure>),
}

enum WorkFailure {
    Library(Error),
    Panic(String),
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Device {
    /// Makes a device that is not open yet.
    pub(crate) fn new(adapter: Option<String>) -> Arc<Self> {
        Arc::new(Self { adapter, engines: Mutex::default(), current: Arc::default(), closed: AtomicBool::new(false) })
    }

    /// Closes the device. Later work is refused. Work that runs keeps the device until it is done.
    pub(crate) fn close(&self) {
        self.closed.store(true, Ordering::Relaxed);
        if let Ok(mut engines) = self.engines.try_lock() {
            discard(std::mem::take(&mut *engines));
        }
    }

    /// Does work with the device on another thread, without the interpreter's lock. Calls `progress` with the name of
    /// the stage and the fraction done. An exception of `progress`, Ctrl-C or another signal ends the wait at once, and
    /// the work at its next report.
    pub(crate) fn run<T: Send + 'static>(
        self: &Arc<Self>,
        py: Python<'_>,
        progress: Option<&Bound<'_, PyAny>>,
        work: impl FnOnce(&mut Engines<'_>) -> Result<T, Error> + Send + 'static,
    ) -> PyResult<T> {
        check_process()?;
        if self.closed.load(Ordering::Relaxed) {
            return Err(PyValueError::new_err("the renderer is closed"));
        }
        let (events, received) = channel();
        // Only a mutex may be shared with the section without the lock of the interpreter.
        let received = Mutex::new(received);
        let abandoned = Arc::new(AtomicBool::new(false));
        let (device, given_up, working) = (Arc::clone(self), Arc::clone(&abandoned), Working::begin());
        let thread = move || {
            let _working = working;
            let result = catch_unwind(AssertUnwindSafe(|| device.work(&events, given_up, work)));
            let result = result.unwrap_or_else(|panic| {
                // The device may be in the middle of something.
                drop(std::mem::take(&mut *locked(&device.engines)));
                Err(WorkFailure::Panic(text_of(panic.as_ref())))
            });
            drop(locked(&device.current).take());
            // Nobody may wait any more.
            drop(events.send(Event::Done(result)));
        };
        let started = std::thread::Builder::new().name("voxsplat".to_owned()).spawn(thread);
        started.map_err(|fault| internal(&format!("no thread could be started: {fault}")))?;
        let wait = || loop {
            let event = py.detach(|| locked(&received).recv_timeout(TICK));
            py.check_signals()?;
            match event {
                Ok(Event::Progress(stage, done)) => {
                    progress.map(|progress| progress.call1((stage, done))).transpose()?;
                }
                Ok(Event::Done(Ok(value))) => return Ok(value),
                Ok(Event::Done(Err(WorkFailure::Library(error)))) => return Err(raised(&error)),
                Ok(Event::Done(Err(WorkFailure::Panic(message)))) => return Err(internal(&message)),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(internal("a thread ended without a result")),
            }
        };
        let result = wait();
        abandoned.store(result.is_err(), Ordering::Relaxed);
        result
    }

    /// Works with the engines.
    fn work<T: Send + 'static>(
        &self,
        events: &Sender<Event<T>>,
        abandoned: Arc<AtomicBool>,
        work: impl FnOnce(&mut Engines<'_>) -> Result<T, Error>,
    ) -> Result<T, WorkFailure> {
        // Earlier work ends first.
        let mut open = locked(&self.engines);
        if abandoned.load(Ordering::Relaxed) {
            return Err(WorkFailure::Library(Error::Cancelled));
        }
        let (events, mut last) = (events.clone(), None::<(&str, Instant)>);
        let report = move |stage: &'static str, done: f64| {
            let is_due = last.is_none_or(|(name, at)| name != stage || done >= 1.0 || at.elapsed() >= TICK);
            if is_due {
                last = Some((stage, Instant::now()));
                drop(events.send(Event::Progress(stage, done)));
            }
        };
        *locked(&self.current) = Some(Current { abandoned, report: Box::new(report) });
        let default = RendererOptions::default();
        let options = RendererOptions { adapter: self.adapter.clone(), progress: self.progress(), ..default };
        work(&mut Engines { open: &mut open, options }).map_err(WorkFailure::Library)
    }

    /// Returns the callback for the progress of the work that runs.
    fn progress(&self) -> Progress {
        let [reports, ends] = [Arc::clone(&self.current), Arc::clone(&self.current)];
        let report = move |stage, done| {
            if let Some(current) = &mut *locked(&reports) {
                (current.report)(stage, done);
            }
        };
        let is_abandoned = |current: &Current| current.abandoned.load(Ordering::Relaxed);
        Progress::new(report).cancelled_by(move || locked(&ends).as_ref().is_some_and(is_abandoned))
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        discard(std::mem::take(&mut *locked(&self.engines)));
    }
}

/// Drops a value on a device. A forked process leaves it alone: to free it would wait for threads that do not exist.
pub(crate) fn discard<T>(held: T) {
    match PROCESS.load(Ordering::Relaxed) == std::process::id() {
        true => drop(held),
        false => std::mem::forget(held),
    }
}

/// Returns the message of a panic.
fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic".to_owned())
}
