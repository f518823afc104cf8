//! Heights and slopes of a flight at exact times.

use super::constants::{Constants, TURN};
use crate::arithmetic::fixed::{high, wide};
use crate::arithmetic::node;

/// Height and slope of the flight above the track at a node, with sine and cosine there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    /// Steps of 2^-30, saturating.
    pub(super) height: i32,
    /// Steps of 2^-26.
    pub(super) slope: i32,
    pub(super) sine: i32,
    pub(super) cosine: i32,
    /// `sin - k`, steps of 2^-28: the curvature.
    pub(super) curvature: i32,
}

/// A flight.
pub(super) struct Ballistic<'a> {
    pub(super) constants: &'a Constants,
    pub(super) phase: u32,
    pub(super) sine: i32,
    pub(super) cosine: i32,
    pub(super) velocity: u32,
    /// Launch velocity in the frame of the feeder, psi + cos t, steps of 2^-48.
    pub(super) rise: i64,
}

impl Ballistic<'_> {
    /// `mean` flight velocity, `v - k d / 2`, after `steps`, and what it fell short of the launch
    /// velocity; steps of 2^-48.
    #[inline(always)]
    pub(super) fn mean(&self, steps: i64) -> (i64, i64) {
        let fall = product_32(steps, self.constants.half_turn_fall as i64);
        (self.rise - fall, fall)
    }

    /// Ballistic rise in turns (steps of 2^-32 of rad / 2 pi, saturating) and velocity (steps of 2^-26)
    /// after `steps`.
    #[inline(never)]
    pub(super) fn ballistic(&self, steps: i64) -> (i32, i64) {
        let (mean, fall) = self.mean(steps);
        let rise = product_32(steps, mean) >> 16;
        let turns = if rise > i64::from(i32::MAX) {
            i32::MAX
        } else if rise < i64::from(i32::MIN) {
            i32::MIN
        } else {
            rise as i32
        };
        (turns, mean - fall)
    }

    /// Height over `level` (steps of 2^-30) after `steps`, steps of 2^-30, saturating; and velocity.
    #[inline(always)]
    pub(super) fn over(&self, steps: i64, level: i32) -> (i32, i32) {
        let (turns, velocity) = self.ballistic(steps);
        // Steps of 2^-28 do not overflow; those of 2^-30 do beyond a height of 2.
        let coarse = high(turns, TURN) + (self.sine >> 2) - (level >> 2);
        let height = if coarse >= 1 << 29 {
            i32::MAX
        } else if coarse < -(1 << 29) {
            -i32::MAX
        } else {
            let rise = (high(turns, TURN) << 2) | (turns.wrapping_mul(TURN) as u32 >> 30) as i32;
            rise.wrapping_add(self.sine).wrapping_sub(level)
        };
        (height, (velocity >> 22) as i32)
    }

    #[inline(always)]
    pub(super) fn steps_to(&self, node: i32) -> i64 {
        (i64::from(node) << 24) - i64::from(self.phase)
    }

    #[inline(never)]
    pub(super) fn local(&self, node: i32) -> Local {
        let [sine, cosine] = node::FIXED[(node & 255) as usize];
        let (height, velocity) = self.over(self.steps_to(node), sine);
        Local {
            height,
            slope: velocity - (cosine >> 4),
            sine,
            cosine,
            curvature: (sine >> 2) - self.constants.k,
        }
    }
}

/// `a b / 2^32`, modulo 2^64, for an `a` below 2^48.
#[inline(always)]
fn product_32(a: i64, b: i64) -> i64 {
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
    sum
}
