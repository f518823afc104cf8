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

#[cfg(test)]
mod tests {
    use super::*;

    /// Bias of the least-squares cosine of the sawtooth, for impacts with this scatter and blanked
    /// share. The motion is even in the phase, so only cosine and mean are fitted.
    fn fitted_bias(scatter: f64, share: f64) -> f64 {
        let turn = core::f64::consts::TAU;
        let motion = |phase: f64| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for n in -20..=20 {
                let deviation = f64::from(n) * 0.15;
                let contribution = libm::exp(-0.5 * deviation * deviation);
                let at = phase - deviation * scatter;
                let since = at - turn * libm::floor(at / turn);
                sum += contribution * (0.5 - since / turn) * libm::sin(at);
                weight += contribution;
            }
            sum / weight
        };
        let fit = |share: f64| {
            let [mut count, mut x, mut xx, mut y, mut xy] = [0.0; 5];
            for n in 0..720 {
                let phase = (f64::from(n) - 359.5) / 720.0 * turn;
                if phase.abs() >= 0.5 * share * turn {
                    let (cosine, moved) = (libm::cos(phase), motion(phase));
                    count += 1.0;
                    x += cosine;
                    xx += cosine * cosine;
                    y += moved;
                    xy += cosine * moved;
                }
            }
            (xy - x * y / count) / (xx - x * x / count)
        };
        fit(share) - fit(0.0)
    }

    #[test]
    fn sawtooth_lies_between_one_phase_and_wide_scatter() {
        for share in [0.1, 0.2, 0.3] {
            let [one, wide] = [0.0, 0.4].map(|scatter| fitted_bias(scatter, share));
            let modelled = f64::from(BLANKING_BIAS) * share;
            let holds = wide < modelled && modelled < one;
            assert!(holds, "{share}: {wide} {modelled} {one}");
        }
    }

    /// The motion was `last` in the previous cycle and is `now`.
    #[test]
    fn blanked_samples_repeat_the_last_cycle() {
        let (last, now) = (Complex::new(1.1, 0.2), Complex::new(0.9, -0.1));
        let (middle, share) = (2.0_f32, 0.25);
        let mut actual = Complex::new(0.0, 0.0);
        let count = 3600;
        for n in 0..count {
            let phase = (n as f32 + 0.5) / count as f32 * TAU;
            let turn = Complex::new(libm::cosf(phase), libm::sinf(phase));
            let blanked = (phase - middle).abs() < 0.5 * share * TAU;
            let reading = if blanked { last } else { now };
            actual += turn.conj() * (reading * turn).im * 2.0;
            if blanked {
                actual -= last * Complex::new(0.0, -1.0);
            }
        }
        // Im(c e^(i phase)) against e^(-i phase) is -i c.
        let actual = actual * Complex::new(0.0, 1.0) / (count as f32 * (1.0 - share));
        let at = Complex::new(libm::cosf(middle), -libm::sinf(middle));
        let expected = now + last_cycle_gain(at, share) * (last - now).conj();
        assert!((actual - expected).norm_sqr() < 1e-7, "{actual} {expected}");
    }
}
