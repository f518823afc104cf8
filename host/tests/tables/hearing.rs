//! Errors of the estimated share of time in gear (docs/theory-real-parts.md#t10.7).

use std::f64::consts::TAU;

use kband::arithmetic::Noise;
use kband::regime::gear::GearWatch;
use kband_control::Target;
use kband_plant::{EnvelopeLoop, Scene};
use kband_scene::add_strike;
use rayon::prelude::*;

/// Drive cycles of a run, and excluded initial cycles: 60 s and 5 s at 50 Hz.
const CYCLES: u32 = 3000;
const SETTLING_CYCLES: u32 = 250;

/// A lot, its k and its number of parts.
#[derive(Clone, Copy)]
pub struct Row {
    lot: [f32; 2],
    scatter: f32,
    k: f32,
    parts: usize,
}

#[derive(Clone, Copy, Default)]
struct Estimates {
    truth: f64,
    /// Number of cycles with an estimate; mean of the estimates, and of their standard errors.
    with_estimate: f64,
    estimate: f64,
    error: f64,
}

fn run(row: &Row, seed: u64) -> Estimates {
    let mut noise = Noise::new(seed);
    let [low, high] = row.lot;
    let mut draw = || low + (high - low) * noise.uniform();
    let mut scene = Scene {
        target: Target::K(row.k),
        seed,
        parts: (0..row.parts).map(|_| draw()).collect(),
        scatter: std::iter::repeat_n(row.scatter, row.parts).collect(),
        ..Scene::default()
    };
    let settings = &mut scene.settings;
    settings.scatter = row.scatter;
    (settings.restitution_low, settings.restitution_high) = (low, high);
    scene.drive.second_gain = settings.second_gain;
    scene.drive.second_lag = settings.second_lag;
    scene.sensor.sensitivity *= 1.0 + settings.amplitude_error * (2.0 * noise.uniform() - 1.0);
    let mut closed = EnvelopeLoop::build(&scene).expect("the rows are feeders");
    let mut watches = vec![GearWatch::build(1).expect("order 1 is one"); row.parts];
    let mut all = Estimates::default();
    for cycle in 0..CYCLES {
        if cycle == SETTLING_CYCLES {
            let now = f64::from(cycle) * TAU;
            watches.iter_mut().for_each(|watch| watch.begin(now));
        }
        let report = closed.cycle().report;
        for strike in closed.strikes() {
            add_strike(&mut watches[usize::from(strike.part)], strike);
        }
        if cycle >= SETTLING_CYCLES && report.in_gear_error.is_finite() {
            all.with_estimate += 1.0;
            all.estimate += f64::from(report.in_gear);
            all.error += f64::from(report.in_gear_error);
        }
    }
    let with_estimate = all.with_estimate.max(1.0);
    all.estimate /= with_estimate;
    all.error /= with_estimate;
    for watch in &watches {
        all.truth += watch.share(f64::from(CYCLES) * TAU).share() / row.parts as f64;
    }
    all
}

/// Rows used to choose the constants of the estimator (`set`), or rows for verification only.
pub fn rows(which: &str) -> Vec<Row> {
    let lots: &[([f32; 2], f32, f32)] = if which == "set" {
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
        ]
    } else {
        &[
            ([0.22, 0.22], 0.06, 0.41),
            ([0.33, 0.33], 0.08, 0.45),
            ([0.55, 0.55], 0.05, 0.6),
            ([0.25, 0.25], 0.10, 0.42),
            ([0.4, 0.4], 0.06, 0.5),
            ([0.15, 0.25], 0.05, 0.39),
            ([0.3, 0.4], 0.05, 0.47),
        ]
    };
    let row = |&(lot, scatter, k): &([f32; 2], f32, f32)| {
        [1, 2, 6, 12, 24].map(|parts| Row {
            lot,
            scatter,
            k,
            parts,
        })
    };
    lots.iter().flat_map(row).collect()
}

fn estimate_shares(rows: &[Row], runs: u64, seed: u64) -> Vec<Vec<Estimates>> {
    let first = seed.wrapping_mul(1 << 20);
    let of_row = |row| (first..first + runs).map(|seed| run(row, seed)).collect();
    rows.par_iter().map(of_row).collect()
}

/// Mean error of the estimate over the runs with one, and its standard error.
fn deviation(runs: &[Estimates]) -> [f64; 2] {
    let with_estimate = runs.iter().filter(|run| run.with_estimate > 0.0);
    let count = with_estimate.clone().count().max(1) as f64;
    let differences = with_estimate.map(|run| run.estimate - run.truth);
    let mean = differences.clone().sum::<f64>() / count;
    let square = differences.map(|deviation| deviation * deviation);
    let square = square.sum::<f64>() / count;
    let spread = ((square - mean * mean).max(0.0) / (count - 1.0).max(1.0)).sqrt();
    [mean, spread]
}

/// Rows of the manual's table: one for each lot, with a column for each number of parts.
pub fn table(rows: &[Row], runs: u64, seed: u64) -> Vec<String> {
    let shares = estimate_shares(rows, runs, seed);
    let mut lines = Vec::new();
    let mut first = 0;
    for lot in rows.chunk_by(|a, b| (a.lot, a.scatter, a.k) == (b.lot, b.scatter, b.k)) {
        let shares = &shares[first..first + lot.len()];
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
        let truth = shares[0].iter().map(|run| run.truth).sum::<f64>() / runs as f64;
        let cell = |runs: &Vec<Estimates>| {
            let [mean, spread] = deviation(runs);
            format!("{mean:+.3} ({spread:.3})")
        };
        let cells: Vec<String> = shares.iter().map(cell).collect();
        let told = shares.iter().flatten();
        let told = told.filter(|run| run.with_estimate > 0.0);
        let errors = told.map(|run| run.error);
        let min_error = errors.clone().fold(f64::INFINITY, f64::min);
        let max_error = errors.fold(0.0, f64::max);
        let cells = cells.join(" | ");
        lines.push(format!(
            "| {lot} | {scatter} | {k} | {truth:.2} | {cells} | {min_error:.3}..{max_error:.3} |"
        ));
    }
    lines
}
