//! The signal path of one sample: drive phase, demodulation, onset detection, drive output.

use heapless::Vec;

use super::energy::{Energy, SECTORS_HANDED, Sectors};
use super::fold::{Fold, Folded, HANDED};
use super::onset::{HEARD_PER_CYCLE, Heard, OnsetDetector};
use crate::arithmetic::{Phase, sine_cosine_single};
use crate::control::angle::phase_step;
use crate::control::drive::UPPER;
use crate::control::settings::Settings;
use crate::feeder::{OutOfRange, STANDARD_GRAVITY};

/// Share of a cycle that the demodulator blanks at most: what is left still tells cosine, sine and mean apart.
pub const MOST_BLANKED: f64 = 1.0 / 3.0;

/// A reading of the converter, right-aligned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AdcCode(pub u16);

/// The nth tone of an output, as shares of full output: `sine sin nx + cosine cos nx` for the phase x of the output.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overtone {
    /// Along the sine of the multiple of the phase, -1..1.
    pub sine: f32,
    /// Along its cosine, -1..1.
    pub cosine: f32,
}

impl Overtone {
    /// No tone.
    pub const NONE: Self = Self {
        sine: 0.0,
        cosine: 0.0,
    };
}

/// What the drive is to do from the next cycle on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Amplitude of the output as a share of full output, 0..1.
    pub amplitude: f32,
    /// Second and third tone of the output; with the amplitude at most full output.
    pub overtones: [Overtone; UPPER],
    /// Advance of the phase per sample (see [`phase_step`](crate::control::phase_step)).
    pub step: u32,
    /// Whether the output changes at once instead of at the next cycle: switching off never waits.
    pub immediate: bool,
    /// Phase of the output from which on, for half a turn, the residual is summed over cycles, from the next
    /// cycle on; `None` ends that and has the sums handed over.
    pub fold: Option<Phase>,
    /// Whether the demodulator takes every sample from the next cycle on, also while an impact rings: an
    /// identification takes off by itself what ringings add.
    pub whole: bool,
}

/// What one cycle of the drive brought.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cycle {
    /// Samples in it.
    pub samples: u16,
    /// Cosine part of the acceleration at the drive's frequency, against the output's phase, in m/s^2.
    pub in_phase: f32,
    /// Sine part of it, in m/s^2.
    pub quadrature: f32,
    /// Cosine and sine part of it at twice and three times the drive's frequency, against as many times the output's phase, in
    /// m/s^2; 0 where the drive affords no such tone.
    pub upper: [[f32; 2]; UPPER],
    /// Mean acceleration in m/s^2.
    pub mean: f32,
    /// Lowest reading.
    pub low: u16,
    /// Highest reading.
    pub high: u16,
    /// Readings at either end of the converter's range.
    pub saturated: u16,
    /// RMS of the noise in the residual in m/s^2.
    pub noise: f32,
    /// The impacts heard, in the order of their time; what is too much is not kept.
    pub(crate) heard: Vec<Heard, HEARD_PER_CYCLE>,
    /// A part of what was folded ([`Command::fold`]) until a cycle before.
    pub(crate) folded: Folded,
    /// Energy of the residual in some sectors of the turn.
    pub(crate) sectors: Sectors,
}

/// What a signal path that fails brings, to show what depends on it.
#[cfg(feature = "unstable")]
impl Cycle {
    /// No impact is heard.
    pub fn deafen(&mut self) {
        self.heard.clear();
    }

    /// All that was folded is this residual in m/s^2.
    pub fn flatten(&mut self, residual: f32) {
        self.folded.residual.fill(residual);
    }
}

/// What a sample gives back to the interrupt that took it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampled {
    /// Output of the drive as a share of full output, -1..1.
    pub output: f32,
    /// Whether this sample began a new cycle, so that [`Signal::cycle`] is fresh.
    pub wrapped: bool,
}

/// The signal path: configuration, oscillator, demodulator and onset detector.
///
/// The ringing of an impact begins at once and dies slowly, which would add to what the demodulator finds: 4.7 % of the
/// amplitude for 24 parts that strike together and ring at 800 Hz. So the samples in which an impact still rings
/// ([`OnsetDetector::rings`]) are blanked, up to a third of a cycle: the last cycle's swing stands for them, with no say in the new one.
/// That leaves 0.3 % at most of 24 parts, at 800 Hz and at 2.4 kHz, where the amplitude is steady; where it changes
/// quickly, what is blanked weighs on the measured change.
///
/// Deadline: one sample (50 us); the sample interrupt calls [`Signal::sample`] and nothing else. A
/// missed sample shifts the drive's phase, which the demodulator then measures with everything else.
///
/// ```
/// use kband::control::{AdcCode, Settings, Signal};
/// let mut signal = Signal::build(&Settings::default())?;
/// // 50 Hz at 20 000 samples a second: a drive cycle ends after 400 of them.
/// let wraps = (0..2010).filter(|_| signal.sample(AdcCode(2048)).wrapped).count();
/// assert_eq!(wraps, 5);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
///
/// What it makes of an acceleration:
///
/// ```
/// use kband::arithmetic::sine_cosine_single;
/// use kband::control::{AdcCode, Settings, Signal};
/// let settings = Settings::default();
/// let mut signal = Signal::build(&settings)?;
/// // A track whose acceleration is 20 m/s^2 times the sine of the output's phase, read by the converter.
/// let zero = settings.sensor_zero / settings.converter_reference * 4096.0;
/// for _ in 0..2000 {
///     let step = kband::arithmetic::Phase::from_bits(kband::control::phase_step(50.0));
///     let (sine, _) = sine_cosine_single(signal.phase() + step);
///     let code = zero + 20.0 * sine / signal.resolution() + 0.5;
///     signal.sample(AdcCode(code as u16));
/// }
/// let cycle = signal.cycle();
/// assert!((cycle.quadrature - 20.0).abs() < 0.01);
/// assert!(cycle.in_phase.abs() < 0.01);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Debug)]
pub struct Signal {
    scale: f32,
    zero: f32,
    full: u16,
    phase: Phase,
    step: u32,
    inverse_step: f32,
    amplitude: f32,
    /// Tones of the output above the first, and how many the drive affords: for these the demodulator looks too.
    overtones: [Overtone; UPPER],
    upper: usize,
    pending: Command,
    /// Mean of the last cycle, taken off before demodulation so that gravity does not leak into it.
    mean: f32,
    cosines: f32,
    sines: f32,
    /// The same at multiples of the drive's frequency.
    multiples: [[f32; 2]; UPPER],
    accelerations: f32,
    weight: f32,
    /// Samples of the cycle that were blanked, and how many may be.
    blanked: f32,
    most_blanked: f32,
    running: Cycle,
    finished: Cycle,
    detector: OnsetDetector,
    fold: Fold,
    energy: Energy,
}

impl Signal {
    /// The signal path these settings describe, drive off; the refusal names the parameter.
    pub fn build(settings: &Settings) -> Result<Self, OutOfRange> {
        settings.check()?;
        let full = ((1_u32 << settings.converter_bits as u32) - 1) as u16;
        let volts = settings.converter_reference / (f32::from(full) + 1.0);
        let scale = volts / settings.sensitivity * STANDARD_GRAVITY as f32;
        let step = phase_step(settings.frequency);
        Ok(Self {
            scale,
            zero: settings.sensor_zero / volts,
            full,
            phase: Phase::ZERO,
            step,
            inverse_step: 1.0 / step as f32,
            amplitude: 0.0,
            overtones: [Overtone::NONE; UPPER],
            upper: settings.upper_tones(),
            pending: Command {
                amplitude: 0.0,
                overtones: [Overtone::NONE; UPPER],
                step,
                immediate: false,
                fold: None,
                whole: false,
            },
            mean: 0.0,
            cosines: 0.0,
            sines: 0.0,
            multiples: [[0.0; 2]; UPPER],
            accelerations: 0.0,
            weight: 0.0,
            blanked: 0.0,
            most_blanked: 0.0,
            running: Self::EMPTY,
            finished: Self::EMPTY,
            detector: OnsetDetector::new(scale),
            fold: Fold::EMPTY,
            energy: Energy::EMPTY,
        })
    }

    const EMPTY: Cycle = Cycle {
        samples: 0,
        in_phase: 0.0,
        quadrature: 0.0,
        upper: [[0.0; 2]; UPPER],
        mean: 0.0,
        low: u16::MAX,
        high: 0,
        saturated: 0,
        noise: 0.0,
        heard: Vec::new(),
        folded: Folded {
            first: 0,
            residual: [0.0; HANDED],
        },
        sectors: Sectors {
            first: 0,
            energy: [0.0; SECTORS_HANDED],
        },
    };

    /// Takes the reading of one sample, gives the output to hold until the next.
    #[inline]
    pub fn sample(&mut self, code: AdcCode) -> Sampled {
        // One path for each number of tones, so that a tone that is not made costs nothing.
        match self.upper {
            0 => self.take::<0>(code),
            1 => self.take::<1>(code),
            _ => self.take::<UPPER>(code),
        }
    }

    /// As [`Signal::sample`], with so many tones above the first; called, so that an image has each path once.
    #[inline(never)]
    fn take<const TONES: usize>(&mut self, code: AdcCode) -> Sampled {
        let before = self.phase;
        self.phase += Phase::from_bits(self.step);
        let wrapped = self.phase.bits() < before.bits();
        let acceleration = (f32::from(code.0) - self.zero) * self.scale;
        let (sine, cosine) = sine_cosine_single(self.phase);
        // The nth tone's acceleration is n^2 times as large, and the detector's high-passes leave n^2 times as
        // much of it: what the cycle before had of them is taken off before them.
        let turns: [[f32; 2]; TONES] = multiples(sine, cosine);
        let mut explained = 0.0;
        for ([cosine, sine], [by_cosine, by_sine]) in turns.iter().zip(&self.finished.upper) {
            explained += by_cosine * cosine + by_sine * sine;
        }
        let surprising = if TONES > 0 {
            acceleration - explained
        } else {
            acceleration
        };
        let residual = self.detector.residual(surprising);
        self.fold.add(self.phase, residual);
        self.energy.add(self.phase, residual);
        let heard = self.detector.detect(residual);
        let mut swing = acceleration - self.mean;
        let blanked = self.detector.rings() && self.blanked < self.most_blanked;
        if blanked {
            // What was found before stands for it, and has no say in what is found.
            swing = self.finished.in_phase * cosine + self.finished.quadrature * sine;
            if TONES > 0 {
                swing += explained;
            }
            self.blanked += 1.0;
        }
        let (by_cosine, by_sine) = (swing * cosine, swing * sine);
        if wrapped {
            // The sample stands for the interval that it ends; the wrap parts it between two cycles.
            let share = self.phase.bits() as f32 * self.inverse_step;
            let rest = 1.0 - share;
            self.add(&turns, rest * swing);
            self.cosines += rest * by_cosine;
            self.sines += rest * by_sine;
            self.accelerations += rest * swing;
            self.weight += rest;
            let begun = if blanked { share } else { 0.0 };
            self.blanked -= begun;
            self.finish();
            self.blanked = begun;
            self.cosines = share * by_cosine;
            self.sines = share * by_sine;
            self.accelerations = share * swing;
            self.weight = share;
            self.add(&turns, share * swing);
        } else {
            self.add(&turns, swing);
            self.cosines += by_cosine;
            self.sines += by_sine;
            self.accelerations += swing;
            self.weight += 1.0;
        }
        let cycle = &mut self.running;
        cycle.samples = cycle.samples.wrapping_add(1);
        if code.0 < cycle.low {
            cycle.low = code.0;
        }
        if code.0 > cycle.high {
            cycle.high = code.0;
        }
        if code.0 == 0 || code.0 >= self.full {
            cycle.saturated = cycle.saturated.wrapping_add(1);
        }
        if let Some(strength) = heard {
            // The ringing rises over the threshold within its first two samples: half of them on average.
            let _ = cycle.heard.push(Heard {
                phase: before,
                strength,
            });
        }
        let mut output = self.amplitude * sine;
        for ([cosine, sine], tone) in turns.iter().zip(&self.overtones) {
            output += tone.cosine * cosine + tone.sine * sine;
        }
        Sampled { output, wrapped }
    }

    /// Adds a share of a sample to what is found at multiples of the drive's frequency.
    #[inline(always)]
    fn add(&mut self, turns: &[[f32; 2]], swing: f32) {
        for (sums, turn) in self.multiples.iter_mut().zip(turns) {
            for (sum, part) in sums.iter_mut().zip(turn) {
                *sum += swing * part;
            }
        }
    }

    fn finish(&mut self) {
        let inverse = 1.0 / (self.weight - self.blanked);
        let (running, finished) = (&mut self.running, &mut self.finished);
        finished.in_phase = (2.0 * self.cosines - self.blanked * finished.in_phase) * inverse;
        finished.quadrature = (2.0 * self.sines - self.blanked * finished.quadrature) * inverse;
        let upper = finished.upper.iter_mut().zip(&mut self.multiples);
        for (found, sum) in upper.take(self.upper) {
            for (found, sum) in found.iter_mut().zip(sum) {
                *found = (2.0 * *sum - self.blanked * *found) * inverse;
                *sum = 0.0;
            }
        }
        finished.mean = self.mean + self.accelerations * inverse;
        finished.noise = self.detector.noise();
        finished.folded = self.fold.finish(self.pending.fold, self.pending.step);
        finished.sectors = self.energy.finish();
        finished.samples = running.samples;
        (finished.low, finished.high) = (running.low, running.high);
        finished.saturated = running.saturated;
        finished.heard.clear();
        for heard in &running.heard {
            // Both hold as many.
            let _ = finished.heard.push(*heard);
        }
        self.mean = finished.mean;
        running.samples = 0;
        (running.low, running.high) = (u16::MAX, 0);
        running.saturated = 0;
        running.heard.clear();
        self.amplitude = self.pending.amplitude;
        self.overtones = self.pending.overtones;
        if self.step != self.pending.step {
            self.step = self.pending.step;
            self.inverse_step = 1.0 / self.step as f32;
        }
        self.most_blanked = if self.pending.whole {
            0.0
        } else {
            MOST_BLANKED as f32 * Phase::TURN as f32 * self.inverse_step
        };
    }

    /// The last whole cycle.
    #[must_use]
    pub fn cycle(&self) -> &Cycle {
        &self.finished
    }

    /// What the drive is to do from the next cycle on, or at once if the command says so.
    pub fn command(&mut self, command: Command) {
        self.pending = command;
        if command.immediate {
            self.amplitude = command.amplitude;
            self.overtones = command.overtones;
        }
    }

    /// Switches the output off at once.
    pub fn off(&mut self) {
        self.amplitude = 0.0;
        self.overtones = [Overtone::NONE; UPPER];
        self.pending.amplitude = 0.0;
        self.pending.overtones = [Overtone::NONE; UPPER];
    }

    /// Phase of the output at the last sample.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Acceleration in m/s^2 that one step of the converter stands for.
    #[must_use]
    pub fn resolution(&self) -> f32 {
        self.scale
    }
}

/// Cosine and sine of twice a phase, three times, and so on, from those of the phase (Chebyshev's recurrence).
#[inline(always)]
fn multiples<const TONES: usize>(sine: f32, cosine: f32) -> [[f32; 2]; TONES] {
    let mut turns = [[0.0; 2]; TONES];
    let (mut before, mut now) = ([1.0, 0.0], [cosine, sine]);
    for (n, turn) in turns.iter_mut().enumerate() {
        let next = if n == 0 {
            [(cosine - sine) * (cosine + sine), 2.0 * sine * cosine]
        } else {
            let twice = 2.0 * cosine;
            [twice * now[0] - before[0], twice * now[1] - before[1]]
        };
        (before, now) = (now, next);
        *turn = next;
    }
    turns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::settings::Settings;

    /// Middle of the converter's range, which is rest.
    const REST: AdcCode = AdcCode(2048);

    fn signal() -> Signal {
        Signal::build(&Settings::default()).unwrap()
    }

    /// Runs on to the end of a cycle, with these readings.
    fn cycle(signal: &mut Signal, code: AdcCode) -> Cycle {
        while !signal.sample(code).wrapped {}
        signal.cycle().clone()
    }

    #[test]
    fn readings_at_either_end_of_the_converter_are_saturated() {
        for (code, counts) in [(0, true), (1, false), (4094, false), (4095, true)] {
            let mut signal = signal();
            // The sample that ends a cycle is one of the next one's readings.
            cycle(&mut signal, AdcCode(code));
            let seen = cycle(&mut signal, AdcCode(code));
            assert_eq!(
                seen.saturated,
                if counts { seen.samples } else { 0 },
                "{code}"
            );
        }
    }

    #[test]
    fn what_is_switched_off_stays_off_over_the_end_of_the_cycle() {
        let mut signal = signal();
        let command = Command {
            amplitude: 0.5,
            step: signal.step,
            ..Command::default()
        };
        signal.command(command);
        cycle(&mut signal, REST);
        let loudest = (0..400).fold(0.0_f32, |most, _| most.max(signal.sample(REST).output));
        assert!(loudest > 0.49, "{loudest}");
        // One command drives, another waits for the end of the cycle.
        signal.command(Command {
            amplitude: 0.9,
            ..command
        });
        signal.off();
        assert!((0..1000).all(|_| signal.sample(REST).output == 0.0));
    }

    #[test]
    fn a_command_counts_from_the_next_cycle_on_or_at_once() {
        for immediate in [false, true] {
            let mut signal = signal();
            for _ in 0..50 {
                signal.sample(REST);
            }
            signal.command(Command {
                amplitude: 0.5,
                step: signal.step,
                immediate,
                ..Command::default()
            });
            assert_eq!(signal.sample(REST).output != 0.0, immediate);
        }
    }

    #[test]
    fn an_impact_is_stamped_with_the_phase_before_the_sample_that_shows_it() {
        let mut signal = signal();
        for _ in 0..30 {
            cycle(&mut signal, REST);
        }
        for _ in 0..100 {
            signal.sample(REST);
        }
        let before = signal.phase();
        // A blow that rings: far over the threshold at once.
        signal.sample(AdcCode(2048 + 1500));
        for n in 0..20 {
            let ring = if n % 2 == 0 { 700 } else { 3400 };
            signal.sample(AdcCode(ring));
        }
        let heard = cycle(&mut signal, REST).heard;
        assert_eq!(heard.first().map(|heard| heard.phase), Some(before));
    }
}
