//! Seeded integer noise with the same bits on every machine.

/// A seeded stream of xorshift64* numbers (Vigna 2016).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noise(u64);

impl Noise {
    /// Stream of a seed; splitmix64 separates the streams of neighbouring seeds.
    pub fn new(seed: u64) -> Self {
        Self(splitmix(seed) | 1)
    }

    /// Next 32 bits.
    #[inline]
    pub fn bits(&mut self) -> u32 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32) as u32
    }

    /// A uniform number in 0..1, in steps of 2^-24.
    pub fn uniform(&mut self) -> f32 {
        (self.bits() >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// A nearly Gaussian number with mean 0, RMS 1 and bound 3.4: the sum of four uniform bytes.
    #[inline]
    pub fn gauss(&mut self) -> f32 {
        let bits = self.bits();
        let pairs = (bits & 0x00ff_00ff) + ((bits >> 8) & 0x00ff_00ff);
        let sum = (pairs & 0xffff) + (pairs >> 16);
        // The sum of four uniform bytes has mean 510 and variance 4 (256^2 - 1) / 12 = 147.8^2.
        (sum as f32 - 510.0) * (1.0 / 147.801)
    }
}

/// Next number of splitmix64 (Steele, Lea & Flood 2014); each adds 0x9E37_79B9_7F4A_7C15 to the
/// state.
#[inline]
pub(crate) fn splitmix(state: u64) -> u64 {
    let mut z = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}
