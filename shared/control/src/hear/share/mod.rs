//! Estimates the share of time in gear of any number of parts from the phases of their impacts.
//!
//! Impacts of a crowd cannot be assigned to parts, but their energies add up. That of a sector is a
//! mixture of profiles in gear, out of gear, and noise (docs/theory-real-parts.md#t10.7).
//!
//! The expected energy of the last mixture weights each equation of the `fit` (iteratively
//! reweighted least squares). Histograms forget exponentially. Delay and decay time of the ringing
//! in the `model` are nuisance parameters, fitted in turn by a parabola through three points.

mod fit;
mod model;

use super::energy::{SECTORS, Sectors};
use super::gear::{DriveState, GearMargin};
use super::signal::Cycle;
use crate::{SAMPLE_RATE, UPPER};
use fit::{
    COMPONENTS, Covariance, DesignMatrix, NOISE_INDEX, SectorEnergy, fit_mixture, moving_average,
    predict_energy, residual_sum, stray_energy, unexplained_energy,
};
use kband::arithmetic::{Phase, square_root_single};
use kband::regime::gear::{
    GROUPS, RESTITUTION_MARGIN, StrikeProfile, StrikeProfiler, StrikeSettings,
};
use model::{drive_energy, has_out_of_gear_profile, impact_energy, predict_design_matrix};

/// Memory of the long energy histogram, in drive cycles (exponential forgetting; 5 s at 50 Hz).
const LONG_MEMORY_CYCLES: f32 = 256.0;
/// Weight of the long histogram, in drive cycles, above which it is fitted.
const MIN_LONG_WEIGHT: f32 = 24.0;
/// Period of the fits to the long histogram, in drive cycles.
const LONG_FIT_PERIOD: u32 = 16;
/// Memory of the short energy histogram, in s, from which READY detects changes of the parts.
const SHORT_MEMORY: f32 = 0.3;
/// Bounds of that memory, in drive cycles.
const SHORT_MEMORY_CYCLES: [f32; 2] = [8.0, 64.0];
/// Weight of the short histogram, in drive cycles, above which it is fitted.
const MIN_SHORT_WEIGHT: f32 = 6.0;
/// Period of the fits to the short histogram, in s.
const SHORT_FIT_PERIOD: f32 = 0.1;
/// Bounds of that period, in drive cycles.
const SHORT_FIT_PERIOD_CYCLES: [f32; 2] = [4.0, 16.0];
/// Largest unexplained share of the energy in gear: systematic part, and random part of one impact.
const MAX_UNEXPLAINED: [f32; 2] = [0.15, 0.9];
/// The same without a profile of parts out of gear: such parts then show only in a poor fit.
const MAX_UNEXPLAINED_WITHOUT_OUT: [f32; 2] = [0.05, 1.1];
/// Largest stray energy over that of all impacts, and over that of the noise. Parts that land
/// together, bounce and rest have 0.047 and more beyond the noise.
const MAX_STRAY: [f32; 2] = [0.035, 0.3];
/// Scatter of the restitution below which the profiles are lines, and fit less well.
const MIN_SCATTER: f32 = 0.01;
/// Predicted share of time in gear above which READY is credible: in gear it is at least 0.71.
const MIN_PREDICTED_SHARE: f32 = 0.65;
/// Difference of the lead from its mean, in 2^-32 turns (0.05 rad), above which the mean is used.
const MAX_LEAD_DIFFERENCE: u32 = 1 << 25;
/// Impacts predicted per slice of background work.
const PROFILE_SLICE_IMPACTS: u32 = 64;
/// Relative change of k, and change of the upper tones, at which profiles are predicted again.
const PROFILE_TOLERANCE: f32 = 0.01;
/// Rounding step of the upper tones (`e cos th`, `e sin th`): equal feeders share one strike count.
const TONE_ROUNDING_STEP: f32 = 1.0 / 1024.0;
/// Relative change of k, and change of the upper tones, up to which the old share remains reported.
const STALE_SHARE_TOLERANCE: f32 = 0.05;
/// Growth of its standard error per drive cycle: 4 s at 50 Hz to [`MAX_REPORTED_ERROR`].
const STALE_ERROR_GROWTH: f32 = 0.001;
/// Initial decay time of the ringing's energy, in s: half of the 1 ms of a bare track.
const INITIAL_DECAY_TIME: f32 = 0.5e-3;
/// Bounds of the decay time, in s.
const DECAY_TIME_BOUNDS: [f32; 2] = [0.05e-3, 5e-3];
/// Step of the search for the decay time, as a factor.
const DECAY_TIME_FACTOR: f32 = 1.15;
/// Energy of the parts over that of the noise above which a share is reported.
const MIN_SIGNAL_TO_NOISE: f32 = 0.3;
/// Minimum share in gear for estimating the margin; below it too few impacts are in gear.
const MIN_SHARE_FOR_MARGIN: f32 = 0.1;
/// Smallest standard error of a share, due to the random errors of the predicted profiles.
///
/// This constant, [`ERROR_PER_EXCESS`] and [`ERROR_AT_BOUND`] are calibrated on 475 random lots. Of
/// the estimates, 68, 95 and 99.7 % are to lie within 1, 2 and 3 errors, also with an exact gain.
const MIN_SHARE_ERROR: f32 = 0.0175;
/// Standard error of a share per excess over the predicted one.
const ERROR_PER_EXCESS: f32 = 0.55;
/// Standard error of a share whose delay or decay time is at its bound.
const ERROR_AT_BOUND: f32 = 0.1;
/// Shortest credible decay time of the energy, in s: two samples.
const MIN_DECAY_TIME: f32 = 0.1e-3;
/// Largest standard error of the share in gear at which it is reported.
const MAX_REPORTED_ERROR: f32 = 0.25;
/// Misfit of the parts to the lot above which they do not fit it; parts of the lot have 0 to 0.005.
const MAX_MISFIT: f32 = 0.03;
/// Factor on the smallest share in gear of a part of the lot; it covers an error of the amplitude.
const MIN_CREDIBLE_SHARE: f32 = 0.7;
/// Duration of a misfit that lasts, in s, and its bounds in drive cycles.
const MIN_MISFIT_DURATION: f32 = 2.6;
const MIN_MISFIT_CYCLES: [f32; 2] = [64.0, 128.0];
/// Number of fits of a hypothesis before the next one.
const MIN_FITS: u32 = 2;
/// Hypotheses on the scatter, over the configured one: regular parts are in gear at fewer phases.
const SCATTER_FACTORS: [f32; 3] = [1.0, 0.4, 0.1];
/// Initial delay of an impact's energy, in samples: two one-pole filters and the ringing's rise.
const INITIAL_DELAY: f32 = 2.5;
/// Bounds of that delay, in samples; an error of the amplitude shifts it.
const DELAY_BOUNDS: [f32; 2] = [-1.5, 6.5];
/// Step of the search for the delay, in samples.
const DELAY_STEP: f32 = 0.5;
/// Trial points around the estimate: steps of the delay, and factors on the decay time.
const TRIAL_POINTS: [[f32; 2]; 3] = [
    [0.0, 1.0],
    [-1.0, 1.0 / DECAY_TIME_FACTOR],
    [1.0, DECAY_TIME_FACTOR],
];
/// Estimated share of time in gear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearShare {
    /// Share, 0..=1.
    pub share: f32,
    /// Standard error of the share.
    pub error: f32,
}

/// Energy by the phase of the output, with exponential forgetting.
#[derive(Clone, Copy, Debug, Default)]
struct Histogram {
    energy: SectorEnergy,
    noise: f32,
    /// Weight of both sums, in drive cycles.
    weight: f32,
}

impl Histogram {
    /// Adds the sectors of one cycle, with exponential forgetting; `memory` in drive cycles.
    fn add(&mut self, sectors: &Sectors, noise: f32, memory: f32) {
        let forgetting_factor = 1.0 - 1.0 / memory;
        // Each cycle brings a quarter of the sectors, with the energy of four cycles.
        let quarter_forgetting_factor =
            forgetting_factor * forgetting_factor * forgetting_factor * forgetting_factor;
        let sums = self.energy.iter_mut().skip(usize::from(sectors.first));
        for (sum, energy) in sums.zip(sectors.energy) {
            *sum = *sum * quarter_forgetting_factor + energy;
        }
        self.noise = self.noise * forgetting_factor + noise;
        self.weight = self.weight * forgetting_factor + 1.0;
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Share of time in gear by the fitted weights, 0..=1.
    pub in_gear: f32,
    /// Unexplained share of the energy (total variation distance) less its bound in gear.
    excess: f32,
    /// Stray energy less its bound.
    stray: f32,
}

impl Agreement {
    /// Whether parts land together, bounce and rest.
    pub fn has_stray(&self) -> bool {
        self.stray > 0.0
    }

    fn fits(&self) -> bool {
        self.excess < 0.0 && !self.has_stray()
    }
}

/// Evidence for READY: the predicted share, and the agreement of both histograms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearEvidence {
    /// Share of time in gear that the map predicts for the lot, 0..=1.
    predicted: f32,
    pub long: Agreement,
    short: Agreement,
}

impl GearEvidence {
    /// Whether the map predicts gear, and both histograms show a share above `level` (0..=1).
    pub fn supports(&self, level: f32) -> bool {
        self.predicted > MIN_PREDICTED_SHARE
            && self.long.in_gear > level
            && self.short.in_gear > level
    }

    pub fn fits(&self) -> bool {
        self.long.fits() && self.short.fits()
    }
}

#[derive(Clone, Debug, Default)]
pub struct ShareEstimator {
    k: f32,
    /// Mean upper tones (`e cos th`, `e sin th`) since then.
    tones: [[f32; 2]; UPPER],
    cycles: f32,
    profiled_tones: [[f32; 2]; UPPER],
    pub profiler: Option<StrikeProfiler>,
    /// Energy of the last 256 cycles; the reported share is fitted to it.
    long: Histogram,
    cycles_since_fit: u32,
    /// Energy of the last 0.3 s; changes of the parts are detected in it.
    short: Histogram,
    cycles_since_short_fit: f32,
    short_fit_due: bool,
    detects_gear: bool,
    /// Evidence for READY; `None` before the first fit.
    pub evidence: Option<GearEvidence>,
    lead: Phase,
    /// Mean lead since the histogram began; a growing load turns the track.
    mean_lead: Phase,
    step: u32,
    /// Amplitudes of the drive's own acceleration, cosine and sine, in m/s^2.
    drive_acceleration: [f32; 2],
    /// Estimated decay time of the ringing's energy, in s.
    decay_time: f32,
    /// Estimated delay of the energy, in samples.
    delay: f32,
    searches_delay: bool,
    search: Option<ParabolicSearch>,
    /// Weights of the last mixture, the starting point of the next fit; all 0 before the first.
    weights: [f32; COMPONENTS],
    pub share: Option<GearShare>,
    pub margin: Option<GearMargin>,
    /// Whether the share was estimated before the track changed.
    is_stale: bool,
    pub has_fit: bool,
    fits: u32,
    /// Misfit of the parts to the lot in the last fit, and cycles in a row above [`MAX_MISFIT`].
    misfit: f32,
    misfit_cycles: f32,
    /// Hypothesis on the scatter: index into [`SCATTER_FACTORS`].
    hypothesis: usize,
    /// Its changes since the misfit began, and decay time and delay of the ringing before these.
    hypothesis_changes: usize,
    ringing_before: (f32, f32),
}

/// Running search for decay time or delay: residual sum of squares at each trial point.
#[derive(Clone, Copy, Debug, Default)]
struct ParabolicSearch {
    trials: usize,
    residual_sum: [f32; TRIAL_POINTS.len()],
}

#[derive(Clone, Copy, Debug)]
struct Mixture {
    /// Sum over the sectors of the squared residual over the expected energy.
    residual_sum: f32,
    unexplained_energy: f32,
    /// Energy between the predicted impacts, and that of the noise there.
    stray_energy: [f32; 2],
    weights: [f32; COMPONENTS],
    /// Covariance of the weights for a dispersion (reduced chi-square) of 1.
    covariance: Covariance,
}

impl ShareEstimator {
    pub fn new() -> Self {
        Self {
            decay_time: INITIAL_DECAY_TIME,
            delay: INITIAL_DELAY,
            ..Self::default()
        }
    }

    /// Clears the histograms and the estimates; keeps the ringing parameters and the profiles.
    pub fn reset(&mut self) {
        self.clear_histograms();
        (self.cycles, self.search) = (0.0, None);
        (self.hypothesis, self.hypothesis_changes) = (0, 0);
        self.clear_estimates();
    }

    fn clear_histograms(&mut self) {
        (self.long, self.cycles_since_fit) = (Histogram::default(), 0);
        (self.short, self.cycles_since_short_fit) = (Histogram::default(), 0.0);
        self.short_fit_due = false;
        self.weights = [0.0; COMPONENTS];
    }

    fn clear_estimates(&mut self) {
        (self.share, self.margin) = (None, None);
        (self.is_stale, self.has_fit) = (false, false);
        self.evidence = None;
        (self.misfit, self.misfit_cycles) = (0.0, 0.0);
    }

    /// Predicted profile of the lot; `None` until the prediction is complete.
    pub fn profile(&self) -> Option<&StrikeProfile> {
        self.profiler.as_ref()?.profile()
    }

    /// Adds one drive cycle to the histograms, and schedules the fits.
    pub fn cycle(&mut self, cycle: &Cycle, drive_state: &DriveState) {
        self.age_stale_share();
        if !drive_state.settled {
            let predicted = self.profiler.as_ref().map(|profiler| profiler.settings().k);
            // No new share is estimated while the amplitude changes.
            if predicted.is_some_and(|k| (drive_state.k - k).abs() > STALE_SHARE_TOLERANCE * k) {
                (self.share, self.margin) = (None, None);
            }
            return;
        }
        let frequency = drive_state.step as f32 * SAMPLE_RATE as f32 * (1.0 / Phase::TURN as f32);
        let cycles = |seconds: f32, [low, high]: [f32; 2]| (seconds * frequency).clamp(low, high);
        self.count_misfit(cycles(MIN_MISFIT_DURATION, MIN_MISFIT_CYCLES));
        self.update_motion(drive_state);
        let noise = cycle.noise * cycle.noise * f32::from(cycle.samples);
        let short_memory = cycles(SHORT_MEMORY, SHORT_MEMORY_CYCLES);
        self.short.add(&cycle.sectors, noise, short_memory);
        self.cycles_since_short_fit += 1.0;
        self.detects_gear = drive_state.detects_gear;
        self.long.add(&cycle.sectors, noise, LONG_MEMORY_CYCLES);
        let difference = (drive_state.lead - self.mean_lead).bits() as i32;
        self.mean_lead += Phase::from_bits((difference as f32 / self.long.weight) as i32 as u32);
        self.lead = if difference.unsigned_abs() > MAX_LEAD_DIFFERENCE {
            self.mean_lead
        } else {
            drive_state.lead
        };
        self.step = drive_state.step;
        self.drive_acceleration = [cycle.in_phase, cycle.quadrature];
        self.cycles_since_fit += 1;
        if self.cycles_since_fit >= LONG_FIT_PERIOD && self.long.weight > MIN_LONG_WEIGHT {
            self.cycles_since_fit = 0;
            if self.profile().is_some() && self.search.is_none() {
                self.search = Some(ParabolicSearch::default());
            }
        }
        self.short_fit_due |= self.cycles_since_short_fit
            >= cycles(SHORT_FIT_PERIOD, SHORT_FIT_PERIOD_CYCLES)
            && self.short.weight > MIN_SHORT_WEIGHT;
    }

    /// Counts the cycles of a misfit; one that lasts tests the next hypothesis on the scatter.
    fn count_misfit(&mut self, min_cycles: f32) {
        if self.misfit <= MAX_MISFIT {
            (self.misfit_cycles, self.hypothesis_changes) = (0.0, 0);
            return;
        }
        self.misfit_cycles += 1.0;
        if self.misfit_cycles > min_cycles
            && self.fits >= MIN_FITS
            && self.hypothesis_changes + 1 < SCATTER_FACTORS.len()
        {
            if self.hypothesis_changes == 0 {
                self.ringing_before = (self.decay_time, self.delay);
            }
            (self.decay_time, self.delay) = self.ringing_before;
            self.hypothesis_changes += 1;
            self.hypothesis = (self.hypothesis + 1) % SCATTER_FACTORS.len();
            self.fits = 0;
        }
    }

    fn scatter_factor(&self) -> f32 {
        let factor = SCATTER_FACTORS.get(self.hypothesis);
        factor.copied().unwrap_or(1.0)
    }

    /// Increases the error of a share estimated before the track changed, up to its withdrawal.
    fn age_stale_share(&mut self) {
        if let Some(share) = self.share.as_mut().filter(|_| self.is_stale) {
            share.error += STALE_ERROR_GROWTH;
            if share.error > MAX_REPORTED_ERROR {
                self.clear_estimates();
            }
        }
    }

    /// Averages the track's motion, and predicts the profiles again after a change.
    fn update_motion(&mut self, drive_state: &DriveState) {
        self.cycles = (self.cycles + 1.0).min(16.0);
        let share = 1.0 / self.cycles;
        self.k += (drive_state.k - self.k) * share;
        if drive_state.shape.is_sine() {
            self.tones = [[0.0; 2]; UPPER];
        } else {
            let means = self.tones.as_flattened_mut().iter_mut();
            for (mean, part) in means.zip(drive_state.shape.cartesian_tones().as_flattened()) {
                *mean += (part - *mean) * share;
            }
        }
        if self.cycles < 8.0 {
            return;
        }
        let order = u32::from(drive_state.order.max(1));
        let differs = |a: f32, b: f32, tolerance: f32| a - b > tolerance || b - a > tolerance;
        let Some((restitution, scatter)) = drive_state.lot else {
            return;
        };
        let scatter = scatter * self.scatter_factor();
        if let Some(profiler) = &self.profiler {
            let settings = profiler.settings();
            let is_within = |tolerance: f32| {
                let tones = self.tones.as_flattened().iter();
                let mut tones = tones.zip(self.profiled_tones.as_flattened());
                settings.order == order
                    && !differs(settings.k, self.k, tolerance * settings.k)
                    && tones.all(|(present, previous)| !differs(*previous, *present, tolerance))
            };
            let is_unchanged = is_within(PROFILE_TOLERANCE);
            let is_close = is_within(STALE_SHARE_TOLERANCE);
            if is_unchanged && settings.restitution == restitution && settings.scatter == scatter {
                return;
            }
            if !is_unchanged {
                // This energy belongs to another motion; after a small change parts stay in gear.
                self.clear_histograms();
                if is_close {
                    self.is_stale = true;
                } else {
                    self.clear_estimates();
                }
            }
        }
        self.search = None;
        self.profiled_tones = self.tones.map(|tone| {
            tone.map(|part| TONE_ROUNDING_STEP * libm::roundf(part / TONE_ROUNDING_STEP))
        });
        let tones = self.profiled_tones.map(|[in_phase, quadrature]| {
            let ratio = square_root_single(in_phase * in_phase + quadrature * quadrature);
            if ratio < 1e-3 {
                [0.0; 2]
            } else {
                [ratio, libm::atan2f(quadrature, in_phase)]
            }
        });
        // Eight binary places of k: an error of at most 0.2 %, a fifth of `PROFILE_TOLERANCE`.
        let k = f32::from_bits((self.k.to_bits() + (1 << 14)) & !((1 << 15) - 1));
        // Outside the map's range there is no estimate.
        self.profiler = StrikeProfiler::new(StrikeSettings {
            restitution,
            scatter,
            order,
            k,
            tones,
            contact: drive_state.contact,
        })
        .ok();
    }

    /// Runs one bounded slice of the estimate; returns whether more are due.
    pub fn step(&mut self) -> bool {
        if let Some(profiler) = &mut self.profiler
            && profiler.advance(PROFILE_SLICE_IMPACTS)
        {
            return true;
        }
        if core::mem::take(&mut self.short_fit_due) {
            self.cycles_since_short_fit = 0.0;
            self.fit_short_histogram();
            return true;
        }
        let Some(mut search) = self.search.take() else {
            return false;
        };
        let Some([steps, factor]) = TRIAL_POINTS.get(search.trials) else {
            self.move_to_minimum(&search.residual_sum);
            return false;
        };
        let (decay_time, delay) = if self.searches_delay {
            (self.decay_time, self.delay + DELAY_STEP * steps)
        } else {
            (self.decay_time * factor, self.delay)
        };
        let Some(design_matrix) = self.design_matrix(decay_time, delay) else {
            return false;
        };
        let measured_energy = self.measured_energy(&self.long);
        let (variance, weights, covariance) = self.fit_weights(&measured_energy, &design_matrix);
        let expected = predict_energy(&design_matrix, &weights);
        if let Some(difference) = search.residual_sum.get_mut(search.trials) {
            *difference = residual_sum([&measured_energy, &expected, &variance]);
        }
        if search.trials == 0 {
            self.update_estimates(&Mixture {
                residual_sum: residual_sum([&measured_energy, &expected, &expected]),
                unexplained_energy: unexplained_energy(&measured_energy, &expected),
                stray_energy: stray_energy(&measured_energy, &expected),
                weights,
                covariance,
            });
        }
        search.trials += 1;
        self.search = Some(search);
        true
    }

    /// Fits the short histogram, after a first fit of the long one, if gear is to be detected. The
    /// slice is used up in any case, so that the other searches run at the same times.
    fn fit_short_histogram(&mut self) {
        if !self.detects_gear || self.evidence.is_none() {
            return;
        }
        let Some(design_matrix) = self.design_matrix(self.decay_time, self.delay) else {
            return;
        };
        let measured_energy = self.measured_energy(&self.short);
        let (_, weights, _) = self.fit_weights(&measured_energy, &design_matrix);
        let unexplained_energy =
            unexplained_energy(&measured_energy, &predict_energy(&design_matrix, &weights));
        let short = self.agreement(&self.short, &weights, unexplained_energy, [0.0; 2]);
        if let (Some(evidence), Some(short)) = (&mut self.evidence, short) {
            evidence.short = short;
        }
    }

    /// Fits the mixture, weighed by the last one; expected energy, weights and their covariance.
    fn fit_weights(
        &self,
        measured_energy: &SectorEnergy,
        design_matrix: &DesignMatrix,
    ) -> (SectorEnergy, [f32; COMPONENTS], Covariance) {
        let fit = |variance: &SectorEnergy| {
            fit_mixture(measured_energy, design_matrix, variance, &self.weights)
        };
        let start_weights = if self.weights == [0.0; COMPONENTS] {
            fit(&moving_average(measured_energy)).0
        } else {
            self.weights
        };
        let sector_variance = predict_energy(design_matrix, &start_weights);
        let (weights, covariance) = fit(&sector_variance);
        (sector_variance, weights, covariance)
    }

    fn update_estimates(&mut self, mixture: &Mixture) {
        let share = self.estimate_share(mixture);
        let (unexplained, stray) = (mixture.unexplained_energy, mixture.stray_energy);
        let long = self.agreement(&self.long, &mixture.weights, unexplained, stray);
        let fitted = self.profile().zip(long);
        self.evidence = fitted.map(|(profile, long)| GearEvidence {
            predicted: profile.share(),
            long,
            short: self.evidence.map_or(long, |before| before.short),
        });
        self.misfit = self.estimate_misfit(long.as_ref());
        self.fits = self.fits.saturating_add(1);
        self.margin = share.and(self.estimate_margin(mixture));
        self.share = share;
        self.weights = mixture.weights;
        (self.is_stale, self.has_fit) = (false, true);
    }

    /// The share of a mixture; `None` if the noise or the error is too large.
    fn estimate_share(&self, mixture: &Mixture) -> Option<GearShare> {
        let profile = self.profile()?;
        let in_gear_weight = mixture.weights[..GROUPS].iter().sum::<f32>();
        let out_weight = mixture.weights[GROUPS..NOISE_INDEX].iter().sum::<f32>();
        let energy = impact_energy(&mixture.weights, profile);
        let total_weight = in_gear_weight + out_weight;
        if energy <= MIN_SIGNAL_TO_NOISE * mixture.weights[NOISE_INDEX] || total_weight <= 0.0 {
            return None;
        }
        let share = in_gear_weight / total_weight;
        // Derivative of the share by each weight, times the sum of weights.
        let slope = |n: usize| match n {
            n if n < GROUPS => 1.0 - share,
            n if n < NOISE_INDEX => -share,
            _ => 0.0,
        };
        let mut variance = 0.0;
        for (a, row) in mixture.covariance.iter().enumerate() {
            for (b, covariance) in row.iter().enumerate() {
                variance += slope(a) * slope(b) * covariance;
            }
        }
        let dispersion = mixture.residual_sum / (SECTORS - COMPONENTS - 1) as f32;
        let random_variance = variance.max(0.0) * dispersion / (total_weight * total_weight);
        // Unexplained energy may come from parts in gear or out of gear.
        let surplus = (mixture.weights[NOISE_INDEX] - self.long.noise / self.long.weight).max(0.0);
        let unexplained_share =
            (mixture.unexplained_energy + surplus) / (energy + mixture.weights[NOISE_INDEX]);
        let excess = ERROR_PER_EXCESS * (share - profile.share()).max(0.0);
        let aligned = DELAY_BOUNDS[0] < self.delay
            && self.delay < DELAY_BOUNDS[1]
            && self.decay_time > MIN_DECAY_TIME;
        let bound_error = if aligned { 0.0 } else { ERROR_AT_BOUND };
        let systematic = [MIN_SHARE_ERROR, unexplained_share, excess, bound_error];
        let squares = systematic.map(|error| error * error);
        let error = square_root_single(random_variance + squares.iter().sum::<f32>());
        (error < MAX_REPORTED_ERROR).then_some(GearShare { share, error })
    }

    /// Misfit of the parts to the lot: unexplained energy beyond its bound, plus what the share
    /// lacks of [`MIN_CREDIBLE_SHARE`] times the smallest share of a part of the lot.
    fn estimate_misfit(&self, long: Option<&Agreement>) -> f32 {
        let (Some(long), Some(profile)) = (long, self.profile()) else {
            return 0.0;
        };
        let energy = self.long.energy.iter().sum::<f32>();
        if energy <= (1.0 + MIN_SIGNAL_TO_NOISE) * self.long.noise {
            return 0.0;
        }
        // Number of equally weighted cycles with the same variance of their mean.
        let weight = self.long.weight;
        let lowest = profile.min_credible_share(weight / (1.0 - 0.5 * weight / LONG_MEMORY_CYCLES));
        long.excess.max(0.0) + (MIN_CREDIBLE_SHARE * lowest - long.in_gear).max(0.0)
    }

    /// Whether the parts do not fit the lot: the misfit lasts with each hypothesis on the scatter.
    pub fn is_misfit(&self) -> bool {
        self.misfit_cycles > 0.0
            && self.hypothesis_changes + 1 == SCATTER_FACTORS.len()
            && self.fits >= MIN_FITS
    }

    /// Agreement of a histogram with its fitted weights, unexplained energy and [`stray_energy`].
    fn agreement(
        &self,
        histogram: &Histogram,
        weights: &[f32; COMPONENTS],
        unexplained_energy: f32,
        [stray, quiet]: [f32; 2],
    ) -> Option<Agreement> {
        let profiler = self.profiler.as_ref()?;
        let (settings, profile) = (profiler.settings(), profiler.profile()?);
        let in_gear_weight = weights[..GROUPS].iter().sum::<f32>();
        let out_weight = weights[GROUPS..NOISE_INDEX].iter().sum::<f32>();
        let surplus = (weights[NOISE_INDEX] - histogram.noise / histogram.weight).max(0.0);
        let energy = impact_energy(weights, profile);
        let unexplained =
            (unexplained_energy + surplus) / (energy + surplus).max(f32::MIN_POSITIVE);
        let [systematic, random] =
            if has_out_of_gear_profile(profile) || settings.scatter < MIN_SCATTER {
                MAX_UNEXPLAINED
            } else {
                MAX_UNEXPLAINED_WITHOUT_OUT
            };
        // Impacts of one part in gear; the number of parts is unknown.
        let impacts = histogram.weight / settings.order as f32;
        Some(Agreement {
            in_gear: in_gear_weight / (in_gear_weight + out_weight).max(f32::MIN_POSITIVE),
            excess: unexplained - systematic - random / square_root_single(impacts),
            stray: stray - MAX_STRAY[0] * energy - MAX_STRAY[1] * quiet,
        })
    }

    /// Margin of the parts in gear: restitution from the groups' weights, trace from their phases.
    fn estimate_margin(&self, mixture: &Mixture) -> Option<GearMargin> {
        let profiler = self.profiler.as_ref()?;
        let profile = profiler.profile()?;
        let StrikeSettings { k, scatter, .. } = *profiler.settings();
        let scatter = scatter / self.scatter_factor();
        let groups = &mixture.weights[..GROUPS];
        let total_weight: f32 = groups.iter().sum();
        let out: f32 = mixture.weights[GROUPS..NOISE_INDEX].iter().sum();
        if total_weight <= MIN_SHARE_FOR_MARGIN * (total_weight + out) {
            return None;
        }
        let group_restitutions: [f32; GROUPS] =
            core::array::from_fn(|group| profiler.restitution(group));
        let weighted = (groups.iter().zip(group_restitutions)).map(|(weight, one)| weight * one);
        let restitution = weighted.sum::<f32>() / total_weight;
        let mut variance = 0.0_f32;
        for (row, one) in mixture.covariance.iter().zip(group_restitutions) {
            for (covariance, other) in row.iter().zip(group_restitutions) {
                variance += (one - restitution) * (other - restitution) * covariance;
            }
        }
        let dispersion = mixture.residual_sum / (SECTORS - COMPONENTS - 1) as f32;
        // Restitutions within a group, and beyond the lot's ends, cannot be separated.
        let difference = group_restitutions[1] - group_restitutions[0];
        let error = square_root_single(
            variance.max(0.0) * dispersion / (total_weight * total_weight)
                + difference * difference / 12.0
                + RESTITUTION_MARGIN * RESTITUTION_MARGIN,
        );
        // A group's phase follows from its restitution; the fit estimates the number of its parts.
        let groups = groups.iter().zip(group_restitutions);
        let traces = groups.zip(profile.launch_accelerations);
        let traces = traces.map(|((weight, one), acceleration)| {
            let restitution_factor = (1.0 + one) * (1.0 + one);
            weight * (1.0 + one * one - restitution_factor * acceleration / k)
        });
        let trace = traces.sum::<f32>() / total_weight;
        Some(GearMargin {
            trace,
            restitution,
            error,
            scatter,
            flip: 1.0 + restitution * restitution + trace,
            to_loss: profile.time_to_loss(),
        })
    }

    /// Moves to the minimum of the parabola through the three trial points (at most one step).
    fn move_to_minimum(&mut self, [at, before, after]: &[f32; TRIAL_POINTS.len()]) {
        let curvature = before + after - 2.0 * at;
        let slope = 0.5 * (after - before);
        let step = if curvature > 0.0 {
            (-slope / curvature).clamp(-1.0, 1.0)
        } else if slope > 0.0 {
            -1.0
        } else {
            1.0
        };
        if self.searches_delay {
            self.delay = (self.delay + step * DELAY_STEP).clamp(DELAY_BOUNDS[0], DELAY_BOUNDS[1]);
        } else {
            self.decay_time = (self.decay_time * libm::powf(DECAY_TIME_FACTOR, step))
                .clamp(DECAY_TIME_BOUNDS[0], DECAY_TIME_BOUNDS[1]);
        }
        self.searches_delay = !self.searches_delay;
    }

    /// Predicted energy of each component by sector, for a decay time in s and a delay in samples.
    fn design_matrix(&self, decay_time: f32, delay: f32) -> Option<DesignMatrix> {
        let profile = self.profile()?;
        let matrix = predict_design_matrix(profile, self.lead, self.step, decay_time, delay);
        Some(matrix)
    }

    /// Energy per cycle of a histogram, less the drive's own.
    fn measured_energy(&self, histogram: &Histogram) -> SectorEnergy {
        let inverse = 1.0 / histogram.weight;
        let own = drive_energy(self.drive_acceleration, self.step);
        core::array::from_fn(|n| (histogram.energy[n] * inverse - own[n]).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_for_ready_needs_both_histograms() {
        for (predicted, shares, supports) in [
            (0.9, [0.6, 0.6], true),
            (0.9, [0.4, 0.6], false),
            (0.9, [0.6, 0.4], false),
            (MIN_PREDICTED_SHARE, [0.6, 0.6], false),
        ] {
            let [long, short] = shares.map(|in_gear| Agreement {
                in_gear,
                excess: -0.1,
                stray: 0.0,
            });
            let evidence = GearEvidence {
                long,
                short,
                predicted,
            };
            assert_eq!(evidence.supports(0.5), supports, "{evidence:?}");
        }
    }
}
