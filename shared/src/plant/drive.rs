//! The resonant drive and the track that it shakes.

use core::f32::consts::{PI, TAU};

use num_complex::Complex32 as Complex;

use super::scene::DriveModel;
use crate::arithmetic::Phase;
use crate::control::{SAMPLE_RATE, phase_of};

/// A resonator driven by an output that is held between samples: exact at the samples, in the
/// rotating pair (x, v / w0), where the step is a decay and a turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resonator {
    /// Damped turn and decay of one sample: the state's matrix by rows.
    matrix: [[f32; 2]; 2],
    /// What a unit of force adds in one sample.
    input: [f32; 2],
    /// Displacement in m and velocity over the natural angular frequency in m.
    state: [f32; 2],
    natural: f32,
    damping: f32,
}

impl Resonator {
    /// The resonator of a drive model at rest.
    #[must_use]
    pub fn new(model: &DriveModel) -> Self {
        // x'' + 2 zeta w0 x' + w0^2 x = w0^2 F; in (x, v/w0): x' = w0 y, y' = w0 (F - x - 2 zeta y).
        let w0 = f64::from(model.resonance) * core::f64::consts::TAU;
        let zeta = 0.5 / f64::from(model.quality);
        let h = 1.0 / f64::from(SAMPLE_RATE);
        let damped = libm::sqrt(1.0 - zeta * zeta);
        let decay = libm::exp(-zeta * w0 * h);
        let (s, c) = libm::sincos(damped * w0 * h);
        let matrix = [
            [decay * (c + zeta / damped * s), decay * s / damped],
            [-decay * s / damped, decay * (c - zeta / damped * s)],
        ];
        // At rest under a unit force the state is (1, 0): the input is what the matrix leaves of it.
        let input = [1.0 - matrix[0][0], -matrix[1][0]];
        // At resonance the displacement is Q times the static one.
        let force = f64::from(model.gain) * 1e-3 / f64::from(model.quality);
        Self {
            matrix: matrix.map(|row| row.map(|entry| entry as f32)),
            input: input.map(|entry| (entry * force) as f32),
            state: [0.0; 2],
            natural: w0 as f32,
            damping: (2.0 * zeta) as f32,
        }
    }

    /// Holds an output (-1..1, times the gain's factor) for one sample.
    #[inline]
    pub fn step(&mut self, output: f32) {
        let [x, y] = self.state;
        let [[a, b], [c, d]] = self.matrix;
        self.state = [
            a * x + b * y + self.input[0] * output,
            c * x + d * y + self.input[1] * output,
        ];
    }

    /// Displacement in m and velocity in m/s.
    #[must_use]
    pub fn motion(&self) -> [f32; 2] {
        [self.state[0], self.state[1] * self.natural]
    }

    /// Acceleration in m/s^2 under an output.
    #[inline]
    #[must_use]
    pub fn acceleration(&self, output: f32, force: f32) -> f32 {
        self.natural
            * self.natural
            * (force * output - self.state[0] - self.damping * self.state[1])
    }
}

/// The track's harmonic motion at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swing {
    /// Normal amplitude (symbol b) in m.
    pub amplitude: f32,
    /// Phase of the track, 0 where it passes its middle upwards.
    pub phase: Phase,
}

impl Swing {
    /// The swing at an angular frequency (rad/s) that passes through this displacement and velocity.
    #[must_use]
    pub fn through(motion: [f32; 2], angular: f32) -> Self {
        let [x, v] = motion;
        let quadrature = v / angular;
        Self {
            amplitude: libm::sqrtf(x * x + quadrature * quadrature),
            phase: phase_of(libm::atan2f(x, quadrature)),
        }
    }
}

/// Ringing of the track under impacts: a damped oscillator that the accelerometer hears.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ringing {
    /// Turn and decay of a sample.
    turn: Complex,
    state: Complex,
    angle: f32,
    decay: f32,
}

impl Ringing {
    /// A ringing at a frequency in Hz that decays in a time in s.
    #[must_use]
    pub fn new(frequency: f32, decay: f32) -> Self {
        let h = 1.0 / SAMPLE_RATE as f32;
        let angle = TAU * frequency * h;
        let keep = libm::expf(-h / decay);
        Self {
            turn: turn(angle) * keep,
            state: Complex::default(),
            angle,
            decay: h / decay,
        }
    }

    /// Adds an impact of a height in m/s^2 that happened a share of a sample (0..1) before the sample
    /// that comes next.
    pub fn strike(&mut self, height: f32, share: f32) {
        let height = height * libm::expf(-self.decay * share);
        self.state += turn(self.angle * share) * height;
    }

    /// Nothing rings.
    pub fn silence(&mut self) {
        self.state = Complex::default();
    }

    /// Acceleration now, in m/s^2.
    #[must_use]
    pub fn acceleration(&self) -> f32 {
        self.state.im
    }

    /// Goes one sample on.
    #[inline]
    pub fn step(&mut self) {
        self.state *= self.turn;
    }
}

/// `e^(i angle)`, with one function for both parts.
fn turn(angle: f32) -> Complex {
    Complex::new(libm::sinf(PI * 0.5 - angle), libm::sinf(angle))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::sine_cosine_single;
    use crate::control::phase_step;

    fn steady(frequency: f32) -> Swing {
        let model = DriveModel::default();
        let mut drive = Resonator::new(&model);
        let mut phase = Phase::ZERO;
        let step = phase_step(frequency);
        // 3 s are 19 time constants of the envelope.
        for _ in 0..60_000 {
            let (sine, _) = sine_cosine_single(phase);
            drive.step(0.2 * sine);
            phase += Phase::from_bits(step);
        }
        let mut swing = Swing::through(drive.motion(), TAU * frequency);
        swing.phase = swing.phase - phase;
        swing
    }

    #[test]
    fn at_resonance_it_swings_by_its_gain_a_quarter_turn_late() {
        let swing = steady(50.0);
        // Rounding of the matrix to f32 shifts the decay by 6e-8 of 3e-4 a sample.
        assert!((swing.amplitude / 0.2e-3 - 1.0).abs() < 1e-3, "{swing:?}");
        let lead = swing.phase.bits() as i32 as f32 * (TAU / Phase::TURN as f32);
        // The held output is half a sample (0.008 rad) late on top.
        assert!((lead + PI / 2.0 + 0.008).abs() < 2e-3, "{lead}");
    }

    #[test]
    fn half_a_bandwidth_off_it_loses_three_decibels() {
        let swing = steady(51.0);
        // Response at w: 1 / sqrt((1 - x^2)^2 + (x / Q)^2) static, x = 1.02.
        let x = 1.02_f32;
        let expected = 1.0 / libm::sqrtf((1.0 - x * x) * (1.0 - x * x) + (x / 25.0) * (x / 25.0));
        assert!((swing.amplitude / (0.2e-3 / 25.0) / expected - 1.0).abs() < 2e-3);
    }
}
