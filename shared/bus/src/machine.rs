//! Interface of the server to a drive.

use crate::protocol::Exception;
use kband_control::wire::{Record, Status, Telemetry};
use kband_control::{Settings, State, Target};

/// Rights of the bus: the setting `bus`, if the bus is in control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Authority {
    /// Read only: the bus is not in control.
    #[default]
    Read = 0,
    /// Run the drive, and set target and settings.
    Command = 1,
    /// Acknowledge faults too.
    Acknowledge = 2,
}

impl Authority {
    /// Rights that these settings give the bus of a board.
    pub fn of(settings: &Settings) -> Self {
        match settings.bus {
            _ if !settings.bus_controls() => Self::Read,
            bus if bus >= 2.0 => Self::Acknowledge,
            _ => Self::Command,
        }
    }
}

/// Progress of the last save that was requested over the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum SaveProgress {
    /// None was requested since the start.
    #[default]
    None = 0,
    /// It is not finished yet.
    Pending = 1,
    /// Settings and target are saved.
    Done = 2,
    /// It failed: the supply was low, the memory failed, or there were too many saves.
    Failed = 3,
}

/// State of a drive at the time of a request.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    /// The last drive cycle.
    pub telemetry: Telemetry,
    /// Inputs and outputs.
    pub status: Status,
    /// Rights of the bus.
    pub authority: Authority,
    /// The configured target.
    pub target: Target,
    /// Progress of the last save.
    pub save: SaveProgress,
    /// Number of events since the start; the newest event has this number minus one.
    pub events: u32,
    /// Drive cycles since the start with a missed control deadline.
    pub missed: u32,
    /// Whether settings may be changed: neither a strap nor a PIN protects them.
    pub writable: bool,
    /// Name, version and build of the image.
    pub image: &'a str,
}

impl Default for Snapshot<'_> {
    fn default() -> Self {
        Self {
            telemetry: Telemetry::default(),
            status: Status::default(),
            authority: Authority::Read,
            target: Target::Amplitude(0.0),
            save: SaveProgress::None,
            events: 0,
            missed: 0,
            writable: true,
            image: "",
        }
    }
}

impl Snapshot<'_> {
    /// Whether the drive is off or in fault, so that settings may be changed and saved.
    pub fn at_rest(&self) -> bool {
        let state = self.telemetry.state;
        state == State::Off.number() || state == State::Fault.number()
    }

    pub(crate) fn status_word(&self) -> u16 {
        let (telemetry, status) = (&self.telemetry, &self.status);
        let is_off = telemetry.state == State::Off.number();
        let fault = telemetry.fault != 0;
        let ready = is_off && !fault && status.inputs.enable && status.permitted;
        let bits = [
            (0, ready),
            (1, !self.at_rest()),
            (2, status.inputs.enable),
            (3, fault),
            (7, telemetry.limits != 0),
            (8, status.ready),
            (9, self.authority > Authority::Read),
        ];
        (bits.into_iter()).fold(0, |word, (bit, set)| word | u16::from(set) << bit)
    }
}

/// A drive on the bus.
///
/// Before it sets anything, the server has checked authority and addresses. Before it sets settings
/// or saves, it has also checked that the drive is at rest. An error is the exception that the bus
/// answers: `Value`, `NotInControl` or `Busy`.
pub trait Machine {
    /// The present state of the drive.
    fn snapshot(&self) -> Snapshot<'_>;

    /// The settings in use.
    fn settings(&self) -> Settings;

    /// The event of this number; `None` if it is overwritten or has not happened yet.
    fn event(&self, number: u32) -> Option<Record>;

    /// Sets another target.
    ///
    /// # Errors
    /// The drive refuses the target and keeps the previous one.
    fn set_target(&mut self, target: Target) -> Result<(), Exception>;

    /// Sets other settings.
    ///
    /// # Errors
    /// The drive refuses the settings and keeps the previous ones.
    fn set_settings(&mut self, settings: &Settings) -> Result<(), Exception>;

    /// Requests that settings and target are saved; [`Snapshot::save`] shows the progress.
    ///
    /// # Errors
    /// The previous save is not finished.
    fn save(&mut self) -> Result<(), Exception>;

    /// Selects a recipe.
    ///
    /// # Errors
    /// The recipe does not exist. Without recipes only 0 is accepted.
    fn select_recipe(&mut self, recipe: u16) -> Result<(), Exception> {
        match recipe {
            0 => Ok(()),
            _ => Err(Exception::Value),
        }
    }
}
