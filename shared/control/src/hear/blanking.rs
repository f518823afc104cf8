//! Bias of the demodulated motion where samples are blanked around impacts.
//!
//! Parts that strike at one phase make the track's velocity jump; drive and loss reverse the jump
//! over the cycle. At phase p after the impact the motion therefore contains a sawtooth part, `J
//! saw(p) sin p` with `saw(p) = 1/2 - p/(2 pi)`. The demodulator fits mean, sine and cosine by
//! least squares, without the samples during the ringing, where the sawtooth is largest.

use crate::angle::phase_of;
use core::f32::consts::{PI, TAU};
use kband::arithmetic::sine_cosine_single;
use num_complex::Complex32 as Complex;

/// Bias of the fit over `J` and the blanked share: 0.43 (one phase) to 0.3 (scatter).
const BLANKING_BIAS: f32 = 0.35;

/// Weight of the impacts' impulse over that in the fundamental, with this share of the cycle blanked.
pub fn impulse_weight(share: f32) -> f32 {
    1.0 + PI * BLANKING_BIAS * share
}

/// Coefficient of the conjugate of (last minus present motion) in the demodulated motion: blanked
/// samples repeat the last cycle. `at` is `e^(-i phase)` of the middle of the blanked interval.
pub fn last_cycle_gain(at: Complex, share: f32) -> Complex {
    let (sine, _) = sine_cosine_single(phase_of(TAU * share));
    at * at * (-sine / (TAU * (1.0 - share)))
}
