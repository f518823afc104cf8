//! The first impact on a track of several tones: the interval that holds it, and its root.

use core::f32::consts::TAU;

use super::launch::{DeflatedGap, Launch};
use super::track::{Edge, Hump, Limits, Track};
use crate::impact::anchor::approach::{approach, householder};
use crate::impact::anchor::candidate::{
    Candidate, MAX_NEGATIVE_DISCRIMINANT, MIN_FALL_SPEED_SQUARED,
};
use crate::impact::anchor::flight::{
    Ballistic, GAP_ROUNDING, Local, RADIANS_PER_STEP, Track as _, abs, larger, newton_or_middle,
    node_from_near, node_of, root, smaller,
};
use crate::impact::anchor::settle::{down_crossing, expand};
use crate::impact::anchor::short::{MAX_LAST_STEP_RATIO, quotient_step};
use crate::impact::anchor::solve::{Bracket, Found, solve};

/// Flight time in rad up to which the omitted terms of the divided form are below rounding.
#[inline(always)]
fn max_short_flight(track: &Track) -> f32 {
    if track.tones.is_of_three {
        Track::MAX_SHORT_FLIGHT * (2.0 / 3.0)
    } else {
        Track::MAX_SHORT_FLIGHT
    }
}

/// Rounding of a height in f32, in b: constant part, and part per rad of flight.
const HEIGHT_ROUNDING: f32 = 3e-5;
const HEIGHT_ROUNDING_PER_RADIAN: f32 = 4e-6;

/// Half the pull in `b w^2` below which a step of the phase decides whether the track throws.
const MAX_LEVEL_HALF_PULL: f32 = 1e-7;

/// Longest flight time in rad from the quadratic near launch; beyond it later turns dominate.
const MAX_START_FROM_LAUNCH: f32 = 2.0;

/// First guess in rad for a part that the track throws and whose parabola soon falls through
/// height 0. The track has sunk by then, so the part meets it later.
const FIRST_GUESS_AFTER_THROW: f32 = 2.0;

/// Smallest time in rad from launch to a hump that is passed; earlier heights lose digits.
const MIN_TIME_TO_HUMP: f32 = 0.2;

/// Flight time in rad up to which the quadratic near launch gives the start.
const MAX_FLIGHT_FROM_LAUNCH: f32 = 0.6;

/// A candidate from the flight near launch or from the fall of the parabola, with its limits.
#[inline(always)]
pub(super) fn candidate(track: &Track, launch: &Launch) -> Option<(Candidate, Limits)> {
    let (phase, height, rise) = (launch.phase, launch.height, launch.rise);
    let mut limits = track.limits(phase, rise)?;
    let a1 = 0.5 * launch.pull;
    let a2 = launch.jerk * (1.0 / 6.0);
    let square = a1 * a1;
    let discriminant = square - 4.0 * a2 * launch.velocity;
    let mut near = MAX_START_FROM_LAUNCH;
    if a1 > 0.0 && discriminant > -MAX_NEGATIVE_DISCRIMINANT * square {
        near = 2.0 * launch.velocity / (a1 + root(discriminant));
    } else if a1 <= 0.0 && a2 < 0.0 {
        near = (a1 - root(discriminant)) / (a2 + a2);
    }
    if near < MAX_START_FROM_LAUNCH {
        let short = max_short_flight(track);
        if near < short {
            if a1 < MAX_LEVEL_HALF_PULL {
                return None;
            }
            limits.first = 0;
            let (flight, arrival) = simple_hop(launch, near, short)?;
            return Some((Candidate::Hop { flight, arrival }, limits));
        }
        let (node, offset) = node_from_near(phase, near);
        let dt = near - offset;
        if let Some(approach) = approach(track, node, dt, -rise, height)
            && approach.preserves_distance(node, dt)
        {
            return Some((Candidate::Near(approach), limits));
        }
    }
    let square = rise * rise + 2.0 * track.gravity.k * height;
    if square <= MIN_FALL_SPEED_SQUARED {
        return None;
    }
    let speed = root(square);
    let origin = rise + speed;
    if origin <= 0.0 {
        return None;
    }
    let (near, start, speed, base) =
        if a1 <= 0.0 && origin < FIRST_GUESS_AFTER_THROW * track.gravity.k {
            (FIRST_GUESS_AFTER_THROW, 0.0, -rise, height)
        } else {
            let fall = origin * track.gravity.inverse;
            (fall, fall, speed, 0.0)
        };
    let (node, offset) = node_from_near(phase, near);
    let dt = (near - start) - offset;
    let approach = approach(track, node, dt, speed, base)?;
    approach
        .preserves_distance(node, dt)
        .then_some((Candidate::Near(approach), limits))
}

impl Limits {
    /// Whether a down-crossing `steps` after launch is the first impact.
    #[inline(always)]
    pub fn contain(&self, track: &Track, launch: &Launch, steps: i64) -> bool {
        self.first <= steps && (steps <= self.last || self.contain_beyond(track, launch, steps))
    }

    /// The same beyond the hump of [`Track::limits`].
    #[inline(never)]
    fn contain_beyond(&self, track: &Track, launch: &Launch, steps: i64) -> bool {
        let limit = track.limit_from_above(launch.phase, launch.height, launch.rise, self.clear);
        limit.is_some_and(|last| steps <= last) || clears(track, launch, steps)
    }
}

/// Number of humps passed before the search takes over.
const MAX_PASSED_HUMPS: usize = 6;

/// Whether a flight clears every hump but the last before `steps`, by more than the rounding of
/// f32. Over a hump the gap is convex, above its tangents at both ends.
fn clears(track: &Track, launch: &Launch, steps: i64) -> bool {
    let (phase, height, rise) = (launch.phase, launch.height, launch.rise);
    let humps = track.humps();
    let wait = |hump: &Hump| hump.phase.wrapping_sub(phase).wrapping_sub(1);
    let Some((mut index, _)) = humps.iter().enumerate().min_by_key(|(_, hump)| wait(hump)) else {
        return false;
    };
    let mut remaining = humps.len();
    let (mut turns, mut turn) = (0.0, 0_i64);
    for _ in 0..MAX_PASSED_HUMPS {
        let Some(hump) = humps.get(index) else { break };
        let begin = wait(hump) as f32 * RADIANS_PER_STEP + turns;
        let end = begin + hump.width;
        let over = |x: f32, edge: &Edge| {
            let fall = track.gravity.k * x;
            let height = x * (rise - 0.5 * fall) + (height - edge.height);
            (height, rise - fall - edge.speed)
        };
        let noise = HEIGHT_ROUNDING + HEIGHT_ROUNDING_PER_RADIAN * end;
        let ((over_begin, falls), (over_end, rises)) =
            (over(begin, &hump.begin), over(end, &hump.end));
        if !(begin > MIN_TIME_TO_HUMP && over_begin > noise && over_end > noise) {
            return false;
        }
        if falls < 0.0 && rises > 0.0 {
            let tangent_height = over_begin * rises + falls * (rises * hump.width - over_end);
            if tangent_height <= noise * (rises - falls) {
                return false;
            }
        }
        index += 1;
        if index == humps.len() {
            index = 0;
        }
        remaining -= 1;
        if remaining == 0 {
            remaining = humps.len();
            turns += TAU;
            turn += 1 << 32;
        }
        let Some(hump) = humps.get(index) else { break };
        if steps <= turn + i64::from(wait(hump)) + i64::from(hump.length) {
            return true;
        }
    }
    false
}

/// The first impact of a flight that is not at rest, and whether it grazes a hump.
#[inline(always)]
pub(super) fn search(launch: &Launch, flight: &Ballistic<'_, Track>) -> (Found, bool, Bracket) {
    let (mut bracket, grazes) = find_bracket(launch, flight);
    let short = max_short_flight(flight.track);
    if bracket.low < short {
        let high = smaller(bracket.high, short);
        if launch.deflated_gap(high).value <= 0.0 {
            let (flight, arrival) = hop(launch, bracket.low, high, bracket.start);
            return (Found::Short { flight, arrival }, grazes, bracket);
        }
        bracket.low = high;
        bracket.start = larger(bracket.start, high);
    }
    (solve(flight, &bracket), grazes, bracket)
}

/// Whether an arrival at `speed` may lie outside its bracket. If the gap is nearly flat, a step can
/// lead anywhere, even back to launch.
#[inline(always)]
pub(super) fn may_leave(bracket: &Bracket, steps: i64, speed: f32) -> bool {
    const BRACKET_ROUNDING: f32 = 1e-3;
    if speed > 0.02 {
        return false;
    }
    let time = steps as f32 * RADIANS_PER_STEP;
    time < bracket.low - BRACKET_ROUNDING
        || time > bracket.high + BRACKET_ROUNDING
        || time < 0.5 * bracket.low
}

/// The root in a bracket by bisection alone: time in rad and arrival speed, in f32.
#[inline(never)]
pub(super) fn bisect(
    launch: &Launch,
    flight: &Ballistic<'_, Track>,
    bracket: &Bracket,
) -> (f32, f32) {
    let edges = Edges::new(launch, flight);
    let (mut low, mut high) = (bracket.low, bracket.high);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let (height, slope, half) = edges.at(middle);
        // On a concave rise even a height rounded below 0 is before the root.
        if height > 0.0 || (half < 0.0 && slope > 0.0) {
            low = middle;
        } else {
            high = middle;
        }
    }
    (high, larger(-edges.at(high).1, 0.0))
}

/// The interval between edges that holds the first impact, and whether the flight grazes before.
/// The interval holds one root of the gap. Between humps the gap is concave and starts positive, or
/// at launch at 0 without falling. It has one root if it is below 0 at the end. Over a hump the gap
/// is convex. If it is below 0 at the end it has one root, else none or two around its minimum.
#[inline(always)]
fn find_bracket(launch: &Launch, flight: &Ballistic<'_, Track>) -> (Bracket, bool) {
    let track = flight.track;
    let (phase, height, rise) = (launch.phase, launch.height, launch.rise);
    let humps = track.humps();
    let (mut next, mut shortest_wait, mut low) = (0, u32::MAX, 0.0);
    for (n, hump) in humps.iter().enumerate() {
        // From the exact start of a hump the next one is a whole turn away.
        let wait = hump.phase.wrapping_sub(phase).wrapping_sub(1);
        if wait <= shortest_wait {
            (next, shortest_wait) = (n, wait);
        }
        let elapsed = phase.wrapping_sub(hump.phase);
        if elapsed < hump.length {
            low = (hump.length - elapsed) as f32 * RADIANS_PER_STEP;
        }
    }
    let edges = Edges::new(launch, flight);
    // While the ball is above the track's reach no hump meets it.
    let (from, to) = track.time_above_reach(height, rise);
    let mut grazes = false;
    let mut turn = 0_u32;
    while !humps.is_empty() && turn < 1 << 20 {
        for n in 0..humps.len() {
            let mut index = next + n;
            if index >= humps.len() {
                index -= humps.len();
            }
            let Some(hump) = humps.get(index) else {
                break;
            };
            let wait = hump.phase.wrapping_sub(phase).wrapping_sub(1);
            let begin = wait as f32 * RADIANS_PER_STEP + turn as f32 * TAU;
            let end = begin + hump.width;
            if from <= begin && end <= to {
                low = end;
                continue;
            }
            let over_begin = edges.gap(begin, &hump.begin);
            let over_end = || edges.gap(end, &hump.end);
            // A launch one step before the hump counts as at its start.
            if over_begin.height <= 0.0 && begin > 0.0 {
                // The start may be below the track by rounding alone.
                grazes |= over_begin.height > -edges.rounding(begin)
                    && edges.is_level(begin, end, over_begin, over_end());
                return (concave(launch, low, begin, over_begin, hump), grazes);
            }
            let over_end = over_end();
            if over_end.height <= 0.0 {
                grazes |= over_end.slope > 0.0
                    && over_end.height > -edges.rounding(end)
                    && edges.is_level(begin, end, over_begin, over_end);
                let start = smaller(from_edge(begin, over_begin, &hump.begin), end);
                return (Bracket::new([begin, end], start), grazes);
            }
            if over_begin.slope < 0.0 && over_end.slope > 0.0 {
                // Height at which both ends' tangents meet, times the difference of slopes.
                let turning = over_end.slope - over_begin.slope;
                let tangent_height = over_begin.height * over_end.slope
                    + over_begin.slope * (over_end.slope * hump.width - over_end.height);
                let noise = if end < edges.short {
                    0.0
                } else {
                    HEIGHT_ROUNDING + HEIGHT_ROUNDING_PER_RADIAN * end
                };
                if tangent_height <= noise * turning {
                    let (dip, touches) = edges.find_minimum(begin, end, over_begin.slope / turning);
                    grazes |= touches;
                    if let Some(bracket) = dip {
                        return (bracket, grazes);
                    }
                }
            }
            low = end;
        }
        turn += 1;
        if turn == 1 && from <= TAU {
            // Every hump that begins before this turn ends within a turn after it.
            let last = (to * (1.0 / TAU)) as i32 - 1;
            if last > 1 {
                turn = last as u32;
                low = larger(low, last as f32 * TAU);
            }
        }
    }
    // Concave throughout: one root, before the ball has fallen below the track.
    let high = track.fall_time(height, rise) + 1e-3;
    let start = near_launch(launch).unwrap_or(high);
    (Bracket::new([low, high], smaller(start, high)), grazes)
}

/// A root of the quadratic near launch, where that is accurate.
#[inline(always)]
fn near_launch(launch: &Launch) -> Option<f32> {
    let a1 = 0.5 * launch.pull;
    let a2 = launch.jerk * (1.0 / 6.0);
    let square = a1 * a1 - 4.0 * a2 * launch.velocity;
    if !(a1 > 0.0 && square >= 0.0) {
        return None;
    }
    let near = 2.0 * launch.velocity / (a1 + root(square));
    (near < MAX_FLIGHT_FROM_LAUNCH).then_some(near)
}

/// The concave interval before `hump`; the gap is below 0 at the hump's begin.
#[inline(always)]
fn concave(launch: &Launch, low: f32, begin: f32, gap: Gap, hump: &Hump) -> Bracket {
    let near = (low == 0.0).then(|| near_launch(launch)).flatten();
    let start = near.unwrap_or_else(|| from_edge(begin, gap, &hump.begin));
    Bracket::new([low, begin], smaller(larger(start, low), begin))
}

/// A step of Householder's method of order 3 from an edge, where u'' is 0.
#[inline(always)]
fn from_edge(time: f32, gap: Gap, edge: &Edge) -> f32 {
    let Gap { height, slope } = gap;
    if slope < 0.0 {
        time + householder(height, slope, slope * slope, 0.0, edge.jerk)
    } else {
        time
    }
}

#[derive(Clone, Copy)]
struct Gap {
    height: f32,
    slope: f32,
}

struct Edges<'a> {
    launch: &'a Launch,
    flight: &'a Ballistic<'a, Track>,
    short: f32,
}

impl<'a> Edges<'a> {
    #[inline(always)]
    fn new(launch: &'a Launch, flight: &'a Ballistic<'a, Track>) -> Self {
        Self {
            launch,
            flight,
            short: max_short_flight(flight.track),
        }
    }

    /// The gap at an edge `x` rad after launch.
    #[inline(always)]
    fn gap(&self, x: f32, edge: &Edge) -> Gap {
        let (track, launch) = (self.flight.track, self.launch);
        if x < self.short {
            let DeflatedGap { value, slope, .. } = launch.deflated_gap(x);
            return Gap {
                height: x * value,
                slope: value + x * slope,
            };
        }
        let fall = track.gravity.k * x;
        Gap {
            height: x * (launch.rise - 0.5 * fall) + (launch.height - edge.height),
            slope: launch.rise - fall - edge.speed,
        }
    }

    /// Minimum of the gap over a hump, with a start at a share of it. Returns a bracket that ends
    /// there if the minimum is below the track, and whether it is within rounding.
    #[inline(never)]
    fn find_minimum(&self, begin: f32, end: f32, share: f32) -> (Option<Bracket>, bool) {
        let (mut low, mut high) = (begin, end);
        let mut x = begin - share * (end - begin);
        for _ in 0..40 {
            let (slope, half) = self.slope(x);
            if slope > 0.0 {
                high = x;
            } else {
                low = x;
            }
            let newton = x - slope / (half + half);
            let next = newton_or_middle(newton, low, high);
            let moved = abs(next - x);
            x = next;
            // The slope gives the gap there, to the cube of the remaining distance.
            if moved <= smaller(1e-3, 1e-2 * x) {
                break;
            }
        }
        let (height, slope, half) = self.at(x);
        let to_minimum = if half > 0.0 {
            slope / (half + half)
        } else {
            0.0
        };
        let lowest = height - 0.5 * slope * to_minimum;
        let bracket = (lowest <= 0.0).then(|| {
            let to_root = if half > 0.0 {
                root(-lowest / half)
            } else {
                0.0
            };
            Bracket::new([begin, x], larger(x - to_root, begin))
        });
        (bracket, abs(lowest) < self.rounding(x))
    }

    /// Whether the gap over the hump, below 0 at one end, is below 0 by its rounding at most.
    #[inline(never)]
    fn is_level(&self, begin: f32, end: f32, over_begin: Gap, over_end: Gap) -> bool {
        if over_begin.slope >= 0.0 {
            over_begin.height > -self.rounding(begin)
        } else if over_end.slope <= 0.0 {
            over_end.height > -self.rounding(end)
        } else {
            let share = over_begin.slope / (over_end.slope - over_begin.slope);
            self.find_minimum(begin, end, share).1
        }
    }

    fn rounding(&self, x: f32) -> f32 {
        if x >= self.short {
            return GAP_ROUNDING + Track::GAP_ROUNDING_PER_RADIAN * x;
        }
        // Some roundings of f32 and of the pull: per tone if the pull is a sum in f32.
        let pull = if self.launch.has_fixed_point_pull() {
            Track::PULL_ROUNDING
        } else {
            larger(
                Track::PULL_ROUNDING,
                6e-8 * self.flight.track.tones.bound(2),
            )
        };
        x * (4e-7 * self.launch.velocity + pull * x)
    }

    /// The slope of the gap and half its curvature after `x`, in f32.
    #[inline(always)]
    fn slope(&self, x: f32) -> (f32, f32) {
        if x < self.short {
            let (_, slope, half) = self.at(x);
            return (slope, half);
        }
        let (track, launch) = (self.flight.track, self.launch);
        let (node, offset) = node_of(launch.phase, x);
        let at = track.at(node);
        let local = Local {
            height: 0.0,
            slope: launch.rise - track.gravity.k * (x - offset) - at.speed,
            push: at.push,
            jerk: at.jerk,
            snap: at.snap,
        };
        let (_, gain, half) = expand(track.gravity.k, &local, offset);
        (local.slope + gain, half)
    }

    /// The gap, its slope and half its curvature after `x`.
    fn at(&self, x: f32) -> (f32, f32, f32) {
        if x < self.short {
            let q = self.launch.deflated_gap(x);
            return (
                x * q.value,
                q.value + x * q.slope,
                q.slope + x * q.half_curvature,
            );
        }
        let (node, offset) = node_of(self.launch.phase, x);
        let local = self.flight.local(node);
        let (height, gain, half) = expand(self.flight.track.gravity.k, &local, offset);
        (height, local.slope + gain, half)
    }
}

/// The short hop near `x` and below `short`, by third-order steps on `u/d`, if the root is simple.
#[inline(always)]
fn simple_hop(launch: &Launch, mut x: f32, short: f32) -> Option<(f32, f32)> {
    for _ in 0..4 {
        let q = launch.deflated_gap(x);
        let e = quotient_step(q.value, q.slope, q.half_curvature)?;
        let last = abs(e) <= MAX_LAST_STEP_RATIO * x;
        x += e;
        if !(x > 0.0 && x < short) {
            return None;
        }
        if last {
            let arrival = -x * (q.slope + 2.0 * q.half_curvature * e);
            return (arrival > 0.0).then_some((x, arrival));
        }
    }
    None
}

/// The short hop that ends between `low` and `high`: third-order steps on `u/d`.
#[inline(never)]
fn hop(launch: &Launch, mut low: f32, mut high: f32, start: f32) -> (f32, f32) {
    let mut x = if start > low && start <= high {
        start
    } else {
        0.5 * (low + high)
    };
    let mut round = 0;
    loop {
        let q = launch.deflated_gap(x);
        let (slope, half) = (q.slope, q.half_curvature);
        if q.value > 0.0 {
            low = x;
        } else {
            high = x;
        }
        let mut e = quotient_step(q.value, slope, half)
            .unwrap_or_else(|| down_crossing(q.value, slope, half).0);
        round += 1;
        // Rounding may move the root to an end.
        let inside = x + e >= low && x + e <= high || abs(e) <= 1e-6 * x;
        if !inside {
            e = 0.5 * (low + high) - x;
        }
        if inside && abs(e) <= MAX_LAST_STEP_RATIO * x || round >= 60 {
            let flight = x + e;
            return (flight, larger(-flight * (slope + 2.0 * half * e), 0.0));
        }
        x += e;
    }
}
