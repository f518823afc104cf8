//! Envelope of the track's amplitude under the output, cycle by cycle (slowly varying amplitude).
//!
//! The resonance has the poles `-w0/(2 Q) +- i w0 sqrt(1 - 1/(4 Q^2))`. The envelope is a phasor in
//! the drive's frame, over its steady value. In a cycle it decays and rotates by `pole = e^(-pi
//! w0/(Q w) + i 2 pi (w0 sqrt(1 - 1/(4 Q^2))/w - 1))` (rotating-wave approximation).

use crate::angle::unit_phasor;
use crate::settings::Settings;
use core::f32::consts::{PI, TAU};
use kband::arithmetic::square_root_single;
use num_complex::Complex32 as Complex;

/// Rotation of the envelope within its time constant, in rad, below which it is a first-order lag.
const MAX_FIRST_ORDER_TURN: f32 = 0.3;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Envelope {
    /// Share of the distance to the steady envelope that remains after a cycle.
    pub pole: Complex,
    /// Mean of that share over the cycle.
    mean: Complex,
    /// Time constant in cycles.
    pub cycles: f32,
    /// Whether the envelope is a first-order lag, so that its phase stays.
    pub first_order: bool,
    /// Steady amplitude over the one at resonance.
    pub response: f32,
    /// Phase lead of the steady track before the output, in rad, -pi..0, without the held output's.
    pub lead: f32,
}

impl Envelope {
    /// The envelope of the configured drive; the one at resonance if the frequency tracks it.
    pub fn from_settings(settings: &Settings) -> Self {
        let x = settings.frequency / settings.resonance;
        if settings.tracking > 0.0 || x == 1.0 {
            let pole = Complex::new(libm::expf(-PI / settings.quality), 0.0);
            return Self {
                pole,
                mean: Complex::new(0.5 * (1.0 + pole.re), 0.0),
                cycles: settings.quality * (1.0 / PI),
                first_order: true,
                response: 1.0,
                lead: -0.5 * PI,
            };
        }
        let cycles = settings.quality * (1.0 / PI) * x;
        let damped = 1.0 - 0.25 / (settings.quality * settings.quality);
        let turn = TAU * (square_root_single(damped) / x - 1.0);
        let decayed = libm::expf(-1.0 / cycles);
        let pole = unit_phasor(turn) * decayed;
        // The mean of `e^(t ln pole)` over a cycle.
        let mean = (pole - 1.0) / Complex::new(-1.0 / cycles, turn);
        let (detuned, width) = (1.0 - x * x, x / settings.quality);
        Self {
            pole,
            mean,
            cycles,
            first_order: turn.abs() * cycles <= MAX_FIRST_ORDER_TURN,
            response: 1.0
                / (settings.quality * square_root_single(detuned * detuned + width * width)),
            lead: -libm::atan2f(width, detuned),
        }
    }

    /// The envelope after a cycle at an output, over the steady one at full output.
    pub fn advance(&self, before: Complex, output: f32) -> Complex {
        if self.pole.im == 0.0 {
            let decay = self.pole.re;
            return Complex::new(decay * before.re + (1.0 - decay) * output, 0.0);
        }
        (before - output) * self.pole + output
    }

    /// Mean of the envelope over the cycle that begins at `before`.
    pub fn mean(&self, before: Complex, output: f32) -> Complex {
        (before - output) * self.mean + output
    }

    /// Largest output that keeps the envelope within `size` at the cycle's end; 0 if none does.
    pub fn output_limit(&self, before: Complex, size: f32) -> f32 {
        if self.pole.im == 0.0 {
            let decay = self.pole.re;
            return ((size - decay * before.re) / (1.0 - decay)).max(0.0);
        }
        // `|p z + (1 - p) u| = size`, a square in u.
        let (decayed, step) = (self.pole * before, Complex::new(1.0, 0.0) - self.pole);
        let square = step.norm_sqr();
        let half = (decayed.conj() * step).re / square;
        let discriminant = half * half + (size * size - decayed.norm_sqr()) / square;
        if discriminant > 0.0 {
            (square_root_single(discriminant) - half).max(0.0)
        } else {
            0.0
        }
    }
}

/// Absolute value of a phasor; exact to the last bit for a real one.
pub fn absolute(phasor: Complex) -> f32 {
    if phasor.im == 0.0 {
        phasor.re.abs()
    } else {
        square_root_single(phasor.norm_sqr())
    }
}
