//! Fixed point: velocities of the kernels without f64.

use crate::feeder::{OutOfRange, accept};

/// Velocity relative to the track (symbol psi) in units of `b w`: 0..64 in steps of 2^-26 (1.5e-8).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Velocity(u32);

impl Velocity {
    /// Velocity 0: at rest where the track does not throw.
    pub const ZERO: Self = Self(0);

    /// The velocity with these bits, in units of 2^-26.
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// The bits, in units of 2^-26.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// The nearest velocity to `value` in units of `b w`, refused outside 0..`limit`, of which
    /// `accepted` tells.
    pub(crate) fn build(
        value: f64,
        limit: f64,
        accepted: &'static str,
    ) -> Result<Self, OutOfRange> {
        accept("velocity", value, (0.0..=limit).contains(&value), accepted)?;
        Ok(Self(libm::round(value * 67_108_864.0) as u32))
    }

    /// The velocity in units of `b w`, exact.
    #[must_use]
    pub fn value(self) -> f64 {
        f64::from(self.0) * (1.0 / 67_108_864.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_velocity_is_the_nearest_step() {
        for value in [0.0, 1e-9, 0.3, 1.0, 28.999, 59.999_999_99] {
            let velocity = Velocity::build(value, 60.0, "0..60").unwrap();
            assert!((velocity.value() - value).abs() <= 0.5 / 67_108_864.0);
        }
        for value in [-1e-9, 60.1, f64::NAN, f64::INFINITY] {
            assert_eq!(
                Velocity::build(value, 60.0, "0..60").unwrap_err().parameter,
                "velocity"
            );
        }
    }
}
