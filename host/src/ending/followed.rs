//! An orbit that is followed impact by impact, until it is known what it is.

use std::f64::consts::TAU;

use kband::impact::{Impact, PartState};
use kband::regime::classify::Regime;
use kband::regime::gear;

use super::Endings;
use super::memory::{MEMORY, Memory};

/// Distance in rad and units of `b w` at which an attracting period-1 orbit holds what comes near it.
const AT_THE_LOCK: f64 = 1e-5;

/// Impacts after which an orbit that did not close is judged by its last ones, again and again.
const WEIGHED: usize = 6000;

/// An orbit on its way to its ending.
pub(super) struct Followed {
    count: usize,
    /// Impacts after which it is given up.
    limit: usize,
    /// Impacts after which its last ones are weighed next.
    weigh_next: usize,
    row: Row,
    keep_next: usize,
    kept: Kept,
    /// The last impacts, once there are not many left.
    memory: Memory,
}

impl Followed {
    pub(super) fn new(limit: usize) -> Self {
        Self {
            count: 0,
            limit,
            weigh_next: WEIGHED.min(limit),
            row: Row::default(),
            keep_next: 16,
            kept: Kept::default(),
            memory: Memory::default(),
        }
    }

    /// Takes the next impact, and says what is known of the ending.
    pub(super) fn take(&mut self, endings: &Endings, impact: &Impact<PartState>) -> Said {
        self.count += 1;
        if let Some(lock) = endings.lock_after(impact.flight)
            && (impact.next.velocity - lock.state().velocity).abs() < AT_THE_LOCK
            && lock.distance(impact.next) < AT_THE_LOCK
        {
            return Said::Ends(Regime::Locked {
                order: lock.order(),
            });
        }
        if let Some((impacts, time)) = self.kept.returned(impact.next, impact.flight) {
            return Said::Ends(named(impacts, (time / TAU).round() as u32));
        }
        self.row.take(impact.flight);
        if self.count + MEMORY > self.weigh_next {
            self.memory.take(impact.flight);
        }
        if self.count == self.keep_next {
            self.kept = Kept {
                state: Some(impact.next),
                ..Kept::default()
            };
            self.keep_next *= 2;
        }
        if self.count == self.weigh_next {
            return self.weighed(endings);
        }
        Said::GoesOn
    }

    /// What it is, as far as its last impacts tell. What repeats nothing is chaos where flights in its gear are known to
    /// stay there; elsewhere it may still come to rest, and nothing is decided.
    pub(super) fn weighed(&mut self, endings: &Endings) -> Said {
        let end = match self.memory.verdict() {
            Regime::Chaotic if self.row.count < MEMORY => Regime::Undecided,
            Regime::Chaotic => match endings.held(self.row.order) {
                Some(true) => Regime::Chaotic,
                Some(false) => Regime::Undecided,
                None => return Said::Asks(self.row.order),
            },
            other => other,
        };
        if end != Regime::Undecided || self.count >= self.limit {
            return Said::Ends(end);
        }
        self.weigh_next = (self.count + WEIGHED).min(self.limit);
        self.memory = Memory::default();
        Said::GoesOn
    }
}

/// What is known of an orbit's ending.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Said {
    /// Nothing yet.
    GoesOn,
    /// Whether flights stay in the gear of this order must be known first; then it is weighed again.
    Asks(u32),
    /// It is known.
    Ends(Regime),
}

/// Flights in gear of one order, in a row.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    order: u32,
    period: f64,
    count: usize,
}

impl Row {
    #[inline]
    fn take(&mut self, flight: f64) {
        if gear::is_in_gear(flight, self.period) {
            self.count += 1;
            return;
        }
        // The nearest whole number of turns, without the platform's rounding.
        self.order = (flight * (1.0 / TAU) + 0.5) as u32;
        self.period = f64::from(self.order) * TAU;
        self.count = usize::from(gear::is_in_gear(flight, self.period));
    }
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
    state: Option<PartState>,
    impacts: u32,
    time: f64,
    /// Impacts and time of the first return.
    first: Option<(u32, f64)>,
}

impl Kept {
    /// Impacts and time of one period, once `state` came back twice to the last bits after the same
    /// number of impacts; once can happen by chance in chaos.
    fn returned(&mut self, state: PartState, flight: f64) -> Option<(u32, f64)> {
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

fn near(a: PartState, b: PartState) -> bool {
    const LAST_BITS: f64 = 1e-9;
    let apart = (a.phase - b.phase).abs();
    (a.velocity - b.velocity).abs() < LAST_BITS && apart.min(TAU - apart) < LAST_BITS
}
