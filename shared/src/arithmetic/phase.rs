//! Phase of the drive as a binary angle.

use core::f64::consts::TAU;
use core::ops::{Add, AddAssign, Sub};

/// Phase of the drive (symbol t), a binary angle: `u32` in units of 2^-32 turns; 2^31 is pi.
///
/// One step is 2 pi / 2^32 = 1.46e-9 rad. Sums and differences wrap exactly, so an accumulated
/// phase never drifts.
///
/// ```
/// use kband::arithmetic::Phase;
/// let quarter = Phase::from_bits(1 << 30);
/// assert_eq!(quarter.radians(), core::f64::consts::FRAC_PI_2);
/// assert_eq!(quarter + quarter + quarter + quarter, Phase::ZERO);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Phase(u32);

impl Phase {
    /// Phase 0, where `sin t = 0` with positive slope.
    pub const ZERO: Self = Self(0);

    /// Steps in a turn: 2^32.
    pub const TURN: f64 = 4_294_967_296.0;
    /// [`Phase::TURN`] as an integer.
    pub(crate) const STEPS: i64 = 1 << 32;
    pub(crate) const RADIANS_PER_STEP: f64 = TAU / Self::TURN;
    pub(crate) const STEPS_PER_RADIAN: f64 = Self::TURN / TAU;

    /// Phase from its bits, in units of 2^-32 turns.
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// The bits, in units of 2^-32 turns.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Nearest phase to a finite angle in rad, modulo 2 pi; within half a step in -2 pi..2 pi.
    pub fn from_radians(angle: f64) -> Self {
        let turns = angle / TAU;
        let fraction = turns - libm::floor(turns);
        // A fraction that rounds up to one turn gives 2^32, which wraps to phase 0.
        Self(libm::round(fraction * Self::TURN) as u64 as u32)
    }

    /// The angle in rad, in 0..2 pi; error at most 4.5e-16 rad.
    pub fn radians(self) -> f64 {
        f64::from(self.0) * Self::RADIANS_PER_STEP
    }
}

impl Add for Phase {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.wrapping_add(other.0))
    }
}

impl AddAssign for Phase {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Phase {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0.wrapping_sub(other.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angle_just_below_a_turn_wraps_to_zero() {
        assert_eq!(Phase::from_radians(TAU - 1e-12), Phase::ZERO);
        assert_eq!(Phase::from_radians(-1e-12), Phase::ZERO);
    }
}
