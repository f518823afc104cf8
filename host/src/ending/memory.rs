//! The last impacts of an orbit that never returned to an earlier state.

use std::f64::consts::TAU;

use kband::regime::classify::{Classifier, HearingSettings, Regime};

/// Number of judged impacts.
pub(super) const MEMORY: usize = 512;

/// A drive cycle in steps of time, 2^-32 cycles.
const CYCLE: f64 = 4_294_967_296.0;

/// Distance of two impacts from whole cycles, in 2^-32 cycles, up to which they count as repeated.
/// It is 1.5e-6 rad, wider than the classifier's tolerance, so the classifier finds no more
/// repeats.
const NEAR: u32 = 1024;

/// The same for a slow approach to a cycle: 1/1024 cycle, 6e-3 rad.
const SLOWLY: u32 = 1 << 22;

/// The last flights of an orbit.
#[derive(Clone, Debug, Default)]
pub(super) struct Memory {
    /// Flight times in rad of drive phase.
    flights: Vec<f64>,
}

impl Memory {
    pub(super) fn take(&mut self, flight: f64) {
        self.flights.push(flight);
    }

    /// Verdict of the classifier on these flights; most are chaos, which needs no classifier.
    pub(super) fn verdict(&self) -> Regime {
        if self.flights.len() >= MEMORY && !self.may_repeat() {
            return Regime::Chaotic;
        }
        // Its settings are within their ranges.
        let Ok(mut classifier) = Classifier::<MEMORY>::build(HearingSettings::COMPUTED) else {
            return Regime::Undecided;
        };
        for flight in &self.flights {
            classifier.flight(*flight);
        }
        classifier.verdict().regime
    }

    /// Whether half of the impacts repeat after some number of impacts.
    ///
    /// With fewer the classifier's verdict is chaos. Times within a cycle suffice, which a CPU
    /// compares four at once.
    fn may_repeat(&self) -> bool {
        self.repeats(NEAR, |near, of| 2 * near >= of)
    }

    /// Whether every impact nearly repeats after some number of impacts, as on a slow approach to a
    /// cycle.
    pub(super) fn settles(&self) -> bool {
        self.repeats(SLOWLY, |near, of| near == of)
    }

    /// Whether, after some number of impacts, `enough` of them repeat within `apart`.
    ///
    /// `enough` takes the number of repeats and the number of compared impacts.
    fn repeats(&self, apart: u32, enough: impl Fn(usize, usize) -> bool) -> bool {
        let mut now = 0_u64;
        let times = self.flights.iter().map(|flight| {
            now = now.wrapping_add((flight * (CYCLE / TAU)).round() as u64);
            now as u32
        });
        let times: Vec<u32> = times.collect();
        let times = &times[times.len().saturating_sub(MEMORY)..];
        (1..=times.len() / 3).any(|impacts| {
            let later = &times[impacts..];
            let pairs = later.iter().zip(times);
            let near = pairs.map(|(later, earlier)| {
                u32::from(later.wrapping_sub(*earlier).wrapping_add(apart) <= 2 * apart)
            });
            enough(near.sum::<u32>() as usize, later.len())
        })
    }
}

#[cfg(test)]
mod tests {
    use kband::impact::{Kernel, Map, Orbit, OrbitEvent};
    use kband::regime::exponent;

    use super::*;

    #[test]
    fn what_is_told_without_the_classifier_is_what_it_says() {
        let mut chaotic = 0;
        for n in 0..60 {
            // From the locked orbit through its doublings into chaos.
            let k = 0.33 + 0.0015 * f64::from(n);
            let map = Map::build(k, 0.2).unwrap();
            let mut memory = Memory::default();
            let mut classifier = Classifier::<MEMORY>::build(HearingSettings::COMPUTED).unwrap();
            for event in Orbit::new(&map, exponent::start(&map, 1))
                .take(1500)
                .skip(900)
            {
                if let OrbitEvent::Impact(impact) = event {
                    memory.take(impact.flight);
                    classifier.flight(impact.flight);
                }
            }
            let said = classifier.verdict().regime;
            assert_eq!(memory.verdict(), said, "{k}");
            chaotic += u32::from(said == Regime::Chaotic && !memory.may_repeat());
        }
        assert!(chaotic > 10, "{chaotic}");
    }

    #[test]
    fn half_of_the_impacts_repeated_may_be_a_pattern() {
        // Alternately an arbitrary time and a whole cycle: each second impact repeats the one
        // before it.
        let mut memory = Memory::default();
        for n in 0..MEMORY {
            let any = 0.3 + 0.7 * (n as f64 * 0.618_034).fract();
            memory.take(TAU * if n % 2 == 0 { any } else { 1.0 });
        }
        assert!(memory.may_repeat());
        memory.flights.iter_mut().for_each(|flight| *flight *= 1.01);
        assert!(!memory.may_repeat());
    }
}
