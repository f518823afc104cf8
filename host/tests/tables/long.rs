//! Tables that take minutes, and for each a short computation by the same code, which takes 0.1 s.

use super::{REAL_PARTS, Table, closed_loop, identifying, kband, list, number, weighing};

pub struct Long {
    pub table: Table,
    /// A short computation by the same code.
    pub little: fn() -> Vec<String>,
}

macro_rules! long_tables {
    ($($test:ident: $name:literal, $page:expr, $head:expr, $rows:expr, $little:expr;)+) => {
        pub const TABLES: &[Long] = &[$(Long {
            table: Table { name: $name, page: $page, head: $head, rows: || $rows },
            little: || $little,
        }),+];

        $(
            #[test]
            #[ignore = "takes minutes; docs/numbers.sh runs it"]
            fn $test() {
                super::whole($name);
            }
        )+
    };
}

long_tables! {
    in_gear_under_scatter: "gear under scatter", "theory-real-parts.md",
        "| R | one tone, s = 0.03 | 0.06 | 0.10 | two tones, s = 0.03 | 0.06 | 0.10 |",
        under_scatter(&["0.1", "0.2", "0.3", "0.4", "0.5", "0.6"], ""),
        under_scatter(&["0.3"], "--k 0.40..0.44:3 --second-tone 0.15,2.356 --runs 1");
    weighing_of_twenty_feeders: "weighing", REAL_PARTS, weighing::HEAD,
        weighing::table(20, 1).expect("feeders"),
        weighing::table(1, 1).expect("feeders");
    gear_in_the_closed_loop: "gear in the closed loop", REAL_PARTS,
        "| R | s | target | tones afforded | in gear | heard | told | expected | k | e, th | e3, th3 | peak (g) | mm/s | lock's mm/s |",
        closed_loop::table(&closed_loop::ROWS, 50),
        closed_loop::table(&closed_loop::ROWS[1..2], 1);
    captures_in_the_closed_loop: "captures in the closed loop", REAL_PARTS,
        "| restitution | captured | median time | slowest twentieth |",
        captures(&["0.18..0.22", "0.28..0.32", "0.38..0.42", "0.48..0.52"], "--duration 20 --runs 300"),
        captures(&["0.28..0.32"], "--duration 3 --runs 1");
    identified_without_scatter: "identified, on three tracks", REAL_PARTS,
        "| restitution | 0.15 | 0.2 | 0.25 | 0.3 | 0.5 | 0.7 | 0.8 |",
        tracks(&[[50.0, 1.0], [50.0, 2.0], [100.0, 1.0]], 20),
        tracks(&[[100.0, 1.0]], 1);
    identified_with_scatter: "identified, with scatter", REAL_PARTS,
        "| parts | scatter | R 0.1 | 0.2 | 0.3 | 0.4 | 0.5 | 0.6 | 0.7 |",
        scattering(&[1, 2, 3, 6], &[0.0, 0.02, 0.05, 0.10, 0.15], 3),
        scattering(&[1], &[0.05], 1);
}

fn under_scatter(restitutions: &[&str], more: &str) -> Vec<String> {
    let row = |restitution: &&str| {
        let result = ["0.03", "0.06", "0.10"].map(|scatter| {
            let lot = format!("--restitution {restitution} --scatter {scatter}");
            kband(&format!("gear {lot} {more}"))
        });
        let one = result.each_ref().map(|result| {
            let [share, k] = ["in_gear", "k"].map(|key| number(&result["one_tone"][key]));
            format!("{share:.2} at k {k:.2}")
        });
        let two = result.map(|result| format!("{:.2}", number(&result["two_tones"]["in_gear"])));
        let cells = [one, two].concat();
        format!("| {restitution} | {} |", cells.join(" | "))
    };
    restitutions.iter().map(row).collect()
}

/// Captures of other lots in the default scene, with a target of lock and without scatter.
fn captures(lots: &[&str], more: &str) -> Vec<String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("lock.toml");
    let line = |line| match line {
        _ if str::starts_with(line, "gear = 1") => "locked = 1",
        _ if line.starts_with("scatter = ") => "scatter = 0.0",
        _ => line,
    };
    let scene: Vec<&str> = kband_host::simulate::DEFAULT.lines().map(line).collect();
    std::fs::write(&path, scene.join("\n")).expect("the scene is written");
    let row = |lot: &&str| {
        let lot_args = format!("--restitution {lot} --seed 1 --fidelity waveform {more}");
        let result = kband(&format!("simulate {} {lot_args}", path.display()));
        let [runs] = list(&result) else {
            panic!("one row");
        };
        let seconds = |key: &str| {
            let time = runs[key].as_f64();
            time.map_or("-".into(), |time| format!("{time:.1} s"))
        };
        let share = super::percent(number(&runs["share"]));
        let times = ["median_time", "slowest_time"].map(seconds).join(" | ");
        format!("| {lot} | {share} | {times} |")
    };
    lots.iter().map(row).collect()
}

fn tracks(tracks: &[[f32; 2]], runs: u64) -> Vec<String> {
    let row = |&track: &[f32; 2]| {
        let [frequency, decay] = track;
        let cell = |restitution| identifying::cell((restitution, 0.0, 1), track, 1..1 + runs);
        let cells = [0.15, 0.2, 0.25, 0.3, 0.5, 0.7, 0.8].map(cell);
        let cells = cells.join(" | ");
        format!("| {frequency} Hz, ringing decays in {decay} ms | {cells} |")
    };
    tracks.iter().map(row).collect()
}

fn scattering(parts: &[usize], scatters: &[f32], runs: u64) -> Vec<String> {
    let mut rows = Vec::new();
    for &parts in parts {
        for &scatter in scatters {
            let cell = |tenths: u8| {
                let lot = (f32::from(tenths) / 10.0, scatter, parts);
                identifying::cell(lot, identifying::BUILT_IN_TRACK, 31..31 + runs)
            };
            let cells: Vec<String> = (1..=7).map(cell).collect();
            let cells = cells.join(" | ");
            rows.push(format!("| {parts} | {scatter:.2} | {cells} |"));
        }
    }
    rows
}
