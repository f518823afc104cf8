//! Accelerometer constants of the envelope plant.

/// Constants that follow from the accelerometer's noise and sensitivity.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sense {
    /// Sensitivity over the configured one.
    pub factor: f64,
    /// RMS of its noise in m/s^2.
    pub noise: f64,
    /// RMS of white noise in the reading in m/s^2, the converter's rounding included.
    pub white: f64,
    /// RMS of this noise after the onset detector's filters, in the board's unit.
    pub residual: f64,
    /// Acceleration in m/s^2 that its axis measures of gravity at rest.
    pub rest: f64,
    /// Distance from the reading at rest to the nearer end of the converter's range, in m/s^2.
    pub headroom: f64,
    /// Converter step in m/s^2.
    pub floor: f64,
    /// Converter reading at rest, and its largest reading.
    pub zero: f64,
    pub full: f64,
}
