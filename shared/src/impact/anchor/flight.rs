//! A launch and its flight in f32, as the search asks a kernel for them.

use crate::arithmetic::{Phase, node, square_root_single};

/// Distance of two nodes in rad.
pub(super) const SPACING: f32 = node::SPACING as f32;
pub(super) const NODES_PER_RADIAN: f32 = (1.0 / node::SPACING) as f32;
pub(super) const RADIANS_PER_STEP: f32 = Phase::RADIANS_PER_STEP as f32;
pub(super) const STEPS_PER_RADIAN: f32 = Phase::STEPS_PER_RADIAN as f32;
/// 1.5 * 2^23: adding it rounds an f32 below 2^22 to an integer, which then stands in the low bits.
const ROUND: f32 = 12_582_912.0;

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

/// Height and slope of the flight above the track at a node, with the track's push and what it becomes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Local {
    pub height: f32,
    pub slope: f32,
    /// `A = -S''` there, its slope and its downward curvature: for a sine its sine, cosine and sine.
    pub push: f32,
    pub surge: f32,
    pub bend: f32,
}

/// What the track does at a node.
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

/// A track as steps on nodes ask for it.
pub(super) trait Track {
    /// k, half of it and its inverse.
    fn k(&self) -> f32;
    fn half_k(&self) -> f32;
    fn inverse(&self) -> f32;
    /// The least square of the speed at height 0 of a tall flight.
    fn tall(&self) -> f32;
    /// The track at a node, from f32.
    fn at(&self, node: i32) -> Motion;
}

/// A flight as its kernel knows it.
pub(crate) trait Flight {
    /// The flight at a node, counted from phase 0 of the turn of launch; near an impact to the full
    /// precision of the kernel. A height of 2 or -2 may stand for any beyond.
    fn local(&self, node: i32) -> Local;
    /// Flights below this many rad keep more digits in the deflated form than on a node.
    const SHORT: f32;
    /// A gap over a hump below this, and what is added to it for each rad of flight, is within rounding.
    const ROUNDING: f32;
    const DRIFT: f32;
    /// Rounding of the pull.
    const PULL: f32;
    /// Where an approach begins.
    #[inline(always)]
    fn node_of(phase: u32, x: f32) -> (i32, f32) {
        node_of(phase, x)
    }
    /// The step at which an approach ends, in rad.
    const LEAP: f32;
    /// An arrival at less than this speed may be a graze within rounding.
    const SLOW: f32;
    /// Whether the end of an approach is the impact, as near as the kernel can tell.
    const FINAL: bool;
    /// The last correction of a settled impact that leaves an error within rounding, in rad at an arrival
    /// speed of 1.
    const NEAR: f32;
}

/// A flight over a sine.
pub(crate) trait OverSine: Flight {
    /// Ballistic height over k at `steps` after launch, where f32 makes it `nearly` 0; k < 1.
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

/// Square root of what is positive of `x`.
#[inline(always)]
pub(super) fn root(x: f32) -> f32 {
    if x > 0.0 { square_root_single(x) } else { 0.0 }
}

/// Nearest integer to `x`, |x| < 2^22, as integer and as f32.
#[inline(always)]
pub(super) fn nearest(x: f32) -> (i32, f32) {
    let shifted = x + ROUND;
    (
        (shifted.to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32),
        shifted - ROUND,
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
    let [sine, cosine] = node::SINGLE[(node & 255) as usize];
    (sine, cosine)
}
