//! What the application asks of a board.

/// The power stage of the drive.
pub trait Drive {
    /// Sets the output to `duty` of the rail, -1..=1 (symbol u).
    ///
    /// This is the last actuator stage: a value beyond the range is held at its end.
    fn set(&mut self, duty: f32);

    /// Switches the power stage off; it stays off until the next [`Drive::set`].
    fn off(&mut self);
}

/// The accelerometer and the enable input, read once a sample.
pub trait Sense {
    /// The newest sample of the accelerometer in converter steps.
    fn sample(&mut self) -> u16;

    /// Whether the enable input is active.
    fn enabled(&mut self) -> bool;
}

/// The independent watchdog.
pub trait Watchdog {
    /// Defers the reset by another period.
    fn feed(&mut self);
}
