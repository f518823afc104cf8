//! An orbit that is followed impact by impact until its regime is decided.

use std::f64::consts::TAU;

use kband::impact::{Impact, PartState};
use kband::regime::classify::Regime;
use kband::regime::gear;

use super::Endings;
use super::memory::{MEMORY, Memory};

/// Distance in rad and `b w` from an attracting period-1 orbit at which it captures an orbit.
const AT_THE_LOCK: f64 = 1e-5;

/// Number of impacts after which an open orbit is judged by its last ones, repeatedly.
const JUDGED_AFTER_IMPACTS: usize = 6000;

/// An orbit without a final regime yet; the fields for every impact come first and together.
pub(super) struct Followed {
    count: usize,
    /// Number of impacts before the next detailed check.
    look_next: usize,
    /// Time in rad since the first launch.
    time: f64,
    kept: Kept,
    keep_next: usize,
    /// Number of impacts before the next judgement by the last ones.
    weigh_next: usize,
    /// Number of impacts after which it is given up.
    limit: usize,
    row: Row,
    /// The last impacts, recorded shortly before a judgement.
    memory: Memory,
}

impl Followed {
    pub(super) fn new(limit: usize) -> Self {
        Self {
            count: 0,
            look_next: 1,
            time: 0.0,
            kept: Kept::NONE,
            keep_next: 16,
            weigh_next: JUDGED_AFTER_IMPACTS.min(limit),
            limit,
            row: Row::default(),
            memory: Memory::default(),
        }
    }

    /// Time in rad since the first launch.
    pub(super) fn time(&self) -> f64 {
        self.time
    }

    /// Takes the next impact and returns the state of the decision.
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

    /// The detailed check, at some impacts only.
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
                ..Kept::NONE
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

    /// Judgement by the last impacts.
    ///
    /// Without repeats it is chaos if flights in its gear are proven to stay there. Otherwise it
    /// may still rest, and stays undecided.
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
        self.weigh_next = (self.count + JUDGED_AFTER_IMPACTS).min(self.limit);
        self.look_next = self.count + 1;
        self.memory = Memory::default();
        Said::GoesOn
    }
}

/// State of the decision on an orbit's regime.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Said {
    /// Undecided.
    GoesOn,
    /// The orbit rests before the part is thrown again.
    Rests,
    /// It depends on whether flights stay in the gear of this order; then it is judged again.
    Asks(u32),
    /// Decided.
    Ends(Regime),
}

/// Consecutive flights in gear of one order.
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
        // The nearest whole number of turns, independent of the platform's rounding.
        self.order = (flight * (1.0 / TAU) + 0.5) as u32;
        self.period = f64::from(self.order) * TAU;
        self.count = usize::from(gear::is_in_gear(flight, self.period));
    }
}

/// Name of a cycle with these numbers of impacts and drive cycles.
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

/// A kept state, to detect the orbit's return (Brent's cycle detection, 1980).
///
/// It is replaced when the number of impacts is a power of two, so it leaves the transient behind.
#[derive(Clone, Copy, Debug)]
struct Kept {
    state: PartState,
    /// Number of impacts up to it.
    count: usize,
    /// Time up to it, in rad.
    time: f64,
    /// Impacts and time of the first return.
    first: Option<(usize, f64)>,
    /// Impacts and time of the shortest period that divides it.
    shortest: Option<(usize, f64)>,
}

impl Kept {
    /// A state that no orbit approaches.
    const NONE: Self = Self {
        state: PartState {
            phase: f64::NAN,
            velocity: f64::NAN,
        },
        count: 0,
        time: 0.0,
        first: None,
        shortest: None,
    };

    /// Impacts and time of one period, after the state has returned twice.
    ///
    /// Both returns must agree to the last bits, after the same number of impacts. One return can
    /// occur by chance in chaos. An orbit that alternates about the one that it approaches is
    /// nearer after two periods than after one, so shorter periods count from a larger distance.
    #[inline]
    fn returned(&mut self, state: PartState, count: usize, time: f64) -> Option<(usize, f64)> {
        let Some((impacts, first_time)) = self.first else {
            if near(self.state, state, LAST_BITS) {
                self.first = Some((count - self.count, time - self.time));
            }
            return None;
        };
        let since = (count - self.count).checked_sub(impacts)?;
        if self.shortest.is_none()
            && impacts.checked_rem(since) == Some(0)
            && near(self.state, state, APPROACHING)
        {
            self.shortest = Some((since, time - self.time - first_time));
        }
        self.shortest
            .filter(|_| since == impacts && near(self.state, state, LAST_BITS))
    }
}

/// Largest distance, in rad and `b w`, of a return to the last bits.
const LAST_BITS: f64 = 1e-9;

/// The same of a return after a shorter period while the orbit still approaches it: a thousand
/// times the last bits, enough for a multiplier down to -0.999. With one nearer to -1 no orbit
/// returns within [`FOLLOWED`](super::FOLLOWED) impacts.
const APPROACHING: f64 = 1e-6;

#[inline]
fn near(a: PartState, b: PartState, distance: f64) -> bool {
    let apart = (a.phase - b.phase).abs();
    (a.velocity - b.velocity).abs() < distance && apart.min(TAU - apart) < distance
}
