//! Where an orbit of the exact map ends.

use std::f64::consts::TAU;

use kband::impact::{Event, Kernel, Map, Orbit, State};
use kband::regime::Lock;
use kband::regime::classify::{Classifier, HearingSettings, Regime};
use kband::regime::lock::HIGHEST_ORDER;

use crate::picture::Tone;
use crate::refusal::Refusal;

/// Impacts that the classifier weighs where an orbit has not repeated to the last bits.
const MEMORY: usize = 512;

/// What a regime is called in tables and legends.
#[must_use]
pub fn name(regime: Regime) -> String {
    let plural = |count: u32| if count == 1 { "" } else { "s" };
    match regime {
        Regime::Locked { order } => format!("locked, r = {order}"),
        Regime::Doubled { order, doublings } => {
            format!("doubled to {}, r = {order}", 1_u64 << doublings.min(63))
        }
        Regime::Periodic { impacts, cycles } => format!(
            "periodic, {impacts} impact{} in {cycles} cycle{}",
            plural(impacts),
            plural(cycles)
        ),
        Regime::HopAndRest { cycles } => {
            format!("hops and rests, {cycles} cycle{}", plural(cycles))
        }
        Regime::Rest => "rests for ever".into(),
        Regime::Chaotic => "chaotic".into(),
        Regime::Undecided => "undecided".into(),
    }
}

/// The tone of a regime in pictures.
#[must_use]
pub fn tone(regime: Regime) -> Tone {
    match regime {
        Regime::Locked { .. } => Tone::Locked,
        Regime::Doubled { .. } => Tone::Doubled,
        Regime::Periodic { .. } => Tone::Periodic,
        Regime::HopAndRest { .. } => Tone::HopAndRest,
        Regime::Rest => Tone::Rest,
        Regime::Chaotic => Tone::Chaotic,
        Regime::Undecided => Tone::Undecided,
    }
}

/// The tones of regimes with their names, in the order of a legend.
pub const TONES: [(Tone, &str); 7] = [
    (Tone::Locked, "locked"),
    (Tone::Doubled, "doubled"),
    (Tone::Periodic, "periodic otherwise"),
    (Tone::Chaotic, "chaotic"),
    (Tone::HopAndRest, "hops and rests"),
    (Tone::Rest, "rests for ever"),
    (Tone::Undecided, "undecided"),
];

/// Follows orbits of one map to their ending.
#[derive(Clone, Debug)]
pub struct Endings {
    map: Map,
    /// The attracting period-1 orbits, by order from 1 on.
    locks: Vec<Option<Lock>>,
    /// Where a part thrown off from rest ends: every part that rests once shares it, as nothing of its
    /// past is left.
    after_rest: Regime,
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
            after_rest: Regime::Rest,
            impacts,
        };
        if let Some(cycles) = relaunch(&map, impacts) {
            endings.after_rest = Regime::HopAndRest { cycles };
        } else if k < 1.0 {
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
    pub fn from_rest(&self) -> Regime {
        self.after_rest
    }

    /// Where a part that starts just after an impact ends.
    #[must_use]
    pub fn of(&self, start: State) -> Regime {
        self.follow(Orbit::new(&self.map, start))
    }

    fn follow(&self, orbit: Orbit<'_>) -> Regime {
        let (mut count, mut keep_next) = (0, 16);
        // Its settings are within their ranges.
        let mut memory = Classifier::<MEMORY>::build(HearingSettings::COMPUTED).ok();
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
                return Regime::Locked {
                    order: lock.order(),
                };
            }
            if let Some((impacts, time)) = kept.returned(impact.next, impact.flight) {
                return named(impacts, (time / TAU).round() as u32);
            }
            if count + MEMORY + 1 > self.impacts
                && let Some(memory) = &mut memory
            {
                memory.flight(impact.flight);
            }
            if count == keep_next {
                kept = Kept {
                    state: Some(impact.next),
                    ..Kept::default()
                };
                keep_next *= 2;
            }
        }
        memory.map_or(Regime::Undecided, |memory| memory.verdict().regime)
    }
}

/// Drive cycles from one lift-off to the next of a part that starts from rest, where it comes to rest
/// again within so many impacts.
fn relaunch(map: &Map, impacts: usize) -> Option<u32> {
    let mut time = 0.0;
    let mut count = 0;
    let mut lifted = false;
    for event in Orbit::from_rest(map) {
        match event {
            Event::Impact(impact) => {
                time += impact.flight;
                count += 1;
                if count > impacts {
                    return None;
                }
            }
            Event::Rest { chatter, .. } => time += chatter,
            Event::LiftOff { wait, .. } if lifted => {
                return Some(((time + wait) / TAU).round() as u32);
            }
            Event::LiftOff { .. } => lifted = true,
        }
    }
    None
}

/// What an orbit of so many impacts in so many cycles is.
fn named(impacts: u32, cycles: u32) -> Regime {
    if impacts.is_power_of_two() && cycles > 0 && cycles.is_multiple_of(impacts) {
        let order = cycles / impacts;
        match impacts.trailing_zeros() {
            0 => Regime::Locked { order },
            doublings => Regime::Doubled { order, doublings },
        }
    } else {
        Regime::Periodic { impacts, cycles }
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
    use std::collections::HashMap;

    use super::*;

    fn shares(k: f64, restitution: f64) -> HashMap<Tone, f64> {
        let endings = Endings::new(k, restitution, 2000).unwrap();
        let mut shares = HashMap::new();
        for row in 0..40 {
            for column in 0..40 {
                let start = State {
                    phase: TAU * (f64::from(column) + 0.5) / 40.0,
                    velocity: 3.0 * (f64::from(row) + 0.5) / 40.0,
                };
                *shares.entry(tone(endings.of(start))).or_default() += 1.0 / 1600.0;
            }
        }
        shares
    }

    #[test]
    fn shares_of_the_reference_case() {
        // Physics, section 7: 33 % lock, 64 % rest and relaunch, 3 % otherwise. Another placing of the
        // 40 x 40 starts moves the shares by the cells on the basin's edge, about 2 %.
        let shares = shares(0.43, 0.2);
        assert!((shares[&Tone::Locked] - 0.33).abs() < 0.02, "{shares:?}");
        assert!(
            (shares[&Tone::HopAndRest] - 0.64).abs() < 0.02,
            "{shares:?}"
        );
    }

    #[test]
    fn below_0_4117_rest_leads_to_the_lock() {
        let shares = shares(0.405, 0.2);
        assert!(shares[&Tone::Locked] > 0.95, "{shares:?}");
    }

    #[test]
    fn above_1_a_part_rests_for_ever_or_locks() {
        // Physics, section 11: k = 1.2, R = 0.8 locks.
        let shares = shares(1.2, 0.8);
        assert!(
            shares[&Tone::Rest] > 0.1 && shares[&Tone::Locked] > 0.05,
            "{shares:?}"
        );
        assert!(!shares.contains_key(&Tone::HopAndRest));
    }

    #[test]
    fn the_cascade_is_named() {
        // Between the flips of physics, section 6.
        for (k, regime) in [
            (0.43, Regime::Locked { order: 1 }),
            (
                0.38,
                Regime::Doubled {
                    order: 1,
                    doublings: 1,
                },
            ),
            (
                0.363,
                Regime::Doubled {
                    order: 1,
                    doublings: 2,
                },
            ),
            (
                0.3596,
                Regime::Doubled {
                    order: 1,
                    doublings: 3,
                },
            ),
            (0.35, Regime::Chaotic),
        ] {
            let start = Lock::at(k, 0.2, 1).unwrap().unwrap().state();
            let beside = State {
                phase: start.phase + 1e-3,
                ..start
            };
            assert_eq!(
                Endings::new(k, 0.2, 3000).unwrap().of(beside),
                regime,
                "{k}"
            );
        }
    }
}
