//! Search for the convex or concave segment that holds the first impact
//! (docs/theory-impacts.md#t3.2).

use super::ballistic::Ballistic;
use core::f64::consts::PI;

use super::constants::{RADIANS_PER_TURN, TURNS_PER_RADIAN, turn_steps};
use crate::arithmetic::Phase;
use crate::arithmetic::fixed::{Fixed, Reciprocal};

/// Height in b over a hump's middle below the track: smaller ones need the minimum, as the flight
/// may graze.
const MIN_TOUCH_DEPTH: Fixed<30> = Fixed::<30>::from_constant(1.0 / 8192.0);

/// A bracket with one down-crossing and the start in it, in steps of a phase after launch.
#[derive(Clone, Copy)]
pub(super) struct Bracket {
    pub(super) low: i64,
    pub(super) high: i64,
    pub(super) start: i64,
}

impl Ballistic<'_> {
    /// The bracket of the first impact, and whether the flight grazes.
    #[inline(never)]
    pub(super) fn find_bracket(&self, throws: bool, clears: bool) -> (Bracket, bool) {
        let constants = self.constants;
        if constants.hump == 0 {
            return (self.concave(), false);
        }
        let to_lift_off = match constants.lift_off.wrapping_sub(self.phase) {
            0 => Phase::STEPS,
            steps => i64::from(steps),
        };
        let (over, velocity) = self.height_over(to_lift_off, constants.threshold);
        if over <= Fixed::<30>::ZERO && !clears {
            let low = if throws {
                (to_lift_off - (Phase::STEPS - i64::from(constants.hump))).max(0)
            } else {
                0
            };
            let start = from_begin(to_lift_off, over, velocity - constants.lift_off_cosine, low);
            let bracket = Bracket {
                low,
                high: to_lift_off,
                start,
            };
            return (bracket, false);
        }
        let mut begin = to_lift_off;
        let mut slope = velocity - constants.lift_off_cosine;
        let mut height = over;
        if clears {
            begin += Phase::STEPS;
            (height, slope) = self.at_begin(begin);
        }
        let mut grazes = false;
        // The hump count bounds the rounds.
        for _ in 0..16 {
            if height <= Fixed::<30>::ZERO {
                let low = begin - (Phase::STEPS - i64::from(constants.hump));
                let start = from_begin(begin, height, slope, low);
                let bracket = Bracket {
                    low,
                    high: begin,
                    start,
                };
                return (bracket, grazes);
            }
            let end = begin + i64::from(constants.hump);
            let (over_end, end_velocity) = self.height_over(end, constants.threshold);
            let high_end = if over_end <= Fixed::<30>::ZERO {
                Some((end, end))
            } else {
                let middle = begin + i64::from(constants.hump >> 1);
                let (over_top, top_velocity) = self.height_over(middle, Fixed::<30>::ONE);
                if over_top <= -MIN_TOUCH_DEPTH {
                    Some((middle, middle))
                } else if slope < Fixed::<26>::ZERO
                    && end_velocity + constants.lift_off_cosine > Fixed::<26>::ZERO
                    && !self.clears_hump(over_top, top_velocity)
                {
                    let (poke, touches) = self.find_minimum(begin, end);
                    grazes |= touches;
                    poke
                } else {
                    (over_top <= Fixed::<30>::ZERO).then_some((middle, middle))
                }
            };
            if let Some((high_end, farthest)) = high_end {
                let start = from_begin(begin, height, slope, begin).min(farthest);
                let bracket = Bracket {
                    low: begin,
                    high: high_end,
                    start,
                };
                return (bracket, grazes);
            }
            begin = self.last_passed_hump(begin) + Phase::STEPS;
            (height, slope) = self.at_begin(begin);
        }
        let bracket = Bracket {
            low: to_lift_off,
            high: begin,
            start: begin,
        };
        (bracket, true)
    }

    /// Height minus k, and slope relative to the track, at a hump's begin.
    #[inline(always)]
    pub(super) fn at_begin(&self, begin: i64) -> (Fixed<30>, Fixed<26>) {
        let (height, velocity) = self.height_over(begin, self.constants.threshold);
        (height, velocity - self.constants.lift_off_cosine)
    }

    /// The bracket on a track that is concave throughout: up to the parabola's fall below
    /// height -1.
    #[inline(never)]
    pub(super) fn concave(&self) -> Bracket {
        // v^2 + 2 k (1 + sin), below 37 where the flight is not tall.
        let rise = self.rise.narrow::<26>();
        let v = rise.to::<13>();
        let lift = self.sine.to::<29>() + Fixed::<29>::from_constant(1.0);
        let drop: Fixed<27> = self.constants.k.times(lift);
        let square = Fixed::<26, u32>(v.short_times::<13, 26>(v).0 as u32)
            .wrapping_add(Fixed(drop.scaled::<26>().0 as u32));
        let speed = square.root::<26>();
        let sum = Fixed::<26, u32>(speed.0.saturating_add_signed(rise.0));
        let turns: Fixed<50, u64> = sum.wide(self.constants.inverse);
        let high = Fixed::<18, i64>(turns.to::<18>().0 as i64).to::<32>().0 + (1 << 18);
        Bracket {
            low: 0,
            high,
            start: high,
        }
    }

    /// Whether `1 - cos x >= 4 x^2 / pi^2` keeps the track below the parabola over the hump.
    ///
    /// The inputs are the height over 1 and the velocity at the middle of the hump.
    #[inline(always)]
    pub(super) fn clears_hump(&self, over_top: Fixed<30>, velocity: Fixed<26>) -> bool {
        // A positive spare implies k below 1.
        const VERSINE_BOUND: Fixed<28> = Fixed::<28>::floor_of_constant(16.0 / (PI * PI));
        let margin = VERSINE_BOUND - (self.constants.k + self.constants.k);
        let height: Fixed<26> = margin.times(over_top);
        let square: Fixed<52, i64> = velocity.wide(velocity);
        // Both rounded to the safe side.
        margin > Fixed::<28>::ZERO && i64::from(height.0) - 1 > square.to::<26>().0 + 1
    }

    /// The last hump, from the one at `begin` on, with the ball above height 1 over all of them.
    #[inline(never)]
    pub(super) fn last_passed_hump(&self, begin: i64) -> i64 {
        let (over, velocity) = self.height_over(begin, Fixed::<30>::ONE);
        if over < Fixed::<30>::ONE || velocity <= Fixed::<26>::ZERO {
            return begin;
        }
        // Rising above height 2: the ball returns there after 2 velocity / k.
        let turns: Fixed<50, u64> = velocity.unsigned().wide(self.constants.inverse);
        let rounds = turns.scaled::<49>().to::<0>().0 as i64;
        begin + (rounds - 2).max(0) * Phase::STEPS
    }

    /// Minimum of the gap over the hump from `begin` to `end`: its time twice if it is below the
    /// track.
    ///
    /// The second value: whether it is within rounding.
    #[inline(never)]
    pub(super) fn find_minimum(&self, begin: i64, end: i64) -> (Option<(i64, i64)>, bool) {
        let phase = i64::from(self.phase);
        let mut low = ((begin + phase) >> 24) as i32;
        let mut high_node = ((end + phase) >> 24) as i32 + 1;
        while high_node - low > 1 {
            let middle = (low + high_node) / 2;
            if self.local(middle).slope > Fixed::<26>::ZERO {
                high_node = middle;
            } else {
                low = middle;
            }
        }
        let (node, local) = (low, self.local(low));
        // Within the hump the slope increases, so bisection finds its zero.
        let place = |steps: i64| {
            let steps = (steps - self.steps_to(node)).clamp(0, 1 << 24) as i32;
            Fixed::<32>(steps).times::<28, 34>(RADIANS_PER_TURN)
        };
        let (mut left, mut right) = (place(begin), place(end));
        for _ in 0..16 {
            let middle = Fixed((left.0 + right.0) / 2);
            if self.expand(&local, middle).1 > Fixed::<26>::ZERO {
                right = middle;
            } else {
                left = middle;
            }
        }
        let d = Fixed((left.0 + right.0) / 2);
        let height = self.expand(&local, d).0;
        // Steps by which the products of a height round.
        const HEIGHT_ROUNDING_STEPS: u32 = 11;
        // The cosine at launch, rounded to 4e-9, shifts the height by that times the flight: 5
        // steps of 2^-30 per rad.
        let drift = (self.steps_to(node) >> 27) as u32;
        let touches = height.unsigned_abs().0 < HEIGHT_ROUNDING_STEPS + drift;
        let turns: Fixed<32> = d.times(TURNS_PER_RADIAN);
        let place = (self.steps_to(node) + i64::from(turns.0)).clamp(begin, end);
        (
            (height <= Fixed::<30>::ZERO).then_some((place, place)),
            touches,
        )
    }
}

/// Newton's step from a hump's begin, in steps of a phase, not before `low`.
#[inline(always)]
pub(super) fn from_begin(lift_off: i64, height: Fixed<30>, slope: Fixed<26>, low: i64) -> i64 {
    if slope >= Fixed::<26>::ZERO {
        return lift_off;
    }
    let step: Fixed<24> = Reciprocal::coarse(slope.unsigned_abs()).times(height);
    let farthest = Fixed::<24>::from_constant(3.0);
    (lift_off + turn_steps(step.clamp(-farthest, farthest))).max(low)
}
