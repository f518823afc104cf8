//! Many runs of one scene with what differs from part to part and drive to drive drawn anew.

use kband::arithmetic::Noise;
use kband_control::{State, Target};

use kband_scene::{Distribution, Fidelity, Outcome, SceneFile, Watch};

use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::{Table, columns, fields};

/// What came of one run.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Restitution drawn for the first part.
    pub restitution: f32,
    /// True sensitivity of the accelerometer over the configured one.
    pub sensitivity: f32,
    /// Kicks that it took.
    pub attempts: u8,
    /// What the parts really did at the end.
    pub regime: String,
    /// State at the end.
    pub state: State,
    /// When the wanted state was reached for good, in s, where the parts really were in it.
    pub reached: Option<f64>,
    /// Amplitude b at the end in m.
    pub amplitude: f64,
    /// k at the end.
    pub k: f64,
    /// Share of time in gear from [`SETTLED`](super::SETTLED) on, mean over the parts; `None` where
    /// it was shorter.
    pub in_gear: Option<f64>,
    /// Estimated share of time in gear, mean over the cycles with an estimate; `None` without one.
    pub in_gear_estimated: Option<f64>,
    /// Share of the cycles with an estimate.
    pub in_gear_coverage: Option<f64>,
    /// Mean conveying speed from [`SETTLED`](super::SETTLED) on in m/s, or at the end of a shorter
    /// run.
    pub speed: f64,
}

fields! {
    /// A run and its number.
    pub fn rows(of: (usize, Run)) {
        all RUN => of.0;
        all RESTITUTION => f64::from(of.1.restitution);
        all SENSOR_SENSITIVITY => f64::from(of.1.sensitivity);
        all REACHED => of.1.reached;
        all KICKS => u32::from(of.1.attempts);
        all B => of.1.amplitude * 1e3;
        all K => Some(of.1.k).filter(|k| k.is_finite());
        all IN_GEAR => of.1.in_gear;
        all IN_GEAR_ESTIMATED => of.1.in_gear_estimated;
        all IN_GEAR_COVERAGE => of.1.in_gear_coverage;
        all SPEED => of.1.speed * 1e3;
        all STATE.words() => of.1.state.name();
        all REGIME.words() => of.1.regime.clone();
    }
}

/// The runs of one way to control.
#[derive(Clone, Debug, PartialEq)]
pub struct Runs {
    /// How it was controlled.
    pub name: &'static str,
    /// One after the other.
    pub runs: Vec<Run>,
}

impl Runs {
    /// `count` runs of `file`, drawn by the scene's seed and the number of the run alone.
    pub fn run(
        name: &'static str,
        file: &SceneFile,
        count: usize,
        fidelity: Fidelity,
        desk: &Desk,
    ) -> Result<Self, Refusal> {
        let runs = desk.try_map(name, count, |n| one(&drawn(file, n as u64), fidelity))?;
        Ok(Self { name, runs })
    }

    /// Runs that have been run.
    pub fn new(name: &'static str, runs: Vec<Run>) -> Self {
        Self { name, runs }
    }

    /// Runs in which the wanted state was reached and real.
    pub fn reached(&self) -> usize {
        self.runs.iter().filter(|run| run.reached.is_some()).count()
    }

    /// Times at which it was, in the order of time.
    pub fn times(&self) -> Vec<f64> {
        let mut times: Vec<f64> = self.runs.iter().filter_map(|run| run.reached).collect();
        times.sort_by(f64::total_cmp);
        times
    }

    /// Time within which so many of 100 runs that reached it had.
    fn time_of(&self, percent: usize) -> Option<f64> {
        let times = self.times();
        times.get(times.len() * percent / 100).copied()
    }

    /// Share of time in gear, mean over the runs; `None` where they were too short.
    pub fn in_gear(&self) -> Option<f64> {
        self.mean(|run| run.in_gear)
    }

    /// Estimated share of time in gear, over the time with an estimate; `None` without one.
    pub fn in_gear_estimated(&self) -> Option<f64> {
        let (mut weighted_share, mut estimated_time) = (0.0, 0.0);
        for run in &self.runs {
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

    fn mean(&self, of: impl Fn(&Run) -> Option<f64>) -> Option<f64> {
        let sum = self.runs.iter().map(of).sum::<Option<f64>>()?;
        (!self.runs.is_empty()).then(|| sum / self.runs.len() as f64)
    }

    /// Share of runs that reached it, and the interval that holds the true share with 95 %
    /// (Wilson).
    pub fn share(&self) -> (f64, f64, f64) {
        let n = self.runs.len().max(1) as f64;
        let p = self.reached() as f64 / n;
        let z = 1.959_964;
        let centre = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
        let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        // At the ends the interval reaches them, whatever rounding says.
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
    // Neighbouring numbers give unrelated streams; 2^32 runs of a seed have their own.
    let mut noise = Noise::new(scene.seed.rotate_left(32).wrapping_add(n));
    let lot = Distribution::Uniform {
        low: settings.restitution_low,
        high: settings.restitution_high,
    };
    let error = settings.amplitude_error;
    drawn
        .distribution
        .unwrap_or(lot)
        .draw_parts(scene, &mut noise);
    scene.sensor.sensitivity *= 1.0 + error * (2.0 * noise.uniform() - 1.0);
    scene.seed = u64::from(noise.bits());
    drawn
}

pub(super) fn one(file: &SceneFile, fidelity: Fidelity) -> Result<Run, Refusal> {
    // Nothing of a single run may print or stop by itself: the desk stops between runs.
    let outcome = Outcome::run(file, fidelity, Watch::default(), &mut |_| Ok(()))?;
    let last = outcome.last();
    let wanted = wanted(file.scene.target);
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
        reached: outcome.reached(wanted).filter(|_| real),
        amplitude: outcome.amplitude(),
        k: outcome.k(),
        in_gear: outcome.in_gear(),
        in_gear_estimated: outcome.record().in_gear_estimated(),
        in_gear_coverage: outcome.record().in_gear_coverage(),
        speed: outcome.record().speed().unwrap_or_else(|| outcome.speed()),
        regime,
    })
}

fn wanted(target: Target) -> State {
    match target {
        Target::Locked { .. } => State::Locked,
        _ => State::Holding,
    }
}

/// The runs as a table, one row each.
pub fn table(all: &[Runs]) -> Table {
    let view = rows();
    let mut columns = vec![columns::CONTROL.words()];
    columns.extend(view.columns());
    let mut table = Table::new(&columns);
    for runs in all {
        for (n, run) in runs.runs.iter().enumerate() {
            let mut row = vec![runs.name.into()];
            row.extend(view.row(&(n, run.clone())));
            table.push_row(row);
        }
    }
    table
}

fields! {
    /// What the runs of one way to control came to.
    pub fn summary(runs: Runs) {
        all CONTROL.words() => runs.name;
        all RUNS => runs.runs.len();
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

/// Draws the share of runs that have reached the wanted state over time.
pub fn draw(all: &[Runs], file: &SceneFile) -> Picture {
    let end = file.duration;
    let mut panel = Panel::new(
        Axis::new("time", "s", 0.0, end),
        Axis::new("runs in the wanted state", "%", -5.0, 105.0),
    );
    for (series, runs) in all.iter().enumerate() {
        let step = 100.0 / runs.runs.len().max(1) as f64;
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
        points.push((end, points[points.len() - 1].1));
        panel = panel.line(runs.name, series, points);
    }
    let settings = &file.scene.settings;
    Picture::new("How soon the parts are where they are wanted")
        .caption(format!(
            "{} runs, R drawn from {}..{}, amplitude error up to {} %, target {}",
            all.first().map_or(0, |runs| runs.runs.len()),
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
        let mut runs = |count, seed, fidelity, threads| {
            let desk = Desk::new(Some(threads)).unwrap();
            file.scene.seed = seed;
            Runs::run("", &file, count, fidelity, &desk).unwrap()
        };
        for fidelity in Fidelity::ALL {
            assert_eq!(runs(6, 3, fidelity, 1), runs(6, 3, fidelity, 3));
        }
        let one = runs(1, 3, Fidelity::Envelope, 1);
        let other = runs(1, 4, Fidelity::Envelope, 1);
        assert_ne!(one.runs[0], other.runs[0]);
        // Of seeds from 2^32 on no digit is lost.
        let large = runs(1, 3 + (1 << 40), Fidelity::Envelope, 1);
        assert_ne!(one.runs[0], large.runs[0]);
    }

    /// R = 0.3, s = 0.05 at k = 0.45: in gear for 0.811 of the time by an independent program
    /// (regime/gear/mod.rs), in the plant of either fidelity, and the same bits for any number of
    /// threads.
    #[test]
    fn the_share_in_gear_agrees_with_the_map_in_both_fidelities() {
        let text = super::super::DEFAULT
            .replace("restitution = [0.18, 0.22]", "restitution = 0.3")
            .replace(
                "scatter = 0.04",
                "actual = [0.3, 0.3, 0.3, 0.3, 0.3, 0.3]\nscatter = 0.05 #",
            );
        let mut file = SceneFile::parse(&text).unwrap();
        file.scene.target = Target::K(0.45);
        file.duration = 60.0;
        for fidelity in Fidelity::ALL {
            let run = |threads| {
                let desk = Desk::new(Some(threads)).unwrap();
                Runs::run("", &file, 3, fidelity, &desk).unwrap()
            };
            let runs = run(1);
            assert_eq!(runs, run(3));
            // 18 parts for 2750 periods each, gear lost every 27 of them: the error of the mean is
            // 0.01.
            let share = runs.in_gear().unwrap();
            assert!((share - 0.811).abs() < 0.03, "{fidelity:?}: {share}");
            assert!(runs.runs[0].in_gear != runs.runs[1].in_gear);
            assert!(
                runs.runs[0].regime.starts_with("in gear 0.8"),
                "{:?}",
                runs.runs[0]
            );
        }
        // Without scatter it is the lock or nothing; in lock, always.
        file.scene.scatter.clear();
        file.scene.target = Target::Locked { order: 1 };
        file.duration = 10.0;
        let desk = Desk::new(Some(1)).unwrap();
        let runs = Runs::run("", &file, 1, Fidelity::Envelope, &desk).unwrap();
        assert!(runs.in_gear().unwrap() > 0.9, "{runs:?}");
    }

    #[test]
    fn the_interval_of_a_share_holds_it_and_stays_within_0_and_1() {
        let run = |reached| Run {
            restitution: 0.2,
            sensitivity: 1.0,
            attempts: 1,
            regime: String::new(),
            state: State::Locked,
            reached,
            amplitude: 0.0,
            k: 0.0,
            in_gear: None,
            in_gear_estimated: None,
            in_gear_coverage: None,
            speed: 0.0,
        };
        let runs = Runs {
            name: "",
            runs: (0..100).map(|n| run((n < 90).then_some(1.0))).collect(),
        };
        let (share, low, high) = runs.share();
        // Wilson's interval for 90 of 100 (Brown, Cai & DasGupta 2001): 0.826..0.945.
        assert!(
            (share - 0.9).abs() < 1e-12
                && (low - 0.8256).abs() < 1e-3
                && (high - 0.9448).abs() < 1e-3
        );
        let none = Runs {
            name: "",
            runs: vec![run(None)],
        };
        assert_eq!(none.share().1, 0.0);
    }
}
