//! `kband monitor`: telemetry and event log of a board, recorded and replayed.

mod rows;

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use kband_control::wire::{Request, Response};

use crate::arguments;
use crate::board::{Address, Emulated, Link, Said, Unsolicited, replay};
use crate::desk::Desk;
use crate::file::{self, Destination};
use crate::refusal::{Exit, Refusal};
use crate::report::Format;
use rows::Rows;
pub(super) use rows::{Row, columns};

/// Time between two looks into the event log; the board takes them for a sign of life too.
const LOG_POLL_INTERVAL: Duration = Duration::from_millis(200);

/// Print telemetry and event log of a board as they arrive.
///
/// Ctrl-C, --duration or --rows end it. A record holds the bytes of the link: damage to it loses
/// only the damaged messages.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband monitor
  kband monitor --on /dev/ttyACM0 --every 1 --record shift.kband
  kband monitor --replay shift.kband --format csv
  kband monitor --on qemu --duration 5")]
pub struct Arguments {
    #[command(flatten)]
    address: Address,

    /// Drive cycles per row of telemetry; 0: the event log only.
    #[arg(long, value_name = "N", default_value = "10", value_parser = arguments::count(0, 65_535))]
    every: usize,

    /// Duration in s of the clock.
    #[arg(long, value_name = "S", value_parser = arguments::within(0.1, 1e7, "s"))]
    duration: Option<f64>,

    /// Number of rows of telemetry after which it ends.
    #[arg(long, value_name = "N", value_parser = arguments::count(1, 1_000_000_000))]
    rows: Option<usize>,

    /// Record to a new file, for --replay. An existing file is refused.
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    record: Option<PathBuf>,

    /// Print a record instead of a board's messages.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["on", "image", "flash_image", "every", "duration", "rows"])]
    replay: Option<PathBuf>,

    /// Form of the rows; json has an object per line.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

/// Prints until the user stops it.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let mut rows = Rows::new(arguments.format);
    match &arguments.replay {
        Some(path) => again(path, &mut rows, desk)?,
        None => now(arguments, &mut rows, desk)?,
    }
    Ok(Exit::Done)
}

fn again(path: &Path, rows: &mut Rows, desk: &Desk) -> Result<(), Refusal> {
    let next = "give the path of a file that kband monitor --record wrote";
    let record = BufReader::new(file::open(path, next)?);
    let remains = replay(record, |said| Ok(rows.take(said)? && desk.go_on().is_ok()))
        .map_err(|refusal| refusal.at(path.display()))?;
    rows.close();
    if remains.unreadable > 0 || remains.cut > 0 {
        eprintln!(
            "{} frames could not be read, {} bytes at the end are no whole frame",
            remains.unreadable, remains.cut
        );
    }
    Ok(())
}

/// Refuses a requested record that cannot be made or already exists.
fn check(record: Option<&Path>) -> Result<(), Refusal> {
    let Some(path) = record else { return Ok(()) };
    Destination::check(path)?;
    if path.exists() {
        return Err(Refusal::new(
            format!("{} is there already", path.display()),
            "give another name, or remove it: a record is never overwritten",
        ));
    }
    Ok(())
}

fn made(path: &Path) -> Result<File, Refusal> {
    let made = File::options().write(true).create_new(true).open(path);
    made.map_err(|error| Refusal::file(path, &error, "check space and permissions of the folder"))
}

fn now(arguments: &Arguments, rows: &mut Rows, desk: &Desk) -> Result<(), Refusal> {
    let path = arguments.record.as_deref();
    check(path)?;
    let mut link = arguments.address.open(Emulated::Running)?;
    if let Some(path) = path {
        link.record(made(path)?)?;
    }
    let frequency = link.ask(&Request::Get("frequency"), |response| match response {
        Response::Setting(setting) => Some(Said::Setting(setting.key.into(), setting.value)),
        _ => None,
    })?;
    if let Some(said) = frequency {
        rows.take(said)?;
    }
    link.tell(&Request::Telemetry(arguments.every as u16))?;
    let begun = Instant::now();
    let limit = arguments.duration.map(Duration::from_secs_f64);
    let mut going = true;
    while going && desk.go_on().is_ok() && limit.is_none_or(|limit| begun.elapsed() < limit) {
        let left = limit.map_or(LOG_POLL_INTERVAL, |limit| {
            limit.saturating_sub(begun.elapsed())
        });
        for said in link.listen(LOG_POLL_INTERVAL.min(left))? {
            if arguments
                .rows
                .is_some_and(|most| rows.cycles >= most as u64)
            {
                going = false;
                break;
            }
            going &= match said {
                Unsolicited::Telemetry(telemetry) => rows.take(Said::Telemetry(telemetry))?,
                Unsolicited::Started(image) => {
                    // A board that starts has its telemetry off.
                    link.tell(&Request::Telemetry(arguments.every as u16))?;
                    rows.take(Said::Started(image))?
                }
            };
        }
        going &=
            log(&mut link, rows)? && arguments.rows.is_none_or(|most| rows.cycles < most as u64);
    }
    link.tell(&Request::Telemetry(0))?;
    rows.close();
    if let Some(path) = path {
        eprintln!("recorded to {}", path.display());
    }
    if link.unreadable() > 0 {
        eprintln!("{} frames could not be read", link.unreadable());
    }
    Ok(())
}

/// Prints what is new in the event log, 64 records at most: what the board keeps.
fn log(link: &mut Link, rows: &mut Rows) -> Result<bool, Refusal> {
    for _ in 0..64 {
        let event = link.ask(&Request::Event(rows.next), |response| match response {
            Response::Event(event) => event,
            _ => None,
        })?;
        match event {
            Some(event) if !rows.take(Said::Event(event))? => return Ok(false),
            Some(_) => {}
            None => break,
        }
    }
    Ok(true)
}
