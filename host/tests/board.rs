//! The verbs of the board against the firmware on the emulated CPU.

mod came;

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::time::Duration;

use came::Came;
use kband_control::wire::{
    Identity, Incoming, MAX_FRAME_BYTES, Receiver, Refusal, Request, Response, SCHEMA, Setting,
    Telemetry, VERSION, read_request, write_identity, write_response,
};
use kband_control::{Identification, Identified, Settings, State, Target};
use kband_host::provenance;
use kband_machines::emulator::Machine;
use kband_machines::images;
use kband_machines::terminal::Terminal;
use serde_json::Value;

/// Wall-clock seconds for one command, a loaded machine allowed for.
const LIMIT: &str = "60";

/// Runs `kband` in `folder` on the emulated board; killed at the limit.
fn kband(folder: impl AsRef<Path>, words: &str) -> Came {
    kband_with(folder, words, &[])
}

/// The same board, whose settings outlast the command.
fn on_flash(folder: impl AsRef<Path>, words: &str) -> Came {
    kband_with(folder, words, &["--flash-image", "board.flash"])
}

fn kband_with(folder: impl AsRef<Path>, words: &str, more: &[&str]) -> Came {
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let board = ["--on", "qemu", "--image", image.to_str().unwrap()];
    run(folder, words, &[&board[..], more].concat())
}

/// Runs `kband` in `folder`; killed at the limit.
fn run(folder: impl AsRef<Path>, words: &str, more: &[&str]) -> Came {
    let words: Vec<&str> = words.split(' ').chain(more.iter().copied()).collect();
    came::run(folder, LIMIT, &words)
}

#[test]
fn an_image_is_checked_without_a_probe() {
    let folder = folder();
    let words = "flash --dry-run --format json";
    let (package, bin, machine) = ("kband-firmware", "feeder", Machine::CortexM4F);
    let nucleo = images::build_with(package, bin, machine, "stm32g474re");
    let plan = run(&folder, words, &[nucleo.to_str().unwrap()]).done();
    let plan: Value = serde_json::from_str(&plan).unwrap();
    assert_eq!(plan["chip"], "STM32G474RE");
    let last = plan["sectors"].as_array().unwrap().last().unwrap();
    assert_eq!(last["what"], "settings and faults, kept");
    assert_eq!(last["sectors"], serde_json::json!([252, 255]));
    let image = images::build(package, bin, machine);
    let plan = run(&folder, words, &[image.to_str().unwrap()]).done();
    let plan: Value = serde_json::from_str(&plan).unwrap();
    let sectors = plan["sectors"].as_array().unwrap();
    let bytes: u64 = sectors
        .iter()
        .map(|sector| sector["image_size"].as_u64().unwrap())
        .sum();
    assert_eq!(Some(bytes), plan["flash_used"].as_u64());
    assert!(
        bytes > 100_000 && plan["ram_used"].as_u64().unwrap() > 32 * 1024,
        "{plan}"
    );
    assert_eq!(plan["written"], false);
    assert_eq!(plan["chip"], "STM32F405RG");
    let kept = &sectors[1];
    assert_eq!(kept["what"], "settings and faults, kept");
    assert_eq!(kept["sectors"], serde_json::json!([1, 4]));
    assert_eq!(plan["option_bytes"], Value::Null);
    // Other option bytes to set are listed; those that cannot be set are refused.
    let asked = ["--option-bytes", image.to_str().unwrap()];
    let plan = run(&folder, words, &asked).done();
    assert!(plan.contains("brown-out reset at level 3"), "{plan}");
    let words = "flash --dry-run";
    let emulated = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let desk = env!("CARGO_BIN_EXE_kband");
    std::fs::write(
        folder.path().join("short"),
        &std::fs::read(&image).unwrap()[..5000],
    )
    .unwrap();
    std::fs::write(folder.path().join("words"), "no image").unwrap();
    for (image, expected) in [
        (
            emulated.to_str().unwrap(),
            ["emulated board", "cargo feeder"],
        ),
        (desk, ["64 bits", "cargo feeder"]),
        ("short", ["short", "cargo feeder"]),
        ("words", ["no ELF", "cargo feeder"]),
        ("none", ["none", "cargo feeder"]),
    ] {
        run(&folder, words, &[image]).refused(&expected);
    }
    // Built without its way to a probe, or with it and no probe here.
    let came = run(&folder, "flash", &[image.to_str().unwrap()]);
    let expected = if cfg!(feature = "flash") {
        "no debug probe"
    } else {
        "--features flash"
    };
    came.refused(&[expected, "next:"]);
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

#[test]
fn the_board_says_who_and_how_it_is() {
    let folder = folder();
    let board = kband(&folder, "identify --format json").json();
    assert_eq!(
        board["schema"],
        format!("{:08x}", kband_control::wire::SCHEMA)
    );
    assert_eq!(board["fits_this_desk"], true);
    assert_eq!(board["self_test"]["sensor"], true);
    assert_eq!(board["self_test"]["settings"], "never saved");
    assert!(
        board["self_test"]["stack_free"].as_u64().unwrap() > 1000,
        "{board}"
    );
    assert_eq!(board["last_words"], Value::Null);
}

#[test]
fn a_saved_change_of_settings_outlasts_a_restart() {
    let folder = folder();
    let list = kband(&folder, "settings list --format json").json();
    let list = list.as_array().unwrap();
    assert_eq!(list.len(), kband_control::Settings::KEYS.len());
    for (row, key) in list.iter().zip(kband_control::Settings::KEYS) {
        assert_eq!(
            (row["key"].as_str(), row["unit"].as_str()),
            (Some(key.name), Some(key.unit))
        );
        for (name, value) in [("value", key.default), ("low", key.low), ("high", key.high)] {
            assert_eq!(
                row[name].as_f64().map(|value| value as f32),
                Some(value),
                "{row}"
            );
        }
    }
    on_flash(&folder, "settings set restitution_high 0.31").says("--save");
    let value = |key: &str| {
        on_flash(&folder, &format!("settings get {key} --format json")).json()[0]["value"].as_f64()
    };
    assert_eq!(value("restitution_high"), Some(0.22));
    on_flash(&folder, "settings set restitution_high 0.31 --save").says("saved: ");
    on_flash(&folder, "settings set incline -2.5 --save").done();
    assert_eq!(value("restitution_high"), Some(0.31));
    assert_eq!(value("incline"), Some(-2.5));
}

#[test]
fn a_file_of_settings_is_taken_whole_or_not_at_all() {
    let folder = folder();
    on_flash(&folder, "settings export all.toml").done();
    let all = std::fs::read_to_string(folder.path().join("all.toml")).unwrap();
    assert_eq!(
        all.matches(" = ").count(),
        kband_control::Settings::KEYS.len()
    );
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    // Neither bound of the interval may move alone.
    write(
        "good.toml",
        "frequency = 55\nrestitution_low = 0.4\nrestitution_high = 0.5\n",
    );
    on_flash(&folder, "settings import good.toml --save").says("3 settings in the file, 3 changed");
    let changed = std::fs::read(folder.path().join("board.flash")).unwrap();
    for (text, expected) in [
        (
            "frequency = 60\nincline = 61\n",
            ["bad.toml", "incline", "-60..60 degrees"],
        ),
        (
            "frequency = 60\nrestitution_high = 0.1\n",
            ["bad.toml", "restitution_high", "reversed"],
        ),
        (
            "frequency = 60\nresonanse = 60\n",
            ["bad.toml", "resonanse", "did you mean resonance?"],
        ),
        ("frequency = 60\ngain", ["bad.toml", "line 2", "next:"]),
        ("frequency = nan\n", ["frequency", "NaN", "5..500 Hz"]),
    ] {
        write("bad.toml", text);
        on_flash(&folder, "settings import bad.toml --save").refused(&expected);
        assert_eq!(
            std::fs::read(folder.path().join("board.flash")).unwrap(),
            changed,
            "{text}"
        );
    }
    // What was exported brings all of it back.
    on_flash(&folder, "settings import all.toml --save").says("3 changed");
    on_flash(&folder, "settings export again.toml").done();
    assert_eq!(
        std::fs::read_to_string(folder.path().join("again.toml")).unwrap(),
        all
    );
}

#[test]
fn recipes_are_saved_used_exported_and_imported() {
    let folder = folder();
    let recipe = |words: &str| on_flash(&folder, &format!("recipe {words}"));
    let flash = || std::fs::read(folder.path().join("board.flash")).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    // They are saved with settings, which a new board does not have.
    recipe("save 1 caps").refused(&["no saved settings", "kband settings save"]);
    on_flash(&folder, "settings set restitution_high 0.31 --save").done();
    on_flash(&folder, "target k 0.5 --save").done();
    recipe("save 1 caps").says("k = 0.5");
    let list = recipe("list --format json").json();
    let list = list.as_array().unwrap();
    assert_eq!(list.len(), 1);
    assert_eq!(list[0]["name"], "caps");
    assert_eq!(list[0]["settings"][1]["value"], 0.31);
    assert_eq!(list[0]["in_use"], false);
    // The settings are as they were.
    let words = "settings get restitution_high --format json";
    assert_eq!(on_flash(&folder, words).json()[0]["value"], 0.31);
    recipe("export all.toml").done();
    let text = std::fs::read_to_string(folder.path().join("all.toml")).unwrap();
    let second = text
        .replace("number = 1", "number = 7")
        .replace("caps", "M3 screws");
    let second = second.replace("value = 0.5", "value = 0.41");
    write("second.toml", &second);
    recipe("import second.toml").says("saved 1 recipes");
    let before = flash();
    let cut = &second[..second.len() - 120];
    let few = second.replace("recipes = 1", "recipes = 2");
    let scatter = second.replace("scatter = 0.05", "scatter = 0.5");
    // Each value is in its range; the machine does not reach the amplitude.
    let far = second.replace(
        "target = \"k\"\nvalue = 0.41",
        "target = \"mm\"\nvalue = 1.5",
    );
    for (bad, expected) in [
        (cut, ["bad.toml", "line ", "next:"]),
        (&few[..], ["line ", "recipes", "2"]),
        (&scatter[..], ["line ", "scatter = 0.5", "0.0..0.3"]),
        (&far[..], ["line 9", "1.5", "accepted"]),
    ] {
        write("bad.toml", bad);
        recipe("import bad.toml").refused(&expected);
        assert_eq!(flash(), before, "{bad}");
    }
    recipe("use 3").refused(&["no such recipe", "kband recipe list"]);
    recipe("use 8").refused(&["8", "0..=7"]);
    recipe("use 7").says("k = 0.41");
    recipe("delete 1").done();
    recipe("delete 1").refused(&["no recipe 1", "kband recipe list"]);
    let list = recipe("list --format json").json();
    assert_eq!(list.as_array().unwrap().len(), 1);
    assert_eq!(list[0]["name"], "M3 screws");
    // A locked board keeps them.
    on_flash(&folder, "settings save").done();
    assert_eq!(
        recipe("list --format json")
            .json()
            .as_array()
            .unwrap()
            .len(),
        1
    );
    on_flash(&folder, "lock 4711").done();
    let before = flash();
    recipe("delete 7").refused(&["locked by a PIN", "kband unlock"]);
    recipe("import second.toml").refused(&["locked by a PIN"]);
    assert_eq!(flash(), before);
}

#[test]
fn a_refusal_names_cause_range_and_next_step() {
    let folder = folder();
    std::fs::write(folder.path().join("words"), "no flash").unwrap();
    for (words, expected) in [
        (
            "settings get freqency",
            ["freqency", "did you mean frequency?"],
        ),
        ("settings set frequency 4", ["frequency = 4", "5..500 Hz"]),
        ("settings set frequency fast", ["fast", "accepted"]),
        (
            "settings set restitution_low 0.5",
            ["restitution_high", "import"],
        ),
        ("settings save", ["no flash", "--flash-image"]),
        ("settings import none.toml", ["none.toml", "next:"]),
        ("settings export none/all.toml", ["none", "mkdir"]),
        ("settings list --flash-image words", ["words", "four pages"]),
    ] {
        kband(&folder, words).refused(&expected);
    }
    let mut names: Vec<_> = std::fs::read_dir(&folder)
        .unwrap()
        .flatten()
        .map(|entry| entry.file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["words"]);
}

#[test]
fn a_board_is_monitored_recorded_and_replayed() {
    let folder = folder();
    let words = "monitor --every 5 --format json --record run.kband --rows 6";
    let now = kband(&folder, words).done();
    let rows: Vec<Value> = now
        .lines()
        .skip(1)
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let cycles: Vec<u64> = rows
        .iter()
        .filter(|row| row["k"].is_number() || row["state"].is_string())
        .map(|row| row["cycle"].as_u64().unwrap())
        .collect();
    assert_eq!(cycles.len(), 6, "{now}");
    assert!(
        cycles.windows(2).all(|pair| pair[1] == pair[0] + 5),
        "{cycles:?}"
    );
    assert!(rows.iter().any(|row| row["event"] == "started"), "{now}");
    // The record has what was printed, and the cycles that came while it ended.
    let replayed = run(&folder, "monitor --replay run.kband --format json", &[]).done();
    let replayed: Vec<&str> = replayed.lines().collect();
    assert!(
        now.lines().skip(1).all(|row| replayed.contains(&row)),
        "{now}{replayed:#?}"
    );
    let csv = run(&folder, "monitor --replay run.kband --format csv", &[]).done();
    assert!(
        provenance::stripped(&csv).starts_with("time (s),cycle,state,k,b (mm),"),
        "{csv}"
    );
    run(&folder, "monitor --replay run.kband", &[]).says("starting");

    let words = "monitor --record run.kband --duration 1";
    kband(&folder, words).refused(&["run.kband", "is there already", "next:"]);
    std::fs::write(folder.path().join("other.kband"), "no record\0\0\0").unwrap();
    let words = "monitor --replay other.kband";
    run(&folder, words, &[]).refused(&["other.kband", "no record", "--record"]);
    run(&folder, "monitor --replay none.kband", &[]).refused(&["none.kband", "--record"]);
}

#[test]
fn an_identification_that_has_no_result_yet_changes_nothing() {
    let folder = folder();
    let flash = || std::fs::read(folder.path().join("board.flash")).unwrap();
    on_flash(&folder, "settings save").done();
    let saved = flash();
    let words = "settings commission --within 2";
    on_flash(&folder, words).refused(&["after 2 s", "no result", "--within"]);
    let words = "settings commission --apply --within 2";
    kband(&folder, words).refused(&["no flash", "--flash-image"]);
    assert_eq!(flash(), saved);
}

/// The settings by key, beyond a loss of power.
fn kept(folder: &tempfile::TempDir) -> impl Fn(&str) -> f64 {
    let all = on_flash(folder, "settings list --format json").json();
    move |key| {
        let mut settings = all.as_array().unwrap().iter();
        let own = settings.find(|setting| setting["key"] == key).unwrap();
        own["value"].as_f64().unwrap()
    }
}

/// The emulated board's drive is one resonance of 1 mm and Q 25 at 50 Hz, which answers at n times
/// its frequency with `1 mm / 25 / (n^2 - 1)` against the output; told is another drive.
#[test]
fn the_drive_response_at_multiples_is_measured_and_saved() {
    let folder = folder();
    let told = "second_tone = 0.05\nthird_tone = 0.02\nsecond_gain = 0.02\nsecond_lag = 150.0\n\
                third_gain = 0.0065\nthird_lag = 160.0\n";
    std::fs::write(folder.path().join("told.toml"), told).unwrap();
    on_flash(&folder, "settings import told.toml --save").done();
    for (option, gain, lag, answer, exact) in [
        (
            "--second-tone",
            "second_gain",
            "second_lag",
            0.04 / 3.0,
            0.03,
        ),
        ("--third-tone", "third_gain", "third_lag", 0.04 / 8.0, 0.05),
    ] {
        let words = format!("settings commission {option} --apply --within 50 --format json");
        let found: Value = serde_json::from_str(&on_flash(&folder, &words).done()).unwrap();
        assert_eq!(found["applied"], true, "{found}");
        let kept = kept(&folder);
        let (measured, late) = (kept(gain), kept(lag));
        assert!(
            (measured / answer - 1.0).abs() < exact,
            "{option}: {measured} {found}"
        );
        assert!(
            (late.rem_euclid(360.0) - 180.0).abs() < 60.0 * exact,
            "{option}: {late} {found}"
        );
    }
    // A third tone needs a second one, and a board that affords none has none to measure.
    kband(&folder, "settings commission --third-tone").refused(&[
        "third_tone = 0",
        "0.01..0.5",
        "settings set third_tone",
    ]);
    let words = "settings set third_tone 0.05 --save --flash-image other.flash";
    kband(&folder, words).refused(&["third_tone", "set second_tone first"]);
}

/// The emulated board's sensor sees nothing of gravity, and its drive is as the default settings say.
#[test]
fn the_tests_of_the_sensor_are_commissioned_and_passed() {
    let folder = folder();
    for change in ["gain 0.8", "current_sensitivity 0.3"] {
        on_flash(&folder, &format!("settings set {change} --save")).done();
    }
    on_flash(&folder, "settings commission --sensor").refused(&["0 mm", "kband target gear 1"]);
    on_flash(&folder, "target order 1 --save").done();
    let words = "settings commission --sensor --apply --within 100 --format json";
    let found = on_flash(&folder, words).json();
    assert_eq!(found["applied"], true, "{found}");
    let kept = kept(&folder);
    assert!((kept("sensor_rest") - 1.65).abs() < 1e-3, "{found}");
    assert!((kept("gain") - 1.0).abs() < 0.03, "{found}");
    assert!((kept("current_gain") - 0.5).abs() < 0.015, "{found}");
    let tolerance = kept("gain_tolerance");
    assert!((1.3..1.4).contains(&tolerance), "{found}");
    let tolerance = kept("load_tolerance");
    assert!((1.3..2.0).contains(&tolerance), "{found}");
    // The next start passes its tests: without --apply nothing is changed, and it is measured again.
    let said = on_flash(&folder, "settings commission --sensor --within 100").done();
    assert!(said.contains("settings set gain_tolerance"), "{said}");
    assert!(said.contains("settings set current_gain 0."), "{said}");
    let words = "settings commission --sensor --second-tone";
    kband(&folder, words).refused(&["--sensor", "--second-tone"]);
}

/// An emulated board that runs on from command to command, at the end of a pseudo-terminal.
struct Standing(Terminal);

impl Standing {
    fn start() -> Self {
        let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
        Self(Terminal::start(&image, "run", Duration::from_secs(300)))
    }

    fn port(&self) -> &str {
        self.0.port().to_str().unwrap()
    }

    fn ask(&self, words: &str) -> Value {
        run(folder(), words, &["--on", self.port(), "--format", "json"]).json()
    }
}

#[cfg(unix)]
#[test]
fn a_board_is_given_targets_and_its_enable_and_tells_how_it_is() {
    let board = Standing::start();
    // Its first cycle is to be over.
    let given = (0..50).any(|_| board.ask("status")["enable_input"] == true);
    assert!(given, "{}", board.ask("status"));
    let now = board.ask("status");
    assert_eq!(now["enable_desk"], true, "{now}");
    assert_eq!(now["alarms"]["supply_low"], false, "{now}");
    assert!(now["next"].as_str().unwrap().len() > 10, "{now}");
    let held = board.ask("target mm 0.15");
    assert_eq!(held["target"], "amplitude 0.15 mm");
    let held = board.ask("target gear 2");
    assert_eq!(held["target"], "gear of order 2");
    let off = board.ask("disable");
    assert_eq!(
        (&off["state"], &off["enable_desk"]),
        (&"off".into(), &false.into())
    );
    assert!(
        off["next"].as_str().unwrap().contains("kband enable"),
        "{off}"
    );
    board.ask("target mm 0.15");
    let on = board.ask("enable");
    assert_eq!(on["enable_desk"], true, "{on}");
    let reached = (0..50).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(100));
        let now = board.ask("status");
        let amplitude = now["b"].as_f64().unwrap();
        now["state"] == "holding" && now["ready"] == true && (amplitude - 0.15).abs() < 0.005
    });
    assert!(reached, "{}", board.ask("status"));
    let folder = folder();
    let refused = |words: &str, said: &[&str]| {
        run(&folder, words, &["--on", board.port()]).refused(said);
    };
    refused(
        "target mm",
        &["needs a number in mm", "kband target mm 0.23"],
    );
    refused("target gear 9", &["1..8", "next:"]);
    refused("target k -3", &["k", "accepted"]);
    refused(
        "target mm 0.2 --save",
        &["is running its drive", "kband disable"],
    );
    assert_eq!(board.ask("status")["target"], "amplitude 0.15 mm");
}

#[cfg(unix)]
#[test]
fn commissioning_writes_a_record_with_settings_and_pictures() {
    use kband_machines::browser::{Browser, keys};

    let board = Standing::start();
    let folder = folder();
    let on = ["--on", board.port()];
    let step = |words: &[&str]| {
        let begin = ["commission", "record.html", "--seconds", "1"];
        came::run(&folder, LIMIT, &[&begin[..], words, &on].concat()).done()
    };
    step(&["--step", "as found"]);
    board.ask("disable");
    board.ask("settings set scatter 0.07");
    board.ask("settings set soft_start 0.5");
    board.ask("target mm 0.15");
    board.ask("enable");
    let reached = (0..50).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(100));
        board.ask("status")["ready"] == true
    });
    assert!(reached, "{}", board.ask("status"));
    let said = step(&["--step", "drive", "--note", "empty <track>"]);
    assert!(said.contains("amplitude 0.15 mm"), "{said}");

    let file = folder.path().join("record.html");
    let browser = Browser::start();
    browser.open(&file);
    assert_eq!(browser.complaints(), [""; 0]);
    let tables = browser
        .script("return [...document.querySelectorAll('table')].map((table) => table.innerText)");
    let settings = tables[0].as_str().unwrap();
    let lines: Vec<&str> = settings.lines().collect();
    assert_eq!(lines.len(), 3, "{settings}");
    assert!(lines[1].starts_with("scatter\t0.05\t0.07"), "{settings}");
    assert!(
        lines[2].starts_with("soft_start\t0.4\t0.5\ts"),
        "{settings}"
    );
    let readings = tables[2].as_str().unwrap();
    assert!(
        readings.contains("as found") && readings.contains("holding"),
        "{readings}"
    );
    assert_eq!(
        browser.script("return document.querySelectorAll('.plot svg').length"),
        4
    );
    assert!(browser.text("main").contains("empty <track>"));
    // What the picture says is what the board held.
    browser.press("#amplitude-1 .plot", &keys::RIGHT.to_string());
    let reading = browser.text("#amplitude-1 .reading");
    let b: f64 = reading
        .split("b ")
        .nth(1)
        .unwrap()
        .split(' ')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert!(
        reading.contains("holding") && (b - 0.15).abs() < 0.005,
        "{reading}"
    );

    // In the other colours it is drawn anew.
    let background = "return getComputedStyle(document.body).backgroundColor";
    let first = browser.script(background);
    browser.click("#colours");
    assert_ne!(first, browser.script(background));
    assert_eq!(
        browser.script("return document.documentElement.dataset.failed ?? ''"),
        ""
    );

    // No other file is taken for a record, and it is also JSON.
    std::fs::write(folder.path().join("other.html"), "<!doctype html>").unwrap();
    let other = ["commission", "other.html", "--step", "a"];
    came::run(&folder, LIMIT, &[&other[..], &on].concat())
        .refused(&["is no record", "another name"]);
    let mut other = vec!["commission", "record.json", "--seconds", "1"];
    other.extend(["--step", "as left"].iter().chain(&on));
    came::run(&folder, LIMIT, &other).done();
    let record = std::fs::read_to_string(folder.path().join("record.json")).unwrap();
    let record: Value = serde_json::from_str(&record).unwrap();
    let last = &record["commissioning"][0];
    assert_eq!(last["settings"]["scatter"]["value"], 0.07);
    let rows = last["telemetry"].as_array().unwrap();
    assert!(
        rows.len() > 1 && rows.last().is_some_and(|row| row["state"] == "holding"),
        "{last}"
    );
}

/// Runs `kband` on a pseudo-terminal whose far end says these bytes again and again.
#[cfg(unix)]
fn on_a_port_that_says(words: &str, bytes: &[u8]) -> Came {
    use std::sync::atomic::{AtomicBool, Ordering};

    let (mut far, near, name) = came::port();
    let done = AtomicBool::new(false);
    let folder = folder();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // What a terminal that nobody reads does not take is lost, as on a wire.
            let _near = near;
            for _ in 0..200 {
                if done.load(Ordering::Relaxed) || far.write_all(bytes).is_err() {
                    break;
                }
                std::thread::sleep(std::time::Duration::from_millis(100));
            }
        });
        let came = run(&folder, words, &["--on", &name]);
        done.store(true, Ordering::Relaxed);
        came
    })
}

/// A frame with the identity of a board.
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

/// A board after it measured its parts: settings and target, those that it saved, and whether its
/// drive runs.
#[cfg(unix)]
struct Commissioned {
    settings: Vec<f32>,
    target: Target,
    saved: Option<(Vec<f32>, Target)>,
    running: bool,
}

#[cfg(unix)]
impl Commissioned {
    /// Answers what comes by the far end of a port until that is closed.
    fn serve(&mut self, far: &mut File) {
        let mut receiver = Receiver::new();
        let mut byte = [0];
        while matches!(far.read(&mut byte), Ok(1)) {
            let Some(Ok(frame)) = receiver.push(byte[0]) else {
                continue;
            };
            let answers = match read_request(frame).unwrap() {
                Incoming::Question { sequence } => identity(sequence, SCHEMA, "0.1.0+stand-in"),
                Incoming::Update { .. } => panic!("no update here"),
                Incoming::Request { sequence, request } => self.answer(sequence, &request),
            };
            if far.write_all(&answers).is_err() {
                return;
            }
        }
    }

    fn answer(&mut self, sequence: u8, request: &Request) -> Vec<u8> {
        let done = || Response::Done;
        let response = match *request {
            Request::Setting(number) => match Settings::KEYS.get(usize::from(number)) {
                Some(key) => Response::Setting(Setting {
                    number,
                    key: key.name,
                    unit: key.unit,
                    value: self.settings[usize::from(number)],
                    low: key.low,
                    high: key.high,
                    default: key.default,
                }),
                None => Response::Refused(Refusal::Unknown),
            },
            // As the board: no setting changes while the drive runs.
            Request::Set { .. } | Request::Save if self.running => {
                Response::Refused(Refusal::Running)
            }
            Request::Set { key, value } => {
                let place = Settings::KEYS.iter().position(|known| known.name == key);
                self.settings[place.unwrap()] = value;
                done()
            }
            Request::Save => {
                self.saved = Some((self.settings.clone(), self.target));
                done()
            }
            Request::Held => Response::Held(self.target),
            Request::Target(target) => {
                self.target = target;
                done()
            }
            Request::Enable(enable) => {
                self.running = enable;
                done()
            }
            Request::Identification => {
                Response::Identification(Identification::Found(Identified {
                    restitution: 0.31,
                    deviation: 0.004,
                    k: 0.5,
                    scatter: 0.0,
                    hops: 64,
                }))
            }
            _ => done(),
        };
        let mut buffer = [0; MAX_FRAME_BYTES];
        let response = write_response(&mut buffer, sequence, &response);
        let mut answers = response.unwrap().to_vec();
        if let Request::Telemetry(1) = request {
            let state = [State::Off, State::Holding][usize::from(self.running)].number();
            let telemetry = Telemetry {
                state,
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
    let before = Settings::default().values().to_vec();
    let target = Target::Speed(60.0);
    for apply in [false, true] {
        let (mut far, near, name) = came::port();
        let mut board = Commissioned {
            settings: before.clone(),
            target,
            saved: None,
            running: true,
        };
        let folder = folder();
        let words = "settings commission --format json --within 20";
        let words = words.to_string() + if apply { " --apply" } else { "" };
        let came = std::thread::scope(|scope| {
            scope.spawn(|| board.serve(&mut far));
            let came = run(&folder, &words, &["--on", &name]);
            // With its last near end the far one reads no more.
            drop(near);
            came
        });
        assert_eq!(came.json()["applied"], apply);
        assert!(board.running);
        assert_eq!(board.target, target);
        let found = Settings {
            restitution_low: 0.29,
            restitution_high: 0.33,
            ..Settings::default()
        };
        let saved = apply.then(|| (found.values().to_vec(), target));
        assert_eq!(board.saved, saved, "--apply saves them");
        assert!(apply || board.settings == before);
    }
}

#[cfg(unix)]
#[test]
fn garbage_and_another_version_give_different_messages() {
    // Another baud rate, or another program's device.
    let words = "settings list";
    on_a_port_that_says(words, b"\x80\x7f\0\xf8\x06\0").refused(&[
        "unreadable frames",
        "115200 baud",
        "next:",
    ]);
    let frame = &identity(0, 0x0bad_cafe, "0.0.9+old");
    on_a_port_that_says(words, frame).refused(&["0.0.9+old", "0badcafe", "kband flash"]);
    // Any board answers a request of its identity.
    let words = "identify --format json";
    let came = on_a_port_that_says(words, frame);
    assert_eq!(came.status, Some(1), "{}", came.said);
    let board: Value = serde_json::from_str(&came.out).unwrap();
    assert_eq!(board["image"], "0.0.9+old");
    assert_eq!(board["fits_this_desk"], false);
}
