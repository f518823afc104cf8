//! Positive floating-point numbers with 64-bit mantissa, for the set-up of kernels on a CPU without
//! f64.

use super::Phase;
use super::square_root_single;

/// A number above 0, with a mantissa of at least 2^58 in steps of 2^-`places`; or 0. The mantissa
/// of a factor is in 2^63..2^64. All numbers have such mantissas except those from
/// [`many`](Self::from_many_steps).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Positive {
    mantissa: u64,
    places: i32,
}

impl Positive {
    pub const ZERO: Self = Self::from_many_steps(0, 0);
    pub const RADIANS_PER_STEP: Self = Self::from_f64(Phase::RADIANS_PER_STEP);

    /// Number from a normal f64 above 0, exactly.
    #[inline(always)]
    pub const fn from_f64(value: f64) -> Self {
        let bits = value.to_bits();
        Self::from_many_steps(bits << 11 | 1 << 63, 1086 - (bits >> 52) as i32)
    }

    /// Number from a count of steps of 2^-`places`.
    #[inline(always)]
    pub const fn from_steps(count: u64, places: i32) -> Self {
        if count == 0 {
            return Self::ZERO;
        }
        let shift = count.leading_zeros();
        Self::from_many_steps(count << shift, places + shift as i32)
    }

    /// Number from a count of steps of 2^-`places`, at least 2^58.
    #[inline(always)]
    pub const fn from_many_steps(mantissa: u64, places: i32) -> Self {
        Self { mantissa, places }
    }

    /// Count of steps of 2^-`places`; the number must be a whole count in 2^32..2^64.
    #[inline(always)]
    pub const fn whole(self, places: i32) -> u64 {
        self.mantissa >> ((self.places - places) & 31)
    }

    /// Nearest count of steps of 2^-`places`, below 2^64.
    #[inline(always)]
    pub const fn nearest(self, places: i32) -> u64 {
        let shift = (self.places - places) as u32;
        match shift {
            0 => self.mantissa,
            1..64 => (self.mantissa >> shift) + (self.mantissa >> (shift - 1) & 1),
            64 => self.mantissa >> 63,
            _ => 0,
        }
    }

    /// Nearest f32, ties to even, for a number within 2^-90..2^90.
    #[inline(always)]
    pub fn single(self) -> f32 {
        // The lower half matters only as a sticky bit: the upper one has 26 bits or more.
        let upper = (self.mantissa >> 32) as u32 | u32::from(self.mantissa as u32 != 0);
        upper as f32 * f32::from_bits(((159 - self.places) as u32) << 23)
    }

    /// Nearest f32 to `1 / x`, for a number whose nearest f32 is `single`.
    #[inline(always)]
    pub fn inverse_single(self, single: f32) -> f32 {
        // Error at most 1.5 of its last places.
        let estimate = (1.0 / single).to_bits();
        let first = 1 << 23;
        let last = first | estimate & (first - 1);
        let mantissa = (self.mantissa >> 11) as i64;
        // Residual of the product against a power of 2 above 2^64; below two units of the f64's
        // last place.
        let rest = 0_i64.wrapping_sub(mantissa.wrapping_mul(i64::from(last)));
        // Below a power of 2 the last place is half as large.
        let below = if last == first {
            mantissa >> 1
        } else {
            mantissa
        };
        // -1 if the next number is nearer.
        let up = (mantissa - 2 * rest) >> 63;
        let down = (below + 2 * rest) >> 63;
        f32::from_bits(estimate.wrapping_sub(up as u32).wrapping_add(down as u32))
    }

    /// Nearest f32 to the product with an integer.
    #[inline(always)]
    pub fn times_integer_single(self, n: u32) -> f32 {
        if n == 0 {
            return 0.0;
        }
        let shift = n.leading_zeros();
        let high = upper(u64::from(n << shift) << 32, self.mantissa);
        Self::from_many_steps(high, self.places + shift as i32 - 32).single()
    }
}

/// `2^32 sqrt(x)` for `x` in 2^60..2^63 with a relative error of about 2^-60: f32 and two Newton
/// steps in integers.
#[inline(always)]
pub(crate) fn root(x: u64) -> u64 {
    // Root of x in 32 bits, of which 23 are correct.
    let estimate = square_root_single((x >> 32) as u32 as f32) * 65_536.0;
    let start = estimate as u32;
    let rate = 2_147_483_648.0 / estimate;
    let square = u64::from(start) * u64::from(start);
    // Below 2^42; the error of the root is below 2^10.
    let residual = x.wrapping_sub(square) as i64;
    let step = ((residual >> 12) as i32 as f32 * rate) as i32;
    let better = (u64::from(start) << 32).wrapping_add_signed(i64::from(step) << 12);
    let residual = x.wrapping_sub(upper(better, better)) as i64;
    let step = (residual as i32 as f32 * rate) as i32;
    better.wrapping_add_signed(i64::from(step))
}

const LOW_HALF: u64 = 0xffff_ffff;

/// Upper half of the product, too small by at most 2.
#[inline(always)]
pub(crate) const fn upper(a: u64, b: u64) -> u64 {
    let (a_high, a_low) = (a >> 32, a & LOW_HALF);
    let (b_high, b_low) = (b >> 32, b & LOW_HALF);
    a_high * b_high + ((a_high * b_low) >> 32) + ((a_low * b_high) >> 32)
}
