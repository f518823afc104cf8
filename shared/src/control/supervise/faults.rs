//! Fault detector: signs of a fault in the sensor's readings, each debounced.
//!
//! Method: limit checks on measured signals and on residuals against a model of the drive
//! (Isermann, Fault-Diagnosis Systems, 2006). Each sign feeds a leaky counter; oscillation is
//! detected by counting reversals with hysteresis.

use core::f32::consts::PI;

use crate::control::hear::Cycle;
use crate::control::state::Fault;

/// Peak-to-peak range of a dead reading, in converter steps: a constant voltage between two steps
/// toggles the last one.
const STILL_STEPS: u16 = 1;
/// Cycles of a dead reading that are a fault: from [`Expected::least`] on, the default sensor's
/// noise alone spans more steps in each.
const STILL: u8 = 3;
/// Peak-to-peak range of a cut wire, in converter steps: noise of 1.5 steps RMS spans 9 in 400
/// samples, a cycle at 50 Hz.
const NOISE_STEPS: u16 = 10;
/// Cycles of a cut wire without a response that are a fault: half of [`UNANSWERED`].
const NOISE: u8 = 8;
/// Readings per cycle at the ends of the converter's range; one ringing of 2.4 kHz has two on each
/// side, at 20 kHz.
const CLIPPED: u16 = 4;
/// Cycles of saturation that are a fault: the time constant of a kick
/// ([`Settings`](crate::control::Settings)), whose crest alone is none.
const SATURATED: u8 = 5;
/// Smallest amplitude over the expected one that is a response: a third of the smallest plausible
/// one.
const ANSWER: f32 = 0.15;
/// Cycles without a response that are a fault: two time constants at Q = 25, after which a drive
/// reaches 86 % of the expected amplitude.
const UNANSWERED: u8 = 15;
/// Largest factor between the amplitude's ratio to the expected one and its usual value in this
/// run; it detects halved sensitivity or supply.
const CHANGED: f32 = 1.9;
/// Cycles after which the usual ratio counts as estimated.
const KNOWN: f32 = 16.0;
/// Memory of the usual ratio in cycles (exponential forgetting): drives change by a third as they
/// warm up, in minutes.
const USUAL: f32 = 500.0;
/// Cycles of an implausible amplitude that are a fault: a second at 50 Hz, twice what the gain
/// estimate needs.
const IMPLAUSIBLE: u8 = 50;
/// Distance of a wrong lead from both ends of its half turn, in rad, for noise and detuning up to
/// 4.7 % at Q = 25.
const WRONG_LEAD: f32 = 0.4;
/// Cycles of a wrong lead that are a fault: as many as of saturation, for a kick moves the phase
/// too.
const INVERTED: u8 = 5;
/// Amplitude over the hard limit that is a fault: five times the overshoot (3 %) of the
/// [`AmplitudeLoop`](crate::control::AmplitudeLoop) over a reference within it.
const EXCESS: f32 = 1.15;
/// Cycles of excessive amplitude that are a fault: two, because an impact can raise a single one.
const EXCESSIVE: u8 = 2;

/// Peak-to-peak swing of the amplitude, over its reference, that counts as a reversal; parts of a
/// fifth of the track's mass cause 0.075.
const SWING: f32 = 0.1;
/// Smallest swing in standard errors of the amplitude: four to either side.
const SWING_NOISE: f32 = 8.0;
/// Reversals that are a fault: three periods; a step of the drive's gain by 1.8 causes five at
/// most.
const OSCILLATING: u8 = 6;
/// Reversals from which the amplitude is unsteady, and from which one beyond [`PEAK`] is a fault:
/// one period.
const UNSTEADY: u8 = 2;
/// Largest amplitude of an oscillation, over the hard limit.
const PEAK: f32 = 1.04;
/// Cycles without a reversal after which the amplitude is steady again.
const STEADY: u8 = 64;
/// Relative change of the reference that restarts the count of reversals.
const MOVED: f32 = 0.05;

/// Reversals of the amplitude about a constant reference, counted with hysteresis (a zigzag
/// filter).
#[derive(Clone, Copy, Debug, Default)]
struct Turns {
    reference: f32,
    /// Highest or lowest amplitude since the last reversal, in m.
    extreme: f32,
    rising: bool,
    count: u8,
    /// Cycles since the last reversal.
    since: u8,
}

impl Turns {
    /// Adds a cycle's amplitude and its standard error, in m. Whether the amplitude oscillates.
    fn cycle(&mut self, measured: f32, reference: f32, ceiling: f32, error: f32) -> bool {
        // A reference that is not a number restarts the count.
        let stands = (reference - self.reference).abs() <= MOVED * self.reference;
        if !stands || reference <= 0.0 {
            *self = Self {
                reference,
                extreme: measured,
                ..Self::default()
            };
            return false;
        }
        let back = if self.rising {
            self.extreme - measured
        } else {
            measured - self.extreme
        };
        self.since = self.since.saturating_add(1);
        if back > SWING * reference + SWING_NOISE * error {
            self.rising = !self.rising;
            self.count = self.count.saturating_add(1);
            (self.extreme, self.since) = (measured, 0);
        } else if back < 0.0 {
            self.extreme = measured;
        }
        if self.since > STEADY {
            self.count = 0;
        }
        self.count >= OSCILLATING || self.count >= UNSTEADY && measured > PEAK * ceiling
    }
}

/// Leaky counter of a fault's sign: each cycle with it adds 2, each without subtracts 1. It also
/// detects a contact that bounces.
#[derive(Clone, Copy, Debug, Default)]
struct Persistence(u8);

impl Persistence {
    /// Adds a cycle. Whether the sign has persisted for `cycles` cycles.
    fn lasts(&mut self, present: bool, cycles: u8) -> bool {
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
struct Usual {
    ratio: f32,
    cycles: f32,
}

impl Usual {
    /// Whether an amplitude is too weak and whether it is too strong, by a factor, against the
    /// expected one and its usual ratio. A plausible one updates that ratio.
    fn judge(&mut self, measured: f32, expected: f32, tolerance: f32) -> (bool, bool) {
        let apart = |factor: f32, usual: f32| {
            (
                factor * measured < usual * expected,
                measured > factor * usual * expected,
            )
        };
        let (mut weak, mut strong) = apart(tolerance, 1.0);
        if self.cycles >= KNOWN {
            let (weaker, stronger) = apart(CHANGED.min(tolerance), self.ratio);
            weak |= weaker;
            strong |= stronger;
        }
        if !weak && !strong {
            self.cycles = (self.cycles + 1.0).min(USUAL);
            self.ratio += (measured / expected - self.ratio) / self.cycles;
        }
        (weak, strong)
    }
}

/// Predictions and limits against which a cycle's reading is checked.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// Whether the drive runs.
    pub running: bool,
    /// Whether the drive's response at its frequency is predictable: not during a resonance search.
    pub known: bool,
    /// Predicted amplitude of this cycle under the outputs so far, in m.
    pub amplitude: f32,
    /// Whether the track's lead is more than a quarter turn from the predicted one.
    pub opposed: bool,
    /// Smallest amplitude that the converter detects, in m.
    pub least: f32,
    /// Largest amplitude within the hard limits, in m.
    pub ceiling: f32,
    /// Reference of the amplitude loop, in m.
    pub reference: f32,
    /// Standard error of the measured amplitude, in m.
    pub error: f32,
    /// Largest factor between measured and expected amplitude.
    pub tolerance: f32,
    /// Whether the mean reading deviates from the one at rest at commissioning.
    pub shifted: bool,
}

/// Counters of every sign of a fault.
#[derive(Clone, Copy, Debug, Default)]
pub struct FaultDetector {
    still: Persistence,
    noise: Persistence,
    saturated: Persistence,
    inverted: Persistence,
    unanswered: Persistence,
    implausible: Persistence,
    shifted: Persistence,
    excessive: Persistence,
    usual: Usual,
    turns: Turns,
}

impl FaultDetector {
    /// Resets the usual ratio of measured to expected amplitude.
    pub fn forget_usual(&mut self) {
        self.usual = Usual::default();
    }

    /// Processes a cycle with its measured amplitude (m) and lead (rad). The results are a detected
    /// fault, and whether the reading is untrusted.
    pub fn cycle(
        &mut self,
        cycle: &Cycle,
        measured: f32,
        lead: f32,
        expected: &Expected,
    ) -> (Option<Fault>, bool) {
        let running = expected.running;
        let moving = running && expected.known && expected.amplitude > expected.least;
        let span = cycle.high.saturating_sub(cycle.low);
        let still = moving && span <= STILL_STEPS;
        let saturated = running && !still && cycle.saturated >= CLIPPED;
        let unanswered = moving && !still && measured < ANSWER * expected.amplitude;
        // A track lags behind its output by 0 to pi; an inverted sensor adds pi. Near the ends are
        // the held output (0.008 rad at 50 Hz), noise, transients, and drives further off their
        // resonance than 1/(2 Q tan 0.4). Beside its resonance a track turns against its output
        // while its amplitude changes; the prediction includes that.
        let wrong = expected.opposed && lead > WRONG_LEAD && lead < PI - WRONG_LEAD;
        let inverted = moving && !unanswered && wrong;
        if !running {
            self.usual = Usual::default();
        }
        let (weak, strong) = if moving && !still {
            self.usual
                .judge(measured, expected.amplitude, expected.tolerance)
        } else {
            (false, false)
        };
        let shifted = running && expected.shifted;
        let excessive = running && measured > EXCESS * expected.ceiling;
        // An untrusted reading is no reversal of the amplitude.
        let trusted = !(still || saturated || unanswered);
        let oscillates = if !running || !expected.known {
            self.turns = Turns::default();
            false
        } else {
            trusted
                && self.turns.cycle(
                    measured,
                    expected.reference,
                    expected.ceiling,
                    expected.error,
                )
        };
        let faults = [
            (self.still.lasts(still, STILL), Fault::SensorLost),
            (
                self.saturated.lasts(saturated, SATURATED),
                Fault::SensorSaturated,
            ),
            (
                self.inverted.lasts(inverted, INVERTED),
                Fault::SensorInverted,
            ),
            (
                self.noise.lasts(unanswered && span <= NOISE_STEPS, NOISE),
                Fault::SensorLost,
            ),
            (
                self.unanswered.lasts(unanswered, UNANSWERED),
                Fault::NoResponse,
            ),
            (
                self.excessive.lasts(excessive, EXCESSIVE),
                Fault::OverAmplitude,
            ),
            (
                self.implausible.lasts(weak || strong, IMPLAUSIBLE),
                Fault::SensorImplausible,
            ),
            (
                self.shifted.lasts(shifted, IMPLAUSIBLE),
                Fault::SensorImplausible,
            ),
            (oscillates, Fault::AmplitudeOscillates),
        ];
        let fault = faults.iter().find(|(lasts, _)| *lasts);
        (
            fault.map(|&(_, fault)| fault),
            still || saturated || unanswered || weak,
        )
    }

    /// Whether the amplitude has not reversed back and forth about its reference.
    pub fn is_steady(&self) -> bool {
        self.turns.count < UNSTEADY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::settings::Settings;
    use crate::control::target::Target;
    use crate::plant::{ClosedLoop, DriveModel, EnvelopeLoop, Scene};

    const EXPECTED: Expected = Expected {
        running: true,
        known: true,
        amplitude: 1e-4,
        opposed: true,
        least: 1e-6,
        ceiling: 1e-3,
        reference: 1e-4,
        error: 0.0,
        tolerance: 2.5,
        shifted: false,
    };

    /// A cycle of a sensor that moves.
    fn moving() -> Cycle {
        Cycle {
            low: 2000,
            high: 2100,
            ..Cycle::default()
        }
    }

    /// Fault that the detector finds in a number of equal cycles.
    fn after(cycles: usize, cycle: &Cycle, measured: f32, lead: f32) -> Option<Fault> {
        let mut detector = FaultDetector::default();
        (0..cycles).fold(None, |found, _| {
            found.or(detector.cycle(cycle, measured, lead, &EXPECTED).0)
        })
    }

    #[test]
    fn a_reading_that_may_not_be_trusted_is_said_at_once() {
        let moving = moving();
        let still = Cycle {
            high: 2000,
            ..moving.clone()
        };
        let clipped = Cycle {
            saturated: CLIPPED,
            ..moving.clone()
        };
        for (cycle, measured, blind) in [
            (&moving, 1e-4, false),
            (&still, 1e-4, true),
            (&clipped, 1e-4, true),
            (&moving, 1e-5, true),
            (&moving, 0.3e-4, true),
            (&moving, 3e-4, false),
        ] {
            let seen = FaultDetector::default().cycle(cycle, measured, -PI / 2.0, &EXPECTED);
            assert_eq!(seen, (None, blind), "{measured}");
            // Without a predictable response only the converter's own ends raise suspicion.
            let searching = Expected {
                known: false,
                ..EXPECTED
            };
            let seen = FaultDetector::default().cycle(cycle, measured, -PI / 2.0, &searching);
            assert_eq!(seen, (None, cycle.saturated > 0), "{measured}");
        }
    }

    #[test]
    fn what_does_not_answer_is_not_inverted_whatever_its_phase() {
        let moving = moving();
        assert_eq!(after(14, &moving, 1e-5, 1.0), None);
        assert_eq!(after(15, &moving, 1e-5, 1.0), Some(Fault::NoResponse));
    }

    #[test]
    fn each_sign_is_a_fault_where_it_is_as_strong_and_lasts_as_long_as_its_constant_says() {
        let moving = moving();
        let spread = |steps: u16| Cycle {
            high: 2000 + steps,
            ..moving.clone()
        };
        let clipped = |saturated: u16| Cycle {
            saturated,
            ..moving.clone()
        };
        let well = (1e-4, -PI / 2.0);
        let cases = [
            (spread(1), spread(2), well, well, 3, Fault::SensorLost),
            (
                clipped(4),
                clipped(3),
                well,
                well,
                5,
                Fault::SensorSaturated,
            ),
            (
                moving.clone(),
                moving.clone(),
                (1e-4, 0.41),
                (1e-4, 0.39),
                5,
                Fault::SensorInverted,
            ),
            (
                moving.clone(),
                moving.clone(),
                (1e-4, PI - 0.41),
                (1e-4, PI - 0.39),
                5,
                Fault::SensorInverted,
            ),
            (
                moving.clone(),
                moving.clone(),
                (1.4e-5, well.1),
                (1.6e-5, well.1),
                15,
                Fault::NoResponse,
            ),
            (
                spread(10),
                spread(11),
                (1.4e-5, well.1),
                (1.6e-5, well.1),
                8,
                Fault::SensorLost,
            ),
            (
                moving.clone(),
                moving,
                (1.16e-3, well.1),
                (1.14e-3, well.1),
                2,
                Fault::OverAmplitude,
            ),
        ];
        for (ill, sound, (b, lead), (sound_b, sound_lead), cycles, fault) in cases {
            assert_eq!(after(cycles, &ill, b, lead), Some(fault));
            assert_eq!(after(cycles - 1, &ill, b, lead), None, "{fault:?}");
            // Short enough to be no implausible amplitude.
            assert_eq!(after(49, &sound, sound_b, sound_lead), None, "{fault:?}");
        }
    }

    #[test]
    fn amplitudes_far_apart_are_implausible_in_a_second_and_others_never() {
        let moving = moving();
        for (measured, found) in [
            (0.39e-4, Some(Fault::SensorImplausible)),
            (0.41e-4, None),
            (2.49e-4, None),
            (2.51e-4, Some(Fault::SensorImplausible)),
        ] {
            assert_eq!(after(50, &moving, measured, -1.5), found);
            assert_eq!(after(49, &moving, measured, -1.5), None);
        }
    }

    #[test]
    fn a_change_by_half_is_implausible_whatever_the_gain_was_told_as() {
        for (told, changed, found) in [
            (1.0, 0.5, true),
            (1.0, 2.0, true),
            (1.0, 0.6, false),
            (1.0, 1.7, false),
            (2.0, 1.0, true),
            (0.5, 1.0, true),
            (2.0, 2.4, false),
        ] {
            let mut usual = Usual::default();
            for _ in 0..200 {
                assert_eq!(usual.judge(told * 1e-4, 1e-4, 2.5), (false, false));
            }
            // As long as a fault takes to be detected, and longer.
            let suspected =
                (0..100).all(|_| usual.judge(changed * 1e-4, 1e-4, 2.5) != (false, false));
            assert_eq!(suspected, found, "{told} {changed}");
        }
        // A change as slow as warming up is no fault.
        let mut usual = Usual::default();
        for n in 0..6000 {
            let ratio = 1.0 - 0.5 * n as f32 / 6000.0;
            assert_eq!(usual.judge(ratio * 1e-4, 1e-4, 2.5), (false, false), "{n}");
        }
    }

    #[test]
    fn a_narrower_tolerance_bounds_ratio_and_change() {
        // Against the configured gain.
        for (ratio, found) in [(0.76, true), (0.78, false), (1.29, false), (1.31, true)] {
            let suspected = Usual::default().judge(ratio, 1.0, 1.3) != (false, false);
            assert_eq!(suspected, found, "{ratio}");
        }
        // Against the usual ratio.
        let mut usual = Usual {
            ratio: 1.2,
            cycles: KNOWN,
        };
        assert_eq!(usual.judge(0.91, 1.0, 1.3), (true, false));
        assert_eq!(usual.judge(0.94, 1.0, 1.3), (false, false));
    }

    #[test]
    fn a_shifted_mean_is_implausible_while_the_drive_runs() {
        let cycle = moving();
        let after = |running, cycles| {
            let expected = Expected {
                running,
                shifted: true,
                ..EXPECTED
            };
            let mut detector = FaultDetector::default();
            (0..cycles).find_map(|_| detector.cycle(&cycle, 1e-4, -1.5, &expected).0)
        };
        assert_eq!(after(true, 49), None);
        assert_eq!(after(true, 50), Some(Fault::SensorImplausible));
        assert_eq!(after(false, 200), None);
    }

    #[test]
    fn a_contact_that_bounces_evades_no_count() {
        let mut detector = FaultDetector::default();
        let found = (0..200).find_map(|n| {
            // Every other cycle is sound.
            let (measured, high) = if n % 2 == 0 {
                (1e-4, 2100)
            } else {
                (0.0, 2000)
            };
            let cycle = Cycle {
                low: 2000,
                high,
                ..Cycle::default()
            };
            detector.cycle(&cycle, measured, -1.5, &EXPECTED).0
        });
        assert_eq!(found, Some(Fault::SensorLost));
    }

    /// Cycle at which an amplitude oscillating about 0.1 mm is a fault; its swing is relative, its
    /// period in cycles.
    fn oscillating(swing: f32, period: f32, ceiling: f32, error: f32) -> Option<usize> {
        let mut turns = Turns::default();
        (0..400).find(|n| {
            let phase = core::f32::consts::TAU * *n as f32 / period;
            let measured = 1e-4 * (1.0 + swing * libm::sinf(phase));
            turns.cycle(measured, 1e-4, ceiling, error)
        })
    }

    #[test]
    fn an_amplitude_that_swings_is_a_fault_within_four_periods_and_at_the_limit_within_three() {
        for period in [2.9_f32, 7.0, 20.0, 100.0] {
            let found = oscillating(0.07, period, 1e-3, 0.0).unwrap();
            assert!(found as f32 <= 4.0 * period, "{period}: {found}");
            // At the hard limit.
            let found = oscillating(0.07, period, 1e-4, 0.0).unwrap();
            assert!(found as f32 <= 2.2 * period + 4.0, "{period}: {found}");
            assert_eq!(oscillating(0.045, period, 1e-4, 0.0), None, "{period}");
            // Within the reading's own error.
            assert_eq!(oscillating(0.07, period, 1e-4, 1e-6), None, "{period}");
        }
        // Too slow to be an oscillation of the loop.
        assert_eq!(oscillating(0.07, 300.0, 1e-3, 0.0), None);
    }

    #[test]
    fn turns_of_a_reference_that_moves_are_no_oscillation() {
        let mut turns = Turns::default();
        for n in 0..400 {
            let moved = if n % 8 < 4 { 1e-4 } else { 1.3e-4 };
            assert!(!turns.cycle(moved, moved, 1e-4, 0.0));
        }
        // A few reversals, then a pause, then a few more.
        for _ in 0..2 {
            for n in 0..4 {
                let swing = if n % 2 == 0 { 1.08e-4 } else { 0.92e-4 };
                assert!(!turns.cycle(swing, 1e-4, 1e-3, 0.0));
            }
            assert!(turns.count >= UNSTEADY);
            for _ in 0..STEADY + 2 {
                turns.cycle(1.08e-4, 1e-4, 1e-3, 0.0);
            }
            assert_eq!(turns.count, 0);
        }
    }

    /// Fault that stops a scene in the envelope plant within some cycles.
    fn fault(scene: &Scene, cycles: usize) -> Option<Fault> {
        let mut closed = EnvelopeLoop::build(scene).unwrap();
        (0..cycles).find_map(|_| closed.cycle().report.fault)
    }

    #[test]
    fn a_gain_wrong_by_two_is_plausible_by_three_it_is_not_and_at_a_tenth_it_does_not_answer() {
        let scene = |gain| Scene {
            target: Target::Amplitude(0.15),
            drive: DriveModel {
                gain,
                ..DriveModel::default()
            },
            ..Scene::default()
        };
        for gain in [0.5, 2.0] {
            assert_eq!(fault(&scene(gain), 400), None, "{gain}");
        }
        for gain in [1.0 / 3.0, 0.25, 3.0] {
            let found = fault(&scene(gain), 400);
            assert_eq!(found, Some(Fault::SensorImplausible), "{gain}");
        }
        assert_eq!(fault(&scene(0.1), 400), Some(Fault::NoResponse));
    }

    #[test]
    fn sharp_and_blunt_drives_start_capture_and_stop_without_a_fault() {
        for (quality, lot) in [(5.0, 0.2), (25.0, 0.2), (120.0, 0.2), (25.0, 0.5)] {
            let scene = Scene {
                settings: Settings {
                    quality,
                    restitution_low: lot - 0.01,
                    restitution_high: lot + 0.01,
                    ..Settings::default()
                },
                drive: DriveModel {
                    quality,
                    ..DriveModel::default()
                },
                parts: core::iter::repeat_n(lot, 24).collect(),
                ..Scene::default()
            };
            let mut closed = ClosedLoop::build(&scene).unwrap();
            for _ in 0..600 {
                assert_eq!(closed.cycle().report.fault, None, "Q {quality} R {lot}");
            }
        }
    }
}
