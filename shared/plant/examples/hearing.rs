//! Errors of the estimated share of time in gear, for one part and for many
//! (docs/theory-real-parts.md#t10.7).
//!
//! It runs lots in the gear that the controller chooses, and lots at given amplitudes.
//!
//! `cargo run --release -p kband-plant --example hearing RUNS SEED
//! ROWS`, with ROWS one of `gear`, `set`, `check` and `all`. The configured amplitude has an error
//! of up to 2 %, another one in each run. The test of the manual's tables makes them from the same
//! runs.

use kband::arithmetic::Noise;
use std::f64::consts::TAU;

use kband::regime::gear::GearWatch;
use kband_control::{GearPlanned, Target};
use kband_plant::{EnvelopeLoop, Scene};
use rayon::prelude::*;

/// Drive cycles of a run, and of the initial ones left out: 60 s and 5 s at 50 Hz.
const CYCLES: u32 = 3000;
const SETTLED: u32 = 250;

/// A lot, its target and its track.
#[derive(Clone, Copy)]
pub struct Row {
    lot: [f32; 2],
    scatter: f32,
    /// k, or `None` for the controller's gear. `second_tone` is that tone's largest amplitude over
    /// the first.
    k: Option<f32>,
    second_tone: f32,
    parts: usize,
}

/// Result of a run.
#[derive(Clone, Copy, Default)]
struct Heard {
    truth: f64,
    /// `heard`: mean estimate over the cycles with one; `told`: their share of all cycles; `error`:
    /// mean estimated error.
    heard: f64,
    told: f64,
    error: f64,
    /// Mean over all cycles of the estimated share, or of its lower bound in cycles without an
    /// estimate.
    least: f64,
}

fn run(row: &Row, seed: u64, known: &mut Option<GearPlanned>) -> Heard {
    let mut noise = Noise::new(seed);
    let [low, high] = row.lot;
    let target = match row.k {
        Some(k) => Target::K(k),
        None => Target::Gear { order: 1 },
    };
    let mut scene = Scene {
        target,
        seed,
        parts: (0..row.parts)
            .map(|_| low + (high - low) * noise.uniform())
            .collect(),
        scatter: std::iter::repeat_n(row.scatter, row.parts).collect(),
        ..Scene::default()
    };
    let settings = &mut scene.settings;
    settings.scatter = row.scatter;
    (settings.restitution_low, settings.restitution_high) = (low, high);
    settings.second_tone = row.second_tone;
    scene.drive.second_gain = settings.second_gain;
    scene.drive.second_lag = settings.second_lag;
    scene.sensor.sensitivity *= 1.0 + settings.amplitude_error * (2.0 * noise.uniform() - 1.0);
    let mut closed = EnvelopeLoop::build(&scene).expect("the rows are feeders");
    let mut watches: Vec<_> = (0..row.parts)
        .map(|_| GearWatch::build(1).expect("order 1 is one"))
        .collect();
    let mut all = Heard::default();
    for cycle in 0..CYCLES {
        if cycle == SETTLED {
            watches
                .iter_mut()
                .for_each(|watch| watch.begin(f64::from(cycle) * TAU));
        }
        closed.advance_spared(|controller| {
            if let (Some(asked), Some(plan)) = (controller.gear_search(), known.as_ref())
                && plan.settings == *asked
            {
                controller.supply_gear(plan.clone());
            }
        });
        let report = closed.moment().report;
        if known.is_none()
            && let Some(plan) = closed.controller().gear_planned()
        {
            *known = Some(plan.clone());
        }
        for strike in closed.strikes() {
            let landed = strike.time as f64 / 4_294_967_296.0 * TAU;
            let flight = f64::from(strike.flight) * TAU;
            let watch = &mut watches[usize::from(strike.part)];
            if strike.rested {
                watch.add_rest(landed - flight);
            }
            watch.add_landing(landed, flight);
        }
        if cycle >= SETTLED {
            all.least += f64::from(report.in_gear);
            if report.in_gear_error.is_finite() {
                all.told += 1.0;
                all.heard += f64::from(report.in_gear);
                all.error += f64::from(report.in_gear_error);
            }
        }
    }
    let counted = f64::from(CYCLES - SETTLED);
    let told = all.told.max(1.0);
    all.heard /= told;
    all.error /= told;
    all.least /= counted;
    all.told /= counted;
    for watch in &watches {
        all.truth += watch.share(f64::from(CYCLES) * TAU).share() / row.parts as f64;
    }
    all
}

/// The rows of the gear table, the rows that its constants were chosen on, and the rows only for
/// checking.
pub fn rows(which: &str) -> Vec<Row> {
    let row = |lot, scatter, k, second_tone, parts| Row {
        lot,
        scatter,
        k,
        second_tone,
        parts,
    };
    let mut rows = Vec::new();
    if which == "gear" || which == "all" {
        for (r, s, e) in [
            (0.2, 0.05, 0.0),
            (0.2, 0.05, 0.15),
            (0.3, 0.05, 0.0),
            (0.3, 0.05, 0.15),
            (0.4, 0.05, 0.0),
            (0.4, 0.05, 0.15),
            (0.5, 0.05, 0.0),
            (0.5, 0.05, 0.15),
            (0.3, 0.10, 0.0),
            (0.3, 0.10, 0.15),
            (0.3, 0.10, 0.25),
            (0.5, 0.10, 0.0),
            (0.5, 0.10, 0.25),
        ] {
            rows.push(row([r, r], s, None, e, 1));
        }
        for e in [0.0, 0.15] {
            for parts in [1, 2, 4, 6, 12, 24] {
                rows.push(row([0.1, 0.3], 0.03, None, e, parts));
            }
        }
    }
    for (set, lots) in [
        (
            "set",
            &[
                ([0.1, 0.3], 0.03, 0.383),
                ([0.2, 0.2], 0.05, 0.403),
                ([0.3, 0.3], 0.05, 0.4438),
                ([0.5, 0.5], 0.05, 0.5516),
                ([0.5, 0.5], 0.10, 0.5516),
                ([0.25, 0.25], 0.04, 0.42),
                ([0.35, 0.35], 0.07, 0.47),
                ([0.45, 0.45], 0.05, 0.53),
                ([0.15, 0.15], 0.06, 0.38),
                ([0.4, 0.4], 0.10, 0.49),
                ([0.2, 0.4], 0.04, 0.45),
                ([0.3, 0.3], 0.05, 0.49),
                ([0.1, 0.1], 0.06, 0.36),
                ([0.2, 0.2], 0.05, 0.4312),
            ][..],
        ),
        (
            "check",
            &[
                ([0.22, 0.22], 0.06, 0.41),
                ([0.33, 0.33], 0.08, 0.45),
                ([0.55, 0.55], 0.05, 0.6),
                ([0.25, 0.25], 0.10, 0.42),
                ([0.4, 0.4], 0.06, 0.5),
                ([0.15, 0.25], 0.05, 0.39),
                ([0.3, 0.4], 0.05, 0.47),
            ],
        ),
    ] {
        if which == set || which == "all" {
            for &(lot, scatter, k) in lots {
                for parts in [1, 2, 6, 12, 24] {
                    rows.push(row(lot, scatter, Some(k), 0.0, parts));
                }
            }
        }
    }
    rows
}

/// The results of `runs` runs of each row.
fn hear(rows: &[Row], runs: u64, seed: u64) -> Vec<Vec<Heard>> {
    rows.par_iter()
        .map(|row| {
            let mut known = None;
            let runs = (0..runs).map(|r| run(row, seed.wrapping_mul(1 << 20) + r, &mut known));
            runs.collect()
        })
        .collect()
}

/// Mean error of the estimate over the runs with one, its standard error, and the root mean square
/// error.
fn apart(runs: &[Heard]) -> [f64; 3] {
    let told = runs.iter().filter(|run| run.told > 0.0);
    let count = told.clone().count().max(1) as f64;
    let differences = told.map(|run| run.heard - run.truth);
    let mean = differences.clone().sum::<f64>() / count;
    let square = differences.map(|apart| apart * apart).sum::<f64>() / count;
    let spread = ((square - mean * mean).max(0.0) / (count - 1.0).max(1.0)).sqrt();
    [mean, spread, square.sqrt()]
}

/// The rows of the manual's table: a line for each lot, a column for each number of parts.
pub fn table(rows: &[Row], runs: u64, seed: u64) -> Vec<String> {
    let found = hear(rows, runs, seed);
    let mut lines = Vec::new();
    let mut first = 0;
    for lot in rows.chunk_by(|a, b| (a.lot, a.scatter, a.k) == (b.lot, b.scatter, b.k)) {
        let found = &found[first..first + lot.len()];
        first += lot.len();
        let Row {
            lot: [low, high],
            scatter,
            k,
            ..
        } = lot[0];
        let lot = if low == high {
            low.to_string()
        } else {
            format!("{low}..{high}")
        };
        let truth = found[0].iter().map(|run| run.truth).sum::<f64>() / runs as f64;
        let cells: Vec<String> = found
            .iter()
            .map(|runs| {
                let [mean, spread, _] = apart(runs);
                format!("{mean:+.3} ({spread:.3})")
            })
            .collect();
        let errors = found.iter().flatten().filter(|run| run.told > 0.0);
        let errors = errors.map(|run| run.error);
        let least = errors.clone().fold(f64::INFINITY, f64::min);
        let most = errors.fold(0.0, f64::max);
        lines.push(format!(
            "| {lot} | {scatter} | {} | {truth:.2} | {} | {least:.3}..{most:.3} |",
            k.unwrap_or_default(),
            cells.join(" | ")
        ));
    }
    lines
}

fn main() {
    let mut given = std::env::args().skip(1);
    let mut number = |otherwise| {
        let number = given.next();
        number.map_or(otherwise, |n| n.parse().expect("a whole number"))
    };
    let (runs, seed) = (number(4_u64), number(1_u64));
    let rows = rows(&given.next().unwrap_or_else(|| "all".into()));
    let found = hear(&rows, runs, seed);
    println!(
        "R         s     k      e     parts  true   heard  apart  +-     rms    error  told   least"
    );
    for (row, runs) in rows.iter().zip(found) {
        let count = runs.len() as f64;
        let mean = |of: &dyn Fn(&Heard) -> f64| runs.iter().map(of).sum::<f64>() / count;
        let told: Vec<_> = runs.iter().filter(|run| run.told > 0.0).collect();
        let of_told = told.len().max(1) as f64;
        let [apart, spread, rms] = apart(&runs);
        println!(
            "{:<9} {:<5} {:<6} {:<5} {:<5} {:6.3} {:6.3} {:+6.3} {:6.3} {:6.3} {:6.3} {:6.3} {:6.3}",
            format!("{}..{}", row.lot[0], row.lot[1]),
            row.scatter,
            row.k.map_or_else(|| "gear".into(), |k| k.to_string()),
            row.second_tone,
            row.parts,
            mean(&|run| run.truth),
            told.iter().map(|run| run.heard).sum::<f64>() / of_told,
            apart,
            spread,
            rms,
            told.iter().map(|run| run.error).sum::<f64>() / of_told,
            mean(&|run| run.told),
            mean(&|run| run.least),
        );
    }
}
