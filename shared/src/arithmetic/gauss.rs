//! Gaussian random numbers by the ratio of uniforms (Leva, ACM Trans. Math. Softw. 18 (1992) 449),
//! with the same bits on every machine.

use core::f64::consts::{LN_2, SQRT_2};

/// Natural logarithm of a normal number above 0, within 3e-16 or an ulp.
fn logarithm(x: f64) -> f64 {
    let bits = x.to_bits();
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

/// Gaussian number with mean 0 and standard deviation 1, from uniform numbers in 0..1, 0 excluded.
/// Two quadratic curves decide all but 1.2 % of the pairs without a logarithm.
#[inline]
pub(crate) fn gauss(mut uniform: impl FnMut() -> f64) -> f64 {
    loop {
        let u = uniform();
        // Width 2 sqrt(2/e), which contains the region v^2 <= -4 u^2 ln u.
        let v = 1.7156 * (uniform() - 0.5);
        let x = u - 0.449_871;
        let y = v.abs() + 0.386_595;
        let q = x * x + y * (0.196 * y - 0.254_72 * x);
        if q < 0.275_97 || (q <= 0.278_46 && v * v <= -4.0 * u * u * logarithm(u)) {
            return v / u;
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Moments and tails of a million numbers, within five standard errors.
    pub fn assert_gaussian(mut draw: impl FnMut() -> f64) {
        const COUNT: u32 = 1_000_000;
        let mut moments = [0.0; 4];
        let mut beyond = [0_u32; 5];
        for _ in 0..COUNT {
            let x = draw();
            for (moment, power) in moments.iter_mut().zip(1..) {
                *moment += libm::pow(x, f64::from(power)) / f64::from(COUNT);
            }
            for (count, limit) in beyond.iter_mut().zip([0.5, 1.0, 2.0, 3.0, 4.0]) {
                *count += u32::from(x > limit);
            }
        }
        // Five standard errors of each: 1e-3, 1.4e-3, 3.9e-3, 9.8e-3.
        let expected = [(0.0, 5e-3), (1.0, 7e-3), (0.0, 2e-2), (3.0, 5e-2)];
        for (moment, (expected, error)) in moments.iter().zip(expected) {
            assert!((moment - expected).abs() < error, "{moments:?}");
        }
        let shares = [0.308_538, 0.158_655, 0.022_750, 0.001_349_9, 3.167e-5];
        for (&count, share) in beyond.iter().zip(shares) {
            let expected = share * f64::from(COUNT);
            let error = 5.0 * libm::sqrt(expected);
            assert!((f64::from(count) - expected).abs() < error, "{beyond:?}");
        }
    }

    #[test]
    fn logarithm_matches_libm() {
        let mut x = 1e-17_f64;
        while x < 3.0 {
            let error = (logarithm(x) - libm::log(x)).abs();
            assert!(error <= 3e-16 + 3e-16 * libm::log(x).abs(), "{x} {error}");
            x *= 1.000_37;
        }
    }
}
