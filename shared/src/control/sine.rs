//! Sine and cosine of a phase in single precision, by the same few operations on every machine.

use core::f32::consts::TAU;

use crate::arithmetic::Phase;

const STEP: f32 = TAU / 4_294_967_296.0;

/// (sine, cosine) of a phase; measured error at most 1.1e-7 each, about 25 instructions on an M4F.
///
/// The phase is folded to within an eighth of a turn of a quarter; Taylor polynomials of degree 9 and
/// 10 are exact to rounding there (the first terms left out are 2e-9 and 1e-10).
#[inline]
#[must_use]
pub fn sine_cosine(phase: Phase) -> (f32, f32) {
    let quarter = phase.bits().wrapping_add(1 << 29) >> 30;
    let x = phase.bits().wrapping_sub(quarter << 30) as i32 as f32 * STEP;
    let z = x * x;
    let sine =
        x + x * z * (-1.666_666_7e-1 + z * (8.333_334e-3 + z * (-1.984_127e-4 + z * 2.755_732e-6)));
    let cosine = 1.0
        + z * (-0.5
            + z * (4.166_666_8e-2 + z * (-1.388_889e-3 + z * (2.480_159e-5 - z * 2.755_732e-7))));
    match quarter {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

/// The phase of an angle in rad, -8..8: nearest within the rounding of f32 (2.4e-7 rad at pi).
#[must_use]
pub fn phase_of(radians: f32) -> Phase {
    let turns = radians * (1.0 / TAU);
    Phase::from_bits((turns * 4_294_967_296.0) as i64 as u32)
}

/// The angle of a phase in rad, -pi..pi, error at most 2e-7 rad.
#[must_use]
pub fn radians_of(phase: Phase) -> f32 {
    phase.bits() as i32 as f32 * STEP
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_hold_their_measured_error_on_the_whole_circle() {
        let mut worst = 0.0_f64;
        for n in 0..200_000_u32 {
            let phase = Phase::from_bits(n.wrapping_mul(2_654_435_761));
            let (s, c) = sine_cosine(phase);
            let (sine, cosine) = libm::sincos(phase.radians());
            worst = worst
                .max(libm::fabs(f64::from(s) - sine))
                .max(libm::fabs(f64::from(c) - cosine));
        }
        assert!(worst < 1.1e-7, "{worst:e}");
    }

    #[test]
    fn an_angle_survives_the_way_through_a_phase() {
        for n in -31..=31 {
            let angle = n as f32 * 0.1;
            assert!((radians_of(phase_of(angle)) - angle).abs() < 5e-7);
        }
    }
}
