//! Where an orbit of the exact map ends.

mod followed;
mod gears;
mod memory;

use std::f64::consts::TAU;
use std::sync::OnceLock;

use kband::impact::batch::{Block, LANES};
use kband::impact::{Kernel, Map, Orbit, OrbitEvent, PartState};
use kband::regime::HIGHEST_ORDER;
use kband::regime::Lock;
use kband::regime::classify::Regime;
use kband::regime::{exponent, gear};

use followed::Followed;
pub use gears::{Gears, InGear};

use crate::picture::Fill;
use crate::refusal::Refusal;

/// Impacts after which every verb gives up an orbit that neither closed nor came to rest, where the user says nothing else.
pub const FOLLOWED: usize = 20_000;

/// Impacts for which a part from rest is followed until it rests again: one orbit for all that rest once, so that it may
/// be a long one.
const RELAUNCHED: usize = 200_000;

/// Impacts for which irregular flights next to the period-1 orbit of an order must stay in gear before any of that order
/// are called chaos.
const HELD: usize = 100_000;

/// Impacts left out at the start of those.
const SETTLING: usize = 1000;

/// Orders of gear in which chaos is told.
const ORDERS: usize = 8;

/// What a regime is called where it is told of an orbit that was followed for so many impacts.
#[must_use]
pub fn told(regime: Regime, followed: usize) -> String {
    match regime {
        Regime::Undecided => format!("undecided after {followed} impacts"),
        other => name(other),
    }
}

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
    /// Whether irregular flights in gear stay there, by order from 1.
    held: [OnceLock<bool>; ORDERS],
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
            held: Default::default(),
        };
        endings.after_rest = endings.relaunched();
        Ok(endings)
    }

    /// The map whose orbits they are.
    #[must_use]
    pub fn map(&self) -> &Map {
        &self.map
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
    pub fn of(&self, start: PartState) -> Regime {
        self.follow(Orbit::new(&self.map, start))
    }

    /// Where parts that start just after an impact end, in the order of their starts: what
    /// [`Endings::of`] says of each, many orbits side by side.
    #[must_use]
    pub fn of_all(&self, starts: &[PartState]) -> Vec<Regime> {
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
                *flying = Some((index, Followed::new(self.impacts)));
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
        let mut followed = Followed::new(self.impacts);
        for event in orbit {
            match event {
                OrbitEvent::Impact(impact) => {
                    if let Some(end) = followed.take(self, &impact) {
                        return end;
                    }
                }
                OrbitEvent::Rest { .. } => return self.after_rest,
                OrbitEvent::LiftOff { .. } => {}
            }
        }
        self.after_rest
    }

    /// Where a part thrown off from rest ends: if at rest again, after so many drive cycles from one lift-off to the next.
    fn relaunched(&self) -> Regime {
        let mut followed = Followed::new(self.impacts.max(RELAUNCHED));
        let mut time = 0.0;
        let mut lifted = false;
        for event in Orbit::from_rest(&self.map) {
            match event {
                OrbitEvent::Impact(impact) => {
                    time += impact.flight;
                    if let Some(end) = followed.take(self, &impact) {
                        return end;
                    }
                }
                OrbitEvent::Rest { chatter, .. } => time += chatter,
                OrbitEvent::LiftOff { wait, .. } if lifted => {
                    let cycles = ((time + wait) / TAU).round() as u32;
                    return Regime::HopAndRest { cycles };
                }
                OrbitEvent::LiftOff { .. } => lifted = true,
            }
        }
        Regime::Rest
    }

    /// Whether irregular flights in gear of an order stay there: told by one orbit from beside the period-1 orbit, as a
    /// gear has one attractor at a time. Long transients are not held: all of them leave gear sooner or later.
    #[must_use]
    pub fn holds(&self, order: u32) -> bool {
        let known = order.checked_sub(1).and_then(|n| self.held.get(n as usize));
        known.is_some_and(|held| *held.get_or_init(|| self.is_held(order)))
    }

    fn is_held(&self, order: u32) -> bool {
        let period = TAU * f64::from(order);
        let mut orbit = Orbit::new(&self.map, exponent::start(&self.map, order));
        (0..HELD).all(|n| match orbit.next() {
            Some(OrbitEvent::Impact(impact)) => {
                n < SETTLING || gear::is_in_gear(impact.flight, period)
            }
            Some(OrbitEvent::LiftOff { .. }) => n == 0,
            Some(OrbitEvent::Rest { .. }) | None => false,
        })
    }
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
                let start = PartState {
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
            let starts: Vec<PartState> = (0..700)
                .map(|n| PartState {
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
            let beside = PartState {
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
