//! Search for the convex or concave segment that holds the first impact
//! (docs/theory-impacts.md#t3.2).

use core::f32::consts::TAU;
use core::f64::consts::PI;

use super::flight::{
    Ballistic, GAP_ROUNDING, Gravity, Launch, RADIANS_PER_STEP, STEPS_PER_RADIAN, Track, abs,
    larger, newton_or_middle, node_of, root, smaller,
};
use super::settle::expand;
use super::short::{ShortFlight, hop, short_flight};
use super::sine_track::SineTrack;
use super::solve::{Bracket, Found, solve};
use crate::arithmetic::{Phase, sine_cosine_single};

/// The first impact of a flight that is not at rest, and whether it grazes a hump.
#[inline(always)]
pub(super) fn search(launch: &Launch, flight: &Ballistic<'_, SineTrack>) -> (Found, bool) {
    let first = short_flight(launch);
    let (mut guess, mut clears, mut skims) = (0.0, false, false);
    match first {
        ShortFlight::Hop { near, grazes } if near > 0.0 => {
            if near < SineTrack::MAX_SHORT_FLIGHT {
                let (flight, arrival) = hop(launch, near);
                return (Found::Short { flight, arrival }, grazes);
            }
            guess = near;
        }
        ShortFlight::Clears { grazes } => (clears, skims) = (true, grazes),
        _ => {}
    }
    let (bracket, grazes) = find_bracket(launch, flight, clears, guess);
    (solve(flight, &bracket), grazes || skims)
}

#[inline(always)]
fn find_bracket(
    launch: &Launch,
    flight: &Ballistic<'_, SineTrack>,
    clears: bool,
    guess: f32,
) -> (Bracket, bool) {
    let track = flight.track;
    let Gravity {
        k,
        half: half_k,
        inverse,
        ..
    } = track.gravity;
    let (lift_off_cosine, hump_length) = (track.lift_off_cosine, track.hump_length);
    let Launch { sine, pull, .. } = *launch;
    let v = launch.velocity + launch.cosine;
    if track.hump == 0 {
        // Concave throughout: one root, before the parabola leaves height -1.
        let high = (v + root(v * v + 2.0 * k * (1.0 + sine))) * inverse;
        let start = if guess > 0.0 && guess < high {
            guess
        } else {
            high
        };
        return (Bracket::new([0.0, high], start), false);
    }
    // Ballistic height over k, and slope over that of the track at a hump's begin.
    let over_k = |x: f32| x * (v - half_k * x) - pull;
    let over_flank = |x: f32| v - k * x - lift_off_cosine;
    // From the exact start of a hump the next one is a whole turn away.
    let lift_off = match track.lift_off.wrapping_sub(launch.phase) {
        0 => TAU,
        steps => steps as f32 * RADIANS_PER_STEP,
    };
    let at_entry = over_k(lift_off);
    if at_entry <= 0.0 && !clears {
        let low = if track.throws(launch.phase) {
            lift_off - (TAU - hump_length)
        } else {
            0.0
        };
        let start = if guess > 0.0 && guess < lift_off && guess < 1.2 {
            guess
        } else {
            let newton = lift_off - at_entry / over_flank(lift_off);
            if guess > 0.0 && guess < newton {
                0.5 * (guess + newton)
            } else {
                newton
            }
        };
        return (Bracket::new([low, lift_off], start), false);
    }
    // Time when the ball falls through height k.
    let through = (v + root(v * v - 2.0 * k * pull)) * inverse;
    // Whether the ball has fallen through height k; near that time its height decides.
    let falls = |time: f32| {
        if abs(time - through) < 1e-4 {
            over_k(time) <= 0.0
        } else {
            time > through
        }
    };
    let mut grazes = false;
    let mut begin = if clears { lift_off + TAU } else { lift_off };
    // A hump that ends below height 1 holds the root. So at most the humps at either end of the
    // window above height 1 are visited, which bounds the rounds.
    for _ in 0..16 {
        // Newton's step from the start of a hump does not overshoot on either side.
        let from_begin = || {
            let slope = over_flank(begin);
            let step = if slope < 0.0 {
                over_k(begin) / slope
            } else {
                0.0
            };
            begin - step
        };
        if falls(begin) {
            let ends = [smaller(through, begin) - 1e-4, begin];
            return (Bracket::new(ends, from_begin()), grazes);
        }
        let end = begin + hump_length;
        if falls(end) {
            let bracket = Bracket::new([begin, through + 1e-4], from_begin());
            return (bracket, grazes);
        }
        let half = 0.5 * hump_length;
        let middle = begin + half;
        let over_top = (sine - 1.0) + middle * (v - half_k * middle);
        let slope = v - k * middle;
        if over_top <= -1e-4 {
            return (Bracket::new([begin, middle], from_begin()), grazes);
        }
        // Within the hump `1 - cos x >= 4 x^2 / pi^2`, which keeps the track below a parabola.
        let margin = (4.0 / (PI * PI)) as f32 - half_k;
        let safe =
            margin > 0.0 && over_top > 1e-4 && 4.0 * margin * (over_top - 1e-4) > slope * slope;
        if !safe && slope + k * half < lift_off_cosine && slope - k * half > -lift_off_cosine {
            let (dip, touches) = find_minimum(flight, middle, over_top, slope);
            grazes |= touches;
            if let Some(mut bracket) = dip {
                bracket.low = begin;
                bracket.start = smaller(larger(bracket.start, begin), bracket.high);
                return (bracket, grazes);
            }
        }
        let mut turns = 1;
        if begin + hump_length < through - 3.0 * TAU {
            turns += count_passed_humps(track, v, sine, begin + TAU);
        }
        begin += turns as f32 * TAU;
    }
    (Bracket::new([lift_off, through], through), true)
}

/// Number of humps under a ball above height 1, from the one at `begin` to the last. The ball left
/// at `v` from a track with sine `sine`.
#[inline(never)]
fn count_passed_humps(track: &SineTrack, v: f32, sine: f32, begin: f32) -> i32 {
    let Gravity { k, inverse, .. } = track.gravity;
    let leaving = v * v - 2.0 * k * (1.0 - sine);
    let speed = root(leaving);
    let (rises, sinks) = ((v - speed) * inverse, (v + speed) * inverse);
    let last = begin + track.hump_length;
    if leaving > 0.0 && v > 0.0 && begin > rises && last < sinks {
        ((sinks - last) * (1.0 / TAU)) as i32
    } else {
        0
    }
}

/// Minimum of the gap over a hump around `middle`. Returns a bracket that ends there if the minimum
/// is below the track, and whether it is within rounding.
#[inline(never)]
fn find_minimum(
    flight: &Ballistic<'_, SineTrack>,
    middle: f32,
    over_top: f32,
    slope: f32,
) -> (Option<Bracket>, bool) {
    let track = flight.track;
    let half = 0.5 * track.hump_length;
    let k = track.gravity.k;
    let (mut low, mut high) = (-half, half);
    let mut d = smaller(larger(-slope / (1.0 - k), low), high);
    for round in 0..40 {
        // sin and cos of d: the track is cos(d) around the middle of its hump.
        let (s, c) = sine_cosine_single(Phase::from_bits((d * STEPS_PER_RADIAN) as i32 as u32));
        let rate = slope - k * d + s;
        let beyond = if rate > 0.0 {
            high = d;
            low
        } else {
            low = d;
            high
        };
        // The gap is convex: it lies above its tangent, from here to the hump's end beyond the
        // minimum. A third tangent costs more, over the orbits tried, than the rounds that it
        // saves.
        if round < 2 {
            let gap = over_top + d * (slope - track.gravity.half * d) + (1.0 - c);
            if gap + rate * (beyond - d) > 1e-3 + 1e-5 * middle {
                return (None, false);
            }
        }
        let newton = d - rate / (c - k);
        let next = newton_or_middle(newton, low, high);
        let moved = abs(next - d);
        d = next;
        if moved < 1e-6 {
            break;
        }
    }
    let time = middle + d;
    let (node, offset) = node_of(flight.phase, time);
    let local = flight.local(node);
    let (height, gain, b2) = expand(k, &local, offset);
    let rate = local.slope + gain;
    let curvature = b2 + b2;
    let lowest = height - 0.5 * rate * rate / curvature;
    let start = || time - root(-2.0 * lowest / curvature);
    let bracket = (lowest <= 0.0).then(|| Bracket::new([0.0, time], start()));
    let rounding = GAP_ROUNDING + SineTrack::GAP_ROUNDING_PER_RADIAN * time;
    (bracket, abs(lowest) < rounding)
}
