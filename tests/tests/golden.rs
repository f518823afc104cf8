//! The golden impacts and hops (25 digits) against the map in f64 and its exact mode.

use kband::impact::{Exact, Kernel, Map};

/// One row: what goes in, what comes out.
struct Golden {
    k: f64,
    restitution: f64,
    phase: f64,
    velocity: f64,
    flight: &'static str,
    next_phase: Option<&'static str>,
    next_velocity: &'static str,
    condition: f64,
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

fn impacts() -> impl Iterator<Item = Golden> {
    include_str!("../reference/impacts.csv")
        .lines()
        .skip(1)
        .map(|line| {
            let field: Vec<&'static str> = line.split(',').collect();
            Golden {
                k: number(field[1]),
                restitution: number(field[2]),
                phase: number(field[3]),
                velocity: number(field[4]),
                flight: field[5],
                next_phase: Some(field[6]),
                next_velocity: field[7],
                condition: number(field[8]),
            }
        })
}

fn hops() -> impl Iterator<Item = Golden> {
    include_str!("../reference/hops.csv")
        .lines()
        .skip(1)
        .map(|line| {
            let field: Vec<&'static str> = line.split(',').collect();
            let (restitution, flight) = (number(field[2]), number(field[5]));
            let arrival = number(field[6]) / restitution;
            Golden {
                k: number(field[1]),
                restitution,
                phase: number(field[3]),
                velocity: number(field[4]),
                flight: field[5],
                next_phase: None,
                next_velocity: field[6],
                condition: flight / arrival,
            }
        })
}

#[test]
fn every_golden_impact_has_the_right_root() {
    let mut counted = 0;
    for golden in impacts().chain(hops()) {
        let map = Map::build(golden.k, golden.restitution).unwrap();
        let state = Map::state(golden.phase, golden.velocity).unwrap();
        let impact = map.impact(state);
        let (flight, velocity) = (number(golden.flight), number(golden.next_velocity));
        // The right root at any condition: another one is at least 1e-3 away.
        assert!(
            (impact.flight / flight - 1.0).abs() < 1e-6,
            "{flight}: {impact:?}"
        );
        // Half a dozen roundings of 1.1e-16, times a condition of up to 100: 1e-12 leaves room for 10.
        if golden.condition < 100.0 {
            assert!((impact.flight / flight - 1.0).abs() < 1e-12, "{impact:?}");
            let error = (impact.next.velocity - velocity).abs();
            assert!(error <= 1e-12 * velocity.max(1e-3 * flight), "{impact:?}");
            if let Some(phase) = golden.next_phase {
                let error = (impact.next.phase - number(phase)).abs();
                assert!(error < 1e-12 * flight.max(1.0), "{impact:?}");
            }
            counted += 1;
        }
    }
    assert!(counted > 2_500, "{counted}");
}

/// Units of 1e-20 of an f64 in 2^-10..2^9 and of a decimal with at least 20 places.
fn fixed(value: f64) -> i128 {
    let bits = value.to_bits();
    let mantissa = i128::from(bits & ((1 << 52) - 1) | 1 << 52);
    let exponent = (bits >> 52) as i32 - 1075;
    let scaled = mantissa * 10_i128.pow(20);
    (scaled + (1_i128 << (-exponent - 1))) >> -exponent
}

fn fixed_decimal(text: &str) -> i128 {
    let (whole, places) = text.split_once('.').unwrap();
    let places: i128 = places[..20].parse().unwrap();
    whole.parse::<i128>().unwrap() * 10_i128.pow(20) + places
}

#[test]
fn the_exact_mode_rounds_phases_correctly() {
    let (mut counted, mut beyond_half) = (0, 0);
    for golden in impacts() {
        let kernel = Exact::build(golden.k, golden.restitution).unwrap();
        let state = Exact::state(golden.phase, golden.velocity).unwrap();
        let phase = kernel.impact(state).next.phase;
        let expected = golden.next_phase.unwrap();
        if golden.condition < 1000.0 && phase > 0.1 && expected.len() > 22 {
            let error = (fixed(phase) - fixed_decimal(expected)).abs();
            let ulp = 1e20 * (f64::from_bits(phase.to_bits() + 1) - phase);
            assert!(
                error as f64 <= 0.51 * ulp + 2.0,
                "{} ulp: {expected} {phase}",
                error as f64 / ulp
            );
            beyond_half += i32::from(error as f64 > 0.5 * ulp + 2.0);
            counted += 1;
        }
    }
    assert!(counted > 900, "{counted}");
    println!("{beyond_half} of {counted} phases are not the nearest f64");
}
