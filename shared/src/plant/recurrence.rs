//! The resonant drive and the demodulator from cycle to cycle, in closed form.

use core::f64::consts::TAU;

use num_complex::Complex64 as Complex;

use super::drive::Swing;
use super::scene::DriveModel;
use crate::arithmetic::{Phase, sine_cosine_single};
use crate::control::{SAMPLE_RATE, phase_of};

/// `e^(i angle)`.
pub(super) fn turn(angle: f64) -> Complex {
    let (sine, cosine) = libm::sincos(angle);
    Complex::new(cosine, sine)
}

/// `e^z`.
pub(super) fn exp(z: Complex) -> Complex {
    turn(z.im) * libm::exp(z.re)
}

/// `e^(i phase)`, as the signal path has it.
fn turned(phase: u32) -> Complex {
    let (sine, cosine) = sine_cosine_single(Phase::from_bits(phase));
    Complex::new(f64::from(cosine), f64::from(sine))
}

/// `e^z` for a transient within a cycle, |z| below some tenths: by its series, else by [`exp`].
fn exp_small(z: Complex) -> Complex {
    if z.norm_sqr() > 0.25 {
        return exp(z);
    }
    // The next term is below 0.5^9/9! = 5e-9.
    let mut sum = Complex::new(1.0, 0.0);
    for n in (1..9).rev() {
        sum = sum * z * INVERSE[n] + 1.0;
    }
    sum
}

const INVERSE: [f64; 9] = [
    1.0,
    1.0,
    1.0 / 2.0,
    1.0 / 3.0,
    1.0 / 4.0,
    1.0 / 5.0,
    1.0 / 6.0,
    1.0 / 7.0,
    1.0 / 8.0,
];

fn power(base: Complex, exponent: u32) -> Complex {
    let (mut result, mut square, mut left) = (Complex::new(1.0, 0.0), base, exponent);
    while left > 0 {
        if left & 1 == 1 {
            result *= square;
        }
        square *= square;
        left >>= 1;
    }
    result
}

/// What the drive's model gives, whatever the frequency.
///
/// `x'' + 2 zeta w0 x' + w0^2 x = w0^2 F` in `y = x'/w0` has the left eigenvector
/// `z = (zeta + i o) x + y` with `o = sqrt(1 - zeta^2)`: `z' = w0 m z + w0 F`, `m = -zeta + i o`. Held
/// over a sample h that is `z <- l z + (l - 1)/m F` with `l = e^(m w0 h)`, which is the matrix of the
/// waveform's [`Resonator`](super::drive::Resonator) in its own basis, and back
/// `x = Im z / o`, `y = Re z - zeta x`.
#[derive(Clone, Copy, Debug)]
struct Mode {
    zeta: f64,
    damped: f64,
    natural: f64,
    /// `ln l` and l: turn and decay of a sample.
    log: Complex,
    sample: Complex,
    /// What a unit of output adds in one sample.
    input: Complex,
    /// The acceleration is `Re(reading z)` and `direct` times the output held before.
    reading: Complex,
    direct: f64,
}

impl Mode {
    fn new(model: &DriveModel) -> Self {
        let natural = f64::from(model.resonance) * TAU;
        let zeta = 0.5 / f64::from(model.quality);
        let damped = libm::sqrt(1.0 - zeta * zeta);
        let m = Complex::new(-zeta, damped);
        let log = m * (natural / f64::from(SAMPLE_RATE));
        let sample = exp(log);
        // At resonance the displacement is Q times the static one.
        let force = f64::from(model.gain) * 1e-3 / f64::from(model.quality);
        let square = natural * natural;
        Self {
            zeta,
            damped,
            natural,
            log,
            sample,
            input: (sample - 1.0) / m * force,
            // w0^2 (F - x - 2 zeta y) in z.
            reading: Complex::new(
                -2.0 * zeta * square,
                (1.0 - 2.0 * zeta * zeta) * square / damped,
            ),
            direct: square * force,
        }
    }
}

/// What a step of the phase gives: the steady response, and the sums of the demodulator.
#[derive(Clone, Copy, Debug)]
struct Tuning {
    step: u32,
    /// Phase of a step in rad, and `e^(i theta)`.
    theta: f64,
    sample: Complex,
    /// Steady state for unit output: `ahead e^(i phase) + back e^(-i phase)`.
    ahead: Complex,
    back: Complex,
    /// Steady acceleration for unit output: `Re(steady e^(i phase))`.
    steady: Complex,
    /// `ln l - i theta`: the transient seen from the turning phase, per sample.
    drift: Complex,
    /// `1 / (e^(2 i theta) - 1)`.
    double: Complex,
    /// Turn and decay of a transient in the shorter and the longer cycle, and its sums against the phase.
    cycles: [Whole; 2],
}

/// A cycle of a number of samples.
#[derive(Clone, Copy, Debug)]
struct Whole {
    samples: u32,
    /// `l^N`.
    decay: Complex,
    /// `r^N` and `(r^N - r)/(r - 1)` for `r = l e^(i theta)` and `r = conj(l) e^(i theta)`.
    ahead: [Complex; 2],
    back: [Complex; 2],
}

impl Whole {
    fn new(mode: &Mode, sample: Complex, samples: u32) -> Self {
        let sums = |ratio: Complex| {
            let last = power(ratio, samples);
            // At an undamped resonance met exactly the series is flat.
            let sum = if (ratio - 1.0).norm_sqr() < 1e-24 {
                Complex::new(f64::from(samples) - 1.0, 0.0)
            } else {
                (last - ratio) / (ratio - 1.0)
            };
            [last, sum]
        };
        Self {
            samples,
            decay: power(mode.sample, samples),
            ahead: sums(mode.sample * sample),
            back: sums(mode.sample.conj() * sample),
        }
    }
}

impl Tuning {
    fn new(mode: &Mode, step: u32) -> Self {
        let theta = f64::from(step) * (TAU / 4_294_967_296.0);
        let sample = turn(theta);
        let half = Complex::new(0.0, -0.5);
        let ahead = mode.input * half / (sample - mode.sample);
        let back = -mode.input * half / (sample.conj() - mode.sample);
        let shorter = ((1_u64 << 32) / u64::from(step)) as u32;
        Self {
            step,
            theta,
            sample,
            ahead,
            back,
            steady: mode.reading * ahead
                + (mode.reading * back).conj()
                + Complex::new(0.0, -mode.direct) * sample.conj(),
            drift: mode.log - Complex::new(0.0, theta),
            double: (sample * sample - 1.0).inv(),
            cycles: [
                Whole::new(mode, sample, shorter),
                Whole::new(mode, sample, shorter + 1),
            ],
        }
    }
}

/// The drive over whole cycles of its output: one complex multiplication each for the transient, the
/// steady part in closed form, both exactly as the held samples have them.
#[derive(Clone, Copy, Debug)]
pub struct Recurrence {
    mode: Mode,
    tuning: Tuning,
    /// The state z at the sample that began the cycle.
    state: Complex,
    /// What of it is not the steady state of this cycle.
    transient: Complex,
    /// Output amplitude of this cycle, complex where the bus ripples.
    output: Complex,
    /// Phase of the output at the sample that began the cycle, and its `e^(i phase)`.
    phase: u32,
    began: Complex,
    /// Which of the two lengths this cycle has.
    longer: usize,
}

/// What the demodulator finds in a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demodulated {
    /// Cosine part of the acceleration in m/s^2.
    pub in_phase: f64,
    /// Sine part of it.
    pub quadrature: f64,
}

impl Recurrence {
    /// The drive of a model at rest, for a step of the phase.
    #[must_use]
    pub fn new(model: &DriveModel, step: u32) -> Self {
        let mode = Mode::new(model);
        let zero = Complex::new(0.0, 0.0);
        Self {
            mode,
            tuning: Tuning::new(&mode, step.max(1)),
            state: zero,
            transient: zero,
            output: zero,
            phase: 0,
            began: Complex::new(1.0, 0.0),
            longer: 0,
        }
    }

    /// Begins a cycle with an output amplitude (real part; the imaginary one leads by a quarter turn) and
    /// a step of the phase.
    pub fn begin(&mut self, output: Complex, step: u32) {
        let step = step.max(1);
        if step != self.tuning.step {
            self.tuning = Tuning::new(&self.mode, step);
        }
        self.output = output;
        self.transient = self.state - self.steady(self.began);
        let shorter = u64::from(self.phase) + u64::from(step) * u64::from(self.samples_of(0));
        self.longer = usize::from(shorter < 1 << 32);
    }

    fn samples_of(&self, longer: usize) -> u32 {
        self.tuning.cycles[longer].samples
    }

    /// Samples of this cycle.
    #[must_use]
    pub fn samples(&self) -> u32 {
        self.samples_of(self.longer)
    }

    /// The steady state at `e^(i phase)`.
    fn steady(&self, at: Complex) -> Complex {
        // Im(G e^(i phase)) drives, so that the response to e^(-i phase) belongs to conj(G).
        self.tuning.ahead * self.output * at + self.tuning.back * self.output.conj() * at.conj()
    }

    /// Ends the cycle: what the demodulator found in it.
    pub fn end(&mut self) -> Demodulated {
        let whole = self.tuning.cycles[self.longer];
        let advance = u64::from(self.tuning.step) * u64::from(whole.samples);
        let phase = (u64::from(self.phase) + advance) as u32;
        let ended = turned(phase);
        // The samples at both ends stand for the shares of their interval that lie within the cycle.
        let per_step = 1.0 / f64::from(self.tuning.step);
        let first = f64::from(self.phase) * per_step;
        let last = 1.0 - f64::from(phase) * per_step;
        let weight = f64::from(whole.samples) - 1.0 + first + last;
        let (began, squared) = (self.began, self.began * self.began);
        let square = ended * ended;
        let sample = self.tuning.sample;
        let doubled = (square - squared * sample * sample) * self.tuning.double
            + squared * first
            + square * last;
        let steady = self.tuning.steady * self.output;
        let reading = self.mode.reading * self.transient;
        let sum = |[end, sum]: [Complex; 2]| sum + first + end * last;
        let found = steady * doubled
            + steady.conj() * weight
            + began * (reading * sum(whole.ahead) + reading.conj() * sum(whole.back));
        self.state = self.transient * whole.decay + self.steady(ended);
        self.phase = phase;
        self.began = ended;
        Demodulated {
            in_phase: found.re / weight,
            quadrature: found.im / weight,
        }
    }

    /// Largest acceleration that this cycle may show, in m/s^2: a bound.
    #[must_use]
    pub fn loudest(&self) -> f64 {
        let norm = |z: Complex| libm::sqrt(z.norm_sqr());
        norm(self.tuning.steady * self.output) + norm(self.mode.reading * self.transient)
    }

    /// Acceleration in m/s^2 at sample `sample` of this cycle.
    #[must_use]
    pub fn acceleration(&self, sample: u32) -> f64 {
        let n = f64::from(sample);
        let at = self.began * turn(n * self.tuning.theta);
        (self.tuning.steady * self.output * at).re
            + (self.mode.reading * self.transient * exp(self.mode.log * n)).re
    }

    /// Phase of the output at the sample that began this cycle.
    #[must_use]
    pub fn phase(&self) -> u32 {
        self.phase
    }

    /// The track's swing at the drive's frequency, `samples` after the sample that began this cycle.
    #[must_use]
    pub fn swing(&self, samples: f64) -> Swing {
        let at = self.at(samples);
        let mut z = self.steady(at);
        if self.transient.norm_sqr() > 1e-30 {
            z += self.transient * exp_small(self.tuning.drift * samples) * at * self.began.conj();
        }
        let x = z.im / self.mode.damped;
        let velocity = (z.re - self.mode.zeta * x) * self.mode.natural;
        let angular = self.tuning.theta * f64::from(SAMPLE_RATE);
        let quadrature = velocity / angular;
        Swing {
            amplitude: libm::sqrt(x * x + quadrature * quadrature) as f32,
            phase: phase_of(libm::atan2f(x as f32, quadrature as f32)),
        }
    }

    /// `e^(i phase)` of the output, `samples` after the sample that began this cycle.
    #[must_use]
    pub fn at(&self, samples: f64) -> Complex {
        let advance = (samples * f64::from(self.tuning.step)) as i64 as u32;
        turned(self.phase.wrapping_add(advance))
    }

    /// Advance of the phase per sample.
    #[must_use]
    pub fn step(&self) -> u32 {
        self.tuning.step
    }
}

#[cfg(test)]
mod tests {
    use super::super::drive::Resonator;
    use super::*;
    use crate::control::phase_step;

    /// The waveform sample by sample beside the recurrence, over changes of amplitude and frequency.
    fn compare(model: &DriveModel, frequencies: [f32; 3]) {
        let mut drive = Resonator::new(model);
        let force = model.gain * 1e-3 / model.quality;
        let mut fast = Recurrence::new(model, phase_step(frequencies[0]));
        let (mut phase, mut held) = (0_u32, 0.0_f32);
        // The waveform's matrix is in f32: its rounding of 6e-8 shifts the decay of a sample, zeta w0 h.
        let rounding = 6e-8 / -fast.mode.log.re;
        let mut largest = 0.0_f64;
        for cycle in 0..90 {
            let step = phase_step(frequencies[cycle / 30]);
            let amplitude = [0.2_f32, 0.7, 0.0, 0.4, 0.45, 0.1][cycle % 18 / 3];
            fast.begin(Complex::new(f64::from(amplitude), 0.0), step);
            let middle = fast.samples() / 2;
            let (mut cosines, mut sines, mut weight) = (0.0_f64, 0.0_f64, 0.0_f64);
            for n in 0..=fast.samples() {
                let reading = f64::from(drive.acceleration(held, force));
                let (sine, cosine) = sine_cosine_single(Phase::from_bits(phase));
                let share = match n {
                    0 => f64::from(phase) / f64::from(step),
                    _ if n == fast.samples() => 1.0 - f64::from(phase) / f64::from(step),
                    _ => 1.0,
                };
                cosines += share * reading * f64::from(cosine);
                sines += share * reading * f64::from(sine);
                weight += share;
                if n == middle {
                    let [x, v] = drive.motion();
                    let angular = f64::from(step) / 4_294_967_296.0 * 20_000.0 * TAU;
                    let slow = Swing::through([x, v], angular as f32);
                    let swing = fast.swing(f64::from(n));
                    let apart = f64::from((swing.phase - slow.phase).bits() as i32);
                    let (share, full) = (2e-5 + rounding, f64::from(model.gain) * 1e-3);
                    let off = f64::from(swing.amplitude - slow.amplitude).abs();
                    assert!(off < share * full, "cycle {cycle}: {swing:?} {slow:?}");
                    if f64::from(slow.amplitude) > 0.01 * full {
                        assert!(apart.abs() / 4_294_967_296.0 * TAU < 100.0 * share);
                    }
                    let seen = fast.acceleration(n);
                    let most = fast.loudest();
                    assert!(
                        (seen - reading).abs() < (2e-4 + rounding) * most + 1e-6
                            && seen.abs() <= most,
                        "cycle {cycle}: {seen} {reading} {most}"
                    );
                }
                if n < fast.samples() {
                    held = amplitude * sine;
                    drive.step(held);
                    phase = phase.wrapping_add(step);
                }
            }
            let found = fast.end();
            assert_eq!(fast.phase(), phase);
            let slow = [2.0 * cosines / weight, 2.0 * sines / weight];
            largest = largest.max(slow[0].hypot(slow[1]));
            let off = (found.in_phase - slow[0]).hypot(found.quadrature - slow[1]);
            // The waveform's first reading of a cycle still has the output before: a step of at most 0.7 in it,
            // theta from the phase's zero, in one reading of N.
            let theta = f64::from(step) / 4_294_967_296.0 * TAU;
            let held = 0.7 * fast.mode.direct * theta * 2.0 / weight;
            assert!(
                off < (1e-4 + rounding) * largest.max(1.0) + held,
                "cycle {cycle}: {off} of {largest}"
            );
        }
        assert!(largest > 1.0);
    }

    #[test]
    fn the_recurrence_is_the_waveform_at_and_off_resonance() {
        let plain = DriveModel::default();
        compare(&plain, [50.0, 50.7, 48.0]);
        let blunt = DriveModel {
            quality: 3.0,
            resonance: 61.0,
            ..plain
        };
        compare(&blunt, [60.0, 33.3, 90.0]);
        let sharp = DriveModel {
            quality: 200.0,
            resonance: 24.9,
            gain: 4.0,
            ..plain
        };
        compare(&sharp, [25.0, 24.9, 25.3]);
    }
}
