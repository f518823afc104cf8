//! Baseline: the textbook's impact map, with convexity segments and monotone Newton steps.
//!
//! Between the phases with `sin t = k` the gap is convex or concave, so Newton's method from the
//! right end converges monotonically. It uses the platform's sine and shares no code with the
//! kernels.

use std::f64::consts::{PI, TAU};

use super::Flight;

/// The first impact after a launch.
#[must_use]
pub fn first_impact(k: f64, phase: f64, velocity: f64) -> Flight {
    let (s, c) = phase.sin_cos();
    if velocity == 0.0 && s < k {
        return Flight {
            duration: 0.0,
            phase,
            arrival: 0.0,
        };
    }
    let v = velocity + c;
    let (lift_off, lift_off_cosine) = if k < 1.0 {
        (k.asin(), (1.0 - k * k).sqrt())
    } else {
        (0.5 * PI, 0.0)
    };
    let gap = |d: f64| {
        let (sh, ch) = (0.5 * d).sin_cos();
        let (middle_cosine, middle_sine) = (c * ch - s * sh, s * ch + c * sh);
        (
            d * (v - 0.5 * k * d) - 2.0 * middle_cosine * sh,
            velocity - k * d + 2.0 * middle_sine * sh,
        )
    };
    // At a segment's end the gap needs no sine.
    let at_end = |d: f64| s - k.min(1.0) + d * (v - 0.5 * k * d);
    let mut convex = s > k && phase < PI;
    let mut low = 0.0;
    let mut high = if phase < lift_off {
        lift_off - phase
    } else if convex {
        PI - lift_off - phase
    } else {
        TAU + lift_off - phase
    };
    // Skips whole turns above the track's reach.
    let leaving = v * v - 2.0 * k * (1.0 - s);
    let (above_from, above_to) = if leaving > 0.0 && v > 0.0 {
        let root = leaving.sqrt();
        ((v - root) / k, (v + root) / k)
    } else {
        (0.0, 0.0)
    };
    let mut first = true;
    let d = loop {
        if low > above_from && high < above_to {
            let turns = ((above_to - high) / TAU).floor();
            low += turns * TAU;
            high += turns * TAU;
        }
        if convex {
            if let Some(d) = (!first)
                .then(|| {
                    let (u, du) = (at_end(low), v - k * low - lift_off_cosine);
                    newton_from_left(gap, u, du, low, high)
                })
                .flatten()
            {
                break d;
            }
            low = high;
            high += PI + 2.0 * lift_off;
        } else {
            let u = at_end(high);
            if u <= 0.0 {
                let mut d = high - u / (v - k * high - lift_off_cosine);
                for _ in 0..200 {
                    let (u, du) = gap(d);
                    if u >= 0.0 || du >= 0.0 {
                        break;
                    }
                    let step = u / du;
                    d -= step;
                    if step <= f64::EPSILON * d {
                        break;
                    }
                }
                break d;
            }
            low = high;
            high += PI - 2.0 * lift_off;
        }
        convex = !convex;
        first = false;
        if !low.is_finite() || low > 1e7 {
            break f64::NAN;
        }
    };
    let arrival = -gap(d).1;
    let ahead = phase + d;
    Flight {
        duration: d,
        phase: ahead - TAU * (ahead / TAU).floor(),
        arrival,
    }
}

fn newton_from_left(
    gap: impl Fn(f64) -> (f64, f64),
    u: f64,
    du: f64,
    low: f64,
    high: f64,
) -> Option<f64> {
    if du >= 0.0 {
        return None;
    }
    let mut d = low - u / du;
    for _ in 0..200 {
        if d > high {
            return None;
        }
        let (u, du) = gap(d);
        if u <= 0.0 {
            return Some(d);
        }
        if du >= 0.0 {
            return None;
        }
        let step = -u / du;
        d += step;
        if step <= f64::EPSILON * d {
            return Some(d);
        }
    }
    None
}
