//! What comes out of a controller each cycle.

use crate::control::drive::Shape;
use crate::control::hear::{Command, GearMargin, Load};
use crate::control::identify::Identification;
use crate::control::state::{Events, Fault, Limits, State};
use crate::regime::classify::Verdict;

/// What the controller saw and did in one cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Report {
    /// Cycles since the controller was built.
    pub cycle: u32,
    /// Measured k; infinite at rest.
    pub k: f32,
    /// Measured normal amplitude of the track (symbol b) in m.
    pub amplitude: f32,
    /// Measured phase lead of the track before the output, in rad, -pi..pi.
    pub lead: f32,
    /// Shape of the track's motion as it was measured: amplitudes of its tones over the first one's and phases against the
    /// track's, -pi..pi; a sine where the drive affords no more.
    pub shape: Shape,
    /// Amplitude that the loop follows at the end of the next cycle but one, in m.
    pub reference: f32,
    /// Amplitude chosen for the target, in m; 0 where there is none.
    pub setpoint: f32,
    /// Impacts heard per cycle, over the last 16.
    pub rate: f32,
    /// Mean phase of the track (symbol t) at the impacts heard, in rad, -pi..pi.
    pub phase: f32,
    /// Concentration of these phases, 0..1.
    pub concentration: f32,
    /// What the parts are heard to do, and how sure that is.
    pub regime: Option<Verdict>,
    /// Drive frequency in Hz.
    pub frequency: f32,
    /// Confidence that the parts are in the wanted lock, 0..1.
    pub confidence: f32,
    /// Share of the parts' time in gear as heard, 0..=1, over some 256 cycles, however many parts strike the track.
    pub in_gear: f32,
    /// Standard error of that share; infinite where it is only a least: before enough was heard, or where what is heard is
    /// of no parts of the lot.
    pub in_gear_error: f32,
    /// Order (symbol r) of that gear: of the lock or gear that is wanted, else 1.
    pub gear: u8,
    /// Mean drive cycles in gear until it is lost: as heard of one part since the setpoint was reached, else as the map has it
    /// of the lot; infinite where neither is known.
    pub to_loss: f32,
    /// How far the parts are from losing gear; `None` where that is not heard.
    pub margin: Option<GearMargin>,
    /// Share of time in gear to expect of the lot at the setpoint, 0..1; 0 for a target other than gear.
    pub expected_in_gear: f32,
    /// The parts on the track as weighed by the power that they take; `None` where they are not in gear, or the mass of the track
    /// is not told.
    pub load: Option<Load>,
    /// Kicks begun for the present target.
    pub attempts: u8,
    /// How far the identification of the parts' restitution has come.
    pub identification: Identification,
    /// What the controller is doing.
    pub state: State,
    /// What stopped it.
    pub fault: Option<Fault>,
    /// What holds it back.
    pub limits: Limits,
    /// What happened in this cycle.
    pub events: Events,
    /// What the drive is to do.
    pub command: Command,
}
