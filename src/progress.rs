//! Progress of long work, and its end on request.

use std::fmt;
use std::sync::Arc;

use crate::error::{Error, Result};

/// A callback for the progress of long work; by default there is none.
///
/// It is called with the name of the work, such as "classifying", and the fraction done, 0 to 1, from one thread at a
/// time. Fractions of one work never fall.
#[derive(Clone, Default)]
pub struct Progress {
    callback: Option<Arc<Callback>>,
    cancelled: Option<Arc<dyn Fn() -> bool + Send + Sync>>,
}

type Callback = dyn Fn(&'static str, f64) + Send + Sync;

impl Progress {
    /// Reports progress to `callback`.
    pub fn new(callback: impl Fn(&'static str, f64) + Send + Sync + 'static) -> Self {
        Self { callback: Some(Arc::new(callback)), cancelled: None }
    }

    /// Makes work end early with [`Error::Cancelled`] once `cancelled` returns true. The work calls it where it reports
    /// its progress; a stage that runs on the device, and shadows, end first.
    #[must_use]
    pub fn cancelled_by(self, cancelled: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self { cancelled: Some(Arc::new(cancelled)), ..self }
    }

    /// Refuses to go on if the work is cancelled.
    pub(crate) fn check(&self) -> Result<()> {
        match &self.cancelled {
            Some(cancelled) if cancelled() => Err(Error::Cancelled),
            _ => Ok(()),
        }
    }

    pub(crate) fn report(&self, doing: &'static str, fraction: f64) {
        if let Some(callback) = &self.callback {
            callback(doing, fraction);
        }
    }
}

impl fmt::Debug for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Progress").field(&self.callback.is_some()).finish()
    }
}
