//! Short hops below 1/16 rad: the root of the height divided by the flight time, by Newton's
//! method.

use super::ballistic::Ballistic;
use crate::arithmetic::fixed::{Fixed, Reciprocal, high, wide, wide_signed};

/// Longest flight time in rad of a short hop.
const MAX_SHORT_HOP: Fixed<34> = Fixed::<34>::from_constant(1.0 / 16.0);

/// The flight near launch, with the height `d (2 psi - d G) / 2`.
///
/// `G = pull - cos d / 3 + sin d^2 / 12`. The number of places varies from flight to flight.
#[derive(Clone, Copy)]
struct NearLaunch {
    /// `k - sin` and sine of the phase of launch, cosine / 3: steps of 2^(down - 30).
    pull: i32,
    sine: i32,
    third: i32,
    cosine: i32,
    /// 2 psi in steps of 2^(down - 64), at most 1/4 (1 where `down` is 2), which no short hop
    /// reaches.
    twice: i64,
    down: u32,
}

impl NearLaunch {
    #[inline(always)]
    fn new(pull: i32, sine: i32, cosine: i32, velocity: u32, down: u32) -> Self {
        Self {
            pull,
            sine,
            third: high(cosine, Fixed::<32>::from_constant(1.0 / 3.0).0),
            cosine,
            twice: i64::from(velocity.min(1 << (23 + down))) << (39 - down),
            down,
        }
    }

    /// `G` and the derivative of `d G` at `d`, below [`MAX_SHORT_HOP`].
    #[inline(always)]
    fn mean_and_slope(&self, Fixed(d): Fixed<34>) -> (i32, i32) {
        let linear = high(self.third, d) >> 2;
        let quadratic = high(self.sine, high(d, d)) >> 4;
        (
            self.pull - linear
                + (((quadratic >> 5) * Fixed::<17>::from_constant(1.0 / 12.0).0) >> 12),
            self.pull - 2 * linear + (quadratic >> 2),
        )
    }

    /// Newton's step from `d` to where `d G` reaches 2 psi, for a slope above 0.
    #[inline(always)]
    fn newton_step(&self, d: Fixed<34>, mean: i32, slope: i32) -> Fixed<34> {
        // Computed as if `down` were 0: its value cancels.
        let reciprocal = Reciprocal::coarse(Fixed::<30, u32>(slope as u32));
        let rest = self.twice - wide_signed(d.0, mean);
        // The shortest hops from rest keep their digits this way.
        if rest == i64::from(rest as i32) {
            return reciprocal.times(Fixed::<64>(rest as i32));
        }
        // A saturated step still leads towards the root.
        let rest = (rest >> 24).clamp(-i64::from(i32::MAX), i64::from(i32::MAX)) as i32;
        reciprocal.times(Fixed::<40>(rest))
    }

    /// The hop where `d G` reaches 2 psi, by Newton's method.
    ///
    /// It starts near the root, or on the left of a concave or on the right of a convex `d G`.
    #[inline(always)]
    fn hop(&self, mut d: Fixed<34>) -> ShortFlight {
        let mut round = 0;
        loop {
            let (mean, slope) = self.mean_and_slope(d);
            if slope <= 0 {
                return self.before_end();
            }
            let step = self.newton_step(d, mean, slope);
            d = d.saturating_add(step).max(Fixed::<34>::ZERO);
            if d >= MAX_SHORT_HOP {
                return self.before_end();
            }
            round += 1;
            // Without convergence the steps circle the root within the resolution of a small pull.
            if step.unsigned_abs() <= d.to::<22>().unsigned_abs().scaled() || round == 24 {
                // u' = -d (d G)' / 2 at the root; half a step rounds.
                let slope = slope - 2 * (high(self.third, step.0) >> 2);
                let up = 7 - self.down;
                let arrival = Fixed((high(d.0, slope) + (1 << (up - 1))) >> up);
                // The flight grazes where the rounding of the pull, some 2^-29, shifts d G by the
                // distance to its maximum, slope^2 / (4 cos / 3).
                let grazes = self.down == 0
                    && slope.unsigned_abs() < 1 << 15
                    && slope * slope < high(self.cosine, d.0);
                return ShortFlight::Hop {
                    flight: d,
                    arrival,
                    grazes,
                };
            }
        }
    }

    /// The hop from the right end, 1/16 rad, if one ends before it.
    #[inline(never)]
    fn before_end(&self) -> ShortFlight {
        let mut d = MAX_SHORT_HOP - Fixed::<34>::STEP;
        let (mean, _) = self.mean_and_slope(d);
        if self.twice >= wide_signed(d.0, mean) {
            // So near to the throw the maximum of d G, at 3 pull / (2 cos), lies before the right
            // end and below 2 psi.
            let clears = self.down == 0 && self.pull > 0 && self.pull < self.cosine >> 5;
            return if clears {
                ShortFlight::Clears {
                    grazes: self.skims(),
                }
            } else {
                ShortFlight::Open
            };
        }
        for _ in 0..60 {
            let (mean, slope) = self.mean_and_slope(d);
            if slope <= 0 {
                break;
            }
            let step = self.newton_step(d, mean, slope);
            d = (d + step).max(Fixed::<34>::ZERO);
            if step.unsigned_abs() <= d.to::<22>().unsigned_abs().scaled() {
                break;
            }
        }
        let (_, slope) = self.mean_and_slope(d);
        let arrival = Fixed(high(d.0, slope.max(0)) >> (7 - self.down));
        ShortFlight::Hop {
            flight: d,
            arrival,
            grazes: false,
        }
    }

    /// Whether 2 psi exceeds the maximum of `d G` by rounding alone, or by the omitted terms.
    ///
    /// `G` is too small by `cos d^3 / 60`, at most 4e-6.
    #[inline(never)]
    fn skims(&self) -> bool {
        let reciprocal = Reciprocal::coarse(Fixed::<30, u32>(self.cosine as u32));
        let last = MAX_SHORT_HOP - Fixed::<34>::STEP;
        let top: Fixed<34> = reciprocal.times(Fixed::<30>(self.pull + self.pull / 2));
        let mut d = top.min(last);
        for _ in 0..2 {
            let (_, slope) = self.mean_and_slope(d);
            // -(d G)'' = 2 cos / 3 - sin d / 2.
            let bend = (2 * self.third - (high(self.sine, d.0) >> 3)).max(1);
            let reciprocal = Reciprocal::coarse(Fixed::<30, u32>(bend as u32));
            let step = reciprocal.times(Fixed::<30>(slope));
            d = d.saturating_add(step).clamp(Fixed::<34>::ZERO, last);
        }
        let gap = self.twice - wide_signed(d.0, self.mean_and_slope(d).0);
        let cube = high(self.cosine, high(d.0, high(d.0, d.0))) >> 6;
        let left_out = i64::from((cube >> 6) + (cube >> 9)) + (1 << 3);
        gap < i64::from(d.0) * left_out
    }
}

/// Result of the flight near launch.
pub(super) enum ShortFlight {
    /// A short hop: flight in rad, arrival speed, and whether it clears the coming hump but for
    /// rounding.
    Hop {
        flight: Fixed<34>,
        arrival: Fixed<26>,
        grazes: bool,
    },
    /// The flight clears the coming hump; `grazes`: by rounding alone.
    Clears { grazes: bool },
    /// Undecided.
    Open,
}

impl Ballistic<'_> {
    /// The flight near launch: short hops below 1/16 rad, in a form that keeps every digit.
    #[inline(always)]
    pub(super) fn short_flight(&self, throws: bool) -> ShortFlight {
        let constants = self.constants;
        // Steps of 2^-30 where they have room.
        let wide_pull = constants.k - self.sine.to();
        let near = if wide_pull < Fixed::<28>::ONE {
            let pull = constants.threshold.wrapping_sub(self.sine);
            // At lift-off itself rounding must not change the sign of the pull, nor make it 0.
            let pull = if throws {
                pull.0.min(-1)
            } else {
                pull.0.max(1)
            };
            NearLaunch::new(pull, self.sine.0, self.cosine.0, self.velocity.0, 0)
        } else {
            NearLaunch::new(
                wide_pull.0.max(1),
                self.sine.to::<28>().0,
                self.cosine.to::<28>().0,
                self.velocity.0,
                2,
            )
        };
        if throws {
            return near.before_end();
        }
        let reciprocal = Reciprocal::fine(Fixed::<30, u32>(near.pull as u32));
        // 2 psi / pull.
        let ratio = wide(self.velocity.0, reciprocal.mantissa);
        let shift = (23 + near.down).checked_sub(reciprocal.shift);
        let Some(first) = shift
            .map(|shift| ratio >> shift)
            .filter(|&z| z < MAX_SHORT_HOP.unsigned().0.into())
        else {
            return near.before_end();
        };
        let first = Fixed::<34>(first as i32);
        // d = z (1 + e + 2 e^2) with z = 2 psi / pull, e = cos z / (3 pull).
        let bend: Fixed<30> = reciprocal.times(Fixed::<30>(near.third).times::<34, 32>(first));
        // Beyond this bound the first terms are useless; from 1/4 on the start may overflow.
        if bend.abs() < Fixed::<30>::from_constant(1.0 / 16.0) {
            let square: Fixed<30> = bend.times(bend);
            near.hop(first + first.times(bend + square + square))
        } else {
            near.hop(first)
        }
    }
}
