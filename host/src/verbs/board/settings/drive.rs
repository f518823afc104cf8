//! State of a board's drive, and bringing it to rest.

use std::time::{Duration, Instant};

use kband_control::State;
use kband_control::wire::{Request, Telemetry};

use crate::board::{Link, Unsolicited};
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;

/// Time between two requests of telemetry; they also keep the link alive for the board.
const LISTEN_INTERVAL: Duration = Duration::from_millis(300);
/// Longest time from the command to rest.
const REST_TIMEOUT: Duration = Duration::from_secs(120);

/// The refusal for a drive that does not run, because no impact would be measured.
pub(super) fn why_off(link: &mut Link) -> Result<Option<Refusal>, Refusal> {
    let Some(last) = cycle(link)? else {
        return Ok(None);
    };
    let off = last.state == State::Off.number();
    let fault = last.state == State::Fault.number();
    Ok((off || fault).then(|| {
        Refusal::new(
            format!("{} does not run its drive{}", link.name(), if fault { ": it stopped in a fault" } else { "" }),
            "give the enable input (after a fault withdraw it first); kband monitor shows the fault",
        )
    }))
}

/// The last drive cycle within [`LISTEN_INTERVAL`].
fn cycle(link: &mut Link) -> Result<Option<Telemetry>, Refusal> {
    link.begin_telemetry(1)?;
    let received = link.listen(LISTEN_INTERVAL)?;
    link.command(&Request::Telemetry(0))?;
    let mut received = received.into_iter().rev();
    Ok(received.find_map(|received| match received {
        Unsolicited::Telemetry(telemetry) => Some(telemetry),
        Unsolicited::Started(_) => None,
    }))
}

/// Collects telemetry by `take` from now on, until `enough` or the time limit. A progress bar
/// counts up to `required`.
pub(super) fn gather(
    link: &mut Link,
    desk: &Desk,
    (name, required): (&str, usize),
    within: Duration,
    take: impl Fn(&mut Vec<Telemetry>, Telemetry),
    enough: impl Fn(&[Telemetry]) -> bool,
) -> Result<Vec<Telemetry>, Refusal> {
    let progress = Progress::new(name, required as u64);
    let start = Instant::now();
    let mut cycles: Vec<Telemetry> = Vec::new();
    let mut max_cycles = 0;
    link.begin_telemetry(1)?;
    while start.elapsed() < within && !enough(&cycles) {
        desk.check_stop()?;
        for received in link.listen(LISTEN_INTERVAL)? {
            if let Unsolicited::Telemetry(telemetry) = received {
                take(&mut cycles, telemetry);
            }
        }
        progress.advance(cycles.len().saturating_sub(max_cycles) as u64);
        max_cycles = max_cycles.max(cycles.len());
        link.command(&Request::Alive)?;
    }
    progress.finish();
    Ok(cycles)
}

/// Brings the drive to rest, as required for a change of settings.
pub(super) fn rest(link: &mut Link) -> Result<(), Refusal> {
    link.command(&Request::Enable(false))?;
    let start = Instant::now();
    while start.elapsed() < REST_TIMEOUT {
        if cycle(link)?.is_some_and(|cycle| cycle.state == State::Off.number()) {
            return Ok(());
        }
    }
    // A drive that does not stop receives no command to continue.
    Err(Refusal::new(
        format!(
            "{} did not come to rest within {} s; its enable stays withdrawn and nothing was changed",
            link.name(),
            REST_TIMEOUT.as_secs()
        ),
        "withdraw the enable input, see why the drive runs on, and reset the board",
    ))
}
