//! Random restitutions in single precision for the simulations of a plan on the board.
//!
//! The generator is SplitMix (Steele, Lea and Flood, OOPSLA 2014) in 32 bits: a Weyl sequence
//! through a mixing function.

use crate::arithmetic::gauss;

/// Seeded stream of restitutions: Gaussian, clipped to [0, 1), as
/// [`Scatter`](crate::impact::Scatter) in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draw {
    /// Mean before clipping.
    pub mean: f32,
    deviation: f32,
    state: u32,
}

impl Draw {
    /// Restitutions with a mean and a standard deviation (symbol s), as the plan's settings.
    pub fn new(mean: f32, deviation: f32, seed: u32) -> Self {
        Self {
            mean,
            deviation,
            // Mixing separates the streams of neighbouring seeds.
            state: mix_bits(seed.wrapping_mul(0x9E37_79B9) ^ 0x5851_F42D),
        }
    }

    #[inline]
    pub fn draw(&mut self) -> f32 {
        if self.deviation == 0.0 {
            return self.mean;
        }
        (self.mean + self.deviation * gauss(|| self.next_bits())).clamp(0.0, 1.0 - f32::EPSILON)
    }

    #[inline]
    fn next_bits(&mut self) -> u32 {
        self.state = self.state.wrapping_add(0x9E37_79B9);
        mix_bits(self.state)
    }
}

/// Mixes all bits (C. Wellons, hash-prospector, bias 0.17).
#[inline]
fn mix_bits(mut z: u32) -> u32 {
    z = (z ^ (z >> 16)).wrapping_mul(0x21f0_aaad);
    z = (z ^ (z >> 15)).wrapping_mul(0x735a_2d97);
    z ^ (z >> 15)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_clipped() {
        let mut wide = Draw::new(0.0, 0.3, 5);
        assert!((0..10_000).all(|_| (0.0..1.0).contains(&wide.draw())));
    }
}
