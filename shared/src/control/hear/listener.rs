//! What the parts are heard to do: the lock, and the regime.

use super::gear::{GearHearing, HeardWith};
use super::margin::Margin;
use super::phases::PhaseStatistics;
use super::signal::Cycle;
use crate::arithmetic::Phase;
use crate::control::hear::LockWindow;
use crate::feeder::OutOfRange;
use crate::regime::classify::{Classifier, HearingSettings, Regime, Verdict};

/// Cycles from one look at the regime to the next: its search for periods is the costliest part of a cycle. From 1
/// to 32 every test and scene passes: it costs instructions alone.
const LOOK: u32 = 8;

/// The parts as they are heard.
#[derive(Clone, Debug)]
pub struct Listener {
    /// When in a cycle they strike.
    pub hearing: PhaseStatistics,
    /// How much of their time they are in gear.
    pub gear: GearHearing,
    classifier: Classifier<64>,
    /// What they were last heard to do.
    pub regime: Option<Verdict>,
    /// Whether that is judged where nothing depends on it.
    pub watched: bool,
}

impl Listener {
    /// Nothing heard yet.
    pub fn build(gear: GearHearing) -> Result<Self, OutOfRange> {
        Ok(Self {
            hearing: PhaseStatistics::default(),
            gear,
            classifier: Classifier::build(HearingSettings::EAR)?,
            regime: None,
            watched: true,
        })
    }

    /// Begins the time of the regimes anew, with the count of cycles.
    pub fn begin(&mut self) {
        if let Ok(fresh) = Classifier::build(HearingSettings::EAR) {
            self.classifier = fresh;
        }
    }

    /// Forgets what the parts were heard to do.
    pub fn forget(&mut self) {
        self.hearing.reset();
        self.gear.reset();
        self.classifier.forget();
        self.regime = None;
    }

    /// Takes what was heard in a cycle; `wanted` is whether the regime decides something.
    pub fn cycle(
        &mut self,
        cycle: &Cycle,
        with: &HeardWith,
        lock: Option<&LockWindow>,
        wanted: bool,
    ) {
        let HeardWith { count, lead, .. } = *with;
        self.gear.cycle(cycle, with);
        let lock = lock.map(|lock| (lock.phase, lock.width));
        self.hearing.cycle(cycle, lead, lock);
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
            Regime::Locked { order } if !self.gear.may_lock_at(self.hearing.phase()) => Verdict {
                regime: Regime::HopAndRest { cycles: order },
                ..verdict
            },
            _ => verdict,
        }
    }

    /// How far the parts are from losing gear; `None` before enough was heard.
    pub fn margin(&self) -> Option<Margin> {
        self.gear.margin()
    }

    /// Confidence that the parts are in a lock, 0..1.
    pub fn confidence(&self, lock: Option<&LockWindow>) -> f32 {
        lock.map_or(0.0, |lock| self.hearing.lock_confidence(lock.order))
    }
}
