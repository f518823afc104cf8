//! What goes into a controller: why it starts, and what the board tells it each cycle.

/// Why the controller starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StartCause {
    /// A user asked for it: a given enable input counts.
    #[default]
    Ordinary,
    /// Power came: off until the enable input, which may stand, was seen withdrawn.
    PowerOn,
    /// The watchdog or a brown-out reset the board: off until enabled anew.
    Reset,
    /// The board was reset three times in a row: off until that is acknowledged.
    Repeated,
    /// The program in the flash is not the one that was written: off for good.
    ImageDamaged,
    /// The stored settings were refused: off, with the defaults in their place.
    Refused,
}

/// What the board tells the controller each cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// The enable input.
    pub enable: bool,
    /// Whether the sample interrupt holds the drive off, by the enable input: it stops without a ramp, or does not start.
    pub held_off: bool,
    /// Whether the enable input began to chatter since the last cycle.
    pub chatters: bool,
    /// Whether the link withholds the drive: it stops, or does not start, although the input is on.
    pub withheld: bool,
    /// The over-temperature input.
    pub over_temperature: bool,
    /// Whether the link brought a valid frame since the last cycle.
    pub link_heard: bool,
    /// Whether the stack came close to its end.
    pub stack_low: bool,
    /// Whether the over-current input opened the bridge.
    pub over_current: bool,
    /// Whether the drive was switched off because the control of several cycles came too late.
    pub control_late: bool,
    /// Whether the supply is below what the chip needs.
    pub supply_low: bool,
    /// Whether the clock is not the crystal's.
    pub clock_failed: bool,
}
