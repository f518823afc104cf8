//! Inputs of a controller: the cause of its start, and the board's inputs in each cycle.

use serde::{Deserialize, Serialize};

/// Cause of the controller's start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum StartCause {
    /// A user requested it: an enable input that is already on counts.
    #[default]
    Ordinary,
    /// The watchdog or a brown-out reset the board: off until enabled again.
    Reset,
    /// The stored settings were refused: off, with the default settings.
    Refused,
    /// Power was switched on: off until the enable input, which may be on, was off once.
    PowerOn,
    /// The board was reset three times in a row: off until acknowledged.
    Repeated,
    /// The program in the flash differs from the written one: off permanently.
    ImageDamaged,
}

/// Commands of the fieldbus that is in control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusCommand {
    /// The run bit as it was written last; `None` before the first.
    pub run: Option<bool>,
    /// Whether the acknowledge bit has risen since the last cycle.
    pub acknowledge: bool,
}

impl BusCommand {
    pub(crate) fn runs(self) -> bool {
        self.run == Some(true)
    }
}

/// Inputs of the board in a cycle. The link does not send the inputs that the firmware itself sets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Inputs {
    /// The enable input.
    pub enable: bool,
    /// Whether the sample interrupt holds the drive off: it stops without a ramp.
    #[serde(skip)]
    pub held_off: bool,
    /// Whether the enable input began to chatter since the last cycle.
    #[serde(skip)]
    pub chatters: bool,
    /// Whether the link withholds the drive, although the enable input is on.
    #[serde(skip)]
    pub withheld: bool,
    /// Commands of the fieldbus, if it is in control.
    #[serde(skip)]
    pub bus: Option<BusCommand>,
    /// The over-temperature input.
    pub over_temperature: bool,
    /// Whether the link, or the bus in control, received a valid frame since the last cycle.
    pub link_heard: bool,
    /// Whether the stack came close to its end.
    pub stack_low: bool,
    /// Whether the over-current input opened the bridge.
    pub over_current: bool,
    /// Whether the drive was switched off because the control of several cycles was too late.
    pub control_late: bool,
    /// Whether the supply is below what the chip needs.
    pub supply_low: bool,
    /// Whether the clock is not the crystal's.
    pub clock_failed: bool,
}
