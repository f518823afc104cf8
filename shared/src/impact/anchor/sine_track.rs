//! Shape: the constants of a track for the search in f32, and closed tests of a flight.

use super::flight::{
    Gravity, Motion, RADIANS_PER_STEP, STEPS_PER_RADIAN, Track, abs, larger, smaller,
};
use crate::arithmetic::Phase;
use crate::arithmetic::node::SINE_COSINE_SINGLE;
use crate::arithmetic::positive::Positive;
use crate::impact::set_up::SetUp;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SineTrack {
    pub(super) gravity: Gravity,
    pub(super) excess: f32,
    pub(super) lift_off_cosine: f32,
    pub(super) hump_length: f32,
    /// Slope down to a hump's begin: steepest for the cubic bound of [`SineTrack::clears`].
    pub(super) skim: f32,
    pub lift_off: u32,
    pub hump: u32,
}

impl SineTrack {
    #[inline(always)]
    pub fn new(set_up: &SetUp) -> Self {
        // Time in rad into a hump up to which the cubic bound holds: `k x / (4 c)` is 0.12 and
        // `x^2 / 20` 0.08 there.
        const MAX_CUBIC_TIME: f32 = 1.26;
        let SetUp { single, hump, .. } = *set_up;
        let inverse = set_up.inverse();
        let lift_off_cosine = set_up.lift_off_cosine.single();
        let reach = smaller(0.48 * lift_off_cosine * inverse, MAX_CUBIC_TIME);
        Self {
            gravity: Gravity {
                k: single,
                half: 0.5 * single,
                inverse,
                min_tall_speed_squared: set_up.min_tall_speed_squared().single(),
            },
            excess: set_up.excess(),
            lift_off_cosine,
            // Rounded to nearest.
            hump_length: Positive::RADIANS_PER_STEP.times_integer_single(hump),
            skim: 0.4 * lift_off_cosine * reach * reach,
            lift_off: set_up.lift_off.bits(),
            hump,
        }
    }

    /// Whether the track throws a part at `phase`: `sin > k`.
    #[inline(always)]
    pub fn throws(&self, phase: u32) -> bool {
        phase.wrapping_sub(self.lift_off) < self.hump
    }

    /// Whether a down-crossing `steps` after launch lies between the short hops and the end of the
    /// next hump. The lower bound excludes launch itself and impacts that the short form settles
    /// with more digits. It is a fifth below the longest short hop, because a candidate only
    /// approximates the impact.
    #[inline(always)]
    pub fn ends(&self, phase: u32, steps: i64) -> bool {
        let to_lift_off = self.lift_off.wrapping_sub(phase).wrapping_sub(1);
        steps >= (0.8 * Self::MAX_SHORT_FLIGHT * STEPS_PER_RADIAN) as i64
            && steps <= i64::from(to_lift_off) + i64::from(self.hump)
    }

    /// Whether the flight clears the next hump and a down-crossing `steps` after launch comes
    /// before the hump after it. At the hump's begin `u` has the height `h` and falls at `p`. From
    /// there on `u` is above `h - p x + f x^3 / 6` with `f = 0.8 lift_off_cosine`. This holds as
    /// far as `k x / (4 lift_off_cosine) + x^2 / 20 <= 0.2`. The minimum of that bound, at `x^2 = 2
    /// p / f`, is above 0 if `h^2 f > 8 p^3 / 9`; beyond it `u` rises.
    #[inline(never)]
    pub fn clears(&self, phase: u32, v: f32, pull: f32, steps: i64) -> bool {
        let to_lift_off = self.lift_off.wrapping_sub(phase).wrapping_sub(1);
        let x = to_lift_off as f32 * RADIANS_PER_STEP;
        // Lower and upper bounds that include rounding. Without the first, 41 of 420 000 touches in
        // f32 are not flagged.
        let height = x * (v - self.gravity.half * x) - pull - 1e-4;
        let fall = larger(self.lift_off_cosine + self.gravity.k * x - v, 0.0) + 1e-5;
        height > 0.0
            && fall < self.skim
            && 0.8 * self.lift_off_cosine * height * height > (8.0 / 9.0) * fall * fall * fall
            && steps > 0
            && steps <= i64::from(to_lift_off) + Phase::STEPS
    }

    /// `k - sin` near an end of a hump, where the difference of the rounded values loses digits. It
    /// is computed from the distance to the nearer end, whose rounding is half a step of the phase.
    #[inline(never)]
    pub fn pull_near_ends(&self, phase: u32) -> f32 {
        let after_begin = phase.wrapping_sub(self.lift_off) as i32 as f32 * RADIANS_PER_STEP;
        let before_end = self.lift_off.wrapping_add(self.hump).wrapping_sub(phase) as i32 as f32
            * RADIANS_PER_STEP;
        let d = if abs(after_begin) < abs(before_end) {
            after_begin
        } else {
            before_end
        };
        let z = d * d;
        let rise = self.lift_off_cosine * d * (1.0 - z * (1.0 / 6.0))
            - self.gravity.k * z * (0.5 - z * (1.0 / 24.0));
        self.excess - rise
    }
}

impl Track for SineTrack {
    // Near the top of the track, other values give larger errors or wrong impacts.
    const MAX_SHORT_FLIGHT: f32 = 0.25;
    const MAX_LAST_STEP: f32 = 0.03;
    const MAX_LAST_CORRECTION: f32 = 5e-3;
    // An ulp of 1.
    const PULL_ROUNDING: f32 = 1.2e-7;
    // Eight ulps.
    const GAP_ROUNDING_PER_RADIAN: f32 = 1e-6;

    #[inline(always)]
    fn gravity(&self) -> Gravity {
        self.gravity
    }

    #[inline(always)]
    fn at(&self, node: i32) -> Motion {
        let [sine, cosine] = SINE_COSINE_SINGLE[(node & 255) as usize];
        Motion {
            height: sine,
            speed: cosine,
            push: sine,
            jerk: cosine,
            snap: sine,
        }
    }
}
