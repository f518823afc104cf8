//! Short hops, below 1/16 rad, in a form that keeps every digit.

use super::ballistic::Ballistic;
use super::constants::ONE;
use crate::arithmetic::fixed::{Reciprocal, high, wide, wide_signed};

/// The flight near launch: its height is `d (2 psi - d G) / 2` with
/// `G = pull - cos d / 3 + sin d^2 / 12`.
#[derive(Clone, Copy)]
struct Near {
    /// `k - sin` and sine of the phase of launch, cosine / 3: steps of 2^(down - 30).
    pull: i32,
    sine: i32,
    third: i32,
    cosine: i32,
    /// 2 psi, steps of 2^(down - 64), at most 1/4 (1 where `down` is 2), which no short hop reaches.
    twice: i64,
    down: u32,
}

impl Near {
    #[inline(always)]
    fn new(pull: i32, sine: i32, cosine: i32, velocity: u32, down: u32) -> Self {
        Self {
            pull,
            sine,
            // 1/3 in steps of 2^-32.
            third: high(cosine, 1_431_655_765),
            cosine,
            twice: i64::from(velocity.min(1 << (23 + down))) << (39 - down),
            down,
        }
    }

    /// `G` and the derivative of `d G` at `d`, below 1/16 in steps of 2^-34.
    #[inline(always)]
    fn mean_and_slope(&self, d: i32) -> (i32, i32) {
        let linear = high(self.third, d) >> 2;
        let quadratic = high(self.sine, high(d, d)) >> 4;
        (
            // 10923 / 2^17 is 1/12.
            self.pull - linear + (((quadratic >> 5) * 10_923) >> 12),
            self.pull - 2 * linear + (quadratic >> 2),
        )
    }

    /// Newton's step from `d` to where `d G` reaches 2 psi, for a slope above 0.
    #[inline(always)]
    fn newton(&self, d: i32, mean: i32, slope: i32) -> i32 {
        let reciprocal = Reciprocal::coarse(slope as u32);
        let rest = self.twice - wide_signed(d, mean);
        // So that the shortest hops from rest keep their digits.
        if rest == i64::from(rest as i32) {
            return reciprocal.times(rest as i32, 0);
        }
        // Steps of 2^-40; a saturated one still leads towards the root.
        let rest = (rest >> 24).clamp(-i64::from(i32::MAX), i64::from(i32::MAX)) as i32;
        reciprocal.times(rest, 24)
    }

    /// The hop where `d G` reaches 2 psi, by Newton's steps from near it, or from its left on a concave
    /// or its right on a convex `d G`.
    #[inline(always)]
    fn hop(&self, mut d: i32) -> Start {
        let mut round = 0;
        loop {
            let (mean, slope) = self.mean_and_slope(d);
            if slope <= 0 {
                return self.before_end();
            }
            let step = self.newton(d, mean, slope);
            d = d.saturating_add(step).max(0);
            if d >= ONE {
                return self.before_end();
            }
            round += 1;
            // Or the steps go around the root by the resolution of a small pull.
            if step.unsigned_abs() <= (d >> 12).unsigned_abs() || round == 24 {
                // u' = -d (d G)' / 2 at the root; half a step rounds.
                let slope = slope - 2 * (high(self.third, step) >> 2);
                let up = 7 - self.down;
                let arrival = (high(d, slope) + (1 << (up - 1))) >> up;
                // Rounding of the pull, some 2^-29, moves d G by what separates the root from the
                // greatest value of d G: slope^2 / (4 cos / 3).
                let grazes = self.down == 0
                    && slope.unsigned_abs() < 1 << 15
                    && slope * slope < high(self.cosine, d);
                return Start::Hop {
                    flight: d,
                    arrival,
                    grazes,
                };
            }
        }
    }

    /// The hop from the right end, 1/16 rad, if there is one before it.
    #[inline(never)]
    fn before_end(&self) -> Start {
        let mut d = ONE - 1;
        let (mean, _) = self.mean_and_slope(d);
        if self.twice >= wide_signed(d, mean) {
            // So near to the throw d G has its greatest value, at 3 pull / (2 cos), before the right end,
            // and 2 psi is above it.
            let clears = self.down == 0 && self.pull > 0 && self.pull < self.cosine >> 5;
            return if clears {
                Start::Clears {
                    grazes: self.skims(),
                }
            } else {
                Start::Open
            };
        }
        for _ in 0..60 {
            let (mean, slope) = self.mean_and_slope(d);
            if slope <= 0 {
                break;
            }
            let step = self.newton(d, mean, slope);
            d = (d + step).max(0);
            if step.unsigned_abs() <= (d >> 12).unsigned_abs() {
                break;
            }
        }
        let (_, slope) = self.mean_and_slope(d);
        let arrival = high(d, slope.max(0)) >> (7 - self.down);
        Start::Hop {
            flight: d,
            arrival,
            grazes: false,
        }
    }

    /// Whether 2 psi is above the greatest `d G` by rounding alone.
    #[inline(never)]
    fn skims(&self) -> bool {
        let reciprocal = Reciprocal::coarse(self.cosine as u32);
        let mut d = reciprocal.times(self.pull + self.pull / 2, 34).min(ONE - 1);
        for _ in 0..2 {
            let (_, slope) = self.mean_and_slope(d);
            // -(d G)'' = 2 cos / 3 - sin d / 2.
            let bend = (2 * self.third - (high(self.sine, d) >> 3)).max(1);
            let step = Reciprocal::coarse(bend as u32).times(slope, 34);
            d = d.saturating_add(step).clamp(0, ONE - 1);
        }
        let gap = self.twice - wide_signed(d, self.mean_and_slope(d).0);
        gap < i64::from(d) << 3
    }
}

/// What the flight near launch says.
pub(super) enum Start {
    /// A short hop: flight in steps of 2^-34 rad and arrival speed in steps of 2^-26; whether it
    /// clears the coming hump but for rounding.
    Hop {
        flight: i32,
        arrival: i32,
        grazes: bool,
    },
    /// The flight clears the coming hump; whether by rounding alone.
    Clears { grazes: bool },
    /// Nothing.
    Open,
}

impl Ballistic<'_> {
    /// The flight near launch: short hops, below 1/16 rad, in a form that keeps every digit.
    #[inline(always)]
    pub(super) fn start(&self, throws: bool) -> Start {
        let constants = self.constants;
        // Steps of 2^-28, or of 2^-30 where they have room.
        let wide_pull = constants.k - (self.sine >> 2);
        let near = if wide_pull < 1 << 28 {
            let pull = constants.threshold.wrapping_sub(self.sine);
            // At lift-off itself the pull must not be rounded against the phase, nor to 0.
            let pull = if throws { pull.min(-1) } else { pull.max(1) };
            Near::new(pull, self.sine, self.cosine, self.velocity, 0)
        } else {
            Near::new(
                wide_pull.max(1),
                self.sine >> 2,
                self.cosine >> 2,
                self.velocity,
                2,
            )
        };
        if throws {
            return near.before_end();
        }
        let reciprocal = Reciprocal::fine(near.pull as u32);
        // 2 psi / pull, steps of 2^-34.
        let ratio = wide(self.velocity, reciprocal.mantissa);
        let shift = (23 + near.down).checked_sub(reciprocal.shift);
        let Some(first) = shift
            .map(|shift| ratio >> shift)
            .filter(|&z| z < ONE as u64)
        else {
            return near.before_end();
        };
        let first = first as i32;
        // d = z (1 + e + 2 e^2) with z = 2 psi / pull, e = cos z / (3 pull).
        let bend = reciprocal.times(high(near.third, first), 28);
        if bend.abs() < ONE >> 4 {
            let square = high(bend, bend) << 2;
            near.hop(first + (high(first, bend + 2 * square) << 2))
        } else {
            near.hop(first)
        }
    }
}
