//! What the parts are heard to do: the lock, and the regime.

use super::gear::GearHearing;
use super::margin::Margin;
use super::phases::PhaseStatistics;
use super::signal::Cycle;
use crate::arithmetic::Phase;
use crate::control::hear::LockWindow;
use crate::feeder::OutOfRange;
use crate::regime::classify::{Classifier, HearingSettings, Verdict};

/// Cycles from one look at the regime to the next: its search for periods is the costliest part of a cycle.
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
    pub fn build() -> Result<Self, OutOfRange> {
        Ok(Self {
            hearing: PhaseStatistics::default(),
            gear: GearHearing::default(),
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

    /// Takes what was heard in cycle number `count`; `wanted` is whether the regime decides something.
    pub fn cycle(
        &mut self,
        cycle: &Cycle,
        count: u32,
        lead: Phase,
        lock: Option<&LockWindow>,
        wanted: bool,
    ) {
        let order = lock.map_or(1, |lock| lock.order);
        self.gear.cycle(cycle, count, lead, order);
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
            self.regime = Some(self.classifier.verdict());
        }
    }

    /// How far the parts are from losing gear; `None` before enough was heard.
    pub fn margin(&self) -> Option<Margin> {
        None
    }

    /// Confidence that the parts are in a lock, 0..1.
    pub fn confidence(&self, lock: Option<&LockWindow>) -> f32 {
        lock.map_or(0.0, |lock| self.hearing.lock_confidence(lock.order))
    }
}
