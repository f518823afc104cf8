//! An orbit that is followed impact by impact until its regime is decided.

use std::f64::consts::TAU;

use kband::impact::{Impact, PartState};
use kband::regime::classify::Regime;
use kband::regime::gear;

use super::Endings;
use super::memory::{JUDGED_IMPACTS, Memory};

/// Distance in rad and `b w` from an attracting period-1 orbit at which it captures an orbit.
const LOCK_TOLERANCE: f64 = 1e-5;
/// Number of impacts between two judgements of an open orbit by its last impacts.
const JUDGEMENT_INTERVAL: usize = 6000;

/// An orbit without a final regime yet. Fields used at every impact come first, for the cache.
pub(super) struct Followed {
    count: usize,
    check_next: usize,
    /// Time in rad since the first launch.
    pub(super) time: f64,
    saved: SavedState,
    save_next: usize,
    /// Number of impacts before the next judgement by the last ones.
    judge_next: usize,
    /// Number of impacts after which the orbit is undecided.
    limit: usize,
    gear_run: GearRun,
    /// The last impacts, recorded only before a judgement.
    memory: Memory,
}

impl Followed {
    pub(super) fn new(limit: usize) -> Self {
        Self {
            count: 0,
            check_next: 1,
            time: 0.0,
            saved: SavedState::NONE,
            save_next: 16,
            judge_next: JUDGEMENT_INTERVAL.min(limit),
            limit,
            gear_run: GearRun::default(),
            memory: Memory::default(),
        }
    }

    #[inline]
    pub(super) fn take(&mut self, endings: &Endings, impact: &Impact<PartState>) -> Verdict {
        self.count += 1;
        self.time += impact.flight;
        if let Some(lock) = endings.lock_after(impact.flight)
            && (impact.next.velocity - lock.state().velocity).abs() < LOCK_TOLERANCE
            && lock.distance(impact.next) < LOCK_TOLERANCE
        {
            return Verdict::Ends(Regime::Locked {
                order: lock.order(),
            });
        }
        if endings.comes_to_rest(impact.next) {
            return Verdict::Rests;
        }
        if let Some((impacts, time)) = self.saved.returned(impact.next, self.count, self.time) {
            return Verdict::Ends(periodic(impacts as u32, (time / TAU).round() as u32));
        }
        if self.count < self.check_next {
            return Verdict::Continues;
        }
        self.check(endings, impact)
    }

    /// The detailed check, which only some impacts need.
    #[inline(never)]
    fn check(&mut self, endings: &Endings, impact: &Impact<PartState>) -> Verdict {
        if self.count + 2 * JUDGED_IMPACTS > self.judge_next {
            self.gear_run.take(impact.flight);
        }
        if self.count + JUDGED_IMPACTS > self.judge_next {
            self.memory.take(impact.flight);
        }
        if self.count == self.save_next {
            self.saved = SavedState {
                state: impact.next,
                count: self.count,
                time: self.time,
                ..SavedState::NONE
            };
            self.save_next *= 2;
        }
        let mut verdict = Verdict::Continues;
        if self.count == self.judge_next {
            verdict = self.judge(endings);
        }
        let gear_run_start = (self.judge_next + 1).saturating_sub(2 * JUDGED_IMPACTS);
        self.check_next = self.save_next.min(gear_run_start.max(self.count + 1));
        verdict
    }

    /// Judgement by the last impacts: chaos only if flights are proven to stay in gear.
    pub(super) fn judge(&mut self, endings: &Endings) -> Verdict {
        let end = match self.memory.verdict() {
            Regime::Chaotic if self.gear_run.count < JUDGED_IMPACTS => Regime::Undecided,
            Regime::Chaotic => match endings.known_to_stay(self.gear_run.order) {
                Some(true) => Regime::Chaotic,
                Some(false) => Regime::Undecided,
                None => return Verdict::NeedsGear(self.gear_run.order),
            },
            other => other,
        };
        if end != Regime::Undecided || self.count >= self.limit {
            return Verdict::Ends(end);
        }
        self.judge_next = (self.count + JUDGEMENT_INTERVAL).min(self.limit);
        self.check_next = self.count + 1;
        self.memory = Memory::default();
        Verdict::Continues
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    Continues,
    /// The orbit rests before the part is thrown again.
    Rests,
    /// Depends on whether flights stay in gear of this order; the orbit is then judged again.
    NeedsGear(u32),
    Ends(Regime),
}

#[derive(Clone, Copy, Debug, Default)]
struct GearRun {
    order: u32,
    period: f64,
    count: usize,
}

impl GearRun {
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

/// Regime that repeats after these numbers of impacts and drive cycles.
fn periodic(impacts: u32, cycles: u32) -> Regime {
    if !impacts.is_power_of_two() || cycles == 0 || !cycles.is_multiple_of(impacts) {
        return Regime::Periodic { impacts, cycles };
    }
    let order = cycles / impacts;
    match impacts.trailing_zeros() {
        0 => Regime::Locked { order },
        doublings => Regime::Doubled { order, doublings },
    }
}

/// A stored state, to detect the orbit's return (Brent's cycle detection, 1980).
struct SavedState {
    state: PartState,
    count: usize,
    time: f64,
    /// Impacts and time of the first return.
    first: Option<(usize, f64)>,
    /// Impacts and time of the shortest period that divides the first return.
    shortest: Option<(usize, f64)>,
}

impl SavedState {
    /// A state that no orbit approaches.
    const NONE: Self = Self {
        state: PartState::new(f64::NAN, f64::NAN),
        count: 0,
        time: 0.0,
        first: None,
        shortest: None,
    };

    /// Impacts and time of one period. Two returns must agree to the last bits: in chaos one may
    /// occur by chance. An approaching orbit is nearer after two periods than after one, so shorter
    /// periods have a larger tolerance.
    #[inline]
    fn returned(&mut self, state: PartState, count: usize, time: f64) -> Option<(usize, f64)> {
        let Some((impacts, first_time)) = self.first else {
            if is_near(self.state, state, RETURN_TOLERANCE) {
                self.first = Some((count - self.count, time - self.time));
            }
            return None;
        };
        let since = (count - self.count).checked_sub(impacts)?;
        if self.shortest.is_none()
            && impacts.checked_rem(since) == Some(0)
            && is_near(self.state, state, APPROACH_TOLERANCE)
        {
            self.shortest = Some((since, time - self.time - first_time));
        }
        self.shortest
            .filter(|_| since == impacts && is_near(self.state, state, RETURN_TOLERANCE))
    }
}

/// Largest distance, in rad and `b w`, of a return that agrees to the last bits.
const RETURN_TOLERANCE: f64 = 1e-9;
/// The same after a shorter period during the approach, for a multiplier down to -0.999. Nearer to
/// -1 no orbit returns within [`MAX_ORBIT_IMPACTS`](super::MAX_ORBIT_IMPACTS) impacts.
const APPROACH_TOLERANCE: f64 = 1e-6;

#[inline]
fn is_near(a: PartState, b: PartState, distance: f64) -> bool {
    let phase_difference = (a.phase - b.phase).abs();
    (a.velocity - b.velocity).abs() < distance
        && phase_difference.min(TAU - phase_difference) < distance
}
