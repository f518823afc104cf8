//! `kband monitor`: telemetry and event log of a board, recorded and replayed.

mod rows;

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use kband_control::wire::Request;

use crate::arguments;
use crate::board::{Address, BoardMessage, Emulated, Link, NEXT, Unsolicited, replay};
use crate::desk::Desk;
use crate::file;
use crate::refusal::{Exit, Refusal};
use crate::report::Format;
use rows::Rows;
pub(super) use rows::{Row, columns};

/// Time between two requests of the event log; they also keep the link alive for the board.
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

    /// Duration in s of real time.
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

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let mut rows = Rows::new(arguments.format);
    match &arguments.replay {
        Some(path) => replay_record(path, &mut rows, desk)?,
        None => print_live(arguments, &mut rows, desk)?,
    }
    Ok(Exit::Done)
}

fn replay_record(path: &Path, rows: &mut Rows, desk: &Desk) -> Result<(), Refusal> {
    let record = BufReader::new(file::open(path, NEXT)?);
    let damage = replay(record, |message| {
        Ok(rows.take(message)? && desk.check_stop().is_ok())
    })
    .map_err(|refusal| refusal.at(path.display()))?;
    rows.close();
    if damage.unreadable > 0 || damage.cut > 0 {
        eprintln!(
            "{} frames could not be read, {} bytes at the end are no whole frame",
            damage.unreadable, damage.cut
        );
    }
    Ok(())
}

fn record_file(path: &Path) -> Result<File, Refusal> {
    let record_file = File::options().write(true).create_new(true).open(path);
    let next = "give another name in a folder of yours: a record is never overwritten";
    record_file.map_err(|error| Refusal::file(path, &error, next))
}

fn print_live(arguments: &Arguments, rows: &mut Rows, desk: &Desk) -> Result<(), Refusal> {
    let path = arguments.record.as_deref();
    let mut link = arguments.address.open(Emulated::Running)?;
    if let Some(path) = path {
        link.record(record_file(path)?)?;
    }
    let frequency = link.request(&Request::Get("frequency"), BoardMessage::from_response)?;
    if let Some(message) = frequency {
        rows.take(message)?;
    }
    link.command(&Request::Telemetry(arguments.every as u16))?;
    let start = Instant::now();
    let limit = arguments.duration.map(Duration::from_secs_f64);
    let mut going = true;
    while going && desk.check_stop().is_ok() && limit.is_none_or(|limit| start.elapsed() < limit) {
        let left = limit.map_or(LOG_POLL_INTERVAL, |limit| {
            limit.saturating_sub(start.elapsed())
        });
        for message in link.listen(LOG_POLL_INTERVAL.min(left))? {
            if arguments.rows.is_some_and(|max| rows.cycles >= max as u64) {
                going = false;
                break;
            }
            if let Unsolicited::Started(_) = message {
                // A board starts with its telemetry off.
                link.command(&Request::Telemetry(arguments.every as u16))?;
            }
            going &= rows.take(message.into())?;
        }
        going &= log(&mut link, rows)? && arguments.rows.is_none_or(|max| rows.cycles < max as u64);
    }
    link.command(&Request::Telemetry(0))?;
    rows.close();
    if let Some(path) = path {
        eprintln!("recorded to {}", path.display());
    }
    if link.unreadable() > 0 {
        eprintln!("{} frames could not be read", link.unreadable());
    }
    Ok(())
}

/// Prints new records of the event log, at most 64, which is the size of the board's log.
fn log(link: &mut Link, rows: &mut Rows) -> Result<bool, Refusal> {
    for _ in 0..64 {
        let event = link.request(&Request::Event(rows.next), BoardMessage::from_response)?;
        let Some(event) = event else { break };
        if !rows.take(event)? {
            return Ok(false);
        }
    }
    Ok(true)
}
