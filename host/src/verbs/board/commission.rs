//! `kband commission`: the record of a commissioning, step by step.

mod record;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use chrono::{SecondsFormat, Utc};
use kband_control::State;
use kband_control::wire::{Request, Telemetry};
use serde_json::{Value as Json, json};

use super::status::BoardStatus;
use crate::arguments::{self, FormatArguments};
use crate::board::{Address, BoardSettings, Emulated, Link, Unsolicited};
use crate::desk::{Desk, Progress};
use crate::file::Destination;
use crate::refusal::{Exit, Refusal};
use crate::report::{finite, shortest};
use record::Record;

/// Record a step of a board's commissioning: settings, readings, and some seconds of telemetry.
///
/// Each call adds a step to the record. The first step shows the board as found, the last as left.
/// The record is one page for the browser, or JSON. It has a picture for each step, and the
/// settings before and after.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband commission line3.html --step 'as found'
  kband commission line3.html --step drive --seconds 10 --note 'empty track, target 0.05 mm'
  kband commission line3.json --step 'as left' --on /dev/ttyACM0

docs/commissioning.md has the steps. This command changes nothing on the board.")]
pub struct Arguments {
    /// The record, .html or .json. It is created if missing; otherwise the step is appended.
    #[arg(value_name = "RECORD.html")]
    record: PathBuf,

    /// Name of the step.
    #[arg(long, value_name = "WORDS")]
    step: String,

    /// Note on the step.
    #[arg(long, value_name = "WORDS")]
    note: Option<String>,

    /// Duration of the recorded telemetry in s.
    #[arg(long, value_name = "S", default_value = "3", value_parser = arguments::within(0.5, 600.0, "s"))]
    seconds: f64,

    #[command(flatten)]
    address: Address,

    #[command(flatten)]
    printed: FormatArguments,
}

/// Largest number of telemetry rows in a step, approximately.
const MAX_ROWS_PER_STEP: f64 = 600.0;

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let target = Destination::check(&arguments.record)?.durable();
    let mut record = Record::open(&target)?;
    let mut link = arguments.address.open(Emulated::Running)?;
    let settings = BoardSettings::read(&mut link)?;
    let frequency = f64::from(settings.configured().frequency);
    let every = arguments.seconds * frequency / MAX_ROWS_PER_STEP;
    let every = every.ceil().max(1.0) as u16;
    let rows = telemetry(&mut link, every, arguments.seconds, desk)?;
    let status = BoardStatus::request(&mut link)?;
    let values = settings.iter().map(|setting| {
        let value = json!({"value": shortest(setting.value), "unit": setting.unit});
        (setting.key.clone(), value)
    });
    record.steps.push(json!({
        "step": arguments.step,
        "note": arguments.note,
        "time_utc": Utc::now().to_rfc3339_opts(SecondsFormat::Secs, true),
        "image": link.image(),
        "status": status.to_json(),
        "settings": values.collect::<Json>(),
        "telemetry": telemetry_json(&rows, frequency),
    }));
    record.write(&target)?;
    status.printout()?.print(arguments.printed.format)?;
    let (written, steps) = (target.describe_write(), record.steps.len());
    eprintln!("{written}: step {steps}, {}", arguments.step);
    Ok(Exit::Done)
}

/// Telemetry of `seconds`, each `every`-th cycle.
fn telemetry(
    link: &mut Link,
    every: u16,
    seconds: f64,
    desk: &Desk,
) -> Result<Vec<Telemetry>, Refusal> {
    let progress = Progress::new("listening", (10.0 * seconds) as u64);
    let mut rows = Vec::new();
    let start = Instant::now();
    link.command(&Request::Telemetry(every))?;
    let recorded = (|| {
        while start.elapsed().as_secs_f64() < seconds {
            desk.check_stop()?;
            for message in link.listen(Duration::from_millis(100))? {
                if let Unsolicited::Telemetry(row) = message {
                    rows.push(row);
                }
            }
            progress.advance(1);
        }
        Ok(())
    })();
    progress.finish();
    // Telemetry is switched off again even after an error.
    link.command(&Request::Telemetry(0))?;
    recorded.map(|()| rows)
}

/// Rows of the record, with the time in s from the first one.
fn telemetry_json(rows: &[Telemetry], frequency: f64) -> Vec<Json> {
    let first = rows.first().map_or(0, |row| row.cycle);
    let finite = |value: f32| finite(value).map(shortest);
    let cells = |row: &Telemetry| {
        let time = f64::from(row.cycle.wrapping_sub(first)) / frequency;
        json!({
            "time": (time * 1e4).round() / 1e4,
            "b": finite(row.amplitude * 1e3),
            "setpoint_b": finite(row.setpoint * 1e3),
            "k": finite(row.k),
            "output": finite(row.output),
            "impacts_detected": finite(row.rate),
            "in_gear_estimated": finite(row.in_gear),
            "state": State::numbered(row.state).map(State::name),
        })
    };
    rows.iter().map(cells).collect()
}
