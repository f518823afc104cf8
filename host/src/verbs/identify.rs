//! `kband identify`: who is on the line, and how it is.

use serde_json::json;

use kband::wire::{Counters, Request, Response, SCHEMA, SelfTest, VERSION};

use crate::arguments::Printed;
use crate::board::{Address, Emulated, Line};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report::{Column, Report, Table};

/// Ask a board who it is: image, link version, self-test, last words before its reset, counters.
///
/// Exit status 1 where the board speaks another version of the link than this kband.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband identify
  kband identify --on /dev/ttyACM0 --format json
  kband identify --on qemu")]
pub struct Arguments {
    #[command(flatten)]
    address: Address,

    #[command(flatten)]
    printed: Printed,
}

/// Asks and prints.
pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    let mut line = arguments.address.open_any(Emulated::AtRest)?;
    let (version, schema) = line.speaks();
    let fits = line.speaks_the_same().is_ok();
    let mut table = Table::new(&[Column::new("item", ""), Column::new("value", "")]);
    let mut row = |item: &str, value: String| table.push([item.into(), value.into()]);
    row("board", line.name().into());
    row("image", format!("kband {}", line.image()));
    row("link", format!("version {version}, schema {schema:08x}"));
    let mut json = json!({
        "board": line.name(),
        "image": line.image(),
        "version": version,
        "schema": format!("{schema:08x}"),
        "fits_this_desk": fits,
    });
    if !fits {
        let report = Report::new(table).note(format!(
            "this desk speaks version {VERSION}, schema {SCHEMA:08x}: flash the firmware that belongs to it (kband flash)"
        ));
        report.json(&json)?.print(arguments.printed.format)?;
        return Ok(Exit::CheckFailed);
    }
    let condition = Condition::ask(&mut line)?;
    match condition.test {
        Some(test) => {
            let verdict =
                |good: bool, bad: &str| if good { "good".into() } else { bad.to_string() };
            row(
                "sensor",
                verdict(
                    test.sensor,
                    "not at zero acceleration: check its cable, sensor_zero and sensitivity",
                ),
            );
            row(
                "settings",
                verdict(
                    test.settings,
                    "those in use are not those kept: kband settings save",
                ),
            );
            row("stack never used", format!("{} bytes", test.stack_free));
            row("late cycles", test.missed.to_string());
        }
        None => row("self-test", "not while the drive runs".into()),
    }
    row(
        "last words",
        condition.words.clone().unwrap_or_else(|| "none".into()),
    );
    let Counters {
        requests,
        oversized,
        corrupt,
        foreign,
        unknown,
        flooded,
    } = condition.counters;
    row("requests read", requests.to_string());
    row(
        "frames refused",
        format!(
            "{oversized} oversized, {corrupt} corrupt, {foreign} foreign, {unknown} unknown, {flooded} too many"
        ),
    );
    json["self_test"] = condition.test.map_or(json!(null), |test| {
        json!({
            "sensor": test.sensor,
            "settings": test.settings,
            "stack_free": test.stack_free,
            "missed": test.missed,
        })
    });
    json["last_words"] = json!(condition.words);
    json["counters"] = json!({
        "requests": requests, "oversized": oversized, "corrupt": corrupt,
        "foreign": foreign, "unknown": unknown, "flooded": flooded,
    });
    Report::new(table)
        .json(&json)?
        .print(arguments.printed.format)?;
    Ok(Exit::Done)
}

/// How a board is.
struct Condition {
    /// `None` while its drive runs.
    test: Option<SelfTest>,
    words: Option<String>,
    counters: Counters,
}

impl Condition {
    fn ask(line: &mut Line) -> Result<Self, Refusal> {
        Ok(Self {
            test: line.ask(&Request::SelfTest, |response| match response {
                Response::SelfTest(test) => Some(test),
                _ => None,
            })?,
            words: line.ask(&Request::LastWords, |response| match response {
                Response::LastWords(words) => words.map(str::to_string),
                _ => None,
            })?,
            counters: line.ask(&Request::Counters, |response| match response {
                Response::Counters(counters) => counters,
                _ => Counters::default(),
            })?,
        })
    }
}
