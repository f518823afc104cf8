//! Gaussian random numbers by the ratio of uniforms (Leva, ACM Trans. Math. Softw. 18 (1992) 449),
//! with the same bits on every machine.

use core::f64::consts::{LN_2, SQRT_2};
use core::ops::{Add, Div, Mul, Neg, Sub};

/// Operations that the method requires of a number type.
pub(crate) trait Arithmetic:
    Copy
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    fn from_constant(constant: f64) -> Self;
    /// Natural logarithm of a normal number above 0, with the same rounding on every machine.
    fn logarithm(self) -> Self;
}

impl Arithmetic for f64 {
    #[inline]
    fn from_constant(constant: f64) -> Self {
        constant
    }

    /// Within 3e-16 or an ulp.
    fn logarithm(self) -> Self {
        let bits = self.to_bits();
        let mut exponent = (bits >> 52) as i32 - 1023;
        let mut mantissa = f64::from_bits(bits & ((1 << 52) - 1) | 1023 << 52);
        if mantissa > SQRT_2 {
            mantissa *= 0.5;
            exponent += 1;
        }
        // 2 atanh z, |z| <= 0.1716.
        let z = (mantissa - 1.0) / (mantissa + 1.0);
        let square = z * z;
        let mut sum = 0.0;
        let mut n = 21.0;
        while n > 0.0 {
            sum = sum * square + 1.0 / n;
            n -= 2.0;
        }
        f64::from(exponent) * LN_2 + 2.0 * z * sum
    }
}

impl Arithmetic for f32 {
    #[inline]
    fn from_constant(constant: f64) -> Self {
        constant as f32
    }

    /// Of a number in 0..1, within 2e-6.
    fn logarithm(self) -> Self {
        let bits = self.to_bits();
        let exponent = (bits >> 23) as i32 - 127;
        let mantissa = f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000);
        // 2 atanh z, 0 <= z < 1/3; the remainder of the series is below 2 z^13 / 13.
        let z = (mantissa - 1.0) / (mantissa + 1.0);
        let w = z * z;
        let sum = 1.0
            + w * (1.0 / 3.0 + w * (0.2 + w * (1.0 / 7.0 + w * (1.0 / 9.0 + w * (1.0 / 11.0)))));
        exponent as f32 * core::f32::consts::LN_2 + 2.0 * z * sum
    }
}

/// Gaussian number with mean 0 and standard deviation 1, from uniform numbers in 0..1, 0 excluded.
/// Two quadratic curves decide all but 1.2 % of the pairs without a logarithm.
#[inline]
pub(crate) fn gauss<F: Arithmetic>(mut uniform: impl FnMut() -> F) -> F {
    let from_constant = F::from_constant;
    loop {
        let u = uniform();
        // Width 2 sqrt(2/e), which contains the region v^2 <= -4 u^2 ln u.
        let v = from_constant(1.7156) * (uniform() - from_constant(0.5));
        let x = u - from_constant(0.449_871);
        let size = if v < from_constant(0.0) { -v } else { v };
        let y = size + from_constant(0.386_595);
        let q = x * x + y * (from_constant(0.196) * y - from_constant(0.254_72) * x);
        let inside = q < from_constant(0.275_97);
        if inside
            || (q <= from_constant(0.278_46)
                && v * v <= from_constant(-4.0) * u * u * u.logarithm())
        {
            return v / u;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithm_matches_libm() {
        let mut x = 1e-17_f64;
        while x < 3.0 {
            let error = (x.logarithm() - libm::log(x)).abs();
            assert!(error <= 3e-16 + 3e-16 * libm::log(x).abs(), "{x} {error}");
            x *= 1.000_37;
        }
    }

    #[test]
    fn f32_logarithm_is_within_its_error() {
        let mut x = 3e-8_f32;
        while x < 1.0 {
            let error = f64::from(x.logarithm()) - libm::log(f64::from(x));
            assert!(error.abs() < 2e-6, "{x} {error}");
            x *= 1.000_37;
        }
    }
}
