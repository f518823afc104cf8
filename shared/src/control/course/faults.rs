//! The fault detector: what looks like a fault, and is one where it persists.

use core::f32::consts::PI;

use crate::control::hear::Cycle;
use crate::control::state::Fault;

/// Amplitude in m that the drive should have before its answer is judged. At 50 Hz its acceleration, 2 m/s^2,
/// is 25 steps of the default converter, and 13 times the RMS of the default sensor's noise.
const MOVING: f32 = 0.02e-3;
/// Steps of the converter that a dead reading may move by: the last one, between two of them.
const STILL_STEPS: u16 = 1;
/// Cycles of that: with [`MOVING`], the default sensor's noise alone moves over more steps in each.
const STILL: u8 = 3;
/// Readings of a cycle at the ends of the converter's range. Fewer may be the crest of one ringing: two
/// readings of 2.4 kHz at 20 kHz, on each side.
const CLIPPED: u16 = 4;
/// Cycles of that: the time constant of a kick ([`Settings`](crate::control::Settings)), whose crest alone is none.
const SATURATED: u8 = 5;
/// Least share of the expected amplitude that is an answer. The loop follows the drive's gain down to a
/// quarter of its setting; what is weaker by as much again is no drive.
const ANSWER: f32 = 0.15;
/// Cycles without one: two time constants of the envelope at Q = 25, in which a drive that was switched on
/// or retuned has come to 86 % of what is expected.
const UNANSWERED: u8 = 15;
/// Distance in rad of a wrong lead from both ends of the half turn where it is wrong. A track lags behind its
/// output by 0 to pi, an inverted sensor says pi more; within this of the ends are the held output (0.008 rad at
/// 50 Hz), noise and transients, and only drives further off their resonance than 1/(2 Q tan 0.4), 4.7 % at
/// Q = 25.
const WRONG_LEAD: f32 = 0.4;
/// Cycles of it: as many, for a kick moves the phase too.
const INVERTED: u8 = 5;
/// Amplitude over the hard limit that is a fault. The reference never goes beyond the limit, and the loop never
/// more than 5 % beyond its reference ([`AmplitudeLoop`](crate::control::AmplitudeLoop)): three times that.
const EXCESS: f32 = 1.15;
/// Cycles of it: the least in a row, for a single one may have been struck.
const EXCESSIVE: u8 = 2;

/// Cycles in a row in which a sign of a fault was seen.
#[derive(Clone, Copy, Debug, Default)]
struct Persistence(u8);

impl Persistence {
    /// Whether `present` has been true for `cycles` cycles in a row.
    fn lasts(&mut self, present: bool, cycles: u8) -> bool {
        self.0 = if present { self.0.saturating_add(1) } else { 0 };
        self.0 >= cycles
    }
}

/// What a cycle's reading is held against.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// Whether the drive runs.
    pub running: bool,
    /// Amplitude that nominal gain would give, in m.
    pub amplitude: f32,
    /// Largest amplitude that the hard limits allow, in m.
    pub ceiling: f32,
}

/// What the reading of the accelerometer is suspected of.
#[derive(Clone, Copy, Debug, Default)]
pub struct FaultDetector {
    still: Persistence,
    saturated: Persistence,
    inverted: Persistence,
    unanswered: Persistence,
    excessive: Persistence,
}

impl FaultDetector {
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
        let moving = running && expected.amplitude > MOVING;
        let still = moving && cycle.high <= cycle.low.saturating_add(STILL_STEPS);
        let saturated = running && !still && cycle.saturated >= CLIPPED;
        let unanswered = moving && !still && measured < ANSWER * expected.amplitude;
        let inverted = moving && !unanswered && lead > WRONG_LEAD && lead < PI - WRONG_LEAD;
        let excessive = running && measured > EXCESS * expected.ceiling;
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
                self.unanswered.lasts(unanswered, UNANSWERED),
                Fault::NoResponse,
            ),
            (
                self.excessive.lasts(excessive, EXCESSIVE),
                Fault::OverAmplitude,
            ),
        ];
        let fault = faults.iter().find(|(lasts, _)| *lasts);
        (
            fault.map(|&(_, fault)| fault),
            still || saturated || unanswered,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Settings, Target};
    use crate::plant::{ClosedLoop, DriveModel, EnvelopeLoop, Scene};

    /// What the detector says of a number of cycles alike.
    fn after(cycles: usize, cycle: &Cycle, measured: f32, lead: f32) -> Option<Fault> {
        let expected = Expected {
            running: true,
            amplitude: 1e-4,
            ceiling: 1e-3,
        };
        let mut detector = FaultDetector::default();
        (0..cycles).fold(None, |found, _| {
            found.or(detector.cycle(cycle, measured, lead, &expected).0)
        })
    }

    #[test]
    fn each_sign_is_a_fault_where_it_is_as_strong_and_lasts_as_long_as_its_constant_says() {
        let moving = Cycle {
            low: 2000,
            high: 2100,
            ..Cycle::default()
        };
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
            assert_eq!(after(100, &sound, sound_b, sound_lead), None, "{fault:?}");
        }
    }

    /// The fault that stops a scene within some cycles, in the envelope.
    fn fault(scene: &Scene, cycles: usize) -> Option<Fault> {
        let mut closed = EnvelopeLoop::build(scene).unwrap();
        (0..cycles).find_map(|_| closed.cycle().report.fault)
    }

    #[test]
    fn a_drive_at_a_quarter_of_its_gain_answers_and_one_at_a_tenth_does_not() {
        let scene = |gain| Scene {
            target: Target::Amplitude(0.15),
            drive: DriveModel {
                gain,
                ..DriveModel::default()
            },
            ..Scene::default()
        };
        assert_eq!(fault(&scene(0.25), 400), None);
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
