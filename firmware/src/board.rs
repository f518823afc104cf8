//! What the application asks of a board.

use kband::control::{AdcCode, Inputs, Report, Target};

use crate::enable::Contact;

/// The power stage of the drive.
pub trait Drive {
    /// Sets the output as a share of full output, -1..1, and switches the power stage on.
    ///
    /// This is the last actuator stage: a value beyond the range is held at its end.
    fn set(&mut self, output: f32);

    /// Switches the power stage off; it stays off until the next [`Drive::set`].
    fn off(&mut self);
}

/// What is read at each sample: the accelerometer and the enable input.
pub trait Sense {
    /// The newest reading of the converter.
    fn sample(&mut self) -> AdcCode;

    /// The enable input since the last sample; `None` where only the [`Panel`] reads it, once a drive cycle.
    fn enable(&mut self) -> Option<Contact> {
        None
    }
}

/// The inputs that are looked at once a drive cycle.
pub trait Panel {
    /// What they say now.
    fn inputs(&mut self) -> Inputs;

    /// Cycles of the core since some time, wrapping; 0 where none are counted.
    fn now(&self) -> u32 {
        0
    }

    /// A target that was asked for since the last cycle.
    fn new_target(&mut self) -> Option<Target> {
        None
    }
}

/// Whoever wants to know what the controller does.
pub trait Monitor {
    /// One drive cycle, and whether its target is met.
    fn report(&mut self, report: &Report, ready: bool);
}

/// The independent watchdog.
pub trait Watchdog {
    /// Defers the reset by another period.
    fn feed(&mut self);
}
