//! Sine and cosine: of a phase by table lookup at the nearest of 256 nodes and a short polynomial,
//! of an angle in f64 by polynomials.
//!
//! There is no `mul_add` and no platform routine, so desk, emulated CPU and board give the same
//! bits.

use core::f64::consts::{FRAC_2_PI, TAU};

use super::Phase;
use super::fixed::Fixed;
use super::node;

const RADIANS_PER_STEP: f32 = Phase::RADIANS_PER_STEP as f32;

const RADIANS_PER_TURN: Fixed<28> = Fixed::<28>::from_constant(TAU);
/// 2 pi, to the last place.
pub(crate) const RADIANS_PER_TURN_FINE: Fixed<60, i64> = Fixed(7_244_019_458_077_122_842);

/// Nearest node, and the distance from it in steps of a phase, in -2^23..2^23.
#[inline(always)]
fn nearest(phase: Phase) -> (usize, i32) {
    let bits = phase.bits();
    let node = bits.wrapping_add(1 << 23) >> 24;
    ((node & 255) as usize, bits.wrapping_sub(node << 24) as i32)
}

/// Sine and cosine of a phase in f32; error at most 6.0e-8, RMS 2.1e-8.
#[inline(always)]
pub fn sine_cosine_single(phase: Phase) -> (f32, f32) {
    let (index, distance) = nearest(phase);
    let [sine, cosine] = node::SINE_COSINE_SINGLE[index];
    let d = distance as f32 * RADIANS_PER_STEP;
    let z = d * d;
    let versine = z * (0.5 - z * (1.0 / 24.0));
    let arc = d - d * z * (1.0 / 6.0);
    (
        sine + (cosine * arc - sine * versine),
        cosine - (sine * arc + cosine * versine),
    )
}

/// Sine and cosine of an angle in rad, -1e5..=1e5; error at most 8.4e-17, RMS 2.8e-17. Beyond, they
/// lose digits.
///
/// The method is the reduction of Cody and Waite with the polynomials of fdlibm (Sun Microsystems,
/// 1993). The routines of libm, for any angle, take 10 KiB of the board's image.
pub fn sine_cosine(angle: f64) -> (f64, f64) {
    // Adding and subtracting it rounds to an integer.
    const ROUNDING_OFFSET: f64 = 1.5 / f64::EPSILON;
    // Half of pi: 33 bits, and the rest.
    const HALF_PI: [f64; 2] = [1.570_796_326_734_125_6, 6.077_100_506_506_192e-11];
    const SINE: [f64; 6] = [
        -1.666_666_666_666_663_2e-1,
        8.333_333_333_322_49e-3,
        -1.984_126_982_985_795e-4,
        2.755_731_370_707_006_8e-6,
        -2.505_076_025_340_686_3e-8,
        1.589_690_995_211_55e-10,
    ];
    const COSINE: [f64; 6] = [
        4.166_666_666_666_66e-2,
        -1.388_888_888_887_411e-3,
        2.480_158_728_947_673e-5,
        -2.755_731_435_139_066_3e-7,
        2.087_572_321_298_175e-9,
        -1.135_964_755_778_819_5e-11,
    ];
    let quarters = (angle * FRAC_2_PI + ROUNDING_OFFSET) - ROUNDING_OFFSET;
    let high = angle - quarters * HALF_PI[0];
    let low = quarters * HALF_PI[1];
    let x = high - low;
    let rest = (high - x) - low;
    let z = x * x;
    let (w, cube) = (z * z, z * x);
    let [s1, s2, s3, s4, s5, s6] = SINE;
    let series = s2 + z * (s3 + z * s4) + z * w * (s5 + z * s6);
    let sine = if quarters == 0.0 {
        x + cube * (s1 + z * series)
    } else {
        x - ((z * (0.5 * rest - cube * series) - rest) - cube * s1)
    };
    let [c1, c2, c3, c4, c5, c6] = COSINE;
    let series = z * (c1 + z * (c2 + z * c3)) + w * w * (c4 + z * (c5 + z * c6));
    let (half, first) = (0.5 * z, 1.0 - 0.5 * z);
    let cosine = first + (((1.0 - first) - half) + (z * series - x * rest));
    match quarters as i64 & 3 {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

/// Arcsine of 0..=1, error below 3e-7 (Abramowitz & Stegun 4.4.46 in f32).
pub(crate) fn arcsine_single(x: f32) -> f32 {
    const COEFFICIENTS: [f32; 8] = [
        -0.001_262_491,
        0.006_670_09,
        -0.017_088_126,
        0.030_891_88,
        -0.050_174_305,
        0.088_978_98,
        -0.214_598_8,
        core::f32::consts::FRAC_PI_2,
    ];
    let sum = COEFFICIENTS.iter().fold(0.0, |sum, c| sum * x + c);
    core::f32::consts::FRAC_PI_2 - super::square_root_single(1.0 - x) * sum
}

/// Cosine of a phase, by products of 32 bits into 64; error at most 3.2e-11, RMS 9.0e-12.
pub(crate) fn cosine_fine(phase: Phase) -> Fixed<48, i64> {
    let (index, distance) = nearest(phase);
    let at_node = node::sine_cosine(index as u32);
    // The nearest multiples of 2^-30 and of 2^-48.
    let [s, c] = at_node.map(|Fixed(x)| Fixed::<30>(((x + (1 << 29)) >> 30) as i32));
    let [_, Fixed(x)] = at_node;
    let cosine = Fixed::<48, i64>((x + (1 << 11)) >> 12);
    let turns = Fixed::<32>(distance).to::<40>();
    let d: Fixed<36> = rounded_product(turns, RADIANS_PER_TURN);
    let z: Fixed<40> = rounded_product(d, d);
    let fourth: Fixed<48> = z.times(z);
    let third: Fixed<44> = z.times(d);
    // 1 - cos d and sin d.
    let versine =
        (z.scaled::<41>() - fourth.times(Fixed::<25>::from_constant(1.0 / 24.0))).to::<36>();
    let arc = d - third.times(Fixed::<32>::from_constant(1.0 / 6.0));
    let fall: Fixed<66, i64> = s.whole(arc) + c.whole(versine);
    cosine - fall.to::<48>()
}

/// Product from its upper half, rounded to nearest.
#[inline(always)]
fn rounded_product<const F: u32, const G: u32, const H: u32>(a: Fixed<F>, b: Fixed<G>) -> Fixed<H> {
    const { assert!(F + G == H + 32) };
    Fixed(((i64::from(a.0) * i64::from(b.0) + (1 << 31)) >> 32) as i32)
}

/// Sine and cosine of a phase in turns, in integers; error at most 1e-17.
pub(crate) fn sine_cosine_exact(phase: Fixed<48, i64>) -> [Fixed<60, i64>; 2] {
    let product = |a: Fixed<60, i64>, b| -> Fixed<60, i64> { a.times(b) };
    let over = |x: Fixed<60, i64>, n: i64| Fixed(x.0 / n);
    let one = Fixed::<60, i64>(1 << 60);
    let node = (phase + Fixed(1 << 39)).to::<8>();
    let [sine, cosine] = node::sine_cosine(node.0 as u32);
    let d = (phase - node.to()).times(RADIANS_PER_TURN_FINE);
    // Three terms of each Taylor series.
    let square = product(d, d);
    let series = |n: i64| {
        let next = one - over(square, (n + 2) * (n + 3));
        one - over(product(square, next), n * (n + 1))
    };
    let arc = product(d, series(2));
    let versine = over(product(square, series(3)), 2);
    [
        sine + product(cosine, arc) - product(sine, versine),
        cosine - product(sine, arc) - product(cosine, versine),
    ]
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::*;

    #[test]
    fn sine_and_cosine_are_libms() {
        let mut different = 0;
        for n in -1_000_000..=1_000_000 {
            let angle = f64::from(n) * if n % 2 == 0 { 1.000_37e-5 } else { 0.099_999_1 };
            let (sine, cosine) = sine_cosine(angle);
            let errors = [sine - libm::sin(angle), cosine - libm::cos(angle)];
            assert!(errors.iter().all(|error| error.abs() <= 1.2e-16), "{angle}");
            different += u32::from(errors != [0.0; 2]);
        }
        // The last bit of 20 of four million values differs.
        assert!(different <= 40, "{different}");
        // The distance of the rounded pi from pi.
        assert!((sine_cosine(PI).0 / 1.224_646_799_147_353_2e-16 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn cosine_of_a_phase_is_within_its_error() {
        const COUNT: u32 = 1_000_000;
        let (mut largest, mut squares) = (0.0_f64, 0.0);
        for n in 0..COUNT {
            // Steps of the golden section cover the turn evenly.
            let phase = Phase::from_bits(n.wrapping_mul(0x9E37_79B9));
            let Fixed(steps) = cosine_fine(phase);
            let error = steps as f64 / (1_u64 << 48) as f64 - libm::cos(phase.radians());
            largest = largest.max(error.abs());
            squares += error * error;
        }
        let rms = libm::sqrt(squares / f64::from(COUNT));
        assert!(largest < 3.2e-11 && rms < 9e-12, "{largest} {rms}");
    }

    #[test]
    fn arcsine_is_within_its_error() {
        for step in 0..=10_000 {
            let x = step as f32 / 10_000.0;
            let error = f64::from(arcsine_single(x)) - libm::asin(f64::from(x));
            assert!(error.abs() < 3e-7, "{x} {error}");
        }
    }
}
