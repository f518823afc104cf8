//! The command line: wrong input, formats, files, threads.

mod outcome;

use std::collections::BTreeSet;
use std::fs::DirEntry;
use std::path::Path;
use std::process::{Command, Stdio};

use kband_control::wire::crc32;
use outcome::{Outcome, folder, kband, start};
use rayon::prelude::*;
use tempfile::TempDir;

fn names(folder: &TempDir) -> Vec<String> {
    let name = |entry: std::io::Result<DirEntry>| entry.unwrap().file_name().into_string();
    let names: Result<BTreeSet<_>, _> = std::fs::read_dir(folder).unwrap().map(name).collect();
    names.unwrap().into_iter().collect()
}

fn scene(folder: &TempDir) -> String {
    kband(folder, "simulate --print-scene").done()
}

/// An entry of a list: the line after `$`, and the text below it.
type Entry<'a> = (&'a str, &'a str);

fn entries(list: &str) -> Vec<Entry<'_>> {
    let entry = |block| {
        let (line, text) = str::split_once(block, '\n').unwrap_or((block, ""));
        (line, text.trim_end())
    };
    list.split("\n$ ").skip(1).map(entry).collect()
}

const INPUT_FILES: [(&str, &str); 3] =
    [("rows.csv", ROWS), ("words.csv", WORDS), ("empty.csv", "")];
const ROWS: &str = "k,restitution,phase,velocity\n0.43,0.2,0.5,0.4\n\n0.43,1.2,0.5,0.4\n";
const WORDS: &str = "k,restitution,phase,velocity\n0.43,R,0.5,0.4\n";

/// The outcome of a line of a list in a folder of its own, and the files that it leaves there.
fn outcome_of(scene: &str, line: &str) -> (Outcome, Vec<String>) {
    let folder = folder();
    let place = folder.path();
    let write = |name: &str, text: &str| std::fs::write(place.join(name), text).unwrap();
    for (name, text) in INPUT_FILES {
        write(name, text);
    }
    let (kind, mut command) = line.split_once(' ').expect("a line has a command");
    if kind == "scene" {
        let mut text = scene.to_string();
        for change in command.split(" and ") {
            let (right, other) = change.split_once(" -> ").unwrap();
            let key_line = format!("\n{right}");
            assert!(text.contains(&key_line), "no line {right} in the scene");
            let other = other.replace("\\n", "\n");
            text = text.replacen(&key_line, &format!("\n{other}"), 1);
        }
        write("my.toml", &text);
        command = "simulate my.toml --out my.svg";
    } else if kind == "file" {
        let (file, after) = command.split_once(" -> ").unwrap();
        let (name, text) = file.split_once(' ').unwrap();
        write(name, &text.replace("\\n", "\n"));
        command = after;
    }
    // A line may name a scene of the tests.
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/scenes");
    for name in command.split(' ').filter(|word| word.ends_with(".toml")) {
        let _ = std::fs::copy(scenes.join(name), place.join(name));
    }
    let before = names(&folder);
    let outcome = match kind {
        "board" => outcome::on_board(place, outcome::TIMEOUT, command, &[]),
        _ => kband(place, command),
    };
    let files = names(&folder).into_iter();
    let described = |name: String| match std::fs::read_to_string(place.join(&name)) {
        Ok(text) if name.ends_with(".csv") => {
            let lines = outcome::stripped(&text).lines().count();
            format!("{name} of {lines} lines")
        }
        _ => name,
    };
    let files = files.filter(|name| !before.contains(name));
    (outcome, files.map(described).collect())
}

/// Compares each text of a list of at least so many lines with that of its line; `KBAND_ACCEPT`
/// writes the list instead.
fn check(name: &str, least: usize, text: impl Fn(&str, Outcome, Vec<String>) -> String + Sync) {
    let path = format!("{}/tests/{name}", env!("CARGO_MANIFEST_DIR"));
    let list = std::fs::read_to_string(&path).unwrap();
    let (entries, scene) = (entries(&list), scene(&folder()));
    assert!(entries.len() >= least, "{} lines in {name}", entries.len());
    let of_line = |(line, _): &Entry<'_>| {
        let (outcome, files) = outcome_of(&scene, line);
        text(line, outcome, files)
    };
    let texts: Vec<String> = entries.par_iter().map(of_line).collect();
    if std::env::var_os("KBAND_ACCEPT").is_some() {
        let mut accepted = list.split("\n$ ").next().unwrap_or_default().to_string();
        for ((line, _), text) in entries.iter().zip(&texts) {
            accepted.push_str(&format!("\n$ {line}\n{text}\n"));
        }
        std::fs::write(path, accepted).unwrap();
        return;
    }
    for ((line, expected), text) in entries.iter().zip(&texts) {
        assert_eq!(text, expected, "$ {line}");
    }
}

#[test]
fn a_wrong_input_is_one_message_with_cause_range_and_next_step() {
    check("wrong_inputs.txt", 150, |line, outcome, files| {
        outcome.refused(&[]);
        let message = outcome.stderr.trim_end();
        assert!(outcome.out.is_empty(), "{line} printed a result");
        assert!(message.starts_with("error: "), "{line}: {message}");
        let steps = message.matches("\n  next: ").count();
        assert_eq!(steps, 1, "{line}: {message}");
        assert!(files.is_empty(), "{line} left {files:?}");
        message.to_string()
    });
}

/// The printed text or picture without its origin, and without the run time of a simulation.
fn printed(outcome: &Outcome) -> String {
    let text = outcome::stripped(&outcome.out) + &outcome.stderr;
    let is_own = |line: &str| line.contains(" times real time (") || line.contains("<metadata>");
    let lines = text.lines().filter(|line| !is_own(line));
    let lines: Vec<&str> = lines.map(str::trim_end).collect();
    lines.join("\n")
}

#[test]
fn printed_results_and_written_files_are_the_accepted_ones() {
    check("reports.txt", 30, |_, outcome, files| {
        format!(
            "{}\n(files: {})",
            printed(&outcome.ended(0)),
            files.join(", ")
        )
    });
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

/// The answer of a command keeps its text or picture; JSON keeps its numbers to nine digits.
#[test]
fn the_answer_of_a_command_is_the_accepted_one() {
    check("answers.txt", 100, |line, outcome, _| {
        let mut text = String::new();
        match line.ends_with("json") {
            true => digest(&outcome.json(), &mut text),
            false => text = printed(&outcome.ended(0)),
        }
        format!("{:08x}", crc32(text.as_bytes()))
    });
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
        "diagram --k 0.3..0.5:3 --impacts 2 --settle 2",
        "impacts --k 0.43 --restitution 0.2 --phase 1 --velocity 1 --count 3",
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

/// tests/answers.txt has pictures on standard output, with the words.
#[test]
fn a_dash_is_standard_output_and_words_go_to_standard_error() {
    let folder = folder();
    let both = |line: &str| {
        let outcome = kband(&folder, line).ended(0);
        (outcome.out, outcome.stderr)
    };
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
fn a_scene_from_stdin_with_a_removed_key_runs() {
    let folder = folder();
    let scene = scene(&folder).replace("[drive]", "[drive]\noutput_minimum = 0.05");
    let mut child = start(&folder, "simulate - --duration 1");
    let mut stdin = child.stdin.take().unwrap();
    std::io::Write::write_all(&mut stdin, scene.as_bytes()).unwrap();
    drop(stdin);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let printed = String::from_utf8(output.stdout).unwrap();
    assert!(printed.contains("conveying speed"), "{printed}");
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
fn a_file_of_more_than_100_mb_is_announced_before_it_is_written() {
    let folder = folder();
    let mut child = start(&folder, "simulate --duration 86400 --trace trace.csv");
    let mut stderr = String::new();
    let mut lines = std::io::BufReader::new(child.stderr.take().unwrap());
    std::io::BufRead::read_line(&mut lines, &mut stderr).unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    // 4 320 000 cycles of 219 bytes.
    assert_eq!(stderr, "note: trace.csv will have about 946 MB\n");
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
