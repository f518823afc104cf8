//! Evaluation of a feeder: by simulated parts on the map, and in the closed loop.

use kband::feeder::OutOfRange;
use kband::transport::convey_from_rest;
use kband_plant::Parts;

use super::Workers;
use super::feeder::{Feeder, map, scene_of};
use super::table::{Lot, PERIODS};
use crate::engine::Fidelity;
use crate::outcome::Outcome;
use crate::record::Watch;
use crate::refusal::Refusal;
use crate::scene::SceneFile;

/// Share in gear and speed of a lot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conveyed {
    /// Share of time in gear, mean over the parts, 0..=1.
    pub share: f64,
    /// Mean conveying speed in mm/s, positive upwards.
    pub speed: f64,
}

/// Changes of ln(parts a minute) and of the share in gear.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensitivity {
    /// For one percent more amplitude b.
    pub amplitude: [f64; 2],
    /// For one percent more frequency at the same b.
    pub frequency: [f64; 2],
    /// For a restitution larger by 0.01.
    pub restitution: [f64; 2],
}

/// Numbers of the runs for the front and the shown feeders: selection biases those of the table.
pub(super) const FRONT_RUNS: std::ops::Range<u64> = 1000..1032;
const VERDICT_RUNS: std::ops::Range<u64> = 2000..2064;

/// A small change of a feeder: factors of b and of frequency, and a shift of restitution.
#[derive(Clone, Copy)]
pub(super) struct Variation {
    amplitude: f64,
    frequency: f64,
    restitution: f64,
}

pub(super) const NOMINAL: Variation = Variation {
    amplitude: 1.0,
    frequency: 1.0,
    restitution: 0.0,
};

/// Relative step of the derivatives by b and frequency, and step by restitution.
const RELATIVE_STEP: f64 = 0.02;
const RESTITUTION_STEP: f64 = 0.01;

fn variations() -> [Variation; 7] {
    let mut all = [NOMINAL; 7];
    for (n, sign) in [-1.0, 1.0].into_iter().enumerate() {
        all[1 + n].amplitude += sign * RELATIVE_STEP;
        all[3 + n].frequency += sign * RELATIVE_STEP;
        all[5 + n].restitution += sign * RESTITUTION_STEP;
    }
    all
}

impl Variation {
    fn apply(&self, feeder: &Feeder) -> Feeder {
        Feeder {
            frequency: feeder.frequency * self.frequency,
            k: feeder.k / (self.amplitude * self.frequency * self.frequency),
            ..*feeder
        }
    }
}

fn part(
    file: &SceneFile,
    lot: &Lot,
    feeder: &Feeder,
    number: usize,
    runs: std::ops::Range<u64>,
    shift: f64,
) -> Result<Conveyed, OutOfRange> {
    let weight = 1.0 / (runs.end - runs.start) as f64;
    let draws = lot.draws(number, runs, shift)?;
    let map = map(feeder.wave()?, feeder.k)?;
    let amplitude = feeder.amplitude(file.scene.settings.gravity.into());
    let unit = amplitude * std::f64::consts::TAU * feeder.frequency;
    let mut sum = Conveyed::default();
    let laws = [feeder.law(&file.scene)?];
    convey_from_rest(&map, &laws, &draws, 1, PERIODS, |_, share, speeds| {
        sum.share += weight * share.share();
        sum.speed += weight * unit * speeds[0];
    })?;
    Ok(sum)
}

/// Share and speed of each feeder with each variation, mean over the parts.
pub(super) fn simulate(
    file: &SceneFile,
    lot: &Lot,
    feeders: &[Feeder],
    variations: &[Variation],
    runs: std::ops::Range<u64>,
    workers: &impl Workers,
) -> Result<Vec<Conveyed>, Refusal> {
    let parts = lot.restitutions.len();
    let count = feeders.len() * variations.len() * parts;
    let all = workers.map("front", count, |n, check_stop| {
        check_stop()?;
        let (point, number) = (n / parts, n % parts);
        let variation = variations[point % variations.len()];
        let feeder = variation.apply(&feeders[point / variations.len()]);
        let (runs, shift) = (runs.clone(), variation.restitution);
        Ok(part(file, lot, &feeder, number, runs, shift)?)
    })?;
    let mean = |parts: &[Conveyed]| {
        let weight = 1.0 / parts.len() as f64;
        parts.iter().fold(Conveyed::default(), |sum, run| Conveyed {
            share: sum.share + weight * run.share,
            speed: sum.speed + weight * run.speed,
        })
    };
    Ok(all.chunks(parts).map(mean).collect())
}

/// Share, speed and their derivatives: central differences with common random numbers.
pub(super) fn judge(
    file: &SceneFile,
    lot: &Lot,
    feeders: &[Feeder],
    workers: &impl Workers,
) -> Result<Vec<(Conveyed, Sensitivity)>, Refusal> {
    let variations = variations();
    let all = simulate(file, lot, feeders, &variations, VERDICT_RUNS, workers)?;
    let judged = all.chunks(variations.len()).map(|points| {
        let by = |n: usize, steps: f64| {
            let (less, more) = (points[n], points[n + 1]);
            let changes = [(more.speed / less.speed).ln(), more.share - less.share];
            changes.map(|change| change / (2.0 * steps))
        };
        let percent = 100.0 * RELATIVE_STEP;
        let sensitivity = Sensitivity {
            amplitude: by(1, percent),
            frequency: by(3, percent),
            restitution: by(5, 1.0),
        };
        (points[0], sensitivity)
    });
    Ok(judged.collect())
}

/// Duration of a closed-loop run, s; the statistics begin at 5 s.
const DURATION: f64 = 30.0;

/// Closed-loop run of a feeder with the parts of the lot; without `feeder` the scene's own.
pub(super) fn close(
    file: &SceneFile,
    lot: &Lot,
    feeder: Option<&Feeder>,
    check_stop: &dyn Fn() -> Result<(), Refusal>,
) -> Result<Outcome, Refusal> {
    let mut run = file.clone();
    if let Some(feeder) = feeder {
        run.scene = scene_of(&file.scene, feeder);
    }
    let of_each = |value: f32| lot.restitutions.iter().map(|_| value).collect::<Parts>();
    let scene = &mut run.scene;
    scene.parts = lot.restitutions.iter().map(|r| *r as f32).collect();
    scene.scatter = of_each(lot.scatter as f32);
    scene.masses = of_each(scene.masses.first().copied().unwrap_or(0.0));
    scene.waiting = 0;
    scene.disturbances.clear();
    (run.duration, run.distribution, run.expectation) = (DURATION, None, None);
    let mut check = |_| check_stop();
    Outcome::run(&run, Fidelity::Envelope, Watch::default(), &mut check)
}

/// Share and speed of a run; `None` if the drive did not run.
pub(super) fn closed(outcome: &Outcome) -> Option<Conveyed> {
    let (share, speed) = (outcome.in_gear()?, 1e3 * outcome.record().speed()?);
    let runs = outcome.k().is_finite();
    runs.then_some(Conveyed { share, speed })
}
