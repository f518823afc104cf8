//! What a kernel computes with: one f64, or several side by side in a SIMD register.
//!
//! A kernel written over [`Lane`] gives the same bits in every width: each operation is the IEEE one of
//! its own lane, nothing is contracted, and a decision is a mask of that lane alone.

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
pub(crate) mod avx2;
pub(crate) mod queue;
#[allow(unsafe_code)]
pub(crate) mod simd;
mod single;
#[cfg(target_arch = "x86_64")]
pub(crate) mod twice;

use core::f64::consts::TAU;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use super::node;

/// Adding it to a number below 2^51 rounds that number to an integer, which then stands in the low bits.
pub(crate) const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// Lanes of the widest register, or two side by side.
pub(crate) const WIDEST: usize = 8;

/// Lanes of a column.
pub(crate) const COLUMN: usize = 256;

/// One quantity of many orbits; eight bits number them.
pub(crate) type Column = [f64; COLUMN];

/// One or several f64 that go through the same operations.
pub(crate) trait Lane:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Yes or no for each lane.
    type Mask: Copy
        + BitAnd<Output = Self::Mask>
        + BitOr<Output = Self::Mask>
        + Not<Output = Self::Mask>;

    /// Number of lanes, at most [`WIDEST`].
    const WIDTH: usize;

    /// The same number in every lane.
    fn splat(value: f64) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Square root in f32, of what f32 can hold: relative error 6e-8, in a third of the time.
    fn rough_sqrt(self) -> Self;
    /// `self > other ? self : other`, so that a NaN gives `other`.
    fn max(self, other: Self) -> Self;
    /// `self < other ? self : other`, so that a NaN gives `other`.
    fn min(self, other: Self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// `self < other`; no for a NaN.
    fn below(self, other: Self) -> Self::Mask;
    /// `yes` where the mask holds, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// `self` where the mask holds, else 0.
    fn only(self, mask: Self::Mask) -> Self;
    /// The mask, one bit for each lane.
    fn bits(mask: Self::Mask) -> u32;
    /// Whether the mask holds in any lane.
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        Self::bits(mask) != 0
    }
    /// The same number. A lone f64 is hidden from the compiler's search for pairs of operations: packing
    /// these kernels' pairs into half-filled registers costs more than it saves.
    #[inline(always)]
    fn lone(self) -> Self {
        self
    }
    /// Sine and cosine at the node whose number stands in the low bits of a [`ROUNDER`] sum.
    fn node(rounded: Self) -> (Self, Self);
    /// [`Lane::node`] of the sums that stand from number `at` on.
    #[inline(always)]
    fn node_at(rounded: &[f64], at: usize) -> (Self, Self) {
        Self::node(Self::load(rounded, at))
    }
    /// Where two [`ROUNDER`] sums name the same node of a turn.
    fn is_same_node(rounded: Self, other: Self) -> Self::Mask;
    /// The phase of that node within its turn, as a sum: its number times [`node::SPACING_HIGH`], and
    /// times [`node::SPACING_LOW`].
    fn within_turn(rounded: Self) -> (Self, Self);
    /// Yes where the bit of the lane is set.
    fn mask(bits: u32) -> Self::Mask;
    /// As many of the values as there are lanes, from number `at` on.
    fn load(values: &[f64], at: usize) -> Self;
    /// Puts the lanes where [`Lane::load`] had them from.
    fn store(self, values: &mut [f64], at: usize);
    /// Puts those lanes that the mask holds for where [`Lane::load`] had them from.
    #[inline(always)]
    fn store_only(self, mask: Self::Mask, values: &mut [f64], at: usize) {
        Self::select(mask, self, Self::load(values, at)).store(values, at);
    }
    /// The first of these numbers of a column.
    fn pick(column: &Column, numbers: [u8; WIDEST]) -> Self;
    /// The bytes at these places, a byte each.
    #[inline(always)]
    fn choose(bytes: [u8; WIDEST], places: u64) -> [u8; WIDEST] {
        places
            .to_le_bytes()
            .map(|place| bytes[usize::from(place) % WIDEST])
    }
    /// The lanes, followed by 0.
    fn to_array(self) -> [f64; WIDEST];
}

/// The largest integer not above `x`, for |x| < 2^51.
#[inline(always)]
pub(crate) fn floor<L: Lane>(x: L) -> L {
    let rounder = L::splat(ROUNDER);
    let nearest = (x + rounder) - rounder;
    nearest - L::splat(1.0).only(x.below(nearest))
}

/// The track at a node of the table.
#[derive(Clone, Copy)]
pub(crate) struct Node<L> {
    /// Sine of the node.
    pub sine: L,
    /// Cosine of the node.
    pub cosine: L,
    /// How far the node lies ahead of the origin that was given to [`Node::near`], in rad.
    pub distance: L,
    /// The [`ROUNDER`] sum that names the node.
    pub rounded: L,
}

impl<L: Lane> Node<L> {
    /// The node nearest to phase `origin + ahead`.
    ///
    /// Its distance from `origin` is exact to an ulp for up to 2^24 nodes (6 600 turns): the reduction of
    /// the phase is an integer mask.
    #[inline(always)]
    pub fn near(origin: L, ahead: L) -> Self {
        let rounded = name(origin + ahead);
        let count = rounded - L::splat(ROUNDER);
        let (sine, cosine) = L::node(rounded);
        Self {
            sine,
            cosine,
            distance: (count * L::splat(node::SPACING_HIGH) - origin)
                + count * L::splat(node::SPACING_LOW),
            rounded,
        }
    }

    /// [`sine_cosine`] of a phase in 0..2 pi to which this node is most often the nearest: then its sine and
    /// cosine need not be fetched. Lanes that `which` does not hold for are not asked, and get anything.
    #[inline(always)]
    pub fn sine_cosine(&self, phase: L, which: L::Mask) -> (L, L) {
        let rounded = name(phase);
        let same = L::is_same_node(rounded, self.rounded);
        if L::any(!same & which) {
            between(phase, rounded, L::node(rounded))
        } else {
            between(phase, rounded, (self.sine, self.cosine))
        }
    }

    /// The phase `offset` past the node, in 0..2 pi; `offset` at most a node spacing.
    #[inline(always)]
    pub fn phase(&self, offset: L) -> L {
        let (high, low) = L::within_turn(self.rounded);
        let phase = high + (low + offset);
        let phase = phase + L::splat(TAU).only(phase.below(L::splat(0.0)));
        // A hair below zero rounds up to the whole turn.
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
    /// For |d| up to a node spacing; relative error 2e-14 of `sagitta`, 3e-16 of the others.
    #[inline(always)]
    pub fn of(d: L) -> Self {
        let z = d * d;
        let sagitta = (d * z * (L::splat(1.0 / 6.0) - z * L::splat(1.0 / 120.0))).lone();
        Self {
            sine: (d - sagitta).lone(),
            versine: (z * L::splat(0.5)
                - (z * z) * (L::splat(1.0 / 24.0) - z * L::splat(1.0 / 720.0)))
            .lone(),
            sagitta,
        }
    }
}

/// Sine and cosine of `phase` in 0..2 pi; error at most 1.7e-16.
#[inline(always)]
pub(crate) fn sine_cosine<L: Lane>(phase: L) -> (L, L) {
    let rounded = name(phase);
    between(phase, rounded, L::node(rounded))
}

/// The [`ROUNDER`] sum that names the node nearest to `phase`.
#[inline(always)]
pub(crate) fn name<L: Lane>(phase: L) -> L {
    phase * L::splat(node::COUNT as f64 / TAU) + L::splat(ROUNDER)
}

/// Sine and cosine of `phase` in 0..2 pi from those of the nearest node.
#[inline(always)]
pub(crate) fn between<L: Lane>(phase: L, rounded: L, (sine, cosine): (L, L)) -> (L, L) {
    let count = rounded - L::splat(ROUNDER);
    let arc = Arc::of(
        (phase - count * L::splat(node::SPACING_HIGH)) - count * L::splat(node::SPACING_LOW),
    );
    (
        (sine + (cosine * arc.sine - sine * arc.versine)).lone(),
        (cosine - (sine * arc.sine + cosine * arc.versine)).lone(),
    )
}
