//! The second tone of the track from cycle to cycle: one complex envelope for each of the drive's modes.

use core::f64::consts::TAU;

use heapless::Vec;
use num_complex::Complex64 as Complex;

use super::drive::{SecondMode, Swing};
use super::recurrence::{exp, turn};
use super::scene::DriveModel;
use crate::arithmetic::Phase;
use crate::control::{SAMPLE_RATE, SecondTone, phase_of};

/// A mode of the drive under the second tone. With the output `Im(U e^(2 i phi))` its displacement is
/// `Im(X e^(2 i phi))`, and X goes to the answer times U as the mode decays, seen from the turning phase; what turns
/// against it is left out.
#[derive(Clone, Copy, Debug)]
struct Mode {
    model: SecondMode,
    /// Displacement in m for unit output of the first tone and of the second.
    answers: [Complex; 2],
    /// `ln` of decay and turn of a sample, against the doubled phase.
    drift: Complex,
    /// Acceleration in 1/s^2 of a unit of the transient.
    surge: Complex,
    /// X at the sample that began the cycle, where it goes, and what is left of the way.
    state: Complex,
    steady: Complex,
    transient: Complex,
}

impl Mode {
    fn tune(&mut self, angular: f64) {
        let natural = TAU * self.model.frequency;
        let per_sample = 1.0 / f64::from(SAMPLE_RATE);
        self.answers = [1.0, 2.0].map(|n: f64| {
            let x = n * angular / natural;
            let half = 0.5 * n * angular * per_sample;
            // An output that is held between samples is half of one late.
            Complex::new(1.0 - x * x, x / self.model.quality).inv()
                * turn(-half)
                * (self.model.force * libm::sin(half) / half)
        });
        let zeta = 0.5 / self.model.quality;
        let damped = libm::sqrt((1.0 - zeta * zeta).max(0.0));
        let own = Complex::new(-zeta, damped) * natural;
        self.drift = (own - Complex::new(0.0, 2.0 * angular)) * per_sample;
        self.surge = own * own;
    }

    /// X a number of samples after the one that began the cycle.
    fn at(&self, samples: f64) -> Complex {
        self.steady + self.transient * exp(self.drift * samples)
    }
}

/// The second tone of a drive, and what its second mode adds to the first one.
#[derive(Clone, Debug)]
pub struct SecondEnvelope {
    modes: Vec<Mode, 2>,
    step: u32,
    angular: f64,
    /// What a second mode adds to the first tone in this cycle, in m.
    added: Complex,
}

impl SecondEnvelope {
    /// Of a drive at rest, at a frequency in Hz; `None` where it has no second tone and no second mode.
    pub fn build(model: &DriveModel, frequency: f64, two_toned: bool) -> Option<Self> {
        let mode = SecondMode::of(model, frequency);
        if !two_toned && mode.is_none() {
            return None;
        }
        let quality = f64::from(model.quality);
        let resonance = SecondMode {
            frequency: f64::from(model.resonance),
            quality,
            force: f64::from(model.gain) * 1e-3 / quality,
        };
        let zero = Complex::new(0.0, 0.0);
        let modes = core::iter::once(resonance).chain(mode).map(|model| Mode {
            model,
            answers: [zero; 2],
            drift: zero,
            surge: zero,
            state: zero,
            steady: zero,
            transient: zero,
        });
        Some(Self {
            modes: modes.collect(),
            step: 0,
            angular: 0.0,
            added: zero,
        })
    }

    /// Begins a cycle with the output's first tone (real part; the imaginary one leads by a quarter turn), its second
    /// one likewise, and a step of the phase.
    pub fn begin(&mut self, first: Complex, second: Complex, step: u32) {
        if step != self.step {
            self.step = step;
            self.angular = f64::from(step) * (TAU * f64::from(SAMPLE_RATE) / Phase::TURN);
            for mode in &mut self.modes {
                mode.tune(self.angular);
            }
        }
        for mode in &mut self.modes {
            mode.steady = mode.answers[1] * second;
            mode.transient = mode.state - mode.steady;
        }
        self.added = match self.modes.get(1) {
            Some(mode) => mode.answers[0] * first,
            None => Complex::new(0.0, 0.0),
        };
    }

    /// Ends a cycle of a number of samples: what the demodulators find in it beside the first tone of the resonance, as
    /// cosine and sine parts of the acceleration in m/s^2 at the drive's frequency and at twice of it.
    pub fn end(&mut self, samples: u32) -> [[f64; 2]; 2] {
        let (count, double) = (f64::from(samples), 2.0 * self.angular);
        let mut found = Complex::new(0.0, 0.0);
        for mode in &mut self.modes {
            let whole = mode.drift * count;
            let left = exp(whole);
            let mean = (left - 1.0) / whole;
            found += mode.steady * (-double * double) + mode.transient * mode.surge * mean;
            mode.state = mode.steady + mode.transient * left;
        }
        let first = self.added * (-self.angular * self.angular);
        [[first.im, first.re], [found.im, found.re]]
    }

    /// Largest acceleration in m/s^2 that it may add: a bound.
    pub fn loudest(&self) -> f64 {
        let size = |z: Complex| libm::sqrt(z.norm_sqr());
        let second = self.modes.iter().map(|mode| {
            4.0 * size(mode.steady) * self.angular * self.angular
                + size(mode.transient) * size(mode.surge)
        });
        size(self.added) * self.angular * self.angular + second.sum::<f64>()
    }

    /// Acceleration in m/s^2 that it adds, a number of samples after the one that began the cycle, where the output has
    /// the phase `phase`.
    pub fn acceleration(&self, samples: f64, phase: f64) -> f64 {
        let double = 2.0 * self.angular;
        let mut sum = self.added * turn(phase) * (-self.angular * self.angular);
        for mode in &self.modes {
            let transient = mode.transient * exp(mode.drift * samples) * mode.surge;
            sum += (mode.steady * (-double * double) + transient) * turn(2.0 * phase);
        }
        sum.im
    }

    /// The swing of the resonance under the first tone with all that is added to it, a number of samples after the one
    /// that began the cycle, where the output has the phase `phase`.
    pub fn complete(&self, swing: Swing, samples: f64, phase: Phase) -> Swing {
        let alone = turn((swing.phase - phase).radians()) * f64::from(swing.amplitude);
        let first = alone + self.added;
        let second: Complex = self.modes.iter().map(|mode| mode.at(samples)).sum();
        let size = libm::sqrt(first.norm_sqr());
        if size <= 0.0 {
            return swing;
        }
        let square = first * first;
        let shape = second * square.conj() / (size * size * size);
        Swing {
            amplitude: size as f32,
            phase: phase + phase_of(libm::atan2f(first.im as f32, first.re as f32)),
            second: SecondTone {
                ratio: libm::sqrt(shape.norm_sqr()) as f32,
                phase: libm::atan2(shape.im, shape.re) as f32,
            },
        }
    }
}
