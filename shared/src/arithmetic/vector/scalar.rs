//! One f64 as a register of one lane, for CPUs without wider ones.
//!
//! `max` and `min` return the second operand if one is NaN, as the instructions MAXPD and MINPD do.

use super::{Column, MAX_LANES, Vector};
use crate::arithmetic::{node, square_root, square_root_single};

impl Vector for f64 {
    type Mask = bool;

    const WIDTH: usize = 1;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        square_root(self)
    }
    #[inline(always)]
    fn rough_sqrt(self) -> Self {
        f64::from(square_root_single(self as f32))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::from_bits(self.to_bits() & (u64::MAX >> 1))
    }
    #[inline(always)]
    fn below(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    #[inline(always)]
    fn keep_where(self, mask: bool) -> Self {
        if mask { self } else { 0.0 }
    }
    #[inline(always)]
    fn bits(mask: bool) -> u32 {
        mask.into()
    }
    #[inline(always)]
    fn node(rounded: Self) -> (Self, Self) {
        let [sine, cosine] = node::SINE_COSINE_DOUBLE[index_of_node(rounded)];
        (sine, cosine)
    }
    #[inline(always)]
    fn within_turn(rounded: Self) -> (Self, Self) {
        let [high, low] = node::NODE_PHASES[index_of_node(rounded)];
        (high, low)
    }
    #[inline(always)]
    fn from_array([value, ..]: [f64; MAX_LANES]) -> Self {
        value
    }
    #[inline(always)]
    fn pick(column: &Column, numbers: [u8; MAX_LANES]) -> Self {
        column[usize::from(numbers[0])]
    }
    #[inline(always)]
    fn to_array(self) -> [f64; MAX_LANES] {
        let mut values = [0.0; MAX_LANES];
        values[0] = self;
        values
    }
}

/// Index of a node, from the low bits of a [`ROUNDING_OFFSET`](super::ROUNDING_OFFSET) sum.
#[inline(always)]
fn index_of_node(rounded: f64) -> usize {
    rounded.to_bits() as usize % node::COUNT
}
