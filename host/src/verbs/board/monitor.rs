//! `kband monitor`: telemetry and event log of a board, recorded and replayed.

use std::fs::File;
use std::io::{BufReader, Stdout, stdout};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use kband_control::wire::{Record, Request, Telemetry};
use kband_control::{Event, Fault, GearMargin, Limits, State, UpperTone};

use crate::board::{Address, BoardMessage, Emulated, Link, NEXT, replay};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{Column, Format, Value, fields, finite, number, shortest, when};
use crate::stream::Stream;
use crate::{arguments, file};

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

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let mut rows = Rows::new(arguments.format);
    match &arguments.replay {
        Some(path) => replay_record(path, &mut rows, desk)?,
        None => print_live(arguments, &mut rows, desk)?,
    }
    Ok(Exit::Done)
}

fn replay_record(path: &Path, rows: &mut Rows, desk: &Desk) -> Result<()> {
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

fn record_file(path: &Path) -> Result<File> {
    let record_file = File::options().write(true).create_new(true).open(path);
    let next = "give another name in a folder of yours: a record is never overwritten";
    record_file.map_err(|error| Refusal::file(path, &error, next))
}

fn print_live(arguments: &Arguments, rows: &mut Rows, desk: &Desk) -> Result<()> {
    let path = arguments.record.as_deref();
    let mut link = arguments.address.open(Emulated::Running)?;
    if let Some(path) = path {
        link.record(record_file(path)?)?;
    }
    if let Some(message) = link.request(&Request::Get("frequency"), BoardMessage::from_response)? {
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
            if let BoardMessage::Started(_) = message {
                // A board starts with its telemetry off.
                link.command(&Request::Telemetry(arguments.every as u16))?;
            }
            going &= rows.take(message)?;
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
fn log(link: &mut Link, rows: &mut Rows) -> Result<bool> {
    for _ in 0..64 {
        let event = link.request(&Request::Event(rows.next), BoardMessage::from_response)?;
        let Some(event) = event else { break };
        if !rows.take(event)? {
            return Ok(false);
        }
    }
    Ok(true)
}

const WIDTHS: [usize; 1 + EVENT_COLUMN] = [
    9, 8, 9, 8, 8, 5, 8, 5, 8, 10, 17, 11, 10, 7, 13, 8, 9, 7, 6, 6, 6, 6, 7, 8, 10, 0,
];

/// A drive cycle: its time if the frequency is known, its number, and its telemetry.
type Cycle = (Option<f64>, u32, Telemetry);

fields! {
    /// A row of telemetry; rows of events have only time, number and event.
    fn cycles(row: Cycle) {
        all TIME => row.0;
        all CYCLE => row.1;
        all STATE => State::numbered(row.2.state).map_or("unknown", State::name);
        // At rest k has no bound.
        all K.digits(4) => Some(row.2.k).filter(|k| *k < 1e4).map(shortest);
        all B.digits(4) => shortest(row.2.amplitude) * 1e3;
        all E.titled("e").digits(3) => tone(&row.2, 0).map(|tone| shortest(tone.ratio));
        all TH.digits(3) => tone(&row.2, 0).map(|tone| shortest(tone.phase));
        all E3.titled("e3").digits(3) => tone(&row.2, 1).map(|tone| shortest(tone.ratio));
        all TH3.digits(3) => tone(&row.2, 1).map(|tone| shortest(tone.phase));
        all OUTPUT.titled("output").digits(3) => shortest(row.2.output);
        all IMPACTS_DETECTED.titled("impacts (1/cycle)").digits(3) => shortest(row.2.rate);
        all PHASE_MEASURED.titled("phase (rad)").digits(3) => shortest(row.2.phase);
        all CONFIDENCE.digits(2) => shortest(row.2.confidence);
        all IN_GEAR.digits(2) => shortest(row.2.in_gear);
        all IN_GEAR_ERROR.digits(1) => finite(row.2.in_gear_error).map(shortest);
        all IN_GEAR_EXPECTED.titled("expected").digits(2) =>
            Some(row.2.expected_in_gear).filter(|share| *share > 0.0).map(shortest);
        all GEAR_BAND_LOW.titled("band from").digits(4) => row.2.target_band.map(|band| shortest(band[0]));
        all GEAR_BAND_HIGH.titled("to").digits(4) => row.2.target_band.map(|band| shortest(band[1]));
        all FLIP_ESTIMATED.titled("margin").digits(2) => margin(&row.2, |margin| margin.flip);
        all TRACE_ESTIMATED.titled("trace").digits(2) => margin(&row.2, |margin| margin.trace);
        all RESTITUTION_ESTIMATED.titled("R").digits(3) => margin(&row.2, |margin| margin.restitution);
        all SCATTER_ESTIMATED.titled("s").digits(2) => margin(&row.2, |margin| margin.scatter);
        all TO_LOSS_ESTIMATED.titled("to_loss (cycles)").digits(3) => margin(&row.2, |margin| margin.to_loss);
        all MASS_WEIGHED.titled("mass (g)").digits(4) => row.2.load.map(|load| shortest(load.mass));
        all FLOW_WEIGHED.titled("flow (g/s)").digits(4) =>
            row.2.load.filter(|load| load.flow != 0.0).map(|load| shortest(load.flow));
        all EVENT => limits_text(&row.2);
    }
}

fn margin(telemetry: &Telemetry, value: fn(GearMargin) -> f32) -> Option<f64> {
    telemetry.margin.map(|margin| shortest(value(margin)))
}

/// An upper tone if the output has one; without it the measured tone is noise.
fn tone(telemetry: &Telemetry, n: usize) -> Option<UpperTone> {
    let shape = telemetry.shape;
    (telemetry.overtones[n] != [0.0; 2]).then_some([shape.second, shape.third][n])
}

pub(in crate::verbs) fn columns() -> Vec<(Column, usize)> {
    cycles().columns().into_iter().zip(WIDTHS).collect()
}

struct Rows {
    stream: Stream<Stdout>,
    row: Row,
    next: u32,
    cycles: u64,
    events: u64,
}

/// Rows of telemetry and events, with the board's time if its frequency is known.
#[derive(Default)]
pub(in crate::verbs) struct Row {
    frequency: Option<f64>,
}

/// Number of columns before that of the event.
const EVENT_COLUMN: usize = 25;

impl Rows {
    fn new(format: Format) -> Self {
        Self {
            stream: Stream::new(format, columns(), stdout()),
            row: Row::default(),
            next: 0,
            cycles: 0,
            events: 0,
        }
    }

    /// Prints the message; returns whether the output still has a reader.
    fn take(&mut self, message: BoardMessage) -> Result<bool> {
        match message {
            BoardMessage::Setting(key, value) => {
                if key == "frequency" {
                    self.row.set_frequency(value);
                }
                Ok(true)
            }
            BoardMessage::Telemetry(telemetry) => {
                self.cycles += 1;
                self.stream.row(&self.row.cycle(&telemetry))
            }
            BoardMessage::Event(event) => {
                // A late response leads to a second request, so the event may arrive twice.
                if (event.number.wrapping_sub(self.next) as i32) < 0 {
                    return Ok(true);
                }
                self.next = event.number.wrapping_add(1);
                self.events += 1;
                self.stream.row(&self.row.event(&event))
            }
            BoardMessage::Started(image) => {
                self.next = 0;
                self.stream.row(&self.row.start(&image))
            }
        }
    }

    fn close(&self) {
        eprintln!("{} rows of telemetry, {} events", self.cycles, self.events);
    }
}

impl Row {
    pub fn set_frequency(&mut self, frequency: f32) {
        self.frequency = (frequency > 0.0).then_some(frequency.into());
    }

    fn time(&self, cycle: u32) -> Option<f64> {
        self.frequency.map(|frequency| f64::from(cycle) / frequency)
    }

    fn event_row(&self, cycle: u32, text: String) -> Vec<Value> {
        let mut row = vec![self.time(cycle).into(), cycle.into()];
        row.resize(EVENT_COLUMN, Value::Missing);
        row.push(text.into());
        row
    }

    pub fn event(&self, record: &Record) -> Vec<Value> {
        self.event_row(record.cycle, event_text(record))
    }

    /// Row of a board's start with this image; the count of cycles restarts.
    pub fn start(&self, image: &str) -> Vec<Value> {
        self.event_row(0, format!("the board started: kband {image}"))
    }

    pub fn cycle(&self, telemetry: &Telemetry) -> Vec<Value> {
        let number = telemetry.cycle;
        cycles().row(&(self.time(number), number, *telemetry))
    }
}

/// Fault and limits of a cycle in words; `None` without any.
fn limits_text(telemetry: &Telemetry) -> Option<String> {
    let fault = Fault::numbered(telemetry.fault);
    let fault = fault.map(|fault| format!("fault {}: {}", fault.number(), fault.name()));
    let limits = Limits::ALL.iter();
    let limits = limits.filter(|limit| limit.bits() & telemetry.limits != 0);
    let limits = limits.map(|limit| format!("limit {}: {}", limit.number(), limit.name()));
    let held: Vec<String> = fault.into_iter().chain(limits).collect();
    (!held.is_empty()).then(|| held.join("; "))
}

fn event_text(record: &Record) -> String {
    let event = Event::numbered(record.event);
    let unknown = || format!("event {}", record.event);
    let name = event.map_or_else(unknown, |event| event.name().into());
    let fault = Fault::numbered(record.fault);
    match (event, fault) {
        (Some(Event::Faulted), Some(fault)) => {
            format!("{name}: {} (fault {})", fault.name(), fault.number())
        }
        (Some(Event::Weighed), _) => {
            let flow = || format!(", {} g/s", number(record.flow, 3));
            let flow = when(record.flow != 0.0, flow);
            format!("{name}: {} g{flow}", number(record.mass, 3))
        }
        _ => name,
    }
}
