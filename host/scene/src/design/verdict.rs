//! Evaluation of a feeder: by simulated parts on the map, and in the closed loop.

use std::ops::Range;

use kband::feeder::OutOfRange;
use kband::transport::convey_from_rest;
use kband_plant::Parts;

use super::feeder::{Feeder, map, scene_of};
use super::table::{Lot, PERIODS};
use super::{CheckStop, Workers};
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
const FRONT_RUNS: Range<u64> = 1000..1032;
const VERDICT_RUNS: Range<u64> = 2000..2064;

/// A small change of a feeder: factors of b and of frequency, and a shift of restitution.
#[derive(Clone, Copy)]
struct Variation {
    amplitude: f64,
    frequency: f64,
    restitution: f64,
}

const NOMINAL: Variation = Variation {
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

/// Duration of a closed-loop run, s; the statistics begin at 5 s.
const DURATION: f64 = 30.0;

/// The lot of a scene, simulated on feeders.
pub(super) struct Trial<'a> {
    pub file: &'a SceneFile,
    pub lot: Lot,
}

impl Trial<'_> {
    /// Share and speed of each feeder with each variation, mean over the parts.
    fn simulate(
        &self,
        feeders: &[Feeder],
        variations: &[Variation],
        runs: Range<u64>,
        workers: &impl Workers,
    ) -> Result<Vec<Conveyed>, Refusal> {
        let scene = &self.file.scene;
        let parts = self.lot.restitutions.len();
        let weight = 1.0 / (runs.end - runs.start) as f64;
        let part = |n: usize| -> Result<Conveyed, OutOfRange> {
            let (point, number) = (n / parts, n % parts);
            let variation = variations[point % variations.len()];
            let feeder = variation.apply(&feeders[point / variations.len()]);
            let draws = (self.lot).draws(number, runs.clone(), variation.restitution)?;
            let map = map(feeder.wave()?, feeder.k)?;
            let amplitude = feeder.amplitude(scene.settings.gravity.into());
            let unit = amplitude * std::f64::consts::TAU * feeder.frequency;
            let mut sum = Conveyed::default();
            let laws = [feeder.law(scene)?];
            convey_from_rest(&map, &laws, &draws, 1, PERIODS, |_, share, speeds| {
                sum.share += weight * share.share();
                sum.speed += weight * unit * speeds[0];
            })?;
            Ok(sum)
        };
        let count = feeders.len() * variations.len() * parts;
        let all = workers.map("front", count, |n, check_stop| {
            check_stop()?;
            Ok(part(n)?)
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

    /// Share and speed of each feeder of a front.
    pub fn front(
        &self,
        feeders: &[Feeder],
        workers: &impl Workers,
    ) -> Result<Vec<Conveyed>, Refusal> {
        self.simulate(feeders, &[NOMINAL], FRONT_RUNS, workers)
    }

    /// Share, speed and their derivatives: central differences with common random numbers.
    pub fn judge(
        &self,
        feeders: &[Feeder],
        workers: &impl Workers,
    ) -> Result<Vec<(Conveyed, Sensitivity)>, Refusal> {
        let variations = variations();
        let all = self.simulate(feeders, &variations, VERDICT_RUNS, workers)?;
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

    /// Closed-loop run of a feeder with the parts of the lot; without `feeder` the scene's own.
    pub fn close(&self, feeder: Option<&Feeder>, stop: CheckStop<'_>) -> Result<Outcome, Refusal> {
        let mut run = self.file.clone();
        if let Some(feeder) = feeder {
            run.scene = scene_of(&self.file.scene, feeder);
        }
        let lot = &self.lot;
        let of_each = |value: f32| lot.restitutions.iter().map(|_| value).collect::<Parts>();
        let scene = &mut run.scene;
        scene.parts = lot.restitutions.iter().map(|r| *r as f32).collect();
        scene.scatter = of_each(lot.scatter as f32);
        scene.masses = of_each(scene.masses.first().copied().unwrap_or(0.0));
        scene.waiting = 0;
        scene.disturbances.clear();
        (run.duration, run.distribution, run.expectation) = (DURATION, None, None);
        Outcome::run(&run, Fidelity::Envelope, Watch::default(), &mut |_| stop())
    }
}

/// Share and speed of a run; `None` if the drive did not run.
pub(super) fn closed(outcome: &Outcome) -> Option<Conveyed> {
    let (share, speed) = (outcome.in_gear()?, 1e3 * outcome.record().speed()?);
    let runs = outcome.k().is_finite();
    runs.then_some(Conveyed { share, speed })
}
