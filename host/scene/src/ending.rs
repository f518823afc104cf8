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
use kband::regime::classify::Regime;
use kband::regime::{Lock, MAX_ORDER, exponent};

pub use gears::{Gears, InGear};
use memory::JUDGED_IMPACTS;
use to_rest::ToRest;
pub use together::of_each;

use crate::refusal::Refusal;

/// Default number of impacts after which an orbit that neither closed nor rested is undecided.
pub const MAX_ORBIT_IMPACTS: usize = 20_000;
/// Number of orbits per thread: most end soon, and the rest are fastest in blocks.
pub const ORBITS_PER_BLOCK: usize = 4096;
/// Number of starts on one track from which the table of certain rests saves time.
const MIN_STARTS_FOR_TABLE: usize = 64;
/// Number of gear orders in which chaos is detected.
const ORDERS: usize = 8;

/// Name of a regime of an orbit that was followed for `followed` impacts.
pub fn describe_regime(regime: Regime, followed: usize) -> String {
    match regime {
        Regime::Undecided if followed < JUDGED_IMPACTS => {
            format!("undecided after {followed} impacts")
        }
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
    let counted = |count: u32, what: &str| match count {
        1 => format!("1 {what}"),
        _ => format!("{count} {what}s"),
    };
    match regime {
        Regime::Locked { order } => format!("locked, r = {order}"),
        Regime::Doubled { order, doublings } => {
            format!("doubled to {}, r = {order}", 1_u64 << doublings.min(63))
        }
        Regime::Periodic { impacts, cycles } => {
            let (impacts, cycles) = (counted(impacts, "impact"), counted(cycles, "cycle"));
            format!("periodic, {impacts} in {cycles}")
        }
        Regime::HopAndRest { cycles } => format!("hops and rests, {}", counted(cycles, "cycle")),
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
    /// Final regime of every part from rest, computed at the first rest: rest erases the history.
    after_rest: OnceLock<Regime>,
    impacts: usize,
    /// Whether irregular flights in gear stay there, by order from 1.
    held: [OnceLock<bool>; ORDERS],
    /// Table of states that certainly come to rest, computed for large numbers of starts.
    to_rest: OnceLock<Box<ToRest>>,
}

impl Endings {
    /// The classifier at `k` and a restitution below 1, for instantaneous impacts, up to `impacts`.
    pub fn new(k: f64, restitution: f64, impacts: usize) -> Result<Self, Refusal> {
        Self::with_contact(k, restitution, impacts, ContactTime::INSTANT)
    }

    /// The same for impacts with a contact time.
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

    /// The classifiers of tracks of a k and a restitution, with the regimes from rest in blocks.
    pub fn from_tracks(
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

    /// Extends an impact, which ends at the touch, by its contact.
    #[inline]
    fn extend(&self, touch: Impact<PartState>) -> Impact<PartState> {
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
        let compute = || together::after_rest(slice::from_ref(self))[0];
        *self.after_rest.get_or_init(compute)
    }

    /// Final regime of a part that starts just after an impact.
    pub fn classify(&self, start: PartState) -> Regime {
        self.classify_all([start].into_iter())[0]
    }

    /// Final regimes of parts that start just after an impact, in the order of their starts.
    pub fn classify_all(&self, starts: impl ExactSizeIterator<Item = PartState>) -> Vec<Regime> {
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
        let to_rest = self.to_rest.get();
        to_rest.is_some_and(|to_rest| to_rest.is_certain(state))
    }

    /// Whether irregular flights in gear of an order stay there; computed on the first call.
    pub fn stays_in_gear(&self, order: u32) -> bool {
        if self.known_to_stay(order).is_none() {
            together::hold(slice::from_ref(self), &BTreeSet::from([(0, order)]));
        }
        self.known_to_stay(order) == Some(true)
    }

    /// The result of [`Self::stays_in_gear`] if computed; false for orders without chaos detection.
    fn known_to_stay(&self, order: u32) -> Option<bool> {
        let held = self.held(order);
        held.map_or(Some(false), |held| held.get().copied())
    }

    fn set_stays(&self, order: u32, stays: bool) {
        // An earlier value is equal, because it was computed alike.
        let _ = self.held(order).map(|held| held.set(stays));
    }

    fn held(&self, order: u32) -> Option<&OnceLock<bool>> {
        self.held.get(order.checked_sub(1)? as usize)
    }
}

#[cfg(test)]
mod tests {
    use std::mem::discriminant;

    use super::*;

    const LOCKED: Regime = Regime::Locked { order: 1 };
    const HOP_AND_REST: Regime = Regime::HopAndRest { cycles: 1 };

    /// Shares of a grid of 40 x 40 starts. Another grid changes them by about 2 %.
    #[test]
    fn shares_of_the_reference_cases() {
        for (k, restitution, regime, shares) in [
            // docs/theory-capture.md#t7.1: 33 % lock, 64 % rest and relaunch, 3 % otherwise.
            (0.43, 0.2, LOCKED, 0.31..=0.35),
            (0.43, 0.2, HOP_AND_REST, 0.62..=0.66),
            // Below 0.4117 rest leads to the lock.
            (0.405, 0.2, LOCKED, 0.95..=1.0),
            // docs/theory-reference.md#t11.4: above 1 a part rests for ever or locks.
            (1.2, 0.8, Regime::Rest, 0.1..=1.0),
            (1.2, 0.8, LOCKED, 0.05..=1.0),
            (1.2, 0.8, HOP_AND_REST, 0.0..=0.0),
        ] {
            let endings = Endings::new(k, restitution, 2000).unwrap();
            let place = |n: u32| (f64::from(n) + 0.5) / 40.0;
            let start = |n: u32| PartState::new(TAU * place(n % 40), 3.0 * place(n / 40));
            let ends = (0..1600).map(|n| endings.classify(start(n)));
            let own = ends.filter(|end| discriminant(end) == discriminant(&regime));
            let share = own.count() as f64 / 1600.0;
            assert!(
                shares.contains(&share),
                "{k} {restitution} {regime:?}: {share}"
            );
        }
    }

    #[test]
    fn batched_orbits_end_as_single_orbits() {
        for (k, restitution) in [(0.43, 0.2), (0.5, 0.6), (0.3, 0.4), (1.2, 0.8), (0.4, 0.0)] {
            let endings = Endings::new(k, restitution, 1500).unwrap();
            let starts = (0..700).map(|n| PartState {
                phase: TAU * (f64::from(n) * 0.618_034).fract(),
                velocity: 3.0 * (f64::from(n) * 0.414_214).fract(),
            });
            let alone = starts.clone().map(|start| endings.classify(start));
            let alone: Vec<Regime> = alone.collect();
            assert_eq!(endings.classify_all(starts), alone, "{k} {restitution}");
        }
    }

    #[test]
    fn the_cascade_is_named() {
        let doubled = |doublings| Regime::Doubled {
            order: 1,
            doublings,
        };
        // Between the flips of docs/theory-bands.md#t6.1
        for (k, regime) in [
            (0.43, LOCKED),
            (0.38, doubled(1)),
            (0.363, doubled(2)),
            (0.3596, doubled(3)),
            (0.35, Regime::Chaotic),
        ] {
            let start = Lock::build(k, 0.2, 1).unwrap().unwrap().state();
            let displaced = PartState::new(start.phase + 1e-3, start.velocity);
            let endings = Endings::new(k, 0.2, 3000).unwrap();
            assert_eq!(endings.classify(displaced), regime, "{k}");
        }
    }
}
