//! The root in a bracket that holds one.

use super::approach::householder;
use super::flight::{
    Flight, Local, Motion, NODES_PER_RADIAN, SPACING, Track, abs, nearest, node_of,
};
use super::settle::down_crossing;

// The thresholds below decide when a step is believed. Measured over 200 000 launches a set (velocities 0..3,
// near lift-off, and such that all but touch a hump), they change no impact where nothing else is said.

/// Householder's step wants a slope down of this; slower arrivals are left to the safeguarded search. Cost
/// alone, between 0 and 0.1.
const SLOWEST: f32 = 0.01;

/// That step also wants `b2 u0` below this share of the slope's square, a quarter being where the parabola has no root. At 0.05
/// twice as many flights below velocity 3 need the safeguarded search (2.4 % steps of it for 1.0 %), at 0.3
/// hardly any; but near the top of the track steps are then taken that lead to no root.
const SIMPLE: f32 = 0.15;

/// How far outside the bracket a step may end, in rad: rounding of the times of its ends in f32. Between 0
/// and 0.01 no impact changes.
const SLACK: f32 = 1e-4;

/// The longest last step in rad: what it leaves is settled on the nodes next to the root. At 0.05 an eighth
/// more steps, at 0.3 as many fewer.
const LAST_STEP: f32 = 0.15;

/// The square of the discriminant's root from which the cubic correction of Cauchy's step is small; between
/// 0 and 0.01 no impact changes.
const CORRECTED: f32 = 1e-3;

/// The largest correction, as a share of the step: at 2 twice as many launches near the top of the track are
/// flagged.
const CORRECTION: f32 = 0.5;

/// The longest last step of Cauchy's as a share of the discriminant's root. At 0.02 a tenth more steps.
const CURVED: f32 = 0.1;

/// A step that moves the time by less, in rad, is the last. At 2e-4 a tenth more steps; at 0.1 23 times as
/// many launches near the top of the track are flagged.
const MOVED: f32 = 2e-3;

/// A height beyond which a kernel may know no more than its sign ([`Flight::local`]): no step from there ends at an impact.
const FAR: f32 = 2.0;

/// A bracket narrower than this, in rad, is the root; between 1e-5 and 1e-3 nothing changes.
const NARROW: f32 = 1e-4;

/// Where the first impact is, nearly.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Found {
    /// A short hop: flight in rad and arrival speed, final.
    Short { flight: f32, arrival: f32 },
    /// At `offset` rad from a node; settled with care for a double root unless it is `simple`.
    Near {
        node: i32,
        offset: f32,
        simple: bool,
    },
}

/// The ball at launch: phase of the track in steps, its height and upward speed there.
#[derive(Clone, Copy)]
pub(super) struct LaunchPoint {
    pub(super) phase: u32,
    pub(super) height: f32,
    pub(super) rise: f32,
}

/// The bracket and start that the segment search hands to the solver.
#[derive(Clone, Copy)]
pub(super) struct Bracket {
    pub(super) low: f32,
    pub(super) high: f32,
    pub(super) start: f32,
}

/// The root in `bracket`, nearly. The bracket holds one down-crossing, so that any step that converges
/// within it has found it: Householder's where the root is simple and near, else the safeguarded
/// search.
#[inline(always)]
pub(super) fn solve<F: Flight>(
    track: &impl Track,
    start: &LaunchPoint,
    flight: &F,
    bracket: &Bracket,
) -> Found {
    let LaunchPoint {
        phase,
        height,
        rise: v,
    } = *start;
    let (mut node, offset) = node_of(phase, bracket.start);
    let mut time = bracket.start - offset;
    for _ in 0..3 {
        let Motion {
            height: below,
            speed,
            push,
            surge,
            ..
        } = track.at(node);
        let u0 = (height - below) + time * (v - track.half_k() * time);
        let u1 = v - track.k() * time - speed;
        let b2 = 0.5 * (push - track.k());
        let square = u1 * u1;
        let product = b2 * u0;
        if !(u1 < -SLOWEST && abs(product) < SIMPLE * square) {
            break;
        }
        let step = householder(u0, u1, square, product, surge);
        let next = time + step;
        if !(next >= bracket.low - SLACK && next <= bracket.high + SLACK) {
            break;
        }
        let (jump, count) = nearest(step * NODES_PER_RADIAN);
        node = node.wrapping_add(jump);
        if abs(step) < LAST_STEP {
            return Found::Near {
                node,
                offset: step - count * SPACING,
                simple: true,
            };
        }
        time += count * SPACING;
    }
    let (node, offset) = solve_safely(track.k(), phase, flight, *bracket);
    Found::Near {
        node,
        offset,
        simple: false,
    }
}

/// The root in `bracket`, nearly, by Cauchy's step on nodes to the full precision of the kernel, with
/// bisection where there is no root near or the step leaves the bracket.
#[inline(never)]
fn solve_safely<F: Flight>(k: f32, phase: u32, flight: &F, bracket: Bracket) -> (i32, f32) {
    let Bracket {
        mut low,
        mut high,
        start: mut x,
    } = bracket;
    let mut round = 0;
    loop {
        let (node, offset) = node_of(phase, x);
        let time = x - offset;
        let local = flight.local(node);
        let Local { height, slope, .. } = local;
        let b2 = 0.5 * (local.push - k);
        let (mut step, square) = down_crossing(height, slope, b2);
        if square > CORRECTED {
            let cubic = step * step * step * local.surge * (1.0 / 6.0) / square;
            if abs(cubic) < CORRECTION * abs(step) {
                step += cubic;
            }
        }
        // The one down-crossing is after every height above 0; near launch, on a concave rise, even one
        // rounded below 0 is before it.
        let before = height > 0.0 || (b2 < 0.0 && slope > 0.0);
        if time > low && time < high {
            if before {
                low = time;
            } else {
                high = time;
            }
        }
        let mut next = time + step;
        let far = abs(height) >= FAR;
        let found = !far && square > 0.0 && next >= low - SLACK && next <= high + SLACK;
        if !found {
            next = 0.5 * (low + high);
            step = next - time;
        }
        let moved = abs(next - x);
        x = next;
        round += 1;
        let near = (abs(step) < CURVED * square && abs(step) < LAST_STEP) || moved < MOVED;
        // Bisection alone is at the rounding of f32 after 32 halvings of a few turns.
        if found && near || high - low < NARROW || round >= 32 {
            let (jump, count) = nearest(step * NODES_PER_RADIAN);
            return (node.wrapping_add(jump), step - count * SPACING);
        }
    }
}
