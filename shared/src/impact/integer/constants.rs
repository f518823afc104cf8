//! Constants of a track and a part, as integers.

use crate::arithmetic::fixed::Fixed;
use crate::arithmetic::{Phase, node};
use crate::impact::set_up::SetUp;

/// Arrival speed in `b w` below which a graze may be within rounding: its squares use all digits.
pub(super) const MAX_GRAZING_SPEED: Fixed<26> = Fixed::<26>::from_constant(1.0 / 64.0);
/// Flight time of 1/16 rad in steps of a phase; shorter flights use the divided form, which keeps
/// every digit.
pub(super) const MAX_SHORT_FLIGHT: i64 = (Phase::STEPS_PER_RADIAN / 16.0) as i64;
/// Half a rad in steps of a phase.
pub(super) const HALF_RADIAN: i64 = 8 * MAX_SHORT_FLIGHT;
/// Largest distance from a node in rad for its expansion. It slightly exceeds the node spacing and
/// stays within the 2^-5 range of the powers.
pub(super) const MAX_NODE_DISTANCE: Fixed<34> = Fixed::<34>::floor_of_constant(1.0 / 40.0);
/// Node spacing in rad.
pub(super) const SPACING: Fixed<34> = Fixed::<34>::from_constant(node::SPACING);
/// Radians per turn, 2 pi, and turns per radian.
pub(super) use crate::arithmetic::trigonometry::{RADIANS_PER_TURN, TURNS_PER_RADIAN};

/// An angle in rad in steps of a phase.
#[inline(always)]
pub(super) fn turn_steps(angle: Fixed<24>) -> i64 {
    let turns: Fixed<24> = angle.times(TURNS_PER_RADIAN);
    i64::from(turns.0) << 8
}

/// The constants of one track and one restitution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Constants {
    /// Phase where a hump begins, and its length.
    pub lift_off: u32,
    pub hump: u32,
    /// k.
    pub k: Fixed<28>,
    /// k modulo 4.
    pub threshold: Fixed<30>,
    /// Slope of the sine at the begin of a hump.
    pub lift_off_cosine: Fixed<26>,
    /// k pi.
    pub half_turn_fall: Fixed<48, i64>,
    /// 1 / (2 pi k).
    pub inverse: Fixed<24, u32>,
    /// Smallest squared speed at height 0 of a tall flight.
    pub min_tall_speed_squared: Fixed<27>,
    /// Restitution, 1 as 1 - 2^-32.
    pub restitution: Fixed<32, u32>,
}

impl Constants {
    /// The constants of a set-up, rounded to their steps.
    pub fn new(set_up: &SetUp) -> Self {
        Self {
            lift_off: set_up.lift_off.bits(),
            hump: set_up.hump,
            k: set_up.fixed(),
            threshold: set_up.fixed(),
            lift_off_cosine: Fixed(set_up.lift_off_cosine.nearest(26) as i32),
            half_turn_fall: set_up.half_turn_fall(),
            inverse: Fixed(set_up.turns().nearest(24) as u32),
            min_tall_speed_squared: Fixed(set_up.min_tall_speed_squared().nearest(27) as i32),
            restitution: set_up.restitution,
        }
    }

    /// Whether a down-crossing `steps` after launch lies between the short hops and the end of the
    /// next hump.
    #[inline(always)]
    pub fn ends(&self, phase: u32, steps: i64) -> bool {
        steps >= MAX_SHORT_FLIGHT && steps <= self.limit(phase)
    }

    /// Steps from `phase` to the end of the next hump; at least 1 to its begin.
    #[inline(always)]
    pub fn limit(&self, phase: u32) -> i64 {
        let to_lift_off = self.lift_off.wrapping_sub(phase).wrapping_sub(1);
        i64::from(to_lift_off) + i64::from(self.hump)
    }
}
