//! `kband monitor`: telemetry and event log of a board, recorded and replayed.

#[cfg_attr(not(feature = "log"), path = "monitor/no_watch.rs")]
mod watch;

use std::fs::File;
use std::io::{BufReader, Stdout, stdout};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use kband::control::{Event, Fault, Limits, State};
use kband::wire::{Record, Request, Response, Telemetry};

use crate::arguments;
use crate::board::{Address, Clock, Emulated, Line, Said, Unasked, replay};
use crate::desk::Desk;
use crate::file::Target;
use crate::refusal::{Exit, Refusal};
use crate::report::{Column, Format, Value, shortest};
use crate::stream::Stream;
use watch::Watch;

/// Time between two looks into the event log; the board takes them for a sign of life too.
const LOOK: Duration = Duration::from_millis(200);

/// Print what a board tells: telemetry and event log, as it comes.
///
/// Ends with Ctrl-C or after --duration or --rows. A record holds the bytes of the line as they came: cut or damaged anywhere, it loses
/// what was there and nothing else.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband monitor
  kband monitor --on /dev/ttyACM0 --every 1 --record shift.kband
  kband monitor --replay shift.kband --format csv
  kband monitor --on qemu --duration 5
  kband monitor --elf my-feeder --log shift.defmt")]
pub struct Arguments {
    #[command(flatten)]
    address: Address,

    /// One row of telemetry every N drive cycles; 0 for the event log alone.
    #[arg(long, value_name = "N", default_value = "10", value_parser = arguments::count(0, 65_535))]
    every: usize,

    /// End after this many seconds of the clock.
    #[arg(long, value_name = "S", value_parser = arguments::within(0.1, 1e7, "s"))]
    duration: Option<f64>,

    /// End after this many rows of telemetry.
    #[arg(long, value_name = "N", value_parser = arguments::count(1, 1_000_000_000))]
    rows: Option<usize>,

    /// Record to a file, to be replayed; a file that is there already is refused.
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    record: Option<PathBuf>,

    /// Print a record instead of a board.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["on", "image", "flash_image", "every", "duration", "rows"])]
    replay: Option<PathBuf>,

    /// Print the board's log as well: the image that runs there, which has the words. A board's log comes with --log.
    #[arg(long, value_name = "IMAGE")]
    elf: Option<PathBuf>,

    /// Print a recorded log instead of a board: its bytes as the board wrote them; needs --elf.
    #[arg(long, value_name = "FILE", requires = "elf", conflicts_with_all = ["on", "image", "flash_image", "every", "duration", "rows", "record", "replay"])]
    log: Option<PathBuf>,

    /// Form of the rows; json is an object a line.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

/// Prints until it is told to stop.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let mut rows = Rows::new(arguments.format);
    match (&arguments.replay, &arguments.log, &arguments.elf) {
        (Some(path), ..) => again(path, &mut rows, desk)?,
        (None, Some(log), Some(elf)) => recorded(elf, log, &mut rows)?,
        _ => now(arguments, &mut rows, desk)?,
    }
    Ok(Exit::Done)
}

/// Prints a record.
fn again(path: &Path, rows: &mut Rows, desk: &Desk) -> Result<(), Refusal> {
    let open = |error: std::io::Error| {
        Refusal::file(
            path,
            &error,
            "give the path of a file that kband monitor --record wrote",
        )
    };
    let record = BufReader::new(File::open(path).map_err(open)?);
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

fn unreadable(watch: &Watch) {
    if watch.unreadable() > 0 {
        eprintln!("{} frames of the log could not be read", watch.unreadable());
    }
}

/// Prints a board.
fn now(arguments: &Arguments, rows: &mut Rows, desk: &Desk) -> Result<(), Refusal> {
    let path = arguments.record.as_deref();
    if let Some(path) = path {
        Target::check(path)?;
        if path.exists() {
            return Err(Refusal::new(
                format!("{} is there already", path.display()),
                "give another name, or remove it: a record is never overwritten",
            ));
        }
    }
    let mut address = arguments.address.clone();
    let mut watch = match &arguments.elf {
        None => None,
        Some(elf) if address.is_emulated() => {
            let (watch, file) = Watch::emulated(elf)?;
            address.log = Some(file);
            Some(watch)
        }
        Some(_) => {
            return Err(Refusal::new(
                "a board writes its log into memory that only its probe reads",
                "record it through the probe and print the record: kband monitor --elf IMAGE --log FILE",
            ));
        }
    };
    let mut line = address.open(Emulated::Running)?;
    if let Some(path) = path {
        let made = File::options().write(true).create_new(true).open(path);
        let record = made.map_err(|error| {
            Refusal::file(path, &error, "check space and permissions of the folder")
        })?;
        line.record(record)?;
    }
    let frequency = line.ask(&Request::Get("frequency"), |response| match response {
        Response::Setting(setting) => Some(Said::Setting(setting.key.into(), setting.value)),
        _ => None,
    })?;
    if let Some(said) = frequency {
        rows.take(said)?;
    }
    line.tell(&Request::Telemetry(arguments.every as u16))?;
    let begun = Instant::now();
    let limit = arguments.duration.map(Duration::from_secs_f64);
    let mut going = true;
    while going && desk.go_on().is_ok() && limit.is_none_or(|limit| begun.elapsed() < limit) {
        let left = limit.map_or(LOOK, |limit| limit.saturating_sub(begun.elapsed()));
        for said in line.listen(LOOK.min(left))? {
            if arguments
                .rows
                .is_some_and(|most| rows.cycles >= most as u64)
            {
                going = false;
                break;
            }
            going &= match said {
                Unasked::Telemetry(telemetry) => rows.take(Said::Telemetry(telemetry))?,
                Unasked::Started(image) => {
                    // A board that starts has its telemetry off.
                    line.tell(&Request::Telemetry(arguments.every as u16))?;
                    rows.take(Said::Started(image))?
                }
            };
        }
        if let Some(watch) = &mut watch {
            going &= rows.log(watch)?;
        }
        going &=
            log(&mut line, rows)? && arguments.rows.is_none_or(|most| rows.cycles < most as u64);
    }
    line.tell(&Request::Telemetry(0))?;
    rows.close();
    if let Some(watch) = &watch {
        unreadable(watch);
    }
    if let Some(path) = path {
        eprintln!("recorded to {}", path.display());
    }
    if line.unreadable() > 0 {
        eprintln!("{} frames could not be read", line.unreadable());
    }
    Ok(())
}

/// Prints what is new in the event log, 64 records at most: what the board keeps.
fn log(line: &mut Line, rows: &mut Rows) -> Result<bool, Refusal> {
    for _ in 0..64 {
        let event = line.ask(&Request::Event(rows.next), |response| match response {
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

/// Telemetry and events as rows.
struct Rows {
    stream: Stream<Stdout>,
    /// Drive frequency in Hz, once it is known.
    frequency: Option<f64>,
    clock: Clock,
    /// Number of the next event.
    next: u32,
    cycles: u64,
    events: u64,
}

impl Rows {
    fn new(format: Format) -> Self {
        let columns = [
            (Column::new("time", "s"), 9),
            (Column::new("cycle", ""), 8),
            (Column::new("state", ""), 9),
            (Column::new("k", "").digits(4), 8),
            (Column::new("b", "mm").digits(4), 8),
            (Column::new("output", "%").digits(3), 10),
            (Column::new("impacts", "1/cycle").digits(3), 17),
            (Column::new("phase", "rad").digits(3), 11),
            (Column::new("confidence", "").digits(2), 10),
            (Column::new("event", ""), 0),
        ];
        Self {
            stream: Stream::new(format, &columns, stdout()),
            frequency: None,
            clock: Clock::default(),
            next: 0,
            cycles: 0,
            events: 0,
        }
    }

    /// Prints it; whether there is still somebody who reads.
    fn take(&mut self, said: Said) -> Result<bool, Refusal> {
        match said {
            Said::Setting(key, value) => {
                if key == "frequency" && value > 0.0 {
                    self.frequency = Some(f64::from(value));
                }
                Ok(true)
            }
            Said::Telemetry(telemetry) => {
                self.cycles += 1;
                let row = self.cycle(&telemetry);
                self.stream.row(&row)
            }
            Said::Event(event) => {
                // Asked for twice where an answer was late.
                if (event.number.wrapping_sub(self.next) as i32) < 0 {
                    return Ok(true);
                }
                self.next = event.number.wrapping_add(1);
                self.events += 1;
                self.event(event.cycle, happened(&event))
            }
            Said::Started(image) => {
                self.next = 0;
                self.clock = Clock::default();
                self.event(0, format!("the board started: kband {image}"))
            }
        }
    }

    /// Time and number of a cycle.
    fn when(&self, cycles: u64) -> Vec<Value> {
        let time = self.frequency.map(|frequency| cycles as f64 / frequency);
        vec![time.into(), cycles.into()]
    }

    /// Prints what is new in a log; whether there is still somebody who reads.
    fn log(&mut self, watch: &mut Watch) -> Result<bool, Refusal> {
        for words in watch.lines()? {
            let mut row = vec![Value::Missing; 9];
            row.push(words.into());
            if !self.stream.row(&row)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn event(&mut self, cycle: u32, words: String) -> Result<bool, Refusal> {
        let mut row = self.when(self.clock.then(cycle));
        row.resize(9, Value::Missing);
        row.push(words.into());
        self.stream.row(&row)
    }

    fn cycle(&mut self, telemetry: &Telemetry) -> Vec<Value> {
        let state = State::ALL
            .iter()
            .find(|state| state.number() == telemetry.state);
        let held = held(telemetry);
        let cycles = self.clock.now(telemetry.cycle);
        let mut row = self.when(cycles);
        row.extend([
            state.map_or("unknown", |state| state.name()).into(),
            // At rest k is beyond all bounds.
            Some(telemetry.k).filter(|k| *k < 1e4).map(shortest).into(),
            (shortest(telemetry.amplitude) * 1e3).into(),
            (shortest(telemetry.output) * 100.0).into(),
            shortest(telemetry.rate).into(),
            shortest(telemetry.phase).into(),
            shortest(telemetry.confidence).into(),
            if held.is_empty() {
                Value::Missing
            } else {
                held.into()
            },
        ]);
        row
    }

    /// Says how much it was.
    fn close(&self) {
        eprintln!("{} rows of telemetry, {} events", self.cycles, self.events);
    }
}

/// Fault and limits of a cycle in words.
fn held(telemetry: &Telemetry) -> String {
    let fault = Fault::ALL
        .iter()
        .find(|fault| fault.number() == telemetry.fault);
    let fault = fault.map(|fault| format!("fault {}: {}", fault.number(), fault.name()));
    let limits = Limits::ALL
        .iter()
        .filter(|limit| limit.bits() & telemetry.limits != 0);
    let limits = limits.map(|limit| format!("limit {}: {}", limit.number(), limit.name()));
    fault
        .into_iter()
        .chain(limits)
        .collect::<Vec<_>>()
        .join("; ")
}

fn happened(record: &Record) -> String {
    let event = Event::ALL
        .iter()
        .find(|event| event.number() == record.event);
    let name = event.map_or_else(
        || format!("event {}", record.event),
        |event| event.name().into(),
    );
    let fault = Fault::ALL
        .iter()
        .find(|fault| fault.number() == record.fault);
    match (event, fault) {
        (Some(Event::Faulted), Some(fault)) => {
            format!("{name}: {} (fault {})", fault.name(), fault.number())
        }
        _ => name,
    }
}
