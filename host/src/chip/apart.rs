//! Work with a probe in a separate thread, because a probe may not answer, and its driver may
//! panic.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use crate::desk::Desk;
use crate::refusal::Refusal;

/// Longest wait for a probe; erasing a sector takes up to 4 s (RM0090, datasheet table 40).
const SILENCE_TIMEOUT: Duration = Duration::from_secs(20);
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(50);
const NAME: &str = "probe";

/// Starts the work; its messages arrive in the channel, which closes at its end.
pub fn start<T: Send + 'static>(
    work: impl FnOnce(Sender<T>) + Send + 'static,
) -> Result<Receiver<T>, Refusal> {
    let others = std::panic::take_hook();
    // The run reports a panic of the thread in its own message.
    std::panic::set_hook(Box::new(move |panic| {
        if std::thread::current().name() != Some(NAME) {
            others(panic);
        }
    }));
    let (sender, received) = channel();
    std::thread::Builder::new()
        .name(NAME.into())
        .spawn(move || work(sender))
        .map_err(|error| {
            let cause = format!("a thread could not be started: {error}");
            Refusal::new(cause, "close other programs and try again")
        })?;
    Ok(received)
}

/// The next message of the work. Refuses after a long silence, a panic, or an interruption by the
/// user.
pub fn next<T>(received: &Receiver<T>, desk: &Desk) -> Result<T, Refusal> {
    let start = Instant::now();
    loop {
        if desk.check_stop().is_err() {
            let cause = "interrupted while the probe was at work";
            return Err(Refusal::cut(cause, "start it again"));
        }
        match received.recv_timeout(STOP_POLL_INTERVAL) {
            Ok(received) => return Ok(received),
            // The work ended without a result.
            Err(RecvTimeoutError::Disconnected) => {
                let cause = "the connection to the probe was lost";
                return Err(Refusal::new(cause, "plug the probe in and try again"));
            }
            Err(RecvTimeoutError::Timeout) if start.elapsed() > SILENCE_TIMEOUT => {
                let waited = SILENCE_TIMEOUT.as_secs();
                let cause = format!("the probe has not answered for {waited} s");
                let next = "unplug the probe, plug it in and try again";
                return Err(Refusal::new(cause, next));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}
