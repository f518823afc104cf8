//! Scalar lane: the operations of a wider register on one f64.

use super::{Column, Lane, MAX_LANES};
use crate::arithmetic::{node, square_root, square_root_single};

pub(crate) use decision::Mask;

impl Lane for f64 {
    type Mask = Mask;

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
    fn below(self, other: Self) -> Mask {
        decision::below(self, other)
    }
    #[inline(always)]
    fn select(mask: Mask, yes: Self, no: Self) -> Self {
        decision::select(mask, yes, no)
    }
    #[inline(always)]
    fn keep_where(self, mask: Mask) -> Self {
        decision::keep(mask, self)
    }
    #[inline(always)]
    fn bits(mask: Mask) -> u32 {
        decision::bits(mask)
    }
    #[inline(always)]
    fn unpaired(self) -> Self {
        decision::unpaired(self)
    }
    #[inline(always)]
    fn node(rounded: Self) -> (Self, Self) {
        let [sine, cosine] = node::SINE_COSINE_DOUBLE[rounded.to_bits() as usize % node::COUNT];
        (sine.unpaired(), cosine.unpaired())
    }
    #[inline(always)]
    fn within_turn(rounded: Self) -> (Self, Self) {
        let [high, low] = node::NODE_PHASES[rounded.to_bits() as usize % node::COUNT];
        (high, low)
    }
    #[inline(always)]
    fn load(values: &[f64], at: usize) -> Self {
        values[at]
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

/// Conditions as all bits of a register set or clear. A choice by `bool` would compile to a branch
/// that CPUs cannot predict.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod decision {
    use core::arch::x86_64::*;
    use core::ops::{BitAnd, BitOr, Not};

    /// All bits of an f64, set if the condition holds.
    #[derive(Clone, Copy)]
    pub(crate) struct Mask(__m128d);

    impl BitAnd for Mask {
        type Output = Self;
        #[inline(always)]
        fn bitand(self, other: Self) -> Self {
            // SAFETY: every x86-64 has SSE2.
            Self(unsafe { _mm_and_pd(self.0, other.0) })
        }
    }

    impl BitOr for Mask {
        type Output = Self;
        #[inline(always)]
        fn bitor(self, other: Self) -> Self {
            // SAFETY: every x86-64 has SSE2.
            Self(unsafe { _mm_or_pd(self.0, other.0) })
        }
    }

    impl Not for Mask {
        type Output = Self;
        #[inline(always)]
        fn not(self) -> Self {
            // SAFETY: every x86-64 has SSE2.
            Self(unsafe { _mm_xor_pd(self.0, _mm_castsi128_pd(_mm_set1_epi64x(-1))) })
        }
    }

    #[inline(always)]
    pub(super) fn below(a: f64, b: f64) -> Mask {
        // SAFETY: every x86-64 has SSE2.
        Mask(unsafe { _mm_cmplt_sd(_mm_set_sd(a), _mm_set_sd(b)) })
    }

    #[inline(always)]
    pub(super) fn select(mask: Mask, yes: f64, no: f64) -> f64 {
        // SAFETY: every x86-64 has SSE2.
        unsafe {
            let (yes, no) = (_mm_set_sd(yes), _mm_set_sd(no));
            _mm_cvtsd_f64(_mm_or_pd(
                _mm_and_pd(mask.0, yes),
                _mm_andnot_pd(mask.0, no),
            ))
        }
    }

    #[inline(always)]
    pub(super) fn keep(mask: Mask, value: f64) -> f64 {
        // SAFETY: every x86-64 has SSE2.
        unsafe { _mm_cvtsd_f64(_mm_and_pd(mask.0, _mm_set_sd(value))) }
    }

    #[inline(always)]
    pub(super) fn unpaired(mut value: f64) -> f64 {
        // SAFETY: no instruction.
        unsafe {
            core::arch::asm!("/* {0} */", inout(xmm_reg) value, options(pure, nomem, nostack, preserves_flags));
        }
        value
    }

    #[inline(always)]
    pub(super) fn bits(mask: Mask) -> u32 {
        // SAFETY: every x86-64 has SSE2.
        unsafe { _mm_movemask_pd(mask.0) as u32 & 1 }
    }
}

#[cfg(not(target_arch = "x86_64"))]
mod decision {
    pub(crate) type Mask = bool;

    #[inline(always)]
    pub(super) fn below(a: f64, b: f64) -> Mask {
        a < b
    }

    #[inline(always)]
    pub(super) fn select(mask: Mask, yes: f64, no: f64) -> f64 {
        if mask { yes } else { no }
    }

    #[inline(always)]
    pub(super) fn keep(mask: Mask, value: f64) -> f64 {
        if mask { value } else { 0.0 }
    }

    #[inline(always)]
    pub(super) fn unpaired(value: f64) -> f64 {
        value
    }

    #[inline(always)]
    pub(super) fn bits(mask: Mask) -> u32 {
        mask.into()
    }
}
