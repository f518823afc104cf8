//! Resonant drive and demodulator in steps of a drive cycle, exact at the samples but for rounding.
//!
//! The drive is its zero-order-hold discretization in modal coordinates (K. J. Åström and B.
//! Wittenmark, Computer-Controlled Systems, 1997). All sums are geometric series.

use crate::model::drive::Swing;
use crate::model::scene::DriveModel;
use core::f64::consts::TAU;
use kband::arithmetic::{Phase, sine_cosine_single};
use kband_control::{SAMPLE_RATE, Shape, phase_of};
use num_complex::Complex64 as Complex;

/// `e^(i angle)`.
pub(crate) fn turn(angle: f64) -> Complex {
    let (sine, cosine) = libm::sincos(angle);
    Complex::new(cosine, sine)
}

pub(crate) fn exp(z: Complex) -> Complex {
    turn(z.im) * libm::exp(z.re)
}

/// `e^(i phase)` with the signal path's sine.
fn unit_phasor(phase: u32) -> Complex {
    let (sine, cosine) = sine_cosine_single(Phase::from_bits(phase));
    Complex::new(f64::from(cosine), f64::from(sine))
}

/// `e^z` by its series for |z| up to 0.3, with a relative error of at most 1e-6, else by [`exp`].
#[inline(always)]
pub(crate) fn exp_small(z: Complex) -> Complex {
    if z.norm_sqr() > 0.09 {
        return exp(z);
    }
    let square = z * z;
    // The next term is below 0.3^6/6! = 1e-6.
    square * square * (z * (1.0 / 120.0) + 1.0 / 24.0)
        + (square * (z * (1.0 / 6.0) + 0.5) + (z + 1.0))
}

const TABLE_BITS: u64 = 4;
const TABLE_SIZE: usize = 1 << TABLE_BITS;
const TABLE_END: u64 = 1 << (2 * TABLE_BITS);

/// Powers `e^(log n)` for n = 0, 1, 2 ..., from two tables and one product.
#[derive(Clone, Copy, Debug, Default)]
pub struct Powers {
    log: Complex,
    /// Powers for exponents below 16, and for multiples of 16.
    fine: [Complex; TABLE_SIZE],
    coarse: [Complex; TABLE_SIZE],
}

impl Powers {
    pub fn new(log: Complex) -> Self {
        let row = |step: Complex| {
            let mut power = Complex::new(1.0, 0.0);
            core::array::from_fn(|_| {
                let next = power * step;
                core::mem::replace(&mut power, next)
            })
        };
        Self {
            log,
            fine: row(exp(log)),
            coarse: row(exp(log * TABLE_SIZE as f64)),
        }
    }

    /// `e^(log n)`; the relative error is at most 2e-14 within the tables, n < 256.
    #[inline]
    pub fn at(&self, n: u64) -> Complex {
        if n >= TABLE_END {
            return self.beyond(n);
        }
        let (coarse, fine) = ((n >> TABLE_BITS) as usize, n as usize % TABLE_SIZE);
        if coarse == 0 {
            return self.fine[fine];
        }
        self.coarse[coarse % TABLE_SIZE] * self.fine[fine]
    }

    #[cold]
    fn beyond(&self, n: u64) -> Complex {
        exp(self.log * n as f64)
    }
}

/// Argument of a complex number; small angles by the series of the arctangent.
fn angle(z: Complex) -> Phase {
    if z.im.abs() < 0.125 * z.re {
        let tangent = z.im / z.re;
        let square = tangent * tangent;
        // The next term is below 0.125^9/9 = 8e-10.
        let angle = tangent
            * (1.0 - square * ((1.0 / 3.0) - square * ((1.0 / 5.0) - square * (1.0 / 7.0))));
        return Phase::from_bits((angle * (Phase::TURN / TAU)) as i64 as u32);
    }
    phase_of(libm::atan2f(z.im as f32, z.re as f32))
}

/// Modal constants of the drive, which do not depend on the drive frequency.
///
/// `x'' + 2 zeta w0 x' + w0^2 x = w0^2 F` with `y = x'/w0` has the left eigenvector `z = (zeta + i
/// o) x + y`, `o = sqrt(1 - zeta^2)`. So `z' = w0 m z + w0 F` with `m = -zeta + i o`. Held over h
/// that is `z <- l z + (l - 1)/m F` with `l = e^(m w0 h)`: the waveform's
/// [`Resonator`](crate::model::drive::Resonator). Back: `x = Im z / o`, `y = Re z - zeta x`.
#[derive(Clone, Copy, Debug)]
struct Mode {
    zeta: f64,
    /// `1/o`.
    per_damped: f64,
    natural: f64,
    /// `ln l` and l, the rotation and decay per sample.
    log: Complex,
    sample: Complex,
    /// Change of z in one sample per unit output.
    input: Complex,
    /// The acceleration is `Re(reading z)` plus `direct` times the held output.
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
            per_damped: 1.0 / damped,
            natural,
            log,
            sample,
            input: (sample - 1.0) / m * force,
            // w0^2 (F - x - 2 zeta y) in terms of z.
            reading: Complex::new(
                -2.0 * zeta * square,
                (1.0 - 2.0 * zeta * zeta) * square / damped,
            ),
            direct: square * force,
        }
    }
}

/// Constants of a drive frequency: steady response and sums of the demodulator.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tuning {
    pub step: u32,
    /// Phase advance per sample in rad.
    theta: f64,
    /// Steady state per unit output: `forward e^(i phase) + backward e^(-i phase)`.
    forward: Complex,
    backward: Complex,
    /// Steady acceleration per unit output: `Re(steady e^(i phase))`.
    steady: Complex,
    /// `ln l - i theta`: the transient per sample, relative to the rotating phase.
    drift: Complex,
    /// Phase lead of the steady swing over the output.
    lead: Phase,
    /// The track's `b e^(i phase)`, rotated back by `lead`: `swing[0] z + swing[1] conj(z)`.
    swing: [Complex; 2],
    /// Samples per phase step of 2^-32 turns.
    pub per_step: f64,
    /// `1 / (e^(2 i theta) - 1)`.
    double: Complex,
    /// Transient decay and demodulator sums over the shorter and the longer cycle.
    cycles: [CycleConstants; 2],
}

#[derive(Clone, Copy, Debug)]
struct CycleConstants {
    samples: u32,
    /// `l^N`.
    decay: Complex,
    /// `r^N` and the sum of `r^n`, `n = 1..N-1`; `r = l e^(i theta)`, or `r = conj(l) e^(i theta)`.
    forward: [Complex; 2],
    backward: [Complex; 2],
}

impl CycleConstants {
    fn new(mode: &Mode, sample: Complex, samples: u32) -> Self {
        let sums = |ratio: Complex| {
            let last = ratio.powu(samples);
            [last, (last - ratio) / (ratio - 1.0)]
        };
        Self {
            samples,
            decay: mode.sample.powu(samples),
            forward: sums(mode.sample * sample),
            backward: sums(mode.sample.conj() * sample),
        }
    }
}

impl Tuning {
    fn new(mode: &Mode, step: u32) -> Self {
        let theta = f64::from(step) * (TAU / Phase::TURN);
        let sample = turn(theta);
        let half = Complex::new(0.0, -0.5);
        let forward = mode.input * half / (sample - mode.sample);
        let backward = -mode.input * half / (sample.conj() - mode.sample);
        let shorter = ((1_u64 << 32) / u64::from(step)) as u32;
        // Imaginary part: displacement. Real part: velocity over the angular frequency.
        let quadrature = mode.natural / (theta * f64::from(SAMPLE_RATE));
        let damping = Complex::new(0.0, quadrature * mode.zeta * mode.per_damped);
        let swing = [
            (damping + quadrature + mode.per_damped) * 0.5,
            (-damping + quadrature - mode.per_damped) * 0.5,
        ];
        let steady = swing[0] * (forward + backward) + swing[1] * (forward + backward).conj();
        let lead = phase_of(libm::atan2f(steady.im as f32, steady.re as f32));
        let against = unit_phasor(lead.bits()).conj();
        Self {
            step,
            theta,
            lead,
            swing: swing.map(|part| part * against),
            per_step: 1.0 / f64::from(step),
            forward,
            backward,
            steady: mode.reading * forward
                + (mode.reading * backward).conj()
                + Complex::new(0.0, -mode.direct) * sample.conj(),
            drift: mode.log - Complex::new(0.0, theta),
            double: (sample * sample - 1.0).inv(),
            cycles: [
                CycleConstants::new(mode, sample, shorter),
                CycleConstants::new(mode, sample, shorter + 1),
            ],
        }
    }
}

/// The drive in steps of a cycle: one complex product for the transient, and the steady state in
/// closed form. Both are exact for the held output, but for the rounding of the f32 sine.
#[derive(Clone, Copy, Debug)]
pub struct Recurrence {
    mode: Mode,
    pub(super) tuning: Tuning,
    /// State z at the first sample of the cycle.
    state: Complex,
    /// The state minus the steady state of this cycle.
    transient: Complex,
    /// Steady state of this cycle: `steady[0] e^(i phase) + steady[1] e^(-i phase)`.
    steady: [Complex; 2],
    /// Acceleration of steady state, times `e^(i phase)`, and transient, times `l^n`: real parts.
    reading: [Complex; 2],
    /// Output phase at the first sample of the cycle, its `e^(i phase)` and the square of that.
    pub phase: u32,
    began: Complex,
    squared: Complex,
    /// Index of this cycle's length.
    longer: usize,
}

impl Recurrence {
    /// The drive of a model at rest, for a phase step per sample.
    pub fn new(model: &DriveModel, step: u32) -> Self {
        let mode = Mode::new(model);
        Self {
            mode,
            tuning: Tuning::new(&mode, step.max(1)),
            state: Complex::ZERO,
            transient: Complex::ZERO,
            steady: [Complex::ZERO; 2],
            reading: [Complex::ZERO; 2],
            phase: 0,
            began: Complex::ONE,
            squared: Complex::ONE,
            longer: 0,
        }
    }

    /// Begins a cycle with a complex output, whose imaginary part leads, and a step per sample.
    pub fn begin(&mut self, output: Complex, step: u32) {
        let step = step.max(1);
        if step != self.tuning.step {
            self.tuning = Tuning::new(&self.mode, step);
        }
        let tuning = &self.tuning;
        // The drive is Im(G e^(i phase)), so the response to e^(-i phase) has conj(G).
        self.steady = [tuning.forward * output, tuning.backward * output.conj()];
        self.transient = self.state - self.steady(self.began);
        self.reading = [tuning.steady * output, self.mode.reading * self.transient];
        let samples = self.tuning.cycles[0].samples;
        let shorter = u64::from(self.phase) + u64::from(step) * u64::from(samples);
        self.longer = usize::from(shorter < 1 << 32);
    }

    pub fn samples(&self) -> u32 {
        self.tuning.cycles[self.longer].samples
    }

    fn steady(&self, at: Complex) -> Complex {
        self.steady[0] * at + self.steady[1] * at.conj()
    }

    /// Ends the cycle; its demodulated acceleration, cosine and sine parts in m/s^2.
    pub fn end(&mut self) -> Complex {
        let constants = &self.tuning.cycles[self.longer];
        let advance = u64::from(self.tuning.step) * u64::from(constants.samples);
        let phase = (u64::from(self.phase) + advance) as u32;
        let ended = unit_phasor(phase);
        // The first and last samples are weighted by the part of their interval within the cycle.
        let per_step = self.tuning.per_step;
        let first = f64::from(self.phase) * per_step;
        let last = 1.0 - f64::from(phase) * per_step;
        let weight = f64::from(constants.samples) - 1.0 + first + last;
        let square = ended * ended;
        let double = self.tuning.double;
        let doubled = square * (double + last) - self.squared * (double + (1.0 - first));
        let [steady, reading] = self.reading;
        let sum = |[end, sum]: [Complex; 2]| sum + first + end * last;
        let transient = reading * sum(constants.forward) + reading.conj() * sum(constants.backward);
        let demodulated = steady * doubled + steady.conj() * weight + self.began * transient;
        self.state = self.transient * constants.decay + self.steady(ended);
        self.phase = phase;
        self.began = ended;
        self.squared = square;
        demodulated * (1.0 / weight)
    }

    /// Output whose force equals an acceleration of the track of 1 m/s^2.
    pub fn per_acceleration(&self) -> f64 {
        1.0 / self.mode.direct
    }

    /// Upper bound of the acceleration in this cycle, in m/s^2.
    pub fn max_acceleration(&self) -> f64 {
        let norm = |z: Complex| libm::sqrt(z.norm_sqr());
        norm(self.reading[0]) + norm(self.reading[1])
    }

    /// Complex amplitude of the steady acceleration in m/s^2, relative to `e^(i phase)`.
    pub fn steady_swing(&self) -> Complex {
        self.reading[0]
    }

    /// Acceleration in m/s^2 at sample `sample` of this cycle.
    pub fn acceleration(&self, sample: u32) -> f64 {
        let n = f64::from(sample);
        let at = self.began * turn(n * self.tuning.theta);
        (self.reading[0] * at).re + (self.reading[1] * exp(self.mode.log * n)).re
    }

    pub fn swinging(&self) -> Swinging<'_> {
        let transient =
            (self.transient.norm_sqr() > 1e-30).then(|| self.transient * self.began.conj());
        let [forward, backward] = self.tuning.swing;
        Swinging {
            drive: self,
            transient,
            counter_rotating: [backward * self.steady[1].conj(), forward * self.steady[1]],
        }
    }

    /// `e^(i phase)` of the output, `samples` after the first sample of this cycle.
    pub fn at(&self, samples: u32) -> Complex {
        unit_phasor(self.phase_at(samples).bits())
    }

    /// Output phase, `samples` after the first sample of this cycle.
    pub fn phase_at(&self, samples: u32) -> Phase {
        let forward = samples.wrapping_mul(self.tuning.step);
        Phase::from_bits(self.phase.wrapping_add(forward))
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Swinging<'a> {
    pub drive: &'a Recurrence,
    /// Transient at the start of the cycle over the rotating phase; `None` once it has decayed.
    transient: Option<Complex>,
    /// Part of the swing from the steady `e^(-i phase)`: a constant, and that of `e^(-2 i phase)`.
    counter_rotating: [Complex; 2],
}

impl Swinging<'_> {
    /// Swing at the drive's frequency, `ticks` of 2^-32 turns after the first sample of the cycle.
    pub fn at(&self, ticks: i64) -> Swing {
        let (tuning, steady) = (&self.drive.tuning, &self.drive.steady);
        let phase = self.drive.phase.wrapping_add(ticks as u32);
        let at = unit_phasor(phase);
        // The state is `forward_state e^(i phase) + steady[1] e^(-i phase)`.
        let mut forward_state = steady[0];
        if let Some(transient) = self.transient {
            let samples = ticks as f64 * tuning.per_step;
            forward_state += transient * exp_small(tuning.drift * samples);
        }
        let [forward, backward] = tuning.swing;
        let [alike, against] = self.counter_rotating;
        let swing = (forward * forward_state + alike)
            + (against + backward * forward_state.conj()) * (at * at).conj();
        Swing {
            amplitude: libm::sqrt(swing.norm_sqr()) as f32,
            phase: Phase::from_bits(phase) + tuning.lead + angle(swing),
            shape: Shape::SINE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::drive::{Resonator, UpperMode};
    use kband_control::phase_step;

    /// Compares waveform and recurrence over changes of amplitude and frequency.
    fn compare(model: &DriveModel, frequencies: [f32; 3]) {
        let mut drive = Resonator::from_mode(&UpperMode::resonance(model));
        let force = model.gain * 1e-3 / model.quality;
        let mut fast = Recurrence::new(model, phase_step(frequencies[0]));
        let (mut phase, mut held) = (0_u32, 0.0_f32);
        // The waveform's matrix in f32 has a rounding of 6e-8, which changes its decay.
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
                    let angular = f64::from(step) / Phase::TURN * 20_000.0 * TAU;
                    let slow = Swing::through([x, v], angular as f32);
                    let swing = fast.swinging().at(i64::from(n) * i64::from(step));
                    let shift = f64::from((swing.phase - slow.phase).bits() as i32);
                    let (share, full) = (2e-5 + rounding, f64::from(model.gain) * 1e-3);
                    let error = f64::from(swing.amplitude - slow.amplitude).abs();
                    assert!(error < share * full, "cycle {cycle}: {swing:?} {slow:?}");
                    if f64::from(slow.amplitude) > 0.01 * full {
                        assert!(shift.abs() / Phase::TURN * TAU < 100.0 * share);
                    }
                    let (actual, maximum) = (fast.acceleration(n), fast.max_acceleration());
                    let is_close = (actual - reading).abs() < (2e-4 + rounding) * maximum + 1e-6;
                    let case = std::format!("cycle {cycle}: {actual} {reading} {maximum}");
                    assert!(is_close && actual.abs() <= maximum, "{case}");
                }
                if n < fast.samples() {
                    held = amplitude * sine;
                    drive.step(held);
                    phase = phase.wrapping_add(step);
                }
            }
            let demodulated = fast.end();
            assert_eq!(fast.phase, phase);
            let slow = [2.0 * cosines / weight, 2.0 * sines / weight];
            largest = largest.max(slow[0].hypot(slow[1]));
            let error = (demodulated.re - slow[0]).hypot(demodulated.im - slow[1]);
            // The waveform's first reading of a cycle contains the previous output. This is a step
            // of at most 0.7 at phase theta, in one of N readings.
            let theta = f64::from(step) / Phase::TURN * TAU;
            let held = 0.7 * fast.mode.direct * theta * 2.0 / weight;
            let tolerance = (1e-4 + rounding) * largest.max(1.0) + held;
            assert!(error < tolerance, "cycle {cycle}: {error} of {largest}");
        }
        assert!(largest > 1.0);
    }

    #[test]
    fn the_recurrence_is_the_waveform_at_and_off_resonance() {
        let standard = DriveModel::default();
        compare(&standard, [50.0, 50.7, 48.0]);
        let low_quality = DriveModel {
            quality: 3.0,
            resonance: 61.0,
            ..standard
        };
        compare(&low_quality, [60.0, 33.3, 90.0]);
        let high_quality = DriveModel {
            quality: 200.0,
            resonance: 24.9,
            gain: 4.0,
            ..standard
        };
        compare(&high_quality, [25.0, 24.9, 25.3]);
    }
}
