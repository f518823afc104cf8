//! The first impact of a flight on a track of several tones: the first root of the gap `u = y - S`.
//!
//! Lengths are in b, times in rad of the drive, velocities in `b w` and accelerations in `b w^2`: y
//! is the part's height, S the track's displacement, `A = -S''` its push, and k gravity. Input is a
//! launch: phase and velocity. The outputs are flight, phase and arrival speed, and whether the
//! impact grazes the track. `search` decides where the methods of this file find no certain root.
//!
//! Convexity isolates the root. The gap is convex on a hump, where the push A exceeds k, and
//! concave elsewhere. S at both ends of a hump is precomputed, without trigonometry. The earliest
//! hump that begins or ends with `u < 0` holds the impact, or the concave interval before it does.
//! The root there is the first one if the flight clears every earlier hump. The tangents at both
//! ends of a hump bound the gap from below. A flight above each height of the track on its fall
//! (tall), and a very short one, need no hump.
//!
//! The root is found by Householder's method of order 4 (Householder 1970). The fallback is
//! Cauchy's step, the root of the second-order Taylor polynomial (Traub 1964).

use core::f64::consts::TAU;

use super::launch::Launch;
use super::search;
use super::short;
use super::track::{Hump, Track};
use crate::arithmetic::vector::{Arc, Node, Vector, floor};
use crate::arithmetic::{node, square_root};
use crate::impact::double::low::{
    MAX_CONVERGENCE_RATIO, MAX_FLIGHT_FROM_LAUNCH, MIN_FLIGHT_TIME, ROUNDING_MARGIN,
};
use crate::impact::double::short::{MAX_SHORT_HOP, ends_within, quadratic_root};
use crate::impact::double::step::{Landing, householder, in_turn};
use crate::impact::wave::motion;

/// Arrival speed in `b w` below which the search decides: near a triple root the steps diverge.
const MIN_ARRIVAL_SPEED: f64 = 0.01;

/// Number of turns whose humps are visited one by one, after the turns above the track's reach.
/// `search` takes longer flights.
const MAX_TURNS: u32 = 8;

/// Largest step, in rad of the highest tone, after which the last step follows.
const MAX_LAST_APPROACH_STEP: f64 = 0.7;

/// Largest Newton step, in rad of the highest tone, that leaves an error below rounding.
const MAX_LAST_NEWTON_STEP: f64 = 2e-4;

const MAX_APPROACHES: u32 = 4;

/// The interval of the track that certainly holds the first impact, the one root of the gap in it.
struct Interval {
    /// First estimate of the root, in rad after launch.
    start: f64,
    /// Ends, in rad after launch.
    low: f64,
    high: f64,
}

/// The first impact after `launch`, and whether it grazes; `None` if the part rests.
#[inline(always)]
pub(super) fn first_impact<const N: usize>(
    track: &Track,
    launch: &Launch,
) -> Option<(Landing<f64>, bool)> {
    if launch.is_tall(track)
        && let Some(landing) = land_tall::<N>(track, launch)
    {
        return Some((landing, false));
    }
    // Passed as numbers: they stay in registers, so that tall flights are not delayed.
    let [sine, cosine] = launch.parts[0];
    land_not_tall::<N>(track, launch.phase, launch.velocity, sine, cosine)
}

/// [`first_impact`] of a flight that is not tall, or whose tall form is not certain.
#[inline(never)]
fn land_not_tall<const N: usize>(
    track: &Track,
    phase: f64,
    velocity: f64,
    sine: f64,
    cosine: f64,
) -> Option<(Landing<f64>, bool)> {
    let launch = &Launch::with_sine_cosine::<N>(track, phase, velocity, sine, cosine);
    if launch.rests(track) {
        return None;
    }
    let landing = if launch.is_tall(track) {
        None
    } else if ends_after_hop(track, launch, MAX_SHORT_HOP / N as f64) {
        short::landing::<N>(track, launch)
    } else {
        let interval = before_next_hump::<N>(track, launch);
        let interval = interval.or_else(|| between_humps::<N>(track, launch));
        interval.and_then(|interval| land_in_interval::<N>(track, launch, &interval))
    };
    match landing {
        Some(landing) => Some((landing, false)),
        None => Some(search::landing::<N>(track, launch)),
    }
}

/// Whether a flight that is not tall ends within about `longest` rad.
#[inline(always)]
fn ends_after_hop(track: &Track, launch: &Launch, longest: f64) -> bool {
    ends_within(launch.velocity, launch.pull(track), launch.at.jerk, longest)
}

/// Landing of a tall flight, the only contact on the ball's fall, if it is certain.
#[inline(always)]
fn land_tall<const N: usize>(track: &Track, launch: &Launch) -> Option<Landing<f64>> {
    let mut d = launch.falls_to(track, 0.0);
    for _ in 0..MAX_APPROACHES {
        let (_, next, _) = approach::<N>(track, launch, d);
        let near = (next - d).abs() < MAX_LAST_APPROACH_STEP / N as f64;
        d = next;
        if near {
            break;
        }
    }
    finish::<N>(track, launch, d, |d| d)
}

#[inline(always)]
fn land_in_interval<const N: usize>(
    track: &Track,
    launch: &Launch,
    interval: &Interval,
) -> Option<Landing<f64>> {
    let mut d = interval.start;
    let (mut below, mut above) = (interval.low, interval.high);
    for _ in 0..MAX_APPROACHES {
        let (node, next, before) = approach::<N>(track, launch, d);
        if before {
            below = below.max(node);
        } else {
            above = above.min(node);
        }
        let next = if below < next && next < above {
            next
        } else {
            (below + above) * 0.5
        };
        let near = (next - d).abs() < MAX_LAST_APPROACH_STEP / N as f64;
        d = next;
        if near {
            break;
        }
    }
    let landing = finish::<N>(track, launch, d, |d| d.max(interval.low).min(interval.high))?;
    (interval.low < landing.flight && landing.flight < interval.high).then_some(landing)
}

/// The landing near `d`, by up to three last steps, each from a time that `within` limits.
#[inline(always)]
fn finish<const N: usize>(
    track: &Track,
    launch: &Launch,
    d: f64,
    within: impl Fn(f64) -> f64,
) -> Option<Landing<f64>> {
    let (mut landing, mut settled) = take_householder_step::<N>(track, launch, d);
    for _ in 0..2 {
        if !settled {
            let next = within(landing.flight);
            (landing, settled) = take_householder_step::<N>(track, launch, next);
        }
    }
    landing.phase = in_turn(landing.phase);
    (settled && MIN_ARRIVAL_SPEED < landing.arrival).then_some(landing)
}

#[derive(Clone, Copy)]
struct HumpBegin<'a> {
    hump: &'a Hump,
    /// Time in rad after launch.
    time: f64,
    /// u and u' there.
    gap: f64,
    slope: f64,
}

impl<'a> HumpBegin<'a> {
    #[inline(always)]
    fn new(track: &Track, launch: &Launch, hump: &'a Hump, time: f64) -> Self {
        Self {
            hump,
            time,
            gap: launch.height(track, time) - hump.begin.height,
            slope: (launch.rise() - track.k * time) - hump.begin.speed,
        }
    }

    /// The interval `low..high`; its first estimate is one step of Householder's method from here.
    #[inline(always)]
    fn find_interval<const N: usize>(
        &self,
        track: &Track,
        launch: &Launch,
        low: f64,
        high: f64,
    ) -> Interval {
        let start = if ends_after_hop(track, launch, MAX_FLIGHT_FROM_LAUNCH / N as f64) {
            quadratic_root(launch.velocity, launch.pull(track), launch.at.jerk)
        } else {
            // Here u'' is 0.
            let begin = &self.hump.begin;
            self.time - householder(self.gap, self.slope, 0.0, begin.jerk, -begin.snap)
        };
        let low = low.max(MIN_FLIGHT_TIME / N as f64);
        Interval {
            start: start.max(low).min(high),
            low,
            high,
        }
    }
}

/// The interval before the next hump, if the ball is below the track at that hump's begin.
#[inline(always)]
fn before_next_hump<const N: usize>(track: &Track, launch: &Launch) -> Option<Interval> {
    let (first, others) = track.humps().split_first()?;
    let mut next = (launch.ahead(first.begin.phase), first);
    for hump in others {
        let time = launch.ahead(hump.begin.phase);
        if time < next.0 {
            next = (time, hump);
        }
    }
    let (time, hump) = next;
    let next = HumpBegin::new(track, launch, hump, time);
    (next.gap < -launch.margin(track))
        .then(|| next.find_interval::<N>(track, launch, time - hump.before, time))
}

/// The interval, from the signs of the gap at both ends of each hump; `None` without certainty.
#[inline(always)]
fn between_humps<const N: usize>(track: &Track, launch: &Launch) -> Option<Interval> {
    if track.humps().is_empty() {
        // Concave throughout, down to the track's lowest reach.
        return Some(Interval {
            start: launch.falls_to(track, 0.0),
            low: 0.0,
            high: launch.falls_to(track, -track.wave.bottom) + 1e-9,
        });
    }
    let (k, v) = (track.k, launch.rise());
    let margin = launch.margin(track);
    // The hump before whose end the impact certainly is, and the interval of the impact.
    let (mut hit, mut low, mut high) = (None, 0.0, f64::MAX);
    let mut first_uncertain = f64::MAX;
    let mut turns = 0.0;
    for round in 0..MAX_TURNS {
        for hump in track.humps() {
            let begin = launch.ahead(hump.begin.phase) + turns;
            let end = begin + hump.width;
            let at_begin = HumpBegin::new(track, launch, hump, begin);
            let gap_end = launch.height(track, end) - hump.end.height;
            let slope_end = (v - k * end) - hump.end.speed;
            let lands_before = at_begin.gap < -margin;
            let above = margin < at_begin.gap;
            let mut lands_on = above && gap_end < -margin;
            let mut last = if lands_before { begin } else { end };
            let ends = [[at_begin.gap, at_begin.slope], [gap_end, slope_end]];
            let mut passed =
                above && margin < gap_end && is_clear(margin, ends[0], ends[1], hump.width);
            if above && margin < gap_end && !passed && begin < high {
                let (lowest, touches, clears) =
                    minimum_on_hump::<N>(track, launch, begin, hump.width, ends, margin);
                if touches {
                    last = lowest;
                }
                (lands_on, passed) = (touches, clears);
            }
            if !(lands_before || lands_on || passed) {
                first_uncertain = first_uncertain.min(begin);
            }
            if (lands_before || lands_on) && last < high {
                low = if lands_before {
                    begin - hump.before
                } else {
                    begin
                };
                (hit, high) = (Some(at_begin), last);
            }
        }
        if high < f64::MAX {
            break;
        }
        turns += TAU;
        if round == 0 {
            // No hump meets the part while it is above the track's highest point. Two turns cover
            // the rounding and the first hump.
            let square = launch.speed_at(track, track.wave.top) - ROUNDING_MARGIN;
            let leaving = square_root(square.max(0.0));
            let above_to = ((v + leaving) * track.per_k * (1.0 - 1e-12)).min(1e12);
            let last = floor(above_to * (1.0 / TAU)) - 2.0;
            let rises = (v - leaving) * track.per_k < TAU;
            if rises && 0.0 < v && 0.0 < leaving && 1.0 < last {
                turns = last * TAU;
            }
        }
    }
    hit.filter(|_| high < first_uncertain)
        .map(|hump| hump.find_interval::<N>(track, launch, low, high))
}

/// Whether a convex gap is certainly above `margin`, by value and slope at both ends. Both values
/// are above it. The gap lies above its tangents there, which meet at the height `cross/(dthen -
/// du)`.
#[inline(always)]
fn is_clear(margin: f64, [u, du]: [f64; 2], [then, dthen]: [f64; 2], width: f64) -> bool {
    let cross = u * dthen - du * then + du * dthen * width;
    du >= 0.0 || dthen <= 0.0 || margin * (dthen - du) < cross
}

/// Minimum of the gap over a hump whose ends are above the track. Returns the approximate time in
/// rad after launch, and whether the gap there is below 0. The last value: whether the gap is
/// certainly above 0 over the whole hump. `ends` holds value and slope of the gap at both ends.
#[inline(always)]
fn minimum_on_hump<const N: usize>(
    track: &Track,
    launch: &Launch,
    begin: f64,
    width: f64,
    ends: [[f64; 2]; 2],
    margin: f64,
) -> (f64, bool, bool) {
    // Nodes nearer to an end may lie beyond it.
    let inset = node::SPACING;
    let end = begin + width;
    let [[_, slope], [_, slope_end]] = ends;
    let mut d = begin - slope * width / (slope_end - slope);
    let (mut lowest, mut at_lowest) = (begin, ends[0]);
    for _ in 0..2 {
        let node = Node::near(launch.phase, d.max(begin + inset).min(end - inset));
        let motion = motion::<N>(&track.wave.parts::<N>(node.sine, node.cosine));
        let speed = (launch.rise() - track.k * node.distance) - motion.speed;
        lowest = node.distance;
        at_lowest = [launch.height(track, node.distance) - motion.height, speed];
        d = node.distance - speed / (motion.push - track.k);
    }
    let inside = begin < lowest && lowest < end;
    let clears = margin < at_lowest[0]
        && is_clear(margin, ends[0], at_lowest, lowest - begin)
        && is_clear(margin, at_lowest, ends[1], end - lowest);
    (lowest, inside && at_lowest[0] < -margin, inside && clears)
}

/// Time of the node next to `d`, a time closer to the impact, and whether the gap at the node is
/// positive. The step is Householder's of order 4 within [`MAX_CONVERGENCE_RATIO`], else Cauchy's
/// to the down-crossing.
#[inline(always)]
fn approach<const N: usize>(track: &Track, launch: &Launch, d: f64) -> (f64, f64, bool) {
    let node = Node::near(launch.phase, d);
    let at = motion::<N>(&track.wave.parts::<N>(node.sine, node.cosine));
    let gap = launch.height(track, node.distance) - at.height;
    let slope = (launch.rise() - track.k * node.distance) - at.speed;
    let curvature = at.push - track.k;
    let product = gap * curvature;
    let step = if slope < 0.0 && product.abs() < MAX_CONVERGENCE_RATIO * (slope * slope) {
        -householder(gap, slope, curvature, at.jerk, -at.snap)
    } else {
        let root = square_root((slope * slope - 2.0 * product).max(0.0));
        if slope > 0.0 {
            -(slope + root) / curvature
        } else {
            (gap + gap) / (root - slope)
        }
    };
    (node.distance, node.distance + step, 0.0 < gap)
}

/// The last step, by Householder's method of order 4. The flag marks steps so short that the
/// remaining error is below rounding. The phase may be a rounding error below zero.
#[inline(always)]
fn take_householder_step<const N: usize>(
    track: &Track,
    launch: &Launch,
    d: f64,
) -> (Landing<f64>, bool) {
    let node = Node::near(launch.phase, d);
    let x = d - node.distance;
    let arc = Arc::new(x);
    let sine = node.sine + (node.cosine * arc.sine - node.sine * arc.versine);
    let cosine = node.cosine - (node.sine * arc.sine + node.cosine * arc.versine);
    let at = motion::<N>(&track.wave.parts::<N>(sine, cosine));
    let speed = launch.rise() - track.k * node.distance;
    let height = launch.height(track, node.distance);
    let value = (height - at.height) + x * (speed - 0.5 * track.k * x);
    let slope = (speed - track.k * x) - at.speed;
    let curvature = at.push - track.k;
    let step = householder(value, slope, curvature, at.jerk, -at.snap);
    let third = (at.jerk + step * (at.snap * (1.0 / 3.0))) * 0.5;
    let arrival = step * (curvature - step * third) - slope;
    let square = slope * slope;
    let near = MAX_LAST_NEWTON_STEP / N as f64;
    // A Newton step below `near`, and a ratio `|u u''|/u'^2` below twice that.
    let settled =
        value * value < near * near * square && (value * curvature).abs() < 2.0 * near * square;
    let (phase_high, phase_low) = f64::within_turn(node.rounded);
    let landing = Landing {
        flight: node.distance + (x - step),
        phase: phase_high + (phase_low + (x - step)),
        arrival,
    };
    (landing, settled)
}
