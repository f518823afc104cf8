//! Eight f64 side by side: AVX-512.
//!
//! No value of this type exists unless the CPU has AVX-512 F and DQ: the only way in is [`super::simd`],
//! which asks.

use core::arch::x86_64::*;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use super::{Lane, WIDEST, avx2};
use crate::arithmetic::node;

/// Eight f64.
#[derive(Clone, Copy)]
pub(crate) struct Avx512(__m512d);

/// Eight decisions, one bit each.
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
    /// The number of the node in the low bits of each lane.
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

    /// Two halves of four f64 each.
    #[inline(always)]
    fn halves(self) -> [__m256d; 2] {
        // SAFETY: the CPU has AVX-512, see the module.
        unsafe {
            [
                _mm512_castpd512_pd256(self.0),
                _mm512_extractf64x4_pd::<1>(self.0),
            ]
        }
    }

    /// The register of two halves.
    #[inline(always)]
    fn join(low: __m256d, high: __m256d) -> Self {
        // SAFETY: the CPU has AVX-512, see the module.
        Self(unsafe { _mm512_insertf64x4::<1>(_mm512_castpd256_pd512(low), high) })
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
        // Plain loads: the gather instruction takes several times as long on some CPUs.
        let index = rounded.index();
        // SAFETY: the CPU has AVX-512, see the module.
        let (low, high) = unsafe {
            (
                _mm512_castsi512_si256(index),
                _mm512_extracti64x4_epi64::<1>(index),
            )
        };
        let (low, high) = (avx2::fetch(low), avx2::fetch(high));
        (Self::join(low.0, high.0), Self::join(low.1, high.1))
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
    fn gather([a, b, c, d, e, f, g, h]: [&[f64; 4]; WIDEST]) -> [Self; 4] {
        let low = avx2::load_transposed([a, b, c, d]);
        let high = avx2::load_transposed([e, f, g, h]);
        [
            Self::join(low[0], high[0]),
            Self::join(low[1], high[1]),
            Self::join(low[2], high[2]),
            Self::join(low[3], high[3]),
        ]
    }
    #[inline(always)]
    fn rows([a, b, c, d]: [Self; 4]) -> [[f64; 4]; WIDEST] {
        let mut rows = [[0.0; 4]; WIDEST];
        let (a, b, c, d) = (a.halves(), b.halves(), c.halves(), d.halves());
        avx2::store_transposed([a[0], b[0], c[0], d[0]], &mut rows[..4]);
        avx2::store_transposed([a[1], b[1], c[1], d[1]], &mut rows[4..]);
        rows
    }
    #[inline(always)]
    fn from_array(values: [f64; WIDEST]) -> Self {
        // SAFETY: the CPU has AVX-512, see the module; the array is as long as a register.
        Self(unsafe { _mm512_loadu_pd(values.as_ptr()) })
    }
    #[inline(always)]
    fn to_array(self) -> [f64; WIDEST] {
        let mut values = [0.0; WIDEST];
        // SAFETY: the CPU has AVX-512, see the module; the array is as long as a register.
        unsafe { _mm512_storeu_pd(values.as_mut_ptr(), self.0) };
        values
    }
}
