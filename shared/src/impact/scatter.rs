//! Restitution that varies at random from impact to impact, as that of any real part.

use crate::arithmetic::{gauss, splitmix};
use crate::feeder::{OutOfRange, accept_in};

/// Largest standard deviation of the restitution; bodies that tumble have 0.27 to 0.52.
const MAX_DEVIATION: f64 = 0.5;

/// A seeded stream of restitutions: Gaussian about a mean, clipped to [0, 1).
///
/// A seed gives the same bits on every machine. The Gaussian numbers end at six standard deviations
/// and come in steps of at most 4.4e-7 of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    mean: f64,
    deviation: f64,
    state: u64,
}

impl Scatter {
    /// Restitutions with a `mean` in -1..=1 before clipping, below 0 for bodies that tumble, and a
    /// standard deviation (symbol s) in 0..=0.5; an error names the one out of range.
    pub fn build(mean: f64, deviation: f64, seed: u64) -> Result<Self, OutOfRange> {
        let scatter = Self {
            mean,
            deviation,
            state: seed,
        };
        scatter.with_mean(mean)?.with_deviation(deviation)
    }

    /// The same stream, about another mean in -1..=1.
    pub fn with_mean(self, mean: f64) -> Result<Self, OutOfRange> {
        accept_in("restitution", mean, -1.0..=1.0, "-1..1")?;
        Ok(Self { mean, ..self })
    }

    /// The same stream, with another standard deviation in 0..=0.5.
    pub fn with_deviation(self, deviation: f64) -> Result<Self, OutOfRange> {
        let accepted = "0..0.5, the standard deviation of restitution from impact to impact";
        accept_in("scatter", deviation, 0.0..=MAX_DEVIATION, accepted)?;
        Ok(Self { deviation, ..self })
    }

    /// The mean before clipping.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// The standard deviation before clipping.
    pub fn deviation(&self) -> f64 {
        self.deviation
    }

    /// The restitution of the next impact, 0..1 without 1; without scatter the mean, at least 0.
    #[inline]
    pub fn draw(&mut self) -> f64 {
        if self.deviation == 0.0 {
            return self.mean.max(0.0);
        }
        (self.mean + self.deviation * f64::from(gauss(|| self.next_bits())))
            .clamp(0.0, 1.0 - f64::EPSILON)
    }

    /// The upper half of the next number of splitmix64 (Steele, Lea & Flood 2014).
    #[inline]
    fn next_bits(&mut self) -> u32 {
        let bits = splitmix(self.state);
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        (bits >> 32) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::assert_gaussian;

    #[test]
    fn scatter_is_gaussian() {
        let mut scatter = Scatter::build(0.5, 0.1, 1).unwrap();
        assert_gaussian(|| gauss(|| scatter.next_bits()).into());
    }

    #[test]
    fn seed_determines_the_stream() {
        let draws = |seed| {
            let mut scatter = Scatter::build(0.3, 0.05, seed).unwrap();
            core::array::from_fn::<u64, 4, _>(|_| scatter.draw().to_bits())
        };
        assert_eq!(draws(3), draws(3));
        assert_ne!(draws(3), draws(4));
        // An independent program gives these bits.
        assert_eq!(draws(3)[0], 0x3fd3_f2ce_be66_6666, "{:#x}", draws(3)[0]);
    }

    #[test]
    fn draws_are_clipped_and_bad_settings_refused() {
        let mut wide = Scatter::build(-0.4, 0.5, 5).unwrap();
        let mut high = Scatter::build(0.99, 0.3, 5).unwrap();
        for _ in 0..10_000 {
            assert!((0.0..1.0).contains(&wide.draw()));
            assert!((0.0..1.0).contains(&high.draw()));
        }
        assert_eq!(Scatter::build(0.4, 0.0, 9).unwrap().draw(), 0.4);
        assert_eq!(Scatter::build(-0.4, 0.0, 9).unwrap().draw(), 0.0);
        for (mean, deviation, parameter) in [
            (1.01, 0.1, "restitution"),
            (-1.1, 0.1, "restitution"),
            (0.3, 0.51, "scatter"),
            (0.3, f64::NAN, "scatter"),
        ] {
            let refused = Scatter::build(mean, deviation, 0).unwrap_err();
            assert_eq!(refused.parameter, parameter);
        }
    }
}
