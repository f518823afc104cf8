//! The root in a bracket that holds one.

use super::approach::householder;
use super::flight::{
    Flight, Launch, Local, NODES_PER_RADIAN, SPACING, abs, nearest, node_of, sine_cosine_at,
};
use super::settle::down_crossing;
use super::shape::Shape;

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
    shape: &Shape,
    launch: &Launch,
    flight: &F,
    bracket: &Bracket,
) -> Found {
    let v = launch.velocity + launch.cosine;
    let (mut node, offset) = node_of(launch.phase, bracket.start);
    let mut time = bracket.start - offset;
    for _ in 0..3 {
        let (sine, cosine) = sine_cosine_at(node);
        let u0 = (launch.sine - sine) + time * (v - shape.half_k * time);
        let u1 = v - shape.k * time - cosine;
        let b2 = 0.5 * (sine - shape.k);
        let square = u1 * u1;
        let product = b2 * u0;
        if !(u1 < -0.01 && abs(product) < 0.15 * square) {
            break;
        }
        let step = householder(u0, u1, square, product, cosine);
        let next = time + step;
        if !(next >= bracket.low - 1e-4 && next <= bracket.high + 1e-4) {
            break;
        }
        let (jump, count) = nearest(step * NODES_PER_RADIAN);
        node = node.wrapping_add(jump);
        if abs(step) < 0.15 {
            return Found::Near {
                node,
                offset: step - count * SPACING,
                simple: true,
            };
        }
        time += count * SPACING;
    }
    let (node, offset) = solve_safely(shape, *launch, flight, *bracket);
    Found::Near {
        node,
        offset,
        simple: false,
    }
}

/// The root in `bracket`, nearly, by Cauchy's step on nodes to the full precision of the kernel, with
/// bisection where there is no root near or the step leaves the bracket.
#[inline(never)]
fn solve_safely<F: Flight>(
    shape: &Shape,
    launch: Launch,
    flight: &F,
    bracket: Bracket,
) -> (i32, f32) {
    let Bracket {
        mut low,
        mut high,
        start: mut x,
    } = bracket;
    let mut round = 0;
    loop {
        let (node, offset) = node_of(launch.phase, x);
        let time = x - offset;
        let local = flight.local(node);
        let Local { height, slope, .. } = local;
        let b2 = 0.5 * (local.sine - shape.k);
        let (mut step, square) = down_crossing(height, slope, b2);
        if square > 1e-3 {
            let cubic = step * step * step * local.cosine * (1.0 / 6.0) / square;
            if abs(cubic) < 0.5 * abs(step) {
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
        let found = square > 0.0 && next >= low - 1e-4 && next <= high + 1e-4;
        if !found {
            next = 0.5 * (low + high);
            step = next - time;
        }
        let moved = abs(next - x);
        x = next;
        round += 1;
        let near = (abs(step) < 0.1 * square && abs(step) < 0.15) || moved < 2e-3;
        if found && near || high - low < 1e-4 || round >= 32 {
            let (jump, count) = nearest(step * NODES_PER_RADIAN);
            return (node.wrapping_add(jump), step - count * SPACING);
        }
    }
}
