//! Fixed point: velocities of the kernels without f64, and integer arithmetic for CPUs without an FPU.

use crate::feeder::{OutOfRange, accept};

/// Velocity relative to the track (symbol psi) in units of `b w`: 0..64 in steps of 2^-26 (1.5e-8).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Velocity(u32);

impl Velocity {
    /// Velocity 0: at rest where the track does not throw.
    pub const ZERO: Self = Self(0);

    /// The velocity with these bits, in units of 2^-26.
    #[must_use]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// The bits, in units of 2^-26.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// The nearest velocity to `value` in units of `b w`, refused outside 0..`limit`, of which
    /// `accepted` tells.
    pub(crate) fn build(
        value: f64,
        limit: f64,
        accepted: &'static str,
    ) -> Result<Self, OutOfRange> {
        accept("velocity", value, (0.0..=limit).contains(&value), accepted)?;
        Ok(Self(libm::round(value * 67_108_864.0) as u32))
    }

    /// The velocity in units of `b w`, exact.
    #[must_use]
    pub fn value(self) -> f64 {
        f64::from(self.0) * (1.0 / 67_108_864.0)
    }
}

/// Whether the CPU multiplies 32 by 32 bits into 32 only (Cortex-M0): wide products are then put
/// together from halves. The bits are the same.
const NARROW: bool = cfg!(all(
    target_arch = "arm",
    target_os = "none",
    not(target_has_atomic = "32")
));

/// The whole product.
#[inline(always)]
pub(crate) fn wide(a: u32, b: u32) -> u64 {
    if NARROW {
        wide_by_halves(a, b)
    } else {
        u64::from(a) * u64::from(b)
    }
}

#[inline(never)]
fn wide_by_halves(a: u32, b: u32) -> u64 {
    let (a_high, a_low) = (a >> 16, a & 0xffff);
    let (b_high, b_low) = (b >> 16, b & 0xffff);
    let low = a_low * b_low;
    // Below 2^32: (2^16 - 1)^2 + 2^16 - 1.
    let one = a_high * b_low + (low >> 16);
    let two = a_low * b_high + (one & 0xffff);
    let high = a_high * b_high + (one >> 16) + (two >> 16);
    (u64::from(high) << 32) | u64::from((two << 16) | (low & 0xffff))
}

/// The upper half of the product, rounded down.
#[inline(always)]
pub(crate) fn high(a: i32, b: i32) -> i32 {
    if NARROW {
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

/// `1 / x` of an integer, as `mantissa 2^(shift - 62)` with the mantissa in 2^30..=2^31.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reciprocal {
    pub mantissa: u32,
    pub shift: u32,
}

/// 256 / (m + 1/2) for m = 1/2..1 in steps of 1/256, less 256.
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

impl Reciprocal {
    /// To about 2^-15 of `x` > 0: one Newton step in 32 bits from the table.
    #[inline(always)]
    pub fn coarse(x: u32) -> Self {
        let shift = leading_zeros(x);
        let m = x << shift;
        let first = 256 + u32::from(RECIPROCALS[((m >> 24) & 127) as usize]);
        let miss = (1_i32 << 24) - (first * (m >> 16)) as i32;
        let second = (first << 8) as i32 + ((first as i32 * miss) >> 16);
        Self {
            mantissa: (second as u32) << 14,
            shift,
        }
    }

    /// To about 2^-29 of `x` > 0: one more Newton step.
    #[inline(always)]
    pub fn fine(x: u32) -> Self {
        let Self { mantissa, shift } = Self::coarse(x);
        let m = x << shift;
        let miss = (1_i32 << 30) - (wide(m, mantissa) >> 32) as i32;
        let gain = ((mantissa >> 14) as i32 * (miss >> 1)) >> 15;
        Self {
            mantissa: mantissa.wrapping_add(gain as u32),
            shift,
        }
    }

    /// `a / x` in steps of `2^-places`, towards 0, saturating.
    #[inline(always)]
    pub fn times(self, a: i32, places: u32) -> i32 {
        let size = self.scale(a.unsigned_abs(), places);
        if a < 0 { -size } else { size }
    }

    #[inline(never)]
    fn scale(self, a: u32, places: u32) -> i32 {
        let product = wide(a, self.mantissa);
        let (low, high) = (product as u32, (product >> 32) as u32);
        let down = 62 - (self.shift + places) as i32;
        let size = if down >= 32 {
            high >> (down - 32).min(31)
        } else if down > 0 && high >> (down - 1) == 0 {
            (high << (32 - down)) | (low >> down)
        } else if product == 0 {
            0
        } else {
            u32::MAX
        };
        size.min(i32::MAX as u32) as i32
    }
}

/// The whole product of signed factors.
#[inline(always)]
pub(crate) fn wide_signed(a: i32, b: i32) -> i64 {
    let product = wide(a.unsigned_abs(), b.unsigned_abs()) as i64;
    if (a ^ b) < 0 { -product } else { product }
}

/// Leading zero bits of `x` > 0.
#[inline(always)]
fn leading_zeros(x: u32) -> u32 {
    if !NARROW {
        return x.leading_zeros();
    }
    let (mut x, mut zeros) = (x, 0);
    if x >> 16 == 0 {
        x <<= 16;
        zeros = 16;
    }
    if x >> 24 == 0 {
        x <<= 8;
        zeros += 8;
    }
    if x >> 28 == 0 {
        x <<= 4;
        zeros += 4;
    }
    if x >> 30 == 0 {
        x <<= 2;
        zeros += 2;
    }
    zeros + u32::from(x >> 31 == 0)
}

/// 256 / sqrt(m + 1/2) for m = 1/4..1 in steps of 1/256, less 256.
const INVERSE_ROOTS: [u8; 192] = {
    let mut table = [0; 192];
    let mut i = 0;
    while i < 192 {
        // The nearest y with y^2 m = 2^25 for m in half steps of 1/256.
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

/// `2^16 sqrt(x)` to about 2^-15 of it, saturating just below 2^32.
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
    use super::*;

    #[test]
    fn a_velocity_is_the_nearest_step() {
        for value in [0.0, 1e-9, 0.3, 1.0, 28.999, 59.999_999_99] {
            let velocity = Velocity::build(value, 60.0, "0..60").unwrap();
            assert!((velocity.value() - value).abs() <= 0.5 / 67_108_864.0);
        }
        for value in [-1e-9, 60.1, f64::NAN, f64::INFINITY] {
            assert_eq!(
                Velocity::build(value, 60.0, "0..60").unwrap_err().parameter,
                "velocity"
            );
        }
    }

    /// Values over every magnitude.
    fn magnitudes() -> impl Iterator<Item = u32> {
        (0..32).flat_map(|shift| (0..200_u32).map(move |i| (u32::MAX - i * 10_737_419) >> shift))
    }

    #[test]
    fn halves_give_the_whole_product() {
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
    fn reciprocals_hold_their_error() {
        for x in magnitudes() {
            let value =
                |r: Reciprocal| f64::from(r.mantissa) * libm::exp2(f64::from(r.shift) - 62.0);
            let (coarse, fine) = (Reciprocal::coarse(x), Reciprocal::fine(x));
            // Measured: 3.1e-5 and 1.6e-9.
            assert!((value(coarse) * f64::from(x) - 1.0).abs() < 4e-5, "{x}");
            assert!((value(fine) * f64::from(x) - 1.0).abs() < 4e-9, "{x}");
        }
    }

    #[test]
    fn roots_hold_their_error() {
        for x in magnitudes() {
            let expected = libm::sqrt(f64::from(x)) * 65_536.0;
            let error = f64::from(square_root_scaled(x)) / expected - 1.0;
            // Measured: 5e-5.
            assert!(error.abs() < 7e-5, "{x} {error}");
        }
    }
}
