//! Steps on nodes from the fall of the parabola or from the cubic near launch, in 15 bits.

use super::ballistic::Ballistic;
use super::constants::HALF;
use crate::arithmetic::fixed::{Reciprocal, high, square_root_scaled, wide};
use crate::arithmetic::node;

/// Where steps on nodes start: a node `late` (steps of 2^-17 rad) after the part was at height `base` (steps
/// of 2^-30), going down at `speed` (steps of 2^-13).
pub(super) struct Approach {
    node: i32,
    late: i32,
    speed: i32,
    base: i32,
}

impl Ballistic<'_> {
    /// The impact of a high flight, nearly; see the search of the kernels with an FPU.
    #[inline(always)]
    pub(super) fn fall(&self) -> Option<(i32, i32)> {
        let crossing = self.crossing(self.constants.high)?;
        self.approach(crossing)
    }

    /// Where the parabola crosses height 0 on its fall, if the square of the speed there is at least
    /// `high`, steps of 2^-27.
    #[inline(always)]
    pub(super) fn crossing(&self, high_square: i32) -> Option<Approach> {
        let constants = self.constants;
        let rise = self.velocity as i32 + (self.cosine >> 4);
        if rise <= 0 {
            return None;
        }
        // The velocity in 15 bits, steps of 2^-scale, its square in 32 with room for 2 k.
        let mut scale = 14;
        while rise >> (26 - scale) > 0x7fff {
            scale -= 1;
        }
        let v = (rise >> (26 - scale)) as u32;
        let shift = 28 - 2 * scale;
        // 2 k sin, steps of 2^-27, and so the square of the speed at the top of the track and at height 0.
        let lift = high(constants.k, self.sine) << 2;
        let needed = high_square.wrapping_sub(lift) as u32;
        if lift < high_square && (v * v) >> 1 < needed >> shift {
            return None;
        }
        let square = (v * v).wrapping_add(((lift >> shift) << 1) as u32);
        // Steps of 2^-26.
        let mut speed = square_root_scaled(square) >> (scale - 10);
        let mut turns = (wide(rise as u32 + speed, constants.inverse) >> 32) as u32;
        if turns > 3 << 18 {
            // So long a flight shows the error of the root: one step of Heron's.
            let square = wide(rise as u32, rise as u32) as i64 + (i64::from(lift) << 25);
            let rest = (square - wide(speed, speed) as i64) >> 22;
            let gain = Reciprocal::coarse(speed).times(rest as i32, 21);
            speed = speed.saturating_add_signed(gain);
            turns = (wide(rise as u32 + speed, constants.inverse) >> 32) as u32;
        }
        // Times in steps of 2^-18 turns; a node every 2^10.
        let time = (self.phase >> 14).wrapping_add(turns) as i32;
        let node = (time + (1 << 9)) >> 10;
        // How late the node is: steps of 2^-17 rad; 3217 / 2^10 is pi.
        let late = (((node << 10) - time) * 3217) >> 10;
        Some(Approach {
            node,
            late,
            speed: (speed >> 13) as i32,
            base: 0,
        })
    }

    /// Steps on nodes until they are short: a node and the distance from it in steps of 2^-34 rad.
    #[inline(never)]
    pub(super) fn approach(&self, from: Approach) -> Option<(i32, i32)> {
        let Approach {
            mut node,
            mut late,
            speed,
            base,
        } = from;
        let k = self.constants.k >> 16;
        for _ in 0..8 {
            let [sine, cosine] = node::FIXED[(node & 255) as usize];
            // Speed in steps of 2^-13, k of 2^-12, heights of 2^-16.
            let fall = (k.wrapping_mul(late) >> 16) + speed;
            // Below 8 in size.
            let fallen = ((speed + fall) >> 1).wrapping_mul(late >> 2) >> 12;
            let u0 = fallen + ((sine - base) >> 14);
            let u1 = fall + (cosine >> 17);
            if u1 < 1 << 8 {
                return None;
            }
            // Newton's step and the quadratic correction b2 u0 / u1^2, steps of 2^-16 and 2^-15.
            let reciprocal = Reciprocal::coarse(u1 as u32);
            let newton = reciprocal.times(u0, 13).clamp(-(1 << 16), 1 << 16);
            let ratio = reciprocal.times(newton, 13).clamp(-(1 << 17), 1 << 17);
            let twice = (((self.constants.k >> 15) - (sine >> 17)) * (ratio >> 2)) >> 12;
            let bend = (twice >> 1).clamp(-(1 << 14), 1 << 14);
            let step = -(newton + ((newton * bend) >> 15));
            // Nodes are 1608.5 steps apart; 2608 / 2^22 is the inverse.
            let jump = (step * 2608 + (1 << 21)) >> 22;
            node += jump;
            if step.unsigned_abs() < 2600 {
                return Some((node, (step - ((jump * 3217) >> 1)) << 18));
            }
            late += jump * 3217;
        }
        None
    }

    /// Where the first impact of a low flight may be, nearly; see the search of the kernels with an FPU.
    #[inline(always)]
    pub(super) fn candidate(&self) -> Option<(i32, i32)> {
        // Steps of 2^-15: half the pull, a sixth of the cosine, the velocity.
        let a1 = (self.constants.k - (self.sine >> 2)) >> 14;
        let a2 = ((self.cosine >> 15) * 10_923) >> 16;
        if a1.unsigned_abs() < 1 << 15 && self.velocity < 3 << 25 {
            let psi = (self.velocity >> 11) as i32;
            // Steps of 2^-29.
            let square = (a1 * a1) >> 1;
            let discriminant = square - ((a2 * psi) << 1);
            let falls = a1 > 0 && discriminant > -(square >> 4);
            if falls || (a1 <= 0 && a2 < 0) {
                // Steps of 2^-15.
                let root = (square_root_scaled((discriminant.max(0) >> 1) as u32) >> 15) as i32;
                let (over, under) = if falls {
                    (psi << 1, a1 + root)
                } else {
                    (root - a1, -(a2 << 1))
                };
                if under <= 0 {
                    return None;
                }
                // Steps of 2^-17 rad.
                let near = Reciprocal::coarse(under as u32).times(over, 17);
                if near < 1 << 14 {
                    return None;
                }
                if near < 4 << 17 {
                    // Steps of 2^-18 turns: 2^-17 rad in 20861 / 2^16 of them.
                    let turns = ((near >> 3) * 20_861) >> 13;
                    let time = (self.phase >> 14) as i32 + turns;
                    let node = (time + (1 << 9)) >> 10;
                    let late = near + ((((node << 10) - time) * 3217) >> 10);
                    return self.approach(Approach {
                        node,
                        late,
                        speed: -((self.velocity as i32 + (self.cosine >> 4)) >> 13),
                        base: self.sine,
                    });
                }
            }
        }
        // A tenth, steps of 2^-27.
        let crossing = self.crossing(13_421_773)?;
        // A root more than half a rad before the crossing is none of a fall.
        let limit = self.constants.limit(self.phase) + HALF;
        (self.steps_to(crossing.node) < limit)
            .then(|| self.approach(crossing))
            .flatten()
    }
}
