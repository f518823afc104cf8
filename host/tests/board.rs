//! Verbs for a board, run against the firmware on the emulated CPU.

mod outcome;

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use kband_control::wire::{
    Identity, Incoming, MAX_FRAME_BYTES, Receiver, Refusal, Request, Response, SCHEMA, Setting,
    Telemetry, VERSION, read_request, write_identity, write_response,
};
use kband_control::{Identification, Identified, Key, Settings, State, Target};
use kband_machines::emulator::Machine;
use kband_machines::images;
use kband_machines::terminal::Terminal;
use outcome::{Outcome, folder};
use serde_json::Value;
use tempfile::TempDir;

const TIMEOUT: &str = "60";
/// Time limit of a board's process and of a wait for a status.
const BOARD_TIMEOUT: Duration = Duration::from_secs(600);
const STATUS_TIMEOUT: Duration = Duration::from_secs(120);

/// Runs `kband` in `folder` on the emulated board; killed at the limit.
fn kband(folder: impl AsRef<Path>, args: &str) -> Outcome {
    outcome::on_board(folder, TIMEOUT, args, &[])
}

/// The same; the board's flash, with its settings, is kept in a file between commands.
fn on_flash(folder: impl AsRef<Path>, args: &str) -> Outcome {
    outcome::on_board(folder, TIMEOUT, args, &["--flash-image", "board.flash"])
}

fn flash(folder: &TempDir) -> Vec<u8> {
    std::fs::read(folder.path().join("board.flash")).unwrap()
}

fn text(folder: &TempDir, name: &str) -> String {
    std::fs::read_to_string(folder.path().join(name)).unwrap()
}

fn run(folder: impl AsRef<Path>, args: &str, more: &[&str]) -> Outcome {
    let args: Vec<&str> = args.split(' ').chain(more.iter().copied()).collect();
    outcome::run(folder, TIMEOUT, &args)
}

#[test]
fn an_image_is_checked_without_a_probe() {
    let folder = folder();
    let args = "flash --dry-run --format json";
    let (package, bin, machine) = ("kband-firmware", "feeder", Machine::CortexM4F);
    let nucleo = images::build_with(package, bin, machine, Some("stm32g474re"));
    let plan = run(&folder, args, &[nucleo.to_str().unwrap()]).json();
    assert_eq!(plan["chip"], "STM32G474RE");
    let last = plan["sectors"].as_array().unwrap().last().unwrap();
    assert_eq!(last["what"], "settings and faults, kept");
    assert_eq!(last["sectors"], serde_json::json!([252, 255]));
    let image = images::build(package, bin, machine);
    let plan = run(&folder, args, &[image.to_str().unwrap()]).json();
    let sectors = plan["sectors"].as_array().unwrap();
    let sizes = sectors.iter().map(|sector| &sector["image_size"]);
    let bytes: u64 = sizes.filter_map(Value::as_u64).sum();
    assert_eq!(Some(bytes), plan["flash_used"].as_u64());
    assert!(bytes > 100_000, "{plan}");
    assert!(plan["ram_used"].as_u64().unwrap() > 32 * 1024, "{plan}");
    assert_eq!(plan["written"], false);
    assert_eq!(plan["chip"], "STM32F405RG");
    let stored = &sectors[1];
    assert_eq!(stored["what"], "settings and faults, kept");
    assert_eq!(stored["sectors"], serde_json::json!([1, 4]));
    assert_eq!(plan["option_bytes"], Value::Null);
    // Pending changes of option bytes are listed. Changes that kband cannot make are refused.
    let requested = ["--option-bytes", image.to_str().unwrap()];
    run(&folder, args, &requested).prints(&["brown-out reset at level 3"]);
    let emulated = run(&folder, "flash --dry-run", &[&outcome::image()]);
    emulated.refused(&["emulated board", "cargo feeder"]);
    let chip_in_qemu = ["--on", "qemu", "--image", image.to_str().unwrap()];
    let expected = [
        "does not answer",
        "an image for the emulated CPU",
        "virtual_feeder",
    ];
    run(&folder, "status", &chip_in_qemu).refused(&expected);
    // This build may lack support for probes; else no probe is connected.
    let outcome = run(&folder, "flash", &[image.to_str().unwrap()]);
    let expected = ["--features flash", "no debug probe"];
    outcome.refused(&[expected[usize::from(cfg!(feature = "flash"))], "next:"]);
}

#[test]
fn identify_reports_identity_and_condition() {
    let folder = folder();
    let board = kband(&folder, "identify --format json").json();
    assert_eq!(board["schema"], format!("{SCHEMA:08x}"));
    assert_eq!(board["fits_this_desk"], true);
    let test = &board["self_test"];
    assert_eq!(test["sensor"], true);
    assert_eq!(test["settings"], "never saved");
    assert!(test["stack_free"].as_u64().unwrap() > 1000, "{board}");
    assert_eq!(board["last_words"], Value::Null);
}

#[test]
fn a_saved_change_of_settings_outlasts_a_restart() {
    let folder = folder();
    let list = kband(&folder, "settings list --format json").json();
    let list = list.as_array().unwrap();
    assert_eq!(list.len(), Settings::KEYS.len());
    for (row, key) in list.iter().zip(Settings::KEYS) {
        assert_eq!(row["key"], key.name);
        assert_eq!(row["unit"], key.unit);
        for (name, value) in [("value", key.default), ("low", key.low), ("high", key.high)] {
            let printed = row[name].as_f64().map(|value| value as f32);
            assert_eq!(printed, Some(value), "{row}");
        }
    }
    on_flash(&folder, "settings set restitution_high 0.31").prints(&["--save"]);
    let value = |key: &str| {
        on_flash(&folder, &format!("settings get {key} --format json")).json()[0]["value"].clone()
    };
    assert_eq!(value("restitution_high"), 0.22);
    on_flash(&folder, "settings set restitution_high 0.31 --save").prints(&["saved: "]);
    on_flash(&folder, "settings set incline -2.5 --save").done();
    assert_eq!(value("restitution_high"), 0.31);
    assert_eq!(value("incline"), -2.5);
}

#[test]
fn a_settings_file_is_applied_whole_or_not_at_all() {
    let folder = folder();
    on_flash(&folder, "settings export all.toml").done();
    let all = text(&folder, "all.toml");
    assert_eq!(all.matches(" = ").count(), Settings::KEYS.len());
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    // Neither bound of the interval may move alone.
    let good = "frequency = 55\nrestitution_low = 0.4\nrestitution_high = 0.5\n";
    write("good.toml", good);
    let imported = on_flash(&folder, "settings import good.toml --save");
    imported.prints(&["3 settings in the file, 3 changed"]);
    let changed = flash(&folder);
    for (text, expected) in [
        (
            "frequency = 60\nrestitution_high = 0.1\n",
            ["bad.toml", "restitution_high", "reversed"],
        ),
        (
            "frequency = 60\nresonanse = 60\n",
            ["bad.toml", "resonanse", "did you mean resonance?"],
        ),
        ("frequency = nan\n", ["frequency", "NaN", "5..500 Hz"]),
    ] {
        write("bad.toml", text);
        on_flash(&folder, "settings import bad.toml --save").refused(&expected);
        assert_eq!(flash(&folder), changed, "{text}");
    }
    // An import of the exported file restores all settings.
    on_flash(&folder, "settings import all.toml --save").prints(&["3 changed"]);
    on_flash(&folder, "settings export again.toml").done();
    assert_eq!(text(&folder, "again.toml"), all);
}

#[test]
fn recipes_are_saved_used_exported_and_imported() {
    let folder = folder();
    let recipe = |args: &str| on_flash(&folder, &format!("recipe {args}"));
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    // Recipes are saved together with the settings, and a new board has no saved settings.
    recipe("save 1 caps").refused(&["no saved settings", "kband settings save"]);
    on_flash(&folder, "settings set restitution_high 0.31 --save").done();
    on_flash(&folder, "target k 0.5 --save").done();
    recipe("save 1 caps").prints(&["k = 0.5"]);
    let list = recipe("list --format json").json();
    let list = list.as_array().unwrap();
    assert_eq!(list.len(), 1);
    assert_eq!(list[0]["name"], "caps");
    assert_eq!(list[0]["settings"][1]["value"], 0.31);
    assert_eq!(list[0]["in_use"], false);
    // The settings are unchanged.
    let args = "settings get restitution_high --format json";
    assert_eq!(on_flash(&folder, args).json()[0]["value"], 0.31);
    recipe("export all.toml").done();
    let second = text(&folder, "all.toml").replace("number = 1", "number = 7");
    let second = second.replace("caps", "M3 screws");
    let second = second.replace("value = 0.5", "value = 0.41");
    write("second.toml", &second);
    recipe("import second.toml").prints(&["saved 1 recipes"]);
    let before = flash(&folder);
    let cut = &second[..second.len() - 120];
    // Each value is within its range, but the drive does not reach the amplitude.
    let k = "target = \"k\"\nvalue = 0.41";
    let far = second.replace(k, "target = \"mm\"\nvalue = 1.5");
    for (bad, expected) in [
        (cut, ["bad.toml", "line ", "next:"]),
        (&far[..], ["line 9", "1.5", "accepted"]),
    ] {
        write("bad.toml", bad);
        recipe("import bad.toml").refused(&expected);
        assert_eq!(flash(&folder), before, "{bad}");
    }
    recipe("use 3").refused(&["no such recipe", "kband recipe list"]);
    recipe("use 8").refused(&["8", "0..=7"]);
    recipe("use 7").prints(&["k = 0.41"]);
    recipe("delete 1").done();
    recipe("delete 1").refused(&["no recipe 1", "kband recipe list"]);
    let list = recipe("list --format json").json();
    assert_eq!(list.as_array().unwrap().len(), 1);
    assert_eq!(list[0]["name"], "M3 screws");
    // A locked board keeps its recipes.
    on_flash(&folder, "settings save").done();
    recipe("list").prints(&["M3 screws"]);
    on_flash(&folder, "lock 4711").done();
    let before = flash(&folder);
    recipe("delete 7").refused(&["locked by a PIN", "kband unlock"]);
    recipe("import second.toml").refused(&["locked by a PIN"]);
    assert_eq!(flash(&folder), before);
}

#[test]
fn a_board_is_monitored_recorded_and_replayed() {
    let folder = folder();
    let args = "monitor --every 5 --format json --record run.kband --rows 6";
    let now = kband(&folder, args).done();
    let rows = now
        .lines()
        .skip(1)
        .map(|line| serde_json::from_str(line).unwrap());
    let rows: Vec<Value> = rows.collect();
    let cycles = rows
        .iter()
        .filter(|row| row["k"].is_number() || row["state"].is_string());
    let cycles: Vec<u64> = cycles.map(|row| row["cycle"].as_u64().unwrap()).collect();
    assert_eq!(cycles.len(), 6, "{now}");
    let mut pairs = cycles.windows(2);
    assert!(pairs.all(|pair| pair[1] == pair[0] + 5), "{cycles:?}");
    assert!(rows.iter().any(|row| row["event"] == "started"), "{now}");
    // The record contains the printed cycles, and those that arrived while the recording ended.
    let replayed = run(&folder, "monitor --replay run.kband --format json", &[]).done();
    let replayed: Vec<&str> = replayed.lines().collect();
    for row in now.lines().skip(1) {
        assert!(replayed.contains(&row), "{now}{replayed:#?}");
    }
    let csv = run(&folder, "monitor --replay run.kband --format csv", &[]).done();
    let csv = outcome::stripped(&csv);
    assert!(csv.starts_with("time (s),cycle,state,k,b (mm),"), "{csv}");
    run(&folder, "monitor --replay run.kband", &[]).prints(&["starting"]);
    let args = "monitor --record run.kband --duration 1";
    kband(&folder, args).refused(&["run.kband", "exists", "never overwritten"]);
}

#[test]
fn an_identification_that_has_no_result_yet_changes_nothing() {
    let folder = folder();
    on_flash(&folder, "settings save").done();
    let saved = flash(&folder);
    let outcome = on_flash(&folder, "settings commission --within 2");
    outcome.refused(&["after 2 s", "no result", "--within"]);
    assert_eq!(flash(&folder), saved);
}

fn stored(folder: &TempDir) -> impl Fn(&str) -> f64 {
    let all = on_flash(folder, "settings list --format json").json();
    move |key| {
        let mut settings = all.as_array().unwrap().iter();
        let own = settings.find(|setting| setting["key"] == key).unwrap();
        own["value"].as_f64().unwrap()
    }
}

/// The emulated drive has one resonance: 1 mm and Q 25 at 50 Hz. At n times 50 Hz its response is
/// `1 mm / 25 / (n^2 - 1)`, opposite in phase to the output, unlike the configured one.
#[test]
fn the_drive_response_at_multiples_is_measured_and_saved() {
    let folder = folder();
    let configured = "second_tone = 0.05\nthird_tone = 0.02\nsecond_gain = 0.02\nsecond_lag = 150.0\n\
                third_gain = 0.0065\nthird_lag = 160.0\n";
    std::fs::write(folder.path().join("told.toml"), configured).unwrap();
    on_flash(&folder, "settings import told.toml --save").done();
    for (tone, answer, exact) in [("second", 0.04 / 3.0, 0.03), ("third", 0.04 / 8.0, 0.05)] {
        let args = format!("settings commission --{tone}-tone --apply --within 50 --format json");
        let result = on_flash(&folder, &args).json();
        assert_eq!(result["applied"], true, "{result}");
        let stored = stored(&folder);
        let [gain, lag] = ["gain", "lag"].map(|what| stored(&format!("{tone}_{what}")));
        assert!(
            (gain / answer - 1.0).abs() < exact,
            "{tone}: {gain} {result}"
        );
        let late = (lag.rem_euclid(360.0) - 180.0).abs();
        assert!(late < 60.0 * exact, "{tone}: {lag} {result}");
    }
}

/// The emulated sensor measures no gravity; the emulated drive has the default parameters.
#[test]
fn the_tests_of_the_sensor_are_commissioned_and_passed() {
    let folder = folder();
    for change in ["gain 0.8", "current_sensitivity 0.3"] {
        on_flash(&folder, &format!("settings set {change} --save")).done();
    }
    on_flash(&folder, "settings commission --sensor").refused(&["0 mm", "kband target gear 1"]);
    on_flash(&folder, "target order 1 --save").done();
    let args = "settings commission --sensor --apply --within 100 --format json";
    let result = on_flash(&folder, args).json();
    assert_eq!(result["applied"], true, "{result}");
    let stored = stored(&folder);
    assert!((stored("sensor_rest") - 1.65).abs() < 1e-3, "{result}");
    assert!((stored("gain") - 1.0).abs() < 0.03, "{result}");
    assert!((stored("current_gain") - 0.5).abs() < 0.015, "{result}");
    assert!((1.3..1.4).contains(&stored("gain_tolerance")), "{result}");
    assert!((1.3..2.0).contains(&stored("load_tolerance")), "{result}");
    // The next start passes its tests. Without --apply no setting changes.
    let outcome = on_flash(&folder, "settings commission --sensor --within 100");
    outcome.prints(&["set gain_tolerance", "set current_gain 0."]);
}

/// An emulated board at a pseudo-terminal that keeps running between commands.
struct EmulatedBoard(Terminal);

impl EmulatedBoard {
    fn start() -> Self {
        let image = outcome::image();
        Self(Terminal::start(image.as_ref(), "run", BOARD_TIMEOUT))
    }

    fn port(&self) -> &str {
        self.0.port().to_str().unwrap()
    }

    fn query(&self, args: &str) -> Value {
        run(folder(), args, &["--on", self.port(), "--format", "json"]).json()
    }

    /// Waits for a status with this property.
    fn wait(&self, has: impl Fn(&Value) -> bool) -> Value {
        let end = Instant::now() + STATUS_TIMEOUT;
        loop {
            let now = self.query("status");
            if has(&now) {
                return now;
            }
            assert!(Instant::now() < end, "{now}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

#[cfg(unix)]
#[test]
fn a_board_gets_targets_and_enable_and_reports_status() {
    let board = EmulatedBoard::start();
    // The first cycle has ended.
    let now = board.wait(|now| now["enable_input"] == true);
    assert_eq!(now["enable_desk"], true, "{now}");
    assert_eq!(now["alarms"]["supply_low"], false, "{now}");
    assert!(now["next"].as_str().unwrap().len() > 10, "{now}");
    let held = board.query("target mm 0.15");
    assert_eq!(held["target"], "amplitude 0.15 mm");
    let held = board.query("target gear 2");
    assert_eq!(held["target"], "gear of order 2");
    let off = board.query("disable");
    assert_eq!(off["state"], "off", "{off}");
    assert_eq!(off["enable_desk"], false, "{off}");
    let next = off["next"].as_str().unwrap();
    assert!(next.contains("kband enable"), "{off}");
    board.query("target mm 0.15");
    let on = board.query("enable");
    assert_eq!(on["enable_desk"], true, "{on}");
    board.wait(|now| {
        let amplitude = now["b"].as_f64().unwrap();
        now["state"] == "holding" && now["ready"] == true && (amplitude - 0.15).abs() < 0.005
    });
    let folder = folder();
    let saved = run(&folder, "target mm 0.2 --save", &["--on", board.port()]);
    saved.refused(&["is running its drive", "kband disable"]);
    assert_eq!(board.query("status")["target"], "amplitude 0.15 mm");
}

#[cfg(unix)]
#[test]
fn commissioning_writes_a_record_with_settings_and_pictures() {
    use kband_machines::browser::Browser;
    let board = EmulatedBoard::start();
    let folder = folder();
    let on = ["--on", board.port()];
    let step = |args: &[&str]| {
        let begin = ["commission", "record.html", "--seconds", "1"];
        outcome::run(&folder, TIMEOUT, &[&begin[..], args, &on].concat()).done()
    };
    step(&["--step", "as found"]);
    board.query("disable");
    board.query("settings set scatter 0.07");
    board.query("settings set soft_start 0.5");
    board.query("target mm 0.15");
    board.query("enable");
    board.wait(|now| now["ready"] == true);
    let printed = step(&["--step", "drive", "--note", "empty <track>"]);
    assert!(printed.contains("amplitude 0.15 mm"), "{printed}");
    let file = folder.path().join("record.html");
    let browser = Browser::start();
    browser.open(&file);
    assert_eq!(browser.errors(), [""; 0]);
    let tables = browser
        .script("return [...document.querySelectorAll('table')].map((table) => table.innerText)");
    let settings = tables[0].as_str().unwrap();
    assert_eq!(settings.lines().count(), 3, "{settings}");
    for begin in ["\nscatter\t0.05\t0.07", "\nsoft_start\t0.4\t0.5\ts"] {
        assert!(settings.contains(begin), "{settings}");
    }
    let readings = tables[2].as_str().unwrap();
    for expected in ["as found", "holding"] {
        assert!(readings.contains(expected), "{readings}");
    }
    let plots = browser.script("return document.querySelectorAll('.plot svg').length");
    assert_eq!(plots, 4);
    assert!(browser.text("main").contains("empty <track>"));
    // Only an HTML page that kband wrote is read as a record. The record also exists as JSON.
    std::fs::write(folder.path().join("other.html"), "<!doctype html>").unwrap();
    let other = run(&folder, "commission other.html --step a", &on);
    other.refused(&["is no record", "another name"]);
    let more = ["--step", "as left", "--on", board.port()];
    run(&folder, "commission record.json --seconds 1", &more).done();
    let record: Value = serde_json::from_str(&text(&folder, "record.json")).unwrap();
    let last = &record["commissioning"][0];
    assert_eq!(last["settings"]["scatter"]["value"], 0.07);
    let rows = last["telemetry"].as_array().unwrap();
    let end = rows.last().unwrap();
    assert_eq!(end["state"], "holding", "{last}");
    // One second of the board's time, however slowly it passes.
    assert!(end["time"].as_f64().unwrap() >= 1.0, "{last}");
}

/// Runs `kband` on a pseudo-terminal whose other end sends these bytes repeatedly.
#[cfg(unix)]
fn run_on_sending_port(args: &str, bytes: &[u8]) -> Outcome {
    use std::sync::atomic::{AtomicBool, Ordering};
    let (mut far, near, name) = outcome::port();
    let done = AtomicBool::new(false);
    let folder = folder();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // A full terminal without a reader loses further bytes, as a wire does.
            let _near = near;
            for _ in 0..200 {
                if done.load(Ordering::Relaxed) || far.write_all(bytes).is_err() {
                    break;
                }
                std::thread::sleep(Duration::from_millis(100));
            }
        });
        let outcome = run(&folder, args, &["--on", &name]);
        done.store(true, Ordering::Relaxed);
        outcome
    })
}

fn identity(sequence: u8, schema: u32, image: &str) -> Vec<u8> {
    let identity = Identity {
        version: VERSION,
        schema,
        image,
    };
    let mut buffer = [0; MAX_FRAME_BYTES];
    let frame = write_identity(&mut buffer, sequence, &identity);
    frame.unwrap().to_vec()
}

/// A board after measuring its parts: settings and target, saved ones, and whether it runs.
#[cfg(unix)]
struct Commissioned {
    settings: Settings,
    target: Target,
    saved: Option<(Settings, Target)>,
    running: bool,
}

#[cfg(unix)]
impl Commissioned {
    /// Answers requests at the far end of a port until the port is closed.
    fn serve(&mut self, far: &mut File) {
        let mut receiver = Receiver::new();
        let mut byte = [0];
        while matches!(far.read(&mut byte), Ok(1)) {
            let Some(Ok(frame)) = receiver.push(byte[0]) else {
                continue;
            };
            let answers = match read_request(frame).unwrap() {
                (sequence, Incoming::Identity) => identity(sequence, SCHEMA, "0.1.0+stand-in"),
                (_, Incoming::Update(_)) => panic!("no update here"),
                (sequence, Incoming::Request(request)) => self.answer(sequence, &request),
            };
            if far.write_all(&answers).is_err() {
                return;
            }
        }
    }

    fn answer(&mut self, sequence: u8, request: &Request) -> Vec<u8> {
        let mut response = Response::Done;
        match *request {
            Request::Setting(number) => {
                let keys = Settings::KEYS.iter().zip(self.settings.values());
                let setting = |(key, value): (&Key, f32)| Setting {
                    number,
                    key: key.name,
                    unit: key.unit,
                    value,
                    low: key.low,
                    high: key.high,
                    default: key.default,
                };
                let setting = keys.map(setting).nth(number.into());
                let unknown = Response::Refused(Refusal::Unknown);
                response = setting.map_or(unknown, Response::Setting);
            }
            // As on the real board, no setting changes while the drive runs.
            Request::Set { .. } | Request::Save if self.running => {
                response = Response::Refused(Refusal::Running);
            }
            Request::Set { key, value } => self.settings.set(key, value).unwrap(),
            Request::Save => self.saved = Some((self.settings, self.target)),
            Request::Held => response = Response::Held(self.target),
            Request::Target(target) => self.target = target,
            Request::Enable(enable) => self.running = enable,
            Request::Identification => {
                response = Response::Identification(Identification::Found(Identified {
                    restitution: 0.31,
                    deviation: 0.004,
                    k: 0.5,
                    scatter: 0.0,
                    hops: 64,
                }));
            }
            _ => {}
        }
        let mut buffer = [0; MAX_FRAME_BYTES];
        let response = write_response(&mut buffer, sequence, &response);
        let mut answers = response.unwrap().to_vec();
        if let Request::Telemetry(1) = request {
            let state = if self.running {
                State::Holding
            } else {
                State::Off
            };
            let telemetry = Telemetry {
                state: state.number(),
                ..Telemetry::default()
            };
            let row = write_response(&mut buffer, 0, &Response::Telemetry(telemetry));
            answers.extend_from_slice(row.unwrap());
        }
        answers
    }
}

#[cfg(unix)]
#[test]
fn commissioning_saves_its_result_with_the_old_target() {
    let target = Target::Speed(60.0);
    for apply in [false, true] {
        let (mut far, near, name) = outcome::port();
        let mut board = Commissioned {
            settings: Settings::default(),
            target,
            saved: None,
            running: true,
        };
        let folder = folder();
        let args = "settings commission --format json --within 20";
        let more = ["--on", &name, "--apply"];
        let outcome = std::thread::scope(|scope| {
            scope.spawn(|| board.serve(&mut far));
            let outcome = run(&folder, args, &more[..2 + usize::from(apply)]);
            // Closing the last near end stops the reader at the far end.
            drop(near);
            outcome
        });
        assert_eq!(outcome.json()["applied"], apply);
        assert!(board.running);
        assert_eq!(board.target, target);
        let mut expected = Settings::default();
        if apply {
            (expected.restitution_low, expected.restitution_high) = (0.29, 0.33);
        }
        let saved = apply.then_some((expected, target));
        assert_eq!(board.saved, saved, "--apply saves them");
        assert_eq!(board.settings, expected);
    }
}

#[cfg(unix)]
#[test]
fn garbage_and_another_version_give_different_messages() {
    // Causes: a wrong baud rate, or a device of another program.
    let args = "settings list";
    let garbage = run_on_sending_port(args, b"\x80\x7f\0\xf8\x06\0");
    garbage.refused(&["unreadable frames", "115200 baud", "next:"]);
    let frame = identity(0, 0x0bad_cafe, "0.0.9+old");
    run_on_sending_port(args, &frame).refused(&["0.0.9+old", "0badcafe", "kband flash"]);
    // Any board answers an identity request.
    let outcome = run_on_sending_port("identify --format json", &frame).ended(1);
    let board: Value = serde_json::from_str(&outcome.out).unwrap();
    assert_eq!(board["image"], "0.0.9+old");
    assert_eq!(board["fits_this_desk"], false);
}
