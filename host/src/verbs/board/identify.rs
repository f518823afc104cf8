//! `kband identify`: identity and condition of the board on the link.

use serde_json::json;

use kband_control::wire::{
    Access, Counters, FaultRecord, Request, Response, SCHEMA, SavedSettings, VERSION,
};
use kband_control::{Fault, State};

use crate::arguments::FormatArguments;
use crate::board::{Address, Emulated};
use crate::desk::Desk;
use crate::refusal::{Exit, Result};
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
    printed: FormatArguments,
}

pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit> {
    let mut link = arguments.address.open_any(Emulated::AtRest)?;
    let (version, schema) = link.protocol();
    let fits = link.check_protocol().is_ok();
    let mut table = Table::new(&[columns::ITEM, columns::VALUE]);
    let mut row = |item: &str, value: String| table.push([item.to_string().into(), value.into()]);
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
        report.json(json).print(arguments.printed.format)?;
        return Ok(Exit::CheckFailed);
    }
    let mut faults = Vec::new();
    for back in 0..FAULTS {
        let fault = link.request(&Request::Fault(back), |response| match response {
            Response::Fault(fault) => fault,
            _ => None,
        })?;
        let Some(fault) = fault else { break };
        faults.push(fault);
    }
    // There is no self-test while the drive runs.
    let test = link.request(&Request::SelfTest, |response| match response {
        Response::SelfTest(test) => Some(test),
        _ => None,
    })?;
    let last_words = link.request(&Request::LastWords, |response| match response {
        Response::LastWords(text) => text.map(str::to_string),
        _ => None,
    })?;
    let counters = link.request(&Request::Counters, |response| match response {
        Response::Counters(counters) => counters,
        _ => Counters::default(),
    })?;
    let access = link.status()?.unwrap_or_default().access;
    match test {
        Some(test) => {
            let set_up = &test.set_up;
            let either = |is: bool, yes: &str, no: &str| if is { yes } else { no }.to_string();
            let bad = "not at zero acceleration: check its cable, sensor_zero and sensitivity";
            row("sensor", either(test.sensor, "good", bad));
            row("settings", settings_text(test.settings).into());
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
                let cost = format!("sample {sample}, control {control} at most");
                row("core cycles", cost);
            }
        }
        None => row("self-test", "not while the drive runs".into()),
    }
    row("desk", access_text(access).into());
    row("last words", last_words.clone().unwrap_or("none".into()));
    for fault in &faults {
        row(&format!("fault {} kept", fault.number), fault_text(fault));
    }
    row("requests read", counters.requests.to_string());
    let refused = format!(
        "{} oversized, {} corrupt, {} foreign, {} unknown, {} too many",
        counters.oversized, counters.corrupt, counters.foreign, counters.unknown, counters.flooded
    );
    row("frames refused", refused);
    let [rows, answers] = [counters.rows_dropped, counters.answers_dropped];
    let dropped = format!("{rows} rows of telemetry, {answers} answers");
    row("frames dropped", dropped);
    json["access"] = json!(match access {
        Access::Full => "full",
        Access::Strapped => "read-only by strap",
        Access::Locked => "read-only by PIN",
    });
    json["self_test"] = test.map_or(json!(null), |test| {
        json!({
            "sensor": test.sensor,
            "settings": match test.settings {
                SavedSettings::InUse => "in use",
                SavedSettings::Different => "others",
                SavedSettings::Never => "never saved",
                SavedSettings::Damaged => "damaged",
            },
            "stack_free": test.stack_free,
            "missed": test.missed,
            "brown_out": test.set_up.brown_out,
            "hardware_watchdog": test.set_up.watchdog,
            "sample_cost": test.set_up.sample,
            "control_cost": test.set_up.control,
        })
    });
    let fault = |fault: &FaultRecord| {
        json!({
            "number": fault.number, "time": fault.seconds, "fault": fault.fault,
            "state": fault.state, "b": fault.amplitude * 1e3,
            "b_expected": fault.expected * 1e3, "output": fault.output,
            "low": fault.low, "high": fault.high,
        })
    };
    json["faults"] = faults.iter().map(fault).collect();
    json["last_words"] = json!(last_words);
    json["counters"] = json!(counters);
    let report = Printout::new(table).json(json);
    report.print(arguments.printed.format).map(|()| Exit::Done)
}

/// Largest number of kept faults.
const FAULTS: u8 = 32;

fn access_text(access: Access) -> &'static str {
    match access {
        Access::Full => "may change the board",
        Access::Strapped => "may read and stop the drive: the strap, PC1, is wired to ground",
        Access::Locked => "may read and stop the drive until kband unlock PIN",
    }
}

fn settings_text(storage: SavedSettings) -> &'static str {
    match storage {
        SavedSettings::InUse => "good",
        SavedSettings::Different => "those in use differ from the saved ones: kband settings save",
        SavedSettings::Never => "none were ever saved, the drive stays off: kband settings save",
        SavedSettings::Damaged => {
            "damaged or of a newer firmware, the drive stays off: kband settings import FILE.toml --save"
        }
    }
}

fn fault_text(record: &FaultRecord) -> String {
    let name = Fault::numbered(record.fault).map_or("unknown", Fault::name);
    let state = State::numbered(record.state).map_or("unknown", State::name);
    let [b, expected] = [record.amplitude, record.expected].map(|metres| metres * 1e3);
    let (fault, seconds, output) = (record.fault, record.seconds, record.output);
    let (low, high) = (record.low, record.high);
    format!(
        "{name} ({fault}) after {seconds} s, {state}: b {b:.4} mm, expected {expected:.4} mm, output {output:.3}, readings {low} to {high}"
    )
}
