//! The library's own checks on the emulated CPU: golden impacts, bands, sine and cosine.
#![cfg_attr(target_os = "none", no_std, no_main)]

use kband::arithmetic::{Phase, sine_cosine_single};
use kband::impact::{Kernel, Map};
use kband::regime::band;
use kband_emulated::say;

kband_emulated::image!(run);

fn run() {
    golden_impacts();
    bands();
    sine_and_cosine();
}

// Reference values with 25 digits in `reference/`. Allowed error: 1e-12 where the condition number
// is below 100.
fn golden_impacts() {
    let (mut worst, mut count) = (0.0_f64, 0);
    for line in include_str!("../../../reference/impacts.csv")
        .lines()
        .skip(1)
    {
        let mut number = [0.0; 9];
        for (value, field) in number.iter_mut().zip(line.split(',')).skip(1) {
            *value = field.parse().expect("a number");
        }
        let [
            _,
            k,
            restitution,
            phase,
            velocity,
            flight,
            _,
            next_velocity,
            condition,
        ] = number;
        let map = Map::build(k, restitution).expect("parameters within range");
        let impact = map.impact(Map::state(phase, velocity).expect("a state within range"));
        if condition < 100.0 {
            let error = (impact.flight / flight - 1.0).abs();
            assert!(error < 1e-12, "{line}: {}", impact.flight);
            let error = (impact.next.velocity / next_velocity - 1.0)
                .abs()
                .max(error);
            worst = worst.max(error);
            count += 1;
        }
    }
    say!("{count} golden impacts, worst relative error {worst:e}");
}

// Equations (15) and (17a) at R = 0.2; the table gives six digits.
fn bands() {
    for (order, low, high) in [
        (1, 0.393052, 0.477465),
        (2, 0.225691, 0.238732),
        (3, 0.155109, 0.159155),
    ] {
        let flip = band::flip(0.2, order).expect("parameters within range");
        let birth = band::birth(0.2, order).expect("parameters within range");
        assert!((flip - low).abs() < 6e-7, "order {order}: {flip}");
        assert!((birth - high).abs() < 6e-7, "order {order}: {birth}");
    }
    say!("3 bands");
}

fn sine_and_cosine() {
    let mut largest = 0.0_f64;
    for n in 0..4096_u32 {
        let phase = Phase::from_bits(n.wrapping_mul(2_654_435_769));
        let (sine, cosine) = (libm::sin(phase.radians()), libm::cos(phase.radians()));
        let (s, c) = sine_cosine_single(phase);
        largest = largest
            .max((f64::from(s) - sine).abs())
            .max((f64::from(c) - cosine).abs());
    }
    say!("sine and cosine: largest error {largest:e}");
    // The largest error in its documentation.
    assert!(largest <= 6.0e-8);
}
