//! Sine and cosine of a phase, by the nearest of 256 nodes and a short polynomial.
//!
//! No `mul_add` and no platform routine: desk, emulated CPU and board give the same bits.

use core::f64::consts::TAU;

use super::Phase;
use super::fixed::high;
use super::node::{self, Fine};

/// Radians in one step of a phase.
const STEP: f32 = (TAU / 4_294_967_296.0) as f32;

/// The nearest node and the distance from it in steps of a phase, in -2^23..2^23.
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
#[must_use]
#[inline(always)]
pub fn sine_cosine_single(phase: Phase) -> (f32, f32) {
    let (index, distance) = nearest(phase);
    let [sine, cosine] = node::SINGLE[index];
    let d = distance as f32 * STEP;
    let z = d * d;
    let versine = z * (0.5 - z * (1.0 / 24.0));
    let arc = d - d * z * (1.0 / 6.0);
    (
        sine + (cosine * arc - sine * versine),
        cosine - (sine * arc + cosine * versine),
    )
}

/// Sine and cosine of a phase in steps of 2^-30: `1 << 30` is 1.
///
/// Uses f32 for the correction to the node, for CPUs with an FPU. Measured over 2^20 spread
/// phases and all nodes: error at most 2.6e-9, RMS 5.2e-10.
///
/// ```
/// use kband::arithmetic::{Phase, sine_cosine_fixed};
/// let (sine, cosine) = sine_cosine_fixed(Phase::from_radians(0.5));
/// assert!((f64::from(sine) / 1073741824.0 - 0.5_f64.sin()).abs() < 2.8e-9);
/// assert!((f64::from(cosine) / 1073741824.0 - 0.5_f64.cos()).abs() < 2.8e-9);
/// ```
#[must_use]
#[inline(always)]
pub fn sine_cosine_fixed(phase: Phase) -> (i32, i32) {
    let (index, distance) = nearest(phase);
    let [sine, cosine] = node::FIXED[index];
    let d = distance as f32 * STEP;
    let z = d * d;
    let versine = z * (0.5 - z * (1.0 / 24.0));
    let arc = d - d * z * (1.0 / 6.0);
    let (s, c) = (sine as f32, cosine as f32);
    (
        sine + (c * arc - s * versine) as i32,
        cosine - (s * arc + c * versine) as i32,
    )
}

/// Sine in steps of 2^-30 and cosine in steps of 2^-48 of a phase, by products of 32 bits into 64.
///
/// Measured over 2^20 spread phases and all nodes: error of the sine at most 9.8e-10, RMS 2.6e-10; of
/// the cosine at most 3.2e-11, RMS 6.4e-12.
#[inline(always)]
pub(crate) fn sine_cosine_fine(phase: Phase) -> (i32, i64) {
    let (index, distance) = nearest(phase);
    let Fine { fixed, cosine, .. } = &node::FINE[index];
    let [s, c] = *fixed;
    // The angle in steps of 2^-36 from 2 pi in steps of 2^-28; its square in steps of 2^-40.
    let d = rounded_high(distance << 8, 1_686_629_713);
    let z = rounded_high(d, d);
    // 1 - cos d from 2^25 / 24, sin d from 2^32 / 6.
    let versine = (z - high(high(z, z), 1_398_101)) >> 5;
    let arc = d - (high(high(z, d), 715_827_883) >> 8);
    let fall = i64::from(s) * i64::from(arc) + i64::from(c) * i64::from(versine);
    let rise = high(c, arc) - high(s, versine);
    (s + ((rise + 8) >> 4), cosine - (fall >> 18))
}

/// The upper half of the product, to the nearest.
#[inline(always)]
fn rounded_high(a: i32, b: i32) -> i32 {
    ((i64::from(a) * i64::from(b) + (1 << 31)) >> 32) as i32
}

/// Sine and cosine of a phase in steps of 2^-30, in integers alone, for CPUs without an FPU.
///
/// Measured over 2^20 spread phases and all nodes: error at most 3.8e-9, RMS 9.6e-10.
///
/// ```
/// use kband::arithmetic::{Phase, sine_cosine_integer};
/// let (sine, cosine) = sine_cosine_integer(Phase::from_radians(0.5));
/// assert!((f64::from(sine) / 1073741824.0 - 0.5_f64.sin()).abs() < 4e-9);
/// assert!((f64::from(cosine) / 1073741824.0 - 0.5_f64.cos()).abs() < 4e-9);
/// ```
#[must_use]
#[inline(always)]
pub fn sine_cosine_integer(phase: Phase) -> (i32, i32) {
    let (index, distance) = nearest(phase);
    let [sine, cosine] = node::FIXED[index];
    // 2 pi in steps of 2^-28: the angle in steps of 2^-34.
    let d = high(distance << 6, 1_686_629_713);
    let powers = Powers::of(d);
    (
        sine + powers.rise(sine, cosine),
        cosine - powers.rise(-cosine, sine),
    )
}

/// Sine and versine of an angle below 1/32 rad, in integers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Powers {
    /// `sin d`, steps of 2^-34.
    pub arc: i32,
    /// `d - sin d`, steps of 2^-34.
    pub lag: i32,
    /// `1 - cos d`, steps of 2^-36.
    pub versine: i32,
    /// `d^2 / 2 - (1 - cos d)`, steps of 2^-36.
    pub flat: i32,
}

impl Powers {
    /// Of `d` in steps of 2^-34.
    #[inline(always)]
    pub fn of(d: i32) -> Self {
        // d^2 / 2 from the upper and lower half of d; the square of the lower one is below a step.
        let (upper, lower) = (d >> 14, d & 0x3fff);
        let half_square = ((upper * upper) >> 5) + ((upper * lower) >> 18);
        // d^3 / 6, 16 bits of each factor; 10923 / 2^15 is 1/3.
        let lag = (((upper * (half_square >> 10)) >> 14) * 10_923) >> 13;
        // d^4 / 24 is (d^2 / 2)^2 / 6, 683 / 2^12 is 1/6.
        let short = half_square >> 16;
        let flat = (short * short * 683) >> 16;
        Self {
            arc: d - lag,
            lag,
            versine: half_square - flat,
            flat,
        }
    }

    /// `sin(t + d) - sin t`, steps of 2^-30.
    #[inline(always)]
    pub fn rise(&self, sine: i32, cosine: i32) -> i32 {
        (high(cosine, self.arc) >> 2) - (high(sine, self.versine) >> 4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest and RMS error over 2^20 phases spread by an odd stride, with the nodes and the places
    /// half way between them, where the polynomial reaches farthest.
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
    fn single_precision_holds_its_error() {
        let (largest, rms) = errors(|phase| {
            let (sine, cosine) = sine_cosine_single(phase);
            (f64::from(sine), f64::from(cosine))
        });
        std::println!("f32: max {largest:e} rms {rms:e}");
        assert!(largest < 6.1e-8 && rms < 2.2e-8);
    }

    #[test]
    fn fixed_point_holds_its_error() {
        let (largest, rms) = errors(|phase| {
            let (sine, cosine) = sine_cosine_fixed(phase);
            (
                f64::from(sine) / 1_073_741_824.0,
                f64::from(cosine) / 1_073_741_824.0,
            )
        });
        std::println!("Q30: max {largest:e} rms {rms:e}");
        assert!(largest < 2.7e-9 && rms < 5.5e-10);
    }

    #[test]
    fn the_fine_cosine_holds_its_error() {
        let (largest, rms) = errors(|phase| {
            let cosine = sine_cosine_fine(phase).1 as f64 / 281_474_976_710_656.0;
            (libm::sin(phase.radians()), cosine)
        });
        std::println!("fine cosine: max {largest:e} rms {rms:e}");
        // Half a step of the angle and of its arc 2.2e-11, of the versine's last bits 1.5e-11, the sixth
        // order left out 5e-15.
        assert!(largest < 3.8e-11 && rms < 8e-12);
        let (largest, rms) = errors(|phase| {
            let sine = f64::from(sine_cosine_fine(phase).0) / 1_073_741_824.0;
            (sine, libm::cos(phase.radians()))
        });
        std::println!("fine sine: max {largest:e} rms {rms:e}");
        // Half a step of the node's and half of its own 9.3e-10, the last bits of two products 1.2e-10.
        assert!(largest < 1.05e-9 && rms < 5e-10);
    }

    #[test]
    fn integers_hold_their_error() {
        let (largest, rms) = errors(|phase| {
            let (sine, cosine) = sine_cosine_integer(phase);
            (
                f64::from(sine) / 1_073_741_824.0,
                f64::from(cosine) / 1_073_741_824.0,
            )
        });
        std::println!("integer: max {largest:e} rms {rms:e}");
        assert!(largest < 4e-9 && rms < 1e-9);
    }
}
