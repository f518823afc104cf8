//! Frequency response of the drive: configured, or that of a second-order resonance.

use core::f32::consts::PI;

use num_complex::Complex32 as Complex;

use super::shape::UPPER;
use crate::angle::SAMPLE_RATE;
use crate::settings::Settings;

/// The track's displacement in m at full output at twice and three times the drive's frequency,
/// against as many times the output's phase: `x = Im(response e^(i n phi))`.
pub fn upper_response(settings: &Settings) -> [Complex; UPPER] {
    let response = |gain: f32, lag: f32, frequency: f32| {
        if gain > 0.0 {
            let lag = lag * (PI / 180.0);
            Complex::new(libm::cosf(lag), -libm::sinf(lag)) * (gain * 1e-3)
        } else {
            resonant(settings, frequency)
        }
    };
    let once = settings.frequency;
    [
        response(settings.second_gain, settings.second_lag, 2.0 * once),
        response(settings.third_gain, settings.third_lag, 3.0 * once),
    ]
}

/// Response of the drive's resonance at a frequency in Hz, in m, with the output held between
/// samples.
fn resonant(settings: &Settings, frequency: f32) -> Complex {
    let x = frequency / settings.resonance;
    let denominator = Complex::new(1.0 - x * x, x / settings.quality);
    let lag = PI * frequency / SAMPLE_RATE as f32;
    Complex::new(libm::cosf(lag), -libm::sinf(lag)) * (settings.gain * 1e-3 / settings.quality)
        / denominator
}
