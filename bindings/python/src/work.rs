//! Long work without the interpreter's lock, on threads, ended by Ctrl-C.

use std::num::NonZero;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use pyo3::prelude::*;

use crate::refused::Refused;

/// Time between two checks for Ctrl-C.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Flag that requests the end of the work. Work of many steps checks it between them.
pub struct Stop(AtomicBool);

impl Stop {
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Runs `work` for each of `0..count` on `threads` threads; results in order. Each result depends
/// on its number alone, so any number of threads gives the same bits.
///
/// # Errors
/// The refusal with the lowest number, as an exception for arrays of this shape; Ctrl-C.
pub fn map<T: Send + Sync>(
    py: Python<'_>,
    shape: &[usize],
    count: usize,
    threads: Option<NonZero<usize>>,
    work: impl Fn(usize, &Stop) -> Result<T, Refused> + Sync + Send,
) -> PyResult<Vec<T>> {
    let threads = threads.or_else(|| thread::available_parallelism().ok());
    let threads = threads.map_or(1, NonZero::get);
    let results: Vec<OnceLock<Result<T, Refused>>> = (0..count).map(|_| OnceLock::new()).collect();
    let (next, stop) = (AtomicUsize::new(0), Stop(AtomicBool::new(false)));
    let worker = || {
        while !stop.is_requested() {
            let n = next.fetch_add(1, Ordering::Relaxed);
            let Some(place) = results.get(n) else { break };
            let result = work(n, &stop);
            if result.is_err() {
                stop.0.store(true, Ordering::Relaxed);
            }
            let _ = place.set(result);
        }
    };
    let interrupted = py.detach(|| {
        thread::scope(|scope| {
            let (working, finished) = channel::<()>();
            for _ in 0..threads.min(count) {
                let working = working.clone();
                scope.spawn(move || {
                    worker();
                    drop(working);
                });
            }
            drop(working);
            let mut interrupted = Ok(());
            while finished.recv_timeout(POLL_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                if interrupted.is_ok() {
                    interrupted = Python::attach(|py| py.check_signals());
                    if interrupted.is_err() {
                        stop.0.store(true, Ordering::Relaxed);
                    }
                }
            }
            interrupted
        })
    });
    interrupted?;
    // The numbers are taken in order, so every one before the first refusal has its result.
    let results = results.into_iter().map_while(OnceLock::into_inner);
    let results: Result<Vec<T>, Refused> = results.collect();
    results.map_err(|cause| cause.exception(shape))
}

/// Checks for Ctrl-C between steps of work on the calling thread, without the interpreter's lock.
pub struct InterruptPoll(Instant);

impl InterruptPoll {
    pub fn new() -> Self {
        Self(Instant::now())
    }

    /// Call it between two steps; an error ends the work.
    pub fn poll(&mut self) -> PyResult<()> {
        if self.0.elapsed() < POLL_INTERVAL {
            return Ok(());
        }
        self.0 = Instant::now();
        Python::attach(|py| py.check_signals())
    }
}
