//! Progress of long work.

use std::fmt;
use std::sync::Arc;

/// A callback for the progress of long work; by default there is none.
///
/// It is called with the name of the work, such as "classifying", and the fraction done, 0 to 1, from one thread at a
/// time. Fractions of one work never fall.
#[derive(Clone, Default)]
pub struct Progress(Option<Arc<Callback>>);

type Callback = dyn Fn(&'static str, f64) + Send + Sync;

impl Progress {
    /// Reports progress to `callback`.
    pub fn new(callback: impl Fn(&'static str, f64) + Send + Sync + 'static) -> Self {
        Self(Some(Arc::new(callback)))
    }

    pub(crate) fn report(&self, doing: &'static str, fraction: f64) {
        if let Some(callback) = &self.0 {
            callback(doing, fraction);
        }
    }
}

impl fmt::Debug for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Progress").field(&self.0.is_some()).finish()
    }
}
