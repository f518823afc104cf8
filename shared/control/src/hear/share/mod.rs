//! Estimates the share of time in gear of any number of parts from the phases of their impacts.
//!
//! Single impacts of a crowd cannot be assigned to parts, but the energies of independent impacts
//! add up. The residual's energy per sector is a mixture of profiles that the map predicts
//! (docs/theory-real-parts.md#t10.7). Its components are parts in gear, parts out of gear, and
//! noise.
//!
//! The expected energy of the last mixture weighs each equation of the `fit` (iteratively reweighted
//! least squares). Histograms forget exponentially. The delay and the decay time of the ringing in
//! the `model` are nuisance parameters, fitted in turn by a parabola through three trial points.

mod fit;
mod model;

use super::energy::{SECTORS, Sectors};
use super::gear::DriveState;
use super::margin::GearMargin;
use super::signal::Cycle;
use crate::angle::SAMPLE_RATE;
use crate::drive::UPPER;
use fit::{Covariance, NOISE, PARTS, Row, Rows, astray, evened, mixed, off, unmix};
use kband::arithmetic::{Phase, square_root_single};
#[cfg(any(test, feature = "memo"))]
use kband::regime::gear::StrikeCount;
use kband::regime::gear::{
    GROUPS, RESTITUTION_MARGIN, StrikeProfile, StrikeProfiler, StrikeSettings,
};
use model::{drive_leak, knows_out, predict_rows, struck};

/// Memory of the long energy histogram, in drive cycles (exponential forgetting; 5 s at 50 Hz).
const MEMORY: f32 = 256.0;
/// Weight of the long histogram, in drive cycles, above which it is fitted.
const BEFORE: f32 = 24.0;
/// Period of the fits to the long histogram, in drive cycles.
const AGAIN: u32 = 16;
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
/// Scatter of the restitution below which the profiles are lines, and fit less well.
const MIN_SCATTER: f32 = 0.01;
/// Predicted share of time in gear above which READY is credible: in gear it is at least 0.71.
const MIN_PREDICTED_SHARE: f32 = 0.65;
/// Difference of the lead from its mean, in 2^-32 turns (0.05 rad), above which the mean is used.
const TURNED: u32 = 1 << 25;
/// Impacts predicted per slice of background work.
const SLICE: u32 = 64;
/// Relative change of k, and change of the upper tones, for which profiles are predicted anew.
const MOVED: f32 = 0.01;
/// Rounding step of the upper tones (`e cos th`, `e sin th`): equal feeders share one strike count.
const STEP_OF_TONES: f32 = 1.0 / 1024.0;
/// Relative change of k, and change of the upper tones, up to which the old share remains reported.
const NEAR: f32 = 0.05;
/// Growth of that share's standard error per drive cycle: after 4 s at 50 Hz it exceeds [`TELLS`].
const FADES: f32 = 0.001;
/// Initial decay time of the ringing's energy, in s: half of the 1 ms of a bare track.
const RINGS: f32 = 0.5e-3;
/// Bounds of the decay time, in s.
const RINGING: [f32; 2] = [0.05e-3, 5e-3];
/// Step of the search for the decay time, as a factor.
const FACTOR: f32 = 1.15;
/// Energy of the parts over that of the noise above which a share is reported.
const HEARD: f32 = 0.3;
/// Minimum share in gear for estimating the margin; below it too few impacts are in gear.
const LEAST: f32 = 0.1;
/// Smallest standard error of a share, due to the random errors of the predicted profiles.
///
/// This constant, [`EXCESS`] and [`UNALIGNED`] are calibrated: of 475 drawn lots, 68, 95 and 99.7 %
/// of the estimates are to lie within 1, 2 and 3 errors, and also where the gain is exact.
const COUNTED: f32 = 0.0175;
/// Standard error of a share per excess over the predicted one.
const EXCESS: f32 = 0.55;
/// Standard error of a share whose delay or decay time is at its bound.
const UNALIGNED: f32 = 0.1;
/// Shortest credible decay time of the energy, in s: two samples.
const MIN_DECAY: f32 = 0.1e-3;
/// Largest standard error of the share in gear at which it is reported.
const TELLS: f32 = 0.25;
/// Misfit of the parts to the lot above which they do not fit it; parts of the lot have 0 to 0.005.
const MAX_MISFIT: f32 = 0.03;
/// Factor on the least share in gear of a part of the lot; it covers an amplitude that is off.
const MIN_CREDIBLE_SHARE: f32 = 0.7;
/// Drive cycles in a row of a misfit that lasts (2.6 s at 50 Hz).
const MIN_MISFIT_CYCLES: f32 = 8.0 * AGAIN as f32;
/// Initial delay of an impact's energy, in samples: two one-pole filters and the ringing's rise.
const LATE: f32 = 2.5;
/// Bounds of that delay, in samples; an error of the amplitude shifts it.
const LATES: [f32; 2] = [-1.5, 6.5];
/// Step of the search for the delay, in samples.
const LATER: f32 = 0.5;
/// Trial points around the estimate: delays in steps of [`LATER`], decay times as powers of
/// [`FACTOR`].
const TRIES: [[f32; 2]; 3] = [[0.0, 1.0], [-1.0, 1.0 / FACTOR], [1.0, FACTOR]];
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
    energy: Row,
    noise: f32,
    /// Weight of both sums, in drive cycles.
    weight: f32,
}

impl Histogram {
    /// Adds the sectors of one cycle, with exponential forgetting; `memory` in drive cycles.
    fn add(&mut self, sectors: &Sectors, noise: f32, memory: f32) {
        let keep = 1.0 - 1.0 / memory;
        // Each cycle brings a quarter of the sectors, with the energy of four cycles.
        let keep_quarter = keep * keep * keep * keep;
        let sums = self.energy.iter_mut().skip(usize::from(sectors.first));
        for (sum, energy) in sums.zip(sectors.energy) {
            *sum = *sum * keep_quarter + energy;
        }
        self.noise = self.noise * keep + noise;
        self.weight = self.weight * keep + 1.0;
    }
}

/// Agreement of an energy histogram with the fitted mixture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Agreement {
    /// Share of time in gear by the fitted weights, 0..=1.
    in_gear: f32,
    /// Unexplained share of the energy (total variation distance) less its bound in gear.
    excess: f32,
}

impl Agreement {
    fn fits(&self) -> bool {
        self.excess < 0.0
    }
}

/// Evidence for READY: the predicted share, and the agreement of both histograms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearEvidence {
    /// Share of time in gear that the map predicts for the lot, 0..=1.
    predicted: f32,
    long: Agreement,
    short: Agreement,
}

impl GearEvidence {
    /// Whether the map predicts gear, and both histograms show a share above `level` (0..=1).
    pub fn supports(&self, level: f32) -> bool {
        self.predicted > MIN_PREDICTED_SHARE
            && self.long.in_gear > level
            && self.short.in_gear > level
    }

    /// Share of time in gear by the long histogram, 0..=1.
    pub fn in_gear(&self) -> f32 {
        self.long.in_gear
    }

    /// Whether the mixture fits both histograms.
    pub fn fits(&self) -> bool {
        self.long.fits() && self.short.fits()
    }
}

/// Estimator of the share of time in gear for any number of parts.
#[derive(Clone, Debug, Default)]
pub struct ShareHearing {
    k: f32,
    /// Mean upper tones (`e cos th`, `e sin th`) since then.
    tones: [[f32; 2]; UPPER],
    cycles: f32,
    /// Upper tones for which the profiles were predicted.
    profiled: [[f32; 2]; UPPER],
    profiler: Option<StrikeProfiler>,
    /// Energy of the last 256 cycles; the reported share is fitted to it.
    long: Histogram,
    due: u32,
    /// Energy of the last 0.3 s; changes of the parts are detected in it.
    short: Histogram,
    short_due: f32,
    /// Whether a fit to the short histogram is due.
    checks: bool,
    detects_gear: bool,
    evidence: Option<GearEvidence>,
    lead: Phase,
    /// Mean lead since the histogram began; a growing load turns the track.
    turned: Phase,
    step: u32,
    /// Amplitudes of the drive's own acceleration, cosine and sine, in m/s^2.
    swing: [f32; 2],
    /// Estimated decay time of the ringing's energy, in s.
    rings: f32,
    /// Estimated delay of the energy, in samples.
    late: f32,
    /// Whether the next search is for the delay.
    of_late: bool,
    fitting: Option<Fitting>,
    /// Weights of the last mixture, the starting point of the next fit; all 0 before the first.
    weights: [f32; PARTS],
    pub share: Option<GearShare>,
    pub margin: Option<GearMargin>,
    /// Whether the share was estimated before the track changed.
    fades: bool,
    pub judged: bool,
    /// Misfit of the parts to the lot in the last fit, and cycles in a row above [`MAX_MISFIT`].
    misfit: f32,
    misfit_cycles: f32,
}

/// Running search for decay time or delay: residual sum of squares at each trial point.
#[derive(Clone, Copy, Debug, Default)]
struct Fitting {
    tried: usize,
    off: [f32; TRIES.len()],
}

/// Fitted mixture.
#[derive(Clone, Copy, Debug)]
struct Mixture {
    /// Sum over the sectors of the squared residual over the expected energy.
    off: f32,
    /// Energy in other sectors than the mixture predicts.
    astray: f32,
    weights: [f32; PARTS],
    /// Covariance of the weights for a dispersion (reduced chi-square) of 1.
    covariance: Covariance,
}

impl GearShare {
    /// Estimate from a lower bound only: the middle of the remaining interval.
    pub(crate) fn at_least(least: f32) -> Self {
        let rest = 0.5 * (1.0 - least);
        Self {
            share: least + rest,
            error: rest,
        }
    }
}

impl ShareHearing {
    /// Estimator without any data.
    pub fn new() -> Self {
        Self {
            rings: RINGS,
            late: LATE,
            ..Self::default()
        }
    }

    /// Clears the histograms and the estimates; keeps the ringing parameters and the profiles.
    pub fn reset(&mut self) {
        self.begin();
        (self.cycles, self.fitting) = (0.0, None);
        self.unlearn();
    }

    fn begin(&mut self) {
        (self.long, self.due) = (Histogram::default(), 0);
        (self.short, self.short_due) = (Histogram::default(), 0.0);
        self.checks = false;
        self.weights = [0.0; PARTS];
    }

    fn unlearn(&mut self) {
        (self.share, self.margin) = (None, None);
        (self.fades, self.judged) = (false, false);
        self.evidence = None;
        (self.misfit, self.misfit_cycles) = (0.0, 0.0);
    }

    /// Evidence for READY; `None` before the first fit.
    pub fn evidence(&self) -> Option<&GearEvidence> {
        self.evidence.as_ref()
    }

    /// Predicted profile of the lot; `None` until the prediction is complete.
    pub fn profile(&self) -> Option<&StrikeProfile> {
        self.profiler.as_ref()?.profile()
    }

    /// Settings of the running strike count; `None` while none runs.
    #[cfg(any(test, feature = "memo"))]
    pub fn asked(&self) -> Option<&StrikeSettings> {
        self.profiler.as_ref()?.pending_settings()
    }

    /// Replaces the running count by a finished one ([`StrikeProfiler::set_stored_result`]).
    #[cfg(any(test, feature = "memo"))]
    pub fn know(&mut self, count: &StrikeCount) {
        if let Some(profiler) = &mut self.profiler {
            profiler.set_stored_result(count);
        }
    }

    /// Adds one drive cycle to the histograms, and schedules the fits.
    pub fn cycle(&mut self, cycle: &Cycle, tuned: &DriveState) {
        self.fade();
        if !tuned.stands {
            return;
        }
        self.follow(tuned);
        self.misfit_cycles = if self.misfit > MAX_MISFIT {
            self.misfit_cycles + 1.0
        } else {
            0.0
        };
        let noise = cycle.noise * cycle.noise * f32::from(cycle.samples);
        let frequency = tuned.step as f32 * SAMPLE_RATE as f32 * (1.0 / Phase::TURN as f32);
        let cycles = |seconds: f32, [low, high]: [f32; 2]| (seconds * frequency).clamp(low, high);
        let short_memory = cycles(SHORT_MEMORY, SHORT_MEMORY_CYCLES);
        self.short.add(&cycle.sectors, noise, short_memory);
        self.short_due += 1.0;
        self.detects_gear = tuned.detects_gear;
        self.long.add(&cycle.sectors, noise, MEMORY);
        let apart = (tuned.lead - self.turned).bits() as i32;
        self.turned += Phase::from_bits((apart as f32 / self.long.weight) as i32 as u32);
        self.lead = if apart.unsigned_abs() > TURNED {
            self.turned
        } else {
            tuned.lead
        };
        self.step = tuned.step;
        self.swing = [cycle.in_phase, cycle.quadrature];
        self.due += 1;
        if self.due >= AGAIN && self.long.weight > BEFORE {
            self.due = 0;
            if self.profile().is_some() && self.fitting.is_none() {
                self.fitting = Some(Fitting::default());
            }
        }
        self.checks |= self.short_due >= cycles(SHORT_FIT_PERIOD, SHORT_FIT_PERIOD_CYCLES)
            && self.short.weight > MIN_SHORT_WEIGHT;
    }

    /// Increases the error of a share estimated before the track changed, up to its withdrawal.
    fn fade(&mut self) {
        if let Some(share) = self.share.as_mut().filter(|_| self.fades) {
            share.error += FADES;
            if share.error > TELLS {
                self.unlearn();
            }
        }
    }

    /// Averages the track's motion, and predicts the profiles anew where it has changed.
    fn follow(&mut self, tuned: &DriveState) {
        self.cycles = (self.cycles + 1.0).min(16.0);
        let share = 1.0 / self.cycles;
        self.k += (tuned.k - self.k) * share;
        if tuned.shape.is_sine() {
            self.tones = [[0.0; 2]; UPPER];
        } else {
            let means = self.tones.as_flattened_mut().iter_mut();
            for (mean, part) in means.zip(tuned.shape.mixed().as_flattened()) {
                *mean += (part - *mean) * share;
            }
        }
        if self.cycles < 8.0 {
            return;
        }
        let order = u32::from(tuned.order.max(1));
        let apart = |a: f32, b: f32, most: f32| a - b > most || b - a > most;
        let Some((restitution, scatter)) = tuned.lot else {
            return;
        };
        if let Some(profiler) = &self.profiler {
            let settings = profiler.settings();
            let within = |most: f32| {
                let tones = self.tones.as_flattened().iter();
                let mut tones = tones.zip(self.profiled.as_flattened());
                settings.order == order
                    && !apart(settings.k, self.k, most * settings.k)
                    && tones.all(|(is, was)| !apart(*was, *is, most))
            };
            let (same, near) = (within(MOVED), within(NEAR));
            if same && settings.restitution == restitution && settings.scatter == scatter {
                return;
            }
            if !same {
                // The energy so far belongs to another motion; after a small change parts stay in
                // gear.
                self.begin();
                if near {
                    self.fades = true;
                } else {
                    self.unlearn();
                }
            }
        }
        self.fitting = None;
        self.profiled = self
            .tones
            .map(|tone| tone.map(|part| STEP_OF_TONES * libm::roundf(part / STEP_OF_TONES)));
        let tones = self.profiled.map(|[straight, across]| {
            let ratio = libm::sqrtf(straight * straight + across * across);
            if ratio < 1e-3 {
                [0.0; 2]
            } else {
                [ratio, libm::atan2f(across, straight)]
            }
        });
        // Outside the map's range there is no estimate.
        self.profiler = StrikeProfiler::new(StrikeSettings {
            restitution,
            scatter,
            order,
            k: rounded(self.k),
            tones,
            contact: tuned.contact,
        })
        .ok();
    }

    /// Runs one bounded slice of the estimate; returns whether more are due.
    pub fn step(&mut self) -> bool {
        if let Some(profiler) = &mut self.profiler
            && profiler.advance(SLICE)
        {
            return true;
        }
        if core::mem::take(&mut self.checks) {
            self.short_due = 0.0;
            self.check();
            return true;
        }
        let Some(mut fitting) = self.fitting.take() else {
            return false;
        };
        let Some([steps, factor]) = TRIES.get(fitting.tried) else {
            self.refine(&fitting.off);
            return false;
        };
        let (rings, late) = if self.of_late {
            (self.rings, self.late + LATER * steps)
        } else {
            (self.rings * factor, self.late)
        };
        let Some(rows) = self.rows(rings, late) else {
            return false;
        };
        let heard = self.heard(&self.long);
        let (by, weights, covariance) = self.fit_weights(&heard, &rows);
        let expected = mixed(&rows, &weights);
        if let Some(apart) = fitting.off.get_mut(fitting.tried) {
            *apart = off(&heard, &expected, &by);
        }
        if fitting.tried == 0 {
            self.tell(&Mixture {
                off: off(&heard, &expected, &expected),
                astray: astray(&heard, &expected),
                weights,
                covariance,
            });
        }
        fitting.tried += 1;
        self.fitting = Some(fitting);
        true
    }

    /// Fits the short histogram, after a first fit of the long one, where gear is to be detected.
    /// Its slice passes in any case: the other searches then run at the same times.
    fn check(&mut self) {
        if !self.detects_gear || self.evidence.is_none() {
            return;
        }
        let Some(rows) = self.rows(self.rings, self.late) else {
            return;
        };
        let heard = self.heard(&self.short);
        let (_, weights, _) = self.fit_weights(&heard, &rows);
        let astray = astray(&heard, &mixed(&rows, &weights));
        let short = self.agreement(&self.short, &weights, astray);
        if let (Some(evidence), Some(short)) = (&mut self.evidence, short) {
            evidence.short = short;
        }
    }

    /// Fits the mixture from the last one, by whose expected energy each sector is weighed. Returns
    /// that energy, the weights and their covariance.
    fn fit_weights(&self, heard: &Row, rows: &Rows) -> (Row, [f32; PARTS], Covariance) {
        let expecting = if self.weights == [0.0; PARTS] {
            unmix(heard, rows, &evened(heard), &self.weights).0
        } else {
            self.weights
        };
        let by = mixed(rows, &expecting);
        let (weights, covariance) = unmix(heard, rows, &by, &self.weights);
        (by, weights, covariance)
    }

    /// Updates share, margin and evidence from a mixture.
    fn tell(&mut self, found: &Mixture) {
        let noise = self.long.noise / self.long.weight;
        let aligned = LATES[0] < self.late && self.late < LATES[1] && self.rings > MIN_DECAY;
        let share = (self.profile()).and_then(|profile| told(found, profile, noise, aligned));
        let long = self.agreement(&self.long, &found.weights, found.astray);
        self.evidence = self
            .profile()
            .zip(long)
            .map(|(profile, long)| GearEvidence {
                predicted: profile.share(),
                long,
                short: self.evidence.map_or(long, |before| before.short),
            });
        self.misfit = self.misfit_of(long.as_ref());
        self.margin = share.and(self.margin_of(found));
        self.share = share;
        self.weights = found.weights;
        (self.fades, self.judged) = (false, true);
    }

    /// Misfit of the parts to the lot: energy that no mixture explains beyond its bound, plus the
    /// share that lacks to [`MIN_CREDIBLE_SHARE`] times the least of a part of the lot.
    fn misfit_of(&self, long: Option<&Agreement>) -> f32 {
        let (Some(long), Some(profile)) = (long, self.profile()) else {
            return 0.0;
        };
        let energy = self.long.energy.iter().sum::<f32>();
        if energy <= (1.0 + HEARD) * self.long.noise {
            return 0.0;
        }
        // Cycles of equal weight with the same variance of their mean.
        let weight = self.long.weight;
        let least = profile.least_share(weight / (1.0 - 0.5 * weight / MEMORY));
        long.excess.max(0.0) + (MIN_CREDIBLE_SHARE * least - long.in_gear).max(0.0)
    }

    /// Whether the parts do not fit the lot: their misfit lasts.
    pub fn is_misfit(&self) -> bool {
        self.misfit_cycles > MIN_MISFIT_CYCLES
    }

    /// Agreement of a histogram with the weights fitted to it; `astray` as of [`astray`].
    fn agreement(
        &self,
        histogram: &Histogram,
        weights: &[f32; PARTS],
        astray: f32,
    ) -> Option<Agreement> {
        let profiler = self.profiler.as_ref()?;
        let (settings, profile) = (profiler.settings(), profiler.profile()?);
        let within = weights[..GROUPS].iter().sum::<f32>();
        let without = weights[GROUPS..NOISE].iter().sum::<f32>();
        let even = (weights[NOISE] - histogram.noise / histogram.weight).max(0.0);
        let unexplained =
            (astray + even) / (struck(weights, profile) + even).max(f32::MIN_POSITIVE);
        let [systematic, random] = if knows_out(profile) || settings.scatter < MIN_SCATTER {
            MAX_UNEXPLAINED
        } else {
            MAX_UNEXPLAINED_WITHOUT_OUT
        };
        // Impacts of one part in gear; the number of parts is unknown.
        let impacts = histogram.weight / settings.order as f32;
        Some(Agreement {
            in_gear: within / (within + without).max(f32::MIN_POSITIVE),
            excess: unexplained - systematic - random / square_root_single(impacts),
        })
    }

    /// Margin of the parts in gear: restitution from the groups' weights, trace from their phases.
    fn margin_of(&self, found: &Mixture) -> Option<GearMargin> {
        let profiler = self.profiler.as_ref()?;
        let profile = profiler.profile()?;
        let StrikeSettings { k, scatter, .. } = *profiler.settings();
        let groups = &found.weights[..GROUPS];
        let all: f32 = groups.iter().sum();
        let out: f32 = found.weights[GROUPS..NOISE].iter().sum();
        if all <= LEAST * (all + out) {
            return None;
        }
        let middles: [f32; GROUPS] = core::array::from_fn(|group| profiler.restitution(group));
        let weighed = groups.iter().zip(middles);
        let restitution = weighed.map(|(weight, middle)| weight * middle).sum::<f32>() / all;
        let mut variance = 0.0_f32;
        for (row, one) in found.covariance.iter().zip(middles) {
            for (covariance, other) in row.iter().zip(middles) {
                variance += (one - restitution) * (other - restitution) * covariance;
            }
        }
        let dispersion = found.off / (SECTORS - PARTS - 1) as f32;
        // Restitutions within a group, and beyond the lot's ends, cannot be separated.
        let apart = middles[1] - middles[0];
        let error = libm::sqrtf(
            variance.max(0.0) * dispersion / (all * all)
                + apart * apart / 12.0
                + RESTITUTION_MARGIN * RESTITUTION_MARGIN,
        );
        // A group's phase follows from its restitution; the fit estimates the number of its parts.
        let each = groups.iter().zip(middles).zip(profile.launch_accelerations);
        let traces = each.map(|((weight, middle), bend)| {
            let squeezed = (1.0 + middle) * (1.0 + middle);
            weight * (1.0 + middle * middle - squeezed * bend / k)
        });
        let trace = traces.sum::<f32>() / all;
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
    fn refine(&mut self, [at, before, after]: &[f32; TRIES.len()]) {
        let bend = before + after - 2.0 * at;
        let slope = 0.5 * (after - before);
        let step = if bend > 0.0 {
            (-slope / bend).clamp(-1.0, 1.0)
        } else if slope > 0.0 {
            -1.0
        } else {
            1.0
        };
        if self.of_late {
            self.late = (self.late + step * LATER).clamp(LATES[0], LATES[1]);
        } else {
            self.rings = (self.rings * libm::powf(FACTOR, step)).clamp(RINGING[0], RINGING[1]);
        }
        self.of_late = !self.of_late;
    }

    /// Predicted energy of each component by sector, for a decay time in s and a delay in samples.
    fn rows(&self, rings: f32, late: f32) -> Option<Rows> {
        Some(predict_rows(
            self.profile()?,
            self.lead,
            self.step,
            rings,
            late,
        ))
    }

    /// Energy per cycle of a histogram, less the drive's own.
    fn heard(&self, histogram: &Histogram) -> Row {
        let inverse = 1.0 / histogram.weight;
        let leak = drive_leak(self.swing, self.step);
        let mut heard = [0.0; SECTORS];
        for ((heard, energy), leak) in heard.iter_mut().zip(&histogram.energy).zip(leak) {
            *heard = (energy * inverse - leak).max(0.0);
        }
        heard
    }
}

/// Rounds k to eight binary places: an error of at most 0.2 %, a fifth of [`MOVED`].
fn rounded(k: f32) -> f32 {
    const STEP: u32 = 1 << 15;
    f32::from_bits((k.to_bits() + STEP / 2) & !(STEP - 1))
}

/// The share of a mixture; `noise`: measured noise energy per cycle; `aligned`: delay and decay
/// time are within their bounds. `None` where noise drowns the parts or the error exceeds
/// [`TELLS`].
fn told(found: &Mixture, profile: &StrikeProfile, noise: f32, aligned: bool) -> Option<GearShare> {
    let within = found.weights[..GROUPS].iter().sum::<f32>();
    let without = found.weights[GROUPS..NOISE].iter().sum::<f32>();
    let energy = struck(&found.weights, profile);
    let all = within + without;
    if energy <= HEARD * found.weights[NOISE] || all <= 0.0 {
        return None;
    }
    let share = within / all;
    // Derivative of the share by each weight, times the sum of weights.
    let slope = |n: usize| match n {
        n if n < GROUPS => 1.0 - share,
        n if n < NOISE => -share,
        _ => 0.0,
    };
    let mut variance = 0.0;
    for (a, row) in found.covariance.iter().enumerate() {
        for (b, covariance) in row.iter().enumerate() {
            variance += slope(a) * slope(b) * covariance;
        }
    }
    let dispersion = found.off / (SECTORS - PARTS - 1) as f32;
    let scattered = variance.max(0.0) * dispersion / (all * all);
    // Energy that no profile explains may be of parts in gear or out.
    let even = (found.weights[NOISE] - noise).max(0.0);
    let astray = (found.astray + even) / (energy + found.weights[NOISE]);
    let excess = EXCESS * (share - profile.share()).max(0.0);
    let unaligned = if aligned { 0.0 } else { UNALIGNED };
    let systematic = [COUNTED, astray, excess, unaligned];
    let squares = systematic.map(|error| error * error);
    let error = square_root_single(scattered + squares.iter().sum::<f32>());
    (error < TELLS).then_some(GearShare { share, error })
}

#[cfg(test)]
mod tests {
    use super::{Agreement, GearEvidence, MIN_PREDICTED_SHARE};

    #[test]
    fn evidence_for_ready_needs_both_histograms() {
        let agreement = |in_gear| Agreement {
            in_gear,
            excess: -0.1,
        };
        let supports = |predicted, long, short| {
            let evidence = GearEvidence {
                predicted,
                long: agreement(long),
                short: agreement(short),
            };
            evidence.supports(0.5)
        };
        assert!(supports(0.9, 0.6, 0.6));
        assert!(!supports(0.9, 0.4, 0.6));
        assert!(!supports(0.9, 0.6, 0.4));
        assert!(!supports(MIN_PREDICTED_SHARE, 0.6, 0.6));
    }
}
