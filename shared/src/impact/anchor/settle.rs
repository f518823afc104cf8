//! An impact near a node to the precision of the kernel.

use super::flight::{Flight, Local, abs, larger, root, smaller};

/// A settled impact: offset from its node in rad, and the arrival speed less minus the node's slope.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Settled {
    pub offset: f32,
    pub speed_gain: f32,
}

/// Height and slope gained over `d` from a node, and half the curvature there.
#[inline(always)]
pub(super) fn expand(k: f32, local: &Local, d: f32) -> (f32, f32, f32) {
    let Local {
        height,
        slope,
        push,
        surge,
        bend,
    } = *local;
    let curvature = push - k;
    let third = surge * d;
    let fourth = bend * d * d;
    let b2 = 0.5 * curvature + 0.5 * third;
    (
        height + d * (slope + d * (0.5 * curvature + third * (1.0 / 6.0) - fourth * (1.0 / 24.0))),
        d * (curvature + 0.5 * third - fourth * (1.0 / 6.0)),
        b2,
    )
}

/// A simple root from `offset` near a node by Newton steps with their quadratic correction, the second
/// only where the first is not enough; `None` where that is not either, or at no down-crossing (the steps
/// may have led back to launch), or at one so slow that it may be a graze.
#[inline(always)]
pub(crate) fn settle<F: Flight>(k: f32, local: &Local, offset: f32) -> Option<Settled> {
    let (settled, left) = settle_once::<F>(k, local, offset);
    if left < 0.0 {
        return Some(settled);
    }
    // So near to the node the expansion holds.
    if abs(settled.offset) < 0.03 {
        let (settled, left) = settle_once::<F>(k, local, settled.offset);
        return (left < 0.0).then_some(settled);
    }
    None
}

/// One step; and a value below 0 where it is enough.
#[inline(always)]
fn settle_once<F: Flight>(k: f32, local: &Local, offset: f32) -> (Settled, f32) {
    let (height, gain, b2) = expand(k, local, offset);
    let slope = local.slope + gain;
    let inverse = 1.0 / slope;
    let newton = height * inverse;
    let e = -newton * (1.0 + b2 * newton * inverse);
    // What is left is about 2 (b2 newton / slope)^2 newton.
    (
        finished(local, offset, gain, b2, e),
        abs(newton) + F::NEAR * (slope + F::SLOW),
    )
}

/// The state after the last step `e`.
#[inline(always)]
fn finished(local: &Local, offset: f32, gain: f32, b2: f32, e: f32) -> Settled {
    Settled {
        offset: offset + e,
        speed_gain: -(gain + e * (b2 + b2 + 0.5 * local.surge * e)),
    }
}

/// The first root of `u0 + u1 d + b2 d^2` by a down-crossing (its extremum where there is none) and
/// the root of the discriminant (Cauchy's step).
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

/// The first root from `offset` near a node, also where two roots nearly meet; and whether it is doubtful.
#[inline(never)]
pub(crate) fn settle_carefully(k: f32, local: Local, mut offset: f32) -> (Settled, bool) {
    // The search came nearer than this, but where three roots nearly meet within rounding.
    const LONGEST_STEP: f32 = 0.02;
    let mut doubtful = false;
    let mut round = 0;
    loop {
        let (height, gain, b2) = expand(k, &local, offset);
        let slope = local.slope + gain;
        let simple = slope < 0.0 && abs(height * b2) < 2e-3 * slope * slope;
        let (mut e, square) = if simple {
            let newton = height / slope;
            (-newton * (1.0 + b2 * newton / slope), 0.0)
        } else {
            down_crossing(height, slope, b2)
        };
        if square > 0.0 {
            let cubic = e * e * e * local.surge * (1.0 / 6.0) / square;
            if abs(cubic) < 0.25 * abs(e) {
                e += cubic;
            }
        }
        if abs(e) > LONGEST_STEP {
            e = smaller(larger(e, -LONGEST_STEP), LONGEST_STEP);
            doubtful = true;
        }
        round += 1;
        if (simple && abs(e) < 2e-3) || abs(e) < 2e-4 || round >= 8 {
            return (finished(&local, offset, gain, b2, e), doubtful);
        }
        offset += e;
    }
}
