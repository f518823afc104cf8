//! Heights and slopes of a flight at exact times.

use super::constants::{Constants, RADIANS_PER_TURN};
use crate::arithmetic::fixed::{Fixed, wide};
use crate::arithmetic::node;
use crate::arithmetic::trigonometry::Powers;

/// Height and slope of the flight above the track at a node, and the motion of the track there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    /// Saturating.
    pub height: Fixed<30>,
    pub slope: Fixed<26>,
    /// `sin - k`.
    pub curvature: Fixed<28>,
    /// Sine and cosine of the node.
    pub sine: Fixed<30>,
    pub cosine: Fixed<30>,
}

/// The track at a node, to 15 bits.
pub(super) struct Motion {
    /// Sine minus a height.
    pub below: Fixed<16>,
    /// Its slope.
    pub speed: Fixed<13>,
    /// `k - sin`, within -8..8.
    pub curvature: Fixed<13>,
}

/// A flight.
pub(super) struct Ballistic<'a> {
    pub(super) constants: &'a Constants,
    pub(super) phase: u32,
    pub(super) sine: Fixed<30>,
    pub(super) cosine: Fixed<30>,
    pub(super) velocity: Fixed<26, u32>,
    /// Launch velocity in the frame of the feeder, psi + cos t.
    pub(super) rise: Fixed<48, i64>,
}

impl Ballistic<'_> {
    /// Mean velocity `v - k d / 2` after `steps`, and its loss relative to the launch velocity.
    #[inline(always)]
    pub(super) fn mean(&self, steps: i64) -> (Fixed<48, i64>, Fixed<48, i64>) {
        let fall = product_32(steps, self.constants.half_turn_fall);
        (self.rise - fall, fall)
    }

    /// Ballistic rise over 2 pi, saturating, and velocity after `steps`.
    #[inline(never)]
    pub(super) fn ballistic(&self, steps: i64) -> (Fixed<32>, Fixed<48, i64>) {
        let (mean, fall) = self.mean(steps);
        let Fixed(rise) = product_32(steps, mean).to::<32>();
        let turns = if rise > i64::from(i32::MAX) {
            i32::MAX
        } else if rise < i64::from(i32::MIN) {
            i32::MIN
        } else {
            rise as i32
        };
        (Fixed(turns), mean - fall)
    }

    /// Height over `level` after `steps`, saturating; and velocity.
    #[inline(always)]
    pub(super) fn height_over(&self, steps: i64, level: Fixed<30>) -> (Fixed<30>, Fixed<26>) {
        let (turns, velocity) = self.ballistic(steps);
        // Steps of 2^-28 cannot overflow; those of 2^-30 do beyond a height of 2.
        let rise: Fixed<28> = turns.times(RADIANS_PER_TURN);
        let coarse = rise + self.sine.to::<28>() - level.to::<28>();
        let height = if coarse >= Fixed::<28>::from_constant(2.0) {
            Fixed(i32::MAX)
        } else if coarse < -Fixed::<28>::from_constant(2.0) {
            Fixed(-i32::MAX)
        } else {
            let low = turns.0.wrapping_mul(RADIANS_PER_TURN.0) as u32 >> 30;
            Fixed::<30>(rise.to::<30>().0 | low as i32)
                .wrapping_add(self.sine)
                .wrapping_sub(level)
        };
        (height, velocity.narrow())
    }

    #[inline(always)]
    pub(super) fn steps_to(&self, node: i32) -> i64 {
        (i64::from(node) << 24) - i64::from(self.phase)
    }

    /// The track at a node, its height over `base`.
    #[inline(always)]
    pub(super) fn motion(&self, node: i32, base: Fixed<30>) -> Motion {
        let [sine, cosine] = node::SINE_COSINE_FIXED[(node & 255) as usize];
        Motion {
            // From one end of the stroke to the other the value is 2, which saturates.
            below: sine.saturating_add(-base).to(),
            speed: cosine.to(),
            curvature: self.constants.k.to::<13>() - sine.to(),
        }
    }

    /// The flight at a node.
    #[inline(never)]
    pub(super) fn local(&self, node: i32) -> Local {
        let [sine, cosine] = node::SINE_COSINE_FIXED[(node & 255) as usize];
        let (height, velocity) = self.height_over(self.steps_to(node), sine);
        Local {
            height,
            slope: velocity - cosine.to(),
            curvature: sine.to() - self.constants.k,
            sine,
            cosine,
        }
    }

    /// Height and slope at a small distance `d` from a node, where both are small.
    #[inline(always)]
    pub(super) fn expand(&self, local: &Local, d: Fixed<34>) -> (Fixed<30>, Fixed<26>) {
        let powers = Powers::new(d);
        let Local { sine, cosine, .. } = *local;
        // u1 d + (S - k) d^2/2 - S d^4/24 + C (d - sin d).
        let bent: Fixed<30> =
            local.curvature.times(powers.versine) - self.constants.k.times(powers.flat);
        let height = local
            .height
            .saturating_add(local.slope.times(d.to::<36>()))
            .saturating_add(bent + cosine.times_short(powers.lag));
        // (S - k) d - S (d - sin d) + C (1 - cos d).
        let gain: Fixed<30> =
            local.curvature.times(d) + cosine.times(powers.versine) - sine.times_short(powers.lag);
        (height, local.slope + gain.to())
    }
}

impl Local {
    /// The curvature at `d` from the node.
    #[inline(always)]
    pub(super) fn curvature_at(&self, d: Fixed<34>) -> Fixed<28> {
        self.curvature + self.cosine.times(d)
    }

    /// Mean curvature over `d` from a place with this `curvature`.
    #[inline(always)]
    pub(super) fn mean_curvature(&self, curvature: Fixed<28>, d: Fixed<34>) -> Fixed<28> {
        let half: Fixed<27> = self.cosine.times(d);
        curvature + half.scaled()
    }
}

/// `turns b`, for `turns` below 2^48 steps of a phase, modulo 2^64 steps.
#[inline(always)]
pub(super) fn product_32<const F: u32>(turns: i64, Fixed(b): Fixed<F, i64>) -> Fixed<F, i64> {
    let a = turns;
    let (a_low, a_high) = (a as u32, (a >> 32) as i32);
    let (b_low, b_high) = (b as u32, (b >> 32) as u32);
    let mut sum = ((wide(a_low, b_low) >> 32) + wide(a_low, b_high)) as i64;
    if (b_high as i32) < 0 {
        sum = sum.wrapping_sub(i64::from(a_low) << 32);
    }
    if a_high != 0 {
        // Signed: -1 is 2^32 - 1 less 2^32.
        let mut upper = (a_high as u32).wrapping_mul(b_high);
        if a_high < 0 {
            upper = upper.wrapping_sub(b_low);
        }
        sum = sum
            .wrapping_add(wide(a_high as u32, b_low) as i64)
            .wrapping_add(i64::from(upper) << 32);
    }
    Fixed(sum)
}
