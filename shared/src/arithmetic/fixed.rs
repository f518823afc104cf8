//! Fixed-point numbers, with velocities of the kernels without f64.

use core::ops::{Add, Neg, Sub};

/// A number in steps of 2^-`F`, held in `T`. The compiler checks the binary places of each sum,
/// product and quotient and derives the shifts. The code states the arithmetic only; the
/// instructions equal hand-written ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Fixed<const F: u32, T = i32>(pub T);

/// Number of steps of 2^-`places` in 1.
const fn steps(places: u32) -> f64 {
    (1_u64 << places) as f64
}

macro_rules! signed {
    ($($bits:ty)+) => {$(
        impl<const F: u32> Fixed<F, $bits> {
            /// The same number in steps of 2^-`G`, rounded down.
            #[inline(always)]
            pub const fn to<const G: u32>(self) -> Fixed<G, $bits> {
                Fixed(if G < F { self.0 >> (F - G) } else { self.0 << (G - F) })
            }

            /// The same bits in steps of 2^-`G`: the number times `2^(F - G)`.
            #[inline(always)]
            pub const fn scaled<const G: u32>(self) -> Fixed<G, $bits> {
                Fixed(self.0)
            }
        }

        impl<const F: u32> Add for Fixed<F, $bits> {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                Self(self.0 + other.0)
            }
        }

        impl<const F: u32> Sub for Fixed<F, $bits> {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                Self(self.0 - other.0)
            }
        }

        impl<const F: u32> Neg for Fixed<F, $bits> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self(-self.0)
            }
        }
    )+};
}

macro_rules! constants {
    ($($bits:ty)+) => {$(
        impl<const F: u32> Fixed<F, $bits> {
            pub const fn from_constant(value: f64) -> Self {
                let scaled = value * steps(F);
                Self(if scaled < 0.0 { scaled - 0.5 } else { scaled + 0.5 } as $bits)
            }
        }
    )+};
}

macro_rules! nearest_in {
    ($($bits:ty)+) => {$(
        impl<const F: u32> Fixed<F, $bits> {
            /// Nearest number to `value`, saturating.
            pub fn nearest(value: f64) -> Self {
                Self(libm::round(value * steps(F)) as $bits)
            }
        }
    )+};
}

signed!(i32 i64);
constants!(i32 i64 u32);
nearest_in!(i64 u32);

impl<const F: u32> Fixed<F> {
    /// The product in steps of 2^-`H`, from its upper half, which is rounded down.
    #[inline(always)]
    pub fn times<const G: u32, const H: u32>(self, other: Fixed<G>) -> Fixed<H> {
        const { assert!(H + 32 <= F + G) };
        let upper = ((i64::from(self.0) * i64::from(other.0)) >> 32) as i32;
        Fixed(upper >> (F + G - H - 32))
    }

    /// Full product.
    #[inline(always)]
    pub fn whole<const G: u32, const H: u32>(self, other: Fixed<G>) -> Fixed<H, i64> {
        const { assert!(F + G == H) };
        Fixed(i64::from(self.0) * i64::from(other.0))
    }
}

impl<const F: u32> Fixed<F, i64> {
    /// Product in steps of 2^-`H`, rounded down, modulo 2^64 steps.
    #[inline(always)]
    pub const fn times<const G: u32, const H: u32>(self, other: Fixed<G, i64>) -> Fixed<H, i64> {
        const { assert!(H <= F + G) };
        Fixed(((self.0 as i128 * other.0 as i128) >> (F + G - H)) as i64)
    }
}

/// Velocity relative to the track (symbol psi) in units of `b w`: 0..64 in steps of 2^-26 (1.5e-8).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Velocity(Fixed<26, u32>);

impl Velocity {
    pub(crate) const ZERO: Self = Self(Fixed(0));

    pub(crate) const fn from_bits(bits: u32) -> Self {
        Self(Fixed(bits))
    }

    /// Bits in units of 2^-26.
    pub const fn bits(self) -> u32 {
        self.0.0
    }

    /// Nearest velocity to `value` in `b w`, saturating.
    pub(crate) fn nearest(value: f64) -> Self {
        Self(Fixed::<26, u32>::nearest(value))
    }

    /// Velocity in `b w`, exact.
    pub(crate) fn value(self) -> f64 {
        f64::from(self.bits()) * (1.0 / steps(26))
    }
}
