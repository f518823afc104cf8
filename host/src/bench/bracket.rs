//! Baseline: the impact map of a general event detector (march, bracket a sign change, refine).
//!
//! Steps of 0.05 rad until the gap changes sign, then secant steps safeguarded by bisection (regula
//! falsi; Brent 1973). It can step over a graze and misses hops shorter than its step.

use std::f64::consts::TAU;

use super::Flight;

/// March step in rad.
const STEP: f64 = 0.05;

/// The first impact found by marching.
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
    let gap = |d: f64| v * d - 0.5 * k * d * d - ((phase + d).sin() - s);
    let mut low = 1e-9;
    let mut high = STEP;
    let mut at_low = gap(low);
    let mut at_high = gap(high);
    while at_high > 0.0 && high < 1e6 {
        (low, at_low) = (high, at_high);
        high += STEP;
        at_high = gap(high);
    }
    for _ in 0..100 {
        let secant = high - at_high * (high - low) / (at_high - at_low);
        let width = high - low;
        // The secant, kept inside the bracket; every two steps at least halve it.
        let mut d = if secant > low && secant < high {
            secant
        } else {
            0.5 * (low + high)
        };
        for _ in 0..2 {
            let u = gap(d);
            if u <= 0.0 {
                (high, at_high) = (d, u);
            } else {
                (low, at_low) = (d, u);
            }
            if high - low <= 0.5 * width {
                break;
            }
            d = 0.5 * (low + high);
        }
        if high - low <= 4.0 * f64::EPSILON * high || at_high == 0.0 {
            break;
        }
    }
    let arrival = k * high + (phase + high).cos() - c - velocity;
    let ahead = phase + high;
    Flight {
        duration: high,
        phase: ahead - TAU * (ahead / TAU).floor(),
        arrival,
    }
}
