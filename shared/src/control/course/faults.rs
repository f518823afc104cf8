//! The fault detector: what looks like a fault, and is one where it persists.

use core::f32::consts::PI;

use crate::control::hear::Cycle;
use crate::control::state::Fault;

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
        let moving = running && expected.amplitude > 0.02e-3;
        let still = moving && cycle.high <= cycle.low.saturating_add(1);
        let saturated = running && !still && cycle.saturated >= 4;
        let unanswered = moving && !still && measured < 0.15 * expected.amplitude;
        let inverted = moving && !unanswered && lead > 0.4 && lead < PI - 0.4;
        let excessive = running && measured > 1.15 * expected.ceiling;
        let faults = [
            (self.still.lasts(still, 3), Fault::SensorLost),
            (self.saturated.lasts(saturated, 5), Fault::SensorSaturated),
            (self.inverted.lasts(inverted, 5), Fault::SensorInverted),
            (self.unanswered.lasts(unanswered, 15), Fault::NoResponse),
            (self.excessive.lasts(excessive, 2), Fault::OverAmplitude),
        ];
        let fault = faults.iter().find(|(lasts, _)| *lasts);
        (
            fault.map(|&(_, fault)| fault),
            still || saturated || unanswered,
        )
    }
}
