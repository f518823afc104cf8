//! Settle: the impact near a node, to the precision of the kernel.
//!
//! Simple roots take Chebyshev's method, double ones Cauchy's with a cubic term (Traub 1964).

use super::flight::{Local, MAX_GRAZING_SPEED, Track, abs, larger, root, smaller};

// The constants choose between two ways to the same impact, measured over 420 000 launches. Within
// the ranges of docs/tuning.md none more is wrong, at most 2 more are flagged.

/// Largest distance from a node in rad for its expansion, whose remainder `d^5/120` is below 2e-10.
const MAX_NODE_DISTANCE: f32 = 0.03;

/// Longest step in rad of the careful method. Only nearly triple roots, flagged, need longer ones.
const MAX_STEP: f32 = 0.02;

/// Largest ratio of `b2 u0` to the squared slope, and largest last step in rad, for Chebyshev's
/// method. It leaves `2 MAX_CURVATURE_RATIO^2` of the step, 1.6e-8 rad.
const MAX_CURVATURE_RATIO: f32 = 2e-3;

/// Largest applied ratio of the cubic correction to Cauchy's step.
const MAX_CUBIC_CORRECTION: f32 = 0.25;

/// Longest last step of Cauchy's method, in rad: it leaves its square over the roots' distance.
const MAX_LAST_STEP: f32 = 2e-4;

/// Number of steps after which the current place counts as the root.
const MAX_STEPS: u32 = 8;

/// A settled impact: offset from its node in rad, and arrival speed plus the node's slope.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settled {
    pub offset: f32,
    pub speed_gain: f32,
}

/// Height and slope at `d` from a node relative to the node's, and half the curvature there.
#[inline(always)]
pub(super) fn expand(k: f32, local: &Local, d: f32) -> (f32, f32, f32) {
    let Local { height, slope, .. } = *local;
    let curvature = local.push - k;
    let third = local.jerk * d;
    let fourth = local.snap * d * d;
    let b2 = 0.5 * curvature + 0.5 * third;
    (
        height + d * (slope + d * (0.5 * curvature + third * (1.0 / 6.0) - fourth * (1.0 / 24.0))),
        d * (curvature + 0.5 * third - fourth * (1.0 / 6.0)),
        b2,
    )
}

/// A simple root from `offset` near a node, by one or two steps of Chebyshev's method. `None` if
/// they do not suffice, at an up-crossing (they may have led back to launch), or near a graze.
#[inline(always)]
pub(super) fn settle<T: Track>(k: f32, local: &Local, offset: f32) -> Option<Settled> {
    let (settled, remaining) = settle_once::<T>(k, local, offset);
    if remaining < 0.0 {
        return Some(settled);
    }
    if abs(settled.offset) < MAX_NODE_DISTANCE {
        let (settled, remaining) = settle_once::<T>(k, local, settled.offset);
        return (remaining < 0.0).then_some(settled);
    }
    None
}

/// One step of Chebyshev's method; the second value is below 0 if it suffices.
#[inline(always)]
fn settle_once<T: Track>(k: f32, local: &Local, offset: f32) -> (Settled, f32) {
    let (height, gain, b2) = expand(k, local, offset);
    let slope = local.slope + gain;
    let inverse = 1.0 / slope;
    let newton = height * inverse;
    let e = -newton * (1.0 + b2 * newton * inverse);
    // The remaining error is about 2 (b2 newton / slope)^2 newton.
    (
        finished(local, offset, gain, b2, e),
        abs(newton) + T::MAX_LAST_CORRECTION * (slope + MAX_GRAZING_SPEED),
    )
}

/// The state after the last step `e`.
#[inline(always)]
fn finished(local: &Local, offset: f32, gain: f32, b2: f32, e: f32) -> Settled {
    Settled {
        offset: offset + e,
        speed_gain: -(gain + e * (b2 + b2 + 0.5 * local.jerk * e)),
    }
}

/// Cauchy's step: to the down-crossing of `u0 + u1 d + b2 d^2`, or to its extremum without one. The
/// second value is the root of the discriminant.
#[inline(always)]
pub(super) fn down_crossing(u0: f32, u1: f32, b2: f32) -> (f32, f32) {
    let square = root(u1 * u1 - 4.0 * b2 * u0);
    let (over, under) = if u1 > 0.0 || square == 0.0 {
        (-(u1 + square), 2.0 * b2)
    } else {
        (2.0 * u0, square - u1)
    };
    (if under != 0.0 { over / under } else { 0.0 }, square)
}

/// The first root from `offset` near a node, also near a double root; and whether it is doubtful.
#[inline(never)]
pub(super) fn settle_carefully(k: f32, local: Local, mut offset: f32) -> (Settled, bool) {
    let mut doubtful = false;
    let mut round = 0;
    loop {
        let (height, gain, b2) = expand(k, &local, offset);
        let slope = local.slope + gain;
        let simple = slope < 0.0 && abs(height * b2) < MAX_CURVATURE_RATIO * slope * slope;
        let (mut e, square) = if simple {
            let newton = height / slope;
            (-newton * (1.0 + b2 * newton / slope), 0.0)
        } else {
            down_crossing(height, slope, b2)
        };
        if square > 0.0 {
            let cubic = e * e * e * local.jerk * (1.0 / 6.0) / square;
            if abs(cubic) < MAX_CUBIC_CORRECTION * abs(e) {
                e += cubic;
            }
        }
        if abs(e) > MAX_STEP {
            e = smaller(larger(e, -MAX_STEP), MAX_STEP);
            doubtful = true;
        }
        round += 1;
        if (simple && abs(e) < MAX_CURVATURE_RATIO) || abs(e) < MAX_LAST_STEP || round >= MAX_STEPS
        {
            return (finished(&local, offset, gain, b2, e), doubtful);
        }
        offset += e;
    }
}
