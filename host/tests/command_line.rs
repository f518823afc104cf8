//! The command line as a user meets it: bad input, formats, files, threads.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use kband_host::provenance;

/// Runs `kband` in `folder` without a terminal or standard input; killed after 60 s.
fn kband(folder: &Path, arguments: &[&str]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_kband"))
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipes = (child.stdout.take().unwrap(), child.stderr.take().unwrap());
    // Read both while it runs: a full pipe would stop it.
    let out = std::thread::spawn(move || read(&mut pipes.0));
    let err = std::thread::spawn(move || read(&mut pipes.1));
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if begun.elapsed() > Duration::from_secs(60) {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("kband {} did not end within 60 s", arguments.join(" "));
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    Output {
        status,
        stdout: out.join().unwrap(),
        stderr: err.join().unwrap(),
    }
}

fn read(pipe: &mut impl std::io::Read) -> Vec<u8> {
    let mut bytes = Vec::new();
    pipe.read_to_end(&mut bytes).unwrap();
    bytes
}

/// An empty folder of this test's own, removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Self {
        let path = std::env::temp_dir().join(format!("kband-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(&self.0)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn words(line: &str) -> Vec<&str> {
    line.split(' ').collect()
}

/// A wrong input of the list: the line after `$`, and the message that it has to come to.
struct Wrong<'a> {
    line: &'a str,
    message: &'a str,
}

fn wrong_inputs(list: &str) -> Vec<Wrong<'_>> {
    let blocks = list.split("\n$ ").skip(1);
    blocks
        .map(|block| {
            let (line, message) = block.split_once('\n').unwrap_or((block, ""));
            Wrong {
                line,
                message: message.trim_end(),
            }
        })
        .collect()
}

/// What comes of one of them, in a folder of its own.
fn message_of(folder: &Folder, scene: &str, line: &str) -> String {
    let output = match line.split_once(' ').expect("a line has a command") {
        ("scene", change) => {
            let (right, wrong) = change.split_once(" -> ").unwrap_or((change, ""));
            let begun = format!("\n{right}");
            assert!(
                scene.contains(&begun),
                "no line {right} in the default scene"
            );
            let wrong = wrong.replace("\\n", "\n");
            let text = scene.replacen(&begun, &format!("\n{wrong}"), 1);
            std::fs::write(folder.0.join("bad.toml"), text).unwrap();
            kband(&folder.0, &["simulate", "bad.toml", "--out", "bad.svg"])
        }
        (_, arguments) => kband(&folder.0, &words(arguments)),
    };
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{line}: {message}");
    assert!(output.stdout.is_empty(), "{line} printed a result");
    assert!(message.starts_with("error: "), "{line}: {message}");
    assert_eq!(message.matches("error:").count(), 1, "{line}: {message}");
    assert_eq!(
        message.matches("\n  next: ").count(),
        1,
        "{line}: {message}"
    );
    let left = folder.names().into_iter().filter(|name| name != "bad.toml");
    let mut left: Vec<String> = left.collect();
    left.retain(|name| !GIVEN.iter().any(|(given, _)| given == name));
    assert!(left.is_empty(), "{line} left {left:?}");
    message.trim_end().to_string()
}

/// The files that the list's commands read.
const GIVEN: [(&str, &str); 3] = [
    (
        "rows.csv",
        "k,restitution,phase,velocity\n0.43,0.2,0.5,0.4\n\n0.43,1.2,0.5,0.4\n",
    ),
    (
        "words.csv",
        "k,restitution,phase,velocity\n0.43,R,0.5,0.4\n",
    ),
    ("empty.csv", ""),
];

/// Each line of `wrong_inputs.txt` is refused by the message below it.
#[test]
fn a_wrong_input_is_one_message_with_cause_range_and_next_step() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/wrong_inputs.txt");
    let list = std::fs::read_to_string(path).unwrap();
    let inputs = wrong_inputs(&list);
    assert!(inputs.len() >= 150, "{} wrong inputs", inputs.len());
    let folder = Folder::new("scene");
    let scene = kband(&folder.0, &["simulate", "--print-scene"]).stdout;
    let scene = String::from_utf8(scene).unwrap();
    let shares: Vec<&[Wrong<'_>]> = inputs.chunks(inputs.len().div_ceil(4)).collect();
    let found: Vec<String> = std::thread::scope(|scope| {
        let run = |(n, share): (usize, &'_ [Wrong<'_>])| {
            let folder = Folder::new(&format!("wrong{n}"));
            for (name, text) in GIVEN {
                std::fs::write(folder.0.join(name), text).unwrap();
            }
            let messages = share.iter();
            let messages = messages.map(|wrong| message_of(&folder, &scene, wrong.line));
            messages.collect::<Vec<_>>()
        };
        let threads: Vec<_> = shares
            .into_iter()
            .enumerate()
            .map(|share| scope.spawn(move || run(share)))
            .collect();
        let ended = threads.into_iter().map(|thread| thread.join());
        ended
            .flat_map(|messages| messages.expect("no input panics"))
            .collect()
    });
    if std::env::var_os("KBAND_ACCEPT").is_some() {
        let head = list.split("\n$ ").next().unwrap_or_default();
        let mut text = head.to_string();
        for (wrong, message) in inputs.iter().zip(&found) {
            text.push_str(&format!("\n$ {}\n{message}\n", wrong.line));
        }
        std::fs::write(path, text).unwrap();
        return;
    }
    for (wrong, message) in inputs.iter().zip(&found) {
        assert_eq!(message, wrong.message, "$ {}", wrong.line);
    }
}

/// An output that is named takes the place of an older one, one that nobody named only of kband's
/// own.
#[test]
fn a_foreign_file_is_replaced_only_where_it_is_named() {
    let folder = Folder::new("existing");
    let replaces = |verb: &str, name: &str| {
        std::fs::write(folder.0.join(name), "mine").unwrap();
        let output = kband(&folder.0, &words(&format!("{verb} --out {name}")));
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{verb}: {message}");
        assert!(
            message.contains(&format!("replaced {name}")),
            "{verb}: {message}"
        );
        assert_ne!(std::fs::read(folder.0.join(name)).unwrap(), b"mine");
        std::fs::remove_file(folder.0.join(name)).unwrap();
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
        let output = kband(&folder.0, &words(&format!("{verb} --out new.json")));
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(message.contains("wrote new.json"), "{verb}: {message}");
        std::fs::remove_file(folder.0.join("new.json")).unwrap();
    }
    // What takes seconds in a build for tests, once: times, and the page of the paper. That of a
    // feeder replaces one in the test that looks at it.
    for (verb, name) in [
        ("bench --rounds 1 --launches 512", "old.svg"),
        ("paper", "old.html"),
    ] {
        replaces(verb, name);
    }
    std::fs::write(folder.0.join("kband-report.html"), "mine").unwrap();
    let output = kband(&folder.0, &words("report"));
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(
        std::fs::read(folder.0.join("kband-report.html")).unwrap(),
        b"mine"
    );
    std::fs::remove_file(folder.0.join("kband-report.html")).unwrap();
    let run = "simulate --duration 1";
    for name in ["kband-simulate.svg", "kband-simulate.csv"] {
        std::fs::write(folder.0.join(name), "mine").unwrap();
        let output = kband(&folder.0, &words(run));
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(
            message.contains(name) && message.contains("next: name the file"),
            "{message}"
        );
        assert_eq!(std::fs::read(folder.0.join(name)).unwrap(), b"mine");
        std::fs::remove_file(folder.0.join(name)).unwrap();
    }
    // Its own are replaced, of a single run and of many.
    for line in [run, run, "simulate --duration 1 --runs 2", run] {
        assert_eq!(kband(&folder.0, &words(line)).status.code(), Some(0));
    }
    assert_eq!(folder.names(), ["kband-simulate.csv", "kband-simulate.svg"]);
}

#[test]
fn a_dash_is_standard_output_and_words_go_to_standard_error() {
    let folder = Folder::new("dash");
    let both = |line: &str| {
        let output = kband(&folder.0, &words(line));
        let [out, err] = [output.stdout, output.stderr]
            .map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        assert_eq!(output.status.code(), Some(0), "{line}: {err}");
        (out, err)
    };
    let (picture, table) = both("bands --restitution 0.2 --out -");
    assert!(picture.starts_with("<svg ") && picture.trim_end().ends_with("</svg>"));
    assert!(
        table.contains("setpoint") && table.contains("wrote standard output"),
        "{table}"
    );
    let (rows, _) = both("bands --restitution 0.2 --out=-.csv");
    assert!(rows.contains("k2,k1") && !rows.contains("wrote"), "{rows}");
    let (image, _) = both("cascade --doublings 2 --out=-.png");
    assert!(image.contains("PNG"));
    let (trace, said) = both("simulate --duration 1 --out a.svg --trace -");
    assert!(
        trace.lines().filter(|line| !line.starts_with('#')).count() > 45,
        "{trace}"
    );
    assert!(said.contains("state  "), "{said}");
    let refused = kband(&folder.0, &words("simulate --duration 1 --out - --trace -"));
    let message = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{message}");
    assert!(message.contains("two outputs of this run"), "{message}");
    assert_eq!(folder.names(), ["a.svg"]);
}

#[test]
#[cfg(target_os = "linux")]
fn what_a_killed_run_left_is_said_and_left_alone() {
    let folder = Folder::new("left");
    // The largest number that Linux gives to a process is 2^22.
    let left = ".rows.csv.4194999.unfinished";
    std::fs::write(folder.0.join(left), "half").unwrap();
    let output = kband(&folder.0, &words("bands --restitution 0.2 --out rows.csv"));
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{message}");
    assert!(message.contains(left), "{message}");
    assert!(message.contains("left of a run that was killed; remove it"));
    assert_eq!(folder.names(), [left, "rows.csv"]);
}

#[test]
fn golden_impacts_by_file_keep_17_digits() {
    let folder = Folder::new("golden");
    let reference = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/reference/impacts.csv"
    );
    let output = kband(&folder.0, &["impacts", "--from", reference]);
    assert_eq!(output.status.code(), Some(0));
    let text = provenance::stripped(&String::from_utf8(output.stdout).unwrap());
    let golden = std::fs::read_to_string(reference).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("flight,next_phase,next_velocity"));
    let mut count = 0;
    for (line, golden) in lines.zip(golden.lines().skip(1)) {
        let golden: Vec<&str> = golden.split(',').collect();
        let flight: f64 = line.split(',').next().unwrap().parse().unwrap();
        let expected: f64 = golden[5].parse().unwrap();
        if golden[8].parse::<f64>().unwrap() < 100.0 {
            // The project's requirement for well-conditioned impacts.
            assert!((flight / expected - 1.0).abs() < 1e-12, "{line}");
        }
        count += 1;
    }
    assert_eq!(count, 1200);
}

#[test]
fn the_batch_gives_the_bits_of_f64() {
    let folder = Folder::new("batch");
    let reference = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/reference/impacts.csv"
    );
    let from = |name: &str| {
        let output = kband(
            &folder.0,
            &["impacts", "--from", reference, "--arithmetic", name],
        );
        assert_eq!(output.status.code(), Some(0));
        provenance::stripped(&String::from_utf8(output.stdout).unwrap())
    };
    assert_eq!(from("f64"), from("batch"));
    let orbit = |name: &str| {
        let line = format!(
            "impacts --k 0.34 --restitution 0.2 --phase 1 --velocity 0.6 --count 50 --arithmetic {name}"
        );
        let printed = kband(&folder.0, &words(&line)).stdout;
        provenance::stripped(&String::from_utf8(printed).unwrap())
    };
    assert_eq!(orbit("f64"), orbit("batch"));
}

#[test]
fn an_orbit_in_three_formats_says_the_same() {
    let folder = Folder::new("formats");
    let run = |format: &str| {
        let line = format!(
            "impacts --k 0.43 --restitution 0.2 --phase -0.5 --velocity 0.45 --count 5 --format {format}"
        );
        let output = kband(&folder.0, &words(&line));
        assert_eq!(output.status.code(), Some(0));
        provenance::stripped(&String::from_utf8(output.stdout).unwrap())
    };
    let csv = run("csv");
    let json: serde_json::Value = serde_json::from_str(&run("json")).unwrap();
    assert_eq!(csv.lines().next(), Some("n,phase,velocity,flight"));
    for (n, line) in csv.lines().skip(1).enumerate() {
        for (column, field) in ["n", "phase", "velocity", "flight"]
            .into_iter()
            .zip(line.split(','))
        {
            assert_eq!(
                json[n][column].as_f64(),
                Some(field.parse().unwrap()),
                "row {n} {column}"
            );
        }
    }
    assert_eq!(run("table").lines().count(), 6);
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let folder = Folder::new("threads");
    let run = |threads: &str, out: &str| {
        let line = format!(
            "diagram --k 0.3..0.5:40 --impacts 50 --settle 50 --threads {threads} --out {out}"
        );
        assert_eq!(kband(&folder.0, &words(&line)).status.code(), Some(0));
        std::fs::read(folder.0.join(out)).unwrap()
    };
    for ending in ["csv", "svg", "png"] {
        let out = format!("out.{ending}");
        let one = run("1", &out);
        assert!(one.len() > 1000);
        assert_eq!(one, run("3", &out), "{ending}");
    }
}

#[test]
fn help_and_version_end_well() {
    let folder = Folder::new("help");
    for line in [
        "--help",
        "--version",
        "impacts --help",
        "completions bash",
        "completions fish",
    ] {
        let output = kband(&folder.0, &words(line));
        assert_eq!(output.status.code(), Some(0), "{line}");
        assert!(
            !output.stdout.is_empty() && output.stderr.is_empty(),
            "{line}"
        );
    }
}

#[test]
fn an_input_is_never_written_over_by_whatever_name() {
    let folder = Folder::new("inputs");
    let rows = "k,restitution,phase,velocity\n0.43,0.2,0.1,0.4\n";
    std::fs::write(folder.0.join("s.csv"), rows).unwrap();
    std::fs::hard_link(folder.0.join("s.csv"), folder.0.join("t.csv")).unwrap();
    let scene = kband(&folder.0, &["simulate", "--print-scene"]).stdout;
    std::fs::write(folder.0.join("my.toml"), &scene).unwrap();
    let before = folder.names();
    for (line, cause) in [
        ("impacts --from s.csv --out s.csv", "an input of this run"),
        ("impacts --from s.csv --out ./s.csv", "an input of this run"),
        ("impacts --from s.csv --out t.csv", "an input of this run"),
        ("simulate my.toml --trace my.toml", "an input of this run"),
        ("simulate my.toml --out ./my.toml", "an input of this run"),
        (
            "simulate my.toml --trace x.csv --scope ./x.csv",
            "two outputs",
        ),
    ] {
        let ended = kband(&folder.0, &words(line));
        let told = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(2), "{line}: {told}");
        assert!(told.contains(cause), "{line}: {told}");
        assert_eq!(told.matches("error:").count(), 1, "{line}: {told}");
    }
    assert_eq!(folder.names(), before);
    assert_eq!(
        std::fs::read(folder.0.join("s.csv")).unwrap(),
        rows.as_bytes()
    );
    assert_eq!(std::fs::read(folder.0.join("my.toml")).unwrap(), scene);
}

#[test]
fn a_scene_of_megabytes_is_refused_in_a_short_message() {
    let folder = Folder::new("long");
    let mut scene = kband(&folder.0, &["simulate", "--print-scene"]).stdout;
    for _ in 0..20_000 {
        scene.extend(b"\n[[disturbance]]\nat = 1.0\nchange = \"nonsense\"\n");
    }
    std::fs::write(folder.0.join("long.toml"), scene).unwrap();
    let ended = kband(&folder.0, &["simulate", "long.toml"]);
    assert_eq!(ended.status.code(), Some(2));
    assert!(
        (50..6500).contains(&ended.stderr.len()),
        "{} bytes",
        ended.stderr.len()
    );
}

#[test]
fn a_seed_on_the_command_line_is_the_scenes() {
    let folder = Folder::new("seed");
    let scene = kband(&folder.0, &["simulate", "--print-scene"]).stdout;
    let scene = String::from_utf8(scene).unwrap();
    assert!(scene.contains("seed = 1 "));
    for seed in [1, 7] {
        let with = scene.replace("seed = 1 ", &format!("seed = {seed} "));
        std::fs::write(folder.0.join(format!("{seed}.toml")), with).unwrap();
    }
    let told = |line: &str| {
        let ended = kband(&folder.0, &words(line));
        assert_eq!(ended.status.code(), Some(0), "{line}");
        // All but how fast it went.
        let told = provenance::stripped(&String::from_utf8(ended.stdout).unwrap());
        let lines = told.lines().filter(|l| !l.contains("times_real_time"));
        lines.collect::<String>()
    };
    for rest in ["--duration 3", "--duration 3 --runs 3"] {
        let rest = format!("{rest} --format json");
        let in_scene = told(&format!("simulate 7.toml {rest}"));
        let on_line = told(&format!("simulate 1.toml --seed 7 {rest}"));
        assert!(in_scene == on_line, "{rest}");
        assert!(
            in_scene != told(&format!("simulate 1.toml {rest}")),
            "{rest}"
        );
    }
    let both = kband(&folder.0, &words("simulate --seed 2 --sweep seed=1..3:3"));
    assert_eq!(both.status.code(), Some(2));
}

/// Writes the built-in scene with other values as my.toml.
fn write_scene(folder: &Path, changes: &[(&str, &str)]) {
    let scene = kband(folder, &["simulate", "--print-scene"]).stdout;
    let scene = String::from_utf8(scene).unwrap();
    let lines = scene.lines().map(|line| {
        let own = |(key, _): &&(&str, &str)| line.starts_with(&format!("{key} = "));
        match changes.iter().find(own) {
            Some((key, value)) => format!("{key} = {value}\n"),
            None => format!("{line}\n"),
        }
    });
    std::fs::write(folder.join("my.toml"), lines.collect::<String>()).unwrap();
}

#[test]
fn what_parts_in_gear_are_compared_with_is_a_run_of_its_own() {
    let folder = Folder::new("compared");
    let printed = |line: &str| -> serde_json::Value {
        let ended = kband(&folder.0, &words(line));
        let text = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert_eq!(ended.status.code(), Some(0), "{line}: {text}");
        provenance::without(serde_json::from_slice(&ended.stdout).unwrap())
    };
    let share = |row: &serde_json::Value| row["in_gear"].as_f64().unwrap();
    // The middle of the lock's band holds parts of scatter 0.04 for half of the time that the
    // choice for gear does.
    let runs = printed("simulate --runs 4 --duration 20 --format json");
    assert!(share(&runs[0]) > share(&runs[1]) + 0.2, "{runs}");

    // A third tone of the scene is compared together with the second.
    write_scene(
        &folder.0,
        &[
            ("restitution", "0.5"),
            ("scatter", "0.1"),
            ("second_tone", "0.25"),
            ("third_tone", "0.06"),
        ],
    );
    let tones = printed("simulate my.toml --compare-second-tone 0.25 --format json");
    let [one, all] = ["one_tone", "two_tones"].map(|name| &tones[name]);
    assert_eq!([&one["e"], &one["e3"]], [0.0, 0.0], "{tones}");
    assert!(all["e3"].as_f64() > Some(0.01), "{tones}");
    assert!(share(all) > share(one) + 0.3, "{tones}");
}

/// Tones that cannot be, scatter that no part has, a drive that cannot, a lot that nothing serves:
/// one message each, with the range and what would work.
#[test]
fn tones_and_lots_that_cannot_be_served_say_what_would_work() {
    let folder = Folder::new("served");
    let changed = |changes: &[(&str, &str)]| write_scene(&folder.0, changes);
    let refused = |arguments: &str, said: &[&str]| {
        let arguments: Vec<&str> = arguments.split(' ').collect();
        let ended = kband(&folder.0, &arguments);
        let text = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert_eq!(ended.status.code(), Some(2), "{text}");
        for words in said.iter().chain(&["accepted", "next"]) {
            assert!(text.contains(words), "{words}: {text}");
        }
        assert!(text.lines().count() <= 4, "{text}");
    };
    for tone in ["0.6,2.356", "-0.1,2.356", "0.15,135"] {
        for verb in [
            "bands --restitution 0.2",
            "gear --restitution 0.2 --scatter 0.05",
        ] {
            let said = [
                "0..0.5 of the first tone",
                "-6.2832..6.2832 rad",
                "135 degrees",
            ];
            refused(&format!("{verb} --second-tone={tone}"), &said);
            refused(
                &format!("{verb} --second-tone=0.15,2.4 --third-tone={tone}"),
                &said,
            );
        }
    }
    refused("gear --restitution 0.3 --scatter 0.31", &["0..0.3"]);
    for (changes, said) in [
        (
            &[("scatter", "0.31")][..],
            ["part.scatter = 0.31", "0..0.3"],
        ),
        (
            &[("second_tone", "0.3"), ("second_gain", "0.0")],
            ["drive.second_tone = 0.3", "raise drive.second_gain"],
        ),
        (
            &[("third_tone", "0.05")],
            ["drive.third_tone = 0.05", "drive.second_tone"],
        ),
        (
            &[
                ("second_tone", "0.3"),
                ("third_tone", "0.06"),
                ("third_gain", "0.0"),
            ],
            ["drive.third_tone = 0.06", "raise drive.third_gain"],
        ),
    ] {
        changed(changes);
        refused("simulate my.toml", &said);
    }
    // A lot that nothing serves is held as well as may be, and said.
    changed(&[
        ("restitution", "[0.05, 0.6]"),
        ("scatter", "0.1"),
        ("duration", "6.0"),
    ]);
    let ended = kband(&folder.0, &["simulate", "my.toml"]);
    let text = String::from_utf8_lossy(&ended.stdout).into_owned();
    for words in [
        "gear poor for the lot",
        "wider than any amplitude of this drive serves",
        "narrower lots",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

#[test]
fn a_scene_from_stdin_runs_and_manual_pages_print() {
    let folder = Folder::new("input");
    let scene = kband(&folder.0, &["simulate", "--print-scene"]).stdout;
    let mut child = Command::new(env!("CARGO_BIN_EXE_kband"))
        .args(words("simulate - --duration 1"))
        .current_dir(&folder.0)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    std::io::Write::write_all(&mut child.stdin.take().unwrap(), &scene).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(told.contains("conveying speed"), "{told}");
    let page = |line: &str| String::from_utf8(kband(&folder.0, &words(line)).stdout).unwrap();
    let whole = page("man");
    assert!(whole.contains(".TH kband 1"), "{whole}");
    let verb = page("man bands");
    assert!(verb.contains(".TH kband-bands 1"), "{verb}");
    assert!(verb.contains("second\\-tone"), "{verb}");
    // A table that is wider than a screen goes on below.
    let bands = page("bands --restitution 0.18..0.22");
    let table = bands
        .lines()
        .skip(2)
        .take_while(|line| !line.starts_with("no band"));
    for line in table {
        assert!(line.chars().count() <= 80, "{line}");
    }
}
