//! What the drive answers to an output: the track's motion at its frequency and at twice of it.

use core::f32::consts::PI;

use num_complex::Complex32 as Complex;

use crate::control::angle::SAMPLE_RATE;
use crate::control::settings::Settings;

/// The track's displacement in m for full output, against the output's phase: `x = Im(answer e^(i phi))`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// At twice the drive's frequency, against its doubled phase.
    pub second: Complex,
}

impl Answer {
    /// The answer that the settings tell of.
    pub fn at(settings: &Settings) -> Self {
        let second = if settings.second_gain > 0.0 {
            let lag = settings.second_lag * (PI / 180.0);
            Complex::new(libm::cosf(lag), -libm::sinf(lag)) * (settings.second_gain * 1e-3)
        } else {
            resonant(settings, 2.0 * settings.frequency)
        };
        Self { second }
    }
}

/// The answer of the drive's one resonance at a frequency in Hz, with the output held between samples.
pub fn resonant(settings: &Settings, frequency: f32) -> Complex {
    let x = frequency / settings.resonance;
    let denominator = Complex::new(1.0 - x * x, x / settings.quality);
    let held = PI * frequency / SAMPLE_RATE as f32;
    Complex::new(libm::cosf(held), -libm::sinf(held)) * (settings.gain * 1e-3 / settings.quality)
        / denominator
}
