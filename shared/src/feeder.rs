//! SI quantities of a feeder and its dimensionless parameters (docs/theory-model.md#t1.2).

use core::f64::consts::{PI, TAU};
use core::fmt;
use core::ops::RangeBounds;

use crate::arithmetic::sine_cosine;

/// Standard gravity, m/s^2 (ISO 80000-3).
pub const STANDARD_GRAVITY: f64 = 9.806_65;

/// Error: a value outside the range of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutOfRange {
    /// Name of the parameter.
    pub parameter: &'static str,
    /// The rejected value.
    pub value: f64,
    /// Accepted range, in words, with the unit.
    pub accepted: &'static str,
}

impl fmt::Display for OutOfRange {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "{} = {:e} is outside {}",
            self.parameter, self.value, self.accepted
        )
    }
}

impl core::error::Error for OutOfRange {}

/// `value` if `accepts` is true and it is no NaN, else an error that names the parameter.
pub fn accept(
    parameter: &'static str,
    value: f64,
    accepts: bool,
    accepted: &'static str,
) -> Result<f64, OutOfRange> {
    if accepts && !value.is_nan() {
        Ok(value)
    } else {
        Err(OutOfRange {
            parameter,
            value,
            accepted,
        })
    }
}

/// `value` if it is in `range`, else an error that names the parameter.
pub(crate) fn accept_in(
    parameter: &'static str,
    value: f64,
    range: impl RangeBounds<f64>,
    accepted: &'static str,
) -> Result<f64, OutOfRange> {
    accept(parameter, value, range.contains(&value), accepted)
}

/// Restitution normal to the track (symbol R) of the parts of a lot: an interval within 0..=1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Restitution {
    low: f64,
    high: f64,
}

impl Restitution {
    /// The interval `low..=high`; an error unless `0 <= low <= high <= 1`.
    pub fn interval(low: f64, high: f64) -> Result<Self, OutOfRange> {
        accept_in("restitution", low, 0.0..=1.0, "0..1")?;
        accept_in("restitution", high, 0.0..=1.0, "0..1")?;
        let accepted = "low bound..1: the interval is reversed";
        accept("restitution (high bound)", high, low <= high, accepted)?;
        Ok(Self { low, high })
    }

    /// One value; an error outside 0..=1.
    pub fn single(value: f64) -> Result<Self, OutOfRange> {
        Self::interval(value, value)
    }

    /// The low bound.
    pub fn low(self) -> f64 {
        self.low
    }

    /// The high bound.
    pub fn high(self) -> f64 {
        self.high
    }

    /// The middle of the interval.
    pub fn middle(self) -> f64 {
        0.5 * (self.low + self.high)
    }
}

/// Geometry of a track, in SI units except for the incline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackSettings {
    /// Drive frequency in Hz, 1..=1000.
    pub frequency: f64,
    /// Incline of the track (symbol alpha) in degrees, -60..=60, positive where parts climb.
    pub incline: f64,
    /// Amplitude parallel to the track over the amplitude normal to it (symbol eta), 0..=100.
    pub amplitude_ratio: f64,
    /// Phase lead of the parallel motion (symbol gamma) in degrees, -180..=180.
    pub phase_lead: f64,
    /// Gravity in m/s^2, 0.1..=30.
    pub gravity: f64,
}

/// A track in SI units, for conversions to and from the dimensionless map.
///
/// ```
/// use kband::feeder::{STANDARD_GRAVITY, Track, TrackSettings, throw_number};
/// let track = Track::build(TrackSettings {
///     frequency: 50.0,
///     incline: 3.0,
///     amplitude_ratio: 1.5,
///     phase_lead: 0.0,
///     gravity: STANDARD_GRAVITY,
/// })?;
/// let b = track.amplitude(0.43);
/// assert!((b - 0.2307e-3).abs() < 1e-7);
/// assert!((track.k(b) - 0.43).abs() < 1e-12);
/// assert!((throw_number(0.43) - 2.3256).abs() < 1e-4);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    angular_frequency: f64,
    incline: f64,
    amplitude_ratio: f64,
    phase_lead: f64,
    gravity: f64,
}

impl Track {
    /// Builds the track; an error names the first parameter out of range.
    pub fn build(settings: TrackSettings) -> Result<Self, OutOfRange> {
        let TrackSettings {
            frequency,
            incline,
            amplitude_ratio,
            phase_lead,
            gravity,
        } = settings;
        for (parameter, value, range, accepted) in [
            ("frequency", frequency, 1.0..=1000.0, "1..1000 Hz"),
            ("incline", incline, -60.0..=60.0, "-60..60 degrees"),
            ("amplitude_ratio", amplitude_ratio, 0.0..=100.0, "0..100"),
            (
                "phase_lead",
                phase_lead,
                -180.0..=180.0,
                "-180..180 degrees",
            ),
            ("gravity", gravity, 0.1..=30.0, "0.1..30 m/s^2"),
        ] {
            accept_in(parameter, value, range, accepted)?;
        }
        Ok(Self {
            angular_frequency: TAU * frequency,
            incline: incline * (PI / 180.0),
            amplitude_ratio,
            phase_lead: phase_lead * (PI / 180.0),
            gravity,
        })
    }

    /// Drive frequency in Hz.
    pub fn frequency(&self) -> f64 {
        self.angular_frequency / TAU
    }

    /// Incline (symbol alpha) in rad.
    pub fn incline(&self) -> f64 {
        self.incline
    }

    /// Tangent of the incline.
    pub fn incline_tangent(&self) -> f64 {
        let (sine, cosine) = sine_cosine(self.incline);
        sine / cosine
    }

    /// Parallel amplitude over normal amplitude (symbol eta).
    pub fn amplitude_ratio(&self) -> f64 {
        self.amplitude_ratio
    }

    /// Phase lead of the parallel motion (symbol gamma) in rad.
    pub fn phase_lead(&self) -> f64 {
        self.phase_lead
    }

    /// Gravity normal to the track (symbol g cos alpha) in m/s^2.
    pub fn normal_gravity(&self) -> f64 {
        self.gravity * sine_cosine(self.incline).1
    }

    /// `k = g cos(alpha) / (b w^2)` for a normal amplitude b in m; infinite at b = 0.
    pub fn k(&self, amplitude: f64) -> f64 {
        self.normal_gravity() / (amplitude * self.angular_frequency * self.angular_frequency)
    }

    /// Normal amplitude b in m for a value of k; infinite at k = 0. The inverse of [`Track::k`].
    pub fn amplitude(&self, k: f64) -> f64 {
        self.normal_gravity() / (k * self.angular_frequency * self.angular_frequency)
    }

    /// Peak normal acceleration of the track over gravity for a normal amplitude b in m.
    pub fn acceleration(&self, amplitude: f64) -> f64 {
        amplitude * self.angular_frequency * self.angular_frequency / self.gravity
    }

    /// Velocity unit `b w` in m/s for a normal amplitude b in m.
    pub fn velocity_unit(&self, amplitude: f64) -> f64 {
        amplitude * self.angular_frequency
    }
}

/// Throw number (symbol Gamma) as quoted by feeder makers: `1/k`.
pub fn throw_number(k: f64) -> f64 {
    1.0 / k
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAPER: TrackSettings = TrackSettings {
        frequency: 50.0,
        incline: 3.0,
        amplitude_ratio: 1.5,
        phase_lead: 0.0,
        gravity: STANDARD_GRAVITY,
    };

    #[test]
    fn k_and_amplitude_are_inverse() {
        let track = Track::build(PAPER).unwrap();
        for k in [0.01, 0.393, 0.7, 3.0] {
            // Rounding of two divisions and two products, each within half an ulp.
            assert!((track.k(track.amplitude(k)) / k - 1.0).abs() < 4.0 * f64::EPSILON);
            // The peak over gravity is the throw number without the incline.
            let peak = track.acceleration(track.amplitude(k)) / libm::cos(track.incline);
            assert!((peak / throw_number(k) - 1.0).abs() < 8.0 * f64::EPSILON);
        }
    }

    #[test]
    fn refusal_names_the_parameter() {
        let refused = |settings| Track::build(settings).unwrap_err().parameter;
        let incline = 90.0;
        assert_eq!(refused(TrackSettings { incline, ..PAPER }), "incline");
        let frequency = f64::NAN;
        assert_eq!(refused(TrackSettings { frequency, ..PAPER }), "frequency");
        let reversed = Restitution::interval(0.3, 0.2).unwrap_err();
        assert_eq!(reversed.parameter, "restitution (high bound)");
        let refused = Restitution::interval(0.18, 1.2).unwrap_err();
        assert_eq!(refused.parameter, "restitution");
    }
}
