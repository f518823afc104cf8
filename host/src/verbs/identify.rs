//! `kband identify`: who is on the link, and how it is.

use serde_json::json;

use kband_control::wire::{
    Access, Counters, Kept, KeptFault, Request, Response, SCHEMA, SelfTest, VERSION,
};
use kband_control::{Fault, State};

use crate::arguments::Printed;
use crate::board::{Address, Emulated, Link};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns};

/// Print the identity of a board: image, link version, self-test, last message before its reset,
/// counters.
///
/// The exit status is 1 if the board has another version of the link than this kband.
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
    let mut link = arguments.address.open_any(Emulated::AtRest)?;
    let (version, schema) = link.speaks();
    let fits = link.speaks_the_same().is_ok();
    let mut table = Table::new(&[columns::ITEM, columns::VALUE]);
    let mut row = |item: &str, value: String| table.push([item.into(), value.into()]);
    row("board", link.name().into());
    row("image", format!("kband {}", link.image()));
    row("link", format!("version {version}, schema {schema:08x}"));
    let mut json = json!({
        "board": link.name(),
        "image": link.image(),
        "version": version,
        "schema": format!("{schema:08x}"),
        "fits_this_desk": fits,
    });
    if !fits {
        let report = Printout::new(table).note(format!(
            "this desk speaks version {VERSION}, schema {SCHEMA:08x}: {}",
            link.fitting_firmware()
        ));
        report.json(&json)?.print(arguments.printed.format)?;
        return Ok(Exit::CheckFailed);
    }
    let condition = Condition::ask(&mut link)?;
    match condition.test {
        Some(test) => {
            let set_up = &test.set_up;
            let either = |is: bool, yes: &str, no: &str| if is { yes } else { no }.to_string();
            let bad = "not at zero acceleration: check its cable, sensor_zero and sensitivity";
            row("sensor", either(test.sensor, "good", bad));
            row("settings", settings_in_words(test.settings).into());
            row("stack never used", format!("{} bytes", test.stack_free));
            row("late cycles", test.missed.to_string());
            let brown_out = match set_up.brown_out {
                0 => "off: kband flash --option-bytes sets level 3".into(),
                level => format!("below {} V", f32::from(level) * 1e-3),
            };
            row("brown-out reset", brown_out);
            let [power, program] = ["starts with the power", "starts with the program"];
            row("watchdog", either(set_up.watchdog, power, program));
            if set_up.sample > 0 {
                let (sample, control) = (set_up.sample, set_up.control);
                row(
                    "core cycles",
                    format!("sample {sample}, control {control} at most"),
                );
            }
        }
        None => row("self-test", "not while the drive runs".into()),
    }
    row("desk", allowed(condition.access).into());
    row(
        "last words",
        condition.words.clone().unwrap_or_else(|| "none".into()),
    );
    for fault in &condition.faults {
        row(&format!("fault {} kept", fault.number), in_words(fault));
    }
    let Counters {
        requests,
        oversized,
        corrupt,
        foreign,
        unknown,
        flooded,
        rows_dropped,
        answers_dropped,
    } = condition.counters;
    row("requests read", requests.to_string());
    row(
        "frames refused",
        format!(
            "{oversized} oversized, {corrupt} corrupt, {foreign} foreign, {unknown} unknown, {flooded} too many"
        ),
    );
    row(
        "frames dropped",
        format!("{rows_dropped} rows of telemetry, {answers_dropped} answers"),
    );
    json["access"] = json!(match condition.access {
        Access::Full => "full",
        Access::Strapped => "read-only by strap",
        Access::Locked => "read-only by PIN",
    });
    json["self_test"] = condition.test.map_or(json!(null), |test| {
        json!({
            "sensor": test.sensor,
            "settings": match test.settings {
                Kept::InUse => "in use",
                Kept::Others => "others",
                Kept::Never => "never saved",
                Kept::Damaged => "damaged",
            },
            "stack_free": test.stack_free,
            "missed": test.missed,
            "brown_out": test.set_up.brown_out,
            "hardware_watchdog": test.set_up.watchdog,
            "sample_cost": test.set_up.sample,
            "control_cost": test.set_up.control,
        })
    });
    json["faults"] = condition
        .faults
        .iter()
        .map(|fault| {
            json!({
                "number": fault.number, "time": fault.seconds, "fault": fault.fault,
                "state": fault.state, "b": fault.amplitude * 1e3,
                "b_expected": fault.expected * 1e3, "output": fault.output,
                "low": fault.low, "high": fault.high,
            })
        })
        .collect();
    json["last_words"] = json!(condition.words);
    json["counters"] = json!({
        "requests": requests, "oversized": oversized, "corrupt": corrupt,
        "foreign": foreign, "unknown": unknown, "flooded": flooded,
        "rows_dropped": rows_dropped, "answers_dropped": answers_dropped,
    });
    Printout::new(table)
        .json(&json)?
        .print(arguments.printed.format)?;
    Ok(Exit::Done)
}

const FAULTS: u8 = 32;

pub(super) fn allowed(access: Access) -> &'static str {
    match access {
        Access::Full => "may change the board",
        Access::Strapped => "may read and stop the drive: the strap, PC1, is wired to ground",
        Access::Locked => "may read and stop the drive until kband unlock PIN",
    }
}

fn settings_in_words(kept: Kept) -> &'static str {
    match kept {
        Kept::InUse => "good",
        Kept::Others => "those in use differ from the saved ones: kband settings save",
        Kept::Never => "none were ever saved, the drive stays off: kband settings save",
        Kept::Damaged => {
            "damaged or of a newer firmware, the drive stays off: kband settings import FILE.toml --save"
        }
    }
}

fn in_words(kept: &KeptFault) -> String {
    let fault = Fault::numbered(kept.fault).map_or("unknown", Fault::name);
    let state = State::numbered(kept.state).map_or("unknown", State::name);
    format!(
        "{fault} ({}) after {} s, {state}: b {:.4} mm, expected {:.4} mm, output {:.3}, readings {} to {}",
        kept.fault,
        kept.seconds,
        kept.amplitude * 1e3,
        kept.expected * 1e3,
        kept.output,
        kept.low,
        kept.high
    )
}

struct Condition {
    /// `None` while its drive runs.
    test: Option<SelfTest>,
    /// The last faults, newest first.
    faults: Vec<KeptFault>,
    words: Option<String>,
    counters: Counters,
    access: Access,
}

impl Condition {
    fn ask(link: &mut Link) -> Result<Self, Refusal> {
        let mut faults = Vec::new();
        for back in 0..FAULTS {
            let fault = link.ask(&Request::Fault(back), |response| match response {
                Response::Fault(fault) => fault,
                _ => None,
            })?;
            let Some(fault) = fault else { break };
            faults.push(fault);
        }
        Ok(Self {
            faults,
            test: link.ask(&Request::SelfTest, |response| match response {
                Response::SelfTest(test) => Some(test),
                _ => None,
            })?,
            words: link.ask(&Request::LastWords, |response| match response {
                Response::LastWords(words) => words.map(str::to_string),
                _ => None,
            })?,
            counters: link.ask(&Request::Counters, |response| match response {
                Response::Counters(counters) => counters,
                _ => Counters::default(),
            })?,
            access: link.status()?.unwrap_or_default().access,
        })
    }
}
