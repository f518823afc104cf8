//! Work on all cores, with progress and Ctrl-C.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use rayon::prelude::*;

use crate::refusal::Refusal;

/// Whether the user has requested a stop.
static STOP_REQUESTED: AtomicBool = AtomicBool::new(false);
/// Number of calls without an answer, each after 50 ms, that a link waits after such a request: the
/// last requests of a verb have this time.
const LAST_WAITS: u32 = 6;

/// What ends the waits of a link, where a board does not answer, after a request to stop.
pub fn end_of_waits() -> impl FnMut() -> Result<(), Refusal> + Send {
    let mut waits = 0;
    move || {
        waits += u32::from(STOP_REQUESTED.load(Ordering::Relaxed));
        if waits > LAST_WAITS {
            let cause = "interrupted while the board did not answer";
            Err(Refusal::cut(cause, "start it again"))
        } else {
            Ok(())
        }
    }
}

/// Environment of every verb: the cores, the progress bar, the user's request to stop.
#[derive(Debug)]
pub struct Desk {
    stop: Arc<AtomicBool>,
    pool: rayon::ThreadPool,
}

impl Desk {
    /// A desk with this many threads, or one for each core.
    pub fn new(threads: Option<usize>) -> Result<Self, Refusal> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.unwrap_or(0))
            .build()
            .map_err(|error| {
                Refusal::new(
                    format!("the threads could not be started: {error}"),
                    "try --threads 1",
                )
            })?;
        Ok(Self {
            stop: Arc::new(AtomicBool::new(false)),
            pool,
        })
    }

    /// From now on Ctrl-C (or SIGTERM) requests a stop of the work; a second one stops at once.
    pub fn listen_for_interruption(&self) {
        let stop = Arc::clone(&self.stop);
        // It fails only if a handler is installed already, which then stays.
        let _ = ctrlc::set_handler(move || {
            STOP_REQUESTED.store(true, Ordering::Relaxed);
            if stop.swap(true, Ordering::SeqCst) {
                crate::file::remove_unfinished();
                std::process::exit(130);
            }
        });
    }

    /// Refuses after a request to stop; work of many steps calls it between them.
    pub fn go_on(&self) -> Result<(), Refusal> {
        if self.stop.load(Ordering::Relaxed) {
            Err(Refusal::interrupted())
        } else {
            Ok(())
        }
    }

    /// Calls `work` for each of `0..count` on all cores; results are in order. Each result must
    /// depend on its number alone: then any number of threads gives the same bits.
    pub fn map<T: Send>(
        &self,
        title: &str,
        count: usize,
        work: impl Fn(usize) -> T + Sync + Send,
    ) -> Result<Vec<T>, Refusal> {
        let progress = Progress::new(title, count as u64);
        let results = self.pool.install(|| {
            (0..count)
                .into_par_iter()
                .map(|n| {
                    self.go_on()?;
                    let result = work(n);
                    progress.advance(1);
                    Ok(result)
                })
                .collect()
        });
        progress.finish();
        results
    }

    /// Like [`Desk::map`] for work that can itself refuse; the first refusal in order is returned.
    pub fn try_map<T: Send>(
        &self,
        title: &str,
        count: usize,
        work: impl Fn(usize) -> Result<T, Refusal> + Sync + Send,
    ) -> Result<Vec<T>, Refusal> {
        self.map(title, count, work)?.into_iter().collect()
    }

    /// Like [`Desk::try_map`] for work that does several of `0..count` at once, spread over the
    /// whole range. They are at most `together`, and fewer if there are threads for them.
    pub fn spread<T: Send>(
        &self,
        title: &str,
        count: usize,
        together: usize,
        work: impl Fn(&[usize]) -> Result<Vec<T>, Refusal> + Sync + Send,
    ) -> Result<Vec<T>, Refusal> {
        let tasks = count
            .div_ceil(together.max(1))
            .max(self.threads())
            .min(count);
        let of_task = |task: usize| (task..count).step_by(tasks).collect::<Vec<_>>();
        let results = self.try_map(title, tasks, |task| work(&of_task(task)))?;
        let mut results: Vec<_> = results.into_iter().map(Vec::into_iter).collect();
        let in_order = (0..count).filter_map(|n| results[n % tasks].next());
        Ok(in_order.collect())
    }

    /// Number of threads that work.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }
}

/// Time after which the progress bar appears; shorter work needs none.
const SHOWN_AFTER: Duration = Duration::from_millis(400);

/// A progress bar on a terminal's standard error. It appears within the first second, also before
/// the first step is done.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    /// The thread that shows the bar, and the channel that ends it early.
    waiting: Mutex<Option<(Sender<()>, JoinHandle<()>)>>,
}

impl Progress {
    /// A bar of `length` steps.
    pub fn new(title: &str, length: u64) -> Self {
        Self::on(title, length, std::io::stderr().is_terminal())
    }

    /// A bar beside rows on standard output; none if both are on a terminal.
    pub fn beside_rows(title: &str, length: u64) -> Self {
        let shown = std::io::stderr().is_terminal() && !std::io::stdout().is_terminal();
        Self::on(title, length, shown)
    }

    fn on(title: &str, length: u64, shown: bool) -> Self {
        let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::hidden());
        let waiting = shown.then(|| {
            let (over, told) = channel();
            let (bar, title) = (bar.clone(), title.to_string());
            let shows = std::thread::spawn(move || {
                if told.recv_timeout(SHOWN_AFTER) == Err(RecvTimeoutError::Timeout) {
                    show(&bar, title);
                }
            });
            (over, shows)
        });
        Self {
            bar,
            waiting: Mutex::new(waiting),
        }
    }

    /// Counts finished steps.
    pub fn advance(&self, steps: u64) {
        self.bar.inc(steps);
    }

    /// Removes the bar.
    pub fn finish(&self) {
        let waiting = self
            .waiting
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        if let Some((over, shows)) = waiting {
            drop(over);
            // It cannot panic; after a panic there would be no bar.
            let _ = shows.join();
        }
        self.bar.finish_and_clear();
    }
}

impl Drop for Progress {
    /// Removes the bar after a refusal, too.
    fn drop(&mut self) {
        self.finish();
    }
}

fn show(bar: &ProgressBar, title: String) {
    let form = "{prefix} [{wide_bar}] {percent:>3} % {elapsed:>3} so far, {eta:>3} left";
    if let Ok(style) = ProgressStyle::with_template(form) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_prefix(title);
    bar.set_draw_target(ProgressDrawTarget::stderr_with_hz(10));
    bar.tick();
    bar.enable_steady_tick(Duration::from_millis(250));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interruption_stops_the_work() {
        let desk = Desk::new(Some(2)).unwrap();
        let stop = Arc::clone(&desk.stop);
        let refused = desk
            .map("", 1_000_000, |n| {
                if n == 10 {
                    stop.store(true, Ordering::SeqCst);
                }
            })
            .unwrap_err();
        assert_eq!(refused.status(), 130);
    }
}
