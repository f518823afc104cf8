//! Work on all cores, with a progress bar and Ctrl-C.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::ending::ORBITS_PER_BLOCK;
use crate::refusal::{Refusal, Result};

static STOP_REQUESTED: AtomicBool = AtomicBool::new(false);
/// Number of waits of 50 ms for a silent board after a request to stop.
const MAX_WAITS_AFTER_STOP: u32 = 6;

/// Ends the waits for a silent board after a request to stop.
pub(crate) fn limit_waits() -> impl FnMut() -> Result<()> + Send {
    let mut waits = 0;
    move || {
        waits += u32::from(STOP_REQUESTED.load(Ordering::Relaxed));
        if waits > MAX_WAITS_AFTER_STOP {
            let cause = "interrupted while the board did not answer";
            Err(Refusal::cut(cause, "start it again"))
        } else {
            Ok(())
        }
    }
}

/// [`Desk::check_stop`] for work that outlives the desk.
pub(crate) fn check_stop() -> Result<()> {
    match STOP_REQUESTED.load(Ordering::Relaxed) {
        true => Err(Refusal::interrupted()),
        false => Ok(()),
    }
}

/// Environment of every verb: cores, progress bar, request to stop.
#[derive(Debug)]
pub struct Desk {
    stop: Arc<AtomicBool>,
    /// Number of threads; 0 for one for each core.
    threads: usize,
    /// Started by the first work on all cores.
    pool: OnceLock<ThreadPool>,
}

impl Desk {
    /// A desk with this many threads, or one for each core.
    pub fn new(threads: Option<usize>) -> Self {
        Self {
            stop: Arc::new(AtomicBool::new(false)),
            threads: threads.unwrap_or(0),
            pool: OnceLock::new(),
        }
    }

    fn pool(&self) -> Result<&ThreadPool> {
        if let Some(pool) = self.pool.get() {
            return Ok(pool);
        }
        let pool = ThreadPoolBuilder::new().num_threads(self.threads).build();
        let pool = pool.map_err(|error| {
            let cause = format!("the threads could not be started: {error}");
            Refusal::new(cause, "try --threads 1")
        })?;
        Ok(self.pool.get_or_init(|| pool))
    }

    /// From now on Ctrl-C (or SIGTERM) requests a stop of the work; a second one stops at once.
    pub fn listen_for_interruption(&self) {
        let stop = Arc::clone(&self.stop);
        // It fails only if a handler is already installed; that one remains.
        let _ = ctrlc::set_handler(move || {
            STOP_REQUESTED.store(true, Ordering::Relaxed);
            if stop.swap(true, Ordering::SeqCst) {
                crate::file::remove_unfinished();
                std::process::exit(130);
            }
        });
    }

    /// Returns a refusal after a request to stop. Work of many steps calls it between them.
    pub fn check_stop(&self) -> Result<()> {
        match self.stop.load(Ordering::Relaxed) {
            true => Err(Refusal::interrupted()),
            false => Ok(()),
        }
    }

    /// Calls `work` for each of `0..count` on all cores; results are in order, and the same for any
    /// number of threads if each depends only on its number.
    pub fn map<T: Send>(
        &self,
        title: &str,
        count: usize,
        work: impl Fn(usize) -> T + Sync + Send,
    ) -> Result<Vec<T>> {
        let progress = Progress::new(title, count as u64);
        let step = |n| {
            self.check_stop()?;
            let result = work(n);
            progress.advance(1);
            Ok(result)
        };
        let all = || (0..count).into_par_iter().map(step).collect();
        self.pool()?.install(all)
    }

    /// Like [`Desk::map`] for work that may refuse; the first refusal in order is returned.
    pub fn try_map<T: Send>(
        &self,
        title: &str,
        count: usize,
        work: impl Fn(usize) -> Result<T> + Sync + Send,
    ) -> Result<Vec<T>> {
        self.map(title, count, work)?.into_iter().collect()
    }

    /// Like [`Desk::try_map`] for groups of orbits, each of numbers spread over the range.
    pub fn spread<T: Send>(
        &self,
        title: &str,
        count: usize,
        work: impl Fn(&[usize]) -> Result<Vec<T>> + Sync + Send,
    ) -> Result<Vec<T>> {
        let blocks = count.div_ceil(ORBITS_PER_BLOCK);
        let tasks = blocks.max(self.pool()?.current_num_threads()).min(count);
        let of_task = |task: usize| (task..count).step_by(tasks).collect::<Vec<_>>();
        let results = self.try_map(title, tasks, |task| work(&of_task(task)))?;
        let mut results: Vec<_> = results.into_iter().map(Vec::into_iter).collect();
        let in_order = (0..count).filter_map(|n| results[n % tasks].next());
        Ok(in_order.collect())
    }
}

/// A progress bar on a terminal's standard error, from before the first step until it is dropped.
#[derive(Debug)]
pub(crate) struct Progress(ProgressBar);

impl Progress {
    pub fn new(title: &str, length: u64) -> Self {
        Self::on(title, length, ProgressDrawTarget::stderr_with_hz(10))
    }

    /// A bar beside rows on standard output; none if rows and bar share a terminal.
    pub fn beside_rows(title: &str, length: u64) -> Self {
        match std::io::stdout().is_terminal() {
            true => Self::on(title, length, ProgressDrawTarget::hidden()),
            false => Self::new(title, length),
        }
    }

    fn on(title: &str, length: u64, target: ProgressDrawTarget) -> Self {
        let bar = ProgressBar::with_draw_target(Some(length), target);
        bar.set_prefix(title.to_string());
        let form = "{prefix} [{wide_bar}] {percent:>3} % {elapsed:>3} so far, {eta:>3} left";
        if let Ok(style) = ProgressStyle::with_template(form) {
            bar.set_style(style.progress_chars("=> "));
        }
        if !bar.is_hidden() {
            bar.enable_steady_tick(Duration::from_millis(250));
        }
        Self(bar)
    }

    pub fn advance(&self, steps: u64) {
        self.0.inc(steps);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interruption_stops_the_work() {
        let desk = Desk::new(Some(2));
        let stop = Arc::clone(&desk.stop);
        let stopped = desk.map("", 1_000_000, |n| {
            if n == 10 {
                stop.store(true, Ordering::SeqCst);
            }
        });
        assert_eq!(stopped.unwrap_err().status(), 130);
    }
}
