//! Where an orbit of the exact map ends.

mod followed;
mod memory;

use std::f64::consts::TAU;

use kband::impact::batch::{Block, LANES};
use kband::impact::{Event, Kernel, Map, Orbit, State};
use kband::regime::HIGHEST_ORDER;
use kband::regime::Lock;
use kband::regime::classify::Regime;

use followed::Followed;

use crate::picture::Fill;
use crate::refusal::Refusal;

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

/// The fill of a regime in pictures.
#[must_use]
pub fn fill(regime: Regime) -> Fill {
    match regime {
        Regime::Locked { .. } => Fill::Locked,
        Regime::Doubled { .. } => Fill::Doubled,
        Regime::Periodic { .. } => Fill::Periodic,
        Regime::HopAndRest { .. } => Fill::HopAndRest,
        Regime::Rest => Fill::Rest,
        Regime::Chaotic => Fill::Chaotic,
        Regime::Undecided => Fill::Undecided,
    }
}

/// The fills of regimes with their names, in the order of a legend.
pub const FILLS: [(Fill, &str); 7] = [
    (Fill::Locked, "locked"),
    (Fill::Doubled, "doubled"),
    (Fill::Periodic, "periodic otherwise"),
    (Fill::Chaotic, "chaotic"),
    (Fill::HopAndRest, "hops and rests"),
    (Fill::Rest, "rests for ever"),
    (Fill::Undecided, "undecided"),
];

/// Follows orbits of one map to their ending.
#[derive(Clone, Debug)]
pub struct Endings {
    map: Map,
    /// The attracting period-1 orbits, by order from 1 to the highest.
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
        let highest = locks.iter().rposition(Option::is_some);
        locks.truncate(highest.map_or(0, |n| n + 1));
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

    /// The attracting period-1 orbit whose order is nearest to a flight.
    fn lock_after(&self, flight: f64) -> Option<&Lock> {
        if self.locks.is_empty() {
            return None;
        }
        let order = (flight * (1.0 / TAU) + 0.5) as usize;
        self.locks.get(order.checked_sub(1)?)?.as_ref()
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

    /// Where parts that start just after an impact end, in the order of their starts: what
    /// [`Endings::of`] says of each, many orbits side by side.
    #[must_use]
    pub fn of_all(&self, starts: &[State]) -> Vec<Regime> {
        let mut ends = vec![Regime::Undecided; starts.len()];
        let mut block = Block::new();
        let mut waiting = starts.iter().enumerate();
        let mut flying: Vec<Option<(usize, Followed)>> = (0..LANES).map(|_| None).collect();
        let mut fill = |block: &mut Block, lane: usize, flying: &mut Option<(usize, Followed)>| {
            *flying = None;
            block.clear(lane);
            if let Some((index, start)) = waiting.next()
                && block.put(lane, &self.map, *start).is_ok()
            {
                *flying = Some((index, Followed::new()));
            }
        };
        for (lane, flying) in flying.iter_mut().enumerate() {
            fill(&mut block, lane, flying);
        }
        while flying.iter().any(Option::is_some) {
            block.advance(1);
            for (lane, slot) in flying.iter_mut().enumerate() {
                let Some((index, followed)) = slot else {
                    continue;
                };
                // A lane that rests, from the start or since its last impact, has no further one.
                let end = match block.impact(lane) {
                    Some(impact) if !followed.rests && impact.flight > 0.0 => {
                        followed.take(self, &impact)
                    }
                    _ => Some(self.after_rest),
                };
                followed.rests = block.rests(lane);
                if let Some(end) = end {
                    ends[*index] = end;
                    fill(&mut block, lane, slot);
                }
            }
        }
        ends
    }

    fn follow(&self, orbit: Orbit<'_>) -> Regime {
        let mut followed = Followed::new();
        for event in orbit {
            match event {
                Event::Impact(impact) => {
                    if let Some(end) = followed.take(self, &impact) {
                        return end;
                    }
                }
                Event::Rest { .. } => return self.after_rest,
                Event::LiftOff { .. } => {}
            }
        }
        followed.verdict()
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

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    fn shares(k: f64, restitution: f64) -> HashMap<Fill, f64> {
        let endings = Endings::new(k, restitution, 2000).unwrap();
        let mut shares = HashMap::new();
        for row in 0..40 {
            for column in 0..40 {
                let start = State {
                    phase: TAU * (f64::from(column) + 0.5) / 40.0,
                    velocity: 3.0 * (f64::from(row) + 0.5) / 40.0,
                };
                *shares.entry(fill(endings.of(start))).or_default() += 1.0 / 1600.0;
            }
        }
        shares
    }

    #[test]
    fn shares_of_the_reference_case() {
        // docs/theory-capture.md#t7.1: 33 % lock, 64 % rest and relaunch, 3 % otherwise. Another placing of the
        // 40 x 40 starts moves the shares by the cells on the basin's edge, about 2 %.
        let shares = shares(0.43, 0.2);
        assert!((shares[&Fill::Locked] - 0.33).abs() < 0.02, "{shares:?}");
        assert!(
            (shares[&Fill::HopAndRest] - 0.64).abs() < 0.02,
            "{shares:?}"
        );
    }

    #[test]
    fn many_side_by_side_end_where_each_ends_alone() {
        for (k, restitution) in [(0.43, 0.2), (0.5, 0.6), (0.3, 0.4), (1.2, 0.8), (0.4, 0.0)] {
            let endings = Endings::new(k, restitution, 1500).unwrap();
            let starts: Vec<State> = (0..700)
                .map(|n| State {
                    phase: TAU * (f64::from(n) * 0.618_034).fract(),
                    velocity: 3.0 * (f64::from(n) * 0.414_214).fract(),
                })
                .collect();
            let alone: Vec<Regime> = starts.iter().map(|start| endings.of(*start)).collect();
            assert_eq!(endings.of_all(&starts), alone, "{k} {restitution}");
        }
    }

    #[test]
    fn below_0_4117_rest_leads_to_the_lock() {
        let shares = shares(0.405, 0.2);
        assert!(shares[&Fill::Locked] > 0.95, "{shares:?}");
    }

    #[test]
    fn above_1_a_part_rests_for_ever_or_locks() {
        // docs/theory-reference.md#t11.4: k = 1.2, R = 0.8 locks.
        let shares = shares(1.2, 0.8);
        assert!(
            shares[&Fill::Rest] > 0.1 && shares[&Fill::Locked] > 0.05,
            "{shares:?}"
        );
        assert!(!shares.contains_key(&Fill::HopAndRest));
    }

    #[test]
    fn the_cascade_is_named() {
        // Between the flips of docs/theory-bands.md#t6.1
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
