//! Interfaces of the application to a board.

use crate::inputs::enable::Contact;
use kband_control::{AdcCode, Inputs, Target};

/// The power stage of the drive.
pub trait Drive {
    /// Sets the output as a share of full output, -1..1, and switches the power stage on.
    ///
    /// This is the last actuator stage: it clamps values beyond the range.
    fn set(&mut self, output: f32);

    /// Switches the power stage off; it stays off until the next [`Drive::set`].
    fn off(&mut self);
}

/// Inputs that are read at each sample: the accelerometer, the drive's current and the
/// enable input.
pub trait Sense {
    /// The newest reading of the converter.
    fn sample(&mut self) -> AdcCode;

    /// The reading of the current sensor in the same sample; read if one is configured.
    fn current(&mut self) -> AdcCode;

    /// The enable input since the last sample; `None` if only the [`Panel`] reads it, once a
    /// drive cycle.
    fn enable(&mut self) -> Option<Contact> {
        None
    }
}

/// Inputs that are read once a drive cycle.
pub trait Panel {
    /// State of the inputs now.
    fn inputs(&mut self) -> Inputs;

    /// Core cycle counter, wrapping; 0 without one.
    fn now(&self) -> u32 {
        0
    }

    /// A target that was requested since the last cycle.
    fn new_target(&mut self) -> Option<Target> {
        None
    }

    /// Number of the recipe at the inputs, debounced; 0: none. `None` without such inputs.
    fn recipe(&mut self) -> Option<u8> {
        None
    }
}
