//! Phases and angles in single precision, and their advance from sample to sample.

use core::f32::consts::TAU;
use kband::arithmetic::{Phase, sine_cosine};
use num_complex::Complex32;

/// Samples per second of the signal path.
pub const SAMPLE_RATE: u32 = 20_000;

const STEP: f32 = TAU / Phase::TURN as f32;

/// The phase of an angle in rad, -8..8: nearest within the rounding of f32 (2.4e-7 rad at pi).
pub fn phase_of(radians: f32) -> Phase {
    let turns = radians * (1.0 / TAU);
    Phase::from_bits((turns * Phase::TURN as f32) as i64 as u32)
}

/// The angle of a phase in rad, -pi..pi, error at most 2e-7 rad.
pub fn radians_of(phase: Phase) -> f32 {
    phase.bits() as i32 as f32 * STEP
}

/// The phasor e^(i angle) of an angle in rad, rounded from f64.
pub fn unit_phasor(angle: f32) -> Complex32 {
    let (sine, cosine) = sine_cosine(f64::from(angle));
    Complex32::new(cosine as f32, sine as f32)
}

/// Advance of the phase per sample for a frequency in Hz, 0..5000; error 2.4e-6 Hz or 1.2e-7 of it.
pub fn phase_step(frequency: f32) -> u32 {
    (f64::from(frequency) * (Phase::TURN / f64::from(SAMPLE_RATE)) + 0.5) as u32
}

/// Time of an impact in 2^-32 cycles: cycle number, phase of the output, the track's lead over it.
pub fn impact_time(count: u32, phase: Phase, lead: Phase) -> u64 {
    (u64::from(count) << 32 | u64::from(phase.bits()))
        .wrapping_add_signed(i64::from(lead.bits() as i32))
}
