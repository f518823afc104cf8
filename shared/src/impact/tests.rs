//! Tests of the arithmetics against each other, launch by launch.

use core::f64::consts::{FRAC_PI_2, TAU};

use super::*;

/// k, phase and velocity of launches: fast, slow, without a hump, and past the top of a hump.
fn launches() -> impl Iterator<Item = [f64; 3]> {
    (0..24_000).map(|n| {
        let [w, x, y, z] = [0.414_214, 0.618_034, 0.732_051, 0.236_068]
            .map(|factor| (f64::from(n) * factor).rem_euclid(1.0));
        let (k, phase) = (0.02 + 0.96 * x, TAU * w);
        match n % 4 {
            0 => [k, phase, 20.0 * y],
            1 => [k, phase, 3.0 * libm::exp10(-7.0 * y)],
            2 => [1.0 + 3.0 * x, phase, 20.0 * y],
            _ => {
                // After d, at a crest, the part is at this height and slope over the track.
                let (height, slope) = (0.02 * (x - 0.5), 0.4 * (y - 0.5));
                let d = FRAC_PI_2 + TAU * libm::floor(1.0 + 3.0 * z) - phase;
                let k = 2.0 * (1.0 + height - libm::sin(phase) - slope * d) / (d * d);
                [k, phase, k * d + slope - libm::cos(phase)]
            }
        }
    })
}

/// Compares the impacts of two arithmetics, by flights in rad and velocities. Launches within
/// rounding of a touch are left out.
fn compare<A: Kernel, B: Kernel>(max_error: f64, build: impl Fn(f64) -> (A, B)) {
    let mut compared = 0;
    for [k, phase, velocity] in launches() {
        if k < 0.02 || velocity < 0.0 {
            continue;
        }
        let (tried, exact) = build(k);
        let state = A::state(phase, velocity).unwrap();
        // Both start from the state as the tried arithmetic holds it.
        let held = A::observe(state);
        let expected = exact.impact(B::state(held.phase, held.velocity).unwrap());
        let actual = tried.impact(state);
        if actual.grazes || expected.grazes {
            continue;
        }
        compared += 1;
        let [next, expected_next] = [A::observe(actual.next), B::observe(expected.next)];
        let speed_error = (next.velocity - expected_next.velocity).abs();
        let error = speed_error.max((actual.flight - expected.flight).abs());
        assert!(error < max_error, "{}: {k:e} {held:?}: {error:e}", A::NAME);
    }
    assert!(compared > 18_000);
}

fn both<A: Kernel, B: Kernel>(k: f64) -> (A, B) {
    (A::build(k, 0.8).unwrap(), B::build(k, 0.8).unwrap())
}

#[test]
fn every_arithmetic_has_the_impacts_of_the_f64_map() {
    compare::<Integer, Map>(3e-8, both);
    compare::<Single, Map>(1e-3, both);
    compare::<WaveMap, Map>(1e-9, both);
}

#[test]
fn f32_has_the_impacts_of_f64_on_three_tones() {
    let tones = [Tone::new(0.15, 2.356), Tone::new(0.05, 1.0)];
    compare(1e-3, |k| {
        (
            Single::on_tones(tones, k, 0.8).unwrap(),
            WaveMap::on_tones(tones, k, 0.8).unwrap(),
        )
    });
}
