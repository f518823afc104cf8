//! Short hops in f32: the root of the height over the flight time (deflation of that at launch).
//!
//! The steps are Chebyshev's, or Cauchy's near a double root (Traub 1964).

use super::flight::{Launch, Track, abs, larger, root, smaller};
use super::settle::down_crossing;
use super::sine_track::SineTrack;

/// `w = u / d` of a short flight and its derivative, in forms that keep every digit.
#[inline(always)]
fn deflated(launch: &Launch, x: f32) -> (f32, f32) {
    let (sine, cosine) = (launch.sine, launch.cosine);
    let z = x * x;
    let q3 = 1.0 / 6.0 - z * (1.0 / 120.0 - z * (1.0 / 5040.0));
    let q4 = 1.0 / 24.0 - z * (1.0 / 720.0);
    let half = 0.5 * launch.pull;
    (
        launch.velocity - x * (half - cosine * x * q3 + sine * z * q4),
        cosine * x * (1.0 / 3.0 - z * (1.0 / 30.0))
            - half
            - sine * z * (1.0 / 8.0 - z * (1.0 / 144.0)),
    )
}

/// Share of `a1^2`: discriminant below which the minimum of `u/d` separates two short roots.
pub(super) const MAX_DOUBLE_ROOT_DISCRIMINANT: f32 = 0.2;

/// Latest time in rad of the minimum between two short roots; beyond it heights keep enough digits.
const MAX_VALLEY_TIME: f32 = 0.08;

/// Rounding of `u/d` per `b w` of velocity: some 3 roundings of f32, 1.2e-7 each.
const QUOTIENT_ROUNDING: f32 = 4e-7;

/// Largest ratio of `w b2` to `w1^2` at which a third-order step converges. It leaves that ratio
/// squared, 1e-4 of the step.
const MAX_QUOTIENT_CURVATURE_RATIO: f32 = 1e-2;

/// Largest ratio of the last third-order step to the flight. It leaves its cube, an f32's rounding.
pub(super) const MAX_LAST_STEP_RATIO: f32 = 4e-3;

/// Result of the cubic near launch.
pub(super) enum ShortFlight {
    Open,
    /// The first impact is `near` this flight time, to the accuracy of the cubic. `grazes`: the
    /// flight clears the coming hump except for rounding.
    Hop {
        near: f32,
        grazes: bool,
    },
    /// The flight clears the coming hump; `grazes`: by rounding alone.
    Clears {
        grazes: bool,
    },
}

#[inline(always)]
pub(super) fn short_flight(launch: &Launch) -> ShortFlight {
    if is_flat(launch) {
        return flat_hop(*launch);
    }
    // u/d = psi - a1 d + a2 d^2 - ...
    let a1 = 0.5 * launch.pull;
    let a2 = launch.cosine * (1.0 / 6.0);
    if a1 <= 0.0 && a2 >= 0.0 {
        return ShortFlight::Open;
    }
    let discriminant = a1 * a1 - 4.0 * a2 * launch.velocity;
    let near = if a1 > 0.0 {
        if a2 > 0.0 && discriminant < MAX_DOUBLE_ROOT_DISCRIMINANT * a1 * a1 {
            return double_hop(*launch, a1, a2);
        }
        2.0 * launch.velocity / (a1 + root(discriminant))
    } else if discriminant >= 0.0 {
        (a1 - root(discriminant)) / (2.0 * a2)
    } else {
        return ShortFlight::Open;
    };
    let grazes = false;
    ShortFlight::Hop { near, grazes }
}

/// The first root below `limit` of `u/d` where its cubic term decides.
#[inline(never)]
fn flat_hop(launch: Launch) -> ShortFlight {
    let limit = SineTrack::MAX_SHORT_FLIGHT;
    let a1 = 0.5 * launch.pull;
    let a2 = launch.cosine * (1.0 / 6.0);
    let a3 = launch.sine * (1.0 / 24.0);
    let square = a2 * a2 - 3.0 * a1 * a3;
    let valley = if a2 > 0.0 && square > 0.0 {
        a1 / (a2 + root(square))
    } else {
        (a2 - root(square)) / (3.0 * a3)
    };
    // Newton's steps do not overshoot from launch down a convex slope to the minimum, or to the
    // inflection. Nor do they from the right of the last root.
    let lowest = if valley > 0.0 {
        deflated(&launch, smaller(valley, limit)).0
    } else {
        1.0
    };
    let grazes =
        abs(lowest) < SineTrack::PULL_ROUNDING * valley + QUOTIENT_ROUNDING * launch.velocity;
    let mut x = if lowest <= 0.0 {
        0.0
    } else if deflated(&launch, limit).0 <= 0.0 {
        limit
    } else if launch.pull > 0.0 && launch.cosine > 0.0 {
        return ShortFlight::Clears { grazes };
    } else {
        return ShortFlight::Open;
    };
    // They converge monotonically; near a double root each step halves the distance.
    for _ in 0..40 {
        let (w, w1) = deflated(&launch, x);
        if w1 >= 0.0 {
            break;
        }
        let next = x - w / w1;
        if !(next > 0.0 && next < limit) {
            break;
        }
        let moved = abs(next - x);
        x = next;
        // The short-hop steps converge from here.
        if moved < 1e-3 * x {
            break;
        }
    }
    ShortFlight::Hop { near: x, grazes }
}

/// Two nearly equal short roots, separated by the minimum of `u/d`.
#[inline(never)]
fn double_hop(launch: Launch, a1: f32, a2: f32) -> ShortFlight {
    let mut x = a1 / (2.0 * a2);
    if x > MAX_VALLEY_TIME {
        return ShortFlight::Open;
    }
    let (mut minimum, mut b2) = (0.0, 1.0);
    for _ in 0..4 {
        let (w, w1) = deflated(&launch, x);
        b2 = a2 - launch.sine * (1.0 / 8.0) * x - launch.cosine * (1.0 / 20.0) * x * x;
        let e = -w1 / (2.0 * b2);
        minimum = w + 0.5 * w1 * e;
        x += e;
    }
    let grazes = abs(minimum) < SineTrack::PULL_ROUNDING * x + QUOTIENT_ROUNDING * launch.velocity;
    if minimum > 0.0 {
        ShortFlight::Clears { grazes }
    } else {
        let near = x - root(-minimum / b2);
        ShortFlight::Hop { near, grazes }
    }
}

/// Third-order step on `w = u/d`, from its value, slope and half its second derivative; `None`
/// unless a simple root is near.
#[inline(always)]
pub(super) fn quotient_step(w: f32, w1: f32, b2: f32) -> Option<f32> {
    if !(w1 < 0.0 && abs(w * b2) < MAX_QUOTIENT_CURVATURE_RATIO * w1 * w1) {
        return None;
    }
    let inverse = 1.0 / w1;
    let newton = w * inverse;
    Some(-newton * (1.0 + b2 * newton * inverse))
}

/// A short hop from its start `x`, by third-order steps on `u/d`.
#[inline(always)]
pub(super) fn hop(launch: &Launch, mut x: f32) -> (f32, f32) {
    let mut round = 0;
    loop {
        let (w, w1) = deflated(launch, x);
        let b2 = launch.cosine * (1.0 / 6.0) - launch.sine * (1.0 / 8.0) * x;
        let e = quotient_step(w, w1, b2).unwrap_or_else(|| down_crossing(w, w1, b2).0);
        round += 1;
        if abs(e) <= MAX_LAST_STEP_RATIO * x || round >= 6 {
            // At the root u' = d w'; w'' = 2 b2 extrapolates w' over the last step.
            let flight = x + e;
            return (flight, larger(-flight * (w1 + 2.0 * b2 * e), 0.0));
        }
        x += e;
    }
}

/// Whether the cubic is too inaccurate for a short hop: pull and cosine both vanish at the top of
/// the track, with k near 1. Within a short hop of the top the cosine is below
/// [`Track::MAX_SHORT_FLIGHT`] and the sine above 0.96, which is a quicker test. Below the bound of
/// the pull, the fourth order of `u`, `d^4/24`, exceeds a quarter of the pull's term.
#[inline(always)]
pub(super) fn is_flat(launch: &Launch) -> bool {
    launch.sine > 0.96
        && abs(launch.cosine) < SineTrack::MAX_SHORT_FLIGHT
        && abs(launch.pull) < 0.3 * SineTrack::MAX_SHORT_FLIGHT * SineTrack::MAX_SHORT_FLIGHT
}
