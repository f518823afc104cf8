//! Where an orbit of the exact map ends.

use std::f64::consts::TAU;

use kband::impact::{Event, Kernel, Map, Orbit, State};
use kband::regime::Lock;
use kband::regime::lock::HIGHEST_ORDER;

use crate::picture::Tone;
use crate::refusal::Refusal;

/// Where an orbit ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Ending {
    /// One impact every so many drive cycles.
    Locked(u32),
    /// The lock of an order after flips: 2, 4, 8... impacts, every `order` cycles on average.
    Doubled {
        /// Drive cycles per impact on average (symbol r).
        order: u32,
        /// Impacts until it repeats.
        impacts: u32,
    },
    /// Another orbit that repeats.
    Periodic {
        /// Impacts until it repeats.
        impacts: u32,
        /// Drive cycles until it repeats.
        cycles: u32,
    },
    /// It comes to rest and is thrown off again, for ever.
    HopAndRest,
    /// It rests for ever.
    Rest,
    /// Neither rest nor repetition within the impacts that were followed.
    Undecided,
}

impl Ending {
    /// What it is called.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Locked(order) => format!("locked, r = {order}"),
            Self::Doubled { order, impacts } => format!("doubled to {impacts}, r = {order}"),
            Self::Periodic { impacts, cycles } => {
                let plural = if cycles == 1 { "" } else { "s" };
                format!("periodic, {impacts} impacts in {cycles} cycle{plural}")
            }
            Self::HopAndRest => "hops, rests, is thrown again".into(),
            Self::Rest => "rests for ever".into(),
            Self::Undecided => "chaotic or undecided".into(),
        }
    }

    /// Its tone in pictures.
    #[must_use]
    pub fn tone(self) -> Tone {
        match self {
            Self::Locked(_) => Tone::Locked,
            Self::Doubled { .. } => Tone::Doubled,
            Self::Periodic { .. } => Tone::Periodic,
            Self::HopAndRest => Tone::HopAndRest,
            Self::Rest => Tone::Rest,
            Self::Undecided => Tone::Chaotic,
        }
    }
}

/// Follows orbits of one map to their ending.
#[derive(Clone, Debug)]
pub struct Endings {
    map: Map,
    /// The attracting period-1 orbits, by order from 1 on.
    locks: Vec<Option<Lock>>,
    /// Where a part thrown off from rest ends: every part that rests once shares it, as nothing of its
    /// past is left.
    after_rest: Ending,
    impacts: usize,
}

impl Endings {
    /// The endings at k and a restitution below 1; an orbit is given up after `impacts`.
    pub fn new(k: f64, restitution: f64, impacts: usize) -> Result<Self, Refusal> {
        let map = Map::build(k, restitution)?;
        let mut locks = Vec::new();
        for order in 1..=HIGHEST_ORDER {
            let Some(lock) = Lock::at(k, restitution, order)? else {
                break;
            };
            locks.push(Some(lock).filter(|lock| lock.attracts() && lock.is_first_return()));
        }
        let mut endings = Self {
            map,
            locks,
            after_rest: if k < 1.0 {
                Ending::HopAndRest
            } else {
                Ending::Rest
            },
            impacts,
        };
        if k < 1.0 {
            endings.after_rest = endings.follow(Orbit::from_rest(&map));
        }
        Ok(endings)
    }

    /// The attracting period-1 orbits.
    pub fn locks(&self) -> impl Iterator<Item = &Lock> {
        self.locks.iter().flatten()
    }

    /// Where a part that starts from rest ends.
    #[must_use]
    pub fn from_rest(&self) -> Ending {
        self.after_rest
    }

    /// Where a part that starts just after an impact ends.
    #[must_use]
    pub fn of(&self, start: State) -> Ending {
        self.follow(Orbit::new(&self.map, start))
    }

    fn follow(&self, orbit: Orbit<'_>) -> Ending {
        let (mut count, mut keep_next) = (0, 16);
        let mut kept = Kept::default();
        for event in orbit {
            let impact = match event {
                Event::Impact(impact) => impact,
                Event::Rest { .. } => return self.after_rest,
                Event::LiftOff { .. } => continue,
            };
            count += 1;
            if count > self.impacts {
                break;
            }
            let order = (impact.flight / TAU).round() as usize;
            if let Some(Some(lock)) = order.checked_sub(1).and_then(|n| self.locks.get(n))
                && lock.distance(impact.next) < 1e-5
            {
                return Ending::Locked(lock.order());
            }
            if let Some((impacts, time)) = kept.returned(impact.next, impact.flight) {
                return named(impacts, (time / TAU).round() as u32);
            }
            if count == keep_next {
                kept = Kept {
                    state: Some(impact.next),
                    ..Kept::default()
                };
                keep_next *= 2;
            }
        }
        Ending::Undecided
    }
}

/// What an orbit of so many impacts in so many cycles is called.
fn named(impacts: u32, cycles: u32) -> Ending {
    if impacts.is_power_of_two() && cycles > 0 && cycles.is_multiple_of(impacts) {
        let order = cycles / impacts;
        match impacts {
            1 => Ending::Locked(order),
            _ => Ending::Doubled { order, impacts },
        }
    } else {
        Ending::Periodic { impacts, cycles }
    }
}

/// A state kept to see whether the orbit comes back to it; it is replaced at powers of two of the count
/// of impacts, so that it leaves the transient behind (Brent).
#[derive(Clone, Copy, Debug, Default)]
struct Kept {
    state: Option<State>,
    impacts: u32,
    time: f64,
    /// Impacts and time of the first return.
    first: Option<(u32, f64)>,
}

impl Kept {
    /// Impacts and time of one period, once `state` came back twice to the last bits after the same
    /// number of impacts; once can happen by chance in chaos.
    fn returned(&mut self, state: State, flight: f64) -> Option<(u32, f64)> {
        let kept = self.state?;
        self.impacts += 1;
        self.time += flight;
        if !near(kept, state) {
            return None;
        }
        match self.first {
            Some((impacts, time)) if self.impacts == 2 * impacts => Some((impacts, time)),
            Some(_) => None,
            None => {
                self.first = Some((self.impacts, self.time));
                None
            }
        }
    }
}

fn near(a: State, b: State) -> bool {
    let apart = (a.phase - b.phase).abs();
    apart.min(TAU - apart).max((a.velocity - b.velocity).abs()) < 1e-9
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    fn shares(k: f64, restitution: f64) -> BTreeMap<Ending, f64> {
        let endings = Endings::new(k, restitution, 2000).unwrap();
        let mut shares = BTreeMap::new();
        for row in 0..40 {
            for column in 0..40 {
                let start = State {
                    phase: TAU * (f64::from(column) + 0.5) / 40.0,
                    velocity: 3.0 * (f64::from(row) + 0.5) / 40.0,
                };
                *shares.entry(endings.of(start)).or_default() += 1.0 / 1600.0;
            }
        }
        shares
    }

    #[test]
    fn shares_of_the_reference_case() {
        // Physics, section 7: 33 % lock, 64 % rest and relaunch, 3 % otherwise. Another placing of the
        // 40 x 40 starts moves the shares by the cells on the basin's edge, about 2 %.
        let shares = shares(0.43, 0.2);
        assert!(
            (shares[&Ending::Locked(1)] - 0.33).abs() < 0.02,
            "{shares:?}"
        );
        assert!(
            (shares[&Ending::HopAndRest] - 0.64).abs() < 0.02,
            "{shares:?}"
        );
    }

    #[test]
    fn below_0_4117_rest_leads_to_the_lock() {
        let shares = shares(0.405, 0.2);
        assert!(shares[&Ending::Locked(1)] > 0.95, "{shares:?}");
    }

    #[test]
    fn above_1_a_part_rests_for_ever_or_locks() {
        // Physics, section 11: k = 1.2, R = 0.8 locks.
        let shares = shares(1.2, 0.8);
        assert!(
            shares[&Ending::Rest] > 0.1 && shares[&Ending::Locked(1)] > 0.05,
            "{shares:?}"
        );
        assert!(!shares.contains_key(&Ending::HopAndRest));
    }

    #[test]
    fn the_cascade_is_named() {
        // Between the flips of physics, section 6.
        for (k, ending) in [
            (0.43, Ending::Locked(1)),
            (
                0.38,
                Ending::Doubled {
                    order: 1,
                    impacts: 2,
                },
            ),
            (
                0.363,
                Ending::Doubled {
                    order: 1,
                    impacts: 4,
                },
            ),
            (
                0.3596,
                Ending::Doubled {
                    order: 1,
                    impacts: 8,
                },
            ),
            (0.35, Ending::Undecided),
        ] {
            let start = Lock::at(k, 0.2, 1).unwrap().unwrap().state();
            let beside = State {
                phase: start.phase + 1e-3,
                ..start
            };
            assert_eq!(
                Endings::new(k, 0.2, 3000).unwrap().of(beside),
                ending,
                "{k}"
            );
        }
    }
}
