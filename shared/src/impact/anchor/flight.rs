//! A launch and its flight in f32, as inputs of the search.

use crate::arithmetic::{Phase, node, square_root_single};

/// Distance of two nodes in rad.
pub(super) const SPACING: f32 = node::SPACING as f32;
pub(super) const NODES_PER_RADIAN: f32 = (1.0 / node::SPACING) as f32;
pub(super) const RADIANS_PER_STEP: f32 = Phase::RADIANS_PER_STEP as f32;
pub(super) const STEPS_PER_RADIAN: f32 = Phase::STEPS_PER_RADIAN as f32;
/// Height in b beyond which a kernel may keep only the sign ([`Flight::local`]): no step from there
/// ends at an impact.
pub(super) const MAX_KNOWN_HEIGHT: f32 = 2.0;
/// 1.5 * 2^23: adding it rounds an f32 below 2^22 to an integer in the low bits.
const ROUNDING_OFFSET: f32 = 12_582_912.0;

/// A launch in f32.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Launch {
    /// Phase, steps.
    pub phase: u32,
    /// Velocity relative to the track (psi).
    pub velocity: f32,
    /// Sine and cosine of the phase.
    pub sine: f32,
    pub cosine: f32,
    /// `k - sin` of the phase, to the precision of the kernel.
    pub pull: f32,
}

/// Height and slope of the flight above the track at a node, with the track's push and its
/// derivatives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Local {
    pub height: f32,
    pub slope: f32,
    /// `A = -S''`, A' and -A''. A sine has its sine, cosine and sine.
    pub push: f32,
    pub surge: f32,
    pub bend: f32,
}

/// Motion of the track at a node.
#[derive(Clone, Copy, Debug)]
pub(in crate::impact) struct Motion {
    /// Displacement S.
    pub height: f32,
    /// S'.
    pub speed: f32,
    /// `A = -S''`, A' and -A''.
    pub push: f32,
    pub surge: f32,
    pub bend: f32,
}

/// A track, for steps on nodes.
pub(super) trait Track {
    /// k, half of it and its inverse.
    fn k(&self) -> f32;
    fn half_k(&self) -> f32;
    fn inverse(&self) -> f32;
    /// Smallest squared speed at height 0 of a tall flight.
    fn min_tall_speed_squared(&self) -> f32;
    /// The track at a node, from f32.
    fn at(&self, node: i32) -> Motion;
}

/// A flight in the arithmetic of its kernel.
pub(crate) trait Flight {
    /// The flight at a node, counted from phase 0 of the turn of launch.
    ///
    /// Near an impact it has the kernel's full precision. A height of 2 or -2 may replace any
    /// beyond.
    fn local(&self, node: i32) -> Local;
    /// Flight time in rad below which the form divided by the flight time keeps more digits than a
    /// node.
    const MAX_SHORT_FLIGHT: f32;
    /// Gap over a hump that is within rounding: constant part, and part per rad of flight.
    const GAP_ROUNDING: f32;
    const GAP_ROUNDING_PER_RADIAN: f32;
    /// Rounding of the pull.
    const PULL_ROUNDING: f32;
    /// Node at which an approach begins, and the offset in rad.
    #[inline(always)]
    fn node_of(phase: u32, x: f32) -> (i32, f32) {
        node_of(phase, x)
    }
    /// Longest last step of an approach, in rad.
    const MAX_LAST_STEP: f32;
    /// Arrival speed below which a graze may be within rounding.
    const MAX_GRAZING_SPEED: f32;
    /// Whether an approach ends at the impact, to the precision of the kernel.
    const APPROACH_IS_FINAL: bool;
    /// Last correction in rad that leaves an error within rounding, at an arrival speed of 1.
    const MAX_LAST_CORRECTION: f32;
}

/// A flight over a sine.
pub(crate) trait OverSine: Flight {
    /// Ballistic height minus k at `steps` after launch, for an f32 value `nearly` 0; k < 1.
    fn above_k(&self, steps: i64, nearly: f32) -> f32;
}

#[inline(always)]
pub(super) fn abs(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & 0x7fff_ffff)
}

#[inline(always)]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Square root of `x`, 0 for negative `x`.
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
pub(crate) fn node_from_near(phase: u32, x: f32) -> (i32, f32) {
    let first = ((phase >> 23) + 1) >> 1;
    let angle = phase.wrapping_sub(first << 24) as i32 as f32 * RADIANS_PER_STEP + x;
    let (jump, count) = nearest(angle * NODES_PER_RADIAN);
    (first as i32 + jump, angle - count * SPACING)
}

#[inline(always)]
pub(super) fn sine_cosine_at(node: i32) -> (f32, f32) {
    let [sine, cosine] = node::SINE_COSINE_SINGLE[(node & 255) as usize];
    (sine, cosine)
}
