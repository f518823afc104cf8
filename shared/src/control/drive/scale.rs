//! What an amplitude means at the drive's frequency: for the parts, for the hard limits, for the output.

use core::f32::consts::{PI, TAU};

use crate::control::angle::phase_step;
use crate::control::settings::Settings;
use crate::control::state::Limits;
use crate::feeder::STANDARD_GRAVITY;

/// Steps of the converter that a swing has to have to be told from rest.
const TELLS: f32 = 8.0;
/// How far the envelope that the outputs should give may go over the hard limits.
const OVER: f32 = 1.2;

/// Response of the drive at its frequency over the one at resonance.
fn response(settings: &Settings) -> f32 {
    let x = settings.frequency / settings.resonance;
    if settings.tracking > 0.0 || x == 1.0 {
        return 1.0;
    }
    let (detuned, damped) = (1.0 - x * x, x / settings.quality);
    1.0 / (settings.quality * libm::sqrtf(detuned * detuned + damped * damped))
}

/// The numbers that amplitude, k and output hang together by.
#[derive(Clone, Copy, Debug)]
pub struct Scale {
    /// Gravity normal to the track (symbol g cos alpha) in m/s^2, as [`Track::normal_gravity`] in single
    /// precision.
    ///
    /// [`Track::normal_gravity`]: crate::feeder::Track::normal_gravity
    pub normal_gravity: f32,
    /// Square of the angular frequency, in 1/s^2.
    pub square: f32,
    /// Advance of the phase per sample.
    pub step: u32,
    /// Largest amplitude that both hard limits allow, in m.
    pub ceiling: f32,
    /// The hard limit that it is.
    pub ceiling_limit: Limits,
    /// Share of the drive's envelope that a cycle leaves.
    pub keep: f32,
    /// Amplitude for full output at the drive's frequency, in m; where the frequency follows the resonance, the
    /// one at resonance.
    pub strength: f32,
    /// Amplitude in m that the converter tells from rest.
    pub least: f32,
}

impl Scale {
    /// The numbers at a frequency in Hz.
    pub fn at(settings: &Settings, frequency: f32) -> Self {
        let mut scale = Self {
            normal_gravity: settings.gravity * libm::cosf(settings.incline * (PI / 180.0)),
            square: 0.0,
            step: 0,
            ceiling: 0.0,
            ceiling_limit: Limits::AMPLITUDE,
            keep: libm::expf(-PI / settings.quality),
            strength: settings.gain * 1e-3 * response(settings),
            least: 0.0,
        };
        scale.retune(settings, frequency);
        scale
    }

    /// What depends on the drive's frequency, in Hz.
    pub fn retune(&mut self, settings: &Settings, frequency: f32) {
        let angular = TAU * frequency;
        self.square = angular * angular;
        self.step = phase_step(frequency);
        let step = settings.converter_reference
            / (libm::exp2f(settings.converter_bits) * settings.sensitivity)
            * STANDARD_GRAVITY as f32;
        self.least = TELLS * step / self.square;
        let by_acceleration = settings.acceleration_limit / self.square;
        let by_amplitude = settings.amplitude_limit * 1e-3;
        self.ceiling = by_acceleration.min(by_amplitude);
        self.ceiling_limit = if by_acceleration < by_amplitude {
            Limits::ACCELERATION
        } else {
            Limits::AMPLITUDE
        };
    }

    /// k at a normal amplitude in m.
    pub fn k(&self, amplitude: f32) -> f32 {
        self.normal_gravity / (amplitude * self.square)
    }

    /// Normal amplitude in m at a k.
    pub fn amplitude(&self, k: f32) -> f32 {
        self.normal_gravity / (k * self.square)
    }

    /// Largest amplitude in m that the settings let the drive reach.
    pub fn reach(&self, settings: &Settings) -> f32 {
        // Response of the resonance at the drive's frequency over the one at resonance.
        let x = settings.frequency / settings.resonance;
        let (detuned, damped) = (1.0 - x * x, x / settings.quality);
        let response = 1.0 / (settings.quality * libm::sqrtf(detuned * detuned + damped * damped));
        (settings.output_maximum * settings.gain * 1e-3 * response).min(self.ceiling)
    }

    /// Largest output for the next cycle, as a share of full output: with the drive's set gain, whatever the
    /// accelerometer says, it takes an envelope (m) no further than a fifth over the hard limits.
    pub fn most_output(&self, envelope: f32) -> f32 {
        let room = OVER * self.ceiling - self.keep * envelope;
        (room / ((1.0 - self.keep) * self.strength)).max(0.0)
    }

    /// The envelope (m) after a cycle at an output.
    pub fn after(&self, envelope: f32, output: f32) -> f32 {
        self.keep * envelope + (1.0 - self.keep) * output * self.strength
    }

    /// How far a kick may go over an amplitude within the drive's output and hard limits.
    pub fn reserve(&self, settings: &Settings, amplitude: f32) -> f32 {
        // The first cycle of a step of the command from 1 to f needs an output of 1 + s (f - 1), with s
        // the step of the reference over the step of the drive's own envelope.
        let steeper = (1.0 - libm::expf(-1.0 / settings.envelope)) / (1.0 - self.keep);
        let strength = settings.output_maximum * settings.gain * 1e-3 / amplitude;
        (1.0 + (strength - 1.0) / steeper.max(1.0)).min(self.ceiling / amplitude)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gravity_normal_to_the_track_is_the_track_s_in_single_precision() {
        for n in -60..=60 {
            let settings = Settings {
                incline: n as f32,
                ..Settings::default()
            };
            let single = f64::from(Scale::at(&settings, 50.0).normal_gravity);
            let double = settings.track().unwrap().normal_gravity();
            // Roundings of the angle (60 degrees in rad times the tangent there: 1.8), of the cosine and of the product.
            assert!(
                (single / double - 1.0).abs() < 2.5e-7,
                "{n}: {single} {double}"
            );
        }
    }
}
