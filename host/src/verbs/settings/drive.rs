//! Whether a board's drive runs, and how it is brought to rest.

use std::time::{Duration, Instant};

use kband_control::State;
use kband_control::wire::{Request, Telemetry};

use crate::board::{Link, Unsolicited};
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;

/// Time between two questions how far it has come; the board takes them for a sign of life too.
const LISTEN_INTERVAL: Duration = Duration::from_millis(300);
/// Time in which a drive comes to rest after the command.
const REST_TIMEOUT: Duration = Duration::from_secs(120);

/// Refused where the drive does not run, for then no impact will be measured.
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

/// The last of the drive cycles that come in a while.
fn cycle(link: &mut Link) -> Result<Option<Telemetry>, Refusal> {
    link.begin_telemetry(1)?;
    let said = link.listen(LISTEN_INTERVAL)?;
    link.tell(&Request::Telemetry(0))?;
    Ok(said.into_iter().rev().find_map(|said| match said {
        Unsolicited::Telemetry(telemetry) => Some(telemetry),
        Unsolicited::Started(_) => None,
    }))
}

/// The telemetry of cycles from now on, as `take` keeps it, until there is enough or the time is
/// over. A progress bar counts up to `wanted`.
pub(super) fn gather(
    link: &mut Link,
    desk: &Desk,
    (name, wanted): (&str, usize),
    within: Duration,
    take: impl Fn(&mut Vec<Telemetry>, Telemetry),
    enough: impl Fn(&[Telemetry]) -> bool,
) -> Result<Vec<Telemetry>, Refusal> {
    let progress = Progress::new(name, wanted as u64);
    let begun = Instant::now();
    let mut cycles: Vec<Telemetry> = Vec::new();
    let mut most = 0;
    link.begin_telemetry(1)?;
    while begun.elapsed() < within && !enough(&cycles) {
        desk.go_on()?;
        for said in link.listen(LISTEN_INTERVAL)? {
            if let Unsolicited::Telemetry(telemetry) = said {
                take(&mut cycles, telemetry);
            }
        }
        progress.advance(cycles.len().saturating_sub(most) as u64);
        most = most.max(cycles.len());
        link.tell(&Request::Alive)?;
    }
    progress.finish();
    Ok(cycles)
}

/// Brings the drive to rest, as settings need it.
pub(super) fn rest(link: &mut Link) -> Result<(), Refusal> {
    link.tell(&Request::Enable(false))?;
    let begun = Instant::now();
    while begun.elapsed() < REST_TIMEOUT {
        if cycle(link)?.is_some_and(|cycle| cycle.state == State::Off.number()) {
            return Ok(());
        }
    }
    // A drive that does not stop gets no command to go on.
    Err(Refusal::new(
        format!(
            "{} did not come to rest within {} s; its enable stays withdrawn and nothing was changed",
            link.name(),
            REST_TIMEOUT.as_secs()
        ),
        "withdraw the enable input, see why the drive runs on, and reset the board",
    ))
}
