//! Safeguarded root and minimum search in f64, where the gap is convex or has one root.
//!
//! The root search takes Cauchy's step, the root of the second-order Taylor polynomial (Traub
//! 1964). The minimum search takes Newton's step on the slope. Both fall back to bisection.

use super::step::Landing;
use crate::arithmetic::square_root;

/// The gap u at some time of the flight, u' and u''.
#[derive(Clone, Copy)]
pub(crate) struct Gap {
    pub value: f64,
    pub slope: f64,
    pub curvature: f64,
    /// Phase there, in 0..2 pi.
    pub phase: f64,
    /// Bound of the rounding error of `value`.
    pub rounding: f64,
}

pub(crate) trait Path {
    /// Longest flight time in rad for which `d (u/d)` gives the gap and keeps its digits.
    const MAX_SHORT_HOP: f64;

    fn at(&self, d: f64) -> Gap;

    /// Flight time of a short hop in rad, `2 psi` over the pull at launch; `None` without a pull.
    fn hop(&self) -> Option<f64>;
}

/// The impact before or within the hump `begin..end`, if any. The interval before it starts at
/// `low`. Between humps the gap is concave, so its sign at `begin` decides. Over the hump it is
/// convex, so the sign of its minimum decides; there is none while the ball `passes` high above.
/// `grazes` keeps whether a touch is within rounding.
pub(crate) fn impact_at_hump<P: Path>(
    path: &P,
    at_begin: Gap,
    [low, begin, end]: [f64; 3],
    passes: bool,
    grazes: &mut bool,
) -> Option<(Landing<f64>, bool)> {
    if at_begin.value <= 0.0 {
        return Some(root(path, low, begin, *grazes));
    }
    if passes || at_begin.slope >= 0.0 {
        return None;
    }
    let at_end = path.at(end);
    let (lowest, at_lowest) = if at_end.slope <= 0.0 {
        (end, at_end)
    } else {
        find_minimum(path, begin, end)
    };
    *grazes |= at_lowest.value.abs() <= at_lowest.rounding && at_end.slope > 0.0;
    (at_lowest.value <= 0.0).then(|| root(path, begin, lowest, *grazes))
}

/// Time and gap of the minimum over the hump `begin..end`, where the slope changes from - to +.
fn find_minimum(path: &impl Path, begin: f64, end: f64) -> (f64, Gap) {
    let (mut low, mut high) = (begin, end);
    let mut d = 0.5 * (low + high);
    let mut at = path.at(d);
    for round in 0..100 {
        if at.slope > 0.0 {
            high = d;
        } else {
            low = d;
        }
        // The tangent bounds a convex gap from below. Stop once the sign of the minimum is certain.
        let lower_bound = at.value - at.slope.abs() * (high - low);
        if at.value < -4.0 * at.rounding || lower_bound > 4.0 * at.rounding {
            return (d, at);
        }
        let newton = d - at.slope / at.curvature;
        let next = if newton > low && newton < high && round % 8 != 7 {
            newton
        } else {
            0.5 * (low + high)
        };
        if (next - d).abs() <= 1e-9 * d {
            // The minimum is flat: this changes the value by less than rounding.
            return (next, path.at(next));
        }
        d = next;
        at = path.at(d);
    }
    (d, at)
}

/// The impact in `low..high`, the only down-crossing; at `low` = 0 the gap leaves zero upwards.
pub(crate) fn root<P: Path>(path: &P, low: f64, high: f64, grazes: bool) -> (Landing<f64>, bool) {
    let (mut below, mut above) = (low, high);
    let mut d = high;
    if low == 0.0
        && let Some(hop) = path.hop()
    {
        d = d.min(hop);
    }
    let mut at = path.at(d);
    let mut estimate = false;
    for round in 0..300 {
        if at.value > 0.0 {
            below = below.max(d);
        } else {
            above = above.min(d);
        }
        let step = if d < P::MAX_SHORT_HOP {
            // u/d has the same root without the one at launch.
            let w = at.value / d;
            let w1 = (at.slope - w) / d;
            let w2 = (at.curvature - 2.0 * w1) / d;
            down_crossing(w, w1, 0.5 * w2)
        } else {
            down_crossing(at.value, at.slope, 0.5 * at.curvature)
        };
        let next = d + step;
        let next = if estimate && next > 0.0 {
            next.max(below).min(above)
        } else if next > below && next < above && round % 4 != 3 {
            next
        } else {
            0.5 * (below + above)
        };
        let moved = (next - d).abs();
        d = next;
        at = path.at(d);
        if estimate || above - below <= f64::EPSILON * above {
            break;
        }
        // Third order: the step after this one is below rounding.
        estimate = moved <= 1e-7 * d && round % 4 != 3;
    }
    let arrival = (-at.slope).max(0.0);
    // A double root within rounding.
    let double = arrival * arrival <= 4.0 * at.curvature.abs() * at.rounding && at.curvature > 0.0;
    (
        Landing {
            flight: d,
            phase: at.phase,
            arrival,
        },
        grazes || double,
    )
}

/// Cauchy's step: to the down-crossing of `f + g x + b x^2`, or to its extremum without one.
fn down_crossing(f: f64, g: f64, b: f64) -> f64 {
    let root = square_root((g * g - 4.0 * b * f).max(0.0));
    if g > 0.0 {
        -(g + root) / (2.0 * b)
    } else if root > g {
        2.0 * f / (root - g)
    } else {
        0.0
    }
}
