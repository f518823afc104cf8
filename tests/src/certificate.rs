//! A quick proof that a given impact is the first; it shares no code with the kernels.
//!
//! It uses four facts:
//!
//! - A ball that leaves height 1 faster than the track's top speed meets the track once.
//! - Above height 1 there is no track.
//! - The oracle's lower bound of the gap holds from any point.
//! - Where the slope is negative up to the impact, the gap before it is positive.
//!
//! The oracle decides flights that these leave open after a few steps.

use crate::oracle::{clear_from, clear_of_launch, gap, rounding};

/// Longest step in rad.
const STRIDE: f64 = 2.0;

/// Whether the impact at `d` is proven to be the first; `d` is a zero of the gap to rounding.
pub fn is_first(k: f64, phase: f64, velocity: f64, d: f64) -> bool {
    let (s, c) = phase.sin_cos();
    let launch = velocity + c;
    let leaving = launch * launch - 2.0 * k * (1.0 - s);
    // Rounding of `leaving` and of the times of height 1.
    let spare = 1e-13 * (1.0 + launch * launch);
    let (mut rises, mut sinks) = (f64::INFINITY, 0.0);
    if launch > 0.0 && leaving > spare {
        let speed = leaving.sqrt();
        sinks = (launch + speed) / k * (1.0 - 1e-12) - spare / (k * speed);
        rises = (launch - speed) / k * (1.0 + 1e-12) + spare / (k * speed);
        if leaving >= 1.0 + spare {
            return d >= sinks;
        }
    }
    let mut at = 0.999 * clear_of_launch(k, phase, velocity, d.min(STRIDE));
    let [_, slope, curvature] = gap(k, phase, velocity, d);
    for _ in 0..200 {
        if at >= rises && at < sinks {
            at = sinks;
        }
        let rest = d - at;
        // u' = slope - curvature (d - x) at most plus (d - x)^2/2 at x.
        if rest <= 0.0 || slope + (-curvature).max(0.0) * rest + 0.5 * rest * rest < 0.01 * slope {
            return true;
        }
        let there = gap(k, phase, velocity, at);
        if there[0] <= 4.0 * rounding(k, phase, velocity, at) {
            return false;
        }
        let step = 0.999 * clear_from(there, phase, at, STRIDE.min(1.01 * rest));
        if step <= 1e-6 * rest {
            return false;
        }
        at += step;
    }
    false
}
