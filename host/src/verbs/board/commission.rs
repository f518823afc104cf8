//! `kband commission`: the record of a commissioning, step by step.

use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use chrono::{SecondsFormat, Utc};
use kband_control::State;
use kband_control::wire::{Request, Telemetry};
use serde_json::{Map, Value as Json, json};

use super::status::BoardStatus;
use crate::arguments::{self, FormatArguments};
use crate::board::{Address, BoardMessage, BoardSettings, Emulated, Link};
use crate::desk::{Desk, Progress};
use crate::file::Destination;
use crate::page::{self, Page};
use crate::provenance;
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{finite, number, shortest};

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
/// Longest wait for telemetry beyond the recorded duration.
const PATIENCE: Duration = Duration::from_secs(10);

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let target = Destination::check(&arguments.record)?.durable();
    let mut record = Record::open(&target)?;
    let mut link = arguments.address.open(Emulated::Running)?;
    let settings = BoardSettings::read(&mut link)?;
    let frequency = f64::from(settings.configured().frequency);
    let every = arguments.seconds * frequency / MAX_ROWS_PER_STEP;
    let every = every.ceil().max(1.0) as u16;
    let rows = telemetry(&mut link, every, arguments.seconds, frequency, desk)?;
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
    status.printout().print(arguments.printed.format)?;
    let (written, steps) = (target.describe_write(), record.steps.len());
    eprintln!("{written}: step {steps}, {}", arguments.step);
    Ok(Exit::Done)
}

/// Listens until the rows span `seconds` of the board's own time, which passes more slowly in an
/// emulator on a busy machine. It waits at most [`PATIENCE`] longer.
fn telemetry(
    link: &mut Link,
    every: u16,
    seconds: f64,
    frequency: f64,
    desk: &Desk,
) -> Result<Vec<Telemetry>> {
    let progress = Progress::new("listening", (10.0 * seconds) as u64);
    let mut rows: Vec<Telemetry> = Vec::new();
    let end = Instant::now() + Duration::from_secs_f64(seconds) + PATIENCE;
    let incomplete = |rows: &[Telemetry]| {
        rows.first().zip(rows.last()).is_none_or(|(first, last)| {
            f64::from(last.cycle.wrapping_sub(first.cycle)) < seconds * frequency
        })
    };
    link.command(&Request::Telemetry(every))?;
    let recorded = (|| {
        while incomplete(&rows) && Instant::now() < end {
            desk.check_stop()?;
            for message in link.listen(Duration::from_millis(100))? {
                if let BoardMessage::Telemetry(row) = message {
                    rows.push(row);
                }
            }
            progress.advance(1);
        }
        Ok(())
    })();
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

const FIGURES: &str = include_str!("commission/record.js");

#[derive(Clone, Debug, Default)]
struct Record {
    steps: Vec<Json>,
}

impl Record {
    /// Opens or begins the record in a file, which is input and output, so without [`crate::file`].
    fn open(target: &Destination) -> Result<Self> {
        let path = target.path();
        target.ends_in("RECORD", &["html", "htm", "json"])?;
        if !path.exists() {
            return Ok(Self::default());
        }
        let text = fs::read_to_string(path)
            .map_err(|error| Refusal::file(path, &error, "give another name"))?;
        Self::read(&text).ok_or_else(|| {
            let name = path.display();
            let cause = format!("{name} is there already, and is no record of a commissioning");
            Refusal::new(cause, "give another name")
        })
    }

    fn read(text: &str) -> Option<Self> {
        let data = if page::own(text) {
            page::data_of(text)?
        } else {
            serde_json::from_str(text).ok()?
        };
        let steps = data.get("commissioning")?.as_array()?.clone();
        Some(Self { steps })
    }

    fn write(&self, target: &Destination) -> Result<()> {
        let data = provenance::add(json!({"commissioning": self.steps}), Map::new());
        let text = if target.ending() == "json" {
            format!("{data:#}\n")
        } else {
            self.page(data).to_html()
        };
        target.write_bytes(text.as_bytes())
    }

    fn page(&self, data: Json) -> Page {
        let cell = |value: &Json| match value {
            Json::Null => "-".to_string(),
            Json::String(text) => text.clone(),
            Json::Number(value) => value.as_f64().map_or("-".into(), |value| number(value, 4)),
            other => other.to_string(),
        };
        let readings = [
            ("state", "state"),
            ("fault", "fault"),
            ("target", "target"),
            ("enable input", "enable_input"),
            ("mean acceleration / m/s\u{b2}", "mean_acceleration"),
            ("b / mm", "b"),
            ("setpoint / mm", "setpoint_b"),
            ("k", "k"),
            ("output", "output"),
            ("in gear estimated", "in_gear_estimated"),
        ];
        let mut heads = vec!["step"];
        heads.extend(readings.map(|(name, _)| name));
        let row = |step: &Json| {
            let mut row = vec![cell(&step["step"])];
            row.extend(readings.map(|(_, key)| cell(&step["status"][key])));
            row
        };
        let rows: Vec<Vec<String>> = self.steps.iter().map(row).collect();
        let (changed, all) = self.settings(&cell);
        let setting_heads = ["key", "before", "after", "unit"];
        let about = format!(
            "{} steps, the settings before those of the first, after those of the last.",
            self.steps.len()
        );
        let settings = if changed.is_empty() {
            page::paragraphs(&["No setting differs between the first step and the last.".into()])
        } else {
            page::table(&setting_heads, &changed)
        } + "<details><summary>all settings</summary>\n"
            + &page::table(&setting_heads, &all)
            + "</details>\n";
        let settings = page::paragraphs(&[about]) + &settings;
        let mut page = Page::new("Record of a commissioning", data, FIGURES)
            .section("Settings that were changed", &settings)
            .section("Readings", &page::table(&heads, &rows));
        for (n, step) in self.steps.iter().enumerate() {
            let [time, image] = [&step["time_utc"], &step["image"]].map(cell);
            let mut lines = vec![format!("{time}, image {image}")];
            lines.extend(step["note"].as_str().map(String::from));
            page = page.section(
                &format!("Step {}: {}", n + 1, cell(&step["step"])),
                &(page::paragraphs(&lines)
                    + &page::figure(&format!("amplitude-{n}"), "Amplitude of the track over time, and setpoint of the target.")
                    + &page::figure(&format!("shares-{n}"), "Output of the drive as a share of the full one, and estimated share of time in gear.")),
            );
        }
        page
    }

    fn settings(&self, cell: &dyn Fn(&Json) -> String) -> (Vec<Vec<String>>, Vec<Vec<String>>) {
        let settings =
            |step: Option<&Json>| step.map_or(Json::Null, |step| step["settings"].clone());
        let [before, after] = [self.steps.first(), self.steps.last()].map(settings);
        let row = |key: &String| {
            let value = |settings: &Json| cell(&settings[key]["value"]);
            let unit = cell(&after[key]["unit"]);
            vec![key.clone(), value(&before), value(&after), unit]
        };
        let keys = after.as_object().into_iter().flat_map(Map::keys);
        let all: Vec<Vec<String>> = keys.map(row).collect();
        let changed = all.iter().filter(|row| row[1] != row[2]).cloned().collect();
        (changed, all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_grows_and_is_read_back_from_page_and_json() {
        let step = |gain: f64| {
            json!({"step": "a <b>", "note": null, "status": {"k": 0.41},
                "settings": {"gain": {"value": gain, "unit": "mm"}, "quality": {"value": 25.0, "unit": ""}}, "telemetry": []})
        };
        let mut record = Record::default();
        record.steps.extend([step(1.0), step(1.25)]);
        let data = json!({"commissioning": record.steps});
        let html = record.page(data.clone()).to_html();
        assert!(html.contains("<td>gain</td><td>1</td><td>1.25</td><td>mm</td>"));
        for text in [html, data.to_string()] {
            assert_eq!(Record::read(&text).unwrap().steps, record.steps);
        }
        for text in ["", "{}", "[1]", "<!doctype html>", "{\"commissioning\": 3}"] {
            assert!(Record::read(text).is_none(), "{text}");
        }
    }
}
