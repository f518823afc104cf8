//! The amplitude loop: it holds the track's amplitude b at its reference, cycle by cycle.
//!
//! At its resonance the drive's amplitude is a first-order lag. There the loop is a PI controller
//! with feedforward through the inverse of that lag. Its integral time is that of the envelope
//! (lambda tuning: Astrom and Hagglund, Advanced PID Control, 2006). Anti-windup is conditional
//! integration. A saturated output moves the reference to the value that the output can realize
//! (conditioning technique: Hanus, Kinnaert and Henrotte 1987).
//!
//! Off the resonance the envelope rotates relative to the output and beats. From 2.5 half widths
//! on, a PI loop of six cycles would oscillate. There the output is the reference through the
//! inverse of the rotating envelope, over the estimated gain. The only feedback is then the gain
//! estimate with exponential forgetting: an integral loop. `margins` has its stability margins.

use super::envelope::{Envelope, absolute};
use super::observer::{ImpactPhase, Observer};
use super::scale::min_amplitude;
use crate::saturate::saturate;
use crate::settings::Settings;
use kband::feeder::OutOfRange;
use num_complex::Complex32 as Complex;

/// Time constant of the closed loop in cycles: phase margin 70 degrees, gain margin above 4.
const CLOSED_LOOP_CYCLES: f32 = 6.0;
/// Weight of a cycle in the gain estimate: a memory of four closed-loop time constants.
const GAIN_FORGETTING: f32 = 0.04;
/// Dead time in cycles: computing 1, driving 1, averaging 0.5.
pub const DEAD_TIME_CYCLES: f32 = 2.5;
/// Time constant of the gain estimate off the resonance, over dead time plus envelope.
const GAIN_TIME_CONSTANT_RATIO: f32 = 3.0;
/// Largest factor between estimated and configured gain; a larger one is a fault or a wrong scale.
const GAIN_RANGE: f32 = 4.0;
/// Share of the full envelope above which the gain is estimated: 13 times a reading's noise.
const MIN_ENVELOPE_FOR_GAIN: f32 = 0.02;
/// Relative deviation of a cycle's gain above which the estimate is a mean over the start.
const GAIN_DEVIATION_FOR_MEAN: f32 = 0.1;
/// Minimum duration of a soft start in cycles, in which a gain wrong by a factor of 2 is estimated.
const MIN_START_CYCLES: f32 = 16.0;
/// The same in time constants of the envelope, for parts of configured mass without an observer.
/// Parts that leave gear during the rise remove their load: 40 % of that step becomes overshoot.
const MIN_LOADED_START_TIME_CONSTANTS: f32 = 4.0;
/// The same off the resonance: a gain wrong by 2 then overshoots the hard limit by 1.8 %.
const MIN_DETUNED_START_CYCLES: f32 = 60.0;
/// Cycles of gain estimation, off the resonance, before a start runs at full rate.
const FULL_RATE_CYCLES: f32 = 16.0;
/// Cycles added to those of gain estimation: a start off the resonance begins at 1/16 of its rate.
const INITIAL_RATE_CYCLES: f32 = 1.0;
/// Minimum duration of a start off the resonance over the lag of the envelope's phase.
const START_OVER_PHASE_LAG: f32 = 6.0;
/// Minimum duration of a start off the resonance in cycles, over the inverse's first output.
const START_OVER_INVERSE_OUTPUT: f32 = 1.5;

/// Fixed values of the loop, derived from the settings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Tuning {
    /// Share of the envelope that survives one cycle: exp(-pi w0 / (Q w)).
    decay: f32,
    /// Integral gain over proportional gain, per cycle.
    integral: f32,
    /// Proportional gain times the drive's gain.
    proportional: f32,
    /// Smallest weight of a cycle in the gain estimate.
    forgetting: f32,
    /// Share of the full envelope above which the gain is estimated.
    min_envelope: f32,
    /// Largest output, as a share of full output.
    max_output: f32,
    /// Configured track amplitude at full output, in m.
    nominal: f32,
    min_start: f32,
}

/// The inverse of a rotating envelope, `(z - pole)(z - pole*) / (z (z - forget))`, of gain 1 at
/// rest, in steps of one cycle. The amplitude's zero is its pole `forget = (pole.re - |pole|^2)/(1
/// - pole.re)`. A negative pole would make the output alternate, so 0 replaces it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Inverse {
    forget: f32,
    /// Weights of the reference one and two cycles ago.
    weights: [f32; 2],
    scale: f32,
}

impl Inverse {
    fn from_pole(pole: Complex) -> Self {
        let forget = ((pole.re - pole.norm_sqr()) / (1.0 - pole.re)).max(0.0);
        let rest = (Complex::new(1.0, 0.0) - pole).norm_sqr();
        Self {
            forget,
            weights: [-2.0 * pole.re, pole.norm_sqr()],
            scale: (1.0 - forget) / rest,
        }
    }

    /// The next value, from the previous value and the references, newest first.
    fn next(&self, before: f32, [newest, second, third, _]: [f32; 4]) -> f32 {
        let [one, two] = self.weights;
        self.forget * before + (newest + one * second + two * third) * self.scale
    }
}

/// The loop that holds the amplitude, with anti-windup and an estimate of the drive's gain.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AmplitudeLoop {
    tuning: Tuning,
    envelope: Envelope,
    inverse: Inverse,
    /// Estimated track amplitude at full output, in m.
    gain: f32,
    /// Cycles since the start in which the gain was estimated, and a quarter of all cycles.
    estimated_cycles: f32,
    quarter_cycles: f32,
    /// Integral term of the output, as a share of full output.
    integral_term: f32,
    /// References at the ends of four cycles, newest first, in m: next, running, measured, before.
    reference: [f32; 4],
    /// The reference through the inverse, in m.
    inverted: f32,
    /// Outputs of the first three of these cycles, newest first.
    output: [f32; 3],
    /// Predicted envelope at the measured cycle's end, for unit gain.
    model: Complex,
    pub saturated: bool,
    /// Load observer, which replaces the feedback on a track of configured mass.
    observer: Option<Observer>,
}

impl AmplitudeLoop {
    pub fn build(settings: &Settings) -> Result<Self, OutOfRange> {
        settings.check()?;
        let envelope = Envelope::from_settings(settings);
        let cycles = settings.quality * (1.0 / core::f32::consts::PI) * settings.frequency
            / settings.resonance;
        let nominal = settings.gain * 1e-3 * envelope.response;
        let inverse = Inverse::from_pole(envelope.pole);
        // Lag of the envelope's phase, in cycles.
        let phase_lag = (Complex::new(1.0, 0.0) - envelope.pole).inv().im.abs();
        // The observer's gain at high frequencies is about Q/2 over the drive's gain. A drive of
        // several tones has modes at multiples of the frequency, which are unstable at that gain.
        let loaded = settings.track_mass > 0.0 && envelope.first_order;
        let observed = loaded && settings.upper_tones() == 0;
        let (forgetting, min_envelope, min_start) = if envelope.first_order {
            let min_start = if loaded && !observed {
                MIN_START_CYCLES.max(MIN_LOADED_START_TIME_CONSTANTS * cycles)
            } else {
                MIN_START_CYCLES
            };
            (GAIN_FORGETTING, MIN_ENVELOPE_FOR_GAIN, min_start)
        } else {
            (
                1.0 / (GAIN_TIME_CONSTANT_RATIO * (DEAD_TIME_CYCLES + envelope.cycles)),
                MIN_ENVELOPE_FOR_GAIN.min(2.0 * min_amplitude(settings) / nominal),
                MIN_DETUNED_START_CYCLES
                    .max(START_OVER_PHASE_LAG * phase_lag)
                    .max(START_OVER_INVERSE_OUTPUT * inverse.scale),
            )
        };
        Ok(Self {
            tuning: Tuning {
                decay: libm::expf(-1.0 / cycles),
                integral: 1.0 / cycles,
                proportional: cycles / CLOSED_LOOP_CYCLES,
                forgetting,
                min_envelope,
                max_output: settings.output_maximum,
                nominal,
                min_start,
            },
            envelope,
            inverse,
            gain: nominal,
            observer: observed.then(|| Observer::from_amplitude(0.0, 0.0, 0.0)),
            ..Self::default()
        })
    }

    /// Load of the parts as a share of full output; 0 without a configured track mass.
    pub fn load(&self) -> f32 {
        (self.observer).map_or(0.0, |observer| observer.load(self.tuning.decay) / self.gain)
    }

    /// Whether the output takes effect immediately instead of at the next wrap of the phase.
    pub fn is_immediate(&self) -> bool {
        self.observer.is_some()
    }

    pub fn forget(&mut self) {
        self.gain = self.tuning.nominal;
        self.resume(0.0, 0.0);
    }

    /// Resumes at an amplitude (m) that an output (share of full output) holds. At rest both are 0,
    /// and the gain estimate stays.
    pub fn resume(&mut self, amplitude: f32, output: f32) {
        self.estimated_cycles = 0.0;
        self.quarter_cycles = 0.0;
        self.integral_term = 0.0;
        self.saturated = false;
        self.reference = [amplitude; 4];
        self.inverted = amplitude;
        self.output = [output; 3];
        self.model = Complex::new(output, 0.0);
        if output > 0.0 && amplitude > 0.0 {
            self.gain = amplitude / output;
            self.estimated_cycles = 1.0 / GAIN_FORGETTING;
        }
        let driven = output * self.gain;
        self.observer =
            (self.observer).map(|_| Observer::from_amplitude(amplitude, driven, self.tuning.decay));
    }

    /// Minimum duration of a soft start in cycles, and the share of its rate that it may have now.
    pub fn start_limits(&self) -> (f32, f32) {
        if self.envelope.first_order {
            return (self.tuning.min_start, 1.0);
        }
        let cycles = self.estimated_cycles.max(self.quarter_cycles) + INITIAL_RATE_CYCLES;
        (self.tuning.min_start, (cycles / FULL_RATE_CYCLES).min(1.0))
    }

    /// Processes the amplitude measured in the last cycle and the `reference` for the end of the
    /// cycle after next, in m. Returns that cycle's output over full output, at most `limit`.
    pub fn cycle(&mut self, measured: f32, reference: f32, limit: f32) -> f32 {
        let high = self.tuning.max_output.min(limit);
        let [newest, before, oldest, _] = self.reference;
        self.reference = [reference, newest, before, oldest];
        self.quarter_cycles += 0.25;
        let old = self.gain;
        self.estimate_gain(measured);
        let (raw, output) = if self.envelope.first_order {
            // The integral term drops the part that the feedforward now gives.
            self.integral_term += self.reference[2] * (1.0 / old - 1.0 / self.gain);
            self.control_at_resonance(measured, high)
        } else {
            let inverted = self.inverse.next(self.inverted, self.reference);
            let raw = inverted / self.gain;
            let output = saturate(raw, 0.0, high);
            self.inverted = if raw == output {
                inverted
            } else {
                output * self.gain
            };
            (raw, output)
        };
        self.saturated = raw > high;
        let [newest, before, _] = self.output;
        self.output = [output, newest, before];
        output
    }

    /// As [`AmplitudeLoop::cycle`], with the load observer; `motion` in m, along sine and cosine of
    /// the output's phase. Returns output and its phase lead (rad).
    pub fn control_under_load(
        &mut self,
        motion: Complex,
        impact_phase: ImpactPhase,
        reference: f32,
        limit: f32,
    ) -> Option<[f32; 2]> {
        let tuning = self.tuning;
        let observer = self.observer.as_mut()?;
        let largest = tuning.max_output.min(limit);
        let high = largest * self.gain;
        let rotated = motion * Complex::new(0.0, 1.0);
        let requested = observer.cycle(rotated, impact_phase, reference, tuning.decay);
        self.saturated = absolute(requested) > high && (requested.re > 0.0);
        let [driven, lead] = observer.limit_output(requested, high);
        // The quotient is rounded and may exceed the limit by one digit.
        Some([(driven / self.gain).min(largest), lead])
    }

    /// Estimates the gain from the cycle that ended: a mean over the start, then exponential.
    fn estimate_gain(&mut self, measured: f32) {
        let tuning = self.tuning;
        let (before, driven) = (self.model, self.output[1]);
        self.model = self.envelope.advance(before, driven);
        let predicted = if self.envelope.first_order {
            0.5 * (absolute(before) + absolute(self.model))
        } else {
            absolute(self.envelope.mean(before, driven))
        };
        if predicted > tuning.min_envelope {
            let (low, high) = (tuning.nominal / GAIN_RANGE, tuning.nominal * GAIN_RANGE);
            let measured_gain = saturate(measured / predicted, low, high);
            let gain_error = measured_gain - self.gain;
            let weight = if self.envelope.first_order
                && gain_error.abs() < GAIN_DEVIATION_FOR_MEAN * self.gain
            {
                tuning.forgetting
            } else {
                (1.0 / (self.estimated_cycles + 1.0)).max(tuning.forgetting)
            };
            self.gain += weight * gain_error;
            self.estimated_cycles = (self.estimated_cycles + 1.0).min(1.0 / tuning.forgetting);
        }
    }

    /// The output of the PI loop with feedforward, before and after its limits.
    fn control_at_resonance(&mut self, measured: f32, high: f32) -> (f32, f32) {
        let tuning = self.tuning;
        let requested = 0.5 * (self.reference[2] + self.reference[3]);
        let error = requested - measured;
        let inverse = 1.0 / self.gain;
        let feedforward =
            (self.reference[0] - tuning.decay * self.reference[1]) * inverse / (1.0 - tuning.decay);
        let proportional_term = tuning.proportional * error * inverse;
        let raw = feedforward + proportional_term + self.integral_term;
        let output = saturate(raw, 0.0, high);
        if raw != output {
            // Reference that the limited output realizes (conditioning technique).
            let excess = output - proportional_term - self.integral_term;
            let [goal, before, ..] = self.reference;
            let filtered = tuning.decay * before + (1.0 - tuning.decay) * self.gain * excess;
            self.reference[0] = saturate(filtered, goal.min(before), goal.max(before));
        }
        // Conditional integration: not further into the limit.
        if (raw <= high || error < 0.0) && (raw >= 0.0 || error > 0.0) {
            self.integral_term += tuning.integral * proportional_term;
        }
        (raw, output)
    }

    /// Feedback gains for the margins: proportional, integral over it, or gain weight.
    pub(super) fn gains(&self) -> [f32; 3] {
        let tuning = self.tuning;
        if self.envelope.first_order {
            [tuning.proportional, tuning.integral, 0.0]
        } else {
            [0.0, 0.0, tuning.forgetting]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    /// The drive's exact envelope, averaged over each cycle; `gain` is over the configured one.
    #[derive(Default)]
    struct SimulatedDrive {
        envelope: f32,
        latched: f32,
        gain: f32,
    }

    impl SimulatedDrive {
        fn cycle(&mut self, output: f32) -> f32 {
            let decay = libm::expf(-core::f32::consts::PI / 25.0);
            let before = self.envelope;
            self.envelope = decay * before + (1.0 - decay) * self.latched * self.gain * 1e-3;
            self.latched = output;
            0.5 * (before + self.envelope)
        }
    }

    #[test]
    fn amplitude_settles_within_a_second_at_any_gain() {
        let goal = 0.23e-3;
        for gain in [0.7, 1.0, 1.3] {
            let mut control = AmplitudeLoop::build(&Settings::default()).unwrap();
            let mut drive = with(SimulatedDrive::default(), |it| it.gain = gain);
            let (mut output, mut peak, mut last_outside) = (0.0, 0.0_f32, 0);
            for n in 0..200 {
                let b = drive.cycle(output);
                output = control.cycle(b, goal * ((n + 2) as f32 / 20.0).min(1.0), 1.0);
                peak = peak.max(b / goal);
                if (b / goal - 1.0).abs() > 0.01 {
                    last_outside = n;
                }
            }
            // 50 cycles are one second; 5 % in k is 5 % in b.
            let holds = peak < 1.05 && last_outside < 50;
            assert!(holds, "{gain}: {peak} {last_outside}");
        }
    }

    #[test]
    fn no_output_is_above_what_is_allowed_now() {
        for resonance in [50.0, 47.0] {
            let settings = with(Settings::default(), |it| it.resonance = resonance);
            let mut control = AmplitudeLoop::build(&settings).unwrap();
            for limit in [0.3, 0.1, 0.2] {
                let output = control.cycle(0.0, 2e-3, limit);
                assert!(output <= limit, "{resonance}: {output} of {limit}");
            }
        }
    }

    /// The amplitude is too small to estimate the gain: only the feedforward acts.
    #[test]
    fn detuned_reference_continues_from_the_limited_output() {
        let settings = with(Settings::default(), |it| it.resonance = 48.0);
        let mut control = AmplitudeLoop::build(&settings).unwrap();
        assert!(!control.envelope.first_order && control.inverse.forget > 0.1);
        let reference = 0.01 * control.gain;
        for _ in 0..50 {
            control.cycle(0.0, reference, 0.004);
        }
        assert_eq!(control.cycle(0.0, reference, 0.004), 0.004);
        let first = control.cycle(0.0, reference, 1.0);
        let forget = control.inverse.forget;
        let expected = forget * 0.004 + (1.0 - forget) * 0.01;
        assert!((first - expected).abs() < 1e-5, "{first} {expected}");
    }

    #[test]
    fn a_reference_out_of_reach_saturates_and_does_not_wind_up() {
        let mut control = AmplitudeLoop::build(&Settings::default()).unwrap();
        let mut drive = with(SimulatedDrive::default(), |it| it.gain = 1.0);
        let mut output = 0.0;
        let mut cycle = |reference: f32| {
            let measured = drive.cycle(output);
            output = control.cycle(measured, reference, 1.0);
            (measured, control.saturated)
        };
        let reach = 1e-3 * Settings::default().output_maximum;
        for (reference, saturated) in [(0.95, false), (1.05, true), (2.0, true)] {
            let last = (0..500).map(|_| cycle(reference * reach)).last().unwrap();
            assert_eq!(last.1, saturated, "{reference}");
        }
        // From 0.95 mm the free decay alone needs 5 cycles to 0.55 mm.
        let cycles = (0..20).position(|_| cycle(0.5e-3).0 < 0.55e-3);
        assert!(cycles.is_some());
    }

    #[test]
    fn a_track_of_several_tones_has_no_observer_of_its_load() {
        let sine = with(Settings::default(), |it| it.track_mass = 10.0);
        let with = with(sine, |it| it.second_tone = 0.15);
        assert!(AmplitudeLoop::build(&sine).unwrap().is_immediate());
        assert!(!AmplitudeLoop::build(&with).unwrap().is_immediate());
    }
}
