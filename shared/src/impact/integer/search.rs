//! The segment of convex or concave height that holds the first impact.

use super::ballistic::Ballistic;
use super::constants::{ONE, TURN, TURNS, WHOLE};
use crate::arithmetic::fixed::{Reciprocal, high, square_root_scaled, wide, wide_signed};
use crate::arithmetic::trigonometry::Powers;

/// A height, steps of 2^-30, below which the lowest point over a hump is looked for, though its middle
/// is under the track: the flight may graze.
const BARELY: i32 = 1 << 17;

/// A bracket with one down-crossing, where to begin in it, all in steps of a phase.
pub(super) struct Bracket {
    pub(super) low: i64,
    pub(super) high: i64,
    pub(super) start: i64,
}

impl Ballistic<'_> {
    /// The bracket of the first impact, and whether the flight grazes.
    #[inline(never)]
    pub(super) fn segment(&self, throws: bool, clears: bool) -> (Bracket, bool) {
        let constants = self.constants;
        if constants.hump == 0 {
            return (self.concave(), false);
        }
        let to_entry = match constants.entry.wrapping_sub(self.phase) {
            0 => WHOLE,
            steps => i64::from(steps),
        };
        let (over, velocity) = self.over(to_entry, constants.threshold);
        if over <= 0 && !clears {
            let low = if throws {
                (to_entry - (WHOLE - i64::from(constants.hump))).max(0)
            } else {
                0
            };
            let start = from_entry(to_entry, over, velocity - constants.flank, low);
            let bracket = Bracket {
                low,
                high: to_entry,
                start,
            };
            return (bracket, false);
        }
        let mut begin = to_entry;
        let mut slope = velocity - constants.flank;
        let mut height = over;
        if clears {
            begin += WHOLE;
            (height, slope) = self.entry(begin);
        }
        let mut grazes = false;
        for _ in 0..16 {
            if height <= 0 {
                let low = begin - (WHOLE - i64::from(constants.hump));
                let start = from_entry(begin, height, slope, low);
                let bracket = Bracket {
                    low,
                    high: begin,
                    start,
                };
                return (bracket, grazes);
            }
            let end = begin + i64::from(constants.hump);
            let (over_end, end_velocity) = self.over(end, constants.threshold);
            let high_end = if over_end <= 0 {
                Some((end, end))
            } else {
                let middle = begin + i64::from(constants.hump >> 1);
                let (over_top, top_velocity) = self.over(middle, ONE);
                if over_top <= -BARELY {
                    Some((middle, middle))
                } else if slope < 0
                    && end_velocity + constants.flank > 0
                    && !self.is_safe(over_top, top_velocity)
                {
                    let (poke, touches) = self.lowest(begin, end);
                    grazes |= touches;
                    poke
                } else {
                    (over_top <= 0).then_some((middle, middle))
                }
            };
            if let Some((high_end, farthest)) = high_end {
                let start = from_entry(begin, height, slope, begin).min(farthest);
                let bracket = Bracket {
                    low: begin,
                    high: high_end,
                    start,
                };
                return (bracket, grazes);
            }
            begin = self.skip(begin) + WHOLE;
            (height, slope) = self.entry(begin);
        }
        let bracket = Bracket {
            low: to_entry,
            high: begin,
            start: begin,
        };
        (bracket, true)
    }

    /// Height over k and slope over the track at the entry of a hump.
    #[inline(always)]
    pub(super) fn entry(&self, begin: i64) -> (i32, i32) {
        let (height, velocity) = self.over(begin, self.constants.threshold);
        (height, velocity - self.constants.flank)
    }

    /// The bracket where the track is concave throughout: up to where the parabola leaves height -1.
    #[inline(never)]
    pub(super) fn concave(&self) -> Bracket {
        // v^2 + 2 k (1 + sin), steps of 2^-26; below 37 where the flight is not high.
        let rise = (self.rise >> 22) as i32;
        let v = rise >> 13;
        let drop = high(self.constants.k, (self.sine >> 1) + (ONE >> 1)) << 2;
        let square = ((v * v) as u32).wrapping_add(drop as u32);
        let speed = square_root_scaled(square) >> 3;
        let turns = wide(speed.saturating_add_signed(rise), self.constants.inverse) >> 32;
        let high = ((turns as i64) << 14) + (1 << 18);
        Bracket {
            low: 0,
            high,
            start: high,
        }
    }

    /// Whether `1 - cos x >= 4 x^2 / pi^2` within the hump keeps the track below the parabola, from the
    /// height over 1 and the velocity at the middle of the hump.
    #[inline(always)]
    pub(super) fn is_safe(&self, over_top: i32, velocity: i32) -> bool {
        // 16 / pi^2, steps of 2^-28; below it k is below 1.
        const BOUND: i32 =
            (16.0 / (core::f64::consts::PI * core::f64::consts::PI) * 268_435_456.0) as i32;
        let spare = BOUND - 2 * self.constants.k;
        // Both products in steps of 2^-26, rounded to the careful side.
        spare > 0
            && i64::from(high(spare, over_top)) - 1 > (wide_signed(velocity, velocity) >> 26) + 1
    }

    /// The last hump at or after the one at `begin` under a ball above height 1, with all between them.
    #[inline(never)]
    pub(super) fn skip(&self, begin: i64) -> i64 {
        let (over, velocity) = self.over(begin, ONE);
        if over < ONE || velocity <= 0 {
            return begin;
        }
        // Rising above height 2: 2 velocity / k until it is there again.
        let rounds = (wide(velocity as u32, self.constants.inverse) >> 49) as i64;
        begin + (rounds - 2).max(0) * WHOLE
    }

    /// The lowest point over the hump from `begin` to `end`: where it is, twice, if it is below the
    /// track, and whether that is within rounding.
    #[inline(never)]
    pub(super) fn lowest(&self, begin: i64, end: i64) -> (Option<(i64, i64)>, bool) {
        let phase = i64::from(self.phase);
        let mut low = ((begin + phase) >> 24) as i32;
        let mut high_node = ((end + phase) >> 24) as i32 + 1;
        while high_node - low > 1 {
            let middle = (low + high_node) / 2;
            if self.local(middle).slope > 0 {
                high_node = middle;
            } else {
                low = middle;
            }
        }
        let (node, local) = (low, self.local(low));
        // Within the hump the slope rises, so that bisection finds its zero.
        let place = |steps: i64| {
            let steps = (steps - self.steps_to(node)).clamp(0, 1 << 24) as i32;
            high(steps, TURN) << 6
        };
        let (mut left, mut right) = (place(begin), place(end));
        for _ in 0..16 {
            let middle = (left + right) / 2;
            if local.slope + self.gain(&local, middle, &Powers::of(middle)) > 0 {
                right = middle;
            } else {
                left = middle;
            }
        }
        let d = (left + right) / 2;
        let powers = Powers::of(d);
        let height = self.height(&local, d, &powers);
        // The cosine at launch, rounded to 4e-9, moves the height by that times the flight.
        let drift = (self.steps_to(node) >> 27) as u32;
        let touches = height.unsigned_abs() < 11 + drift;
        let place = (self.steps_to(node) + i64::from(high(d, TURNS) >> 2)).clamp(begin, end);
        ((height <= 0).then_some((place, place)), touches)
    }
}

/// Where Newton's step leads from the entry of a hump, steps of a phase, not before `low`.
#[inline(always)]
fn from_entry(entry: i64, height: i32, slope: i32, low: i64) -> i64 {
    if slope >= 0 {
        return entry;
    }
    let step = Reciprocal::coarse(slope.unsigned_abs()).times(height, 20);
    // Steps of 2^-24 rad.
    let step = step.clamp(-(3 << 24), 3 << 24);
    (entry + (i64::from(high(step, TURNS)) << 8)).max(low)
}
