//! Upper tones of the track in steps of a drive cycle: one slow envelope per tone and mode.

use super::recurrence::{exp, turn};
use crate::model::drive::{Swing, UpperMode};
use crate::model::scene::DriveModel;
use core::f64::consts::TAU;
use heapless::Vec;
use kband::arithmetic::Phase;
use kband_control::{SAMPLE_RATE, Shape, UPPER, UpperTone, phase_of};
use num_complex::Complex64 as Complex;

/// A mode under one upper tone: under `Im(U e^(i n phi))` its displacement is `Im(X e^(i n phi))`.
///
/// X converges to the response times U at the mode's decay; the counter-rotating term is neglected.
#[derive(Clone, Copy, Debug, Default)]
struct Driven {
    /// Displacement in m per unit output.
    response: Complex,
    /// Logarithm of decay and rotation per sample, relative to the multiple of the phase.
    drift: Complex,
    /// X at the first sample of the cycle, its limit, and its remaining difference.
    state: Complex,
    steady: Complex,
    transient: Complex,
}

#[derive(Clone, Copy, Debug)]
struct Mode {
    model: UpperMode,
    /// Displacement in m per unit output of the first tone.
    response: Complex,
    /// Acceleration per unit transient in 1/s^2.
    square: Complex,
    tones: [Driven; UPPER],
}

/// A tone's frequency over the drive's frequency.
fn harmonic(tone: usize) -> f64 {
    tone as f64 + 2.0
}

impl Mode {
    fn tune(&mut self, angular: f64) {
        let natural = TAU * self.model.frequency;
        let per_sample = 1.0 / f64::from(SAMPLE_RATE);
        let response = |n: f64| {
            let x = n * angular / natural;
            let half = 0.5 * n * angular * per_sample;
            // The zero-order hold adds half a sample of delay.
            Complex::new(1.0 - x * x, x / self.model.quality).inv()
                * turn(-half)
                * (self.model.force * libm::sin(half) / half)
        };
        let zeta = 0.5 / self.model.quality;
        let damped = libm::sqrt((1.0 - zeta * zeta).max(0.0));
        let eigenvalue = Complex::new(-zeta, damped) * natural;
        self.response = response(1.0);
        self.square = eigenvalue * eigenvalue;
        for (n, tone) in self.tones.iter_mut().enumerate() {
            let n = harmonic(n);
            tone.response = response(n);
            tone.drift = (eigenvalue - Complex::new(0.0, n * angular)) * per_sample;
        }
    }
}

/// The upper tones of a drive, and the contribution of its upper modes to the first tone.
#[derive(Clone, Debug)]
pub struct UpperEnvelope {
    modes: Vec<Mode, { 1 + UPPER }>,
    pub tones: usize,
    step: u32,
    angular: f64,
    /// Contribution of the upper modes to the first tone in this cycle, in m.
    added: Complex,
}

impl UpperEnvelope {
    /// A drive at rest with so many upper tones, at a frequency in Hz; `None` if it has none.
    pub fn build(model: &DriveModel, frequency: f64, tones: usize) -> Option<Self> {
        let modes = UpperMode::fit_configured(model, frequency);
        if tones == 0 && modes.is_empty() {
            return None;
        }
        let resonance = core::iter::once(UpperMode::resonance(model));
        let modes = resonance.chain(modes).map(|model| Mode {
            model,
            response: Complex::ZERO,
            square: Complex::ZERO,
            tones: [Driven::default(); UPPER],
        });
        Some(Self {
            modes: modes.collect(),
            tones,
            step: 0,
            angular: 0.0,
            added: Complex::ZERO,
        })
    }

    /// Begins a cycle with the complex outputs of the first and the upper tones and a phase step.
    pub fn begin(&mut self, first: Complex, upper: [Complex; UPPER], step: u32) {
        if step != self.step {
            self.step = step;
            self.angular = f64::from(step) * (TAU * f64::from(SAMPLE_RATE) / Phase::TURN);
            for mode in &mut self.modes {
                mode.tune(self.angular);
            }
        }
        for mode in &mut self.modes {
            for (tone, output) in mode.tones.iter_mut().zip(upper).take(self.tones) {
                tone.steady = tone.response * output;
                tone.transient = tone.state - tone.steady;
            }
        }
        let above = self.modes.iter().skip(1);
        self.added = above.map(|mode| mode.response * first).sum();
    }

    /// Ends a cycle and returns the demodulated acceleration beside that of the resonance's first
    /// tone. Values are cosine and sine parts in m/s^2, at the drive's frequency and its multiples.
    pub fn end(&mut self, samples: u32) -> (Complex, [[f64; 2]; UPPER]) {
        let count = f64::from(samples);
        let mut sums = [Complex::ZERO; UPPER];
        for mode in &mut self.modes {
            let tones = mode.tones.iter_mut().zip(&mut sums).take(self.tones);
            for (n, (tone, sums)) in tones.enumerate() {
                let angular = harmonic(n) * self.angular;
                let exponent = tone.drift * count;
                let decay = exp(exponent);
                let mean = (decay - 1.0) / exponent;
                *sums += tone.steady * (-angular * angular) + tone.transient * mode.square * mean;
                tone.state = tone.steady + tone.transient * decay;
            }
        }
        let first = self.added * (-self.angular * self.angular);
        (
            Complex::new(first.im, first.re),
            sums.map(|tone| [tone.im, tone.re]),
        )
    }

    fn driven(&self) -> impl Iterator<Item = (&Mode, usize, &Driven)> {
        self.modes.iter().flat_map(|mode| {
            let tones = mode.tones.iter().take(self.tones).enumerate();
            tones.map(move |(n, tone)| (mode, n, tone))
        })
    }

    /// Upper bound of the added acceleration in m/s^2.
    pub fn max_acceleration(&self) -> f64 {
        let size = |z: Complex| libm::sqrt(z.norm_sqr());
        let above = self.driven().map(|(mode, n, tone)| {
            let angular = harmonic(n) * self.angular;
            size(tone.steady) * angular * angular + size(tone.transient) * size(mode.square)
        });
        size(self.added) * self.angular * self.angular + above.sum::<f64>()
    }

    /// Added acceleration in m/s^2, `samples` after the first of the cycle, at an output phase.
    pub fn acceleration(&self, samples: f64, phase: f64) -> f64 {
        let mut sum = self.added * turn(phase) * (-self.angular * self.angular);
        for (mode, n, tone) in self.driven() {
            let angular = harmonic(n) * self.angular;
            let transient = tone.transient * exp(tone.drift * samples) * mode.square;
            sum += (tone.steady * (-angular * angular) + transient) * turn(harmonic(n) * phase);
        }
        sum.im
    }

    /// Swing with all contributions, `samples` after the first of the cycle, at an output phase.
    pub fn complete(&self, swing: Swing, samples: f64, phase: Phase) -> Swing {
        let single = turn((swing.phase - phase).radians()) * f64::from(swing.amplitude);
        let first = single + self.added;
        let size = libm::sqrt(first.norm_sqr());
        if size <= 0.0 {
            return swing;
        }
        let mut upper = [Complex::ZERO; UPPER];
        for (_, n, tone) in self.driven() {
            if let Some(sum) = upper.get_mut(n) {
                *sum += tone.steady + tone.transient * exp(tone.drift * samples);
            }
        }
        // The phase of the nth tone is relative to n times that of the first.
        let (mut power, mut long) = (first, size * size);
        let [second, third] = upper.map(|tone| {
            power *= first;
            long *= size;
            let shape = tone * power.conj() / long;
            let ratio = libm::sqrt(shape.norm_sqr()) as f32;
            UpperTone::new(ratio, libm::atan2(shape.im, shape.re) as f32)
        });
        Swing {
            amplitude: size as f32,
            phase: phase + phase_of(libm::atan2f(first.im as f32, first.re as f32)),
            shape: Shape { second, third },
        }
    }
}
