//! Tables that take minutes, and for each a little of the same way that takes a tenth of a second.

use std::f64::consts::TAU;

use kband::regime::gear::is_in_gear;
use kband_control::{Controller, StartCause, Target};
use kband_plant::{EnvelopeLoop, Scene};
use serde_json::Value;

use super::{
    REAL_PARTS, Table, closed_loop, hearing, identifying, kband, list, number, shapes, weighing,
};

/// A table that takes minutes.
pub struct Long {
    pub table: Table,
    /// A little of the same way.
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

const HEARD: &str = "| R | s | k | true, one part | 1 part | 2 | 6 | 12 | 24 parts | error told |";

long_tables! {
    in_gear_under_scatter: "gear under scatter", "theory-real-parts.md",
        "| R | one tone, s = 0.03 | 0.06 | 0.10 | two tones, s = 0.03 | 0.06 | 0.10 |",
        under_scatter(&["0.1", "0.2", "0.3", "0.4", "0.5", "0.6"], ""),
        under_scatter(&["0.3"], "--k 0.40..0.44:3 --second-tone 0.15,2.356 --runs 1");
    shapes_of_the_track: "shapes", REAL_PARTS, shapes::HEAD,
        shapes::table(&shapes::LOTS, [4000, shapes::MOVES]).expect("shapes"),
        shapes::table(&shapes::LOTS[5..], [20, 1]).expect("shapes");
    weighing_of_twenty_feeders: "weighing", REAL_PARTS, weighing::HEAD,
        weighing::table(20, 1).expect("feeders"),
        weighing::table(1, 1).expect("feeders");
    share_heard_of_the_chosen_lots: "share heard, lots chosen with", REAL_PARTS, HEARD,
        hearing::table(&hearing::rows("set"), 6, 1),
        hearing::table(&hearing::rows("set")[5..10], 1, 1);
    share_heard_of_the_other_lots: "share heard, other lots", REAL_PARTS, HEARD,
        hearing::table(&hearing::rows("check"), 6, 77),
        hearing::table(&hearing::rows("check")[5..10], 1, 77);
    gear_of_order_two: "gear of order 2", REAL_PARTS,
        "| R | s | one tone: map | plan | two tones: map, at k, e, th | plan, at k, e, th |",
        order_two(&[("0.2", "0.05"), ("0.3", "0.03"), ("0.4", "0.05"), ("0.6", "0.05")], "--largest-second-tone 0.3 --runs 12"),
        order_two(&[("0.3", "0.03")], "--k 0.19..0.2:2 --second-tone 0.18,2.88 --runs 1");
    losses_of_gear: "losses of gear", REAL_PARTS,
        "| R, s, k | share | cycles in gear | cycles out of it | of these beyond the 40th |",
        losses(&LOSSES, 100_000),
        losses(&LOSSES[4..], 2000);
    gear_in_the_closed_loop: "gear in the closed loop", REAL_PARTS,
        "| R | s | target | tones afforded | in gear | heard | told | expected | k | e, th | e3, th3 | peak (g) | mm/s | lock's mm/s |",
        closed_loop::table(&closed_loop::ROWS, 50),
        closed_loop::table(&closed_loop::ROWS[1..2], 1);
    captures_in_the_closed_loop: "captures in the closed loop", REAL_PARTS,
        "| restitution | band alone | planned kicks | median time | slowest twentieth |",
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
        let found = ["0.03", "0.06", "0.10"].map(|scatter| {
            let lot = format!("--restitution {restitution} --scatter {scatter}");
            kband(&format!("gear {lot} {more}"))
        });
        let one = found.each_ref().map(|found| {
            let [share, k] = ["in_gear", "k"].map(|key| number(&found["one_tone"][key]));
            format!("{share:.2} at k {k:.2}")
        });
        let two = found.map(|found| format!("{:.2}", number(&found["two_tones"]["in_gear"])));
        let cells = [one, two].concat();
        format!("| {restitution} | {} |", cells.join(" | "))
    };
    restitutions.iter().map(row).collect()
}

/// What the controller plans for a lot in gear of order 2, with upper tones of at most so much: k,
/// e and th.
fn planned(restitution: &str, scatter: &str, second_tone: f32) -> [f32; 3] {
    let mut settings = Scene::default().settings;
    let restitution = restitution.parse().expect("a restitution");
    (settings.restitution_low, settings.restitution_high) = (restitution, restitution);
    settings.scatter = scatter.parse().expect("a scatter");
    settings.amplitude_error = 0.0;
    settings.second_tone = second_tone;
    let target = Target::Gear { order: 2 };
    let mut controller =
        Controller::build(&settings, target, StartCause::Ordinary).expect("a feeder");
    while controller.plan_step() {}
    let plan = controller.gear().expect("a plan");
    let [e, th] = plan.tones[0];
    [plan.k, e, th]
}

fn order_two(lots: &[(&str, &str)], more: &str) -> Vec<String> {
    let row = |&(restitution, scatter): &(&str, &str)| {
        let lot = format!("gear --order 2 --restitution {restitution} --scatter {scatter}");
        let map = kband(&format!("{lot} {more}"));
        // The plan's place in double precision.
        let [k, ..] = planned(restitution, scatter, 0.0);
        let one = kband(&format!("{lot} --k {k} --second-tone 0.1,1 --runs 64"));
        let [k2, e, th] = planned(restitution, scatter, 0.3);
        let two = kband(&format!("{lot} --k {k2} --second-tone {e},{th} --runs 64"));
        let share = |found: &Value, tones: &str| number(&found[tones]["in_gear"]);
        let best = |key: &str| number(&map["two_tones"][key]);
        format!(
            "| {restitution} | {scatter} | {:.2} | {:.2} | {:.3}: {:.3}, {:.2}, {:.2} | {:.3}: {k2:.3}, {e:.2}, {th:.2} |",
            share(&map, "one_tone"),
            share(&one, "one_tone"),
            share(&map, "two_tones"),
            best("k"),
            best("e"),
            best("th"),
            share(&two, "two_tones"),
        )
    };
    lots.iter().map(row).collect()
}

/// Restitution, scatter and the k that the plan finds for them.
const LOSSES: [[f32; 3]; 6] = [
    [0.2, 0.05, 0.398],
    [0.3, 0.05, 0.441],
    [0.4, 0.05, 0.508],
    [0.5, 0.05, 0.562],
    [0.3, 0.10, 0.444],
    [0.5, 0.10, 0.550],
];

/// How long one part is in gear between two losses of it, and how long out of it.
fn losses(lots: &[[f32; 3]], cycles: u32) -> Vec<String> {
    let row = |&[restitution, scatter, k]: &[f32; 3]| {
        let mut scene = Scene {
            target: Target::K(k),
            parts: [restitution].into_iter().collect(),
            scatter: [scatter].into_iter().collect(),
            ..Scene::default()
        };
        scene.settings.scatter = scatter;
        scene.settings.restitution_low = restitution;
        scene.settings.restitution_high = restitution;
        let mut closed = EnvelopeLoop::build(&scene).expect("a feeder");
        for _ in 0..250 {
            closed.cycle();
        }
        // Flights in gear in a row and when the first of them began; when gear was lost; cycles in
        // gear and out of it.
        let (mut row, mut began, mut lost) = (0, 0.0, None);
        let (mut inside, mut outside) = (0.0, Vec::new());
        for _ in 0..cycles {
            closed.cycle();
            for strike in closed.strikes() {
                let landed = strike.time as f64 / 4_294_967_296.0;
                let flight = f64::from(strike.flight);
                if is_in_gear(flight * TAU, TAU) && !strike.rested {
                    if row == 0 {
                        began = landed - flight;
                    }
                    row += 1;
                    if row == 8 {
                        outside.extend(lost.take().map(|lost| began - lost));
                    }
                } else {
                    if row >= 8 {
                        let left = landed - flight;
                        inside += left - began;
                        lost = Some(left);
                    }
                    row = 0;
                }
            }
        }
        let count = outside.len() as f64;
        let out: f64 = outside.iter().sum();
        let beyond: f64 = outside.iter().map(|cycles| (cycles - 40.0).max(0.0)).sum();
        format!(
            "| {restitution}, {scatter:.2}, {k:.3} | {:.2} | {:.0} | {:.1} | {:.0} % |",
            inside / (inside + out),
            inside / count,
            out / count,
            100.0 * beyond / out
        )
    };
    lots.iter().map(row).collect()
}

/// The built-in scene with another lot, that is to lock and does not scatter.
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
        let found = kband(&format!(
            "simulate {} --restitution {lot} --seed 1 --fidelity waveform {more}",
            path.display()
        ));
        let [planned, alone] = list(&found) else {
            panic!("two ways");
        };
        let seconds = |key: &str| {
            let time = planned[key].as_f64();
            time.map_or("-".into(), |time| format!("{time:.1} s"))
        };
        let share = |row: &Value| super::percent(number(&row["share"]));
        format!(
            "| {lot} | {} | {} | {} | {} |",
            share(alone),
            share(planned),
            seconds("median_time"),
            seconds("slowest_time"),
        )
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
                identifying::cell(lot, identifying::BUILT_IN, 31..31 + runs)
            };
            let cells: Vec<String> = (1..=7).map(cell).collect();
            let cells = cells.join(" | ");
            rows.push(format!("| {parts} | {scatter:.2} | {cells} |"));
        }
    }
    rows
}
