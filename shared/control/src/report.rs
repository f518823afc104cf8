//! Result of a controller's cycle.

use crate::{Command, Events, Fault, GearMargin, Identification, Limits, Load, Shape, State};
use kband::regime::classify::Verdict;
use serde::{Deserialize, Serialize};

/// Measurements, estimates and decisions of one cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Cycles since the controller was built.
    pub cycle: u32,
    /// Measured k; infinite at rest.
    pub k: f32,
    /// Measured normal amplitude of the track (symbol b) in m.
    pub amplitude: f32,
    /// Measured phase lead of the track before the output, in rad, -pi..pi.
    pub lead: f32,
    /// Measured shape of the track's motion; a sine if the settings allow no upper tone.
    pub shape: Shape,
    /// Reference amplitude at the end of the cycle after next, in m.
    pub reference: f32,
    /// Amplitude of the target's setpoint, in m; 0 if there is none.
    pub setpoint: f32,
    /// Detected impacts per cycle, averaged over the last 16 cycles.
    pub rate: f32,
    /// Mean phase of the track (symbol t) at the detected impacts, in rad, -pi..pi.
    pub phase: f32,
    /// Concentration of these phases (length of their mean phasor), 0..1.
    pub concentration: f32,
    /// Detected regime of the parts, with its confidence.
    pub regime: Option<Verdict>,
    /// Drive frequency in Hz.
    pub frequency: f32,
    /// Confidence that the parts are in the requested lock, 0..1.
    pub confidence: f32,
    /// Estimated share of the parts' time in gear, 0..=1, over some 256 cycles.
    pub in_gear: f32,
    /// Standard error of that share; infinite if it is only a lower bound.
    pub in_gear_error: f32,
    /// Order (symbol r) of the requested lock or gear, to which these values refer; else 1.
    pub gear: u8,
    /// Mean drive cycles in gear until its loss: of one part, or predicted.
    pub to_loss: f32,
    /// Margin of the parts to losing gear; `None` without an estimate.
    pub margin: Option<GearMargin>,
    /// Predicted share of the lot's time in gear at the setpoint, 0..1; 0 for another target.
    pub expected_in_gear: f32,
    /// Lowest and highest k for a target of gear or chaos; `None` for another target.
    ///
    /// In the gear band the lot's predicted share is within
    /// [`kband::regime::gear::GEAR_BAND_LOSS`] of the setpoint's. In the chaotic band every part of
    /// the lot is chaotic.
    pub target_band: Option<[f32; 2]>,
    /// Load of the parts, estimated from their power; `None` out of gear or without a track mass.
    pub load: Option<Load>,
    /// Kicks begun for the present target.
    pub attempts: u8,
    /// Progress of the identification of the parts' restitution.
    pub identification: Identification,
    /// State of the controller.
    pub state: State,
    /// The fault that stopped the drive.
    pub fault: Option<Fault>,
    /// The limits that hold it back.
    pub limits: Limits,
    /// Events of this cycle.
    pub events: Events,
    /// The next command.
    pub command: Command,
}
