//! The certified search: for flights whose decisions come close to rounding.
//!
//! It walks the stretches of the track in order. Between a hump's end and the next edge the gap is
//! concave, so its sign at the edge tells whether the stretch holds the impact; over a hump it is
//! convex, so the sign of its minimum does. Nothing can be jumped over, every root is bracketed.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use super::launch::{Launch, Track};
use super::short::{LONGEST, deflated};
use super::step::{Landing, Local};
use crate::arithmetic::lane::{Arc, floor};
use crate::arithmetic::square_root;

/// The gap at some time of the flight.
#[derive(Clone, Copy)]
struct Gap {
    /// `u`.
    value: f64,
    /// `u'`.
    slope: f64,
    /// `u''`.
    curvature: f64,
    /// Phase there, in 0..2 pi.
    phase: f64,
    /// Bound of the rounding error of `value`.
    rounding: f64,
}

fn gap(track: &Track<f64>, launch: &Launch<f64>, d: f64) -> Gap {
    let (s, c, psi) = (launch.sine, launch.cosine, launch.velocity);
    if d < LONGEST {
        let pull = track.k - s;
        let w = deflated(pull, launch, d);
        let ahead = launch.phase + d;
        let phase = if ahead < TAU {
            ahead
        } else {
            ((launch.phase - TAU) + d).max(0.0)
        };
        Gap {
            value: d * w.value,
            slope: w.slope,
            curvature: w.curvature,
            phase,
            rounding: f64::EPSILON * d * (psi + d * (pull.abs() + track.k + 1.0) + d * d * c.abs()),
        }
    } else {
        let local = Local::near(track, launch, d);
        let node = &local.node;
        let x = d - node.distance;
        let arc = Arc::of(x);
        let turning = node.sine * arc.sine + node.cosine * arc.versine;
        let v = launch.rise();
        Gap {
            value: local.value
                + (x * (local.slope - 0.5 * track.k * x)
                    + (node.sine * arc.versine + node.cosine * arc.sagitta)),
            slope: local.slope + (turning - track.k * x),
            curvature: node.sine + (node.cosine * arc.sine - node.sine * arc.versine) - track.k,
            phase: node.phase(x),
            rounding: f64::EPSILON * (2.0 + d * (v.abs() + track.k * d)),
        }
    }
}

/// What the search does with the humps of the track while the ball is above all of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Envelope {
    /// It jumps over them: no impact is possible there.
    #[default]
    Skip,
    /// It looks at each; to show what the jump saves and that it changes nothing.
    Walk,
}

/// The first impact after `launch`, and whether it grazes: whether an earlier or later touch is within
/// rounding of this decision.
#[cold]
pub(crate) fn landing(
    track: &Track<f64>,
    launch: &Launch<f64>,
    envelope: Envelope,
) -> (Landing<f64>, bool) {
    let v = launch.rise();
    let leaving = launch.leaving(track);
    // While the ball is above height 1 no hump reaches it.
    let (above_from, above_to) = if envelope == Envelope::Skip && v > 0.0 && leaving > 0.0 {
        let root = square_root(leaving);
        ((v - root) * track.per_k, (v + root) * track.per_k)
    } else {
        (f64::INFINITY, 0.0)
    };
    let width = 2.0 * (FRAC_PI_2 - track.edge);
    let hump_end = PI - track.edge;
    // At rest up to lift-off, or a rounding before it: the hump has begun.
    let lifting = launch.velocity == 0.0 && launch.cosine > 0.0 && launch.phase < hump_end;
    let (mut low, first) = if launch.phase < track.edge && !lifting {
        (0.0, track.edge - launch.phase)
    } else if launch.phase < hump_end {
        (hump_end - launch.phase, (track.edge - launch.phase) + TAU)
    } else {
        (0.0, (track.edge - launch.phase) + TAU)
    };
    let mut turns = 0.0;
    let mut grazes = false;
    loop {
        let begin = first + turns * TAU;
        let at_begin = gap_at_edge(track, launch, begin);
        if at_begin.value <= 0.0 {
            return root(track, launch, low, begin, grazes);
        }
        let end = begin + width;
        if !(above_from <= begin && end <= above_to) && at_begin.slope < 0.0 {
            let at_end = gap(track, launch, end);
            let (lowest, at_lowest) = if at_end.slope <= 0.0 {
                (end, at_end)
            } else {
                lowest(track, launch, begin, end)
            };
            if at_lowest.value <= 0.0 {
                grazes |= -at_lowest.value <= at_lowest.rounding && at_end.slope > 0.0;
                return root(track, launch, begin, lowest, grazes);
            }
            grazes |= at_lowest.value <= at_lowest.rounding && at_end.slope > 0.0;
        }
        low = end;
        turns += 1.0;
        // Every hump that begins and ends while the ball is above height 1.
        let next = first + turns * TAU;
        if above_from <= next {
            let skipped = floor((above_to - (next + width)) * (1.0 / TAU));
            if skipped > 0.0 {
                turns += skipped;
                low = first + (turns - 1.0) * TAU + width;
            }
        }
    }
}

/// The gap where the track's acceleration passes k going up.
fn gap_at_edge(track: &Track<f64>, launch: &Launch<f64>, begin: f64) -> Gap {
    let mut at = gap(track, launch, begin);
    if begin >= LONGEST {
        at.value = launch.height(track, begin) - track.k.min(1.0);
        at.slope = (launch.rise() - track.k * begin) - track.edge_cosine;
    }
    at
}

/// The lowest gap over the hump `begin..end`, where the slope changes from - to +.
fn lowest(track: &Track<f64>, launch: &Launch<f64>, begin: f64, end: f64) -> (f64, Gap) {
    let (mut low, mut high) = (begin, end);
    let mut d = 0.5 * (low + high);
    let mut at = gap(track, launch, d);
    for round in 0..100 {
        if at.slope > 0.0 {
            high = d;
        } else {
            low = d;
        }
        // Below its value here less what the slope can take, or above zero no more: it is decided.
        let least = at.value - at.slope.abs() * (high - low);
        if at.value < -4.0 * at.rounding || least > 4.0 * at.rounding {
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
            return (next, gap(track, launch, next));
        }
        d = next;
        at = gap(track, launch, d);
    }
    (d, at)
}

/// The impact in `low..high`, where the gap goes from + to - once; at `low` = 0 it leaves zero upwards.
fn root(
    track: &Track<f64>,
    launch: &Launch<f64>,
    low: f64,
    high: f64,
    grazes: bool,
) -> (Landing<f64>, bool) {
    let (mut below, mut above) = (low, high);
    let pull = track.k - launch.sine;
    let mut d = high;
    if low == 0.0 && pull > 0.0 {
        d = d.min(2.0 * launch.velocity / pull);
    }
    let mut at = gap(track, launch, d);
    let mut close = false;
    for round in 0..300 {
        if at.value > 0.0 {
            below = below.max(d);
        } else {
            above = above.min(d);
        }
        let step = if d < LONGEST {
            // u/d has the same root without the one at launch.
            let w = at.value / d;
            let w1 = (at.slope - w) / d;
            let w2 = (at.curvature - 2.0 * w1) / d;
            down_crossing(w, w1, 0.5 * w2)
        } else {
            down_crossing(at.value, at.slope, 0.5 * at.curvature)
        };
        let next = d + step;
        let next = if close && next > 0.0 {
            next.max(below).min(above)
        } else if next > below && next < above && round % 4 != 3 {
            next
        } else {
            0.5 * (below + above)
        };
        let moved = (next - d).abs();
        d = next;
        at = gap(track, launch, d);
        if close || above - below <= f64::EPSILON * above {
            break;
        }
        // Third order: the step after this one is below rounding.
        close = moved <= 1e-7 * d && round % 4 != 3;
    }
    let arrival = (-at.slope).max(0.0);
    // Two roots within rounding of each other.
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

/// Step to where `f + g x + b x^2` crosses zero going down; to its extremum where it does not.
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
