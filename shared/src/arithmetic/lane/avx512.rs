//! Lanes of eight f64 in AVX-512 registers.
//!
//! The methods are sound only on a CPU with AVX-512 F and DQ, which is not checked here. Only
//! `batch` and `tones/batch` use the type, in functions called after a check by
//! [`Simd`](super::simd::Simd).

use core::arch::x86_64::*;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use super::avx2::{apart, pair};
use super::{Column, Lane, WIDEST};
use crate::arithmetic::node;

/// Eight f64.
#[derive(Clone, Copy)]
pub(crate) struct Avx512(__m512d);

/// Eight conditions, one bit each.
#[derive(Clone, Copy)]
pub(crate) struct Mask(__mmask8);

macro_rules! operators {
    ($($operator:ident $method:ident $intrinsic:ident,)*) => {$(
        impl $operator for Avx512 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: the CPU has AVX-512, see the module.
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    )*};
}

operators! {
    Add add _mm512_add_pd,
    Sub sub _mm512_sub_pd,
    Mul mul _mm512_mul_pd,
    Div div _mm512_div_pd,
}

impl Neg for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_xor_pd(self.0, _mm512_set1_pd(-0.0)) })
    }
}

impl BitAnd for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOr for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Not for Mask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl Avx512 {
    /// Index of the node in the low bits of each lane.
    #[inline(always)]
    fn index(self) -> __m512i {
        // SAFETY: the CPU has AVX-512, see the module.
        unsafe {
            _mm512_and_si512(
                _mm512_castpd_si512(self.0),
                _mm512_set1_epi64(node::COUNT as i64 - 1),
            )
        }
    }
}

impl Lane for Avx512 {
    type Mask = Mask;

    const WIDTH: usize = 8;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_set1_pd(value) })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_sqrt_pd(self.0) })
    }
    #[inline(always)]
    fn rough_sqrt(self) -> Self {
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_cvtps_pd(_mm256_sqrt_ps(_mm512_cvtpd_ps(self.0))) })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_max_pd(self.0, other.0) })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_min_pd(self.0, other.0) })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_andnot_pd(_mm512_set1_pd(-0.0), self.0) })
    }
    #[inline(always)]
    fn below(self, other: Self) -> Mask {
        // SAFETY: the CPU has AVX-512, see the module.
        Mask(unsafe { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(self.0, other.0) })
    }
    #[inline(always)]
    fn select(mask: Mask, yes: Self, no: Self) -> Self {
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_mask_blend_pd(mask.0, no.0, yes.0) })
    }
    #[inline(always)]
    fn only(self, mask: Mask) -> Self {
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_maskz_mov_pd(mask.0, self.0) })
    }
    #[inline(always)]
    fn bits(mask: Mask) -> u32 {
        mask.0.into()
    }
    #[inline(always)]
    fn node(rounded: Self) -> (Self, Self) {
        // Plain loads: the gather instruction takes several times longer on some CPUs.
        Self::node_at(&rounded.to_array(), 0)
    }
    #[inline(always)]
    fn node_at(rounded: &[f64], at: usize) -> (Self, Self) {
        let [a, b, c, d, e, f, g, h] = *apart(&rounded[at..at + Self::WIDTH]);
        let (even, odd) = (four([a, c, e, g]), four([b, d, f, h]));
        // SAFETY: the CPU has AVX-512, see the module.
        unsafe {
            (
                Self(_mm512_unpacklo_pd(even, odd)),
                Self(_mm512_unpackhi_pd(even, odd)),
            )
        }
    }
    #[inline(always)]
    fn is_same_node(rounded: Self, other: Self) -> Mask {
        // SAFETY: the CPU has AVX-512, see the module.
        Mask(unsafe { _mm512_cmpeq_epi64_mask(rounded.index(), other.index()) })
    }
    #[inline(always)]
    fn within_turn(rounded: Self) -> (Self, Self) {
        // SAFETY: the CPU has AVX-512, see the module.
        let count = Self(unsafe { _mm512_cvtepi64_pd(rounded.index()) });
        (
            count * Self::splat(node::SPACING_HIGH),
            count * Self::splat(node::SPACING_LOW),
        )
    }
    #[inline(always)]
    fn mask(bits: u32) -> Mask {
        Mask(bits as __mmask8)
    }
    #[inline(always)]
    fn load(values: &[f64], at: usize) -> Self {
        let values = &values[at..at + Self::WIDTH];
        // SAFETY: the CPU has AVX-512, see the module; the slice is as long as a register.
        Self(unsafe { _mm512_loadu_pd(values.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, values: &mut [f64], at: usize) {
        let values = &mut values[at..at + Self::WIDTH];
        // SAFETY: the CPU has AVX-512, see the module; the slice is as long as a register.
        unsafe { _mm512_storeu_pd(values.as_mut_ptr(), self.0) };
    }
    #[inline(always)]
    fn store_only(self, mask: Mask, values: &mut [f64], at: usize) {
        let values = &mut values[at..at + Self::WIDTH];
        // SAFETY: the CPU has AVX-512, see the module; the slice is as long as a register.
        unsafe { _mm512_mask_storeu_pd(values.as_mut_ptr(), mask.0, self.0) };
    }
    #[inline(always)]
    fn pick(column: &Column, numbers: [u8; WIDEST]) -> Self {
        let mut values = [0.0; 8];
        for (value, number) in values.iter_mut().zip(numbers) {
            *value = column[usize::from(number)];
        }
        let [a, b, c, d, e, f, g, h] = values;
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_setr_pd(a, b, c, d, e, f, g, h) })
    }
    #[inline(always)]
    fn choose(bytes: [u8; WIDEST], places: u64) -> [u8; WIDEST] {
        // SAFETY: the CPU has AVX-512, see the module.
        unsafe {
            let bytes = _mm_cvtsi64_si128(i64::from_le_bytes(bytes));
            let chosen = _mm_shuffle_epi8(bytes, _mm_cvtsi64_si128(places as i64));
            _mm_cvtsi128_si64(chosen).to_le_bytes()
        }
    }
    #[inline(always)]
    fn to_array(self) -> [f64; WIDEST] {
        let mut values = [0.0; WIDEST];
        // SAFETY: the CPU has AVX-512, see the module; the array is as long as a register.
        unsafe { _mm512_storeu_pd(values.as_mut_ptr(), self.0) };
        values
    }
}

/// Sine and cosine of the nodes of these [`ROUNDER`](super::ROUNDER) sums.
#[inline(always)]
fn four([a, b, c, d]: [f64; 4]) -> __m512d {
    // SAFETY: the CPU has AVX-512, see the module; a pair is as long as the loaded vector.
    unsafe {
        let a = _mm_loadu_pd(pair(a));
        let low = _mm256_insertf128_pd::<1>(_mm256_castpd128_pd256(a), _mm_loadu_pd(pair(b)));
        let all = _mm512_castpd256_pd512(low);
        let all = _mm512_insertf64x2::<2>(all, _mm_loadu_pd(pair(c)));
        _mm512_insertf64x2::<3>(all, _mm_loadu_pd(pair(d)))
    }
}
