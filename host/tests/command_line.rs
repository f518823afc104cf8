//! The command line: wrong input, formats, files, threads.

mod outcome;

use std::collections::BTreeSet;
use std::fs::DirEntry;
use std::process::{Command, Stdio};

use kband_host::provenance;
use outcome::{kband, start};
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn names(folder: &TempDir) -> Vec<String> {
    let name = |entry: std::io::Result<DirEntry>| entry.unwrap().file_name().into_string();
    let names: Result<BTreeSet<_>, _> = std::fs::read_dir(folder).unwrap().map(name).collect();
    names.unwrap().into_iter().collect()
}

fn scene(folder: &TempDir) -> String {
    kband(folder, "simulate --print-scene").done()
}

/// A wrong input of the list: the line after `$`, and the expected message.
type Wrong<'a> = (&'a str, &'a str);

fn wrong_inputs(list: &str) -> Vec<Wrong<'_>> {
    let wrong = |block| {
        let (line, message) = str::split_once(block, '\n').unwrap_or((block, ""));
        (line, message.trim_end())
    };
    list.split("\n$ ").skip(1).map(wrong).collect()
}

/// Output for one wrong input, run in its own folder.
fn message_of(folder: &TempDir, scene: &str, line: &str) -> String {
    let place = folder.path();
    let outcome = match line.split_once(' ').expect("a line has a command") {
        ("scene", changes) => {
            let mut text = scene.to_string();
            for change in changes.split(" and ") {
                let (right, wrong) = change.split_once(" -> ").unwrap();
                let key_line = format!("\n{right}");
                assert!(text.contains(&key_line), "no line {right} in the scene");
                let wrong = wrong.replace("\\n", "\n");
                text = text.replacen(&key_line, &format!("\n{wrong}"), 1);
            }
            std::fs::write(place.join("bad.toml"), text).unwrap();
            kband(place, "simulate bad.toml --out bad.svg")
        }
        ("file", rest) => {
            let (file, command) = rest.split_once(" -> ").unwrap();
            let (name, text) = file.split_once(' ').unwrap();
            std::fs::write(place.join(name), text.replace("\\n", "\n")).unwrap();
            let outcome = kband(place, command);
            std::fs::remove_file(place.join(name)).unwrap();
            outcome
        }
        ("board", args) => outcome::on_board(place, outcome::TIMEOUT, args, &[]),
        (_, args) => kband(place, args),
    };
    outcome.refused(&[]);
    let message = outcome.stderr.trim_end();
    assert!(outcome.out.is_empty(), "{line} printed a result");
    assert!(message.starts_with("error: "), "{line}: {message}");
    let steps = message.matches("\n  next: ").count();
    assert_eq!(steps, 1, "{line}: {message}");
    let mut left = names(folder);
    left.retain(|name| name != "bad.toml" && !INPUT_FILES.iter().any(|(given, _)| given == name));
    assert!(left.is_empty(), "{line} left {left:?}");
    message.to_string()
}

const INPUT_FILES: [(&str, &str); 3] =
    [("rows.csv", ROWS), ("words.csv", WORDS), ("empty.csv", "")];
const ROWS: &str = "k,restitution,phase,velocity\n0.43,0.2,0.5,0.4\n\n0.43,1.2,0.5,0.4\n";
const WORDS: &str = "k,restitution,phase,velocity\n0.43,R,0.5,0.4\n";

/// Each line of `wrong_inputs.txt` is refused with the message below it.
#[test]
fn a_wrong_input_is_one_message_with_cause_range_and_next_step() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/wrong_inputs.txt");
    let list = std::fs::read_to_string(path).unwrap();
    let inputs = wrong_inputs(&list);
    assert!(inputs.len() >= 150, "{} wrong inputs", inputs.len());
    let scene = scene(&folder());
    let shares: Vec<&[Wrong<'_>]> = inputs.chunks(inputs.len().div_ceil(4)).collect();
    let messages: Vec<String> = std::thread::scope(|scope| {
        let run = |share: &'_ [Wrong<'_>]| {
            let folder = folder();
            for (name, text) in INPUT_FILES {
                std::fs::write(folder.path().join(name), text).unwrap();
            }
            let messages = share.iter();
            let messages = messages.map(|(line, _)| message_of(&folder, &scene, line));
            messages.collect::<Vec<_>>()
        };
        let spawn = |share| scope.spawn(move || run(share));
        let threads: Vec<_> = shares.into_iter().map(spawn).collect();
        let ended = threads.into_iter().map(|thread| thread.join());
        let messages: Result<Vec<_>, _> = ended.collect();
        messages.expect("no input panics").concat()
    });
    if std::env::var_os("KBAND_ACCEPT").is_some() {
        let head = list.split("\n$ ").next().unwrap_or_default();
        let mut text = head.to_string();
        for ((line, _), message) in inputs.iter().zip(&messages) {
            text.push_str(&format!("\n$ {line}\n{message}\n"));
        }
        std::fs::write(path, text).unwrap();
        return;
    }
    for ((line, expected), message) in inputs.iter().zip(&messages) {
        assert_eq!(message, expected, "$ {line}");
    }
}

/// Scenes whose printed reports differ in most of their lines.
const REPORTED: [&str; 10] = [
    "chaotic",
    "doubled",
    "drawn_parts",
    "identification",
    "in_gear",
    "locked_order_2",
    "misfit",
    "not_captured",
    "over_current",
    "output_limit",
];

/// What `kband simulate` prints of these scenes is in `reports.txt`, except its own run time.
#[test]
fn the_report_of_a_scene_is_the_accepted_one() {
    let here = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/reports.txt");
    let folder = folder();
    let mut reports = String::new();
    for name in REPORTED {
        let scene = format!("{}/../tests/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        std::fs::copy(scene, folder.path().join("scene.toml")).unwrap();
        let printed = kband(&folder, "simulate scene.toml").done();
        reports.push_str(&format!("$ kband simulate {name}.toml\n"));
        for line in printed.lines() {
            if !line.ends_with(" times real time (envelope)") {
                reports.push_str(&format!("{line}\n"));
            }
        }
    }
    if std::env::var_os("KBAND_ACCEPT").is_some() {
        std::fs::write(here, reports).unwrap();
        return;
    }
    let accepted = std::fs::read_to_string(here).unwrap();
    for (line, expected) in reports.lines().zip(accepted.lines()) {
        assert_eq!(line, expected);
    }
    assert_eq!(reports.len(), accepted.len(), "lines at the end");
}

/// Keys, texts and numbers (to nine digits) of a JSON value, in the order of the value.
fn digest(value: &serde_json::Value, text: &mut String) {
    match value {
        serde_json::Value::Number(number) => {
            *text += &format!("{:.8e} ", number.as_f64().unwrap());
        }
        serde_json::Value::Array(values) => values.iter().for_each(|value| digest(value, text)),
        serde_json::Value::Object(fields) => {
            for (key, value) in fields {
                *text += key;
                digest(value, text);
            }
        }
        other => *text += &other.to_string(),
    }
}

/// Each command of `answers.txt` has the result of the hash (FNV-1a) before it. `KBAND_ACCEPT=1`
/// writes the hashes after an intended change.
#[test]
fn the_answer_of_a_command_is_the_accepted_one() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/answers.txt");
    let accepted = std::fs::read_to_string(path).unwrap();
    let folder = folder();
    let mut actual = String::new();
    for line in accepted.lines() {
        let (_, command) = line.split_once("  ").expect("a hash and a command");
        let answer = kband(&folder, &format!("{command} --format json")).json();
        let mut text = String::new();
        digest(&answer, &mut text);
        let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
        });
        actual += &format!("{hash:016x}  {command}\n");
    }
    if std::env::var_os("KBAND_ACCEPT").is_some() {
        std::fs::write(path, actual).unwrap();
        return;
    }
    for (line, expected) in actual.lines().zip(accepted.lines()) {
        assert_eq!(line, expected);
    }
}

/// A named output overwrites any file, a default name only files that kband wrote.
#[test]
fn a_foreign_file_is_replaced_only_where_it_is_named() {
    let folder = folder();
    let mine = |name: &str| std::fs::write(folder.path().join(name), "mine").unwrap();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let remove = |name: &str| std::fs::remove_file(folder.path().join(name)).unwrap();
    let replaces = |verb: &str, name: &str| {
        mine(name);
        let outcome = kband(&folder, &format!("{verb} --out {name}"));
        let stderr = outcome.ended(0).stderr;
        let replaced = format!("replaced {name}");
        assert!(stderr.contains(&replaced), "{verb}: {stderr}");
        assert_ne!(read(name), b"mine");
        remove(name);
    };
    let verbs = [
        "bands",
        "basins --k 0.43 --restitution 0.2 --grid 4",
        "capture --runs 1 --parts 1 --factor 1..2:2 --longest 10",
        "cascade --doublings 1",
        "diagram --k 0.3..0.5:3 --impacts 2 --settle 2",
        "exponent --k 0.34 --impacts 320 --settle 10",
        "impacts --k 0.43 --restitution 0.2 --phase 1 --velocity 1 --count 3",
        "transport --k 0.43 --impacts 100 --settle 10 --starts 2",
        "margins",
        "gear --k 0.4..0.5:2 --second-tone 0.1,2.4 --runs 1 --periods 40",
    ];
    for verb in verbs {
        for name in ["old.csv", "old.svg"] {
            replaces(verb, name);
        }
        let stderr = kband(&folder, &format!("{verb} --out new.json")).stderr;
        assert!(stderr.contains("wrote new.json"), "{verb}: {stderr}");
        remove("new.json");
    }
    let run = "simulate --duration 1";
    for (args, name) in [
        ("report", "kband-report.html"),
        (run, "kband-simulate.svg"),
        (run, "kband-simulate.csv"),
    ] {
        mine(name);
        kband(&folder, args).refused(&[name, "next: name the file"]);
        assert_eq!(read(name), b"mine");
        remove(name);
    }
    // Files that kband wrote are replaced, by a single run and by many.
    for line in [run, run, "simulate --duration 1 --runs 2", run] {
        kband(&folder, line).done();
    }
    assert_eq!(names(&folder), ["kband-simulate.csv", "kband-simulate.svg"]);
}

#[test]
fn a_dash_is_standard_output_and_words_go_to_standard_error() {
    let folder = folder();
    let both = |line: &str| {
        let outcome = kband(&folder, line).ended(0);
        (outcome.out, outcome.stderr)
    };
    let (picture, table) = both("bands --restitution 0.2 --out -");
    assert!(picture.starts_with("<svg ") && picture.trim_end().ends_with("</svg>"));
    for expected in ["setpoint", "wrote standard output"] {
        assert!(table.contains(expected), "{table}");
    }
    let (rows, _) = both("bands --restitution 0.2 --out=-.csv");
    assert!(rows.contains("k2,k1") && !rows.contains("wrote"), "{rows}");
    let (image, _) = both("cascade --doublings 2 --out=-.png");
    assert!(image.contains("PNG"));
    let (trace, stderr) = both("simulate --duration 1 --out a.svg --trace -");
    let rows = trace.lines().filter(|line| !line.starts_with('#'));
    assert!(rows.count() > 45, "{trace}");
    assert!(stderr.contains("state  "), "{stderr}");
    let refused = kband(&folder, "simulate --duration 1 --out - --trace -");
    refused.refused(&["two outputs of this run"]);
    assert_eq!(names(&folder), ["a.svg"]);
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let folder = folder();
    let run = |verb: &str, threads: usize, out: &str| {
        kband(&folder, &format!("{verb} --threads {threads} --out {out}")).done();
        std::fs::read(folder.path().join(out)).unwrap()
    };
    let diagram = "diagram --k 0.3..0.5:40 --impacts 50 --settle 50";
    let capture = "capture --restitution 0.18..0.22 --runs 30 --parts 2 --factor 1..2:11";
    let gear = "gear --restitution 0.2..0.3 --scatter 0.06 --k 0.4..0.48:3 --runs 8 --periods 200";
    let transport = "transport --restitution 0.9 --k 0.05..0.07:3 --impacts 300 --settle 100";
    for (verb, out) in [
        ("design --candidates 2000 --checked 1", "out.json"),
        (diagram, "out.csv"),
        (diagram, "out.svg"),
        (diagram, "out.png"),
        (capture, "out.json"),
        (gear, "out.csv"),
        (transport, "out.csv"),
    ] {
        let one = run(verb, 1, out);
        assert!(one.len() > 100, "{verb}");
        assert!(one == run(verb, 3, out), "{verb} --out {out}");
    }
}

#[test]
#[cfg(unix)]
fn an_input_is_never_written_over_by_whatever_name() {
    let folder = folder();
    let place = |name: &str| folder.path().join(name);
    let rows = "k,restitution,phase,velocity\n0.43,0.2,0.1,0.4\n";
    std::fs::write(place("s.csv"), rows).unwrap();
    let scene = scene(&folder);
    std::fs::write(place("my.toml"), &scene).unwrap();
    std::os::unix::fs::symlink(place("s.csv"), place("link.csv")).unwrap();
    let before = names(&folder);
    for line in [
        "impacts --from s.csv --out s.csv",
        "impacts --from s.csv --out ./s.csv",
        "impacts --from s.csv --out link.csv",
        "simulate my.toml --trace my.toml",
        "simulate my.toml --out ./my.toml",
    ] {
        kband(&folder, line).refused(&["an input of this run"]);
    }
    let twice = "simulate my.toml --trace x.csv --scope ./x.csv";
    kband(&folder, twice).refused(&["two outputs"]);
    assert_eq!(names(&folder), before);
    assert_eq!(std::fs::read_to_string(place("s.csv")).unwrap(), rows);
    assert_eq!(std::fs::read_to_string(place("my.toml")).unwrap(), scene);
}

#[test]
fn a_scene_of_megabytes_is_refused_in_a_short_message() {
    let folder = folder();
    let bad = "\n[[disturbance]]\nat = 1.0\nchange = \"nonsense\"\n";
    let text = scene(&folder) + &bad.repeat(20_000);
    std::fs::write(folder.path().join("long.toml"), text).unwrap();
    let length = kband(&folder, "simulate long.toml").ended(2).stderr.len();
    assert!((50..6500).contains(&length), "{length}");
}

#[test]
fn a_seed_on_the_command_line_is_the_scenes() {
    let folder = folder();
    let scene = scene(&folder);
    assert!(scene.contains("seed = 1 "));
    for seed in [1, 7] {
        let with = scene.replace("seed = 1 ", &format!("seed = {seed} "));
        std::fs::write(folder.path().join(format!("{seed}.toml")), with).unwrap();
    }
    for rest in ["--duration 3", "--duration 3 --runs 3"] {
        let printed = |scene: &str| {
            // Everything but the computing time.
            let mut printed =
                kband(&folder, &format!("simulate {scene} {rest} --format json")).json();
            if let Some(whole) = printed.as_object_mut() {
                whole.remove("times_real_time");
            }
            printed
        };
        let in_scene = printed("7.toml");
        assert_eq!(in_scene, printed("1.toml --seed 7"), "{rest}");
        assert_ne!(in_scene, printed("1.toml"), "{rest}");
    }
}

#[test]
fn the_reference_for_parts_in_gear_is_a_separate_run() {
    // At scatter 0.04 the middle of the lock's band gives half the share of the gear setpoint.
    let runs = kband(folder(), "simulate --runs 4 --duration 20 --format json").json();
    let [planned, alone] = [0, 1].map(|n| runs[n]["in_gear"].as_f64().unwrap());
    assert!(planned > alone + 0.2, "{runs}");
}

#[test]
fn misplaced_amplitude_names_the_motion_and_the_right_one() {
    let folder = folder();
    for (k, motion, wrong) in [
        ("2.0", "they lie at rest", "too little"),
        ("0.6", "they hop and rest in turn", "too little"),
        ("0.28", "they hop irregularly", "too much"),
    ] {
        let own = scene(&folder).replacen("gear = 1 ", &format!("k = {k} "), 1);
        std::fs::write(folder.path().join("my.toml"), own).unwrap();
        let best = "0.252 mm keeps them in gear for 98 % of the time";
        kband(&folder, "simulate my.toml").prints(&[motion, wrong, best]);
    }
}

#[test]
fn a_scene_from_stdin_runs_and_a_table_fits_the_screen() {
    let folder = folder();
    let mut child = start(&folder, "simulate - --duration 1");
    let mut stdin = child.stdin.take().unwrap();
    std::io::Write::write_all(&mut stdin, scene(&folder).as_bytes()).unwrap();
    drop(stdin);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let printed = String::from_utf8(output.stdout).unwrap();
    assert!(printed.contains("conveying speed"), "{printed}");
    // Columns beyond the width of the screen continue below.
    let bands = kband(&folder, "bands --restitution 0.18..0.22").done();
    let table = bands.lines().skip(2);
    let table = table.take_while(|line| !line.starts_with("no band"));
    for line in table {
        assert!(line.chars().count() <= 80, "{line}");
    }
}

#[test]
fn a_reader_that_goes_away_ends_a_run_quietly() {
    let folder = folder();
    for line in [
        "simulate --duration 600 --trace -",
        "diagram --restitution 0.2 --out=-.csv",
        "basins --k 0.43 --restitution 0.2 --grid 200 --format csv",
    ] {
        let mut child = start(&folder, line);
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{stderr}");
        assert!(!stderr.contains("error"), "{stderr}");
    }
}

#[test]
fn gear_draws_by_default_and_regimes_stay_below_their_limit() {
    let folder = folder();
    let small = "gear --restitution 0.3 --runs 1 --periods 40 --k 0.4..0.5:2";
    kband(&folder, &format!("{small} --second-tone 0.15,2.356")).done();
    assert_eq!(names(&folder), ["kband-gear.svg"]);
    let wide = "diagram --show regimes --restitution 0..0.9:2 --format csv --k 1.5..2";
    let rows = kband(&folder, wide).done();
    assert_eq!(provenance::stripped(&rows).lines().count(), 1 + 2000);
}

#[test]
fn design_reports_its_changes_to_the_feeder_of_the_scene() {
    let folder = folder();
    let designed = kband(&folder, "design --candidates 2000 --checked 1");
    designed.prints(&["\nYour feeder at 50 Hz: 37", "held by: the drive's stroke"]);
    assert_eq!(names(&folder), ["kband-design.svg"]);
}

/// Writes the default scene with changed values as my.toml.
fn write_scene(folder: &TempDir, changes: &[(&str, &str)]) {
    let scene = scene(folder);
    let lines = scene.lines().map(|line| {
        let own = |(key, _): &&(&str, &str)| line.starts_with(&format!("{key} = "));
        match changes.iter().find(own) {
            Some((key, value)) => format!("{key} = {value}\n"),
            None => format!("{line}\n"),
        }
    });
    std::fs::write(folder.path().join("my.toml"), lines.collect::<String>()).unwrap();
}

#[test]
fn a_lot_out_of_gear_is_held_as_well_as_may_be_with_its_remedies() {
    let folder = folder();
    let lot = ("restitution", "[0.05, 0.6]");
    write_scene(&folder, &[lot, ("scatter", "0.1"), ("duration", "6.0")]);
    kband(&folder, "simulate my.toml").prints(&[
        "gear poor for the lot",
        "Next: parts sorted by restitution",
        "one change at a time is predicted to give",
    ]);
    // A feeder off its resonance is advised no second tone.
    let lot = ("restitution", "[0.35, 0.45]");
    write_scene(&folder, &[lot, ("frequency", "60.0")]);
    let text = kband(&folder, "simulate my.toml").prints(&[
        "Next: a stronger drive: the output is at its limit",
        "the drive on its resonance: it runs at 60 Hz, its resonance is 50 Hz",
    ]);
    let (_, causes) = text.split_once("causes  ").expect("causes");
    assert!(!causes.contains("second tone"), "{text}");
}

#[test]
fn a_file_of_more_than_100_mb_is_announced_before_it_is_written() {
    let folder = folder();
    let mut child = start(&folder, "simulate --duration 86400 --trace trace.csv");
    let mut stderr = String::new();
    let mut lines = std::io::BufReader::new(child.stderr.take().unwrap());
    std::io::BufRead::read_line(&mut lines, &mut stderr).unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    // 4 320 000 cycles of 205 bytes.
    assert_eq!(stderr, "note: trace.csv will have about 885 MB\n");
}

/// A command on a pseudo-terminal shows its progress on standard error.
#[test]
#[cfg(unix)]
fn a_long_command_is_seen_to_work_before_its_first_step_is_done() {
    use std::io::Read;

    use rustix::termios::{Winsize, tcsetwinsize};
    let (mut master, terminal, _) = outcome::port();
    let size = Winsize {
        ws_row: 24,
        ws_col: 80,
        ws_xpixel: 0,
        ws_ypixel: 0,
    };
    tcsetwinsize(&master, size).unwrap();
    // One step takes some minutes.
    let mut child = Command::new(env!("CARGO_BIN_EXE_kband"))
        .args(["exponent", "--k", "0.34", "--impacts", "1000000000"])
        .env("TERM", "xterm")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(terminal)
        .spawn()
        .unwrap();
    let (mut stderr, mut bytes) = (String::new(), [0; 256]);
    while !(stderr.contains("exponent [") && stderr.contains("2s so far")) {
        let count = master.read(&mut bytes).unwrap();
        stderr += &String::from_utf8_lossy(&bytes[..count]);
    }
    assert!(child.try_wait().unwrap().is_none());
    child.kill().unwrap();
    child.wait().unwrap();
}
