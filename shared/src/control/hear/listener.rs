//! What the parts are heard to do: the lock, and the regime.

use super::gear::{GearHearing, HeardWith};
use super::margin::GearMargin;
use super::phases::PhaseStatistics;
use super::share::{GearShare, ShareHearing, Tuned};
use super::signal::Cycle;
use crate::arithmetic::Phase;
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
        self.geared = false;
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
        self.geared = match self.in_gear() {
            Some(heard) if self.geared => heard.share > LOST,
            Some(heard) => heard.share - heard.error > GEARED,
            None => self.in_gear_at_least() > if self.geared { LOST } else { GEARED },
        };
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
