//! The search for k at which a lot is chaotic (docs/theory-bands.md#t6.3), in slices, by the map.
//!
//! A scan of k from high to low on a geometric grid, by the board's own regime classifier.

use crate::settings::Settings;
use kband::feeder::OutOfRange;
use kband::impact::{Kernel, Single, SingleState};
use kband::regime::classify::{Classifier, Regime, TimingAccuracy};
use kband::regime::{Lock, band};

/// Impacts that one slice computes: 24 000 instructions at 190 an impact.
const SLICE_IMPACTS: u32 = 128;
/// Relative step of the scan in k: the middle of an interval errs by 0.2 %.
const SCAN_STEP: f64 = 0.004;
/// Highest k of the scan over the flip at the lot's lowest restitution.
const MAX_K_OVER_FLIP: f64 = 0.935;
/// Lowest k of the scan over the flip at the lot's highest restitution.
const MIN_K_OVER_FLIP: f64 = 0.80;
/// Impacts after which a part is classified, by the last [`CLASSIFIED_IMPACTS`].
const TRIAL_IMPACTS: u32 = 600;
/// Impacts in the classifier's memory, as on the board.
const CLASSIFIED_IMPACTS: usize = 64;
/// Velocity in b w below which a part comes to rest (docs/theory-impacts.md#t4.1).
const MIN_VELOCITY: f32 = 1e-3;

#[derive(Clone, Copy, Debug)]
struct Trial {
    map: Single,
    state: SingleState,
    impacts: u32,
    classifier: Classifier<CLASSIFIED_IMPACTS>,
}

impl Trial {
    fn new(k: f64, restitution: f64) -> Option<Self> {
        let lock = Lock::build(k, restitution, 1).ok()??;
        let state = lock.state();
        Some(Self {
            map: Single::build(k, restitution).ok()?,
            // Beside the orbit, which is unstable here.
            state: Single::state(state.phase + 0.02, state.velocity).ok()?,
            impacts: 0,
            classifier: Classifier::build(TimingAccuracy::BOARD).ok()?,
        })
    }

    /// Computes one impact. Whether the part is chaotic, once it is classified.
    fn step(&mut self) -> Option<bool> {
        let impact = self.map.land(self.state);
        self.state = impact.next;
        self.impacts += 1;
        // The hops end; this saves the impacts of a classification.
        if impact.next.velocity < MIN_VELOCITY {
            return Some(false);
        }
        if self.impacts + CLASSIFIED_IMPACTS as u32 > TRIAL_IMPACTS {
            self.classifier.flight(impact.flight());
        }
        (self.impacts > TRIAL_IMPACTS).then(|| self.classifier.verdict().regime == Regime::Chaotic)
    }
}

/// Search for the widest chaotic interval of k without rest, for the lot's ends and its middle.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChaosSearch {
    parts: [f64; 3],
    k: f64,
    lowest_k: f64,
    part: usize,
    trial: Option<Trial>,
    /// The present interval and the longest so far, as (high k, low k).
    growing: Option<(f64, f64)>,
    longest: Option<(f64, f64)>,
    done: bool,
}

impl ChaosSearch {
    pub fn begin(settings: &Settings) -> Result<Self, OutOfRange> {
        let lot = settings.lot()?;
        let (low, high) = (lot.low(), lot.high());
        Ok(Self {
            // The part of highest restitution comes to rest first.
            parts: [high, low, lot.middle()],
            k: MAX_K_OVER_FLIP * band::flip(low, 1)?,
            lowest_k: MIN_K_OVER_FLIP * band::flip(high, 1)?,
            ..Self::default()
        })
    }

    pub fn step(&mut self) -> bool {
        if self.done {
            return false;
        }
        for _ in 0..SLICE_IMPACTS {
            if self.k < self.lowest_k {
                self.done = true;
                return false;
            }
            if self.trial.is_none() {
                let restitution = self.parts.get(self.part).copied();
                self.trial = restitution.and_then(|restitution| Trial::new(self.k, restitution));
            }
            let Some(trial) = &mut self.trial else {
                self.next(false);
                continue;
            };
            if let Some(chaotic) = trial.step() {
                self.trial = None;
                if chaotic && self.part + 1 < self.parts.len() {
                    self.part += 1;
                } else {
                    self.next(chaotic);
                }
            }
        }
        true
    }

    /// Moves on to the next k. `chaotic`: all parts were chaotic at this one.
    fn next(&mut self, chaotic: bool) {
        let width = |interval: Option<(f64, f64)>| interval.map_or(0.0, |(high, low)| high / low);
        self.growing = chaotic.then(|| (self.growing.map_or(self.k, |(high, _)| high), self.k));
        if width(self.growing) > width(self.longest) {
            self.longest = self.growing;
        }
        self.part = 0;
        self.k *= 1.0 - SCAN_STEP;
    }

    /// The result, once the search is over: lowest and highest k of the widest interval.
    pub fn result(&self) -> Option<Option<[f64; 2]>> {
        let interval = self.longest.map(|(high, low)| [low, high]);
        self.done.then_some(interval)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::lot;
    use kband::impact::Map;
    use kband::regime::exponent::{self, Dynamics, ExponentSettings};

    #[test]
    fn found_k_has_a_positive_exponent() {
        for (low, high) in [(0.2, 0.2), (0.195, 0.205), (0.3, 0.3), (0.5, 0.5)] {
            let mut search = ChaosSearch::begin(&lot(low, high)).unwrap();
            while search.step() {}
            let [lowest, highest] = search.result().unwrap().unwrap();
            let k = libm::sqrt(lowest * highest);
            let middle = 0.5 * f64::from(low + high);
            let map = Map::build(k, middle).unwrap();
            let settings = ExponentSettings {
                settle: 1000,
                impacts: 4000,
            };
            let start = exponent::start_near_lock(&map, 1);
            let found = exponent::measure(&map, start, settings).unwrap();
            assert_eq!(found.dynamics, Dynamics::Chaotic, "R {middle} k {k}");
        }
    }
}
