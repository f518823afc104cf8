//! Estimates the restitution that best explains the averaged chatter, by the smallest residual.
//!
//! All impacts of a part ring in the same way, with a height proportional to speed. So an average
//! is one unknown ringing at the times and strengths that k and R predict. Method: separable
//! nonlinear least squares (variable projection, Golub and Pereyra 1973). The height is eliminated
//! linearly; decay and frequency start from a grid and improve by Gauss-Newton steps. The
//! restitution is found on a grid of [`GRID_POINTS`] values and by a parabola. The evidence is the
//! log likelihood ratio of the residuals.

use super::bounce_train::{BounceTrain, IMPACTS};
use super::ringing::{Pulse, Ringing, TrainFit, correlate_with_drive, fit_train};
use crate::hear::{BINS_PER_CYCLE, BinLayout, MAX_BINS};
use core::f32::consts::{PI, TAU};
use kband::arithmetic::Phase;
use kband::impact::ContactTime;

/// Time from the beginning of an average to the expected first landing, in rad.
pub const LANDING_OFFSET: f32 = 0.5;
/// Largest shift of the first landing, in rad: an error of 1.5 % of k moves it at most this far.
const MAX_LANDING_SHIFT: f32 = 0.1;
/// Upper limit of that shift, in samples; it bounds the work at low frequencies.
const MAX_LANDING_SHIFT_SAMPLES: f32 = 8.0;
/// Number of restitutions on the grid: 0.004 apart over half of the range.
const GRID_POINTS: usize = 128;
/// Extension of the grid beyond its bounds; an error of 1 % of k moves these by up to 0.015.
const GRID_MARGIN: f32 = 0.02;
const MIN_RESTITUTION: f32 = 0.02;
/// Lowest frequency on the grid of ringings, in rad per sample: 480 Hz.
const MIN_ANGLE: f32 = 0.15;
/// Step of that grid, in rad per sample, which the Gauss-Newton steps bridge.
const ANGLE_STEP: f32 = 0.08;
/// Number of frequencies on the grid: up to 9.6 kHz.
const ANGLES: u16 = 37;
/// Decay times on the grid, in samples: 0.3 to 3.2 ms.
const DECAY_SAMPLES: [f32; 4] = [6.0, 14.0, 30.0, 64.0];
/// Number of alternating rounds for first landing and ringing; the last steps are 1/6 sample.
const ROUNDS: u16 = 4;
/// Lowest restitution for the interval between two impacts in which the ringing is fitted.
const MIN_INTERVAL_RESTITUTION: f32 = 0.14;
/// Minimum length of that interval, in samples: one millisecond.
const MIN_FIRST_LANDING_SAMPLES: f32 = 20.0;
/// Number of onsets tried per restitution: half a sample before, at, and after the first landing.
const ONSETS_PER_RESTITUTION: u16 = 3;
/// Threshold on the explained over the residual sum of squares per bin: thrice the best on noise.
const MIN_EXPLAINED_PER_BIN: f32 = 80.0;
/// Largest residual over that of noise alone for a chatter of the map.
const MAX_RESIDUAL_OVER_NOISE: f32 = 8.0;
/// Largest residual over that of the first landing alone for a chatter of the map.
const MAX_RESIDUAL_OVER_LANDING: f32 = 0.25;
/// Minimum distance of a rival restitution: three times the largest standard error of a result.
const MIN_RIVAL_DISTANCE: f32 = 0.03;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// Fit of the first landing's ringing, n-th grid point.
    Ringing(u16),
    /// Search for its time, n-th round.
    Onset(u16),
    /// Fit of a train, n-th pair of restitution and onset.
    Trains(u16),
    Done,
}

/// Classification of an average.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// Chatter of parts with this restitution.
    Restitution(f32),
    Quiet,
    /// Neither chatter of the map nor noise.
    Unexplained,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Best {
    fit: TrainFit,
    ringing: Ringing,
    onset: f32,
}

/// Comparison of averages with the predicted chatter of every restitution, in slices.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    residual: [f32; MAX_BINS],
    layout: BinLayout,
    /// Samples in a radian of the drive.
    per_radian: f32,
    normal_gravity: f32,
    k: f64,
    pub contact: ContactTime,
    /// Lowest restitution of the grid, and its step.
    lowest: f32,
    grid_step: f32,
    stage: Stage,
    ringing: Option<Ringing>,
    /// Samples from the average's beginning to the first landing, and on to the second impact.
    onset: f32,
    first_landing_samples: f32,
    best: Option<Best>,
    pub verdict: Verdict,
    /// Residual of each restitution in this average.
    residual_sum: [f32; GRID_POINTS],
    /// Log ratios of the residual to the least one, summed over all averages with a chatter.
    sums: [f32; GRID_POINTS],
    /// The same sum for the first landing alone.
    first_landing_sum: f32,
    /// Relative bias of the measured amplitude by the ringing; `None` before its estimate.
    amplitude_bias: Option<f32>,
}

impl Fit {
    /// A fit without data. As a constant it would take 2 KiB of flash.
    pub fn empty() -> Self {
        Self {
            residual: [0.0; MAX_BINS],
            layout: BinLayout::NONE,
            per_radian: 1.0,
            normal_gravity: 0.0,
            k: 1.0,
            contact: ContactTime::INSTANT,
            lowest: MIN_RESTITUTION,
            grid_step: 0.0,
            stage: Stage::Done,
            ringing: None,
            onset: 0.0,
            first_landing_samples: 0.0,
            best: None,
            verdict: Verdict::Quiet,
            residual_sum: [0.0; GRID_POINTS],
            sums: [0.0; GRID_POINTS],
            first_landing_sum: 0.0,
            amplitude_bias: None,
        }
    }

    /// Sets the grid: restitutions that rest each cycle at the first k but not at the second.
    pub fn set_grid(&mut self, (rest, hopping): (f64, f64)) {
        let max_resting_restitution = |k: f64| {
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..7 {
                let middle = 0.5 * (low + high);
                let bounces = BounceTrain::simulate(k, middle, self.contact);
                let rests = bounces.is_some_and(|bounces| bounces.rests());
                let end = if rests { &mut low } else { &mut high };
                *end = middle;
            }
            low
        };
        let highest = max_resting_restitution(rest) + GRID_MARGIN;
        self.lowest = (max_resting_restitution(hopping) - GRID_MARGIN).max(MIN_RESTITUTION);
        self.grid_step = (highest - self.lowest).max(2.0 * GRID_MARGIN) / (GRID_POINTS - 1) as f32;
    }

    pub fn store(&mut self, first: usize, residual: &[f32; BINS_PER_CYCLE]) {
        for (slot, value) in self.residual.iter_mut().skip(first).zip(residual) {
            *slot = *value;
        }
    }

    /// Begins the comparison of the stored average, at a measured k. `normal_gravity` (m/s^2):
    /// amplitude of the track's acceleration at k = 1; `step`: advance of the phase per sample.
    pub fn begin(&mut self, k: f64, normal_gravity: f32, step: u32) {
        self.layout = BinLayout::from_step(step);
        self.per_radian = Phase::TURN as f32 / (TAU * step.max(1) as f32);
        self.normal_gravity = normal_gravity;
        self.k = k * (1.0 + f64::from(self.amplitude_bias.unwrap_or(0.0)));
        self.best = None;
        self.residual_sum = [f32::INFINITY; GRID_POINTS];
        self.onset = LANDING_OFFSET * self.per_radian;
        let lowest = self.lowest.max(MIN_INTERVAL_RESTITUTION);
        let lowest_bounces = BounceTrain::simulate(self.k, lowest, self.contact);
        let interval = lowest_bounces.map_or(0.0, |bounces| bounces.impacts[1].0 * self.per_radian);
        self.first_landing_samples = interval.max(MIN_FIRST_LANDING_SAMPLES);
        self.stage = (self.ringing).map_or(Stage::Ringing(0), |_| Stage::Onset(0));
    }

    /// Runs one slice of at most 0.3 million instructions; returns whether it did any work.
    pub fn step(&mut self) -> bool {
        self.stage = match (self.stage, self.ringing) {
            (Stage::Done, _) => return false,
            (Stage::Ringing(n), _) => self.try_ringing(n),
            (Stage::Onset(n), Some(ringing)) => self.try_onsets(n, ringing),
            (Stage::Trains(n), Some(ringing)) => self.try_train(n, ringing),
            (_, None) => Stage::Done,
        };
        true
    }

    pub fn busy(&self) -> bool {
        self.stage != Stage::Done
    }

    fn try_ringing(&mut self, n: u16) -> Stage {
        let ringing = Ringing {
            decay: 1.0 / DECAY_SAMPLES[usize::from(n) % DECAY_SAMPLES.len()],
            angle: MIN_ANGLE + ANGLE_STEP * f32::from(n / DECAY_SAMPLES.len() as u16),
        };
        // Higher frequencies are aliases if bins are more than a sample apart.
        let distinct = ringing.angle * (self.layout.stride as f32) < PI;
        let landing = LANDING_OFFSET * self.per_radian;
        if distinct && let Some(onset) = self.landing(ringing, landing, 1.0, false) {
            self.onset = onset;
            self.ringing = Some(ringing);
        }
        if n + 1 < ANGLES * DECAY_SAMPLES.len() as u16 {
            Stage::Ringing(n + 1)
        } else {
            Stage::Onset(0)
        }
    }

    fn try_onsets(&mut self, n: u16, ringing: Ringing) -> Stage {
        self.best = None;
        let (middle, stride) = if n == 0 {
            (LANDING_OFFSET * self.per_radian, 1.0)
        } else {
            (self.onset, 0.5 / f32::from(n))
        };
        if let Some(onset) = self.landing(ringing, middle, stride, true) {
            self.onset = onset;
        }
        self.ringing = self.best.map(|best| best.fit.refined);
        self.best = None;
        if n + 1 < ROUNDS {
            Stage::Onset(n + 1)
        } else {
            Stage::Trains(0)
        }
    }

    /// Searches the first landing around `middle` in steps of `step` samples; returns a better one.
    fn landing(&mut self, ringing: Ringing, middle: f32, step: f32, tuned: bool) -> Option<f32> {
        let range = (MAX_LANDING_SHIFT * self.per_radian).min(MAX_LANDING_SHIFT_SAMPLES) as i32;
        let mut candidate = None;
        for shift in -range..=range {
            let onset = middle + step * shift as f32;
            let end = ((onset + self.first_landing_samples) / self.layout.stride as f32) as usize;
            let bins = self.bins();
            let section = &bins[..end.min(bins.len())];
            let landing = [(onset, 1.0)];
            let fit = fit_train(section, self.layout.stride, ringing, tuned, &landing);
            if self.update_best(fit, ringing, onset) {
                candidate = Some(onset);
            }
        }
        candidate
    }

    /// Keeps a fit with a smaller relative residual; returns whether it was better.
    fn update_best(&mut self, fit: TrainFit, ringing: Ringing, onset: f32) -> bool {
        // Relative residuals, because the pieces differ in length with the onset.
        let refined = self.best.is_none_or(|best| {
            let best = best.fit;
            fit.residual_sum * best.baseline_sum < best.residual_sum * fit.baseline_sum
        });
        if refined {
            self.best = Some(Best {
                fit,
                ringing,
                onset,
            });
        }
        refined
    }

    fn try_train(&mut self, n: u16, ringing: Ringing) -> Stage {
        let index = usize::from(n / ONSETS_PER_RESTITUTION);
        let shift = n % ONSETS_PER_RESTITUTION;
        let onset = self.onset + 0.5 * (f32::from(shift) - 1.0);
        if let Some(bounces) =
            BounceTrain::simulate(self.k, self.grid_restitution(index), self.contact)
        {
            let train = self.train(&bounces, onset);
            let fit = fit_train(self.bins(), self.layout.stride, ringing, true, &train);
            if let Some(residual_sum) = self.residual_sum.get_mut(index) {
                *residual_sum = residual_sum.min(fit.residual_sum);
            }
            self.update_best(fit, ringing, onset);
        }
        if usize::from((n + 1) / ONSETS_PER_RESTITUTION) < GRID_POINTS {
            Stage::Trains(n + 1)
        } else {
            self.conclude()
        }
    }

    /// Classifies the average and adds its log likelihood ratios; the first chatter gives the bias.
    fn conclude(&mut self) -> Stage {
        self.verdict = self.decide();
        let (Verdict::Restitution(restitution), Some(best)) = (self.verdict, self.best) else {
            // The ringing is discarded too.
            self.ringing = None;
            return Stage::Done;
        };
        self.ringing = Some(best.fit.refined);
        if self.amplitude_bias.is_none() {
            let bias = self.amplitude_bias(restitution, &best);
            self.amplitude_bias = Some(bias);
            self.k *= f64::from(1.0 + bias);
            self.best = None;
            self.residual_sum = [f32::INFINITY; GRID_POINTS];
            return Stage::Trains(0);
        }
        for (sum, residual_sum) in self.sums.iter_mut().zip(&self.residual_sum) {
            *sum += libm::logf(*residual_sum / best.fit.residual_sum);
        }
        self.first_landing_sum +=
            libm::logf(self.fit_first_landing(&best).residual_sum / best.fit.residual_sum);
        Stage::Done
    }

    /// Fit of the first landing alone, with the ringing of the best fit.
    fn fit_first_landing(&self, best: &Best) -> TrainFit {
        let landing = [(best.onset, 1.0)];
        let stride = self.layout.stride;
        fit_train(self.bins(), stride, best.ringing, true, &landing)
    }

    fn decide(&self) -> Verdict {
        let (Some(best), Some(restitution)) = (self.best, interpolate_minimum(&self.residual_sum))
        else {
            return Verdict::Quiet;
        };
        let bins = self.bins();
        let fit = best.fit;
        let (residual_sum, baseline_sum) = (fit.residual_sum, fit.baseline_sum);
        let noise = self.noise() * bins.len() as f32;
        if baseline_sum - residual_sum < MIN_EXPLAINED_PER_BIN * residual_sum / bins.len() as f32 {
            let is_quiet = baseline_sum < MAX_RESIDUAL_OVER_NOISE * noise;
            return if is_quiet {
                Verdict::Quiet
            } else {
                Verdict::Unexplained
            };
        }
        if residual_sum < MAX_RESIDUAL_OVER_NOISE * noise
            || residual_sum < MAX_RESIDUAL_OVER_LANDING * self.fit_first_landing(&best).residual_sum
        {
            Verdict::Restitution(self.grid_restitution(0) + restitution * self.grid_step)
        } else {
            Verdict::Unexplained
        }
    }

    /// Variance of the average before the first landing, while the parts fly.
    fn noise(&self) -> f32 {
        let quiet = (LANDING_OFFSET - 1.5 * MAX_LANDING_SHIFT) * self.per_radian
            / self.layout.stride as f32;
        let bins = self.bins();
        let quiet = &bins[..(quiet as usize).min(bins.len())];
        let count = quiet.len().max(2) as f32;
        let mean = quiet.iter().sum::<f32>() / count;
        let squares: f32 = quiet.iter().map(|x| (x - mean) * (x - mean)).sum();
        squares / (count - 1.0)
    }

    /// Relative bias of the measured amplitude by the impacts' ringing, which lowers k.
    fn amplitude_bias(&self, restitution: f32, best: &Best) -> f32 {
        let Some(bounces) = BounceTrain::simulate(self.k, restitution, self.contact) else {
            return 0.0;
        };
        let samples = self.layout.bins as u32 * self.layout.stride;
        let step = 1.0 / self.per_radian;
        let turning = [bounces.landing - best.onset * step, step];
        let train = self.train(&bounces, best.onset);
        let sum = correlate_with_drive(&best.fit, best.ringing, samples, turning, &train);
        // The track's acceleration is its amplitude times the negative sine.
        let swing = -2.0 * step * (1.0 / TAU) * sum;
        let share = swing * self.k as f32 / self.normal_gravity;
        share / (1.0 - share)
    }

    fn grid_restitution(&self, index: usize) -> f32 {
        self.lowest + self.grid_step * index as f32
    }

    fn bins(&self) -> &[f32] {
        &self.residual[..self.layout.bins.min(MAX_BINS)]
    }

    /// Impacts of a chatter with its first landing at this sample.
    fn train(&self, bounces: &BounceTrain, onset: f32) -> [Pulse; IMPACTS] {
        (bounces.impacts).map(|(time, speed)| (onset + time * self.per_radian, speed))
    }

    /// Restitution with the least residual over all averages with a chatter.
    pub fn all(&self) -> Option<f32> {
        interpolate_minimum(&self.sums).map(|index| self.lowest + self.grid_step * index)
    }

    /// Twice the log likelihood ratio of that restitution to its best rival.
    pub fn evidence(&self) -> f32 {
        let Some(estimate) = self.all() else {
            return 0.0;
        };
        let (mut best, mut rival) = (f32::INFINITY, f32::INFINITY);
        for (index, sum) in self.sums.iter().enumerate() {
            let offset = self.grid_restitution(index) - estimate;
            let is_best = offset.abs() < MIN_RIVAL_DISTANCE;
            let minimum = if is_best { &mut best } else { &mut rival };
            *minimum = minimum.min(*sum);
        }
        (rival - best) * self.layout.bins as f32
    }

    /// The same ratio to the first landing alone; negative for parts that scatter.
    pub fn train_evidence(&self) -> f32 {
        let best = self.sums.iter().copied().fold(f32::INFINITY, f32::min);
        (self.first_landing_sum - best) * self.layout.bins as f32
    }
}

/// Index of the least value, interpolated by a parabola.
fn interpolate_minimum(values: &[f32]) -> Option<f32> {
    let (mut least, mut minimum) = (None, f32::INFINITY);
    for (index, &value) in values.iter().enumerate() {
        if value < minimum {
            (least, minimum) = (Some(index), value);
        }
    }
    let least = least?;
    let neighbors = (values.get(least.wrapping_sub(1)), values.get(least + 1));
    let offset = match neighbors {
        (Some(below), Some(above)) => 0.5 * (below - above) / (below - 2.0 * minimum + above),
        _ => 0.0,
    };
    // NaN beside restitutions without a fit, whose residuals are infinite.
    let between = (-0.5..=0.5).contains(&offset);
    Some(least as f32 + if between { offset } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn interpolated_minimum_is_the_vertex_of_a_parabola() {
        for vertex in [0.6_f32, 1.0, 3.3, 4.5, 7.9] {
            let square = |n: u8| (f32::from(n) - vertex) * (f32::from(n) - vertex) + 2.0;
            let values: Vec<f32> = (0..10).map(square).collect();
            let found = interpolate_minimum(&values).unwrap();
            assert!((found - vertex).abs() < 1e-4, "{vertex}: {found}");
        }
        assert_eq!(interpolate_minimum(&[1.0, 2.0, 3.0]), Some(0.0));
        assert_eq!(interpolate_minimum(&[3.0, 2.0, f32::INFINITY]), Some(1.0));
        assert_eq!(interpolate_minimum(&[]), None);
    }
}
