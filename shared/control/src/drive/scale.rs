//! Conversion between amplitude, k and output at the drive's frequency; the hard limits.

use super::envelope::Envelope;
use crate::angle::unit_phasor;
use crate::{Limits, Settings, phase_of, phase_step};
use core::f32::consts::{PI, TAU};
use kband::arithmetic::sine_cosine_single;
use kband::feeder::STANDARD_GRAVITY;
use num_complex::Complex32 as Complex;

/// Smallest detectable swing in converter steps: a phase error of 0.04 rad at 500 Hz.
const MIN_RESOLVED_STEPS: f32 = 8.0;
/// Largest predicted envelope over the hard limits, above the over-amplitude fault.
const MAX_ENVELOPE_RATIO: f32 = 1.2;

/// Smallest detectable amplitude at the configured frequency, in m.
pub fn min_amplitude(settings: &Settings) -> f32 {
    let angular = TAU * settings.frequency;
    min_acceleration(settings) / (angular * angular)
}

/// Smallest detectable acceleration, in m/s^2.
fn min_acceleration(settings: &Settings) -> f32 {
    let step = settings.converter_reference
        / (libm::exp2f(settings.converter_bits) * settings.sensitivity)
        * STANDARD_GRAVITY as f32;
    MIN_RESOLVED_STEPS * step
}

#[derive(Clone, Copy, Debug, Default)]
pub struct Scale {
    /// Gravity normal to the track (symbol g cos alpha) in m/s^2.
    pub normal_gravity: f32,
    /// Square of the angular frequency, in 1/s^2.
    pub angular_squared: f32,
    /// Advance of the phase per sample.
    pub step: u32,
    /// Largest reference within both hard limits, in m.
    pub ceiling: f32,
    pub ceiling_limit: Limits,
    pub envelope: Envelope,
    /// Share of the envelope's size that survives a cycle, 0..1.
    decay: f32,
    /// Amplitude at full output and the drive's frequency, in m; at the resonance if it is tracked.
    pub full_amplitude: f32,
    /// Amplitude per ampere of the drive's current, in m/A; 0 if it is not commissioned.
    pub per_ampere: f32,
    /// Smallest detectable amplitude, in m.
    pub min_amplitude: f32,
}

impl Scale {
    /// The factors at the configured frequency.
    pub fn from_settings(settings: &Settings) -> Self {
        let envelope = Envelope::from_settings(settings);
        let mut scale = Self {
            normal_gravity: settings.gravity * unit_phasor(settings.incline * (PI / 180.0)).re,
            envelope,
            decay: libm::expf(-PI / settings.quality),
            full_amplitude: settings.gain * 1e-3 * envelope.response,
            per_ampere: settings.current_gain * 1e-3 * envelope.response,
            ..Self::default()
        };
        scale.retune(settings, settings.frequency);
        scale
    }

    /// Updates the factors that depend on the drive's frequency, in Hz.
    pub fn retune(&mut self, settings: &Settings, frequency: f32) {
        let angular = TAU * frequency;
        self.angular_squared = angular * angular;
        self.step = phase_step(frequency);
        self.min_amplitude = min_acceleration(settings) / self.angular_squared;
        let [amplitude, acceleration] = settings.reference_limits();
        let (by_amplitude, by_acceleration) =
            (amplitude * 1e-3, acceleration / self.angular_squared);
        self.ceiling = by_acceleration.min(by_amplitude);
        self.ceiling_limit = if by_acceleration < by_amplitude {
            Limits::ACCELERATION
        } else {
            Limits::AMPLITUDE
        };
    }

    /// k at a normal amplitude in m.
    pub fn k(&self, amplitude: f32) -> f32 {
        self.normal_gravity / (amplitude * self.angular_squared)
    }

    /// Normal amplitude in m at a k.
    pub fn amplitude(&self, k: f32) -> f32 {
        self.normal_gravity / (k * self.angular_squared)
    }

    /// Largest amplitude in m that the settings allow the drive.
    pub fn reach(&self, settings: &Settings) -> f32 {
        (settings.output_maximum * self.full_amplitude).min(self.ceiling)
    }

    /// Largest output for the next cycle, a share of full output. It keeps the predicted envelope
    /// within 1.2 of the hard limits, or within `amplitude` (m), without the accelerometer.
    pub fn output_limit(&self, envelope: Complex, amplitude: Option<f32>) -> f32 {
        let amplitude = amplitude.unwrap_or(MAX_ENVELOPE_RATIO * self.ceiling);
        (self.envelope).output_limit(envelope, amplitude / self.full_amplitude)
    }

    /// Whether a lead (rad) is more than a quarter turn from that of an envelope.
    pub fn is_opposed(&self, envelope: Complex, lead: f32) -> bool {
        let (sine, cosine) = sine_cosine_single(phase_of(lead - self.envelope.lead));
        envelope.re * cosine + envelope.im * sine < 0.0
    }

    /// Largest amplitude of a kick over an amplitude (m), within output and hard limits.
    pub fn max_kick(&self, settings: &Settings, amplitude: f32) -> f32 {
        // A command step from 1 to f needs an output of 1 + s (f - 1), with the steepness s.
        let rise_ratio = (1.0 - libm::expf(-1.0 / settings.envelope)) / (1.0 - self.decay);
        let output_ratio = settings.output_maximum * settings.gain * 1e-3 / amplitude;
        (1.0 + (output_ratio - 1.0) / rise_ratio.max(1.0)).min(self.ceiling / amplitude)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    #[test]
    fn reach_and_reserve_end_at_the_output_and_at_the_hard_limit() {
        let settings = Settings::default();
        let scale = Scale::from_settings(&settings);
        // Eight steps of 3.3 V / 4096 at 0.1 V/g are 0.632 m/s^2.
        let smallest = scale.min_amplitude;
        assert!((smallest - 6.4042e-6).abs() < 1e-9, "{smallest}");
        assert_eq!(smallest, min_amplitude(&settings));
        let steep = with(settings, |it| it.incline = -60.0);
        let gravity = Scale::from_settings(&steep).normal_gravity;
        assert!((gravity / (0.5 * settings.gravity) - 1.0).abs() < 2.5e-7);
        // The output's 0.95 mm are the limit; a millimetre is allowed.
        assert!((scale.reach(&settings) - 0.95e-3).abs() < 1e-9);
        let limited = with(settings, |it| it.amplitude_limit = 0.3);
        let scale = Scale::from_settings(&limited);
        assert_eq!(scale.reach(&limited), scale.ceiling);
        let actual = (scale.ceiling, scale.ceiling_limit);
        assert_eq!(actual, (0.3e-3, Limits::AMPLITUDE));
        let reserve = scale.max_kick(&limited, 0.2e-3);
        assert!((reserve - 1.5).abs() < 1e-6, "{reserve}");
        // 40 m/s^2 at 50 Hz are 0.405 mm.
        let gentle = with(settings, |it| it.acceleration_limit = 40.0);
        let scale = Scale::from_settings(&gentle);
        let ceiling = scale.ceiling;
        assert!((ceiling - 0.40528e-3).abs() < 1e-8, "{ceiling}");
        assert_eq!(scale.ceiling_limit, Limits::ACCELERATION);
    }

    /// The amplitude follows the command with `envelope`, the track follows the output with `decay`.
    #[test]
    fn the_largest_kick_needs_the_whole_output() {
        for envelope in [0.5, 2.0, 8.0, 40.0] {
            let settings = with(Settings::default(), |it| {
                (it.envelope, it.amplitude_limit, it.acceleration_limit) = (envelope, 50.0, 4e3);
            });
            let scale = Scale::from_settings(&settings);
            let full = settings.output_maximum * settings.gain * 1e-3;
            for share in [0.3, 0.6, 0.9] {
                let kick = scale.max_kick(&settings, share * full);
                let (mut command, mut largest) = (1.0, 0.0_f32);
                for _ in 0..1000 {
                    let next = kick + (command - kick) * libm::expf(-1.0 / envelope);
                    let output = (next - scale.decay * command) / (1.0 - scale.decay);
                    (command, largest) = (next, largest.max(output));
                }
                let used = largest * share;
                assert!((used - 1.0).abs() < 1e-4, "{envelope}, {share}: {used}");
            }
        }
    }

    #[test]
    fn no_output_takes_the_envelope_further() {
        let settings = with(Settings::default(), |it| it.amplitude_limit = 0.3);
        let scale = Scale::from_settings(&settings);
        let mut envelope = Complex::default();
        for _ in 0..200 {
            envelope = (scale.envelope).advance(envelope, scale.output_limit(envelope, None));
        }
        let reached = envelope.norm_sqr().sqrt() * scale.full_amplitude / scale.ceiling;
        assert!((reached - 1.2).abs() < 0.02, "{reached}");
    }
}
