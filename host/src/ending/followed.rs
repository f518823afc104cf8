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

/// An orbit on its way to its ending. What every impact asks for stands first and together.
pub(super) struct Followed {
    count: usize,
    /// Impacts after which more is looked at than where the orbit is.
    look_next: usize,
    /// Since its first launch, in rad.
    time: f64,
    kept: Kept,
    keep_next: usize,
    /// Impacts after which its last ones are weighed next.
    weigh_next: usize,
    /// Impacts after which it is given up.
    limit: usize,
    row: Row,
    /// The last impacts, once there are not many left.
    memory: Memory,
}

impl Followed {
    pub(super) fn new(limit: usize) -> Self {
        Self {
            weigh_next: WEIGHED.min(limit),
            ..Self::weighed_at(limit)
        }
    }

    /// One that is judged no earlier than when it is given up.
    pub(super) fn weighed_at(limit: usize) -> Self {
        Self {
            count: 0,
            look_next: 1,
            time: 0.0,
            kept: Kept::NONE,
            keep_next: 16,
            weigh_next: limit,
            limit,
            row: Row::default(),
            memory: Memory::default(),
        }
    }

    /// Time since its first launch, in rad.
    pub(super) fn time(&self) -> f64 {
        self.time
    }

    /// Whether its last impacts come near a cycle, however slowly.
    pub(super) fn settles(&self) -> bool {
        self.memory.settles()
    }

    /// Takes the next impact, and says what is known of the ending.
    #[inline]
    pub(super) fn take(&mut self, endings: &Endings, impact: &Impact<PartState>) -> Said {
        self.count += 1;
        self.time += impact.flight;
        if let Some(lock) = endings.lock_after(impact.flight)
            && (impact.next.velocity - lock.state().velocity).abs() < AT_THE_LOCK
            && lock.distance(impact.next) < AT_THE_LOCK
        {
            return Said::Ends(Regime::Locked {
                order: lock.order(),
            });
        }
        if endings.comes_to_rest(impact.next) {
            return Said::Rests;
        }
        if let Some((impacts, time)) = self.kept.returned(impact.next, self.count, self.time) {
            return Said::Ends(named(impacts as u32, (time / TAU).round() as u32));
        }
        if self.count < self.look_next {
            return Said::GoesOn;
        }
        self.look(endings, impact)
    }

    /// What else an impact asks for, now and then.
    #[inline(never)]
    fn look(&mut self, endings: &Endings, impact: &Impact<PartState>) -> Said {
        if self.count + 2 * MEMORY > self.weigh_next {
            self.row.take(impact.flight);
        }
        if self.count + MEMORY > self.weigh_next {
            self.memory.take(impact.flight);
        }
        if self.count == self.keep_next {
            self.kept = Kept {
                state: impact.next,
                count: self.count,
                time: self.time,
                first: None,
            };
            self.keep_next *= 2;
        }
        let said = if self.count == self.weigh_next {
            self.weighed(endings)
        } else {
            Said::GoesOn
        };
        let row_begins = (self.weigh_next + 1).saturating_sub(2 * MEMORY);
        self.look_next = self.keep_next.min(row_begins.max(self.count + 1));
        said
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
        self.look_next = self.count + 1;
        self.memory = Memory::default();
        Said::GoesOn
    }
}

/// What is known of an orbit's ending.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Said {
    /// Nothing yet.
    GoesOn,
    /// It comes to rest before it is thrown off again.
    Rests,
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
#[derive(Clone, Copy, Debug)]
struct Kept {
    state: PartState,
    /// Impacts up to it.
    count: usize,
    /// Time up to it, in rad.
    time: f64,
    /// Impacts and time of the first return.
    first: Option<(usize, f64)>,
}

impl Kept {
    /// No orbit comes near to it.
    const NONE: Self = Self {
        state: PartState {
            phase: f64::NAN,
            velocity: f64::NAN,
        },
        count: 0,
        time: 0.0,
        first: None,
    };

    /// Impacts and time of one period, once the state, after `count` impacts and `time`, came back twice to the last bits
    /// after the same number of impacts; once can happen by chance in chaos.
    #[inline]
    fn returned(&mut self, state: PartState, count: usize, time: f64) -> Option<(usize, f64)> {
        if !near(self.state, state) {
            return None;
        }
        match self.first {
            Some((impacts, time)) => (count - self.count == 2 * impacts).then_some((impacts, time)),
            None => {
                self.first = Some((count - self.count, time - self.time));
                None
            }
        }
    }
}

#[inline]
fn near(a: PartState, b: PartState) -> bool {
    const LAST_BITS: f64 = 1e-9;
    let apart = (a.phase - b.phase).abs();
    (a.velocity - b.velocity).abs() < LAST_BITS && apart.min(TAU - apart) < LAST_BITS
}
