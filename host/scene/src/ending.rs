//! Classification of an orbit's final regime on the exact map.

mod followed;
mod gears;
mod memory;
mod to_rest;
mod together;

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::slice;
use std::sync::OnceLock;

use kband::impact::{ContactTime, Impact, Kernel, Map, Orbit, PartState};
use kband::regime::Lock;
use kband::regime::MAX_ORDER;
use kband::regime::classify::Regime;
use kband::regime::exponent;

pub use gears::{Gears, InGear};
use memory::MEMORY;
use to_rest::ToRest;
pub use together::of_each;

use crate::refusal::Refusal;

/// Number of impacts after which every verb gives up an orbit that neither closed nor rested; the
/// default.
pub const FOLLOWED: usize = 20_000;

/// Number of orbits per thread: most end soon, and the rest fly fastest side by side.
pub const TOGETHER: usize = 4096;

/// Number of starts on one track from which the table of certain rests saves time.
const MIN_STARTS_FOR_TABLE: usize = 64;

/// Number of gear orders in which chaos is detected.
const ORDERS: usize = 8;

/// Name of a regime of an orbit that was followed for `followed` impacts.
pub fn describe_regime(regime: Regime, followed: usize) -> String {
    match regime {
        Regime::Undecided if followed < MEMORY => format!("undecided after {followed} impacts"),
        Regime::Undecided => chaotic_so_far(followed),
        other => name(other),
    }
}

/// Name of an orbit without repetition that may still come to rest.
pub fn chaotic_so_far(impacts: usize) -> String {
    format!("chaotic for at least {impacts} impacts; whether it is a transient is open")
}

/// Name of a regime in tables and legends.
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
        Regime::Undecided => "chaotic so far".into(),
    }
}

/// Classifies orbits of one map by their final regime.
#[derive(Clone, Debug)]
pub struct Endings {
    map: Map,
    contact: ContactTime,
    /// The attracting period-1 orbits, by order from 1 to the highest.
    locks: Vec<Option<Lock>>,
    /// Final regime of a part from rest, computed where one rests. Every part that rests once shares
    /// it, because rest erases the history.
    after_rest: OnceLock<Regime>,
    impacts: usize,
    /// Whether irregular flights in gear stay there, by order from 1.
    held: [OnceLock<bool>; ORDERS],
    /// Table of states that certainly come to rest, computed for large numbers of starts.
    to_rest: OnceLock<Box<ToRest>>,
}

impl Endings {
    /// The classifier at `k` and a restitution below 1, of impacts in no time; it gives up an orbit
    /// after `impacts` impacts.
    ///
    /// Errors: a `Refusal` for parameters out of range.
    pub fn new(k: f64, restitution: f64, impacts: usize) -> Result<Self, Refusal> {
        Self::with_contact(k, restitution, impacts, ContactTime::INSTANT)
    }

    /// The same of impacts that take time.
    pub fn with_contact(
        k: f64,
        restitution: f64,
        impacts: usize,
        contact: ContactTime,
    ) -> Result<Self, Refusal> {
        let map = Map::build(k, restitution)?;
        let mut locks = Vec::new();
        for order in 1..=MAX_ORDER {
            let Some(lock) = Lock::with_contact(k, restitution, order, contact)? else {
                break;
            };
            locks.push(Some(lock).filter(|lock| lock.attracts() && lock.is_first_return()));
        }
        let highest = locks.iter().rposition(Option::is_some);
        locks.truncate(highest.map_or(0, |n| n + 1));
        Ok(Self {
            map,
            contact,
            locks,
            after_rest: OnceLock::new(),
            impacts,
            held: Default::default(),
            to_rest: OnceLock::new(),
        })
    }

    /// The endings on many tracks, each of a k and a restitution; the regimes of parts from rest are
    /// computed side by side.
    pub fn of_tracks(
        tracks: &[(f64, f64)],
        impacts: usize,
        contact: ContactTime,
    ) -> Result<Vec<Self>, Refusal> {
        let one =
            |(k, restitution): &(f64, f64)| Self::with_contact(*k, *restitution, impacts, contact);
        let mut all: Vec<Self> = tracks.iter().map(one).collect::<Result<_, _>>()?;
        let ends = together::after_rest(&all);
        for (endings, end) in all.iter_mut().zip(ends) {
            endings.after_rest = end.into();
        }
        Ok(all)
    }

    /// The map of the orbits, up to the touch.
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The orbit that begins just after an impact with `start`, or from rest.
    pub fn orbit(&self, start: Option<PartState>) -> Orbit<'_> {
        let orbit = match start {
            Some(start) => Orbit::new(&self.map, start),
            None => Orbit::from_rest(&self.map),
        };
        orbit.with_contact(self.contact)
    }

    /// An impact that ends at the touch, with its contact.
    #[inline]
    fn hold(&self, touch: Impact<PartState>) -> Impact<PartState> {
        if self.contact == ContactTime::INSTANT {
            return touch;
        }
        let (k, restitution) = (self.map.k(), self.map.restitution());
        self.contact.hold(restitution, touch, k, None)
    }

    /// A start near the locked orbit of `order` if it exists, else at lift-off.
    pub fn start_near_lock(&self, order: u32) -> PartState {
        let (k, restitution) = (self.map.k(), self.map.restitution());
        match Lock::with_contact(k, restitution, order, self.contact) {
            Ok(Some(lock)) => PartState::new(lock.state().phase + 1e-3, lock.state().velocity),
            _ => exponent::start_near_lock(&self.map, order),
        }
    }

    /// The attracting period-1 orbits.
    pub fn locks(&self) -> impl Iterator<Item = &Lock> {
        self.locks.iter().flatten()
    }

    /// The attracting period-1 orbit with the order nearest to a flight.
    fn lock_after(&self, flight: f64) -> Option<&Lock> {
        if self.locks.is_empty() {
            return None;
        }
        let order = (flight * (1.0 / TAU) + 0.5) as usize;
        self.locks.get(order.checked_sub(1)?)?.as_ref()
    }

    /// Final regime of a part that starts from rest.
    pub fn from_rest(&self) -> Regime {
        *self
            .after_rest
            .get_or_init(|| together::after_rest(slice::from_ref(self))[0])
    }

    /// Final regime of a part that starts just after an impact.
    pub fn of(&self, start: PartState) -> Regime {
        self.of_all([start].into_iter())[0]
    }

    /// Final regimes of parts that start just after an impact, in the order of their starts.
    pub fn of_all(&self, starts: impl ExactSizeIterator<Item = PartState>) -> Vec<Regime> {
        // The bound behind the table is one of impacts in no time.
        if starts.len() >= MIN_STARTS_FOR_TABLE && self.contact.is_instant() {
            self.to_rest
                .get_or_init(|| Box::new(ToRest::new(self.map.k(), self.map.restitution())));
        }
        of_each(slice::from_ref(self), starts.map(|start| (0, start)))
    }

    /// Whether the table proves that a part launched in `state` rests before it is thrown again.
    #[inline]
    fn comes_to_rest(&self, state: PartState) -> bool {
        self.to_rest
            .get()
            .is_some_and(|to_rest| to_rest.is_certain(state))
    }

    /// Whether irregular flights in gear of an order stay there; computed on the first call.
    pub fn holds(&self, order: u32) -> bool {
        if self.held(order).is_none() {
            together::hold(slice::from_ref(self), &BTreeSet::from([(0, order)]));
        }
        self.held(order) == Some(true)
    }

    /// Whether irregular flights in gear of an order stay there, if computed; false for orders without
    /// chaos detection.
    fn held(&self, order: u32) -> Option<bool> {
        match order.checked_sub(1).and_then(|n| self.held.get(n as usize)) {
            Some(held) => held.get().copied(),
            None => Some(false),
        }
    }

    fn set_held(&self, order: u32, stays: bool) {
        let held = order.checked_sub(1).and_then(|n| self.held.get(n as usize));
        if let Some(held) = held {
            // An earlier value is equal, because it was computed alike.
            let _ = held.set(stays);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;
    use std::mem::{Discriminant, discriminant};

    use super::*;

    const LOCKED: Regime = Regime::Locked { order: 1 };
    const HOP_AND_REST: Regime = Regime::HopAndRest { cycles: 1 };

    fn share(shares: &HashMap<Discriminant<Regime>, f64>, regime: Regime) -> f64 {
        let share = shares.get(&discriminant(&regime));
        share.copied().unwrap_or_default()
    }

    fn shares(k: f64, restitution: f64) -> HashMap<Discriminant<Regime>, f64> {
        let endings = Endings::new(k, restitution, 2000).unwrap();
        let mut shares = HashMap::new();
        for row in 0..40 {
            for column in 0..40 {
                let start = PartState {
                    phase: TAU * (f64::from(column) + 0.5) / 40.0,
                    velocity: 3.0 * (f64::from(row) + 0.5) / 40.0,
                };
                *shares.entry(discriminant(&endings.of(start))).or_default() += 1.0 / 1600.0;
            }
        }
        shares
    }

    #[test]
    fn shares_of_the_reference_case() {
        // docs/theory-capture.md#t7.1: 33 % lock, 64 % rest and relaunch, 3 % otherwise. Another
        // grid of 40 x 40 starts changes the shares by the cells on the basin's edge, about 2 %.
        let shares = shares(0.43, 0.2);
        assert!((share(&shares, LOCKED) - 0.33).abs() < 0.02, "{shares:?}");
        assert!(
            (share(&shares, HOP_AND_REST) - 0.64).abs() < 0.02,
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
            assert_eq!(
                endings.of_all(starts.iter().copied()),
                alone,
                "{k} {restitution}"
            );
        }
    }

    #[test]
    fn below_0_4117_rest_leads_to_the_lock() {
        let shares = shares(0.405, 0.2);
        assert!(share(&shares, LOCKED) > 0.95, "{shares:?}");
    }

    #[test]
    fn above_1_a_part_rests_for_ever_or_locks() {
        // docs/theory-reference.md#t11.4: k = 1.2, R = 0.8 locks.
        let shares = shares(1.2, 0.8);
        assert!(
            share(&shares, Regime::Rest) > 0.1 && share(&shares, LOCKED) > 0.05,
            "{shares:?}"
        );
        assert!(share(&shares, HOP_AND_REST) == 0.0);
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
            let start = Lock::build(k, 0.2, 1).unwrap().unwrap().state();
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
