//! Fixed-point numbers: velocities of the kernels without f64, and integer arithmetic for CPUs
//! without an FPU.

use core::ops::{Add, Neg, Sub};

use crate::feeder::{OutOfRange, accept};

/// A number in steps of 2^-`F`, held in `T`.
///
/// The compiler checks the binary places of each sum, product and quotient and derives the shifts.
/// The code states the arithmetic only; the instructions equal hand-written ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Fixed<const F: u32, T = i32>(pub T);

/// Number of steps of 2^-`places` in 1.
const fn steps(places: u32) -> f64 {
    (1_u64 << places) as f64
}

macro_rules! stored_in {
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
    )+};
}

macro_rules! rounded_to {
    ($($bits:ty)+) => {$(
        impl<const F: u32> Fixed<F, $bits> {
            pub const ZERO: Self = Self(0);

            /// Nearest number to a constant.
            pub const fn from_constant(value: f64) -> Self {
                let scaled = value * steps(F);
                Self(if scaled < 0.0 { scaled - 0.5 } else { scaled + 0.5 } as $bits)
            }

            #[inline(always)]
            pub const fn wrapping_sub(self, other: Self) -> Self {
                Self(self.0.wrapping_sub(other.0))
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

macro_rules! in_32_bits {
    ($($bits:ty)+) => {$(
        impl<const F: u32> Fixed<F, $bits> {
            /// Number from an f32, rounded towards 0, saturating.
            #[inline(always)]
            pub fn from_single(value: f32) -> Self {
                Self((value * steps(F) as f32) as $bits)
            }

            /// The nearest f32.
            #[inline(always)]
            pub fn single(self) -> f32 {
                self.0 as f32 * (1.0 / steps(F)) as f32
            }

            /// Product in steps of 2^-`H`, rounded down; it must fit 32 bits.
            #[inline(always)]
            pub const fn short_times<const G: u32, const H: u32>(
                self,
                other: Fixed<G, $bits>,
            ) -> Fixed<H, $bits> {
                const { assert!(H <= F + G) };
                Fixed((self.0 * other.0) >> (F + G - H))
            }

            #[inline(always)]
            pub const fn wrapping_add(self, other: Self) -> Self {
                Self(self.0.wrapping_add(other.0))
            }
        }
    )+};
}

stored_in!(i32 i64 u32 u64);
rounded_to!(i32 i64 u32);
nearest_in!(u32);
// The tracks of several tones.
nearest_in!(i64);
#[cfg(test)]
nearest_in!(i32);
in_32_bits!(i32 u32);

impl<const F: u32> Neg for Fixed<F> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl<const F: u32> Neg for Fixed<F, i64> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl<const F: u32> Fixed<F> {
    /// One step.
    pub const STEP: Self = Self(1);
    /// 1, if it is in range.
    pub const ONE: Self = Self(1 << F);

    /// Largest number not above a constant of at least 0.
    pub const fn floor_of_constant(value: f64) -> Self {
        Self((value * steps(F)) as i32)
    }

    #[inline(always)]
    pub const fn saturating_add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }

    #[inline(always)]
    pub const fn saturating_sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }

    #[inline(always)]
    pub const fn abs(self) -> Self {
        Self(self.0.abs())
    }

    /// The same value in an unsigned type; it must be at least 0.
    #[inline(always)]
    pub const fn unsigned(self) -> Fixed<F, u32> {
        Fixed(self.0 as u32)
    }

    #[inline(always)]
    pub const fn unsigned_abs(self) -> Fixed<F, u32> {
        Fixed(self.0.unsigned_abs())
    }

    /// The product in steps of 2^-`H`, from its upper half, which is rounded down.
    #[inline(always)]
    pub fn times<const G: u32, const H: u32>(self, other: Fixed<G>) -> Fixed<H> {
        let upper = high(self.0, other.0);
        Fixed(if H + 32 < F + G {
            upper >> (F + G - H - 32)
        } else {
            upper << (H + 32 - F - G)
        })
    }

    /// As [`times`](Self::times), for at most 2^30 steps and fewer than 2^16.
    #[inline(always)]
    pub fn times_short<const G: u32, const H: u32>(self, other: Fixed<G>) -> Fixed<H> {
        const { assert!(H + 15 <= F + G) };
        if HAS_NARROW_MULTIPLIER {
            Fixed(long_by_short(self.0, other.0) >> (F + G - H - 15))
        } else {
            self.times(other)
        }
    }

    /// Product in steps of 2^-`H`, rounded down. Near an impact it fits 32 bits; elsewhere it is
    /// modulo 2^32.
    #[inline(always)]
    pub const fn wrapping_times<const G: u32, const H: u32>(self, other: Fixed<G>) -> Fixed<H> {
        const { assert!(H <= F + G) };
        Fixed(self.0.wrapping_mul(other.0) >> (F + G - H))
    }

    /// Full product in steps of 2^-`H`, rounded down, modulo 2^32 steps.
    #[inline(always)]
    pub const fn product<const G: u32, const H: u32>(self, other: Fixed<G>) -> Fixed<H> {
        const { assert!(H <= F + G) };
        Fixed(((self.0 as i64 * other.0 as i64) >> (F + G - H)) as i32)
    }

    /// Full product by the fastest method of this CPU.
    #[inline(always)]
    pub fn wide<const G: u32, const H: u32>(self, other: Fixed<G>) -> Fixed<H, i64> {
        if HAS_NARROW_MULTIPLIER {
            const { assert!(F + G == H) };
            Fixed(wide_signed(self.0, other.0))
        } else {
            self.whole(other)
        }
    }

    /// Full product for a CPU with a multiplier of 32 by 32 bits into 64.
    #[inline(always)]
    pub fn whole<const G: u32, const H: u32>(self, other: Fixed<G>) -> Fixed<H, i64> {
        const { assert!(F + G == H) };
        Fixed(i64::from(self.0) * i64::from(other.0))
    }
}

impl<const F: u32> Fixed<F, u32> {
    /// Full product.
    #[inline(always)]
    pub fn wide<const G: u32, const H: u32>(self, other: Fixed<G, u32>) -> Fixed<H, u64> {
        const { assert!(F + G == H) };
        Fixed(wide(self.0, other.0))
    }

    /// Square root, rounded down; relative error about 2^-15.
    #[inline(always)]
    pub fn root<const H: u32>(self) -> Fixed<H, u32> {
        const { assert!(F.is_multiple_of(2) && H <= F / 2 + 16) };
        Fixed(square_root_scaled(self.0) >> (F / 2 + 16 - H))
    }

    /// The same value in a signed type; it must be below half the range.
    #[inline(always)]
    pub const fn signed(self) -> Fixed<F> {
        Fixed(self.0 as i32)
    }
}

impl<const F: u32> Fixed<F, i64> {
    /// Product in steps of 2^-`H`, rounded down, modulo 2^32 steps; it must fit 64 bits.
    #[inline(always)]
    pub const fn product<const G: u32, const H: u32>(self, other: Fixed<G>) -> Fixed<H> {
        const { assert!(H <= F + G) };
        Fixed(((self.0 * other.0 as i64) >> (F + G - H)) as i32)
    }

    /// The number in steps of 2^-`G`, rounded down, modulo 2^32 steps.
    #[inline(always)]
    pub const fn narrow<const G: u32>(self) -> Fixed<G> {
        const { assert!(G <= F) };
        Fixed((self.0 >> (F - G)) as i32)
    }
}

/// Velocity relative to the track (symbol psi) in units of `b w`: 0..64 in steps of 2^-26 (1.5e-8).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Velocity(Fixed<26, u32>);

impl Velocity {
    /// Velocity 0: at rest, if the track does not throw.
    pub const ZERO: Self = Self(Fixed(0));

    /// Velocity from its bits, in units of 2^-26.
    pub const fn from_bits(bits: u32) -> Self {
        Self(Fixed(bits))
    }

    /// Bits in units of 2^-26.
    pub const fn bits(self) -> u32 {
        self.0.0
    }

    /// Velocity from a fixed-point number.
    pub(crate) const fn from_fixed(value: Fixed<26, u32>) -> Self {
        Self(value)
    }

    /// The fixed-point number.
    pub(crate) const fn fixed(self) -> Fixed<26, u32> {
        self.0
    }

    /// Nearest velocity to `value` in `b w`; an error outside 0..`limit`, with `accepted` as its
    /// text.
    pub(crate) fn build(
        value: f64,
        limit: f64,
        accepted: &'static str,
    ) -> Result<Self, OutOfRange> {
        accept("velocity", value, (0.0..=limit).contains(&value), accepted)?;
        Ok(Self(Fixed::<26, u32>::nearest(value)))
    }

    /// Velocity in `b w`, exact.
    pub fn value(self) -> f64 {
        f64::from(self.bits()) * (1.0 / steps(26))
    }
}

/// Whether the CPU multiplies 32 by 32 bits into 32 only (Cortex-M0). Wide products are then
/// composed of halves, with the same bits.
const HAS_NARROW_MULTIPLIER: bool = cfg!(all(
    target_arch = "arm",
    target_os = "none",
    not(target_has_atomic = "32")
));

/// Full product.
#[inline(always)]
pub(crate) fn wide(a: u32, b: u32) -> u64 {
    if HAS_NARROW_MULTIPLIER {
        wide_by_halves(a, b)
    } else {
        u64::from(a) * u64::from(b)
    }
}

#[inline(always)]
fn wide_by_halves(a: u32, b: u32) -> u64 {
    let (a_high, a_low) = (a >> 16, a & 0xffff);
    let (b_high, b_low) = (b >> 16, b & 0xffff);
    let outer = (u64::from(a_high * b_high) << 32) | u64::from(a_low * b_low);
    outer + (u64::from(a_high * b_low) << 16) + (u64::from(a_low * b_high) << 16)
}

/// Upper half of the product, rounded down.
#[inline(always)]
pub(crate) fn high(a: i32, b: i32) -> i32 {
    if HAS_NARROW_MULTIPLIER {
        high_by_halves(a, b)
    } else {
        ((i64::from(a) * i64::from(b)) >> 32) as i32
    }
}

#[inline(always)]
fn high_by_halves(a: i32, b: i32) -> i32 {
    let (a_high, a_low) = (a >> 16, a & 0xffff);
    let (b_high, b_low) = (b >> 16, b & 0xffff);
    let low = ((a_low as u32 * b_low as u32) >> 16) as i32;
    let one = a_high * b_low + low;
    let two = a_low * b_high + (one & 0xffff);
    a_high * b_high + (one >> 16) + (two >> 16)
}

/// `a b 2^-15`, rounded down, for absolute values of at most 2^30 and below 2^16.
#[inline(always)]
fn long_by_short(a: i32, b: i32) -> i32 {
    (a >> 15) * b + (((a & 0x7fff) * b) >> 15)
}

/// Reciprocal `1 / x` of a number in steps of 2^-`F`. The integer x has the reciprocal
/// `mantissa 2^(shift - 62)`, mantissa in 2^30..=2^31.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reciprocal<const F: u32> {
    pub mantissa: u32,
    pub shift: u32,
}

/// Table of 256 / (m + 1/2) - 256 for m = 1/2..1 in steps of 1/256.
const RECIPROCALS: [u8; 128] = {
    let mut table = [0; 128];
    let mut i = 0;
    while i < 128 {
        let m = 2 * (128 + i as u32) + 1;
        let value = (131_072 + m / 2) / m - 256;
        table[i] = if value > 255 { 255 } else { value as u8 };
        i += 1;
    }
    table
};

impl<const F: u32> Reciprocal<F> {
    /// Relative error about 2^-15 for `x` > 0: the table and one Newton step in 32 bits.
    #[inline(always)]
    pub fn coarse(x: Fixed<F, u32>) -> Self {
        let x = x.0;
        let shift = leading_zeros(x);
        Self::of_scaled(x << shift, shift)
    }

    /// Relative error about 2^-29 for `x` > 0: one more Newton step.
    #[inline(always)]
    pub fn fine(x: Fixed<F, u32>) -> Self {
        let Self { mantissa, shift } = Self::coarse(x);
        let m = x.0 << shift;
        let miss = if HAS_NARROW_MULTIPLIER {
            miss_by_halves(m, mantissa)
        } else {
            (1_i32 << 30) - (wide(m, mantissa) >> 32) as i32
        };
        let gain = ((mantissa >> 14) as i32 * (miss >> 1)) >> 15;
        Self {
            mantissa: mantissa.wrapping_add(gain as u32),
            shift,
        }
    }

    /// As [`coarse`](Self::coarse), for `x` of at least 2^8 steps, and mostly below 2^16.
    #[inline(always)]
    pub fn short(x: Fixed<F, u32>) -> Self {
        if !HAS_NARROW_MULTIPLIER || x.0 >> 16 != 0 {
            return Self::coarse(x);
        }
        let shift = 16 + u32::from(LEADING_ZEROS[(x.0 >> 8) as usize]);
        Self::of_scaled(x.0 << shift, shift)
    }

    /// Reciprocal of `m 2^-shift` for `m` in 2^31..2^32, with a relative error of about 2^-15.
    #[inline(always)]
    fn of_scaled(m: u32, shift: u32) -> Self {
        let first = 256 + u32::from(RECIPROCALS[((m >> 24) & 127) as usize]);
        let miss = (1_i32 << 24) - (first * (m >> 16)) as i32;
        let second = (first << 8) as i32 + ((first as i32 * miss) >> 16);
        Self {
            mantissa: (second as u32) << 14,
            shift,
        }
    }

    /// `a / x` in steps of 2^-`H`, rounded towards 0, with |a| at most `limit`, from a
    /// [`short`](Self::short) reciprocal.
    #[inline(always)]
    pub fn short_times<const A: u32, const H: u32>(self, a: Fixed<A>, limit: Fixed<H>) -> Fixed<H> {
        const { assert!(H + F <= A + 16 && H + F > A + 8) };
        let size = a.0.unsigned_abs();
        let size = if size >> 22 == 0 {
            // The mantissa has 17 bits: multiply by the upper 14 bits of the size, then by the
            // lower 8.
            let mantissa = self.mantissa >> 14;
            let sum = (size >> 8) * mantissa + (((size & 0xff) * mantissa) >> 8);
            sum >> (40 + A - H - F - self.shift)
        } else {
            scaled(self.mantissa, self.shift, size, H + F - A) as u32
        };
        let size = size.min(limit.0 as u32) as i32;
        Fixed(if a.0 < 0 { -size } else { size })
    }

    /// `a / x` in steps of 2^-`H`, rounded towards 0, saturating.
    #[inline(always)]
    pub fn times<const A: u32, const H: u32>(self, a: Fixed<A>) -> Fixed<H> {
        const { assert!(A <= H + F) };
        let size = scaled(self.mantissa, self.shift, a.0.unsigned_abs(), H + F - A);
        Fixed(if a.0 < 0 { -size } else { size })
    }
}

/// 2^30 minus the upper half of `m mantissa`, for the mantissa of a coarse reciprocal.
#[inline(always)]
fn miss_by_halves(m: u32, mantissa: u32) -> i32 {
    // The mantissa has 17 bits with a leading 1, and the product is close to 2^62.
    let rest = (mantissa >> 14) - (1 << 16);
    let over = m
        .wrapping_add((m >> 16).wrapping_mul(rest))
        .wrapping_add(((m & 0xffff) * rest) >> 16);
    -(over as i32 >> 2)
}

/// `a mantissa 2^(shift + places - 62)`, rounded down, saturating; one routine for all places.
#[inline(never)]
fn scaled(mantissa: u32, shift: u32, a: u32, places: u32) -> i32 {
    let down = 62 - (shift + places) as i32;
    let upper = |a| (wide(a, mantissa) >> 32) as u32;
    // Usually the upper half of the product suffices, which is below 2^31.
    if down >= 32 {
        return (upper(a) >> (down - 32).min(31)) as i32;
    }
    if down > 0 && a >> down == 0 {
        return upper(a << (32 - down)) as i32;
    }
    let size = if down > 0 {
        wide(a, mantissa) >> down
    } else {
        u64::from(a) << 32
    };
    size.min(i32::MAX as u64) as i32
}

/// Full product of signed factors.
#[inline(always)]
pub(crate) fn wide_signed(a: i32, b: i32) -> i64 {
    let product = wide(a.unsigned_abs(), b.unsigned_abs()) as i64;
    if (a ^ b) < 0 { -product } else { product }
}

/// Number of leading zero bits of a byte.
const LEADING_ZEROS: [u8; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        table[byte] = (byte as u8).leading_zeros() as u8;
        byte += 1;
    }
    table
};

/// Number of leading zero bits of `x` > 0.
#[inline(always)]
fn leading_zeros(x: u32) -> u32 {
    if HAS_NARROW_MULTIPLIER {
        leading_zeros_by_bytes(x)
    } else {
        x.leading_zeros()
    }
}

#[inline(always)]
fn leading_zeros_by_bytes(x: u32) -> u32 {
    let halves = u32::from(x >> 16 == 0) << 4;
    let x = x << halves;
    let bytes = u32::from(x >> 24 == 0) << 3;
    halves + bytes + u32::from(LEADING_ZEROS[(x << bytes >> 24) as usize])
}

/// Table of 256 / sqrt(m + 1/2) - 256 for m = 1/4..1 in steps of 1/256.
const INVERSE_ROOTS: [u8; 192] = {
    let mut table = [0; 192];
    let mut i = 0;
    while i < 192 {
        // Nearest y with y^2 m = 2^25, for m in half steps of 1/256.
        let m = 2 * (64 + i as u32) + 1;
        let mut y = 256;
        while (2 * y + 1) * (2 * y + 1) * m < 4 << 25 && y < 511 {
            y += 1;
        }
        table[i] = (y - 256) as u8;
        i += 1;
    }
    table
};

/// `2^16 sqrt(x)` with a relative error of about 2^-15, saturating just below 2^32.
#[inline(always)]
pub(crate) fn square_root_scaled(x: u32) -> u32 {
    if x == 0 {
        return 0;
    }
    let shift = leading_zeros(x) & !1;
    let m = x << shift;
    let first = 256 + u32::from(INVERSE_ROOTS[(m >> 24) as usize - 64]);
    let miss = (1_i32 << 30) - ((m >> 16) * ((first * first) >> 2)) as i32;
    let second = (first << 8) as i32 + ((first as i32 * (miss >> 14)) >> 9);
    // sqrt(m), steps of 2^-31.
    let root = (m >> 16) * (second as u32 >> 1);
    (root >> (shift / 2)).min(i32::MAX as u32) << 1
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::*;

    /// Each product and shift agrees with f64, which holds these numbers exactly.
    #[test]
    fn binary_places_follow_from_the_type() {
        let number = |x: Fixed<28>| f64::from(x.0) / steps(28);
        for a in [-3.7, -0.01, 0.0, 1e-8, 1.0, 3.25] {
            for b in [-7.9, -1.0, 0.3, 6.0] {
                let (x, y) = (Fixed::<28>::nearest(a), Fixed::<28>::nearest(b));
                let exact = number(x) * number(y);
                let upper: Fixed<22> = x.times(y);
                assert_eq!(
                    f64::from(upper.0),
                    libm::floor(exact * steps(22)),
                    "{a} {b}"
                );
                let whole: Fixed<56, i64> = x.wide(y);
                assert_eq!(whole, x.whole(y));
                assert_eq!(whole.0 as f64, exact * steps(56), "{a} {b}");
                let lower: Fixed<24> = x.product(y);
                assert_eq!(lower, whole.narrow());
                let (short, other) = (x.to::<12>(), y.to::<12>());
                let product: Fixed<20> = short.short_times(other);
                assert_eq!(product, short.wrapping_times(other));
                assert_eq!(product.0, (short.0 * other.0) >> 4);
            }
            let x = Fixed::<28>::nearest(a);
            assert_eq!(
                f64::from(x.to::<20>().0),
                libm::floor(number(x) * steps(20))
            );
            assert_eq!(x.scaled::<27>().to::<28>(), x + x);
            let single = Fixed::<20>::nearest(a).single();
            assert_eq!(Fixed::<20>::from_single(single), Fixed::<20>::nearest(a));
        }
        assert_eq!(Fixed::<28>::from_constant(PI), Fixed::<28>::nearest(PI));
        assert_eq!(Fixed::<28>::from_constant(-PI), Fixed::<28>::nearest(-PI));
        assert_eq!(
            Fixed::<28>::floor_of_constant(PI),
            Fixed::<28>::from_constant(PI) - Fixed::<28>::STEP
        );
        let root = Fixed::<28>::from_constant(2.25).unsigned().root::<30>();
        // Relative error 2^-15.
        assert!(root.0.abs_diff(3 << 29) < 3 << 14, "{root:?}");
    }

    #[test]
    fn quotients_have_the_requested_places() {
        for a in [-0.3, 1e-4, 0.7] {
            for x in [0.01, 0.4, 3.0] {
                let (a, x) = (Fixed::<30>::nearest(a), Fixed::<26>::nearest(x));
                let quotient: Fixed<24> = Reciprocal::fine(x.unsigned_abs()).times(a);
                let exact = f64::from(a.0) / f64::from(x.0) / 16.0 * steps(24);
                // Error of the reciprocal, 2^-29, and rounding towards 0.
                let error = (f64::from(quotient.0) - exact).abs();
                assert!(error < 1.0 + 4e-9 * exact.abs(), "{a:?} {x:?} {error}");
            }
        }
    }

    #[test]
    fn velocity_rounds_to_the_nearest_step() {
        for value in [0.0, 1e-9, 0.3, 1.0, 28.999, 59.999_999_99] {
            let velocity = Velocity::build(value, 60.0, "0..60").unwrap();
            assert!((velocity.value() - value).abs() <= 0.5 / steps(26));
        }
        for value in [-1e-9, 60.1, f64::NAN, f64::INFINITY] {
            assert_eq!(
                Velocity::build(value, 60.0, "0..60").unwrap_err().parameter,
                "velocity"
            );
        }
    }

    /// Values of all magnitudes.
    fn magnitudes() -> impl Iterator<Item = u32> {
        (0..32).flat_map(|shift| (0..200_u32).map(move |i| (u32::MAX - i * 10_737_419) >> shift))
    }

    #[test]
    fn products_by_halves_are_exact() {
        for a in magnitudes().step_by(7) {
            for b in magnitudes().step_by(13) {
                assert_eq!(wide_by_halves(a, b), u64::from(a) * u64::from(b));
                let (a, b) = (a as i32, b as i32);
                let expected = ((i64::from(a) * i64::from(b)) >> 32) as i32;
                assert_eq!(high_by_halves(a, b), expected);
            }
        }
    }

    #[test]
    fn reciprocals_are_within_their_error() {
        for x in magnitudes() {
            let value =
                |r: Reciprocal<0>| f64::from(r.mantissa) * libm::exp2(f64::from(r.shift) - 62.0);
            let (coarse, fine) = (Reciprocal::coarse(Fixed(x)), Reciprocal::fine(Fixed(x)));
            // Measured: 3.1e-5 and 1.6e-9.
            assert!((value(coarse) * f64::from(x) - 1.0).abs() < 4e-5, "{x}");
            assert!((value(fine) * f64::from(x) - 1.0).abs() < 4e-9, "{x}");
        }
    }

    /// The method for a narrow multiplier gives the same bits.
    #[test]
    fn narrow_forms_give_the_same_bits() {
        for x in magnitudes() {
            assert_eq!(leading_zeros_by_bytes(x), x.leading_zeros(), "{x}");
            let Reciprocal { mantissa, shift } = Reciprocal::<0>::coarse(Fixed(x));
            let m = x << shift;
            let miss = (1 << 30) - (wide(m, mantissa) >> 32) as i32;
            assert_eq!(miss_by_halves(m, mantissa), miss, "{x}");
        }
        let signed = |x: u32| [x as i32, -(x as i32)];
        for a in magnitudes()
            .step_by(7)
            .map(|a| a >> 2)
            .chain([1 << 30])
            .flat_map(signed)
        {
            for b in magnitudes().step_by(13).map(|b| b >> 16).flat_map(signed) {
                let product = i64::from(a) * i64::from(b);
                assert_eq!(i64::from(long_by_short(a, b)), product >> 15, "{a} {b}");
            }
        }
    }

    #[test]
    fn short_quotients_are_exact_within_the_limit() {
        let limit = Fixed::<16>::from_constant(2.0);
        for x in magnitudes().filter(|x| *x >= 1 << 8) {
            let x = Fixed::<13, u32>(x);
            let (short, coarse) = (Reciprocal::short(x), Reciprocal::coarse(x));
            assert_eq!(
                [short.mantissa, short.shift],
                [coarse.mantissa, coarse.shift]
            );
            for a in magnitudes().step_by(11).map(|a| Fixed::<16>(a as i32)) {
                let whole: Fixed<16> = coarse.times(a);
                assert_eq!(
                    short.short_times(a, limit),
                    whole.clamp(-limit, limit),
                    "{a:?} {x:?}"
                );
            }
        }
    }

    /// Agrees with a product in wide integers.
    #[test]
    fn scaled_products_saturate() {
        for mantissa in magnitudes().step_by(17).map(|m| (1 << 30) | m >> 2) {
            for a in magnitudes().step_by(29).chain([0]) {
                for down in -30..=62 {
                    let product = u128::from(a) * u128::from(mantissa);
                    let size = (product << 30 >> (down + 30)).min(i32::MAX as u128);
                    // It saturates where no bits are shifted out.
                    let size = if down <= 0 && a > 0 {
                        i32::MAX as u128
                    } else {
                        size
                    };
                    let places = 62 - down;
                    assert_eq!(
                        scaled(mantissa, 0, a, places as u32) as u128,
                        size,
                        "{mantissa} {a} {down}"
                    );
                }
            }
        }
    }

    #[test]
    fn square_roots_are_within_their_error() {
        for x in magnitudes() {
            let expected = libm::sqrt(f64::from(x)) * 65_536.0;
            let error = f64::from(square_root_scaled(x)) / expected - 1.0;
            // Measured: 5e-5.
            assert!(error.abs() < 7e-5, "{x} {error}");
        }
    }
}
