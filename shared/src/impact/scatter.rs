//! Restitution that scatters from impact to impact, as that of every body that tumbles.

use crate::feeder::{OutOfRange, accept};

/// Largest restitution that is drawn: the clip to 0..1, 1 itself excluded.
const HIGHEST: f64 = 1.0 - f64::EPSILON;

/// Largest standard deviation, as an f32 has it: a scene and the wire say 0.3 in single precision, which is above 0.3.
const WIDEST: f64 = 0.3_f32 as f64;

/// A seeded stream of restitutions: Gaussian about a mean, clipped to [0, 1).
///
/// Only sums, products, quotients and square roots of f64 are used, so that a seed gives the same bits on every
/// machine. The Gaussian is exact but for the 53 bits of its uniform numbers (ratio of uniforms, Leva 1992).
///
/// ```
/// use kband::impact::Scatter;
/// let mut scatter = Scatter::build(0.3, 0.05, 7)?;
/// let mean = (0..10_000).map(|_| scatter.draw()).sum::<f64>() / 1e4;
/// assert!((mean - 0.3).abs() < 0.002);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    mean: f64,
    deviation: f64,
    state: u64,
}

impl Scatter {
    /// Restitutions with a `mean` in 0..=1, a standard deviation (symbol s) in 0..=0.3 and a seed.
    pub fn build(mean: f64, deviation: f64, seed: u64) -> Result<Self, OutOfRange> {
        Self {
            mean: 0.0,
            deviation: 0.0,
            state: seed,
        }
        .about(mean)?
        .within(deviation)
    }

    /// The same stream, about another mean in 0..=1.
    pub fn about(self, mean: f64) -> Result<Self, OutOfRange> {
        accept("restitution", mean, (0.0..=1.0).contains(&mean), "0..1")?;
        Ok(Self { mean, ..self })
    }

    /// The same stream, with another standard deviation in 0..=0.3.
    pub fn within(self, deviation: f64) -> Result<Self, OutOfRange> {
        accept(
            "scatter",
            deviation,
            (0.0..=WIDEST).contains(&deviation),
            "0..0.3, the standard deviation of restitution from impact to impact",
        )?;
        Ok(Self { deviation, ..self })
    }

    /// The mean before clipping.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// The standard deviation before clipping.
    #[must_use]
    pub fn deviation(&self) -> f64 {
        self.deviation
    }

    /// The restitution of the next impact, at least 0 and below 1; without scatter the mean itself.
    #[inline]
    pub fn draw(&mut self) -> f64 {
        if self.deviation == 0.0 {
            return self.mean;
        }
        (self.mean + self.deviation * self.gauss()).clamp(0.0, HIGHEST)
    }

    /// The next 64 bits (splitmix64: Steele, Lea & Flood 2014).
    #[inline]
    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in 0..1, 0 excluded, in steps of 2^-53.
    #[inline]
    fn uniform(&mut self) -> f64 {
        ((self.bits() >> 11) as f64 + 0.5) * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Gaussian with mean 0 and deviation 1.
    ///
    /// The ratio of uniforms; two quadratic curves decide all but 1.2 % of the pairs without a logarithm
    /// (J. L. Leva, ACM Trans. Math. Softw. 18 (1992) 449, constants there).
    #[inline]
    fn gauss(&mut self) -> f64 {
        loop {
            let u = self.uniform();
            // Twice sqrt(2/e) wide: the whole region v^2 <= -4 u^2 ln u lies inside.
            let v = 1.7156 * (self.uniform() - 0.5);
            let x = u - 0.449_871;
            let y = v.abs() + 0.386_595;
            let q = x * x + y * (0.196 * y - 0.254_72 * x);
            if q < 0.275_97 || (q <= 0.278_46 && v * v <= -4.0 * u * u * logarithm(u)) {
                return v / u;
            }
        }
    }
}

/// Natural logarithm of a normal positive number, within 3e-16 or an ulp, in the operations that every machine
/// rounds alike.
fn logarithm(x: f64) -> f64 {
    let bits = x.to_bits();
    let mut exponent = (bits >> 52) as i32 - 1023;
    let mut mantissa = f64::from_bits(bits & ((1 << 52) - 1) | 1023 << 52);
    if mantissa > core::f64::consts::SQRT_2 {
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
    f64::from(exponent) * core::f64::consts::LN_2 + 2.0 * z * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_logarithm_is_that_of_libm() {
        let mut x = 1e-17;
        while x < 3.0 {
            let error = (logarithm(x) - libm::log(x)).abs();
            assert!(error <= 3e-16 + 3e-16 * libm::log(x).abs(), "{x} {error}");
            x *= 1.000_37;
        }
    }

    #[test]
    fn it_is_gaussian() {
        const COUNT: u32 = 1_000_000;
        let mut scatter = Scatter::build(0.5, 0.1, 1).unwrap();
        let mut moments = [0.0; 4];
        let mut beyond = [0_u32; 5];
        for _ in 0..COUNT {
            let x = scatter.gauss();
            for (moment, power) in moments.iter_mut().zip(1..) {
                *moment += libm::pow(x, f64::from(power)) / f64::from(COUNT);
            }
            for (count, limit) in beyond.iter_mut().zip([0.5, 1.0, 2.0, 3.0, 4.0]) {
                *count += u32::from(x > limit);
            }
        }
        // Five standard errors of each: 1e-3, 1.4e-3, 3.9e-3, 9.8e-3.
        for (moment, (expected, error)) in
            moments
                .iter()
                .zip([(0.0, 5e-3), (1.0, 7e-3), (0.0, 2e-2), (3.0, 5e-2)])
        {
            assert!((moment - expected).abs() < error, "{moments:?}");
        }
        for (&count, share) in
            beyond
                .iter()
                .zip([0.308_538, 0.158_655, 0.022_750, 0.001_349_9, 3.167e-5])
        {
            let expected = share * f64::from(COUNT);
            let error = 5.0 * libm::sqrt(expected);
            assert!((f64::from(count) - expected).abs() < error, "{beyond:?}");
        }
    }

    #[test]
    fn a_seed_gives_the_same_bits_and_another_others() {
        let draws = |seed| {
            let mut scatter = Scatter::build(0.3, 0.05, seed).unwrap();
            core::array::from_fn::<u64, 4, _>(|_| scatter.draw().to_bits())
        };
        assert_eq!(draws(3), draws(3));
        assert_ne!(draws(3), draws(4));
        // A program of its own gives these bits.
        assert_eq!(draws(3)[0], 0x3fce_bfc0_011c_ccbe, "{:#x}", draws(3)[0]);
    }

    #[test]
    fn it_is_clipped_and_refused_beyond_its_range() {
        let mut wide = Scatter::build(0.0, 0.3, 5).unwrap();
        let mut high = Scatter::build(0.99, 0.3, 5).unwrap();
        for _ in 0..10_000 {
            assert!((0.0..1.0).contains(&wide.draw()));
            assert!((0.0..1.0).contains(&high.draw()));
        }
        assert_eq!(Scatter::build(0.4, 0.0, 9).unwrap().draw(), 0.4);
        for (mean, deviation, parameter) in [
            (1.01, 0.1, "restitution"),
            (-0.1, 0.1, "restitution"),
            (0.3, 0.31, "scatter"),
            (0.3, f64::NAN, "scatter"),
        ] {
            let refused = Scatter::build(mean, deviation, 0).unwrap_err();
            assert_eq!(refused.parameter, parameter);
        }
    }
}
