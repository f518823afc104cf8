//! The fault detector: what looks like a fault, and is one where it persists.

use core::f32::consts::PI;

use crate::control::hear::Cycle;
use crate::control::state::Fault;

// At a fraction and at a multiple of each of these one of the tests below fails.

/// Steps of the converter that a dead reading may move by: the last one, between two of them.
const STILL_STEPS: u16 = 1;
/// Cycles of that: from [`Expected::least`] on, the default sensor's noise alone moves over more steps in each.
const STILL: u8 = 3;
/// Steps that a cut wire spans: a converter's own noise of 1.5 steps RMS comes to 9 in the 400 samples of a cycle at 50 Hz.
const NOISE_STEPS: u16 = 10;
/// Cycles of that and no answer: half of those in which any drive that does not answer is a fault.
const NOISE: u8 = 8;
/// Readings of a cycle at the ends of the converter's range. Fewer may be the crest of one ringing: two
/// readings of 2.4 kHz at 20 kHz, on each side.
const CLIPPED: u16 = 4;
/// Cycles of that: the time constant of a kick ([`Settings`](crate::control::Settings)), whose crest alone is none.
const SATURATED: u8 = 5;
/// Least share of the expected amplitude that is an answer: a third of the least that is plausible.
const ANSWER: f32 = 0.15;
/// Cycles without one: two time constants of the envelope at Q = 25, in which a drive that was switched on
/// or retuned has come to 86 % of what is expected.
const UNANSWERED: u8 = 15;
/// How far, as a factor, they may be apart from how far they usually are in this run: a sensor that loses half of what it
/// gives, or whose supply falls to half, is not one whose gain was told wrong. A narrower tolerance of the settings replaces it.
const CHANGED: f32 = 1.9;
/// Cycles after which that is known, and the memory for it in cycles: drives change by a third as they warm up, in minutes.
const KNOWN: f32 = 16.0;
const USUAL: f32 = 500.0;
/// Cycles beyond either: a second at 50 Hz, in which the loop has learned a gain twice over.
const IMPLAUSIBLE: u8 = 50;
/// Distance in rad of a wrong lead from both ends of the half turn where it is wrong. A track lags behind its
/// output by 0 to pi, an inverted sensor says pi more; within this of the ends are the held output (0.008 rad at
/// 50 Hz), noise and transients, and only drives further off their resonance than 1/(2 Q tan 0.4), 4.7 % at
/// Q = 25.
const WRONG_LEAD: f32 = 0.4;
/// Cycles of it: as many, for a kick moves the phase too.
const INVERTED: u8 = 5;
/// Amplitude over the hard limit that is a fault. The reference never goes beyond the limit, and the loop never
/// more than 3 % beyond its reference ([`AmplitudeLoop`](crate::control::AmplitudeLoop)): five times that.
const EXCESS: f32 = 1.15;
/// Cycles of it: the least of more than one, for a single one may have been struck.
const EXCESSIVE: u8 = 2;

/// Peak-to-peak swing of the amplitude, over its reference, at which the amplitude has turned. A fifth of the track's mass in
/// parts moves it by 0.075 to one side in single cycles.
const SWING: f32 = 0.1;
/// The same swing in standard errors of the amplitude's reading: four standard errors to either side.
const SWING_NOISE: f32 = 8.0;
/// Turns that are a fault: three periods. A step of the drive's gain by 1.8 turns the amplitude five times at most.
const OSCILLATING: u8 = 6;
/// Turns from which on the amplitude is not steady, and from which on one beyond [`PEAK`] is a fault: one period.
const UNSTEADY: u8 = 2;
/// Amplitude over the hard limit that an oscillation may not reach.
const PEAK: f32 = 1.04;
/// Cycles without a turn after which the amplitude is steady again.
const STEADY: u8 = 64;
/// Change of the reference, as a share of it, after which turns are counted anew.
const MOVED: f32 = 0.05;

/// Turns of the amplitude about a reference that stands still: reversals by more than a threshold (a zigzag filter).
#[derive(Clone, Copy, Debug, Default)]
struct Turns {
    reference: f32,
    /// Highest or lowest amplitude since the last turn, in m.
    extreme: f32,
    rising: bool,
    count: u8,
    /// Cycles since the last turn.
    since: u8,
}

impl Turns {
    /// Takes the amplitude of a cycle and the standard error of its reading, in m; whether it oscillates.
    fn cycle(&mut self, measured: f32, reference: f32, ceiling: f32, error: f32) -> bool {
        // Also where either is no number.
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

/// Cycles in which a sign of a fault was seen: each that shows it adds two, each that does not takes one off, so that a
/// contact that bounces is found as well.
#[derive(Clone, Copy, Debug, Default)]
struct Persistence(u8);

impl Persistence {
    /// Whether `present` has been true for `cycles` cycles.
    fn lasts(&mut self, present: bool, cycles: u8) -> bool {
        self.0 = if present {
            self.0.saturating_add(2)
        } else {
            self.0.saturating_sub(1)
        };
        self.0 >= 2 * cycles
    }
}

/// Amplitude measured over amplitude expected, as it usually is in a run.
#[derive(Clone, Copy, Debug, Default)]
struct Usual {
    ratio: f32,
    cycles: f32,
}

impl Usual {
    /// Whether an amplitude is too weak and whether it is too strong for one that is expected, by a factor; one that is neither is
    /// learned.
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

/// What a cycle's reading is held against.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// Whether the drive runs.
    pub running: bool,
    /// Whether the drive's response at its frequency is known: it is not while the resonance is searched for.
    pub known: bool,
    /// Amplitude that the outputs so far should have given in this cycle, in m.
    pub amplitude: f32,
    /// Whether the track's lead is more than a quarter turn from the one that the outputs should have given.
    pub opposed: bool,
    /// Amplitude in m that the converter tells from rest.
    pub least: f32,
    /// Largest amplitude that the hard limits allow, in m.
    pub ceiling: f32,
    /// Amplitude that the loop follows, in m.
    pub reference: f32,
    /// Standard error of the amplitude's reading, in m.
    pub error: f32,
    /// How far, as a factor, amplitude measured and amplitude expected may be apart.
    pub tolerance: f32,
    /// Whether the mean reading deviates from the one at rest that was commissioned.
    pub shifted: bool,
}

/// What the reading of the accelerometer is suspected of.
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
    /// Forgets what is usual of amplitude measured over amplitude expected in this run.
    pub fn forget_usual(&mut self) {
        self.usual = Usual::default();
    }

    /// Takes a cycle with the amplitude (m) and the lead (rad) measured in it; the fault that it proves, and
    /// whether its reading may not be trusted.
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
        // A track beside its resonance turns against its output while its amplitude changes: that is expected.
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
        // A reading that may not be trusted is no turn of the amplitude.
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

    /// Whether the amplitude has not turned back and forth about its reference.
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

    /// What the detector says of a number of cycles alike.
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
            // Nothing is suspected of a drive whose response is not known, but the converter's own ends.
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
            // Not so long that it becomes implausible.
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
            // For as long as it takes to be a fault, and longer.
            let suspected =
                (0..100).all(|_| usual.judge(changed * 1e-4, 1e-4, 2.5) != (false, false));
            assert_eq!(suspected, found, "{told} {changed}");
        }
        // As slowly as drives warm up, it is none.
        let mut usual = Usual::default();
        for n in 0..6000 {
            let ratio = 1.0 - 0.5 * n as f32 / 6000.0;
            assert_eq!(usual.judge(ratio * 1e-4, 1e-4, 2.5), (false, false), "{n}");
        }
    }

    #[test]
    fn a_narrower_tolerance_bounds_ratio_and_change() {
        // Against what the gain lets expect.
        for (ratio, found) in [(0.76, true), (0.78, false), (1.29, false), (1.31, true)] {
            let suspected = Usual::default().judge(ratio, 1.0, 1.3) != (false, false);
            assert_eq!(suspected, found, "{ratio}");
        }
        // Against what is usual.
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

    /// The cycle in which an amplitude that swings to both sides of 0.1 mm by a share of it, with a period in cycles, is a fault.
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
            // At its limit.
            let found = oscillating(0.07, period, 1e-4, 0.0).unwrap();
            assert!(found as f32 <= 2.2 * period + 4.0, "{period}: {found}");
            assert_eq!(oscillating(0.045, period, 1e-4, 0.0), None, "{period}");
            // What the reading's own error explains.
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
        // A few turns, then a pause, and a few more.
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

    /// The fault that stops a scene within some cycles, in the envelope.
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
