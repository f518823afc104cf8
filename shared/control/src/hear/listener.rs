//! Detects lock, gear and regime of the parts, and an empty track, from all estimators.
//!
//! Gear is detected with hysteresis; time limits confirm gear and an empty track.

use super::gear::{DriveState, GearEstimator, GearMargin};
use super::phases::{LockWindow, PhaseStatistics};
use super::share::{GearEvidence, GearShare, ShareEstimator};
use super::signal::Cycle;
use crate::angle::{SAMPLE_RATE, impact_time, phase_of, radians_of};
use kband::arithmetic::Phase;
use kband::feeder::OutOfRange;
use kband::regime::classify::{Classifier, Regime, TimingAccuracy, Verdict};
use kband::regime::gear::StrikeProfile;

/// Period of the regime's classification, in drive cycles. It is the most expensive task.
const CLASSIFICATION_PERIOD_CYCLES: u32 = 8;
/// Largest error at which a share with only a lower bound is reported.
const MAX_BOUND_ERROR: f32 = 0.1;
/// Ratio of single flights to the share of all parts below which several parts are on the track.
const MIN_SINGLE_FLIGHT_RATIO: f32 = 0.5;
/// Share of time in gear above which gear is detected.
const GEAR_DETECTED_SHARE: f32 = 0.5;
/// Largest error of a share below [`FULL_SHARE`] at which gear is detected. Lots in gear had less.
const MAX_DETECTION_ERROR: f32 = 0.18;
/// Share above which gear is detected with any error: parts scatter less than configured.
const FULL_SHARE: f32 = 0.985;
/// Share of time in gear below which gear is lost (hysteresis).
const GEAR_LOST_SHARE: f32 = 0.4;
/// Share of time in single flights above which they prove gear of one part alone.
const MIN_SINGLE_FLIGHTS: f32 = 0.99;
/// Share of time in single flights below which that proof is lost (hysteresis).
const LOST_SINGLE_FLIGHTS: f32 = 0.9;
/// Minimum drive cycles without contradiction before gear is detected again.
const MIN_SUPPORTED_CYCLES: f32 = 24.0;
/// Minimum time without contradiction, in s.
const MIN_SUPPORTED_SECONDS: f32 = 0.4;
/// Largest error of the mean stamped phase of landings from rest, in rad.
const MAX_LANDING_ERROR: f32 = 0.15;
/// Minimum time without an impact for an empty track, in s.
const EMPTY_SECONDS: f32 = 1.0;
/// Minimum time without an impact for an empty track, in flights of the gear.
const EMPTY_FLIGHTS: f32 = 4.0;

#[derive(Clone, Debug)]
pub struct Listener {
    pub phases: PhaseStatistics,
    pub gear: GearEstimator,
    pub share: ShareEstimator,
    classifier: Classifier<64>,
    pub regime: Option<Verdict>,
    /// Whether the parts are in gear for more than half of their time.
    pub in_gear_detected: bool,
    silent_cycles: f32,
    /// Whether the track is empty: no impact for a second.
    pub empty: bool,
    /// Number of drive cycles since the energy last contradicted gear.
    supported: f32,
    /// Frequency of the drive in Hz.
    frequency: f32,
    pub always_classifies: bool,
}

impl Listener {
    /// Listener without any data; refused outside the classifier's range.
    pub fn build() -> Result<Self, OutOfRange> {
        Ok(Self {
            phases: PhaseStatistics::default(),
            gear: GearEstimator::default(),
            share: ShareEstimator::new(),
            classifier: Classifier::build(TimingAccuracy::BOARD)?,
            regime: None,
            in_gear_detected: false,
            silent_cycles: 0.0,
            empty: false,
            supported: f32::INFINITY,
            frequency: 0.0,
            always_classifies: true,
        })
    }

    /// Restarts the classifier, with the count of cycles.
    pub fn begin(&mut self) {
        if let Ok(fresh) = Classifier::build(TimingAccuracy::BOARD) {
            self.classifier = fresh;
        }
    }

    pub fn clear(&mut self) {
        self.phases = PhaseStatistics::default();
        self.gear.reset();
        self.share.reset();
        self.classifier.forget();
        self.regime = None;
        (self.in_gear_detected, self.supported, self.silent_cycles) = (false, f32::INFINITY, 0.0);
    }

    pub fn cycle(&mut self, cycle: &Cycle, drive_state: &DriveState, lock: Option<&LockWindow>) {
        let DriveState { count, lead, .. } = *drive_state;
        self.gear.cycle(cycle, drive_state);
        self.share.cycle(cycle, drive_state);
        self.frequency = drive_state.step as f32 * SAMPLE_RATE as f32 * (1.0 / Phase::TURN as f32);
        self.watch_silence(cycle, drive_state.order);
        if drive_state.detects_gear {
            self.update_gear_detection();
        }
        self.phases.cycle(cycle, count, lead, lock);
        for impact in &cycle.impacts {
            let time = impact_time(count, impact.phase, lead);
            (self.classifier).impact((time >> 32) as u32, Phase::from_bits(time as u32));
        }
        self.classifier.cycle(count);
        if count.is_multiple_of(CLASSIFICATION_PERIOD_CYCLES)
            && (self.always_classifies || drive_state.needs_regime)
        {
            self.regime = Some(self.correct_verdict(self.classifier.verdict(), lock));
        }
    }

    /// Detects an empty track (no impact for a second and four flights), and clears the estimates.
    fn watch_silence(&mut self, cycle: &Cycle, order: u8) {
        if !cycle.impacts.is_empty() {
            (self.silent_cycles, self.empty) = (0.0, false);
            return;
        }
        self.silent_cycles += 1.0;
        let max_silence = (EMPTY_SECONDS * self.frequency).max(EMPTY_FLIGHTS * f32::from(order));
        self.empty = self.silent_cycles > max_silence;
        if self.empty {
            self.gear.reset();
            self.share.reset();
        }
    }

    /// Detects gear, and counts the cycles without contradiction by the energy.
    fn update_gear_detection(&mut self) {
        let one = self.is_one_in_gear(LOST_SINGLE_FLIGHTS);
        let refuted = self.share.evidence.is_some_and(|evidence| {
            !(evidence.supports(GEAR_LOST_SHARE) && (evidence.fits() || one))
        });
        self.supported = if refuted { 0.0 } else { self.supported + 1.0 };
        self.in_gear_detected = self.detect_gear();
    }

    /// Whether the parts are in gear for more than half of their time, with hysteresis. The map
    /// must support gear, and the energy fit it; or nearly all flights are single ones of one part.
    fn detect_gear(&self) -> bool {
        let Some(evidence) = self.share.evidence else {
            return self.in_gear_detected && self.in_gear_at_least() > GEAR_LOST_SHARE;
        };
        let (level, single) = if self.in_gear_detected {
            (GEAR_LOST_SHARE, LOST_SINGLE_FLIGHTS)
        } else {
            (GEAR_DETECTED_SHARE, MIN_SINGLE_FLIGHTS)
        };
        let shares = match self.share.share {
            Some(estimate) if self.in_gear_detected => estimate.share > GEAR_LOST_SHARE,
            Some(estimate) => {
                let certain = estimate.error < MAX_DETECTION_ERROR || estimate.share > FULL_SHARE;
                certain && estimate.share - estimate.error > GEAR_DETECTED_SHARE
            }
            None => false,
        };
        let supported = MIN_SUPPORTED_CYCLES.max(MIN_SUPPORTED_SECONDS * self.frequency);
        (self.in_gear_detected || self.supported > supported)
            && evidence.supports(level)
            && (evidence.fits() && shares || self.is_one_in_gear(single))
    }

    /// Whether the parts do not fit the lot. One part in gear gives its restitution instead.
    pub fn is_misfit(&self) -> bool {
        let in_gear = |evidence: GearEvidence| evidence.long.in_gear > GEAR_LOST_SHARE;
        self.share.is_misfit()
            && !(self.gear.share() > GEAR_LOST_SHARE && self.share.evidence.is_some_and(in_gear))
    }

    /// Whether single flights of one part take a share of the time above `level` (0..=1), at a
    /// phase of gear. Parts that rest together strike as regularly (docs/theory-bands.md#t5.1).
    fn is_one_in_gear(&self, level: f32) -> bool {
        self.gear.share() > level && self.gear.may_stay_in_gear_at(self.phases.phase())
    }

    /// Corrects a verdict of parts that land from rest or where gear repels: they hop and rest.
    fn correct_verdict(&self, verdict: Verdict, lock: Option<&LockWindow>) -> Verdict {
        let phase = self.phases.phase();
        let within = |middle: Phase, width: f32| radians_of(phase_of(phase) - middle).abs() < width;
        let is_at_lock = lock.is_some_and(|lock| within(lock.phase, lock.width));
        let landing = self.gear.landing_phase_from_rest();
        let is_landing = landing.is_some_and(|at| within(phase_of(at), MAX_LANDING_ERROR));
        if self.gear.may_lock_at(phase) && (is_at_lock || !is_landing) {
            return verdict;
        }
        let regime = match verdict.regime {
            Regime::Locked { order } => Regime::HopAndRest { cycles: order },
            Regime::Doubled { order, doublings } => Regime::HopAndRest {
                cycles: order << doublings,
            },
            Regime::Chaotic => Regime::Undecided,
            other => other,
        };
        Verdict { regime, ..verdict }
    }

    /// Margin of one part to the loss of gear; `None` with too few impacts, and for several parts.
    pub fn margin(&self) -> Option<GearMargin> {
        let mut margin = self.gear.margin()?;
        if self.share.share.is_some() && !self.is_one() {
            return None;
        }
        if self.gear.time_to_loss().is_infinite()
            && let Some(profile) = self.share.profile()
        {
            margin.to_loss = margin.to_loss.max(profile.time_to_loss());
        }
        Some(margin)
    }

    /// Mean drive cycles in gear per loss: measured of one part, else predicted for the lot.
    pub fn time_to_loss(&self) -> f32 {
        let measured = self.gear.time_to_loss();
        if measured.is_finite() && self.margin().is_some() {
            return measured;
        }
        (self.share.profile()).map_or(f32::INFINITY, StrikeProfile::time_to_loss)
    }

    /// Estimated share of time in gear; `None` if only a lower bound exists, or with stray energy.
    pub fn in_gear(&self) -> Option<GearShare> {
        let strays = (self.share.evidence).is_some_and(|evidence| evidence.long.has_stray());
        self.fitted_share().filter(|_| !strays)
    }

    fn fitted_share(&self) -> Option<GearShare> {
        if self.share.has_fit {
            return self.share.share;
        }
        // Middle of the interval above the lower bound.
        let min_share = self.gear.share();
        let error = 0.5 * (1.0 - min_share);
        (error < MAX_BOUND_ERROR).then_some(GearShare {
            share: min_share + error,
            error,
        })
    }

    /// Whether the impacts come from one part: with several, most flights are not detected.
    fn is_one(&self) -> bool {
        let lower_bound = |estimate: GearShare| estimate.share - 2.0 * estimate.error;
        let of_all = self.share.share.map_or(1.0, lower_bound);
        self.gear.long_share() >= MIN_SINGLE_FLIGHT_RATIO * of_all
    }

    /// Estimated share of time in gear, or its lower bound.
    pub fn in_gear_at_least(&self) -> f32 {
        match self.in_gear() {
            Some(estimate) => estimate.share,
            // Energy that no profile explains gives no lower bound.
            None if self.share.has_fit && !self.is_one() => 0.0,
            None => self.gear.share(),
        }
    }

    /// Confidence that the parts are in a lock, 0..1.
    pub fn confidence(&self, lock: Option<&LockWindow>) -> f32 {
        let in_gear = self.fitted_share();
        let upper_bound = in_gear.map_or(1.0, |estimate| estimate.share + 2.0 * estimate.error);
        (lock.map_or(0.0, |lock| self.phases.lock_confidence(lock.order))).min(upper_bound)
    }
}
