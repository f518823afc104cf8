//! Vectors of eight f64 in pairs of AVX2 registers.
//!
//! A flight is a chain of dependent operations. Two registers that take turns need two thirds of
//! the time of one after the other.
//!
//! Its methods are sound only on a CPU with AVX2, which nothing here checks. Only `batch` names the
//! type, in functions that are called after [`Simd`](super::simd::Simd) has found AVX2.

use core::arch::x86_64::*;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use super::{Column, MAX_LANES, ROUNDING_OFFSET, Vector};
use crate::arithmetic::node;

#[derive(Clone, Copy)]
pub(crate) struct Avx2([__m256d; 2]);

/// Eight conditions: all bits of an f64, set if it holds.
#[derive(Clone, Copy)]
pub(crate) struct Mask([__m256d; 2]);

/// An expression for each of the two registers, by its index. A closure would not be inlined into
/// a function with AVX2.
macro_rules! both {
    ($n:ident => $each:expr) => {{
        // SAFETY: the CPU has AVX2, see the module.
        unsafe {
            [
                {
                    let $n = 0;
                    $each
                },
                {
                    let $n = 1;
                    $each
                },
            ]
        }
    }};
}

macro_rules! operators {
    ($($type:ident $operator:ident $method:ident $intrinsic:ident,)*) => {$(
        impl $operator for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(both!(n => $intrinsic(self.0[n], other.0[n])))
            }
        }
    )*};
}

operators! {
    Avx2 Add add _mm256_add_pd,
    Avx2 Sub sub _mm256_sub_pd,
    Avx2 Mul mul _mm256_mul_pd,
    Avx2 Div div _mm256_div_pd,
    Mask BitAnd bitand _mm256_and_pd,
    Mask BitOr bitor _mm256_or_pd,
}

impl Neg for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(both!(n => _mm256_xor_pd(self.0[n], _mm256_set1_pd(-0.0))))
    }
}

impl Not for Mask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        let all = both!(_n => _mm256_castsi256_pd(_mm256_set1_epi64x(-1)));
        Self(both!(n => _mm256_xor_pd(self.0[n], all[n])))
    }
}

impl Avx2 {
    /// Index of the node in the low bits of each lane.
    #[inline(always)]
    fn index(self) -> [__m256i; 2] {
        both!(n => _mm256_and_si256(
            _mm256_castpd_si256(self.0[n]),
            _mm256_set1_epi64x(node::COUNT as i64 - 1),
        ))
    }
}

impl Vector for Avx2 {
    type Mask = Mask;

    const WIDTH: usize = 8;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self(both!(_n => _mm256_set1_pd(value)))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(both!(n => _mm256_sqrt_pd(self.0[n])))
    }
    #[inline(always)]
    fn rough_sqrt(self) -> Self {
        Self(both!(n => _mm256_cvtps_pd(_mm_sqrt_ps(_mm256_cvtpd_ps(self.0[n])))))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(both!(n => _mm256_max_pd(self.0[n], other.0[n])))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(both!(n => _mm256_min_pd(self.0[n], other.0[n])))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(both!(n => _mm256_andnot_pd(_mm256_set1_pd(-0.0), self.0[n])))
    }
    #[inline(always)]
    fn below(self, other: Self) -> Mask {
        Mask(both!(n => _mm256_cmp_pd::<_CMP_LT_OQ>(self.0[n], other.0[n])))
    }
    #[inline(always)]
    fn select(mask: Mask, yes: Self, no: Self) -> Self {
        Self(both!(n => _mm256_blendv_pd(no.0[n], yes.0[n], mask.0[n])))
    }
    #[inline(always)]
    fn keep_where(self, mask: Mask) -> Self {
        Self(both!(n => _mm256_and_pd(self.0[n], mask.0[n])))
    }
    #[inline(always)]
    fn bits(mask: Mask) -> u32 {
        let [low, high] = both!(n => _mm256_movemask_pd(mask.0[n]) as u32);
        low | high << 4
    }
    #[inline(always)]
    fn node(rounded: Self) -> (Self, Self) {
        let index = rounded.index();
        // SAFETY: an index is below the table's length.
        let pairs = both!(n => {
            let (low, high) = (
                _mm256_castsi256_si128(index[n]),
                _mm256_extracti128_si256::<1>(index[n]),
            );
            let table = node::SINE_COSINE_DOUBLE.as_ptr();
            let a = _mm_loadu_pd(table.add(_mm_cvtsi128_si64(low) as usize).cast());
            let b = _mm_loadu_pd(table.add(_mm_extract_epi64::<1>(low) as usize).cast());
            let c = _mm_loadu_pd(table.add(_mm_cvtsi128_si64(high) as usize).cast());
            let d = _mm_loadu_pd(table.add(_mm_extract_epi64::<1>(high) as usize).cast());
            let ac = _mm256_insertf128_pd::<1>(_mm256_castpd128_pd256(a), c);
            let bd = _mm256_insertf128_pd::<1>(_mm256_castpd128_pd256(b), d);
            (_mm256_unpacklo_pd(ac, bd), _mm256_unpackhi_pd(ac, bd))
        });
        let [(sine, cosine), (more_sine, more_cosine)] = pairs;
        (Self([sine, more_sine]), Self([cosine, more_cosine]))
    }
    #[inline(always)]
    fn within_turn(rounded: Self) -> (Self, Self) {
        // An integer below 2^52 with the exponent bits of 2^52 is 2^52 plus itself.
        const INTEGER_OFFSET: f64 = 4_503_599_627_370_496.0;
        const _: () = assert!(ROUNDING_OFFSET > INTEGER_OFFSET);
        let index = rounded.index();
        let count = Self(both!(n => {
            let lift = _mm256_set1_pd(INTEGER_OFFSET);
            let lifted = _mm256_or_si256(index[n], _mm256_castpd_si256(lift));
            _mm256_sub_pd(_mm256_castsi256_pd(lifted), lift)
        }));
        (
            count * Self::splat(node::SPACING_HIGH),
            count * Self::splat(node::SPACING_LOW),
        )
    }
    #[inline(always)]
    fn from_array(values: [f64; MAX_LANES]) -> Self {
        // SAFETY: the array has both registers.
        Self(both!(n => _mm256_loadu_pd(values.as_ptr().add(4 * n))))
    }
    #[inline(always)]
    fn pick(column: &Column, numbers: [u8; MAX_LANES]) -> Self {
        let mut values = [0.0; MAX_LANES];
        for (value, number) in values.iter_mut().zip(numbers) {
            *value = column[usize::from(number)];
        }
        let [a, b, c, d, e, f, g, h] = values;
        // SAFETY: the CPU has AVX2, see the module.
        Self(unsafe { [_mm256_setr_pd(a, b, c, d), _mm256_setr_pd(e, f, g, h)] })
    }
    #[inline(always)]
    fn choose(bytes: [u8; MAX_LANES], places: u64) -> [u8; MAX_LANES] {
        // SAFETY: the CPU has AVX2, see the module.
        unsafe {
            let bytes = _mm_cvtsi64_si128(i64::from_le_bytes(bytes));
            let chosen = _mm_shuffle_epi8(bytes, _mm_cvtsi64_si128(places as i64));
            _mm_cvtsi128_si64(chosen).to_le_bytes()
        }
    }
    #[inline(always)]
    fn to_array(self) -> [f64; MAX_LANES] {
        let mut values = [0.0; MAX_LANES];
        // SAFETY: the CPU has AVX2, see the module; the array has both registers.
        unsafe {
            _mm256_storeu_pd(values.as_mut_ptr(), self.0[0]);
            _mm256_storeu_pd(values.as_mut_ptr().add(4), self.0[1]);
        }
        values
    }
}
