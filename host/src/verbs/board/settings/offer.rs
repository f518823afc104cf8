//! Measurements on a board with a running drive, and the settings that they propose.

use std::time::{Duration, Instant};

use kband_control::State;
use kband_control::wire::{Request, Telemetry};

use super::save_if_requested;
use crate::board::{Address, BoardMessage, BoardSettings, Emulated, Link};
use crate::desk::{Desk, Progress};
use crate::refusal::{Refusal, Result};
use crate::report::{Field, Format, View, columns};

/// Address of the board and time limit of a measurement, and whether to set the proposed settings.
pub(super) struct Commissioning<'a> {
    pub address: &'a Address,
    pub apply: bool,
    pub within: Duration,
    pub format: Format,
    pub desk: &'a Desk,
}

impl Commissioning<'_> {
    pub fn open(&self) -> Result<(Link, BoardSettings)> {
        let mut link = self.address.open(Emulated::Running)?;
        let settings = BoardSettings::read(&mut link)?;
        Ok((link, settings))
    }

    /// Prints the result with notes, and sets and saves the proposed settings or prints commands.
    pub fn conclude<R>(
        &self,
        (mut link, mut settings): (Link, BoardSettings),
        offered: &[(&str, f32)],
        mut notes: Vec<String>,
        view: View<'_, R>,
        value: R,
    ) -> Result<()> {
        if self.apply {
            rest(&mut link)?;
            let offered = offered.iter().map(|(key, value)| (key.to_string(), *value));
            let offered: Vec<_> = offered.collect();
            let result = settings
                .change(&mut link, &offered)
                .and_then(|()| save_if_requested(&mut link, true, self.address));
            link.command(&Request::Enable(true))?;
            notes.push(result?);
        } else {
            let options = self.address.options();
            notes.push("nothing was changed; to set it, with the drive at rest:".into());
            notes.extend(offered.iter().enumerate().map(|(n, (key, value))| {
                let last = n + 1 == offered.len();
                let save = if last { " --save" } else { "" };
                format!("  kband settings set {key} {value}{save}{options}")
            }));
        }
        let applied = Field::json(columns::APPLIED, |_| self.apply);
        let view = view.and(View::from_fields(vec![applied]));
        let value = [value];
        let report = view.printout(&value).notes(notes);
        report.json(view.object(&value[0])).print(self.format)
    }
}

/// Time between two requests of telemetry; they also keep the link alive for the board.
const LISTEN_INTERVAL: Duration = Duration::from_millis(300);
const REST_TIMEOUT: Duration = Duration::from_secs(120);

/// The refusal for a drive that does not run, because no impact would be measured.
pub(super) fn why_off(link: &mut Link) -> Result<Option<Refusal>> {
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
fn cycle(link: &mut Link) -> Result<Option<Telemetry>> {
    link.begin_telemetry(1)?;
    let received = link.listen(LISTEN_INTERVAL)?;
    link.command(&Request::Telemetry(0))?;
    let mut received = received.into_iter().rev();
    Ok(received.find_map(|received| match received {
        BoardMessage::Telemetry(telemetry) => Some(telemetry),
        _ => None,
    }))
}

/// Collects telemetry by `take` until `enough` or the time limit; the bar counts to `required`.
pub(super) fn gather(
    link: &mut Link,
    desk: &Desk,
    (name, required): (&str, usize),
    within: Duration,
    take: impl Fn(&mut Vec<Telemetry>, Telemetry),
    enough: impl Fn(&[Telemetry]) -> bool,
) -> Result<Vec<Telemetry>> {
    let progress = Progress::new(name, required as u64);
    let start = Instant::now();
    let mut cycles: Vec<Telemetry> = Vec::new();
    let mut max_cycles = 0;
    link.begin_telemetry(1)?;
    while start.elapsed() < within && !enough(&cycles) {
        desk.check_stop()?;
        for received in link.listen(LISTEN_INTERVAL)? {
            if let BoardMessage::Telemetry(telemetry) = received {
                take(&mut cycles, telemetry);
            }
        }
        progress.advance(cycles.len().saturating_sub(max_cycles) as u64);
        max_cycles = max_cycles.max(cycles.len());
        link.command(&Request::Alive)?;
    }
    Ok(cycles)
}

pub(super) fn rest(link: &mut Link) -> Result<()> {
    link.command(&Request::Enable(false))?;
    let start = Instant::now();
    while start.elapsed() < REST_TIMEOUT {
        if cycle(link)?.is_some_and(|cycle| cycle.state == State::Off.number()) {
            return Ok(());
        }
    }
    // A drive that does not stop receives no command to continue.
    let (name, seconds) = (link.name(), REST_TIMEOUT.as_secs());
    let cause = format!(
        "{name} did not come to rest within {seconds} s; its enable stays withdrawn and nothing was changed"
    );
    let next = "withdraw the enable input, see why the drive runs on, and reset the board";
    Err(Refusal::new(cause, next))
}
