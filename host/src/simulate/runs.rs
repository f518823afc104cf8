//! Many runs of one scene with random parts, amplitude error and noise.

use kband::arithmetic::Noise;
use kband_control::{State, Target};

use kband_scene::{Distribution, Fidelity, Outcome, SceneFile, Watch};

use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::Result;
use crate::report::{Column, Table, Value, fields, finite};

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Run {
    /// Restitution drawn for the first part.
    pub restitution: f32,
    /// True sensitivity of the accelerometer over the configured one.
    pub sensitivity: f32,
    pub attempts: u8,
    pub regime: String,
    pub state: State,
    /// Time in s at which the requested state was entered and held to the end.
    pub reached: Option<f64>,
    /// Amplitude b at the end in m.
    pub amplitude: f64,
    pub k: f64,
    /// Simulated share of time in gear from 5 s on, mean over the parts, if the run was longer.
    pub in_gear: Option<f64>,
    /// Estimated share of time in gear, mean over the cycles with an estimate; `None` without one.
    pub in_gear_estimated: Option<f64>,
    /// Share of the cycles with an estimate.
    pub in_gear_coverage: Option<f64>,
    /// Mean conveying speed from 5 s on in m/s; of the end, for a shorter run.
    pub speed: f64,
}

fields! {
    pub fn rows(row: (usize, Run)) {
        all RUN => row.0;
        all RESTITUTION => f64::from(row.1.restitution);
        all SENSOR_SENSITIVITY => f64::from(row.1.sensitivity);
        all REACHED => row.1.reached;
        all KICKS => u32::from(row.1.attempts);
        all B => row.1.amplitude * 1e3;
        all K => finite(row.1.k);
        all IN_GEAR => row.1.in_gear;
        all IN_GEAR_ESTIMATED => row.1.in_gear_estimated;
        all IN_GEAR_COVERAGE => row.1.in_gear_coverage;
        all SPEED => row.1.speed * 1e3;
        all STATE.text() => row.1.state.name();
        all REGIME.text() => row.1.regime.clone();
    }
}

/// Runs of one scene, in order.
#[derive(Clone, Debug, PartialEq)]
pub struct Runs(pub Vec<Run>);

impl Runs {
    /// `count` runs of `file`, drawn by the scene's seed and the number of the run.
    pub fn run(file: &SceneFile, count: usize, fidelity: Fidelity, desk: &Desk) -> Result<Self> {
        let run = |n| run_one(&drawn(file, n as u64), fidelity);
        desk.try_map("runs", count, run).map(Self)
    }

    /// Number of runs that reached the requested state.
    pub fn reached(&self) -> usize {
        self.0.iter().filter(|run| run.reached.is_some()).count()
    }

    /// Times in s at which they reached it, ascending.
    pub fn times(&self) -> Vec<f64> {
        let mut times: Vec<f64> = self.0.iter().filter_map(|run| run.reached).collect();
        times.sort_by(f64::total_cmp);
        times
    }

    /// Time in s within which this percentage of those runs reached it.
    pub(super) fn time_of(&self, percent: usize) -> Option<f64> {
        let times = self.times();
        times.get(times.len() * percent / 100).copied()
    }

    /// Share of time in gear, mean over the runs; `None` if one was too short.
    pub fn in_gear(&self) -> Option<f64> {
        self.mean(|run| run.in_gear)
    }

    /// Estimated share of time in gear, over the time with an estimate; `None` without one.
    pub fn in_gear_estimated(&self) -> Option<f64> {
        let (mut weighted_share, mut estimated_time) = (0.0, 0.0);
        for run in &self.0 {
            if let (Some(share), Some(time)) = (run.in_gear_estimated, run.in_gear_coverage) {
                weighted_share += share * time;
                estimated_time += time;
            }
        }
        (estimated_time > 0.0).then(|| weighted_share / estimated_time)
    }

    /// Share of the time from 5 s on with an estimate.
    pub fn in_gear_coverage(&self) -> Option<f64> {
        self.mean(|run| run.in_gear_coverage)
    }

    /// Mean conveying speed over the runs in m/s; `None` without runs.
    pub fn speed(&self) -> Option<f64> {
        self.mean(|run| Some(run.speed))
    }

    fn mean(&self, value: impl Fn(&Run) -> Option<f64>) -> Option<f64> {
        let sum = self.0.iter().map(value).sum::<Option<f64>>()?;
        (!self.0.is_empty()).then(|| sum / self.0.len() as f64)
    }

    /// Share of runs that reached it, and its 95 % confidence interval (Wilson).
    pub fn share(&self) -> (f64, f64, f64) {
        let n = self.0.len().max(1) as f64;
        let p = self.reached() as f64 / n;
        let z = 1.959_964;
        let centre = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
        let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        // The interval includes 0 and 1 in spite of rounding.
        let low = if p == 0.0 { 0.0 } else { centre - half };
        let high = if p == 1.0 { 1.0 } else { centre + half };
        (p, low.max(0.0), high.min(1.0))
    }
}

/// The scene of run `n`: parts, amplitude error and noise drawn.
pub(super) fn drawn(file: &SceneFile, n: u64) -> SceneFile {
    let mut drawn = file.clone();
    let scene = &mut drawn.scene;
    let settings = &scene.settings;
    // Neighbouring numbers give unrelated streams; seeds share none for up to 2^32 runs.
    let mut noise = Noise::new(scene.seed.rotate_left(32).wrapping_add(n));
    let lot = Distribution::Uniform {
        low: settings.restitution_low,
        high: settings.restitution_high,
    };
    let error = settings.amplitude_error;
    let distribution = drawn.distribution.unwrap_or(lot);
    distribution.draw_parts(scene, &mut noise);
    scene.sensor.sensitivity *= 1.0 + error * (2.0 * noise.uniform() - 1.0);
    scene.seed = u64::from(noise.bits());
    drawn
}

pub(super) fn run_one(file: &SceneFile, fidelity: Fidelity) -> Result<Run> {
    // A single run neither prints nor stops by itself: the desk stops between runs.
    let outcome = Outcome::run(file, fidelity, Watch::default(), &mut |_| Ok(()))?;
    let last = outcome.last();
    let target_state = target_state(file.scene.target);
    let regime = outcome.regime();
    let real = match file.scene.target {
        Target::Locked { order } => regime == format!("locked, order {order}"),
        _ => true,
    };
    Ok(Run {
        restitution: file.scene.parts[0],
        sensitivity: file.scene.sensor.sensitivity,
        attempts: last.attempts,
        state: last.state,
        reached: outcome.reached(target_state).filter(|_| real),
        amplitude: outcome.amplitude(),
        k: outcome.k(),
        in_gear: outcome.in_gear(),
        in_gear_estimated: outcome.record().in_gear_estimated(),
        in_gear_coverage: outcome.record().in_gear_coverage(),
        speed: outcome.record().speed().unwrap_or_else(|| outcome.speed()),
        regime,
    })
}

fn target_state(target: Target) -> State {
    match target {
        Target::Locked { .. } => State::Locked,
        _ => State::Holding,
    }
}

pub fn table(runs: &Runs) -> Table {
    table_of(Vec::new(), std::iter::once((Vec::new(), runs)))
}

/// A row for each run, which begins with the cells of its block under `columns`.
pub(super) fn table_of<'a>(
    mut columns: Vec<Column>,
    blocks: impl Iterator<Item = (Vec<Value>, &'a Runs)>,
) -> Table {
    let view = rows();
    columns.extend(view.columns());
    let mut table = Table::new(&columns);
    for (cells, runs) in blocks {
        for (n, run) in runs.0.iter().enumerate() {
            let mut row = cells.clone();
            row.extend(view.row(&(n, run.clone())));
            table.push_row(row);
        }
    }
    table
}

fields! {
    pub fn summary(runs: Runs) {
        all RUNS => runs.0.len();
        all RUNS_REACHED.titled("reached") => runs.reached();
        all SHARE.digits(4) => runs.share().0;
        all LOW_95.digits(4) => runs.share().1;
        all HIGH_95.digits(4) => runs.share().2;
        all MEDIAN_TIME.titled("median (s)").digits(3) => runs.time_of(50);
        all SLOWEST_TIME.titled("slowest 5 % (s)").digits(3) => runs.time_of(95);
        all IN_GEAR.digits(3) => runs.in_gear();
        all IN_GEAR_ESTIMATED.digits(3) => runs.in_gear_estimated();
        all IN_GEAR_COVERAGE.digits(3) => runs.in_gear_coverage();
        all SPEED.digits(4) => runs.speed().map(|speed| 1e3 * speed);
    }
}

/// Draws the share of runs that reached the requested state over time.
pub fn draw(runs: &Runs, file: &SceneFile) -> Picture {
    let share = Axis::new("runs in the wanted state", "%", -5.0, 105.0);
    let step = 100.0 / runs.0.len().max(1) as f64;
    let mut points = vec![(0.0, 0.0)];
    let times = runs.times();
    let stride = times.len().div_ceil(400).max(1);
    for (n, time) in times.iter().enumerate() {
        if n % stride == 0 || n + 1 == times.len() {
            let (x, y) = (*time, (n + 1) as f64 * step);
            points.push((x, points[points.len() - 1].1));
            points.push((x, y));
        }
    }
    points.push((file.duration, points[points.len() - 1].1));
    let panel = Panel::new(Axis::new("time", "s", 0.0, file.duration), share).line("", 0, points);
    let settings = &file.scene.settings;
    Picture::new("How soon the parts are where they are wanted")
        .caption(format!(
            "{} runs, R drawn from {}..{}, amplitude error up to {} %, target {}",
            runs.0.len(),
            settings.restitution_low,
            settings.restitution_high,
            settings.amplitude_error * 100.0,
            super::describe(file.scene.target)
        ))
        .panel(panel)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_depends_on_its_number_and_the_seed_alone() {
        let mut file = SceneFile::parse(super::super::DEFAULT).unwrap();
        file.duration = 4.0;
        let desk = Desk::new(Some(2));
        let mut runs = |count, seed| {
            file.scene.seed = seed;
            Runs::run(&file, count, Fidelity::Envelope, &desk)
                .unwrap()
                .0
        };
        let one = runs(1, 3);
        assert_eq!(runs(6, 3)[..1], one);
        // Seeds from 2^32 on keep all their digits.
        for other in [4, 3 + (1 << 40)] {
            assert_ne!(one, runs(1, other));
        }
    }

    /// R = 0.3, s = 0.05 at k = 0.45: share in gear 0.811 by an independent program
    /// (regime/gear/mod.rs). Any number of threads gives the same bits.
    #[test]
    fn the_share_in_gear_agrees_with_the_map_in_both_fidelities() {
        let actual = "actual = [0.3, 0.3, 0.3, 0.3, 0.3, 0.3]\nscatter = 0.05 #";
        let text = super::super::DEFAULT.replace("scatter = 0.04", actual);
        let text = text.replace("restitution = [0.18, 0.22]", "restitution = 0.3");
        let mut file = SceneFile::parse(&text).unwrap();
        file.scene.target = Target::K(0.45);
        file.duration = 60.0;
        for fidelity in Fidelity::ALL {
            let run = |threads| {
                let desk = Desk::new(Some(threads));
                Runs::run(&file, 3, fidelity, &desk).unwrap()
            };
            let runs = run(1);
            assert_eq!(runs, run(3));
            // 18 parts for 2750 periods, a loss every 27: the standard error of the mean is 0.01.
            let share = runs.in_gear().unwrap();
            assert!((share - 0.811).abs() < 0.03, "{fidelity:?}: {share}");
            assert!(runs.0[0].in_gear != runs.0[1].in_gear);
            let first = &runs.0[0];
            assert!(first.regime.starts_with("in gear 0.8"), "{first:?}");
        }
    }

    #[test]
    fn the_interval_of_a_share_holds_it_and_stays_within_0_and_1() {
        let run = |reached| Run {
            reached,
            ..Run::default()
        };
        let share_of = |runs| Runs(runs).share();
        let runs = (0..100).map(|n| run((n < 90).then_some(1.0)));
        let (share, low, high) = share_of(runs.collect());
        // Wilson's interval for 90 of 100 (Brown, Cai & DasGupta 2001): 0.826..0.945.
        assert!((share - 0.9).abs() < 1e-12);
        assert!((low - 0.8256).abs() < 1e-3 && (high - 0.9448).abs() < 1e-3);
        assert_eq!(share_of(vec![run(None)]).1, 0.0);
    }
}
