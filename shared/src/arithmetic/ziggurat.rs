//! Gaussian random numbers in single precision by the ziggurat method (Marsaglia and Tsang, J. Stat.
//! Softw. 5 (2000) 8), with the same bits on every machine.

/// Layers of equal area under the density; the lowest one includes the tail.
const LAYERS: usize = 128;

/// End of the tail; 2e-9 of all numbers would be beyond it.
const TAIL_END: f32 = 6.0;

/// Width of each layer, in standard deviations. The first is the width that the lowest layer would
/// have as a rectangle, from area V = 9.912563e-3 and tail R = 3.442620.
static WIDTHS: [f32; LAYERS + 1] = [
    3.713_086, 3.442_62, 3.223_085, 3.083_229, 2.978_696, 2.894_344, 2.823_125, 2.761_169,
    2.706_114, 2.656_406, 2.610_972, 2.569_034, 2.530_01, 2.493_455, 2.459_018, 2.426_421,
    2.395_434, 2.365_871, 2.337_575, 2.310_414, 2.284_274, 2.259_06, 2.234_686, 2.211_081,
    2.188_18, 2.165_927, 2.144_27, 2.123_166, 2.102_573, 2.082_456, 2.062_782, 2.043_522,
    2.024_647, 2.006_134, 1.987_96, 1.970_103, 1.952_546, 1.935_269, 1.918_257, 1.901_495,
    1.884_967, 1.868_661, 1.852_565, 1.836_665, 1.820_953, 1.805_417, 1.790_047, 1.774_834,
    1.759_77, 1.744_846, 1.730_054, 1.715_387, 1.700_837, 1.686_397, 1.672_061, 1.657_822,
    1.643_674, 1.629_611, 1.615_628, 1.601_718, 1.587_877, 1.574_098, 1.560_377, 1.546_709,
    1.533_088, 1.519_51, 1.505_969, 1.492_461, 1.478_982, 1.465_526, 1.452_089, 1.438_665,
    1.425_251, 1.411_842, 1.398_432, 1.385_017, 1.371_592, 1.358_152, 1.344_693, 1.331_208,
    1.317_693, 1.304_142, 1.290_55, 1.276_91, 1.263_218, 1.249_466, 1.235_649, 1.221_76, 1.207_792,
    1.193_737, 1.179_587, 1.165_336, 1.150_973, 1.136_49, 1.121_877, 1.107_124, 1.092_219,
    1.077_151, 1.061_906, 1.046_471, 1.030_83, 1.014_967, 0.998_864, 0.982_501, 0.965_855,
    0.948_903, 0.931_616, 0.913_965, 0.895_915, 0.877_427, 0.858_457, 0.838_952, 0.818_854,
    0.798_092, 0.776_584, 0.754_231, 0.730_912, 0.706_48, 0.680_748, 0.653_479, 0.624_359,
    0.592_963, 0.558_692, 0.520_656, 0.477_438, 0.426_548, 0.362_871, 0.272_321, 0.0,
];

/// Density times the root of 2 pi.
fn density(x: f32) -> f32 {
    libm::expf(-0.5 * x * x)
}

/// Gaussian number with mean 0 and standard deviation 1, within -6..6, from 32 random bits a call. A
/// table decides 97 % of them.
#[inline]
pub(crate) fn gauss(mut random_bits: impl FnMut() -> u32) -> f32 {
    loop {
        let bits = random_bits();
        let layer = bits as usize % LAYERS;
        let [width, next] = [WIDTHS[layer], WIDTHS[layer + 1]];
        // Uniform in -1..1 without 0, in steps of 2^-23.
        let x = ((bits as i32 >> 8) as f32 + 0.5) * (1.0 / 8_388_608.0) * width;
        if x.abs() < next {
            return x;
        }
        let decided = match layer {
            0 => Some(tail(next, &mut random_bits).copysign(x)),
            _ => wedge([width, next], x, &mut random_bits),
        };
        if let Some(x) = decided {
            return x;
        }
    }
}

/// Uniform in 0..1, in steps of 2^-24.
fn uniform(random_bits: &mut impl FnMut() -> u32) -> f32 {
    (random_bits() >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Accepts a number between the widths of this layer and the next if it is below the density.
#[cold]
#[inline(never)]
fn wedge(widths: [f32; 2], x: f32, random_bits: &mut impl FnMut() -> u32) -> Option<f32> {
    let [low, high] = widths.map(density);
    (low + uniform(random_bits) * (high - low) < density(x)).then_some(x)
}

/// Number beyond `begin`, by rejection from a uniform distribution, which needs no logarithm. One
/// number in 1700 comes from here.
#[cold]
#[inline(never)]
fn tail(begin: f32, random_bits: &mut impl FnMut() -> u32) -> f32 {
    loop {
        let x = begin + uniform(random_bits) * (TAIL_END - begin);
        if uniform(random_bits) * density(begin) < density(x) {
            return x;
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::arithmetic::splitmix;

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
    fn single_numbers_are_gaussian() {
        let mut state = 0_u64;
        let mut bits = || {
            state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
            (splitmix(state) >> 32) as u32
        };
        assert_gaussian(|| gauss(&mut bits).into());
    }

    /// The recurrence of the paper: a layer ends where the density is higher by area over width. With
    /// the paper's constants the last one ends at 9e-6 instead of 0.
    #[test]
    fn widths_give_layers_of_equal_area() {
        const AREA: f64 = 9.912_563_035_262_17e-3;
        let mut x = 3.442_619_855_899;
        let density = |x: f64| libm::exp(-0.5 * x * x);
        assert!((f64::from(WIDTHS[0]) - AREA / density(x)).abs() < 6e-7);
        for &width in &WIDTHS[1..] {
            assert!((f64::from(width) - x).abs() < 1e-5, "{width} {x}");
            let above: f64 = density(x) + AREA / x;
            x = libm::sqrt(-2.0 * libm::log(above.min(1.0)));
        }
    }
}
