//! Signal path of one sample: drive phase, demodulation, onset detection, drive output.
//!
//! Methods: a phase accumulator generates the drive (direct digital synthesis). Lock-in
//! demodulation over one cycle measures the tones of the acceleration. Samples in which an impact
//! rings are replaced by the last cycle's tone (imputation), and left out of the new estimate.

use super::average::{AverageBins, SynchronousAverage};
use super::energy::{EnergyHistogram, Sectors};
use super::onset::{DetectedImpact, MAX_IMPACTS_PER_CYCLE, OnsetDetector};
use crate::{Settings, UPPER, phase_step};
use heapless::Vec;
use kband::arithmetic::{Phase, sine_cosine_single, square_root_single};
use kband::feeder::{OutOfRange, STANDARD_GRAVITY};
use serde::{Deserialize, Serialize};

/// Largest share of a cycle that the demodulator blanks: cosine, sine and mean stay separable.
pub const MAX_BLANKED_SHARE: f64 = 1.0 / 3.0;
/// Acceleration beyond any converter, in m/s^2: a hundred times full scale at least sensitivity.
const MAX_ACCELERATION: f32 = 1e7;

/// Reading of the converter, right-aligned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AdcCode(pub u16);

/// Command to the drive from the next cycle on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Command {
    /// Amplitude of the output as a share of full output, 0..1.
    pub amplitude: f32,
    /// Phase lead of that output; it compensates the phase shift by a load of parts.
    pub lead: Phase,
    /// Second and third tone of the output, along sine and cosine of the multiple of its phase, as
    /// shares of full output. The sum with the amplitude is at most full output.
    pub overtones: [[f32; 2]; UPPER],
    /// Advance of the phase per sample (see [`phase_step`](crate::phase_step)).
    pub step: u32,
    /// Whether the output changes at once instead of at the next cycle: switching off never waits.
    pub immediate: bool,
    /// Start phase of an average of the residual over half a turn, `None` ends it.
    pub average_from: Option<Phase>,
    /// Whether the demodulator uses every sample from the next cycle on, also while an impact
    /// rings: identification corrects that bias itself. It is not sent.
    #[serde(skip)]
    pub whole: bool,
}

/// Measurements of one drive cycle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cycle {
    /// Number of samples.
    pub samples: u16,
    /// Cosine part of the acceleration at the drive's frequency, at the output's phase, in m/s^2.
    pub in_phase: f32,
    /// Sine part of the acceleration at the drive's frequency, in m/s^2.
    pub quadrature: f32,
    /// Cosine and sine parts at twice and three times the drive's frequency, in m/s^2. Their phase
    /// reference is the same multiple of the output's phase; 0 if the drive makes no such tone.
    pub upper: [[f32; 2]; UPPER],
    /// Mean acceleration in m/s^2.
    pub mean: f32,
    /// Lowest reading.
    pub low: u16,
    /// Highest reading.
    pub high: u16,
    /// Number of readings at either end of the converter's range.
    pub saturated: u16,
    /// RMS of the noise in the residual in m/s^2.
    pub noise: f32,
    /// Share of the samples that the demodulator blanked, 0..=1/3.
    pub blanked: f32,
    /// Amplitude of the drive's current at the drive's frequency, in A; 0 without a current sensor.
    pub current: f32,
    /// Detected impacts in order of time; impacts beyond the capacity are dropped.
    pub impacts: Vec<DetectedImpact, MAX_IMPACTS_PER_CYCLE>,
    /// Some bins of the last ended average ([`Command::average_from`]).
    pub average: AverageBins,
    /// Energy of the residual in some sectors of the turn.
    pub sectors: Sectors,
}

impl Cycle {
    /// Whether all measurements are finite and small enough for squares.
    pub(crate) fn is_finite(&self) -> bool {
        let single = [
            self.in_phase,
            self.quadrature,
            self.mean,
            self.noise,
            self.blanked,
            self.current,
        ];
        let mut all = self.upper.as_flattened().iter().chain(&single);
        all.all(|number| number.abs() < MAX_ACCELERATION)
    }
}

/// Result of one sample, for the sample interrupt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampled {
    /// Output of the drive as a share of full output, -1..1.
    pub output: f32,
    /// Whether this sample began a new cycle, so that [`Signal::cycle`] is fresh.
    pub wrapped: bool,
}

/// Extremes and counts of a cycle's readings.
#[derive(Clone, Copy, Debug)]
struct Readings {
    samples: u16,
    low: u16,
    high: u16,
    saturated: u16,
}

impl Readings {
    const NONE: Self = Self {
        samples: 0,
        low: u16::MAX,
        high: 0,
        saturated: 0,
    };

    /// Adds a reading of a converter with this highest code.
    #[inline(always)]
    fn add(&mut self, AdcCode(code): AdcCode, full_scale: u16) {
        self.samples = self.samples.wrapping_add(1);
        (self.low, self.high) = (self.low.min(code), self.high.max(code));
        if code == 0 || code >= full_scale {
            self.saturated = self.saturated.wrapping_add(1);
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct CycleTiming {
    /// Advance of the phase per sample, and its inverse.
    step: u32,
    inverse: f32,
    max_blanked: f32,
}

impl CycleTiming {
    /// Timing at an advance of the phase per sample; `whole` disables blanking.
    fn from_step(step: u32, whole: bool) -> Self {
        let inverse = 1.0 / step as f32;
        let max_blanked = MAX_BLANKED_SHARE as f32 * Phase::TURN as f32 * inverse;
        Self {
            step,
            inverse,
            max_blanked: if whole { 0.0 } else { max_blanked },
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Cosine and sine sums at the drive's frequency.
    first: [f32; 2],
    accelerations: f32,
    weight: f32,
    blanked: f32,
}

impl Sums {
    /// Adds a sample with this weight.
    #[inline(always)]
    fn add(&mut self, share: f32, [by_cosine, by_sine]: [f32; 2], swing: f32) {
        self.first[0] += share * by_cosine;
        self.first[1] += share * by_sine;
        self.accelerations += share * swing;
        self.weight += share;
    }
}

/// Value of [`Signal::path`] if the settings have a current sensor.
const WITH_CURRENT: u8 = UPPER as u8 + 1;

#[derive(Clone, Copy, Debug)]
struct CurrentMeter {
    /// Amperes per step of the converter; unused without a current sensor.
    scale: f32,
    /// Mean reading of the last cycle, in steps: the sensor's zero, which is subtracted.
    mean: f32,
    sums: Sums,
}

/// Signal path: configuration, oscillator, demodulator and onset detector.
///
/// The ringing of an impact biases the demodulated amplitude, by 4.7 % for 24 parts that strike
/// together and ring at 800 Hz. The last cycle's tone therefore replaces the samples in which an
/// impact rings ([`OnsetDetector::is_ringing`]), up to a third of a cycle. They have no effect on
/// the new estimate. At a steady amplitude at most 0.3 % of bias remains, at 800 Hz and at 2.4 kHz.
///
/// Deadline: one sample (50 us). A missed one shifts the drive's phase, which is measured.
///
/// ```
/// use kband_control::{AdcCode, Settings, Signal};
/// let mut signal = Signal::build(&Settings::default())?;
/// // 50 Hz at 20 000 samples a second: a drive cycle ends after 400 of them.
/// let wraps = (0..2010).filter(|_| signal.sample(AdcCode(2048)).wrapped).count();
/// assert_eq!(wraps, 5);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Signal {
    scale: f32,
    zero: f32,
    full_scale: u16,
    phase: Phase,
    /// Timing of this cycle, and of the next.
    timing: CycleTiming,
    next_timing: CycleTiming,
    /// Output along sine and cosine of the phase.
    amplitude: [f32; 2],
    /// Upper tones of the output, and the number that the drive can make; as many are demodulated.
    overtones: [[f32; 2]; UPPER],
    upper: usize,
    /// The instance that takes a sample: by the number of upper tones, or [`WITH_CURRENT`].
    path: u8,
    pending: Command,
    /// Output of the pending command along sine and cosine.
    next_amplitude: [f32; 2],
    /// Mean of the last cycle; its subtraction keeps gravity out of the demodulation.
    mean: f32,
    sums: Sums,
    /// Cosine and sine sums at multiples of the drive's frequency.
    multiples: [[f32; 2]; UPPER],
    /// Cosine and sine parts of each tone in the last whole cycle.
    measured: [[f32; 2]; 1 + UPPER],
    readings: Readings,
    /// Current and last whole cycle, alternating, which avoids copies.
    cycles: [Cycle; 2],
    /// Index of the whole one.
    complete: u8,
    detector: OnsetDetector,
    average: SynchronousAverage,
    energy: EnergyHistogram,
    current: CurrentMeter,
}

impl Signal {
    /// Signal path for these settings, with the drive off; the error names the refused parameter.
    pub fn build(settings: &Settings) -> Result<Self, OutOfRange> {
        settings.check()?;
        let full_scale = ((1_u32 << settings.converter_bits as u32) - 1) as u16;
        let volts = settings.converter_reference / (f32::from(full_scale) + 1.0);
        let scale = volts / settings.sensitivity * STANDARD_GRAVITY as f32;
        let step = phase_step(settings.frequency);
        let empty = Cycle {
            low: u16::MAX,
            ..Cycle::default()
        };
        Ok(Self {
            scale,
            zero: settings.sensor_zero / volts,
            full_scale,
            phase: Phase::ZERO,
            timing: CycleTiming {
                max_blanked: 0.0,
                ..CycleTiming::from_step(step, false)
            },
            next_timing: CycleTiming::from_step(step, false),
            amplitude: [0.0; 2],
            overtones: [[0.0; 2]; UPPER],
            upper: settings.upper_tones(),
            path: if settings.current_sensitivity > 0.0 {
                WITH_CURRENT
            } else {
                settings.upper_tones() as u8
            },
            pending: Command {
                step,
                ..Command::default()
            },
            next_amplitude: [0.0; 2],
            mean: 0.0,
            sums: Sums::default(),
            multiples: [[0.0; 2]; UPPER],
            measured: [[0.0; 2]; 1 + UPPER],
            readings: Readings::NONE,
            cycles: [empty.clone(), empty],
            complete: 1,
            detector: OnsetDetector::new(scale),
            average: SynchronousAverage::empty(),
            energy: EnergyHistogram::default(),
            current: CurrentMeter {
                scale: volts / settings.current_sensitivity,
                mean: settings.sensor_zero / volts,
                sums: Sums::default(),
            },
        })
    }

    /// Processes the reading of one sample; returns the output to hold until the next.
    ///
    /// It reads no current: [`Signal::sample_with`] does, if a sensor is configured.
    #[inline]
    pub fn sample(&mut self, code: AdcCode) -> Sampled {
        self.sample_with(code, AdcCode::default)
    }

    /// As [`Signal::sample`], with the current sensor's reading, taken if one is configured.
    #[inline]
    pub fn sample_with(&mut self, code: AdcCode, current: impl FnOnce() -> AdcCode) -> Sampled {
        // One instance per number of tones: unused tones cost nothing, nor does an unused sensor.
        match self.path {
            0 => self.process_sample::<0>(code),
            1 => self.process_sample::<1>(code),
            2 => self.process_sample::<UPPER>(code),
            _ => self.process_both(code, current()),
        }
    }

    /// One sample of accelerometer and current sensor.
    #[inline(never)]
    fn process_both(&mut self, code: AdcCode, current: AdcCode) -> Sampled {
        self.add_current(current);
        match self.upper {
            0 => self.process_sample::<0>(code),
            1 => self.process_sample::<1>(code),
            _ => self.process_sample::<UPPER>(code),
        }
    }

    /// As [`Signal::sample`], with this number of upper tones; each instance exists once.
    #[inline(never)]
    fn process_sample<const TONES: usize>(&mut self, code: AdcCode) -> Sampled {
        let before = self.phase;
        self.phase += Phase::from_bits(self.timing.step);
        let wrapped = self.phase.bits() < before.bits();
        let acceleration = (f32::from(code.0) - self.zero) * self.scale;
        let (sine, cosine) = sine_cosine_single(self.phase);
        // The nth tone's acceleration is n^2 times as large. The high-passes also pass n^2 times as
        // much of it. The tones of the last cycle are therefore subtracted first.
        let turns: [[f32; 2]; TONES] = multiples(sine, cosine);
        let mut predicted = 0.0;
        let measured = &self.measured;
        for_each_upper_tone::<TONES>(|n| {
            predicted += measured[1 + n][0] * turns[n][0] + measured[1 + n][1] * turns[n][1];
        });
        let innovation = if TONES > 0 {
            acceleration - predicted
        } else {
            acceleration
        };
        let residual = self.detector.residual(innovation);
        self.average.add(self.phase, residual);
        self.energy.add(self.phase, residual);
        let onset = self.detector.detect(residual);
        let mut swing = acceleration - self.mean;
        let blanked = self.detector.is_ringing() && self.sums.blanked < self.timing.max_blanked;
        if blanked {
            // The last cycle's tone replaces the sample, without effect on the new estimate.
            let [by_cosine, by_sine] = self.measured[0];
            swing = by_cosine * cosine + by_sine * sine;
            if TONES > 0 {
                swing += predicted;
            }
            self.sums.blanked += 1.0;
        }
        let (by_cosine, by_sine) = (swing * cosine, swing * sine);
        if wrapped {
            // A sample represents the interval that it ends; the wrap splits it between two cycles.
            let share = self.phase.bits() as f32 * self.timing.inverse;
            let rest = 1.0 - share;
            self.add(&turns, rest * swing);
            let mut ended = self.sums;
            ended.add(rest, [by_cosine, by_sine], swing);
            let begun = if blanked { share } else { 0.0 };
            ended.blanked -= begun;
            self.sums = Sums {
                first: [share * by_cosine, share * by_sine],
                accelerations: share * swing,
                weight: share,
                blanked: begun,
            };
            self.finish::<TONES>(&ended);
            self.add(&turns, share * swing);
        } else {
            self.add(&turns, swing);
            self.sums.add(1.0, [by_cosine, by_sine], swing);
        }
        self.readings.add(code, self.full_scale);
        if let Some(strength) = onset {
            let [first, second] = &mut self.cycles;
            let running = if self.complete == 0 { second } else { first };
            // The ringing exceeds the threshold within two samples, on average after one.
            let _ = running.impacts.push(DetectedImpact {
                phase: before,
                strength,
            });
        }
        let [along, across] = self.amplitude;
        let mut output = along * sine + across * cosine;
        let overtones = &self.overtones;
        for_each_upper_tone::<TONES>(|n| {
            let [sine, cosine] = overtones[n];
            output += cosine * turns[n][0] + sine * turns[n][1];
        });
        Sampled { output, wrapped }
    }

    /// Adds the reading of the current sensor at the next sample, before the accelerometer's.
    #[inline(always)]
    fn add_current(&mut self, code: AdcCode) {
        let CurrentMeter { scale, mean, sums } = &mut self.current;
        let phase = self.phase + Phase::from_bits(self.timing.step);
        let (sine, cosine) = sine_cosine_single(phase);
        let swing = f32::from(code.0) - *mean;
        let products = [swing * cosine, swing * sine];
        if phase.bits() >= self.phase.bits() {
            sums.add(1.0, products, swing);
            return;
        }
        let share = phase.bits() as f32 * self.timing.inverse;
        sums.add(1.0 - share, products, swing);
        let inverse = 1.0 / sums.weight;
        let [by_cosine, by_sine] = sums.first;
        let square = by_cosine * by_cosine + by_sine * by_sine;
        let [first, second] = &mut self.cycles;
        let running = if self.complete == 0 { second } else { first };
        running.current = 2.0 * *scale * inverse * square_root_single(square);
        *mean += sums.accelerations * inverse;
        *sums = Sums::default();
        sums.add(share, products, swing);
    }

    /// Adds a weighted sample to the sums at multiples of the drive's frequency.
    #[inline(always)]
    fn add<const TONES: usize>(&mut self, turns: &[[f32; 2]; TONES], swing: f32) {
        let sums = &mut self.multiples;
        for_each_upper_tone::<TONES>(|n| {
            sums[n][0] += swing * turns[n][0];
            sums[n][1] += swing * turns[n][1];
        });
    }

    #[inline(always)]
    fn finish<const TONES: usize>(&mut self, ended: &Sums) {
        let blanked = ended.blanked;
        let inverse = 1.0 / (ended.weight - blanked);
        let [first, second] = &mut self.cycles;
        // The cycle that ends, and the one before it, whose memory the next cycle uses.
        let (cycle, before) = if self.complete == 0 {
            (second, first)
        } else {
            (first, second)
        };
        self.complete ^= 1;
        let sums = core::iter::once(ended.first).chain(self.multiples);
        for (measured, sums) in self.measured.iter_mut().zip(sums).take(1 + TONES) {
            for (measured, sum) in measured.iter_mut().zip(sums) {
                *measured = (2.0 * sum - blanked * *measured) * inverse;
            }
        }
        self.multiples[..TONES].fill([0.0; 2]);
        [cycle.in_phase, cycle.quadrature] = self.measured[0];
        cycle.upper[..TONES].copy_from_slice(&self.measured[1..=TONES]);
        cycle.mean = self.mean + ended.accelerations * inverse;
        self.mean = cycle.mean;
        cycle.noise = self.detector.noise();
        cycle.blanked = blanked / ended.weight;
        let pending = &self.pending;
        (self.average).finish(pending.average_from, pending.step, &mut cycle.average);
        self.energy.end_cycle(&mut cycle.sectors);
        let readings = core::mem::replace(&mut self.readings, Readings::NONE);
        (cycle.samples, cycle.saturated) = (readings.samples, readings.saturated);
        (cycle.low, cycle.high) = (readings.low, readings.high);
        before.impacts.clear();
        self.amplitude = self.next_amplitude;
        self.overtones[..TONES].copy_from_slice(&pending.overtones[..TONES]);
        self.timing = self.next_timing;
    }

    /// Last whole cycle.
    pub fn cycle(&self) -> &Cycle {
        &self.cycles[usize::from(self.complete & 1)]
    }

    /// Sets the command for the next cycle; applies it now if it is immediate.
    #[inline]
    pub fn command(&mut self, command: Command) {
        self.pending = command;
        // Computed here, as the sample at the cycle's end is the most expensive.
        self.next_timing = CycleTiming::from_step(command.step, command.whole);
        let (sine, cosine) = sine_cosine_single(command.lead);
        self.next_amplitude = [command.amplitude * cosine, command.amplitude * sine];
        if command.immediate {
            self.amplitude = self.next_amplitude;
            self.overtones = command.overtones;
        }
    }

    /// Switches the output off at once.
    pub fn off(&mut self) {
        self.amplitude = [0.0; 2];
        self.next_amplitude = [0.0; 2];
        self.overtones = [[0.0; 2]; UPPER];
        self.pending.overtones = [[0.0; 2]; UPPER];
    }

    /// Phase of the output at the last sample.
    pub fn phase(&self) -> Phase {
        self.phase
    }
}

/// Cosine and sine of the multiples of a phase, from twice on, by Chebyshev's recurrence.
#[inline(always)]
fn multiples<const TONES: usize>(sine: f32, cosine: f32) -> [[f32; 2]; TONES] {
    let mut turns = [[0.0; 2]; TONES];
    for_each_upper_tone::<TONES>(|n| {
        turns[n] = if n == 0 {
            [(cosine - sine) * (cosine + sine), 2.0 * sine * cosine]
        } else {
            let twice = 2.0 * cosine;
            [twice * turns[0][0] - cosine, twice * turns[0][1] - sine]
        };
    });
    turns
}

/// Calls `act` for each tone above the first, unrolled: a loop would slow the sample by a quarter.
#[inline(always)]
fn for_each_upper_tone<const TONES: usize>(mut act: impl FnMut(usize)) {
    const { assert!(TONES <= UPPER && UPPER == 2) };
    if TONES > 0 {
        act(0);
    }
    if TONES > 1 {
        act(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    /// Middle of the converter's range: rest.
    const REST: AdcCode = AdcCode(2048);

    fn signal() -> Signal {
        Signal::build(&Settings::default()).unwrap()
    }

    fn cycle(signal: &mut Signal, code: AdcCode) -> Cycle {
        while !signal.sample(code).wrapped {}
        signal.cycle().clone()
    }

    #[test]
    fn readings_at_either_end_of_the_converter_are_saturated() {
        for (code, counts) in [(0, true), (1, false), (4094, false), (4095, true)] {
            let mut signal = signal();
            // The sample that ends a cycle counts among the next cycle's readings.
            cycle(&mut signal, AdcCode(code));
            let actual = cycle(&mut signal, AdcCode(code));
            let expected = if counts { actual.samples } else { 0 };
            assert_eq!(actual.saturated, expected, "{code}");
        }
    }

    #[test]
    fn current_is_measured_at_any_phase_and_zero() {
        // The samples do not fit the cycles. A step is 8.06 mA.
        for (frequency, amperes, phase, zero) in [
            (61.0, 2.0, 0.0, 2048.0),
            (61.0, 0.5, 1.0, 1800.0),
            (61.0, 0.0, 0.0, 2048.0),
            (470.0, 0.5, 1.0, 1000.0),
        ] {
            let settings = Settings {
                frequency,
                safe_amplitude: 0.001,
                current_sensitivity: 0.1,
                ..Settings::default()
            };
            let mut signal = Signal::build(&settings).unwrap();
            for _ in 0..2000 {
                let next = signal.phase() + Phase::from_bits(signal.timing.step);
                let (sine, _) = sine_cosine_single(next + Phase::from_radians(phase));
                let steps = zero + amperes * sine * 0.1 / 3.3 * 4096.0 + 0.5;
                signal.sample_with(REST, || AdcCode(steps as u16));
            }
            let measured = signal.cycle().current;
            assert_eq!(signal.cycle().in_phase, 0.0);
            let holds = (measured - amperes).abs() < 2e-3;
            assert!(holds, "{frequency} {amperes}: {measured}");
        }
    }

    #[test]
    fn an_immediate_command_changes_upper_tones_within_its_cycle() {
        let settings = with(Settings::default(), |it| it.second_tone = 0.1);
        for immediate in [true, false] {
            let mut signal = Signal::build(&settings).unwrap();
            cycle(&mut signal, REST);
            signal.command(Command {
                overtones: [[0.2, 0.0]; UPPER],
                step: signal.timing.step,
                immediate,
                ..Command::default()
            });
            // A cycle of 50 Hz has 400 samples.
            let peak = (0..390).fold(0.0_f32, |max, _| max.max(signal.sample(REST).output));
            assert_eq!(peak > 0.19, immediate, "{peak}");
            let peak = (0..400).fold(0.0_f32, |max, _| max.max(signal.sample(REST).output));
            assert!(peak > 0.19, "{peak}");
        }
    }

    #[test]
    fn output_stays_off_past_the_end_of_the_cycle() {
        let mut signal = signal();
        let command = Command {
            amplitude: 0.5,
            step: signal.timing.step,
            ..Command::default()
        };
        signal.command(command);
        cycle(&mut signal, REST);
        let peak = (0..400).fold(0.0_f32, |max, _| max.max(signal.sample(REST).output));
        assert!(peak > 0.49, "{peak}");
        // One command is active, another waits for the end of the cycle.
        signal.command(with(command, |it| it.amplitude = 0.9));
        signal.off();
        assert!((0..1000).all(|_| signal.sample(REST).output == 0.0));
    }
}
