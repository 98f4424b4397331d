//! Host times of the stages of a picture.

use std::time::Instant;

use voxsplat::stats::{Clock, StageTime};

/// The host times of the stages, in the order in which they ran.
#[derive(Default)]
pub(crate) struct Stages(pub(crate) Vec<StageTime>);

impl Stages {
    pub(crate) fn time<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.0.push(StageTime { name, seconds: start.elapsed().as_secs_f64(), clock: Clock::Host });
        result
    }

    /// Appends the stages of a later part of the work.
    pub(crate) fn append(&mut self, mut later: Self) {
        self.0.append(&mut later.0);
    }
}
