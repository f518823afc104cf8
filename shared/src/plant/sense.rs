//! The accelerometer as the envelope has it.

/// What the accelerometer's noise and sensitivity give, computed where they change.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sense {
    /// Its sensitivity over the one that the controller was told.
    pub factor: f64,
    /// RMS of its noise in m/s^2.
    pub noise: f64,
    /// RMS of white noise in the reading in m/s^2, the converter's rounding included.
    pub white: f64,
    /// RMS of what the onset detector keeps of that, as the board reads it.
    pub residual: f64,
    /// Acceleration in m/s^2 that its axis sees of gravity at rest.
    pub rest: f64,
    /// Acceleration in m/s^2 that the converter has room for on its nearer side.
    pub headroom: f64,
    /// Acceleration in m/s^2 of a step of the converter.
    pub floor: f64,
    /// The converter's reading at rest, and its highest.
    pub zero: f64,
    pub full: f64,
}
