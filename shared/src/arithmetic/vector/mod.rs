//! Number type of the kernels: one f64, or several in a SIMD register.
//!
//! A kernel written over [`Vector`] gives the same bits in each width. Every operation is the IEEE
//! operation of its lane, nothing is fused, and a condition is a mask per lane.

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
pub(crate) mod avx2;
pub(crate) mod queue;
mod scalar;
pub(crate) mod simd;

use core::f64::consts::TAU;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use super::node;

/// Adding it rounds a number below 2^51 to an integer, held in the low bits of the sum.
pub(crate) const ROUNDING_OFFSET: f64 = 6_755_399_441_055_744.0;

/// Bytes of a register of lane numbers: the largest number of lanes of a register.
pub(crate) const MAX_LANES: usize = 8;

pub(crate) const COLUMN_LANES: usize = 256;

/// One quantity of many orbits, indexed by eight bits.
pub(crate) type Column = [f64; COLUMN_LANES];

/// One or several f64 processed alike.
pub(crate) trait Vector:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// One condition per lane.
    type Mask: Copy
        + BitAnd<Output = Self::Mask>
        + BitOr<Output = Self::Mask>
        + Not<Output = Self::Mask>;

    /// Number of lanes, at most [`MAX_LANES`].
    const WIDTH: usize;

    fn splat(value: f64) -> Self;
    fn sqrt(self) -> Self;
    /// Square root in f32, in a third of the time: relative error 6e-8 within its range.
    fn rough_sqrt(self) -> Self;
    /// `self > other ? self : other`, so that a NaN gives `other`.
    fn max(self, other: Self) -> Self;
    /// `self < other ? self : other`, so that a NaN gives `other`.
    fn min(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// `self < other`; false for NaN.
    fn below(self, other: Self) -> Self::Mask;
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// `self` if the mask holds, else 0.
    fn keep_where(self, mask: Self::Mask) -> Self;
    /// The mask as one bit per lane.
    fn bits(mask: Self::Mask) -> u32;
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        Self::bits(mask) != 0
    }
    /// Sine and cosine at the node whose index is in the low bits of a [`ROUNDING_OFFSET`] sum.
    fn node(rounded: Self) -> (Self, Self);
    /// Phase of that node within its turn as a sum: its index times [`node::SPACING_HIGH`], and
    /// times [`node::SPACING_LOW`].
    fn within_turn(rounded: Self) -> (Self, Self);
    /// One value per lane, from the first on.
    fn from_array(values: [f64; MAX_LANES]) -> Self;
    /// Values of a column at the first of these indices.
    fn pick(column: &Column, numbers: [u8; MAX_LANES]) -> Self;
    /// Bytes at these positions.
    #[inline(always)]
    fn choose(bytes: [u8; MAX_LANES], places: u64) -> [u8; MAX_LANES] {
        places
            .to_le_bytes()
            .map(|place| bytes[usize::from(place) % MAX_LANES])
    }
    /// The lanes, followed by zeros.
    fn to_array(self) -> [f64; MAX_LANES];
}

/// Largest integer not above `x`, for |x| < 2^51.
#[inline(always)]
pub(crate) fn floor<V: Vector>(x: V) -> V {
    let rounder = V::splat(ROUNDING_OFFSET);
    let nearest = (x + rounder) - rounder;
    nearest - V::splat(1.0).keep_where(x.below(nearest))
}

#[derive(Clone, Copy)]
pub(crate) struct Node<V> {
    pub sine: V,
    pub cosine: V,
    /// Phase from the origin given to [`Node::near`] to the node, in rad.
    pub distance: V,
    /// [`ROUNDING_OFFSET`] sum with the index of the node.
    pub rounded: V,
}

impl<V: Vector> Node<V> {
    /// Node nearest to phase `origin + ahead`. Its distance from `origin` is exact to an ulp for up
    /// to 2^24 nodes (6 600 turns). The phase is reduced by an integer mask.
    #[inline(always)]
    pub fn near(origin: V, ahead: V) -> Self {
        let rounded = node_sum(origin + ahead);
        let count = rounded - V::splat(ROUNDING_OFFSET);
        let (sine, cosine) = V::node(rounded);
        Self {
            sine,
            cosine,
            distance: (count * V::splat(node::SPACING_HIGH) - origin)
                + count * V::splat(node::SPACING_LOW),
            rounded,
        }
    }

    /// Phase `offset` after the node, in 0..2 pi; `offset` is at most a node spacing.
    #[inline(always)]
    pub fn phase(&self, offset: V) -> V {
        let (high, low) = V::within_turn(self.rounded);
        let phase = high + (low + offset);
        let phase = phase + V::splat(TAU).keep_where(phase.below(V::splat(0.0)));
        // A phase just below zero would round up to a full turn.
        phase.min(V::splat(TAU.next_down()))
    }
}

/// The parts of sine and cosine `d` rad from a node.
#[derive(Clone, Copy)]
pub(crate) struct Arc<V> {
    pub sine: V,
    /// `1 - cos d`.
    pub versine: V,
    /// `d - sin d`.
    pub sagitta: V,
}

impl<V: Vector> Arc<V> {
    /// For |d| up to a node spacing; relative error 2e-14 for `sagitta`, 3e-16 for the others.
    #[inline(always)]
    pub fn new(d: V) -> Self {
        let z = d * d;
        let sagitta = d * z * (V::splat(1.0 / 6.0) - z * V::splat(1.0 / 120.0));
        Self {
            sine: d - sagitta,
            versine: z * V::splat(0.5)
                - (z * z) * (V::splat(1.0 / 24.0) - z * V::splat(1.0 / 720.0)),
            sagitta,
        }
    }
}

/// [`ROUNDING_OFFSET`] sum with the index of the node nearest to `phase`.
#[inline(always)]
fn node_sum<V: Vector>(phase: V) -> V {
    phase * V::splat(node::COUNT as f64 / TAU) + V::splat(ROUNDING_OFFSET)
}

/// Sine and cosine of `phase` in 0..2 pi; error at most 1.7e-16.
#[inline(always)]
pub(crate) fn sine_cosine<V: Vector>(phase: V) -> (V, V) {
    let rounded = node_sum(phase);
    let (sine, cosine) = V::node(rounded);
    let count = rounded - V::splat(ROUNDING_OFFSET);
    let arc = Arc::new(
        (phase - count * V::splat(node::SPACING_HIGH)) - count * V::splat(node::SPACING_LOW),
    );
    (
        sine + (cosine * arc.sine - sine * arc.versine),
        cosine - (sine * arc.sine + cosine * arc.versine),
    )
}
