//! Fault detector: signs of a fault in the sensor's readings, each debounced.
//!
//! Method: limit checks on signals and on residuals against a model of the drive (Isermann,
//! Fault-Diagnosis Systems, 2006), by leaky counters. Reversals are counted with hysteresis.

use crate::{Cycle, Fault};
use core::f32::consts::PI;

/// Peak-to-peak range of a dead reading, in converter steps.
const DEAD_RANGE_STEPS: u16 = 1;
/// Cycles of a dead reading that are a fault: the default sensor's noise alone spans more steps.
const DEAD_CYCLES: u8 = 3;
/// Peak-to-peak range of a cut wire, in converter steps: noise spans 9 at 50 Hz.
const CUT_WIRE_RANGE_STEPS: u16 = 10;
/// Cycles of a cut wire without a response that are a fault: half of [`NO_RESPONSE_CYCLES`].
const CUT_WIRE_CYCLES: u8 = 8;
/// Readings per cycle at the converter's ends; one ringing of 2.4 kHz has two on each side.
const CLIPPED_READINGS: u16 = 4;
/// Cycles of saturation that are a fault: the time constant of a kick, whose crest alone is none.
const SATURATED_CYCLES: u8 = 5;
/// Smallest amplitude over the expected one that is a response: a third of the plausible one.
const MIN_RESPONSE_SHARE: f32 = 0.15;
/// Cycles without a response that are a fault: two time constants at Q = 25 (86 %).
const NO_RESPONSE_CYCLES: u8 = 15;
/// Largest factor between the amplitude's ratio to the expected one and its usual value.
const MAX_RATIO_CHANGE: f32 = 1.9;
/// Cycles after which the usual ratio counts as estimated.
const MIN_RATIO_CYCLES: f32 = 16.0;
/// Memory of the usual ratio in cycles: drives change by a third as they warm up, in minutes.
const RATIO_MEMORY_CYCLES: f32 = 500.0;
/// Cycles of an implausible amplitude that are a fault: twice the duration of the gain estimate.
const IMPLAUSIBLE_CYCLES: u8 = 50;
/// Distance of a wrong lead from its half turn's ends, in rad: noise and detuning.
const WRONG_LEAD_MARGIN: f32 = 0.4;
/// Cycles of a wrong lead that are a fault: as for saturation, because a kick also moves the phase.
const INVERTED_CYCLES: u8 = 5;
/// Amplitude over the hard limit that is a fault: five times the amplitude loop's overshoot (3 %).
const MAX_AMPLITUDE_RATIO: f32 = 1.15;
/// Cycles of excessive amplitude that are a fault: two, because an impact can raise a single one.
const EXCESS_CYCLES: u8 = 2;
/// Swing of the amplitude, over its reference, that counts as a reversal; heavy parts cause 0.075.
const REVERSAL_SWING: f32 = 0.1;
/// Smallest swing in standard errors of the amplitude: four to either side.
const REVERSAL_STANDARD_ERRORS: f32 = 8.0;
/// Reversals that are a fault: three periods; a step of the drive's gain by 1.8 causes five.
const OSCILLATION_REVERSALS: u8 = 6;
/// Reversals from which the amplitude is unsteady, and from which one beyond [`PEAK`] is a fault.
const UNSTEADY_REVERSALS: u8 = 2;
/// Largest amplitude of an oscillation, over the hard limit.
const PEAK: f32 = 1.04;
/// Cycles without a reversal after which the count begins again.
const STEADY_CYCLES: u8 = 64;
/// Cycles without a reversal after which READY may return: heavy parts beat over 60 to 80 cycles.
const READY_CYCLES: u8 = 160;
/// Largest relative error of the amplitude at READY.
const READY_ERROR: f32 = 0.08;
/// Allowance of READY for noise, in standard errors of the amplitude.
const READY_STANDARD_ERRORS: f32 = 4.0;
/// Relative change of the reference that restarts the count of reversals.
const REFERENCE_CHANGE: f32 = 0.05;

/// Reversals of the amplitude about a constant reference, counted with hysteresis (zigzag filter).
#[derive(Clone, Copy, Debug, Default)]
struct ReversalCounter {
    reference: f32,
    /// Highest or lowest amplitude since the last reversal, in m.
    extreme: f32,
    rising: bool,
    count: u8,
    since: u8,
    unsteady: bool,
    /// Whether the amplitude is too far from its reference for READY.
    deviates: bool,
}

impl ReversalCounter {
    /// Adds a cycle's amplitude and its standard error, in m. Returns whether it oscillates.
    fn cycle(&mut self, measured: f32, reference: f32, ceiling: f32, error: f32) -> bool {
        let tolerance = READY_ERROR * reference + READY_STANDARD_ERRORS * error;
        let deviates = (measured - reference).abs() > tolerance;
        // A reference that is not a number restarts the count.
        let unchanged = (reference - self.reference).abs() <= REFERENCE_CHANGE * self.reference;
        if !unchanged || reference <= 0.0 {
            *self = Self {
                reference,
                extreme: measured,
                deviates,
                ..Self::default()
            };
            return false;
        }
        self.deviates = deviates;
        let change = measured - self.extreme;
        let reversal = if self.rising { -change } else { change };
        self.since = self.since.saturating_add(1);
        if reversal > REVERSAL_SWING * reference + REVERSAL_STANDARD_ERRORS * error {
            self.rising = !self.rising;
            self.count = self.count.saturating_add(1);
            (self.extreme, self.since) = (measured, 0);
        } else if reversal < 0.0 {
            self.extreme = measured;
        }
        self.unsteady |= self.count >= UNSTEADY_REVERSALS;
        if self.since > STEADY_CYCLES {
            self.count = 0;
        }
        self.unsteady &= self.since <= READY_CYCLES;
        self.count >= OSCILLATION_REVERSALS
            || self.count >= UNSTEADY_REVERSALS && measured > PEAK * ceiling
    }
}

/// Whether a measured amplitude is below and whether it is above a predicted one, times its usual
/// ratio to that, by a factor.
fn differs(measured: f32, predicted: f32, factor: f32, ratio: f32) -> (bool, bool) {
    let weak = factor * measured < ratio * predicted;
    (weak, measured > factor * ratio * predicted)
}

/// Leaky counter of a fault's sign: each cycle with it adds 2, each without subtracts 1.
#[derive(Clone, Copy, Debug, Default)]
struct LeakyCounter(u8);

impl LeakyCounter {
    /// Adds a cycle. Returns whether the sign has persisted for `cycles` cycles.
    fn count(&mut self, present: bool, cycles: u8) -> bool {
        self.0 = if present {
            self.0.saturating_add(2)
        } else {
            self.0.saturating_sub(1)
        };
        self.0 >= 2 * cycles
    }
}

/// Ratio of measured to expected amplitude, averaged over the run.
#[derive(Clone, Copy, Debug, Default)]
struct RatioEstimate {
    ratio: f32,
    cycles: f32,
}

impl RatioEstimate {
    /// Whether an amplitude is too small and whether it is too large, by a factor. It is compared
    /// with the expected amplitude and with its usual ratio, which a plausible amplitude updates.
    fn check(&mut self, measured: f32, expected: f32, tolerance: f32) -> (bool, bool) {
        let (mut weak, mut strong) = differs(measured, expected, tolerance, 1.0);
        if self.cycles >= MIN_RATIO_CYCLES {
            let narrow = MAX_RATIO_CHANGE.min(tolerance);
            let (weaker, stronger) = differs(measured, expected, narrow, self.ratio);
            weak |= weaker;
            strong |= stronger;
        }
        if !weak && !strong {
            self.cycles = (self.cycles + 1.0).min(RATIO_MEMORY_CYCLES);
            self.ratio += (measured / expected - self.ratio) / self.cycles;
        }
        (weak, strong)
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Prediction {
    pub running: bool,
    /// Whether the drive's response at its frequency is predictable: not during a resonance search.
    pub valid: bool,
    /// Predicted amplitude of this cycle under the outputs so far, in m.
    pub amplitude: f32,
    /// Amplitude predicted from the drive's current, in m; `None` if it is not commissioned.
    pub by_current: Option<f32>,
    /// Whether the track's lead is more than a quarter turn from the predicted one.
    pub opposed: bool,
    /// Smallest amplitude that the converter detects, in m.
    pub min_amplitude: f32,
    /// Largest amplitude within the hard limits, in m.
    pub ceiling: f32,
    /// Reference of the amplitude loop, in m.
    pub reference: f32,
    /// Standard error of the measured amplitude, in m.
    pub error: f32,
    pub tolerance: f32,
    /// Whether the mean reading deviates from the one at rest at commissioning.
    pub shifted: bool,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct FaultDetector {
    /// Of each sign, in the order of their precedence.
    signs: [LeakyCounter; 9],
    load_ratio: RatioEstimate,
    reversals: ReversalCounter,
}

impl FaultDetector {
    /// Resets the usual ratio of measured to expected amplitude.
    pub fn reset_load_ratio(&mut self) {
        self.load_ratio = RatioEstimate::default();
    }

    /// Processes a cycle: amplitude (m), lead (rad). A fault, and whether its reading is untrusted.
    pub fn cycle(
        &mut self,
        cycle: &Cycle,
        measured: f32,
        lead: f32,
        expected: &Prediction,
    ) -> (Option<Fault>, bool) {
        let running = expected.running;
        let moving = running && expected.valid && expected.amplitude > expected.min_amplitude;
        let span = cycle.high.saturating_sub(cycle.low);
        let frozen = moving && span <= DEAD_RANGE_STEPS;
        let saturated = running && !frozen && cycle.saturated >= CLIPPED_READINGS;
        let no_response = moving && !frozen && measured < MIN_RESPONSE_SHARE * expected.amplitude;
        // A track lags its output by 0 to pi; an inverted sensor adds pi. Leads near the ends come
        // from the held output, noise, transients, and drives far off their resonance.
        let wrong = expected.opposed && lead > WRONG_LEAD_MARGIN && lead < PI - WRONG_LEAD_MARGIN;
        let inverted = moving && !no_response && wrong;
        if !running {
            self.load_ratio = RatioEstimate::default();
        }
        let suspected = (moving && !frozen)
            .then(|| (self.load_ratio).check(measured, expected.amplitude, expected.tolerance));
        let (mut weak, mut strong) = suspected.unwrap_or_default();
        let mut over_limit = false;
        if let Some(by_current) = expected.by_current
            && moving
        {
            let (weaker, stronger) = differs(measured, by_current, expected.tolerance, 1.0);
            weak |= weaker;
            strong |= stronger;
            over_limit = by_current > MAX_AMPLITUDE_RATIO * expected.tolerance * expected.ceiling;
        }
        let shifted = running && expected.shifted;
        let excessive = running && measured > MAX_AMPLITUDE_RATIO * expected.ceiling;
        // An untrusted reading is no reversal of the amplitude.
        let is_trusted = !(frozen || saturated || no_response);
        let oscillates = if !running || !expected.valid {
            self.reversals = ReversalCounter::default();
            false
        } else {
            let (reference, ceiling, error) =
                (expected.reference, expected.ceiling, expected.error);
            is_trusted && self.reversals.cycle(measured, reference, ceiling, error)
        };
        let cut_wire = no_response && span <= CUT_WIRE_RANGE_STEPS;
        let signs = [
            (frozen, DEAD_CYCLES, Fault::SensorLost),
            (saturated, SATURATED_CYCLES, Fault::SensorSaturated),
            (inverted, INVERTED_CYCLES, Fault::SensorInverted),
            (cut_wire, CUT_WIRE_CYCLES, Fault::SensorLost),
            (no_response, NO_RESPONSE_CYCLES, Fault::NoResponse),
            (excessive, EXCESS_CYCLES, Fault::OverAmplitude),
            (weak || strong, IMPLAUSIBLE_CYCLES, Fault::SensorImplausible),
            (shifted, IMPLAUSIBLE_CYCLES, Fault::SensorImplausible),
            (over_limit, EXCESS_CYCLES, Fault::SensorImplausible),
        ];
        let mut fault = oscillates.then_some(Fault::AmplitudeOscillates);
        for (counter, (present, cycles, cause)) in self.signs.iter_mut().zip(signs).rev() {
            if counter.count(present, cycles) {
                fault = Some(cause);
            }
        }
        (fault, frozen || saturated || no_response || weak)
    }

    /// Whether the amplitude is at its reference and does not oscillate about it.
    pub fn is_steady(&self) -> bool {
        !self.reversals.unsteady && !self.reversals.deviates
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    const EXPECTED: Prediction = Prediction {
        running: true,
        valid: true,
        amplitude: 1e-4,
        by_current: None,
        opposed: true,
        min_amplitude: 1e-6,
        ceiling: 1e-3,
        reference: 1e-4,
        error: 0.0,
        tolerance: 2.5,
        shifted: false,
    };

    fn by_current(amplitude: f32) -> Prediction {
        with(EXPECTED, |it| {
            (it.by_current, it.tolerance) = (Some(amplitude), 1.3)
        })
    }

    fn moving() -> Cycle {
        with(Cycle::default(), |it| (it.low, it.high) = (2000, 2100))
    }

    /// Fault that the detector finds in a number of equal cycles.
    fn after(cycles: usize, cycle: &Cycle, measured: f32, lead: f32) -> Option<Fault> {
        let mut detector = FaultDetector::default();
        (0..cycles).fold(None, |detected, _| {
            detected.or(detector.cycle(cycle, measured, lead, &EXPECTED).0)
        })
    }

    #[test]
    fn untrusted_reading_is_flagged_in_its_cycle() {
        let moving = moving();
        let frozen = with(moving.clone(), |it| it.high = 2000);
        let clipped = with(moving.clone(), |it| it.saturated = CLIPPED_READINGS);
        for (cycle, measured, untrusted) in [
            (&moving, 1e-4, false),
            (&frozen, 1e-4, true),
            (&clipped, 1e-4, true),
            (&moving, 1e-5, true),
            (&moving, 0.3e-4, true),
            (&moving, 3e-4, false),
        ] {
            let actual = FaultDetector::default().cycle(cycle, measured, -PI / 2.0, &EXPECTED);
            assert_eq!(actual, (None, untrusted), "{measured}");
            // Without a predictable response only the converter's own ends raise suspicion.
            let searching = with(EXPECTED, |it| it.valid = false);
            let actual = FaultDetector::default().cycle(cycle, measured, -PI / 2.0, &searching);
            assert_eq!(actual, (None, cycle.saturated > 0), "{measured}");
        }
    }

    #[test]
    fn each_sign_is_a_fault_at_its_threshold_and_duration() {
        // Range and saturated readings, amplitude in 0.1 mm, lead: with the sign, and just without.
        let lag = -PI / 2.0;
        use Fault::{SensorImplausible as Implausible, *};
        let cases = [
            ((1, 0, 1.0, lag), (2, 0, 1.0, lag), 3, SensorLost),
            ((99, 4, 1.0, lag), (99, 3, 1.0, lag), 5, SensorSaturated),
            ((99, 0, 1.0, 0.41), (99, 0, 1.0, 0.39), 5, SensorInverted),
            ((99, 0, 1.0, 2.73), (99, 0, 1.0, 2.75), 5, SensorInverted),
            ((99, 0, 0.14, lag), (99, 0, 0.16, lag), 15, NoResponse),
            // A missing response is never called inverted.
            ((99, 0, 0.10, 1.0), (99, 0, 0.16, lag), 15, NoResponse),
            ((10, 0, 0.14, lag), (11, 0, 0.16, lag), 8, SensorLost),
            ((99, 0, 11.6, lag), (99, 0, 11.4, lag), 2, OverAmplitude),
            ((99, 0, 0.39, lag), (99, 0, 0.41, lag), 50, Implausible),
            ((99, 0, 2.51, lag), (99, 0, 2.49, lag), 50, Implausible),
        ];
        let after = |cycles, (span, saturated, measured, lead): (u16, u16, f32, f32)| {
            let cycle = with(moving(), |it| {
                (it.high, it.saturated) = (2000 + span, saturated)
            });
            after(cycles, &cycle, measured * 1e-4, lead)
        };
        for (faulty, healthy, cycles, fault) in cases {
            assert_eq!(after(cycles, faulty), Some(fault));
            assert_eq!(after(cycles - 1, faulty), None, "{fault:?}");
            // Where it lasts, such an amplitude is implausible.
            let later = after(100, healthy);
            assert!(later != Some(fault), "{fault:?}");
            assert!(matches!(later, None | Some(Implausible)), "{later:?}");
        }
    }

    #[test]
    fn halved_ratio_is_implausible_at_any_gain() {
        for (usual_ratio, changed, detected) in [
            (1.0, 0.5, true),
            (1.0, 2.0, true),
            (1.0, 0.6, false),
            (1.0, 1.7, false),
            (2.0, 1.0, true),
            (0.5, 1.0, true),
            (2.0, 2.4, false),
        ] {
            let mut load_ratio = RatioEstimate::default();
            for _ in 0..200 {
                let checked = load_ratio.check(usual_ratio * 1e-4, 1e-4, 2.5);
                assert_eq!(checked, (false, false));
            }
            // As long as a fault takes to be detected, and longer.
            let suspected =
                (0..100).all(|_| load_ratio.check(changed * 1e-4, 1e-4, 2.5) != (false, false));
            assert_eq!(suspected, detected, "{usual_ratio} {changed}");
        }
        // A change as slow as warming up is no fault.
        let mut load_ratio = RatioEstimate::default();
        for n in 0..6000 {
            let ratio = 1.0 - 0.5 * n as f32 / 6000.0;
            let checked = load_ratio.check(ratio * 1e-4, 1e-4, 2.5);
            assert_eq!(checked, (false, false), "{n}");
        }
    }

    #[test]
    fn a_narrower_tolerance_bounds_ratio_and_change() {
        // Against the configured gain.
        for (ratio, detected) in [(0.76, true), (0.78, false), (1.29, false), (1.31, true)] {
            let suspected = RatioEstimate::default().check(ratio, 1.0, 1.3) != (false, false);
            assert_eq!(suspected, detected, "{ratio}");
        }
        // Against the usual ratio.
        let mut load_ratio = RatioEstimate {
            ratio: 1.2,
            cycles: MIN_RATIO_CYCLES,
        };
        assert_eq!(load_ratio.check(0.91, 1.0, 1.3), (true, false));
        assert_eq!(load_ratio.check(0.94, 1.0, 1.3), (false, false));
    }

    #[test]
    fn another_current_or_mean_is_implausible_in_a_second_or_at_once() {
        let cycle = moving();
        // Cycles to the fault, and whether the reading is untrusted at once.
        let after = |expected: &Prediction| {
            let mut detector = FaultDetector::default();
            let untrusted = detector.cycle(&cycle, 1e-4, -1.5, expected).1;
            let detected = (2..200).find(|_| {
                let fault = detector.cycle(&cycle, 1e-4, -1.5, expected).0;
                fault.inspect(|fault| assert_eq!(*fault, Fault::SensorImplausible));
                fault.is_some()
            });
            (detected, untrusted)
        };
        for (amplitude, result) in [
            (0.0, (Some(50), false)),
            (0.76e-4, (Some(50), false)),
            (0.78e-4, (None, false)),
            (1.29e-4, (None, false)),
            (1.31e-4, (Some(50), true)),
            (1.49e-3, (Some(50), true)),
            // 1.15 times the tolerance times the ceiling of 1 mm.
            (1.50e-3, (Some(2), true)),
        ] {
            assert_eq!(after(&by_current(amplitude)), result, "{amplitude}");
        }
        let unknown = with(by_current(1e-2), |it| it.valid = false);
        assert_eq!(after(&unknown), (None, false));
        let shifted = with(by_current(1e-4), |it| it.shifted = true);
        assert_eq!(after(&shifted), (Some(50), false));
        let rests = with(by_current(1e-2), |it| {
            (it.shifted, it.running) = (true, false)
        });
        assert_eq!(after(&rests), (None, false));
    }

    #[test]
    fn a_contact_that_bounces_evades_no_count() {
        let mut detector = FaultDetector::default();
        let detected = (0..200).find_map(|n| {
            // Every other cycle is sound.
            let (measured, high) = [(1e-4, 2100), (0.0, 2000)][n % 2];
            let cycle = with(Cycle::default(), |it| (it.low, it.high) = (2000, high));
            detector.cycle(&cycle, measured, -1.5, &EXPECTED).0
        });
        assert_eq!(detected, Some(Fault::SensorLost));
    }

    /// The tolerance is 8 % of the reference and four standard errors.
    #[test]
    fn an_amplitude_off_its_reference_is_not_steady() {
        for (measured, error, steady) in [
            (0.93e-4, 0.0, true),
            (0.91e-4, 0.0, false),
            (1.09e-4, 0.0, false),
            (1.11e-4, 1e-6, true),
            (1.13e-4, 1e-6, false),
        ] {
            let mut detector = FaultDetector::default();
            detector.reversals.cycle(measured, 1e-4, 1e-3, error);
            assert_eq!(detector.is_steady(), steady, "{measured}");
            detector.reversals.cycle(1e-4, 1e-4, 1e-3, error);
            assert!(detector.is_steady());
        }
    }

    /// Cycle at which a swing about 0.1 mm, of a relative size and a period in cycles, is a fault.
    fn oscillating(swing: f32, period: f32, ceiling: f32, error: f32) -> Option<usize> {
        let mut reversals = ReversalCounter::default();
        (0..400).find(|n| {
            let phase = core::f32::consts::TAU * *n as f32 / period;
            let measured = 1e-4 * (1.0 + swing * libm::sinf(phase));
            reversals.cycle(measured, 1e-4, ceiling, error)
        })
    }

    #[test]
    fn oscillation_is_a_fault_within_four_periods() {
        for period in [2.9_f32, 7.0, 20.0, 100.0] {
            let detected = oscillating(0.07, period, 1e-3, 0.0).unwrap();
            assert!(detected as f32 <= 4.0 * period, "{period}: {detected}");
            // At the hard limit.
            let detected = oscillating(0.07, period, 1e-4, 0.0).unwrap();
            let holds = detected as f32 <= 2.2 * period + 4.0;
            assert!(holds, "{period}: {detected}");
            assert_eq!(oscillating(0.045, period, 1e-4, 0.0), None, "{period}");
            // Within the reading's own error.
            assert_eq!(oscillating(0.07, period, 1e-4, 1e-6), None, "{period}");
        }
        // Too slow to be an oscillation of the loop.
        assert_eq!(oscillating(0.07, 300.0, 1e-3, 0.0), None);
    }

    #[test]
    fn moving_reference_is_no_oscillation() {
        let mut reversals = ReversalCounter::default();
        for n in 0..400 {
            let moved = if n % 8 < 4 { 1e-4 } else { 1.3e-4 };
            assert!(!reversals.cycle(moved, moved, 1e-4, 0.0));
        }
        // A few reversals, then a pause, then a few more.
        for _ in 0..2 {
            for n in 0..4 {
                let swing = if n % 2 == 0 { 1.08e-4 } else { 0.92e-4 };
                assert!(!reversals.cycle(swing, 1e-4, 1e-3, 0.0));
            }
            assert!(reversals.count >= UNSTEADY_REVERSALS);
            for n in 0..=READY_CYCLES + 1 {
                assert!(n > READY_CYCLES || reversals.unsteady, "{n}");
                reversals.cycle(1.08e-4, 1e-4, 1e-3, 0.0);
            }
            assert!(reversals.count == 0 && !reversals.unsteady);
        }
    }
}
