//! Work with a probe in a separate thread: a probe may never answer, and its driver may panic.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use crate::desk::Desk;
use crate::refusal::Refusal;

/// Longest silence of a probe; erasing a sector takes up to 4 s (RM0090, datasheet table 40).
const SILENCE_TIMEOUT: Duration = Duration::from_secs(20);
/// Time between two tests for a stop by the user.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(50);
const NAME: &str = "probe";

/// Starts the work; its messages arrive by the channel, which closes with it.
pub fn start<T: Send + 'static>(
    work: impl FnOnce(Sender<T>) + Send + 'static,
) -> Result<Receiver<T>, Refusal> {
    let others = std::panic::take_hook();
    // The run reports a panic of the thread in its one message.
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

/// The next message of the work. Refused after a long silence, an abort, or a stop by the user.
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

/// The refusal for work that ended without a result.
pub fn broken_off() -> Refusal {
    Refusal::new(
        "the connection to the probe was lost",
        "plug the probe in and try again",
    )
}
