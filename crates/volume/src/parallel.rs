//! Loops on all cores, compiled once: a loop of rayon's is some 2,500 lines of LLVM for each type of sample, and such
//! loops were a sixth of the lines of this crate.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

/// Calls `work` with each number below `count`.
pub fn for_each(count: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(work);
}

/// Calls `work` with each chunk of `size` elements, the last of which may be shorter, and its number.
pub fn for_each_chunk<T: Send>(elements: &mut [T], size: usize, work: impl Fn(usize, &mut [T]) + Sync) {
    let chunks: Vec<Mutex<&mut [T]>> = elements.chunks_mut(size.max(1)).map(Mutex::new).collect();
    for_each(chunks.len(), &|number| work(number, &mut lock(&chunks[number])));
}

/// Returns the results of `make` for each number below `count`, in order.
///
/// # Errors
/// An error of `make`. It is not called again after the first error.
pub fn try_map<R: Send, E: Send>(count: usize, make: impl Fn(usize) -> Result<R, E> + Sync) -> Result<Vec<R>, E> {
    try_map_by(&for_each, count, make)
}

/// Returns the results of [`try_map`] by threads of its own, as work that waits for other machines needs.
///
/// # Errors
/// The error of [`try_map`].
pub fn try_map_in<R: Send, E: Send>(
    threads: usize,
    count: usize,
    make: impl Fn(usize) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let on_threads = |count: usize, work: &(dyn Fn(usize) + Sync)| {
        let next = AtomicUsize::new(0);
        let numbers = || std::iter::repeat_with(|| next.fetch_add(1, Relaxed)).take_while(|number| *number < count);
        std::thread::scope(|scope| {
            (0..threads.min(count)).for_each(|_| drop(scope.spawn(|| numbers().for_each(work))))
        });
    };
    try_map_by(&on_threads, count, make)
}

/// A loop that calls a function with each number below a count.
type Loop<'a> = &'a dyn Fn(usize, &(dyn Fn(usize) + Sync));

fn try_map_by<R: Send, E: Send>(
    for_each: Loop<'_>,
    count: usize,
    make: impl Fn(usize) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let results: Vec<Mutex<Option<Result<R, E>>>> = (0..count).map(|_| Mutex::new(None)).collect();
    let failed = AtomicBool::new(false);
    for_each(count, &|number| {
        if !failed.load(Relaxed) {
            let result = make(number);
            failed.fetch_or(result.is_err(), Relaxed);
            *lock(&results[number]) = Some(result);
        }
    });
    results.into_iter().filter_map(|result| result.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
}

/// Locks a slot that one thread uses: a panic elsewhere does not make its content wrong.
fn lock<T>(slot: &Mutex<T>) -> MutexGuard<'_, T> {
    slot.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_order_and_an_error_ends_the_work() {
        assert_eq!(try_map(1000, |n| Ok::<_, ()>(2 * n)).unwrap(), (0..1000).map(|n| 2 * n).collect::<Vec<_>>());
        assert_eq!(try_map(1000, |n| if n == 700 { Err(n) } else { Ok(n) }), Err(700));
        assert_eq!(try_map(0, Err::<(), _>), Ok(Vec::<()>::new()));
        assert_eq!(try_map_in(3, 100, |n| Ok::<_, ()>(2 * n)).unwrap(), (0..100).map(|n| 2 * n).collect::<Vec<_>>());
        assert_eq!(try_map_in(3, 100, |n| if n == 70 { Err(n) } else { Ok(n) }), Err(70));
        // Work that waits for other work needs as many threads.
        let together = std::sync::Barrier::new(16);
        assert_eq!(try_map_in(16, 32, |_| Ok::<_, ()>(together.wait().is_leader())).unwrap().len(), 32);
    }

    #[test]
    fn chunks_have_their_numbers() {
        let mut elements = vec![0; 10];
        for_each_chunk(&mut elements, 4, |number, chunk| chunk.fill(number));
        assert_eq!(elements, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2]);
    }
}
