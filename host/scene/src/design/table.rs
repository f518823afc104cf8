//! Table of share in gear and conveying speed on a grid, with interpolation. The share of one lot
//! depends on k and the tones, the speed in `b w` also on eta, phase lead and incline.

use kband::feeder::{OutOfRange, Track, TrackSettings};
use kband::impact::Scatter;
use kband::transport::{WaveLaw, convey_from_rest};
use kband_plant::Scene;

use super::Workers;
use super::feeder::{law, map, wave};
use crate::refusal::Refusal;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axis {
    pub low: f64,
    pub high: f64,
    pub count: usize,
}

impl Axis {
    /// `count` values, or one if the ends are equal.
    pub fn new([low, high]: [f64; 2], count: usize) -> Self {
        let count = if low < high { count } else { 1 };
        Self { low, high, count }
    }

    fn value(&self, n: usize) -> f64 {
        self.low + (self.high - self.low) * n as f64 / (self.count.max(2) - 1) as f64
    }

    /// The node below a value, and the fraction of the distance to the next; clamped to the ends.
    fn place(&self, value: f64) -> (usize, f64) {
        if self.count < 2 {
            return (0, 0.0);
        }
        let steps = (self.count - 1) as f64;
        let position = ((value - self.low) / (self.high - self.low) * steps).clamp(0.0, steps);
        let node = (position as usize).min(self.count - 2);
        (node, position - node as f64)
    }
}

pub(super) struct Lot {
    pub restitutions: Vec<f64>,
    /// Standard deviation from impact to impact.
    pub scatter: f64,
    pub seed: u64,
}

/// Drive periods of a run; the last three quarters count.
pub(super) const PERIODS: f64 = 250.0;

impl Lot {
    /// Random restitutions of one part, a seed for each of `runs`. All points have the same draws.
    pub fn draws(
        &self,
        part: usize,
        runs: std::ops::Range<u64>,
        shift: f64,
    ) -> Result<Vec<Scatter>, OutOfRange> {
        let mean = (self.restitutions[part] + shift).clamp(0.0, 1.0);
        let draw = |run| {
            let seed = self.seed.rotate_left(20) ^ (part as u64) << 40 ^ run;
            Scatter::build(mean, self.scatter, seed)
        };
        runs.map(draw).collect()
    }
}

/// Axes of the table: k, e, th, e3; eta, phase lead in degrees, tangent of the incline.
pub(super) type Axes = [Axis; 7];
const SHARE_AXES: usize = 4;
/// Runs of each part at a node; fewer for many laws of motion along the track.
const RUNS: [u64; 2] = [12, 4];
const MANY_LAWS: usize = 10;
/// Angle of the third tone in rad, by a random search (docs/theory-real-parts.md#t10.3).
pub(super) const THIRD_TONE_ANGLE: f64 = 5.3;

/// Shares and speeds at the nodes, the last axis fastest.
pub(super) struct Table {
    pub axes: Axes,
    shares: Vec<f32>,
    speeds: Vec<f32>,
}

impl Table {
    pub fn compute(
        scene: &Scene,
        lot: &Lot,
        axes: Axes,
        workers: &impl Workers,
    ) -> Result<Self, Refusal> {
        let [k, e, th, e3, ..] = axes;
        let counts = axes.map(|axis| axis.count);
        let of_share: usize = counts[..SHARE_AXES].iter().product();
        let of_speed: usize = counts[SHARE_AXES..].iter().product();
        let runs = RUNS[usize::from(of_speed > MANY_LAWS)];
        let nodes = workers.map("table", of_share, |n, check_stop| {
            let mut rest = n;
            let [e3, th, e, k] = [e3, th, e, k].map(|axis: Axis| {
                let value = axis.value(rest % axis.count);
                rest /= axis.count;
                value
            });
            let wave = wave([[e, th], [e3, THIRD_TONE_ANGLE]])?;
            let laws = laws(scene, &axes, |track| law(scene, &wave, k, track))?;
            let map = map(wave, k)?;
            let (mut share, mut speeds) = (0.0, vec![0.0; laws.len()]);
            let weight = 1.0 / (lot.restitutions.len() as f64 * runs as f64);
            for part in 0..lot.restitutions.len() {
                check_stop()?;
                let draws = lot.draws(part, 0..runs, 0.0)?;
                convey_from_rest(&map, &laws, &draws, 1, PERIODS, |_, of_run, ways| {
                    share += weight * of_run.share();
                    for (sum, speed) in speeds.iter_mut().zip(ways) {
                        *sum += weight * speed;
                    }
                })?;
            }
            Ok((share as f32, speeds))
        })?;
        let mut table = Self {
            axes,
            shares: Vec::with_capacity(of_share),
            speeds: Vec::with_capacity(of_share * of_speed),
        };
        for (share, speeds) in nodes {
            table.shares.push(share);
            let speeds = speeds.iter().map(|speed| *speed as f32);
            table.speeds.extend(speeds);
        }
        Ok(table)
    }

    /// Share in gear and speed in `b w` at a point, by multilinear interpolation.
    pub fn at(&self, point: [f64; 7]) -> (f64, f64) {
        let mut corners = [(0_usize, 1.0); 1 << 7];
        let mut used = 1;
        let mut shared = 0.0;
        for (n, (axis, value)) in self.axes.iter().zip(point).enumerate() {
            let (node, part) = axis.place(value);
            for corner in &mut corners[..used] {
                corner.0 = corner.0 * axis.count + node;
            }
            if axis.count > 1 && part > 0.0 {
                for corner in 0..used {
                    let (index, weight) = corners[corner];
                    corners[corner].1 = weight * (1.0 - part);
                    corners[used + corner] = (index + 1, weight * part);
                }
                used *= 2;
            }
            if n + 1 == SHARE_AXES {
                shared = weighted(&corners[..used], &self.shares);
            }
        }
        (shared, weighted(&corners[..used], &self.speeds))
    }
}

fn weighted(corners: &[(usize, f64)], values: &[f32]) -> f64 {
    let parts = corners.iter();
    let parts = parts.map(|(index, weight)| weight * f64::from(values[*index]));
    parts.sum()
}

/// Laws of motion at every node of the last axes.
fn laws(
    scene: &Scene,
    axes: &Axes,
    law: impl Fn(&Track) -> Result<WaveLaw, OutOfRange>,
) -> Result<Vec<WaveLaw>, OutOfRange> {
    let [.., ratio, lead, tangent] = axes;
    let law = |n: usize| {
        law(&Track::build(TrackSettings {
            frequency: scene.settings.frequency.into(),
            incline: tangent.value(n % tangent.count).atan().to_degrees(),
            amplitude_ratio: ratio.value(n / tangent.count / lead.count),
            phase_lead: lead.value(n / tangent.count % lead.count),
            gravity: scene.settings.gravity.into(),
        })?)
    };
    let count = ratio.count * lead.count * tangent.count;
    (0..count).map(law).collect()
}
