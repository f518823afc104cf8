//! Resonant drive of the waveform plant: damped oscillators discretized exactly with zero-order
//! hold (K. J. Åström and B. Wittenmark, Computer-Controlled Systems, 1997).

use super::scene::{DriveModel, SensorModel};
use core::f32::consts::{PI, TAU};
use core::f64::consts::PI as PI64;
use heapless::Vec;
use kband::arithmetic::{Phase, sine_cosine_single};
use kband_control::{SAMPLE_RATE, Shape, UPPER, UpperTone, phase_of};
use num_complex::{Complex32 as Complex, Complex64};

/// A damped oscillator under a held output, exact at the samples: decay and rotation of (x, v/w0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resonator {
    /// State matrix of one sample, by rows.
    matrix: [[f32; 2]; 2],
    /// Change of the state in one sample per unit force.
    input: [f32; 2],
    /// Displacement in m and velocity over the natural angular frequency in m.
    state: [f32; 2],
    natural: f32,
    damping: f32,
}

impl Resonator {
    pub fn from_mode(mode: &UpperMode) -> Self {
        // x'' + 2 zeta w0 x' + w0^2 x = w0^2 F, in (x, v/w0).
        let w0 = mode.frequency * core::f64::consts::TAU;
        let zeta = 0.5 / mode.quality;
        let h = 1.0 / f64::from(SAMPLE_RATE);
        let damped = libm::sqrt(1.0 - zeta * zeta);
        let decay = libm::exp(-zeta * w0 * h);
        let (s, c) = libm::sincos(damped * w0 * h);
        let matrix = [
            [decay * (c + zeta / damped * s), decay * s / damped],
            [-decay * s / damped, decay * (c - zeta / damped * s)],
        ];
        // The fixed point (1, 0) under unit force determines the input column.
        let input = [1.0 - matrix[0][0], -matrix[1][0]];
        Self {
            matrix: matrix.map(|row| row.map(|entry| entry as f32)),
            input: input.map(|entry| (entry * mode.force) as f32),
            state: [0.0; 2],
            natural: w0 as f32,
            damping: (2.0 * zeta) as f32,
        }
    }

    /// Advances one sample under an output (-1..1, times the gain's factor).
    #[inline]
    pub fn step(&mut self, output: f32) {
        self.state = self.after(self.state, output);
    }

    /// State one sample later under a held output.
    #[inline]
    fn after(&self, [x, y]: [f32; 2], output: f32) -> [f32; 2] {
        let [[a, b], [c, d]] = self.matrix;
        [
            a * x + b * y + self.input[0] * output,
            c * x + d * y + self.input[1] * output,
        ]
    }

    /// Displacement in m and velocity in m/s.
    pub fn motion(&self) -> [f32; 2] {
        [self.state[0], self.state[1] * self.natural]
    }

    /// Adds a displacement in m and a velocity in m/s, as after a push.
    pub fn push(&mut self, displacement: f64, velocity: f64) {
        self.state[0] += displacement as f32;
        self.state[1] += (velocity / f64::from(self.natural)) as f32;
    }

    /// Static displacement in m under a constant acceleration in m/s^2.
    pub fn sag(&self, acceleration: f64) -> f64 {
        acceleration / (f64::from(self.natural) * f64::from(self.natural))
    }

    /// Acceleration in m/s^2 under an output.
    #[inline]
    pub fn acceleration(&self, output: f32, force: f32) -> f32 {
        self.natural
            * self.natural
            * (force * output - self.state[0] - self.damping * self.state[1])
    }
}

/// Harmonic motion of the track at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Swing {
    /// Normal amplitude (symbol b) in m.
    pub amplitude: f32,
    /// Phase of the track; 0 at its centre, moving upwards.
    pub phase: Phase,
    pub shape: Shape,
}

impl Swing {
    /// Swing through a displacement and velocity at an angular frequency in rad/s.
    pub fn through(motion: [f32; 2], angular: f32) -> Self {
        let [x, v] = motion;
        let quadrature = v / angular;
        Self {
            amplitude: libm::sqrtf(x * x + quadrature * quadrature),
            phase: phase_of(libm::atan2f(x, quadrature)),
            shape: Shape::SINE,
        }
    }

    /// This swing with upper tones, each through a displacement (m) and a velocity (m/s).
    pub fn with(self, motions: [[f32; 2]; UPPER], angular: f32) -> Self {
        let tone = |motion: [f32; 2], harmonic: u32| {
            if motion == [0.0; 2] || self.amplitude <= 0.0 {
                return UpperTone::NONE;
            }
            let own = Self::through(motion, harmonic as f32 * angular);
            let first = Phase::from_bits(self.phase.bits().wrapping_mul(harmonic));
            let phase = (own.phase - first).bits() as i32 as f32 * (TAU / Phase::TURN as f32);
            UpperTone::new(own.amplitude / self.amplitude, phase)
        };
        let [second, third] = motions;
        Self {
            shape: Shape::new(tone(second, 2), tone(third, 3)),
            ..self
        }
    }
}

/// A mode: the resonance, or one fitted to the configured response at a multiple of the frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpperMode {
    /// Frequency in Hz.
    pub frequency: f64,
    pub quality: f64,
    /// Static displacement in m at full output; negative for a mode in antiphase.
    pub force: f64,
}

/// Rounds of the alternating fit of two modes, which respond to each other's tone by hundredths.
const FIT_ROUNDS: usize = 12;

impl UpperMode {
    pub fn resonance(model: &DriveModel) -> Self {
        let quality = f64::from(model.quality);
        Self {
            frequency: model.resonance.into(),
            quality,
            // At resonance the displacement is Q times the static one.
            force: f64::from(model.gain) * 1e-3 / quality,
        }
    }

    /// Modes of a model at a drive frequency in Hz; none if the resonance alone has that response.
    pub fn fit_configured(model: &DriveModel, frequency: f64) -> Vec<Self, UPPER> {
        let configured = [
            (2.0, model.second_gain, model.second_lag),
            (3.0, model.third_gain, model.third_lag),
        ];
        let mut modes = [None::<Self>; UPPER];
        let several = configured.iter().filter(|(_, gain, _)| *gain > 0.0).count() > 1;
        for _ in 0..if several { FIT_ROUNDS } else { 1 } {
            for (n, (harmonic, gain, lag)) in configured.into_iter().enumerate() {
                if gain <= 0.0 {
                    continue;
                }
                // The zero-order hold adds half a sample of delay, which no mode causes.
                let hold_lag = PI64 * harmonic * frequency / f64::from(SAMPLE_RATE);
                let lag = f64::from(lag).to_radians() - hold_lag;
                let (sine, cosine) = libm::sincos(lag);
                let configured = Complex64::new(cosine, -sine) * (f64::from(gain) * 1e-3);
                let at = harmonic * frequency;
                let mut residue = configured - Self::resonance(model).response(at);
                modes[n] = None;
                for mode in modes.iter().flatten() {
                    residue -= mode.response(at);
                }
                modes[n] = Self::fitted(residue, at, f64::from(model.second_quality));
            }
        }
        modes.into_iter().flatten().collect()
    }

    /// Mode of a quality factor whose response to full output at a frequency in Hz is `residue` m.
    fn fitted(residue: Complex64, at: f64, quality: f64) -> Option<Self> {
        // A mode lags by less than half a turn; a larger lag requires antiphase.
        let against = residue.im > 0.0;
        let residue = if against { -residue } else { residue };
        let size = libm::sqrt(residue.norm_sqr());
        if size < 1e-12 {
            return None;
        }
        // tan lag = (x/Q) / (1 - x^2).
        let tangent = -residue.re / residue.im.min(-1e-6 * size) / quality;
        let x = libm::sqrt(0.25 * tangent * tangent + 1.0) - 0.5 * tangent;
        let stiffness = Complex64::new(1.0 - x * x, x / quality);
        let force = size * libm::sqrt(stiffness.norm_sqr());
        Some(Self {
            frequency: at / x,
            quality,
            force: if against { -force } else { force },
        })
    }

    /// Response to full output at a frequency in Hz, in m.
    fn response(&self, frequency: f64) -> Complex64 {
        let x = frequency / self.frequency;
        Complex64::new(1.0 - x * x, x / self.quality).inv() * self.force
    }
}

/// Separates the upper tones of the track's motion, by simulating each mode under each tone.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToneSeparator {
    /// State of each mode under each upper tone.
    states: [[[f32; 2]; 1 + UPPER]; UPPER],
    upper: usize,
    /// Estimated output along sine and cosine of the phase and its multiples.
    output: [[f32; 2]; 1 + UPPER],
}

impl ToneSeparator {
    pub fn new(upper: usize) -> Self {
        Self {
            upper,
            ..Self::default()
        }
    }

    /// Adds an output held at a phase that advances by `step` per sample, on these modes.
    ///
    /// The output's tones are estimated by the projection algorithm (Kaczmarz 1937): each sample
    /// corrects two coefficients a tone. The estimate follows a change in a quarter of a cycle.
    #[inline]
    pub fn step<'a>(
        &mut self,
        output: f32,
        phase: Phase,
        step: u32,
        modes: impl Iterator<Item = &'a Resonator> + Clone,
    ) {
        let (sine, cosine) = sine_cosine_single(phase);
        let (sine2, cosine2) = (2.0 * sine * cosine, (cosine - sine) * (cosine + sine));
        let third = [2.0 * cosine * sine2 - sine, 2.0 * cosine * cosine2 - cosine];
        let tones = [[sine, cosine], [sine2, cosine2], third];
        let numbers = 2 * (1 + self.upper);
        let explained: f32 = (tones.as_flattened().iter())
            .zip(self.output.as_flattened())
            .take(numbers)
            .map(|(t, o)| t * o)
            .sum();
        let rate = (8.0 * step as f32 / Phase::TURN as f32).min(0.5);
        let error = rate * (output - explained);
        let own = self.output.as_flattened_mut().iter_mut();
        for (own, tone) in own.zip(tones.as_flattened()).take(numbers) {
            *own += error * tone;
        }
        let above = tones.iter().zip(&self.output).skip(1).take(self.upper);
        for ((tone, output), states) in above.zip(&mut self.states) {
            let driven = output[0] * tone[0] + output[1] * tone[1];
            for (state, mode) in states.iter_mut().zip(modes.clone()) {
                *state = mode.after(*state, driven);
            }
        }
    }

    /// Displacement in m and velocity in m/s of each upper tone; 0 for tones that are absent.
    pub fn motions<'a>(
        &self,
        modes: impl Iterator<Item = &'a Resonator> + Clone,
    ) -> [[f32; 2]; UPPER] {
        self.states.map(|states| {
            let mode_motions = states.iter().zip(modes.clone());
            let mut mode_motions = mode_motions.map(|([x, y], mode)| [*x, y * mode.natural]);
            let first = mode_motions.next().unwrap_or_default();
            mode_motions.fold(first, |[x, v], [dx, dv]| [x + dx, v + dv])
        })
    }
}

/// Ringing of the track after impacts: a damped oscillator in the accelerometer's reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ringing {
    /// Rotation and decay per sample.
    turn: Complex,
    state: Complex,
    angle: f32,
    decay: f32,
}

impl Ringing {
    pub fn from_sensor(sensor: &SensorModel) -> Self {
        let (frequency, decay) = (sensor.ringing_frequency, sensor.ringing_decay * 1e-3);
        let h = 1.0 / SAMPLE_RATE as f32;
        let angle = TAU * frequency * h;
        let decay_factor = libm::expf(-h / decay);
        Self {
            turn: turn(angle) * decay_factor,
            state: Complex::default(),
            angle,
            decay: h / decay,
        }
    }

    /// Adds an impact of a height in m/s^2, a share of a sample (0..1) before the next sample.
    pub fn strike(&mut self, height: f32, share: f32) {
        let height = height * libm::expf(-self.decay * share);
        self.state += turn(self.angle * share) * height;
    }

    pub fn silence(&mut self) {
        self.state = Complex::default();
    }

    /// Acceleration in m/s^2.
    pub fn acceleration(&self) -> f32 {
        self.state.im
    }

    #[inline]
    pub fn step(&mut self) {
        self.state *= self.turn;
    }
}

/// `e^(i angle)`, with one function for both parts.
fn turn(angle: f32) -> Complex {
    Complex::new(libm::sinf(PI * 0.5 - angle), libm::sinf(angle))
}
