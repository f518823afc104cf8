//! Where the parts of a lot are chaotic: a search with the map on board, slice by slice.

use crate::control::settings::Settings;
use crate::feeder::OutOfRange;
use crate::impact::{Hybrid, Kernel};
use crate::regime::classify::{Classifier, HearingSettings, Regime};
use crate::regime::{Lock, band};

/// Impacts that one slice computes. At 300 instructions an impact 38 000.
const SLICE: u32 = 128;
/// Step in k, as a share of it: both ends of a stretch are then known to 0.4 %, its middle to 0.2 %, a fifth of the 1 %
/// that an amplitude may be off. With 0.05 `what_it_finds_is_chaotic_by_the_exponent_too` fails.
const STEP: f64 = 0.004;
/// Highest k that is tried, over the flip of the deadest part: the doublings accumulate at 0.87 to 0.92 of it. At
/// 0.87 `a_search_that_is_spared_ends_with_the_same_at_the_same_slice` finds none.
const HIGHEST: f64 = 0.935;
/// Lowest k that is tried, over the flip of the liveliest part: below, its hopping is transient. At 0.9
/// `what_it_finds_is_chaotic_by_the_exponent_too` fails; from 0.7 to 0.85 it passes.
const LOWEST: f64 = 0.80;
/// Impacts after which a part is judged, by the last [`HEARD`] of them. In the 536 before, an orbit that draws a part by 1 %
/// an impact has brought it from 1 rad to 0.005 rad, which the classifier takes for the orbit; what settles slower is chaos to the
/// board's own hearing too. From 264 to 1700 every test passes.
const IMPACTS: u32 = 600;
/// Impacts that the classifier remembers, as that of the board.
const HEARD: usize = 64;
/// Velocity in b w below which a part counts as coming to rest: its hops then end within `2e-3/(P (1 - R))`
/// (docs/theory-impacts.md#t4.1) wherever the pull P of the track is not as small itself. It spares the impacts up to the
/// judgement, which calls such parts no chaos as well: from 0 to 0.2 every test passes.
const RESTING: f64 = 1e-3;

/// One part at one k being listened to.
#[derive(Clone, Copy, Debug)]
struct Trial {
    map: Hybrid,
    state: <Hybrid as Kernel>::State,
    impacts: u32,
    classifier: Classifier<HEARD>,
}

impl Trial {
    fn new(k: f64, restitution: f64) -> Option<Self> {
        let lock = Lock::at(k, restitution, 1).ok()??;
        let state = lock.state();
        Some(Self {
            map: Hybrid::build(k, restitution).ok()?,
            // Off the orbit, which repels here.
            state: Hybrid::state(state.phase + 0.02, state.velocity).ok()?,
            impacts: 0,
            classifier: Classifier::build(HearingSettings::BOARD).ok()?,
        })
    }

    /// One impact; whether the part is chaotic, once it is known.
    fn step(&mut self) -> Option<bool> {
        let impact = self.map.impact(self.state);
        self.state = impact.next;
        self.impacts += 1;
        if Hybrid::observe(impact.next).velocity < RESTING {
            return Some(false);
        }
        if self.impacts + HEARD as u32 > IMPACTS {
            self.classifier.flight(impact.flight);
        }
        (self.impacts > IMPACTS).then(|| self.classifier.verdict().regime == Regime::Chaotic)
    }
}

/// A search for chaos that has come to its end: for which lot, what came, after how many slices.
///
/// Two controllers with the same lot come to the same k after as many slices, so that one that is told
/// need not search ([`Controller::chaos_known`](crate::control::Controller::chaos_known)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chaos {
    /// Lowest and highest restitution of the lot.
    pub lot: [f32; 2],
    /// k in the middle of the widest stretch, `None` where the lot has none.
    pub k: Option<f64>,
    /// Slices that it took.
    pub slices: u32,
}

/// The search for the widest stretch of k where the deadest, the middle and the liveliest part of a
/// lot hop chaotically without coming to rest, as far as the board's own classifier can tell.
#[derive(Clone, Copy, Debug)]
pub struct ChaosSearch {
    parts: [f64; 3],
    k: f64,
    lowest: f64,
    part: usize,
    trial: Option<Trial>,
    /// The stretch that is growing and the longest so far, as (high k, low k).
    growing: Option<(f64, f64)>,
    longest: Option<(f64, f64)>,
    done: bool,
    lot: [f32; 2],
    slices: u32,
    /// What came of it, or of another search for the same lot.
    known: Option<Chaos>,
}

impl ChaosSearch {
    /// The search for a lot; the refusal names the parameter.
    pub fn begin(settings: &Settings) -> Result<Self, OutOfRange> {
        let lot = settings.lot()?;
        let (low, high) = (lot.low(), lot.high());
        Ok(Self {
            // The liveliest part comes to rest first, the deadest is periodic longest.
            parts: [high, low, lot.middle()],
            k: HIGHEST * band::flip(low, 1)?,
            lowest: LOWEST * band::flip(high, 1)?,
            part: 0,
            trial: None,
            growing: None,
            longest: None,
            done: false,
            lot: [settings.restitution_low, settings.restitution_high],
            slices: 0,
            known: None,
        })
    }

    /// One slice; whether more are to be done.
    pub fn step(&mut self) -> bool {
        if self.done {
            return false;
        }
        self.slices = self.slices.saturating_add(1);
        if let Some(known) = self.known {
            self.done = self.slices >= known.slices;
            return !self.done;
        }
        for _ in 0..SLICE {
            if self.k < self.lowest {
                self.done = true;
                self.known = Some(Chaos {
                    lot: self.lot,
                    k: self.longest.map(|(high, low)| libm::sqrt(high * low)),
                    slices: self.slices,
                });
                return false;
            }
            let restitution = self.parts.get(self.part).copied();
            let trial = match &mut self.trial {
                Some(trial) => trial,
                empty => {
                    match restitution.and_then(|restitution| Trial::new(self.k, restitution)) {
                        Some(trial) => empty.insert(trial),
                        None => {
                            self.next(false);
                            continue;
                        }
                    }
                }
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

    /// Goes on to the next k; `chaotic` is whether all parts were at this one.
    fn next(&mut self, chaotic: bool) {
        let width = |stretch: Option<(f64, f64)>| stretch.map_or(0.0, |(high, low)| high / low);
        self.growing = chaotic.then(|| (self.growing.map_or(self.k, |(high, _)| high), self.k));
        if width(self.growing) > width(self.longest) {
            self.longest = self.growing;
        }
        self.part = 0;
        self.k *= 1.0 - STEP;
    }

    /// The lot that is being searched for; `None` once its chaos is known or found.
    #[cfg(any(test, feature = "unstable"))]
    #[must_use]
    pub fn asked(&self) -> Option<[f32; 2]> {
        (!self.done && self.known.is_none()).then_some(self.lot)
    }

    /// Spares the search, if it is for this lot: what came of it then comes after as many slices.
    #[cfg(any(test, feature = "unstable"))]
    pub fn know(&mut self, known: Chaos) {
        if self.asked() == Some(known.lot) {
            self.known = Some(known);
        }
    }

    /// What came of it, once it is over.
    #[must_use]
    pub fn found(&self) -> Option<&Chaos> {
        self.known.as_ref().filter(|_| self.done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::Map;
    use crate::regime::exponent::{self, Dynamics, ExponentSettings};

    fn search(low: f32, high: f32) -> (Option<f64>, u32) {
        let mut search = ChaosSearch::begin(&Settings {
            restitution_low: low,
            restitution_high: high,
            ..Settings::default()
        })
        .unwrap();
        let mut slices = 0;
        while search.step() {
            slices += 1;
            assert!(slices < 2000);
        }
        (search.found().unwrap().k, slices)
    }

    #[test]
    fn what_it_finds_is_chaotic_by_the_exponent_too() {
        for (low, high) in [(0.2, 0.2), (0.195, 0.205), (0.3, 0.3), (0.5, 0.5)] {
            let (k, _) = search(low, high);
            let k = k.unwrap();
            let middle = 0.5 * f64::from(low + high);
            let map = Map::build(k, middle).unwrap();
            let settings = ExponentSettings {
                settle: 1000,
                impacts: 4000,
            };
            let found = exponent::measure(&map, exponent::start(&map, 1), settings).unwrap();
            assert_eq!(found.dynamics, Dynamics::Chaotic, "R {middle} k {k}");
        }
    }

    #[test]
    fn a_search_that_is_spared_ends_with_the_same_at_the_same_slice() {
        let settings = Settings::default();
        let mut first = ChaosSearch::begin(&settings).unwrap();
        while first.step() {}
        let found = *first.found().unwrap();
        let mut spared = ChaosSearch::begin(&settings).unwrap();
        spared.know(Chaos {
            lot: [0.1, 0.2],
            ..found
        });
        assert_eq!(spared.asked(), Some(found.lot));
        spared.step();
        spared.know(found);
        let mut slices = 2;
        while spared.step() {
            slices += 1;
        }
        assert_eq!(slices, found.slices);
        assert_eq!(spared.found(), Some(&found));
    }

    #[test]
    fn a_wide_lot_has_no_common_chaos_and_the_search_ends() {
        let (k, slices) = search(0.15, 0.25);
        assert_eq!(k, None);
        assert!(slices < 1200, "{slices}");
    }
}
