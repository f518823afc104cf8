//! What every kernel for microcontrollers is set up from, in f64.

use crate::arithmetic::Phase;
use crate::feeder::{OutOfRange, accept};

/// Set-up constants of a track in f64: the one routine all kernels take theirs from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SetUp {
    /// k.
    pub k: f64,
    /// Phase where a hump begins, `arcsin k`; a quarter turn where k >= 1.
    pub lift_off: Phase,
    /// Length of a hump, `pi - 2 arcsin k`, in steps of a phase; 0 where k >= 1.
    pub hump: u32,
    /// Slope of the sine at `lift_off`, `sqrt(1 - k^2)`.
    pub lift_off_cosine: f64,
}

impl SetUp {
    /// The constants for `k`, with the refusal of a k or a restitution that no kernel for
    /// microcontrollers takes.
    pub fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        accept("k", k, (0.005..=4.0).contains(&k), "0.005..4")?;
        accept(
            "restitution",
            restitution,
            (0.0..=1.0).contains(&restitution),
            "0..1",
        )?;
        Ok(Self::new(k))
    }

    /// The least square of the speed at height 0 of a tall flight, with what rounding may take: from
    /// there on the speed at every height h is above `sqrt(1 - h^2)`, the track's.
    pub fn tall(&self) -> f64 {
        let k = self.k;
        0.01 + if k < 1.0 { 1.0 + k * k } else { 2.0 * k }
    }

    fn new(k: f64) -> Self {
        if k >= 1.0 {
            return Self {
                k,
                lift_off: Phase::from_bits(1 << 30),
                hump: 0,
                lift_off_cosine: 0.0,
            };
        }
        let lift_off = Phase::from_radians(libm::asin(k));
        Self {
            k,
            lift_off,
            hump: (1_u32 << 31) - 2 * lift_off.bits(),
            lift_off_cosine: libm::sqrt((1.0 - k) * (1.0 + k)),
        }
    }
}
