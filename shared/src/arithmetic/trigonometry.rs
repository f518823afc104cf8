//! Sine and cosine of a phase by table lookup at the nearest of 256 nodes and a short polynomial.
//!
//! There is no `mul_add` and no platform routine, so desk, emulated CPU and board give the same
//! bits.

use core::f64::consts::TAU;

use super::Phase;
use super::fixed::Fixed;
use super::node::{self, Fine};

/// Radians in one step of a phase.
const RADIANS_PER_STEP: f32 = Phase::RADIANS_PER_STEP as f32;

/// 2 pi.
pub(crate) const RADIANS_PER_TURN: Fixed<28> = Fixed::<28>::from_constant(TAU);
/// 1 / (2 pi).
pub(crate) const TURNS_PER_RADIAN: Fixed<32> = Fixed::<32>::from_constant(1.0 / TAU);

/// Nearest node, and the distance from it in steps of a phase, in -2^23..2^23.
#[inline(always)]
fn nearest(phase: Phase) -> (usize, i32) {
    let bits = phase.bits();
    let node = bits.wrapping_add(1 << 23) >> 24;
    ((node & 255) as usize, bits.wrapping_sub(node << 24) as i32)
}

/// Sine and cosine of a phase in f32.
///
/// Measured over 2^20 spread phases and all nodes: error at most 6.0e-8, RMS 2.1e-8.
///
/// ```
/// use kband::arithmetic::{Phase, sine_cosine_single};
/// let (sine, cosine) = sine_cosine_single(Phase::from_radians(0.5));
/// assert!((f64::from(sine) - 0.5_f64.sin()).abs() < 6.1e-8);
/// assert!((f64::from(cosine) - 0.5_f64.cos()).abs() < 6.1e-8);
/// ```
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

/// Sine and, more accurate, cosine of a phase, by products of 32 bits into 64.
///
/// Measured over 2^20 spread phases and all nodes: the sine's error is at most 9.8e-10 (RMS
/// 2.6e-10), the cosine's 3.2e-11 (RMS 6.4e-12).
#[inline(always)]
pub(crate) fn sine_cosine_fine(phase: Phase) -> (Fixed<30>, Fixed<48, i64>) {
    let (index, distance) = nearest(phase);
    let Fine { fixed, cosine, .. } = &node::FINE_NODES[index];
    let [s, c] = *fixed;
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
    let rise: Fixed<34> = c.times(arc) - s.times(versine);
    (
        s + (rise + Fixed::<34>(8)).to::<30>(),
        *cosine - fall.to::<48>(),
    )
}

/// Product from its upper half, rounded to nearest.
#[inline(always)]
fn rounded_product<const F: u32, const G: u32, const H: u32>(a: Fixed<F>, b: Fixed<G>) -> Fixed<H> {
    const { assert!(F + G == H + 32) };
    Fixed(((i64::from(a.0) * i64::from(b.0) + (1 << 31)) >> 32) as i32)
}

/// Sine and cosine of a phase in steps of 2^-30, in integers only, for CPUs without an FPU.
///
/// Measured over 2^20 spread phases and all nodes: error at most 3.8e-9, RMS 9.6e-10.
#[inline(always)]
pub(crate) fn sine_cosine_narrow(phase: Phase) -> [Fixed<30>; 2] {
    let (index, distance) = nearest(phase);
    let [sine, cosine] = node::SINE_COSINE_FIXED[index];
    let turns = Fixed::<32>(distance).to::<38>();
    let powers = Powers::new(turns.times(RADIANS_PER_TURN));
    [
        sine + powers.rise(sine, cosine),
        cosine - powers.rise(-cosine, sine),
    ]
}

/// Sine and versine of an angle below 1/32 rad, in integers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Powers {
    /// `sin d`.
    pub arc: Fixed<34>,
    /// `d - sin d`.
    pub lag: Fixed<34>,
    /// `1 - cos d`.
    pub versine: Fixed<36>,
    /// `d^2 / 2 - (1 - cos d)`.
    pub flat: Fixed<36>,
}

impl Powers {
    /// Values for an angle `d`.
    #[inline(always)]
    pub fn new(d: Fixed<34>) -> Self {
        // d^2 / 2 from both halves of d; the square of the lower one is below a step.
        let (upper, lower) = (d.to::<20>(), Fixed::<34>(d.0 & 0x3fff));
        let square: Fixed<35> = upper.short_times(upper);
        let mixed: Fixed<36> = upper.short_times(lower);
        let half_square = square.scaled::<36>() + mixed;
        // d^3 / 6, 16 bits of each factor.
        let half_cube: Fixed<32> = upper.short_times(half_square.to::<26>());
        let lag = half_cube.short_times(Fixed::<15>::from_constant(1.0 / 3.0));
        // d^4 / 24 is (d^2 / 2)^2 / 6.
        let short = half_square.to::<20>();
        let fourth: Fixed<40> = short.short_times(short);
        let flat = fourth.short_times(Fixed::<12>::from_constant(1.0 / 6.0));
        Self {
            arc: d - lag,
            lag,
            versine: half_square - flat,
            flat,
        }
    }

    /// `sin(t + d) - sin t`.
    #[inline(always)]
    pub fn rise(&self, sine: Fixed<30>, cosine: Fixed<30>) -> Fixed<30> {
        cosine.times::<34, 30>(self.arc) - sine.times(self.versine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest and RMS error over 2^20 phases with an odd stride, the nodes, and the midpoints,
    /// where the polynomial is least accurate.
    fn errors(evaluate: impl Fn(Phase) -> (f64, f64)) -> (f64, f64) {
        let spread = (0..1_u32 << 20).map(|i| i.wrapping_mul(2_654_435_769));
        let corners = (0..512_u32).flat_map(|j| {
            let middle = j << 23;
            [middle.wrapping_sub(1), middle, middle + 1]
        });
        let (mut largest, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
        for bits in spread.chain(corners) {
            let phase = Phase::from_bits(bits);
            let (sine, cosine) = evaluate(phase);
            let angle = phase.radians();
            for error in [sine - libm::sin(angle), cosine - libm::cos(angle)] {
                largest = largest.max(error.abs());
                squares += error * error;
                count += 1.0;
            }
        }
        (largest, libm::sqrt(squares / count))
    }

    #[test]
    fn arcsine_is_within_its_error() {
        for step in 0..=10_000 {
            let x = step as f32 / 10_000.0;
            let error = f64::from(arcsine_single(x)) - libm::asin(f64::from(x));
            assert!(error.abs() < 3e-7, "{x} {error}");
        }
    }

    #[test]
    fn f32_sine_is_within_its_error() {
        let (largest, rms) = errors(|phase| {
            let (sine, cosine) = sine_cosine_single(phase);
            (f64::from(sine), f64::from(cosine))
        });
        std::println!("f32: max {largest:e} rms {rms:e}");
        assert!(largest < 6.1e-8 && rms < 2.2e-8);
    }

    #[test]
    fn fine_cosine_is_within_its_error() {
        let (largest, rms) = errors(|phase| {
            let cosine = sine_cosine_fine(phase).1.0 as f64 / libm::exp2(48.0);
            (libm::sin(phase.radians()), cosine)
        });
        std::println!("fine cosine: max {largest:e} rms {rms:e}");
        // Error bound: 2.2e-11 from half a step of the angle and its arc, 1.5e-11 from the versine,
        // 5e-15 from the sixth order.
        assert!(largest < 3.8e-11 && rms < 8e-12);
        let (largest, rms) = errors(|phase| {
            let sine = f64::from(sine_cosine_fine(phase).0.0) / f64::from(1 << 30);
            (sine, libm::cos(phase.radians()))
        });
        std::println!("fine sine: max {largest:e} rms {rms:e}");
        // Error bound: 9.3e-10 from half a step of the node and of the result, 1.2e-10 from two
        // products.
        assert!(largest < 1.05e-9 && rms < 5e-10);
    }

    #[test]
    fn integer_sine_is_within_its_error() {
        let (largest, rms) = errors(|phase| {
            let [sine, cosine] = sine_cosine_narrow(phase).map(|Fixed(value)| value);
            (
                f64::from(sine) / f64::from(1 << 30),
                f64::from(cosine) / f64::from(1 << 30),
            )
        });
        std::println!("integer: max {largest:e} rms {rms:e}");
        assert!(largest < 4e-9 && rms < 1e-9);
    }
}
