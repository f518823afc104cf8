//! Share of time in gear, 0..1, over a grid of k and waves, and the best points.
//!
//! Monte Carlo simulation with common random numbers. Fresh runs select the best points; further
//! ones estimate their shares, because selection biases a share upwards (winner's curse).

use std::ops::Range;

use kband::feeder::Restitution;
use kband::impact::{ContactTime, Scatter, Wave, WaveMap};
use kband::regime::gear::{Share, shares_from_rest};
use kband_scene::restitutions;

use super::super::common_band;
use crate::desk::Desk;
use crate::refusal::Result;

/// Parts whose restitution scatters, and their runs.
#[derive(Clone, Copy)]
pub(in crate::verbs) struct Lot {
    pub restitution: Restitution,
    /// Number of parts of the lot, including both ends.
    pub parts: usize,
    pub scatter: f64,
    pub order: u32,
    pub runs: usize,
    pub periods: f64,
    pub seed: u64,
    pub contact: ContactTime,
}

/// Stages of the search, each with fresh runs: the whole map, its best points, the named points.
/// Each has four times as many runs of a point as the one before.
#[derive(Clone, Copy)]
enum Stage {
    Map,
    Choice,
    Verdict,
}

/// Number of runs of a point in a stage, over that of the map.
fn effort(stage: Stage) -> usize {
    4_usize.pow(stage as u32)
}

pub(super) struct Shares(pub Vec<Share>);

impl Shares {
    pub fn mean(&self) -> f64 {
        self.0.iter().map(Share::share).sum::<f64>() / self.0.len() as f64
    }

    pub fn min_share(&self) -> f64 {
        self.0.iter().map(Share::share).fold(1.0, f64::min)
    }

    pub fn sum(&self) -> Share {
        let zero = Share::default();
        self.0.iter().fold(zero, |sum, share| sum.plus(share))
    }
}

pub(super) struct Point {
    pub name: &'static str,
    pub wave: Wave,
    pub k: f64,
    pub shares: Shares,
}

pub(super) struct Survey {
    pub lot: Lot,
    pub k: Vec<f64>,
    pub waves: Vec<Wave>,
    /// Mean and smallest share of the parts for each wave at each k, wave by wave.
    pub map: Vec<[f64; 2]>,
    /// The best points on one tone and on several, and the middle of the band, if there is one.
    pub points: Vec<Point>,
}

/// Number of points of the map that are simulated again, for each number of tones.
const REFINED_POINTS: usize = 16;

impl Lot {
    pub(super) fn restitutions(&self) -> Vec<f64> {
        restitutions(self.restitution, self.parts)
    }

    /// Simulates every part at one point.
    fn simulate(&self, wave: &Wave, k: f64, stage: Stage) -> Result<Shares> {
        let mut shares = Shares(vec![Share::default(); self.restitutions().len()]);
        self.add_runs(&mut shares, wave, k, stage, 0..self.runs * effort(stage))?;
        Ok(shares)
    }

    /// Adds these runs of every part. The seed depends only on part, run and stage.
    fn add_runs(
        &self,
        Shares(shares): &mut Shares,
        wave: &Wave,
        k: f64,
        stage: Stage,
        runs: Range<usize>,
    ) -> Result<()> {
        let restitutions = self.restitutions();
        let mut scatters = Vec::with_capacity(runs.len() * restitutions.len());
        for (part, &restitution) in restitutions.iter().enumerate() {
            for run in runs.clone() {
                let number = (stage as u64) << 48 | (part as u64) << 32 | run as u64;
                let seed = self.seed.rotate_left(20) ^ number;
                scatters.push(Scatter::build(restitution, self.scatter, seed)?);
            }
        }
        let map = WaveMap::on(*wave, k, restitutions[0])?;
        let add = |n: usize, share: Share| {
            let part = n / runs.len();
            shares[part] = shares[part].plus(&share);
        };
        Ok(shares_from_rest(
            &map,
            self.contact,
            &scatters,
            self.order,
            self.periods,
            add,
        )?)
    }

    /// Mean and smallest share of the parts. If no part was ever in gear in half of the runs, the
    /// others are left out.
    pub fn at(&self, wave: &Wave, k: f64) -> Result<[f64; 2]> {
        let half = self.runs.div_ceil(2);
        let mut shares = Shares(vec![Share::default(); self.restitutions().len()]);
        self.add_runs(&mut shares, wave, k, Stage::Map, 0..half)?;
        if shares.mean() > 0.0 {
            self.add_runs(&mut shares, wave, k, Stage::Map, half..self.runs)?;
        }
        Ok([shares.mean(), shares.min_share()])
    }

    /// Simulated drive periods of each part at a named point.
    pub(super) fn run_periods(&self) -> f64 {
        0.75 * self.periods * (self.runs * effort(Stage::Verdict)) as f64
    }
}

impl Survey {
    /// The map over `k` and `waves`; the sine is the first of at least two. On one tone the named
    /// point is at `planned`, the controller's setpoint, if the map contains it.
    pub fn run(
        lot: Lot,
        k: &[f64],
        waves: &[Wave],
        planned: Option<f64>,
        desk: &Desk,
    ) -> Result<Self> {
        let place = |n: usize| (&waves[n / k.len()], k[n % k.len()]);
        let map = desk.try_map("gear", waves.len() * k.len(), |n| {
            let (wave, k) = place(n);
            lot.at(wave, k)
        })?;
        let verdict = |name: &'static str, wave: &Wave, k: f64| -> Result<Point> {
            let shares = lot.simulate(wave, k, Stage::Verdict)?;
            Ok(Point {
                name,
                wave: *wave,
                k,
                shares,
            })
        };
        let best = |name: &'static str, points: Range<usize>| {
            let mut order: Vec<usize> = points.collect();
            order.sort_by(|&a, &b| map[b][0].total_cmp(&map[a][0]));
            order.truncate(REFINED_POINTS);
            let repeated = desk.try_map("best points", order.len(), |n| {
                let (wave, k) = place(order[n]);
                Ok(lot.simulate(wave, k, Stage::Choice)?.mean())
            })?;
            let worse_first = |a: &usize, b: &usize| repeated[*a].total_cmp(&repeated[*b]);
            let best = (0..order.len()).rev().max_by(worse_first).unwrap_or(0);
            let (wave, k) = place(order[best]);
            verdict(name, wave, k)
        };
        let on_sine = |name, k| verdict(name, &Wave::sine(), k);
        let one_tone = match planned {
            Some(k_planned) if k[0] <= k_planned && k_planned <= k[k.len() - 1] => {
                on_sine("one tone", k_planned)?
            }
            _ => best("one tone", 0..k.len())?,
        };
        let three = waves.iter().any(|wave| wave.third().amplitude > 0.0);
        let two = if three { "three tones" } else { "two tones" };
        let mut points = vec![one_tone, best(two, k.len()..waves.len() * k.len())?];
        if let Ok(band) = common_band(lot.restitution, lot.order, lot.contact)? {
            points.push(on_sine("middle of the band", band.setpoint())?);
        }
        Ok(Self {
            lot,
            k: k.to_vec(),
            waves: waves.to_vec(),
            map,
            points,
        })
    }

    /// Number of the wave of the point on two tones.
    pub fn best_wave(&self) -> usize {
        let is_best = |wave: &Wave| *wave == self.points[1].wave;
        self.waves.iter().position(is_best).unwrap_or(0)
    }

    pub fn over_k(&self, wave: usize) -> impl Iterator<Item = (f64, f64)> + '_ {
        let count = self.k.len();
        (0..count).map(move |n| (self.k[n], self.map[wave * count + n][0]))
    }
}
