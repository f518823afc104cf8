//! The last impacts of an orbit that never returned to an earlier state.

use std::f64::consts::TAU;

use kband::regime::classify::{Classifier, Regime, TimingAccuracy};

pub(super) const JUDGED_IMPACTS: usize = 512;
/// A drive cycle in steps of time, 2^-32 cycles.
const CYCLE: f64 = 4_294_967_296.0;
/// Largest deviation of two impacts from whole cycles that counts as a repetition, in 2^-32 cycles:
/// 1.5e-6 rad, wider than the classifier's tolerance.
const RETURN_TOLERANCE: u32 = 1024;
/// The same on the approach to a cycle of one impact: 2e-4 rad. Cycles of more impacts are followed
/// for fewer periods, and found from a smaller distance.
const APPROACH_TOLERANCE: u32 = 1 << 17;

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

    /// Verdict of the classifier; in most cases it is chaos, which needs no classifier.
    pub(super) fn verdict(&self) -> Regime {
        if self.flights.len() >= JUDGED_IMPACTS && !self.may_repeat() {
            return Regime::Chaotic;
        }
        // Its settings are within their ranges.
        let Ok(mut classifier) = Classifier::<JUDGED_IMPACTS>::build(TimingAccuracy::COMPUTED)
        else {
            return Regime::Undecided;
        };
        for flight in &self.flights {
            classifier.flight(*flight);
        }
        match classifier.verdict().regime {
            Regime::Doubled { order, doublings } => self.least_doubled(order, doublings),
            other => other,
        }
    }

    /// The orbit with the fewest doublings that the impacts approach, while they alternate about
    /// it.
    fn least_doubled(&self, order: u32, doublings: u32) -> Regime {
        let times = self.times();
        let approaches = |fewer: u32| {
            let impacts = 1 << fewer;
            2 * repeats(&times, impacts, APPROACH_TOLERANCE >> fewer) >= times.len() - impacts
        };
        match (0..doublings).find(|fewer| approaches(*fewer)) {
            Some(0) => Regime::Locked { order },
            Some(fewer) => Regime::Doubled {
                order,
                doublings: fewer,
            },
            None => Regime::Doubled { order, doublings },
        }
    }

    /// Whether half of the impacts repeat after some number of impacts; with fewer the verdict is
    /// chaos. Times within a cycle suffice; a CPU compares four at once.
    fn may_repeat(&self) -> bool {
        let times = self.times();
        (1..=times.len() / 3)
            .any(|impacts| 2 * repeats(&times, impacts, RETURN_TOLERANCE) >= times.len() - impacts)
    }

    /// Times of the last impacts within their cycles.
    fn times(&self) -> Vec<u32> {
        let mut now = 0_u64;
        let times = self.flights.iter().map(|flight| {
            now = now.wrapping_add((flight * (CYCLE / TAU)).round() as u64);
            now as u32
        });
        let times: Vec<u32> = times.collect();
        times[times.len().saturating_sub(JUDGED_IMPACTS)..].to_vec()
    }
}

/// Number of impacts that repeat within `tolerance` after some number of impacts.
fn repeats(times: &[u32], impacts: usize, tolerance: u32) -> usize {
    let pairs = times[impacts..].iter().zip(times);
    let repeats = pairs.map(|(later, earlier)| {
        u32::from(later.wrapping_sub(*earlier).wrapping_add(tolerance) <= 2 * tolerance)
    });
    repeats.sum::<u32>() as usize
}

#[cfg(test)]
mod tests {
    use kband::impact::{Kernel, Map, Orbit, OrbitEvent};
    use kband::regime::exponent;

    use super::*;

    #[test]
    fn the_shortcut_agrees_with_the_classifier() {
        let mut chaotic = 0;
        for n in 0..60 {
            // From the locked orbit through its doublings to chaos.
            let k = 0.33 + 0.0015 * f64::from(n);
            let map = Map::build(k, 0.2).unwrap();
            let mut memory = Memory::default();
            let mut classifier =
                Classifier::<JUDGED_IMPACTS>::build(TimingAccuracy::COMPUTED).unwrap();
            for event in Orbit::new(&map, exponent::start_near_lock(&map, 1))
                .take(1500)
                .skip(900)
            {
                if let OrbitEvent::Impact(impact) = event {
                    memory.take(impact.flight);
                    classifier.flight(impact.flight);
                }
            }
            let expected = classifier.verdict().regime;
            assert_eq!(memory.verdict(), expected, "{k}");
            chaotic += u32::from(expected == Regime::Chaotic && !memory.may_repeat());
        }
        assert!(chaotic > 10, "{chaotic}");
    }

    #[test]
    fn half_of_the_impacts_repeated_may_be_a_pattern() {
        // Alternately an arbitrary time and a whole cycle: each second impact repeats the last.
        let mut memory = Memory::default();
        for n in 0..JUDGED_IMPACTS {
            let any = 0.3 + 0.7 * (n as f64 * 0.618_034).fract();
            memory.take(TAU * if n % 2 == 0 { any } else { 1.0 });
        }
        assert!(memory.may_repeat());
        memory.flights.iter_mut().for_each(|flight| *flight *= 1.01);
        assert!(!memory.may_repeat());
    }
}
