//! Identifies the restitution of the parts from their chatter, as a sequence of drive levels.
//!
//! The track throws a part at rest at arcsin k. The intervals to its further impacts depend on its
//! restitution. A synchronous average is compared with the chatter that the map predicts.
//!
//! A small k gives long and loud hops, but parts must rest before they are thrown again. The search
//! descends from [`FIRST_K`] until impacts are detected while a resting part would fly. Then parts
//! are brought to rest, and averaged at a level with rest, until one restitution exceeds all others
//! by a likelihood ratio. The spread of the averages gives the standard error.

use super::bounce_train::BounceTrain;
use super::fit::{Fit, LANDING_OFFSET, Verdict};
use crate::hear::{BINS_PER_CYCLE, BinLayout, DetectedImpact, Listener};
use crate::{Cycle, GearMargin, phase_of};
use core::f32::consts::TAU;
use heapless::Vec;
use kband::arithmetic::{Phase, square_root_single};
use kband::impact::ContactTime;
use serde::{Deserialize, Serialize};

/// k of the first level: a part of R = 0.84 still rests each cycle there.
pub const FIRST_K: f64 = 0.87;
/// Ratio of k between successive levels: less than the 4 to 9 % by which [`resting_k`] overshoots.
const LEVEL_RATIO: f64 = 0.965;
/// Lowest k of the descent: parts that still rest there have R up to 0.25.
const LOWEST_K: f64 = 0.42;
/// k at which the parts come to rest. It is above the last lock of order 1 for R up to 0.8, which
/// ends at k = (1 + R)/(pi (1 - R)) (docs/theory-bands.md#t5.2).
const REST_K: f64 = 3.0;
/// Drive cycles within [`SETTLED_TOLERANCE`] before a level counts: four time constants of a kick.
const SETTLING_CYCLES: u8 = 20;
/// Duration of the check at a level, in drive cycles.
const CHECK_CYCLES: u8 = 20;
/// Number of impacts during flight that shows parts without rest: one or two may be noise.
const MIN_FLIGHT_IMPACTS: u8 = 3;
/// Tolerance before lift-off, in rad, for the end of a late chatter.
const LIFT_OFF_MARGIN: f32 = 0.5;
/// Tolerance before the first landing, in rad: an error of k of 1 % (0.1 rad) and the stamp (0.05).
const LANDING_MARGIN: f32 = 0.3;
/// Drive cycles per average, each with one hop of every part: a quarter of the noise remains.
const AVERAGED_CYCLES: u16 = 16;
/// Minimum number of averages for a result, one at each k of the [`AVERAGED_K_RANGE`].
const MIN_AVERAGES: usize = 4;
/// Largest number of averages; half as many if only noise is measured.
const MAX_AVERAGES: usize = 16;
/// Relative range of k over the averages. It moves the second impact by about half a period of the
/// ringing (0.05 to 0.11 rad for R of 0.1 to 0.8). So two ringings meet in every phase.
const AVERAGED_K_RANGE: f64 = 0.05;
/// Largest relative underestimate of k by the ringing of resting parts ([`Signal`](crate::Signal)).
const MAX_K_UNDERESTIMATE: f64 = 0.03;
/// Relative step below the k of the first impacts in flight at which parts surely do not rest.
const HOPPING_K_STEP: f64 = 0.08;
/// Largest relative error of the amplitude for settling: 1 %, as everywhere.
const SETTLED_TOLERANCE: f32 = 0.01;
/// Largest relative error of the amplitude during a check or an average.
const MEASURING_TOLERANCE: f32 = 0.03;
/// Largest relative error of the amplitude while the parts come to rest.
const REST_TOLERANCE: f32 = 0.2;
/// Threshold on twice the log likelihood ratio ([`Fit::evidence`]) for a result: a ratio of e^24.
const MIN_EVIDENCE: f32 = 48.0;
/// Lowest restitution separable from 0: its second impact drowns in the first one's ringing.
const MIN_RESTITUTION: f32 = 0.04;
/// Time limit in drive cycles: twice the need of some 20 levels and 16 averages of 40 to 70 cycles.
const TIME_LIMIT_CYCLES: u16 = 4000;
/// k at which R of about 0.3, 0.1, 0.5 enters gear from rest (docs/theory-real-parts.md#t10.1).
const GEAR_CHECK_K: [f64; 3] = [0.46, 0.37, 0.55];
/// Duration of that check, in drive cycles.
const GEAR_CHECK_CYCLES: u16 = 300;
/// Largest standard error of a restitution estimated in gear: that of 25 impacts at s = 0.10.
const MAX_GEAR_ERROR: f32 = 0.02;
/// Standard error of the selection bias over s^2: certain impacts end gear, which biases R.
const SELECTION_ERROR: f32 = 2.0;
/// Largest estimated scatter that counts as none: three times the stamp error of a sample at 50 Hz.
const MAX_NO_SCATTER: f32 = 0.015;
/// Largest difference between averages and gear for agreement: 1 % of k is 0.01 in R.
const AGREEMENT_TOLERANCE: f32 = 0.02;
/// Threshold on the estimated number of parts for several; one gives at most 1.05, two give 2.2.
const MIN_SEVERAL_PARTS: f32 = 1.5;
/// Standard error by sampling and bias, times squared samples per turn: 0.0018 at 50 Hz.
const SAMPLING_ERROR: f32 = 288.0;
/// Largest standard error of a result: a lot of twice that to either side is the default's width.
const MAX_ERROR: f32 = 0.01;

/// Identified restitution.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identified {
    /// Restitution normal to the track (symbol R).
    pub restitution: f32,
    /// Standard error of the restitution, from the spread of the averages.
    pub deviation: f32,
    /// k at which the parts hopped.
    pub k: f32,
    /// Scatter of restitution from impact to impact (symbol s); 0 without detected scatter.
    pub scatter: f32,
    /// Number of hops in the estimate.
    pub hops: u16,
}

/// Reason for a missing result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Unidentified {
    /// Nothing repeats every cycle: no parts, or impacts too faint for detection.
    Quiet,
    /// A repeating signal that is not the chatter of one restitution.
    Unlike,
    /// Second impact lost in the ringing of the first: restitution near 0, or scatter near it.
    Dead,
    /// Only the first landing repeats: restitution scatters, by impact or by part.
    Scattered,
    /// The drive did not hold the requested amplitudes within the time limit.
    Unsteady,
}

/// Progress of an identification.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Identification {
    /// Not requested.
    #[default]
    Idle,
    /// Running.
    Listening {
        /// Number of hops so far.
        hops: u16,
    },
    /// Finished with a result.
    Found(Identified),
    /// Finished without a result.
    NotFound(Unidentified),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// Settling of the amplitude: cycles within tolerance.
    Settling(u8),
    /// Check whether the parts rest: cycles, and impacts during flight.
    Listening(u8, u8),
    /// Average: start phase of the output, and cycles.
    Averaging(Phase, u16),
    Collecting,
    Comparing,
    /// Check of parts in gear: cycles.
    Checking(u16),
}

/// Effect of a drive cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    Going,
    /// New level at this k.
    At(f64),
    /// Finished; whether with a result.
    Done(bool),
}

/// State of the drive in one cycle.
#[derive(Clone, Copy, Debug)]
pub struct Driven<'a> {
    /// Relative error of the amplitude; infinite while it changes.
    pub amplitude_error: f32,
    pub k: f64,
    /// Phase lead of the track over the output.
    pub lead: Phase,
    /// Lowest k that the drive reaches.
    pub min_k: f64,
    /// Gravity normal to the track in m/s^2.
    pub normal_gravity: f32,
    /// Advance of the phase per sample.
    pub step: u32,
    /// Estimates of parts in gear, of any restitution.
    pub listener: &'a Listener,
}

/// Sequence of one identification.
#[derive(Clone, Debug)]
pub struct Identifier {
    pub result: Identification,
    stage: Stage,
    k: f64,
    /// Sum of the measured k over an average.
    sum: f64,
    /// Residual energy less noise, summed over the cycles of all averages.
    energy: f32,
    /// Squared first landing speed over `b w k`, summed over the same cycles.
    squares: f32,
    turns_a_sample: f32,
    /// Number of cycles in all averages with a detected impact.
    cycles_with_impact: u16,
    fit: Fit,
    /// k of the first average; `None` during the descent.
    first: Option<f64>,
    /// Restitutions of the averages with a chatter, and the number of all averages.
    estimates: Vec<f32, MAX_AVERAGES>,
    averages: usize,
    hops: u16,
    /// Result of the averages, and the number of gear checks begun.
    averages_result: Option<Identification>,
    checks: usize,
    /// Age in drive cycles.
    age: u16,
}

impl Identifier {
    pub fn new() -> Self {
        Self {
            result: Identification::Idle,
            stage: Stage::Settling(0),
            k: FIRST_K,
            sum: 0.0,
            energy: 0.0,
            squares: 0.0,
            turns_a_sample: 0.0,
            cycles_with_impact: 0,
            fit: Fit::empty(),
            first: None,
            estimates: Vec::new(),
            averages: 0,
            hops: 0,
            averages_result: None,
            checks: 0,
            age: 0,
        }
    }

    /// Begins an identification at [`FIRST_K`], for impacts of this duration.
    pub fn begin(&mut self, contact: ContactTime) {
        *self = Self::new();
        self.fit.contact = contact;
        self.result = Identification::Listening { hops: 0 };
    }

    /// Aborts a running identification; a result remains.
    pub fn stop(&mut self) {
        if self.is_running() {
            *self = Self::new();
        }
    }

    pub fn is_running(&self) -> bool {
        matches!(self.result, Identification::Listening { .. })
    }

    /// Restarts the settling: the drive does something else, and the running average is invalid.
    pub fn interrupt(&mut self) {
        self.stage = Stage::Settling(0);
    }

    /// As [`Identifier::interrupt`], while the amplitude changes; counts towards the time limit.
    pub fn wait(&mut self) -> Step {
        self.interrupt();
        self.check_time_limit()
    }

    fn check_time_limit(&mut self) -> Step {
        self.age = self.age.saturating_add(1);
        if self.age < TIME_LIMIT_CYCLES {
            return Step::Going;
        }
        self.end(Identification::NotFound(Unidentified::Unsteady))
    }

    /// Start phase of a requested average.
    pub fn average_from(&self) -> Option<Phase> {
        match self.stage {
            Stage::Averaging(from, _) => Some(from),
            _ => None,
        }
    }

    pub fn cycle(&mut self, driven: &Driven<'_>, cycle: &Cycle) -> Step {
        let average = &cycle.average;
        let old = self.check_time_limit();
        if old != Step::Going {
            return old;
        }
        match self.stage {
            Stage::Settling(cycles) => {
                let tolerance = if self.k > 1.0 {
                    REST_TOLERANCE
                } else {
                    SETTLED_TOLERANCE
                };
                // The rest of an interrupted average must be transferred first.
                let is_settled = driven.amplitude_error < tolerance && average.first == 0;
                let cycles = if is_settled { cycles + 1 } else { 0 };
                self.stage = Stage::Settling(cycles);
                if cycles >= SETTLING_CYCLES {
                    return self.settled(driven.lead);
                }
            }
            Stage::Listening(..) | Stage::Averaging(..)
                if driven.amplitude_error > MEASURING_TOLERANCE =>
            {
                self.stage = Stage::Settling(0);
            }
            Stage::Listening(cycles, airborne_impacts) => {
                let airborne_impacts =
                    airborne_impacts.saturating_add(self.airborne_impacts(cycle, driven.lead));
                self.stage = Stage::Listening(cycles + 1, airborne_impacts);
                if airborne_impacts >= MIN_FLIGHT_IMPACTS {
                    return self.begin_averages(self.k * (1.0 - HOPPING_K_STEP));
                }
                if cycles + 1 >= CHECK_CYCLES {
                    let next = self.k * LEVEL_RATIO;
                    return if next < LOWEST_K.max(driven.min_k) {
                        self.begin_averages(0.0)
                    } else {
                        self.set_level(next)
                    };
                }
            }
            Stage::Averaging(from, cycles) => {
                self.sum += driven.k;
                self.turns_a_sample = driven.step as f32 * (1.0 / Phase::TURN as f32);
                self.cycles_with_impact += u16::from(!cycle.impacts.is_empty());
                let noise = cycle.noise * cycle.noise * f32::from(cycle.samples);
                self.energy += cycle.sectors.energy.iter().sum::<f32>() - noise;
                let from_rest = driven.listener.gear.landing_speed_from_rest();
                let speed = from_rest / driven.k as f32;
                self.squares += speed * speed;
                self.stage = if cycles + 1 < AVERAGED_CYCLES {
                    Stage::Averaging(from, cycles + 1)
                } else {
                    Stage::Collecting
                };
            }
            Stage::Collecting => {
                if let Some(first) = usize::from(average.first).checked_sub(1) {
                    self.fit.store(first, &average.residual);
                    if first + BINS_PER_CYCLE >= BinLayout::from_step(driven.step).bins {
                        let k = self.sum / f64::from(AVERAGED_CYCLES);
                        self.fit.begin(k, driven.normal_gravity, driven.step);
                        self.stage = Stage::Comparing;
                    }
                }
            }
            Stage::Checking(cycles) => {
                self.stage = Stage::Checking(cycles + 1);
                if let (true, Some(result)) =
                    (cycles + 1 >= GEAR_CHECK_CYCLES, self.averages_result)
                {
                    let margin = driven.listener.margin().filter(|margin| {
                        let count = self.estimate_parts(driven, margin.restitution);
                        count.is_some_and(|count| count < MIN_SEVERAL_PARTS)
                    });
                    return self.end_gear_check(margin, result);
                }
            }
            Stage::Comparing => {
                if !self.fit.busy() {
                    return self.evaluate_average();
                }
            }
        }
        Step::Going
    }

    /// Runs one slice of the comparison; returns whether it did any work.
    pub fn step(&mut self) -> bool {
        self.stage == Stage::Comparing && self.fit.step()
    }

    fn settled(&mut self, lead: Phase) -> Step {
        if self.averages_result.is_some() {
            self.stage = Stage::Checking(0);
            return Step::Going;
        }
        let bounces = BounceTrain::simulate(self.k, 0.5, self.fit.contact);
        match (self.first, bounces) {
            (None, _) => self.stage = Stage::Listening(0, 0),
            (Some(first), None) => return self.set_level(first),
            (Some(_), Some(bounces)) => {
                let landing = Phase::from_radians(f64::from(bounces.landing));
                self.sum = 0.0;
                self.stage = Stage::Averaging(landing - lead - phase_of(LANDING_OFFSET), 0);
            }
        }
        Step::Going
    }

    /// Brings the parts to rest before averages at a k with rest; `hopping`: a k without rest.
    fn begin_averages(&mut self, hopping: f64) -> Step {
        let first = resting_k(self.k);
        self.first = Some(first);
        (self.fit).set_grid((first * (1.0 + MAX_K_UNDERESTIMATE), hopping));
        self.set_level(REST_K)
    }

    fn set_level(&mut self, k: f64) -> Step {
        self.k = k;
        self.stage = Stage::Settling(0);
        Step::At(k)
    }

    /// Number of impacts while a part that rests each cycle would fly.
    fn airborne_impacts(&self, cycle: &Cycle, lead: Phase) -> u8 {
        let lift_off = libm::asin(self.k) as f32;
        let bounces = BounceTrain::simulate(self.k, 0.5, self.fit.contact);
        let landing = bounces.map_or(TAU, |bounces| bounces.landing);
        let in_air = landing - LANDING_MARGIN - (lift_off - LIFT_OFF_MARGIN);
        let since = phase_of(lift_off - LIFT_OFF_MARGIN);
        let after = |impact: &DetectedImpact| (impact.phase + lead - since).radians() as f32;
        let airborne_impacts = cycle.impacts.iter().filter(|impact| after(impact) < in_air);
        airborne_impacts.count() as u8
    }

    fn evaluate_average(&mut self) -> Step {
        self.averages += 1;
        let verdict = self.fit.verdict;
        if let Verdict::Restitution(restitution) = verdict
            && self.estimates.push(restitution).is_ok()
        {
            self.hops += AVERAGED_CYCLES;
            self.result = Identification::Listening { hops: self.hops };
            if self.estimates.len() >= MIN_AVERAGES && self.fit.train_evidence() < -MIN_EVIDENCE {
                return self.begin_gear_check(Identification::NotFound(Unidentified::Scattered));
            }
            if let Some(fitted) = self.combine_averages() {
                return self.begin_gear_check(if fitted.restitution < MIN_RESTITUTION {
                    Identification::NotFound(Unidentified::Dead)
                } else {
                    Identification::Found(fitted)
                });
            }
        }
        let is_silent = verdict == Verdict::Quiet && self.estimates.is_empty();
        let max_averages = MAX_AVERAGES / if is_silent { 2 } else { 1 };
        match (self.first, verdict) {
            (Some(first), _) if self.averages < max_averages => {
                let step = self.averages % MIN_AVERAGES;
                let increase = AVERAGED_K_RANGE * step as f64 / (MIN_AVERAGES - 1) as f64;
                self.set_level(first * (1.0 + increase))
            }
            // Impacts that do not repeat come from parts that scatter.
            _ if is_silent
                && 2 * self.cycles_with_impact < AVERAGED_CYCLES * self.averages as u16 =>
            {
                self.end(Identification::NotFound(Unidentified::Quiet))
            }
            _ => self.begin_gear_check(Identification::NotFound(Unidentified::Unlike)),
        }
    }

    /// Checks the averages' result against the restitution in gear: scattered parts repeat none.
    fn begin_gear_check(&mut self, result: Identification) -> Step {
        self.averages_result = Some(result);
        match GEAR_CHECK_K.get(self.checks) {
            Some(&k) => {
                self.checks += 1;
                self.set_level(k)
            }
            None => self.end(result),
        }
    }

    /// Combines the estimate in gear with the result of the averages.
    fn end_gear_check(&mut self, margin: Option<GearMargin>, result: Identification) -> Step {
        let Some(margin) = margin.filter(|margin| margin.error < MAX_GEAR_ERROR) else {
            return self.begin_gear_check(result);
        };
        let scatters = margin.scatter > MAX_NO_SCATTER;
        let scatter = if scatters { margin.scatter } else { 0.0 };
        self.end(match result {
            Identification::Found(fitted)
                if (fitted.restitution - margin.restitution).abs()
                    < AGREEMENT_TOLERANCE.max(3.0 * margin.error) =>
            {
                Identification::Found(Identified { scatter, ..fitted })
            }
            _ if scatter > 0.0 => Identification::Found(Identified {
                restitution: margin.restitution,
                deviation: combine_errors(margin.error, SELECTION_ERROR * scatter * scatter),
                k: self.k as f32,
                scatter,
                hops: GEAR_CHECK_CYCLES,
            }),
            // Without scatter the averages are more accurate.
            _ => result,
        })
    }

    /// Estimates the number n of parts from two energies: n^2 of joint landings, n in gear.
    fn estimate_parts(&self, driven: &Driven<'_>, restitution: f32) -> Option<f32> {
        let bounces = BounceTrain::simulate(self.first?, restitution, self.fit.contact)?;
        let trained: f32 = (bounces.impacts.iter().map(|(_, speed)| speed * speed)).sum();
        let relative_energy = self.energy / (self.squares * trained);
        let k = driven.k as f32;
        Some(relative_energy / (driven.listener.gear.energy_per_squared_speed()? * k * k))
    }

    /// Result of the averages; `None` before it is significant and accurate enough.
    fn combine_averages(&self) -> Option<Identified> {
        let mean = self.fit.all()?;
        let squares: f32 = self.estimates.iter().map(|r| (r - mean) * (r - mean)).sum();
        let count = self.estimates.len().max(2) as f32;
        let deviation = square_root_single(squares / (count * (count - 1.0)));
        let repeats = mean < MIN_RESTITUTION || self.fit.train_evidence() > MIN_EVIDENCE;
        let is_consistent = self.estimates.len() >= MIN_AVERAGES
            && deviation < MAX_ERROR
            && self.fit.evidence() > MIN_EVIDENCE
            && repeats;
        let sampled = SAMPLING_ERROR * self.turns_a_sample * self.turns_a_sample;
        is_consistent.then_some(Identified {
            restitution: mean,
            deviation: combine_errors(deviation, sampled),
            k: self.first? as f32,
            scatter: 0.0,
            hops: self.hops,
        })
    }

    fn end(&mut self, result: Identification) -> Step {
        self.result = result;
        self.stage = Stage::Settling(0);
        Step::Done(matches!(result, Identification::Found(_)))
    }
}

fn combine_errors(one: f32, other: f32) -> f32 {
    square_root_single(one * one + other * other)
}

/// k at which parts surely rest each cycle, after impacts in flight at `k`. It is a fit to
/// measurements, 4 to 9 % above the k at which parts of R = 0.3 to 0.8 cease to rest.
fn resting_k(k: f64) -> f64 {
    k * (1.17 - 0.44 * (k - 0.6).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the parts scatter, the gear's restitution replaces one that it contradicts.
    #[test]
    fn gear_corrects_averages_that_it_contradicts() {
        let fitted = Identified {
            restitution: 0.3,
            deviation: 0.004,
            k: 0.5,
            scatter: 0.0,
            hops: 300,
        };
        for (restitution, scatter, expected) in [
            (0.329, 0.05, (0.3, 0.05)),
            (0.271, 0.05, (0.3, 0.05)),
            (0.332, 0.05, (0.332, 0.05)),
            (0.5, 0.01, (0.3, 0.0)),
        ] {
            let mut identifier = Identifier::new();
            let margin = GearMargin {
                restitution,
                error: 0.01,
                scatter,
                ..GearMargin::default()
            };
            identifier.end_gear_check(Some(margin), Identification::Found(fitted));
            let Identification::Found(found) = identifier.result else {
                panic!("{restitution}: {:?}", identifier.result);
            };
            assert_eq!((found.restitution, found.scatter), expected);
        }
    }

    #[test]
    fn result_stays_until_the_next_identification() {
        let mut identifier = Identifier::new();
        assert_eq!(identifier.result, Identification::Idle);
        identifier.begin(ContactTime::INSTANT);
        assert!(identifier.is_running());
        identifier.stop();
        assert_eq!(identifier.result, Identification::Idle);
        identifier.begin(ContactTime::INSTANT);
        let done = Identification::NotFound(Unidentified::Unlike);
        assert_eq!(identifier.end(done), Step::Done(false));
        identifier.stop();
        assert_eq!(identifier.result, done);
        identifier.begin(ContactTime::INSTANT);
        assert!(identifier.is_running());
    }
}
