//! A track and a part in the integers that a flight is computed from.

use crate::arithmetic::node;
use crate::impact::set_up::SetUp;

pub(super) const ONE: i32 = 1 << 30;
/// An arrival at less than 1/64, steps of 2^-26, may be a graze within rounding.
pub(super) const SLOW: i32 = 1 << 20;
/// A flight of 1/16 rad in steps of a phase: shorter ones have a form that keeps every digit.
pub(super) const SHORT: i64 = 42_722_829;
/// Half a rad in steps of a phase.
pub(super) const HALF: i64 = 8 * SHORT;
/// 2 pi, steps of 2^-28.
pub(super) const TURN: i32 = 1_686_629_713;
/// 1 / (2 pi), steps of 2^-32: turns in a radian.
pub(super) const TURNS: i32 = 683_565_276;
/// A turn in steps of a phase.
pub(super) const WHOLE: i64 = 1 << 32;
/// The farthest that the expansion about a node is used: 1/40 rad in steps of 2^-34.
pub(super) const REACH: i32 = ((1_i64 << 34) / 40) as i32;
/// Distance of two nodes, steps of 2^-34 rad.
pub(super) const SPACING: i32 = (node::SPACING * 17_179_869_184.0) as i32;

/// The constants of one track and one restitution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Constants {
    /// Phase where a hump begins, and its length.
    pub entry: u32,
    pub hump: u32,
    /// k, steps of 2^-28, and steps of 2^-30 modulo 4.
    pub k: i32,
    pub threshold: i32,
    /// Slope of the sine at the entry of a hump, steps of 2^-26.
    pub flank: i32,
    /// k pi, steps of 2^-48.
    pub half_turn_fall: u64,
    /// 1 / (2 pi k), steps of 2^-24.
    pub inverse: u32,
    /// The least square of the speed at height 0 of a high flight, steps of 2^-27.
    pub high: i32,
    /// Restitution, steps of 2^-32, 1 as 2^32 - 1.
    pub restitution: u32,
}

impl Constants {
    /// Those of a set-up, rounded to their steps.
    pub fn new(set_up: &SetUp, restitution: f64) -> Self {
        let pi = core::f64::consts::PI;
        Self {
            entry: set_up.entry.bits(),
            hump: set_up.hump,
            k: libm::round(set_up.k * 268_435_456.0) as i32,
            threshold: libm::round(set_up.k * 1_073_741_824.0) as u64 as i32,
            flank: libm::round(set_up.flank * 67_108_864.0) as i32,
            half_turn_fall: libm::round(set_up.k * pi * 281_474_976_710_656.0) as u64,
            inverse: libm::round(16_777_216.0 / (2.0 * pi * set_up.k)) as u32,
            high: libm::round(set_up.high() * 134_217_728.0) as i32,
            restitution: libm::round(restitution * 4_294_967_296.0) as u32,
        }
    }

    /// Whether a down-crossing `steps` after launch at `phase` comes before the end of the next hump, and
    /// not so soon that it is settled with more digits as a short hop.
    #[inline(always)]
    pub fn ends(&self, phase: u32, steps: i64) -> bool {
        steps >= SHORT && steps <= self.limit(phase)
    }

    /// Steps from `phase` to the end of the next hump, and no fewer than 1 to its entry.
    #[inline(always)]
    pub fn limit(&self, phase: u32) -> i64 {
        let to_entry = self.entry.wrapping_sub(phase).wrapping_sub(1);
        i64::from(to_entry) + i64::from(self.hump)
    }
}
