//! What the parts are heard to do: the lock, and the regime.

use super::gear::{GearHearing, HeardWith};
use super::margin::GearMargin;
use super::phases::PhaseStatistics;
use super::share::{GearShare, ShareHearing, Tuned};
use super::signal::Cycle;
use crate::arithmetic::Phase;
use crate::control::angle::SAMPLE_RATE;
use crate::control::hear::LockWindow;
use crate::feeder::OutOfRange;
use crate::regime::classify::{Classifier, HearingSettings, Regime, Verdict};
use crate::regime::gear::StrikeProfile;

/// Cycles from one look at the regime to the next: its search for periods is the costliest part of a cycle. From 1
/// to 32 every test and scene passes: it costs instructions alone.
const LOOK: u32 = 8;

/// Error of a share of which no more than the least is known, below which it is told.
const NEARLY: f32 = 0.1;
/// Share of one part's flights over that of all that strike, below which there is more than one part.
const ONE: f32 = 0.5;
/// Share of time in gear above which the parts are heard to be in it, and below which no more.
const GEARED: f32 = 0.5;
const LOST: f32 = 0.4;

/// Drive cycles without contradiction, and at least a second, before gear is detected again: energy of before the loss is still in
/// the long histogram.
const MIN_SUPPORTED: f32 = 64.0;
/// Time in s, and flights of the gear, without an impact after which the track is empty.
const EMPTY_SECONDS: f32 = 1.0;
const EMPTY_FLIGHTS: f32 = 4.0;

/// The parts as they are heard.
#[derive(Clone, Debug)]
pub struct Listener {
    /// When in a cycle they strike.
    pub phases: PhaseStatistics,
    /// How much of their time they are in gear.
    pub gear: GearHearing,
    /// The same of many at once.
    pub share: ShareHearing,
    classifier: Classifier<64>,
    /// What they were last heard to do.
    pub regime: Option<Verdict>,
    /// Whether parts are heard to be in gear for more than half of their time.
    pub geared: bool,
    /// Drive cycles without an impact.
    silent: f32,
    /// Whether the track is empty: no impact for a second.
    pub empty: bool,
    /// Drive cycles since the energy last contradicted gear.
    supported: f32,
    /// Frequency of the drive in Hz.
    frequency: f32,
    /// Whether that is judged where nothing depends on it.
    pub watched: bool,
}

impl Listener {
    /// Nothing heard yet.
    pub fn build(gear: GearHearing) -> Result<Self, OutOfRange> {
        Ok(Self {
            phases: PhaseStatistics::default(),
            gear,
            share: ShareHearing::new(),
            classifier: Classifier::build(HearingSettings::BOARD)?,
            regime: None,
            geared: false,
            silent: 0.0,
            empty: false,
            supported: f32::INFINITY,
            frequency: 0.0,
            watched: true,
        })
    }

    /// Begins the time of the regimes anew, with the count of cycles.
    pub fn begin(&mut self) {
        if let Ok(fresh) = Classifier::build(HearingSettings::BOARD) {
            self.classifier = fresh;
        }
    }

    /// Forgets what the parts were heard to do.
    pub fn forget(&mut self) {
        self.phases.reset();
        self.gear.reset();
        self.share.reset();
        self.classifier.forget();
        self.regime = None;
        (self.geared, self.supported, self.silent) = (false, f32::INFINITY, 0.0);
    }

    /// Takes what was heard in a cycle; `wanted` is whether the regime decides something.
    pub fn cycle(
        &mut self,
        cycle: &Cycle,
        with: &HeardWith,
        lock: Option<&LockWindow>,
        tuned: &Tuned,
        wanted: bool,
    ) {
        let HeardWith { count, lead, .. } = *with;
        self.gear.cycle(cycle, with);
        self.share.cycle(cycle, tuned);
        self.frequency = tuned.step as f32 * SAMPLE_RATE as f32 * (1.0 / Phase::TURN as f32);
        self.watch_silence(cycle, tuned);
        let evidence = self.share.evidence();
        let contradicted = evidence.is_some_and(|evidence| !evidence.supports(LOST));
        self.supported = if contradicted {
            0.0
        } else {
            self.supported + 1.0
        };
        self.geared = self.detect_gear();
        self.phases.cycle(cycle, count, lead, lock);
        for heard in &cycle.heard {
            let time = (u64::from(count) << 32 | u64::from(heard.phase.bits()))
                .wrapping_add_signed(i64::from(lead.bits() as i32));
            self.classifier
                .impact((time >> 32) as u32, Phase::from_bits(time as u32));
        }
        self.classifier.cycle(count);
        if count.is_multiple_of(LOOK) && (self.watched || wanted) {
            self.regime = Some(self.judged(self.classifier.verdict()));
        }
    }

    /// Forgets the parts once the track is empty: without an impact for a second, and for four flights of the gear.
    fn watch_silence(&mut self, cycle: &Cycle, tuned: &Tuned) {
        if !cycle.heard.is_empty() {
            (self.silent, self.empty) = (0.0, false);
            return;
        }
        self.silent += 1.0;
        let patience = (EMPTY_SECONDS * self.frequency).max(EMPTY_FLIGHTS * f32::from(tuned.order));
        self.empty = self.silent > patience;
        if self.empty {
            self.gear.reset();
            self.share.reset();
        }
    }

    /// Whether parts are in gear for more than half of their time, with hysteresis. It is detected only from a fit to the map that
    /// supports it; impacts alone may be those of a part that lands and rests.
    fn detect_gear(&self) -> bool {
        let level = if self.geared { LOST } else { GEARED };
        let Some(evidence) = self.share.evidence() else {
            return self.geared && self.in_gear_at_least() > LOST;
        };
        (self.geared || self.supported > MIN_SUPPORTED.max(self.frequency))
            && evidence.supports(level)
            && match self.in_gear() {
                Some(heard) if self.geared => heard.share > LOST,
                Some(heard) => heard.share - heard.error > GEARED,
                None => self.in_gear_at_least() > level,
            }
    }

    /// A verdict, but for parts that strike as regularly as a lock where none strikes: they hop, chatter unheard and rest.
    fn judged(&self, verdict: Verdict) -> Verdict {
        match verdict.regime {
            Regime::Locked { order } if !self.gear.may_lock_at(self.phases.phase()) => Verdict {
                regime: Regime::HopAndRest { cycles: order },
                ..verdict
            },
            _ => verdict,
        }
    }

    /// How far one part is from losing gear; `None` before enough was heard, and where many are.
    pub fn margin(&self) -> Option<GearMargin> {
        let mut margin = self.gear.margin()?;
        if self.share.share().is_some() && !self.is_one() {
            return None;
        }
        if self.gear.time_to_loss().is_infinite()
            && let Some(profile) = self.share.profile()
        {
            margin.to_loss = margin.to_loss.max(profile.time_to_loss());
        }
        Some(margin)
    }

    /// How far the parts are from losing gear: one part as it is heard, several as a mean over the lot.
    pub fn margin_of_all(&self) -> Option<GearMargin> {
        self.margin().or_else(|| self.share.margin())
    }

    /// Mean drive cycles in gear until it is lost: as heard of one part, else as the map has it of the lot; infinite where
    /// neither knows.
    pub fn time_to_loss(&self) -> f32 {
        let heard = self.gear.time_to_loss();
        if heard.is_finite() && self.margin().is_some() {
            return heard;
        }
        self.share
            .profile()
            .map_or(f32::INFINITY, StrikeProfile::time_to_loss)
    }

    /// The share of the parts' time in gear; `None` where no more than a least is known ([`GearHearing::share`]).
    pub fn in_gear(&self) -> Option<GearShare> {
        if self.share.is_judged() {
            return self.share.share();
        }
        let least = GearShare::at_least(self.gear.share());
        (least.error < NEARLY).then_some(least)
    }

    /// Whether what is heard is one part in gear: of more than one, most flights are not heard as such.
    fn is_one(&self) -> bool {
        let flights = self.gear.long_share();
        match self.share.share() {
            Some(together) => flights >= ONE * (together.share - 2.0 * together.error),
            None => flights >= ONE,
        }
    }

    /// That share, or what it is at least.
    pub fn in_gear_at_least(&self) -> f32 {
        match self.in_gear() {
            Some(heard) => heard.share,
            // What is of no lot may be anything.
            None if self.share.is_judged() && !self.is_one() => 0.0,
            None => self.gear.share(),
        }
    }

    /// Confidence that the parts are in a lock, 0..1.
    pub fn confidence(&self, lock: Option<&LockWindow>) -> f32 {
        let most = match self.in_gear() {
            Some(heard) => heard.share + 2.0 * heard.error,
            None => 1.0,
        };
        lock.map_or(0.0, |lock| self.phases.lock_confidence(lock.order))
            .min(most)
    }
}
