//! The resonant drive and the track that it shakes.

use core::f32::consts::{PI, TAU};

use num_complex::{Complex32 as Complex, Complex64};

use super::scene::DriveModel;
use crate::arithmetic::Phase;
use crate::arithmetic::sine_cosine_single;
use crate::control::{SAMPLE_RATE, SecondTone, phase_of};

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
        // At resonance the displacement is Q times the static one.
        let force = f64::from(model.gain) * 1e-3 / f64::from(model.quality);
        Self::of(f64::from(model.resonance), f64::from(model.quality), force)
    }

    /// The resonator of a frequency in Hz and a quality factor at rest, displaced by `force` (m) under full output.
    #[must_use]
    pub fn of(resonance: f64, quality: f64, force: f64) -> Self {
        // x'' + 2 zeta w0 x' + w0^2 x = w0^2 F; in (x, v/w0): x' = w0 y, y' = w0 (F - x - 2 zeta y).
        let w0 = resonance * core::f64::consts::TAU;
        let zeta = 0.5 / quality;
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
    /// The second tone.
    pub second: SecondTone,
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
            second: SecondTone::NONE,
        }
    }

    /// This swing with a second tone that passes through a displacement (m) and a velocity (m/s) of its own.
    #[must_use]
    pub fn with(self, motion: [f32; 2], angular: f32) -> Self {
        let second = Self::through(motion, 2.0 * angular);
        let apart = second.phase - self.phase - self.phase;
        Self {
            second: SecondTone {
                ratio: second.amplitude / self.amplitude,
                phase: apart.bits() as i32 as f32 * (TAU / Phase::TURN as f32),
            },
            ..self
        }
    }
}

/// Which mode, beside the resonance, makes the track answer at twice the drive's frequency as a model says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondMode {
    /// Its frequency in Hz.
    pub frequency: f64,
    /// Its quality factor.
    pub quality: f64,
    /// Its displacement in m under full output at rest; below 0 where it moves against the other.
    pub force: f64,
}

impl SecondMode {
    /// The mode of a model for a drive frequency in Hz; `None` where the resonance alone makes it so.
    #[must_use]
    pub fn of(model: &DriveModel, frequency: f64) -> Option<Self> {
        if model.second_gain <= 0.0 {
            return None;
        }
        let quality = f64::from(model.second_quality);
        // The output is held between samples: half of one more, which no mode makes.
        let held = core::f64::consts::TAU * frequency / f64::from(SAMPLE_RATE);
        let lag = f64::from(model.second_lag).to_radians() - held;
        let (sine, cosine) = libm::sincos(lag);
        let told = Complex64::new(cosine, -sine) * (f64::from(model.second_gain) * 1e-3);
        let missing = told - response(model, 2.0 * frequency);
        // A mode lags by less than half a turn; what lags by more moves against the output.
        let against = missing.im > 0.0;
        let missing = if against { -missing } else { missing };
        let size = libm::sqrt(missing.norm_sqr());
        if size < 1e-12 {
            return None;
        }
        // tan lag = (x/Q) / (1 - x^2).
        let tangent = -missing.re / missing.im.min(-1e-6 * size) / quality;
        let x = libm::sqrt(0.25 * tangent * tangent + 1.0) - 0.5 * tangent;
        let stiffness = Complex64::new(1.0 - x * x, x / quality);
        let force = size * libm::sqrt(stiffness.norm_sqr());
        Some(Self {
            frequency: 2.0 * frequency / x,
            quality,
            force: if against { -force } else { force },
        })
    }
}

/// What the resonance of a model answers to full output at a frequency in Hz, in m.
fn response(model: &DriveModel, frequency: f64) -> Complex64 {
    let (quality, x) = (
        f64::from(model.quality),
        frequency / f64::from(model.resonance),
    );
    let force = f64::from(model.gain) * 1e-3 / quality;
    Complex64::new(1.0 - x * x, x / quality).inv() * force
}

/// Tells the second tone of the track's motion from the first: it finds the tones of the output, and lets copies of the
/// drive's modes answer the second one alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TonesApart {
    first: Resonator,
    mode: Option<Resonator>,
    /// The output along sine and cosine of the phase and of its double.
    output: [f32; 4],
}

impl TonesApart {
    /// Of a drive at rest.
    #[must_use]
    pub fn new(first: Resonator, mode: Option<Resonator>) -> Self {
        Self {
            first,
            mode,
            output: [0.0; 4],
        }
    }

    /// Takes an output that is held for a sample, at a phase that advances by `step` a sample.
    ///
    /// Four numbers describe the output over a cycle; each sample corrects them by its share of what they do not
    /// explain (a projection of Kaczmarz), which is exact once nothing is left, and forgets a change in a quarter of
    /// a cycle.
    #[inline]
    pub fn step(&mut self, output: f32, phase: Phase, step: u32) {
        let (sine, cosine) = sine_cosine_single(phase);
        let tones = [
            sine,
            cosine,
            2.0 * sine * cosine,
            (cosine - sine) * (cosine + sine),
        ];
        let explained: f32 = tones.iter().zip(&self.output).map(|(t, o)| t * o).sum();
        let rate = (8.0 * step as f32 / Phase::TURN as f32).min(0.5);
        let error = rate * (output - explained);
        for (own, tone) in self.output.iter_mut().zip(tones) {
            *own += error * tone;
        }
        let second = self.output[2] * tones[2] + self.output[3] * tones[3];
        self.first.step(second);
        if let Some(mode) = &mut self.mode {
            mode.step(second);
        }
    }

    /// Displacement in m and velocity in m/s of the second tone.
    #[must_use]
    pub fn motion(&self) -> [f32; 2] {
        sum(self.first.motion(), self.mode.as_ref())
    }
}

/// A motion with that of a second mode.
pub fn sum(motion: [f32; 2], mode: Option<&Resonator>) -> [f32; 2] {
    let Some(mode) = mode else {
        return motion;
    };
    let [x, v] = mode.motion();
    [motion[0] + x, motion[1] + v]
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
