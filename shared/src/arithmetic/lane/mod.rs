//! Number type of the kernels: one f64, or several in a SIMD register.
//!
//! A kernel written over [`Lane`] gives the same bits in each width. Every operation is the IEEE
//! operation of its lane, nothing is fused, and a condition is a mask per lane.

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
pub(crate) mod avx2;
pub(crate) mod queue;
pub(crate) mod simd;
mod single;

use core::f64::consts::TAU;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use super::node;

/// Constant whose addition rounds a number below 2^51 to an integer, held in the low bits of the
/// sum.
pub(crate) const ROUNDING_OFFSET: f64 = 6_755_399_441_055_744.0;

/// Bytes of a register of lane numbers; as many lanes as a register may have.
pub(crate) const MAX_LANES: usize = 8;

/// Number of lanes of a column.
pub(crate) const COLUMN_LANES: usize = 256;

/// One quantity of many orbits, indexed by eight bits.
pub(crate) type Column = [f64; COLUMN_LANES];

/// One or several f64 processed alike.
pub(crate) trait Lane:
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

    /// The same number in every lane.
    fn splat(value: f64) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Square root in f32, for numbers within its range: relative error 6e-8, in a third of the
    /// time.
    fn rough_sqrt(self) -> Self;
    /// `self > other ? self : other`, so that a NaN gives `other`.
    fn max(self, other: Self) -> Self;
    /// `self < other ? self : other`, so that a NaN gives `other`.
    fn min(self, other: Self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// `self < other`; false for NaN.
    fn below(self, other: Self) -> Self::Mask;
    /// `yes` where the mask holds, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// `self` where the mask holds, else 0.
    fn keep_where(self, mask: Self::Mask) -> Self;
    /// The mask as one bit per lane.
    fn bits(mask: Self::Mask) -> u32;
    /// Whether the mask holds in any lane.
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        Self::bits(mask) != 0
    }
    /// Sine and cosine at the node whose index is in the low bits of a [`ROUNDING_OFFSET`] sum.
    fn node(rounded: Self) -> (Self, Self);
    /// Phase of that node within its turn as a sum: its index times [`node::SPACING_HIGH`], and
    /// times [`node::SPACING_LOW`].
    fn within_turn(rounded: Self) -> (Self, Self);
    /// Loads one value per lane from index `at` on.
    fn load(values: &[f64], at: usize) -> Self;
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
pub(crate) fn floor<L: Lane>(x: L) -> L {
    let rounder = L::splat(ROUNDING_OFFSET);
    let nearest = (x + rounder) - rounder;
    nearest - L::splat(1.0).keep_where(x.below(nearest))
}

/// A node of the table.
#[derive(Clone, Copy)]
pub(crate) struct Node<L> {
    /// Sine of the node.
    pub sine: L,
    /// Cosine of the node.
    pub cosine: L,
    /// Phase from the origin given to [`Node::near`] to the node, in rad.
    pub distance: L,
    /// [`ROUNDING_OFFSET`] sum with the index of the node.
    pub rounded: L,
}

impl<L: Lane> Node<L> {
    /// Node nearest to phase `origin + ahead`.
    ///
    /// Its distance from `origin` is exact to an ulp for up to 2^24 nodes (6 600 turns). The phase
    /// is reduced by an integer mask.
    #[inline(always)]
    pub fn near(origin: L, ahead: L) -> Self {
        let rounded = node_sum(origin + ahead);
        let count = rounded - L::splat(ROUNDING_OFFSET);
        let (sine, cosine) = L::node(rounded);
        Self {
            sine,
            cosine,
            distance: (count * L::splat(node::SPACING_HIGH) - origin)
                + count * L::splat(node::SPACING_LOW),
            rounded,
        }
    }

    /// Phase `offset` after the node, in 0..2 pi; `offset` is at most a node spacing.
    #[inline(always)]
    pub fn phase(&self, offset: L) -> L {
        let (high, low) = L::within_turn(self.rounded);
        let phase = high + (low + offset);
        let phase = phase + L::splat(TAU).keep_where(phase.below(L::splat(0.0)));
        // A phase just below zero would round up to a full turn.
        phase.min(L::splat(TAU.next_down()))
    }
}

/// The parts of sine and cosine `d` rad from a node.
#[derive(Clone, Copy)]
pub(crate) struct Arc<L> {
    /// `sin d`.
    pub sine: L,
    /// `1 - cos d`.
    pub versine: L,
    /// `d - sin d`.
    pub sagitta: L,
}

impl<L: Lane> Arc<L> {
    /// For |d| up to a node spacing; relative error 2e-14 for `sagitta`, 3e-16 for the others.
    #[inline(always)]
    pub fn new(d: L) -> Self {
        let z = d * d;
        let sagitta = d * z * (L::splat(1.0 / 6.0) - z * L::splat(1.0 / 120.0));
        Self {
            sine: d - sagitta,
            versine: z * L::splat(0.5)
                - (z * z) * (L::splat(1.0 / 24.0) - z * L::splat(1.0 / 720.0)),
            sagitta,
        }
    }
}

/// [`ROUNDING_OFFSET`] sum with the index of the node nearest to `phase`.
#[inline(always)]
fn node_sum<L: Lane>(phase: L) -> L {
    phase * L::splat(node::COUNT as f64 / TAU) + L::splat(ROUNDING_OFFSET)
}

/// Sine and cosine of `phase` in 0..2 pi; error at most 1.7e-16.
#[inline(always)]
pub(crate) fn sine_cosine<L: Lane>(phase: L) -> (L, L) {
    let rounded = node_sum(phase);
    let (sine, cosine) = L::node(rounded);
    let count = rounded - L::splat(ROUNDING_OFFSET);
    let arc = Arc::new(
        (phase - count * L::splat(node::SPACING_HIGH)) - count * L::splat(node::SPACING_LOW),
    );
    (
        sine + (cosine * arc.sine - sine * arc.versine),
        cosine - (sine * arc.sine + cosine * arc.versine),
    )
}
