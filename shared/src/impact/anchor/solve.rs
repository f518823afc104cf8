//! The root in a bracket with one down-crossing.
//!
//! Householder's method of order 3 for simple roots, else Cauchy steps with bisection.

use super::approach::householder;
use super::flight::{
    Ballistic, Gravity, Local, MAX_HEIGHT, NODES_PER_RADIAN, SPACING, Track, abs, nearest, node_of,
};
use super::settle::down_crossing;

// The thresholds decide which steps are accepted. They were measured over 200 000 launches per set:
// velocities 0..3, near lift-off, and nearly touching a hump. See docs/tuning.md.

/// Smallest slope in `b w` for Householder's step; it affects cost only.
const MIN_SLOPE: f32 = 0.01;

/// Largest ratio of `b2 u0` to the squared slope for Householder's step. From a quarter on the
/// parabola has no root.
const MAX_CURVATURE_RATIO: f32 = 0.15;

/// Distance in rad by which a step may leave the bracket: rounding of the bracket's ends in f32.
const BRACKET_ROUNDING: f32 = 1e-4;

/// Longest last step in rad. The nodes next to the root settle the remaining error.
const MAX_LAST_STEP: f32 = 0.15;

/// Squared root of the discriminant from which the cubic correction of Cauchy's step is small.
const MIN_CORRECTED_ROOT: f32 = 1e-3;

/// Largest applied ratio of the correction to the step.
const MAX_CUBIC_CORRECTION: f32 = 0.5;

/// Largest ratio of Cauchy's last step to the discriminant's root.
const MAX_CAUCHY_STEP_RATIO: f32 = 0.1;

/// Change of time in rad below which a step is the last.
const MIN_TIME_CHANGE: f32 = 2e-3;

/// Width in rad: a narrower bracket counts as the root.
const MIN_BRACKET_WIDTH: f32 = 1e-4;

/// Approximate place of the first impact.
#[derive(Clone, Copy, Debug)]
pub(super) enum Found {
    /// A short hop: flight in rad and arrival speed, both final.
    Short { flight: f32, arrival: f32 },
    /// At `offset` rad from a node; unless `simple`, it may be a double root.
    Near {
        node: i32,
        offset: f32,
        simple: bool,
    },
}

/// A bracket with one down-crossing, and the start in it, in rad after launch.
#[derive(Clone, Copy)]
pub(super) struct Bracket {
    pub(super) low: f32,
    pub(super) high: f32,
    pub(super) start: f32,
}

impl Bracket {
    #[inline(always)]
    pub(super) fn new([low, high]: [f32; 2], start: f32) -> Self {
        Self { low, high, start }
    }
}

/// Approximate root in `bracket`, which holds one down-crossing: any step that converges within it
/// has found the root.
#[inline(always)]
pub(super) fn solve<T: Track>(flight: &Ballistic<'_, T>, bracket: &Bracket) -> Found {
    let (track, v) = (flight.track, flight.rise);
    let Gravity { k, half, .. } = track.gravity();
    let (mut node, offset) = node_of(flight.phase, bracket.start);
    let mut time = bracket.start - offset;
    for _ in 0..3 {
        let at = track.at(node);
        let u0 = (flight.height - at.height) + time * (v - half * time);
        let u1 = v - k * time - at.speed;
        let b2 = 0.5 * (at.push - k);
        let square = u1 * u1;
        let product = b2 * u0;
        if !(u1 < -MIN_SLOPE && abs(product) < MAX_CURVATURE_RATIO * square) {
            break;
        }
        let step = householder(u0, u1, square, product, at.jerk);
        let next = time + step;
        if !(next >= bracket.low - BRACKET_ROUNDING && next <= bracket.high + BRACKET_ROUNDING) {
            break;
        }
        let (jump, count) = nearest(step * NODES_PER_RADIAN);
        node = node.wrapping_add(jump);
        if abs(step) < MAX_LAST_STEP {
            return Found::Near {
                node,
                offset: step - count * SPACING,
                simple: true,
            };
        }
        time += count * SPACING;
    }
    let (node, offset) = solve_safely(flight, *bracket);
    Found::Near {
        node,
        offset,
        simple: false,
    }
}

/// Approximate root in `bracket`, by Cauchy's step on nodes. Bisection replaces steps without a
/// near root and steps that leave the bracket.
#[inline(never)]
fn solve_safely<T: Track>(flight: &Ballistic<'_, T>, bracket: Bracket) -> (i32, f32) {
    let k = flight.track.gravity().k;
    let (mut low, mut high, mut x) = (bracket.low, bracket.high, bracket.start);
    let mut round = 0;
    loop {
        let (node, offset) = node_of(flight.phase, x);
        let time = x - offset;
        let local = flight.local(node);
        let Local { height, slope, .. } = local;
        let b2 = 0.5 * (local.push - k);
        let (mut step, square) = down_crossing(height, slope, b2);
        if square > MIN_CORRECTED_ROOT {
            let cubic = step * step * step * local.jerk * (1.0 / 6.0) / square;
            if abs(cubic) < MAX_CUBIC_CORRECTION * abs(step) {
                step += cubic;
            }
        }
        // The only down-crossing is after every height above 0. Near launch, on a concave rise,
        // even a height rounded below 0 is before it.
        let before = height > 0.0 || (b2 < 0.0 && slope > 0.0);
        if time > low && time < high {
            if before {
                low = time;
            } else {
                high = time;
            }
        }
        let mut next = time + step;
        let far = abs(height) >= MAX_HEIGHT;
        let has_root = !far
            && square > 0.0
            && next >= low - BRACKET_ROUNDING
            && next <= high + BRACKET_ROUNDING;
        if !has_root {
            next = 0.5 * (low + high);
            step = next - time;
        }
        let moved = abs(next - x);
        x = next;
        round += 1;
        let is_near = (abs(step) < MAX_CAUCHY_STEP_RATIO * square && abs(step) < MAX_LAST_STEP)
            || moved < MIN_TIME_CHANGE;
        // After 32 halvings of a few turns bisection alone reaches the rounding of f32.
        if has_root && is_near || high - low < MIN_BRACKET_WIDTH || round >= 32 {
            let (jump, count) = nearest(step * NODES_PER_RADIAN);
            return (node.wrapping_add(jump), step - count * SPACING);
        }
    }
}
