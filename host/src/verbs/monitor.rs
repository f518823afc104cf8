//! `kband monitor`: telemetry and event log of a board, recorded and replayed.

mod rows;
#[cfg_attr(not(feature = "log"), path = "monitor/no_watch.rs")]
mod watch;

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
use watch::Watch;

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
  kband monitor --on qemu --duration 5
  kband monitor --elf my-feeder --probe
  kband monitor --on /dev/ttyACM0 --elf my-feeder --probe 0483:3748
  kband monitor --elf my-feeder --log shift.defmt")]
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

    /// Also print the board's log, decoded with this image, which must be the one that runs there.
    /// A board's log comes through --probe.
    #[arg(long, value_name = "IMAGE")]
    elf: Option<PathBuf>,

    /// Read the log through a debug probe; name the probe if several are connected. The board runs
    /// on. Without --on only the log is printed.
    #[arg(long, value_name = "VID:PID[:SERIAL]", num_args = 0..=1, requires = "elf", conflicts_with_all = ["replay", "log"])]
    probe: Option<Option<String>>,

    /// Also record the log's bytes to a new file, for --log. An existing file is refused.
    #[arg(long, value_name = "FILE", requires = "elf", conflicts_with_all = ["replay", "log"])]
    record_log: Option<PathBuf>,

    /// Print a recorded log instead of a board's; needs --elf.
    #[arg(long, value_name = "FILE", requires = "elf", conflicts_with_all = ["on", "image", "flash_image", "every", "duration", "rows", "record", "replay"])]
    log: Option<PathBuf>,

    /// Form of the rows; json has an object per line.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

/// Prints until the user stops it.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let mut rows = Rows::new(arguments.format);
    match (&arguments.replay, &arguments.log, &arguments.elf) {
        (Some(path), ..) => again(path, &mut rows, desk)?,
        (None, Some(log), Some(elf)) => recorded(elf, log, &mut rows)?,
        (None, None, Some(elf)) if arguments.probe.is_some() && arguments.address.on.is_none() => {
            through_the_probe(arguments, elf, &mut rows, desk)?;
        }
        _ => now(arguments, &mut rows, desk)?,
    }
    Ok(Exit::Done)
}

/// Prints a record.
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

/// Prints a recorded log.
fn recorded(elf: &Path, log: &Path, rows: &mut Rows) -> Result<(), Refusal> {
    let mut watch = Watch::recorded(elf, log)?;
    rows.log(&mut watch)?;
    rows.close();
    unreadable(&watch);
    Ok(())
}

/// Prints the log that a probe reads, without a link to the board.
fn through_the_probe(
    arguments: &Arguments,
    elf: &Path,
    rows: &mut Rows,
    desk: &Desk,
) -> Result<(), Refusal> {
    for (option, given) in [
        ("--record", arguments.record.is_some()),
        ("--rows", arguments.rows.is_some()),
        ("--image", arguments.address.image.is_some()),
        ("--flash-image", arguments.address.flash_image.is_some()),
    ] {
        if given {
            return Err(Refusal::new(
                format!("{option} needs telemetry, which a probe does not read"),
                "name the board's serial port as well: --on /dev/PORT",
            ));
        }
    }
    let wanted = arguments.probe.iter().flatten().next();
    check(arguments.record_log.as_deref())?;
    let mut watch = Watch::probed(elf, wanted.map(String::as_str), desk)?;
    record_log(&mut watch, arguments)?;
    let begun = Instant::now();
    let limit = arguments.duration.map(Duration::from_secs_f64);
    let mut going = true;
    while going && desk.go_on().is_ok() {
        going = rows.log(&mut watch)? && limit.is_none_or(|limit| begun.elapsed() < limit);
        if going {
            std::thread::sleep(LOG_POLL_INTERVAL);
        }
    }
    rows.close();
    unreadable(&watch);
    if let Some(path) = &arguments.record_log {
        eprintln!("recorded to {}", path.display());
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

fn record_log(watch: &mut Watch, arguments: &Arguments) -> Result<(), Refusal> {
    if let Some(path) = &arguments.record_log {
        watch.record(made(path)?);
    }
    Ok(())
}

fn unreadable(watch: &Watch) {
    if watch.unreadable() > 0 {
        eprintln!("{} frames of the log could not be read", watch.unreadable());
    }
}

/// Prints a board.
fn now(arguments: &Arguments, rows: &mut Rows, desk: &Desk) -> Result<(), Refusal> {
    let path = arguments.record.as_deref();
    check(path)?;
    check(arguments.record_log.as_deref())?;
    let mut address = arguments.address.clone();
    let mut watch = match &arguments.elf {
        None => None,
        Some(_) if address.is_emulated() && arguments.probe.is_some() => {
            return Err(Refusal::new(
                "the emulated board has no probe",
                "leave --probe out: its log comes without",
            ));
        }
        Some(elf) if address.is_emulated() => {
            let (watch, file) = Watch::emulated(elf)?;
            address.log = Some(file);
            Some(watch)
        }
        Some(elf) => match &arguments.probe {
            Some(wanted) => Some(Watch::probed(elf, wanted.as_deref(), desk)?),
            None => {
                return Err(Refusal::new(
                    "a board writes its log into memory that only a debug probe reads",
                    "add --probe, or print a record of it: kband monitor --elf IMAGE --log FILE",
                ));
            }
        },
    };
    let mut link = address.open(Emulated::Running)?;
    if let Some(path) = path {
        link.record(made(path)?)?;
    }
    if let Some(watch) = &mut watch {
        record_log(watch, arguments)?;
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
        if let Some(watch) = &mut watch {
            going &= rows.log(watch)?;
        }
        going &=
            log(&mut link, rows)? && arguments.rows.is_none_or(|most| rows.cycles < most as u64);
    }
    link.tell(&Request::Telemetry(0))?;
    rows.close();
    if let Some(watch) = &watch {
        unreadable(watch);
    }
    for path in path.iter().chain(&arguments.record_log.as_deref()) {
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
