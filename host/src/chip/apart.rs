//! Work with a probe in a thread of its own: a probe may never answer, and what drives it may panic.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use crate::desk::Desk;
use crate::refusal::Refusal;

/// Longest silence of a probe; the longest erasing of a sector takes 4 s (RM0090, datasheet table 40).
const SILENCE_TIMEOUT: Duration = Duration::from_secs(20);
/// Between two looks whether the user asked to stop.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Name of such a thread.
const NAME: &str = "probe";

/// Starts the work; what it says comes by the channel, which closes with it.
pub fn start<T: Send + 'static>(
    work: impl FnOnce(Sender<T>) + Send + 'static,
) -> Result<Receiver<T>, Refusal> {
    let others = std::panic::take_hook();
    // A panic there is told by the one message of the run.
    std::panic::set_hook(Box::new(move |panic| {
        if std::thread::current().name() != Some(NAME) {
            others(panic);
        }
    }));
    let (sender, said) = channel();
    std::thread::Builder::new()
        .name(NAME.into())
        .spawn(move || work(sender))
        .map_err(|error| {
            Refusal::new(
                format!("a thread could not be started: {error}"),
                "close other programs and try again",
            )
        })?;
    Ok(said)
}

/// The next thing that the work says; refused if it says nothing for long, has broken off, or the user asked to
/// stop.
pub fn next<T>(said: &Receiver<T>, desk: &Desk) -> Result<T, Refusal> {
    let begun = Instant::now();
    loop {
        if desk.go_on().is_err() {
            return Err(Refusal::cut(
                "interrupted while the probe was at work",
                "start it again",
            ));
        }
        match said.recv_timeout(STOP_POLL_INTERVAL) {
            Ok(said) => return Ok(said),
            Err(RecvTimeoutError::Disconnected) => return Err(broken_off()),
            Err(RecvTimeoutError::Timeout) if begun.elapsed() > SILENCE_TIMEOUT => {
                return Err(Refusal::new(
                    format!(
                        "the probe has not answered for {} s",
                        SILENCE_TIMEOUT.as_secs()
                    ),
                    "unplug the probe, plug it in and try again",
                ));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}

/// The work ended without a last word.
pub fn broken_off() -> Refusal {
    Refusal::new(
        "the way to the probe broke off",
        "plug the probe in and try again",
    )
}
