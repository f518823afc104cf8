//! A launch and its flight in f32, as inputs of the search.

use crate::arithmetic::{Phase, node, square_root_single};

pub(super) const SPACING: f32 = node::SPACING as f32;
pub(super) const NODES_PER_RADIAN: f32 = (1.0 / node::SPACING) as f32;
pub(super) const RADIANS_PER_STEP: f32 = Phase::RADIANS_PER_STEP as f32;
pub(super) const STEPS_PER_RADIAN: f32 = Phase::STEPS_PER_RADIAN as f32;
/// Height in b beyond which no step ends at an impact.
pub(super) const MAX_HEIGHT: f32 = 2.0;
/// Arrival speed in `b w` below which a graze may be within rounding.
pub(super) const MAX_GRAZING_SPEED: f32 = 0.015;
/// Gap in b over a hump that is within rounding: some eighty ulps, the roundings of a height at
/// 60 b w. `grazing_flights_are_decided_down_to_rounding` tests it.
pub(super) const GAP_ROUNDING: f32 = 1e-5;
/// 1.5 * 2^23: adding it rounds an f32 below 2^22 to an integer in the low bits.
const ROUNDING_OFFSET: f32 = 12_582_912.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct Launch {
    /// Phase, steps.
    pub phase: u32,
    /// Velocity relative to the track (psi).
    pub velocity: f32,
    pub sine: f32,
    pub cosine: f32,
    /// `k - sin` of the phase, to the precision of the kernel.
    pub pull: f32,
}

/// Height and slope of the flight over the track at a node; the track's push and derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    pub height: f32,
    pub slope: f32,
    /// `A = -S''`, A' and -A''. A sine has its sine, cosine and sine.
    pub push: f32,
    pub jerk: f32,
    pub snap: f32,
}

pub(in crate::impact) type Motion = crate::impact::wave::Motion<f32>;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gravity {
    pub k: f32,
    pub half: f32,
    pub inverse: f32,
    /// Smallest squared speed at height 0 of a tall flight.
    pub min_tall_speed_squared: f32,
}

pub(in crate::impact) trait Track {
    /// Flight time in rad below which the height over the flight time keeps more digits.
    const MAX_SHORT_FLIGHT: f32;
    /// Longest last step of an approach, in rad: the remaining error is its cube.
    const MAX_LAST_STEP: f32;
    /// Last correction in rad that leaves an error within rounding, at an arrival speed of 1.
    const MAX_LAST_CORRECTION: f32;
    /// Rounding of the pull in `b w^2`.
    const PULL_ROUNDING: f32;
    /// Gap in b over a hump that is within rounding, per rad of flight.
    const GAP_ROUNDING_PER_RADIAN: f32;

    fn gravity(&self) -> Gravity;

    fn at(&self, node: i32) -> Motion;
}

#[derive(Clone, Copy)]
pub(in crate::impact) struct Ballistic<'a, T> {
    pub track: &'a T,
    /// Phase of the launch, steps.
    pub phase: u32,
    /// Displacement of the track there.
    pub height: f32,
    /// The ball's velocity there, `psi + S'`.
    pub rise: f32,
}

impl<T: Track> Ballistic<'_, T> {
    /// The flight at a node, counted from phase 0 of the turn of launch.
    #[inline(always)]
    pub fn local(&self, node: i32) -> Local {
        let steps = steps_to(self.phase, node);
        // Whole turns and the rest, each rounded once.
        let turns = ((steps + (1 << 31)) >> 32) as i32;
        let time = steps as i32 as f32 * RADIANS_PER_STEP + turns as f32 * core::f32::consts::TAU;
        let at = self.track.at(node);
        let fall = self.track.gravity().k * time;
        Local {
            height: (self.height - at.height) + time * (self.rise - 0.5 * fall),
            slope: self.rise - fall - at.speed,
            push: at.push,
            jerk: at.jerk,
            snap: at.snap,
        }
    }
}

#[inline(always)]
pub(super) fn steps_to(phase: u32, node: i32) -> i64 {
    (i64::from(node) << 24) - i64::from(phase)
}

#[inline(always)]
pub(super) fn abs(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & 0x7fff_ffff)
}

#[inline(always)]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
pub(super) fn newton_or_middle(newton: f32, low: f32, high: f32) -> f32 {
    let is_inside = newton > low && newton < high;
    if is_inside {
        newton
    } else {
        0.5 * (low + high)
    }
}

#[inline(always)]
pub(super) fn root(x: f32) -> f32 {
    if x > 0.0 { square_root_single(x) } else { 0.0 }
}

/// Nearest integer to `x`, |x| < 2^22, as integer and as f32.
#[inline(always)]
pub(super) fn nearest(x: f32) -> (i32, f32) {
    let shifted = x + ROUNDING_OFFSET;
    (
        (shifted.to_bits() as i32).wrapping_sub(ROUNDING_OFFSET.to_bits() as i32),
        shifted - ROUNDING_OFFSET,
    )
}

/// The node nearest to flight time `x` (rad) and the distance of `x` from it.
#[inline(always)]
pub(super) fn node_of(phase: u32, x: f32) -> (i32, f32) {
    let angle = phase as f32 * RADIANS_PER_STEP + x;
    let (node, count) = nearest(angle * NODES_PER_RADIAN);
    (node, angle - count * SPACING)
}

/// As [`node_of`], from the node nearest to the phase: the angle from there keeps its digits.
#[inline(always)]
pub(super) fn node_from_near(phase: u32, x: f32) -> (i32, f32) {
    let first = ((phase >> 23) + 1) >> 1;
    let angle = phase.wrapping_sub(first << 24) as i32 as f32 * RADIANS_PER_STEP + x;
    let (jump, count) = nearest(angle * NODES_PER_RADIAN);
    (first as i32 + jump, angle - count * SPACING)
}
