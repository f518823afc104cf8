//! Rows written one by one: the memory of `kband impacts` and `kband diagram` does not grow with their
//! number.

mod outcome;

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command};

use kband::impact::{Kernel, Map, PartState};
use outcome::start;

/// Largest memory of a command, KiB.
const MAX_MEMORY: u64 = 64 << 10;
const ORBIT: &str = "impacts --k 0.34 --restitution 0.2 --phase 0.5 --velocity 0.45";

/// Peak memory of a process so far, KiB; `None` after its end.
fn peak(child: &Child) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// Number of lines that a command prints, and its peak memory near the end.
fn printed(folder: &Path, args: &str, lines: usize) -> (usize, u64) {
    let mut child = start(folder, args);
    let mut out = BufReader::new(child.stdout.take().unwrap());
    let (mut line, mut count, mut peak_memory) = (Vec::new(), 0, 0);
    while out.read_until(b'\n', &mut line).unwrap() > 0 {
        line.clear();
        count += 1;
        // A pipe has a buffer of 64 KiB, some hundred lines.
        if count % 1000 == 0 && count + 5000 < lines {
            peak_memory = peak(&child).expect("it still writes").max(peak_memory);
        }
    }
    assert!(child.wait().unwrap().success(), "{args}");
    (count, peak_memory)
}

/// States after each impact, by the map itself.
fn states(count: usize) -> Vec<(f64, PartState)> {
    let map = Map::build(0.34, 0.2).unwrap();
    let mut state = Map::state(0.5, 0.45).unwrap();
    let impact = || {
        let impact = map.impact(state);
        state = impact.next;
        Some((impact.flight, state))
    };
    std::iter::from_fn(impact).take(count).collect()
}

#[test]
#[cfg(target_os = "linux")]
fn memory_does_not_grow_with_the_number_of_rows() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = std::fs::File::create(folder.path().join("rows.csv")).unwrap();
    writeln!(file, "k,restitution,phase,velocity").unwrap();
    for (_, state) in states(400_000) {
        writeln!(file, "0.34,0.2,{},{}", state.phase, state.velocity).unwrap();
    }
    for (args, lines) in [
        (format!("{ORBIT} --count 600000"), 600_000),
        (format!("{ORBIT} --count 150000 --format json"), 900_000),
        (format!("{ORBIT} --count 300000 --out a.svg"), 300_000),
        (format!("{ORBIT} --count 300000 --out rows.json"), 300_000),
        ("impacts --from rows.csv".into(), 400_000),
    ] {
        let (count, peak_memory) = printed(folder.path(), &args, lines);
        // The first lines are the provenance.
        assert!((lines..lines + 100).contains(&count), "{args}: {count}");
        let fits = 0 < peak_memory && peak_memory < MAX_MEMORY;
        assert!(fits, "{args}: {peak_memory} KiB");
    }
    // All impacts at once would take 23 MiB more than the program.
    let diagram = "diagram --k 0.335..0.345:3 --starts rest --impacts 500000 --format csv";
    let (count, peak_memory) = printed(folder.path(), diagram, 1_500_000);
    assert!(count > 1_500_000, "{count}");
    assert!(peak_memory < 24 << 10, "{peak_memory} KiB");
}

#[test]
#[cfg(target_os = "linux")]
fn an_interrupted_diagram_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let diagram = "diagram --k 0.3..0.5:1000 --starts rest --impacts 10000 --scatter 0.05";
    let mut child = start(folder.path(), &format!("{diagram} --out rows.csv"));
    let files = || std::fs::read_dir(folder.path()).unwrap().count();
    while files() == 0 {
        assert!(child.try_wait().unwrap().is_none(), "it wrote nothing");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let process = child.id().to_string();
    let killed = Command::new("kill").args(["-INT", &process]).status();
    assert!(killed.unwrap().success());
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(130), "{message}");
    let once = |word: &str| message.matches(word).count() == 1;
    assert!(once("error: interrupted") && once("next:"), "{message}");
    assert_eq!(files(), 0);
}

/// The JSON of streamed rows is that of a table (report/rows.rs).
#[test]
fn streamed_rows_are_the_impacts_of_the_map() {
    let folder = tempfile::tempdir().unwrap();
    // More rows than between two checks for an interruption.
    const COUNT: usize = 5000;
    let expected = states(COUNT);
    let rows = |args: &str| -> Vec<Vec<f64>> {
        let csv = outcome::kband(&folder, args).done();
        let csv = outcome::stripped(&csv);
        let row = |line: &str| line.split(',').map(|cell| cell.parse().unwrap()).collect();
        csv.lines().skip(1).map(row).collect()
    };
    let orbit = rows(&format!("{ORBIT} --count {COUNT}"));
    let mut launches = String::from("k,restitution,phase,velocity\n0.34,0.2,0.5,0.45\n");
    for (n, (flight, state)) in expected.iter().enumerate() {
        let values = [(n + 1) as f64, state.phase, state.velocity, *flight];
        assert_eq!(orbit[n], values, "row {n}");
        launches += &format!("0.34,0.2,{},{}\n", state.phase, state.velocity);
    }
    // The same orbit, with each impact from a row of a file.
    std::fs::write(folder.path().join("launches.csv"), launches).unwrap();
    let impacts = rows("impacts --from launches.csv");
    assert_eq!([orbit.len(), impacts.len()], [COUNT, COUNT + 1]);
    for (row, (flight, state)) in impacts.iter().zip(&expected) {
        assert_eq!(*row, [*flight, state.phase, state.velocity]);
    }
}
